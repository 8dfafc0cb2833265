"""Lines of the torque that references make: against closed forms, and as bounds of a steady state's lines
above a record's passband.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.special import jv
from support.scenarios import baseline, limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.unseen import clock_line_bounds
from microvib.model.commanded_torque import commanded_torque
from microvib.model.linear import staircase_torque

SMOOTH = {
    "friction.coulomb": 0.0,
    "friction.breakaway": 0.0,
    "friction.slip_ring": None,
    "motor.detent_torque": 0.0,
}
TABLE = {"driver.table": {"harmonics": [{"order": 30, "amplitude": math.radians(3.0)}]}}


def smooth(**changes: Any) -> mv.Scenario:
    return baseline().with_si({**SMOOTH, **changes})


def test_an_ideal_driver_has_the_staircase() -> None:
    drive = smooth()
    found = commanded_torque(drive, 1000.0)
    turn = drive.driver.beats * drive.driver.microsteps
    orders = np.arange(1, 9)
    driving = found.amplitude[orders * turn - 1]
    assert driving == pytest.approx(np.abs(staircase_torque(drive, orders)), rel=0.03)
    others = np.delete(found.amplitude[: 8 * turn], orders * turn - 1)
    assert np.max(others) < 1e-9


@pytest.mark.parametrize("order", [30, 34, 94, 98])
def test_an_error_of_the_angle_has_images_at_either_side_of_driving_lines(order: int) -> None:
    """Held from microstep to microstep, delta sin(30 theta_e) has the lines delta sinc(m/N) at all orders
    m = k N +- 30; with 3 degrees the next order of delta counts half a per cent.
    """
    drive = smooth(**TABLE)
    turn = drive.driver.beats * drive.driver.microsteps
    stiff = drive.motor.axis_torque_constant * drive.motor.axis_current
    expected = stiff * math.radians(3.0) * abs(np.sinc(order / turn))
    assert commanded_torque(drive, 1000.0).amplitude[order - 1] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("side", [0, 1, -1, 2])
def test_compensation_spreads_driving_lines_by_bessel_functions(side: int) -> None:
    """Microsteps that come ``microsteps`` of their periods early or late over two cycles of a turn."""
    microsteps, order = 0.2, 2
    drive = smooth()
    amplitude = microsteps * drive.driver.microstep(drive.motor) / drive.reducer.ratio
    drive = smooth(**{"driver.compensation": [{"order": order, "amplitude": amplitude}]})
    of_rotor = drive.driver.beats * drive.driver.microsteps * drive.motor.rotor_teeth
    found = commanded_torque(drive, 200.0).amplitude
    alone = abs(complex(staircase_torque(drive, np.array([1]))[0]))
    expected = alone * abs(jv(side, 2.0 * math.pi * microsteps))
    assert found[of_rotor + side * order - 1] >= 0.94 * expected


def spectrum(state: Any) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and amplitudes of T_d [N m] of a steady state, of which samples are a period."""
    size = 2.0 * np.abs(np.fft.rfft(state.T_d - np.mean(state.T_d))) / len(state.T_d)
    return np.arange(size.size) * state.frequency, size


DRIVERS: dict[str, dict[str, Any]] = {
    "table": TABLE,
    "gain": {"driver.imperfections.gain_b": 0.1},
    "quadrature and detent torque": {
        "driver.imperfections.quadrature": 0.05,
        "motor.detent_torque": 0.01,
    },
    "converter": {"driver.imperfections.dac_bits": 4},
    "dead band": {"driver.imperfections.dead_band": 0.15},
    "compensation": {
        "driver.compensation": [{"order": 2, "amplitude": math.radians(60.0 / 3600.0)}]
    },
    "compensation and table": {
        "driver.compensation": [{"order": 2, "amplitude": math.radians(60.0 / 3600.0)}],
        **TABLE,
    },
}


@pytest.mark.parametrize("changes", DRIVERS.values(), ids=DRIVERS.keys())
def test_no_line_of_a_steady_state_is_above_its_bound(changes: dict[str, Any]) -> None:
    drive = smooth(**changes, **{"record.sample_rate": 1024.0})
    state = mv.steady_state(drive)
    at, size = spectrum(state)
    start, high = 25.0, 300.0
    bounds = list(clock_line_bounds(drive, start, high))
    largest = 0
    for k in np.flatnonzero((at > start + 1.0) & (at < high - 1.0) & (size > 1e-3 * np.max(size))):
        low, top = at[k] - 0.5, at[k] + 0.5
        most = max(
            (float(np.max(b.within(low, top).most, initial=0.0)) for b in bounds), default=0.0
        )
        assert size[k] <= most, at[k]
        largest += 1
    assert largest > 3


@pytest.mark.parametrize("steady", [False, True])
@pytest.mark.parametrize(
    ("changes", "band"),
    [
        (
            {
                **TABLE,
                "array.modes.0.frequency": 27.0,
                "record.sample_rate": 66.0,
            },
            (27.0, 40.0),
        ),
        (
            {
                "driver.compensation": [{"order": 2, "amplitude": math.radians(60.0 / 3600.0)}],
                "record.sample_rate": 64.0,
            },
            (50.3, 50.7),
        ),
    ],
    ids=["image", "compensation"],
)
def test_what_references_make_above_the_passband_is_not_passed(
    changes: dict[str, Any], band: tuple[float, float], steady: bool
) -> None:
    """The largest line there is above the limit at a sample rate that shows it."""
    drive = smooth(**changes, **{"record.settle": 5.0, "record.duration": 16.0})
    fine = mv.steady_state(drive.with_si({"record.sample_rate": 1024.0}))
    at, size = spectrum(fine)
    true = float(np.max(size[(at > band[0]) & (at < band[1])]))
    motion = mv.steady_state(drive) if steady else mv.simulate(drive, channels=("T_d",))
    judged = judge(mv.find_lines(motion), limit_of(0.8 * true, *band), drive)
    assert judged.verdict == "not judged", str(judged)
