"""Lines and windows over an orbit: their tables and picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.analysis.margins import NoVerdict, Verdict, worst_verdict
from microvib.reports import sheets
from microvib.reports.angles import (
    SHOWN,
    angle_margins,
    draw_rms,
    label_axes,
    limit_facts,
    limit_items,
    lines_table,
)
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import format_number
from microvib.reports.outcome import Item, Outcome, Part, Picture
from microvib.results import ARRAY_ANGLE, FREQUENCY, Column, Measure, Table
from microvib.solve.channels import LOAD_COLUMNS
from microvib.studies.orbit import (
    MAX_QUASI_STATIC_CHANGE,
    TOLERANCE,
    ExpectedExcess,
    Orbit,
    WindowOverOrbit,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAIN_METRICS = ("ape", "rpe", "smear", "jitter")
"""Metrics that stand first, and alone on a terminal."""


def orbit_outcome(orbit: Orbit) -> Outcome:
    """An orbit for those who read it: worst and rms of the windows, lines over the time, how it was
    found, and what is to be known of it.
    """
    windows, loads = _windows(orbit), _loads(orbit)
    los = windows.measure("worst_rad")
    picture = Picture(
        "orbit", lambda: draw_orbit(orbit, los), "Lines and windows over the orbit", _CAPTION
    )
    at = {"time_s": orbit.time, "angle_deg": np.degrees(orbit.sweep.angles)}
    return Outcome(
        "Orbit",
        f"Over an orbit: {orbit.sweep.scenario.title or 'drive'}",
        _how(orbit),
        _verdict(orbit),
        (*_limit_facts(orbit), *_facts(orbit, los)),
        (
            Part(
                "",
                (*_limit_items(orbit), *(Text(text, note=True) for text in orbit.notes()), picture),
            ),
            Part("Windows over the orbit", (windows,)),
            Part("Method of solution", (Text(" ".join(_method(orbit))),)),
        ),
        orbit.sweep.scenario,
        files=(
            _over_time(orbit, at, loads),
            lines_table("orbit_lines", orbit.sweep, **at),
        ),
        data={"orbit": _data(orbit, windows, loads)},
    )


_CAPTION = (
    "Left, lines of the line of sight, radial, 0-to-peak, over the orbit's time; dots were run."
    " Right, rms of all lines."
)
_MEANING = (
    "Turning: size of what the array's rate itself changes (the modes' change while they settle,"
    " gyroscopic terms), of the rms; above"
    f" {100 * MAX_QUASI_STATIC_CHANGE:g} % the angles cannot be taken one by one. Steps are halved"
    f" from {100 * TOLERANCE:g} %."
)


def _verdict(orbit: Orbit) -> Verdict | NoVerdict:
    """The worst of the angles that were run; no pass where a line is expected above the limit between them."""
    if orbit.judged is None:
        return ""
    expected: Verdict | NoVerdict = "" if orbit.excess is None else "not judged"
    return worst_verdict([*(one.verdict for one in orbit.judged.judgements), expected])


def _limit_facts(orbit: Orbit) -> Iterator[Fact]:
    if orbit.judged is None:
        return
    if orbit.excess is not None and _verdict(orbit) == "not judged":
        yield Fact("not judged", _excess_words(orbit.excess), "fail")
    yield from limit_facts(orbit.judged)


def _limit_items(orbit: Orbit) -> Iterator[Item]:
    """Sentences and table on the limit at the angles that were run, and on what is expected between them."""
    if orbit.judged is None:
        return
    yield from limit_items(orbit.judged)
    if orbit.excess is not None:
        yield Text(f"Between them {_excess_words(orbit.excess)}: the orbit does not pass.")


def _excess_words(one: ExpectedExcess) -> str:
    unit = "N" if one.component.startswith("F") else "N m"
    return (
        f"{one.line} of {one.component} at {FREQUENCY.figure(one.frequency)} is expected to have"
        f" {format_number(one.amplitude, 3)} {unit} at {ARRAY_ANGLE.figure(one.angle)}, where"
        f" {format_number(one.allowed, 3)} {unit} are allowed"
    )


def _how(orbit: Orbit) -> str:
    first, last = np.degrees(orbit.sweep.angles[[0, -1]])
    return f"Line of sight over {orbit.time[-1]:.6g} s, {first:g} to {last:g} deg of the array."


def _windows(orbit: Orbit) -> Table:
    """Every metric in every window; for readers the main ones first."""
    main = [w for w in orbit.windows if w.metric in _MAIN_METRICS]
    others = [w for w in orbit.windows if w.metric not in _MAIN_METRICS]
    return Table.of(
        "orbit_windows",
        WindowOverOrbit,
        orbit.windows,
        for_readers=map(_for_readers, [*main, *others]),
        brief=len(main),
        caption=_MEANING,
    )


def _for_readers(one: WindowOverOrbit) -> WindowOverOrbit:
    """The motion itself needs no window."""
    return replace(one, window=math.nan) if one.metric == "ape" else one


def _method(orbit: Orbit) -> list[str]:
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


def _facts(orbit: Orbit, los: Measure) -> Iterator[Fact]:
    whole = orbit.windows[0]
    at = f"{ARRAY_ANGLE.figure(whole.angle)}, {whole.time:.0f} s"
    yield Fact(los.figure(whole.worst), f"worst, at {at}")
    yield Fact(los.figure(whole.rms), "rms over the orbit")
    error = f"{100 * orbit.interpolation:.2g} %"
    yield Fact(error, "of it may be wrong between the angles that were run")


def _loads(orbit: Orbit) -> dict[str, np.ndarray]:
    """Rms of all lines of each load at each time, (n,)."""
    squares = np.abs([one.loads for one in orbit.sweep.lines]) ** 2
    rms = np.sqrt(0.5 * np.sum(squares, axis=1))
    return dict(zip(LOAD_COLUMNS, rms.T, strict=True))


def _over_time(orbit: Orbit, at: dict[str, np.ndarray], loads: dict[str, np.ndarray]) -> Table:
    """Windows and loads over the time, for a file."""
    columns = dict(at)
    for w in orbit.windows:
        window = "" if w.metric == "ape" else f"_{w.window:g}s"
        columns[f"{w.metric}{window}_radial_rad"] = orbit.size(w.metric, w.window)
    columns |= {f"{name}_rms": values for name, values in loads.items()}
    rows = tuple(zip(*(values.tolist() for values in columns.values()), strict=True))
    return Table("orbit", tuple(map(Column, columns)), rows)


def _data(orbit: Orbit, windows: Table, loads: dict[str, np.ndarray]) -> dict[str, Any]:
    first, last = np.degrees(orbit.sweep.angles[[0, -1]])
    return {
        "time_s": float(orbit.time[-1]),
        "from_deg": float(first),
        "to_deg": float(last),
        "windows": windows.records(),
        "loads": {name: {"worst": float(x.max()), "rms": orbit.mean(x**2)} for name, x in loads.items()},
        "angles_run_deg": np.degrees(orbit.runs.angles).tolist(),
        "halvings": [{"angles": h.angles, "tried": h.tried, "error": h.error} for h in orbit.halvings],
        "interpolation_error": orbit.interpolation,
        "turned_in_decay_deg": math.degrees(orbit.turned_in_decay),
        "quasi_static": orbit.quasi_static,
        "notes": orbit.notes(),
        "judgement": _judged_data(orbit),
    }  # fmt: skip


def _judged_data(orbit: Orbit) -> dict[str, Any] | None:
    """The verdict, that at each angle, and what is expected between; None without a limit."""
    if orbit.judged is None:
        return None
    return {
        "verdict": _verdict(orbit),
        "angles": [
            {"angle_deg": math.degrees(row.angle), "verdict": row.verdict}
            for row in angle_margins(orbit.judged)
        ],
        "expected_excess": None if orbit.excess is None else asdict(orbit.excess),
    }


def draw_orbit(orbit: Orbit, los: Measure) -> Figure:
    """The largest lines over the time, dots where they were run, and the rms in each window; in the
    unit of ``los``.
    """
    drawing, axes = sheets.sheet(3.0, 1, 2)
    left, right = axes[0]
    sweep, minutes = orbit.sweep, orbit.time / 60.0
    run = (orbit.runs.angles - sweep.angles[0]) / (sweep.angles[-1] - sweep.angles[0]) * minutes[-1]
    for k, name in enumerate(sweep.names[:SHOWN]):
        left.plot(
            minutes, sweep.los(name) / los.size, color=sheets.COLOURS[k], linewidth=0.9, label=name
        )
        left.plot(
            run, orbit.runs.los(name) / los.size, "o", color=sheets.COLOURS[k], markersize=2.5
        )
    draw_rms(right, minutes, sweep.lines[0].windows, orbit.size, los, "-")
    label_axes(left, right, "time [min]", los)
    return drawing
