"""Comparison of any two: scenario, run folder, recording, table of lines, or reference lines
tables.
"""

from __future__ import annotations

import cmath
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, get_args

import numpy as np

from microvib.analysis.background import background_notes
from microvib.analysis.limits import part_of_cycle_note
from microvib.analysis.lines import find_lines, lines_of_recording, recording_warnings
from microvib.analysis.steadiness import blurred
from microvib.errors import MicrovibError, OptionError, expect
from microvib.io.recordings import Prepared
from microvib.io.sources import ReferenceLines, RunFolder, Source, open_source
from microvib.model.line_names import LineName, is_unlisted
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.line_table import NOT_THE_DRIVES, Line, LineTable
from microvib.solve.integration import Progress
from microvib.solve.motion import Motion
from microvib.solve.simulate import simulate
from microvib.studies.chain_filter import LineRatio, find_filter
from microvib.studies.evidence import Observation, observations
from microvib.studies.misreading import (
    CONSENSUS_WIDTH,
    MIN_COMMON_FIGURES,
    MIN_LOG_SCALE,
    MIN_MEAN_COSINE_BELOW,
    Ratios,
    ShownLine,
    best_reversal,
    common_scale,
    consensus,
    followed_up_to,
    is_of_units,
    lacking_lines,
    other_axis,
    rolled_off_lines,
    scale_in_words,
    unit_of_lacking,
)
from microvib.testdata.recording import Recording
from microvib.text_tables import counted
from microvib.units import Band, band, within_band

COVERAGE = 2.0
"""Standard uncertainties of the difference within which two amplitudes agree; of equal lines one in
twenty is beyond.
"""
AGREES, DIFFERS, UNJUDGED, ONLY_A, ONLY_B = "agrees", "differs", "not judged", "only A", "only B"
HIDDEN = "hidden"
"""Verdict on a line below the floor or the background of one side, unless the other's is
too large for that floor: under a floor that is high enough anything agrees, and amplitudes of noise
alone are above two deviations in one of seven cases."""
FREQUENCY_TOLERANCE = 1e-4
"""Relative difference of frequency up to which unexpected lines of aligned clocks are the same, or
three uncertainties.
"""
_MOST_NAMED = 4
_WHY_ALL_LACK = "was the drive running, and are channel, unit of measure and gain right?"
_WHY_BAND_LACKS = (
    "does a filter in the chain or its passband hold them back (response of the preparation file), "
    "or is the scenario that of another drive?"
)


@dataclass(frozen=True)
class SideLine:
    """Line of one side; nan where a value is unknown."""

    frequency: float = math.nan
    amplitude: float = math.nan
    uncertainty: float = math.nan
    bin_frequency: float = math.nan
    bin_amplitude: float = math.nan
    seen: bool = True
    """Whether it is above the noise floor."""
    frequency_uncertainty: float = 0.0
    decay: float = 0.0
    """[1/s]; 0 of a line that lasts."""
    decay_uncertainty: float = 0.0
    steady: bool = True
    """Whether the record is so where the line is: of one that is not the amplitude is not known."""

    usable: bool = True
    """Whether it is the drive's as the force table shows it: outside its usable band, near its resonances and
    in the background it is not."""
    phase: float = math.nan
    """[rad]."""

    @property
    def place(self) -> float:
        """Frequency [Hz], or that of its bin."""
        if math.isfinite(self.frequency):
            return self.frequency
        return self.bin_frequency

    @property
    def known(self) -> bool:
        """Whether anything is said of the line."""
        return math.isfinite(self.amplitude) or math.isfinite(self.bin_amplitude)


