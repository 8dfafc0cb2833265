"""The craft in pictures and tables: hub, arrays at their angles, boresight; loads on the hub; line
of sight and its largest contributors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.analysis.pointing import HubLines
from microvib.analysis.start import steady_start_advice
from microvib.model.array import Array
from microvib.model.coupling import MIN_FREQUENCY_WITHOUT_CONTROL, require_craft
from microvib.model.hub_edge import KNOWN_PART, hub_edge
from microvib.model.rigid import COMPONENTS, inertia_about_center, tensor
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import CENTER, SECOND_INTERFACE, Interface, SecondWing, Spacecraft
from microvib.reports.document import Fact, Text
from microvib.reports.moving import box_corners
from microvib.reports.numbers import count_text, plain_number, window_text
from microvib.reports.outcome import Item, Pairs, Part, Picture
from microvib.reports.sheets import BLUE, COLOURS, GREEN, GREY, ORANGE, RED, new_figure, plain_sheet
from microvib.results import POINTING_ANGLE, TORQUE, Column, Measure, Table
from microvib.signals.pointing import METRICS, Metric, cumulative_rms, metric_name, radial_rms
from microvib.signals.spectrum import amplitude_spectrum, power_spectral_density
from microvib.solve.channels import LOADS, SECOND_LOADS
from microvib.solve.motion import Motion
from microvib.units import Si

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

_MAX_LOAD_LINES = 12
"""Lines in the table of loads."""
_MAX_CONTRIBUTORS = 5
_MAX_TOLD = 4
"""Number of these in a sentence."""
_ANGLE = replace(POINTING_ANGLE, form="#.3g")
_MIN_BINS = 4.0
"""Bins below which an angle says nothing: it is an acceleration over the square of a frequency."""
_VIEW = np.array([[-0.64, 0.77, 0.0], [-0.29, -0.24, 0.93]])
"""Hub axes as they are drawn: to the right, and up; the eye looks at their cross product."""
MIN_TRANSIENT_PART = 0.01
"""Part of a mean square from which it is told that it rings after the start."""


def craft_parts(motion: Motion, hub: HubLines) -> Iterator[Part]:
    """Sections on the spacecraft in a run's report."""
    yield Part("The spacecraft", tuple(_craft(motion.scenario)), new_page=True, report_only=True)
    yield Part("Loads on the hub", tuple(_loads(motion, hub)), not_on_terminal=True)
    if hub.los is not None:
        yield Part("Line of sight", tuple(_line_of_sight(motion, hub)), not_on_terminal=True)


def pointing_angle(hub: HubLines) -> Measure:
    """How angles of the line of sight are given, all in the unit that suits the largest."""
    sums = [row["radial_rad"] for row in hub.totals()]
    return _ANGLE.suited_to(sums or np.abs(hub.amplitude).ravel())


def pointing_facts(hub: HubLines | None) -> tuple[Fact, ...]:
    """The leading figure of the line of sight: what is left of it in the longest window."""
    if hub is None or hub.los is None or not hub.windows:
        return ()
    window = max(hub.windows)
    rms = float(radial_rms(hub.sums("rpe", window).sum(axis=0)))
    die = np.array([name in hub.rings for name in hub.names], dtype=bool)
    if rms:
        part = float(hub.mean_squares("rpe", window)[die].sum()) / rms**2
    else:
        part = 0.0
    if part > MIN_TRANSIENT_PART:
        rings = f", {plain_number(100 * part, 2)} % of its square ringing after the start"
    else:
        rings = ""
    value = pointing_angle(hub).figure(rms)
    return (Fact(value, f"line of sight, RPE in {window_text(window)}{rings}"),)


def pointing_sentence(hub: HubLines) -> Iterator[str]:
    """The leading figure of the line of sight with the lines that contribute most to it."""
    angle = pointing_angle(hub)
    for fact in pointing_facts(hub):
        ranked = hub.ranking("rpe", max(hub.windows))[:_MAX_TOLD]
        shares = ", ".join(f"{name} {angle.figure(rms)}" for name, rms in ranked)
        label = f"{fact.label[0].upper()}{fact.label[1:]}"
        yield f"{label}: {fact.value}; largest contributors, rms: {shares}."


