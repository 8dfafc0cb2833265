"""Evidence: measured lines with their uncertainties, from recordings or tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.lines import lines_of_recording
from microvib.errors import MicrovibError, OptionError
from microvib.io.formats import READERS
from microvib.io.recordings import Prepared
from microvib.io.sources import Source
from microvib.io.tables import PaperLines
from microvib.model.expected import expected_lines
from microvib.model.scenario import Scenario
from microvib.signals.line_table import DETECTION, LineTable
from microvib.testdata.recording import Recording
from microvib.units import Band, Si, band

PAPER_CLOCK = 0.994
"""Step clock over nominal that fits the peaks of Table 5 (53, 106, 159.0625 Hz)."""


@dataclass(frozen=True)
class Observation:
    """One measured figure of one line.

    ``form`` is amplitude or nearest_bin [N m], frequency [Hz], decay [1/s], or phase [rad] (of a driving line against the
    first, k phi_1 - phi_k, which no choice of time zero changes).
    """

    line: str
    form: str
    value: float
    uncertainty: float
    bin_hz: float = math.nan
    """Bin of a nearest_bin figure: the test's bin, whichever bin is nearest to the line of a simulation."""


@dataclass(frozen=True)
class Evidence:
    """Observations of one test, and the record in which they were made."""

    name: str
    observations: tuple[Observation, ...]
    clock_ratio: float | None
    """Step clock found over that of the scenario."""
    duration: float
    sample_rate: float
    notes: tuple[str, ...] = ()
    """What reading and preparing a recording did."""


def chosen(
    evidence: Sequence[Evidence],
    scenario: Scenario,
    bands: Sequence[Band] = (),
    without: Sequence[str] = (),
) -> list[Evidence]:
    """The evidence of lines in the ``bands`` (without any: everywhere), less those named in ``without``.

    Phases are relative to the first driving line and go with it. MicrovibError for a name that no evidence has, and where
    nothing is left.
    """
    seen = dict.fromkeys(o.line for one in evidence for o in one.observations)
    for name in without:
        if name not in seen:
            raise OptionError("without", f"no evidence has this line; there are {', '.join(seen)}", name)
    ends = [band(given) for given in bands]
    at = {line.name: line.frequency for line in expected_lines(scenario, Si(math.inf))}

    def wanted(line: str) -> bool:
        return line not in without and (not ends or any(low <= at.get(line, -1.0) <= high for low, high in ends))

    kept = [
        replace(
            one,
            observations=tuple(
                o for o in one.observations if wanted(o.line) and (o.form != "phase" or wanted("drive_1"))
            ),
        )
        for one in evidence
    ]
    if not any(one.observations for one in kept):
        raise OptionError("without" if without else "band", "leaves no line of the evidence")
    return kept


def evidence_of(source: Source | Recording, scenario: Scenario, channel: str = "Mz", name: str = "") -> Evidence:
    """Evidence of a recording (its drive-axis torque in ``channel``), a table of lines that is called ``name``, or the paper."""
    match source:
        case PaperLines("test"):
            return paper_evidence(scenario)
        case LineTable():
            return _of_table(source, scenario, name)
        case Recording():
            return evidence_of(Prepared(source), scenario, channel, name)
        case Prepared(recording, background):
            table = lines_of_recording(recording, channel, scenario, background)
            found = tuple(
                o for o in observations(table) if not _near_mains(table[o.line].frequency_hz, recording.duration)
            )
            return Evidence(
                recording.title, found, table.clock_ratio, recording.duration, recording.sample_rate, recording.notes
            )
        case _:
            raise MicrovibError(
                f"{name or 'the source'}: is not evidence; expected a recording ({', '.join(READERS)}), a table of lines (.csv)"
                " or 'paper'"
            )


