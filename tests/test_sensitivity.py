"""Which assumed value matters most, against a scenario whose answer is known in closed form."""

import json
import math

import pytest
from support.commands import microvib

import microvib as mv
from microvib.errors import MicrovibError
from microvib.model.ranges import noted_ranges
from microvib.signals.line_table import Line
from microvib.studies.sensitivity import (
    Effect,
    LineEffects,
    _effect,
    _Scan,
    sensitivities,
)

LINE = Line("drive_1", amplitude=1.0)
BRIEF = {"record.settle": "0.5 s", "record.duration": "2 s"}
RANGES = {
    "array.inertia": "assumed: not weighed; range 8 kg*m^2 to 9 kg*m^2",
    "driver.proportional_gain": "assumed: a loop; range 400 V/A to 600 V/A",
    "reducer.stiffness": "data sheet: K1; range 3290 N*m/rad to 6110 N*m/rad",
}


@pytest.fixture(scope="module")
def scenario() -> mv.Scenario:
    return mv.load_scenario("state-1", BRIEF).with_sources(RANGES)


def test_ranges_are_read_from_sources(scenario):
    ranges = noted_ranges(scenario)
    assert ranges == {
        "array.inertia": (8.0, 9.0),
        "driver.proportional_gain": (400.0, 600.0),
        "reducer.stiffness": (3290.0, 6110.0),
    }


def test_effects_are_those_of_changed_scenarios(scenario):
    found = {line.line: line for line in sensitivities(scenario)}
    line = found["drive_1"]
    assert {effect.key for effect in line.effects} == set(RANGES)
    assert line.effects[0].key == "reducer.stiffness"
    spans = [
        max(line.amplitude, *e.amplitudes) - min(line.amplitude, *e.amplitudes)
        for e in line.effects
    ]
    assert spans == sorted(spans, reverse=True)
    effect = line.effects[0]

    def amplitude(stiffness: float) -> float:
        changed = scenario.with_si({"reducer.stiffness": stiffness})
        return mv.find_lines(mv.simulate(changed))["drive_1"].amplitude

    assert effect.amplitudes == pytest.approx((amplitude(3290.0), amplitude(6110.0)), rel=1e-3)
    slope = math.log(amplitude(1.02 * 5053) / amplitude(0.98 * 5053)) / math.log(1.02 / 0.98)
    assert effect.sensitivity == pytest.approx(slope, abs=0.02)


def test_in_the_steady_state_sensitivities_are_derivatives(scenario):
    found = sensitivities(scenario, start="steady")
    assert found.how == "Lines are those of steady states, and d ln/d ln their derivatives."
    fine = scenario.with_si({"solver.refinement": 4})

    def amplitude(key: str, factor: float) -> float:
        changed = fine.with_si({key: scenario[key] * factor}).with_sources({})
        return mv.find_lines(changed, start="steady")["drive_1"].amplitude

    effects = {x.key: x for x in next(x for x in found if x.line == "drive_1").effects}
    for key, effect in effects.items():
        slope = math.log(amplitude(key, 1.002) / amplitude(key, 0.998)) / math.log(1.002 / 0.998)
        assert effect.sensitivity == pytest.approx(slope, rel=0.01, abs=2e-4), key
    ends = [amplitude("reducer.stiffness", x / 5053.0) for x in (3290.0, 6110.0)]
    assert effects["reducer.stiffness"].amplitudes == pytest.approx(ends, rel=1e-3)


@pytest.mark.release
def test_without_derivatives_differences_of_steady_states_are_taken(scenario):
    remembers = scenario.with_({"friction.presliding": {"stiffness": "2000 N*m/rad"}})
    remembers = remembers.with_sources({"array.inertia": RANGES["array.inertia"]})
    found = sensitivities(remembers, start="steady")
    assert "by array.inertia differences" in found.how
    line = next(x for x in found if x.line == "full_step_1")
    assert line.effects[0].sensitivity == pytest.approx(1.0, abs=0.1)


def test_a_scenario_that_notes_no_range_is_told_how():
    with pytest.raises(MicrovibError, match="sources: no value of this scenario has a range"):
        sensitivities(mv.load_scenario("state-1", BRIEF))


