"""A drive on a craft: against the whole system in untransformed coordinates, limits, momentum, and what is refused."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.linalg import eigh
from support import craft as whole
from support import rodas4
from support.craft_scenarios import (
    BENDING,
    DAMPED,
    FLEXIBLE,
    OBLIQUE,
    PAYLOAD,
    TIMES,
    UNDAMPED,
    instants,
    off,
    scenario_of,
    seen,
    six,
)
from support.tiers import sweep

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.lines import steady_lines
from microvib.cli.main import main
from microvib.io.yaml_text import parse_yaml
from microvib.model.line_names import LineName
from microvib.model.linear import coupled_modes
from microvib.signals.pointing import metric_weight
from microvib.solve import kernel
from microvib.solve.batch import simulate_torques
from microvib.solve.command import Command
from microvib.solve.integration import simulate_from_rest
from microvib.solve.pack import pack
from microvib.solve.sampling import empty_sample_buffer
from microvib.units import Si


@pytest.fixture(scope="module")
def undamped() -> np.ndarray:
    return UNDAMPED.run(TIMES)


@pytest.mark.parametrize(("packed_for", "within"), [(pack, 2e-6), (rodas4.packed_for_rodas4, 1e-4)])
def test_loads_and_motions_are_those_of_the_whole_system(
    undamped: np.ndarray, packed_for: Any, within: float
) -> None:
    scenario = scenario_of(UNDAMPED)
    craft = scenario.craft
    assert craft is not None
    found = instants(scenario, TIMES, packed_for(scenario))
    n_q = UNDAMPED.n_q
    for outputs, wanted in (
        (craft.loads(), [UNDAMPED.hub_loads(y) for y in undamped]),
        (craft.motion("interface"), [UNDAMPED.root @ y[:n_q] for y in undamped]),
        (craft.motion("center"), [y[:6] for y in undamped]),
        (craft.acceleration("center"), [UNDAMPED.accelerations(y)[:6] for y in undamped]),
    ):
        assert off(seen(scenario, outputs, found), np.array(wanted)) < within
    assert (
        off(np.array([row[2][:2] for row in found]), undamped[:, [UNDAMPED.n - 2, UNDAMPED.n - 1]])
        < within
    )


def test_a_flexible_controlled_hub_is_as_the_whole_system() -> None:
    still = replace(FLEXIBLE, control_damping=1e-9, damping=0.0 * whole.DAMPING)
    scenario, states, n_q = scenario_of(still), still.run(TIMES), still.n_q
    craft, found = scenario.craft, instants(scenario, TIMES)
    assert craft is not None
    at_payload = np.zeros((6, n_q))
    at_payload[:3, :3] = at_payload[3:, 3:6] = np.eye(3)
    at_payload[:3, 3:6] = -whole.cross_matrix(np.array([0.1, -0.2, 0.6]))
    at_payload[:, 6:] = PAYLOAD[:, None]
    for rows, by in (
        (craft.motion("interface"), still.root),
        (craft.motion("payload"), at_payload),
        (craft.line_of_sight(), at_payload[3:5]),
    ):
        assert off(seen(scenario, rows, found), np.array([by @ y[:n_q] for y in states])) < 1e-4


@pytest.mark.parametrize("full", [whole.FullCraft(bandwidth=0.3), FLEXIBLE, OBLIQUE])
def test_lines_of_the_clock_take_the_whole_damping_matrix(full: whole.FullCraft) -> None:
    """Responses to accelerations of both shafts, from the whole matrices, where modes are damped hard and unalike."""
    craft, n = scenario_of(full).craft, full.n - 2
    assert craft is not None
    for f in (0.45, 1.19, 3.33, 53.3):
        s = 2j * math.pi * f
        dynamic = s**2 * full.M[:n, :n] + s * full.C[:n, :n] + full.K[:n, :n]
        x = -np.linalg.solve(dynamic, full.M[:n, n:])
        assert craft.transfer(craft.motion("interface"), np.array([f]))[0] == pytest.approx(
            full.root @ x[: full.n_q], rel=1e-8
        )
        if not full.flexible:
            on_centre = (s**2 * full.hub_M + s * full.C + full.K)[:6, :6] @ x[:6]
            moment = on_centre[3:] - np.cross(whole.PLACE, on_centre[:3], axisb=0, axisc=0)
            loads = craft.transfer(craft.loads(), np.array([f]))[0]
            assert loads == pytest.approx(np.vstack([on_centre[:3], moment]), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("case", sweep(DAMPED, "all", "critical"))
def test_lines_where_damping_couples_the_modes_are_those_of_the_whole_system(case: str) -> None:
    """Loads, motions and shafts at instants over a full step, and their lines in it: of the drive and of full steps."""
    full = DAMPED[case]
    scenario, period = scenario_of(full), 2.0 * math.pi / 200.0 / (full.ratio * full.rate)
    times = period * (0.4 + np.arange(96) / 96.0)
    states, found, craft, n_q = full.run(times), instants(scenario, times), scenario.craft, full.n_q
    assert craft is not None
    pairs = [
        (craft.motion("interface"), [full.root @ y[:n_q] for y in states]),
        (
            craft.acceleration("interface"),
            [full.root @ full.accelerations(y)[:n_q] for y in states],
        ),
    ]
    if not full.flexible:
        pairs += [(craft.loads(), [full.hub_loads(y) for y in states])]
    both = [(seen(scenario, rows, found), np.array(wanted)) for rows, wanted in pairs]
    both += [(np.array([row[2][:2] for row in found]), states[:, [full.n - 2, full.n - 1]])]
    for ours, theirs in both:
        assert off(ours, theirs) < 1e-5
        lines, wanted = (
            np.abs(np.fft.rfft(x * np.hanning(96)[:, None], axis=0))[[4, 16, 32]]
            for x in (ours, theirs)
        )
        assert np.all(np.abs(lines - wanted) < 1e-3 * wanted + 1e-9 * wanted.max(axis=0))


@pytest.mark.parametrize("full", [UNDAMPED, FLEXIBLE])
def test_modes_with_locked_hinges(full: whole.FullCraft) -> None:
    n = full.n - 2
    squares = eigh(full.K[:n, :n], full.M[:n, :n], eigvals_only=True)
    craft = scenario_of(full).craft
    assert craft is not None
    free = n - craft.frequency.size
    assert free == (3 if full.bandwidth else 6)
    assert np.abs(squares[:free]).max() < 1e-9
    assert craft.frequency == pytest.approx(np.sqrt(squares[free:]) / (2.0 * math.pi), rel=1e-9)


@pytest.mark.parametrize("damping", [whole.DAMPING, np.full(4, 0.3)], ids=["light", "heavy"])
def test_momentum_of_a_free_craft_that_sticks_and_slips_is_conserved(damping: np.ndarray) -> None:
    friction = {
        "friction.coulomb": 0.02,
        "friction.breakaway": 0.4,
        "motor.friction.coulomb": 2e-4,
        "motor.friction.breakaway": 5e-4,
    }
    full = whole.FullCraft(damping=damping)
    scenario = scenario_of(full, **friction)
    craft = scenario.craft
    assert craft is not None
    packed = pack(scenario)
    packed.advance(
        0.5,
        empty_sample_buffer(packed.channels)._replace(width=0.0),
        *Command(scenario).microsteps(0.0, 0.5),
    )
    assert packed.state.counters[kernel.STICKS] > 3
    eta, rate, shafts = instants(scenario, np.array([0.5]))[0]
    y = craft.modes
    of_modes = y.p @ rate - y.q @ (y.d * rate + y.k * eta + y.g @ shafts[4:])
    hub_and_modes = (
        craft.shapes @ of_modes + craft.by_output * shafts[4] + craft.by_rotor * shafts[5]
    )
    rates = np.concatenate([hub_and_modes, shafts[4:]])
    left, exchanged = full.M[:6] @ rates, np.abs(full.M[:6] * rates).max(axis=1)
    assert np.abs(left / exchanged).max() < 1e-12


@pytest.mark.parametrize("full", [whole.FullCraft(), DAMPED["critical"], DAMPED["hub"]])
def test_invariants_on_a_craft_with_friction(full: whole.FullCraft) -> None:
    scenario = scenario_of(full, **{"friction.coulomb": 0.02, "friction.breakaway": 0.05})
    motion = mv.simulate(scenario)
    assert motion.invariants.torque_forms < 1e-9
    assert motion.invariants.energy_mechanical < 1e-3
    assert motion.invariants.momentum < 1e-5


@pytest.mark.parametrize(
    ("rigid", "damped"), [(False, False), (True, False), (False, True), (True, True)]
)
def test_both_methods_agree_where_bodies_stick(rigid: bool, damped: bool) -> None:
    changes: dict[str, Any] = {
        "friction.coulomb": 0.02, "friction.breakaway": 0.3, "motor.friction.coulomb": 2e-4, "motor.friction.breakaway": 5e-4,
    }  # fmt: skip
    changes |= (
        {"reducer.stiffness": "rigid", "friction.coulomb": 1.0, "friction.breakaway": 3.0}
        if rigid
        else {}
    )
    changes |= (
        {"reducer.transmission_error": [{"order": 2, "amplitude": 1e-4, "phase": 0.3}]}
        if rigid
        else {}
    )
    light = whole.FullCraft(
        hub_scale=0.1, rotor_inertia=2e-3
    )  # so that both shafts feel each other through the hub
    if damped:
        light = replace(light, bandwidth=0.3, control_damping=1.5, damping=np.full(4, 0.3))
        changes |= {"friction.coulomb": 2.0, "friction.breakaway": 8.0} if rigid else {}
    scenario = scenario_of(light, **changes, **{"record.settle": 0.0, "record.duration": 0.5})
    motions = [mv.simulate(scenario), rodas4.simulate(scenario)]
    assert motions[0].solver["sticks"] > 0
    for name in ("T_d", "My", "Fx", "los_x"):
        a, b = (motion[name] for motion in motions)
        assert np.sqrt(np.mean((a - b) ** 2)) < 2e-3 * np.sqrt(np.mean(b**2))


def test_a_heavy_hub_is_firm_ground() -> None:
    heavy = scenario_of(whole.FullCraft(hub_scale=1e9))
    ground = heavy.with_({"spacecraft": None})
    torques = [torque.T_d for torque in simulate_torques([heavy, ground])]
    assert np.abs(torques[0] - torques[1]).max() < 1e-6 * np.abs(torques[1]).max()


def test_about_one_axis_a_rigid_hub_in_closed_form() -> None:
    """One mode about the drive axis through the hub's centre of mass: f^2 = f_1^2 / (1 - H^2 / (J + J_flex + J_m + J_hub))."""
    J, J_hub, J_flex, J_m, H, f = 12.0, 40.0, 0.01, 0.252e-4, 3.3, 1.19
    scenario = scenario_of(whole.FullCraft()).with_si(
        {
            "array": {
                "inertia": J,
                "modes": [
                    {"frequency": f, "damping": 0.01, "interface_participation": [0, 0, 0, 0, 0, H]}
                ],
                "rigid_body": {
                    "mass": 30.0,
                    "center_of_mass": [0.0, 0.0, 2.0],
                    "inertia": [140.0, 140.0, J, 0.0, 0.0, 0.0],
                },
            },
            "spacecraft.hub": {"mass": 400.0, "inertia": [30.0, J_hub, 30.0, 0.0, 0.0, 0.0]},
            "spacecraft.interface.position": [0.0, 0.8, 0.0],
            "spacecraft.line_of_sight.boresight": [1.0, 0.0, 0.0],
        }
    )
    craft = scenario.craft
    assert craft is not None
    assert craft.frequency == pytest.approx(
        [f / math.sqrt(1.0 - H**2 / (J + J_flex + J_m + J_hub))]
    )
    motion = mv.simulate(scenario)
    assert motion["My"] == pytest.approx(motion["T_d"], abs=1e-9)
    # The torque on the hub turns the hub: los_x is its rotation about hub y, for a boresight along x.
    assert motion["los_ax"] == pytest.approx(motion["T_d"] / J_hub, abs=1e-12)
    assert np.abs(motion.hub("center", accelerations=True)[:, [0, 1, 2, 3, 5]]).max() < 1e-12


