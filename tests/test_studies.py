"""Comparison and identification on evidence whose truth is known, because it was simulated."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from support.scenarios import baseline

import microvib as mv
from microvib.errors import MicrovibError
from microvib.io.recordings import write_recording
from microvib.io.sources import open_source
from microvib.reports.comparison import comparison_outcome
from microvib.reports.document import Form, Table
from microvib.reports.identification import (
    draw_before_and_after,
    fit_json,
    fit_outcome,
)
from microvib.reports.outcome import study_contents, terminal_text
from microvib.reports.rendering import write_study
from microvib.studies.compare import Side, SideLine, _match_unlisted_names, compare
from microvib.studies.evidence import evidence_of, select_evidence
from microvib.studies.identify import (
    Candidate,
    ErrorModel,
    effects_of,
    identify,
    parse_fit,
    parse_key,
    selection,
    with_effects,
)
from microvib.studies.identify.goodness import Goodness, goodness
from microvib.studies.identify.problem import Problem
from microvib.studies.identify.search import Descent, Optimum
from microvib.studies.identify.selection import EFFECTS, Selector
from microvib.testdata.recording import Recording


def read_evidence(path, scenario, **how):
    return evidence_of(open_source(str(path), **how), scenario, name=str(path))


def compared(a, b):
    first = open_source(str(a))
    return compare(first, first if a == b else open_source(str(b)), names=(str(a), str(b)))


TRUTH = {
    "array.rigid_inertia": 0.11,
    "reducer.stiffness": 10_500.0,
    "motor.friction.viscous": 0.022,
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A made test: other parameters, another clock, noise, drift and mains on top; eight seconds after four."""
    scenario = baseline().with_si(
        {**TRUTH, "tracking.clock_ratio": 0.9962, "record.settle": 4.0, "record.duration": 8.0}
    )
    torque = mv.simulate(scenario, channels=("T_d",))["T_d"]
    t = np.arange(torque.size) / 4096
    random = np.random.default_rng(3)
    torque = (
        torque
        + random.normal(0, 1e-3, t.size)
        + 1e-3 * np.sin(2 * np.pi * 50 * t)
        + 2e-3 * np.sin(0.5 * t)
    )
    path = tmp_path_factory.mktemp("tests") / "made.uff"
    write_recording(Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, "made"), path)
    return path


@pytest.fixture(scope="module")
def start():
    return baseline().with_si({"record.settle": 4.0})


def test_evidence_of_a_recording(recording, start):
    evidence = read_evidence(recording, start)
    assert evidence.clock_ratio == pytest.approx(0.9962, abs=2e-6)
    assert evidence.duration == 8.0
    assert {("drive_1", "amplitude"), ("drive_2", "phase"), ("array_mode_1", "frequency")} <= {
        (o.line, o.form) for o in evidence.observations
    }


@pytest.fixture(scope="module")
def fit(recording, start):
    """The true damping is ten times the start's, two and a half times the range that is begun with; the mode's frequency is 4 % off."""
    wrong = start.with_si(
        {
            **TRUTH,
            "reducer.stiffness": 8000.0,
            "reducer.damping": 0.5,
            "array.modes.0.frequency": 1.24,
        }
    )
    keys = [parse_fit(wrong, key) for key in ("reducer.stiffness", "reducer.damping")]
    return identify(
        wrong, [(read_evidence(recording, wrong), {})], keys, starts=16, finishes=2, seed=2
    )


def test_identification_finds_the_truth(fit):
    truth = {"reducer.stiffness": 10_500.0, "reducer.damping": 5.0, "array.modes.0.frequency": 1.19}
    assert {e.key for e in fit.estimates} == set(truth)
    for e in fit.estimates:
        assert e.identifiable, e
        assert e.low < 0.99 * truth[e.key] < 1.02 * truth[e.key] < e.high, e
        assert e.interval[0] <= truth[e.key] <= e.interval[1], e
        assert e.standard_error < 0.03 * truth[e.key], e
    assert "fitted as well" in fit.estimates[-1].verdict
    assert fit.goodness.explained
    assert fit.converged
    assert fit.usable
    assert "explains these data" in fit.goodness.sentence
    assert not any(d.off for d in fit.deviations)


def first_text(fit):
    """What stands first in a report, and before all estimates on a terminal."""
    return fit_outcome(fit).parts[0].items[0].text


