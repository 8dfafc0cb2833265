"""Order cuts against a limit over frequency.

A sweep fails where an order is above the limit, and never passes: a resonance that is swept through
responds less than in a dwell, and orders that are not tracked are not assessed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from microvib.errors import OptionError
from microvib.results import (
    DECIBEL,
    FREQUENCY,
    LINE_FREQUENCY,
    SHARE,
    TORQUE,
    TORQUE_LIMIT,
    TORQUE_UNCERTAINTY,
    Column,
)
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.studies.track import TRACKED, OrderCut, OrderTracking

ABOVE, BELOW, CLOSE, UNKNOWN = (
    "above the limit",
    "below in this sweep",
    "within its uncertainty of the limit",
    "not told",
)
"""Findings on an order."""
_SIGMAS = 2.0
"""Standard uncertainties of an amplitude by which it must be on one side of the limit."""


@dataclass(frozen=True)
class CutMargin:
    """An order at the point of its cut that is nearest to the limit."""

    order: Annotated[str, Column("order", "order")]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    uncertainty: Annotated[float, Column("amplitude_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    limit: Annotated[float, Column("limit_n_m", "limit", TORQUE_LIMIT)]
    frequency: Annotated[float, Column("frequency_hz", "at", LINE_FREQUENCY)]
    speed: Annotated[float, Column("speed_hz", "speed", FREQUENCY)]
    margin: Annotated[float, Column("margin_db", "margin", DECIBEL)]
    """Limit over amplitude."""
    told: Annotated[float, Column("told", "told", SHARE)]
    """Part of the cut within the limit's frequencies at which the amplitude is known."""
    finding: Annotated[str, Column("finding", "finding")]

    @property
    def words(self) -> str:
        """Name for readers: of an order, or of a line of constant frequency."""
        return f"line at {self.order}" if self.order.endswith("Hz") else f"order {self.order}"


@dataclass(frozen=True)
class CutLimits:
    """Order cuts against a limit."""

    curve: LimitCurve
    margins: tuple[CutMargin, ...]
    """A row for each order that crosses the limit's frequencies, the smallest margin first."""

    @property
    def verdict(self) -> Literal["fail", "not judged"]:
        """*fail* where an order is above the limit; a sweep passes nothing."""
        return "fail" if any(one.finding == ABOVE for one in self.margins) else "not judged"

    @property
    def words(self) -> str:
        """Sentence on what was found."""
        above = [one.words for one in self.margins if one.finding == ABOVE]
        if above:
            return f"FAIL, above the limit: {', '.join(above)}."
        return (
            "No tracked order is above the limit in this sweep. That is no pass: a resonance that is swept"
            " through responds less than in a dwell, and orders that are not tracked are not assessed."
        )


def cuts_against(found: OrderTracking, limit: Limit) -> CutLimits:
    """Compare order cuts with a limit.

    Parameters
    ----------
    found : OrderTracking
        A sweep.
    limit : Limit
        The curve of the sweep's channel counts, or else that of the torque about the drive axis.

    Returns
    -------
    CutLimits
        Margins, of which those of fixed lines are a part.

    Raises
    ------
    OptionError
        For a limit in another unit than the channel, or that has none for it.
    """
    curve = limit.loads.get(found.channel, limit.curve)
    unit = "N" if found.channel in limit.loads and found.channel.startswith("F") else "N*m"
    if curve is None:
        raise OptionError("limit", f"has no curve for channel {found.channel}")
    if found.unit != unit:
        raise OptionError(
            "limit", f"is in {unit.replace('*', ' ')}, and channel {found.channel} in {found.unit}"
        )
    rows = [_margin(cut, curve, found.bandwidth) for cut in found.cuts]
    known = [row for row in rows if row is not None]
    known.sort(key=lambda row: math.inf if math.isnan(row.margin) else row.margin)
    return CutLimits(curve, tuple(known))


def _margin(cut: OrderCut, curve: LimitCurve, bandwidth: float) -> CutMargin | None:
    """The point with the smallest margin; None where the order does not cross the limit's frequencies.

    Between points, and within half the bandwidth about each, the least of the limit counts.
    """
    reach = 0.5 * bandwidth + _half_steps(cut.frequency)
    low, high = np.maximum(cut.frequency - reach, 0.0), cut.frequency + reach
    least = np.asarray(curve.strictest(low, high))
    inside = np.isfinite(least)
    if not np.any(inside):
        return None
    known = inside & cut.known
    told = float(np.count_nonzero(known) / np.count_nonzero(inside))
    if not np.any(known):
        nan = math.nan
        return CutMargin(cut.label, nan, nan, nan, nan, nan, nan, told, UNKNOWN)
    most = np.asarray(curve.most_lenient(low, high))
    upper = cut.amplitude + _SIGMAS * cut.uncertainty
    lower = np.maximum(cut.amplitude - _SIGMAS * cut.uncertainty, 0.0)
    above = known & (cut.finding == TRACKED) & (lower > most)
    over = np.where(known, upper / np.where(inside, least, math.inf), 0.0)
    ratios = np.where(above, lower / np.where(inside, most, math.inf), 0.0)
    i = int(np.argmax(ratios if np.any(above) else over))
    return CutMargin(
        cut.label,
        float(cut.amplitude[i]),
        float(cut.uncertainty[i]),
        float(least[i]),
        float(cut.frequency[i]),
        float(cut.speed[i]),
        20.0 * math.log10(least[i] / max(cut.amplitude[i], 1e-300)),
        told,
        _finding(above, over, told),
    )


def _finding(above: np.ndarray, over: np.ndarray, told: float) -> str:
    if np.any(above):
        return ABOVE
    if np.max(over) > 1.0:
        return CLOSE
    if told < 1.0:
        return f"{BELOW} where told"
    return BELOW


def _half_steps(frequency: np.ndarray) -> np.ndarray:
    """Half of the distance to the further neighbour of each point [Hz], (m,)."""
    if frequency.size < 2:
        return np.zeros(frequency.size)
    steps = np.abs(np.diff(frequency))
    return 0.5 * np.maximum(np.append(steps, steps[-1]), np.insert(steps, 0, steps[0]))


def limit_along(cut: OrderCut, curve: LimitCurve) -> Sequence[float]:
    """The limit at the frequencies of a cut, (m,); infinite where nothing is limited."""
    found: list[float] = np.asarray(curve.at(cut.frequency)).tolist()
    return found
