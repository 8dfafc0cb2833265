"""Drives by voltage pulses: against windings integrated one by one by SciPy, and closed forms."""

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.pulse_scenarios import HELD, drawn, scenario_of
from support.pulses import CURRENTS, TL, TM, WL, WM, Friction, integrate
from support.stopped import rows_at
from support.tiers import at_a_release

import microvib as mv
from microvib.errors import MicrovibError, OptionError, ScenarioError
from microvib.reports.outcome import Picture
from microvib.reports.step_margin import draw_step_margin, step_margin_outcome
from microvib.solve import kernel
from microvib.solve.motion import StepCount
from microvib.studies.step_margin import StepMargin, StepRun, step_margin

SEEDS, STEPS = (3, 8, 11), 6
"""Of the first dozen draws three that make all steps."""
COLUMNS = ("i_A", "i_B", "theta_m", "omega_m", "theta_l", "omega_l")
FINE = {"solver.accuracy": 1e-6}
CLAMPS = ("unidirectional", "bidirectional")
ALWAYS = ((3, "unidirectional"), (11, "bidirectional"))
DRAWN = pytest.mark.parametrize(
    ("seed", "clamp"),
    [one if one in ALWAYS else at_a_release(*one) for one in itertools.product(SEEDS, CLAMPS)],
)
"""Each clamp on a draw of its own; the others at a release."""


def rows_of(scenario, times, names=COLUMNS):
    return rows_at(scenario, times)[0][:, [kernel.CHANNELS.index(name) for name in names]]


def clamped(drive, clamp):
    """The drive of the oracle: two windings, or four of which each conducts either way."""
    both = clamp == "bidirectional"
    return replace(drive, four_windings=both, both_ways=both)


@cache
def by_oracle(seed, clamp):
    drive = clamped(drawn(seed), clamp)
    times = 0.5 * drive.step_time + np.arange(0.0, STEPS * drive.step_time, 1e-3)
    return integrate(drive, STEPS, times=times, first=0.5 * drive.step_time)


def columns_of(y):
    """``COLUMNS`` of the oracle's states; of two windings on a phase the difference of currents."""
    i = y[:, CURRENTS:]
    if i.shape[1] == 4:
        i = i[:, :2] - i[:, 2:]
    return np.column_stack([i, y[:, [TM, WM, TL, WL]]])


@DRAWN
def test_angles_rates_and_currents_are_those_of_an_independent_integration(seed, clamp):
    drive, run = clamped(drawn(seed), clamp), by_oracle(seed, clamp)
    assert run.lost == run.gained == 0
    found = rows_of(scenario_of(drive, STEPS, **FINE), run.t)
    expected = columns_of(run.y)
    difference, size = np.abs(found - expected).max(axis=0), np.abs(expected).max(axis=0)
    assert np.all(difference[[0, 1, 3, 5]] < 1e-3 * size[[0, 1, 3, 5]])
    step = drive.full_step
    assert difference[2] < 1e-3 * step
    assert difference[4] < 1e-3 * step / drive.ratio


@DRAWN
def test_lines_of_the_torque_are_those_of_an_independent_integration(seed, clamp):
    drive, run = clamped(drawn(seed), clamp), by_oracle(seed, clamp)
    scenario = scenario_of(drive, STEPS, **FINE)
    found = rows_of(scenario, run.t, ("omega_m", "omega_l"))
    inertia = np.array([drive.J_m, drive.J_l])
    momentum = np.column_stack([found @ inertia, run.y[:, [WM, WL]] @ inertia])
    torque = -np.diff(momentum, axis=0) / 1e-3
    last = torque[-round(4 * drive.step_time / 1e-3) :]
    t, lines = 1e-3 * np.arange(len(last)), np.arange(1, 13) / drive.step_time
    window = np.hanning(len(last))[:, None]
    mine, oracle = np.abs(np.exp(-2j * math.pi * np.outer(lines, t)) @ (window * last)).T
    assert np.all(np.abs(mine - oracle) < 1e-3 * oracle.max())


@DRAWN
def test_a_coarser_run_is_near_and_its_balances_hold(seed, clamp):
    drive, run = clamped(drawn(seed), clamp), by_oracle(seed, clamp)
    motion = mv.simulate(scenario_of(drive, STEPS))
    assert not motion.invariants.broken
    assert motion.invariants.energy < 1e-4
    assert motion.steps == StepCount(STEPS, 0, 0, 0)
    rest = rows_of(scenario_of(drive, STEPS), run.t)
    assert np.abs(rest[:, 2] - run.y[:, TM]).max() < 0.01 * drive.full_step


