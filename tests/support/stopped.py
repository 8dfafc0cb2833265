"""The kernel, stopped at times of one's own."""

from collections.abc import Iterable

import numpy as np

from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import Packed, pack
from microvib.solve.sampling import empty_sample_buffer


def rows_at(scenario: Scenario, times: Iterable[float]) -> tuple[np.ndarray, Packed]:
    """Snapshots at ``times`` [s], one row each, and the packed drive at the last."""
    packed, rows = pack(scenario), []
    for stop in times:
        advance(scenario, packed, stop)
        rows.append(packed.snapshot())
    return np.array(rows), packed


def advance(scenario: Scenario, packed: Packed, stop: float) -> None:
    """Bring a packed drive to ``stop`` [s]."""
    microsteps = Command(scenario).microsteps(float(packed.state.clock[kernel.NOW]), stop)
    assert packed.advance(stop, empty_sample_buffer(packed.channels), *microsteps) == kernel.OK
