"""Files of the compiled drive, as the table of formats has them: FMUs, and archives of folders."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Collection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from pydantic import Field

from microvib.errors import MicrovibError, ScenarioError
from microvib.export.native.drive import exportable
from microvib.export.native.fmu import FOLDERS, export_fmu
from microvib.export.native.library import export_c_library
from microvib.export.native.wasm import export_wasm
from microvib.export.subject import Subject
from microvib.model.part import Part
from microvib.model.scenario import Scenario

_NATIVE = ", ".join(FOLDERS[3])


class LibraryOptions(Part):
    """Platforms of the binaries."""

    platforms: tuple[str, ...] = Field(
        default=(), description=f"list of {_NATIVE}; without it this machine's"
    )


class FmuOptions(LibraryOptions):
    """Kind, name and platforms of an FMU."""

    kind: Literal["source", "drive", "tones"] = Field(
        default="source",
        description="source, drive (the host has the array's modes) or tones (lines alone)",
    )
    model: str = Field(
        default="sada", pattern=r"^[A-Za-z_]\w*$", description="name of the model, a word"
    )


def not_exportable(scenario: Scenario) -> str:
    """Sentence on why a drive has no compiled form; empty where it has."""
    try:
        exportable(scenario)
    except MicrovibError as error:
        return str(error)
    return ""


def write_fmu2(subject: Subject, path: Path, options: FmuOptions) -> None:
    """Write an FMU of FMI 2.0."""
    _write_fmu(subject, path, options, 2)


def write_fmu3(subject: Subject, path: Path, options: FmuOptions) -> None:
    """Write an FMU of FMI 3.0."""
    _write_fmu(subject, path, options, 3)


def _write_fmu(subject: Subject, path: Path, options: FmuOptions, version: int) -> None:
    _check_platforms(f"fmu{version}", options.platforms, FOLDERS[version])
    with TemporaryDirectory() as folder:
        made = export_fmu(
            subject.scenario,
            Path(folder) / f"{options.model}.fmu",
            version=version,
            kind=options.kind,
            platforms=options.platforms,
        )
        shutil.copyfile(made, path)


def _check_platforms(target: str, given: tuple[str, ...], allowed: Collection[str]) -> None:
    """ScenarioError for a platform that a format has not."""
    for name in given:
        if name not in allowed:
            raise ScenarioError(
                f"{target}: platforms: '{name}' is not allowed; there are {', '.join(allowed)}"
            )


def write_c_library(subject: Subject, path: Path, options: LibraryOptions) -> None:
    """Write an archive of the C library's folder."""
    _check_platforms("c", options.platforms, FOLDERS[3])
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
