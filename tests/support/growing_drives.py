"""Drives whose deviations from smooth turning grow, or whose lines appear where the linear drive has none:
drawn at random, and kept as they are.
"""

from microvib.io.scenario_file import scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.scenario import Scenario

WIDE_DETENT = """
title: three phases and a large detent torque
motor:
  rotor_teeth: 50
  phases: 3
  current: 0.2925 A
  torque_constant: 1.319 N*m/A
  detent_torque: 0.05457 N*m
  winding_resistance: 9.38 ohm
  rotor_inertia: 0.158 kg*cm^2
  winding_inductance: 0.01452 H
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.003 deg/s
    viscous: 0.0038 N*m*s/rad
  eddy_damping: 0.000153 N*m*s/rad
driver:
  beats: 6
  microsteps: 16
  drive: current
  proportional_gain: 48.28 V/A
  integral_gain: 3.119e+04 V/(A*s)
  microstep_ramp: 0.29
reducer:
  ratio: 50
  wave_generator_inertia: 0.0133 kg*cm^2
  stiffness: 1.005e+04 N*m/rad
  damping: 6.72 N*m*s/rad
friction:
  coulomb: 0 N*m
  breakaway: 0 N*m
  stribeck_rate: 0.003 deg/s
  viscous: 0.0381 N*m*s/rad
array:
  inertia: 8.53385 kg*m^2
  modes:
  - frequency: 1.639 Hz
    damping: 1 percent
    effective_inertia: 0.05105 kg*m^2
  - frequency: 7.611 Hz
    damping: 0.3 percent
    effective_inertia: 1.96 kg*m^2
  - frequency: 12.1 Hz
    damping: 0.3 percent
    effective_inertia: 6.454 kg*m^2
tracking:
  rate: 0.25682 deg/s
record:
  settle: 30 s
  duration: 16 s
  sample_rate: 2048 Hz
"""

SLOW_GROWTH = """
title: a small detent torque, and little more damping than it takes away
motor:
  rotor_teeth: 50
  current: 0.6 A
  torque_constant: 0.3 N*m/A
  detent_torque: 0.004 N*m
  winding_resistance: 6 ohm
  winding_inductance: 13 mH
  rotor_inertia: 0.2 kg*cm^2
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.003 deg/s
    viscous: 0.0116 N*m*s/rad
driver:
  beats: 4
  microsteps: 64
  proportional_gain: 500 V/A
  integral_gain: 6000 V/(A*s)
reducer:
  ratio: 10
  wave_generator_inertia: 0.05 kg*cm^2
  stiffness: rigid
  damping: 5 N*m*s/rad
friction:
  coulomb: 0 N*m
  breakaway: 0 N*m
  stribeck_rate: 0.003 deg/s
  viscous: 0 N*m*s/rad
array:
  inertia: 0.9 kg*m^2
  rigid_inertia: 0.9 kg*m^2
  modes: []
tracking:
  profile:
  - rate: 1.809 deg/s
    ramp: 20 s
record:
  settle: 30 s
  duration: 16 s
  sample_rate: 1024 Hz
"""

BY_WINDINGS = """
array:
  inertia: 5e-05 kg*m^2
  modes: []
  rigid_inertia: 5e-05 kg*m^2
driver:
  beats: 4
  drive: voltage
  microsteps: 32
friction:
  breakaway: 0 N*m
  coulomb: 0 N*m
  stribeck_rate: 0.003 deg/s
  viscous: 0 N*m*s/rad
motor:
  current: 0.6 A
  detent_torque: 0.0002 N*m
  friction:
    breakaway: 0 N*m
    coulomb: 0 N*m
    stribeck_rate: 0.003 deg/s
    viscous: 0.0012317736978591676 N*m*s/rad
  rotor_inertia: 0.2 kg*cm^2
  rotor_teeth: 50
  torque_constant: 0.3 N*m/A
  winding_inductance: 0.013 H
  winding_resistance: 6 ohm
record:
  duration: 16 s
  sample_rate: 4096 Hz
  settle: 30 s
reducer:
  damping: 5 N*m*s/rad
  ratio: 1
  stiffness: rigid
  wave_generator_inertia: 0.01 kg*cm^2
title: voltages at a high rate
tracking:
  profile:
  - ramp: 10 s
    rate: 720.0 deg/s
"""

GEAR_AND_DETENT = """
title: an error of the gear and a detent harmonic
motor:
  rotor_teeth: 20
  phases: 5
  current: 0.3193 A
  torque_constant: 0.418 N*m/A
  detent_torque: 0 N*m
  winding_resistance: 2.77 ohm
  rotor_inertia: 0.0371 kg*cm^2
  winding_inductance: 0.007966 H
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.003 deg/s
    viscous: 0.0335 N*m*s/rad
  detent:
  - order: 6
    amplitude: 0.0037 N*m
    phase: 90 deg
driver:
  beats: 10
  microsteps: 4
  drive: current
  proportional_gain: 50.81 V/A
  integral_gain: 1.767e+04 V/(A*s)
  microstep_ramp: 0.95
reducer:
  ratio: 100
  wave_generator_inertia: 0.0318 kg*cm^2
  stiffness: 2876 N*m/rad
  damping: 8.53 N*m*s/rad
  transmission_error:
  - order: 813
    amplitude: 2 arcsec
friction:
  coulomb: 0 N*m
  breakaway: 0 N*m
  stribeck_rate: 0.003 deg/s
  viscous: 0.17 N*m*s/rad
array:
  inertia: 0.541941 kg*m^2
  modes:
  - frequency: 46.5 Hz
    damping: 0.2 percent
    effective_inertia: 0.5066 kg*m^2
tracking:
  rate: 0.20601 deg/s
record:
  settle: 30 s
  duration: 16 s
  sample_rate: 2048 Hz
"""

BENT = """
title: full steps of five phases with friction
motor:
  rotor_teeth: 50
  phases: 5
  current: 0.3751 A
  torque_constant: 0.6212 N*m/A
  detent_torque: 0.009887 N*m
  winding_resistance: 11.7 ohm
  rotor_inertia: 0.0663 kg*cm^2
  winding_inductance: 0.03995 H
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.003 deg/s
    viscous: 0.0124 N*m*s/rad
driver:
  beats: 10
  microsteps: 1
  drive: current
  proportional_gain: 426 V/A
  integral_gain: 1.248e+05 V/(A*s)
reducer:
  ratio: 3
  wave_generator_inertia: 0.149 kg*cm^2
  stiffness: 8398 N*m/rad
  damping: 2.65 N*m*s/rad
friction:
  coulomb: 0.01039 N*m
  breakaway: 0.01039 N*m
  stribeck_rate: 0.555 deg/s
  viscous: 0.297 N*m*s/rad
array:
  inertia: 3.95502 kg*m^2
  modes:
  - frequency: 6.144 Hz
    damping: 0.3 percent
    effective_inertia: 3.87 kg*m^2
tracking:
  rate: 0.16449 deg/s
record:
  settle: 30 s
  duration: 16 s
  sample_rate: 2048 Hz
"""


def drawn(text: str) -> Scenario:
    """The scenario of one of these texts."""
    return scenario_of(parse_yaml(text, "drawn"), "drawn")