def craft_words(craft: Spacecraft) -> str:
    """Hub, angle of the array and attitude control in a line."""
    control, modes = craft.attitude_control, len(craft.hub.modes)
    if control is None:
        held = "no attitude control"
    else:
        held = f"attitude control of {control.bandwidth:g} Hz"
    if modes:
        kind = f"with {count_text(modes, 'flexible mode')}"
    else:
        kind = "rigid"
    if craft.second_wing is None:
        wing = ""
    else:
        wing = f"; second wing {_second_words(craft.second_wing)}"
    return f"hub of {craft.hub.mass:.5g} kg, {kind}; array at {math.degrees(craft.array_angle):.4g}°{wing}; {held}"


def hub_sentence(scenario: Scenario) -> str:
    """Sentence on the frequencies up to which the hub of a craft and its arrays are known."""
    craft = require_craft(scenario).spacecraft
    arrays = {"the array": scenario.array}
    if craft.second_wing is not None and craft.second_wing.array is not None:
        arrays["the second wing's array"] = craft.second_wing.array
    known = "; ".join(
        f"{name} by modes up to {max(mode.frequency for mode in array.modes):.4g} Hz, beyond which"
        " it is rigid"
        for name, array in arrays.items()
        if array.modes
    )
    edge = hub_edge(scenario)
    if edge is not None:
        hub = (
            f"The hub is known up to {edge.frequency:.4g} Hz, {KNOWN_PART:g} of the first mode that is left"
            f" out, and a line above may be {edge.factor:.4g} times as large (assumed)"
        )
    elif craft.hub.modes:
        last = max(mode.frequency for mode in craft.hub.modes)
        hub = f"The hub is known by its modes up to {last:.4g} Hz, beyond which it is rigid"
    else:
        hub = "The hub is rigid"
    return f"{'; '.join(filter(None, (hub, known)))}."


_HOLDS = {"held": "held by its drive", "locked": "its shaft locked"}
"""Text on a second wing that does not step."""


def _second_words(wing: SecondWing) -> str:
    """Text on the second wing's drive."""
    if wing.array_angle is None:
        angle = "with the first"
    else:
        angle = f"at {math.degrees(wing.array_angle):.4g}°"
    if wing.drive != "driven":
        return f"{angle}, {_HOLDS[wing.drive]}"
    if wing.stagger:
        late = f", {wing.stagger:g} microsteps after the first"
    else:
        late = ""
    if wing.clock_ratio != 1.0:
        clock = f", its clock {wing.clock_ratio:g} times the first's"
    else:
        clock = ""
    if wing.tracking:
        rate = ", with its own commanded motion"
    else:
        rate = ""
    return f"{angle}, driven{late}{clock}{rate}"


def _craft(scenario: Scenario) -> Iterator[Item]:
    craft, locked = scenario.spacecraft, scenario.craft
    assert craft is not None
    assert locked is not None
    position = ", ".join(f"{x:.4g}" for x in craft.interface.position)
    moments = ", ".join(f"{x:.4g}" for x in np.linalg.eigvalsh(tensor(craft.hub.inertia)))
    frequencies = ", ".join(f"{f:.4g}" for f in locked.frequency[:8]) + (
        ", …" if locked.frequency.size > 8 else ""
    )
    rows = {
        "Craft": craft_words(craft),
        "Principal moments": f"{moments} kg m², about the hub's centre of mass",
        "Interface": f"at [{position}] m from the hub's centre of mass",
        **({} if craft.second_wing is None else {"Second wing": _second(scenario)}),
        "Modes with locked hinges": f"{frequencies} Hz",
    }
    if craft.second_wing is None:
        arrays = "the array"
    else:
        arrays = "the first array"
    caption = (
        f"Hub and array as boxes of their mass and inertia, hub axes; dotted, {arrays} at angle 0,"
        " dashed, the drive"
        " axis."
    )
    if craft.second_wing is not None:
        caption = caption.replace("Hub and array", "Hub and arrays").replace("axis.", "axes.")
    yield Pairs(tuple(rows.items()))
    yield Picture("", partial(draw_craft, scenario), "Hub, array and line of sight", caption)


