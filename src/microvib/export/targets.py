"""Formats that scenarios and runs can be exported to: a declaration of each, in one table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from microvib.errors import OptionError, did_you_mean, missing_library
from microvib.export.data import CsvOptions, DataOptions, write_csv, write_mat, write_uff
from microvib.export.nastran import NastranOptions, write_nastran
from microvib.export.native.files import (
    Fmu2Options,
    Fmu3Options,
    LibraryOptions,
    not_exportable,
    write_c_library,
    write_fmu2,
    write_fmu3,
    write_wasm,
)
from microvib.export.source import no_source
from microvib.export.source_sheet import SourceSheetOptions, write_source_sheet
from microvib.export.state_space import no_state_space
from microvib.export.state_space_files import write_state_space
from microvib.export.subject import Subject
from microvib.model.part import Part
from microvib.model.scenario import Scenario

Needs = Literal["scenario", "run"]


def _nothing(scenario: Scenario) -> str:
    """Refuse no scenario."""
    return ""


class NoOptions(Part):
    """Options of a target that has none."""


@dataclass(frozen=True)
class Option:
    """An option of a target, as its declaration has it."""

    key: str
    default: str
    """As it is typed behind ``KEY=``; empty for none."""
    meaning: str
    kind: Literal["choice", "choices", "number", "text"]
    """One of the choices, a list of them, a whole number, or any text."""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """A format of another tool, and the function that writes it."""

    name: str
    gives: str
    """Contents of the file, in words."""
    needs: Needs
    """Whether a scenario is enough, or its run is needed; a scenario that was not run is run then."""
    endings: tuple[str, ...]
    """Endings of its files; the first is taken where no file is named."""
    write: Callable[[Subject, Path, Any], None]
    """Writes a subject, with options of the kind below, to a file that does not exist yet."""
    options: type[Part] = NoOptions
    library: str = ""
    """Module of an optional package that it needs."""
    refuses: Callable[[Scenario], str] = _nothing
    """Sentence on why a scenario cannot be exported so; empty where it can."""

    @property
    def missing(self) -> str:
        """Sentence on the package that is missing here; empty where nothing is."""
        if not self.library or find_spec(self.library) is not None:
            return ""
        return missing_library(ModuleNotFoundError(name=self.library))

    @property
    def offered(self) -> tuple[Option, ...]:
        """Its options."""
        schema = self.options.model_json_schema().get("properties", {})
        return tuple(
            _option(key, self.options.model_fields[key].default, told)
            for key, told in schema.items()
        )

    def option_lines(self) -> list[str]:
        """Its options: key, default and meaning, a line each."""
        return [f"{one.key}={one.default}: {one.meaning}" for one in self.offered]


def _option(key: str, default: Any, told: dict[str, Any]) -> Option:
    """An option by its default and what the schema tells of it."""
    alternatives = [one for one in told.get("anyOf", [told]) if one.get("type") != "null"]
    (own,) = alternatives
    listed = own.get("items", own).get("enum", ())
    kind: Literal["choice", "choices", "number", "text"] = "text"
    if own.get("type") == "integer":
        kind = "number"
    elif own.get("type") == "array":
        kind = "choices"
    elif listed:
        kind = "choice"
    return Option(key, _typed(default), told.get("description", ""), kind, tuple(listed))


def _typed(value: Any) -> str:
    """A value as it is typed."""
    if value is None:
        return ""
    if isinstance(value, tuple):
        return "[" + ", ".join(map(str, value)) + "]"
    return str(value)


TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        Target(
            "state-space",
            "matrices A, B, C, D of the linearised drive, array and spacecraft, with named channels",
            "scenario",
            (".mat", ".npz"),
            write_state_space,
            refuses=no_state_space,
        ),
        Target(
            "nastran",
            "bulk data: loads at the interface by frequency, time or density, and the array as superelement",
            "run",
            (".bdf", ".dat"),
            write_nastran,
            NastranOptions,
            library="pyyeti",
        ),
        Target(
            "uff",
            "universal file, datasets 58: time histories, lines, densities, frequency responses",
            "run",
            (".uff",),
            write_uff,
            DataOptions,
        ),
        Target(
            "mat",
            "MATLAB file, version 5: time histories, lines, densities, frequency responses",
            "run",
            (".mat",),
            write_mat,
            DataOptions,
        ),
        Target(
            "csv",
            "one table: time histories, lines, densities or frequency responses",
            "run",
            (".csv",),
            write_csv,
            CsvOptions,
        ),
        Target(
            "source-sheet",
            "data sheet of the source: blocked loads at the lines with uncertainty, and apparent mass",
            "scenario",
            (".h5",),
            write_source_sheet,
            SourceSheetOptions,
            refuses=no_source,
        ),
        Target(
            "fmu2",
            "FMU for co-simulation, FMI 2.0, without Python where it runs",
            "scenario",
            (".fmu",),
            write_fmu2,
            Fmu2Options,
        ),
        Target(
            "fmu3",
            "FMU for co-simulation, FMI 3.0, without Python where it runs",
            "scenario",
            (".fmu",),
            write_fmu3,
            Fmu3Options,
        ),
        Target(
            "c",
            "library that C calls, with its header and examples, as an archive",
            "scenario",
            (".zip",),
            write_c_library,
            LibraryOptions,
            refuses=not_exportable,
        ),
        Target(
            "wasm",
            "WebAssembly module without imports and its loader in JavaScript, as an archive",
            "scenario",
            (".zip",),
            write_wasm,
            library="ziglang",
            refuses=not_exportable,
        ),
    )
}
"""All targets by name."""


def target_of_file(name: str) -> tuple[Target, str] | None:
    """Target and ending of a file called by both, such as ``nastran.bdf``; None where there is none."""
    stem, dot, last = name.partition(".")
    ending = dot + last
    if stem not in TARGETS or ending not in TARGETS[stem].endings:
        return None
    return TARGETS[stem], ending


def target_of(name: Any) -> Target:
    """The target of a name; OptionError where there is none, or its package is missing."""
    if name not in TARGETS:
        meant = did_you_mean(str(name), TARGETS)
        raise OptionError("as", f"is not known; {meant}allowed are {', '.join(TARGETS)}", str(name))
    found = TARGETS[name]
    if found.missing:
        raise OptionError("as", found.missing, found.name)
    return found
