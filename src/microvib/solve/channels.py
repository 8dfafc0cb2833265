"""Channels of a motion: name, unit and meaning, declared here and nowhere else.

The kernel fills a row with them in this order (``kernel.CHANNELS``); its powers come out as
energies.
"""

from __future__ import annotations

from dataclasses import dataclass

from microvib.model.rigid import COMPONENTS


@dataclass(frozen=True)
class Channel:
    """Description of a channel of a motion."""

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
        Channel("T_f_m", "N*m", "friction on the rotor, with eddy-current damping"),
        Channel("T_f", "N*m", "friction on the output (Eq. 7), with noise and harness"),
        Channel("T_g", "N*m", "torque through the reducer on the output"),
        Channel("T_l", "N*m", "load torque of the array (Eq. 16)"),
        Channel("T_d", "N*m", "disturbance torque on the spacecraft, momentum form (Eq. 20)"),
        Channel(
            "T_d_force",
            "N*m",
            "disturbance torque on the spacecraft, sum of the torques on the housing",
        ),
        Channel("stuck_rotor", "1", "fraction of the time that the rotor sticks"),
        Channel("stuck_output", "1", "fraction of the time that the output shaft sticks"),
        Channel("E_kinetic", "J", "kinetic energy"),
        Channel("E_magnetic", "J", "magnetic energy of the windings"),
        Channel("E_elastic", "J", "elastic energy of gear, modes, detent and harness"),
        Channel("E_electrical", "J", "electrical energy supplied since t = 0"),
        Channel("E_joule", "J", "energy lost in the windings since t = 0"),
        Channel("E_friction", "J", "energy lost in both frictions since t = 0"),
        Channel("E_damping", "J", "energy lost in gear and modal damping since t = 0"),
    )
}
MODAL = {
    "eta": Channel("eta", "kg^0.5*m", "modal coordinates"),
    "eta_rate": Channel("eta_rate", "kg^0.5*m/s", "rates of the modal coordinates"),
}
TIME = Channel("time", "s", "time from the start of the command")
LOADS = {
    name: Channel(name, "N" if name.startswith("F") else "N*m", f"{name} on the spacecraft")
    for name in COMPONENTS
}
"""Loads at the interface, of arrays with participation in six components."""
LOAD_COLUMNS = tuple(
    f"{name.lower()}_{'n' if load.unit == 'N' else 'n_m'}" for name, load in LOADS.items()
)
LOS_COLUMNS = ("los_x_rad", "los_y_rad")
"""Columns of loads and angles of the line of sight in tables."""
SECOND_LOADS = {
    f"{name}_2": Channel(
        f"{name}_2", load.unit, f"{name} on the spacecraft at the second wing's interface"
    )
    for name, load in LOADS.items()
}
"""Loads of a second wing."""
LINE_OF_SIGHT = {
    "los_x": Channel(
        "los_x",
        "rad",
        "first angle of the line of sight, less the mean motion that the command makes",
    ),
    "los_y": Channel("los_y", "rad", "second angle of the line of sight"),
    "los_ax": Channel(
        "los_ax", "rad/s^2", "second derivative of the first angle of the line of sight"
    ),
    "los_ay": Channel(
        "los_ay", "rad/s^2", "second derivative of the second angle of the line of sight"
    ),
}
"""Channels of a spacecraft with a line of sight."""
ALL_CHANNELS = {**CHANNELS, **MODAL, **LOADS, **SECOND_LOADS, **LINE_OF_SIGHT}
"""Everything that has a name."""
