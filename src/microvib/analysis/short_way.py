"""The blocked-load method from a run on a fixed base to a craft, and its error against the
coupled run, line by line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microvib.analysis.hub_lines import channel_lines, complex_amplitudes
from microvib.analysis.lines import expected_in
from microvib.analysis.pointing import HubLines
from microvib.analysis.run import run_scenario
from microvib.model.coupling import (
    CoupledResponse,
    blocked_load_method,
    require_craft,
    rotation_to_hub_axes,
)
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.solve.integration import Progress
from microvib.solve.motion import Motion
from microvib.solve.steady.state import SteadyState


@dataclass(frozen=True)
class BlockedLines:
    """Lines of the clock on a fixed base."""

    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    loads: np.ndarray
    """Complex amplitudes at the interface point, hub axes, (k, 6) [N, N m]."""


def blocked_lines(source: Motion | SteadyState, on: Scenario, harmonics: int = 8) -> BlockedLines:
    """Lines of the six loads of a run on ground, in the hub axes of the scenario ``on`` a craft and
    at its array angle.
    """
    # What rings does so at other frequencies on a craft: the blocked-load method does not take it.
    expected = [
        line
        for line in expected_in(source.scenario, on.record.sample_rate, harmonics)
        if line.of_clock
    ]
    found = [channel_lines(source, name, tuple(expected)) for name in COMPONENTS]
    loads = np.array([complex_amplitudes(column) for column in found]).T.reshape(len(expected), 6)
    kept = np.any(np.isfinite(loads) & (loads != 0.0), axis=1)
    names = tuple(line.name for line, keep in zip(expected, kept, strict=True) if keep)
    frequency = np.array([line.frequency for line in expected])
    return BlockedLines(
        names, frequency[kept], np.nan_to_num(loads[kept]) @ rotation_to_hub_axes(on).T
    )


def blocked_load_solution(
    scenario: Scenario, *, harmonics: int = 8, progress: Progress | None = None
) -> tuple[BlockedLines, CoupledResponse]:
    """Blocked lines of a scenario on a craft, run without it, and what they become on it."""
    require_craft(scenario)
    result = run_scenario(
        scenario.model_copy(update={"spacecraft": None}), harmonics=harmonics, progress=progress
    )
    source = result.state or result.motion
    assert source is not None
    lines = blocked_lines(source, scenario, harmonics)
    return lines, blocked_load_method(scenario, lines.frequency, lines.loads)


@dataclass(frozen=True)
class Difference:
    """One line the blocked-load method and coupled: amplitudes of the line of sight and of the load vector,
    and how far they lie apart.
    """

    line: str
    frequency: float
    los: tuple[float, float]
    """Radial amplitude the blocked-load method and coupled [rad]; nan without a line of sight."""
    los_error: float
    """Length of the difference of the complex pairs over that of the coupled one."""
    load_error: float
    """Relative difference of the moments about the interface point."""
    share: float
    """Share of this line in the mean square of the coupled line of sight."""


def method_differences(
    lines: BlockedLines, short: CoupledResponse, full: HubLines
) -> list[Difference]:
    """The blocked-load method against the coupled run, line by line, those that count most in the line of
    sight first.
    """
    total = float(np.sum(full.amplitude**2)) or 1.0
    rows = []
    for k, name in enumerate(lines.names):
        if name not in full.names:
            continue
        j = full.names.index(name)
        los = (np.full(2, np.nan), np.full(2, np.nan))
        if short.los is not None and full.los is not None:
            los = short.los[k], full.los[j]
        size = tuple(float(np.linalg.norm(x)) for x in los)
        share = float(np.sum(full.amplitude[j] ** 2)) / total
        moments = short.loads[k, 3:], full.loads[j, 3:]
        rows.append(
            Difference(
                name,
                float(lines.frequency[k]),
                (size[0], size[1]),
                _relative_difference(*los),
                _relative_difference(*moments),
                share,
            )
        )
    return sorted(rows, key=lambda row: -row.share)


def _relative_difference(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.linalg.norm(found - wanted) / max(float(np.linalg.norm(wanted)), 1e-300))
