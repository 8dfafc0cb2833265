"""Scenario files: what they say, how they are changed, and what is refused with which sentence."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import microvib as mv
from microvib.io.named import catalog_text
from microvib.io.recordings import load_preparation
from microvib.io.scenario_file import json_schema, load_scenario, parse_value, scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.scenario import Scenario
from microvib.model.sentences import validate_part

EXAMPLE = """
motor: {rotor_teeth: 50, current: 0.6 A, torque_constant: 0.3 N*m/A, detent_torque: 0.01 N*m, winding_resistance: 6 ohm,
  winding_inductance: 13 mH, rotor_inertia: 0.2 kg*cm^2,
  friction: {coulomb: 0 N*m, breakaway: 0 N*m, stribeck_rate: 0.003 deg/s, viscous: 0.0255 N*m*s/rad}}
driver: {beats: 4, microsteps: 16, proportional_gain: 500 V/A, integral_gain: 6000 V/(A*s), supply_voltage: null}
reducer: {ratio: 100, wave_generator_inertia: 0.052 kg*cm^2, stiffness: 8400 N*m/rad, damping: 5 N*m*s/rad}
friction: {coulomb: 0.02 N*m, breakaway: 0.04 N*m, stribeck_rate: 0.003 deg/s, viscous: 0.0255 N*m*s/rad}
array: {inertia: 8.18 kg*m^2, rigid_inertia: 0.13 kg*m^2, modes: [{frequency: 1.19 Hz, damping: 1 percent}]}
tracking: {rate: 0.06 deg/s}
record: {settle: 30 s, duration: 16 s, sample_rate: 4096 Hz}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "drive.yaml"
    path.write_text(EXAMPLE)
    return path


def test_catalog_has_the_five_states():
    assert mv.catalog_names() == tuple(f"state-{n}" for n in range(1, 6))


def test_what_is_changed_of_the_catalog_is_changed_there_only():
    before = load_scenario("state-1")
    changed = load_scenario("state-1", {"array.modes.0.frequency": "2 Hz", "title": "mine"})
    assert (changed.array.modes[0].frequency, changed.title) == (2.0, "mine")
    assert load_scenario("state-1") == before


@pytest.mark.parametrize(("state", "frequency", "inertia"), [(1, 1.19, 8.18), (2, 1.39, 8.18), (3, 1.59, 8.18), (4, 1.19, 15.69), (5, 1.19, 22.99)])  # fmt: skip
def test_table_2_states(state, frequency, inertia):
    scenario = load_scenario(f"state-{state}")
    seen = min(mv.coupled_modes(scenario), key=lambda mode: abs(mode.frequency - frequency))
    assert seen.frequency == pytest.approx(
        frequency, rel=4e-3 if state == 1 else 1e-4
    )  # through the drive
    assert scenario.array.inertia == inertia


def test_catalog_says_what_is_identified_and_what_is_assumed():
    for state in range(1, 6):
        scenario = load_scenario(f"state-{state}")
        for key in ("array.rigid_inertia", "reducer.stiffness", "motor.friction.viscous"):
            assert scenario.source_of(key).startswith("identified from")
        for key in ("reducer.damping", "array.modes.0.damping"):
            assert scenario.source_of(key).startswith("assumed")


def test_si_inside(file):
    scenario = load_scenario(file)
    assert scenario.motor.rotor_inertia == pytest.approx(2e-5)
    assert scenario.motor.winding_inductance == pytest.approx(13e-3)
    assert scenario.tracking.rate == pytest.approx(math.radians(0.06))
    assert scenario.array.modes[0].damping == pytest.approx(0.01)
    assert scenario.rotor_inertia == pytest.approx(0.252e-4)


@pytest.mark.parametrize("name", [f"state-{n}" for n in range(1, 6)])
def test_a_dumped_scenario_is_the_same_scenario(name, tmp_path):
    scenario = load_scenario(name)
    path = tmp_path / "again.yaml"
    path.write_text(mv.dump_scenario(scenario))
    assert load_scenario(path) == scenario


