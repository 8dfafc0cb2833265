"""Scenarios that several tests and benchmarks simulate."""

import math
from typing import Any, TypeVar

import numpy as np

import microvib as mv
from microvib.analysis.limits import Limit
from microvib.model.part import Part
from microvib.model.reducer import Reducer
from microvib.model.sentences import validate_part
from microvib.units import Si

P = TypeVar("P", bound=Part)

ROUND = {
    "motor.friction.viscous": 0.0255,
    "reducer.stiffness": 8400.0,
    "reducer.damping": 5.0,
    "array.rigid_inertia": 0.13,
    "array.modes.0.frequency": 1.19,
    "array.modes.0.damping": 0.01,
    "tracking.clock_ratio": 1.0,
}
NO_FRICTION = {"friction.coulomb": 0.0, "friction.breakaway": 0.0, "friction.slip_ring": None}
"""None but viscous on the output."""
ON_ROTOR = {
    "motor.friction.coulomb": 0.002,
    "motor.friction.breakaway": 0.004,
    "motor.friction.stribeck_rate": 0.05,
}
RIGID = {"reducer.stiffness": "rigid"}
ERROR = {
    "reducer.transmission_error": [
        {"order": 2, "amplitude": 2e-4, "phase": 0.3},
        {"order": 200, "amplitude": 1e-5, "phase": -1.1},
    ]
}
THREE_MODES = {
    "array.rigid_inertia": None,
    "array.modes": [
        {"frequency": 0.4, "damping": 0.005, "effective_inertia": 5.0},
        {"frequency": 1.19, "damping": 0.01, "effective_inertia": 2.5},
        {"frequency": 31.0, "damping": 0.02, "effective_inertia": 0.5},
    ],
}


def baseline() -> mv.Scenario:
    """State 1 with round values of what the paper does not give: figures of tests then do not move
    with an identification.
    """
    return mv.load_scenario("state-1").with_si(ROUND)


def in_si(part: type[P], **parameters: Any) -> P:
    """A part of numbers in SI, where its constructor asks for units."""
    return validate_part(part, parameters, si=True)


def changed(part: P, **values: Any) -> P:
    """A part with other values in SI; names of nested ones with two underscores between them."""
    data = part.model_dump()
    for key, value in values.items():
        node = data
        *path, last = key.split("__")
        for name in path:
            node = node[name]
        node[last] = value
    return in_si(type(part), **data)


def recorded(scenario: mv.Scenario, seed: int | None = None, noise: float = 1e-3) -> mv.Recording:
    """What is felt about the drive axis of a scenario, with noise [N m] where a seed is given."""
    torque = mv.simulate(scenario, channels=("T_d",))["T_d"]
    if seed is not None:
        torque = torque + np.random.default_rng(seed).normal(0.0, noise, torque.size)
    return mv.Recording({"Mz": torque}, scenario.record.sample_rate, {"Mz": "N*m"}, "made")


def limit_of(*numbers: float) -> Limit:
    """A limit [N m] and its band [Hz]."""
    return Limit(*map(Si, numbers))


def random_scenario(seed: int) -> mv.Scenario:
    """A legal set drawn about state 1: drive, gear (one in seven rigid), frictions, one to four
    modes, rate and microsteps.
    """
    r = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(r.uniform(math.log(low), math.log(high))))

    def some(low: float, high: float) -> float:
        return float(r.uniform(low, high))

    current, coulomb = some(0.3, 1.2), some(0.0, 0.1)
    on_rotor = some(0.0, 0.005) if r.random() < 0.5 else 0.0
    inertia, rigid = between(1.0, 60.0), between(0.02, 0.5)
    count = int(r.integers(1, 5))
    share = r.dirichlet(np.r_[20.0, np.ones(count - 1)])
    frequencies = np.sort([between(0.2, 10.0) for _ in range(count)])
    return mv.load_scenario("state-1").with_si(
        {
            "motor.current": current,
            "motor.torque_constant": some(0.15, 0.4),
            "motor.detent_torque": current * some(0.0, 0.015),
            "motor.winding_inductance": between(3e-3, 3e-2),
            "motor.friction.viscous": between(0.005, 0.06),
            "motor.friction.coulomb": on_rotor,
            "motor.friction.breakaway": on_rotor * some(1.0, 1.5),
            "driver.microsteps": int(r.choice([4, 8, 16, 32, 64])),
            "driver.proportional_gain": between(50.0, 1000.0),
            "driver.integral_gain": between(500.0, 20_000.0) if r.random() < 0.5 else 0.0,
            "driver.supply_voltage": None if r.random() < 0.5 else 6.0 * current * some(1.3, 4.0),
            "reducer.stiffness": "rigid" if r.random() < 1 / 7 else between(3000.0, 30_000.0),
            "reducer.damping": between(0.2, 10.0),
            "reducer.ratio": float(r.choice([50, 80, 100, 160])),
            "friction.coulomb": coulomb,
            "friction.breakaway": coulomb + some(0.0, 0.05),
            "friction.stribeck_rate": math.radians(between(0.001, 0.05)),
            "friction.viscous": between(0.005, 5.0),
            "friction.slip_ring.contact_pairs": int(r.integers(0, 400)),
            "array.inertia": inertia,
            "array.rigid_inertia": None,
            "array.modes": [
                {
                    "frequency": float(f),
                    "damping": some(0.005, 0.02),
                    "effective_inertia": float((inertia - rigid) * s),
                }
                for f, s in zip(frequencies, share, strict=True)
            ],
            "tracking.rate": math.radians(between(0.01, 0.3)) * float(r.choice([-1, 1])),
            "tracking.clock_ratio": some(0.99, 1.01),
        }
    )


