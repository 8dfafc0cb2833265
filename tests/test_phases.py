"""Motors of three and five phases, and drives without a current loop: against windings integrated phase by phase by SciPy."""

import math
from functools import cache

import numpy as np
import pytest
from support.phases import Phases
from support.scenarios import NO_FRICTION, baseline
from support.stopped import rows_at

import microvib as mv
from microvib.errors import ScenarioError
from microvib.model.expected import expected_lines
from microvib.model.linear import coupled_modes, linear_lines
from microvib.model.part import to_plain_data
from microvib.model.sentences import validate_part
from microvib.solve import kernel
from microvib.solve.pack import pack
from microvib.solve.steady.period import common_period
from microvib.solve.steady.state import steady_state

SMOOTH = {
    "sources": {},
    **NO_FRICTION,
    "array.modes": [],
    "array.rigid_inertia": None,
    "array.inertia": 0.16,
    "reducer.damping": 1.0,
    "tracking.rate": math.radians(0.3),
}
THREE = {"motor.phases": 3, "driver.beats": 6}
FIVE = {"motor.phases": 5, "driver.beats": 10}
VOLTAGE = {
    "driver.drive": "voltage",
    "driver.proportional_gain": 0.0,
    "driver.integral_gain": 0.0,
    "motor.friction.viscous": 0.01,
}
ERRORS = {
    "driver.imperfections": {
        "gain_b": 0.03,
        "offset_a": 0.02,
        "offset_b": -0.01,
        "quadrature": 0.03,
        "dac_bits": 7,
    }
}
BARE = {"motor.detent_torque": 0.0, "motor.friction.viscous": 1e-4}
CASES = {
    "three phases": (THREE, "star"),
    "three phases, windings apart": (THREE, "apart"),
    "five phases": (FIVE, "star"),
    "five phases, detent of the half step": (FIVE | {"motor.detent_order": 20}, "apart"),
    "three phases, errors of the references": (THREE | ERRORS, "apart"),
    "five phases, errors of the references": (FIVE | ERRORS, "star"),
    "two phases, voltages": (VOLTAGE, "apart"),
    "three phases, voltages": (THREE | VOLTAGE, "star"),
    "five phases, voltages, errors, ramps": (
        FIVE | VOLTAGE | ERRORS | {"driver.microstep_ramp": 0.5},
        "apart",
    ),
}


TIMES = np.linspace(0.0, 0.04, 17)[1:]


def rows_of(scenario, times):
    names = ["theta_m", "omega_m", "theta_l", "omega_l", "T_d", "E_magnetic"]
    return rows_at(scenario, times)[0][:, [kernel.CHANNELS.index(name) for name in names]]


@cache
def phase_by_phase(case):
    changes, connection = CASES[case]
    return Phases(baseline().with_si({**SMOOTH, **changes}), connection).run(TIMES)


@pytest.mark.parametrize("case", CASES)
def test_two_axes_move_as_the_phases_do(case):
    scenario = baseline().with_si({**SMOOTH, **CASES[case][0], "solver.accuracy": 2.5e-7})
    expected, found = phase_by_phase(case), rows_of(scenario, TIMES)
    if "errors" in case:
        expected, found = (
            expected[:, :-1],
            found[:, :-1],
        )  # currents off the two planes heat and store, and make no torque
    assert np.max(np.abs(expected[:, 4])) > 1e-3
    assert np.max(np.abs(found - expected) / np.max(np.abs(expected), axis=0)) < 2e-6


@pytest.mark.parametrize(
    ("changes", "steps"), [({}, 4), (THREE, 6), (FIVE, 10)], ids=["two", "three", "five"]
)
def test_an_ideal_drive_repeats_after_a_full_step_and_its_lines_are_orders_of_it(changes, steps):
    scenario = baseline().with_si(changes)
    assert math.degrees(scenario.driver.full_step(scenario.motor)) == pytest.approx(
        {4: 1.8, 6: 1.2, 10: 0.72}[steps]
    )
    assert common_period(scenario) == (16, 16)
    found = {x.name: x for x in expected_lines(scenario, "300 Hz")}
    f_e = scenario.motor.rotor_teeth * scenario.reducer.ratio * abs(scenario.rate) / (2 * math.pi)
    assert found["electrical_1"].frequency == pytest.approx(f_e)
    assert found["full_step_1"].frequency == pytest.approx(steps * f_e)
    assert found["full_step_1"].origin == "full step, order 1"
    assert found["drive_1"].frequency == pytest.approx(16 * steps * f_e)
    assert found["drive_1_minus_1"].frequency == pytest.approx(15 * steps * f_e)


