"""Tables of the terminal: no column runs into another, no figure is folded, nothing is lost, whatever the width."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.terminal import in_terminal

import microvib as mv
from microvib.text_tables import text_table, wrapped

HEADER = ("line", "expected Hz", "test N m", "bin N m", "status")
ROWS = [
    ("array_mode_1", "1.18620", "4.9486e-02", "4.5076e-02", "decaying"),
    ("drive_1", "53.01333", "4.7709e-02", "4.7611e-02", "ok"),
    (
        "electrical_1",
        "0.82833",
        "",
        "6.2229e-03",
        "not separable from array_mode_1; a record of 6.99 s could separate them",
    ),
]


@pytest.fixture
def columns(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> int:
    monkeypatch.setenv("COLUMNS", str(request.param))
    return int(request.param)


def test_without_a_limit_each_row_is_a_line() -> None:
    lines = text_table(HEADER, ROWS, left=1, last_left=True).splitlines()
    assert len(lines) == 4
    assert lines[1] == "array_mode_1      1.18620  4.9486e-02  4.5076e-02  decaying"
    assert lines[3].endswith("6.99 s could separate them")


@pytest.mark.parametrize("columns", [24, 30, 40, 50, 60, 80, 100, 132], indirect=True)
def test_a_narrow_table_keeps_every_figure_whole_and_every_column_apart(columns: int) -> None:
    text = text_table(HEADER, ROWS, left=1, last_left=True)
    assert max(map(len, text.splitlines())) <= columns
    words = re.split(r"  +|\n", text)
    for row in ROWS:
        assert all(cell in words for cell in row[1:4] if cell)
    assert " ".join(ROWS[2][-1].split()) in " ".join(text.split())
    for line in text.splitlines():
        if line.startswith("drive_1 "):
            figures = set(re.split(r"  +", line)[1:])
            assert figures <= {*ROWS[1]}, "a row has its own figures"


@pytest.mark.parametrize("columns", [50], indirect=True)
def test_words_at_the_beginning_fold_and_a_last_word_goes_below_its_row(columns: int) -> None:
    rows = [
        (
            "state 5: amplitude of the line at the driving frequency",
            "1.25",
            "assumed: of a range of settling times",
        ),
        ("b", "2", "ok"),
    ]
    lines = text_table(("item", "ours", "why"), rows, left=1, last_left=True).splitlines()
    assert lines == [
        "item                ours  why",
        "state 5: amplitude  1.25",
        "of the line at the",
        "driving frequency",
        "    assumed: of a range of settling times",
        "b                      2  ok",
    ]
    assert columns == 50


def test_a_figure_stays_with_its_unit() -> None:
    for width in range(12, 40):
        for line in wrapped(
            "drive_1 reaches 347.2 mN m at 0.06 deg/s, 12 % above 4096 Hz of 16 s each", width
        ):
            assert not re.search(r"(?<![_a-z])[\d.]+$|\bm?N$", line), line


def test_a_line_table_folds_as_all_tables_do(
    motion_1: mv.Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = mv.find_lines(motion_1)
    whole = str(table)
    monkeypatch.setenv("COLUMNS", "60")
    narrow = str(table)
    assert max(map(len, narrow.splitlines())) <= 60 < max(map(len, whole.splitlines()))
    assert set(re.findall(r"\d\.\d+e-\d+", narrow)) == set(re.findall(r"\d\.\d+e-\d+", whole))


def test_tables_follow_the_width_of_the_terminal_and_orders_stay_comments(tmp_path: Path) -> None:
    shown = in_terminal("show", "state-1", cwd=tmp_path, columns=60)
    assert shown.status == 0
    orders = shown.raw.replace("\r", "").partition("# Orders:\n")[2].splitlines()
    assert len(orders) > 10
    assert all(line.startswith("#   ") and len(line) <= 60 for line in orders)
