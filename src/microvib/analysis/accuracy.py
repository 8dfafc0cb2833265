"""Error of a run from its integration in time: the beginning of the record is run again with finer steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from microvib.errors import SimulationError, expect
from microvib.model.scenario import Scenario
from microvib.signals.line_table import Line, LineTable
from microvib.solve.integration import again
from microvib.solve.motion import Motion

BOUND = 5e-3
"""Relative change of a line above which finer steps are advised."""
LEAST = 0.01
"""Fraction of the largest line above which a line counts."""
SHARE = 1.0 / 20.0
"""Fraction of the simulated time that is run again; with steps twice as fine, a tenth of the work."""
FULL_STEPS = 2.0
"""Full steps of the motor that are run again, at least."""
MOST = 16.0
"""Time [s] that is run again, at most."""
MAX_REFINEMENT = 64
"""Of ``solver.refinement``."""
SENSITIVE = 0.1
"""Part of an amplitude that is taken for the doubt of a motion which depends on details below the tolerance. What two runs differ
by is not a bound: in random sets it was 0.05 to 24 % (benchmarks/README.md)."""
KEY = "error_estimate"
"""Of a solver's account."""
_NOTHING = 1e-3
"""Difference of two runs, over the RMS of T_d, that says nothing by its growth."""
_GROWS = 3.0
"""Growth of a difference, from its first quarter to the largest, above which a motion may depend on details below the tolerance."""
_CONVERGES = 0.25
"""What twice finer steps leave of a difference at most; with order 4 a sixteenth is expected."""


@dataclass(frozen=True)
class Accuracy:
    """Uncertainty from the integration in time, by the difference from a run with finer steps from the same state."""

    stretch_s: float
    """Length of the beginning of the record that was run again [s]."""
    rms: float
    """RMS of the difference of T_d over the RMS of T_d about its mean."""
    line: float
    """Largest change of a line over its amplitude, of lines of at least a hundredth of the largest."""
    name: str
    """That line; empty if there is none."""
    sensitive: bool
    """Whether differences grow, or do not fall with the steps: the motion depends on details below the tolerance."""
    refinement: int
    """``solver.refinement`` with which lines are within BOUND: the run's own where they are, or where no step would help."""
    advised: bool
    """Whether that is another than the run's own."""

    @property
    def doubt(self) -> float:
        """Relative error of an amplitude from the integration."""
        return max(self.line, SENSITIVE) if self.sensitive else self.line

    def __str__(self) -> str:
        line = f"lines within {100 * self.line:.2g} % ({self.name}), " if self.name else ""
        sizes = f"{line}T_d within {100 * self.rms:.2g} % RMS, by {self.stretch_s:.3g} s with every step twice as fine"
        if self.sensitive:
            return (
                f"SENSITIVE: the motion depends on details below the tolerance ({sizes}, and the difference grows or does not"
                " fall with finer steps); its lines are those of one of many such motions, which finer steps make no more certain"
            )
        if self.advised:
            return f"NOT fine enough: {sizes}; set solver.refinement={self.refinement}"
        return sizes


def accuracy(motion: Motion, table: LineTable) -> Accuracy | None:
    """How far T_d of ``motion`` and the ``table`` of its lines are off by the integration.

    The beginning of the record is run again from its state with every step twice as fine and, where that leaves a doubt, four
    times as fine. None for a motion from a file, whose state is not known, and where ``solver.refinement`` allows no finer step.
    """
    expect(motion, Motion, "a motion (mv.simulate)")
    scenario, beginning = motion.scenario, motion.beginning
    own = scenario.solver.refinement
    if beginning is None or 4 * own > MAX_REFINEMENT:
        return None
    duration, rate = stretch(scenario), scenario.record.sample_rate
    T_d, counted = motion["T_d"][: round(duration * rate)], _counted(table)
    try:
        twice = again(scenario, beginning, 2, duration)
        first = _difference(T_d, twice, counted, rate)
        found = Accuracy(duration, first.rms, first.line, first.name, False, own, False)
        if first.line <= BOUND and not first.grows:
            return found
        second = _difference(twice, again(scenario, beginning, 4, duration), counted, rate)
    except SimulationError:  # a finer run that stops where this one went on
        return Accuracy(duration, 1.0, 1.0, counted[0].line if counted else "", True, own, False)
    if second.grows or second.rms > _CONVERGES * first.rms:
        return replace(found, sensitive=True)
    if first.line <= BOUND:
        return found
    return replace(found, refinement=(2 if second.line <= BOUND else 4) * own, advised=True)


def noted(table: LineTable, found: Accuracy | None) -> LineTable:
    """A table that knows how far it is off, so that a limit is judged by it."""
    return replace(table, own_error=0.0 if found is None else found.doubt)


def account(solver: Mapping[str, Any], found: Accuracy | None) -> dict[str, Any]:
    """The solver's account with the estimate."""
    return {**solver, KEY: None if found is None else asdict(found)}


def estimate_in(solver: Mapping[str, Any]) -> Accuracy | None:
    """The estimate that a solver's account holds."""
    known = solver.get(KEY)
    return None if known is None else Accuracy(**known)


def stretch(scenario: Scenario) -> float:
    """Length of the beginning of a record that is run again [s]."""
    record = scenario.record
    share = SHARE * (record.settle + record.duration)
    f_d = scenario.driving_frequency
    steps = FULL_STEPS * scenario.driver.microsteps / f_d if f_d else 0.0
    least = 8.0 / record.sample_rate
    return min(max(share, steps, least), MOST, record.duration)


def _counted(table: LineTable) -> list[Line]:
    """Lines that stand out and persist."""
    seen = [x for x in table if x.status == "ok" and x.amplitude_n_m > 0.0]
    top = max((x.amplitude_n_m for x in seen), default=0.0)
    return [x for x in seen if x.amplitude_n_m >= LEAST * top]


class _Difference(NamedTuple):
    rms: float
    line: float
    name: str
    grows: bool
    """Whether it grows from the first quarter on, to a significant size."""


def _difference(T_d: np.ndarray, finer: np.ndarray, counted: list[Line], sample_rate: float) -> _Difference:
    """The differences between two torques (n,) from the same state, and between their lines."""
    size, apart = float(np.std(finer)) or 1.0, T_d - finer
    rms, *quarters = (float(np.sqrt(np.mean(x**2))) / size for x in (apart, *np.array_split(apart, 4)))
    both = zip(counted, _amplitudes(T_d, counted, sample_rate), _amplitudes(finer, counted, sample_rate), strict=True)
    changes = ((abs(a - b) / x.amplitude_n_m, x.line) for x, a, b in both)
    line, name = max(changes, key=lambda change: change[0], default=(0.0, ""))
    return _Difference(rms, line, name, max(quarters) > max(_GROWS * quarters[0], _NOTHING))


def _amplitudes(x: np.ndarray, counted: list[Line], sample_rate: float) -> list[float]:
    """Amplitudes at the lines' frequencies, with a Hann window; neighbours that it does not part are in both of two runs."""
    window = np.hanning(x.size + 2)[1:-1]
    shaped = (x - x.mean()) * window * (2.0 / window.sum())
    t = np.arange(x.size) / sample_rate
    return [float(abs(np.exp(-2j * np.pi * line.frequency_hz * t) @ shaped)) for line in counted]
