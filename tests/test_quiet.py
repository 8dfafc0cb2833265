"""A quieter drive: levers, objectives, starts, search, and what is handed over."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import microvib as mv
from microvib.io.current_table import read_current_table
from microvib.model.expected import is_made
from microvib.model.torque_margin import MotorisationFactors, lag_of_array, torque_margin
from microvib.reports.outcome import study_contents, terminal_text
from microvib.reports.quiet import draw_lines, quiet_outcome
from microvib.studies.budget.files import Requirements
from microvib.studies.quiet.cases import draw_cases
from microvib.studies.quiet.evaluate import Case, evaluations, figure_of
from microvib.studies.quiet.lever_options import parse_levers
from microvib.studies.quiet.levers import (
    Setting,
    TableLimits,
    levels_of,
    table_rows,
    with_levers,
)
from microvib.studies.quiet.measure import UntoldLine, measure_lines
from microvib.studies.quiet.objective import parse_objective
from microvib.studies.quiet.starts import STARTS
from microvib.studies.quiet.study import P95, Constraints, QuietDrive, quiet, upper_quantile

SHORT = {"record.settle": "10 s", "record.duration": "4 s"}


@pytest.fixture(scope="module")
def drive() -> mv.Scenario:
    return mv.load_scenario("state-1").with_(SHORT)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("quiet") / "figures.jsonl"


@pytest.fixture(scope="module")
def told() -> list[tuple[float, float]]:
    """What the search of ``found`` tells of how far it is."""
    return []


@pytest.fixture(scope="module")
def found(drive: mv.Scenario, kept: Path, told: list[tuple[float, float]]) -> QuietDrive:
    def progress(done: float, total: float) -> None:
        told.append((done, total))

    return quiet(drive, "rms", ["ramp"], cases=8, effort=4, keep=kept, progress=progress)


# ---- Lines of a settled drive ----


def test_the_rms_of_a_run_is_that_of_the_steady_state(drive: mv.Scenario) -> None:
    for changes in ({}, {"driver.microstep_ramp": 1.0}):
        scenario = drive.with_(changes)
        series = np.abs(mv.steady_state(scenario).harmonics()[1:])
        steady = math.sqrt(0.5 * float(np.sum(series**2)))
        assert measure_lines(scenario).rms == pytest.approx(steady, rel=5e-3)


def test_what_rings_from_the_start_does_not_count(drive: mv.Scenario) -> None:
    ramp = drive.with_({"driver.microstep_ramp": 1.0})
    from_rest, from_above = (measure_lines(start.begun(ramp)) for start in STARTS[:2])
    assert "array_mode_1" not in from_above.names
    assert from_above.rms == pytest.approx(from_rest.rms, rel=0.02)


def test_starts_find_motions_that_coexist(drive: mv.Scenario) -> None:
    """Ramp and detent table together: a start from rest slips and sticks at 30 Hz, one from above
    does not."""
    levers = parse_levers(["ramp", "table"], drive)
    both = with_levers(drive, levers, Setting(tuple(lever.guess for lever in levers)))
    from_rest, from_above = (measure_lines(start.begun(both)) for start in STARTS[:2])
    assert from_rest.rms > 15e-3
    assert from_above.rms < 1.5e-3
    assert not from_rest.problem


def test_a_drive_that_loses_its_steps_has_no_figure(drive: mv.Scenario) -> None:
    weak = measure_lines(drive.with_({"motor.current": "1 mA"}))
    assert weak.problem
    assert parse_objective("rms", drive).of(weak) == math.inf


# ---- Levers ----


def test_a_table_cancels_the_detent_torque_at_standstill(drive: mv.Scenario) -> None:
    """Torque K_m I sin(angle of the table - theta_e) - T sin 4 theta_e is zero at the command."""
    motor, driver = drive.motor, drive.driver
    full = motor.torque_constant * motor.current
    amplitude = math.asin(motor.detent_torque / full)
    rows = table_rows(driver, [(4, complex(amplitude))])
    theta_e = driver.electrical_angle(np.arange(len(rows)))
    torque = full * (rows[:, 1] * np.cos(theta_e) - rows[:, 0] * np.sin(theta_e))
    wanted = motor.detent_torque * np.sin(4 * theta_e)
    assert np.max(np.abs(torque - wanted)) < 2e-3 * motor.detent_torque
    (table,) = parse_levers(["table"], drive)
    guessed = with_levers(drive, [table], Setting((table.guess,)))
    assert guessed.driver.table is not None
    assert np.allclose(guessed.driver.table.currents, rows, atol=1e-12)


def test_bits_make_whole_numbers(drive: mv.Scenario) -> None:
    (table,) = parse_levers(["table"], drive, TableLimits(bits=8))
    made = with_levers(drive, [table], Setting((table.guess,)))
    assert made.driver.table is not None
    rows = np.array(made.driver.table.currents) * levels_of(8)
    assert np.allclose(rows, np.rint(rows), atol=1e-9)


def test_levers_act_on_their_keys(drive: mv.Scenario) -> None:
    levers = parse_levers(["current=0.3:0.6 A", "gains", "microsteps=16,32", "damping"], drive)
    made = with_levers(drive, levers, Setting(((0.0,), (1.0,), (32.0,), (1.0,))))
    assert made["motor.current"] == pytest.approx(0.3)
    assert made["driver.proportional_gain"] == pytest.approx(1000.0)
    assert made["driver.integral_gain"] == pytest.approx(12000.0)
    assert made["driver.microsteps"] == 32
    assert made["reducer.damping"] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("lever", "sentence"),
    [
        ("spring", "lever spring: is none"),
        ("reducer.stiffness", "wants a range"),
        ("current=0.6:0.3 A", "LOW must be below HIGH"),
        ("current=0.3:0.6 V", "lever current=0.3:0.6 V"),
        ("microsteps=0", "whole numbers from 1 on"),
        ("wings", "needs spacecraft.second_wing.stagger"),
    ],
)
def test_a_wrong_lever_is_one_sentence(drive: mv.Scenario, lever: str, sentence: str) -> None:
    with pytest.raises(mv.OptionError, match=sentence) as caught:
        parse_levers([lever], drive)
    assert "\n" not in str(caught.value)


def test_two_levers_over_one_key_are_refused(drive: mv.Scenario) -> None:
    with pytest.raises(mv.OptionError, match=r"motor\.current is set by two levers"):
        parse_levers(["current", "motor.current=0.1:0.2 A"], drive)


def test_a_lever_that_the_cases_vary_is_refused(drive: mv.Scenario) -> None:
    levers = parse_levers(["reducer.stiffness=4000:6000 N*m/rad"], drive)
    with pytest.raises(mv.OptionError, match=r"sets reducer\.stiffness, which the cases vary"):
        draw_cases(drive, levers)


# ---- Objectives ----


def test_objectives_see_what_they_name(drive: mv.Scenario, tmp_path: Path) -> None:
    lines = measure_lines(drive)
    drive_1 = parse_objective("drive_1", drive).of(lines)
    assert drive_1 == pytest.approx(47.8e-3, rel=0.01)
    assert parse_objective("40:60 Hz", drive).of(lines) == drive_1
    assert parse_objective("60:120 Hz", drive).of(lines) == pytest.approx(13.7e-3, rel=0.01)
    limit = tmp_path / "limit.csv"
    limit.write_text("frequency_hz,amplitude_n_m\n10,0.01\n200,0.01\n")
    assert parse_objective(str(limit), drive).of(lines) == pytest.approx(drive_1 / 0.01)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("drive_one", "is not a line of this drive"),
        ("5:1 Hz", "band"),
        ("missing.csv", "missing.csv"),
    ],
)
def test_a_wrong_objective_is_one_sentence(drive: mv.Scenario, text: str, sentence: str) -> None:
    with pytest.raises(mv.MicrovibError, match=sentence):
        parse_objective(text, drive)


def test_a_requirement_wants_a_line_of_sight(drive: mv.Scenario) -> None:
    with pytest.raises(mv.OptionError, match="line of sight"):
        parse_objective("rms", drive, "examples/requirement.yaml")


# ---- Margins ----


def test_the_torque_margin_is_that_of_the_sum(drive: mv.Scenario) -> None:
    found = torque_margin(drive)
    on_output = drive.friction.breakaway_torque / 100.0
    on_rotor = drive.motor.friction.viscous * abs(drive.rate or 0.0) * 100.0
    required = 2.0 * (3.0 * (on_output + on_rotor) + 1.5 * drive.motor.detent_torque)
    assert found.required == pytest.approx(required, rel=1e-9)
    assert found.margin == pytest.approx(0.3 * 0.6 / required - 1.0)
    relaxed = torque_margin(drive, MotorisationFactors(friction=1.5))
    assert relaxed.margin > found.margin


def test_a_driver_with_errors_has_the_torque_of_its_least_currents(drive: mv.Scenario) -> None:
    ideal, weak = (
        torque_margin(drive.with_({"driver.imperfections.gain_b": x})) for x in (0.0, -0.2)
    )
    assert weak.available == pytest.approx(0.8 * ideal.available, rel=1e-9)
    assert weak.required == ideal.required


def test_the_lag_is_that_of_the_steady_state(drive: mv.Scenario) -> None:
    for viscous, gain_b in (
        ("0.0255 N*m*s/rad", 0.0),
        ("50 N*m*s/rad", 0.0),
        ("50 N*m*s/rad", -0.3),
    ):
        errors = {"driver.imperfections.gain_b": gain_b}
        changed = drive.with_({"friction.viscous": viscous, **errors})
        state = mv.steady_state(changed)
        behind = float(np.mean((changed.rate or 0.0) * state.time - state["theta_l"]))
        assert lag_of_array(changed) == pytest.approx(behind, rel=0.02)


def test_a_constraint_forbids_settings(drive: mv.Scenario) -> None:
    with pytest.raises(mv.OptionError, match="torque margin"):
        quiet(drive, "rms", ["ramp"], constraints=Constraints(margin=50.0), cases=8, effort=4)


def test_a_drive_with_presliding_is_drawn_with_its_own_and_without(drive: mv.Scenario) -> None:
    own = {"stiffness": "3000 N*m/rad", "elements": 7}
    scenario = drive.with_({"friction.presliding": own})
    cases = draw_cases(scenario, [], count=8)
    assert "friction.presliding: stiffness 3000 N*m/rad, elements 7 or none" in cases.text
    drawn = [scenario.with_si(changes).friction.presliding for changes in cases.judged]
    assert drawn.count(None) == 4
    assert drawn.count(scenario.friction.presliding) == 4


# ---- The search ----


def test_a_full_ramp_is_found(found: QuietDrive) -> None:
    assert found.setting is not None
    assert found.quieter["driver.microstep_ramp"] == pytest.approx(1.0, abs=0.02)
    assert found.before.from_rest == pytest.approx(36.5e-3, rel=0.02)
    assert found.after.from_rest < 6e-3


def test_cases_count_from_their_worst_start(found: QuietDrive) -> None:
    """With a full ramp some cases slip and stick; the drive as it is from rest does not."""
    assert found.after.cases.size == 8
    assert found.after.worst > 3.0 * found.after.from_rest
    assert found.after.coexisting > 0
    text = terminal_text(quiet_outcome(found))
    assert "several motions" in text
    assert "assumed" in text


def test_a_search_tells_its_best_from_its_first_setting(drive: mv.Scenario) -> None:
    """Of the nominal drive until drawn cases judge; each is better than those before."""
    said: list[str] = []

    class Enough(Exception):
        pass

    def note(text: str) -> None:
        said.append(text)
        if "worst of" in text:
            raise Enough

    with pytest.raises(Enough):
        quiet(drive, "rms", ["ramp"], cases=8, effort=4, on_best=note)
    assert "of the nominal drive: driver.microstep_ramp 0" in said[0]
    nominal = [float(text.split()[0]) for text in said[:-1]]
    assert nominal == sorted(nominal, reverse=True)
    assert "in the worst of 16 cases: driver.microstep_ramp" in said[-1]


def test_a_search_tells_each_run_from_the_first_moment(
    found: QuietDrive, told: list[tuple[float, float]]
) -> None:
    """Of the runs that judge, too, which are most of a short search."""
    done = np.array([one for one, _ in told])
    total = told[-1][1]
    assert done[0] == 0.0
    assert np.all(np.diff(done) >= 0.0)
    assert len({whole for _, whole in told[2:]}) == 1
    assert np.sum(np.diff(done) == 1.0) >= 0.5 * found.runs
    judging = 3 * (1 + len(found.cases.judged)) * len(STARTS)
    inside = done[(done > total - judging) & (done < total)]
    assert np.max(np.diff(inside)) <= 2 * len(STARTS)
    assert done[-1] == total or found.best_nominal is None


def test_an_interrupted_search_goes_on_from_its_file(
    found: QuietDrive, drive: mv.Scenario, kept: Path
) -> None:
    lines = kept.read_text().splitlines(keepends=True)
    kept.write_text("".join(lines[:-1]) + lines[-1][:20])  # as a power failure leaves it
    again = quiet(drive, "rms", ["ramp"], cases=8, effort=4, keep=kept)
    assert again.runs <= 1
    assert np.array_equal(again.after.cases, found.after.cases)
    assert again.setting == found.setting
    assert kept.read_text() == "".join(lines)


def test_a_kept_figure_that_was_edited_is_a_sentence(
    found: QuietDrive, drive: mv.Scenario, kept: Path, tmp_path: Path
) -> None:
    head, first, *rest = kept.read_text().splitlines()
    key, value, *others = json.loads(first)
    other = tmp_path / "edited.jsonl"
    other.write_text("\n".join([head, json.dumps([key, 0.1 * value, *others]), *rest, ""]))
    with pytest.raises(mv.MicrovibError, match="line 2: was changed since the search wrote it"):
        quiet(drive, "rms", ["ramp"], cases=8, effort=4, keep=other)


def test_a_file_of_something_else_is_refused(drive: mv.Scenario, tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    for text in ("a,b\n1,2\n3,4\n", "one line"):
        other.write_text(text)
        with pytest.raises(mv.MicrovibError, match="was not written by a search"):
            quiet(drive, "rms", ["ramp"], cases=8, effort=4, keep=other)
        assert other.read_text() == text


def test_verdicts_are_on_the_quantile_over_cases(found: QuietDrive) -> None:
    assert quiet_outcome(found).verdict == ""
    assert quiet_outcome(found, 1e-3).verdict == "fail"
    assert quiet_outcome(found, 1.0).verdict == "not judged"  # eight cases bound no quantile


def test_the_folder_has_what_a_driver_takes(found: QuietDrive) -> None:
    files, report = study_contents(quiet_outcome(found))
    assert {"scenario.yaml", "lines.csv", "designs.csv", "levers.json", "cases.png"} <= set(files)
    assert "ramp" in json.loads(str(files["levers.json"]))["levers"]
    assert report is not None


@pytest.mark.release
def test_a_table_of_somebody_else_is_checked(drive: mv.Scenario, tmp_path: Path) -> None:
    (table,) = parse_levers(["table"], drive, TableLimits(bits=10))
    made = with_levers(drive, [table], Setting((table.guess,)))
    assert made.driver.table is not None
    whole = np.rint(np.array(made.driver.table.currents) * levels_of(10)).astype(int)
    file = tmp_path / "table.csv"
    rows = "".join(f"{a},{b}\n" for a, b in whole.tolist())
    file.write_text(f"i_a_of_511,i_b_of_511\n{rows}")
    assert np.allclose(read_current_table(file)["currents"], made.driver.table.currents)
    checked = quiet(drive, "full_step_1", check=file, cases=8, effort=4)
    assert checked.setting is None
    assert checked.after.from_rest == pytest.approx(1.05e-3, rel=0.2)
    assert checked.before.from_rest == pytest.approx(5.11e-3, rel=0.02)


def currents_file(file: Path, rows: np.ndarray) -> Path:
    """A table of currents over I as somebody else's file."""
    file.write_text("i_a,i_b\n" + "".join(f"{a:.9f},{b:.9f}\n" for a, b in rows.tolist()))
    return file


