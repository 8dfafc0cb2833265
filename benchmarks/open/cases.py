"""The cases of the open benchmark: which there are, which half is withheld, and what each draws.

A case is its name and its seed, and nothing else is kept of it. ``half`` is decided by the digest
of the name; the seed of a withheld case also depends on a salt, so that whoever judges can draw a
withheld half that nobody has seen.
"""

from __future__ import annotations

import copy
import hashlib
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from integrator import Parameters

CASES = 100
SALT = "2026"
"""Of the withheld half whose results the page shows."""
OPEN, WITHHELD = "open", "withheld"
SUFFIXES = (".uff", ".mat", ".csv", ".tdms")
RATES = (2048.0, 2500.0, 4096.0, 5000.0)
"""Sample rates [Hz] that a file states."""
FEWEST_PERIODS = 6.0
"""Electrical periods that a record holds at least."""
DETUNED = {"reducer.stiffness": 0.25, "motor.friction.viscous": 0.25, "array.rigid_inertia": 0.15}
"""Parameters to be identified, and by which part at most the scenario has them wrong."""


@dataclass(frozen=True)
class Case:
    """A name, its half and the seed that everything is drawn from."""

    name: str
    half: str
    seed: int


def cases(count: int = CASES, salt: str = SALT) -> list[Case]:
    """The first ``count`` cases."""
    return [case_of(f"case-{k:03d}", salt) for k in range(count)]


def case_of(name: str, salt: str = SALT) -> Case:
    """A case by its name: withheld where the last bit of the name's SHA-256 is 1."""
    withheld = hashlib.sha256(name.encode()).digest()[-1] & 1
    if withheld:
        half, seeded = WITHHELD, f"{salt}/{name}"
    else:
        half, seeded = OPEN, name
    seed = int.from_bytes(hashlib.sha256(f"seed of {seeded}".encode()).digest()[:8], "big")
    return Case(name, half, seed)


def manifest(count: int = CASES, salt: str = SALT) -> str:
    """Names, halves and seeds as CSV text, as ``manifest.csv`` has them."""
    rows = [f"{case.name},{case.half},{case.seed}" for case in cases(count, salt)]
    return "\n".join(["case,half,seed", *rows, ""])


@dataclass(frozen=True)
class Test:
    """A drive, how it is driven, and how it is recorded."""

    case: Case
    drive: Parameters
    references: np.ndarray
    """Reference currents of each microstep of an electrical period, (m, 2) [A]."""
    f_d: float
    """Microsteps per second, of a clock without error [Hz]."""
    settle: float
    duration: float
    sample_rate: float
    """As the file states it [Hz]."""
    recorder_ratio: float
    """Sample rate of the recorder over the stated one."""
    suffix: str
    noise: Noise
    ripple: Ripple
    scenario: dict[str, Any]
    """What a user knows of the drive, as a scenario file, with the parameters to identify wrong."""
    truth: dict[str, float] = field(default_factory=dict)
    """Values of these parameters."""

    @property
    def f_e(self) -> float:
        """Electrical periods per second [Hz]."""
        return self.f_d / len(self.references)

    def true_scenario(self) -> dict[str, Any]:
        """The scenario with the values of the drive as it is, and its clock."""
        scenario = copy.deepcopy(self.scenario)
        for key, value in self.truth.items():
            _put(scenario, key, value)
        nominal = scenario["tracking"]["rate"] * self.drive.h * self.drive.z * len(self.references)
        scenario["tracking"]["clock_ratio"] = self.f_d / (nominal / (2.0 * math.pi))
        scenario["motor"]["flux_harmonics"] = [
            {"order": int(order), "amplitude": float(part), "phase": float(phase)}
            for order, part, phase in self.drive.flux
        ]
        return scenario


@dataclass(frozen=True)
class Noise:
    """Noise of the table: white, a part that grows as 1/f below a corner, and the mains."""

    density: float
    """One-sided [N2 m2/Hz]."""
    corner: float
    mains: float
    """50 or 60 Hz."""
    hum: float
    """Amplitude of the mains' first harmonic [N m]; those after it fall as 1/k."""

    def at(self, frequency: np.ndarray) -> np.ndarray:
        """One-sided power spectral density [N2 m2/Hz]."""
        return self.density * (1.0 + self.corner / np.maximum(frequency, 0.01))


@dataclass(frozen=True)
class Ripple:
    """Errors of the measuring chain's gain, from line to line: standard deviations."""

    gain: float = 0.004
    phase: float = 0.01
    width: float = 2.0
    """Frequencies nearer than this share their error [Hz]."""


