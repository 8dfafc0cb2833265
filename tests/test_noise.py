"""Torque noise: its density and its draw, an independent integrator, the response of the linear drive, and what refuses it."""

import re

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import welch
from support.automaton import Automaton, both
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge, transient_warnings
from microvib.solve.batch import simulate_torques
from microvib.solve.noise import torque_noise
from microvib.solve.steady.state import steady_state
from microvib.validation.assumed_ranges import described_drive
from microvib.validation.loading import load_published

NOISE = {"density": 2e-6, "lowest": 0.5, "highest": 20.0, "seed": 3}


def drawn(scenario):
    """Times of the knots, values and slopes in N m/s."""
    table, rate = torque_noise(scenario)
    values, slopes = table.reshape(-1, 2).T
    return np.arange(values.size) / rate, values, slopes * rate


def test_the_draw_has_the_density_asked_for_in_its_band_and_nothing_outside(state_1):
    scenario = state_1.with_si(
        {"friction.torque_noise": NOISE, "record.settle": 0.0, "record.duration": 2000.0}
    )
    t, values, slopes = drawn(scenario)
    f, S = welch(values, 1.0 / (t[1] - t[0]), nperseg=2048)
    assert S[(f > 1.0) & (f < 19.0)].mean() == pytest.approx(2e-6, rel=0.02)
    assert S[(f < 0.3) | (f > 21.0)].max() < 1e-9 * 2e-6 + 1e-2 * 2e-6
    assert np.var(values) == pytest.approx(2e-6 * 19.5, rel=0.03)
    by_differences = (values[2:] - values[:-2]) / (t[2] - t[0])
    assert np.std(slopes[1:-1] - by_differences) < 0.1 * np.std(slopes)


def test_the_seed_is_the_draw(state_1):
    seeds = [
        drawn(state_1.with_si({"friction.torque_noise": {**NOISE, "seed": k}}))[1]
        for k in (3, 3, 4)
    ]
    assert np.array_equal(seeds[0], seeds[1])
    assert abs(np.corrcoef(seeds[0], seeds[2])[0, 1]) < 0.1


def test_an_independent_integration_with_the_same_draw_agrees(state_1):
    scenario = state_1.with_si(
        {
            "friction.torque_noise": {**NOISE, "density": 1e-4}, "friction.presliding": {"stiffness": 1e5}, "solver.accuracy": 1e-5,
            "motor.friction.coulomb": 0.0, "motor.friction.breakaway": 0.0,
        }
    )  # fmt: skip
    t, values, slopes = drawn(scenario)
    automaton = Automaton(scenario, CubicHermiteSpline(t, values, slopes))
    quiet = Automaton(scenario)
    (y, packed), (other, _) = (
        both(one, 0.7 / scenario.driving_frequency) for one in (automaton, quiet)
    )
    moved = abs(y[6] - other[6])
    assert moved > 1e-9
    assert packed.state.y[6] == pytest.approx(y[6], abs=1e-3 * moved)


def test_two_forms_of_the_torque_and_the_balances_hold_with_noise(state_1):
    scenario = state_1.with_si(
        {"friction.torque_noise": NOISE, "record.settle": 0.5, "record.duration": 1.0}
    )
    motion = mv.simulate(scenario)
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.momentum < 1e-5
    assert motion.invariants.energy_mechanical < 1e-3
    (alone,) = simulate_torques([scenario])
    assert np.std(alone.T_d - motion["T_d"]) < 1e-2 * np.std(alone.T_d)


def test_without_density_nothing_changes_to_the_last_bit(state_1):
    short = state_1.with_si({"record.settle": 0.2, "record.duration": 0.3})
    silent = short.with_si({"friction.torque_noise": {**NOISE, "density": 0.0}})
    assert np.array_equal(mv.simulate(short)["T_d"], mv.simulate(silent)["T_d"])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"friction.torque_noise": {"density": -1.0}}, "friction.torque_noise.density"),
        (
            {"friction.torque_noise": {"density": 1e-6, "lowest": 5.0, "highest": 2.0}},
            "is not above lowest",
        ),
        (
            {"friction.torque_noise": {"density": 1e-6, "lowest": 3000.0}},
            "is not below half the sample rate, 2048 Hz",
        ),
        ({"motor.friction.torque_noise": {"density": 1e-6}}, "noise acts on the output"),
    ],
)
def test_what_is_not_noise_is_a_sentence(state_1, changes, said):
    with pytest.raises(mv.ScenarioError, match=re.escape(said)):
        state_1.with_si(changes)


