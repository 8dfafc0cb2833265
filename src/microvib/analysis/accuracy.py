"""Error of a run from its integration in time: it is run again with finer steps, the torque alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from microvib.analysis.margins import MIN_ERROR_REFERENCE_RATIO
from microvib.errors import SimulationError, expect
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.line_table import Line, LineTable
from microvib.solve.batch import Torque
from microvib.solve.integration import Simulation, rerun_refined
from microvib.solve.motion import InitialState, Motion
from microvib.solve.steady.state import SteadyState, find_steady

MAX_LINE_CHANGE = 5e-3
"""Relative change of a line above which finer steps are advised."""
MAX_RMS_CHANGE = 0.01
"""RMS of the difference of T_d, over the RMS of T_d, above which two runs are not taken for one
motion, whatever their lines: what lines show then is chance, and a run twice as fine again must
tell."""
MIN_LINE_RATIO = 0.01
"""Fraction of the largest line above which a line counts."""
MAX_REFINEMENT = 64
"""Largest ``solver.refinement`` that is advised."""
FINEST_ESTIMATED = MAX_REFINEMENT // 4
"""``solver.refinement`` up to which runs twice and four times as fine tell the error."""
SENSITIVE_MOTION_ERROR = 0.1
"""Relative error assumed for the lines of a motion that depends on details below the tolerance.
The difference of two runs is no bound there: in random sets it was 0.05 to 24 %
(benchmarks/README.md)."""
RMS_SAFETY_FACTOR = 1.5
"""Factor on the difference of T_d for the error of a line: that of single lines between two runs is
small by chance at times.
"""
ERROR_ESTIMATE_KEY = "error_estimate"
"""Key of the error estimate in a solver's account."""
_DIVERGED_RMS = 0.5
"""RMS of the difference of T_d, over the RMS of T_d, above which a run twice as fine is another
motion: that a third is like one of the two does not make it certain."""
_MAX_CONVERGENCE_RATIO = 0.25
"""Largest ratio of successive differences under step halving; order 4 gives a sixteenth."""


@dataclass(frozen=True)
class Accuracy:
    """Uncertainty from the integration in time, by the difference from a run with finer steps from
    the same state.
    """

    rms: float
    """RMS of the difference of T_d over the RMS of T_d about its mean."""
    line: float
    """Largest change of a line over its amplitude, of lines of at least a hundredth of the largest."""
    name: str
    """That line; empty if there is none."""
    sensitive: bool
    """Whether differences do not fall with the steps: the motion depends on details below the
    tolerance.
    """
    refinement: int
    """``solver.refinement`` with which lines are within BOUND and T_d within SAME_MOTION: the run's
    own where they are, or where no step would help."""
    advised: bool
    """Whether that is another than the run's own."""

    @property
    def relative_error(self) -> float:
        """Relative error of an amplitude from the integration."""
        return max(
            self.line,
            RMS_SAFETY_FACTOR * self.rms,
            SENSITIVE_MOTION_ERROR if self.sensitive else 0.0,
        )

    def __repr__(self) -> str:
        return f"Accuracy: {self}"

    def __str__(self) -> str:
        if self.name:
            line = f"lines within {100 * self.line:.2g} % ({self.name}), "
        else:
            line = ""
        sizes = f"{line}T_d within {100 * self.rms:.2g} % RMS, by comparison with a second run at half the step size"
        if self.sensitive:
            return (
                f"SENSITIVE: the motion depends on details below the tolerance ({sizes}, and the"
                " difference does not shrink with finer"
                " steps); its lines are one sample of many possible motions, and refining the steps"
                " does not reduce their uncertainty"
            )
        if self.advised:
            return f"NOT fine enough: {sizes}; set solver.refinement={self.refinement}"
        return sizes


@dataclass
class ErrorOfIntegration:
    """The error of a simulated torque's lines, found by running it again when a verdict asks."""

    source: Motion | SteadyState | Torque
    of_torque: bool = True
    """Whether the lines are those of T_d; of another channel the error of T_d alone counts."""
    found: float | None = None

    def __call__(self, table: LineTable) -> float:
        """Part of every amplitude of the ``table``; nan where it cannot be found."""
        if self.found is None:
            counted = table if self.of_torque else replace(table, lines=())
            self.found = self._error(counted)
        return self.found

    def _error(self, table: LineTable) -> float:
        if isinstance(self.source, SteadyState):
            return with_integration_error(table, steady_accuracy(self.source, table)).own_error
        if isinstance(self.source, Torque):
            scenario = self.source.scenario
            beginning = Simulation(scenario, torque_only=True).initial_state
            found = _compared(scenario, beginning, self.source.T_d, table)
            return with_integration_error(table, found).own_error
        if ERROR_ESTIMATE_KEY in self.source.solver:
            known = read_error_estimate(self.source.solver)
            return with_integration_error(table, known).own_error
        if self.source.beginning is None:
            return math.nan
        return with_integration_error(table, error_of_motion(self.source, table)).own_error


