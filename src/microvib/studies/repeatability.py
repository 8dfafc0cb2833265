"""Repeated tests: mean and spread of each line, what of it is scatter from run to run and from unit to unit,
and outliers.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Annotated

import numpy as np

from microvib.analysis.background import background_notes
from microvib.analysis.lines import (
    CLOCK_TOLERANCE,
    find_lines,
    lines_of_recording,
    recording_warnings,
)
from microvib.errors import MicrovibError
from microvib.io.recordings import Prepared
from microvib.model.line_names import is_unlisted
from microvib.model.record import PASSBAND
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.results import COUNT, FREQUENCY, SHARE, TORQUE, TORQUE_UNCERTAINTY, Column, Measure
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import NOT_THE_DRIVES, Line, LineTable
from microvib.signals.scatter import (
    FEWEST_FOR_OUTLIERS,
    OUTLIER_RATIO,
    Scatter,
    outliers,
    random_effects,
)
from microvib.signals.tones import HannSpectrum

_SAME_FREQUENCY = 1e-4
"""Relative difference of frequency up to which lines without names are the same."""
OTHER_FACTOR, OTHER_UNIT_FACTOR = 2.0, 10.0
"""Factors between the amplitudes of a run and those of the others of its unit, or of other units where it is
the only one of its own, from which it is questioned."""
_MOST_NAMED = 6
_OF_A_MEDIAN = math.sqrt(0.5 * math.pi)
"""Standard uncertainty of a median over that of a mean."""
_ABSENT = Scatter(math.nan, math.nan, math.nan)
_BOUND = Measure("%", 0.01, ".3g")


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """One test of a unit."""

    name: str
    source: Prepared
    unit: str = ""
    """Unit under test; runs of one are repetitions."""


@dataclass(frozen=True)
class LineScatter:
    """A line over all runs; amplitudes 0-to-peak, scatters as parts of the mean."""

    channel: Annotated[str, Column("channel")]
    line: Annotated[str, Column("line", "line")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    runs: Annotated[int, Column("runs", "runs", COUNT)]
    """How many show it."""
    mean: Annotated[float, Column("mean_n_m", "mean", TORQUE)]
    uncertainty: Annotated[float, Column("uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    """Standard uncertainty of the mean: of estimates, of scatter, and of the table, which is common to all runs."""
    median: Annotated[float, Column("median_n_m", measure=TORQUE)]
    estimate: Annotated[float, Column("estimate", "estimate", SHARE)]
    """Part that one estimate is unsure, root mean square, without what is common to all runs."""
    run: Annotated[float, Column("run_scatter", "run to run", SHARE)]
    run_low: Annotated[float, Column("run_scatter_low", measure=SHARE)]
    run_high: Annotated[float, Column("run_scatter_high", "at most", _BOUND, absent="?")]
    unit: Annotated[float, Column("unit_scatter", "unit to unit", SHARE)]
    unit_low: Annotated[float, Column("unit_scatter_low", measure=SHARE)]
    unit_high: Annotated[float, Column("unit_scatter_high", "at most", _BOUND)]
    outliers: Annotated[str, Column("outliers", "outliers")]


@dataclass(frozen=True)
class RunDeviation:
    """One line of one run against the median of all runs."""

    channel: Annotated[str, Column("channel")]
    line: Annotated[str, Column("line", "line")]
    run: Annotated[str, Column("run", "run")]
    unit: Annotated[str, Column("unit", "unit")]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    uncertainty: Annotated[float, Column("uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    part: Annotated[float, Column("over_median", "over median", SHARE)]
    """Amplitude over the median, less one."""
    over_scale: Annotated[float, Column("over_scale", "over scale", Measure(form=".1f"))]
    outlier: Annotated[bool, Column("outlier")]
    status: Annotated[str, Column("status", "status")]


@dataclass(frozen=True)
class RunsApart:
    """Two runs of one unit whose amplitudes as a whole differ by ``OTHER_FACTOR`` or more."""

    large: str
    small: str
    factor: float
    """Median of the lines' ratios."""