def test_both_windings_of_a_pair_conduct_alike_and_brake_twice():
    """After its pulse a rotor that swings past 8 V has equal currents in the windings of a pair that
    was not driven, one each way; with diodes one of them, and half the torque."""
    drive = clamped(HELD, "bidirectional")
    t = 0.5 * drive.step_time + np.arange(1e-3, drive.on_time, 1e-4)
    rows, packed = rows_at(scenario_of(drive, 1), t)
    net = rows[:, kernel.CHANNELS.index("i_A")]
    run = integrate(drive, 1, times=t, first=0.5 * drive.step_time)
    a, _, c, _ = run.y[:, CURRENTS:].T
    assert np.abs(net).max() > 1e-3
    assert a == pytest.approx(-c, abs=1e-9)
    assert net == pytest.approx(2.0 * a, abs=2e-3 * np.abs(a).max())
    assert packed.drive.windings == 4


def test_a_clamp_that_is_not_reached_does_not_matter():
    free, same = (
        scenario_of(clamped(replace(HELD, diode_voltage=400.0), clamp), 2) for clamp in CLAMPS
    )
    t = 0.5 * HELD.step_time + np.arange(0.0, 1.0, 1e-2)
    assert rows_of(same, t) == pytest.approx(rows_of(free, t), rel=1e-6, abs=1e-9)


def test_current_rises_freewheels_against_the_diodes_and_stays_exactly_zero():
    held = replace(HELD, rotor=Friction(coulomb=10.0), K_d=0.0)
    scenario = scenario_of(held, 1)
    start, tau = 0.5 * held.step_time, held.L / held.R
    end, final = start + held.on_time, held.voltage / held.R
    last = final * (1.0 - math.exp(-held.on_time / tau))
    zero = end + tau * math.log(1.0 + last * held.R / held.diode_voltage)
    times = np.array([start + 0.3 * tau, start + 3.0 * tau, end - 1e-4, end + 0.5 * tau, zero - 1e-4, zero + 1e-6, zero + 1.0])  # fmt: skip
    rows = rows_of(scenario, times, ("i_A", "i_B", "u_B", "E_magnetic"))
    rising = final * -np.expm1(-(times[:3] - start) / tau)
    against = held.diode_voltage / held.R
    falling = (last + against) * np.exp(-(times[3:5] - end) / tau) - against
    assert rows[:5, 1] == pytest.approx(np.r_[rising, falling], rel=1e-6)
    assert rows[:5, 2] == pytest.approx([held.voltage] * 3 + [-held.diode_voltage] * 2)
    assert np.all(rows[5:, :2] == 0.0)
    assert np.all(rows[:, 0] == 0.0)


def test_an_open_winding_has_its_back_emf_and_no_current_until_that_exceeds_the_diodes():
    drive = replace(HELD, diode_voltage=60.0)
    run = integrate(drive, 1, first=0.5 * drive.step_time)
    assert run.lost == 0
    t = 0.5 * drive.step_time + drive.on_time + 0.05 + np.arange(0.0, 0.1, 1e-4)
    rows = rows_of(scenario_of(drive, 1), t, ("i_A", "i_B", "u_A", "u_B", "theta_m", "omega_m"))
    p = drive.teeth * rows[:, 4]
    emf = drive.K_m * rows[:, 5]
    assert np.all(rows[:, :2] == 0.0)
    assert rows[:, 2] == pytest.approx(-emf * np.sin(p), abs=1e-12)
    assert rows[:, 3] == pytest.approx(emf * np.cos(p), abs=1e-12)


def test_no_current_flows_through_diodes_that_the_back_emf_does_not_reach():
    """What conducts is decided by the voltage: the rotor swings freely with high diodes, and with low
    ones the windings brake it."""
    free, braked = (replace(HELD, diode_voltage=volts) for volts in (60.0, 2.0))
    t = 0.5 * HELD.step_time + np.arange(0.0, 1.0, 1e-4)
    currents = [
        np.abs(rows_of(scenario_of(drive, 1), t, ("i_A",))).max() for drive in (free, braked)
    ]
    assert currents[0] == 0.0
    assert currents[1] > 1e-3


