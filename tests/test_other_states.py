"""Verdicts on a craft with a second wing in all states of the hinge that a run takes as a linear spring:
sliding or locked by dry friction, and a wing that is locked outright."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import microvib as mv
from microvib.analysis.limits import Judgement, judge
from microvib.analysis.other_states import other_states, slipping_reason_of_table
from microvib.analysis.run import RunResult
from microvib.model.linear import disturbance_torque_response
from microvib.model.other_hinge import other_hinge
from microvib.model.scenario import Scenario
from microvib.reports.rates import rates_outcome
from microvib.reports.run.outcome import run_outcome
from microvib.signals.limit_curve import LimitCurve
from microvib.studies.campaign.cases import VERDICTS, compute_bytes
from microvib.studies.campaign.design import read_design
from microvib.studies.campaign.folder import create
from microvib.studies.campaign.results import merge, open_results
from microvib.studies.campaign.statistics import ABOVE, UNKNOWN, case_verdicts, line_verdicts
from microvib.studies.profiles.plan import Run, plan_profile
from microvib.studies.profiles.runs import Case, Ringing
from microvib.studies.rates import OTHER_STATE, RECORD_GAP, full_case, linear_case, plan_rates
from microvib.units import Si

RATE = math.radians(0.0209)
WING = {
    "drive": "held",
    "interface": {
        "position": [0.35, -0.9, -0.2],
        "drive_axis": [0.0, -1.0, 0.0],
        "reference": [1.0, 0.0, 0.0],
    },
}
OF_STATE = "in another state of the second wing's hinge"
SLIP_RING = {
    "contact_pairs": 320,
    "contact_force": 0.042,
    "friction_factor": 1.53,
    "ring_radius": 0.0265,
}


def craft(rate: float = RATE, **changes: Any) -> Scenario:
    """The small craft with a second wing and a slip ring whose friction holds its shaft; full-step lines
    stand at 1.16 Hz, where a mode is only while that shaft is locked.
    """
    one = mv.load_scenario("examples/spacecraft.yaml")
    array = one.array.model_dump()
    array["modes"][1]["damping"] = 0.003
    settings: dict[str, Any] = {
        "tracking.rate": rate,
        "friction.slip_ring": SLIP_RING,
        "array": array,
        "spacecraft.second_wing": WING,
    }
    return one.with_si(settings | changes)


def run(scenario: Scenario) -> RunResult:
    return mv.run_scenario(scenario, start="steady", lines_only=True)


@pytest.fixture(scope="module")
def held() -> RunResult:
    return run(craft())


@pytest.fixture(scope="module")
def locked() -> RunResult:
    return run(craft(**{"spacecraft.second_wing.drive": "locked"}))


def test_a_locked_wing_is_one_whose_drive_is_very_stiff() -> None:
    one = craft(**{"spacecraft.second_wing.drive": "locked"})
    stiff = craft(
        **{
            "spacecraft.second_wing.motor": {**one.motor.model_dump(), "torque_constant": 3e4},
            "spacecraft.second_wing.reducer": {**one.reducer.model_dump(), "stiffness": 1e9},
        }
    )
    assert one.craft is not None
    assert stiff.craft is not None
    modes = len(one.craft.frequency)
    assert len(stiff.craft.frequency) == modes + 2
    assert one.craft.frequency[3:] == pytest.approx(stiff.craft.frequency[3:modes], rel=1e-4)
    free = craft().craft
    assert free is not None
    assert np.max(np.abs(free.frequency[:modes] / one.craft.frequency - 1.0)) > 0.01


def test_the_ratio_is_that_of_the_two_linear_crafts() -> None:
    """Responses through the modes of either craft against one system with a spring that locks."""
    smooth = {"motor.detent_torque": 0.0}
    f = np.array([0.3, 1.0, 1.16111, 1.222, 3.48, 18.58])
    torque = np.eye(2 + 4)[0]
    sizes = []
    for drive in ("held", "locked"):
        one = craft(**smooth, **{"spacecraft.second_wing.drive": drive})
        of_rotor = np.zeros(2 + len(one.load.H))
        of_rotor[: torque.size] = torque
        sizes.append(disturbance_torque_response(one, f, of_rotor))
    expected = sizes[1] / sizes[0]
    hinge = other_hinge(craft(**smooth))
    assert hinge is not None
    least, most = hinge.ratios(f, f)
    lowest, highest = np.minimum(expected, 1.0), np.maximum(expected, 1.0)
    assert most == pytest.approx(highest, rel=0.01)
    assert np.all(
        least <= 1.01 * lowest
    )  # friction that slides at times leaves less than both at some
    assert least == pytest.approx(lowest, rel=0.35)
    assert expected[2] > 9.0
    assert expected[3] < 0.2


@pytest.mark.parametrize("turned", [1j, np.exp(0.25j * np.pi), np.exp(0.75j * np.pi)])
def test_friction_that_slides_for_a_part_of_the_time_is_between_least_and_most(
    turned: complex,
) -> None:
    """A damper of any size in place of the other hinge's friction, and one that is a part of a spring or a mass."""
    hinge = other_hinge(craft(**{"motor.detent_torque": 0.0}))
    assert hinge is not None
    states, f = hinge.states, np.geomspace(0.5, 30.0, 23)
    M, C, K = states._system
    [spring] = [one for one in states.springs if math.isinf(one.high)]
    rows = np.array([hinge.row("", there=False)])
    least, most = states.extremes(f, states.on_rotor, rows, between=False)[:, :, 0, 0]
    for size in np.geomspace(1e-2, 1e6, 41):
        friction = turned * size * np.outer(spring.on, spring.on)
        for k, omega in enumerate(2.0 * np.pi * f):
            moved = np.linalg.solve(K - omega**2 * M + 1j * omega * C + friction, states.on_rotor)
            found = float(np.abs(rows @ moved)[0, 0])
            assert least[k] <= found * (1.0 + 1e-9)
            assert turned != 1j or found <= most[k] * (1.0 + 1e-9)


