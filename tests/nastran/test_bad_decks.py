"""Each way in which a deck can be wrong is named in one sentence; what is only doubtful is said."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microvib.io.nastran import read_modal_model
from microvib.io.nastran.op2 import read_vectors
from microvib.structures.deck import Deck, import_options, modal_model
from microvib.structures.modal import ModalError

INTERFACE, HOME = 1001, (0.1, -0.2, 0.3)


def options(units="SI", interface=INTERFACE, drive_axis="y", **more):
    return import_options(
        {"units": units, "interface": interface, "drive_axis": drive_axis, **more}, "test"
    )


@pytest.fixture
def deck(frame):
    f, P, M = frame().about((0, 0, 0))
    return Deck(f[:9], P[:, :9], M, grids={INTERFACE: np.array(HOME), 7: np.zeros(3)})


def refused(path, words, given=None):
    with pytest.raises(ModalError, match=words) as caught:
        read_modal_model(path, given or options())
    assert "\n" not in str(caught.value)
    assert str(path.parent) in str(caught.value)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"units": "mm"}, "units: 'mm' is not allowed; unit system of the deck: SI, mm-t-s"),
        ({"drive_axis": "w"}, "drive_axis: 'w' is not allowed"),
        (
            {"interface": [1, 2]},
            "interface: .* is not allowed; interface point: a grid id, or three",
        ),
        ({"damping": "3"}, "damping: '3' is not allowed; modal damping ratio"),
        ({"colour": 1}, "colour: unknown key; allowed for an import are units"),
    ],
)
def test_options_are_checked(given, words):
    with pytest.raises(ModalError, match=words):
        options(**given)


def test_missing_options_are_named():
    with pytest.raises(
        ModalError, match=r"units: missing.*\n.*interface: missing.*\n.*drive_axis: missing"
    ):
        import_options({}, "my.yaml")


def test_free_model_is_refused(tmp_path, frame, write_op2, write_f06):
    free = frame(free=True)
    refused(
        write_op2(tmp_path / "a.op2", free, count=12, mass=True, forces=False),
        "grid 1001 moves in mode 1|rigid-body modes",
    )
    path = write_f06(tmp_path / "a.f06", free, count=12)
    refused(
        path,
        "6 of 12 modes are rigid-body modes .* the model is free",
        options(interface=[0, 0, 0]),
    )


def test_mechanism_is_refused(deck):
    with pytest.raises(
        ModalError, match=r"1 of 9 modes are rigid-body modes .* mechanism or a disconnected part"
    ):
        modal_model(replace(deck, frequency=np.r_[1e-5, deck.frequency[1:]]), options())


def test_slow_free_body_is_refused_by_its_gap(deck):
    with pytest.raises(ModalError, match="6 of 9 modes are rigid-body modes"):
        modal_model(replace(deck, frequency=np.r_[[0.002] * 6, 1.0, 2.0, 3.0]), options())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda M: M + np.diag([0, 0, 0, 0, 0, 1.0], 0) * 0 + np.eye(6, k=3) * 5.0, "not symmetric"),
        (lambda M: M - np.diag([0, 0, 0, 0, 2 * M[4, 4], 0]), "must not be negative"),
        (lambda M: M + 3 * M[4, 4] * (np.eye(6)[:, [3]] @ np.eye(6)[[4]] + np.eye(6)[:, [4]] @ np.eye(6)[[3]]), "negative eigenvalue"),
        (lambda M: M * np.nan, "not finite"),
        (lambda M: 0.5 * M, "hold more than the mass of the rigid body, .* % of it in"),
    ],
)  # fmt: skip
def test_mass_that_is_none_is_refused(deck, change, words):
    with pytest.raises(ModalError, match=words):
        modal_model(replace(deck, mass=change(deck.mass)), options())


def test_interface_point_not_in_the_model(deck, tmp_path, frame, write_f06):
    with pytest.raises(
        ModalError, match="interface: grid 99 is not in the model, which has 2 grids from 7 to 1001"
    ):
        modal_model(deck, options(interface=99))
    path = write_f06(tmp_path / "a.f06", frame(), count=3)
    refused(path, "interface: the file does not say where grid 1001 is")


def test_frame_not_in_the_model(deck):
    with pytest.raises(
        ModalError, match="frame: rectangular coordinate system 4 is not in the file; it has none"
    ):
        modal_model(deck, options(frame=4))
    with pytest.raises(ModalError, match="is not a direction"):
        modal_model(deck, options(drive_axis=[0, 0, 0]))


def test_drive_axis_without_inertia(deck):
    one = np.diag([0, 0, 0, 0, 0, 1.0])
    with pytest.raises(ModalError, match="no moment of inertia about the drive axis"):
        modal_model(
            replace(deck, mass=one, participation=0 * deck.participation),
            options(interface=[0, 0, 0]),
        )


def said(model, words):
    assert any(words in note for note in model.notes), model.notes


def test_what_is_doubtful_is_said(deck):
    said(
        modal_model(
            replace(deck, mass=1000 * deck.mass, participation=deck.participation * 1000**0.5),
            options(),
        ),
        "The mass is",
    )
    said(modal_model(deck, options("mm-t-s")), "radius of gyration")
    said(modal_model(replace(deck, frequency=deck.frequency * 1e4), options()), "highest frequency")
    said(modal_model(deck, options()), "less than 90 %")
    still = replace(deck, mass=np.diag(np.diag(deck.mass)), participation=0.1 * deck.participation)
    still.participation[4] = 1e-6
    said(modal_model(still, options(interface=[0, 0, 0])), "No mode moves about the drive axis")
    flat = Deck(
        deck.frequency[:5],
        0.1 * np.diag([0, 0, 1, 1, 1, 0.0])[:, :5],
        np.diag([0, 0, 20.0, 5.0, 5.0, 0]),
    )
    said(modal_model(flat, options(interface=[0, 0, 0])), "no mass in Fx, Fy, Mz")
    uneven = replace(deck, mass=deck.mass + np.diag([9.0, 0, 0, 0, 0, 0]))
    said(modal_model(uneven, options(interface=[0, 0, 0])), "mass differs by direction")
    assert not any("?" in note for note in modal_model(deck, options()).notes)


def test_a_little_too_much_by_rounding_is_mended(frame):
    f, P, M = frame().about(HOME)
    whole = Deck(f, P, P @ P.T * (1 - 2e-7), reference=HOME)
    model = modal_model(whole, options(interface=list(HOME)))
    said(model, "rounding")
    assert model.array().J_h >= 0.0


def test_wrong_kinds_of_files(tmp_path, frame, write_op2, write_f06, write_ansys):
    text = write_f06(tmp_path / "a.f06", frame(), count=3)
    binary = write_op2(tmp_path / "a.op2", frame(), count=3)
    refused(text.rename(tmp_path / "b.op2"), "is not an OP2 file")
    refused(binary.rename(tmp_path / "b.f06"), "no table of real eigenvalues")
    (tmp_path / "c.op4").write_text("no matrices here\n")
    refused(tmp_path / "c.op4", "corrupt or truncated|is not an OP4 file|holds no matrices")
    (tmp_path / "d.op2").write_bytes(b"")
    refused(tmp_path / "d.op2", "is empty")
    refused(tmp_path / "none.op2", "cannot be read")
    refused(tmp_path / "none.bdf", "'.bdf' is not known; modes are read from .csv, .op2")
    (tmp_path / "e.pch").write_text("$TITLE = X\n")
    refused(tmp_path / "e.pch", "neither DMIG entries")
    with pytest.raises(ModalError, match="give units, interface, drive_axis"):
        read_modal_model(binary if binary.exists() else tmp_path / "b.f06")


def test_op2_without_what_is_needed(tmp_path, frame, write_op2):
    deck = frame()
    refused(
        write_op2(tmp_path / "a.op2", deck, count=4, lama=False), "no table of eigenvalues .LAMA."
    )
    refused(
        write_op2(tmp_path / "b.op2", deck, count=4, forces=False, shapes=False),
        "has no eigenvectors; ask for SPCFORCES",
    )
    refused(
        write_op2(tmp_path / "c.op2", deck, count=4, forces=False),
        "eigenvectors, but no mass matrix and no forces",
    )
    refused(
        write_op2(tmp_path / "d.op2", deck, count=4, mass=True, shapes=False),
        "no eigenvectors .OUG.",
    )
    refused(write_op2(tmp_path / "e.op2", deck, count=4, geometry=False), "no geometry")
    refused(write_op2(tmp_path / "f.op2", deck, count=4, weight=False), "no rigid-body mass")
    refused(
        write_op2(tmp_path / "g.op2", deck, count=4),
        "grid 99 is not in the model",
        options(interface=99),
    )
    refused(
        write_op2(tmp_path / "h.op2", deck, count=4, mass=True),
        "grid 7 moves in mode",
        options(interface=7),
    )


def test_model_that_is_held_elsewhere(tmp_path, frame, write_op2):
    path = write_op2(tmp_path / "a.op2", frame(also=(31,)), count=4)
    refused(path, "grid 31 is constrained, too .1 grids beside 1001.")


@pytest.mark.parametrize("shapes", [True, False])
@pytest.mark.parametrize("route", [{}, {"factors": True}, {"mass": True}])
def test_another_grid_than_the_one_that_is_held(tmp_path, frame, write_op2, route, shapes):
    if shapes or "mass" not in route:
        path = write_op2(tmp_path / "a.op2", frame(), shapes=shapes, **route)
        with pytest.raises(
            ModalError, match=r"interface: grid 58 (moves in mode \d|is not constrained, but 1001)"
        ):
            read_modal_model(path, options(interface=58))


def test_mass_matrix_of_another_model(tmp_path, frame, write_op2):
    deck = frame()
    path = write_op2(
        tmp_path / "a.op2", deck, count=4, extra={"MGG": np.diag(np.arange(1.0, 43.0))}
    )
    refused(path, "not orthogonal in the mass matrix")
    path = write_op2(tmp_path / "b.op2", deck, count=4, extra={"MGG": np.eye(12)})
    refused(path, "mass matrix is .12, 12., but the model has 42")


def test_truncated_files_never_pass_for_whole_ones(tmp_path, frame, write_op2, write_f06):
    deck = frame("mm-t-s")
    for name, path in (
        ("a.op2", write_op2(tmp_path / "w.op2", deck, count=4)),
        ("a.f06", write_f06(tmp_path / "w.f06", deck, count=4)),
    ):
        data = path.read_bytes()
        whole = read_modal_model(path, options("mm-t-s", list(deck.at)))
        for part in np.linspace(0.02, 0.98, 25):
            (tmp_path / name).write_bytes(data[: int(part * len(data))])
            try:
                model = read_modal_model(tmp_path / name, options("mm-t-s", list(deck.at)))
            except ModalError:
                continue
            np.testing.assert_allclose(model.frequency, whole.frequency)
            np.testing.assert_allclose(np.diag(model.mass), np.diag(whole.mass), rtol=1e-6)


def test_punch_that_breaks_off(tmp_path, frame, write_f06):
    lines = [f"{'$SPCF':80}", f"{'$EIGENVALUE =  2.0000000E+02  MODE =     1':80}"]
    lines.append(f"{INTERFACE:10d}{'G':>8}{1.0:18.6E}{2.0:18.6E}{3.0:18.6E}{1:8d}")
    (tmp_path / "a.pch").write_text("\n".join(lines))
    write_f06(tmp_path / "run.f06", frame(), count=2)
    refused(
        tmp_path / "a.pch",
        "has 3 of the six forces of constraint of mode 1",
        options(interface=list(HOME), mass="run.f06"),
    )
    refused(tmp_path / "a.pch", "give the F06 of the run")
    refused(
        tmp_path / "a.pch",
        "forces of constraint are on grid 1001, not on 7",
        options(interface=7, mass="run.f06"),
    )
    refused(tmp_path / "a.pch", "No such file", options(mass="none.f06"))


def test_listing_without_what_is_needed(tmp_path, frame, write_f06, write_ansys):
    deck, origin = frame(), options(interface=[0, 0, 0])
    refused(
        write_f06(tmp_path / "a.f06", deck, count=4, weight=False, free=False),
        "no rigid-body mass",
        origin,
    )
    refused(write_f06(tmp_path / "b.f06", deck, count=4, tables=()), "ask for MEFFMASS", origin)
    magnitudes = write_f06(tmp_path / "c.f06", deck, count=4, tables=("effective",))
    refused(magnitudes, "magnitudes of effective mass only", options(interface=list(HOME)))
    refused(
        write_ansys(tmp_path / "d.out", deck, count=4, mass=False), "precise mass summary", origin
    )
    refused(
        write_ansys(tmp_path / "e.out", deck, count=4, directions=("X", "ROTZ")),
        "direction Y, Z, ROTX, ROTY",
        origin,
    )


def test_weight_units_are_noticed_and_mended(tmp_path, frame, write_f06):
    """A deck in inches whose densities are weights: the weight generator does not know PARAM,WTMASS."""
    deck = frame("in-lbf-s")
    path = write_f06(tmp_path / "a.f06", deck, count=6, scaled=386.089)
    whole, clamped = deck.about(HOME)[2][0, 0], deck.bodies[-1][1]
    said(
        read_modal_model(path, options("in-lbf-s", list(deck.at))),
        f"{386.089 * whole / (whole - clamped):.4g} times the mass",
    )
    model = read_modal_model(path, options("in-lbf-s", list(deck.at), wtmass=1 / 386.089))
    np.testing.assert_allclose(np.diag(model.mass), np.diag(deck.about(HOME)[2]), rtol=1e-5)


def test_craig_bampton_that_is_none(tmp_path, frame, craig_bampton):
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    K, M = craig_bampton(frame("mm-t-s"), 8)

    def write(name, K, M):
        op4.write(str(tmp_path / name), {"kaa": K, "maa": M}, binary=True)
        return tmp_path / name

    given = options("mm-t-s")
    grounded = K.copy()
    grounded[:6, :6] += 1e3 * np.diag([1.0, 1, 1, 1e6, 1e6, 1e6])
    refused(write("a.op4", grounded, M), "constrained other than at its boundary", given)
    mixed = K.copy()
    mixed[2, 9] = mixed[9, 2] = np.abs(K[6:, 6:]).max()
    refused(write("b.op4", mixed, M), "couples boundary and modes", given)
    refused(
        write("c.op4", K + np.triu(np.ones_like(K), 1) * K.max(), M),
        "not symmetric|are a boundary",
        given,
    )
    full = np.random.default_rng(0).normal(size=K.shape)
    refused(write("d.op4", full @ full.T, M), "are a boundary beside mass-normalised modes", given)
    refused(
        write("e.op4", K, M),
        "has no geometry; give the interface as the id",
        options("mm-t-s", [0, 0, 0]),
    )
    op4.write(str(tmp_path / "f.op4"), {"bxx": K}, binary=True)
    refused(tmp_path / "f.op4", "holds BXX; expected KAA and MAA", given)


def genuine(name):
    """A file of a real run that the library brings with its own tests, where it is installed."""
    spec = importlib.util.find_spec("pyyeti")
    path = Path(spec.origin).parent / "tests" / name if spec else Path(name)
    return path if path.is_file() else pytest.skip("the library's test files are not installed")


def test_real_free_model_is_refused():
    with pytest.raises(ModalError, match="of 278 modes are rigid-body modes"):
        read_modal_model(genuine("nas2cam_extseout/full.op2"), options("mm-t-s", 3))
    with pytest.raises(ModalError, match="of 18 modes are rigid-body modes"):
        read_modal_model(genuine("nastran_op2_data/rdop2gpwg_1.op2"), options("SI", 1))


def test_vectors_of_a_real_file_are_those_that_the_library_reads():
    op2 = pytest.importorskip("pyyeti.nastran.op2")
    path = genuine("nas2cam_extseout/full.op2")
    with op2.OP2(str(path)) as file:
        ours = read_vectors(file, "OUGV1", "<4")
        theirs = file.rdop2oug("OUGV1")
    assert ours.rows == [tuple(row) for row in theirs.index]
    np.testing.assert_array_equal(ours.values, theirs.to_numpy())


def test_real_superelement_has_the_mass_that_its_listing_prints():
    """EXTSEOUT model on four corner grids; mass of the G-set from the weight check of the same run (its F06)."""
    model = read_modal_model(
        genuine("nas2cam_extseout/inboard.op4"), options("mm-kg-s", [0, 0, 0], drive_axis="x")
    )
    printed = {
        (0, 0): 1.755052,
        (0, 4): 2.632578e2,
        (3, 3): 1.148825e5,
        (3, 4): -2.737877e5,
        (5, 5): 2.305948e6,
    }
    for (i, j), value in printed.items():
        scale = 1e-3 ** ((i > 2) + (j > 2))
        assert model.mass[i, j] == pytest.approx(scale * value, rel=1e-4)
    said(model, "4 boundary grids are tied rigidly")
    assert model.frequency[0] == pytest.approx(np.sqrt(1483.15979) / (2 * np.pi), rel=1e-6)


def test_real_listing_of_a_free_run_is_refused():
    path = genuine("nas2cam/no_se.out")
    with pytest.raises(ModalError, match="6 of 6 modes are rigid-body modes"):
        read_modal_model(path, options("SI", [0, 0, 0]))
