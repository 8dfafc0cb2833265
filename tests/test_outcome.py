"""Results that are declared once: files, terminal, report and page say the same of them."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from typing import Annotated

import pytest

from microvib.reports.document import Text
from microvib.reports.outcome import Outcome, Part, page_answer, study_contents, terminal_text
from microvib.results import RATE, TORQUE, Column, Table


@dataclass(frozen=True)
class Found:
    """A record with a field that no table has."""

    rate: Annotated[float, Column("rate_deg_s", "rate", RATE, absent="none")]
    amplitude: Annotated[float, Column("amplitude_n_m", "largest line", TORQUE)]
    line: Annotated[str, Column("line", "line")]
    order: Annotated[float, Column("order", measure=RATE)]
    kept: str = "nobody sees it"


FOUND = [
    Found(math.radians(0.06), 0.0121, "drive_1", math.radians(2.0)),
    Found(math.nan, math.nan, "drive_2", math.nan),
    Found(math.radians(0.3), 1.5, "=1+1", math.nan),
]


@pytest.fixture(scope="module")
def outcome(state_1) -> Outcome:
    table = Table.of("found", Found, FOUND, for_readers=FOUND[:2], brief=1, caption="A caption.")
    parts = (
        Part("", (Text("In `words`."),)),
        Part("Lines", (table,)),
        Part("Nothing", ()),
    )
    return Outcome("Study", "A study", "Three cases.", "pass", (), parts, state_1)


def test_files_have_all_rows_and_columns_in_their_units(outcome):
    files, _ = study_contents(outcome)
    assert list(files) == ["found.csv"]
    head, *rows = csv.reader(io.StringIO(files["found.csv"]))
    assert head == ["rate_deg_s", "amplitude_n_m", "line", "order"]
    assert rows[0] == ["0.06", "0.0121", "drive_1", "2"]
    assert rows[1] == ["", "", "drive_2", ""]
    assert len(rows) == 3
    assert rows[2][2] != "=1+1"  # a spreadsheet would compute it


def test_a_terminal_shows_the_first_rows_under_headings_with_units(outcome):
    said = terminal_text(outcome)
    assert said.startswith("Three cases.\n\nIn words.\n\nLines:\n")
    assert "rate [deg/s]" in said
    assert said.count("drive_") == 1
    assert "Nothing" not in said


def test_report_and_page_show_the_same_cells(outcome):
    _, report = study_contents(outcome)
    [_, lines, *_] = [report.first_page, *(s.blocks for s in report.sections)]
    [shown] = lines
    answer = page_answer(outcome)
    [given] = answer["parts"][1]["tables"]
    assert [row.cells for row in shown.rows] == [tuple(row.values()) for row in given["rows"]]
    assert given["rows"][0] == {"rate_deg_s": "0.06", "amplitude_n_m": "12.10", "line": "drive_1"}
    assert given["rows"][1] == {"rate_deg_s": "none", "amplitude_n_m": "", "line": "drive_2"}
    assert [(x.title, x.unit) for x in shown.columns] == [
        (x["title"], x["unit"]) for x in given["columns"]
    ]
    assert shown.caption == given["caption"] == "A caption."
    assert "Nothing" not in [section.title for section in report.sections]