def test_all_figures_are_shown_and_nothing_is_green_that_nothing_checks(fit):
    assert fit_outcome(fit).facts[0].status == "pass"
    ((evidence, _),) = fit.before
    shown = evidence.observations
    assert any("plus_" in o.line for o in shown)
    assert any(o.is_angle for o in shown)
    assert all(f"{o.line} {o.form}" in terminal_text(fit_outcome(fit)) for o in shown)
    (figures,) = (
        s for s in study_contents(fit_outcome(fit))[1].sections if s.title == "Before and after"
    )
    table = next(block for block in figures.blocks if isinstance(block, Table))
    rows = {row.cells[0]: row.cells for row in table.rows}
    assert set(rows) == {f"{o.line} {o.form}" for o in shown}
    angle = next(o for o in shown if o.is_angle)
    unit, test, _, after, *off = rows[f"{angle.line} {angle.form}"][1:7]
    assert (unit, off) == ("deg", ["", ""])
    assert float(test.replace("−", "-")) == pytest.approx(math.degrees(angle.value), rel=1e-3)
    assert abs(float(after.replace("−", "-")) - float(test.replace("−", "-"))) < 30.0
    amplitudes = [o.line for o in shown if o.form == "amplitude"]
    drawing = draw_before_and_after(fit)
    assert [label.get_text() for ax in drawing.axes for label in ax.get_xticklabels()] == amplitudes
    unchecked = replace(fit.goodness, chi_square=0.0, figures=2, parameters=2)
    bare = replace(fit, goodness=unchecked)
    assert fit_outcome(bare).facts[0].value == "not checked"
    assert fit_outcome(bare).facts[0].status == ""


def test_what_identifies_nothing_says_so_first(fit):
    """However well its figures agree; and nothing of it is adopted."""
    reason = "not identifiable: the evidence is insensitive to it"
    none = replace(
        fit, estimates=tuple(replace(e, identifiable=False, verdict=reason) for e in fit.estimates)
    )
    assert first_text(none).startswith(
        "Nothing is identified: the evidence is insensitive to it. Agreement of the model with the data"
    )
    assert not none.usable
    one = replace(fit, estimates=(none.estimates[0], *fit.estimates[1:]))
    assert one.usable
    assert first_text(one).startswith("The model explains these data")


def test_parameters_of_one_ending_are_told_apart(fit):
    """``motor.friction.viscous`` is not ``friction.viscous``."""
    blocks = [
        block
        for section in study_contents(fit_outcome(fit))[1].sections
        for block in section.blocks
    ]
    heads = {
        column.title for block in blocks if isinstance(block, Table) for column in block.columns
    }
    assert {e.key for e in fit.estimates} <= heads
    assert "modes.0.frequency" not in heads


def test_what_an_identification_writes(fit, tmp_path):
    assert np.diag(fit.correlation) == pytest.approx(1.0)
    assert fit.scenario.source_of("reducer.stiffness").startswith("identified from")
    files = write_study(tmp_path / "fit", study_contents(fit_outcome(fit)), Form(), overwrite=False)
    assert sorted(files) == [
        "alternatives.csv", "amplitudes.png", "correlation.csv", "dependences.csv", "fit.json",
        "left_1.png", "parameters.csv", "report.html", "scenario.yaml", "selection.csv",
        "sensitivities.csv",
    ]  # fmt: skip
    written = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert set(written["parameters"]["reducer.stiffness"]) >= {"estimate", "standard_error", "unit"}
    assert written["goodness"]["explained"] is True
    (left,) = written["left"]
    frequency, amplitude, floor = (
        np.array(left[name]) for name in ("frequency_hz", "amplitude_n_m", "floor_n_m")
    )
    mains = np.argmin(np.abs(frequency - 50.0))
    assert frequency[mains] == pytest.approx(50.0, abs=0.1)  # no line of the drive
    assert amplitude[mains] == pytest.approx(1e-3, rel=0.2)
    noise = (
        np.sqrt(np.log(4.0)) * 1e-3 * np.sqrt(1.5 * 2.0 / (8.0 * 4096.0))
    )  # median of bins, with the window's

    assert np.quantile(floor, 0.1) == pytest.approx(
        noise, rel=0.2
    )  # elsewhere there are lines that are not listed
    assert "there is an unexplained peak; the highest above the floor is" in terminal_text(
        fit_outcome(fit)
    )
    assert "Residual of" in (tmp_path / "fit" / "report.html").read_text()
    again = mv.load_scenario(tmp_path / "fit" / "scenario.yaml")
    assert again.reducer.stiffness == fit.scenario.reducer.stiffness
    assert fit_json(fit)["status"].startswith("calibrated")
    assert first_text(fit).startswith("The model explains these data")


