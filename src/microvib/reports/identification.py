"""An identification for those who read it: goodness, parameters, lines before and after."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import package_versions
from microvib.model.scenario import Scenario
from microvib.reports import figures, sheets
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import format_number, with_error
from microvib.reports.outcome import Item, Outcome, Part, Picture, Verdict
from microvib.reports.typography import file_name
from microvib.results import COUNT, DIFFERENCE, Column, Measure, Table
from microvib.signals.line_table import ResidualPeaks
from microvib.studies.evidence import Evidence, predicted
from microvib.studies.identify import Estimate, Fit
from microvib.studies.identify.goodness import OUTLIER_SIGMAS, unwrap_to_measured
from microvib.studies.identify.selection import Candidate
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_ESTIMATE = Measure(form=".6g")
_INTERVAL = Measure(form=".5g")
_STANDARD_ERROR = Measure(form=".2g")
_SIGNED = Measure(form="+z.2f")
_SIGMA = Measure(form="+z.1f")
_TEXT = Measure()
"""Measure of figures that are texts in the unit of their row."""

CALIBRATED = "Calibrated, not predicted: the parameters were fitted to these figures."
_HOW_TO_READ = (
    "Intervals have 95 % confidence. They come from the profile of the cost where its curvature"
    " alone would mislead, and are"
    " widened by the scatter that the fit leaves. They are conditional on the model: every "
    "parameter that was not fitted is taken as exact (see the dependence on parameters not fitted)."
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
    "Each candidate, together with all effects that the evidence supports: by how much it lowers"
    " chi-square, and the threshold that"
    " this must exceed, set so that evidence without any of the effects exceeds it in five of a hundred cases. Each number"
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


@dataclass(frozen=True)
class EstimateRow:
    """One identified parameter, in its own unit."""

    key: Annotated[str, Column("key", "parameter", role="key")]
    start: Annotated[float, Column("start", "before", _ESTIMATE)]
    estimate: Annotated[float, Column("estimate", "estimate", _ESTIMATE)]
    standard_error: Annotated[
        float, Column("standard_error", "standard error", _STANDARD_ERROR, absent="-")
    ]
    interval_low: Annotated[float, Column("low_95", "95 % from", _INTERVAL, absent="withheld")]
    interval_high: Annotated[float, Column("high_95", "to", _INTERVAL, absent="withheld")]
    unit: Annotated[str, Column("unit", "unit")]
    low: Annotated[float, Column("range_low", "range from", _INTERVAL, report_only=True)]
    high: Annotated[float, Column("range_high", "to", _INTERVAL, report_only=True)]
    identifiable: Annotated[str, Column("identifiable", role="verdict")]
    verdict: Annotated[str, Column("verdict", "verdict")]


@dataclass(frozen=True)
class FigureRow:
    """A fitted figure of a test, in the unit that readers see."""

    name: Annotated[str, Column("figure", "quantity")]
    unit: Annotated[str, Column("unit", "unit")]
    test: Annotated[str, Column("test", "test", _TEXT)]
    before: Annotated[str, Column("before", "before", _TEXT)]
    after: Annotated[str, Column("after", "after", _TEXT)]
    before_difference: Annotated[float, Column("before_difference", "before, off by", DIFFERENCE)]
    after_difference: Annotated[float, Column("after_difference", "after, off by", DIFFERENCE)]
    sigma: Annotated[float, Column("sigma", "sigma", _SIGMA)]


def fit_outcome(fit: Fit, start: Scenario | None = None) -> Outcome:
    """An identification for those who read it: goodness first, parameters with what they are worth,
    lines before and after.

    Parameters
    ----------
    fit : Fit
        What was found.
    start : Scenario, optional
        What it started from, for the values before.

    Returns
    -------
    Outcome
        With ``fit.json``, and ``scenario.yaml``: one for each recording where values are its own.
    """
    tests = ", ".join(f"{e.name} ({len(e.observations)} observations)" for e, _ in fit.after)
    figures_of_tests = [_figure_row(f) for f in _figures(fit)]
    amplitudes = Picture(
        "amplitudes",
        lambda: draw_before_and_after(fit),
        "Amplitudes of the test, before and after",
        "Amplitudes of the lines in the test, before and after the fit.",
    )
    every_figure = Table.of("", FigureRow, figures_of_tests)
    return Outcome(
        "Identification report",
        f"Identification: {fit.scenario.title or 'drive'}",
        f"From {tests}; {fit.simulations} simulations ({fit.method}), seed {fit.seed}.",
        _verdict(fit),
        (_goodness_fact(fit), *map(_estimate_fact, fit.parameters[:3])),
        (
            Part(
                "",
                (
                    Text(" ".join([fit.sentence, *_warnings(fit)])),
                    _outliers(figures_of_tests),
                    _estimates(fit, start),
                    _alternatives(fit),
                    Table.of("selection", Candidate, fit.selection, caption=_SELECTION),
                    Text(CALIBRATED, note=True),
                    amplitudes,
                ),
            ),
            Part(
                "Before and after",
                (every_figure, *map(Text, _prepared(fit))),
                new_page=True,
            ),
            Part("Residuals", tuple(_residuals(fit))),
            Part("Dependence on parameters not fitted", _dependences(fit)),
            Part(
                "Correlation of the estimates",
                (_matrix("correlation", "parameter", fit, zip(_keys(fit), fit.correlation, strict=True)),),
                report_only=True,
            ),
            Part(
                "Sensitivities",
                (Text(_SENSITIVITY), _matrix("sensitivities", "figure", fit, fit.sensitivities.items())),
                report_only=True,
            ),
        ),
        fit.scenario,
        data={"fit": fit_json(fit)},
        other_files={
            "scenario.yaml": dump_scenario(fit.scenario),
            **{
                f"scenario-{k}.yaml": dump_scenario(one)
                for k, one in enumerate(fit.scenarios[1:], 2)
            },
        },
    )  # fmt: skip


def _keys(fit: Fit) -> list[str]:
    return [e.key for e in fit.estimates]


def _verdict(fit: Fit) -> Verdict:
    if not fit.usable:
        return "fail"
    if fit.goodness.freedom <= 0:
        return "not judged"
    return "pass"


def _goodness_fact(fit: Fit) -> Fact:
    if _verdict(fit) == "not judged":
        return Fact("not checked", "as many parameters as measured values: any model might fit")
    label = (
        f"chi-square per degree of freedom; below {fit.goodness.limit:.3g} if the model is correct"
    )
    return Fact(f"{fit.goodness.ratio:.3g}", label, "pass" if fit.usable else "fail")


def _estimate_fact(e: Estimate) -> Fact:
    value = f"{with_error(e.estimate, e.standard_error)} {pretty(e.unit)}".rstrip()
    label = f"{e.key}: {'identifiable' if e.identifiable else 'NOT identifiable'}"
    return Fact(value, label, "" if e.identifiable else "fail")


def _estimates(fit: Fit, start: Scenario | None) -> Table:
    before = (
        {}
        if start is None
        else {key: value for key, value, _ in start.entries() if value is not None}
    )
    rows = [
        EstimateRow(
            e.key,
            float(before.get(e.key, math.nan)),
            e.estimate,
            e.standard_error,
            *e.interval,
            pretty(e.unit),
            e.low,
            e.high,
            "yes" if e.identifiable else "no",
            e.verdict,
        )
        for e in fit.parameters
    ]
    return Table.of("parameters", EstimateRow, rows, caption=_HOW_TO_READ)


def _figure_row(f: _Figure) -> FigureRow:
    unit, digits, scale = _shown_in(f)
    test, before, after = (format_number(value, digits, scale) for value in f.values)
    differences = f.difference(f.before), f.difference(f.after)
    return FigureRow(f.name, unit, test, before, after, *differences, f.sigma)


def _outliers(rows: Sequence[FigureRow]) -> Table:
    """Figures that are further off than their uncertainty explains, farthest first."""
    off = sorted(
        (row for row in rows if not abs(row.sigma) <= OUTLIER_SIGMAS),
        key=lambda row: -abs(row.sigma),
    )
    shown = off[:_MAX_OUTLIERS]
    return Table.of(
        "",
        FigureRow,
        shown,
        caption=f"Values that deviate by more than their uncertainty: {len(off)} of {len(rows)}.",
    ).only(("figure", "unit", "test", "after", "sigma"))


def _alternatives(fit: Fit) -> Table:
    """Other values of all parameters, a row each."""
    columns = (Column("number", "as good", COUNT), *_key_columns(fit, _ESTIMATE))
    rows = tuple((k, *other.values()) for k, other in enumerate(fit.alternatives, 1))
    caption = "Other values, a row each, that explain the data as well."
    return Table("alternatives", columns, rows, caption=caption)


def _key_columns(fit: Fit, measure: Measure) -> tuple[Column, ...]:
    return tuple(Column(key, key, measure) for key in _keys(fit))


def _matrix(name: str, of: str, fit: Fit, rows: Iterable[tuple[str, Iterable[float]]]) -> Table:
    """A table with a column for each estimate; phases are left to ``fit.json``."""
    columns = (Column(of, of.replace("_", " ")), *_key_columns(fit, _SIGNED))
    kept = tuple(
        (label, *map(float, row))
        for label, row in rows
        if "phase" not in label and " turn" not in label
    )
    return Table(name, columns, kept)


def _dependences(fit: Fit) -> tuple[Item, ...]:
    """How estimates move with parameters that were not fitted; nothing where that is not known."""
    rows = [(one.key, one.shifts) for one in fit.dependences[:_MAX_DEPENDENCES]]
    if not rows:
        return ()
    return (Text(_DEPENDENCE_NOTE), _matrix("dependences", "not_fitted", fit, rows))


def _residuals(fit: Fit) -> Iterator[Item]:
    """Residuals of the fitted model and unexplained peaks, with the floor."""
    shown = _residuals_with_floor(fit)
    if shown:
        yield Text(" ".join(_residual_peaks_text(fit)))
    for k, (one, rest, floor) in enumerate(shown[:_MAX_PICTURES], 1):
        caption = (
            f"{one.name}: measured amplitudes, their residuals after the fit, the highest "
            "unexplained peaks, and the noise floor (median of the neighbouring bins)."
        )
        draw = partial(draw_residuals, fit, one, rest, floor)
        yield Picture(f"left_{k}", draw, f"Residual of {one.name}", caption)


def values_text(values: Mapping[str, float]) -> str:
    """Values of what is fitted, by key, as they are told while it is searched."""
    return ", ".join(f"{key} {value:.4g}" for key, value in values.items())


def _warnings(fit: Fit) -> list[str]:
    """Warnings that precede the estimates."""
    if fit.interrupted:
        return [*fit.notes, "Interrupted: the best so far."]
    unfinished = "The search has not converged: a finer search still found a better fit."
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
    """Unexplained peaks in words: of each recording, between the lowest and the highest of
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
            what = "no unexplained peak"
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
    at = {line.name: line.frequency for line in after.table}
    return [at.get(o.line, math.nan) for o in evidence.observations if o.form == "amplitude"]


