"""Comparison of any two: scenario, run folder, recording, table of lines, or the paper's own tables."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from microvib.analysis.lines import lines
from microvib.errors import MicrovibError
from microvib.io.recordings import READERS, read_recording
from microvib.io.results import PAPER_LINES, read_table
from microvib.io.scenario_file import catalog_names, load_scenario
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.solve.simulate import Progress, simulate
from microvib.studies.evidence import is_line_table, line_table_rows, measured_lines
from microvib.testdata.preparation import Preparation

PAPER = ("paper-test", "paper-simulation")
"""Names for the test and the simulation columns of Tables 5 and 6."""


COLUMNS = (
    "line", "a_frequency_hz", "b_frequency_hz", "a_amplitude_n_m", "b_amplitude_n_m", "difference_n_m", "relative_error",
    "significance", "a_bin_frequency_hz", "b_bin_frequency_hz", "a_bin_amplitude_n_m", "b_bin_amplitude_n_m", "bin_relative_error",
    "a_uncertainty_n_m", "b_uncertainty_n_m", "verdict",
)  # fmt: skip
"""Columns of ``compare.csv``."""
COVERAGE = 2.0
"""Standard uncertainties of the difference within which two amplitudes agree; of equal lines one in twenty is beyond."""
AGREES, DIFFERS, UNJUDGED, ONLY_A, ONLY_B = "agrees", "differs", "not judged", "only A", "only B"
SAME = 1e-4
"""Relative difference of frequency up to which unexpected lines of aligned clocks are the same."""


@dataclass(frozen=True)
class Figures:
    """What one side says of one line; nan where it says nothing."""

    frequency: float = math.nan
    amplitude: float = math.nan
    uncertainty: float = math.nan
    bin_frequency: float = math.nan
    bin_amplitude: float = math.nan

    @property
    def known(self) -> bool:
        """Whether anything is said of the line."""
        return math.isfinite(self.amplitude) or math.isfinite(self.bin_amplitude)


@dataclass(frozen=True)
class Side:
    """One side of a comparison: its lines, and its samples where it has any."""

    name: str
    kind: str
    lines: dict[str, Figures]
    clock_ratio: float | None = None
    """Step clock over nominal."""
    torque: np.ndarray | None = None
    sample_rate: float = math.nan
    scenario: Scenario | None = None
    notes: tuple[str, ...] = ()
    """What reading and preparing a recording did."""


@dataclass(frozen=True)
class Row:
    """One line of both sides."""

    line: str
    a: Figures
    b: Figures

    @property
    def error(self) -> float:
        """Relative difference of the amplitudes, b over a, wherever the bins fall."""
        return self.b.amplitude / self.a.amplitude - 1.0

    @property
    def bin_error(self) -> float:
        """The same of the paper's nearest-bin amplitudes."""
        return self.b.bin_amplitude / self.a.bin_amplitude - 1.0

    @property
    def significance(self) -> float:
        """Difference of the amplitudes over its standard uncertainty; nan where that is not known."""
        spread = math.hypot(self.a.uncertainty, self.b.uncertainty)
        return abs(self.b.amplitude - self.a.amplitude) / spread if spread > 0.0 else math.nan

    @property
    def verdict(self) -> str:
        """Whether the amplitudes agree within their uncertainties; where one is not known they are not judged."""
        if self.a.known != self.b.known:
            return ONLY_A if self.a.known else ONLY_B
        if math.isnan(self.significance):
            return UNJUDGED
        return AGREES if self.significance <= COVERAGE else DIFFERS


def compare(
    a: str,
    b: str,
    *,
    scenario: str | None = None,
    channel: str = "Mz",
    preparation: Preparation | None = None,
    progress: Progress | None = None,
) -> tuple[Side, Side, list[Row]]:
    """Both sides and the lines that at least one of them has.

    Clocks are aligned: a scenario is simulated at the clock that the other side's recording shows. ``scenario`` says which lines to
    look for in recordings where neither side is a scenario, nor the paper; ``preparation`` is applied to recordings.
    """
    guide = (
        next((load_scenario(x) for x in (a, b) if _is_scenario(x)), None)
        or _folder_scenario(a, b)
        or (
            load_scenario(scenario or "state-1") if scenario or {a, b} & set(PAPER) else None
        )  # the paper's tables are of state 1
    )
    sides: dict[str, Side] = {}
    for source in sorted((a, b), key=_is_scenario):
        other = next((s.clock_ratio for s in sides.values() if s.kind == "recording"), None)
        sides[source] = _side(source, guide, channel, preparation, other, progress)
    if guide is None and {"recording"} < {side.kind for side in sides.values()}:
        raise MicrovibError(f"{a}, {b}: lines of a recording have no names without a drive; name it with --scenario")
    first, second = sides[a], _with_names_of(sides[a], sides[b])
    names = [*first.lines, *(name for name in second.lines if name not in first.lines)]
    return (
        first,
        second,
        [Row(name, first.lines.get(name, Figures()), second.lines.get(name, Figures())) for name in names],
    )


