"""Files of other Nastrans, and models with parts that are loose, massless or only partly held: read, or refused by name."""

from pathlib import Path

import numpy as np
import pytest

from microvib.io.nastran import read_modal_model
from microvib.io.nastran.free import read_free
from microvib.structures.deck import import_options
from microvib.structures.modal import ModalError

INTERFACE, HOME = 1001, (0.1, -0.2, 0.3)
REAL = Path(__file__).parents[2].parent / "shared" / "real" / "nastran"


def options(units="SI", interface=INTERFACE, drive_axis="y", **more):
    return import_options(
        {"units": units, "interface": interface, "drive_axis": drive_axis, **more}, "test"
    )


def same(a, b, tolerance=1e-6):
    np.testing.assert_allclose(a.frequency, b.frequency, rtol=tolerance)
    np.testing.assert_allclose(a.mass, b.mass, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(np.abs(a.participation), np.abs(b.participation), atol=1e-4)


@pytest.mark.parametrize("endian", ["<", ">"])
@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize(
    "route", [{"factors": True}, {"mass": True, "forces": False}, {"shapes": False}]
)
def test_the_table_of_grids_of_siemens_nastran(tmp_path, frame, write_op2, endian, local, route):
    deck = frame("mm-t-s", local=local)
    usual = write_op2(tmp_path / "a.op2", deck, count=12, endian=endian, **route)
    other = write_op2(tmp_path / "b.op2", deck, count=12, endian=endian, siemens=True, **route)
    same(read_modal_model(other, options("mm-t-s")), read_modal_model(usual, options("mm-t-s")))


def test_a_table_of_grids_of_another_width_is_told(tmp_path, frame, write_op2):
    path = write_op2(tmp_path / "a.op2", frame(), count=4)
    data = path.read_bytes()
    n = len(frame().ids)
    record = np.int32(16 * n).tobytes()
    at = data.index(record, data.index(b"BGPDT"))
    # one grid fewer in the table than in the list of their numbers
    cut = (
        data[: at - 8]
        + np.int32(4 * n - 4).tobytes()
        + data[at - 4 : at]
        + np.int32(16 * n - 16).tobytes()
    )
    cut += (
        data[at + 4 : at + 4 + 16 * n - 16]
        + np.int32(16 * n - 16).tobytes()
        + data[at + 8 + 16 * n :]
    )
    path.write_bytes(cut)
    with pytest.raises(ModalError, match=r"words for each of 7 grids in BGPDT; 4 or 12 are read"):
        read_modal_model(path, options())


@pytest.mark.parametrize("route", [{"factors": True}, {"mass": True}, {"shapes": False}])
def test_a_loose_grid_is_no_interface(tmp_path, frame, write_op2, route):
    path = write_op2(
        tmp_path / "a.op2", frame(), count=12, loose=7777, **(route if "mass" not in route else {})
    )
    with pytest.raises(
        ModalError,
        match=rf"interface: grid 7777 is not constrained, but {INTERFACE}: it carries no forces",
    ):
        read_modal_model(path, options(interface=7777))
    read_modal_model(path, options())


def test_a_loose_grid_is_no_point_of_a_hub(tmp_path, frame, write_op2):
    path = write_op2(tmp_path / "a.op2", frame(free=True), forces=False, loose=7777)
    with pytest.raises(
        ModalError, match="points: grid 7777 has no motion in any mode: it is disconnected"
    ):
        read_free(path, [7777])


def augmented(text, words):
    """A listing whose tables of eigenvalues have a second line of title."""
    title = next(line for line in text.splitlines() if "R E A L   E I G E N V A L U E S" in line)
    return text.replace(title, f"{title}\n{'':41}({words} AUGMENTATION OF RESIDUAL VECTORS)")


def test_a_listing_with_residual_vectors(tmp_path, frame, write_f06):
    plain = write_f06(tmp_path / "a.f06", frame("mm-t-s"), count=20, per_page=7)
    more = tmp_path / "b.f06"
    more.write_text(augmented(plain.read_text(), "BEFORE"))
    same(
        read_modal_model(more, options("mm-t-s", [100.0, -200.0, 300.0])),
        read_modal_model(plain, options("mm-t-s", [100.0, -200.0, 300.0])),
    )


@pytest.mark.parametrize("participation_of", ["BEFORE", "AFTER"])
def test_of_two_tables_that_of_the_participation_is_taken(
    tmp_path, frame, write_f06, participation_of
):
    """With residual vectors there are more modes after the augmentation than before."""
    short = write_f06(tmp_path / "short.f06", frame(), count=15)
    long = write_f06(tmp_path / "long.f06", frame(), count=20)
    before, after = (augmented(p.read_text(), w) for p, w in ((short, "BEFORE"), (long, "AFTER")))

    def eigenvalues(text):
        lines = text.splitlines()
        first = next(k for k, line in enumerate(lines) if "R E A L   E I G E N" in line)
        last = next(k for k in range(first + 5, len(lines)) if not lines[k].strip())
        return lines[:first], lines[first:last], lines[last:]

    kept = before if participation_of == "BEFORE" else after
    top, _, rest = eigenvalues(kept)
    path = tmp_path / "both.f06"
    path.write_text(
        "\n".join([*top, *eigenvalues(before)[1], "", *eigenvalues(after)[1], *rest]) + "\n"
    )
    model = read_modal_model(path, options(interface=[0.0, 0.0, 0.0]))
    assert model.frequency.size == (15 if participation_of == "BEFORE" else 20)
    assert any("residual vectors" in note for note in model.notes)


def reduced(frame, craig_bampton, folder, dropped=()):
    """A Craig-Bampton model of two boundary grids in OP4, ASM and PCH, without some directions of the second."""
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    K, M = craig_bampton(frame, 10)
    keep = np.setdiff1d(np.arange(len(K)), [6 + d - 1 for d in dropped])
    n = len(K) - 12
    (first, second) = sorted((INTERFACE, *frame.also))
    lines = [
        "SEBULK,101,EXTOP4,,MANUAL,,,101",
        "SECONCT,101,0,,NO",
        f",{first},{first},{second},{second}",
    ]
    lines += [f",9001,THRU,{9000 + n},9001,THRU,{9000 + n}", f"SPOINT,9001,THRU,{9000 + n}"]
    for g in (first, second):
        lines.append(f"GRID,{g},,{','.join(f'{x:.6f}' for x in frame.places[g])}")
    (folder / "cb.asm").write_text("\n".join(lines) + "\n")
    rest = "".join(str(d) for d in range(1, 7) if d not in dropped)
    extrn = [f"{first:8d}{123456:8d}", f"{second:8d}{rest:>8}"] + [
        f"{9001 + k:8d}{0:8d}" for k in range(n)
    ]
    rows = ["".join(extrn[k : k + 4]) for k in range(0, len(extrn), 4)]
    (folder / "cb.pch").write_text(
        "\n".join([f"EXTRN   {rows[0]}", *(f"        {row}" for row in rows[1:])]) + "\n"
    )
    op4.write(str(folder / "cb.op4"), {"kaa": K[np.ix_(keep, keep)], "maa": M[np.ix_(keep, keep)]})
    return folder / "cb.op4"


def test_directions_that_a_boundary_lacks_are_named(tmp_path, frame, craig_bampton):
    deck = frame(also=(20,))
    path = reduced(deck, craig_bampton, tmp_path)
    assert read_modal_model(path, options(interface=[0.0, 0.0, 0.0])).frequency.size == 10
    path = reduced(deck, craig_bampton, tmp_path, dropped=(2, 5))
    with pytest.raises(
        ModalError, match=r"lacks directions of 1 grids \(grid 1001: y, ry\).*BSET1,123456"
    ):
        read_modal_model(path, options(interface=[0.0, 0.0, 0.0]))
    with pytest.raises(
        ModalError, match=r"points: the motion of grid 1001 is not in the file in y, ry"
    ):
        read_free(path, [1001])
    assert read_free(path, [20])[2].shape == (1, 6, 20)


def test_directions_without_mass_follow_statically(tmp_path, frame, craig_bampton):
    """A hub whose boundary has no rotary inertia has the frequencies of one with next to none."""
    from microvib.io.nastran import free

    deck = frame(also=(20,), free=True)
    K, M = deck.matrices
    n = len(K)
    names = [(int(g), d) for g in deck.ids for d in range(1, 7)]
    massless = [k for k, (g, d) in enumerate(names) if g == INTERFACE and d > 3]
    light, none = M.copy(), M.copy()
    for A in (light, none):
        A[massless, :] = A[:, massless] = 0.0
    light[massless, massless] = 1e-9 * np.diag(M)[massless]
    T = free._massive_motions(K, none, names, np.arange(n))
    from scipy.linalg import eigh

    expected = eigh(K, light, eigvals_only=True)[: T.shape[1]]
    found = eigh(T.T @ K @ T, T.T @ none @ T, eigvals_only=True)
    assert T.shape == (n, n - 3)
    np.testing.assert_allclose(found[6:30], expected[6:30], rtol=1e-5)
    loose = K.copy()
    loose[massless[0], :] = loose[:, massless[0]] = 0.0
    with pytest.raises(
        ModalError, match=rf"neither mass nor stiffness for a motion in rx of grid {INTERFACE}"
    ):
        free._massive_motions(loose, none, names, np.arange(n))


real = pytest.mark.skipif(not REAL.is_dir(), reason="the files of others are not here")


@real
def test_a_real_file_of_siemens_nastran():
    path = REAL / "pn_mwe_s-solution_1.op2"
    model = read_modal_model(path, options("mm-kg-s", 1))
    assert model.frequency == pytest.approx([89.560745, 89.560745, 1044.7596], rel=1e-6)
    assert model.participation[0] ** 2 == pytest.approx([0.0, 0.0, 5.056303], abs=1e-5)
    assert sorted(model.participation[1] ** 2)[1:] == pytest.approx([0.07077, 4.97312], abs=1e-4)
    assert model.mass[0, 0] == pytest.approx(5.076652, rel=1e-6)
    with pytest.raises(ModalError, match="grid 2 is not constrained"):
        read_modal_model(path, options("mm-kg-s", 2))


@real
def test_a_real_listing_with_residual_vectors():
    model = read_modal_model(
        REAL / "misams_SOL103_response.f06", options("mm-t-s", [0.0, 0.0, 0.0])
    )
    assert model.frequency.size == 581
    assert model.frequency[0] == pytest.approx(91.29278)
    assert model.participation[:2, 0] ** 2 / np.diag(model.mass)[:2] == pytest.approx(
        [3.077326e-3, 0.1434768], rel=1e-5
    )


@real
def test_a_real_boundary_with_some_directions_of_a_grid():
    with pytest.raises(ModalError, match=r"grid 475: x, z, rx, ry, rz"):
        read_modal_model(REAL / "reduced_bset_notall6.op4", options("in-lbf-s", 373))
