"""Background of a recording: lines, floor and mains that are there with the drive off, too."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from microvib.analysis import spectra
from microvib.results import LINE_FREQUENCY, TORQUE, Column
from microvib.signals.clock import MAINS, MAINS_BINS
from microvib.signals.line_fit import BACKGROUND_DRIFT, estimate_lines
from microvib.signals.line_table import IN_BACKGROUND, LineTable
from microvib.signals.spectrum import Density, tone_amplitude
from microvib.signals.tones import HannSpectrum
from microvib.testdata.recording import Recording
from microvib.units import Si

MOST_HARMONICS = 20
"""Multiples of the mains' frequency that are marked."""
_MOST_NAMED = 6
_HALF = 0.5
"""Part of a band's power from which the background makes it."""


def background_notes(
    recording: Recording, background: Recording | None, channel: str, table: LineTable | None = None
) -> Iterator[str]:
    """Sentences without a stop on what of a recording's channel is in the background: lines, bands of the
    floor, and all of it.
    """
    if background is None or channel not in background.channels:
        return
    mine, its = (float(np.std(x[channel])) for x in (recording, background))
    if its >= mine > 0.0:
        yield (
            f"the background is as loud as the recording ({its:.3g} and {mine:.3g}"
            f" {recording.units.get(channel, '')} RMS): little of it is the drive's"
        )
    if table is not None:
        yield from _line_notes(table)
    bands = [f"{low:.3g} to {high:.3g} Hz" for low, high in _bands(recording, background, channel)]
    if bands:
        yield f"the background makes half or more of the power at {', '.join(bands)}"


def _line_notes(table: LineTable) -> Iterator[str]:
    there = [x for x in table if x.status == IN_BACKGROUND]
    if not there:
        return
    by_size = sorted(there, key=lambda x: -x.amplitude)
    names = ", ".join(x.name for x in by_size[:_MOST_NAMED])
    more = f" and {len(there) - _MOST_NAMED} more" if len(there) > _MOST_NAMED else ""
    yield (
        f"{names}{more}: at least half as large with the drive off, and not judged as the drive's"
    )
    clock = [x for x in table if x.of_clock and (x.seen or x.status == IN_BACKGROUND)]
    if clock and 2 * sum(x.status == IN_BACKGROUND for x in clock) >= len(clock):
        yield (
            "half or more of the drive's lines are in the background: was the drive running in it, or is"
            " it louder than the drive?"
        )


def _bands(
    recording: Recording, background: Recording, channel: str
) -> Iterator[tuple[float, float]]:
    """Ranges [Hz] of third octaves in which the background makes half of the power or more."""
    density = spectra.psd(recording, channel)
    its = spectra.psd(background, channel, Si(density.resolution))
    centre, mine = density.third_octaves()
    part = _powers(its, centre) >= math.sqrt(_HALF) * mine
    edges = np.flatnonzero(np.diff(np.concatenate([[0], part.astype(np.int8), [0]])))
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield float(centre[a] * 10**-0.05), float(centre[b - 1] * 10**0.05)


def _powers(density: Density, centre: np.ndarray) -> np.ndarray:
    """RMS in third octaves about each ``centre`` (m,) [Hz]."""
    return np.array([density.band_rms(Si(f * 10**-0.05), Si(f * 10**0.05)) for f in centre])


@dataclass(frozen=True)
class BackgroundLine:
    """A line of the background above its noise floor, and what the recording has there."""

    frequency: Annotated[float, Column("frequency_hz", "frequency", LINE_FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "drive off", TORQUE)]
    recorded: Annotated[float, Column("recorded_n_m", "drive on", TORQUE)]
    """Largest amplitude of the recording there."""
    line: Annotated[str, Column("line", "line of the drive there")]
    mains: Annotated[str, Column("mains", "mains?")]


def lines_of_background(
    recording: Recording, background: Recording | None, channel: str, table: LineTable | None = None
) -> tuple[BackgroundLine, ...]:
    """Lines of a background's channel, the largest first; none without a background."""
    if background is None or channel not in background.channels:
        return ()
    x, rate = background[channel], background.sample_rate
    found = [line for line in estimate_lines(x, rate, ()) if math.isfinite(line.amplitude)]
    mine = HannSpectrum.of(recording[channel] - recording[channel].mean(), rate)
    rows = []
    for line in sorted(found, key=lambda one: -one.amplitude):
        f, off = line.frequency, BACKGROUND_DRIFT * line.frequency
        near = [
            one
            for one in table or ()
            if one.of_clock and abs(one.place - f) < off + BINS_APART / recording.duration
        ]
        rows.append(
            BackgroundLine(
                f,
                line.amplitude,
                tone_amplitude(recording[channel], rate, mine.peak(f - off, f + off)[0]),
                ", ".join(one.name for one in near),
                mains_harmonic(f, background.duration),
            )
        )
    return tuple(rows)


BINS_APART = 2.5
"""Bins of a record within which two lines are not told apart."""


def mains_harmonic(frequency: float, duration: float) -> str:
    """The mains' frequency and multiple that a line [Hz] of a record [s] may be pick-up of, in words; empty
    where none is near.
    """
    for mains in MAINS:
        k = round(frequency / mains) if math.isfinite(frequency) else 0
        if 1 <= k <= MOST_HARMONICS and abs(frequency - k * mains) * duration < MAINS_BINS:
            return f"{k} x {mains:g} Hz"
    return ""
