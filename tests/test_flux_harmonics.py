"""Harmonics of flux linkages and of the detent torque: against windings integrated phase by phase, closed forms, and what refuses them."""

import math
import re

import numpy as np
import pytest
from support import rodas4
from support.phases import Phases
from support.scenarios import NO_FRICTION, baseline
from support.stopped import rows_at
from support.tiers import at_a_release, sweep

import microvib as mv
from microvib.model.expected import distance_to_clock_line
from microvib.model.harmonics import sequence
from microvib.model.orders import drive_orders
from microvib.solve import kernel
from microvib.solve.pack import pack
from microvib.solve.steady.period import common_period

BEATS = {2: 4, 3: 6, 5: 10}
SMOOTH = {
    "sources": {},
    **NO_FRICTION,
    "array.modes": [],
    "array.rigid_inertia": None,
    "array.inertia": 0.16,
    "reducer.damping": 1.0,
    "tracking.rate": math.radians(0.3),
    "record.settle": 0.2,
    "record.duration": 1.0,
}
VOLTAGE = {"driver.drive": "voltage", "driver.proportional_gain": 0.0, "driver.integral_gain": 0.0}
ROWS = ("theta_m", "omega_m", "theta_l", "omega_l", "T_d")


def motor_of(phases, orders, amplitude=0.05, phase=0.4):
    harmonics = [{"order": k, "amplitude": amplitude, "phase": phase} for k in orders]
    return {
        "motor.phases": phases,
        "driver.beats": BEATS[phases],
        "motor.flux_harmonics": harmonics,
    }


def drawn(phases, seed):
    """A drawn motor and driver: all flux harmonics, and two of the detent torque beside its own."""
    r = np.random.default_rng([seed, phases])
    orders = (3, 5, 7) if phases < 5 else (3, 7, 9, 11)
    flux = [
        {"order": k, "amplitude": float(r.uniform(0.01, 0.06)), "phase": float(r.uniform(0.0, 6.0))}
        for k in orders
    ]
    detent = [
        {"order": n, "amplitude": float(r.uniform(1e-3, 5e-3)), "phase": float(r.uniform(0.0, 6.0))}
        for n in (2, 4 * phases)
    ]
    return {
        **SMOOTH,
        "motor.phases": phases,
        "driver.beats": BEATS[phases],
        "driver.microsteps": int(r.choice([8, 16])),
        "motor.current": float(r.uniform(0.3, 1.2)),
        "motor.flux_harmonics": flux,
        "motor.detent": detent,
        "motor.eddy_damping": float(r.uniform(1e-3, 5e-3)),
        "motor.friction.viscous": float(r.uniform(0.01, 0.03)),
    }


@pytest.mark.parametrize("seed", sweep([1, 2], 1))
@pytest.mark.parametrize("phases", sweep([2, 3, 5], 3))
def test_lines_are_those_of_windings_integrated_phase_by_phase(phases, seed):
    scenario = baseline().with_si(drawn(phases, seed))
    turn = 2 * math.pi / (scenario.motor.rotor_teeth * scenario.reducer.ratio * abs(scenario.rate))
    count = 2048
    times = turn * (1.0 + np.arange(count) / count)
    expected = Phases(scenario, "star" if phases > 2 else "apart").run(times)[:, 4]
    found = rows_at(scenario, times)[0][:, kernel.CHANNELS.index("T_d")]
    wanted, got = np.fft.rfft(expected) / count, np.fft.rfft(found) / count
    strong = np.abs(wanted) > 1e-3 * np.max(np.abs(wanted))
    strong[0] = False
    # that each new part makes lines: half turns by the detent torque, full steps
    assert strong[2]
    assert strong[2 * phases]
    assert np.count_nonzero(strong) > 10
    np.testing.assert_allclose(got[strong], wanted[strong], rtol=1e-3)


@pytest.mark.parametrize("connection", ["star", "apart"])
@pytest.mark.parametrize(
    ("phases", "orders"), [(2, (3, 5, 7)), (3, (5, 7)), (5, (9, 11))], ids=["two", "three", "five"]
)
def test_with_voltages_too_two_axes_move_as_the_phases_do(phases, orders, connection):
    changes = {**SMOOTH, **VOLTAGE, **motor_of(phases, orders), "motor.friction.viscous": 0.01}
    scenario = baseline().with_si({**changes, "solver.accuracy": 2.5e-7})
    times = np.linspace(0.0, 0.04, 17)[1:]
    connected = connection if phases > 2 else "apart"
    expected = Phases(scenario, connected).run(times)[:, :5]
    found = rows_at(scenario, times)[0][:, [kernel.CHANNELS.index(name) for name in ROWS]]
    assert np.max(np.abs(found - expected) / np.max(np.abs(expected), axis=0)) < 2e-6


