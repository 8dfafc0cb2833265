"""Rate planning: lines of the steady state over rate and microstep count, where they meet modes,
which rates to avoid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, groupby, pairwise
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from microvib.analysis.accuracy import failed_invariants_reason
from microvib.analysis.lines import Steady, steady_lines
from microvib.analysis.margins import (
    ABOVE_PASSBAND_FACTOR,
    GROWTH_FACTOR,
    SHARED_BINS_FACTOR,
    amplitude_bound,
    frequency_error_bound,
)
from microvib.analysis.noise import NOISE, changed_line_bounds, noise_bounds, noise_of_record
from microvib.analysis.other_states import slipping_reason, stirring
from microvib.analysis.start import (
    RecordGap,
    mode_has_decayed,
    record_gap,
    rounded_up,
    unseen_rates_gap,
)
from microvib.analysis.unseen import (
    OutOfBandLines,
    clock_line_bounds,
    nonlinear_torque_bounds,
    out_of_band_lines,
)
from microvib.errors import (
    OptionError,
    ScenarioError,
    SimulationError,
    expect_list,
    whole_number,
)
from microvib.model.commanded_torque import commanded_torque
from microvib.model.hub_edge import HubEdge, hub_edge
from microvib.model.line_names import (
    SECOND_DRIVE,
    driving_line,
    electrical_line,
    full_step_line,
    of_second_wing,
)
from microvib.model.linear import (
    CoupledMode,
    LinearLine,
    coupled_modes,
    disturbance_torque_response,
    linear_lines,
    matrices,
)
from microvib.model.other_hinge import OtherHinge, other_hinge, torque_at_other_interface
from microvib.model.parametric import decay_in_motion, parametric_resonances
from microvib.model.record import PASSBAND
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.results import FREQUENCY, MICROSTEPS, ORDER, RATE, TORQUE, Column, former_field
from microvib.signals.limit_curve import EVERYWHERE, Limit, LimitCurve
from microvib.signals.limit_curve import in_band as limit_in_band
from microvib.signals.line_table import BELOW_FLOOR, NOISE_DRIVEN, TWELFTH_OCTAVE, Line, LineTable
from microvib.solve.integration import Progress
from microvib.studies.workers import parallel_calls
from microvib.text_tables import counted
from microvib.units import Band, GivenQuantity, Si, quantity
from microvib.units import band as ends
from microvib.units import within_band as in_band

Solve = Callable[[Iterable[tuple[float, int, bool]]], list["RateCase"]]
"""Solves cases (rate, microsteps, whether a run from rest is waited for to its end)."""
HARMONICS = 8
MIN_LINE_RATIO = 1e-6
"""Lines below this fraction of a case's largest are dropped: rounding."""
MIN_RESONANCE_RATIO = 1e-3
"""Fraction of a case's largest line below which a line that meets a mode is no resonance."""
PARAMETRIC_SHIFTS = np.linspace(0.97, 1.03, 13)
"""Rates, over that at which the motor's stiffness varies at twice the frequency of a mode, at which a
plan looks for parametric resonance.
"""
_SAME_ORDER = 1e-4
"""Difference of two lines' orders, over them, within which they are one."""
MOST_ELECTRICAL_ORDERS = 16
"""Largest lines of a driver's errors that a plan takes to modes, up to as many driving lines."""
_OTHER_STANDS = "lines are those of each drive while the other one stands, and both step"
_RAISED = 2.0
"""Times that a mode of another state of the other wing's hinge raises a line that a plan looks at."""
MAX_RESONANCE_DAMPING = 0.2
"""Damping ratio above which a resonance of the drive can be ignored."""
FULL_STEPS = 4
"""Full steps of the motor that a plan records at least where there is no steady state, if that is
affordable."""
_SAME_RATE, _SAME_LINE = 1e-5, 1e-3
"""Parts by which rates differ that are one, and frequencies of what is one line."""
_EXACT_ORDER = 1e-6
"""Part by which the order of a steady state's line differs at most from the whole number that it is."""
REFINEMENTS = 4
"""Halvings of the step between two rates where a line comes near the limit."""
REFINED_NEAR = 3.0
"""Factor to the limit within which it does."""
REFINED_ABOVE = 0.02
"""Part of a rate below which a step is short."""
BISECTIONS = 8
"""Halvings of the step between two rates with which the edge of a forbidden band is found."""

ABOVE_LIMIT = "a line is above the limit"
HIDDEN_LINE = "unknown: a line hidden by the noise floor may exceed the limit"
ABOVE_PASSBAND = "not judged: lines above the passband may exceed the limit"
PART_OF_TIME = (
    "not judged: lines of a part of the time exceed the limit, as the drive changes slowly"
)
_IN_PIECES = "a line of a part of the time"
STEP_OF_LIMIT = (
    "not judged: a line stands where the limit changes, within what its frequency is known to"
)
OTHER_STATE = "not judged: a line may be above the limit, or below it, by the other wing"
ABOVE_HUB = "not judged: a line is above the frequency up to which the hub is known"
RECORD_GAP = "not judged: the record does not show all lines of tracking"
BEYOND_LINEAR_MODEL = (
    "not judged: what the linearised drive leaves out may put lines above the limit (a plan of the"
    " full model judges it)"
)
_SPRING_LOST = 0.01
"""Part of the electromagnetic spring up to which the linearised drive's lines leave out that it varies."""
_LINEAR_ERROR = 0.1
"""Part by which lines of the linearised drive may be larger by what is not linear, where its spring
varies by less than ``_SPRING_LOST``; assumed, twice the largest seen.
"""
NEAR_RESONANCE = "too close to a resonance:"


