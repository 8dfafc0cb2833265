"""Identification from command to folder: text, tables and report."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import package_versions, to_json
from microvib.reports import figures, sheets
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import Contents, Document, Fact, Mark, Section, Table, Text, table
from microvib.reports.numbers import (
    brief_number,
    format_number,
    percent,
    plain_number,
    signed,
    with_error,
)
from microvib.reports.typography import file_name
from microvib.signals.line_table import ResidualPeaks
from microvib.studies.evidence import Evidence, predicted
from microvib.studies.identify import Deviation, Estimate, Fit
from microvib.studies.identify.goodness import unwrap_to_measured
from microvib.text_tables import text_table
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

CALIBRATED = "Calibrated, not predicted: the parameters were fitted to these figures."
_HOW_TO_READ = (
    "Intervals have 95 % confidence. They come from the profile of the cost where its curvature"
    " alone would mislead, and are"
    " widened by the scatter that the fit leaves. They hold for the model as it is: whatever was"
    " not fitted is taken as exact"
    " (see what the estimates depend on)."
    " A parameter counts as identifiable if the model explains the data, the standard error is"
    " below 20 %, the best value lies"
    " inside its range and no other explains the data as well."
)
_SENSITIVITY = "Relative change of a figure for a relative change of a parameter."
_DEPENDENCE_NOTE = (
    "Relative change of an estimate for a relative change of a parameter that was not fitted, to"
    " first order: 2 means that"
    " 1 % moves it by 2 %. No interval includes an error of such a parameter."
)
_SELECTION = (
    "Each candidate, together with all effects that the evidence asks for: by how much it lowers"
    " chi-square, and the threshold that"
    " this must exceed, set so that evidence without any of the effects would ask for one in five"
    " of a hundred cases. Each number"
    " of bits is a candidate of its own. Where figures scatter, as with friction with memory, the"
    " scatter counts against the"
    " candidate. False alarms were counted for detent torque, driver errors, bits and friction with"
    " memory; take other effects"
    " as a hint."
)
_LINES_PER_ROW = 16
"""Lines side by side in a picture."""
_MAX_OUTLIERS, _MAX_DEPENDENCES, _MAX_PICTURES = 12, 8, 6
MIN_PEAK_OVER_FLOOR = 8.0
"""Times of the floor that the highest of thousands of bins of noise hardly reaches, with what a
tone loses between bins.
"""


def fit_text(fit: Fit) -> str:
    """Goodness of fit, what is off, estimates with verdicts, and the lines before and after, as
    text.
    """
    lines = [fit.sentence, *_warnings(fit), *_outliers_text(fit), ""]
    estimates = []
    for e in fit.parameters:
        error = brief_number(e.standard_error, 2) or (
            "withheld" if math.isnan(e.interval[0]) else "-"
        )
        estimates.append((e.key, f"{e.estimate:.6g}", error, _interval(e), e.unit, e.verdict))
    head = ("parameter", "estimate", "std error", "95 % interval", "unit", "verdict")
    lines.append(text_table(head, estimates, left=1, last_left=True))
    lines += [f"as good: {values_text(other)}" for other in fit.alternatives]
    lines += [one.sentence for one in fit.selection]
    figures = [
        (
            f.name,
            *(f"{x:.6g}" for x in f.values),
            _relative_difference(f.before, f),
            _relative_difference(f.after, f),
        )
        for f in _figures(fit)
    ]
    lines += [
        "",
        text_table(("observed", "test", "before", "after", "before %", "after %"), figures, left=1),
    ]
    lines.append("")
    for one in fit.leanings[:3]:
        moves = (
            f"{e.key} {shift:+.2g} %" for e, shift in zip(fit.estimates, one.shifts, strict=True)
        )
        lines.append(f"1 % more of {one.key}: {', '.join(moves)}")
    lines += [*_residual_peaks_text(fit), *_prepared(fit)]
    lines.append(
        f"{fit.observations} observations, {fit.simulations} simulations, seed {fit.seed}."
        f" {CALIBRATED}"
    )
    return "\n".join(lines)


def values_text(values: Mapping[str, float]) -> str:
    """Values of what is fitted, by key, as they are told while it is searched."""
    return ", ".join(f"{key} {value:.4g}" for key, value in values.items())


def _warnings(fit: Fit) -> list[str]:
    """What else is to be known before any estimate is read."""
    if fit.interrupted:
        return [*fit.notes, "Interrupted: the best so far."]
    unfinished = "The search has not converged: a finer one still found something better."
    return [*fit.notes, *_shared(fit), *([] if fit.converged else [unfinished])]


def _shared(fit: Fit) -> list[str]:
    """Which parameters have one value in all recordings, and which one in each."""
    if len(fit.after) == 1:
        return []
    all_, own = (
        [e.key for e in fit.parameters if bool(e.recording) == each] for each in (False, True)
    )
    texts = (
        f"One value in all {len(fit.after)} recordings: {', '.join(all_) or 'none'}",
        f"one in each: {', '.join(own)}",
    )
    return ["; ".join(texts[: 2 if own else 1]) + "."]


def _residual_peaks_text(fit: Fit) -> list[str]:
    """What no line accounts for, in words: of each recording, between the lowest and the highest of
    its lines.
    """
    told = []
    for one, rest, floor in _residuals_with_floor(fit):
        at = [f for f in _frequencies(fit, one) if math.isfinite(f)]
        times = np.where(
            (rest.frequency >= min(at)) & (rest.frequency <= max(at)), rest.amplitude / floor, 0.0
        )
        k, above = int(np.argmax(times)), float(np.max(times))
        where = f"{1e3 * rest.amplitude[k]:.3g} mN m at {rest.frequency[k]:.4g} Hz, {above:.2g} times the floor about it"
        if above < MIN_PEAK_OVER_FLOOR:
            what = "nothing stands out beside the lines"
        else:
            what = "there is an unexplained peak"
        told.append(
            f"{one.name}: from {min(at):.3g} to {max(at):.3g} Hz {what}; the highest above the"
            f" floor is {where}."
        )
    return told


def _frequencies(fit: Fit, evidence: Evidence) -> list[float]:
    """Frequencies of a test's amplitudes, those of the fitted model's lines."""
    (after,) = (found for one, found in fit.after if one is evidence)
    at = {line.line: line.frequency_hz for line in after.table}
    return [at.get(o.line, math.nan) for o in evidence.observations if o.form == "amplitude"]


def _residuals_with_floor(fit: Fit) -> list[tuple[Evidence, ResidualPeaks, np.ndarray]]:
    """Of each recording, what is left beside its lines, with the floor."""
    found = ((one, one.rest) for one, _ in fit.after if np.any(np.isfinite(_frequencies(fit, one))))
    return [
        (one, rest, rest.floor)
        for one, rest in found
        if rest is not None and rest.floor is not None and rest.floor.all()
    ]


def _prepared(fit: Fit) -> list[str]:
    """The step clock that each recording told, and what was done to it."""
    clocks = [
        f"{e.name}: its step clock is {e.clock_ratio:.6g} times the scenario's; this includes any"
        " sampling-clock error, as"
        " do the mode frequencies."
        for e, _ in fit.after
        if e.clock_ratio is not None
    ]
    return clocks + [f"{e.name}: {'; '.join(e.notes)}." for e, _ in fit.after if e.notes]


def _outliers_text(fit: Fit) -> list[str]:
    off = _outliers(fit)
    shown = [
        (_name(fit, d), f"{d.measured:.6g}", f"{d.fitted:.6g}", f"{d.sigma:+.1f}")
        for d in off[:_MAX_OUTLIERS]
    ]
    rows = [text_table(("off", "test", "fitted", "sigma"), shown, left=1)]
    if len(off) > _MAX_OUTLIERS:
        rows += [f"and {len(off) - _MAX_OUTLIERS} more"]
    else:
        rows += []
    if off:
        return rows
    return []


def _outliers(fit: Fit) -> list[Deviation]:
    return sorted((d for d in fit.deviations if d.off), key=lambda d: -abs(d.sigma))


def _name(fit: Fit, d: Deviation) -> str:
    return f"{d.line} {d.form}" + (f" [{d.test}]" if len(fit.after) > 1 else "")


def _interval(e: Estimate) -> str:
    low, high = e.interval
    if math.isfinite(low):
        return f"{low:.5g} to {high:.5g}"
    return "withheld"


class _Figure(NamedTuple):
    """A fitted figure: what it is called, in which form, and what test and model give for it,
    before and after the fit.
    """

    name: str
    is_angle: bool
    test: float
    before: float
    after: float

    @property
    def values(self) -> tuple[float, float, float]:
        """Of the test, before and after the fit."""
        return self.test, self.before, self.after


def _figures(fit: Fit) -> list[_Figure]:
    """All fitted figures of the tests, with their values before and after."""
    several = len(fit.before) > 1
    return [
        _Figure(
            f"{o.line} {o.form}" + (f" [{file_name(evidence.name)}]" if several else ""), o.is_angle,
            o.value, unwrap_to_measured(o, predicted(before, o)), unwrap_to_measured(o, predicted(after, o)),
        )
        for (evidence, before), (_, after) in zip(fit.before, fit.after, strict=True)
        for o in evidence.observations
    ]  # fmt: skip


def _relative_difference(value: float, figure: _Figure) -> str:
    """Relative difference from the test's figure in per cent; empty for angles, and where that is
    0, as the decay of what seems to last."""
    if figure.test and not figure.is_angle:
        return percent(value / figure.test - 1.0)
    return ""


def fit_json(fit: Fit) -> dict[str, Any]:
    """What ``fit.json`` holds."""
    names = [e.key for e in fit.estimates]

    def by_name(row: Sequence[float]) -> dict[str, float]:
        return dict(zip(names, map(float, row), strict=True))

    return {
        "goodness": {
            "sentence": fit.sentence, "explained": fit.goodness.explained, "chi_square": fit.goodness.chi_square,
            "degrees_of_freedom": fit.goodness.freedom, "per_degree_of_freedom": fit.goodness.ratio,
            "limit": fit.goodness.limit,
        },
        "alternatives": list(fit.alternatives), "usable": fit.usable, "converged": fit.converged, "notes": list(fit.notes),
        "deviations": [asdict(d) for d in fit.deviations],
        "leans_on": {one.key: by_name(one.shifts) for one in fit.leanings},
        "parameters": {
            e.key: {
                "estimate": e.estimate, "standard_error": e.standard_error, "unit": e.unit,
                "confidence_95": list(e.interval), "from_profile": e.profiled,
                "low": e.low, "high": e.high, "identifiable": e.identifiable, "verdict": e.verdict,
                "shared": not e.recording, "recording": e.recording or None,
            }
            for e in fit.parameters
        },
        "selection": [asdict(one) | {"sentence": one.sentence} for one in fit.selection],
        "left": [
            {"name": one.name, "frequency_hz": rest.frequency.tolist(), "amplitude_n_m": rest.amplitude.tolist(),
             "floor_n_m": floor.tolist()}
            for one, rest, floor in _residuals_with_floor(fit)
        ],
        "correlation": {name: by_name(row) for name, row in zip(names, fit.correlation, strict=True)},
        "sensitivities": {figure: by_name(row) for figure, row in fit.sensitivities.items()},
        "evidence": [
            {"name": e.name, "clock_ratio": e.clock_ratio, "observations": len(e.observations), "notes": list(e.notes)}
            for e, _ in fit.after
        ],
        "cost": fit.cost, "observations": fit.observations, "simulations": fit.simulations, "seed": fit.seed,
        "interrupted": fit.interrupted, "status": "calibrated: fitted to these lines", "versions": package_versions(),
    }  # fmt: skip


def fit_folder(fit: Fit) -> Contents:
    """``fit.json``, ``scenario.yaml`` (one for each recording where values are its own) and the
    report.
    """
    files = {"fit.json": to_json(fit_json(fit)), "scenario.yaml": dump_scenario(fit.scenario)}
    files |= {
        f"scenario-{k}.yaml": dump_scenario(one) for k, one in enumerate(fit.scenarios[1:], 2)
    }
    return files, fit_report(fit)


def fit_report(fit: Fit) -> Document:
    """The report of an identification: goodness first, parameters with what they are worth, lines
    before and after.
    """
    tests = ", ".join(f"{e.name} ({len(e.observations)} observations)" for e, _ in fit.after)
    keys = [e.key for e in fit.estimates]
    prepared = [Text(text, note=True) for text in _prepared(fit)]
    explained = (
        f"chi-square per degree of freedom; below {fit.goodness.limit:.3g} if the model is correct"
    )
    good = Fact(f"{fit.goodness.ratio:.3g}", explained, "pass" if fit.usable else "fail")
    if fit.usable and fit.goodness.freedom <= 0:
        good = Fact("not checked", "as many parameters as figures: any model might fit")
    return study_report(
        "Identification report",
        f"Identification: {fit.scenario.title or 'drive'}",
        f"From {tests}; {fit.simulations} simulations, seed {fit.seed}.",
        facts=[good, *map(_estimated, fit.parameters[:3])],
        first_page=(
            Text(" ".join([fit.sentence, *_warnings(fit)])), *_outliers_table(fit), _estimates(fit), *_alternatives(fit),
            *_selected(fit),
            Text(f"{CALIBRATED} {_HOW_TO_READ}", note=True),
            figure_block(draw_before_and_after(fit), "Amplitudes of the test, before and after",
                  "Amplitudes of the lines in the test, before and after the fit."),
        ),
        sections=(
            Section("Before and after", (Text(CALIBRATED), _before_and_after(fit), *prepared), new_page=True),
            *_residual_pictures(fit),
            *_dependence_table(fit),
            Section("Correlation of the estimates", (_matrix("parameter", fit, zip(keys, fit.correlation, strict=True)),)),
            Section("Sensitivities", (Text(_SENSITIVITY), _matrix("figure", fit, fit.sensitivities.items()))),
        ),
        scenario=fit.scenario,
    )  # fmt: skip


def _dependence_table(fit: Fit) -> list[Section]:
    """How estimates move with parameters that were not fitted; nothing where that is not known."""
    rows = [(one.key, one.shifts) for one in fit.leanings[:_MAX_DEPENDENCES]]
    if rows:
        return [
            Section(
                "What the estimates depend on",
                (Text(_DEPENDENCE_NOTE), _matrix("not fitted", fit, rows)),
            )
        ]
    return []


def _estimated(e: Estimate) -> Fact:
    value = f"{with_error(e.estimate, e.standard_error)} {pretty(e.unit)}".rstrip()
    label = f"{e.key}: {'identifiable' if e.identifiable else 'NOT identifiable'}"
    return Fact(value, label, "" if e.identifiable else "fail")


def _outliers_table(fit: Fit) -> tuple[Table, ...]:
    header = ["figure", "test [1]", "fitted [1]", "off [σ]"]
    off = ((_name(fit, d), d) for d in _outliers(fit)[:_MAX_OUTLIERS])
    rows = [
        [name, format_number(d.measured), format_number(d.fitted), signed(d.sigma, 1)]
        for name, d in off
    ]
    if rows:
        return (
            table(header, rows, "Values that deviate by more than their uncertainty; SI units."),
        )
    return ()


def _estimates(fit: Fit) -> Table:
    header = [
        "`parameter`",
        "estimate ± standard error [1]",
        "95 % interval [1]",
        "unit",
        "range [1]",
        "verdict",
    ]
    rows = [
        [
            e.key,
            with_error(e.estimate, e.standard_error),
            _interval(e),
            pretty(e.unit),
            f"{plain_number(e.low)} to {plain_number(e.high)}",
            e.verdict,
        ]
        for e in fit.parameters
    ]
    marks: dict[int, Mark] = {k: "fail" for k, e in enumerate(fit.parameters) if not e.identifiable}
    return table(header, rows, "", marks)


def _alternatives(fit: Fit) -> tuple[Table, ...]:
    """Other values of all parameters, a row each."""
    rows = [
        [str(k), *(format_number(v) for v in other.values())]
        for k, other in enumerate(fit.alternatives, 1)
    ]
    header = ["", *(f"{e.key} [1]" for e in fit.estimates)]
    if rows:
        return (table(header, rows, "Other values, a row each, that explain the data as well."),)
    return ()


def _selected(fit: Fit) -> tuple[Table, ...]:
    """What the evidence asks for, of the candidates."""
    header = [
        "`effect`",
        "evidence",
        "chi-square lower by [1]",
        "parameters [1]",
        "asked for above [1]",
    ]
    rows = [
        [one.effect, one.answer, f"{one.gain:.3g}", str(one.parameters),
         f"{one.limit:.3g}"]
        for one in fit.selection
    ]  # fmt: skip
    if rows:
        return (table(header, rows, _SELECTION),)
    return ()


def _residual_pictures(fit: Fit) -> tuple[Section, ...]:
    """Pictures of what neither the fitted model nor any line accounts for, with the floor."""
    shown = _residuals_with_floor(fit)[:_MAX_PICTURES]
    drawings = (
        figure_block(draw_residuals(fit, one, rest, floor), f"What is left of {one.name}",
              f"{one.name}: amplitudes of the test, what the fitted model leaves of them, the"
              " highest peaks beside all lines, and"
              " the floor, the median of bins about each.")
        for one, rest, floor in shown
    )  # fmt: skip
    if shown:
        return (Section("What is left", (Text(" ".join(_residual_peaks_text(fit))), *drawings)),)
    return ()


def draw_residuals(fit: Fit, evidence: Evidence, rest: ResidualPeaks, floor: np.ndarray) -> Drawing:
    """Floor and highest peaks beside the lines of a recording, its lines, and what the fitted model
    leaves of each.
    """
    drawing, ax = sheets.one_axes(3.4)
    (after,) = (found for one, found in fit.after if one is evidence)
    pairs = [(o, predicted(after, o)) for o in evidence.observations if o.form == "amplitude"]
    figures.draw_residual_floor(
        ax, rest.frequency, {"highest peaks beside the lines": rest.amplitude, "floor": floor},
        _frequencies(fit, evidence),
        {"lines of the test": [o.value for o, _ in pairs], "left by the model": [abs(v - o.value) for o, v in pairs]},
    )  # fmt: skip
    return drawing


def _before_and_after(fit: Fit) -> Table:
    header = ["figure", "unit", "test [1]", "before [1]", "after [1]", "before against test [%]",
              "after against test [%]"]  # fmt: skip
    rows = []
    for f in _figures(fit):
        unit, digits, scale = _shown_in(f)
        shown = [format_number(value, digits, scale) for value in f.values]
        rows.append(
            [
                f.name,
                unit,
                *shown,
                _relative_difference(f.before, f),
                _relative_difference(f.after, f),
            ]
        )
    return table(header, rows)


def _shown_in(figure: _Figure) -> tuple[str, int, float]:
    """Unit of a figure in the report, its digits, and the unit's parts in one of SI."""
    if figure.is_angle:
        return "deg", 4, math.degrees(1.0)
    if _is_torque(figure.name):
        return "mN m", 4, 1e3
    if "frequency" in figure.name:
        return ("Hz", 6, 1.0)
    return ("1/s", 6, 1.0)


def _is_torque(figure_name: str) -> bool:
    return "amplitude" in figure_name or "nearest_bin" in figure_name


def draw_before_and_after(fit: Fit) -> Drawing:
    """Amplitudes of all lines of the test, before and after the fit, in as many rows as they need."""
    amplitudes = [f for f in _figures(fit) if _is_torque(f.name)]
    rows = [
        amplitudes[k : k + _LINES_PER_ROW] for k in range(0, len(amplitudes), _LINES_PER_ROW)
    ] or [[]]
    drawing, each = sheets.panels(len(rows), 3.0 if len(rows) > 1 else 3.4, columns=1)
    for ax, row in zip(each, rows, strict=True):
        groups = {
            name: [f.values[k] for f in row] for k, name in enumerate(("test", "before", "after"))
        }
        figures.draw_pairs(ax, [f.name.removesuffix(" amplitude") for f in row], groups)
    return drawing


def _matrix(of: str, fit: Fit, rows: Iterable[tuple[str, Iterable[float]]]) -> Table:
    header = [of, *(f"{e.key} [1]" for e in fit.estimates)]
    return table(
        header,
        (
            [name, *(signed(x) for x in row)]
            for name, row in rows
            if "phase" not in name and " turn" not in name
        ),
    )
