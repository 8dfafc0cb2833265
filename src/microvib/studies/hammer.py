"""Hammer test of a force table: responses of its readings over loads, and the resonances in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.rigid import COMPONENTS
from microvib.results import FREQUENCY, SHARE, Column, Measure
from microvib.signals.impacts import Blow, Estimator, ImpactError, ImpactResponse, impact_response
from microvib.testdata.bench import Bench
from microvib.testdata.bench_parts import Resonance, table_response
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.table_response import MIN_COHERENCE, TableResponse, resonance_peaks
from microvib.units import GivenQuantity, quantity

MOST_RESONANCES = 3
"""Resonances of one component that are fitted."""
_ABOVE_PEAK = 1.5
"""Times the highest fitted resonance, up to which a response is fitted."""
_SHARES = (1.0, 0.5, 0.1)
"""Shares from which a fit starts."""
GOOD_MISFIT = 3.0
"""Root of the reduced chi square from which a fit does not describe the response."""
_SECONDS = Measure("s", form=".3f")
_NEWTONS = Measure("N", form=".4g")
_RELATIVE = Measure("%", 0.01, ".2g")
_PLAIN = Measure(form=".3g")


@dataclass(frozen=True, eq=False)
class Hits:
    """Recording of blows along or about one axis of the table."""

    load: str
    """Component that the hammer loads."""
    recording: Recording
    arm: float = 1.0
    """Lever arm [m] of a torque; 1 for a force."""


@dataclass(frozen=True)
class FittedResonance:
    """A resonance of the table with its standard uncertainties."""

    component: Annotated[str, Column("component", "component")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    frequency_uncertainty: Annotated[float, Column("frequency_uncertainty", "±", _RELATIVE)]
    """Relative."""
    damping: Annotated[float, Column("damping", "damping ratio", SHARE)]
    damping_uncertainty: Annotated[float, Column("damping_uncertainty", "± of it", _RELATIVE)]
    """Relative."""
    share: Annotated[float, Column("share", "share of the load", SHARE)]
    share_uncertainty: Annotated[float, Column("share_uncertainty", "±", _RELATIVE)]
    misfit: Annotated[float, Column("misfit", "misfit", _PLAIN)]
    """Root of the reduced chi square of the fit that it is of: 1 where only noise is left."""

    @property
    def trusted(self) -> bool:
        """Whether the model describes the response."""
        return self.misfit < GOOD_MISFIT


@dataclass(frozen=True)
class FoundBlow:
    """A blow, and whether it counts."""

    load: Annotated[str, Column("load", "load")]
    time: Annotated[float, Column("time_s", "time", _SECONDS)]
    peak: Annotated[float, Column("peak_n", "peak", _NEWTONS)]
    rejected: Annotated[str, Column("left_out", "left out")]


@dataclass(frozen=True, eq=False)
class HammerTest:
    """Responses of a table and its resonances."""

    def model(self, component: str, frequency: np.ndarray) -> np.ndarray | None:
        """Response of the fitted resonances of a component at each ``frequency`` (m,) [Hz]; None without any."""
        own = [x for x in self.resonances if x.component == component]
        if not own:
            return None
        p = [0.0]
        for x in own:
            p += [math.log(2.0 * math.pi * x.frequency), math.log(x.damping), x.share]
        decay = self.each[component].window_decay
        return _model(2j * math.pi * frequency + decay, np.array(p))

    responses: TableResponse
    each: dict[str, ImpactResponse]
    """By component."""
    resonances: tuple[FittedResonance, ...]
    blows: tuple[FoundBlow, ...]
    mounted_mass: float
    """Mass on the table [kg] in the test."""
    estimator: Estimator

    @property
    def bench(self) -> Bench:
        """The table as a virtual bench: its resonances under what was mounted."""
        table = tuple(
            _resonance(
                one.component,
                one.frequency,
                one.damping,
                one.share,
                frequency_uncertainty=one.frequency_uncertainty,
                damping_uncertainty=one.damping_uncertainty,
            )
            for one in self.resonances
            if one.trusted
        )
        whole = Bench(
            title=f"table by a hammer test under {self.mounted_mass:g} kg",
            source=(
                f"measured: hammer test, {self.estimator}, {self.mounted_mass:g} kg on the table, whose"
                " resonances these are; noise, amplifiers and converter are not measured, and left out"
            ),
        )
        return whole.model_copy(update={"table": table})


def _resonance(
    component: str, frequency: float, damping: float, share: float, **more: float
) -> Resonance:
    """A resonance of figures in SI, which a fit may have taken beyond what a file may say."""
    values: dict[str, Any] = {"component": component, "frequency": frequency}
    values |= {"damping": damping, "share": share, **more}
    return Resonance.model_construct(**values)


def hammer_test(
    hits: Sequence[Hits],
    impact: str,
    *,
    mounted_mass: GivenQuantity,
    block: GivenQuantity | None = None,
    estimator: Estimator = "H1",
) -> HammerTest:
    """Find a table's responses, readings over loads, and its resonances from blows of a hammer.

    Each response is that of one reading over its own load; a blow off the axes loads others, too,
    which is not taken out. Resonances are fitted to it, weighted by its uncertainties, as the virtual
    bench has them (``table_response``), and their uncertainties are the fit's.

    Parameters
    ----------
    hits : sequence of Hits
        Recordings, one for each component that was hit.
    impact : str
        Channel of the hammer's force.
    mounted_mass : str or Si
        Mass on the table in the test, such as ``"12 kg"``: the responses hold for it.
    block : str or Si, optional
        Length of a block, such as ``"0.5 s"``.
    estimator : {"H1", "H2"}
        Which estimate of the response.

    Returns
    -------
    HammerTest
        Responses, resonances and all blows with why they were left out.

    Raises
    ------
    MicrovibError
        Where a channel cannot be used, or fewer than three blows count.
    """
    mass = quantity("mounted_mass", mounted_mass, "kg")
    length = None if block is None else quantity("block", block, "s", positive=True)
    if not mass >= 0.0:
        raise MicrovibError(f"mounted_mass: {mass:g} kg is not allowed; it must be at least 0 kg")
    each: dict[str, ImpactResponse] = {}
    blows: list[FoundBlow] = []
    for one in hits:
        if one.load in each:
            raise MicrovibError(f"{one.load}: two recordings are of its blows; give one of them")
        each[one.load] = _response(one, impact, length, estimator)
        blows += [_found(one.load, blow) for blow in each[one.load].blows]
    found = [fit for name, response in each.items() for fit in _resonances(name, response)]
    return HammerTest(_table(each, mass), each, tuple(found), tuple(blows), mass, estimator)


def _found(load: str, blow: Blow) -> FoundBlow:
    return FoundBlow(load, blow.time, blow.peak, blow.rejected)


def _response(hits: Hits, impact: str, block: float | None, estimator: Estimator) -> ImpactResponse:
    recording = hits.recording
    if hits.load not in COMPONENTS:
        raise MicrovibError(
            f"'{hits.load}' is no component of the table; {', '.join(COMPONENTS)} are known"
        )
    force, reading = recording.load(impact), recording.load(hits.load)
    if recording.units[impact] != "N":
        raise RecordingError(
            f"{recording.title}: channel {impact} is a torque; a hammer's force is expected"
        )
    for name, x in ((impact, force), (hits.load, reading)):
        if not np.all(np.isfinite(x)) or np.ptp(x) == 0.0:
            raise RecordingError(
                f"{recording.title}: channel {name} is constant, or has samples that are not numbers"
            )
    try:
        found = impact_response(force, reading, recording.sample_rate, block, estimator)
    except ImpactError as error:
        raise RecordingError(f"{recording.title}, blows of {hits.load}: {error}") from None
    return replace(found, H=found.H / hits.arm, uncertainty=found.uncertainty / abs(hits.arm))


def _table(each: dict[str, ImpactResponse], mass: float) -> TableResponse:
    """All responses on the frequencies of the one with the finest bins; what an exponential window changes
    goes into their uncertainties.
    """
    f = min(each.values(), key=lambda one: one.frequency[0]).frequency
    top = 0.8 * max(one.frequency[-1] for one in each.values())
    f = f[f <= top]
    H = np.full((f.size, 6, 6), np.nan, dtype=complex)
    spread, coherence = np.full((f.size, 6, 6), np.nan), np.full((f.size, 6), np.nan)
    for name, one in each.items():
        k = COMPONENTS.index(name)
        inside = (f >= one.frequency[0]) & (f <= one.frequency[-1])
        at = f[inside]
        H[inside, k, k] = np.interp(at, one.frequency, one.H.real) + 1j * np.interp(
            at, one.frequency, one.H.imag
        )
        by_window = one.window_decay * np.abs(np.gradient(one.H, 2.0 * math.pi * one.frequency))
        total = np.minimum(np.hypot(one.uncertainty, by_window), 1e6)
        spread[inside, k, k] = np.interp(at, one.frequency, total)
        coherence[inside, k] = np.interp(at, one.frequency, one.coherence)
    return TableResponse(f"hammer test under {mass:g} kg", f, H, spread, coherence)


def _resonances(component: str, response: ImpactResponse) -> list[FittedResonance]:
    """Resonances of a component, the lowest first; none where no peak is above the noise."""
    starts = _start_frequencies(response)
    if not starts:
        return []
    f = response.frequency
    within = (f <= _ABOVE_PEAK * starts[-1]) & (response.coherence >= MIN_COHERENCE)
    within &= response.uncertainty > 0.0
    count = 2 + 3 * len(starts)
    if np.count_nonzero(within) < count + 8:
        return []
    cut = replace(
        response,
        frequency=f[within],
        H=response.H[within],
        coherence=response.coherence[within],
        uncertainty=response.uncertainty[within],
    )
    return _fitted(component, cut, starts)


def _start_frequencies(response: ImpactResponse) -> list[float]:
    """Frequencies [Hz] of the most prominent peaks, ascending."""
    good = response.coherence >= MIN_COHERENCE
    peaks = resonance_peaks(response.frequency[good], response.H[good], response.uncertainty[good])
    return sorted(peaks[np.argsort(-peaks[:, 1])[:MOST_RESONANCES], 0].tolist())


def _model(s: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Static value times the product of the bench's resonances: p is its logarithm, then for each the
    logarithms of frequency and damping, and the share.
    """
    H = math.exp(p[0]) * np.ones(s.size, dtype=complex)
    for log_w, log_damping, share in p[1:].reshape(-1, 3):
        w = math.exp(log_w)
        one = _resonance("Fx", w / (2.0 * math.pi), math.exp(log_damping), float(share))
        H = H * table_response(s, w, one)
    return H


