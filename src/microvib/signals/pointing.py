"""Pointing errors over windows of time: exact weights on lines and densities, amplitudes at which they exceed, blur (MTF).

A window of T sees a motion of frequency f with the weights that follow from averaging over all phases; with u = pi f T and the
spherical Bessel functions j_n they are

    ape        1                             the motion itself
    mpe        j_0(u)^2                      its mean over the window (displacement)
    rpe        1 - j_0(u)^2                  what moves about this mean
    smear      3 j_1(u)^2                    of that, the part of the straight line that fits best
    jitter     1 - j_0(u)^2 - 3 j_1(u)^2     what moves about this line
    stability  2 (1 - cos 2 pi f T_s)        change from one instant to another T_s later
    pde        2 (1 - cos 2 pi f T_s) j_0^2  change of the mean from one window to another that begins T_s later

on the mean square, A^2/2 of a line or a one-sided density over frequency. Names are those of ECSS-E-ST-60-10C. Angles are in rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from microvib.errors import MicrovibError

Metric = Literal["ape", "mpe", "rpe", "smear", "jitter", "stability", "pde"]
METRICS: tuple[Metric, ...] = get_args(Metric)

_TERMS = 14  # terms of the sum over (2 n + 1) j_n(u)^2, which is 1; at u < 1 the next is below 1e-40
_PER_PERIOD = 16.0  # pieces in which a density is integrated, for each period that a weight goes through
_MOST_PIECES = 20_000_000
_GRID = 1 << 16  # bins of a distribution


def weight(metric: Metric, frequency: np.ndarray | float, window: float, apart: float | None = None) -> np.ndarray:
    """Weight of ``metric`` on the mean square at ``frequency`` [Hz], any shape, for a ``window`` T [s].

    ``apart`` is T_s [s] of stability and pde, from the start of one window to that of the next; without it they are adjacent, T.
    """
    if not window > 0.0 or not math.isfinite(window) or (apart is not None and not apart > 0.0):
        raise MicrovibError(
            f"window: {window:g} s (apart: {apart}) is not allowed; times greater than 0 s are expected"
        )
    f = np.asarray(frequency, dtype=float)
    u = np.pi * np.abs(f) * window
    mean = np.sinc(u / np.pi) ** 2
    if metric == "ape":
        return np.ones_like(u)
    if metric == "mpe":
        return mean
    if metric == "smear":
        return 3.0 * _spherical(1, u) ** 2
    if metric in ("rpe", "jitter"):
        return _beyond(1 if metric == "rpe" else 2, u, mean)
    change = 4.0 * np.sin(np.pi * f * (window if apart is None else apart)) ** 2
    return change if metric == "stability" else change * mean


def _spherical(order: int, u: np.ndarray) -> np.ndarray:
    from scipy.special import spherical_jn

    return np.asarray(spherical_jn(order, u), dtype=float)


def _beyond(first: int, u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """1 less the first ``first`` terms of the sum of (2 n + 1) j_n(u)^2; the others where u is small and the difference is lost."""
    left = 1.0 - mean if first == 1 else 1.0 - mean - 3.0 * _spherical(1, u) ** 2
    small = u < 1.0
    if np.any(small):
        terms = sum((2 * n + 1) * _spherical(n, u[small]) ** 2 for n in range(first, _TERMS))
        left = np.array(left)
        left[small] = terms
    return np.asarray(left)


def mean_square_of_lines(
    metric: Metric,
    frequency: np.ndarray,
    amplitude: np.ndarray,
    window: float,
    apart: float | None = None,
) -> np.ndarray:
    """Mean square [rad^2] of each line of ``amplitude`` 0-to-peak (k, ...) at ``frequency`` (k,) [Hz] in a ``window`` [s]."""
    amplitude = np.asarray(amplitude, dtype=float)
    w = weight(metric, frequency, window, apart)
    return np.asarray(w.reshape(w.shape + (1,) * (amplitude.ndim - w.ndim)) * 0.5 * amplitude**2)


def mean_square_of_density(
    metric: Metric, frequency: np.ndarray, density: np.ndarray, window: float, apart: float | None = None
) -> float:
    """Mean square [rad^2] of a one-sided ``density`` (n,) [rad^2/Hz], linear between the frequencies (n,) [Hz], ascending.

    Nothing is assumed outside them. The weight is integrated as finely as it varies. Raises MicrovibError.
    """
    f, S = np.asarray(frequency, dtype=float), np.asarray(density, dtype=float)
    if f.ndim != 1 or f.shape != S.shape or f.size < 2 or np.any(np.diff(f) <= 0.0) or f[0] < 0.0:
        raise MicrovibError("density: frequencies that ascend from 0 Hz or more are expected, and a density for each")
    if np.any(S < 0.0) or not np.all(np.isfinite(S)):
        raise MicrovibError("density: a value is negative or not finite; rad^2/Hz of 0 or more are expected")
    longest = max(window, apart or 0.0)
    pieces = np.maximum(np.ceil(np.diff(f) * longest * _PER_PERIOD), 1.0)
    if pieces.sum() > _MOST_PIECES:
        raise MicrovibError(
            f"window: {longest:g} s with a density up to {f[-1]:g} Hz takes {pieces.sum():.2g} pieces; at most"
            f" {_MOST_PIECES:.0e} are allowed; cut the density above, or shorten the window"
        )
    count = pieces.astype(int)
    interval = np.repeat(np.arange(count.size), count)
    nodes, shares = np.polynomial.legendre.leggauss(3)
    total = 0.0
    for part in np.array_split(np.arange(interval.size), max(interval.size // 200_000, 1)):
        k = interval[part]
        done = (part - (np.cumsum(count) - count)[k]) / count[k]  # part of the interval before the piece
        u = done[:, None] + 0.5 * (1.0 + nodes) / count[k, None]
        at = f[k, None] + u * np.diff(f)[k, None]
        value = S[k, None] + u * np.diff(S)[k, None]
        width = (np.diff(f) / count)[k]
        total += float(width @ ((value * weight(metric, at, window, apart)) @ (0.5 * shares)))
    return total


def cumulative_rms(frequency: np.ndarray, density: np.ndarray, *, falling: bool = False) -> np.ndarray:
    """Root of the integral of a one-sided ``density`` (n,) from the lowest frequency up to each, or down from the highest, (n,)."""
    f, S = np.asarray(frequency, dtype=float), np.asarray(density, dtype=float)
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (S[1:] + S[:-1]) * np.diff(f))])
    return np.asarray(np.sqrt(np.maximum(steps[-1] - steps if falling else steps, 0.0)))


def radial(mean_squares: np.ndarray) -> np.ndarray:
    """Root mean square of the distance from the axis, from mean squares about both axes (..., 2)."""
    return np.asarray(np.sqrt(np.sum(mean_squares, axis=-1)))


# ---- Statistics: a line is at its amplitude most of the time, noise hardly ever beyond three sigma ----


def level(amplitudes: Sequence[float] | np.ndarray, sigma: float, confidence: float = 0.997) -> float:
    """Angle [rad] that the sum of independent lines and Gaussian noise stays within for a part ``confidence`` of the time.

    ``amplitudes`` of lines 0-to-peak, each arcsine-distributed, of unrelated phases; ``sigma`` of the noise. The densities are
    convolved numerically, on a grid of _GRID bins: within 1e-4 of the largest angle.
    """
    if not 0.0 < confidence < 1.0:
        raise MicrovibError(f"confidence: {confidence:g} is not allowed; a part between 0 and 1 is expected")
    lines = np.abs(np.asarray(amplitudes, dtype=float))
    lines = np.sort(lines[lines > 0.0])
    reach = float(lines.sum()) + 8.0 * sigma
    if reach == 0.0:
        return 0.0
    if sigma == 0.0 and lines.size == 1:
        return float(lines[0] * math.sin(0.5 * math.pi * confidence))
    width = 2.0 * reach / (_GRID - 2)
    edges = (np.arange(_GRID + 1) - 0.5 * _GRID) * width
    spectrum = np.ones(_GRID // 2 + 1, dtype=complex)
    for amplitude in lines:
        spectrum *= np.fft.rfft(np.fft.ifftshift(np.diff(_arcsine(edges, float(amplitude)))))
    if sigma > 0.0:
        spectrum *= np.fft.rfft(np.fft.ifftshift(np.diff(_normal(edges, sigma))))
    # The grid's bins are centred half a bin off zero; every convolution adds that half, which is taken out here.
    chances = np.fft.fftshift(np.fft.irfft(spectrum, _GRID))
    centres = (np.arange(_GRID) - 0.5 * _GRID + 0.5 * (lines.size + (sigma > 0.0))) * width
    order = np.argsort(np.abs(centres))
    inside = np.cumsum(chances[order])
    return float(np.interp(confidence, inside, np.abs(centres[order])))


def bound(amplitudes: Sequence[float] | np.ndarray, sigma: float, sigmas: float = 3.0) -> float:
    """Angle [rad] that is passed only by the noise's own excess: all lines at their crests, and ``sigmas`` sigma of noise."""
    return float(np.sum(np.abs(amplitudes))) + sigmas * sigma


