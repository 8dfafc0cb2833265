"""Many torques at once: those of ``simulate``, each the same whatever it is computed with."""

import math

import numpy as np
import pytest
from numba import njit
from support.scenarios import ERROR, NO_FRICTION, RIGID

import microvib as mv
import microvib.solve.vector_type
from microvib.model.expected import expected_lines
from microvib.signals.line_fit import lines_at_known_clock
from microvib.solve import vector as lanes
from microvib.solve.batch import simulate_torques
from microvib.solve.command import Command

SHORT = {"record.settle": 1.0, "record.duration": 2.0}
MODES = [
    {"frequency": f, "damping": 0.01, "effective_inertia": m}
    for f, m in ((0.4, 5.0), (1.19, 2.5), (31.0, 0.5))
]
FREE = {"sources": {}, **NO_FRICTION}
DRIVES = {
    "state 1": {},
    "another rate and current": {"tracking.rate": "0.09 deg/s", "motor.current": 0.45},
    "a longer record": {"record.duration": 3.0, "record.settle": 0.5},
    "a record from the start": {"record.settle": 0.0},
    "a lower sample rate": {"record.sample_rate": 512.0},
    "backwards": {"tracking.rate": "-0.06 deg/s"},
    "three modes": {"array.rigid_inertia": None, "array.modes": MODES},
    "no modes": {"array.rigid_inertia": None, "array.modes": []},
    "rigid reducer": RIGID,
    "transmission error": ERROR,
    "rigid, transmission error": {**RIGID, **ERROR},
    "Stribeck shape 2": {"friction.stribeck_shape": 2.0},
    "no friction": FREE,
    "supply limits": {"driver.supply_voltage": 18.0, "tracking.rate": "0.2 deg/s"},
    "no integral gain": {"driver.integral_gain": 0.0},
    "a ramp": {
        "tracking.rate": None,
        "tracking.profile": [{"rate": "0.06 deg/s", "ramp": "2 s", "hold": "1 s"}],
    },
}
FINE = {"solver.refinement": 3}


@pytest.fixture(scope="module")
def drives(state_1):
    return [state_1.with_si({**SHORT, **changes}) for changes in DRIVES.values()]


@pytest.fixture(scope="module")
def torques(drives):
    return simulate_torques(drives)


def same(a, b):
    """Equal to the last bit."""
    numbers = (a.stuck_output, a.steps, a.momentum) == (b.stuck_output, b.steps, b.momentum)
    return numbers and np.array_equal(a.T_d, b.T_d)


@pytest.mark.parametrize("k", range(len(DRIVES)), ids=list(DRIVES))
def test_torque_is_that_of_simulate(drives, torques, k):
    motion, torque = mv.simulate(drives[k], channels=("T_d", "stuck_output")), torques[k]
    assert torque.T_d.shape == motion["T_d"].shape
    rms = np.sqrt(np.mean((torque.T_d - motion["T_d"]) ** 2))
    assert (
        rms < 6e-4 * np.abs(motion["T_d"]).max()
    )  # measured 5e-7 to 7.2e-5, most of it the solver's accuracy
    assert torque.stuck_output == pytest.approx(
        motion["stuck_output"].mean(), abs=2e-4
    )  # the filter reaches further
    assert (
        torque.steps <= motion.solver["steps"]
    )  # nothing but the torque has to be smooth inside them
    assert torque.momentum < 1e-7


def test_torques_converge_to_those_of_simulate(drives, torques):
    for k in (0, 6, 8):
        fine, motion = (
            simulate_torques([drives[k].with_si(FINE)])[0],
            mv.simulate(drives[k].with_si(FINE)),
        )
        coarse = mv.simulate(drives[k])
        far = np.sqrt(np.mean((torques[k].T_d - coarse["T_d"]) ** 2))
        near = np.sqrt(np.mean((fine.T_d - motion["T_d"]) ** 2))
        assert near < far / 30  # measured a hundredth


