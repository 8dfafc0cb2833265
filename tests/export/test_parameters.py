"""Parameters that are set before the start: the drive is then that of a scenario with these values."""

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
    drive, packed = Drive(native(scenario)), pack(changed)
    for key, value in given.items():
        drive.set_parameter(key, value)
    expected = np.zeros((COUNT, packed.columns))
    samples = sample_buffer(expected, 0.0, WIDTH)
    command = Command(changed).microsteps(0.0, 1.0)
    assert packed.advance(1.0, samples, *command) == kernel.OK
    drive.ask("begin_record", 0.0, WIDTH)
    found = drive.record(COUNT)
    for k, channel in enumerate(kernel.CHANNELS):
        largest = np.max(np.abs(expected[:, k]))
        assert np.max(np.abs(found[:, k] - expected[:, k])) <= 1e-9 * largest, channel
    unchanged, samples = np.zeros_like(expected), sample_buffer(np.zeros_like(expected), 0.0, WIDTH)
    pack(scenario).advance(1.0, samples, *Command(scenario).microsteps(0.0, 1.0))
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
