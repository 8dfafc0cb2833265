"""Lines that a record has for a part of its time only, as the drive changes within it.

The amplitude of a line is that over the whole record. Where a drive slips otherwise over a part of a
slow cycle, what it makes there counts in that for a small part, or is parted into many lines; here
the spectrum of each piece of a record is looked at, and what is larger in one than on average is
told. Of a motion that repeats the pieces are those of its period, which is known exactly, and what is
larger in one than the lines about it is told.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from microvib.model.record import PASSBAND
from microvib.signals.line_table import Line
from microvib.signals.unaccounted import samples_of_lines

_PIECES_OF_CYCLE = 4.0
"""Pieces into which the longest cycle is parted first; each further time into twice as many."""
_HALVINGS = 6
_SHIFTS = 4
"""Pieces that begin within the length of one."""
_FIRST_BIN = 4
"""First bin of a piece that its mean does not reach."""
_FINER = 2
"""Bins that are computed for one of a piece: a tone between two of them is at most 4 % larger."""
LOUDER = 1.3
"""Times its RMS over all pieces that something has in one where it is louder than on average."""
LOUDER_THAN_LINES = 1.02
"""Times the largest line about it that a bin must have in a piece to count."""
_REACH = 2
"""Bins of a piece on either side within which a line is about it."""
_NEAR_LINE = 1.0
"""Bins of a piece within which a line of a comb counts, half of what lies between two of them at
least."""
_SAMPLES_OF_ORDER = 2.5
"""Samples of a period for each order of its series."""
_NEGLIGIBLE_PEAK = 1e-4
"""Part of the largest line that a bin must have to count."""
_OVER_NOISE = 6.0
"""Times the floor that a bin of a piece must have where noise makes one."""


def intermittent_peaks(  # noqa: PLR0913 - keyword options
    x: np.ndarray,
    sample_rate: float,
    lines: Iterable[Line],
    cycle: float,
    shortest: float,
    *,
    noise: tuple[np.ndarray, np.ndarray] | None = None,
    louder: float = LOUDER,
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and amplitudes of what is louder in a piece of a record than on average, with the
    lines that are there at all times, which it may be a swelling of.

    Parameters
    ----------
    x : ndarray
        Samples (n,), in the unit of the lines.
    sample_rate : float
        [Hz].
    lines : iterable of Line
        Lines that are there at all times, which are subtracted first.
    cycle : float
        Time [s] after which the drive is as before.
    shortest : float
        Time [s] below which pieces do not tell the drive's own lines apart.
    noise : tuple of ndarray, optional
        Frequencies (m,) [Hz] and amplitudes (m,) that noise makes in bins of the whole record.
    louder : float
        Times its RMS over all pieces that a bin without a line about it must have in one to count: what
        is steady has it once.
    """
    duration = x.size / sample_rate
    known = [line for line in lines if math.isfinite(line.amplitude)]
    steady = [line for line in known if line.decay == 0.0]
    x = x - x.mean()
    x = x - samples_of_lines(known, x.size, sample_rate)
    turns = np.array([line.frequency for line in steady]) / sample_rate
    tones = np.array([cmath.rect(line.amplitude, line.phase) for line in steady])
    frequency, amplitude = [np.zeros(0)], [np.zeros(0)]
    for each in _lengths(cycle, shortest, duration):
        size = round(each * sample_rate)
        length = size / sample_rate
        added = _LinesOfPieces.of_tones(turns, tones, size)
        largest, mean, with_lines = _bins_of_pieces(x, size, added)
        at = np.arange(largest.size) / (_FINER * length)
        about = _largest_about(_sizes_of(tones, turns, size), _FINER * _REACH)
        counts = np.where(
            about > 0.0, with_lines > LOUDER_THAN_LINES * about, largest > louder * mean
        )
        if noise is not None:
            counts &= largest > _OVER_NOISE * math.sqrt(duration / length) * np.interp(at, *noise)
        counts &= (at >= _FIRST_BIN / length) & (at <= PASSBAND * sample_rate)
        frequency.append(at[counts])
        amplitude.append(with_lines[counts])
    return np.concatenate(frequency), np.concatenate(amplitude)