def heavy_scenario(seed: int) -> mv.Scenario:
    """A slow set about state 1 in which friction weighs much and falls with the rate."""
    r = np.random.default_rng(10_000 + seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(r.uniform(math.log(low), math.log(high))))

    coulomb = between(0.02, 0.3)
    return random_scenario(seed).with_si(
        {
            "friction.coulomb": coulomb,
            "friction.breakaway": coulomb + between(0.005, 0.15),
            "friction.stribeck_rate": math.radians(between(0.001, 0.1)),
            "friction.viscous": between(0.005, 1.0),
            "tracking.rate": math.radians(between(0.004, 0.06)) * float(r.choice([-1, 1])),
            "tracking.clock_ratio": 1.0,
        }
    )


def smooth_scenario(seed: int) -> mv.Scenario:
    """State 1 with microsteps that ramp over their whole length, little detent torque and a reducer of
    little damping: smooth turning is stable there, and friction may keep the drive ringing beside it.
    """
    r = np.random.default_rng(20_000 + seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(r.uniform(math.log(low), math.log(high))))

    return mv.load_scenario("state-1").with_si(
        {
            "driver.microsteps": int(r.choice([4, 8, 16])),
            "driver.microstep_ramp": 1.0,
            "motor.detent_torque": between(3e-4, 3e-3),
            "reducer.stiffness": between(3e3, 2e4),
            "reducer.damping": between(0.3, 1.0),
            "tracking.rate": math.radians(between(0.03, 0.06)),
        }
    )


