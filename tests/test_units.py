import importlib
import math
import pickle
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenarios import in_si

from microvib import units
from microvib.errors import (
    ChannelError,
    MicrovibError,
    ObjectError,
    OptionError,
    ScenarioError,
    SynchronismLost,
    error_context,
)
from microvib.model.part import Part
from microvib.units import Quantity, Si, convert


class Sample(Part):
    inertia: Annotated[float, Quantity("kg*m^2", "an inertia", gt=0, display="kg*cm^2")]
    frequency: Annotated[float, Quantity("Hz", "a frequency", ge=0)] = 1.0
    rate: Annotated[float, Quantity("rad/s", "a rate")] = 0.0


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.2 kg*cm^2", "kg*m^2", 2e-5),
        ("13 mH", "H", 13e-3),
        ("1 percent", "", 0.01),
        ("0.06 deg/s", "rad/s", math.radians(0.06)),
        ("6000 V/(A*s)", "V/A/s", 6000.0),
        ("1e3 N*m/rad", "N*m/rad", 1e3),
        ("1 N*m/deg", "N*m/rad", 180 / math.pi),
        ("2.5 kHz", "Hz", 2500.0),
        ("4 rpm", "rad/s", 4 * math.pi / 30),
        ("5 %", "", 0.05),
        ("−0.06 °/s", "rad/s", -math.radians(0.06)),
        ("6 Ω", "ohm", 6.0),
        ("13\u00a0mH", "H", 13e-3),
        ("0.3 V*s/rad", "N*m/A", 0.3),
        ("40 1/s", "s^-1", 40.0),
    ],
)
def test_units_are_converted(text, unit, value):
    assert convert(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    "error",
    [
        MicrovibError("a: is wrong", remedy="overwrite"),
        OptionError("limit", "must be positive", "-1 N*m", remedy="band"),
        SynchronismLost("lost", 1.5),
        ChannelError("channel 'x' is not in this motion"),
        ObjectError("1 is of type int; expected a scenario"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_come_back_from_other_processes_as_they_were(error):
    with pytest.raises(type(error)) as raised, error_context("b"):
        raise error
    back = pickle.loads(pickle.dumps(raised.value))
    assert type(back) is type(error)
    assert str(back) == f"b: {raised.value.args[0].removeprefix('b: ')}"
    assert vars(back) == vars(error)


@pytest.mark.parametrize(
    ("written", "unit", "value"),
    [
        *((text, "N*m", 1.0) for text in ("Nm", "N m", "N·m", "N.m", "N-m")),
        *((text, "N*m", 1e-3) for text in ("mNm", "Nmm", "mN m", "mN·m", "N mm")),
        *((text, "N*m", 10.0) for text in ("daNm", "kNcm")),
        *(
            (text, "kg*m^2", 1e-4)
            for text in ("kgcm2", "kgcm²", "kg·cm²", "kg cm^2", "kg*cm**2", "kg.cm2", "kg-cm²")
        ),
        *((text, "kg*m^2", 1e-7) for text in ("gcm2", "gcm²", "g·cm²", "g cm2")),
        *((text, "kg*m^2", 1.0) for text in ("kgm2", "kg m²", "kg·m^2")),
        *((text, "N*m*s/rad", 1.0) for text in ("Nms/rad", "N m s/rad", "Nm·s/rad", "Nms")),
        *((text, "V*s/A", 1.0) for text in ("Vs/A", "V s/A")),
        ("mNms/rad", "N*m*s/rad", 1e-3),
        ("Nm/°", "N*m/rad", 180 / math.pi),
        ("N/Hz^½", "N/Hz^0.5", 1.0),
        ("μH", "H", 1e-6),
        ("µH", "H", 1e-6),
        ("lbf·in", "N*m", 0.1129848290276167),
        ("in-lbf", "N*m", 0.1129848290276167),
        ("ozfin", "N*m", 0.1129848290276167 / 16),
    ],
)
def test_units_are_read_as_people_and_print_write_them(written, unit, value):
    assert convert(f"1 {written}", unit) == pytest.approx(value, rel=1e-12)
    assert convert(f"1{written}", unit) == convert(f"1 {written}", unit)


@pytest.mark.parametrize(
    ("text", "unit", "complaint"),
    [
        ("5", "kg*m^2", "needs a unit"),
        ("5 kg", "kg*m^2", "wrong dimension"),
        ("banana", "kg*m^2", "is not a quantity"),
        (
            "banana",
            "",
            "is not a number; write one without a unit, such as 0.5, or a percentage, such as '50 percent'",
        ),
        ("0,6 A", "A", "write a decimal point, not a comma"),
        ("0.6 A + 1 A", "A", "is not a quantity"),
        ("2 60 A", "A", "is not a quantity"),
        ("9**9**9 A", "A", "is not a quantity"),
        ("0.6 Ampelle", "A", "has an unknown unit, 'Ampelle'"),
        ("7 rad/s", "Hz", "mixes angles and cycles"),
        ("60 rpm", "Hz", "mixes angles and cycles"),
        ("1 Hz", "rad/s", "mixes cycles and angles"),
        ("5 percent", "rad", "is a percentage; an angle is expected here, in rad"),
        ("5 %/s", "rad/s", "is a percentage; an angle is expected here, in rad/s"),
        ("", "kg", "is not a quantity"),
        ("1 kg" * 100, "kg", "too long"),
        ("7 °/s", "Hz", "mixes angles and cycles"),
        ("7 turns/s", "Hz", "mixes angles and cycles"),
        ("7 cycles/s", "Hz", "mixes angles and cycles"),
        ("5 deg", "", "has one angle unit too many"),
        ("1 N*m*rad", "N*m/rad", "has one angle unit too many"),
        ("3 dB", "", "has a unit with an offset"),
        ("20 °C", "K", "has a unit with an offset"),
        ("1 As", "A", "wrong dimension"),
        ("1e999 A", "A", "is not finite"),
        ("-1e60 A", "A", "is too large"),
        ("1e-999 A", "A", "too small for a number"),
        ("nan A", "A", "is not finite"),
        ("1 A^9^9^9^9", "A", "unknown unit"),
        ("1 m*9^9^9^9", "m", "unknown unit"),
        ("1 A^123", "A", "unknown unit"),
    ],
)
def test_bad_quantities_are_named(text, unit, complaint):
    with pytest.raises(ValueError, match=complaint):
        convert(text, unit)


@pytest.mark.parametrize(
    "value", [0.0, -1.0, math.nan, math.inf, "nan kg*m^2", "-3 kg*m^2", True, None, [1.0], {}]
)
def test_what_is_out_of_range_or_no_number_is_refused(value):
    with pytest.raises(ScenarioError, match="an inertia"):
        in_si(Sample, inertia=value)


@given(st.floats(min_value=1e-12, max_value=1e12))
def test_formatted_quantities_read_back_to_the_same_value(value):
    quantity = Sample.quantity_of("inertia")
    assert convert(quantity.format(value), "kg*m^2") == value


def _parts(root=Part):
    for part in root.__subclasses__():
        if part.__module__.startswith("microvib."):
            yield part
        yield from _parts(part)


def _declared():
    """Every kind of quantity that a parameter of the project is."""
    for module in (
        "model.scenario",
        "structures.array_design",
        "structures.deck",
        "structures.simulator_design",
        "studies.campaign.study_file",
        "testdata.bench",
        "testdata.preparation",
    ):
        importlib.import_module(f"microvib.{module}")
    found = (part.quantity_of(name) for part in _parts() for name in part.model_fields)
    return list({(q.unit, q.display): q for q in found if q is not None}.values())


DECLARED = _declared()


@pytest.mark.parametrize("quantity", DECLARED, ids=lambda q: f"{q.unit}-{q.display}")
@settings(max_examples=25, deadline=None)
@given(value=st.floats(min_value=1e-9, max_value=1e9), sign=st.sampled_from([1.0, -1.0]))
def test_what_is_printed_of_any_parameter_is_read_back(quantity, value, sign):
    value *= sign
    assert convert(quantity.format(value), quantity.unit) == value
    shown = quantity.show(value)
    for text in (shown, shown.replace(" ", "\u00a0"), shown.replace("-", "−")):
        assert convert(text, quantity.unit) == pytest.approx(value, rel=1e-5)


def test_parameters_of_all_kinds_are_tried():
    assert len(DECLARED) > 25
    assert {"kg*m^2", "N*m*s/rad", "N/Hz^0.5", "kg^0.5*m", ""} <= {
        quantity.unit for quantity in DECLARED
    }


def test_numbers_of_any_size_and_kind():
    for number in (np.float32(2.5), np.int64(3)):
        assert in_si(Sample, inertia=number).inertia == float(number)
    with pytest.raises(ScenarioError, match="a number of 5000 digits is not finite"):
        in_si(Sample, inertia=10**5000)


def test_numbers_need_a_unit_or_to_be_said_to_be_in_si():
    assert in_si(Sample, inertia=2.0) == Sample(inertia=Si(2.0)) == Sample(inertia="2 kg*m^2")
    with pytest.raises(
        ScenarioError, match=r"inertia: 2\.0 needs a unit, such as '2\.0 kg\*cm\^2' \(an inertia\)"
    ):
        Sample(inertia=2.0)


def test_common_units_are_to_the_last_bit_as_the_registry_has_them(monkeypatch):
    pairs = [(given, unit) for unit, row in units._COMMON.items() for given in row]
    pairs += [(unit, given) for given, unit in pairs]
    listed = [units._factor.__wrapped__(given, given, unit) for given, unit in pairs]
    monkeypatch.setattr(units, "_COMMON", {})
    assert listed == [units._factor.__wrapped__(given, given, unit) for given, unit in pairs]


def test_the_registry_is_not_needed_for_declared_units(monkeypatch):
    monkeypatch.setattr(units, "_registry", None)
    for quantity in DECLARED:
        for unit in {quantity.unit, quantity.display} - {""}:
            assert units._factor.__wrapped__(unit, unit, quantity.unit) > 0.0
            assert units._factor.__wrapped__(quantity.unit, quantity.unit, unit) > 0.0


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5 Ohm", "ohm", 5.0), ("5 Ohms", "ohm", 5.0), ("2 kOhm", "ohm", 2000.0), ("3 mOhm", "ohm", 0.003),
        ("1 rev/day", "rad/s", 2 * math.pi / 86400), ("1 rev/min", "rad/s", 2 * math.pi / 60), ("1 RPM", "rad/s", 2 * math.pi / 60),
        ("1 U/min", "rad/s", 2 * math.pi / 60), ("1 rev", "rad", 2 * math.pi), ("4 KHz", "Hz", 4000.0), ("4 hz", "Hz", 4.0),
        ("3 Volt", "V", 3.0), ("3 Amps", "A", 3.0), ("2 Henry", "H", 2.0), ("180 Deg", "rad", math.pi), ("2 Sec", "s", 2.0),
        ("0", "N*m", 0.0), ("0.0", "kg*m^2", 0.0), ("-0", "rad/s", 0.0),
    ],
)  # fmt: skip
def test_units_as_they_are_spelled_and_nought_without_one(text, unit, value):
    assert convert(text, unit) == pytest.approx(value, rel=1e-12)


def test_a_number_that_is_not_nought_needs_a_unit():
    for text in ("1", "1e-300", "0.5"):
        with pytest.raises(ValueError, match="needs a unit"):
            convert(text, "N*m")
    with pytest.raises(ValueError, match="mixes angles and cycles"):
        convert("1 rev/day", "Hz")


def test_nought_is_taken_in_a_scenario(state_1):
    assert (
        state_1.with_(**{"friction.coulomb": 0, "friction.breakaway": "0"}).friction.coulomb == 0.0
    )


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("3000 1/min", "rad/s"),
        ("3000 min^-1", "rad/s"),
        ("50 1/s", "rad/s"),
        ("2 s^-2", "rad/s^2"),
        ("1e-8 N*min^2", "N*s^2/rad^2"),
    ],
)
def test_a_speed_says_whether_turns_or_radians_are_counted(text: str, unit: str) -> None:
    """A wheel of 3000 turns a minute was taken for one of 3000 radians, and passed."""
    with pytest.raises(ValueError, match="leaves open whether turns or radians are counted"):
        convert(text, unit)
    assert convert("1e-8 N*s^2", "N*s^2/rad^2") == 1e-8