def observations(table: LineTable) -> tuple[Observation, ...]:
    """Observations from the lines of a table that stand out: amplitudes, phases of driving lines, frequency and decay of modes."""
    found = []
    first = next((line for line in table if line.line == "drive_1" and line.status == "ok"), None)
    for line in table:
        if line.kind == "other" or line.status not in ("ok", "decaying", "growing"):
            continue
        if line.amplitude_n_m < 2 * DETECTION * line.floor_n_m:
            continue
        found.append(Observation(line.line, "amplitude", line.amplitude_n_m, line.amplitude_uncertainty_n_m))
        if line.kind == "array mode":
            found.append(Observation(line.line, "frequency", line.frequency_hz, line.frequency_uncertainty_hz))
            found.append(Observation(line.line, "decay", line.decay_per_s, line.decay_uncertainty_per_s))
        elif line.kind == "drive" and first is not None and line.line != "drive_1":
            order = int(line.line.split("_")[1])
            spread = math.hypot(order * first.phase_uncertainty_rad, line.phase_uncertainty_rad)
            found.append(Observation(line.line, "phase", order * first.phase_rad - line.phase_rad, spread))
    return tuple(found)


@dataclass(frozen=True)
class Simulated:
    """Lines of a simulated test, and its rectangular-window amplitudes, (k,) [N m], a bin each ``resolution`` [Hz]."""

    table: LineTable
    bins: np.ndarray
    resolution: float

    def bin_amplitude(self, frequency: float) -> float:
        """Amplitude of the bin nearest to ``frequency`` [Hz]."""
        return float(self.bins[round(frequency / self.resolution)])


def predicted(lines: Simulated, wanted: Observation) -> float:
    """The simulated figure for one observation; nan if the lines do not have it."""
    by_name = {line.line: line for line in lines.table}
    line = by_name.get(wanted.line)
    if line is None:
        return math.nan
    if wanted.form == "phase":
        order = int(wanted.line.split("_")[1])
        return float(order * by_name["drive_1"].phase_rad - line.phase_rad)
    figures: dict[str, float] = {
        "amplitude": line.amplitude_n_m,
        "nearest_bin": line.bin_amplitude_n_m if math.isnan(wanted.bin_hz) else lines.bin_amplitude(wanted.bin_hz),
        "frequency": line.frequency_hz,
        "decay": line.decay_per_s,
    }
    return figures[wanted.form]


def _near_mains(frequency: float, duration: float) -> bool:
    """Whether pick-up of 50 or 60 Hz mains, or of one of its first harmonics, may stand in a line."""
    return any(abs(frequency - m * mains) * duration < 5.0 for mains in (50.0, 60.0) for m in range(1, 7))


def paper_evidence(scenario: Scenario) -> Evidence:
    """Test columns of Tables 5 and 6: four nearest-bin amplitudes and the clock that fits their frequencies."""
    from microvib.io.tables import PAPER_LINES, read_table

    bins = {row["line"]: float(row["test_hz"]) for row in read_table("table5_line_frequencies")}
    found = []
    for row in read_table("table6_line_amplitudes"):
        digits = row["test_n_m"]
        value = float(digits)
        rounding = 0.5 * 10.0 ** -len(digits.split(".")[1]) / math.sqrt(3.0)
        found.append(Observation(PAPER_LINES[row["line"]], "nearest_bin", value, rounding, bins[row["line"]]))
    # The natural line's bin, 1.1875 Hz: its frequency lies within half a bin of that, which is put at three sigma.
    found.append(Observation("array_mode_1", "frequency", 1.1875, 0.03125 / 3.0))
    return Evidence(
        "Appl. Sci. 2021, 11, 9076, Table 6 (test)",
        tuple(found),
        PAPER_CLOCK / scenario.tracking.clock_ratio,
        16.0,
        4096.0,
    )


def _of_table(table: LineTable, scenario: Scenario, name: str) -> Evidence:
    """Amplitudes, or else those of nearest bins; without uncertainties one per cent is taken."""
    found = []
    ratio = None
    for line in table:
        form, value = "amplitude", line.amplitude_n_m
        if math.isnan(value):
            form, value = "nearest_bin", line.bin_amplitude_n_m
        spread = line.amplitude_uncertainty_n_m
        if value > 0.0:
            found.append(Observation(line.line, form, value, spread if spread > 0.0 else 0.01 * value))
        if line.line == "drive_1" and scenario.driving_frequency and line.frequency_hz > 0.0:
            ratio = line.frequency_hz / scenario.driving_frequency
    if not found:
        raise MicrovibError(f"{name}: has no line with amplitude_n_m or bin_amplitude_n_m")
    return Evidence(name, tuple(found), ratio, scenario.record.duration, scenario.record.sample_rate)
