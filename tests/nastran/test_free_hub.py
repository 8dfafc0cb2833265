"""A hub from Nastran: mass properties, shapes and receptances against those of the frame they come from."""

import json

import numpy as np
import pytest
from scipy.linalg import block_diag

import microvib as mv
from microvib.io.file_access import FileAccess
from microvib.io.hub_sources import hub_from
from microvib.io.modal_table import modes_csv
from microvib.io.scenario_file import scenario_of
from microvib.io.spacecraft_files import with_spacecraft
from microvib.model.rigid import rigid_motion_at, tensor
from microvib.structures.modal import ModalError, ModalModel

GRIDS = {"root": 1001, "payload": 20, "tip": 58}


def hub_of(path, units="SI", points=GRIDS):
    given = {
        "spacecraft": {
            "hub": {"modes": path.name, "units": units, "points": points, "damping": "0.5 percent"}
        }
    }
    found = with_spacecraft(given, FileAccess(path.parent), "craft", scenario_of)["spacecraft"][
        "hub"
    ]
    return json.loads(json.dumps(found))


def number(text):
    return float(str(text).split()[0])


@pytest.mark.parametrize("units", ["SI", "mm-t-s", "in-lbf-s"])
def test_mass_center_and_shapes(frame, write_op2, tmp_path, units):
    body = frame(units=units, free=True, local=True)
    hub = hub_of(write_op2(tmp_path / "hub.op2", body, forces=False), units)
    places = body.places
    masses = [(m, inertia, places[g] + arm) for g, m, inertia, arm in body.bodies]
    mass = sum(m for m, *_ in masses)
    center = sum(m * at for m, _, at in masses) / mass
    inertia = sum(
        (
            i + m * ((at - center) @ (at - center) * np.eye(3) - np.outer(at - center, at - center))
            for m, i, at in masses
        ),
        np.zeros((3, 3)),
    )
    assert number(hub["mass"]) == pytest.approx(mass, rel=1e-4)
    wanted = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    assert [number(x) for x in hub["inertia"]] == pytest.approx(
        wanted, rel=1e-3, abs=1e-3 * inertia.max()
    )
    for point, grid in zip(hub["points"], GRIDS.values(), strict=True):
        assert [number(x) for x in point["position"]] == pytest.approx(
            places[grid] - center, abs=1e-4
        )
    frequency, phi = frame(free=True).modes
    assert number(hub["modes"][0]["frequency"]) == pytest.approx(frequency[6], rel=1e-4)
    shape = np.array(hub["modes"][0]["shapes"])
    expected = np.array([phi[frame(free=True).rows(g), 6] for g in GRIDS.values()])
    assert shape * np.sign(shape[2, 0] * expected[2, 0]) == pytest.approx(
        expected, abs=2e-4 * np.abs(expected).max()
    )


def test_what_is_no_free_hub_is_said(frame, write_op2, tmp_path):
    held = write_op2(tmp_path / "held.op2", frame(), forces=False)
    with pytest.raises(
        ModalError, match=r"held\.op2: 0 of 36 modes are those of a free rigid body"
    ):
        hub_of(held)
    free = write_op2(tmp_path / "free.op2", frame(free=True), forces=False)
    with pytest.raises(ModalError, match="points: grid 99 is not in the model"):
        hub_of(free, points={"root": 99})
    other = write_op2(tmp_path / "five.op2", frame(free=True), forces=False, count=5)
    with pytest.raises(ModalError, match=r"five\.op2: 5 of 5 modes are those of a free rigid body"):
        hub_of(other)
    with pytest.raises(mv.ScenarioError, match=r"spacecraft\.hub\.units"):
        hub_of(free, units="mm")
    with pytest.raises(mv.ScenarioError, match=r"spacecraft\.hub\.points"):
        hub_of(free, points=["root"])