def test_lines_of_angles_are_those_of_the_angles_themselves() -> None:
    scenario = scenario_of(whole.FullCraft(), **{"record.duration": 6.0, "record.settle": 2.0})
    result = mv.run_scenario(scenario)
    assert result.motion is not None
    found = hub_lines(result.motion, result.table)
    k = found.names.index("drive_1")
    assert found.los is not None
    assert np.abs(found.loads[k, 4]) == pytest.approx(result.table["drive_1"].amplitude, rel=1e-6)
    x, f = result.motion["los_x"], float(found.frequency[k])
    t = np.arange(x.size) / scenario.record.sample_rate
    window = np.hanning(x.size) * np.exp(-2j * np.pi * f * t)
    assert 2.0 * np.sum(window * (x - x.mean())) / np.hanning(x.size).sum() == pytest.approx(
        found.los[k, 0], rel=1e-3
    )
    rms = found.mean_squares("rpe", 0.01)[k]
    assert rms == pytest.approx(metric_weight("rpe", f, 0.01) * 0.5 * np.abs(found.los[k]) ** 2)
    header, rows = found.pointing_table()
    assert rows[k][header.index("rpe_10ms_x_rad")] == pytest.approx(math.sqrt(rms[0]))
    summed = found.summary()
    assert len(summed["windows"]) == 2 * 7
    assert summed["cumulative"]["rms_up_los_x_rad"][-1] == pytest.approx(
        summed["cumulative"]["rms_down_los_x_rad"][0]
    )


