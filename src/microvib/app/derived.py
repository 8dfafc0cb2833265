"""What follows from a scenario before it is run."""

from __future__ import annotations

import math

from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario


def derived(scenario: Scenario) -> list[str]:
    """Values that follow from a scenario and that an engineer wants to see before running it."""
    motor, driver, reducer, array = scenario.motor, scenario.driver, scenario.reducer, scenario.array
    step, f_d = driver.full_step(motor), scenario.driving_frequency
    texts = [
        f"full step {math.degrees(step):.6g} deg, microstep {math.degrees(step) / driver.microsteps:.6g} deg at the rotor (Eq. 25)",
        f"driving frequency f_d {f_d:.6g} Hz (Eq. 26)"
        if f_d
        else "driving frequency: the rate is zero or changes in the record",
        f"electromagnetic spring z K_m I {motor.electromagnetic_stiffness:.6g} N m/rad at the rotor,"
        f" {motor.electromagnetic_stiffness * reducer.ratio**2:.6g} N m/rad at the output",
        f"breakaway torque of the output {scenario.friction.breakaway_torque:.6g} N m, slip ring included (Eq. 6, 7)",
        f"rigidly attached inertia J_h {array.J_h:.6g} kg m², of J {array.inertia:.6g} kg m²",
    ]
    for mode in coupled_modes(scenario)[:12]:
        clamped = "" if mode.fixed_frequency is None else f", clamped {mode.fixed_frequency:.6g} Hz"
        texts.append(
            f"{mode.name}: {mode.frequency:.6g} Hz through the drive{clamped}, damping ratio {mode.damping:.4g}"
        )
    return texts