def receptance_of(hub, names, frequency):
    """Motions of points (6 each) by loads on them, from mass, inertia and flexible modes."""
    at = [next(k for k, p in enumerate(hub.points) if p.name == name) for name in names]
    rigid = np.vstack([rigid_motion_at(np.array(hub.points[k].position)) for k in at])
    flexible = np.array([np.concatenate([mode.shapes[k] for k in at]) for mode in hub.modes]).T
    mass = block_diag(hub.mass * np.eye(3), tensor(hub.inertia))
    w = 2.0 * np.pi * frequency
    own = np.array([(2.0 * np.pi * mode.frequency) ** 2 for mode in hub.modes]) - w**2
    return (
        rigid @ np.linalg.inv(-(w**2) * mass) @ rigid.T + flexible @ np.diag(1.0 / own) @ flexible.T
    )


def receptance_in(body, grids, frequency):
    """The same from the frame's own matrices, SI, basic frame."""
    K, M = body.matrices
    rows = np.concatenate([np.arange(6) + 6 * body.order[g] for g in grids])
    return np.linalg.inv(K - (2.0 * np.pi * frequency) ** 2 * M)[np.ix_(rows, rows)]


def bulk(path, body):
    """GRID entries of the frame, with the coordinate system of the one that has its own."""
    T = body.turn
    lines = [f"CORD2R*  {5:15d}{0:16d}" + "".join(f"{v:16.9E}" for v in (0.0, 0.0))]
    numbers = [0.0, *T[2], *(T[0] + T[2])]
    lines += ["*       " + "".join(f"{v:16.9E}" for v in numbers[k : k + 4]) for k in (0, 4)]
    for grid in body.ids:
        x, y, z = body.places[grid] / body.scale[0]
        own = 5 if body.local and grid == 20 else 0
        lines += [f"GRID*   {grid:16d}{0:16d}{x:16.9E}{y:16.9E}", f"*       {z:16.9E}{own:16d}"]
    path.write_text("\n".join(lines) + "\nENDDATA\n")


def mixed(body, seed=3):
    """Modes with the rigid ones in another combination, and at tiny frequencies as programs give them."""
    frequency, phi = body.modes
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(6, 6)))
    return np.r_[np.array([0.0, 2e-5, 1e-6, 4e-4, 3e-5, 1e-4]), frequency[6:]], np.hstack(
        [phi[:, :6] @ turn, phi[:, 6:]]
    )


def full_op4(folder, body):
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    K, M = body.matrices
    bulk(folder / "hub.bdf", body)
    op4.write(
        str(folder / "hub.op4"), {"phg": 2.5 * mixed(body)[1], "mgg": M, "kgg": K}, binary=True
    )
    return "hub.op4", 1e-6


def punched(folder, body):
    frequency, phi = mixed(body)
    lines = []
    for k, f in enumerate(frequency):
        lines += ["$TITLE   = FRAME", "$EIGENVECTOR", "$REAL OUTPUT", "$SUBCASE ID =           1"]
        lines.append(f"$EIGENVALUE = {(2 * np.pi * f) ** 2:14.7E}  MODE = {k + 1:5d}")
        for grid in body.ids:
            values = phi[body.rows(grid), k]
            lines.append(f"{grid:10d}{'G':>8}{''.join(f'{v:18.6E}' for v in values[:3])}")
            lines.append(f"{'-CONT-':18}{''.join(f'{v:18.6E}' for v in values[3:])}")
    (folder / "hub.pch").write_text(
        "\n".join(f"{line:72}{n:8d}" for n, line in enumerate(lines, 1)) + "\n"
    )
    bulk(folder / "hub.dat", body)
    return "hub.pch", 2e-4


def reduced_op4(folder, body):
    """A Craig-Bampton model with three boundary grids, as EXTSEOUT leaves it in OP4 and ASM; all of its modes."""
    nastran = pytest.importorskip("pyyeti.nastran")
    K, M, boundary = craig_bampton_of(body)
    uset = nastran.n2p.addgrid(
        None, boundary, "b", 0, np.array([body.places[g] / body.scale[0] for g in boundary]), 0
    )
    nastran.bulk.wtextseout(
        str(folder / "hub"),
        se=101,
        bset=np.arange(18),
        uset=uset,
        spoint1=9001,
        kaa=K,
        maa=M,
        namelist=["kaa", "maa"],
    )
    return "hub.op4", 1e-5


