"""What a fit says of a model that lacks something: rounding of the references, a motion of another period."""

import numpy as np
import pytest

import microvib as mv
from microvib.studies.evidence import Evidence, Observation, evidence_of, subharmonic_amplitudes
from microvib.studies.identify import IntegerKey, parse_fit
from microvib.studies.identify.goodness import deviations
from microvib.studies.identify.hints import MIN_SUBHARMONIC_RATIO, model_deficiency_hints
from microvib.studies.identify.intervals import Z_95, Interval, profiles
from microvib.studies.identify.lacking import UnmodelledEffect
from microvib.studies.identify.problem import ErrorModel, Problem, cost
from microvib.studies.identify.search import LinearModel, Optimum, linearise_at
from microvib.studies.identify.verdict import Findings, IntegerResult, estimate
from microvib.testdata.recording import Recording


@pytest.fixture(scope="module")
def short():
    return mv.load_scenario("state-1").with_si({"record.settle": 4.0, "record.duration": 8.0})


def posed(model, torque):
    """The problem of a stiffness, of a recording of a torque."""
    recording = Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, title="made")
    one = evidence_of(recording, model)
    return Problem(model, [(one, {})], [parse_fit(model, "reducer.stiffness")], ErrorModel(0.004))


def said(model, torque):
    """Hints on a model, of a recording of a torque."""
    problem = posed(model, torque)
    after = problem.lines(problem.start)
    return model_deficiency_hints(problem.tests, after, deviations(problem, problem.start))


def judged(problem):
    """Verdict on the start, as if a search had converged there and explained everything."""
    best = Optimum(problem.start, np.zeros(problem.figures + 1), 0.0)
    local = LinearModel(np.ones((problem.figures + 1, 1)), np.array([[1e-4]]), 1.0)
    found = Findings(problem, best, local, True, (Interval(best.x[0] - 0.02, best.x[0] + 0.02),))
    return estimate(found, 0).verdict


def test_fewer_figures_than_parameters_identify_none_of_them(short):
    """Ranges and the prior would tell the rest, and they are no evidence."""
    rows = tuple(Observation(name, "amplitude", 0.01, 1e-4) for name in ("drive_1", "drive_2"))
    keys = [
        parse_fit(short, key)
        for key in ("reducer.stiffness", "reducer.damping", "array.rigid_inertia")
    ]

    def verdict(figures, fitted, wholes=0):
        tests = [(Evidence("made", rows[:figures], 1.0, 8.0, 4096.0), {})]
        problem, m = Problem(short, tests, keys[:fitted], ErrorModel(0.004)), fitted
        best = Optimum(problem.start, np.zeros(figures + m), 0.0)
        local = LinearModel(np.ones((figures + m, m)), 1e-4 * np.eye(m), 1.0)
        intervals = tuple(Interval(x - 0.02, x + 0.02) for x in best.x)
        whole = (
            IntegerResult(IntegerKey("driver.imperfections.dac_bits", 4, 14), 8, (8,)),
        ) * wholes
        found = Findings(problem, best, local, True, intervals, whole=whole)
        return estimate(found, 0).verdict

    assert verdict(2, 3) == "not identifiable: 2 figures cannot tell 3 parameters; fit fewer"
    assert (
        verdict(1, 1, wholes=1) == "not identifiable: 1 figure cannot tell 2 parameters; fit fewer"
    )
    assert verdict(2, 2) == "identifiable, if the model holds"


def test_what_the_model_lacks_is_held_against_the_interval_of_a_profile(short):
    """Beside a null slopes tell so little that the linearised standard error hides any shift."""
    rows = tuple(Observation(name, "amplitude", 0.01, 1e-4) for name in ("drive_1", "drive_2"))
    tests = [(Evidence("made", rows, 1.0, 8.0, 4096.0), {})]
    problem = Problem(short, tests, [parse_fit(short, "reducer.stiffness")], ErrorModel(0.004))
    best = Optimum(problem.start, np.zeros(3), 0.0)
    local = LinearModel(np.full((3, 1), 1e-2), np.array([[1.0]]), 1.0)
    interval = Interval(best.x[0] - 0.02, best.x[0] + 0.02, profiled=True)
    found = Findings(
        problem,
        best,
        local,
        True,
        (interval,),
        lacking=(UnmodelledEffect("friction.presliding", (0.1,)),),
    )
    assert "does not rule out friction.presliding" in estimate(found, 0).verdict


def torque_of(scenario):
    return mv.simulate(scenario, channels=("T_d",))["T_d"]


