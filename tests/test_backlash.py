"""Backlash of the gear: an independent integrator, limits without and with load, energy, orders of trains."""

import numpy as np
import pytest
from support.automaton import Automaton, alike, both
from support.scenarios import NO_FRICTION, in_si

import microvib as mv
from microvib.errors import MicrovibError
from microvib.model.part import to_plain_data
from microvib.model.reducer import Reducer
from microvib.solve import kernel
from microvib.solve.batch import simulate_torques
from microvib.solve.integration import status_error

STEP = 1.2e-5  # rad at the output; a microstep of state 1 is 1.96e-5
NO_DRY_FRICTION = {
    **NO_FRICTION, "friction.viscous": 0.5,
    "motor.friction.coulomb": 0.0, "motor.friction.breakaway": 0.0, "motor.friction.viscous": 0.01,
}  # fmt: skip
SHORT = {"record.settle": 0.5, "record.duration": 1.0}


@pytest.fixture
def loose(state_1):
    """No friction holds a flank: the gear rattles at every microstep."""
    return state_1.with_si(
        {**NO_DRY_FRICTION, **SHORT, "reducer.backlash": STEP, "solver.accuracy": 1e-5}
    )


def test_an_independent_integration_from_contact_to_contact_agrees(loose):
    automaton = Automaton(loose)
    y, packed = both(automaton, 6.2 / loose.driving_frequency)
    assert automaton.contacts > 5
    alike(automaton, y, packed)


def test_the_gear_transmits_nothing_in_its_gap_and_the_energy_is_kept(loose):
    motion = mv.simulate(loose.with_si({"solver.accuracy": 1e-3}))
    twist = -motion["theta_m"] / loose.reducer.ratio - motion["theta_l"]
    inside = np.abs(twist) < 0.3 * STEP  # means over a sample's filter may look out of the gap
    assert 0.02 < np.mean(inside) < 0.98
    assert np.median(np.abs(motion["T_g"][inside])) < 1e-3 * np.max(np.abs(motion["T_g"]))
    assert np.abs(twist).max() > 0.5 * STEP
    assert motion.invariants.energy_mechanical < 1e-3


def test_a_gear_loaded_on_one_flank_moves_as_one_without_backlash(state_1):
    """Friction of state 1 holds the flank: only the angle lags, by half the backlash."""
    short = state_1.with_si({"record.settle": 60.0, "record.duration": 4.0})
    tight, loose = simulate_torques([short, short.with_si({"reducer.backlash": 1e-4})])
    lines = [mv.find_lines(torque)["drive_1"].amplitude for torque in (tight, loose)]
    assert lines[1] == pytest.approx(lines[0], rel=1e-5)


def test_without_backlash_nothing_changes(state_1):
    none, tiny = (
        mv.simulate(state_1.with_si({**SHORT, **more})) for more in ({}, {"reducer.backlash": 0.0})
    )
    assert np.array_equal(none["T_d"], tiny["T_d"])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"reducer.backlash": 1e-4, "reducer.stiffness": "rigid"},
            "backlash: a rigid reducer cannot have backlash",
        ),
        ({"reducer.backlash": -1e-4}, "backlash: -0.0001"),
    ],
)
def test_what_backlash_does_not_go_with_is_told(state_1, changes, sentence):
    with pytest.raises(MicrovibError, match=sentence):
        mv.simulate(state_1.with_si({**SHORT, **changes}))


def test_backlash_of_a_train_adds_up_at_the_output():
    stage = {"pinion": 20, "wheel": 200, "backlash": 2e-3, "stiffness": 2e4}
    reducer = in_si(
        Reducer, train=[stage, {**stage, "backlash": 3e-4}], wave_generator_inertia=0.0, damping=1.0
    )
    assert reducer.backlash == pytest.approx(2e-3 / 10.0 + 3e-4)
    assert "backlash" not in to_plain_data(reducer)


def test_a_gear_may_cross_its_backlash_in_a_small_part_of_the_longest_step(state_1):
    """Full steps at a ratio of 67: the gap of 1.5 arcsec is crossed in 48 us."""
    errors = [
        {"order": 1, "amplitude": 3.2e-6, "phase": 1.77},
        {"order": 2, "amplitude": 1.4e-6, "phase": 5.65},
    ]
    fast = state_1.with_si(
        {
            **NO_FRICTION, "friction.viscous": 0.0255, "motor.friction.viscous": 0.0,
            "reducer.ratio": 66.7, "reducer.stiffness": 19832.0, "reducer.damping": 0.0,
            "reducer.backlash": 7.24e-6, "reducer.transmission_error": errors,
            "driver.microsteps": 2, "tracking.rate": 1.301e-3, **SHORT,
        }
    )  # fmt: skip
    motion = mv.simulate(fast)
    assert motion.invariants.energy_mechanical < 1e-3
    assert motion.invariants.momentum < 1e-6


def test_a_run_with_backlash_that_stops_says_which_step_is_short_enough(state_1):
    loose = state_1.with_si({"reducer.backlash": 7.24e-6})
    said = str(status_error(loose, kernel.STEP_TOO_SMALL, 0.5))
    assert "crosses its backlash within one step; set solver.max_step to 20 us or less" in said