def test_profile_and_transmission_error_survive_a_dump(tmp_path, file):
    changes = {
        "tracking": {
            "profile": [{"rate": "0.1 deg/s", "ramp": "2 s", "hold": "3 s"}, {"rate": "-0.1 deg/s"}]
        },
        "reducer.transmission_error": [{"order": 2, "amplitude": "20 arcsec", "phase": "30 deg"}],
        "reducer.stiffness": "rigid",
    }
    scenario = load_scenario(file, changes)
    path = tmp_path / "again.yaml"
    path.write_text(mv.dump_scenario(scenario))
    assert load_scenario(path) == scenario


@pytest.mark.parametrize(
    ("setting", "read"),
    [
        ("reducer.stiffness=9000 N*m/rad", lambda s: s.reducer.stiffness == 9000.0),
        ("reducer.stiffness=rigid", lambda s: s.reducer.rigid),
        ("array.modes.0.frequency=1.3 Hz", lambda s: s.array.modes[0].frequency == 1.3),
        ("tracking.clock_ratio=0.994", lambda s: s.tracking.clock_ratio == 0.994),
        ("driver.supply_voltage=24 V", lambda s: s.driver.supply_voltage == 24.0),
        ("driver.supply_voltage=null", lambda s: s.driver.supply_voltage is None),
        ("friction.slip_ring=null", lambda s: s.friction.slip_ring is None),
        ("driver.microsteps=64", lambda s: s.driver.microsteps == 64),
    ],
)
def test_set(setting, read):
    key, _, value = setting.partition("=")
    assert read(load_scenario("state-1", {key: parse_value(value)}))


def test_what_is_set_is_no_longer_said_to_come_from_the_paper():
    scenario = load_scenario("state-1", {"motor.current": "0.7 A"})
    assert scenario.source_of("motor.current") == "set by the user"
    assert "9076" in scenario.source_of("motor.torque_constant")


def test_scenarios_are_frozen(state_1):
    with pytest.raises(Exception, match="frozen"):
        state_1.motor.current = 1.0


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("motor.rotor_inertia", "-0.2 kg*cm^2", "motor.rotor_inertia: '-0.2 kg*cm^2' is not allowed; it must be greater than 0 kg*m^2"),
        ("motor.rotor_inertia", "0.2 kg", "motor.rotor_inertia: '0.2 kg' has the wrong dimension"),
        ("motor.rotor_inertia", 0.2, "motor.rotor_inertia: 0.2 needs a unit, such as '0.2 kg*cm^2'"),
        ("motor.rotor_inertia", float("nan"), "motor.rotor_inertia: nan is not finite"),
        ("motor.curent", "0.6 A", "motor.curent: unknown key; did you mean motor.current? allowed here are rotor_teeth, phases, current"),
        ("driver.microsteps", 0, "driver.microsteps: 0 is not allowed; a whole number from 1 to 65536 is expected"),
        ("driver.microsteps", "many", "driver.microsteps: 'many' is not allowed; a whole number"),
        ("reducer.stiffness", "soft", "reducer.stiffness: 'soft'"),
        ("reducer.stiffness", "-1 N*m/rad", "reducer.stiffness: '-1 N*m/rad' is not allowed; it must be greater than 0 N*m/rad"),
        ("array.rigid_inertia", "9 kg*m^2", "array.rigid_inertia: 9 kg*m^2 is more than the inertia, 8.18 kg*m^2"),
        ("array.modes.0.effective_inertia", "9 kg*m^2", "array.modes: effective inertias H^2 add up to 9 kg*m^2, more than the inertia"),
        ("array.modes.0.damping", "200 percent", "array.modes.0.damping: '200 percent' is not allowed"),
        ("array.modes.3.damping", "1 percent", "array.modes.3.damping: there is no entry '3'; array.modes has the one entry 0"),
        ("friction.breakaway", "0.001 N*m", "friction.breakaway: 0.001 N*m is below coulomb"),
        ("tracking.profile", [{"rate": "1 deg/s"}], "tracking: give either rate"),
        ("record.duration", "0.001 s", "record.duration: 0.001 s at 4096 Hz is 4.096 samples; at least 8 are needed"),
        ("record.sample_rate", "7 rad/s", "record.sample_rate: '7 rad/s' mixes angles and cycles"),
        ("driver.supply_voltage", "2 V", "driver: supply_voltage 2 V cannot drive 0.6 A through 6 ohm; it must be at least 3.6 V"),
        ("motor.current.value", "1 A", "motor.current.value: motor.current is a single value"),
        ("array.modes", [{"frequency": "1 Hz", "damping": 0.01}] * 2001, "array.modes: has 2001 entries; at most 2000 are allowed"),
        ("array.modes", "none", "array.modes: 'none' is not allowed; a list is expected"),
        ("sources", {"motor.curent": "data sheet"}, "sources: 'motor.curent' is not a key of this scenario"),
    ],
)  # fmt: skip
def test_bad_values_are_one_clear_sentence(key, value, sentence):
    with pytest.raises(mv.ScenarioError) as caught:
        load_scenario("state-1", {key: value})
    assert f"state-1: {sentence}" in str(caught.value) or str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)


