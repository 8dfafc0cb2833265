"""Order tracking of a sweep: order cuts, order map, waterfall, maxima and the resonances that orders
cross.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from microvib.analysis import spectra
from microvib.errors import MicrovibError, OptionError, expect_list
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.recordings import Prepared
from microvib.io.sources import RunFolder, Source
from microvib.model.linear import coupled_modes
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.results import (
    FREQUENCY,
    LINE_FREQUENCY,
    PHASE,
    TIME,
    TORQUE,
    TORQUE_UNCERTAINTY,
    Column,
)
from microvib.signals.order_spectrum import OrderMap, order_map
from microvib.signals.order_tracking import OrderError, Tracked, track_components
from microvib.signals.spectrum import Waterfall
from microvib.signals.sweep_clock import stretch_length
from microvib.solve.integration import Progress
from microvib.studies.analyse import opened_source, torque_of
from microvib.studies.speed_reference import (
    Reference,
    named,
    of_profile,
    of_scenario,
    of_speed_channel,
    of_strongest,
    of_tacho,
    with_clock,
)
from microvib.testdata.recording import Recording, require_usable_channel
from microvib.testdata.section import Section
from microvib.units import GivenQuantity, Si, quantity

HIGHEST = 0.45
"""Part of the sample rate up to which components are tracked."""
DETECTED = 3.0
"""Times of its uncertainty from which an amplitude is above the floor."""
MAX_ORDERS = 64
"""Orders and fixed lines that are tracked together, at most."""
TRACKED, IN_FLOOR, NOT_SEPARABLE, BEYOND = (
    "tracked",
    "below the floor",
    "not separable",
    "above the usable frequencies",
)
"""Findings on an order at a time."""
_BANDWIDTH = 0.3
"""Bandwidth over the least distance between components, where none is given."""
_PROMINENCE = 0.2
"""Part of a peak's height that it must stand above its surroundings to be taken for a resonance."""
_ALIKE = 0.03
"""Part of a frequency within which peaks of several orders are at the same one."""
_NEAR_MODE = 0.1
"""Part of a mode's frequency within which a resonance is named after it."""
_NOTED = 0.05
"""Part of a sweep, more than its two ends, from which an order that is not told has a note."""
_AT_ENDS = 1.0
"""Knots at the ends of the record whose amplitudes make no maximum."""
_ONE_REFERENCE = "give one of tacho, speed, profile, scenario, strongest"
SWEEP_NOTE = "a resonance that the sweep passes quickly responds less than in a dwell on it, and later in the sweep"


