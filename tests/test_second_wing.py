"""A second wing: against both drives in one untransformed system, limits, symmetry, momentum, files, and what is refused."""

import csv
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from support import craft as whole
from support import rodas4
from support.craft_scenarios import instants, off, scenario_of, seen
from support.run_reports import run_text
from support.tiers import at_a_release, sweep
from support.two_wings import BothDrives, Wing

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.lines import steady_lines
from microvib.analysis.run import RunResult, lines_of_second
from microvib.io.yaml_text import parse_yaml
from microvib.model.coupling import blocked_load_method, source_of
from microvib.model.craft import Craft, OutputMatrix
from microvib.model.drive_matrices import coordinates
from microvib.model.linear import coupled_modes, dynamic_stiffness
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.reports.craft import draw_craft
from microvib.reports.parameters import derived
from microvib.reports.run.folder import run_to_folder
from microvib.signals.pointing import radial_rms
from microvib.solve.channels import SECOND_LOADS
from microvib.solve.on_craft import evaluate_outputs
from microvib.studies.angles import angles_in, sweep_angles
from microvib.studies.budget.files import Requirement, Requirements
from microvib.studies.campaign.cases import VERDICTS, Chunk, compute_bytes
from microvib.studies.campaign.design import read_design
from microvib.studies.campaign.folder import create
from microvib.studies.campaign.results import merge
from microvib.studies.orbit import analyse_orbit, check_orbit
from microvib.studies.rates import ABOVE_LIMIT, full_case, linear_case
from microvib.units import Si

OPPOSITE = np.array([0.35, -0.9, -0.2])
TIMES = np.array([0.05, 0.15, 0.29, 0.4])
CALM = whole.FullCraft(
    damping=0.0 * whole.DAMPING, gear_damping=0.0, on_rotor=0.0, on_output=0.0, detent=1e-9
)
"""Drives whose linearisation is all that a held shaft does: no detent torque, no friction."""
SECOND = {
    "interface": {
        "position": OPPOSITE.tolist(),
        "drive_axis": [0.0, -1.0, 0.0],
        "reference": [1.0, 0.0, 0.0],
    }
}
OBLIQUE: dict[str, Any] = {
    "interface": {
        "position": [-0.4, -0.8, 0.3],
        "drive_axis": [0.48, -0.6, -0.64],
        "reference": [0.8, 0.0, 0.6],
    },
    "array_angle": math.radians(71.0),
}


def both(
    full: whole.FullCraft = CALM, wing: dict[str, Any] | None = None, **changes: Any
) -> Scenario:
    """The craft of ``test_craft`` with a second wing on the other side."""
    return scenario_of(full, **{"spacecraft.second_wing": {**SECOND, **(wing or {})}, **changes})


def system_of(scenario: Scenario, full: whole.FullCraft, **second: Any) -> BothDrives:
    """The same in one system."""
    other = scenario.other_wing
    assert other is not None
    assert other.spacecraft is not None
    first = Wing(whole.PLACE, full.axis, full.reference, full.angle, full.rate, drive=full)
    place, rate = (
        other.spacecraft.interface,
        float(other.tracking.rate or 0.0) * other.tracking.clock_ratio,
    )
    there = Wing(
        np.array(place.position), np.array(place.drive_axis), np.array(place.reference), other.spacecraft.array_angle,
        rate, drive=full,
    )  # fmt: skip
    return BothDrives((first, replace(there, **second)), full.bandwidth, full.control_damping)


def craft_of(scenario: Scenario) -> Craft:
    assert scenario.craft is not None
    return scenario.craft


Look = Callable[[Craft], OutputMatrix]


def added(scenario: Scenario, first: Look, second: Look, times: np.ndarray = TIMES) -> np.ndarray:
    """What is looked at in the first drive's run and in the second's, added at ``times``."""
    runs = [(scenario.alone, first)]
    if scenario.driven_wing is not None:
        runs.append((scenario.driven_wing, second))
    return np.sum(
        [seen(one, look(craft_of(one)), instants(one, times)) for one, look in runs], axis=0
    )


DAMPED = whole.FullCraft(bandwidth=0.3, detent=1e-9)


@pytest.mark.parametrize(
    ("full", "wing", "second", "most"),
    [
        at_a_release(CALM, {"drive": "held"}, {"rate": 0.0}, 1e-3),
        (DAMPED, {"drive": "held"}, {"rate": 0.0}, 5e-5),
        at_a_release(CALM, {"drive": "driven"}, {}, 1e-4),
        at_a_release(DAMPED, {"drive": "driven", "stagger": 0.4}, {"late": 0.4}, 5e-5),
        (DAMPED, {"drive": "driven", "clock_ratio": 1.1, **OBLIQUE}, {}, 5e-5),
        (
            whole.FullCraft(),
            {"drive": "driven"},
            {},
            2e-3,
        ),  # what is left out is the detent torque's stiffness
    ],
)
def test_the_sum_of_two_runs_is_one_system_of_both(
    full: whole.FullCraft, wing: dict[str, Any], second: dict[str, Any], most: float
) -> None:
    scenario = both(full, wing)
    system = system_of(scenario, full, **second)
    states = system.run(TIMES)
    found = [
        added(scenario, lambda c: c.acceleration("center"), lambda c: c.acceleration("center")),
        added(scenario, lambda c: c.loads(), lambda c: c.second_loads()),
        added(scenario, lambda c: c.second_loads(), lambda c: c.loads()),
    ]
    wanted = [
        [system.accelerations(y)[:6] for y in states],
        *([system.loads(y, k) for y in states] for k in (0, 1)),
    ]
    for one, reference in zip(found, wanted, strict=True):
        assert off(one, np.array(reference)) < most


