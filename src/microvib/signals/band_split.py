"""Time histories in bands of frequency, by zero-phase filters whose roll-off is stated, and what another
filter might have made of their peaks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.signals.band_ends import loudness_of_ends

REJECTION = 60.0
"""Decibels by which a filter rejects what is beyond its roll-off."""
LEAK = 10.0 ** (-REJECTION / 20.0)
"""Part of the largest value of a record that may come through all the same."""
_MARGIN = 16
"""Samples at both ends beside those that are looked at; interpolation takes ten."""
_FINE = 16.0
"""Samples per cycle of the highest frequency from which a peak is taken."""
WIDEST = 0.2
"""Roll-off, over the frequency of the edge, where the band is wide enough for it."""


@dataclass(frozen=True)
class BandHistory:
    """A band's time history, and bounds over filters of the same roll-off; m samples."""

    first: int
    """Sample of the record at which it begins: what is before is the filter's transient."""
    values: np.ndarray
    """(m,), in the unit of the record."""
    inner: np.ndarray
    """The part that every such filter passes unchanged, (m,)."""
    edges: np.ndarray
    """Envelope of what is on the slopes of the edges, of which a filter passes any part, (m,)."""
    leak: float
    """Size of what may come through from beyond the edges."""
    top: float
    """Highest frequency in it over the sample rate."""
    longer: tuple[np.ndarray, np.ndarray]
    """Values and inner part with ``margin`` samples more at both ends, which values between samples
    are interpolated from, (m + 2 margin,) each."""
    margin: int
    ends: float
    """RMS in the band of the loudest piece of the record's ends, which are the filter's transients, over
    that of the loudest piece, as long, of what lies between them; at least 1."""

    @property
    def peak(self) -> float:
        """Largest magnitude, between samples too."""
        return self._peak

    @cached_property
    def _peak(self) -> float:
        return float(np.max(np.abs(_finer(self.longer[0], self.top, self.margin))))

    @property
    def place(self) -> int:
        """Sample of the record that is nearest to the largest magnitude."""
        return self.first + int(np.argmax(np.abs(self.values)))

    @property
    def largest(self) -> float:
        """Peak that no filter of this roll-off exceeds; never below that of the one that was taken."""
        inner, edges = self._fine
        step = self.top * self.edges.size / inner.size
        bound = float(np.max(inner + edges)) / math.cos(math.pi * step) + self.leak
        return max(bound, self.peak)

    @property
    def least(self) -> float:
        """Peak that each filter of this roll-off reaches; never above that of the one that was taken."""
        inner, edges = self._fine
        return min(max(float(np.max(inner - edges)) - self.leak, 0.0), self.peak)

    @cached_property
    def _fine(self) -> tuple[np.ndarray, np.ndarray]:
        """Magnitudes of the inner part between samples too, and the envelope of the edges there."""
        inner = np.abs(_finer(self.longer[1], self.top, self.margin))
        return inner, np.repeat(_neighbourhood(self.edges), inner.size // self.edges.size)


def roll_off_for(low: float, high: float) -> float:
    """Roll-off, over the frequency of the edge, that leaves half of a band of [Hz] unchanged."""
    return min(WIDEST, 0.5 * (high - low) / (high + low))


def filter_reach(low: float, high: float, roll_off: float) -> float:
    """Time [s] before and behind a sample that a band's filter looks at."""
    edge = low if low > 0.0 else high
    return 0.5 * _length(roll_off * edge)


def _length(half_width: float) -> float:
    """Length [s] of a low-pass that falls from 1 to 0 within ``half_width`` [Hz] of its edge (Kaiser)."""
    return (REJECTION - 7.95) / (2.285 * 2.0 * math.pi * 2.0 * half_width)


def split_band(
    x: np.ndarray, rate: float, low: float, high: float, roll_off: float
) -> BandHistory | None:
    """The band from ``low`` to ``high`` [Hz] of the mean-free ``x`` (n,), without the filter's transients.

    Half of an amplitude passes at the edges, all from ``roll_off`` times the edge inside them, and
    nothing but -60 dB from as much outside. None where the filter is longer than the record.
    """
    reach = math.ceil(filter_reach(low, high, roll_off) * rate)
    if 2 * reach >= x.size - 2:
        return None
    kept = slice(reach, x.size - reach)

    def nominal(values: np.ndarray) -> np.ndarray:
        passed = _low_pass(values, rate, high, roll_off * high)
        if low > 0.0:
            passed = passed - _low_pass(values, rate, low, roll_off * low)
        return passed

    y = nominal(x)
    on_slopes, envelope = np.zeros(x.size), np.zeros(x.size)
    tapered = _with_soft_ends(x, reach)
    for edge in (low, high):
        if edge > 0.0:
            slope = _slope(tapered, rate, edge, roll_off)
            on_slopes += slope
            envelope += _envelope(slope)
    inner = y - nominal(on_slopes)
    top = min(high * (1.0 + roll_off) / rate, 0.5)
    leak = LEAK * float(np.max(np.abs(x)))
    margin = min(reach, _MARGIN)
    longer = slice(reach - margin, x.size - reach + margin)
    return BandHistory(
        reach, y[kept], inner[kept], envelope[kept], leak, top, (y[longer], inner[longer]), margin,
        loudness_of_ends(x, rate, (low, high), y[kept], nominal),
    )  # fmt: skip


def _with_soft_ends(x: np.ndarray, reach: int) -> np.ndarray:
    """Samples that come up from zero and go back to it within the first and last ``reach``, which are
    left out: the ends of a record would be heard at all frequencies.
    """
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(reach) / max(reach, 1))
    return np.asarray(x * np.concatenate([rise, np.ones(x.size - 2 * reach), rise[::-1]]))


