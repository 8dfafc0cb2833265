"""How loud a band is at the ends of a record, where its filter's transients are left out.

A filter sees no further than the record, and what is cut there is heard at all frequencies. The ends are
therefore filtered with their own mirror image behind them, with and without the steady tones beside the band.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

_SHORTEST = 8
"""Samples of a piece by which the ends of a record are compared with the rest, at least."""
_AT_ONCE = 1_000_000
"""Samples that are worked on together, in little memory."""
_REACHES = 16
"""Times the filter's reach that is looked at for tones beside the band."""
_MOST_TONES = 12
_BESIDE = 8.0
"""Bins within which tones are fitted together."""
_SMALL_TONE = 0.02
"""Amplitude of a tone beside the band, over the largest magnitude in it, below which it stays: the mirror
image makes less of it."""
_ROUNDS = 3
"""Corrections of the tones' frequencies; each leaves about the square of what was left."""


def loudness_of_ends(
    x: np.ndarray,
    reach: int,
    inner: np.ndarray,
    passed: Callable[[np.ndarray], np.ndarray],
    band: tuple[float, float],
) -> float:
    """RMS in a band of the loudest piece within ``reach`` of a record's ends over that of the loudest
    between, for pieces of some lengths; at least 1.

    Parameters
    ----------
    x : ndarray
        The record (n,), without its mean.
    reach : int
        Samples before and behind one that the filter looks at.
    inner : ndarray
        The band between the ends, (n - 2 reach,).
    passed : callable
        The filter; as many samples as it is given.
    band : tuple of float
        Its edges over the sample rate.
    """
    least = _SMALL_TONE * float(np.max(np.abs(inner)))
    ends = [_end_in_band(each, reach, passed, band, least) for each in (x, x[::-1])]
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
    reach: int,
    passed: Callable[[np.ndarray], np.ndarray],
    band: tuple[float, float],
    least: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The band in the last ``reach`` samples of ``x`` as it is, and without the tones beside it that go on
    from before, down to an amplitude of ``least``; (reach,) each.

    What is new at the end is loud in both: tones are cut there in the one, and what varies like a tone
    for a while is taken to go on in the other.
    """
    part = x[-_REACHES * reach :]
    kept = slice(part.size - reach, part.size)
    rest = part - _steady_tones(part, part.size - reach, band, least)
    as_it_is, without = (
        passed(np.pad(each, (0, reach), mode="symmetric"))[kept] for each in (part, rest)
    )
    return as_it_is, without


def _steady_tones(x: np.ndarray, known: int, band: tuple[float, float], least: float) -> np.ndarray:
    """Sum over all of ``x`` (n,) of the tones outside a band that its first ``known`` samples hold."""
    frequencies, amplitudes = np.zeros(0), np.zeros(0, complex)
    rest = x[:known]
    for _ in range(_MOST_TONES):
        frequency, amplitude = _largest_tone(rest, band)
        if amplitude < max(least, 1e-300):
            break
        near = np.abs(frequencies - frequency) < _BESIDE / known
        together = rest + _tones(frequencies[near], amplitudes[near], known)
        f, a = _fitted(together, np.append(frequencies[near], frequency))
        rest = together - _tones(f, a, known)
        frequencies = np.append(frequencies[~near], f)
        amplitudes = np.append(amplitudes[~near], a)
    return _tones(frequencies, amplitudes, x.size)


def _largest_tone(x: np.ndarray, band: tuple[float, float]) -> tuple[float, float]:
    """Frequency over the sample rate, and amplitude, of the largest tone outside a band."""
    from scipy.fft import next_fast_len

    window = _hann(x.size)
    size = next_fast_len(2 * x.size, real=True)
    magnitude = np.abs(np.fft.rfft(x * window, size)) * (2.0 / window.sum())
    f = np.arange(magnitude.size) / size
    magnitude[(f >= band[0]) & (f <= band[1])] = 0.0
    k = int(np.argmax(magnitude))
    return float(f[k]), float(magnitude[k])


def _fitted(x: np.ndarray, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies over the sample rate, from these ``frequencies`` (m,) on, and complex amplitudes of the
    tones that fit ``x`` best together.
    """
    for _ in range(_ROUNDS):
        amplitude, slope = _least_squares(x, frequencies, 2)
        step = np.imag(slope * amplitude.conj()) / np.maximum(np.abs(amplitude) ** 2, 1e-300)
        frequencies = frequencies + np.clip(step / (np.pi * x.size), -0.5 / x.size, 0.5 / x.size)
    return frequencies, _least_squares(x, frequencies, 1)[0]


def _tones(frequencies: np.ndarray, amplitudes: np.ndarray, size: int) -> np.ndarray:
    """Sum of tones, (size,)."""
    total = np.zeros(size)
    for at in range(0, size, _AT_ONCE):
        k = np.arange(at, min(at + _AT_ONCE, size))
        for each, a in zip(frequencies.tolist(), amplitudes.tolist(), strict=True):
            total[k] += np.real(a * np.exp(2j * np.pi * each * k))
    return total


def _least_squares(x: np.ndarray, frequencies: np.ndarray, terms: int) -> np.ndarray:
    """Complex amplitudes (terms, m) of tones that are constant, or change linearly from -1 to 1 as well
    over ``x`` (n,), whose middle counts most.
    """
    m = 2 * terms * frequencies.size
    normal, right = np.zeros((m, m)), np.zeros(m)
    for at in range(0, x.size, _AT_ONCE // m):
        k = np.arange(at, min(at + _AT_ONCE // m, x.size))
        turning = np.exp(2j * np.pi * np.outer(frequencies, k))
        along = 2.0 * k / x.size - 1.0
        complexes = np.concatenate([turning * along**power for power in range(terms)])
        rows = np.concatenate([complexes.real, -complexes.imag])
        weighed = rows * np.sin(np.pi * (k + 0.5) / x.size) ** 2
        normal += weighed @ rows.T
        right += weighed @ x[k]
    found = np.linalg.lstsq(normal, right, rcond=1e-9)[0]
    return np.asarray((found[: m // 2] + 1j * found[m // 2 :]).reshape(terms, -1))


def _hann(size: int) -> np.ndarray:
    return np.asarray(np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2)


def _loudest_piece(x: np.ndarray, length: int) -> float:
    """Largest root of the summed squares over Hann-windowed pieces, half of one apart."""
    window = _hann(length)
    pieces = np.lib.stride_tricks.sliding_window_view(x, length)[:: max(length // 2, 1)]
    return math.sqrt(max(_power(group, window) for group in _groups(x[-length:], pieces)))


def _groups(last: np.ndarray, pieces: np.ndarray) -> Iterator[np.ndarray]:
    rows = max(_AT_ONCE // last.size, 1)
    yield last[None]
    for k in range(0, len(pieces), rows):
        yield pieces[k : k + rows]


def _power(pieces: np.ndarray, window: np.ndarray) -> float:
    return float(np.max(np.sum((pieces * window) ** 2, axis=1)))
