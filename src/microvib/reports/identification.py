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
from microvib.reports.blocks import drawn, study
from microvib.reports.document import Contents, Document, Fact, Mark, Section, Table, Text, table
from microvib.reports.numbers import brief, format_number, percent, plain, signed, with_error
from microvib.reports.typography import file_name
from microvib.signals.line_table import Rest
from microvib.studies.evidence import Evidence, predicted
from microvib.studies.identify import Deviation, Estimate, Fit
from microvib.studies.identify.goodness import beside
from microvib.text_tables import text_table
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

CALIBRATED = "Calibrated, not predicted: the parameters were fitted to these figures."
_HOW_TO_READ = (
    "Intervals have 95 % confidence. They come from the profile of the cost where its curvature alone would mislead, and are"
    " widened by the scatter that the fit leaves. They hold for the model as it is: whatever was not fitted is taken as exact"
    " (see what the estimates depend on)."
    " A parameter counts as identifiable if the model explains the data, the standard error is below 20 %, the best value lies"
    " inside its range and no other explains the data as well."
)
_SENSITIVITY = "Relative change of a figure for a relative change of a parameter."
_LEANING = (
    "Relative change of an estimate for a relative change of a parameter that was not fitted, to first order: 2 means that"
    " 1 % moves it by 2 %. No interval includes an error of such a parameter."
)
_SELECTION = (
    "Each candidate, together with all effects that the evidence asks for: by how much it lowers chi-square, and the threshold that"
    " this must exceed, set so that evidence without any of the effects would ask for one in five of a hundred cases. Each number"
    " of bits is a candidate of its own. Where figures scatter, as with friction with memory, the scatter counts against the"
    " candidate. False alarms were counted for detent torque, driver errors, bits and friction with memory; take other effects"
    " as a hint."
)
_IN_A_ROW = 16
"""Lines side by side in a picture."""
_MAX_OFF, _MAX_LEANING, _MAX_PICTURES = 12, 8, 6
OUTSTANDING = 8.0
"""Times of the floor that the highest of thousands of bins of noise hardly reaches, with what a tone loses between bins."""


def fit_text(fit: Fit) -> str:
    """Goodness of fit, what is off, estimates with verdicts, and the lines before and after, as text."""
    lines = [fit.sentence, *_warnings(fit), *_off_text(fit), ""]
    estimates = []
    for e in fit.parameters:
        error = brief(e.standard_error, 2) or ("withheld" if math.isnan(e.interval[0]) else "-")
        estimates.append((e.key, f"{e.estimate:.6g}", error, _interval(e), e.unit, e.verdict))
    head = ("parameter", "estimate", "std error", "95 % interval", "unit", "verdict")
    lines.append(text_table(head, estimates, left=1, last_left=True))
    lines += [f"as good: {values_text(other)}" for other in fit.alternatives]
    lines += [one.sentence for one in fit.selection]
    figures = [
        (f.name, *(f"{x:.6g}" for x in f.values), _off_by(f.before, f), _off_by(f.after, f)) for f in _figures(fit)
    ]
    lines += ["", text_table(("observed", "test", "before", "after", "before %", "after %"), figures, left=1)]
    lines.append("")
    for one in fit.leanings[:3]:
        moves = (f"{e.key} {shift:+.2g} %" for e, shift in zip(fit.estimates, one.shifts, strict=True))
        lines.append(f"1 % more of {one.key}: {', '.join(moves)}")
    lines += [*_left(fit), *_prepared(fit)]
    lines.append(f"{fit.observations} observations, {fit.simulations} simulations, seed {fit.seed}. {CALIBRATED}")
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
    all_, own = ([e.key for e in fit.parameters if bool(e.recording) == each] for each in (False, True))
    texts = (
        f"One value in all {len(fit.after)} recordings: {', '.join(all_) or 'none'}",
        f"one in each: {', '.join(own)}",
    )
    return ["; ".join(texts[: 2 if own else 1]) + "."]


def _left(fit: Fit) -> list[str]:
    """What no line accounts for, in words: of each recording, between the lowest and the highest of its lines."""
    told = []
    for one, rest, floor in _rests(fit):
        at = [f for f in _frequencies(fit, one) if math.isfinite(f)]
        times = np.where((rest.frequency >= min(at)) & (rest.frequency <= max(at)), rest.amplitude / floor, 0.0)
        k, above = int(np.argmax(times)), float(np.max(times))
        where = (
            f"{1e3 * rest.amplitude[k]:.3g} mN m at {rest.frequency[k]:.4g} Hz, {above:.2g} times the floor about it"
        )
        what = (
            "nothing stands out beside the lines"
            if above < OUTSTANDING
            else "something no line accounts for stands out"
        )
        told.append(
            f"{one.name}: from {min(at):.3g} to {max(at):.3g} Hz {what}; the highest above the floor is {where}."
        )
    return told


