"""The validation table: what it holds, and that its rows can fail."""

import csv
import io
import math
import re
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from microvib.cli.main import main
from microvib.errors import MicrovibError
from microvib.io.scenario_file import dump_scenario, load_scenario
from microvib.studies.sas import catalog_states
from microvib.validation import draws
from microvib.validation.assumptions import (
    Calibrated,
    amplitudes,
    assumed_scenario,
    draw_assumptions,
)
from microvib.validation.claims import claims_of, line_names
from microvib.validation.draws import extend_table, kept_draws
from microvib.validation.published import DEFAULT_TEST, load_test
from microvib.validation.study import check_near, checks_csv, validate

TEST = load_test(DEFAULT_TEST)
NAMES = line_names(TEST)
CLAIMS = claims_of(TEST)
BAR = 0.1


@pytest.fixture(scope="module")
def checks():
    return validate().checks


def find(checks, *words):
    return [c for c in checks if all(word in c.item + " " + c.source for word in words)]


def test_columns_of_the_table(checks):
    rows = list(csv.DictReader(io.StringIO(checks_csv(checks))))
    assert list(rows[0])[:8] == [
        "item",
        "source",
        "paper",
        "test",
        "ours",
        "error_percent",
        "bar",
        "holds",
    ]
    assert {row["holds"] for row in rows} <= {"yes", "no", ""}
    assert {row["status"] for row in rows} == {"calibrated", "assumed", "predicted", "computed"}
    assert all((row["over_spread"] != "") == (row["status"] == "predicted") for row in rows)
    assert all(row["holds"] != "" for row in rows if row["status"] in ("predicted", "computed"))


def test_state_1_calibrated_meets_the_tests_bins_and_amplitudes(checks):
    for c in (*find(checks, "Table 5"), *find(checks, "Table 6")):
        assert c.holds, c
        assert c.status == "calibrated"
    amplitudes = find(checks, "Table 6")
    assert len(amplitudes) == 8
    assert max(abs(c.error_percent) for c in amplitudes) < 5.0


def test_statements_on_other_states_are_predictions(checks):
    for words, count in (
        (("range of amplitudes",), 3),
        (("grows with the mode",), 2),
        (("grows with inertia",), 8),
    ):
        found = find(checks, *words)
        assert len(found) == count
        assert {c.status for c in found} == {"predicted"}
    assert all(c.holds for c in find(checks, "range of amplitudes"))


def test_the_kept_table_is_what_the_study_gives():
    rows = kept_draws(DEFAULT_TEST, TEST)
    assert len(rows) > 20
    assert [int(row["draw"]) for row in rows] == list(range(len(rows)))
    for row in rows:
        for key, value in asdict(draw_assumptions(TEST, int(row["draw"]))).items():
            assert float(row[key]) == pytest.approx(value, rel=1e-5)
        if row["refused"]:
            continue
        means = {
            n: np.array([*(float(row[f"state_{n}_{name}"]) for name in NAMES), math.nan])
            for n in range(1, 6)
        }
        for k, claim in enumerate(CLAIMS):
            if "largest" not in claim.item:
                assert claim.value(means) == pytest.approx(
                    float(row[f"value_{k}"]), rel=1e-4, abs=3e-7
                )
            assert claim.holds(float(row[f"value_{k}"])) == (row[f"holds_{k}"] == "1")
    found = Calibrated(*(float(rows[0][f.name]) for f in fields(Calibrated)))
    again = amplitudes(assumed_scenario(TEST, 4, draw_assumptions(TEST, 0), found), NAMES)[0]
    for k, name in enumerate(NAMES[1:], 1):  # noise hardly moves these
        assert again[k] == pytest.approx(float(rows[0][f"state_4_{name}"]), rel=0.02)


def test_draws_are_kept_and_continued(tmp_path, monkeypatch):
    made = []

    def row(test, number, seeds):
        made.append(number)
        return {
            "draw": number,
            "seeds": seeds,
            **asdict(draw_assumptions(TEST, number)),
            "refused": "not tried",
        }

    monkeypatch.setattr(draws, "row_of", row)
    extend_table(TEST, tmp_path / "draws.csv", 2, 1)
    steps = []
    rows = extend_table(
        TEST, tmp_path / "draws.csv", 4, 1, lambda done, total: steps.append((done, total))
    )
    assert steps == [(3, 5), (4, 5), (5, 5)]
    assert made == [0, 1, 2, 3, 4]
    assert [row["draw"] for row in rows] == ["0", "1", "2", "3", "4"]


def test_draws_are_announced_interrupted_and_continued(tmp_path, monkeypatch):
    stops = [10]

    def row(test, number, seeds):
        if number in stops:
            raise KeyboardInterrupt
        return {
            "draw": number,
            "seeds": seeds,
            **asdict(draw_assumptions(TEST, number)),
            "refused": "not tried",
        }

    def command():
        table = str(tmp_path / "draws.csv")
        return (
            CliRunner().invoke(main, ["statements", table, "--draws", "39", "--seeds", "12"]).stderr
        )

    monkeypatch.setattr(draws, "row_of", row)
    said = command()
    assert said.startswith("40 draws to compute, about 20 min. ")
    assert "after an interruption the same command continues" in said
    assert len((tmp_path / "draws.csv").read_text().splitlines()) == 1 + 10
    stops.clear()
    assert command().startswith("30 draws to compute, about 15 min. ")
    assert len((tmp_path / "draws.csv").read_text().splitlines()) == 1 + 40
    assert "to compute" not in command()