def test_lines_of_a_drive_that_a_table_stops_are_not_zero(
    drive: mv.Scenario, tmp_path: Path
) -> None:
    """Currents that turn backwards: no line is quieter, and the margin that is asked for is judged."""
    backwards = currents_file(tmp_path / "table.csv", table_rows(drive.driver, [])[::-1])
    given = Constraints(margin=2.0)
    checked = quiet(drive, "full_step_1", check=backwards, constraints=given, cases=8, effort=4)
    assert checked.after.from_rest == math.inf
    line = next(x for x in checked.lines if x.name == "full_step_1")
    assert line.before == pytest.approx(5.11e-3, rel=0.02)
    assert line.after == math.inf
    assert math.isnan(line.change)
    outcome = quiet_outcome(checked, 1.0)
    assert outcome.verdict == "fail"
    text = terminal_text(outcome)
    assert "Not allowed: torque margin 1.42, below 2.00" in text
    assert "not known" in text


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"bits": 8}, "bits: does not go with check"),
        ({"levels": ["ramp"]}, "lever: does not go with check"),
        ({"table_rows": 32}, "table_rows 32: is less than the 64 rows that the table takes"),
        ({"rows": 63}, r"table.csv: driver\.table\.currents: has 63 rows"),
    ],
)
def test_what_does_not_go_with_a_check_is_one_sentence(
    drive: mv.Scenario, tmp_path: Path, options: dict[str, Any], sentence: str
) -> None:
    rows = table_rows(drive.driver, [])[: options.pop("rows", None)]
    levers = options.pop("levels", [])
    table = currents_file(tmp_path / "table.csv", rows)
    with pytest.raises(mv.MicrovibError, match=sentence):
        quiet(drive, "rms", levers, check=table, cases=8, **options)