def with_known_error(table: LineTable) -> LineTable:
    """A table that knows how far it is off, for which a motion may be run again."""
    if table.find_error is None:
        return table
    return replace(table, own_error=table.find_error(table), find_error=None)


MAX_STEADY_RECORD = 128.0
"""Length [s] of a record from a steady state that is run again: it repeats, and longer ones tell no more."""


def steady_accuracy(state: SteadyState, table: LineTable) -> Accuracy | None:
    """``accuracy`` of the record that begins in a steady state, and that of a start from rest, where
    several motions may repeat with the command.
    """
    record = state.scenario.record
    shorter = {"record.duration": min(record.duration, MAX_STEADY_RECORD)}
    motion = replace(state, scenario=state.scenario.with_si(shorter)).motion(channels=("T_d",))
    found = error_of_motion(motion, table)
    several = state.subharmonic or bool(state.scenario.reducer.backlash)
    if found is None or not several:
        return found
    change, frequency = _change_from_rest(state)
    if change <= max(MAX_LINE_CHANGE, found.line):
        return found
    return replace(found, line=change, name=f"at {frequency:.5g} Hz", sensitive=True, advised=False)


def _change_from_rest(state: SteadyState) -> tuple[float, float]:
    """Largest change of a line, over its amplitude, to the steady state that a start from rest with
    finer steps leads to, and its frequency [Hz].

    Which of several motions a start leads to may depend on details below the tolerance.
    """
    finer = {"solver.refinement": 2 * state.scenario.solver.refinement}
    other, _ = find_steady(state.scenario.with_si(finer), whole=False)
    if other is None:
        return 1.0, state.driving_frequency
    own, theirs = _amplitudes_by_order(state), _amplitudes_by_order(other)
    if not own:  # the slowest line is above the passband, and no other is listed
        return 0.0, state.driving_frequency
    least = MIN_ERROR_REFERENCE_RATIO * max(own.values())
    changes = {
        order: abs(own.get(order, 0.0) - theirs.get(order, 0.0)) / max(own.get(order, 0.0), least)
        for order in own.keys() | theirs.keys()
    }
    worst = max(changes, key=lambda order: changes[order])
    return changes[worst], float(worst) * state.driving_frequency


def _amplitudes_by_order(state: SteadyState) -> dict[Fraction, float]:
    """Amplitudes of the torque's lines [N m] by their orders of the microsteps."""
    count = int(PASSBAND * state.scenario.record.sample_rate / state.frequency) + 1
    series = np.abs(state.harmonics("T_d", count))
    return {Fraction(k, state.microsteps): float(series[k]) for k in range(1, series.size)}


def accuracy(motion: Motion, table: LineTable) -> Accuracy | None:
    """Estimate how far T_d of a motion and the table of its lines are off by the integration.

    The motion is run again from its beginning with every step twice as fine and, where
    lines or T_d itself then differ, four times as fine: all of it, because what a motion
    remembers of rare events while it settles may show in lines that a short stretch cannot part.

    Parameters
    ----------
    motion : Motion
        What was simulated.
    table : LineTable
        Its lines, as ``find_lines(motion)`` gives them.

    Returns
    -------
    Accuracy or None
        Relative errors of lines and of T_d. None for a motion from a file, whose state is not
        known, and where ``solver.refinement`` allows no finer step.

    Raises
    ------
    ObjectError
        For what is no motion or no table of lines.
    """
    expect(motion, Motion, "a motion (mv.simulate)")
    expect(table, LineTable, "a table of lines (mv.find_lines)")
    return error_of_motion(motion, table)


def error_of_motion(motion: Motion, table: LineTable) -> Accuracy | None:
    """``accuracy`` of a motion and the table of its lines."""
    if motion.beginning is None:
        return None
    return _compared(motion.scenario, motion.beginning, motion["T_d"], table)


