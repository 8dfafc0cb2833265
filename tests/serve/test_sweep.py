"""Lines over one value: those of the scenarios at its points, and no value that cannot be."""

from __future__ import annotations

import pytest
from support.server import SHORT, result
from support.tiers import sweep

import microvib as mv
from microvib.analysis.lines import steady_lines
from microvib.model.linear import linear_lines

DRIVE = {"base": "state-1", "changes": SHORT}
SWEEP = {"scenario": DRIVE, "key": "motor.current", "from": "0.3 A", "to": "0.6 A", "count": 3}


def amplitudes(told: dict, line: str) -> list[float]:
    return [
        next(x["amplitude"] for x in point["lines"] if x["line"] == line)
        for point in told["points"]
    ]


@pytest.mark.long
@pytest.mark.parametrize("linear", sweep([True, False], True))
def test_a_sweep_has_the_lines_of_each_point(client, linear):
    answer = client.post("/api/sweeps", json={**SWEEP, "linear": linear})
    assert answer.status_code == 202, answer.text
    told = result(client, answer.json()["id"])
    assert [point["value"] for point in told["points"]] == ["0.3 A", "0.45 A", "0.6 A"]
    assert told["values"] == [0.3, 0.45, 0.6]
    assert told["unit"] == "A"
    for value, found in zip(("0.3 A", "0.45 A", "0.6 A"), amplitudes(told, "drive_1"), strict=True):
        scenario = mv.load_scenario("state-1", {**SHORT, "motor.current": value})
        if linear:
            expected = abs(linear_lines(scenario)[0].amplitude)
        else:
            expected = steady_lines(scenario).lines["drive_1"].amplitude
        assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("more", "key", "words"),
    [
        ({"from": "0.3 V"}, "from", "wrong dimension"),
        ({"to": "much"}, "to", "much"),
        ({"count": 1}, "count", "2"),
        ({"count": 201}, "count", "200"),
        ({"key": "motor.wheels"}, "key", "is not a key"),
        ({"key": "driver.drive"}, "key", "is not a physical quantity"),
        ({"key": "array.from", "from": "/etc/passwd"}, "key", "opens no files"),
        ({"from": "-1 A"}, "key", "motor.current"),
    ],
)
def test_a_sweep_that_cannot_be(client, more, key, words):
    answer = client.post("/api/sweeps", json={**SWEEP, **more})
    assert answer.status_code == 422, answer.text
    assert answer.json()["key"] == key, answer.text
    assert words in answer.json()["error"]
