"""How often stated uncertainties cover the truth, on made records whose truth is known.

Records are tones whose frequencies, decays and amplitudes are known, in Gaussian noise. Claimed are
the lines whose status gives a figure; of the claims, those are counted whose amplitude and
frequency are within two standard uncertainties of the truth.
"""

from dataclasses import dataclass

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.line_fit import estimate_lines

RATE, SAMPLES = 256.0, 4096
DURATION = SAMPLES / RATE
CLAIMS = ("ok", "decaying", "growing")


@dataclass(frozen=True)
class Coverage:
    """Part of the claims that hold, and part of the lines that a claim is made of."""

    amplitude: float
    frequency: float
    claimed: float


def expect(name: str, kind: str, frequency: float, width: float = 0.0) -> ExpectedLine:
    """A line that is looked for ``width`` [Hz] about its frequency."""
    return ExpectedLine(
        name, kind, frequency, frequency - width, frequency + width, f"{name}, order 1"
    )


def coverage(
    pair: str,
    distance: float,
    noise: float,
    fold: float,
    records: int = 100,
    searched: bool = False,
) -> Coverage:
    """Coverage of two standard uncertainties, for two modes (``pair`` "modes") or a mode beside
    full_step_1 ("clock").

    They are ``distance`` bins apart, of amplitudes about 1, in noise of RMS ``noise``; modes fall
    by ``fold`` e-foldings over the record. ``searched`` leaves the clock to be found within 1 per
    cent.
    """
    random, t = (
        np.random.default_rng([round(1e3 * v) for v in (distance, noise, fold)]),
        np.arange(SAMPLES) / RATE,
    )
    hits, claims, lines = [], 0, 0
    for _ in range(records):
        first = (40.0 + random.uniform(-0.5, 0.5)) / DURATION
        second = first + distance / DURATION
        sizes, phases = random.uniform(0.5, 1.5, 3), random.uniform(-np.pi, np.pi, 3)
        clock = ("full_step_1", "drive_1")
        ratio = 1.0 + (random.uniform(-0.01, 0.01) if searched else 0.0)
        decays = fold * random.uniform(0.7, 1.4, 2) / DURATION
        if pair == "modes":
            full = 25.0 / DURATION
            truth = {
                "array_mode_1": (first, decays[0], sizes[0]),
                "array_mode_2": (second, decays[1], sizes[1]),
            }
        else:
            full = first
            truth = {
                "array_mode_1": (second, decays[0], sizes[0]),
                "full_step_1": (first * ratio, 0.0, sizes[1]),
            }
        x = random.normal(0.0, noise, SAMPLES)
        for (f, sigma, a), phase in zip(truth.values(), phases, strict=False):
            x += a * np.exp(-sigma * t) * np.cos(2 * np.pi * f * t + phase)
        drive = 16.0 * full
        x += sizes[2] * np.cos(2 * np.pi * drive * ratio * t + phases[2])
        width = 0.01 if searched else 0.0
        expected = [
            expect(clock[0], "full step", full, width * full),
            expect(clock[1], "drive", drive, width * drive),
            *(expect(n, "array mode", f + random.uniform(-0.3, 0.3) / DURATION, 0.5 / DURATION)
              for n, (f, _, _) in truth.items() if n.startswith("array")),
        ]  # fmt: skip
        table = estimate_lines(x, RATE, expected)
        for name, (f, sigma, a) in truth.items():
            line, falls = table[name], sigma * DURATION
            mean = a * -np.expm1(-falls) / falls if falls else a
            lines += 1
            if line.status in CLAIMS:
                claims += 1
                hits.append(
                    (
                        abs(line.amplitude - mean) <= 2 * line.amplitude_uncertainty,
                        abs(line.frequency - f) <= 2 * line.frequency_uncertainty,
                    )
                )
    good = np.array(hits).reshape(-1, 2).mean(axis=0) if hits else np.array([np.nan, np.nan])
    return Coverage(float(good[0]), float(good[1]), claims / lines)