def test_a_line_on_a_mode_of_the_locked_hinge_does_not_pass(
    held: RunResult, locked: RunResult
) -> None:
    line = held.table["full_step_1"]
    assert line.amplitude == pytest.approx(0.0816, rel=0.01)
    assert locked.table["full_step_1"].amplitude == pytest.approx(0.457, rel=0.01)
    limit = mv.Limit("150 mN*m")
    judged = held.judge(limit)
    assert judged.verdict == "not judged"
    one = judged.of(line)
    assert one is not None
    assert one.verdict == "not judged"
    assert one.by_state
    assert one.why.startswith("full_step_1 (81.64 mN m, and up to ")
    told = str(judged)
    assert "second wing's hinge: dry friction of up to 0.591 N m" in told
    assert "spacecraft.second_wing.drive: locked judges it locked" in told
    assert locked.judge(limit).verdict == "fail"


def test_a_limit_far_above_all_states_is_passed_and_says_on_what_it_rests(
    held: RunResult, locked: RunResult
) -> None:
    limit = mv.Limit("1200 mN*m")
    judged = held.judge(limit)
    assert judged.verdict == "pass"
    assert "held by its linearised drive" in judged.assumption
    assert judged.assumption in str(judged)
    told = run_outcome(held, limit)
    assert told.verdict == "pass"
    assert told.data["judgement"]["assumption"] == judged.assumption
    assert not locked.judge(limit).assumption


def test_a_line_on_a_mode_of_the_free_hinge_does_not_fail() -> None:
    """At 1.222 Hz the mode is there only while the shaft is free."""
    result = run(craft(RATE * 1.2219 / 1.16111))
    line = result.table["full_step_1"]
    hinge = other_states(result.table, result.scenario)
    assert hinge is not None
    assert hinge.least(line, line.amplitude) < 0.5 * line.amplitude
    one = result.judge(mv.Limit(Si(0.7 * line.amplitude))).of(line)
    assert one is not None
    assert one.verdict == "not judged"
    assert "as little as" in one.why
    low = result.judge(mv.Limit(Si(0.02 * line.amplitude))).of(line)
    assert low is not None
    assert low.fails


