"""Basilisk's hub jitters by microvib's drive: python examples/basilisk_array.py [STEP in seconds]

The array's torsion mode is Basilisk's spinning body, its spring held by the drive's shaft. Lines of the hub's rate are
set against those of microvib's own free craft, from rest as well. Needs Basilisk: pip install 'microvib[export]' bsk
"""

import ctypes
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.simulation import extForceTorque, spacecraft, spinningBodyOneDOFStateEffector
from Basilisk.utilities import SimulationBaseClass, macros

import microvib as mv

STEP = 1e-3  # s
HUB_INERTIA = 60.0  # about the drive axis, kg m^2
ARRAY_INERTIA = 12.2  # all of it, kg m^2
FREQUENCY, DAMPING, PARTICIPATION = 1.19, 0.01, 3.35  # of the torsion mode: Hz, of critical, kg^0.5 m
PANEL_INERTIA = PARTICIPATION**2  # the rest of the array turns with the shaft and stays in the drive
OMEGA = 2 * np.pi * FREQUENCY
SPRING, DAMPER = OMEGA**2 * PANEL_INERTIA, 2 * DAMPING * OMEGA * PANEL_INERTIA

NONE = ["0 kg*m^2"] * 3
CRAFT = mv.load_scenario(
    Path(__file__).parent / "spacecraft.yaml",
    {
        # The drive axis is principal and goes through both centres of mass: the craft turns about it alone.
        "array.inertia": f"{ARRAY_INERTIA} kg*m^2",
        "array.modes": [
            {
                "frequency": f"{FREQUENCY} Hz",
                "damping": DAMPING,
                "interface_participation": [0, 0, 0, 0, 0, PARTICIPATION],
            }
        ],
        "array.rigid_body": {
            "mass": "36 kg",
            "center_of_mass": ["0 m", "0 m", "1 m"],
            "inertia": ["100 kg*m^2", "100 kg*m^2", f"{ARRAY_INERTIA} kg*m^2", *NONE],
        },
        "spacecraft.hub.inertia": ["200 kg*m^2", f"{HUB_INERTIA} kg*m^2", "210 kg*m^2", *NONE],
        "spacecraft.interface.position": ["0 m", "0.9 m", "0 m"],
        "spacecraft.attitude_control": None,
        "spacecraft.line_of_sight": None,
    },
)
SHAFT = CRAFT.with_(  # what is rigid on the shaft, without the mode that Basilisk has
    {
        "spacecraft": None,
        "array.inertia": f"{ARRAY_INERTIA - PANEL_INERTIA} kg*m^2",
        "array.modes": [],
        "array.rigid_body": None,
    }
)


class SolarArrayDrive(sysModel.SysModel):
    """The drive with what is rigid on its shaft. It runs before the spacecraft in each step, so that its mean torque
    of the step acts over this very step."""

    def __init__(self, library):
        super().__init__()
        self.ModelTag = "solarArrayDrive"
        self.library = ctypes.CDLL(str(library))
        self.library.microvib_new.restype = ctypes.c_void_p
        self.library.microvib_output.restype = ctypes.c_double
        self.library.microvib_error.restype = ctypes.c_char_p
        self.drive = ctypes.c_void_p(self.library.microvib_new(None, ctypes.c_size_t(0)))
        self.panel_in = messaging.HingedRigidBodyMsgReader()  # angle of the panel from the hub
        self.hub_in = messaging.SCStatesMsgReader()
        self.shaft_out = messaging.HingedRigidBodyMsg()  # angle of the shaft, where the panel's spring is held
        self.torque_out = messaging.CmdTorqueBodyMsg()  # on the hub, what the panel does not put there itself
        self.hub_rate, self.shaft_angle = 0.0, 0.0

    def output(self, name):
        which = self.library.microvib_find_output(self.drive, name.encode())
        return self.library.microvib_output(self.drive, ctypes.c_size_t(which))

    def UpdateState(self, nanos):
        if nanos == 0:
            return
        panel, hub_rate = self.panel_in(), self.hub_in().omega_BN_B[1]
        # In Basilisk the panel's spring pulls at panel and hub; in truth at panel and shaft.
        on_shaft = SPRING * (panel.theta - self.output("theta_l")) + DAMPER * (panel.thetaDot - self.output("omega_l"))
        self.library.microvib_set_shaft_torque(self.drive, ctypes.c_double(on_shaft))
        acceleration = (hub_rate - self.hub_rate) / STEP  # of the step before
        self.library.microvib_set_hub_acceleration(self.drive, ctypes.c_double(acceleration))
        self.hub_rate = hub_rate
        if self.library.microvib_do_step(self.drive, ctypes.c_double(1e-9 * nanos)):
            raise RuntimeError(self.library.microvib_error(self.drive).decode())

        # T_d has the pull at the shaft in it, which Basilisk puts on the hub itself.
        torque = messaging.CmdTorqueBodyMsgPayload()
        torque.torqueRequestBody = [0.0, self.output("T_d_mean") - on_shaft, 0.0]
        self.torque_out.write(torque, nanos, self.moduleID)
        before, self.shaft_angle = self.shaft_angle, self.output("theta_l")
        shaft = messaging.HingedRigidBodyMsgPayload()
        shaft.theta = (before + self.shaft_angle) / 2  # means over the step
        shaft.thetaDot = (self.shaft_angle - before) / STEP
        self.shaft_out.write(shaft, nanos, self.moduleID)


