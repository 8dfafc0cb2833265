"""The open benchmark, run as its page says, and its scorer on a truth made by hand."""

from __future__ import annotations

import csv
import hashlib
import importlib.util
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.tiers import sweep

ROOT = Path(__file__).parents[1]
HEADER = "case,frequency_hz,amplitude_n_m,phase_rad,frequency_sd_hz,amplitude_sd_n_m,phase_sd_rad"


def benchmark(*arguments: object) -> str:
    command = [sys.executable, str(ROOT / "benchmarks" / "open"), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def rows_of(text: str, title: str) -> dict[str, dict[str, str]]:
    """A table that is printed under a title, by the first cell of its rows."""
    part = text.split(title, 1)[1].strip().split("\n\n")[1]
    header, _, *rows = (
        [cell.strip() for cell in line.strip("| ").split("|")] for line in part.splitlines()
    )
    return {row[0]: dict(zip(header, row, strict=True)) for row in rows}


def half(name: str) -> str:
    return "withheld" if hashlib.sha256(name.encode()).digest()[-1] & 1 else "open"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A truth of two lines that count, one too small to and a mode."""
    name = "case-000"
    (tmp_path / name).mkdir()
    truth = {
        "half": half(name), "duration": 10.0, "parameters": {}, "flux_harmonics": [], "modes": [2.0],
        "unscored": [70.0],
        "lines": [[50.02, 1e-2, 1.0, 1e-5], [100.04, 1e-3, -3.1, 1e-5], [150.06, 5e-5, 0.0, 1e-5]],
    }  # fmt: skip
    (tmp_path / name / "truth.json").write_text(json.dumps(truth))
    return tmp_path


def scored(folder: Path, *rows: tuple[float, ...]) -> dict[str, str]:
    entry = folder / "entry.csv"
    lines = [
        ",".join(["case-000", *("" if math.isnan(x) else repr(x) for x in row)]) for row in rows
    ]
    entry.write_text("\n".join([HEADER, *lines, ""]))
    text = benchmark("score", folder, entry, "--count", 1)
    return rows_of(text, f"Lines, {half('case-000')} half")["entry"]


def test_what_is_exact_scores_so(folder):
    sd = (1e-3, 1e-5, 1e-3)
    row = scored(folder, (50.02, 1e-2, 1.0, *sd), (100.04, 1e-3, -3.1 + 2.0 * math.pi, *sd))
    assert row["lines"] == "2"
    assert (row["missed %"], row["false a recording"]) == ("0.0", "0.00")
    assert row["amplitude in 95 %"] == row["phase in 95 %"] == row["frequency in 95 %"] == "100.0"


def test_what_is_wrong_scores_so(folder):
    nan = (math.nan,) * 3
    row = scored(
        folder,
        (50.03, 1.1e-2, 1.5, *nan),  # a tenth of a bin, 10 %, 0.5 rad off; the other line is missed
        (60.0, 1e-3, 0.0, *nan),  # nothing is there
        (50.07, 2e-3, 0.0, *nan),  # a second one on a line that has one
        (150.06, 5e-5, 0.0, *nan),  # there, and too small to be asked for
        (2.0, 1e-2, 0.0, *nan),  # a mode
        (70.0, 1e-2, 0.0, *nan),  # an order without one amplitude
    )  # fmt: skip
    assert row["missed %"] == "50.0"
    assert row["false a recording"] == "2.00"
    assert row["frequency, bins/1000"].startswith("1e+02")
    assert row["amplitude %"].startswith("10 ")
    assert row["phase, mrad"].startswith("5e+02")
    assert row["amplitude in 95 %"] == "none stated"


def test_intervals_that_do_not_hold_the_truth_are_counted(folder):
    row = scored(
        folder, (50.02, 1.001e-2, 1.0, 1e-3, 5e-6, 1e-3), (100.04, 1.001e-3, -3.1, 1e-3, 1e-6, 1e-3)
    )
    assert row["amplitude in 95 %"] == "50.0"


@pytest.fixture
def scorer(monkeypatch):
    """The benchmark's module of scores."""
    folder = ROOT / "benchmarks" / "open"
    monkeypatch.syspath_prepend(str(folder))
    spec = importlib.util.spec_from_file_location("open_scorer", folder / "scoring.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "open_scorer", module)  # where dataclasses look for types
    spec.loader.exec_module(module)
    return module


def test_intervals_of_both_halves_are_means_over_recordings(scorer):
    halves = [
        scorer.Score(inside={"phase": [1.0, 0.8]}),
        scorer.Score(inside={"phase": [0.9], "amplitude": [1.0]}),
    ]
    row = scorer.coverage_row("mine", halves)
    assert row == ["mine", "none stated", "100.0 of one", "90.0 ± 5.8"]


def test_parameters_tell_how_far_they_are_off_over_what_is_stated(scorer):
    row = {"key": "k", "estimate": "10", "low": "8", "high": "14", "identifiable": "yes"}
    truths = {"a": {"k": 11.0}, "b": {"k": 9.0}, "c": {"k": 15.0}}
    (cells,) = scorer.parameter_rows(truths, [row | {"case": name} for name in truths])
    told = dict(zip(scorer.PARAMETER_HEADER, cells, strict=True))
    assert told["of these, truth in 95 %"] == "2 of 3"
    off = [1.96 * x for x in (1.0 / 4.0, 1.0 / 2.0, 5.0 / 4.0)]
    assert told["RMS error, deviations"] == f"{math.sqrt(sum(x * x for x in off) / 3.0):.2f}"


NAMES = ("case-002", "case-008")


@pytest.mark.release
def test_two_cases_are_made_estimated_and_scored(tmp_path):
    text = benchmark("all", tmp_path, "--only", *NAMES, "--most", 0)
    found = [rows_of(text, f"Lines, {each} half") for each in ("open", "withheld")]
    for rows in found:
        assert set(rows) == {
            "nearest bin of an FFT", "flat-top peak", "SciPy peak fit", "Vold-Kalman", "microvib",
        }  # fmt: skip
    lines = sum(int(rows["microvib"]["lines"]) for rows in found)
    assert lines > 10
    for name in NAMES:
        truth = json.loads((tmp_path / name / "truth.json").read_text())
        assert truth["half"] == half(name)
    again = tmp_path / "again"
    benchmark("make", again, "--only", NAMES[0])
    first, second = (
        json.loads((x / NAMES[0] / "truth.json").read_text()) for x in (tmp_path, again)
    )
    assert first == second
    other = tmp_path / "other"
    withheld = next(name for name in NAMES if half(name) == "withheld")
    benchmark("make", other, "--only", withheld, "--salt", "another")
    assert json.loads((other / withheld / "truth.json").read_text()) != json.loads(
        (tmp_path / withheld / "truth.json").read_text()
    )
    with (tmp_path / "lines of microvib.csv").open(newline="") as file:
        ours = [row for row in csv.DictReader(file) if row["case"] == NAMES[0]]
    true = np.array(first["lines"])
    largest = true[np.argmax(true[:, 1])]
    nearest = min(ours, key=lambda row: abs(float(row["frequency_hz"]) - largest[0]))
    error = float(nearest["amplitude_n_m"]) - largest[1]
    assert abs(error) < 5.0 * float(nearest["amplitude_sd_n_m"]) + 1e-4 * largest[1]


@pytest.mark.long
@pytest.mark.parametrize(
    "name", sweep(["case-000", "case-004"], "case-000")
)  # the second has flux harmonics
def test_the_integrator_agrees_with_ours(tmp_path, name):
    text = benchmark("check", tmp_path, "--only", name)
    count, off = int(text.split()[1]), float(text.split()[-2])
    assert count > 3
    assert off < 0.1


def test_the_manifest_is_that_of_the_cases(tmp_path):
    kept = (ROOT / "benchmarks" / "open" / "manifest.csv").read_text()
    assert benchmark("manifest", tmp_path) == kept
    rows = list(csv.DictReader(kept.splitlines()))
    assert len(rows) == 100
    assert all(row["half"] == half(row["case"]) for row in rows)
