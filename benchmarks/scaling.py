"""How microvib's cost grows: with the number of array modes, and with the simulated time.

``python benchmarks/scaling.py``

Nothing is asserted. Machines differ: only the slopes mean something elsewhere.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import microvib as mv

MODES = (0, 1, 3, 10, 30, 60)
SPANS = (4, 8, 16, 32, 64, 128, 256)
"""Simulated times [s]; half of each is recorded."""
HIGHEST = 120.0
"""Frequency of the highest mode [Hz]."""
EXTRA = 0.001
"""Effective inertia of each mode after the first [kg m^2]."""
RUNS = 5


def main() -> None:
    """Print both tables."""
    state = mv.load_scenario("state-1")
    mv.simulate(state)  # compiles, or loads what was compiled
    _modes(state)
    _spans(state)


def with_modes(state: mv.Scenario, count: int) -> mv.Scenario:
    """``state`` with ``count`` modes from its own first one up to HIGHEST, evenly spread by ratio.

    The inertia rigidly on the shaft stays what it is, and the modes after the first are weak: the
    drive then sticks and slips much as before, so that the cost of the modes is seen and not that
    of another motion.
    """
    array = state.array
    first = array.modes[0]
    frequencies = np.geomspace(first.frequency, HIGHEST, max(count, 2))[:count]
    inertias = np.full(count, EXTRA)
    if count:
        inertias[0] = array.H[0] ** 2 - (count - 1) * EXTRA
    modes = [
        {"frequency": float(f), "damping": first.damping, "effective_inertia": float(inertia)}
        for f, inertia in zip(frequencies, inertias, strict=True)
    ]
    data: dict[str, Any] = {
        "inertia": array.J_h + float(inertias.sum()),
        "rigid_inertia": None,
        "modes": modes,
    }
    # The sources name single modes, which need not exist any more.
    return state.with_si({"sources": {}, **{f"array.{key}": value for key, value in data.items()}})


def _modes(state: mv.Scenario) -> None:
    print(f"modes ({state.record.settle:g} s to settle, {state.record.duration:g} s recorded)")
    print(
        f"{'modes':>6s} {'sticks per s':>13s} {'steps per s':>12s} {'ms per simulated s':>19s} {'us per step':>12s}"
    )
    per_second, per_step = [], []
    for count in MODES:
        scenario = with_modes(state, count)
        wall, solver = _best(scenario)
        span = solver["simulated_s"]
        work = solver["steps"] + solver["rejected_steps"] + solver["event_location_steps"]
        per_second.append(1e3 * wall / span)
        per_step.append(1e6 * wall / work)
        sticks = solver["sticks"] / span
        print(
            f"{count:6d} {sticks:13.1f} {work / span:12.0f} {per_second[-1]:19.2f} {per_step[-1]:12.2f}"
        )
    print(
        f"fit: {_line(MODES, per_second)} ms per simulated s; {_line(MODES, per_step)} us per step"
    )
    print(
        f"power of the number of modes from {MODES[-3]} to {MODES[-1]}: {_power(MODES[-3:], per_second[-3:]):.2f}\n"
    )


def _spans(state: mv.Scenario) -> None:
    print("simulated time (half of it recorded)")
    print(f"{'simulated s':>12s} {'wall s':>9s} {'ms per simulated s':>19s}")
    walls = []
    for span in SPANS:
        wall, _ = _best(state.with_si({"record.settle": 0.5 * span, "record.duration": 0.5 * span}))
        walls.append(wall)
        print(f"{span:12d} {wall:9.4f} {1e3 * wall / span:19.2f}")
    print(f"power of the simulated time: {_power(SPANS, walls):.3f}")


def _best(scenario: mv.Scenario) -> tuple[float, dict[str, Any]]:
    """Wall time [s] of the best of RUNS runs, and what the solver says of it."""
    walls = []
    for _ in range(RUNS):
        begun = time.perf_counter()
        motion = mv.simulate(scenario)
        walls.append(time.perf_counter() - begun)
    return min(walls), motion.solver


def _line(x: tuple[int, ...], y: list[float]) -> str:
    slope, intercept = np.polyfit(x, y, 1)
    return f"{intercept:.2f} + {slope:.3f} x modes"


def _power(x: tuple[int, ...], y: list[float]) -> float:
    """Exponent p of y ~ x^p."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


if __name__ == "__main__":
    main()
