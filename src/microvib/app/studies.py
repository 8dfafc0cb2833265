"""Comparison and identification from command to folder: text, tables and report of each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from microvib.app import plots
from microvib.app.reports.document import Document, Fact, Figure, Form, Mark, Section, Table, Text, pairs, table
from microvib.app.reports.pieces import drawn, figure, milli, number, percent, plain, signed, study, with_error
from microvib.app.reports.rendering import report_files
from microvib.io.results import package_versions, to_json, write_folder
from microvib.io.scenario_file import dump_scenario
from microvib.studies.compare import Row, Side, rows_csv
from microvib.studies.evidence import Evidence, Simulated, predicted
from microvib.studies.identify import Estimate, Fit
from microvib.units import pretty

CALIBRATED = "Calibrated, not predicted: these figures were fitted to."
_HOW_TO_READ = (
    "Standard errors include the scatter that the fit leaves. A parameter counts as identifiable if its standard error is"
    " below 20 %, it is not at the end of its range, and it can be told from the others."
)
_SENSITIVITY = "Relative change of a figure for a relative change of a parameter."
_MOST_IN_FRONT = 10
"""Lines on the first page of a comparison."""
_MAIN = ("array_mode_1", "full_step_1", "drive_1", "drive_2", "drive_3")


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


def write_comparison(
    out: Path, a: Side, b: Side, rows: Sequence[Row], overwrite: bool, form: Form | None = None
) -> tuple[str, ...]:
    """``compare.csv`` and the report of a comparison; names of the files."""
    files: dict[str, Any] = {"compare.csv": rows_csv(list(rows))}
    files |= report_files(comparison_report(a, b, rows, form), form)
    write_folder(out, files, overwrite)
    return tuple(files)


def comparison_report(a: Side, b: Side, rows: Sequence[Row], form: Form | None = None) -> Document:
    """The report of a comparison: lines wherever the bins fall, the paper's nearest bins, spectra over each other."""
    shown = _worth_a_row(rows)
    defensible = [r for r in shown if math.isfinite(r.error)]
    binned = [r for r in shown if math.isfinite(r.bin_error)]
    main = sorted(defensible, key=lambda r: -r.a.amplitude)[:_MOST_IN_FRONT]
    sections = [Section("All lines", _line_table(defensible), new_page=True)] if len(main) < len(defensible) else []
    sections += [Section("Nearest bins (as Tables 5 and 6)", _bin_table(binned))] if binned else []
    return study(
        "Comparison report",
        "Comparison of disturbance lines",
        f"B against A: {b.name} ({b.kind}) against {a.name} ({a.kind}).",
        facts=_differences(shown),
        front=(
            pairs(_side(mark, s) for mark, s in (("A", a), ("B", b))),
            *_line_table([r for r in defensible if r in main]),
            *_spectra(a, b),
        ),
        sections=sections,
        form=form,
    )


def _differences(rows: Sequence[Row]) -> list[Fact]:
    """Differences of the largest lines: those wherever the bins fall, else those of nearest bins."""
    found = [(r, r.error, r.a.amplitude) for r in rows if math.isfinite(r.error)]
    found = found or [(r, r.bin_error, r.a.bin_amplitude) for r in rows if math.isfinite(r.bin_error)]
    found.sort(key=lambda item: -item[2])
    return [Fact(f"{percent(error)} %", f"{r.line}, B against A") for r, error, _ in found[:4]]


def _side(mark: str, side: Side) -> tuple[str, str]:
    clock = "" if side.clock_ratio is None else f"; step clock {side.clock_ratio:.7f} of nominal"
    return mark, f"{side.name} ({side.kind}){clock}"


def _line_table(rows: Sequence[Row]) -> tuple[Text | Table, ...]:
    if not rows:
        return ()
    header = ["line", "A [Hz]", "B [Hz]", "A [mN m]", "B [mN m]", "B - A [mN m]", "B/A - 1 [%]", "over uncertainty [1]"]
    cells = [
        [r.line, number(r.a.frequency, 7), number(r.b.frequency, 7), milli(r.a.amplitude), milli(r.b.amplitude),
         milli(r.b.amplitude - r.a.amplitude, 3), percent(r.error), number(r.significance, 3)]
        for r in rows
    ]  # fmt: skip
    caption = (
        "Amplitudes 0-to-peak, wherever the bins fall; clocks aligned. The last column is the difference over its standard"
        " uncertainty: above 2 or so it is no chance. Names with _of_b are lines that only B has."
    )
    return (table(header, cells, caption),)


def _bin_table(rows: Sequence[Row]) -> tuple[Text | Table, ...]:
    header = ["line", "A [Hz]", "B [Hz]", "A [mN m]", "B [mN m]", "B - A [mN m]", "B/A - 1 [%]"]
    cells = [
        [r.line, number(r.a.bin_frequency, 7), number(r.b.bin_frequency, 7), milli(r.a.bin_amplitude), milli(r.b.bin_amplitude),
         milli(r.b.bin_amplitude - r.a.bin_amplitude, 3), percent(r.bin_error)]
        for r in rows
    ]  # fmt: skip
    return Text("The paper's estimator: rectangular window, nearest bin. Between bins it reads up to 36 % low."), table(
        header, cells
    )


