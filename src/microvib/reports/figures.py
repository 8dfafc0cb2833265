"""Figures: time history, spectrum with named lines and limit, zoom on the array mode, torques
through one full step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.analysis.limits import Judgement
from microvib.analysis.spectra import spectrum
from microvib.model.linear import coupled_modes
from microvib.model.presliding import quasi_static_torque
from microvib.reports.sheets import (
    BLUE,
    COLOURS,
    GREY,
    RED,
    legend_name,
    name_points,
    new_figure,
    one_axes,
    plain_numbers,
    plain_sheet,
)
from microvib.signals.line_table import BELOW_FLOOR, Line, LineTable
from microvib.signals.screen import extremes
from microvib.signals.spectrum import Density, Spectrum, Waterfall, amplitude_spectrum, window_name
from microvib.solve.motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Spectral = Spectrum | Density | Waterfall
"""Curves over frequency."""
_POINTS = 2000
"""Groups of samples that a time history is drawn of, at least where there are more."""
_RIGHT_OF_LAST = 1.15
"""Times the highest frequency that a logarithmic axis reaches, for names."""
_NEAREST_NAMED = 3
"""Lines that are named for being nearest to a limit, besides those above it."""
_ABOVE_NAMED = 1.0
"""Room above the highest named line for its name and a legend [inch]."""
_WORTH_NAMING = 1e-2
"""Part of the largest line from which a line is worth a name where lines crowd."""
_LOW_PART = 0.12
"""Part of a linear axis in which lines are too near to each other to be named ..."""
_CROWD = 4
"""... if there are so many of them."""
_SHOWN_MICROSTEPS = 4.0
"""At the start of a record that are drawn."""


def draw_overview(motion: Motion, table: LineTable) -> Figure:
    """Overview of a run: history and a stretch of it, spectrum with named lines, zoom on the array
    mode.
    """
    figure, axes = new_figure(12.0, 7.2, 2, 2)
    draw_history(axes[0, 0], motion)
    draw_microsteps(axes[0, 1], motion)
    draw_spectrum(axes[1, 0], motion, table)
    draw_array_zoom(axes[1, 1], motion, table)
    figure.suptitle(motion.scenario.title or "microvib run")
    return figure


def spectrum_upper_end(lines: Iterable[Line]) -> float:
    """Upper end [Hz] of a spectrum that shows all the lines, at least 200 Hz."""
    return max([200.0, *(1.08 * x.frequency for x in lines)])


def draw_first_page(
    motion: Motion, table: LineTable, highest: float, judged: Judgement | None = None
) -> Figure:
    """The picture of a report's first page: spectrum with named lines and limit, and the time
    history below it.
    """
    figure, axes = plain_sheet(5.5, 2, 1)
    spectrum_ax, history_ax = axes[:, 0]
    spectrum_ax.get_gridspec().set_height_ratios((1.7, 1.0))
    figure.subplots_adjust()  # moves the axes
    draw_spectrum(spectrum_ax, motion, table, highest, judged)
    draw_history(history_ax, motion)
    return figure


def draw_history(ax: Axes, motion: Motion) -> None:
    """Disturbance torque over the record (as Figure 9b, drive axis), peaks kept when points are
    merged.
    """
    size = max(motion.time.size // _POINTS, 1)
    low, high = extremes(1e3 * motion["T_d"], size)
    ax.fill_between(motion.time[::size], low, high, color=BLUE, linewidth=0.4, edgecolor=BLUE)
    ax.set(
        xlabel="time [s]",
        ylabel="disturbance torque [mN m]",
        title="Time history about the drive axis",
    )
    ax.margins(x=0)


def draw_microsteps(ax: Axes, motion: Motion) -> None:
    """A few microsteps at the start of the record, with the time that the shaft sticks shaded."""
    t = _first_microsteps_time(motion)
    ax.plot(t, 1e3 * motion["T_d"][: t.size], color=BLUE, linewidth=1.4)
    title = f"Disturbance torque through {_SHOWN_MICROSTEPS:g} microsteps"
    ax.set(xlabel="time in the record [ms]", ylabel="torque [mN m]", title=title)
    ax.margins(x=0)
    _headroom(ax, 0.2)
    if "stuck_output" in motion.channels and _shade_stuck(ax, motion, t):
        ax.legend(loc="upper right", fontsize=8)


def _first_microsteps_time(motion: Motion) -> np.ndarray:
    """Times of the first microsteps from the start of the record on [ms]."""
    f_d = motion.scenario.driving_frequency
    n = int(
        np.clip((_SHOWN_MICROSTEPS / f_d if f_d else 0.1) * motion.sample_rate, 8, motion.time.size)
    )
    return (motion.time[:n] - motion.time[0]) * 1e3


def _shade_stuck(ax: Axes, motion: Motion, t: np.ndarray) -> bool:
    """Shade the time that the shaft sticks; whether it does."""
    where = motion["stuck_output"][: t.size] > 0.5
    if np.any(where):
        grey = ax.fill_between(
            t, 0, 1, where=where, transform=ax.get_xaxis_transform(), color="#bbbbbb", alpha=0.45
        )
        grey.set(linewidth=0, label="shaft sticks")
    return bool(np.any(where))


def draw_spectrum(
    ax: Axes,
    motion: Motion,
    table: LineTable,
    highest: float = 200.0,
    judged: Judgement | None = None,
) -> None:
    """Amplitude spectrum of the disturbance torque to ``highest`` [Hz] with the lines named (as
    Figure 10), and the limit.
    """
    draw_judged_amplitudes(ax, spectrum(motion, window="hann"), "N m", highest, table, judged)


def draw_judged_amplitudes(
    ax: Axes,
    made: Spectrum,
    unit: str,
    highest: float,
    table: LineTable,
    judged: Judgement | None = None,
) -> None:
    """An amplitude spectrum to ``highest`` [Hz] with the lines of a ``table`` named and, where they
    are judged, the limit; over a logarithmic axis where lines crowd at its low end.
    """
    shown = _in_reach(table, highest)
    first = () if judged is None else governing_lines(judged)
    by_logarithm = _crowds_at_low(shown, first, highest) or _has_curve(judged)
    own_names = judged is not None or by_logarithm  # axes must have their limits before
    draw_amplitudes(ax, made, unit, highest, table, names=not own_names)
    if by_logarithm:
        _make_logarithmic(ax, shown, judged, made)
    if judged is not None:
        _draw_limit(ax, judged, highest)
        _make_room_for_names(ax, [x for x in shown if x.name in first and x.amplitude > 0.0])
    if own_names:
        _name_lines(ax, shown, first)


def _in_reach(table: LineTable, highest: float) -> list[Line]:
    """Lines with an amplitude up to a frequency [Hz]."""
    return [x for x in table if np.isfinite(x.amplitude) and x.frequency <= highest]


def _has_curve(judged: Judgement | None) -> bool:
    """Whether a limit over frequency is drawn, whose points lie evenly on logarithmic scales."""
    return judged is not None and judged.curve is not None and not judged.curve.is_flat


def governing_lines(judged: Judgement) -> tuple[str, ...]:
    """Names of the lines that decide a verdict: those above the limit, the worst first, then those
    that are nearest to it.
    """
    above = [m.line.name for m in judged.margins if m.fails]
    near = [m.line.name for m in judged.margins if not m.fails and m.line.seen]
    return (*above, *near[:_NEAREST_NAMED])


def _crowds_at_low(shown: Sequence[Line], first: Sequence[str], highest: float) -> bool:
    """Whether several of the lines that are worth a name stand in the lowest part of a linear axis."""
    top = max((x.amplitude for x in shown), default=0.0)
    worth = [x for x in shown if x.seen and (x.name in first or x.amplitude >= _WORTH_NAMING * top)]
    low = sum(x.frequency < _LOW_PART * highest for x in worth)
    return low >= _CROWD


def _make_logarithmic(
    ax: Axes, shown: Sequence[Line], judged: Judgement | None, made: Spectrum
) -> None:
    """A logarithmic axis from below the lowest line, and the lowest frequency that is limited, on."""
    lowest = [0.7 * x.frequency for x in shown if x.seen]
    if judged is not None and judged.limit.low > 0.0:
        lowest.append(0.8 * judged.limit.low)
    ax.set_xscale("log")
    ax.set_xlim(max(min(lowest, default=1.0), made.resolution), _RIGHT_OF_LAST * ax.get_xlim()[1])
    plain_numbers(ax.xaxis)


def _make_room_for_names(ax: Axes, named: Sequence[Line]) -> None:
    """Axes that have room for the names of some lines, below the legend."""
    if not named:
        return
    sizes = [1e3 * x.amplitude for x in named]
    low, high = ax.get_ylim()
    low = min([low, *(0.5 * size for size in sizes)])
    inches = ax.get_window_extent().height / ax.figure.dpi
    highest = max(1.0 - _ABOVE_NAMED / inches, 0.5)  # part of the height of the axes
    high = max(high, low * (max(sizes) / low) ** (1.0 / highest))
    ax.set_ylim(low, high)


def _draw_limit(ax: Axes, judged: Judgement, highest: float) -> None:
    """The limit over its band, and squares about the lines above it."""
    curve, above = judged.curve, [m.line for m in judged.margins if m.fails]
    if curve is None:
        return
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, 0.5e3 * curve.least), max(high, 4.0e3 * curve.most))
    part = curve.within(0.0, highest)
    if part is not None:
        ax.plot(
            [max(f, 1e-9) for f in part.frequency],
            1e3 * np.array(part.amplitude),
            color="black",
            linewidth=1.4,
            linestyle="--",
            zorder=4.5,  # names do not hide it
            label=f"limit {judged.allowed}",
        )
    label = "above the limit" if above else None
    _dots(ax, above, "s", markersize=7, fillstyle="none", markeredgewidth=1.4, label=label)
    ax.legend(loc="upper right", fontsize=7.5, ncols=2)


def draw_amplitudes(
    ax: Axes,
    s: Spectrum,
    unit: str,
    highest: float,
    table: LineTable | None = None,
    names: bool = True,
) -> None:
    """An amplitude spectrum to ``highest`` [Hz], four decades of it in thousandths of ``unit``, and the
    lines of ``table``, with their ``names``.
    """
    highest = min(highest, s.sample_rate / 2)
    keep = (s.frequency <= highest) & (s.frequency > 0)
    ax.semilogy(
        s.frequency[keep], 1e3 * np.maximum(s.amplitude[keep], 1e-12), color=BLUE, linewidth=0.8
    )
    shown = [x for x in table or () if np.isfinite(x.amplitude) and x.frequency <= highest]
    heights = [1e3 * x.amplitude for x in shown] or [1e3 * float(s.amplitude[keep].max())]
    top = max([a for a in heights if a > 0] or [1.0])
    ax.set_ylim(top * 1e-4, top * 12)
    ax.set_xlim(0, highest)
    if names:
        _name_lines(ax, shown)
    ax.set(
        xlabel="frequency [Hz]",
        ylabel=f"amplitude, 0-to-peak [m{unit}]",
        title=f"Spectrum ({_made_by(s)})",
    )


def add_background(
    ax: Axes, background: Spectrum, lines: Sequence[tuple[float, float, bool]]
) -> None:
    """The floor of a background's spectrum before that of a recording, and its ``lines``: frequency,
    amplitude, and whether they are the mains'."""
    from scipy.ndimage import median_filter

    f = background.frequency
    keep = (f > 0.0) & (f <= ax.get_xlim()[1])
    floor = median_filter(background.amplitude, size=_FLOOR_BINS)[keep]
    ax.semilogy(f[keep], 1e3 * floor, color="k", lw=1.0, label="floor with the drive off")
    for mains, marker, label in (
        (False, "x", "line with the drive off"),
        (True, "^", "mains line with the drive off"),
    ):
        own = [(at, 1e3 * size) for at, size, is_mains in lines if is_mains == mains]
        own = [(at, size) for at, size in own if at <= ax.get_xlim()[1]]
        if own:
            ax.plot(*zip(*own, strict=True), marker, color="k", ms=5, ls="", label=label, zorder=6)
    ax.legend(loc="upper right", fontsize=7.5)