def test_a_jump_is_no_derivative():
    scan = _Scan("key", 2.0, (1.0, 3.0), ())
    smooth = _effect(scan, LINE, [0.98**1.5, 1.02**1.5, 0.4, 1.8])
    assert smooth.sensitivity == pytest.approx(1.5)
    jumps = _effect(scan, LINE, [0.98**1.5, 1.3, 0.4, 1.8])
    assert math.isnan(jumps.sensitivity)
    assert jumps.slopes == pytest.approx((1.5, math.log(1.3) / math.log(1.02)))
    assert jumps.span(1.0) == pytest.approx(1.4)
    flat = _effect(scan, LINE, [1.0, 1.001, 1.0, 1.0])
    assert flat.sensitivity == pytest.approx(0.025, rel=0.02)


def test_what_fails_and_what_is_left_out_is_said(scenario):
    sources = {
        "motor.current": "assumed: no range: by product",
        "driver.microsteps": "assumed: typical; range 4 to 64",
        "motor.torque_constant": "assumed: very weak at one end; range 0.001 N*m/A to 0.31 N*m/A",
    }
    found = sensitivities(scenario.with_sources(sources))
    assert found.left_out == {
        "motor.current": "assumed, without a range",
        "driver.microsteps": "not a continuous value",
    }
    (case,) = found.failed
    assert (case.key, case.value) == ("motor.torque_constant", 0.001)
    assert "loss of synchronism" in case.reason
    effect = next(line for line in found if line.line == "drive_1").effects[0]
    assert math.isnan(effect.amplitudes[0])
    assert effect.amplitudes[1] > 0.0


def test_the_command_prints_a_table_or_json(tmp_path):
    done = microvib("new", "my.yaml", "--gear", "size 14 ratio 100", cwd=tmp_path)
    assert done.exit_code == 0, done.output
    brief = [word for key, text in BRIEF.items() for word in ("--set", f"{key}={text}")]
    table = microvib("sensitivity", "my.yaml", *brief, cwd=tmp_path)
    assert table.exit_code == 0, table.output
    assert "3290 N m/rad to 6110 N m/rad" in table.stdout
    rows = [
        line.split(maxsplit=1) for line in table.stdout.partition("Not ranked:")[2].splitlines()
    ]
    assert ["array.rigid_inertia", "assumed, without a range"] in rows
    data = json.loads(microvib("sensitivity", "my.yaml", "--json", *brief, cwd=tmp_path).stdout)
    drive = next(line for line in data["lines"] if line["line"] == "drive_1")
    assert {e["key"] for e in drive["effects"]} == {
        "reducer.stiffness", "reducer.damping", "reducer.transmission_error.0.amplitude", "reducer.wave_generator_inertia"
    }  # fmt: skip


def test_a_resonance_inside_a_range_is_seen():
    """At both ends of its range the array's mode is far from the first full-step line, and in between it meets it."""
    sources = {
        "array.modes.0.frequency": "assumed: to 30 %; range 2.4 Hz to 4.6 Hz",
        "motor.detent_torque": "assumed: to 20 %; range 0.011 N*m to 0.016 N*m",
    }
    brief = {
        "record.settle": "4 s",
        "record.duration": "6 s",
        "array.modes.0.frequency": "2.5 Hz",
        "reducer.stiffness": "80000 N*m/rad",
    }
    line = {
        x.line: x for x in sensitivities(mv.load_scenario("state-1", brief).with_sources(sources))
    }["full_step_1"]
    mode = next(e for e in line.effects if e.key == "array.modes.0.frequency")
    ends = max(line.amplitude, *mode.amplitudes)
    assert max(x for _, x in mode.between) > 3.0 * ends
    assert line.verdict == "array.modes.0.frequency matters most"


@pytest.mark.parametrize(
    ("ends", "says"),
    [
        ([(0.5, 1.5), (0.9, 1.1)], "a matters most"),
        ([(0.5, 1.5), (0.9, 1.85)], "a and b matter most"),
        (
            [(0.5, 1.5), (0.5, 1.5), (0.5, 1.5)],
            "3 of 3 values change it equally: the most influential one is not resolved",
        ),
        ([(0.999, 1.0005), (1.0, 1.0)], "no value changes it by more than the error of a run"),
        (
            [(0.5, 1.5), (math.nan, 1.1)],
            "a matters most; it is unknown in part of the range of b",
        ),
    ],
)
def test_what_matters_most_is_said_as_far_as_it_is_told(ends, says):
    effects = (
        Effect(key, 1.0, (0.5, 2.0), 0.0, (0.0, 0.0), found)
        for key, found in zip("abc", ends, strict=False)
    )
    assert LineEffects("line", 1.0, 1.0, tuple(effects)).verdict == says
