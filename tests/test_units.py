import math
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from microvib.model.part import Part
from microvib.units import Quantity, convert


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
    ],
)
def test_units_are_converted(text, unit, value):
    assert convert(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "complaint"),
    [
        ("5", "kg*m^2", "needs a unit"),
        ("5 kg", "kg*m^2", "wrong dimension"),
        ("banana", "kg*m^2", "is not a quantity"),
        ("0,6 A", "A", "write a decimal point, not a comma"),
        ("0.6 A + 1 A", "A", "is not a quantity"),
        ("2 60 A", "A", "is not a quantity"),
        ("9**9**9 A", "A", "is not a quantity"),
        ("0.6 Ampelle", "A", "has an unknown unit, 'Ampelle'"),
        ("7 rad/s", "Hz", "mixes angles and cycles"),
        ("60 rpm", "Hz", "mixes angles and cycles"),
        ("1 Hz", "rad/s", "mixes cycles and angles"),
        ("", "kg", "is not a quantity"),
        ("1 kg" * 100, "kg", "too long"),
    ],
)
def test_bad_quantities_are_named(text, unit, complaint):
    with pytest.raises(ValueError, match=complaint):
        convert(text, unit)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "nan kg*m^2", "-3 kg*m^2", True, None, [1.0], {}])
def test_what_is_out_of_range_or_no_number_is_refused(value):
    with pytest.raises(ValidationError, match="an inertia"):
        Sample(inertia=value)


@given(st.floats(min_value=1e-12, max_value=1e12))
def test_formatted_quantities_read_back_to_the_same_value(value):
    quantity = Sample.quantity_of("inertia")
    assert convert(quantity.format(value), "kg*m^2") == value


def test_numbers_need_a_unit_only_where_units_are_asked_for():
    assert Sample(inertia=2.0).inertia == 2.0
    with pytest.raises(ValidationError, match=r"needs a unit, such as '2\.0 kg\*cm\^2'"):
        Sample.model_validate({"inertia": 2.0}, context={"units_required": True})