def test_no_step_is_lost():
    assert mv.simulate(scenario_of(HELD, 4), channels="T_d").steps == StepCount(4, 0, 0, 0)


@pytest.mark.release
def test_all_steps_are_lost_where_the_pulse_does_not_move_the_rotor():
    weak = replace(HELD, voltage=10.0, rotor=Friction(coulomb=0.05))
    found = mv.simulate(scenario_of(weak, 5), channels="T_d").steps
    run = integrate(weak, 5, first=0.5 * weak.step_time)
    assert (run.lost, run.gained, run.first) == (5, 0, 1)
    assert found == StepCount(5, 5, 0, 1)


@pytest.mark.parametrize(
    ("seed", "clamp"),
    [
        (2, CLAMPS[0]),
        at_a_release(15, CLAMPS[0]),
        at_a_release(2, CLAMPS[1]),
        (15, CLAMPS[1]),
    ],
)
def test_some_steps_are_lost_and_counted_as_by_an_independent_integration(seed, clamp):
    drive = clamped(drawn(seed), clamp)
    run = integrate(drive, STEPS, first=0.5 * drive.step_time)
    assert 0 < run.lost < STEPS
    found = mv.simulate(scenario_of(drive, STEPS, **FINE), channels="T_d").steps
    assert found == StepCount(STEPS, run.lost, run.gained, run.first)


def test_motion_of_another_drive_counts_no_steps():
    scenario = mv.load_scenario("state-1").with_si({"record.settle": 0.1, "record.duration": 0.2})
    assert mv.simulate(scenario, channels="T_d").steps is None


@pytest.mark.parametrize("clamp", CLAMPS)
def test_backwards_steps_are_made_and_lost_alike(clamp):
    held = clamped(HELD, clamp)
    scenario = scenario_of(held, 4)
    back = scenario.with_si({"tracking.rate": -scenario["tracking.rate"]})
    assert mv.simulate(back, channels="T_d").steps == StepCount(4, 0, 0, 0)
    weak = replace(held, voltage=10.0, rotor=Friction(coulomb=0.05))
    lost = scenario_of(weak, 4, **{"tracking.rate": -scenario["tracking.rate"]})
    assert mv.simulate(lost, channels="T_d").steps == StepCount(4, 4, 0, 1)


PULSE = {
    "driver.drive": "pulse",
    "driver.microsteps": 1,
    "driver.proportional_gain": "0 V/A",
    "driver.integral_gain": "0 V/(A*s)",
    "driver.supply_voltage": "70 V",
    "driver.on_time": "60 ms",
    "driver.diode_voltage": "8 V",
    "tracking.rate": "0.004 deg/s",
}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"driver.diode_voltage": None}, "driver.diode_voltage"),
        ({"driver.supply_voltage": None}, "driver.supply_voltage"),
        ({"driver.on_time": None}, "driver.on_time: is null, but drive: pulse needs it; give it in ms"),
        ({"driver.on_time": "6 s"}, "driver.on_time: 6000 ms is longer than a step, which takes"),
        ({"driver.drive": "current", "driver.proportional_gain": "500 V/A"}, "only acts with drive: pulse"),
        ({"driver.microsteps": 16}, "microsteps: 16 is not allowed with drive: pulse"),
        ({"driver.beats": 6}, "beats: 6 is not allowed with drive: pulse"),
        ({"driver.proportional_gain": "5 V/A"}, "pulse has no current loop"),
        ({"driver.microstep_ramp": 0.5}, "microstep_ramp: shapes currents"),
        ({"driver.microstep_shape": [{}, {"fraction": 0.5, "after": "3 ms"}]}, "microstep_shape: shapes currents"),
        ({"driver.compensation": [{"order": 2, "amplitude": "9 arcsec"}]}, "compensation: cannot be combined with"),
        ({"driver.diode_voltage": "0 V"}, "driver.diode_voltage"),
        ({"driver.clamp": "bidirectional", "driver.diode_voltage": None}, "driver.diode_voltage: is null, but drive: pulse needs it; give it in V"),
        ({"driver.clamp": "both"}, "driver.clamp: 'both' is not allowed; write 'unidirectional' or 'bidirectional'"),
        ({"driver.clamp": "8 V"}, "driver.clamp: '8 V' is not allowed; write 'unidirectional' or 'bidirectional'"),
        ({"motor.phases": 3, "driver.beats": 4}, "with 3 phases"),
    ],
)  # fmt: skip
def test_what_no_pulse_drive_can_be_is_told_in_one_sentence(changes, words):
    with pytest.raises(ScenarioError) as caught:
        mv.load_scenario("state-1").with_(PULSE | changes)
    assert words in str(caught.value)