def test_lines_of_rounded_references_are_told_and_no_others(short):
    rounding = short.with_si({"driver.imperfections.dac_bits": 8})
    torque = torque_of(rounding)
    (one,) = said(short, torque)
    assert one.startswith("full_step_")
    assert "fit driver.imperfections.dac_bits, too" in one
    assert said(rounding, torque) == ()
    gain = short.with_si({"driver.imperfections.gain_b": 0.02})  # makes electrical_2, and is fitted
    assert said(short, torque_of(gain)) == ()


def test_without_torque_noise_nothing_is_identified_where_the_floor_allows_it(short):
    """It lowers driving lines by a tenth, since it frees what sticks; noise of the instrument is another thing."""
    noisy = short.with_si({"friction.torque_noise": {"density": 2e-6, "seed": 3}})
    torque = torque_of(noisy)
    (one,) = said(short, torque)
    assert "may be torque noise of some 8e-07 N^2*m^2/Hz" in one
    problem = posed(short, torque)
    assert 0.5e-6 < problem.tests[0][0].noise < 2e-6  # where the shaft sticks it swallows some
    assert judged(problem).startswith("not identifiable without friction.torque_noise")
    instrument = np.random.default_rng(1).normal(0.0, 5e-3, torque.size)
    assert not any(
        "torque noise" in sentence for sentence in said(short, torque_of(short) + instrument)
    )
    assert posed(noisy, torque).tests[0][0].noise == 0.0  # known, and sought by its levels


@pytest.mark.parametrize(("part", "word"), [(2, "second"), (3, "third")])
def test_a_motion_of_another_period_is_told(short, part, word):
    torque = torque_of(short)
    t = np.arange(torque.size) / 4096.0
    other = torque + 3e-3 * np.cos(2 * np.pi * short.driving_frequency / part * t)
    (one,) = said(short, other)
    assert (
        f"made: the recording's motion repeats every {word} microstep, the model's does not" in one
    )
    assert "3 and 0.00" in one
    assert judged(posed(short, torque)).startswith("identifiable")
    assert judged(posed(short, other)).startswith(
        "not identifiable: the model's motion repeats after another number"
    )


def test_what_the_evidence_does_not_tell_costs_one_point_of_a_profile_to_each_side(short):
    """A gain in the evidence of the full step alone, which hardly knows it: the interval is open to both ends at once."""
    seen = Observation("full_step_1", "amplitude", 5.07e-3, 2e-3)
    one = Evidence("made", (seen,), None, 8.0, 4096.0)
    problem = Problem(
        short, [(one, {})], [parse_fit(short, "driver.imperfections.gain_b")], ErrorModel(0.004)
    )
    (r,) = problem.residuals([problem.start])
    best = Optimum(problem.start, r, cost(r))
    local = linearise_at(problem, best)
    before = problem.best_so_far.simulations
    (interval,) = profiles(problem, best, local).intervals
    assert interval.open_low
    assert interval.open_high
    assert (interval.low, interval.high) == pytest.approx((problem.low[0], problem.high[0]))
    assert problem.best_so_far.simulations <= before + 2


def test_an_interval_ends_where_its_profile_rises_however_flat_that_is_at_the_best(short):
    """As beside the null of a line, where slopes tell nothing and figures a little further much."""

    class Bent(Problem):
        def residuals(self, points, also=()):
            return [np.array([((x[0] - self.start[0]) / 0.1) ** 3, 0.0]) for x in points]

    seen = Observation("full_step_1", "amplitude", 5.07e-3, 2e-3)
    tests = [(Evidence("made", (seen,), None, 8.0, 4096.0), {})]
    problem = Bent(short, tests, [parse_fit(short, "reducer.stiffness")], ErrorModel(0.004))
    best = Optimum(problem.start, np.zeros(2), 0.0)
    local = LinearModel(np.array([[1e-3], [0.0]]), np.array([[1e6]]), 1.0)
    (interval,) = profiles(problem, best, local).intervals
    reach = 0.1 * Z_95 ** (1.0 / 3.0)
    assert (interval.low, interval.high) == pytest.approx(
        (best.x[0] - reach, best.x[0] + reach), abs=0.05 * reach
    )
    assert interval.profiled
    assert not interval.open_low
    assert not interval.open_high


def test_noise_at_a_part_of_the_driving_frequency_is_no_motion_of_another_period(short):
    """Where driving lines are small, a bin of noise is more than a fiftieth of them."""
    torque = 0.02 * torque_of(short)
    noise = np.random.default_rng(2).normal(0.0, 4e-3, torque.size)
    part = subharmonic_amplitudes(torque + noise, 4096.0, short.driving_frequency)
    assert part[1] > MIN_SUBHARMONIC_RATIO * part[0]
    assert not any("repeats every" in sentence for sentence in said(short, torque + noise))
