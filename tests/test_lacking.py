"""Effects that a model lacks and the evidence does not rule out: what they move is not identifiable."""

from dataclasses import replace

import numpy as np
import pytest

import microvib as mv
from microvib.studies.evidence import evidence_of, select_evidence
from microvib.studies.identify import parse_fit
from microvib.studies.identify import search as search_module
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.lacking import CHAIN, shift_reason, unmodelled_effects
from microvib.studies.identify.problem import ErrorModel, Problem, cost
from microvib.studies.identify.search import Optimum, least_misfit, linearise_at
from microvib.testdata.recording import Recording
from microvib.testdata.response import Stage, response, without_response


@pytest.fixture(scope="module")
def made():
    """A drive, and the evidence of a recording of it."""
    scenario = mv.load_scenario("state-1").with_si({"record.settle": 8.0, "record.duration": 6.0})
    torque = mv.simulate(scenario, channels=("T_d",))["T_d"]
    torque = torque + np.random.default_rng(1).normal(0.0, 2e-5, torque.size)
    return scenario, evidence_of(Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, "made"), scenario)


def judged(scenario, evidence, simulated):
    """What moves the viscous friction, where it is fitted and at its truth."""
    problem = Problem(
        scenario,
        [(evidence, {})],
        [parse_fit(scenario, "motor.friction.viscous")],
        ErrorModel(0.004),
    )
    (r,) = problem.residuals([problem.start])
    best = Optimum(problem.start, r, cost(r))
    local = linearise_at(problem, best)
    found = unmodelled_effects(problem, best, local, simulated)
    return found, shift_reason(found, problem, best, 0, float(local.spread[0]))


def test_few_lines_do_not_rule_out_a_chain_of_filters_unless_it_is_stated(made):
    scenario, evidence = made
    (few,) = select_evidence([evidence], scenario, ["0.5:60 Hz"])
    _, why = judged(scenario, few, simulated=False)
    assert why.startswith(
        f"not identifiable: the evidence does not rule out {CHAIN}, which would move it by -"
    )
    stated = replace(few, prepared=replace(few.prepared, response_known=True))
    assert judged(scenario, stated, simulated=False)[1] == ""
    assert judged(scenario, evidence, simulated=False)[1] == ""  # all lines rule it out


def test_effects_of_the_drive_are_looked_at_too(made):
    """One figure rules out nothing."""
    scenario, evidence = made
    one = replace(evidence, prepared=replace(evidence.prepared, response_known=True))
    one = replace(
        one,
        observations=tuple(
            o for o in one.observations if (o.line, o.form) == ("drive_1", "amplitude")
        ),
    )
    found, why = judged(scenario, one, simulated=True)
    assert {"driver.supply_voltage", "friction.presliding", "reducer.backlash"} <= {
        each.effect for each in found
    }
    assert why.startswith("not identifiable: the evidence does not rule out ")


def test_a_chain_may_be_stated_as_flat():
    flat = (Stage(kind="flat"),)
    assert np.all(response(flat, np.array([1.0, 1e3]), 4096.0) == 1.0)
    recording = Recording({"Mz": np.sin(np.arange(64.0))}, 64.0, {"Mz": "N*m"}, "made")
    told = without_response(recording, flat)
    assert np.array_equal(told["Mz"], recording["Mz"])
    assert "declared to have a flat response" in told.notes[-1]


@pytest.mark.release
def test_no_frequency_is_fitted_along_where_the_scenario_has_it_right(made):
    """Amplitudes are wrong by 3 % where 0.4 % was stated: no fit explains them, and another frequency hardly helps."""
    scenario, evidence = made
    random = np.random.default_rng(2)
    wrong = [
        replace(o, value=o.value * random.lognormal(0.0, 0.03)) if o.form == "amplitude" else o
        for o in evidence.observations
    ]
    key = parse_fit(scenario, "motor.friction.viscous")
    problem = Problem(
        scenario, [(replace(evidence, observations=tuple(wrong)), {})], [key], ErrorModel(0.004)
    )
    wider = problem.along()
    assert wider is not None
    starts = [Optimum(x, r, cost(r)) for x in (wider.start,) for r in wider.residuals([x])]
    asked, found = least_misfit(wider, starts, seed=1)
    assert not goodness(asked, found[0].r).explained
    assert [one.key for one in asked.keys] == ["motor.friction.viscous"]
    assert key.value(float(found[0].x[0])) == pytest.approx(
        scenario["motor.friction.viscous"], rel=0.1
    )
    off = scenario.with_si(
        {"array.modes.0.frequency": 1.05 * float(scenario["array.modes.0.frequency"])}
    )
    needed = problem.again(scenario=off).along()
    assert needed is not None
    starts = [Optimum(x, r, cost(r)) for x in (needed.start,) for r in needed.residuals([x])]
    kept, _ = least_misfit(needed, starts, seed=1)
    assert [one.along for one in kept.keys] == [False, True]


def test_a_search_that_failed_with_the_scenarios_frequency_is_made_again_from_what_explained(
    made, monkeypatch
):
    """The first round misses the fit that explains the evidence at the scenario's own frequency, the second finds it."""
    scenario, evidence = made
    key = parse_fit(scenario, "motor.friction.viscous")
    problem = Problem(scenario, [(evidence, {})], [key], ErrorModel(0.004))
    rounds, round_ = [], search_module._search_round

    def missing(posed, *asked):
        rounds.append([one.key for one in posed.keys])
        if len(rounds) > 1:
            return round_(posed, *asked)
        x = posed.start + 0.5
        (r,) = posed.residuals([x])
        return [Optimum(x, r, cost(r))]

    monkeypatch.setattr(search_module, "_search_round", missing)
    monkeypatch.setattr(search_module, "symmetric_solutions", lambda *_: [])
    found, optima = search_module.search(problem, seed=1, starts=8, finishes=1)
    assert [len(keys) for keys in rounds] == [1, 2]
    assert [one.key for one in found.keys] == ["motor.friction.viscous"]
    assert goodness(found, optima[0].r).explained
