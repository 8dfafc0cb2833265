"""Recordings on the page: windows of their time histories."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.server import client_of, result, spec

from microvib.io.recordings import write_recording
from microvib.testdata.recording import Recording
from microvib.web.jobs.library import opened_library
from microvib.web.jobs.store import Store
from microvib.web.server.limits import Limits

RATE = 1000.0


def a_test(samples: int = 60_000, seed: int = 1) -> Recording:
    """A tone in noise with one large sample."""
    t = np.arange(samples) / RATE
    x = 0.02 * np.sin(2.0 * np.pi * 53.0 * t)
    x += np.random.default_rng(seed).normal(0.0, 1e-3, samples)
    x[samples // 3] = 0.7
    return Recording({"Mz": x, "Fx": 3.0 * x}, RATE, {"Mz": "N*m", "Fx": "N"}, "test")


def sent(client, recording: Recording, folder: Path, name: str = "test.mat") -> dict:
    write_recording(recording, folder / name)
    answer = client.post(
        "/api/recordings", params={"name": name}, content=(folder / name).read_bytes()
    )
    assert answer.status_code == 200, answer.text
    return answer.json()


def window(client, id: str, **query) -> dict:
    answer = client.get(
        f"/api/recordings/{id}/series", params={"channel": "Mz", "points": 200, **query}
    )
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.mark.parametrize("name", ["test.mat", "test.uff", "test.csv"])
def test_a_window_shows_every_sample_or_the_extremes_of_all(client, tmp_path, name):
    recording = a_test()
    kept = sent(client, recording, tmp_path, name)
    x = recording["Mz"]
    whole = window(client, kept["id"])
    assert not whole["exact"]
    assert len(whole["t"]) <= 200
    assert max(whole["max"]) == pytest.approx(0.7, rel=1e-6)
    assert min(whole["min"]) == pytest.approx(x.min(), rel=1e-6)
    near = window(client, kept["id"], **{"from": 19.9, "to": 20.1})
    assert near["exact"]
    assert near["max"] == []
    first = round(near["t"][0] * RATE)
    assert near["min"] == pytest.approx(x[first : first + len(near["min"])], rel=1e-5, abs=1e-9)
    assert max(near["min"]) == pytest.approx(0.7)
    force = window(client, kept["id"], channel="Fx")
    assert force["unit"] == "N"
    assert max(force["max"]) == pytest.approx(2.1)


def test_windows_that_are_none(client, tmp_path):
    kept = sent(client, a_test(4000), tmp_path)
    for query in ({"from": 9.0, "to": 12.0}, {"from": -5.0, "to": -1.0}, {"from": 3.0, "to": 1.0}):
        window(client, kept["id"], **query)
    address = f"/api/recordings/{kept['id']}/series"
    missing = client.get(address, params={"channel": "My"})
    assert (missing.status_code, missing.json()["key"]) == (404, "channel")
    assert missing.json()["error"] == "there is no channel 'My'; there are Mz, Fx"
    for query in ({"from": "nan"}, {"points": 0}, {"points": 10**6}, {"to": "inf"}):
        assert client.get(address, params={"channel": "Mz", **query}).status_code == 422
    assert client.get("/api/recordings/0123456789abcdef/series?channel=Mz").status_code == 404


def test_samples_that_are_no_numbers_are_gaps(client, tmp_path):
    recording = a_test(4000)
    x = recording["Mz"].copy()
    x[1000:1010] = np.nan
    kept = sent(client, Recording({"Mz": x}, RATE, {"Mz": "N*m"}), tmp_path)
    seen = window(client, kept["id"], **{"from": 0.99, "to": 1.02})
    assert seen["min"].count(None) == 10


@pytest.mark.parametrize("lost", [True, False])
def test_a_recording_and_its_samples_outlast_the_server(tmp_path, lost):
    """Also one that an older version kept without its samples."""
    library = tmp_path / "library"
    recording = a_test()
    for turn in range(2):
        with opened_library(library) as entries:
            root = tmp_path / f"root-{turn}"
            root.mkdir()
            store = Store(root, Limits(), entries)
            client = client_of(store)
            if turn == 0:
                kept = sent(client, recording, tmp_path)
                before = window(client, kept["id"])
                folder = library / "entries" / kept["id"]
                if lost:
                    for file in (*folder.glob("*.samples"), folder / "channels.json"):
                        file.unlink()
            assert window(client, kept["id"]) == before
            store.close()
            store.join()


def test_an_analysis_of_the_samples_is_that_of_the_file(client, store, tmp_path):
    """Samples beside a file stand for it; where they are broken the file is read."""
    kept = sent(client, a_test(), tmp_path)
    asked = {"recording": kept["id"], "scenario": spec()}
    found = result(client, client.post("/api/analyses", json=asked).json()["id"])
    folder = store.upload(kept["id"]).folder
    head = json.loads((folder / "channels.json").read_text())
    (folder / "channels.json").write_text(json.dumps(head | {"format": 0}))
    read = result(client, client.post("/api/analyses", json=asked).json()["id"])
    assert read == found
    for channel in folder.glob("*.samples"):
        channel.write_bytes(channel.read_bytes()[:-8])
    (folder / "channels.json").write_text(json.dumps(head))
    assert result(client, client.post("/api/analyses", json=asked).json()["id"]) == found


def test_recordings_make_room_for_newer_ones(tmp_path):
    """By their number, and by the bytes of their files and samples together; the newest stays."""
    (tmp_path / "root").mkdir()
    store = Store(tmp_path / "root", Limits(recordings=3, recorded=2_500_000))
    client = client_of(store)
    small = [sent(client, a_test(1000), tmp_path, f"{k}.mat")["id"] for k in range(4)]
    there = [client.get(f"/api/recordings/{id}").status_code for id in small]
    assert there == [404, 200, 200, 200]
    large = sent(client, a_test(90_000), tmp_path, "large.mat")["id"]
    there = [client.get(f"/api/recordings/{id}").status_code for id in (*small, large)]
    assert there == [404, 404, 404, 404, 200]
    assert [folder.name for folder in store.root.iterdir()] == [large]
    store.close()
    store.join()
