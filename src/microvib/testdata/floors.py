"""Noise floors of channels before and after they were mixed: in octaves, so that noise that fills a part of the
band is not missed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from microvib.model.rigid import COMPONENTS

MAX_FLOOR_RATIO = 1.1
"""Floor after torques were moved or cross-talk was taken out, over that before, from which it is
told."""
LONGEST_FLOOR = 2**20
"""Samples of which a floor is computed."""
_FIRST_BIN = 3
"""First bin that the mean does not reach."""
_FEWEST_BINS = 32
"""Bins of an octave, from which its median tells a floor."""
_FAR_MORE = 1.5
"""Times the rise of the whole record's floor, from which the octave where it rises most is told."""

_AS_MUCH = 0.9
"""Part of the largest rise from which a higher octave, of more bins, is told in its place."""


class Floor(NamedTuple):
    """Floor of a channel: roots of median spectral densities, [unit/Hz^0.5]."""

    whole: float
    """Floor of all bins."""
    edges: np.ndarray
    """Ends [Hz] of the octaves, (k + 1,)."""
    octaves: np.ndarray
    """Floor of each octave, (k,)."""

    @property
    def rms(self) -> float:
        """RMS of noise with the floors of the octaves."""
        return math.sqrt(float(np.sum(self.octaves**2 * np.diff(self.edges))))


def floor_of(x: np.ndarray, rate: float) -> Floor | None:
    """Floor of a channel ``x`` (n,) at ``rate`` [Hz], that of noise where lines are few; None if not known.

    The median of a density is ln 2 times its mean.
    """
    x = x[:LONGEST_FLOOR]
    if x.size < 64 or not np.all(np.isfinite(x)):
        return None
    w = np.hanning(x.size)
    power = np.abs(np.fft.rfft((x - x.mean()) * w)) ** 2
    scale = 2.0 / (math.log(2.0) * rate * float(w @ w))
    bins = _octaves(power.size)
    medians = [float(np.median(power[a:b])) for a, b in pairwise(bins)]
    whole = math.sqrt(scale * float(np.median(power[_FIRST_BIN:])))
    return Floor(whole, np.array(bins) * rate / x.size, np.sqrt(scale * np.array(medians)))


def _octaves(size: int) -> list[int]:
    """First bins of octaves up to ``size``, from the highest down; the lowest takes what is left."""
    bins = [size]
    while bins[0] // 2 - _FIRST_BIN > _FEWEST_BINS:
        bins.insert(0, bins[0] // 2)
    return [_FIRST_BIN, *bins]


def raised_floors(before: np.ndarray, after: np.ndarray, rate: float) -> Iterator[str]:
    """Clauses on the components whose noise floor is higher after than before, (6, n) each, and what
    follows.
    """
    raised = False
    for name, x, y in zip(COMPONENTS, before, after, strict=True):
        low, high = floor_of(x, rate), floor_of(y, rate)
        if low is not None and high is not None:
            clause = _rise(name, low, high)
            if clause:
                raised = True
                yield clause
    if raised:
        yield "what was below the new floor can no longer be seen"


def _rise(name: str, low: Floor, high: Floor) -> str:
    """A clause where a channel's floor rises, in the whole record or in an octave of it; empty where
    it does not.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(high.octaves / low.octaves, nan=1.0, posinf=1.0)
    k, whole = int(np.flatnonzero(ratios >= _AS_MUCH * np.max(ratios))[-1]), 1.0
    if low.whole > 0.0:
        whole = high.whole / low.whole
    if max(whole, float(ratios[k])) <= MAX_FLOOR_RATIO:
        return ""
    unit = "N" if name.startswith("F") else "N*m"
    place, a, b = "", low.whole, high.whole
    if ratios[k] > _FAR_MORE * whole:
        place = f" at {high.edges[k]:.3g} to {high.edges[k + 1]:.3g} Hz"
        a, b = float(low.octaves[k]), float(high.octaves[k])
    return (
        f"it raises the floor of {name} from {a:.3g} to {b:.3g} {unit}/Hz^0.5{place}, {b / a:.3g}"
        f" times, by the noise of the other channels (RMS of the whole floor {low.rms:.3g} to"
        f" {high.rms:.3g} {unit})"
    )
