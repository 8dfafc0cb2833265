"""Scenarios of pulsed drives, from the parameters of the oracle beside them."""

from typing import Any

import numpy as np

import microvib as mv
from support.pulses import Friction, PulsedDrive

HELD = PulsedDrive(
    voltage=71.0,
    on_time=0.06,
    diode_voltage=8.0,
    step_time=2.16,
    R=300.0,
    L=1.5,
    K_m=1.0,
    K_d=0.02,
    J_m=2e-5,
    J_l=100.0,
    K_g=3e4,
    C_g=30.0,
    rotor=Friction(0.005, 0.0, 1.0, 1e-4),
    output=Friction(1.0, 0.0, 1.0, 1.0),
)
"""A drive that makes all its steps."""


def drawn(seed: int) -> PulsedDrive:
    """A drive drawn about that: motor, gear, frictions, load, pulse and clamp."""
    r = np.random.default_rng(seed)

    def times(value: float, factor: float) -> float:
        return value * float(np.exp(r.uniform(-1.0, 1.0) * np.log(factor)))

    resistance, held = times(200.0, 2.0), times(0.004, 2.0)
    return PulsedDrive(
        voltage=times(70.0, 1.3),
        on_time=times(0.05, 1.5),
        diode_voltage=times(6.0, 2.0),
        step_time=times(0.4, 1.5),
        R=resistance,
        L=resistance * times(5e-3, 2.0),
        K_m=times(0.8, 1.5),
        K_d=times(0.02, 1.5),
        J_m=times(2e-5, 2.0),
        J_l=times(40.0, 2.0),
        K_g=times(2e4, 2.0),
        C_g=times(20.0, 2.0),
        ratio=float(r.choice([100, 160, 200])),
        rotor=Friction(0.8 * held, 0.2 * held, times(0.5, 2.0), times(2e-4, 2.0)),
        output=Friction(times(0.4, 2.0), 0.1, times(1e-3, 2.0), times(1.0, 2.0)),
    )


def scenario_of(drive: PulsedDrive, steps: int, **changes: Any) -> mv.Scenario:
    """The scenario of a drive, with a record of so many steps, each judged."""
    rate = -drive.full_step / drive.ratio / drive.step_time
    of_drive = {
        "motor.rotor_teeth": drive.teeth,
        "motor.torque_constant": drive.K_m,
        "motor.detent_torque": drive.K_d,
        "motor.winding_resistance": drive.R,
        "motor.winding_inductance": drive.L,
        "motor.rotor_inertia": 0.6 * drive.J_m,
        "driver.drive": "pulse",
        "driver.beats": 4,
        "driver.microsteps": 1,
        "driver.proportional_gain": 0.0,
        "driver.integral_gain": 0.0,
        "driver.supply_voltage": drive.voltage,
        "driver.on_time": drive.on_time,
        "driver.diode_voltage": drive.diode_voltage,
        "driver.clamp": "bidirectional" if drive.both_ways else "unidirectional",
        "reducer.ratio": drive.ratio,
        "reducer.wave_generator_inertia": 0.4 * drive.J_m,
        "reducer.stiffness": drive.K_g,
        "reducer.damping": drive.C_g,
        "reducer.output_inertia": 0.3 * drive.J_l,
        "array.modes": [],
        "array.rigid_inertia": None,
        "array.inertia": 0.7 * drive.J_l,
        "friction.slip_ring": None,
        **_friction("motor.friction", drive.rotor),
        **_friction("friction", drive.output),
        "tracking.rate": rate,
        "tracking.clock_ratio": 1.0,
        "record.settle": 0.0,
        "record.duration": (steps + 0.75) * drive.step_time,
        "record.sample_rate": 1000.0,
        "record.start": "rest",
    }
    return mv.load_scenario("state-1").with_si(of_drive | changes)


def _friction(group: str, friction: Friction) -> dict[str, float]:
    return {
        f"{group}.coulomb": friction.coulomb,
        f"{group}.breakaway": friction.held,
        f"{group}.stribeck_rate": friction.stribeck_rate,
        f"{group}.stribeck_shape": 1.0,
        f"{group}.viscous": friction.viscous,
    }
