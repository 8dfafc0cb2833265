"""The spacecraft's motion at an exported drive: in closed form, and against a drive on a free craft."""

from pathlib import Path

import numpy as np
import pytest
from support.native_drive import Drive

import microvib as mv
from microvib.export.native.drive import without_modes
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import pack
from microvib.solve.sampling import sample_buffer

NONE = ["0 kg*m^2"] * 3
HUB_INERTIA = 60.0
"""About the drive axis [kg m^2]; the array's is 12.2."""
CRAFT = mv.load_scenario(
    Path(__file__).parents[2] / "examples" / "spacecraft.yaml",
    {
        # Drive axis through both centres of mass, and principal: the craft turns about it alone.
        "array.modes": [
            {
                "frequency": "1.19 Hz",
                "damping": "1 percent",
                "interface_participation": [0, 0, 0, 0, 0, 3.35],
            }
        ],
        "array.rigid_body": {
            "mass": "36 kg",
            "center_of_mass": ["0 m", "0 m", "1 m"],
            "inertia": ["100 kg*m^2", "100 kg*m^2", "12.2 kg*m^2", *NONE],
        },
        "spacecraft.hub.inertia": ["200 kg*m^2", f"{HUB_INERTIA} kg*m^2", "210 kg*m^2", *NONE],
        "spacecraft.interface.position": ["0 m", "0.9 m", "0 m"],
        "spacecraft.attitude_control": None,
        "spacecraft.line_of_sight": None,
        "record.start": "rest",
    },
)
WHOLE = mv.load_scenario(
    Path(__file__).parents[2] / "examples" / "spacecraft.yaml",
    {
        "spacecraft.attitude_control": None,
        "spacecraft.line_of_sight": None,
        "record.start": "rest",
    },
)
FIXED = CRAFT.with_({"spacecraft": None})
ALONE = without_modes(FIXED)
STANDS = FIXED.with_(
    {
        "tracking.rate": "0 deg/s",
        "friction.coulomb": "50 N*m",
        "friction.breakaway": "50 N*m",
        "reducer.stiffness": "1e6 N*m/rad",
    }
)


def torque(scenario, step, count):
    """Mean T_d over each of ``count`` steps [N m], as the solver has it."""
    packed, rows = pack(scenario), np.zeros((count, pack(scenario).columns))
    command = Command(scenario).microsteps(0.0, step * count)
    assert packed.advance(step * count, sample_buffer(rows, 0.0, step), *command) == kernel.OK
    return rows[:, kernel.T_D]


def coupled(library, step, count, turns):
    """The same of an exported drive on a rigid hub that it accelerates; each step is repeated so
    often, with the acceleration that it led to."""
    drive, found, acceleration = Drive(library), [], 0.0
    for k in range(count):
        begun = drive.state
        for _ in range(turns):
            drive.state = begun
            drive.ask("set_hub_acceleration", acceleration)
            drive.step(step * (k + 1))
            acceleration = drive["T_d_mean"] / HUB_INERTIA
        found.append(drive["T_d_mean"])
    drive.free()
    return np.array(found)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def test_a_hub_that_turns_makes_the_torque_of_a_free_craft(native):
    """The craft has equations of its own, of modes of the free craft (``model.craft``)."""
    step, count = 1e-3, 3000
    expected = torque(CRAFT, step, count)
    assert rms(torque(FIXED, step, count) - expected) > 0.5 * rms(expected)
    library = native(FIXED)
    assert rms(coupled(library, step, count, 6) - expected) < 2e-4 * rms(expected)
    assert rms(coupled(library, step, count, 1) - expected) < 1e-2 * rms(expected)


