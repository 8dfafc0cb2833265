"""Every command and subcommand as a program, in a terminal and through a pipe: what it ends with, what it says, how it refuses."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import click
import pytest

pytest.importorskip("pty", reason="pseudo-terminals are of POSIX")

from support.commands import ONE_AFTER_ANOTHER, SHORT
from support.terminal import in_terminal

from microvib.cli.main import main

PULSES = str(Path(__file__).parents[1] / "examples" / "pulses.yaml")
RATES = [
    "rates",
    "state-1",
    "--from",
    "0.05 deg/s",
    "--to",
    "0.06 deg/s",
    "--count",
    "2",
    "--linear",
]
_SAID_OF_WHEEL = ["--speeds", "rpm", "--amplitude", "peak", "--window", "hann", "--out", "of-wheel"]
DONE = {
    "run": ["run", "state-1", *SHORT],
    "run --steady": ["run", "state-1", "--steady", "--lines-only", *SHORT],
    "report": ["report", "old"],
    "compare": ["compare", "old", "old.csv", "--channel", "Mz"],
    "analyse": ["analyse", "old.csv"],
    "measure": ["measure", "state-1", "--bench", "bench.yaml", *SHORT, "-o", "new.csv"],
    "identify": [
        "identify",
        "state-1",
        "old/lines.csv",
        "--fit",
        "reducer.stiffness",
        "--starts",
        "2",
        "--band",
        "40:60 Hz",
        "--set",
        "record.settle=0.2 s",
        "--set",
        "record.duration=0.5 s",
    ],
    "rates": RATES,
    "profile": ["profile", "state-1", "--linear"],
    "margin": ["margin", PULSES, "--over", "driver.supply_voltage=60:62 V", "--count", "2"],
    "modes": ["modes", "modes.csv"],
    "sas size": ["sas", "size", "--inertia", "8.18", "--frequency", "1.19"],
    "campaign create": ["campaign", "create", "study.yaml", "another"],
    "campaign run": ["campaign", "run", "batch"],
    "campaign resume": ["campaign", "resume", "batch"],
    "campaign status": ["campaign", "status", "batch"],
    "campaign merge": ["campaign", "merge", "batch"],
    "campaign report": ["campaign", "report", "batch"],
    "campaign case": ["campaign", "case", "batch", "1"],
    "scenarios": ["scenarios"],
    "show": ["show", "state-1"],
    "new": ["new", "drive.yaml"],
    "sensitivity": [
        "sensitivity",
        "state-1",
        *SHORT,
        "--set",
        "sources={reducer.stiffness: assumed; range 4 kN*m/rad to 6 kN*m/rad}",
    ],
    "schema": ["schema"],
    "budget": ["budget", "craft.yaml", *SHORT],
    "docs": ["docs", "--path"],
    "track": [
        "track",
        "old.csv",
        "--orders",
        "1",
        "--profile",
        "0 s:53.01 Hz, 2 s:53.01 Hz",
        "--clock",
        "stated",
    ],
    "repeatability": ["repeatability", "A=old.csv", "A=again.csv"],
    "hammer": ["hammer", "Mz@1m=blows.csv", "--mounted-mass", "0 kg"],
    "wheel": ["wheel", "--axial-force", "wheel.csv", *_SAID_OF_WHEEL, "--force-unit", "N"],
    "envelope": ["envelope", "old", "old.csv", "again.csv", "--statistic", "mean"],
    "acceptance": [
        "acceptance",
        "A=old.csv",
        "A=again.csv",
        "--template",
        "report.md",
        "--out",
        "accepted",
    ],
    "export": ["export", "old", "--as", "mat", "-o", "exported.mat"],
    "export --list": ["export", "--list"],
}
"""A command line of each command, in the folder of ``worked``."""
LONG = {
    "validate": ["validate", "goniometer"],
    "quiet": [
        "quiet",
        "state-1",
        "--lever",
        "ramp",
        "--cases",
        "8",
        "--effort",
        "4",
        "--set",
        "record.settle=1.5 s",
        "--set",
        "record.duration=1 s",
    ],
    "statements": ["statements", "draws.csv", "--draws", "1", "--seeds", "1"],
}
REFUSED = {
    "run": (["run", "state-9"], "no such file and no catalog scenario"),
    "report": (["report", "nowhere"], "nowhere"),
    "compare": (["compare", "nowhere", "state-1"], "nowhere"),
    "analyse": (["analyse", "nothing.uff"], "nothing.uff: cannot be read: No such file"),
    "measure": (["measure", "state-1", "-o", "x.wav"], "'.wav' is not known"),
    "identify": (
        ["identify", "state-1", "state-1:measured", "--fit", "reducer.stifness"],
        "reducer.stifness",
    ),
    "validate": (["validate", "--out", "old"], "already holds results"),
    "statements": (["statements", "modes.csv"], "is not a table of draws"),
    "rates": ([*RATES[:2], "--from", "1 kg", *RATES[4:]], "'1 kg' has the wrong dimension"),
    "profile": (["profile", "state-1", "--final-rate", "1 kg"], "'1 kg' has the wrong dimension"),
    "modes": (["modes", "reference-arry"], "reference-arry"),
    "sas size": (
        ["sas", "size", "--inertia", "8 m", "--frequency", "1 Hz"],
        "'8 m' has the wrong dimension",
    ),
    "campaign create": (["campaign", "create", "modes.csv", "another"], "modes.csv"),
    "campaign run": (["campaign", "run", "old"], "is not a campaign"),
    "campaign resume": (["campaign", "resume", "old"], "is not a campaign"),
    "campaign status": (["campaign", "status", "old"], "is not a campaign"),
    "campaign merge": (["campaign", "merge", "old"], "is not a campaign"),
    "campaign report": (["campaign", "report", "old"], "is not a campaign"),
    "campaign case": (["campaign", "case", "batch", "7"], "7"),
    "serve": (["serve", "--no-browser", "--port", "0", "--host", "0.0.0.0"], "--allow-remote"),
    "margin": (
        ["margin", "state-1", "--over", "driver.supply_voltage=60:80 V"],
        "pulse is expected where lost steps are counted",
    ),
    "show": (["show", "state-1", "--set", "a=b"], "a: "),
    "new": (["new", "study.yaml"], "already exists"),
    "sensitivity": (["sensitivity", "state-1"], "no value of this scenario has a range"),
    "budget": (["budget", "state-1"], "spacecraft: missing"),
    "track": (["track", "old.csv", "--orders", "1"], "no reference is given"),
    "repeatability": (["repeatability", "A=old.csv"], "repeatability needs two or more"),
    "envelope": (["envelope", "state-1"], "state-1: is no run that was kept"),
    "hammer": (["hammer", "Mz=blows.csv", "--mounted-mass", "0 kg"], "a torque needs a lever arm"),
    "wheel": (
        ["wheel", "--axial-force", "wheel.csv", *_SAID_OF_WHEEL],
        "--force-unit: the unit is not said",
    ),
    "acceptance": (
        ["acceptance", "A=old.csv", "--template", "nowhere.md", "--out", "a"],
        "nowhere.md",
    ),
    "quiet": (["quiet", "state-1", "--lever", "spring"], "lever spring: is none"),
    "export": (["export", "state-1", "--as", "matlab", "-o", "a.mat"], "--as matlab: is not known"),
}
"""A command line that is refused, and words of the sentence that says why."""
MISUSED = {
    "scenarios": ["scenarios", "nowhere"],
    "schema": ["schema", "nowhere"],
    "docs": ["docs", "--nothing"],
    "microvib": ["nothing"],
}
"""Command lines that no command takes; of those that are not above, nothing else can be wrong."""
ANY = {"docs": (0, 1)}
"""The site is not in every installation."""


def leaves(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[str]:
    """Names of all commands below one that do something themselves."""
    if isinstance(command, click.Group):
        for name, below in command.commands.items():
            yield from leaves(below, (*words, name))
    else:
        yield " ".join(words)


def test_every_command_is_in_the_tables():
    names = set(leaves(main))
    assert len(names) >= 22
    assert {name.partition(" --")[0] for name in (*DONE, *LONG)} == names - {"serve"}
    assert set(REFUSED) | set(MISUSED) == names | {"microvib"}


@pytest.fixture
def copied(worked: Path, tmp_path: Path) -> Path:
    """A copy of the folder that commands work on, whatever they then write there."""
    shutil.copytree(worked, tmp_path / "work")
    return tmp_path / "work"


def named(text: str) -> dict[str, tuple[int, str]]:
    """Status and text of each command that ONE_AFTER_ANOTHER has run."""
    parts = re.split(r"^== (.+) == (\d+)\n?", text, flags=re.M)
    return {
        name: (int(status), said)
        for said, name, status in zip(parts[::3], parts[1::3], parts[2::3], strict=False)
    }


def shown(commands: dict[str, list[str]], cwd: Path, **settings) -> dict[str, tuple[int, str]]:
    """Status and screen of each command, run in one terminal and one process, whose imports they share."""
    ended = in_terminal(
        program=[sys.executable, "-c", ONE_AFTER_ANOTHER, json.dumps(commands)], cwd=cwd, **settings
    )
    assert ended.status == 0, ended.text
    found = named(ended.text + "\n")
    assert list(found) == list(commands), ended.text
    return found


def piped(commands: dict[str, list[str]], cwd: Path) -> dict[str, tuple[int, str]]:
    """Status and text of each command, both streams in one pipe."""
    program = [sys.executable, "-c", ONE_AFTER_ANOTHER, json.dumps(commands)]
    ended = subprocess.run(
        program, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=True
    )
    found = named(ended.stdout)
    assert list(found) == list(commands), ended.stdout
    return found


PROGRESS = re.compile(r"^\d+ of \d+ \w+, [\d.]+ \w+/s(?:, .* left)?\n", re.M)
"""Line on the progress of long work, which a pipe gets every few seconds, and a terminal as a bar."""


def bare(text: str) -> str:
    """A text without the breaks of its lines, and without figures, of which some are times."""
    return re.sub(r"\d+", "#", re.sub(r"\s", "", text))


def same(narrow: str, wide: str) -> bool:
    """Whether each word of one text is in the other; columns of a folded table stand one below the other."""

    def holds(text: str, words: str) -> bool:
        whole = bare(text)
        return all(bare(word) in whole for word in set(words.split()))

    return holds(wide, narrow) and holds(narrow, wide)


def checked(commands: dict[str, list[str]], copied: Path, tmp_path: Path) -> None:
    """40 columns: nothing of a bar is left, no figure is broken at the edge, no traceback; and a pipe gets the same."""
    shutil.copytree(copied, tmp_path / "pipe")
    in_pipe = piped(commands, tmp_path / "pipe")
    for name, (status, said) in shown(commands, copied, columns=40).items():
        assert status in ANY.get(name, (0,)), (name, said)
        assert said, name
        for unwanted in (
            "Traceback",
            "bug in microvib",
            "━",
            "\x1b",
            " of 2 s",
            "computing",
            "searching",
        ):
            assert unwanted not in said, (name, said)
        assert status == in_pipe[name][0], name
        assert same(said, PROGRESS.sub("", in_pipe[name][1])), name


def test_every_command_in_a_narrow_terminal_says_what_a_pipe_gets(copied, tmp_path):
    checked(DONE, copied, tmp_path)


@pytest.mark.release
def test_long_commands_too(copied, tmp_path):
    checked(LONG, copied, tmp_path)


def test_every_refusal_is_one_sentence_in_a_terminal_and_in_a_pipe(copied):
    lines = {name: line for name, (line, _) in REFUSED.items()}
    before = sorted(copied.rglob("*"))
    screens, pipes = shown(lines, copied, columns=40), piped(lines, copied)
    for name, (_, words) in REFUSED.items():
        status, sentence = pipes[name]
        assert status == 1, (name, sentence)
        assert sentence.startswith("Error: "), (name, sentence)
        assert sentence.count("\n") == 1, (name, sentence)
        assert words in sentence, name
        assert (screens[name][0], bare(screens[name][1])) == (1, bare(sentence)), name
    assert sorted(copied.rglob("*")) == before


OUT_OF_RANGE = {
    "rates": ["rates", "state-1", "--from", "1 deg/s", "--to", "2 deg/s", "--count", "1"],
    "run": ["run", "state-1", "--harmonics", "0"],
    "serve": ["serve", "--port", "65536"],
}


def test_a_number_out_of_its_range_is_refused_in_one_sentence(tmp_path):
    for name, (status, said) in piped(OUT_OF_RANGE, tmp_path).items():
        assert status == 1, (name, said)
        assert re.fullmatch(r"Error: .*'--\w+'.* is not in the range .*\n", said), (name, said)


def test_misuse_is_told_with_what_is_right(tmp_path):
    for name, (status, said) in (
        shown(MISUSED, tmp_path, columns=60) | piped(MISUSED, tmp_path)
    ).items():
        assert status == 2, (name, said)
        assert said.startswith("Usage: "), said
        assert "Try " in said
        assert len(re.findall(r"^Error: ", said, re.M)) == 1


def test_help_and_version(tmp_path):
    lines = {
        "help": ["--help"],
        "version": ["--version"],
        **{name: [*name.split(), "--help"] for name in leaves(main)},
    }
    for name, (status, said) in shown(lines, tmp_path, columns=80).items():
        assert status == 0
        assert name == "version" or "Usage: microvib" in said, name
        assert max(map(len, said.splitlines())) <= 80, name
        assert '" "' not in said, name


def answers(written: str) -> bool:
    """Whether the server does, whose address was printed: its workers are then still starting."""
    found = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+\s", written)
    if found is None:
        return False
    with urlopen(found[0].strip(), timeout=60) as page:
        return b"<html" in page.read()


def test_serve_in_a_terminal_ends_with_ctrl_c(tmp_path):
    arguments = ["serve", "--port", "0", "--no-browser"]
    ended = in_terminal(*arguments, cwd=tmp_path, columns=200, until=answers)
    assert ended.status == 0, ended.text
    assert "Traceback" not in ended.text
