"""Lines of a motion that repeats: the coefficients of its Fourier series, exact, without window or leakage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.signals.line_search import MAX_OTHERS
from microvib.signals.line_table import FAINT, Line, LineTable, Rest
from microvib.signals.orders import Orders

TRANSIENT = "not in a steady state"
"""Status of an array mode: it rings after a start and decays."""
_LEAST = 1e-6  # amplitude over the largest, below which a line is none


def lines_of_series(
    series: np.ndarray, base: float, microsteps: int, expected: Sequence[ExpectedLine], samples: int, sample_rate: float
) -> LineTable:
    """The ``expected`` lines in the Fourier series ``series`` (n,) [N m], complex, of k ``base`` [Hz], k = 0, 1, ...

    The period has ``microsteps`` microsteps. Rows are those of ``estimate_lines`` on a record of ``samples`` at ``sample_rate``
    [Hz], at whose first sample the phases are; nearest-bin figures are what that record would give.
    """
    amplitudes = np.abs(series)
    top = float(np.max(amplitudes[1:], initial=0.0))
    bins = _Bins(series, base, samples, sample_rate)
    rows, named = [], set()
    for line in expected:
        k = round(line.frequency / base)
        if line.kind == "array mode":
            row = _row(line, math.nan, math.nan, TRANSIENT)
        elif abs(line.frequency - k * base) < 1e-6 * base and k < series.size:
            named.add(k)
            row = _row(line, float(amplitudes[k]), float(np.angle(series[k])), _status(amplitudes[k], top))
        else:
            row = _row(line, 0.0, 0.0, FAINT)
        rows.append(row)
    rows += _others(series, base, microsteps, named, Orders.of(expected, 1.0))
    frequency, amplitude = bins.nearest(np.array([row.expected_hz for row in rows]))
    filled = [
        replace(row, bin_frequency_hz=float(f), bin_amplitude_n_m=float(a))
        for row, f, a in zip(rows, frequency, amplitude, strict=True)
    ]
    listed = {round(row.expected_hz / base) for row in rows}
    left = np.array([k for k in range(1, series.size) if k not in listed], dtype=int)
    return LineTable(tuple(filled), 1.0, 0.0, samples, sample_rate, rest=Rest.of(left * base, amplitudes[left]))


def _status(amplitude: float, top: float) -> str:
    return "ok" if amplitude > _LEAST * top else FAINT


def _row(line: ExpectedLine, amplitude: float, phase: float, status: str) -> Line:
    spread = math.nan if math.isnan(amplitude) else 0.0
    return Line(
        line=line.name,
        kind=line.kind,
        origin=line.origin,
        expected_hz=float(line.frequency),
        frequency_hz=math.nan if math.isnan(amplitude) else float(line.frequency),
        frequency_uncertainty_hz=spread,
        amplitude_n_m=amplitude,
        amplitude_uncertainty_n_m=spread,
        phase_rad=phase,
        phase_uncertainty_rad=spread,
        bin_frequency_hz=math.nan,
        bin_amplitude_n_m=math.nan,
        floor_n_m=spread,
        decay_per_s=spread,
        decay_uncertainty_per_s=spread,
        status=status,
    )


def _others(series: np.ndarray, base: float, microsteps: int, named: set[int], orders: Orders | None) -> list[Line]:
    """Orders without a name, from a hundredth of the largest, the strongest first, as ``estimate_lines`` lists them."""
    amplitudes = np.abs(series)
    amplitudes[[0, *named]] = 0.0
    strong = np.argsort(-amplitudes, kind="stable")[:MAX_OTHERS]
    least = 0.01 * float(np.max(np.abs(series[1:]), initial=0.0))
    lines: list[Line] = []
    for k in (int(k) for k in strong if amplitudes[k] > least):
        origin = orders.name(k * base, 1e-6 * base) if orders else None
        origin = origin or f"{Fraction(k, microsteps)} of the driving frequency"
        line = ExpectedLine(f"other_{len(lines) + 1}", "other", k * base, k * base, k * base, origin)
        lines.append(_row(line, float(amplitudes[k]), float(np.angle(series[k])), "ok"))
    return lines


class _Bins:
    """The paper's estimator on a record of the series: rectangular window, nearest bin, leakage of all lines included."""

    def __init__(self, series: np.ndarray, base: float, samples: int, sample_rate: float) -> None:
        keep = np.abs(series) > _LEAST * np.max(np.abs(series[1:]), initial=0.0)
        keep[0] = False  # bins are of the mean-free record
        self._tones = np.concatenate([series[keep], series[keep].conj()])
        self._frequencies = np.concatenate([np.flatnonzero(keep), -np.flatnonzero(keep)]) * base
        self._samples, self._rate = samples, sample_rate

    def nearest(self, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies [Hz] and amplitudes of the bins nearest to ``frequency`` (m,) [Hz]."""
        n = self._samples
        k = np.minimum(np.round(frequency * n / self._rate), n // 2)
        # Sum of a geometric series for each tone: sin(pi nu n/f_s) / sin(pi nu/f_s), nu its distance from the bin.
        cycles = self._frequencies / self._rate
        distance = np.sin(np.pi * (cycles - k[:, None] / n))
        half = np.exp(1j * np.pi * cycles * (n - 1)) * np.sin(np.pi * cycles * n) * self._tones
        near = np.abs(distance) < 1e-12
        share = np.where(near, 0.0, half / np.where(near, 1.0, distance))
        whole = np.sum(share, axis=1) * np.exp(-1j * np.pi * k * (n - 1) / n) * (-1.0) ** k
        whole += n * np.sum(np.where(near, self._tones, 0.0), axis=1)
        return k * self._rate / n, np.abs(whole) / n
