"""A pointing budget on the page: the library's answer, tables that come with the request, and no file of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.server import result, spec, wait
from support.tiers import sweep

import microvib as mv
from microvib.reports.budget import budget_outcome
from microvib.reports.designs import designs_outcome
from microvib.reports.outcome import text_files
from microvib.reports.typography import typeset_text
from microvib.studies.budget.angles import budget_over_angles
from microvib.studies.budget.designs import Designs
from microvib.studies.budget.study import pointing_budget

EXAMPLES = Path(__file__).parents[2] / "examples"
CRAFT = {"text": (EXAMPLES / "spacecraft.yaml").read_text()}
REQUIREMENT = (EXAMPLES / "requirement.yaml").read_text().partition("  - {name: P-2")[0]
SOURCES = (
    (EXAMPLES / "sources.yaml").read_text().replace("speed_to: 3000 rpm", "speed_to: 1050 rpm")
)
"""One requirement and a fortieth of the wheel's speeds: tests/test_budget.py takes the whole example."""
WHEEL = """
sources:
  - name: wheel 2
    position: [0.2 m, -0.3 m, 0.1 m]
    wheel: {speed: 1800 rpm, axis: [0, 0, 1], table: harmonics.csv}
"""
HARMONICS = "order,radial_force_n_rpm2,radial_torque_n_m_rpm2\n1,1.1e-8,1.1e-9\n2,3.3e-9,4e-10\n"


@pytest.fixture
def files(tmp_path) -> Path:
    """A folder of the files that requests bring as texts."""
    given = {
        "requirement.yaml": REQUIREMENT,
        "sources.yaml": SOURCES,
        "harmonics.csv": HARMONICS,
        "wheel.yaml": WHEEL,
    }
    for name, text in given.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def begun(client, **asked) -> str:
    answer = client.post("/api/budgets", json={"scenario": CRAFT, "steady": True, **asked})
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


@pytest.mark.long
@pytest.mark.parametrize("name", sweep(["wheel", "sources"], "wheel"))
def test_a_budget_is_that_of_the_library_and_has_a_report(client, files, name):
    """The same files to the last digit, and the report that says the same."""
    sources = (files / f"{name}.yaml").read_text()
    tables = {"harmonics.csv": HARMONICS} if name == "wheel" else {}
    asked = {"sources": sources, "tables": tables, "rule": "bound", "one_clock": True}
    id = begun(client, requirement=REQUIREMENT, **asked)
    told = result(client, id)
    expected = budget_outcome(
        pointing_budget(
            EXAMPLES / "spacecraft.yaml", files / "requirement.yaml", names=["drive"],
            sources=files / f"{name}.yaml", steady=True, rule="bound", one_clock=True,
        )
    )  # fmt: skip
    assert told["files"] == text_files(expected)
    assert (told["summary"], told["verdict"]) == (expected.summary, expected.verdict)
    wheel = "wheel 2" if name == "wheel" else "wheel 1"
    assert {row["source"] for row in told["parts"][2]["items"][0]["rows"]} == {"drive", wheel}
    answer = client.get(f"/api/studies/{id}/files/report.html")
    assert answer.status_code == 200
    assert "Pointing of a small craft" in answer.text
    assert typeset_text(expected.summary) in answer.text
    assert client.get(f"/api/studies/{id}/files/result.json").status_code == 404


@pytest.mark.release
def test_the_worst_of_several_angles_is_that_of_the_library(client, files):
    told = result(client, begun(client, requirement=REQUIREMENT, angles="0,45"))
    expected = budget_over_angles(
        EXAMPLES / "spacecraft.yaml", files / "requirement.yaml", names=["drive"],
        angles=["0 deg", "45 deg"], steady=True,
    )  # fmt: skip
    assert told["files"] == text_files(budget_outcome(expected))
    assert json.loads(told["files"]["budget.json"])["array_angles_deg"] == [0.0, 45.0]


@pytest.mark.release
def test_a_table_of_the_sources_comes_with_the_request(client, files):
    told = result(
        client,
        begun(client, requirement=REQUIREMENT, sources=WHEEL, tables={"harmonics.csv": HARMONICS}),
    )
    expected = pointing_budget(
        EXAMPLES / "spacecraft.yaml", files / "requirement.yaml", names=["drive"],
        sources=files / "wheel.yaml", steady=True,
    )  # fmt: skip
    assert told["files"] == text_files(budget_outcome(expected))


