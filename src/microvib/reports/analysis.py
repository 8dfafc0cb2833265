"""An analysis for those who read it: lines with uncertainties, spectra, bands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np

from microvib.analysis.background import BackgroundLine, mains_harmonic
from microvib.analysis.limits import Judgement
from microvib.analysis.margins import NoVerdict, Verdict, worst_verdict
from microvib.analysis.orders import OrderLine
from microvib.io.runs import lines_csv
from microvib.io.tables import columns_csv
from microvib.reports import figures
from microvib.reports.analysis_units import (
    CHANNEL_KINDS,
    ENDINGS,
    key_in_unit,
    measure_in_unit,
    table_in_unit,
)
from microvib.reports.bands import band_parts, bands_sentence
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.run.first_page import verdict_facts
from microvib.reports.run.margins import margin_tables, margins_csv
from microvib.reports.typography import file_name
from microvib.results import (
    FREQUENCY,
    TIME,
    TORQUE,
    Column,
    Table,
)
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import DETECTION_RATIO, Line, LineTable
from microvib.studies.analyse import Analysis
from microvib.studies.bands import verdict_on
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_NAMED = 8
"""Lines that a spectrum is wide enough for."""
_LINE_COLUMNS = (
    "line",
    "frequency_hz",
    "frequency_uncertainty_hz",
    "amplitude_n_m",
    "amplitude_uncertainty_n_m",
    "floor_n_m",
    "background_n_m",
    "mains",
    "origin",
    "status",
)
"""Keys of what is shown of a line."""


_WATERFALL_ROWS = 8
"""Stretches of a waterfall that a terminal shows."""


@dataclass(frozen=True)
class BandRms:
    """RMS of a band."""

    band: Annotated[str, Column("band", "band")]
    rms: Annotated[float, Column("rms", "RMS", TORQUE)]


def analysis_outcome(
    a: Analysis, judged: Judgement | None = None, *, with_spectra_files: bool = True
) -> Outcome:
    """An analysis for those who read it: lines with uncertainties, amplitude spectrum, density,
    waterfall, RMS in bands; where a limit was given, the verdict on its lines.

    The files of spectra, a row for each bin, are left out where nobody takes them: of millions of
    samples they take longer than the analysis.
    """
    files = _files(a) if with_spectra_files else {}
    reach = figures.spectrum_upper_end(_largest(a))

    def picture(name: str, made: figures.Spectral, height: float, title: str) -> tuple[Item, ...]:
        """How a spectrum was made, and its picture."""

        def draw() -> Figure:
            drawing = figures.draw_spectral(made, pretty(a.unit), reach, height, a.table, judged)
            if made is a.spectrum and a.background is not None:
                marks = [(x.frequency, x.amplitude, bool(x.mains)) for x in a.background_lines]
                figures.add_background(drawing.axes[0], a.background, marks)
            return drawing

        text = str(made)
        return (Text(f"{text[:1].upper()}{text[1:]}."), Picture(name, draw, title))

    spectrum = picture("spectrum", a.spectrum, 4.4, "Amplitude spectrum")
    density = picture("density", a.density, 2.7, "Power spectral density")
    return Outcome(
        "Analysis report",
        f"Analysis of {file_name(a.name)}, channel {a.channel}",
        f"Lines with uncertainties and spectra of {CHANNEL_KINDS[a.unit]}.",
        _verdict(a, judged),
        (*(() if judged is None else verdict_facts(judged)), *_facts(a)),
        (
            Part("", (Pairs(tuple(_about(a))), *spectrum)),
            Part("Against the limit", tuple(_against_limit(judged))),
            Part("Orders of the electrical period", _orders(a), new_page=True),
            Part("Other lines" if a.orders else "Lines", _lines(a), new_page=not a.orders),
            Part("Lines with the drive off", _of_background(a)),
            Part("Power spectral density", density),
            Part("Waterfall", (*picture("waterfall", a.waterfall, 2.9, "Waterfall"), _loudest(a))),
            Part("RMS in bands", (_bands(a),)),
            *band_parts(a.band_peaks),
        ),
        other_files=files | ({} if judged is None else {"margins.csv": margins_csv(judged)}),
    )


def _verdict(a: Analysis, judged: Judgement | None) -> Verdict | NoVerdict:
    """The verdict on lines and bands: the worse of the two, empty without limits."""
    of_lines: Verdict | NoVerdict = "" if judged is None else judged.verdict
    return worst_verdict([verdict_on(a.band_peaks), of_lines])


def _against_limit(judged: Judgement | None) -> Iterator[Item]:
    """The verdict by a limit, and the lines with the smallest margins."""
    if judged is not None:
        yield Text(str(judged))
        yield from margin_tables(judged)


def _about(a: Analysis) -> Iterator[tuple[str, str]]:
    """The source, how long it is, its step clock, and what was done to it."""
    yield "Source", f"{file_name(a.name)}, channel {a.channel}"
    yield (
        "Record",
        f"{a.recording.samples} samples at {a.recording.sample_rate:g} Hz, {a.recording.duration:g} s",
    )
    if a.clock_ratio is not None and a.table is not None:
        error = a.table.clock_ratio_uncertainty
        yield "Step clock over nominal", f"{a.clock_ratio:.7f} ± {error:.1g}"
    if a.table is not None:
        told_apart = f"{SEPARATION / a.recording.duration:.3g} Hz"
        yield "Resolution", f"lines are told apart, and from the mean, {told_apart} away"
    if a.band_peaks:
        said = [f"{bands_sentence(a.band_peaks)}", a.recording.chain_assumption.rstrip(".")]
        yield "Peaks in bands", ". ".join(filter(None, said))
    for note in a.recording.notes_on(a.channel):
        if note:
            yield "Note", note


def _orders(a: Analysis) -> tuple[Table, ...]:
    """The orders of the electrical period, each with whether it is above the noise floor."""
    if not a.orders:
        return ()
    return (
        table_in_unit(Table.of("orders", OrderLine, a.orders, caption=_ORDERS_CAPTION), a.unit),
    )


_ORDERS_CAPTION = (
    f"An order is above the noise floor from {DETECTION_RATIO:g} times that floor on. Orders of an"
    " acceleration can be compared with a torque's, sizes cannot: the structure between answers to"
    " each frequency in its own way."
)


def _lines(a: Analysis) -> tuple[Table, ...]:
    if a.table is None:
        return ()
    shown = [line for line in a.table.notable() if not (a.orders and line.of_clock)]
    if a.orders and not shown:
        return ()
    found = _with_mains(Table.of("", Line, shown, caption=_LINES_CAPTION), shown, a)
    return (table_in_unit(found.only(_LINE_COLUMNS), a.unit),)


def _of_background(a: Analysis) -> tuple[Item, ...]:
    """Lines of the background."""
    if a.background is None:
        return ()
    if not a.background_lines:
        return (Text("With the drive off there is no line above the noise."),)
    table = Table.of(
        "background", BackgroundLine, a.background_lines, brief=12, caption=_BACKGROUND_CAPTION
    )
    return (table_in_unit(table, a.unit),)


_BACKGROUND_CAPTION = (
    "The recording's largest amplitude within a part in a thousand of each line of the background. Where a"
    " line of the drive is there, too, its background says whether it is judged."
)


def _with_mains(table: Table, lines: list[Line], a: Analysis) -> Table:
    """The table with a column of the mains' harmonics that lines may be pick-up of, where any may."""
    marks = [mains_harmonic(line.place, a.recording.duration) for line in lines]
    if not any(marks):
        return table
    rows = tuple((*row, mark) for row, mark in zip(table.rows, marks, strict=True))
    return replace(table, columns=(*table.columns, Column("mains", "mains?")), rows=rows)


