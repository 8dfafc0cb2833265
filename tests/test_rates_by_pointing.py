"""Rates planned by requirements on the line of sight."""

from __future__ import annotations

import pytest

import microvib as mv
from microvib.reports.outcome import terminal_text
from microvib.reports.rates_by_pointing import pointing_rates_outcome
from microvib.studies.rates_by_pointing import PointingPlan, plan_rates_by_pointing

CRAFT, REQUIREMENT = "examples/spacecraft.yaml", "examples/requirement.yaml"


@pytest.fixture(scope="module")
def plan() -> PointingPlan:
    return plan_rates_by_pointing(CRAFT, ["0.055 deg/s", "0.065 deg/s"], REQUIREMENT)


def test_the_rate_that_meets_a_mode_uses_most_of_the_limit(plan: PointingPlan) -> None:
    """At 0.065 deg/s the full step, 3.61 Hz, is near the mode at 3.1 Hz through the craft."""
    best, worst = plan.cases
    assert worst.share > 5.0 * best.share
    assert worst.line == "full_step_1"
    assert worst.frequency == pytest.approx(3.611, abs=1e-3)


def test_parts_of_limits_are_those_of_a_budget_of_the_drive(plan: PointingPlan) -> None:
    """The curve P-5 and the rms P-1 and P-3 are those that the budget finds for its lines."""
    judged = plan.judged[0]
    shares = {one.requirement.name: one.value / one.limit for one in judged.budget.judged}
    assert judged.case.share == pytest.approx(shares[judged.case.requirement], rel=0.02)


def test_the_best_rate_is_judged_by_a_budget(plan: PointingPlan) -> None:
    assert plan.judged[0].case.rate == plan.cases[0].rate
    assert plan.judged[0].verdict == "pass"
    outcome = pointing_rates_outcome(plan)
    assert outcome.verdict == "pass"
    assert "its budget passes" in terminal_text(outcome)


def test_without_a_line_of_sight_there_is_no_plan() -> None:
    with pytest.raises(mv.OptionError, match="line of sight"):
        plan_rates_by_pointing("state-1", ["0.06 deg/s"], REQUIREMENT)
