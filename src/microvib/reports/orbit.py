"""Lines and windows over an orbit as text, tables, picture and report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.io.tables import columns_csv, to_json
from microvib.reports import sheets
from microvib.reports.angles import SHOWN, draw_rms, label_axes, lines_csv
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import Contents, Document, Fact, Section, Text, table
from microvib.reports.numbers import angle_unit, brief_number
from microvib.solve.channels import LOAD_COLUMNS
from microvib.studies.orbit import MAX_QUASI_STATIC_CHANGE, TOLERANCE, Orbit
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAIN_METRICS = ("ape", "rpe", "smear", "jitter")
"""Metrics of the text and of the first page; the files have all."""


def orbit_text(orbit: Orbit) -> str:
    """Worst and rms of the windows over the orbit, how it was found, and what is to be known of it."""
    scenario, head, rows = orbit.sweep.scenario, *_windows(orbit)
    parts = [
        f"{scenario.title or 'Orbit'}: line of sight over {orbit.time[-1]:.6g} s, {_travel(orbit)}"
        " of the array.",
        text_table(head, [row for row in rows if row[0] in _MAIN_METRICS]),
        " ".join(_method_text(orbit)),
        *orbit.notes(),
    ]
    return "\n\n".join(parts)


def _travel(orbit: Orbit) -> str:
    first, last = np.degrees(orbit.sweep.angles[[0, -1]])
    return f"{first:g} to {last:g} deg"


def _windows(orbit: Orbit) -> tuple[list[str], list[list[str]]]:
    unit, size = angle_unit([w.worst for w in orbit.windows])
    head = [
        "metric",
        "window s",
        f"worst {unit}",
        "at deg",
        "at s",
        f"rms over orbit {unit}",
        "turning %",
    ]
    rows = []
    for w in orbit.windows:
        if w.metric == "ape":
            window = ""
        else:
            window = f"{w.window:g}"
        at = [f"{math.degrees(orbit.sweep.angles[w.at]):.4g}", f"{orbit.time[w.at]:.4g}"]
        rows.append(
            [
                w.metric,
                window,
                brief_number(w.worst / size),
                *at,
                brief_number(w.rms / size),
                f"{100 * w.turning:.2g}",
            ]
        )
    return head, rows


def _method_text(orbit: Orbit) -> list[str]:
    """Runs, halvings and the turning, in sentences."""
    rounds = ", then ".join(
        f"{100 * h.error:.2g} % at {h.tried} angles between {h.angles}" for h in orbit.halvings
    )
    return [
        f"{len(orbit.runs.angles)} angles run, {len(orbit.time)} evaluated.",
        f"Largest error of interpolation, over the rms of the orbit: {rounds}.",
        "While the mode that rings longest falls to 1/e, the array turns by"
        f" {math.degrees(orbit.turned_in_decay):.2g} deg.",
    ]


def orbit_folder(orbit: Orbit) -> Contents:
    """Tables, JSON, picture and report."""
    sweep, degrees = orbit.sweep, np.degrees(orbit.sweep.angles)
    loads = np.sqrt(0.5 * np.sum(np.abs([one.loads for one in sweep.lines]) ** 2, axis=1))
    at = {"time_s": orbit.time, "angle_deg": degrees}
    over = at | {
        f"{w.metric}{'' if w.metric == 'ape' else f'_{w.window:g}s'}_radial_rad": orbit.size(
            w.metric, w.window
        )
        for w in orbit.windows
    }
    over |= {f"{name}_rms": column for name, column in zip(LOAD_COLUMNS, loads.T, strict=True)}
    said = {
        "time_s": float(orbit.time[-1]),
        "from_deg": float(degrees[0]),
        "to_deg": float(degrees[-1]),
        "windows": [
            {"metric": w.metric, "window_s": w.window, "worst_rad": w.worst, "worst_deg": float(degrees[w.at]),
             "worst_s": float(orbit.time[w.at]), "rms_rad": w.rms, "turning": w.turning}
            for w in orbit.windows
        ],
        "loads": {name: {"worst": float(x.max()), "rms": orbit.mean(x**2)} for name, x in zip(LOAD_COLUMNS, loads.T, strict=True)},
        "angles_run_deg": np.degrees(orbit.runs.angles).tolist(),
        "halvings": [{"angles": h.angles, "tried": h.tried, "error": h.error} for h in orbit.halvings],
        "interpolation_error": orbit.interpolation,
        "turned_in_decay_deg": math.degrees(orbit.turned_in_decay),
        "quasi_static": orbit.quasi_static,
        "notes": orbit.notes(),
    }  # fmt: skip
    picture = draw_orbit(orbit)
    files: dict[str, Any] = {
        "orbit.csv": columns_csv(over),
        "orbit_lines.csv": lines_csv(sweep, **at),
        "orbit.json": to_json(said),
        "orbit.png": sheets.png(picture),
    }
    return files, orbit_report(orbit, picture)


def orbit_report(orbit: Orbit, picture: Figure) -> Document:
    """The report: worst instant, rms, what they are worth; picture; every window."""
    whole, scenario = orbit.windows[0], orbit.sweep.scenario
    facts = [
        Fact(
            f"{1e9 * whole.worst:.4g} nrad",
            f"worst, at {math.degrees(orbit.sweep.angles[whole.at]):.4g}°,"
            f" {orbit.time[whole.at]:.0f} s",
        ),
        Fact(f"{1e9 * whole.rms:.4g} nrad", "rms over the orbit"),
        Fact(f"{100 * orbit.interpolation:.2g} %", "of it may be wrong between the angles that were run"),
    ]  # fmt: skip
    head, rows = _windows(orbit)
    units = [f"{stem} [{unit}]" for stem, _, unit in (x.rpartition(" ") for x in head[1:])]
    heads, notes = [head[0], *units], [Text(text, note=True) for text in orbit.notes()]
    meaning = (
        "Turning: size of what the array's rate itself changes (the modes' change while they"
        " settle, gyroscopic terms), of the"
        f" rms; above {100 * MAX_QUASI_STATIC_CHANGE:g} % the angles cannot be taken one by one."
        " Steps are halved from"
        f" {100 * TOLERANCE:g} %."
    )
    return study_report(
        "Orbit",
        f"Over an orbit: {scenario.title or 'drive'}",
        f"{orbit.time[-1]:.6g} s, {_travel(orbit)} of the array",
        facts=facts,
        first_page=(
            *notes,
            table(heads, [row for row in rows if row[0] in _MAIN_METRICS], meaning),
            figure_block(picture, "Lines and windows over the orbit", _CAPTION),
        ),
        sections=[
            Section("Every window", (table(heads, rows),)),
            Section("How it was found", tuple(map(Text, _method_text(orbit)))),
        ],
        scenario=scenario,
    )


_CAPTION = "Left, lines of the line of sight, radial, 0-to-peak, over the orbit's time; dots were run. Right, rms of all lines."


def draw_orbit(orbit: Orbit) -> Figure:
    """The largest lines over the time, dots where they were run; and the rms in each window."""
    drawing, axes = sheets.sheet(3.0, 1, 2)
    left, right = axes[0]
    sweep, minutes = orbit.sweep, orbit.time / 60.0
    run = (orbit.runs.angles - sweep.angles[0]) / (sweep.angles[-1] - sweep.angles[0]) * minutes[-1]
    for k, name in enumerate(sweep.names[:SHOWN]):
        left.plot(
            minutes, 1e6 * sweep.los(name), color=sheets.COLOURS[k], linewidth=0.9, label=name
        )
        left.plot(run, 1e6 * orbit.runs.los(name), "o", color=sheets.COLOURS[k], markersize=2.5)
    draw_rms(right, minutes, sweep.lines[0].windows, orbit.size, "-")
    label_axes(left, right, "time [min]")
    return drawing
