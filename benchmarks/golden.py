"""Keep what every command prints and writes, and compare it after a change of the code.

    python benchmarks/golden.py keep FOLDER       # run every command, keep its results in the new FOLDER
    python benchmarks/golden.py compare FOLDER    # run them again and list what differs from FOLDER

Two kinds of results are kept, all as text:

- *figures*: motions (a digest of each variable), tables, summaries, scenarios, schema, the page's answers. They must stay the
  same to the last bit; ``compare`` ends with status 1 where they do not.
- *words*: what is printed, and the text of reports. They may be mended; ``compare`` shows the difference.

Dates, durations of the computation, versions and folders are replaced by a mark before anything is
kept. Figures are the same on one machine only: products are fused where the processor can. Keep and
compare on the same one. ``--only NAME`` takes the commands whose name contains NAME, and those that
they need.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pypdf
import scipy.io

MICROVIB = (sys.executable, "-m", "microvib")
EXAMPLES = Path(__file__).parents[1] / "examples"
DEADLINE = 1800.0
"""Seconds after which a command, or a job of the page, counts as hanging."""


class Command(NamedTuple):
    """A command line, the files or folders that it writes, and the commands that must have run
    before it.
    """

    arguments: Sequence[str]
    writes: Sequence[str] = ()
    needs: Sequence[str] = ()


SHORT = ("--set", "record.settle=0.5 s", "--set", "record.duration=2 s")
GEARED = "reducer.transmission_error=[{order: 2, amplitude: 10 urad, phase: 0 deg}]"
NOISY = "friction.torque_noise={density: 2e-6 N^2*m^2/Hz, lowest: 0 Hz, highest: null, seed: 1}"
STUDY = """
harmonics: 2
scenario: state-1
set: {record.settle: 0.2 s, record.duration: 1 s, record.sample_rate: 1024 Hz}
limit: 30 mN*m
vary: {friction.breakaway: {distribution: uniform, within: 20 percent}}
sampling: {method: random, count: 6}
"""
FILES: Mapping[str, str] = {
    "study.yaml": STUDY,
    "craft.yaml": (EXAMPLES / "spacecraft.yaml").read_text(encoding="utf-8"),
    "requirement.yaml": (EXAMPLES / "requirement.yaml").read_text(encoding="utf-8"),
    "sources.yaml": (EXAMPLES / "sources.yaml").read_text(encoding="utf-8"),
    "modes.csv": "frequency_hz,damping,effective_inertia_kg_m2,inertia_kg_m2\n1.19,0.01,8,9\n",
}


def _states() -> Iterator[tuple[str, Command]]:
    for k in range(1, 6):
        yield (
            f"run-state-{k}",
            Command(["run", f"state-{k}", "--out", f"state-{k}"], [f"state-{k}"]),
        )


COMMANDS: Mapping[str, Command] = {
    "help": Command(["--help"]),
    "scenarios": Command(["scenarios"]),
    "schema": Command(["schema"]),
    "show": Command(["show", "state-1"]),
    "show-craft": Command(["show", "craft.yaml"]),
    "new": Command(["new", "new.yaml"], ["new.yaml"]),
    "new-datasheet": Command(
        [
            "new",
            "sheet.yaml",
            "--from-datasheet",
            "--holding-torque",
            "0.5 N*m",
            "--step-angle",
            "0.018 deg",
            "--gear",
            "size 14 ratio 100",
        ],
        ["sheet.yaml"],
    ),
    **dict(_states()),
    "run-limit": Command(
        [
            "run",
            "state-1",
            *SHORT,
            "--limit",
            "10 mN*m",
            "--band",
            "0.5:150 Hz",
            "--pdf",
            "--out",
            "limit",
        ],
        ["limit"],
    ),
    "run-steady": Command(
        ["run", "state-1", "--steady", "--limit", "40 mN*m", "--out", "steady"], ["steady"]
    ),
    "run-lines-only": Command(
        ["run", "state-2", "--lines-only", *SHORT, "--out", "only"], ["only"]
    ),
    "run-noise": Command(
        [
            "run",
            "state-1",
            *SHORT,
            "--set",
            NOISY,
            "--seeds",
            "4",
            "--limit",
            "60 mN*m",
            "--out",
            "noise",
        ],
        ["noise"],
    ),
    "run-gear-error": Command(
        ["run", "state-1", *SHORT, "--set", GEARED, "--out", "geared"], ["geared"]
    ),
    "run-craft": Command(["run", "craft.yaml", *SHORT, "--out", "craft"], ["craft"]),
    "run-angles": Command(
        ["run", "craft.yaml", *SHORT, "--angles", "0,45", "--out", "angles"], ["angles"]
    ),
    "run-orbit": Command(
        ["run", "craft.yaml", "--orbit", "--angles", "0:60:30", "--out", "orbit"], ["orbit"]
    ),
    "report": Command(
        ["report", "limit", "--limit", "5 mN*m", "-o", "again.html"], ["again.html"], ["run-limit"]
    ),
    "measure-csv": Command(["measure", "state-1", *SHORT, "-o", "bench.csv"], ["bench.csv"]),
    "measure-mat": Command(["measure", "state-1", *SHORT, "-o", "bench.mat"], ["bench.mat"]),
    "analyse": Command(
        ["analyse", "bench.csv", "--scenario", "state-1", "--band", "0.5:100 Hz", "--out", "seen"],
        ["seen"],
        ["measure-csv"],
    ),
    "compare": Command(
        ["compare", "bench.csv", "state-1", "--out", "beside"], ["beside"], ["measure-csv"]
    ),
    "compare-reference": Command(["compare", "state-1:measured", "state-1"]),
    "identify": Command(
        [
            "identify",
            "state-1",
            "bench.csv",
            "--fit",
            "reducer.stiffness",
            "--starts",
            "4",
            "--band",
            "40:170 Hz",
            *SHORT,
            "--out",
            "fit",
        ],
        ["fit"],
        ["measure-csv"],
    ),
    "rates": Command(
        [
            "rates",
            "state-1",
            "--from",
            "0.04 deg/s",
            "--to",
            "0.08 deg/s",
            "--count",
            "5",
            "--microsteps",
            "16,32",
            "--limit",
            "30 mN*m",
            "--out",
            "rates",
        ],
        ["rates"],
    ),
    "rates-linear": Command(
        [
            "rates",
            "state-1",
            "--from",
            "0.01 deg/s",
            "--to",
            "0.3 deg/s",
            "--count",
            "50",
            "--linear",
            "--out",
            "chart",
        ],
        ["chart"],
    ),
    "sensitivity": Command(
        [
            "sensitivity",
            "state-1",
            *SHORT,
            "--set",
            "sources={reducer.stiffness: assumed; range 4 kN*m/rad to 6 kN*m/rad}",
        ]
    ),
    "budget": Command(
        [
            "budget",
            "craft.yaml",
            *SHORT,
            "--requirement",
            "requirement.yaml",
            "--sources",
            "sources.yaml",
            "--out",
            "budget",
        ],
        ["budget"],
    ),
    "budget-steady": Command(
        ["budget", "craft.yaml", "--steady", "--requirement", "requirement.yaml"]
    ),
    "modes": Command(["modes", "modes.csv", "--out", "modes"], ["modes"]),
    "modes-fem": Command(["modes", "reference-array", "--count", "4", "--out", "array"], ["array"]),
    "sas": Command(
        ["sas", "size", "--inertia", "8.18 kg*m^2", "--frequency", "1.19 Hz", "--out", "sas"],
        ["sas"],
    ),
    "campaign-create": Command(
        ["campaign", "create", "study.yaml", "batch"], ["batch/manifest.json"]
    ),
    "campaign-run": Command(["campaign", "run", "batch"], [], ["campaign-create"]),
    "campaign-status": Command(["campaign", "status", "batch"], [], ["campaign-run"]),
    "campaign-case": Command(["campaign", "case", "batch", "1"], [], ["campaign-run"]),
    "campaign-report": Command(
        ["campaign", "report", "batch"], ["batch/results.nc", "batch/report"], ["campaign-run"]
    ),
    "validate": Command(["validate", "--out", "paper"], ["paper"]),
}
ASKED: Mapping[str, tuple[str, Any]] = {
    "run": ("runs", {"scenario": {"base": "state-1", "changes": {"record.settle": "1 s", "record.duration": "4 s"}}}),
    "rates": (
        "rates",
        {"scenario": {"base": "state-1", "changes": {}}, "from": "0.02 deg/s", "to": "0.2 deg/s", "count": 5,
         "linear": True, "limit": "30 mN*m"},
    ),
    "sas": ("sas", {"inertia": "8.18 kg*m^2", "frequency": "1.19 Hz"}),
}  # fmt: skip
"""Jobs of the page: where they are posted, and what is asked."""
READ: Mapping[str, tuple[str, Any]] = {
    "catalog": ("catalog", None),
    "schema": ("schema", None),
    "scenario": (
        "scenario",
        {"base": "state-1", "changes": {"motor.current": "0.5 A", "driver.beats": "5"}},
    ),
    "datasheet": (
        "datasheet",
        {"entries": {"holding_torque": "0.5 N*m", "gear": "size 14 ratio 100"}},
    ),
}
"""What the page asks without starting a job."""


# --- from a result to text ----------------------------------------------------------------------------------------------

MARKS: Sequence[tuple[re.Pattern[str], str]] = (
    (
        re.compile(r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?(?:Z|[+-]\d\d:\d\d)?)?"),
        "DATE",
    ),
    (re.compile(r"\bsimulated in [\d.]+ (?:ms|s|min)"), "simulated in TIME"),
    (re.compile(r"\bin [\d.]+ (?:ms|s|min)\b(?=[.;,]?\s*(?:$|\n|Written))"), "in TIME"),
    (re.compile(r"[\d.]+ cases/s"), "SPEED"),
    (re.compile(r'("(?:times_real_time|wall_s|simulate|total)": )[\d.eE+-]+'), r"\1TIME"),
    (re.compile(r'("microvib(?:_version)?": )"[^"]*"'), r'\1"VERSION"'),
)


class Text(HTMLParser):
    """The words of an HTML page, a line for each piece, and a digest of each picture; scripts and
    styles left out.
    """

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._silent = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Leave out what is not read, and note a picture."""
        if tag in ("script", "style"):
            self._silent += 1
        source = dict(attrs).get("src")
        if tag == "img" and source:
            self.lines.append(f"[picture {_digest(source.encode())}]")

    def handle_endtag(self, tag: str) -> None:
        """Read on after a script or style."""
        if tag in ("script", "style"):
            self._silent -= 1

    def handle_data(self, data: str) -> None:
        """Keep a piece of text."""
        if not self._silent and data.strip():
            self.lines.append(" ".join(data.split()))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def _array(name: str, values: np.ndarray) -> str:
    """A line on an array: its shape, its digest and, for numbers, its ends, to see at a glance how
    far it moved.
    """
    if values.dtype.hasobject:
        return f"{name} {values.tolist()!r}"
    ends = ""
    if values.dtype.kind in "fiu" and values.size:
        ends = f" least {np.nanmin(values)!r} largest {np.nanmax(values)!r}"
    return f"{name} {values.dtype} {values.shape} {_digest(np.ascontiguousarray(values).tobytes())}{ends}"


