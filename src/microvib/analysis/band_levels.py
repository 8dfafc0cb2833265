"""Largest line and RMS of the lines in a band, with what they may be: by these two designs are compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from microvib.analysis.margins import amplitude_bound, amplitude_error_bound
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.line_table import Line, LineTable


@dataclass(frozen=True)
class Level:
    """A level of a torque [N m], and between what it may be."""

    line: str
    """The line whose level it is; empty of several."""
    value: float
    least: float
    most: float


@dataclass(frozen=True)
class BandLevels:
    """Levels of the lines in a band."""

    largest: Level
    """The largest line, 0-to-peak."""
    rms: Level
    """Root of the mean square of all lines."""


def band_levels(table: LineTable, low: float, high: float) -> BandLevels:
    """Find the largest line and the RMS of the lines between two frequencies.

    A line may be off by its uncertainty and the integration's error (``amplitude_error_bound``); one that
    decays or grows may be absent later, or as large as at the start; one without an amplitude may be
    as large as ``amplitude_bound`` says. Modes that a steady state does not have are left out.

    Parameters
    ----------
    table : LineTable
        Lines of one channel.
    low, high : float
        The band [Hz].

    Returns
    -------
    BandLevels
        Levels [N m], 0 where there is no line.
    """
    lines = [x for x in table if low <= x.place <= high and x.status != TRANSIENT]
    each = [_level(line, table) for line in lines]
    largest = max((x for x in each if x.value > 0.0), key=lambda x: x.value, default=None)
    return BandLevels(
        Level(
            "" if largest is None else largest.line,
            *(_over(max, each, end) for end in ("value", "least", "most")),
        ),
        Level("", *(_over(_rms, each, end) for end in ("value", "least", "most"))),
    )


def _level(line: Line, table: LineTable) -> Level:
    if not (line.seen and math.isfinite(line.amplitude)):
        return Level(line.name, 0.0, 0.0, amplitude_bound(line))
    off = amplitude_error_bound(line, table)
    if line.status in ("decaying", "growing"):
        start = max(line.amplitude, line.amplitude_at_start(table.duration))
        return Level(line.name, line.amplitude, 0.0, start + off)
    return Level(line.name, line.amplitude, max(line.amplitude - off, 0.0), line.amplitude + off)


def _over(combine: Callable[[Sequence[float]], float], each: Sequence[Level], end: str) -> float:
    return combine([0.0, *(getattr(x, end) for x in each)])


def _rms(amplitudes: Sequence[float]) -> float:
    return math.sqrt(math.fsum(0.5 * x**2 for x in amplitudes))
