"""Frequency response of a force table, readings over loads: measured or modelled, with its uncertainty, and
the frequencies up to which readings can be corrected by it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.rigid import COMPONENTS
from microvib.testdata.bench_parts import Resonance, table_response

USABLE_PART = 0.5
"""Part of the table's first resonance up to which readings are corrected."""
STATIC_PART = 0.3
"""Part of the first resonance up to which the static value of a response is read."""
LARGEST_STATIC_ERROR = 0.2
"""Part by which a response at low frequencies may differ from 1: a hammer's calibration, and no unit."""
_MOST_DAMPED = 0.2
"""Damping ratio that a table's first resonance has at most (assumed)."""
_LARGEST_PHASE = 1.4
"""Phase [rad] up to which a filter is told by it."""
STATIC_ERROR_TOLD = 0.005
"""Part from which a difference is told."""
MIN_COHERENCE = 0.8
"""Coherence below which a response is not used: something else than the hammer made the reading."""
MIN_PROMINENCE_DB = 1.0
"""Height [dB] from which a peak of a response is a resonance."""
_PEAK_SIGNIFICANCE = 10.0
"""Standard uncertainties of a response from which a peak is above the noise: of a thousand bins of noise alone,
highest and lowest are seven apart."""
_NEIGHBOURS = 31
_DECIBELS = 20.0 / math.log(10.0)
_LOUD_UNCERTAINTY = 0.2
"""Relative uncertainty from which a bin says nothing of peaks."""
_MODEL_POINTS = 4000
_FEWEST_POINTS = 8


class TableResponseError(MicrovibError):
    """A response of a force table that cannot be used: says which, and what is wrong with it."""


@dataclass(frozen=True, eq=False)
class TableResponse:
    """Readings over loads of a force table at each frequency.

    Parameters
    ----------
    name : str
        What it is a response of.
    frequency : numpy.ndarray
        Frequencies, (m,) [Hz], ascending.
    H : numpy.ndarray
        Readings Fx Fy Fz Mx My Mz over loads, (m, 6, 6) [SI]; nan where nothing is known.
    uncertainty : numpy.ndarray
        Standard uncertainty of the magnitude of each, (m, 6, 6); nan where it is not known.
    coherence : numpy.ndarray
        Coherence of each reading with its own load, (m, 6); nan where it is not known.
    resonances : mapping of str to float
        First resonances [Hz] by component, where they are known otherwise than by peaks of ``H``.
    """

    name: str
    frequency: np.ndarray
    H: np.ndarray
    uncertainty: np.ndarray
    coherence: np.ndarray
    resonances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        f = self.frequency
        if f.size < _FEWEST_POINTS or not np.all(np.isfinite(f)) or np.any(np.diff(f) <= 0.0):
            raise TableResponseError(
                f"{self.name}: at least {_FEWEST_POINTS} frequencies in rising order are expected"
            )

    @property
    def known(self) -> tuple[str, ...]:
        """Components whose reading over their own load is known."""
        return tuple(
            name for k, name in enumerate(COMPONENTS) if np.any(np.isfinite(self.H[:, k, k]))
        )

    @property
    def coupled(self) -> bool:
        """Whether all 36 responses are known."""
        return bool(np.all(np.any(np.isfinite(self.H), axis=0)))

    def first_resonance(self, component: str) -> float:
        """First resonance [Hz] of a component; of a coupled response that of the whole table. Infinite
        where the model has none, nan where no peak is seen in the response.
        """
        if component in self.resonances:
            return self.resonances[component]
        of = self.known if self.coupled else (component,)
        found = [self._first_peak(COMPONENTS.index(one)) for one in of]
        return min((f for f in found if not math.isnan(f)), default=math.nan)

    def _first_peak(self, k: int) -> float:
        """Frequency [Hz] of the first peak above the noise; nan without one."""
        peaks = resonance_peaks(self.frequency, self.H[:, k, k], self.uncertainty[:, k, k])
        return float(peaks[0, 0]) if peaks.size else math.nan

    def highest(self, component: str) -> float:
        """Frequency [Hz] up to which readings of a component are corrected: half the first resonance, or
        half of what the response covers where it shows none.
        """
        end = float(self.frequency[np.isfinite(self.diagonal(component))][-1])
        first = self.first_resonance(component)
        if math.isnan(first):
            return USABLE_PART * end
        return min(USABLE_PART * first, end)

    def diagonal(self, component: str) -> np.ndarray:
        """Reading of a component over its own load, (m,)."""
        k = COMPONENTS.index(component)
        return np.asarray(self.H[:, k, k])

    def chain_error(self, component: str) -> np.ndarray:
        """Relative error, (m,), that a filter of the hammer's channel may have made: 1 / cos of the phase by which
        readings lead their load, or lag more than a damped table does, less 1; nan where not known.

        A table's readings lag; those over a load that a low-pass has delayed lead. Of all filters with the
        same phase one of first order takes most.
        """
        H, f = self.diagonal(component), self.frequency
        if self.resonances:  # a model has no such channel
            return np.zeros(f.size)
        first = self.first_resonance(component)
        part = f / (f[-1] if math.isnan(first) else first)
        lag = np.arctan2(2.0 * _MOST_DAMPED * part, 1.0 - part**2)
        phase = np.angle(H)
        beyond = np.maximum(np.maximum(phase, -phase - lag), 0.0)
        return np.asarray(1.0 / np.cos(np.minimum(beyond, _LARGEST_PHASE)) - 1.0)

    def normalised(self) -> tuple[TableResponse, dict[str, float]]:
        """The response with 1 as each reading's static value, and the values that were found.

        What a static value differs from 1 is the calibration of the hammer or of the table, which is no
        part of the table's dynamics. TableResponseError where it differs so much that a unit, a sign or a channel
        is wrong, or where it cannot be read.
        """
        H, spread, found = self.H.copy(), self.uncertainty.copy(), {}
        for name in self.known:
            value = self.static_value(name)
            if abs(value - 1.0) > LARGEST_STATIC_ERROR:
                raise TableResponseError(
                    f"{self.name}: {name} is {value:.4g} times its load at low frequencies, where 1 is"
                    f" expected{static_mistake(value)}; check units, sign and channel of the hammer test"
                )
            found[name] = value
            k = COMPONENTS.index(name)
            H[:, k], spread[:, k] = H[:, k] / value, spread[:, k] / value
        return replace(self, H=H, uncertainty=spread), found

    def static_value(self, component: str) -> float:
        """Reading of a component over its own load well below the first resonance; TableResponseError
        where it cannot be seen.
        """
        x, f = self.diagonal(component), self.frequency
        first = self.first_resonance(component)
        if math.isinf(first):
            return 1.0
        whole = f[-1] if math.isnan(first) else first
        unsure = self.coherence[:, COMPONENTS.index(component)] < MIN_COHERENCE
        low = np.isfinite(x) & (f <= STATIC_PART * whole) & ~unsure
        if not np.any(low):
            raise TableResponseError(
                f"{self.name}: {component} has no bin of a coherence of at least {MIN_COHERENCE:g} below"
                f" {STATIC_PART:g} of its first resonance, {whole:.4g} Hz: whether it goes to 1 at low"
                " frequencies cannot be seen; measure it from lower frequencies on"
            )
        rigid = x[low] if math.isnan(first) else x[low] * (1.0 - (f[low] / whole) ** 2)
        return float(np.median(rigid.real))