def _second(scenario: Scenario) -> str:
    """Where the second wing sits and what it does."""
    craft, other = scenario.spacecraft, scenario.other_wing
    assert craft is not None
    assert craft.second_wing is not None
    assert other is not None
    assert other.spacecraft is not None
    position = ", ".join(f"{x:.4g}" for x in craft.second_wing.interface.position)
    words = _second_words(craft.second_wing)
    words = words.replace(
        "with the first", f"with the first ({math.degrees(other.spacecraft.array_angle):.4g}°)", 1
    )
    moves = craft.second_wing.drive == "driven" and other.rate is not None
    if moves:
        rate = f"; its shaft turns at {math.degrees(other.rate or 0.0):.6g} deg/s"
    else:
        rate = ""
    return f"at [{position}] m, {words}{rate}"


def draw_craft(scenario: Scenario) -> Drawing:
    """Hub, arrays at their angles, drive axes and line of sight, seen from obliquely above."""
    craft, other = scenario.spacecraft, scenario.other_wing
    assert craft is not None
    figure, axes = new_figure(7.0, 3.4, layout=None)
    ax = axes[0, 0]
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.99)
    ax.set_axis_off()
    ax.set_aspect("equal")
    wings = [(scenario.array, craft.interface, craft.array_angle)]
    if other is not None and other.spacecraft is not None:
        wings.append((other.array, other.spacecraft.interface, other.spacecraft.array_angle))
    bodies = [_array(*wing) for wing in wings]
    hub = box_corners(craft.hub.mass, tensor(craft.hub.inertia))
    size = float(np.ptp(np.vstack([hub, *bodies]), axis=0).max())
    toward = np.cross(*_VIEW)
    if craft.array_angle % math.tau:
        _edges(
            ax,
            _array(scenario.array, craft.interface, 0.0),
            color=GREY,
            linewidth=0.6,
            linestyle=":",
        )
    for _, interface, _ in wings:
        root, axis = np.array(interface.position), interface.axis
        _line(
            ax,
            root - 0.1 * size * axis,
            root + 0.75 / len(wings) * size * axis,
            color="black",
            linewidth=0.9,
            linestyle="--",
        )
    boxes = [(hub, "#d9d9d9", "#333333"), *((body, "#9ecae1", BLUE) for body in bodies)]
    for corners, face, edge in sorted(boxes, key=lambda box: float(box[0].mean(axis=0) @ toward)):
        _faces(ax, corners, toward, face, edge)
    for k, ((_, interface, angle), body) in enumerate(zip(wings, bodies, strict=True), 1):
        root, middle = np.array(interface.position), body.mean(axis=0)
        _line(ax, root, middle, color=BLUE, linewidth=2.0)
        ax.plot(*(_VIEW @ root), "o", color=ORANGE, markersize=5, zorder=8)
        white = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.7}
        if len(wings) == 1:
            name = "ψ"
        else:
            name = f"ψ{'₁₂'[k - 1]}"
        turned = f"{math.degrees(angle):.4g}".replace("-", "−")
        ax.annotate(f"{name} = {turned}°", _VIEW @ middle, fontsize=9, zorder=9, bbox=white)
    _names(ax, craft, size)
    ax.autoscale_view()
    ax.margins(0.04)
    return figure


def _array(array: Array, interface: Interface, angle: float) -> np.ndarray:
    """Corners (8, 3) of an array's box at an angle [rad], hub axes."""
    body = array.rigid_body
    assert body is not None
    center = np.array(body.center_of_mass)
    about = inertia_about_center(body.mass, center, tensor(body.inertia))
    return np.asarray(
        np.array(interface.position)
        + (center + box_corners(body.mass, about)) @ interface.turn(array.drive_axis, angle).T
    )


def _names(ax: Axes, craft: Spacecraft, size: float) -> None:
    """Axes of the hub, and the boresight."""
    for k, name in enumerate("xyz"):
        _arrow(ax, np.zeros(3), 0.22 * size * np.eye(3)[k], GREEN, name)
    los = craft.line_of_sight
    if los is not None and los.boresight is not None:
        places = {p.name: p.position for p in craft.hub.points} | {CENTER: (0.0, 0.0, 0.0)}
        if craft.second_wing is not None:
            places.setdefault(SECOND_INTERFACE, craft.second_wing.interface.position)
        start = np.array(places.get(los.point, craft.interface.position))
        along = np.array(los.boresight) / np.abs(los.boresight).max()
        _arrow(ax, start, start + 0.4 * size * along / np.linalg.norm(along), RED, "line of sight")