def test_halved_steps_change_no_line_by_a_per_cent(checks):
    (check,) = find(checks, "steps are halved")
    assert check.ours < 0.01


def test_a_row_that_misses_its_bar_does_not_hold():
    assert check_near("x", "s", 1.0 + 0.9 * BAR, BAR, "calibrated", paper=math.nan, test=1.0).holds
    assert not check_near(
        "x", "s", 1.0 + 1.1 * BAR, BAR, "calibrated", paper=math.nan, test=1.0
    ).holds


def test_the_papers_own_figures_are_those_of_its_tables(checks):
    lines = load_scenario("state-1").reference.lines
    models = sorted(line.model_amplitude for line in lines)
    assert models == [0.002198, 0.00399, 0.01249, 0.03661]  # Table 6
    assert sorted(c.paper for c in find(checks, "Table 6", "nearest-bin")) == models


OWN_TEST = """
title: A test of our own
citation: test report XY-12
states: [{scenario: PLACE/own.yaml}]
lines: {frequencies: page 3, amplitudes: page 4, within: 0.2}
larger: [{line: drive_1, than: drive_2, state: 1, source: page 5}]
peaks: [{state: 1, value: 1 N*m, factor: 1.5}]
"""
REFERENCE = {
    "source": "test report XY-12",
    "duration": "4 s",
    "sample_rate": "1024 Hz",
    "lines": [{"line": "drive_1", "frequency": "53.02 Hz", "amplitude": "45 mN*m"}],
}


@pytest.fixture
def own_test(tmp_path):
    scenario = load_scenario("state-1").with_(
        {
            "reference": REFERENCE,
            "record.settle": "2 s",
            "record.duration": "4 s",
            "record.sample_rate": "1024 Hz",
        }
    )
    (tmp_path / "own.yaml").write_text(dump_scenario(scenario))
    path = tmp_path / "test.yaml"
    path.write_text(OWN_TEST.replace("PLACE", str(tmp_path)))
    return path


def test_another_published_test_is_a_file(own_test):
    found = validate(str(own_test))
    by_item = {c.item: c for c in found.checks}
    line = by_item["drive_1 line, amplitude [N m]"]
    assert line.status == "predicted"  # its parameters were identified from other lines
    assert line.test == pytest.approx(0.045)
    assert line.ours == found.states[1].table["drive_1"].amplitude
    assert line.holds
    assert by_item["drive_1 over drive_2, state 1 [1]"].holds
    assert by_item["largest disturbance torque in the record [N m]"].holds is False
    assert not any(c.status == "assumed" for c in found.checks)
    done = CliRunner().invoke(main, ["validate", str(own_test)])
    assert done.exit_code == 0, done.output
    assert "drive_1 over drive_2, state 1 [1]" in done.output


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("state: 1, source", "state: 2, source", "there is no state 2"),
        ("larger:", "larget:", "larget: unknown key"),
        ("than: drive_2", "than: drive_99", "drive_99: is not a line of"),
        ("value: 1 N*m", "value: 1 Hz", r"peaks\.0\.value"),
        ("PLACE/own.yaml", "nowhere.yaml", "nowhere.yaml: there is no such file"),
    ],
)
def test_a_bad_published_test_is_one_sentence(own_test, old, new, why):
    text = own_test.read_text().replace("PLACE", str(own_test.parent))
    own_test.write_text(text.replace(old.replace("PLACE", str(own_test.parent)), new))
    with pytest.raises(MicrovibError, match=why):
        validate(str(own_test))


def test_the_file_that_the_page_prints_is_a_test(tmp_path):
    page = (Path(__file__).parents[1] / "docs" / "validation.md").read_text("utf-8")
    (printed,) = re.findall(r"```yaml\n# our-test.yaml\n(.*?)```", page, re.S)
    (tmp_path / "our-test.yaml").write_text(printed)
    test = load_test(str(tmp_path / "our-test.yaml"))
    assert len(claims_of(test)) == 4
    assert line_names(test)[:2] == ("array_mode_1", "drive_1")


def test_a_test_without_assumptions_has_nothing_to_draw(own_test, tmp_path):
    table = str(tmp_path / "draws.csv")
    done = CliRunner().invoke(main, ["statements", table, "--test", str(own_test)])
    assert done.exit_code == 1
    assert "nothing is assumed of this test" in done.output


def test_states_of_the_test_are_those_that_simulators_are_sized_for():
    stated = [(state.mode_frequency, state.inertia) for state in TEST.states]
    assert stated == [(state.frequency, state.inertia) for state in catalog_states()]
