"""Friction with memory: its elements, closed forms of quasi-static loops, an independent integrator, and its limits."""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import brentq
from support.automaton import Automaton, alike, both
from support.stopped import rows_at

import microvib as mv
from microvib.errors import MicrovibError
from microvib.model.presliding import loop_elements, maxwell_elements, quasi_static_torque
from microvib.solve import kernel
from microvib.solve.batch import simulate_torques
from microvib.solve.steady.state import steady_state

MICROSTEPS = 6


@pytest.fixture(scope="module")
def presliding(state_1):
    return state_1.with_si({"friction.presliding": {"stiffness": 1e5}})


def virgin(elements, limit, angle):
    """Torque of elements at rest before, turned by an angle."""
    return sum(min(k * angle, share * limit) for k, share in elements)


@pytest.mark.parametrize(
    ("stiffness", "angle", "count"),
    [(6000.0, None, 6), (6000.0, 5e-4, 10), (2e5, 1e-4, 4), (3e3, 1.0, 2)],
)
def test_elements_have_the_stiffness_the_limit_and_the_angle_asked_for(stiffness, angle, count):
    limit = 0.6
    elements = maxwell_elements(stiffness, limit, count, angle)
    assert sum(k for k, _ in elements) == pytest.approx(stiffness)
    assert sum(share for _, share in elements) == pytest.approx(1.0)
    ends = [share * limit / k for k, share in elements]
    assert ends == sorted(ends)
    assert ends[-1] == pytest.approx(angle or 4.0 * limit / stiffness)
    assert virgin(elements, limit, 1e-3 * ends[0]) == pytest.approx(1e-3 * stiffness * ends[0])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"stiffness": 1e3, "breakaway_angle": 1e-5},
            r"breakaway_angle is 1e-05 rad; it must be above",
        ),
        ({"stiffness": 1e3, "breakaway_angle": 1e-5, "elements": 1}, "one element slides at"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"stiffness": 1e3, "elements": 11}, "elements"),
    ],
)
def test_what_does_not_go_together_is_a_sentence(state_1, changes, said):
    with pytest.raises(mv.ScenarioError, match=said):
        state_1.with_si({"friction.presliding": changes})


def test_an_independent_integration_from_event_to_event_agrees(presliding):
    scenario = presliding.with_si(
        {"motor.friction.coulomb": 0.0, "motor.friction.breakaway": 0.0, "solver.accuracy": 1e-5}
    )
    automaton = Automaton(scenario)
    y, packed = both(automaton, (MICROSTEPS + 0.2) / scenario.driving_frequency)
    assert len(automaton.modes) > 1
    assert packed.state.counters[kernel.BREAKAWAYS] > 4
    alike(automaton, y, packed)


def loop(amplitude):
    """To an amplitude, there and back twice, (5, 400) angles: the way out, then branches between the ends."""
    ends = np.array([0.0, 1.0, -1.0, 1.0, -1.0, 1.0]) * amplitude
    return np.array([np.linspace(a, b, 400) for a, b in itertools.pairwise(ends)])


def test_quasi_static_loops_follow_masings_rule_and_close():
    memory, limit, amplitude = maxwell_elements(6e3, 0.6, 6), 0.6, 3e-4
    torque = quasi_static_torque(memory, limit, loop(amplitude).ravel()).reshape(5, -1)
    for branch, sign in ((1, -1.0), (2, 1.0)):
        turned = np.abs(loop(amplitude)[branch] - loop(amplitude)[branch, 0])
        masing = np.array([2.0 * virgin(memory, limit, 0.5 * x) for x in turned])
        assert torque[branch] - torque[branch, 0] == pytest.approx(sign * masing, abs=1e-12)
    assert torque[3] == pytest.approx(torque[1], abs=1e-12)  # no drift


def test_an_inner_loop_is_forgotten_where_it_closes():
    memory, limit = maxwell_elements(6e3, 0.6, 6), 0.6
    straight = np.linspace(0.0, 3e-4, 400)
    there = np.concatenate(
        [
            straight[:200],
            np.linspace(straight[199], 5e-5, 50),
            np.linspace(5e-5, straight[199], 50),
            straight[200:],
        ]
    )
    assert quasi_static_torque(memory, limit, there)[-200:] == pytest.approx(
        quasi_static_torque(memory, limit, straight)[-200:], abs=1e-12
    )


