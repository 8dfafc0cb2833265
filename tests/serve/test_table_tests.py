"""A force table on the page: recordings prepared by a text and tables of the request, a hammer test, an acceptance
report; the same figures as the command line's, and no file of the server's machine.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from support.hammer import blows, resonance
from support.server import items, result, spec, wait
from support.tiers import at_a_release

import microvib as mv
from microvib.io.recordings import load_preparation, read_prepared, read_recording, write_recording
from microvib.io.scenario_file import load_bench
from microvib.reports.acceptance import acceptance_outcome
from microvib.reports.analysis import analysis_outcome
from microvib.reports.hammer import hammer_outcome
from microvib.reports.outcome import page_answer, text_files
from microvib.studies.acceptance import acceptance
from microvib.studies.analyse import analyse
from microvib.studies.hammer import Hits, hammer_test
from microvib.studies.measure import measure
from microvib.studies.repeatability import RecordedRun, repeatability
from microvib.testdata.recording import Recording

EXAMPLE = Path(__file__).parents[2] / "examples" / "acceptance"
HOW = """
detrend: 1
background: off.uff
table_frf: {file: frf.csv, mounted_mass: 12 kg, test_mass: 12 kg}
"""
TEMPLATE = """# Acceptance of {{ data.drive }}

Verdict: {{ test.verdict }}
{{ test.verdicts }}

## The table
{{ test.table_resonances }}

{% for run in runs %}
## {{ run.unit }}: {{ run.name }}
{{ run.limit }}
{% endfor %}
"""


class Files(NamedTuple):
    """A folder with recordings, and their ids on the page."""

    folder: Path
    ids: dict[str, str]
    frf: str
    """Text of the table's response."""


def alone(recording: Recording) -> Recording:
    """Its torque about the drive axis alone, without what is known of the table."""
    return replace(
        recording, channels={"Mz": recording["Mz"]}, units={"Mz": recording.units["Mz"]}, table=None
    )


@pytest.fixture(scope="module")
def files(client, tmp_path_factory) -> Files:
    folder = tmp_path_factory.mktemp("table")
    short = {"sample_rate": 1024.0, "filter_corner": 400.0, "duration": 8.0}
    bench = load_bench(str(EXAMPLE / "bench.yaml")).model_copy(update=short)
    drive = mv.load_scenario("state-1")
    made = {
        "a1.uff": alone(measure(drive, bench, seed=1)),
        "a2.uff": alone(measure(drive, bench, seed=2)),
        "off.uff": alone(measure(drive.with_({"tracking.rate": "0 deg/s"}), bench, seed=7)),
        "hits.uff": blows([resonance("Mz", 310.0, 0.02)], noise=0.01, arm=0.2),
    }
    ids = {}
    for name, one in made.items():
        write_recording(one, folder / name)
        content = (folder / name).read_bytes()
        answer = client.post("/api/recordings", params={"name": name}, content=content)
        assert answer.status_code == 200, answer.text
        ids[name] = answer.json()["id"]
    (folder / "how.yaml").write_text(HOW)
    frf = text_files(hammer_outcome(by_hammer(folder)))["frf.csv"]
    (folder / "frf.csv").write_text(frf)
    return Files(folder, ids, frf)


def by_hammer(folder: Path):
    hits = Hits("Mz", read_recording(folder / "hits.uff"), 0.2)
    return hammer_test([hits], "hammer", mounted_mass="12 kg")


def started(client, path: str, **asked: Any) -> dict[str, Any]:
    answer = client.post(f"/api/{path}", json=asked)
    assert answer.status_code == 202, answer.text
    id = answer.json()["id"]
    return {"id": id, **result(client, id)}


def part(answer: dict[str, Any], title: str) -> dict[str, Any]:
    (found,) = [part for part in answer["parts"] if part["title"] == title]
    return found


def prepared_by(files: Files, **more: Any) -> dict[str, Any]:
    return {"prepare": HOW, "tables": {"frf.csv": files.frf}, **more}


