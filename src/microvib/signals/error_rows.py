"""Errors beside lines and noise, such as biases and drifts: how they are spread, for sums of
distributions.

A deviation is a random variable about zero; the density of a sum is the convolution of all, the
product of their characteristic functions. In windows what a drift does depends on the instant, and so
sizes are given in rows, as those of lines (``pointing.windowed_amplitudes``).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

Kind = Literal["normal", "uniform", "arcsine"]
_VARIANCE: dict[Kind, float] = {"normal": 1.0, "uniform": 1.0 / 3.0, "arcsine": 0.5}
"""Variance of a deviation of size 1."""
SIGMAS = 3.0
"""Standard deviations of a normal deviation that a bound counts at least, as of noise."""
_REACH = 8.0
"""Standard deviations within which a normal deviation is for all that is computed."""
_NODES = 6
"""Gauss nodes in each interval in which the transform of a ramp is integrated."""


@dataclass(frozen=True)
class Deviation:
    """A random variable about zero, [rad]."""

    kind: Kind
    size: np.ndarray
    """Standard deviation of a normal one, half-width of a uniform one, amplitude of an arcsine, (n,)
    rows.
    """

    @property
    def variance(self) -> np.ndarray:
        """(n,) [rad^2]."""
        return np.asarray(_VARIANCE[self.kind] * self.size**2)

    @property
    def reach(self) -> np.ndarray:
        """Beyond which it is never, (n,); a normal one hardly ever."""
        return (_REACH if self.kind == "normal" else 1.0) * self.size

    def transform(self, at: np.ndarray) -> np.ndarray:
        """Characteristic function at ``at`` (m,) [1/rad], (n, m)."""
        from scipy.special import j0

        x = np.outer(self.size, at)
        if self.kind == "normal":
            return np.asarray(np.exp(-0.5 * x**2))
        if self.kind == "uniform":
            return np.asarray(np.sinc(x / np.pi))
        return np.asarray(j0(x))


@dataclass(frozen=True)
class Ramp:
    """Error that grows evenly from zero to an end, seen at an instant of which nothing is known."""

    mean: float
    """Mean of the end [rad]."""
    deviations: tuple[Deviation, ...] = ()
    """Independent deviations of the end from it, of one row; none where it is known."""

    @property
    def variance(self) -> float:
        """[rad^2]."""
        return (self.mean**2 + self._spread) / 3.0 - 0.25 * self.mean**2

    @property
    def reach(self) -> float:
        """Beyond which it is hardly ever [rad]."""
        return abs(self.mean) + sum(float(x.reach[0]) for x in self.deviations)

    @property
    def _spread(self) -> float:
        return sum(float(x.variance[0]) for x in self.deviations)

    def transform(self, at: np.ndarray) -> np.ndarray:
        """Characteristic function at ``at`` (m,) [1/rad], evenly spaced from their spacing up, (1, m).

        That of the end times a part t of the time that is uniform from 0 to 1: the mean of the end's
        own from 0 to each.
        """
        if not self.deviations:
            half = 0.5 * self.mean * at
            return np.asarray(np.exp(1j * half) * np.sinc(half / np.pi))[None]
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        step = float(at[0])
        places = (at[:, None] - 0.5 * step + 0.5 * step * nodes).ravel()
        own = np.exp(1j * self.mean * places)
        for one in self.deviations:
            own = own * one.transform(places)[0]
        whole = np.cumsum(own.reshape(-1, _NODES) @ (0.5 * step * weights))
        return np.asarray(whole / at)[None]


@dataclass(frozen=True)
class ErrorRows:
    """Independent errors that add to lines and noise, in rows (n,) that go with those of the lines,
    or one for all.
    """

    mean: np.ndarray
    """Known part of their sum, with its sign [rad], (n,)."""
    deviations: tuple[Deviation, ...] = ()
    ramps: tuple[Ramp, ...] = ()

    @property
    def known(self) -> bool:
        """Whether they are their mean alone."""
        return not self.deviations and not self.ramps

    @property
    def reach(self) -> np.ndarray:
        """Beyond which they are hardly ever together, (n,) [rad]."""
        normal = sum((x.reach**2 for x in self.deviations if x.kind == "normal"), np.zeros(1))
        others = sum((x.reach for x in self.deviations if x.kind != "normal"), np.zeros(1))
        ramps = sum(ramp.reach for ramp in self.ramps)
        return np.asarray(np.abs(self.mean) + np.sqrt(normal) + others + ramps)

    @property
    def mean_square(self) -> np.ndarray:
        """(n,) [rad^2]."""
        mean = self.mean + 0.5 * sum(ramp.mean for ramp in self.ramps)
        spread = sum((x.variance for x in self.deviations), np.zeros(1))
        return np.asarray(mean**2 + spread + sum(ramp.variance for ramp in self.ramps))

    def crest(self, noise: np.ndarray | float = 0.0, sigmas: float = SIGMAS) -> np.ndarray:
        """The most that they make together with noise of mean squares [rad^2], of all rows or of each
        (n,), (n,) [rad]: all at their largest, and so many standard deviations of what is normal.

        That is where each ramp begins or ends, whichever is more.
        """
        found = []
        for ended in product((False, True), repeat=len(self.ramps)):
            ramps = [ramp for ramp, has in zip(self.ramps, ended, strict=True) if has]
            mean = self.mean + sum(ramp.mean for ramp in ramps)
            spreads = [*self.deviations, *(x for ramp in ramps for x in ramp.deviations)]
            normal = sum((x.variance for x in spreads if x.kind == "normal"), np.zeros(1))
            others = sum((x.size for x in spreads if x.kind != "normal"), np.zeros(1))
            found.append(np.abs(mean) + others + sigmas * np.sqrt(normal + noise))
        return np.asarray(np.max(np.broadcast_arrays(*found), axis=0))

    def transform(self, at: np.ndarray) -> np.ndarray:
        """Characteristic function at ``at`` (m,) [1/rad], evenly spaced from their spacing up, (n,
        m) or (1, m); complex.
        """
        found = np.exp(1j * np.outer(self.mean, at))
        for deviation in self.deviations:
            found = found * deviation.transform(at)
        for ramp in self.ramps:
            found = found * ramp.transform(at)
        return np.asarray(found)

    def with_noise(self, sigma: np.ndarray | float) -> ErrorRows:
        """Errors with normal noise besides of ``sigma`` [rad], of all rows or of each, (n,)."""
        if not np.any(sigma):
            return self
        noise = Deviation("normal", np.atleast_1d(sigma))
        return ErrorRows(self.mean, (*self.deviations, noise), self.ramps)
