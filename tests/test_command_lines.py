"""Command lines that the docs print run, in the order of their page, in a clean folder."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from support.commands import SHORT, microvib
from support.pages import AT_A_RELEASE, LINES_AT_A_RELEASE

ROOT = Path(__file__).parents[1]
PAGES = [
    "README.md",
    *sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "docs").rglob("*.md")),
]

RUN_ELSEWHERE = {
    "docs/howto/acceptance-test.md": "tests/test_acceptance.py",
    "docs/howto/test-day.md": "tests/test_days.py",
    "docs/howto/systems-evening.md": "tests/test_days.py",
}
"""Pages with a test of their own, which runs their lines as they stand."""
SHORTER: dict[str, list[str]] = {
    "--seeds 60": [*SHORT, "--seeds", "2"],
    "--angles 0:180:15": [*SHORT, "--angles", "0:180:90"],
    "--angles 0:330:30": [*SHORT, "--angles", "0,120"],
    "--orbit": [*SHORT, "--angles", "30:40:10"],
    "--judge 2": ["--count", "2"],
    "sweep.yaml": [],
    '--to "0.09 deg/s"': ["--count", "2", "--linear"],
    '--to "0.06 deg/s"': ["--count", "2", "--linear", "--out", "another plan"],
    'rates state-1 --from "0.05 deg/s" --to "0.07 deg/s"': ["--count", "2", "--linear"],
    "microvib rates": ["--count", "2", "--linear", "--from", "0.1 deg/s", "--microsteps", "16,32"],
    "microvib modes": ["--count", "3"],
    "microvib run": SHORT,
    "microvib measure": ["--bench", "short.yaml"],
    "microvib identify": [
        "--set",
        "record.settle=0.2 s",
        "--set",
        "record.duration=1 s",
        "--starts",
        "2",
    ],
}
"""What is appended to lines that have these words: the same command on less work."""
FEWER = {
    "count: 128": "count: 16",
    "record.settle: 2 s": "record.settle: 0.5 s",
    "record.duration: 4 s": "record.duration: 1 s\n  record.sample_rate: 1024 Hz",
    "limit: 60 mN*m": "limit: 60 mN*m\nharmonics: 2",
}
"""What stands instead in files that a page prints."""
NOT_RUN = {
    "-m venv": "makes an environment; CI does it",
    "pip install": "installs; what its lines name is looked up below",
    "-m pytest": "this is one of its tests",
    "analyse slew.txt": "a recording of the reader's own; tests/test_orders_of_a_clock.py makes one of its shape",
    "python benchmarks/open": "minutes; tests/test_open_benchmark.py runs it on two cases",
    "microvib serve": "serves until it is stopped; tests/serve/test_command.py starts and stops it",
    "curl ": "asks a server that runs; tests/serve asks",
    "/shared/batch": "a cluster with Slurm; tests/campaign/test_killed.py looks at what it is given",
    "example.py ./drive-linux64.so": "in the folder of a library; tests/export/test_c_library.py runs it",
    "examples/basilisk_array.py": "needs Basilisk, which is not among the test's packages; tests/export/test_basilisk.py",
    "--as fmu": "seconds of a compiler for each platform; tests/export runs the command's function",
    "microvib validate": "seconds; tests/test_commands.py runs it, in a terminal and in a pipe",
    "microvib statements": "a minute a draw; tests/test_validate.py makes one with fewer records",
    "my-drive.yaml one.uff two.uff": "recordings of the reader's own; tests/test_driver.py and test_studies.py identify",
    "state-1.yaml one.uff two.uff": "recordings of the reader's own; tests/test_driver.py and test_studies.py identify",
    "--recording table.csv": "a recording of the reader's own; tests/test_budget.py takes one",
    "--compare B.yaml": "two designs of the reader's own; tests/test_designs.py compares some",
    "--campaign batch --steady": "a campaign of the reader's own; tests/test_budget.py takes one",
    "microvib analyse unit-1.uff": "recordings of the reader's own; tests/test_sections.py makes some",
    "microvib sensitivity my-drive.yaml": "the drive's ranges come from a data sheet; tests/test_sensitivity.py",
    "microvib profile": "a minute; tests/test_profiles.py runs the command",
    "microvib wheel": "waterfalls of the reader's own; tests/test_wheel_waterfalls.py makes some",
    "microvib quiet": "minutes; tests/test_quiet.py and test_commands.py run it",
    "my-drive.yaml --from-datasheet": "asks in a terminal, or writes what is there already; tests/test_new.py",
    "microvib identify state-1 state-1:measured": "minutes, as its page says; tests/test_studies.py identifies",
}
"""Lines that are left out, by words that they have, and why."""
CATALOG = ROOT / "src" / "microvib" / "catalog"
DRIVE, ARRAY, BENCH = (
    (CATALOG / name).read_text("utf-8")
    for name in ("new.yaml", "reference-array.yaml", "benches/force-table.yaml")
)
STUDY = "{scenario: state-1, harmonics: 2, set: {record.settle: 0.5 s, record.duration: 1 s}, vary: {driver.microsteps: [16, 32]}}"
CRAFT = {
    name: (ROOT / "examples" / name).read_text("utf-8")
    for name in ("spacecraft.yaml", "requirement.yaml", "sources.yaml")
}
LESS = {
    "requirement.yaml": CRAFT["requirement.yaml"].partition("  - {name: P-2")[0],
    "sources.yaml": CRAFT["sources.yaml"].replace("speed_to: 3000 rpm", "speed_to: 1050 rpm"),
}
"""One requirement and a fortieth of the wheel's speeds, which are looked at for each angle; tests/test_budget.py takes the whole example."""
GIVEN: dict[str, dict[str, str]] = {
    "README.md": {"study.yaml": STUDY},
    "docs/fem.md": {"my-array.yaml": ARRAY},
    "docs/howto/array.md": {"my-array.yaml": ARRAY, "my-drive.yaml": DRIVE},
    "docs/howto/export.md": {"my-drive.yaml": DRIVE}
    | {f"examples/{name}": text for name, text in CRAFT.items()},
    "docs/howto/limit-curves.md": {f"examples/{name}": text for name, text in CRAFT.items()},
    "docs/howto/order-tracking.md": {
        "bands.csv": "low_hz,high_hz,limit_mn_m\n2,20,15\n20,80,70\n80,150,20\n"
    },
    "docs/howto/motor.md": {"my-drive.yaml": DRIVE},
    "docs/howto/pulses.md": {"pulses.yaml": (ROOT / "examples" / "pulses.yaml").read_text()},
    "docs/howto/pointing.md": CRAFT
    | LESS
    | {"study.yaml": STUDY.replace("state-1", "spacecraft.yaml")},
    "docs/howto/quiet.md": {f"examples/{name}": text for name, text in CRAFT.items()},
    "docs/howto/rate.md": {"my-drive.yaml": DRIVE},
    "docs/theory/spacecraft.md": {f"examples/{name}": text for name, text in CRAFT.items()},
}
"""Files that a page tells its reader to have written, and does not print."""
SHORT_BENCH = BENCH.replace("duration: 16 s", "duration: 3 s")
"""``short.yaml``: every later command looks at the recording, and an identification simulates as long, hundreds of times."""


