"""Files of the compiled drive, as the table of formats has them: FMUs, and archives of folders."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, get_args

from pydantic import Field

from microvib.errors import MicrovibError
from microvib.export.native.drive import exportable
from microvib.export.native.fmu import export_fmu
from microvib.export.native.library import export_c_library
from microvib.export.native.wasm import export_wasm
from microvib.export.subject import Subject
from microvib.model.part import Part
from microvib.model.scenario import Scenario

Native = Literal["linux64", "linux-arm64", "win64", "darwin64", "darwin-arm64"]
NativeInFmi2 = Literal["linux64", "win64", "darwin64"]


class LibraryOptions(Part):
    """Platforms of the binaries."""

    platforms: tuple[Native, ...] = Field(
        default=(), description=f"list of {', '.join(get_args(Native))}; without it this machine's"
    )


class FmuOptions(Part):
    """Kind and name of an FMU."""

    kind: Literal["source", "drive", "tones"] = Field(
        default="source",
        description="source, drive (the host has the array's modes) or tones (lines alone)",
    )
    model: str = Field(default="sada", description="name of the model, a word")

    def _consistency_errors(self) -> Iterator[str]:
        if not re.fullmatch(r"[A-Za-z_]\w*", self.model, re.ASCII):
            yield f"model: '{self.model}' is not allowed; a word of letters a to z, digits and _ is expected"


class Fmu2Options(FmuOptions):
    """Kind, name and platforms of an FMU of FMI 2.0."""

    platforms: tuple[NativeInFmi2, ...] = Field(
        default=(),
        description=f"list of {', '.join(get_args(NativeInFmi2))}; without it this machine's",
    )


class Fmu3Options(FmuOptions, LibraryOptions):
    """Kind, name and platforms of an FMU of FMI 3.0."""


def not_exportable(scenario: Scenario) -> str:
    """Sentence on why a drive has no compiled form; empty where it has."""
    try:
        exportable(scenario)
    except MicrovibError as error:
        return str(error)
    return ""


def write_fmu2(subject: Subject, path: Path, options: Fmu2Options) -> None:
    """Write an FMU of FMI 2.0."""
    _write_fmu(subject, path, options, 2)


def write_fmu3(subject: Subject, path: Path, options: Fmu3Options) -> None:
    """Write an FMU of FMI 3.0."""
    _write_fmu(subject, path, options, 3)


def _write_fmu(
    subject: Subject, path: Path, options: Fmu2Options | Fmu3Options, version: int
) -> None:
    with TemporaryDirectory() as folder:
        made = export_fmu(
            subject.scenario,
            Path(folder) / f"{options.model}.fmu",
            version=version,
            kind=options.kind,
            platforms=options.platforms,
        )
        shutil.copyfile(made, path)


def write_c_library(subject: Subject, path: Path, options: LibraryOptions) -> None:
    """Write an archive of the C library's folder."""
    with TemporaryDirectory() as folder:
        made = export_c_library(
            subject.scenario, Path(folder) / "microvib-drive", platforms=options.platforms
        )
        _write_archive(made, path)


def write_wasm(subject: Subject, path: Path, _: Part) -> None:
    """Write an archive of the WebAssembly module's folder."""
    with TemporaryDirectory() as folder:
        _write_archive(export_wasm(subject.scenario, Path(folder) / "microvib-drive"), path)


def _write_archive(folder: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder.parent))
