"""How far a run is off by its integration: estimated from the run itself, against runs with finer steps."""

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from support.line_errors import worst_change
from support.scenarios import limit_of, random_scenario, scenario_of_any_kind

import microvib as mv
from microvib.analysis.accuracy import (
    MAX_LINE_CHANGE,
    SENSITIVE_MOTION_ERROR,
    accuracy,
    add_error_estimate,
    with_integration_error,
)
from microvib.analysis.limits import judge
from microvib.analysis.run import run_scenario
from microvib.cli.main import main
from microvib.io.runs import read_run
from microvib.solve.batch import simulate_torques
from microvib.solve.integration import rerun_refined
from microvib.solve.steady.state import steady_state

OFF, WANDERS, REMEMBERS = 13, 186, 18
"""Random sets whose lines need finer steps than an accuracy of 3 percent asks for, whose motion depends on the smallest detail,
and whose record shows what happened while it settled."""


def basin():
    """A slow drive of three phases with backlash, whose motion has several forms."""
    friction = {
        "viscous": 0.00384,
        "coulomb": 0.00204,
        "breakaway": 0.00223,
        "stribeck_rate": 0.00426,
    }
    drive = {
        "rotor_teeth": 50,
        "phases": 3,
        "current": 1.0,
        "torque_constant": 0.42,
        "detent_torque": 0.0041,
    }
    windings = {"winding_resistance": 11.7, "winding_inductance": 0.0119, "rotor_inertia": 4.3e-5}
    gear = {
        "ratio": 50.0,
        "wave_generator_inertia": 5e-6,
        "stiffness": 22800.0,
        "damping": 3.92,
        "backlash": 7.6e-5,
    }
    return mv.load_scenario("state-1").with_si(
        {
            "sources": {},
            "motor": {**drive, **windings, "friction": friction},
            "driver": {
                "beats": 6,
                "microsteps": 32,
                "proportional_gain": 93.6,
                "integral_gain": 2955.0,
            },
            "reducer": gear,
            "friction": {
                "coulomb": 1.13e-4,
                "breakaway": 2.68e-4,
                "stribeck_rate": 7.6e-5,
                "viscous": 0.0457,
            },
            "array": {
                "inertia": 1.95,
                "modes": [{"frequency": 0.326, "damping": 0.0032, "effective_inertia": 1.72}],
            },
            "tracking": {"rate": 6.4e-4},
            "record": {"settle": 1.5, "duration": 4.0, "sample_rate": 2048.0},
        }
    )


def coarse(k):
    return random_scenario(k).with_si({"solver.accuracy": 0.03})


@pytest.fixture(scope="module")
def off():
    motion = mv.simulate(coarse(OFF))
    table = mv.find_lines(motion)
    return motion, table, accuracy(motion, table)


@pytest.fixture(scope="module")
def wanders():
    motion = mv.simulate(random_scenario(WANDERS))
    table = mv.find_lines(motion)
    return motion, table, accuracy(motion, table)


def test_a_run_is_done_again_to_the_last_bit(motion_1):
    shorter = motion_1.scenario.with_si({"record.settle": 0.5, "record.duration": 2.0})
    beginning = mv.simulate(shorter, channels=("T_d",)).beginning
    assert np.array_equal(
        rerun_refined(shorter, beginning, 1, 2.0), simulate_torques([shorter])[0].T_d
    )


def test_what_a_motion_remembers_of_its_settling_is_seen():
    scenario = random_scenario(REMEMBERS)
    motion = mv.simulate(scenario, channels=("T_d",))
    table = mv.find_lines(motion)
    exact = mv.find_lines(mv.simulate(scenario.with_({"solver.refinement": 4}), channels=("T_d",)))
    assert worst_change(table, exact)[0] > MAX_LINE_CHANGE
    estimate = accuracy(motion, table)
    assert estimate.sensitive or estimate.line > MAX_LINE_CHANGE


def test_a_set_whose_lines_are_off_is_told_what_to_set(off):
    motion, table, estimate = off
    assert estimate.line > MAX_LINE_CHANGE
    assert estimate.advised
    assert not estimate.sensitive
    assert str(estimate).endswith(f"set solver.refinement={estimate.refinement}")
    exact = mv.find_lines(mv.simulate(motion.scenario.with_({"solver.refinement": 8})))
    change = worst_change(table, exact)[0]
    assert change > MAX_LINE_CHANGE
    assert change / 3.0 < estimate.line < 3.0 * change
    finer = mv.simulate(motion.scenario.with_({"solver.refinement": estimate.refinement}))
    refined = mv.find_lines(finer)
    assert worst_change(refined, exact)[0] < MAX_LINE_CHANGE
    assert not accuracy(finer, refined).advised


