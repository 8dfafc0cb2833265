"""Several angles of the array in one call: each as a run of its own, what is written, what is refused."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support import craft as whole
from support.craft_scenarios import scenario_of

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.cli.main import main
from microvib.io.scenario_file import dump_scenario
from microvib.reports.angles import angles_outcome
from microvib.reports.outcome import terminal_text
from microvib.results import Table
from microvib.signals.pointing import radial_rms
from microvib.studies.angles import angles_in, sweep_angles
from microvib.units import Si


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("0:180:45", [0, 45, 90, 135, 180]),
        ("0:100:45 deg", [0, 45, 90]),
        ("90:-90:-90", [90, 0, -90]),
        ("0, 30,7.5", [0, 30, 7.5]),
        ("0:0.2:0.1 rad", np.degrees([0.0, 0.1, 0.2])),
    ],
)
def test_angles_as_they_are_written(text: str, degrees: list[float]) -> None:
    assert np.degrees(angles_in(text)) == pytest.approx(degrees)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0:180", "is not a range"),
        ("0:180:-15", "is not a range"),
        ("0:1:x", "has an unknown unit"),
        ("a,b", "is not a quantity"),
        ("0:360:0.1", "at most 361"),
    ],
)
def test_other_angles_are_a_sentence(text: str, says: str) -> None:
    with pytest.raises(mv.MicrovibError, match=says):
        angles_in(text)


def test_each_angle_is_a_run_of_its_own(tmp_path: Path) -> None:
    short = {"record.settle": Si(1.0), "record.duration": Si(2.0)}
    scenario = scenario_of(whole.FullCraft(bandwidth=0.1), **short)
    found = sweep_angles(scenario, angles_in("0,75"))
    result = mv.run_scenario(scenario.with_si({"spacecraft.array_angle": math.radians(75.0)}))
    assert result.motion is not None
    one = hub_lines(result.motion, result.table)
    assert found.los("drive_1")[1] == pytest.approx(
        np.linalg.norm(one.amplitude[one.names.index("drive_1")]), rel=1e-9
    )
    assert found.rms("rpe", 0.01)[1] == pytest.approx(
        float(radial_rms(one.mean_squares("rpe", 0.01).sum(axis=0)))
    )
    assert abs(found.los("drive_1")[0] / found.los("drive_1")[1] - 1.0) > 0.01
    outcome = angles_outcome(found)
    [table] = [item for item in outcome.parts[1].items if isinstance(item, Table)]
    top = max(float(np.linalg.norm(x.amplitude, axis=1).max()) for x in found.lines)
    assert 1e-9 <= top < 1e-6
    unit, size = "nrad", 1e-9
    assert [column.title for column in table.shown] == [
        "angle [deg]", "largest line", "frequency [Hz]", f"its amplitude [{unit}]", f"APE [{unit}]",
        f"RPE 10 ms [{unit}]", f"RPE 100 ms [{unit}]",
    ]  # fmt: skip
    texts = table.texts()
    assert [float(row[4]) for row in texts[:2]] == pytest.approx(
        found.rms("ape", 1.0) / size, rel=1e-3
    )
    assert [row[0] for row in texts] == ["0", "75", "all", "worst"]
    assert len(table.rows) == 2
    (tmp_path / "craft.yaml").write_text(dump_scenario(scenario))
    arguments = [
        "run",
        str(tmp_path / "craft.yaml"),
        "--angles",
        "0,75",
        "--out",
        str(tmp_path / "o"),
    ]
    done = CliRunner().invoke(main, arguments, prog_name="microvib")
    assert done.exit_code == 0, done.output
    rows = [
        r
        for r in csv.DictReader((tmp_path / "o" / "angles.csv").read_text().splitlines())
        if r["line"] == "drive_1"
    ]
    assert [float(r["angle_deg"]) for r in rows] == [0.0, 75.0]
    assert math.hypot(float(rows[1]["los_x_rad"]), float(rows[1]["los_y_rad"])) == pytest.approx(
        found.los("drive_1")[1]
    )
    said = json.loads((tmp_path / "o" / "angles.json").read_text())
    assert said["angles_deg"] == pytest.approx([0.0, 75.0])
    assert (tmp_path / "o" / "angles.png").stat().st_size > 10_000


def test_each_angle_is_judged_as_its_run_is(tmp_path: Path) -> None:
    """The verdict is the worst of them; loads differ from angle to angle, the torque hardly."""
    short = {"record.start": "steady", "record.duration": Si(2.0)}
    scenario = scenario_of(whole.FullCraft(bandwidth=0.1), **short)
    loads = {}
    for angle in (0.0, 75.0):
        run = mv.run_scenario(scenario.with_si({"spacecraft.array_angle": math.radians(angle)}))
        assert run.state is not None
        loads[angle] = max(x.amplitude for x in mv.find_lines(run.state, "Fx") if x.amplitude > 0.0)
    less, more = sorted(loads, key=lambda angle: loads[angle])
    curve = tmp_path / "curve.csv"
    allowed = math.sqrt(loads[less] * loads[more])
    curve.write_text(f"frequency_hz,fx_n\n0.01,{allowed}\n500,{allowed}\n", encoding="utf-8")
    limit = mv.read_limit(curve)
    found = sweep_angles(scenario, angles_in(f"{less},{more}"), limit=limit)
    for angle, judged in zip((less, more), found.judgements, strict=True):
        there = scenario.with_si({"spacecraft.array_angle": math.radians(angle)})
        own = mv.run_scenario(there, limit=limit).judgement
        assert own is not None
        assert (judged.verdict, judged.all_gaps) == (own.verdict, own.all_gaps)
    assert found.judgements[0].verdict != "fail"
    assert found.judgements[1].verdict == "fail"
    outcome = angles_outcome(found)
    assert outcome.verdict == "fail"
    assert "FAIL at 1 of 2 angles" in terminal_text(outcome)
    assert f" of Fx at {more:g} deg)" in terminal_text(outcome)


def test_firm_ground_has_no_angles() -> None:
    with pytest.raises(mv.MicrovibError, match="spacecraft: missing"):
        sweep_angles(mv.load_scenario("state-1"), angles_in("0,3"))
