"""Amplitudes that the noise of the output's friction makes in a record of T_d, at every frequency, in
closed form by the linearised drive.

Noise of density S on the output makes abs(G)^2 S in T_d, with G as ``friction_to_disturbance``. A bin
of a record under a Hann window reads an amplitude whose mean square is twice that density, weighted
with the square of the window's response. Over draws it has a Rayleigh distribution. The largest of
several bins stays below a level at least as often as independent bins would (Gaussian correlation
inequality).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from microvib.model.drive_matrices import coordinates
from microvib.model.driven import noise_bands, noise_density
from microvib.model.linear import coupled_modes, disturbance_torque_response
from microvib.model.scenario import Scenario

QUANTILE = 0.95
"""Part of the draws that the largest amplitude of a band is given for."""
_REACH = 2.0
"""Bins on either side within which a Hann window sees a tone; beyond, less than a thirtieth of it."""
_PARTS = 32
"""Equal parts of that reach in which the window's response is taken for constant."""
_NODES = 2000
"""Frequencies at which the density is known, besides those about modes and at ends of bands."""
_NODES_OF_MODE = 60
_MOST_BINS = 200_000
"""Bins that are looked at one by one; of more, each stands for several."""
_SMALL = 1e-4
"""Part of the largest mean square below which bins do not count."""


@dataclass(frozen=True)
class NoiseAmplitudes:
    """Amplitudes, 0-to-peak [N m], that noise alone makes in the bins of a record."""

    frequency: np.ndarray
    """[Hz], (n,)."""
    mean_square: np.ndarray
    """Mean over draws of the squared amplitude [N^2 m^2], (n,)."""
    number: float = 1.0
    """How many bins each stands for."""

    def quantile(self, probability: float = QUANTILE) -> float:
        """The amplitude [N m] that no bin exceeds in so many of the draws; 0 without noise."""
        from scipy.optimize import brentq  # slow to import, and seldom needed

        top = float(np.max(self.mean_square, initial=0.0))
        if top == 0.0:
            return 0.0
        relative = self.mean_square[self.mean_square > _SMALL * top] / top
        wanted = math.log(probability)

        def excess(level: float) -> float:
            within = np.log1p(-np.exp(-level / relative))
            return self.number * float(np.sum(within)) - wanted

        most = math.log(self.number * relative.size / (1.0 - probability)) + 1.0
        least = 0.5 * -math.log1p(-(probability ** (1.0 / self.number)))
        return math.sqrt(top * float(brentq(excess, least, most)))

    @property
    def loudest(self) -> float:
        """Frequency [Hz] of the bin with the most noise; nan without any."""
        if not self.frequency.size:
            return math.nan
        return float(self.frequency[np.argmax(self.mean_square)])


def noise_amplitudes(
    scenario: Scenario, duration: float, low: float = 0.0, high: float = math.inf
) -> NoiseAmplitudes:
    """Amplitudes of noise alone in the bins between two frequencies [Hz] of a record of ``duration``
    [s], as if the shaft always slid; none where nothing is noisy.
    """
    nothing = NoiseAmplitudes(np.empty(0), np.empty(0))
    bands = list(noise_bands(scenario).values())
    if not bands:
        return nothing
    beside = _REACH / duration
    ends = (
        max(low, min(band[0] for band in bands) - beside),
        min(high, max(band[1] for band in bands) + beside),
    )
    if ends[0] > ends[1]:
        return nothing
    first, last = max(math.ceil(ends[0] * duration - 0.5), 1), ends[1] * duration + 0.5
    if last < first:
        return nothing
    count = math.floor(last) - first + 1
    number = max(math.ceil(count / _MOST_BINS), 1)
    at = (first + np.arange(0, count, number)) / duration
    return NoiseAmplitudes(at, mean_square_amplitudes(scenario, at, duration), float(number))


def torque_of_noise(scenario: Scenario) -> float:
    """Root mean square of the noise on the output [N m]."""
    if not noise_bands(scenario):
        return 0.0
    nodes = _nodes(scenario, 0.0, math.inf)
    return math.sqrt(float(np.trapezoid(noise_density(scenario, nodes), nodes)))


