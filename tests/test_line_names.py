"""Names of lines: what is made is read back, and what is no such name stands for itself."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import microvib as mv
from microvib.model.line_names import (
    ARRAY_MODE,
    DRIVE,
    ELECTRICAL,
    FULL_STEP,
    UNLISTED,
    LineName,
    is_sideband,
    is_unlisted,
)


@given(
    st.sampled_from([DRIVE, FULL_STEP, ELECTRICAL, ARRAY_MODE, UNLISTED, "wave_generator"]),
    st.integers(1, 10_000),
    st.integers(-3, 3),
    st.booleans(),
)
def test_a_name_is_read_as_it_was_made(family, order, sideband, second):
    name = LineName(family, order, sideband, second)
    assert LineName.parse(str(name)) == name


@given(st.text())
def test_any_text_is_a_name_that_is_written_as_it_was(text):
    assert str(LineName.parse(text)) == text


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("drive_3", LineName("drive", 3)),
        ("drive_3_minus_2", LineName("drive", 3, -2)),
        ("drive_resonance_1", LineName("drive_resonance", 1)),
        ("wing_2 full_step_1", LineName("full_step", 1, second_wing=True)),
        ("wing_2_mode_1", LineName("wing_2_mode", 1)),
        ("wing_2 other_4", LineName("other", 4, second_wing=True)),
        ("ear_05", LineName("ear_05")),
    ],
)
def test_names_that_stand_in_files(text, read):
    assert LineName.parse(text) == read


def test_all_names_of_an_expectation_say_their_kind(state_1):
    kinds = {"drive": DRIVE, "full step": FULL_STEP, "electrical": ELECTRICAL}
    for line in mv.expected_lines(state_1, "2000 Hz"):
        name = LineName.parse(line.name)
        assert str(name) == line.name
        assert name.is_mode == line.is_mode
        assert is_sideband(line.name) == (line.kind == "sideband")
        assert name.is_driving_line == (line.kind == "drive")
        assert name.family == kinds.get(line.kind, name.family)


def test_lines_that_only_one_of_two_records_has_are_unlisted():
    assert is_unlisted("other_2_of_b")
    assert is_unlisted("wing_2 other_2")
    assert not is_unlisted("another_2")
