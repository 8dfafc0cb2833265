"""The same frame through every kind of file: frequencies, participation and mass against the full matrices."""

import numpy as np
import pytest

from microvib.io.nastran import read_modal_model
from microvib.structures.deck import import_options
from microvib.structures.modal import ModalError

INTERFACE, HOME = 1001, (0.1, -0.2, 0.3)


def options(units="SI", interface=INTERFACE, drive_axis="y", **more):
    return import_options(
        {"units": units, "interface": interface, "drive_axis": drive_axis, **more}, "test"
    )


def agree(model, expected, tolerance):
    """Frequencies, mass, and participation up to the sign of each mode."""
    frequency, P, M = expected
    s = model.frequency.size
    np.testing.assert_allclose(model.frequency, frequency[:s], rtol=tolerance)
    size = np.sqrt(np.diag(M))
    np.testing.assert_allclose(
        model.mass / np.outer(size, size), M / np.outer(size, size), atol=3 * tolerance
    )
    signs = np.sign((model.participation * P[:, :s] / np.diag(M)[:, None]).sum(axis=0))
    np.testing.assert_allclose(
        model.participation * signs / size[:, None], P[:, :s] / size[:, None], atol=10 * tolerance
    )


ROUTES = {
    "factors": {"factors": True},
    "mass": {"mass": True, "forces": False},
    "forces": {"shapes": False},
}


@pytest.mark.parametrize("units", ["SI", "mm-t-s", "in-lbf-s"])
@pytest.mark.parametrize("route", ROUTES)
def test_op2_three_ways(tmp_path, frame, write_op2, units, route):
    deck = frame(units)
    path = write_op2(tmp_path / "a.op2", deck, count=20, **ROUTES[route])
    agree(read_modal_model(path, options(units)), deck.about(HOME), 1e-6)


def test_forces_of_constraint_hold_with_a_consistent_mass(tmp_path, frame, write_op2):
    deck = frame(consistent=True)
    path = write_op2(tmp_path / "a.op2", deck, count=12, shapes=False)
    agree(read_modal_model(path, options()), deck.about(HOME), 1e-6)


@pytest.mark.parametrize(
    "more", [{"endian": ">"}, {"maximum": True}, {"mass": True, "maximum": True}]
)
def test_op2_byte_order_and_normalisation(tmp_path, frame, write_op2, more):
    deck = frame("mm-t-s")
    path = write_op2(tmp_path / "a.op2", deck, count=8, **more)
    model = read_modal_model(path, options("mm-t-s"))
    agree(model, deck.about(HOME), 1e-6)
    assert any("not mass-normalised" in n for n in model.notes) == ("mass" in more)


@pytest.mark.parametrize("basic", [False, True])
def test_grids_with_output_systems_of_their_own(tmp_path, frame, write_op2, basic):
    deck = frame(local=True)
    path = write_op2(tmp_path / "a.op2", deck, count=8, mass=True, basic=basic)
    agree(read_modal_model(path, options()), deck.about(HOME), 1e-6)


def test_interface_point_and_drive_axis_anywhere(tmp_path, frame, write_op2):
    deck = frame("mm-t-s", local=True)
    path = write_op2(tmp_path / "a.op2", deck, count=10)
    there = (0.4, -0.7, 0.2)
    model = read_modal_model(
        path, options("mm-t-s", [1e3 * v for v in there], drive_axis=[0.0, 3.0, 4.0])
    )
    z = np.array([0.0, 0.6, 0.8])
    turn = np.array([[1.0, 0, 0], np.cross(z, [1.0, 0, 0]), z])
    agree(model, deck.about(there, turn), 1e-6)
    assert model.drive_axis == "z"
    assert model.inertia == pytest.approx(z @ deck.about(there)[2][3:, 3:] @ z, rel=1e-6)
    model = read_modal_model(path, options("mm-t-s", frame=5, drive_axis="x"))
    agree(model, deck.about(HOME, deck.turn), 1e-6)