_FLOOR_BINS = 101


def _made_by(s: Spectrum) -> str:
    return f"{window_name(s.window)}, {s.samples / s.sample_rate:g} s, {s.resolution:.4g} Hz bins"


def _name_lines(ax: Axes, shown: Sequence[Line], first: Sequence[str] = ()) -> None:
    """Mark lines at their estimated amplitude [mN m], and name those that stand clear of each
    other: lines that come ``first`` in bold, then modes, then the strongest."""
    bottom = ax.get_ylim()[0]
    visible = [x for x in shown if 1e3 * x.amplitude > bottom and x.status != BELOW_FLOOR]
    _dots(ax, visible, markersize=4, zorder=5)
    top = max((x.amplitude for x in visible), default=0.0)
    rank = {name: k for k, name in enumerate(first)}
    visible.sort(key=lambda x: (rank.get(x.name, len(rank)), not x.is_mode, -x.amplitude))
    name_points(ax, [
        (x.frequency, 1e3 * x.amplitude, f"{x.name}\n{x.frequency:.4g} Hz", x.name in rank)
        for x in visible if x.name in rank or x.amplitude >= 1e-3 * top
    ])  # fmt: skip


def _dots(ax: Axes, lines: Sequence[Line], marker: str = "o", **style: Any) -> None:
    ax.plot(
        [x.frequency for x in lines],
        [1e3 * x.amplitude for x in lines],
        marker,
        color=RED,
        **style,
    )


