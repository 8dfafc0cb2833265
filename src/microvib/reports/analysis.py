"""An analysis for those who read it: lines with uncertainties, spectra, bands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from microvib.io.runs import lines_csv
from microvib.io.tables import columns_csv
from microvib.reports import figures
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.typography import file_name
from microvib.results import (
    FREQUENCY,
    TORQUE,
    TORQUE_UNCERTAINTY,
    Column,
    Measure,
    Table,
)
from microvib.signals.line_table import Line
from microvib.studies.analyse import Analysis
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
    "origin",
    "status",
)
"""Keys of what is shown of a line."""


@dataclass(frozen=True)
class BandRms:
    """RMS of a band."""

    band: Annotated[str, Column("band", "band")]
    rms: Annotated[float, Column("rms", "RMS", TORQUE)]


def analysis_outcome(a: Analysis) -> Outcome:
    """An analysis for those who read it: lines with uncertainties, amplitude spectrum, density,
    waterfall, RMS in bands.
    """
    reach = figures.spectrum_upper_end(_largest(a))

    def picture(name: str, made: figures.Spectral, height: float, title: str) -> tuple[Item, ...]:
        """How a spectrum was made, and its picture."""

        def draw() -> Figure:
            return figures.draw_spectral(made, pretty(a.unit), reach, height, a.table)

        text = str(made)
        return (Text(f"{text[:1].upper()}{text[1:]}."), Picture(name, draw, title))

    spectrum = picture("spectrum", a.spectrum, 4.4, "Amplitude spectrum")
    density = picture("density", a.density, 2.7, "Power spectral density")
    return Outcome(
        "Analysis report",
        f"Analysis of {file_name(a.name)}, channel {a.channel}",
        f"Lines with uncertainties and spectra of a {'torque' if a.unit == 'N*m' else 'force'}.",
        "",
        tuple(_facts(a)),
        (
            Part("", (Pairs(tuple(_about(a))), *spectrum)),
            Part("Lines", _lines(a), new_page=True),
            Part("Power spectral density", density),
            Part("Waterfall", picture("waterfall", a.waterfall, 2.9, "Waterfall")),
            Part("RMS in bands", (_bands(a),)),
        ),
        other_files=_files(a),
    )


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
    for note in a.recording.notes_on(a.channel):
        if note:
            yield "Note", note


def _lines(a: Analysis) -> tuple[Table, ...]:
    if a.table is None:
        return ()
    found = Table.of("", Line, a.table.notable(), caption=_LINES_CAPTION)
    return (_in_unit(found.only(_LINE_COLUMNS), a.unit),)


_LINES_CAPTION = (
    "Amplitudes 0-to-peak, independent of the bins; ± is one standard uncertainty from the floor"
    " about the line."
)


def _in_unit(table: Table, unit: str) -> Table:
    """A table of torques as one of forces, where the channel is one."""
    columns = [
        replace(x, measure=_measure(x.measure, unit))
        if x.measure in (TORQUE, TORQUE_UNCERTAINTY)
        else x
        for x in table.columns
    ]
    return replace(table, columns=tuple(columns))


def _measure(torque: Measure, unit: str) -> Measure:
    return replace(torque, unit=f"m{pretty(unit)}")


def _bands(a: Analysis) -> Table:
    bands = [BandRms(f"{low:g} to {high:g} Hz", rms) for low, high, rms in a.bands]
    bands.append(BandRms("whole record, about its mean", _rms(a)))
    caption = "RMS in 1/3-octave bands is in `third_octaves.csv`."
    return _in_unit(Table.of("", BandRms, bands, caption=caption), a.unit)


def _files(a: Analysis) -> dict[str, str]:
    """All lines, and the spectra."""
    centre, rms = a.density.third_octaves()
    unit = "n" if a.unit == "N" else "n_m"
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
    lines = {} if a.table is None else {"lines.csv": lines_csv(a.table)}
    return lines | {f"{name}.csv": columns_csv(columns) for name, columns in tables.items()}


def _facts(a: Analysis) -> Iterator[Fact]:
    amplitude = _measure(TORQUE, a.unit)
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
