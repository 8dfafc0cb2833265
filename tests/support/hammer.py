"""Recordings of a hammer's blows on a virtual table whose resonances are known."""

import math
from collections.abc import Sequence

import numpy as np

from microvib.model.rigid import COMPONENTS
from microvib.testdata.bench import Bench, Resonance, measure
from microvib.testdata.recording import Recording
from support.scenarios import in_si

PULSE = 2e-4  # seconds; standard deviation of a blow's force over time


def blows(
    resonances: Sequence[Resonance],
    *,
    count: int = 10,
    gap: float = 1.0,
    noise: float = 0.05,
    second: tuple[int, float] | None = None,
    arm: float = 1.0,
    seed: int = 0,
    rate: float = 4096.0,
) -> Recording:
    """Channel ``hammer`` [N] and the reading of the resonances' component; ``noise`` is that of the
    reading over its RMS, and in newtons of the force; ``second`` is a blow that is struck twice, and how many seconds later.
    """
    rng, component = np.random.default_rng(seed), resonances[0].component
    bench = in_si(
        Bench,
        sample_rate=rate,
        duration=count * gap + 1.0,
        lead=0.5,
        torque_range=1e5,
        force_range=1e5,
    ).model_copy(update={"table": tuple(resonances)})
    n = math.ceil(bench.span * bench.analog_rate)
    t = np.arange(n) / bench.analog_rate - bench.lead
    force = np.zeros(n)
    for k in range(count):
        at = 0.5 + k * gap + rng.uniform(0.0, 0.05)
        force += rng.uniform(50.0, 150.0) * np.exp(-0.5 * ((t - at) / PULSE) ** 2)
        if second is not None and second[0] == k:
            force += 30.0 * np.exp(-0.5 * ((t - at - second[1]) / PULSE) ** 2)
    x = np.zeros((6, n))
    x[COMPONENTS.index(component)] = arm * force
    reading = measure(bench, x, np.zeros(n))[component]
    first = round(bench.lead * bench.analog_rate)
    hammer = force[first : first + 4 * reading.size : 4]
    channels = {
        "hammer": hammer + noise * rng.normal(size=hammer.size),
        component: reading + noise * reading.std() * rng.normal(size=reading.size),
    }
    units = {"hammer": "N", component: "N" if component[0] == "F" else "N*m"}
    return Recording(channels, rate, units, "blows")


def resonance(
    component: str = "Mz", frequency: float = 300.0, damping: float = 0.02, share: float = 1.0
) -> Resonance:
    """A resonance of figures in SI."""
    return in_si(Resonance, component=component, frequency=frequency, damping=damping, share=share)
