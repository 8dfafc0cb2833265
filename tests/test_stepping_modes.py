"""Stepping modes over rate: which number of microsteps a plan's table chooses, with hysteresis."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from itertools import pairwise

import pytest
from click.testing import CliRunner

from microvib.cli.main import main
from microvib.studies.rates import RateCase, RateLine, RatePlan, plan_rates, rate_grid
from microvib.studies.stepping_modes import SWITCH_GAIN, stepping_modes

RATES = [math.radians(0.01 * k) for k in range(1, 6)]


def plan_of(state_1, amplitudes: dict[int, list[float]], limit: float | None = None) -> RatePlan:
    """A plan whose cases have one line each, nan where a case failed."""
    cases = [
        RateCase(rate, count, (RateLine("drive_1", "drive", 1.0, 50.0, size),))
        if size == size
        else RateCase(rate, count, (), "lost synchronism")
        for count, sizes in amplitudes.items()
        for rate, size in zip(RATES, sizes, strict=True)
    ]
    return RatePlan(state_1, tuple(cases), (), (), (), limit, (0.0, math.inf), False)


def chosen(plan: RatePlan) -> list[tuple[float, float, int]]:
    return [
        (round(math.degrees(x.low), 6), round(math.degrees(x.high), 6), x.microsteps)
        for x in stepping_modes(plan)
    ]


def test_the_smallest_is_taken_and_kept_until_another_brings_three_decibels(state_1):
    plan = plan_of(state_1, {16: [1.0, 1.0, 1.0, 1.0, 1.0], 64: [2.0, 0.9, 0.72, 0.70, 0.2]})
    assert pytest.approx(1.4125, rel=1e-4) == SWITCH_GAIN
    assert chosen(plan) == [(0.01, 0.035, 16), (0.035, 0.05, 64)]
    first, second = stepping_modes(plan)
    assert (first.largest, second.largest) == (1.0, 0.70)
    assert first.line == "drive_1"
    assert first.verdict == ""


def test_a_small_gain_is_taken_where_it_keeps_the_limit(state_1):
    sizes = {16: [0.9, 0.9, 1.05, 0.9, 0.9], 64: [0.95, 0.95, 0.95, 0.95, 0.95]}
    plan = plan_of(state_1, sizes, limit=1.0)
    assert chosen(plan) == [(0.01, 0.025, 16), (0.025, 0.05, 64)]
    assert [x.verdict for x in stepping_modes(plan)] == ["pass", "pass"]


def test_what_is_above_the_limit_with_every_count_is_said(state_1):
    plan = plan_of(state_1, {16: [3.0] * 5, 64: [2.5] * 5}, limit=1.0)
    (only,) = stepping_modes(plan)
    assert (only.microsteps, only.verdict) == (64, "fail")


def test_a_count_whose_case_failed_is_not_chosen(state_1):
    plan = plan_of(state_1, {16: [0.1, math.nan, 0.1, 0.1, 0.1], 64: [0.2] * 5})
    assert chosen(plan) == [(0.01, 0.015, 16), (0.015, 0.025, 64), (0.025, 0.05, 16)]
    plan = plan_of(state_1, {16: [math.nan] * 5, 64: [math.nan] * 5}, limit=1.0)
    (only,) = stepping_modes(plan)
    assert math.isnan(only.largest)
    assert only.verdict == "not judged"


def test_a_resonance_between_rates_counts_for_the_rate_next_to_it(state_1):
    plan = plan_of(state_1, {16: [0.1] * 5, 64: [0.2] * 5})
    at = RateCase(math.radians(0.0312), 16, (RateLine("drive_1", "drive", 1.0, 50.0, 9.0),))
    met = replace(plan, cases=(*plan.cases, at))
    assert chosen(plan) == [(0.01, 0.05, 16)]
    assert chosen(met) == [(0.01, 0.025, 16), (0.025, 0.035, 64), (0.035, 0.05, 16)]


def test_one_count_needs_no_table(state_1):
    assert stepping_modes(plan_of(state_1, {16: [1.0] * 5})) == ()


def test_ranges_follow_each_other_over_the_whole_plan(state_1):
    plan = plan_rates(state_1, rate_grid("0.02 deg/s", "0.06 deg/s", 5), [16, 64])
    found = stepping_modes(plan)
    assert math.degrees(found[0].low) == pytest.approx(0.02)
    assert math.degrees(found[-1].high) == pytest.approx(0.06)
    assert all(a.high == b.low for a, b in pairwise(found))
    for one in found:
        cases = [c for c in plan.of(one.microsteps) if one.low <= c.rate < one.high]
        assert max(map(plan.top, cases)) <= one.largest


def test_the_command_writes_the_table(tmp_path):
    arguments = [
        "rates", "state-1", "--from", "0.03 deg/s", "--to", "0.06 deg/s", "--count", "3", "--microsteps", "16,64",
        "--linear", "-o", str(tmp_path / "plan"),
    ]  # fmt: skip
    run = CliRunner().invoke(main, arguments)
    assert run.exit_code == 0, run.output
    assert "Stepping modes over rate" in run.output
    with (tmp_path / "plan" / "stepping_modes.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["microsteps"] == "64"
    assert {"from_deg_s", "to_deg_s", "largest_n_m", "line", "verdict"} <= set(rows[0])
