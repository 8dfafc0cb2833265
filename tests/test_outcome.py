"""Results that are declared once: files, terminal, report and page say the same of them."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from typing import Annotated

import pytest
from matplotlib.figure import Figure

from microvib.reports import sheets
from microvib.reports.document import Text
from microvib.reports.outcome import (
    Outcome,
    Pairs,
    Part,
    Picture,
    page_answer,
    report_table,
    study_contents,
    terminal_text,
    text_files,
)
from microvib.results import POINTING_ANGLE, RATE, TORQUE, TORQUE_UNCERTAINTY, Column, Table


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
    said = terminal_text(replace(outcome, verdict=""))
    assert said.startswith("Three cases.\n\nIn words.\n\nLines:\n")
    assert "rate [deg/s]" in said
    assert said.count("drive_") == 1
    assert "Nothing" not in said


def test_a_verdict_stands_last_on_a_terminal(outcome):
    said = terminal_text(outcome)
    assert said.startswith("Three cases.\n\nLines:\n")
    assert said.endswith("\n\nIn words.")


@dataclass(frozen=True)
class Judged:
    """A requirement with its verdict."""

    name: Annotated[str, Column("name", "requirement")]
    value: Annotated[float, Column("value_rad", "value", POINTING_ANGLE)]
    limit: Annotated[float, Column("limit_rad", "limit", POINTING_ANGLE)]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]


def test_rows_stand_out_by_their_verdict_and_angles_have_one_unit(state_1):
    table = Table.of("judged", Judged, [Judged("P-1", 2e-9, 1e-6, "pass"), Judged("P-2", 3e-6, 2e-6, "fail"),
                                        Judged("P-3", math.nan, 2e-6, "not judged")])  # fmt: skip
    shown = report_table(table)
    assert [column.unit for column in shown.columns] == ["", "µrad", "µrad", ""]
    assert [(row.mark, row.cells) for row in shown.rows] == [
        ("pass", ("P-1", "0.002", "1", "pass")),
        ("fail", ("P-2", "3", "2", "FAIL")),
        ("off", ("P-3", "", "2", "not judged")),
    ]
    assert table.measure("value_rad").figure(3e-9) == "0.003 µrad"
    assert table.file_rows()[1] == ["P-2", 3e-6, 2e-6, "fail"]
    assert table.records()[0] == {
        "name": "P-1",
        "value_rad": 2e-9,
        "limit_rad": 1e-6,
        "verdict": "pass",
    }
    found = Outcome(
        "Study",
        "A study",
        "Said.",
        "fail",
        (),
        (Part("", (table,)),),
        state_1,
        data={"judged": {"x": math.nan}},
    )
    assert text_files(found) == {
        "judged.csv": "name,value_rad,limit_rad,verdict\nP-1,2e-09,1e-06,pass\nP-2,3e-06,2e-06,fail\nP-3,,2e-06,not judged\n",
        "judged.json": '{\n  "x": null\n}\n',
    }  # fmt: skip


def test_rows_of_a_group_stand_under_its_word_in_a_report() -> None:
    columns = (Column("name", "requirement", role="group"), Column("line", "line"))
    table = Table("", columns, (("P-1", "drive_1"), ("P-1", "drive_2"), ("P-2", "drive_1")))
    shown = report_table(table)
    assert [column.title for column in shown.columns] == ["line"]
    assert [(row.mark, row.cells) for row in shown.rows] == [
        ("group", ("P-1",)),
        ("", ("drive_1",)),
        ("", ("drive_2",)),
        ("group", ("P-2",)),
        ("", ("drive_1",)),
    ]


def test_report_and_page_show_the_same_cells(outcome):
    _, report = study_contents(outcome)
    [_, lines, *_] = [report.first_page, *(s.blocks for s in report.sections)]
    [shown] = lines
    answer = page_answer(outcome)
    [given] = answer["parts"][1]["items"]
    assert [row.cells for row in shown.rows] == [tuple(row.values()) for row in given["rows"]]
    assert given["rows"][0] == {"rate_deg_s": "0.06", "amplitude_n_m": "12.10", "line": "drive_1"}
    assert given["rows"][1] == {"rate_deg_s": "none", "amplitude_n_m": "", "line": "drive_2"}
    assert [(x.title, x.unit) for x in shown.columns] == [
        (x["title"], x["unit"]) for x in given["columns"]
    ]
    assert shown.caption == given["caption"] == "A caption."
    assert "Nothing" not in [section.title for section in report.sections]


@dataclass(frozen=True)
class Compared:
    """A line with what it is, a key, an uncertainty, and a verdict of two words."""

    line: Annotated[str, Column("line", "line")]
    key: Annotated[str, Column("key", "parameter", role="key")]
    origin: Annotated[str, Column("origin", "what it is", report_only=True)]
    uncertainty: Annotated[float, Column("u_n_m", "±", TORQUE_UNCERTAINTY)]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]

    @property
    def twice(self) -> Annotated[float, Column("twice_n_m", "2 ±", TORQUE_UNCERTAINTY)]:
        """A column that is computed."""
        return 2.0 * self.uncertainty


COMPARED = Table.of(
    "compared",
    Compared,
    [
        Compared("drive_1", "motor.current", "microstep", 2e-5, "differs"),
        Compared("drive_2", "motor.current", "microstep", 4e-7, "agrees"),
    ],
)


def test_columns_of_properties_stand_last_and_small_uncertainties_are_only_less():
    assert COMPARED.texts() == [
        ["drive_1", "motor.current", "microstep", "0.020", "differs", "0.040"],
        ["drive_2", "motor.current", "microstep", "< 0.001", "agrees", "< 0.001"],
    ]
    assert COMPARED.file_rows()[1] == [
        "drive_2",
        "motor.current",
        "microstep",
        4e-7,
        "agrees",
        8e-7,
    ]
    assert COMPARED.marks() == ["off", "pass"]
    few = COMPARED.only(("line", "verdict"))
    assert (few.name, few.texts()) == ("", [["drive_1", "differs"], ["drive_2", "agrees"]])
    assert few.marks() == ["off", "pass"]


def test_the_page_has_what_a_terminal_is_too_narrow_for_and_the_rows_that_a_report_leaves_out():
    kept, left_out = Compared("a", "k", "", 1e-5, "agrees"), Compared("b", "k", "", 1e-9, "differs")
    some = Table.of("", Compared, [kept, left_out], for_readers=[kept]).only(("line", "verdict"))
    of_reports = Table("", some.columns, some.rows, brief=0)
    part = Part("Lines", (some, of_reports), not_on_terminal=True)
    found = Outcome("Study", "A study", "Said.", "", (), (Part("", ()), part))
    assert terminal_text(found) == "Said."
    [shown] = page_answer(found)["parts"][1]["items"]
    assert shown["rows"] == [{"line": "a", "verdict": "agrees"}]
    assert shown["all_rows"] == [*shown["rows"], {"line": "b", "verdict": "differs"}]
    assert some.texts() == [["a", "agrees"]]


def test_what_is_for_a_report_alone_is_in_no_other_form(state_1):
    found = Outcome(
        "Study",
        "A study",
        "Said.",
        "",
        (),
        (
            Part("", (Pairs((("A", "a.csv"), ("B", "b.csv"))), COMPARED)),
            Part("Matrix", (Text("Sensitivities."),), report_only=True),
        ),
        other_files={"simulator.yaml": "title: x\n"},
    )
    said = terminal_text(found)
    assert said.startswith("Said.\n\nA: a.csv\nB: b.csv\n\nline")
    assert "microstep" not in said
    assert "Sensitivities" not in said
    answer = page_answer(found)
    assert [part["title"] for part in answer["parts"]] == [""]
    named, compared = answer["parts"][0]["items"]
    assert named == {"kind": "pairs", "rows": [["A", "a.csv"], ["B", "b.csv"]]}
    [verdict] = [x for x in compared["columns"] if x["key"] == "verdict"]
    assert (verdict["marks"]["differs"], verdict["marks"]["FAIL"]) == ("off", "fail")
    files, report = study_contents(found)
    assert sorted(files) == ["compared.csv", "simulator.yaml"]
    assert report.sections[0].title == "Matrix"
    names, lines = report.first_page
    assert [row.cells for row in names.rows] == [("A", "a.csv"), ("B", "b.csv")]
    assert [column.kind for column in lines.columns][:3] == ["text", "code", "text"]
    assert lines.rows[0].cells[2] == "microstep"


def test_the_page_gets_the_points_of_a_picture(outcome):
    """Curves and dots as they were drawn, with what their axes show; no line across the axes, and not too many."""

    def draw(count: int = 3) -> Figure:
        drawing, axes = sheets.sheet(2.0, 2, 1)
        upper, lower = axes[:, 0]
        upper.sharex(lower)
        upper.plot(range(count), [k**2 for k in range(count)], label="squares")
        upper.axhline(4.0)
        lower.scatter([0.5, math.nan], [7.0, 8.0])
        upper.set(ylabel="power")
        lower.set(ylabel="dots", xlabel="number")
        return drawing

    few = replace(outcome, parts=(Part("", (Picture("p", draw, "A picture"),)),))
    (item,) = page_answer(few, pictures=True)["parts"][0]["items"]
    assert item["points"] == [
        ("power against number", "squares", 0.0, 0.0),
        ("power against number", "squares", 1.0, 1.0),
        ("power against number", "squares", 2.0, 4.0),
        ("dots against number", "", 0.5, 7.0),
    ]
    many = replace(outcome, parts=(Part("", (Picture("p", lambda: draw(20_000), "A picture"),)),))
    assert page_answer(many, pictures=True)["parts"][0]["items"][0]["points"] == []
