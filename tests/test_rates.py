"""Rate plans: lines over rate, where they meet modes, what a limit forbids; and the closed form of the linearised drive."""

import csv
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from support.scenarios import NO_FRICTION, baseline

import microvib as mv
from microvib.cli.main import main
from microvib.cli.rates import _counts
from microvib.errors import MicrovibError
from microvib.model.linear import linear_lines
from microvib.reports.outcome import terminal_text
from microvib.reports.rates import best_text, draw_campbell, rates_outcome, solution_counts_text
from microvib.studies.rates import (
    ABOVE_LIMIT,
    ABOVE_PASSBAND,
    BEYOND_LINEAR_MODEL,
    HIDDEN_LINE,
    RECORD_GAP,
    RateCase,
    RateLine,
    at_rate,
    full_case,
    linear_error,
    plan_rates,
    rate_grid,
)
from microvib.units import Si, band, quantity

DEG = math.pi / 180.0


@pytest.fixture(scope="module")
def plan(state_1):
    # about the rate at which the full-step line meets the array mode, 0.0208 deg/s
    return plan_rates(
        state_1,
        rate_grid("0.016 deg/s", "0.026 deg/s", 11),
        (8, 16),
        limit="30 mN*m",
        band="0.1:5 Hz",
    )


def test_a_line_peaks_where_it_meets_the_mode(plan, state_1):
    meeting = next(r for r in plan.resonances if r.mode == "array_mode_1" and r.microsteps == 16)
    assert meeting.line == "full_step_1"
    assert meeting.frequency == pytest.approx(1.1565, rel=0.03)
    assert meeting.frequency == pytest.approx(
        at_rate(state_1, meeting.rate, 16).driving_frequency / 16, rel=1e-9
    )
    others = [x.amplitude for c in plan.of(16) for x in c.lines if x.name == "full_step_1"]
    assert meeting.amplitude == max(others)
    assert meeting.amplitude > 5.0 * np.median(others)


def test_the_peak_is_that_of_the_run_in_time(plan, state_1):
    meeting = next(r for r in plan.resonances if r.mode == "array_mode_1" and r.microsteps == 16)
    # six time constants of the mode, which the line drives: the record then has it but for 0.3 %
    scenario = at_rate(state_1, meeting.rate, 16).with_si({"record.settle": 90.0})
    torque = mv.simulate(scenario, channels=("T_d",))["T_d"]
    t = np.arange(torque.size) / scenario.record.sample_rate
    basis = np.exp(-2j * np.pi * meeting.frequency * t) * np.hanning(t.size)
    amplitude = 2.0 * abs(np.sum(torque * basis)) / np.sum(np.hanning(t.size))
    assert amplitude == pytest.approx(meeting.amplitude, rel=0.01)


def test_forbidden_bands_end_where_the_largest_line_is_at_the_limit(plan, state_1):
    assert [b.microsteps for b in plan.forbidden] == [8, 16]
    for b in plan.forbidden:
        assert b.line == "full_step_1"
        assert b.low < 0.0208 * DEG < b.high
        for edge, inward in ((b.low, 1.0), (b.high, -1.0)):
            outside, inside = (
                full_case(state_1, Si(edge + side * 5e-6 * DEG), b.microsteps)
                .largest(plan.band)
                .amplitude
                for side in (-inward, inward)
            )
            assert outside < 0.03 < inside


def test_the_best_rate_is_outside_and_smallest(plan):
    case, top = plan.best()
    assert all(
        not b.low <= case.rate <= b.high for b in plan.forbidden if b.microsteps == case.microsteps
    )
    assert top == min(line.amplitude for c in plan.cases if (line := c.largest(plan.band)))
    assert plan.best(16)[1] >= top
    assert plan.worst(16) > 0.2


def limited(plan, **changes):
    return replace(plan, **changes)


def test_where_no_rate_meets_the_limit_there_is_no_best(plan):
    forbidden = limited(plan, limit=0.9 * plan.least()[1])
    assert forbidden.best() is None
    assert forbidden.least() == plan.least()
    said = best_text(forbidden)
    assert said.startswith("Best: none for a limit of")
    assert "The rate with the smallest maximum line:" in said