@pytest.mark.parametrize("count", [8, 19, 50, 72, 80])
def test_a_further_case_exceeds_the_stated_quantile_no_more_often_than_it_says(count: int) -> None:
    """Its probability, the mean of a beta distribution, is 1 - k / (n + 1) for the k-th of n cases."""
    k = upper_quantile(np.arange(1.0, count + 1.0), P95)
    least = 1.0 - P95 if count >= 19 else 1.0 / (count + 1.0)
    assert 1.0 - k / (count + 1.0) <= least + 1e-12
    assert 1.0 - (k - 1.0) / (count + 1.0) > 1.0 - P95  # none smaller does
    draws = np.random.default_rng(5).random((4000, count))
    stated = np.array([upper_quantile(x, P95) for x in draws])
    exceeded = float(np.mean(np.random.default_rng(6).random(4000) > stated))
    assert exceeded <= least + 3.0 * math.sqrt(least / 4000.0)


def test_a_drive_without_a_rate_is_refused(drive: mv.Scenario) -> None:
    with pytest.raises(mv.MicrovibError, match=r"tracking\.profile"):
        quiet(drive.with_({"tracking": {"profile": [{"rate": "0.06 deg/s"}]}}), "rms", ["ramp"])


def test_what_the_record_does_not_show_is_not_passed(found: QuietDrive) -> None:
    """Cases of which the record does not tell enough, and requirements, which a budget judges."""
    same = np.full(80, 1e-3)
    many = replace(found.after, cases=same, most=same, least=same)
    shown = replace(found, after=many)
    assert quiet_outcome(shown, 1.0).verdict == "pass"
    noisy = {"friction.torque_noise": {"density": 1e-3, "lowest": 5.0, "highest": 6.0}}
    for scale, verdict in ((1e-12, "pass"), (1.0, "not judged")):  # one draw in each case
        noisy["friction.torque_noise"]["density"] = 1e-3 * scale
        loud = replace(shown, scenario=found.scenario.with_si(noisy))
        assert quiet_outcome(loud, 1e-2).verdict == verdict
    unknown = np.where(np.arange(80) < 8, math.nan, 1e-3)
    for most, verdict in ((0.5, "pass"), (2.0, "not judged"), (math.inf, "not judged")):
        open_to = np.where(np.isnan(unknown), most, 1e-3)
        bounded = replace(many, cases=unknown, most=open_to, least=np.nan_to_num(unknown))
        outcome = quiet_outcome(replace(found, after=bounded), 1.0)
        assert outcome.verdict == verdict
        assert f"95 % of the cases: {verdict}" in terminal_text(outcome)
    assert "in 8 of 80 cases the record" in terminal_text(outcome)
    requirements = Requirements.model_validate({"requirements": [{"limit": "1 urad"}]})
    pointing = replace(found.objective, requirements=requirements.requirements)
    assert quiet_outcome(replace(shown, objective=pointing), 1.0).verdict == "not judged"


