"""Mistakes of recordings that figures tell: another sign, order of samples, unit or axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from microvib.signals.spectrum import tone_amplitude
from microvib.signals.tones import HannSpectrum
from microvib.studies.evidence import Observation
from microvib.studies.relative_phase import phase_multiples

UNITS = {
    1e3: "mN*m",
    1e6: "uN*m",
    1.0 / 0.112985: "lbf*in",
    1.0 / 1.355818: "lbf*ft",
    1.0 / 9.80665: "kgf*m",
    1e2: "N*cm",
}
"""Names of units, by how many of them are a newton metre."""
UNIT_TOLERANCE = 0.05
"""Relative difference of a scale from a unit's, up to which it is called that."""

MIN_LOG_SCALE = math.log(5.0)
"""Median of the logarithms of ratios from which two sets of amplitudes differ by a scale rather
than line by line.
"""
MAX_LOG_SCATTER = 1.0
"""Median deviation of these logarithms up to which their median is a scale in common, but for a third
of the median: what is off by a factor of 3 line by line has no common factor of 7.
"""
CONSENSUS_WIDTH, MIN_CONSENSUS, CONSENSUS_LEAD = 0.2, 4, 2.0
"""Width of logarithms within which lines follow one scale; at how many places of the frequency axis they
must; and how many times as many as follow any other scale.
"""
SAME_PLACE = 0.1
"""Logarithm of two frequencies' ratio up to which lines are at one place."""
MOST_FOLLOW = 2.0 / 3.0
"""Part of the lines from which a scale is told without their number."""
MIN_COMMON_FIGURES = 3
"""Figures in common below which nothing is told of two sets."""
MIN_MEAN_COSINE, MIN_COSINE_GAIN = 0.7, 0.5
"""Mean cosine of differences of angles from which a reading fits, and by how much it must be better
than the angles as they are.
"""
MIN_MEAN_COSINE_BELOW = 0.9
"""Mean cosine of the lines below a resonance alone, of which there are few."""
MAX_LOG_FOLLOWED = math.log(2.0)
"""Logarithm by which a line's ratio may be off a scale that it follows: below a resonance that amplifies by
less, phases are as they were.
"""
LACKING, LACKING_UNSEEN = 5.0, 2.0
"""Factor by which a record must fall short of each main line of another side for its scale to be in question;
and where none of these lines stands above its floor. A drive that was made quieter by 10 dB has 1/3.
"""
MAIN_LINES = 0.1
"""Amplitude over the largest's from which a line is a main one: smaller ones may be other machines'."""
MIN_ROLL_OFF = 0.75
"""Power of the frequency with which a record's part of lines falls behind a low-pass; well beyond its corner
it is 1 for one of first order.
"""
SIGMAS = 3.0
"""Standard uncertainties within which an estimate is expected; noise alone exceeds them in 1 of 90 lines."""


def reversal_variants(
    observations: Sequence[Observation], steps: int
) -> dict[str, tuple[Observation, ...]]:
    """Observations as they are, and with sign, time or both reversed; ``steps`` are full steps in
    an electrical period.
    """
    back = tuple(o for o in map(_time_reversed, observations) if o is not None)
    return {
        "": tuple(observations),
        "with its sign reversed": tuple(_sign_reversed(o, steps) for o in observations),
        "with its time reversed": back,
        "with its sign and time reversed": tuple(_sign_reversed(o, steps) for o in back),
    }


def _sign_reversed(o: Observation, steps: int) -> Observation:
    """The observation as it is where the channel's sign is reversed; ``steps`` are full steps in an
    electrical period.
    """
    if not o.is_angle:
        return o
    if o.form == "turn":
        mine, its = (1, 0)
    else:
        mine, its = phase_multiples(o.line, o.against, steps)
    return replace(o, value=math.remainder(o.value + math.pi * (mine - its), math.tau))


