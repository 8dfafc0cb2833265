"""Modes that noise keeps ringing: what their lines read in a record, in closed form, by the
linearised drive.

The noise is that of the output's friction: torque noise, and roughness that the output turns past
at its rate. A stuck shaft swallows both, which the linearised drive knows nothing of: where the
output sticks, a line is smaller.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.model.linear import dynamic_stiffness, momentum_row
from microvib.model.scenario import Scenario
from microvib.results import former_field

MAX_E_FOLDINGS = 4.0
"""e-foldings of a mode within a record up to which one decaying tone describes it; beyond, its line
is a band.
"""
RAYLEIGH_P95 = math.sqrt(math.log(20.0))
"""The 95 % quantile of a Rayleigh distribution over its root mean square."""
_PARTS = 400


@dataclass(frozen=True)
class NoiseDrivenLine:
    """Amplitude, 0-to-peak [N m], that noise alone gives a mode's line in a record, over draws."""

    name: str
    mean: float
    deviation: float
    quantile: float
    """95 % of the draws are below it."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            return former_field(self, name, {"line": "name"})


def noise_density(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """One-sided density [N^2 m^2/Hz] of the noise of the output's friction at each ``frequency``
    (n,) [Hz].

    Roughness of density S in cycles per turn makes T_f^2 S(f/n)/n at n turns per second; none where
    the rate changes or is zero.
    """
    friction, rate, density = scenario.friction, scenario.rate, np.zeros(np.shape(frequency))
    if friction.torque_noise is not None:
        density += friction.torque_noise.at(frequency, scenario.record.sample_rate)
    if friction.position is not None and friction.position.roughness is not None and rate:
        turns = abs(rate) / (2.0 * math.pi)
        density += (
            friction.torque(rate) ** 2 * friction.position.roughness.at(frequency / turns) / turns
        )
    return density


def noise_bands(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """The band [Hz] of each kind of that noise, by its key; of roughness where the output turns at
    a constant rate.
    """
    friction, rate, bands = scenario.friction, scenario.rate, {}
    if friction.torque_noise is not None and not friction.torque_noise.silent:
        bands["friction.torque_noise"] = friction.torque_noise.band(scenario.record.sample_rate)
    if friction.position is None:
        rough = None
    else:
        rough = friction.position.roughness
    if rough is not None and rough.deviation > 0.0 and rate:
        turns = abs(rate) / (2.0 * math.pi)
        bands["friction.position.roughness"] = rough.band[0] * turns, rough.band[1] * turns
    return bands


def friction_to_disturbance(scenario: Scenario, frequency: float) -> complex:
    """T_d over a torque of friction on the output at a ``frequency`` [Hz], by the linearised drive."""
    dynamic, omega = dynamic_stiffness(scenario, frequency), 2.0 * math.pi * frequency
    pull = np.zeros(dynamic.shape[0])
    if scenario.reducer.rigid:
        pull[0] = 1.0 / scenario.reducer.h
    else:
        pull[1] = -1.0
    motion = np.linalg.solve(dynamic, pull)
    return complex(omega**2 * (momentum_row(scenario, frequency) @ motion))


def noise_bin_amplitude(scenario: Scenario, frequency: float, duration: float) -> float:
    """Root mean square amplitude [N m] of a bin of a record of ``duration`` [s] by noise alone; 0
    where there is none.
    """
    S = float(noise_density(scenario, np.array([frequency]))[0])
    if S > 0.0:
        return abs(friction_to_disturbance(scenario, frequency)) * math.sqrt(2.0 * S / duration)
    return 0.0


def noise_driven_lines(
    scenario: Scenario, duration: float, expected: Sequence[ExpectedLine]
) -> tuple[NoiseDrivenLine, ...]:
    """Contribution of noise alone to those of the ``expected`` lines that are array modes in a record of
    ``duration`` [s], where it reaches them.

    A mode of frequency f and decay rate sigma has an envelope of mean square abs(G(f))^2 S sigma,
    with G the ``friction_to_disturbance`` and S the density, averaged over the resonance. It varies
    as exp(-sigma t), and one decaying tone follows it through ``MAX_E_FOLDINGS`` e-foldings of a
    record: the mean read is that of the envelope, sqrt(pi)/2 of its root mean square (Rayleigh),
    the deviation that of its mean over the record, which has 2 (a - 1 + exp(-a))/a^2 of the
    variance after a = sigma T.
    """
    found = []
    for mode in (line for line in expected if line.is_mode):
        sigma, fold = mode.decay, mode.decay * duration
        if not 0.0 < fold <= MAX_E_FOLDINGS:
            continue
        angles = math.pi * (
            (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
        )  # of equal parts of the resonance
        S = float(
            np.mean(
                noise_density(scenario, mode.frequency + sigma / (2.0 * math.pi) * np.tan(angles))
            )
        )
        if S == 0.0:
            continue
        size = abs(friction_to_disturbance(scenario, mode.frequency)) * math.sqrt(S * sigma)
        if fold > 1e-3:
            left = 2.0 * (fold - 1.0 + math.exp(-fold)) / fold**2
        else:
            left = 1.0
        mean, deviation = (
            0.5 * math.sqrt(math.pi) * size,
            math.sqrt((1.0 - 0.25 * math.pi) * left) * size,
        )
        beyond = (RAYLEIGH_P95 - 0.5 * math.sqrt(math.pi)) / math.sqrt(1.0 - 0.25 * math.pi)
        found.append(NoiseDrivenLine(mode.name, mean, deviation, mean + beyond * deviation))
    return tuple(found)
