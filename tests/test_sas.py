"""The simulator: formulas against hand, its finite elements against closed forms, sizing, tolerances, command."""

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from support.scenarios import changed

from microvib.cli.main import main
from microvib.errors import MicrovibError, OptionError, ScenarioError
from microvib.io.file_access import WORKING_FOLDER
from microvib.io.modal_sources import load_design, modal_source
from microvib.io.scenario_file import dump_part, load_scenario
from microvib.reports.sas_drawing import draw_simulator
from microvib.structures.fem.assembly import assemble
from microvib.structures.fem.described import kinds, solve_design
from microvib.structures.fem.simulator_mesh import structure_of
from microvib.structures.springs import allowable_stress, coil_stress, spring_energy, wahl_factor
from microvib.studies.sas import (
    SizingError,
    TargetState,
    catalog_states,
    parts_of,
    response,
    size,
    state_of_array,
    stock_springs,
    tolerance,
)  # fmt: skip
from microvib.studies.sizing import parse_state, read_states

TARGET = TargetState("target", 1.19, 8.18)
TWO_DEGREES = math.radians(2.0)


@pytest.fixture(scope="module")
def design():
    return load_design("reference-sas")


@pytest.fixture(scope="module")
def sizing(design):
    return size(TARGET, catalog_states(), design, TWO_DEGREES)


def rigid(design, **groups):
    stiff = {"radial": 1e13, "axial": 1e13, "rocking": 1e12}
    return changed(design, material__modulus=7e15, bearing=stiff, rope=None, **groups)


# Formulas


def test_eq_22_is_the_energy_of_eight_springs():
    k, arm, d, angle = 900.0, 0.25, 0.02, 0.03
    lengths = [d + sign * arm * angle for sign in (1, -1) for _ in range(4)]
    by_hand = sum(0.5 * k * (x**2 - d**2) for x in lengths)
    assert spring_energy(k, arm, d, angle) == pytest.approx(by_hand)
    assert by_hand == pytest.approx(4 * k * arm**2 * angle**2)


def test_eq_21_and_22_hold_the_same_energy(sizing):
    e = sizing.target.equations
    assert e["kinetic_energy_j"] == pytest.approx(e["spring_energy_j"])
    assert e["printed_eq_24_rad_per_s"] == pytest.approx(2 * math.pi * e["frequency_hz"])


def test_stress_of_a_coil_by_hand():
    assert wahl_factor(0.002, 0.016) == pytest.approx(31 / 28 + 0.615 / 8)
    assert coil_stress(50.0, 0.002, 0.016) == pytest.approx(
        (31 / 28 + 0.615 / 8) * 8 * 50 * 0.016 / (math.pi * 0.002**3)
    )
    assert allowable_stress(0.001) == pytest.approx(0.45 * 2220e6)


WIRE_SHEAR_MODULUS = 81.5e9  # of patented cold-drawn steel wire, EN 10270-1 [Pa]


@pytest.mark.parametrize("spring", stock_springs(), ids=lambda s: s.name)
def test_a_stock_spring_has_the_rate_of_its_coils(spring):
    rate = WIRE_SHEAR_MODULUS * spring.wire**4 / (8.0 * spring.coil**3 * spring.coils)
    assert rate == pytest.approx(spring.rate, rel=0.01)
    body = (spring.coils + 1.0) * spring.wire
    assert body < spring.free_length < body + 2.5 * spring.coil


