"""The clock ratio of a record: step clock found over step clock expected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.line_table import DETECTION
from microvib.signals.tones import HannSpectrum, steady

MAX_CLOCK_LINES = 12
"""Lines, the strongest, that the clock ratio is estimated from."""
_PEAKS = 6
"""Peaks of a band that may be the line that is looked for there."""
_AGREE = 0.15
"""Bins that a line without noise may be off the place where the others put it, before it counts as another."""


def estimate_clock_ratio(clock: Sequence[ExpectedLine], spectrum: HannSpectrum) -> float | None:
    """Clock ratio that explains the lines of the clock best, all together; None where none of them stands out.

    Every peak in the bands of the first driving lines is tried; the one whose ratio has most lines stand out gives the start.
    Lines that the others contradict are left out, for another line stands in their place. Then Gauss-Newton on the joint fit,
    which weights each line with what it tells.
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
    """Ratio of the peak, in the bands of the first driving lines, whose ratio has most lines of the clock stand out."""
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
    """Sum over the lines of the clock of the logarithm of how far each stands out where ``ratio`` puts it."""
    total = 0.0
    for line in clock:
        unsure = min(0.15 * line.frequency / told.frequency, 1.5)  # a peak tells its place to some tenth of a bin
        height = spectrum.height(line.frequency * ratio, unsure)
        floor = max(spectrum.floor(line.frequency * ratio), 1e-300)
        total += np.log(max(height / (DETECTION * floor), 1.0))
    return round(total, 6)


def agreeing(clock: Sequence[ExpectedLine], start: float, spectrum: HannSpectrum) -> tuple[list[ExpectedLine], float]:
    """The strongest lines that stand out and agree about the ratio, and the ratio that they tell by their peaks."""
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
    # a line tells the ratio by its frequency; by their median no few can draw the others with them
    order = np.argsort(d / f)
    weight = np.cumsum(f[order])
    shift = float((d / f)[order][np.searchsorted(weight, 0.5 * weight[-1])])
    agree = np.abs(d - shift * f) * spectrum.duration < _AGREE + np.array(unsure)
    strongest = sorted(np.flatnonzero(agree).tolist(), key=lambda i: -height[i])[:MAX_CLOCK_LINES]
    return [lines[i] for i in strongest], start + shift