@dataclass(frozen=True)
class Side:
    """One side of a comparison: its lines, and its samples where it has any."""

    name: str
    kind: str
    lines: dict[str, SideLine]
    clock_ratio: float | None = None
    """Step clock over nominal."""
    torque: np.ndarray | None = None
    sample_rate: float = math.nan
    scenario: Scenario | None = None
    notes: tuple[str, ...] = ()
    """Notes on reading and preparing a recording."""
    duration: float = math.nan
    """Length of the record [s]; nan of a table."""
    observations: tuple[Observation, ...] = ()
    """Values of the lines above the noise floor."""
    as_recorded: tuple[Observation, ...] = ()
    """Values of a recording, also of lines that its force table or a background changes."""
    channel: str = ""
    """Channel of a recording."""
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)
    """All channels of a recording that are of the same kind, (n,) each."""
    chain_stated: bool = False
    """Whether the preparation of a recording states the filters of its measuring chain."""
    repeats: float = math.nan
    """Frequency [Hz] with which the drive's motion repeats at its nominal clock; nan where it is not known."""


def _relative(value: float, reference: float) -> float:
    if reference > 0.0:
        return value / reference - 1.0
    return math.nan


@dataclass(frozen=True)
class Row:
    """One line of both sides."""

    line: str
    a: SideLine
    b: SideLine

    @property
    def error(self) -> float:
        """Relative difference of the amplitudes, b over a, independent of the bins; nan where a is not above its floor."""
        if self.a.seen:
            return _relative(self.b.amplitude, self.a.amplitude)
        return math.nan

    @property
    def bin_error(self) -> float:
        """Relative difference of the nearest-bin amplitudes; the bin at 0 Hz holds the mean, which is
        taken off.
        """
        if min(self.a.bin_frequency, self.b.bin_frequency) <= 0.0:
            return math.nan
        return _relative(self.b.bin_amplitude, self.a.bin_amplitude)

    @property
    def significance(self) -> float:
        """Difference of the amplitudes over its standard uncertainty; nan where that is not known."""
        spread = math.hypot(self.a.uncertainty, self.b.uncertainty)
        if spread > 0.0:
            return abs(self.b.amplitude - self.a.amplitude) / spread
        return math.nan

    @property
    def places(self) -> list[float]:
        """Frequencies [Hz] of the line on the sides that have it."""
        return [x.place for x in (self.a, self.b) if math.isfinite(x.place)]

    def is_within(self, low: float, high: float) -> bool:
        """Whether the line is in a band [Hz], by either side's frequency."""
        return any(within_band(f, low, high) for f in self.places)

    @property
    def steady(self) -> bool:
        """Whether the records of both sides are so where the line is."""
        return self.a.steady and self.b.steady

    @property
    def usable(self) -> bool:
        """Whether the force tables of both sides show the line."""
        return self.a.usable and self.b.usable

    @property
    def verdict(self) -> str:
        """Whether the amplitudes agree within their uncertainties; where one is not known they are
        not judged.
        """
        if self.a.known != self.b.known:
            if self.a.known:
                return ONLY_A
            return ONLY_B
        if math.isnan(self.significance) or not (self.steady and self.usable):
            return UNJUDGED
        larger = max(self.a, self.b, key=lambda side: side.amplitude)
        if self.significance > COVERAGE and larger.seen:
            return DIFFERS
        if self.a.seen and self.b.seen:
            return AGREES
        return HIDDEN


class Comparison(NamedTuple):
    """Both sides and the lines that at least one of them has."""

    a: Side
    b: Side
    rows: list[Row]

    def __repr__(self) -> str:
        verdicts = Counter(row.verdict for row in self.rows)
        told = ", ".join(f"{verdict}: {count}" for verdict, count in verdicts.most_common())
        return f"Comparison of {self.a.name} with {self.b.name}: {counted(len(self.rows), 'line')}\n  {told}"


ComparisonSource = Source | Motion | Recording