def _slope(x: np.ndarray, rate: float, edge: float, roll_off: float) -> np.ndarray:
    """The part of ``x`` within ``roll_off`` of an edge, all of it, and of what is up to half as far
    beyond some.
    """
    half = 0.25 * roll_off * edge
    upper = min(edge * (1.0 + 1.25 * roll_off), 0.499 * rate)
    return _low_pass(x, rate, upper, half) - _low_pass(x, rate, edge * (1 - 1.25 * roll_off), half)


def _low_pass(x: np.ndarray, rate: float, edge: float, half_width: float) -> np.ndarray:
    """Zero-phase FIR low-pass, 6 dB down at ``edge`` [Hz]; beyond the record there is nothing."""
    from scipy.signal import firwin, kaiser_beta, oaconvolve

    if edge + half_width >= 0.5 * rate:
        return x
    taps = 2 * math.ceil(0.5 * _length(half_width) * rate) + 1
    h = firwin(taps, edge, window=("kaiser", kaiser_beta(REJECTION)), fs=rate)
    return np.asarray(oaconvolve(x, h, mode="full")[taps // 2 : taps // 2 + x.size])


def _envelope(x: np.ndarray) -> np.ndarray:
    """Magnitude of the analytic signal, (n,)."""
    from scipy.fft import next_fast_len
    from scipy.signal import hilbert

    return np.asarray(np.abs(hilbert(x, next_fast_len(x.size, real=False))[: x.size]))


def _finer(x: np.ndarray, top: float, margin: int) -> np.ndarray:
    """Samples as dense as peaks are read from, whose highest frequency is ``top`` sample rates, without
    ``margin`` samples at both ends, where interpolation lacks neighbours.
    """
    from scipy.signal import resample_poly

    factor = math.ceil(_FINE * top)
    if factor <= 1:
        return x[margin : x.size - margin]
    dense = resample_poly(x, factor, 1, window=("kaiser", 8.0))
    return np.asarray(dense[margin * factor : dense.size - margin * factor])


def _neighbourhood(x: np.ndarray) -> np.ndarray:
    """The larger of each sample and the next one, (n,)."""
    return np.maximum(x, np.concatenate([x[1:], x[-1:]]))
