"""The one door from a scenario or a run to a file of another tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError, OptionError, OutputError, expect_path
from microvib.export.subject import Progress, Subject, subject_of
from microvib.export.targets import Target, target_of
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.scenario_file import parse_value
from microvib.io.writing import real_path, write_file
from microvib.model.part import Part
from microvib.model.sentences import validate_part


def export_as(
    source: Any,
    target: str,
    out: Path | str,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> Path:
    """Write a scenario or a run as a file of another tool.

    Parameters
    ----------
    source : Scenario, RunResult, Motion, str or path
        What is exported; as name a scenario of the catalog, a scenario file, or the folder of a run.
    target : str
        Name of the format, as ``microvib export --list`` has them: ``"state-space"``, ``"nastran"``,
        ``"uff"``, ``"mat"``, ``"csv"``, ``"source-sheet"``, ``"fmu2"``, ``"fmu3"``, ``"c"``, ``"wasm"``.
    out : str or path
        The file, with an ending of the format.
    overwrite : bool
        Replace a file that is there.
    progress : callable, optional
        Called as ``progress(done, total)`` where a scenario has to be run first.
    **options : Any
        Options of the format.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    OptionError
        For a format that is not known, or an option or an ending that it has not.
    OutputError
        Where the file is there, or cannot be written.
    MicrovibError
        Where the source cannot be exported so.
    """
    expect_path(out)
    found = target_of(target)
    path = check_file_name(found, Path(out), overwrite)
    chosen = options_of(found, options)
    subject = subject_of(source)
    check_subject(found, subject)
    if found.needs == "run":
        subject = subject.as_run(progress)
    write_subject(subject, found, path, chosen, overwrite=overwrite)
    return path


def check_file_name(
    target: Target, out: Path, overwrite: bool = False, files: FileAccess = WORKING_FOLDER
) -> Path:
    """The file to be written, before anything is computed; OptionError or OutputError where its name
    does not fit, it is there already, or its folder is not.
    """
    path = files.under("output").path(str(out))
    if path.suffix.lower() not in target.endings:
        raise OptionError(
            "output",
            f"{path} is not allowed; the name of a {target.name} file must end in"
            f" {' or '.join(target.endings)}",
        )
    there = real_path(path)
    if there.is_dir():
        raise OutputError(f"{path}: is a folder; a file is expected")
    if there.exists() and not overwrite:
        raise OutputError(
            f"{path}: already exists; nothing was written; choose another file, or allow it to be"
            " replaced",
            remedy="overwrite",
        )
    if not there.parent.is_dir():
        raise OutputError(f"{path}: cannot be written: there is no folder {path.parent}")
    return path


def check_subject(target: Target, subject: Subject) -> None:
    """MicrovibError where a scenario cannot be exported so, before it is run."""
    refusal = target.refuses(subject.scenario)
    if refusal:
        raise MicrovibError(refusal)


def typed_options(texts: Sequence[str]) -> dict[str, Any]:
    """Options that are typed as KEY=VALUE; OptionError where one is not, or stands twice."""
    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key:
            raise OptionError("option", "KEY=VALUE is expected, such as contents=[lines]", text)
        if key in found:
            raise OptionError("option", f"{key} is given twice; once is expected", text)
        found[key] = parse_value(value)
    return found


def options_of(target: Target, given: Mapping[str, Any]) -> Part:
    """Options of a target, checked; ScenarioError says which is wrong, and what is allowed."""
    return validate_part(target.options, dict(given), origin=target.name)


def write_subject(
    subject: Subject, target: Target, path: Path, options: Part, *, overwrite: bool = False
) -> None:
    """Write a subject with the options of its target, whole or not at all."""
    write_file(path, partial(_written, subject, target, options), overwrite=overwrite)


def _written(subject: Subject, target: Target, options: Part, path: Path) -> None:
    target.write(subject, path, options)