def draw_array_zoom(ax: Axes, motion: Motion, table: LineTable) -> None:
    """Spectrum about the array's first modes; clamped and coupled frequency of the strongest
    marked.
    """
    modes = [line for line in table if line.is_mode and np.isfinite(line.amplitude)]
    top = 4.0 * min((line.expected for line in modes), default=1.0)
    s = spectrum(motion, window="rectangular")
    keep = (s.frequency <= top) & (s.frequency > 0)
    ax.plot(
        s.frequency[keep],
        s.amplitude[keep] * 1e3,
        color=BLUE,
        linewidth=1.0,
        marker=".",
        markersize=3,
    )
    marked = sorted((x for x in modes if x.expected <= top), key=lambda x: -x.amplitude)[:2]
    for line in marked:
        _mark_mode(ax, motion, line)
    _name_points(ax, [x for x in table if x.frequency <= top and x.status != BELOW_FLOOR])
    if modes:
        title = f"Array mode ({_made_by(s)})"
    else:
        title = f"Low frequencies ({_made_by(s)})"
    ax.set(xlabel="frequency [Hz]", ylabel="amplitude, 0-to-peak [mN m]", title=title)
    ax.set_xlim(0, top)
    _headroom(ax, 0.2 + 0.15 * len(marked))
    ax.set_ylim(bottom=0)
    if marked:
        ax.legend(loc="upper right", fontsize=7.5, ncols=2)