def test_a_hinge_without_dry_friction_is_judged_as_it_runs(held: RunResult) -> None:
    free = {"coulomb": 0.0, "breakaway": 0.0, "stribeck_rate": 5e-5, "viscous": 0.0255}
    one = craft(**{"spacecraft.second_wing.friction": free})
    judged = run(one).judge(mv.Limit("150 mN*m"))
    assert judged.verdict == "pass"
    assert judged.worst is not None
    assert judged.worst.amplitude == pytest.approx(held.table["full_step_1"].amplitude, rel=1e-3)


def test_no_other_line_changes_by_more_than_is_allowed_for(
    held: RunResult, locked: RunResult
) -> None:
    states = other_states(held.table, held.scenario)
    assert states is not None
    others = [x for x in held.table if x.seen and x.name != "full_step_1"]
    assert len(others) > 20
    for x in others:
        there = next((y for y in locked.table if y.name == x.name and y.seen), None)
        if there is not None:
            assert states.least(x, x.amplitude) <= there.amplitude <= states.largest(x, x.amplitude)


def test_loads_are_judged_in_other_states_too(held: RunResult) -> None:
    size = held.load_lines(mv.Limit.of_curves(None, {"My": LimitCurve.flat(1.0)}))["My"]["full_step_1"].amplitude  # fmt: skip
    judged = held.judge(mv.Limit.of_curves(None, {"My": LimitCurve.flat(2.0 * size)}))
    assert {one.component for one in judged.loads} == {"My", "My_2"}
    assert judged.verdict == "not judged"
    for one in judged.loads:
        found = next(m for m in one.margins if m.line.name == "full_step_1")
        assert found.by_state == (one.component == "My" or found.amplitude * 3.0 > 2.0 * size)


def test_wings_that_both_step_see_each_others_hinge() -> None:
    both = run(craft(**{"spacecraft.second_wing.drive": "driven"}))
    assert both.second is not None
    judged = both.judge(mv.Limit("150 mN*m"))
    assert judged.verdict == "not judged"
    assert {m.line.name for m in judged.margins if m.by_state} == {
        "full_step_1",
        "wing_2 full_step_1",
    }
    assert any("wing_2 the state of the first wing's hinge" in gap for gap in judged.gaps)


@pytest.mark.parametrize("solve", [full_case, linear_case])
def test_a_rate_is_not_allowed_in_one_state_alone(solve: Any) -> None:
    """The linearised drive has no full-step lines: its driving line is brought to the mode."""
    rate = RATE if solve is full_case else RATE / 16.0
    case = solve(craft(), Si(rate), 16)
    everywhere = (0.0, math.inf)
    line = max(case.lines, key=lambda x: x.most)
    assert line.frequency == pytest.approx(1.1611, rel=1e-3)
    assert line.most > 5.0 * line.amplitude
    alone = replace(case, gap=None, unseen=(), hidden=())
    assert alone.verdict(everywhere, 2.0 * line.amplitude) == OTHER_STATE
    assert alone.verdict(everywhere, 1.1 * line.most) == ""
    assert case.verdict(everywhere, 2.0 * line.amplitude) != ""


def test_a_plan_of_rates_looks_at_modes_of_the_locked_hinge() -> None:
    """Between two rates of the plan a driving line is on the mode; neither of them is near."""
    rates = [Si(0.97 * RATE / 16.0), Si(1.03 * RATE / 16.0)]
    plan = plan_rates(craft(), rates, linear=True)
    met = {x.line: x for x in plan.resonances if OF_STATE in x.mode}
    one = met["drive_1"]
    assert 0.97 < 16.0 * one.rate / RATE < 1.03
    case = next(x for x in plan.cases if x.rate == one.rate)
    line = next(x for x in case.lines if x.name == "drive_1")
    assert one.amplitude == pytest.approx(line.raised)
    assert line.most > 5.0 * line.amplitude