def _residuals_with_floor(fit: Fit) -> list[tuple[Evidence, ResidualPeaks, np.ndarray]]:
    """Residual of each recording without its lines, with the floor."""
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


class _Figure(NamedTuple):
    """A fitted figure: what it is called, in which form, and what test and model give for it,
    before and after the fit.
    """

    name: str
    is_angle: bool
    test: float
    before: float
    after: float
    sigma: float
    """Difference of the fitted model's over its standard deviation."""

    def difference(self, value: float) -> float:
        """Relative difference from the test's figure; nan for angles, and where that is 0, as the
        decay of what seems to last."""
        if self.test and not self.is_angle:
            return value / self.test - 1.0
        return math.nan

    @property
    def values(self) -> tuple[float, float, float]:
        """Values of the test, before and after the fit."""
        return self.test, self.before, self.after


def _figures(fit: Fit) -> list[_Figure]:
    """All fitted figures of the tests, with their values before and after."""
    several = len(fit.before) > 1
    sigmas = {(d.test, d.line, d.form): d.sigma for d in fit.deviations}
    return [
        _Figure(
            f"{o.line} {o.form}" + (f" [{file_name(evidence.name)}]" if several else ""), o.is_angle,
            o.value, unwrap_to_measured(o, predicted(before, o)), unwrap_to_measured(o, predicted(after, o)),
            sigmas[evidence.name, o.line, o.form],
        )
        for (evidence, before), (_, after) in zip(fit.before, fit.after, strict=True)
        for o in evidence.observations
    ]  # fmt: skip


def fit_json(fit: Fit) -> dict[str, Any]:
    """Contents of ``fit.json``."""
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
        "leans_on": {one.key: by_name(one.shifts) for one in fit.dependences},
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
        "cost": fit.cost, "observations": fit.observations, "simulations": fit.simulations, "method": fit.method, "seed": fit.seed,
        "interrupted": fit.interrupted, "status": "calibrated: fitted to these lines", "versions": package_versions(),
    }  # fmt: skip


def draw_residuals(fit: Fit, evidence: Evidence, rest: ResidualPeaks, floor: np.ndarray) -> Drawing:
    """Floor and highest unexplained peaks of a recording, its lines, and what the fitted model
    leaves of each.
    """
    drawing, ax = sheets.one_axes(3.4)
    (after,) = (found for one, found in fit.after if one is evidence)
    pairs = [(o, predicted(after, o)) for o in evidence.observations if o.form == "amplitude"]
    figures.draw_residual_floor(
        ax, rest.frequency, {"highest unexplained peaks": rest.amplitude, "floor": floor},
        _frequencies(fit, evidence),
        {"lines of the test": [o.value for o, _ in pairs], "residual of the model": [abs(v - o.value) for o, v in pairs]},
    )  # fmt: skip
    return drawing


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
