"""A reaction wheel from its measured waterfalls: harmonics with intervals, structural modes, and what
stays unexplained.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from microvib.analysis.margins import FREQUENCY_SIGMAS
from microvib.results import FREQUENCY, ORDER, Column, Measure
from microvib.signals.close_orders import told_apart
from microvib.signals.ridges import (
    FIRST_BIN,
    PowerMap,
    Ridge,
    RidgeSearch,
    find_ridges,
    whirl_paths,
)
from microvib.studies.wheel_fit import (
    MOTIONS,
    Coefficient,
    FoundMode,
    Reading,
    amplification_of,
    bound_coefficient,
    factor_of,
    find_modes,
    fit_coefficient,
    over_axes,
    read_apart,
    read_order,
)
from microvib.studies.wheel_gaps import Fit, failed_speeds, require_power, usable_bins
from microvib.studies.wheel_masked import held_at_all_speeds, largest_power

COEFFICIENT = Measure(form=".4g")
SPEED = Measure("rpm", 2.0 * np.pi / 60.0, ".5g", file_size=2.0 * np.pi / 60.0)
RATIO = Measure(form=".3g")
_BROAD = 3.0
"""Widths of a line of the spectra from which a ridge of a constant frequency is a resonance."""
_MAINS = (50.0, 60.0)
_MOST_LEFT = 10
"""Peaks of no ridge that are named, the largest ones."""
_CHANCE = 1e-3
"""Chance that noise has any peak that is named."""
_EXPLAINED = 1.5
"""Factor of the power of orders with their largest coefficients that a peak must be above."""
_DRIVEN, _USUAL_DRIVEN = 4.0, 0.95
"""Factor of the level, and the quantile that it is of the levels beside modes, that what noise makes of a mode
does not reach."""
_NEIGHBOURS, _SAME_ORDER = 2, 0.02
"""Speeds from one peak to the next, and part by which their orders differ, up to which they are together."""
_MOST_SPEEDS = 4
"""Speeds that are named one by one."""


@dataclass(frozen=True)
class HarmonicRow:
    """A harmonic in one load."""

    order: Annotated[float, Column("order", "order", ORDER)]
    uncertainty: Annotated[float, Column("order_uncertainty", "±", Measure(form=".2g"))]
    load: Annotated[str, Column("load", "load")]
    value: Annotated[float, Column("coefficient", "coefficient", COEFFICIENT)]
    least: Annotated[float, Column("coefficient_least", "least", COEFFICIENT)]
    most: Annotated[float, Column("coefficient_most", "most", COEFFICIENT)]
    unit: Annotated[str, Column("unit", "unit")]
    speeds: Annotated[float, Column("speeds", "speeds", Measure(form=".0f"))]
    remark: Annotated[str, Column("remark", "remark")]


@dataclass(frozen=True)
class ModeRow:
    """A structural mode of the wheel."""

    motion: Annotated[str, Column("motion", "mode")]
    frequency: Annotated[float, Column("frequency_hz", "frequency at rest", FREQUENCY)]
    frequency_error: Annotated[float, Column("frequency_uncertainty_hz", "±", FREQUENCY)]
    damping: Annotated[float, Column("damping", "damping", RATIO)]
    damping_least: Annotated[float, Column("damping_least", "least", RATIO)]
    damping_most: Annotated[float, Column("damping_most", "most", RATIO)]
    ratio: Annotated[float, Column("inertia_ratio", "inertia ratio", RATIO)]
    ratio_error: Annotated[float, Column("inertia_ratio_uncertainty", "±", Measure(form=".2g"))]
    how: Annotated[str, Column("found_by", "found by")]


@dataclass(frozen=True)
class UnexplainedRow:
    """Ridge or peak that is of no order and no mode."""

    what: Annotated[str, Column("what", "what")]
    load: Annotated[str, Column("load", "load")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    speed: Annotated[float, Column("speed_rpm", "at", SPEED)]
    amplitude: Annotated[float, Column("amplitude", "amplitude", COEFFICIENT)]
    unit: Annotated[str, Column("unit", "unit")]


@dataclass(frozen=True)
class Resonance:
    """Speeds between which an order has a resonance in a load that no mode explains, or a peak that is of no
    order.
    """

    load: str
    order: float
    speed: float
    """[rad/s]."""
    speed_to: float
    """[rad/s]."""


@dataclass(frozen=True)
class Harmonic:
    """An order with its coefficients."""

    order: float
    uncertainty: float
    coefficients: Mapping[str, Coefficient]
    """By load."""


@dataclass(frozen=True)
class MeasuredWheel:
    """A wheel as its waterfalls show it."""

    name: str
    maps: Mapping[str, PowerMap]
    """By load."""
    ridges: tuple[Ridge, ...]
    harmonics: tuple[Harmonic, ...]
    """Ascending by order."""
    modes: tuple[FoundMode, ...]
    unexplained: tuple[UnexplainedRow, ...]
    more_peaks: tuple[UnexplainedRow, ...]
    """Peaks of no ridge that are not in these, the largest first."""
    failed: Mapping[str, np.ndarray]
    """Speeds (n,) of each load that are left out, as they do not show the wheel."""
    spectra_up_to: float
    """Frequency up to which there are spectra [Hz]: above ``highest`` a filter weakens them."""

    @property
    def measured(self) -> np.ndarray:
        """Speeds at which all loads show the wheel [rad/s]."""
        one = next(iter(self.maps.values()))
        return np.asarray(one.speed[~np.any(list(self.failed.values()), axis=0)])

    @property
    def speeds(self) -> tuple[float, float]:
        """Ends of the measured speeds [rad/s]."""
        return float(self.measured[0]), float(self.measured[-1])

    @property
    def highest(self) -> float:
        """Frequency up to which it was measured [Hz]."""
        one = next(iter(self.maps.values()))
        return float(one.frequency[-1])

    @property
    def _resonances_of_orders(self) -> list[Resonance]:
        return [
            Resonance(load, one.order, *ends)
            for one in self.harmonics
            for load, c in one.coefficients.items()
            for ends in c.resonances
        ]

    @property
    def resonances(self) -> list[Resonance]:
        """Resonances of its orders that no mode explains, and the named peaks that are of no order."""
        found = self._resonances_of_orders
        peaks = [row for row in (*self.unexplained, *self.more_peaks) if np.isfinite(row.speed)]
        for load in dict.fromkeys(row.load for row in peaks):
            found += _speeds_of_peaks([row for row in peaks if row.load == load], self.measured)
        return found

    def unexplained_rows(self) -> list[UnexplainedRow]:
        """Ridges and peaks that are of no order and no mode, and resonances of orders without a mode, each at
        the middle of its speeds.
        """
        rows = list(self.unexplained)
        for one in self._resonances_of_orders:
            speed = 0.5 * (one.speed + one.speed_to)
            f = one.order * speed / (2.0 * np.pi)
            what = f"resonance of order {one.order:.4g} without a mode"
            rows.append(UnexplainedRow(what, _words(one.load), f, speed, np.nan, _unit(one.load)))
        return rows

    def harmonic_rows(self) -> list[HarmonicRow]:
        """Harmonics by order and load."""
        return [
            HarmonicRow(
                x.order, x.uncertainty, _words(load), c.value, c.least, c.most,
                _unit(load, "s²/rad²"), c.speeds, _remark(c),
            )
            for x in self.harmonics
            for load, c in x.coefficients.items()
        ]  # fmt: skip

    def mode_rows(self) -> list[ModeRow]:
        """Modes with their uncertainties."""
        return [
            ModeRow(
                x.motion, x.frequency, x.uncertainty[0], x.damping, *x.dampings,
                x.inertia_ratio if x.motion == "rocking" else np.nan,
                x.uncertainty[1] if x.motion == "rocking" else np.nan, x.how,
            )
            for x in self.modes
        ]  # fmt: skip


def measured_wheel(maps: Mapping[str, PowerMap], name: str = "") -> MeasuredWheel:
    """Find the harmonics and structural modes of a reaction wheel in its measured waterfalls.

    Parameters
    ----------
    maps : mapping of str to PowerMap
        Waterfall of each load that was measured: ``radial_force`` and ``axial_force`` [N],
        ``radial_torque`` and ``axial_torque`` [N m], on one grid of speeds and frequencies.
    name : str
        Name of the wheel.

    Returns
    -------
    MeasuredWheel
        Harmonics with their coefficients (load over speed squared) and 95 % intervals, modes, and
        the peaks that neither explains. Speeds at which no order of a load is seen, and frequencies
        above which all orders or the floor fall off, are left out.

    Raises
    ------
    MicrovibError
        Where a load is zero everywhere, or too few speeds show the orders.
    """
    require_power(maps)
    search = _ridges(maps)
    fits, modes = _fits(maps, search, _all_kept(maps))
    whole = next(iter(maps.values()))
    count = usable_bins(maps, fits)
    if count < whole.frequency.size:
        maps = {load: one.up_to_bin(count) for load, one in maps.items()}
        search = _ridges(maps)
        fits, modes = _fits(maps, search, _all_kept(maps))
    failed = failed_speeds(maps, fits)
    if any(x.any() for x in failed.values()):
        fits, modes = _fits(maps, search, {load: ~x for load, x in failed.items()})
    orders = sorted(_of_kind(search, "order"), key=lambda x: x.values[0])
    harmonics = [
        Harmonic(
            _rounded(x), x.uncertainty,
            {one.load: one.coefficient for one in fits if one.reading.order == x.values[0]},
        )
        for x in orders
    ]  # fmt: skip
    peaks: list[tuple[float, UnexplainedRow]] = []
    for (load, one), of_no_order in zip(maps.items(), search.of_no_order, strict=True):
        ignored = of_no_order | failed[load][:, None]
        peaks += _peaks_left(load, one, fits, modes, search, ignored)
    peaks.sort(key=lambda x: -x[0])
    named = [row for _, row in peaks[:_MOST_LEFT]]
    return MeasuredWheel(
        name, maps, search.ridges, tuple(harmonics), tuple(modes),
        (*_constant(maps, search.ridges), *named), tuple(row for _, row in peaks[_MOST_LEFT:]), failed,
        float(whole.frequency[-1]),
    )  # fmt: skip


def _ridges(maps: Mapping[str, PowerMap]) -> RidgeSearch:
    each = list(maps.values())
    return told_apart(each, find_ridges(each))


def _of_kind(search: RidgeSearch, kind: str) -> list[Ridge]:
    return [x for x in search.ridges if x.kind == kind]


def _all_kept(maps: Mapping[str, PowerMap]) -> dict[str, np.ndarray]:
    return {load: np.ones(one.speed.size, dtype=bool) for load, one in maps.items()}


def _fits(
    maps: Mapping[str, PowerMap], search: RidgeSearch, kept: Mapping[str, np.ndarray]
) -> tuple[list[Fit], list[FoundMode]]:
    """Coefficients of all orders in all loads, by the speeds of each load that are ``kept``, and modes."""
    orders, whirls = _of_kind(search, "order"), _of_kind(search, "whirl")
    modes: list[FoundMode] = []
    fits: list[Fit] = []
    for load, one in maps.items():
        readings = [read_order(one, x.values[0], search.ridges, kept[load]) for x in orders]
        own = find_modes(load, readings, whirls)
        modes += own
        of_load: list[Fit] = []
        for reading in readings:
            factor = amplification_of(own, reading)
            alone = (
                read_order(axis, reading.order, search.ridges, kept[load]) for axis in one.of_axes
            )
            c = over_axes(
                fit_coefficient(reading, factor), [fit_coefficient(x, factor) for x in alone]
            )
            if not np.isfinite(c.most):
                factor_at_all = factor_of(own, reading.order, one.speed)
                bound = bound_coefficient(one, reading.order, factor_at_all, kept[load])
                c = replace(c, most=bound, usual=bound, bounded=True)
                told = _told_apart(
                    one, reading.order, [x.values[0] for x in orders], own, kept[load]
                )
                if told.value > 0.0:
                    c = replace(told, most=max(bound, told.most), usual=max(bound, told.usual))
            of_load.append(Fit(load, reading, factor, c))
        fits += held_at_all_speeds(of_load, one, search.ridges, own, kept[load])
    if "radial_torque" not in maps:
        modes += find_modes("radial_torque", _NONE, whirls)
    return fits, modes


def _told_apart(
    one: PowerMap,
    order: float,
    orders: Sequence[float],
    modes: Sequence[FoundMode],
    kept: np.ndarray,
) -> Coefficient:
    """The coefficient of an order that others mask, by the lines of all at once."""
    readings = [read_apart(x, order, orders, kept) for x in (one, *one.of_axes)]
    mean, *axes = (fit_coefficient(x, amplification_of(modes, x)) for x in readings)
    return over_axes(mean, axes)


def _rounded(ridge: Ridge) -> float:
    """An order to the digit of its uncertainty."""
    return round(ridge.values[0], max(-int(np.floor(np.log10(ridge.uncertainty))), 0))


_NONE: tuple[Reading, ...] = ()


def _words(load: str) -> str:
    return load.replace("_", " ")


def _unit(load: str, per: str = "") -> str:
    return f"{'N m' if load.endswith('torque') else 'N'} {per}".rstrip()


def speeds_in_words(speeds: Sequence[float]) -> str:
    """Some speeds [rad/s] as text, in rpm: all of them, or of many how many and between which."""
    rpm = [f"{x / SPEED.size:.5g}" for x in speeds]
    if len(rpm) > _MOST_SPEEDS:
        return f"{len(rpm)} speeds from {rpm[0]} to {rpm[-1]} rpm"
    return f"{', '.join(rpm[:-1])} and {rpm[-1]} rpm" if len(rpm) > 1 else f"{rpm[0]} rpm"


def _remark(one: Coefficient) -> str:
    if one.bounded:
        return "masked by other ridges at every speed: an upper bound"
    said = ["not seen"] if one.value == 0.0 and not one.large else []
    if one.value == 0.0 and one.large:
        said.append(f"seen at {speeds_in_words(one.large)} alone, which most holds")
    if one.value > 0.0 and one.large:
        said.append(f"larger at {speeds_in_words(one.large)}, which most holds")
    if one.weak:
        said.append(
            f"less than half of it, or absent, at {speeds_in_words(one.weak)}: least holds that"
        )
    if one.near_modes:
        said.append("near a mode at all speeds")
    if one.axes_differ:
        said.append("its axes differ: the interval holds either")
    return ", ".join(said)


def _constant(maps: Mapping[str, PowerMap], ridges: Sequence[Ridge]) -> list[UnexplainedRow]:
    """Ridges whose frequency does not follow the speed."""
    found = []
    for ridge in (x for x in ridges if x.kind == "line"):
        f = ridge.values[0]
        load = max(
            maps, key=lambda x: float(np.median(_line_power(maps[x], f) / maps[x].floor.mean()))
        )
        one = maps[load]
        amplitude = float(np.sqrt(2.0 * max(float(np.median(_line_power(one, f))), 0.0)))
        found.append(
            UnexplainedRow(
                _constant_words(ridge, one), _words(load), f, np.nan, amplitude, _unit(load)
            )
        )
    return found


def _line_power(one: PowerMap, frequency: float) -> np.ndarray:
    at = int(one.bins(np.array(frequency)))
    near = slice(max(at - one.lobe, 0), at + one.lobe + 1)
    return np.asarray((one.power[:, near] - one.floor[:, near]).sum(axis=1))


def _constant_words(ridge: Ridge, one: PowerMap) -> str:
    f = ridge.values[0]
    if ridge.width > _BROAD * one.spacing:
        return "resonance that does not move with the speed"
    for mains in _MAINS:
        if f > 0.5 * mains and abs(f - mains * round(f / mains)) <= one.spacing:
            return f"constant frequency, as mains of {mains:g} Hz"
    return "constant frequency"


_SKIRT = 6.0
"""Half-widths of a mode within which what noise makes of it is taken for it."""


def _beside(modes: Sequence[FoundMode], one: PowerMap) -> np.ndarray:
    """Cells within the skirts of modes, (n, m)."""
    near = np.zeros(one.power.shape, dtype=bool)
    for mode in modes:
        still = np.array([mode.frequency])
        paths = whirl_paths(still, np.array([mode.inertia_ratio]), one.speed)[:, 0]
        reach = _SKIRT * mode.damping * mode.frequency + (one.lobe + 1) * one.spacing
        for path in paths:
            near |= np.abs(one.frequency - path[:, None]) < reach
    return near


def _peaks_left(
    load: str,
    one: PowerMap,
    fits: Sequence[Fit],
    modes: Sequence[FoundMode],
    search: RidgeSearch,
    ignored: np.ndarray,
) -> Iterator[tuple[float, UnexplainedRow]]:
    """Peaks of a load, with their levels over the floor, that noise does not have, and that neither orders with
    their largest coefficients explain nor noise that excites modes; cells (n, m) of constant lines, whirl and
    failed speeds are ``ignored``.
    """
    from scipy.stats import gamma

    K = one.averages
    errors = {x.values[0]: FREQUENCY_SIGMAS * x.uncertainty for x in _of_kind(search, "order")}
    of_load = [fit for fit in fits if fit.load == load]
    own = [mode for mode in modes if mode.motion == MOTIONS.get(load)]
    off = [errors[fit.reading.order] for fit in of_load]
    explained = largest_power(one, of_load, own, off)
    level = np.where(ignored, 0.0, (one.power - _EXPLAINED * explained) / one.floor)
    level[:, :FIRST_BIN] = 0.0
    beside = _beside(modes, one)
    if beside.any():
        level[beside & (level < _DRIVEN * np.quantile(level[beside], _USUAL_DRIVEN))] = 0.0
    wanted = float(gamma.isf(_CHANCE / level.size, K) / K)
    inner = level[:, 1:-1]
    peak = (inner > 1.5 * wanted) & (inner >= level[:, :-2]) & (inner >= level[:, 2:])
    for i, j in zip(*np.nonzero(peak), strict=True):
        near = slice(max(j + 1 - one.lobe, 0), j + 2 + one.lobe)
        amplitude = float(np.sqrt(2.0 * one.power[i, near].sum()))
        row = UnexplainedRow(
            "single peak", _words(load), float(one.frequency[j + 1]), float(one.speed[i]),
            amplitude, _unit(load),
        )  # fmt: skip
        yield float(level[i, j + 1]), row


def _speeds_of_peaks(rows: Sequence[UnexplainedRow], measured: np.ndarray) -> list[Resonance]:
    """Peaks of one load at neighbouring speeds of those that were ``measured`` (n,), whose orders are about
    one, together.
    """
    groups: list[list[UnexplainedRow]] = []
    for row in sorted(rows, key=lambda x: x.speed):
        order = row.frequency / row.speed
        at = np.searchsorted(measured, row.speed)
        for group in groups:
            last = group[-1]
            near = at - np.searchsorted(measured, last.speed) <= _NEIGHBOURS
            if near and abs(order * last.speed / last.frequency - 1.0) < _SAME_ORDER:
                group.append(row)
                break
        else:
            groups.append([row])
    found = []
    for group in groups:
        order = 2.0 * np.pi * float(np.median([x.frequency / x.speed for x in group]))
        start, stop = (int(np.searchsorted(measured, x.speed)) for x in (group[0], group[-1]))
        ends = measured[[max(start - 1, 0), min(stop + 1, measured.size - 1)]]
        found.append(Resonance(group[0].load.replace(" ", "_"), order, *ends.tolist()))
    return found
