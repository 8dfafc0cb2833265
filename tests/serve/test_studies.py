"""Recordings, comparisons, identifications, rate plans and simulators on the page."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from support.server import SHORT, items, result, spec, wait

import microvib as mv
from microvib.io.formats import READERS
from microvib.io.limit_files import limit_from_text
from microvib.io.recordings import write_recording
from microvib.reports.rates import rates_outcome
from microvib.studies.rates import plan_rates, rate_grid
from microvib.testdata.recording import Recording
from microvib.web.routes.new_jobs import RECORDINGS


def test_the_page_takes_all_recordings_that_are_read():
    """The server has a list of its own, since it loads no library that reads files."""
    assert tuple(READERS) == RECORDINGS


@pytest.fixture(scope="module")
def recording(motion, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "bench.uff"
    noise = np.random.default_rng(1).normal(0.0, 1e-4, motion["T_d"].size)
    write_recording(
        Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"}, "bench"), path
    )
    return path


@pytest.fixture(scope="module")
def loaded(client, recording) -> dict:
    answer = client.post(
        "/api/recordings", params={"name": "my bench.uff"}, content=recording.read_bytes()
    )
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.mark.parametrize("unit", ["N m", "N·m", "mNm", "kN"])
def test_units_go_to_the_page_as_a_run_has_them(client, tmp_path, unit):
    """However a file writes its unit: a run's curves and a recording's can be laid over each other."""
    rng = np.random.default_rng(1)
    channels = {name: rng.normal(0.0, 1e-3, 8192) for name in ("Mx", "Mz")}
    forces = unit.endswith("N")
    channels = {"Fx": channels["Mx"]} if forces else channels
    write_recording(
        Recording(channels, 1024.0, dict.fromkeys(channels, unit)), tmp_path / "test.csv"
    )
    answer = client.post(
        "/api/recordings", params={"name": "test.csv"}, content=(tmp_path / "test.csv").read_bytes()
    )
    kept = answer.json()
    plain = "N" if forces else "N*m"
    assert {channel["unit"] for channel in kept["channels"]} == {plain}
    for name in channels:
        asked = {"recording": kept["id"], "scenario": spec(), "channel": name}
        found = result(client, client.post("/api/analyses", json=asked).json()["id"])
        assert found["unit"] == plain
        assert found["run_channel"] == ("T_d" if name == "Mz" else name)


def test_a_recording_is_analysed_as_the_command_line_does(client, loaded, recording):
    from microvib.io.sources import open_source
    from microvib.studies.analyse import analyse

    assert loaded["channels"][0]["name"] == "Mz"
    assert loaded["duration"] == pytest.approx(4.0)
    id = client.post("/api/analyses", json={"recording": loaded["id"], "scenario": spec()}).json()[
        "id"
    ]
    found, expected = (
        result(client, id),
        analyse(open_source(str(recording)), scenario=mv.load_scenario("state-1")),
    )
    assert items(found["parts"][0], "pairs")[0]["rows"][0] == ["Source", "my bench.uff, channel Mz"]
    assert found["clock_ratio"] == expected.clock_ratio
    assert [x["amplitude_n_m"] for x in found["lines"] if x["line"] == "drive_1"] == [
        expected.table["drive_1"].amplitude
    ]
    assert max(found["spectrum"]["amplitude"]) == expected.spectrum.amplitude.max()
    part = {"from": 50, "to": 60}
    zoomed = client.get(f"/api/analyses/{id}/spectrum", params=part).json()
    inside = (expected.spectrum.frequency >= 50) & (expected.spectrum.frequency <= 60)
    assert zoomed == {
        "f": expected.spectrum.frequency[inside].tolist(),
        "values": expected.spectrum.amplitude[inside].tolist(),
    }
    density = client.get(f"/api/analyses/{id}/spectrum", params={"of": "density", **part}).json()
    assert max(density["values"]) == max(
        expected.density.density[
            (expected.density.frequency >= 50) & (expected.density.frequency <= 60)
        ]
    )


def test_a_recording_beside_a_run(client, loaded, finished):
    id = client.post("/api/comparisons", json={"recording": loaded["id"], "run": finished}).json()[
        "id"
    ]
    found = result(client, id)
    assert found["summary"].endswith("against my bench.uff (recording).")
    rows = items(found["parts"][0], "table")[0]["rows"]
    row = next(row for row in rows if row["line"] == "drive_1")
    assert float(row["relative_error"]) == pytest.approx(0.0, abs=1.0)


def test_a_parameter_is_identified_from_the_page(client, loaded):
    start_at = {**SHORT, "motor.friction.viscous": "0.02 N*m*s/rad"}
    asked = {
        "recordings": [loaded["id"]],
        "scenario": {"base": "state-1", "changes": start_at},
        "starts": 2,
    }
    wrong = client.post("/api/identifications", json={**asked, "fit": ["motor.colour"]}).json()[
        "id"
    ]
    assert wait(client, wrong)["error"].startswith("fit motor.colour: is not a key of the scenario")
    id = client.post(
        "/api/identifications",
        json={**asked, "fit": ["motor.friction.viscous=0.01 N*m*s/rad:0.03 N*m*s/rad"]},
    ).json()["id"]
    job = wait(client, id)
    assert job["state"] == "done", job
    found = client.get(f"/api/jobs/{id}/result").json()
    (parameter,) = next(
        x["rows"] for x in items(found["parts"][0], "table") if x["name"] == "parameters"
    )
    assert float(parameter["start"]) == 0.02
    assert float(parameter["estimate"]) == pytest.approx(0.01442, rel=0.05)
    assert found["scenario_changes"]["motor.friction.viscous"].endswith("N*m*s/rad")


def matlab(**arrays) -> bytes:
    stream = io.BytesIO()
    savemat(stream, arrays)
    return stream.getvalue()


def leading_out() -> bytes:
    """An HDF5 file whose channel lies in a file of the server's owner."""
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file["fs"] = 4096.0
        file.create_dataset("Mz", shape=(64,), dtype="u1", external=[(__file__, 0, 64)])
    return stream.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "status", "words"),
    [
        ("x.exe", b"MZ", 422, "'.exe' is not known"),
        ("x.uff", b"no uff", 422, "x.uff: is truncated, or no UFF"),
        ("x.mat", b"\x89HDF\r\n\x1a\n" + b"junk" * 100, 422, "x.mat: is corrupt or truncated"),
        (
            "x.mat",
            matlab(fs=np.nan, Mz=np.arange(9.0)),
            422,
            "x.mat: fs gives a sample rate of nan Hz",
        ),
        ("x.nc", b"", 422, "x.nc: is corrupt or truncated"),
        ("x.mat", leading_out(), 422, "x.mat: /Mz is stored in other files"),
        ("x.nc", leading_out(), 422, "x.nc: /Mz is stored in other files"),
        ("../../x.csv", b"a,b\n1,2\n", 422, "x.csv: has no 8 consecutive rows of numbers"),
        ("x.csv", b"t,Mz\n" + b"0,1\n" * 1_000_000, 413, "at most 3 MB"),
    ],
)
def test_recordings_that_are_none(client, store, name, content, status, words):
    before = sorted(store.root.iterdir())
    answer = client.post("/api/recordings", params={"name": name}, content=content)
    assert answer.status_code == status
    assert words in answer.json()["error"]
    assert str(store.root) not in answer.text
    assert sorted(store.root.iterdir()) == before


