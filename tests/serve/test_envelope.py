"""Envelopes over what the page holds: the library's answer, under the names of their owner."""

from __future__ import annotations

import io
import math
from pathlib import Path

import pytest
from support.server import SHORT, result, spec, start, wait

import microvib as mv
from microvib.analysis.run import run_scenario
from microvib.io.limit_files import limit_from_text
from microvib.reports.envelope import envelope_outcome
from microvib.reports.outcome import text_files
from microvib.reports.rates import rates_outcome
from microvib.studies.envelope.members import NamedMember
from microvib.studies.envelope.study import envelope
from microvib.studies.rates import plan_rates, rate_grid

CURVE = "frequency_hz,t_mnm\n0.5,8\n10,8\n10,20\n40,80\n400,80\n"
SECOND = {**SHORT, "motor.detent_torque": "12 mN*m"}
RATES = {"from": "0.05 deg/s", "to": "0.06 deg/s", "count": 3, "linear": True}
CAMPAIGN = {
    "scenario": {"base": "state-1", "changes": SHORT},
    "solve": "record",
    "title": "batch",
    "vary": {"motor.detent_torque": {"distribution": "uniform", "within": "20 percent"}},
    "count": 8,
}


def post(client, members: list[str], **more) -> dict:
    answer = client.post("/api/envelopes", json={"members": members, **more})
    assert answer.status_code == 202, answer.text
    return result(client, answer.json()["id"])


@pytest.fixture(scope="module")
def second(client) -> str:
    """A run with more detent torque."""
    id = start(client, SECOND, name="second unit")
    assert wait(client, id)["state"] == "done"
    return id


def upload(client, phase: float) -> str:
    rows = io.StringIO("time [s],Mz [N*m]\n")
    rows.seek(0, io.SEEK_END)
    for k in range(4000):
        rows.write(f"{k / 500!r},{0.01 * math.sin(2 * math.pi * 53.3 * k / 500 + phase)!r}\n")
    answer = client.post(
        "/api/recordings", params={"name": "a test.csv"}, content=rows.getvalue().encode()
    )
    assert answer.status_code == 200, answer.text
    return answer.json()["id"]


def test_an_envelope_over_runs_is_that_of_the_library(client, finished, second):
    asked = {"statistics": ["max", "mean"], "limit": CURVE, "band": "1:150 Hz"}
    told = post(client, [finished, second], **asked)
    title = client.get(f"/api/jobs/{finished}").json()["title"]
    members = [
        NamedMember(name, run_scenario(mv.load_scenario("state-1", changes)))
        for name, changes in ((title, SHORT), ("second unit", SECOND))
    ]
    expected = envelope_outcome(
        envelope(
            members,
            statistics=["max", "mean"],
            limit=limit_from_text(CURVE).within("1:150 Hz"),
        )
    )
    assert told["files"] == text_files(expected)
    assert (told["summary"], told["verdict"]) == (expected.summary, expected.verdict)
    assert told["facts"][0]["label"] == "maximum, mean against the limit"
    assert "second unit" in told["files"]["members.csv"]


def test_an_envelope_over_a_rate_map_is_that_of_the_plan(client, tmp_path):
    id = client.post("/api/rates", json={"scenario": spec(), **RATES}).json()["id"]
    result(client, id)
    title = client.get(f"/api/jobs/{id}").json()["title"]
    told = post(client, [id], limit="60 mN*m")
    plan = plan_rates(
        mv.load_scenario("state-1"), rate_grid("0.05 deg/s", "0.06 deg/s", 3), linear=True
    )
    for name, text in text_files(rates_outcome(plan)).items():
        (tmp_path / name).write_text(text)
    expected = envelope([tmp_path], limit=mv.Limit("60 mN*m"))
    files = text_files(envelope_outcome(expected))
    assert told["files"] == {
        name: text.replace(str(tmp_path), title) for name, text in files.items()
    }