def test_the_best_rate_keeps_away_from_resonances_as_asked(plan):
    def away(best):
        return plan.nearest(best[0])[1]

    free = limited(plan, limit=None, keep_away=0.0).best()
    far = limited(plan, limit=None, keep_away=2.0 * away(free)).best()
    assert far is None or (away(far) >= 2.0 * away(free) and far[1] >= free[1])
    assert limited(plan, keep_away=0.99).best() is None


def test_a_best_rate_at_the_end_of_the_range_is_flagged(plan):
    first = plan.of(16)[0]
    assert plan.is_at_end(first)
    assert not plan.is_at_end(plan.of(16)[1])
    end = limited(plan, cases=(first, replace(plan.of(16)[1], lines=())), limit=None)
    assert "this is the end of the range" in best_text(end)


FULL_STEPS_ALONE = {
    "tracking.clock_ratio": 1.0,
    "driver.microsteps": 1,
    "reducer.stiffness": "5700 N*m/rad",
    "array.rigid_inertia": None,
    "array.modes": [
        {"frequency": "1.2 Hz", "damping": "1 percent", "effective_inertia": "7.9 kg*m^2"},
        {"frequency": "31 Hz", "damping": "0.03 percent", "effective_inertia": "0.004 kg*m^2"},
    ],
}
"""State 1 in full steps, with a second mode that the tenth driving line meets at 0.0562 deg/s."""


@pytest.fixture(scope="module")
def plan_of_full_steps(state_1):
    return plan_rates(
        state_1.with_(FULL_STEPS_ALONE),
        rate_grid("0.0535 deg/s", "0.05667 deg/s", 2),
        limit="120 mN*m",
        keep_away=0.02,
    )


def test_a_line_beyond_the_eighth_order_is_looked_at_where_it_meets_a_mode(plan_of_full_steps):
    """A best rate was 0.9 % away from a line five times the limit."""
    plan = plan_of_full_steps
    [met] = [x for x in plan.resonances if x.mode == "array_mode_2"]
    assert met.line == "drive_10"
    assert met.amplitude > 4.0 * 0.12
    assert met.frequency == pytest.approx(31.0, rel=3e-3)
    best, _ = plan.best()
    assert abs(best.rate / met.rate - 1.0) >= 0.02
    assert any(band.line == "drive_10" and band.why == ABOVE_LIMIT for band in plan.forbidden)


def test_lines_of_the_clock_are_called_by_their_orders(plan_of_full_steps):
    names = {line.name for case in plan_of_full_steps.cases for line in case.lines}
    assert {"drive_9", "drive_10", "drive_11"} <= names
    assert not any(name.startswith("other") for name in names)


def test_how_cases_were_found_is_counted(plan):
    some = [replace(case, reason="why") if k < 3 else case for k, case in enumerate(plan.cases)]
    some[3] = replace(some[3], lines=(), reason="lost")
    steady = sum(not case.reason for case in some)
    in_time = len(some) - steady - 1
    assert solution_counts_text(limited(plan, cases=tuple(some))) == (
        f"{steady} steady states of the full model, {in_time} time integrations, 1 failed"
    )


def test_results_do_not_depend_on_what_else_is_planned(plan, state_1):
    case = plan.of(8)[3]
    assert full_case(state_1, case.rate, 8) == case


def test_processes_solve_cases_as_threads_do(plan, state_1):
    rates = [case.rate for case in plan.of(16)[:3]]
    apart = plan_rates(state_1, [Si(rate) for rate in rates], (16,), band="0.1:5 Hz", workers=2)
    assert [case for case in apart.cases if case.rate in rates] == plan.of(16)[:3]


def test_cases_without_a_steady_state_and_failed_ones_are_marked(state_1):
    weak = state_1.with_si({"motor.current": 0.02, "record.settle": 1.0, "record.duration": 2.0})
    failed = full_case(weak, Si(0.3 * DEG), 16)
    assert failed.lines == ()
    assert "synchronism" in failed.reason
    uneven = state_1.with_si(
        {
            "friction.position": {"harmonics": [{"order": 1, "amplitude": 0.01}]},
            "record.settle": 1.0,
            "record.duration": 4.0,
        }
    )
    case = full_case(uneven, Si(0.06 * DEG), 16)
    assert "does not repeat with the command" in case.reason
    assert case.lines
    both = plan_rates(weak, rate_grid("0.29 deg/s", "0.3 deg/s", 2), (16,), limit="10 mN*m")
    assert both.best() is None
    assert math.isnan(both.worst(16))
    assert "synchronism" in both.forbidden[0].why