def _mark_mode(ax: Axes, motion: Motion, line: Line) -> None:
    """Where a mode is with the shaft held, and where through the drive."""
    clamped = next(
        (m.fixed_frequency for m in coupled_modes(motion.scenario) if m.name == line.name), None
    )
    styles = ((clamped, "clamped", GREY, ":"), (line.expected, "through the drive", RED, "--"))
    for f, what, colour, dashes in styles:
        if f is not None:
            ax.axvline(
                f,
                color=colour,
                linestyle=dashes,
                linewidth=1.2,
                label=f"{line.name}, {what} {f:.4g} Hz",
            )


def _name_points(ax: Axes, shown: Sequence[Line]) -> None:
    """Points at the estimated amplitudes; those of at least a fiftieth of the largest are named."""
    _dots(ax, shown, markersize=5)
    top = max((x.amplitude for x in shown), default=0.0)
    for x in shown:
        if x.amplitude >= 0.02 * top > 0.0:
            at = (x.frequency, x.amplitude * 1e3)
            ax.annotate(x.name, at, xytext=(6, 2), textcoords="offset points", fontsize=8)


def draw_torques(output: Axes, rotor: Axes, motion: Motion) -> None:
    """Torques through a few microsteps: which goes where at the output, less their means, and at
    the rotor.
    """
    names = {"T_d": "on the spacecraft", "T_g": "gear", "T_f": "friction", "T_l": "array"}
    _draw_curves(
        output, motion, {label: motion[name] - motion[name].mean() for name, label in names.items()}
    )
    output.set(ylabel="torque less its mean [mN m]", title="At the output")
    gear = motion["T_g"] / motion.scenario.reducer.h
    _draw_curves(
        rotor,
        motion,
        {"motor": motion["T_e"], "friction": motion["T_f_m"], "gear over ratio": gear},
    )
    rotor.set(ylabel="torque [mN m]", title="At the rotor")


