"""Frictions with memory grow until all of their elements slide: what a drive does before is not what it
does from then on.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.start import record_gap
from microvib.model.presliding import quasi_static_torque
from microvib.model.winding_up import seconds_until_sliding, sliding_travel, wind_up
from microvib.solve.steady.period import NotPeriodic
from microvib.studies.quiet.measure import measure_lines
from microvib.studies.quiet.starts import require_constant_rate
from microvib.studies.rates import RECORD_GAP, full_case
from microvib.units import Si

SOFT = {
    "tracking.clock_ratio": 1.0,
    "array.modes.0.damping": 0.05,
    "friction.presliding": {"stiffness": "11 N*m/rad"},
    "record.duration": "16 s",
    "record.sample_rate": "512 Hz",
}
"""Presliding over 12 degrees, 206 s at the rate of state 1; then the array swings on the gear."""
SWING = (20.0, 30.0)
"""Band [Hz] of that swing."""


@pytest.fixture(scope="module")
def soft() -> mv.Scenario:
    return mv.load_scenario("state-1").with_(SOFT)


def lines_of(scenario: mv.Scenario, settle: str) -> mv.LineTable:
    return mv.find_lines(mv.simulate(scenario.with_({"record.settle": settle}), channels=("T_d",)))


def largest(table: mv.LineTable) -> float:
    return max(
        x.amplitude
        for x in table
        if SWING[0] < x.frequency < SWING[1] and math.isfinite(x.amplitude)
    )


def test_all_elements_slide_at_the_end_of_the_travel_and_not_before(soft):
    friction, travel = soft.friction, sliding_travel(soft)
    limit = friction.breakaway_torque
    angles = np.array([0.0, 0.99, 1.0, 1.5]) * travel
    torque = quasi_static_torque(friction.memory, limit, angles)
    assert torque[2:] == pytest.approx(limit, rel=1e-9)
    assert torque[1] < limit * (1.0 - 1e-6)


def test_a_record_before_friction_slides_passes_nothing_that_it_does_later(soft):
    """Lines of the array that swings on its gear rose to 70 times those that had passed."""
    early, late = lines_of(soft, "30 s"), lines_of(soft, "300 s")
    limit = limit_of(3e-3, *SWING)
    assert largest(early) < 1.4e-3
    assert largest(late) > 9e-3
    assert record_gap(soft.with_({"record.settle": "300 s"}), 16.0) is None
    judged = mv.judge(early, limit, soft.with_({"record.settle": "30 s"}))
    assert judged.verdict == "not judged"
    assert "until the array has turned by 12.3 deg (record.settle >= 206 s)" in str(judged)


def test_a_rate_is_not_allowed_by_a_record_before_friction_slides(soft):
    case = full_case(soft.with_({"record.settle": "30 s"}), Si(math.radians(0.06)), 16)
    assert case.verdict(SWING, 3e-3) == RECORD_GAP
    assert case.gap is not None
    assert "record.settle >= 206 s" in case.gap.why


def test_a_motion_that_repeats_before_friction_slides_is_no_steady_state(soft):
    """It repeated for an hour, and then the array began to swing."""
    softer = soft.with_({"friction.presliding": {"stiffness": "0.5 N*m/rad"}})
    with pytest.raises(NotPeriodic, match=r"slides only after 4\.\d+e\+03 s"):
        mv.steady_state(softer)


def test_a_steady_state_is_that_of_friction_that_slides(soft):
    """Without a friction that falls with the rate there is one, after 80 s of presliding."""
    drive = soft.with_(
        {
            "friction.coulomb": "0.5 N*m",
            "friction.breakaway": "0.5 N*m",
            "friction.slip_ring": None,
            "friction.presliding": {"stiffness": "24 N*m/rad"},
        }
    )
    waits = seconds_until_sliding(drive, 0.0)
    assert waits == pytest.approx((sliding_travel(drive) + wind_up(drive)) / drive.rate)
    found = mv.steady_state(drive)
    assert found.solver["simulated_s"] > waits
    late = {x.name: x.amplitude for x in lines_of(drive, f"{waits + 60.0:.3f} s")}
    for line in mv.find_lines(found):
        if line.amplitude > 5e-4 and line.name in late:
            assert line.amplitude == pytest.approx(late[line.name], rel=5e-3)


def test_after_a_reversal_elements_go_from_one_end_to_the_other(soft):
    there = seconds_until_sliding(soft, 0.0)
    turned = soft.with_(
        {
            "tracking": {
                "profile": [
                    {"rate": "0.06 deg/s", "hold": "300 s"},
                    {"rate": "-0.06 deg/s"},
                ]
            }
        }
    )
    assert seconds_until_sliding(turned, 300.0 + 1e-9) == pytest.approx(2.0 * there)
    assert seconds_until_sliding(turned, 299.0) == 0.0


def test_a_harness_counts_where_the_motor_feels_it(soft):
    plain = soft.with_({"friction.presliding": None})
    assert sliding_travel(plain) == 0.0
    strands = {"stiffness": "10 N*m/rad"}
    light = plain.with_({"friction.harness": {"friction": "0.1 N*m", "presliding": strands}})
    heavy = plain.with_({"friction.harness": {"friction": "2 N*m", "presliding": strands}})
    assert sliding_travel(light) == 0.0
    assert sliding_travel(heavy) == pytest.approx(0.8)
    assert record_gap(light.with_({"record.settle": "60 s"}), 16.0) is None
    gap = record_gap(heavy.with_({"record.settle": "60 s"}), 16.0)
    assert gap is not None
    assert "presliding lasts" in gap.why


@pytest.mark.parametrize(
    ("friction", "least", "most"), [("0.5 N*m", 1e-3, 0.01), ("2 N*m", 0.01, 0.05)]
)
def test_lines_change_while_strands_are_stretched(soft, friction, least, most):
    """By less than the part that they have of the motor's torque, 0.03 and 0.11."""
    strands = {"friction": friction, "presliding": {"stiffness": "10 N*m/rad"}}
    drive = soft.with_({"friction.presliding": None, "friction.harness": strands})
    early, late = (
        {x.name: x.amplitude for x in lines_of(drive, settle) if x.amplitude > 3e-3}
        for settle in ("25 s", "300 s")
    )
    changes = [abs(early[name] / late[name] - 1.0) for name in early.keys() & late.keys()]
    assert least < max(changes) < most


def test_a_search_for_a_quieter_drive_wants_friction_that_slides(soft):
    early = soft.with_({"record.settle": "30 s"})
    with pytest.raises(mv.MicrovibError, match="the record begins too early for a search"):
        require_constant_rate(early)
    assert "until the array has turned" in measure_lines(early).problem
    still = mv.load_scenario("state-1").with_({"record.settle": "0.02 s"})
    assert "does not turn yet" in measure_lines(still).problem
    require_constant_rate(mv.load_scenario("state-1"))


def test_a_stiff_presliding_delays_nothing():
    """As measured on bearings: seconds of arc."""
    drive = mv.load_scenario("state-1").with_(
        {"friction.presliding": {"stiffness": "6000 N*m/rad"}}
    )
    assert record_gap(drive, 16.0) is None
    assert seconds_until_sliding(drive, 0.0) < 1.0
