"""Angles of an array, shapes of modes and draws of the noise on the page: the figures of the library."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.server import SHORT, items, result, spec, wait

import microvib as mv
from microvib.io.limit_files import limit_from_text
from microvib.io.modal_sources import modal_source
from microvib.io.named import catalog_names
from microvib.reports.angles import angles_outcome
from microvib.reports.moving import MAX_DISPLACEMENT_RATIO, NOISE, shape_of_array, shape_of_craft
from microvib.reports.outcome import text_files
from microvib.studies.angles import sweep_angles

EXAMPLE = Path(__file__).parents[2] / "examples" / "spacecraft.yaml"
CRAFT = {
    "text": EXAMPLE.read_text(encoding="utf-8"),
    "changes": {"record.settle": "1 s", "record.duration": "4 s"},
}


def found(client, what: str, **asked) -> dict:
    answer = client.post(f"/api/{what}", json=asked)
    assert answer.status_code == 202, answer.text
    return result(client, answer.json()["id"])


def refused(client, what: str, **asked) -> dict:
    answer = client.post(f"/api/{what}", json=asked)
    assert answer.status_code == 422, answer.text
    return answer.json()


def test_a_sweep_is_that_of_the_command_line(client):
    told = found(client, "angles", scenario=CRAFT, angles="0,45")
    sweep = sweep_angles(mv.load_scenario(EXAMPLE, CRAFT["changes"]), ["0 deg", "45 deg"])
    lines = told["files"]["angles.csv"].splitlines()
    assert (
        lines[0]
        == "angle_deg,line,frequency_hz,fx_n,fy_n,fz_n,mx_n_m,my_n_m,mz_n_m,los_x_rad,los_y_rad"
    )
    assert len(lines) == 1 + sum(len(one.names) for one in sweep.lines)
    first = lines[1].split(",")
    assert (first[1], float(first[-1])) == (
        sweep.lines[0].names[0],
        pytest.approx(sweep.lines[0].amplitude[0, 1]),
    )
    first, every = told["parts"]
    [table] = items(every, "table")
    assert [(x["title"], x["unit"]) for x in table["columns"][:2]] == [
        ("angle", "deg"),
        ("largest line", ""),
    ]
    assert [row["angle_deg"] for row in table["rows"]] == ["0", "45", "all", "worst"]
    [picture] = items(first, "picture")
    assert picture["source"].startswith("data:image/svg+xml;base64,")
    assert json.loads(told["files"]["angles.json"])["angles_deg"] == [0.0, 45.0]


def test_a_sweep_is_judged_at_each_angle_by_a_curve_of_torque_or_loads(client):
    """As on the command line, and nothing between the angles; a limit is text, and no file."""
    for curve in ("frequency_hz,t_mnm\n0.5,8\n400,80\n", "frequency_hz,mz_mnm\n1,500\n100,500\n"):
        told = found(client, "angles", scenario=CRAFT, angles="0,45", limit=curve, band="1:90 Hz")
        limit = limit_from_text(curve).within("1:90 Hz")
        sweep = sweep_angles(
            mv.load_scenario(EXAMPLE, CRAFT["changes"]), ["0 deg", "45 deg"], limit=limit
        )
        expected = angles_outcome(sweep)
        assert told["verdict"] == expected.verdict
        assert told["files"] == text_files(expected)
        table = items(told["parts"][0], "table")[0]
        assert [row["angle_deg"] for row in table["rows"]] == ["0", "45"]
    for text in ("allowed.csv", "/etc/passwd", "5"):
        assert refused(client, "angles", scenario=CRAFT, angles="0", limit=text)["key"] == "limit"


@pytest.mark.parametrize(
    ("asked", "key", "words"),
    [
        ({"angles": "0:180"}, "angles", "write FIRST:LAST:STEP in degrees"),
        ({"angles": " "}, "angles", "missing; write FIRST:LAST:STEP"),
        ({"angles": "0:1e308:1e-308"}, "angles", "is too large"),
        ({"angles": "0:360:0.1"}, "angles", "at most 361 angles"),
        ({"angles": "0:10:5 kg"}, "angles", "wrong dimension"),
        (
            {"angles": "0,45", "scenario": spec()},
            "spacecraft",
            "a scenario on a spacecraft is expected",
        ),
    ],
)
def test_a_sweep_that_cannot_be(client, asked, key, words):
    told = refused(client, "angles", **{"scenario": CRAFT, **asked})
    assert told["key"] == key
    assert words in told["error"]


def test_shapes_of_finite_elements_are_those_of_the_mesh(client):
    scenario = {"base": "state-1", "changes": {"array": "{fem: reference-array, modes: 4}"}}
    told = found(client, "shapes", scenario=scenario)
    modes = modal_source("reference-array", 4).modes
    shapes, moving = np.array(told["moving"]["shapes"]), told["moving"]
    assert shapes.shape == (4, *modes.structure.xyz.shape)
    for k in range(4):
        u = modes.shapes[:, :3, k]
        size = MAX_DISPLACEMENT_RATIO * np.ptp(modes.structure.xyz, axis=0).max()
        np.testing.assert_allclose(shapes[k], size * u / np.linalg.norm(u, axis=1).max(), atol=6e-5)
    assert len(moving["faces"]) > 10
    columns = {name: [row[k] for row in told["rows"]] for k, name in enumerate(told["header"])}
    assert columns["frequency [Hz]"] == pytest.approx(modes.frequency.tolist())
    assert columns["about z [kg m²]"] == pytest.approx(
        (modes.participation[5] ** 2).tolist(), abs=NOISE * modes.mass[5, 5]
    )
    assert "mesh" in told["words"]
    # Modes that were changed since are not those of the mesh any more.
    other = client.post("/api/scenario", json=scenario).json()["yaml"]
    assert "momentum" in found(client, "shapes", scenario={"text": other})["words"]


def test_shapes_of_a_craft_keep_their_momentum_and_the_look_of_the_model(client):
    told = found(client, "shapes", scenario=CRAFT, of="craft")
    scenario = mv.load_scenario(EXAMPLE)
    craft, moving = scenario.craft, shape_of_craft(scenario, None)
    columns = {name: [row[k] for row in told["rows"]] for k, name in enumerate(told["header"])}
    assert columns["frequency [Hz]"] == pytest.approx(craft.frequency.tolist())
    assert all(0.0 < share < 100.0 for share in columns["energy in the hub [%]"])
    los = np.linalg.norm(craft.line_of_sight().position @ craft.shapes, axis=0)
    assert columns["line of sight [µrad/mm]"] == pytest.approx(
        (1e3 * los / moving.largest).tolist()
    )
    assert len(told["moving"]["sight"]) == 1
    np.testing.assert_allclose(
        np.array(told["moving"]["shapes"]), np.moveaxis(moving.scaled, 2, 0), atol=6e-5
    )


SECOND = {
    "position": ["0.35 m", "-0.9 m", "-0.2 m"],
    "drive_axis": [0, -1, 0],
    "reference": [1, 0, 0],
}


@pytest.mark.parametrize(
    "changes", [{}, {"spacecraft.second_wing": {"interface": SECOND}}], ids=["one wing", "two"]
)
def test_no_mode_moves_the_free_craft_as_a_whole(changes):
    """Hub and wings, each a rigid body here, keep their momentum, and about the hub's centre of mass its moment."""
    scenario = mv.load_scenario(EXAMPLE, {**changes, "spacecraft.attitude_control": None})
    moving = shape_of_craft(scenario, None)
    masses = [scenario.spacecraft.hub.mass, *[scenario.array.rigid_body.mass] * (1 + len(changes))]
    firsts = [0, 8, 18]  # of the eight corners of each box
    momenta = [
        m * moving.shapes[k : k + 8].mean(axis=0) for m, k in zip(masses, firsts, strict=False)
    ]
    assert np.abs(np.sum(momenta, axis=0)).max() < 1e-12 * np.abs(momenta).max()


