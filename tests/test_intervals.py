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
from microvib.studies.identify.problem import PHASE_FLOOR, Problem, total_standard_deviation
from microvib.studies.identify.search import RESTART_STEPS, Descent, linearise_at

pytestmark = pytest.mark.long
KEYS = ("reducer.stiffness", "motor.friction.viscous", "array.rigid_inertia")
RECORDINGS = 12


def wrong(o, random, reference):
    """A figure as another test of the same drive might give it; the phase of ``drive_1`` is wrong by
    ``reference`` [rad], and those that are relative to it by as many times that.
    """
    error = total_standard_deviation(o, MODEL_ERROR) * random.normal()
    if o.form == "phase":
        return replace(o, value=o.value + error - int(o.line[-1]) * reference)
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
        reference = PHASE_FLOOR * random.normal()
        off = tuple(wrong(o, random, reference) for o in figures)
        made = Evidence("made", off, None, 4.0, truth.record.sample_rate)
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


def test_shared_errors_of_a_recording_count_with_their_whole_covariance():
    truth = baseline().with_si({"record.settle": 2.0, "record.duration": 4.0})
    torque = mv.simulate(truth, channels=("T_d",))["T_d"]
    table = lines_of_samples(torque, truth.record.sample_rate, truth, measured=True)
    made = Evidence("made", observations(table), None, 4.0, truth.record.sample_rate)
    keys = [parse_fit(truth, key) for key in KEYS]
    problem = Problem(truth, [(made, {})] * 2, keys, ErrorModel(MODEL_ERROR, common=0.01))
    assert problem.shared.shape == (problem.figures, 4)  # scale, and drive_1's phase, of both
    covariance = np.diag(problem.weights**2) + problem.shared @ problem.shared.T
    d = np.random.default_rng(3).normal(0.0, 0.02, (5, problem.figures))
    expected = [row @ np.linalg.solve(covariance, row) for row in d]
    r = np.concatenate(problem.weighted(d), axis=-1)
    assert np.sum(r**2, axis=-1) == pytest.approx(expected, rel=1e-9)
    # whole turns of an angle are none, whatever is shared
    turned = d.copy()
    turned[:, [o.is_angle for _, o in problem.observed]] += math.tau
    there = np.concatenate([*problem.weighted(turned), np.ones((5, 3))], axis=-1)
    same = np.concatenate([r, np.ones((5, 3))], axis=-1)
    assert problem.least(there) == pytest.approx(same, abs=1e-8)
