"""How loud a band is at the ends of a record, where its filter's transients are left out.

A filter sees no further than the record, and what is cut there is heard at all frequencies. The ends are
therefore filtered with their own mirror image behind them, with and without the lines beside the band.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from microvib.signals.line_fit import estimate_lines
from microvib.signals.line_table import Line
from microvib.signals.tones import MIN_SAMPLES
from microvib.signals.unaccounted import hann_window, samples_of_lines

_SHORTEST = 8
"""Samples of a piece by which the ends of a record are compared with the rest, at least."""
_AT_ONCE = 1_000_000
"""Samples of such pieces that are worked on together, in little memory."""
_REACHES = 16
"""Times the filter's reach that is looked at for lines beside the band."""
_SMALL_LINE = 0.02
"""Amplitude of a line beside the band, over the largest magnitude in it, below which it stays: the mirror
image makes less of it."""


def loudness_of_ends(
    x: np.ndarray,
    rate: float,
    band: tuple[float, float],
    inner: np.ndarray,
    passed: Callable[[np.ndarray], np.ndarray],
) -> float:
    """RMS in a band of the loudest piece of a record's ends over that of the loudest between, for pieces of
    some lengths; at least 1.

    Parameters
    ----------
    x : ndarray
        The record (n,), without its mean, at ``rate`` [Hz].
    band : tuple of float
        Edges of the band [Hz].
    inner : ndarray
        The band between the ends, (n - 2 reach,), where the filter looks at ``reach`` samples before and
        behind each.
    passed : callable
        The filter; as many samples as it is given.
    """
    reach = (x.size - inner.size) // 2
    least = _SMALL_LINE * float(np.max(np.abs(inner)))

    def beside(line: Line) -> bool:
        return line.amplitude > least and not band[0] <= line.frequency <= band[1]

    ends = [_end_in_band(each, rate, reach, passed, beside) for each in (x, x[::-1])]
    found = 1.0
    for length in sorted({min(length, inner.size) for length in (reach, reach // 2, reach // 4)}):
        if length < _SHORTEST:
            continue
        loudest = max(min(_loudest_piece(each, length) for each in end) for end in ends)
        between = _loudest_piece(inner, length)
        if loudest > 0.0:
            found = max(found, loudest / between if between > 0.0 else math.inf)
    return found


def _end_in_band(
    x: np.ndarray,
    rate: float,
    reach: int,
    passed: Callable[[np.ndarray], np.ndarray],
    beside: Callable[[Line], bool],
) -> tuple[np.ndarray, np.ndarray]:
    """The band in the last ``reach`` samples of ``x`` as it is, and without the lines ``beside`` it that go
    on from before; (reach,) each.

    What is new at the end is loud in both: lines are cut there in the one, and what is like a line for a
    while is taken to go on in the other.
    """
    part = x[-_REACHES * reach :]
    before = part[:-reach]
    lines = estimate_lines(before - before.mean(), rate, ()) if before.size >= MIN_SAMPLES else ()
    went_on = [one for one in lines if one.seen and beside(one)]
    rest = part - samples_of_lines(went_on, part.size, rate, before.size / rate)
    kept = slice(part.size - reach, part.size)
    as_it_is, without = (
        passed(np.pad(each, (0, reach), mode="symmetric"))[kept] for each in (part, rest)
    )
    return as_it_is, without


def _loudest_piece(x: np.ndarray, length: int) -> float:
    """Largest root of the summed squares over Hann-windowed pieces, half of one apart."""
    window = hann_window(length)
    pieces = np.lib.stride_tricks.sliding_window_view(x, length)[:: max(length // 2, 1)]
    return math.sqrt(max(_power(group, window) for group in _groups(x[-length:], pieces)))


def _groups(last: np.ndarray, pieces: np.ndarray) -> Iterator[np.ndarray]:
    rows = max(_AT_ONCE // last.size, 1)
    yield last[None]
    for k in range(0, len(pieces), rows):
        yield pieces[k : k + rows]


def _power(pieces: np.ndarray, window: np.ndarray) -> float:
    return float(np.max(np.sum((pieces * window) ** 2, axis=1)))