@pytest.mark.parametrize("control", [0.0, 0.3])
def test_the_steady_state_on_a_craft_is_that_of_a_long_run(control: float) -> None:
    damped = whole.FullCraft(damping=np.full(4, 0.08), bandwidth=control, control_damping=1.5)
    scenario = scenario_of(damped, **{"record.settle": 20.0, "record.duration": 6.0})
    long, steady = mv.run_scenario(scenario), steady_lines(scenario)
    assert steady.state is not None
    assert long.motion is not None
    a, b = hub_lines(long.motion, long.table), hub_lines(steady.state, steady.lines)
    for name in ("drive_1", "drive_2", "full_step_1"):
        i, j = a.names.index(name), b.names.index(name)
        assert np.abs(a.loads[i] - b.loads[j]).max() < 2e-3 * np.abs(b.loads[j]).max()


WRONG = {
    "not positive definite": ({"spacecraft.hub.inertia": [180.0, 150.0, -2.0, 0.0, 0.0, 0.0]}, "spacecraft.hub.inertia: principal"),
    "triangle": ({"spacecraft.hub.inertia": [180.0, 150.0, 410.0, 0.0, 0.0, 0.0]}, "more than the sum of the other two"),
    "control": ({"spacecraft.attitude_control": "off"}, "attitude_control: write none, or bandwidth and damping, such as"),
    "bandwidth": ({"spacecraft.attitude_control": {"bandwidth": 0.0, "damping": 0.7}}, "attitude_control.bandwidth: 0.0 is not allowed"),
    "boresight": ({"spacecraft.line_of_sight.boresight": [0.0, 0.0, 0.0]}, "line_of_sight.boresight"),
    "axis": ({"spacecraft.interface.drive_axis": [0.0, 0.0, 0.0]}, "spacecraft.interface.drive_axis"),
    "reference": ({"spacecraft.interface.reference": [1.0, 1.0, 0.0]}, "not perpendicular"),
    "point": ({"spacecraft.line_of_sight.point": "star"}, "'star' is not a point of the hub; there are interface, center"),
    "six": ({"array": {"inertia": 8.18, "rigid_inertia": 0.13, "modes": [{"frequency": 1.19, "damping": 0.01}]}}, "array: has no interface_participation"),
    "mass": ({"array.rigid_body": None}, "array: has no rigid_body"),
    "D_0": ({"array.rigid_body.mass": 5.0, "array.rigid_body.inertia": [421.0, 430.0, 12.2, 0.0, 0.0, 0.0]}, "D_0 = M_r - P P'"),
    "J": ({"array.rigid_body.inertia": [420.0, 430.0, 13.2, 0.0, 0.0, 0.0]}, "disagrees with inertia"),
}  # fmt: skip