@dataclass(frozen=True)
class RateLine:
    """One line at one rate."""

    name: Annotated[str, Column("line")]
    kind: Annotated[str, Column("kind")]
    order: Annotated[float, Column("order", measure=ORDER)]
    """Frequency over the driving frequency."""
    frequency: Annotated[float, Column("frequency_hz", measure=FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", measure=TORQUE)]
    spread: Annotated[float, Column("spread_n_m", measure=TORQUE)] = field(
        default=math.nan, compare=False
    )
    """First-order change of the amplitude within the ranges that sources note
    (``microvib.analysis.spread``)."""
    away: float = 0.0
    """How far from its frequency [Hz] another line may lie that it stands for."""
    ratios: tuple[float, float] = (1.0, 1.0)
    """Least and largest amplitude over its own, over the states of the other wing's hinge."""
    stirred: float = 0.0
    """Change of it there, at most, by the changes of others [N m]."""

    @property
    def raised(self) -> float:
        """The amplitude to which the hinge raises it at most [N m]."""
        return self.amplitude * self.ratios[1]

    @property
    def most(self) -> float:
        """The largest amplitude that it may have in any of these states [N m]."""
        return self.raised + self.stirred

    @property
    def least(self) -> float:
        """The least [N m]."""
        return max(self.amplitude * self.ratios[0] - self.stirred, 0.0)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            return former_field(self, name, {"line": "name"})


@dataclass(frozen=True)
class RateCase:
    """Lines at one rate [rad/s] and microstep count.

    Where there is no steady state, ``reason`` says why and the lines are those of time integration,
    or none if it fails.
    """

    rate: float
    microsteps: int
    lines: tuple[RateLine, ...]
    reason: str = ""
    hidden: tuple[RateLine, ...] = ()
    """Lines of a time integration that a floor or what is beside them hides, with what they may
    have at most.
    """
    confirmed: bool = False
    """Whether a run from rest was waited for until it arrived at the steady state (``steady_state``,
    ``confirmed``).
    """
    shown: float = math.inf
    """Highest frequency [Hz] up to which lines were looked for; 0 for the linearised drive, which
    has driving lines only.
    """
    unseen: tuple[OutOfBandLines, ...] = field(default=(), compare=False, repr=False)
    """Lines of which nothing is seen, above ``shown``, with what they may have at most."""
    gap: RecordGap | None = None
    """Reason why its record does not show all lines of tracking."""
    edge: HubEdge | None = None
    """Where the model of the hub ends."""
    hinge: str = ""
    """States of the other wing's hinge, in which lines differ, and what to do; empty without one."""

    @property
    def failed(self) -> bool:
        """Whether nothing is known of it; a record that shows no line is not that."""
        return not self.lines and bool(self.reason)

    def rings(self, band: tuple[float, float]) -> bool:
        """Whether the largest line within ``band`` [Hz] is of no clock, in a time integration: the
        drive excites itself.
        """
        largest = self.largest(band)
        return bool(self.reason) and largest is not None and largest.kind == "other"

    def largest(
        self,
        band: tuple[float, float],
        hidden: bool = False,
        limit: float | LimitCurve | None = None,
    ) -> RateLine | None:
        """The largest line within ``band`` [Hz], or the largest that is ``hidden``; beside a
        ``limit`` over frequency that which is nearest to it, or farthest above. None if there is
        none.
        """
        curve = _curve_in(limit, band)
        inside = _lines_within(self.hidden if hidden else self.lines, curve)
        if curve.is_flat:
            return max(inside, key=lambda line: line.amplitude, default=None)
        return _nearest_to(inside, curve)

    def verdict(self, band: tuple[float, float], limit: float | LimitCurve) -> str:
        """Empty where all lines within ``band`` [Hz] are known to be below the ``limit``, one
        amplitude [N m] or a curve; else ``failed`` or why they are not.
        """
        if self.failed:
            return "failed"
        curve = _curve_in(limit, band)
        hidden = self.largest(band, hidden=True, limit=curve)
        overstated = 1.0 if self.gap is None else self.gap.overstated
        if self._is_above(curve, overstated):
            return ABOVE_LIMIT
        if hidden is not None and _exceeds(hidden, curve):
            return PART_OF_TIME if hidden.name == _IN_PIECES else HIDDEN_LINE
        if self.gap is not None:
            return RECORD_GAP
        if self._may_exceed_above_hub(curve):
            return ABOVE_HUB
        if why := self._above_in_some(curve):
            return why
        if not any(np.any(one.may_exceed(curve)) for one in self.unseen_in(band, curve)):
            return ""
        if self.shown > 0.0:
            return ABOVE_PASSBAND
        return BEYOND_LINEAR_MODEL

    def _is_above(self, curve: LimitCurve, overstated: float) -> bool:
        """Whether a line is above the most lenient limit within its frequency uncertainty."""
        inside = _lines_within(self.lines, curve)
        lenient = curve.most_lenient(*_ranges(inside))
        least = np.array([line.least for line in inside], dtype=float)
        least[self._above_hub(inside)] = 0.0
        return bool(np.any(least > overstated * lenient))

    def _above_hub(self, lines: Sequence[RateLine]) -> np.ndarray:
        """Which lines may be above the frequency up to which the hub is known, (k,)."""
        top = math.inf if self.edge is None else self.edge.frequency
        return np.asarray(_ranges(lines)[1] > top)

    def _may_exceed_above_hub(self, curve: LimitCurve) -> bool:
        """Whether a line there, seen or not, may be above a curve by what the hub's model lacks."""
        if self.edge is None:
            return False
        inside = _lines_within((*self.lines, *self.hidden), curve)
        most = self.edge.factor * np.array([line.most for line in inside], dtype=float)
        if np.any(self._above_hub(inside) & (most > curve.strictest(*_ranges(inside)))):
            return True
        raised = (one.above_hub(self.edge) for one in self.unseen)
        parts = (one.within(curve.low, curve.high) for one in raised)
        return any(np.any(part.may_exceed(curve)) for part in parts if part.frequency.size)

    def _above_in_some(self, curve: LimitCurve) -> str:
        """Why a line is not certainly above a curve, and not below it either; empty without one."""
        if any(line.least > _allowed(line, curve) for line in _lines_within(self.lines, curve)):
            return STEP_OF_LIMIT
        return OTHER_STATE if _exceeds(self.largest_in_states(curve), curve) else ""

    def largest_in_states(self, curve: LimitCurve) -> RateLine | None:
        """The line that is largest beside a curve in any state of the other wing's hinge, with its
        amplitude there; None without one.
        """
        inside = [replace(x, amplitude=x.most) for x in _lines_within(self.lines, curve)]
        return _nearest_to(inside, curve)

    def unseen_in(
        self, band: tuple[float, float], limit: float | LimitCurve | None = None
    ) -> list[OutOfBandLines]:
        """Bounds on unseen lines within ``band`` [Hz], and within the range of a ``limit``."""
        curve = _curve_in(limit, band)
        parts = (one.within(curve.low, curve.high) for one in self.unseen)
        return [part for part in parts if part.frequency.size]

    def largest_unseen(
        self, band: tuple[float, float], limit: float | LimitCurve | None = None
    ) -> RateLine | None:
        """Largest bound on unseen lines within ``band`` [Hz], or that which is farthest above a
        ``limit``; None if there is none.
        """
        curve = _curve_in(limit, band)
        found = [
            (float(over[k]), float(x.most[k]), float(x.frequency[k]), x.what)
            for x in self.unseen_in(band, curve)
            for over in [x.most / (1.0 if curve.is_flat else x.least_allowed(curve))]
            for k in [np.argmax(over)]
        ]
        if not found:
            return None
        _, most, frequency, what = max(found)
        return RateLine(f"{what} at {frequency:.4g} Hz", "unseen", math.nan, frequency, most)


def _curve_in(limit: float | LimitCurve | None, band: tuple[float, float]) -> LimitCurve:
    """A limit in a band; without one a curve that has its range and allows anything."""
    return limit_in_band(math.inf if limit is None else limit, band)


def _amplitudes(lines: Sequence[RateLine]) -> np.ndarray:
    """Amplitudes of lines [N m], (k,)."""
    return np.array([line.amplitude for line in lines], dtype=float)


def _places(lines: Sequence[RateLine]) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of lines [Hz] and how far from these they may be, (k,) each."""
    f = np.array([line.frequency for line in lines], dtype=float)
    away = np.array([line.away for line in lines], dtype=float)
    return f, np.maximum(frequency_error_bound(f), away)


def _ranges(lines: Sequence[RateLine]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest frequencies [Hz] that lines may have, (k,) each."""
    f, reach = _places(lines)
    return f - reach, f + reach


def _lines_within(lines: Sequence[RateLine], curve: LimitCurve) -> list[RateLine]:
    """Lines that may be in the range of a curve."""
    f, reach = _places(lines)
    inside = in_band(f, curve.low, curve.high, reach)
    return [line for line, kept in zip(lines, inside, strict=True) if kept]


def _nearest_to(lines: Sequence[RateLine], curve: LimitCurve) -> RateLine | None:
    """The first of the lines that are nearest to a curve, or farthest above it; None of none."""
    if not lines:
        return None
    parts = _amplitudes(lines) / curve.strictest(*_ranges(lines))
    return lines[int(np.argmax(parts))]


def _exceeds(line: RateLine | None, curve: LimitCurve) -> bool:
    """Whether there is a line and it is above the curve."""
    return line is not None and line.amplitude > _allowed(line, curve)


def _allowed(line: RateLine, curve: LimitCurve) -> float:
    """The strictest limit within a line's frequency uncertainty [N m]."""
    [allowed] = curve.strictest(*_ranges([line]))
    return float(allowed)


@dataclass(frozen=True)
class Resonance:
    """A rate at which a line of the clock coincides with a mode."""

    microsteps: Annotated[int, MICROSTEPS]
    rate: Annotated[float, Column("rate_deg_s", "rate", RATE)]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "line there", TORQUE)]
    """Amplitude of that line at the resonance [N m]; NaN where the case failed."""
    line: Annotated[str, Column("line", "line")]
    mode: Annotated[str, Column("mode", "mode")]
    mode_frequency: Annotated[float, Column("mode_hz", measure=FREQUENCY)]


@dataclass(frozen=True)
class Forbidden:
    """A band of rates in which a line passes the limit, which is too close to a resonance, or in
    which nothing is known because the simulation fails."""

    microsteps: Annotated[int, MICROSTEPS]
    low: Annotated[float, Column("from_deg_s", "from", RATE)]
    high: Annotated[float, Column("to_deg_s", "to", RATE)]
    largest: Annotated[float, Column("largest_n_m", "largest line", TORQUE)]
    line: Annotated[str, Column("line", "line")]
    why: Annotated[str, Column("why", "why")]


