"""A hub from Nastran's free-free modes: mass properties and shapes against those of the frame they come from."""

import json

import numpy as np
import pytest

import microvib as mv
from microvib.io.spacecraft_files import with_spacecraft
from microvib.structures.modal import ModalError

GRIDS = {"root": 1001, "payload": 20, "tip": 58}


def hub_of(path, units="SI", points=GRIDS):
    given = {"spacecraft": {"hub": {"modes": path.name, "units": units, "points": points, "damping": "0.5 percent"}}}
    found = with_spacecraft(given, path.parent, "craft")["spacecraft"]["hub"]
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
    assert [number(x) for x in hub["inertia"]] == pytest.approx(wanted, rel=1e-3, abs=1e-3 * inertia.max())
    for point, grid in zip(hub["points"], GRIDS.values(), strict=True):
        assert [number(x) for x in point["position"]] == pytest.approx(places[grid] - center, abs=1e-4)
    frequency, phi = frame(free=True).modes
    assert number(hub["modes"][0]["frequency"]) == pytest.approx(frequency[6], rel=1e-4)
    shape = np.array(hub["modes"][0]["shapes"])
    expected = np.array([phi[frame(free=True).rows(g), 6] for g in GRIDS.values()])
    assert shape * np.sign(shape[2, 0] * expected[2, 0]) == pytest.approx(expected, abs=2e-4 * np.abs(expected).max())


def test_what_is_no_free_hub_is_said(frame, write_op2, tmp_path):
    held = write_op2(tmp_path / "held.op2", frame(), forces=False)
    with pytest.raises(ModalError, match=r"held\.op2: 0 of 36 modes are those of a free rigid body"):
        hub_of(held)
    free = write_op2(tmp_path / "free.op2", frame(free=True), forces=False)
    with pytest.raises(ModalError, match="points: grid 99 is not in the model"):
        hub_of(free, points={"root": 99})
    with pytest.raises(mv.ScenarioError, match=r"spacecraft\.hub\.units"):
        hub_of(free, units="mm")
    with pytest.raises(mv.ScenarioError, match=r"spacecraft\.hub\.points"):
        hub_of(free, points=["root"])