def test_a_missing_key_is_named(file):
    file.write_text(EXAMPLE.replace("current: 0.6 A, ", ""))
    with pytest.raises(
        mv.ScenarioError, match=r"motor.current: missing \(amplitude of the phase currents, in A\)"
    ):
        load_scenario(file)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"\xff\xfe\x00", "is not text in UTF-8"),
        (b"motor: [unclosed", "is not valid YAML"),
        (b"", "keys with their values are expected"),
        (b"- 1\n- 2\n", "keys with their values are expected"),
        (b"motor: 5\n", "motor: 5 is not allowed; keys are expected here"),
        (b"motor: {a: 1, a: 2}\n", "is not valid YAML"),
        (b"#" * 5_000_000, "has 5.0 MB"),
        (b"motor: &m {current: 1 A}\nreducer: *m\n", "anchors and aliases"),
        (b"[" * 100_000, "nested too deeply"),
        (b"- " * 100_000, "nested too deeply"),
        (b"? " * 100_000, "nested too deeply"),
        (b"".join(b" " * k + b"a:\n" for k in range(200)), "nested too deeply"),
        (b"a: &a [x,x,x]\nb: &b [*a,*a]\nc: [*b,*b]\n", "anchors and aliases"),
        (b"a: &a [*a]\n", "anchors and aliases"),
        (b"motor: !!python/object:os.system [ls]\n", "tags .* are not used"),
        (b"title: !!binary aGFsbG8=\n", "tags .* are not used"),
        (b"title: !mine x\n", "tags .* are not used"),
        (b"title: a\0b\n", "is not valid YAML: special characters"),
        ("motor: {}\n".encode("utf-16"), "is not text in UTF-8"),
        (b"motor:\n\tcurrent: 1 A\n", "is not valid YAML"),
        (b"a: 1\n---\nb: 1\n", "is not valid YAML"),
        (b"a: " + b"9" * 5000, "is not valid YAML"),
        (b"title: " + b"x" * 5000, "title: has 5000 characters; at most 500 are allowed"),
        (b"array: {from: 5}", "array.from: 5 is not allowed; the name of a file"),
        (b'array: {from: "a\\0.csv"}', "array.from: .* is not allowed; the name of a file"),
    ],
)
def test_bad_files_are_one_clear_sentence(tmp_path, content, complaint):
    path = tmp_path / "bad.yaml"
    path.write_bytes(content)
    with pytest.raises(mv.ScenarioError, match=complaint):
        load_scenario(path)


