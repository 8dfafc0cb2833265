"""The command line in a terminal, in a pipe and without either: what is on the screen, what it ends with, never a traceback."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pty", reason="pseudo-terminals are of POSIX")

import click
from support.commands import SHORT
from support.terminal import in_terminal, screen

from microvib.cli.progress import progress_bar
from microvib.cli.streams import BUG, TRACEBACK, status_of
from microvib.errors import MicrovibError

LONG = ["--set", "record.duration=20000 s"]


def shell(line: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """What a POSIX shell makes of a line, ``microvib`` standing for the command."""
    line = f'microvib() {{ "$PYTHON" -m microvib "$@"; }}; {line}'
    env = {**os.environ, "PYTHON": sys.executable}
    return subprocess.run(
        ["sh", "-c", line],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


@pytest.mark.parametrize(
    "environment", [{"TERM": "dumb"}, {"NO_COLOR": "1", "TERM": "no-such-terminal", "COLUMNS": "0"}]
)
def test_a_run_in_terminals_of_all_sorts(worked, tmp_path, environment):
    arguments = ["run", "state-1", *SHORT, "--lines-only", "--out", str(tmp_path / "out")]
    shown = in_terminal(*arguments, cwd=worked, environment=environment)
    assert shown.status == 0, shown.text
    assert "Written:" in shown.text
    assert "simulating" not in shown.text
    if environment.get("TERM") == "dumb":
        assert "\x1b" not in shown.raw
    if "NO_COLOR" in environment:
        assert not re.search(r"\x1b\[[\d;]*(3\d|4\d|9\d)m", shown.raw)


def test_a_terminal_that_does_not_tell_its_size_gets_lines_of_eighty_columns(tmp_path):
    shown = in_terminal("scenarios", cwd=tmp_path, columns=0)
    assert shown.status == 0
    assert any(len(line) > 60 for line in shown.raw.splitlines())


def test_the_screen_is_read_as_a_terminal_shows_it():
    assert screen("half\rwhole\x1b[K\r\n\x1b[31mred\x1b[0m", 20) == ["whole", "red"]
    assert screen("a bar\r\n\x1b[1A\x1b[2K\rgone", 20) == ["gone"]
    assert screen("abcdef", 4) == ["abcd", "ef"]


def test_a_bar_is_drawn_while_it_goes_on_and_gone_at_the_end(worked, tmp_path):
    arguments = ["run", "state-1", *SHORT, "--lines-only", "--out", str(tmp_path / "out")]
    shown = in_terminal(*arguments, cwd=worked)
    assert shown.status == 0, shown.text
    assert re.search(r"simulating.*━.* of \d+ s", shown.raw)
    assert "━" not in shown.text


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1"])
def test_a_stream_that_lacks_characters_shows_others_in_their_place(tmp_path, encoding):
    """As a file that a command's output goes to on Windows."""
    line = f"PYTHONIOENCODING={encoding} microvib new my.yaml --from-datasheet --ratio 100 > said"
    assert shell(line, tmp_path).returncode == 0
    said = (tmp_path / "said").read_text(encoding=encoding)
    assert "kg cm²" in said
    assert "(2? f_c R" in said


# -- interrupted -----------------------------------------------------------------------------------------------------

INTERRUPTED = (130, -2)
"""As we end, and as the interpreter ends where the interrupt came within code that it compiled from text; a shell says 130."""


@pytest.mark.parametrize(
    ("arguments", "sign"),
    [
        (["run", "state-1", "--lines-only", *LONG, "--out", "out"], " of 20030 s"),
        (["rates", "state-1", "--from", "0.01 deg/s", "--to", "0.3 deg/s", "--count", "5000", "--out", "out"], " cases"),
        (["validate", "--out", "out"], "running"),
        (["campaign", "run", "{worked}/long"], " of 4000 cases"),
    ],
    ids=lambda x: x[0] if isinstance(x, list) else "",
)  # fmt: skip
def test_an_interrupt_ends_every_long_command_with_one_sentence(worked, tmp_path, arguments, sign):
    arguments = [text.format(worked=worked) for text in arguments]
    shown = in_terminal(
        *arguments, cwd=tmp_path, columns=300, until=lambda written: sign in written
    )
    assert shown.status in INTERRUPTED, shown.text
    assert [line for line in shown.screen if line.strip(" ^C")] == [shown.screen[-1]], shown.text
    assert shown.screen[-1].startswith("Interrupted; ")
    assert list(tmp_path.iterdir()) == []


def test_an_identification_that_is_interrupted_keeps_the_best_and_says_so(worked, tmp_path):
    tested = str(worked / "old" / "lines.csv")
    search = [
        "identify",
        "state-1",
        tested,
        "--fit",
        "reducer.stiffness",
        "--starts",
        "4096",
        *SHORT,
        "--out",
        "out",
    ]
    shown = in_terminal(
        *search, cwd=tmp_path, columns=300, until=lambda written: "global: " in written
    )
    assert shown.status in INTERRUPTED, shown.text
    assert "Interrupted: the best so far" in shown.text
    assert json.loads((tmp_path / "out" / "fit.json").read_text())["interrupted"] is True


def test_an_interrupt_while_the_program_is_still_starting_is_quiet(tmp_path):
    program = "import sys, threading, _thread\nimport microvib.cli.common as c\nsys.modules.pop('microvib.cli.serve', None)"
    program += "\nclass Late:\n  def find_spec(self, name, *a):\n    if name.endswith('cli.serve'): raise KeyboardInterrupt"
    program += "\nsys.meta_path.insert(0, Late())\nfrom microvib.cli.main import main\nmain()"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (130, "")


