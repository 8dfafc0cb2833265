"""Rate profiles: closed forms of input shapers, an oscillator integrated by SciPy, and what the full model rings with."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from support.tiers import sweep

import microvib as mv
from microvib.cli.main import main
from microvib.errors import MicrovibError, OptionError
from microvib.model.linear import coupled_modes, rate_step_response
from microvib.model.winding_up import wind_up
from microvib.reports.outcome import terminal_text, text_files
from microvib.reports.profiles import profile_outcome
from microvib.studies.profiles.manoeuvre import Manoeuvre, lag
from microvib.studies.profiles.modes import UncertainMode
from microvib.studies.profiles.plan import FULL, LINEAR, STEP, Run
from microvib.studies.profiles.rate_profile import RateProfile
from microvib.studies.profiles.runs import Case, Ringing, case_of, legs_of, measure, with_profile
from microvib.studies.profiles.shapes import (
    S_CURVE_LEGS,
    extra_insensitive,
    jump,
    ramp,
    s_curve,
    shaped,
    shortest_of,
    zero_vibration,
)
from microvib.studies.profiles.shortest import Bounds, samples_of, shortest_change
from microvib.studies.profiles.worst import TOLERANCE, search_worst, start_grid

F, ZETA = 1.19, 0.01
RATE = math.radians(0.06)
FRICTIONLESS = {
    "friction.coulomb": 0.0, "friction.breakaway": 0.0, "friction.slip_ring": None, "motor.detent_torque": 0.0,
    "driver.microsteps": 256,
}  # fmt: skip


def mode_of(spread=0.1, dampings=(ZETA, ZETA), allowed=10**-1.5, frequency=F, damping=ZETA):
    return UncertainMode("array_mode_1", frequency, damping, spread, dampings, 60.0, allowed)


def impulses(shaper) -> RateProfile:
    return RateProfile.of_jumps(*shaper)


def eigenvalue(frequency: float, damping: float) -> np.ndarray:
    return np.array([mode_of(frequency=frequency, damping=damping).eigenvalue()])


def residual(profile: RateProfile, frequency: float, damping: float) -> float:
    return float(abs(profile.residual(eigenvalue(frequency, damping))[0]))


def oscillator_residual(profile: RateProfile, frequency: float, damping: float) -> float:
    """Ringing after a profile over that after a step, both at its end: an oscillator whose support turns with it."""
    omega = 2.0 * math.pi * frequency / math.sqrt(1.0 - damping**2)
    omega_d = 2.0 * math.pi * frequency

    def slope(t, y):
        k = min(int(np.searchsorted(edges, t, side="right")) - 1, len(edges) - 2)
        part = (t - edges[k]) / (edges[k + 1] - edges[k])
        rate = before[k] + part * (after[k] - before[k])
        return [
            y[1],
            -2.0 * damping * omega * y[1]
            - omega**2 * y[0]
            - (after[k] - before[k]) / (edges[k + 1] - edges[k])
            + 0.0 * rate,
        ]

    times, rates = profile.times, profile.rates
    spans = np.flatnonzero(np.diff(times) > 0.0)
    edges = [times[0], *times[1:][spans]]
    before, after = rates[spans], rates[spans + 1]
    y = np.array(
        [0.0, -(before[0] - 0.0)]
    )  # a jump of the support's rate is one of the relative rate
    for k in range(len(spans)):
        edge = (edges[k], edges[k + 1])
        y = solve_ivp(slope, edge, y, rtol=1e-11, atol=1e-14, max_step=0.2 * (edge[1] - edge[0])).y[
            :, -1
        ]
        following = before[k + 1] if k + 1 < len(spans) else 1.0
        y[1] -= following - after[k]
    return math.hypot(y[1] + damping * omega * y[0], omega_d * y[0])


# ----------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize(
    ("order", "at_5", "at_10"),
    [(1, 0.0785, 0.1564), (2, 0.00616, 0.02447), (3, 0.000483, 0.003828)],
)
def test_zv_zvd_and_zvdd_leave_powers_of_a_cosine(order, at_5, at_10):
    shaper = impulses(zero_vibration(F, 0.0, order))
    for off, printed in ((0.05, at_5), (0.1, at_10)):
        for side in (1.0 - off, 1.0 + off):
            assert residual(shaper, side * F, 0.0) == pytest.approx(
                abs(math.cos(0.5 * math.pi * side)) ** order, rel=1e-9
            )
            assert residual(shaper, side * F, 0.0) == pytest.approx(printed, rel=5e-3)
    assert residual(shaper, F, 0.0) < 1e-12


def test_with_one_percent_damping_zv_and_zvd_leave_the_residuals_of_the_literature():
    zv, zvd = (impulses(zero_vibration(F, ZETA, order)) for order in (1, 2))
    assert 100.0 * residual(zv, 1.05 * F, ZETA) == pytest.approx(7.7, abs=0.1)
    assert 100.0 * residual(zv, 1.10 * F, ZETA) == pytest.approx(15.3, abs=0.3)
    assert 100.0 * residual(zvd, 1.05 * F, ZETA) == pytest.approx(0.6, abs=0.03)
    assert 100.0 * residual(zvd, 1.10 * F, ZETA) == pytest.approx(2.4, abs=0.06)


def test_ei_leaves_what_is_tolerated_at_the_mode_and_nothing_on_either_side():
    shaper = impulses(extra_insensitive(F, 0.0, 0.05))
    assert residual(shaper, F, 0.0) == pytest.approx(0.05, rel=1e-9)
    x = np.linspace(0.75, 1.25, 4001)
    size = np.array([residual(shaper, f * F, 0.0) for f in x])
    inside = np.abs(x - 1.0) < 0.19
    assert size[inside].max() <= 0.0501  # insensitivity 0.4 at 5 %
    zeros = x[np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] < size[2:])) + 1]
    assert len(zeros) == 2
    assert zeros[0] < 1.0 < zeros[1]


@pytest.mark.parametrize("frequency", [0.9 * F, F, 1.07 * F])
@pytest.mark.parametrize(
    "profile",
    [
        impulses(zero_vibration(F, ZETA, 1)), impulses(zero_vibration(F, ZETA, 2)), impulses(zero_vibration(F, ZETA, 3)),
        impulses(extra_insensitive(F, ZETA, 0.05)), ramp(0.6), s_curve(1.3), jump().then(jump().scaled(1.0, 1.0), 0.4),
        ramp(0.2).convolved(*zero_vibration(F, ZETA, 2)),
    ],
    ids=["ZV", "ZVD", "ZVDD", "EI", "ramp", "S curve", "step", "ramped ZVD"],
)  # fmt: skip
def test_residuals_are_those_of_an_oscillator_integrated_in_time(profile, frequency):
    found = oscillator_residual(profile, frequency, ZETA)
    assert residual(profile, frequency, ZETA) == pytest.approx(found, abs=2e-8)


def test_a_ramp_of_whole_periods_leaves_nothing():
    assert residual(ramp(1.0 / F), F, 0.0) < 1e-12
    assert residual(ramp(0.5 / F), F, 0.0) == pytest.approx(2.0 / math.pi, rel=1e-9)


def test_an_s_curve_in_legs_is_near_the_curve():
    T = 2.0 / F
    found = residual(s_curve(T), 1.07 * F, 0.0)
    half = 0.5 * math.pi * 1.07 * F * T
    exact = (math.sin(half) / half) ** 2  # two ramps of half the length
    assert found == pytest.approx(exact, rel=5.0 / S_CURVE_LEGS**2 * math.pi**2)
    assert found != exact


def test_convolution_keeps_jumps_and_area():
    base = RateProfile(np.array([0.0, 0.0, 0.3, 0.3]), np.array([0.0, 0.2, 0.5, 1.0]))
    times, parts = zero_vibration(F, ZETA, 2)
    made = base.convolved(times, parts)
    assert made.rates[0] == 0.0
    assert made.rates[-1] == pytest.approx(1.0)
    assert lag(made) == pytest.approx(lag(base) + float(times @ parts), rel=1e-12)
    s = eigenvalue(1.1 * F, ZETA)
    each = sum(
        p * base.residual(s)[0] * np.exp(s[0] * (times[-1] - t))
        for t, p in zip(times, parts, strict=True)
    )
    assert made.residual(s)[0] == pytest.approx(each, rel=1e-10)


# ----------------------------------------------------------------------------- bounds, and the shortest


@pytest.mark.parametrize("dampings", [(ZETA, ZETA), (0.002, 0.05)])
@pytest.mark.parametrize(
    "profile",
    [s_curve(1.3), impulses(zero_vibration(F, ZETA, 1)), ramp(7.9)],
    ids=["S", "ZV", "ramp"],
)
def test_the_bound_is_above_every_value_of_the_region_and_hardly_above_the_largest(
    profile, dampings
):
    mode = mode_of(dampings=dampings, allowed=0.05)
    most = np.max(np.abs(profile.residual(mode.eigenvalues(801, 41))))
    assert most <= mode.worst_residual(profile) <= most + 0.011 * 0.05


@pytest.mark.parametrize("allowed", [1e-3, 10**-1.5, 0.3])
def test_for_a_mode_that_is_known_the_shortest_is_two_steps(allowed):
    """|1 + exp(i omega T)|/2 = cos(omega T/2) = allowed: ZV as allowed goes to 0."""
    mode = mode_of(spread=0.0, dampings=(0.0, 0.0), allowed=allowed, damping=0.0)
    shape, _ = shortest_change(samples_of([mode]), 1.0 / F, Bounds())
    assert shape.duration * F == pytest.approx(math.acos(allowed) / math.pi, abs=0.004)


def test_the_shortest_keeps_two_uncertain_modes_and_is_shorter_than_their_shapers():
    modes = [mode_of(allowed=0.05), mode_of(frequency=2.9, allowed=0.1, spread=0.05)]
    shape, _ = shortest_change(samples_of(modes), 1.0 / F, Bounds(), 0.97)
    assert np.all(np.diff(shape.rates) >= -1e-9)  # no overshoot
    for mode in modes:
        assert mode.worst_residual(shape) <= mode.allowed
    assert shape.duration < shaped(jump(), "ZVD", modes).duration


def test_a_limit_that_no_length_keeps_is_said():
    mode = mode_of(spread=0.5, allowed=1e-4)
    with pytest.raises(
        MicrovibError, match="limit: no profile of up to 1 periods of the slowest mode keeps it"
    ):
        shortest_change(samples_of([mode]), 1.0 / F, Bounds(), longest=1.0)


def test_an_acceleration_is_kept():
    shape, _ = shortest_change(samples_of([mode_of()]), 1.0 / F, Bounds(acceleration=1.5))
    assert shape.largest_acceleration <= 1.5 * (1.0 + 1e-6)
    free, _ = shortest_change(samples_of([mode_of()]), 1.0 / F, Bounds())
    assert free.duration < shape.duration


def test_the_shortest_of_a_family_is_found_at_its_first_length():
    """A ramp leaves sin(x)/x with x = pi f T: one of a single frequency is one period long."""
    mode = mode_of(spread=0.0, dampings=(0.0, 0.0), allowed=1e-3, damping=0.0)
    assert shortest_of(ramp, 0.0, [mode]).duration * F == pytest.approx(1.0, abs=2e-3)
    hopeless = mode_of(spread=0.5, allowed=1e-6)
    assert shortest_of(ramp, 0.0, [hopeless]) is None


# ----------------------------------------------------------------------------- manoeuvres


@pytest.mark.parametrize(
    ("initial", "final", "angle"),
    [(0.0, RATE, 0.02), (0.0, 0.0, 0.1), (RATE, RATE, -0.05), (-RATE, 0.0, 0.2)],
)
def test_a_rotation_gains_its_angle_on_the_target(initial, final, angle):
    turn = Manoeuvre(initial, final, angle, largest_rate=5.0 * RATE)
    made = turn.profile([s_curve(0.8), impulses(zero_vibration(F, ZETA, 2))])
    assert made.angle - final * made.duration == pytest.approx(angle, rel=1e-9)
    assert np.max(np.abs(made.rates)) == pytest.approx(5.0 * RATE)
    assert made.rates[-1] == pytest.approx(final)


def test_a_small_angle_is_turned_at_a_smaller_rate():
    turn = Manoeuvre(0.0, 0.0, 0.001, largest_rate=5.0 * RATE)
    made = turn.profile([ramp(1.0), ramp(1.0)])
    assert made.angle == pytest.approx(0.001, rel=1e-9)
    assert np.max(made.rates) == pytest.approx(0.001)
    with pytest.raises(OptionError, match=r"angle .*too small"):
        Manoeuvre(0.0, RATE, -1e-7, largest_rate=2.0 * RATE).profile([ramp(9.0), ramp(9.0)])


def test_legs_are_the_profile(state_1):
    profile = ramp(0.3).convolved(*zero_vibration(F, ZETA, 2)).scaled(0.0, RATE)
    made = with_profile(state_1.with_({"tracking.clock_ratio": 1.0}), profile)
    times, rates = made.tracking.breakpoints()
    t = np.linspace(0.0, profile.duration, 997)
    assert np.interp(t, times, rates) == pytest.approx(profile.at(t), abs=1e-15)
    assert made.record.settle == pytest.approx(profile.duration)
    many = RateProfile(np.arange(1502.0), np.tile([0.0, RATE], 751))
    with pytest.raises(MicrovibError, match="1501 legs are needed; at most 1000"):
        legs_of(many)


# ----------------------------------------------------------------------------- the drive


@pytest.fixture(scope="module")
def frictionless(state_1):
    return state_1.with_si(FRICTIONLESS)


def test_the_step_of_the_linearised_drive_is_that_of_a_run(frictionless):
    case = case_of(frictionless, ("array_mode_1",), 1.0, 1.0, 1.0)
    (found,) = measure(case, jump().scaled(0.0, RATE))
    expected = case.gains[0] * RATE
    assert found.most == pytest.approx(abs(expected), rel=4e-3)
    late = np.angle(expected / found.value) / (2.0 * math.pi * case.modes[0].frequency)
    assert 0.0 < late < 1.5e-3  # seconds, of the current loop, which the linearised drive has not


def test_a_gain_is_what_a_rigid_hold_would_make_of_one_mode(state_1):
    """On a shaft that follows its command a step of the rate leaves H^2 omega ringing."""
    stiff = state_1.with_si({**FRICTIONLESS, "reducer.stiffness": "rigid", "motor.current": 600.0})
    (mode,) = (m for m in coupled_modes(stiff) if m.name == "array_mode_1")
    H_squared = stiff.array.inertia - stiff.array.rigid_inertia
    (gain,) = np.abs(rate_step_response(stiff, (mode,)))
    assert gain == pytest.approx(
        H_squared * 2.0 * math.pi * stiff.array.modes[0].frequency, rel=1e-3
    )


@pytest.mark.parametrize("frequency", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("order", [1, 2])
def test_without_friction_and_detent_the_full_model_rings_as_the_closed_form_says(
    frictionless, order, frequency
):
    nominal = case_of(frictionless, ("array_mode_1",), 1.0, 1.0, 1.0).modes[0]
    shape = impulses(zero_vibration(nominal.frequency, nominal.damping, order))
    case = case_of(frictionless, ("array_mode_1",), frequency, 1.0, 1.0)
    assert case.modes[0].frequency == pytest.approx(frequency * nominal.frequency, rel=1e-9)
    (found,) = measure(case, shape.scaled(0.0, RATE))
    step = abs(case.gains[0]) * RATE
    expected = residual(shape, case.modes[0].frequency, case.modes[0].damping)
    assert found.most / step == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    "noise",
    [
        {"friction.position": {"roughness": {"density": "1e-6", "lowest": 1000, "highest": 20000}}},
        {"friction.torque_noise": {"density": "2e-5 N^2*m^2/Hz", "highest": "5 Hz"}},
    ],
)
def test_noise_of_the_friction_rings_on_top(state_1, noise):
    """What draws of it leave ringing in three periods after a start is below what a run is said to have at most."""
    start = RateProfile.of_jumps(np.array([0.0]), np.array([state_1.rate]))
    [quiet] = measure(Case(state_1, ("array_mode_1",)), start)
    [noisy] = measure(Case(state_1.with_(noise), ("array_mode_1",)), start)
    assert noisy.amplitude == pytest.approx(quiet.amplitude, rel=1e-9)
    assert noisy.most > quiet.most + 0.005
    mode = next(m for m in coupled_modes(state_1) if m.name == "array_mode_1")
    found = []
    for seed in range(4):
        kind = (
            "friction.torque_noise"
            if "friction.torque_noise" in noise
            else "friction.position.roughness"
        )
        drawn = state_1.with_(noise).with_({f"{kind}.seed": seed})
        run = drawn.with_({"record.settle": "40 s", "record.duration": "12 s"})
        x = mv.simulate(run, channels=("T_d",))["T_d"]
        size = round(3.0 / mode.frequency * run.record.sample_rate)
        turn = np.exp(-2j * np.pi * mode.frequency * np.arange(size) / run.record.sample_rate)
        window = np.hanning(size)
        pieces = np.lib.stride_tricks.sliding_window_view(x, size)[::size]
        found += (2.0 * np.abs(pieces @ (turn * window)) / window.sum()).tolist()
    assert 0.1 * (noisy.most - quiet.most) < np.quantile(found, 0.9) < noisy.most


def test_friction_spoils_shapers_and_a_corrected_shape_does_not_ring(state_1):
    plan = mv.plan_profile(state_1, frequency_uncertainty=0.0, damping_uncertainty=0.0)
    assert plan["ZVD"].linear_worst < 1e-3
    assert plan["ZVD"].measured_worst > 0.3
    assert plan["ZVD"].verdict == "fail"
    assert plan[FULL].measured_worst < 10**-1.5
    assert plan.best.name == FULL
    assert plan.best.duration < 1.5 * plan.period


@pytest.fixture(scope="module")
def plan(state_1):
    return mv.plan_profile(state_1)


@pytest.mark.long
def test_a_start_is_30_dB_quieter_over_ten_percent_within_one_and_a_half_periods(plan):
    best = plan.best
    assert best.name == FULL
    assert best.duration < 1.5 * plan.period
    counted = [run for run in best.runs if run.counts]
    assert {run.case.frequency for run in counted} >= {0.9, 0.95, 1.0, 1.05, 1.1, 0.975, 1.025}
    assert all(20.0 * math.log10(run.below_step) < -30.0 for run in counted)
    assert {run.ringing.status for run in counted} == {"decaying"}
    for name in ("ZV", "ZVD", "EI", "ZVDD", LINEAR, STEP):
        assert plan[name].verdict == "fail"
    assert plan[LINEAR].linear_worst <= 10**-1.5
    assert plan[STEP].measured_worst == pytest.approx(1.0, abs=0.03)


@pytest.mark.long
@pytest.mark.parametrize("frequency", sweep([0.91, 0.97, 1.03, 1.09], 0.91))
def test_the_scenario_that_is_handed_over_rings_as_was_said(plan, frequency):
    """Frequencies at which the shape was neither found nor checked, the clamped one off by so much, lines of another record."""
    clamped = plan.scenario.array.modes[0].frequency
    changes = {"array.modes.0.frequency": frequency * clamped, "record.duration": 12.0}
    made = plan.commanded(plan.best).with_si(changes)
    line = mv.find_lines(made)["array_mode_1"]
    step = mv.find_lines(plan.scenario.with_si({**changes, "record.settle": 0.0}))["array_mode_1"]
    assert line.amplitude_at_start(12.0) < 10**-1.5 * step.amplitude_at_start(12.0)


@pytest.mark.long
def test_files_of_a_plan(plan):
    outcome = profile_outcome(plan)
    assert outcome.verdict == "pass"
    files = text_files(outcome)
    rows = list(csv.DictReader(io.StringIO(files["profile.csv"])))
    assert float(rows[-1]["time_s"]) == pytest.approx(plan.best.duration, rel=1e-8)
    assert float(rows[-1]["rate_deg_s"]) == pytest.approx(0.06)
    instants = list(csv.DictReader(io.StringIO(files["instants.csv"])))
    turned = 0.994 * plan.best.profile.angle / (math.radians(1.8) / 16 / 100)
    assert int(instants[-1]["count"]) == round(turned)
    times = np.array([float(row["time_s"]) for row in instants])
    assert np.all(np.diff(times) > 0.0)
    said = terminal_text(outcome)
    wound = 0.9 * math.degrees(wind_up(plan.scenario))
    assert f"It begins with {wound:.3g} deg at the full rate" in said
    assert "With friction 10 % less or more" in terminal_text(outcome)


def test_a_stop_turns_through_its_microsteps(state_1):
    plan = mv.plan_profile(state_1, initial_rate="0.06 deg/s", final_rate="0 deg/s", runs=False)
    shape = plan["ZVD"]
    found = plan.instants(shape)
    assert found.times[0] >= 0.0
    step = math.radians(1.8) / 16 / 100
    assert abs(found.counts[-1] - 0.994 * shape.profile.angle / step) <= 1.0
    assert shape.start > 30.0
    made = plan.commanded(shape)
    assert made.tracking.profile[-1].rate == 0.0
    assert made.record.settle == pytest.approx(shape.start + shape.duration)


@pytest.mark.release
def test_a_stop_is_quiet_and_says_what_another_begin_costs(state_1):
    plan = mv.plan_profile(
        state_1, initial_rate="0.06 deg/s", final_rate="0 deg/s", damping_uncertainty=0.0
    )
    best = plan.best
    assert best.name == FULL
    assert best.duration < 1.5 * plan.period
    late = [run for run in best.runs if run.case.late]
    assert {run.case.late for run in late} == {0.25, 0.5, 0.75}
    assert not any(run.counts for run in late)
    assert max(run.below_step for run in late) > 2.0 * best.measured_worst
    said = terminal_text(profile_outcome(plan))
    into = plan.microsteps_into_full_step(best)
    assert f"It is made for a begin {into:.2f} microsteps after a full step" in said
    turned = plan.commanded(best).tracking.breakpoints()
    before = turned[0] <= best.start + 1e-9
    count = np.trapezoid(turned[1][before], turned[0][before]) / (math.radians(1.8) / 16 / 100)
    assert into == pytest.approx(count % 16, abs=1e-6)
    assert "Begun a quarter, half or three quarters of a full step later" in said


TWO_MODES = {
    "array.inertia": 8.18, "array.rigid_inertia": None,
    "array.modes": [
        {"frequency": 0.8, "damping": 0.01, "effective_inertia": 6.0},
        {"frequency": 2.1, "damping": 0.01, "effective_inertia": 1.8},
    ],
}  # fmt: skip


@pytest.mark.release
def test_two_modes_are_kept_quiet(state_1):
    plan = mv.plan_profile(
        state_1.with_si(TWO_MODES), frequency_uncertainty="5 percent", attenuation=26.0
    )
    assert [mode.name for mode in plan.modes] == ["array_mode_1", "array_mode_2"]
    assert plan.best.name == FULL
    for shape in (plan[LINEAR], plan["ZVD"]):
        assert {one.mode for one in shape.residuals} == {"array_mode_1", "array_mode_2"}
    assert {run.mode for run in plan.best.runs} == {"array_mode_1", "array_mode_2"}
    assert plan[LINEAR].duration < plan["ZVD"].duration


def test_two_modes_by_the_linearised_drive(state_1):
    plan = mv.plan_profile(state_1.with_si(TWO_MODES), runs=False, limit="3 mN*m")
    assert all(one.worst <= one.limit for one in plan[LINEAR].residuals)
    assert plan[LINEAR].verdict == "not judged"
    assert plan.best is None
    assert profile_outcome(plan).verdict == "not judged"
    assert plan[LINEAR].duration < plan["ZVD"].duration


# ----------------------------------------------------------------------------- a limit over frequency


def curve(*points) -> mv.Limit:
    return mv.Limit.over_frequency([(f"{f} Hz", f"{a} mN*m") for f, a in points])


@pytest.fixture(scope="module")
def two_modes(state_1):
    return state_1.with_si(TWO_MODES)


def test_a_flat_curve_is_its_number(two_modes):
    one = mv.plan_profile(two_modes, runs=False, limit="3 mN*m")
    for same in (mv.Limit("3 mN*m"), curve((0.1, 3.0), (100.0, 3.0))):
        found = mv.plan_profile(two_modes, runs=False, limit=same)
        assert [shape.duration for shape in found.shapes] == [s.duration for s in one.shapes]
        assert [s.residuals for s in found.shapes] == [s.residuals for s in one.shapes]
        assert found.limit == one.limit


def test_each_mode_keeps_the_limit_at_its_own_frequency(two_modes):
    """Ten times as much for the second mode: its residual may be ten times as large, and the profile shorter."""
    first, second = (mode.frequency for mode in mv.plan_profile(two_modes, runs=False).modes)
    between = math.sqrt(first * second)
    at = curve((0.1, 3.0), (between, 3.0), (between, 30.0), (100.0, 30.0))
    plan = mv.plan_profile(two_modes, runs=False, limit=at)
    even = mv.plan_profile(two_modes, runs=False, limit="3 mN*m")
    allowed = {one.mode: one.limit for one in plan[LINEAR].residuals}
    assert allowed["array_mode_1"] == pytest.approx(3e-3 / 1.1)
    if "array_mode_2" in allowed:
        assert allowed["array_mode_2"] == pytest.approx(30e-3 / 1.1)
    assert plan[LINEAR].duration < even[LINEAR].duration
    assert "limit 3 to 30 mN m from 0.1 to 100 Hz" in terminal_text(profile_outcome(plan))


def test_a_notch_within_the_uncertainty_of_a_mode_counts_wherever_it_is(state_1):
    """Between two of the frequencies that are run, too: a verdict is not decided by where a case is."""
    (mode,) = mv.plan_profile(state_1, runs=False).modes
    f = 1.0375 * mode.frequency  # runs are at 0.9, 1 and 1.1 of it, and checks at 1.025 and 1.05
    notch = ((0.1, 20.0), (0.999 * f, 20.0), (f, 2.0), (1.001 * f, 20.0), (100.0, 20.0))
    plan = mv.plan_profile(state_1, runs=False, limit=curve(*notch))
    even = mv.plan_profile(state_1, runs=False, limit="2 mN*m")
    assert [s.residuals for s in plan.shapes] == [s.residuals for s in even.shapes]
    assert [s.duration for s in plan.shapes] == [s.duration for s in even.shapes]


def test_a_run_fails_only_what_no_limit_at_its_frequency_allows():
    ringing = Ringing(5e-3, 0.0, 5e-3, "decaying")
    case = Case(mv.load_scenario("state-1"), ("array_mode_1",))
    assert Run("step", case, "array_mode_1", ringing, 2e-3, 1.0).verdict == "fail"
    between = Run("step", case, "array_mode_1", ringing, 2e-3, 1.0, fails_above=20e-3)
    assert between.verdict == "not judged"
    above = Run("step", case, "array_mode_1", ringing, 2e-3, 1.0, fails_above=4e-3)
    assert above.verdict == "fail"


def test_a_mode_where_the_limit_has_no_value_is_named_and_one_alone_is_refused(two_modes, state_1):
    plan = mv.plan_profile(two_modes, runs=False, limit=curve((0.1, 3.0), (1.2, 3.0)))
    assert [mode.name for mode in plan.modes] == ["array_mode_1"]
    assert plan.not_limited == ("array_mode_2",)
    said = terminal_text(profile_outcome(plan))
    assert "Not limited, since the limit has no value at their frequencies: array_mode_2." in said
    with pytest.raises(MicrovibError, match="from 20 to 100 Hz and limits no mode: array_mode_1"):
        mv.plan_profile(state_1, runs=False, limit=curve((20.0, 3.0), (100.0, 3.0)))


def test_the_command_takes_a_curve(tmp_path):
    (tmp_path / "allowed.csv").write_text("frequency_hz,t_mnm\n0.5,2\n10,20\n")
    words = ["profile", "state-1", "--linear", "--limit", str(tmp_path / "allowed.csv")]
    run = CliRunner().invoke(main, [*words, "-o", str(tmp_path / "plan")])
    assert run.exit_code == 0, run.output
    assert "limit 2 to 20 mN m from 0.5 to 10 Hz" in run.output
    assert "fails by the most lenient one at its frequency" in " ".join(run.output.split())
    (tmp_path / "loads.csv").write_text("frequency_hz,fx_n\n0.5,2\n10,20\n")
    run = CliRunner().invoke(main, [*words[:-1], str(tmp_path / "loads.csv")])
    assert run.exit_code != 0
    assert "a rate profile looks at the torque about the drive axis alone" in run.output


# ----------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"final_rate": 0.0}, "final_rate 0 deg/s: is the initial rate"),
        ({"final_rate": "1 m"}, "wrong dimension"),
        ({"final_rate": 0.1}, "needs a unit"),
        ({"angle": "2 deg"}, "largest_rate: is needed with an angle"),
        ({"largest_rate": "1 deg/s"}, "largest_rate: applies to a rotation by an angle"),
        ({"angle": "2 deg", "largest_rate": "0.05 deg/s"}, "must be above the rates before and after the manoeuvre, 0.06 deg/s"),
        ({"angle": "0 deg", "largest_rate": "1 deg/s"}, "angle: must not be 0"),
        ({"limit": "0 N*m"}, "limit: .*greater than 0"),
        ({"attenuation": -3.0}, "attenuation -3: must be above 0"),
        ({"frequency_uncertainty": "80 percent"}, "frequency_uncertainty 80 percent: must be at least 0"),
        ({"largest_acceleration": "0 deg/s^2"}, "largest_acceleration: .*greater than 0"),
    ],
)  # fmt: skip
def test_wrong_options_are_refused(state_1, options, sentence):
    with pytest.raises(MicrovibError, match=sentence):
        mv.plan_profile(state_1, runs=False, **options)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"array.modes": [], "array.rigid_inertia": None}, "array.modes: is empty; a rigid array does not ring"),
        ({"friction.breakaway": 900.0}, "motor.current: is too small"),
    ],
)  # fmt: skip
def test_drives_that_no_profile_suits_are_refused(state_1, changes, sentence):
    with pytest.raises(MicrovibError, match=sentence):
        mv.plan_profile(state_1.with_si(changes), runs=False)


def test_the_command_writes_its_folder_and_refuses_in_a_sentence(tmp_path):
    run = CliRunner().invoke(main, ["profile", "state-1", "--linear", "-o", str(tmp_path / "plan")])
    assert run.exit_code == 0, run.output
    assert "shortest, linearised drive" in run.output
    assert "Not judged: the full model was not run" in run.output
    names = {path.name for path in (tmp_path / "plan").iterdir()}
    assert {
        "shapes.csv",
        "linear.csv",
        "profile.csv",
        "instants.csv",
        "scenario.yaml",
        "profile.png",
        "report.html",
    } <= names
    again = mv.load_scenario(tmp_path / "plan" / "scenario.yaml")
    assert again.tracking.profile is not None
    run = CliRunner().invoke(main, ["profile", "state-1", "--final-rate", "0 deg/s"])
    assert run.exit_code != 0
    assert "--final-rate" in run.output
    assert "Traceback" not in run.output


# ---- The worst within the ranges ----


def test_the_worst_of_a_narrow_peak_is_found_and_what_is_left_is_bounded():
    """Ringing that is largest between the points of the first grid, off in frequency and in damping."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        centre, width = rng.uniform(0.87, 1.13), rng.uniform(0.02, 0.1)
        lightest = rng.uniform(0.5, 1.5)

        def rings(at, centre=centre, width=width, lightest=lightest):
            peak = 1.0 / (1.0 + ((at[0] - centre) / width) ** 2)
            return peak * math.exp(-((at[1] - lightest) ** 2)) * np.exp(3j * at[0])

        def measured(points, rings=rings):
            found = []
            for at in points:
                case = Case(mv.load_scenario("state-1"), ("mode",), *at)
                c = rings(at)
                found.append((case, (Ringing(abs(c), float(np.angle(c)), abs(c), "ok"),)))
            return found

        worst = search_worst(start_grid(0.15, 0.5, 0.0), measured, lambda case: np.ones(1))
        largest = max(one.most for (one,) in worst.ringing)
        true = max(
            abs(rings((f, d, 1.0)))
            for f in np.linspace(0.85, 1.15, 301) for d in np.linspace(0.5, 1.5, 101)
        )  # fmt: skip
        assert largest >= true - TOLERANCE
        assert true <= largest + worst.between
        assert worst.between <= TOLERANCE


@pytest.mark.release
def test_a_profile_keeps_its_limit_at_any_frequency_and_damping(state_1):
    """The worst is at 50 % less damping and 5.6 % more frequency, where runs at the ends are quiet."""
    drive = state_1.with_si(
        {"tracking.rate": math.radians(0.1), "driver.microsteps": 32, "array.modes.0.damping": 0.05}
    )
    plan = mv.plan_profile(
        drive, limit="4 mN*m", frequency_uncertainty="15 percent", damping_uncertainty="50 percent"
    )
    assert plan.best is not None
    most = plan.best.largest_ringing + plan.best.between * 4e-3
    assert most <= 4e-3
    drawn = np.random.default_rng(1).uniform((0.85, 0.5), (1.15, 1.5), (25, 2)).tolist()
    for frequency, damping in ((1.0559, 0.5), *drawn):
        case = case_of(drive, ("array_mode_1",), frequency, damping, 1.0)
        (ringing,) = measure(case, plan.best.whole)
        assert ringing.most <= most * 1.001
