"""How often the interval of the clock ratio holds the truth while an array mode rings.

``python benchmarks/ringing_clock.py [--recordings N] [--seed N] [--noise N_m]``

Each recording is of a drive like the catalog's states 1, 2 and 4 whose reducer, frictions and driver
are drawn, begun 2 to 30 s after its start, with a clock that is drawn, and noise. In brackets are
95 % confidence limits of the share (Clopper and Pearson). Nothing is asserted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.errors import MicrovibError
from microvib.model.scenario import Scenario

STATES = (1, 2, 4)
DURATION, RATE = 10.0, 4096.0
SETTLE = (2.0, 30.0)
NORMAL = 1.96
"""Standard deviations of an interval of 95 %."""


def drawn(random: np.random.Generator) -> Scenario:
    """A drive like one of the catalog's."""
    start = mv.load_scenario(f"state-{random.choice(STATES)}")
    own = {name: value for name, value, _ in start.entries()}
    keys = ("reducer.stiffness", "motor.friction.viscous", "friction.coulomb", "friction.viscous")
    parts = {key: own[key] * random.uniform(0.6, 1.4) for key in keys if own.get(key)}
    errors = {
        "driver.imperfections.gain_b": 0.02 * random.uniform(-1.0, 1.0),
        "driver.imperfections.offset_a": 0.01 * random.uniform(-1.0, 1.0),
        "driver.imperfections.offset_b": 0.01 * random.uniform(-1.0, 1.0),
        "driver.imperfections.quadrature": 0.02 * random.uniform(-1.0, 1.0),
    }
    record = {
        "record.settle": random.uniform(*SETTLE), "record.duration": DURATION, "record.sample_rate": RATE,
    }  # fmt: skip
    return start.with_si({**parts, **errors, **record})


def deviation(random: np.random.Generator, noise: float) -> tuple[float, float, float, float]:
    """Error of the clock ratio of one recording, its standard uncertainty, the largest mode's
    amplitude over that of the clock's largest line, and the error in cycles of that line.
    """
    nominal = drawn(random)
    clock = nominal.tracking.clock_ratio * random.uniform(0.995, 1.005)
    torque = mv.simulate(nominal.with_si({"tracking.clock_ratio": clock}), channels=("T_d",))["T_d"]
    noisy = torque + random.normal(0.0, noise, torque.size)
    table = lines_of_samples(noisy, RATE, nominal, measured=True)
    if table.clock_ratio is None or table.clock_ratio_uncertainty is None:
        return np.nan, np.nan, np.nan, np.nan
    rings = max((x.amplitude for x in table if x.is_mode and x.seen), default=0.0)
    largest = max((x for x in table if x.of_clock and x.seen), key=lambda x: x.amplitude)
    error = table.clock_ratio - clock / nominal.tracking.clock_ratio
    cycles = error * largest.frequency * DURATION
    return error, table.clock_ratio_uncertainty, rings / largest.amplitude, cycles


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, estimate, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=100, help="how many (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of drives and noise (default: 1)")
    parser.add_argument("--noise", type=float, default=1e-4, help="of a sample [N m]")
    options = parser.parse_args(arguments)
    rows = []
    for k in range(options.recordings):
        try:
            row = deviation(np.random.default_rng([options.seed, k]), options.noise)
        except MicrovibError as reason:
            print(f"recording {k}: {reason}", file=sys.stderr)
            continue
        print(
            f"recording {k}: {row[0]:.2g}, {row[0] / row[1]:.2f} of {row[1]:.2g}; rings {row[2]:.2g}, {row[3]:.2g} cycles",
            file=sys.stderr,
        )
        rows.append(row)
    error, spread, rings, _ = np.array(rows).T
    off = np.abs(error / spread)
    inside, known = int(np.sum(off <= NORMAL)), int(np.sum(np.isfinite(off)))
    low, high = binomtest(inside, known).proportion_ci(0.95)
    print(
        f"{inside} of {known} within {NORMAL} standard uncertainties"
        f" ({100.0 * low:.0f} to {100.0 * high:.0f} %), the farthest {np.nanmax(off):.2g} off;"
        f" RMS {np.sqrt(np.nanmean(off**2)):.2g}; modes of up to {np.nanmax(rings):.2g} of the"
        " clock's largest line"
    )


if __name__ == "__main__":
    main()