def scenario_of_any_kind(seed: int) -> mv.Scenario:
    """A legal set of any kind of drive.

    Two, three or five phases, harmonic gear (with or without its transmission error), gear train or
    rigid gear, backlash, presliding, falling friction, errors of the driver, modes from 0.3 to 60
    Hz with 0.2 to 5 % of damping, 0.01 to 0.3 deg/s, 8 to 256 microsteps; one in eight on a free
    spacecraft.
    """
    r = np.random.default_rng(50_000 + seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(r.uniform(math.log(low), math.log(high))))

    def some(low: float, high: float) -> float:
        return float(r.uniform(low, high))

    phases = int(r.choice([2, 2, 2, 3, 5]))
    current, inertia, rigid = some(0.3, 1.2), between(1.0, 60.0), between(0.02, 0.5)
    count = int(r.integers(1, 5))
    share, frequencies = (
        r.dirichlet(np.ones(count)),
        np.sort([between(0.3, 60.0) for _ in range(count)]),
    )
    coulomb, on_rotor = between(0.01, 0.3), some(0.0, 0.005) if r.random() < 0.5 else 0.0
    given: dict[str, Any] = {
        "motor.phases": phases,
        "motor.current": current,
        "motor.torque_constant": some(0.15, 0.4),
        "motor.detent_torque": current * some(0.0, 0.015),
        "motor.winding_inductance": between(3e-3, 3e-2),
        "motor.friction.viscous": between(0.003, 0.06),
        "motor.friction.coulomb": on_rotor,
        "motor.friction.breakaway": on_rotor * some(1.0, 1.5),
        "motor.friction.stribeck_rate": between(0.001, 0.1),
        "driver.beats": 2 * phases,
        "driver.microsteps": int(r.choice([8, 16, 32, 64, 128, 256])),
        "driver.proportional_gain": between(50.0, 1000.0),
        "driver.integral_gain": between(500.0, 20_000.0) if r.random() < 0.5 else 0.0,
        "friction.coulomb": coulomb,
        "friction.breakaway": coulomb + between(0.003, 0.15),
        "friction.stribeck_rate": math.radians(between(0.001, 0.1)),
        "friction.viscous": between(0.005, 1.0),
        "friction.slip_ring.contact_pairs": int(r.integers(0, 300)),
        "tracking.rate": math.radians(between(0.01, 0.3)) * float(r.choice([-1, 1])),
        "tracking.clock_ratio": 1.0,
        "record": {"settle": 30.0, "duration": 16.0, "sample_rate": 2048.0},
    }
    kind = r.choice(["plain", "plain", "rigid", "error", "error", "train"])
    gear: dict[str, Any] = {"wave_generator_inertia": 5e-6, "damping": between(0.2, 5.0)}
    if kind == "train":
        pinion, wheel, sun, ring = (
            int(r.integers(15, 30)),
            int(r.integers(45, 120)),
            int(r.integers(15, 25)),
            int(r.integers(45, 90)),
        )
        ring += (ring - sun) % 2
        errors = [{"order": "mesh", "amplitude": between(2e-6, 5e-5)}] if r.random() < 0.5 else []
        stages = [{"pinion": pinion, "wheel": wheel}, {"pinion": 18, "wheel": 90, "errors": errors}]
        if (sun + ring) % 3 == 0:
            stages.insert(1, {"sun": sun, "ring": ring, "planets": 3})
        gear |= {"train": stages, "stiffness": between(3000.0, 30_000.0)}
    else:
        gear |= {
            "ratio": float(r.choice([50, 80, 100, 160])),
            "stiffness": "rigid" if kind == "rigid" else between(3e3, 3e4),
        }
    if kind == "error":
        gear["transmission_error"] = [
            {"order": 2, "amplitude": between(1e-5, 2e-4), "phase": some(0.0, 6.0)}
        ]
    extra = r.random()
    if extra < 0.12:
        given["friction.presliding"] = {"stiffness": between(2000.0, 30_000.0), "elements": 4}
    elif extra < 0.2 and kind != "rigid":
        gear["backlash"] = between(5e-5, 5e-4)
    elif extra < 0.4:
        errors = {
            "gain_b": some(-0.03, 0.03),
            "offset_a": some(-0.03, 0.03),
            "quadrature": some(-0.02, 0.02),
        }
        given["driver.imperfections"] = errors
    given["reducer"] = in_si(Reducer, **gear)
    moving = float(inertia - rigid)
    modes = [
        {
            "frequency": float(f),
            "damping": between(0.002, 0.05),
            "effective_inertia": moving * float(s),
        }
        for f, s in zip(frequencies, share, strict=True)
    ]
    scenario = mv.load_scenario("state-1").with_si(
        given | {"array.inertia": inertia, "array.rigid_inertia": None, "array.modes": modes}
    )
    return scenario if r.random() > 1 / 8 else scenario.with_si(_on_craft(scenario, r))


def _on_craft(scenario: mv.Scenario, r: np.random.Generator) -> dict[str, Any]:
    """A free hub under the array, which is given the six components that a craft needs."""
    array = scenario.array
    modes = [
        {
            "frequency": m.frequency,
            "damping": m.damping,
            "interface_participation": [
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
                math.sqrt(float(m.effective_inertia or 0.0)),
            ],
        }
        for m in array.modes
    ]
    J = array.inertia
    body = {
        "mass": 4.0 * J,
        "center_of_mass": [0.0, 0.0, 2.0],
        "inertia": [30.0 * J, 30.0 * J, J, 0.0, 0.0, 0.0],
    }
    hub = [float(x) for x in r.uniform(40.0, 400.0, 3)]
    return {
        "array": {"inertia": J, "drive_axis": "z", "modes": modes, "rigid_body": body},
        "spacecraft": {
            "hub": {
                "mass": 50.0 * J,
                "inertia": [
                    *(float(np.mean(hub)) + 0.3 * (np.array(hub) - np.mean(hub))),
                    0.0,
                    0.0,
                    0.0,
                ],
            },
            "array_angle": 0.5,
            "interface": {
                "position": [0.3, 0.9, 0.0],
                "drive_axis": [0, 1, 0],
                "reference": [1, 0, 0],
            },
            "attitude_control": {"bandwidth": 0.02, "damping": 0.7},
        },
    }