@pytest.mark.release
def test_what_superposition_leaves_out_of_lines() -> None:
    """Two full-step periods of the drive with its detent torque: driving lines 1e-4, sidebands 0.1 %, full-step lines 0.5 %."""
    full, n = whole.FullCraft(), 160
    times = 1.2 + np.arange(n) * 0.6 / n
    scenario = both(full, {"drive": "driven", "stagger": 0.3})
    system = system_of(scenario, full, late=0.3)
    wanted = np.array([system.loads(y, 0) for y in system.run(times, rtol=1e-7)])
    found = added(scenario, lambda c: c.loads(), lambda c: c.second_loads(), times)
    for f, most in (
        (53.333333, 2e-4),
        (50.0, 2e-3),
        (56.666667, 2e-3),
        (3.333333, 2e-3),
        (6.666667, 1e-2),
        (16.666667, 1e-2),
    ):
        tone = np.exp(-2j * np.pi * f * times)
        assert np.abs(tone @ (found - wanted)).max() < most * np.abs(tone @ wanted).max()


def test_modes_of_a_craft_with_a_held_wing() -> None:
    """With the first hinge locked, against the whole matrices; and as the drive gets stiff, with both hinges locked."""
    scenario = both(
        CALM, OBLIQUE, **{"spacecraft.attitude_control": {"bandwidth": 0.1, "damping": 0.7}}
    )
    system = system_of(scenario, replace(CALM, bandwidth=0.1))
    keep = [k for k in range(system.n) if k not in (system.n - 4, system.n - 3)]
    squares = eigh(
        system.springs[np.ix_(keep, keep)], system.M[np.ix_(keep, keep)], eigvals_only=True
    )
    assert craft_of(scenario).frequency == pytest.approx(
        np.sqrt(squares[3:]) / (2.0 * math.pi), rel=1e-8
    )
    bolted = eigh(system.K[:-4, :-4], system.M[:-4, :-4], eigvals_only=True)
    wanted, apart = np.sqrt(bolted[3:]) / (2.0 * math.pi), []
    for times in (1e3, 1e4):
        motor = scenario.motor.model_copy(update={"current": times * CALM.current})
        reducer = scenario.reducer.model_copy(update={"stiffness": times * CALM.stiffness})
        stiff = scenario.with_si(
            {"spacecraft.second_wing.motor": motor, "spacecraft.second_wing.reducer": reducer}
        )
        apart.append(1.0 - craft_of(stiff).frequency[: wanted.size] / wanted)
    assert np.abs(apart[1]).max() < 1e-3
    assert apart[1][-4:] == pytest.approx(0.1 * apart[0][-4:], rel=0.02)


def test_responses_take_the_held_drives_damping() -> None:
    """Loads of both wings and the hub's motion by the first's shafts, against the whole matrices."""
    full = whole.FullCraft(bandwidth=0.3)
    scenario = both(full, OBLIQUE)
    system, craft = system_of(scenario, full), craft_of(scenario)
    n, shafts = system.n, [system.n - 4, system.n - 3]
    keep = [k for k in range(n) if k not in shafts]
    for f in (0.45, 1.19, 3.33, 53.3):
        s = 2j * math.pi * f
        dynamic = s**2 * system.M + s * system.C + system.springs
        x = np.zeros((n, 2), dtype=complex)
        x[shafts] = np.eye(2) / s**2
        x[keep] = (
            -np.linalg.solve(dynamic[np.ix_(keep, keep)], s**2 * system.M[np.ix_(keep, shafts)])
            / s**2
        )
        at = np.array([f])
        assert craft.transfer(craft.motion("center"), at)[0] == pytest.approx(x[:6], rel=1e-8)
        for rows, k in ((craft.loads(), 0), (craft.second_loads(), 1)):
            on_centre = -(s**2) * (system.part[k] @ x)[:6]
            moment = on_centre[3:] - np.cross(
                system.wings[k].place, on_centre[:3], axisb=0, axisc=0
            )
            assert craft.transfer(rows, at)[0] == pytest.approx(
                np.vstack([on_centre[:3], moment]), rel=1e-7, abs=1e-9
            )


def test_the_short_way_knows_the_second_wing() -> None:
    """Apparent masses, in which the second wing is one of its own, against the coupled structure."""
    scenario = both(whole.FullCraft(bandwidth=0.3), OBLIQUE)
    f, craft = np.array([0.3, 1.19, 3.1, 53.3]), craft_of(scenario)
    short = blocked_load_method(scenario, f, source_of(scenario).blocked(f, np.ones(f.size)))
    assert short.los is not None
    T = coordinates(scenario.reducer, craft.load.H.size)
    for k, x in enumerate(f):
        motion = T @ np.linalg.solve(dynamic_stiffness(scenario, x), np.eye(T.shape[1])[0])
        alpha = -((2.0 * math.pi * x) ** 2) * motion[[1, 0]]
        loads, los = (
            craft.transfer(rows, f[[k]])[0] @ alpha
            for rows in (craft.loads(), craft.line_of_sight())
        )
        assert np.abs(loads - short.loads[k]).max() < 1e-8 * np.abs(loads).max()
        assert np.abs(los - short.los[k]).max() < 1e-8 * np.abs(los).max()