def _time_reversed(o: Observation) -> Observation | None:
    """The observation as it is where the samples are in reverse order; None of what the first
    sample's time tells.
    """
    if o.form == "turn":
        return None
    if o.is_angle or o.form == "decay":
        return replace(o, value=-o.value)
    return o


def is_of_units(logarithm: float, close: float = UNIT_TOLERANCE) -> bool:
    """Whether a scale is that of one unit taken for another."""
    factors = [*UNITS, *(1.0 / f for f in UNITS)]
    return any(abs(math.exp(logarithm) / f - 1.0) < close for f in factors)


def scale_in_words(logarithm: float, close: float = UNIT_TOLERANCE) -> str:
    """A scale in words: by what the recording is to be divided."""
    times = math.exp(logarithm)
    for f, unit in UNITS.items():
        if abs(times / f - 1.0) < close:
            return f"{_by(f)}, as in {unit} taken for N*m,"
    for f, unit in UNITS.items():
        if abs(times * f - 1.0) < close:
            return f"{_by(1.0 / f)}, as in N*m taken for {unit},"
    return _by(times, ".3g")


def _by(times: float, form: str = ".6g") -> str:
    """A division by a number in words: a multiplication where it is below 1."""
    if times > 1.0:
        return f"divided by {times:{form}}"
    return f"multiplied by {1.0 / times:{form}}"


Ratios = Sequence[tuple[float, float]]
"""Pairs of frequency [Hz] and logarithm of the ratio of a line of two tests."""


@dataclass(frozen=True)
class Consensus:
    """A scale that several lines have in common."""

    logarithm: float
    """Logarithm of the scale: the median of those of its lines."""
    spread: float
    """How far the logarithm of a line that follows it is from it at most."""
    lines: int
    """How many lines follow it."""
    of: int
    """How many lines there are."""
    places: int
    """At how many places of the frequency axis lines follow it: a line and its sidebands are at one."""

    @property
    def most(self) -> bool:
        """Whether most lines follow it."""
        return self.lines >= MOST_FOLLOW * self.of


def consensus(ratios: Ratios) -> Consensus | None:
    """The scale that lines at more places of the frequency axis follow than any other one; None where
    no scale is clearly ahead.

    A table's resonance takes lines about it and above it from the scale, each by another factor, and
    may take the most of them: the median is then no line's scale, and the densest place of the
    logarithms is. A line and its sidebands are off by one factor anyway and count once.
    """
    best = _densest(ratios)
    if best is None or best.places < MIN_CONSENSUS:
        return None
    others = [x for x in ratios if abs(x[1] - best.logarithm) > CONSENSUS_WIDTH]
    rival = _densest(others)
    if rival is not None and best.places < CONSENSUS_LEAD * rival.places:
        return None
    return best


def _densest(ratios: Ratios) -> Consensus | None:
    """The scale that lines at most places follow, whether it is clearly ahead or not; None without lines."""
    if not ratios:
        return None
    frequencies, logs = np.array(sorted(ratios, key=lambda x: x[1])).T
    places = _places(frequencies)
    ends = np.searchsorted(logs, logs + CONSENSUS_WIDTH, side="right")
    windows = [slice(start, end) for start, end in enumerate(ends)]
    best = max(windows, key=lambda one: (np.unique(places[one]).size, logs[one].size))
    count = int(np.unique(places[best]).size)
    middle = float(np.median(logs[best]))
    spread = float(np.max(np.abs(logs[best] - middle)))
    return Consensus(middle, spread, logs[best].size, logs.size, count)


def _places(frequencies: np.ndarray) -> np.ndarray:
    """Numbers of the places of lines on the frequency axis; lines nearer than ``SAME_PLACE`` are at one."""
    order = np.argsort(frequencies)
    apart = np.diff(np.log(frequencies[order])) > SAME_PLACE
    places = np.empty(order.size, dtype=int)
    places[order] = np.concatenate(([0], np.cumsum(apart)))
    return places