@pytest.mark.parametrize("content", [b"[" + b"1," * 600 + b"]", b"- 1\n" * 600])
def test_files_of_too_many_keys_are_refused_while_they_are_read(tmp_path, monkeypatch, content):
    monkeypatch.setattr("microvib.io.yaml_text.MAX_ENTRIES", 600)
    path = tmp_path / "long.yaml"
    path.write_bytes(content + b"\t}")  # which is no YAML, and is not come to
    with pytest.raises(mv.ScenarioError, match="more than 600 keys and values"):
        load_scenario(path)


def test_brackets_in_words_and_a_byte_order_mark_are_no_depth(tmp_path):
    path = tmp_path / "windows.yaml"
    path.write_text(
        f"# {'[' * 500}\n{mv.dump_scenario(load_scenario('state-1'))}", encoding="utf-8-sig"
    )
    assert load_scenario(path) == load_scenario("state-1")


def test_of_many_problems_few_are_told(tmp_path):
    path = tmp_path / "many.yaml"
    path.write_text(EXAMPLE + "".join(f"key_{k}: 1\n" for k in range(5000)))
    with pytest.raises(mv.ScenarioError, match=r"\.\.\. and 4992 more") as caught:
        load_scenario(path)
    assert len(str(caught.value).splitlines()) == 9


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(mv.ScenarioError, match="no such file and no catalog scenario of this name"):
        load_scenario(tmp_path / "nothing.yaml")
    with pytest.raises(mv.ScenarioError, match="is a folder"):
        load_scenario(tmp_path)
    with pytest.raises(mv.ScenarioError, match=r"is a folder; a preparation file is expected$"):
        load_preparation(tmp_path)
    with pytest.raises(mv.ScenarioError, match="cannot be read"):
        load_scenario("a\0b.yaml")


def _json_like():
    leaf = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12)
    return st.recursive(
        leaf,
        lambda x: st.lists(x, max_size=3) | st.dictionaries(st.text(max_size=6), x, max_size=3),
        max_leaves=8,
    )


KEYS = [key for key, _, _ in load_scenario("state-1").entries()]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    key=st.sampled_from(
        [*KEYS, "motor", "array.modes", "array.modes.0", "tracking.profile", "sources", "solver"]
    ),
    value=_json_like(),
)
def test_any_value_gives_a_scenario_or_a_sentence(key, value):
    sentence = ""
    try:
        scenario = load_scenario("state-1", {key: value})
    except mv.ScenarioError as error:
        sentence = str(error).strip()
    assert sentence or load_scenario_text(mv.dump_scenario(scenario)) == scenario


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=200))
def test_any_text_gives_a_scenario_or_a_sentence(text):
    with pytest.raises(mv.ScenarioError):
        load_scenario_text(text)


def load_scenario_text(text: str) -> mv.Scenario:
    return validate_part(Scenario, parse_yaml(text, "text"))


@settings(max_examples=60, deadline=None)
@given(
    inertia=st.floats(0.01, 1e4),
    share=st.floats(0.0, 0.99),
    frequency=st.floats(0.01, 500.0),
    damping=st.floats(0.0, 0.5),
    stiffness=st.floats(1.0, 1e9),
)
def test_effective_inertias_never_exceed_the_inertia(inertia, share, frequency, damping, stiffness):
    changes = {
        "array.inertia": f"{inertia!r} kg*m^2",
        "array.rigid_inertia": f"{inertia * (1 - share)!r} kg*m^2",
        "array.modes.0.frequency": f"{frequency!r} Hz",
        "array.modes.0.damping": damping,
        "reducer.stiffness": f"{stiffness!r} N*m/rad",
    }
    scenario = load_scenario("state-1", changes)
    assert float((scenario.array.H**2).sum()) <= inertia * (1 + 1e-9)
    assert all(mode.frequency > 0 for mode in mv.coupled_modes(scenario))


def test_schema_names_every_key(state_1):
    text = str(json_schema())
    for key, _, quantity in state_1.entries():
        assert f"'{key.split('.')[-1]}'" in text or key.split(".")[-1].isdigit()
        if quantity is not None and quantity.unit:
            assert f"'x-unit': '{quantity.unit}'" in text


