"""Where the model of a hub ends: lines above 0.7 of the first mode that is left out neither pass nor fail, unless they are far
within the limit.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import scenario_of

import microvib as mv
from microvib.model.hub_edge import HubEdge, hub_edge
from microvib.reports.craft import hub_sentence
from microvib.signals.limit_curve import EVERYWHERE
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.sources import Contribution
from microvib.studies.budget.sums import assess
from microvib.studies.rates import ABOVE_HUB, ABOVE_LIMIT, RateCase, RateLine
from microvib.units import Si

EXAMPLES = Path(__file__).parents[1] / "examples"
EDGE = HubEdge(100.0, 101.0)


def wheel(frequency, size, **changes):
    """One line about x [rad] on a hub that is known up to 70 Hz."""
    los = np.array([[size, 0.0]], dtype=complex)
    return Contribution(
        "wheel", "given", ("order 1",), np.array([frequency]), los, edge=EDGE, **changes
    )


def required(**changes):
    return Requirement(name="A", axis="x", limit=Si(1e-6), metric="ape", **changes)


@pytest.mark.parametrize(
    ("frequency", "size", "verdict"),
    [
        (69.0, 9e-7, "pass"),
        (24.0, 1.39e-6, "pass"),
        (26.0, 1.39e-6, "not judged"),
        (71.0, 9e-7, "not judged"),
        (71.0, 9e-9, "pass"),
        (69.0, 2e-6, "fail"),
        (71.0, 2e-6, "not judged"),
        (500.0, 9e-7, "not judged"),
    ],
)
def test_a_line_of_a_budget_above_the_edge(frequency, size, verdict):
    found = assess(required(), [wheel(frequency, size)], "rss")
    assert found.verdict == verdict
    if verdict == "not judged" and frequency > EDGE.frequency:
        assert (
            "what is above 70 Hz, for the hub's modes from 100 Hz on are left out" in found.why[0]
        )
        assert "spacecraft.hub.count" in found.why[0]


def test_a_band_below_the_edge_is_judged():
    found = assess(required(highest=Si(60.0)), [wheel(71.0, 9e-7)], "rss")
    assert found.verdict == "pass"


def test_a_curve_above_the_edge_is_not_judged():
    curve = [{"frequency": f"{f} Hz", "amplitude": "1 urad"} for f in (10, 200)]
    asked = Requirement(name="A", axis="x", curve=curve)
    verdicts = [assess(asked, [wheel(f, 9e-7)], "rss").verdict for f in (69.0, 71.0)]
    assert verdicts == ["pass", "not judged"]


def test_speeds_that_are_not_the_worst_are_looked_at_above_the_edge():
    """The slow speed has the larger line, the fast one lies above the edge."""
    slow, fast = wheel(50.0, 9e-7), wheel(90.0, 5e-7)
    both = wheel(50.0, 9e-7, alternatives=(slow, fast))
    assert assess(required(), [both], "rss").verdict == "not judged"
    assert assess(required(), [wheel(50.0, 9e-7, alternatives=(slow,))], "rss").verdict == "pass"


def test_a_density_above_the_edge():
    f = np.linspace(1.0, 200.0, 400)
    verdicts = []
    for top in (65.0, 150.0):
        S = np.where(f[:, None] < top, 1e-15, 0.0) * [1.0, 0.0]
        one = Contribution(
            "noise", "given", (), np.zeros(0), np.zeros((0, 2)), density=(f, S), edge=EDGE
        )
        verdicts.append(assess(required(), [one], "rss").verdict)
    assert verdicts == ["pass", "not judged"]


@pytest.fixture(scope="module")
def run():
    changes = {"spacecraft.hub.left_out_from": "120 Hz", "record.start": "steady"}
    return mv.run_scenario(mv.load_scenario(EXAMPLES / "spacecraft.yaml", changes))


def test_a_limit_on_torque(run):
    """Driving lines are at 53.3, 106.7 Hz and so on, and the edge at 84 Hz."""
    first, second = (run.table[name].amplitude for name in ("drive_1", "drive_2"))
    assert hub_edge(run.scenario).factor == 501.0
    assert run.judge(mv.Limit(Si(1.5 * first), Si(1.0), Si(80.0))).verdict == "pass"
    found = run.judge(mv.Limit(Si(1.5 * first), Si(1.0), Si(120.0)))
    assert found.verdict == "not judged"
    assert any("what is above 84 Hz" in gap for gap in found.gaps)
    assert run.judge(mv.Limit(Si(0.5 * second), Si(90.0), Si(120.0))).verdict == "not judged"
    assert run.judge(mv.Limit(Si(600.0 * first), Si(1.0), Si(120.0))).verdict == "pass"


def test_a_rate_whose_line_is_above_the_edge():
    line = RateLine("drive_1", "drive", 1.0, 80.0, 1e-3)
    known = RateCase(0.01, 16, (line,))
    for amplitude, verdict in ((2e-3, ABOVE_HUB), (5e-4, ABOVE_HUB), (1.0, "")):
        open_case = RateCase(0.01, 16, (line,), edge=EDGE)
        assert open_case.verdict(EVERYWHERE, amplitude) == verdict
    assert known.verdict(EVERYWHERE, 2e-3) == ""
    assert known.verdict(EVERYWHERE, 5e-4) == ABOVE_LIMIT


def test_what_is_known_of_hub_and_array_is_said():
    rigid = mv.load_scenario(EXAMPLES / "spacecraft.yaml")
    assert hub_edge(rigid) is None
    assert hub_sentence(rigid) == (
        "The hub is rigid; the array by modes up to 8.7 Hz, beyond which it is rigid."
    )
    assert hub_edge(mv.load_scenario("state-1")) is None
    flexible = scenario_of(whole.FullCraft(flexible=[(17.0, 0.003, np.full(6, 1e-3))]))
    assert "The hub is known by its modes up to 17 Hz, beyond which it is rigid" in hub_sentence(
        flexible
    )


def test_the_frequency_is_kept_in_a_scenario(run):
    again = json.loads(json.dumps(mv.dump_scenario(run.scenario)))
    assert "left_out_from: 120 Hz" in again