def test_a_run_that_is_fine_is_left_alone(motion_1):
    table = mv.find_lines(motion_1)
    estimate = accuracy(motion_1, table)
    assert not estimate.advised
    assert not estimate.sensitive
    assert estimate.refinement == motion_1.scenario.solver.refinement
    finer = mv.simulate(motion_1.scenario.with_({"solver.refinement": 4}))
    apart = np.std(finer["T_d"] - motion_1["T_d"]) / np.std(finer["T_d"])
    assert apart / 3.0 < estimate.rms < 3.0 * apart
    assert 0.5 * worst_change(table, mv.find_lines(finer))[0] < estimate.line < MAX_LINE_CHANGE


def test_a_motion_that_depends_on_the_smallest_detail_is_named_so(wanders):
    motion, table, estimate = wanders
    assert estimate.sensitive
    assert not estimate.advised
    assert str(estimate).startswith("SENSITIVE: the motion depends on details below the tolerance")
    assert estimate.relative_error >= SENSITIVE_MOTION_ERROR
    # it does: a change far below the tolerance grows a hundredfold within ten seconds
    scenario = motion.scenario.with_si({"record.settle": 0.2})
    nudged = replace(motion.beginning, state=motion.beginning.state * (1.0 + 1e-9))
    there, back = (rerun_refined(scenario, b, 1, 10.0) for b in (motion.beginning, nudged))
    assert np.std((there - back)[-4096:]) > 100.0 * np.std((there - back)[:256])


def test_lines_that_agree_do_not_hide_that_a_finer_run_is_another_motion(off, monkeypatch):
    """The other motion is the mirror image of the first: its lines are as large, and T_d differs by twice its RMS."""
    motion, table, _ = off
    mirrored = 2.0 * motion["T_d"].mean() - motion["T_d"]
    monkeypatch.setattr("microvib.analysis.accuracy.rerun_refined", lambda *given: mirrored)
    estimate = accuracy(motion, table)
    assert estimate.line < 1e-9
    assert estimate.rms == pytest.approx(2.0)
    assert estimate.sensitive
    for factor in (0.3, 2.0):
        line = max(table, key=lambda x: np.nan_to_num(x.amplitude))
        limit = limit_of(factor * line.amplitude, line.frequency - 0.01, line.frequency + 0.01)
        assert (
            judge(with_integration_error(table, estimate), limit).of(line).verdict == "not judged"
        )


def test_a_drive_whose_motion_has_several_forms_is_sensitive():
    """With a refinement of 1 and 2 drive_1 is the same to 0.1 %, with 4 a quarter of it, and T_d is another motion."""
    motion = mv.simulate(basin(), channels=("T_d",))
    table = mv.find_lines(motion)
    estimate = accuracy(motion, table)
    assert estimate.sensitive
    assert estimate.rms > 0.3
    line = table["drive_1"]
    limit = limit_of(0.7 * line.amplitude, line.frequency - 0.1, line.frequency + 0.1)
    assert judge(with_integration_error(table, estimate), limit).of(line).verdict == "not judged"


def test_a_steady_state_without_a_line_in_the_passband_has_an_account(state_1):
    """Its slowest line is at 3.3 Hz, above the passband of 8 samples a second."""
    slow = state_1.with_({"record.sample_rate": "8 Hz", "reducer.backlash": "100 arcsec"})
    result = mv.run_scenario(slow, start="steady", lines_only=True)
    assert result.state is not None
    assert not [line for line in result.table if line.amplitude > 0.0]


def test_a_limit_is_judged_with_what_the_integration_may_be_off(off):
    motion, whole, estimate = off
    table = replace(
        whole, lines=tuple(x for x in whole if x.status == "ok"), find_error=None
    )  # what rings would be a doubt of its own, and nobody asked for the error
    known, solver = (
        with_integration_error(table, estimate),
        add_error_estimate(motion.solver, estimate),
    )
    assert known.own_error == estimate.relative_error == solver["error_estimate"]["line"]
    line = min(table, key=lambda x: x.amplitude_uncertainty / x.amplitude)
    near = limit_of(line.amplitude * (1.0 + 0.5 * estimate.line))
    alone = near.torque, line.frequency - 0.01, line.frequency + 0.01
    assert judge(table, limit_of(*alone)).of(line).verdict == "pass"
    assert judge(known, limit_of(*alone)).of(line).verdict == "not judged"


def test_a_run_says_it_everywhere(tmp_path, off, monkeypatch):
    monkeypatch.setattr("microvib.reports.sheets.svg", lambda drawing: "<svg/>")
    _, _, estimate = off
    out = tmp_path / "run"
    (tmp_path / "set.yaml").write_text(mv.dump_scenario(coarse(OFF)), encoding="utf-8")
    done = CliRunner().invoke(main, ["run", str(tmp_path / "set.yaml"), "--out", str(out)])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert f"Integration: {estimate}" in said
    summary = json.loads((out / "summary.json").read_text())
    assert summary["solver"]["error_estimate"]["refinement"] == 2
    assert (
        read_run(out).table.own_error
        == summary["own_error"]
        == pytest.approx(estimate.relative_error)
    )
    page = (out / "report.html").read_text()
    assert page.count("NOT fine enough") == 2
    assert "set solver.refinement=2" in page