@pytest.mark.parametrize(
    ("changes", "near"),
    [
        ({"reducer.same_way": True}, 2e-4),
        ({"reducer.stiffness": "rigid", "reducer.damping": "0 N*m*s/rad"}, 1e-3),
        ({"friction.harness": {"stiffness": "20 N*m/rad", "neutral_angle": "3 deg"}}, 5e-4),
        ({"reducer.backlash": "30 arcsec"}, 5e-4),
        # A rotor whose inertia, times the ratio, is 1.6 % of the array's: it feels the hub as if at the output.
        ({"motor.rotor_inertia": "20 kg*cm^2"}, 2e-2),
    ],
    ids=["same way", "rigid gear", "harness", "backlash", "heavy rotor"],
)
def test_a_hub_turns_drives_of_other_kinds(native, changes, near):
    craft, step, count = CRAFT.with_(changes), 1e-3, 1000
    fixed = craft.with_({"spacecraft": None})
    expected = torque(craft, step, count)
    assert rms(torque(fixed, step, count) - expected) > 0.03 * rms(expected)
    assert rms(coupled(native(fixed), step, count, 6) - expected) < near * rms(expected)


def test_a_hub_that_moves_in_six_makes_the_torque_of_a_free_craft(native):
    """The whole example: four modes in six components, an array at an angle. The rigid hub is in the
    host, whose step is solved with the array's residual mass: it is heavier than the hub."""
    fixed = WHOLE.with_({"spacecraft": None})
    P = fixed.array.interface
    residual = fixed.array.mass - P @ P.T
    solve = np.linalg.inv(hub_mass(WHOLE) + residual)
    drive, found, step, count = Drive(native(fixed)), [], 1e-3, 2000
    acceleration, names = np.zeros(6), ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    for k in range(count):
        begun = drive.state
        for _ in range(4):
            drive.state = begun
            for component in range(6):
                drive.ask("set_interface_acceleration", component, acceleration[component])
            drive.step(step * (k + 1))
            loads = np.array([drive[f"{name}_mean"] for name in names])
            acceleration = solve @ (loads + residual @ acceleration)
        found.append(loads[5])
    drive.free()
    expected = torque(WHOLE, step, count)
    assert rms(torque(fixed, step, count) - expected) > 0.1 * rms(expected)
    assert rms(np.array(found) - expected) < 2e-4 * rms(expected)


def hub_mass(craft):
    """Mass matrix of the hub about the interface, in axes of the array, (6, 6)."""
    hub, (r, axes) = craft.spacecraft.hub, interface_of(craft)
    xx, yy, zz, xy, xz, yz = hub.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    x, y, z = -r  # the centre of mass from the interface
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    M = np.block(
        [
            [hub.mass * np.eye(3), -hub.mass * cross],
            [hub.mass * cross, inertia - hub.mass * cross @ cross],
        ]
    )
    turn = np.kron(np.eye(2), axes)
    return turn.T @ M @ turn


def interface_of(craft):
    """Place of the interface [m], and the array's axes as columns, in axes of the hub."""
    at = craft.spacecraft.interface
    z = np.array(at.drive_axis, dtype=float)
    x = np.array(at.reference, dtype=float)
    y, angle = np.cross(z, x), craft.spacecraft.array_angle
    turned = np.cos(angle) * x + np.sin(angle) * y
    return np.array(at.position), np.column_stack([turned, np.cross(z, turned), z])


def test_other_components_need_an_array_that_is_known_in_them(native):
    drive = Drive(native(mv.load_scenario("state-1")))
    with pytest.raises(RuntimeError, match="known about its drive axis alone"):
        drive.ask("set_interface_acceleration", 0, 0.1)
    with pytest.raises(RuntimeError, match="components 0 to 5"):
        drive.ask("set_interface_acceleration", 6, 0.1)
    drive.ask("set_interface_acceleration", 5, 0.1)
    drive.free()


