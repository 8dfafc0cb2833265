"""From a drive to the file of a recording and its truth.

Truth are the lines of the integrator's own motion at the orders of the electrical frequency, whose
clock is known exactly: a least-squares fit with Hann's weights over whole electrical periods, before
the chain's errors and noise. What these errors do to a line is known exactly, too, and applied.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from cases import Test
from integrator import integrate
from scipy.signal import firwin, oaconvolve

PASSBAND = 0.35
"""Part of the sample rate up to which lines are scored."""
DENSE = 32768.0
"""Interval means per second that are integrated, about."""
MARGIN = 2.0
"""Time beyond each end of a record [s] that filters may look at."""
MIN_LINES, MAX_UNSTEADY = 3, 0.2
"""Lines well above the noise that a recording has, and part of its lines that may be unsteady."""
STEADY = 1e-3
"""Part of a line's amplitude by which two windows may see it differently."""


@dataclass(frozen=True)
class TrueLine:
    """A line as a file's own time base has it."""

    order: int
    """Of the electrical frequency; 0 of the mains."""
    frequency: float
    amplitude: float
    phase: float
    """Of the cosine at the first sample [rad]."""
    sigma: float
    """Least standard deviation of its amplitude that the noise allows [N m]."""


@dataclass(frozen=True)
class Made:
    """A recording and its truth."""

    x: np.ndarray
    """Torque [N m] at the stated sample rate, (n,)."""
    lines: tuple[TrueLine, ...]
    unsteady: tuple[float, ...]
    """Frequencies [Hz] at orders whose amplitude is not one figure: they are not scored."""
    events: int


def make(test: Test) -> Made:
    """The recording of a test; ValueError where the drive loses its steps."""
    fs = test.sample_rate * test.recorder_ratio
    factor = round(DENSE / test.sample_rate)
    step = 1.0 / (factor * fs)
    margin = round(MARGIN * test.sample_rate)
    samples = round(test.duration * test.sample_rate)
    length = 2 * margin + samples
    # Sample 0 of the record is at the middle of an interval, at time `settle`.
    first = test.settle - (margin * factor + 0.5) * step
    edges = first + step * np.arange(length * factor + 1)
    momentum, events, lost = integrate(test.drive, test.references, test.f_d, edges)
    if lost:
        raise ValueError("lost its steps")
    torque = -np.diff(momentum) / step
    random = np.random.default_rng([test.case.seed, 1])
    passed = oaconvolve(torque, _low_pass(factor), "same")[::factor]
    gain = _ripple(test, length, fs, random)
    recorded = np.fft.irfft(np.fft.rfft(passed) * gain, length)[margin : margin + samples]
    lines, unsteady = _true_lines(test, passed[margin : margin + samples], (gain, fs / length))
    _check_repeats(lines, unsteady)
    hum = _mains(test, fs, samples, random)
    t = np.arange(samples) / fs
    noise = _noise(test, samples, fs, random)
    for line in hum:
        noise += line.amplitude * np.cos(
            2.0 * math.pi * line.frequency * t * test.recorder_ratio + line.phase
        )
    return Made(recorded + noise, (*lines, *hum), unsteady, events)


def _low_pass(factor: int) -> np.ndarray:
    """Linear-phase low-pass from interval means to samples: 100 dB from 0.63 of the rate on."""
    taps: np.ndarray = firwin(32 * factor + 1, 1.0 / factor, window=("kaiser", 10.0))
    return taps


def _ripple(test: Test, length: int, fs: float, random: np.random.Generator) -> np.ndarray:
    """Complex gain of the chain at the bins of ``length`` samples: smooth errors about 1."""
    f = np.fft.rfftfreq(length, 1.0 / fs)
    knots = np.arange(0.0, f[-1] + 4.0 * test.ripple.width, test.ripple.width)
    errors = random.normal(size=(2, knots.size))
    gain, phase = (np.interp(f, knots, each) for each in errors)
    return np.exp(test.ripple.gain * gain + 1j * test.ripple.phase * phase)