def test_long_results_are_packed_and_files_are_not(client, finished):
    long, short = (client.get(f"/api/{path}") for path in (f"jobs/{finished}/result", "jobs?ids="))
    assert long.headers["content-encoding"] == "gzip"
    assert len(long.content) > 10_000
    assert "content-encoding" not in short.headers
    assert "content-encoding" not in client.get(f"/api/runs/{finished}/files/motion.nc").headers


def test_a_rate_plan_and_its_bad_options(client):
    asked = {
        "scenario": spec(),
        "from": "0.02 deg/s",
        "to": "0.2 deg/s",
        "count": 5,
        "linear": True,
    }
    found = result(client, client.post("/api/rates", json=asked).json()["id"])
    [best] = items(found["parts"][0], "table")[0]["rows"]
    smallest = min(max(x["amplitude"] for x in case["lines"]) for case in found["cases"])
    assert float(best["largest_n_m"]) == pytest.approx(1e3 * smallest, rel=1e-3)
    assert found["verdict"] == ""
    limited = result(
        client, client.post("/api/rates", json={**asked, "limit": "30 mN*m"}).json()["id"]
    )
    assert limited["verdict"] == "not judged"  # the linearised drive has driving lines only
    assert items(limited["parts"][0], "table")[0]["rows"][0]["best_rate_deg_s"] == "none"
    for more, key in (
        ({"from": "1 m"}, "from"), ({"to": "0.01 deg/s"}, "from"), ({"limit": "-1 N*m"}, "limit"), ({"band": "5"}, "band"),
        ({"count": 2000, "microsteps": [8, 16, 32]}, "count"), ({"microsteps": [0]}, "microsteps.0"),
        ({"scenario": spec(motor__current="1 V")}, "motor.current"),
    ):  # fmt: skip
        answer = client.post("/api/rates", json={**asked, **more})
        assert (answer.status_code, answer.json()["key"]) == (422, key), answer.text