def compare(  # noqa: PLR0913 - keyword options
    a: ComparisonSource | str | os.PathLike[str],
    b: ComparisonSource | str | os.PathLike[str],
    *,
    names: tuple[str, str] = ("A", "B"),
    scenario: GivenScenario | None = None,
    channel: str = "Mz",
    bands: Sequence[Band] = (),
    progress: Progress | None = None,
) -> Comparison:
    """Compare the lines of two sides.

    Clocks are aligned: a scenario is simulated at the clock that the other side's recording shows.

    Parameters
    ----------
    a, b : Scenario, Motion, RunFolder, Recording, LineTable, ReferenceLines, str or path
        The sides. A name is that of a scenario, a run's folder, a recording or a table of lines, as
        ``open_source`` takes it.
    names : pair of str
        Names of sides that have none themselves.
    scenario : Scenario, str or path, optional
        Says which lines to look for in recordings where neither side is a scenario, nor the
        reference lines of one.
    channel : str
        Channel of recordings that has the torque about the drive axis.
    bands : sequence of str or pairs, optional
        Bands whose lines are compared, such as ``["0.5:150 Hz"]``; without any all are.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    Comparison
        Both sides, and a row for each line that at least one has, with its difference and verdict.

    Raises
    ------
    MicrovibError
        Where lines of a recording would have no names, for want of a drive, or a name is not known.
    SimulationError
        What ``simulate`` raises.
    """
    a, b = _opened(a), _opened(b)
    if scenario is not None:
        scenario = as_scenario(scenario)
    guide = drive_of_sides(a, b, scenario)
    sides: dict[int, Side] = {}
    given = list(enumerate(zip((a, b), names, strict=True)))
    for k, (source, name) in sorted(given, key=lambda item: isinstance(item[1][0], Scenario)):
        clock = next((s.clock_ratio for s in sides.values() if s.kind == "recording"), None)
        sides[k] = _side(source, name, guide, channel, clock, progress)
    first, second = sides[0], sides[1]
    if guide is None and {"recording"} < {first.kind, second.kind}:
        text = "lines of a recording have no names without a drive; name it"
        raise MicrovibError(f"{first.name}, {second.name}: {text}", remedy="scenario")
    first, second = _over_common_duration(first, _match_unlisted_names(first, second))
    either = dict.fromkeys([*first.lines, *second.lines])
    rows = [Row(x, first.lines.get(x, SideLine()), second.lines.get(x, SideLine())) for x in either]
    return Comparison(first, second, _in_bands(rows, bands))


def _opened(side: ComparisonSource | str | os.PathLike[str]) -> ComparisonSource:
    """A side that was given, or that a name stands for."""
    if isinstance(side, (str, os.PathLike)):
        return open_source(os.fspath(side))
    sources = "a scenario, a motion, a recording or a table of lines (mv.open_source has all names)"
    expect(side, get_args(ComparisonSource), sources)
    return side


def _in_bands(rows: list[Row], bands: Sequence[Band]) -> list[Row]:
    """The lines in any of the bands, by either side's frequency."""
    ends = [band(given) for given in bands]
    if not ends:
        return rows
    kept = [r for r in rows if any(r.is_within(*pair) for pair in ends)]
    if not kept:
        every = sorted(f for r in rows for f in r.places)
        if every:
            where = f"lines are from {every[0]:.4g} to {every[-1]:.4g} Hz"
        else:
            where = "neither side has any"
        raise OptionError("band", f"no line of either side lies in it; {where}")
    return kept


def misread(a: Side, b: Side, rows: Sequence[Row]) -> tuple[str, ...]:
    """Sentences on mistakes of unit, sign or order of samples by which one side would be as the
    other.
    """
    axes = _misread_axes(a, b)
    if axes:
        return axes  # lines of different axes are of no common scale or sign
    ratios, lacking = _log_ratios(rows), _lacking(a, b, rows)
    scale = common_scale(ratios)
    for side, lines in lacking.items():  # their uncertainties tell units apart that are near
        scale = (1.0 if side == "A" else -1.0) * unit_of_lacking(lines) or scale
    if a.kind == "recording":
        recorded, other, mark, sign = (a, b, "A", -1.0)
    else:
        recorded, other, mark, sign = (b, a, "B", 1.0)
    what, why = [_reversal(recorded, other, followed_up_to(ratios, scale))], ""
    if scale:
        factor, taken, unit = scale_in_words(sign * scale).rstrip(",").partition(", as in ")
        what.append(factor)
        why = f"{taken}{unit}{_followers(ratios)}"
    told = (
        () if scale else tuple(f"{_lacking_in_words(*x)}: {_WHY_ALL_LACK}" for x in lacking.items())
    )
    if not (said := " and ".join(filter(None, what))):
        return told
    checked = recorded.name
    if a.kind == b.kind == "recording":
        checked = "both recordings"
    like = f"{mark} {said} would be like {'B' if mark == 'A' else 'A'}{why}"
    return (f"{like}: check order, sign and unit of {checked}.", *told)