def test_a_prepared_recording_is_that_of_the_command_line(client, files):
    """Corrected for the table, beside the background that the preparation names among the page's recordings."""
    asked = prepared_by(files, recording=files.ids["a1.uff"], scenario=spec())
    found = started(client, "analyses", **asked)
    source = read_prepared(files.folder / "a1.uff", load_preparation(files.folder / "how.yaml"))
    expected = analyse(source, name="a1.uff", scenario="state-1")
    told = page_answer(analysis_outcome(expected, with_spectra_files=False))
    assert part(found, "Lines") == part(told, "Lines")
    assert found["background"]
    said = str(found["parts"])
    assert "for the table's dynamics, by at most" in said
    assert str(files.folder) not in said
    bare = started(client, "analyses", recording=files.ids["a1.uff"], scenario=spec())
    assert part(bare, "Lines") != part(found, "Lines")


@pytest.mark.release
def test_a_background_that_is_chosen_is_prepared_alike_and_is_one(client, files):
    text = HOW.replace("background: off.uff\n", "")
    asked = {
        "recording": files.ids["a1.uff"],
        "scenario": spec(),
        "background": files.ids["off.uff"],
    }
    tables = {"frf.csv": files.frf}
    chosen = started(client, "analyses", **asked, prepare=text, tables=tables)
    named = started(client, "analyses", **asked | prepared_by(files, background=None))
    assert chosen["background_lines"] == named["background_lines"]
    assert chosen["lines"] == named["lines"]
    answer = client.post("/api/analyses", json=asked | prepared_by(files))
    job = wait(client, answer.json()["id"])
    assert job["error"] == "background: is stated in the preparation, too; leave one of them out"


def test_repeatability_and_comparison_are_of_prepared_recordings(client, files):
    tests = [{"recording": files.ids[name], "unit": "A"} for name in ("a1.uff", "a2.uff")]
    found = started(client, "repeated", **prepared_by(files, tests=tests, scenario=spec()))
    how = load_preparation(files.folder / "how.yaml")
    runs = [
        RecordedRun(name, read_prepared(files.folder / name, how), "A")
        for name in ("a1.uff", "a2.uff")
    ]
    expected = repeatability(runs, scenario="state-1", channels=["Mz"])
    line = next(line for line in expected.lines if line.line == "drive_1")
    (row,) = [
        row
        for row in items(part(found, "Lines of Mz"), "table")[0]["rows"]
        if row["line"] == "drive_1"
    ]
    assert float(row["mean_n_m"]) == pytest.approx(1e3 * line.mean, rel=1e-3)
    one, other = (files.ids[name] for name in ("a1.uff", "a2.uff"))
    asked = prepared_by(files, recording=one, other=other, scenario=spec())
    compared = started(client, "comparisons", **asked)
    assert "for the table's dynamics" in str(compared["parts"])


def test_a_hammer_test_is_that_of_the_library_and_its_response_corrects(client, files):
    asked = {"hits": [{"recording": files.ids["hits.uff"], "load": "Mz", "arm": "0.2 m"}]}
    found = started(client, "hammers", mounted_mass="12 kg", **asked)
    assert found["files"] == text_files(hammer_outcome(by_hammer(files.folder)))
    assert found["files"]["frf.csv"] == files.frf
    responses = next(part for part in found["parts"] if part["title"] == "Responses")
    (picture,) = items(responses, "picture")
    coherence = [y for shown, _, _, y in picture["points"] if shown.startswith("coherence")]
    rows = [line.split(",") for line in files.frf.splitlines()[1:]]
    assert coherence == pytest.approx([float(row[3]) for row in rows][: len(coherence)], abs=1e-6)
    assert len(coherence) > 100
    assert "report.html" in found["reports"]
    answer = client.get(f"/api/studies/{found['id']}/files/report.html")
    assert answer.status_code == 200
    assert "Hammer test" in answer.text


