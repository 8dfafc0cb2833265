"""Deviations from smooth turning that grow: parametric resonance, mid-range instability, and what that
leaves of verdicts.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.growing_drives import (
    BENT,
    BY_WINDINGS,
    GEAR_AND_DETENT,
    SLOW_GROWTH,
    WIDE_DETENT,
    drawn,
)
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.model.linear import coupled_modes
from microvib.model.parametric import decay_in_motion, growth_over_angle
from microvib.model.turning import turning_drive
from microvib.solve.steady.from_rest import RunFromRest
from microvib.solve.steady.period import NotPeriodic, PeriodMap, common_period
from microvib.solve.steady.search import Search
from microvib.solve.steady.state import _check_grown
from microvib.studies.rates import plan_rates, rate_grid


def test_a_motion_about_which_a_mode_grows_at_half_the_full_steps_is_no_steady_state():
    """The tool passed 0.45 N m, and a start from rest leads to 12 N m."""
    scenario = drawn(WIDE_DETENT).with_({"tracking.rate": "0.2195 deg/s"})
    with pytest.raises(NotPeriodic, match=r"not stable \(multiplier 1.019\)"):
        Search(PeriodMap(scenario, common_period(scenario)[0])).run(0)
    lines = [x for x in mv.find_lines(scenario, start="steady") if math.isfinite(x.amplitude)]
    largest = max(lines, key=lambda x: x.amplitude)
    assert largest.frequency == pytest.approx(4.573, abs=0.01)
    assert largest.amplitude == pytest.approx(12.3, rel=0.03)


@pytest.mark.parametrize(("rate", "multiplier"), [(0.2188, 1.01782), (0.2215, 1.00878)])
def test_growth_of_the_linear_drive_is_that_of_the_kernels_period(rate, multiplier):
    """Multipliers are those of the kernel's own period, by differences."""
    scenario = drawn(WIDE_DETENT).with_({"tracking.rate": f"{rate} deg/s"})
    period = common_period(scenario)[0] / scenario.driving_frequency
    assert math.exp(turning_drive(scenario).growth * period) == pytest.approx(multiplier, abs=3e-4)


@pytest.mark.parametrize(
    ("text", "settle", "limit", "band", "what"),
    [
        (SLOW_GROWTH, "40 s", 5e-3, (0.5, 7.0), "parametric resonance"),
        (BY_WINDINGS, "30 s", 1e-3, (1.0, 150.0), "mid-range instability"),
    ],
)
def test_a_run_in_time_passes_nothing_while_deviations_may_grow(text, settle, limit, band, what):
    record = {"record.settle": settle, "record.sample_rate": "512 Hz"}
    ramped = drawn(text).with_(record)
    scenario = ramped.with_({"tracking": {"rate": f"{math.degrees(ramped.rate)!r} deg/s"}})
    assert turning_drive(scenario).growth > 0.01
    judged = judge(mv.find_lines(mv.simulate(ramped)), limit_of(limit, *band), scenario)
    assert judged.verdict == "not judged"
    assert what in str(judged)


@pytest.mark.parametrize("name", ["state-1", "state-3", "state-5"])
def test_nothing_grows_in_the_catalog(name):
    assert turning_drive(mv.load_scenario(name)).growth == 0.0


def test_side_lines_of_a_gears_error_above_the_passband_are_not_passed():
    """At 512 Hz the line is seen with 7.7 mN m."""
    scenario = drawn(GEAR_AND_DETENT).with_(
        {"record.settle": "60 s", "record.sample_rate": "16 Hz"}
    )
    lines = mv.find_lines(mv.simulate(scenario))
    assert judge(lines, limit_of(7e-3, 39.2, 40.1), scenario).verdict == "not judged"
    assert judge(lines, limit_of(1.0, 39.2, 40.1), scenario).verdict == "pass"


def test_a_rate_plan_looks_at_parametric_resonances():
    plan = plan_rates(
        drawn(WIDE_DETENT),
        rate_grid("0.192778 deg/s", "0.36506 deg/s", 3),
        limit="0.76 N*m",
        band="0.05:100 Hz",
    )
    for rate in np.radians([0.2188, 0.2195, 0.2205, 0.2215]):
        assert any(band.low <= rate <= band.high for band in plan.forbidden)


@pytest.mark.release
def test_a_rate_plan_refines_where_a_bent_resonance_comes_near_the_limit():
    plan = plan_rates(
        drawn(BENT),
        rate_grid("0.111041 deg/s", "0.19274 deg/s", 5),
        limit="1.5849 N*m",
        band="0.05:30 Hz",
    )
    assert any(band.low < math.radians(0.137) < band.high for band in plan.forbidden)


