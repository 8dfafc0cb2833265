"""Results about recordings as the page gets them: plain data, SI units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from microvib.analysis.background import mains_harmonic
from microvib.analysis.limits import Judgement
from microvib.reports.analysis import analysis_outcome
from microvib.reports.order_tracking import order_outcome
from microvib.reports.outcome import page_answer
from microvib.results import file_record
from microvib.signals.screen import decimate_spectrum, largest_in_cells
from microvib.studies.analyse import Analysis
from microvib.studies.cut_limits import CutLimits, limit_along
from microvib.studies.track import OrderCut, OrderTracking
from microvib.web.jobs.drawn_limits import drawn_limit

_POINTS = 6000
_MAP = 160, 600
"""Rows and columns of an order map, at most."""


def analysis_result(
    a: Analysis, start: float, bands: list[dict[str, Any]], judged: Judgement | None
) -> dict[str, Any]:
    """Result of one channel from ``start`` [s] on, with the page's drawings: lines, spectrum, density,
    background, bands, limit.
    """
    f, amplitude = decimate_spectrum(a.spectrum.frequency, a.spectrum.amplitude, _POINTS)
    g, density = decimate_spectrum(a.density.frequency, a.density.density, _POINTS)
    return page_answer(analysis_outcome(a, judged, with_spectra_files=False)) | {
        "lines": [] if a.table is None else [file_record(line) for line in a.table],
        "spectrum": {"f": f.tolist(), "amplitude": amplitude.tolist(), "made": str(a.spectrum)},
        "density": {"f": g.tolist(), "psd": density.tolist(), "made": str(a.density)},
        "clock_ratio": a.clock_ratio,
        "channel": a.channel,
        "unit": a.unit,
        "run_channel": a.channel if a.table is None else "T_d",  # what a run has of the same load
        "section": [start, start + a.recording.duration],
        "waterfall": str(a.waterfall),
        "background": a.background is not None,
        "background_lines": [file_record(line) for line in a.background_lines],
        "mains": _mains(a),
        "bands": bands,
        "limit": None if judged is None else drawn_limit(judged),
    }


def _mains(a: Analysis) -> list[dict[str, Any]]:
    """Lines that may be pick-up of the mains, and of which harmonic."""
    marked = [(line, mains_harmonic(line.place, a.recording.duration)) for line in a.table or ()]
    return [
        {"line": line.name, "frequency": line.place, "mains": words}
        for line, words in marked
        if words and line.seen
    ]


def tracking_result(
    found: OrderTracking, against: CutLimits | None, start: float
) -> dict[str, Any]:
    """Result of a sweep from ``start`` [s] on, with the page's drawings: cuts, order map."""
    m = found.order_map
    cells, down, across = largest_in_cells(m.amplitude, *_MAP)
    clock = found.reference.clock
    return page_answer(order_outcome(found, against)) | {
        "channel": found.channel,
        "unit": found.unit,
        "reference": found.reference.name,
        "clock": None if clock is None else [float(x) for x in _ends(clock.correction)],
        "cuts": [_cut(cut, against, start) for cut in found.cuts],
        "limit_curve": _points(against),
        "order_map": {
            "order": m.order[across].tolist(),
            "time": (start + m.time[down]).tolist(),
            "speed": m.speed[down].tolist(),
            "amplitude": rounded_map(cells),
            "made": str(m),
        },
        "waterfall": str(found.waterfall),
    }


def _ends(x: np.ndarray) -> tuple[float, float]:
    return float(np.min(x)), float(np.max(x))


def _points(against: CutLimits | None) -> list[tuple[float, float]]:
    """Points of a limit [Hz] that changes over frequency; none where it is one number, or there is
    none.
    """
    if against is None or against.curve.is_flat:
        return []
    return list(zip(against.curve.frequency, against.curve.amplitude, strict=True))


def _cut(cut: OrderCut, against: CutLimits | None, start: float) -> dict[str, Any]:
    """An order cut, in figures as long as a screen shows."""
    limit = None if against is None else limit_along(cut, against.curve)
    return {
        "label": cut.label,
        "order": None if math.isnan(cut.order) else cut.order,
        "time": _short(start + cut.time),
        "speed": _short(cut.speed),
        "frequency": _short(cut.frequency),
        "amplitude": _short(cut.amplitude),
        "uncertainty": _short(cut.uncertainty),
        "phase": _short(cut.phase),
        "known": cut.known.tolist(),
        "finding": [str(one) for one in cut.finding],
        "limit": limit,
    }


def _short(x: np.ndarray) -> list[float]:
    return [float(f"{value:.6g}") for value in x.tolist()]


def rounded_map(amplitude: np.ndarray) -> list[list[float]]:
    """Amplitudes of a map to four digits, which no colour shows more of."""
    return [[float(f"{value:.4g}") for value in row] for row in amplitude.tolist()]


def spectra_of(analyses: Sequence[Analysis]) -> dict[str, Any]:
    """Spectra of several recordings, to lie over each other."""
    curves = []
    for one in analyses:
        f, y = decimate_spectrum(one.spectrum.frequency, one.spectrum.amplitude, _POINTS)
        curves.append({"name": one.name, "f": _short(f), "amplitude": _short(y)})
    return {"unit": analyses[0].unit, "channel": analyses[0].channel, "spectra": curves}