@dataclass(frozen=True, eq=False)
class Repeatability:
    """Lines of several runs, and how they scatter."""

    runs: tuple[RecordedRun, ...]
    channels: tuple[str, ...]
    units_of: dict[str, str]
    """Unit of measure of each channel."""
    lines: tuple[LineScatter, ...]
    deviations: tuple[RunDeviation, ...]
    outlying_runs: dict[str, float]
    """Runs of which half of the lines or more are outliers, and the median of amplitude over their unit's, less one."""
    absent: dict[str, tuple[str, ...]]
    """Runs with less than 1/``OTHER_FACTOR`` of half or more of the lines that the others show, and those lines."""
    not_judged: tuple[str, ...]
    """Lines of runs that were left out, and why, a sentence without a stop each."""
    notes: tuple[str, ...]

    @property
    def groups(self) -> tuple[str, ...]:
        """Units under test."""
        return tuple(dict.fromkeys(run.unit for run in self.runs))

    @property
    def run_warnings(self) -> tuple[str, ...]:
        """Sentences without a stop on runs that are not of the same drive, motion, gain or channel as the others:
        lines are absent, or all of them are off by a factor of ``OTHER_FACTOR``; and on units whose other runs
        are as far apart, of which it is not known which is right.
        """
        told = []
        for name, lines in self.absent.items():
            names = ", ".join(lines[:_MOST_NAMED]) + (" ..." if len(lines) > _MOST_NAMED else "")
            told.append(
                f"{name} has far less of the lines {names} than the others: was the drive running, and are channel,"
                " unit of measure and gain the same?"
            )
        off = {
            name: 1.0 + part
            for name, part in self.outlying_runs.items()
            if name not in self.absent and not 1.0 / OTHER_FACTOR < 1.0 + part < OTHER_FACTOR
        }
        for name, factor in off.items():
            told.append(
                f"{name} has {factor:.3g} times the amplitudes of the other runs of its unit: are"
                " unit of measure and gain the same?"
            )
        for apart in _runs_apart([x for x in self.deviations if x.run not in {*self.absent, *off}]):
            told.append(
                f"{apart.large} has {apart.factor:.3g} times the amplitudes of {apart.small}, of the same unit: do"
                " unit of measure, gain and mounting agree, and does the unit repeat?"
            )
        return tuple(told)


