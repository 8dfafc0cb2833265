"""The clock ratio of a record: step clock found over step clock expected."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.model.line_names import LineName, driving_line, electrical_line, full_step_line
from microvib.signals.line_table import DETECTION_RATIO
from microvib.signals.tones import HannSpectrum, steady_tones

MAX_CLOCK_LINES = 12  # number of the strongest lines from which the clock ratio is estimated
_PEAKS = 6  # peaks tried in each band
_AGREEMENT_DISTANCE = 0.15
"""Distance [bins] of a noise-free line from where the others put it above which it is taken for
another line.
"""

WIDE_RATIO_RANGE = (0.2, 5.0)
"""Least and largest ratio at which a clock is looked for that is not where it is expected."""
_MAX_PEAKS_TRIED = 24
"""Highest peaks of a record that are tried as lines of such a clock."""
_MIN_SCORE_RATIO = 1.3
"""Times of the score of the clock where it is expected, from which another one is taken for the
record's.
"""
_MIN_COMB_LINES = 3
"""Lines of such a clock, other than driving lines, without which its comb may be any machine's."""
MAINS = (50.0, 60.0)
MAINS_BINS = 5.0
"""Bins of a record within which a line may be pick-up of the mains."""


def near_mains(frequency: float, duration: float) -> bool:
    """Whether pick-up of the mains, or of one of its first harmonics, may stand in a line [Hz] of a
    record [s].
    """
    return any(
        abs(frequency - m * mains) * duration < MAINS_BINS for mains in MAINS for m in range(1, 7)
    )


_FIRST_LINES = (*map(driving_line, (1, 2, 3)), full_step_line(1), electrical_line(1))
"""Lines of which a high peak is tried to be one."""


def search_wide_clock_ratio(
    expected: Sequence[ExpectedLine], found: float | None, highest: float, spectrum: HannSpectrum
) -> float | None:
    """Clock ratio, within ``WIDE_RATIO_RANGE``, at which far more of the ``expected`` lines stand
    out than at the one ``found``.

    Every high peak up to ``highest`` [Hz] is tried as one of the first lines of each family, and
    scored by the whole comb, the mains' lines left out. None where no ratio is better, or where
    only driving lines are detected, as a comb of any machine's does.
    """
    clock = [line for line in expected if line.of_clock]
    first = [line for line in clock if line.name in _FIRST_LINES]
    modes = [line for line in expected if line.is_mode]
    peaks = [f for f, height in spectrum.peaks(3.0 / spectrum.duration, highest, _MAX_PEAKS_TRIED)
             if height > DETECTION_RATIO * spectrum.floor(f)
             and not any(mode.low <= f <= mode.high for mode in modes)]  # fmt: skip
    if found is None or not first:
        known = 0.0
    else:
        known = sum(_scores(clock, found, first[0], spectrum).values())
    best, ratio = _MIN_SCORE_RATIO * known, None
    for line in first:
        for f in peaks:
            if WIDE_RATIO_RANGE[0] < f / line.frequency < WIDE_RATIO_RANGE[1]:
                each = _scores(clock, f / line.frequency, line, spectrum)
                others = sum(
                    score > 0.0
                    for name, score in each.items()
                    if not LineName.parse(name).is_driving_line
                )
                if others >= _MIN_COMB_LINES and sum(each.values()) > best:
                    best, ratio = sum(each.values()), f / line.frequency
    return ratio


