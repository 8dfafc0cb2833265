"""Parameters that act exactly like a fitted one: what is found is of both together."""

from __future__ import annotations

import numpy as np
import pytest

import microvib as mv
from microvib.studies.evidence import Evidence, evidence_of
from microvib.studies.identify import parse_fit
from microvib.studies.identify.equivalent import Equivalent, equivalents, together
from microvib.studies.identify.problem import ErrorModel, Problem, cost
from microvib.studies.identify.search import Optimum, linearise_at
from microvib.testdata.recording import Recording


@pytest.fixture(scope="module")
def drive() -> mv.Scenario:
    return mv.load_scenario("state-1").with_si({"record.settle": 8.0, "record.duration": 6.0})


@pytest.fixture(scope="module")
def evidence(drive: mv.Scenario) -> Evidence:
    """A recording of it."""
    torque = mv.simulate(drive, channels=("T_d",))["T_d"]
    torque = torque + np.random.default_rng(1).normal(0.0, 2e-5, torque.size)
    return evidence_of(Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, "made"), drive)


def alike(drive: mv.Scenario, evidence: Evidence, key: str) -> dict[str, Equivalent]:
    """What acts like one parameter that is fitted, by its key."""
    problem = Problem(drive, [(evidence, {})], [parse_fit(drive, key)], ErrorModel(0.004))
    (r,) = problem.residuals([problem.start])
    best = Optimum(problem.start, r, cost(r))
    found = equivalents(problem, best, linearise_at(problem, best))
    return {one.key: one for one in found}


def test_eddy_damping_that_a_scenario_lacks_acts_like_viscous_friction(
    drive: mv.Scenario, evidence: Evidence
) -> None:
    """In the equation of the rotor both are one torque over its rate."""
    key = parse_fit(drive, "motor.friction.viscous")
    found = alike(drive, evidence, key.key)
    assert set(found) == {"motor.eddy_damping"}
    one = found["motor.eddy_damping"]
    assert one.value == 0.0
    assert one.ratio == pytest.approx(1.0, abs=1e-4)
    text = together([one], key, 0.022)
    assert (
        text == " with motor.eddy_damping: the sum is, 0.022 N m s/rad; the two are not told apart"
    )


def test_inertias_on_one_shaft_act_alike(drive: mv.Scenario, evidence: Evidence) -> None:
    key = parse_fit(drive, "motor.rotor_inertia")
    found = alike(drive, evidence, key.key)
    one = found["reducer.wave_generator_inertia"]
    assert one.ratio == pytest.approx(1.0, abs=1e-3)
    assert "the sum is, 2.52e-05 kg m²" in together([one], key, 2e-5)


def test_nothing_else_acts_like_a_stiffness(drive: mv.Scenario, evidence: Evidence) -> None:
    assert alike(drive, evidence, "reducer.stiffness") == {}
