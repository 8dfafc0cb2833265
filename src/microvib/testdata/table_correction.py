"""Correction of a recording for the dynamics of its force table, up to half of the table's first resonance,
and what is then known of its readings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.model.rigid import COMPONENTS
from microvib.testdata.channels import LOADS
from microvib.testdata.force_table import ForceTable, UnusableBand
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.table_response import (
    MIN_COHERENCE,
    STATIC_ERROR_TOLD,
    USABLE_PART,
    TableResponse,
    TableResponseError,
)
from microvib.units import Quantity

LARGEST_UNCERTAINTY = 0.05
"""Relative standard uncertainty of a response from which readings are not corrected by it."""
SAME_MASS = 0.01
"""Part by which two masses on the table may differ and count as one."""
_TAPER = 1.1
"""Times the highest frequency that is corrected, up to which the correction fades out."""
_SCALLOPING = 1.18
"""Largest amplitude of a tone over what its nearest bin of a Hann window reads."""
_BLOCKS = 2**16
"""Parts of a spectrum in which uncertainties are kept."""


class TableFrf(Part):
    """Frequency response of the table that is taken out of the readings, and the mass that it holds for."""

    file: str | None = Field(
        default=None,
        max_length=1000,
        description="frequency responses, readings over loads: UFF 58, CSV or MATLAB; without it, those of the"
        " resonances of bench",
    )
    mounted_mass: (
        Annotated[float, Quantity("kg", "mass on the table when its response was measured", ge=0)]
        | None
    ) = None
    test_mass: (
        Annotated[float, Quantity("kg", "mass on the table in this recording", ge=0)] | None
    ) = None
    table_mass: (
        Annotated[
            float, Quantity("kg", "mass that moves in its first resonance when it is empty", gt=0)
        ]
        | None
    ) = None
    uncertainty: (
        Annotated[
            float,
            Quantity(
                "", "relative standard uncertainty of the response", ge=0, le=1, display="percent"
            ),
        ]
        | None
    ) = None
    averages: int | None = Field(
        default=None,
        ge=2,
        le=10_000,
        description="averages of the response, where its file has coherences and no uncertainties",
    )
    measured: Any = Field(
        default=None, exclude=True, description="response that the file holds, put here by reading"
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.measured is not None and not isinstance(self.measured, TableResponse):
            yield "measured: is put here by reading; name the file under file"
        if self.file is not None:
            for name in ("mounted_mass", "test_mass"):
                if getattr(self, name) is None:
                    yield (
                        f"{name}: missing, in kg; a response holds for the mass that was on the table"
                        " (0 kg: empty)"
                    )
        elif self.mounted_mass is not None or self.test_mass is not None:
            yield "mounted_mass: goes with file; a modelled response holds for bench.mounted"

    @property
    def shift(self) -> float:
        """Least ratio of a resonance in the recording to that in the response, or the largest where the
        mass on the table was less: sqrt((m + M)/(m + M')), with 0 as m where it is not stated.
        """
        before, now = self.mounted_mass, self.test_mass
        if before is None or now is None or abs(now - before) <= SAME_MASS * max(now, before):
            return 1.0
        m = self.table_mass or 0.0
        if m + before == 0.0:
            return 0.0
        if m + now == 0.0:
            return math.inf
        return math.sqrt((m + before) / (m + now))

    def mass_note(self) -> str:
        """The state that the response holds for, in words; a warning where the recording's is another."""
        if self.file is None:
            return "the response is that of the declared resonances under bench.mounted"
        text = f"the response holds for {self.mounted_mass:g} kg on the table"
        if self.shift == 1.0:
            return text
        text += f", and {self.test_mass:g} kg were on it in the recording"
        if self.table_mass is None:
            return (
                f"WARNING: {text}: its resonances may lie anywhere from {self.shift:.3g} times theirs on,"
                " since table_mass is not stated; this is in the uncertainties"
            )
        return (
            f"WARNING: {text}: its resonances lie at {self.shift:.3g} times theirs; this is in the"
            " uncertainties, and nothing is shifted"
        )


@dataclass(frozen=True, eq=False)
class CorrectedTable(ForceTable):
    """A table whose dynamics were taken out of the readings, where its response is known."""

    corrected = True

    bands: Mapping[str, tuple[UnusableBand, ...]] = field(default_factory=dict)
    """Frequencies at which the reading of a component of the table was not corrected, ascending."""
    frequency: np.ndarray = field(default_factory=lambda: np.zeros(1))
    """Lower ends [Hz] of the parts of the spectrum in which uncertainties are kept, (m,)."""
    relative: np.ndarray = field(default_factory=lambda: np.zeros((6, 1)))
    """Relative standard uncertainty of each component of the table, (6, m)."""
    absolute: np.ndarray = field(default_factory=lambda: np.zeros((6, 1)))
    """Standard uncertainty of each channel by the response, (6, m) [N, N m]."""
    said: Mapping[str, str] = field(default_factory=dict)
    """Notes on what was done to each component, a sentence without a stop."""
    alone: bool = True
    """Whether each channel still is one component of the table, as relative uncertainties have it."""

    def departure(self, channel: str, frequency: np.ndarray) -> np.ndarray:
        """Relative standard uncertainty of a channel by the table's response at each ``frequency`` (m,)
        [Hz], (m,).
        """
        rows = [COMPONENTS.index(one) for one in self.made_of.get(channel, ())]
        there = self._part(np.asarray(frequency, dtype=float))
        return np.asarray(np.max(self.relative[rows][:, there], axis=0, initial=0.0))

    def _part(self, frequency: np.ndarray) -> np.ndarray:
        k = np.searchsorted(self.frequency, frequency, side="right") - 1
        return np.clip(k, 0, self.frequency.size - 1)

    def amplitude_uncertainty(self, channel: str, frequency: float, amplitude: float) -> float:
        """Standard uncertainty of a line's ``amplitude`` by the table's response."""
        if channel not in self.made_of:
            return 0.0
        relative = float(self.departure(channel, np.array([frequency]))[0]) * amplitude
        if self.alone:
            return relative
        k = int(self._part(np.array([frequency]))[0])
        own = self.absolute[COMPONENTS.index(channel), max(k - 1, 0) : k + 2]
        return _SCALLOPING * float(np.max(own))

    def phase_uncertainty(self, channel: str, frequency: float, amplitude: float) -> float:
        """Standard uncertainty [rad] of a line's phase by the table's response."""
        if not amplitude > 0.0:
            return math.pi
        return min(self.amplitude_uncertainty(channel, frequency, amplitude) / amplitude, math.pi)

    def objection(self, channel: str, frequency: float) -> str:
        """Why a line at a ``frequency`` [Hz] does not show its load, as a clause; empty where it does."""
        low, high = self.usable
        if not low <= frequency <= high:
            return super().objection(channel, frequency)
        for component in self.made_of.get(channel, ()):
            for one in self.bands.get(component, ()):
                if one.low <= frequency <= one.high:
                    return one.why
        return ""

    def _about_resonances(self, channel: str) -> list[UnusableBand]:
        low, high = self.usable
        every = [one for c in self.made_of.get(channel, ()) for one in self.bands.get(c, ())]
        cut = [UnusableBand(max(x.low, low), min(x.high, high), x.why) for x in every]
        return sorted((x for x in cut if x.low < x.high), key=lambda x: (x.low, x.high))

    def notes(self, channel: str) -> Iterator[str]:
        """Sentences without a stop on what was done to a channel."""
        for component in self.made_of.get(channel, ()):
            if component in self.said:
                yield self.said[component]

    def combined(self, A: np.ndarray, large: np.ndarray) -> ForceTable:
        """The table of new components ``A`` (6, 6) times these, of which ``large`` (6, 6) says which
        make a part of which.
        """
        made = super().combined(A, large)
        single = all(np.count_nonzero(row) <= 1 for row in A)
        assert isinstance(made, CorrectedTable)
        return replace(
            made,
            absolute=np.sqrt(np.abs(A) ** 2 @ self.absolute**2),
            alone=self.alone and single,
        )


def without_table_dynamics(
    recording: Recording, response: TableResponse, how: TableFrf
) -> Recording:
    """Six components with the table's dynamics taken out where its ``response`` is known well enough, up
    to half of its first resonance; RecordingError where it cannot be used.

    Readings are divided by the response in the frequency domain, by its inverse matrix where it is
    coupled. Its uncertainty, that of interpolation, and that by another mass on the table go into the
    lines. What lies outside is left as recorded and is not judged.
    """
    try:
        plain, static = response.normalised()
        work = _Work.of(plain, how, static)
    except TableResponseError as error:
        raise RecordingError(f"{recording.title}: table_frf: {error}") from None
    names = [c for c in plain.known if c in recording.channels]
    if plain.coupled and len([c for c in COMPONENTS if c in recording.channels]) < 6:
        raise RecordingError(
            f"{recording.title}: table_frf: its 36 responses need all of {', '.join(COMPONENTS)}; name"
            " them under channels"
        )
    for name in names:
        if recording.units.get(name) not in LOADS or not np.all(np.isfinite(recording[name])):
            raise RecordingError(
                f"{recording.title}: channel {name} is no force or torque, or has samples that are not"
                " numbers; the table's dynamics cannot be taken out"
            )
    channels = dict(recording.channels)
    loads = work.loads({name: recording[name] for name in names}, recording.sample_rate)
    channels.update(loads)
    table = work.table(recording, loads, static)
    notes = [f"table's dynamics taken out by {response.name}: {how.mass_note()}"]
    return recording.looked_at().noted("; ".join(notes), channels=channels, table=table)


@dataclass(frozen=True, eq=False)
class _Work:
    """A response as it is applied: inverse, uncertainties and limits, on its own frequencies."""

    response: TableResponse
    how: TableFrf
    inverse: np.ndarray
    """Loads over readings, (m, 6, 6); nan where not known."""
    relative: np.ndarray
    """Relative uncertainty of each reading over its own load, (m, 6)."""
    others: np.ndarray
    """The part of it that is not the response's own: of interpolation, by another mass, by the
    calibration of hammer or table and by the hammer's filters, (m, 6).
    """
    bands: Mapping[str, tuple[UnusableBand, ...]]
    ends: Mapping[str, tuple[float, float]]
    """Lowest and highest frequency [Hz] that is corrected, by component."""

    @classmethod
    def of(cls, response: TableResponse, how: TableFrf, static: Mapping[str, float]) -> _Work:
        relative, others = _relative_uncertainty(response, how, static)
        if response.coupled:
            _check_coupled(response, how)
            inverse = np.full(response.H.shape, np.nan, dtype=complex)
            good = np.all(np.isfinite(response.H), axis=(1, 2))
            inverse[good] = np.linalg.inv(response.H[good])
        else:
            inverse = np.full(response.H.shape, np.nan, dtype=complex)
            for name in response.known:
                k = COMPONENTS.index(name)
                good = np.isfinite(response.diagonal(name))
                inverse[good, k, k] = 1.0 / response.diagonal(name)[good]
        bands, ends = {}, {}
        for name in COMPONENTS:
            bands[name], ends[name] = _limits(response, how, name, relative)
        return cls(response, how, inverse, relative, others, bands, ends)

    def loads(self, readings: Mapping[str, np.ndarray], rate: float) -> dict[str, np.ndarray]:
        """Loads of which these are the ``readings``, (n,) each."""
        n = next(iter(readings.values())).size if readings else 0
        room = min(n - 1, max(n // 8, 64))
        f = np.fft.rfftfreq(n + 2 * room, 1.0 / rate)
        spectra = {
            name: np.fft.rfft(np.pad(x, room, mode="reflect", reflect_type="odd"))
            for name, x in readings.items()
        }
        found = {}
        for name in readings:
            i = COMPONENTS.index(name)
            total = np.zeros(f.size, dtype=complex)
            for other, X in spectra.items():
                gain = self._gain(i, COMPONENTS.index(other), f)
                if gain is not None:
                    total += gain * X
            found[name] = np.fft.irfft(total, n + 2 * room)[room : room + n]
        return found

    def _gain(self, i: int, j: int, f: np.ndarray) -> np.ndarray | None:
        """Load i over reading j at each frequency, fading to that of a rigid table beyond what is
        corrected; None where nothing comes of it.
        """
        if i != j and not self.response.coupled:
            return None
        x, good = self.inverse[:, i, j], np.isfinite(self.inverse[:, i, j])
        rigid = 1.0 if i == j else 0.0
        low, high = self.ends[COMPONENTS[i]]
        if not low < high < math.inf:
            return np.full(f.size, rigid, dtype=complex)
        known = self.response.frequency[good]
        part = np.interp(f, known, x[good].real) + 1j * np.interp(f, known, x[good].imag)
        fade = np.clip((f - high) / ((_TAPER - 1.0) * high), 0.0, 1.0)
        weight = np.where(f < low, 0.0, 0.5 * (1.0 + np.cos(np.pi * fade)))
        return rigid + weight * (part - rigid)

    def table(
        self, recording: Recording, loads: Mapping[str, np.ndarray], static: Mapping[str, float]
    ) -> CorrectedTable:
        """The table of the corrected readings, with uncertainties and limits."""
        f, size = _amplitudes(loads, recording.sample_rate)
        relative = np.array(
            [
                np.interp(f, self.response.frequency, np.nan_to_num(self.relative[:, k], nan=0.0))
                for k in range(6)
            ]
        )
        relative = np.minimum(relative, 1.0)
        absolute = relative * size
        if self.response.coupled:
            absolute = self._coupled_uncertainty(f, size)
            with np.errstate(divide="ignore", invalid="ignore"):
                relative = np.clip(np.nan_to_num(absolute / size, nan=0.0, posinf=1.0), 0.0, 1.0)
        before = recording.table or ForceTable("the table")
        return CorrectedTable(
            name=before.name,
            usable=before.usable,
            largest_bias=before.largest_bias,
            noise=before.noise,
            noise_corner=before.noise_corner,
            noise_band=before.noise_band,
            made_of=before.made_of,
            bands=self.bands,
            frequency=f,
            relative=relative,
            absolute=absolute,
            said={c: self._sentence(c, static) for c in COMPONENTS},
            alone=not self.response.coupled,
        )

    def _coupled_uncertainty(self, f: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Uncertainties of loads by those of all 36 responses, L = H^-1 R, dL = -H^-1 dH L, (6, m)."""
        response, step = self.response, self.response.frequency
        stated = (self.how.uncertainty or 0.0) * np.abs(response.H)
        spread = np.hypot(np.nan_to_num(response.uncertainty), np.nan_to_num(stated))
        total = np.zeros_like(size)
        for j in range(6):
            reading = np.zeros(f.size)
            for k in range(6):
                reading += (np.interp(f, step, spread[:, j, k]) * size[k]) ** 2
            for i in range(6):
                gain = np.interp(f, step, np.nan_to_num(np.abs(self.inverse[:, i, j])))
                total[i] += gain**2 * reading
        others = np.array([np.interp(f, step, x) for x in np.nan_to_num(self.others.T, posinf=1.0)])
        return np.sqrt(total + (np.minimum(others, 1.0) * size) ** 2)

    def _sentence(self, component: str, static: Mapping[str, float]) -> str:
        low, high = self.ends[component]
        first = (
            self.response.first_resonance(component)
            if component in self.response.known
            else math.nan
        )
        if math.isinf(first):
            return f"{component}: the model has no resonance of it; nothing is to be corrected"
        if not low < high:
            return f"{component}: nothing is corrected, and nothing is judged"
        f = self.response.frequency
        inside = (f >= low) & (f <= high)
        k = COMPONENTS.index(component)
        change = np.abs(self.inverse[inside, k, k]) - 1.0
        largest = float(np.nanmax(np.abs(change), initial=0.0))
        text = (
            f"{component}: corrected from {low:.4g} to {high:.4g} Hz for the table's dynamics, by at most"
            f" {100.0 * largest:.3g} %, with a standard uncertainty of at most"
            f" {100.0 * self._largest_uncertainty(component, inside):.2g} %"
        )
        if math.isnan(first):
            text += f"; no resonance is seen up to {f[-1]:.4g} Hz, of which half is used"
        else:
            text += f"; half of the first resonance, {first:.4g} Hz, is the limit"
        value = static.get(component, 1.0)
        if abs(value - 1.0) > STATIC_ERROR_TOLD:
            text += (
                f"; its value at low frequencies, {value:.4g}, is left out as the hammer's calibration, but"
                " may be the table's own: the difference is in the uncertainty; correct the sensitivity that"
                " is wrong"
            )
        if component not in self.response.resonances:
            text += f"; a resonance narrower than its bins, {np.median(np.diff(f)):.2g} Hz, may not be seen"
        gaps = [x for x in self.bands[component] if x.high < high and x.low > low]
        if gaps:
            text += f"; {len(gaps)} gaps where it is not known well enough"
        return (
            f"{text}; what lies outside is not judged, and as recorded (the correction fades out from"
            f" {high:.4g} to {_TAPER * high:.4g} Hz)"
        )

    def _largest_uncertainty(self, component: str, inside: np.ndarray) -> float:
        own = self.relative[inside, COMPONENTS.index(component)]
        good = own[own <= LARGEST_UNCERTAINTY]
        return float(np.max(good, initial=0.0))


def _amplitudes(loads: Mapping[str, np.ndarray], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the spectrum by their lower ends [Hz], (m,), and the largest amplitude in each, of a Hann
    window, (6, m).
    """
    n = next(iter(loads.values())).size if loads else 2
    bins = n // 2 + 1
    block = -(-bins // _BLOCKS)
    first = np.arange(0, bins, block)
    size = np.zeros((6, first.size))
    w = np.hanning(n)
    for name, x in loads.items():
        amplitude = np.abs(np.fft.rfft((x - x.mean()) * w)) * 2.0 / w.sum()
        size[COMPONENTS.index(name)] = np.maximum.reduceat(amplitude, first)
    return first * rate / n, size


def _relative_uncertainty(
    response: TableResponse, how: TableFrf, static: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Relative standard uncertainty of each reading over its own load, (m, 6), and the part of it that is
    not the response's own: of interpolation between bins, by another mass on the table, by the ``static``
    values, of which nobody knows whether the hammer or the table has them, and by a filter of the hammer.
    """
    total = np.full((response.frequency.size, 6), np.nan)
    others = total.copy()
    for name in response.known:
        k = COMPONENTS.index(name)
        H = response.diagonal(name)
        own = _own_uncertainty(response, how, name)
        by_mass = _by_mass(response.frequency, H, how.shift)
        by_calibration = 1.0 / static.get(name, 1.0) - 1.0
        by_chain = response.chain_error(name)
        parts = (_between_bins(H) / np.abs(H), by_mass, np.full(H.size, by_calibration), by_chain)
        others[:, k] = np.sqrt(np.sum(np.square(parts), axis=0))
        total[:, k] = np.sqrt(own**2 + (how.uncertainty or 0.0) ** 2 + others[:, k] ** 2)
    return total, others


def _check_coupled(response: TableResponse, how: TableFrf) -> None:
    """TableResponseError where one of 36 responses has no uncertainty."""
    known = np.any(np.isfinite(response.uncertainty), axis=0)
    if how.uncertainty is None and not np.all(known):
        j, k = (int(x) for x in np.argwhere(~known)[0])
        raise TableResponseError(
            f"{response.name}: {COMPONENTS[j]} over {COMPONENTS[k]} comes without uncertainties; state"
            " table_frf.uncertainty, such as 1 percent"
        )


def _own_uncertainty(response: TableResponse, how: TableFrf, name: str) -> np.ndarray:
    """Relative standard uncertainty that a response comes with, or by its coherence, (m,): of H1 over n
    averages sqrt((1 - c)/(2 (n - 1) c)); 0 where a stated one stands for it.
    """
    k, H = COMPONENTS.index(name), response.diagonal(name)
    own = response.uncertainty[:, k, k] / np.abs(H)
    coherence = response.coherence[:, k]
    if np.any(np.isfinite(own)):
        return np.asarray(own)
    if how.averages is not None and np.any(np.isfinite(coherence)):
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.sqrt((1.0 - coherence) / (2.0 * (how.averages - 1) * coherence))
    if how.uncertainty is None:
        raise TableResponseError(
            f"{response.name}: {name} comes without uncertainties; state table_frf.uncertainty, such as 1"
            " percent, or table_frf.averages where the file has coherences"
        )
    return np.where(np.isfinite(H), 0.0, np.nan)


def _between_bins(H: np.ndarray) -> np.ndarray:
    """Error of linear interpolation, an eighth of the second difference, (m,)."""
    bend = np.zeros(H.size)
    bend[1:-1] = np.abs(H[:-2] - 2.0 * H[1:-1] + H[2:]) / 8.0
    return np.nan_to_num(bend)


def _by_mass(f: np.ndarray, H: np.ndarray, shift: float) -> np.ndarray:
    """Part by which the response changes if its frequencies are ``shift`` times as high, (m,)."""
    if shift == 1.0:
        return np.zeros(f.size)
    good = np.isfinite(H)
    if not 0.0 < shift < math.inf:
        return np.where(f > 0.0, np.inf, 0.0)
    at = f / shift
    moved = np.interp(at, f[good], H[good].real, right=np.inf) + 1j * np.interp(
        at, f[good], H[good].imag, right=0.0
    )
    return np.nan_to_num(np.abs(moved / H - 1.0), nan=np.inf, posinf=np.inf)


def _limits(
    response: TableResponse, how: TableFrf, name: str, relative: np.ndarray
) -> tuple[tuple[UnusableBand, ...], tuple[float, float]]:
    """Where the reading of a component is not corrected, and between which frequencies [Hz] it is."""
    if name not in response.known:
        why = f"{response.name} has no response of {name}, by which it could be corrected"
        return (UnusableBand(0.0, math.inf, why),), (0.0, 0.0)
    first = response.first_resonance(name)
    if math.isinf(first):
        return (), (0.0, math.inf)
    f, k = response.frequency, COMPONENTS.index(name)
    low = float(f[np.isfinite(response.diagonal(name))][0])
    high = response.highest(name)
    if not math.isnan(first) and how.shift < 1.0:
        high = min(high, USABLE_PART * first * how.shift)
    found = []
    if low > 0.0:
        found.append(UnusableBand(0.0, low, f"{response.name} begins at {low:.4g} Hz"))
    if low < high:
        found += _gaps(response, name, relative[:, k], (low, high))
    found.append(UnusableBand(max(high, low), math.inf, _beyond(response, name, high)))
    return tuple(found), (low, high)


def _beyond(response: TableResponse, name: str, high: float) -> str:
    first = response.first_resonance(name)
    if math.isnan(first):
        return (
            f"it is above {high:.4g} Hz, half of what {response.name} covers of {name}, in which no"
            " resonance is seen"
        )
    return (
        f"it is above {high:.4g} Hz, up to which {name} is corrected: half of the table's first"
        f" resonance, {first:.4g} Hz, under the mass in the recording"
    )


def _gaps(
    response: TableResponse, name: str, relative: np.ndarray, ends: tuple[float, float]
) -> Iterator[UnusableBand]:
    """Frequencies between two ends at which a response is not known well enough; each bin stands for
    what lies up to its neighbours.
    """
    f, k = response.frequency, COMPONENTS.index(name)
    with np.errstate(invalid="ignore"):
        incoherent = response.coherence[:, k] < MIN_COHERENCE
        unsure = ~(relative <= LARGEST_UNCERTAINTY)
    bad = (incoherent | unsure) & (f >= ends[0]) & (f <= ends[1])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(np.int8), [0]])))
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        low, high = float(f[max(a - 1, 0)]), float(f[min(b, f.size - 1)])
        if np.any(incoherent[a:b]):
            least = float(np.nanmin(response.coherence[a:b, k]))
            why = f"the coherence of {response.name} is {least:.2f} there, below {MIN_COHERENCE:g}"
        else:
            most = 100.0 * float(np.nanmax(relative[a:b]))
            why = (
                f"the uncertainty of {response.name} is {most:.2g} % there, above"
                f" {100.0 * LARGEST_UNCERTAINTY:g} %"
            )
        yield UnusableBand(low, high, why)
