"""Smallest and largest samples of groups of groups: any window of a long record for a screen at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

GROUP = 8
"""Samples, or groups, of a group."""
_PARTS = 4
"""Groups of a pixel, at least, so that its ends are off by less than a quarter of it."""
_COARSEST = 64
"""Groups below which no coarser level is made."""


@dataclass(frozen=True)
class Curve:
    """A window of a record for a screen; m points."""

    time: np.ndarray
    """Seconds, (m,): of samples, or the first of each group of them."""
    low: np.ndarray
    """Smallest sample of each group, (m,); where all samples fit they are these."""
    high: np.ndarray
    """Largest sample of each group, (m,)."""

    @property
    def of_samples(self) -> bool:
        """Whether every point is a sample."""
        return self.low is self.high


@dataclass(frozen=True)
class Pyramid:
    """Samples of a channel, and the smallest and largest of groups of 8, 64, 512 ... of them."""

    samples: np.ndarray
    """(n,)."""
    rate: float
    """Samples per second [Hz]."""
    levels: tuple[tuple[np.ndarray, np.ndarray], ...]
    """Smallest and largest of each group, the finest groups first; nan are passed over."""

    @classmethod
    def of(cls, samples: np.ndarray, rate: float) -> Pyramid:
        """The pyramid of ``samples`` (n,)."""
        low, high, levels = samples, samples, []
        while low.size > GROUP * _COARSEST:
            low, high = _grouped(low, np.fmin), _grouped(high, np.fmax)
            levels.append((low, high))
        return cls(samples, rate, tuple(levels))

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.samples.size / self.rate

    def window(self, t0: float, t1: float, pixels: int) -> Curve:
        """The record from ``t0`` to ``t1`` [s] in at most ``pixels`` groups, none of whose samples is lost.

        Where the window has at most two samples to a pixel they are given as they are. Parts outside
        the record are left out; the first and last group may reach beyond the window by less than a
        quarter of a pixel.
        """
        first = int(np.clip(np.floor(t0 * self.rate), 0, max(self.samples.size - 1, 0)))
        last = int(np.clip(np.ceil(t1 * self.rate) + 1, first, self.samples.size))
        pixels = max(int(pixels), 1)
        count = last - first
        if count <= 2 * pixels:
            x = np.asarray(self.samples[first:last])
            return Curve(np.arange(first, last) / self.rate, x, x)
        size, (low, high) = 1, (self.samples, self.samples)
        for k, level in enumerate(self.levels, 1):
            if count < _PARTS * pixels * GROUP**k:
                break
            size, (low, high) = GROUP**k, level
        begin, end = first // size, -(-last // size)
        starts = begin + np.arange(pixels) * (end - begin) // pixels
        own = starts - begin
        lowest = np.fmin.reduceat(np.asarray(low[begin:end]), own)
        highest = np.fmax.reduceat(np.asarray(high[begin:end]), own)
        return Curve(starts * size / self.rate, lowest, highest)


def _grouped(x: np.ndarray, of: np.ufunc) -> np.ndarray:
    """Smallest or largest of each group of neighbours, the last one perhaps smaller."""
    whole = x.size // GROUP * GROUP
    found = of.reduce(x[:whole].reshape(-1, GROUP), axis=1)
    if whole < x.size:
        found = np.append(found, of.reduce(x[whole:]))
    return np.asarray(found)


def level_sizes(samples: int) -> Sequence[int]:
    """Groups of each level of a pyramid over so many samples."""
    sizes: list[int] = []
    size = samples
    while size > GROUP * _COARSEST:
        size = -(-size // GROUP)
        sizes.append(size)
    return sizes
