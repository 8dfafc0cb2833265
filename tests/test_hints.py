"""What a fit says of a model that lacks something: rounding of the references, a motion of another period."""

import numpy as np
import pytest

import microvib as mv
from microvib.errors import OptionError
from microvib.studies.evidence import evidence_of
from microvib.studies.identify import parse_fit
from microvib.studies.identify.goodness import deviations
from microvib.studies.identify.hints import hints
from microvib.studies.identify.problem import Problem, Trust
from microvib.testdata.recording import Recording


@pytest.fixture(scope="module")
def short():
    return mv.load_scenario("state-1").with_si({"record.settle": 4.0, "record.duration": 8.0})


def said(model, torque):
    """Hints on a model, of a recording of a torque."""
    recording = Recording({"Mz": torque}, 4096.0, {"Mz": "N*m"}, title="made")
    one = evidence_of(recording, model)
    problem = Problem(model, [(one, {})], [parse_fit(model, "reducer.stiffness")], Trust(0.004))
    after = problem.lines(problem.start)
    return hints(problem.tests, after, deviations(problem, problem.start))


def torque_of(scenario):
    return mv.simulate(scenario, channels=("T_d",))["T_d"]


def test_lines_of_rounded_references_are_told_and_no_others(short):
    rounding = short.with_si({"driver.imperfections.dac_bits": 8})
    torque = torque_of(rounding)
    (one,) = said(short, torque)
    assert one.startswith("full_step_")
    assert "driver.imperfections.dac_bits is not fitted: set each number of bits" in one
    assert said(rounding, torque) == ()
    gain = short.with_si({"driver.imperfections.gain_b": 0.02})  # makes electrical_2, and is fitted
    assert said(short, torque_of(gain)) == ()


@pytest.mark.parametrize(("part", "word"), [(2, "second"), (3, "third")])
def test_a_motion_of_another_period_is_told(short, part, word):
    torque = torque_of(short)
    t = np.arange(torque.size) / 4096.0
    (one,) = said(short, torque + 3e-3 * np.cos(2 * np.pi * short.driving_frequency / part * t))
    assert f"made: the recording's motion repeats every {word} microstep, the model's does not" in one
    assert "3 and 0.00" in one


@pytest.mark.parametrize(
    "key", ["driver.imperfections.dac_bits", "driver.microsteps", "friction.slip_ring.contact_pairs"]
)
def test_whole_numbers_are_set_and_not_fitted(short, key):
    with pytest.raises(
        OptionError, match="is a whole number, which is set and not fitted; identify with each that may be"
    ):
        parse_fit(short, key)