def test_an_acceptance_report_is_made_by_its_template(client, files):
    tests = [{"recording": files.ids[name], "unit": "A"} for name in ("a1.uff", "a2.uff")]
    hits = {"hits": [{"recording": files.ids["hits.uff"], "load": "Mz", "arm": "0.2 m"}]}
    found = started(
        client, "acceptances",
        **prepared_by(files, tests=tests, scenario=spec(), limit="60 mN*m", band="1.5:120 Hz"),
        template=TEMPLATE, data="drive: SADA 7", reference="scenario",
        hammer={"mounted_mass": "12 kg", **hits},
    )  # fmt: skip
    how = load_preparation(files.folder / "how.yaml")
    drive = mv.load_scenario("state-1")
    expected = acceptance(
        [RecordedRun(n, read_prepared(files.folder / n, how), "A") for n in ("a1.uff", "a2.uff")],
        scenario=drive, limit=mv.Limit("60 mN*m", "1.5 Hz", "120 Hz"),
        reference=drive, reference_name=drive.title, hammer=by_hammer(files.folder),
    )  # fmt: skip
    assert found["verdict"] == expected.verdict == "pass"
    assert found["files"] == text_files(acceptance_outcome(expected))
    titles = [part["title"] for part in found["parts"]]
    assert titles == ["", "The table", "Repeatability", "Against the reference"]
    report = client.get(f"/api/studies/{found['id']}/files/report.html").text
    for words in ("Acceptance of SADA 7", "A: a1.uff", "A: a2.uff"):
        assert words in report, words


