"""Comparison and identification on evidence whose truth is known, because it was simulated."""

import json

import numpy as np
import pytest
from baseline import baseline

import microvib as mv
from microvib.app.comparison import write_comparison
from microvib.app.studies import fit_json, write_fit
from microvib.errors import MicrovibError
from microvib.io.recordings import write_recording
from microvib.signals.recording import Recording
from microvib.studies.compare import Figures, Side, _with_names_of, compare
from microvib.studies.evidence import read_evidence
from microvib.studies.identify import identify, parse_fit

TRUTH = {"array.rigid_inertia": 0.11, "reducer.stiffness": 10_500.0, "motor.friction.viscous": 0.022}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A made test: other parameters, another clock, noise, drift and mains on top; eight seconds after four."""
    scenario = baseline().with_si(
        {**TRUTH, "tracking.clock_ratio": 0.9962, "record.settle": 4.0, "record.duration": 8.0}
    )
    torque = mv.simulate(scenario, channels=("T_d",))["T_d"]
    t = np.arange(torque.size) / 4096
    random = np.random.default_rng(3)
    torque = torque + random.normal(0, 1e-3, t.size) + 1e-3 * np.sin(2 * np.pi * 50 * t) + 2e-3 * np.sin(0.5 * t)
    path = tmp_path_factory.mktemp("tests") / "made.uff"
    write_recording(Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, "made"), path)
    return path


@pytest.fixture(scope="module")
def start():
    return baseline().with_si({"record.settle": 4.0})


def test_evidence_of_a_recording(recording, start):
    evidence = read_evidence(str(recording), start)
    assert evidence.clock_ratio == pytest.approx(0.9962, abs=2e-6)
    assert evidence.duration == 8.0
    assert {("drive_1", "amplitude"), ("drive_2", "phase"), ("array_mode_1", "frequency")} <= {
        (o.line, o.form) for o in evidence.observations
    }


def test_identification_finds_the_truth(recording, start, tmp_path):
    evidence = read_evidence(str(recording), start)
    keys = [parse_fit(start, "array.rigid_inertia=0.08 kg*m^2:0.2 kg*m^2"), parse_fit(start, "reducer.stiffness=6000 N*m/rad:16000 N*m/rad"), parse_fit(start, "motor.friction.viscous=0.01 N*m*s/rad:0.04 N*m*s/rad")]  # fmt: skip
    fit = identify(start, [(evidence, {})], keys, starts=32, finishes=2, seed=2)
    for e in fit.estimates:
        assert e.identifiable, e
        assert abs(e.estimate - TRUTH[e.key]) < max(0.02 * TRUTH[e.key], 2 * e.standard_error), e
    assert np.diag(fit.correlation) == pytest.approx(1.0)
    assert fit.scenario.source_of("reducer.stiffness").startswith("identified from")
    files = write_fit(tmp_path / "fit", fit, overwrite=False)
    assert sorted(files) == ["fit.json", "report.html", "scenario.yaml"]
    written = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert set(written["parameters"]["reducer.stiffness"]) >= {"estimate", "standard_error", "unit"}
    again = mv.load_scenario(tmp_path / "fit" / "scenario.yaml")
    assert again.reducer.stiffness == fit.scenario.reducer.stiffness
    assert fit_json(fit)["status"].startswith("calibrated")


def test_a_range_of_ours_widens_and_a_wrong_mode_frequency_is_fitted_along(recording, start):
    """Damping starts at a tenth of the truth, with a range to two fifths of it; the scenario's mode lies 4 % off."""
    evidence = read_evidence(str(recording), start)
    wrong = start.with_si({**TRUTH, "reducer.damping": 0.5, "array.modes.0.frequency": 1.24})
    fit = identify(wrong, [(evidence, {})], [parse_fit(wrong, "reducer.damping")], starts=8, finishes=1)
    found = {e.key: e for e in fit.estimates}
    assert found["reducer.damping"].estimate == pytest.approx(5.0, rel=0.02)
    assert found["reducer.damping"].identifiable
    assert found["array.modes.0.frequency"].estimate == pytest.approx(1.19, rel=1e-3)
    assert "fitted along" in found["array.modes.0.frequency"].verdict


def test_a_parameter_without_effect_is_not_identifiable(recording, start):
    evidence = read_evidence(str(recording), start)
    keys = [parse_fit(start, "motor.friction.viscous"), parse_fit(start, "friction.stribeck_shape=0.9:1.1")]
    known = start.with_si({k: v for k, v in TRUTH.items() if "viscous" not in k} | {"friction.breakaway": 0.0247})
    fit = identify(known, [(evidence, {})], keys, starts=4, finishes=1)
    assert not next(e for e in fit.estimates if e.key.endswith("shape")).identifiable


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("reducer.stifness", "is no key of the scenario; allowed are motor.current"),
        ("driver.microsteps", "not a number"),
        ("reducer.stiffness=9000:3000", "needs a unit|below HIGH"),
        ("reducer.stiffness=9000 N*m/rad:3000 N*m/rad", "LOW must be below HIGH"),
        ("reducer.output_inertia", "starts at 0; give its range"),
    ],
)
def test_bad_fit_keys_are_one_sentence(start, text, complaint):
    with pytest.raises(MicrovibError, match=complaint):
        parse_fit(start, text)