def _frequencies(fit: Fit, evidence: Evidence) -> list[float]:
    """Frequencies of a test's amplitudes, those of the fitted model's lines."""
    (after,) = (found for one, found in fit.after if one is evidence)
    at = {line.line: line.frequency_hz for line in after.table}
    return [at.get(o.line, math.nan) for o in evidence.observations if o.form == "amplitude"]


def _rests(fit: Fit) -> list[tuple[Evidence, Rest, np.ndarray]]:
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
        f"{e.name}: its step clock is {e.clock_ratio:.6g} times the scenario's; a sampling clock that is off counts in that, and"
        " in the frequencies of modes."
        for e, _ in fit.after
        if e.clock_ratio is not None
    ]
    return clocks + [f"{e.name}: {'; '.join(e.notes)}." for e, _ in fit.after if e.notes]


def _off_text(fit: Fit) -> list[str]:
    off = _off(fit)
    shown = [(_name(fit, d), f"{d.measured:.6g}", f"{d.fitted:.6g}", f"{d.sigma:+.1f}") for d in off[:_MAX_OFF]]
    rows = [text_table(("off", "test", "fitted", "sigma"), shown, left=1)]
    rows += [f"and {len(off) - _MAX_OFF} more"] if len(off) > _MAX_OFF else []
    return rows if off else []


def _off(fit: Fit) -> list[Deviation]:
    return sorted((d for d in fit.deviations if d.off), key=lambda d: -abs(d.sigma))


def _name(fit: Fit, d: Deviation) -> str:
    return f"{d.line} {d.form}" + (f" [{d.test}]" if len(fit.after) > 1 else "")


def _interval(e: Estimate) -> str:
    low, high = e.interval
    return f"{low:.5g} to {high:.5g}" if math.isfinite(low) else "withheld"


class _Figure(NamedTuple):
    """A fitted figure: what it is called, in which form, and what test and model give for it, before and after the fit."""

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
            o.value, beside(o, predicted(before, o)), beside(o, predicted(after, o)),
        )
        for (evidence, before), (_, after) in zip(fit.before, fit.after, strict=True)
        for o in evidence.observations
    ]  # fmt: skip


def _off_by(value: float, figure: _Figure) -> str:
    """Relative difference from the test's figure in per cent; empty for angles, and where that is 0, as the decay of what
    seems to last."""
    return percent(value / figure.test - 1.0) if figure.test and not figure.is_angle else ""


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
            for one, rest, floor in _rests(fit)
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
    """``fit.json``, ``scenario.yaml`` (one for each recording where values are its own) and the report."""
    files = {"fit.json": to_json(fit_json(fit)), "scenario.yaml": dump_scenario(fit.scenario)}
    files |= {f"scenario-{k}.yaml": dump_scenario(one) for k, one in enumerate(fit.scenarios[1:], 2)}
    return files, fit_report(fit)


def fit_report(fit: Fit) -> Document:
    """The report of an identification: goodness first, parameters with what they are worth, lines before and after."""
    tests = ", ".join(f"{e.name} ({len(e.observations)} observations)" for e, _ in fit.after)
    keys = [e.key for e in fit.estimates]
    prepared = [Text(text, note=True) for text in _prepared(fit)]
    explained = f"chi-square per degree of freedom; below {fit.goodness.limit:.3g} if the model is correct"
    good = Fact(f"{fit.goodness.ratio:.3g}", explained, "pass" if fit.usable else "fail")
    if fit.usable and fit.goodness.freedom <= 0:
        good = Fact("not checked", "as many parameters as figures: any model might fit")
    return study(
        "Identification report",
        f"Identification: {fit.scenario.title or 'drive'}",
        f"From {tests}; {fit.simulations} simulations, seed {fit.seed}.",
        facts=[good, *map(_estimated, fit.parameters[:3])],
        first_page=(
            Text(" ".join([fit.sentence, *_warnings(fit)])), *_off_table(fit), _estimates(fit), *_alternatives(fit),
            *_selected(fit),
            Text(f"{CALIBRATED} {_HOW_TO_READ}", note=True),
            drawn(draw_before_and_after(fit), "Amplitudes of the test, before and after",
                  "Amplitudes of the lines in the test, before and after the fit."),
        ),
        sections=(
            Section("Before and after", (Text(CALIBRATED), _before_and_after(fit), *prepared), new_page=True),
            *_what_is_left(fit),
            *_depend_on(fit),
            Section("Correlation of the estimates", (_matrix("parameter", fit, zip(keys, fit.correlation, strict=True)),)),
            Section("Sensitivities", (Text(_SENSITIVITY), _matrix("figure", fit, fit.sensitivities.items()))),
        ),
        scenario=fit.scenario,
    )  # fmt: skip


def _depend_on(fit: Fit) -> list[Section]:
    """How estimates move with parameters that were not fitted; nothing where that is not known."""
    rows = [(one.key, one.shifts) for one in fit.leanings[:_MAX_LEANING]]
    return [Section("What the estimates depend on", (Text(_LEANING), _matrix("not fitted", fit, rows)))] if rows else []


