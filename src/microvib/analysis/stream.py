"""Lines of a run that is too long to keep in memory, block by block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from microvib.analysis.accuracy import add_error_estimate, error_of_motion, with_integration_error
from microvib.analysis.lines import expected_in, intermittency_cause, simulated_lines
from microvib.model.scenario import Scenario
from microvib.signals.intermittent import LOUDER_THAN_LINES
from microvib.signals.line_table import Line, LineTable, ResidualPeaks
from microvib.solve.integration import Progress, Simulation
from microvib.solve.motion import Invariants, Motion

BLOCK_SAMPLES = 1 << 19
"""Samples of one block: 128 s at 4096 Hz, 4 MB."""
_ROW = 1024
"""Samples of a row of the Fourier sums."""


def lines_of_stream(
    scenario: Scenario, harmonics: int, progress: Progress | None = None
) -> tuple[LineTable, Invariants, dict[str, Any]]:
    """Lines of the disturbance torque, their mean over equal blocks of the record; with one block,
    as ``lines`` does.

    The amplitude is the mean over the blocks; frequency and decay are means weighted with amplitude
    squared over the blocks in which the line is seen; phase and its uncertainty are those of the
    first block, the status that of the loudest. The nearest-bin figure is that of the whole record,
    summed up exactly as it streams by. Unexpected lines are those of the first block, means over
    the blocks that have them; those of other blocks count as what is left, and so do lines that are
    louder in a block than on average, where something changes the drive slowly. The integration's
    error is that of the first block.
    """
    samples, rate = scenario.record.samples, scenario.record.sample_rate
    blocks = max(-(-samples // BLOCK_SAMPLES), 1)
    run = Simulation(scenario, progress=progress, channels=("T_d",))
    tables: list[LineTable] = []
    sums, start = np.zeros(1, dtype=complex), 0
    expected = expected_in(scenario, rate, harmonics)
    for block in _equal_blocks(run, samples // blocks):
        found = simulated_lines(block, rate, scenario, expected)
        tables.append(replace(found, harmonics=harmonics))
        if start == 0:
            begun = block.copy()
            numbers = [round(x.place * samples / rate) for x in tables[0]]
        sums = sums + _bin_sums(block, start, numbers, samples)
        start += block.size
    amplitudes = np.where(
        np.array(numbers) == 0, 0.0, 2.0 * np.abs(sums) / samples
    ).tolist()  # bin 0: mean taken out
    bins = [
        (number * rate / samples, amplitude)
        for number, amplitude in zip(numbers, amplitudes, strict=True)
    ]
    if len(tables) == 1:
        table = tables[0]
    else:
        table = _mean(tables, bins)
        if intermittency_cause(scenario):
            table = _with_loudest_blocks(table, tables)
    t = scenario.record.settle + np.arange(begun.size) / rate
    motion = Motion(scenario, t, {"T_d": begun}, run.invariants, run.solver, run.beginning)
    error = error_of_motion(motion, table)
    table = replace(table, broken=run.invariants.broken)
    return (
        with_integration_error(table, error),
        run.invariants,
        add_error_estimate(run.solver, error) | {"line_blocks": len(tables)},
    )


def _equal_blocks(run: Simulation, size: int) -> Iterator[np.ndarray]:
    """Blocks of ``size`` samples from the stream; a shorter rest joins the last block."""
    kept: list[np.ndarray] = []
    have = 0
    for block in run:
        kept.append(block["T_d"])
        have += block["T_d"].size
        if have >= 2 * size:
            joined = np.concatenate(kept)
            yield joined[:size]
            kept, have = [joined[size:]], have - size
    if have:
        yield np.concatenate(kept)


def _bin_sums(block: np.ndarray, start: int, numbers: list[int], samples: int) -> np.ndarray:
    """Contribution of a block from the sample ``start`` on to the Fourier sums of the whole record, at
    the bins ``numbers``.

    The block is cut into rows of ``_ROW`` samples. Along a row the phase of a bin runs alike in all
    of them, so that the sums over rows are a product of matrices, and each row has a phase of its
    own: exponentials are needed for a row and a column, not for each sample. It is the same sum to
    rounding: 1e-12 of the largest sample, a sample.
    """
    bins = np.array(numbers)
    rows = -(-block.size // _ROW)
    padded = np.zeros((rows, _ROW))
    padded.ravel()[: block.size] = block
    along = _phases(np.arange(_ROW), bins, samples)
    inner = padded @ along.real + 1j * (padded @ along.imag)
    return np.einsum("rk,rk->k", _phases(start + _ROW * np.arange(rows), bins, samples), inner)


def _phases(n: np.ndarray, bins: np.ndarray, samples: int) -> np.ndarray:
    """Phase factors of ``bins`` at the samples ``n``, (n, bins); whole turns are taken out first,
    so that a long record keeps its digits."""
    return np.exp(-2j * np.pi / samples * (np.outer(n, bins) % samples))


def _mean(tables: list[LineTable], bins: list[tuple[float, float]]) -> LineTable:
    """Lines of the first block, with means over all; ``bins`` are frequency and amplitude in the
    nearest bin of the whole record.
    """
    lines = []
    for first, (bin_frequency, bin_amplitude) in zip(tables[0], bins, strict=True):
        in_blocks = [_matching_line(table, first) for table in tables]
        mean = _mean_line([line for line in in_blocks if line is not None])
        lines.append(replace(mean, bin_frequency=bin_frequency, bin_amplitude=bin_amplitude))
    ratios = [t.clock_ratio for t in tables if t.clock_ratio is not None]
    spreads = [t.clock_ratio_uncertainty for t in tables if t.clock_ratio_uncertainty is not None]
    return replace(
        tables[0],
        lines=tuple(lines),
        clock_ratio=float(np.mean(ratios)) if ratios else None,
        clock_ratio_uncertainty=_uncertainty_of_mean(spreads) if spreads else None,
        samples=sum(table.samples for table in tables),
        rest=_rest_of_blocks(tables),
    )


def _with_loudest_blocks(table: LineTable, tables: list[LineTable]) -> LineTable:
    """Lines of all blocks, with peaks of those that are louder in one than on average."""
    rest = table.rest
    if rest is None:
        return table
    frequency, amplitude = [], []
    for line in table:
        in_blocks = (_matching_line(one, line) for one in tables)
        loudest = max((x.amplitude for x in in_blocks if x is not None and x.seen), default=0.0)
        if loudest > LOUDER_THAN_LINES * line.amplitude:
            frequency.append(line.place)
            amplitude.append(loudest)
    if not frequency:
        return table
    peaks = rest.with_peaks(np.array(frequency), np.array(amplitude) / rest.factor)
    return replace(table, rest=peaks)


def _mean_line(blocks: list[Line]) -> Line:
    """One line's mean over the blocks."""
    # A mode that has died away says nothing of its frequency: blocks count by the square of what
    # they show.
    weights = np.array([x.amplitude**2 if x.seen else 0.0 for x in blocks])
    if not np.any(weights > 0.0):
        weights = np.ones(len(blocks))

    hidden = [x for x in blocks if not math.isfinite(x.amplitude)]
    telling = hidden[0] if hidden else blocks[int(np.argmax(weights))]

    def values(name: str) -> list[float]:
        return [getattr(line, name) for line in blocks]

    return replace(
        blocks[0],
        frequency=float(np.average(values("frequency"), weights=weights)),
        decay=float(np.average(values("decay"), weights=weights)),
        amplitude=float(np.average(values("amplitude"))),
        floor=float(np.average(values("floor"))),
        frequency_uncertainty=_uncertainty_of_mean(values("frequency_uncertainty")),
        amplitude_uncertainty=_uncertainty_of_mean(values("amplitude_uncertainty")),
        status=telling.status,
    )


