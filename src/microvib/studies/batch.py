"""One process over several records: the figures of each side by side, their mean and spread, and the
records that fall out of line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from microvib.analysis.orders import ABOVE_FLOOR
from microvib.errors import OptionError
from microvib.results import COUNT, SHARE, TORQUE, TORQUE_UNCERTAINTY, Column
from microvib.signals.scatter import outliers
from microvib.studies.analyse import Analysis
from microvib.studies.track import OrderTracking

MIN_RECORDS = 4
"""Records of a figure below which none is named as an outlier."""


@dataclass(frozen=True)
class Figure:
    """One figure of one record, in its unit."""

    value: float
    uncertainty: float = 0.0
    seen: bool = True
    """Whether it stands above its floor."""


@dataclass(frozen=True)
class FigureSpread:
    """A figure over several records."""

    name: Annotated[str, Column("figure", "figure")]
    records: Annotated[int, Column("records", "records", COUNT)]
    mean: Annotated[float, Column("mean_n_m", "mean", TORQUE)]
    deviation: Annotated[float, Column("deviation_n_m", "deviation", TORQUE_UNCERTAINTY)]
    """Standard deviation over the records; nan of one."""
    relative: Annotated[float, Column("deviation_part", "of the mean", SHARE)]
    own: Annotated[float, Column("own_uncertainty_n_m", "± of one", TORQUE_UNCERTAINTY)]
    """Standard uncertainty of one record's figure, root mean square."""
    lowest: Annotated[float, Column("lowest_n_m", "lowest", TORQUE)]
    lowest_in: Annotated[str, Column("lowest_in", "in", report_only=True)]
    highest: Annotated[float, Column("highest_n_m", "highest", TORQUE)]
    highest_in: Annotated[str, Column("highest_in", "in", report_only=True)]
    outliers: Annotated[str, Column("outliers", "outliers")]
    """Records far from the median of all; words where there are too few to tell."""


@dataclass(frozen=True)
class Batch:
    """Several records, analysed alike."""

    names: tuple[str, ...]
    channel: str
    unit: str
    figures: tuple[Mapping[str, Figure], ...]
    """Figures of each record, by name."""
    spreads: tuple[FigureSpread, ...]


def batch_of(names: Sequence[str], records: Sequence[Analysis | OrderTracking]) -> Batch:
    """The figures of several records of one unit, compared: those above their floor in one of them.

    OptionError where the records are in different units.
    """
    units = {record.unit for record in records}
    if len(units) > 1:
        raise OptionError("channel", f"is in different units in these records: {', '.join(units)}")
    names = _once_each(names)
    figures = tuple(figures_of(record) for record in records)
    every = dict.fromkeys(name for one in figures for name in one if one[name].seen)
    spreads = tuple(
        spread_of(
            name, {of: one[name] for of, one in zip(names, figures, strict=True) if name in one}
        )
        for name in every
    )
    return Batch(tuple(names), records[0].channel, records[0].unit, figures, spreads)


def _once_each(names: Sequence[str]) -> list[str]:
    """Names of records; of a name that occurs several times, with a number."""
    found: list[str] = []
    for name in names:
        k = sum(1 for before in names[: len(found)] if before == name)
        found.append(f"{name} ({k + 1})" if k else name)
    return found


def figures_of(record: Analysis | OrderTracking) -> dict[str, Figure]:
    """Amplitudes of a record by what they are of: lines, orders, peaks of bands, RMS."""
    if isinstance(record, OrderTracking):
        return dict(_figures_of_orders(record))
    return dict(_figures_of_analysis(record))


def _figures_of_orders(found: OrderTracking) -> Iterator[tuple[str, Figure]]:
    for one in found.maxima:
        if not math.isfinite(one.mean):
            continue
        yield f"order {one.order}, largest", Figure(one.amplitude, one.uncertainty)
        yield f"order {one.order}, mean", Figure(one.mean)


def _figures_of_analysis(a: Analysis) -> Iterator[tuple[str, Figure]]:
    for order in a.orders:
        if math.isfinite(order.amplitude):
            seen = order.finding.startswith(ABOVE_FLOOR)
            yield f"order {order.order}", Figure(order.amplitude, order.uncertainty, seen)
    for line in a.table or ():
        known = line.seen and math.isfinite(line.amplitude) and line.kind != "other"
        if known and not (a.orders and line.of_clock):
            yield line.name, Figure(line.amplitude, line.amplitude_uncertainty)
    for peak in a.band_peaks:
        if math.isfinite(peak.peak):
            yield f"peak of {peak.channel}, {peak.band}", Figure(peak.peak)
    for low, high, rms in a.bands:
        yield f"RMS, {low:g} to {high:g} Hz", Figure(rms)
    yield "RMS of the record", Figure(float(a.recording[a.channel].std()))


def spread_of(name: str, figures: Mapping[str, Figure]) -> FigureSpread:
    """One figure over the records that have it."""
    of = list(figures)
    values = np.array([figures[each].value for each in of])
    uncertainty = np.array([figures[each].uncertainty for each in of])
    own = math.sqrt(float(np.mean(uncertainty**2)))
    mean = float(values.mean())
    deviation = float(values.std(ddof=1)) if values.size > 1 else math.nan
    low, high = int(np.argmin(values)), int(np.argmax(values))
    return FigureSpread(
        name,
        values.size,
        mean,
        deviation,
        deviation / mean if mean > 0.0 else math.nan,
        own if own > 0.0 else math.nan,
        float(values[low]),
        of[low],
        float(values[high]),
        of[high],
        _outliers(of, values, uncertainty),
    )


def _outliers(names: Sequence[str], values: np.ndarray, uncertainty: np.ndarray) -> str:
    """Records far from the median, by the rule for repeated tests (``signals.scatter``)."""
    if values.size < MIN_RECORDS:
        return f"not told of {values.size}"
    if not np.median(values) > 0.0:
        return ""
    far = outliers(values[None], uncertainty[None], [""] * values.size)[1][0]
    return ", ".join(name for name, is_far in zip(names, far, strict=True) if is_far)