def _spectra(a: Side, b: Side) -> tuple[Figure, ...]:
    measured = [
        (f"{mark}: {s.name}", s.torque, s.sample_rate) for mark, s in (("A", a), ("B", b)) if s.torque is not None
    ]
    if not measured:
        return ()
    drawing, axes = plots.sheet(3.6, 1, 2)
    for ax, highest in zip(axes[0], (5.0, 200.0), strict=True):
        plots.draw_overlay(ax, measured, highest)
    return (
        drawn(
            drawing,
            "Spectra of both sides",
            "One-sided amplitude spectra, 0-to-peak; A is drawn wide, B narrow over it.",
        ),
    )


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


def write_fit(out: Path, fit: Fit, overwrite: bool, form: Form | None = None) -> tuple[str, ...]:
    """``fit.json``, ``scenario.yaml`` and the report of an identification; names of the files."""
    files: dict[str, Any] = {"fit.json": to_json(fit_json(fit)), "scenario.yaml": dump_scenario(fit.scenario)}
    files |= report_files(fit_report(fit, form), form)
    write_folder(out, files, overwrite)
    return tuple(files)


def fit_report(fit: Fit, form: Form | None = None) -> Document:
    """The report of an identification: parameters with what they are worth, lines before and after, what tells what."""
    tests = ", ".join(f"{e.name} ({len(e.observations)} observations)" for e, _ in fit.after)
    stopped = " Interrupted: the best so far." if fit.interrupted else ""
    return study(
        "Identification report",
        f"Identification: {fit.scenario.title or 'drive'}",
        f"From {tests}; {fit.simulations} simulations, seed {fit.seed}.{stopped}",
        facts=[_estimated(e) for e in fit.estimates[:4]],
        front=(_estimates(fit), Text(f"{CALIBRATED} {_HOW_TO_READ}", note=True), _before_and_after_picture(fit)),
        sections=(
            Section("Before and after", (Text(CALIBRATED), _before_and_after(fit)), new_page=True),
            Section(
                "Correlation of the estimates",
                (_matrix("parameter", fit, zip(_keys(fit), fit.correlation, strict=True)),),
            ),
            Section("Sensitivities", (Text(_SENSITIVITY), _matrix("figure", fit, fit.sensitivities.items()))),
        ),
        form=form,
        scenario=fit.scenario,
    )


def _estimated(e: Estimate) -> Fact:
    value = f"{with_error(e.estimate, e.standard_error)} {pretty(e.unit)}".rstrip()
    return Fact(value, f"{e.key}: {'identifiable' if e.identifiable else 'NOT identifiable'}")


def _estimates(fit: Fit) -> Table:
    header = ["`parameter`", "estimate ± standard error [1]", "unit", "range [1]", "verdict"]
    rows = [
        [
            e.key,
            with_error(e.estimate, e.standard_error),
            pretty(e.unit),
            f"{plain(e.low)} to {plain(e.high)}",
            e.verdict,
        ]
        for e in fit.estimates
    ]
    marks: dict[int, Mark] = {k: "fail" for k, e in enumerate(fit.estimates) if not e.identifiable}
    return table(header, rows, "", marks)


def _before_and_after(fit: Fit) -> Table:
    rows = [
        [name, figure(1e3 * t), figure(1e3 * b), figure(1e3 * a), percent(b / t - 1), percent(a / t - 1)]
        if _is_torque(name)
        else [name, figure(t, 6), figure(b, 6), figure(a, 6), percent(b / t - 1), percent(a / t - 1)]
        for name, t, b, a in _figures(fit)
    ]
    for row, (name, *_) in zip(rows, _figures(fit), strict=True):
        row.insert(1, "mN m" if _is_torque(name) else "Hz" if "frequency" in name else "1/s")
    header = [
        "figure",
        "unit",
        "test [1]",
        "before [1]",
        "after [1]",
        "before against test [%]",
        "after against test [%]",
    ]
    return table(header, rows)


def _is_torque(figure_name: str) -> bool:
    return "amplitude" in figure_name or "nearest_bin" in figure_name


def _before_and_after_picture(fit: Fit) -> Figure:
    amplitudes = [f for f in _figures(fit) if _is_torque(f[0])][:12]
    drawing, axes = plots.sheet(3.4)
    test, before, after = ([float(f[k]) for f in amplitudes] for k in (1, 2, 3))
    groups = {"test": test, "before": before, "after": after}
    plots.draw_pairs(axes[0, 0], [f[0].removesuffix(" amplitude") for f in amplitudes], groups)
    return drawn(
        drawing,
        "Amplitudes of the test, before and after",
        "Amplitudes of the lines in the test, before and after the fit.",
    )


def _keys(fit: Fit) -> list[str]:
    return [e.key for e in fit.estimates]


def _matrix(of: str, fit: Fit, rows: Iterable[tuple[str, Iterable[float]]]) -> Table:
    header = [of, *(f"{_short_key(key)} [1]" for key in _keys(fit))]
    return table(header, ([name, *(signed(x) for x in row)] for name, row in rows if "phase" not in name))


def _short_key(key: str) -> str:
    """The end of a key that says what it is."""
    parts = key.split(".")
    return ".".join(parts[-3 if len(parts) > 2 and parts[-2].isdigit() else -2 :])
