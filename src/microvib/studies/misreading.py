"""Mistakes of recordings that figures tell: another sign, order of samples, unit or axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

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
"""Median deviation of these logarithms up to which they have a scale in common."""
MIN_COMMON_FIGURES = 3
"""Figures in common below which nothing is told of two sets."""
MIN_MEAN_COSINE, MIN_COSINE_GAIN = 0.7, 0.5
"""Mean cosine of differences of angles from which a reading fits, and by how much it must be better
than the angles as they are.
"""


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


def scale_in_words(logarithm: float, close: float = UNIT_TOLERANCE) -> str:
    """A scale in words: by what the recording is to be divided."""
    times = math.exp(logarithm)
    for f, unit in UNITS.items():
        if abs(times / f - 1.0) < close:
            return f"divided by {f:.6g}, as in {unit} taken for N*m,"
    for f, unit in UNITS.items():
        if abs(times * f - 1.0) < close:
            return f"multiplied by {f:.6g}, as in N*m taken for {unit},"
    if logarithm > 0.0:
        return f"divided by {times:.3g}"
    return f"multiplied by {1.0 / times:.3g}"


def common_scale(logarithms: Sequence[float]) -> float:
    """The logarithm of the scale by which all of some amplitudes differ from others; 0 where there
    is none in common.

    ``logarithms`` are those of each line's ratio.
    """
    if len(logarithms) < MIN_COMMON_FIGURES:
        return 0.0
    middle = float(np.median(logarithms))
    scatter = float(np.median(np.abs(np.array(logarithms) - middle)))
    if abs(middle) < MIN_LOG_SCALE or scatter > MAX_LOG_SCATTER:
        return 0.0
    # what the model is off, line by line, makes a scale inexact: a unit's within that scatter is
    # taken
    near = [math.log(f) * sign for f in UNITS for sign in (1.0, -1.0)]
    unit = min(near, key=lambda one: abs(one - middle))
    if abs(unit - middle) < max(scatter, UNIT_TOLERANCE):
        return unit
    return middle


def best_reversal(mine: Sequence[Observation], its: Sequence[Observation], steps: int) -> str:
    """How angles and decays, ``mine``, must be read to be as ``its``: in the words of
    ``reversal_variants``, nothing as they are.
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
    if each[best] > max(MIN_MEAN_COSINE, each[""] + MIN_COSINE_GAIN):
        return best
    return ""


def _key(o: Observation) -> tuple[str, str, str]:
    return o.line, o.form, o.against


MAX_AXIS_SCATTER, MIN_AXIS_SCATTER, AXIS_GAIN = 0.1, 0.25, 4.0
"""Median deviation of the logarithms of ratios up to which another channel has the same lines; from which the
named channel has not; and times the other's that it must be.
"""
MOST_AXIS_LINES = 8
_DRIFT = 2e-3
"""Part of their frequency by which lines of two tests are looked for at each other's."""


def other_axis(
    lines: Sequence[tuple[float, float]],
    channels: Mapping[str, np.ndarray],
    sample_rate: float,
    named: str,
) -> tuple[str, float]:
    """Channel of a recording that has a test's ``lines``, pairs of frequency [Hz] and amplitude, where the
    ``named`` one has not, and the logarithm of its scale; empty where there is none.

    ``channels`` are the recording's, (n,) each at ``sample_rate`` [Hz]. The largest lines count.
    """
    largest = sorted((x for x in lines if x[1] > 0.0), key=lambda x: -x[1])[:MOST_AXIS_LINES]
    if len(largest) < MIN_COMMON_FIGURES or named not in channels:
        return "", 0.0
    each: dict[str, tuple[float, float]] = {}
    for name, x in channels.items():
        if not np.all(np.isfinite(x)) or np.ptp(x) == 0.0:
            continue
        spectrum = HannSpectrum.of(x - x.mean(), sample_rate)
        ratios = np.array([_at_line(x, spectrum, f) / amplitude for f, amplitude in largest])
        logs = np.log(np.maximum(ratios, 1e-300))
        middle = float(np.median(logs))
        each[name] = float(np.median(np.abs(logs - middle))), middle
    best = min(each, key=lambda name: each[name][0], default=named)
    if best == named or named not in each:
        return "", 0.0
    least = max(MIN_AXIS_SCATTER, AXIS_GAIN * each[best][0])
    if each[best][0] > MAX_AXIS_SCATTER or each[named][0] < least:
        return "", 0.0
    return best, each[best][1]


def _at_line(x: np.ndarray, spectrum: HannSpectrum, frequency: float) -> float:
    """Amplitude of a channel at the highest peak about a frequency [Hz]."""
    off = _DRIFT * frequency
    at, _ = spectrum.peak(frequency - off, frequency + off)
    return tone_amplitude(x, spectrum.sample_rate, at)