@pytest.mark.release
def test_estimates_lean_on_what_was_not_fitted(recording, start):
    """To first order: where the inertia is 1 % wrong, the estimate moves as was said."""
    evidence = [(read_evidence(recording, start), {})]
    known = start.with_si({k: v for k, v in TRUTH.items() if k != "reducer.stiffness"})
    key = parse_fit(start, "reducer.stiffness=9000 N*m/rad:12000 N*m/rad")
    loose = {"model_error": 0.3, "starts": 2, "finishes": 1}
    found = identify(known, evidence, [key], **loose)
    heavier = identify(
        known.with_si({"motor.rotor_inertia": 1.01 * known.motor.rotor_inertia}),
        evidence,
        [key],
        **loose,
    )
    shift = next(one.shifts[0] for one in found.dependences if one.key == "motor.rotor_inertia")
    moved = heavier.estimates[0].estimate / found.estimates[0].estimate - 1.0
    assert moved == pytest.approx(0.01 * shift, rel=0.2)


def test_a_model_that_does_not_explain_the_data_identifies_nothing(recording, start, tmp_path):
    """One key on a recording that needs more; of the drive's lines alone, or the mode's frequency is fitted as well."""
    (evidence,) = select_evidence([read_evidence(recording, start)], start, ["20:400 Hz"])
    key = parse_fit(start, "reducer.stiffness=4000 N*m/rad:20000 N*m/rad")
    fit = identify(start, [(evidence, {})], [key], starts=2, finishes=1)
    assert fit.goodness.ratio > 10.0 * fit.goodness.limit
    assert not any(e.identifiable for e in fit.estimates)
    assert all(math.isnan(e.standard_error) and math.isnan(e.interval[0]) for e in fit.estimates)
    assert not fit.usable
    text = terminal_text(fit_outcome(fit))
    assert first_text(fit).startswith("The model does not explain these data: chi-square")
    worst = max(fit.deviations, key=lambda d: abs(d.sigma))
    _, outliers, _, _ = text[text.index(first_text(fit)) :].split("\n\n")[:4]
    assert f"{worst.line} {worst.form}" in outliers
    write_study(tmp_path / "fit", study_contents(fit_outcome(fit)), Form(), overwrite=False)
    written = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert written["usable"] is False
    assert written["parameters"]["reducer.stiffness"]["standard_error"] is None
    assert "does not explain" in fit.scenario.source_of("reducer.stiffness")


def test_a_stated_range_is_respected_and_its_end_is_not_identifiable(recording, start):
    evidence = read_evidence(recording, start)
    known = start.with_si({k: v for k, v in TRUTH.items() if k != "motor.friction.viscous"})
    key = parse_fit(
        start, "motor.friction.viscous=0.005 N*m*s/rad:0.0215 N*m*s/rad"
    )  # the truth, 0.022, lies outside
    (e,) = identify(known, [(evidence, {})], [key], starts=2, finishes=1, model_error=0.1).estimates
    assert e.low < e.estimate <= 0.0215
    assert not e.identifiable
    assert e.verdict == "not identifiable: at the end of its range"


def test_a_common_error_of_the_scale_is_no_misfit(recording, start):
    """A recording that reads 3 % high throughout."""
    evidence = read_evidence(recording, start)
    scaled = replace(evidence, observations=tuple(
        replace(o, value=1.03 * o.value) if o.form == "amplitude" else o for o in evidence.observations
    ))  # fmt: skip
    known = start.with_si({k: v for k, v in TRUTH.items() if k != "reducer.stiffness"})
    key = parse_fit(start, "reducer.stiffness=9000 N*m/rad:12000 N*m/rad")

    def fitted(common):
        problem = Problem(known, [(scaled, {})], [key], ErrorModel(0.004, common))
        return goodness(
            problem, problem.residuals([np.array([key.coordinate(TRUTH["reducer.stiffness"])])])[0]
        )

    assert not fitted(0.0).explained
    assert fitted(0.03).explained