@pytest.mark.parametrize("size", [1e-320, 1e-160, 1e160, 1e300])
def test_directions_of_any_length_are_the_same(size: float) -> None:
    plain = scenario_of(whole.FullCraft())
    told = {"drive_axis": [0.0, size, 0.0], "reference": [size, 0.0, 0.0]}
    scaled = plain.with_si({f"spacecraft.interface.{key}": value for key, value in told.items()})
    scaled = scaled.with_si({"spacecraft.line_of_sight.boresight": [0.0, 0.0, size]})
    a, b = plain.craft, scaled.craft
    assert a is not None
    assert b is not None
    at = np.array([1.0, 53.3])
    assert b.transfer(b.loads(), at) == pytest.approx(
        a.transfer(a.loads(), at), rel=1e-9, abs=1e-12
    )
    assert b.transfer(b.line_of_sight(), at) == pytest.approx(
        a.transfer(a.line_of_sight(), at), rel=1e-9, abs=1e-12
    )


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_a_craft_is_one_sentence(case: str) -> None:
    changes, says = WRONG[case]
    with pytest.raises(mv.ScenarioError) as caught:
        scenario_of(whole.FullCraft(), **changes)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_flexible_hub_needs_shapes_where_the_drive_sits() -> None:
    with pytest.raises(
        mv.ScenarioError, match=r"interface\.position: no point of the hub's modes lies at"
    ):
        scenario_of(FLEXIBLE, **{"spacecraft.interface.position": [0.0, 0.0, 0.0]})
    with pytest.raises(mv.ScenarioError, match="centre of mass of a flexible hub has no shapes"):
        scenario_of(FLEXIBLE, **{"spacecraft.line_of_sight.point": "center"})


