"""Amplitude spectrum and density of one member in bands that all members have in common.

The amplitude spectrum has one noise bandwidth for all members, whatever their length and rate, under a
flat-top window, which reads a tone wherever it lies between two bins. The density of a band is the mean
square between its edges over its width: nothing is interpolated, and the bands' mean squares add up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microvib.model.record import PASSBAND
from microvib.signals.frequency_bands import Bandwidth
from microvib.signals.spectrum import (
    SpectrumError,
    averaged_spectrum,
    noise_bandwidth,
    power_spectral_density,
)
from microvib.units import Si

WINDOW_HALF_WIDTH = 5.0
"""Bins from the middle of the main lobe of a flat-top window to its end."""
OVERLAP = 0.75
"""Part of a stretch under a flat-top window that the next one shares."""


@dataclass(frozen=True)
class InBands:
    """One figure of one member by the numbers of bands."""

    figures: dict[int, float]
    why: str = ""
    """Why there are none; empty where there are."""


NO_SAMPLES = InBands({}, "it keeps no samples")


def amplitudes_in_bands(
    x: np.ndarray, rate: float, bandwidth: Bandwidth, resolution: float
) -> InBands:
    """Find the highest amplitude in each band, 0-to-peak.

    Parameters
    ----------
    x : ndarray
        Samples, (n,).
    rate : float
        Samples per second [Hz].
    bandwidth : Bandwidth
        The bands.
    resolution : float
        Noise bandwidth of the spectrum [Hz]; bands that are narrower have no figure.

    Returns
    -------
    InBands
        Amplitudes by bands, where they are resolved; a tone within half a bin of an edge counts in
        both bands.
    """
    step = resolution / noise_bandwidth("flat-top")
    try:
        made = averaged_spectrum(x, rate, "linear", Si(step), "flat-top", OVERLAP)
    except SpectrumError as error:
        return InBands({}, str(error).replace("resolution: ", "a spectrum of ", 1))
    step = made.resolution
    f, found = made.frequency, {}
    for k in _resolved(bandwidth, WINDOW_HALF_WIDTH * step, rate, resolution):
        low, high = bandwidth.ends(k)
        here = slice(
            int(np.searchsorted(f, low - 0.5 * step)),
            int(np.searchsorted(f, high + 0.5 * step, "right")),
        )
        found[k] = float(np.max(made.amplitude[here]))
    return InBands(found, "" if found else "no band is resolved")


def densities_in_bands(x: np.ndarray, rate: float, bandwidth: Bandwidth) -> InBands:
    """Find the mean power spectral density of each band, whose mean square is that of the signal.

    Parameters
    ----------
    x : ndarray
        Samples, (n,).
    rate : float
        Samples per second [Hz].
    bandwidth : Bandwidth
        The bands.

    Returns
    -------
    InBands
        Densities [unit^2/Hz] by bands that are two bins wide or more (Welch, Hann, bins 8 / record).
    """
    try:
        made = power_spectral_density(x, rate)
    except SpectrumError as error:
        return InBands({}, str(error))
    step, found = made.resolution, {}
    for k in _resolved(bandwidth, step, rate, 2.0 * step):
        low, high = bandwidth.ends(k)
        found[k] = made.band_rms(Si(low), Si(high)) ** 2 / (high - low)
    return InBands(found, "" if found else "no band is resolved")


def _resolved(bandwidth: Bandwidth, low: float, rate: float, narrowest: float) -> list[int]:
    """Bands from a frequency [Hz] up to the passband that are no narrower than a width [Hz]."""
    top = PASSBAND * rate
    if not low < top:
        return []
    found = []
    for k in bandwidth.touching(low, top):
        first, last = bandwidth.ends(k)
        whole = first >= low * (1.0 - 1e-9) and last <= top * (1.0 + 1e-9)
        if whole and last - first >= narrowest * (1.0 - 1e-9):
            found.append(k)
    return found


def mean_square(densities: InBands, bandwidth: Bandwidth) -> float:
    """Mean square of all bands of a member together; nan where it has none."""
    if not densities.figures:
        return math.nan
    ends = {k: bandwidth.ends(k) for k in densities.figures}
    return sum(x * (ends[k][1] - ends[k][0]) for k, x in densities.figures.items())
