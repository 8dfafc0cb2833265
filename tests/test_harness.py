"""A harness across the output: against an independent integrator, a closed form of its loop, balances, and what refuses it."""

import math
import re

import numpy as np
import pytest
from support.automaton import Automaton, both
from support.scenarios import baseline
from support.stopped import rows_at
from support.tiers import sweep

import microvib as mv
from microvib.model.linear import coupled_modes, matrices
from microvib.model.presliding import quasi_static_torque
from microvib.model.ranges import values_without_range
from microvib.model.winding_up import wind_up
from microvib.reports.parameters import provenance
from microvib.solve import kernel
from microvib.solve.pack import pack
from microvib.solve.steady.state import steady_state

HARNESS = {
    "stiffness": 2.0,
    "neutral_angle": 0.01,
    "friction": 0.02,
    "presliding": {"stiffness": 400.0, "elements": 3},
}
FRICTION = {**HARNESS, "stiffness": 0.0}
SHORT = {"record.settle": 1.0, "record.duration": 3.0}
T_F, THETA_L = kernel.CHANNELS.index("T_f"), kernel.CHANNELS.index("theta_l")


def drawn(seed):
    r = np.random.default_rng(seed)
    harness = {
        "stiffness": float(r.uniform(0.5, 20.0)),
        "neutral_angle": float(r.uniform(-0.02, 0.02)),
        "friction": float(r.uniform(0.01, 0.1)),
        "presliding": {"stiffness": float(r.uniform(500.0, 5000.0)), "elements": 2},
    }
    return {
        "friction.harness": harness,
        "friction.presliding": {"stiffness": float(r.uniform(4e3, 9e3)), "elements": 2},
        "motor.friction.coulomb": 0.0,
        "motor.friction.breakaway": 0.0,
        "tracking.rate": math.radians(0.3),
    }


@pytest.mark.parametrize("seed", sweep([1, 2, 3], 1))
def test_an_independent_integration_finds_the_same_motion(seed):
    scenario = baseline().with_si({**drawn(seed), "solver.accuracy": 1e-5})
    end = 20.0 / scenario.driving_frequency
    automaton, without = (
        Automaton(s) for s in (scenario, scenario.with_si({"friction.harness": None}))
    )
    (same, packed), (other, _) = both(automaton, end), both(without, end)
    moved = abs(same[6] - other[6])
    assert moved > 1e-7
    assert packed.state.y[6] == pytest.approx(same[6], abs=1e-3 * moved)
    assert packed.state.y[7] == pytest.approx(same[7], abs=1e-3 * abs(same[7] - other[7]))
    assert len(automaton.modes) > 1


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("presliding", [None, {"stiffness": 6e3, "elements": 3}])
def test_momentum_and_energy_balance(rigid, presliding):
    changes = {
        **SHORT,
        "friction.harness": HARNESS,
        "friction.presliding": presliding,
        **({"reducer.stiffness": "rigid"} if rigid else {}),
    }
    motion = mv.simulate(baseline().with_si(changes))
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.momentum < 1e-6
    assert motion.invariants.energy_mechanical < 1e-3
    if presliding:  # whose own mean follows how the output stops
        return
    plain = mv.simulate(baseline().with_si({**changes, "friction.harness": None}))
    moved = motion["T_f"].mean() - plain["T_f"].mean()
    angle = motion["theta_l"].mean() - HARNESS["neutral_angle"]
    assert moved == pytest.approx(HARNESS["stiffness"] * angle + HARNESS["friction"], rel=0.05)


def test_its_torque_over_angle_is_the_loop_of_its_elements():
    """There and back, slowly: spring, and elements as they are without a drive."""
    profile = [
        {"rate": math.radians(0.5), "ramp": 0.1, "hold": 1.0},
        {"rate": -math.radians(0.5), "ramp": 0.2, "hold": 1.0},
        {"rate": math.radians(0.5), "ramp": 0.2, "hold": 1.0},
    ]
    none = {"friction.coulomb": 0.0, "friction.breakaway": 0.0, "friction.slip_ring": None}
    scenario = baseline().with_si(
        {
            **none,
            "friction.viscous": 0.0,
            "friction.harness": HARNESS,
            "tracking": {"profile": profile},
        }
    )
    rows, _ = rows_at(scenario, np.arange(1, 3001) * 1e-3)
    angle, harness = rows[:, THETA_L], scenario.friction.harness
    wanted = quasi_static_torque(harness.memory, harness.friction, np.r_[0.0, angle])[1:]
    wanted += harness.stiffness * (angle - harness.neutral_angle)
    assert np.ptp(angle) > 4e-3
    # the path between samples, and their reversals, are not seen by the closed form
    assert np.max(np.abs(rows[:, T_F] - wanted)) < 5e-3 * np.ptp(wanted)


def test_without_torque_nothing_changes_to_the_last_bit():
    short = baseline().with_si({"record.settle": 0.2, "record.duration": 0.3})
    none = {"friction.harness": {"stiffness": 0.0}}
    assert np.array_equal(mv.simulate(short)["T_d"], mv.simulate(short.with_si(none))["T_d"])


def test_modes_see_its_spring():
    plain, sprung = baseline(), baseline().with_si({"friction.harness": {"stiffness": 500.0}})
    by_kernel = pack(sprung).propagators.A[0] - pack(plain).propagators.A[0]
    wanted = -500.0 / sprung.output_inertia
    assert by_kernel[kernel.WL, kernel.TL] == pytest.approx(wanted, rel=1e-4)
    K, before = matrices(sprung)[2], matrices(plain)[2]
    assert np.count_nonzero(K - before) == 1
    assert K[1, 1] - before[1, 1] == pytest.approx(500.0)
    assert coupled_modes(sprung)[0].frequency > 1.001 * coupled_modes(plain)[0].frequency


