"""The page's files: packed, kept for ever under the digest of their contents, and each asked for once."""

from __future__ import annotations

import gzip
import re

import pytest

import microvib as mv
from microvib.analysis.lines import steady_lines
from microvib.web.server.assets import Assets

FILES = re.compile(r'(?:src|href)="(/static/[^"]+)"')


@pytest.fixture(scope="module")
def page(client) -> str:
    return client.get("/").text


def test_every_file_that_the_page_names_is_there_packed_and_lasting(client, page):
    names = FILES.findall(page)
    assert len(names) > 20
    for name in names:
        assert re.fullmatch(r"/static/[0-9a-f]{16}/[\w.]+", name)
        answer = client.get(name, headers={"accept-encoding": "gzip"})
        assert (answer.status_code, answer.headers["content-encoding"]) == (200, "gzip")
        assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert answer.headers["vary"] == "accept-encoding"
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        plain = client.get(name, headers={"accept-encoding": "identity"})
        assert "content-encoding" not in plain.headers
        assert plain.content == answer.content


def test_plotly_is_sent_at_a_third_of_its_length(client, page):
    digest = re.search(r"/static/([0-9a-f]{16})/", page)[1]
    name = f"/static/{digest}/plotly.min.js"
    plain = client.get(name, headers={"accept-encoding": "identity"})
    packed = client.get(name, headers={"accept-encoding": "gzip, br"})
    assert int(packed.headers["content-length"]) < int(plain.headers["content-length"]) / 3
    assert "plotly" not in page  # nobody waits for it


def test_an_address_of_other_contents_has_nothing(client):
    for name in ("0" * 16, "x"):
        answer = client.get(f"/static/{name}/app.js")
        assert answer.status_code == 404
        assert "immutable" not in answer.headers.get("cache-control", "")


def test_the_page_itself_is_asked_for_each_time_and_sent_once(client):
    first = client.get("/")
    assert first.headers["cache-control"] == "no-cache"
    again = client.get("/", headers={"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_the_digest_is_that_of_the_contents(monkeypatch, tmp_path):
    one, other = Assets(), Assets()
    assert one.digest == other.digest
    changed = tmp_path / "app.js"
    changed.write_text("// another")
    monkeypatch.setitem(other._paths, "app.js", changed)
    del other.__dict__["digest"]
    assert one.digest != other.digest
    assert gzip.decompress(other.get("app.js").packed) == b"// another"


def test_lines_at_once_are_those_of_the_linearised_drive_and_of_the_steady_state(client):
    spec = {"base": "state-1", "changes": {"motor.current": "0.5 A"}}
    scenario = mv.load_scenario("state-1", spec["changes"])
    answer = client.post("/api/lines", json={"scenario": spec})
    expected = steady_lines(scenario).lines
    found = {line["line"]: line["amplitude"] for line in answer.json()["lines"]}
    assert answer.json()["reason"] == ""
    assert found["drive_1"] == pytest.approx(expected["drive_1"].amplitude, rel=1e-9)
    linear = client.post("/api/lines", json={"scenario": spec, "linear": True}).json()["lines"]
    assert [line["line"] for line in linear] == [f"drive_{k}" for k in range(1, 9)]
    still = {"base": "state-1", "changes": {"tracking.rate": "0 deg/s"}}
    answer = client.post("/api/lines", json={"scenario": still, "linear": True})
    assert (answer.status_code, "constant rate" in answer.json()["error"]) == (422, True)
