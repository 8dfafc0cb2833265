"""The clock ratio of a record: step clock found over step clock expected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.line_table import DETECTION
from microvib.signals.tones import HannSpectrum, steady

MAX_CLOCK_LINES = 12  # number of the strongest lines from which the clock ratio is estimated
_PEAKS = 6  # peaks tried in each band
_AGREE = 0.15
"""Distance [bins] of a noise-free line from where the others put it above which it is taken for another line."""


def estimate_clock_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Clock ratio that best explains all lines of the clock together; None if none of them stands out.

    Every peak in the bands of the first driving lines is tried; the one whose ratio makes most lines stand out gives the start.
    Lines that the others contradict are left out, since another line is in their place. Gauss-Newton on the joint fit follows,
    in which each line has the weight that its amplitude and frequency give it.
    """
    start = _first_ratio(clock, spectrum)
    if start is None:
        return None
    lines, ratio = agreeing(clock, start, spectrum)
    if not lines:
        return start
    bin_ratio = 1.0 / (max(line.frequency for line in lines) * spectrum.duration)
    near = spectrum.near(steady(lines, ratio).frequency)
    r = spectrum.residual(steady(lines, ratio), near)
    for _ in range(12):
        slope = (spectrum.residual(steady(lines, ratio + 1e-4 * bin_ratio), near) - r) / (1e-4 * bin_ratio)
        move = float(np.clip(-(slope @ r) / max(float(slope @ slope), 1e-300), -0.2 * bin_ratio, 0.2 * bin_ratio))
        r_new = spectrum.residual(steady(lines, ratio + move), near)
        if r_new @ r_new > r @ r:
            break
        ratio, r = ratio + move, r_new
        if abs(move) < 1e-9 * bin_ratio:
            break
    return ratio


def _first_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Ratio by that peak in the bands of the first driving lines which makes most lines of the clock stand out."""
    candidates = [line for line in clock if line.kind == "drive"][:3] or [
        line for line in clock if line.kind == "full step" and line.high > line.low
    ]
    slack = 0.7 / spectrum.duration
    tried = []
    for line in candidates:
        for frequency, height in spectrum.peaks(line.low, line.high, _PEAKS):
            stands = height > DETECTION * max(spectrum.floor(frequency), 1e-300)
            if stands and line.low - slack <= frequency <= line.high + slack:
                ratio = frequency / line.frequency
                tried.append((_evidence(clock, ratio, line, spectrum), frequency * height, ratio))
    return max(tried)[2] if tried else None


def _evidence(clock: Sequence[ExpectedLine], ratio: float, told: ExpectedLine, spectrum: HannSpectrum) -> float:
    """How well ``ratio`` explains the clock: sum over its lines of the logarithm of height there over detection limit."""
    total = 0.0
    for line in clock:
        unsure = min(0.15 * line.frequency / told.frequency, 1.5)  # a peak gives its place to about a tenth of a bin
        height = spectrum.height(line.frequency * ratio, unsure)
        floor = max(spectrum.floor(line.frequency * ratio), 1e-300)
        total += np.log(max(height / (DETECTION * floor), 1.0))
    return round(total, 6)


def agreeing(clock: Sequence[ExpectedLine], start: float, spectrum: HannSpectrum) -> tuple[list[ExpectedLine], float]:
    """The strongest lines that stand out and agree on the ratio, and the ratio from their peaks."""
    lines, offset, unsure, height = [], [], [], []
    for line in clock:
        at, size = spectrum.peak(line.frequency * start, line.frequency * start)
        floor = spectrum.floor(line.frequency * start)
        if size > DETECTION * max(floor, 1e-300):
            lines.append(line)
            offset.append(at - line.frequency * start)
            unsure.append(floor / size)
            height.append(size)
    if not lines:
        return [], start
    f, d = np.array([line.frequency for line in lines]), np.array(offset)
    # median weighted by frequency, which is how sharply a line gives the ratio: a few false lines cannot pull it
    order = np.argsort(d / f)
    weight = np.cumsum(f[order])
    shift = float((d / f)[order][np.searchsorted(weight, 0.5 * weight[-1])])
    agree = np.abs(d - shift * f) * spectrum.duration < _AGREE + np.array(unsure)
    strongest = sorted(np.flatnonzero(agree).tolist(), key=lambda i: -height[i])[:MAX_CLOCK_LINES]
    return [lines[i] for i in strongest], start + shift
