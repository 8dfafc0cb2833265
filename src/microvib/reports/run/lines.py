"""Lines of a run as tables: with their margins to a limit, over draws of the noise, and beside
measured ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

from microvib.analysis.limits import Judgement
from microvib.analysis.reference import (
    ReferenceRow,
    compare_with_reference,
    comparison_worth,
    estimator_text,
)
from microvib.model.scenario import Scenario
from microvib.reports.document import Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item
from microvib.results import DECIBEL, TORQUE, TORQUE_UNCERTAINTY, Column, Measure, Table
from microvib.signals.line_table import BELOW_FLOOR, Line, LineTable, SeedLine

MAX_LINES = 10
"""Lines on the first page."""
_FREQUENCY = Measure("Hz", form="#.7g")
_PHASE = Measure("rad", form=".3f")
_FACTOR = Measure(form="#.3g")


@dataclass(frozen=True)
class LineRow:
    """A line as readers see it; SI units."""

    line: Annotated[str, Column("line", "line")]
    expected: Annotated[float, Column("expected_hz", "expected", _FREQUENCY)]
    frequency: Annotated[float, Column("frequency_hz", "frequency", _FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    amplitude_uncertainty: Annotated[
        float,
        Column("amplitude_uncertainty_n_m", "± (1σ)", TORQUE_UNCERTAINTY, report_only=True),
    ]
    spread: Annotated[float, Column("spread_n_m", "± (ranges)", TORQUE_UNCERTAINTY)]
    """How far it moves within the ranges that sources note."""
    phase: Annotated[float, Column("phase_rad", "phase", _PHASE, report_only=True)]
    bin_amplitude: Annotated[float, Column("bin_amplitude_n_m", "nearest bin", TORQUE)]
    origin: Annotated[str, Column("origin", "what it is", report_only=True)]
    limit: Annotated[float, Column("limit_n_m", "limit there", TORQUE)]
    margin: Annotated[float, Column("margin_db", "margin", DECIBEL)]
    factor: Annotated[float, Column("factor", "factor", _FACTOR)]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]
    status: Annotated[str, Column("status", "status")]
    """Empty for a line that is simply seen."""


_MAIN = ("line", "frequency_hz", "amplitude_n_m", "spread_n_m", "origin", "status")
_JUDGED = (
    "line", "frequency_hz", "amplitude_n_m", "spread_n_m", "margin_db", "factor", "verdict", "status",
)  # fmt: skip
"""Columns of the first page, without a limit and with one."""
_BY_CURVE = (
    "line", "frequency_hz", "amplitude_n_m", "limit_n_m", "margin_db", "verdict", "status",
)  # fmt: skip
"""Columns with a limit over frequency."""
_ALL = (
    "line", "expected_hz", "frequency_hz", "amplitude_n_m", "amplitude_uncertainty_n_m",
    "spread_n_m", "phase_rad", "bin_amplitude_n_m", "origin", "margin_db", "verdict", "status",
)  # fmt: skip


def line_row(line: Line, judged: Judgement | None) -> LineRow:
    """A line, with its margin as dB and as a factor where it is judged."""
    found = None if judged is None else judged.of(line)
    return LineRow(
        line.name,
        line.expected,
        line.frequency,
        line.amplitude,
        line.amplitude_uncertainty if math.isfinite(line.amplitude) else math.nan,
        line.spread,
        line.phase,
        line.bin_amplitude,
        line.origin,
        math.nan if found is None else found.limit,
        math.nan if found is None else found.decibel,
        math.nan if found is None else found.factor,
        _verdict(line, judged),
        "" if line.status == "ok" else line.status,
    )


def _verdict(line: Line, judged: Judgement | None) -> str:
    """Verdict on a line, which may also lie outside of the limit's band; empty without a limit."""
    if judged is None:
        return ""
    found = judged.of(line)
    if found is not None:
        return found.verdict
    if judged.limit.curve is None:
        return ""
    if line in judged.unknown:
        return "not judged"
    return "outside"


def _rows(lines: Iterable[Line], judged: Judgement | None) -> list[LineRow]:
    return [line_row(line, judged) for line in lines]


