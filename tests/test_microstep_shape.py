"""Microsteps made in parts: closed forms of what they leave, and every way to ask for the lines."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import rodas4
from support.derivatives_by_solving import relative_derivatives
from support.scenarios import NO_FRICTION, baseline

import microvib as mv
from microvib.errors import ScenarioError
from microvib.io.scenario_file import dump_part
from microvib.model.linear import coupled_modes, linear_lines
from microvib.reports.parameters import derived_values
from microvib.solve.command import Command
from microvib.solve.steady.state import steady_state

FREE = {"sources": {}, **NO_FRICTION, "motor.detent_torque": 0.0}
RIGID_LOAD = {"array.modes": [], "array.rigid_inertia": None, "array.inertia": 0.2}
ZV, ZVD = (0.5, 0.5), (0.25, 0.5, 0.25)
THREE = {
    "driver.microstep_shape": [
        {},
        {"fraction": 0.45, "after": 0.004},
        {"fraction": 0.25, "after": 0.0131},
    ]
}


def resonance(scenario: mv.Scenario) -> float:
    """Frequency [Hz] of the hub on the reducer."""
    return next(m for m in coupled_modes(scenario) if m.name == "drive_resonance_1").frequency


def shape(fractions: tuple[float, ...], apart: float) -> dict[str, object]:
    """Parts with those fractions, each ``apart`` [s] from the one before."""
    parts = [{"fraction": f, "after": k * apart} for k, f in enumerate(fractions)]
    return {"driver.microstep_shape": parts}


def with_microsteps_at(scenario: mv.Scenario, frequency: float) -> mv.Scenario:
    """The scenario at the rate at which so many microsteps come in a second."""
    rate = scenario["tracking.rate"] * frequency / scenario.driving_frequency
    return scenario.with_si({"tracking.rate": rate})


@pytest.mark.parametrize("off", [-0.1, -0.05, 0.0, 0.05, 0.1])
@pytest.mark.parametrize(("fractions", "power"), [(ZV, 1), (ZVD, 2)], ids=["ZV", "ZVD"])
def test_parts_half_a_period_apart_leave_what_the_closed_form_says(fractions, power, off):
    """Of a line at f beside the resonance f_0 |cos(pi f / 2 f_0)|, squared with three parts: at 5 and
    10 % off 7.8 and 15.6 %, with three 0.6 and 2.4 %."""
    plain = baseline().with_si(FREE | RIGID_LOAD | {"driver.microsteps": 128})  # chords are arcs
    f_0 = resonance(plain)
    plain = with_microsteps_at(plain, 0.5 * f_0 * (1.0 + off))  # drive_2 is beside the resonance
    shaped = plain.with_si(shape(fractions, 0.5 / f_0))
    before, after = (mv.find_lines(s, start="steady")["drive_2"] for s in (plain, shaped))
    left = abs(math.cos(0.5 * math.pi * (1.0 + off))) ** power
    assert after.amplitude / before.amplitude == pytest.approx(left, rel=0.01, abs=5e-5)


@pytest.mark.parametrize("off", [0.0, 0.05, 0.1])
def test_a_single_microstep_in_halves_leaves_the_hub_at_rest(off):
    """Of the ringing after a microstep at f_0 halves leave |1 + exp(j pi (1 + off))|/2 = sin(pi off/2)
    where their time is off, if little decays in half a period."""
    plain = baseline().with_si(
        FREE
        | RIGID_LOAD
        | {
            "reducer.damping": 0.05,
            "motor.friction.viscous": 1e-5,
            "record.settle": 0.0,
            "record.duration": 1.6,
            "record.sample_rate": 4096.0,
        }
    )
    f_0 = resonance(plain)
    slow = with_microsteps_at(plain, 0.4)  # one microstep, at 1.25 s
    ringing = []
    for s in (slow, slow.with_si(shape(ZV, 0.5 / f_0 * (1.0 + off)))):
        motion = mv.simulate(s, channels=("T_d",))
        t = motion.time
        late = (t > 1.25 + 0.1) & (t < 1.25 + 0.3)
        basis = np.exp(-2j * np.pi * f_0 * t[late]) * np.hanning(np.sum(late))
        ringing.append(abs(np.sum(motion["T_d"][late] * basis)))
    assert ringing[1] / ringing[0] == pytest.approx(math.sin(0.5 * math.pi * off), abs=0.02)


def test_linear_lines_know_the_parts():
    s = baseline().with_si(FREE | RIGID_LOAD | THREE)
    table = mv.find_lines(s, start="steady")
    plain = {x.order: x for x in linear_lines(s.with_si({"driver.microstep_shape": []}))}
    for line in linear_lines(s, 4):
        f = line.frequency
        factor = (
            0.3 + 0.45 * np.exp(-2j * np.pi * f * 4e-3) + 0.25 * np.exp(-2j * np.pi * f * 13.1e-3)
        )
        assert line.amplitude == pytest.approx(plain[line.order].amplitude * factor, rel=1e-9)
        assert abs(line.amplitude) == pytest.approx(
            table[f"drive_{line.order}"].amplitude, rel=0.03
        )


@pytest.mark.parametrize("after", [0.006, 0.0178])
@pytest.mark.parametrize("rate", [0.06, -0.06])
def test_the_steady_state_is_that_of_a_run(after, rate):
    """Also where the last part comes after the place where periods otherwise begin."""
    s = baseline().with_si(
        {
            "driver.microstep_shape": [{}, {"fraction": 0.6, "after": after}],
            "tracking.rate": math.radians(rate),
            "record.settle": 80.0,
            "record.duration": 12.0,
        }
    )
    state, run = steady_state(s), mv.find_lines(mv.simulate(s, channels=("T_d",)))
    assert not state.invariants.broken
    found = mv.find_lines(state)
    for name in ("drive_1", "drive_2", "drive_3", "full_step_1"):
        assert run[name].amplitude == pytest.approx(found[name].amplitude, rel=2e-3), name
        assert abs(math.remainder(run[name].phase - found[name].phase, 2 * math.pi)) < 5e-3, name


@pytest.mark.parametrize("after", [0.006, 0.0178])
def test_derivatives_by_a_part_are_those_of_solving_again(after):
    parts = {"driver.microstep_shape": [{}, {"fraction": 0.7, "after": after}]}
    s = baseline().with_si(FREE | RIGID_LOAD | parts | {"solver.refinement": 4})
    keys, orders = ["driver.microstep_shape.1.after", "driver.microstep_shape.1.fraction"], [16, 32]
    found = steady_state(s).derivatives(keys, orders).relative
    for row, key in zip(found, keys, strict=True):
        assert row == pytest.approx(relative_derivatives(s, key, orders), rel=1e-3), key


def test_the_reference_integration_finds_the_same_lines():
    s = baseline().with_si(THREE | {"record.settle": 2.0, "record.duration": 4.0})
    other = mv.find_lines(rodas4.simulate(s, channels=("T_d",)))
    found = mv.find_lines(mv.simulate(s, channels=("T_d",)))
    for name in ("full_step_1", "drive_1", "drive_2"):
        assert found[name].amplitude == pytest.approx(other[name].amplitude, rel=1e-3), name


def test_microsteps_are_counted_whole():
    s = baseline().with_si(THREE | {"record.settle": 1.0, "record.duration": 2.0})
    plain = s.with_si({"driver.microstep_shape": []})
    assert mv.simulate(s).solver["microsteps"] == mv.simulate(plain).solver["microsteps"]


leg = st.fixed_dictionaries(
    {
        "rate": st.floats(-0.0012, 0.0012),
        "ramp": st.sampled_from([0.0, 0.5, 1.3]),
        "hold": st.floats(0.0, 2.0),
    }
)


@settings(max_examples=40, deadline=None)
@given(legs=st.lists(leg, min_size=1, max_size=5), pieces=st.integers(1, 9))
def test_references_are_the_sum_of_all_parts_so_far(legs, pieces):
    """Whatever the profile is and wherever it is asked for microsteps from."""
    s = baseline().with_si(THREE | {"tracking": {"profile": legs}})
    whole, rows = Command(s.with_si({"driver.microstep_shape": []})).microsteps(0.0, 8.0)
    command, edges = Command(s), np.linspace(0.0, 8.0, pieces + 1)
    found = [command.microsteps(a, b) for a, b in pairwise(edges)]
    times, parts = (np.concatenate(each) for each in zip(*found, strict=True))
    assert np.all(np.diff(times) >= 0.0)
    vector = rows[:, 0] + 1j * rows[:, 1]
    held = 0.6 + 0j
    steps = np.diff(np.concatenate([[held], vector]))
    t = np.linspace(0.0137, 7.99, 500)
    expected = np.full(t.size, held)
    for fraction, after in ((0.3, 0.0), (0.45, 0.004), (0.25, 0.0131)):
        made = np.concatenate([[0.0], np.cumsum(fraction * steps)])
        expected += made[np.searchsorted(whole + after, t, side="right")]
    seen = np.concatenate([[held], parts[:, 0] + 1j * parts[:, 1]])
    assert np.max(np.abs(seen[np.searchsorted(times, t, side="right")] - expected)) < 1e-9


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"driver.microstep_shape": [{"fraction": 0.5}]}, "microstep_shape: has one part"),
        (
            {"driver.microstep_shape": [{"fraction": 0.5}, {"fraction": 0.6, "after": "3 ms"}]},
            "the fractions add up to 1.1; 1 is expected",
        ),
        (
            {"driver.microstep_shape": [{}, {"fraction": 1.0, "after": "3 ms"}]},
            "add up to 1; less than 1 is expected",
        ),
        (
            {"driver.microstep_shape": [{}, {"after": "3 ms"}]},
            "microstep_shape.1.fraction: missing; only the first part may leave it out",
        ),
        (
            {"driver.microstep_shape": [{"after": "1 ms"}, {"fraction": 0.5, "after": "3 ms"}]},
            "microstep_shape.0.after: 1 ms is not allowed",
        ),
        (
            {"driver.microstep_shape": [{}, {"fraction": 0.5}]},
            "microstep_shape.1.after: 0 ms is not after the part before, at 0 ms",
        ),
        (
            {"driver.microstep_shape": [{}, {"fraction": 0.5, "after": "3"}]},
            "microstep_shape.1.after: '3' needs a unit, such as '3 ms'",
        ),
        (
            {"driver.microstep_shape": [{}, {"fraction": 0.5, "after": "30 ms"}]},
            "microstep_shape.1.after: 30 ms is not before the next microstep, which comes after 18.75 ms"
            " at the fastest rate of the command",
        ),
        (
            {
                "driver.microstep_shape": [{}, {"fraction": 0.5, "after": "3 ms"}],
                "driver.microstep_ramp": 0.5,
            },
            "microstep_shape: cannot be combined with microstep_ramp",
        ),
    ],
)
def test_what_no_shape_can_be_is_told_in_one_sentence(changes, words):
    with pytest.raises(ScenarioError) as caught:
        baseline().with_(changes)
    assert words in str(caught.value)


def test_a_rate_plan_goes_on_where_the_parts_do_not_fit():
    s = baseline().with_si({"driver.microstep_shape": [{}, {"fraction": 0.5, "after": 0.016}]})
    plan = mv.plan_rates(s, ["0.05 deg/s", "0.08 deg/s"])
    slow, fast = plan.cases[0], plan.cases[-1]
    assert slow.lines
    assert not slow.reason
    assert fast.failed
    assert "16 ms is not before the next microstep" in fast.reason


def test_a_scenario_with_parts_is_written_read_and_changed(tmp_path):
    s = baseline().with_si(THREE)
    (tmp_path / "drive.yaml").write_text(dump_part(s))
    again = mv.load_scenario(tmp_path / "drive.yaml")
    assert again.driver == s.driver
    assert again["driver.microstep_shape.1.after"] == 0.004
    moved = again.with_si({"driver.microstep_shape.1.after": 0.005})
    assert moved.driver.shape.after == (0.0, 0.005, 0.0131)
    assert moved.driver.shape.fractions == pytest.approx((0.3, 0.45, 0.25))
    by = {name: value for name, value, _ in derived_values(s)}
    assert by["drive_1 by the parts of a microstep"].endswith(" %")
