"""A data sheet on the page: the same entries, sentences, assumptions and ranking as on the command line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.server import SHORT, items, result

import microvib as mv
from microvib.io.data_sheet import DataSheet
from microvib.io.new_scenario import sheet_text
from microvib.io.questions import QUESTIONS
from microvib.io.scenario_file import dump_scenario
from microvib.reports.outcome import page_answer
from microvib.reports.sensitivity import ranking_outcome
from microvib.studies.sensitivity import sensitivities

STATED = {"holding_torque": "0.5 N*m", "ratio": "100", "detent": "4 percent"}


def asked(client, **entries: str) -> dict:
    answer = client.post("/api/datasheet", json={"entries": entries})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_form_and_command_line_ask_for_all_that_can_be_said(client):
    fields = client.get("/api/datasheet").json()
    assert {f["key"] for f in fields} | {"detent_torque"} == set(
        DataSheet.model_fields
    )  # which the question of detent takes
    assert asked(client, holding_torque="0.5 N*m", detent="20 mN*m")["errors"] == []
    assert [f["key"] for f in fields] == list(QUESTIONS)
    torque, phases = fields[:2]
    assert (torque["unit"], torque["example"]) == ("N*m", "0.5 N*m")
    assert phases["choices"] == ["2", "3", "5"]
    for field in fields:  # an example can be typed as it stands
        assert (
            not field["example"]
            or asked(client, **{field["key"]: field["example"]})["errors"] == []
        )


def test_the_file_is_that_of_the_command_line(client):
    found = asked(client, **STATED)
    text, missing = sheet_text(STATED)
    assert found["text"] == text
    assert [(x["key"], x["value"]) for x in found["assumed"]] == [
        (key, entry.text) for key, entry in missing.items()
    ]
    resistance = next(x for x in found["assumed"] if x["key"] == "motor.winding_resistance")
    assert resistance["why"].endswith("range 2 ohm to 20 ohm")
    shown = client.post("/api/scenario", json={"text": found["text"]}).json()
    assert shown["errors"] == []
    assert shown["sources"]["motor.winding_resistance"].startswith("assumed: ")
    assert len(asked(client)["assumed"]) > len(found["assumed"])  # nothing said, more assumed


@pytest.mark.parametrize(
    ("entries", "told"),
    [
        ({"holding_torque": "0.5 kg"}, {"holding_torque": "wrong dimension"}),
        (
            {"holding_torque": "", "ratio": "0"},
            {"holding_torque": "''", "ratio": "at least 1 and at most 1000"},
        ),
        ({"phases": "4"}, {"phases": "write 2, 3 or 5"}),
        ({"gear": "size 15"}, {"gear": "sizes are 14, 17, 20, 25, 32"}),
        ({"phases_on": "3"}, {"phases_on": "3 is not allowed with 2 phases"}),
        ({"step_angle": "1.7 deg", "ratio": "3"}, {"step_angle": "a whole number of rotor teeth"}),
        (
            {"step_angle": "1e-320 deg", "ratio": "100"},
            {"step_angle": "a whole number of rotor teeth"},
        ),
        ({"colour": "red"}, {"colour": "unknown key"}),
    ],
)
def test_each_wrong_entry_gets_a_sentence(client, entries, told):
    found = asked(client, **entries)
    assert found["text"] is None
    assert {e["key"] for e in found["errors"]} == set(told)
    for error in found["errors"]:
        assert told[error["key"]] in error["error"]
        assert "\n" not in error["error"]


def test_a_request_that_is_too_long_is_refused(client):
    assert client.post("/api/datasheet", json={"entries": {"gear": "9" * 201}}).status_code == 422
    assert (
        client.post(
            "/api/datasheet", json={"entries": {f"k{k}": "1" for k in range(31)}}
        ).status_code
        == 422
    )


def test_the_ranking_is_that_of_the_command_line(client):
    drive = mv.new_scenario(**STATED).with_(SHORT)
    keys = ("motor.winding_resistance", "reducer.stiffness", "driver.microsteps")
    drive = drive.with_sources({key: drive.source_of(key) for key in keys})
    found = result(
        client,
        client.post("/api/sensitivity", json={"scenario": {"text": dump_scenario(drive)}}).json()[
            "id"
        ],
    )
    expected = sensitivities(drive)
    assert found == page_answer(ranking_outcome(expected, drive))
    first, *each, left_out = found["parts"]
    lines = [(x["line"], x["amplitude_n_m"]) for x in items(first, "table")[0]["rows"]]
    assert lines == [(x.line, f"{1e3 * x.amplitude:#.4g}".rstrip(".")) for x in expected]
    for part, line in zip(each, expected, strict=True):
        rows = items(part, "table")[0]["rows"]
        assert [row["key"] for row in rows] == [e.key for e in line.effects]
        ends = [
            [math.nan if x == "unknown" else 1e-3 * float(x) for x in (row["at_low_n_m"], row["at_high_n_m"])]
            for row in rows
        ]  # fmt: skip
        np.testing.assert_allclose(ends, [e.amplitudes for e in line.effects], rtol=5.1e-4)
    assert np.isfinite(ends).any()
    shown = {row["key"]: row["range"] for row in items(each[0], "table")[0]["rows"]}
    quantity = next(quantity for key, _, quantity in drive.entries() if key == keys[0])
    assert shown[keys[0]] == f"{quantity.show(2.0)} to {quantity.show(20.0)}"
    assert items(left_out, "table")[0]["rows"] == [
        {"key": "driver.microsteps", "reason": "not a continuous value"}
    ]


def test_a_scenario_without_ranges_is_not_ranked(client):
    answer = client.post("/api/sensitivity", json={"scenario": {"base": "state-1"}})
    assert answer.status_code == 422
    assert answer.json()["error"].startswith("sources: no value of this scenario has a range")
