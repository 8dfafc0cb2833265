"""The least misfit where no fit explains the evidence: found whatever error is stated, and wherever a search ended."""

import math
from dataclasses import replace

import numpy as np
import pytest

import microvib as mv
from microvib.studies.evidence import evidence_of
from microvib.studies.identify import parse_fit
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.problem import ErrorModel, Problem, cost
from microvib.studies.identify.search import Optimum, least_misfit
from microvib.testdata.recording import Recording

KEYS = ("reducer.stiffness", "reducer.damping", "motor.friction.viscous", "array.rigid_inertia")
LINES = 0.02
"""Standard deviation of the amplitudes' errors."""
DRAW = [79, 1]
"""Of the drives drawn so far, one whose search ended at 250 times the least misfit."""


@pytest.fixture(scope="module")
def made():
    """A drive whose friction remembers, so that its motion is sensitive, and a recording with errors of its lines."""
    random = np.random.default_rng(DRAW)
    rate, stiffness = np.exp(random.uniform(np.log([0.02, 4e3]), np.log([0.1, 1.2e4])))
    record = {"tracking.rate": math.radians(rate), "record.settle": 3.0, "record.duration": 4.0}
    model = mv.load_scenario("state-1").with_si(
        {**record, "friction.presliding": {"stiffness": float(stiffness)}}
    )
    truth = {key: float(model[key]) * math.exp(random.uniform(-0.7, 0.7)) for key in KEYS}
    truth["reducer.damping"] = float(model["reducer.damping"]) * math.exp(random.uniform(0.0, 2.5))
    torque = mv.simulate(model.with_si(truth), channels=("T_d",))["T_d"]
    recording = Recording(
        {"Mz": torque + random.normal(0.0, 1e-5, torque.size)}, 4096.0, {"Mz": "N*m"}, "made"
    )
    one = evidence_of(recording, model)
    wrong = [
        replace(o, value=o.value * math.exp(LINES * random.normal()))
        if o.form == "amplitude"
        else o
        for o in one.observations
    ]
    kept = tuple(o for o in wrong if (o.line, o.form) != ("array_mode_1", "amplitude"))
    return model, truth, replace(one, observations=kept)


def posed(made, model_error):
    model, _, evidence = made
    return Problem(
        model, [(evidence, {})], [parse_fit(model, key) for key in KEYS], ErrorModel(model_error)
    )


def at(problem, values):
    x = problem.point(values)
    (r,) = problem.residuals([x])
    return Optimum(x, r, cost(r))


@pytest.mark.release
@pytest.mark.parametrize(
    "model_error",
    [0.004, 0.0004],
)
def test_the_least_misfit_is_found_from_a_corner_whatever_error_is_stated(made, model_error):
    problem, truth = posed(made, model_error), made[1]
    least = goodness(problem, at(problem, truth).r).chi_square
    off = {"reducer.damping": 0.07, "motor.friction.viscous": 1.12, "array.rigid_inertia": 1.09}
    corner = at(problem, {key: value * off.get(key, 1.0) for key, value in truth.items()})
    assert goodness(problem, corner.r).chi_square > 20.0 * least
    found, optima = least_misfit(problem, [corner], seed=1)
    assert goodness(found, optima[0].r).chi_square < 1.02 * least
    if model_error > 0.1 * LINES:
        values = found.named(optima[0].x)
        assert [values[key] / truth[key] for key in KEYS] == pytest.approx(np.ones(4), rel=0.1)
    else:  # so far from the errors that the lines have, the least misfit need not be near the truth
        assert goodness(found, optima[0].r).chi_square < least
