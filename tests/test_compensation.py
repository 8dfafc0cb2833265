"""Microsteps that come earlier or later against the gear's error: what that cancels and what it spreads."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import j0
from support.derivatives_by_solving import relative_derivatives
from support.scenarios import NO_FRICTION, baseline, limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.start import record_gap
from microvib.errors import OptionError, ScenarioError
from microvib.io.scenario_file import dump_part
from microvib.model.expected import distance_to_clock_line, expected_lines
from microvib.model.orders import drive_orders
from microvib.model.slow_variations import slow_variations
from microvib.reports.parameters import derived_values
from microvib.solve.command import Command
from microvib.solve.steady.period import common_period
from microvib.solve.steady.state import steady_state
from microvib.units import Si

FREE = {"sources": {}, **NO_FRICTION, "motor.detent_torque": 0.0}
RIGID_LOAD = {"array.modes": [], "array.rigid_inertia": None, "array.inertia": 0.2}
HARMONIC = {"order": 2, "amplitude": 1.5e-4, "phase": 0.7}
ERROR = {"reducer.transmission_error": [HARMONIC]}
COMPENSATION = {"driver.compensation": [HARMONIC]}


def smooth(**changes: object) -> mv.Scenario:
    return baseline().with_si(FREE | RIGID_LOAD | {"record.settle": 10.0} | changes)


def at_order(scenario: mv.Scenario, order: int) -> float:
    """Amplitude [N m] of the torque at ``order`` per turn of the rotor, in the steady state."""
    state = steady_state(scenario)
    assert not state.invariants.broken
    turns = state.microsteps / (64 * 50)
    assert order * turns == pytest.approx(round(order * turns))
    return float(abs(state.harmonics("T_d")[round(order * turns)]))


@pytest.mark.parametrize(
    "changes", [{}, {"reducer.stiffness": "rigid"}], ids=["compliant", "rigid"]
)
@pytest.mark.parametrize("rate", [0.06, -0.03])
def test_compensation_cancels_the_error_and_a_wrong_phase_leaves_its_chord(changes, rate):
    s = smooth(**changes, **{"tracking.rate": math.radians(rate)})
    error = at_order(s.with_si(ERROR), 2)
    # the error turns array and hub, the rotor going on evenly: T = J omega^2 a, far below resonances
    omega = 2 * math.pi * s.driving_frequency / 1600
    assert error == pytest.approx(0.2 * omega**2 * 1.5e-4, rel=0.05)
    assert at_order(s.with_si(ERROR | COMPENSATION), 2) < 0.1 * error
    for off in (0.2, -0.5, math.pi):
        wrong = {"driver.compensation": [HARMONIC | {"phase": 0.7 + off}]}
        left = at_order(s.with_si(ERROR | wrong), 2) / error
        assert left == pytest.approx(abs(2 * math.sin(0.5 * off)), rel=0.03, abs=0.01)


def test_a_microstep_comes_when_the_output_shall_be_there():
    """-theta/h + epsilon(theta) is then what is commanded, from where the drive begins."""
    harmonics = [HARMONIC, {"order": 7, "amplitude": 2e-5, "phase": -2.0}]
    profile = {
        "profile": [
            {"rate": 0.001, "ramp": 0.5, "hold": 1.0},
            {"rate": -0.0012, "ramp": 0.7, "hold": 1.0},
            {"rate": 4e-4, "ramp": 0.5},
        ]
    }
    s = baseline().with_si({"driver.compensation": harmonics, "tracking": profile})
    t, rows = Command(s).microsteps(0.0, 6.0)
    rotor = np.concatenate([[0.0], rows[:, 2] / 50])
    middle = 0.5 * (rotor[1:] + rotor[:-1])
    times, rates = s.tracking.breakpoints()
    fine = np.linspace(0.0, 6.0, 600_001)
    rate = np.interp(fine, times, rates)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * 1e-5)])

    def error(theta):
        return sum(x["amplitude"] * np.sin(x["order"] * theta + x["phase"]) for x in harmonics)

    output = -middle / 100 + error(middle) - error(0.0)
    assert t.size > 150
    assert np.all(np.abs(np.diff(rotor)) == pytest.approx(2 * math.pi / 3200))
    assert np.interp(t, fine, angle) == pytest.approx(output, abs=1e-9)


def test_driving_lines_are_spread_by_a_bessel_function():
    """Microsteps that come earlier and later by B of their periods modulate the phase of driving line k by
    2 pi k B: J_0 of that is left of it, and the RMS of the torque stays."""
    for amplitude in (1e-5, 3e-5, 1.5e-4):
        s = smooth(**{"driver.compensation": [HARMONIC | {"amplitude": amplitude}]})
        state, plain = steady_state(s), steady_state(smooth())
        moved = 100 * amplitude / (2 * math.pi / 3200)
        for k in (1, 2):
            left = abs(
                state.harmonics("T_d")[k * state.microsteps]
                / plain.harmonics("T_d")[k * plain.microsteps]
            )
            assert left == pytest.approx(abs(j0(2 * math.pi * k * moved)), abs=0.01)
        assert np.std(state.T_d) == pytest.approx(np.std(plain.T_d), rel=0.02)


@pytest.mark.parametrize(
    "changes",
    [
        {"driver.microstep_ramp": 0.7},
        {"driver.microstep_shape": [{}, {"fraction": 0.7, "after": 0.0178}], **ERROR},
        {"driver.compensation": [{"order": 50, "amplitude": 1e-5, "phase": 0.2}]},
        {"tracking.rate": -math.radians(0.06), "driver.microstep_ramp": 1.0},
    ],
    ids=["ramps", "late parts, gear", "electrical order", "turning back, ramps"],
)
def test_the_steady_state_is_that_of_a_run(changes):
    """With friction and detent torque; all lines up to 400 Hz, with their phases."""
    s = baseline().with_si(
        RIGID_LOAD | COMPENSATION | {"record.settle": 20.0, "record.duration": 60.0} | changes
    )
    state, T_d = steady_state(s), mv.simulate(s, channels=("T_d",))["T_d"]
    series, count = np.fft.rfft(T_d) * (2.0 / T_d.size), round(400 / state.frequency)
    each = round(60 * state.frequency)
    assert 60 * state.frequency == pytest.approx(each)  # whole periods
    found, run = state.harmonics("T_d")[1:count], series[each : each * count : each]
    assert np.linalg.norm(run - found) < 1e-3 * np.linalg.norm(found)


def test_derivatives_by_compensation_are_those_of_solving_again():
    s = smooth(**ERROR, **COMPENSATION, **{"solver.refinement": 4})
    keys, orders = (
        ["driver.compensation.0.amplitude", "driver.compensation.0.phase"],
        [1, 1557, 1600],
    )
    found = steady_state(s).derivatives(keys, orders).relative
    for row, key in zip(found, keys, strict=True):
        solved = relative_derivatives(s, key, orders)
        assert row == pytest.approx(solved, rel=2e-3, abs=5e-3), key


def test_what_repeats_with_compensation_is_known_everywhere():
    s = smooth(**COMPENSATION)
    gear = smooth(**ERROR)
    assert common_period(s) == common_period(gear) == (1600, 16)
    by = {x.name: x for x in expected_lines(s, Si(100.0))}
    assert by["wave_generator_2"].frequency == pytest.approx(s.driving_frequency / 1600)
    assert by["wave_generator_2"].origin == "compensation, order 2"
    assert by["drive_1"].origin == "microstep, order 1: spread by compensation"
    both = {x.name: x for x in expected_lines(smooth(**ERROR, **COMPENSATION), Si(100.0))}
    assert both["wave_generator_2"].origin == "transmission error, order 2"
    f = s.driving_frequency / 1600
    assert distance_to_clock_line(s, 1.1 * f) == pytest.approx(0.1 * f)
    assert "wave_generator_2" in {x.name for x in drive_orders(s)}
    assert [x.what for x in slow_variations(s)] == ["driver.compensation (order 2)"]
    assert mv.find_lines(s, start="steady")["wave_generator_2"].amplitude > 1e-7
    said = {name: (value, by) for name, value, by in derived_values(s)}
    assert said["drive_1 is spread by"] == (
        "1.6 Hz to both sides",
        "driver.compensation, by which microsteps come up to 7.64 of their periods early or late",
    )


def test_a_record_of_a_part_of_the_cycle_judges_no_line():
    """Its driving line is there, and over whole cycles only a tenth of it is left: neither is told."""
    s = baseline().with_si(COMPENSATION | {"record.settle": 90.0, "record.duration": 6.0})
    short = mv.find_lines(mv.simulate(s, channels=("T_d",)))
    whole = mv.find_lines(s, start="steady")
    largest = max(x.amplitude for x in short if abs(x.place - s.driving_frequency) < 3.0)
    limit = limit_of(2.0 * whole["drive_1"].amplitude, 40.0, 60.0)
    assert largest > 2.0 * whole["drive_1"].amplitude
    gap = record_gap(s, 6.0)
    assert "driver.compensation (order 2) repeats after 30 s" in gap.why
    assert gap.overstated == math.inf
    assert judge(short, limit, s).verdict == "not judged"


def weak_compensation(amplitude: float, **record: float) -> mv.Scenario:
    """Compensation of the first order that changes the rate by 4.85e-4 for each arcsecond of its
    amplitude [arcsec].
    """
    changes = {
        "driver.compensation": [{"order": 1, "amplitude": math.radians(amplitude / 3600.0)}],
        "driver.microsteps": 64,
        "record.settle": 60.0,
        "record.duration": 8.0,
    }
    return baseline().with_si(changes | {f"record.{key}": value for key, value in record.items()})


def test_compensation_counts_by_how_far_it_shifts_the_highest_line_of_a_record():
    shifted = weak_compensation(1.9)
    assert "driver.compensation (order 1)" in record_gap(shifted, 8.0).why
    assert record_gap(weak_compensation(0.12), 8.0) is not None  # by 0.67 bins
    assert record_gap(weak_compensation(0.12), 4.0) is None
    assert record_gap(weak_compensation(1.9, sample_rate=64.0, duration=4.0), 4.0) is None
    assert record_gap(shifted, 130.0) is None


def test_a_line_that_compensation_moves_into_a_narrow_band_is_not_passed_before():
    """Its rate changes by less than a thousandth, and a high line by many bins."""
    s = weak_compensation(1.9)
    table = mv.find_lines(mv.simulate(s, channels=("T_d",)))
    line = max((x for x in table if x.seen and 630.0 < x.place < 650.0), key=lambda x: x.amplitude)
    for low, high in ((line.place - 0.6, line.place - 0.3), (line.place + 0.3, line.place + 0.6)):
        judged = judge(table, limit_of(0.5 * line.amplitude, low, high), s)
        assert judged.verdict == "not judged"
        assert "driver.compensation (order 1) repeats after 60 s" in str(judged)


def test_a_scenario_with_compensation_is_written_read_and_changed(tmp_path):
    s = smooth(**COMPENSATION)
    (tmp_path / "drive.yaml").write_text(dump_part(s))
    again = mv.load_scenario(tmp_path / "drive.yaml")
    assert again.driver == s.driver
    moved = again.with_({"driver.compensation.0.amplitude": "20 arcsec"})
    assert moved["driver.compensation.0.amplitude"] == pytest.approx(math.radians(20 / 3600))
    none = again.with_si({"driver.compensation.0.amplitude": 0.0})
    plain = smooth()
    t, rows = Command(none).microsteps(0.0, 3.0)
    assert np.array_equal(t, Command(plain).microsteps(0.0, 3.0)[0])
    assert steady_state(none).T_d == pytest.approx(steady_state(plain).T_d, abs=0.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"driver.compensation": [{"order": 2, "amplitude": "1 deg"}]},
            "driver.compensation: the sum of order x amplitude is 0.0349066 rad; it must be below 1/ratio,"
            " 0.01 rad",
        ),
        (
            {"driver.compensation": [{"order": 2.5, "amplitude": "1 arcsec"}]},
            "driver.compensation.0.order: 2.5 is not allowed; a whole number from 1 to 1000",
        ),
        (
            {
                "driver.compensation": [{"order": 2, "amplitude": "100 arcsec"}],
                "driver.microstep_shape": [{}, {"fraction": 0.5, "after": "18 ms"}],
            },
            "microstep_shape.1.after: 18 ms is not before the next microstep, which comes after 16.9319 ms at"
            " the fastest rate of the command and the steepest driver.compensation",
        ),
    ],
)
def test_what_no_compensation_can_be_is_told_in_one_sentence(changes, words):
    with pytest.raises(ScenarioError) as caught:
        baseline().with_(changes)
    assert words in str(caught.value)


def test_the_linearised_rate_plan_does_not_take_compensation():
    with pytest.raises(OptionError, match=r"driver\.compensation spreads the driving lines"):
        mv.plan_rates(smooth(**COMPENSATION), ["0.06 deg/s"], linear=True)
