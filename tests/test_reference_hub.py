"""The described craft of the catalog: mass by hand, a bench on its mounts in closed form, finer meshes, and what is refused."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csc_matrix
from support.hub_responses import payload_rotations

import microvib as mv
from microvib.errors import MicrovibError
from microvib.io.file_access import FileAccess
from microvib.io.hub_sources import hub_from
from microvib.io.named import catalog_text
from microvib.io.yaml_text import parse_yaml
from microvib.model.hub_edge import KNOWN_PART
from microvib.model.rigid import tensor
from microvib.model.sentences import validate_part
from microvib.structures.fem.assembly import assemble
from microvib.structures.fem.hub_mesh import free_modes, structure_of
from microvib.structures.fem.modes import lowest_modes
from microvib.structures.hub_design import HubDesign

NAME = "reference-hub"


def described(**changes):
    """The description of the catalog with dotted keys changed."""
    data = parse_yaml(catalog_text(f"hubs/{NAME}"), NAME)
    for key, value in changes.items():
        *groups, last = key.split("__")
        inside = data
        for group in groups:
            inside = inside[int(group) if group.isdigit() else group]
        inside[last] = value
    return validate_part(HubDesign, data, origin=NAME)


def test_mass_properties_are_those_of_the_parts():
    design, hub = described(), hub_from({"modes": NAME, "count": 4})
    a, b, c = design.bus.size
    panel = design.bus.panel.areal_mass
    parts = [(panel * b * c, (x, 0, 0), (0, b, c)) for x in (-a / 2, 0, a / 2)]
    parts += [(panel * a * c, (0, y, 0), (a, 0, c)) for y in (-b / 2, b / 2)]
    parts += [(panel * a * b, (0, 0, z), (a, b, 0)) for z in (-c / 2, c / 2)]
    bench = design.bench
    level = c / 2 + bench.above
    parts.append(
        (
            bench.panel.areal_mass * bench.length * bench.width,
            (0, 0, level),
            (bench.length, bench.width, 0),
        )
    )
    parts += [(unit.mass, unit.position, (0, 0, 0)) for unit in design.equipment]
    masses, at = np.array([m for m, *_ in parts]), np.array([place for _, place, _ in parts], float)
    masses, at = (
        np.append(masses, bench.payload_mass),
        np.vstack([at, [0, 0, level + bench.payload_above]]),
    )
    center = masses @ at / masses.sum()
    own = [m / 12 * (np.dot(s, s) * np.eye(3) - np.diag(np.square(s))) for m, _, s in parts]
    inertia = sum(own) + np.diag(bench.payload_inertia)
    for m, r in zip(masses, at - center, strict=True):
        inertia = inertia + m * (r @ r * np.eye(3) - np.outer(r, r))
    assert hub.mass == pytest.approx(masses.sum(), rel=1e-6)
    assert tensor(hub.inertia) == pytest.approx(
        inertia, abs=5e-3 * inertia.max()
    )  # the mesh lumps panels at nodes
    assert hub.points[0].position == pytest.approx(
        np.array(design.points[0].position) - center, abs=2e-3
    )
    assert [p.name for p in hub.points] == ["root", "wheels", "payload"]
    residual = 6 * len(hub.points)
    assert 4 < len(hub.modes) <= 4 + residual
    assert hub.left_out_from == pytest.approx(free_modes(design, 5).frequency[10], rel=1e-9)


def test_a_stiff_bench_on_a_stiff_box_in_closed_form():
    """Two rigid bodies on four mounts bounce at (k (1/m_1 + 1/m_2))^1/2 and swing about z at (c (1/J_1 + 1/J_2))^1/2."""
    stiff = {"modulus_1": "70000 GPa", "modulus_2": "70000 GPa", "shear_modulus": "26300 GPa"}
    mounts = [
        {
            "x": f"{x} m",
            "y": f"{y} m",
            "axial": "2e6 N/m",
            "lateral": "3e6 N/m",
            "rotational": "1 N*m/rad",
            "reach": "105 mm",
        }
        for x, y in ((0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3))
    ]
    face = [
        {"thickness": "0.5 mm", "angle": "0 deg", "poisson": 0.3, "density": "2700 kg/m^3", **stiff}
    ]
    core = {
        "thickness": "30 mm",
        "density": "50 kg/m^3",
        "shear_xz": "310 GPa",
        "shear_yz": "310 GPa",
    }
    panel = {"face": face, "core": core}
    design = described(
        equipment=[], bus__panel=panel, bench__panel=panel, bench__mounts=mounts, bench__payload_above="0 m",
        points=[{"name": "root", "position": ["0 m", "0.65 m", "0 m"], "reach": "155 mm"}],
    )  # fmt: skip
    modes = free_modes(design, 6)
    areal = design.bus.panel.areal_mass
    a, b, c = design.bus.size
    m_1, m_2 = areal * (3 * b * c + 2 * a * c + 2 * a * b), areal + design.bench.payload_mass
    bounce = math.sqrt(4 * 2e6 * (1 / m_1 + 1 / m_2)) / (2 * math.pi)
    assert (
        np.abs(modes.frequency[6:] / bounce - 1.0).min() < 1e-2
    )  # a thousand times as stiff is not rigid
    J_1 = areal * (
        a * b * (a**2 + b**2) / 6
        + b * c * (a**2 / 2 + 3 * b**2 / 12)
        + a * c * (b**2 / 2 + 2 * a**2 / 12)
    )
    J_2 = areal / 6 + design.bench.payload_inertia[2]
    swing = math.sqrt((4 * 3e6 * 2 * 0.3**2 + 4) * (1 / J_1 + 1 / J_2)) / (2 * math.pi)
    assert (
        np.abs(modes.frequency[6:] / swing - 1.0).min() < 2e-2
    )  # inertia of the panels is lumped at nodes


def _with_masses_at_root(frequency, shapes, mass):
    """Frequencies [Hz] of free modes (s,) with a ``mass`` matrix (6, 6) added at a point, ``shapes`` (6, s)."""
    squares = (2.0 * np.pi * frequency) ** 2
    squares[:6] = 0.0
    found = eigh(np.diag(squares), np.eye(squares.size) + shapes.T @ mass @ shapes)[0]
    return np.sqrt(np.maximum(found[6:], 0.0)) / (2.0 * np.pi)


def test_residual_modes_give_the_whole_mesh_with_an_array_on_it():
    """The mesh with a heavy body at its root, solved as a whole, against few free modes of the mesh alone."""
    design = described()
    structure, points = structure_of(design)
    system = assemble(structure, clamped=False)
    root = 6 * points["root"] + np.arange(6)
    at_root = system.T.tocsr()[root].T
    mass = np.diag([36.0, 36.0, 36.0, 420.0, 12.0, 430.0])
    on_root = at_root @ csc_matrix(mass) @ at_root.T
    whole = lowest_modes(system.K, (system.M + on_root).tocsc(), 14)[0]
    true = np.sqrt(whole[6:]) / (2.0 * np.pi)
    modes = free_modes(design, 10)
    cut = _with_masses_at_root(modes.frequency[:16].copy(), modes.shapes[0, :, :16], mass)
    kept = _with_masses_at_root(modes.frequency.copy(), modes.shapes[0], mass)
    assert kept[:8] == pytest.approx(true, rel=3e-5)
    assert cut[0] > 2.0 * true[0]


def test_responses_are_known_up_to_the_edge():
    """The hub with few modes against that with many, up to ``KNOWN_PART`` of the first that is left out."""
    many, f = hub_from({"modes": NAME, "count": 150}), np.geomspace(5.0, 350.0, 3000)
    for count in (10, 20, 30):
        few = hub_from({"modes": NAME, "count": count})
        inside = f <= KNOWN_PART * few.left_out_from
        for point in ("root", "wheels"):
            true = payload_rotations(many, f[inside], point)
            found = payload_rotations(few, f[inside], point)
            off = np.abs(found - true).max(axis=(1, 2)) / np.abs(true).max(axis=(1, 2))
            assert off.max() < 0.025, (count, point)


@pytest.mark.long
def test_a_finer_mesh_changes_little():
    coarse, fine = (
        free_modes(described(mesh=mesh), 8).frequency[6:14] for mesh in ("100 mm", "50 mm")
    )
    assert fine == pytest.approx(coarse, rel=0.06)


def test_a_file_of_ones_own_and_what_is_refused(tmp_path):
    text = catalog_text(f"hubs/{NAME}")
    (tmp_path / "mine.yaml").write_text(text.replace("payload_mass: 75 kg", "payload_mass: 90 kg"))
    mine, ours = (
        hub_from({"modes": name, "count": 1, "damping": 0.01}, FileAccess(tmp_path))
        for name in ("mine.yaml", NAME)
    )
    assert mine.mass == pytest.approx(ours.mass + 15.0)
    assert mine.modes[0].damping == 0.01
    for before, after, says in (
        (
            "reach: 155 mm",
            "reach: 10 mm",
            "root: no place of the mesh lies within 0.01 m of it; a larger reach is needed",
        ),
        ("x: 0.4 m, y: 0 m", "x: 0.7 m, y: 0 m", "bench.mounts.0: lies beside the bench"),
        ("name: root", "name: payload", "points: each needs a name of its own"),
        ("mesh: 100 mm", "mesh: 0.1 mm", "mesh: elements of 0.0001 m make about"),
        ("length: 1.2 m", "length: -1 m", "bus.length"),
    ):
        assert before in text
        (tmp_path / "bad.yaml").write_text(text.replace(before, after))
        with pytest.raises(MicrovibError) as caught:
            hub_from({"modes": "bad.yaml"}, FileAccess(tmp_path))
        assert says in str(caught.value)
    with pytest.raises(mv.ScenarioError, match=r"missing\.yaml: there is no such file"):
        hub_from({"modes": "missing.yaml"}, FileAccess(tmp_path))


def test_position_may_be_a_point_of_the_hub(tmp_path):
    data = parse_yaml(
        (Path(__file__).parents[1] / "examples" / "spacecraft.yaml").read_text(), "craft"
    )
    data["spacecraft"]["hub"] |= {
        "points": [{"name": "root", "position": ["0.35 m", "0.9 m", "-0.2 m"]}]
    }
    path, loaded = tmp_path / "craft.yaml", []
    for position in (["0.35 m", "0.9 m", "-0.2 m"], "root"):
        data["spacecraft"]["interface"]["position"] = position
        path.write_text(json.dumps(data))
        loaded.append(mv.load_scenario(path))
    assert loaded[0] == loaded[1]
    data["spacecraft"]["interface"]["position"] = "tip"
    path.write_text(json.dumps(data))
    with pytest.raises(
        mv.ScenarioError, match=r"interface\.position: 'tip' is not a point of the hub \(root\)"
    ):
        mv.load_scenario(path)