def moved(elements, limit, loads):
    """Angles to which loads, one after the other, turn elements that begin at rest."""

    def excess(x, path, load):
        return quasi_static_torque(elements, limit, np.array([*path, x]))[-1] - load

    path, before = [0.0], 0.0
    for load in loads:
        far = path[-1] + math.copysign(1e-2, load - before)
        path.append(float(brentq(excess, path[-1], far, args=(tuple(path), load), xtol=1e-15)))
        before = load
    return np.array(path[1:])


@pytest.mark.parametrize("swing", [0.02, 0.1, 0.25])
def test_a_small_load_that_swings_about_a_large_one_does_not_make_the_shaft_creep(swing):
    """As it would with LuGre's law, at any size of the swing."""
    memory, limit = maxwell_elements(6e3, 0.6, 6), 0.6
    angles = moved(memory, limit, [0.3, *([0.3 + swing, 0.3 - swing] * 15)])
    way = 2.0 * swing / 6e3  # at least, with all elements sticking
    assert angles[1] - angles[2] > 0.99 * way
    assert np.ptp(angles[1::2]) < 1e-6 * way
    assert np.ptp(angles[2::2]) < 1e-6 * way


@pytest.mark.parametrize("amplitude", [2e-5, 1e-4, 1e-3])
def test_a_cycle_dissipates_what_its_elements_slide(amplitude):
    memory, limit = maxwell_elements(6e3, 0.6, 6), 0.6
    path = loop(amplitude)
    torque = quasi_static_torque(memory, limit, path.ravel()).reshape(5, -1)
    lost = sum(float(np.trapezoid(torque[k], path[k])) for k in (1, 2))
    exact = sum(
        4.0 * share * limit * max(amplitude - share * limit / k, 0.0) for k, share in memory
    )
    assert lost == pytest.approx(exact, abs=2e-2 * limit * amplitude)


SPLIT, LIMIT = (
    ((4000.0, 0.2), (1500.0, 0.3), (700.0, 0.5)),
    0.545,
)  # the last slides at 389 microradians


