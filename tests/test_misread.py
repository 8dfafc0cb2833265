"""Recordings of another sign, unit or axis: no model explains them, and what would is told."""

from dataclasses import replace

import numpy as np
import pytest
from support.tiers import at_a_release

import microvib as mv
from microvib.studies.evidence import evidence_of
from microvib.studies.identify import ErrorModel, identify, parse_fit
from microvib.studies.identify.fit import without_start_dependence
from microvib.studies.identify.misread import diagnose_units_signs
from microvib.studies.identify.problem import Problem, cost
from microvib.studies.identify.scattered import is_noisy
from microvib.studies.identify.search import Optimum, linearise_at
from microvib.testdata.recording import Recording


@pytest.fixture(scope="module")
def short():
    return mv.load_scenario("state-1").with_si({"record.settle": 1.0, "record.duration": 4.0})


@pytest.fixture(scope="module")
def torque(short):
    x = mv.simulate(short.with_si({"reducer.stiffness": 5300.0}), channels=("T_d",))["T_d"]
    return x + np.random.default_rng(1).normal(0.0, 2e-4, x.size)


def posed(model, channels):
    recording = Recording(channels, 4096.0, dict.fromkeys(channels, "N*m"), title="made")
    keys, trust = [parse_fit(model, "reducer.stiffness")], ErrorModel(0.004)
    tests, _ = without_start_dependence([(evidence_of(recording, model), {})], model, keys, trust)
    return Problem(model, tests, keys, trust)


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (-1.0, "with its sign reversed the model"),
        at_a_release(1e3, "divided by 1000, as in mN*m taken for N*m, the model"),
        at_a_release(1.0 / 0.112985, "divided by 8.85073, as in lbf*in taken for N*m, the model"),
        (
            -1e-3,
            "with its sign reversed and multiplied by 1000, as in N*m taken for mN*m, the model",
        ),
        (1.7, "divided by 1.7 the model"),
    ],
)
def test_a_channel_of_another_sign_or_unit_is_told(short, torque, factor, said):
    (one,) = diagnose_units_signs(posed(short, {"Mz": factor * torque}))
    assert one == f"made: {said} explains it; check order, sign and unit of Mz."


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_samples_in_reverse_order_are_told(short, torque, sign):
    (one,) = diagnose_units_signs(posed(short, {"Mz": sign * torque[::-1]}))
    what = "its time" if sign > 0.0 else "its sign and time"
    assert (
        one
        == f"made: with {what} reversed the model explains it; check order, sign and unit of Mz."
    )


def test_a_channel_that_is_right_is_not(short, torque):
    assert diagnose_units_signs(posed(short, {"Mz": torque})) == ()


@pytest.mark.release
def test_another_axis_is_told(short, torque):
    noise = np.random.default_rng(2).normal(0.0, 2e-4, torque.size)
    other = 5.0 * np.gradient(torque) + noise
    (one,) = diagnose_units_signs(posed(short, {"Mz": other, "Mx": noise, "My": torque}))
    assert one == "made: the model explains My in place of Mz; check the drive axis."
    (one,) = diagnose_units_signs(posed(short, {"Mz": other, "Mx": -torque}))
    assert (
        one
        == "made: the model explains Mx in place of Mz, with its sign reversed; check the drive axis."
    )


def test_phases_that_are_half_a_turn_off_are_no_figures_that_scatter(short, torque):
    """Half a turn either way is the same: figures seem to jump there, and a regression would take them for random."""
    problem = posed(short.with_si({"reducer.stiffness": 5300.0}), {"Mz": -torque})
    (r,) = problem.residuals([problem.start])
    best = Optimum(problem.start, r, cost(r))
    assert not is_noisy(problem, best, linearise_at(problem, best))


def test_a_fit_to_a_reversed_recording_says_so(short, torque):
    fit = identify(
        short,
        [Recording({"Mz": -torque}, 4096.0, {"Mz": "N*m"}, title="made")],
        ["reducer.stiffness"],
        starts=3,
    )
    assert not fit.goodness.explained
    assert "with its sign reversed the model explains it" in fit.notes[0]


@pytest.mark.release
def test_the_least_misfit_and_the_error_that_would_explain_are_told(short, torque):
    """Of amplitudes that are wrong by 3 % where 0.4 % was stated."""
    one = evidence_of(Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, title="made"), short)
    random = np.random.default_rng(4)
    wrong = [
        o if o.form != "amplitude" else replace(o, value=o.value * random.lognormal(0.0, 0.03))
        for o in one.observations
    ]
    fit = identify(
        short, [replace(one, observations=tuple(wrong))], ["reducer.stiffness"], starts=3
    )
    assert not fit.goodness.explained
    assert fit.converged
    assert fit.estimates[0].estimate == pytest.approx(5300.0, rel=0.03)
    (told,) = (note for note in fit.notes if "model_error" in note)
    error = float(told.removeprefix("At a model_error of ").split(" percent")[0])
    assert 0.4 < error < 4.0
    assert ", in place of 0.4 percent, it would explain them" in told