def test_a_clamped_shaft_passes_on_the_inertias(native):
    """T_d of a standing drive under a constant acceleration: -J a, with the mode in closed form."""
    acceleration, array = 0.3, STANDS.array
    drive = Drive(native(STANDS))
    drive.step(0.5)
    before = drive["T_d"]
    drive.ask("set_hub_acceleration", acceleration)
    (H,), (D,), (square,) = array.H, array.D, array.Lambda
    rigid = STANDS.load.output_left + STANDS.rotor_inertia
    turn = np.sqrt(square - 0.25 * D**2)
    for time in (0.0, 0.05, 0.2, 0.7):
        drive.step(0.5 + time)
        fading = np.exp(-0.5 * D * time)
        second = (
            -H
            * acceleration
            * fading
            * (np.cos(turn * time) - 0.5 * D / turn * np.sin(turn * time))
        )
        expected = -rigid * acceleration - H * (second + H * acceleration)
        assert drive["T_d"] - before == pytest.approx(expected, rel=1e-6), time
        assert drive["Mz"] == drive["T_d"]
    drive.free()


def test_a_drive_with_the_host_s_modes_is_the_source(native):
    """The array's mode in the host, driven by the shaft's rate, its torque held over each step; what
    is held costs an error of the first order in the step."""
    expected = torque(FIXED, 0.01, 200)
    (H,), (D,), (square,) = FIXED.array.H, FIXED.array.D, FIXED.array.Lambda

    def in_host(step):
        drive, eta, w, found = Drive(native(ALONE)), 0.0, 0.0, []
        each = round(0.01 / step)
        for k in range(200 * each):
            drive.ask("set_shaft_torque", H * (D * (w - H * drive["omega_l"]) + square * eta))
            begun = drive["theta_l"]
            drive.step(step * (k + 1))
            # The mode by the midpoint rule, with the shaft's mean rate.
            mean_rate = (drive["theta_l"] - begun) / step
            change = np.linalg.solve(
                [[1.0, -0.5 * step], [0.5 * step * square, 1.0 + 0.5 * step * D]],
                [step * (w - H * mean_rate), -step * (square * eta + D * (w - H * mean_rate))],
            )
            eta, w = eta + change[0], w + change[1]
            # The host's spacecraft feels the housing alone, the array by its own torque.
            found.append(drive["T_d_mean"])
        drive.free()
        return np.mean(np.reshape(found, (200, each)), axis=1)

    fine, coarse = (rms(in_host(step) - expected) for step in (2.5e-4, 1e-3))
    assert fine < 0.4 * coarse
    assert fine < 0.004 * rms(expected)


def test_means_are_those_of_the_instants(native):
    drive = Drive(native(FIXED))
    drive.step(0.2)
    drive.ask("set_hub_acceleration", -0.02)
    instants, means = [drive["T_d"]], []
    for k in range(1, 4001):
        drive.step(0.2 + k * 2.5e-5)
        instants.append(drive["T_d"])
        means.append(drive["T_d_mean"])
    halves = 0.5 * (np.array(instants[1:]) + np.array(instants[:-1]))
    assert rms(halves - means) < 2e-3 * rms(halves)
    assert np.mean(halves) == pytest.approx(np.mean(means), rel=1e-4)
    drive.free()


def test_steps_may_be_cut_anywhere(native):
    """A long step with many knots, which the wrapper takes in parts, against short ones."""
    found = []
    for count in (1, 64):
        drive = Drive(native(FIXED))
        drive.ask("set_hub_acceleration", 1e-3)
        for k in range(1, count + 1):
            drive.step(48.0 * k / count)
        found.append((drive["theta_l"], drive["T_d"]))
        drive.free()
    assert found[0] == pytest.approx(found[1], rel=1e-5)


def test_state_goes_back_before_the_first_motion(native):
    drive = Drive(native(FIXED))
    drive.step(0.4)
    kept = drive.state
    drive.step(1.0)
    alone = drive["T_d"]
    drive.state = kept
    drive.ask("set_hub_acceleration", 0.1)
    drive.step(1.0)
    assert abs(drive["T_d"] - alone) > 0.1
    drive.state = kept
    drive.step(1.0)
    assert drive["T_d"] == alone
    drive.free()