def _faces(ax: Axes, corners: np.ndarray, toward: np.ndarray, face: str, edge: str) -> None:
    """Visible faces of a box."""
    middle = corners.mean(axis=0)
    for k in range(3):
        for side in (0, 1):
            bits = [b for b in range(8) if (b >> (2 - k)) & 1 == side]
            ring = corners[[bits[0], bits[1], bits[3], bits[2]]]
            if (ring.mean(axis=0) - middle) @ toward > 0.0:
                ax.fill(
                    *(_VIEW @ ring.T), facecolor=face, edgecolor=edge, linewidth=0.9, alpha=0.85
                )


def _edges(ax: Axes, corners: np.ndarray, **style: Any) -> None:
    for a in range(8):
        for bit in (1, 2, 4):
            if not a & bit:
                _line(ax, corners[a], corners[a | bit], **style)


def _line(ax: Axes, a: np.ndarray, b: np.ndarray, **style: Any) -> None:
    ax.plot(*np.column_stack([_VIEW @ a, _VIEW @ b]), **style)


def _arrow(ax: Axes, a: np.ndarray, b: np.ndarray, colour: str, name: str) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", _VIEW @ b, _VIEW @ a, arrowprops=style, zorder=8)
    ax.plot(*np.column_stack([_VIEW @ a, _VIEW @ b]), linewidth=0)  # so that the axes reach to it
    ax.annotate(
        name, _VIEW @ b, (3, 3), textcoords="offset points", color=colour, fontsize=8.5, zorder=9
    )


def _loads(motion: Motion, hub: HubLines) -> Iterator[Item]:
    first = _loads_at(motion, hub, hub.loads, tuple(LOADS), "loads.csv")
    if hub.second is None:
        yield Text(
            "Loads on the hub at the interface point, hub axes; about the drive axis this is T_d."
        )
        yield from first
        return
    wing = ""
    if motion.second_wing is not None:
        wing = ", and what its wing puts on the hub while the other one steps"
    yield Text(
        "Loads on the hub at both interface points, hub axes. About its drive axis the first's is"
        f" T_d{wing}."
    )
    yield from first
    yield Text("At the second wing's interface:")
    yield from _loads_at(motion, hub, hub.second, tuple(SECOND_LOADS), "loads_wing_2.csv")


_FORCE = Measure("mN", 1e-3, "#.4g")
_LOAD_COLUMNS = (
    Column("line", "line"),
    Column("frequency_hz", "frequency", Measure("Hz", form="#.5g")),
    *(Column(name, name, TORQUE if name[0] == "M" else _FORCE) for name in COMPONENTS),
)


def _loads_at(
    motion: Motion, hub: HubLines, loads: np.ndarray, names: tuple[str, ...], file: str
) -> Iterator[Item]:
    """Lines and spectra of six loads."""
    sizes = np.nan_to_num(np.abs(loads))
    share = (sizes / sizes.max(axis=0, initial=1e-300)).max(axis=1, initial=0.0)
    kept = sorted(
        np.argsort(-share, kind="stable")[:_MAX_LOAD_LINES], key=lambda k: hub.frequency[k]
    )
    rows = tuple((hub.names[k], float(hub.frequency[k]), *np.abs(loads[k]).tolist()) for k in kept)
    yield Table("", _LOAD_COLUMNS, rows, caption=_loads_caption(hub, kept, file))
    yield Picture(
        "",
        partial(_draw_loads, motion, names),
        "Spectra of forces and moments",
        "Amplitude spectra, one-sided, Hann window.",
    )


def _loads_caption(hub: HubLines, kept: Sequence[int], file: str) -> str:
    shown = [hub.names[k] for k in kept]
    caption = "Amplitudes 0-to-peak."
    if ringing := [name for name in hub.rings if name in shown]:
        caption = (
            f"Amplitudes 0-to-peak, of {', '.join(ringing)}, which ring after the start, the mean"
            " over the record."
        )
    if left := len(hub.names) - len(kept):
        caption += f" {count_text(left, 'line')} more and all phases in `{file}`."
    return caption


