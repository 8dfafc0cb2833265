"""A queue, cancelled and killed workers, memory, time and room: nothing takes the server down."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import ExitStack
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient
from support.server import LONG, SHORT, client_of, opened, result, spec, start, wait

from microvib.web.jobs.store import Store
from microvib.web.server.limits import Limits


def test_two_at_a_time_then_a_queue_then_a_refusal_and_cancelling_frees_the_slot(client):
    running = [start(client, LONG) for _ in range(2)]
    for id in running:
        wait(client, id, "running")
    waiting = [start(client, SHORT), start(client, LONG)]
    full = client.post("/api/runs", json={"scenario": spec()})
    assert full.status_code == 429
    assert (
        full.json()["error"] == "2 computations are waiting already; cancel some, or wait for them"
    )
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
    with ExitStack() as stack:

        def make(**limits) -> tuple[TestClient, Store]:
            store = stack.enter_context(opened(tmp_path, replace(Limits(), **limits)))
            return client_of(store), store

        yield make


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
    assert (job["state"], job["error"]) == (
        "failed",
        "stopped after 1.5 s, the longest that is allowed here",
    )
    ids = []
    for _ in range(4):
        ids.append(start(client, SHORT))
        wait(client, ids[-1])
    known = [job["id"] for job in client.get("/api/jobs").json()]
    assert len(known) <= 3
    assert ids[-1] in known
    assert client.get(f"/api/runs/{ids[0]}/series", params={"channels": "T_d"}).status_code == 404
    assert len([p for p in store.root.iterdir() if p.is_dir()]) == len(known)