def test_a_box_moves_as_the_rigid_body_closest_to_the_mode():
    """With the mesh of an array at hand: no rigid motion comes closer to a mode, weighed by mass."""
    source = modal_source("reference-array", 3)
    array, modes = source.model.array(), source.modes
    box, mesh = shape_of_array(array, None), shape_of_array(array, modes)
    weights = np.sqrt(np.maximum(modes.node_masses, 0.0))[:, None]
    arms = np.stack([np.cross(axis, mesh.xyz) for axis in np.eye(3)], axis=2)
    A = np.concatenate([np.broadcast_to(np.eye(3), (len(mesh.xyz), 3, 3)), arms], axis=2)
    closest = np.linalg.lstsq(
        (weights[:, :, None] * A).reshape(-1, 6), (weights[:, :, None] * mesh.shapes).reshape(-1, 3)
    )[0]
    np.testing.assert_allclose(box.shapes[8], closest[:3], atol=0.03 * np.abs(box.shapes).max())


@pytest.mark.parametrize("name", catalog_names())
def test_modes_about_the_drive_axis_alone_turn_a_panel_about_it(client, name):
    told = found(client, "shapes", scenario={"base": name, "changes": {}})
    array = mv.load_scenario(name).array
    columns = {key: [row[k] for row in told["rows"]] for k, key in enumerate(told["header"])}
    assert columns["frequency [Hz]"] == [mode.frequency for mode in array.modes]
    assert columns["about z [kg m²]"] == pytest.approx((array.H**2).tolist())
    assert columns["kind"] == ["Mz"] * len(array.modes)
    assert "drive axis z alone" in told["words"]
    xyz, shapes = np.array(told["moving"]["xyz"]), np.array(told["moving"]["shapes"])
    turn = shapes[:, :, 1] @ xyz[:, 0] / (xyz[:, 0] @ xyz[:, 0])
    for shape, angle in zip(shapes, turn, strict=True):  # a small rotation about z
        np.testing.assert_allclose(
            shape, angle * np.stack([-xyz[:, 1], xyz[:, 0], 0 * xyz[:, 0]], axis=1), atol=6e-5
        )
        assert abs(angle) > 0.1


