"""Lines of a run in other states of the other wing's hinge than the one that the run has: whether they
would change a verdict.

By how much a line differs is what the linearised drives and craft make of a torque on the shafts of the
drive (``microvib.model.other_hinge``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.margins import RINGING_FACTOR, Margin, line_range
from microvib.analysis.unseen import OutOfBandLines
from microvib.model.other_hinge import OtherHinge, other_hinge, torque_at_locked_hinge
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_table import (
    NOISE_DRIVEN,
    Line,
    LineTable,
    ResidualPeaks,
    part_ends,
)

COUNTS = 0.01
"""Part by which a line has to differ for a verdict to say on what it rests."""
SECOND_WING = "_2"
"""Ending of the channels of loads at a second wing's interface."""
_LEAST_ALLOWED = 1e-9
"""Part of a limit that is left to a line at the least, where others take it all."""
_FAR_BELOW = 1e3
"""Times below a limit from which no other state is looked at, above the passband."""


@dataclass(frozen=True)
class View:
    """A hinge, and the load that is seen of the drive which moves it."""

    hinge: OtherHinge
    component: str = ""
    there: bool = False

    def ratios(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """As ``OtherHinge.ratios``."""
        return self.hinge.ratios(low, high, self.component, there=self.there)


@dataclass(frozen=True)
class OtherStates:
    """Other states of a hinge than a run's, for the lines of one table."""

    views: tuple[View, ...]
    """By each drive whose lines the table has."""
    of_lines: Mapping[str, np.ndarray]
    """For each line that lasts, by its name: least and largest amplitude over its own, and what it may
    change beside by the changes of others, (3,)."""
    stirred: float
    """Change of a line that is not among them, at most, by their changes, in the table's unit."""

    @property
    def gap(self) -> str:
        """Why nothing is known of lines that differ between states, and what to do."""
        return self.views[0].hinge.gap

    @property
    def assumption(self) -> str:
        """On what a verdict rests, as a sentence."""
        one = self.views[0].hinge
        return (
            f"Lines are those with {one.whose} shaft held by its linearised drive, and verdicts hold in other"
            f" states of that hinge, too ({one.why})."
        )

    def ratios(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Least and largest ratio over all views between frequencies (m,) and (m,) [Hz], (2, m)."""
        each = np.array([view.ratios(low, high) for view in self.views])
        return np.array([each[:, 0].min(axis=0), each[:, 1].max(axis=0)])

    def largest(self, line: Line, amplitude: float) -> float:
        """The most that a line of an ``amplitude`` has in any state."""
        _, most, stirred = self._of(line)
        return most * amplitude + stirred

    def least(self, line: Line, amplitude: float) -> float:
        """The least that it has."""
        least, _, stirred = self._of(line)
        return max(least * amplitude - stirred, 0.0)

    def strictest(self, line: Line, limit: float) -> float:
        """Amplitude up to which a line of the run is within a ``limit`` in every state."""
        _, most, stirred = self._of(line)
        return max((limit - stirred) / most, _LEAST_ALLOWED * limit)

    def most_lenient(self, line: Line, limit: float) -> float:
        """Amplitude from which a line of the run is above a ``limit`` in every state."""
        least, _, stirred = self._of(line)
        return (limit + stirred) / least if least > 0.0 else math.inf

    def judged(
        self, found: Margin, judged_at: Callable[[float], Margin], lenient: float, unit: str
    ) -> Margin:
        """The margin of a line, not judged where it would pass or fail in another state.

        ``judged_at`` judges it by another limit; it failed above ``lenient``.
        """
        line, at = found.line, found.limit
        if found.verdict == "pass":
            if judged_at(self.strictest(line, at)).verdict == "pass":
                return found
            other = f"up to {1e3 * self.largest(line, found.amplitude):.4g}"
        elif found.verdict == "fail":
            if judged_at(self.most_lenient(line, lenient)).verdict == "fail":
                return found
            other = f"as little as {1e3 * self.least(line, found.amplitude):.4g}"
        else:
            return found
        why = (
            f"{line.name} ({1e3 * found.amplitude:.4g} {unit}, and {other} {unit} with another state of"
            f" {self.views[0].hinge.whose} hinge)"
        )
        return replace(found, verdict="not judged", why=why, by_state=True)

    def matters(self, table: LineTable, limit: LimitCurve) -> bool:
        """Whether a line within a limit's band differs by more than ``COUNTS``."""
        return any(
            limit.holds(line.place) and np.max(np.abs(self.of_lines[line.name][:2] - 1.0)) > COUNTS
            for line in table
            if line.name in self.of_lines
        )

    def peaks_above(
        self, peaks: ResidualPeaks | None, limit: LimitCurve, factor: float = 1.0
    ) -> tuple[float, float] | None:
        """Frequency [Hz] and largest amplitude of the peak that is farthest above a limit in another state;
        None where none is.
        """
        if peaks is None or not peaks.frequency.size:
            return None
        most = self.ratios(*part_ends(peaks.frequency))[1]
        scaled = replace(peaks, amplitude=peaks.amplitude * most + self.stirred)
        frequency, amplitude, allowed = scaled.nearest_to(limit)
        return (frequency, factor * amplitude) if factor * amplitude > allowed else None

    def out_of_band(self, one: OutOfBandLines, limit: LimitCurve) -> OutOfBandLines:
        """Bounds on lines above the passband, as large as they are in any state where they are not far
        below a limit.
        """
        near = np.flatnonzero(_FAR_BELOW * one.most > one.least_allowed(limit))
        if not near.size:
            return one
        most, at = one.most.copy(), one.frequency[near]
        most[near] *= self.ratios(at, at)[1]
        return replace(one, most=most)

    def _of(self, line: Line) -> tuple[float, float, float]:
        """Ratios of a line, and what others change of it."""
        found = self.of_lines.get(line.name)
        if found is None:
            return 1.0, 1.0, self.stirred
        least, most, stirred = found.tolist()
        return least, most, stirred


def other_states(
    table: LineTable, scenario: Scenario | None, component: str = "", *, first: bool = True
) -> OtherStates | None:
    """Other states of the other wing's hinge for the lines of a simulated table; None where there is no
    other wing, or nothing but its linearised drive holds it.

    ``component`` is the load that the lines are of, ``Fx`` to ``Mz``, with ``_2`` at the second wing's
    interface; the torque of the drive without it. Not ``first``: the drive is the second wing's.
    """
    if scenario is None or table.clock_ratio_uncertainty != 0.0:
        return None
    views = tuple(_views(scenario, component, first=first))
    if not views:
        return None
    states = OtherStates(views, {}, 0.0)
    lines = [line for line in table if _lasts(line) and line.place > 0.0]
    ranges = np.array([line_range(line, table, scenario) for line in lines]).reshape(-1, 2)
    ratios = states.ratios(np.maximum(ranges[:, 0], 1e-9), ranges[:, 1])
    size = np.nan_to_num([line.amplitude for line in lines])
    beside = stirring(size, ratios)
    of_lines = {
        line.name: of for line, of in zip(lines, np.vstack([ratios, beside]).T, strict=True)
    }
    return replace(states, of_lines=of_lines, stirred=float(np.max(beside, initial=0.0)))


def stirring(amplitude: np.ndarray, ratios: np.ndarray) -> np.ndarray:
    """Change of each line (k,), at most, by the largest change of another, where ``ratios`` (2, k) change it.

    Friction, detent torque and the motor's spring couple lines: a tenth of that change, where 6 % of it
    were seen (``tests/test_other_states.py``).
    """
    changes = amplitude * np.abs(ratios - 1.0).max(axis=0, initial=0.0)
    largest, others = (*np.sort(changes)[:-3:-1], 0.0, 0.0)[:2]
    found = np.full(changes.shape, RINGING_FACTOR * largest)
    if found.size:
        found[np.argmax(changes)] = RINGING_FACTOR * others
    return found


def _lasts(line: Line) -> bool:
    """Whether a line is no ringing, nor one draw of noise."""
    if line.status in (TRANSIENT, NOISE_DRIVEN):
        return False
    return not line.is_mode or line.status == "ok"


def _views(scenario: Scenario, component: str, *, first: bool) -> Iterator[View]:
    """The hinges that loads of a scenario's drives depend on."""
    there = component.endswith(SECOND_WING)
    name = component.removesuffix(SECOND_WING)
    own = other_hinge(scenario, first=first)
    if own is not None:
        yield View(own, name, there)
    driven = scenario.driven_wing if component else None
    second = None if driven is None else other_hinge(driven, first=False)
    if second is not None:
        yield View(second, name, not there)


def slipping_reason_of_table(table: LineTable, scenario: Scenario | None) -> str:
    """As ``slipping_reason``, by the lines of a table, those that decay as at the start of the record."""
    lines = [line for line in table if line.seen and line.place > 0.0]
    size = [max(line.amplitude, line.amplitude_at_start(table.duration)) for line in lines]
    return slipping_reason(scenario, [line.place for line in lines], np.nan_to_num(size))


def slipping_reason(
    scenario: Scenario | None, frequency: Sequence[float], amplitude: np.ndarray
) -> str:
    """Why a second wing's shaft that a scenario has locked may not stay so, by lines (k,) [Hz] of the first
    drive's torque [N m]; empty where it does, and where no friction is given that would hold it.
    """
    other = None if scenario is None else scenario.other_wing
    if scenario is None or other is None or not scenario.second_is_locked:
        return ""
    holds, key = other.friction.breakaway_torque, "spacecraft.second_wing.drive"
    if holds == 0.0:
        return ""
    if other.friction.memory:
        return f"the state of the second wing's hinge, which friction with presliding does not lock ({key}: held)"
    at_hinge = torque_at_locked_hinge(scenario, np.array(frequency, dtype=float))
    torque = float(np.sum(amplitude * at_hinge))
    if torque <= holds:
        return ""
    return (
        f"the state of the second wing's hinge, which is locked in the run: torques of up to {torque:.3g} N m"
        f" there may overcome its friction, of {holds:.3g} N m ({key}: held)"
    )
