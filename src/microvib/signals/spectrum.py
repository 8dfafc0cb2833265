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


def tone_amplitude(x: np.ndarray, sample_rate: float, frequency: float) -> float:
    """Amplitude of ``x`` at one frequency [Hz], Hann-windowed, wherever the bins fall; for tones apart from others."""
    w = window_values("hann", x.size)
    phase = np.exp(-2j * np.pi * frequency / sample_rate * np.arange(x.size))
    return 2.0 * abs(complex(phase @ ((x - x.mean()) * w))) / float(w.sum())
