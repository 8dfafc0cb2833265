"""Whether a run can be trusted: its invariants, each against a bar, with a verdict in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from microvib.analysis.accuracy import read_error_estimate
from microvib.analysis.run import RunResult
from microvib.model.line_names import SECOND_DRIVE
from microvib.reports.document import Text
from microvib.reports.outcome import Item
from microvib.results import Column, Measure, Table
from microvib.solve.motion import BALANCE_TOLERANCE, JOULE_HEAT_TOLERANCE, Motion

_MEANINGS = {
    "torque_forms": "largest difference of momentum form and force form of T_d, over the largest T_d",
    "momentum": "mean torque that the change of angular momentum does not account for, over the largest T_d",
    "energy": "|energy in - stored - dissipated| over the electrical energy supplied",
    "energy_mechanical": (
        "the same over the energy beyond Joule heat, which is the stricter figure; allowed are"
        f" {BALANCE_TOLERANCE:g} of it and"
        f" {JOULE_HEAT_TOLERANCE:g} of the electrical energy"
    ),
}


@dataclass(frozen=True)
class InvariantRow:
    """An invariant with its bar and whether it holds."""

    name: Annotated[str, Column("invariant", "invariant")]
    value: Annotated[float, Column("value", "value", Measure(form=".2g"))]
    bar: Annotated[float, Column("bar", "at most", Measure(form=".3g"))]
    meaning: Annotated[str, Column("meaning", "meaning")]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]


def drives(result: RunResult) -> dict[str, Motion | RunResult]:
    """Result of each stepping drive, its motion if there is one, by how texts call what
    is theirs.
    """
    motion = result.motion
    if motion is None:
        return {**result.drives}
    if motion.second_wing is None:
        return {"": motion.alone}
    return {"": motion.alone, f" of {SECOND_DRIVE}": motion.second_wing}


def failed_invariants(result: RunResult) -> list[str]:
    """Names of the invariants that do not hold, of any drive."""
    broken = (name for one in drives(result).values() for name in one.invariants.broken)
    return list(dict.fromkeys(broken))


def invariants_sentence(one: Motion | RunResult, fails: list[str]) -> str:
    """Whether all invariants hold, with the two of one drive that say most."""
    values = one.invariants
    figures = (
        f"momentum within {values.momentum:.1e}, energy beyond Joule heat within"
        f" {values.energy_mechanical:.1e}"
    )
    if fails:
        return f"NOT all hold ({', '.join(fails)}); {figures}"
    return f"all hold; {figures}"


def invariants(result: RunResult) -> Iterator[Item]:
    """Every invariant of each drive with its bar and verdict, and what they do not say."""
    fails = failed_invariants(result)
    for whose, one in drives(result).items():
        yield from _of_drive(whose, one, fails)


def _of_drive(whose: str, one: Motion | RunResult, fails: list[str]) -> Iterator[Item]:
    values = one.invariants
    if fails:
        yield Text(f"Invariants{whose}: NOT to be used, {', '.join(fails)} above tolerance.")
    else:
        yield Text(f"All invariants{whose} hold.")
    rows = (
        InvariantRow(
            name.replace("_", " "),
            getattr(values, name),
            bar,
            _MEANINGS[name],
            "does NOT hold" if name in fails else "holds",
        )
        for name, bar in values.bars.items()
    )
    yield Table.of("", InvariantRow, rows)
    yield Text(
        f"Since the start {values.energy_in:.4g} J of electrical energy were supplied,"
        f" {values.energy_dissipated:.4g} J dissipated, {values.energy_stored:.4g} J stored."
    )
    finer = "To see the lines converge, run again with `solver.refinement=2` and `4`: every step is then that many times finer."
    estimate = read_error_estimate(one.solver)
    if estimate is not None:
        finer = f"The run was done again from the same state with finer steps: {estimate}."
    yield Text(f"These invariants do not bound the error of a line. {finer}")