@pytest.mark.parametrize(("phases", "orders"), [(3, (3, 9, 15)), at_a_release(5, (3, 5, 7, 13))])
def test_what_no_current_of_the_two_axes_meets_makes_no_torque(phases, orders):
    """Zero sequence and the second plane of five phases: to the last bit here, in a star by its own currents."""
    plain = baseline().with_si({**SMOOTH, **motor_of(phases, ())})
    with_them = baseline().with_si({**SMOOTH, **motor_of(phases, orders)})
    assert with_them.motor.axis_flux_harmonics == ()
    a, b = (mv.simulate(s, channels=("T_d",))["T_d"] for s in (plain, with_them))
    assert np.array_equal(a, b)
    times = np.linspace(0.0, 0.1, 41)[1:]
    expected = Phases(with_them, "star").run(times)[:, 4]
    fine = with_them.with_si({"solver.accuracy": 2.5e-7})
    found = rows_at(fine, times)[0][:, kernel.CHANNELS.index("T_d")]
    # By its back-EMF the second plane has currents of the order a K_m omega_m/(R + K_P), and so a
    # torque of the order of the amplitude's square.
    assert np.max(np.abs(found - expected)) < (1e-8 if phases == 3 else 1e-4) * np.max(
        np.abs(expected)
    )


def test_flux_rates_are_those_of_the_contract_for_two_phases():
    """k_A = -K_m [sin p + a sin(3p + phi)] and k_B = K_m [cos p - a cos(3p + phi)], by the kernel's T_e."""
    a, phi, current = 0.1, 0.7, 0.6
    scenario = baseline().with_si({**motor_of(2, (3,), a, phi), "motor.detent_torque": 0.0})
    packed, K_m = pack(scenario), scenario.motor.torque_constant
    for p in np.linspace(0.0, 6.0, 25):
        for currents, rate in (
            ((current, 0.0), -(math.sin(p) + a * math.sin(3 * p + phi))),
            ((0.0, current), math.cos(p) - a * math.cos(3 * p + phi)),
        ):
            packed.state.y[[kernel.TM, kernel.IA, kernel.IB]] = p / 50, *currents
            T_e = packed.snapshot()[kernel.CHANNELS.index("T_e")]
            assert T_e == pytest.approx(K_m * current * rate, abs=1e-12)


@pytest.mark.parametrize("phases", [2, 3, 5])
@pytest.mark.parametrize("order", range(3, 26, 2))
def test_the_sequence_is_that_of_the_sum_over_the_phases(phases, order):
    axes = np.array([0.0, math.pi / 2]) if phases == 2 else 2 * math.pi * np.arange(phases) / phases
    p = np.linspace(0.0, 2 * math.pi, 64, endpoint=False)
    rates = np.sin(order * (p[:, None] - axes))
    along, across = 2.0 / phases * rates @ np.cos(axes), -2.0 / phases * rates @ np.sin(axes)
    turned = sequence(order, phases)
    np.testing.assert_allclose(along, np.sin(order * p) if turned else 0.0, atol=1e-12)
    np.testing.assert_allclose(across, turned * np.cos(order * p), atol=1e-12)


@pytest.mark.parametrize("phases", [2, 3, 5])
@pytest.mark.parametrize("amplitude", [0.03, 0.5])
def test_power_in_is_power_out(phases, amplitude):
    orders = (3, 5, 7) if phases < 5 else (9, 11)
    changes = {
        **motor_of(phases, orders, amplitude),
        "motor.detent": [{"order": 3, "amplitude": 2e-3, "phase": 0.4}],
        "record.settle": 1.0,
        "record.duration": 3.0,
    }
    invariants = mv.simulate(baseline().with_si(changes)).invariants
    assert invariants.torque_forms < 1e-9
    assert invariants.momentum < 1e-6
    assert invariants.energy_mechanical < 1e-3