_LINES_CAPTION = (
    "Amplitudes 0-to-peak, independent of the bins; ± is one standard uncertainty from the floor"
    " about the line."
)


@dataclass(frozen=True)
class WaterfallPeak:
    """The largest bin of a stretch of the waterfall."""

    time: Annotated[float, Column("time_s", "middle of the stretch", TIME)]
    frequency: Annotated[float, Column("frequency_hz", "largest bin", FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]


def _loudest(a: Analysis) -> Table:
    """The largest bin of each stretch of the waterfall, for a terminal: of many stretches some."""
    w = a.waterfall
    step = max(-(-w.time.size // _WATERFALL_ROWS), 1)
    rows = []
    for k in range(0, w.time.size, step):
        i = int(np.argmax(w.amplitude[k, 1:])) + 1
        rows.append(
            WaterfallPeak(float(w.time[k]), float(w.frequency[i]), float(w.amplitude[k, i]))
        )
    caption = "The largest bin of some of the stretches, in their order."
    return table_in_unit(Table.of("", WaterfallPeak, rows, caption=caption), a.unit)


def _bands(a: Analysis) -> Table:
    bands = [BandRms(f"{low:g} to {high:g} Hz", rms) for low, high, rms in a.bands]
    bands.append(BandRms("whole record, about its mean", _rms(a)))
    caption = "RMS in 1/3-octave bands is in `third_octaves.csv`."
    return table_in_unit(Table.of("", BandRms, bands, caption=caption), a.unit)


def _files(a: Analysis) -> dict[str, str]:
    """All lines, and the spectra."""
    centre, rms = a.density.third_octaves()
    unit = ENDINGS[a.unit]
    tables = {
        "spectrum": {
            "frequency_hz": a.spectrum.frequency,
            f"amplitude_{unit}": a.spectrum.amplitude,
        },
        "density": {
            "frequency_hz": a.density.frequency,
            f"density_{unit}_squared_per_hz": a.density.density,
            f"cumulative_rms_{unit}": a.density.cumulative_rms,
        },
        "third_octaves": {"centre_hz": centre, f"rms_{unit}": rms},
    }
    lines = {} if a.table is None else {"lines.csv": _lines_file(a.table)}
    return lines | {f"{name}.csv": columns_csv(columns) for name, columns in tables.items()}


def _lines_file(table: LineTable) -> str:
    """All lines as CSV text, its header in the table's unit."""
    header, rest = lines_csv(table).split("\n", 1)
    keys = [key_in_unit(key, table.unit) for key in header.split(",")]
    return "\n".join([",".join(keys), rest])


def _facts(a: Analysis) -> Iterator[Fact]:
    amplitude = measure_in_unit(TORQUE, a.unit)
    for line in _largest(a)[:2]:
        where = f"{line.name} at {FREQUENCY.figure(line.frequency)}"
        yield Fact(amplitude.figure(line.amplitude), where)
    yield Fact(amplitude.figure(_rms(a)), "RMS about the mean")
    if a.clock_ratio is not None:
        yield Fact(f"{a.clock_ratio:.6f}", "step clock over nominal")


def _rms(a: Analysis) -> float:
    return float(a.recording[a.channel].std())


def _largest(a: Analysis) -> list[Line]:
    seen = [line for line in a.table or () if line.seen and math.isfinite(line.amplitude)]
    return sorted(seen, key=lambda line: -line.amplitude)[:_MAX_NAMED]
