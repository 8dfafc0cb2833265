"""The server against its own description: no request, however odd, is answered by a fault or by what is not described."""

from __future__ import annotations

import contextlib
from itertools import count
from pathlib import Path
from unittest import SkipTest

import pytest
import schemathesis
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from support.server import opened
from support.tiers import sweep

import microvib as mv
from microvib.web.server.access import Access
from microvib.web.server.application import create_app
from microvib.web.server.limits import Limits

pytestmark = pytest.mark.long
CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
]
ODD = settings(
    deadline=None,
    max_examples=8,
    suppress_health_check=list(HealthCheck),
    derandomize=True,
    phases=[Phase.generate],
)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store that takes little: whatever is started gives way soon, or is refused."""
    with opened(
        tmp_path_factory.mktemp("store"), Limits(at_once=1, waiting=4, wall_s=20.0, quick_s=5.0)
    ) as store:
        yield store


@pytest.fixture(scope="module")
def app(store):
    return create_app(store, Access(names=frozenset({"localhost", "testserver"}), token="s3cret"))


OWNER = {"authorization": "Bearer s3cret"}


@pytest.fixture(scope="module")
def known(app) -> str:
    """Id of a run that is done."""
    client = TestClient(app, headers=OWNER)
    quick = {"base": "state-1", "changes": {"record.settle": "0 s", "record.duration": "0.5 s"}}
    id = client.post("/api/runs", json={"scenario": quick}).json()["id"]
    assert '"state":"done"' in client.get(f"/api/jobs/{id}/events").text
    return id


@pytest.mark.parametrize(
    "mode", sweep(GenerationMode, GenerationMode.NEGATIVE), ids=lambda mode: mode.value
)
def test_every_answer_is_as_described(app, known, mode):
    """Half of the requests name a run and a scenario that exist, so that they get further than the first check."""
    described = schemathesis.openapi.from_asgi("/api/openapi.json", app, headers=OWNER)
    operations = [found.ok() for found in described.get_all_operations()]
    assert len(operations) >= 17
    number = count()

    for operation in operations:

        @given(case=operation.as_strategy(generation_mode=mode))
        @ODD
        def answered(case):
            if next(number) % 2 and case.method != "DELETE":
                if "id" in (case.path_parameters or {}):
                    case.path_parameters["id"] = known
                if isinstance(case.body, dict) and isinstance(case.body.get("scenario"), dict):
                    case.body["scenario"] = {"base": "state-1"}
            case.call_and_validate(checks=CHECKS, headers=OWNER)

        with contextlib.suppress(
            SkipTest, Unsatisfiable
        ):  # nothing can be wrong with a request without parameters
            answered()


KEYS = [key for key, _, _ in mv.load_scenario("state-1").entries()]
VALUES = st.one_of(
    st.text(max_size=30),
    st.floats().map(str),
    st.integers(-5, 10**9).map(str),
    st.sampled_from(
        [
            "rigid",
            "null",
            "[]",
            "{}",
            "[1, 2]",
            "{a: b}",
            "1e999 N",
            "-1 Hz",
            "1 N*m",
            "1 percent",
            "0 s",
            "y",
        ]
    ),
)
CHANGES = st.dictionaries(
    st.one_of(
        st.sampled_from([*KEYS, "array", "sources", "title", "array.fem", "motor", "record"]),
        st.text(max_size=20),
    ),
    VALUES,
    max_size=4,
)


@given(changes=CHANGES)
@settings(ODD, max_examples=50)
def test_whatever_is_typed_gets_an_answer_with_sentences(app, changes):
    """Any text in any field: the form answers, and what it calls right can be read back."""
    answer = TestClient(app, headers=OWNER).post(
        "/api/scenario", json={"base": "state-1", "changes": changes}
    )
    assert answer.status_code in (200, 422, 429), answer.text
    if answer.status_code != 200:
        return
    shown = answer.json()
    assert bool(shown["errors"]) == (shown["yaml"] is None)
    assert all(error["error"] and "\n" not in error["error"] for error in shown["errors"])
    if shown["yaml"] is not None:
        assert (
            TestClient(app, headers=OWNER)
            .post("/api/scenario", json={"text": shown["yaml"]})
            .json()["errors"]
            == []
        )


@given(
    text=st.one_of(
        st.text(max_size=200), st.sampled_from(KEYS).map(lambda key: f"{key}: [1, {{a: 2}}]")
    )
)
@settings(ODD, max_examples=40)
def test_whatever_is_uploaded_gets_a_sentence(app, text):
    answer = TestClient(app, headers=OWNER).post("/api/scenario", json={"text": text})
    assert answer.status_code == 200, answer.text
    assert answer.json()["errors"]


CRAFT = (Path(__file__).parents[1] / "examples" / "spacecraft.yaml").read_text()
NAMES = st.sampled_from(["/etc/passwd", "../a.csv", "a.csv", "harmonics.csv", "~/.ssh/id_rsa"])
PLACE = "position: [0 m, 0 m, 0 m]"
DESCRIPTIONS = st.one_of(
    st.text(max_size=200),
    NAMES,
    NAMES.map(lambda name: f"sources: [{{name: a, lines: {name}}}]"),
    NAMES.map(lambda name: f"sources: [{{name: a, density: {name}}}]"),
    NAMES.map(
        lambda name: (
            f"sources: [{{name: a, {PLACE}, wheel: {{speed: 9 rpm, axis: [0, 0, 1], table: {name}}}}}]"
        )
    ),
    st.sampled_from(["limit", "curve", "metric", "requirements"]).map(
        lambda key: f"requirements: [{{{key}: [1, {{a: 2}}]}}]"
    ),
)


@given(
    requirement=DESCRIPTIONS,
    sources=DESCRIPTIONS,
    tables=st.dictionaries(
        st.one_of(NAMES, st.text(max_size=20)), st.text(max_size=50), max_size=2
    ),
)
@settings(ODD, max_examples=60)
def test_whatever_is_sent_to_a_budget_is_answered_with_a_sentence(
    app, store, requirement, sources, tables
):
    """Of a craft, so that it is read; what is begun ends, and nothing tells of the server's files."""
    asked = {"scenario": {"text": CRAFT}, "requirement": requirement, "sources": sources}
    client = TestClient(app, headers=OWNER)
    answer = client.post("/api/budgets", json={**asked, "tables": tables})
    assert answer.status_code in (202, 422, 429), answer.text
    assert str(store.root) not in answer.text
    assert "root:" not in answer.text
    if answer.status_code == 202:
        client.delete(f"/api/jobs/{answer.json()['id']}")
    else:
        assert answer.json()["error"]
        assert "\n" not in answer.json()["error"]