def _estimated(e: Estimate) -> Fact:
    value = f"{with_error(e.estimate, e.standard_error)} {pretty(e.unit)}".rstrip()
    label = f"{e.key}: {'identifiable' if e.identifiable else 'NOT identifiable'}"
    return Fact(value, label, "" if e.identifiable else "fail")


def _off_table(fit: Fit) -> tuple[Table, ...]:
    header = ["figure", "test [1]", "fitted [1]", "off [σ]"]
    off = ((_name(fit, d), d) for d in _off(fit)[:_MAX_OFF])
    rows = [[name, format_number(d.measured), format_number(d.fitted), signed(d.sigma, 1)] for name, d in off]
    return (
        (table(header, rows, "Figures that are further off than their uncertainty explains; SI units."),)
        if rows
        else ()
    )


def _estimates(fit: Fit) -> Table:
    header = ["`parameter`", "estimate ± standard error [1]", "95 % interval [1]", "unit", "range [1]", "verdict"]
    rows = [
        [e.key, with_error(e.estimate, e.standard_error), _interval(e), pretty(e.unit), f"{plain(e.low)} to {plain(e.high)}",
         e.verdict]
        for e in fit.parameters
    ]  # fmt: skip
    marks: dict[int, Mark] = {k: "fail" for k, e in enumerate(fit.parameters) if not e.identifiable}
    return table(header, rows, "", marks)


def _alternatives(fit: Fit) -> tuple[Table, ...]:
    """Other values of all parameters, a row each."""
    rows = [[str(k), *(format_number(v) for v in other.values())] for k, other in enumerate(fit.alternatives, 1)]
    header = ["", *(f"{e.key} [1]" for e in fit.estimates)]
    return (table(header, rows, "Other values, a row each, that explain the data as well."),) if rows else ()


def _selected(fit: Fit) -> tuple[Table, ...]:
    """What the evidence asks for, of the candidates."""
    header = ["`effect`", "evidence", "chi-square lower by [1]", "parameters [1]", "asked for above [1]"]
    rows = [
        [one.effect, one.answer, f"{one.gain:.3g}", str(one.parameters),
         f"{one.limit:.3g}"]
        for one in fit.selection
    ]  # fmt: skip
    return (table(header, rows, _SELECTION),) if rows else ()


def _what_is_left(fit: Fit) -> tuple[Section, ...]:
    """Pictures of what neither the fitted model nor any line accounts for, with the floor."""
    shown = _rests(fit)[:_MAX_PICTURES]
    drawings = (
        drawn(draw_what_is_left(fit, one, rest, floor), f"What is left of {one.name}",
              f"{one.name}: amplitudes of the test, what the fitted model leaves of them, the highest peaks beside all lines, and"
              " the floor, the median of bins about each.")
        for one, rest, floor in shown
    )  # fmt: skip
    return (Section("What is left", (Text(" ".join(_left(fit))), *drawings)),) if shown else ()


def draw_what_is_left(fit: Fit, evidence: Evidence, rest: Rest, floor: np.ndarray) -> Drawing:
    """Floor and highest peaks beside the lines of a recording, its lines, and what the fitted model leaves of each."""
    drawing, ax = sheets.one_axes(3.4)
    (after,) = (found for one, found in fit.after if one is evidence)
    pairs = [(o, predicted(after, o)) for o in evidence.observations if o.form == "amplitude"]
    figures.draw_rest(
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
        rows.append([f.name, unit, *shown, _off_by(f.before, f), _off_by(f.after, f)])
    return table(header, rows)


def _shown_in(figure: _Figure) -> tuple[str, int, float]:
    """Unit of a figure in the report, its digits, and the unit's parts in one of SI."""
    if figure.is_angle:
        return "deg", 4, math.degrees(1.0)
    if _is_torque(figure.name):
        return "mN m", 4, 1e3
    return ("Hz", 6, 1.0) if "frequency" in figure.name else ("1/s", 6, 1.0)


def _is_torque(figure_name: str) -> bool:
    return "amplitude" in figure_name or "nearest_bin" in figure_name


def draw_before_and_after(fit: Fit) -> Drawing:
    """Amplitudes of all lines of the test, before and after the fit, in as many rows as they need."""
    amplitudes = [f for f in _figures(fit) if _is_torque(f.name)]
    rows = [amplitudes[k : k + _IN_A_ROW] for k in range(0, len(amplitudes), _IN_A_ROW)] or [[]]
    drawing, each = sheets.panels(len(rows), 3.0 if len(rows) > 1 else 3.4, columns=1)
    for ax, row in zip(each, rows, strict=True):
        groups = {name: [f.values[k] for f in row] for k, name in enumerate(("test", "before", "after"))}
        figures.draw_pairs(ax, [f.name.removesuffix(" amplitude") for f in row], groups)
    return drawing


def _matrix(of: str, fit: Fit, rows: Iterable[tuple[str, Iterable[float]]]) -> Table:
    header = [of, *(f"{e.key} [1]" for e in fit.estimates)]
    return table(
        header, ([name, *(signed(x) for x in row)] for name, row in rows if "phase" not in name and " turn" not in name)
    )