def test_a_rate_is_not_allowed_for_lines_that_are_hidden(plan, state_1):
    """Without a steady state a record tells the lines: what it does not resolve, or its floor hides, may be above the limit."""
    noise = {"density": "1e-5 N^2*m^2/Hz", "highest": "200 Hz"}
    noisy = state_1.with_(
        {"friction.torque_noise": noise, "record.settle": "16 s", "record.duration": "4 s"}
        | {"friction.breakaway": Si(state_1.friction.coulomb)}
    )
    slow = full_case(noisy, Si(0.0025 * DEG), 16)
    lines = {x.name: x.amplitude for x in slow.hidden}
    assert "full_step_1" in lines
    assert not set(lines) & {x.name for x in slow.lines}
    assert slow.verdict((0.0, math.inf), 2.0 * max(lines.values())) == ""
    assert (
        slow.verdict((0.0, math.inf), 1.01 * slow.largest((0.0, math.inf)).amplitude) == HIDDEN_LINE
    )
    best, top = limited(plan).best()
    hidden = (replace(best.lines[0], name="full_step_3", frequency=1.0, amplitude=1.0),)
    cases = tuple(replace(case, hidden=hidden) if case is best else case for case in plan.cases)
    assert limited(plan, cases=cases).best()[1] >= top
    assert limited(plan, cases=cases).best(best.microsteps)[0].rate != best.rate


def test_a_plan_records_full_steps_where_there_is_no_steady_state(state_1):
    """Between two slips of a slow drive a record of 4 s passed a limit of a fiftieth of a line."""
    noise = {"density": "1e-9 N^2*m^2/Hz", "highest": "200 Hz"}
    noisy = state_1.with_(
        {
            "friction.torque_noise": noise,
            "record.settle": "200 s",
            "record.duration": "4 s",
        }
    )
    slow = full_case(noisy, Si(0.001 * DEG), 16)
    assert slow.gap is None
    assert slow.largest((0.05, 0.06)) is not None  # its first full-step line
    too_slow = full_case(noisy, Si(0.0001 * DEG), 16)
    top = too_slow.largest((0.0, math.inf)).amplitude
    assert too_slow.verdict((0.0, math.inf), 5.0 * top) == RECORD_GAP
    assert too_slow.verdict((0.0, math.inf), 0.5 * top) == ABOVE_LIMIT
    rates = [Si(0.0001 * DEG), Si(0.00011 * DEG)]
    planned = plan_rates(noisy, rates, (16,), limit=Si(5.0 * top))
    assert planned.best() is None
    assert [x.why for x in planned.forbidden] == [
        "not judged: lines of a motion that slips once in a full step, of which the record holds"
        " fewer than two (record.duration >= 360 s)"
    ]


def test_a_steady_state_beside_rates_at_which_the_drive_excites_itself_is_confirmed(
    state_1, monkeypatch
):
    """The middle of three rates has neighbours whose largest line is of no clock: its run from rest is waited for."""
    rates = [0.05 * DEG, 0.06 * DEG, 0.07 * DEG]
    asked = []

    def solved(scenario, rate, microsteps, confirmed=False):
        asked.append((rate, confirmed))
        lines = (
            RateLine("drive_1", "drive", 1.0, 50.0, 0.01),
            RateLine("other_1", "other", 0.06, 2.9, 0.4),
        )
        if rate == rates[1] and not confirmed:
            return RateCase(rate, microsteps, lines[:1])
        return RateCase(rate, microsteps, lines, "a run from rest does not settle")

    monkeypatch.setattr("microvib.studies.rates.full_case", solved)
    monkeypatch.setattr("microvib.studies.rates._resonance_crossings", lambda *given: [])
    plan = plan_rates(state_1, [Si(rate) for rate in rates], (16,), limit="100 mN*m")
    assert (rates[1], True) in asked
    assert plan.best() is None
    assert [(b.low, b.high, b.line) for b in plan.forbidden] == [(rates[0], rates[2], "other_1")]


