"""What can be computed by hand: resonances, decays, sticking, breakaway, conservation."""

import math

import numpy as np
import pytest
from support.scenarios import ERROR, NO_FRICTION, ON_ROTOR, RIGID, THREE_MODES, baseline
from support.stopped import advance

import microvib as mv
from microvib.solve import kernel
from microvib.solve.pack import pack

SMOOTH = {**NO_FRICTION, "friction.viscous": 0.0}
NO_ROTOR_LOSS = {"motor.friction.viscous": 0.0}
RIGID_LOAD = {"array.modes": [], "array.rigid_inertia": None}
ONE_MODE = {}
# T_s + N_c p mu r of Table 3
LIMIT = 0.0462 + 320 * 0.042 * 1.53 * 0.0265


def scenario_with(*changes):
    merged = {"sources": {}}
    for change in changes:
        merged |= change
    return baseline().with_si(merged)


def channels(q):
    return dict(zip(kernel.CHANNELS, q.snapshot(), strict=False))


def released(changes, index, offset):
    """A drive that holds still but for one state."""
    scenario = scenario_with({"tracking.rate": 0.0, "solver.accuracy": 2.5e-11}, changes)
    q = pack(scenario)
    q.state.y[index] += offset
    kernel.initial_friction(q.state, q.drive)
    return scenario, q


def pole(samples, dt):
    """Pole with positive imaginary part of a decaying tone [1/s], by linear prediction."""
    M = np.column_stack([samples[1:-1], -samples[:-2]])
    two_re, square = np.linalg.lstsq(M, samples[2:], rcond=None)[0]
    z = complex(two_re / 2, math.sqrt(square - (two_re / 2) ** 2))
    return np.log(z) / dt


@pytest.mark.parametrize("detent", [0.0, 0.01])
@pytest.mark.parametrize("inertia", [8.18, 0.5])
def test_rotor_and_rigid_load_swing_on_the_electromagnetic_spring(detent, inertia):
    no_loss = {
        **SMOOTH,
        **NO_ROTOR_LOSS,
        **RIGID_LOAD,
        "reducer.stiffness": "rigid",
        "driver.integral_gain": 0.0,
    }
    scenario, q = released(
        {**no_loss, "motor.detent_torque": detent, "array.inertia": inertia}, kernel.TM, 1e-6
    )
    dt, theta = 4e-3, []
    for k in range(1, 200):
        advance(scenario, q, k * dt)
        theta.append(q.state.y[kernel.TM])
    found = pole(np.array(theta[5:]), dt)
    # J_m + J/h^2 on z K_m I + 4 z K_d, where I is what a proportional loop reaches; windings add their back-EMF.
    J, K_m, R_loop, L = 2.52e-5 + inertia / 1e4, 0.3, 506.0, 0.013
    stiffness = 50 * K_m * 0.6 * 500 / R_loop + 4 * 50 * detent
    poles = np.roots([J * L, J * R_loop, stiffness * L + K_m**2, stiffness * R_loop])
    exact = poles[np.argmax(poles.imag)]
    assert found == pytest.approx(exact, rel=1e-8)  # worst measured 1.6e-9
    assert found.imag == pytest.approx(
        math.sqrt(stiffness / J), rel=5e-5
    )  # 2.6e-5: what the windings take


