"""Analysis from command to folder: its text, its tables and its report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from microvib.app import plots
from microvib.app.report import picture
from microvib.app.studies import number, page
from microvib.io.results import columns_csv, lines_csv, write_folder
from microvib.studies.analyse import Analysis

_SHOWN = 200.0
"""Upper end of the pictures [Hz], as the paper's Figure 10."""


def analysis_text(a: Analysis) -> str:
    """Lines with their uncertainties, how the spectra were made, RMS and bands."""
    rows = [f"{a.name}, channel {a.channel}"]
    rows += [f"  {note}" for note in a.recording.notes]
    if a.table is not None:
        if a.clock_ratio is not None:
            rows.append(f"step clock over nominal: {a.clock_ratio:.7f} ± {a.table.clock_ratio_uncertainty:.1g}")
        rows += ["", f"{'line':16s} {'Hz':>12s} {'±':>9s} {'N m':>11s} {'±':>9s} {'floor':>9s}  status"]
        rows += [
            f"{x.line:16s} {number(x.frequency_hz, 8):>12s} {number(x.frequency_uncertainty_hz, 2):>9s}"
            f" {number(x.amplitude_n_m):>11s} {number(x.amplitude_uncertainty_n_m, 2):>9s} {number(x.floor_n_m, 2):>9s}  {x.status}"
            for x in a.table.notable()
        ]
    rows += ["", str(a.spectrum), str(a.density), str(a.waterfall), ""]
    rows.append(f"RMS about the mean: {a.recording[a.channel].std():.4g} {a.unit}")
    rows += [f"RMS from {low:g} to {high:g} Hz: {rms:.4g} {a.unit}" for low, high, rms in a.bands]
    return "\n".join(rows)


def write_analysis(out: Path, a: Analysis, overwrite: bool) -> tuple[str, ...]:
    """Tables and report of an analysis; names of the files."""
    centre, rms = a.density.third_octaves()
    unit = "n" if a.unit == "N" else "n_m"
    files: dict[str, Any] = {} if a.table is None else {"lines.csv": lines_csv(a.table)}
    files |= {
        "spectrum.csv": columns_csv({"frequency_hz": a.spectrum.frequency, f"amplitude_{unit}": a.spectrum.amplitude}),
        "density.csv": columns_csv(
            {
                "frequency_hz": a.density.frequency,
                f"density_{unit}_squared_per_hz": a.density.density,
                f"cumulative_rms_{unit}": a.density.cumulative_rms,
            }
        ),
        "third_octaves.csv": columns_csv({"centre_hz": centre, f"rms_{unit}": rms}),
        "report.html": _report(a),
    }
    write_folder(out, files, overwrite)
    return tuple(files)


def _report(a: Analysis) -> str:
    sections: list[dict[str, Any]] = []
    if a.table is not None:
        header = [
            "line",
            "frequency [Hz]",
            "± [mHz]",
            "amplitude [mN m]",
            "± [mN m]",
            "floor [mN m]",
            "origin",
            "status",
        ]
        rows = [
            [x.line, number(x.frequency_hz, 7), number(1e3 * x.frequency_uncertainty_hz, 2), number(1e3 * x.amplitude_n_m),
             number(1e3 * x.amplitude_uncertainty_n_m, 2), number(1e3 * x.floor_n_m, 2), x.origin, x.status]
            for x in a.table.notable()
        ]  # fmt: skip
        text = (
            "Amplitudes 0-to-peak, wherever the bins fall; ± is one standard uncertainty from the floor about the line."
        )
        sections.append({"title": "Lines", "text": text, "header": header, "rows": rows})
    pictures: tuple[tuple[str, Any, Any], ...] = (
        ("Amplitude spectrum", a.spectrum, lambda ax: plots.draw_amplitudes(ax, a.spectrum, a.unit, _SHOWN, a.table)),
        ("Power spectral density", a.density, lambda ax: plots.draw_density(ax, a.density, a.unit, _SHOWN)),
        ("Waterfall", a.waterfall, lambda ax: plots.draw_waterfall(ax, a.waterfall, a.unit, _SHOWN)),
    )
    sections += [{"title": t, "figure": _figure(draw), "caption": str(made)} for t, made, draw in pictures]
    sections.append(_bands(a))
    x = a.recording[a.channel]
    lead = (
        f"{a.name}, channel {a.channel}: {x.size} samples at {a.recording.sample_rate:g} Hz,"
        f" {a.recording.duration:g} s. " + "; ".join(note for note in a.recording.notes if note)
    )
    return page("Analysis of a torque" if a.unit == "N m" else "Analysis of a force", lead, sections)


def _figure(draw: Any) -> str:
    figure, axes = plots.new_figure(11.0, 4.0)
    draw(axes[0, 0])
    return picture(figure)


def _bands(a: Analysis) -> dict[str, Any]:
    rows = [[f"{low:g} to {high:g} Hz", number(1e3 * rms)] for low, high, rms in a.bands]
    x: np.ndarray = a.recording[a.channel]
    rows.append(["whole record, about its mean", number(1e3 * float(x.std()))])
    return {"title": "Bands", "header": ["band", f"RMS [m{a.unit}]"], "rows": rows,
            "text": "RMS in 1/3-octave bands is in third_octaves.csv."}  # fmt: skip