def _compared(
    scenario: Scenario, beginning: InitialState, T_d: np.ndarray, table: LineTable
) -> Accuracy | None:
    """``accuracy`` of a torque (n,) [N m] from its beginning."""
    own = scenario.solver.refinement
    if not can_be_refined(scenario):
        return None
    counted, rate = _significant_lines(table), scenario.record.sample_rate
    duration = T_d.size / rate
    try:
        twice = rerun_refined(scenario, beginning, 2, duration)
        first = _difference(T_d, twice, counted, rate)
        found = Accuracy(first.rms, first.line, first.name, False, own, False)
        if first.is_fine:
            return found
        second = _difference(twice, rerun_refined(scenario, beginning, 4, duration), counted, rate)
    except SimulationError:  # a finer run that stops where this one went on
        return Accuracy(1.0, 1.0, counted[0].name if counted else "", True, own, False)
    if first.rms > _DIVERGED_RMS or second.rms > _MAX_CONVERGENCE_RATIO * first.rms:
        worst = max(first, second, key=lambda one: one.line)
        return replace(
            found, rms=max(first.rms, second.rms), line=worst.line, name=worst.name, sensitive=True
        )
    return replace(found, refinement=(2 if second.is_fine else 4) * own, advised=True)


def can_be_refined(scenario: Scenario) -> bool:
    """Whether runs with finer steps, which tell the error of the integration, are possible."""
    return scenario.solver.refinement <= FINEST_ESTIMATED


def with_integration_error(table: LineTable, found: Accuracy | None) -> LineTable:
    """A table that knows how far it is off, so that a limit is judged by it; nan without an
    estimate.
    """
    own_error = math.nan if found is None else found.relative_error
    return replace(table, own_error=own_error, find_error=None)


def failed_invariants_reason(broken: Sequence[str], scenario: Scenario | None) -> str:
    """Why nothing that a motion shows is taken for known, and what to do: invariants that do not
    hold, by name; empty if all do.
    """
    if not broken:
        return ""
    if scenario is None:
        own = 1
    else:
        own = scenario.solver.refinement
    names = " and ".join(name.replace("_", " ") for name in dict.fromkeys(broken))
    if own <= FINEST_ESTIMATED:
        finer = f"solver.refinement={4 * own}"
    else:
        finer = "a smaller solver.accuracy"
    return f"the whole motion, because its {names} balance is violated (refine the steps: {finer})"


def add_error_estimate(solver: Mapping[str, Any], found: Accuracy | None) -> dict[str, Any]:
    """The solver's account with the estimate."""
    return {**solver, ERROR_ESTIMATE_KEY: None if found is None else asdict(found)}


def read_error_estimate(solver: Mapping[str, Any]) -> Accuracy | None:
    """The estimate that a solver's account holds."""
    known = solver.get(ERROR_ESTIMATE_KEY)
    if known is None:
        return None
    return Accuracy(**known)


def _significant_lines(table: LineTable) -> list[Line]:
    """Lines above the noise floor that persist."""
    seen = [x for x in table if x.status == "ok" and x.amplitude > 0.0]
    top = max((x.amplitude for x in seen), default=0.0)
    return [x for x in seen if x.amplitude >= MIN_LINE_RATIO * top]


class _Difference(NamedTuple):
    rms: float
    line: float
    name: str

    @property
    def is_fine(self) -> bool:
        """Whether two runs are one motion, with the same lines."""
        return self.line <= MAX_LINE_CHANGE and self.rms <= MAX_RMS_CHANGE


def _difference(
    T_d: np.ndarray, finer: np.ndarray, counted: list[Line], sample_rate: float
) -> _Difference:
    """The differences between two torques (n,) from the same state, and between their lines."""
    rms = float(np.sqrt(np.mean((T_d - finer) ** 2))) / (float(np.std(finer)) or 1.0)
    both = zip(
        counted,
        _amplitudes(T_d, counted, sample_rate),
        _amplitudes(finer, counted, sample_rate),
        strict=True,
    )
    changes = ((abs(a - b) / x.amplitude, x.name) for x, a, b in both)
    line, name = max(changes, key=lambda change: change[0], default=(0.0, ""))
    return _Difference(rms, line, name)


def _amplitudes(x: np.ndarray, counted: list[Line], sample_rate: float) -> list[float]:
    """Amplitudes at the lines' frequencies, with a Hann window; neighbours that it does not part
    are in both of two runs.
    """
    window = np.hanning(x.size + 2)[1:-1]
    size = (
        4 * x.size
    )  # so that a line is at most an eighth of a bin off, a hundredth of its amplitude
    spectrum = np.abs(np.fft.rfft((x - x.mean()) * window * (2.0 / window.sum()), size))
    return [float(spectrum[round(line.frequency / sample_rate * size)]) for line in counted]
