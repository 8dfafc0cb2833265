"""Order tracking: amplitude and phase over time of components whose phase is known.

A record is fitted by components A_k(t) cos(phi_k(t) + theta_k(t)), all at once, whose complex
amplitudes are cubic splines in time with equally spaced knots. This is the second-generation
Vold-Kalman filter (Vold, Mains and Blough, SAE 972007) with splines in place of its penalty on the
second difference of the envelopes: the number of unknowns goes with the bandwidth and not with the
sample rate, and the covariance of the amplitudes is that of a linear fit. ``tests/support/vold_kalman``
is that filter, for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.errors import MicrovibError

_DEGREE = 3
_SUPPORT = _DEGREE + 1
"""Splines that are not zero between two knots."""
_RIDGE = 1e-9
"""Part of the largest diagonal element that is added to all: components without samples are zero."""
_ROUGHNESS = 1e-3
"""Weight of third differences of an envelope, over the largest diagonal element."""
_MARGIN = 12
"""Knots beside a stretch within which others tell on its covariance: the inverse falls by more than
a half from one to the next."""
_STRETCH = 24
"""Knots of a stretch whose covariance is computed at a time."""
LOST_SEPARATION = 4.0
"""Times of the variance that a component would have by itself, from which it is *not separable*."""
_BESIDE = (0.75, 1.5, 3.0)
"""Distances from a component, over the bandwidth: what is between the first two counts with its mean
power, lines among it, what is up to the third with its median, as noise."""
_PER_KNOT = 4
"""Points per knot at which amplitudes are given."""


@dataclass(frozen=True)
class Tracked:
    """Amplitudes of components over time; K components, n samples, m points."""

    time: np.ndarray
    """Points [s], (m,)."""
    amplitude: np.ndarray
    """Complex amplitudes, (K, m): magnitudes are 0-to-peak, angles those of cosines."""
    noise: np.ndarray
    """Standard uncertainty of the magnitudes from the floor beside each component, (K, m)."""
    resolution_error: np.ndarray
    """Change of the amplitudes where the bandwidth is halved, beyond its noise, (K, m)."""
    separation: np.ndarray
    """Variance over that of the component by itself, (K, m)."""
    residual: np.ndarray
    """Samples less all components and the trend, (n,)."""
    bandwidth: float
    """Width [Hz] about a component within which everything is taken for it."""

    @cached_property
    def uncertainty(self) -> np.ndarray:
        """Standard uncertainty of the magnitudes, noise and resolution, (K, m)."""
        return np.hypot(self.noise, self.resolution_error)

    @cached_property
    def separable(self) -> np.ndarray:
        """Whether the record tells a component from the others at a point, (K, m)."""
        return self.separation < LOST_SEPARATION


class OrderError(MicrovibError):
    """Orders that cannot be tracked: says which setting, and what would be possible."""


def track_components(
    x: np.ndarray, sample_rate: float, phases: np.ndarray, used: np.ndarray, bandwidth: float
) -> Tracked:
    """Amplitudes of components of ``x`` (n,) with ``phases`` (K, n) [rad].

    ``used`` (K, n) says at which samples a component counts: where its frequency is beyond what the
    record holds it does not. OrderError where the record is shorter than four times 1/``bandwidth``.
    """
    duration = x.size / sample_rate
    intervals = int(np.floor(duration * bandwidth))
    if intervals < 4:
        raise OrderError(
            f"bandwidth: {bandwidth:.4g} Hz needs a record of {4.0 / bandwidth:.4g} s; it has"
            f" {duration:.4g} s"
        )
    fine = _Fit.of(x, sample_rate, phases, used, intervals)
    coarse = _Fit.of(x, sample_rate, phases, used, max(intervals // 2, 2))
    t = np.linspace(0.0, duration - 1.0 / sample_rate, intervals * _PER_KNOT + 1)
    amplitude, halved = fine.at(t), coarse.at(t)
    residual = x - fine.values(phases, used)
    floor = _floor_beside(residual, sample_rate, phases, bandwidth, t)
    unit, alone = fine.variance(t, amplitude)
    noise = np.sqrt(unit * floor)
    change = np.abs(np.abs(amplitude) - np.abs(halved))
    return Tracked(
        t,
        amplitude,
        noise,
        _RESOLUTION_PART * np.maximum(change - 2.0 * noise, 0.0),
        unit / alone,
        residual,
        bandwidth,
    )


_RESOLUTION_PART = 0.5
"""Part of the change at half the bandwidth that counts as uncertainty: halving the distance of the
knots of cubic splines makes errors of smooth curves 16 times smaller, of bent ones half."""


@dataclass(frozen=True)
class _Fit:
    """Splines fitted to a record: their Gram matrix, its factor, and the coefficients."""

    intervals: int
    duration: float
    components: int
    gram: np.ndarray
    """Lower bands of the matrix, (bands, size)."""
    coefficients: np.ndarray
    """By knot and column, (knots, 2 K + 1)."""

    @classmethod
    def of(
        cls, x: np.ndarray, rate: float, phases: np.ndarray, used: np.ndarray, intervals: int
    ) -> _Fit:
        from scipy.linalg import solveh_banded

        K, width = len(phases), 2 * len(phases) + 1
        knots = intervals + _DEGREE
        bands = _SUPPORT * width
        gram, right = np.zeros((bands, knots * width)), np.zeros(knots * width)
        position = np.arange(x.size) * (intervals / x.size)
        starts = np.searchsorted(position, np.arange(intervals + 1))
        for j in range(intervals):
            part = slice(starts[j], starts[j + 1])
            D = _design(position[part] - j, phases[:, part], used[:, part])
            block = D.T @ D
            first = j * width
            right[first : first + bands] += D.T @ x[part]
            for d in range(bands):
                gram[d, first : first + bands - d] += np.diagonal(block, -d)
        gram[0] += _RIDGE * float(np.max(gram[0]))
        solved = solveh_banded(gram + _roughness(knots, width, bands, gram), right, lower=True)
        return cls(intervals, x.size / rate, K, gram, solved.reshape(knots, width))

    def _places(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First knot (m,) of each time, and the splines there, (m, 4)."""
        position = np.clip(t / self.duration * self.intervals, 0.0, self.intervals)
        first = np.minimum(position.astype(int), self.intervals - 1)
        return first, _splines(position - first)

    def at(self, t: np.ndarray) -> np.ndarray:
        """Complex amplitudes (K, m) at the times ``t`` (m,) [s]."""
        first, B = self._places(t)
        around = self.coefficients[first[:, None] + np.arange(_SUPPORT)]
        values = np.einsum("ms,msc->cm", B, around)
        K = self.components
        return np.asarray(values[:K] - 1j * values[K : 2 * K])

    def values(self, phases: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Samples (n,) of all components and the trend."""
        n = phases.shape[1]
        t = np.arange(n) * (self.duration / n)
        first, B = self._places(t)
        out = np.zeros(n)
        for s in range(_SUPPORT):
            c = self.coefficients[first + s]
            out += B[:, s] * c[:, -1]
            for k in range(self.components):
                wave = c[:, k] * np.cos(phases[k])
                wave += c[:, self.components + k] * np.sin(phases[k])
                out += B[:, s] * used[k] * wave
        return out

    def variance(self, t: np.ndarray, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Variances (K, m) of the magnitudes at the times ``t`` for noise of variance 1: with all
        components, and with each by itself.
        """
        first, B = self._places(t)
        joint, alone = np.empty(amplitude.shape), np.empty(amplitude.shape)
        for begin in range(0, self.intervals, _STRETCH):
            here = np.flatnonzero((first >= begin) & (first < begin + _STRETCH))
            if here.size == 0:
                continue
            low = max(begin - _MARGIN, 0)
            high = min(begin + _STRETCH + _MARGIN, self.intervals) + _DEGREE
            G = self._block(low, high)
            self._variances(G, first[here] - low, B[here], amplitude[:, here], (joint, alone), here)
        return joint, alone

    def _variances(
        self,
        G: np.ndarray,
        first: np.ndarray,
        B: np.ndarray,
        amplitude: np.ndarray,
        out: tuple[np.ndarray, np.ndarray],
        here: np.ndarray,
    ) -> None:
        """Variances of points from the Gram matrix ``G`` of the knots about them."""
        K, width = self.components, 2 * self.components + 1
        knots = len(G) // width
        inverse = np.linalg.inv(G).reshape(knots, width, knots, width)
        rows = first[:, None] + np.arange(_SUPPORT)
        for k in range(K):
            pair = [k, K + k]
            own = np.ix_(range(knots), pair, range(knots), pair)
            by_itself = G.reshape(knots, width, knots, width)[own].reshape(2 * knots, 2 * knots)
            single = np.linalg.inv(by_itself).reshape(knots, 2, knots, 2)
            away = amplitude[k] / np.maximum(np.abs(amplitude[k]), 1e-300)
            weight = np.array([away.real, -away.imag])
            for target, covariance in ((out[0], inverse[own]), (out[1], single)):
                picked = covariance[rows[:, :, None], :, rows[:, None, :], :]
                target[k, here] = np.einsum("ms,mu,msuab,am,bm->m", B, B, picked, weight, weight)

    def _block(self, low: int, high: int) -> np.ndarray:
        """The Gram matrix between two knots, dense."""
        width = 2 * self.components + 1
        first, size = low * width, (high - low) * width
        G = np.zeros((size, size))
        for d in range(min(len(self.gram), size)):
            band = self.gram[d, first : first + size - d]
            index = np.arange(size - d)
            G[index + d, index] = band
            G[index, index + d] = band
        return G


def _roughness(knots: int, width: int, bands: int, gram: np.ndarray) -> np.ndarray:
    """Lower bands of a small penalty on third differences of each component's coefficients.

    It counts where the record tells nothing, as at a crossing: envelopes pass through it smoothly.
    """
    out = np.zeros(gram.shape)
    D = np.array([-1.0, 3.0, -3.0, 1.0])
    size = _ROUGHNESS * float(np.max(gram[0]))
    for j in range(knots - _DEGREE):
        for a in range(_SUPPORT):
            for b in range(a + 1):
                at = (j + b) * width
                out[(a - b) * width, at : at + width] += size * D[a] * D[b]
    return out


def _splines(u: np.ndarray) -> np.ndarray:
    """The four cubic B-splines (m, 4) of an interval at the parts ``u`` (m,) of it."""
    v = 1.0 - u
    return np.column_stack(
        [
            v**3 / 6.0,
            (3.0 * u**3 - 6.0 * u**2 + 4.0) / 6.0,
            (3.0 * v**3 - 6.0 * v**2 + 4.0) / 6.0,
            u**3 / 6.0,
        ]
    )


def _design(u: np.ndarray, phases: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Columns of the fit between two knots, (m, 4 (2 K + 1)): by knot cosines, sines and the trend."""
    waves = np.column_stack([(used * np.cos(phases)).T, (used * np.sin(phases)).T, np.ones(u.size)])
    return np.einsum("ms,mc->msc", _splines(u), waves).reshape(u.size, -1)


def _floor_beside(
    residual: np.ndarray, rate: float, phases: np.ndarray, bandwidth: float, t: np.ndarray
) -> np.ndarray:
    """Variance (K, m) of white noise as dense as the residual beside each component at the times ``t``.

    Each component is turned back by its own phase, so that lines which follow it stay beside it, and
    are not smeared over it by the sweep. A line that is not tracked and crosses a component, or comes
    close to it, raises the uncertainty of the latter.
    """
    segment = int(min(max(round(4.0 * rate / bandwidth), 16), residual.size))
    starts = np.arange(0, residual.size - segment + 1, max(segment // 2, 1))
    window = np.hanning(segment + 1)[:-1]
    window /= np.sqrt(np.sum(window**2))
    offset = np.fft.fftfreq(segment, 1.0 / rate)
    close = np.abs(offset) < max(4.0 * bandwidth, 8.0 * rate / segment)
    offset = offset[close]
    place = np.minimum(starts + segment // 2, phases.shape[1] - 2)
    where = (phases[:, place + 1] - phases[:, place]) * rate / (2.0 * np.pi)
    found = np.empty((len(phases), starts.size))
    for k, phase in enumerate(phases):
        turned = residual * np.exp(-1j * phase)
        for j, start in enumerate(starts):
            power = np.abs(np.fft.fft(turned[start : start + segment] * window)[close]) ** 2
            found[k, j] = _power_beside(offset + where[k, j], power, where[:, j], k, bandwidth)
    middle = (starts + 0.5 * segment) / rate
    return np.array([np.interp(t, middle, row) for row in found])


def _power_beside(
    f: np.ndarray, power: np.ndarray, where: np.ndarray, k: int, bandwidth: float
) -> float:
    """Power of the bins at ``f`` beside component ``k``, but for those near other components and near
    zero frequency.
    """
    distance = np.abs(f[:, None] - where)
    near, close, far = (part * bandwidth for part in _BESIDE)
    clear = (np.min(distance, axis=1) > near) & (f > near)
    beside = clear & (distance[:, k] < far)
    for chosen in (beside, clear, distance[:, k] > near):
        if np.count_nonzero(chosen) >= 4:
            break
    else:
        return float(np.mean(power))
    floor = float(np.median(power[chosen])) / np.log(2.0)
    closest = clear & (distance[:, k] < close)
    if np.count_nonzero(closest) >= 3:
        floor = max(floor, float(np.mean(power[closest])))
    return floor