def test_a_confirmed_steady_state_is_the_one_that_was_found(state_1):
    found, confirmed = (full_case(state_1, Si(0.06 * DEG), 16, given) for given in (False, True))
    assert confirmed.confirmed
    assert not found.confirmed
    assert confirmed.lines == found.lines


def test_a_rate_at_which_the_array_does_not_turn_yet_is_not_the_best(state_1, monkeypatch):
    """Where there is no steady state, and the record is over before the drive is wound up, lines are those of an array that stands.

    Of two rates alone: those at which lines meet modes would be forty more, and where the band ends does not matter.
    """
    for crossings in ("_resonance_crossings", "_modes_to_solve"):
        monkeypatch.setattr(f"microvib.studies.rates.{crossings}", lambda *given: [])
    monkeypatch.setattr("microvib.studies.rates.BISECTIONS", 1)
    error = [{"order": 7, "amplitude": "1 arcsec"}]
    held = state_1.with_(
        {"reducer.transmission_error": error, "record.settle": "1 s", "record.duration": "4 s"}
    )
    plan = plan_rates(
        held, rate_grid("0.0005 deg/s", "0.03 deg/s", 2), limit="100 mN*m", band="0.1:50 Hz"
    )
    slow, fast = plan.cases[0], plan.cases[-1]
    assert slow.lines == ()
    assert slow.reason.startswith("the array does not turn yet")
    assert fast.lines
    assert plan.best()[0] is not slow
    assert plan.forbidden[0].why == slow.reason


def test_a_line_at_the_end_of_the_band_is_in_it(plan):
    case = plan.of(16)[0]
    line = next(x for x in case.lines if x.name == "drive_1")
    alone, end = replace(case, lines=(line,)), round(line.frequency, 9)
    assert end != line.frequency
    assert alone.largest((0.0, end)) == line
    assert alone.largest((end, 2.0 * end)) == line
    assert alone.largest((0.0, 0.99 * end)) is None


@pytest.mark.parametrize("stiffness", ["8400 N*m/rad", "rigid"])
def test_the_linear_lines_are_those_of_a_drive_without_stick_and_detent(state_1, stiffness):
    smooth = {
        "reducer.stiffness": stiffness,
        "motor.detent_torque": 0.0,
        **NO_FRICTION,
    }
    scenario = state_1.with_si(smooth)
    table = mv.find_lines(scenario, start="steady")
    for line in linear_lines(scenario):
        # currents do not follow quite at once: back-EMF damps by 2 %
        assert abs(line.amplitude) == pytest.approx(
            table[f"drive_{line.order}"].amplitude, rel=0.03
        )
        assert line.frequency == pytest.approx(table[f"drive_{line.order}"].frequency)
    assert linear_lines(scenario.with_si({"tracking.rate": 0.0})) == ()


def test_a_linear_plan_states_its_error(state_1):
    plan = plan_rates(state_1, rate_grid("0.1 deg/s", "0.3 deg/s", 40), (16,), linear=True)
    assert {line.kind for case in plan.cases for line in case.lines} == {"drive"}
    median, largest, count = linear_error(plan, 3)[16]
    assert count >= 6
    assert 0.001 < median <= largest < 2.0


