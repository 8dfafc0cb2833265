"""Names of lines by their place among the orders of the step clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from microvib.model.expected import ExpectedLine
from microvib.model.line_names import driving_line, electrical_line, full_step_line

_CHANCE = 0.05  # a fraction that a frequency anywhere would hit as often by chance is not evidence
_LARGEST = 8  # denominator of the fractions that names are made of


_ELECTRICAL = "electrical period"


def is_slower_than_full_steps(name: str) -> bool:
    """Whether a name of ``ClockOrders.name`` is of a motion that repeats less often than once in a
    microstep or a full step.
    """
    return "/" in name or name.startswith(_ELECTRICAL)


@dataclass(frozen=True)
class ClockOrders:
    """The step clock that a record shows: frequencies [Hz] of microsteps and of full steps (detent
    periods), None where there are none, and what the latter are called."""

    drive: float
    full_step: float | None
    word: str = "full step"
    steps: int = 4
    """Full steps per electrical period."""

    @classmethod
    def of(cls, expected: Sequence[ExpectedLine], ratio: float | None) -> ClockOrders | None:
        """Orders of the ``expected`` lines at a clock ratio; None without a clock."""
        found = {
            line.name: line
            for line in expected
            if line.name in (driving_line(1), full_step_line(1), electrical_line(1))
        }
        if driving_line(1) not in found or ratio is None:
            return None
        full = found.get(full_step_line(1))
        if full:
            word = full.origin.partition(",")[0]
        else:
            word = "full step"
        if full and electrical_line(1) in found:
            steps = round(full.frequency / found[electrical_line(1)].frequency)
        else:
            steps = 4
        return cls(
            found[driving_line(1)].frequency * ratio,
            full.frequency * ratio if full else None,
            word,
            steps,
        )

    @property
    def electrical(self) -> float:
        """Electrical periods per second [Hz]; microsteps, where full steps are not known."""
        if self.full_step:
            return self.full_step / self.steps
        return self.drive

    def whole(self, frequency: float, within: float) -> float | None:
        """The frequency [Hz] of the whole order of microsteps or full steps that is ``within`` so
        many Hz of this one.
        """
        for base in (self.drive, self.full_step):
            k = round(frequency / base) if base else 0
            if base and k > 0 and base > 4.0 * within and abs(frequency - k * base) <= within:
                return k * base
        return None

    def name(self, frequency: float, within: float) -> str | None:
        """The simplest order that lies ``within`` so many Hz of a frequency; None if there is none,
        or where one lay as near any frequency by chance."""
        hits: list[tuple[int, int, str]] = []
        for rank, (base, words) in enumerate(self._families()):
            for q in range(1, _LARGEST + 1):
                p = round(frequency * q / base)
                if p > 0 and abs(frequency - p * base / q) <= within and math.gcd(p, q) == 1:
                    chance = 2.0 * within * sum(_coprime(i) for i in range(1, q + 1)) / base
                    if chance < _CHANCE:
                        hits.append((q, rank, words(p, q)))
        if hits:
            return min(hits)[2]
        return None

    def with_mode(self, frequency: float, modes: Mapping[str, tuple[float, float]]) -> str | None:
        """The order of the clock and the mode whose sum or difference a frequency is; None if there
        is none, or where one lay as near any frequency by chance. ``modes``: by name their
        frequencies [Hz], and within what a sum must agree."""
        base = self.electrical
        for mode, (own, within) in modes.items():
            for word, shifted in (("plus", frequency - own), ("less", frequency + own)):
                order = round(shifted / base) * base
                if (
                    order > 0.0
                    and abs(shifted - order) <= within
                    and 4.0 * within * len(modes) < _CHANCE * base
                ):
                    return f"{self.name(order, 1e-6 * base)} {word} {mode}"
        return None

    def _families(self) -> Iterable[tuple[float, Callable[[int, int], str]]]:
        yield (
            self.drive,
            lambda p, q: (
                f"{p}/{q} of the driving frequency"
                if q > 1
                else f"order {p} of the driving frequency"
            ),
        )
        if self.full_step:
            yield self.full_step, self._of_full_step

    def _of_full_step(self, p: int, q: int) -> str:
        if q == 1:
            return f"{self.word}, order {p}"
        if self.steps % q == 0:
            return f"{_ELECTRICAL}, order {p * self.steps // q}"
        return f"{p}/{q} of the {self.word}"


@lru_cache
def _coprime(q: int) -> int:
    """How many fractions with the denominator ``q`` lie between two whole numbers."""
    return sum(math.gcd(p, q) == 1 for p in range(1, q + 1))