SLOW_SAMPLES = {"record.settle": "10 s", "record.duration": "4 s", "record.sample_rate": "82 Hz"}


@pytest.mark.parametrize(
    ("objective", "rate"), [("drive_1", "0.06 deg/s"), ("0.5:150 Hz", "0.03 deg/s")]
)
def test_lines_count_at_any_sample_rate(drive: mv.Scenario, objective: str, rate: str) -> None:
    """The record shows lines up to 28.7 Hz; what is asked for is above it, and was taken for 0."""
    slow = drive.with_({**SLOW_SAMPLES, "tracking.rate": rate})
    dense = slow.with_({"record.sample_rate": "2048 Hz"})
    asked = parse_objective(objective, slow)
    with evaluations(asked) as figures:
        found = figures.values([Case(one, STARTS[0]) for one in (slow, dense)])
    assert found[0] == pytest.approx(found[1], rel=5e-3)
    assert found[0] > 10e-3


def test_a_line_that_no_record_shows_is_not_zero(drive: mv.Scenario) -> None:
    """At a rate at which it would take too many samples, nothing is known of it."""
    objective = parse_objective("0.5:2000000 Hz", drive)
    figure = figure_of(drive, STARTS[0].name, objective)
    assert math.isnan(figure.value)
    assert figure.most == math.inf