@pytest.mark.parametrize("stiffness", [8400.0, "rigid"])
@pytest.mark.parametrize(("accuracy", "close"), [(2.5e-11, 1e-10), (5e-4, 1e-8)])
def test_array_mode_decays_at_its_clamped_frequency_behind_a_stuck_shaft(
    stiffness, accuracy, close
):
    scenario, q = released(
        {"reducer.stiffness": stiffness, "solver.accuracy": accuracy}, kernel.MODES, 1e-3
    )
    t = np.arange(1, 400) * 0.05
    eta, shaft = [], set()
    for stop in t:
        advance(scenario, q, stop)
        eta.append(q.state.y[kernel.MODES])
        shaft |= {q.state.y[kernel.TL], q.state.y[kernel.WL]}
    omega, xi = 2 * math.pi * 1.19, 0.01
    exact = omega * complex(-xi, math.sqrt(1 - xi**2))
    found = pole(np.array(eta), 0.05)
    assert found.imag == pytest.approx(exact.imag, rel=close)
    assert found.real == pytest.approx(exact.real, rel=close)
    swing = (
        1e-3
        * np.exp(exact.real * t)
        * (np.cos(exact.imag * t) - exact.real / exact.imag * np.sin(exact.imag * t))
    )
    assert np.abs(eta - swing).max() < 1e-3 * close
    assert shaft == {0.0}


def test_microstep_line_vanishes_with_the_size_of_the_microstep():
    def line(n):
        record = {"record.settle": 2.0, "record.duration": 6.0, "record.sample_rate": 1024.0}
        # The 16th full-step harmonic of the detent torque has the same frequency.
        motion = mv.simulate(
            scenario_with({"driver.microsteps": n, "motor.detent_torque": 0.0}, record)
        )
        spectrum = mv.spectrum(motion, window="hann")
        bin_ = np.argmin(np.abs(spectrum.frequency - 160 / 3))
        assert spectrum.frequency[bin_] == pytest.approx(160 / 3)
        return spectrum.amplitude[bin_]

    assert line(16384) < 1e-7 * line(16)  # measured 4e-9


@pytest.mark.parametrize("held", [300.0, pytest.param(3600.0, marks=pytest.mark.long)])
def test_held_shaft_does_not_creep(held):
    two_seconds = [{"rate": math.radians(0.06), "hold": 2.03}, {"rate": 0.0}]
    record = {"record.settle": 60.0, "record.duration": held, "record.sample_rate": 16.0}
    scenario = scenario_with({"tracking.rate": None, "tracking.profile": two_seconds}, record)
    motion = mv.simulate(scenario, channels=("theta_l", "omega_l", "T_g", "T_f"))
    assert np.all(motion["omega_l"] == 0.0)
    # Of a constant the sampling filter's sum keeps all but rounding: 2e-18 of 2e-3 rad.
    assert np.ptp(motion["theta_l"]) < 1e-14 * motion["theta_l"][0]
    # It is held against a wound-up reducer, not left at rest.
    assert 0.1 < abs(motion["T_f"][-1]) < LIMIT
    assert motion["T_f"][-1] == pytest.approx(motion["T_g"][-1])


@pytest.mark.parametrize("way", [-1.0, 1.0])
@pytest.mark.parametrize(("share", "holds"), [(1 - 1e-9, True), (1 + 1e-9, False)])
def test_wound_up_shaft_breaks_away_above_the_breakaway_torque_only(way, share, holds):
    # T_g = K_g gamma with the rotor at zero, where its friction keeps it: else it would give way and unload the shaft.
    held_rotor = {"motor.friction.coulomb": 1.0, "motor.friction.breakaway": 1.0}
    windup = way * share * LIMIT / 8400.0
    scenario, q = released(held_rotor, kernel.TL, windup)
    advance(scenario, q, 60.0)
    assert (q.state.y[kernel.TL] == windup) == holds
    if holds:
        assert q.state.y[kernel.WL] == 0.0
    else:
        assert way * q.state.y[kernel.TL] < way * windup  # it went the way it was pushed


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({}, LIMIT),
        ({"friction.slip_ring": None}, 0.0462),
        (RIGID, LIMIT),
        ({**RIGID, **ON_ROTOR}, LIMIT + 100 * 0.004),
    ],
    ids=["compliant", "no slip ring", "rigid", "rigid, friction on the rotor too"],
)
def test_tracking_breaks_away_at_the_breakaway_torque(changes, limit):
    scenario = scenario_with({"solver.accuracy": 2.5e-7}, changes)

    def at(t):
        q = pack(scenario)
        advance(scenario, q, t)
        return q

    slips, sticks = 0.2, 0.0
    assert at(slips).state.counters[kernel.BREAKAWAYS] > 0
    while slips - sticks > 1e-12:
        middle = 0.5 * (slips + sticks)
        if at(middle).state.counters[kernel.BREAKAWAYS]:
            slips = middle
        else:
            sticks = middle
    q = at(sticks)
    c = channels(q)
    assert (q.state.y[kernel.TL], q.state.y[kernel.WL]) == (0.0, 0.0)
    held = abs(c["T_f"]) + (100 * abs(c["T_f_m"]) if scenario.reducer.rigid else 0.0)
    assert held <= limit * (1 + 3 * kernel.AT_LIMIT)  # twice as much, and what ends a step
    # After a microstep the torque on the rigid reducer rises by 1e5 N m/s: 1e-7 of the limit in what is left of time.
    assert held == pytest.approx(limit, rel=3e-7)
    # and an instant later friction has fallen
    assert at(slips + 1e-3).state.y[kernel.WL] != 0.0