# -- pipes, closed streams, full disks -------------------------------------------------------------------------------

NO_SPACE = "Error: standard output cannot be written: No space left on device\n"


@pytest.mark.parametrize(
    ("line", "status", "said"),
    [
        ("microvib show state-1 >&-", 0, ""),
        ("microvib show state-1 <&- >&- 2>&-", 0, ""),
        ("microvib show nowhere 2>&-", 1, ""),
        ("microvib nothing 2>&-", 2, ""),
        ("microvib show nowhere 2>/dev/full", 1, ""),
        ("microvib show state-1 >/dev/full", 1, NO_SPACE),
        ("microvib --help >/dev/full", 1, NO_SPACE),
        ("microvib show state-1 >/dev/full 2>&1", 1, ""),
        ("(microvib schema; echo $? >&2) | head -0", 0, "141\n"),
        ("(microvib schema; echo $? >&2) | head -1 | grep -c .", 0, None),
        ("(microvib --help; echo $? >&2) | true", 0, "141\n"),
    ],
)
def test_streams_that_are_closed_broken_or_full(tmp_path, line, status, said):
    if "/dev/full" in line and not os.path.exists("/dev/full"):
        pytest.skip("there is no /dev/full here")
    done = shell(line, tmp_path)
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    if said is not None:
        assert done.stderr == said


def test_a_run_without_standard_error_works_and_nothing_is_written_into_its_files(worked, tmp_path):
    line = "microvib run state-1 --set 'record.settle=0.5 s' --set 'record.duration=2 s' --out out"
    quiet = shell(f"{line} <&- >&- 2>&-", tmp_path)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    assert (tmp_path / "out" / "lines.csv").read_text() == (
        worked / "old" / "lines.csv"
    ).read_text()


def test_results_are_written_although_nobody_reads_the_text_whatever_the_window_system(
    worked, tmp_path
):
    done = shell(
        f"MPLBACKEND=nonsense microvib analyse '{worked}/old.csv' --out out | true", tmp_path
    )
    assert done.stderr == ""
    assert (tmp_path / "out" / "report.html").is_file()


# -- what nobody foresaw ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (MicrovibError("reducer: is too soft"), 1, "Error: reducer: is too soft\n"),
        (PermissionError(13, "Permission denied", "a/b"), 1, "Error: a/b: Permission denied\n"),
        (
            MemoryError(),
            1,
            "Error: out of memory; shorten record.duration or run fewer cases at a time\n",
        ),
        (KeyboardInterrupt(), 130, "Interrupted; no file was left half-written.\n"),
        (SystemExit(3), 3, ""),
        (click.UsageError("no"), 2, "Error: no\n"),
    ],
)
def test_what_ends_a_command_is_one_sentence_and_a_status(capsys, error, status, sentence):
    def fail():
        raise error

    assert status_of(fail) == status
    assert capsys.readouterr().err == sentence


def test_a_bug_is_called_a_bug_and_shows_its_traceback_on_request(capsys, monkeypatch):
    def fail():
        raise ZeroDivisionError("of all things")

    assert status_of(fail) == BUG == 70
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "a bug in microvib, not in your input (ZeroDivisionError: of all things)" in said
    assert TRACEBACK in said
    monkeypatch.setenv(TRACEBACK, "1")
    assert status_of(fail) == BUG
    assert "Traceback" in capsys.readouterr().err


def test_what_is_refused_before_the_work_begins_is_told_without_a_bar(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    with pytest.raises(MicrovibError), progress_bar():
        raise MicrovibError("requirement: is not there")
    assert capsys.readouterr().err == ""
    with progress_bar() as tell:
        tell(0.0, 46.0)
        assert (
            "compiles on first use" in capsys.readouterr().err
        )  # at once, however soon the work is done


def test_every_bar_is_a_line_a_minute_where_there_is_no_terminal(capsys, monkeypatch):
    now = iter([0.0, 59.0, 61.0, 100.0, 130.0, 131.0])
    monkeypatch.setattr("microvib.cli.progress.time.monotonic", lambda: next(now))
    with progress_bar("computing", "draws") as tell:
        for done in (0, 1, 2, 3, 4, 10):
            tell(done, 10)
    assert capsys.readouterr().err == (
        "computing: 2 of 10 draws, 4 min left\ncomputing: 4 of 10 draws, 3 min left\ncomputing: 10 of 10 draws\n"
    )
    now = iter([0.0, 30.0, 61.0, 70.0, 130.0])
    with progress_bar() as tell:
        for text in "abcde":
            tell.say(text)
    assert capsys.readouterr().err == "c\ne\n"
    now = iter([0.0, 30.0])
    with progress_bar() as tell:
        for done in (0.0, 1.0):
            tell(done, 1.0)
    assert capsys.readouterr().err == "", "short work is quiet"


def test_progress_on_lines_has_rate_and_time_left(capsys, monkeypatch):
    now = iter([0.0, 5.0, 16.0, 20.0])
    monkeypatch.setattr("microvib.cli.progress.time.monotonic", lambda: next(now))
    with progress_bar("computing", "cases", lines_every=15.0) as tell:
        for done in (10, 20, 42, 50):
            tell(done, 50)
    assert (
        capsys.readouterr().err
        == "42 of 50 cases, 2 cases/s, 4 s left\n50 of 50 cases, 2 cases/s\n"
    )