def test_a_drive_without_the_line_is_quiet(drive: mv.Scenario) -> None:
    """A line that the drive does not have is 0; one that others hide, or the floor, is at most its bound."""
    asked = parse_objective("drive_1", drive)
    lines = replace(measure_lines(drive), names=(), frequency=np.zeros(0), amplitude=np.zeros(0))
    assert asked.of(replace(lines, untold=())) == 0.0
    hidden = replace(lines, untold=(UntoldLine("drive_1", 53.0, 2e-3),))
    assert math.isnan(asked.of(hidden))
    assert asked.most(hidden) == 2e-3


def test_a_line_that_leaves_the_passband_is_not_seen(drive: mv.Scenario) -> None:
    """64 microsteps put drive_1 at 212 Hz, above the 179 Hz that 512 samples a second show: it is not
    0 there, and counts for the RMS, for which the record becomes denser.
    """
    fine = drive.with_({"record.sample_rate": "512 Hz", "driver.microsteps": 64})
    of_step, of_all = (parse_objective(text, fine) for text in ("full_step_1", "rms"))
    lines = {x.name: x.amplitude for x in figure_of(fine, STARTS[0].name, of_step).lines}
    assert lines["full_step_1"] == pytest.approx(5.16e-3, rel=0.02)
    assert math.isnan(lines["drive_1"])
    with evaluations(of_all) as figures:
        (one,) = figures.figures([Case(fine, STARTS[0])])
    assert {x.name: x.amplitude for x in one.lines}["drive_1"] == pytest.approx(3.34e-3, rel=0.05)