def peaks_of_period(
    series: np.ndarray, base: float, comb: int, shortest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and amplitudes of what a motion that repeats has in a piece of its period, and is
    larger than the lines of its Fourier series about it.

    To the lines that change slowly each bin adds the line of the comb that is there, with its phase.

    Parameters
    ----------
    series : ndarray
        Complex amplitudes (n,) at k ``base``, k = 0, 1, ...
    base : float
        Frequency of its period [Hz].
    comb : int
        Multiples of this order are lines that the motion would have without what changes slowly.
    shortest : float
        Time [s] below which pieces do not tell these lines apart: two periods of the first of them.
    """
    sizes = np.abs(series)
    sizes[0] = 0.0
    least = _NEGLIGIBLE_PEAK * float(sizes.max(initial=0.0))
    beside = series.copy()
    beside[::comb] = 0.0
    size = _even_above(_SAMPLES_OF_ORDER * series.size)
    x = np.fft.irfft(0.5 * size * np.pad(beside, (0, size // 2 + 1 - series.size)), size)
    frequency, amplitude = [np.zeros(0)], [np.zeros(0)]
    for each in _lengths(1.0 / base, shortest, math.inf):
        length = round(each * base * size)
        lines = _LinesOfPieces.of(series, comb, size, length)
        largest = _largest_of_pieces(x, length, lines)
        orders = np.arange(largest.size) * size / (_FINER * length)
        about = _largest_about(sizes, math.ceil(_REACH * size / length))
        known = about[np.minimum(np.round(orders).astype(int), sizes.size - 1)]
        counts = (largest > LOUDER_THAN_LINES * known) & (largest > least)
        counts &= (orders >= _FIRST_BIN * size / length) & (orders < sizes.size)
        frequency.append(orders[counts] * base)
        amplitude.append(largest[counts])
    return np.concatenate(frequency), np.concatenate(amplitude)


class _LinesOfPieces(NamedTuple):
    """Lines at multiples of an order in the bins of pieces that are nearest to them, (m,) each."""

    bins: np.ndarray
    values: np.ndarray
    """Contribution of each to its bin of the first piece."""
    turns: np.ndarray
    """By how much its phase turns with each sample [rad]."""

    @classmethod
    def of(cls, series: np.ndarray, comb: int, size: int, length: int) -> _LinesOfPieces:
        """Make the lines of a period of ``size`` samples, in pieces of ``length``."""
        orders = np.arange(comb, series.size, comb)
        return cls.of_tones(orders / size, series[orders], length)

    @classmethod
    def of_tones(cls, turns: np.ndarray, tones: np.ndarray, length: int) -> _LinesOfPieces:
        """Make them of complex amplitudes ``tones`` (n,) that turn so many times with each sample, (n,)."""
        position = turns[:, None] * length
        nearest = np.round(_FINER * position).astype(int)
        bins = nearest + np.arange(-_FINER, _FINER + 1)
        apart = position - bins / _FINER
        here = (np.abs(apart) <= _NEAR_LINE) & (bins >= 0) & (bins <= _FINER * length // 2)
        values = 0.5 * tones[:, None] * _hann_sum(apart, length)
        angles = np.broadcast_to(2.0 * np.pi * turns[:, None], bins.shape)
        return cls(bins[here], values[here], angles[here])

    def add_to(self, values: np.ndarray, start: int) -> None:
        """Add them to the bins of a piece that begins at the sample ``start``."""
        np.add.at(values, self.bins, self.values * np.exp(1j * self.turns * start))


def _hann_sum(apart: np.ndarray, length: int) -> np.ndarray:
    """Sum of a Hann window of so many samples times a tone that is ``apart`` from a bin by so many, in
    closed form.
    """

    def plain(bins: np.ndarray) -> np.ndarray:
        angle = np.pi * bins / length
        near = np.abs(np.sin(angle)) < 1e-12
        sums = np.sin(length * angle) / np.where(near, 1.0, np.sin(angle))
        return np.where(near, length, sums) * np.exp(1j * angle * (length - 1))

    turn = np.exp(1j * np.pi / length)
    beside = turn * plain(apart + 1.0) + plain(apart - 1.0) / turn
    return np.asarray(0.5 * plain(apart) - 0.25 * beside)


def _largest_of_pieces(x: np.ndarray, length: int, lines: _LinesOfPieces) -> np.ndarray:
    """Largest amplitude of each bin in pieces of ``length`` samples of a motion ``x`` (n,) that
    repeats, and of the ``lines`` beside it.
    """
    window, around = _hann(length), np.concatenate([x, x[:length]])
    largest = np.zeros(_FINER * length // 2 + 1)
    for start in range(0, x.size, max(length // _SHIFTS, 1)):
        values = np.fft.rfft(around[start : start + length] * window, _FINER * length)
        lines.add_to(values, start)
        largest = np.maximum(largest, 2.0 * np.abs(values) / window.sum())
    return largest


def _sizes_of(tones: np.ndarray, turns: np.ndarray, length: int) -> np.ndarray:
    """Amplitude of the largest of some ``tones`` in each bin of a piece, by their nearest bins."""
    sizes = np.zeros(_FINER * length // 2 + 1)
    nearest = np.minimum(np.round(_FINER * turns * length).astype(int), sizes.size - 1)
    np.maximum.at(sizes, nearest, np.abs(tones))
    return sizes


def _largest_about(sizes: np.ndarray, reach: int) -> np.ndarray:
    """Largest of ``sizes`` (n,) within so many on either side of each, (n,)."""
    from scipy.ndimage import maximum_filter1d  # slow to import, and seldom needed

    return np.asarray(maximum_filter1d(sizes, 2 * reach + 1, mode="constant"))


def _even_above(number: float) -> int:
    """An even number of samples, no less than a ``number``, of which a transform is quick."""
    from scipy.fft import next_fast_len

    return 2 * int(next_fast_len(math.ceil(0.5 * number)))


def _hann(size: int) -> np.ndarray:
    return np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2


def _lengths(cycle: float, shortest: float, duration: float) -> Iterator[float]:
    """Lengths of pieces [s], each half of the one before, and the ``shortest``, unless that takes too many: where a
    line wanders, it is no smaller in any that tells the drive's own lines apart.
    """
    length = min(cycle / _PIECES_OF_CYCLE, 0.5 * duration)
    if length < shortest:
        return
    for _ in range(_HALVINGS):
        yield length
        if length == shortest:
            return
        length = max(0.5 * length, shortest)


def _bins_of_pieces(
    x: np.ndarray, size: int, lines: _LinesOfPieces
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest amplitude of each bin in pieces of ``size`` samples, its RMS over all of them, and the
    largest with the ``lines`` that are there.
    """
    window = _hann(size)
    largest = np.zeros(_FINER * size // 2 + 1)
    squares, with_lines = np.zeros_like(largest), np.zeros_like(largest)
    starts = range(0, x.size - size + 1, max(size // _SHIFTS, 1))
    for start in starts:
        values = np.fft.rfft(x[start : start + size] * window, _FINER * size)
        amplitude = 2.0 * np.abs(values) / window.sum()
        largest = np.maximum(largest, amplitude)
        squares += amplitude**2
        lines.add_to(values, start)
        with_lines = np.maximum(with_lines, 2.0 * np.abs(values) / window.sum())
    return largest, np.sqrt(squares / len(starts)), with_lines
