"""Who is answered: hosts, origins, tokens, cookies and keys; what no request should be is refused in a sentence."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from support.server import BASE, client_of, spec


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
        store,
        "",
        remote=True,
        names=frozenset({"drive.example"}),
        cookie="microvib-1",
        session="c00kie",
        key="k3y",
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
        (
            {"cookie": 'a={"b": [1]}; microvib-1=x; microvib-1=c00kie; c', "x-microvib-key": "k3y"},
            200,
        ),
        (
            {
                "cookie": "microvib-1=c00kie",
                "x-microvib-key": "k3y",
                "sec-fetch-site": "same-origin",
            },
            200,
        ),
        (
            {"cookie": "microvib-1=c00kie", "x-microvib-key": "k3y", "sec-fetch-site": "same-site"},
            403,
        ),
        (
            {
                "cookie": "microvib-1=c00kie",
                "x-microvib-key": "k3y",
                "sec-fetch-site": "cross-site",
            },
            403,
        ),
    ],
)
def test_only_the_owner_is_answered(stranger, headers, status):
    answer = stranger.get("/api/jobs", headers=headers)
    assert answer.status_code == status
    if status == 401:
        assert answer.json()["error"].startswith(
            "open the address that microvib serve printed last"
        )


def test_strangers_get_the_empty_page_and_nothing_else(stranger, finished):
    assert "<html" in stranger.get("/").text
    assert stranger.get("/static/app.js").status_code == 200
    owned = [
        f"/api/runs/{finished}/files/lines.csv",
        f"/api/runs/{finished}/exports/state-space.npz",
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
    assert [stranger.get(path, headers=cookie).status_code for path in owned] == [
        200,
        200,
        401,
        401,
        401,
        401,
    ]  # links


def test_the_token_is_exchanged(stranger):
    for wrong in ("/?token=", "/?token=wrong", "/?token=s3cret2"):
        assert stranger.get(wrong).status_code == 401
    for content in (b"", b"token=wrong", b"x" * 5000):
        assert stranger.post("/enter", content=content).status_code == 401
    named = {
        "host": "drive.example",
        "origin": "null",
        "sec-fetch-site": "cross-site",
    }  # a file that is opened
    for entered in (
        stranger.get("/?token=s3cret", headers=named),
        stranger.post("/enter", content=b"token=s3cret", headers=named),
    ):
        assert entered.status_code == 200
        assert (
            entered.headers["set-cookie"] == "microvib-1=c00kie; Path=/; HttpOnly; SameSite=Strict"
        )
        assert entered.headers["cache-control"] == "no-store"
        assert entered.headers["referrer-policy"] == "no-referrer"
        assert 'content="k3y"' in entered.text
        assert "s3cret" not in entered.text
    assert stranger.get("/?token=s3cret", headers={"host": "evil.example"}).status_code == 403


def test_requests_are_bounded(client):
    large = client.post(
        "/api/scenario", content=b"x" * 2_000_001, headers={"content-type": "application/json"}
    )
    assert large.status_code == 413
    assert "at most 2 MB" in large.json()["error"]
    assert (
        client.post("/api/recordings", params={"name": "x.csv"}, content=iter([b"a"])).status_code
        == 411
    )


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
        (
            "POST",
            "/api/scenario",
            b'{"base": "state-1", "changes": {' + b'"a":"",' * 100_000 + b'"a":""}}',
            413,
        ),
        ("POST", "/api/scenario", '{"base": "state-1"}'.encode("utf-16"), 422),
        ("POST", "/api/scenario", b'{"base": "state-1", "text": "x"}', 422),
        ("POST", "/api/scenario", b'{"base": "\\ud800"}', 422),
        ("POST", "/api/scenario", b'{"base": "state-1", "more": 1}', 422),
        ("POST", "/api/scenario", b"\xff\xfe", 422),
    ],
)
def test_every_refusal_is_a_sentence(client, method, path, content, status):
    answer = client.request(
        method, path, content=content, headers={"content-type": "application/json"}
    )
    assert answer.status_code == status, answer.text
    assert set(answer.json()) == {"error", "key"}
    assert answer.json()["error"]
    assert "Traceback" not in answer.text


def test_a_fault_of_the_program_is_a_sentence_and_a_line_in_the_log(client, monkeypatch, caplog):
    monkeypatch.setattr("microvib.web.routes.forms.view_of", lambda spec: 1 / 0)
    answer = client.post("/api/scenario", json=spec())
    assert answer.status_code == 500
    assert answer.json() == {
        "error": "internal error of the server; its log says more",
        "key": None,
    }
    assert "POST /api/scenario: division by zero" in caplog.text


@pytest.mark.parametrize("name", ["app.js", "plotly.min.js", "shapes.js"])
def test_a_browser_that_has_a_script_is_not_sent_it_again(client, name):
    first = client.get(f"/static/{name}")
    assert (first.status_code, first.headers["cache-control"]) == (200, "no-cache")
    again = client.get(f"/static/{name}", headers={"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