def test_a_parameter_without_effect_is_not_identifiable(recording, start):
    """The rotor's Stribeck rate, where breakaway is no higher than Coulomb friction."""
    evidence = read_evidence(recording, start)
    key = parse_fit(start, "motor.friction.stribeck_rate=0.001 deg/s:0.01 deg/s")
    (rate,) = identify(
        start.with_si(TRUTH), [(evidence, {})], [key], starts=2, finishes=1
    ).estimates
    assert not rate.identifiable
    assert rate.verdict == "not identifiable: the evidence is insensitive to it"


def test_lines_are_chosen_by_band_and_name(recording, start):
    evidence = read_evidence(recording, start)
    (low,) = select_evidence([evidence], start, ["0.5:120 Hz"])
    assert {o.line for o in low.observations} < {o.line for o in evidence.observations}
    assert {"drive_1", "drive_2"} <= {o.line for o in low.observations}
    assert "drive_3" not in {o.line for o in low.observations}
    (rest,) = select_evidence([evidence], start, without=["drive_1"])
    assert not any(
        o.line == "drive_1" or o.form == "phase" for o in rest.observations
    )  # phases are relative to it
    with pytest.raises(
        MicrovibError, match=r"^without drive_99: no evidence has this line; there are"
    ):
        select_evidence([evidence], start, without=["drive_99"])
    with pytest.raises(MicrovibError, match="band: leaves no line"):
        select_evidence([evidence], start, ["2000:2001 Hz"])


def test_a_search_looks_at_short_records_with_the_lines_of_whole_ones():
    """Also with phases at the first sample; where the settling time is fitted, or a bin depends on the record, at whole ones."""
    true = baseline().with_si(
        {"record.settle": 20.0, "record.duration": 16.0, "driver.imperfections.offset_a": 0.02}
    )
    torque = mv.simulate(true, channels=("T_d",))["T_d"]
    evidence = evidence_of(Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, "made"), true)
    told = replace(
        evidence, observations=tuple(o for o in evidence.observations if o.line != "array_mode_1")
    )
    assert any(o.form == "turn" for o in told.observations)

    def problem(one, key="reducer.stiffness"):
        return Problem(true, [(one, {})], [parse_fit(true, key)], ErrorModel(0.004))

    whole = problem(told)
    short = whole.rough()
    record = short.tests[0][1].record
    assert record.settle + record.duration <= 0.7 * (20.0 + 16.0)
    lines, its = whole.residuals([whole.start])[0], short.residuals([whole.start])[0]
    amplitudes = np.array(
        [o.value if o.form == "amplitude" else math.inf for o in told.observations]
    )
    # full_step_8, a hundred-thousandth of the largest, is 2.1 % larger at 12.8 s, by steps four times as fine, too
    seen = amplitudes > 2e-5 * np.max(amplitudes[np.isfinite(amplitudes)])
    assert np.max(np.abs(lines - its)[: seen.size][seen]) < 1.0  # standard deviations
    assert short.whole is whole
    fitted = problem(told, "record.settle=15 s:25 s")
    bins = problem(
        replace(
            told, observations=tuple(replace(o, form="nearest_bin") for o in told.observations[:1])
        )
    )
    rings = problem(
        replace(
            told, observations=tuple(o for o in evidence.observations if o.line == "array_mode_1")
        )
    )
    for timed in (fitted, bins, rings):
        assert timed.rough() is timed


def test_slopes_serve_for_several_steps(recording, start):
    """From 3 % off, a local fit of three parameters takes fewer simulations than differences at each of its steps would."""
    keys = [parse_fit(start, key) for key in TRUTH]
    known = start.with_si(TRUTH)
    problem = Problem(known, [(read_evidence(recording, start), {})], keys, ErrorModel(0.004))
    found = Descent(problem, problem.start + np.array([0.03, -0.03, 0.03])).run(60)
    assert goodness(problem, found.r).explained
    assert found.x == pytest.approx(problem.start, abs=0.02)
    assert problem.best_so_far.simulations < 30


DAMPING = "array.modes.0.damping=0.5 percent:3 percent"
FEW = {"starts": 2, "finishes": 1}