def largest_lines(lines: LineTable) -> list[Line]:
    """Lines that are seen and worth a row, the largest first."""
    seen = [x for x in lines.notable() if x.seen]
    return sorted(seen, key=lambda x: -x.amplitude)


def main_lines(lines: LineTable, judged: Judgement | None) -> list[Line]:
    """The largest lines, or those with the smallest margins, by frequency."""
    found = largest_lines(lines)
    if judged is not None and judged.limit.curve is not None:
        found = [m.line for m in judged.margins]
    return sorted(found[:MAX_LINES], key=lambda x: x.frequency)


def main_table(lines: LineTable, judged: Judgement | None) -> Table:
    """The lines of the first page; a terminal has all of them anyway."""
    shown = main_lines(lines, judged)
    most = "largest amplitudes" if judged is None else "smallest margins"
    which = ""
    if len(shown) < len(lines):
        which = f"The {len(shown)} of {len(lines)} lines with the {most}. "
    keys: tuple[str, ...] = _MAIN
    if judged is not None:
        keys = _JUDGED if judged.limit.is_one_number else _BY_CURVE
    caption = f"{which}Amplitudes 0-to-peak."
    return Table.of("", LineRow, _rows(shown, judged), brief=0, caption=caption).only(keys)


_READING = (
    "Amplitudes are 0-to-peak and do not depend on where the bins fall; ± is how well the line of"
    " this record is known. Nearest bin is the figure of a rectangular window, which reads up to"
    " 36 % low between bins. A decaying line is"
    " quoted with its mean over the record. Phases are those of a cosine at the first sample."
)


def all_lines(lines: LineTable, judged: Judgement | None) -> Iterator[Item]:
    """The lines worth a row and those that fail, and what was left out."""
    shown = _worth_a_row(lines, judged)
    yield Table.of(
        "",
        LineRow,
        _rows(lines, judged),
        for_readers=_rows(shown, judged),
        caption=_READING,
    ).only(_ALL)
    if not any(x.seen for x in lines):
        yield Text(
            "No line above the noise floor: the record is too short, its sample rate too low, or nothing"
            " moves."
        )
    yield from map(Text, _left_out(lines, shown))


def _worth_a_row(lines: LineTable, judged: Judgement | None) -> list[Line]:
    worth = {x.name for x in lines.notable()}
    if judged is not None:
        worth |= {m.line.name for m in judged.margins if m.fails}
    return [x for x in lines if x.name in worth]


def _left_out(lines: LineTable, shown: Sequence[Line]) -> Iterator[str]:
    """Sentences on the lines that are left to the CSV file."""
    faint = [x.name for x in lines if x.status == BELOW_FLOOR]
    small = len(lines) - len(faint) - sum(x.status != BELOW_FLOOR for x in shown)
    if small:
        yield f"{count_text(small, 'small line')} more in `lines.csv`."
    if faint:
        yield f"Expected, but not above the floor: {', '.join(faint)}."


def lines_over_seeds(lines: LineTable, judged: Judgement | None) -> Iterator[Item]:
    """The lines worth a row over many draws of the noise."""
    shown = _worth_a_row(lines, judged)
    found = [seed for x in shown if (seed := lines.over_seeds(x.name))]
    if not found:
        return
    yield Text(
        f"Over {found[0].draws} draws of the noise, this record's and those of the following seeds."
        " The 95 % quantile is given with what this many draws say about it, each bound with 95 %"
        " confidence; fewer than 59 do not bound it from above."
    )
    yield Table.of("", SeedLine, found)


def beside_reference(scenario: Scenario, lines: LineTable) -> Iterator[Item]:
    """The reference lines of a scenario beside those of a run."""
    found, reference = compare_with_reference(scenario, lines), scenario.reference
    if not found or reference is None:
        return
    yield Text(
        f"Measured, and by the publication's own model: {reference.source}. Amplitudes:"
        f" {estimator_text(reference)}; {comparison_worth(scenario)}."
    )
    caption = "The last columns are differences of amplitude."
    yield Table.of("", ReferenceRow, found, caption=caption)