COMBINATIONS = pytest.mark.parametrize(
    "changes",
    [
        pytest.param(
            {"reducer.stiffness": stiffness, **friction, **modes, **error},
            id=f"{stiffness}, {friction_name}, {modes_name}{', transmission error' if error else ''}",
        )
        for stiffness in (8400.0, "rigid")
        for friction_name, friction in {
            "no friction": SMOOTH,
            "friction on the output": {},
            "friction on the rotor": {**SMOOTH, **ON_ROTOR},
            "both frictions": ON_ROTOR,
        }.items()
        for modes_name, modes in {
            "rigid load": RIGID_LOAD,
            "one mode": ONE_MODE,
            "three modes": THREE_MODES,
        }.items()
        for error in ({}, ERROR)
    ],
)
SHORT = {"record.settle": 0.25, "record.duration": 1.0}


@COMBINATIONS
def test_what_is_conserved(changes):
    invariants = mv.simulate(scenario_with(SHORT, changes), channels=("T_d",)).invariants
    assert invariants.torque_forms < 1e-12  # worst measured 1.6e-15
    assert invariants.momentum < 3e-5  # worst measured 1.1e-5
    assert invariants.energy < 2e-6  # 4e-7
    assert invariants.energy_mechanical < 1e-3  # 8e-4: no friction, so little else passes the shaft


@pytest.mark.parametrize(
    "changes",
    [{}, RIGID, THREE_MODES, ON_ROTOR],
    ids=["compliant", "rigid", "three modes", "both frictions"],
)
def test_balances_close_with_the_tolerance(changes):
    tight = {"solver.accuracy": 2.5e-8}
    invariants = mv.simulate(scenario_with(SHORT, changes, tight), channels=("T_d",)).invariants
    assert invariants.torque_forms < 1e-12
    assert invariants.momentum < 1e-8
    assert invariants.energy_mechanical < 5e-7  # 1.2e-7


@pytest.mark.parametrize(
    "changes", [{}, RIGID, THREE_MODES], ids=["compliant", "rigid", "three modes"]
)
def test_integral_of_the_disturbance_torque_is_the_angular_momentum_lost(changes):
    record = {"record.settle": 0.25, "record.duration": 1.0, "record.sample_rate": 16384.0}
    scenario = scenario_with(record, changes)
    m = mv.simulate(scenario)
    # (J_flex + J) omega_l + H d eta/dt + J_m omega_m, from the samples
    L = 8.18 * m["omega_l"] + m["eta_rate"] @ scenario.array.H + 2.52e-5 * m["omega_m"]
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (m["T_d"][1:] + m["T_d"][:-1]) / 16384.0)])
    # worst measured 3.2e-4: the trapezoids across the sampling filter's answer to sticks and breakaways
    assert np.abs(impulse + L - L[0]).max() < 1e-3 * np.abs(L - L[0]).max()
