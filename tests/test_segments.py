"""Segments of a period: the same motion as the period in one go, for every part of the drive."""

import numpy as np
import pytest

from microvib.solve import kernel
from microvib.solve.sampling import sample_buffer
from microvib.solve.steady.period import NotPeriodic, PeriodMap, common_period
from microvib.solve.steady.segments import Segments

CHANGES = [
    {},
    {"driver.microsteps": 1},
    {"driver.beats": 5, "driver.microsteps": 1},  # a period of five microsteps
    {"driver.microsteps": 44},  # parts of two microsteps, which eight segments do not divide evenly
    {"tracking.rate": "-0.13 deg/s"},
    {"reducer.stiffness": "rigid"},
    {
        "reducer.stiffness": "rigid",
        "reducer.transmission_error": [{"order": 200, "amplitude": "2 arcsec"}],
    },
    {"driver.integral_gain": 0.0, "driver.supply_voltage": 8.0},
    {"array.modes": [], "array.rigid_inertia": None},
]


@pytest.fixture(params=CHANGES, ids=str)
def period(request, state_1):
    scenario = state_1.with_si(request.param)
    return PeriodMap(scenario, common_period(scenario)[0])


def chain(period, segments, x):
    """Starts of all segments and the end of the last, one after the other; and all that is known of each segment."""
    states, known = [x], []
    for j in range(segments.bounds.size - 1):
        known.append(
            segments.advance(
                states[-1][None], segments.bounds[j : j + 1], segments.bounds[j + 1 : j + 2], 20
            )
        )
        states.append(known[-1].x[0])
    return np.array(states), known


def test_segments_in_a_row_are_the_period(period):
    segments = Segments(period)
    assert segments.bounds[0] == 0
    assert segments.bounds[-1] == period.microsteps
    assert np.all(np.diff(segments.bounds) > 0)
    x = period.advance(period.guess())
    states, known = chain(period, segments, x)

    rows = np.zeros((20 * period.microsteps, period.packed.columns))
    width = period.microstep_time / 20
    end = period.advance(x, sample_buffer(rows, period.start, width))
    # Each segment begins with a step of its own: apart by the solver's tolerance.
    assert np.max(np.abs(states[-1] - end) / period.sizes) < 2e-3
    T_d = np.concatenate([ends.T_d for ends in known])
    assert T_d.shape == (len(rows),)
    assert np.sqrt(np.mean((T_d - rows[:, kernel.T_D]) ** 2)) < 2e-3 * np.max(np.abs(T_d))
    sticks = rows[:, kernel.CHANNELS.index("stuck_output")]
    assert sum(ends.stuck_output for ends in known) * period.frequency == pytest.approx(
        sticks.mean(), abs=2e-3
    )
    for which, name in enumerate(("stuck_rotor", "stuck_output")):
        ever = bool(np.any(rows[:, kernel.CHANNELS.index(name)]))
        assert any(ends.ever[0, which] for ends in known) == ever


def test_all_segments_at_once_are_those_one_by_one(period):
    segments = Segments(period)
    states, known = chain(period, segments, period.advance(period.guess()))
    together = segments.advance(states[:-1], segments.bounds[:-1], segments.bounds[1:], 20)
    assert np.array_equal(together.x, states[1:])
    assert np.array_equal(together.T_d, np.concatenate([ends.T_d for ends in known]))
    assert np.array_equal(together.stuck, np.concatenate([ends.stuck for ends in known]))
    more = np.tile(np.arange(states.shape[0] - 1), 3)
    many = segments.advance(states[more], segments.bounds[more], segments.bounds[more + 1])
    assert np.array_equal(many.x, states[more + 1])
    assert many.T_d.size == 0


def test_a_segment_that_fails_says_so(state_1):
    period = PeriodMap(state_1, 16)
    segments = Segments(period)
    x = np.tile(period.guess(), (8, 1))
    x[3, kernel.WM] = 1e4
    with pytest.raises(NotPeriodic, match="synchronism"):
        segments.advance(x, segments.bounds[:-1], segments.bounds[1:])
    x[3] = np.nan
    with pytest.raises(NotPeriodic, match="not finite"):
        segments.advance(x, segments.bounds[:-1], segments.bounds[1:])