def measured(amplitude, noise=0.0, offset=0.0, first=0, seed=1):
    """Rows of a loop as a bench writes them: from rest, then twice round, with noise and an offset of the torque sensor."""
    t = np.linspace(0.0, 2.25, 450)
    angle = amplitude * np.interp(t % 1.0, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    torque = quasi_static_torque(SPLIT, LIMIT, angle) + offset
    torque = torque + np.random.default_rng(seed).normal(0.0, noise, angle.size)
    return tuple(zip(angle[first:].tolist(), torque[first:].tolist(), strict=True))


@pytest.mark.parametrize(
    ("amplitude", "noise", "offset", "first", "within"),
    [
        (1e-3, 0.0, 0.0, 0, 0.03),
        (1e-3, 2e-3, 0.05, 130, 0.03),  # begins within a turn
        (2e-4, 1e-3, -0.02, 0, 0.03),  # its last element never slides
        (5e-5, 5e-4, 0.0, 40, 0.03),
    ],
)
def test_a_measured_loop_makes_elements_that_go_round_it(amplitude, noise, offset, first, within):
    found = loop_elements(measured(amplitude, noise, offset, first), LIMIT, 6)
    assert len(found) <= 6
    assert sum(share for _, share in found) == pytest.approx(1.0)
    for part in (1.0, 0.3, 0.1):  # loops in it that were not measured, too
        angle = loop(part * amplitude).ravel()
        ours, true = (quasi_static_torque(split, LIMIT, angle) for split in (found, SPLIT))
        assert np.abs(ours - true).max() < within * np.abs(true).max()


def test_a_first_loading_alone_is_enough():
    angle = np.linspace(0.0, 1e-3, 300)
    for side in (1.0, -1.0):
        rows = tuple(
            zip(side * angle, side * quasi_static_torque(SPLIT, LIMIT, angle), strict=True)
        )
        ours = quasi_static_torque(loop_elements(rows, LIMIT, 6), LIMIT, angle)
        assert ours == pytest.approx(quasi_static_torque(SPLIT, LIMIT, angle), abs=0.02 * LIMIT)


def test_a_scenario_takes_a_measured_loop_as_csv(state_1, tmp_path):
    rows = [f"{angle * 1e6:.6f},{torque * 1e3:.6f}" for angle, torque in measured(1e-3)]
    (tmp_path / "loop.csv").write_text("\n".join(["angle [urad],torque [mN*m]", *rows]))
    changes = {
        "friction.presliding.loop": str(tmp_path / "loop.csv"),
        "friction.breakaway": "0 N*m",
    }
    with pytest.raises(MicrovibError, match=r"friction\.presliding: loop levels at 0\.545 N\*m"):
        mv.load_scenario("state-1", {"friction.presliding.loop": str(tmp_path / "loop.csv")})
    scenario = mv.load_scenario("state-1", {**changes, "friction.coulomb": "0 N*m"})
    limit = scenario.friction.breakaway_torque
    assert limit == pytest.approx(LIMIT, rel=0.01)
    assert limit != LIMIT
    assert scenario.friction.memory == loop_elements(scenario.friction.presliding.loop, limit, 6)
    (tmp_path / "own.yaml").write_text(mv.dump_scenario(scenario))
    assert mv.load_scenario(tmp_path / "own.yaml").friction == scenario.friction


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"loop": [[0.0, 0.0], [1e-3, 0.5]]}, "loop: at least 5 rows are expected"),
        (
            {"loop": [[1e-3 * k, -0.1 * k] for k in range(6)]},
            "loop: its torque does not rise with the angle",
        ),
        ({"loop": [[1e-3 * k, 0.3] for k in range(1, 7)]}, "loop levels at .* is expected"),
        ({"loop": [[1e-3 * k, 0.4 * k] for k in range(6)]}, "loop reaches 2 N.m; at most"),
        (
            {"loop": [[1e-3 * k, 0.1 * k] for k in range(6)], "stiffness": 1e4},
            "give either stiffness or loop",
        ),
        (
            {"loop": [[1e-3 * k, 0.1 * k] for k in range(6)], "breakaway_angle": 1e-3},
            "already defines gross sliding",
        ),
        ({"elements": 3}, "give either stiffness or loop"),
    ],
)
def test_loops_that_say_nothing_are_told(state_1, changes, sentence):
    with pytest.raises(MicrovibError, match=rf"^friction\.presliding.*{sentence}"):
        state_1.with_si({"friction.presliding": changes})


def along(scenario, microsteps=12, per_microstep=400):
    """Snapshots through the first microsteps, by channel."""
    rows, _ = rows_at(
        scenario,
        np.arange(microsteps * per_microstep) / (per_microstep * scenario.driving_frequency),
    )
    return dict(zip(kernel.CHANNELS, rows[:, : kernel.N_CHANNELS].T, strict=True))


def test_friction_without_a_rate_is_the_quasi_static_one_of_the_path(state_1):
    dry = {
        "friction.breakaway": state_1.friction.coulomb,
        "friction.viscous": 0.0,
        "friction.presliding": {"stiffness": 1e5},
    }
    scenario = state_1.with_si(dry)
    seen, friction = along(scenario), scenario.friction
    expected = quasi_static_torque(friction.memory, friction.breakaway_torque, seen["theta_l"])
    assert np.ptp(expected) > 0.99 * friction.breakaway_torque
    assert seen["T_f"] == pytest.approx(expected, abs=2e-3 * friction.breakaway_torque)


def test_the_gears_hysteresis_is_the_quasi_static_one_of_its_twist(state_1):
    scenario = state_1.with_si(
        {"reducer.hysteresis": {"loss": 2e-6, "stiffness": 8e3}, "reducer.damping": 0.0}
    )
    seen, gear = along(scenario), scenario.reducer
    twist = -seen["theta_m"] / gear.ratio - seen["theta_l"]
    lag = seen["T_g"] - gear.stiffness * twist
    expected = quasi_static_torque(gear.memory, gear.hysteresis_torque, twist)
    assert np.ptp(expected) > 1.9 * gear.hysteresis_torque
    assert lag == pytest.approx(expected, abs=2e-2 * gear.hysteresis_torque)