@pytest.mark.parametrize("rigid", [False, True])
def test_the_other_integration_agrees(rigid):
    changes = {
        **motor_of(2, (3, 5, 7)),
        "motor.detent": [{"order": 8, "amplitude": 2e-3, "phase": 0.4}],
        "record.settle": 0.3,
        "record.duration": 0.5,
        **({"reducer.stiffness": "rigid"} if rigid else {}),
    }
    scenario = baseline().with_si(changes)
    motion = mv.simulate(scenario)["T_d"]
    reference = rodas4.simulate(scenario.with_si({"solver.refinement": 2}), channels=("T_d",))[
        "T_d"
    ]
    assert np.std(motion - reference) < 2e-3 * np.std(reference)


def steady_lines(changes):
    state = mv.steady_state(mv.load_scenario("state-1").with_(changes))
    at = {}
    for name, order in (("full_step_1", 1), ("full_step_2", 2)):
        f = order * state.scenario.driving_frequency / state.scenario.driver.microsteps
        at[name] = abs(state.harmonics()[round(f / state.frequency)])
    return at


NO_DETENT = {"motor.detent_torque": "0 N*m"}
CURRENTS = ("0.3 A", "0.6 A", "1.2 A")
H3 = {**NO_DETENT, "motor.flux_harmonics": [{"order": 3, "amplitude": 0.0556}]}


def test_a_third_harmonic_keeps_its_line_whatever_the_current_and_detent_torque_goes_as_its_inverse():
    by_flux = [steady_lines({**H3, "motor.current": amplitude}) for amplitude in CURRENTS]
    by_detent = [steady_lines({"motor.current": amplitude}) for amplitude in CURRENTS]
    flux, detent = (np.array([x["full_step_1"] for x in each]) for each in (by_flux, by_detent))
    assert np.max(flux) / np.min(flux) < 1.01
    np.testing.assert_allclose(detent * [0.3, 0.6, 1.2] / (0.6 * detent[1]), 1.0, rtol=0.02)
    # at the current of the test they look alike, also in the second harmonic
    assert flux[1] == pytest.approx(detent[1], rel=0.01)
    second = by_flux[1]["full_step_2"], by_detent[1]["full_step_2"]
    assert 0.5 < second[0] / second[1] < 1.0


def test_order_of_the_torque_is_told_before_anything_runs():
    two = baseline().with_si(motor_of(2, (3, 5, 7)))
    words = {x.name: x for x in drive_orders(two)}
    f_e = two.driving_frequency / 64
    assert [words[f"flux {k}"].frequency / f_e for k in (3, 5, 7)] == pytest.approx([4, 4, 8])
    assert "proportional to the current" in words["flux 3"].words
    three = baseline().with_si(motor_of(3, (3, 5, 7)))
    words = {x.name: x for x in drive_orders(three)}
    assert "no torque with 3 phases" in words["flux 3"].words
    f_e = three.driving_frequency / 96
    assert [words[f"flux {k}"].frequency / f_e for k in (5, 7)] == pytest.approx([6, 6])


def test_lines_that_they_make_are_expected_and_found():
    alone = {**NO_DETENT, "motor.detent": [{"order": 2, "amplitude": "2 mN*m", "phase": "20 deg"}]}
    scenario = mv.load_scenario("state-1").with_(alone)
    expected = {x.name: x for x in mv.expected_lines(scenario, "60 Hz")}
    assert "detent harmonic 2" in expected["electrical_2"].origin
    found = mv.find_lines(scenario, start="steady")
    assert found["electrical_2"].amplitude > 1e-4
    assert common_period(scenario) == (32, 32)
    f_e = scenario.driving_frequency / 64
    assert distance_to_clock_line(scenario, 3 * f_e) == pytest.approx(f_e)
    by_flux = mv.load_scenario("state-1").with_(H3)
    expected = {x.name: x for x in mv.expected_lines(by_flux, "60 Hz")}
    assert "flux harmonic 3" in expected["full_step_1"].origin
    assert "drive_1_minus_1" in expected
    assert common_period(by_flux) == (16, 16)


def test_a_high_detent_harmonic_has_its_line():
    scenario = baseline().with_si({"motor.detent": [{"order": 48, "amplitude": 1e-3}]})
    names = {x.name: x.origin for x in mv.expected_lines(scenario, "60 Hz")}
    assert "detent harmonic 48" in names["full_step_12"]


