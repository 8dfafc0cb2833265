"""A run in a terminal: its lines, what a limit says of them, and how far to trust them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from microvib.analysis.limits import Limit, judge, transient_warnings
from microvib.analysis.reference import (
    compare_with_reference,
    comparison_worth,
    estimator_text,
)
from microvib.analysis.run import RunResult
from microvib.analysis.start import steady_state_fallback_note
from microvib.model.scenario import Scenario
from microvib.reports.craft import pointing_facts
from microvib.reports.numbers import brief_number, percent
from microvib.results import POINTING_ANGLE
from microvib.signals.line_table import LineTable
from microvib.text_tables import text_table

_MAX_CONTRIBUTORS = 4
"""Lines that are told of the line of sight."""


def run_text(result: RunResult, limit: Limit | None = None) -> str:
    """What is told of a run; a ``limit`` judges its lines."""
    return "\n".join(
        [*_lines(result.scenario, result.table), *_integration_error_text(result, limit)]
    )


def _lines(scenario: Scenario, table: LineTable) -> Iterator[str]:
    yield f"\n{scenario.title or 'Lines'}: amplitudes 0-to-peak\n"
    yield table.text(notable=True)
    yield from (f"\n{sentence}" for sentence in transient_warnings(table, scenario))
    if not any(line.seen for line in table):
        yield "No line stands out: the record is too short, its sample rate too low, or nothing moves."
    yield from _beside_reference(scenario, table)


def _beside_reference(scenario: Scenario, table: LineTable) -> Iterator[str]:
    rows, reference = compare_with_reference(scenario, table), scenario.reference
    if not rows or reference is None:
        return
    yield (
        f"\nCompared with measured lines, {reference.source} ({estimator_text(reference)}),"
        f" {comparison_worth(scenario)}:\n"
    )
    head = (
        "line",
        "measured Hz",
        "model Hz",
        "this run Hz",
        "measured N m",
        "model N m",
        "this run N m",
        "model %",
        "this run %",
    )
    cells = [
        (
            r.line,
            f"{r.measured_hz:.4f}",
            brief_number(r.model_hz, 7),
            f"{r.run_hz:.4f}",
            f"{r.measured_n_m:.5f}",
            brief_number(r.model_n_m),
            f"{r.run_n_m:.6f}",
            percent(r.model_error),
            percent(r.run_error),
        )
        for r in rows
    ]
    yield text_table(head, cells, left=1)


def _numerics(whose: str, result: RunResult) -> Iterator[str]:
    """How one drive was solved, and how well."""
    solver, i = result.solver, result.invariants
    if result.state is not None:
        yield (
            f"\nSteady state{whose}: repeats every {solver['period_s']:.6g} s"
            f" ({solver['period_microsteps']} microsteps); found"
            f" with {solver['periods_evaluated']:.3g} periods; a deviation falls to"
            f" {solver['multiplier']:.3g} of itself in one"
            f" period, to a hundredth in {solver['settling_s']:.3g} s."
        )
    yield (
        f"\nInvariants{whose}: torque forms {i.torque_forms:.1e}, energy beyond Joule heat"
        f" {i.energy_mechanical:.1e},"
        f" momentum {i.momentum:.1e}. {solver['simulated_s']:.4g} s simulated in"
        f" {solver['wall_s']:.2g} s."
    )
    if result.accuracy is not None:
        yield f"Integration{whose}: {result.accuracy}."


def _integration_error_text(result: RunResult, limit: Limit | None) -> Iterator[str]:
    scenario, second = result.scenario, result.second
    for fact in pointing_facts(result.hub):
        assert result.hub is not None
        window = max(result.hub.windows)
        rms = replace(POINTING_ANGLE, form=".3g")
        costs = (
            f"{name} {rms.suited_to([angle]).figure(angle)}"
            for name, angle in result.hub.ranking("rpe", window)[:_MAX_CONTRIBUTORS]
        )
        yield f"\n{fact.label[0].upper()}{fact.label[1:]}: {fact.value}; largest contributors, rms: {', '.join(costs)}."
    if limit is not None:
        yield f"\n{judge(result.table, limit, scenario, None if second is None else second.table)}"
    if told := steady_state_fallback_note(result.solver):
        yield f"\n{told}"
    for whose, one in result.drives.items():
        yield from _numerics(whose, one)
    if scenario.craft is not None and result.state is None and result.motion is None:
        yield "Loads and line of sight need the motion, or a steady state: leave --lines-only out, or add --steady."
