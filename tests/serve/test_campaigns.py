"""Campaigns on the page: the command line's cases and figures, stopped and gone on with, and no file of a request."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from support.server import SHORT, client_of, result, spec, wait

from microvib.studies.campaign.cases import compute
from microvib.studies.campaign.design import read_design
from microvib.studies.campaign.folder import create, open_campaign
from microvib.web.jobs.library import opened_library
from microvib.web.jobs.store import Store
from microvib.web.routes.forms import Spec, scenario
from microvib.web.server.limits import Limits

NORMAL = {"distribution": "normal", "relative_deviation": "3 percent"}
SMALL = {
    "scenario": {"base": "state-1", "changes": SHORT},
    "vary": {"motor.torque_constant": NORMAL, "reducer.damping": {"distribution": "uniform", "within": "20 percent"}},
    "count": 8,
    "solve": "record",
    "limit": "60 mN*m",
}  # fmt: skip


def started(client, **more) -> str:
    answer = client.post("/api/campaigns", json={**SMALL, **more})
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def begun(client, id: str) -> dict:
    """What is known as soon as the first cases are computed."""
    until = time.monotonic() + 300.0
    while time.monotonic() < until:
        answer = client.get(f"/api/campaigns/{id}/so-far")
        assert answer.status_code == 200, answer.text
        if answer.json():
            return answer.json()
        time.sleep(0.02)
    raise AssertionError("no case was computed")


@pytest.fixture(scope="module")
def through(client) -> str:
    id = started(client)
    assert wait(client, id)["state"] == "done"
    return id


@pytest.mark.long
def test_a_campaign_is_that_of_the_command_line(client, store, through, tmp_path):
    """Study and scenario as files make the very same campaign, and its cases the same figures."""
    for name in ("study.yaml", "scenario.yaml"):
        answer = client.get(f"/api/campaigns/{through}/files/{name}")
        (tmp_path / name).write_bytes(answer.content)
    theirs = create(read_design(tmp_path / "study.yaml"), tmp_path / "made")
    ours = open_campaign(Path(store.root) / through / "campaign")
    assert theirs.identity == ours.identity
    expected = compute(theirs.work(0))
    assert ours.read(0).to_bytes() == expected.to_bytes()
    told = result(client, through)
    drive_1 = next(line for line in told["scatter"]["lines"] if line["line"] == "drive_1")
    amplitudes = expected.figures["amplitude"][:, expected.lines.index("drive_1")]
    assert drive_1["amplitude"] == pytest.approx(amplitudes, rel=1e-5)
    assert told["worst"][0]["case"] == int(np.nanargmax(told["scatter"]["largest"]))
    [level] = told["percentiles"]
    assert level["median"]["why"].startswith("open: not known in")  # records of 1 s resolve no mode
    assert level["p95"]["value"] is None  # eight draws bound no such percentile
    assert {"statistics.csv", "worst.csv", "effects.csv"} <= set(told["files"])
    report = client.get(f"/api/campaigns/{through}/files/report.html")
    assert report.status_code == 200
    worst = float(told["worst"][0]["labels"]["motor.torque_constant"].split()[0])
    assert f"{worst:.4g}" in report.text
    assert client.get(f"/api/campaigns/{through}/files/samples.npy").status_code == 404


@pytest.mark.long
def test_a_case_is_a_scenario_of_the_form(client, store, through):
    design = open_campaign(Path(store.root) / through / "campaign").design
    case = client.get(f"/api/campaigns/{through}/cases/5").json()
    assert set(case["changes"]) == {"motor.torque_constant", "reducer.damping"}
    changed = {**SHORT, **case["changes"]}
    assert scenario(Spec(base="state-1", changes=changed)) == design.scenario(5)
    assert client.get(f"/api/campaigns/{through}/cases/8").status_code == 422
    assert client.get(f"/api/campaigns/{through}/cases/-1").status_code == 422


@pytest.mark.release
def test_a_campaign_goes_on_where_it_was_cancelled_and_after_a_restart(tmp_path):
    """Its verdict is not given before all cases are computed, and those that are stay as they are."""
    limits = Limits()
    with opened_library(tmp_path / "library") as library:
        store = Store(folder(tmp_path / "first"), limits, library)
        client = client_of(store)
        id = started(client, count=64)
        first = begun(client, id)
        assert 0 < first["computed"] < first["cases"] == 64
        assert first["verdict"] != "pass"
        client.delete(f"/api/jobs/{id}")
        assert wait(client, id)["state"] == "cancelled"
        before = {path.name: path.read_bytes() for path in chunks(library, id)}
        assert 0 < len(before) < 8
        assert client.post(f"/api/campaigns/{id}/resume").status_code == 202
        assert wait(client, id, "running", "done")["state"] in ("running", "done")
        close(store)
    with opened_library(tmp_path / "library") as library:
        store = Store(folder(tmp_path / "second"), limits, library)
        client = client_of(store)
        if client.get(f"/api/jobs/{id}").json()["state"] != "done":
            assert client.get(f"/api/campaigns/{id}/so-far").json()["cases"] == 64
            assert client.post(f"/api/campaigns/{id}/resume").status_code == 202
        told = result(client, id)
        assert told["computed"] == 64
        after = {path.name: path.read_bytes() for path in chunks(library, id)}
        assert len(after) == 8
        assert all(after[name] == data for name, data in before.items())
        assert client.post(f"/api/campaigns/{id}/resume").status_code == 409
        close(store)


def folder(path: Path) -> Path:
    path.mkdir()
    return path


def chunks(library, id: str) -> list[Path]:
    return sorted((library.folder(id) / "campaign" / "chunks").glob("*.npz"))


def close(store: Store) -> None:
    store.close()
    store.join()


@pytest.mark.parametrize(
    ("more", "key", "words"),
    [
        ({"vary": {}}, "vary", "at least one key to vary"),
        ({"vary": {"motor.torque_constant": {"distribution": "normal"}}}, "motor.torque_constant", "give deviation"),
        ({"vary": {"motor.torque_constant": {"distribution": "file"}}}, "motor.torque_constant", "normal, uniform"),
        ({"vary": {"motor.torque_constant": ["1 V"]}}, "motor.torque_constant", "wrong dimension"),
        ({"vary": {"motor.wheels": NORMAL}}, "motor.wheels", "is not a key of the scenario"),
        ({"vary": {"array.from": ["/etc/passwd"]}}, "array.from", "opens no files"),
        ({"vary": {"array.fem": ["/etc/passwd"]}}, "array.fem", "opens no files"),
        ({"limit": "/etc/passwd"}, "limit", ""),
        ({"limit": "allowed.csv"}, "limit", ""),
        ({"limit": "3 N"}, "limit", "wrong dimension"),
        ({"limit": None, "band": "1:5 Hz"}, "band", ""),
        ({"count": 2001}, "count", "2000"),
        ({"vary": {**SMALL["vary"], "motor.current": {"from": "0.3 A", "to": "0.4 A", "count": "300"}}}, "count", "at most 2000"),
        ({"vary": {"motor.current": {"from": "0.3 A", "to": "0.4 A", "count": "many"}}}, "motor.current", "whole number"),
        ({"study": "study.yaml"}, "study", "not"),
        ({"folder": "/tmp"}, "folder", "not"),
        ({"scenario": spec(record__duration="4000 s")}, "record.duration", "more than the page keeps"),
    ],
)  # fmt: skip
def test_a_campaign_that_cannot_be(client, more, key, words):
    answer = client.post("/api/campaigns", json={**SMALL, **more})
    assert answer.status_code == 422, answer.text
    assert answer.json()["key"] == key, answer.text
    assert words in answer.json()["error"]
    assert "passwd" not in json.dumps(answer.json()) or key == "limit"


def test_only_a_campaign_is_one(client, finished):
    for path in ("so-far", "cases/0", "files/results.nc"):
        assert client.get(f"/api/campaigns/{finished}/{path}").status_code == 404
    assert client.post(f"/api/campaigns/{finished}/resume").status_code == 404