@pytest.mark.parametrize("rigid", [False, True])
def test_its_friction_is_that_of_an_output_with_the_same_elements(rigid):
    memory = {"stiffness": 6e3, "elements": 3}
    bare = {"friction.breakaway": 0.0, "friction.coulomb": 0.0, "friction.slip_ring": None}
    gear = {"reducer.stiffness": "rigid"} if rigid else {}
    own = {"friction.breakaway": 0.3, "friction.coulomb": 0.3, "friction.presliding": memory}
    in_harness = {"friction.harness": {"friction": 0.3, "presliding": memory}}
    one, other = (
        mv.simulate(baseline().with_si({**SHORT, **bare, **gear, **friction}))
        for friction in (own, in_harness)
    )
    assert one.solver["breakaways"] > 100
    size = np.std(one["T_d"])
    assert np.std(one["T_d"] - other["T_d"]) < 1e-3 * size
    assert np.std(one["T_f"] - other["T_f"]) < 1e-3 * np.std(one["T_f"])


@pytest.mark.parametrize("rigid", [False, True])
def test_beside_an_output_that_sticks_its_lines_are_converged(rigid):
    gear = {"reducer.stiffness": "rigid"} if rigid else {}
    scenario = baseline().with_si({**SHORT, **gear, "friction.harness": HARNESS})
    coarse, fine = (mv.simulate(scenario.with_si({"solver.refinement": n}))["T_d"] for n in (1, 4))
    window = np.hanning(coarse.size)
    a, b = (np.abs(np.fft.rfft(x * window)) for x in (coarse, fine))
    strong = b > 0.05 * b.max()
    np.testing.assert_allclose(a[strong], b[strong], rtol=5e-3)


def test_a_steady_state_is_sought_with_its_friction_alone():
    rigid_spring = baseline().with_si({"friction.harness": HARNESS})
    with pytest.raises(mv.SimulationError, match=r"friction\.harness: null leaves it out"):
        steady_state(rigid_spring)
    scenario = baseline().with_si({"friction.harness": FRICTION, "record.settle": 40.0})
    steady = {x.name: x.amplitude for x in mv.find_lines(scenario, start="steady")}
    run = {x.name: x.amplitude for x in mv.find_lines(mv.simulate(scenario))}
    for name in ("drive_1", "full_step_1"):
        assert steady[name] == pytest.approx(run[name], rel=0.02), name


def test_it_turns_with_the_array():
    turned = baseline().with_si({"friction.harness": HARNESS}).friction.turned(0.3)
    assert turned.harness.neutral_angle == pytest.approx(0.01 - 0.3)


def test_the_output_is_wound_up_further():
    plain, with_it = baseline(), baseline().with_si({"friction.harness": HARNESS})
    assert wind_up(with_it) > wind_up(plain)


def test_harness_and_eddy_currents_are_assumed_until_their_source_is_given():
    keys = ("friction.harness.stiffness", "motor.eddy_damping")
    scenario = mv.load_scenario("state-1").with_sources({})
    assert all(provenance(scenario.source_of(key)).status == "assumed" for key in keys)
    data = {"friction.harness": {"stiffness": "2 N*m/rad"}, "motor.eddy_damping": "1 mN*m*s/rad"}
    changed = scenario.with_(data)
    assert provenance(changed.source_of(keys[0])).status == "set by the user"
    unnamed = changed.with_sources({"friction": "Table 3", "motor": "its data sheet"})
    assert all(provenance(unnamed.source_of(key)).status == "assumed" for key in keys)
    assert unnamed.source_of("friction.coulomb") == "Table 3"
    assert set(keys) <= set(values_without_range(unnamed))
    told = unnamed.with_sources({"friction.harness": "measured", "motor.eddy_damping": "measured"})
    assert all(provenance(told.source_of(key)).status == "given" for key in keys)
    assert not set(keys) & set(values_without_range(told))


def test_eddy_currents_are_a_viscous_torque_on_the_rotor():
    short = baseline().with_si({"record.settle": 0.2, "record.duration": 0.3})
    viscous = short.motor.friction.viscous
    eddy = {"motor.eddy_damping": 0.25 * viscous, "motor.friction.viscous": 0.75 * viscous}
    a, b = (mv.simulate(s, channels=("T_d",))["T_d"] for s in (short, short.with_si(eddy)))
    assert np.max(np.abs(a - b)) < 1e-9 * np.max(np.abs(a))
    damped = [m.damping for m in coupled_modes(short.with_si({"motor.eddy_damping": 0.02}))]
    assert damped != pytest.approx([m.damping for m in coupled_modes(short)])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"friction.harness": {"friction": 0.1}}, "friction.harness.presliding: missing"),
        ({"friction.harness": {"presliding": {"stiffness": 1.0}}}, "friction.harness.presliding: there is no friction"),
        ({"friction.harness": {"friction": 0.1, "presliding": {"stiffness": 1.0, "breakaway_angle": 0.01}}}, "breakaway_angle is 0.01 rad"),
        ({"friction.harness": {"stiffness": -1.0}}, "friction.harness.stiffness: -1"),
        ({"motor.friction.harness": {"stiffness": 1.0}}, "a harness is on the output"),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_a_sentence(changes, said):
    with pytest.raises(mv.ScenarioError, match=re.escape(said)):
        baseline().with_si(changes)
