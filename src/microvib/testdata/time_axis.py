"""Time axes of recordings: the sample rate that one tells, and what is wrong with it."""

from __future__ import annotations

import math

import numpy as np

from microvib.testdata.recording import RecordingError


def regular_rate(t: np.ndarray) -> tuple[float, str]:
    """Sample rate [Hz] of a time axis, and a note; RecordingError where samples are missing or
    their spacing wanders.

    A time axis that is written with few digits gives a rate that is off by millionths; where it is
    that close to a whole number of hertz, that number is meant.
    """
    if t.size < 8 or not np.all(np.isfinite(t)):
        raise RecordingError("a time axis of at least 8 finite values is expected")
    steps = np.diff(t)
    typical = float(np.median(steps))
    twice = np.flatnonzero(steps == 0.0)
    if t[-1] > t[0] and np.all(steps >= 0.0) and (typical <= 0.0 or twice.size > 0.01 * t.size):
        about = (t.size - 1) / (t[-1] - t[0])
        raise RecordingError(
            f"its time axis has too few digits to tell the samples apart, about {about:.4g} in a"
            " second; write more digits, or"
            " add the rate to the preparation file, such as sample_rate: 4096 Hz",
            remedy="prepare",
        )
    if twice.size and t[-1] > t[0] and np.all(steps >= 0.0):
        raise RecordingError(
            f"{twice.size} of its samples have the time of the one before, the first at"
            f" {t[twice[0]]:.6g} s"
        )
    if typical <= 0.0 or np.any(steps < -0.5 * typical):
        raise RecordingError("its time axis does not increase throughout")
    gaps = np.flatnonzero(steps > 1.5 * typical)
    if gaps.size:
        missing = round(float((steps[gaps] / typical - 1).sum()))
        raise RecordingError(
            f"about {missing} samples are missing, the first at {t[gaps[0]]:.6g} s"
        )
    mean = float((t[-1] - t[0]) / (t.size - 1))
    wander = float(np.max(np.abs(t - t[0] - mean * np.arange(t.size))))
    if wander > max(0.05 * mean, _time_resolution(t)):
        raise RecordingError(
            f"its sample spacing varies by {wander:.3g} s; resample it at a constant rate first"
        )
    return snapped_rate(1.0 / mean)


def agrees(t: np.ndarray, rate: float) -> bool:
    """Whether a time axis [s] of few digits is that of samples at ``rate`` [Hz], to its last digit."""
    steps = np.diff(t)
    if t.size < 8 or not np.all(np.isfinite(t)) or np.any(steps < 0.0) or not np.any(steps > 0.0):
        return False
    digit = 1.01 * float(np.min(steps[steps > 0.0]))
    # Where samples have times of their own, one that is missing or twice is no matter of digits.
    if np.mean(steps == 0.0) > 0.01:
        allowed = digit
    else:
        allowed = min(digit, 0.9 / rate)
    return bool(np.ptp(t - t[0] - np.arange(t.size) / rate) <= allowed)


def _time_resolution(t: np.ndarray) -> float:
    """The last digit [s] to which a time axis is written where that is the sixth to tenth; 0 where
    it has more.
    """
    decade = math.floor(math.log10(max(abs(float(t[-1])), 1e-12)))
    last = t[np.abs(t) >= 10.0**decade]  # what is smaller may have more decimals
    for k in range(5, 10):
        counts = last / 10.0 ** (decade - k)
        if np.all(np.abs(counts - np.rint(counts)) < 1e-3):
            return float(10.0 ** (decade - k))
    return 0.0


def snapped_rate(rate: float) -> tuple[float, str]:
    """A whole number of hertz where ``rate`` is within 1e-5 of one, and a note that says so; a rate
    that is not finite as it is.
    """
    if not math.isfinite(rate):
        return rate, ""
    whole = float(round(rate))
    if whole > 0.0 and rate != whole and abs(rate / whole - 1.0) < 1e-5:
        told = f"{rate:.6f}" != f"{whole:.6f}"
        return (
            whole,
            f"sample rate {rate:.6f} Hz of the time axis read as {whole:g} Hz" if told else "",
        )
    return rate, ""
