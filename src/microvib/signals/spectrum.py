"""Amplitude spectra, one-sided, zero-to-peak, with what they were made by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from microvib.errors import MicrovibError

Window = Literal["rectangular", "hann"]


@dataclass(frozen=True)
class Spectrum:
    """One-sided amplitude spectrum: a tone on a bin reads its amplitude, zero to peak."""

    frequency: np.ndarray
    """Bins [Hz], (m,)."""
    amplitude: np.ndarray
    """Amplitudes in the unit of the signal, (m,)."""
    window: Window
    samples: int
    sample_rate: float
    """Samples per second [Hz]."""

    @property
    def resolution(self) -> float:
        """Distance of the bins [Hz]."""
        return self.sample_rate / self.samples

    def __str__(self) -> str:
        return (
            f"amplitude spectrum, one-sided, 0-to-peak; {self.window} window, {self.samples} samples at"
            f" {self.sample_rate:g} Hz, {self.samples / self.sample_rate:g} s, resolution {self.resolution:g} Hz, no averaging"
        )


def window_values(name: Window, samples: int) -> np.ndarray:
    """Window of ``samples`` points (periodic), (n,)."""
    if name == "rectangular":
        return np.ones(samples)
    if name == "hann":
        return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(samples) / samples)
    raise MicrovibError(f"window: '{name}' is not known; allowed are rectangular and hann")


def amplitude_spectrum(x: np.ndarray, sample_rate: float, window: Window = "rectangular") -> Spectrum:
    """Amplitude spectrum of the mean-free signal ``x`` (n,); 2 |X| / sum of the window."""
    w = window_values(window, x.size)
    X = np.fft.rfft((x - x.mean()) * w)
    return Spectrum(np.arange(X.size) * sample_rate / x.size, 2.0 * np.abs(X) / w.sum(), window, x.size, sample_rate)


def nearest_bin(x: np.ndarray, sample_rate: float, frequency: float) -> tuple[float, float]:
    """The paper's estimator: rectangular window, bin nearest to ``frequency``; its frequency [Hz] and amplitude.

    Between bins it reads up to 36 % low (picket fence), so that it depends on where the bins happen to fall.
    """
    bin_number = round(frequency * x.size / sample_rate)
    phase = np.exp(-2j * np.pi * bin_number / x.size * np.arange(x.size))
    return bin_number * sample_rate / x.size, 2.0 * abs(complex(phase @ (x - x.mean()))) / x.size
