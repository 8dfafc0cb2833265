"""Response of a measuring chain: what it does to a load at each frequency, and its removal from a
recording.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from microvib.model.part import Part
from microvib.testdata.channels import LOADS
from microvib.testdata.force_table import UnusableBand
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import Quantity

MIN_RESPONSE = (
    0.25  # magnitude from which a response is taken out: below, noise would grow more than fourfold
)


class Stage(Part):
    """One stage of a chain, linear and the same for all channels."""

    kind: Literal["boxcar", "butterworth", "bessel", "table", "flat"] = Field(
        description="boxcar: samples are means over an interval; butterworth, bessel: analog filter; table: as calibrated;"
        " flat: passes all alike"
    )
    length: (
        Annotated[
            float, Quantity("s", "interval of a boxcar; without it, that of the samples", gt=0)
        ]
        | None
    ) = None
    order: int | None = Field(default=None, ge=1, le=16, description="order of a filter")
    corner: (
        Annotated[
            float,
            Quantity("Hz", "frequency at which a filter passes 0.707 of a load's amplitude", gt=0),
        ]
        | None
    ) = None
    passes: Literal["low", "high"] = Field(
        default="low", description="side of its corner that a filter passes"
    )
    file: str | None = Field(
        default=None,
        max_length=1000,
        description="CSV table with frequency_hz, magnitude and, if known, phase_deg",
    )
    rows: tuple[tuple[float, float, float], ...] = Field(
        default=(),
        description="rows of the table: frequency [Hz], magnitude, phase [deg]; what file names is put here",
    )

    def _consistency_errors(self) -> Iterator[str]:
        own = {"boxcar": ("length",), "table": ("file",), "flat": ()}.get(
            self.kind, ("order", "corner")
        )
        for name in ("length", "order", "corner", "file"):
            belongs = name in own
            given = getattr(self, name) is not None or (name == "file" and self.rows)
            if given and not belongs:
                yield f"{name}: does not go with {self.kind}"
            if belongs and not given and name != "length":
                yield f"{name}: missing; {self.kind} needs it"
        frequencies = [row[0] for row in self.rows]
        if self.rows and (len(self.rows) < 2 or any(a >= b for a, b in pairwise(frequencies))):
            yield "rows: at least two frequencies, rising, are expected"

    def at(self, frequency: np.ndarray, sample_rate: float) -> np.ndarray:
        """Complex response at each ``frequency`` [Hz], (m,); nan beyond the ends of a table."""
        if self.kind == "boxcar":
            return np.sinc(frequency * (self.length or 1.0 / sample_rate)).astype(complex)
        if self.kind == "flat":
            return np.ones(np.shape(frequency), dtype=complex)
        if self.kind == "table":
            f, magnitude, phase = np.array(self.rows).T
            turned = np.unwrap(np.deg2rad(phase))
            inside = (frequency >= f[0]) & (frequency <= f[-1])
            H = np.interp(frequency, f, magnitude) * np.exp(1j * np.interp(frequency, f, turned))
            return np.where(inside, H, np.nan)
        from scipy import signal

        w = 2.0 * np.pi * float(self.corner or 0.0)
        if self.kind == "bessel":
            zpk = signal.bessel(self.order, w, self.passes, analog=True, output="zpk", norm="mag")
        else:
            zpk = signal.butter(self.order, w, self.passes, analog=True, output="zpk")
        return signal.freqs_zpk(*zpk, worN=2.0 * np.pi * frequency)[1]

    def __str__(self) -> str:
        if self.kind == "boxcar":
            if self.length is None:
                return "boxcar"
            return f"boxcar of {self.length:g} s"
        if self.kind == "flat":
            return "flat"
        if self.kind == "table":
            if self.file is None:
                return "table"
            return f"table {self.file}"
        return f"{self.kind} {self.passes}-pass of order {self.order} at {self.corner:g} Hz"


def _listed(given: Any) -> Any:
    """One stage, or the word boxcar or flat, as a list of stages."""
    if isinstance(given, (list, tuple)):
        stages = given
    else:
        stages = [given]
    return [{"kind": stage} if isinstance(stage, str) else stage for stage in stages]


Chain = Annotated[
    tuple[Stage, ...], BeforeValidator(_listed)
]  # stages that a load passes one after another


def response(chain: tuple[Stage, ...], frequency: np.ndarray, sample_rate: float) -> np.ndarray:
    """Complex response of a whole chain at each ``frequency`` [Hz], (m,); nan where a table does
    not say.
    """
    H = np.ones(np.shape(frequency), dtype=complex)
    for stage in chain:
        H = H * stage.at(np.asarray(frequency, dtype=float), sample_rate)
    return H


def without_response(recording: Recording, chain: tuple[Stage, ...]) -> Recording:
    """Forces and torques ahead of the chain: their spectra over the response, wherever that is at
    least ``MIN_RESPONSE``.

    Elsewhere the recording does not show its loads, and says so (``Recording.unusable``).

    The record is continued at both ends as its mirror image turned about the end's value, so that
    no step is filtered. Its first and last samples still depend on what came before and after.
    RecordingError where a channel is not finite, or nothing can be corrected.
    """
    if all(stage.kind == "flat" for stage in chain):
        return recording.noted(
            "measuring chain declared to have a flat response", chain_stated=True
        )
    n = recording.samples
    loads = {
        name: x for name, x in recording.channels.items() if recording.units.get(name) in LOADS
    }
    for name, x in loads.items():
        if not np.all(np.isfinite(x)):
            raise RecordingError(
                f"{recording.title}: channel {name} has samples that are not numbers; its response"
                " cannot be removed"
            )
    room = min(n - 1, max(n // 8, 64))
    f = np.fft.rfftfreq(n + 2 * room, 1.0 / recording.sample_rate)
    H = response(chain, f, recording.sample_rate)
    size = np.nan_to_num(np.abs(H))
    usable = size >= MIN_RESPONSE
    if not np.any(usable[1:]):
        raise RecordingError(
            f"{recording.title}: response: it is below {MIN_RESPONSE:g} at all frequencies of the"
            " recording"
        )
    gain = np.ones(f.size, dtype=complex)
    np.divide(1.0, H, out=gain, where=usable)
    channels = dict(recording.channels)
    for name, x in loads.items():
        longer = np.pad(x, room, mode="reflect", reflect_type="odd")
        channels[name] = np.fft.irfft(np.fft.rfft(longer) * gain, longer.size)[room : room + n]
    low, high = f[usable][[0, -1]]
    lost = tuple(_lost_bands(f, usable))
    beyond = " and not judged" if lost else ""
    factor = float(np.max(np.abs(gain[usable])))
    return recording.looked_at().noted(
        f"response of the measuring chain removed ({', '.join(map(str, chain))}) from {low:.4g} to"
        f" {high:.5g} Hz, where it is at"
        f" least {MIN_RESPONSE:g}; by a factor of at most {factor:.4g}; outside, lines are as"
        f" recorded{beyond}",
        channels=channels,
        lost=(*recording.lost, *lost),
        chain_stated=any(stage.kind != "boxcar" for stage in chain),
    )


def _lost_bands(frequency: np.ndarray, usable: np.ndarray) -> Iterator[UnusableBand]:
    """Frequencies [Hz] about those that are not ``usable`` (m,), up to their neighbours that are."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (~usable).astype(np.int8), [0]])))
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        low = float(frequency[first - 1]) if first else 0.0
        high = float(frequency[end]) if end < frequency.size else math.inf
        if high <= frequency[1]:
            continue  # the mean alone, of which no line is made
        if math.isinf(high):
            where = f"above {low:.4g} Hz"
        else:
            where = f"from {low:.4g} to {high:.4g} Hz"
        why = (
            f"the measuring chain passes less than {MIN_RESPONSE:g} of a load {where}, or is not"
            " known there"
        )
        yield UnusableBand(low, high, why, "chain")
