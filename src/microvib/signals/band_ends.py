"""How loud a band is at the ends of a record, where its filter's transients are left out.

A filter sees no further than the record, and what is cut there is heard at all frequencies. The ends are
therefore filtered with their own mirror image behind them, upright and turned over, and with that of what the
lines leave that went on before; behind the end these go on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from microvib.signals.line_fit import estimate_lines
from microvib.signals.tones import MIN_SAMPLES
from microvib.signals.unaccounted import hann_window, samples_of_lines

_SHORTEST, _PERIODS = 8, 2.0
"""Samples of a piece by which the ends of a record are compared with the rest, at least, and periods of the band's
upper edge: a burst is as loud as it is in a piece that is no longer.
"""
_HOPS = 8
"""Pieces of an end that begin within the length of one, so that one is about the middle of a burst."""
_AT_ONCE = 1_000_000
"""Samples of such pieces that are worked on together, in little memory."""
_REACHES = 16
"""Times the filter's reach that is looked at for lines."""
_SMALL_LINE = 0.02
"""Amplitude of a line over the largest magnitude in the band, below which it stays: the mirror image makes
less of it."""


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
    shortest = max(_SHORTEST, math.ceil(_PERIODS * rate / band[1]))

    ends = [_end_in_band(each, rate, reach, passed, least) for each in (x, x[::-1])]
    found = 1.0
    for length in _lengths(shortest, min(reach // 2, inner.size)):
        hop = max(length // _HOPS, 1)
        loudest = max(
            min(_loudest_piece(each[: reach + length // 2], length, hop) for each in end)
            for end in ends
        )
        between = _loudest_piece(inner, length, max(length // 2, 1))
        if loudest > 0.0:
            found = max(found, loudest / between if between > 0.0 else math.inf)
    return found


def _lengths(shortest: int, longest: int) -> Iterator[int]:
    """Samples of pieces, each half as many as of those before."""
    while longest >= shortest:
        yield longest
        longest //= 2


def _end_in_band(
    x: np.ndarray,
    rate: float,
    reach: int,
    passed: Callable[[np.ndarray], np.ndarray],
    least: float,
) -> list[np.ndarray]:
    """The band in the last ``reach`` samples of ``x`` and behind them: in their mirror image, upright and
    turned over, and in that of what lines larger than ``least`` leave that were there before and go on;
    (2 reach,) each.

    What is new at the end is loud in all: lines are bent there in the first two, and what is like a line for
    a while is taken to go on in the last.
    """
    part = x[-_REACHES * reach :]
    before = part[:-reach]
    lines = estimate_lines(before - before.mean(), rate, ()) if before.size >= MIN_SAMPLES else ()
    went_on = [one for one in lines if one.seen and one.amplitude > least]
    behind = 2 * reach  # the filter looks as far behind what is looked at
    go_on = samples_of_lines(went_on, part.size + behind, rate, before.size / rate)
    upright = np.pad(part, (0, behind), mode="symmetric")
    turned_over = np.pad(part, (0, behind), mode="symmetric", reflect_type="odd")
    rest = np.pad(part - go_on[: part.size], (0, behind), mode="symmetric")
    kept = slice(part.size - reach, part.size + reach)
    return [passed(each)[kept] for each in (upright, turned_over, rest + go_on)]


def _loudest_piece(x: np.ndarray, length: int, hop: int) -> float:
    """Largest root of the summed squares over Hann-windowed pieces, a ``hop`` apart."""
    window = hann_window(length)
    pieces = np.lib.stride_tricks.sliding_window_view(x, length)[::hop]
    return math.sqrt(max(_power(group, window) for group in _groups(x[-length:], pieces)))


def _groups(last: np.ndarray, pieces: np.ndarray) -> Iterator[np.ndarray]:
    rows = max(_AT_ONCE // last.size, 1)
    yield last[None]
    for k in range(0, len(pieces), rows):
        yield pieces[k : k + rows]


def _power(pieces: np.ndarray, window: np.ndarray) -> float:
    return float(np.max(np.sum((pieces * window) ** 2, axis=1)))