def common_scale(ratios: Ratios) -> float:
    """The logarithm of the scale by which some amplitudes differ from others; 0 where they have none
    in common. Half of the lines must be off in its direction.
    """
    if len(ratios) < MIN_COMMON_FIGURES:
        return _thousand_of_all(ratios)
    logarithms = np.array([logarithm for _, logarithm in ratios])
    middle = float(np.median(logarithms))
    scatter = float(np.median(np.abs(logarithms - middle)))
    found = consensus(ratios)
    if found is None:
        scale, allowed, spread = middle, min(MAX_LOG_SCATTER, abs(middle) / 3.0), scatter
    else:
        scale, allowed, spread = found.logarithm, abs(found.logarithm) / 3.0, found.spread
    if min(abs(middle), abs(scale)) < MIN_LOG_SCALE or middle * scale < 0.0 or scatter > allowed:
        return 0.0
    return _unit_within(scale, spread + UNIT_TOLERANCE)


def _thousand_of_all(ratios: Ratios) -> float:
    """The logarithm of a thousand or a million, or of a part of it, if all of a few lines are off by
    that; else 0.
    """
    for scale in (math.log(f) * sign for f in (1e3, 1e6) for sign in (1.0, -1.0)):
        if ratios and all(abs(one - scale) < UNIT_TOLERANCE for _, one in ratios):
            return scale
    return 0.0


def _unit_within(scale: float, scatter: float) -> float:
    """The logarithm of a unit's scale if it is the only one within a scatter of a scale's, or else the
    scale's: what a model is off, line by line, makes a scale inexact.
    """
    every = [math.log(f) * sign for f in UNITS for sign in (1.0, -1.0)]
    near = [one for one in every if abs(one - scale) < scatter]
    if len(near) == 1:
        return near[0]
    return scale


@dataclass(frozen=True)
class ShownLine:
    """A line of one side, and what a record has of it."""

    name: str
    expected: float
    """Amplitude of the other side, which is above its floor."""
    amplitude: float
    """Amplitude in the record; of noise alone where the line is not seen."""
    uncertainty: float
    """Its standard uncertainty."""
    seen: bool
    """Whether it is above the record's floor."""
    frequency: float = math.nan
    """[Hz]."""

    @property
    def in_words(self) -> str:
        """Its name and the part that the record has, or may have at most."""
        if self.seen:
            return f"{self.name} at {100.0 * self.amplitude / self.expected:.3g} %"
        most = self.amplitude + SIGMAS * self.uncertainty
        return f"{self.name} at most at {100.0 * most / self.expected:.2g} %"

    def least(self, quiet: bool) -> float:
        """Amplitude that the record has of it: of a hidden line what is beyond the noise's, unless the whole
        record is ``quiet``, with no line above its floor.
        """
        if self.seen or quiet:
            return self.amplitude
        return self.amplitude - SIGMAS * self.uncertainty

    def has(self, scale: float) -> bool:
        """Whether the record has the line divided by e to the ``scale``: below its floor, may have."""
        there = self.expected * math.exp(-scale)
        within = SIGMAS * self.uncertainty
        if self.seen:
            return abs(self.amplitude - there) < within + UNIT_TOLERANCE * there
        return self.amplitude + within > there


def lacking_lines(lines: Sequence[ShownLine]) -> tuple[ShownLine, ...]:
    """Main lines of which a record has far too little, the largest first, if it has of all that it would show;
    else nothing.

    One line may be far smaller than expected, all of them together are not of a drive that runs: its unit,
    gain or channel may be another. Lines that noise would hide say nothing.
    """
    main = _main_lines(lines)
    quiet = not any(x.seen for x in main)
    telling = _telling(main, quiet)
    if any(_has_enough(x, quiet) for x in telling):
        return ()
    return tuple(sorted(telling, key=lambda x: -x.expected))


def _main_lines(lines: Sequence[ShownLine]) -> list[ShownLine]:
    largest = max((x.expected for x in lines), default=0.0)
    return [x for x in lines if x.expected >= MAIN_LINES * largest]


