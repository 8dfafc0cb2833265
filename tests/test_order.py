"""Measured order of the time integration: no friction, no microsteps, every step equally long; also while references ramp."""

import numpy as np
import pytest
from support.rodas4 import packed_for_rodas4
from support.scenarios import ERROR, NO_FRICTION, RIGID, THREE_MODES, baseline

from microvib.solve import kernel, propagators
from microvib.solve.pack import pack
from microvib.solve.sampling import empty_sample_buffer

SMOOTH = {
    "sources": {},
    **NO_FRICTION,
    "motor.friction.viscous": 0.02,
    "reducer.stiffness": 6406.0,
    "reducer.damping": 0.275,
    "tracking.rate": 0.0,
    "solver.max_step": 1.0,
}
# With Table 3's gains the current loop's 26 us hide the order until the errors are near rounding; these make it 1 ms.
SLOW_LOOP = {"driver.proportional_gain": 5.0, "driver.integral_gain": 600.0}
VARIES = {
    "friction.viscous": 20.0,
    "friction.position.harmonics": [{"order": 20_000, "amplitude": 0.6, "phase": 0.7}],
}
RAMP = {"driver.microstep_ramp": 0.95}
CASES = {
    "compliant reducer": {},
    "ramping references": RAMP,
    "rigid reducer, ramping references": {**RIGID, **RAMP},
    "compliant reducer, three modes": THREE_MODES,
    "compliant reducer, transmission error": ERROR,
    "rigid reducer": RIGID,
    "rigid reducer, three modes": {**RIGID, **THREE_MODES},
    "rigid reducer, transmission error": {**RIGID, **ERROR},
    "friction over the angle": VARIES,
    "rigid reducer, friction over the angle": {**RIGID, **VARIES},
    "derivative gain": {"driver.derivative_gain": 0.01},
    "no integral gain": {"driver.integral_gain": 0.0},
}
STOPS = np.arange(1, 9) * 2.0**-8


def off_equilibrium(changes, packed_for=packed_for_rodas4):
    """A drive that starts off equilibrium, under references that move where its driver ramps."""
    q = packed_for(baseline().with_si({**SMOOTH, **changes}))
    q.state.y[kernel.TM] += 3e-3
    q.state.y[kernel.IA] -= 0.05
    q.state.y[kernel.IB] += 0.05
    if "driver.microstep_ramp" in changes:
        q.state.clock[[kernel.RATE_A, kernel.RATE_B, kernel.RAMP_END]] = -3.0, 7.0, 1.0
    return q


def histories(changes, step):
    """Weighted states, and energies and impulse, at STOPS after a start off equilibrium, in steps of ``step``."""
    q = off_equilibrium(changes)
    weights = q.scale.copy()
    # An error weight of zero accepts every step, and max_step is then the step.
    q.scale[:] = 0.0
    object.__setattr__(q, "drive", q.drive._replace(max_step=step))
    q.state.clock[kernel.NEXT_STEP] = step
    nothing = empty_sample_buffer(q.channels)
    states, sums = [], []
    for stop in STOPS:
        assert q.advance(stop, nothing, np.zeros(0), np.zeros((0, 3))) == kernel.OK
        states.append(q.state.y * weights)
        sums.append([*q.state.energy, q.state.clock[kernel.IMPULSE]])
    assert q.state.counters[kernel.STEPS] == round(STOPS[-1] / step)
    return np.array(states), np.array(sums)


def slopes(changes, exponents):
    """Slopes of the error between neighbouring steps 2^-k s: of the state, (m,), and of each sum, (m, 5)."""
    exact, exact_sums = histories(changes, 2.0**-18)
    runs = [histories(changes, 2.0**-k) for k in exponents]
    errors = np.array([np.abs(states - exact).max() for states, _ in runs])
    sum_errors = np.array([np.abs(sums - exact_sums).max(axis=0) for _, sums in runs])
    return np.log2(errors[:-1] / errors[1:]), np.log2(sum_errors[:-1] / sum_errors[1:])


@pytest.mark.parametrize("case", CASES)
def test_state_converges_with_order_four(case):
    # A Rosenbrock method has its order only with the exact Jacobian: this checks every term of it.
    state, _ = slopes({**SLOW_LOOP, **CASES[case]}, range(11, 16))
    assert np.all((state > 3.85) & (state < 4.15)), state  # measured 3.96 to 4.07


@pytest.mark.parametrize("case", CASES)
def test_energies_and_impulse_converge_with_order_four(case):
    # Gauss quadrature (order 4) on the continuous extension (order 3, so its integral has order 4)
    _, sums = slopes({**SLOW_LOOP, **CASES[case]}, range(12, 16))
    assert np.all((sums > 3.5) & (sums < 4.4)), sums  # measured 3.64 to 4.15


@pytest.mark.parametrize("case", CASES)
def test_stiff_current_loop_does_not_lower_the_order_for_good(case):
    # Steps from 38 to 1.2 time constants of the loop: order 3 to 5 on the way, and no loss of it over the whole.
    state, _ = slopes(CASES[case], range(10, 16))
    assert np.all(state > 2.9), state  # measured 3.03 and more
    assert state.mean() > 4.0, state  # measured 4.27 to 4.58


def states_in_equal_steps(changes, step, monkeypatch):
    """Weighted states at STOPS after the same start, by the propagators: tables of one length take every step as it comes."""
    monkeypatch.setattr(propagators, "MOST_LEVELS", 1)
    settings = {"solver.accuracy": 1e-13, "solver.max_step": step}
    q = off_equilibrium({**changes, **settings}, pack)
    q.state.levels[:] = 0
    states = []
    for stop in STOPS:
        assert (
            q.advance(stop, empty_sample_buffer(q.channels), np.zeros(0), np.zeros((0, 3)))
            == kernel.OK
        )
        states.append(q.state.y / q.sizes)
    assert q.state.counters[kernel.STEPS] == round(STOPS[-1] / step)
    return np.array(states)


@pytest.mark.parametrize("case", CASES)
def test_ends_of_propagated_steps_converge_with_order_six(case, monkeypatch):
    # Lobatto's four nodes integrate polynomials of degree 5, so that ends of steps are better than the cubics inside them.
    changes = {**SLOW_LOOP, **CASES[case]}
    exact = states_in_equal_steps(changes, 2.0**-15, monkeypatch)
    errors = np.array(
        [
            np.abs(states_in_equal_steps(changes, 2.0**-k, monkeypatch) - exact).max()
            for k in (10, 11, 12)
        ]
    )
    order = np.log2(errors[:-1] / errors[1:])
    assert np.all((order > 5.7) & (order < 6.3)), order  # measured 5.81 to 6.03