@pytest.mark.long
def test_amplitudes_of_the_starts_ringing_do_not_count_where_its_time_is_not_known(
    recording, start
):
    """A wrong settling time must not move the damping: the decay tells it."""
    evidence = [(read_evidence(recording, start), {})]
    assert any(
        o.line == "array_mode_1" and o.form == "amplitude" for o in evidence[0][0].observations
    )
    wrong = start.with_si({**TRUTH, "record.settle": 6.0})
    fit = identify(wrong, evidence, [parse_fit(wrong, DAMPING)], **FEW)
    assert fit.goodness.explained
    assert fit.estimates[0].interval[0] < 0.01 < fit.estimates[0].interval[1]
    assert "array_mode_1 is not used" in fit.notes[0]


@pytest.mark.release
def test_amplitudes_of_the_starts_ringing_count_where_its_time_is_fitted(recording, start):
    true = start.with_si(TRUTH)
    keys = [parse_fit(true, key) for key in (DAMPING, "record.settle=3 s:6 s")]
    fit = identify(true, [(read_evidence(recording, start), {})], keys, **FEW)
    assert fit.notes == ()
    assert fit.estimates[1].interval[0] < 4.0 < fit.estimates[1].interval[1]


def test_a_test_s_own_keys_and_keys_named_twice_are_not_fitted(recording, start):
    evidence = read_evidence(recording, start)
    key = parse_fit(start, "reducer.stiffness")
    with pytest.raises(MicrovibError, match=r"^fit reducer.stiffness: the test .* sets it itself"):
        identify(start, [(evidence, {"reducer.stiffness": "9000 N*m/rad"})], [key])
    with pytest.raises(MicrovibError, match=r"^fit reducer.stiffness: is named twice"):
        identify(start, [(evidence, {})], [key, key])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "reducer.stifness",
            r"is not a key of the scenario; did you mean reducer\.stiffness\? allowed are",
        ),
        ("driver.microsteps", "is an integer; give its range"),
        ("reducer.stiffness=9000:3000", "needs a unit|below HIGH"),
        ("reducer.stiffness=9000 N*m/rad:3000 N*m/rad", "LOW must be below HIGH"),
        ("reducer.output_inertia", "starts at 0; give its range"),
        ("tracking.clock_ratio", "sets the step clock, which the recording's lines give"),
        ("tracking.rate", "sets the step clock"),
        ("reducer.ratio=90:110", "sets the step clock"),
        ("record.duration", "belongs to the recording"),
        ("solver.accuracy", "is a setting of the solver"),
    ],
)
def test_bad_fit_keys_are_one_sentence(start, text, complaint):
    with pytest.raises(MicrovibError, match=complaint):
        parse_key(start, text)


def test_bad_evidence_is_one_sentence(start, tmp_path):
    with pytest.raises(MicrovibError, match=r"nothing\.xyz: is not known; expected a scenario"):
        read_evidence("nothing.xyz", start)
    with pytest.raises(MicrovibError, match="state-1: is not evidence; expected a recording"):
        read_evidence("state-1", start)
    with pytest.raises(MicrovibError, match="state-1:model: is not evidence"):
        read_evidence("state-1:model", start)
    (tmp_path / "lines.csv").write_text("line,amplitude_n_m\ndrive_1,many\n")
    with pytest.raises(MicrovibError, match="row 2: amplitude_n_m 'many' is not a number"):
        read_evidence(tmp_path / "lines.csv", start)


def test_comparison_of_a_recording_with_a_scenario(recording, tmp_path):
    a, b, rows = compared(recording, "state-1")
    by_name = {row.line: row for row in rows}
    assert b.clock_ratio == pytest.approx(
        0.9962, abs=2e-6
    )  # the scenario ran at the recording's clock
    assert by_name["drive_1"].a.frequency == pytest.approx(by_name["drive_1"].b.frequency, abs=1e-4)
    assert abs(by_name["drive_2"].error) > 0.05
    contents = study_contents(comparison_outcome(a, b, rows))
    files = write_study(tmp_path / "out", contents, Form(), overwrite=False)
    assert sorted(files) == ["compare.csv", "report.html", "spectra.png"]
    assert "relative_error" in (tmp_path / "out" / "compare.csv").read_text()


def test_comparison_of_measured_and_model_reference_lines():
    _, _, rows = compared("state-1:measured", "state-1:model")
    errors = {row.line: 100 * row.bin_error for row in rows}
    assert errors == pytest.approx(
        {"array_mode_1": 5.0, "drive_1": -15.72, "drive_2": 22.33, "drive_3": 21.44}, abs=0.01
    )


