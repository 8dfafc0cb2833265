"""What outlasts the server: runs, studies and recordings, whole or not at all, for their owner alone."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from support.server import SHORT, client_of, result, spec, start, wait

from microvib import __version__
from microvib.errors import MicrovibError
from microvib.io.user_folders import seal_key
from microvib.io.writing import workspace
from microvib.web.jobs.library import InUse, opened_library
from microvib.web.jobs.store import Store
from microvib.web.server.limits import Limits

RECORDING = "time [s],Mz [N*m]\n" + "".join(
    f"{k / 200!r},{0.01 * math.sin(2 * math.pi * 12 * k / 200)!r}\n" for k in range(4000)
)
ID = "0123456789abcdef"


@pytest.fixture
def serving(tmp_path):
    """Starts a server on a library, and ends the one before."""
    with ExitStack() as last:

        def again(folder: Path = tmp_path / "library", **limits):
            last.close()
            library = last.enter_context(opened_library(folder))
            root = last.enter_context(workspace(library.root, "page"))
            store = Store(root, replace(Limits(), **limits), library)
            last.callback(store.join)
            last.callback(store.close)
            return client_of(store)

        yield again


def entries(client) -> list[dict]:
    return client.get("/api/library").json()["entries"]


def upload(client, name: str = "test.csv") -> str:
    answer = client.post("/api/recordings", params={"name": name}, content=RECORDING.encode())
    assert answer.status_code == 200, answer.text
    return answer.json()["id"]


def test_runs_studies_and_recordings_survive_a_restart(serving):
    client = serving()
    run = start(client, SHORT, name="my run", steady=False)
    recording = upload(client)
    before = result(client, run)
    body = {"scenario": spec(), "from": "0.02 deg/s", "to": "0.2 deg/s", "count": 5, "linear": True}
    rates = client.post("/api/rates", json=body).json()["id"]
    analysis = client.post("/api/analyses", json={"recording": recording, "scenario": spec()})
    made = [rates, analysis.json()["id"]]
    answers = [result(client, id) for id in made]
    limit = {"limit": "30 mN*m"}
    verdict = client.get(f"/api/runs/{run}/verdict", params=limit).json()
    spectrum = client.get(f"/api/runs/{run}/spectrum").json()

    client = serving()
    assert {entry["id"] for entry in entries(client)} == {run, recording, *made}
    assert result(client, run) == before
    assert [result(client, id) for id in made] == answers
    assert client.get(f"/api/runs/{run}/spectrum").json() == spectrum
    assert client.get(f"/api/runs/{run}/verdict", params=limit).json() == verdict
    assert client.get(f"/api/runs/{run}/files/report.html").status_code == 200
    assert client.get(f"/api/recordings/{recording}").json()["samples"] == 4000
    asked = client.get(f"/api/library/{run}").json()["asked"]
    assert (asked["scenario"]["changes"], asked["name"]) == (SHORT, "my run")
    again = client.post("/api/analyses", json={"recording": recording, "scenario": spec()})
    assert result(client, again.json()["id"])["spectrum"] == answers[1]["spectrum"]


@pytest.mark.release
def test_budgets_and_envelopes_survive_a_restart_with_their_reports(serving):
    client = serving()
    run = start(client, SHORT)
    assert wait(client, run)["state"] == "done"
    craft = (Path(__file__).parents[2] / "examples" / "spacecraft.yaml").read_text()
    required = "requirements: [{name: P-1, metric: rpe, window: 10 ms, limit: 0.02 urad}]"
    asked = {"scenario": {"text": craft}, "requirement": required, "steady": True}
    made = [
        client.post("/api/budgets", json=asked).json()["id"],
        client.post("/api/envelopes", json={"members": [run], "limit": "60 mN*m"}).json()["id"],
    ]
    answers = [result(client, id) for id in made]
    reports = [client.get(f"/api/studies/{id}/files/report.html").text for id in made]
    assert answers[0]["verdict"] == "pass"
    assert "members.csv" in answers[1]["files"]

    client = serving()
    assert [result(client, id) for id in made] == answers
    assert [client.get(f"/api/studies/{id}/files/report.html").text for id in made] == reports
    again = client.post("/api/envelopes", json={"members": [run], "limit": "60 mN*m"})
    assert result(client, again.json()["id"])["files"] == answers[1]["files"]


def test_names_and_attributes_can_be_changed_and_stay(serving):
    client = serving()
    id = upload(client)
    changes = {"title": "unit 2, +Z", "attributes": {"unit": "2", "axis": "+Z"}}
    answer = client.patch(f"/api/library/{id}", json=changes)
    assert answer.json() | changes == answer.json()
    wrong = [{"title": ""}, {"title": 201 * "x"}, {"id": ID}, {"attributes": {201 * "x": "1"}}]
    assert [client.patch(f"/api/library/{id}", json=one).status_code for one in wrong] == 4 * [422]
    client = serving()
    (entry,) = entries(client)
    assert entry | changes == entry
    assert client.get(f"/api/recordings/{id}").json()["name"] == "unit 2, +Z"
    assert client.patch(f"/api/library/{ID}", json={"title": "x"}).status_code == 404


def test_what_is_deleted_can_be_brought_back_until_the_server_ends(serving, tmp_path):
    client = serving()
    first, second = upload(client), start(client, SHORT)
    wait(client, second)
    for id in (first, second):
        assert client.delete(f"/api/library/{id}").status_code == 204
        assert client.delete(f"/api/library/{id}").status_code == 404
    assert entries(client) == []
    assert client.get(f"/api/jobs/{second}").status_code == 404
    assert client.post(f"/api/library/{second}/restore").json()["id"] == second
    assert result(client, second)["lines"]
    client = serving()
    assert [entry["id"] for entry in entries(client)] == [second]
    assert client.post(f"/api/library/{first}/restore").status_code == 404
    assert not list(tmp_path.rglob(f"*{first}*"))


def test_entries_are_addressed_by_ids_alone(serving, tmp_path):
    client = serving()
    (tmp_path / "other").mkdir()
    for name in (
        "..",
        "../other",
        "..%2fother",
        "%2e%2e%2fother",
        "ABCDEF0123456789",
        f"{ID}%2f..",
        f"{ID}/entry.json",
        "/etc",
    ):
        for method in ("GET", "DELETE", "PATCH"):
            answer = client.request(method, f"/api/library/{name}", json={"title": "x"})
            assert answer.status_code in (404, 405, 422), (method, name)
    assert (tmp_path / "other").is_dir()


def test_a_library_is_bounded_and_what_is_to_stay_stays(serving):
    client = serving(recordings=2)
    first = upload(client, "first.csv")
    client.patch(f"/api/library/{first}", json={"kept": True})
    others = [upload(client, f"{k}.csv") for k in range(3)]
    assert {entry["id"] for entry in entries(client)} == {first, *others[1:]}
    assert {entry["id"] for entry in entries(serving())} == {first, *others[1:]}


def test_one_server_has_a_library_at_a_time(serving, tmp_path):
    serving()
    with pytest.raises(InUse, match="in use"), opened_library(tmp_path / "library"):
        pass


def test_a_folder_with_other_content_or_of_others_is_no_library(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with (
        pytest.raises(MicrovibError, match=r"holds other content \(thesis.txt\)"),
        opened_library(tmp_path),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    if sys.platform == "win32":
        return
    open_to_all = tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    (tmp_path / "link").symlink_to(tmp_path)
    for folder in (open_to_all, tmp_path / "link"):
        with pytest.raises(MicrovibError, match="folder of your own"), opened_library(folder):
            pass


def test_what_is_not_whole_or_not_ours_is_not_an_entry(serving, tmp_path):
    client = serving()
    id = upload(client)
    folder = tmp_path / "library" / "entries"
    whole = json.loads((folder / id / "entry.json").read_text())

    def put(name: str, text: str) -> None:
        (folder / name).mkdir()
        (folder / name / "entry.json").write_text(text)

    put("1" * 16, json.dumps(whole))  # another's description
    put("2" * 16, json.dumps(whole)[:40])
    put("3" * 16, "[]")
    put("readme", json.dumps(whole | {"id": "readme"}))
    (folder / ("4" * 16)).mkdir()
    (folder / ("5" * 16)).symlink_to(folder / id)
    if sys.platform != "win32":
        put("6" * 16, json.dumps(whole | {"id": "6" * 16}))
        (folder / ("6" * 16)).chmod(0o777)
    assert [entry["id"] for entry in entries(serving())] == [id]


def test_a_pickle_that_another_wrote_is_not_read(serving, tmp_path):
    """A library that came from elsewhere shows its figures, and runs nothing."""
    client = serving()
    id = start(client, SHORT)
    wait(client, id)
    seen = tmp_path / "seen"
    folder = tmp_path / "library" / "entries" / id
    bad = f"cposix\nsystem\n(S'touch {seen}'\ntR.".encode()
    (folder / "run.pickle").write_bytes(bad)
    client = serving()
    assert result(client, id)["lines"]
    for path in ("verdict?limit=30+mN*m", "files/report.html", "exports/state-space.npz"):
        answer = client.get(f"/api/runs/{id}/{path}")
        assert answer.status_code == 409, path
        assert "run it again" in answer.json()["error"]
    assert not seen.exists()
    assert client.get(f"/api/runs/{id}/files/lines.csv").status_code == 200


def test_a_run_of_another_version_says_so(serving, tmp_path):
    client = serving()
    id = start(client, SHORT)
    wait(client, id)
    file = tmp_path / "library" / "entries" / id / "entry.json"
    file.write_text(file.read_text().replace(__version__, "0.0.1"))
    client = serving()
    answer = client.get(f"/api/runs/{id}/verdict", params={"limit": "30 mN*m"})
    assert (answer.status_code, "another version" in answer.json()["error"]) == (409, True)


def test_a_full_disk_costs_no_result(serving, monkeypatch, tmp_path):
    client = serving()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("microvib.web.jobs.library.os.rename", full)
    id = start(client, SHORT)
    assert result(client, id)["lines"]
    assert entries(client) == []
    monkeypatch.undo()
    assert not list((tmp_path / "library" / "entries").iterdir())


def test_the_key_that_seals_is_the_users_own_and_stays(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("microvib.io.user_folders.sys.platform", "linux")
    first = seal_key()
    assert seal_key() == first
    assert len(first) == 32
    if os.name == "posix":
        file = tmp_path / "microvib" / "seal.key"
        assert file.stat().st_mode & 0o077 == 0
        file.chmod(0o666)  # others could have read or changed it
        assert seal_key() != first
    shutil.rmtree(tmp_path / "microvib")
    assert seal_key() != first


def test_strangers_see_no_library(serving, tmp_path):
    client = serving()
    id = upload(client)
    bare = {"authorization": ""}
    assert client.get("/api/library", headers=bare).status_code == 401
    assert client.delete(f"/api/library/{id}", headers=bare).status_code == 401
    foreign = {"origin": "http://evil.example"}
    assert client.delete(f"/api/library/{id}", headers=foreign).status_code == 403
    assert str(tmp_path) not in client.get("/api/library").text
