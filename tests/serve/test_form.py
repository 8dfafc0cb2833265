"""The form: sentences beside their keys, what differs from the catalog, and no file of the server's owner."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from support.server import spec

from microvib.io.named import catalog_text
from microvib.io.scenario_file import parse_yaml
from microvib.web.routes import forms


def test_what_is_wrong_is_said_beside_its_key(client):
    answer = client.post(
        "/api/scenario", json=spec(motor__current="5 V", driver__microsteps="0")
    ).json()
    errors = {e["key"]: e["error"] for e in answer["errors"]}
    assert errors["motor.current"].startswith(
        "motor.current: '5 V' has the wrong dimension; a unit compatible with A"
    )
    assert "a whole number from 1 to 65536" in errors["driver.microsteps"]
    assert answer["values"]["motor.current"] == "5 V"
    assert answer["base_values"]["motor.current"] == "0.6 A"
    assert answer["yaml"] is None
    refused = client.post("/api/runs", json={"scenario": spec(motor__current="5 V")})
    assert refused.status_code == 422
    assert refused.json() == {"error": errors["motor.current"], "key": "motor.current"}


def test_what_differs_from_the_catalog_is_marked(client):
    changes = {
        "motor__current": "700 mA",
        "driver__microsteps": "16",
        "reducer__stiffness": "rigid",
    }
    answer = client.post("/api/scenario", json=spec(**changes)).json()
    assert answer["errors"] == []
    assert sorted(answer["changed"]) == ["motor.current", "reducer.stiffness"]
    assert answer["values"]["motor.current"] == "700 mA"  # as it was typed
    assert answer["sources"]["motor.current"] == "set by the user"
    assert answer["sources"]["motor.torque_constant"].startswith("Appl. Sci.")
    again = client.post("/api/scenario", json={"text": answer["yaml"]}).json()
    assert again["values"]["motor.current"] == "0.70000000000000007 A"  # to the last digit
    assert again["yaml"] == answer["yaml"]


def test_a_wrong_file_is_shown_with_what_is_wrong_and_can_be_mended(client):
    text = catalog_text("state-1").replace("current: 0.6 A", "current: 0.6 V")
    shown = client.post("/api/scenario", json={"text": text}).json()
    assert [e["key"] for e in shown["errors"]] == ["motor.current"]
    assert (shown["values"]["motor.current"], shown["values"]["array.modes.0.frequency"]) == (
        "0.6 V",
        "1.2459 Hz",
    )
    assert shown["yaml"] is None
    plain = re.sub(r"sources:\n(  .*\n)*", "", text)
    mended = client.post(
        "/api/scenario", json={"text": plain, "changes": {"motor.current": "0.5 A"}}
    ).json()
    assert mended["errors"] == []
    assert "current: 0.5 A" in mended["yaml"]


def test_every_value_as_typed_reads_back(client):
    """Typing what the form shows changes nothing: each text goes through units and back."""
    shown = client.post("/api/scenario", json=spec()).json()
    typed = {key: text for key, text in shown["values"].items() if text}
    again = client.post("/api/scenario", json={"base": "state-1", "changes": typed}).json()
    assert again["errors"] == []
    assert again["changed"] == []


def test_every_value_has_its_field(client):
    groups = client.get("/api/schema").json()["groups"]
    assert [g["key"] for g in groups] == [
        "motor",
        "driver",
        "reducer",
        "friction",
        "array",
        "spacecraft",
        "tracking",
        "record",
        "solver",
    ]
    fields = {f["key"]: f for g in groups for f in g["fields"]}
    for key in client.post("/api/scenario", json=spec()).json()["values"]:
        generic = re.sub(r"\.\d+\..*", "", key)
        assert any(f == generic or f.startswith(f"{generic}.") for f in fields), key
    stiffness = fields["reducer.stiffness"]
    assert (stiffness["kind"], stiffness["unit"], stiffness["choices"]) == (
        "quantity",
        "N*m/rad",
        ["rigid"],
    )
    assert fields["array.modes"]["items"][0]["unit"] == "Hz"
    assert fields["friction.slip_ring.ring_radius"]["optional"]
    assert not fields["motor.current"]["optional"]


def test_a_spacecraft_has_its_fields(client):
    groups = client.get("/api/schema").json()["groups"]
    fields = {f["key"] for g in groups for f in g["fields"]}
    text = Path("examples/spacecraft.yaml").read_text(encoding="utf-8")
    values = client.post("/api/scenario", json={"text": text, "changes": {}}).json()["values"]
    craft = [key for key in values if key.startswith("spacecraft.")]
    assert "spacecraft.hub.mass" in craft
    for key in craft:
        assert any(f == key or f.startswith(f"{key}.") for f in fields), key
    assert not [f for f in fields if f.startswith("spacecraft.second_wing.motor")]


def test_the_catalog(client):
    assert [entry["name"] for entry in client.get("/api/catalog").json()] == [
        f"state-{k}" for k in range(1, 6)
    ]


def test_an_array_from_finite_elements(client):
    answer = client.post("/api/scenario", json=spec(array__fem="reference-array")).json()
    assert answer["errors"] == []
    assert answer["values"]["array.modes.9.frequency"]


@pytest.mark.parametrize("key", ["from", "fem"])
@pytest.mark.parametrize(
    "path", ["/etc/passwd", "../x.yaml", "state-1.yaml", "modes.csv", "reference-array.yaml"]
)
def test_no_path_of_a_page_is_opened(client, key, path):
    text = f"array: {{{key}: {path}}}"
    for asked in (
        {"text": text},
        {"text": f"array:\n  {key}: {path}\n  modes: 2"},
        {"text": text, "changes": {"array.modes": "2"}},
        {"base": "state-1", "changes": {f"array.{key}": path}},
        {"base": "state-1", "changes": {"array": f"{{{key}: {path}}}"}},
    ):
        error = client.post("/api/scenario", json=asked).json()["errors"][0]
        assert error["key"] == f"array.{key}"
        assert "the page opens no files" in error["error"]
        assert client.post("/api/runs", json={"scenario": asked}).status_code == 422


@pytest.mark.parametrize("path", ["/etc/passwd", "../x.csv", "hub.op2", "hub.yaml"])
@pytest.mark.parametrize(("group", "key"), [("hub", "modes"), ("line_of_sight", "rows")])
def test_no_path_of_a_craft_is_opened(client, group, key, path):
    for asked in (
        {"text": f"spacecraft: {{{group}: {{{key}: {path}}}}}"},
        {"base": "state-1", "changes": {f"spacecraft.{group}.{key}": path}},
        {"base": "state-1", "changes": {f"spacecraft.{group}": f"{{{key}: {path}}}"}},
        {"base": "state-1", "changes": {"spacecraft": f"{{{group}: {{{key}: {path}}}}}"}},
    ):
        error = client.post("/api/scenario", json=asked).json()["errors"][0]
        assert error["key"] == f"spacecraft.{group}.{key}"
        assert "the page opens no files" in error["error"]
        assert client.post("/api/runs", json={"scenario": asked}).status_code == 422


@pytest.mark.parametrize(
    "wing",
    [
        "{scenario: NAME}",
        "{array: {from: NAME}}",
        "{array: {fem: NAME}}",
        "{interface: {position: NAME}, scenario: NAME}",
        "{driver: {table: NAME}}",
    ],
)
def test_no_file_of_a_second_wing_is_opened(client, tmp_path, wing):
    """Neither its keys nor its figures come back, and nothing else of the machine, from whatever takes a scenario."""
    private = tmp_path / "private.yaml"
    private.write_text(catalog_text("state-1").replace("0.6 A", "0.4711 A") + "hidden_key: 1\n")
    value = f"{{second_wing: {wing.replace('NAME', str(private))}}}"
    for asked in (
        {"base": "state-1", "changes": {"spacecraft": value}},
        {
            "base": "state-1",
            "changes": {"spacecraft.second_wing": wing.replace("NAME", str(private))},
        },
        {"text": catalog_text("state-1") + f"spacecraft: {value}\n"},
    ):
        answer = client.post("/api/scenario", json=asked)
        assert answer.json()["errors"]
        assert answer.json()["yaml"] is None
        assert "hidden_key" not in answer.text
        assert "4711" not in answer.text
        for route, more in (
            ("runs", {}),
            ("rates", {"from": "0.01 deg/s", "to": "0.1 deg/s"}),
            ("angles", {"angles": "0:90:30"}),
            ("shapes", {}),
            ("sensitivity", {}),
        ):
            refused = client.post(f"/api/{route}", json={"scenario": asked, **more})
            assert refused.status_code == 422
            assert "hidden_key" not in refused.text
        assert client.post("/api/sas", json={"from_scenario": asked}).status_code == 422


def test_a_second_wing_of_the_catalog_needs_no_file(client):
    craft = (Path(__file__).parents[2] / "examples" / "spacecraft.yaml").read_text()
    data = parse_yaml(craft, "craft")
    wing = {
        "scenario": "state-1",
        "array": {"fem": "reference-array", "modes": 2},
        "interface": data["spacecraft"]["interface"],
    }
    answer = client.post(
        "/api/scenario",
        json={"text": craft, "changes": {"spacecraft.second_wing": json.dumps(wing)}},
    )
    assert answer.json()["errors"] == []
    assert answer.json()["sources"]["motor.current"]


def test_modes_of_a_hub_count(client):
    text = (Path(__file__).parents[2] / "examples" / "spacecraft.yaml").read_text()
    hub = "modes: reference-hub, count: {}".format
    told = re.sub(r"  hub: (.*\n)(    .*\n)+", f"  hub: {{{hub(97)}}}\n", text).replace(
        "position: [0.35 m, 0.9 m, -0.2 m]", "position: root"
    )
    told = told.replace("boresight: [0, 0, 1]", "boresight: [0, 0, 1]\n    point: payload")
    error = client.post("/api/runs", json={"scenario": {"text": told}}).json()
    assert "spacecraft.hub.modes: has 112 modes, beside 4 of the array" in error["error"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [1, 2]\nb: [*a, *a]", "anchors and aliases"),
        ("[" * 5000, "is not valid YAML"),
        ("motor: {current: 1 A", "line 1"),
        ("- 1\n- 2", "keys with their values are expected"),
        ("\x00", "is not valid YAML"),
        ("", "keys with their values are expected"),
        ("1: 2", ""),
        ("motor: !!set {a, b}", "tags"),
        (f"array: {{inertia: {'9' * 5000}}}", ""),
    ],
)
def test_texts_that_are_no_scenarios(client, text, words):
    answer = client.post("/api/scenario", json={"text": text})
    assert answer.status_code == 200
    assert words in answer.json()["errors"][0]["error"]


@pytest.mark.parametrize("text", ["motor: [", "motor: {current: 1 V}"])
def test_a_text_is_read_once(monkeypatch, text):
    read: list[str] = []
    monkeypatch.setattr(
        forms, "parse_yaml", lambda text, name: read.append(text) or parse_yaml(text, name)
    )
    forms._parsed.cache_clear()
    assert forms.view_of(forms.Spec(text=text, changes={"motor.current": "1 A"}))["errors"]
    assert read == [text]


def test_a_large_text_is_read_by_a_worker_and_an_array_has_bounds(client):
    modes = "\n".join(
        "    - {frequency: 3 Hz, damping: 1 percent, participation: 0.01 kg^0.5*m}"
        for _ in range(250)
    )
    state_1 = catalog_text("state-1")
    text = re.sub(r"  rigid_inertia:.*\n  modes:\n(    .*\n)*", f"  modes:\n{modes}\n", state_1)
    text = re.sub(r"  array\.\S+: .*\n", "", text)
    error = client.post("/api/scenario", json={"text": text}).json()["errors"][0]
    assert error == {
        "error": "array.modes: has 250 modes; the page takes at most 100, `microvib run` takes all",
        "key": "array.modes",
    }


def test_the_form_tells_unusual_values():
    from microvib.web.routes.forms import Spec, view_of

    assert view_of(Spec(base="state-1"))["unusual"] == []
    (said,) = view_of(Spec(base="state-1", changes={"motor.current": "0.25 mA"}))["unusual"]
    assert said.startswith("motor.current: 0.00025 A is unusual")


def test_a_gear_train_survives_the_form_and_is_edited_there(client):
    train = "{damping: 5 N*m*s/rad, stiffness: 8400 N*m/rad, train: [{pinion: 20, wheel: 60}, {sun: 20, ring: 70}]}"
    text = client.post(
        "/api/scenario", json={"base": "state-1", "changes": {"reducer": train}}
    ).json()["yaml"]

    def shown(**changes: str) -> dict:
        changed = {key.replace("__", "."): value for key, value in changes.items()}
        return client.post("/api/scenario", json={"text": text, "changes": changed}).json()

    other = shown(motor__current="0.5 A")
    assert other["errors"] == []
    assert other["changed"] == ["motor.current"]
    assert (other["values"]["reducer.ratio"], other["values"]["reducer.train.1.ring"]) == (
        "13.5",
        "70",
    )
    assert shown(reducer__train__0__wheel="90")["values"]["reducer.ratio"] == "20.25"
    assert shown(reducer__train="[{pinion: 20, wheel: 80}]")["values"]["reducer.ratio"] == "4"
    (told,) = shown(reducer__train="[{pinion: 2, wheel: 80}]")["errors"]
    assert (told["key"], "a whole number from 4 to 10000" in told["error"]) == (
        "reducer.train.0.pinion",
        True,
    )
