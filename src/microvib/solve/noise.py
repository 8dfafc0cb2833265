"""Random friction of the output: one draw of a Gaussian process with a given density,
smooth in time or in angle.
"""

from __future__ import annotations

import math

import numpy as np

from microvib.errors import SimulationError
from microvib.model.scenario import Scenario

KNOTS_PER_PERIOD = 8.0
"""Knots per period of the highest frequency; cubics through values and slopes at them are within
1e-4 of it.
"""
MAX_KNOTS = 1 << 23
"""Largest number of knots of a run: 134 MB."""


def torque_noise(scenario: Scenario) -> tuple[np.ndarray, float]:
    """Values and slopes per knot, one after another (2 n,), and knots per second; empty without
    noise.

    The draw has random phases and amplitudes at all multiples of 1 / (its length), which is that of
    the run at least: another length of the run is another draw. Raises SimulationError where a run
    needs more knots than can be kept.
    """
    noise, record = scenario.friction.torque_noise, scenario.record
    if noise is None or noise.silent:
        return np.zeros(0), 0.0
    high = noise.band(record.sample_rate)[1]
    rate = KNOTS_PER_PERIOD * high
    needed = (record.settle + record.duration) * rate
    if needed > MAX_KNOTS:
        raise SimulationError(
            f"friction.torque_noise: a run of {record.settle + record.duration:g} s with noise up"
            f" to {high:g} Hz needs"
            f" {needed:.2g} values; at most {MAX_KNOTS:.2g} are kept; lower"
            " friction.torque_noise.highest"
        )
    n = 1 << max(math.ceil(needed) + 1, 16).bit_length()
    return _draw(
        noise.at(np.fft.rfftfreq(n, 1.0 / rate), record.sample_rate), n, rate, noise.seed
    ), rate


def roughness(scenario: Scenario) -> tuple[np.ndarray, float]:
    """Roughness of friction over the angle, for one turn of the output, and knots per radian; parts
    of the friction.
    """
    position = scenario.friction.position
    rough = position.roughness if position else None
    if rough is None or rough.deviation == 0.0:
        return np.zeros(0), 0.0
    n = 1 << (max(math.ceil(KNOTS_PER_PERIOD * rough.band[1]), 16) - 1).bit_length()
    return _draw(rough.at(np.arange(n // 2 + 1.0)), n, n, rough.seed), n / (2.0 * math.pi)


def _draw(density: np.ndarray, n: int, rate: float, seed: int) -> np.ndarray:
    """Values and slopes per knot, (2 n,), of a process with a one-sided ``density`` (n/2 + 1,) at
    the multiples of rate / n.
    """
    f = np.fft.rfftfreq(n, 1.0 / rate)
    draw = np.random.default_rng(seed).standard_normal((f.size, 2)) @ np.array([1.0, -1j])
    spectrum = np.where(density > 0.0, 0.5 * n * np.sqrt(density * rate / n) * draw, 0.0)
    values, slopes = (np.fft.irfft(x, n) for x in (spectrum, spectrum * 2j * np.pi * f / rate))
    return np.column_stack([values, slopes]).ravel()