def test_lines_are_those_of_simulate(state_1, motion_1):
    scenario = motion_1.scenario
    torque = simulate_torques([scenario])[0]
    expected = expected_lines(scenario, "1400 Hz")
    ours, theirs = (
        lines_at_known_clock(x, torque.sample_rate, expected) for x in (torque.T_d, motion_1["T_d"])
    )
    amplitudes = np.array([[a.amplitude, b.amplitude] for a, b in zip(ours, theirs, strict=True)])
    top = np.nanmax(amplitudes)
    assert np.nanmax(np.abs(amplitudes[:, 0] - amplitudes[:, 1])) < 1e-4 * top


def test_a_torque_is_the_same_to_the_last_bit_in_any_company(drives, torques):
    again = simulate_torques([*drives[::-1], *drives[3:], *drives[:3]])
    for torque, other in zip(torques[::-1] + torques[3:] + torques[:3], again, strict=True):
        assert same(torque, other)


def test_a_torque_is_the_same_to_the_last_bit_alone(drives, torques):
    for k in (0, 2, 6, 10, 11):
        assert same(torques[k], simulate_torques([drives[k]])[0])


def test_failures_stand_in_their_place(state_1, drives, torques):
    lost = state_1.with_si({**SHORT, "tracking.rate": "300 deg/s"})
    stiff = state_1.with_si(
        {**SHORT, "driver.proportional_gain": 1e40, "driver.integral_gain": 1e50}
    )
    results = simulate_torques([lost, drives[0], stiff, lost, drives[1], *[stiff] * 9, drives[2]])
    assert same(results[1], torques[0])
    assert same(results[4], torques[1])
    assert same(results[14], torques[2])
    for k, scenario in ((0, lost), (2, stiff), (3, lost), (13, stiff)):
        with pytest.raises(mv.SimulationError) as alone:
            mv.simulate(scenario)
        assert type(results[k]) is type(alone.value)
        assert str(results[k]) == str(alone.value)


def test_a_command_that_cannot_be_followed_is_a_failure_too(drives, torques, monkeypatch):
    known = Command.microsteps

    def refuse(self, start, stop):
        if self._motor == drives[1].motor:
            raise mv.SimulationError("too many microsteps")
        return known(self, start, stop)

    monkeypatch.setattr(Command, "microsteps", refuse)
    results = simulate_torques([drives[1], drives[0]])
    assert str(results[0]) == "too many microsteps"
    assert same(results[1], torques[0])


def test_nothing_to_do():
    assert simulate_torques([]) == []


def _on_lanes(function, x):
    """A function of lanes at the values ``x`` (n,), n a multiple of WIDTH."""
    as_rows = lanes.rows

    @njit(error_model="numpy")
    def evaluate(x, out):
        given, results = as_rows(x, 0, x.shape[0], 1), as_rows(out, 0, x.shape[0], 1)
        for k in range(x.shape[0]):
            results[k] = function(given[k])

    out = np.zeros((x.size // lanes.WIDTH, lanes.WIDTH))
    evaluate(x.reshape(out.shape), out)
    return out.ravel()


@njit
def _sine(x):
    return lanes.sincos(x)[0]


@njit
def _cosine(x):
    return lanes.sincos(x)[1]


@pytest.mark.parametrize("span", [0.8, 30.0, 1e5])
@pytest.mark.parametrize(("ours", "exact"), [(_sine, math.sin), (_cosine, math.cos)])
def test_sine_and_cosine_of_lanes(ours, exact, span):
    x = np.concatenate(
        [np.random.default_rng(3).uniform(-span, span, 4000), [0.0, -0.0, 1e-300, math.pi / 4]]
    )
    assert _on_lanes(ours, np.resize(x, 4008)) == pytest.approx(
        [exact(v) for v in np.resize(x, 4008)], abs=2.5e-16
    )


def test_exponential_of_lanes():
    x = np.concatenate(
        [np.random.default_rng(3).uniform(-690.0, 690.0, 4000), [0.0, -0.0, 1e-300, 1.0]]
    )
    x = np.resize(x, 4008)
    exact = np.array([math.exp(v) for v in x])
    ours = _on_lanes(njit(lambda x: lanes.exp(x)), x)
    assert np.max(np.abs(ours / exact - 1.0)) < 5e-16
    assert np.all(_on_lanes(njit(lambda x: lanes.exp(x)), np.full(8, -1e9)) < 1e-303)