@pytest.mark.parametrize(
    ("path", "more", "key", "words"),
    [
        ("analyses", {"tables": {"../frf.csv": "x"}}, "tables", "the name of a table such as"),
        ("analyses", {"tables": {"/etc/passwd": ""}}, "tables", "the name of a table such as"),
        ("analyses", {"prepare": "x" * 200_001}, "prepare", "at most 200000"),
        ("analyses", {"tables": {f"{k}.csv": "" for k in range(21)}}, "tables", "20"),
        ("hammers", {"hits": [{"load": "Mz"}]}, "arm", "is missing; Mz is a torque"),
        ("hammers", {"hits": [{"load": "Fz", "arm": "1 m"}]}, "arm", "Fz is a force and has none"),
        ("hammers", {"hits": [{"load": "Mz", "arm": "0 m"}]}, "arm", "of 0 m makes no torque"),
        ("hammers", {"hits": [{"load": "Mz", "arm": "2"}]}, "arm", "needs a unit"),
        ("hammers", {"mounted_mass": "12"}, "mounted_mass", "needs a unit"),
        ("hammers", {"hits": []}, "hits", "at least 1"),
        ("acceptances", {"template": "  "}, "template", "is missing"),
        ("acceptances", {"units": ("A", "")}, "tests", "have a unit in part"),
        ("acceptances", {"limit": "limit.csv"}, "limit", "limit"),
        ("acceptances", {"reference": "/etc/passwd"}, "reference", "reference"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_at_once(client, files, path, more, key, words):
    answer = client.post(f"/api/{path}", json=asked_of(path, files, dict(more)))
    assert answer.status_code == 422, answer.text
    assert (answer.json()["key"] or "").startswith(key) or key in answer.json()["key"]
    assert words in answer.json()["error"]


def asked_of(path: str, files: Files, more: dict[str, Any]) -> dict[str, Any]:
    """A request that is right but for what is changed."""
    one = files.ids["a1.uff"]
    if path == "analyses":
        return {"recording": one, "scenario": spec(), **more}
    if path == "hammers":
        hits = more.pop("hits", [{"load": "Fz"}])
        whole = [{"recording": files.ids["hits.uff"], **hit} for hit in hits]
        return {"mounted_mass": "12 kg", "hits": whole, **more}
    units = more.pop("units", ("A", "A"))
    names = ("a1.uff", "a2.uff")
    tests = [{"recording": files.ids[n], "unit": u} for n, u in zip(names, units, strict=True)]
    return {"tests": tests, "scenario": spec(), "template": TEMPLATE, **more}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("table_frf: {file: /etc/passwd, mounted_mass: 0 kg, test_mass: 0 kg}", "'passwd' names a file, and it did not come with the request"),
        ("table_frf: {file: ../frf.csv, mounted_mass: 0 kg, test_mass: 0 kg}", "'../frf.csv' names a file"),
        ("response: [{kind: table, file: entry.json}]", "'entry.json' names a file"),
        ("bench: /etc/passwd", "names a file"),
        ("background: /etc/passwd", "there is no recording 'passwd' here"),
        ("background: hits.csv", "there is no recording 'hits.csv' here"),
        ("a: &a [*a]", "anchors and aliases"),
        ("detrend: 99", "detrend"),
        ("table_frf: {file: broken.csv, mounted_mass: 0 kg, test_mass: 0 kg}", "broken.csv"),
    ],
)  # fmt: skip
def test_a_preparation_opens_nothing_that_was_not_sent(client, store, files, text, words):
    asked = {"recording": files.ids["a1.uff"], "scenario": spec(), "prepare": text}
    answer = client.post("/api/analyses", json=asked | {"tables": {"broken.csv": "a,b\n1,2\n"}})
    assert answer.status_code == 202, answer.text
    id = answer.json()["id"]
    job = wait(client, id)
    assert job["state"] == "failed"
    assert words in job["error"]
    assert str(store.root) not in job["error"]
    assert list(store.folder(store.job(id)).iterdir()) == []  # nothing is left of what was sent


def test_no_door_opens_a_file_of_a_preparation(client, files):
    """Whatever is made of a recording: nothing is computed of one whose preparation names a file."""
    one, other = (files.ids[name] for name in ("a1.uff", "a2.uff"))
    sneaky = {"scenario": spec(), "prepare": "bench: /etc/passwd"}
    doors: dict[str, dict[str, Any]] = {
        "analyses": {"recording": one},
        "batches": {"recordings": [one, other]},
        "trackings": {"recording": one, "orders": "1,4"},
        "comparisons": {"recording": one, "other": other},
        "repeated": {"tests": [{"recording": one}, {"recording": other}]},
        "identifications": {"recordings": [one], "fit": ["motor.detent_torque=1 mN*m:20 mN*m"]},
        "acceptances": {"tests": [{"recording": one}], "template": TEMPLATE},
    }
    for path, asked in doors.items():
        answer = client.post(f"/api/{path}", json=asked | sneaky)
        assert answer.status_code == 202, (path, answer.text)
        job = wait(client, answer.json()["id"])
        assert job["state"] == "failed", path
        assert "names a file, and it did not come with the request" in job["error"], path


@pytest.mark.parametrize(
    ("template", "words"),
    [
        at_a_release("{{ test.colour }}", "test has no part 'colour'"),
        ("{% include '/etc/passwd' %}", "template"),
        ("{{ test.__class__.__mro__ }}", "template"),
        at_a_release("{{ ''.__class__ }}", "template"),
        at_a_release("{% macro f() %}{{ f() }}{% endmacro %}{{ f() }}", "template"),
        ("{% for k in range(10 ** 9) %}x{% endfor %}", "template"),
        ("{{ 'x' * 10 ** 11 }}", "template: takes too much memory"),
        at_a_release("{{ data.drive }}", "data has no 'drive'"),
    ],
)
def test_a_template_reaches_nothing_else(client, files, template, words):
    answer = client.post(
        "/api/acceptances", json=asked_of("acceptances", files, {"template": template})
    )
    job = wait(client, answer.json()["id"])
    assert job["state"] == "failed", job
    assert words in job["error"]
    assert "fault of the program" not in job["error"]
