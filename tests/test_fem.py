"""The array description, its mesh and modes, second-order terms, and what is wrong with bad models."""

import dataclasses
import math

import numpy as np
import pytest
from support.scenarios import changed

from microvib.errors import MicrovibError, ScenarioError
from microvib.io.file_access import FileAccess
from microvib.io.modal_sources import load_design, modal_source
from microvib.io.named import catalog_names
from microvib.io.scenario_file import dump_scenario, load_scenario
from microvib.model.sentences import validate_part
from microvib.structures.array_design import ArrayDesign
from microvib.structures.fem.array_mesh import kinds, structure_of
from microvib.structures.fem.coupling import Coupling, coupling, coupling_size, rotating_frequencies
from microvib.structures.fem.described import modal_model, solve_design
from microvib.structures.fem.modes import solve
from microvib.structures.fem.structure import Link, Lump, Mesh, Spring, StructureError


@pytest.fixture(scope="module")
def design():
    return load_design("reference-array")


@pytest.fixture(scope="module")
def reference(design):
    return solve_design(design, 14)


def test_table_1(reference):
    f = np.array([mode.frequency for mode in load_design("reference-array").reference])
    assert f.size == 10
    np.testing.assert_allclose(reference.frequency[:10], f, rtol=0.05)
    fraction = reference.participation[3] ** 2 / reference.mass[3, 3]
    assert reference.mass[3, 3] == pytest.approx(7.69, rel=0.01)
    assert fraction[2] == pytest.approx(0.967, abs=0.01)
    assert fraction[0] < 1e-6
    assert fraction[1] < 1e-4
    assert "".join(kinds(reference)[:7]) == "BITBIBT"
    assert fraction[6] == pytest.approx(0.0269, abs=0.003)


def test_the_rigid_body_of_the_array(design, reference):
    """Mass and inertia from the description by hand: panels as thick plates, legs and cross-bar as rods."""
    p, y = design.panels, design.yoke
    panel = design.sandwich.areal_mass * p.span * p.chord
    rods = {
        "leg": 2
        * rod(y.leg, y.density)
        * math.hypot(y.length, y.half_width_panel - y.half_width_drive),
        "bar": rod(y.crossbar, y.density) * 2 * y.half_width_panel,
    }
    assert reference.mass[0, 0] == pytest.approx(3 * panel + sum(rods.values()), rel=1e-9)
    a, b = y.half_width_drive, y.half_width_panel
    inertia = (
        3 * panel * (p.chord**2 / 12 + design.offset**2)
        + rods["leg"] * (a * a + a * b + b * b) / 3
        + rods["bar"] * b * b / 3
    )
    assert reference.mass[3, 3] == pytest.approx(
        inertia, rel=5e-4
    )  # thickness of panels and tubes left out
    np.testing.assert_allclose(reference.mass, reference.mass.T, atol=1e-12)


def rod(tube, density):
    return density * (
        tube.width * tube.height - (tube.width - 2 * tube.wall) * (tube.height - 2 * tube.wall)
    )


def test_all_modes_together_carry_the_whole_mass(design):
    """Effective masses of all modes of a mesh add up to the rigid body less what is clamped."""
    coarse = changed(design, mesh=1.0)
    structure = structure_of(coarse)
    few = solve(structure, 100)
    sums = (few.participation**2).sum(axis=1) / np.diag(few.mass)
    assert np.all(sums < 1.0 + 1e-9)
    assert np.all(np.diff(np.cumsum(few.participation**2, axis=1), axis=1) >= 0.0)
    assert np.all(sums > 0.985)


def test_a_missing_panel(design, reference):
    without = solve_design(changed(design, panels__missing=(3,)), 3)
    assert without.mass[3, 3] < 0.7 * reference.mass[3, 3]
    assert without.frequency[0] > 1.5 * reference.frequency[0]


def test_compliance_of_the_shaft_softens(design, reference):
    torsion = 4e3
    soft = {
        "along_x": 1e8,
        "along_y": 1e8,
        "along_z": 1e8,
        "about_x": torsion,
        "about_y": 1e8,
        "about_z": 1e8,
    }
    modes = solve_design(changed(design, shaft=soft), 6)
    k = 2
    series = 1.0 / (
        1.0 / (reference.participation[3, k] ** 2 * (2 * np.pi * reference.frequency[k]) ** 2)
        + 1.0 / torsion
    )
    rigid = reference.participation[3, k] ** 2 * (2 * np.pi * reference.frequency[k]) ** 2
    expected = reference.frequency[k] * math.sqrt(series / rigid)
    assert np.min(np.abs(modes.frequency / expected - 1)) < 5e-3