def test_a_rate_plan_by_a_limit_over_frequency_is_that_of_the_library(client):
    """The text of a table; each rate with the line that is nearest to it, and what it allows that line."""
    curve = "frequency_hz,t_mnm\n0.5,8\n20,8\n20,60\n400,200\n"
    asked = {"scenario": spec(), "from": "0.03 deg/s", "to": "0.06 deg/s", "count": 2}
    found = result(client, client.post("/api/rates", json={**asked, "limit": curve}).json()["id"])
    limit = limit_from_text(curve)
    expected = plan_rates("state-1", rate_grid("0.03 deg/s", "0.06 deg/s", 2), [16], limit=limit)
    assert found["summary"] == rates_outcome(expected).summary
    assert found["verdict"] == rates_outcome(expected).verdict
    nearest = [case["nearest"] for case in found["cases"]]
    assert [one["line"] for one in nearest] == [expected.governing(x).name for x in expected.cases]
    for one in nearest:
        assert one["allowed"] == pytest.approx(8e-3) or one["allowed"] > 50e-3
    for text, words in (
        ("frequency_hz,fx_n\n1,2\n10,2\n", "a plan of rates looks at the torque"),
        ("/etc/passwd", "limit"),
        ("allowed.csv", "limit"),
    ):
        answer = client.post("/api/rates", json={**asked, "limit": text})
        assert (answer.status_code, answer.json()["key"]) == (422, "limit"), answer.text
        assert words in answer.json()["error"]


def test_a_simulator_is_sized(client):
    asked = {"inertia": "8.18 kg*m^2", "frequency": "1.19 Hz", "states": ["1.39:8.18"]}
    found = result(client, client.post("/api/sas", json=asked).json()["id"])
    target = items(found["parts"][0], "table")[0]["rows"][0]
    assert float(target["elements_frequency_hz"]) == pytest.approx(1.19, rel=0.01)
    [drawing] = [x for part in found["parts"] for x in items(part, "picture")]
    assert drawing["source"].startswith("data:image/svg+xml;base64,")
    bad = client.post("/api/sas", json={**asked, "inertia": "8 m"}).json()["id"]
    assert wait(client, bad)["error"].startswith("inertia: '8 m' has the wrong dimension")
    assert client.post("/api/sas", json={"inertia": "8 kg*m^2"}).json()["key"] == "frequency"
