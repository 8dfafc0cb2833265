"""Torque noise of the output's friction: one draw of a Gaussian process with a given density, smooth in time."""

from __future__ import annotations

import math

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario

KNOTS = 8.0
"""Knots per period of the highest frequency; cubics through values and slopes at them are within 1e-4 of it."""
MOST_KNOTS = 1 << 23
"""Of a run: 134 MB."""


def torque_noise(scenario: Scenario) -> tuple[np.ndarray, float]:
    """Values and slopes per knot, one after another (2 n,), and knots per second; empty without noise.

    The draw has random phases and amplitudes at all multiples of 1 / (its length), which is that of the run at least: another
    length of the run is another draw. Raises SimulationError where a run needs more knots than can be kept.
    """
    noise, record = scenario.friction.torque_noise, scenario.record
    if noise is None or noise.density == 0.0:
        return np.zeros(0), 0.0
    low, high = noise.band(record.sample_rate)
    rate = KNOTS * high
    needed = (record.settle + record.duration) * rate
    if needed > MOST_KNOTS:
        raise SimulationError(
            f"friction.torque_noise: a run of {record.settle + record.duration:g} s with noise up to {high:g} Hz needs"
            f" {needed:.2g} values; at most {MOST_KNOTS:.2g} are kept; lower friction.torque_noise.highest"
        )
    n = 1 << max(math.ceil(needed) + 1, 16).bit_length()
    f = np.fft.rfftfreq(n, 1.0 / rate)
    draw = np.random.default_rng(noise.seed).standard_normal((f.size, 2)) @ np.array([1.0, -1j])
    inside = (f > 0.0) & (f >= low) & (f <= high)
    spectrum = np.where(inside, 0.5 * n * np.sqrt(noise.density * rate / n) * draw, 0.0)
    values, slopes = (np.fft.irfft(x, n) for x in (spectrum, spectrum * 2j * np.pi * f / rate))
    return np.column_stack([values, slopes]).ravel(), rate