def test_masses_and_damping(design):
    heavy = changed(
        design,
        masses=({"mass": 2.0, "x": design.yoke.length + 0.5, "y": 0.5},),
        damping={"ratio": 0.004, "mass": 0.01, "stiffness": 1e-4, "modes": (0.02,)},
    )
    model = modal_model(heavy, 3)
    assert model.mass[0, 0] == pytest.approx(modal_model(design, 3).mass[0, 0] + 2.0)
    W = 2 * np.pi * model.frequency[1]
    assert model.damping[:2] == pytest.approx([0.02, 0.004 + 0.01 / 2 / W + 1e-4 * W / 2])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"panels__missing": (2,)}, "panel 3: not connected to the interface"),
        ({"panels__missing": (1,)}, "not connected to the interface"),
        ({"masses": ({"mass": 1.0, "x": 0.1, "y": 0.0},)}, "masses.0: there is no panel"),
        ({"mesh": 1e-4}, "degrees of freedom; at most"),
    ],
)  # fmt: skip
def test_a_model_that_does_not_hang_together(design, change, words):
    with pytest.raises(StructureError, match=words):
        solve_design(changed(design, **change), 3)


def test_a_mechanism_is_named(design):
    data = design.model_dump()
    for hinge in data["hinges"]["between"]:
        hinge["stiffness"]["about_y"] = hinge["stiffness"]["about_x"] = hinge["stiffness"][
            "along_z"
        ] = 0.0
    with pytest.raises(StructureError, match=r"without stiffness.*panel 3 moves along z"):
        solve_design(validate_part(ArrayDesign, data, si=True), 4)


def test_a_wrong_unit_is_questioned(design):
    heavy = changed(design, sandwich__nonstructural_mass=1000 * design.sandwich.nonstructural_mass)
    notes = modal_model(heavy, 3).notes
    assert len(notes) == 2
    assert "kg/m²" in notes[0]
    assert modal_model(design, 3).notes == ()


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("sandwich.core.thickness", "0 mm", "core.thickness: '0 mm' is not allowed; it must be greater than 0 m"),
        ("sandwich.core.thickness", "20 mm^2", "wrong dimension"),
        ("yoke.leg.wall", "20 mm", "fills the tube"),
        ("hinges.root.0.position", "5 m", "beyond the panel"),
        ("panels.missing", "[7]", "no panel 7"),
        ("panels.spann", "1 m", "panels.spann: unknown key; did you mean panels.span? allowed here are count, span"),
        ("hinges.between", "[]", "hinges.between: missing"),
    ],
)  # fmt: skip
def test_a_description_with_a_mistake(tmp_path, design, key, value, words):
    from microvib.io.named import catalog_text
    from microvib.io.scenario_file import parse_value
    from microvib.io.yaml_text import parse_yaml
    from microvib.model.scenario import set_key

    data = parse_yaml(catalog_text("reference-array"), "")
    set_key(data, key, parse_value(value))
    import json

    (tmp_path / "a.yaml").write_text(json.dumps(data))
    with pytest.raises(ScenarioError, match=r"a\.yaml") as error:
        load_design("a.yaml", FileAccess(tmp_path))
    assert words.replace("\\", "") in str(error.value)


def test_links_must_not_chain():
    mesh = Mesh()
    a, b, c = (int(mesh.add((k, 0, 0))[0]) for k in (0.0, 1.0, 2.0))
    mesh.parts += [Link("one", a, np.array([b])), Link("two", b, np.array([c])), Lump("m", c, 1.0)]
    with pytest.raises(
        StructureError, match="two: its reference node depends on another rigid link"
    ):
        solve(mesh.structure(a), 1)


def test_eq_13_a_turning_oscillator():
    """A mass on equal springs across the axis, seen from the turning frame, has the frequencies Omega +- omega (Foucault)."""
    mesh = Mesh()
    a, b = (int(mesh.add((0.0, 0.0, 0.0))[0]) for _ in range(2))
    mesh.parts += [
        Spring("spring", (a, b), (1e6, 400.0, 400.0, 1e6, 1e6, 1e6)),
        Lump("mass", b, 4.0, (1.0, 1.0, 1.0)),
    ]
    modes = solve(mesh.structure(a), 2)
    terms = coupling(modes)
    np.testing.assert_allclose(modes.frequency * 2 * np.pi, 10.0, rtol=1e-9)
    np.testing.assert_allclose(
        rotating_frequencies(terms, np.full(2, 10.0), 0.5), [9.5, 10.5], rtol=1e-9
    )
    np.testing.assert_allclose(terms.F, -terms.F.T, atol=1e-15)
    # so that the two Coriolis terms of Eq. 13 cancel as they are printed; the second wants F transposed
    eta, rate = np.array([0.3, -0.7]), np.array([1.1, 0.2])
    assert rate @ terms.F @ eta + eta @ terms.F @ rate == pytest.approx(0.0, abs=1e-15)
    assert abs(rate @ terms.F @ eta + eta @ terms.F.T @ rate) > 0.1


