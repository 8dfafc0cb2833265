"""Derivatives of a steady state's lines, beside differences of steady states that are solved for."""

from dataclasses import replace

import numpy as np
import pytest
from support.scenarios import random_scenario

import microvib as mv
from microvib.errors import MicrovibError
from microvib.solve import kernel
from microvib.solve.steady import recorded
from microvib.solve.steady.derivatives import QUICK, about_closed, with_effort
from microvib.solve.steady.directions import Parameters, directions
from microvib.solve.steady.period import PeriodMap
from microvib.solve.steady.recorded import NotDifferentiable, RecordedPeriod, output_offset
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


CLOSED_KEYS = (
    "motor.current",
    "motor.winding_inductance",
    "reducer.ratio",
    "reducer.stiffness",
    "friction.stribeck_shape",
    "array.rigid_inertia",
    "array.modes.0.frequency",
    "tracking.rate",
)


def _closed(state: SteadyState, key: str, factor: float, orders: np.ndarray) -> np.ndarray:
    """Harmonics of the motion that repeats, with finer steps and one value changed."""
    given = state.scenario
    changed = _with(given.with_si({"solver.refinement": 4}), key, factor)
    if key == "reducer.ratio":
        changed = changed.with_si({"record.settle": given["record.settle"] / factor})
    start = state.state.copy()
    wound = [PeriodMap(x, state.microsteps).commanded_output for x in (given, changed)]
    start[kernel.TL] += wound[1] - wound[0]
    beside = replace(state, scenario=changed, state=start)
    return beside.derivatives([], orders.tolist()).amplitudes


@pytest.mark.parametrize("of", ["state-1", "rigid"])
def test_they_are_those_of_motions_that_are_closed(of: str) -> None:
    """All lines above 1 % of the largest, complex, by keys that act in every part of the drive."""
    scenario = mv.load_scenario("state-1")
    keys = CLOSED_KEYS
    if of == "rigid":
        scenario = scenario.with_si({"reducer.stiffness": "rigid"})
        keys = tuple(key for key in keys if key not in ("reducer.stiffness", "array.rigid_inertia"))
    state, part = steady_state(scenario), 1e-4
    found = state.derivatives(keys)
    large = np.abs(found.amplitudes) > 0.01 * np.abs(found.amplitudes).max()
    here = _closed(state, keys[0], 1.0, found.orders[large])
    expected = np.array(
        [
            np.subtract(*(_closed(state, key, 1.0 + x, found.orders[large]) for x in (part, -part)))
            / (2.0 * part * here)
            for key in keys
        ]
    )
    largest = np.maximum(np.abs(expected).max(axis=0), 1.0)
    off = np.abs(found.relative[:, large] - expected) / largest
    assert np.sum(large) >= 10
    assert np.mean(np.isnan(off)) < 0.05
    assert np.nanmax(off) < 3e-4
    assert np.nanquantile(off, 0.98) < 1e-4


def test_a_replay_ends_where_the_recorded_period_does(state: SteadyState) -> None:
    period = PeriodMap(state.scenario, state.microsteps)
    recorded = RecordedPeriod(PeriodMap(state.scenario, state.microsteps), np.arange(1, 17))
    start = state.state - output_offset(period)
    end = recorded.record(start).state + output_offset(period)
    assert np.abs((end - period.advance(state.state)) / period.sizes).max() < 1e-5
    again = recorded.beside(start).state + output_offset(period)
    assert np.abs((end - again) / period.sizes).max() < 1e-9


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


@pytest.mark.parametrize("error", [np.array([1.0, 1.0]), np.array([1.0, -1.0])])
def test_errors_of_two_parameters_do_not_cancel_in_the_check(
    state: SteadyState, error: np.ndarray
) -> None:
    """Of parameters that act alike, whichever way they are changed."""
    parameters = Parameters.of(state.scenario, ["tracking.rate", "motor.detent_torque"], {})
    about, other = (
        RecordedPeriod.with_finer_steps(state.scenario, state.microsteps, np.array(LINES), finer)
        for finer in (QUICK.finer, QUICK.checked_finer)
    )
    differences = about_closed(about, state.state, QUICK, 2e-5)
    moved, total, _ = differences.by_parameters(parameters)
    wrong = total + 0.01 * error * differences.harmonics[:, None]
    right, found = (differences.disagreement(other, parameters, moved, x) for x in (total, wrong))
    assert np.max(right) < 1e-3
    assert np.min(found) > 0.001


def test_equal_errors_of_parameters_that_act_alike_are_seen() -> None:
    """Beside motions that are closed: force and radius of a slip ring have one direction and the same errors
    with little effort, of which the check of both, changed in opposite ways, saw a fifth.
    """
    solved = steady_state(random_scenario(1041))
    alike = ["friction.slip_ring.contact_force", "friction.slip_ring.ring_radius"]
    found = solved.derivatives(["driver.proportional_gain", *alike])
    size = np.abs(found.amplitudes)
    large = size > 3e-3 * size.max()
    orders, part = found.orders[large], 3e-5
    below, here, above = (_closed(solved, alike[0], 1.0 + x, orders) for x in (-part, 0.0, part))
    expected = (above - below) / (2.0 * part * here)
    for own in found.relative[1:, large]:
        off = np.abs(own - expected) / np.maximum(np.abs(expected), 1.0)
        assert np.mean(np.isfinite(off)) > 0.9
        assert np.nanmax(off) < 1e-4


def test_where_little_effort_is_not_good_more_is_made() -> None:
    """Of a drive whose lines are steep and curved functions of its parameters, beside motions that are
    closed.
    """
    solved = steady_state(random_scenario(33))
    keys = ["reducer.stiffness", "array.inertia", "array.modes.0.frequency"]
    found = solved.derivatives(keys)
    parameters = Parameters.of(solved.scenario, keys, {})
    given = solved.scenario, solved.state, solved.microsteps, found.orders, parameters
    quick = with_effort(QUICK, *given)
    size = np.abs(found.amplitudes)
    large = size > 0.01 * size.max()
    orders, part = found.orders[large], 1e-5
    here = _closed(solved, keys[0], 1.0, orders)
    expected = np.array(
        [
            np.subtract(*(_closed(solved, key, 1.0 + x, orders) for x in (part, -part)))
            / (2.0 * part * here)
            for key in keys
        ]
    )
    largest = np.maximum(np.abs(expected).max(axis=0), 1.0)
    off, quickly_off = (
        np.abs(one.relative[:, large] - expected) / largest for one in (found, quick)
    )
    assert not quick.is_good
    assert np.max(off) < 3e-5
    assert not np.all(quickly_off < 3e-5)  # off, or refused


def test_near_a_kink_there_is_no_derivative() -> None:
    """Sticks that are about to drop out: derivatives depend on the steps, and few are given."""
    scenario = random_scenario(20)
    kinked = steady_state(scenario).derivatives(["motor.torque_constant", "motor.friction.viscous"])
    large = np.abs(kinked.amplitudes) > 3e-3 * np.abs(kinked.amplitudes).max()
    assert np.mean(np.isnan(kinked.derivatives[:, large])) > 0.5


def test_a_parameter_that_is_zero_has_one_with_a_scale() -> None:
    """Of viscous friction that is not there yet, beside steady states with a little of it."""
    scenario = mv.load_scenario("state-1").with_si({"friction.viscous": 0.0})
    state, scale = steady_state(scenario), 5.0
    found = state.derivatives(["friction.viscous"], LINES, scales={"friction.viscous": scale})
    fine = scenario.with_si({"solver.refinement": 4})
    none, some = (
        np.abs(steady_state(fine.with_si({"friction.viscous": x})).harmonics()[list(LINES)])
        for x in (0.0, 1e-3 * scale)
    )
    along = (found.derivatives[0] * found.amplitudes.conj() / np.abs(found.amplitudes)).real
    assert 1e-3 * scale * along / none == pytest.approx(some / none - 1.0, rel=0.05, abs=1e-5)


def test_what_has_none_is_refused(state: SteadyState) -> None:
    with pytest.raises(MicrovibError, match=r"driver\.microsteps: 16 has no derivative"):
        state.derivatives(["driver.microsteps"])
    memory = state.scenario.with_({"friction.presliding": {"stiffness": "2000 N*m/rad"}})
    with pytest.raises(NotDifferentiable, match="memory"):
        steady_state(memory).derivatives(["reducer.damping"])


ALIKE = {
    "friction.slip_ring.contact_force": "friction.slip_ring.friction_factor",
    "motor.rotor_inertia": "reducer.wave_generator_inertia",
}
"""Parameters that change the drive as others do."""


def test_parameters_that_change_a_drive_alike_have_one_direction(state: SteadyState) -> None:
    keys = (*ALIKE, *ALIKE.values(), "motor.friction.stribeck_rate", "reducer.damping")
    parameters = Parameters.of(state.scenario, keys, {})
    orders = np.arange(1, 9)
    period = RecordedPeriod.with_finer_steps(state.scenario, state.microsteps, orders, 2)
    found = directions(period, parameters, 2e-6)
    assert [keys[i] for i in found.chosen] == [*ALIKE, "reducer.damping"]
    assert found.parts[:, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-5)
    inertias = [
        state.scenario[key] for key in ("reducer.wave_generator_inertia", "motor.rotor_inertia")
    ]
    assert found.parts[:, 3] == pytest.approx([0.0, inertias[0] / inertias[1], 0.0], rel=1e-5)
    assert not np.any(found.parts[:, 4])  # without an excess at rest, its rate does nothing


def test_currents_that_are_nearly_zero_make_no_parameters_alike(state: SteadyState) -> None:
    """Over a turn of the rotor the references pass zero, where they are rounding."""
    parameters = Parameters.of(state.scenario, KEYS[:4], {})
    period = RecordedPeriod.with_finer_steps(state.scenario, 1600, np.arange(1, 9), 1)
    assert np.array_equal(directions(period, parameters, 2e-6).parts, np.eye(4))


def test_derivatives_do_not_depend_on_what_else_is_asked_for(state: SteadyState) -> None:
    keys = [*ALIKE, *ALIKE.values()]
    together = state.derivatives(keys, LINES).relative
    alone = np.array([state.derivatives([key], LINES).relative[0] for key in keys])
    assert np.abs(together - alone).max() < 1e-4


def test_coarse_derivatives_are_good_to_a_hundredth(state: SteadyState) -> None:
    fine = state.derivatives(KEYS, LINES).relative
    coarse = state.derivatives(KEYS, LINES, coarse=True).relative
    largest = np.maximum(np.abs(fine).max(axis=0), 1.0)
    assert (np.abs(coarse - fine) / largest).max() < 0.01


def test_many_intervals_with_fewer_terms_give_the_same_coefficients(
    state: SteadyState, monkeypatch: pytest.MonkeyPatch
) -> None:
    orders = list(range(1, 301))
    few = state.derivatives([], orders).amplitudes
    monkeypatch.setattr(recorded, "INTERVALS", 8)
    monkeypatch.setattr(recorded, "TERMS", 10)
    many = state.derivatives([], orders).amplitudes
    assert np.abs(many - few).max() < 1e-9 * np.abs(many).max()