def reduced_pch(folder, body):
    """The same in DMIG entries."""
    K, M, boundary = craig_bampton_of(body)
    dofs = [(g, k) for g in boundary for k in range(1, 7)] + [
        (9001 + k, 0) for k in range(len(K) - 18)
    ]
    lines = []
    for grid in boundary:
        x, y, z = body.places[grid] / body.scale[0]
        lines += [f"GRID*   {grid:16d}{0:16d}{x:16.9E}{y:16.9E}", f"*       {z:16.9E}{0:16d}"]
    for name, A in (("KAAX", K), ("MAAX", M)):
        lines.append(f"{'DMIG':8}{name:8}{0:8d}{6:8d}{2:8d}{0:8d}")
        for j, (grid, direction) in enumerate(dofs):
            lines.append(f"{'DMIG*':8}{name:16}{grid:16d}{direction:16d}")
            lines += [
                f"{'*':8}{g:16d}{d:16d}{f'{A[i, j]:.9E}'.replace('E', 'D'):>16}"
                for i, (g, d) in enumerate(dofs)
                if i >= j
            ]
    (folder / "hub.pch").write_text("\n".join(lines) + "\n")
    return "hub.pch", 1e-4


def craig_bampton_of(body):
    """K and M, boundary first, and its grids: all inner modes, so that nothing is left out."""
    boundary = sorted(GRIDS.values())
    held = np.concatenate([np.arange(6) + 6 * body.order[g] for g in boundary])
    inner = np.setdiff1d(np.arange(6 * len(body.ids)), held)
    K, M = body.matrices
    squares, phi = np.linalg.eigh(
        np.linalg.solve(
            L := np.linalg.cholesky(M[np.ix_(inner, inner)]),
            np.linalg.solve(L, K[np.ix_(inner, inner)]).T,
        )
    )
    assert squares[0] > 0.0
    T = np.zeros((len(K), held.size + inner.size))
    T[held, : held.size] = np.eye(held.size)
    T[np.ix_(inner, range(held.size))] = -np.linalg.solve(
        K[np.ix_(inner, inner)], K[np.ix_(inner, held)]
    )
    T[np.ix_(inner, range(held.size, T.shape[1]))] = np.linalg.solve(L.T, phi)
    k, m = T.T @ K @ T, T.T @ M @ T
    return (k + k.T) / 2, (m + m.T) / 2, boundary


@pytest.mark.parametrize("source", [full_op4, punched, reduced_op4, reduced_pch])
@pytest.mark.parametrize("units", ["SI", "mm-t-s", "in-lbf-s"])
def test_every_source_has_the_receptances_of_the_frame(frame, tmp_path, source, units):
    body = frame(units=units, free=True, local=source in (full_op4, punched))
    name, within = source(tmp_path, body)
    hub = hub_from(
        {"modes": name, "units": units, "points": GRIDS, "damping": 0.0}, FileAccess(tmp_path)
    )
    for f in (0.5, 9.0, 60.0):
        wanted = receptance_in(frame(free=True), GRIDS.values(), f)
        size = np.sqrt(np.abs(np.diag(wanted)))
        off = np.abs(receptance_of(hub, list(GRIDS), f) - wanted) / np.outer(size, size)
        assert off.max() < within
    assert all(mode.damping == 0.0 for mode in hub.modes)


