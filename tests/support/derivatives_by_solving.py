"""Derivatives of lines by keys of a scenario, by solving for two more steady states."""

from __future__ import annotations

import numpy as np

import microvib as mv
from microvib.solve.steady.period import PeriodMap
from microvib.solve.steady.state import steady_state


def amplitudes(scenario: mv.Scenario, orders: list[int]) -> np.ndarray:
    """Complex amplitudes [N m] whose phases are those on the step clock, as derivatives have them."""
    state, k = steady_state(scenario), np.array(orders)
    period = PeriodMap(scenario, state.microsteps)
    clock = period.start - period.after_clock
    turned = 2j * np.pi * k * state.frequency * (clock - scenario.record.settle)
    return np.asarray(state.harmonics("T_d")[k] * np.exp(turned))


def relative_derivatives(scenario: mv.Scenario, key: str, orders: list[int]) -> np.ndarray:
    """d ln c / d ln p, (k,), by a change of the key by a thousandth to both sides."""
    value = scenario[key]
    above, below = (
        amplitudes(scenario.with_si({key: value * (1.0 + change)}), orders)
        for change in (1e-3, -1e-3)
    )
    return np.asarray((above - below) / (2e-3 * amplitudes(scenario, orders)))
