"""Levels by which two runs are compared: the largest line and the RMS of the lines in a band, with what they may be."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import microvib as mv
from microvib.analysis.band_levels import band_levels
from microvib.analysis.margins import amplitude_error_bound
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.line_table import LineTable


@pytest.fixture(scope="module")
def table(motion_1) -> LineTable:
    return mv.find_lines(motion_1)


def test_levels_are_those_of_the_lines_in_the_band(table):
    found = band_levels(table, 40.0, 200.0)
    lines = [x for x in table if 40.0 <= x.place <= 200.0 and x.seen]
    largest = max(lines, key=lambda x: x.amplitude)
    off = amplitude_error_bound(largest, table)
    assert found.largest.line == largest.name == "drive_1"
    assert found.largest.value == largest.amplitude
    assert found.largest.most == pytest.approx(largest.amplitude + off)
    assert found.largest.least == pytest.approx(largest.amplitude - off)
    rms = math.sqrt(sum(0.5 * x.amplitude**2 for x in lines))
    assert found.rms.value == pytest.approx(rms)
    assert found.rms.least < rms < found.rms.most


def test_an_error_of_the_integration_counts(table):
    less, more = (
        band_levels(replace(table, own_error=error), 40.0, 200.0).largest for error in (0.05, 0.1)
    )
    assert more.most - less.most == pytest.approx(0.05 * less.value)
    assert less.least - more.least == pytest.approx(0.05 * less.value)


def test_what_rings_may_be_absent_or_as_large_as_at_the_start(table):
    ringing = replace(table["array_mode_1"], status="decaying", decay=0.1)
    alone = replace(table, lines=(ringing,))
    found = band_levels(alone, 0.1, 200.0).largest
    assert found.least == 0.0
    assert found.most > ringing.amplitude_at_start(table.duration) > ringing.amplitude


def test_a_masked_line_counts_in_what_may_be_and_a_mode_of_no_steady_state_does_not(table):
    masked = replace(
        table["drive_1"], status="not separable", amplitude=math.nan, bin_amplitude=0.01
    )
    gone = replace(table["array_mode_1"], status=TRANSIENT)
    found = band_levels(replace(table, lines=(masked, gone)), 0.1, 200.0)
    assert (found.largest.line, found.largest.value, found.largest.least) == ("", 0.0, 0.0)
    assert found.largest.most == pytest.approx(0.1)
    assert found.rms.most == pytest.approx(0.1 / math.sqrt(2.0))


def test_a_band_without_lines_has_none(table):
    found = band_levels(table, 1e4, 2e4)
    assert (found.largest.value, found.largest.most, found.rms.most) == (0.0, 0.0, 0.0)
