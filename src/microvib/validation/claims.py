"""Claims of a published test, and whether amplitudes of its states meet them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from microvib.io.scenario_file import load_scenario
from microvib.model.reference import ReferenceLine
from microvib.model.scenario import Scenario
from microvib.validation.published import LargerClaim, PeakClaim, PublishedTest

Amplitudes = Mapping[int, np.ndarray]
"""Amplitudes of each state by its number, of the test's lines and last the largest torque [N m],
(lines + 1,); of a state from power-on, under its number with a minus sign, the largest torque
alone is known.
"""


@dataclass(frozen=True)
class Claim:
    """One claim: what is compared, and whether it holds."""

    item: str
    source: str
    bar: str
    value: Callable[[Amplitudes], float]
    holds: Callable[[float], bool]
    published: float = math.nan
    """Published value, or its bound."""
    is_measured: bool = False
    """Whether ``published`` is a measured value, of which an error can be told."""


def scenario_of_state(test: PublishedTest, number: int) -> Scenario:
    """The scenario of a state."""
    return load_scenario(test.states[number - 1].scenario)


def reference_lines(test: PublishedTest) -> tuple[ReferenceLine, ...]:
    """Lines that were measured in the first state that has some; none where no state has."""
    for number in range(1, len(test.states) + 1):
        reference = scenario_of_state(test, number).reference
        if reference is not None:
            return reference.lines
    return ()


def line_names(test: PublishedTest) -> tuple[str, ...]:
    """Names of the lines that the test tells of: those that were measured first."""
    named = [one.line for one in reference_lines(test)]
    named += [line for claim in test.ranges for line in claim.lines]
    named += [line for claim in test.growths for line in claim.lines]
    named += [line for claim in test.larger for line in (claim.line, claim.than)]
    return tuple(dict.fromkeys(named))


def power_on_states(test: PublishedTest) -> tuple[int, ...]:
    """States of which the torque from power-on is compared."""
    return tuple(dict.fromkeys(x.state for x in test.peaks if x.when == "from power-on"))


def claims_of(test: PublishedTest) -> tuple[Claim, ...]:
    """All claims of the test, in the order of its file."""
    names = line_names(test)
    return (
        *_ranges(test, names),
        *_growths(test, names),
        *(_peak(claim) for claim in test.peaks),
        *(_larger(claim, names) for claim in test.larger),
    )


def _ranges(test: PublishedTest, names: Sequence[str]) -> Iterator[Claim]:
    for claim in test.ranges:
        for line in claim.lines:
            yield Claim(
                f"{line}, range of amplitudes over states {_numbers(claim.states)} [N m]",
                claim.source,
                f"at most {claim.at_most:g} N m",
                _range(names.index(line), claim.states),
                _at_most(claim.at_most),
                claim.at_most,
            )


def _growths(test: PublishedTest, names: Sequence[str]) -> Iterator[Claim]:
    for claim in test.growths:
        for line in claim.lines:
            for first, second in claim.pairs:
                yield Claim(
                    f"{line} grows with {claim.cause}: state {second} over state {first} [1]",
                    claim.source,
                    "greater than 1",
                    _ratio(names.index(line), first, second),
                    _exceeds_one,
                )


def _peak(claim: PeakClaim) -> Claim:
    sign = -1 if claim.when == "from power-on" else 1
    return Claim(
        f"largest disturbance torque {claim.when} [N m]",
        claim.source,
        f"within a factor of {claim.factor:g}",
        lambda of: float(of[sign * claim.state][-1]),
        lambda value: 1.0 / claim.factor <= value / claim.value <= claim.factor,
        claim.value,
        is_measured=True,
    )


def _larger(claim: LargerClaim, names: Sequence[str]) -> Claim:
    first, second = names.index(claim.line), names.index(claim.than)
    words = claim.words or f"{claim.line} over {claim.than}, state {claim.state}"
    return Claim(
        f"{words} [1]",
        claim.source,
        "greater than 1",
        lambda of: float(of[claim.state][first] / of[claim.state][second]),
        _exceeds_one,
    )


def _range(k: int, states: Iterable[int]) -> Callable[[Amplitudes], float]:
    return lambda of: float(np.ptp([of[number][k] for number in states]))


def _ratio(k: int, first: int, second: int) -> Callable[[Amplitudes], float]:
    return lambda of: float(of[second][k] / of[first][k])


def _at_most(bound: float) -> Callable[[float], bool]:
    return lambda value: value <= bound


def _exceeds_one(value: float) -> bool:
    return value > 1.0


def _numbers(states: Sequence[int]) -> str:
    if len(states) > 2 and all(b == a + 1 for a, b in pairwise(states)):
        return f"{states[0]}-{states[-1]}"
    return ", ".join(map(str, states))
