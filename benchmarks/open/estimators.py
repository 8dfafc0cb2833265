"""Four estimators of lines that are not microvib's, as they are usually programmed.

Each gets what any entrant gets: samples, the stated sample rate and the nominal scenario, and gives
rows of frequency [Hz], amplitude [N m], phase [rad] of the cosine at the first sample, and their
standard deviations (nan where it states none).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter
from scipy.optimize import curve_fit
from scipy.signal import find_peaks
from scipy.signal.windows import flattop

Estimates = np.ndarray
"""Rows (lines, 6): frequency, amplitude, phase, and the standard deviation of each."""
DETECTED = 6.0
"""Times the floor from which a peak counts, as microvib has it."""
PASSBAND = 0.35
FLOOR_BINS = 41
CLOCK_TOLERANCE = 0.02
_NAN = math.nan


def _floor(magnitude: np.ndarray) -> np.ndarray:
    """Median of the bins about each."""
    return np.asarray(median_filter(magnitude, FLOOR_BINS, mode="nearest"))


def _peaks(magnitude: np.ndarray, apart: int) -> np.ndarray:
    """Bins of peaks that stand above the floor, at least so many bins apart, in the passband."""
    last = int(2.0 * PASSBAND * magnitude.size)
    tall = np.where(magnitude > DETECTED * _floor(magnitude), magnitude, 0.0)
    found, _ = find_peaks(tall, height=1e-300, distance=apart)
    return found[(found >= 3) & (found < last)]


def nearest_bin(x: np.ndarray, rate: float, scenario: dict[str, Any]) -> Estimates:
    """Peaks of an FFT without a window, read off their bins."""
    spectrum = np.fft.rfft(x - x.mean()) * (2.0 / x.size)
    bins = _peaks(np.abs(spectrum), 3)
    rows = [(k * rate / x.size, abs(spectrum[k]), np.angle(spectrum[k]), *[_NAN] * 3) for k in bins]
    return np.array(rows).reshape(-1, 6)


def flat_top(x: np.ndarray, rate: float, scenario: dict[str, Any]) -> Estimates:
    """Peaks of an FFT with a flat-top window, read off their bins."""
    window = flattop(x.size, sym=False)
    spectrum = np.fft.rfft((x - x.mean()) * window) * (2.0 / window.sum())
    bins = _peaks(np.abs(spectrum), 6)
    rows = [(k * rate / x.size, abs(spectrum[k]), np.angle(spectrum[k]), *[_NAN] * 3) for k in bins]
    return np.array(rows).reshape(-1, 6)


def peak_fit(x: np.ndarray, rate: float, scenario: dict[str, Any]) -> Estimates:
    """Peaks of an FFT with a Hann window, each fitted by ``scipy.optimize.curve_fit``."""
    n = x.size
    spectrum = np.fft.rfft((x - x.mean()) * (1.0 - np.cos(2.0 * np.pi * np.arange(n) / n))) * (
        2.0 / n
    )
    magnitude = np.abs(spectrum)
    floor = _floor(magnitude)
    rows = []
    for k in _peaks(magnitude, 3):
        near = np.arange(k - 2, k + 3)
        y = np.concatenate([spectrum[near].real, spectrum[near].imag])
        beside = magnitude[k + 1] if magnitude[k + 1] > magnitude[k - 1] else magnitude[k - 1]
        side = 1.0 if magnitude[k + 1] > magnitude[k - 1] else -1.0
        ratio = beside / magnitude[k]
        start = k + side * (2.0 * ratio - 1.0) / (ratio + 1.0)
        phase = np.angle(spectrum[k]) - np.pi * (start - k)
        guess = (start, magnitude[k], phase)
        # A floor of magnitude m is Gaussian noise of m/1.18 in each part.
        sigma = np.full(y.size, max(floor[k], 1e-300) / 1.177)
        try:
            best, cov = curve_fit(
                _hann_tone, near, y, guess, sigma, absolute_sigma=True, maxfev=200
            )
        except RuntimeError:
            continue
        sd = np.sqrt(np.diag(cov))
        amplitude, turn = abs(best[1]), best[2] + (np.pi if best[1] < 0.0 else 0.0)
        rows.append((best[0] * rate / n, amplitude, turn, sd[0] * rate / n, sd[1], sd[2]))
    return np.array(rows).reshape(-1, 6)


def _hann_tone(bins: np.ndarray, cycles: float, amplitude: float, phase: float) -> np.ndarray:
    """Bins of a tone under a Hann window, real parts before imaginary ones."""
    d = cycles - bins
    d = np.where(np.abs(np.abs(d) - 1.0) < 1e-6, d + 2e-6, d)
    tone = amplitude * np.exp(1j * (phase + np.pi * d)) * np.sinc(d) / (1.0 - d**2)
    return np.concatenate([tone.real, tone.imag])


def vold_kalman(x: np.ndarray, rate: float, scenario: dict[str, Any]) -> Estimates:
    """Orders of the electrical frequency by Vold-Kalman filters of the second generation, of two
    poles, one order after another.

    The filter needs a tachometer: here the clock that makes most of the comb of driving lines. The
    amplitude is that of the mean envelope, its deviation that of the envelope's slow scatter.
    """
    x = x - x.mean()
    f_e = _electrical_frequency(x, rate, scenario)
    if f_e is None:
        return np.zeros((0, 6))
    n = x.size
    magnitude = np.abs(np.fft.rfft(x * (1.0 - np.cos(2.0 * np.pi * np.arange(n) / n)))) * (2.0 / n)
    floor = _floor(magnitude)
    rows = []
    for order in range(1, int(PASSBAND * rate / f_e) + 1):
        place = round(order * f_e * n / rate)
        if place < 3 or magnitude[place - 1 : place + 2].max() < DETECTED * floor[place]:
            continue
        rows.append(_order(x, rate, order * f_e, 0.25 * f_e))
    return np.array(rows).reshape(-1, 6)


def _order(x: np.ndarray, rate: float, frequency: float, bandwidth: float) -> tuple[float, ...]:
    """One order: minimise |x - Re(envelope carrier)|^2 with r^2 |second difference|^2."""
    n = x.size
    step = max(int(rate / (40.0 * bandwidth)), 1)
    t = np.arange(n) / rate
    base = 2.0 * x * np.exp(-2j * np.pi * frequency * t)
    m = n // step
    coarse = base[: m * step].reshape(m, step).mean(axis=1)
    at = (np.arange(m) * step + 0.5 * (step - 1)) / rate
    # Tuma: weight of a two-pole filter whose response is 3 dB down at the bandwidth.
    half = np.pi * bandwidth * step / rate
    r2 = (math.sqrt(2.0) - 1.0) / (2.0 * (1.0 - math.cos(half))) ** 2
    band = np.zeros((3, m))
    band[2] = 1.0 + r2 * 6.0
    band[1], band[0] = -4.0 * r2, r2
    band[2, [0, -1]], band[2, [1, -2]] = 1.0 + r2, 1.0 + 5.0 * r2
    band[1, 1], band[1, -1] = -2.0 * r2, -2.0 * r2
    envelope = solveh_banded(band, coarse)
    mean = envelope.mean()
    turn = np.unwrap(np.angle(envelope))
    slope = float(np.polyfit(at - at.mean(), turn, 1)[0])
    amplitude = float(np.mean(np.abs(envelope)))
    independent = max(m * step / rate * bandwidth, 2.0)
    sd = float(np.std(np.abs(envelope)) / math.sqrt(independent))
    phase = float(np.angle(mean)) - slope * float(at.mean())
    phase_sd = sd / max(amplitude, 1e-300)
    frequency_sd = phase_sd * math.sqrt(12.0) / (2.0 * np.pi * n / rate)
    start_sd = 2.0 * phase_sd
    return frequency + slope / (2.0 * np.pi), amplitude, phase, frequency_sd, sd, start_sd


def _electrical_frequency(x: np.ndarray, rate: float, scenario: dict[str, Any]) -> float | None:
    """The electrical frequency within the tolerance at which the comb of lines is highest."""
    nominal = electrical_frequency(scenario)
    n = x.size
    magnitude = np.abs(np.fft.rfft(x * (1.0 - np.cos(2.0 * np.pi * np.arange(n) / n)))) * (2.0 / n)
    logs = np.log(np.maximum(magnitude / np.maximum(DETECTED * _floor(magnitude), 1e-300), 1.0))
    count = min(int(PASSBAND * rate / nominal), 1000)
    steps = int(2.0 * CLOCK_TOLERANCE * nominal * count * n / rate * 4.0) + 1
    ratios = np.linspace(1.0 - CLOCK_TOLERANCE, 1.0 + CLOCK_TOLERANCE, steps)
    orders = np.arange(1, count + 1)
    scores = [
        float(
            np.sum(
                logs[
                    np.minimum(np.rint(q * nominal * orders * n / rate).astype(int), logs.size - 1)
                ]
            )
        )
        for q in ratios
    ]
    best = int(np.argmax(scores))
    return None if scores[best] <= 0.0 else float(ratios[best] * nominal)


def electrical_frequency(scenario: dict[str, Any]) -> float:
    """Nominal electrical frequency of a scenario [Hz]."""
    rate = scenario["tracking"]["rate"] * scenario["reducer"]["ratio"]
    return float(rate * scenario["motor"]["rotor_teeth"] / (2.0 * math.pi))


ESTIMATORS: dict[str, Callable[[np.ndarray, float, dict[str, Any]], Estimates]] = {
    "nearest bin of an FFT": nearest_bin,
    "flat-top peak": flat_top,
    "SciPy peak fit": peak_fit,
    "Vold-Kalman": vold_kalman,
}