def _arcsine(x: np.ndarray, amplitude: float) -> np.ndarray:
    """Chance that a line is below ``x``."""
    return np.asarray(0.5 + np.arcsin(np.clip(x / amplitude, -1.0, 1.0)) / np.pi)


def _normal(x: np.ndarray, sigma: float) -> np.ndarray:
    from scipy.special import ndtr

    return np.asarray(ndtr(x / sigma))


# ---- Image: modulation transfer ----


def transfer_of_line(amplitude: float, nu: np.ndarray | float) -> np.ndarray:
    """MTF of a sinusoidal motion of ``amplitude`` [rad], fast against the exposure, at ``nu`` [cycles/rad]."""
    from scipy.special import j0

    return np.asarray(j0(2.0 * np.pi * amplitude * np.asarray(nu, dtype=float)))


def transfer_of_smear(length: float, nu: np.ndarray | float) -> np.ndarray:
    """MTF of a steady motion over ``length`` [rad] during the exposure."""
    return np.sinc(length * np.asarray(nu, dtype=float))


def transfer_of_noise(sigma: float, nu: np.ndarray | float) -> np.ndarray:
    """MTF of a random motion of standard deviation ``sigma`` [rad], fast against the exposure."""
    return np.asarray(np.exp(-2.0 * (np.pi * sigma * np.asarray(nu, dtype=float)) ** 2))


def transfer_in_window(
    frequency: np.ndarray, amplitude: np.ndarray, sigma: float, window: float, nu: np.ndarray | float
) -> np.ndarray:
    """MTF of lines and noise in an exposure of ``window`` [s]: of each line its jitter as a sinusoid, of all lines the smear.

    The smear's length is that of a steady motion with the same mean square, sqrt(12 x mean square); the lines' phases count as
    unrelated. ``sigma`` is the noise's jitter in this window.
    """
    jitter = np.sqrt(2.0 * mean_square_of_lines("jitter", frequency, amplitude, window))
    length = math.sqrt(12.0 * float(np.sum(mean_square_of_lines("smear", frequency, amplitude, window))))
    total = transfer_of_smear(length, nu) * transfer_of_noise(sigma, nu)
    for one in jitter:
        total = total * transfer_of_line(float(one), nu)
    return np.asarray(total)