def _draw_loads(motion: Motion, names: tuple[str, ...]) -> Drawing:
    drawing, axes = plain_sheet(2.7, 1, 2)
    for ax, some, unit in ((axes[0, 0], names[:3], "mN"), (axes[0, 1], names[3:], "mN m")):
        spectra = {
            name: amplitude_spectrum(motion[name], motion.sample_rate, "hann") for name in some
        }
        curves = {
            name.removesuffix("_2"): (s.frequency, 1e3 * s.amplitude) for name, s in spectra.items()
        }
        _curves(ax, curves, f"amplitude, 0-to-peak [{unit}]", 1e-5)
    return drawing


def _curves(
    ax: Axes, curves: Mapping[str, tuple[np.ndarray, np.ndarray]], label: str, depth: float
) -> None:
    """Curves over frequency, to 200 Hz, on two logarithmic axes, down to a part ``depth`` of the
    largest value.
    """
    top = 0.0
    for (name, (f, y)), colour, dashes in zip(
        curves.items(), COLOURS, ("-", "--", "-."), strict=False
    ):
        keep = (f > 0.0) & (f <= 200.0)
        top = max(top, float(np.nanmax(y[keep], initial=0.0)))
        ax.plot(
            f[keep],
            np.maximum(y[keep], 1e-300),
            color=colour,
            linestyle=dashes,
            linewidth=1.0,
            label=name,
        )
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="frequency [Hz]",
        ylabel=label,
        ylim=(depth * (top or 1.0), 4 * (top or 1.0)),
    )
    ax.legend(loc="upper left", fontsize=7)


def _line_of_sight(motion: Motion, hub: HubLines) -> Iterator[Item]:
    angle, within = pointing_angle(hub), hub.summary()["within"]
    summed = count_text(len(hub.names), "line") + (" and torque noise" if hub.density else "")
    yield Text(
        f"Sums of {summed} as mean squares; the line of sight stays within"
        f" {angle.figure(within['los_x_rad'])} about x and"
        f" {angle.figure(within['los_y_rad'])} about y for"
        f" {100 * within['confidence']:.4g} % of the time. The mean commanded motion is removed."
    )
    if hub.windows:
        yield _rms_in_windows(hub, angle)
        yield from _pixels_in_windows(hub, angle)
        yield _contributors_in_windows(hub, angle)
    yield angles_picture(motion, angle)


def _radial_sums(hub: HubLines) -> dict[tuple[float, str], float]:
    """Radial rms [rad] by window [s] and metric."""
    return {(row["window_s"], row["metric"]): row["radial_rad"] for row in hub.totals()}


def _window_columns(hub: HubLines, measure: Measure | None) -> tuple[Column, ...]:
    return tuple(Column(f"{w:g}_s", window_text(w), measure) for w in hub.windows)


def _rms_in_windows(hub: HubLines, angle: Measure) -> Table:
    """Radial rms in each window and metric."""
    sums = _radial_sums(hub)
    rows = [(metric_name(metric), *(sums[w, metric] for w in hub.windows)) for metric in METRICS]
    what = "all lines"
    if hub.density is not None:
        what = "all lines and torque noise (through the linearised drive)"
        for metric in _OF_NOISE:
            noise = (float(radial_rms(hub.noise(metric, w))) for w in hub.windows)
            rows.append((f"of which torque noise, {metric_name(metric)}", *noise))
    columns = (Column("metric", "metric"), *_window_columns(hub, angle))
    caption = f"Radial rms of {what}, by length of the window."
    return Table("", columns, tuple(rows), caption=caption)


_OF_NOISE: tuple[Metric, ...] = ("ape", "rpe")