def test_a_pulse_as_long_as_a_step_is_a_lasting_voltage():
    """Then windings are switched from one to the next, and all steps are made."""
    drive = replace(HELD, step_time=0.5, on_time=0.5)
    assert mv.simulate(scenario_of(drive, 4), channels="T_d").steps == StepCount(4, 0, 0, 0)


def test_a_pulse_drive_has_no_steady_state_and_says_so():
    scenario = scenario_of(HELD, 2).with_si({"record.start": "steady"})
    assert "voltage pulses" in mv.simulate(scenario, channels="T_d").solver["steady"]


def test_a_clamp_belongs_to_pulses():
    scenario = mv.load_scenario("state-1")
    with pytest.raises(ScenarioError, match="clamp: only acts with drive: pulse"):
        scenario.with_({"driver.clamp": "bidirectional"})


WEAK = replace(HELD, voltage=30.0, step_time=0.5)
"""With a friction about half the torque of its pulse it loses steps somewhere."""


def test_a_margin_finds_where_steps_are_lost():
    scenario = scenario_of(WEAK, 3)
    found = step_margin(scenario, "motor.friction.breakaway=0.005:0.4 N*m", count=4)
    assert [found.runs[0].state, found.runs[-1].state] == ["made", "lost"]
    edge = found.edges[0]
    assert edge.begins
    assert edge.above.value - edge.below.value == pytest.approx((0.4 - 0.005) / 3 / 16)
    for run in (edge.below, edge.above):
        friction = Friction(
            WEAK.rotor.coulomb, run.value - WEAK.rotor.coulomb, 1.0, WEAK.rotor.viscous
        )
        oracle = integrate(replace(WEAK, rotor=friction), 3, first=0.5 * WEAK.step_time)
        assert (run.lost, run.gained, run.first) == (oracle.lost, oracle.gained, oracle.first)


def test_a_margin_is_drawn_as_it_was_found():
    """One point a run, shaded where both neighbours lose steps, hatched where one does."""

    def run(value: float, lost: int, first: int, problem: str = "") -> StepRun:
        return StepRun(value, 0 if problem else 9, lost, 0, first, problem)

    runs = run(60.0, 0, 0), run(61.0, 2, 7), run(62.0, 4, 3), run(63.0, 0, 0), run(64.0, 0, 0, "no")
    margin = StepMargin(scenario_of(HELD, 2), "driver.supply_voltage", 60.0, 64.0, runs)
    count, first = draw_step_margin(margin).axes
    drawn = [line.get_xydata().tolist() for line in count.lines]
    assert drawn == [[[60.0, 0.0], [63.0, 0.0]], [[61.0, 2.0], [62.0, 4.0]], [[64.0, 0.0]]]
    assert [line.get_xydata().tolist() for line in first.lines] == [[[61.0, 7.0], [62.0, 3.0]]]
    ends = [(x.get_x(), x.get_x() + x.get_width(), bool(x.get_hatch())) for x in count.patches]
    assert ends == [(60.0, 61.0, True), (61.0, 62.0, False), (62.0, 63.0, True)]
    assert first.get_xlabel() == "driver.supply_voltage [V]"
    pictures = [x for part in step_margin_outcome(margin).parts for x in part.items]
    assert "step_margin" in [x.name for x in pictures if isinstance(x, Picture)]


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ("driver.voltage=60:80 V", "is not a number of the scenario"),
        ("driver.supply_voltage", "is no range; write KEY=LOW:HIGH with a unit"),
        ("driver.supply_voltage=80:60 V", "LOW must be below HIGH"),
        ("driver.supply_voltage=60:80 A", "write KEY=LOW:HIGH with a unit (V)"),
    ],
)
def test_a_range_that_is_none_is_told(over, words):
    with pytest.raises(OptionError, match="over") as caught:
        step_margin(scenario_of(HELD, 2), over)
    assert words in str(caught.value)


def test_a_drive_that_holds_its_currents_has_no_margin_against_lost_steps():
    with pytest.raises(MicrovibError, match="pulse is expected"):
        step_margin("state-1", "driver.supply_voltage=60:80 V")
