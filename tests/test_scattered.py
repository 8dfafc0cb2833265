"""Estimates from figures that scatter: intervals, what is not told, and where a motion is sensitive."""

import math

import numpy as np
import pytest

import microvib as mv
from microvib.studies.evidence import Evidence, Observation
from microvib.studies.identify import ErrorModel, identify, parse_fit
from microvib.studies.identify.problem import Problem, cost
from microvib.studies.identify.scattered import is_noisy, noisy_objective
from microvib.studies.identify.search import Optimum, linearise_at
from microvib.testdata.recording import Recording

KEYS = ("reducer.stiffness", "motor.friction.viscous")
FIGURES, SCATTER = 12, 1.5
LATE = 0.8
"""What a later start does to the figures: as if the first parameter were larger by that power of the time."""


class Made(Problem):
    """Figures that bend a little over the parameters and scatter by SCATTER, in deviations of the recording's own error."""

    def made(self, slopes: np.ndarray, seed: int) -> Optimum:
        """With another recording's errors; where a search may have ended."""
        self.random, self.slopes = np.random.default_rng(seed), slopes
        self.truth = self.start + 0.03
        self.errors = self.random.normal(size=FIGURES) + SCATTER * self.random.normal(size=FIGURES)
        x = self.truth + 0.02 * self.random.normal(size=self.truth.size)
        (r,) = self.residuals([x])
        return Optimum(x, r, cost(r))

    def residuals(self, points, also=()):
        found, settle = [], self.scenario.record.settle
        for x, (own,) in zip(points, also or [[{}]] * len(points), strict=True):
            off = x - self.truth
            off[0] += LATE * math.log(own.get("record.settle", settle) / settle)
            r = (
                self.slopes @ (off + 0.3 * off**2)
                + SCATTER * self.random.normal(size=FIGURES)
                - self.errors
            )
            found.append(
                np.append(r / (self.weights / self.tight), 0.1 * (x - self.start) / self.spans)
            )
        return found

    def within(self, x):
        return self


@pytest.fixture(scope="module")
def problem(state_1):
    rows = tuple(Observation(f"line_{k}", "amplitude", 0.01, 1e-4) for k in range(FIGURES))
    return Made(
        state_1,
        [(Evidence("made", rows, 1.0, 16.0, 4096.0), {})],
        [parse_fit(state_1, key) for key in KEYS],
        ErrorModel(0.0),
    )


def test_intervals_of_figures_that_scatter_hold_the_truth_as_often_as_they_say(problem):
    slopes = np.random.default_rng(0).normal(size=(FIGURES, 2)) * [60.0, 25.0]
    inside, off = [], []
    for seed in range(20):
        found = noisy_objective(problem, [problem.made(slopes, seed)])
        assert found.converged
        inside += [i.low < x < i.high for i, x in zip(found.intervals, problem.truth, strict=True)]
        off.append((found.best.x - problem.truth) / found.local.spread)
    assert 0.85 <= np.mean(inside) < 1.0
    assert 0.6 < np.mean(np.square(off)) < 1.5


def test_what_such_figures_do_not_tell_is_wide_open(problem):
    found = noisy_objective(problem, [problem.made(np.full((FIGURES, 2), [60.0, 0.0]), 1)])
    assert found.intervals[1].high - found.intervals[1].low > 1.0


def test_what_rests_on_the_settling_time_is_told_of_such_figures(problem):
    slopes = np.random.default_rng(0).normal(size=(FIGURES, 2)) * [60.0, 25.0]
    (late,) = noisy_objective(problem, [problem.made(slopes, 3)]).dependences
    assert late.key == "record.settle"
    assert late.shifts == pytest.approx((-LATE * math.log(1.1) / 0.1, 0.0), abs=0.15)


def test_friction_with_memory_makes_figures_jump_and_the_rigid_contact_does_not(state_1):
    short = state_1.with_si({"record.settle": 1.0, "record.duration": 2.0})
    names = ("drive_1", "drive_2", "drive_3", "drive_4", "drive_5", "full_step_1")
    rows = tuple(Observation(name, "amplitude", 0.01, 1e-6) for name in names)
    for presliding, expected in ((None, False), ({"stiffness": 8e3}, True)):
        drive = short.with_si({"friction.presliding": presliding})
        tests = [(Evidence("made", rows, 1.0, 2.0, 4096.0), {})]
        problem = Problem(drive, tests, [parse_fit(drive, "reducer.stiffness")], ErrorModel(0.004))
        (r,) = problem.residuals([problem.start])
        best = Optimum(problem.start, r, cost(r))
        assert is_noisy(problem, best, linearise_at(problem, best)) is expected


@pytest.mark.release
def test_a_presliding_stiffness_is_identified():
    """No search ends here: after a change by less than a thousandth lines are others by a per cent."""
    start = mv.load_scenario("state-1").with_si(
        {"friction.presliding": {"stiffness": 8e3}, "record.settle": 2.0, "record.duration": 8.0}
    )
    clock = 0.998 * start.tracking.clock_ratio
    drive = start.with_si({"friction.presliding.stiffness": 7e3, "tracking.clock_ratio": clock})
    x = mv.simulate(drive, channels=("T_d",))["T_d"]
    x = x + np.random.default_rng(1).normal(0.0, 2e-4, x.size)
    recording = Recording({"Mz": x}, 4096.0, {"Mz": "N*m"}, title="made")
    fit = identify(start, [recording], ["friction.presliding.stiffness"], starts=32)
    (found,) = fit.estimates
    assert found.identifiable
    assert found.interval[0] < 7e3 < found.interval[1]
    assert found.standard_error < 0.05 * found.estimate
    assert "the motion is sensitive" in fit.notes[-1]