def _rest_of_blocks(tables: list[LineTable]) -> ResidualPeaks:
    """Residual of all blocks that no line of the first block accounts for."""
    left = [table.rest for table in tables if table.rest is not None]
    left += [_unmatched_peaks(table, tables[0]) for table in tables[1:]]
    rest = ResidualPeaks.of(
        np.concatenate([one.frequency for one in left]),
        np.concatenate([one.amplitude for one in left]),
    )
    each = [one.sums_at(rest.frequency) for one in left]
    return replace(
        rest,
        together=np.max(each, axis=0),
        slow=max(one.slow for one in left),
        resolution=max(one.resolution for one in left),
    )


def _matching_line(table: LineTable, line: Line) -> Line | None:
    """That line in another block; an unexpected one is found by its frequency, since its number
    means nothing there.
    """
    if line.kind != "other":
        return table[line.name]
    near = (
        x
        for x in table
        if x.kind == "other" and abs(x.frequency - line.frequency) * table.duration < 1.0
    )
    return next(near, None)


def _unmatched_peaks(table: LineTable, first: LineTable) -> ResidualPeaks:
    """Unexpected lines of a block that the first one does not have."""
    lines = [x for x in table if x.kind == "other" and _matching_line(first, x) is None]
    return ResidualPeaks(
        np.array([x.frequency for x in lines]), np.array([x.amplitude for x in lines])
    )


def _uncertainty_of_mean(spreads: list[float]) -> float:
    """Standard uncertainty of a mean of independent values."""
    return float(np.sqrt(np.sum(np.square(spreads)))) / len(spreads)