def lacking_within(
    a: Side, b: Side, rows: Sequence[Row], low: float, high: float
) -> tuple[str, ...]:
    """Sentences on a side that is a record with far too little of all main lines of the other from ``low`` to
    ``high`` [Hz], or of those from some frequency up, as behind a low-pass; empty where it has enough.

    A low-pass is looked for among the lines of the band, and among all of the record: a band may have one line
    alone.
    """
    inside = [r for r in rows if r.is_within(low, high)]
    where = f"from {low:.4g} Hz" + (f" to {high:.4g} Hz" if math.isfinite(high) else "")
    if lacking := _lacking(a, b, inside):
        told = [f"{where} {_lacking_in_words(*x)}" for x in lacking.items()]
    else:
        told = [
            f"{where} {_rolled_off_in_words(*x)}"
            for x in _lacking(a, b, inside, rolled_off_lines).items()
        ] or [
            _rolled_off_in_words(*x)
            for x in _lacking(a, b, rows, rolled_off_lines).items()
            if min(line.frequency for line in x[1]) <= high
        ]
    if told:
        return tuple(f"{sentence}: {_WHY_BAND_LACKS}" for sentence in told)
    return tuple(filter_gaps(a, b, rows, low, high))


def filter_gaps(a: Side, b: Side, rows: Sequence[Row], low: float, high: float) -> Iterator[str]:
    """Sentences on filters of measuring chains that take more than is allowed of lines between ``low`` and ``high``
    [Hz], by amplitudes and phases of all lines of a recording beside the other side's.
    """
    for mark, other, side in (("A", "B", a), ("B", "A", b)):
        if side.kind != "recording" or side.chain_stated:
            continue
        repeats = next((x.repeats for x in (a, b) if math.isfinite(x.repeats)), math.nan)
        found = find_filter(tuple(_line_ratios(rows, mark)), repeats)
        if found is not None and found.takes_between(low, high):
            yield (
                f"the lines of {mark} are those of {other} behind {found}: take it out, or state that there is none"
                " (response of the preparation file)"
            )


def _line_ratios(rows: Sequence[Row], mark: str) -> Iterator[LineRatio]:
    """Lines of the clock of the side ``mark`` over the other side's, where both are known."""
    for row in rows:
        own, other = (row.a, row.b) if mark == "A" else (row.b, row.a)
        name = LineName.parse(row.line)
        if name.is_unlisted or name.is_mode or not (row.usable and row.steady):
            continue
        turn = own.phase - other.phase
        if _lasts(own) and _lasts(other) and math.isfinite(turn):
            unsure = math.hypot(
                own.uncertainty / own.amplitude, other.uncertainty / other.amplitude
            )
            yield LineRatio(other.place, cmath.rect(own.amplitude / other.amplitude, turn), unsure)


def misreads_amplitudes(a: Side, b: Side, rows: Sequence[Row]) -> bool:
    """Whether one side would be as the other in another unit, has the other's lines on another axis, or is a
    record with far too little of all of them: then its amplitudes are not those that a limit is about.
    """
    if _misread_axes(a, b) or is_of_units(common_scale(_log_ratios(rows))):
        return True
    return bool(_lacking(a, b, rows))


