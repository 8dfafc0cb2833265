"""Lines over many draws of the noise: mean, deviation and 95 % quantile, with what so many draws
can tell of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from microvib.analysis.lines import expected_in, named_or_modes
from microvib.errors import OptionError
from microvib.model.scenario import Scenario
from microvib.signals.line_fit import lines_at_known_clock
from microvib.signals.line_table import Line, LineTable, SeedLine
from microvib.signals.seed_peaks import MOST_DRAWS, SeedPeaks, peaks_of_draw
from microvib.solve.batch import Torque, simulate_torques

QUANTILE, CONFIDENCE = 0.95, 0.95
MAX_SEEDS = 100_000


def seeds_of(scenario: Scenario, draw: int) -> dict[str, int]:
    """Keys and values of the seeds of a draw of the scenario's noise, the first being its own; none
    without noise.
    """
    noise, position = scenario.friction.torque_noise, scenario.friction.position
    if noise and not noise.silent:
        keys = {"friction.torque_noise.seed": noise.seed}
    else:
        keys = {}
    if position and position.roughness and position.acts:
        keys["friction.position.roughness.seed"] = position.roughness.seed
    return {key: (seed + draw) % 2**63 for key, seed in keys.items()}


def check_seeds(scenario: Scenario, number: int) -> None:
    """OptionError where a scenario has no noise to draw, or so many draws are not allowed."""
    if not seeds_of(scenario, 0):
        raise OptionError(
            "seeds",
            "sets the number of noise draws, but this scenario has no noise; give it some"
            " (friction.torque_noise), or leave this option out",
        )
    if not 2 <= number <= MAX_SEEDS:
        raise OptionError("seeds", f"{number} is not allowed; 2 to {MAX_SEEDS} draws are expected")


def with_seeds(
    table: LineTable, scenario: Scenario, number: int, progress: Callable[[int], None] | None = None
) -> LineTable:
    """The table with its lines over a ``number`` of draws, those of its seeds and of the following
    ones, each from rest.

    Unlisted lines are others in every draw and are left out; ``seed_peaks`` has what is beside the
    clock's lines. What ``check_seeds`` allows is drawn; raises what ``simulate`` raises.
    """
    rest = scenario.with_({"record.start": "rest"})
    names = [line.name for line in table if line.kind != "other"]
    found: dict[str, list[Line]] = {name: [] for name in names}
    broken, record = dict.fromkeys(table.broken), scenario.record
    expected = expected_in(scenario, record.sample_rate, table.harmonics)
    wanted = named_or_modes(expected, names)
    peaks = []
    for k in range(number):
        (torque,) = simulate_torques([rest.with_(seeds_of(scenario, k))])
        if not isinstance(torque, Torque):
            raise torque
        broken |= dict.fromkeys(torque.broken)
        drawn = lines_at_known_clock(torque.T_d, torque.sample_rate, wanted)
        if k < MOST_DRAWS:
            peaks.append(peaks_of_draw(torque.T_d, torque.sample_rate, drawn))
        for line in drawn:
            if line.name in found and math.isfinite(line.amplitude):
                found[line.name].append(line)
        if progress:
            progress(k + 1)
    over = tuple(_seed_statistics(rows) for rows in found.values() if len(rows) > 0.9 * number)
    return replace(table, seeds=over, seed_peaks=SeedPeaks.of(peaks), broken=tuple(broken))


def _seed_statistics(rows: list[Line]) -> SeedLine:
    amplitude = np.sort([x.amplitude for x in rows])
    low, high = quantile_bounds(amplitude)
    return SeedLine(
        name=rows[0].name,
        frequency=float(np.median([x.frequency for x in rows])),
        draws=len(rows),
        mean=float(amplitude.mean()),
        deviation=float(amplitude.std(ddof=1)),
        p95=float(np.quantile(amplitude, QUANTILE)),
        p95_low=low,
        p95_high=high,
        hidden=max((x.hidden for x in rows), default=0.0),
    )


def quantile_bounds(values: np.ndarray, quantile: float = QUANTILE) -> tuple[float, float]:
    """Bounds of a ``quantile`` of the distribution that sorted ``values`` (n,) are drawn from, each
    with CONFIDENCE, whatever the distribution.

    The m-th smallest of n draws is below the quantile as often as a binomial distribution says; nan
    where n is too small.
    """
    from scipy.special import bdtr

    n = values.size
    below = bdtr(np.arange(n), n, quantile)  # of at most so many draws being below the quantile
    low = np.flatnonzero(below <= 1.0 - CONFIDENCE)
    high = np.flatnonzero(below >= CONFIDENCE)
    return (
        float(values[low[-1]]) if low.size else 0.0,
        float(values[high[0]]) if high.size else math.nan,
    )