def test_momentum_is_exchanged_between_hub_and_both_wings() -> None:
    """What the hub gains is what both loads put on it, through stick and slip."""
    friction = {
        "friction.coulomb": 0.02,
        "friction.breakaway": 0.3,
        "motor.friction.coulomb": 2e-4,
        "motor.friction.breakaway": 5e-4,
    }
    scenario = both(whole.FullCraft(), {"drive": "driven", "clock_ratio": 0.9}, **friction)
    motion = mv.simulate(scenario.with_si({"record.settle": 0.0, "record.duration": 0.5}))
    assert motion.solver["sticks"] > 0
    gained = motion.hub("center", accelerations=True) @ np.block(
        [[whole.HUB_MASS * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), whole.HUB_INERTIA]]
    )
    on_centre = np.zeros_like(gained)
    for place, names in ((whole.PLACE, ("F{}", "M{}")), (OPPOSITE, ("F{}_2", "M{}_2"))):
        force, moment = (np.column_stack([motion[name.format(k)] for k in "xyz"]) for name in names)
        on_centre += np.hstack([force, moment + np.cross(place, force)])
    assert off(on_centre, gained) < 1e-9


PLAIN = {
    "inertia": 12.2,
    "modes": [{"frequency": 1.19, "damping": 0.05, "interface_participation": [0.0, 0.0, 0.0, 0.0, 0.0, 3.35]}],
    "rigid_body": {"mass": 36.0, "center_of_mass": [0.0, 0.0, 3.0], "inertia": [420.0, 420.0, 12.2, 0.0, 0.0, 0.0]},
}  # fmt: skip


def symmetric(inertia: float, wing: dict[str, Any] | None) -> Scenario:
    """Equal wings on one axis through the centre of a hub; what they do is about that axis alone."""
    hub = {"mass": 420.0, "inertia": [180.0, inertia, 180.0, 0.0, 0.0, 0.0]}
    place = {
        "drive_axis": [0.0, -1.0, 0.0],
        "reference": [1.0, 0.0, 0.0],
        "position": [0.0, -0.9, 0.0],
    }
    on = {"second_wing": None if wing is None else {"interface": place, **wing}}
    return scenario_of(replace(CALM, on_rotor=0.0255, on_output=0.05, gear_damping=5.0)).with_si(
        {
            "array": PLAIN,
            "spacecraft.hub": hub,
            "spacecraft.interface.position": [0.0, 0.9, 0.0],
            "record.start": "steady",
            **{f"spacecraft.{key}": value for key, value in on.items()},
        }
    )


def test_wings_that_turn_with_the_sun_double_and_against_each_other_cancel() -> None:
    """Two wings on a hub of J are each one on a hub of J/2; those that turn against each other stand on a fixed base."""
    driven = {"drive": "driven"}
    with_sun, half = symmetric(4.0, driven), symmetric(2.0, None)
    against = symmetric(4.0, {**driven, "tracking": {"rate": with_sun.tracking.rate}})
    other = with_sun.driven_wing
    assert other is not None
    assert other.tracking.rate == -with_sun.tracking.rate  # type: ignore[operator]
    found = {}
    for name, scenario in (("sun", with_sun), ("half", half), ("against", against)):
        state = steady_lines(scenario).state
        assert state is not None
        lines = hub_lines(state, mv.find_lines(scenario, start="steady"))
        k = lines.names.index("drive_1")
        assert lines.los is not None
        found[name] = lines.loads[k, 4], lines.los[k, 1], lines.second, k
    sun, alone, opposite = found["sun"], found["half"], found["against"]
    assert sun[2] is not None
    assert sun[2][sun[3], 4] == pytest.approx(sun[0], rel=1e-6)
    assert sun[0] == pytest.approx(alone[0], rel=1e-3)
    assert sun[1] == pytest.approx(alone[1], rel=1e-3)
    assert opposite[2] is not None
    assert opposite[2][opposite[3], 4] == pytest.approx(-opposite[0], rel=1e-6)
    assert abs(opposite[1]) < 1e-6 * abs(sun[1])
    ground = mv.find_lines(symmetric(4.0, None).with_({"spacecraft": None}), start="steady")[
        "drive_1"
    ].amplitude
    assert abs(opposite[0]) == pytest.approx(ground, rel=2e-3)
    assert abs(sun[0]) != pytest.approx(ground, rel=0.02)


def test_half_a_microstep_cancels_odd_driving_lines() -> None:
    size = {}
    for stagger in (0.0, 0.5):
        found = steady_lines(symmetric(4.0, {"drive": "driven", "stagger": stagger}))
        assert found.state is not None
        lines = hub_lines(found.state, found.lines)
        size[stagger] = {
            name: lines.amplitude[lines.names.index(name), 1]
            for name in ("drive_1", "drive_2", "drive_3")
        }
    for name in ("drive_1", "drive_3"):
        assert size[0.5][name] < 1e-4 * size[0.0][name]
    assert size[0.5]["drive_2"] == pytest.approx(size[0.0]["drive_2"], rel=1e-4)


