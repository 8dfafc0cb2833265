"""Verdicts of a comparison: which lines agree within their uncertainties, which do not, which cannot be judged."""

from __future__ import annotations

import csv
import io
import math

import pytest

from microvib.io.sources import open_source
from microvib.reports.comparison import clock_sentence, comparison_report, comparison_text, verdict_sentence
from microvib.reports.document import Table, Text
from microvib.reports.rendering import html
from microvib.reports.typography import file_name
from microvib.studies.compare import Figures, Row, Side, compare, comparison_csv


def row(line: str, a: tuple[float, ...], b: tuple[float, ...]) -> Row:
    """Amplitude and uncertainty of both sides [N m]; of one that says nothing, nothing."""
    return Row(line, *(Figures(10.0, *side) if side else Figures() for side in (a, b)))


ROWS = [
    row("drive_1", (1.0, 0.03), (1.09, 0.04)),  # 1.8 standard uncertainties
    row("drive_2", (0.5, 0.003), (0.5105, 0.004)),  # 2.1
    row("drive_3", (0.2, math.nan), (0.2, 0.001)),
    row("drive_4", (0.1, 0.001), ()),
    row("drive_5", (), (0.1, 0.001)),
    row("drive_6", (0.3, 0.0), (0.3, 0.0)),
]


def test_two_standard_uncertainties_of_the_difference_decide():
    verdicts = {r.line: r.verdict for r in ROWS}
    assert verdicts == {
        "drive_1": "agrees",
        "drive_2": "differs",
        "drive_3": "not judged",
        "drive_4": "only A",
        "drive_5": "only B",
        "drive_6": "not judged",  # nothing is known of how well
    }


def test_the_sentence_counts_and_names():
    assert verdict_sentence(ROWS) == (
        "1 of 2 lines agrees within 2 standard uncertainties of the difference (drive_1); 1 differs (drive_2)."
        " 1 line only A has (drive_4). 1 line only B has (drive_5). 2 lines without uncertainties (drive_6, drive_3)."
    )
    assert verdict_sentence(ROWS[2:3]) == "No line is judged: one side has no known uncertainty."


def test_the_file_keeps_all_digits_and_the_verdict():
    rows = list(csv.DictReader(io.StringIO(comparison_csv(ROWS))))
    assert [r["verdict"] for r in rows] == [r.verdict for r in ROWS]
    assert rows[1]["b_amplitude_n_m"] == "0.5105"
    assert rows[0]["a_uncertainty_n_m"] == "0.03"


def test_the_papers_columns_are_not_judged():
    a, b, rows = compare(open_source("paper-test"), open_source("paper-simulation"))
    document = comparison_report(a, b, rows)
    assert document.facts[0].value == "not judged"
    assert "agree" not in comparison_text(a, b, rows)


def test_the_first_page_says_which_lines_agree():
    a, b = (Side(name, "table", {}) for name in ("/home/me/secret/a.csv", "b.csv"))
    document = comparison_report(a, b, ROWS)
    assert document.facts[0].value == "1 of 2"
    assert any(isinstance(x, Text) and x.text.startswith(verdict_sentence(ROWS)) for x in document.first_page)
    main = next(x for x in document.first_page if isinstance(x, Table) and x.columns[0].title == "line")
    verdicts = {r.cells[0]: (r.cells[-1], r.mark) for r in main.rows}
    assert verdicts["drive_1"] == ("agrees", "pass")
    assert verdicts["drive_2"] == ("differs", "off")
    assert verdicts["drive_3"] == ("not judged", "")
    page = html(document)
    assert "a.csv" in page
    assert "secret" not in page


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (("recording", 0.99), ("simulation", 0.99), "B was simulated at the recording's clock"),
        (("simulation", 1.0), ("simulation", 0.999), "B is -1000.0 ppm off A"),
        (("recording", 0.99), ("table", None), "not known on the other side"),
        (("table", None), ("paper", None), "not known on either side"),
    ],
)
def test_the_clock_is_told(a, b, words):
    assert words in clock_sentence(*(Side("x", kind, {}, clock) for kind, clock in (a, b)))


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("a.uff", "a.uff"),
        ("/x/y/a.uff", "a.uff"),
        ("C:\\x\\a b.uff", "a b.uff"),
        ("runs/one/", "one"),
        ("state-1", "state-1"),
    ],
)
def test_titles_and_legends_name_files(source, name):
    assert file_name(source) == name