def test_the_command_writes_tables_and_pictures(tmp_path):
    out = tmp_path / "plan"
    (tmp_path / "drive.yaml").write_text(mv.dump_scenario(baseline()))
    arguments = [
        "rates",
        str(tmp_path / "drive.yaml"),
        "--from",
        "0.1 deg/s",
        "--to",
        "12 arcmin/s",
        "--count",
        "4",
        "--microsteps",
        "16,32",
    ]
    done = CliRunner().invoke(main, [*arguments, "--limit", "30 mN*m", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "Best: 0.2 deg/s with 32 microsteps" in done.output
    assert {p.name for p in out.glob("[!.]*")} == {
        "best.csv", "rates.csv", "resonances.csv", "forbidden.csv", "stepping_modes.csv", "not_seen.csv", "campbell.png", "largest.png", "report.html",
    }  # fmt: skip
    with (out / "rates.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["microsteps"] for row in rows} == {"16", "32"}
    assert all(
        row["status"] == "steady" or row["status"].startswith("in time: a run from rest")
        for row in rows
    )
    assert sum(row["status"] == "steady" for row in rows) > 0.8 * len(rows)
    drive = next(row for row in rows if row["line"] == "drive_2")
    assert float(drive["order"]) == pytest.approx(2.0)
    again = CliRunner().invoke(main, [*arguments, "--linear", "--out", str(out)])
    assert again.exit_code == 1  # never over what is there
    linear = CliRunner().invoke(main, [*arguments, "--linear"])
    assert "Linear against full model" in linear.output


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ["--from", "0.3 deg/s", "--to", "0.1 deg/s"],
            "--from 0.3 deg/s: is not allowed; it must be above 0 and below 0.1 deg/s",
        ),
        (["--from", "0 deg/s", "--to", "0.1 deg/s"], "must be above 0"),
        (["--from", "0.1", "--to", "0.1 deg/s"], "--from: '0.1' needs a unit"),
        (["--from", "0.1 Hz", "--to", "1 deg/s"], "mixes cycles and angles"),
        (
            ["--from", "0.1 deg/s", "--to", "1 deg/s", "--microsteps", "8,many"],
            "whole numbers from 1 to 65536",
        ),
        (
            ["--from", "0.1 deg/s", "--to", "1 deg/s", "--limit", "10 mN"],
            "--limit: '10 mN' has the wrong dimension",
        ),
        (["--from", "0.1 deg/s", "--to", "1 deg/s", "--limit", "0 N*m"], "must be greater than 0"),
        (
            ["--from", "0.1 deg/s", "--to", "1 deg/s", "--keep-away", "5 Hz"],
            "--keep-away: '5 Hz' has the wrong dimension",
        ),
        (
            ["--from", "0.1 deg/s", "--to", "1 deg/s", "--keep-away", "120 percent"],
            "below 100 percent",
        ),
        (["--from", "0.1 deg/s", "--to", "1 deg/s", "--band", "5 Hz"], "write LOW:HIGH"),
        (["--from", "0.1 deg/s", "--to", "1 deg/s", "--band", "5:0.5 Hz"], "below the second"),
    ],
)
def test_bad_input_is_one_sentence(arguments, complaint):
    done = CliRunner().invoke(main, ["rates", "state-1", *arguments])
    assert done.exit_code == 1
    assert complaint in done.output
    assert done.output.startswith("Error: ")
    assert "Traceback" not in done.output


def test_options_are_quantities():
    assert band("0.5:5 Hz") == (0.5, 5.0)
    assert band("500 mHz:0.1 kHz") == (0.5, 100.0)
    assert _counts("8, 16,8") == (8, 16)
    assert quantity("limit", "10 mN*m", "N*m") == pytest.approx(0.01)
    with pytest.raises(MicrovibError, match="band: "):
        band("1:2 s")


@pytest.mark.release
def test_a_script_without_a_guard_is_told_so_and_one_worker_needs_none(tmp_path):
    script = tmp_path / "plan.py"
    script.write_text(
        "import sys, microvib as mv\n"
        "try:\n"
        "    print(len(mv.plan_rates(mv.load_scenario('state-1'), ['0.06 deg/s'], workers=int(sys.argv[1])).cases))\n"
        "except mv.MicrovibError:\n"
        "    sys.exit(3)\n"
    )
    runs = [
        subprocess.run(
            [sys.executable, script, workers], capture_output=True, text=True, timeout=300
        )
        for workers in ("1", "2")
    ]
    assert [run.returncode for run in runs] == [0, 3]
    assert runs[0].stdout == "1\n"
    assert "if __name__ == '__main__':" in runs[1].stderr
    assert "Traceback" not in runs[1].stderr