def draw_friction_loop(loops: Axes, run: Axes, motion: Motion) -> None:
    """Friction of the output over its angle: slowly to and fro over a shaft that slides at last;
    through some microsteps.
    """
    friction, t = motion.scenario.friction, _first_microsteps_time(motion)
    memory, limit = friction.memory, friction.breakaway_torque
    slides = memory[-1][1] * limit / memory[-1][0]
    angle, measured = (
        np.array(friction.presliding.loop if friction.presliding else ()).reshape(-1, 2).T
    )
    if angle.size:
        within = 0.5 * float(np.ptp(angle))
    else:
        within = 0.5 * slides
    for amplitude, dashes in ((1.2 * slides, ":"), (within, "--"), (0.2 * within, "-")):
        turns = amplitude * np.array([0.0, 1.0, 0.0, -1.0, 0.0, 1.0])
        path = np.interp(np.linspace(0.0, 5.0, 1000), np.arange(6), turns)
        torque = 1e3 * quasi_static_torque(memory, limit, path)
        loops.plot(
            1e6 * path,
            torque,
            color=GREY,
            linestyle=dashes,
            linewidth=1.2,
            label=f"±{1e6 * amplitude:.3g} µrad",
        )
    if angle.size:
        centred = angle - 0.5 * (angle.min() + angle.max())
        loops.plot(
            1e6 * centred,
            1e3 * measured,
            color=RED,
            marker=".",
            markersize=3,
            linestyle="none",
            label="measured",
        )
    _headroom(loops, 0.6)
    loops.legend(loc="upper left", fontsize=7)
    turned = motion["theta_l"][: t.size] - motion["theta_l"][0]
    run.plot(1e6 * turned, 1e3 * motion["T_f"][: t.size], color=RED, linewidth=1.3)
    for ax, title in ((loops, "Slow cycles"), (run, f"In the run, {t[-1] - t[0]:.3g} ms")):
        ax.set(xlabel="angle of the output [µrad]", ylabel="friction torque [mN m]", title=title)


def _draw_curves(ax: Axes, motion: Motion, curves: Mapping[str, np.ndarray]) -> None:
    """Curves over the first microsteps, told apart by colour and by dashes."""
    t = _first_microsteps_time(motion)
    for (label, x), colour, dashes in zip(
        curves.items(), COLOURS, ("-", "--", "-.", ":"), strict=False
    ):
        ax.plot(t, 1e3 * x[: t.size], color=colour, linestyle=dashes, linewidth=1.3, label=label)
    _shade_stuck(ax, motion, t)
    ax.set(xlabel="time in the record [ms]")
    ax.margins(x=0)
    _headroom(ax, 0.45)
    ax.legend(loc="upper right", fontsize=7, ncols=2)