def resonance_peaks(f: np.ndarray, H: np.ndarray, uncertainty: np.ndarray) -> np.ndarray:
    """Peaks of a response ``H`` (m,) at frequencies ``f`` (m,) that its ``uncertainty`` (m,) does not make:
    frequency [Hz] and prominence [dB], (peaks, 2), ascending.

    The noise is the median over neighbouring bins, since that of a bin is known by few blows only.
    """
    from scipy.ndimage import median_filter
    from scipy.signal import find_peaks, peak_prominences

    size = np.abs(H)
    good = np.isfinite(size) & (size > 0.0)
    relative = np.where(good, uncertainty / np.where(good, size, 1.0), np.nan)
    good &= ~(relative > _LOUD_UNCERTAINTY)
    if np.count_nonzero(good) < _FEWEST_POINTS:
        return np.empty((0, 2))
    level = 20.0 * np.log10(size[good])
    noise = _DECIBELS * median_filter(np.nan_to_num(relative[good]), size=_NEIGHBOURS)
    peaks = find_peaks(level)[0]
    out = peak_prominences(level, peaks)[0]
    seen = out >= np.maximum(MIN_PROMINENCE_DB, _PEAK_SIGNIFICANCE * noise[peaks])
    return np.column_stack([f[good][peaks[seen]], out[seen]])


def static_mistake(value: float) -> str:
    """Mistake that a wrong static value is typical of, as a clause; empty where none is known."""
    if abs(value + 1.0) < LARGEST_STATIC_ERROR:
        return ": its sign is reversed"
    for factor, unit in (
        (1e3, "readings in mN over loads in N"),
        (1e-3, "readings in N over loads in mN"),
    ):
        if abs(abs(value) / factor - 1.0) < LARGEST_STATIC_ERROR:
            return f": as of {unit}"
    for factor, unit in ((9.80665, "kgf for N"), (4.448, "lbf for N")):
        for of in (factor, 1.0 / factor):
            if abs(abs(value) / of - 1.0) < 0.05:
                return f": as in {unit}, or the reverse"
    return ""


def modelled_response(name: str, resonances: tuple[Resonance, ...]) -> TableResponse:
    """Response of a table with these ``resonances``, which already are those under the mass on it.

    Uncertainties follow from those of frequencies and damping ratios, to first order; nan where none
    is stated.
    """
    top = 2.0 * max(one.frequency for one in resonances)
    f = np.linspace(0.0, top, _MODEL_POINTS)
    H = np.zeros((f.size, 6, 6), dtype=complex)
    spread = np.zeros((f.size, 6, 6))
    first: dict[str, float] = {}
    for k, component in enumerate(COMPONENTS):
        own = [one for one in resonances if one.component == component]
        H[:, k, k] = _product(f, own)
        first[component] = min((one.frequency for one in own if one.share > 0.0), default=math.inf)
        if own:
            spread[:, k, k] = _model_uncertainty(f, own)
    return TableResponse(name, f, H, spread, np.full((f.size, 6), np.nan), first)


def _product(f: np.ndarray, resonances: list[Resonance]) -> np.ndarray:
    s, H = 2j * math.pi * f, np.ones(f.size, dtype=complex)
    for one in resonances:
        H = H * table_response(s, 2.0 * math.pi * one.frequency, one)
    return H


def _model_uncertainty(f: np.ndarray, resonances: list[Resonance]) -> np.ndarray:
    """Root of the sum of squares of the changes by each parameter's uncertainty, (m,); nan where a
    frequency's is not stated.
    """
    H, total = _product(f, resonances), np.zeros(f.size)
    for k, one in enumerate(resonances):
        if one.frequency_uncertainty is None:
            return np.full(f.size, np.nan)
        changes = [{"frequency": one.frequency * (1.0 + one.frequency_uncertainty)}]
        if one.damping_uncertainty is not None:
            changes.append({"damping": one.damping * (1.0 + one.damping_uncertainty)})
        for change in changes:
            moved = [*resonances[:k], one.model_copy(update=change), *resonances[k + 1 :]]
            total += np.abs(_product(f, moved) - H) ** 2
    return np.sqrt(total)
