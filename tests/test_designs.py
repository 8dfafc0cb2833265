"""Two designs against the same requirements: verdicts of each, what changes, and when they differ."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support import craft as whole
from support.craft_scenarios import scenario_of

from microvib.cli.main import main
from microvib.errors import MicrovibError
from microvib.reports.designs import designs_outcome
from microvib.reports.outcome import terminal_text
from microvib.studies.budget.designs import Designs
from microvib.studies.budget.files import Requirement, Requirements
from microvib.studies.budget.sources import Contribution, Unobserved, open_gap
from microvib.studies.budget.study import Budget
from microvib.studies.budget.sums import assess, combine_lines

EXAMPLES = Path(__file__).parents[1] / "examples"
_LIMIT = Requirement.model_validate({"name": "R", "axis": "x", "limit": "1 rad"})


def budget(
    amplitude: float, *gaps: Unobserved, error: float = 0.0, asked: Requirement = _LIMIT
) -> Budget:
    los = np.array([[amplitude, 0.0]], dtype=complex)
    one = Contribution("a", "", ("line",), np.array([5.0]), los, gaps=gaps, relative_error=error)
    return Budget(
        scenario_of(whole.FullCraft(bandwidth=0.2)),
        Requirements(requirements=(asked,)),
        "rss",
        (one,),
        combine_lines([one], "rss"),
        (assess(asked, [one], "rss"),),
        (),
    )


def test_a_change_is_told_in_percent_and_decibel() -> None:
    found = Designs(("a.yaml", "b.yaml"), budget(1.0), budget(0.5))
    (pair,) = found.pairs
    assert pair.change == pytest.approx(0.5)
    assert (pair.better, pair.passed_by) == ("B", "both")
    said = terminal_text(designs_outcome(found))
    assert "-50.00" in said
    assert f"{20 * math.log10(0.5):.2f}" in said
    assert "Both designs pass" in said


@pytest.mark.parametrize(
    ("a", "b", "error", "better"),
    [
        (1.0, 1.05, 0.0, "A"),
        (1.05, 1.0, 0.0, "B"),
        (1.0, 1.05, 0.03, "no difference within uncertainty"),
        (1.0, 1.0, 0.0, "no difference within uncertainty"),
    ],
)
def test_designs_differ_only_beyond_what_is_not_known(
    a: float, b: float, error: float, better: str
) -> None:
    (pair,) = Designs(("a", "b"), budget(a, error=error), budget(b, error=error)).pairs
    assert pair.better == better


def test_what_nothing_bounds_is_not_judged_unless_it_is_larger_anyway() -> None:
    gap = open_gap("not looked at")
    (pair,) = Designs(("a", "b"), budget(1.0), budget(1.0, gap)).pairs
    assert (pair.better, pair.passed_by) == ("not judged", "A")
    (pair,) = Designs(("a", "b"), budget(1.0), budget(1.2, gap)).pairs
    assert pair.better == "A"  # B is 1.2 at least
    found = Designs(("a", "b"), budget(1.0), budget(1.0, gap))
    assert "B: R, not judged: a: not looked at." in terminal_text(designs_outcome(found))
    assert found.passed_by == "A"
    assert designs_outcome(found).verdict == "not judged"


def test_a_failure_of_either_is_the_verdict_on_both() -> None:
    found = Designs(("a", "b"), budget(9.0), budget(1.0))
    assert found.passed_by == "B"
    assert designs_outcome(found).verdict == "fail"
    assert Designs(("a", "b"), budget(9.0), budget(8.0)).passed_by == "neither"


def test_designs_by_other_requirements_are_refused() -> None:
    other = _LIMIT.model_copy(update={"limit": 2.0})
    with pytest.raises(MicrovibError, match="requirement: differs"):
        Designs(("a", "b"), budget(1.0), budget(1.0, asked=other))


def test_a_curve_is_compared_by_what_it_allows_where_each_is_worst() -> None:
    curve = [
        {"frequency": "1 Hz", "amplitude": "1 rad"},
        {"frequency": "100 Hz", "amplitude": "0.01 rad"},
    ]
    asked = Requirement.model_validate({"axis": "x", "curve": curve})
    low, high = budget(0.1, asked=asked), budget(0.1, asked=asked)
    moved = replace(high.contributions[0], frequency=np.array([50.0]))
    high = replace(high, judged=(assess(asked, [moved], "rss"),))
    (pair,) = Designs(("a", "b"), low, high).pairs
    assert pair.change == pytest.approx(10.0)
    assert (pair.better, pair.passed_by) == ("A", "A")


def test_the_command_compares_two_designs(tmp_path: Path) -> None:
    sources = tmp_path / "b.yaml"
    sources.write_text("sources:\n  - {name: bias, constant: {x: 2 urad, y: 0 urad}}\n")
    arguments = ["budget", str(EXAMPLES / "spacecraft.yaml"), "--steady", "--requirement",
                 str(EXAMPLES / "requirement.yaml"), "--compare-sources", str(sources), "--out", str(tmp_path / "o")]  # fmt: skip
    done = CliRunner().invoke(main, arguments, prog_name="microvib")
    assert done.exit_code == 0, done.output
    rows = {
        row["name"]: row
        for row in csv.DictReader((tmp_path / "o" / "designs.csv").read_text().splitlines())
    }
    assert rows["P-4"]["passed_by"] == rows["P-4"]["smaller"] == "A"
    assert rows["P-4"]["b_verdict"] == "fail"
    ratio = float(rows["P-4"]["b_value_rad"]) / float(rows["P-4"]["a_value_rad"])
    assert float(rows["P-4"]["change_percent"]) == pytest.approx(100.0 * (ratio - 1.0), rel=1e-6)
    assert rows["P-1"]["smaller"] == "no difference within uncertainty"  # a constant is not in RPE
    assert "A alone passes all of 5 requirements" in done.output
    said = json.loads((tmp_path / "o" / "designs.json").read_text())["b"]
    assert said["verdict"] == "fail"
    assert "Comparison of designs" in (tmp_path / "o" / "report.html").read_text()


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ([], "by the same requirements; give them (--requirement)"),
        (["--requirement", "r.yaml", "--campaign", "batch"], "does not go with campaign"),
        (["--requirement", "r.yaml", "--short-way"], "does not go with short_way, which"),
    ],
)
def test_what_is_of_one_design_is_refused(more: list[str], says: str) -> None:
    arguments = ["budget", str(EXAMPLES / "spacecraft.yaml"), "--compare", "state-1", *more]
    done = CliRunner().invoke(main, arguments, prog_name="microvib")
    assert done.exit_code != 0
    assert says in " ".join(done.output.split()), done.output


@pytest.mark.parametrize("option", ["--compare", "--compare-sources"])
def test_files_of_the_second_design_are_read_before_the_first_is_computed(
    option: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def computed(*_: object, **__: object) -> None:
        raise AssertionError("design A was computed")

    monkeypatch.setattr("microvib.studies.budget.study.pointing_budget", computed)
    arguments = ["budget", str(EXAMPLES / "spacecraft.yaml"), "--requirement",
                 str(EXAMPLES / "requirement.yaml"), option, "nowhere.yaml"]  # fmt: skip
    done = CliRunner().invoke(main, arguments, prog_name="microvib")
    assert done.exit_code == 1
    assert "nowhere.yaml: there is no such file" in done.output