def test_modes_with_the_interface_clamped(frame, write_op2, tmp_path):
    """Craig-Bampton with one point: what an array is read from, freed at its interface."""
    body = frame(units="mm-t-s", local=True)
    write_op2(tmp_path / "clamped.op2", body, mass=True)
    hub = hub_from(
        {"modes": "clamped.op2", "units": "mm-t-s", "interface": 1001, "damping": "0 percent"},
        FileAccess(tmp_path),
    )
    for f in (0.5, 9.0, 60.0):
        wanted = receptance_in(frame(free=True), [1001], f)
        size = np.sqrt(np.abs(np.diag(wanted)))
        assert np.abs(receptance_of(hub, ["root"], f) - wanted).max() < 2e-4 * size.max() ** 2
    cut = hub_from(
        {"modes": "clamped.op2", "units": "mm-t-s", "interface": 1001, "count": 3},
        FileAccess(tmp_path),
    )
    assert len(cut.modes) == 3 + 6
    assert [m.frequency for m in cut.modes[:3]] == pytest.approx(
        [m.frequency for m in hub.modes[:3]]
    )
    assert cut.left_out_from == pytest.approx(hub.modes[3].frequency)
    slow = 0.1 * hub.modes[0].frequency
    assert receptance_of(cut, ["root"], slow) == pytest.approx(
        receptance_of(hub, ["root"], slow), rel=1e-3, abs=1e-9
    )


def test_a_clamped_table_with_the_damping_of_its_modes(tmp_path):
    """One mode about z: freed, its square grows by J / (J - H^2), and its damping ratio by the root of that."""
    model = ModalModel(
        np.array([4.0]),
        np.array([0.02]),
        np.eye(6)[:, 5:] * 3.0,
        np.diag([5.0, 5.0, 5.0, 8.0, 9.0, 12.0]),
    )
    (tmp_path / "one.csv").write_text(modes_csv(model))
    hub = hub_from({"modes": "one.csv", "interface": "yes"}, FileAccess(tmp_path))
    ratio = 1.0 / (1.0 - 3.0**2 / 12.0)
    assert [mode.frequency for mode in hub.modes] == pytest.approx([4.0 * ratio**0.5])
    assert [mode.damping for mode in hub.modes] == pytest.approx([0.02 * ratio**0.5])


def test_what_is_no_source_is_said(frame, tmp_path):
    body = frame(free=True)
    full_op4(tmp_path, body)
    (tmp_path / "hub.bdf").unlink()
    given = {"modes": "hub.op4", "units": "SI", "points": GRIDS}
    with pytest.raises(ModalError, match=r"hub\.op4: does not say where its grids are"):
        hub_from(given, FileAccess(tmp_path))
    reduced_op4(tmp_path, body)
    with pytest.raises(ModalError, match="points: grid 7 is not in the model, which has 3 grids"):
        hub_from({**given, "points": {"root": 7}}, FileAccess(tmp_path))
    (tmp_path / "hub.asm").unlink()
    (tmp_path / "hub.pch").unlink()
    with pytest.raises(ModalError, match="has no geometry"):
        hub_from(given, FileAccess(tmp_path))
    (tmp_path / "empty.pch").write_text("$TITLE\n")
    with pytest.raises(ModalError, match="neither DMIG entries"):
        hub_from({**given, "modes": "empty.pch"}, FileAccess(tmp_path))
    punched(tmp_path, body)
    lines = (tmp_path / "hub.pch").read_text().splitlines()
    kept = [line for line in lines if not line.startswith("        20")]
    (tmp_path / "hub.pch").write_text("\n".join(kept))
    with pytest.raises(ModalError, match="points: the motion of grid 20 is not in the file"):
        hub_from({**given, "modes": "hub.pch"}, FileAccess(tmp_path))
    for key, value, says in (
        ("count", -1, r"spacecraft\.hub\.count: -1 is not allowed"),
        ("damping", 2, r"spacecraft\.hub\.damping: 2 is not allowed"),
        ("mass", "3 kg", r"spacecraft\.hub\.mass: does not go with"),
        ("modes", "hub.txt", r"spacecraft\.hub\.modes: 'hub\.txt' is not a source"),
    ):
        with pytest.raises(mv.ScenarioError, match=says):
            hub_from({**given, key: value}, FileAccess(tmp_path))