# ---- What the record does not tell ----


@pytest.fixture(scope="module")
def short() -> mv.Scenario:
    """A drive whose record of 2 s resolves neither the gear's line at 0.556 Hz nor, while the start rings,
    the driving lines; its only line from 0.2 to 1.5 Hz has 11.02 mN m in a record of 54 s.
    """
    changes = {
        "reducer.transmission_error": [{"order": 20, "amplitude": "60 arcsec", "phase": "0 deg"}],
        "array.modes": [{"frequency": "3.1 Hz", "damping": "1.5 percent"}],
        "array.inertia": "3 kg*m^2",
        "tracking.rate": "0.1 deg/s",
        "driver.microsteps": 8,
        "record.settle": "6 s",
        "record.duration": "2 s",
        "record.sample_rate": "1024 Hz",
    }
    return mv.load_scenario("state-1").with_(changes)


SLOW_BAND = "0.2:1.5 Hz"


@pytest.mark.parametrize("objective", [SLOW_BAND, "0.53:0.6 Hz"])
@pytest.mark.parametrize("ramp", [0.0, 1.0])
def test_a_band_counts_what_may_be_in_it(short: mv.Scenario, objective: str, ramp: float) -> None:
    """Driving lines that the fit does not separate are no line of a band 80 times lower, and a line there
    that the record does not resolve leaves it open; a long record tells it.
    """
    drive = short.with_({"driver.microstep_ramp": ramp})
    long = drive.with_({"record.settle": "60 s", "record.duration": "54 s"})
    asked = parse_objective(objective, drive)
    figure, told = (figure_of(one, STARTS[0].name, asked) for one in (drive, long))
    lines = {x.name: x.amplitude for x in mv.find_lines(mv.simulate(long))}
    assert told.value == pytest.approx(lines["wave_generator_20"], rel=1e-6)
    assert math.isnan(figure.value)
    assert figure.least <= told.value <= figure.most
    assert figure.duration >= 4.4


def test_what_is_left_counts_by_its_own_frequencies(drive: mv.Scenario) -> None:
    """A tone of 3 mN m at 70 Hz that no line explains is in the bands about it, and in no others."""
    lines = measure_lines(drive)
    tone = np.where(np.abs(lines.left.frequency - 70.0) < 0.1, 0.5 * 3e-3**2, 0.0)
    with_tone = replace(lines, left=replace(lines.left, mean_square=tone))
    for band, there in (("65:75 Hz", True), ("75:95 Hz", False), ("5:65 Hz", False)):
        figure = parse_objective(band, drive).of
        alone = figure(replace(lines, left=replace(lines.left, mean_square=0.0 * tone)))
        assert figure(with_tone) == pytest.approx(3e-3 if there else alone, rel=1e-9)