def test_the_example_runs(tmp_path: Path) -> None:
    out = tmp_path / "run"
    example = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
    done = CliRunner().invoke(
        main,
        [
            "run",
            str(example),
            "--out",
            str(out),
            "--set",
            "record.settle=1 s",
            "--set",
            "record.duration=4 s",
        ],
    )
    assert done.exit_code == 0, done.output
    lines, loads, pointing = (
        list(csv.DictReader((out / f"{name}.csv").read_text().splitlines()))
        for name in ("lines", "loads", "pointing")
    )
    assert [row["line"] for row in loads] == [row["line"] for row in pointing]
    drive = next(row for row in loads if row["line"] == "drive_1")
    torque = next(row for row in lines if row["line"] == "drive_1")
    assert float(drive["my_n_m"]) == pytest.approx(float(torque["amplitude_n_m"]), rel=1e-4)
    assert float(drive["my_phase_rad"]) == pytest.approx(float(torque["phase_rad"]), abs=1e-5)
    assert {"rpe_10ms_x_rad", "pde_1s_y_rad"} <= set(pointing[0])
    windows = json.loads((out / "summary.json").read_text())["pointing"]["windows"]
    assert len(windows) == 4 * 7
    assert mv.load_scenario(out / "scenario.yaml") == mv.load_scenario(example).with_si(
        {"record.settle": 1.0, "record.duration": 4.0}
    )
    again = mv.read_run(out).motion
    assert again["los_x"] == pytest.approx(mv.simulate(again.scenario)["los_x"], abs=1e-12)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_any_array_axis_may_be_the_drives(axis: str) -> None:
    """The same array told in axes that are renamed cyclically."""
    before = scenario_of(whole.FullCraft())
    moved = {"x": [2, 0, 1], "y": [1, 2, 0]}[axis]  # which old axis each new one is
    turn = np.eye(3)[moved]
    modes = [
        {
            "frequency": f,
            "damping": xi,
            "interface_participation": [*p[:3][moved].tolist(), *p[3:][moved].tolist()],
        }
        for f, xi, p in zip(whole.FREQUENCIES, whole.DAMPING, whole.PARTICIPATION.T, strict=True)
    ]
    array = {
        "inertia": whole.ARRAY_INERTIA[2, 2],
        "drive_axis": axis,
        "modes": modes,
        "rigid_body": {
            "mass": whole.ARRAY_MASS,
            "center_of_mass": whole.ARRAY_CENTER[moved].tolist(),
            "inertia": six(turn @ whole.ARRAY_INERTIA @ turn.T),
        },
    }
    found = []
    for scenario in (before, before.with_si({"array": array})):
        assert scenario.craft is not None
        found.append(scenario.craft.transfer(scenario.craft.loads(), np.array([0.7, 53.3])))
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-12)


def test_an_array_from_finite_elements_brings_its_six_components(tmp_path: Path) -> None:
    path, data = (
        tmp_path / "craft.yaml",
        parse_yaml(mv.dump_scenario(scenario_of(whole.FullCraft())), "craft"),
    )
    path.write_text(json.dumps({**data, "array": {"fem": "reference-array", "modes": 8}}))
    scenario = mv.load_scenario(path)
    array, craft = scenario.array, scenario.craft
    assert array.mass is not None
    assert array.interface is not None
    assert craft is not None
    assert array.interface_inertia == pytest.approx(
        array.mass[:, 3 + "xyz".index(array.drive_axis)], rel=1e-6, abs=1e-6
    )
    still = np.linalg.eigvalsh(array.mass - array.interface @ array.interface.T)
    assert still.min() > -1e-6 * np.trace(array.mass)
    assert craft.frequency.size == 8


