"""Steady states that are searched for many scenarios at once, in place of runs."""

import math

import numpy as np
import pytest

import microvib as mv
from microvib.analysis.lines import lines_by_name, lines_by_name_of_steady_state, lines_of_samples
from microvib.solve.batch import simulate_torques
from microvib.solve.steady.period import NotPeriodic, PeriodMap
from microvib.solve.steady.search import Search
from microvib.solve.steady.state import (
    SteadyState,
    is_searched,
    steady_by_search,
    steady_state,
)

LINES = [f"drive_{k}" for k in range(1, 9)] + ["full_step_1", "array_mode_1"]
BESIDE_ANOTHER = {
    "reducer.stiffness": 4821.076998,
    "motor.friction.viscous": 0.016831035,
    "array.rigid_inertia": 0.161494216,
    "motor.detent_torque": 0.009544597678,
    "reducer.damping": 0.5140923554,
}
"""Of a drive like state 1 that has two motions, of which the mean motion leads to the other one."""


@pytest.fixture(scope="module")
def searched(state_1: mv.Scenario) -> SteadyState:
    return steady_by_search(state_1)


FRICTIONLESS = {
    "friction.coulomb": 0.0,
    "friction.breakaway": 0.0,
    "motor.friction.coulomb": 0.0,
    "motor.friction.breakaway": 0.0,
}


@pytest.mark.parametrize("changes", [{}, FRICTIONLESS], ids=["friction", "none"])
def test_a_deviation_rings_as_what_is_left_of_a_start(
    state_1: mv.Scenario, changes: dict[str, float]
) -> None:
    """By the lines of a run in time, late enough that the deviation is small; asked for with a frequency
    and a decay that are off."""
    scenario = state_1.with_si(changes)
    late = scenario.with_si({"record.settle": 60.0, "record.duration": 30.0})
    torque = mv.simulate(late, channels="T_d")["T_d"]
    run = lines_of_samples(torque, late.record.sample_rate, late)
    seen = next(line for line in run if line.is_mode)
    frequency, decay = steady_by_search(scenario).ringing(1.02 * seen.frequency, 0.5 * seen.decay)
    assert frequency == pytest.approx(seen.frequency, rel=1e-3)
    assert decay == pytest.approx(seen.decay, rel=0.02)


def test_of_nothing_that_decays_slowly_nothing_is_known(searched: SteadyState) -> None:
    settled = SteadyState(**{**vars_of(searched), "slow_multipliers": None})
    assert all(math.isnan(x) for x in settled.ringing(1.0, 0.1))


def vars_of(state: SteadyState) -> dict:
    """Fields of a steady state."""
    return {name: getattr(state, name) for name in state.__dataclass_fields__}


def test_integrated_harmonics_converge_to_lines_of_a_run(state_1: mv.Scenario) -> None:
    """At 426 Hz, too, where steps of the solution's own size would be off by 4 %."""
    run = late_lines(state_1)
    orders, errors = np.arange(1, 9), []
    for refinement in (1, 4):
        state = steady_by_search(state_1.with_si({"solver.refinement": refinement}))
        found = np.abs(state.integrated_harmonics(orders * state.microsteps))
        errors.append(
            [abs(x / run[f"drive_{k}"] - 1.0) for k, x in zip(orders, found, strict=True)]
        )
    own, finer = np.array(errors)
    assert np.max(own) < 1e-3
    assert np.max(finer) < 1e-3


def test_integrated_harmonics_have_the_phases_of_samples(searched: SteadyState) -> None:
    """Those at the first sample of the record."""
    orders = searched.microsteps * np.arange(1, 5)
    ratio = searched.integrated_harmonics(orders) / searched.harmonics()[orders]
    np.testing.assert_allclose(np.angle(ratio), 0.0, atol=1e-3)


def late_lines(scenario: mv.Scenario) -> dict[str, float]:
    """Amplitudes [N m] of a run after five minutes."""
    late = scenario.with_si({"record.settle": 300.0, "record.duration": 20.0})
    (torque,) = simulate_torques([late])
    return {line.name: line.amplitude for line in lines_by_name(torque, late, LINES)}


def test_lines_are_those_of_a_late_run(state_1: mv.Scenario) -> None:
    run = late_lines(state_1)
    for line in lines_by_name_of_steady_state(steady_by_search(state_1), LINES):
        if not line.is_mode:
            assert line.amplitude == pytest.approx(run[line.name], rel=0.04), line.name


def test_of_two_motions_the_one_is_found_that_a_start_from_rest_leads_to() -> None:
    """The search begins as every run does, at rest; from the mean motion it ends at the other one,
    whose fifth driving line is three times as large."""
    scenario = mv.load_scenario("state-1").with_si(BESIDE_ANOTHER)
    run = late_lines(scenario)["drive_5"]
    found = steady_by_search(scenario).harmonics()[5 * 16]
    assert abs(found) == pytest.approx(run, rel=0.02)
    other = Search(PeriodMap(scenario, 16), segments=1)
    other._converge(other._begin(0))
    tones = np.abs(np.fft.rfft(other.ends.T_d)) * 2.0 / other.ends.T_d.size
    assert tones[5 * 16] > 2.0 * run


def test_a_search_from_near_by_finds_what_one_from_rest_does(
    state_1: mv.Scenario, searched: SteadyState
) -> None:
    other = state_1.with_si({"reducer.stiffness": 1.01 * state_1["reducer.stiffness"]})
    near, far = steady_by_search(other, searched), steady_by_search(other)
    orders = near.microsteps * np.arange(1, 9)
    here, there = near.harmonics()[orders], far.harmonics()[orders]
    np.testing.assert_allclose(here, there, rtol=1e-4)
    assert near.multiplier == pytest.approx(far.multiplier, abs=1e-5)
    assert near.solver["periods_evaluated"] < far.solver["periods_evaluated"]
    off = np.abs(searched.harmonics()[orders] / here - 1.0)
    assert np.max(off) > 1e-3  # it went there


def test_they_are_those_of_the_search_that_asks_where_a_start_from_rest_leads(
    state_1: mv.Scenario, searched: SteadyState
) -> None:
    orders = searched.microsteps * np.arange(1, 9)
    asked = steady_state(state_1).harmonics()[orders]
    np.testing.assert_allclose(searched.harmonics()[orders], asked, rtol=1e-4)


@pytest.mark.parametrize(
    "changes",
    [
        {"friction.presliding": {"stiffness": "20000 N*m/rad"}},
        {"friction.torque_noise": {"density": "1e-6 N^2*m^2/Hz"}},
        {"motor.friction.breakaway": "2 N*m"},
    ],
    ids=["memory", "noise", "never moves"],
)
def test_nothing_is_found_where_nothing_repeats_from_its_state_alone(
    state_1: mv.Scenario, changes: dict
) -> None:
    try:
        scenario = state_1.with_(changes)
    except mv.MicrovibError as why:
        pytest.fail(str(why))
    with pytest.raises(NotPeriodic):
        steady_by_search(scenario)


def test_where_nothing_is_found_is_known_before(state_1: mv.Scenario) -> None:
    assert is_searched(state_1)
    assert not is_searched(state_1.with_({"friction.presliding": {"stiffness": "20000 N*m/rad"}}))
    noisy = state_1.with_({"friction.torque_noise": {"density": "1e-6 N^2*m^2/Hz"}})
    assert not is_searched(noisy)
    assert not is_searched(state_1.with_({"tracking.rate": "0 deg/s"}))