def _netcdf(path: Path) -> str:
    lines: list[str] = []

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            values = np.asarray(item[()])
            text = values.dtype.kind in "OS"
            lines.append(f"{name} {values.tolist()!r}" if text else _array(name, values))

    with h5py.File(path) as file:
        file.visititems(visit)
        for key, value in sorted(file.attrs.items()):
            if not key.startswith("_"):
                lines.append(f"@{key} {value!r}")
    return "\n".join(sorted(lines))


def _matlab(path: Path) -> str:
    variables = {k: v for k, v in scipy.io.loadmat(path).items() if not k.startswith("__")}
    return "\n".join(_array(name, np.asarray(values)) for name, values in sorted(variables.items()))


def _html(path: Path) -> str:
    page = Text()
    page.feed(path.read_text(encoding="utf-8"))
    return "\n".join(page.lines)


def _pdf(path: Path) -> str:
    return "\n".join(page.extract_text() for page in pypdf.PdfReader(path).pages)


def _plain(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _binary(path: Path) -> str:
    return _digest(path.read_bytes())


class Kept(NamedTuple):
    """How a kind of file is kept: as figures or as words, and what makes text of it."""

    kind: str
    text: Callable[[Path], str]


KINDS: Mapping[str, Kept] = {
    **dict.fromkeys((".csv", ".json", ".yaml"), Kept("figures", _plain)),
    ".nc": Kept("figures", _netcdf),
    ".mat": Kept("figures", _matlab),
    ".html": Kept("words", _html),
    ".pdf": Kept("words", _pdf),
    ".png": Kept("words", _binary),
    ".svg": Kept("words", _binary),
}
OTHER = Kept("figures", _binary)


def _marked(text: str, places: Sequence[Path]) -> str:
    """Text without what differs from one run to the next."""
    for place in places:
        text = text.replace(str(place), "FOLDER")
    for pattern, mark in MARKS:
        text = pattern.sub(mark, text)
    return text


# --- running ------------------------------------------------------------------------------------------------------------


def run_all(kept: Path, only: str) -> None:
    """Run the commands, and the page, in a folder that is thrown away; keep what they gave in
    ``kept``.
    """
    environment = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder).resolve()
        for name, text in FILES.items():
            (work / name).write_text(text, encoding="utf-8")
        for name in _chosen(only):
            began = time.monotonic()
            _run(COMMANDS[name], work, kept / name, environment)
            print(f"{name:20s} {time.monotonic() - began:6.1f} s", file=sys.stderr, flush=True)
        if only in "page":
            _ask_page(work, kept / "page", environment)