def test_lines_alone_say_it_too(off):
    found = run_scenario(coarse(OFF), lines_only=True)
    assert found.solver["error_estimate"]["line"] == pytest.approx(off[2].line, rel=1e-6)
    assert found.table.own_error == pytest.approx(off[2].relative_error, rel=1e-6)


def test_no_estimate_where_no_step_is_finer_or_the_state_is_not_known(state_1):
    short = state_1.with_si({"record.settle": 0.1, "record.duration": 0.2, "solver.refinement": 32})
    motion = mv.simulate(short)
    assert accuracy(motion, mv.find_lines(motion)) is None
    coarse = mv.simulate(short.with_({"solver.refinement": 1}))
    assert accuracy(coarse, mv.find_lines(coarse)) is not None
    assert accuracy(replace(coarse, beginning=None), mv.find_lines(coarse)) is None
    assert math.isfinite(accuracy(coarse, mv.find_lines(coarse)).rms)


def test_without_an_estimate_nothing_is_judged(state_1):
    """With a refinement of 32 no run is finer: an error of 0 would be too good."""
    short = state_1.with_si(
        {"record.settle": 16.0, "record.duration": 3.0, "solver.refinement": 32}
    )
    for finest, verdicts in ((32, {"not judged"}), (16, {"pass"})):
        scenario = short.with_({"solver.refinement": finest})
        table = mv.find_lines(mv.simulate(scenario, channels=("T_d",)))
        judged = judge(table, limit_of(1e3, 40.0, 60.0), scenario)
        assert {judged.verdict} == verdicts
    fine = mv.find_lines(mv.simulate(short, channels=("T_d",)))
    gaps = judge(fine, limit_of(1e3, 40.0, 60.0), short).gaps
    assert any("solver.refinement=16 or less" in gap for gap in gaps)


@pytest.mark.parametrize("door", ["motion", "batch", "steady", "saved", "lines alone"])
def test_lines_of_every_origin_are_judged_by_how_far_they_are_off(door, off):
    """A limit half the error of the integration above a line passes by no way to it."""
    motion, _, estimate = off
    scenario = motion.scenario
    steady = scenario.with_({"record.start": "steady"})

    table = {
        "motion": lambda: mv.find_lines(motion),
        "batch": lambda: mv.find_lines(mv.simulate_many([scenario])[0]),
        "steady": lambda: mv.find_lines(scenario, start="steady"),
        "saved": lambda: mv.find_lines(replace(motion, beginning=None)),
        "lines alone": lambda: mv.run_scenario(steady, lines_only=True).table,
    }[door]()
    steady_lines = tuple(x for x in table if x.status == "ok" and x.kind != "other")
    table = replace(table, lines=steady_lines)  # nothing rings, nor has side lines by what rings
    line = min(table, key=lambda x: x.amplitude_uncertainty / x.amplitude)
    band = line.frequency - 0.01, line.frequency + 0.01
    limit = limit_of(line.amplitude * (1.0 + 0.5 * estimate.line), *band)
    unaware = replace(table, find_error=None, own_error=0.0)
    assert mv.judge(unaware, limit, scenario).of(line).verdict == "pass"
    judged = mv.judge(table, limit, scenario)
    assert judged.of(line).verdict == "not judged"
    if door == "saved":
        assert "error of its integration is not known" in judged.gaps[0]
        assert "mv.run" in judged.gaps[0]
    else:
        far = limit_of(2.0 * line.amplitude, *band)
        assert mv.judge(table, far, scenario).of(line).verdict == "pass"


def test_the_error_is_sought_once_and_only_for_a_verdict(off, monkeypatch):
    motion, _, estimate = off
    calls = []

    def counted(*given):
        calls.append(given[2])
        return rerun_refined(*given)

    monkeypatch.setattr("microvib.analysis.accuracy.rerun_refined", counted)
    table = mv.find_lines(motion)
    assert not calls
    for torque in (0.01, 0.02):
        mv.judge(table, limit_of(torque), motion.scenario)
    assert calls == [2, 4]
    assert table.find_error(table) == pytest.approx(estimate.relative_error)
    assert pickle.loads(pickle.dumps(table)).find_error(table) == table.find_error(table)


def test_a_steady_state_beside_others_neither_passes_nor_fails():
    scenario = scenario_of_any_kind(47).with_si(
        {"reducer.backlash": 0.00011359277888394826, "motor.detent_torque": 0.022308329154971083}
    )
    finer = scenario.with_si({"solver.refinement": 2})
    found, other = (mv.find_lines(steady_state(one)) for one in (scenario, finer))
    size = {x.frequency: x.amplitude for x in other if x.status == "ok"}
    steady = [x for x in found if x.status == "ok" and x.frequency in size]
    differs = max(steady, key=lambda x: abs(x.amplitude - size[x.frequency]))
    between = 0.5 * (differs.amplitude + size[differs.frequency])
    assert abs(differs.amplitude / between - 1.0) > 0.03
    assert found.find_error(found) > 0.1
    assert mv.judge(found, limit_of(between), scenario).of(differs).verdict == "not judged"