def draw(case: Case) -> Test:
    """All that a case's seed decides."""
    random = np.random.default_rng(case.seed)
    motor = _motor(random)
    known, drive_parts = _mechanics(random, motor)
    microsteps = int(random.choice([8, 16, 32, 64]))
    nominal = float(np.exp(random.uniform(math.log(25.0), math.log(220.0))))
    duration, nominal = _duration(random, nominal, microsteps)
    errors = _driver_errors(random)
    flux = _flux(random)
    ratio = 1.0 + random.uniform(-0.008, 0.008)
    rate = nominal / (microsteps * 4.0 * motor["z"]) * 2.0 * math.pi / drive_parts["h"]
    drive = Parameters(flux=flux, **motor, **drive_parts)
    slowest = float(np.min(0.5 * drive.D))
    settle = min(max(4.0 / slowest, 3.0), 20.0)
    size = 0.02 * float(np.exp(random.uniform(math.log(1e-3), math.log(0.1))))  # RMS of 1 kHz [N m]
    hum = size * random.uniform(0.5, 3.0) if random.random() < 0.3 else 0.0
    noise = Noise(
        size**2 / 1000.0, float(random.uniform(0.0, 2.0)), float(random.choice([50.0, 60.0])), hum
    )
    truth = _unknown(drive)
    scenario = _scenario(drive, known | errors | {"microsteps": microsteps, "rate": rate})
    for key, part in DETUNED.items():
        off = 1.0 + part * float(random.uniform(-1.0, 1.0))
        if key in truth:
            _put(scenario, key, truth[key] * off)
    sample_rate = float(random.choice(RATES))
    scenario["record"] = {"settle": settle, "duration": duration, "sample_rate": sample_rate}
    return Test(
        case=case,
        drive=drive,
        references=references(known["current"], microsteps, errors),
        f_d=nominal * ratio,
        settle=settle,
        duration=duration,
        sample_rate=sample_rate,
        recorder_ratio=1.0 + random.uniform(-1e-4, 1e-4),
        suffix=str(random.choice(SUFFIXES)),
        noise=noise,
        ripple=Ripple(),
        scenario=scenario,
        truth=truth,
    )  # fmt: skip


def _motor(random: np.random.Generator) -> dict[str, Any]:
    """Two-phase motor of 1.8 or 0.9 degrees with its current loops."""
    z, K_m = float(random.choice([50, 50, 100])), float(random.uniform(0.15, 0.45))
    L = float(random.uniform(4e-3, 15e-3))
    K_P = L * float(random.uniform(12e3, 25e3))
    return {
        "z": z, "K_m": K_m, "R": float(random.uniform(2.0, 9.0)), "L": L, "K_P": K_P, "K_I": 12.0 * K_P,
        "J_m": float(random.uniform(1.5e-5, 5e-5)),
    }  # fmt: skip


