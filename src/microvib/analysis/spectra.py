"""Samples of any source, and their spectra: a motion, a torque of many, a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microvib.errors import ChannelError, SimulationError, expect, expect_channel
from microvib.signals import spectrum as spectra
from microvib.signals.spectrum import Average, Density, Spectrum, Waterfall, Window
from microvib.solve.batch import Torque
from microvib.solve.motion import Motion, scalar_channel, unit_of
from microvib.testdata.recording import Recording, check_samples
from microvib.units import GivenQuantity

Sampled = Motion | Torque | Recording
"""Sources with samples: of many channels, of T_d alone, or measured."""
SAMPLED = "a motion (mv.simulate) or a recording (mv.read_recording)"


def samples_of(
    source: Sampled, channel: str = "", expected: str = SAMPLED
) -> tuple[np.ndarray, float, str]:
    """Values (n,) of a channel, samples per second [Hz] and unit.

    Without a ``channel`` it is the disturbance torque: T_d, or Mz of a recording. ChannelError or
    RecordingError where there is no such channel, or not one value at a time, or where a
    recording's samples are no measurement.
    """
    if isinstance(source, SimulationError):
        raise source  # of mv.simulate_many, in place of a motion
    expect(source, (Motion, Torque, Recording), expected)
    expect_channel(channel)
    if isinstance(source, Motion):
        name = channel or "T_d"
        own = scalar_channel(source.channels, name, source.scenario, source.time)
        return (
            own if source.second_wing is None else source[name],
            source.sample_rate,
            unit_of(name),
        )
    if isinstance(source, Recording):
        name = channel or "Mz"
        return check_samples(source, name), source.sample_rate, source.units.get(name, "")
    if channel not in ("", "T_d"):
        raise ChannelError(
            f"channel '{channel}' is not in this torque, which has T_d only; mv.simulate keeps all channels"
        )
    return source.T_d, source.sample_rate, "N*m"


def spectrum(source: Sampled, channel: str = "", window: Window = "rectangular") -> Spectrum:
    """Estimate the one-sided amplitude spectrum, 0-to-peak, of a channel over the whole record.

    Parameters
    ----------
    source : Motion or Recording
        Samples of the channel.
    channel : str, optional
        Any channel that is one value at a time, or a load ``"Fx"`` to ``"Mz"``. Without it T_d, or
        Mz of a recording.
    window : {"rectangular", "hann", "flat-top"}
        Window of the samples.

    Returns
    -------
    Spectrum
        Frequencies [Hz] and amplitudes in the unit of the channel, (m,) each.

    Raises
    ------
    ChannelError
        For a channel that the source has not.
    RecordingError
        Where a recording's samples are no measurement.
    """
    x, rate, unit = samples_of(source, channel)
    return replace(spectra.amplitude_spectrum(x, rate, window), unit=unit)


def averaged_spectrum(
    source: Sampled,
    average: Average,
    channel: str = "",
    resolution: GivenQuantity | None = None,
    window: Window = "hann",
    overlap: float = 0.5,
) -> Spectrum:
    """One amplitude spectrum of the stretches of a channel, *linear*, *peak-hold* or *exponential*
    (``signals.spectrum.averaged_spectrum``); with *none* that of all its samples at once.
    """
    x, rate, unit = samples_of(source, channel)
    made = spectra.averaged_spectrum(x, rate, average, resolution, window, overlap)
    return replace(made, unit=unit)


def psd(
    source: Sampled,
    channel: str = "",
    resolution: GivenQuantity | None = None,
    window: Window = "hann",
    overlap: float = 0.5,
) -> Density:
    """Estimate the one-sided power spectral density of a channel (Welch).

    Parameters
    ----------
    source : Motion or Recording
        Samples of the channel.
    channel : str, optional
        Any channel that is one value at a time, or a load ``"Fx"`` to ``"Mz"``. Without it T_d, or
        Mz of a recording.
    resolution : str or Si, optional
        Distance between bins, such as ``"0.5 Hz"``.
    window : {"rectangular", "hann", "flat-top"}
        Window of each stretch.
    overlap : float
        Part of a stretch that the next one shares, up to 0.95.

    Returns
    -------
    Density
        Frequencies [Hz] and densities in the unit of the channel squared per Hz, (m,) each.

    Raises
    ------
    ChannelError
        For a channel that the source has not.
    RecordingError
        Where a recording's samples are no measurement.
    """
    x, rate, unit = samples_of(source, channel)
    return replace(spectra.power_spectral_density(x, rate, resolution, window, overlap), unit=unit)


def waterfall(
    source: Sampled,
    channel: str = "",
    resolution: GivenQuantity | None = None,
    window: Window = "hann",
    overlap: float = 0.5,
) -> Waterfall:
    """Estimate amplitude spectra of successive stretches of a channel.

    Parameters
    ----------
    source : Motion or Recording
        Samples of the channel.
    channel : str, optional
        Any channel that is one value at a time, or a load ``"Fx"`` to ``"Mz"``. Without it T_d, or
        Mz of a recording.
    resolution : str or Si, optional
        Distance between bins, such as ``"0.5 Hz"``; a stretch is 1/``resolution`` long.
    window : {"rectangular", "hann", "flat-top"}
        Window of each stretch.
    overlap : float
        Part of a stretch that the next one shares, up to 0.95.

    Returns
    -------
    Waterfall
        Times [s], (t,), frequencies [Hz], (m,), and amplitudes in the unit of the channel, (t, m).

    Raises
    ------
    ChannelError
        For a channel that the source has not.
    RecordingError
        Where a recording's samples are no measurement.
    """
    x, rate, unit = samples_of(source, channel)
    return replace(spectra.waterfall(x, rate, resolution, window, overlap), unit=unit)
