"""Modes that a change of rate excites, with their uncertainty and what they may ring with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.studies.profiles.rate_profile import RateProfile

GRID_SHARE = 0.01
"""Part of what is allowed by which a residual may be overstated between points."""
_MOST_POINTS = 200_000
"""Points, at most."""


@dataclass(frozen=True)
class UncertainMode:
    """A mode over the ranges of its frequency and damping, and its largest residual."""

    name: str
    frequency: float
    """Nominal frequency [Hz], damped, as it rings."""
    damping: float
    spread: float
    """Part of the frequency by which it may be off either way."""
    dampings: tuple[float, float]
    """Ends of the range of its damping ratio."""
    gain: float
    """Amplitude of T_d that a step of the rate by one leaves ringing, nominal [N m s/rad]."""
    allowed: float = math.inf
    """Largest residual of a change of rate by one."""

    def eigenvalue(self, factor: float = 1.0) -> complex:
        """Eigenvalue [1/s] at the nominal damping and ``factor`` times the frequency."""
        return complex(
            _eigenvalues(np.array([factor * self.frequency]), np.array([self.damping]))[0]
        )

    def eigenvalues(self, frequencies: int, dampings: int) -> np.ndarray:
        """Eigenvalues [1/s] at even points over both ranges, (n,)."""
        f, zeta = self._points(frequencies, dampings)
        return _eigenvalues(f, zeta)

    def _points(self, frequencies: int, dampings: int) -> tuple[np.ndarray, np.ndarray]:
        f = self.frequency * np.linspace(1.0 - self.spread, 1.0 + self.spread, frequencies)
        zeta = np.linspace(*self.dampings, dampings if self.dampings[1] > self.dampings[0] else 1)
        grid = np.meshgrid(f, zeta, indexing="ij")
        return grid[0].ravel(), grid[1].ravel()

    def nominal_residual(self, profile: RateProfile) -> float:
        """Residual ``|R|`` of a profile at the nominal values."""
        return float(abs(profile.residual(np.array([self.eigenvalue()]))[0]))

    def worst_residual(self, profile: RateProfile, size: float = 1.0) -> float:
        """Upper bound on the residual ``|R|`` of a profile over both ranges.

        R(s) has no singularity, so that ``|R|`` is largest at the edge of the region of eigenvalues: at
        its four straight sides. Between points on these it is bounded by the slope that R has at
        most. The points are as close as it takes to overstate by ``GRID_SHARE`` of what is allowed,
        times ``size``.
        """
        corners = self._corners()
        sides = list(zip(corners, np.roll(corners, -1), strict=True))
        slope = profile.residual_slope(-float(np.max(corners.real)))
        aim = GRID_SHARE * size * (self.allowed if math.isfinite(self.allowed) else 1.0)
        spacing = max(
            2.0 * aim / max(slope, 1e-300), sum(abs(b - a) for a, b in sides) / _MOST_POINTS
        )
        bound = 0.0
        for first, last in sides:
            count = math.ceil(abs(last - first) / spacing)
            s = first + (last - first) * np.linspace(0.0, 1.0, count + 1)
            between = 0.5 * slope * abs(last - first) / max(count, 1)
            bound = max(bound, float(np.max(np.abs(profile.residual(s)))) + between)
        return bound

    def _corners(self) -> np.ndarray:
        """Eigenvalues [1/s] at the ends of both ranges, complex (4,), in turn."""
        low, high = self.frequency * (1.0 - self.spread), self.frequency * (1.0 + self.spread)
        light, heavy = self.dampings
        return _eigenvalues(
            np.array([low, high, high, low]), np.array([light, light, heavy, heavy])
        )


def _eigenvalues(frequency: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Eigenvalues [1/s] of damped frequencies [Hz] and damping ratios, (n,)."""
    omega_d = 2.0 * math.pi * frequency
    return np.asarray(-damping / np.sqrt(1.0 - damping**2) * omega_d + 1j * omega_d)