def _mechanics(
    random: np.random.Generator, motor: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Current, and the drive's other parameters."""
    current = float(random.uniform(0.3, 0.9))
    spring = motor["z"] * motor["K_m"] * current
    damping = float(random.uniform(0.35, 0.9))
    J_h = float(np.exp(random.uniform(math.log(0.05), math.log(0.4))))
    hub = 2.0 * math.pi * float(random.uniform(15.0, 50.0))
    count = int(random.integers(1, 4))
    f = np.sort(np.exp(random.uniform(math.log(1.0), math.log(9.0), count)))
    share = random.uniform(1.0, 8.0) * random.dirichlet(np.ones(count))
    H = np.sqrt(np.maximum(share, 0.02))
    if count > 1 and np.min(np.diff(f)) < 0.5:
        f = 1.2 + 2.1 * np.arange(count)
    xi = random.uniform(0.01, 0.03, count)
    parts = {
        "K_d": float(random.uniform(0.01, 0.07)) * motor["K_m"] * current,
        "rotor_viscous": 2.0 * damping * math.sqrt(spring * motor["J_m"]),
        "h": float(random.choice([80.0, 100.0, 120.0, 160.0])),
        "K_g": J_h * hub**2, "C_g": 2.0 * float(random.uniform(0.01, 0.05)) * J_h * hub,
        "sliding": float(random.uniform(0.1, 0.9)), "excess": float(random.uniform(0.003, 0.03)),
        "stribeck_rate": math.radians(float(random.uniform(0.002, 0.01))),
        "viscous": float(random.uniform(0.0, 0.05)), "J_h": J_h, "H": H,
        "Lambda": (2.0 * math.pi * f) ** 2, "D": 2.0 * xi * 2.0 * math.pi * f,
    }  # fmt: skip
    return {"current": current, "frequencies": f, "dampings": xi}, parts


def _duration(random: np.random.Generator, f_d: float, microsteps: int) -> tuple[float, float]:
    """A usual length of a record [s] that holds enough electrical periods, and the driving frequency
    [Hz], faster where none does.
    """
    f_d = max(f_d, FEWEST_PERIODS * 4 * microsteps / 16.0)
    long_enough = [
        x for x in (4.0, 8.0, 12.0, 16.0) if x * f_d / (4 * microsteps) >= FEWEST_PERIODS
    ]
    return float(random.choice(long_enough)), f_d


def _driver_errors(random: np.random.Generator) -> dict[str, Any]:
    errors: dict[str, Any] = {"gain_b": 0.0, "offset_a": 0.0, "offset_b": 0.0, "quadrature": 0.0}
    if random.random() < 0.6:
        sizes = {"gain_b": 0.02, "offset_a": 0.01, "offset_b": 0.01, "quadrature": 0.02}
        errors = {key: size * float(random.uniform(-1.0, 1.0)) for key, size in sizes.items()}
    errors["dac_bits"] = int(random.integers(8, 13)) if random.random() < 0.25 else None
    return errors


def _flux(random: np.random.Generator) -> np.ndarray:
    """Third and fifth harmonic of the flux linkages, in some drives."""
    if random.random() > 0.4:
        return np.zeros((0, 3))
    turn = float(random.choice([0.0, math.pi])) + float(random.normal(0.0, 0.2))
    third = (3.0, float(random.uniform(0.005, 0.04)), turn)
    return np.array(
        [third, (5.0, float(random.uniform(0.0, 0.01)), float(random.uniform(-3.0, 3.0)))]
    )


def references(current: float, microsteps: int, errors: dict[str, Any]) -> np.ndarray:
    """i_A* and i_B* [A] of each microstep of an electrical period, (4 n, 2)."""
    angle = 2.0 * math.pi * np.arange(4 * microsteps) / (4 * microsteps)
    a = np.cos(angle) + errors["offset_a"]
    b = (1.0 + errors["gain_b"]) * np.sin(angle + errors["quadrature"]) + errors["offset_b"]
    both = np.stack([a, b], axis=1)
    if errors["dac_bits"] is not None:
        levels = 2 ** (errors["dac_bits"] - 1) - 1
        size = np.floor(np.round(np.abs(both) * levels, 9) + 0.5)
        both = np.copysign(size, both) / levels
    return current * both


def _scenario(d: Parameters, known: dict[str, Any]) -> dict[str, Any]:
    """A scenario file's contents, in SI: what is known of the drive but its flux harmonics."""
    modes = [
        {"frequency": float(f), "damping": float(xi), "effective_inertia": float(H**2)}
        for f, xi, H in zip(known["frequencies"], known["dampings"], d.H, strict=True)
    ]
    array = {"inertia": d.J_h + float(np.sum(d.H**2)), "modes": modes}
    if len(modes) == 1:  # its effective inertia follows from the rigid one, which is to be found
        del modes[0]["effective_inertia"]
        array["rigid_inertia"] = d.J_h
    errors = {
        key: known[key] for key in ("gain_b", "offset_a", "offset_b", "quadrature", "dac_bits")
    }
    return {
        "title": "open benchmark",
        "motor": {
            "rotor_teeth": int(d.z), "current": known["current"], "torque_constant": d.K_m,
            "detent_torque": d.K_d, "winding_resistance": d.R, "winding_inductance": d.L,
            "rotor_inertia": d.J_m, "friction": {"coulomb": 0.0, "breakaway": 0.0, "stribeck_rate": 1e-4,
            "viscous": d.rotor_viscous},
        },
        "driver": {
            "beats": 4, "microsteps": known["microsteps"], "proportional_gain": d.K_P,
            "integral_gain": d.K_I, "derivative_gain": 0.0, "supply_voltage": None, "imperfections": errors,
        },
        "reducer": {
            "ratio": d.h, "wave_generator_inertia": 0.0, "stiffness": d.K_g, "damping": d.C_g,
            "output_inertia": 0.0,
        },
        "friction": {
            "coulomb": d.sliding, "breakaway": d.sliding + d.excess, "stribeck_rate": d.stribeck_rate,
            "stribeck_shape": 1.0, "viscous": d.viscous,
        },
        "array": array,
        "tracking": {"rate": known["rate"], "clock_ratio": 1.0},
    }  # fmt: skip


def _unknown(d: Parameters) -> dict[str, float]:
    """The parameters that are to be identified; the rigid inertia with one mode only, where the
    total is what is known.
    """
    found = {"reducer.stiffness": d.K_g, "motor.friction.viscous": d.rotor_viscous}
    if d.H.size == 1:
        found["array.rigid_inertia"] = d.J_h
    return found


def _put(tree: dict[str, Any], key: str, value: float) -> None:
    *path, last = key.split(".")
    for name in path:
        tree = tree[name]
    tree[last] = value
