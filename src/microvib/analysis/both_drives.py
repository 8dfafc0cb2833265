"""Lines of the torque about a drive axis with both drives of a craft stepping.

The disturbance torque of a drive is what it makes while the other one stands. Where both step, the craft
feels at each interface what the other drive makes there, too. By how much is what the linearised drives
and craft make of it (``microvib.model.other_hinge.torque_at_other_interface``); with which phase is not
asked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.margins import Margin, line_range
from microvib.model.other_hinge import load_over_torque, torque_at_other_interface
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import Line, LineTable

_SAME_LINE = 1e-4
"""Part of a frequency within which lines of both drives are one, however long the record is."""


@dataclass(frozen=True)
class AddedTorque:
    """Lines that another drive adds about the axis of a drive."""

    frequency: np.ndarray
    """[Hz], (k,)."""
    amplitude: np.ndarray
    """[N m], or [N] of a force, (k,)."""
    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    """Ends of what the frequencies may be [Hz], (k,)."""
    resolution: float
    """Distance [Hz] within which lines are not told apart by a record as long as the scenario's."""

    @classmethod
    def of(cls, table: LineTable, scenario: Scenario) -> AddedTorque:
        """Take the lines of the other drive, of whose craft and wing the ``scenario`` is."""
        return cls._of(table, scenario, lambda f: torque_at_other_interface(scenario, f))

    @classmethod
    def of_load(
        cls, table: LineTable, scenario: Scenario, component: str, *, there: bool
    ) -> AddedTorque:
        """Take what a drive's lines make of a load at its own interface, or at the other (``there``)."""
        return cls._of(
            table, scenario, lambda f: load_over_torque(scenario, f, component, there=there)
        )

    @classmethod
    def _of(
        cls, table: LineTable, scenario: Scenario, ratios: Callable[[np.ndarray], np.ndarray]
    ) -> AddedTorque:
        lines = _lasting(table)
        at = np.array([line.place for line in lines])
        size = np.array([line.amplitude for line in lines])
        ranges = np.array([line_range(line, table, scenario) for line in lines]).reshape(-1, 2)
        made = size * ratios(at) if lines else size
        names = tuple(line.name for line in lines)
        resolution = SEPARATION / scenario.record.duration
        return cls(at, made, names, ranges[:, 0], ranges[:, 1], resolution)

    def beside(self, frequency: float) -> float:
        """Sum of the added lines that the record cannot separate from a line at this frequency [Hz]."""
        return float(np.sum(self.amplitude[self._same(self.frequency, frequency)]))

    def judged(self, margin: Margin) -> Margin:
        """A margin, not judged where what is added may decide it."""
        added = self.beside(margin.line.place)
        least, most = margin.amplitude - added, margin.amplitude + added
        passes, fails = margin.verdict == "pass", margin.verdict == "fail"
        if not ((passes and most > margin.limit) or (fails and least <= margin.limit)):
            return margin
        end = f"up to {1e3 * most:.4g}" if passes else f"{1e3 * max(least, 0.0):.4g} or more"
        why = (
            f"{margin.line.name} ({1e3 * margin.amplitude:.4g} mN m, and {end} mN m about this axis with"
            " both drives stepping)"
        )
        return replace(margin, verdict="not judged", why=why)

    def alone(self, lines: Sequence[Line], limit: LimitCurve) -> Iterator[str]:
        """Added lines above a limit where the drive has no line of its own, in words."""
        own = np.array([line.place for line in lines if line.seen])
        for k, name in enumerate(self.names):
            if not limit.holds(self.frequency[k]) or np.any(self._same(own, self.frequency[k])):
                continue
            if self.amplitude[k] > limit.strictest(self.low[k], self.high[k]):
                yield f"{name} of the other drive, up to {1e3 * self.amplitude[k]:.4g} mN m about this axis"

    def _same(self, frequencies: np.ndarray, frequency: float) -> np.ndarray:
        within = max(_SAME_LINE * frequency, self.resolution)
        return np.asarray(np.abs(frequencies - frequency) <= within)


def drifting_lines(
    limit: LimitCurve,
    component: str,
    tables: tuple[LineTable, LineTable | None],
    scenario: Scenario | None,
) -> Iterator[str]:
    """Lines of a load that two drives with clocks of their own make together, where these drift through
    all phases for longer than a record shows, and may be above a limit; in words.

    ``component`` is the load, ``Fx`` to ``Mz``, with ``_2`` at the second wing's interface; ``tables`` are
    those of both drives' torques.
    """
    first, second = tables
    wing = None if scenario is None else scenario.driven_wing
    if scenario is None or wing is None or second is None or _have_one_clock(scenario):
        return
    name, there = component.removesuffix("_2"), component.endswith("_2")
    own = AddedTorque.of_load(first, scenario, name, there=there)
    theirs = AddedTorque.of_load(second, wing.alone, name, there=not there)
    unit = "N" if name.startswith("F") else "N m"
    for line, f, size in zip(own.names, own.frequency, own.amplitude, strict=True):
        added = theirs.beside(f)
        if added > 0.0 and limit.holds(f) and size + added > limit.strictest(f, f):
            yield (
                f"{line} of both drives, up to {1e3 * (size + added):.4g} m{unit}"
                " as their clocks drift through all phases, which the record does not show"
            )


def _have_one_clock(scenario: Scenario) -> bool:
    """Whether a second wing's drive makes its steps with those of the first."""
    craft = scenario.spacecraft
    wing = None if craft is None else craft.second_wing
    return wing is not None and wing.tracking is None and wing.clock_ratio == 1.0


def _lasting(table: LineTable) -> list[Line]:
    """Lines with an amplitude that last."""
    return [
        line
        for line in table
        if line.seen
        and line.status != TRANSIENT
        and line.place > 0.0
        and math.isfinite(line.amplitude)
    ]