@pytest.mark.release
def test_a_plan_of_rates_forbids_a_mode_of_the_locked_hinge() -> None:
    rates = [Si(0.97 * RATE), Si(1.03 * RATE)]
    plan = plan_rates(craft(), rates, limit=Si(0.2))
    [met] = [x for x in plan.resonances if OF_STATE in x.mode]
    assert met.line == "full_step_1"
    assert met.amplitude > 0.4
    assert any(OTHER_STATE in x.why and x.low <= met.rate <= x.high for x in plan.forbidden)


def test_a_locked_shaft_that_would_slip_is_not_judged(locked: RunResult) -> None:
    """The torque at the locked hinge against what friction holds."""
    loads = locked.load_lines(mv.Limit.of_curves(None, {"My": LimitCurve.flat(1.0)}))
    there = sum(x.amplitude for x in loads["My_2"] if x.seen)
    weak: dict[str, float] = {}
    for part, slips in ((2.0, False), (0.5, True)):
        weak = {
            "coulomb": 0.5 * part * there,
            "breakaway": part * there,
            "stribeck_rate": 5e-5,
            "viscous": 0.0255,
        }
        one = locked.scenario.with_si({"spacecraft.second_wing.friction": weak})
        assert bool(slipping_reason_of_table(locked.table, one)) == slips
        judged = judge(locked.table, mv.Limit("1200 mN*m"), one)
        assert judged.verdict == ("not judged" if slips else "pass")
    case = full_case(
        locked.scenario.with_si({"spacecraft.second_wing.friction": weak}), Si(RATE), 16
    )
    assert case.gap is not None
    assert "may overcome its friction" in case.gap.why
    assert case.verdict((0.0, math.inf), 0.1) == RECORD_GAP


def test_a_budget_refuses_a_locked_wing() -> None:
    with pytest.raises(mv.MicrovibError, match=r"second_wing.drive: locked.*use held"):
        mv.pointing_budget(craft(**{"spacecraft.second_wing.drive": "locked"}))


@pytest.mark.release
def test_a_case_of_a_campaign_neither_passes_nor_fails(tmp_path: Path) -> None:
    """A line that is within the limit, and one above it, are not counted as such: the other state decides."""
    (tmp_path / "craft.yaml").write_text(mv.dump_scenario(craft()))
    for limit, name in (("150 mN*m", "full_step_1"), ("60 mN*m", "full_step_1")):
        study = tmp_path / f"{limit[:2]}.yaml"
        study.write_text(
            "scenario: craft.yaml\n"
            "vary: {motor.detent_torque: {distribution: uniform, within: 1e-6 percent}}\n"
            f"sampling: {{method: random, count: 1}}\nlimit: {limit}\nsolve: steady\n"
        )
        campaign = create(read_design(study), tmp_path / limit[:2])
        campaign.write(0, compute_bytes(campaign.work(0)))
        merge(campaign)
        results = open_results(campaign)
        curve = LimitCurve.flat(0.001 * float(limit.split()[0]))
        whole = case_verdicts(results, curve, (0.0, math.inf))
        of_line = line_verdicts(results, name, curve, (0.0, math.inf), whole)
        if limit == "150 mN*m":
            assert VERDICTS[results.verdicts[0]] == "not judged"
            assert whole.tolist() == [UNKNOWN]
            assert of_line.tolist() == [UNKNOWN]
        else:
            assert VERDICTS[results.verdicts[0]] == "fail"
            assert of_line.tolist() == [ABOVE]


def test_the_files_of_a_plan_tell_of_other_states() -> None:
    plan = plan_rates(craft(), [Si(RATE / 16.0)], linear=True)
    table = next(x for x in rates_outcome(plan).files if x.name == "not_seen")
    told = {row[2]: row[5] for row in table.rows}
    assert told[f"drive_1 {OF_STATE.replace('second', 'other')}"] == pytest.approx(
        next(x for x in plan.cases[0].lines if x.name == "drive_1").most
    )


