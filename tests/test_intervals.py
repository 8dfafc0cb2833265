"""Intervals of identified parameters, on figures that are wrong by random parts of the size stated for them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.scenarios import baseline

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.studies.evidence import Evidence, observations
from microvib.studies.identify import MODEL_ERROR, ErrorModel, parse_fit
from microvib.studies.identify.intervals import Z_95, profiles
from microvib.studies.identify.problem import Problem, total_standard_deviation
from microvib.studies.identify.search import RESTART_STEPS, Descent, linearise_at

pytestmark = pytest.mark.long
KEYS = ("reducer.stiffness", "motor.friction.viscous", "array.rigid_inertia")
RECORDINGS = 12


def wrong(o, random):
    """A figure as another test of the same drive might give it."""
    error = total_standard_deviation(o, MODEL_ERROR) * random.normal()
    if o.form == "phase":
        return replace(o, value=o.value + error)
    return replace(
        o, value=o.value * math.exp(error) if o.form == "amplitude" else o.value * (1.0 + error)
    )


@pytest.fixture(scope="module")
def errors():
    """Deviations from the truth over the standard errors that the intervals state, (recordings, parameters)."""
    truth = baseline().with_si({"record.settle": 2.0, "record.duration": 4.0})
    torque = mv.simulate(truth, channels=("T_d",))["T_d"]
    table = lines_of_samples(torque, truth.record.sample_rate, truth, measured=True)
    figures = [
        o for o in observations(table) if o.line.startswith("drive_") and o.line.count("_") == 1
    ]
    random = np.random.default_rng(4)
    found = []
    for _ in range(RECORDINGS):
        made = Evidence(
            "made", tuple(wrong(o, random) for o in figures), None, 4.0, truth.record.sample_rate
        )
        problem = Problem(
            truth, [(made, {})], [parse_fit(truth, key) for key in KEYS], ErrorModel(MODEL_ERROR)
        )
        best = Descent(problem, problem.start).run(RESTART_STEPS)
        intervals = profiles(problem, best, linearise_at(problem, best)).intervals
        found.append(
            [
                (x - x0) / ((i.high - i.low) / (2.0 * Z_95))
                for x, x0, i in zip(best.x, problem.start, intervals, strict=True)
            ]
        )
    return np.array(found)


def test_intervals_hold_the_truth_as_often_as_they_say(errors):
    """Mean squares of such errors scatter by 0.24 about 1; of intervals half as wide, about 4."""
    assert 0.4 < np.mean(errors**2) < 1.8
    assert np.mean(np.abs(errors) <= Z_95) >= 0.85