def test_stiff_contacts_give_the_lines_of_a_friction_that_sticks(state_1):
    short = state_1.with_si({"record.settle": 1.0, "record.duration": 2.0})
    rigid, *stiff = simulate_torques(
        [short, *(short.with_si({"friction.presliding": {"stiffness": k}}) for k in (6e3, 1e8))]
    )

    def drive_1(torque):
        spectrum = np.abs(
            np.fft.rfft((torque.T_d - torque.T_d.mean()) * np.hanning(torque.T_d.size))
        )
        return float(spectrum[round(2.0 * short.driving_frequency) + np.arange(-1, 2)].max())

    apart = [abs(drive_1(x) / drive_1(rigid) - 1.0) for x in stiff]
    assert apart[1] < 1e-3 < 0.05 < apart[0]


def test_balances_close_with_elements_on_rotor_output_and_gear(state_1):
    own = {"stiffness": 1e5}
    scenario = state_1.with_si(
        {
            "record.settle": 0.5, "record.duration": 1.0, "friction.presliding": own,
            "reducer.hysteresis": {"loss": 2e-6, "stiffness": 8e3}, "motor.friction.coulomb": 2e-3,
            "motor.friction.breakaway": 3e-3, "motor.friction.presliding": {"stiffness": 10.0, "elements": 3},
        }
    )  # fmt: skip
    motion = mv.simulate(scenario)
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.momentum < 1e-4
    assert motion.invariants.energy_mechanical < 1e-3
    assert 0.0 < np.mean(motion["stuck_output"]) < 1.0
    fine = mv.simulate(scenario.with_({"solver.refinement": 2}))
    assert np.std(fine["T_d"] - motion["T_d"]) < 0.01 * np.std(fine["T_d"])


def test_a_rigid_reducer_takes_elements_too(state_1):
    scenario = state_1.with_si(
        {
            "record.settle": 0.5,
            "record.duration": 1.0,
            "reducer.stiffness": "rigid",
            "friction.presliding": {"stiffness": 1e5},
        }
    )
    motion = mv.simulate(scenario)
    assert motion.invariants.momentum < 1e-4
    assert motion.invariants.energy_mechanical < 1e-3


@pytest.mark.parametrize("coulomb", [1e-3, 2e-3, 4e-3])
def test_a_rigid_reducer_mixes_a_friction_that_sticks_with_one_that_remembers(state_1, coulomb):
    scenario = state_1.with_si(
        {
            "record.settle": 0.5, "record.duration": 1.0, "reducer.stiffness": "rigid", "friction.presliding": {"stiffness": 2e4},
            "motor.friction.coulomb": coulomb, "motor.friction.breakaway": 1.5 * coulomb,
        }
    )  # fmt: skip
    motion = mv.simulate(scenario)
    assert 0.0 < np.mean(motion["stuck_rotor"]) < 1.0
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.momentum < 1e-4
    assert motion.invariants.energy_mechanical < 1e-3
    fine = mv.simulate(scenario.with_({"solver.refinement": 4}))
    assert np.std(fine["T_d"] - motion["T_d"]) < 0.02 * np.std(fine["T_d"])


def test_a_steady_state_goes_on_with_what_the_elements_remember(presliding):
    state = steady_state(presliding)
    record = mv.find_lines(state.motion(channels=("T_d",)))
    for name in ("drive_1", "drive_2"):
        assert record[name].amplitude == pytest.approx(
            mv.find_lines(state)[name].amplitude, rel=0.01
        )


def test_the_torque_alone_is_as_accurate_as_with_all_channels_where_friction_remembers(state_1):
    scenario = state_1.with_si({"friction.presliding": {"stiffness": 2e4}})
    fine = mv.simulate(scenario.with_si({"solver.refinement": 4}), channels=("T_d",))["T_d"]
    [alone] = simulate_torques([scenario])
    deviation = float(np.std(alone.T_d - fine) / np.std(fine))
    assert (
        deviation < 1e-3
    )  # 1.3 % where what happens inside steps counts as little as without memory
