"""Campaigns of the page: computed in the folder of their job, as `microvib campaign` computes them in a
folder of its own, so that they go on where they were stopped.
"""

from __future__ import annotations

import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import OptionError
from microvib.io.tables import to_json
from microvib.reports import rendering
from microvib.reports.campaign.report import (
    Summary,
    allowed_by,
    campaign_outcome,
    missing_percentile_reason,
    summarise,
)
from microvib.reports.outcome import page_answer, report, text_files
from microvib.studies.campaign.design import Design, limit_of
from microvib.studies.campaign.folder import Campaign, create, open_campaign
from microvib.studies.campaign.results import DONE, Results, merge, open_results
from microvib.studies.campaign.run import compute_missing
from microvib.studies.campaign.statistics import LARGEST_LINE, LineStatistics, largest_line
from microvib.studies.workers import in_threads
from microvib.units import Si, band, convert
from microvib.web.jobs import ProgressCallback
from microvib.web.routes.forms import values_of

CAMPAIGN = "campaign"
"""Folder of the campaign in that of its job."""
SO_FAR = "partial.json"
"""File of the answer of a campaign that is not through."""
_EVERY = 2.0
"""Seconds between two looks at what is known so far, or ten times what one takes."""
_WORST = 20
_DIGITS = 6


def compute(folder: Path, design: Design | None, tell: ProgressCallback) -> dict[str, Any]:
    """Compute a campaign of ``design``, or what is missing of the one that is in ``folder``; its
    answer.
    """
    where = folder / CAMPAIGN
    if design is not None and not where.exists():
        campaign = create(design, where)
    else:
        campaign = open_campaign(where)
    next_look = time.monotonic()

    def progress(done: int, total: int) -> None:
        nonlocal next_look
        tell(done, total, "cases", "computing")
        began = time.monotonic()
        if 0 < done < total and began > next_look:
            _write_whole(folder / SO_FAR, to_json(answer(campaign)))
            took = time.monotonic() - began
            next_look = began + took + max(_EVERY, 10.0 * took)

    with in_threads() as backend:
        compute_missing(campaign, backend, progress=progress)
    tell(campaign.design.cases, campaign.design.cases, "cases", "drawing")
    return answer(campaign, pictures=True)


def _write_whole(path: Path, text: str) -> None:
    new = path.with_name(f"{os.getpid()}-{path.name}")
    new.write_text(text, encoding="utf-8")
    os.replace(new, path)


def answer(campaign: Campaign, pictures: bool = False) -> dict[str, Any]:
    """Figures, cases and tables of a campaign as far as it is computed, for the page."""
    merge(campaign)
    summary = _summary(campaign)
    outcome = campaign_outcome(summary)
    design = campaign.design
    found = summary.results
    return page_answer(outcome, pictures=pictures) | {
        "cases": design.cases,
        "computed": int(np.sum(found.state == DONE)),
        "files": text_files(outcome),
        "percentiles": _percentiles(summary),
        "worst": _worst(summary),
        "scatter": _scatter(found, summary),
        "limit": summary.limit if isinstance(summary.limit, float) else None,
        "steady": design.study.solve == "steady" or design.base.record.start == "steady",
    }


def _summary(campaign: Campaign) -> Summary:
    """Its statistics against the study's own limit and band, as `microvib campaign report` has them."""
    study = campaign.design.study
    within = (Si(0.0), Si("inf")) if study.band is None else band(study.band)
    return summarise(open_results(campaign), allowed_by(limit_of(study), within), within)


def _percentiles(s: Summary) -> list[dict[str, Any]]:
    """Percentiles of the largest line at each level [N m], with their intervals, or why one is not given."""

    def figures(row: LineStatistics, name: str, q: float) -> dict[str, Any]:
        return asdict(getattr(row, name)) | {"why": missing_percentile_reason(row, q)}

    return [
        {
            "level": row.level.text,
            "draws": row.level.draws,
            "failed": row.level.failed,
            "median": figures(row, "median", 0.5),
            "p95": figures(row, "p95", 0.95),
            "p99": figures(row, "p99", 0.99),
            "largest": row.largest,
            "case": row.worst,
        }
        for row in s.by_level
    ]


def _worst(s: Summary) -> list[dict[str, Any]]:
    """The worst cases by their largest line, or by their smallest margin to a limit over frequency, with
    what varies in them.
    """
    design, found = s.results.campaign.design, s.worst[LARGEST_LINE]
    return [
        {"case": one.case, "amplitude": one.amplitude, "labels": design.labels(one.case)}
        for one in found[:_WORST]
    ]


def _scatter(results: Results, s: Summary) -> dict[str, Any]:
    """All cases: values of what varies, in the units that people use, and their lines."""
    design = results.campaign.design
    lines = [
        {
            "line": name,
            "frequency": _short(results.of(name, "frequency")),
            "amplitude": _short(results.of(name)),
        }
        for name in results.lines
    ]
    return {
        "keys": [values_of_key(design, key) for key in design.keys],
        "lines": lines,
        "largest": _short(largest_line(results, s.band)),
        "reasons": {str(k): text for k, text in enumerate(results.reasons) if text},
    }


def values_of_key(design: Design, key: str) -> dict[str, Any]:
    """Values of a key in all cases, in the unit that people use for it."""
    values = design.column(key)
    if values.dtype == object:
        return {"key": key, "unit": "", "values": values.tolist()}
    varied = {x.key: x for x in (*design.levels, *design.uncertain)}.get(key)
    if varied is None or not varied.display:
        return {"key": key, "unit": "", "values": _short(values)}
    factor = convert(f"1 {varied.unit}", varied.display)
    return {"key": key, "unit": varied.display, "values": _short(factor * values)}


def _short(values: np.ndarray) -> list[float]:
    """Numbers with six digits: more do not show."""
    return [float(f"{x:.{_DIGITS}g}") for x in values.tolist()]


def case(folder: Path, number: int) -> dict[str, Any]:
    """A case as changes of the scenario that the campaign varies; MicrovibError where there is none of
    this number.
    """
    campaign = open_campaign(folder / CAMPAIGN)
    design = campaign.design
    if number >= design.cases:
        raise OptionError("number", f"there is no case {number}; there are 0 to {design.cases - 1}")
    texts = values_of(design.scenario(number))
    return {
        "number": number,
        "changes": {key: texts[key] for key in design.changes(number)},
        "labels": design.labels(number),
        "steady": design.study.solve == "steady" or design.base.record.start == "steady",
    }


def write_report(folder: Path, name: str) -> None:
    """Write ``report.html`` or ``report.pdf`` of what is computed beside the campaign."""
    campaign = open_campaign(folder / CAMPAIGN)
    merge(campaign)
    document = report(campaign_outcome(_summary(campaign)))
    new = folder / f"{os.getpid()}-{name}"
    if name == "report.pdf":
        new.write_bytes(rendering.pdf(document))
    else:
        new.write_text(rendering.html(document), encoding="utf-8")
    new.replace(folder / name)
