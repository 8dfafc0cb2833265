"""Clipping of a channel, by the distribution of its samples at its extremes.

An amplifier that saturates holds its output at one level, and the converter behind it adds noise, so that
samples there need not be equal. What tells them from a smooth signal's crests is their distribution: a
spike at the level, and no crest beside it. A crest of the form \\|t\\|^m has as many samples within the
distance d of its level as d^(1/m), and so many close to it and many a little farther; a rounded corner, as
of a square wave behind a low-pass, approaches its level exponentially and has as many samples in each
octave of d; an ideal step has none. A signal that is cut off passes the level at its own speed: twice as
many in each octave as in the one before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_WIDTHS = 2.0 ** (-0.5 * np.arange(8, 28))
"""Widths of a plateau over the signal's range, from 1/16 down."""
_ADJACENT = 3
"""Widths in a row with which a plateau must be told: one alone may fall between samples that repeat with
every period.
"""
_SPIKE = 5.0
"""Samples on a plateau over those within a width beyond it. A parabolic crest has 3.4 times as many."""
_LAST_OCTAVE = 0.45, 0.75
"""Part of the last of three octaves of distance in their samples: 4/7 where a signal passes at its own speed;
0.42 at most beside crests that are flat enough to be spikes (m of 4 and more), 1/3 beside rounded corners.
"""
_RISE = 1.2
"""How many times as many samples as an octave the one before it may have: chance, where it should have half."""
_LEAST_FLANK, _LEAST_RUN = 5, 1.5
"""Samples in the nearest octave below which nothing is told, and mean number of samples in a row on a plateau."""
_MOST_BEYOND = 0.1
"""Samples beyond a plateau over those on it: what a filter overshoots."""
_REST = 0.1
"""Level over the largest sample's size up to which a plateau is the rest between pulses of one sign."""
_EXACT_RUN, _EXACT_RUNS, _NEXT_STEPS, _OF_STEPS = 3, 2, 3, 3.0
"""Equal samples in a row at an extreme, and runs of them, by which clipping is told; of how many of the
converter's next steps these samples must be how many times as many: the crests of a coarsely quantised signal
have at most as many.
"""
_STEP_RESOLUTION = 1e-9
"""Part of the range up to which samples are equal but for rounding."""


@dataclass(frozen=True)
class Plateau:
    """A level at which a channel is cut off."""

    side: str
    """Which of its values it is, ``largest`` or ``smallest``."""
    level: float
    """The level, in the channel's unit."""
    share: float
    """Part of the samples that is there."""

    def in_words(self, unit: str = "") -> str:
        """The part of the samples, the level with its ``unit``, and the side."""
        level = f"{self.level:.4g} {unit}".rstrip()
        return f"{100.0 * self.share:.3g} % of its samples lie at its {self.side} value, {level}"


def find_plateaus(x: np.ndarray) -> tuple[Plateau, ...]:
    """Levels at which a channel is cut off.

    Parameters
    ----------
    x : numpy.ndarray
        Samples, (n,), finite.

    Returns
    -------
    tuple of Plateau
        The one at its largest values, the one at its smallest, or both; empty where there is none.
    """
    ordered = np.sort(x)
    if x.size < _EXACT_RUN or ordered[0] == ordered[-1]:
        return ()
    sides = (("largest", 1.0, ordered), ("smallest", -1.0, -ordered[::-1]))
    runs = [_exact_runs(sign * x, up) for _, sign, up in sides]
    several = sum(runs) >= _EXACT_RUNS
    found = []
    for (side, sign, up), exact in zip(sides, runs, strict=True):
        if several and exact:
            level, half_width = float(up[-1]), 0.0
        else:
            level, half_width = _spike(sign * x, up)
        if math.isfinite(level):
            share = float(np.mean(np.abs(sign * x - level) <= half_width))
            found.append(Plateau(side, sign * level, share))
    return tuple(found)


def run_lengths(flags: np.ndarray) -> np.ndarray:
    """Lengths of the runs of true ones in ``flags`` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.view(np.int8), [0]])))
    return edges[1::2] - edges[::2]


def _exact_runs(x: np.ndarray, ordered: np.ndarray) -> int:
    """Number of runs of equal samples at the largest value of ``x`` (n,); 0 where the converter's steps may
    have made them of a crest.
    """
    top = ordered[-1]
    runs = int(np.count_nonzero(run_lengths(x == top) >= _EXACT_RUN))
    if runs == 0:
        return 0
    steps = np.diff(ordered)
    step = float(np.min(steps[steps > _STEP_RESOLUTION * (top - ordered[0])]))
    at, beside = _numbers_above(ordered, top - np.array([0.5, _NEXT_STEPS + 0.5]) * step)
    return runs if at > _OF_STEPS * (beside - at) else 0


def _spike(x: np.ndarray, ordered: np.ndarray) -> tuple[float, float]:
    """Level at which samples ``x`` (n,), ``ordered`` besides, are cut off above, and how far those that are lie
    from it; nan where they are not.
    """
    beyond = max(int(1e-4 * x.size), 1)
    inner = max(int(1e-3 * x.size), 1)
    high = float(ordered[-beyond])
    span = high - float(ordered[inner - 1])
    narrowest, told = (math.nan, math.nan), 0
    for width in _WIDTHS * span:
        level = _densest(ordered, high, 0.25 * span, width)
        told = told + 1 if _is_cut_off(x, ordered, level, width) else 0
        if told >= _ADJACENT:
            narrowest = float(np.median(x[np.abs(x - level) <= width])), float(width)
    return narrowest


def _densest(ordered: np.ndarray, high: float, reach: float, width: float) -> float:
    """Middle of the ``width`` in which most samples are, within ``reach`` below ``high``."""
    lower = high - reach + np.arange(0.0, reach + width, 0.25 * width)
    inside = np.searchsorted(ordered, lower + width, "right") - np.searchsorted(ordered, lower)
    return float(lower[np.argmax(inside)] + 0.5 * width)


def _is_cut_off(x: np.ndarray, ordered: np.ndarray, level: float, width: float) -> bool:
    """Whether samples ``x`` (n,), ``ordered`` besides, are cut off at a ``level``, to a ``width``."""
    if abs(level) <= _REST * max(-ordered[0], ordered[-1]):
        return False
    bounds = level + width * np.array([1.0, -1.0, -2.0, -4.0, -8.0])
    beyond, *within = _numbers_above(ordered, bounds).tolist()
    near, middle, far = np.diff(within).tolist()
    there, flank = within[0], near + middle + far
    if near < _LEAST_FLANK or there < _SPIKE * near or beyond > _MOST_BEYOND * there:
        return False
    steadily = near <= _RISE * middle and middle <= _RISE * far
    if not steadily or not _LAST_OCTAVE[0] <= far / flank <= _LAST_OCTAVE[1]:
        return False
    return float(np.mean(run_lengths(x >= level - width))) >= _LEAST_RUN


def _numbers_above(ordered: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Numbers of the samples from each of the ``bounds`` up."""
    return ordered.size - np.searchsorted(ordered, bounds)
