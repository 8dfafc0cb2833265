"""Parameters that are set before the start: the drive is then that of a scenario with these values."""

from pathlib import Path

import numpy as np
import pytest
from support.native_drive import Drive

import microvib as mv
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import pack
from microvib.solve.sampling import sample_buffer

STATE = mv.load_scenario("state-1", {"record.start": "rest"})
SIX = STATE.with_(
    {"array.modes.0.interface_participation": [0.4, 3.0, 0.0, 1.2, 0.0, float(STATE.array.H[0])]}
)
RIGID = STATE.with_({"reducer.stiffness": "rigid", "reducer.damping": "0 N*m*s/rad"})
PULSES = mv.load_scenario(Path(__file__).parents[2] / "examples" / "pulses.yaml")
WIDTH, COUNT = 1.0 / 1024.0, 1024
CASES = {
    "detent": (SIX, {"motor.detent_torque": 0.02}, {"motor.detent_torque": "0.02 N*m"}),
    "stiffer": (SIX, {"reducer.stiffness": 20e3}, {"reducer.stiffness": "20000 N*m/rad"}),
    "softer": (SIX, {"reducer.stiffness": 900.0}, {"reducer.stiffness": "900 N*m/rad"}),
    "damper": (SIX, {"reducer.damping": 4.0}, {"reducer.damping": "4 N*m*s/rad"}),
    "mode": (SIX, {"array.modes[1].damping": 0.05}, {"array.modes.0.damping": "5 percent"}),
    "microsteps": (SIX, {"driver.microsteps": 64}, {"driver.microsteps": 64}),
    "rate": (SIX, {"tracking.rate": -1e-3}, {"tracking.rate": "-0.001 rad/s"}),
    "viscous": (SIX, {"friction.viscous": 3.0}, {"friction.viscous": "3 N*m*s/rad"}),
    "slides": (
        SIX,
        {"friction.sliding_torque": 0.1},
        {
            "friction.slip_ring": None,
            "friction.coulomb": "0.1 N*m",
            "friction.breakaway": "0.1216 N*m",
        },
    ),
    "rotor": (
        SIX,
        {"motor.friction.sliding_torque": 2e-4, "motor.friction.stribeck_torque": 1e-4},
        {"motor.friction.coulomb": "2e-4 N*m", "motor.friction.breakaway": "3e-4 N*m"},
    ),
    "pulses": (
        PULSES,
        {"reducer.stiffness": 12e3, "motor.detent_torque": 0.004, "friction.viscous": 0.4},
        {
            "reducer.stiffness": "12000 N*m/rad",
            "motor.detent_torque": "4 mN*m",
            "friction.viscous": "0.4 N*m*s/rad",
        },
    ),
    "voltages": (
        STATE.with_(
            {"driver.drive": "voltage"}
            | {f"driver.{name}_gain": 0.0 for name in ("proportional", "integral", "derivative")}
        ),
        {"reducer.stiffness": 9e3},
        {"reducer.stiffness": "9000 N*m/rad"},
    ),
    "rigid": (RIGID, {"motor.detent_torque": 0.005}, {"motor.detent_torque": "0.005 N*m"}),
    "many": (
        SIX,
        {
            "driver.microsteps": 8,
            "tracking.rate": 2e-3,
            "reducer.stiffness": 3e3,
            "friction.viscous": 1.0,
        },
        {
            "driver.microsteps": 8,
            "tracking.rate": "0.002 rad/s",
            "reducer.stiffness": "3000 N*m/rad",
            "friction.viscous": "1 N*m*s/rad",
        },
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_parameters_are_those_of_a_scenario(native, name):
    """Every channel of a second, and what is packed, against the solver with the changed scenario."""
    scenario, given, changes = CASES[name]
    changed = scenario.with_(changes)
    seconds = 4.0 if scenario.driver.pulsed else 1.0
    width = WIDTH * seconds
    drive, packed = Drive(native(scenario)), pack(changed)
    for key, value in given.items():
        drive.set_parameter(key, value)
    expected = np.zeros((COUNT, packed.columns))
    samples = sample_buffer(expected, 0.0, width)
    command = Command(changed).microsteps(0.0, seconds)
    assert packed.advance(seconds, samples, *command) == kernel.OK
    drive.ask("begin_record", 0.0, width)
    found = drive.record(COUNT)
    for k, channel in enumerate(kernel.CHANNELS):
        largest = np.max(np.abs(expected[:, k]))
        assert np.max(np.abs(found[:, k] - expected[:, k])) <= 1e-9 * largest, channel
    samples = sample_buffer(np.zeros_like(expected), 0.0, width)
    pack(scenario).advance(seconds, samples, *Command(scenario).microsteps(0.0, seconds))
    unchanged = samples.rows[:, kernel.T_D]
    assert np.max(np.abs(unchanged - expected[:, kernel.T_D])) > 1e-4 * np.max(np.abs(unchanged))
    drive.free()


def test_loads_follow_a_damping(native):
    from microvib.solve.integration import channels_of
    from microvib.solve.motion import interface_loads

    changed = SIX.with_({"array.modes.0.damping": "5 percent"})
    packed, drive = pack(changed), Drive(native(SIX))
    drive.set_parameter("array.modes[1].damping", 0.05)
    samples = sample_buffer(np.zeros((0, packed.columns)), 0.0, WIDTH)
    packed.advance(1.0, samples, *Command(changed).microsteps(0.0, 1.0))
    drive.step(1.0)
    loads = interface_loads(channels_of(packed.snapshot()[None], 1), changed)[0]
    for name, load in zip(("Fx", "Fy", "Fz", "Mx", "My", "Mz"), loads, strict=True):
        assert drive[name] == pytest.approx(load, rel=1e-9, abs=1e-12)
    drive.free()


def names_of(drive):
    return [drive.call("parameter_name", k).decode() for k in range(drive.call("parameters"))]


@pytest.mark.parametrize(
    ("changes", "fixed"),
    [
        (
            {"reducer.hysteresis": {"loss": "10 arcsec", "stiffness": "2000 N*m/rad"}},
            {"reducer.stiffness"},
        ),
        (
            {"friction.presliding": {"stiffness": "9000 N*m/rad", "breakaway_angle": "0.03 deg"}},
            {"friction.sliding_torque", "friction.stribeck_torque"},
        ),
    ],
)
def test_what_others_hang_on_is_no_parameter(native, changes, fixed):
    """A hysteresis has its torque by the gear's stiffness; presliding its elements by angle and levels."""
    plain, drive = Drive(native(STATE)), Drive(native(STATE.with_(changes)))
    assert set(names_of(plain)) - set(names_of(drive)) == fixed
    plain.free()
    drive.free()


def test_presliding_by_stiffness_follows_the_levels(native):
    given = STATE.with_({"friction.presliding": {"stiffness": "9000 N*m/rad"}})
    levels = {"friction.slip_ring": None, "friction.coulomb": "0.3 N*m"}
    changed = given.with_(levels | {"friction.breakaway": "0.3216 N*m"})
    drive, packed = Drive(native(given)), pack(changed)
    drive.set_parameter("friction.sliding_torque", 0.3)
    drive.set_parameter("friction.stribeck_torque", changed.friction.stribeck_torque)
    samples = sample_buffer(np.zeros((COUNT, packed.columns)), 0.0, WIDTH)
    packed.advance(1.0, samples, *Command(changed).microsteps(0.0, 1.0))
    drive.ask("begin_record", 0.0, WIDTH)
    expected, found = samples.rows[:, kernel.T_D], drive.record(COUNT)[:, kernel.T_D]
    assert np.max(np.abs(found - expected)) < 1e-9 * np.max(np.abs(expected))
    drive.free()


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("reducer.stiffness", 1e12, "asks for shorter steps than this export has room for"),
        ("friction.viscous", 1e9, "asks for shorter steps"),
        ("tracking.rate", 1e200, "5000000 are followed"),
        ("driver.microsteps", 65537, "a whole number from 1 to 65536 is expected$"),
        ("array.modes[1].damping", 5.0, "a number from 0 to 0.99 is expected$"),
    ],
)
def test_a_value_that_is_refused_leaves_the_drive_as_it_was(native, name, value, said):
    drive, other = Drive(native(SIX)), Drive(native(SIX))
    which = names_of(drive).index(name)
    before = drive.call("parameter", which)
    with pytest.raises(RuntimeError, match=said):
        drive.set_parameter(name, value)
    assert drive.call("parameter", which) == before
    for one in (drive, other):
        one.step(0.7)
    assert drive["T_d"] == other["T_d"]
    drive.free()
    other.free()