def lines_of(page: str) -> list[str]:
    """Command lines in the indented blocks of a page, each as one line; cells are executed with the site, but for those of a release."""
    text = (ROOT / page).read_text("utf-8").replace("\\\n", " ")
    begin = (
        "(?: {4})?" if page.removeprefix("docs/").removesuffix(".md") in AT_A_RELEASE else " {4}"
    )
    found = re.findall(
        rf"^{begin}((?:[^\s`]*microvib(?! \{{)|\S*python3?|pip|curl|ssh) .*)$", text, re.M
    )
    return [part.strip() for line in found for part in re.sub(r"\s# .*", "", line).split("&&")]


def printed(page: str) -> dict[str, str]:
    """Files that a page prints: YAML or CSV that begins with its name as a comment."""
    text = (ROOT / page).read_text("utf-8")
    return dict(
        re.findall(r"^```(?:yaml|text)\n# (\S+\.(?:yaml|csv))$\n(.*?)^```$", text, re.M | re.S)
    )


def fewer(text: str) -> str:
    for long, short in FEWER.items():
        text = text.replace(long, short)
    return text


def entry(table: dict, line: str):
    return next((table[words] for words in table if words in line), None)


def words_of(line: str) -> tuple[list[str], str]:
    """Words of a command without what its output is handed on to, and the file that it goes to."""
    program, *words = shlex.split(line)
    assert Path(program).name == "microvib", line
    words = words[: words.index("|")] if "|" in words else words
    into = words[words.index(">") + 1] if ">" in words else ""
    words = words[: words.index(">")] if into else words
    return words + (entry(SHORTER, line) or []), into


def group(page: str) -> Any:
    """Marks of a page: README's lines run every time."""
    if page == "README.md":
        return ()
    return pytest.mark.release if page in LINES_AT_A_RELEASE else pytest.mark.long


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=group(page))
        for page in PAGES
        if lines_of(page) and page not in RUN_ELSEWHERE
    ],
)
def test_the_lines_of_a_page_run_as_printed(page, tmp_path):
    for name, text in {"short.yaml": SHORT_BENCH, **GIVEN.get(page, {}), **printed(page)}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(fewer(text))
    for line in lines_of(page):
        if entry(NOT_RUN, line) is None:
            words, into = words_of(line)
            done = microvib(*words, cwd=tmp_path)
            assert done.exit_code == 0, (line, done.output)
            if into:
                (tmp_path / into).write_text(done.stdout)


def test_what_is_left_out_or_shortened_is_on_a_page():
    lines = [line for page in PAGES for line in lines_of(page)]
    for words in (*NOT_RUN, *SHORTER):
        assert any(words in line for line in lines), words
    files = [text for page in PAGES for text in printed(page).values()]
    for words in FEWER:
        assert any(words in text for text in files), words


def test_lines_that_install_name_what_they_need():
    """The site is built by a checkout's own installation (-e); extras are those of pyproject.toml."""
    import tomllib

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for page in PAGES:
        text = (ROOT / page).read_text("utf-8")
        for flags, names in re.findall(
            r"pip install ((?:-\S+ (?:constraints\.txt )?)*)['\"](?:microvib|\.)\[([\w,-]+)\]", text
        ):
            assert set(names.split(",")) <= set(extras), (page, names)
            assert "docs" not in names.split(",") or "-e" in flags, page