def test_schema_allows_a_craft_that_is_left_free():
    def allowed(node, name):
        if isinstance(node, dict):
            found = [node[name]] if name in node else []
            return found + [x for value in node.values() for x in allowed(value, name)]
        return [x for item in node for x in allowed(item, name)] if isinstance(node, list) else []

    (of_control,) = allowed(json_schema()["$defs"]["Spacecraft"]["properties"], "attitude_control")
    assert {"const": "none", "type": "string"} in of_control["anyOf"]
    assert "AttitudeControl" in str(of_control)


def test_a_changed_copy_is_what_its_whole_data_give(state_1):
    before = state_1.model_dump()
    changed = state_1.with_(
        {"motor.friction.viscous": "0.03 N*m*s/rad", "array.modes.0.frequency": "1.3 Hz"}
    )
    data = state_1.model_dump()
    data["motor"]["friction"]["viscous"], data["array"]["modes"][0]["frequency"] = 0.03, 1.3
    assert changed == validate_part(Scenario, data, si=True)
    assert state_1.model_dump() == before


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"reducer.stiffness": -1.0, "motor.curent": 1.0}, "motor.curent: unknown key"),
        (
            {"reducer.stiffness": -1.0, "motor.curent": 1.0},
            "reducer.stiffness: -1.0 is not allowed",
        ),
        ({"driver.supply_voltage": 2.0}, "driver: supply_voltage 2 V cannot drive 0.6 A"),
        ({"array.rigid_inertia": 9.0}, "array.rigid_inertia: 9 kg*m^2 is more than the inertia"),
        ({"gearbox.ratio": 1.0}, "gearbox: unknown key"),
        ({"title": 3}, "title: 3 is not allowed"),
    ],
)
def test_a_changed_copy_is_refused_with_the_same_sentences(state_1, changes, sentence):
    with pytest.raises(mv.ScenarioError, match=re.escape(sentence)):
        state_1.with_si(changes)


BARE = {
    "tracking.rate": 0.05,
    "record.settle": 4,
    "array.modes": [{"frequency": 1.2, "damping": 0.01}],
    "tracking": {"profile": [{"rate": 0.001}]},
    "friction.slip_ring": {
        "contact_pairs": 20,
        "contact_force": 0.1,
        "friction_factor": 0.2,
        "ring_radius": 0.02,
    },
}


@pytest.mark.parametrize("key", BARE)
def test_a_bare_number_where_a_unit_decides_is_refused_in_every_door(state_1, key):
    for door in (state_1.with_, lambda changes: load_scenario("state-1", changes)):
        with pytest.raises(
            mv.ScenarioError, match=rf"{key.split('.')[0]}\S* .*needs a unit, such as '"
        ):
            door({key: BARE[key]})


def test_the_si_door_takes_bare_numbers_in_si(state_1):
    changed = state_1.with_si(
        {"tracking.rate": 0.001, "record.settle": 4, "array.modes.0.frequency": "1.3 Hz"}
    )
    assert (changed.tracking.rate, changed.record.settle, changed.array.modes[0].frequency) == (
        0.001,
        4.0,
        1.3,
    )
    assert state_1.with_(tracking=changed.tracking).tracking == changed.tracking
    assert type(state_1.with_({"motor.current": "1 A"}).motor.torque_constant) is float


def test_changes_are_left_as_they_were(state_1):
    changes = {"tracking": {"rate": "0.1 deg/s"}, "tracking.clock_ratio": 0.99}
    state_1.with_(changes)
    load_scenario("state-1", changes)
    assert changes == {"tracking": {"rate": "0.1 deg/s"}, "tracking.clock_ratio": 0.99}