@dataclass(frozen=True)
class RatePlan:
    """Result of a plan; cases by microstep count and rate."""

    scenario: Scenario
    cases: tuple[RateCase, ...]
    modes: tuple[CoupledMode, ...]
    resonances: tuple[Resonance, ...]
    forbidden: tuple[Forbidden, ...]
    limit: float | None
    """Largest amplitude of a line [N m]; of a curve over frequency the least."""
    band: tuple[float, float]
    linear: bool
    keep_away: float = 0.0
    """Part of a resonance's rate that the best rate must be away from it, such as 0.05."""
    curve: LimitCurve | None = None
    """The limit over frequency; None where it is one amplitude."""

    @property
    def judged_by(self) -> float | LimitCurve | None:
        """The limit, one amplitude [N m] or a curve; None without one."""
        return self.limit if self.curve is None else self.curve

    def __repr__(self) -> str:
        rates = [math.degrees(case.rate) for case in self.cases]
        counts = ", ".join(str(count) for count in self.counts)
        rows = [
            f"Rate plan of {self.scenario.brief}",
            f"{counted(len(self.cases), 'case')} from {min(rates):.4g} to {max(rates):.4g} deg/s with {counts}"
            f" microsteps{', linearised' if self.linear else ''}",
            f"{counted(len(self.resonances), 'resonance')}, {counted(len(self.forbidden), 'forbidden band')} of rates",
            self._best_in_words(),
        ]
        return "\n  ".join(rows)

    def _best_in_words(self) -> str:
        best = self.best()
        if best is None:
            return "no rate is allowed"
        case, amplitude = best
        return (
            f"best rate {math.degrees(case.rate):.4g} deg/s with {case.microsteps} microsteps:"
            f" largest line {1e3 * amplitude:.4g} mN m"
        )

    def of(self, microsteps: int) -> list[RateCase]:
        """Cases of one microstep count, by rate."""
        return [case for case in self.cases if case.microsteps == microsteps]

    @property
    def counts(self) -> tuple[int, ...]:
        """Microstep counts, as planned."""
        return tuple(dict.fromkeys(case.microsteps for case in self.cases))

    def best(self, microsteps: int | None = None) -> tuple[RateCase, float] | None:
        """Case whose largest line is smallest, with that amplitude [N m], of those that are
        allowed; None if none is.
        """
        return self._smallest(case for case in self._solved(microsteps) if self.is_allowed(case))

    def least(self, microsteps: int | None = None) -> tuple[RateCase, float] | None:
        """Best of all cases, whether allowed or not; None where all failed."""
        return self._smallest(self._solved(microsteps))

    def widest_step(self) -> tuple[float, float]:
        """The largest distance between neighbouring rates, over the lower of them, and that distance
        [rad/s]; zeros of single rates.
        """
        steps = [
            (b.rate / a.rate - 1.0, b.rate - a.rate)
            for count in self.counts
            for a, b in pairwise(self.of(count))
        ]
        return max(steps, default=(0.0, 0.0))

    def is_allowed(self, case: RateCase) -> bool:
        """Whether a case has lines, none of them above the limit or hidden, and is far enough from
        every resonance.
        """
        near, limit = self.nearest(case), math.inf if self.judged_by is None else self.judged_by
        return not case.verdict(self.band, limit) and (near is None or near[1] >= self.keep_away)

    def nearest(self, case: RateCase) -> tuple[Resonance, float] | None:
        """The resonance nearest to a case, and how far its rate is away from it, over the
        resonance's.
        """
        found = [
            (r, abs(case.rate / r.rate - 1.0))
            for r in self.resonances
            if r.microsteps == case.microsteps
        ]
        return min(found, key=lambda item: item[1], default=None)

    def is_at_end(self, case: RateCase) -> bool:
        """Whether a case lies at the end of the range that was planned, beyond which nothing is
        known.
        """
        rates = [x.rate for x in self.of(case.microsteps)]
        return case.rate in (min(rates), max(rates))

    def _solved(self, microsteps: int | None) -> list[RateCase]:
        return [
            case for case in self.cases if not case.failed and microsteps in (None, case.microsteps)
        ]

    def _smallest(self, cases: Iterable[RateCase]) -> tuple[RateCase, float] | None:
        return min(
            ((case, self.top(case)) for case in cases),
            key=lambda item: item[1] / self.allowed_to(item[0]),
            default=None,
        )

    def governing(self, case: RateCase) -> RateLine | None:
        """The line of a case that is largest within the band, or with a limit over frequency nearest
        to it or farthest above, hidden ones with what they may have; None if there is none.
        """
        found = (
            case.largest(self.band, limit=self.curve),
            case.largest(self.band, hidden=True, limit=self.curve),
        )
        known = [line for line in found if line is not None]
        return max(known, key=lambda line: line.amplitude / self._allowed(line), default=None)

    def top(self, case: RateCase) -> float:
        """Amplitude [N m] of the ``governing`` line of a case; 0 without one."""
        line = self.governing(case)
        return 0.0 if line is None else line.amplitude

    def allowed_to(self, case: RateCase) -> float:
        """Amplitude that a limit over frequency allows to the ``governing`` line of a case [N m]; 1 where there
        is none, so that amplitudes are compared as they are.
        """
        line = self.governing(case)
        return 1.0 if line is None else self._allowed(line)

    def margin(self, case: RateCase) -> float:
        """Limit over amplitude of the ``governing`` line of a case; nan without a limit or a line."""
        top = self.top(case)
        if self.limit is None or not top > 0.0:
            return math.nan
        return (self.limit if self.curve is None else self.allowed_to(case)) / top

    def _allowed(self, line: RateLine) -> float:
        return 1.0 if self.curve is None else _allowed(line, limit_in_band(self.curve, self.band))

    def worst(self, microsteps: int) -> float:
        """Largest line over all rates of one microstep count [N m]; NaN where all cases failed."""
        found = [
            line.amplitude for case in self.of(microsteps) if (line := case.largest(self.band))
        ]
        return max(found, default=math.nan)