def _lacking(
    a: Side,
    b: Side,
    rows: Sequence[Row],
    of: Callable[[Sequence[ShownLine]], tuple[ShownLine, ...]] = lacking_lines,
) -> dict[str, tuple[ShownLine, ...]]:
    """Main lines of the other side of which a recording has far too little, by the recording's mark; ``of``
    tells which: all, nothing where it has enough of one, or those behind a low-pass.
    """
    pairs = {"A": (a, [(r, r.a, r.b) for r in rows]), "B": (b, [(r, r.b, r.a) for r in rows])}
    found = {}
    for mark, (side, lines) in pairs.items():
        shown = [
            ShownLine(
                r.line, there.amplitude, own.amplitude, own.uncertainty, own.seen, there.place
            )
            for r, own, there in lines
            if r.usable and _lasts(there) and not own.decay and own.amplitude > 0.0
        ]
        if side.kind == "recording" and (lacking := of(shown)):
            found[mark] = lacking
    return found


def _lacking_in_words(mark: str, lines: Sequence[ShownLine]) -> str:
    """A sentence on main lines of which a recording has far too little."""
    other = "B" if mark == "A" else "A"
    names = ", ".join(x.in_words for x in lines[:_MOST_NAMED])
    more = " ..." if len(lines) > _MOST_NAMED else ""
    what = f"{mark} shows none of the main lines of {other}"
    if any(x.seen for x in lines):
        what = f"{mark} has far less than {other} of every main line that its noise does not hide"
    return f"{what} ({names}{more})"


def _rolled_off_in_words(mark: str, lines: Sequence[ShownLine]) -> str:
    """A sentence on main lines of which a recording has the less the higher they are."""
    other = "B" if mark == "A" else "A"
    names = ", ".join(x.in_words for x in sorted(lines, key=lambda x: x.frequency)[:_MOST_NAMED])
    return f"{mark} has far less than {other} of its upper main lines, and the less the higher they are ({names})"


def _log_ratios(rows: Sequence[Row]) -> Ratios:
    """Ratios, B over A, of the lasting lines that both sides have above their floors; those alone that
    their force tables show, if there are enough of them.
    """
    both = [r for r in rows if _lasts(r.a) and _lasts(r.b)]
    shown = [r for r in both if r.usable]
    if len(shown) < MIN_COMMON_FIGURES:
        shown = both
    return [(r.a.place, math.log(r.b.amplitude / r.a.amplitude)) for r in shown]


def _lasts(side: SideLine) -> bool:
    """Whether a line is above the floor and does not decay, so that a scale of it means something."""
    return side.seen and side.amplitude > 0.0 and side.place > 0.0 and not side.decay


def _followers(ratios: Ratios) -> str:
    """How many lines follow the scale, where many do not; nothing where most do."""
    found = consensus(ratios)
    if found is None or found.most:
        return ""
    within = 50.0 * CONSENSUS_WIDTH
    return f", which {found.lines} of {found.of} lines follow within {within:g} %"


def _reversal(recorded: Side, other: Side, up_to: float) -> str:
    """How a recording must be read to be as the other side, in words: by all its lines, or else by those
    below a resonance, ``up_to`` [Hz], for above it phases are others.
    """
    drive = recorded.scenario or other.scenario
    steps = 4 if drive is None else drive.motor.alike_per_turn
    mine, its = recorded.observations, other.observations
    if recorded.kind == other.kind == "recording":
        mine, its = recorded.as_recorded, other.as_recorded
    found = best_reversal(mine, its, steps)
    if found or math.isinf(up_to):
        return found
    below = [o for o in mine if recorded.lines[o.line].place < up_to]
    return best_reversal(below, its, steps, MIN_MEAN_COSINE_BELOW)


def _misread_axes(a: Side, b: Side) -> tuple[str, ...]:
    """A sentence where another channel of a recording has the other side's lines, and the named one has not."""
    for mark, mine, other in (("A", a, b), ("B", b, a)):
        lines = [(x.place, x.amplitude) for x in other.lines.values() if x.seen and x.place > 0.0]
        found = other_axis(lines, mine.channels, mine.sample_rate, mine.channel)
        if found:
            words = ""
            if abs(found.scale) >= MIN_LOG_SCALE:
                words = f", {scale_in_words(found.scale).rstrip(',')}"
            own = "has not"
            if found.named_scale is not None:
                own = f"has them at {math.exp(found.named_scale):.3g} of their size"
            return (
                f"{found.channel} of {mark} has the lines of {other.channel or 'the other side'} of"
                f" {'B' if mark == 'A' else 'A'}{words}, and its {mine.channel} {own}: check channels and axes"
                f" of {mine.name}.",
            )
    return ()


