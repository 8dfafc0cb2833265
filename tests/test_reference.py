"""Reference lines of a scenario: shown beside a run, compared, and taken as evidence."""

from __future__ import annotations

import math

import pytest
from support.run_reports import run_text

import microvib as mv
from microvib.analysis.reference import compare_with_reference, comparison_worth
from microvib.analysis.run import run_scenario
from microvib.errors import MicrovibError, ScenarioError
from microvib.io.scenario_file import dump_scenario
from microvib.io.sources import open_source
from microvib.studies.evidence import evidence_of

SHORT = {"record.settle": "5 s", "record.duration": "4 s", "record.sample_rate": "1024 Hz"}
OWN = {
    "source": "test report XY-12",
    "duration": "8 s",
    "sample_rate": "1024 Hz",
    "lines": [{"line": "drive_1", "frequency": "53.0 Hz", "amplitude": "40 mN*m"}],
}


@pytest.fixture(scope="module")
def scenario() -> mv.Scenario:
    return mv.load_scenario("state-1").with_(SHORT)


@pytest.fixture(scope="module")
def table(scenario: mv.Scenario):
    return mv.find_lines(mv.simulate(scenario, channels=("T_d",)))


def test_lines_of_a_reference_stand_beside_a_run(scenario, table) -> None:
    rows = {row.line: row for row in compare_with_reference(scenario, table)}
    assert list(rows) == ["array_mode_1", "drive_1", "drive_2", "drive_3"]
    one = rows["drive_1"]
    assert (one.measured_frequency, one.measured_amplitude, one.model_amplitude) == (
        53.0,
        0.04344,
        0.03661,
    )
    assert one.run_amplitude == table["drive_1"].bin_amplitude
    assert one.run_error == pytest.approx(one.run_amplitude / 0.04344 - 1.0)


def test_a_reference_of_the_users_own_is_compared_by_fitted_lines(scenario, table) -> None:
    own = scenario.with_({"reference": OWN})
    (row,) = compare_with_reference(own, table)
    assert row.run_amplitude == table["drive_1"].amplitude
    assert row.measured_amplitude == pytest.approx(0.04)
    assert math.isnan(row.model_amplitude)
    assert mv.load_scenario("state-2").reference is None


def test_a_run_at_another_rate_has_no_reference_line(scenario) -> None:
    other = scenario.with_({"tracking.rate": "0.08 deg/s"})
    table = mv.find_lines(mv.simulate(other, channels=("T_d",)))
    assert [row.line for row in compare_with_reference(other, table)] == ["array_mode_1"]


def test_what_a_comparison_is_worth_follows_from_the_sources(scenario) -> None:
    state = mv.load_scenario("state-1")
    assert comparison_worth(state).startswith("calibrated, not predicted")
    assert "changed by the user" in comparison_worth(scenario.with_({"motor.current": "0.5 A"}))
    elsewhere = state.model_copy(update={"reference": state.with_({"reference": OWN}).reference})
    assert comparison_worth(elsewhere).startswith("assumed parameters")


def test_a_run_tells_its_reference_and_a_scenario_without_one_none(scenario) -> None:
    told = run_text(run_scenario(scenario, lines_only=True))
    assert (
        "Measured, and by the publication's own model: Appl. Sci. 2021, 11, 9076, Tables 5 and 6."
        in told
    )
    assert "measured" not in run_text(
        run_scenario(scenario.with_({"reference": None}), lines_only=True)
    )


def test_a_reference_is_kept_in_the_file_and_is_no_parameter(scenario) -> None:
    text = dump_scenario(scenario)
    assert "Tables 5 and 6" in text
    assert not any(key.startswith("reference") for key, _, _ in scenario.entries())
    assert "reference" not in scenario.with_({"reference": OWN}).sources


def test_a_reference_is_evidence(scenario) -> None:
    own = scenario.with_({"reference": {**OWN, "clock_ratio": 0.994}})
    source = open_source("state-1:measured")
    found = evidence_of(source, scenario)
    assert [(o.line, o.form) for o in found.observations] == [
        *((line, "nearest_bin") for line in ("array_mode_1", "drive_1", "drive_2", "drive_3")),
        ("array_mode_1", "frequency"),
    ]
    mode = found.observations[-1]
    assert (mode.value, mode.uncertainty) == (1.1875, 0.03125 / 3.0)
    assert found.observations[0].uncertainty == pytest.approx(0.5e-4 / math.sqrt(3.0))
    assert (found.duration, found.sample_rate, found.clock_ratio) == (16.0, 4096.0, 1.0)
    (line,) = evidence_of(type(source)("own", own, "measured"), own).observations
    assert (line.form, line.value, line.uncertainty) == ("amplitude", 0.04, 0.0004)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("state-2:measured", "state-2:measured: the scenario has no reference lines"),
        ("nothing:measured", "nothing: there is no such file"),
        ("state-1:test", "state-1:test: is not known"),
    ],
)
def test_what_is_no_reference_is_one_sentence(name: str, why: str) -> None:
    with pytest.raises(MicrovibError, match=why):
        open_source(name)


def test_a_reference_without_a_models_lines_has_no_column_of_it(tmp_path, scenario) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(dump_scenario(scenario.with_({"reference": OWN})))
    assert open_source(f"{path}:measured").table["drive_1"].amplitude == pytest.approx(0.04)
    with pytest.raises(MicrovibError, match="no model's amplitudes"):
        open_source(f"{path}:model")


def test_a_bad_reference_is_one_sentence(scenario) -> None:
    with pytest.raises(ScenarioError, match=r"reference\.lines\.0\.amplitude"):
        scenario.with_({"reference": {**OWN, "lines": [{**OWN["lines"][0], "amplitude": "4 Hz"}]}})