def test_sources_of_what_is_no_longer_there_are_dropped(state_1):
    keys = (
        "array",
        "array.modes",
        "array.modes.0",
        "array.modes.0.damping",
        "friction.slip_ring.contact_pairs",
    )
    wrong = (
        "array.modes.1",
        "array.modes.00",
        "array.modes.x",
        "motor.",
        "title",
        "sources",
        "motor.current.value",
        "",
    )
    every = state_1.with_sources(dict.fromkeys((*keys, *wrong), "made"))
    assert tuple(every.sources) == keys
    fewer = every.with_({"array.modes": [], "array.rigid_inertia": None})
    changed = dict.fromkeys(("array.modes", "array.rigid_inertia"), "set by the user")
    assert fewer.sources == {"array": "made", keys[4]: "made", **changed}


def test_a_value_that_was_changed_has_no_longer_the_source_of_the_one_before():
    """At every door alike; what was not changed keeps its own."""
    published = load_scenario("state-1")
    assert published.source_of("reducer.stiffness").startswith("identified")
    changes = {"reducer.stiffness": "9000 N*m/rad"}
    for one in (
        published.with_(changes),
        load_scenario("state-1", changes),
        published.with_si({"reducer.stiffness": 9000.0}),
    ):
        assert one.source_of("reducer.stiffness") == "set by the user"
        assert one.source_of("reducer.damping") == published.source_of("reducer.damping")
    other = published.with_(
        friction={
            "coulomb": "0.03 N*m",
            "breakaway": "0.05 N*m",
            "stribeck_rate": "0.003 deg/s",
            "viscous": "0.02 N*m*s/rad",
        }
    )
    assert other.source_of("friction.coulomb") == "set by the user"
    assert published.with_(title="mine").sources == published.sources
    bare = load_scenario(
        Path(__file__).parents[1] / "examples" / "spacecraft.yaml", changes
    )  # a file that says one source for all
    assert bare.sources == {"reducer.stiffness": "set by the user"}


@pytest.mark.parametrize("name", [*mv.catalog_names(), "new"])
def test_nothing_of_the_catalog_is_doubtful(name):
    assert scenario_of(parse_yaml(catalog_text(name), name), name).unusual_values() == ()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (
            "array.modes.0.damping",
            "50 %",
            "50 % is unusual; 0.01 % to 15 % is expected (modal damping ratio)",
        ),
        ("motor.current", "0.25 mA", "0.00025 A is unusual; 0.005 A to 20 A is expected"),
        ("tracking.rate", "-3 rad/s", "-171.887 °/s is unusual; 0.0001 °/s to 10 °/s is expected"),
        ("motor.rotor_inertia", "0.2 kg*m^2", "2000 kg cm² is unusual"),
        (
            "tracking",
            {"profile": [{"rate": "1 deg/s", "hold": "1 s"}, {"rate": "1 rad/s"}]},
            "57.2958 °/s is unusual",
        ),
    ],
)
def test_what_is_allowed_but_of_an_unusual_size_is_doubted(key, value, said):
    (text,) = load_scenario("state-1", {key: value}).unusual_values()
    assert text.startswith(key)
    assert said in text


def test_nothing_is_doubted_where_zero_means_none():
    changes = {
        "array.modes.0.damping": 0,
        "motor.detent_torque": "0 N*m",
        "record.settle": "0 s",
        "tracking.rate": "0 deg/s",
    }
    assert load_scenario("state-1", changes).unusual_values() == ()


def test_every_usual_size_is_allowed():
    declared = [
        quantity
        for name in mv.catalog_names()
        for _, _, quantity in load_scenario(name).entries()
        if quantity
    ]
    with_sizes = [quantity for quantity in declared if quantity.usual]
    assert len(with_sizes) > 100
    for quantity in with_sizes:
        low, high = quantity.usual
        assert 0.0 < low < high
        assert quantity.unusual(low) == quantity.unusual(high) == ""
        assert quantity.le is None or high <= quantity.le


@pytest.mark.parametrize(("key", "value"), [("method", "propagators"), ("tolerance", "1e-6")])
def test_a_removed_key_says_what_to_do_instead(key, value):
    with pytest.raises(
        mv.ScenarioError, match=rf"solver.{key}: this key was removed; .*leave the key out"
    ):
        mv.load_scenario("state-1").with_({f"solver.{key}": value})
