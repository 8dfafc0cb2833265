"""Drives that something changes over longer than a full step: drawn at random, and kept as they are."""

from microvib.io.scenario_file import scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.scenario import Scenario

ERROR_OF_GEAR = """
title: drawn at random
motor:
  rotor_teeth: 50
  phases: 2
  current: 1.257 A
  torque_constant: 0.1218 N*m/A
  detent_torque: 0.001099 N*m
  winding_resistance: 2.07 ohm
  winding_inductance: 8.46 mH
  rotor_inertia: 4.77e-05 kg*m^2
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.136 rad/s
    viscous: 0.00143 N*m*s/rad
driver:
  beats: 4
  microsteps: 8
  proportional_gain: 171.3 V/A
  integral_gain: 4561 V/(A*s)
  imperfections:
    gain_b: -0.032
    quadrature: -2.9 deg
    dac_bits: 6
reducer:
  ratio: 100.0
  same_way: false
  wave_generator_inertia: 9.39e-06 kg*m^2
  stiffness: 1.936e+04 N*m/rad
  damping: 1.54 N*m*s/rad
  output_inertia: 0 kg*m^2
  transmission_error:
  - order: 3
    amplitude: 57.6 arcsec
    phase: 293 deg
friction:
  coulomb: 0.0201 N*m
  breakaway: 0.0201 N*m
  stribeck_rate: 0.000995 rad/s
  viscous: 0.208 N*m*s/rad
  presliding:
    stiffness: 2.754e+05 N*m/rad
    elements: 2
array:
  inertia: 0.67383351 kg*m^2
  modes:
  - frequency: 4.6824 Hz
    damping: 0.00668
    effective_inertia: 0.034233 kg*m^2
  - frequency: 13.409 Hz
    damping: 0.0459
    effective_inertia: 0.016085 kg*m^2
  - frequency: 25.586 Hz
    damping: 0.00996
    effective_inertia: 0.30393 kg*m^2
  - frequency: 59.84 Hz
    damping: 0.0154
    effective_inertia: 0.10943 kg*m^2
  - frequency: 61.239 Hz
    damping: 0.0292
    effective_inertia: 0.12815 kg*m^2
tracking:
  rate: 0.074725 deg/s
record:
  settle: 107.6 s
  duration: 3.401 s
  sample_rate: 964 Hz
"""
"""Transmission error of three cycles per turn, of 16 s each; a record of 3.4 s."""

FRICTION_OVER_ANGLE = """
title: drawn at random
motor:
  rotor_teeth: 50
  phases: 2
  current: 1.429 A
  torque_constant: 0.4145 N*m/A
  detent_torque: 0.00368 N*m
  winding_resistance: 5.99 ohm
  winding_inductance: 8.6 mH
  rotor_inertia: 3.68e-05 kg*m^2
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.233 rad/s
    viscous: 0.00656 N*m*s/rad
driver:
  beats: 4
  microsteps: 16
  proportional_gain: 121.1 V/A
  integral_gain: 2.346e+04 V/(A*s)
reducer:
  ratio: 100.0
  same_way: false
  wave_generator_inertia: 1.74e-05 kg*m^2
  stiffness: 2.798e+04 N*m/rad
  damping: 9.14 N*m*s/rad
  output_inertia: 0.047 kg*m^2
  transmission_error:
  - order: 3
    amplitude: 48.3 arcsec
    phase: 186 deg
friction:
  coulomb: 2.56 N*m
  breakaway: 3.44 N*m
  stribeck_rate: 8.57e-05 rad/s
  viscous: 0.187 N*m*s/rad
  position:
    harmonics:
    - order: 71
      amplitude: 0.458
      phase: 252 deg
array:
  inertia: 1.1133365 kg*m^2
  modes:
  - frequency: 1.2518 Hz
    damping: 0.0358
    effective_inertia: 0.64332 kg*m^2
tracking:
  rate: 0.111213 deg/s
record:
  settle: 14.6 s
  duration: 1.826 s
  sample_rate: 1736 Hz
"""
"""Friction over the angle, of 45.6 s a cycle; in a part of it the drive slips at every third microstep."""

ERROR_OF_TWO_CYCLES = """
title: drawn at random
motor:
  rotor_teeth: 50
  phases: 2
  current: 0.3577 A
  torque_constant: 0.1082 N*m/A
  detent_torque: 0.003582 N*m
  winding_resistance: 5.59 ohm
  winding_inductance: 3.89 mH
  rotor_inertia: 5.52e-05 kg*m^2
  friction:
    coulomb: 0 N*m
    breakaway: 0 N*m
    stribeck_rate: 0.0106 rad/s
    viscous: 0.00227 N*m*s/rad
driver:
  beats: 4
  microsteps: 5
  proportional_gain: 161.7 V/A
  integral_gain: 5.935e+04 V/(A*s)
reducer:
  ratio: 160.0
  same_way: false
  wave_generator_inertia: 6.25e-06 kg*m^2
  stiffness: 3400 N*m/rad
  damping: 0.843 N*m*s/rad
  output_inertia: 0 kg*m^2
  transmission_error:
  - order: 2
    amplitude: 30.1 arcsec
    phase: 267 deg
friction:
  coulomb: 0.0516 N*m
  breakaway: 0.0808 N*m
  stribeck_rate: 0.000132 rad/s
  viscous: 0.25 N*m*s/rad
array:
  inertia: 0.28291619 kg*m^2
  modes:
  - frequency: 1.3773 Hz
    damping: 0.0195
    effective_inertia: 0.10659 kg*m^2
tracking:
  rate: 0.0372284 deg/s
record:
  settle: 62.1 s
  duration: 9.873 s
  sample_rate: 512 Hz
"""
"""Transmission error of two cycles per turn, of 30 s each; a record of 9.9 s."""


def drawn(text: str) -> Scenario:
    """The scenario of one of these texts."""
    return scenario_of(parse_yaml(text, "drawn"), "drawn")
