"""A quieter drive on the page: levers and lines to choose from, the library's answer, and no file of a request."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from support.server import SHORT, items, result, spec, wait

import microvib as mv
from microvib.io.scenario_file import scenario_of
from microvib.io.tables import rows_csv
from microvib.io.yaml_text import parse_yaml
from microvib.reports.quiet import quiet_outcome
from microvib.studies.quiet.lever_options import NAMED, named_levers, parse_levers
from microvib.studies.quiet.study import Constraints, quiet

EXAMPLES = Path(__file__).parents[2] / "examples"
DRIVE = {"base": "state-1", "changes": SHORT}
PULSE = {
    "driver.drive": "pulse",
    "driver.on_time": "5 ms",
    "driver.diode_voltage": "0.7 V",
    "driver.supply_voltage": "28 V",
    "driver.microsteps": "1",
    "driver.proportional_gain": "0 V/A",
    "driver.integral_gain": "0 V/(A*s)",
}
WOUND_UP = {"base": "state-1", "changes": {"record.settle": "2.5 s", "record.duration": "1.5 s"}}
REQUIREMENT = "requirements: [{name: P-1, metric: rpe, window: 10 ms, limit: 0.02 urad}]"
TABLE = rows_csv(
    ["i_a", "i_b"],
    [[math.cos(math.pi * k / 32), math.sin(math.pi * k / 32)] for k in range(64)],
)
HARMONIC = "order,amplitude_deg,phase_deg\n4,2.5,0\n"
SMALL = {"scenario": WOUND_UP, "levers": ["ramp"], "cases": 8, "effort": 4}
SETTLED = {"base": "state-1", "changes": {**SHORT, "record.settle": "6 s"}}
JUDGED = {"scenario": SETTLED, "check": HARMONIC, "cases": 8}


def choices(client, scenario: dict) -> dict:
    answer = client.post("/api/quiet/choices", json=scenario)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_scenario_has_levers_with_their_usual_ranges(client):
    found = choices(client, DRIVE)
    spans = {lever["name"]: lever["span"] for lever in found["levers"]}
    assert spans == {
        "ramp": "0:1",
        "shape": "0.943159:17.92 ms",
        "table": "4",
        "microsteps": "16,32,64",
        "rate": "0.054:0.066 deg/s",
        "current": "0.24:0.6 A",
        "gains": "0.05:2",
        "damping": "0.5:5 N*m*s/rad",
    }
    assert {"drive_1", "full_step_1"} <= set(found["lines"])


@pytest.mark.parametrize(
    ("changes", "missing", "without_range"),
    [
        ({}, {"wings", "compensation"}, set()),
        (
            {
                "driver.drive": "voltage",
                "driver.proportional_gain": "0 V/A",
                "driver.integral_gain": "0 V/(A*s)",
            },
            {"wings", "compensation", "table", "gains"},
            set(),
        ),
        ({"reducer.damping": "0 N*m*s/rad"}, {"wings", "compensation"}, {"damping"}),
        ({"motor.detent_torque": "0 N*m"}, {"wings", "compensation"}, {"table"}),
    ],
)
def test_a_usual_range_is_that_of_the_name_alone(changes, missing, without_range):
    """Written out it means the same as the name; where there is none, the name alone is refused."""
    scenario = mv.load_scenario("state-1", changes)
    found = {lever.name: lever for lever in named_levers(scenario)}
    assert set(NAMED) - set(found) == missing
    for name, lever in found.items():
        if name in without_range:
            assert not lever.span
            with pytest.raises(mv.OptionError):
                parse_levers([name], scenario)
            continue
        [alone], [written] = (
            parse_levers([name], scenario),
            parse_levers([f"{name}={lever.span}"], scenario),
        )
        assert written.text == alone.text


@pytest.mark.release
def test_a_quieter_drive_is_that_of_the_library(client):
    answer = client.post(
        "/api/quiet", json={**SMALL, "levers": ["ramp", "table"], "limit": "1 N*m"}
    )
    assert answer.status_code == 202, answer.text
    told = result(client, answer.json()["id"])
    drive = mv.load_scenario("state-1", WOUND_UP["changes"])
    expected = quiet(drive, "rms", ["ramp", "table"], cases=8, effort=4)
    [designs] = items(told["parts"][0], "table")
    row = next(row for row in designs["rows"] if row["design"] == "quieter")
    assert float(row["p95"]) == pytest.approx(1e3 * expected.after.p95, rel=1e-3)
    assert told["verdict"] == "not judged"  # eight cases bound no quantile
    [picture] = items(told["parts"][0], "picture")
    assert picture["source"].startswith("data:image/svg+xml;base64,")
    assert {"scenario.yaml", "table.csv", "lines.csv"} <= set(told["files"])
    changed = {**WOUND_UP["changes"], **told["scenario_changes"]}
    assert set(told["scenario_changes"]) == {"driver.microstep_ramp", "driver.table"}
    view = client.post("/api/scenario", json={"base": "state-1", "changes": changed}).json()
    assert view["errors"] == []
    for text in (view["yaml"], told["files"]["scenario.yaml"]):
        assert scenario_of(parse_yaml(text, "x"), "x").driver == expected.quieter.driver


CURVE = "frequency_hz,t_mnm\n1,100\n40,100\n40,20\n500,20\n"
SPREAD = "scenario: any\nvary: {motor.detent_torque: {distribution: uniform, within: 10 percent}}"
CONSTRAINED = {"margin": "0.5", "factor": ["friction=1.5", "total=1.2"], "lag": "1 deg"}


@pytest.mark.long
def test_a_verdict_by_a_curve_over_a_study_is_that_of_the_command(client, tmp_path):
    asked = {**JUDGED, **CONSTRAINED, "objective": CURVE, "study": SPREAD}
    answer = client.post("/api/quiet", json=asked)
    assert answer.status_code == 202, answer.text
    told = result(client, answer.json()["id"])
    sent = (("curve.csv", CURVE), ("study.yaml", SPREAD), ("table.csv", HARMONIC))
    for name, text in sent:
        (tmp_path / name).write_text(text)
    expected = quiet(
        mv.load_scenario("state-1", SETTLED["changes"]),
        str(tmp_path / "curve.csv"),
        check=tmp_path / "table.csv",
        study=tmp_path / "study.yaml",
        constraints=Constraints.of_texts("0.5", CONSTRAINED["factor"], "1 deg"),
        cases=8,
    )
    outcome = quiet_outcome(expected)
    assert [fact["value"] for fact in told["facts"]] == [fact.value for fact in outcome.facts]
    assert "lines over the limit curve." in told["summary"]
    assert told["verdict"] == outcome.verdict == "fail"
    assert "% of the limit" in told["facts"][0]["value"]
    assert "is assumed" not in str(told["parts"][0])
    [cases] = items(told["parts"][-1], "pairs")
    assert "motor.detent_torque" in str(cases)


@pytest.mark.long
def test_a_margin_that_nothing_keeps_ends_a_search(client):
    answer = client.post("/api/quiet", json={**SMALL, "margin": "1e6"})
    job = wait(client, answer.json()["id"])
    assert job["state"] == "failed"
    assert "torque margin" in job["error"]
    assert "below 1000000.00" in job["error"]


@pytest.mark.long
def test_requirements_are_judged_where_there_is_a_line_of_sight(client):
    craft = (EXAMPLES / "spacecraft.yaml").read_text()
    changes = {"record.settle": "30 s", "record.duration": "16 s"}
    scenario = {"text": craft, "changes": changes}
    assert choices(client, scenario)["line_of_sight"]
    assert not choices(client, DRIVE)["line_of_sight"]
    asked = {**JUDGED, "scenario": scenario, "requirement": REQUIREMENT}
    answer = client.post("/api/quiet", json=asked)
    assert answer.status_code == 202, answer.text
    told = result(client, answer.json()["id"])
    assert "requirement nearest to its limit, of P-1" in told["summary"]
    # Of the nominal drive; drawn ones, with less damping, still ring in such a record.
    assert "% of the limit after" in str(told["parts"])
    lacking = client.post(
        "/api/quiet", json={**asked, "requirement": "requirements: [{metric: rpe}]"}
    )
    assert lacking.status_code == 422
    assert lacking.json()["key"] == "requirement"


@pytest.mark.long
def test_a_table_that_was_sent_is_judged_and_goes_into_the_form(client):
    asked = {**JUDGED, "objective": "full_step_1", "margin": "1e6", "limit": "1 N*m"}
    answer = client.post("/api/quiet", json=asked)
    assert answer.status_code == 202, answer.text
    told = result(client, answer.json()["id"])
    assert not told["searched"]
    assert told["verdict"] == "fail"
    assert "Not allowed: torque margin" in str(told["parts"][0])
    [designs] = items(told["parts"][0], "table")
    before, after = (float(row["nominal"]) for row in designs["rows"])
    assert after < 0.5 * before
    assert set(told["scenario_changes"]) == {"driver.table"}
    changed = {**SETTLED["changes"], **told["scenario_changes"]}
    view = client.post("/api/scenario", json={"base": "state-1", "changes": changed}).json()
    assert view["errors"] == []
    driver = scenario_of(parse_yaml(told["files"]["scenario.yaml"], "x"), "x").driver
    assert scenario_of(parse_yaml(view["yaml"], "x"), "x").driver == driver
    assert driver.table.harmonics[0].order == 4


@pytest.mark.parametrize(
    ("more", "key", "words"),
    [
        ({"objective": "limit.csv"}, "objective", "the page opens no files"),
        ({"objective": "curve.csv"}, "objective", "the page opens no files"),
        ({"objective": "frequency_hz,t_mnm\n1,x"}, "objective", "curve.csv, row 2: t_mnm"),
        ({"objective": "frequency_hz,fx_n\n1,1\n2,2"}, "objective", "torque"),
        ({"objective": "/etc/hosts.csv "}, "objective", "the page opens no files"),
        ({"objective": "drive_one"}, "objective", "is not a line of this drive"),
        ({"objective": "5:1 Hz"}, "objective", "is not a band"),
        ({"requirement": "requirement.yaml"}, "requirement", ""),
        (
            {"requirement": REQUIREMENT},
            "requirement",
            "on a line of sight, which this scenario has not",
        ),
        ({"study": "study.yaml"}, "study", ""),
        (
            {"study": "scenario: x\nvary: {motor.nothing: [1, 2]}"},
            "study",
            "study.yaml: vary.motor.nothing",
        ),
        (
            {"study": "scenario: x\nvary: {array.from: [/etc/passwd]}"},
            "study",
            "the page opens no files",
        ),
        ({"study": "scenario: x\nvary: {driver.table.from: [/etc/passwd]}"}, "study", ""),
        (
            {"study": "scenario: x\nlimit: /etc/hosts.csv\nvary: {motor.current: [0.6 A]}"},
            "study",
            "the page opens no files",
        ),
        (
            {"study": "scenario: x\nvary: {motor.current: [0.6 A]}", "levers": ["current"]},
            "lever",
            "sets motor.current, which the cases vary",
        ),
        (
            {
                "study": f"scenario: x\nvary: {{motor.current: [{', '.join(['0.6 A'] * 49)}], motor.detent_torque: {{from: 1 mN*m, to: 2 mN*m, count: 100}}}}"
            },
            "study",
            "4900 cases; at most 2000",
        ),
        ({"check": "table.csv", "levers": []}, "check", "table.csv"),
        ({"check": "/etc/passwd", "levers": []}, "check", "table.csv: has no rows"),
        ({"check": "i_a,i_b\n1,0\n0,x", "levers": []}, "check", "table.csv, row 3: i_b"),
        ({"check": "i_a,i_b\n1,0\n0,1", "levers": []}, "check", "2 rows"),
        ({"check": TABLE, "levers": [], "table_rows": 63}, "table_rows", "64 rows"),
        ({"check": TABLE}, "lever", "does not go with check"),
        ({"check": TABLE, "levers": [], "bits": 8}, "bits", "does not go with check"),
        ({"margin": "a little"}, "margin", "a little"),
        ({"factor": ["friction"]}, "factor", "write NAME=NUMBER"),
        ({"factor": ["friction=0.5"]}, "factor", "friction"),
        ({"factor": ["fricton=2"]}, "factor", "friction"),
        ({"lag": "1 mm"}, "lag", "wrong dimension"),
        ({"table_rows": 16385}, "table_rows", "16384"),
        ({"keep": "figures.jsonl"}, "keep", "not"),
        ({"levers": []}, "lever", "is missing"),
        ({"levers": ["wings"]}, "lever", "needs spacecraft.second_wing.stagger"),
        ({"levers": ["table=/etc/passwd"]}, "lever", "whole numbers from 1 on"),
        ({"levers": ["array.from=1:2"]}, "lever", "is none"),
        ({"levers": ["current=0.3:0.6 V"]}, "lever", "current=0.3:0.6 V"),
        ({"levers": ["current=nan:0.6 A"]}, "lever", ""),
        ({"bits": 1}, "bits", ""),
        ({"cases": 401}, "cases", "400"),
        ({"effort": 1001}, "effort", "1000"),
        ({"effort": None}, "effort", ""),
        ({"limit": "3 N"}, "limit", "wrong dimension"),
        ({"scenario": spec(motor__current="1 V")}, "motor.current", ""),
        (
            {"scenario": spec(record__duration="4000 s")},
            "record.duration",
            "more than the page keeps",
        ),
        (
            {"scenario": spec(**PULSE)},
            "driver.drive",
            "is pulse",
        ),
    ],
)
def test_a_search_that_cannot_be(client, more, key, words):
    answer = client.post("/api/quiet", json={**SMALL, **more})
    assert answer.status_code == 422, answer.text
    assert answer.json()["key"] == key, answer.text
    assert words in answer.json()["error"]
    assert "CSV" not in answer.json()["error"]


def test_a_drive_without_a_rate_has_no_choices(client):
    profile = {"base": "state-1", "changes": {"tracking": "{profile: [{rate: 0.06 deg/s}]}"}}
    for path, asked in (("quiet/choices", profile), ("quiet", {**SMALL, "scenario": profile})):
        answer = client.post(f"/api/{path}", json=asked)
        assert answer.status_code == 422
        assert answer.json()["key"] == "tracking.profile"