def test_eq_15_a_radial_mass_changes_the_momentum():
    """A mass at a radius r on a radial spring: C = r sqrt(m), and it is held off by omega^2 r/(Omega^2 - omega^2)."""
    mesh = Mesh()
    a, b, c = (int(mesh.add(p)[0]) for p in [(0, 0, 0), (0, 2.0, 0), (0, 2.0, 0)])
    mesh.parts += [
        Link("arm", a, np.array([b])),
        Spring("radial", (b, c), (1e7, 900.0, 1e7, 1e7, 1e7, 1e7)),
        Lump("mass", c, 9.0, (1, 1, 1)),
    ]
    modes = solve(mesh.structure(a), 1)
    assert abs(coupling(modes).C[0]) == pytest.approx(2.0 * 3.0)
    found = coupling_size(modes, 0.1, np.array([0.01]))
    stretch = 0.01 / (100.0 - 0.01)
    # far below the resonance the inertia is m r^2 (1 + stretch)^2, whose radius follows the rate: dJ/d omega adds as much again
    assert found.torque > (1 + stretch) ** 2 - 1
    assert isinstance(coupling(modes), Coupling)


def test_eq_15_is_small_at_the_cruising_rate(reference):
    slow, fast = (
        coupling_size(reference, math.radians(rate), np.full(14, 0.01)) for rate in (0.06, 1.0)
    )
    assert slow.torque < 1e-4
    assert slow.frequency < 1e-5
    assert fast.torque < 0.01
    assert fast.frequency / slow.frequency == pytest.approx((1.0 / 0.06) ** 2, rel=0.1)


def test_a_scenario_takes_finite_elements(tmp_path):
    scenario = load_scenario(
        "state-1",
        {"array.fem": "reference-array", "array.modes": 3, "array.damping": "0.5 percent"},
    )
    assert len(scenario.array.modes) == 3
    assert scenario.array.modes[0].damping == pytest.approx(0.005)
    assert scenario.source_of("array.inertia") == "finite elements of reference-array, 3 modes"
    (tmp_path / "again.yaml").write_text(dump_scenario(scenario))
    assert load_scenario(tmp_path / "again.yaml") == scenario
    assert "reference-array" not in catalog_names()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"array.fem": "reference-arry"}, "is not a source of modes; allowed are reference-array"),
        ({"array.fem": "none.yaml"}, "none.yaml: there is no such file"),
        ({"array.fem": "reference-array", "array.modes": -1}, "array.modes: -1 is not allowed"),
        ({"array.fem": "reference-array", "array.from": "x.csv"}, "does not go with array.fem"),
        ({"array.fem": "reference-array", "array.inertia": "7 kg*m^2"}, "array.inertia"),
    ],
)  # fmt: skip
def test_a_scenario_with_a_wrong_source(changes, words):
    with pytest.raises(MicrovibError, match=words):
        load_scenario("state-1", changes)


def test_a_description_beside_the_scenario(tmp_path, design):
    from microvib.io.named import catalog_text

    (tmp_path / "mine.yaml").write_text(catalog_text("reference-array"))
    text = dump_scenario(load_scenario("state-1"))
    head, _, rest = text.partition("array:\n")
    tail = rest[rest.index("tracking:") :]
    head = "\n".join(line for line in head.splitlines() if not line.startswith("  array"))
    (tmp_path / "s.yaml").write_text(f"{head}\narray: {{fem: mine.yaml, modes: 2}}\n{tail}")
    scenario = load_scenario(tmp_path / "s.yaml")
    assert scenario.array.inertia == pytest.approx(7.69, rel=0.01)


def test_more_modes_than_the_mesh_has():
    mesh = Mesh()
    a, b = (int(mesh.add((0.0, 0.0, 0.0))[0]) for _ in range(2))
    mesh.parts += [Spring("s", (a, b), (1.0,) * 6), Lump("m", b, 1.0, (1, 1, 1))]
    with pytest.raises(StructureError, match="9 modes are asked for; a mesh with 6 free"):
        solve(mesh.structure(a), 9)


def test_the_source_of_a_table(tmp_path):
    from microvib.io.modal_table import modes_csv

    model = modal_source("reference-array", 4).model
    (tmp_path / "m.csv").write_text(modes_csv(model))
    back = modal_source("m.csv", 2, FileAccess(tmp_path)).model
    assert back.frequency.size == 2
    assert back.drive_axis == "x"
    np.testing.assert_allclose(back.participation, model.first(2).participation, atol=1e-9)
    assert dataclasses.replace(back, title="").inertia == pytest.approx(model.inertia)
