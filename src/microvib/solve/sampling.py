"""From the kernel's interval means to samples without aliasing.

The kernel gives every channel as its mean over intervals of 1/(m f_s), jumps included: that is a
boxcar filter, exact, with zeros at all multiples of the inner rate m f_s. A symmetric FIR filter
then takes the band of the record, corrects the boxcar's droop, and every m-th value is kept. Up to
0.35 f_s a tone keeps its amplitude within 1e-4 and its phase exactly. What would fold into that
band is 80 dB down, but for the neighbourhoods of the multiples of m f_s: there the boxcar alone
holds it back, by 20 log10(m / 0.35) dB or more. m is at least 4 and such that the inner rate is at
least a hundred times the driving frequency, where the torques have become small: of a jump of
height a, f_d times a second, an order k line has a / (pi k).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.decimate import filter_and_decimate
from microvib.solve.vector import whole_lanes

MIN_FACTOR = 4
MIN_INNER_RATE_RATIO = 100
"""Inner rate over driving frequency, at least."""
MAX_TARGET_INNER_RATE = 65_536.0
"""Inner rate [Hz] above which a high driving frequency no longer raises it."""
FILTER_HALF_LENGTH = 9
"""Half length of the filter in samples of the record."""
ERROR_WEIGHTS, TORQUE_ERROR_WEIGHTS = (0.5, 1.0), (0.1, 0.0)
"""Weights of the errors of rates and of currents inside steps: where channels are sampled, and
where nothing but the torque is, which is that of polynomials of degree 7."""
_BETA = 7.86  # Kaiser window, 80 dB


def inner_factor(sample_rate: float, driving_frequency: float) -> int:
    """Inner intervals per sample, m."""
    wanted = min(MIN_INNER_RATE_RATIO * driving_frequency, MAX_TARGET_INNER_RATE)
    return max(MIN_FACTOR, math.ceil(wanted / sample_rate))


def half_length(factor: int) -> int:
    """Inner intervals on each side of a sample that its filter takes."""
    return FILTER_HALF_LENGTH * factor


@dataclass(frozen=True)
class SampleIntervals:
    """The kernel's intervals from which the samples of a record are made."""

    factor: int
    """Intervals per sample."""
    width: float
    """Their width [s]."""
    first: float
    """Start of the first [s]."""
    missing: int
    """Intervals before the first that the filter takes, but that lie before the start of the
    motion.
    """
    rows: int

    @property
    def end(self) -> float:
        """End of the last interval [s]."""
        return self.first + self.rows * self.width


def max_driving_frequency(scenario: Scenario) -> float:
    """The highest driving frequency [Hz] at any time."""
    return scenario.highest_driving_frequency


def sample_intervals(scenario: Scenario, start: float = 0.0) -> SampleIntervals:
    """Intervals for the record of ``scenario``, as many before its first sample as there are since
    ``start`` [s].
    """
    record = scenario.record
    factor = inner_factor(record.sample_rate, max_driving_frequency(scenario))
    half, width = half_length(factor), 1.0 / (factor * record.sample_rate)
    lead = min(half, int((record.settle - start) / width))
    first = record.settle - (lead + 0.5) * width
    if first < start:
        lead, first = lead - 1, first + width
    return SampleIntervals(
        factor, width, first, half - lead, lead + 1 + (record.samples - 1) * factor + half
    )


def empty_sample_buffer(columns: int) -> Any:
    """Samples for a stretch in which nothing is recorded."""
    return sample_buffer(np.zeros((0, columns)), math.inf, 1.0)


def sample_buffer(
    rows: np.ndarray, first: float, width: float, mix: np.ndarray | None = None
) -> Any:
    """Samples that fill ``rows`` (n, columns) with means over intervals of ``width`` [s] from
    ``first`` [s] on.

    The first columns are sums of the channels by the weights ``mix`` (sums, channels); without it,
    all channels or, where there are two, the torque and the output's stick (``Packed.torque_of``).
    Propagators fill whole lanes (``Packed.columns``).
    """
    columns = rows.shape[1]
    if columns == 2 and mix is None:
        shown = TORQUE_ERROR_WEIGHTS
    else:
        shown = ERROR_WEIGHTS
    cursor, mix = np.zeros(2, dtype=np.int64), np.zeros((0, 0)) if mix is None else mix
    return kernel.Samples(first, width, rows, np.zeros(columns), cursor, mix, *shown)


def step_buffer(rows: np.ndarray) -> Any:
    """Samples that fill ``rows`` (n, ``kernel.STEP_COLUMNS``) with the steps themselves, from which
    they can be taken again (``microvib.solve.replay``). What does not fit is not recorded.
    """
    cursor = np.zeros(2, dtype=np.int64)
    return kernel.Samples(
        math.inf, 0.0, rows, np.zeros(0), cursor, np.zeros((0, 0)), *TORQUE_ERROR_WEIGHTS
    )


@lru_cache(maxsize=8)
def decimation_filter(factor: int) -> np.ndarray:
    """Linear-phase low-pass at f_s/2 with the inverse of the boxcar's response in its passband, by
    frequency sampling.
    """
    grid, half = 1024 * factor, half_length(factor)
    f = np.arange(grid // 2 + 1) / grid  # in cycles per inner interval
    response = np.where(f <= 0.5 / factor, 1.0 / np.sinc(f), 0.0)
    kernel = np.roll(np.fft.irfft(response, grid), half)[: 2 * half + 1]
    shaped = kernel * np.kaiser(2 * half + 1, _BETA)
    normalised: np.ndarray = shaped / shaped.sum()
    normalised.flags.writeable = False
    return normalised


class Decimator:
    """Streaming filter over rows (time, channel); keeps what the next block needs."""

    def __init__(self, factor: int = MIN_FACTOR) -> None:
        self._factor = factor
        self._taps = decimation_filter(factor)
        self._rows, self._left, self._filled = np.zeros((0, 0)), 0, 0

    def room(self, count: int, channels: int) -> np.ndarray:
        """Memory for the next ``count`` rows, as wide as ``channels`` need in whole lanes;
        ``filtered`` takes what is in it.
        """
        self._filled = self._left + count
        if (
            len(self._rows) < self._filled
        ):  # kept: fresh memory for each block would cost as much as filtering it
            left, self._rows = (
                self._rows[: self._left],
                np.zeros((self._filled, whole_lanes(channels))),
            )
            self._rows[: self._left, : left.shape[1]] = left
        return self._rows[self._left : self._filled]

    def filtered(self) -> np.ndarray:
        """Samples that the rows in that memory complete; the first belongs to input row
        ``half_length(factor)``.
        """
        here = self._rows[: self._filled]
        out = np.empty((max((len(here) - self._taps.size) // self._factor + 1, 0), here.shape[1]))
        # Compiled, not a matrix product: threads of BLAS collapse where other processes keep the
        # cores busy.
        filter_and_decimate(here, self._taps, self._factor, out)
        left = here[len(out) * self._factor :].copy()
        self._left = len(left)
        self._rows[: self._left] = left
        return out

    def push(self, rows: np.ndarray) -> np.ndarray:
        """Samples that ``rows`` (n, channels) complete."""
        self.room(*rows.shape)[:, : rows.shape[1]] = rows
        return self.filtered()[:, : rows.shape[1]]

    def end(self) -> np.ndarray:
        """Samples that are completed if the last row goes on."""
        last = self._rows[self._left - 1 : self._left]
        return self.push(np.repeat(last, 2 * half_length(self._factor) + self._factor, axis=0))
