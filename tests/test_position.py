"""Friction that varies with the angle: its field, both integrations, an independent integrator, what refuses it, tables as files."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicHermiteSpline
from support import rodas4
from support.automaton import Automaton, both
from support.stopped import rows_at

import microvib as mv
from microvib.solve import kernel
from microvib.solve.batch import simulate_torques
from microvib.solve.integration import status_error
from microvib.solve.noise import roughness
from microvib.solve.propagate import _crowd_after
from microvib.solve.steady.state import steady_state

ROUGH = {"density": 1e-6, "lowest": 2000.0, "highest": 30_000.0, "seed": 3}
FIELD = {
    "harmonics": [
        {"order": 3, "amplitude": 0.2, "phase": 0.5},
        {"order": 20_000, "amplitude": 0.1},
    ],
    "roughness": ROUGH,
}


def field(scenario):
    """Factor on the friction at an angle, from its definition."""
    listed = scenario.friction.position.harmonics
    table, per_radian = roughness(scenario)
    values, slopes = table.reshape(-1, 2).T
    angles = np.arange(values.size + 1) / per_radian
    g = CubicHermiteSpline(angles, np.r_[values, values[0]], np.r_[slopes, slopes[0]] * per_radian)
    return lambda angle: (
        1.0
        + sum(h.amplitude * math.cos(h.order * angle + h.phase) for h in listed)
        + float(g(angle % (2 * math.pi)))
    )


def test_the_field_has_the_density_asked_for_and_repeats_after_a_turn(state_1):
    scenario = state_1.with_si({"friction.position.roughness": ROUGH})
    values = roughness(scenario)[0][::2]
    power = 2.0 * np.abs(np.fft.rfft(values) / values.size) ** 2
    orders = np.arange(power.size)
    inside = (orders >= 2000) & (orders <= 30_000)
    assert power[inside].mean() == pytest.approx(1e-6, rel=0.03)
    assert power[~inside].max() < 1e-20
    assert np.std(values) == pytest.approx(scenario.friction.position.roughness.deviation, rel=0.02)
    other = roughness(scenario.with_si({"friction.position.roughness.seed": 4}))[0][::2]
    assert abs(np.corrcoef(values, other)[0, 1]) < 0.05


def test_friction_is_its_law_times_the_field(state_1):
    scenario = state_1.with_si({"friction.position": FIELD})
    factor, seen = field(scenario), 0
    for row in rows_at(scenario, np.arange(1, 400) * 1.3e-3)[0]:
        now = dict(zip(kernel.CHANNELS, row.tolist(), strict=False))
        if not now["stuck_output"]:
            law = scenario.friction.torque(now["omega_l"])
            assert now["T_f"] == pytest.approx(factor(now["theta_l"]) * law, rel=1e-9)
            seen += 1
    assert seen > 20


def test_an_independent_integration_with_the_same_field_agrees(state_1):
    memory = {"stiffness": 6e3, "elements": 4}
    scenario = state_1.with_si(
        {
            "friction.position": FIELD, "friction.presliding": memory, "solver.accuracy": 1e-5,
            "motor.friction.coulomb": 0.0, "motor.friction.breakaway": 0.0, "tracking.rate": 0.02,
        }
    )  # fmt: skip
    by_field, by_none = (
        Automaton(scenario, grip=grip) for grip in (field(scenario), lambda angle: 1.0)
    )
    (same, packed), (without, _) = (
        both(one, 20.0 / scenario.driving_frequency) for one in (by_field, by_none)
    )
    moved = abs(same[6] - without[6])
    assert moved > 1e-7
    assert packed.state.y[6] == pytest.approx(same[6], abs=1e-3 * moved)
    assert packed.state.counters[kernel.BREAKAWAYS] > 2


@pytest.mark.parametrize("rigid", [False, True])
def test_both_integrations_and_batches_take_it(state_1, rigid):
    changes = {"friction.position": FIELD, "record.settle": 0.3, "record.duration": 0.5}
    scenario = state_1.with_({"reducer.stiffness": "rigid"} if rigid else {}).with_si(changes)
    motion = mv.simulate(scenario)
    reference = rodas4.simulate(scenario.with_si({"solver.refinement": 2}), channels=("T_d",))[
        "T_d"
    ]
    plain = mv.simulate(scenario.with_si({"friction.position": None}), channels=("T_d",))["T_d"]
    effect = np.std(plain - reference)
    assert effect > 0.01 * np.std(reference)
    assert np.std(motion["T_d"] - reference) < 0.02 * effect
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.energy_mechanical < 1e-3
    (alone,) = simulate_torques([scenario])
    assert np.std(alone.T_d - motion["T_d"]) < 2e-3 * np.std(reference)


def test_without_amplitude_nothing_changes_to_the_last_bit(state_1):
    short = state_1.with_si({"record.settle": 0.2, "record.duration": 0.3})
    none = {"harmonics": [{"order": 2, "amplitude": 0.0}], "roughness": {**ROUGH, "density": 0.0}}
    assert np.array_equal(
        mv.simulate(short)["T_d"], mv.simulate(short.with_si({"friction.position": none}))["T_d"]
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"friction.position.harmonics": [{"order": 1, "amplitude": 1.2}]}, "amplitude"),
        ({"friction.position.harmonics": [{"order": 1, "amplitude": 0.6}, {"order": 2, "amplitude": 0.5}]}, "change its sign"),
        ({"friction.position.harmonics": [{"order": 0, "amplitude": 0.1}]}, "order"),
        ({"friction.position.roughness": {"density": 1e-3, "highest": 1e4}}, "change its sign"),
        ({"friction.position.roughness": {"density": 1e-9}}, "highest: required when density is a number"),
        ({"friction.position.roughness": {"highest": 100.0}}, "give either density or table"),
        ({"friction.position.roughness": {"density": 1e-9, "lowest": 9.0, "highest": 8.0}}, "are not more than lowest"),
        ({"friction.torque_noise": {"density": 1e-9, "table": [[1.0, 1e-6]]}}, "give either density or table"),
        ({"friction.torque_noise": {"table": [[2.0, 1e-6], [1.0, 1e-6]]}}, "must be above 0 and ascend"),
        ({"friction.torque_noise": {"table": [[1.0, -1e-6], [2.0, 1e-6]]}}, "densities must be at least 0"),
        ({"motor.friction.position": {}}, "slip ring and bearing are on the output"),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_a_sentence(state_1, changes, said):
    with pytest.raises(mv.ScenarioError, match=re.escape(said)):
        state_1.with_si(changes)


STEEP = {
    "friction.slip_ring": None,
    "friction.coulomb": "0.2148 N*m",
    "friction.breakaway": "0.4296 N*m",
    "friction.stribeck_rate": "0.0237 deg/s",
    "friction.presliding": {"stiffness": "70 N*m/rad"},
    "friction.position": {"harmonics": [{"order": 481, "amplitude": 0.5}]},
    "driver.microsteps": 4,
    "tracking.rate": "0.0491 deg/s",
    "record.settle": "0 s",
    "record.duration": "12 s",
}
"""Friction that falls with the angle faster than its elements relax when the array swings back."""


def test_elements_that_are_pulled_back_to_less_friction_yield(state_1):
    """They stuck and broke away three million times within 30 ms, and the run did not end."""
    drive = state_1.with_(STEEP)
    coarse, fine = (mv.simulate(drive.with_si({"solver.refinement": n})) for n in (1, 4))
    for motion in (coarse, fine):
        assert 1000 < motion.solver["breakaways"] < 100_000
        assert np.min(motion["omega_l"]) < 0.0  # it does swing back
    # momentum is lost where rates are set to zero, less of it the finer the events are found
    assert fine.invariants.momentum < 0.3 * coarse.invariants.momentum < 3e-3
    assert fine.invariants.energy_mechanical < 0.3 * coarse.invariants.energy_mechanical < 1.5e-3


def test_friction_never_exceeds_its_limit_on_the_way_back(state_1):
    """All elements together hold at most what friction holds at rest at that angle."""
    drive = state_1.with_(STEEP)
    limit = drive.friction.breakaway_torque
    back = 0
    for row in rows_at(drive, np.arange(4000, 6000) * 2e-3)[0]:
        now = dict(zip(kernel.CHANNELS, row.tolist(), strict=False))
        if now["omega_l"] < 0.0:
            factor = 1.0 + 0.5 * math.cos(481 * now["theta_l"])
            most = limit * factor - drive.friction.viscous * now["omega_l"]
            assert abs(now["T_f"]) <= most * (1.0 + 1e-6)
            back += 1
    assert back > 100


def test_events_without_end_are_an_error(state_1):
    crowd = 0.0
    propagators = SimpleNamespace(longest=2e-3)
    for _ in range(1000):
        crowd = _crowd_after.python(0, 1e-3, crowd, propagators)
    assert crowd == 0.0
    for _ in range(1000):
        crowd = _crowd_after.python(0, 1e-9, crowd, propagators)
    assert crowd == pytest.approx(1000.0, rel=1e-3)
    assert "without end" in str(status_error(state_1, kernel.ENDLESS_EVENTS, 1.0))


def test_the_steady_search_says_why_not(state_1):
    with pytest.raises(mv.SimulationError, match="does not repeat"):
        steady_state(state_1.with_si({"friction.position": FIELD}))


def test_a_density_comes_from_a_file(tmp_path, state_1):
    (tmp_path / "psd.csv").write_text("frequency [Hz],PSD [mN^2*m^2/Hz]\n0,9\n0.5,4.0\n5,0.04\n")
    scenario = mv.load_scenario(
        "state-1", {"friction.torque_noise": {"table": str(tmp_path / "psd.csv"), "seed": 2}}
    )
    noise = scenario.friction.torque_noise
    assert noise.table == ((0.5, pytest.approx(4e-6)), (5.0, pytest.approx(4e-8)))
    # straight in logarithms: 1/f^2 between the rows, nothing beyond them
    assert noise.at(np.array([0.4, 1.0, 5.1]), 4096.0) == pytest.approx([0.0, 1e-6, 0.0])
    again = tmp_path / "again.yaml"
    again.write_text(mv.dump_scenario(scenario))
    assert mv.load_scenario(again) == scenario
    same = {
        "friction.torque_noise": {"table": [[0.01, 2e-6], [50.0, 2e-6]]},
        "record.settle": 0.1,
        "record.duration": 0.2,
    }
    flat = {**same, "friction.torque_noise": {"density": 2e-6, "lowest": 0.01, "highest": 50.0}}
    assert np.allclose(
        mv.simulate(state_1.with_si(same))["T_d"],
        mv.simulate(state_1.with_si(flat))["T_d"],
        rtol=1e-9,
        atol=1e-12,
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has 0 rows"),
        ("1,2,3\n", "row 1: has 3 columns"),
        ("f,S\n1,x\n", "row 2: density 'x' is not a number"),
        ("f [Hz],S [N*m]\n1,2\n", "column 'S [N*m]' has the wrong dimension"),
        ("1,inf\n", "a finite number is expected"),
    ],
)
def test_a_file_that_is_no_density_is_a_sentence(tmp_path, text, said):
    (tmp_path / "psd.csv").write_text(text)
    with pytest.raises(mv.ScenarioError, match=re.escape(said)):
        mv.load_scenario("state-1", {"friction.torque_noise.table": str(tmp_path / "psd.csv")})
    (tmp_path / "rough.csv").write_text("order,density\n10,1e-9\n1000,1e-9\n")
    rough = mv.load_scenario(
        "state-1", {"friction.position.roughness.table": str(tmp_path / "rough.csv")}
    )
    assert rough.friction.position.roughness.band == (10.0, 1000.0)


CREEPS = {
    "driver": {
        "beats": 4,
        "microsteps": 2,
        "proportional_gain": "40.5 V/A",
        "integral_gain": "8670 V/(A*s)",
        "imperfections": {
            "dac_bits": 6,
            "gain_b": -0.0181,
            "offset_a": -0.00816,
            "offset_b": 0.000813,
            "quadrature": "0.281 deg",
        },
    },
    "friction": {
        "coulomb": "0.224 N*m",
        "breakaway": "0.224 N*m",
        "stribeck_rate": "0.254 deg/s",
        "stribeck_shape": 2.0,
        "viscous": "12.9 N*m*s/rad",
        "position": {"harmonics": [{"order": 320, "amplitude": 0.0597}]},
    },
    "motor": {
        "current": "0.306 A",
        "detent_torque": "0.00833 N*m",
        "friction": {
            "coulomb": "0.000504 N*m",
            "breakaway": "0.000504 N*m",
            "stribeck_rate": "0.0634 deg/s",
            "viscous": "0.01 N*m*s/rad",
        },
        "rotor_inertia": "0.169 kg*cm^2",
        "rotor_teeth": 90,
        "torque_constant": "0.234 N*m/A",
        "winding_inductance": "19.8 mH",
        "winding_resistance": "17.2 ohm",
    },
    "reducer": {
        "damping": "0.723 N*m*s/rad",
        "ratio": 100,
        "stiffness": "5600 N*m/rad",
        "wave_generator_inertia": "0.0736 kg*cm^2",
    },
    "array": {
        "inertia": "3.22 kg*m^2",
        "modes": [
            {"frequency": "0.187 Hz", "damping": 0.00283, "effective_inertia": "1.22 kg*m^2"},
            {"frequency": "0.362 Hz", "damping": 0.00357, "effective_inertia": "1.13 kg*m^2"},
            {"frequency": "2.62 Hz", "damping": 0.0139, "effective_inertia": "0.372 kg*m^2"},
            {"frequency": "4.07 Hz", "damping": 0.00247, "effective_inertia": "0.415 kg*m^2"},
        ],
    },
    "tracking": {"rate": "0.0177 deg/s"},
    "record": {"settle": "5 s", "duration": "8 s", "sample_rate": "512 Hz"},
}
"""A drive whose rotor creeps, slowed down by its own viscous friction, to where its breakaway torque holds it."""


def test_a_rotor_that_creeps_to_rest_at_its_breakaway_torque_stays_there(tmp_path):
    """Held within rounding there, it would slip and stick without end."""
    (tmp_path / "creeps.yaml").write_text(yaml.safe_dump(CREEPS))
    scenario = mv.load_scenario(tmp_path / "creeps.yaml")
    motion = mv.simulate(scenario)
    other = rodas4.simulate(scenario, channels=("T_d",))
    assert motion.invariants.energy_mechanical < 1e-4
    off = motion["T_d"] - other["T_d"]
    assert np.sqrt(np.mean(off**2)) < 1e-3 * np.std(other["T_d"])