def shaft_library(folder):
    """Path of the C library of the drive and its shaft, for this machine."""
    archive = Path(folder) / "drive.zip"
    mv.export_as(SHAFT, "c", archive)
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(folder)
    return next(path for path in Path(folder).rglob("*") if path.suffix in (".so", ".dll", ".dylib"))


def simulate_hub(library, duration):
    """Times [s] and rates of the hub about the drive axis [rad/s] in Basilisk."""
    simulation = SimulationBaseClass.SimBaseClass()
    step = macros.sec2nano(STEP)
    simulation.CreateNewProcess("dynamics").addTask(simulation.CreateNewTask("task", step))

    craft = spacecraft.Spacecraft()
    craft.hub.mHub = 420.0
    craft.hub.IHubPntBc_B = np.diag([200.0, HUB_INERTIA, 210.0]).tolist()

    panel = spinningBodyOneDOFStateEffector.SpinningBodyOneDOFStateEffector()
    panel.mass = 36.0
    panel.r_SB_B = [[0.0], [0.9], [0.0]]
    panel.r_ScS_S = [[0.0], [1.0], [0.0]]
    panel.sHat_S = [[0.0], [1.0], [0.0]]
    panel.IPntSc_S = np.diag([64.0, PANEL_INERTIA, 64.0]).tolist()
    panel.dcm_S0B = np.eye(3).tolist()
    panel.k, panel.c = SPRING, DAMPER
    craft.addStateEffector(panel)

    torque = extForceTorque.ExtForceTorque()
    craft.addDynamicEffector(torque)

    drive = SolarArrayDrive(library)
    drive.panel_in.subscribeTo(panel.spinningBodyOutMsg)
    drive.hub_in.subscribeTo(craft.scStateOutMsg)
    panel.spinningBodyRefInMsg.subscribeTo(drive.shaft_out)
    torque.cmdTorqueInMsg.subscribeTo(drive.torque_out)

    log = craft.scStateOutMsg.recorder()
    for order, model in enumerate([drive, torque, panel, craft, log]):
        simulation.AddModelToTask("task", model, 100 - order)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(duration))
    simulation.ExecuteSimulation()
    drive.library.microvib_free(drive.drive)
    return 1e-9 * log.times(), log.omega_BN_B[:, 1]


def amplitudes(time, values, frequencies):
    """Amplitudes of cosines at these frequencies, fitted with a Hann window: the ringing mode leaks less."""
    window = np.hanning(len(time))[:, None]
    waves = np.exp(2j * np.pi * np.outer(time, frequencies))
    table = window * np.hstack([waves.real, waves.imag, np.ones((len(time), 1))])
    found = np.linalg.lstsq(table, window[:, 0] * values)[0]
    return np.hypot(found[: len(frequencies)], found[len(frequencies) : -1])


def compare(settle, duration):
    """Print and return relative differences of the hub's rate from microvib's own: of its RMS, of its lines."""
    with tempfile.TemporaryDirectory() as folder:
        time, rate = simulate_hub(shaft_library(folder), settle + duration)
    time, rate = time[time >= settle], rate[time >= settle]

    record = {"record.start": "rest", "record.settle": f"{settle} s", "record.duration": f"{duration} s"}
    run = mv.simulate(CRAFT.with_(record), channels="T_d")
    own_rate = np.cumsum(run["T_d"]) / run.sample_rate / HUB_INERTIA
    jitter = np.std(rate) / np.std(own_rate) - 1
    print(f"Hub in Basilisk, from microvib's own free craft: mean rate {1e6 * rate.mean():.2f} urad/s,")
    print(f"jitter {1e6 * rate.std():.2f} urad/s RMS ({100 * jitter:+.2f} %), most of it the mode that rings; lines")

    found = mv.find_lines(run)
    frequencies = np.array([found[name].frequency for name in ("drive_1", "drive_2", "drive_3")])
    omega = 2 * np.pi * frequencies
    rates = amplitudes(time, rate, frequencies)
    differences = rates / (amplitudes(run.time, run["T_d"], frequencies) / (HUB_INERTIA * omega)) - 1
    for frequency, line, difference in zip(frequencies, rates, differences, strict=True):
        angle = line / (2 * np.pi * frequency)
        print(
            f"{frequency:8.3f} Hz: rate {1e6 * line:.5f} urad/s ({100 * difference:+.2f} %), angle {1e9 * angle:.4f} nrad"
        )
    return jitter, differences


if __name__ == "__main__":
    if len(sys.argv) > 1:
        STEP = float(sys.argv[1])
    compare(settle=30.0, duration=16.0)
