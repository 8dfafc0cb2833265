"""Scenarios that several tests and benchmarks simulate."""

import math
from typing import Any, TypeVar

import numpy as np

import microvib as mv
from microvib.analysis.limits import Limit
from microvib.model.part import Part
from microvib.model.sentences import validated
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
ON_ROTOR = {"motor.friction.coulomb": 0.002, "motor.friction.breakaway": 0.004, "motor.friction.stribeck_rate": 0.05}
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
    """State 1 with round values of what the paper does not give: figures of tests then do not move with an identification."""
    return mv.load_scenario("state-1").with_si(ROUND)


def in_si(part: type[P], **parameters: Any) -> P:
    """A part of numbers in SI, where its constructor asks for units."""
    return validated(part, parameters, si=True)


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
    """A legal set drawn about state 1: drive, gear (one in seven rigid), frictions, one to four modes, rate and microsteps."""
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
                {"frequency": float(f), "damping": some(0.005, 0.02), "effective_inertia": float((inertia - rigid) * s)}
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