def energy(design, angle):
    """Of eight springs between points that turn with the frame and points of the plate, from their lengths."""
    total = 0.0
    for sx in (-1, 1):
        for sy in (-1, 1):
            inner = np.array([sx * design.arm, sy * design.plate.hook])
            outer = np.array([sx * design.arm, sy * design.hook_end])
            turn = np.array(
                [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
            )
            x = np.linalg.norm(turn @ outer - inner) - design.spring.free_length
            total += 2 * (design.spring.initial_tension * x + 0.5 * design.spring.rate * x**2)
    return total


def test_stiffness_with_tension_is_that_of_the_stretched_springs(design):
    step = 1e-4
    curvature = (energy(design, step) - 2 * energy(design, 0.0) + energy(design, -step)) / step**2
    assert design.stiffness == pytest.approx(curvature, rel=1e-6)


# Finite elements


def test_inertia_by_hand_is_that_of_the_elements(design):
    assert solve_design(design, 4).mass[5, 5] == pytest.approx(design.inertia, rel=1e-12)
    heavier = changed(design, counterweight__mass=3.0)
    w = design.counterweight
    assert heavier.inertia - design.inertia == pytest.approx(4 * (w.radius**2 + w.diameter**2 / 8))
    bare = changed(design, arm=0.2)
    assert solve_design(bare, 4).mass[5, 5] == pytest.approx(bare.inertia, rel=1e-12)


@pytest.mark.parametrize("hook", [0.0, 0.015])
def test_rigid_parts_give_eq_24(design, hook):
    stiff = rigid(design, plate__hook=hook)
    modes = solve_design(stiff, 2)
    assert modes.frequency[0] == pytest.approx(stiff.frequency, rel=1e-5)
    assert modes.participation[5, 0] ** 2 == pytest.approx(stiff.moving_inertia, rel=1e-5)
    if hook == 0.0:
        printed = (
            2 * stiff.arm * math.sqrt(2 * stiff.spring.rate / stiff.moving_inertia) / (2 * math.pi)
        )
        assert modes.frequency[0] == pytest.approx(printed, rel=1e-5)


def test_tension_resists_no_rigid_motion(design):
    """Springs and their tension alone, all of their ends turned and moved as one body over the ground."""
    structure = structure_of(design)
    springs = tuple(
        part
        for part in structure.parts
        if part.name in ("spring", "tension") and hasattr(part, "stiffness")
    )
    assert len(springs) == 24
    alone = assemble(dataclasses.replace(structure, parts=springs), clamped=False)
    R = alone.R.copy()
    R[6 * structure.interface : 6 * structure.interface + 6] = 0.0
    energy = R.T @ alone.K @ R
    assert np.abs(energy).max() < 1e-9 * design.stiffness


def test_the_rope_adds_its_twist(design):
    twist = 20.0
    with_rope = rigid(design)
    rope = {"length": 2.0, "tension": 300.0, "axial": 2000.0, "twist": twist}
    with_rope = changed(with_rope, rope=rope)
    expected = math.sqrt((with_rope.stiffness + twist) / with_rope.moving_inertia) / (2 * math.pi)
    assert solve_design(with_rope, 2).frequency[0] == pytest.approx(expected, rel=1e-5)


def test_table_4(design):
    modes = solve_design(design, 6)
    assert modes.frequency[0] == pytest.approx(1.187, rel=0.02)
    assert modes.mass[5, 5] == pytest.approx(8.46, rel=0.02)
    published = [mode.frequency for mode in design.reference]
    assert published == [1.187, 18.16, 18.27]
    np.testing.assert_allclose(modes.frequency[1:3], published[1:], rtol=0.05)
    assert kinds(design, modes)[:4] == ("T", "R", "R", "H")
    assert modal_source("reference-sas", 6).model.J_h == pytest.approx(design.J_h, rel=0.01)
    assert 0.05 < design.J_h < 0.4


def test_a_finer_mesh_changes_little(design):
    coarse, fine = (solve_design(changed(design, mesh=m), 4).frequency for m in (0.1, 0.05))
    np.testing.assert_allclose(coarse, fine, rtol=1e-4)


def test_a_mesh_too_fine_is_a_sentence(design):
    with pytest.raises(MicrovibError, match="degrees of freedom"):
        structure_of(changed(design, mesh=1e-4))


def test_a_description_with_a_missing_group_is_a_sentence(tmp_path):
    path = tmp_path / "half.yaml"
    path.write_text("arm: 0.2 m\nframe: {half_length: 1 m}\n")
    with pytest.raises(ScenarioError, match="spring: missing"):
        load_design(str(path), WORKING_FOLDER)


def test_a_scenario_takes_the_simulator():
    scenario = load_scenario("state-1", {"array.fem": "reference-sas", "array.modes": 3})
    assert scenario.array.inertia == pytest.approx(8.46, rel=1e-3)
    assert scenario.array.J_h == pytest.approx(0.2233, rel=1e-2)
    assert scenario.array.drive_axis == "z"
    assert load_scenario("state-1", {"array.fem": "reference-sas"}).array.modes[
        0
    ].frequency == pytest.approx(1.187, rel=1e-3)


# Sizing


def test_the_five_states_of_table_2(sizing):
    assert len(sizing.states) == 5
    assert sizing.one_spring
    for setting in sizing.settings:
        f, J = setting.finite_elements
        assert f == pytest.approx(setting.state.frequency, rel=0.01)
        assert pytest.approx(setting.state.inertia, rel=0.01) == J
        assert setting.design.frequency == pytest.approx(
            setting.state.frequency, rel=1e-3
        )  # settings to 0.1 mm
        assert setting.forces[0] > 0.0
        assert setting.stress < setting.allowable


def test_what_stands_for_the_array():
    model = modal_source("reference-array", 10).model
    state = state_of_array(model, "array")
    assert state.frequency == pytest.approx(1.187, abs=2e-3)
    assert state.inertia == pytest.approx(7.698, abs=2e-3)


def test_a_state_of_its_own_springs(design):
    """States that no stock spring reaches together have their own."""
    sizing = size(
        TargetState("slow", 0.66, 8.18), [TargetState("fast", 3.2, 8.18)], design, TWO_DEGREES
    )
    assert not sizing.one_spring
    assert [s.design.frequency for s in sizing.settings] == pytest.approx([0.66, 3.2], rel=1e-3)


def test_tolerances_against_monte_carlo(sizing):
    design = sizing.target.design
    found = tolerance(design)
    values, limits, _ = parts_of(design)
    nominal = response(design, values)
    assert nominal == pytest.approx((design.frequency, design.inertia), rel=1e-9)
    draws = values + limits * np.random.default_rng(3).uniform(-1, 1, (40_000, values.size))
    for k, sample in enumerate(response(design, draws)):
        assert sample.std() / nominal[k] == pytest.approx(found.deviation[k], rel=0.02)
        assert np.abs(sample / nominal[k] - 1).max() < found.worst[k]
    corner = response(design, values + limits * np.r_[np.ones(12), -np.ones(9), 1.0])
    assert corner[0] / nominal[0] - 1 == pytest.approx(found.worst[0], rel=0.03)
    assert sum(f for f, _ in found.contributions.values()) == pytest.approx(found.worst[0])


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ((1.19, 50.0), "10 kg at 740 mm give 27.5"),
        ((1.19, 1.0), "2 kg at 450 mm give 5.8"),
        ((9.0, 8.18), "stiffest stock springs at an arm of 360 mm give 3.3"),
        ((0.1, 8.18), "softest stock springs at an arm of 180 mm give 0.6"),
    ],
)
def test_out_of_reach_says_what_binds(design, state, words):
    with pytest.raises(SizingError, match=words) as error:
        size(TargetState("target", *state), [], design, TWO_DEGREES)
    assert "allowed are" in str(error.value)