@pytest.mark.parametrize("clock_ratio", [1.0, 1.25])
def test_a_settled_run_has_the_lines_of_the_steady_state(clock_ratio: float) -> None:
    wing = {"drive": "driven", "stagger": 0.3, "clock_ratio": clock_ratio}
    changes = {"record.settle": 20.0, "record.duration": 6.0}
    scenario = both(whole.FullCraft(damping=np.full(4, 0.08)), wing, **changes)
    long, found = mv.run_scenario(scenario), steady_lines(scenario)
    assert long.motion is not None
    assert found.state is not None
    a, b = hub_lines(long.motion, long.table), hub_lines(found.state, found.lines)
    names = ["drive_2", "drive_1", "full_step_1"]
    names += [] if clock_ratio == 1.0 else ["wing_2 drive_1", "wing_2 full_step_1"]
    assert [name for name in b.names if name.startswith("wing_2")] == [] or clock_ratio != 1.0
    for name in names:
        i, j = a.names.index(name), b.names.index(name)
        for ours, theirs in ((a.loads, b.loads), (a.second, b.second), (a.los, b.los)):
            assert ours is not None
            assert theirs is not None
            assert np.abs(ours[i] - theirs[j]).max() < 3e-3 * np.abs(theirs[j]).max()
    i = a.names.index("drive_1")
    of_both = (("My", a.loads), ("My_2", a.second)) if clock_ratio == 1.0 else ()
    for channel, loads in of_both:  # of two clocks not separable in so short a record
        assert loads is not None
        table = mv.find_lines(found.state, channel)
        assert table["drive_1"].amplitude == pytest.approx(abs(loads[i, 4]), rel=5e-3)
    x, f = long.motion["My_2"], a.frequency[a.names.index(names[-2])]
    tone = 2.0 * np.mean(
        np.hanning(x.size) / 0.5 * x * np.exp(-2j * np.pi * f * np.arange(x.size) / 1024.0)
    )
    assert a.second is not None
    assert tone == pytest.approx(a.second[a.names.index(names[-2]), 4], rel=0.02)


def test_both_methods_agree() -> None:
    scenario = both(
        whole.FullCraft(),
        {"drive": "driven", "stagger": 0.3},
        **{"record.settle": 0.0, "record.duration": 0.5},
    )
    other = scenario.driven_wing
    assert other is not None
    motions = [
        mv.simulate(scenario),
        replace(rodas4.simulate(scenario), second_wing=rodas4.simulate(other)),
    ]
    for name in ("T_d", "My", "My_2", "Fx", "los_x"):
        a, b = (motion[name] for motion in motions)
        assert np.sqrt(np.mean((a - b) ** 2)) < 2e-3 * np.sqrt(np.mean(b**2))


def test_each_channel_of_the_craft_is_its_own_row() -> None:
    scenario = both(
        whole.FullCraft(), {"drive": "driven"}, **{"record.settle": 0.0, "record.duration": 0.1}
    )
    motion, craft = mv.simulate(scenario).alone, scenario.craft
    assert craft is not None
    for names, rows in {
        COMPONENTS: craft.loads(),
        tuple(SECOND_LOADS): craft.second_loads(),
        ("los_x", "los_y"): craft.line_of_sight(),
        ("los_ax", "los_ay"): craft.line_of_sight(accelerations=True),
    }.items():
        expected = evaluate_outputs(rows, motion.channels, scenario, motion.time)
        off_by = np.abs(np.column_stack([motion[name] for name in names]) - expected)
        assert np.all(off_by.max(axis=0) <= 1e-12 * np.abs(expected).max(axis=0))
        assert len(np.unique(np.abs(expected).max(axis=0))) == len(names)


def test_one_wing_is_as_before() -> None:
    scenario = scenario_of(whole.FullCraft())
    assert scenario.mounted is scenario.spacecraft
    assert scenario.other_wing is None
    assert scenario.driven_wing is None
    assert scenario.alone is scenario
    assert "second" not in mv.dump_scenario(scenario)
    assert (
        "Fx_2"
        not in mv.simulate(scenario.with_si({"record.duration": 0.05}))._ipython_key_completions_()
    )
    with pytest.raises(mv.ChannelError, match="no spacecraft with a second_wing"):
        _ = mv.simulate(scenario.with_si({"record.duration": 0.05}))["Fx_2"]


def test_what_the_second_takes_over_and_what_is_its_own() -> None:
    noise = {"friction.torque_noise": {"density": 1e-8, "highest": 100.0, "seed": 5}}
    scenario = both(
        whole.FullCraft(), {"drive": "driven", "clock_ratio": 1.01, "stagger": 32.0}, **noise
    )
    other = scenario.with_si({"tracking.clock_ratio": 0.99}).driven_wing
    assert other is not None
    assert other.spacecraft is not None
    assert other.motor == scenario.motor
    assert other.tracking.clock_ratio == pytest.approx(0.99 * 1.01)
    assert other.driver.delay == pytest.approx(32.0 / other.driving_frequency)  # type: ignore[operator]
    assert other.spacecraft.array_angle == -whole.FullCraft().angle
    assert other.friction.torque_noise is not None
    assert other.friction.torque_noise.seed != 5
    stiffer = scenario.with_si({"reducer.stiffness": 9000.0}).driven_wing
    assert stiffer is not None
    assert stiffer.reducer.stiffness == 9000.0
    ours, theirs = (sorted(m.frequency for m in coupled_modes(one)) for one in (scenario, other))
    assert len(ours) == len(theirs)