def estimate_clock_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Clock ratio that best explains all lines of the clock together; None if none of them stands
    out.

    Every peak in the bands of the first driving lines is tried; the one whose ratio makes most
    lines are detected gives the start. Lines that the others contradict are left out, since another
    line is in their place. Gauss-Newton on the joint fit follows, in which each line has the weight
    that its amplitude and frequency give it.
    """
    start = _first_ratio(clock, spectrum)
    if start is None:
        return None
    lines, ratio = consistent_lines(clock, start, spectrum)
    if not lines:
        return start
    bin_ratio = 1.0 / (max(line.frequency for line in lines) * spectrum.duration)
    near = spectrum.near(steady_tones(lines, ratio).frequency)
    r = spectrum.residual(steady_tones(lines, ratio), near)
    for _ in range(12):
        slope = (spectrum.residual(steady_tones(lines, ratio + 1e-4 * bin_ratio), near) - r) / (
            1e-4 * bin_ratio
        )
        move = float(
            np.clip(
                -(slope @ r) / max(float(slope @ slope), 1e-300), -0.2 * bin_ratio, 0.2 * bin_ratio
            )
        )
        r_new = spectrum.residual(steady_tones(lines, ratio + move), near)
        if r_new @ r_new > r @ r:
            break
        ratio, r = ratio + move, r_new
        if abs(move) < 1e-9 * bin_ratio:
            break
    return ratio


def _first_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Ratio by that peak in the bands of the first driving lines which makes most lines of the
    clock are detected.
    """
    searched = [line for line in clock if line.high > line.low]
    candidates = [line for line in clock if line.kind == "drive"][:3] or [
        line for line in searched if line.kind == "full step"
    ]
    if all(line.kind == "electrical" for line in clock):  # a stated step rate, and no scenario
        candidates = searched
    slack = 0.7 / spectrum.duration
    tried = []
    for line in candidates:
        for frequency, height in spectrum.peaks(line.low, line.high, _PEAKS):
            stands = height > DETECTION_RATIO * max(spectrum.floor(frequency), 1e-300)
            if stands and line.low - slack <= frequency <= line.high + slack:
                ratio = frequency / line.frequency
                tried.append((_comb_score(clock, ratio, line, spectrum), frequency * height, ratio))
    if tried:
        return max(tried)[2]
    return None


def _comb_score(
    clock: Sequence[ExpectedLine], ratio: float, told: ExpectedLine, spectrum: HannSpectrum
) -> float:
    """How well ``ratio`` explains the clock, as a line ``told`` it: the sum of what its lines
    score.
    """
    return round(sum(_scores(clock, ratio, told, spectrum, mains=True).values()), 6)


def _scores(
    clock: Sequence[ExpectedLine],
    ratio: float,
    told: ExpectedLine,
    spectrum: HannSpectrum,
    mains: bool = False,
) -> dict[str, float]:
    """Logarithm of each line's height over the detection limit at a ``ratio``; 0 where ``mains``
    may stand, unless they count.
    """
    found = {}
    for line in clock:
        at = line.frequency * ratio
        unsure = min(
            0.15 * line.frequency / told.frequency, 1.5
        )  # a peak gives its place to about a tenth of a bin
        height, floor = spectrum.height(at, unsure), max(spectrum.floor(at), 1e-300)
        counts = mains or not near_mains(at, spectrum.duration)
        if counts:
            found[line.name] = math.log(max(height / (DETECTION_RATIO * floor), 1.0))
        else:
            found[line.name] = 0.0
    return found


def consistent_lines(
    clock: Sequence[ExpectedLine],
    start: float,
    spectrum: HannSpectrum,
    most: int | None = MAX_CLOCK_LINES,
) -> tuple[list[ExpectedLine], float]:
    """The strongest lines that are detected and agree on the ratio, ``most`` of them or all, and the
    ratio from their peaks.
    """
    lines, offset, unsure, height = [], [], [], []
    for line in clock:
        at, size = spectrum.peak(line.frequency * start, line.frequency * start)
        floor = spectrum.floor(line.frequency * start)
        if size > DETECTION_RATIO * max(floor, 1e-300):
            lines.append(line)
            offset.append(at - line.frequency * start)
            unsure.append(floor / size)
            height.append(size)
    if not lines:
        return [], start
    f, d = np.array([line.frequency for line in lines]), np.array(offset)
    # median weighted by frequency, which is how sharply a line gives the ratio: a few false lines
    # cannot pull it
    order = np.argsort(d / f)
    weight = np.cumsum(f[order])
    shift = float((d / f)[order][np.searchsorted(weight, 0.5 * weight[-1])])
    agree = np.abs(d - shift * f) * spectrum.duration < _AGREEMENT_DISTANCE + np.array(unsure)
    strongest = sorted(np.flatnonzero(agree).tolist(), key=lambda i: -height[i])[:most]
    return [lines[i] for i in strongest], start + shift
