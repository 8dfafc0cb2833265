"""Peaks of bands for those who read them: a table with verdicts, and a picture of peaks and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from microvib.analysis.margins import worst_verdict
from microvib.io.tables import rows_csv
from microvib.reports import sheets
from microvib.reports.analysis_units import columns_in_unit
from microvib.reports.document import Text
from microvib.reports.outcome import Outcome, Part, Picture
from microvib.reports.sheets import BLUE, GREY, RED
from microvib.results import Table
from microvib.studies.bands import BandPeak, verdict_on
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WORDS = {"pass": "pass", "not judged": "not judged", "fail": "FAIL"}
"""Verdicts as a sentence has them, those that fail last."""
BANDS_CAPTION = (
    "Largest magnitudes of the time history in each band, its mean taken out, by zero-phase FIR filters (Kaiser,"
    " 60 dB): half of an amplitude passes at an edge, and within the roll-off about it the filter falls from 1 to"
    " 0. *Least* and *largest* are bounds over all filters that fall there in any way; the verdict holds for all"
    " of them. What the filters' transients reach at both ends of the record is left out."
)


def band_parts(peaks: Sequence[BandPeak]) -> list[Part]:
    """Parts of a report on the peaks of bands, one for each unit; none without bands."""
    units = list(dict.fromkeys(peak.unit for peak in peaks))
    return [_part([peak for peak in peaks if peak.unit == unit], unit, units) for unit in units]


def with_bands(outcome: Outcome, peaks: Sequence[BandPeak]) -> Outcome:
    """An outcome with its peaks in bands: their verdict counts, too, and its first page says so."""
    if not peaks:
        return outcome
    worst = worst_verdict([outcome.verdict, verdict_on(peaks)])
    first, *others = outcome.parts
    said = Text(f"Peaks in bands: {bands_sentence(peaks)}.")
    first = replace(first, items=(*first.items, said))
    return replace(outcome, verdict=worst, parts=(first, *others, *band_parts(peaks)))


def bands_files(peaks: Sequence[BandPeak]) -> dict[str, str]:
    """CSV files of peaks in bands, by name."""
    tables = [x for part in band_parts(peaks) for x in part.items if isinstance(x, Table)]
    return {
        f"{x.name}.csv": rows_csv([column.key for column in x.columns], x.file_rows())
        for x in tables
    }


def bands_sentence(peaks: Sequence[BandPeak]) -> str:
    """How many bands pass, fail and are not judged, and which fail."""
    count = {word: [one for one in peaks if one.verdict == word] for word in WORDS}
    said = [f"{len(found)} {WORDS[word]}" for word, found in count.items() if found]
    failed = [f"{one.channel} {one.band}" for one in count["fail"]]
    return ", ".join(said) + (f": {'; '.join(failed)}" if failed else "")


def _part(peaks: Sequence[BandPeak], unit: str, units: Sequence[str]) -> Part:
    ending = f"_{1 + units.index(unit)}" if len(units) > 1 else ""
    name = f"band_peaks{ending}"
    table = Table.of(name, BandPeak, peaks, caption=BANDS_CAPTION.replace("*", ""))
    table = replace(table, columns=columns_in_unit(table.columns, unit))
    notes = [
        Text(f"{one.channel}, {one.band}, is not judged: {one.why}.") for one in peaks if one.why
    ]
    picture = Picture(name, lambda: _drawn(peaks, unit), "Peaks of bands and their limits")
    title = "Peaks in bands" if len(units) == 1 else f"Peaks in bands, in {pretty(unit)}"
    return Part(title, (table, *notes, picture), new_page=True)


def _drawn(peaks: Sequence[BandPeak], unit: str) -> Figure:
    figure, ax = sheets.one_axes(3.2)
    draw_band_peaks(ax, peaks, unit)
    return figure


def draw_band_peaks(ax: Axes, peaks: Sequence[BandPeak], unit: str) -> None:
    """Limits over frequency, with the peak of each band and its bounds over filters; open where it is
    not judged.
    """
    lowest = min((one.low for one in peaks if one.low > 0.0), default=0.1)
    for k, one in enumerate(peaks):
        low = max(one.low, 0.3 * lowest)
        label = "limit" if k == 0 else ""
        ax.hlines(1e3 * one.limit, low, one.high, color=GREY, linewidth=1.6, label=label)
        if not math.isfinite(one.peak):
            continue
        at = math.sqrt(low * one.high)
        colour = RED if one.verdict == "fail" else BLUE
        face = "none" if one.verdict == "not judged" else colour
        ax.vlines(at, 1e3 * max(one.least, 1e-3 * one.peak), 1e3 * one.largest, color=colour)
        ax.plot(at, 1e3 * one.peak, "o", color=colour, markerfacecolor=face, markersize=5)
    ax.plot([], [], "o", color=BLUE, label="peak, bounds over filters")
    ax.plot([], [], "o", color=RED, label="above the limit")
    ax.plot([], [], "o", color=BLUE, markerfacecolor="none", label="not judged")
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=f"peak [m{pretty(unit)}]")
    sheets.plain_numbers(ax.xaxis)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.25)
    ax.legend(loc="upper center", fontsize=7, ncols=4)
