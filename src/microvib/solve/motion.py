"""The motion history: labelled channels with units, and how it was computed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from microvib.model.scenario import Scenario


@dataclass(frozen=True)
class Channel:
    """What one channel of a motion is."""

    name: str
    unit: str
    meaning: str


CHANNELS = {
    channel.name: channel
    for channel in (
        Channel("i_A", "A", "current of phase A"),
        Channel("i_B", "A", "current of phase B"),
        Channel("u_A", "V", "voltage of phase A"),
        Channel("u_B", "V", "voltage of phase B"),
        Channel("i_ref_A", "A", "reference current of phase A (Eq. 1)"),
        Channel("i_ref_B", "A", "reference current of phase B (Eq. 1)"),
        Channel("theta_m", "rad", "angle of the rotor"),
        Channel("omega_m", "rad/s", "rate of the rotor"),
        Channel("alpha_m", "rad/s^2", "angular acceleration of the rotor"),
        Channel("theta_l", "rad", "angle of the array's root"),
        Channel("omega_l", "rad/s", "rate of the array's root"),
        Channel("alpha_l", "rad/s^2", "angular acceleration of the array's root"),
        Channel("T_e", "N*m", "motor torque, electromagnetic and detent (Eq. 4)"),
        Channel("T_f_m", "N*m", "friction on the rotor"),
        Channel("T_f", "N*m", "friction on the output (Eq. 7)"),
        Channel("T_g", "N*m", "torque through the reducer on the output"),
        Channel("T_l", "N*m", "load torque of the array (Eq. 16)"),
        Channel("T_d", "N*m", "disturbance torque on the spacecraft, momentum form (Eq. 20)"),
        Channel("T_d_force", "N*m", "disturbance torque on the spacecraft, sum of what the housing feels"),
        Channel("stuck_rotor", "1", "fraction of the time that the rotor sticks"),
        Channel("stuck_output", "1", "fraction of the time that the output shaft sticks"),
        Channel("E_kinetic", "J", "kinetic energy"),
        Channel("E_magnetic", "J", "magnetic energy of the windings"),
        Channel("E_elastic", "J", "elastic energy of gear, modes and detent"),
        Channel("E_electrical", "J", "electrical energy put in since t = 0"),
        Channel("E_joule", "J", "energy lost in the windings since t = 0"),
        Channel("E_friction", "J", "energy lost in both frictions since t = 0"),
        Channel("E_damping", "J", "energy lost in gear and modal damping since t = 0"),
    )
}
MODAL = {
    "eta": Channel("eta", "kg^0.5*m", "modal coordinates"),
    "eta_rate": Channel("eta_rate", "kg^0.5*m/s", "rates of the modal coordinates"),
}
INTERFACE = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@dataclass(frozen=True)
class Invariants:
    """What must hold whatever the parameters: how well it did."""

    torque_forms: float
    """Largest difference of the two forms of T_d over the largest T_d (algebra: rounding is expected)."""
    momentum: float
    """Mean torque that the change of momentum leaves over, ``|Delta L + integral of T_d dt| / t``, over the largest T_d."""
    energy: float
    """``|energy in - stored - dissipated|`` over the electrical energy put in."""
    energy_mechanical: float
    """The same over the energy that passed the shaft of the motor (without Joule heat, so the sharper figure)."""
    energy_in: float
    energy_dissipated: float
    energy_stored: float


@dataclass(frozen=True)
class Motion:
    """Sampled motion of one scenario: channels by name, each (n,), modal ones (n, s), at ``sample_rate`` [Hz]."""

    scenario: Scenario
    time: np.ndarray
    """Times from the start of the command [s], (n,)."""
    channels: dict[str, np.ndarray]
    invariants: Invariants
    solver: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]

    @property
    def sample_rate(self) -> float:
        """Samples per second [Hz]."""
        return self.scenario.record.sample_rate

    def interface_loads(self) -> np.ndarray | None:
        """Loads on the spacecraft Fx Fy Fz [N], Mx My Mz [N m] at the interface, (n, 6); None without 6 x s participation.

        The drive axis carries T_d; the others are what modes and interface inertia push back with.
        """
        array = self.scenario.array
        P = array.interface
        needed = {"alpha_l", "eta", "eta_rate", "T_d"} <= set(self.channels)
        if not array.modes and array.interface_inertia is not None:
            P = np.zeros((6, 0))
        if P is None or not needed:
            return None
        alpha = self.channels["alpha_l"]
        w_rate = -(self.channels["eta_rate"] * array.D + self.channels["eta"] * array.Lambda)
        acceleration = w_rate - np.outer(alpha, array.H)
        loads: np.ndarray = -acceleration @ P.T
        if array.interface_inertia is not None:
            loads -= np.outer(alpha, np.array(array.interface_inertia))
        loads[:, 3 + "xyz".index(array.drive_axis)] = self.channels["T_d"]
        return loads

    @property
    def dataset(self) -> Any:
        """The same as an ``xarray.Dataset`` with dimensions ``time`` and ``mode`` and a unit on every variable."""
        import xarray as xr

        data = {}
        for name, values in self.channels.items():
            channel = CHANNELS.get(name) or MODAL[name]
            dims = ("time", "mode") if values.ndim == 2 else ("time",)
            data[name] = (dims, values, {"units": channel.unit, "long_name": channel.meaning})
        loads = self.interface_loads()
        if loads is not None:
            for k, name in enumerate(INTERFACE):
                unit = "N" if k < 3 else "N*m"
                data[name] = (("time",), loads[:, k], {"units": unit, "long_name": f"{name} on the spacecraft"})
        coords = {"time": ("time", self.time, {"units": "s", "long_name": "time from the start of the command"})}
        return xr.Dataset(data, coords, {"title": self.scenario.title, "sample_rate": self.sample_rate})