def _pixels_in_windows(hub: HubLines, angle: Measure) -> Iterator[Table]:
    """Windows in pixels with the remaining contrast, where the line of sight has a pixel."""
    craft = hub.scenario.spacecraft
    los = None if craft is None else craft.line_of_sight
    if los is None or los.pixel is None:
        return
    sums = _radial_sums(hub)
    rows: list[tuple[str | float, ...]] = [
        (metric_name(m), *(sums[w, m] / los.pixel for w in hub.windows)) for m in METRICS
    ]
    for axis in "xy":
        left = (row["mtf_at_nyquist"] for row in hub.image() if row["axis"] == axis)
        rows.append((f"contrast (MTF), turns about {axis}", *(f"{one:.4f}" for one in left)))
    columns = (Column("metric", "metric"), *_window_columns(hub, Measure(form="#.3g")))
    caption = (
        f"The same in pixels of {angle.figure(los.pixel)}; contrast at half a cycle per"
        " pixel (below 0 it is reversed)."
    )
    yield Table("", columns, tuple(rows), caption=caption)


def _contributors_in_windows(hub: HubLines, angle: Measure) -> Table:
    """Which lines contribute most in each window."""
    ranks = [
        [x for x in hub.ranking("rpe", w)[:_MAX_CONTRIBUTORS] if x[1] > 0.0] for w in hub.windows
    ]
    columns = [[f"{_named(hub, line)}, {angle.text(rms)}" for line, rms in rank] for rank in ranks]
    padded = [[*column, *[""] * (_MAX_CONTRIBUTORS - len(column))] for column in columns]
    rows = tuple((str(k + 1), *(column[k] for column in padded)) for k in range(_MAX_CONTRIBUTORS))
    return Table(
        "",
        (Column("rank", "rank"), *_window_columns(hub, None)),
        rows,
        caption=f"Largest contributors in each window: RPE, radial rms in {angle.unit}. The"
        " start-up transient counts with its mean over the record (a longer"
        f" record.settle{steady_start_advice(hub.scenario)} leaves it out).",
    )


def _named(hub: HubLines, line: str) -> str:
    if line in hub.rings:
        return f"{line} (rings)"
    return line


def angles_picture(motion: Motion, angle: Measure) -> Picture:
    """Densities of both angles, and what they add up to from either end; out of accelerations,
    which no drift leaks into.
    """
    resolution = Si(motion.sample_rate / motion.time.size)
    spacecraft = motion.scenario.spacecraft
    lowest = _MIN_BINS * resolution
    if spacecraft is not None and spacecraft.attitude_control is None:
        lowest = max(lowest, MIN_FREQUENCY_WITHOUT_CONTROL)
    caption = (
        "Left, power spectral density of both angles (Hann window, bins of"
        f" {float(resolution):.3g} Hz, from {lowest:.3g} Hz on). Right, rms of both together, added"
        " up from either end."
    )
    draw = partial(draw_angles, motion, resolution, lowest, angle)
    return Picture("", draw, "Line of sight over frequency", caption)


def draw_angles(motion: Motion, resolution: Si, lowest: float, angle: Measure) -> Drawing:
    """Densities of both angles in bins of a ``resolution`` [Hz], that of the whole record, since
    what rings slowly counts most, from ``lowest`` [Hz] on, and their sums.
    """
    drawing, axes = plain_sheet(2.9, 1, 2)
    densities, total = {}, np.zeros(1)
    f = np.zeros(0)
    for name in ("los_x", "los_y"):
        found = power_spectral_density(
            motion[name.replace("los_", "los_a")], motion.sample_rate, resolution, "hann"
        )
        keep = found.frequency >= lowest
        f = found.frequency[keep]
        density = found.density[keep] / (2.0 * np.pi * f) ** 4
        densities[name] = (f, density / angle.size**2)
        total = total + density
    rms = [cumulative_rms(f, total, falling=falling) / angle.size for falling in (False, True)]
    _curves(axes[0, 0], densities, f"density [{angle.unit}²/Hz]", 1e-12)
    for y, label, dashes in zip(
        rms, ("from low to high", "from high to low"), ("-", "--"), strict=True
    ):
        axes[0, 1].semilogx(
            f, y, color=BLUE if dashes == "-" else RED, linestyle=dashes, linewidth=1.3, label=label
        )
    axes[0, 1].set(
        xlabel="frequency [Hz]",
        ylabel=f"cumulative rms, radial [{angle.unit}]",
        ylim=(0.0, None),
    )
    axes[0, 1].legend(loc="center right", fontsize=7)
    return drawing