def drive_of_sides(
    a: ComparisonSource, b: ComparisonSource, scenario: Scenario | None
) -> Scenario | None:
    """Find the drive that says which lines to look for in recordings: a side that is a scenario, that of one's
    run, or a ``scenario`` that the user names; None without any.
    """
    found: list[Scenario | None] = [x for x in (a, b) if isinstance(x, Scenario)]
    found += [x.scenario for x in (a, b) if isinstance(x, (RunFolder, Motion))]
    found += [scenario, *(x.scenario for x in (a, b) if isinstance(x, ReferenceLines))]
    return next((x for x in found if x is not None), None)


def _over_common_duration(a: Side, b: Side) -> tuple[Side, Side]:
    """Both sides with means of decaying lines over as long a time, that of the shorter record."""
    shorter = min(a.duration, b.duration)  # nan, where one is a table, changes nothing
    told = []
    for side in (a, b):
        lines = {
            name: _mean_over_duration(x, side.duration, shorter) for name, x in side.lines.items()
        }
        changed = [name for name, x in lines.items() if x != side.lines[name]]
        note = (
            f"{', '.join(changed)}: mean over its first {shorter:g} s, as long as the other record"
        )
        told.append(
            replace(side, lines=lines, notes=(*side.notes, note) if changed else side.notes)
        )
    return told[0], told[1]


def _match_unlisted_names(a: Side, b: Side) -> Side:
    """``b`` with its unexpected lines named as those of ``a`` at the same frequency; each side
    numbers them by size.
    """
    known = {name: x for name, x in a.lines.items() if is_unlisted(name)}
    lines: dict[str, SideLine] = {}
    for name, x in b.lines.items():
        same = next((k for k, one in known.items() if _same_frequency(one, x)), None)
        lines[(same or f"{name}_of_b") if is_unlisted(name) else name] = x
    return replace(b, lines=lines)


def _same_frequency(a: SideLine, b: SideLine) -> bool:
    spread = math.hypot(a.frequency_uncertainty, b.frequency_uncertainty)
    allowed = max(FREQUENCY_TOLERANCE * b.frequency, 0.0 if math.isnan(spread) else 3.0 * spread)
    return abs(a.frequency - b.frequency) < allowed


def _side(
    source: ComparisonSource,
    name: str,
    guide: Scenario | None,
    channel: str,
    clock: float | None,
    progress: Progress | None,
) -> Side:
    match source:
        case Scenario():
            if clock is not None:
                source = source.with_({"tracking.clock_ratio": clock})
                name = f"{name} at clock {clock:.6f}"
            return _of_motion(simulate(source, channels=("T_d",), progress=progress), name)
        case Motion():
            return _of_motion(source, name)
        case Recording():
            return _of_recording(Prepared(source.in_si()), guide, channel)
        case Prepared():
            return _of_recording(source, guide, channel)
        case RunFolder():
            return _of_run_folder(source)
        case ReferenceLines():
            return Side(source.name, "reference", _figures(source.table))
        case LineTable():
            return Side(name, "table", _figures(source))


def _of_motion(motion: Motion, name: str) -> Side:
    table = find_lines(motion)
    side = Side(
        name,
        "simulation",
        _figures(table),
        motion.scenario.tracking.clock_ratio,
        motion["T_d"],
        motion.sample_rate,
        motion.scenario,
        duration=table.duration,
        observations=observations(table),
        repeats=_repeats(motion.scenario),
    )
    return _unless_part_of_cycle(side, table)


def _repeats(scenario: Scenario | None) -> float:
    """Frequency [Hz] with which the drive's motion repeats; nan where it is not known."""
    if scenario is None or not scenario.driving_frequency:
        return math.nan
    return scenario.driving_frequency / (scenario.driver.beats * scenario.driver.microsteps)


