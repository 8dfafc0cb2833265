"""Acceptance reports from templates: named parts, verdicts, what is refused; the how-to's commands run as they stand."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.tiers import at_a_release

import microvib as mv
from microvib.cli.main import main
from microvib.io.recordings import write_recording
from microvib.testdata.recording import Recording

ROOT = Path(__file__).parents[1]
RATE = 512.0
TEMPLATE = """# Test of {{ data.drive }}

Verdict: **{{ test.verdict }}** ({{ test.limit }}).

{{ test.verdicts }}
{{ test.conclusion }}

## Repeatability
{{ test.repeatability }}

{% for run in runs %}
## {{ run.unit }}: {{ run.name }}
{{ run.limit }}
{{ run.spectrum }}
{% endfor %}

| role | name |
|---|---|
| engineer | |
"""


def recorded(path: Path, seed: int, gain: float = 1.0) -> None:
    t = np.arange(4096) / RATE
    x = sum(a * np.cos(2.0 * np.pi * f * t) for f, a in ((13.7, 0.04), (41.1, 0.02), (88.2, 0.01)))
    noise = np.random.default_rng(seed).normal(0.0, 1e-3, t.size)
    write_recording(Recording({"Mz": gain * x + noise}, RATE, {"Mz": "N*m"}, "made"), path)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(3):
        recorded(tmp_path / f"{k}.uff", k)
    (tmp_path / "template.md").write_text(TEMPLATE)
    (tmp_path / "unit.yaml").write_text("drive: FM 2\n")
    return tmp_path


def report(*more: str, runs=("A=0.uff", "A=1.uff", "A=2.uff"), limit="60 mN*m"):
    command = ["acceptance", *runs, "--template", "template.md", "--data", "unit.yaml", "-o", "out"]
    return CliRunner().invoke(main, [*command, "--limit", limit, "--band", "5:100 Hz", *more])


def test_a_report_has_the_parts_where_the_template_has_them(folder):
    done = report()
    assert done.exit_code == 0, done.output
    text = (folder / "out" / "report.md").read_text()
    assert text.startswith("# Test of FM 2\n")
    assert "\x02" not in text
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert len(pictures) == 4
    assert all((folder / "out" / name).read_bytes()[:4] == b"\x89PNG" for name in pictures)
    order = [
        text.index(words) for words in ("Verdict:", "## Repeatability", "## A: 0.uff", "| engineer")
    ]
    assert order == sorted(order)
    page = (folder / "out" / "report.html").read_text()
    assert all(words in page for words in ("Test of FM 2", "Repeatability", "A: 2.uff", "engineer"))
    assert "smallest margin judged" in page
    assert page.count("<img") >= 4


@pytest.mark.parametrize(("limit", "verdict"), [("60 mN*m", "pass"), ("30 mN*m", "fail")])
def test_the_verdict_is_that_of_all_runs(folder, limit, verdict):
    done = report(limit=limit)
    assert done.output.startswith(f"Verdict: {verdict}")


def test_a_pass_says_what_it_assumes_of_the_measuring_chain(folder):
    assert "Assumed: the measuring chain takes nothing" in " ".join(report().output.split())


def test_a_verdict_fails_by_one_run(folder):
    both_pass = report("--overwrite", runs=("A=0.uff", "A=1.uff"), limit="60 mN*m")
    assert both_pass.output.startswith("Verdict: pass")
    recorded(folder / "loud.uff", 9, gain=2.0)
    one_fails = report("--overwrite", runs=("A=0.uff", "A=1.uff", "A=loud.uff"), limit="60 mN*m")
    assert one_fails.output.startswith("Verdict: fail")
    assert "loud.uff is an outlier in most of its lines" in one_fails.output


@pytest.mark.parametrize("reference", [(), at_a_release(("--reference", "state-1"))])
@pytest.mark.parametrize(
    ("factor", "verdict"),
    [(1.0, "pass"), (1e-3, "not judged"), (-1e-3, "not judged"), (-1.0, "pass")],
)
def test_a_run_in_another_unit_does_not_pass(folder, predicted, reference, factor, verdict):
    """It is held against the scenario; a sign changes no amplitude."""
    noise = np.random.default_rng(1).normal(0.0, 1e-6, predicted.size)
    channels = {"Mz": factor * predicted + noise}
    write_recording(Recording(channels, 4096.0, {"Mz": "N*m"}, "made"), folder / "own.mat")
    (folder / "template.md").write_text("# T\n{{ test.verdict }}\n{{ test.conclusion }}\n")
    options = ("--overwrite", "--scenario", "state-1", *reference)
    done = report(*options, runs=("A=own.mat",), limit="70 mN*m")
    assert done.exit_code == 0, done.output
    assert done.output.startswith(f"Verdict: {verdict}"), done.output
    told = "the recording (A) beside the scenario (B): A" in done.output
    assert told == (verdict == "not judged")
    assert ("(B): A multiplied by 1000 would be like B" in done.output) == (factor == 1e-3)
    beside_reference = "Not passed while this is open: of" in done.output
    assert beside_reference == (bool(reference) and verdict == "not judged")
    if reference:
        assert ("with its sign reversed" in done.output) == (factor < 0.0)


@pytest.fixture(scope="module")
def predicted():
    """The torque of state 1 in its steady state."""
    scenario = mv.load_scenario("state-1").with_({"record.duration": "10 s"})
    return mv.simulate(scenario, start="steady")["T_d"]


def test_without_a_limit_nothing_is_judged(folder):
    (folder / "template.md").write_text("# T\n{{ test.verdict }}\n")
    command = ["acceptance", "0.uff", "--template", "template.md", "-o", "out"]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    assert "Verdict: not judged" in done.output
    assert "not judged" in (folder / "out" / "report.md").read_text()


@pytest.mark.parametrize(
    ("template", "told"),
    [
        ("{{ test.verdikt }}", "has no part 'verdikt'; did you mean verdict"),
        ("{{ runs[0].spectra }}", "run 1 has no part 'spectra'"),
        ("{{ data.nothing }}", "data has no 'nothing'; there are drive"),
        ("line\n{% if %}", "template.md, line 2"),
        ("{{ nothing }}", "'nothing' is undefined"),
        ("{{ runs[9].name }}", "template.md"),
        ("{{ 1 / 0 }}", "an expression of it fails"),
        ("{{ test.__class__.__mro__ }}", "template.md"),
    ],
)
def test_a_wrong_template_is_a_sentence_and_writes_nothing(folder, template, told):
    (folder / "template.md").write_text(template)
    done = report()
    assert done.exit_code != 0
    assert told in f"{done.output}{done.exception}"
    assert not (folder / "out").exists()


def test_words_of_a_template_are_no_markup(folder):
    (folder / "unit.yaml").write_text("drive: '<script>alert(1)</script>'\n")
    report()
    assert "<script>alert" not in (folder / "out" / "report.html").read_text()


def commands(page: Path) -> list[str]:
    """Commands of a page, those over several lines in one."""
    text = page.read_text("utf-8").replace("\\\n", " ")
    return [line.strip() for line in text.splitlines() if re.match(r" {4}(microvib|python) ", line)]


@pytest.mark.release
def test_the_how_to_runs_as_it_stands(tmp_path):
    """Its commands and its Python, in a copy of the example's folder."""
    page = ROOT / "docs" / "howto" / "acceptance-test.md"
    shutil.copytree(ROOT / "examples" / "acceptance", tmp_path / "test")
    where = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "COLUMNS": "200"}
    told = {}
    for line in commands(page):
        words = shlex.split(line)
        program = [sys.executable, "-m", "microvib"] if words[0] == "microvib" else [sys.executable]
        done = subprocess.run(
            [*program, *words[1:]], cwd=tmp_path / "test", env=where, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        told[words[1]] = done.stdout
    assert "double hit: 28 % again after 30 ms" in told["hammer"]
    assert "beyond the table's FRF" in told["analyse"]
    assert told["acceptance"].startswith("Verdict: pass")
    code = re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)[0]
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path / "test",
        env=where,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("310.0") or done.stdout.startswith("309.9")


def test_a_copy_of_a_record_is_no_other_run(folder):
    """A unit that was never recorded passed with the file of another one."""
    shutil.copy(folder / "0.uff", folder / "copy.uff")
    done = report(runs=("A=0.uff", "B=copy.uff"))
    assert done.exit_code != 0
    assert "channel Mz is that of 0.uff, sample for sample" in " ".join(done.output.split())
    assert not (folder / "out").exists()


def test_a_unit_that_did_not_run_is_not_accepted(folder):
    """What is not heard is below every limit."""
    recorded(folder / "off.uff", 4, gain=0.0)
    done = report(runs=("A=0.uff", "A=off.uff"))
    assert done.exit_code == 0
    said = " ".join(done.output.split())
    assert "Verdict: not judged" in said
    assert "off.uff: no line but the mains' stands above the noise" in said
