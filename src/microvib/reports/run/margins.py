"""Lines against a limit: each with what is allowed where it stands, the worst first, of the torque about
the drive axis and of every load that has a limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from microvib.analysis.limits import Judgement
from microvib.analysis.margins import Margin
from microvib.io.tables import rows_csv
from microvib.reports.document import Text
from microvib.reports.outcome import Item
from microvib.results import DECIBEL, TORQUE, Column, Measure, Table

MOST_SHOWN = 20
"""Lines of the torque, and of forces, that a report lists; all of them are in margins.csv."""
_TORQUE_NAME = "T_d"
_FREQUENCY = Measure("Hz", form="#.6g")
_FORCE = Measure("mN", 1e-3, "#.4g")


@dataclass(frozen=True)
class MarginRow:
    """A line and its limit; SI units."""

    component: Annotated[str, Column("component", "of")]
    line: Annotated[str, Column("line", "line")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", _FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    """Amplitude that is judged: of a decaying line that at the start of the record."""
    limit: Annotated[float, Column("limit_n_m", "limit there", TORQUE)]
    force: Annotated[float, Column("amplitude_n", "amplitude", _FORCE)]
    force_limit: Annotated[float, Column("limit_n", "limit there", _FORCE)]
    margin: Annotated[float, Column("margin_db", "margin", DECIBEL)]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]
    why: Annotated[str, Column("why")]


_SHOWN = ("component", "line", "frequency_hz", "margin_db", "verdict")
_OF_TORQUE = (*_SHOWN[:3], "amplitude_n_m", "limit_n_m", *_SHOWN[3:])
_OF_FORCE = (*_SHOWN[:3], "amplitude_n", "limit_n", *_SHOWN[3:])


def margin_rows(judged: Judgement) -> list[MarginRow]:
    """Every line that is judged, the smallest margin first."""
    found = [
        _row(one.component or _TORQUE_NAME, margin) for one in judged.each for margin in one.margins
    ]
    return sorted(found, key=lambda row: row.margin)


def _row(component: str, one: Margin) -> MarginRow:
    known = one.amplitude, one.limit
    nothing = math.nan, math.nan
    is_force = component.startswith("F")
    return MarginRow(
        component,
        one.line.name,
        one.line.place,
        *(nothing if is_force else known),
        *(known if is_force else nothing),
        one.decibel,
        one.verdict,
        one.why,
    )


def margin_items(judged: Judgement) -> Iterator[Item]:
    """The lines with the smallest margins to limits over frequency; nothing where the limit is one
    number, which the tables of lines have margins to.
    """
    if judged.limit.is_one_number:
        return
    yield from margin_tables(judged)
    yield Text(
        "The limit is the strictest within the uncertainty of the line's frequency; between"
        " points of the curve it is straight on logarithmic scales."
    )


def margin_tables(judged: Judgement) -> Iterator[Table]:
    """The lines with the smallest margins, those of torques and of forces."""
    rows = margin_rows(judged)
    yield from _part([row for row in rows if not row.component.startswith("F")], _OF_TORQUE)
    yield from _part([row for row in rows if row.component.startswith("F")], _OF_FORCE)


def _part(rows: list[MarginRow], keys: tuple[str, ...]) -> Iterator[Table]:
    if not rows:
        return
    shown = rows[:MOST_SHOWN]
    which = "Smallest margins first."
    if len(shown) < len(rows):
        which = f"The {len(shown)} of {len(rows)} lines with the smallest margins; all are in `margins.csv`."
    caption = f"{which} Amplitudes 0-to-peak."
    yield Table.of("", MarginRow, rows, for_readers=shown, caption=caption).only(keys)


def margins_csv(judged: Judgement) -> str:
    """CSV text of every line that is judged, the smallest margin first."""
    table = Table.of("margins", MarginRow, margin_rows(judged))
    return rows_csv([column.key for column in table.columns], table.file_rows())


def judgement_data(judged: Judgement) -> dict[str, Any]:
    """A judgement for JSON: its verdict, what was not judged, and of each curve its smallest margins."""
    return {
        "verdict": judged.verdict,
        "not_judged": list(judged.all_gaps),
        "assumption": judged.assumption,
        "curves": [
            {
                "component": one.component or _TORQUE_NAME,
                "verdict": one.verdict,
                "lines_above": one.above,
                "smallest_margins": list(_smallest(one.margins)),
            }
            for one in judged.each
        ],
    }


def _smallest(margins: Iterable[Margin]) -> Iterator[dict[str, Any]]:
    for one in list(margins)[:MOST_SHOWN]:
        yield {
            "line": one.line.name,
            "frequency_hz": one.line.place,
            "amplitude": one.amplitude,
            "limit": one.limit,
            "margin_db": one.decibel,
            "verdict": one.verdict,
        }
