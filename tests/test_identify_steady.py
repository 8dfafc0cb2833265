"""Identification by steady states in place of runs: when, and that answers are those of runs."""

import numpy as np
import pytest

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.studies.evidence import Evidence, observations
from microvib.studies.identify import ErrorModel, identify, parse_fit
from microvib.studies.identify.fit import (
    IN_TIME,
    STEADY,
    STEADY_THEN_IN_TIME,
    without_start_dependence,
)
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.problem import Problem
from microvib.studies.identify.search import Descent, Optimum, linearise_at, search

KEYS = ["reducer.stiffness", "motor.friction.viscous"]
TRUTH = {"reducer.stiffness": 5600.0, "motor.friction.viscous": 0.0162}
FIVE = {
    "reducer.stiffness": 5432.0,
    "motor.friction.viscous": 0.01653,
    "array.rigid_inertia": 0.1477,
    "motor.detent_torque": 0.01111,
    "reducer.damping": 0.458,
}
"""Of a drive whose estimates are correlated: slopes that are a little off give other intervals."""


@pytest.fixture(scope="module")
def start() -> mv.Scenario:
    return mv.load_scenario("state-1").with_si({"record.duration": 20.0})


def recorded(scenario: mv.Scenario) -> Evidence:
    """Lines of a noisy record of the scenario, 20 s long."""
    torque = mv.simulate(scenario, channels="T_d")["T_d"]
    noisy = torque + np.random.default_rng(1).normal(0.0, 1e-3, torque.size)
    table = lines_of_samples(noisy, 4096.0, scenario, measured=True)
    return Evidence("test", tuple(observations(table)), table.clock_ratio, 20.0, 4096.0)


@pytest.fixture(scope="module")
def evidence(start: mv.Scenario) -> Evidence:
    return recorded(start.with_si(TRUTH))


def posed(scenario: mv.Scenario, evidence: Evidence, keys: list[str] = KEYS) -> Problem:
    """The problem of an identification."""
    trust, fitted = ErrorModel(0.004), [parse_fit(scenario, key) for key in keys]
    tests, _ = without_start_dependence([(evidence, {})], scenario, fitted, trust)
    return Problem(scenario, tests, fitted, trust)


@pytest.mark.release
def test_answers_are_those_of_runs(
    start: mv.Scenario, evidence: Evidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_steady_states = identify(start, [evidence], KEYS)
    monkeypatch.setattr(Problem, "in_steady_state", lambda *_: None)
    by_runs = identify(start, [evidence], KEYS)
    assert by_steady_states.method == STEADY
    assert by_runs.method == IN_TIME
    for own, other in zip(by_steady_states.estimates, by_runs.estimates, strict=True):
        assert own.estimate == pytest.approx(other.estimate, abs=0.1 * other.standard_error)
        assert own.standard_error == pytest.approx(other.standard_error, rel=0.01)
        assert np.diff(own.interval) == pytest.approx(np.diff(other.interval), rel=0.02)
        assert own.identifiable == other.identifiable
        assert own.interval[0] < TRUTH[own.key] < own.interval[1]
    assert by_steady_states.goodness.chi_square == pytest.approx(
        by_runs.goodness.chi_square, abs=0.05
    )


def test_corrected_steady_states_have_the_residuals_of_runs(start: mv.Scenario) -> None:
    """At the optimum, and two standard errors beside it along the directions that the evidence tells most
    and least of, to less than what moves an estimate by 3 % of its own."""
    problem = posed(start, recorded(start.with_si(FIVE)), list(FIVE))
    best = Descent(problem, problem.point(FIVE)).run(20, 1e-3)
    local = linearise_at(problem, best)
    assert local.steady is not None
    values, vectors = np.linalg.eigh(local.covariance)
    sides = 2.0 * np.sqrt(values[[0, -1]])[:, None] * vectors[:, [0, -1]].T
    points = [best.x, *(best.x + side for side in sides), *(best.x - side for side in sides)]
    each = zip(local.steady.residuals(points), problem.residuals(points), strict=True)
    moved = np.array([np.linalg.pinv(local.J) @ (near - run) for near, run in each])
    assert np.max(np.abs(moved) / local.spread) < 0.03


def test_where_no_steady_state_is_searched_runs_are(start: mv.Scenario, evidence: Evidence) -> None:
    assert posed(start, evidence).steady() is not None
    noise = {"friction.torque_noise": {"density": "1e-6 N^2*m^2/Hz"}}
    assert posed(start.with_(noise), evidence).steady() is None
    memory = {"friction.presliding": {"stiffness": "20000 N*m/rad"}}
    assert posed(start.with_(memory), evidence).steady() is None
    assert posed(start, evidence, [*KEYS, "record.settle"]).steady() is None


@pytest.mark.release
def test_a_motion_of_another_kind_is_searched_for_by_runs(
    start: mv.Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where steady states explain nothing, as where they are all lost, the search is as before."""
    monkeypatch.setattr(Problem, "steady", lambda self: self.in_steady_state(self.start))
    few = parse_fit(start, "reducer.stiffness")
    evidence = recorded(start.with_si({"reducer.stiffness": 5600.0}))
    monkeypatch.setattr("microvib.studies.identify.search._search_steady_states", lambda *_: [])
    monkeypatch.setattr("microvib.studies.identify.search.ALIKE", 0.0)
    fit = identify(start, [evidence], [few], starts=8)
    assert fit.method == STEADY_THEN_IN_TIME
    assert fit.estimates[0].estimate == pytest.approx(5600.0, rel=0.01)


@pytest.mark.parametrize("explained", [True, False])
def test_where_runs_jump_about_what_steady_states_lead_to_runs_are_looked_at(
    start: mv.Scenario, evidence: Evidence, monkeypatch: pytest.MonkeyPatch, explained: bool
) -> None:
    """What these lead to counts if it explains the evidence, and else what steady states led to."""
    problem = posed(start, evidence)
    looks = []

    def look_at_runs(asked: Problem, *_: object) -> list[Optimum]:
        x = asked.point(TRUTH) if explained else asked.start
        looks.append(Descent(asked, x).run(0))
        return looks

    monkeypatch.setattr("microvib.studies.identify.search.figures_jump", lambda *_: True)
    monkeypatch.setattr("microvib.studies.identify.search._search_round", look_at_runs)
    asked, optima = search(problem, 1, 8, 1)
    assert len(looks) == 1
    assert goodness(asked, looks[0].r).explained == explained
    assert goodness(asked, optima[0].r).explained
    assert (optima[0].cost == looks[0].cost) == explained