def test_recordings_and_runs_together(client, finished):
    """A recording counts once, however often it was sent."""
    one, other, copy = upload(client, 0.0), upload(client, 1.0), upload(client, 0.0)
    told = post(client, [finished, one, other], scenario=spec())
    assert told["facts"][0]["value"] == "3"
    assert "a test.csv (2)" in told["files"]["members.csv"]
    answer = client.post("/api/envelopes", json={"members": [one, copy]})
    job = wait(client, answer.json()["id"])
    assert job["error"] == "a test.csv: is given twice; a member counts once"


@pytest.mark.release
def test_an_envelope_over_a_campaign_has_percentiles_of_its_cases(client, store):
    id = client.post("/api/campaigns", json=CAMPAIGN).json()["id"]
    result(client, id)
    told = post(client, [id], statistics=["p95"], limit="60 mN*m")
    folder = store.folder(store.job(id)) / "campaign"
    expected = envelope([folder], statistics=["p95"], limit=mv.Limit("60 mN*m"))
    files = text_files(envelope_outcome(expected))
    assert told["files"] == {
        name: text.replace(str(folder), "batch") for name, text in files.items()
    }
    assert "batch, case 0" in told["files"]["members.csv"]
    assert told["verdict"] == "not judged"  # of eight cases no bound on the quantile is known


def test_an_envelope_has_a_report(client, finished):
    answer = client.post("/api/envelopes", json={"members": [finished]})
    id = answer.json()["id"]
    assert result(client, id)["reports"][0] == "report.html"
    assert "Envelope of 1 member" in client.get(f"/api/studies/{id}/files/report.html").text


@pytest.mark.parametrize(
    ("more", "status", "key", "words"),
    [
        ({"members": []}, 422, "members", "at least 1"),
        ({"members": ["/etc/passwd"]}, 422, "members.0", "match"),
        ({"members": ["0" * 16]}, 404, "members", "no longer here"),
        ({"statistics": ["p50"]}, 422, "statistics.0", "'max', 'mean', 'p95' or 'p99'"),
        ({"bandwidth": "wide"}, 422, "bandwidth", "wide"),
        ({"resolution": "1 N"}, 422, "resolution", "wrong dimension"),
        ({"limit": "30 kg"}, 422, "limit", "30 kg"),
        ({"limit": "allowed.csv"}, 422, "limit", "allowed.csv"),
        ({"limit": "a,b\n1,2\n"}, 422, "limit", "limit"),
        ({"scenario": spec(motor__current="1 V")}, 422, "motor.current", ""),
        ({"prepare": "how.yaml"}, 422, "prepare", "not"),
    ],
)
def test_an_envelope_that_cannot_be(client, finished, more, status, key, words):
    answer = client.post("/api/envelopes", json={"members": [finished], **more})
    assert answer.status_code == status, answer.text
    assert answer.json()["key"] == key, answer.text
    assert words in answer.json()["error"]


def test_what_has_no_lines_is_no_member(client, finished):
    id = client.post("/api/sas", json={"inertia": "8 kg*m^2", "frequency": "1 Hz"}).json()["id"]
    wait(client, id)
    answer = client.post("/api/envelopes", json={"members": [id]})
    assert answer.status_code == 422
    assert "is no member" in answer.json()["error"]
    answer = client.post("/api/envelopes", json={"members": [finished, finished]})
    assert answer.json()["error"] == "members: one is there twice; a member counts once"


def test_tables_of_a_map_that_an_older_version_kept_are_missed(client, store):
    id = client.post("/api/rates", json={"scenario": spec(), **RATES}).json()["id"]
    result(client, id)
    (Path(store.folder(store.job(id))) / "tables" / "rates.csv").rename(
        Path(store.folder(store.job(id))) / "rates.csv"
    )
    for file in (Path(store.folder(store.job(id))) / "tables").iterdir():
        file.unlink()
    (Path(store.folder(store.job(id))) / "tables").rmdir()
    answer = client.post("/api/envelopes", json={"members": [id]})
    job = wait(client, answer.json()["id"])
    assert job["error"].endswith("has no tables of its lines here; make it again")
