"""Torque noise so slow that a record sees one value of it: what other values may make of the drive.

The output's friction is then another from draw to draw, and with it where the shaft sticks, which
side of a backlash the teeth are on, and how far the motor lags. Each of these switches a torque that
is no larger than the noise; a line of it is bounded by the drive's response to that torque, as lines
of friction above the passband are (``microvib.analysis.unseen``). Draws show it
(tests/test_noise_verdicts.py): with lines that backlash makes, a tenth of this bound was seen at most.
"""

from __future__ import annotations

import math

import numpy as np

from microvib.model.drive_matrices import coordinates
from microvib.model.linear import coupled_modes, disturbance_torque_response
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.model.slow_variations import NEGLIGIBLE_SHARE

CYCLES_OF_NOISE = 4.0
"""Cycles in a record below which it sees too little of noise to know what it does to the drive;
assumed: two, after which a periodic change is seen as a whole, in each half."""
_SIGMAS = 2.0
"""Standard deviations of slow noise within which 95 % of its values are."""
_LINE_OF_BOUNDED = 4.0 / math.pi
"""Largest line of a torque that never exceeds 1: that of a square wave."""
_POINTS = 600
"""Frequencies at which a density is added up, and the drive is looked at, besides its modes."""


def slow_noise_torque(scenario: Scenario, duration: float) -> float:
    """Root mean square [N m] of the torque noise of which a record of ``duration`` [s] sees fewer
    than CYCLES_OF_NOISE cycles; 0 without noise.
    """
    noise = scenario.friction.torque_noise
    if noise is None or noise.silent:
        return 0.0
    low, high = noise.band(scenario.record.sample_rate)
    high = min(high, CYCLES_OF_NOISE / duration)
    if not high > low:
        return 0.0
    rows = np.array([f for f, _ in noise.table if low < f < high])
    at = np.union1d(np.linspace(low, high, _POINTS), rows)
    return math.sqrt(float(np.trapezoid(noise.at(at, scenario.record.sample_rate), at)))


def slow_noise_bound(scenario: Scenario, duration: float, frequency: np.ndarray) -> np.ndarray:
    """Upper bounds [N m] of what slow noise may add to a line at each ``frequency`` (n,) [Hz]."""
    size = _SIGMAS * slow_noise_torque(scenario, duration)
    if size <= NEGLIGIBLE_SHARE * scenario.friction.largest_torque or not frequency.size:
        return np.zeros(frequency.size)
    modes = (mode.frequency for mode in coupled_modes(scenario))
    switching = max(scenario.driving_frequency or 0.0, *modes, 0.0)
    falling = np.minimum(1.0, 2.0 * switching / np.maximum(frequency, 1e-9))
    output = coordinates(scenario.reducer, len(scenario.load.H))[1]
    return (
        _LINE_OF_BOUNDED * size * falling * disturbance_torque_response(scenario, frequency, output)
    )


def slow_noise_places(scenario: Scenario, duration: float, band: tuple[float, float]) -> np.ndarray:
    """Frequencies (n,) [Hz] within a ``band`` [Hz] of the record's passband at which that bound is
    looked at: evenly spread, and those of modes.
    """
    low = max(band[0], 1.0 / duration)
    high = min(band[1], PASSBAND * scenario.record.sample_rate)
    if high < low:
        return np.zeros(0)
    modes = np.array([mode.frequency for mode in coupled_modes(scenario)])
    return np.union1d(np.geomspace(low, high, _POINTS), modes[(modes > low) & (modes < high)])
