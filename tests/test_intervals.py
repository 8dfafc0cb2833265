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
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.intervals import Z_95, profiles
from microvib.studies.identify.problem import (
    PHASE_FLOOR,
    TORQUE_FORMS,
    Problem,
    total_standard_deviation,
)
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


def of_one_chain(log_gain=lambda f: 0.0):
    """Lines of one drive, twice, by a chain whose gain errs by ``log_gain`` of the frequency; and that
    of each figure.
    """
    truth = baseline().with_si({"record.settle": 2.0, "record.duration": 4.0})
    torque = mv.simulate(truth, channels=("T_d",))["T_d"]
    table = lines_of_samples(torque, truth.record.sample_rate, truth, measured=True)
    at = {x.name: x.frequency for x in table}
    figures = tuple(
        replace(o, value=o.value * math.exp(log_gain(at[o.line]))) if o.form in TORQUE_FORMS else o
        for o in observations(table)
    )
    made = Evidence("made", figures, None, 4.0, truth.record.sample_rate)

    def problem(trust):
        return Problem(truth, [(made, {})] * 2, [parse_fit(truth, KEYS[0])], trust)

    return problem, np.array([at[o.line] for _ in range(2) for o in figures])


def test_errors_of_a_chain_are_alike_at_near_frequencies_and_in_all_recordings():
    """Their covariance in closed form; figures other than amplitudes have none."""
    problem, f = of_one_chain()
    alone, its = (problem(ErrorModel(MODEL_ERROR, chain=x, chain_width=3.0)) for x in (0.0, 0.02))
    more = its.shared[:, : its.shared.shape[1] - alone.shared.shape[1]]
    sizes = np.array([o.form in TORQUE_FORMS for _, o in its.observed])
    expected = 4e-4 * np.exp(-0.5 * (np.subtract.outer(f, f) / 3.0) ** 2)
    expected[~sizes] = expected[:, ~sizes] = 0.0
    # a mode's line is where it was measured, the others where the clock has them
    assert more @ more.T == pytest.approx(expected, abs=4e-4 * 1e-3)
    near = np.abs(np.subtract.outer(f[sizes], f[sizes]))
    assert np.any((near > 0.5) & (near < 6.0))  # some share a part
    assert its.weights == pytest.approx(alone.weights)


def test_a_recording_by_a_chain_whose_gain_errs_is_explained_where_that_is_stated():
    def ripple(f):
        return 0.03 * math.sin(f / 15.0)

    problem, _ = of_one_chain(ripple)

    def ratio(trust):
        its = problem(trust)
        return goodness(its, its.residuals([its.start])[0])

    assert not ratio(ErrorModel(MODEL_ERROR)).explained
    assert ratio(ErrorModel(MODEL_ERROR, chain=0.03, chain_width=10.0)).explained


def test_an_error_that_lines_share_is_no_reason_to_know_their_sum_better():
    """Of one line in two recordings by one chain the mean is as uncertain as the chain; the difference
    is as certain as if there were none.
    """
    problem, _ = of_one_chain()
    its = problem(ErrorModel(MODEL_ERROR, chain=0.02))
    k = next(k for k, (_, o) in enumerate(its.observed) if o.form in TORQUE_FORMS)
    pair = [k, k + its.figures // 2]
    covariance = (np.diag(its.weights**2) + its.shared @ its.shared.T)[np.ix_(pair, pair)]
    assert np.array([0.5, 0.5]) @ covariance @ [0.5, 0.5] > 0.02**2
    assert np.array([1.0, -1.0]) @ covariance @ [1.0, -1.0] == pytest.approx(
        2.0 * its.weights[k] ** 2
    )
