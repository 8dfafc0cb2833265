"""Hubs from files: tables of free-free modes with rigid ones in any combination, rows of the line of sight, what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from support import craft as whole
from support.craft_scenarios import scenario_of

import microvib as mv
from microvib.io.hub_sources import COLUMNS
from microvib.io.scenario_file import load_scenario
from microvib.io.yaml_text import parse_yaml
from microvib.model.coupling import receiver_of
from microvib.model.rigid import rigid_motion_at
from microvib.model.spacecraft import Hub
from microvib.structures.hub import FreeModes, free_free_modes, hub_of
from microvib.structures.modal import ModalError, ModalModel

HUB_COLUMNS = ("mode", "frequency_hz", "damping", *COLUMNS[2:])
SHAPE = COLUMNS[6:]

ORIGIN = np.array([0.3, -0.1, 0.7])  # of the table, from the hub's centre of mass
POINTS = {"root": whole.PLACE, "payload": np.array([0.1, -0.2, 0.6])}
BENDING = np.array([2e-3, -3e-3, 4e-3, 1e-2, 6e-3, -8e-3])


def motion(position: np.ndarray) -> np.ndarray:
    m = np.eye(6)
    m[:3, 3:] = -whole.cross_matrix(position)
    return m


def free_modes() -> FreeModes:
    """The hub of ``support.craft`` with one flexible mode; its six rigid modes are mixed at random."""
    mass = np.zeros((6, 6))
    mass[:3, :3], mass[3:, 3:] = whole.HUB_MASS * np.eye(3), whole.HUB_INERTIA
    values, vectors = np.linalg.eigh(mass)
    mixed = np.linalg.qr(np.random.default_rng(3).normal(size=(6, 6)))[0]
    rigid = vectors @ np.diag(values**-0.5) @ mixed
    shapes = np.array(
        [
            np.column_stack([motion(place) @ rigid, BENDING * (1.0 + k)])
            for k, place in enumerate(POINTS.values())
        ]
    )
    tiny = np.array([3e-5, 1e-4, 0.0, 2e-4, 1e-5, 4e-4])
    places = np.array(list(POINTS.values())) - ORIGIN
    return FreeModes(np.append(tiny, 17.0), np.full(7, 0.003), tuple(POINTS), places, shapes)


def table(modes: FreeModes) -> str:
    lines = [",".join(HUB_COLUMNS)]
    for k, f in enumerate(modes.frequency):
        for p, name in enumerate(modes.names):
            values = [*modes.positions[p], *modes.shapes[p, :, k]]
            lines.append(
                ",".join(
                    [str(k + 1), repr(float(f)), "0.003", name, *(repr(float(v)) for v in values)]
                )
            )
    return "\n".join(lines) + "\n"


SPACECRAFT = {
    "hub": {"modes": "hub.csv"},
    "interface": {
        "position": ["0.35 m", "0.9 m", "-0.2 m"],
        "drive_axis": [0, 1, 0],
        "reference": [1, 0, 0],
    },
    "line_of_sight": {"rows": "los.csv", "windows": ["10 ms"]},
}
ARRAY = {
    "inertia": "12.2 kg*m^2",
    "modes": [
        {
            "frequency": "1.19 Hz",
            "damping": "1 percent",
            "interface_participation": [0.1, -0.1, 0.02, 0.3, -0.4, 3.35],
        }
    ],
    "rigid_body": {
        "mass": "36.15 kg",
        "center_of_mass": ["0.04 m", "0.02 m", "3.2 m"],
        "inertia": [f"{x} kg*m^2" for x in (420, 430, 12.2, 1.5, -4, -2.2)],
    },
}
ROWS = (
    ",".join(("axis", "point", *SHAPE))
    + "\nx,payload,0,0,0,1,0,0\nx,root,0.5,0,0,0,0,0\ny,payload,0,0,0,0,1,0\n"
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "craft.yaml"
    drive = parse_yaml(mv.dump_scenario(load_scenario("state-1")), "state-1")
    del drive["sources"]
    path.write_text(json.dumps({**drive, "array": ARRAY, "spacecraft": SPACECRAFT}))
    (tmp_path / "hub.csv").write_text(table(free_modes()))
    (tmp_path / "los.csv").write_text(ROWS)
    return path


def test_mass_and_shapes_come_out_of_any_mixture_of_rigid_modes() -> None:
    hub = hub_of(free_modes())
    assert hub.mass == pytest.approx(whole.HUB_MASS)
    wanted = [180.0, 150.0, 210.0, 4.0, -6.0, 3.0]
    assert hub.inertia == pytest.approx(wanted, rel=1e-9)
    for point, place in zip(hub.points, POINTS.values(), strict=True):
        assert point.position == pytest.approx(place, abs=1e-12)
    assert [mode.frequency for mode in hub.modes] == [17.0]
    assert hub.modes[0].shapes[1] == pytest.approx(2.0 * BENDING)


def _with_flexible(number: int) -> FreeModes:
    """The hub with ``number`` flexible modes of random shapes."""
    free, random = free_modes(), np.random.default_rng(7)
    shapes = 1e-2 * random.normal(size=(2, 6, number))
    return FreeModes(
        np.append(free.frequency[:6], np.linspace(20.0, 400.0, number)),
        np.full(6 + number, 0.003),
        free.names,
        free.positions,
        np.concatenate([free.shapes[:, :, :6], shapes], axis=2),
    )


def _static_compliance(hub: Hub) -> np.ndarray:
    shapes = np.array([np.ravel(mode.shapes) for mode in hub.modes])
    stiffness = np.array([(2.0 * np.pi * mode.frequency) ** 2 for mode in hub.modes])
    return shapes.T @ (shapes / stiffness[:, None])


def test_modes_left_out_keep_their_static_compliance() -> None:
    modes = _with_flexible(40)
    whole_hub, cut = hub_of(modes), hub_of(modes, count=5)
    assert [mode.frequency for mode in cut.modes[:5]] == pytest.approx(modes.frequency[6:11])
    assert len(cut.modes) == 5 + 12
    assert cut.left_out_from == pytest.approx(modes.frequency[11])
    assert min(mode.frequency for mode in cut.modes[5:]) >= modes.frequency[11]
    assert _static_compliance(cut) == pytest.approx(
        _static_compliance(whole_hub), rel=1e-6, abs=1e-18
    )
    assert {round(mode.damping, 6) for mode in cut.modes[:5]} == {0.003}


def test_few_modes_left_out_are_the_residual_modes_themselves() -> None:
    modes = _with_flexible(9)
    cut = hub_of(modes, count=3)
    assert cut.left_out_from is None
    assert [m.frequency for m in cut.modes] == pytest.approx(modes.frequency[6:], rel=1e-6)
    assert [m.damping for m in cut.modes] == pytest.approx([0.003] * 9, rel=1e-6)


def test_a_scenario_names_its_tables(file: Path, tmp_path: Path) -> None:
    scenario = load_scenario(file)
    craft = scenario.craft
    assert craft is not None
    rows = craft.line_of_sight()
    assert rows.position[0] == pytest.approx(craft.at("payload")[3] + 0.5 * craft.at("root")[0])
    assert rows.position[1] == pytest.approx(craft.at("payload")[4])
    assert scenario.source_of("spacecraft.hub.mass") == "free-free modes of hub.csv"
    whole_again = tmp_path / "again.yaml"
    whole_again.write_text(mv.dump_scenario(scenario))
    assert load_scenario(whole_again) == scenario


def test_a_hub_freed_of_its_clamp_weighs_what_its_clamped_modes_say(tmp_path: Path) -> None:
    """Apparent mass at the root, D_0 + sum p p' (w_k^2 + 2 j z w_k w) / (w_k^2 - w^2 + 2 j z w_k w), with unequal damping."""
    M = rigid_motion_at(np.array([0.2, -0.1, 0.6]))
    M = M.T @ np.diag([300.0, 300.0, 300.0, 150.0, 120.0, 180.0]) @ M
    parts = np.random.default_rng(2).normal(size=(6, 4))
    P = 0.9 * np.linalg.cholesky(M) @ parts / np.linalg.norm(parts, 2)
    f, xi = np.array([9.0, 9.4, 21.0, 30.0]), np.array([0.2, 0.001, 0.1, 0.02])
    hub = hub_of(free_free_modes(ModalModel(f, xi, P, M)))
    place = {
        "position": hub.points[0].position,
        "drive_axis": (0.0, 1.0, 0.0),
        "reference": (1.0, 0.0, 0.0),
    }
    craft = {"hub": hub, "interface": place}
    scenario = scenario_of(whole.FullCraft(), spacecraft=craft)
    at, w_k = np.geomspace(1.0, 60.0, 41), 2.0 * np.pi * f
    w = 2.0 * np.pi * at[:, None]
    shares = (w_k**2 + 2j * xi * w_k * w) / (w_k**2 - w**2 + 2j * xi * w_k * w)
    wanted = np.linalg.inv(M - P @ P.T + np.einsum("ik,mk,jk->mij", P, shares, P))
    assert receiver_of(scenario).accelerance(at) == pytest.approx(
        wanted, abs=1e-9 * np.abs(wanted).max()
    )
    alone = [mode.model_copy(update={"coupling": ()}) for mode in hub.modes]
    diagonal = scenario.with_si({"spacecraft.hub.modes": alone})
    assert (
        np.abs(receiver_of(diagonal).accelerance(at) - wanted).max() > 0.05 * np.abs(wanted).max()
    )
    (tmp_path / "again.yaml").write_text(mv.dump_scenario(scenario))
    assert load_scenario(tmp_path / "again.yaml") == scenario
    with pytest.raises(
        mv.ScenarioError, match="is not positive semi-definite and would add energy"
    ):
        scenario.with_si({"spacecraft.hub.modes.1.coupling": [1e3]})
    with pytest.raises(
        mv.ScenarioError,
        match=r"modes\.1\.coupling: has 2 values; one for each mode before it, 1, is expected",
    ):
        scenario.with_si({"spacecraft.hub.modes.1.coupling": [0.1, 0.2]})


