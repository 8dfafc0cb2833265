"""The server of the page: the command line's numbers, sentences beside keys, and nothing that takes it down."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import httpx2 as httpx
import numpy as np
import pytest
from fastapi.testclient import TestClient
from scipy.io import savemat
from support.scenarios import limit_of

import microvib as mv
from microvib.io.recordings import write_recording
from microvib.io.scenario_file import catalog_text, parse_yaml
from microvib.reports.run.folder import run_scenario
from microvib.signals.screen import outline
from microvib.solve.channels import CHANNELS
from microvib.testdata.recording import Recording
from microvib.web.jobs.store import Store
from microvib.web.routes import forms
from microvib.web.routes.results import series
from microvib.web.server.access import Access
from microvib.web.server.application import create_app
from microvib.web.server.limits import Limits

BASE = "http://127.0.0.1:8321"
TOKEN = "s3cret"
SHORT = {"record.settle": "1 s", "record.duration": "4 s"}
LONG = {"record.settle": "100000 s"}


def client_of(store: Store, shown: str = TOKEN, **access) -> TestClient:
    """A client that shows the token, or what is given."""
    app = create_app(store, Access(token=TOKEN, **access))
    headers = {"authorization": f"Bearer {shown}"} if shown else {}
    return TestClient(app, base_url=BASE, raise_server_exceptions=False, headers=headers)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    opened = Store(tmp_path_factory.mktemp("store"), Limits(waiting=2, recording=3_000_000))
    yield opened
    opened.close()
    opened.join()


@pytest.fixture(scope="module")
def client(store) -> TestClient:
    return client_of(store)


def spec(**changes: str) -> dict:
    return {"base": "state-1", "changes": {key.replace("__", "."): text for key, text in changes.items()}}


def start(client: TestClient, changes: dict[str, str], **more) -> str:
    answer = client.post("/api/runs", json={"scenario": {"base": "state-1", "changes": changes}, **more})
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def wait(client: TestClient, id: str, *states: str, seconds: float = 120.0) -> dict:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        job = client.get(f"/api/jobs/{id}").json()
        if job["state"] in (states or ("done", "failed", "cancelled")):
            return job
        time.sleep(0.02)
    raise AssertionError(f"still {job}")


def result(client: TestClient, id: str) -> dict:
    job = wait(client, id)
    assert job["state"] == "done", job
    answer = client.get(f"/api/jobs/{id}/result")
    assert str(client.app._app.state.store.root) not in answer.text  # nothing of where the server keeps its files
    return answer.json()


@pytest.fixture(scope="module")
def finished(client) -> str:
    """A short run of state 1."""
    id = start(client, SHORT)
    assert wait(client, id)["state"] == "done"
    return id


@pytest.fixture(scope="module")
def motion() -> mv.Motion:
    return mv.simulate(mv.load_scenario("state-1", SHORT))


# The same numbers as elsewhere


def test_a_run_gives_the_numbers_of_the_command_line(client, finished, tmp_path):
    run_scenario(mv.load_scenario("state-1", SHORT), tmp_path / "run", lines_only=True)
    text = (tmp_path / "run" / "lines.csv").read_text()
    assert client.get(f"/api/runs/{finished}/files/lines.csv").text == text
    rows = {row["line"]: row for row in csv.DictReader(io.StringIO(text))}
    for line in result(client, finished)["lines"]:
        for column in ("frequency_hz", "amplitude_n_m", "phase_rad", "bin_amplitude_n_m"):
            shown = "" if line[column] is None else f"{line[column]:.9g}"
            assert shown == rows[line["line"]][column]


def test_the_drive_train_balances(client, finished, motion):
    found = result(client, finished)["drivetrain"]
    power = found["power"]
    stored = power["kinetic"] + power["magnetic"] + power["elastic"]
    spent = power["joule"] + power["friction"] + power["damping"] + stored
    assert power["electrical"] == pytest.approx(spent, rel=1e-3)
    assert found["T_d"]["peak"] == np.abs(motion["T_d"]).max()
    assert found["i_rms"] == pytest.approx(0.6 / np.sqrt(2), rel=0.01)  # sine of 0.6 A
    torques = {row["torque"]: row for row in result(client, finished)["budget"]}
    drive_1 = mv.lines(motion)["drive_1"]
    assert torques["T_d"]["drive_1_amplitude"] == pytest.approx(drive_1.amplitude_n_m, rel=1e-3)
    assert torques["T_d"]["drive_1_phase"] == pytest.approx(drive_1.phase_rad, abs=1e-2)
    assert found["stuck_output"] == motion["stuck_output"].mean()


def test_series_are_exact_where_every_sample_is_there(client, finished, motion):
    query = {"channels": "T_d,i_A", "from": 1.5, "to": 1.6, "points": 2000}
    found = client.get(f"/api/runs/{finished}/series", params=query).json()
    keep = (motion.time >= 1.5) & (motion.time <= 1.6)
    assert found["exact"]
    assert found["t"] == motion.time[keep].tolist()
    for name in ("T_d", "i_A"):
        assert found["channels"][name]["min"] == found["channels"][name]["max"] == motion[name][keep].tolist()
    assert found["channels"]["T_d"]["unit"] == "N*m"


@pytest.mark.parametrize("points", [2, 37, 1000, 16_383, 16_384])
def test_no_peak_is_lost_at_any_zoom(client, finished, motion, points):
    found = client.get(f"/api/runs/{finished}/series", params={"channels": "T_d", "points": points}).json()
    assert len(found["t"]) <= points
    assert max(found["channels"]["T_d"]["max"]) == motion["T_d"].max()
    assert min(found["channels"]["T_d"]["min"]) == motion["T_d"].min()
    assert np.all(np.diff(found["t"]) > 0.0)


def test_the_last_samples_are_in_the_last_group():
    x = np.zeros(1003)
    x[-1] = 5.0
    found = series({"T_d": x}, 0.0, 100.0, None, None, 10)
    assert found["channels"]["T_d"]["max"][-1] == 5.0
    assert found["to"] == 10.02


def test_a_thinned_spectrum_keeps_its_peaks_at_their_frequency(client, finished, motion):
    whole = mv.spectrum(motion, window="hann")
    k = int(np.argmax(whole.amplitude))
    found = client.get(f"/api/runs/{finished}/spectrum", params={"points": 50}).json()
    assert len(found["f"]) <= 50
    assert found["amplitude"][int(np.argmax(found["amplitude"]))] == whole.amplitude[k]
    assert whole.frequency[k] in found["f"]
    part = client.get(f"/api/runs/{finished}/spectrum", params={"from": 50, "to": 60, "window": "rectangular"}).json()
    assert 50 <= min(part["f"]) < max(part["f"]) <= 60


def test_a_thinned_spectrum_has_no_plateaus_on_a_logarithmic_axis():
    """A tone between two decades: few points at low frequencies would draw a level line from it to its neighbours."""
    f = np.arange(200_000) / 100.0
    y = np.where(np.abs(f - 1.19) < 0.005, 1.0, 1e-6)
    shown, values = outline(f, y, 4000, log=True)
    assert np.array_equal(shown[shown < 3.0], f[f < 3.0])
    assert (values == 1.0).sum() == 1
    thinned, low = outline(f, np.abs(np.sin(f)) + 1e-6, 1000)
    assert thinned.size <= 1000
    assert np.median(low) < 0.75  # the smallest are there beside the largest


def test_a_verdict_is_that_of_the_report(client, finished, motion):
    from microvib.analysis.limits import judge

    table = mv.lines(motion)
    for query, limit in (
        ({"limit": "30 mN*m"}, limit_of(0.03)),
        ({"limit": "30 mN*m", "band": "0.5:5 Hz"}, limit_of(0.03, 0.5, 5.0)),
    ):
        judged = judge(table, limit, motion.scenario)
        found = client.get(f"/api/runs/{finished}/verdict", params=query).json()
        assert found["text"] == str(judged)
        assert found["verdict"] == judged.verdict
        assert [m["line"] for m in found["margins"]] == [m.line.line for m in judged.margins]
    page = client.get(f"/api/runs/{finished}/files/report.html", params={"limit": "30 mN*m"}).text
    assert "limit 30" in page
    assert "limit 30" not in client.get(f"/api/runs/{finished}/files/report.html").text
    wrong = client.get(f"/api/runs/{finished}/verdict", params={"limit": "30 kg"})
    assert wrong.status_code == 422
    assert wrong.json()["key"] == "limit"


def test_jobs_that_are_asked_for(client, finished):
    assert [job["id"] for job in client.get("/api/jobs", params={"ids": f"{finished},{'0' * 16}"}).json()] == [finished]
    assert client.get("/api/jobs", params={"ids": ""}).json() == []
    assert finished in [job["id"] for job in client.get("/api/jobs").json()]


def test_files_of_a_run(client, finished):
    assert mv.Scenario  # the scenario reads back to the same
    text = client.get(f"/api/runs/{finished}/files/scenario.yaml").text
    assert text == mv.dump_scenario(mv.load_scenario("state-1", SHORT))
    netcdf = client.get(f"/api/runs/{finished}/files/motion.nc")
    assert netcdf.content[:4] == b"\x89HDF"
    assert "attachment" in netcdf.headers["content-disposition"]
    assert "drive_1" in client.get(f"/api/runs/{finished}/files/report.html").text
    assert client.get(f"/api/runs/{finished}/files/report.pdf").content.startswith(b"%PDF")
    for name in ("report.exe", "result.json", "run.pickle", "..%2F..%2Fetc%2Fpasswd"):
        assert client.get(f"/api/runs/{finished}/files/{name}").status_code == 404


def test_a_steady_run_says_that_it_is_steady(client):
    run = start(client, {**SHORT, "record.settle": "0 s"}, steady=True)
    found = result(client, run)
    lines = {line["line"]: line for line in found["lines"]}
    assert lines["array_mode_1"]["status"] == "not in a steady state"
    assert found["solver"]["multiplier"] < 1.0
    assert "start: steady" in client.get(f"/api/runs/{run}/files/scenario.yaml").text


def test_events_tell_how_far_a_run_is(client):
    id = start(client, {"record.settle": "60 s", "record.duration": "4 s"})
    states = [json.loads(line[6:]) for line in client.get(f"/api/jobs/{id}/events").text.splitlines() if line]
    assert states[-1]["state"] == "done"
    done = [s["progress"]["done"] for s in states if s["progress"]["unit"] == "s"]
    assert done == sorted(done)
    assert states[-1]["progress"]["total"] == pytest.approx(64.0, abs=0.1)


# The form


def test_what_is_wrong_is_said_beside_its_key(client):
    answer = client.post("/api/scenario", json=spec(motor__current="5 V", driver__microsteps="0")).json()
    errors = {e["key"]: e["error"] for e in answer["errors"]}
    assert errors["motor.current"].startswith("motor.current: '5 V' has the wrong dimension; a unit compatible with A")
    assert "a whole number from 1 to 65536" in errors["driver.microsteps"]
    assert answer["values"]["motor.current"] == "5 V"
    assert answer["base_values"]["motor.current"] == "0.6 A"
    assert answer["yaml"] is None
    refused = client.post("/api/runs", json={"scenario": spec(motor__current="5 V")})
    assert refused.status_code == 422
    assert refused.json() == {"error": errors["motor.current"], "key": "motor.current"}


def test_what_differs_from_the_catalog_is_marked(client):
    changes = {"motor__current": "700 mA", "driver__microsteps": "16", "reducer__stiffness": "rigid"}
    answer = client.post("/api/scenario", json=spec(**changes)).json()
    assert answer["errors"] == []
    assert sorted(answer["changed"]) == ["motor.current", "reducer.stiffness"]
    assert answer["values"]["motor.current"] == "700 mA"  # as it was typed
    assert answer["sources"]["motor.current"] == "set by the user"
    assert answer["sources"]["motor.torque_constant"].startswith("Appl. Sci.")
    again = client.post("/api/scenario", json={"text": answer["yaml"]}).json()
    assert again["values"]["motor.current"] == "0.70000000000000007 A"  # to the last digit
    assert again["yaml"] == answer["yaml"]


def test_a_wrong_file_is_shown_with_what_is_wrong_and_can_be_mended(client):
    text = catalog_text("state-1").replace("current: 0.6 A", "current: 0.6 V")
    shown = client.post("/api/scenario", json={"text": text}).json()
    assert [e["key"] for e in shown["errors"]] == ["motor.current"]
    assert (shown["values"]["motor.current"], shown["values"]["array.modes.0.frequency"]) == ("0.6 V", "1.2459 Hz")
    assert shown["yaml"] is None
    plain = re.sub(r"sources:\n(  .*\n)*", "", text)
    mended = client.post("/api/scenario", json={"text": plain, "changes": {"motor.current": "0.5 A"}}).json()
    assert mended["errors"] == []
    assert "current: 0.5 A" in mended["yaml"]


def test_every_value_as_typed_reads_back(client):
    """Typing what the form shows changes nothing: each text goes through units and back."""
    shown = client.post("/api/scenario", json=spec()).json()
    typed = {key: text for key, text in shown["values"].items() if text}
    again = client.post("/api/scenario", json={"base": "state-1", "changes": typed}).json()
    assert again["errors"] == []
    assert again["changed"] == []


def test_every_value_has_its_field(client):
    groups = client.get("/api/schema").json()["groups"]
    assert [g["key"] for g in groups] == [
        "motor",
        "driver",
        "reducer",
        "friction",
        "array",
        "tracking",
        "record",
        "solver",
    ]
    fields = {f["key"]: f for g in groups for f in g["fields"]}
    for key in client.post("/api/scenario", json=spec()).json()["values"]:
        generic = re.sub(r"\.\d+\..*", "", key)
        assert any(f == generic or f.startswith(f"{generic}.") for f in fields), key
    stiffness = fields["reducer.stiffness"]
    assert (stiffness["kind"], stiffness["unit"], stiffness["choices"]) == ("quantity", "N*m/rad", ["rigid"])
    assert fields["array.modes"]["items"][0]["unit"] == "Hz"
    assert fields["friction.slip_ring.ring_radius"]["optional"]
    assert not fields["motor.current"]["optional"]


def test_the_catalog(client):
    assert [entry["name"] for entry in client.get("/api/catalog").json()] == [f"state-{k}" for k in range(1, 6)]


def test_an_array_from_finite_elements(client):
    answer = client.post("/api/scenario", json=spec(array__fem="reference-array")).json()
    assert answer["errors"] == []
    assert answer["values"]["array.modes.9.frequency"]


@pytest.mark.parametrize("key", ["from", "fem"])
@pytest.mark.parametrize("path", ["/etc/passwd", "../x.yaml", "state-1.yaml", "modes.csv", "reference-array.yaml"])
def test_no_path_of_a_page_is_opened(client, key, path):
    text = f"array: {{{key}: {path}}}"
    for asked in (
        {"text": text},
        {"text": f"array:\n  {key}: {path}\n  modes: 2"},
        {"text": text, "changes": {"array.modes": "2"}},
        {"base": "state-1", "changes": {f"array.{key}": path}},
        {"base": "state-1", "changes": {"array": f"{{{key}: {path}}}"}},
    ):
        error = client.post("/api/scenario", json=asked).json()["errors"][0]
        assert error["key"] == f"array.{key}"
        assert "the page opens no files" in error["error"]
        assert client.post("/api/runs", json={"scenario": asked}).status_code == 422


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [1, 2]\nb: [*a, *a]", "anchors and aliases"),
        ("[" * 5000, "is not YAML"),
        ("motor: {current: 1 A", "line 1"),
        ("- 1\n- 2", "a mapping of keys is expected"),
        ("\x00", "is not YAML"),
        ("", "a mapping of keys is expected"),
        ("1: 2", ""),
        ("motor: !!set {a, b}", "tags"),
        (f"array: {{inertia: {'9' * 5000}}}", ""),
    ],
)
def test_texts_that_are_no_scenarios(client, text, words):
    answer = client.post("/api/scenario", json={"text": text})
    assert answer.status_code == 200
    assert words in answer.json()["errors"][0]["error"]


@pytest.mark.parametrize("text", ["motor: [", "motor: {current: 1 V}"])
def test_a_text_is_read_once(monkeypatch, text):
    read: list[str] = []
    monkeypatch.setattr(forms, "parse_yaml", lambda text, name: read.append(text) or parse_yaml(text, name))
    forms._parsed.cache_clear()
    assert forms.view_of(forms.Spec(text=text, changes={"motor.current": "1 A"}))["errors"]
    assert read == [text]


def test_a_large_text_is_read_by_a_worker_and_an_array_has_bounds(client):
    modes = "\n".join("    - {frequency: 3 Hz, damping: 1 percent, participation: 0.01 kg^0.5*m}" for _ in range(250))
    state_1 = catalog_text("state-1")
    text = re.sub(r"  rigid_inertia:.*\n  modes:\n(    .*\n)*", f"  modes:\n{modes}\n", state_1)
    text = re.sub(r"  array\.\S+: .*\n", "", text)
    error = client.post("/api/scenario", json={"text": text}).json()["errors"][0]
    assert error == {
        "error": "array.modes: has 250 modes; the page takes at most 100, `microvib run` takes all",
        "key": "array.modes",
    }


# Recordings


@pytest.fixture(scope="module")
def recording(motion, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "bench.uff"
    noise = np.random.default_rng(1).normal(0.0, 1e-4, motion["T_d"].size)
    write_recording(Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"}, "bench"), path)
    return path


@pytest.fixture(scope="module")
def loaded(client, recording) -> dict:
    answer = client.post("/api/recordings", params={"name": "my bench.uff"}, content=recording.read_bytes())
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_recording_is_analysed_as_the_command_line_does(client, loaded, recording):
    from microvib.io.sources import open_source
    from microvib.studies.analyse import analyse

    assert loaded["channels"][0]["name"] == "Mz"
    assert loaded["duration"] == pytest.approx(4.0)
    id = client.post("/api/analyses", json={"recording": loaded["id"], "scenario": spec()}).json()["id"]
    found, expected = result(client, id), analyse(open_source(str(recording)), scenario=mv.load_scenario("state-1"))
    assert found["title"] == "my bench.uff, Mz"
    assert found["clock_ratio"] == expected.clock_ratio
    assert [x["amplitude_n_m"] for x in found["lines"] if x["line"] == "drive_1"] == [
        expected.table["drive_1"].amplitude_n_m
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
        expected.density.density[(expected.density.frequency >= 50) & (expected.density.frequency <= 60)]
    )


def test_a_recording_beside_a_run(client, loaded, finished):
    id = client.post("/api/comparisons", json={"recording": loaded["id"], "run": finished}).json()["id"]
    found = result(client, id)
    assert found["a"]["name"] == "my bench.uff"
    row = next(row for row in found["rows"] if row["line"] == "drive_1")
    assert row["error"] == pytest.approx(0.0, abs=0.01)


def test_a_parameter_is_identified_from_the_page(client, loaded):
    start_at = {**SHORT, "motor.friction.viscous": "0.02 N*m*s/rad"}
    asked = {"recordings": [loaded["id"]], "scenario": {"base": "state-1", "changes": start_at}, "starts": 2}
    wrong = client.post("/api/identifications", json={**asked, "fit": ["motor.colour"]}).json()["id"]
    assert wait(client, wrong)["error"].startswith("fit motor.colour: is not a key of the scenario")
    id = client.post(
        "/api/identifications", json={**asked, "fit": ["motor.friction.viscous=0.01 N*m*s/rad:0.03 N*m*s/rad"]}
    ).json()["id"]
    job = wait(client, id)
    assert job["state"] == "done", job
    found = client.get(f"/api/jobs/{id}/result").json()
    (parameter,) = found["parameters"]
    assert parameter["start"] == 0.02
    assert parameter["value"] == pytest.approx(0.01442, rel=0.05)
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
        ("x.mat", b"\x89HDF\r\n\x1a\n" + b"junk" * 100, 422, "x.mat: is broken or truncated"),
        ("x.mat", matlab(fs=np.nan, Mz=np.arange(9.0)), 422, "x.mat: fs gives a sample rate of nan Hz"),
        ("x.nc", b"", 422, "x.nc: is broken or truncated"),
        ("x.mat", leading_out(), 422, "x.mat: /Mz is stored in other files"),
        ("x.nc", leading_out(), 422, "x.nc: /Mz is stored in other files"),
        ("../../x.csv", b"a,b\n1,2\n", 422, "x.csv: has no 8 rows of numbers"),
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


# Plans


def test_a_rate_plan_and_its_bad_options(client):
    asked = {"scenario": spec(), "from": "0.02 deg/s", "to": "0.2 deg/s", "count": 5, "linear": True}
    found = result(client, client.post("/api/rates", json={**asked, "limit": "30 mN*m"}).json()["id"])
    assert found["best"]["largest"] == min(max(x["amplitude"] for x in case["lines"]) for case in found["cases"])
    for more, key in (
        ({"from": "1 m"}, "from"), ({"to": "0.01 deg/s"}, "from"), ({"limit": "-1 N*m"}, "limit"), ({"band": "5"}, "band"),
        ({"count": 2000, "microsteps": [8, 16, 32]}, "count"), ({"microsteps": [0]}, "microsteps.0"),
        ({"scenario": spec(motor__current="1 V")}, "motor.current"),
    ):  # fmt: skip
        answer = client.post("/api/rates", json={**asked, **more})
        assert (answer.status_code, answer.json()["key"]) == (422, key), answer.text


def test_a_simulator_is_sized(client):
    asked = {"inertia": "8.18 kg*m^2", "frequency": "1.19 Hz", "states": ["1.39:8.18"]}
    found = result(client, client.post("/api/sas", json=asked).json()["id"])
    assert found["settings"][0]["elements_frequency_hz"] == pytest.approx(1.19, rel=0.01)
    assert found["drawing"].startswith("data:image/svg+xml;base64,")
    bad = client.post("/api/sas", json={**asked, "inertia": "8 m"}).json()["id"]
    assert wait(client, bad)["error"].startswith("inertia: '8 m' has the wrong dimension")
    assert client.post("/api/sas", json={"inertia": "8 kg*m^2"}).json()["key"] == "frequency"


# Bounds


def test_two_at_a_time_then_a_queue_then_a_refusal_and_cancelling_frees_the_slot(client):
    running = [start(client, LONG) for _ in range(2)]
    for id in running:
        wait(client, id, "running")
    waiting = [start(client, SHORT), start(client, LONG)]
    full = client.post("/api/runs", json={"scenario": spec()})
    assert full.status_code == 429
    assert full.json()["error"] == "2 computations are waiting already; cancel some, or wait for them"
    assert [client.get(f"/api/jobs/{id}").json()["state"] for id in waiting] == ["queued", "queued"]
    assert client.delete(f"/api/jobs/{waiting[1]}").status_code == 204
    assert wait(client, waiting[1])["state"] == "cancelled"
    assert client.delete(f"/api/jobs/{running[0]}").status_code == 204
    assert wait(client, running[0])["state"] == "cancelled"
    assert wait(client, waiting[0])["state"] == "done"
    assert client.get(f"/api/jobs/{running[0]}/result").status_code == 409
    assert client.get(f"/api/jobs/{running[1]}").json()["state"] == "running"
    client.delete(f"/api/jobs/{running[1]}")


def test_a_killed_worker_ends_its_run_and_nothing_else(client, store):
    first, second = start(client, LONG), start(client, LONG)
    for id in (first, second):
        wait(client, id, "running")
    os.kill(store.job(first).pid, signal.SIGKILL)
    job = wait(client, first)
    assert job["state"] == "failed"
    assert "killed by signal 9" in job["error"]
    assert client.get(f"/api/jobs/{second}").json()["state"] == "running"
    assert wait(client, start(client, SHORT))["state"] == "done"
    client.delete(f"/api/jobs/{second}")


def test_an_ended_computation_can_be_forgotten(client, store):
    id = start(client, SHORT)
    wait(client, id)
    assert client.delete(f"/api/jobs/{id}").status_code == 204
    assert client.get(f"/api/jobs/{id}").status_code == 404
    assert not (store.root / id).exists()


def test_a_record_that_is_too_large_is_refused(client):
    answer = client.post("/api/runs", json={"scenario": spec(record__duration="1000000 s")})
    assert (answer.status_code, answer.json()["key"]) == (422, "record.duration")


@pytest.fixture
def bounded(tmp_path):
    opened: list[Store] = []

    def make(**limits) -> tuple[TestClient, Store]:
        opened.append(Store(tmp_path, replace(Limits(), **limits)))
        return client_of(opened[-1]), opened[-1]

    yield make
    for one in opened:
        one.close()
        one.join()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere memory is not bounded")
def test_memory_is_bounded(bounded):
    client, _ = bounded(memory=300_000_000)
    job = wait(client, start(client, {"record.settle": "0 s", "record.duration": "380 s"}))
    assert job["state"] == "failed"
    assert "memory" in job["error"]
    assert result(client, start(client, SHORT))["title"]


def test_time_is_bounded_and_old_results_make_room(bounded):
    client, store = bounded(wall_s=1.5, kept=2)
    job = wait(client, start(client, LONG))
    assert (job["state"], job["error"]) == ("failed", "stopped after 1.5 s, the longest that is allowed here")
    ids = []
    for _ in range(4):
        ids.append(start(client, SHORT))
        wait(client, ids[-1])
    known = [job["id"] for job in client.get("/api/jobs").json()]
    assert len(known) <= 3
    assert ids[-1] in known
    assert client.get(f"/api/runs/{ids[0]}/series", params={"channels": "T_d"}).status_code == 404
    assert len([p for p in store.root.iterdir() if p.is_dir()]) == len(known)


# Who may ask


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "localhost:8321"}, 200),
        ({"host": "127.0.0.1"}, 200),
        ({"host": "[::1]:8321"}, 200),
        ({"host": "evil.example"}, 403),
        ({"host": "127.0.0.1.evil.example:8321"}, 403),
        ({"host": "192.168.1.5:8321"}, 403),
        ({"host": "localhost@evil.example"}, 403),
        ({"host": "["}, 403),
        ({"host": ""}, 403),
        ({"origin": BASE}, 200),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "http://127.0.0.1:9999"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": "http://["}, 403),
        ({"origin": ""}, 403),
    ],
)
def test_host_and_origin_are_checked(client, headers, status):
    answer = client.post("/api/scenario", json=spec(), headers=headers)
    assert answer.status_code == status
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cache-control"] == "no-store"


def test_reading_needs_no_origin(client):
    assert client.get("/api/jobs", headers={"origin": "http://evil.example"}).status_code == 200
    assert "access-control-allow-origin" not in client.get("/api/jobs").headers


@pytest.fixture(scope="module")
def stranger(store) -> TestClient:
    """A client that has nothing to show, to a server that others may reach."""
    return client_of(
        store, "", remote=True, names=frozenset({"drive.example"}), cookie="microvib-1", session="c00kie", key="k3y"
    )


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 401),
        ({"authorization": "Bearer wrong"}, 401),
        ({"authorization": "Bearer "}, 401),
        ({"authorization": "Bearer s3cret"}, 200),
        ({"authorization": "Bearer s3cret", "host": "evil.example"}, 403),
        ({"authorization": "Bearer s3cret", "host": "192.168.1.5:8321"}, 200),
        ({"cookie": "microvib-1=c00kie"}, 401),  # which the browser shows to every port of the host
        ({"x-microvib-key": "k3y"}, 401),
        ({"cookie": "microvib-1=wrong", "x-microvib-key": "k3y"}, 401),
        ({"cookie": "microvib-1", "x-microvib-key": "k3y"}, 401),
        ({"cookie": "microvib-2=c00kie", "x-microvib-key": "k3y"}, 401),
        ({"cookie": "microvib-1=c00kie", "x-microvib-key": "wrong"}, 401),
        ({"cookie": "microvib-1=c00kie", "x-microvib-key": "k3y"}, 200),
        ({"cookie": 'a={"b": [1]}; microvib-1=x; microvib-1=c00kie; c', "x-microvib-key": "k3y"}, 200),
        ({"cookie": "microvib-1=c00kie", "x-microvib-key": "k3y", "sec-fetch-site": "same-origin"}, 200),
        ({"cookie": "microvib-1=c00kie", "x-microvib-key": "k3y", "sec-fetch-site": "same-site"}, 403),
        ({"cookie": "microvib-1=c00kie", "x-microvib-key": "k3y", "sec-fetch-site": "cross-site"}, 403),
    ],
)
def test_only_the_owner_is_answered(stranger, headers, status):
    answer = stranger.get("/api/jobs", headers=headers)
    assert answer.status_code == status
    if status == 401:
        assert answer.json()["error"].startswith("open the address that microvib serve printed last")


def test_strangers_get_the_empty_page_and_nothing_else(stranger, finished):
    assert "<html" in stranger.get("/").text
    assert stranger.get("/static/app.js").status_code == 200
    owned = [
        f"/api/runs/{finished}/files/lines.csv",
        "/api/openapi.json",
        "/api/schema",
        "/nothing",
        f"/api/jobs/{finished}",
    ]
    for path in owned:
        assert stranger.get(path).status_code == 401
        assert stranger.get(f"{path}?token=s3cret").status_code == 401
    assert stranger.delete(f"/api/jobs/{finished}").status_code == 401
    assert stranger.post("/api/runs", json={"scenario": spec()}).status_code == 401
    cookie = {"cookie": "microvib-1=c00kie"}
    assert [stranger.get(path, headers=cookie).status_code for path in owned] == [200, 401, 401, 401, 401]  # a link


def test_the_token_is_exchanged(stranger):
    for wrong in ("/?token=", "/?token=wrong", "/?token=s3cret2"):
        assert stranger.get(wrong).status_code == 401
    for content in (b"", b"token=wrong", b"x" * 5000):
        assert stranger.post("/enter", content=content).status_code == 401
    named = {"host": "drive.example", "origin": "null", "sec-fetch-site": "cross-site"}  # a file that is opened
    for entered in (
        stranger.get("/?token=s3cret", headers=named),
        stranger.post("/enter", content=b"token=s3cret", headers=named),
    ):
        assert entered.status_code == 200
        assert entered.headers["set-cookie"] == "microvib-1=c00kie; Path=/; HttpOnly; SameSite=Strict"
        assert entered.headers["cache-control"] == "no-store"
        assert entered.headers["referrer-policy"] == "no-referrer"
        assert 'content="k3y"' in entered.text
        assert "s3cret" not in entered.text
    assert stranger.get("/?token=s3cret", headers={"host": "evil.example"}).status_code == 403


def test_requests_are_bounded(client):
    large = client.post("/api/scenario", content=b"x" * 2_000_001, headers={"content-type": "application/json"})
    assert large.status_code == 413
    assert "at most 2 MB" in large.json()["error"]
    assert client.post("/api/recordings", params={"name": "x.csv"}, content=iter([b"a"])).status_code == 411


@pytest.mark.parametrize(
    ("method", "path", "content", "status"),
    [
        ("GET", "/api/nothing", None, 404),
        ("GET", "/static/nothing.js", None, 404),
        ("GET", "/static/..%2Fapi.py", None, 404),
        ("GET", "/api/jobs/0123456789abcdef", None, 404),
        ("GET", "/api/jobs/..%2F..", None, 404),
        ("GET", "/api/jobs/xyz", None, 422),
        ("PUT", "/api/jobs", None, 405),
        ("POST", "/api/scenario", b"{", 422),
        ("POST", "/api/scenario", b"[" * 15_000, 400),
        ("POST", "/api/scenario", b"[" * 500_000, 413),
        ("POST", "/api/scenario", b'{"base": "state-1", "changes": {' + b'"a":"",' * 100_000 + b'"a":""}}', 413),
        ("POST", "/api/scenario", '{"base": "state-1"}'.encode("utf-16"), 422),
        ("POST", "/api/scenario", b'{"base": "state-1", "text": "x"}', 422),
        ("POST", "/api/scenario", b'{"base": "\\ud800"}', 422),
        ("POST", "/api/scenario", b'{"base": "state-1", "more": 1}', 422),
        ("POST", "/api/scenario", b"\xff\xfe", 422),
    ],
)
def test_every_refusal_is_a_sentence(client, method, path, content, status):
    answer = client.request(method, path, content=content, headers={"content-type": "application/json"})
    assert answer.status_code == status, answer.text
    assert set(answer.json()) == {"error", "key"}
    assert answer.json()["error"]
    assert "Traceback" not in answer.text


def test_a_fault_of_the_program_is_a_sentence_and_a_line_in_the_log(client, monkeypatch, caplog):
    monkeypatch.setattr("microvib.web.routes.forms.view_of", lambda spec: 1 / 0)
    answer = client.post("/api/scenario", json=spec())
    assert answer.status_code == 500
    assert answer.json() == {"error": "internal error of the server; its log says more", "key": None}
    assert "POST /api/scenario: division by zero" in caplog.text


# The command


@contextmanager
def microvib(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "microvib", "serve", "--no-browser", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        try:
            yield server
        finally:
            server.kill()


def told(*arguments: str) -> tuple[int, str]:
    """Exit status and what is said of a server that should not start."""
    with microvib(*arguments) as server:
        said = server.communicate(timeout=60)[1]
        return server.returncode, said


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGINT])
def test_the_command_serves_and_ends_cleanly(tmp_path, monkeypatch, end):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with microvib("--port", "0") as server:
        url, port, token = re.search(r"(http://127.0.0.1:(\d+))/\?token=(\S+)", server.stdout.readline()).groups()
        with httpx.Client(base_url=url, timeout=60.0, headers={"authorization": f"Bearer {token}"}) as client:
            assert "<html" in client.get("/").text
            assert client.get("/static/plotly.min.js").headers["content-type"].startswith("text/javascript")
            if end == signal.SIGTERM:
                used = f"Error: --port {port}: is in use; choose another, or end what uses it\n"
                assert told("--port", port) == (1, used)
                wait(client, start(client, LONG), "running")
            server.send_signal(end)
            _, said = server.communicate(timeout=60)
        assert (server.returncode, said) == (0, "")
    assert not list(tmp_path.glob(".page-*"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--host", "0.0.0.0"], "(--allow-remote)"),
        (["--host", "no.such.host.invalid"], "is not an address of this machine"),
    ],
)
def test_addresses_that_are_refused(arguments, words):
    status, said = told("--port", "0", *arguments)
    assert (status, said.count("\n")) == (1, 1)
    assert words in said


def test_channels_of_the_page_are_those_of_a_motion(client, finished):
    assert [c["name"] for c in result(client, finished)["channels"]] == list(CHANNELS)


def test_the_form_tells_unusual_values():
    from microvib.web.routes.forms import Spec, view_of

    assert view_of(Spec(base="state-1"))["doubts"] == []
    (said,) = view_of(Spec(base="state-1", changes={"motor.current": "0.25 mA"}))["doubts"]
    assert said.startswith("motor.current: 0.00025 A is unusual")