def plan_rates(  # noqa: PLR0913 - keyword options
    scenario: GivenScenario,
    rates: Sequence[GivenQuantity],
    microsteps: Sequence[int] | None = None,
    *,
    limit: GivenQuantity | Limit | None = None,
    band: Band | None = None,
    linear: bool = False,
    keep_away: float = 0.0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> RatePlan:
    """Find the steady lines at all rates of the array and microstep counts, and at every rate where
    a line meets a mode.

    Each case is solved independently, so that results do not depend on their order or on who solves
    them. A steady state beside a rate at which the drive excites itself (the largest line is of no
    clock) is suspicious: there a run from rest is waited for to its end, and the case is
    ``confirmed`` or becomes a time integration.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive: a scenario, a name of the catalog, or the path of a scenario file.
    rates : sequence of str or Si
        Rates of the array: those of a ``rate_grid``, or listed, such as ``["0.06 deg/s"]``.
    microsteps : sequence of int, optional
        Microsteps a full step; without it the scenario's.
    limit : str, Si or Limit, optional
        Largest amplitude of a line, such as ``"10 mN*m"``, or a limit over frequency of the torque
        about the drive axis: defines forbidden rates, whose edges are found by bisection.
    band : str or pair, optional
        Frequencies in which the limit holds, such as ``"0.5:150 Hz"``.
    linear : bool
        Use the closed form of the linearised drive instead (driving lines only).
    keep_away : float
        Part of its rate within which a resonance is too near, such as 0.05: defines forbidden
        rates, too.
    workers : int, optional
        Processes that solve cases; they start in a second, and want a script to guard its main part
        (``if __name__ == "__main__":``). Without it they are threads, which share one interpreter.
    progress : callable, optional
        Called as ``progress(done, total)``, with the number of cases.

    Returns
    -------
    RatePlan
        Cases by microstep count and rate, resonances, forbidden bands of rates, and the best rate.

    Raises
    ------
    OptionError
        For an empty list, and for a rate, count, limit or band that is none.
    ScenarioError
        Where a name stands for no scenario.
    """
    scenario = as_scenario(scenario)
    _check_linear(scenario, linear)
    grid, counts = rates_and_counts(scenario, rates, microsteps)
    within = (0.0, math.inf) if band is None else ends(band)
    most, curve = _limit_in(limit, within)
    if not 0.0 <= keep_away < 1.0:
        raise OptionError("keep_away", "must be at least 0 and below 100 percent", str(keep_away))
    asked = _Asked(scenario, grid, counts, most, within, linear, keep_away)
    solve_case = linear_case if linear else full_case
    with parallel_calls(progress, workers) as calls:

        def solve(wanted: Iterable[tuple[float, int, bool]]) -> list[RateCase]:
            return calls(
                solve_case, ((scenario, Si(rate), n, confirmed) for rate, n, confirmed in wanted)
            )

        rows, resonances = _solved_rows(asked, solve)
        forbidden = []
        if most is not None:
            forbidden = [b for row in rows for b in _forbidden(row, most, within, solve)]
    if keep_away > 0.0:
        forbidden += [_too_near(resonance, keep_away) for resonance in resonances]
    return RatePlan(
        scenario,
        tuple(chain.from_iterable(rows)),
        tuple(mode for mode in coupled_modes(scenario) if _may_resonate(mode)),
        resonances,
        tuple(forbidden),
        most.least if isinstance(most, LimitCurve) else most,
        within,
        linear,
        keep_away,
        curve,
    )


class _Asked(NamedTuple):
    """Question that a plan answers."""

    scenario: Scenario
    grid: list[Si]
    counts: tuple[int, ...]
    limit: float | LimitCurve | None
    band: tuple[float, float]
    linear: bool
    keep_away: float


def _solved_rows(asked: _Asked, solve: Solve) -> tuple[list[list[RateCase]], tuple[Resonance, ...]]:
    """Cases of each microstep count by rate, and the resonances that they show."""
    low, high = min(asked.grid), max(asked.grid)
    # a resonance just beyond the range may be too near to a rate at its end
    reach = low / (1.0 + asked.keep_away), high / (1.0 - asked.keep_away)
    crossings = [
        x for count in asked.counts for x in _resonance_crossings(asked.scenario, count, reach)
    ]
    wanted, beyond = _wanted_cases(asked.grid, asked.counts, crossings)
    found = _solved_cases(wanted | beyond, asked.band, solve)
    swept = _modes_to_solve(asked, found)
    at_modes = {(rate, x.microsteps) for x in swept for rate in x.rates}
    found |= _solved_cases(at_modes - set(found), asked.band, solve)
    wanted |= {key for key in at_modes if low <= key[0] <= high}
    if not asked.linear and asked.limit is not None:
        wanted |= _refine(found, wanted, (asked.limit, asked.band), solve)
    rows = [[found[key] for key in sorted(wanted) if key[1] == count] for count in asked.counts]
    at_swept = _swept_resonances(swept, found, asked.limit, asked.band)
    return rows, (*_resonances(crossings, found), *at_swept)


def _modes_to_solve(asked: _Asked, found: dict[tuple[float, int], RateCase]) -> list[_SweptMode]:
    """Modes between the rates of cases at which lines of any order may decide a verdict."""
    if asked.linear or (asked.limit is None and asked.keep_away == 0.0):
        return []
    return list(_swept_modes(asked.scenario, found.values(), asked.limit, asked.band))


def _limit_in(
    given: GivenQuantity | Limit | None, within: tuple[float, float]
) -> tuple[float | LimitCurve | None, LimitCurve | None]:
    """Limit that a plan judges by, and the curve over frequency that it is; of a limit that is one number, the
    number."""
    if given is None:
        return None, None
    if not isinstance(given, Limit):
        return quantity("limit", given, "N*m", positive=True), None
    curve = given.torque_curve("a plan of rates")
    if given.is_one_number and (curve.low, curve.high) == EVERYWHERE:
        return curve.least, None
    part = limit_in_band(curve, within)
    return part, part


def _check_linear(scenario: Scenario, linear: bool) -> None:
    """OptionError for a drive without a linearised one, or whose lines that does not give."""
    if scenario.driver.pulsed and linear:
        raise OptionError(
            "linear",
            "is not known of driver.drive: pulse, between whose pulses nothing pulls; leave it out",
        )
    if scenario.driver.compensates and linear:
        raise OptionError(
            "linear",
            "does not know how driver.compensation spreads the driving lines; leave it out",
        )


def rates_and_counts(
    scenario: Scenario, rates: Sequence[GivenQuantity], microsteps: Sequence[int] | None
) -> tuple[list[Si], tuple[int, ...]]:
    """Rates [rad/s] and microstep counts of a plan; OptionError."""
    expect_list(rates, "rates", "['0.06 deg/s']")
    expect_list(() if microsteps is None else microsteps, "microsteps", "[16, 32]")
    grid = [quantity("rates", rate, "rad/s", example="deg/s") for rate in rates]
    if microsteps is None:
        microsteps = (scenario.driver.microsteps,)
    counts = tuple(whole_number("microsteps", count, 1, 65_536) for count in microsteps)
    for key, given in {"rates": grid, "microsteps": counts}.items():
        if not given:
            raise OptionError(key, "the list is empty; at least one is expected")
    return grid, counts


def _wanted_cases(
    grid: Sequence[Si], counts: Iterable[int], crossings: Iterable[_Crossing]
) -> tuple[set[tuple[float, int]], set[tuple[float, int]]]:
    """Rates [rad/s] and microstep counts of the plan's cases: those of the grid and about the
    resonances in its range; and those about resonances just beyond.
    """
    wanted = {(float(rate), count) for count in counts for rate in grid}
    at_modes = {(rate, x.resonance.microsteps) for x in crossings for rate in x.rates}
    inside = {key for key in at_modes if min(grid) <= key[0] <= max(grid)}
    return wanted | inside, at_modes - inside


def _refine(
    found: dict[tuple[float, int], RateCase],
    wanted: set[tuple[float, int]],
    bound: tuple[float | LimitCurve, tuple[float, float]],
    solve: Solve,
) -> set[tuple[float, int]]:
    """Rates that are added between those of the plan where a line comes near the limit, which are
    ``found``, too; ``bound`` are limit [N m] and band [Hz].

    The frequency of a resonance may fall as its amplitude rises, so that it is largest beside the
    rate at which a line meets the mode of the linearised drive. Intervals are halved at whose ends no
    line is above the limit and at one of which a line is near it, until they are short.
    """
    (limit, band), added = bound, set[tuple[float, int]]()
    for _ in range(REFINEMENTS):
        cases = sorted((found[key] for key in wanted | added), key=lambda x: (x.microsteps, x.rate))
        middles = [
            (0.5 * (a.rate + b.rate), a.microsteps, False)
            for a, b in pairwise(cases)
            if a.microsteps == b.microsteps
            and b.rate - a.rate > REFINED_ABOVE * a.rate
            and not a.verdict(band, limit)
            and not b.verdict(band, limit)
            and max(_part(a, band, limit), _part(b, band, limit)) * REFINED_NEAR > 1.0
        ]
        if not middles:
            break
        new = {(case.rate, case.microsteps): case for case in solve(middles)}
        found |= new
        added |= set(new)
    return added


def _part(case: RateCase, band: tuple[float, float], limit: float | LimitCurve) -> float:
    """Part of a limit that the largest line of a case in the band has, 0 without one."""
    curve = _curve_in(limit, band)
    line = case.largest_in_states(curve)
    return 0.0 if line is None else line.amplitude / _allowed(line, curve)


class _SweptMode(NamedTuple):
    """A mode that a line of the plan's cases passes between two of their rates."""

    microsteps: int
    order: float
    """Frequency of the line over the rate [Hz s/rad]."""
    mode: CoupledMode
    rates: list[float]
    """At which the plan looks."""


def _swept_modes(
    scenario: Scenario,
    cases: Iterable[RateCase],
    limit: float | LimitCurve | None,
    band: tuple[float, float],
) -> Iterator[_SweptMode]:
    """Modes that lines of any order pass between two rates, where a line may come near the limit.

    How large a line is on the mode follows from what it is at the neighbouring rate and from the
    linearised drive's response at both frequencies.
    """
    modes, on_modes = _modes_and_responses(scenario)
    ordered = sorted(cases, key=lambda case: (case.microsteps, case.rate))
    expected = {id(case): _Expected.of(case, scenario) for case in ordered}
    seen = set[tuple[int, str, float]]()
    for a, b in pairwise(ordered):
        if a.microsteps != b.microsteps:
            continue
        for case in (a, b):
            for mode, response in zip(modes, on_modes.tolist(), strict=True):
                for line in expected[id(case)].passing(mode, response, (a.rate, b.rate)):
                    order = line.frequency / case.rate
                    at_mode = replace(line, frequency=mode.frequency)
                    key = (a.microsteps, mode.name, round(math.log(order), 6))
                    if key in seen or not _may_matter(at_mode, case, limit, band):
                        continue
                    seen.add(key)
                    examined = _rates_to_examine(mode.frequency / order, mode)
                    yield _SweptMode(a.microsteps, order, mode, examined)


def _modes_and_responses(scenario: Scenario) -> tuple[list[CoupledMode], np.ndarray]:
    """Modes that may resonate in any state of another wing's hinge, and T_d by a torque of 1 on the rotor at
    each, (m,).
    """
    known, hinge = coupled_modes(scenario), other_hinge(scenario)
    modes = [mode for mode in (*known, *_modes_of_hinge(hinge, known)) if _may_resonate(mode)]
    at = np.array([mode.frequency for mode in modes])
    raised = np.ones(at.size) if hinge is None else hinge.ratios(at, at)[1]
    return modes, raised * (_responses(scenario, at) if modes else 1.0)


class _Expected(NamedTuple):
    """Lines of a case with what they have over the linearised drive's response."""

    rate: float
    lines: list[RateLine]
    per_hertz: np.ndarray
    """Rate over the frequency of each, (n,)."""
    pull: np.ndarray
    """Torque on the rotor that would make each by the linearised drive [N m], (n,)."""

    @classmethod
    def of(cls, case: RateCase, scenario: Scenario) -> _Expected:
        """Take a case's lines; what the floor of a run in time hides is none."""
        lines = [*case.lines, *(() if case.reason else case.hidden)]
        f = np.array([line.frequency for line in lines])
        amplitude = np.array([line.amplitude for line in lines])
        return cls(case.rate, lines, case.rate / f, amplitude / _responses(scenario, f))

    def passing(
        self, mode: CoupledMode, response: float, rates: tuple[float, float]
    ) -> Iterator[RateLine]:
        """Lines that meet a mode between two rates [rad/s], each with the amplitude that is expected
        where the drive has this ``response``.
        """
        low, high = rates[0] * (1.0 + _SAME_RATE), rates[1] * (1.0 - _SAME_RATE)
        met = self.per_hertz[:, None] * np.array(_rates_to_examine(mode.frequency, mode))
        for k in np.flatnonzero(np.any((met > low) & (met < high), axis=1)).tolist():
            yield replace(self.lines[k], amplitude=float(self.pull[k]) * response)


def _responses(scenario: Scenario, frequency: Sequence[float] | np.ndarray) -> np.ndarray:
    """T_d by a torque of 1 on the rotor, by the linearised drive, at each ``frequency`` (m,) [Hz]."""
    of_rotor = np.eye(matrices(scenario)[0].shape[0])[0]
    return disturbance_torque_response(scenario, np.asarray(frequency, dtype=float), of_rotor)


def _may_matter(
    line: RateLine, case: RateCase, limit: float | LimitCurve | None, band: tuple[float, float]
) -> bool:
    """Whether a line that is expected comes near the limit, or without one near the largest of its case."""
    curve = _curve_in(limit, band)
    if not _lines_within([line], curve):
        return False
    if limit is None:
        largest = case.largest(band)
        most = 0.0 if largest is None else largest.amplitude
    else:
        most = _allowed(line, curve)
    return line.amplitude * REFINED_NEAR > most


def _swept_resonances(
    swept: Iterable[_SweptMode],
    found: dict[tuple[float, int], RateCase],
    limit: float | LimitCurve | None,
    band: tuple[float, float],
) -> Iterator[Resonance]:
    """The modes swept on which the line does come near the limit, at the strongest of their rates."""
    for one in swept:
        cases = [found[rate, one.microsteps] for rate in one.rates]
        there = [
            (line, case)
            for case in cases
            for line in case.lines
            if abs(line.frequency / (one.order * case.rate) - 1.0) < _SAME_LINE
        ]
        if not there:
            continue
        line, case = max(there, key=lambda item: item[0].raised)
        if _may_matter(replace(line, amplitude=line.raised), case, limit, band):
            f = one.mode.frequency
            yield Resonance(
                one.microsteps,
                case.rate,
                line.frequency,
                line.raised,
                line.name,
                one.mode.name,
                f,
            )


def _may_resonate(mode: CoupledMode) -> bool:
    """Whether a mode of the array, or one of the drive that is not damped too much for that."""
    return mode.fixed_frequency is not None or mode.damping < MAX_RESONANCE_DAMPING


def _solved_cases(
    wanted: Iterable[tuple[float, int]], band: tuple[float, float], solve: Solve
) -> dict[tuple[float, int], RateCase]:
    """Cases by rate and microstep count, those beside a drive that excites itself confirmed."""
    found = {
        (case.rate, case.microsteps): case
        for case in solve((*key, False) for key in sorted(wanted))
    }
    while suspicious := _unconfirmed_cases(found.values(), band):
        confirmed = solve((case.rate, case.microsteps, True) for case in suspicious)
        found |= {(case.rate, case.microsteps): case for case in confirmed}
    return found


def _resonances(
    crossings: Iterable[_Crossing],
    found: dict[tuple[float, int], RateCase],
) -> tuple[Resonance, ...]:
    """The crossings at which a line is large enough, each at the strongest of its rates."""
    strongest = (
        _strongest_crossing(resonance, [found[rate, resonance.microsteps] for rate in examined])
        for resonance, examined in crossings
    )
    return tuple(resonance for resonance in strongest if resonance is not None)


def _too_near(resonance: Resonance, keep_away: float) -> Forbidden:
    """The band within ``keep_away`` of a resonance, a part of its rate."""
    return Forbidden(
        resonance.microsteps,
        resonance.rate * (1.0 - keep_away),
        resonance.rate * (1.0 + keep_away),
        resonance.amplitude,
        resonance.line,
        f"{NEAR_RESONANCE} {resonance.line} on {resonance.mode}",
    )


def at_rate(scenario: Scenario, rate: GivenQuantity, microsteps: int) -> Scenario:
    """``scenario`` at a constant rate with another microstep count."""
    tracking = {
        "rate": quantity("rate", rate, "rad/s", example="deg/s"),
        "clock_ratio": scenario.tracking.clock_ratio,
    }
    return scenario.with_si({"tracking": tracking, "driver.microsteps": microsteps})


def _case_at(scenario: Scenario, rate: Si, microsteps: int) -> Scenario | RateCase:
    """``at_rate``; where microsteps follow too quickly for their parts, a case that says so."""
    try:
        return at_rate(scenario, rate, microsteps)
    except ScenarioError as why:
        if not scenario.driver.microstep_shape:
            raise
        return RateCase(rate, microsteps, (), str(why))


def full_case(scenario: Scenario, rate: Si, microsteps: int, confirmed: bool = False) -> RateCase:
    """One case with the full model, its steady state ``confirmed`` by a run from rest that is
    waited for to its end.

    Where a second wing is driven, lines of both drives.
    """
    changed = _case_at(scenario, rate, microsteps)
    if isinstance(changed, RateCase):
        return changed
    first = _in_other_states(_full_case(changed, rate, microsteps, confirmed), other_hinge(changed))
    first = _if_it_slips(first, changed)
    other = changed.driven_wing
    if other is None:
        return first
    if other.rate == 0.0:
        return replace(first, gap=first.gap or unseen_rates_gap(other.alone))
    second = _full_case(other.alone, rate, microsteps, confirmed)
    second = _in_other_states(second, other_hinge(other, first=False))
    return _combine_drives(
        _with_other_stepping(first, second, other.alone),
        _with_other_stepping(second, first, changed),
    )


def _in_other_states(case: RateCase, hinge: OtherHinge | None) -> RateCase:
    """A case with what its lines may be in other states of the other wing's ``hinge``; what is hidden
    or bounded by a model is as large as it may be there.
    """
    if hinge is None or case.failed:
        return case
    lines = _with_ratios(case.lines, hinge)
    stirred = max((x.stirred for x in lines), default=0.0)
    of_hidden = _with_ratios(case.hidden, hinge)
    hidden = (
        replace(x, amplitude=x.raised + stirred, ratios=(1.0, 1.0), stirred=0.0) for x in of_hidden
    )
    unseen = case.unseen
    if case.shown == 0.0:  # above a passband the hinge changes next to nothing
        unseen = tuple(
            replace(x, most=x.most * hinge.ratios(x.frequency, x.frequency)[1]) for x in unseen
        )
    return replace(case, lines=lines, hidden=tuple(hidden), unseen=unseen, hinge=hinge.gap)


def _with_other_stepping(case: RateCase, other: RateCase, scenario: Scenario) -> RateCase:
    """A case of a drive with what the lines of the ``other``, whose drive the ``scenario`` is, add about its
    axis where both step.
    """
    if case.failed or other.failed or not other.lines:
        return case
    at, _ = _places(other.lines)
    added = _amplitudes(other.lines) * torque_at_other_interface(scenario, at)
    f, _ = _places(case.lines)
    same = np.abs(f[:, None] - at) <= _SAME_LINE * at
    lines = tuple(
        replace(line, stirred=line.stirred + float(more))
        for line, more in zip(case.lines, same @ added, strict=True)
    )
    alone = [
        replace(line, name=f"{line.name} of the other drive", amplitude=float(size))
        for line, size, has in zip(other.lines, added, same.any(axis=0), strict=True)
        if not has
    ]
    return replace(
        case,
        lines=lines,
        hidden=(*case.hidden, *alone),
        hinge="; ".join(filter(None, (case.hinge, _OTHER_STANDS))),
    )


def _if_it_slips(case: RateCase, changed: Scenario) -> RateCase:
    """A case whose lines decide nothing where a second wing's shaft that is locked may slip."""
    at, _ = _places(case.lines)
    why = slipping_reason(changed, at.tolist(), _amplitudes(case.lines))
    if case.failed or not why:
        return case
    return replace(case, gap=RecordGap(why, turns=True, overstated=math.inf))


def _with_ratios(lines: Sequence[RateLine], hinge: OtherHinge) -> tuple[RateLine, ...]:
    """Lines with their ratios within the uncertainty of their frequencies."""
    f, reach = _places(lines)
    near = np.where(np.isfinite(reach), reach, 0.0)
    ratios = hinge.ratios(f - near, f + near)
    beside = stirring(_amplitudes(lines), ratios)
    return tuple(
        replace(line, ratios=(float(a), float(b)), stirred=float(c))
        for line, a, b, c in zip(lines, *ratios, beside, strict=True)
    )


def _full_case(changed: Scenario, rate: Si, microsteps: int, confirmed: bool) -> RateCase:
    """Solve the drive of a scenario at its own rate; ``rate`` and ``microsteps`` are those of the
    plan.
    """
    try:
        result = steady_lines(
            changed, harmonics=HARMONICS, confirmed=confirmed, full_steps=FULL_STEPS
        )
    except SimulationError as why:  # loss of synchronism, for one
        return RateCase(rate, microsteps, (), str(why))
    gap = record_gap(changed, result.lines.duration, steady=not result.fallback)
    if gap is not None and not gap.turns:
        return RateCase(rate, microsteps, (), gap.why)
    if broken := failed_invariants_reason(result.lines.broken, changed):
        return RateCase(rate, microsteps, (), broken)
    seen = [
        x for x in result.lines if not x.is_mode and x.status != BELOW_FLOOR and x.amplitude > 0.0
    ]
    shown = PASSBAND * result.lines.sample_rate
    lines = _without_rounding(seen, changed.driving_frequency or math.nan)
    if not result.fallback:
        full_step = changed.motor.full_steps / (changed.driver.beats * changed.driver.microsteps)
        lines = tuple(_named_by_order(line, full_step) for line in lines)
    return RateCase(
        rate,
        microsteps,
        lines,
        result.fallback,
        (*_hidden(changed, result, seen), *_noise_bounds(changed, result.lines)),
        confirmed and not result.fallback,
        shown,
        tuple(out_of_band_lines(changed, result.lines, shown, math.inf)),
        gap,
        hub_edge(changed),
    )


def _without_rounding(seen: Sequence[Line], driving_frequency: float) -> tuple[RateLine, ...]:
    """The lines that are not smaller than rounding beside the largest."""
    top = max((x.amplitude for x in seen), default=0.0)
    return tuple(
        RateLine(
            x.name, x.kind, x.frequency / driving_frequency, x.frequency, x.amplitude, x.spread
        )
        for x in seen
        if x.amplitude >= MIN_LINE_RATIO * top
    )


def _named_by_order(line: RateLine, full_step_order: float) -> RateLine:
    """A line of a steady state without a name, called by its order where that is one of the step clock's."""
    if line.kind != "other":
        return line
    for unit, kind, name in (
        (1.0, "drive", driving_line),
        (full_step_order, "full step", full_step_line),
    ):
        k = round(line.order / unit)
        if k and abs(line.order - k * unit) < _EXACT_ORDER * line.order:
            return replace(line, name=name(k), kind=kind)
    return line


def _hidden(scenario: Scenario, found: Steady, seen: Sequence[Line]) -> Iterator[RateLine]:
    """Lines up to the passband without a figure of their own, with what they may have at most in
    the steady state: those that are not ``seen``, modes that a run in time leaves ringing, and what
    no line accounts for."""
    f_d = scenario.driving_frequency or math.nan
    if found.fallback:
        yield from _not_seen(scenario, found.lines, seen)
    if (pieces := found.lines.pieces) is not None:
        for f, most in zip(pieces.frequency.tolist(), pieces.amplitude.tolist(), strict=True):
            yield RateLine(_IN_PIECES, "other", f / f_d, f, most, away=TWELFTH_OCTAVE * f)
    if (rest := found.lines.rest) is None:
        return
    for f, amplitude in zip(rest.frequency.tolist(), rest.amplitude.tolist(), strict=True):
        if amplitude > 0.0:
            yield RateLine(
                "an unexplained peak",
                "other",
                f / f_d,
                f,
                rest.factor * amplitude,
                away=TWELFTH_OCTAVE * f,
            )
    if rest.slow > 0.0:
        for f in np.geomspace(1e-3, 1.0, 31) * rest.frequency.min(initial=math.inf):
            yield RateLine(
                "lines that the record is too short to resolve",
                "other",
                f / f_d,
                float(f),
                ABOVE_PASSBAND_FACTOR * rest.slow,
            )


def _noise_bounds(scenario: Scenario, table: LineTable | None) -> Iterator[RateLine]:
    """Upper bounds of what noise of the friction makes, in other draws than that of the ``table``,
    too; none in a steady state.
    """
    if table is not None and noise_of_record(scenario, table) is None:
        return
    duration = scenario.record.duration if table is None else table.duration
    direct = noise_bounds(scenario, duration)
    found = list(zip(direct.frequency.tolist(), direct.amplitude.tolist(), strict=True))
    if table is not None:
        found += changed_line_bounds(table, scenario)
    f_d = scenario.driving_frequency or math.nan
    for f, most in found:
        yield RateLine(NOISE, "other", f / f_d, f, most, away=TWELFTH_OCTAVE * f)


def _not_seen(scenario: Scenario, table: LineTable, seen: Sequence[Line]) -> Iterator[RateLine]:
    """Lines of a run in time that are not ``seen`` and may last."""
    f_d = scenario.driving_frequency or math.nan
    for x in table:
        if x.status == "growing":  # nothing bounds its multiples, wherever they are
            what = f"lines caused by {x.name} while it grows"
            most = GROWTH_FACTOR * x.amplitude
            yield RateLine(what, "other", x.place / f_d, x.place, most, away=math.inf)
        if x in seen:
            continue
        most = _mode_amplitude_bound(x, table.duration) if x.is_mode else amplitude_bound(x)
        if most > 0.0 and not mode_has_decayed(x, scenario):
            yield RateLine(x.name, x.kind, x.place / f_d, x.place, most)


def _mode_amplitude_bound(x: Line, duration: float) -> float:
    """Upper bound [N m] on what remains of a mode in a record of ``duration`` [s]: for a decaying one, its amplitude at the end."""
    if x.status == "growing":
        return math.inf
    if x.status == NOISE_DRIVEN:
        return max(x.amplitude, _NOISE_QUANTILE_FACTOR * x.noise_p95)
    if not math.isfinite(x.amplitude):
        return amplitude_bound(x)
    if x.status == "decaying":
        return x.amplitude_at_start(duration) * math.exp(-x.decay * duration)
    return SHARED_BINS_FACTOR * x.amplitude  # what lasts there, and what rings against it


_NOISE_QUANTILE_FACTOR = 2.0
"""Times the 95 % quantile of a line that noise drives, which one in 10^5 draws exceeds."""


def linear_case(scenario: Scenario, rate: Si, microsteps: int, confirmed: bool = False) -> RateCase:
    """One case with the linearised drive, of which there is nothing to be ``confirmed``."""
    changed = _case_at(scenario, rate, microsteps)
    if isinstance(changed, RateCase):
        return changed
    first = _in_other_states(_linear_case(changed, rate, microsteps), other_hinge(changed))
    first = _if_it_slips(first, changed)
    other = changed.driven_wing
    if other is None:
        return first
    if other.rate == 0.0:
        return replace(first, gap=unseen_rates_gap(other.alone))
    second = _linear_case(other.alone, rate, microsteps)
    second = _in_other_states(second, other_hinge(other, first=False))
    return _combine_drives(
        _with_other_stepping(first, second, other.alone),
        _with_other_stepping(second, first, changed),
    )


def _linear_case(changed: Scenario, rate: Si, microsteps: int) -> RateCase:
    """As ``_full_case``."""
    found = linear_lines(changed, HARMONICS)
    spring_lost = _spring_lost(changed, found)
    amplitudes = _with_weaker_spring(changed, found, spring_lost)
    lines = tuple(
        RateLine(driving_line(x.order), "drive", float(x.order), x.frequency, largest)
        for x, largest in zip(found, amplitudes, strict=True)
    )
    most = (1.0 + _LINEAR_ERROR) * np.array(amplitudes)
    at = np.array([x.frequency for x in found])
    others = (
        OutOfBandLines(
            "driving lines by the error of the linearised drive", at, most, np.zeros_like(at)
        ),
        *clock_line_bounds(changed, 0.0, math.inf, known=HARMONICS),
        *nonlinear_torque_bounds(changed, 0.0, math.inf),
    )
    hidden = tuple(_noise_bounds(changed, None))
    gap = _linear_gap(spring_lost)
    return RateCase(
        rate,
        microsteps,
        lines,
        hidden=hidden,
        shown=0.0,
        unseen=others,
        gap=gap,
        edge=hub_edge(changed),
    )


def _spring_lost(changed: Scenario, lines: Sequence[LinearLine]) -> float:
    """Part by which the electromagnetic spring of a drive is at times weaker than in the linearised one:
    the rotor swings about the field, and currents that go straight from one reference to the next
    lack of the circle.
    """
    by_swing = 0.25 * sum(abs(x.deviation) ** 2 for x in lines)
    if changed.driver.microstep_ramp == 0.0:
        return by_swing
    step = changed.motor.rotor_teeth * changed.driver.microstep(changed.motor)
    return by_swing + 1.0 - math.cos(0.5 * step)


def _linear_gap(spring_lost: float) -> RecordGap | None:
    """Reason why a linearised drive's lines decide nothing, as its spring is not constant; None where
    it is.
    """
    if spring_lost <= _SPRING_LOST:
        return None
    return RecordGap(
        f"the drive is not linear: by its swing and its microsteps the electromagnetic spring varies by"
        f" {100.0 * spring_lost:.2g} %, and at most {100.0 * _SPRING_LOST:.2g} % are left out (a plan of"
        " the full model judges it)",
        turns=True,
        overstated=math.inf,
    )


def _with_weaker_spring(
    changed: Scenario, lines: Sequence[LinearLine], spring_lost: float
) -> list[float]:
    """Amplitudes of a linearised drive's lines, or those with the weaker spring if they are larger:
    beside a mode little moves them.
    """
    current = max(1.0 - spring_lost, 1.0 - _SPRING_LOST) * changed.motor.current
    weaker = linear_lines(changed.with_si({"motor.current": current}), HARMONICS)
    pairs = zip(lines, weaker, strict=True)
    return [max(abs(a.amplitude), abs(b.amplitude)) for a, b in pairs]


def _combine_drives(first: RateCase, second: RateCase) -> RateCase:
    """A case of two drives on one craft, the second's lines called so; nothing is known where one
    of them failed.
    """
    for case, whose in ((first, ""), (second, f"{SECOND_DRIVE}: ")):
        if case.failed:
            return replace(first, lines=(), hidden=(), unseen=(), reason=f"{whose}{case.reason}")

    def called(lines: Iterable[RateLine]) -> tuple[RateLine, ...]:
        return tuple(replace(x, name=of_second_wing(x.name)) for x in lines)

    reasons = [first.reason] if first.reason else []
    if second.reason:
        reasons.append(f"{SECOND_DRIVE}: {second.reason}")
    return replace(
        first,
        lines=(*first.lines, *called(second.lines)),
        reason="; ".join(reasons),
        hidden=(*first.hidden, *called(second.hidden)),
        confirmed=first.confirmed and second.confirmed,
        shown=min(first.shown, second.shown),
        unseen=(
            *first.unseen,
            *(replace(x, what=f"{SECOND_DRIVE}, {x.what}") for x in second.unseen),
        ),
        gap=first.gap or second.gap,
        hinge=first.hinge or second.hinge,
    )


def linear_error(plan: RatePlan, count: int = 5) -> dict[int, tuple[float, float, int]]:
    """Error of a linear plan's drive_1 to drive_3 against the full model at ``count`` rates of each
    microstep count.

    Median and largest ``|linear/full - 1|``, and how many lines were compared.
    """
    result = {}
    for n in plan.counts:
        cases, errors = plan.of(n), []
        for k in np.unique(np.linspace(0, len(cases) - 1, count).astype(int)):
            full = {
                x.name: x.amplitude for x in full_case(plan.scenario, Si(cases[k].rate), n).lines
            }
            errors += [
                abs(x.amplitude / full[x.name] - 1.0) for x in cases[k].lines[:3] if x.name in full
            ]
        values = errors or [math.nan]
        result[n] = (float(np.median(values)), float(np.max(values)), len(errors))
    return result


class _Crossing(NamedTuple):
    """Where a line of one drive meets a mode."""

    resonance: Resonance
    rates: list[float]
    """At which the plan looks."""


def _resonance_crossings(
    scenario: Scenario, microsteps: int, span: tuple[float, float]
) -> Iterator[_Crossing]:
    """Rates within a range at which lines of either drive meet a mode."""
    slowest = at_rate(scenario, Si(span[0]), microsteps)
    modes = coupled_modes(scenario)
    beside = _modes_of_hinge(other_hinge(slowest), modes)
    yield from _crossings_of_drive(slowest.alone, microsteps, span, (*modes, *beside), "")
    second = slowest.driven_wing
    if second is None or not second.rate or _second_has_own_rate(scenario):
        return
    own = coupled_modes(second.alone)
    if len(own) == len(modes):  # the same modes, by the names that they have on the first drive
        ours, theirs = (sorted(each, key=lambda m: m.frequency) for each in (modes, own))
        own = tuple(replace(b, name=a.name) for a, b in zip(ours, theirs, strict=True))
    beside = _modes_of_hinge(other_hinge(second, first=False), own)
    theirs_too = (*own, *beside)
    yield from _crossings_of_drive(second.alone, microsteps, span, theirs_too, f"{SECOND_DRIVE} ")


def _modes_of_hinge(
    hinge: OtherHinge | None, known: Sequence[CoupledMode]
) -> tuple[CoupledMode, ...]:
    """Modes of a craft in other states of the other wing's hinge that raise a line."""
    return () if hinge is None else tuple(hinge.modes(known, _RAISED))


def _second_has_own_rate(scenario: Scenario) -> bool:
    """Whether the second wing's lines stay where they are, whatever the plan's rate is."""
    wing = None if scenario.spacecraft is None else scenario.spacecraft.second_wing
    return wing is not None and wing.tracking is not None


def _crossings_of_drive(
    drive: Scenario,
    microsteps: int,
    span: tuple[float, float],
    modes: Sequence[CoupledMode],
    prefix: str,
) -> Iterator[_Crossing]:
    """Where driving and full-step lines of a ``drive``, and those of its gears' errors, meet modes.

    ``span`` are the ends of the range of rates, at the first of which the drive is, and
    ``microsteps`` the plan's, which a second drive need not share. Lines are called with ``prefix``.
    """
    low, high = span
    per_rate = (drive.driving_frequency or 0.0) / low
    orders = _orders_of_lines(drive)
    for mode in filter(_may_resonate, modes):
        for line, order in orders:
            rate, f = mode.frequency / (order * per_rate), mode.frequency
            examined = _rates_to_examine(rate, mode)
            if any(low <= one <= high for one in examined):
                met = Resonance(microsteps, rate, f, math.nan, f"{prefix}{line}", mode.name, f)
                yield _Crossing(met, examined)
    yield from _parametric_crossings(drive, microsteps, span, prefix)


def _parametric_crossings(
    drive: Scenario, microsteps: int, span: tuple[float, float], prefix: str
) -> Iterator[_Crossing]:
    """Where what varies over the angle of a ``drive`` does so at twice the frequency of a mode, or at the
    sum of two, and by enough to keep it ringing.

    What rings has half the order of the variation. The rotor's own motion shifts the rate; looked at
    are the rates nearby at which the mode grows most, or decays most slowly.
    """
    low, high = span
    own = float(drive.rate or 0.0) / low
    ends = drive, *(one for _, one in _drive_at(drive, [high * own]))
    for found in dict.fromkeys(x for one in ends for x in parametric_resonances(one)):
        per_rate = 0.5 * found.order * abs(own) / (2.0 * math.pi)
        f = 0.5 * found.frequency
        rate = f / per_rate
        if not low <= rate <= high:
            continue
        near = [x * own for x in rate * PARAMETRIC_SHIFTS if low <= x <= high]
        decays = {x / own: decay_in_motion(found.mode, one) for x, one in _drive_at(drive, near)}
        if not decays:
            continue
        slowed = [x for x, decay in decays.items() if decay < 0.5 * found.mode.decay]
        least = min(decays, key=lambda x: decays[x])
        line = f"{prefix}{found.line}"
        met = Resonance(microsteps, least, per_rate * least, math.nan, line, found.mode.name, f)
        yield _Crossing(met, sorted({least, *slowed}))


def _drive_at(drive: Scenario, rates: Sequence[float]) -> Iterator[tuple[float, Scenario]]:
    """Rates [rad/s] and the drive at each, without those too fast for the parts of its microsteps."""
    for rate in rates:
        case = _case_at(drive, Si(rate), drive.driver.microsteps)
        if isinstance(case, Scenario):
            yield rate, case


def _orders_of_lines(scenario: Scenario) -> list[tuple[str, float]]:
    """Lines of a drive that may be resonances, by their frequencies over the driving frequency."""
    driver, motor, members = scenario.driver, scenario.motor, range(1, HARMONICS + 1)
    detent = motor.full_steps / (driver.beats * driver.microsteps)
    orders = [(driving_line(k), float(k)) for k in members]
    torques = motor.torque_orders
    if any(order % motor.full_steps == 0 for order in torques):
        orders += [(full_step_line(k), k * detent) for k in members if (k * detent) % 1.0 != 0.0]
    turn = driver.beats * driver.microsteps
    electrical = [n for n in torques if n % motor.full_steps] + _electrical_orders(scenario)
    orders += [(electrical_line(n), n / turn) for n in dict.fromkeys(electrical)]
    of_rotor = turn * motor.rotor_teeth
    orders += [
        (e.line, float(e.order) / of_rotor) for e in scenario.rotor_harmonics if e.amplitude > 0.0
    ]
    position = scenario.friction.position
    of_output = of_rotor * scenario.reducer.ratio
    return orders + [
        (f"friction_{each.order}", float(each.order) / of_output)
        for each in (position.harmonics if position else ())
        if each.amplitude > 0.0
    ]


def _electrical_orders(scenario: Scenario) -> list[int]:
    """Cycles per electrical turn of the largest lines that errors of a driver make."""
    driver = scenario.driver
    if not driver.distorted or driver.compensates:
        return []
    highest = MOST_ELECTRICAL_ORDERS * float(scenario.driving_frequency or 0.0)
    size = commanded_torque(scenario, highest).amplitude.copy()
    turn = driver.beats * driver.microsteps
    size[turn - 1 :: turn] = 0.0  # driving lines
    largest = np.argsort(-size)[:MOST_ELECTRICAL_ORDERS]
    return [int(k) + 1 for k in largest if size[k] > MIN_RESONANCE_RATIO * np.max(size)]


def _rates_to_examine(rate: float, mode: CoupledMode) -> list[float]:
    """Rates to examine: while the shaft sticks part of the time, the mode is between its coupled
    and its clamped frequency.
    """
    ratio = (mode.fixed_frequency or mode.frequency) / mode.frequency
    return [
        rate * float(s)
        for s in np.unique(np.linspace(1.0, ratio if abs(ratio - 1.0) <= 0.1 else 1.0, 3))
    ]


def _strongest_crossing(meeting: Resonance, cases: Sequence[RateCase]) -> Resonance | None:
    """The meeting at that of its rates at which its line is largest; None where the line is too
    small to be one.
    """
    order = meeting.frequency / meeting.rate
    found = [
        (x, case.rate)
        for case in cases
        for x in _significant_lines(case)
        if x.name == meeting.line
        or math.isclose(x.frequency / case.rate, order, rel_tol=_SAME_ORDER)
    ]
    if not found:
        if all(case.failed for case in cases):
            return meeting
        return None
    line, rate = max(found, key=lambda item: item[0].raised)
    return replace(meeting, rate=rate, frequency=line.frequency, amplitude=line.raised)


def _significant_lines(case: RateCase) -> list[RateLine]:
    top = max((x.raised for x in case.lines), default=0.0)
    return [x for x in case.lines if x.raised >= MIN_RESONANCE_RATIO * top]


def _unconfirmed_cases(cases: Iterable[RateCase], band: tuple[float, float]) -> list[RateCase]:
    """Steady states beside rates at which the drive excites itself, that are not confirmed yet."""
    ordered = sorted(cases, key=lambda case: (case.microsteps, case.rate))
    pairs = [(a, b) for a, b in pairwise(ordered) if a.microsteps == b.microsteps]
    beside = {id(case) for a, b in pairs for case, other in ((a, b), (b, a)) if other.rings(band)}
    return [
        case for case in ordered if id(case) in beside and not case.reason and not case.confirmed
    ]


def _forbidden(
    row: Sequence[RateCase],
    limit: float | LimitCurve,
    band: tuple[float, float],
    solve: Solve,
) -> list[Forbidden]:
    """Bands of one microstep count, ``row`` by rate; edges by bisection, all edges at once."""

    def verdict(case: RateCase) -> str:
        return case.verdict(band, limit)

    edges = [(a, b) for a, b in pairwise(row) if verdict(a) != verdict(b)]
    for _ in range(BISECTIONS):
        middles = solve(
            [
                (0.5 * (a.rate + b.rate), a.microsteps, a.rings(band) or b.rings(band))
                for a, b in edges
            ]
        )
        edges = [
            (middle, b) if verdict(middle) == verdict(a) else (a, middle)
            for (a, b), middle in zip(edges, middles, strict=True)
        ]
    turns = [row[0].rate, *(0.5 * (a.rate + b.rate) for a, b in edges), row[-1].rate]
    members = [list(group) for _, group in groupby(row, verdict)]
    return [
        _forbidden_band(cases, low, high, limit, band)
        for cases, (low, high) in zip(members, pairwise(turns), strict=True)
        if verdict(cases[0])
    ]


def _forbidden_band(
    cases: Sequence[RateCase],
    low: float,
    high: float,
    limit: float | LimitCurve,
    band: tuple[float, float],
) -> Forbidden:
    """The band of rates of cases in a row with one verdict, and its largest line."""
    why = cases[0].verdict(band, limit)
    if why in (ABOVE_PASSBAND, BEYOND_LINEAR_MODEL):
        each = [case.largest_unseen(band, limit) for case in cases]
    elif why == OTHER_STATE:
        each = [case.largest_in_states(_curve_in(limit, band)) for case in cases]
    else:
        each = [case.largest(band, why in (HIDDEN_LINE, PART_OF_TIME), limit) for case in cases]
    found = [line for line in each if line is not None]
    curve = _curve_in(limit, band)
    top = _nearest_to(found, curve)
    why = _with_remedy(why, cases)
    if why == ABOVE_PASSBAND:
        such = f", such as {top.name}" if top else ""
        why = f"{why} ({_required_sample_rate(cases, band, limit)}){such}"
    if top is None:
        return Forbidden(cases[0].microsteps, low, high, math.nan, "", why)
    return Forbidden(cases[0].microsteps, low, high, top.amplitude, top.name, why)


def _with_remedy(why: str, cases: Sequence[RateCase]) -> str:
    """Verdict of cases in a row with its reason, as far as they have that."""
    if why == "failed":
        return cases[0].reason
    if why == ABOVE_HUB:
        edge = next(case.edge for case in cases if case.edge is not None)
        return f"not judged: {edge.why}"
    if why == RECORD_GAP:
        slowest = next(case.gap for case in cases if case.gap is not None)
        return f"not judged: {slowest.why}"
    return f"{why}: {cases[0].hinge}" if why == OTHER_STATE else why


def _required_sample_rate(
    cases: Iterable[RateCase], band: tuple[float, float], limit: float | LimitCurve
) -> str:
    """The sample rate from which a record shows what may be above the limit [N m]."""
    curve = _curve_in(limit, band)
    above = [
        x.frequency[x.may_exceed(curve)] for case in cases for x in case.unseen_in(band, curve)
    ]
    return f"record.sample_rate >= {rounded_up(float(np.max(np.concatenate(above))) / PASSBAND)} Hz"


def rate_grid(low: GivenQuantity, high: GivenQuantity, count: int = 200) -> tuple[Si, ...]:
    """Make rates in even steps, for ``plan_rates``.

    Parameters
    ----------
    low, high : str or Si
        First and last rate, such as ``"0.01 deg/s"`` and ``"0.3 deg/s"``.
    count : int
        Number of rates, 2 or more.

    Returns
    -------
    tuple of Si
        Rates of the array [rad/s].

    Raises
    ------
    OptionError
        Where they do not make a range.
    """
    low, high = (
        quantity(key, rate, "rad/s", example="deg/s") for key, rate in (("from", low), ("to", high))
    )
    count = whole_number("count", count, 2, 10_000)
    if not 0.0 < low < high:
        first, last = (f"{math.degrees(rate):g} deg/s" for rate in (low, high))
        raise OptionError(
            "from",
            f"is not allowed; it must be above 0 and below {last}, the end of the range",
            first,
        )
    return tuple(map(Si, np.linspace(low, high, count).tolist()))