def test_a_curve_counts_what_may_be_under_it(short: mv.Scenario, tmp_path: Path) -> None:
    limit = tmp_path / "limit.csv"
    limit.write_text("frequency_hz,amplitude_n_m\n0.3,0.02\n1.5,0.02\n")
    asked = parse_objective(str(limit), short)
    figure = figure_of(short, STARTS[0].name, asked)
    assert math.isnan(figure.value)
    assert figure.least <= 11.02e-3 / 0.02 <= figure.most


@pytest.fixture(scope="module")
def untold(short: mv.Scenario, tmp_path_factory: pytest.TempPathFactory) -> QuietDrive:
    """Its own currents as a table, judged."""
    file = tmp_path_factory.mktemp("untold") / "table.csv"
    own = currents_file(file, table_rows(short.driver, []))
    return quiet(short, SLOW_BAND, check=own, cases=8)


def test_cases_that_the_record_leaves_open_are_said(untold: QuietDrive) -> None:
    """No verdict, no improvement and no other motion of what is one linear steady motion."""
    outcome = quiet_outcome(untold, 20e-3)
    assert outcome.verdict == "not judged"
    assert untold.before.unknown == untold.after.unknown == 8
    assert untold.after.coexisting == 0
    text = terminal_text(outcome)
    assert "95 % of cases: not known before, not known after" in text
    assert (
        "Not known in 8 of 8 cases before and 8 of 8 after: the record of 2 s does not tell" in text
    )
    assert "use record.duration >=" in text
    assert "several motions the quieter drive has" not in text
    assert " dB)" not in text


def test_lines_that_are_not_told_are_not_zero(untold: QuietDrive) -> None:
    """Table, file and picture: the largest that they may be comes first."""
    rows = {row.name: row for row in untold.lines}
    for name in ("wave_generator_20", "drive_1"):
        assert math.isnan(rows[name].before)
        assert math.isnan(rows[name].before_p95)
    files, _ = study_contents(quiet_outcome(untold))
    table = [line.split(",") for line in str(files["lines.csv"]).splitlines()]
    row = next(line for line in table if line[0] == "wave_generator_20")
    assert row[2] in ("", "nan")
    drawn = draw_lines(untold)
    assert "not known" in {text.get_text() for text in drawn.axes[0].texts}


def test_a_line_of_sight_counts_lines_that_are_not_told() -> None:
    """A hidden line may add to the angle what the drive's motion makes of its bound."""
    craft = mv.load_scenario("examples/spacecraft.yaml")
    asked = parse_objective("rms", craft, "examples/requirement.yaml")
    lines = measure_lines(craft, pointing=True)
    assert lines.los is not None
    told = asked.of(lines)
    line = UntoldLine("full_step_2", 6.7, 1.0, los=10.0 * np.abs(lines.los).max(axis=0))
    hidden = replace(lines, untold=(line,))
    assert math.isnan(asked.of(hidden))
    assert asked.most(hidden) > 1.01 * told
    assert asked.least(hidden) <= told


def test_lines_that_nothing_makes_leave_no_band_open(drive: mv.Scenario) -> None:
    """An ideal driver has no lines of the electrical period, a table against the detent torque alone none
    of orders 1 to 3; errors of the driver have."""
    assert is_made("drive_1", drive)
    assert is_made("full_step_1", drive)
    for made, changes in (
        (False, {}),
        (True, {"driver.imperfections.gain_b": 0.01}),
        (True, {"reducer.backlash": "1 arcsec"}),
    ):
        assert is_made("electrical_2", drive.with_(changes)) == made
    (table,) = parse_levers(["table"], drive)
    corrected = with_levers(drive, [table], Setting((table.guess,)))
    assert not is_made("electrical_1", corrected)
    series = np.abs(mv.steady_state(corrected).harmonics()[1:])
    lines = mv.find_lines(mv.steady_state(corrected))
    electrical = [x.amplitude for x in lines if x.name == "electrical_1" and x.seen]
    assert max(electrical, default=0.0) < 1e-6 * series.max()
