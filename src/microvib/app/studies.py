"""Studies from command to folder: comparison and identification, each with its tables and its report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from microvib.app import plots
from microvib.app.report import picture, render
from microvib.io.results import package_versions, to_json, write_folder
from microvib.io.scenario_file import dump_scenario
from microvib.studies.compare import Row, Side, rows_csv
from microvib.studies.evidence import Evidence, Simulated, predicted
from microvib.studies.identify import Fit

CALIBRATED = "Calibrated, not predicted: these figures were fitted to."
_HOW_TO_READ = (
    "Standard errors include the scatter that the fit leaves. A parameter counts as identifiable if its standard error is"
    " below 20 %, it is not at the end of its range, and it can be told from the others."
)
_SENSITIVITY = "Relative change of a figure for a relative change of a parameter."
_MAIN = ("array_mode_1", "full_step_1", "drive_1", "drive_2", "drive_3")


def page(title: str, lead: str, sections: list[dict[str, Any]]) -> str:
    """HTML text of a report in sections, each with text, a table, a figure, or what of these it has."""
    version = package_versions()["microvib"]
    return render("study.html", title=title, lead=lead, sections=sections, version=version)


def number(value: float, digits: int = 4) -> str:
    """A figure for a table; empty where there is none."""
    return f"{value:.{digits}g}" if math.isfinite(value) else ""


def percent(value: float) -> str:
    """A relative difference for a table."""
    return f"{100 * value:+.2f}" if math.isfinite(value) else ""


def comparison_text(a: Side, b: Side, rows: Sequence[Row]) -> str:
    """Tables 5 and 6 for any pair, as text: the nearest-bin form, and the form that does not depend on bins."""
    clocks = ", ".join(f"{s.name}: {s.clock_ratio:.7f}" for s in (a, b) if s.clock_ratio is not None)
    lines = [
        f"A: {a.name} ({a.kind})",
        f"B: {b.name} ({b.kind})",
        *([f"step clock over nominal: {clocks}"] if clocks else []),
        "",
    ]
    header = ("A Hz", "B Hz", "A N m", "B N m", "B/A %", "A bin N m", "B bin N m", "B/A %")
    lines.append(f"{'line':16s}" + "".join(f"{text:>12s}" for text in header))
    for row in _worth_a_row(rows):
        hz = [x.frequency if math.isfinite(x.frequency) else x.bin_frequency for x in (row.a, row.b)]
        cells = [
            number(hz[0], 8),
            number(hz[1], 8),
            number(row.a.amplitude),
            number(row.b.amplitude),
            percent(row.error),
        ]
        cells += [number(row.a.bin_amplitude), number(row.b.bin_amplitude), percent(row.bin_error)]
        lines.append(f"{row.line:16s}" + "".join(f"{cell:>12s}" for cell in cells))
    return "\n".join(lines)


def _worth_a_row(rows: Sequence[Row]) -> list[Row]:
    """Lines of at least a thousandth of the largest on either side; sidebands and unexpected lines a fiftieth."""

    def size(row: Row) -> float:
        values = [x.amplitude if math.isfinite(x.amplitude) else x.bin_amplitude for x in (row.a, row.b)]
        return max((v for v in values if math.isfinite(v)), default=0.0)

    def least(row: Row) -> float:
        return 0.02 if any(mark in row.line for mark in ("_plus_", "_minus_", "other_")) else 1e-3

    top = max((size(row) for row in rows), default=0.0)
    return [row for row in rows if size(row) >= least(row) * top]


def write_comparison(out: Path, a: Side, b: Side, rows: Sequence[Row], overwrite: bool) -> tuple[str, ...]:
    """``compare.csv`` and ``report.html`` of a comparison; names of the files."""
    files: dict[str, Any] = {"compare.csv": rows_csv(list(rows)), "report.html": _comparison_report(a, b, rows)}
    write_folder(out, files, overwrite)
    return tuple(files)


def _comparison_report(a: Side, b: Side, rows: Sequence[Row]) -> str:
    shown = _worth_a_row(rows)
    header = [
        "line",
        "A [Hz]",
        "B [Hz]",
        "A [mN m]",
        "B [mN m]",
        "B - A [mN m]",
        "B/A - 1 [%]",
        "over its uncertainty [1]",
    ]
    defensible = [
        [r.line, number(r.a.frequency, 8), number(r.b.frequency, 8), number(1e3 * r.a.amplitude), number(1e3 * r.b.amplitude),
         number(1e3 * (r.b.amplitude - r.a.amplitude), 3), percent(r.error), number(r.significance, 3)]
        for r in shown if math.isfinite(r.error)
    ]  # fmt: skip
    nearest = [
        [r.line, number(r.a.bin_frequency, 8), number(r.b.bin_frequency, 8), number(1e3 * r.a.bin_amplitude),
         number(1e3 * r.b.bin_amplitude), number(1e3 * (r.b.bin_amplitude - r.a.bin_amplitude), 3), percent(r.bin_error)]
        for r in shown if math.isfinite(r.bin_error)
    ]  # fmt: skip
    sections = []
    if defensible:
        text = "Amplitudes 0-to-peak, wherever the bins fall; clocks aligned."
        sections.append({"title": "Lines", "text": text, "header": header, "rows": defensible})
    text = "The paper's estimator: rectangular window, nearest bin. Between bins it reads up to 36 % low."
    sections.append({"title": "Nearest bins (Tables 5 and 6)", "text": text, "header": header[:7], "rows": nearest})
    measured = [
        (f"{mark}: {s.name}", s.torque, s.sample_rate) for mark, s in (("A", a), ("B", b)) if s.torque is not None
    ]
    if measured:
        figure, axes = plots.new_figure(11.0, 4.2, 1, 2)
        for ax, highest in zip(axes[0], (5.0, 200.0), strict=True):
            plots.draw_overlay(ax, measured, highest)
        sections.append(
            {"title": "Spectra", "figure": picture(figure), "caption": "One-sided amplitude spectra, 0-to-peak."}
        )
    clocks = "; ".join(
        f"{s.name}: step clock {s.clock_ratio:.7f} of nominal" for s in (a, b) if s.clock_ratio is not None
    )
    lead = f"A is {a.name} ({a.kind}), B is {b.name} ({b.kind}). {clocks}"
    return page("Comparison of disturbance lines", lead, sections)


def fit_text(fit: Fit) -> str:
    """Estimates, verdicts, and the lines before and after, as text."""
    lines = [f"{'parameter':32s} {'estimate':>12s} {'std error':>10s}  {'unit':12s} verdict"]
    lines += [
        f"{e.key:32s} {e.estimate:12.6g} {e.standard_error:10.2g}  {e.unit:12s} {e.verdict}" for e in fit.estimates
    ]
    lines += ["", f"{'observed':28s} {'test':>12s} {'before':>12s} {'after':>12s} {'before %':>9s} {'after %':>9s}"]
    for name, test, before, after in _figures(fit):
        lines.append(
            f"{name:28s} {test:12.6g} {before:12.6g} {after:12.6g} {percent(before / test - 1):>9s} {percent(after / test - 1):>9s}"
        )
    lines.append(f"\n{fit.observations} observations, {fit.simulations} simulations, seed {fit.seed}. {CALIBRATED}")
    if fit.interrupted:
        lines.append("Interrupted: the best so far.")
    return "\n".join(lines)


def _figures(fit: Fit) -> list[tuple[str, float, float, float]]:
    """Amplitudes and mode figures of the tests with their values before and after."""
    rows = []
    for (evidence, before), (_, after) in zip(fit.before, fit.after, strict=True):
        rows += _of_one(evidence, before, after, len(fit.before) > 1)
    return rows


def _of_one(
    evidence: Evidence, before: Simulated, after: Simulated, several: bool
) -> list[tuple[str, float, float, float]]:
    mark = f" [{evidence.name}]" if several else ""
    return [
        (f"{o.line} {o.form}{mark}", o.value, predicted(before, o), predicted(after, o))
        for o in evidence.observations
        if o.form != "phase" and (o.line in _MAIN or (o.line.startswith(("drive", "array")) and "us_" not in o.line))
    ]


def fit_json(fit: Fit) -> dict[str, Any]:
    """What ``fit.json`` holds."""
    names = [e.key for e in fit.estimates]

    def by_name(row: Sequence[float]) -> dict[str, float]:
        return dict(zip(names, map(float, row), strict=True))

    return {
        "parameters": {
            e.key: {
                "estimate": e.estimate, "standard_error": e.standard_error, "unit": e.unit,
                "confidence_95": [e.estimate - 1.96 * e.standard_error, e.estimate + 1.96 * e.standard_error],
                "low": e.low, "high": e.high, "identifiable": e.identifiable, "verdict": e.verdict,
            }
            for e in fit.estimates
        },
        "correlation": {name: by_name(row) for name, row in zip(names, fit.correlation, strict=True)},
        "sensitivities": {figure: by_name(row) for figure, row in fit.sensitivities.items()},
        "evidence": [
            {"name": e.name, "clock_ratio": e.clock_ratio, "observations": len(e.observations)} for e, _ in fit.after
        ],
        "cost": fit.cost, "observations": fit.observations, "simulations": fit.simulations, "seed": fit.seed,
        "interrupted": fit.interrupted, "status": "calibrated: these lines were fitted to", "versions": package_versions(),
    }  # fmt: skip


def write_fit(out: Path, fit: Fit, overwrite: bool) -> tuple[str, ...]:
    """``fit.json``, ``scenario.yaml`` and ``report.html`` of an identification; names of the files."""
    files: dict[str, Any] = {
        "fit.json": to_json(fit_json(fit)),
        "scenario.yaml": dump_scenario(fit.scenario),
        "report.html": _fit_report(fit),
    }
    write_folder(out, files, overwrite)
    return tuple(files)


def _fit_report(fit: Fit) -> str:
    estimates = [
        [
            e.key,
            number(e.estimate, 6),
            number(e.standard_error, 2),
            e.unit,
            f"{number(e.low)} to {number(e.high)}",
            e.verdict,
        ]
        for e in fit.estimates
    ]
    names = [e.key for e in fit.estimates]
    short = [f"{name.split('.')[-2]}.{name.split('.')[-1]} [1]" for name in names]
    correlation = [[name, *(f"{x:+.2f}" for x in row)] for name, row in zip(names, fit.correlation, strict=True)]
    sensitivity = [
        [figure, *(f"{x:+.2f}" for x in row)] for figure, row in fit.sensitivities.items() if "phase" not in figure
    ]
    figures = _figures(fit)
    rows = [[n, number(t), number(b), number(a), percent(b / t - 1), percent(a / t - 1)] for n, t, b, a in figures]
    amplitudes = [f for f in figures if "amplitude" in f[0] or "bin" in f[0]][:12]
    figure, axes = plots.new_figure(11.0, 4.0)
    groups = {
        "test": [f[1] for f in amplitudes],
        "before": [f[2] for f in amplitudes],
        "after": [f[3] for f in amplitudes],
    }
    plots.draw_pairs(axes[0, 0], [f[0] for f in amplitudes], groups)
    header = ["parameter", "estimate [SI]", "standard error [SI]", "unit", "range", "verdict"]
    figures_header = ["figure", "test [SI]", "before [SI]", "after [SI]", "before [%]", "after [%]"]
    sections: list[dict[str, Any]] = [
        {"title": "Parameters", "header": header, "rows": estimates, "text": _HOW_TO_READ},
        {
            "title": "Before and after",
            "figure": picture(figure),
            "header": figures_header,
            "rows": rows,
            "text": CALIBRATED,
        },
        {"title": "Correlation", "header": ["parameter", *short], "rows": correlation},
        {"title": "Sensitivities", "header": ["figure", *short], "rows": sensitivity, "text": _SENSITIVITY},
    ]
    tests = ", ".join(f"{e.name} ({len(e.observations)} observations)" for e, _ in fit.after)
    lead = f"Identified from {tests}. {fit.simulations} simulations, seed {fit.seed}." + (
        " Interrupted: the best so far." if fit.interrupted else ""
    )
    return page(f"Identification: {fit.scenario.title}", lead, sections)
