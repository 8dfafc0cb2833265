"""The validation table: what it holds, and that its rows can fail."""

import csv
import io
import math
from dataclasses import asdict, fields

import numpy as np
import pytest
from click.testing import CliRunner

from microvib.cli.main import main
from microvib.io.scenario_file import load_scenario
from microvib.studies import statements
from microvib.studies.statements import (
    CENTRAL_ASSUMPTIONS,
    NAMES,
    STATEMENTS,
    Calibrated,
    amplitudes,
    draw_assumptions,
    extend_table,
    kept_draws,
    scenario_of,
)
from microvib.studies.validate import AMPLITUDE_BAR, _near, checks_csv, validate


@pytest.fixture(scope="module")
def checks():
    return validate()[0]


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
    rows = kept_draws()
    assert len(rows) > 20
    assert [int(row["draw"]) for row in rows] == list(range(len(rows)))
    for row in rows:
        for key, value in asdict(draw_assumptions(int(row["draw"]))).items():
            assert float(row[key]) == pytest.approx(value, rel=1e-5)
        if row["refused"]:
            continue
        means = {
            n: np.array([*(float(row[f"state_{n}_{name}"]) for name in NAMES), math.nan])
            for n in range(1, 6)
        }
        for k, statement in enumerate(STATEMENTS):
            if "largest" not in statement.item:
                assert statement.value(means) == pytest.approx(
                    float(row[f"value_{k}"]), rel=1e-4, abs=3e-7
                )
            assert statement.holds(float(row[f"value_{k}"])) == (row[f"holds_{k}"] == "1")
    found = Calibrated(*(float(rows[0][f.name]) for f in fields(Calibrated)))
    again = amplitudes(scenario_of(4, CENTRAL_ASSUMPTIONS, found))[0]
    for k, name in enumerate(NAMES[1:], 1):  # noise hardly moves these
        assert again[k] == pytest.approx(float(rows[0][f"state_4_{name}"]), rel=0.02)


def test_draws_are_kept_and_continued(tmp_path, monkeypatch):
    made = []

    def row(number, seeds, start):
        made.append(number)
        return {
            "draw": number,
            "seeds": seeds,
            **asdict(draw_assumptions(number)),
            "refused": "not tried",
        }

    monkeypatch.setattr(statements, "row_of", row)
    extend_table(tmp_path / "draws.csv", 2, 1)
    steps = []
    rows = extend_table(
        tmp_path / "draws.csv", 4, 1, lambda done, total: steps.append((done, total))
    )
    assert steps == [(3, 5), (4, 5), (5, 5)]
    assert made == [0, 1, 2, 3, 4]
    assert [row["draw"] for row in rows] == ["0", "1", "2", "3", "4"]


def test_draws_are_announced_interrupted_and_continued(tmp_path, monkeypatch):
    stops = [10]

    def row(number, seeds, start):
        if number in stops:
            raise KeyboardInterrupt
        return {
            "draw": number,
            "seeds": seeds,
            **asdict(draw_assumptions(number)),
            "refused": "not tried",
        }

    def command():
        table = str(tmp_path / "draws.csv")
        return (
            CliRunner().invoke(main, ["statements", table, "--draws", "39", "--seeds", "12"]).stderr
        )

    monkeypatch.setattr(statements, "row_of", row)
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
    assert _near(
        "x", "s", 1.0 + 0.9 * AMPLITUDE_BAR, AMPLITUDE_BAR, "calibrated", paper=math.nan, test=1.0
    ).holds
    assert not _near(
        "x", "s", 1.0 + 1.1 * AMPLITUDE_BAR, AMPLITUDE_BAR, "calibrated", paper=math.nan, test=1.0
    ).holds


def test_the_papers_own_figures_are_those_of_its_tables(checks):
    lines = load_scenario("state-1").reference.lines
    models = sorted(line.model_amplitude for line in lines)
    assert models == [0.002198, 0.00399, 0.01249, 0.03661]  # Table 6
    assert sorted(c.paper for c in find(checks, "Table 6", "nearest-bin")) == models