def test_unexpected_lines_are_matched_by_frequency_not_by_number():
    lines = {"other_1": SideLine(100.0, 2.0), "other_2": SideLine(300.0, 1.0)}
    a, b = (
        Side("a", "table", lines),
        Side("b", "table", {"other_1": SideLine(300.001, 9.0), "other_2": SideLine(50.0, 5.0)}),
    )
    assert _match_unlisted_names(a, b).lines == {
        "other_2": b.lines["other_1"],
        "other_2_of_b": b.lines["other_2"],
    }


def test_comparison_of_a_scenario_with_itself():
    _, _, rows = compared("state-2", "state-2")
    assert all(row.bin_error == 0.0 for row in rows)


def test_a_recording_names_no_lines_of_a_drive_that_nobody_named(recording):
    from microvib.studies.analyse import analyse

    found = analyse(open_source(str(recording)))
    assert {line.kind for line in found.table} == {"other"}
    assert {line.origin for line in found.table} == {""}
    assert found.clock_ratio is None
    assert (
        "lines are not identified, because no scenario was given to predict them"
        in found.recording.notes
    )
    named = analyse(open_source(str(recording)), scenario=baseline())
    largest = max(named.table, key=lambda line: line.amplitude if line.status == "ok" else 0.0)
    assert max(line.amplitude for line in found.table) == pytest.approx(largest.amplitude, rel=0.01)
    _, _, rows = compared(recording, recording)
    assert rows
    assert all(row.line.startswith("other_") and row.error == 0.0 for row in rows)


def test_a_recording_and_a_table_need_a_drive_that_names_the_lines(recording, tmp_path):
    (tmp_path / "lines.csv").write_text("line,frequency_hz,amplitude_n_m\ndrive_1,14.5,0.05\n")
    with pytest.raises(MicrovibError, match="have no names without a drive; name it") as failed:
        compared(recording, tmp_path / "lines.csv")
    assert failed.value.remedy == "scenario"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (
            b"line,frequency_hz,amplitude_n_m\ndrive_1,14.5,inf\n",
            "row 2: amplitude_n_m is inf; a finite number",
        ),
        (
            b"line,frequency_hz,amplitude_n_m\ndrive_1,fast,0.05\n",
            "row 2: frequency_hz 'fast' is not a number",
        ),
        (
            b"line,frequency_hz,amplitude_n_m\n" + 200 * b"drive_1,14.5,0.05\n" + b"\xb5",
            "cannot be read: is not a table as text",
        ),
    ],
)
def test_tables_of_lines_that_are_broken(tmp_path, start, content, complaint):
    path = tmp_path / "lines.csv"
    path.write_bytes(content)
    for read in (lambda: read_evidence(path, start), lambda: compared(path, path)):
        with pytest.raises(MicrovibError, match=complaint):
            read()


def test_evidence_is_of_the_loads_ahead_of_the_chain(recording, start):
    from microvib.testdata.preparation import Preparation

    raw = read_evidence(recording, start)
    told = read_evidence(recording, start, preparation=Preparation(response="boxcar"))
    before, after = (
        {o.line: o for o in e.observations if o.form == "amplitude" and o.line.startswith("drive_")}
        for e in (raw, told)
    )
    assert len(before.keys() & after.keys()) >= 3
    for name in before.keys() & after.keys():
        gain = 1.0 / np.sinc(
            int(name.split("_")[1]) * start.driving_frequency * raw.clock_ratio / 4096.0
        )
        assert after[name].value == pytest.approx(
            gain * before[name].value, abs=0.1 * before[name].uncertainty
        )
    assert "response of the measuring chain removed (boxcar)" in " ".join(told.notes)


STATES = (
    {"reducer.stiffness": 10_500.0, "motor.friction.viscous": 0.022},
    {"array.inertia": 15.69, "motor.friction.viscous": 0.03},
)
"""Two tests of one reducer: another inertia and warmer grease, and so another friction, in the second."""


