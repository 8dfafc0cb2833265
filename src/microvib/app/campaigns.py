"""A campaign as text, tables, pictures and report; one of its cases, computed again."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.app import campaign_plots
from microvib.app.report import picture
from microvib.app.studies import number, page
from microvib.errors import OutputError
from microvib.io.results import write_folder
from microvib.io.scenario_file import dump_scenario
from microvib.studies.campaign.cases import FIGURES, compute
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.results import DONE, FAILED, MISSING, Results
from microvib.studies.campaign.slurm import job_state
from microvib.studies.campaign.statistics import (
    ANY,
    Estimate,
    Indices,
    LineStatistics,
    Tornado,
    line_statistics,
    main_lines,
    sobol,
    tornado,
    worst_cases,
)

WORST = 5
"""Worst cases that are listed for each line."""
MOST_REASONS = 10


@dataclass(frozen=True)
class Summary:
    """What is told of a campaign."""

    results: Results
    limit: float | None
    band: tuple[float, float]
    rows: list[LineStatistics]
    lines: list[str]
    """Lines of the pictures."""
    worst: dict[str, list[tuple[int, float]]]
    tornados: list[Tornado]
    indices: list[Indices]


def summarise(results: Results, limit: float | None, band: tuple[float, float]) -> Summary:
    """Statistics, worst cases, effects and Sobol indices of merged results."""
    rows = line_statistics(results, limit, band)
    lines = main_lines(rows) or list(results.lines[:4])
    shown = [ANY, *lines]
    tornados = [t for line in shown[:4] if (t := tornado(results, line, band)) and t.effects]
    indices = [i for line in shown[:4] if (i := sobol(results, line, band))]
    worst = {line: worst_cases(results, line, band, WORST) for line in shown}
    return Summary(results, limit, band, rows, lines, worst, tornados, indices)


def state_text(campaign: Campaign, reasons: bool = False) -> str:
    """How far a campaign is: cases done, failed, missing, and with ``reasons`` why cases failed."""
    done = failed = 0
    why: Counter[str] = Counter()
    examples: dict[str, int] = {}
    for cases, chunk in campaign.results():
        for case, reason in zip(cases, chunk.reasons, strict=True):
            done += not reason
            failed += bool(reason)
            if reason:
                kind = _kind_of(reason)
                why[kind] += 1
                examples.setdefault(kind, case)
    total = campaign.design.cases
    text = f"{done + failed} of {total} cases computed, {failed} of them failed"
    if done + failed < total:
        text += f"; {total - done - failed} to do: microvib campaign resume {campaign.folder}"
    lines = [text]
    queued = job_state(campaign)
    if queued:
        lines.append(f"Slurm: {queued}")
    if reasons:
        lines += [f"  {count} x {kind} (case {examples[kind]})" for kind, count in why.most_common(MOST_REASONS)]
    return "\n".join(lines)


def _kind_of(reason: str) -> str:
    """A reason without its figures, so that alike ones are counted together."""
    words = ["..." if any(c.isdigit() for c in word) else word for word in reason.split()]
    return " ".join(word for k, word in enumerate(words) if word != "..." or k == 0 or words[k - 1] != "...")[:200]


def report_text(s: Summary) -> str:
    """Distributions, exceedance, effects and worst cases as text."""
    counts = _counts(s.results)
    lines = [f"{counts[DONE]} cases, {counts[FAILED]} failed, {counts[MISSING]} not computed yet."]
    if s.rows:
        above = "" if s.limit is None else f"{'above ' + format(1e3 * s.limit, 'g') + ' mN m':>24s}"
        lines += ["", f"{'line':18s} {'Hz':>19s} {'median':>9s} {'P95':>9s} {'P95, 95 % sure':>20s} {'P99':>9s} {'largest':>9s}"
                  f" {'case':>8s}{above}   mN m, 0-to-peak"]  # fmt: skip
        lines += [_row_text(r) for r in _shown(s)]
    for item in s.tornados[:2]:
        effects = ", ".join(f"{e.key} {1e3 * e.low:.4g} to {1e3 * e.high:.4g}" for e in item.effects[:4])
        fit = f" (plane explains {100 * item.explained:.0f} %)" if math.isfinite(item.explained) else ""
        lines += ["", f"What moves {item.line}, mN m{fit}: {effects}"]
    for found in s.indices[:2]:
        order = np.argsort([-t.value for t in found.total])[:4]
        terms = ", ".join(f"{found.keys[k]} {found.first[k].value:.2f} / {found.total[k].value:.2f}" for k in order)
        lines += [f"Sobol indices of {found.line}, first order / total: {terms}"]
    folder = s.results.campaign.folder
    worst = s.worst[ANY][:1]
    lines += ["", f"Worst case again: microvib campaign case {folder} {worst[0][0]} --out worst.yaml"] if worst else []
    return "\n".join(lines)


def _shown(s: Summary) -> list[LineStatistics]:
    """The largest line of each case, and lines of the pictures with what else is at least a hundredth of the largest."""
    top = s.rows[0].p95.value
    return [r for r in s.rows if r.line in (ANY, *s.lines) or ("_plus_" not in r.line and "_minus_" not in r.line
            and r.p95.value > 0.01 * top)]  # fmt: skip


def _row_text(r: LineStatistics) -> str:
    text = (
        f"{r.line:18s} {_hertz(r):>19s} {_milli(r.median.value):>9s} {_milli(r.p95.value):>9s} {_interval(r.p95):>20s}"
        f" {_milli(r.p99.value):>9s} {_milli(r.largest):>9s} {r.worst:8d}"
    )
    return text if r.exceedance is None else f"{text}{_percent_interval(r.exceedance):>24s}"


def _hertz(r: LineStatistics) -> str:
    low, high = r.frequency
    if not math.isfinite(low):
        return ""
    return f"{low:.5g}" if high - low < 1e-4 * high else f"{low:.4g} to {high:.4g}"


def _milli(value: float) -> str:
    return number(1e3 * value)


def _interval(e: Estimate) -> str:
    """An interval; an open end means that the cases are too few to bound it."""
    return f"{_milli(e.low) or '?'} to {_milli(e.high) or '?'}"


def _percent_interval(e: Estimate) -> str:
    return f"{100 * e.value:.3g} % ({100 * e.low:.2g} to {100 * e.high:.2g})"


def _counts(results: Results) -> dict[int, int]:
    state = results.state
    return {code: int(np.sum(state == code)) for code in (MISSING, DONE, FAILED)}


def write_report(out: Path, s: Summary) -> tuple[str, ...]:
    """Tables, pictures and report of a campaign; they replace those of an earlier call."""
    pictures = _pictures(s)
    files: dict[str, Any] = {
        "statistics.csv": _statistics_csv(s.rows),
        "worst.csv": _worst_csv(s),
        "failed.csv": _failed_csv(s.results),
        "effects.csv": _effects_csv(s),
        **{f"{name}.png": _png(figure) for name, (figure, _) in pictures.items()},
        "report.html": _report(s, pictures),
    }
    write_folder(out, files, overwrite=True)
    return tuple(files)


def _png(figure: Any) -> Any:
    return lambda path: figure.savefig(path, format="png")


def _pictures(s: Summary) -> dict[str, tuple[Any, str]]:
    """Figures by name, each with its caption."""
    results, design = s.results, s.results.campaign.design
    made: dict[str, tuple[Any, str]] = {}
    if s.rows:
        text = "Bars from the median to the 95 % point of the cases."
        made["envelopes"] = campaign_plots.envelopes(_shown(s)[:16], s.limit), text
        lines = [ANY, *s.lines][:6]
        text = "Part of the cases above an amplitude."
        made["exceedance"] = campaign_plots.exceedances(results, lines, s.limit, s.band), text
        text = "Cases by amplitude of each line. Full, dashed and dotted: median, 95 % and 99 % point."
        made["histograms"] = campaign_plots.histograms(results, lines, s.limit, s.band), text
    if any(len(levels.values) > 1 for levels in design.levels):
        text = "Median over the levels of a key; shaded, 5 to 95 % of the cases."
        made["levels"] = campaign_plots.over_levels(results, [ANY, *s.lines][:4], s.band), text
    if s.tornados:
        text = "Amplitude from the 5 % to the 95 % point of each key, the others at their mean; levels from lowest to highest mean."
        made["tornado"] = campaign_plots.tornados(s.tornados), text
    if s.indices:
        text = (
            "Part of the variance that a key explains alone (first order) and with all others (total), 95 % bootstrap."
        )
        made["sobol"] = campaign_plots.sobol_bars(s.indices), text
    scatter = campaign_plots.scatters(results, ANY, s.band)
    if scatter is not None:
        made["scatter"] = scatter, "Largest line of each case over what varies."
    return made


def _csv(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([number(x, 9) if isinstance(x, float) else x for x in row] for row in rows)
    return stream.getvalue()


def _statistics_csv(rows: Sequence[LineStatistics]) -> str:
    header = ["line", "cases", "lowest_hz", "highest_hz", "mean_n_m", "deviation_n_m"]
    header += [f"{name}{end}_n_m" for name in ("median", "p95", "p99") for end in ("", "_low", "_high")]
    header += ["largest_n_m", "worst_case", "exceedance", "exceedance_low", "exceedance_high"]

    def cells(e: Estimate | None) -> list[float]:
        return [math.nan] * 3 if e is None else [e.value, e.low, e.high]

    return _csv(header, (
        [r.line, r.count, *r.frequency, r.mean, r.deviation, *cells(r.median), *cells(r.p95), *cells(r.p99), r.largest,
         r.worst, *cells(r.exceedance)]
        for r in rows
    ))  # fmt: skip


def _worst_csv(s: Summary) -> str:
    design = s.results.campaign.design
    keys = design.keys
    rows = []
    for line, found in s.worst.items():
        for rank, (case, amplitude) in enumerate(found, 1):
            labels = design.labels(case)
            rows.append([line, rank, case, amplitude, *(labels.get(key, "") for key in keys)])
    return _csv(["line", "rank", "case", "amplitude_n_m", *keys], rows)


def _failed_csv(results: Results) -> str:
    design, reasons = results.campaign.design, results.reasons
    keys = design.keys
    failed = [int(k) for k in np.flatnonzero(results.state == FAILED)]
    labelled = ((case, design.labels(case)) for case in failed)
    rows = ([case, reasons[case], *(labels.get(key, "") for key in keys)] for case, labels in labelled)
    return _csv(["case", "reason", *keys], rows)


def _effects_csv(s: Summary) -> str:
    rows: list[list[Any]] = [["tornado", t.line, e.key, e.low, e.high, ""] for t in s.tornados for e in t.effects]
    for found in s.indices:
        for kind, estimates in (("sobol first order", found.first), ("sobol total", found.total)):
            rows += [
                [kind, found.line, key, e.low, e.high, e.value] for key, e in zip(found.keys, estimates, strict=True)
            ]
    return _csv(["kind", "line", "key", "low", "high", "value"], rows)


def _report(s: Summary, pictures: dict[str, tuple[Any, str]]) -> str:
    campaign = s.results.campaign
    design, counts = campaign.design, _counts(s.results)
    header = ["line", "frequency [Hz]", "median [mN m]", "P95 [mN m]", "its 95 % interval [mN m]", "P99 [mN m]",
              "largest [mN m]", "in case [1]"]  # fmt: skip
    header += ["above the limit [1]"] if s.limit is not None else []
    lines = [
        [r.line, _hertz(r), _milli(r.median.value), _milli(r.p95.value), _interval(r.p95), _milli(r.p99.value),
         _milli(r.largest), str(r.worst), *([_percent_interval(r.exceedance)] if r.exceedance else [])]
        for r in _shown(s)
    ] if s.rows else []  # fmt: skip
    sections: list[dict[str, Any]] = []
    if lines:
        sections.append({"title": "Lines", "header": header, "rows": lines, "text": _how_to_read(s)})
    titles = {
        "envelopes": "Envelopes", "exceedance": "Exceedance", "histograms": "Histograms", "tornado": "What moves the lines",
        "sobol": "Sobol indices", "scatter": "Cases", "levels": "Over the levels",
    }  # fmt: skip
    for name, (figure, caption) in pictures.items():
        sections.append({"title": titles[name], "figure": picture(figure), "caption": caption})
    sections += [_worst_section(s), _varied_section(campaign), *_failed_section(s.results)]
    lead = (
        f"{counts[DONE]} of {design.cases} cases of {design.base.title or design.study.scenario}, {counts[FAILED]} failed,"
        f" {counts[MISSING]} not computed. {_sampling(campaign)} Identity {campaign.identity[:16]}."
    )
    return page(design.study.title or f"Campaign {campaign.folder.name}", lead, sections)


def _how_to_read(s: Summary) -> str:
    band = "" if s.band == (0.0, math.inf) else f" Lines from {s.band[0]:g} to {s.band[1]:g} Hz."
    text = (
        "P95 and P99: amplitudes that 95 % and 99 % of the cases stay below. Intervals hold with 95 % confidence whatever the"
        " distribution, for independent cases; with '?' the cases are too few."
    )
    return text + band + " Figures are the model's for the spread assumed; they are not a measured batch."


def _sampling(campaign: Campaign) -> str:
    design = campaign.design
    sampling, settings = design.study.sampling, design.base
    how = (
        f"Sampling: {sampling.method}, {design.samples.shape[0]} points, seed {sampling.seed}."
        if design.uncertain
        else ""
    )
    record = settings.record
    solve = (
        "steady states"
        if design.study.solve == "steady"
        else f"records of {record.duration:g} s after {record.settle:g} s"
    )
    return f"{how} Each case: {solve}."


def _worst_section(s: Summary) -> dict[str, Any]:
    design = s.results.campaign.design
    rows = [
        [line, str(case), _milli(amplitude), "; ".join(f"{key} {text}" for key, text in design.labels(case).items())]
        for line, found in s.worst.items()
        for case, amplitude in found[:3]
    ]
    text = f"Each runs again alone: microvib campaign case {s.results.campaign.folder} CASE"
    return {"title": "Worst cases", "header": ["line", "case [1]", "amplitude [mN m]", "what is varied"], "rows": rows,
            "text": text}  # fmt: skip


def _varied_section(campaign: Campaign) -> dict[str, Any]:
    design = campaign.design
    rows = [
        [x.key, f"{len(x.values)} levels: {', '.join(x.labels[:8])}{', ...' if len(x.labels) > 8 else ''}"]
        for x in design.levels
    ]
    rows += [[x.key, x.text] for x in design.uncertain]
    rows += [[f"{' and '.join(c.keys)}", f"correlation {c.coefficient:g}"] for c in design.study.correlations]
    rows += [[f"combination {k}", str(item)] for k, item in enumerate(design.combinations) if item]
    return {"title": "What varies", "header": ["key", "how"], "rows": rows}


def _failed_section(results: Results) -> list[dict[str, Any]]:
    failed = np.flatnonzero(results.state == FAILED)
    if not failed.size:
        return []
    reasons = results.reasons
    rows = [[str(case), reasons[case]] for case in failed[:20].tolist()]
    text = "All of them are in failed.csv." if failed.size > 20 else ""
    return [{"title": "Failed cases", "header": ["case", "reason"], "rows": rows, "text": text}]


def again_text(campaign: Campaign, case: int) -> str:
    """A case computed alone, its lines, and whether they are the very numbers that are kept."""
    alone = compute(campaign.work([case]))
    lines = [f"Case {case}: " + "; ".join(f"{key} {text}" for key, text in campaign.design.labels(case).items())]
    if alone.reasons[0]:
        lines.append(f"Failed: {alone.reasons[0]}")
    for k, name in enumerate(alone.lines):
        amplitude, frequency = alone.figures["amplitude"][0, k], alone.figures["frequency"][0, k]
        lines.append(f"{name:16s} {frequency:12.5f} Hz {amplitude:12.6e} N m")
    chunk = case // campaign.chunk_size
    if not campaign.file(chunk).is_file():
        return "\n".join([*lines, "It is not computed in the campaign yet."])
    kept, place = campaign.read(chunk), case % campaign.chunk_size
    differing = [name for name in alone.lines if not _same(alone, 0, kept, place, name)]
    same = not differing and alone.reasons[0] == kept.reasons[place]
    lines.append(
        "The same as in the campaign, to the last bit."
        if same
        else f"Differs from the campaign in {', '.join(differing) or 'its reason'}."
    )
    return "\n".join(lines)


def _same(a: Any, i: int, b: Any, j: int, name: str) -> bool:
    x, y = a.lines.index(name), b.lines.index(name) if name in b.lines else -1
    return y >= 0 and all(np.array_equal(a.figures[f][i, x], b.figures[f][j, y], equal_nan=True) for f in FIGURES)


def write_case(campaign: Campaign, case: int, path: Path) -> None:
    """Write a case's scenario to a new file; OutputError where there is one already."""
    text = dump_scenario(campaign.design.scenario(case))
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise OutputError(f"{path}: exists already; nothing was written") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