def _with_names_of(a: Side, b: Side) -> Side:
    """``b`` with its unexpected lines named as those of ``a`` at the same frequency, for they are numbered by size on each side."""
    known = {name: x.frequency for name, x in a.lines.items() if name.startswith("other_")}
    lines: dict[str, Figures] = {}
    for name, x in b.lines.items():
        same = next((k for k, f in known.items() if abs(f - x.frequency) < SAME * x.frequency), None)
        lines[(same or f"{name}_of_b") if name.startswith("other_") else name] = x
    return replace(b, lines=lines)


def _is_scenario(source: str) -> bool:
    return source in catalog_names() or source.endswith((".yaml", ".yml"))


def _folder_scenario(*sources: str) -> Scenario | None:
    for source in sources:
        path = Path(source) / "scenario.yaml"
        if path.is_file():
            return load_scenario(path)
    return None


def _side(
    source: str,
    guide: Scenario | None,
    channel: str,
    preparation: Preparation | None,
    clock: float | None,
    progress: Progress | None,
) -> Side:
    path = Path(source)
    if source in PAPER:
        return _paper(source)
    if _is_scenario(source):
        return _simulated(source, load_scenario(source), clock, progress)
    if path.is_dir():
        return _folder(path)
    if path.suffix.lower() == ".csv" and is_line_table(path):
        return Side(source, "table", _read_lines(path))
    if path.suffix.lower() in READERS:
        prepared, table = measured_lines(path, guide, channel, preparation)
        recording = prepared.recording
        ratio = None if table.clock_ratio is None or guide is None else table.clock_ratio * guide.tracking.clock_ratio
        x, rate = recording[channel], recording.sample_rate
        return Side(source, "recording", _figures(table), ratio, x, rate, notes=recording.notes)
    raise MicrovibError(
        f"{source}: cannot be compared; expected a scenario, a run folder, a recording ({', '.join(READERS)}),"
        f" a table of lines (.csv) or one of {', '.join(PAPER)}"
    )


def _simulated(name: str, scenario: Scenario, clock: float | None, progress: Progress | None) -> Side:
    if clock is not None:
        scenario = scenario.with_({"tracking.clock_ratio": clock})
    motion = simulate(scenario, channels=("T_d",), progress=progress)
    title = f"{name} at clock {clock:.6f}" if clock is not None else name
    ratio = scenario.tracking.clock_ratio
    return Side(title, "simulation", _figures(lines(motion)), ratio, motion["T_d"], motion.sample_rate, scenario)


def _folder(path: Path) -> Side:
    if not (path / "lines.csv").is_file():
        raise MicrovibError(f"{path}: is not a run folder; it has no lines.csv")
    torque, rate = None, math.nan
    if (path / "motion.nc").is_file():
        recording = read_recording(path / "motion.nc")
        torque, rate = recording["Mz"], recording.sample_rate
    scenario = _folder_scenario(str(path))
    ratio = None if scenario is None else scenario.tracking.clock_ratio
    return Side(str(path), "run", _read_lines(path / "lines.csv"), ratio, torque, rate, scenario)


def _figures(table: LineTable) -> dict[str, Figures]:
    return {
        x.line: Figures(
            x.frequency_hz, x.amplitude_n_m, x.amplitude_uncertainty_n_m, x.bin_frequency_hz, x.bin_amplitude_n_m
        )
        for x in table
    }


def _read_lines(path: Path) -> dict[str, Figures]:
    columns = ("frequency_hz", "amplitude_n_m", "amplitude_uncertainty_n_m", "bin_frequency_hz", "bin_amplitude_n_m")
    return {name: Figures(*map(figure, columns)) for name, figure in line_table_rows(path)}


def _paper(source: str) -> Side:
    column = "test" if source == "paper-test" else "simulation"
    hz = {row["line"]: float(row[f"{column}_hz"]) for row in read_table("table5_line_frequencies")}
    found = {
        PAPER_LINES[row["line"]]: Figures(bin_frequency=hz[row["line"]], bin_amplitude=float(row[f"{column}_n_m"]))
        for row in read_table("table6_line_amplitudes")
    }
    return Side(source, "paper", found)


def rows_csv(rows: list[Row]) -> str:
    """CSV text of a comparison."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        a, b = row.a, row.b
        values = (
            a.frequency, b.frequency, a.amplitude, b.amplitude, b.amplitude - a.amplitude, row.error, row.significance,
            a.bin_frequency, b.bin_frequency, a.bin_amplitude, b.bin_amplitude, row.bin_error, a.uncertainty, b.uncertainty,
        )  # fmt: skip
        writer.writerow([row.line, *("" if math.isnan(v) else f"{v:.9g}" for v in values), row.verdict])
    return stream.getvalue()