def test_bad_evidence_is_one_sentence(start, tmp_path):
    with pytest.raises(MicrovibError, match="is no evidence; wanted is a recording"):
        read_evidence("nothing.xyz", start)
    (tmp_path / "lines.csv").write_text("line,amplitude_n_m\ndrive_1,many\n")
    with pytest.raises(MicrovibError, match="row 2: amplitude_n_m 'many' is no number"):
        read_evidence(str(tmp_path / "lines.csv"), start)


def test_comparison_of_a_recording_with_a_scenario(recording, tmp_path):
    a, b, rows = compare(str(recording), "state-1")
    by_name = {row.line: row for row in rows}
    assert b.clock_ratio == pytest.approx(0.9962, abs=2e-6)  # the scenario ran at the recording's clock
    assert by_name["drive_1"].a.frequency == pytest.approx(by_name["drive_1"].b.frequency, abs=1e-4)
    assert abs(by_name["drive_2"].error) > 0.05
    files = write_comparison(tmp_path / "out", a, b, rows, overwrite=False)
    assert sorted(files) == ["compare.csv", "report.html"]
    assert "relative_error" in (tmp_path / "out" / "compare.csv").read_text()


def test_comparison_of_the_papers_two_columns():
    _, _, rows = compare("paper-test", "paper-simulation")
    errors = {row.line: 100 * row.bin_error for row in rows}
    assert errors == pytest.approx(
        {"array_mode_1": 5.0, "drive_1": -15.72, "drive_2": 22.33, "drive_3": 21.44}, abs=0.01
    )


def test_unexpected_lines_are_matched_by_frequency_not_by_number():
    lines = {"other_1": Figures(100.0, 2.0), "other_2": Figures(300.0, 1.0)}
    a, b = (
        Side("a", "table", lines),
        Side("b", "table", {"other_1": Figures(300.001, 9.0), "other_2": Figures(50.0, 5.0)}),
    )
    assert _with_names_of(a, b).lines == {"other_2": b.lines["other_1"], "other_2_of_b": b.lines["other_2"]}


def test_comparison_of_a_scenario_with_itself():
    _, _, rows = compare("state-2", "state-2")
    assert all(row.bin_error == 0.0 for row in rows)


def test_a_recording_names_no_lines_of_a_drive_that_nobody_named(recording):
    from microvib.studies.analyse import analyse

    found = analyse(str(recording))
    assert {line.kind for line in found.table} == {"other"}
    assert {line.origin for line in found.table} == {""}
    assert found.clock_ratio is None
    assert "lines are not named, for no drive was; name it with --scenario" in found.recording.notes
    named = analyse(str(recording), scenario="state-1")
    largest = max(named.table, key=lambda line: line.amplitude_n_m if line.status == "ok" else 0.0)
    assert max(line.amplitude_n_m for line in found.table) == pytest.approx(largest.amplitude_n_m, rel=0.01)
    _, _, rows = compare(str(recording), str(recording))
    assert rows
    assert all(row.line.startswith("other_") and row.error == 0.0 for row in rows)


def test_a_recording_and_a_table_need_a_drive_that_names_the_lines(recording, tmp_path):
    (tmp_path / "lines.csv").write_text("line,frequency_hz,amplitude_n_m\ndrive_1,14.5,0.05\n")
    with pytest.raises(MicrovibError, match="name it with --scenario"):
        compare(str(recording), str(tmp_path / "lines.csv"))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"line,frequency_hz,amplitude_n_m\ndrive_1,14.5,inf\n", "row 2: amplitude_n_m is inf; a finite number"),
        (b"line,frequency_hz,amplitude_n_m\ndrive_1,fast,0.05\n", "row 2: frequency_hz 'fast' is no number"),
        (
            b"line,frequency_hz,amplitude_n_m\n" + 200 * b"drive_1,14.5,0.05\n" + b"\xb5",
            "cannot be read: is not a table as text",
        ),
    ],
)
def test_tables_of_lines_that_are_broken(tmp_path, start, content, complaint):
    path = tmp_path / "lines.csv"
    path.write_bytes(content)
    for read in (lambda: read_evidence(str(path), start), lambda: compare(str(path), str(path))):
        with pytest.raises(MicrovibError, match=complaint):
            read()
