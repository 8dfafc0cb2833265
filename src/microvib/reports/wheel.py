"""A wheel from its measured waterfalls for those who read it: harmonics, modes, waterfalls with the
ridges, and the files that a budget reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from microvib.analysis.margins import FREQUENCY_SIGMAS
from microvib.io.tables import rows_csv
from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.results import Table
from microvib.signals.ridges import PowerMap, Ridge
from microvib.studies.budget.files import LOADS_OF_WHEEL
from microvib.studies.wheel import (
    HarmonicRow,
    MeasuredWheel,
    ModeRow,
    Resonance,
    UnexplainedRow,
    speeds_in_words,
)
from microvib.studies.wheel_fit import ridge_paths

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DECADES = 3.0
"""Decades of amplitude that maps show in colour."""
_ACROSS = ("radial_force", "radial_torque")
"""Loads across the spin axis, which have two axes."""
_RPM = 2.0 * np.pi / 60.0
_MOST_NAMED = 4
"""Resonances without mode that the terminal names."""
_MODE_COLOUR = "#ff5c5c"
_HARMONICS_CAPTION = (
    "Coefficients times the square of the speed are amplitudes, 0-to-peak. Least and most are the ends of"
    " the 95 % interval by the scatter over speeds, and hold what is clearly seen at single speeds; a harmonic"
    " that is not seen in a load may be up to *most*. Two orders that no speed separates are one row, which has"
    " their rms together; as they beat, their crest may be 1.41 times its amplitude."
).replace("*", "")
_MODES_CAPTION = (
    "± are standard uncertainties of the fit, and least and most the ends of a damping with 95 % (0.0001 where no"
    " speed is near enough to the peak to tell). The budget's file has twice ±; a damping that only the width of a"
    " ridge tells counts from half to twice as much (assumed)."
)
_USE = (
    "`wheel.yaml` is a file of sources for `microvib budget --sources wheel.yaml`, once the wheel's place and"
    " axis on the hub are in it. A budget counts the intervals of coefficients and modes. The noise of the"
    " bearings is not in it: give that as `density`."
)


def wheel_outcome(found: MeasuredWheel) -> Outcome:
    """A measured wheel for those who read it."""
    low, high = (x / _RPM for x in found.speeds)
    orders = ", ".join(f"{x.order:.4g}" for x in found.harmonics) or "none"
    harmonics = Table.of(
        "harmonic_fits", HarmonicRow, found.harmonic_rows(), caption=_HARMONICS_CAPTION
    )
    modes = Table.of("modes", ModeRow, found.mode_rows(), caption=_MODES_CAPTION)
    rest = Table.of("unexplained", UnexplainedRow, found.unexplained_rows())
    return Outcome(
        "Wheel from its waterfalls",
        f"Harmonics and modes of {found.name or 'a wheel'}",
        f"Orders {orders}, from {low:.5g} to {high:.5g} rpm and up to {found.highest:.4g} Hz.",
        "",
        tuple(_facts(found)),
        (
            Part("", (Pairs(tuple(_about(found))), *_pictures(found))),
            Part("Harmonics", _or_none(harmonics, "No order stands above the noise.")),
            Part("Structural modes", _or_none(modes, "No mode is seen in the measured speeds.")),
            Part("What stays unexplained", _or_none(rest, "Nothing.")),
            Part("How to use it", (Text(_USE),) if found.harmonics else ()),
        ),
        other_files=_files_for_budget(found),
    )


def _or_none(table: Table, none: str) -> tuple[Item, ...]:
    return (table,) if table.rows else (Text(none), table)


def _facts(found: MeasuredWheel) -> Iterator[Fact]:
    yield Fact(str(len(found.harmonics)), "orders")
    yield Fact(str(len(found.modes)), "structural modes")
    yield Fact(str(len(found.unexplained_rows()) + len(found.more_peaks)), "unexplained")


def _not_measured(found: MeasuredWheel) -> list[str]:
    return [load for load in LOADS_OF_WHEEL if load not in found.maps]


def _of_one_axis(found: MeasuredWheel) -> list[str]:
    """Loads across the spin axis that were measured about one of two axes."""
    return [load for load, one in found.maps.items() if load in _ACROSS and not one.axes]


def _about(found: MeasuredWheel) -> Iterator[tuple[str, str]]:
    one = next(iter(found.maps.values()))
    yield "Loads", ", ".join(load.replace("_", " ") for load in found.maps)
    yield (
        "Spectra",
        f"{one.speed.size} speeds, {one.frequency.size} frequencies, {one.spacing:.4g} Hz apart",
    )
    missing = _not_measured(found)
    if missing:
        names = ", ".join(x.replace("_", " ") for x in missing)
        yield (
            "Note",
            f"{names}: not measured; a budget passes nothing until they are taken out of not_measured in wheel.yaml",
        )
    if one_axis := _of_one_axis(found):
        names = ", ".join(x.replace("_", " ") for x in one_axis)
        yield (
            "Note",
            f"{names}: measured about one of two axes, and the other may differ; a budget passes nothing until they"
            " are taken out of one_axis in wheel.yaml",
        )
    yield from (("Note", text) for text in _left_out(found))
    if not found.harmonics:
        yield (
            "Note",
            "no order stands above the noise at enough speeds: there is no file for a budget (average longer, or"
            " measure at more speeds)",
        )
    if found.resonances:
        yield "Note", _resonances_in_words(found.resonances)
    speed = found.measured
    gap = float(np.max(np.diff(speed)))
    if gap > 4.0 * float(np.median(np.diff(speed))):
        at = int(np.argmax(np.diff(speed)))
        ends = (speed[at] / _RPM, speed[at + 1] / _RPM)
        yield "Note", f"no speed was measured between {ends[0]:.5g} and {ends[1]:.5g} rpm"
    if found.more_peaks:
        yield "Note", f"{len(found.more_peaks)} more peaks are of no ridge"


def _resonances_in_words(resonances: Sequence[Resonance]) -> str:
    """A sentence on resonances that no mode explains."""
    first = [
        f"{one.load.replace('_', ' ')}, order {one.order:.4g}, {one.speed / _RPM:.5g} to {one.speed_to / _RPM:.5g} rpm"
        for one in resonances[:_MOST_NAMED]
    ]
    more = f" and {len(resonances) - _MOST_NAMED} more" if len(resonances) > _MOST_NAMED else ""
    return (
        "resonances that no mode explains, or peaks of no order, which may be larger between measured speeds:"
        f" {'; '.join(first)}{more} (measure there at speeds closer together, or with"
        " finer frequencies); a budget judges nothing there"
    )


def _left_out(found: MeasuredWheel) -> Iterator[str]:
    """Speeds and frequencies of the spectra that are not used."""
    failed = {load: x for load, x in found.failed.items() if x.any()}
    in_all = np.all(list(found.failed.values()), axis=0)
    speed = next(iter(found.maps.values())).speed
    if in_all.any():
        yield _failed_words(speed[in_all], "any load")
    for load, x in failed.items():
        if np.any(x & ~in_all):
            yield _failed_words(speed[x & ~in_all], load.replace("_", " "))
    if found.spectra_up_to > found.highest:
        yield (
            f"above {found.highest:.4g} Hz all orders or the noise fall off, as by the analyser's filter: left"
            " out, a budget judges nothing there"
        )


def _failed_words(speeds: np.ndarray, where: str) -> str:
    return (
        f"no order that other speeds show is seen in {where} at {speeds_in_words(speeds.tolist())}, as if the"
        " wheel stood or the run failed: left out"
    )


# ---- Files for a budget ----

_UNITS = {
    "radial_force": "n",
    "axial_force": "n",
    "radial_torque": "n_m",
    "axial_torque": "n_m",
}


def _files_for_budget(found: MeasuredWheel) -> dict[str, str]:
    """Files that a budget reads; none where no order is seen, which is no wheel without disturbance."""
    if not found.harmonics:
        return {}
    return {"harmonics.csv": harmonics_csv(found), "wheel.yaml": wheel_yaml(found)}


def harmonics_csv(found: MeasuredWheel) -> str:
    """Table of harmonics as ``wheel.table`` reads it."""
    columns = ["order", "order_error"]
    for load in found.maps:
        unit = f"{_UNITS[load]}_s2_rad2"
        columns += [f"{load}_{unit}", f"{load}_least_{unit}", f"{load}_most_{unit}"]
    rows = []
    for x in found.harmonics:
        row: list[float | str] = [x.order, float(f"{FREQUENCY_SIGMAS * x.uncertainty:.2g}")]
        for load in found.maps:
            c = x.coefficients[load]
            row += [c.value, c.least, c.most]
        rows.append(row)
    return rows_csv(columns, rows)


def wheel_yaml(found: MeasuredWheel) -> str:
    """File of sources with the wheel, whose place and axis are left to be filled in."""
    low, high = (x / _RPM for x in found.speeds)
    lines = [
        "# Wheel from its measured waterfalls. Fill in where it is on the hub: position (or point) and axis.",
        "sources:",
        "  - name: wheel",
        "    # position: [0.2 m, -0.3 m, 0.1 m]",
        "    wheel:",
        "      # axis: [0, 0, 1]",
        f"      speed: {low:.9g} rpm",
        f"      speed_to: {high:.9g} rpm",
        f"      measured_from: {low:.9g} rpm",
        f"      measured_to: {high:.9g} rpm",
        f"      measured_up_to: {found.highest:.6g} Hz",
        "      table: harmonics.csv",
    ]
    missing = _not_measured(found)
    if missing:
        lines.append(f"      not_measured: [{', '.join(missing)}]  # leave out what is zero")
    if one_axis := _of_one_axis(found):
        lines.append(
            f"      one_axis: [{', '.join(one_axis)}]  # leave out what is equal about both"
        )
    if found.resonances:
        lines.append(
            "      resonances:  # that no mode explains, or peaks of no order: nothing is judged there"
        )
    for one in found.resonances:
        ends = f"speed: {one.speed / _RPM:.9g} rpm, speed_to: {one.speed_to / _RPM:.9g} rpm"
        lines.append(f"        - {{load: {one.load}, order: {one.order:.5g}, {ends}}}")
    if found.modes:
        lines.append("      modes:")
    for x in found.modes:
        keys = f"motion: {x.motion}, frequency: {x.frequency:.6g} Hz, damping: {x.damping:.4g}"
        if x.motion == "rocking":
            keys += f", inertia_ratio: {x.inertia_ratio:.4g}"
        least, most = x.dampings
        error = 100.0 * x.frequency_error(found.speeds[1])
        lines.append(f"        - {{{keys}, frequency_error: {error:.3g} percent,")
        lines.append(f"           damping_least: {least:.4g}, damping_most: {most:.4g}}}")
    return "\n".join(lines) + "\n"


# ---- Pictures ----


def _pictures(found: MeasuredWheel) -> tuple[Picture, ...]:
    return tuple(
        Picture(
            f"waterfall_{load}",
            lambda load=load: draw_waterfall(found, load),  # type: ignore[misc]
            f"Waterfall of the {load.replace('_', ' ')} with the ridges",
            "White, dashed: orders. Red: modes of this load. Yellow: constant frequencies.",
        )
        for load in found.maps
    )


def draw_waterfall(found: MeasuredWheel, load: str) -> Figure:
    """Waterfall of a load over frequency and speed with ridges and modes."""
    one = found.maps[load]
    figure, ax = sheets.one_axes(3.8)
    _colours(ax, one, "N m" if load.endswith("torque") else "N")
    speed = np.linspace(one.speed[0], one.speed[-1], 200)
    styles = {"order": ("white", (0, (4, 3))), "line": ("#ffd33d", "solid")}
    for ridge in found.ridges:
        if ridge.kind in styles:
            colour, style = styles[ridge.kind]
            ax.plot(
                ridge_paths(ridge, speed)[0],
                speed / _RPM,
                color=colour,
                linestyle=style,
                linewidth=0.7,
            )
    motion = {"radial_force": "radial", "axial_force": "axial", "radial_torque": "rocking"}
    for mode in (x for x in found.modes if x.motion == motion.get(load)):
        as_ridge = Ridge("whirl", (mode.frequency, mode.inertia_ratio), 0.0, 0.0, (), 0.0)
        for path in ridge_paths(as_ridge, speed):
            ax.plot(path, speed / _RPM, color=_MODE_COLOUR, linewidth=0.9)
    ax.set(
        xlabel="frequency [Hz]", ylabel="speed [rpm]",
        xlim=(0.0, one.frequency[-1]), ylim=(one.speed[0] / _RPM, one.speed[-1] / _RPM),
    )  # fmt: skip
    _name_orders(ax, found, one)
    return figure


def _colours(ax: Axes, one: PowerMap, unit: str) -> None:
    """Amplitudes of lines in colours over the decades below the largest."""
    from matplotlib.colors import LogNorm

    amplitude = np.sqrt(2.0 * np.maximum(one.power, 0.0))
    top = max(float(amplitude[:, 1:].max()), 1e-300)
    mesh = ax.pcolormesh(
        one.frequency, one.speed / _RPM, np.maximum(amplitude, top * 10.0**-_DECADES),
        norm=LogNorm(top * 10.0**-_DECADES, top), cmap="viridis", shading="nearest", rasterized=True,
    )  # fmt: skip
    ax.figure.colorbar(mesh, ax=ax, label=f"amplitude of a bin, 0-to-peak [{unit}]")
    ax.grid(False)


def _name_orders(ax: Axes, found: MeasuredWheel, one: PowerMap) -> None:
    """Names of orders where their paths leave the picture."""
    for x in found.harmonics:
        at = min(0.97 * one.speed[-1], 0.95 * one.frequency[-1] * 2.0 * np.pi / x.order)
        if at <= one.speed[0]:
            continue
        ax.annotate(
            f"{x.order:.4g}", (x.order * at / (2.0 * np.pi), at / _RPM), fontsize=7, ha="center",
            va="center", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip
