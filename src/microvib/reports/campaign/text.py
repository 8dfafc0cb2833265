"""A campaign as text, tables, pictures and report; one of its cases, computed again."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import rows_csv
from microvib.io.writing import write_file
from microvib.reports.campaign import report
from microvib.reports.campaign.report import (
    MAX_LEVELS,
    MAX_REASONS,
    Summary,
    above_limit,
    frequency_text,
    integrated_text,
    interval,
    percents,
    reason_without_values,
    shown_rows,
)
from microvib.reports.document import Contents
from microvib.reports.numbers import brief_milli
from microvib.reports.sheets import png
from microvib.studies.campaign.cases import FIGURES, Chunk, compute
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.results import DONE, FAILED, MISSING
from microvib.studies.campaign.slurm import job_state
from microvib.studies.campaign.statistics import LARGEST_LINE, Estimate, LineStatistics
from microvib.text_tables import text_table


def state_text(campaign: Campaign, reasons: bool = False) -> str:
    """How far a campaign is: cases done, failed, missing, and with ``reasons`` why cases failed."""
    computed, why = 0, Counter[str]()
    examples: dict[str, int] = {}
    for cases, chunk in campaign.results():
        computed += len(cases)
        for case, reason in zip(cases, chunk.reasons, strict=True):
            if reason:
                kind = reason_without_values(reason)
                why[kind] += 1
                examples.setdefault(kind, case)
    total = campaign.design.cases
    lines = [f"{computed} of {total} cases computed, {why.total()} of them failed"]
    if computed < total:
        lines[0] += (
            f"; {total - computed} to do: microvib campaign resume"
            f" {shlex.quote(str(campaign.folder))}"
        )
    if queued := job_state(campaign):
        lines.append(f"Slurm: {queued}")
    if reasons:
        lines += [
            f"  {count} x {kind} (case {examples[kind]})"
            for kind, count in why.most_common(MAX_REASONS)
        ]
    return "\n".join(lines)


def report_text(s: Summary) -> str:
    """Distributions, exceedance, effects and worst cases as text."""
    cases = report.counts(s.results)
    lines = [f"{cases[DONE]} cases, {cases[FAILED]} failed, {cases[MISSING]} not computed yet."]
    if integrated := integrated_text(s):
        lines += [integrated]
    else:
        lines += []
    if s.rows:
        head = ["line", "Hz", "median", "P95", "P95, 95 % confidence", "P99", "largest", "case"]
        rows = [[*head, *([] if s.limit is None else [f"above {1e3 * s.limit:g} mN m"])]]
        for r in shown_rows(s):
            median, p95, p99, top = map(
                brief_milli, (r.median.value, r.p95.value, r.p99.value, r.largest)
            )
            row = [r.line, frequency_text(r), median, p95, interval(r.p95), p99, top, str(r.worst)]
            rows.append(row + ([] if s.limit is None else [above_limit(r)]))
        lines += ["", "Lines in mN m, 0-to-peak:", text_table(rows[0], rows[1:], left=1)]
    if s.rows and s.several:
        text = "Each line at the level at which it is largest. The largest line level by level, highest first:"
        lines += ["", text, "", *(_level_text(r) for r in s.by_level[:MAX_LEVELS])]
        lines += [f"and {len(s.by_level) - MAX_LEVELS} more in statistics.csv"] * (
            len(s.by_level) > MAX_LEVELS
        )
    if s.any_level is not None and s.limit is not None:
        any_, e = s.any_level, s.any_level.exceedance
        lines += ["", f"Above {1e3 * s.limit:g} mN m at one level or more: {any_.above} of {any_.count} draws, {any_.unknown} not"
                  f" judged, {100 * e.value:.3g} % (95 % interval {percents(e)} %)."]  # fmt: skip
    if why := report.why_not_judged(s):
        lines += ["", why]
    else:
        lines += []
    for item in s.tornados[:2]:
        effects = ", ".join(
            f"{e.key} {1e3 * e.low:.4g} to {1e3 * e.high:.4g}" for e in item.effects[:4]
        )
        if math.isfinite(item.explained):
            fit = f" (plane explains {100 * item.explained:.0f} %)"
        else:
            fit = ""
        lines += ["", f"What moves {item.line}, mN m{fit}: {effects}"]
    for found in s.indices[:2]:
        order = np.argsort([-t.value for t in found.total])[:4]
        terms = ", ".join(
            f"{found.keys[k]} {found.first[k].value:.2f} / {found.total[k].value:.2f}"
            for k in order
        )
        lines += [f"Sobol indices of {found.line}, first order / total: {terms}"]
    worst = s.worst[LARGEST_LINE][:1]
    if worst:
        folder = shlex.quote(str(s.results.campaign.folder))
        lines += [
            "",
            f"Worst case again: microvib campaign case {folder} {worst[0][0]} --out worst.yaml",
        ]
    return "\n".join(lines)


def _level_text(r: LineStatistics) -> str:
    if brief_milli(r.median.value):
        median = f"median {brief_milli(r.median.value)}, "
    else:
        median = ""
    if r.above is not None:
        above = f"; above the limit: {above_limit(r)}"
    else:
        above = ""
    return (
        f"  {r.level.text}: {median}largest {brief_milli(r.largest)} mN m (case {r.worst}){above}"
    )


def campaign_folder(s: Summary) -> Contents:
    """Tables, pictures and report of a campaign."""
    pictures = report.draw(s)
    files: dict[str, Any] = {
        "statistics.csv": _statistics_csv(s.rows),
        **_cases_csv(s),
        "effects.csv": _effects_csv(s),
        **{f"{name}.png": png(picture.drawing) for name, picture in pictures.items()},
    }
    return files, report.campaign_report(s, pictures)


def _statistics_csv(rows: Sequence[LineStatistics]) -> str:
    header = ["level", "line", "cases", "lowest_hz", "highest_hz", "mean_n_m", "deviation_n_m"]
    header += [
        f"{name}{end}_n_m" for name in ("median", "p95", "p99") for end in ("", "_low", "_high")
    ]
    header += [
        "largest_n_m",
        "worst_case",
        "above",
        "exceedance",
        "exceedance_low",
        "exceedance_high",
    ]

    def cells(e: Estimate | None) -> list[float]:
        if e is None:
            return [math.nan] * 3
        return [e.value, e.low, e.high]

    return rows_csv(header, (
        [r.level.text, r.line, r.count, *r.frequency, r.mean, r.deviation, *cells(r.median), *cells(r.p95), *cells(r.p99),
         r.largest, r.worst, "" if r.above is None else r.above, *cells(r.exceedance)]
        for r in rows
    ))  # fmt: skip


def _cases_csv(s: Summary) -> dict[str, str]:
    """Tables of the worst cases and of those that failed, with what is varied in them."""
    design = s.results.campaign.design
    keys = design.keys

    def labels(case: int) -> list[str]:
        found = design.labels(case)
        return [found.get(key, "") for key in keys]

    worst = (
        [line, rank, case, amplitude, *labels(case)]
        for line, found in s.worst.items()
        for rank, (case, amplitude) in enumerate(found, 1)
    )
    failed = (
        [case, reason, *labels(case)] for case, reason in enumerate(s.results.reasons) if reason
    )
    return {
        "worst.csv": rows_csv(["line", "rank", "case", "amplitude_n_m", *keys], worst),
        "failed.csv": rows_csv(["case", "reason", *keys], failed),
    }


def _effects_csv(s: Summary) -> str:
    rows: list[list[Any]] = [
        ["tornado", t.line, e.key, e.low, e.high, ""] for t in s.tornados for e in t.effects
    ]
    for found in s.indices:
        for kind, estimates in (("sobol first order", found.first), ("sobol total", found.total)):
            pairs = zip(found.keys, estimates, strict=True)
            rows += [[kind, found.line, key, e.low, e.high, e.value] for key, e in pairs]
    return rows_csv(["kind", "line", "key", "low", "high", "value"], rows)


def recomputed_case_text(campaign: Campaign, case: int) -> str:
    """A case computed alone, its lines, and whether they are the very numbers that are kept."""
    chunk = case // campaign.chunk_size
    alone = compute(campaign.work(chunk, [case]))
    lines = [
        f"Case {case}: "
        + "; ".join(f"{key} {text}" for key, text in campaign.design.labels(case).items())
    ]
    if alone.reasons[0]:
        lines.append(f"Failed: {alone.reasons[0]}")
    for k, name in enumerate(alone.lines):
        amplitude, frequency = alone.figures["amplitude"][0, k], alone.figures["frequency"][0, k]
        lines.append(f"{name:16s} {frequency:12.5f} Hz {amplitude:12.6e} N m")
    if not campaign.file(chunk).is_file():
        return "\n".join([*lines, "It is not computed in the campaign yet."])
    kept, place = campaign.read(chunk), case % campaign.chunk_size
    differing = [
        name for name in alone.lines if _figures(alone, 0, name) != _figures(kept, place, name)
    ]
    if alone.reasons[0] != kept.reasons[place] and not differing:
        differing += ["its reason"]
    else:
        differing += []
    same = "The same as in the campaign, to the last bit."
    lines.append(f"Differs from the campaign in {', '.join(differing)}." if differing else same)
    return "\n".join(lines)


def _figures(chunk: Chunk, k: int, line: str) -> bytes:
    """All that is kept of a line of the k-th case, as bytes; none where the chunk has no such line."""
    if line in chunk.lines:
        at = chunk.lines.index(line)
    else:
        at = None
    if at is None:
        return b""
    return b"".join(chunk.figures[name][k, at].tobytes() for name in FIGURES)


def write_case(campaign: Campaign, case: int, path: Path) -> None:
    """Write a case's scenario to a new file; OutputError where there is one already."""
    write_file(path, dump_scenario(campaign.design.scenario(case)))