def _headroom(ax: Axes, share: float = 0.25) -> None:
    """Room above the curves for a legend or labels."""
    low, high = ax.get_ylim()
    ax.set_ylim(
        low,
        high * (high / low) ** share if ax.get_yscale() == "log" else high + share * (high - low),
    )


def draw_overlay(
    ax: Axes, sides: Sequence[tuple[str, np.ndarray, float]], highest: float = 200.0
) -> None:
    """Amplitude spectra of several torques over each other (as Figures 11, 12, 16); the first is
    drawn widest.
    """
    widths, top = np.linspace(2.6, 0.9, max(len(sides), 2)), 0.0
    for (name, torque, rate), colour, width in zip(sides, COLOURS, widths, strict=False):
        s = amplitude_spectrum(torque, rate, "hann")
        keep = (s.frequency > 0) & (s.frequency <= highest)
        f, a = s.frequency[keep], 1e3 * np.maximum(s.amplitude[keep], 1e-9)
        top = max(top, 1e3 * float(s.amplitude[keep].max()))
        ax.plot(f, a, color=colour, linewidth=width, label=legend_name(name))
    _style_overlay(ax, highest, 1e-5 * top, top)


def _style_overlay(ax: Axes, highest: float, bottom: float, top: float) -> None:
    ax.set(
        yscale="log",
        xlabel="frequency [Hz]",
        ylabel="amplitude, 0-to-peak [mN m]",
        xlim=(0, highest),
        ylim=(bottom, top),
    )
    _headroom(ax)
    ax.legend(loc="upper right", fontsize=6.5)


_MIN_PEAK_RATIO = 1e-3
"""Peaks below this part of the largest are not drawn."""


def draw_stems(ax: Axes, sides: Sequence[tuple[str, np.ndarray, float]], highest: float) -> None:
    """Peaks of several torques' amplitude spectra to ``highest`` [Hz], those of one frequency side
    by side.
    """
    from matplotlib.transforms import ScaledTranslation

    spectra = [amplitude_spectrum(torque, rate, "hann") for _, torque, rate in sides]
    top = max(
        1e3 * float(s.amplitude[(s.frequency > 0) & (s.frequency <= highest)].max())
        for s in spectra
    )
    bottom = _MIN_PEAK_RATIO * top
    for k, ((name, _, _), s, colour) in enumerate(zip(sides, spectra, COLOURS, strict=False)):
        f, a = s.frequency, 1e3 * s.amplitude
        peaks = 1 + np.flatnonzero(
            (a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:]) & (a[1:-1] > bottom) & (f[1:-1] <= highest)
        )
        aside = ScaledTranslation(
            1.7 / 72.0 * (k - 0.5 * (len(sides) - 1)), 0.0, ax.figure.dpi_scale_trans
        )
        where = ax.transData + aside
        ax.vlines(f[peaks], bottom, a[peaks], color=colour, linewidth=1.0, transform=where)
        ax.plot(
            f[peaks],
            a[peaks],
            "osD^v"[k % 5],
            color=colour,
            markersize=2.6,
            transform=where,
            label=legend_name(name),
        )
    _style_overlay(ax, highest, bottom, top)


def draw_spectral(
    made: Spectral,
    unit: str,
    highest: float,
    height: float,
    table: LineTable | None = None,
    judged: Judgement | None = None,
) -> Figure:
    """A sheet of a report with a spectrum, whose lines ``table`` names and may be ``judged``, a density
    or a waterfall to ``highest`` [Hz].
    """
    figure, ax = one_axes(height)
    if isinstance(made, Spectrum) and table is not None:
        draw_judged_amplitudes(ax, made, unit, highest, table, judged)
    elif isinstance(made, Spectrum):
        draw_amplitudes(ax, made, unit, highest)
    elif isinstance(made, Density):
        draw_density(ax, made, unit, highest)
    else:
        draw_waterfall(ax, made, unit, highest)
    return figure


