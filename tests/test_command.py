"""The motion command: rates, ramps, stops and reversals become microsteps at the right times."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenarios import baseline

from microvib.solve.command import Command

leg = st.fixed_dictionaries(
    {
        "rate": st.floats(-0.02, 0.02),
        "ramp": st.sampled_from([0.0, 0.5, 1.3]),
        "hold": st.floats(0.0, 2.0),
    }
)


@settings(max_examples=60, deadline=None)
@given(legs=st.lists(leg, min_size=1, max_size=5), pieces=st.integers(1, 7))
def test_microsteps_follow_the_rounded_command(legs, pieces):
    scenario = baseline().with_si(tracking={"profile": legs})
    command = Command(scenario)
    edges = np.linspace(0.0, 8.0, pieces + 1)
    parts = [command.microsteps(a, b) for a, b in pairwise(edges)]
    times = np.concatenate([t for t, _ in parts])
    counts = np.concatenate([r[:, 2] for _, r in parts]) * 64 / (2 * np.pi)
    assert np.all(np.diff(times) >= 0)
    # each changes the count by one, and between them the count is the rounded command
    assert np.abs(np.diff(np.concatenate([[0.0], counts]))) == pytest.approx(1.0)
    t = np.linspace(0.01, 7.99, 400)
    latest = np.concatenate([[0.0], counts])[np.searchsorted(times, t, side="right")]
    assert np.max(np.abs(latest - command.count(t)), initial=0.0) <= 0.5 + 1e-6


def test_ramp_stop_and_reversal(state_1):
    legs = [
        {"rate": 0.002, "ramp": 1.0, "hold": 2.0},
        {"rate": 0.0, "ramp": 0.5, "hold": 1.0},
        {"rate": -0.002},
    ]
    command = Command(state_1.with_si(tracking={"profile": legs}))
    travelled = -np.diff(
        command.count(np.array([0.0, 1.0, 3.0, 3.5, 4.5, 5.0]))
    )  # positive array rate
    assert travelled[0] == pytest.approx(travelled[1] / 4)
    assert travelled[2] == pytest.approx(travelled[1] / 8)
    assert travelled[3] == 0.0
    assert travelled[4] == pytest.approx(-travelled[1] / 4)


def test_rate_in_the_record(state_1):
    legs = [{"rate": 0.002, "ramp": 2.0, "hold": 40.0}, {"rate": 0.0}]
    scenario = state_1.with_si(tracking={"profile": legs})
    assert scenario.with_si({"record.settle": 2.0}).rate == 0.002
    assert scenario.with_si({"record.settle": 1.0}).rate is None
    assert scenario.with_si({"record.settle": 30.0}).rate is None
    assert scenario.with_si({"record.settle": 50.0}).rate == 0.0


@pytest.mark.parametrize("chunks", [1, 3])
def test_a_microstep_due_where_the_rate_changes_comes_once(state_1, chunks):
    """Ramps that end half way between two microsteps, to within the noise of floating point."""
    per_second = -Command(state_1.with_si(tracking={"profile": [{"rate": 0.001}]}))._rates[-1]
    for k in range(1, 200):
        rate = 0.001 * (1.0 + 0.0137 * k)
        hold = (k + 0.5) / abs(per_second * rate / 0.001)
        legs = [
            {"rate": rate, "ramp": 2.0 * hold, "hold": 0.0},
            {"rate": 0.7 * rate, "ramp": 0.1, "hold": hold},
            {"rate": 0.0},
        ]
        command = Command(state_1.with_si(tracking={"profile": legs}))
        edges = np.linspace(0.0, 3.0 * hold, chunks + 1)
        counts = (
            np.concatenate(
                [[0.0], *(command.microsteps(a, b)[1][:, 2] for a, b in pairwise(edges))]
            )
            * 64
            / (2 * np.pi)
        )
        assert np.abs(np.diff(counts)) == pytest.approx(1.0)
