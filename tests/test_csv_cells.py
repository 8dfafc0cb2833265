"""Texts of other people in CSV files: no spreadsheet computes them, numbers stay numbers, and every reader gets them back."""

from __future__ import annotations

import csv
import io
import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.campaigns import made, spread
from support.commands import microvib

import microvib as mv
from microvib.errors import MicrovibError
from microvib.io.csv_cells import escape_formula, unescape_formula
from microvib.io.recordings import write_recording
from microvib.io.tables import csv_rows, rows_csv
from microvib.studies.campaign.slurm import submit

FORMULAS = (
    "=HYPERLINK(1)",
    "+1+cmd|' /C calc'!A0",
    "-2+3+cmd|x",
    "@SUM(1)",
    "\t=1+1",
    "\r=1",
    " =1+1",
    "\uff1d1+1",
)
TAKES = re.compile(r"\s*[=+@\uff0b\uff1d\uff20\uff0d-]\s*\S|[\t\r]")


@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_is_text_and_comes_back(text: str) -> None:
    assert not TAKES.match(escape_formula(text))
    assert unescape_formula(escape_formula(text)) == text


@pytest.mark.parametrize(
    "text", ["-1.5", "+2e-3", "-inf", "1", "", "-", "drive_1", "a=b", "-5e300"]
)
def test_numbers_and_plain_texts_are_as_they_were(text: str) -> None:
    assert escape_formula(text) == unescape_formula(text) == text


INSIDE = (
    "x;=1+1",
    "x; =1+1",
    'x;"=1+1"',
    "x;'=1+1",
    "=1;=1",
    ";@SUM(1)",
    "a;b;\t=1",
    "x;-2+3",
    "x;\"'=1",
    "x;\uff1d1",
)


@pytest.mark.parametrize("text", INSIDE)
def test_a_formula_behind_a_semicolon_is_text_and_comes_back(text: str) -> None:
    """As a spreadsheet reads the table whose language parts cells at semicolons."""
    table = rows_csv(["name", "n"], [[text, 1.0]])
    cells = [
        cell for row in csv.reader(io.StringIO(table, newline=""), delimiter=";") for cell in row
    ]
    assert not [cell for cell in cells if TAKES.match(cell)]
    assert unescape_formula(escape_formula(text)) == text
    (read,) = [row[0] for row in csv.reader(io.StringIO(table, newline=""))][1:]
    assert unescape_formula(read) == text


@pytest.mark.parametrize("text", ["a;b", "N m; 2 of 3", "ok; a=b", "'; x"])
def test_semicolons_of_plain_texts_stay(text: str) -> None:
    assert escape_formula(text) == unescape_formula(text) == text


@given(st.text("a1;=+-@' \"\t\n", max_size=12))
def test_any_text_of_such_characters_comes_back(text: str) -> None:
    assert unescape_formula(escape_formula(text)) == text


@given(st.text(max_size=20))
def test_any_text_comes_back(text: str) -> None:
    assert unescape_formula(escape_formula(text)) == text


def test_numbers_of_any_kind_stay_numbers() -> None:
    text = rows_csv(["=head", "n"], [[-1.5, -2], [np.float64(-0.25), np.int64(-7)]])
    assert text == "'=head,n\n-1.5,-2\n-0.25,-7\n"


def test_all_tables_are_written_in_one_place() -> None:
    sources = Path(mv.__file__).parent.rglob("*.py")
    writers = [
        p.name
        for p in sources
        if re.search(r"csv\.(Dict)?[wW]riter", p.read_text(encoding="utf-8"))
    ]
    assert sorted(writers) == ["csv_cells.py", "tables.py"]  # the second rewrites what it reads