def _chosen(only: str) -> list[str]:
    """Names of the commands whose name contains ``only``, and of those that they need, in the order
    of the table.
    """
    chosen = {name for name in COMMANDS if only in name}
    while missing := {need for name in chosen for need in COMMANDS[name].needs} - chosen:
        chosen |= missing
    return [name for name in COMMANDS if name in chosen]


def _run(command: Command, work: Path, kept: Path, environment: Mapping[str, str]) -> None:
    done = subprocess.run(
        [*MICROVIB, *command.arguments],
        cwd=work,
        env=environment,
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    _keep(kept / "status.figures", f"{done.returncode}")
    _keep(kept / "printed.words", _marked(done.stdout, [work]))
    _keep(kept / "errors.words", _marked(done.stderr, [work]))
    for name in command.writes:
        for path in _files(work / name):
            how = KINDS.get(path.suffix, OTHER)
            _keep(kept / f"{path.relative_to(work)}.{how.kind}", _marked(how.text(path), [work]))


def _files(path: Path) -> list[Path]:
    return (
        sorted(x for x in path.rglob("*") if x.is_file())
        if path.is_dir()
        else [path] * path.exists()
    )


def _keep(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.rstrip("\n") + "\n", encoding="utf-8")


class Page(NamedTuple):
    """The page's server: its address, and the token that every request must show."""

    address: str
    token: str

    def ask(self, path: str, body: Any = None) -> Any:
        """Answer to a GET, or with a body to a POST; a refusal is an answer, too."""
        data = None if body is None else json.dumps(body).encode()
        headers = {"authorization": f"Bearer {self.token}", "content-type": "application/json"}
        request = urllib.request.Request(f"{self.address}/api/{path}", data, headers)
        try:
            with urllib.request.urlopen(request, timeout=DEADLINE) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as refusal:
            return {"status": refusal.code, **json.load(refusal)}


@contextmanager
def _served(work: Path, environment: Mapping[str, str]) -> Iterator[Page]:
    command = [*MICROVIB, "serve", "--port", "0", "--no-browser"]
    server = subprocess.Popen(command, cwd=work, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        for line in server.stdout:
            if found := re.search(r"(http://[\d.:]+)\S*[#?&]token=([\w-]+)", line):
                break
        else:
            raise SystemExit("the page's server said no address")
        yield Page(found[1], found[2])
    finally:
        server.terminate()
        server.wait(DEADLINE)


def _ask_page(work: Path, kept: Path, environment: Mapping[str, str]) -> None:
    with _served(work, environment) as page:
        for name, (path, body) in READ.items():
            _keep(kept / f"{name}.figures", _answer(page.ask(path, body), work))
        for name, (path, body) in ASKED.items():
            id = page.ask(path, body)["id"]
            until = time.monotonic() + DEADLINE
            while (
                page.ask(f"jobs/{id}")["state"] not in ("done", "failed")
                and time.monotonic() < until
            ):
                time.sleep(0.1)
            result = _answer(page.ask(f"jobs/{id}/result"), work).replace(id, "ID")
            _keep(kept / f"{name}.figures", result)


def _answer(content: Any, work: Path) -> str:
    return _marked(json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False), [work])


# --- comparing ----------------------------------------------------------------------------------------------------------


def compare(before: Path, after: Path, only: str) -> bool:
    """Print what differs; whether all figures are the same."""
    names = {
        path.relative_to(root)
        for root in (before, after)
        for path in root.rglob("*")
        if path.is_file()
    }
    chosen = {*_chosen(only), *(["page"] if only in "page" else [])}
    differing = {"figures": 0, "words": 0}
    for name in sorted(x for x in names if x.parts[0] in chosen):
        old, new = (
            (root / name).read_text(encoding="utf-8") if (root / name).exists() else ""
            for root in (before, after)
        )
        if old != new:
            differing[name.suffix[1:]] += 1
            _print_difference(name, old, new)
    print(
        f"{len(names)} results; figures differ in {differing['figures']}, words in {differing['words']}"
    )
    return not differing["figures"]


def _print_difference(name: Path, old: str, new: str, most: int = 40) -> None:
    lines = list(
        difflib.unified_diff(
            old.splitlines(), new.splitlines(), "before", "after", lineterm="", n=0
        )
    )
    print(f"== {name}: {sum(x[0] in '+-' for x in lines) - 2} lines differ")
    for line in lines[2 : most + 2]:
        print(f"   {line[:200]}")
    if len(lines) > most + 2:
        print(f"   and {len(lines) - most - 2} more")


def main() -> int:
    """Keep or compare, as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["keep", "compare"])
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--only",
        default="",
        metavar="NAME",
        help="commands whose name contains NAME (default: all)",
    )
    options = parser.parse_args()
    if options.what == "keep":
        if options.folder.exists():
            parser.error(f"{options.folder} exists; nothing that was kept is overwritten")
        run_all(options.folder, options.only)
        return 0
    if not options.folder.is_dir():
        parser.error(f"{options.folder} is no folder; make it with `keep`")
    with tempfile.TemporaryDirectory() as folder:
        run_all(Path(folder), options.only)
        return 0 if compare(options.folder, Path(folder), options.only) else 1


if __name__ == "__main__":
    sys.exit(main())
