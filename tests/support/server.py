"""The page's server in the test's own process: a client that shows its token, and what is asked of
it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fastapi.testclient import TestClient

from microvib.web.jobs.store import Store
from microvib.web.server.access import Access
from microvib.web.server.application import create_app
from microvib.web.server.limits import Limits

BASE = "http://127.0.0.1:8321"
TOKEN = "s3cret"
SHORT = {"record.settle": "1 s", "record.duration": "4 s"}
LONG = {"record.settle": "100000 s"}


@contextmanager
def opened(folder: Path, limits: Limits) -> Iterator[Store]:
    """A store of jobs, whose workers are ended with it."""
    store = Store(folder, limits)
    yield store
    store.close()
    store.join()


def client_of(store: Store, shown: str = TOKEN, **access) -> TestClient:
    """A client that shows the token, or what is given."""
    app = create_app(store, Access(token=TOKEN, **access))
    headers = {"authorization": f"Bearer {shown}"} if shown else {}
    return TestClient(app, base_url=BASE, raise_server_exceptions=False, headers=headers)


def spec(**changes: str) -> dict:
    return {
        "base": "state-1",
        "changes": {key.replace("__", "."): text for key, text in changes.items()},
    }


def start(client: TestClient, changes: dict[str, str], **more) -> str:
    answer = client.post(
        "/api/runs", json={"scenario": {"base": "state-1", "changes": changes}, **more}
    )
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def wait(client: TestClient, id: str, *states: str, seconds: float = 300.0) -> dict:
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
    assert (
        str(client.app._app.state.store.root) not in answer.text
    )  # nothing of where the server keeps its files
    return answer.json()


def items(part: dict, kind: str) -> list[dict]:
    """The items of one kind, ``"table"`` for one, in a part of a result."""
    return [item for item in part["items"] if item["kind"] == kind]
