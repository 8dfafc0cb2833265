"""Lines of a run against a limit: the margin of each, and what could not be judged."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microvib.signals.table import DETECTION, FAINT, Line, LineTable


@dataclass(frozen=True)
class Limit:
    """Largest amplitude, 0-to-peak [N m], that a line may have between two frequencies [Hz]."""

    torque: float
    low: float = 0.0
    high: float = math.inf

    @property
    def band(self) -> str:
        """The band in words; empty where the limit holds for all frequencies."""
        return f"from {self.low:g} to {self.high:g} Hz" if math.isfinite(self.high) else ""


@dataclass(frozen=True)
class Margin:
    """One line against the limit."""

    line: Line
    amplitude: float
    """What is judged [N m]: the line's amplitude, or what a line that was not found may have at most."""
    factor: float
    """Limit over amplitude."""

    @property
    def decibel(self) -> float:
        """The factor in dB."""
        return 20.0 * math.log10(self.factor)

    @property
    def passes(self) -> bool:
        """Whether the amplitude is at most the limit."""
        return self.factor >= 1.0


@dataclass(frozen=True)
class Judgement:
    """All lines within the band against the limit, the smallest margin first, and those of which no amplitude is known."""

    limit: Limit
    margins: tuple[Margin, ...]
    unknown: tuple[Line, ...]

    @property
    def above(self) -> int:
        """How many lines are above the limit."""
        return sum(not m.passes for m in self.margins)

    def of(self, line: Line) -> Margin | None:
        """Margin of one line; None where it was not judged."""
        return next((m for m in self.margins if m.line.line == line.line), None)

    def __str__(self) -> str:
        band = f" {self.limit.band}" if self.limit.band else ""
        if not self.margins:
            return f"Limit {1e3 * self.limit.torque:.4g} mN m: no line{band} to judge."
        verdict = f"FAIL, {self.above} of {len(self.margins)} lines above" if self.above else "pass"
        return f"Limit {1e3 * self.limit.torque:.4g} mN m{band}: {verdict}{self._worst()}."

    def _worst(self) -> str:
        worst = self.margins[0]
        if math.isinf(worst.factor):
            return ""
        return f"; smallest margin {worst.decibel:+.1f} dB, factor {worst.factor:.3g} ({worst.line.line})"


def judge(table: LineTable, limit: Limit) -> Judgement:
    """Every line of the table within the band, also those that a report leaves out for being small."""
    within = [x for x in table if limit.low <= _frequency(x) <= limit.high]
    margins = [_margin(x, limit) for x in within if math.isfinite(x.amplitude_n_m)]
    unknown = tuple(x for x in within if not math.isfinite(x.amplitude_n_m))
    return Judgement(limit, tuple(sorted(margins, key=lambda m: m.factor)), unknown)


def _frequency(line: Line) -> float:
    return line.frequency_hz if math.isfinite(line.frequency_hz) else line.expected_hz


def _margin(line: Line, limit: Limit) -> Margin:
    amplitude = line.amplitude_n_m
    if line.status == FAINT:
        amplitude = max(amplitude, DETECTION * line.floor_n_m)
    return Margin(line, amplitude, limit.torque / amplitude if amplitude > 0.0 else math.inf)
