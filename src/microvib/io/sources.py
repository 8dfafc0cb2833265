"""The one door from a name to what it stands for: a scenario, a run's folder, a recording, a table
of lines, the reference lines of a scenario.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from microvib.errors import MicrovibError, expect
from microvib.io.formats import READERS
from microvib.io.named import catalog_names
from microvib.io.recordings import Prepared, read_prepared, read_recording
from microvib.io.runs import check_run_folder
from microvib.io.scenario_file import load_scenario
from microvib.io.tables import is_line_table, read_lines, reference_table
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording


@dataclass(frozen=True)
class RunFolder:
    """Contents of a run's folder, None where missing; also of another version, or put
    together by hand.
    """

    path: Path
    scenario: Scenario | None
    lines: LineTable | None
    motion: Recording | None
    """Torque about the drive axis, as channel Mz."""


REFERENCE_COLUMNS = ("measured", "model")


@dataclass(frozen=True)
class ReferenceLines:
    """Reference lines of a scenario: as measured, or by the publication's own model."""

    name: str
    scenario: Scenario
    column: str
    """One of ``REFERENCE_COLUMNS``."""

    @property
    def table(self) -> LineTable:
        """The lines as a table, of which frequency and amplitude are known."""
        assert self.scenario.reference is not None
        return reference_table(self.scenario.reference, self.column)


Source = Scenario | RunFolder | Prepared | LineTable | ReferenceLines
FORMER_NAMES = {
    "paper": "state-1:measured",
    "paper-test": "state-1:measured",
    "paper-simulation": "state-1:model",
}
"""Names of the release before, and what they stand for."""


def open_source(name: str, preparation: Preparation | None = None) -> Source:
    """Open what a name stands for.

    Parameters
    ----------
    name : str
        A name of the catalog or a YAML file is a scenario; a folder is that of a run; a file is a
        recording by its ending, a CSV file whose first column is ``line`` a table of lines;
        ``paper-test`` (or ``paper``) and ``paper-simulation`` are former names of those of state-1.
    preparation : Preparation, optional
        What is done to a recording before it is used.

    Returns
    -------
    Scenario, RunFolder, Prepared, LineTable or ReferenceLines
        The object, by what the name is of.

    Raises
    ------
    MicrovibError
        Where the name is of none of them, or what it is of cannot be read.
    """
    expect(name, str, "the name of a scenario, a run, a recording or a table")
    path = Path(name)
    scenario, _, column = FORMER_NAMES.get(name, name).rpartition(":")
    if scenario and column in REFERENCE_COLUMNS and not path.exists():
        return _reference(name, load_scenario(scenario), column)
    if name in catalog_names() or path.suffix.lower() in (".yaml", ".yml"):
        return load_scenario(name)
    if path.is_dir():
        return _folder(path)
    if path.suffix.lower() == ".csv" and is_line_table(path):
        return read_lines(path)
    if path.suffix.lower() in READERS:
        return read_prepared(path, preparation)
    raise MicrovibError(
        f"{name}: is not known; expected a scenario (of the catalog, or .yaml), the folder of a"
        " run, a recording"
        f" ({', '.join(READERS)}), a table of lines (.csv), or reference lines of a scenario"
        " (SCENARIO:measured, SCENARIO:model)"
    )


def _reference(name: str, scenario: Scenario, column: str) -> ReferenceLines:
    if scenario.reference is None:
        raise MicrovibError(
            f"{name}: the scenario has no reference lines; add measured lines to its file, under the"
            " key reference"
        )
    if column == "model" and not any(x.model_amplitude for x in scenario.reference.lines):
        raise MicrovibError(
            f"{name}: no model's amplitudes are among the scenario's reference lines"
        )
    return ReferenceLines(name, scenario, column)


def _folder(path: Path) -> RunFolder:
    scenario, lines, motion = (path / name for name in ("scenario.yaml", "lines.csv", "motion.nc"))
    if not lines.is_file() and not motion.is_file():
        raise MicrovibError(
            f"{path}: is not the folder of a run; it has neither lines.csv nor motion.nc"
        )
    check_run_folder(path)
    return RunFolder(
        path,
        load_scenario(scenario) if scenario.is_file() else None,
        read_lines(lines) if lines.is_file() else None,
        read_recording(motion) if motion.is_file() else None,
    )