def _fitted(component: str, response: ImpactResponse, starts: list[float]) -> list[FittedResonance]:
    from scipy.optimize import least_squares

    s = 2j * math.pi * response.frequency + response.window_decay
    sign = math.copysign(1.0, float(np.median(response.H[: max(4, response.H.size // 20)].real)))

    def off(p: np.ndarray) -> np.ndarray:
        miss = (_model(s, p) - sign * response.H) / response.uncertainty
        return np.concatenate([miss.real, miss.imag])

    low, high = [-3.0], [3.0]
    for f in starts:
        low += [math.log(2.0 * math.pi * 0.8 * f), math.log(1e-4), 0.0]
        high += [math.log(2.0 * math.pi * 1.25 * f), math.log(0.9), 1.5]
    best = None
    for share in _SHARES:
        p = [0.0]
        for f in starts:
            p += [math.log(2.0 * math.pi * f), math.log(0.02), share]
        got = least_squares(
            off, p, bounds=(low, high), x_scale=[0.01, *[0.001, 0.1, 0.1] * len(starts)]
        )
        if best is None or got.cost < best.cost:
            best = got
    assert best is not None
    dof = max(best.fun.size - best.x.size, 1)
    misfit = math.sqrt(2.0 * best.cost / dof)
    spread = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac))) * max(misfit, 1.0)
    found = []
    for k in range(len(starts)):
        log_w, log_damping, share = best.x[1 + 3 * k : 4 + 3 * k]
        sigma = spread[1 + 3 * k : 4 + 3 * k]
        found.append(
            FittedResonance(
                component,
                math.exp(log_w) / (2.0 * math.pi),
                float(sigma[0]),
                math.exp(log_damping),
                min(float(sigma[1]), 1.0),
                min(float(share), 1.0),
                float(sigma[2]),
                misfit,
            )
        )
    return found
