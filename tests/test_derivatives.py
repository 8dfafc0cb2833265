"""Derivatives of a steady state's lines, beside differences of steady states that are solved for."""

import numpy as np
import pytest
from support.scenarios import random_scenario

import microvib as mv
from microvib.errors import MicrovibError
from microvib.solve.steady.derivatives import NotDifferentiable
from microvib.solve.steady.state import SteadyState, steady_state

KEYS = (
    "reducer.stiffness",
    "reducer.damping",
    "motor.detent_torque",
    "motor.friction.viscous",
    "friction.coulomb",
    "tracking.rate",
)
LINES = (1, 15, 16, 17, 32)
"""full_step_1, drive_1 with its side lines and drive_2 of state 1: higher ones show the sampling of a
solved state."""
STEP = 2e-3


@pytest.fixture(scope="module")
def state() -> SteadyState:
    """Steady state of a drive whose output sticks in every microstep."""
    return steady_state("state-1")


def _with(scenario: mv.Scenario, key: str, factor: float) -> mv.Scenario:
    changes = {key: scenario[key] * factor}
    if key == "tracking.rate":
        changes["record.settle"] = scenario["record.settle"] / factor
    return scenario.with_si(changes)


@pytest.mark.parametrize("key", KEYS)
def test_they_are_those_of_steady_states_that_are_solved_for(state: SteadyState, key: str) -> None:
    fine = state.scenario.with_si({"solver.refinement": 4})
    found = state.derivatives([key], LINES).relative[0].real
    below, above = (
        np.abs(steady_state(_with(fine, key, factor)).harmonics()[list(LINES)])
        for factor in (1.0 - STEP, 1.0 + STEP)
    )
    solved = np.log(above / below) / np.log((1.0 + STEP) / (1.0 - STEP))
    assert found == pytest.approx(solved, rel=0.01, abs=2e-3)


def test_fourier_coefficients_of_steps_are_those_of_samples(state: SteadyState) -> None:
    amplitudes = state.derivatives(["reducer.damping"], LINES).amplitudes
    assert np.abs(amplitudes) == pytest.approx(np.abs(state.harmonics()[list(LINES)]), rel=1e-4)


def test_detent_and_torque_constant_scale_the_full_step_line(state: SteadyState) -> None:
    """At rest under detent the line is as the detent torque over the motor's stiffness."""
    by_detent, by_constant = state.derivatives(
        ["motor.detent_torque", "motor.torque_constant"], [1]
    ).relative[:, 0]
    assert by_detent.real == pytest.approx(1.0, abs=0.03)
    assert by_constant.real == pytest.approx(-1.0, abs=0.03)


def test_a_kink_has_no_derivative() -> None:
    """Sticks that are about to drop out: differences to both sides disagree, and nothing is given."""
    scenario = random_scenario(20)
    kinked = steady_state(scenario).derivatives(["motor.torque_constant", "motor.friction.viscous"])
    large = np.abs(kinked.amplitudes) > 3e-3 * np.abs(kinked.amplitudes).max()
    assert np.mean(np.isnan(kinked.derivatives[:, large])) > 0.5


def test_what_has_none_is_refused(state: SteadyState) -> None:
    with pytest.raises(MicrovibError, match=r"driver\.microsteps: 16 has no derivative"):
        state.derivatives(["driver.microsteps"])
    memory = state.scenario.with_({"friction.presliding": {"stiffness": "2000 N*m/rad"}})
    with pytest.raises(NotDifferentiable, match="memory"):
        steady_state(memory).derivatives(["reducer.damping"])