def test_a_budget_keeps_names_of_sources_as_text(tmp_path: Path) -> None:
    craft = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
    (tmp_path / "p.csv").write_text("line,frequency_hz,los_x_rad,los_y_rad\n=1+1,40,1e-7,1e-7\n")
    (tmp_path / "s.yaml").write_text("sources:\n  - {name: '=HYPERLINK(1)', lines: p.csv}\n")
    (tmp_path / "r.yaml").write_text(
        "requirements:\n  - {name: '@R1', metric: ape, limit: 1 arcsec}\n"
    )
    done = microvib(
        "budget", str(craft), "--requirement", "r.yaml", "--sources", "s.yaml", "--out", "b",
        "--set", "record.settle=1 s", "--set", "record.duration=4 s", cwd=tmp_path,
    )  # fmt: skip
    assert done.exit_code in (0, 1), done.stderr
    tables = list((tmp_path / "b").glob("*.csv"))
    cells = [c for path in tables for row in csv.reader(io.StringIO(path.read_text())) for c in row]
    assert "'=HYPERLINK(1)" in cells
    assert not [
        c
        for c in cells
        if TAKES.match(c) and not re.fullmatch(r"[+-]?[\d.]+(e[+-]?\d+)?|[+-]?inf", c)
    ]
    assert "=HYPERLINK(1)" in [
        c for path in tables for row in csv_rows(path, MicrovibError) for c in row
    ]


def test_channels_of_a_recording_come_back(tmp_path: Path) -> None:
    names = ("=A1+B1", "-Mz", "a, b")
    recording = mv.Recording(
        {name: np.sin(np.arange(64.0) + k) for k, name in enumerate(names)}, mv.Si(64.0)
    )
    write_recording(recording, tmp_path / "r.csv")
    head = next(csv.reader([(tmp_path / "r.csv").read_text().splitlines()[0]]))
    assert not [c for c in head if TAKES.match(c)]
    assert tuple(mv.read_recording(tmp_path / "r.csv").channels) == names


AWKWARD = "odd dir $(touch hit) 'q' \"d\" 100%a #x"


def test_a_script_of_slurm_takes_any_folder_as_one_word(tmp_path: Path) -> None:
    """Run by the shell with a program in place of Python that writes its arguments down."""
    campaign = made(tmp_path, spread(count=2), AWKWARD, 2)
    submit(campaign, 1, ["--comment=two words", "--time 0:10:00", "--exclusive"], only_write=True)
    script = campaign.folder / "slurm.sh"
    options = [
        line.removeprefix("#SBATCH ")
        for line in script.read_text().splitlines()
        if line.startswith("#SBATCH")
    ]
    said = [
        word for line in options for word in shlex.split(line)
    ]  # as Slurm parts them: blanks, quotes and backslashes
    assert f"--output={str(campaign.folder.resolve()).replace('%', '%%')}/slurm-%a.log" in said
    assert said[-4:] == ["--comment=two words", "--time", "0:10:00", "--exclusive"]
    last = script.read_text().splitlines()[-1].removeprefix("exec ")
    program = shlex.split(last)[0]
    run = subprocess.run(
        ["sh", "-c", last.replace(program, "printf '%s\\n'", 1)],
        cwd=tmp_path, env={"SLURM_ARRAY_TASK_ID": "0", "PATH": "/usr/bin:/bin"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert str(campaign.folder.resolve()) in run.stdout.splitlines()
    assert str(campaign.folder.resolve() / "slurm-todo.txt") in run.stdout.splitlines()
    assert not list(tmp_path.rglob("hit"))


def test_what_does_not_go_into_a_script_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        MicrovibError, match="a line break or another control character in a folder's name"
    ):
        submit(made(tmp_path, spread(count=2), "a\nrm -rf x", 2), 1, only_write=True)
    campaign = made(tmp_path, spread(count=2), "c", 2)
    for wrong in ("--time=1\nrm -rf x", "rm -rf x", "--a=1\r", ""):
        with pytest.raises(
            MicrovibError, match="is no option of sbatch; write one, such as --time=02:00:00"
        ):
            submit(campaign, 1, [wrong], only_write=True)
    assert not list(tmp_path.rglob("slurm.sh"))