WRONG = {
    "place": ({"interface": {"position": [0.0, 0.0, 0.0], "drive_axis": [0.0, -1.0, 0.0]}}, "second_wing.interface.reference: missing"),
    "axis": ({"interface": {**SECOND["interface"], "drive_axis": [1.0, 0.0, 0.0], "reference": [0.0, 1.0, 0.0]}}, "second_wing.interface.drive_axis: is perpendicular"),
    "drive": ({"drive": "free"}, "second_wing.drive: 'free' is not allowed"),
    "clock": ({"drive": "driven", "clock_ratio": 0.0}, "second_wing.clock_ratio: 0.0 is not allowed"),
    "stagger": ({"drive": "driven", "stagger": -0.5}, "second_wing.stagger: -0.5 is not allowed"),
    "late": ({"drive": "driven", "stagger": 64.0}, "second_wing.stagger: 64 microsteps take 1.2 s, and record.settle is 1 s"),
    "rest": ({"drive": "driven", "stagger": 0.5, "tracking": {"rate": 0.0}}, "second_wing.stagger: 0.5 microsteps are no fixed delay"),
    "array": ({"array": {"inertia": 8.18, "rigid_inertia": 0.13, "modes": [{"frequency": 1.19, "damping": 0.01}]}}, "spacecraft.second_wing: array: has no interface_participation"),
    "voltage": ({"driver": {"beats": 4, "microsteps": 16, "drive": "voltage"}}, "driver.drive: voltage"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_a_second_wing_is_one_sentence(case: str) -> None:
    wing, says = WRONG[case]
    with pytest.raises(mv.ScenarioError) as caught:
        both(whole.FullCraft(), wing)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def quick(**wing: Any) -> Scenario:
    """Both wings in their steady states, with short records."""
    return both(
        whole.FullCraft(),
        {"drive": "driven", **wing},
        **{"record.start": "steady", "record.duration": 1.2},
    )


@pytest.mark.release
def test_files_of_a_run_and_the_way_back(tmp_path: Path) -> None:
    out, scenario = tmp_path / "run", quick(stagger=0.25)
    result, _, files = run_to_folder(scenario, out)
    assert result.second is not None
    assert result.second.accuracy is not None
    assert result.second.accuracy != result.accuracy
    assert f"Integration of wing_2: {result.second.accuracy}\n" in run_text(result)
    assert "Invariants of wing_2: all hold; momentum within" in run_text(result)
    assert {"motion_wing_2.nc", "lines_wing_2.csv", "loads_wing_2.csv"} <= set(files)
    assert result.state is not None
    loads = {
        row["line"]: row
        for row in csv.DictReader((out / "loads_wing_2.csv").read_text().splitlines())
    }
    lines = hub_lines(result.state, result.table)
    assert lines.second is not None
    found = abs(lines.second[lines.names.index("drive_1"), 4])
    assert float(loads["drive_1"]["my_n_m"]) == pytest.approx(found, rel=1e-6)
    own = {
        row["line"]: row
        for row in csv.DictReader((out / "lines_wing_2.csv").read_text().splitlines())
    }
    assert float(own["drive_1"]["amplitude_n_m"]) == pytest.approx(found, rel=0.01)
    kept = mv.read_run(out)
    again = kept.motion
    limit = mv.Limit("60 mN*m", "0.5 Hz", "150 Hz")
    as_kept = RunResult.of_motion(again, kept.table, kept.second_table).judge(limit)
    assert as_kept.verdict == result.judge(limit).verdict == "pass"
    worst, of_run = as_kept.worst, result.judge(limit).worst
    assert worst
    assert of_run
    assert worst.line.name == of_run.line.name
    assert worst.factor == pytest.approx(of_run.factor, rel=1e-8)
    assert result.motion is not None
    assert again.second_wing is not None
    assert again.second_wing.invariants == result.second.invariants != again.invariants
    told = lines_of_second(again, result.table)
    assert told is not None
    assert told.own_error == result.second.table.own_error == result.second.accuracy.relative_error
    for name in ("T_d", "My", "My_2", "los_x"):
        assert again[name] == pytest.approx(result.motion[name], abs=1e-12)
    report = (out / "report.html").read_text()
    assert "second wing with the first, driven, 0.25 microsteps after the first" in report
    assert "At the second wing" in report
    assert "All invariants of wing_2 hold" in report
    texts = [text.get_text() for text in draw_craft(scenario).axes[0].texts]
    assert {"ψ₁ = 30°", "ψ₂ = −30°"} <= set(texts)
    said = derived(scenario)
    assert any("rate of its shaft -0.06 deg/s" in text for text in said)
    assert any(
        "first shaft locked second drive 100 %" in text or "second drive 9" in text for text in said
    )
    assert any("first array" in text and "second array" in text for text in said)
    held = out.parent / "held"
    *_, files = run_to_folder(quick().alone, held, lines_only=True)
    assert {name for name in files if "wing_2" in name} == {"loads_wing_2.csv"}


def test_another_drive_from_a_file(tmp_path: Path) -> None:
    """Two scenarios that name each other; the second brings drive and array, and a group that is given goes before it."""
    first, second = (
        {**parse_yaml(mv.dump_scenario(scenario_of(whole.FullCraft(ratio=ratio))), "x")}
        for ratio in (100.0, 160.0)
    )
    for mine, other in ((first, "second.yaml"), (second, "first.yaml")):
        place = {**SECOND["interface"], "position": ["0.35 m", "-0.9 m", "-0.2 m"]}
        mine["spacecraft"]["second_wing"] = {"scenario": other, "interface": place}
    first["spacecraft"]["second_wing"]["friction"] = {
        **first["friction"],
        "viscous": "0.07 N*m*s/rad",
    }
    for name, data in (("first", first), ("second", second)):
        (tmp_path / f"{name}.yaml").write_text(json.dumps(data))
    loaded = mv.load_scenario(tmp_path / "first.yaml")
    other = loaded.other_wing
    assert other is not None
    assert (loaded.reducer.ratio, other.reducer.ratio, other.friction.viscous) == (
        100.0,
        160.0,
        0.07,
    )
    assert loaded.source_of("spacecraft.second_wing.reducer.ratio") == "second.yaml"
    (tmp_path / "again.yaml").write_text(mv.dump_scenario(loaded))
    assert mv.load_scenario(tmp_path / "again.yaml") == loaded
    (tmp_path / "first.yaml").write_text(
        json.dumps(
            {**first, "spacecraft": {**first["spacecraft"], "second_wing": {"scenario": "x.yaml"}}}
        )
    )
    with pytest.raises(mv.ScenarioError, match=r"x\.yaml: there is no such file"):
        mv.load_scenario(tmp_path / "first.yaml")


@pytest.mark.parametrize("clock_ratio", sweep([1.0, 1.01], 1.0))
def test_a_budget_takes_both_wings_one_by_one(clock_ratio: float) -> None:
    """Lines of one clock with their phases: its sums are those of the run."""
    scenario = quick(stagger=0.25, clock_ratio=clock_ratio)
    budget = mv.pointing_budget(
        scenario, Requirements(requirements=(Requirement(metric="ape", limit="1 urad"),))
    )  # type: ignore[call-arg]
    assert [one.source for one in budget.contributions] == ["drive 1", "drive 1 wing_2"]
    assert len({one.clock for one in budget.contributions}) == (1 if clock_ratio == 1.0 else 2)
    found = steady_lines(scenario)
    assert found.state is not None
    sums = {
        (row["metric"], row["window_s"]): row["radial_rad"]
        for row in hub_lines(found.state, found.lines).totals()
    }
    for window in budget.windows:
        assert window.lines[2] == pytest.approx(sums[window.metric, window.window], rel=1e-6)


@pytest.mark.release
@pytest.mark.parametrize("clock_ratio", [1.0, 1.01])
def test_a_budget_takes_a_campaign_of_both_wings(tmp_path: Path, clock_ratio: float) -> None:
    """Cases that do not differ are the nominal one."""
    scenario = quick(
        stagger=0.25, clock_ratio=clock_ratio, friction=scenario_of(whole.FullCraft()).friction
    )
    (tmp_path / "craft.yaml").write_text(mv.dump_scenario(scenario))
    (tmp_path / "study.yaml").write_text(
        "scenario: craft.yaml\nvary: {motor.detent_torque: {distribution: uniform, within: 1e-6 percent}}\n"
        "sampling: {method: random, count: 2}\n"
    )
    campaign = create(read_design(tmp_path / "study.yaml"), tmp_path / "c")
    campaign.write(0, compute_bytes(campaign.work(0)))
    merge(campaign)
    required = Requirements(requirements=(Requirement(metric="ape", limit="1 urad"),))  # type: ignore[call-arg]
    apart, joined = (
        mv.pointing_budget(scenario, required),
        mv.pointing_budget(scenario, required, campaign=tmp_path / "c"),
    )
    (one,) = joined.contributions
    assert (one.how, one.cases_lack) == ("steady state of the coupled run, both wings", "")
    assert one.cases is not None
    for case in one.cases:
        assert case == pytest.approx(np.abs(one.los), rel=1e-6, abs=1e-9 * np.abs(one.los).max())
    for name in ("value", "least", "most"):
        assert getattr(joined.judged[0], name) == pytest.approx(
            getattr(apart.judged[0], name), rel=1e-9
        )


def test_cases_of_a_campaign_keep_lines_of_both_clocks(tmp_path: Path) -> None:
    (tmp_path / "craft.yaml").write_text(mv.dump_scenario(quick(clock_ratio=1.01)))
    (tmp_path / "study.yaml").write_text(
        "scenario: craft.yaml\nvary: {motor.detent_torque: {distribution: uniform, within: 30 percent}}\n"
        "sampling: {method: random, count: 1}\n"
    )
    campaign = create(read_design(tmp_path / "study.yaml"), tmp_path / "c")
    chunk = Chunk.from_bytes(compute_bytes(campaign.work(0)))
    case = steady_lines(campaign.design.scenario(0))
    assert case.state is not None
    own = hub_lines(case.state, case.lines)
    for name in ("drive_1", "wing_2 drive_1"):
        found = [chunk.figures[key][0, chunk.lines.index(name)] for key in ("los_x", "los_y")]
        assert found == pytest.approx(own.amplitude[own.names.index(name)], rel=1e-6)


def test_a_limit_is_passed_only_if_both_drives_are_within() -> None:
    """The second has more current and a larger line; a verdict on the first alone would pass."""
    wings = quick().with_si(
        {"spacecraft.second_wing.motor": {**quick().motor.model_dump(), "current": 1.2}}
    )
    result = mv.run_scenario(wings.with_({"record.start": "steady"}))
    assert result.second is not None
    own, other = (table["drive_1"].amplitude for table in (result.table, result.second.table))
    assert other > 1.05 * own
    between = mv.Limit(Si(0.5 * (own + other)))
    judged = mv.judge(result.table, between, result.scenario, result.second.table)
    assert judged.verdict == "fail"
    assert judged.margins[0].line.name == "wing_2 drive_1"
    assert "FAIL" in run_text(result, between)
    alone = mv.judge(result.table, between, result.scenario)
    assert alone.verdict == "not judged"
    told = "the second wing's drive, whose lines are not here (leave --lines-only out)"
    assert told in alone.gaps


def test_a_report_judges_the_second_drive_by_the_lines_of_its_run(tmp_path: Path) -> None:
    result = mv.run_scenario(quick(), harmonics=3)
    assert result.second is not None
    limit = mv.Limit(Si(0.01 * result.table["drive_1"].amplitude))
    judged = mv.judge(result.table, limit, result.scenario, result.second.table)
    assert judged.verdict == "fail"
    mv.write_run(result, tmp_path / "run", limit=limit)
    assert (
        f"FAIL: {judged.above} of {len(judged.margins)} lines"
        in (tmp_path / "run" / "report.html").read_text()
    )


@pytest.mark.parametrize("steady", ["", "solve: steady"])
def test_a_campaign_of_the_torque_alone_is_judged_by_both_drives(
    tmp_path: Path, steady: str
) -> None:
    """Without a line of sight, a limit between the first drive's largest line and the second's, which has more current."""
    wings = quick().with_si(
        {"spacecraft.second_wing.motor": {**quick().motor.model_dump(), "current": 1.2}}
    )
    blind = wings.with_(
        {"spacecraft.line_of_sight": None, "record.start": "rest", "record.settle": "0.5 s"}
    )
    (tmp_path / "craft.yaml").write_text(mv.dump_scenario(blind))
    limits = [
        mv.find_lines(one, start="steady")["drive_1"].amplitude
        for one in (blind, blind.driven_wing)
        if one is not None
    ]
    (tmp_path / "study.yaml").write_text(
        "scenario: craft.yaml\nvary: {motor.detent_torque: {distribution: uniform, within: 1 percent}}\n"
        f"sampling: {{method: random, count: 1}}\nlimit: {0.5 * sum(limits)} N*m\nband: 50 Hz:60 Hz\n{steady}\n"
    )
    campaign = create(read_design(tmp_path / "study.yaml"), tmp_path / "c")
    chunk = Chunk.from_bytes(compute_bytes(campaign.work(0)))
    assert [VERDICTS[k] for k in chunk.verdict] == ["fail"]


def test_over_an_orbit_a_held_wing_turns_with_the_first() -> None:
    scenario = quick().alone
    turned = scenario.at_angle("1 rad").other_wing
    assert turned is not None
    assert turned.spacecraft is not None
    assert turned.spacecraft.array_angle == -1.0


@pytest.mark.parametrize("wing", [{"stagger": 0.3}, {"array_angle": 3.5, "clock_ratio": 1.03}])
def test_over_an_orbit_both_drives_step(
    wing: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the runs lines of both, at both interfaces' angles, are those of a run there."""
    monkeypatch.setattr("microvib.studies.orbit._MIN_ANGLES", 31)
    scenario = quick(**wing)
    orbit = analyse_orbit(scenario, angles_in("30:60:30"))
    assert not orbit.notes()
    (there,) = sweep_angles(scenario, [Si(math.radians(40.0))]).lines
    mounted = there.scenario.mounted
    assert mounted is not None
    assert mounted.second_wing is not None
    turned = wing.get("array_angle", -math.radians(30.0)) - wing.get(
        "clock_ratio", 1.0
    ) * math.radians(10.0)
    assert mounted.second_wing.array_angle == pytest.approx(turned)
    size = [float(radial_rms(there.sums(metric, 0.01).sum(axis=0))) for metric in ("ape", "rpe")]
    found = [
        np.interp(math.radians(40.0), orbit.sweep.angles, orbit.size(m, 0.01))
        for m in ("ape", "rpe")
    ]
    assert found == pytest.approx(size, rel=1e-3)
    k, name = int(np.argmin(abs(orbit.sweep.angles - math.radians(40.0)))), "drive_1"
    loads = orbit.sweep.lines[k].loads[orbit.sweep.lines[k].names.index(name)]
    assert loads == pytest.approx(
        there.loads[there.names.index(name)], rel=0.02, abs=1e-3 * np.abs(loads).max()
    )


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"tracking.rate": 0.0}, "tracking"),
        ({"spacecraft.second_wing.tracking": {"rate": 0.0}}, "spacecraft.second_wing"),
    ],
)
def test_an_orbit_needs_both_rates(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(mv.MicrovibError, match=f"^{key}.*a constant rate"):
        check_orbit(quick().with_si(changes))


@pytest.mark.parametrize("linear", [True, False])
def test_a_rate_plan_judges_both_drives(linear: bool) -> None:
    """A second drive with half the microsteps has larger lines: a limit between the two allows no rate by the first's lines alone."""
    one = both(wing={"drive": "driven"})
    microsteps = one.driver.microsteps
    coarse = {**one.driver.model_dump(), "microsteps": microsteps // 4}
    craft = both(wing={"drive": "driven", "driver": coarse})
    rate = craft.rate
    assert rate is not None
    solve = linear_case if linear else full_case
    case, alone = (solve(x, Si(rate), microsteps) for x in (craft, craft.alone))
    assert not case.failed
    sizes = {x.name: x.amplitude for x in case.lines}
    second = max(x for name, x in sizes.items() if name.startswith("wing_2 "))
    first = max(x.amplitude for x in alone.lines)
    own = max(x for name, x in sizes.items() if not name.startswith("wing_2 "))
    assert own == pytest.approx(first, rel=1e-9)
    other = craft.driven_wing
    assert other is not None
    expected = solve(other.alone, Si(other.rate or 0.0), other.driver.microsteps)
    assert second == pytest.approx(max(x.amplitude for x in expected.lines), rel=1e-6)
    assert second > 1.3 * first
    assert case.verdict((0.0, math.inf), math.sqrt(first * second)) == ABOVE_LIMIT


@pytest.mark.parametrize("geared", [False, True])
def test_a_rate_plan_keeps_away_from_resonances_of_both_drives(geared: bool) -> None:
    """The second drive's lines, of half the microsteps or behind a gear of its own, meet the craft's modes at rates of their own. Without detent torque no parametric resonances are looked for, which takes most of the time."""
    smooth = {"motor.detent_torque": "0 N*m"}
    one = both(wing={"drive": "driven"}, **smooth)
    coarse = {**one.driver.model_dump(), "microsteps": one.driver.microsteps // 2}
    own: dict[str, Any] = {"driver": coarse}
    if geared:
        own = {"clock_ratio": 1.37}
    craft = both(wing={"drive": "driven", **own}, **smooth)
    other = craft.driven_wing
    assert other is not None
    rate = craft.rate
    assert rate is not None
    speed = (other.driving_frequency or math.nan) / rate
    modes = [m for m in coupled_modes(craft) if m.damping < 0.2 or m.fixed_frequency is not None]
    grid = [Si(x) for x in np.linspace(0.5 * rate, 2.0 * rate, 7)]
    plan = mv.plan_rates(craft, grid, linear=True, keep_away=0.02)
    named = {m.name: m.frequency for m in modes}
    met = [r for r in plan.resonances if r.line.startswith("wing_2 ")]
    assert met
    assert {r.mode for r in met} <= set(named)
    for r in met:
        order = int(r.line.rpartition("_")[2])
        assert r.rate * order * speed == pytest.approx(named[r.mode], rel=0.1)
        assert any(b.low < r.rate < b.high and r.line in b.why for b in plan.forbidden)
    own_lines = [r for r in plan.resonances if not r.line.startswith("wing_2 ")]
    alone = mv.plan_rates(craft.alone, grid, linear=True, keep_away=0.02)
    assert {(r.line, r.mode) for r in own_lines} <= {(r.line, r.mode) for r in alone.resonances}
    strongest = max(met, key=lambda r: r.amplitude)
    there = mv.plan_rates(craft, [Si(1.005 * strongest.rate)], linear=True, keep_away=0.02)
    assert not any(there.is_allowed(case) for case in there.cases)
    for bystander in (0.0, 2.0 * rate):  # one that holds, and one of a rate of its own
        held = both(wing={"drive": "driven", **own, "tracking": {"rate": bystander}}, **smooth)
        still = mv.plan_rates(held, grid, linear=True)
        assert not [r for r in still.resonances if r.line.startswith("wing_2 ")]


def test_lines_of_two_clocks_are_not_added_with_phases_however_near_they_are() -> None:
    """A second clock a millionth off the first drifts through all phases: lines of both add as mean squares, in a run and in the one source of a campaign."""
    from microvib.studies.budget.study import both_wings
    from microvib.studies.budget.sums import assess

    def hub_of(ratio: float) -> Any:
        state = mv.steady_state(quick(stagger=0.5, clock_ratio=ratio))
        return hub_lines(state, mv.find_lines(state))

    near, one = hub_of(1.0 + 4e-7), hub_of(1.0)
    assert "wing_2 drive_1" not in one.names
    for name in ("drive_1", "drive_2", "full_step_1"):
        assert f"wing_2 {name}" in near.names
        each = [drive.los[drive.names.index(name)] for drive in near.drives]
        listed = [near.los[near.names.index(x)] for x in (name, f"wing_2 {name}")]
        assert np.array(listed) == pytest.approx(np.array(each))
        assert one.los[one.names.index(name)] == pytest.approx(np.sum(each, axis=0), rel=0.02)
    scenario = quick(stagger=0.5, clock_ratio=1.0 + 4e-7)
    first, second = mv.pointing_budget(scenario).contributions
    tables = hub_of(1.0 + 4e-7).drives
    whole_craft = both_wings(scenario, first, second, *tables)
    asked = Requirement(metric="ape", limit="1 urad", highest="1.5 Hz", lowest="0.5 Hz")
    f = first.frequency[first.names.index("drive_1")]
    asked = asked.model_copy(update={"lowest": 0.999 * f, "highest": 1.001 * f})
    apart, together = assess(asked, [first, second], "rss"), assess(asked, [whole_craft], "rss")
    assert together.value == pytest.approx(apart.value, rel=1e-6)
    assert together.least <= apart.least * (1.0 + 1e-9)
    assert together.most >= apart.most * (1.0 - 1e-9)
