"""Order tracking for those who read it: maxima, order cuts over speed, order map, Campbell diagram."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from microvib.reports import sheets
from microvib.reports.analysis_units import CHANNEL_KINDS, measure_in_unit, table_in_unit
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.sheets import COLOURS, GREY
from microvib.reports.typography import file_name
from microvib.results import FREQUENCY, TORQUE, Table
from microvib.signals.spectrum import window_name
from microvib.studies.cut_limits import CutLimits, CutMargin
from microvib.studies.track import (
    BEYOND,
    NOT_SEPARABLE,
    TRACKED,
    CutPoint,
    Maximum,
    OrderCut,
    OrderTracking,
    Resonance,
)
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DECADES = 3.0
"""Decades of amplitude that maps show in colour."""
_NAME_ROOM = 0.08
"""Part of an axis that a name takes."""
_MOST_CUTS = 8
"""Orders, the largest ones, that a picture has room for."""
_MAXIMA_CAPTION = (
    "Amplitudes 0-to-peak; ± is one standard uncertainty, from the floor beside the order and from the"
    " change of the amplitude at half the bandwidth."
)
_RESONANCE_CAPTION = (
    "Frequencies at which cuts of orders have peaks that are higher than their surroundings."
)


def order_outcome(found: OrderTracking, against: CutLimits | None = None) -> Outcome:
    """Orders of a sweep for those who read it; ``against`` a limit where one was given."""
    maxima = Table.of("maxima", Maximum, found.maxima, caption=_MAXIMA_CAPTION)
    resonances = Table.of("resonances", Resonance, found.resonances, caption=_RESONANCE_CAPTION)
    points = chain.from_iterable(cut.points() for cut in found.cuts)
    cuts = Table.of("order_cuts", CutPoint, points, for_readers=())
    return Outcome(
        "Order tracking report",
        f"Orders of {file_name(found.name)}, channel {found.channel}",
        f"Order cuts, order map and waterfall of {CHANNEL_KINDS[found.unit]} through a rate sweep.",
        "" if against is None else against.verdict,
        tuple(_facts(found)),
        (
            Part("", (Pairs(tuple(_about(found))), _cuts_picture(found))),
            Part("Against the limit", _against_limit(against, found.unit)),
            Part("Maxima of the orders", (table_in_unit(maxima, found.unit),), new_page=True),
            Part("Resonances that orders cross", (resonances,)),
            _picture_part("Phases", _PHASE_TEXT, _phases_picture(found)),
            _picture_part("Order map", f"{_capital(str(found.order_map))}.", _map_picture(found)),
            _picture_part("Waterfall", _campbell_text(found), _campbell_picture(found)),
        ),
        files=(table_in_unit(cuts, found.unit),),
    )


def _against_limit(against: CutLimits | None, unit: str) -> tuple[Item, ...]:
    """The verdict by a limit, and the orders by their margins."""
    if against is None:
        return ()
    table = Table.of("cut_margins", CutMargin, against.margins, caption=_MARGINS_CAPTION)
    return (Text(against.words), table_in_unit(table, unit))


_MARGINS_CAPTION = (
    "The point of each order with the least margin. The limit is the least within the bandwidth and up to the"
    " next points; an order is above it where it exceeds the most of it by two uncertainties. *Told* is the"
    " part of the order's way through the limit's frequencies at which its amplitude is known."
).replace("*", "")


def _picture_part(title: str, text: str, picture: Picture) -> Part:
    """A picture and how it was made, which a terminal does not show."""
    return Part(title, (Text(text), picture), not_on_terminal=True)


_PHASE_TEXT = (
    "Phases are those of cosines, from the phase of the reference: order times its revolutions since the"
    " first sample. They turn by half a turn where an order crosses a lightly damped resonance."
)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _campbell_text(found: OrderTracking) -> str:
    w = found.waterfall
    return (
        f"{_capital(window_name(w.window))}, {1.0 / w.resolution:.3g} s, resolution"
        f" {w.resolution:.3g} Hz; lines are the orders that were tracked."
    )


def _about(found: OrderTracking) -> Iterator[tuple[str, str]]:
    """Source, reference, bandwidth, and what could not be told."""
    speed = found.reference.speed(found.recording.sample_rate)
    yield "Source", f"{file_name(found.name)}, channel {found.channel}"
    yield (
        "Record",
        f"{found.recording.samples} samples at {found.recording.sample_rate:g} Hz,"
        f" {found.recording.duration:g} s",
    )
    yield "Reference", f"{found.reference.words}; order 1 is once per {found.reference.name}"
    yield "Speed", f"{speed[0]:.5g} Hz at the start, {speed[-1]:.5g} Hz at the end"
    clock = found.reference.clock
    if clock is not None and np.any(clock.correction != 0.0):
        low, high = clock.correction.min(), clock.correction.max()
        yield (
            "Clock",
            f"{100.0 * low:+.3g} to {100.0 * high:+.3g} % beside the stated speed,"
            f" mean ± {100.0 * clock.uncertainty:.1g} %",
        )
    yield "Bandwidth", f"{found.bandwidth:.3g} Hz about each order"
    for note in (*found.recording.notes_on(found.channel), *found.notes):
        if note:
            yield "Note", note


def _facts(found: OrderTracking) -> Iterator[Fact]:
    amplitude = measure_in_unit(TORQUE, found.unit)
    known = [one for one in found.maxima if math.isfinite(one.amplitude)]
    for one in sorted(known, key=lambda one: -one.amplitude)[:3]:
        where = f"order {one.order} at {FREQUENCY.figure(one.frequency)}"
        yield Fact(amplitude.figure(one.amplitude), where)


def _cuts_picture(found: OrderTracking) -> Picture:
    def draw() -> Figure:
        figure, ax = sheets.one_axes(4.4)
        draw_cuts(ax, found)
        return figure

    return Picture("order_cuts", draw, "Order cuts")


def draw_orders(found: OrderTracking) -> Figure:
    """Order cuts, and the waterfall with the paths of the orders below them."""
    figure, axes = sheets.sheet(7.4, 2, 1)
    draw_cuts(axes[0, 0], found)
    draw_campbell(axes[1, 0], found)
    return figure


def _largest_cuts(found: OrderTracking) -> list[OrderCut]:
    """Cuts that a picture shows, ascending in order; the largest where there are many."""
    size = {id(one): float(np.max(np.where(one.known, one.amplitude, 0.0))) for one in found.cuts}
    chosen = sorted(found.cuts, key=lambda one: -size[id(one)])[:_MOST_CUTS]
    return [one for one in found.cuts if any(one is each for each in chosen)]


def _across(found: OrderTracking) -> tuple[str, bool]:
    """Label of the axis of speed, and whether it is time instead, as where the speed goes both ways."""
    speed = found.cuts[0].speed
    steps = np.diff(speed)
    one_way = np.mean(steps > 0.0) > 0.98 or np.mean(steps < 0.0) > 0.98
    if one_way:
        return f"speed [{found.reference.name}s per second]", False
    return "time [s]", True


def draw_cuts(ax: Axes, found: OrderTracking) -> None:
    """Amplitude of each order over speed with a band of two standard uncertainties; where an order
    is not told, its curve is broken.
    """
    label, in_time = _across(found)
    for k, cut in enumerate(_largest_cuts(found)):
        x = cut.time if in_time else cut.speed
        y = 1e3 * np.where(cut.known, cut.amplitude, np.nan)
        u = 2e3 * cut.uncertainty
        colour = COLOURS[k % len(COLOURS)]
        style = "-" if k < len(COLOURS) else "--"
        name = cut.label if math.isnan(cut.order) else f"order {cut.label}"
        ax.fill_between(x, np.maximum(y - u, 0.0), y + u, color=colour, alpha=0.2, linewidth=0)
        ax.plot(x, y, style, color=colour, linewidth=1.2, label=name)
    ax.set(xlabel=label, ylabel=f"amplitude, 0-to-peak [m{pretty(found.unit)}]")
    ax.margins(x=0)
    ax.set_ylim(bottom=0.0, top=1.18 * ax.get_ylim()[1])
    ax.legend(loc="upper center", fontsize=7.5, ncols=min(len(found.cuts), 4))


def _phases_picture(found: OrderTracking) -> Picture:
    def draw() -> Figure:
        figure, ax = sheets.one_axes(2.7)
        label, in_time = _across(found)
        for k, cut in enumerate(_largest_cuts(found)):
            x = cut.time if in_time else cut.speed
            turned = np.degrees(np.angle(np.exp(1j * cut.phase)))
            ax.plot(
                x,
                np.where(cut.finding == TRACKED, turned, np.nan),
                ".",
                markersize=2.5,
                color=COLOURS[k % len(COLOURS)],
                label=cut.label if math.isnan(cut.order) else f"order {cut.label}",
            )
        ax.set(xlabel=label, ylabel="phase [deg]", ylim=(-190, 260), yticks=range(-180, 181, 90))
        ax.margins(x=0)
        ax.legend(loc="upper center", fontsize=7.5, ncols=min(len(found.cuts), 8), markerscale=3)
        return figure

    return Picture("phases", draw, "Phases of the orders")


def _map_picture(found: OrderTracking) -> Picture:
    def draw() -> Figure:
        figure, ax = sheets.one_axes(3.4)
        m = found.order_map
        _, in_time = _across(found)
        y, what = (m.time, "time [s]") if in_time else (m.speed, _across(found)[0])
        _colours(ax, m.order, y, 1e3 * m.amplitude, f"m{pretty(found.unit)}")
        ax.set(xlabel=f"order of the {found.reference.name}", ylabel=what)
        return figure

    return Picture("order_map", draw, "Order map")


def _campbell_picture(found: OrderTracking) -> Picture:
    def draw() -> Figure:
        figure, ax = sheets.one_axes(3.8)
        draw_campbell(ax, found)
        return figure

    return Picture("campbell", draw, "Waterfall with the orders, over frequency and speed")


def draw_campbell(ax: Axes, found: OrderTracking) -> None:
    """Waterfall over frequency, and speed or time, with the paths of the orders."""
    w, cut = found.waterfall, found.cuts[0]
    label, in_time = _across(found)
    time = w.time + (cut.time[0])
    y = time if in_time else np.interp(time, cut.time, cut.speed)
    top = min(1.15 * max(float(np.max(one.frequency)) for one in found.cuts), w.frequency[-1])
    keep = (w.frequency > 0.0) & (w.frequency <= top)
    _colours(ax, w.frequency[keep], y, 1e3 * w.amplitude[:, keep], f"m{pretty(found.unit)}")
    for one in _largest_cuts(found):
        shown = np.where((one.finding == BEYOND) | (one.finding == NOT_SEPARABLE), np.nan, 1.0)
        along = one.time if in_time else one.speed
        ax.plot(one.frequency * shown, along, color="white", linewidth=0.6, linestyle=(0, (4, 3)))
    _name_paths(ax, _largest_cuts(found), in_time, top)
    ax.set(xlabel="frequency [Hz]", ylabel=label)


def _name_paths(ax: Axes, cuts: Sequence[OrderCut], in_time: bool, top: float) -> None:
    """Names near the ends of the paths of orders, in rows where paths are close to each other."""
    ends: list[tuple[float, float, str]] = []
    for one in cuts:
        inside = np.flatnonzero(one.frequency < 0.97 * top)
        at = inside[int(0.97 * (inside.size - 1))]
        along = one.time if in_time else one.speed
        ends.append((float(one.frequency[at]), float(along[at]), one.label))
    taken: list[float] = []
    for frequency, height, name in sorted(ends):
        row = sum(abs(frequency - other) < _NAME_ROOM * top for other in taken)
        taken.append(frequency)
        ax.annotate(
            name,
            (frequency, height),
            xytext=(0, -8 - 13 * row),
            textcoords="offset points",
            fontsize=7,
            ha="center",
            bbox={"facecolor": "white", "edgecolor": GREY, "pad": 0.8, "linewidth": 0.4},
        )


def _colours(ax: Axes, x: np.ndarray, y: np.ndarray, amplitude: np.ndarray, unit: str) -> None:
    """A map of amplitudes, in colours over the decades below the largest."""
    from matplotlib.colors import LogNorm

    order = np.argsort(y, kind="stable")
    top = max(float(np.max(amplitude)), 1e-300)
    low = top * 10.0**-_DECADES
    mesh = ax.pcolormesh(
        x,
        y[order],
        np.maximum(amplitude[order], low),
        norm=LogNorm(low, top),
        cmap="viridis",
        shading="nearest",
        rasterized=True,
    )
    ax.figure.colorbar(mesh, ax=ax, label=f"amplitude, 0-to-peak [{unit}]")
    ax.grid(False)