def test_a_rate_is_not_allowed_for_lines_above_the_passband(state_1):
    """Where a slow record shows no line above its passband, one that a fast record shows there forbids the rate, or is not known."""
    rates, of_band = rate_grid("0.2 deg/s", "0.4 deg/s", 6), (5.0, 100.0)
    limits = 0.003, 0.015, 0.06
    whole = plan_rates(state_1, rates, limit="15 mN*m", band="5:100 Hz")
    for sample_rate in ("40 Hz", "150 Hz"):
        plan = plan_rates(
            state_1.with_({"record.sample_rate": sample_rate}),
            rates,
            limit="15 mN*m",
            band="5:100 Hz",
        )
        known = {case.rate: case for case in whole.cases}  # either plan may add rates of its own
        both = [(case, known[case.rate]) for case in plan.cases if case.rate in known]
        assert len(both) >= len(rates)
        for case, truth in both:
            for limit in limits:
                assert case.verdict(of_band, limit) or not truth.verdict(of_band, limit)
        if sample_rate == "40 Hz":
            assert plan.best() is None
            said = " ".join(terminal_text(rates_outcome(plan)).split())
            assert "0 failed" not in said
            assert "failed" not in said
            assert (
                "not judged: lines above the passband may exceed the limit (record.sample_rate >= "
                in said
            )
            assert "such as a line of the output's friction at" in said
            assert plan.forbidden[0].why.startswith(ABOVE_PASSBAND)
    assert whole.best() is not None


def test_a_linear_plan_allows_no_rate_for_what_it_does_not_have(state_1):
    rates = rate_grid("0.2 deg/s", "0.4 deg/s", 4)
    plan = plan_rates(state_1, rates, limit="15 mN*m", band="5:100 Hz", linear=True)
    assert plan.best() is None
    assert BEYOND_LINEAR_MODEL in " ".join(terminal_text(rates_outcome(plan)).split())
    assert plan_rates(state_1, rates, linear=True).best() is not None


@pytest.mark.parametrize(
    ("microsteps", "why"),
    [(1, "the drive is not linear"), (8, "what the linearised drive leaves out")],
)
def test_a_linear_plan_allows_no_rate_within_the_error_of_its_lines(state_1, microsteps, why):
    """Without friction and detent torque; ramps make the field's strength ripple with the microsteps."""
    drive = state_1.with_(
        {
            "motor.detent_torque": "0 N*m",
            "motor.friction.coulomb": "0 N*m",
            "motor.friction.breakaway": "0 N*m",
            "friction.coulomb": "0 N*m",
            "friction.breakaway": "0 N*m",
            "driver.microstep_ramp": 1.0,
            "driver.microsteps": microsteps,
        }
    )
    rates = rate_grid("0.35 deg/s", "0.3501 deg/s", 2)
    alone, _ = plan_rates(drive, rates, linear=True).cases
    largest = max(line.amplitude for line in alone.lines)
    plan = plan_rates(drive, rates, limit=Si(1.05 * largest), linear=True)
    assert plan.best() is None
    assert why in plan.forbidden[0].why
    full = full_case(drive, Si(alone.rate), microsteps)
    assert abs(max(line.amplitude for line in full.lines) / largest - 1.0) > 0.015


def test_a_small_line_in_the_band_is_not_dropped_for_a_large_one_outside(state_1):
    case = full_case(state_1, Si(0.09 * DEG), 16)
    top = max(x.amplitude for x in case.lines)
    small = max((x for x in case.lines if x.amplitude < 1e-3 * top), key=lambda x: x.amplitude)
    assert small.amplitude > 1e-5 * top
    assert (
        case.verdict((0.999 * small.frequency, 1.001 * small.frequency), 0.5 * small.amplitude)
        == ABOVE_LIMIT
    )


def test_a_band_without_a_listed_line_is_judged_by_what_no_line_accounts_for():
    """full_step_13, which is no row of a case's table, has 0.425 mN m in this band."""
    rates = mv.rate_grid("0.0597 deg/s", "0.0603 deg/s", 2)
    plan = mv.plan_rates(
        mv.load_scenario("state-1"), rates, limit="0.3 mN*m", band=("28 Hz", "45 Hz")
    )
    assert plan.best() is None
    assert plan.least()[1] > 4e-4


def test_a_mode_is_named_where_its_name_covers_the_fewest_points():
    """At 16 microsteps drive_1 comes down on the resonance from the left below: the name stands at the right, or above."""
    plan = plan_rates(
        mv.load_scenario("state-1"),
        rate_grid("0.03 deg/s", "0.06 deg/s", 24),
        (16, 64),
        linear=True,
    )
    drawing = draw_campbell(plan)
    drawing.canvas.draw()
    for ax in drawing.axes[:2]:
        points = ax.transData.transform(ax.collections[0].get_offsets())
        for name in ax.texts:
            box = name.get_window_extent()
            covered = [box.contains(*point) for point in points]
            assert sum(covered) <= 0.02 * len(points), name.get_text()