@numba.njit(cache=True)
def _orders(x, weights, angle, count):
    """Sums of the weighted samples (n,) over the harmonics 1 to ``count`` of an angle, (2, count)."""
    found = np.zeros((2, count), dtype=np.complex128)
    for i in range(x.size):
        turn, z = complex(math.cos(angle[i]), -math.sin(angle[i])), 1.0 + 0.0j
        a, b = x[i] * weights[0, i], x[i] * weights[1, i]
        for k in range(count):
            z *= turn
            found[0, k] += a * z
            found[1, k] += b * z
    return found


def _true_lines(
    test: Test, torque: np.ndarray, chain: tuple[np.ndarray, float]
) -> tuple[list[TrueLine], tuple[float, ...]]:
    """Lines at the orders of f_e in the torque of the record before the chain's errors and noise,
    as the chain shows them: its complex gain at bins, and their distance [Hz].
    """
    fs = test.sample_rate * test.recorder_ratio
    periods = math.floor(test.f_e * torque.size / fs)
    n = round(periods / test.f_e * fs)
    angle = 2.0 * math.pi * test.f_e * np.arange(n) / fs
    hann = 1.0 - np.cos(2.0 * math.pi * (np.arange(n) + 0.5) / n)
    # The second window, its square, sees the middle of the record more.
    weights = np.stack([hann, hann**2])
    weights /= np.sum(weights, axis=1, keepdims=True)
    count = int(PASSBAND * fs / test.f_e)
    found = 2.0 * _orders(torque[:n] - np.mean(torque[:n]), weights, angle, count)
    f = test.f_e * np.arange(1, count + 1)
    bins = np.arange(chain[0].size) * chain[1]
    gain = np.interp(f, bins, np.abs(chain[0])) * np.exp(
        1j * np.interp(f, bins, np.angle(chain[0]))
    )
    shown, differ = found[0] * gain, np.abs(found[1] - found[0])
    sigma = np.sqrt(test.noise.at(f) / test.duration)
    lines, unsteady = [], []
    for k in range(count):
        place = float(f[k] / test.recorder_ratio)
        if differ[k] > STEADY * abs(found[0, k]) + 0.3 * sigma[k]:
            unsteady.append(place)
            continue
        figures = (float(np.abs(shown[k])), float(np.angle(shown[k])), float(sigma[k]))
        lines.append(TrueLine(k + 1, place, *figures))
    return lines, tuple(unsteady)


def _check_repeats(lines: list[TrueLine], unsteady: tuple[float, ...]) -> None:
    """ValueError for a drive whose motion does not repeat, so that its lines have no amplitudes."""
    large = sum(line.amplitude > 10.0 * line.sigma for line in lines)
    if large < MIN_LINES or len(unsteady) > MAX_UNSTEADY * (large + len(unsteady)):
        raise ValueError("does not repeat its motion, or shows few lines")


def _mains(test: Test, fs: float, samples: int, random: np.random.Generator) -> list[TrueLine]:
    """The mains' first three harmonics."""
    if not test.noise.hum:
        return []
    frequency = test.noise.mains * (1.0 + random.uniform(-1e-3, 1e-3))
    lines = []
    for k in (1, 2, 3):
        f = k * frequency / test.recorder_ratio
        sigma = float(np.sqrt(test.noise.at(np.array([f]))[0] / (samples / fs)))
        lines.append(
            TrueLine(0, f, test.noise.hum / k, float(random.uniform(-math.pi, math.pi)), sigma)
        )
    return lines


def _noise(test: Test, samples: int, fs: float, random: np.random.Generator) -> np.ndarray:
    """Gaussian noise of the table's density: made in twice the length, of which the middle is kept."""
    n = 2 * samples
    f = np.fft.rfftfreq(n, 1.0 / fs)
    white = np.fft.rfft(random.normal(size=n))
    shaped = np.fft.irfft(white * np.sqrt(test.noise.at(f) * fs / 2.0), n)
    return np.asarray(shaped[samples // 2 : samples // 2 + samples])
