"""Effects that a model lacks and the evidence does not rule out: what they move is not identifiable."""

from dataclasses import replace

import numpy as np
import pytest

import microvib as mv
from microvib.studies.evidence import chosen, evidence_of
from microvib.studies.identify import parse_fit
from microvib.studies.identify.lacking import CHAIN, lacking, moved_by
from microvib.studies.identify.problem import Problem, Trust, cost
from microvib.studies.identify.search import Optimum, local_at
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
    problem = Problem(scenario, [(evidence, {})], [parse_fit(scenario, "motor.friction.viscous")], Trust(0.004))
    (r,) = problem.residuals([problem.start])
    best = Optimum(problem.start, r, cost(r))
    local = local_at(problem, best)
    found = lacking(problem, best, local, simulated)
    return found, moved_by(found, problem, best, 0, float(local.spread[0]))


def test_few_lines_do_not_rule_out_a_chain_of_filters_unless_it_is_stated(made):
    scenario, evidence = made
    (few,) = chosen([evidence], scenario, ["0.5:60 Hz"])
    _, why = judged(scenario, few, simulated=False)
    assert why.startswith(
        f"not identifiable without {CHAIN}, which the evidence does not rule out and which moves it by -"
    )
    stated = replace(few, prepared=replace(few.prepared, response_known=True))
    assert judged(scenario, stated, simulated=False)[1] == ""
    assert judged(scenario, evidence, simulated=False)[1] == ""  # all lines rule it out


def test_effects_of_the_drive_are_looked_at_too(made):
    """One figure rules out nothing."""
    scenario, evidence = made
    one = replace(evidence, prepared=replace(evidence.prepared, response_known=True))
    one = replace(one, observations=tuple(o for o in one.observations if (o.line, o.form) == ("drive_1", "amplitude")))
    found, why = judged(scenario, one, simulated=True)
    assert {"driver.supply_voltage", "friction.presliding", "reducer.backlash"} <= {each.effect for each in found}
    assert why.startswith("not identifiable without ")


def test_a_chain_may_be_stated_as_flat():
    flat = (Stage(kind="flat"),)
    assert np.all(response(flat, np.array([1.0, 1e3]), 4096.0) == 1.0)
    recording = Recording({"Mz": np.sin(np.arange(64.0))}, 64.0, {"Mz": "N*m"}, "made")
    told = without_response(recording, flat)
    assert np.array_equal(told["Mz"], recording["Mz"])
    assert "stated as flat" in told.notes[-1]