def test_what_cannot_take_noise_says_so(state_1):
    noisy = state_1.with_si({"friction.torque_noise": NOISE})
    with pytest.raises(mv.SimulationError, match="does not repeat"):
        steady_state(noisy)
    with pytest.raises(mv.SimulationError, match="lower friction"):
        mv.simulate(noisy.with_si({"record.duration": 4e5, "friction.torque_noise.highest": 500.0}))


def test_a_line_that_noise_drives_is_not_judged_by_one_draw(state_1):
    loud = {"density": 4e-6, "lowest": 0.0, "highest": 20.0, "seed": 1}
    scenario = state_1.with_si(
        {"friction.torque_noise": loud, "record.settle": 40.0, "record.duration": 8.0}
    )
    table = mv.find_lines(mv.simulate(scenario, channels=("T_d",)))
    mode, drive = table["array_mode_1"], table["drive_1"]
    assert mode.amplitude > 0.0
    assert judge(table, limit_of(100.0 * mode.amplitude), scenario).of(mode).verdict == "pass"
    for torque in (1.2 * mode.amplitude, 0.1 * mode.amplitude):
        judged = judge(table, limit_of(torque), scenario)
        assert judged.of(mode).verdict == "not judged"
        assert "one draw of many" in judged.of(mode).why
        assert judged.of(drive).verdict != "not judged"
    assert any(
        x.startswith("array_mode_1") and "one draw of many" in x
        for x in transient_warnings(table, scenario)
    )
    quiet = state_1.with_si({"record.settle": 2.0, "record.duration": 8.0})
    assert not any(
        "draw" in x
        for x in transient_warnings(mv.find_lines(mv.simulate(quiet, channels=("T_d",))), quiet)
    )


EDGE = {
    "motor.torque_constant": 0.5712685920123258,
    "array.inertia": 0.016586847547892646,
    "motor.detent_torque": 0.011503700739074228,
    "motor.flux_harmonics.0.amplitude": 0.018122676589878796,
    "motor.flux_harmonics.0.phase": 0.3165596640606488,
    "friction.coulomb": 0.004860445531378095,
    "friction.breakaway": 0.005936305841227703,
    "friction.viscous": 0.029398907451983418,
    "friction.torque_noise.density": 5.872570137909809e-13,
}
"""Drive of ``catalog/tests/sentinel-4.yaml`` that comes to rest where friction just fails to hold it."""
RATE_OF_MOVE = 1.0225780017608532


@pytest.mark.parametrize("accuracy", [1e-3, 5e-4])
def test_a_body_that_noise_moves_and_friction_holds_by_turns_neither_stops_a_run_nor_depends_on_steps(
    accuracy,
):
    """Noise changes faster than these steps tell; a hundred times as accurate, they are shorter."""
    drive = described_drive(load_published("sentinel-4"), "sentinel-4")
    values = drive.central_values() | {"rate of the move": RATE_OF_MOVE}
    scenario = drive.scenario("raised cosine of 5 s", values).with_si(EDGE)
    found, finer = (
        mv.simulate(scenario.with_si({"solver.accuracy": one})) for one in (accuracy, 1e-5)
    )
    assert finer.solver["sticks"] > 100
    assert found.solver["sticks"] == pytest.approx(finer.solver["sticks"], rel=0.03)
    stopped = found.time > 5.2
    crept, truly = (np.ptp(motion["theta_m"][stopped]) for motion in (found, finer))
    assert crept == pytest.approx(truly, rel=0.02)
    assert np.std(found["T_d"][stopped]) == pytest.approx(np.std(finer["T_d"][stopped]), rel=0.03)