def _telling(lines: Sequence[ShownLine], quiet: bool) -> list[ShownLine]:
    """Lines that noise would not hide; ``quiet`` where it hides all."""
    factor = LACKING_UNSEEN if quiet else LACKING
    return [x for x in lines if x.seen or x.expected > factor * SIGMAS * x.uncertainty]


def _has_enough(line: ShownLine, quiet: bool) -> bool:
    """Whether a record does not fall far short of a line; ``quiet`` where noise hides all."""
    factor = LACKING_UNSEEN if quiet else LACKING
    return line.least(quiet) * factor > line.expected


def rolled_off_lines(lines: Sequence[ShownLine]) -> tuple[ShownLine, ...]:
    """Main lines from some frequency up of which a record has far too little, and the less the higher they
    are, as behind a low-pass; the largest first. Nothing of one line alone, nor where they are smaller by a
    factor in common, as of a quieter drive.
    """
    telling = sorted(_telling(_main_lines(lines), False), key=lambda x: -x.frequency)
    lacking = list(takewhile(lambda x: not _has_enough(x, False), telling))
    seen = [x for x in lacking if x.seen and x.amplitude > 0.0]
    if len(seen) < 2:
        return ()
    octaves = math.log(seen[0].frequency / seen[-1].frequency)
    fall = math.log(_part(seen[-1]) / _part(seen[0]))
    if octaves < SAME_PLACE or fall < MIN_ROLL_OFF * octaves:
        return ()
    return tuple(sorted(lacking, key=lambda x: -x.expected))


def _part(line: ShownLine) -> float:
    return line.amplitude / line.expected


def unit_of_lacking(lines: Sequence[ShownLine]) -> float:
    """The logarithm of the one unit's scale by which a record has less of all ``lines``, within their
    uncertainties; 0 where none is seen, none fits or several do.
    """
    every = [math.log(f) * sign for f in UNITS for sign in (1.0, -1.0)]
    fit = [scale for scale in every if all(x.has(scale) for x in lines)]
    if len(fit) == 1 and any(x.seen for x in lines):
        return fit[0]
    return 0.0


def followed_up_to(ratios: Ratios, scale: float) -> float:
    """Frequency [Hz] of the first line that does not follow a scale, inf where all do."""
    off = [f for f, logarithm in ratios if abs(logarithm - scale) > MAX_LOG_FOLLOWED]
    return min(off, default=math.inf)


def best_reversal(
    mine: Sequence[Observation],
    its: Sequence[Observation],
    steps: int,
    least: float = MIN_MEAN_COSINE,
) -> str:
    """How angles and decays, ``mine``, must be read to be as ``its``: in the words of
    ``reversal_variants``, nothing as they are. ``least`` is the mean cosine of their differences
    from which they are.
    """
    others = {(o.line, o.form, o.against): o.value for o in its}

    def fit(which: Sequence[Observation]) -> float:
        apart = [
            math.cos(o.value - others[key])
            for o in which
            if o.form == "phase" and (key := _key(o)) in others
        ]
        apart += [
            math.copysign(1.0, o.value * others[key])
            for o in which
            if o.form == "decay"
            and abs(o.value) > 2.0 * o.uncertainty
            and (key := _key(o)) in others
        ]
        apart = [one for one in apart if math.isfinite(one)]
        if len(apart) >= MIN_COMMON_FIGURES:
            return sum(apart) / len(apart)
        return math.nan

    each = {what: fit(which) for what, which in reversal_variants(mine, steps).items()}
    best = max(each, key=lambda what: (each[what], not what))
    if each[best] > max(least, each[""] + MIN_COSINE_GAIN):
        return best
    return ""


def _key(o: Observation) -> tuple[str, str, str]:
    return o.line, o.form, o.against