def test_a_value_that_is_set_back_leaves_nothing(native):
    one, other = Drive(native(SIX)), Drive(native(SIX))
    for value in (64, 16):
        one.set_parameter("driver.microsteps", value)
    one.set_parameter("reducer.stiffness", 900.0)
    one.set_parameter("reducer.stiffness", SIX.reducer.stiffness)
    for drive in (one, other):
        drive.step(0.7)
    assert one["T_d"] == pytest.approx(other["T_d"], rel=1e-9)
    one.free()
    other.free()


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (
            "reducer.stiffness",
            0.0,
            "^reducer.stiffness 0 is not allowed; a positive number is expected$",
        ),
        ("reducer.damping", -1.0, "^reducer.damping -1 is not allowed; 0 or a positive number"),
        ("driver.microsteps", 2.5, "a whole number from 1 to 65536 is expected$"),
        ("tracking.rate", float("nan"), "^tracking.rate nan is not allowed; a finite number"),
    ],
)
def test_bad_values_are_sentences(native, name, value, said):
    drive = Drive(native(SIX))
    with pytest.raises(RuntimeError, match=said):
        drive.set_parameter(name, value)
    drive.step(0.1)
    with pytest.raises(RuntimeError, match=f"^{name} can be set before the first step alone$"):
        drive.set_parameter(name, 1.0)
    drive.free()