def two_tests(start):
    first = start.with_si({**STATES[0], "record.settle": 2.0, "record.duration": 6.0})
    random, found = np.random.default_rng(5), []
    for true in (first, first.with_si(STATES[1])):
        torque = mv.simulate(true, channels=("T_d",))["T_d"]
        x = Recording(
            {"Mz": torque + random.normal(0, 1e-3, torque.size)},
            4096.0,
            {"Mz": "N*m"},
            f"{true.array.inertia:g}",
        )
        found.append(x)
    return found


@pytest.mark.release
def test_what_is_shared_has_one_value_and_the_rest_one_for_each_recording(start, tmp_path):
    start = start.with_si(
        {"record.settle": 2.0, "motor.friction.viscous": 0.025, "reducer.stiffness": 8000.0}
    )
    other = start.with_si({"array.inertia": 15.69})
    keys, tests = ["reducer.stiffness", "motor.friction.viscous"], two_tests(start)
    evidence = [tests[0], (tests[1], other)]
    fit = identify(start, evidence, keys, share=["reducer.stiffness"], starts=16, finishes=1)
    found = {e.key: e for e in fit.estimates}
    truth = {
        "reducer.stiffness": 10_500.0,
        "motor.friction.viscous [8.18]": 0.022,
        "motor.friction.viscous [15.69]": 0.03,
    }
    assert set(found) == set(truth)
    for key, value in truth.items():
        assert found[key].identifiable, found[key]
        assert abs(found[key].estimate - value) < max(
            0.01 * value, 2.0 * found[key].standard_error
        ), found[key]
    assert [one.motor.friction.viscous for one in fit.scenarios] == [
        e.estimate for e in fit.estimates if e.recording
    ]
    assert [one.array.inertia for one in fit.scenarios] == [8.18, 15.69]
    assert "from 15.69" in fit.scenarios[1].source_of("motor.friction.viscous")
    assert {"scenario.yaml", "scenario-2.yaml"} <= set(
        write_study(tmp_path / "two", study_contents(fit_outcome(fit)), Form(), overwrite=False)
    )
    told = fit_json(fit)["parameters"]
    assert [told[key]["shared"] for key in truth] == [True, False, False]
    assert "One value in all 2 recordings: reducer.stiffness; one in each: motor" in terminal_text(
        fit_outcome(fit)
    )
    # one friction for both does not explain them, whatever it is
    stiff = [
        (one, sc.with_si({"reducer.stiffness": 10_500.0}))
        for one, sc in zip((evidence[0], evidence[1][0]), (start, other), strict=True)
    ]
    alike = identify(stiff[0][1], stiff, keys[1:], share=keys[1:], **FEW)
    assert not any(e.recording for e in alike.estimates)
    assert not alike.goodness.explained


def test_what_is_shared_must_be_fitted_and_in_every_scenario(recording, start):
    one = read_evidence(recording, start)
    with pytest.raises(
        MicrovibError,
        match=r"^share reducer\.damping: is not fitted; name it among the keys to fit, too",
    ):
        identify(start, [one, one], ["reducer.stiffness"], share=["reducer.damping"])
    rigid = start.with_({"reducer.hysteresis": {"loss": "10 arcsec", "stiffness": "1000 N*m/rad"}})
    with pytest.raises(
        MicrovibError, match=r"^fit reducer\.hysteresis\.loss: the scenario of .* does not have it"
    ):
        identify(rigid, [one, (one, start)], ["reducer.hysteresis.loss"])


def test_a_mode_that_does_not_seem_to_decay_is_a_row_as_others_are(fit):
    """Its decay, 0, has no relative difference."""
    ((one, before),), ((_, after),) = fit.before, fit.after
    told = [replace(o, value=0.0) if o.form == "decay" else o for o in one.observations]
    still = replace(one, observations=tuple(told))
    shown = terminal_text(
        fit_outcome(replace(fit, before=((still, before),), after=((still, after),)))
    )
    (row,) = [line for line in shown.splitlines() if line.startswith("array_mode_1 decay")]
    assert len(row.split()) == 7  # two words of its name, unit, three figures and sigma


