"""The spread of steady lines over the ranges that sources note, beside steady states at their ends."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from support.commands import microvib

import microvib as mv
from microvib.analysis.spread import spread_sentence
from microvib.io.scenario_file import dump_scenario
from microvib.studies.rates import at_rate, full_case
from microvib.units import Si

HALVES = {"reducer.stiffness": 15.0, "motor.detent_torque": 1e-5, "array.inertia": 0.01}
"""Half widths of narrow ranges [SI], within which lines are straight."""
UNITS = {
    "reducer.stiffness": "N*m/rad",
    "motor.detent_torque": "N*m",
    "array.inertia": "kg*m^2",
}
LINES = ("drive_1", "drive_2", "full_step_1", "drive_1_minus_1")


def _ranged(scenario: mv.Scenario, halves: dict[str, float]) -> mv.Scenario:
    notes = {
        key: f"data sheet; range {scenario[key] - half!r} {UNITS[key]}"
        f" to {scenario[key] + half!r} {UNITS[key]}"
        for key, half in halves.items()
    }
    return scenario.with_sources(notes)


@pytest.fixture(scope="module")
def scenario() -> mv.Scenario:
    return _ranged(mv.load_scenario("state-1"), HALVES)


@pytest.fixture(scope="module")
def table(scenario: mv.Scenario):
    return mv.find_lines(scenario, start="steady")


def test_it_is_the_root_of_squares_of_what_the_ends_do(scenario, table):
    fine = scenario.with_sources({}).with_si({"solver.refinement": 4})
    squares = dict.fromkeys(LINES, 0.0)
    for key, half in HALVES.items():
        ends = [
            mv.find_lines(fine.with_si({key: scenario[key] + way}), start="steady")
            for way in (-half, half)
        ]
        for name in LINES:
            squares[name] += (0.5 * (ends[1][name].amplitude - ends[0][name].amplitude)) ** 2
    for name in LINES:
        assert table[name].spread == pytest.approx(math.sqrt(squares[name]), rel=0.01), name


def test_the_way_is_that_to_the_farther_end():
    given = mv.load_scenario("state-1")
    value, unit = given["reducer.stiffness"], UNITS["reducer.stiffness"]
    narrow, skew = (
        mv.find_lines(
            given.with_sources(
                {"reducer.stiffness": f"assumed; range {value - 5.0} {unit} to {value + up} {unit}"}
            ),
            start="steady",
        )["drive_1"].spread
        for up in (5.0, 20.0)
    )
    assert skew == pytest.approx(4.0 * narrow, rel=1e-6)


def test_it_is_said_whose_ranges_they_are(table):
    said = spread_sentence(table)
    assert "to first order" in said
    assert all(key in said for key in HALVES)
    assert np.isnan(mv.find_lines("state-1", start="steady")["drive_1"].spread)
    assert spread_sentence(mv.find_lines("state-1", start="steady")) == ""


def test_what_has_no_derivatives_says_why(scenario):
    remembers = scenario.with_({"friction.presliding": {"stiffness": "2000 N*m/rad"}})
    found = mv.find_lines(remembers, start="steady")
    assert np.isnan(found["drive_1"].spread)
    assert "not known to first order: friction with memory" in spread_sentence(found)


def test_a_range_that_cannot_be_read_does_not_stop_a_run(scenario):
    wrong = scenario.with_sources({"reducer.stiffness": "assumed; range 2 kg to 3 kg"})
    found = mv.find_lines(wrong, start="steady")
    assert found["drive_1"].amplitude > 0.0
    assert "sources.reducer.stiffness" in spread_sentence(found)


def test_rates_carry_it_too(scenario):
    rate = Si(math.radians(0.05))
    case = full_case(scenario, rate, 16)
    line = next(x for x in case.lines if x.name == "drive_1")
    alone = mv.find_lines(at_rate(scenario, rate, 16), start="steady")["drive_1"]
    assert line.spread == pytest.approx(alone.spread, rel=1e-6)


def test_a_run_shows_it_on_the_terminal_and_in_its_file(scenario, tmp_path: Path):
    (tmp_path / "s.yaml").write_text(dump_scenario(scenario), encoding="utf-8")
    out = tmp_path / "out"
    asked = ("run", "s.yaml", "--steady", "--lines-only", "--out", "out")
    shown = microvib(*asked, cwd=tmp_path)
    assert "± (ranges)" in shown.stdout
    with open(out / "lines.csv", newline="", encoding="utf-8") as file:
        rows = {row["line"]: row for row in csv.DictReader(file)}
    assert float(rows["drive_1"]["spread_n_m"]) > 0.0