def test_lines_of_two_drives_that_step_together_are_judged_by_what_the_craft_feels():
    """A torque of 215 mN m of each drive alone passed 300 where the craft feels 466 about that axis."""
    pair = craft(
        math.radians(0.0219),
        **{"friction.slip_ring": None, "spacecraft.second_wing.drive": "driven"},
    )
    found = mv.run_scenario(pair, start="steady")
    felt = found.load_lines(mv.Limit.of_curves(None, {"My": LimitCurve.flat(1.0)}))
    both = max(felt[name]["full_step_1"].amplitude for name in ("My", "My_2"))
    alone = found.table["full_step_1"].amplitude
    assert both > 2.0 * alone
    between = found.judge(mv.Limit(Si(0.5 * (alone + both))))
    assert between.verdict == "not judged"
    [margin] = [m for m in between.margins if m.line.name == "full_step_1"]
    told = re.search(r"up to ([\d.]+) mN m about this axis with both drives stepping", margin.why)
    assert told
    assert 1e-3 * float(told[1]) == pytest.approx(both, rel=0.01)
    assert "a limit of the loads" in str(between)
    assert found.judge(mv.Limit(Si(1.2 * both))).verdict == "pass"


def test_rates_of_two_drives_that_step_together_are_not_judged_by_each_alone():
    pair = craft(
        math.radians(0.0219),
        **{"friction.slip_ring": None, "spacecraft.second_wing.drive": "driven"},
    )
    case = full_case(pair, Si(math.radians(0.0219)), pair.driver.microsteps)
    alone = max(line.amplitude for line in case.lines)
    assert case.verdict((0.5, 2.0), 1.4 * alone) == OTHER_STATE
    assert "both step" in case.hinge
    assert case.verdict((0.5, 2.0), 4.0 * alone) == ""


def test_a_load_of_drives_with_clocks_of_their_own_passes_by_no_phase_of_theirs():
    """Torques that cancelled in the record passed 2.2 mN m, and come to 5.3 half a beat later."""
    light = {
        "friction.coulomb": 0.0,
        "friction.breakaway": 0.0,
        "spacecraft.attitude_control.bandwidth": 0.05,
        "spacecraft.hub.inertia": [60.0, 15.0, 65.0, 0.0, 0.0, 0.0],
        "spacecraft.second_wing": WING | {"drive": "driven"},
    }
    pair = mv.load_scenario("examples/spacecraft.yaml").with_si(light)
    limit = mv.Limit.of_curves(None, {"My": LimitCurve((3.0, 4.0), (2.2e-3, 2.2e-3))})

    def judged(**wing: float) -> Judgement:
        changes = {f"spacecraft.second_wing.{key}": value for key, value in wing.items()}
        [of_first, _] = run(pair.with_si(changes)).judge(limit).loads
        return of_first

    drifting = judged(clock_ratio=1.00001)
    assert drifting.verdict == "not judged"
    told = re.search(
        r"full_step_1 of both drives, up to ([\d.]+) mN m as their clocks drift", str(drifting)
    )
    assert told
    assert judged().verdict == "pass"  # one clock keeps that phase
    worst = judged(stagger=8.0)
    assert worst.verdict == "fail"
    [margin] = [m for m in worst.margins if m.line.name == "full_step_1"]
    assert 1e-3 * float(told[1]) == pytest.approx(margin.line.amplitude, rel=0.01)


def test_a_profile_of_rate_passes_in_no_state_of_the_hinge_alone() -> None:
    """What rings may be a mode of the locked hinge, which no run of the plan has."""
    manoeuvre = {"limit": "100 mN*m", "frequency_uncertainty": 0.02, "runs": False}
    held, locked = (
        plan_profile(craft(math.radians(0.3), **changes), **manoeuvre)
        for changes in ({}, {"spacecraft.second_wing.drive": "locked"})
    )
    assert all("second wing's hinge" in shape.unknown for shape in held.shapes)
    assert not any(shape.unknown for shape in locked.shapes)
    kept = Run("step", Case(locked.scenario, ()), "mode", Ringing(0.01, 0.0, 0.01, "ok"), 0.1, 1.0)
    passing = replace(locked.shapes[0], residuals=(), runs=(kept,), searched=True)
    assert passing.verdict == "pass"
    assert replace(passing, unknown=held.shapes[0].unknown).verdict == "not judged"