def repeatability(
    runs: Sequence[RecordedRun],
    *,
    scenario: GivenScenario | None = None,
    channels: Sequence[str] = ("Mz",),
) -> Repeatability:
    """Find mean and spread of each line of several tests, scatter from run to run and from unit to unit, and
    outliers.

    Parameters
    ----------
    runs : sequence of RecordedRun
        Tests; runs with the same ``unit`` are repetitions of one unit's.
    scenario : Scenario, str or path, optional
        Names the lines of the torque about the drive axis; those of other channels, and all without it,
        are matched by frequency.
    channels : sequence of str
        Channels that are looked at.

    Returns
    -------
    Repeatability
        A row for each line that two runs or more show.

    Raises
    ------
    MicrovibError
        With fewer than two runs, where two have one name, or a channel cannot be used.
    """
    if len(runs) < 2:
        raise MicrovibError(f"{len(runs)} recording was given; repeatability needs two or more")
    names = [run.name for run in runs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise MicrovibError(f"{twice}: is given twice; a run counts once")
    guide = None if scenario is None else as_scenario(scenario)
    rows: list[LineScatter] = []
    deviations: list[RunDeviation] = []
    left_out: list[str] = []
    notes: list[str] = []
    units: dict[str, str] = {}
    lacking: dict[str, tuple[str, ...]] = {}
    for channel in channels:
        tables = [_lines(run, channel, guide, notes) for run in runs]
        kinds = {table.unit for table in tables}
        if len(kinds) > 1:
            raise MicrovibError(
                f"channel {channel}: is in {' and '.join(sorted(kinds))} in different runs"
            )
        units[channel] = kinds.pop()
        found = _Matched.of(runs, channel, tables)
        left_out += found.left_out
        for name, lines in found.absent():
            lacking[name] = (*lacking.get(name, ()), *lines)
        more, each = found.rows()
        rows += more
        deviations += each
    return Repeatability(
        tuple(runs),
        tuple(channels),
        units,
        tuple(rows),
        tuple(deviations),
        _outlying_runs(deviations),
        lacking,
        tuple(left_out),
        tuple(notes),
    )


def _lines(run: RecordedRun, channel: str, guide: Scenario | None, notes: list[str]) -> LineTable:
    recording, background = run.source.recording, run.source.background
    of_drive = guide is not None and channel == f"M{guide.array.drive_axis}"
    if of_drive or recording.units.get(channel) == "N*m":
        table = lines_of_recording(recording, channel, guide if of_drive else None, background)
    else:
        table = find_lines(recording, channel)
    own = [*background_notes(recording, background, channel, table)]
    own += recording_warnings(recording, channel, guide if of_drive else None, table)
    notes += [f"{run.name}, {channel}: {note}" for note in own]
    return table


@dataclass(frozen=True, eq=False)
class _Matched:
    """Lines of a channel in all runs."""

    runs: Sequence[RecordedRun]
    channel: str
    lines: dict[str, list[Line | None]]
    left_out: list[str]

    @classmethod
    def of(cls, runs: Sequence[RecordedRun], channel: str, tables: Sequence[LineTable]) -> _Matched:
        lines: dict[str, list[Line | None]] = {}
        for k, table in enumerate(tables):
            for line in table:
                if not math.isfinite(line.amplitude) or not (
                    line.seen or line.status in NOT_THE_DRIVES
                ):
                    continue
                name = _name(line, lines)
                lines.setdefault(name, [None] * len(runs))[k] = line
        left_out = []
        for name, each in lines.items():
            for k, one in enumerate(each):
                why = "" if one is None else _not_compared(one)
                if why:
                    left_out.append(f"{channel}, {name} of {runs[k].name}: {why}")
                    each[k] = None
        return cls(runs, channel, lines, left_out)

    def absent(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Runs that have too little of half or more of the lines that the others show, and those lines."""
        for k, run in enumerate(self.runs):
            others = [j for j in self._alike(k) if j != k]
            factor = OTHER_FACTOR if run.unit == self.runs[others[0]].unit else OTHER_UNIT_FACTOR
            expected = {
                name: one.amplitude / factor
                for name, each in self.lines.items()
                if (one := _common(each, others)) is not None and self._may_show(run, one.frequency)
            }
            lacking = tuple(
                name for name, least in expected.items() if self._amplitude(name, k) < least
            )
            if lacking and 2 * len(lacking) >= len(expected):
                yield run.name, lacking

    def _amplitude(self, name: str, k: int) -> float:
        """Amplitude of a line in run ``k``, or of the highest peak where it may be."""
        there = self.lines[name][k]
        if there is not None:
            return there.amplitude
        recording = self.runs[k].source.recording
        x = recording[self.channel]
        spectrum = HannSpectrum.of(x - x.mean(), recording.sample_rate)
        f = next(one.frequency for one in self.lines[name] if one is not None)
        return spectrum.peak((1.0 - CLOCK_TOLERANCE) * f, (1.0 + CLOCK_TOLERANCE) * f)[1]

    def _alike(self, k: int) -> list[int]:
        """Runs of the unit of run ``k``, or all where it is the only one."""
        same = [j for j, run in enumerate(self.runs) if run.unit == self.runs[k].unit]
        return same if len(same) > 1 else list(range(len(self.runs)))

    def _may_show(self, run: RecordedRun, frequency: float) -> bool:
        """Whether a run can show a line at a ``frequency`` [Hz]."""
        recording = run.source.recording
        lowest, highest = SEPARATION / recording.duration, PASSBAND * recording.sample_rate
        hidden = any(x.low <= frequency <= x.high for x in recording.unusable(self.channel))
        return lowest < frequency < highest and not hidden

    def _by_table(self, line: Line | None, run: RecordedRun) -> float:
        """The part of a line's uncertainty that is its table's, and so common to runs on one table."""
        table = run.source.recording.table
        if line is None or table is None:
            return 0.0
        return table.amplitude_uncertainty(self.channel, line.frequency, line.amplitude)

    def _own(self, line: Line | None, run: RecordedRun) -> float:
        """The rest of it, by which runs differ."""
        if line is None:
            return math.nan
        whole = _known(line.amplitude_uncertainty)
        return math.sqrt(max(whole**2 - self._by_table(line, run) ** 2, 0.0))

    def rows(self) -> tuple[list[LineScatter], list[RunDeviation]]:
        """A row for each line that two runs or more show, the largest first, and for each of their lines."""
        shown = {
            name: each for name, each in self.lines.items() if sum(x is not None for x in each) > 1
        }
        if not shown:
            return [], []
        values = np.array(
            [[math.nan if x is None else x.amplitude for x in each] for each in shown.values()]
        )
        spread = np.array(
            [
                [self._own(x, run) for x, run in zip(each, self.runs, strict=True)]
                for each in shown.values()
            ]
        )
        units = [run.unit for run in self.runs]
        over, out = outliers(values, spread, units)
        of_units = _outlying_units(values, spread, units)
        rows, deviations = [], []
        for k, (name, each) in enumerate(shown.items()):
            rows.append(self._row(name, each, out[k], of_units[k]))
            middle = float(np.nanmedian(values[k]))
            for j, one in enumerate(each):
                if one is not None:
                    deviations.append(
                        RunDeviation(
                            self.channel,
                            name,
                            self.runs[j].name,
                            self.runs[j].unit,
                            one.amplitude,
                            spread[k, j],
                            one.amplitude / middle - 1.0,
                            float(over[k, j]),
                            bool(out[k, j]),
                            one.status,
                        )
                    )
        rows.sort(key=lambda row: -row.mean)
        return rows, deviations

    def _row(
        self, name: str, each: Sequence[Line | None], out: np.ndarray, units: Sequence[str]
    ) -> LineScatter:
        kept = [(k, x) for k, x in enumerate(each) if x is not None]
        x = np.array([one.amplitude for _, one in kept])
        sigma = np.array([self._own(one, self.runs[k]) for k, one in kept])
        common = float(np.median([self._by_table(one, self.runs[k]) for k, one in kept]))
        found = random_effects(x, sigma, [self.runs[k].unit for k, _ in kept])
        told = [self.runs[k].name for k, _ in kept if out[k]]
        return LineScatter(
            self.channel,
            name,
            float(np.median([one.frequency for _, one in kept])),
            len(kept),
            found.mean,
            math.hypot(found.uncertainty, common),
            float(np.median(x)),
            float(np.sqrt(np.mean(sigma**2))) / found.mean,
            found.runs.value / found.mean,
            found.runs.low / found.mean,
            found.runs.high / found.mean,
            found.groups.value / found.mean,
            found.groups.low / found.mean,
            found.groups.high / found.mean,
            ", ".join([*told, *(f"unit {unit}" for unit in units)]),
        )


def _common(each: Sequence[Line | None], of: Sequence[int]) -> Line | None:
    """The smallest of a line in the runs ``of``; None where fewer than half of these show it."""
    shown = [one for k in of if (one := each[k]) is not None]
    if not shown or 2 * len(shown) < len(of):
        return None
    return min(shown, key=lambda one: one.amplitude)


def _not_compared(line: Line) -> str:
    """Why a line of a run says nothing of scatter, in words; empty where it does."""
    if line.status in NOT_THE_DRIVES:
        return line.status
    if line.status in ("decaying", "growing"):
        return f"{line.status}: its amplitude depends on when the record began"
    return ""


def _outlying_units(
    values: np.ndarray, spread: np.ndarray, units: Sequence[str]
) -> list[list[str]]:
    """Units whose median is an outlier among those of three units or more, for each line."""
    names = list(dict.fromkeys(units))
    medians, errors = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of lines that a unit does not show
        for name in names:
            own = np.flatnonzero([unit == name for unit in units])
            medians.append(np.nanmedian(values[:, own], axis=1))
            errors.append(np.nanmedian(spread[:, own], axis=1))
    found = outliers(np.array(medians).T, np.array(errors).T, [""] * len(names))[1]
    return [[names[j] for j in np.flatnonzero(row).tolist()] for row in found]


def _known(uncertainty: float) -> float:
    return uncertainty if math.isfinite(uncertainty) else 0.0


def _name(line: Line, known: dict[str, list[Line | None]]) -> str:
    """Name of a line; of one without its own that of the same frequency in another run, or its frequency."""
    if not is_unlisted(line.name):
        return line.name
    for name, each in known.items():
        own = next((x for x in each if x is not None), None)
        if own is None or not is_unlisted(own.name):
            continue
        spread = math.hypot(_known(own.frequency_uncertainty), _known(line.frequency_uncertainty))
        if abs(own.frequency - line.frequency) < max(_SAME_FREQUENCY * own.frequency, 3.0 * spread):
            return name
    return f"at {line.frequency:.5g} Hz"


def _outlying_runs(deviations: Sequence[RunDeviation]) -> dict[str, float]:
    """Runs of which half of the lines that can be judged or more are outliers, and the median of their
    amplitudes over those of their unit, less one.
    """
    found = {}
    for name in dict.fromkeys(x.run for x in deviations):
        own = [x for x in deviations if x.run == name and math.isfinite(x.over_scale)]
        if own and 2 * sum(x.outlier for x in own) >= len(own):
            found[name] = float(np.median([_over_unit(x, deviations) for x in own]))
    return found


def _runs_apart(deviations: Sequence[RunDeviation]) -> Iterator[RunsApart]:
    """Of each unit the two runs that are farthest apart, if their amplitudes as a whole differ by
    ``OTHER_FACTOR`` or may do so within two standard uncertainties.
    """
    for unit in dict.fromkeys(x.unit for x in deviations):
        runs: dict[str, dict[tuple[str, str], RunDeviation]] = {}
        for x in deviations:
            if x.unit == unit:
                runs.setdefault(x.run, {})[x.channel, x.line] = x
        pairs = [(a, b, *_log_apart(runs[a], runs[b])) for a, b in permutations(runs, 2)]
        far = [x for x in pairs if x[2] > 0.0 and x[2] + 2.0 * x[3] >= math.log(OTHER_FACTOR)]
        if far:
            large, small, apart, _ = max(far, key=lambda x: x[2])
            yield RunsApart(large, small, math.exp(apart))


def _log_apart(
    a: Mapping[tuple[str, str], RunDeviation], b: Mapping[tuple[str, str], RunDeviation]
) -> tuple[float, float]:
    """Median of the logarithms of the ratios, a over b, of the lines that two runs show, and its standard
    uncertainty; 0 where they show none in common.
    """
    both = [(a[key], b[key]) for key in a if key in b]
    if not both:
        return 0.0, 0.0
    logs = [math.log(x.amplitude / y.amplitude) for x, y in both]
    spread = [math.hypot(x.uncertainty / x.amplitude, y.uncertainty / y.amplitude) for x, y in both]
    return float(np.median(logs)), float(np.median(spread)) * _OF_A_MEDIAN / math.sqrt(len(both))


def _over_unit(one: RunDeviation, deviations: Sequence[RunDeviation]) -> float:
    """Amplitude over the median of its line in the runs of its unit, less one."""
    key = (one.channel, one.line, one.unit)
    alike = [x.amplitude for x in deviations if (x.channel, x.line, x.unit) == key]
    return one.amplitude / float(np.median(alike)) - 1.0


RULE = (
    f"An outlier is more than {OUTLIER_RATIO:g} times its scale away from the median of its unit's runs; the scale"
    " is the line's own uncertainty and the scatter that all lines of the channel have in common (the median of all"
    f" deviations). A unit is one if its median is so among those of all units. Fewer than {FEWEST_FOR_OUTLIERS} runs"
    " (units) have none. Outliers are named, and nothing is left out."
)
"""Rule for outliers, in words."""