SOFT = {
    "driver.microsteps": 32,
    "motor.detent_torque": "0 N*m",
    "motor.friction.viscous": "0 N*m*s/rad",
    "reducer.ratio": 20.0,
    "reducer.stiffness": "30000 N*m/rad",
    "reducer.damping": "1 N*m*s/rad",
    "friction.slip_ring": None,
    "friction.coulomb": "0 N*m",
    "friction.breakaway": "0 N*m",
    "friction.viscous": "2 N*m*s/rad",
    "array": {
        "inertia": "10 kg*m^2",
        "modes": [
            {"frequency": "0.3 Hz", "damping": "3 percent", "effective_inertia": "0.3 kg*m^2"}
        ],
    },
    "record.settle": "70 s",
    "record.sample_rate": "256 Hz",
}
"""A drive on a gear of 20 whose rotor swings with the array at 2.9 Hz."""
BY_ERROR = SOFT | {
    "reducer.transmission_error": [{"order": 100, "amplitude": "2 arcsec"}],
    "tracking": {"profile": [{"rate": "1.04269 deg/s", "ramp": "60 s"}]},
}
RIGID_BY_ERROR = BY_ERROR | {
    "reducer.stiffness": "rigid",
    "reducer.damping": "0 N*m*s/rad",
    "tracking": {"profile": [{"rate": "1.0994 deg/s", "ramp": "60 s"}]},
}
BY_POSITION = SOFT | {
    "friction.coulomb": "0.3 N*m",
    "friction.breakaway": "0.3 N*m",
    "friction.position": {"harmonics": [{"order": 3600, "amplitude": 0.2}]},
    "tracking": {"profile": [{"rate": "0.579 deg/s", "ramp": "60 s"}]},
}


@pytest.mark.parametrize(
    ("changes", "key", "settle", "apart"),
    [
        (BY_ERROR, "reducer.transmission_error", 90, 40),
        (RIGID_BY_ERROR, "reducer.transmission_error", 66, 16),
        (BY_POSITION, "friction.position", 60, 10),
    ],
)
def test_what_varies_over_the_angle_of_a_shaft_may_keep_a_mode_ringing(changes, key, settle, apart):
    """Twenty seconds after its ramp a drive passed a limit that it fails for good after two minutes."""
    drive = mv.load_scenario("state-1").with_(changes)
    [fed] = growth_over_angle(drive)
    assert fed.what == key
    assert fed.modes == ("drive_resonance_1",)
    [mode] = [m for m in coupled_modes(drive) if m.name == "drive_resonance_1"]
    assert fed.may_grow
    assert fed.growth == pytest.approx(fed.rate - mode.decay)
    assert decay_in_motion(mode, drive) < 0.0
    long = drive.with_({"record.settle": f"{settle} s", "record.duration": f"{apart + 4} s"})
    x = mv.simulate(long, channels="T_d")["T_d"]
    swing = x * np.exp(-2j * math.pi * mode.frequency / 256.0 * np.arange(x.size))
    first, last = (abs(np.mean(swing[k : k + 1024] * np.hanning(1024))) for k in (0, apart * 256))
    # to first order, within a tenth or so
    assert math.log(last / first) / apart + mode.decay == pytest.approx(fed.rate, rel=0.15)
    early = drive.with_({"record.settle": "80 s", "record.duration": "16 s"})
    judged = judge(mv.find_lines(mv.simulate(early)), limit_of(10.0, 0.5, 80.0), early)
    assert judged.verdict == "not judged"
    assert f"parametric resonance that has not come to its end, as {key} varies" in str(judged)


def test_what_varies_far_from_twice_a_mode_feeds_none():
    drive = mv.load_scenario("state-1").with_(BY_ERROR)
    for rate in ("1.00 deg/s", "1.09 deg/s"):
        assert not growth_over_angle(drive.with_({"tracking": {"rate": rate}}))
    rigid = drive.with_({"reducer.stiffness": "rigid", "reducer.damping": "0 N*m*s/rad"})
    assert not growth_over_angle(rigid)


@pytest.mark.long
def test_a_rate_plan_looks_where_an_error_of_the_gear_comes_at_twice_a_mode():
    """Neither end of the range has a line above 50 mN m; between them 1.76 N m ring."""
    drive = mv.load_scenario("state-1").with_(BY_ERROR | {"tracking": {"rate": "1 deg/s"}})
    plan = plan_rates(drive, rate_grid("1 deg/s", "1.06 deg/s", 2), limit="1 N*m", band="0.5:80 Hz")
    assert any(x.line == "half of wave_generator_100" for x in plan.resonances)
    for rate in np.radians([1.0271, 1.0323, 1.035]):
        assert any(band.low <= rate <= band.high for band in plan.forbidden)


def test_nothing_is_steady_while_an_error_of_the_gear_feeds_a_mode_from_nothing():
    """A run that looked as if it repeated was taken for the lasting motion."""
    drive = mv.load_scenario("state-1").with_(BY_ERROR | {"tracking": {"rate": "1.0427 deg/s"}})
    period = PeriodMap(drive, common_period(drive)[0])
    run = RunFromRest(period)
    run.simulated = 100.0
    with pytest.raises(NotPeriodic, match="grow so slowly"):
        _check_grown(run)
