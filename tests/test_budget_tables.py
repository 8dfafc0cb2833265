"""Tables of runs and budgets as sources of a budget: what they leave out is said in them, and nothing
passes by it.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from support.tiers import sweep

import microvib as mv
from microvib.analysis.run import RunResult
from microvib.io.file_access import FileAccess
from microvib.reports.budget import budget_outcome
from microvib.reports.outcome import terminal_text, text_files
from microvib.reports.run.folder import run_texts
from microvib.studies.budget.files import OtherSource, Requirement, Requirements
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.sources import Contribution
from microvib.studies.budget.study import Budget
from microvib.studies.budget.sums import Assessment, assess, combine_lines

EXAMPLES = Path(__file__).parents[1] / "examples"
WHEEL = {
    "speed": "1000 rpm",
    "speed_to": "3000 rpm",
    "axis": [0, 0, 1],
    "harmonics": [{"order": 1, "radial_force": "1e-6 N*s^2/rad^2"}],
}
ORIGIN = ["0 m", "0 m", "0 m"]
NEAR_END = {"metric": "ape", "axis": "x", "lowest": "45 Hz", "highest": "49.9 Hz"}


@pytest.fixture(scope="module")
def scenario() -> mv.Scenario:
    return mv.load_scenario(EXAMPLES / "spacecraft.yaml")


def other(folder: Path, scenario: mv.Scenario, **given: object) -> Contribution:
    source = OtherSource(**{"name": "other", **given})
    return contribution_of_other(source, scenario, FileAccess(folder=folder))


def write_lines(path: Path, scenario: mv.Scenario, *contributions: Contribution) -> None:
    """``lines.csv`` of a budget of these contributions."""
    tones = combine_lines(contributions, "rss", with_errors=False)
    budget = Budget(scenario, None, "rss", contributions, tones, (), ())
    path.write_text(text_files(budget_outcome(budget))["lines.csv"])


def judged(*contributions: Contribution, **keys: object) -> Assessment:
    return assess(Requirement(**{"metric": "ape", "limit": "1 mrad", **keys}), contributions, "rss")


def test_a_table_of_a_wheel_with_a_range_of_speeds_says_that_it_lists_one(
    tmp_path: Path, scenario: mv.Scenario
) -> None:
    wheel = other(tmp_path, scenario, wheel=WHEEL, position=ORIGIN)
    write_lines(tmp_path / "lines.csv", scenario, wheel)
    read = other(tmp_path, scenario, lines="lines.csv")
    itself = judged(wheel, **NEAR_END)
    assert itself.value > 0.0
    found = judged(read, **NEAR_END)
    assert found.verdict == "not judged"
    assert "lines.csv leaves out: other: other speeds (wheel" in found.why[0]
    assert found.most >= itself.most


def test_a_table_says_that_a_density_of_another_source_is_not_in_it(
    tmp_path: Path, scenario: mv.Scenario
) -> None:
    (tmp_path / "density.csv").write_text(
        "frequency_hz,los_x_rad2_hz,los_y_rad2_hz\n10,1e-16,1e-16\n30,1e-16,1e-16\n"
    )
    (tmp_path / "some.csv").write_text("frequency_hz,los_x_rad,los_y_rad\n12,1e-9,1e-9\n")
    density = other(tmp_path, scenario, name="hum", density="density.csv")
    line = other(tmp_path, scenario, lines="some.csv")
    assert judged(line).verdict == "pass"
    write_lines(tmp_path / "lines.csv", scenario, density, line)
    found = judged(other(tmp_path, scenario, lines="lines.csv"))
    assert found.verdict == "not judged"
    assert "hum: its density" in found.why[0]


def test_a_complete_table_is_judged_with_the_bounds_of_its_lines(
    tmp_path: Path, scenario: mv.Scenario
) -> None:
    """Loads of a line without phases add up with the worst, and may cancel."""
    (tmp_path / "loads.csv").write_text("frequency_hz,mx_n_m,my_n_m\n12,0.01,0.02\n31,0.02,0.01\n")
    first = other(tmp_path, scenario, lines="loads.csv", position=ORIGIN)
    first = Contribution(
        "other", first.how, first.names, first.frequency, first.los, phased=False,
        relative_error=first.relative_errors,
    )  # fmt: skip
    write_lines(tmp_path / "lines.csv", scenario, first)
    with (tmp_path / "lines.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["left_out"] for row in rows} == {""}
    assert {row["los_x_phase_rad"] for row in rows} == {""}
    read = other(tmp_path, scenario, lines="lines.csv")
    assert not read.phased
    given, found = judged(first), judged(read)
    assert found.verdict == given.verdict == "pass"
    assert given.least < 0.96 * given.value
    assert (found.least, found.value, found.most) == pytest.approx(
        (given.least, given.value, given.most), rel=1e-6
    )


@pytest.fixture(scope="module", params=[False, True], ids=["quiet", "noisy"])
def run(scenario: mv.Scenario, request: pytest.FixtureRequest) -> RunResult:
    changes: dict[str, object] = {"record.duration": "4 s", "record.settle": "1 s"}
    if request.param:
        changes["friction.torque_noise"] = {"density": "1e-4 N^2*m^2/Hz"}
    return mv.run_scenario(scenario.with_(changes))


@pytest.mark.parametrize("name", sweep(["pointing.csv", "loads.csv"], "loads.csv"))
def test_tables_of_a_run_say_what_it_did_not_look_at(
    tmp_path: Path, scenario: mv.Scenario, run: RunResult, name: str
) -> None:
    noisy = run.scenario.friction.torque_noise is not None
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / name).write_text(run_texts(run, {})[name])
    where = {"position": ["0.35 m", "0.9 m", "-0.2 m"]} if name == "loads.csv" else {}
    read = other(tmp_path, scenario, lines=f"run/{name}", **where)
    found = judged(read, lowest="45 Hz", highest="60 Hz")
    assert found.verdict == "not judged"
    told = "; ".join(found.why)
    assert f"{name} leaves out: " in told
    assert ("friction.torque_noise, which makes a density" in told) == noisy
    assert "while array_mode_1 still rings" in told  # as limits of the run have it
    assert found.least == 0.0  # and nothing fails
    by_name = dict(zip(read.names, read.settled, strict=True))
    assert not any(by_name[each] for each in run.hub.rings if each in by_name)


def test_a_marked_table_of_others_is_not_judged_and_an_unmarked_one_is(
    tmp_path: Path, scenario: mv.Scenario
) -> None:
    head = "frequency_hz,los_x_rad,los_y_rad,left_out\n"
    (tmp_path / "marked.csv").write_text(head + "5,1e-6,0,\n7,1e-6,0,what the cooler does\n")
    (tmp_path / "plain.csv").write_text(head + "5,1e-6,0,\n7,1e-6,0,\n")
    marked, plain = (other(tmp_path, scenario, lines=f"{x}.csv") for x in ("marked", "plain"))
    assert judged(plain).verdict == "pass"
    found = judged(marked)
    assert (found.verdict, found.why) == (
        "not judged",
        ("other: marked.csv leaves out: what the cooler does",),
    )
    assert found.least == pytest.approx(1e-6 / np.sqrt(2.0))  # of the row that leaves out nothing
    assert judged(marked, limit="0.1 urad").verdict == "fail"


def test_what_curves_and_densities_say_nothing_of_stands_beside_the_verdict(
    tmp_path: Path, scenario: mv.Scenario
) -> None:
    (tmp_path / "d.csv").write_text(
        "frequency_hz,los_x_rad2_hz,los_y_rad2_hz\n20,1e-16,1e-16\n90,1e-16,1e-16\n"
    )
    density = other(tmp_path, scenario, name="hiss", density="d.csv")
    noise = other(
        tmp_path, scenario, name="sensor", random={"spread_x": "1 urad", "spread_y": "1 urad"}
    )
    points = [{"frequency": f"{f} Hz", "amplitude": "1 urad"} for f in (1, 500)]
    sources = (density, noise)

    def said(*asked: dict[str, object]) -> str:
        required = Requirements(requirements=list(asked))
        tones = combine_lines(sources, "rss", with_errors=False)
        budget = Budget(scenario, required, "rss", sources, tones, (), ())
        return terminal_text(budget_outcome(budget))

    curve = said({"axis": "x", "curve": points})
    assert "Curves limit nothing below 1 Hz and above 500 Hz" in curve
    assert "no densities and errors without lines: those of hiss, sensor." in curve
    band = said({"limit": "1 mrad", "lowest": "5 Hz", "highest": "80 Hz"})
    assert (
        "The density of hiss is given from 20 Hz to 90 Hz, and nothing of it counts outside."
        in band
    )
    inside = said({"limit": "1 mrad", "lowest": "25 Hz", "highest": "80 Hz"})
    assert "density of hiss is given" not in inside