def test_without_amplitude_nothing_changes_to_the_last_bit():
    short = baseline().with_si({"record.settle": 0.2, "record.duration": 0.3})
    none = {
        **motor_of(2, (3, 5), 0.0),
        "motor.detent": [{"order": 8, "amplitude": 0.0}],
        "motor.eddy_damping": 0.0,
    }
    assert np.array_equal(mv.simulate(short)["T_d"], mv.simulate(short.with_si(none))["T_d"])


def test_a_detent_of_the_list_is_the_detent_torque_with_a_phase():
    short = baseline().with_si({"record.settle": 0.2, "record.duration": 0.3})
    K_d = short.motor.detent_torque
    listed = {"motor.detent_torque": 0.0, "motor.detent": [{"order": 4, "amplitude": K_d}]}
    a, b = (mv.simulate(s, channels=("T_d",))["T_d"] for s in (short, short.with_si(listed)))
    assert np.max(np.abs(a - b)) < 1e-5 * np.max(np.abs(a))
    turned = short.with_si({**listed, "motor.detent.0.phase": math.pi})
    assert np.max(np.abs(mv.simulate(turned, channels=("T_d",))["T_d"] - a)) > 1e-3


def test_keys_of_harmonics_are_used_as_those_of_other_lists(tmp_path):
    scenario = mv.load_scenario("state-1").with_(
        {
            "motor.flux_harmonics": [{"order": 3, "amplitude": 0.025, "phase": "10 deg"}],
            "motor.detent": [{"order": 8, "amplitude": "1 mN*m"}],
        }
    )
    assert scenario["motor.flux_harmonics.0.phase"] == pytest.approx(math.radians(10))
    changed = scenario.with_({"motor.flux_harmonics.0.amplitude": 0.03})
    assert changed.motor.flux_harmonics[0].amplitude == 0.03
    (tmp_path / "again.yaml").write_text(mv.dump_scenario(scenario))
    again = mv.load_scenario(tmp_path / "again.yaml")
    assert again.motor == scenario.motor


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"motor.flux_harmonics": [{"order": 4, "amplitude": 0.1}]}, "motor.flux_harmonics.0.order: 4 is not allowed; an odd order from 3 to 25 is expected"),
        ({"motor.flux_harmonics": [{"order": 1, "amplitude": 0.1}]}, "motor.flux_harmonics.0.order: 1"),
        ({"motor.flux_harmonics": [{"order": 3, "amplitude": 1.0}]}, "motor.flux_harmonics.0.amplitude: 1"),
        ({"motor.flux_harmonics": [{"order": 3, "amplitude": -1.5}]}, "motor.flux_harmonics.0.amplitude: -1.5"),
        ({"motor.flux_harmonics": [{"order": 3, "amplitude": 0.1}, {"order": 3, "amplitude": 0.2}]}, "motor.flux_harmonics: order 3 is given more than once"),
        ({"motor.flux_harmonics": [{"amplitude": 0.1}]}, "motor.flux_harmonics.0.order: missing"),
        ({"motor.detent": [{"order": 4, "amplitude": 0.1}]}, "motor.detent.0.order: 4 is the order of detent_torque"),
        ({"motor.detent": [{"order": 8, "amplitude": 0.1}, {"order": 8, "amplitude": 0.1}]}, "motor.detent: order 8 is given more than once"),
        ({"motor.detent": [{"order": 0, "amplitude": 0.1}]}, "motor.detent.0.order: 0"),
        ({"motor.detent": [{"order": 8, "amplitude": -0.1}]}, "motor.detent.0.amplitude: -0.1"),
        ({"motor.eddy_damping": -1.0}, "motor.eddy_damping: -1"),
        ({**motor_of(5, (3,)), "driver.imperfections.gain_b": 0.01}, "order 3 of five phases acts on currents in their second plane, which errors of the driver"),
        ({**motor_of(5, (9, 7)), **VOLTAGE}, "order 7 of five phases acts on currents in their second plane, which voltages"),
    ],
)  # fmt: skip
def test_what_a_motor_cannot_have_is_a_sentence(changes, said):
    with pytest.raises(mv.ScenarioError, match=re.escape(said)) as told:
        baseline().with_si(changes)
    assert "\n" not in str(told.value)