@pytest.mark.parametrize("units", ["SI", "mm-t-s"])
@pytest.mark.parametrize(
    "layout",
    [{}, {"per_page": 5}, {"per_page": 5, "repeat": False}, {"letter": "D"}, {"weight": False}],
)
def test_f06(tmp_path, frame, write_f06, units, layout):
    deck = frame(units)
    path = write_f06(tmp_path / "a.f06", deck, count=13, **layout)
    model = read_modal_model(path, options(units, interface=list(deck.at)))
    expected = deck.about(HOME)
    if "weight" in layout:  # the A-set leaves out what is on the clamped point
        m, inertia = deck.bodies[-1][1:3]
        expected[2][:] -= np.block([[m * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), inertia]])
        assert any("clamped points is missing" in n for n in model.notes)
    agree(model, expected, 5e-6)


def test_f06_about_a_grid(tmp_path, frame, write_f06):
    deck = frame("mm-t-s")
    path = write_f06(tmp_path / "a.f06", deck, count=6, reference=INTERFACE)
    model = read_modal_model(path, options("mm-t-s"))
    np.testing.assert_allclose(
        np.abs(model.participation), np.abs(deck.about(HOME)[1][:, :6]), rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize("tables", [("effective",), ("fractions",)])
def test_effective_mass_gives_the_drive_axis_only(tmp_path, frame, write_f06, tables):
    deck = frame("mm-t-s")
    path = write_f06(tmp_path / "a.f06", deck, count=10, tables=tables)
    model = read_modal_model(path, options("mm-t-s", interface=[0, 0, 0]))
    _, P, M = deck.about((0, 0, 0))
    np.testing.assert_allclose(model.effective[4], P[4, :10] ** 2, rtol=1e-5, atol=1e-9)
    assert model.inertia == pytest.approx(M[4, 4], rel=1e-6)
    assert not model.spatial
    assert any("magnitudes only" in n for n in model.notes)
    assert model.array().inertia == model.inertia


@pytest.mark.parametrize("units", ["SI", "mm-t-s"])
def test_ansys(tmp_path, frame, write_ansys, units):
    deck = frame(units)
    path = write_ansys(tmp_path / "solve.out", deck, count=9)
    agree(read_modal_model(path, options(units, interface=list(deck.at))), deck.about(HOME), 5e-6)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("last", [True, False])
def test_craig_bampton_against_the_full_model(tmp_path, frame, craig_bampton, binary, last):
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    deck = frame("mm-t-s")
    K, M = craig_bampton(deck, 15)
    order = np.r_[6:21, :6] if last else np.arange(21)
    path = tmp_path / "cb.op4"
    op4.write(
        str(path), {"kaa": K[np.ix_(order, order)], "maa": M[np.ix_(order, order)]}, binary=binary
    )
    agree(read_modal_model(path, options("mm-t-s")), deck.about(HOME), 1e-8)


def test_shapes_and_matrices_in_op4(tmp_path, frame):
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    deck = frame("mm-t-s", local=True)
    K, M = deck.matrices
    path = tmp_path / "full.op4"
    op4.write(
        str(path),
        {"phig": 3.0 * deck.modes[1][:, :9], "mgg": M, "kgg": K, "rbg": deck.rigid},
        binary=True,
    )
    agree(
        read_modal_model(path, options("mm-t-s", interface=list(deck.at))), deck.about(HOME), 1e-8
    )


def test_mass_matrix_in_op4_beside_op2(tmp_path, frame, write_op2):
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    deck = frame("mm-t-s", local=True)
    path = write_op2(tmp_path / "a.op2", deck, count=9, forces=False)
    op4.write(str(tmp_path / "mgg.op4"), {"mgg": deck.matrices[1]}, binary=True)
    agree(read_modal_model(path, options("mm-t-s", mass="mgg.op4")), deck.about(HOME), 1e-6)


def big(card, *fields):
    """Large-field card, four fields of 16 columns a line."""
    lines = [fields[k : k + 4] for k in range(0, len(fields), 4)]
    body = [
        "".join(f"{v:>16.9E}" if isinstance(v, float) else f"{v:>16}" for v in line)
        for line in lines
    ]
    return [f"{card + '*':8}{body[0]}", *(f"{'*':8}{line}" for line in body[1:])]


def dmig(path, deck, K, M, count):
    """What EXTSEOUT(DMIGPCH) punches: boundary grid, scalar points of the modes, KAAX and MAAX."""
    out = ["$ BOUNDARY GRID DATA", *big("GRID", INTERFACE, 0, *map(float, deck.at), 0)]
    dofs = [(INTERFACE, k) for k in range(1, 7)] + [(9001 + k, 0) for k in range(count)]
    for name, A in (("KAAX", K), ("MAAX", M)):
        out.append(f"{'DMIG':8}{name:8}{0:8d}{6:8d}{2:8d}{0:8d}")
        for j, (grid, direction) in enumerate(dofs):
            out.append(f"{'DMIG*':8}{name:16}{grid:16d}{direction:16d}")
            out += [
                f"{'*':8}{g:16d}{d:16d}{f'{A[i, j]:.9E}'.replace('E', 'D'):>16}"
                for i, (g, d) in enumerate(dofs)
                if i >= j
            ]
    path.write_text("\n".join(out) + "\n")
    return path


def test_punched_craig_bampton(tmp_path, frame, craig_bampton):
    deck = frame("mm-t-s")
    path = dmig(tmp_path / "ext.pch", deck, *craig_bampton(deck, 7), 7)
    agree(read_modal_model(path, options("mm-t-s")), deck.about(HOME), 1e-6)
    agree(
        read_modal_model(path, options("mm-t-s", interface=[0, 0, 0])), deck.about((0, 0, 0)), 1e-6
    )


def spcf(path, deck, count, maximum=False):
    """SPCFORCES(PUNCH)=ALL of a run of modes."""
    f, phi = deck.modes
    phi = phi / np.abs(phi).max(axis=0) if maximum else phi
    forces = deck.forces(phi, f)[deck.rows(INTERFACE)]
    out = []
    for k in range(count):
        out += ["$TITLE   = FRAME", "$SUBTITLE=", "$LABEL   =", "$SPCF", "$REAL OUTPUT", "$SUBCASE ID =           1",
                f"$EIGENVALUE = {(2 * np.pi * f[k]) ** 2:14.7E}  MODE = {k + 1:5d}",
                f"{INTERFACE:10d}{'G':>8}{''.join(f'{v:18.6E}' for v in forces[:3, k])}",
                f"{'-CONT-':18}{''.join(f'{v:18.6E}' for v in forces[3:, k])}"]  # fmt: skip
    path.write_text("\n".join(f"{line:72}{n:8d}" for n, line in enumerate(out, 1)) + "\n")
    return path


@pytest.mark.parametrize("maximum", [True, False])
@pytest.mark.parametrize("grid", [True, False])
def test_punched_forces_of_constraint(tmp_path, frame, write_f06, grid, maximum):
    deck = frame("mm-t-s")
    path = spcf(tmp_path / "modes.pch", deck, 8, maximum)
    write_f06(
        tmp_path / "run.f06", deck, count=10, grdpnt=INTERFACE if grid else 0, maximum=maximum
    )
    model = read_modal_model(
        path, options("mm-t-s", INTERFACE if grid else list(deck.at), mass="run.f06")
    )
    agree(model, deck.about(HOME), 5e-6)


def test_punched_forces_that_are_not_those_of_the_listing(tmp_path, frame, write_f06):
    deck = frame("mm-t-s")
    write_f06(tmp_path / "run.f06", deck, count=8, grdpnt=INTERFACE)
    lines = spcf(tmp_path / "modes.pch", deck, 8).read_text().splitlines()
    other = [line.replace("MODE =     3", "MODE =     9") for line in lines]
    for rows, told in (
        (lines + lines, "forces of constraint of mode 1 twice"),
        (lines[:18] + lines[27:], "lacks mode 3, which run.f06 has"),
        (other, "lacks mode 3"),
        (
            [line.replace("MODE =     8", "MODE =    20") for line in lines],
            "lacks mode 8|mode 20 is not that of run.f06",
        ),
        (
            spcf(tmp_path / "b.pch", frame(), 8)
            .read_text()
            .replace("E+01  MODE", "E+02  MODE")
            .splitlines(),
            "is not that of run",
        ),
    ):
        (tmp_path / "modes.pch").write_text("\n".join(rows) + "\n")
        with pytest.raises(ModalError, match=told):
            read_modal_model(tmp_path / "modes.pch", options("mm-t-s", INTERFACE, mass="run.f06"))