def test_candidates_are_switched_on_and_off(start):
    on = with_effects(start, list(EFFECTS), list(EFFECTS))
    assert on.friction.presliding is not None
    assert on.reducer.hysteresis is not None
    assert on.reducer.transmission_error
    assert on.driver.distorted
    assert on.motor.detent_torque == start.motor.detent_torque
    off = with_effects(on, list(EFFECTS), [])
    assert off.motor.detent_torque == 0.0
    assert (
        off.with_si({"motor.detent_torque": start.motor.detent_torque}).with_sources(start.sources)
        == start
    )
    assert with_effects(off, list(EFFECTS), ["motor.detent_torque"]).motor.detent_torque > 0.0
    assert effects_of(["all"]) == list(EFFECTS)
    with pytest.raises(
        MicrovibError,
        match=r"^select friction\.presliging: is not a candidate; did you mean friction\.presliding",
    ):
        effects_of(["friction.presliging"])
    with pytest.raises(
        MicrovibError, match=r"^select friction\.torque_noise: not identifiable from lines"
    ):
        effects_of(["friction.torque_noise"])


def test_what_is_fitted_is_no_candidate(recording, start):
    told = [read_evidence(recording, start)]
    with pytest.raises(
        MicrovibError, match=r"^select motor\.detent_torque: is fitted, so it is no candidate"
    ):
        identify(start, told, ["motor.detent_torque"], select=["motor.detent_torque"])


def test_an_effect_is_asked_for_where_the_evidence_has_it_and_not_told_where_nothing_explains_it():
    told = Candidate("motor.detent_torque", False, 0.4, 1, 3.84)
    assert told.sentence.startswith(
        "motor.detent_torque: the evidence does not support it (chi-square lower by 0.4 with 1"
    )
    assert "not told: no model explains the evidence" in replace(told, explained=False).sentence
    assert "the evidence asks for it" in replace(told, selected=True, gain=20.0).sentence


class Told(Selector):
    """With gains that are given: much by chi-square, little over the scatter that is left."""

    def raw_gain(self, models, name):
        return 1500.0

    def gain(self, models, name):
        return 1500.0 / 12_000.0


def test_a_single_effect_is_held_against_the_scatter_that_is_left(monkeypatch, start):
    """Where no model explains the evidence, chi-square falls far by any parameter: that alone asks for nothing."""
    monkeypatch.setattr(selection, "goodness", lambda *_: Goodness(2e5, 18, 2))
    posed = Problem(start, [], [parse_fit(start, "reducer.stiffness")], ErrorModel(0.004))
    monkeypatch.setattr(
        Told, "fitted", lambda self, on: (posed, Optimum(np.zeros(0), np.zeros(0), 0.0))
    )
    selector = Told(start, [], [], ["motor.detent_torque"], ErrorModel(0.004), 1, 8, None)
    (told,) = selector.run()[-1]
    assert not told.selected
    assert not told.explained


def test_friction_with_memory_and_over_the_angle_may_be_fitted_where_the_scenario_has_it(start):
    keys = ("friction.presliding.stiffness", "friction.presliding.breakaway_angle")
    with pytest.raises(
        MicrovibError,
        match=r"^fit friction\.presliding\.stiffness: the scenario has no friction\.presliding",
    ):
        parse_fit(start, keys[0])
    memory = {"stiffness": 9000.0, "breakaway_angle": 3e-4, "elements": 4}
    position = {"harmonics": [{"order": 12_000, "amplitude": 0.01}]}
    has = start.with_si({"friction.presliding": memory, "friction.position": position})
    found = [parse_fit(has, key) for key in (*keys, "friction.position.harmonics.0.amplitude")]
    assert [key.range for key in found] == [
        pytest.approx((math.log(v / 4), math.log(v * 4))) for v in (9000.0, 3e-4, 0.01)
    ]


def test_a_table_is_evidence_of_the_lines_that_a_simulation_has():
    """Members beyond the eighth count; lines that nobody expects, which tables number by size, do not."""
    scenario = mv.load_scenario("state-1", {"record.settle": "40 s", "record.duration": "8 s"})
    table = mv.find_lines(scenario, start="steady", harmonics=12)
    stray = replace(table["drive_10"], name="other_1", kind="other")
    evidence = evidence_of(replace(table, lines=(*table, stray)), scenario)
    lines = [o.line for o in evidence.observations]
    assert {"drive_9", "drive_12"} < set(lines)
    problem = Problem(
        scenario, [(evidence, {})], [parse_key(scenario, "reducer.stiffness")], ErrorModel(0.004)
    )
    (r,) = problem.residuals([problem.start])
    off = dict(zip(lines, np.abs(r), strict=False))
    assert max(off.values()) < 5.0, off