@dataclass(frozen=True)
class CutPoint:
    """A point of an order cut."""

    order: Annotated[str, Column("order", "order")]
    time: Annotated[float, Column("time_s", "time", TIME)]
    speed: Annotated[float, Column("speed_hz", "speed", FREQUENCY)]
    frequency: Annotated[float, Column("frequency_hz", "frequency", LINE_FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    uncertainty: Annotated[float, Column("amplitude_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    phase: Annotated[float, Column("phase_rad", "phase", PHASE)]
    """Phase of a cosine, from the phase of the reference."""
    finding: Annotated[str, Column("finding", "finding")]


@dataclass(frozen=True)
class OrderCut:
    """One order, or one fixed line, over the sweep; m points."""

    label: str
    """The order as a number, or the frequency of a fixed line."""
    order: float
    """nan of a fixed line."""
    time: np.ndarray
    """Seconds from the first sample of the section, (m,)."""
    speed: np.ndarray
    """Speed of the reference [Hz], (m,)."""
    frequency: np.ndarray
    """Frequency of the component [Hz], (m,)."""
    amplitude: np.ndarray
    """0-to-peak, (m,)."""
    uncertainty: np.ndarray
    """Standard uncertainty from the floor beside the order and from the bandwidth, (m,)."""
    phase: np.ndarray
    """[rad], unwrapped, (m,)."""
    finding: np.ndarray
    """One of TRACKED, IN_FLOOR, NOT_SEPARABLE, BEYOND, (m,)."""

    @property
    def known(self) -> np.ndarray:
        """Points at which the record tells the amplitude, (m,), also that it is in the floor."""
        return (self.finding == TRACKED) | (self.finding == IN_FLOOR)

    def points(self) -> Iterator[CutPoint]:
        """Rows of the cut for a table."""
        for i in range(self.time.size):
            yield CutPoint(
                self.label,
                float(self.time[i]),
                float(self.speed[i]),
                float(self.frequency[i]),
                float(self.amplitude[i]),
                float(self.uncertainty[i]),
                float(self.phase[i]),
                str(self.finding[i]),
            )


@dataclass(frozen=True)
class Maximum:
    """Largest amplitude of an order, or a peak of its cut."""

    order: Annotated[str, Column("order", "order")]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    uncertainty: Annotated[float, Column("amplitude_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    frequency: Annotated[float, Column("frequency_hz", "frequency", LINE_FREQUENCY)]
    speed: Annotated[float, Column("speed_hz", "speed", FREQUENCY)]
    time: Annotated[float, Column("time_s", "time", TIME)]
    mean: Annotated[float, Column("mean_amplitude_n_m", "mean of the sweep", TORQUE)]
    """Mean amplitude over the sweep, where it is told; nan of further peaks."""
    what: Annotated[str, Column("what", "what")]
    """*resonance* with its frequency, or *largest*, and how much of the order is known."""


@dataclass(frozen=True)
class Resonance:
    """A frequency at which orders have peaks."""

    frequency: Annotated[float, Column("frequency_hz", "resonance", LINE_FREQUENCY)]
    orders: Annotated[str, Column("orders", "orders that cross it")]
    speeds: Annotated[str, Column("speeds_hz", "at speeds [Hz]")]
    what: Annotated[str, Column("what", "what")]


@dataclass(frozen=True)
class OrderTracking:
    """A sweep, tracked."""

    name: str
    channel: str
    unit: str
    recording: Recording
    """The section that was tracked."""
    reference: Reference
    cuts: tuple[OrderCut, ...]
    maxima: tuple[Maximum, ...]
    resonances: tuple[Resonance, ...]
    bandwidth: float
    """[Hz]."""
    order_map: OrderMap
    waterfall: Waterfall
    notes: tuple[str, ...]
    """On what cannot be told, a sentence each."""

    def cut(self, order: float) -> OrderCut:
        """The cut of an order; OptionError where it was not tracked."""
        for one in self.cuts:
            if one.order == order:
                return one
        tracked = ", ".join(one.label for one in self.cuts)
        raise OptionError("order", f"{order:g} was not tracked; tracked are {tracked}")


def track_orders(  # noqa: PLR0913 - keyword options
    source: Source | Recording | str | os.PathLike[str],
    orders: Sequence[float],
    *,
    name: str = "",
    channel: str = "Mz",
    tacho: str | None = None,
    pulses_per_rev: float = 1.0,
    speed: str | None = None,
    profile: str | None = None,
    scenario: GivenScenario | None = None,
    strongest: float | None = None,
    clock: str = "found",
    fixed: Sequence[GivenQuantity] = (),
    bandwidth: GivenQuantity | None = None,
    section: Section | None = None,
    files: FileAccess = WORKING_FOLDER,
    progress: Progress | None = None,
) -> OrderTracking:
    """Track orders through a rate sweep: amplitude and phase of each over time and speed.

    All orders are fitted at once, so that close and crossing ones are told apart where the record
    allows it; where it does not, they are *not separable* there.

    Parameters
    ----------
    source : Scenario, RunFolder, Recording, Prepared, str or path
        Recording of a sweep, a run's folder, or a scenario that is simulated.
    orders : sequence of float
        Orders to track: cycles per revolution of the reference.
    name : str
        What a scenario is called.
    channel : str
        Channel with the torque, force or acceleration.
    tacho : str, optional
        Channel with pulses of a tacho, which is the reference then.
    pulses_per_rev : float
        Pulses per revolution.
    speed : str, optional
        Channel that is the speed of the reference, in rpm, Hz or deg/s.
    profile : str, optional
        Speed profile of the reference: ``"0 s:10 Hz, 5 s:40 Hz"``, a CSV file, or the text of one.
    scenario : Scenario, str or path, optional
        Drive whose command is the reference: order 1 is once per electrical period.
    strongest : float, optional
        Order that the strongest component of the record is; it is followed then.
    clock : {"found", "stated"}
        Whether the clock of a profile or a scenario is looked for in the record.
    fixed : sequence of str or Si, optional
        Frequencies of lines that do not follow the speed, such as ``"50 Hz"``, tracked alongside.
    bandwidth : str or Si, optional
        Width about each order within which all is taken for it.
    section : Section, optional
        Part of the record.
    files : FileAccess
        Permission to open the file of a profile.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    OrderTracking
        Order cuts, maxima, resonances, order map and waterfall.

    Raises
    ------
    MicrovibError
        Where a channel is missing or unfit, no reference or several are given, or the record is too
        short.

    Examples
    --------
    >>> import numpy as np
    >>> import microvib as mv
    >>> t = np.arange(3000) / 600.0
    >>> x = 0.2 * np.cos(2.0 * np.pi * 4.0 * (10.0 * t + 3.0 * t**2))
    >>> sweep = mv.Recording({"Mz": x}, 600.0, {"Mz": "N*m"}, "sweep")
    >>> found = mv.track_orders(sweep, [1, 4], profile="0 s:10 Hz, 5 s:40 Hz")
    >>> print(f"{found.cut(4).amplitude.mean():.3f} N m")
    0.200 N m
    """
    tracked_orders = _checked(orders)
    opened = opened_source(source)
    recording, own = _recording(opened, name, channel, progress)
    if section is not None and not isinstance(opened, Prepared):
        raise OptionError("from", "sections are of recordings; a run has its record's length")
    offset = 0.0
    if section is not None:
        recording, offset = section.cut(recording)
    require_usable_channel(recording, channel, acceleration=True)
    guide = own if scenario is None else as_scenario(scenario)
    given = [one for one in (tacho, speed, profile, scenario, strongest) if one is not None]
    if len(given) > 1:
        raise MicrovibError(f"several references are given; {_ONE_REFERENCE}")
    x, rate = recording[channel] - np.mean(recording[channel]), recording.sample_rate
    if tacho is not None:
        reference = of_tacho(recording, tacho, pulses_per_rev)
    elif speed is not None:
        reference = of_speed_channel(recording, speed)
    elif profile is not None:
        stated, words = of_profile(x.size, rate, profile, offset, files)
        reference = with_clock(x, rate, stated, words, tracked_orders, clock)
    elif strongest is not None:
        reference = of_strongest(x, rate, strongest, tracked_orders, _seconds(x.size / rate))
    elif guide is not None:
        stated, words = of_scenario(guide, x.size, rate, offset)
        kind = "stated" if scenario is None else clock
        reference = with_clock(x, rate, stated, words, tracked_orders, kind)
        reference = named(reference, "electrical period")
    else:
        raise MicrovibError(f"no reference is given; {_ONE_REFERENCE}")
    return _track(
        _Sweep(name or recording.title, channel, recording, reference),
        tracked_orders,
        _fixed_lines(fixed, len(tracked_orders), rate),
        _stated_bandwidth(bandwidth),
        guide,
    )


def _fixed_lines(fixed: Sequence[GivenQuantity], orders: int, rate: float) -> list[float]:
    """Frequencies [Hz] of lines that are tracked beside a number of orders; OptionError where one is too
    high for the sample rate [Hz], or there are too many.
    """
    lines = [float(quantity("fixed", one, "Hz", positive=True)) for one in fixed]
    for f in lines:
        if f > HIGHEST * rate:
            raise OptionError(
                "fixed",
                f"{f:g} Hz is not allowed; at most {HIGHEST * rate:g} Hz are tracked at"
                f" {rate:g} samples a second",
            )
    if len(lines) + orders > MAX_ORDERS:
        raise OptionError("orders", f"at most {MAX_ORDERS} orders and fixed lines are tracked")
    return lines


def _stated_bandwidth(given: GivenQuantity | None) -> float | None:
    """Bandwidth [Hz]; None where none is given."""
    if given is None:
        return None
    return float(quantity("bandwidth", given, "Hz", positive=True))


def _checked(orders: Sequence[float]) -> list[float]:
    """Orders, ascending and each once; OptionError where one is none."""
    expect_list(orders, "orders", "[0.5, 1, 4, 6]")
    found = sorted({float(order) for order in orders})
    if not found:
        raise OptionError("orders", "none is given; give some, such as 0.5,1,4,6")
    for order in found:
        if not (math.isfinite(order) and order > 0.0):
            raise OptionError("orders", f"{order:g} is not allowed; orders are greater than 0")
    return found


def _seconds(duration: float) -> float:
    """Length [s] of the stretches in which the strongest component is looked for."""
    return max(min(duration / 24.0, 1.0), duration / 400.0)


def _recording(
    source: Source, name: str, channel: str, progress: Progress | None
) -> tuple[Recording, Scenario | None]:
    """Samples of a source, and the scenario of a simulated one."""
    match source:
        case Prepared():
            return source.recording, None
        case Scenario():
            return torque_of(source, name, progress), source
        case RunFolder():
            if source.motion is None:
                raise MicrovibError(f"{source.path}: has no motion.nc; orders need a motion")
            return source.motion, source.scenario
    raise MicrovibError(
        f"{name or 'the source'}: lines alone cannot be tracked; expected a recording, the folder"
        " of a run or a scenario"
    )


@dataclass(frozen=True)
class _Sweep:
    """A channel of a record and its reference."""

    name: str
    channel: str
    recording: Recording
    reference: Reference

    @property
    def x(self) -> np.ndarray:
        """Samples less their mean, where the reference is known, (n,)."""
        x = self.recording[self.channel][self.reference.part]
        return np.asarray(x - x.mean())

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return self.recording.sample_rate

    @property
    def start(self) -> float:
        """Time [s] of the first of them in the section."""
        return (self.reference.part.start or 0) / self.rate


def _default_bandwidth(sweep: _Sweep, orders: list[float]) -> float:
    """Bandwidth [Hz] that tells orders apart at all but the lowest speeds, in a record of that length."""
    speed = sweep.reference.speed(sweep.rate)
    gap = float(np.min(np.diff([0.0, *orders])))
    slow = float(np.percentile(speed, 5.0))
    least = 6.0 * sweep.rate / speed.size
    most = 64.0 / stretch_length(speed, sweep.rate, orders)
    return max(min(_BANDWIDTH * gap * slow, most, sweep.rate / 20.0), least)


def _track(
    sweep: _Sweep,
    orders: list[float],
    lines: list[float],
    bandwidth: float | None,
    guide: Scenario | None,
) -> OrderTracking:
    x, rate, reference = sweep.x, sweep.rate, sweep.reference
    speed = reference.speed(rate)
    t = np.arange(x.size) / rate
    phases = (
        2.0
        * np.pi
        * np.array([order * reference.phase for order in orders] + [f * t for f in lines])
    )
    frequency = np.array([order * speed for order in orders] + [np.full(x.size, f) for f in lines])
    used = frequency < HIGHEST * rate
    _require_within(orders, frequency, used, rate)
    width = _default_bandwidth(sweep, orders) if bandwidth is None else bandwidth
    tracked = track_components(x, rate, phases, used, width)
    labels = [f"{order:g}" for order in orders] + [f"{f:g} Hz" for f in lines]
    every = orders + [math.nan] * len(lines)
    at = np.clip(np.rint(tracked.time * rate).astype(int), 0, x.size - 1)
    cuts = tuple(
        _cut(label, order, tracked, k, (sweep.start, speed[at], frequency[k][at], used[k][at]))
        for k, (label, order) in enumerate(zip(labels, every, strict=True))
    )
    peaks = [(cut, i) for cut in cuts for i in _peaks(cut, width)]
    resonances = _resonances(peaks, width, guide)
    highest = max(1.25 * max(orders), max(orders) + 1.0)
    top = min(highest, HIGHEST * rate / max(float(np.percentile(speed, 50.0)), 1e-12))
    made = order_map(x, rate, reference.phase, orders, max(top, max(orders)))
    resolution = Si(max(1.0 / stretch_length(speed, rate, orders), 8.0 * rate / x.size))
    section = replace(
        sweep.recording, channels={sweep.channel: sweep.recording[sweep.channel][reference.part]}
    )
    return OrderTracking(
        sweep.name,
        sweep.channel,
        sweep.recording.units[sweep.channel],
        sweep.recording,
        reference,
        cuts,
        tuple(_maxima(cuts, peaks, resonances, width)),
        tuple(resonances),
        width,
        replace(made, unit=sweep.recording.units[sweep.channel], time=made.time + sweep.start),
        spectra.waterfall(section, sweep.channel, Si(min(float(resolution), rate / 16.0))),
        tuple(_notes(cuts, width, x.size / rate, resonances)),
    )


def _require_within(
    orders: list[float], frequency: np.ndarray, used: np.ndarray, rate: float
) -> None:
    """OrderError for an order whose frequency is above the usable ones throughout."""
    for k, order in enumerate(orders):
        if not np.any(used[k]):
            raise OrderError(
                f"orders: order {order:g} is at {frequency[k].min():.4g} Hz and above, beyond"
                f" {HIGHEST * rate:.4g} Hz, up to which {rate:g} samples a second are used"
            )


def _cut(
    label: str,
    order: float,
    tracked: Tracked,
    k: int,
    at: tuple[float, np.ndarray, np.ndarray, np.ndarray],
) -> OrderCut:
    start, speed, frequency, used = at
    amplitude, uncertainty = np.abs(tracked.amplitude[k]), tracked.uncertainty[k]
    finding = np.full(amplitude.size, TRACKED, dtype=object)
    finding[amplitude < DETECTED * uncertainty] = IN_FLOOR
    finding[~tracked.separable[k]] = NOT_SEPARABLE
    finding[~used] = BEYOND
    phase = np.unwrap(np.angle(tracked.amplitude[k]))
    time = tracked.time + start
    return OrderCut(label, order, time, speed, frequency, amplitude, uncertainty, phase, finding)


def _peaks(cut: OrderCut, bandwidth: float) -> list[int]:
    """Points at which a cut has peaks that are higher than their surroundings and than the noise."""
    from scipy.signal import find_peaks

    if math.isnan(cut.order):
        return []
    inside = cut.finding == TRACKED
    ends = _AT_ENDS / bandwidth
    inside &= (cut.time > cut.time[0] + ends) & (cut.time < cut.time[-1] - ends)
    shown = np.where(cut.known, cut.amplitude, 0.0)
    found, about = find_peaks(shown, prominence=0.0)
    kept = []
    for i, prominence in zip(found.tolist(), about["prominences"].tolist(), strict=True):
        least = max(_PROMINENCE * cut.amplitude[i], 4.0 * cut.uncertainty[i])
        if inside[i] and prominence > least:
            kept.append(i)
    return kept


def _peaks_by_frequency(
    peaks: list[tuple[OrderCut, int]], bandwidth: float
) -> list[list[tuple[OrderCut, int]]]:
    """Peaks of different orders that are at one frequency, together; ascending."""
    groups: list[list[tuple[OrderCut, int]]] = []
    for cut, i in sorted(peaks, key=lambda one: one[0].frequency[one[1]]):
        f = cut.frequency[i]
        if groups:
            before, j = groups[-1][-1]
            near = max(_ALIKE * f, bandwidth)
            other = all(one.label != cut.label for one, _ in groups[-1])
            if f - before.frequency[j] < near and other:
                groups[-1].append((cut, i))
                continue
        groups.append([(cut, i)])
    return groups


def _resonances(
    peaks: list[tuple[OrderCut, int]], bandwidth: float, guide: Scenario | None
) -> list[Resonance]:
    """Frequencies at which peaks of orders are, ascending."""
    modes = () if guide is None else coupled_modes(guide)
    found = []
    for group in _peaks_by_frequency(peaks, bandwidth):
        weights = np.array([cut.amplitude[i] for cut, i in group])
        f = float(np.average([cut.frequency[i] for cut, i in group], weights=weights))
        near_modes = [m for m in modes if abs(m.frequency / f - 1.0) < _NEAR_MODE]
        if near_modes:
            mode = min(near_modes, key=lambda m: abs(m.frequency - f))
            what = f"{mode.name} at {mode.frequency:.4g} Hz"
        elif len(group) > 1:
            what = "several orders peak at one frequency"
        else:
            what = "one order alone: its excitation may change with the speed"
        found.append(
            Resonance(
                f,
                ", ".join(cut.label for cut, _ in group),
                ", ".join(f"{cut.speed[i]:.4g}" for cut, i in group),
                what,
            )
        )
    return found


def _maxima(
    cuts: Sequence[OrderCut],
    peaks: list[tuple[OrderCut, int]],
    resonances: Sequence[Resonance],
    bandwidth: float,
) -> Iterator[Maximum]:
    """The largest amplitude of each order, then its other peaks; where nothing is known, words."""
    for cut in cuts:
        if not np.any(cut.known):
            worst = sorted({str(one) for one in cut.finding})
            nan = math.nan
            yield Maximum(
                cut.label, nan, nan, nan, nan, nan, nan, f"not judged: {', '.join(worst)}"
            )
            continue
        own = [i for one, i in peaks if one is cut]
        largest = _largest(cut, bandwidth)
        for i in [largest, *(i for i in own if i != largest)]:
            words = [_resonance_words(cut, i, resonances)] if i in own else []
            if cut.finding[i] == IN_FLOOR:
                words.append(IN_FLOOR)
            if i == largest:
                words = ["largest", *words, *_part_told(cut)]
            yield Maximum(
                cut.label,
                float(cut.amplitude[i]),
                float(cut.uncertainty[i]),
                float(cut.frequency[i]),
                float(cut.speed[i]),
                float(cut.time[i]),
                float(np.mean(cut.amplitude[cut.known])) if i == largest else math.nan,
                ", ".join(words),
            )


def _largest(cut: OrderCut, bandwidth: float) -> int:
    """Point with the largest known amplitude, not at the ends of the record where there is another."""
    ends = _AT_ENDS / bandwidth
    inner = (cut.time > cut.time[0] + ends) & (cut.time < cut.time[-1] - ends) & cut.known
    if not np.any(inner):
        inner = cut.known
    return int(np.argmax(np.where(inner, cut.amplitude, -1.0)))


def _part_told(cut: OrderCut) -> list[str]:
    """Words for the part of the sweep in which the order is known; none where that is all of it."""
    share = float(np.mean(cut.known))
    if share < 0.995:
        return [f"of the {100.0 * share:.0f} % of the sweep where it is told"]
    return []


def _resonance_words(cut: OrderCut, i: int, resonances: Sequence[Resonance]) -> str:
    nearest = min(resonances, key=lambda one: abs(one.frequency - cut.frequency[i]))
    return f"crosses {nearest.frequency:.4g} Hz"


def _notes(
    cuts: Sequence[OrderCut], bandwidth: float, duration: float, resonances: Sequence[Resonance]
) -> Iterator[str]:
    """Sentences on orders that are not told apart, or are above the usable frequencies in part."""
    for cut in cuts:
        lost = cut.finding == NOT_SEPARABLE
        if np.mean(lost) > _NOTED:
            yield _not_separable(cut, cuts, lost, bandwidth, duration)
        beyond = cut.finding == BEYOND
        if np.any(beyond):
            f = cut.frequency[beyond].min()
            yield f"order {cut.label} is not tracked from {f:.4g} Hz on, above the usable frequencies"
    if resonances:
        yield SWEEP_NOTE


def _not_separable(
    cut: OrderCut, cuts: Sequence[OrderCut], lost: np.ndarray, bandwidth: float, duration: float
) -> str:
    """Sentence on where an order is not separable, from what, and what would tell them apart."""
    others = [one for one in cuts if one is not cut]
    gaps = {one.label: np.abs(one.frequency - cut.frequency)[lost] for one in others}
    gaps["the mean"] = cut.frequency[lost]
    nearest = min(gaps, key=lambda label: float(np.median(gaps[label])))
    gap = float(np.median(gaps[nearest]))
    speeds = cut.speed[lost]
    from_what = nearest if nearest == "the mean" else f"order {nearest}"
    if nearest.endswith(" Hz"):
        from_what = f"the line at {nearest}"
    share = 100.0 * float(np.mean(lost))
    what = f"the line at {cut.label}" if math.isnan(cut.order) else f"order {cut.label}"
    text = (
        f"{what} is not separable from {from_what} at {speeds.min():.4g} to"
        f" {speeds.max():.4g} Hz of the reference, {share:.0f} % of the sweep"
    )
    needed = _BANDWIDTH * gap
    if needed > 0.0 and 4.0 / needed <= duration and needed < bandwidth:
        return f"{text}; a bandwidth of {needed:.2g} Hz would tell most of it"
    return f"{text}; the record is too short, or its sweep too quick, to tell them there"