def _unless_part_of_cycle(side: Side, table: LineTable) -> Side:
    """A simulated side, whose lines are not known where its record holds a part of what changes the
    drive slowly: they are others at other angles.
    """
    note = part_of_cycle_note(table, side.scenario)
    if not note:
        return side
    lines = {name: replace(x, steady=False) for name, x in side.lines.items()}
    return replace(side, lines=lines, notes=(*side.notes, note))


def _of_recording(source: Prepared, guide: Scenario | None, channel: str) -> Side:
    recording = source.recording
    table = lines_of_recording(recording, channel, guide, source.background)
    ratio = None
    if table.clock_ratio is not None and guide is not None:
        ratio = table.clock_ratio * guide.tracking.clock_ratio
    return Side(
        recording.title,
        "recording",
        _figures(table),
        ratio,
        recording[channel],
        recording.sample_rate,
        notes=(
            *recording.notes_on(channel),
            *background_notes(recording, source.background, channel, table),
            *recording_warnings(recording, channel, guide, table),
        ),
        duration=table.duration,
        observations=observations(table),
        chain_stated=recording.chain_stated,
        repeats=_repeats(guide),
        as_recorded=observations(_unmarked(table)),
        channel=channel,
        channels={
            name: x
            for name, x in recording.channels.items()
            if recording.units.get(name) == recording.units[channel]
        },
    )


def _unmarked(table: LineTable) -> LineTable:
    """The lines as they stand in the record, whatever they are worth as the drive's."""
    lines = [replace(x, status="ok") if x.status in NOT_THE_DRIVES else x for x in table]
    return replace(table, lines=tuple(lines))


def _of_run_folder(source: RunFolder) -> Side:
    if source.lines is None:
        raise MicrovibError(f"{source.path}: is not a run folder; it has no lines.csv")
    motion, made = source.motion, source.scenario
    side = Side(
        str(source.path),
        "run",
        _figures(source.lines),
        None if made is None else made.tracking.clock_ratio,
        None if motion is None else motion["Mz"],
        math.nan if motion is None else motion.sample_rate,
        made,
        duration=math.nan if made is None else made.record.duration,
        observations=observations(source.lines),
    )
    return _unless_part_of_cycle(side, source.lines)


def _decay_with_uncertainty(line: Line) -> tuple[float, float]:
    """Decay of a mode [1/s] and its uncertainty; none of a line that lasts."""
    if not line.is_mode or not math.isfinite(line.decay):
        return 0.0, 0.0
    return (
        line.decay,
        line.decay_uncertainty if line.decay_uncertainty > 0.0 else 0.0,
    )


def _mean_over_duration(figures: SideLine, duration: float, shorter: float) -> SideLine:
    """A decaying line's mean amplitude over the first ``shorter`` seconds of a record of
    ``duration`` [s], by its decay.
    """
    if not figures.decay or not shorter < duration:
        return figures
    longer, other, sigma = duration, shorter, figures.decay

    def change(sigma: float) -> float:
        return math.log(_mean(sigma * other) / _mean(sigma * longer))

    unsure = figures.decay_uncertainty
    more = 0.5 * abs(change(sigma + unsure) - change(sigma - unsure))
    factor = math.exp(change(sigma))
    spread = math.hypot(factor * figures.uncertainty, factor * figures.amplitude * more)
    return replace(figures, amplitude=factor * figures.amplitude, uncertainty=spread)


def _mean(fold: float) -> float:
    """Mean of exp(-t) from 0 to ``fold``."""
    if fold:
        return -math.expm1(-fold) / fold
    return 1.0


def _figures(table: LineTable) -> dict[str, SideLine]:
    return {
        x.name: SideLine(
            x.frequency, x.amplitude, x.amplitude_uncertainty, x.bin_frequency, x.bin_amplitude,
            x.seen or not x.status, x.frequency_uncertainty, *_decay_with_uncertainty(x), not blurred(table, x),
            x.status not in NOT_THE_DRIVES, x.phase,
        )
        for x in table
    }  # fmt: skip
