"""microvib's own entry: lines by ``find_lines``, parameters by ``identify``, from the files alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import microvib as mv
from microvib.io.scenario_file import scenario_of
from microvib.studies.evidence import evidence_of, select_evidence
from microvib.studies.identify import identify

STARTS = 24
HARMONICS = 50
"""Members of each family of lines that are looked for."""


def lines(folder: Path) -> np.ndarray:
    """Lines of a case's recording that are no array modes, (n, 6)."""
    scenario = mv.load_scenario(str(folder / "scenario.yaml"))
    recording = mv.read_recording(recording_of(folder))
    table = mv.find_lines(recording, "Mz", HARMONICS, scenario=scenario, every_order=True)
    rows = [
        (x.frequency, x.amplitude, x.phase, x.frequency_uncertainty, x.amplitude_uncertainty, x.phase_uncertainty)
        for x in table
        if x.seen and not x.is_mode
    ]  # fmt: skip
    return np.array(rows).reshape(-1, 6)


def recording_of(folder: Path) -> Path:
    """The file of a case's recording."""
    return next(path for path in sorted(folder.iterdir()) if path.stem == "recording")


def parameters(folder: Path, keys: list[str], seed: int) -> Iterator[dict[str, str]]:
    """Estimates of the parameters that a scenario has wrong."""
    scenario = mv.load_scenario(str(folder / "scenario.yaml"))
    recording = mv.read_recording(recording_of(folder))
    evidence = evidence_of(recording, scenario, "Mz", folder.name)
    selected = select_evidence([evidence], [scenario], (), ())
    fit = identify(scenario, [(selected[0], {})], keys, starts=STARTS, finishes=1, seed=seed)
    for e in fit.estimates:
        if e.key in keys:
            yield {
                "case": folder.name, "key": e.key, "estimate": repr(float(e.estimate)),
                "low": repr(float(e.interval[0])), "high": repr(float(e.interval[1])),
                "identifiable": "yes" if e.identifiable else "no",
                "explained": "yes" if fit.goodness.explained else "no",
            }  # fmt: skip


def largest_difference(
    scenario: dict[str, Any], lines: Sequence[Any], f_e: float, ratio: float
) -> tuple[float, int]:
    """Largest relative difference of amplitudes between microvib's simulation and an integrator's
    ``lines``, of those above a hundredth of the largest, and how many these are.

    The integrator's samples are means over 1/32768 s, which takes 0.3 % of a line at 1400 Hz: that is
    put back.
    """
    motion = mv.simulate(scenario_of(scenario, "the true drive"), channels=("T_d",))
    rate, x = motion.sample_rate, motion["T_d"]
    n = round(math.floor(f_e * x.size / rate) / f_e * rate)
    x = x[:n] - np.mean(x[:n])
    weights = 1.0 - np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    largest = max(line.amplitude for line in lines)
    off = []
    for line in lines:
        if line.amplitude > 0.01 * largest:
            f = line.frequency * ratio
            turn = np.exp(-2j * np.pi * f * np.arange(n) / rate)
            size = 2.0 * abs(np.sum(weights * x * turn)) / np.sum(weights) * np.sinc(f / 32768.0)
            off.append(abs(size / line.amplitude - 1.0))
    return max(off), len(off)