def draw_density(ax: Axes, density: Density, unit: str, highest: float) -> None:
    """Power spectral density, and on a second axis the cumulative RMS."""
    keep = (density.frequency > 0) & (density.frequency <= highest)
    f = density.frequency[keep]
    ax.semilogy(
        f,
        1e6 * np.maximum(density.density[keep], 1e-24),
        color=BLUE,
        linewidth=0.9,
        label="density",
    )
    ax.set(
        xlabel="frequency [Hz]", ylabel=f"power spectral density [(m{unit})²/Hz]", xlim=(0, highest)
    )
    right = ax.twinx()
    right.plot(
        f,
        1e3 * density.cumulative_rms[keep],
        color=RED,
        linewidth=1.6,
        linestyle="--",
        label="cumulative RMS",
    )
    right.set_ylabel(f"cumulative RMS from 0 Hz [m{unit}]")
    right.set_ylim(bottom=0)
    right.spines["top"].set_visible(False)
    _headroom(ax)
    _headroom(right, 0.2)
    ax.legend(handles=[*ax.lines, *right.lines], loc="upper right", fontsize=7.5, ncols=2)


def draw_waterfall(ax: Axes, w: Waterfall, unit: str, highest: float) -> None:
    """Amplitude in thousandths of ``unit`` over time and frequency, colour in decades below the
    largest.
    """
    from matplotlib.colors import LogNorm

    keep = (w.frequency > 0) & (w.frequency <= highest)
    amplitude = 1e3 * w.amplitude[:, keep]
    top = float(np.max(amplitude))
    f, norm, values = w.frequency[keep], LogNorm(1e-4 * top, top), np.maximum(amplitude, 1e-4 * top)
    mesh = ax.pcolormesh(
        f, w.time, values, norm=norm, cmap="viridis", shading="nearest", rasterized=True
    )
    ax.figure.colorbar(mesh, ax=ax, label=f"amplitude, 0-to-peak [m{unit}]")
    ax.set(xlabel="frequency [Hz]", ylabel="time in the record [s]")
    ax.grid(False)


_LEVEL_NAMES = 6
"""Lines whose names have room side by side."""


def draw_pairs(ax: Axes, names: Sequence[str], groups: Mapping[str, Sequence[float]]) -> None:
    """Amplitudes [N m] of the same lines on several sides, as points side by side; drawn in mN m."""
    x = np.arange(len(names))
    for k, (label, values) in enumerate(groups.items()):
        aside, colour = (k - 0.5 * (len(groups) - 1)) * 0.16, COLOURS[k % len(COLOURS)]
        ax.semilogy(
            x + aside,
            1e3 * np.asarray(values),
            "osD^v"[k % 5],
            color=colour,
            markersize=5,
            label=label,
        )
    steep = len(names) > _LEVEL_NAMES
    ax.set_xticks(
        x,
        names,
        rotation=60 if steep else 20,
        ha="right",
        rotation_mode="anchor",
        fontsize=7 if steep else None,
    )
    ax.set_ylabel("amplitude, 0-to-peak [mN m]")
    _headroom(ax)
    ax.legend(loc="upper right", fontsize=7.5, ncols=len(groups))


def draw_residual_floor(
    ax: Axes, frequency: np.ndarray, curves: Mapping[str, np.ndarray], lines: Sequence[float],
    dots: Mapping[str, Sequence[float]],
) -> None:  # fmt: skip
    """Curves [N m] over ``frequency`` (n,) [Hz], and dots at those of lines, (m,); drawn in mN m."""
    for (label, values), colour, width in zip(curves.items(), COLOURS, (0.8, 1.6), strict=False):
        ax.plot(frequency, 1e3 * values, color=colour, linewidth=width, label=label)
    for (label, amplitudes), colour, marker in zip(dots.items(), COLOURS[2:], "ox", strict=False):
        ax.plot(
            lines, 1e3 * np.asarray(amplitudes), marker, color=colour, markersize=4, label=label
        )
    ax.set(
        xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="amplitude, 0-to-peak [mN m]"
    )
    _headroom(ax)
    ax.legend(loc="upper right", fontsize=6.5, ncols=2)