def test_a_detent_of_the_half_step_has_its_own_order():
    scenario = baseline().with_si(FIVE | {"motor.detent_order": 20})
    assert common_period(scenario) == (8, 8)
    found = {x.name: x.frequency for x in expected_lines(scenario, "300 Hz")}
    assert found["drive_1"] - found["drive_1_minus_1"] == pytest.approx(2 * found["full_step_1"])
    strong = {
        x.name
        for x in mv.find_lines(scenario.with_si({"motor.detent_torque": 0.02}), start="steady")
        if x.amplitude > 1e-5
    }
    assert "full_step_2" in strong
    assert "full_step_1" not in strong


@pytest.mark.parametrize(
    "changes",
    [THREE, FIVE | ERRORS, VOLTAGE, THREE | VOLTAGE | ERRORS],
    ids=["three", "five, errors", "voltages", "all"],
)
def test_the_steady_state_is_what_a_run_settles_to(changes):
    scenario = baseline().with_si(
        changes | {"tracking.rate": math.radians(0.1), "record.settle": 40.0}
    )
    steady = {x.name: x.amplitude for x in mv.find_lines(scenario, start="steady")}
    run = {x.name: x for x in mv.find_lines(mv.simulate(scenario))}
    for name in ("drive_1", "drive_2", "full_step_1"):
        assert steady[name] == pytest.approx(run[name].amplitude, rel=0.01), name


@pytest.mark.parametrize("rate", [0.06, 0.4])
def test_lines_of_voltages_are_the_closed_form_of_the_linear_drive(rate):
    scenario = baseline().with_si(
        {**SMOOTH, **VOLTAGE, **BARE, "tracking.rate": math.radians(rate)}
    )
    state, f_d = steady_state(scenario), scenario.driving_frequency
    for line in linear_lines(scenario, 3):
        found = state.harmonics()[round(line.frequency / state.frequency)]
        assert abs(found) == pytest.approx(abs(line.amplitude), rel=2e-3), line.order
    assert line.frequency == pytest.approx(3 * f_d)
    loop = linear_lines(
        scenario.with_si({"driver.drive": "current", "driver.proportional_gain": 500.0}), 1
    )[0]
    assert abs(loop.amplitude) != pytest.approx(
        abs(linear_lines(scenario, 1)[0].amplitude), rel=0.1
    )


def test_modes_through_a_drive_of_voltages_are_those_of_the_kernels_derivative():
    scenario = baseline().with_si({**SMOOTH, **VOLTAGE, "motor.detent_torque": 0.0})
    values = np.linalg.eigvals(
        pack(scenario).propagators.A[0]
    )  # by differences of the equations of motion, nothing stuck
    wanted = np.sort(np.abs(values[values.imag > 1.0].imag)) / (2 * math.pi)
    found = np.sort([mode.frequency for mode in coupled_modes(scenario)])
    np.testing.assert_allclose(found, wanted, rtol=1e-4)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"motor.phases": 4},
            r"motor\.phases: 4 is not allowed; write 2, 3 or 5 \(number of phases\)",
        ),
        (
            {"motor.phases": 3},
            "beats 4 is not allowed with 3 phases; a multiple of their number is expected, such as 6",
        ),
        (
            THREE | {"motor.detent_order": 4},
            r"motor\.detent_order: 4 is not allowed with 3 phases; a multiple of 6",
        ),
        (
            THREE | {"driver.supply_voltage": 28.0},
            "supply_voltage 28 V limits each of the 3 phases",
        ),
        (
            {"driver.drive": "voltage"},
            "drive: voltage has no current loop; set proportional_gain, integral_gain,",
        ),
        (
            {"driver.drive": "power"},
            r"driver\.drive: 'power' is not allowed; write 'current', 'voltage' or 'pulse'",
        ),
        (
            VOLTAGE | {"driver.supply_voltage": 3.0},
            "cannot drive 0.6 A through 6 ohm; it must be at least 3.6 V",
        ),
    ],
)
def test_what_does_not_go_together_is_a_sentence(changes, sentence):
    with pytest.raises(ScenarioError, match=sentence):
        baseline().with_si(changes)


def test_gains_are_still_asked_for_where_there_is_a_loop():
    data = to_plain_data(baseline())
    del data["driver"]["integral_gain"]
    with pytest.raises(
        ScenarioError,
        match=r"driver\.integral_gain: missing \(integral gain of the current loop, in V",
    ):
        validate_part(mv.Scenario, data, si=True)
