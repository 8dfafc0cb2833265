"""A quieter drive on the page: levers and lines to choose from, the library's answer, and no file of a request."""

from __future__ import annotations

import pytest
from support.server import SHORT, items, result, spec

import microvib as mv
from microvib.io.scenario_file import scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.studies.quiet.lever_options import NAMED, named_levers, parse_levers
from microvib.studies.quiet.study import quiet

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
SMALL = {"scenario": WOUND_UP, "levers": ["ramp"], "cases": 8, "effort": 4}


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


@pytest.mark.long
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


@pytest.mark.parametrize(
    ("more", "key", "words"),
    [
        ({"objective": "limit.csv"}, "objective", "the page opens no files"),
        ({"objective": "/etc/hosts.csv "}, "objective", "the page opens no files"),
        ({"objective": "drive_one"}, "objective", "is not a line of this drive"),
        ({"objective": "5:1 Hz"}, "objective", "is not a band"),
        ({"requirement": "requirement.yaml"}, "requirement", "not"),
        ({"study": "study.yaml"}, "study", "not"),
        ({"check": "table.csv"}, "check", "not"),
        ({"keep": "figures.jsonl"}, "keep", "not"),
        ({"levers": []}, "levers", ""),
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
