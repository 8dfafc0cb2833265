"""Scores of estimates against the truth, from tables alone: whoever made them, in whatever language."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

SCORED = 10.0
"""Times the least standard deviation of its amplitude from which a line must be found."""
OF_LARGEST = 1e-3
"""Part of a recording's largest line from which one must be found."""
KNOWN = 3.0
"""Times it, from which an estimate that is there is no false line."""
NORMAL = 1.96
"""Standard deviations of an interval of 95 %."""
_MODE_LOW, _MODE_HIGH = 0.75, 1.1
"""Clamped frequencies of an array's modes within which lines are not scored: they ring there."""


@dataclass(frozen=True)
class Truth:
    """What is known of one recording."""

    duration: float
    lines: np.ndarray
    """(lines, 4): frequency [Hz], amplitude [N m], phase [rad], least standard deviation [N m]."""
    unscored: np.ndarray
    """Frequencies [Hz] of orders without one amplitude."""
    modes: np.ndarray
    """Clamped frequencies [Hz]."""

    @property
    def bin(self) -> float:
        return 1.0 / self.duration

    def rings(self, frequency: float) -> bool:
        """Whether an array's mode may ring there."""
        low, high = (
            _MODE_LOW * self.modes - 1.5 * self.bin,
            _MODE_HIGH * self.modes + 1.5 * self.bin,
        )
        return bool(np.any((frequency >= low) & (frequency <= high)))

    @property
    def scored(self) -> np.ndarray:
        """Which lines must be found, (lines,)."""
        least = np.maximum(SCORED * self.lines[:, 3], OF_LARGEST * np.max(self.lines[:, 1]))
        large = self.lines[:, 1] >= least
        far = self.lines[:, 0] >= 3.0 * self.bin
        steady = np.array([not self.rings(f) for f in self.lines[:, 0]], dtype=bool)
        return large & far & steady


@dataclass
class Score:
    """Counts and errors of one estimator over some recordings."""

    recordings: int = 0
    lines: int = 0
    missed: list[float] = field(default_factory=list)
    """Part of each recording's lines."""
    false: int = 0
    amplitude: list[float] = field(default_factory=list)
    """Relative errors."""
    over_least: list[float] = field(default_factory=list)
    """Errors of amplitudes over their least standard deviation."""
    frequency: list[float] = field(default_factory=list)
    """Errors in bins."""
    phase: list[float] = field(default_factory=list)
    inside: dict[str, list[float]] = field(default_factory=dict)
    """Of each figure: the part of each recording's stated intervals that hold the truth."""

    def add(self, truth: Truth, estimates: np.ndarray) -> None:
        """Count one recording's estimates (n, 6)."""
        self.recordings += 1
        self.lines += int(np.sum(truth.scored))
        matched = _matches(truth, estimates)
        self.false += sum(
            _is_false(truth, row, i in matched.values()) for i, row in enumerate(estimates)
        )
        asked = np.flatnonzero(truth.scored).tolist()
        found = [k for k in asked if k in matched]
        if asked:
            self.missed.append(1.0 - len(found) / len(asked))
        held: dict[str, list[bool]] = {}
        for k in found:
            for name, inside in self._errors(truth, truth.lines[k], estimates[matched[k]]):
                held.setdefault(name, []).append(inside)
        for name, each in held.items():
            self.inside.setdefault(name, []).append(float(np.mean(each)))

    def _errors(
        self, truth: Truth, line: np.ndarray, row: np.ndarray
    ) -> Iterator[tuple[str, bool]]:
        """Count the errors of a line; which of its figures have an interval, and whether it holds
        the truth.
        """
        errors = {
            "frequency": row[0] - line[0],
            "amplitude": row[1] - line[1],
            "phase": float(np.angle(np.exp(1j * (row[2] - line[2])))),
        }
        self.amplitude.append(errors["amplitude"] / line[1])
        self.over_least.append(errors["amplitude"] / line[3])
        self.frequency.append(errors["frequency"] / truth.bin)
        self.phase.append(errors["phase"])
        for (name, error), sd in zip(errors.items(), row[3:], strict=True):
            if math.isfinite(sd):
                yield name, bool(abs(error) <= NORMAL * sd)


def _matches(truth: Truth, estimates: np.ndarray) -> dict[int, int]:
    """The largest estimate within a bin of each true line, nearest lines first: by line."""
    found: dict[int, int] = {}
    for i in np.argsort(-estimates[:, 1], kind="stable").tolist():
        apart = np.abs(truth.lines[:, 0] - estimates[i, 0])
        near = [k for k in np.flatnonzero(apart < truth.bin).tolist() if k not in found]
        if near:
            found[min(near, key=lambda k: apart[k])] = i
    return found


def _is_false(truth: Truth, row: np.ndarray, matched: bool) -> bool:
    """Whether an estimate is of nothing that is there."""
    f, amplitude = row[0], row[1]
    if truth.rings(f) or f < 3.0 * truth.bin:
        return False
    if np.any(np.abs(truth.unscored - f) < truth.bin):
        return False
    near = np.abs(truth.lines[:, 0] - f) < truth.bin
    there = near & (truth.lines[:, 1] > np.maximum(KNOWN * truth.lines[:, 3], 0.3 * amplitude))
    return not (matched and bool(np.any(there)))


def share(hits: Sequence[float]) -> float:
    """Mean in per cent."""
    return 100.0 * float(np.mean(hits)) if len(hits) else math.nan


def line_row(name: str, score: Score) -> list[str]:
    """A row of the table of lines."""

    def of(values: Sequence[float], factor: float, form: str) -> str:
        if not values:
            return "-"
        middle, high = np.quantile(np.abs(values), [0.5, 0.95]) * factor
        return f"{middle:{form}} / {high:{form}}"

    inside = [
        f"{share(score.inside[key]):.1f}" if key in score.inside else "none stated"
        for key in ("frequency", "amplitude", "phase")
    ]
    return [
        name, str(score.lines), f"{share(score.missed):.1f}",
        f"{score.false / max(score.recordings, 1):.2f}", of(score.frequency, 1e3, ".2g"),
        of(score.amplitude, 100.0, ".2g"), of(score.over_least, 1.0, ".2g"), of(score.phase, 1e3, ".2g"), *inside,
    ]  # fmt: skip


def coverage_row(name: str, scores: Sequence[Score]) -> list[str]:
    """A row of the table of intervals over several groups of recordings: means over all recordings,
    with their standard errors.
    """
    row = [name]
    for key in ("frequency", "amplitude", "phase"):
        each = [100.0 * part for score in scores for part in score.inside.get(key, ())]
        if len(each) > 1:
            error = float(np.std(each, ddof=1)) / math.sqrt(len(each))
            row.append(f"{float(np.mean(each)):.1f} ± {error:.1f}")
        else:
            row.append(f"{each[0]:.1f} of one" if each else "none stated")
    return row


COVERAGE_HEADER = ["estimator", "frequency in 95 %", "amplitude in 95 %", "phase in 95 %"]


LINE_HEADER = [
    "estimator", "lines", "missed %", "false a recording", "frequency, bins/1000", "amplitude %",
    "amplitude over least", "phase, mrad", "frequency in 95 %", "amplitude in 95 %", "phase in 95 %",
]  # fmt: skip


def parameter_rows(
    truths: Mapping[str, Mapping[str, float]], rows: Iterable[Mapping[str, str]]
) -> list[list[str]]:
    """Table of parameters: of each key how many have an interval, hold the truth, and errors."""
    of: dict[str, list[tuple[float, float, float, float, bool]]] = {}
    for row in rows:
        truth = truths[row["case"]][row["key"]]
        figures = (float(row["estimate"]), float(row["low"]), float(row["high"]))
        of.setdefault(row["key"], []).append((truth, *figures, row["identifiable"] == "yes"))
    table = []
    for key, each in of.items():
        stated = [e for e in each if e[2] <= e[3]]
        sure = [e for e in each if e[4]]
        errors = [abs(e[1] / e[0] - 1.0) for e in sure]
        inside = [e[2] <= e[0] <= e[3] for e in sure]
        every = [e[2] <= e[0] <= e[3] for e in stated]
        table.append([
            key, str(len(each)), str(len(sure)), f"{sum(inside)} of {len(sure)}",
            f"{sum(every)} of {len(stated)}",
            f"{100.0 * float(np.median(errors)):.2f}" if errors else "-", _rms_deviations(sure),
        ])  # fmt: skip
    return table


PARAMETER_HEADER = [
    "key", "recordings", "identifiable", "of these, truth in 95 %", "truth in 95 %, of all stated",
    "median error %", "RMS error, deviations",
]  # fmt: skip


def _rms_deviations(each: Sequence[tuple[float, float, float, float, bool]]) -> str:
    """RMS of errors over their standard deviations, as the side of the interval has it on which the
    truth lies.
    """
    if not each:
        return "-"
    ratios = [
        NORMAL * (truth - estimate) / ((high if truth > estimate else low) - estimate)
        for truth, estimate, low, high, _ in each
    ]
    return f"{math.sqrt(float(np.mean(np.square(ratios)))):.2f}"
