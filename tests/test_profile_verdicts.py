"""Verdicts on a record at one rate of a profile that holds others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.start import record_gap, start_sentence
from microvib.studies.profiles.manoeuvre import Manoeuvre
from microvib.studies.profiles.plan import unknown_angle_reason
from microvib.studies.rates import RECORD_GAP, RateCase, full_case, linear_case
from microvib.units import Si

TRACKING = {"rate": "0.06 deg/s"}
RESTS_FIRST = [{"rate": "0 deg/s", "hold": "50 s"}, TRACKING]
SHORT = {"record.settle": "4 s", "record.duration": "2 s", "record.sample_rate": "512 Hz"}
"""A record in which lines are looked for quickly; where it begins, a leg of 50 s has not ended."""


def under(scenario: mv.Scenario, profile: list[dict[str, str]], **record: str) -> mv.Scenario:
    changes: dict[str, Any] = {"tracking": {"profile": profile}} | SHORT
    return scenario.with_(changes | {f"record.{key}": value for key, value in record.items()})


def gap(scenario: mv.Scenario, **how: bool) -> str:
    found = record_gap(scenario, 128.0, **how)
    return "" if found is None else found.why


def test_a_record_before_the_array_turns_passes_no_limit(state_1):
    rests = under(state_1, RESTS_FIRST)
    table = mv.find_lines(mv.simulate(rests, channels=("T_d",)))
    assert not any(x.seen for x in table)
    assert table.clock_ratio is None
    judged = judge(table, limit_of(1.0, 0.5, 150.0), rests)
    assert judged.verdict == "not judged"
    assert "lines at 0.06 deg/s, which tracking.profile holds from 50 s on" in str(judged)
    assert "from 4 to 6 s, begins before the array turns" in str(judged)


@pytest.mark.parametrize(
    ("profile", "settle", "unseen"),
    [
        (RESTS_FIRST, "30 s", "0.06 deg/s"),
        ([{"rate": "0.03 deg/s", "hold": "50 s"}, TRACKING], "30 s", "0.06 deg/s"),
        ([{"rate": "0.03 deg/s", "hold": "50 s"}, TRACKING], "60 s", "0.03 deg/s"),
        ([{"rate": "0.06 deg/s", "hold": "50 s"}, {"rate": "-0.06 deg/s"}], "30 s", "-0.06 deg/s"),
        ([{"rate": "0.06 deg/s", "hold": "50 s"}, {"rate": "-0.06 deg/s"}], "60 s", "0.06 deg/s"),
        ([{"rate": "0.06 deg/s", "hold": "50 s"}, {"rate": "0 deg/s"}], "60 s", "0.06 deg/s"),
        ([{"rate": "0.3 deg/s", "ramp": "20 s", "hold": "0 s"}, TRACKING], "60 s", "0.3 deg/s"),
    ],
)  # fmt: skip
def test_a_rate_that_the_record_does_not_see_is_told(state_1, profile, settle, unseen):
    drive = under(state_1, profile, settle=settle)
    for steady in (False, True):
        assert gap(drive, steady=steady).startswith(f"lines at {unseen}, which tracking.profile")
    assert not gap(drive, simulated=False).startswith("lines at")


@pytest.mark.parametrize(
    "profile",
    [
        [TRACKING],
        [{"rate": "0.06 deg/s", "ramp": "10 s"}],
        [{"rate": "0.03 deg/s", "hold": "0.42 s"}, TRACKING],
        [{"rate": "0.02 deg/s", "ramp": "2 s", "hold": "0 s"}, {"rate": "0.06 deg/s", "ramp": "5 s"}],
        [{"rate": "0.06 deg/s", "hold": "50 s"}, {"rate": "0.06 deg/s"}],
        [{"rate": "0.06 deg/s", "hold": "0.5 s"}, {"rate": "0 deg/s", "hold": "0.5 s"}, TRACKING],
        [{"rate": "0 deg/s", "hold": "5 s"}, TRACKING],
        [{"rate": "0 deg/s"}],
    ],
)  # fmt: skip
def test_a_start_leaves_a_verdict_as_it_is(state_1, profile):
    assert gap(under(state_1, profile, settle="80 s")) == ""


STOP_AND_GO = [{"rate": "0 deg/s", "hold": "0.4 s"}, {"rate": "0.06 deg/s", "hold": "0.4 s"}]


@pytest.mark.parametrize(
    ("profile", "start"),
    [
        ([{"rate": "0.06 deg/s", "hold": "90 s"}, {"rate": "0 deg/s", "ramp": "5 s"}], 90),
        ([{"rate": "0.06 deg/s", "hold": "90 s"}, {"rate": "0 deg/s"}], 90),
        ([{"rate": "0.06 deg/s", "hold": "90 s"}, *10 * STOP_AND_GO, TRACKING], 90),
        ([{"rate": "0.06 deg/s", "hold": "30 s"}, *10 * STOP_AND_GO, TRACKING], 30),
        ([TRACKING | {"hold": "50 s"}, TRACKING | {"hold": "50 s"}, {"rate": "0 deg/s"}], 100),
        ([TRACKING | {"ramp": "70 s"}], 0),
        ([{"rate": "0.02 deg/s", "ramp": "1 s", "hold": "0 s"}, {"rate": "0.021 deg/s", "ramp": "60 s", "hold": "0 s"}, TRACKING], 0),
    ],
)  # fmt: skip
def test_a_rate_that_changes_besides_the_start_is_not_judged(state_1, profile, start):
    drive = under(state_1, profile, settle="80 s")
    for steady in (False, True):
        told = f"while its rate changes, from {start} s on (tracking.profile)"
        assert told in gap(drive, steady=steady)


def test_a_start_is_said_beside_the_verdict(state_1):
    assert start_sentence(state_1) == ""
    twice = [TRACKING | {"hold": "50 s"}, TRACKING]
    assert start_sentence(under(state_1, twice, settle="80 s")) == ""
    assert start_sentence(under(state_1, [{"rate": "0 deg/s", "hold": "5 s"}, TRACKING])) == ""
    ramped = under(state_1, [TRACKING | {"ramp": "10 s"}], settle="20 s")
    assert start_sentence(ramped) == "The start, until 10 s (tracking.profile), is not judged."


@pytest.fixture(scope="module")
def second_rests() -> mv.Scenario:
    """A craft whose second array rests for the first 50 s."""
    interface = {
        "position": ["0.35 m", "-0.9 m", "-0.2 m"],
        "drive_axis": [0, -1, 0],
        "reference": [1, 0, 0],
    }
    rests = {"profile": [{"rate": "0 deg/s", "hold": "50 s"}, {"rate": "-0.06 deg/s"}]}
    wing = {"drive": "driven", "interface": interface, "tracking": rests}
    craft = mv.load_scenario(Path(__file__).parents[1] / "examples/spacecraft.yaml")
    return craft.with_({"spacecraft.second_wing": wing})


def test_a_second_wing_that_rests_is_not_passed(second_rests):
    motion = mv.simulate(second_rests.with_(SHORT))
    assert motion.second_wing is not None
    first, second = (mv.find_lines(each, "T_d") for each in (motion, motion.second_wing))
    judged = judge(first, limit_of(10.0, 5.0, 100.0), motion.scenario, second)
    assert "wing_2 lines at -0.06 deg/s" in str(judged)


def test_a_rate_with_a_second_wing_that_rests_is_not_judged(second_rests):
    case: RateCase = linear_case(second_rests, Si(1e-3), 16)
    assert case.verdict((5.0, 100.0), 10.0) == RECORD_GAP
    case = full_case(second_rests, Si(1e-3), 16)
    assert case.verdict((5.0, 100.0), 10.0) == RECORD_GAP


def test_lines_without_the_second_wings_say_what_to_leave_out(second_rests):
    alone = second_rests.with_(SHORT | {"spacecraft.second_wing.tracking": None})
    table = mv.find_lines(mv.simulate(alone, channels=("T_d",)))
    judged = judge(table, limit_of(10.0, 5.0, 100.0), alone)
    assert judged.verdict == "not judged"
    assert (
        "the second wing's drive, whose lines are not here (leave --lines-only out)" in judged.gaps
    )


@pytest.mark.parametrize(
    "varies",
    [
        {"friction.position": {"harmonics": [{"order": 1, "amplitude": 0.4, "phase": "180 deg"}]}},
        {"reducer.transmission_error": [{"order": 2, "amplitude": "60 arcsec"}]},
    ],
)
def test_a_manoeuvre_from_one_angle_of_what_varies_over_it_is_not_passed(state_1, varies):
    """From another angle it leaves up to four times the limit ringing."""
    assert not unknown_angle_reason(state_1, Manoeuvre(0.0, state_1.rate))
    drive, [key] = state_1.with_(varies), varies
    said = unknown_angle_reason(drive, Manoeuvre(0.0, state_1.rate))
    assert said == unknown_angle_reason(drive, Manoeuvre(state_1.rate, 0.0))
    assert f"leave {key} out" in said
