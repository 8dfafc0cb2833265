"""The one door from a name to what it stands for: a scenario, a run's folder, a recording, a table
of lines, the paper's lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from microvib.errors import MicrovibError, expect
from microvib.io.formats import READERS
from microvib.io.named import catalog_names
from microvib.io.recordings import Prepared, read_prepared, read_recording
from microvib.io.scenario_file import load_scenario
from microvib.io.tables import PaperLines, is_line_table, paper_lines, read_lines
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording


@dataclass(frozen=True)
class RunFolder:
    """What a run's folder holds, None where that is not there; also of another version, or put
    together by hand.
    """

    path: Path
    scenario: Scenario | None
    lines: LineTable | None
    motion: Recording | None
    """Torque about the drive axis, as channel Mz."""


Source = Scenario | RunFolder | Prepared | LineTable | PaperLines


def open_source(name: str, preparation: Preparation | None = None) -> Source:
    """The object that ``name`` stands for; a recording is prepared as ``preparation`` says.

    A name of the catalog or a YAML file is a scenario; a folder is that of a run; a file is a
    recording by its ending, a CSV file whose first column is ``line`` a table of lines;
    ``paper-test`` (or ``paper``) and ``paper-simulation`` are the paper's. MicrovibError where it
    is none of them, or cannot be read.
    """
    expect(name, str, "the name of a scenario, a run, a recording or a table")
    path = Path(name)
    if name in ("paper", "paper-test"):
        return paper_lines("test")
    if name == "paper-simulation":
        return paper_lines("simulation")
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
        f" ({', '.join(READERS)}), a table of lines (.csv), paper-test or paper-simulation"
    )


def _folder(path: Path) -> RunFolder:
    scenario, lines, motion = (path / name for name in ("scenario.yaml", "lines.csv", "motion.nc"))
    if not lines.is_file() and not motion.is_file():
        raise MicrovibError(
            f"{path}: is not the folder of a run; it has neither lines.csv nor motion.nc"
        )
    return RunFolder(
        path,
        load_scenario(scenario) if scenario.is_file() else None,
        read_lines(lines) if lines.is_file() else None,
        read_recording(motion) if motion.is_file() else None,
    )