@pytest.mark.release
def test_two_designs_are_those_of_the_library(client, files):
    """The second with other microsteps and sources of its own, whose table comes with the request."""
    fine = {**CRAFT, "changes": {"driver.microsteps": "64"}}
    told = result(
        client,
        begun(
            client, requirement=REQUIREMENT, other=fine, other_sources=WHEEL,
            tables={"harmonics.csv": HARMONICS},
        ),
    )  # fmt: skip
    craft = mv.load_scenario(str(EXAMPLES / "spacecraft.yaml"))
    a, b = (
        pointing_budget(
            one, files / "requirement.yaml", names=["drive"], steady=True, sources=sources
        )
        for one, sources in (
            (craft, ()),
            (craft.with_({"driver.microsteps": 64}), files / "wheel.yaml"),
        )
    )
    names = "the scenario in the form", "the second scenario"
    expected = designs_outcome(Designs(names, a, b))
    assert told["files"] == text_files(expected)
    assert (told["summary"], told["verdict"]) == (expected.summary, expected.verdict)


def test_what_is_wrong_in_a_table_is_said_under_the_name_that_it_was_sent_by(client, store):
    """Before anything is simulated, and without a folder of the server."""
    id = begun(client, sources=WHEEL, tables={"harmonics.csv": "order,radial_force_n\n1,2\n"})
    job = wait(client, id)
    assert job["state"] == "failed"
    assert job["error"].startswith("sources: wheel 2: harmonics.csv: ")
    assert job["progress"]["done"] == 0
    assert list(store.folder(store.job(id)).iterdir()) == []  # nothing is left of what was sent


def test_a_craft_is_budgeted_without_requirements_where_nothing_is_judged(client):
    answer = client.post("/api/budgets", json={"scenario": CRAFT, "steady": True})
    assert answer.status_code == 202
    client.delete(f"/api/jobs/{answer.json()['id']}")


NO_CURVE = "requirements: [{name: P-1, metric: rpe, window: 10 ms}]"


@pytest.mark.parametrize(
    ("more", "key", "words"),
    [
        ({"scenario": spec()}, "spacecraft", "a scenario on a spacecraft is expected"),
        ({"requirement": NO_CURVE}, "requirement", "give either limit"),
        ({"requirement": "a: [b"}, "requirement", "is not valid YAML"),
        ({"requirement": "&a [*a]"}, "requirement", "anchors and aliases"),
        ({"requirement": "/etc/passwd"}, "requirement", "requirement"),
        ({"requirement": "x" * 200_001}, "requirement", "at most 200000"),
        ({"sources": "sources: []"}, "sources", "the list is empty"),
        ({"sources": WHEEL}, "sources", "'harmonics.csv' names a file, and it did not come"),
        (
            {"sources": WHEEL, "tables": {"Harmonics.csv": HARMONICS}},
            "sources",
            "'harmonics.csv' names a file",
        ),
        (
            {"sources": "sources: [{name: a, lines: /etc/passwd}]"},
            "sources",
            "sources: a: lines: '/etc/passwd' names a file, and it did not come with the request",
        ),
        (
            {"sources": "sources: [{name: a, density: ../entry.json}]"},
            "sources",
            "sources: a: density: '../entry.json' names a file",
        ),
        ({"tables": {"../harmonics.csv": HARMONICS}}, "tables", "the name of a table such as"),
        ({"tables": {"/etc/passwd": ""}}, "tables", "the name of a table such as"),
        ({"tables": {".hidden.csv": ""}}, "tables", "the name of a table such as"),
        ({"tables": {"C:\\x.csv": ""}}, "tables", "the name of a table such as"),
        ({"tables": {"a\0.csv": ""}}, "tables", "the name of a table such as"),
        ({"tables": {f"{k}.csv": "" for k in range(21)}}, "tables", "20"),
        ({"rule": "sum"}, "rule", "rss"),
        ({"angles": "0:180"}, "angles", "write FIRST:LAST:STEP in degrees"),
        ({"campaign": "batch"}, "campaign", "not"),
        ({"recording": "a1.uff"}, "recording", "not"),
        ({"prepare": "how.yaml"}, "prepare", "not"),
        ({"compare": "fine.yaml"}, "compare", "not"),
        ({"other": CRAFT}, "requirement", "two designs are judged by the same requirements"),
        ({"other": spec(), "requirement": REQUIREMENT}, "spacecraft", "on a spacecraft is expected"),
        (
            {"other_sources": WHEEL, "requirement": REQUIREMENT},
            "sources",
            "'harmonics.csv' names a file, and it did not come",
        ),
        ({"other_sources": "a: [b", "requirement": REQUIREMENT}, "sources", "is not valid YAML"),
    ],
)  # fmt: skip
def test_a_budget_that_cannot_be(client, more, key, words):
    answer = client.post("/api/budgets", json={"scenario": CRAFT, **more})
    assert answer.status_code == 422, answer.text
    assert answer.json()["key"] == key, answer.text
    assert words in answer.json()["error"]
    assert "\n" not in answer.json()["error"]


def test_reports_are_of_studies_that_leave_them(client, finished):
    for id, name in ((finished, "report.html"), ("0" * 16, "report.html"), (finished, "a.html")):
        assert client.get(f"/api/studies/{id}/files/{name}").status_code == 404
