"""One server for all tests of a process, a short run that it finished, and the same run outside of it."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from support.server import SHORT, client_of, opened, start, wait

import microvib as mv
from microvib.web.server.limits import Limits


@pytest.fixture(scope="session")
def store(tmp_path_factory):
    with opened(tmp_path_factory.mktemp("store"), Limits(waiting=2, recording=3_000_000)) as store:
        yield store


@pytest.fixture(scope="session")
def client(store) -> TestClient:
    return client_of(store)


@pytest.fixture(scope="session")
def finished(client) -> str:
    """A short run of state 1."""
    id = start(client, SHORT)
    assert wait(client, id)["state"] == "done"
    return id


@pytest.fixture(scope="session")
def motion() -> mv.Motion:
    return mv.simulate(mv.load_scenario("state-1", SHORT))
