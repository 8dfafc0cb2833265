"""The floor between a recording's lines: where it can be seen, and how much torque noise it allows."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from microvib.model.driven import friction_to_disturbance
from microvib.model.line_names import electrical_line, full_step_line
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import LineTable
from microvib.signals.tones import MIN_SAMPLES as MIN_TONE_SAMPLES
from microvib.signals.tones import HannSpectrum

BANDS = np.geomspace(2.0, 200.0, 9)
"""Ends [Hz] of the bands in which the level between the lines is taken."""
MIN_BINS = 16
"""Bins of a band, below which it tells no level."""
_MODE_HALF_WIDTH = 0.1
"""Part of a mode's frequency about it that belongs to the mode."""
_MIN_DIFFERENCE_GAIN = 1.0
"""Gain of a difference over a period from which its bins count."""
_MEDIAN, _QUARTILE = math.sqrt(2.0 * math.log(2.0)), math.sqrt(2.0 * math.log(4.0 / 3.0))
"""Median and lower quartile of noise's amplitudes over the RMS of one of their parts (Rayleigh)."""
_HANN_NOISE_BANDWIDTH = 1.5
"""Mean square of noise in a bin under a Hann window over that without a window."""


def bins_between_lines(
    x: np.ndarray, sample_rate: float, table: LineTable, scenario: Scenario
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Hann-window amplitudes of all bins (n,), their frequencies [Hz], and the bins between lines
    of each of some bands.

    A band in which the lines of the step clock leave too few bins free is not among them.
    """
    spectrum = HannSpectrum.of(x - x.mean(), sample_rate)
    f = np.arange(spectrum.magnitude.size) / spectrum.duration
    free = np.ones(f.size, dtype=bool)
    for line in table:  # one without a frequency of its own stands where it is expected
        free &= np.abs(f - line.place) * table.duration > SEPARATION + 1.0
    spacing = _spacing(table)
    if spacing:
        free &= np.abs(f - spacing * np.rint(f / spacing)) * table.duration > SEPARATION
    free &= _away_from_modes(f, scenario)
    return spectrum.magnitude, f, _in_bands(f, free)


def max_torque_noise_density(
    x: np.ndarray, sample_rate: float, table: LineTable, scenario: Scenario
) -> float:
    """The largest density [N^2 m^2/Hz] of white torque noise that a recording ``x`` (n,) [N m]
    allows, by the linearised drive.

    Noise raises the floor of every band, so that the band which allows least is right. Where no
    band has bins between the lines, what is left of them a period of the motion later is noise;
    where the record has no two periods, all that stands in the quietest bins may be. Infinite where
    nothing can be looked at.
    """
    each = _floors_between(x, sample_rate, table, scenario)
    each = each or _floors_of_differences(x, sample_rate, table, scenario)
    each = each or _quietest(x, sample_rate, scenario)
    return min(
        (density / abs(friction_to_disturbance(scenario, f)) ** 2 for f, density in each),
        default=math.inf,
    )


def _floors_between(
    x: np.ndarray, sample_rate: float, table: LineTable, scenario: Scenario
) -> list[tuple[float, float]]:
    """Frequency [Hz] and density [N^2 m^2/Hz] of the bins between the lines of each band."""
    magnitude, f, bands = bins_between_lines(x, sample_rate, table, scenario)
    duration = x.size / sample_rate
    return [
        (float(np.median(f[k])), _density(float(np.median(magnitude[k])) / _MEDIAN, duration))
        for k in bands
    ]


def _floors_of_differences(
    x: np.ndarray, sample_rate: float, table: LineTable, scenario: Scenario
) -> list[tuple[float, float]]:
    """Floors of the changes from one period of the motion to the next; nothing where the record
    is shorter than two.
    """
    spacing = _spacing(table)
    if spacing:
        lag = sample_rate / spacing
    else:
        lag = math.inf
    if 2.0 * lag + MIN_TONE_SAMPLES > x.size:
        return []
    from scipy.interpolate import CubicSpline

    at = np.arange(int(x.size - 1 - lag))
    difference = CubicSpline(np.arange(x.size), x)(at + lag) - x[at]
    spectrum = HannSpectrum.of(difference - difference.mean(), sample_rate)
    f = np.arange(spectrum.magnitude.size) / spectrum.duration
    gain = 2.0 * np.abs(np.sin(math.pi * f * lag / sample_rate))
    bands = _in_bands(f, (gain > _MIN_DIFFERENCE_GAIN) & _away_from_modes(f, scenario))
    sizes = spectrum.magnitude / np.maximum(gain, _MIN_DIFFERENCE_GAIN)
    return [
        (float(np.median(f[k])), _density(float(np.median(sizes[k])) / _MEDIAN, spectrum.duration))
        for k in bands
    ]


def _quietest(x: np.ndarray, sample_rate: float, scenario: Scenario) -> list[tuple[float, float]]:
    """Floors from each band's quietest bins."""
    spectrum = HannSpectrum.of(x - x.mean(), sample_rate)
    f = np.arange(spectrum.magnitude.size) / spectrum.duration
    bands = _in_bands(f, _away_from_modes(f, scenario))
    low = [float(np.quantile(spectrum.magnitude[k], 0.25)) / _QUARTILE for k in bands]
    return [
        (float(np.median(f[k])), _density(size, spectrum.duration))
        for k, size in zip(bands, low, strict=True)
    ]


def _density(part: float, duration: float) -> float:
    """Density [N^2 m^2/Hz] of noise from the RMS of one part of its bins [N m] under a Hann window."""
    return part**2 * duration / _HANN_NOISE_BANDWIDTH


def _spacing(table: LineTable) -> float:
    """Distance [Hz] of the lines that the step clock makes: those of the electrical period where
    several are seen, else of full steps; 0 where the rate is not constant."""
    several = sum(line.kind == "electrical" and line.seen for line in table) > 1
    first = {line.name: line.expected for line in table}
    steps = first.get(
        electrical_line(1) if several or full_step_line(1) not in first else full_step_line(1), 0.0
    )
    return steps * (table.clock_ratio or 1.0)


def _away_from_modes(f: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Which frequencies (n,) [Hz] are near no mode."""
    near = [
        np.abs(f / mode.frequency - 1.0) <= _MODE_HALF_WIDTH for mode in coupled_modes(scenario)
    ]
    if near:
        return ~np.any(near, axis=0)
    return np.ones(f.size, dtype=bool)


def _in_bands(f: np.ndarray, which: np.ndarray) -> list[np.ndarray]:
    """Bins of each band of which enough are to be looked at."""
    bands = [np.flatnonzero(which & (f >= a) & (f < b)) for a, b in pairwise(BANDS)]
    return [k for k in bands if k.size >= MIN_BINS]
