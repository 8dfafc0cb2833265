"""Lines of the torque about a drive axis with both drives of a craft stepping.

The disturbance torque of a drive is what it makes while the other one stands. Where both step, the craft
feels at each interface what the other drive makes there, too. By how much is what the linearised drives
and craft make of it (``microvib.model.other_hinge.torque_at_other_interface``); with which phase is not
asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.margins import Margin, line_range
from microvib.model.other_hinge import torque_at_other_interface
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_table import Line, LineTable

_SAME_LINE = 1e-4
"""Part of a frequency within which lines of both drives are one; in a record, a bin of it at least."""
_COUNTS = 0.01
"""Part of the limit below which what the other drive adds is left to the margin's own bounds."""


@dataclass(frozen=True)
class AddedTorque:
    """Lines that another drive adds about the axis of a drive."""

    frequency: np.ndarray
    """[Hz], (k,)."""
    amplitude: np.ndarray
    """[N m], (k,)."""
    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    """Ends of what the frequencies may be [Hz], (k,)."""
    resolution: float
    """Distance [Hz] within which lines of a record are not told apart; 0 of exact ones."""

    @classmethod
    def of(cls, table: LineTable, scenario: Scenario) -> AddedTorque:
        """Take the lines of the other drive, of whose craft and wing the ``scenario`` is."""
        lines = [
            line for line in table if line.seen and line.status != TRANSIENT and line.place > 0.0
        ]
        lines = [line for line in lines if math.isfinite(line.amplitude)]
        at = np.array([line.place for line in lines])
        size = np.array([line.amplitude for line in lines])
        ranges = np.array([line_range(line, table, scenario) for line in lines]).reshape(-1, 2)
        there = size * torque_at_other_interface(scenario, at) if lines else size
        resolution = 0.0 if table.rest is None or table.rest.floor is None else 1.0 / table.duration
        names = tuple(line.name for line in lines)
        return cls(at, there, names, ranges[:, 0], ranges[:, 1], resolution)

    def beside(self, line: Line) -> float:
        """Torque that is added to a line of the drive itself, at most [N m]."""
        return float(np.sum(self.amplitude[self._near(line.place)]))

    def judged(self, margin: Margin) -> Margin:
        """A margin, not judged where what is added may decide it."""
        added = self.beside(margin.line)
        least, most = margin.amplitude - added, margin.amplitude + added
        passes, fails = margin.verdict == "pass", margin.verdict == "fail"
        if added <= _COUNTS * margin.limit or not (
            (passes and most > margin.limit) or (fails and least <= margin.limit)
        ):
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

    def _near(self, frequency: float) -> np.ndarray:
        return self._same(self.frequency, frequency)

    def _same(self, frequencies: np.ndarray, frequency: float) -> np.ndarray:
        within = max(_SAME_LINE * frequency, self.resolution)
        return np.asarray(np.abs(frequencies - frequency) <= within)