def test_shapes_that_are_not_known(client):
    assert refused(client, "shapes", scenario=spec(), of="craft")["key"] == "spacecraft"
    rigid = client.post(
        "/api/shapes", json={"scenario": {**CRAFT, "changes": {"array.modes": "[]"}}}
    ).json()["id"]
    assert wait(client, rigid)["error"] == (
        "array.modes: is empty, the array is rigid; give modes, or take it from finite elements (array.fem)"
    )


def test_lines_over_seeds_are_those_of_the_command_line(client, tmp_path):
    noise = {
        **SHORT,
        "friction.torque_noise": "{density: 1e-7 N^2*m^2/Hz, lowest: 0.5 Hz, highest: 200 Hz}",
    }
    told = found(client, "runs", scenario={"base": "state-1", "changes": noise}, seeds=3)
    shown = client.post("/api/scenario", json={"base": "state-1", "changes": noise}).json()["yaml"]
    path = tmp_path / "noisy.yaml"
    path.write_text(shown, encoding="utf-8")
    table = mv.run_scenario(mv.load_scenario(path), seeds=3).table
    [lines] = [part for part in told["parts"] if part["title"] == "Lines over draws of the noise"]
    text, over_seeds = lines["items"]
    assert text["text"].startswith("Over 3 draws of the noise")
    shown = {row["line"]: float(row["mean_n_m"]) for row in over_seeds["rows"]}
    assert {"drive_1", "drive_2"} <= set(shown)
    means = {x.name: 1e3 * x.mean for x in table.seeds}
    assert shown == pytest.approx({line: means[line] for line in shown}, rel=1e-3)
    assert "seeds.csv" in told["files"]


@pytest.mark.parametrize("seeds", [1, 1001, 2.5, "many", "", True])
def test_seeds_that_are_none(client, seeds):
    told = refused(client, "runs", scenario=spec(), seeds=seeds)
    assert told == {
        "error": "seeds: a whole number of draws from 2 to 1000 is expected",
        "key": "seeds",
    }


def test_seeds_without_noise(client):
    assert (
        "this scenario has no noise" in refused(client, "runs", scenario=spec(), seeds=3)["error"]
    )


@pytest.mark.release
def test_files_of_a_driven_second_wing(client):
    data = yaml.safe_load(CRAFT["text"])
    far = {
        "position": ["0.35 m", "-0.9 m", "-0.2 m"],
        "drive_axis": [0, -1, 0],
        "reference": [1, 0, 0],
    }
    data["spacecraft"]["second_wing"] = {"drive": "driven", "interface": far}
    answer = client.post("/api/runs", json={"scenario": {**CRAFT, "text": yaml.safe_dump(data)}})
    assert answer.status_code == 202, answer.text
    id = answer.json()["id"]
    assert {"loads_wing_2.csv", "lines_wing_2.csv"} <= set(result(client, id)["files"])
    for name, first in (
        ("loads_wing_2.csv", "line,frequency_hz,fx_n"),
        ("lines_wing_2.csv", "line,expected_hz"),
    ):
        told = client.get(f"/api/runs/{id}/files/{name}")
        assert told.status_code == 200
        assert told.text.startswith(first)
    assert client.get(f"/api/runs/{id}/files/motion.nc").status_code == 200
