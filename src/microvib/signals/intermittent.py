"""Lines that a record has for a part of its time only, as the drive changes within it.

The amplitude of a line is that over the whole record. Where a drive slips otherwise over a part of a
slow cycle, what it makes there counts in that for a small part, or is parted into many lines; here
the spectrum of each piece of a record is looked at, and what is larger in one than on average is
told.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

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
_LOUDER = 1.3
"""Times its RMS over all pieces that a bin must have in one to count: what is steady has it once."""
_OVER_NOISE = 6.0
"""Times the floor that a bin of a piece must have where noise makes one."""


def intermittent_peaks(
    x: np.ndarray,
    sample_rate: float,
    lines: Iterable[Line],
    cycle: float,
    shortest: float,
    noise: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and amplitudes of what is louder in a piece of a record than on average.

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
    """
    duration = x.size / sample_rate
    x = x - x.mean()
    x = x - samples_of_lines([y for y in lines if math.isfinite(y.amplitude)], x.size, sample_rate)
    frequency, amplitude = [np.zeros(0)], [np.zeros(0)]
    for each in _lengths(cycle, shortest, duration):
        size = round(each * sample_rate)
        length = size / sample_rate
        largest, mean = _bins_of_pieces(x, size)
        at = np.arange(largest.size) / (_FINER * length)
        counts = largest > _LOUDER * mean
        if noise is not None:
            counts &= largest > _OVER_NOISE * math.sqrt(duration / length) * np.interp(at, *noise)
        counts &= (at >= _FIRST_BIN / length) & (at <= PASSBAND * sample_rate)
        frequency.append(at[counts])
        amplitude.append(largest[counts])
    return np.concatenate(frequency), np.concatenate(amplitude)


def _lengths(cycle: float, shortest: float, duration: float) -> Iterator[float]:
    """Lengths of pieces [s], each half of the one before."""
    length = min(cycle / _PIECES_OF_CYCLE, 0.5 * duration)
    for _ in range(_HALVINGS):
        if length < shortest:
            return
        yield length
        length *= 0.5


def _bins_of_pieces(x: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Largest amplitude of each bin in pieces of ``size`` samples, and its RMS over all of them."""
    window = np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2
    largest = np.zeros(_FINER * size // 2 + 1)
    squares = np.zeros_like(largest)
    starts = range(0, x.size - size + 1, max(size // _SHIFTS, 1))
    for start in starts:
        values = np.fft.rfft(x[start : start + size] * window, _FINER * size)
        amplitude = 2.0 * np.abs(values) / window.sum()
        largest = np.maximum(largest, amplitude)
        squares += amplitude**2
    return largest, np.sqrt(squares / len(starts))