def rms_of_noise(scenario: Scenario, low: float, high: float) -> float:
    """Root mean square [N m] of what noise makes of T_d between two frequencies [Hz]."""
    if not noise_bands(scenario):
        return 0.0
    nodes = _nodes(scenario, low, high)
    nodes = np.unique(np.clip(nodes, low, high))
    output = coordinates(scenario.reducer, len(scenario.load.H))[1]
    density = disturbance_torque_response(scenario, nodes, output) ** 2 * noise_density(
        scenario, nodes
    )
    return math.sqrt(float(np.trapezoid(density, nodes)))


def crest_of_noise(cycles: float) -> float:
    """Peak of noise, over its root mean square, that 95 % of the draws of so many ``cycles`` of the highest
    frequency stay below: two peaks of either sign in a cycle, taken as independent.
    """
    return math.sqrt(2.0 * math.log(max(2.0 * cycles, 1.0) / (1.0 - QUANTILE)))


def mean_square_amplitudes(
    scenario: Scenario, frequency: np.ndarray, duration: float
) -> np.ndarray:
    """Mean squares of the amplitudes that noise alone makes at frequencies of a record.

    Parameters
    ----------
    scenario : Scenario
        Drive and noise.
    frequency : ndarray
        Frequencies [Hz], (n,).
    duration : float
        Length of the record [s].

    Returns
    -------
    ndarray
        Mean over draws of what a Hann window reads there, squared [N^2 m^2], (n,).
    """
    if not frequency.size or not noise_bands(scenario):
        return np.zeros(frequency.size)
    beside = _REACH / duration
    nodes = _nodes(scenario, float(frequency.min()) - beside, float(frequency.max()) + beside)
    output = coordinates(scenario.reducer, len(scenario.load.H))[1]
    response = disturbance_torque_response(scenario, nodes, output)
    density = response**2 * noise_density(scenario, nodes)
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(nodes)
    power = np.concatenate([[0.0], np.cumsum(steps)])
    edges = np.linspace(-_REACH, _REACH, _PARTS + 1)
    weights = _window_response(0.5 * (edges[1:] + edges[:-1])) ** 2
    found = np.zeros(frequency.size)
    before = np.interp(frequency + edges[0] / duration, nodes, power)
    for edge, weight in zip(edges[1:], weights, strict=True):
        after = np.interp(frequency + edge / duration, nodes, power)
        found += 2.0 * weight * (after - before)
        before = after
    return found


def _window_response(bins: np.ndarray) -> np.ndarray:
    """Response of a Hann window to a tone that is so many bins (n,) beside its own."""
    with np.errstate(divide="ignore", invalid="ignore"):
        response = np.sinc(bins) / (1.0 - bins**2)
    return np.where(np.isclose(np.abs(bins), 1.0), 0.5, response)


def _nodes(scenario: Scenario, low: float, high: float) -> np.ndarray:
    """Frequencies (n,) [Hz], ascending, between which the density of T_d is straight enough."""
    found: list[np.ndarray] = []
    for first, last in noise_bands(scenario).values():
        start, end = max(first, low, 1e-9), min(last, high)
        if end > start:
            edges = np.array([first, last])
            found += [
                np.geomspace(start, end, _NODES),
                np.linspace(start, end, _NODES // 8),
                edges * (1.0 - 1e-9),
                edges,
                edges * (1.0 + 1e-9),
            ]
    found += list(_table_frequencies(scenario))
    angles = math.pi * (np.arange(1, _NODES_OF_MODE) / _NODES_OF_MODE - 0.5)
    for mode in coupled_modes(scenario):
        width = abs(mode.decay) / (2.0 * math.pi)
        found.append(mode.frequency + width * np.tan(angles))
    nodes = np.unique(np.concatenate(found))
    return nodes[(nodes > 0.0) & (nodes < 1e9)]


def _table_frequencies(scenario: Scenario) -> Iterator[np.ndarray]:
    """Frequencies [Hz] of the rows of the noise's tables."""
    friction = scenario.friction
    if friction.torque_noise is not None and friction.torque_noise.table:
        yield np.array(friction.torque_noise.table)[:, 0]
    rough = friction.position and friction.position.roughness
    if rough and rough.table and scenario.rate:
        yield np.array(rough.table)[:, 0] * abs(scenario.rate) / (2.0 * math.pi)
