"""The force table that made a recording: how its resonances change what it reads, in which band it
is usable, and the noise of its channels, also after torques were moved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np

from microvib.model.rigid import COMPONENTS
from microvib.testdata.bench_parts import Resonance, band_power, table_response

LARGEST_BIAS = 0.05
"""Part by which readings may differ from loads in a band that nobody declared."""
_TOLD_CORRELATION = 0.05
"""Correlation of the noise of two channels from which it is told."""
_TOLD_RISE = 1.1
"""Times the declared noise of a channel before, from which its rise is told."""


class UnusableBand(NamedTuple):
    """Frequencies [Hz] at which a channel does not show its load, and why."""

    low: float
    high: float
    why: str
    cause: Literal["table", "chain", "trend", "scale"] = "table"
    """Force table, measuring chain, a polynomial that was removed, or a scale that may be missing."""


@dataclass(frozen=True, eq=False)
class ForceTable:
    """A table as its readings have it. Torques that were moved are made of several components, of
    which each has resonances of its own.
    """

    corrected = False
    """Whether the table's dynamics were taken out of the readings."""

    name: str
    resonances: tuple[Resonance, ...] = ()
    """Under the mass on the table."""
    usable: tuple[float, float] = (0.0, math.inf)
    """Ends [Hz] of the band in which it is used, as declared."""
    largest_bias: float = LARGEST_BIAS
    """Part by which a reading may differ from its load in a usable band."""
    noise: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    """Spectral densities and cross densities of the channels' noise above ``noise_corner``, (6, 6)
    [N^2/Hz, N^2 m/Hz, N^2 m^2/Hz]."""
    noise_corner: float = 0.0
    """Frequency [Hz] below which the power grows with 1/f."""
    noise_band: tuple[float, float] = (0.0, 500.0)
    """Band [Hz] of the RMS values that are told."""
    made_of: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: {name: (name,) for name in COMPONENTS}
    )
    """Components of the table that a channel is made of."""

    def responses(self, channel: str, frequency: np.ndarray) -> np.ndarray:
        """Reading over load at each ``frequency`` (m,) [Hz] of the components that a channel is made of,
        (k, m), complex.
        """
        s = 2j * math.pi * np.asarray(frequency, dtype=float)
        rows = []
        for component in self.made_of.get(channel, ()):
            H = np.ones(s.shape, dtype=complex)
            for one in self.resonances:
                if one.component == component:
                    H = H * table_response(s, 2.0 * math.pi * one.frequency, one)
            rows.append(H)
        return np.array(rows).reshape(len(rows), *s.shape)

    def departure(self, channel: str, frequency: np.ndarray) -> np.ndarray:
        """Size of reading over load less one at each ``frequency`` (m,) [Hz], amplitude and phase
        together, (m,): of the component that is furthest off.
        """
        H = self.responses(channel, frequency)
        return np.asarray(np.max(np.abs(H - 1.0), axis=0, initial=0.0))

    def amplitude_ratio(self, channel: str, frequency: float) -> float:
        """Amplitude of reading over load at a ``frequency`` [Hz] of the component that is furthest
        off; 1 without resonances.
        """
        H = self.responses(channel, np.array([frequency]))
        if H.size == 0:
            return 1.0
        return float(np.abs(H[np.argmax(np.abs(H - 1.0)), 0]))

    def lag(self, channel: str, frequency: float) -> float:
        """Largest angle [rad] by which a reading is off its load's phase at a ``frequency`` [Hz]."""
        H = self.responses(channel, np.array([frequency]))
        return float(np.max(np.abs(np.angle(H)), initial=0.0))

    def amplitude_uncertainty(self, channel: str, frequency: float, amplitude: float) -> float:
        """Part of a line's ``amplitude`` that the table's resonances change, as a standard uncertainty."""
        return abs(self.amplitude_ratio(channel, frequency) - 1.0) * amplitude

    def phase_uncertainty(self, channel: str, frequency: float, amplitude: float) -> float:
        """Angle [rad] by which the table's resonances turn a line, as a standard uncertainty."""
        return self.lag(channel, frequency)

    def objection(self, channel: str, frequency: float) -> str:
        """Why a line at a ``frequency`` [Hz] does not show its load, as a clause; empty where it does."""
        low, high = self.usable
        if not low <= frequency <= high:
            return f"it lies beyond the usable band of {self.name}, {_band_text(low, high)}"
        if float(self.departure(channel, np.array([frequency]))[0]) <= self.largest_bias:
            return ""
        nearest = self._nearest_resonance(channel, frequency)
        return (
            f"the table's resonance of {nearest.component} at {nearest.frequency:.4g} Hz makes the"
            f" reading {self.amplitude_ratio(channel, frequency):.3g} times the load"
        )

    def _nearest_resonance(self, channel: str, frequency: float) -> Resonance:
        own = [one for one in self.resonances if one.component in self.made_of[channel]]
        return min(own, key=lambda one: abs(math.log(one.frequency / frequency)))

    def unusable(self, channel: str) -> tuple[UnusableBand, ...]:
        """Frequencies at which a channel does not show its load: ends of the usable band, and about
        resonances, ascending.
        """
        low, high = self.usable
        found = []
        if low > 0.0:
            found.append(UnusableBand(0.0, low, self.objection(channel, 0.5 * low)))
        found += self._about_resonances(channel)
        if math.isfinite(high):
            found.append(UnusableBand(high, math.inf, self.objection(channel, 2.0 * high)))
        return tuple(found)

    def _about_resonances(self, channel: str) -> list[UnusableBand]:
        """Bands within the usable one in which readings differ too much from loads."""
        from scipy.optimize import brentq

        own = [one for one in self.resonances if one.component in self.made_of.get(channel, ())]
        if not own:
            return []

        def beyond(f: float) -> float:
            return float(self.departure(channel, np.array([f]))[0]) - self.largest_bias

        low, high = self.usable
        f = _grid(own, low, high)
        over = self.departure(channel, f) > self.largest_bias
        ends = [
            float(brentq(beyond, f[k], f[k + 1])) for k in np.flatnonzero(np.diff(over.astype(int)))
        ]
        if over[0]:
            ends.insert(0, low)
        if over[-1]:
            ends.append(high)
        pairs = zip(ends[::2], ends[1::2], strict=True)
        return [UnusableBand(a, b, self._reason(channel, a, b)) for a, b in pairs]

    def _reason(self, channel: str, low: float, high: float) -> str:
        own = [one for one in self.resonances if one.component in self.made_of[channel]]
        inside = [one for one in own if low <= one.frequency <= high] or own
        told = ", ".join(f"{one.component} at {one.frequency:.4g} Hz" for one in inside)
        return (
            f"the table's resonance ({told}) makes readings differ from loads by more than"
            f" {100.0 * self.largest_bias:.3g} %"
        )

    def notes(self, channel: str) -> Iterator[str]:
        """Sentences without a stop on what the table does to a channel."""
        if channel not in self.made_of:
            return
        low, high = self.usable
        bands = self._about_resonances(channel)
        if not bands and low == 0.0 and math.isinf(high):
            return
        if (low, high) == (0.0, math.inf):
            text = f"{self.name}: no usable band is declared"
        else:
            text = f"{self.name}: usable {_band_text(low, high)} as declared"
        for one in bands:
            text += f"; {_band_text(one.low, one.high)} {one.why}"
        inside = self._largest_bias_within(channel, bands)
        if inside:
            where = "elsewhere" if bands else "there"
            text += f"; {where} its resonances change {channel} by at most {inside}"
        yield f"{text}; what lies outside is not judged, and nothing is corrected"

    def _largest_bias_within(self, channel: str, bands: list[UnusableBand]) -> str:
        """The largest bias where the table is usable, in words; empty where it has no resonance."""
        own = [one for one in self.resonances if one.component in self.made_of[channel]]
        if not own:
            return ""
        f = _grid(own, *self.usable)
        for one in bands:
            f = f[(f < one.low) | (f > one.high)]
        if f.size == 0:
            return ""
        off = self.departure(channel, f)
        k = int(np.argmax(off))
        return f"{100.0 * off[k]:.2g} % (at {f[k]:.4g} Hz)"

    def rms(self, channel: str) -> float:
        """RMS of a channel's declared noise in ``noise_band``; 0 where none is declared."""
        k = COMPONENTS.index(channel)
        return math.sqrt(self.noise[k, k] * band_power(*self._told_band(), self.noise_corner))

    def _told_band(self) -> tuple[float, float]:
        low, high = self.noise_band
        if self.noise_corner > 0.0:
            low = max(low, min(1.0, 0.5 * high))
        return low, high

    def combined(self, A: np.ndarray, large: np.ndarray) -> ForceTable:
        """The table of new components ``A`` (6, 6) times these, of which ``large`` (6, 6) says which
        make a part of which.
        """
        made_of = {
            name: tuple(
                dict.fromkeys(
                    component
                    for j in np.flatnonzero(large[i]).tolist()
                    for component in self.made_of[COMPONENTS[j]]
                )
            )
            for i, name in enumerate(COMPONENTS)
        }
        return replace(self, noise=A @ self.noise @ A.T, made_of=made_of)

    def renamed(self, names: Mapping[str, str]) -> ForceTable:
        """The table of channels under other names, ``{new: old}`` or ``{new: "-old"}``."""
        A = np.zeros((6, 6))
        for new, old in names.items():
            if new in COMPONENTS and old.lstrip("-") in COMPONENTS:
                sign = -1.0 if old.startswith("-") else 1.0
                A[COMPONENTS.index(new), COMPONENTS.index(old.lstrip("-"))] = sign
        return self.combined(A, A != 0.0)

    def raised_noise(self, A: np.ndarray) -> Iterator[str]:
        """Clauses on the declared noise of channels that is larger in new components, ``A`` (6, 6)
        times these, and on the noise of forces that torques then share.
        """
        after = replace(self, noise=A @ self.noise @ A.T)
        band = _band_text(*self._told_band())
        for name in COMPONENTS:
            low, high = self.rms(name), after.rms(name)
            if high > _TOLD_RISE * low > 0.0:
                yield (
                    f"the declared noise of {name} rises from {_in_milli(low, name)} to"
                    f" {_in_milli(high, name)} RMS {band}, {high / low:.3g} times"
                )
        size = np.sqrt(np.diag(after.noise))
        for i, j in combinations(range(3, 6), 2):
            product = size[i] * size[j]
            if product > 0.0 and abs(after.noise[i, j]) > _TOLD_CORRELATION * product:
                parts = np.abs(A[i, :3] * A[j, :3] * np.diag(self.noise)[:3])
                yield (
                    f"{COMPONENTS[i]} and {COMPONENTS[j]} then share noise of"
                    f" {COMPONENTS[int(np.argmax(parts))]} (correlation"
                    f" {after.noise[i, j] / product:.2f})"
                )


def _grid(resonances: list[Resonance], low: float, high: float) -> np.ndarray:
    """Frequencies [Hz] between two, dense about resonances, (m,) ascending."""
    top = 20.0 * max(one.frequency for one in resonances)
    bottom = 1e-3 * min(one.frequency for one in resonances)
    first, last = max(low, bottom), min(high, top)
    if not first < last:
        return np.array([first, first * (1.0 + 1e-9)])
    offsets = np.concatenate([-np.geomspace(0.9, 1e-6, 200), [0.0], np.geomspace(1e-6, 9.0, 200)])
    about = np.concatenate([one.frequency * (1.0 + offsets) for one in resonances])
    every = np.concatenate([np.geomspace(first, last, 2000), about])
    return np.unique(every[(every >= first) & (every <= last)])


def _band_text(low: float, high: float) -> str:
    if math.isinf(high):
        return f"from {low:.4g} Hz up"
    return f"from {low:.4g} to {high:.4g} Hz"


def _in_milli(value: float, component: str) -> str:
    if component.startswith("F"):
        return f"{1e3 * value:.3g} mN"
    return f"{1e3 * value:.3g} mN m"