MAX_AXIS_SCATTER, MIN_AXIS_SCATTER, AXIS_GAIN = 0.1, 0.25, 4.0
"""Median deviation of the logarithms of ratios up to which another channel has the same lines; from which the
named channel has not; and times the other's that it must be.
"""
MAX_AXIS_SCALE = 0.1
"""Logarithm of its scale up to which another channel has the lines as they are, where the named one has them
at another scale.
"""
MOST_AXIS_LINES = 8
"""Largest lines of which this is asked."""
_DRIFT = 2e-3
"""Part of their frequency by which lines of two tests are looked for at each other's."""


@dataclass(frozen=True)
class OtherAxis:
    """A channel that has a test's lines in place of the named one."""

    channel: str
    scale: float
    """Logarithm of its scale."""
    named_scale: float | None = None
    """Logarithm of the named channel's, where it has the lines at one scale, too; None where it has not."""


def other_axis(
    lines: Sequence[tuple[float, float]],
    channels: Mapping[str, np.ndarray],
    sample_rate: float,
    named: str,
) -> OtherAxis | None:
    """Channel of a recording that has a test's ``lines``, pairs of frequency [Hz] and amplitude, where the
    ``named`` one has not, or only at another scale; None where there is none.

    ``channels`` are the recording's, (n,) each at ``sample_rate`` [Hz]. The largest lines count, or else
    those of the lower half, which a table's resonance changes less.
    """
    seen = sorted(x for x in lines if x[1] > 0.0)
    alive = {name: x for name, x in channels.items() if np.all(np.isfinite(x)) and np.ptp(x) > 0.0}
    for some in (seen, seen[: len(seen) // 2]):
        largest = sorted(some, key=lambda x: -x[1])[:MOST_AXIS_LINES]
        if len(largest) < MIN_COMMON_FIGURES or named not in alive:
            break
        each = {name: _log_ratios(x, sample_rate, largest) for name, x in alive.items()}
        if found := _axis_of(each, named):
            return found
    return None


def _log_ratios(
    x: np.ndarray, sample_rate: float, lines: Sequence[tuple[float, float]]
) -> np.ndarray:
    """Logarithms of a channel's amplitudes over those of lines, in their order."""
    spectrum = HannSpectrum.of(x - x.mean(), sample_rate)
    ratios = np.array([_at_line(x, spectrum, f) / amplitude for f, amplitude in lines])
    return np.log(np.maximum(ratios, 1e-300))


def _axis_of(each: Mapping[str, np.ndarray], named: str) -> OtherAxis | None:
    """Channel in which lines have one scale, where they have none in the named one, or where they are as
    they should be, and in the named one far off by one scale, as by cross-talk.

    ``each`` has the logarithms of the channels' ratios.
    """
    middle = {name: float(np.median(logs)) for name, logs in each.items()}
    scatter = {name: float(np.median(np.abs(logs - middle[name]))) for name, logs in each.items()}
    if scatter[named] <= MAX_AXIS_SCATTER and abs(middle[named]) >= MIN_LOG_SCALE:
        nearest = min(middle, key=lambda name: abs(middle[name]))
        if abs(middle[nearest]) < MAX_AXIS_SCALE and scatter[nearest] < MAX_AXIS_SCATTER:
            return OtherAxis(nearest, 0.0, middle[named])
    best = min(scatter, key=lambda name: scatter[name])
    least = max(MIN_AXIS_SCATTER, AXIS_GAIN * scatter[best])
    if best == named or scatter[best] > MAX_AXIS_SCATTER or scatter[named] < least:
        return None
    return OtherAxis(best, _unit_within(middle[best], scatter[best] + UNIT_TOLERANCE))


def _at_line(x: np.ndarray, spectrum: HannSpectrum, frequency: float) -> float:
    """Amplitude of a channel at the highest peak about a frequency [Hz]."""
    off = _DRIFT * frequency
    at, _ = spectrum.peak(frequency - off, frequency + off)
    return tone_amplitude(x, spectrum.sample_rate, at)
