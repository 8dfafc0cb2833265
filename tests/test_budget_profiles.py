"""Budgets of profiles: a record that does not see every rate of a drive passes nothing."""

from pathlib import Path

import numpy as np
import pytest

import microvib as mv
from microvib.model.expected import is_made
from microvib.studies.budget.files import Requirement, Requirements

EXAMPLES = Path(__file__).parents[1] / "examples"
LATER = [{"rate": "0 deg/s", "hold": "100 s"}, {"rate": "0.2 deg/s"}]
STOPPED = [{"rate": "0.2 deg/s", "hold": "20 s"}, {"rate": "0 deg/s"}]
SECOND = {
    "drive": "driven",
    "interface": {
        "position": ["0.35 m", "-0.9 m", "-0.2 m"],
        "drive_axis": [0, -1, 0],
        "reference": [1, 0, 0],
    },
    "tracking": {"profile": LATER},
}
STOPS_LATER = {
    "profile": [{"rate": "0.06 deg/s", "hold": "200 s"}, {"rate": "0 deg/s", "ramp": "40 s"}]
}


UNSEEN = "lines at 0.2 deg/s, which tracking.profile holds"
CHANGES = "what the array does while its rate changes, from 200 s on"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"tracking.rate": None, "tracking.profile": LATER}, UNSEEN),
        ({"tracking.rate": None, "tracking.profile": STOPPED}, UNSEEN),
        ({"spacecraft.second_wing": SECOND}, UNSEEN),
        ({"tracking": STOPS_LATER}, CHANGES),
        ({"spacecraft.second_wing": SECOND | {"tracking": STOPS_LATER}}, CHANGES),
    ],
    ids=["later", "stopped", "second wing later", "stops later", "second wing stops later"],
)
def test_a_rate_that_the_record_does_not_see_is_not_judged(
    changes: dict[str, object], told: str
) -> None:
    scenario = mv.load_scenario(EXAMPLES / "spacecraft.yaml").with_(changes)
    wide = Requirement(metric="ape", axis="x", lowest="170 Hz", highest="185 Hz", limit="1 mrad")
    found = mv.pointing_budget(scenario, Requirements(requirements=(wide,)))
    (one,) = found.judged
    assert one.verdict == "not judged"
    assert any(told in why for why in one.why)


def test_lines_that_nothing_in_the_drive_makes_are_0_at_least() -> None:
    """In a short record what rings is read as lines of the clock, too."""
    short = {"record.settle": "2 s", "record.duration": "2 s", "record.sample_rate": "1024 Hz"}
    scenario = mv.load_scenario(EXAMPLES / "spacecraft.yaml").with_(short)
    one = mv.pointing_budget(scenario).contributions[0]
    least = 1.0 - one.relative_errors[0].max(axis=1)
    unmade = [k for k, name in enumerate(one.names) if not is_made(name, scenario)]
    assert unmade
    assert np.all(least[unmade] == 0.0)
    assert least[one.names.index("drive_1")] > 0.5
