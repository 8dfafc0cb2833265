"""Whole numbers that are identified: each that may be is tried, and those that explain the evidence as well are told."""

import math

import numpy as np
import pytest

import microvib as mv
from microvib.errors import MicrovibError, OptionError
from microvib.reports.identification import fit_json, fit_outcome
from microvib.reports.outcome import terminal_text
from microvib.studies.identify import ErrorModel, IntegerKey, identify, parse_key
from microvib.studies.identify.keys import DAC_BITS, FitKey
from microvib.studies.identify.selection import Selector
from microvib.testdata.recording import Recording


@pytest.fixture(scope="module")
def short():
    return mv.load_scenario("state-1").with_si({"record.settle": 1.0, "record.duration": 4.0})


def recorded(scenario):
    x = mv.simulate(scenario, channels=("T_d",))["T_d"]
    noise = np.random.default_rng(1).normal(0.0, 2e-4, x.size)
    return Recording({"Mz": x + noise}, 4096.0, {"Mz": "N*m"}, title="made")


@pytest.fixture(scope="module")
def rounded(short):
    """A recording of a driver with 9 bits, on another gear."""
    return recorded(short.with_si({DAC_BITS: 9, "reducer.stiffness": 5400.0}))


def test_a_whole_number_is_given_as_those_that_may_be(short):
    assert parse_key(short, DAC_BITS) == IntegerKey(DAC_BITS, 4, 14)
    key = parse_key(short, f"{DAC_BITS} = 6:10")
    assert isinstance(key, IntegerKey)
    assert list(key.numbers) == [6, 7, 8, 9, 10]
    assert isinstance(parse_key(short, "friction.slip_ring.contact_pairs=310:330"), IntegerKey)
    assert isinstance(parse_key(short, "reducer.stiffness"), FitKey)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("friction.slip_ring.contact_pairs", "is an integer; give its range, friction"),
        (f"{DAC_BITS}=8", "write KEY=LOW:HIGH with whole numbers"),
        (f"{DAC_BITS}=8.5:9", "write KEY=LOW:HIGH with whole numbers"),
        (f"{DAC_BITS}=10:8", "LOW below HIGH"),
        ("friction.slip_ring.contact_pairs=1:100", "at most 32 of them"),
        (f"{DAC_BITS}=8:30", "30 is not allowed"),
        ("driver.microsteps=8:32", "sets the step clock"),
    ],
)
def test_a_range_of_whole_numbers_that_cannot_be_is_refused(short, text, said):
    with pytest.raises(OptionError, match=f"^fit .*{said}"):
        parse_key(short, text)


def test_a_whole_number_is_one_in_all_recordings_and_never_alone(short, rounded):
    both = [rounded, rounded]
    with pytest.raises(
        MicrovibError,
        match=r"^share driver\.imperfections\.dac_bits: is an integer with one value",
    ):
        identify(short, both, ["reducer.stiffness", DAC_BITS], share=["reducer.stiffness"])
    with pytest.raises(MicrovibError, match="fit a continuous parameter with it"):
        identify(short, [rounded], [DAC_BITS])
    with pytest.raises(
        MicrovibError,
        match=r"^select driver\.imperfections\.dac_bits: is fitted, so it is no candidate",
    ):
        identify(short, [rounded], ["reducer.stiffness", DAC_BITS], select=[DAC_BITS])


@pytest.mark.release
def test_bits_are_identified_beside_a_stiffness(short, rounded):
    fit = identify(
        short, [rounded], ["reducer.stiffness", f"{DAC_BITS}=8:10"], starts=8, finishes=1
    )
    (stiffness,), (bits,) = fit.estimates, fit.whole
    assert stiffness.interval[0] < 5400.0 < stiffness.interval[1]
    assert bits.estimate == 9
    assert bits.identifiable
    assert bits.interval == (9, 9)
    assert math.isnan(bits.standard_error)
    assert fit.scenario[DAC_BITS] == 9
    assert fit.scenario.sources[DAC_BITS] == "identified from made: 9"
    text = terminal_text(fit_outcome(fit))
    (row,) = [line for line in text.splitlines() if line.startswith(DAC_BITS)]
    assert row.split()[1:] == ["9", "-", "9", "9", "identifiable"]
    assert fit_json(fit)["parameters"][DAC_BITS]["confidence_95"] == [9, 9]


@pytest.mark.filterwarnings("error::UserWarning")
def test_bits_that_the_evidence_does_not_tell_apart_are_told(short):
    """Of references that are not rounded, 12 bits or more are no others."""
    fit = identify(
        short, [recorded(short)], ["reducer.stiffness", f"{DAC_BITS}=11:14"], starts=6, finishes=1
    )
    (bits,) = fit.whole
    assert not bits.identifiable
    assert "explain the data as well" in bits.verdict or "explains the data as well" in bits.verdict
    assert bits.interval[1] == 14


@pytest.mark.release
def test_rounding_is_asked_for_where_it_is_and_not_where_it_is_not(short, rounded):
    from microvib.studies.evidence import evidence_of
    from microvib.studies.identify.fit import without_start_dependence

    for recording, expected in ((rounded, True), (recorded(short), False)):
        keys, trust = [parse_key(short, "reducer.stiffness")], ErrorModel(0.004)
        tests, _ = without_start_dependence(
            [(evidence_of(recording, short), {})], short, keys, trust
        )
        scenario, _, _, (told,) = Selector(short, tests, keys, [DAC_BITS], trust, 1, 8, None).run()
        assert told.selected is expected
        assert told.parameters == 1
        assert told.limit > 6.0  # of eleven candidates
        assert scenario[DAC_BITS] == (9 if expected else None)