@pytest.mark.parametrize(
    ("full", "names"),
    [
        (whole.FullCraft(), ["array"] * 4),
        (whole.FullCraft(bandwidth=0.02), ["control"] * 3 + ["array"] * 4),
        (whole.FullCraft(bandwidth=0.02, control_damping=1.5), ["control"] * 2 + ["array"] * 4),
        (
            whole.FullCraft(bandwidth=2.0),
            ["array", "control", "array", "control", "control", "array", "array"],
        ),
        (
            whole.FullCraft(
                bandwidth=0.02, flexible=[(5.0, 0.01, BENDING), (30.0, 0.01, 2.0 * BENDING)]
            ),
            ["control"] * 3 + ["array"] * 3 + ["hub", "array", "hub"],
        ),
    ],
)
def test_modes_are_named_by_what_holds_their_energy(
    full: whole.FullCraft, names: list[str]
) -> None:
    """Frequencies against the whole matrices with held shafts; an overdamped mode of the control has no name."""
    found = coupled_modes(scenario_of(full))
    assert all(LineName.parse(m.name).is_mode == (m.fixed_frequency is not None) for m in found)
    modes = [m for m in found if m.fixed_frequency is not None]
    kinds = [m.name.split("_mode_")[0] for m in modes]
    assert kinds == names
    for kind in set(kinds):  # each kind is counted by itself
        numbers = [
            int(m.name.rpartition("_")[2])
            for m, own in zip(modes, kinds, strict=True)
            if own == kind
        ]
        assert numbers == sorted(set(numbers))
    n = full.n - 2
    squares, shapes = eigh(full.K[:n, :n], full.M[:n, :n])
    for mode, kind in zip(modes, kinds, strict=True):
        k = int(
            np.argmin(
                np.abs(np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi) - mode.fixed_frequency)
            )
        )
        assert math.sqrt(squares[k]) == pytest.approx(
            2.0 * math.pi * mode.fixed_frequency, rel=1e-6
        )
        x = shapes[:, k]
        rows = {"control": slice(3, 6), "hub": slice(6, full.n_q), "array": slice(full.n_q, n)}
        energy = {name: float(x[at] @ full.K[at, at] @ x[at]) for name, at in rows.items()}
        assert kind == max(energy, key=energy.__getitem__)


@pytest.mark.parametrize("duration", [4.0, 16.0])
def test_the_line_of_sight_that_cases_of_a_campaign_keep_is_that_of_a_run(duration: float) -> None:
    """With the longer record no line lies near the mean."""
    changes = {"record.settle": Si(2.0), "record.duration": Si(duration)}
    scenario = scenario_of(whole.FullCraft(bandwidth=0.02), **changes)
    motion = mv.simulate(scenario)
    few = simulate_from_rest(scenario, channels=("T_d", "alpha_l", "alpha_m", "los_ax", "los_ay"))
    for name in ("T_d", "alpha_l", "los_ay"):
        assert np.abs(few[name] - motion[name]).max() < 1e-12 * np.abs(motion[name]).max()
    assert few.invariants.energy == motion.invariants.energy
    later = simulate_from_rest(
        scenario, channels=("T_d", "alpha_l", "alpha_m", "los_ax", "los_ay"), balanced=False
    )
    assert np.abs(later["T_d"] - motion["T_d"]).max() < 1e-5 * np.abs(motion["T_d"]).max()
    assert later.invariants.energy < 1e-5
    assert later.invariants.momentum < 1e-5
    assert later.invariants.energy_in < 0.9 * motion.invariants.energy_in  # of the record alone
    table = mv.find_lines(motion)
    one, other = hub_lines(motion, table), hub_lines(few, table, los_only=True)
    assert one.names == other.names
    clock = np.array([not name.startswith("array_mode") for name in one.names])
    assert not np.all(clock)
    size = np.abs(one.los)
    apart = np.abs(other.los - one.los)
    assert np.all(apart[clock] < 1e-5 * size[clock] + 1e-6 * size.max())
    assert np.all(apart[~clock].max(axis=1) < 0.01 * size[~clock].max(axis=1))
    with pytest.raises(mv.MicrovibError, match="los_x' is made of others"):
        simulate_from_rest(scenario, channels=("los_x",))