def test_between_the_counterweights(design):
    gap = changed(design, adjustment__masses=(0.5, 10.0), adjustment__radius_min=0.6)
    with pytest.raises(SizingError, match=r"adjustment\.masses"):
        size(TargetState("target", 1.19, 12.0), [], gap, TWO_DEGREES)


def test_an_amplitude_too_large(design):
    with pytest.raises(SizingError, match="at most 8"):
        size(TARGET, [], design, math.radians(20.0))
    size(TARGET, [], design, math.radians(8.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arm": 0.5}, "adjustment goes from 0.18 to 0.36"),
        ({"preload": 0.2}, r"preload: the springs end"),
        ({"adjustment__arm_max": 0.45}, "radius_min|off the plate"),
        ({"adjustment__radius_max": 1.0}, "off the frame"),
        ({"shaft__bore": 0.06}, "leaves no wall"),
        ({"frame__bridge": 0.5}, "wider than the rails"),
        ({"adjustment__arm_min": 0.05}, "under the bridge"),
    ],
)
def test_a_description_that_does_not_fit(design, change, words):
    with pytest.raises(ScenarioError, match=words):
        changed(design, **change)


def test_options_as_sentences(tmp_path):
    assert (
        parse_state("1.19 Hz:15.69 kg*m^2", "a")
        == parse_state("1.19:15.69", "a")
        == TargetState("a", 1.19, 15.69)
    )
    for text in ("-1", "nan", "0", "2 s", "x"):
        with pytest.raises(OptionError, match="state: "):
            parse_state(f"1.19:{text}", "a")
    table = tmp_path / "states.csv"
    table.write_text("state,mode_frequency_hz,inertia_kg_m2\na,1.3,9\nb,x,9\n")
    with pytest.raises(MicrovibError, match="row 3"):
        read_states(table)
    table.write_text("f\n1\n")
    with pytest.raises(MicrovibError, match="mode_frequency_hz"):
        read_states(table)