def _changed(modes: FreeModes, **changes: object) -> FreeModes:
    return FreeModes(**{**vars(modes), **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda m: _changed(m, frequency=np.append(np.array([0.5, 0.7, 1.0, 2.0, 3.0, 4.0]), 17.0)), "0 of 7 modes are those of a free"),
        (lambda m: _changed(m, frequency=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 17.0])), "5 of 7 modes"),
        (lambda m: _changed(m, positions=1000.0 * m.positions), "move point"),
        (lambda m: _changed(m, shapes=m.shapes * np.repeat([1000.0, 1.0], 3)[:, None]), "move point"),
    ],
)  # fmt: skip
def test_modes_that_are_no_free_hubs_are_one_sentence(wrong, says) -> None:
    with pytest.raises(ModalError, match=says):
        hub_of(wrong(free_modes()))


@pytest.mark.parametrize(
    ("name", "edit", "says"),
    [
        ("hub.csv", lambda t: t.replace("frequency_hz", "f"), "frequency_hz is missing"),
        ("hub.csv", lambda t: "\n".join(t.splitlines()[:-1]), "has no row for point payload"),
        ("hub.csv", lambda t: t.replace("17.0", "x", 1), "frequency_hz 'x' is not a number"),
        ("los.csv", lambda t: t.replace("payload", "star"), "'star' is not a point of the hub"),
        ("los.csv", lambda t: "", "is not a table of sensitivities"),
        ("craft.yaml", lambda t: t.replace("hub.csv", "none.csv"), "No such file"),
        (
            "craft.yaml",
            lambda t: t.replace("hub.csv", "hub.doc"),
            "is not a source of a hub's modes",
        ),
        (
            "craft.yaml",
            lambda t: t.replace('"hub.csv"', '"hub.csv", "mass": "3 kg"'),
            "does not go with hub.modes",
        ),
        (
            "craft.yaml",
            lambda t: t.replace("0.35 m", "0.36 m"),
            "no point of the hub's modes lies at",
        ),
    ],
)
def test_bad_files_are_one_sentence(file: Path, name: str, edit, says: str) -> None:
    path = file.parent / name
    path.write_text(edit(path.read_text()))
    with pytest.raises(mv.MicrovibError) as caught:
        load_scenario(file)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
