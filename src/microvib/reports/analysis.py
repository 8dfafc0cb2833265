"""Analysis from command to folder: its text, its tables and its report."""

from __future__ import annotations

from typing import Any

from microvib.io.runs import lines_csv
from microvib.io.tables import columns_csv
from microvib.reports import figures
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import (
    Block,
    Contents,
    Document,
    Fact,
    Figure,
    Section,
    Table,
    Text,
    pairs,
    table,
)
from microvib.reports.numbers import brief_number, format_number, milli
from microvib.reports.typography import file_name
from microvib.signals.line_table import Line, LineTable
from microvib.studies.analyse import Analysis
from microvib.text_tables import text_table
from microvib.units import pretty


def analysis_text(a: Analysis) -> str:
    """Lines with their uncertainties, how the spectra were made, RMS and bands."""
    rows = [f"{a.name}, channel {a.channel}"]
    rows += [f"  {note}" for note in a.recording.told(a.channel)]
    if a.table is not None:
        if a.clock_ratio is not None:
            rows.append(
                f"step clock over nominal: {a.clock_ratio:.7f} ±"
                f" {a.table.clock_ratio_uncertainty:.1g}"
            )
        lines = [
            (x.line, brief_number(x.frequency_hz, 8), brief_number(x.frequency_uncertainty_hz, 2), brief_number(x.amplitude_n_m),
             brief_number(x.amplitude_uncertainty_n_m, 2), brief_number(x.floor_n_m, 2), x.status)
            for x in a.table.notable()
        ]  # fmt: skip
        head = ("line", "Hz", "±", "N m", "±", "floor", "status")
        rows += ["", text_table(head, lines, left=1, last_left=True)]
    rows += ["", str(a.spectrum), str(a.density), str(a.waterfall), ""]
    rows.append(f"RMS about the mean: {a.recording[a.channel].std():.4g} {pretty(a.unit)}")
    rows += [
        f"RMS from {low:g} to {high:g} Hz: {rms:.4g} {pretty(a.unit)}" for low, high, rms in a.bands
    ]
    return "\n".join(rows)


def analysis_folder(a: Analysis) -> Contents:
    """Tables and report of an analysis."""
    centre, rms = a.density.third_octaves()
    unit = "n" if a.unit == "N" else "n_m"
    if a.table is None:
        files: dict[str, Any] = {}
    else:
        files = {"lines.csv": lines_csv(a.table)}
    tables = {
        "spectrum": {"frequency_hz": a.spectrum.frequency, f"amplitude_{unit}": a.spectrum.amplitude},
        "density": {"frequency_hz": a.density.frequency, f"density_{unit}_squared_per_hz": a.density.density,
                    f"cumulative_rms_{unit}": a.density.cumulative_rms},
        "third_octaves": {"centre_hz": centre, f"rms_{unit}": rms},
    }  # fmt: skip
    files |= {f"{name}.csv": columns_csv(columns) for name, columns in tables.items()}
    return files, analysis_report(a)


_MAX_FIRST_PAGE = 8


def analysis_report(a: Analysis) -> Document:
    """The report of an analysis: lines with uncertainties, amplitude spectrum, density, waterfall,
    bands.
    """
    reach = figures.spectrum_upper_end(_largest(a))

    def drawing(made: figures.Spectral, height: float, alt: str) -> Figure:
        text = str(made)
        return figure_block(
            figures.draw_spectral(made, pretty(a.unit), reach, height, a.table),
            alt,
            f"{text[:1].upper()}{text[1:]}.",
        )

    spectrum = drawing(a.spectrum, 4.4, "Amplitude spectrum")
    density = drawing(a.density, 2.7, "Power spectral density")
    fall = drawing(a.waterfall, 2.9, "Waterfall")
    if a.table is None:
        lines = []
    else:
        lines = [Section("All lines", _all_lines(a.table), new_page=True)]
    record = f"{a.recording.samples} samples at {a.recording.sample_rate:g} Hz, {a.recording.duration:g} s"
    notes = [("Note", note) for note in a.recording.told(a.channel) if note]
    return study_report(
        "Analysis report",
        f"Analysis of {file_name(a.name)}, channel {a.channel}",
        "Lines with uncertainties and spectra of a " + ("torque." if a.unit == "N*m" else "force."),
        facts=_facts(a),
        first_page=(
            pairs([("Source", file_name(a.name)), ("Record", record), *notes]),
            *_main_lines(a),
            spectrum,
        ),
        sections=(
            *lines,
            Section("Power spectral density", (density,), new_page=not lines),
            Section("Waterfall", (fall,)),
            Section(
                "RMS in bands",
                (_bands(a), Text("RMS in 1/3-octave bands is in `third_octaves.csv`.", note=True)),
            ),
        ),
    )


def _facts(a: Analysis) -> list[Fact]:
    facts = [
        Fact(
            f"{milli(line.amplitude_n_m)} m{pretty(a.unit)}",
            f"{line.line} at {format_number(line.frequency_hz)} Hz",
        )
        for line in _largest(a)[:2]
    ]
    facts.append(
        Fact(
            f"{milli(float(a.recording[a.channel].std()))} m{pretty(a.unit)}", "RMS about the mean"
        )
    )
    if a.clock_ratio is not None:
        facts.append(Fact(f"{a.clock_ratio:.6f}", "step clock over nominal"))
    return facts


def _largest(a: Analysis) -> list[Line]:
    seen = [line for line in a.table or () if line.seen]
    return sorted(seen, key=lambda line: -line.amplitude_n_m)[:_MAX_FIRST_PAGE]


def _main_lines(a: Analysis) -> tuple[Table, ...]:
    if a.table is None:
        return ()
    rows = [
        [
            x.line,
            format_number(x.frequency_hz, 6),
            milli(x.amplitude_n_m),
            _spread(x.amplitude_uncertainty_n_m),
            x.origin,
        ]
        for x in sorted(_largest(a), key=lambda x: x.frequency_hz)
    ]
    header = [
        "line",
        "frequency [Hz]",
        f"amplitude [m{pretty(a.unit)}]",
        f"± [m{pretty(a.unit)}]",
        "what it is",
    ]
    return (
        table(
            header, rows, "The largest lines. Amplitudes 0-to-peak; ± is one standard uncertainty."
        ),
    )


def _all_lines(lines: LineTable) -> tuple[Block, ...]:
    header = ["line", "frequency [Hz]", "± [mHz]", "amplitude [mN m]", "± [mN m]", "floor [mN m]", "what it is",
              "status"]  # fmt: skip
    rows = [
        [x.line, format_number(x.frequency_hz, 7), _spread(x.frequency_uncertainty_hz), milli(x.amplitude_n_m),
         _spread(x.amplitude_uncertainty_n_m), brief_number(1e3 * x.floor_n_m, 2), x.origin, x.status]
        for x in lines.notable()
    ]  # fmt: skip
    text = "Amplitudes 0-to-peak, wherever the bins fall; ± is one standard uncertainty from the floor about the line."
    return Text(text), table(header, rows)


def _spread(value: float) -> str:
    """An uncertainty in thousandths; empty where none could be told."""
    if value > 0.0:
        return brief_number(1e3 * value, 2)
    return ""


def _bands(a: Analysis) -> Table:
    rows = [[f"{low:g} to {high:g} Hz", milli(rms)] for low, high, rms in a.bands]
    rows.append(["whole record, about its mean", milli(float(a.recording[a.channel].std()))])
    return table(["band", f"RMS [m{pretty(a.unit)}]"], rows)