def test_a_description_reads_back(sizing, tmp_path):
    path = tmp_path / "simulator.yaml"
    path.write_text(dump_part(sizing.target.design))
    assert load_design(str(path), WORKING_FOLDER) == sizing.target.design


def test_the_drawing_has_its_dimensions(sizing):
    setting = sizing.target
    texts = [t.get_text() for ax in draw_simulator(setting).axes for t in ax.texts]
    d = setting.design
    for wanted in (
        f"l = {1e3 * d.arm:.1f}",
        f"r = {1e3 * d.counterweight.radius:.1f}",
        "1600",
        "400",
        "200",
        "260",
    ):
        assert wanted in texts
    assert any("4 × 2 kg" in text for text in texts)


# Command


def test_sas_size_writes_a_source_of_modes(tmp_path):
    out = tmp_path / "sas"
    done = CliRunner().invoke(
        main, ["sas", "size", "--inertia", "8.18", "--frequency", "1.19", "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert "state 5" in done.output
    assert sorted(p.name for p in out.glob("[!.]*")) == [
        "drawing.png", "report.html", "sas.csv", "sas.json", "simulator.yaml", "tolerances.csv",
    ]  # fmt: skip
    rows = list(csv.DictReader((out / "sas.csv").read_text().splitlines()))
    assert [row["state"] for row in rows] == ["target", *(f"state {k}" for k in range(1, 6))]
    data = json.loads((out / "sas.json").read_text())
    assert data["settings"][5]["elements_inertia_kg_m2"] == pytest.approx(22.99, rel=0.01)
    assert "—" not in (out / "report.html").read_text()
    model = modal_source(str(out / "simulator.yaml"), 3, WORKING_FOLDER).model
    assert model.frequency[0] == pytest.approx(1.19, rel=0.01)
    again = CliRunner().invoke(
        main, ["sas", "size", "--inertia", "8.18", "--frequency", "1.19", "--out", str(out)]
    )
    assert again.exit_code == 1
    assert "--overwrite" in again.output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--inertia", "8.18"], "give both inertia and frequency, or instead of them an array"),
        (["--array", "reference-array", "--inertia", "8"], "or instead of them an array"),
        (["--inertia", "8.18", "--frequency", "1.19 rad/s"], "mixes angles and cycles"),
        (["--inertia", "8.18", "--frequency", "1.19", "--amplitude", "2"], "'2 deg'"),
        (
            ["--inertia", "8.18", "--frequency", "1.19", "--design", "reference-array"],
            "describes an array",
        ),
        (["--inertia", "8.18", "--frequency", "1.19", "--state", "1"], "is not a state"),
        (
            ["--inertia", "8.18", "--frequency", "1.19", "--state", "1:9", "--states", "x"],
            "cannot be combined",
        ),
        (["--inertia", "80", "--frequency", "1.19"], "out of reach"),
    ],
)
def test_bad_options_are_sentences_and_write_nothing(options, words, tmp_path):
    done = CliRunner().invoke(main, ["sas", "size", *options, "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert words in done.output
    assert not (tmp_path / "out").exists()
