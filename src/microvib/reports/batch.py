"""Several records side by side: one table of their figures with mean, spread and outliers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from microvib.analysis.margins import worst_verdict
from microvib.reports import sheets
from microvib.reports.analysis_units import table_in_unit
from microvib.reports.outcome import Outcome, Pairs, Part, Picture, text_files
from microvib.reports.sheets import COLOURS, RED
from microvib.reports.typography import file_name
from microvib.results import TORQUE, Column, Table
from microvib.signals.scatter import OUTLIER_RATIO
from microvib.studies.batch import MIN_RECORDS, Batch, FigureSpread
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 24
"""Figures that a picture has room for."""
_CAPTION = (
    "Mean and standard deviation over the records that have the figure. An outlier is further from the"
    f" median than {OUTLIER_RATIO:g} times a robust scale, of the scatter and of the figure's own"
    f" uncertainty; of fewer than {MIN_RECORDS} records none is named."
)


def batch_outcome(batch: Batch, outcomes: Sequence[Outcome]) -> Outcome:
    """Several records side by side, with the files of each of their ``outcomes``."""
    spreads = Table.of("comparison", FigureSpread, batch.spreads, caption=_CAPTION)
    count = len(batch.names)
    return Outcome(
        "Comparison of records",
        f"{count} records, channel {batch.channel}",
        f"{count} records, analysed alike: mean, spread and outliers of their figures.",
        worst_verdict(one.verdict for one in outcomes),
        (),
        (
            Part("", (Pairs(tuple(_about(batch, outcomes))),)),
            Part("Figures of all records", (table_in_unit(spreads, batch.unit), _picture(batch))),
        ),
        files=(table_in_unit(_each(batch), batch.unit),),
        other_files=_files(batch.names, outcomes),
    )


def _about(batch: Batch, outcomes: Sequence[Outcome]) -> list[tuple[str, str]]:
    rows = []
    for k, (name, one) in enumerate(zip(batch.names, outcomes, strict=True), 1):
        judged = f", {one.verdict.replace('fail', 'FAIL')}" if one.verdict else ""
        rows.append((f"Record {k}", f"{file_name(name)}, channel {batch.channel}{judged}"))
    return rows


def _each(batch: Batch) -> Table:
    """The figures of each record, a row for each figure."""
    columns = [Column("figure", "figure")]
    columns += [
        Column(f"record_{k}_n_m", f"record {k}", TORQUE) for k in range(1, len(batch.names) + 1)
    ]
    rows = [
        (one.name, *(f[one.name].value if one.name in f else math.nan for f in batch.figures))
        for one in batch.spreads
    ]
    return Table("figures", tuple(columns), tuple(rows), for_readers=())


def short_names(names: Sequence[str]) -> list[str]:
    """A name of a file for each record, without folder and ending, each once."""
    found: list[str] = []
    for name in names:
        stem, k = Path(name).stem or "record", 1
        while (short := stem if k == 1 else f"{stem}-{k}") in found:
            k += 1
        found.append(short)
    return found


def _files(names: Sequence[str], outcomes: Sequence[Outcome]) -> Mapping[str, str]:
    """Tables of each record, under its name."""
    return {
        f"{short}_{file}": text
        for short, one in zip(short_names(names), outcomes, strict=True)
        for file, text in text_files(one).items()
    }


def _picture(batch: Batch) -> Picture:
    return Picture("comparison", lambda: _drawn(batch), "Figures of all records")


def _drawn(batch: Batch) -> Figure:
    """The figures of each record over their means, the largest figures first."""
    shown = sorted(
        (one for one in batch.spreads if one.records > 1 and one.mean > 0.0),
        key=lambda one: -one.mean,
    )[:_SHOWN]
    figure, ax = sheets.one_axes(max(0.27 * len(shown) + 1.2, 2.4))
    for k, one in enumerate(shown):
        values = [
            100.0 * (f[one.name].value / one.mean - 1.0) for f in batch.figures if one.name in f
        ]
        named = one.outliers.split(", ") if one.records >= MIN_RECORDS else []
        far = [
            name in named
            for name, f in zip(batch.names, batch.figures, strict=True)
            if one.name in f
        ]
        y = np.full(len(values), float(-k))
        colours = [RED if out else COLOURS[0] for out in far]
        ax.scatter(values, y, c=colours, s=14, alpha=0.7, linewidths=0)
    ax.set_yticks(range(0, -len(shown), -1), [one.name for one in shown])
    ax.axvline(0.0, color="#888888", linewidth=0.8)
    ax.set(
        xlabel=f"record over mean, less 1 [%] (amplitudes in m{pretty(batch.unit)}; outliers red)"
    )
    ax.set_ylim(-len(shown) + 0.4, 0.6)
    return figure
