"""Peaks of a time history in bands against a limit for each: the second form of requirement, beside one
on lines.

A peak depends on the filter. It is given by one filter, whose roll-off is stated, with the least and
the largest peak that filters of this roll-off make: a band passes or fails only where all agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np

from microvib.analysis.accuracy import failed_invariants_reason
from microvib.analysis.both_drives import AddedTorque
from microvib.analysis.limits import judge
from microvib.analysis.margins import NoVerdict, Verdict, worst_verdict
from microvib.analysis.noise import LINEAR_FACTOR, noise_of_record
from microvib.analysis.other_states import other_states
from microvib.analysis.run import RunResult
from microvib.analysis.spectra import samples_of
from microvib.analysis.start import rounded_up
from microvib.errors import MicrovibError, OptionError
from microvib.io.band_limits import BandLimit
from microvib.model.noise_amplitudes import crest_of_noise, rms_of_noise
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.results import COUNT, DECIBEL, SHARE, TIME, TORQUE, TORQUE_LIMIT, Column, Measure
from microvib.signals.band_split import BandHistory, filter_reach, roll_off_for, split_band
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import LineTable
from microvib.testdata.recording import Recording, require_usable_channel
from microvib.units import Si, pretty

MIN_CYCLES = 5.0
"""Cycles of a band's lower edge, behind the filter's transients, below which it passes nothing."""
ROLL_OFFS = (0.01, 0.5)
"""Least and largest roll-off that may be asked for."""
_EDGE = Measure("Hz", form=".6g")
_SIGMAS = 3.0
"""Standard uncertainties that a peak keeps from its limit, as lines do."""
_AS_LOUD = 1.25
"""Ratio of RMS up to which what is louder at the ends of a record is taken to last there, as what
decays does."""
_OF_PIECE = 1.5
"""Height of a peak over what the RMS of a piece says that it is in for a part only; assumed."""
_GRID = 64
"""Frequencies of a band at which the force table is asked."""


@dataclass(frozen=True)
class BandPeak:
    """Peak of a band against its limit, in the unit of its channel."""

    channel: Annotated[str, Column("channel", "channel")]
    low: Annotated[float, Column("low_hz", "from", _EDGE)]
    high: Annotated[float, Column("high_hz", "to", _EDGE)]
    limit: Annotated[float, Column("limit_n_m", "limit", TORQUE_LIMIT)]
    peak: Annotated[float, Column("peak_n_m", "peak", TORQUE)]
    """Largest magnitude by the filter with ``roll_off``; nan where there is none."""
    least: Annotated[float, Column("least_n_m", "least, any filter", TORQUE)]
    """Peak that every filter of this roll-off reaches."""
    largest: Annotated[float, Column("largest_n_m", "largest, any filter", TORQUE)]
    """Peak that no filter of this roll-off exceeds."""
    time: Annotated[float, Column("time_s", "at", TIME)]
    """Time of the peak, from the first sample."""
    roll_off: Annotated[float, Column("roll_off", "roll-off", SHARE)]
    """Part of an edge's frequency on both sides of it within which the filter falls from 1 to 0."""
    looked_at: Annotated[float, Column("looked_at_s", "looked at", TIME)]
    """Length of the record behind the filter's transients."""
    cycles: Annotated[float, Column("cycles", "", COUNT)]
    """Cycles of the lower edge in it."""
    verdict: Annotated[Verdict, Column("verdict", "verdict", role="verdict")]
    why: Annotated[str, Column("why")]
    """Reason why it is not judged, a clause; empty where it is."""
    unit: str = "N*m"

    @property
    def margin(self) -> Annotated[float, Column("margin_db", "margin", DECIBEL)]:
        """Limit over the largest peak."""
        if not self.largest > 0.0:
            return math.nan
        return 20.0 * math.log10(self.limit / self.largest)

    @property
    def band(self) -> str:
        """The band in words."""
        return f"{self.low:g} to {self.high:g} Hz"


@dataclass(frozen=True)
class _Tolerance:
    """By how much what was read in a band may differ from the drive's load."""

    size: float
    """In the unit of the channel."""
    why: str
    """Cause of it, as a clause; empty where nothing does."""


TORQUE_CHANNEL = "T_d"
"""Name of the disturbance torque of a run on a craft among channels."""
Gaps = Callable[[float, float, float], Sequence[str]]
"""Reasons why lines between two frequencies [Hz] are not judged against a limit, in words."""


Tolerances = Callable[[float, float, float], Iterable[tuple[float, str]]]
"""By how much peaks between two frequencies [Hz] in so many seconds may differ from those of a record, in the unit
of the channel, and the cause of each, as a clause.
"""


class _Reasons(NamedTuple):
    """Reasons why a band passes nothing, or is not judged."""

    gaps: Gaps
    broken: str
    cycle: float
    """Time after which the motion repeats [s]; 0 where that is not known."""
    tolerances: Tolerances


def no_gaps(low: float, high: float, limit: float) -> Sequence[str]:
    """No reasons: of a recording, whose samples are all that there is."""
    return ()


def no_tolerances(low: float, high: float, seconds: float) -> Iterable[tuple[float, str]]:
    """No tolerances: of a recording, whose own are known."""
    return ()


def _tolerances_of_lines(
    table: LineTable, scenario: Scenario, second: LineTable | None
) -> Tolerances:
    """Tolerances of a simulated torque: other draws of its noise, other states of a second wing's hinge, and what
    a second drive adds.
    """

    def found(low: float, high: float, seconds: float) -> Iterator[tuple[float, str]]:
        noisy = noise_of_record(scenario, table)
        if noisy is not None and (rms := rms_of_noise(noisy, low, high)) > 0.0:
            crest = LINEAR_FACTOR * rms * crest_of_noise(high * seconds)
            yield crest, f"noise of {1e3 * rms:.3g} mN m RMS there, of which a run is one draw"
        inside = [x for x in table if low <= x.place <= high and math.isfinite(x.amplitude)]
        if (states := other_states(table, scenario)) is not None:
            changes = (
                max(
                    states.largest(x, x.amplitude) - x.amplitude,
                    x.amplitude - states.least(x, x.amplitude),
                )
                for x in inside
            )
            yield sum(changes), states.gap
        wing = scenario.driven_wing
        if wing is not None and second is not None:
            added = AddedTorque.of(second, wing.alone)
            within = (added.frequency >= low) & (added.frequency <= high)
            yield (
                float(np.sum(added.amplitude[within])),
                "what the second wing's drive adds about this axis",
            )

    return found


def reasons_of_lines(
    table: LineTable, scenario: Scenario | None, second: LineTable | None = None
) -> dict[str, Any]:
    """Reasons for ``judge_bands`` of simulated lines, for which a limit on each would not be judged
    either: what a record does not settle, what other draws of noise make, what the integration leaves
    open.
    """

    def gaps(low: float, high: float, limit: float) -> Sequence[str]:
        return judge(table, Limit(Si(limit), Si(low), Si(high)), scenario, second).gaps

    reasons = {"gaps": gaps, "broken": failed_invariants_reason(table.broken, scenario)}
    if scenario is None:
        return reasons
    return {**reasons, "tolerances": _tolerances_of_lines(table, scenario, second)}


def judge_bands(  # noqa: PLR0913 - keyword options
    recording: Recording,
    limits: Sequence[BandLimit],
    channel: str = "Mz",
    *,
    roll_off: float | None = None,
    background: Recording | None = None,
    gaps: Gaps = no_gaps,
    broken: str = "",
    cycle: float = 0.0,
    tolerances: Tolerances = no_tolerances,
) -> tuple[BandPeak, ...]:
    """Judge the peak of a channel's time history in each band.

    What the force table changes and is not corrected counts with three standard uncertainties, the
    peak of a background as a whole: it may add to the drive's, or hide as much of it.

    Parameters
    ----------
    recording : Recording
        Samples in SI.
    limits : sequence of BandLimit
        Bands and their limits.
    channel : str
        Channel of the bands that name none.
    roll_off : float, optional
        Part of an edge's frequency, on both sides, within which filters fall from 1 to 0; without it
        0.2, or less where a band is narrow.
    background : Recording, optional
        The table with the drive off, prepared alike.
    gaps : callable, optional
        Further reasons why a band passes nothing.
    broken : str
        Reason why no band is judged, such as invariants of a simulation that do not hold.
    cycle : float
        Time [s] after which the motion is known to repeat, of which a part passes nothing; 0 where that is
        not known.
    tolerances : callable, optional
        By how much peaks may differ from those of the record, and why.

    Returns
    -------
    tuple of BandPeak
        Peaks and verdicts, in the order of the limits.

    Raises
    ------
    MicrovibError
        Where a limit has another unit than its channel, or a channel is missing or unfit.
    """
    if roll_off is not None and not ROLL_OFFS[0] <= roll_off <= ROLL_OFFS[1]:
        low, high = ROLL_OFFS
        raise OptionError("roll_off", f"{roll_off:g} is not allowed; from {low:g} to {high:g}")
    found = []
    for limit in limits:
        name = limit.channel or channel
        require_usable_channel(recording, name, acceleration=True)
        unit = recording.units[name]
        if unit != limit.unit:
            raise MicrovibError(
                f"bands: the limit from {limit.low:g} to {limit.high:g} Hz is in"
                f" {pretty(limit.unit)}, and channel {name} is in {pretty(unit)}"
            )
        reasons = _Reasons(gaps, broken, cycle, tolerances)
        found.append(_judged((recording, background), name, limit, roll_off, reasons))
    return tuple(found)


def judge_bands_of_run(
    result: RunResult, limits: Sequence[BandLimit], roll_off: float | None = None
) -> tuple[BandPeak, ...]:
    """Judge the peaks of a run's disturbance torque in bands, as ``judge_bands`` does those of a
    recording; what keeps its lines from passing keeps bands from it, too.

    OptionError where the run kept no motion, or its noise was drawn several times.
    """
    if not limits:
        return ()
    if result.motion is None:
        raise OptionError("bands", "need the motion; leave lines_only out")
    if result.table.seeds:
        raise OptionError("bands", "are judged by one motion; leave seeds out")
    x, rate, unit = samples_of(result.motion)
    # on a craft Mx, My, Mz are loads on the hub in its own axes
    on_craft = result.scenario.spacecraft is not None
    axis = TORQUE_CHANNEL if on_craft else "M" + result.scenario.array.drive_axis
    _expect_torque(limits, axis)
    recording = Recording({axis: x}, rate, {axis: unit}, result.scenario.title)
    second = None if result.second is None else result.second.table
    reasons = reasons_of_lines(result.table, result.scenario, second)
    cycle = float(result.solver.get("period_s", 0.0))
    return judge_bands(recording, limits, axis, roll_off=roll_off, cycle=cycle, **reasons)


def _expect_torque(limits: Sequence[BandLimit], axis: str) -> None:
    """OptionError for a limit of another channel than a run's torque."""
    for limit in limits:
        if limit.channel not in (None, "", axis):
            raise OptionError(
                "bands",
                f"channel {limit.channel} is a load that a run's bands do not judge; they are of the disturbance"
                f" torque, {axis} (leave the channel out, or limit the load's lines by --limit)",
            )


def verdict_on(peaks: Sequence[BandPeak]) -> Verdict | NoVerdict:
    """Verdict on all bands together: the worst of theirs; empty where there are none."""
    return worst_verdict(peak.verdict for peak in peaks)


def _judged(
    recorded: tuple[Recording, Recording | None],
    name: str,
    limit: BandLimit,
    asked: float | None,
    reasons: _Reasons,
) -> BandPeak:
    recording, background = recorded
    rate = recording.sample_rate
    roll_off = roll_off_for(limit.low, limit.high) if asked is None else asked
    blind = reasons.broken or _blind_reason(recording, name, limit, roll_off)
    history = _history(recording, name, limit, roll_off)
    if history is None:
        nan = math.nan
        why = blind or _too_short(recording, limit, roll_off)
        return _row(name, limit, (nan, nan, nan, nan), roll_off, 0.0, ("not judged", why))
    looked_at = history.values.size / rate
    figures = (history.peak, history.least, history.largest, history.place / rate)
    ends = limit.low * (1.0 - roll_off), limit.high * (1.0 + roll_off)
    tolerances = (
        _tolerance_of_table(recording, name, limit, roll_off, history.largest),
        _tolerance_of_background(background, name, limit, roll_off),
        *(
            _Tolerance(size, why)
            for size, why in reasons.tolerances(*ends, looked_at)
            if size > 0.0
        ),
    )
    unseen = (
        _unseen_reason(limit, looked_at, reasons.gaps)
        or _part_of_cycle_reason(looked_at, recording.duration, reasons.cycle)
        or _loud_ends_reason(history, limit, rate)
    )
    verdict = _verdict(limit, figures, blind, unseen, tolerances)
    return _row(name, limit, figures, roll_off, looked_at, verdict)


def band_history(recording: Recording, peak: BandPeak) -> BandHistory | None:
    """The time history of which a peak is the largest magnitude; None where there is none."""
    if not math.isfinite(peak.peak):
        return None
    x = recording[peak.channel] - np.mean(recording[peak.channel])
    return split_band(x, recording.sample_rate, peak.low, peak.high, peak.roll_off)


def _history(
    recording: Recording, name: str, limit: BandLimit, roll_off: float
) -> BandHistory | None:
    """Time history of a band; None where a filter for it does not fit the record."""
    rate, x = recording.sample_rate, recording[name] - np.mean(recording[name])
    if limit.high * (1.0 + roll_off) >= 0.5 * rate or _narrow(limit, roll_off):
        return None
    return split_band(x, rate, limit.low, limit.high, roll_off)


def _tolerance_of_table(
    recording: Recording, name: str, limit: BandLimit, roll_off: float, largest: float
) -> _Tolerance:
    """Change of a band's peak by the force table: its resonances, or how well its response is known."""
    table = recording.table
    if table is None:
        return _Tolerance(0.0, "")
    low, high = limit.low * (1.0 - roll_off), limit.high * (1.0 + roll_off)
    frequency = np.linspace(max(low, 1e-3 * high), high, _GRID)
    sigma = max(table.amplitude_uncertainty(name, f, largest) for f in frequency.tolist())
    if not sigma > 0.0:
        return _Tolerance(0.0, "")
    part = 100.0 * _SIGMAS * sigma / largest
    return _Tolerance(_SIGMAS * sigma, f"the force table leaves it unsure by {part:.2g} %")


def _tolerance_of_background(
    background: Recording | None, name: str, limit: BandLimit, roll_off: float
) -> _Tolerance:
    """Part of a band's peak that may be the background's, or hidden by it."""
    if background is None or name not in background.channels:
        return _Tolerance(0.0, "")
    history = _history(background, name, limit, roll_off)
    if history is None:
        return _Tolerance(math.inf, "the background is shorter than the band's filter")
    milli = 1e3 * history.largest
    return _Tolerance(
        history.largest,
        f"the background has a peak of {milli:.3g} m{pretty(limit.unit)} there, which may add to the"
        " drive's or hide as much",
    )


def _row(
    name: str,
    limit: BandLimit,
    figures: tuple[float, float, float, float],
    roll_off: float,
    looked_at: float,
    verdict: tuple[Verdict, str],
) -> BandPeak:
    peak, least, largest, time = figures
    return BandPeak(
        name,
        limit.low,
        limit.high,
        limit.limit,
        peak,
        least,
        largest,
        time,
        roll_off,
        looked_at,
        limit.low * looked_at,
        *verdict,
        unit=limit.unit,
    )


def _verdict(
    limit: BandLimit,
    figures: tuple[float, float, float, float],
    blind: str,
    unseen: str,
    tolerances: Sequence[_Tolerance],
) -> tuple[Verdict, str]:
    """Verdict and reason. What was not seen passes nothing; a peak above the limit is one all the
    same, unless the record does not show the loads of this band.
    """
    peak, least, largest, _ = figures
    if blind:
        return "not judged", blind
    off = sum(one.size for one in tolerances)
    if least - off > limit.limit:
        return "fail", ""
    if unseen:
        return "not judged", unseen
    if max(largest, peak) + off <= limit.limit:
        return "pass", ""
    if least > limit.limit or largest <= limit.limit:
        return "not judged", "; ".join(one.why for one in tolerances if one.why)
    return "not judged", (
        "the filter decides: what is on the slopes of its edges puts the peak below or above the limit;"
        " a smaller roll-off, and a longer record, tell"
    )


def _narrow(limit: BandLimit, roll_off: float) -> bool:
    return limit.low * (1.0 + roll_off) >= limit.high * (1.0 - roll_off)


def _blind_reason(recording: Recording, name: str, limit: BandLimit, roll_off: float) -> str:
    """Reason why the record does not show the loads of a band, as a clause; empty where it does."""
    top, passband = limit.high * (1.0 + roll_off), PASSBAND * recording.sample_rate
    if _narrow(limit, roll_off):
        widest = (limit.high - limit.low) / (limit.high + limit.low)
        return f"the band is narrower than the filter's roll-off; below {widest:.3g} it has a peak"
    if top > passband:
        return (
            f"the filter reaches up to {top:.4g} Hz, and {recording.sample_rate:g} samples a second"
            f" show loads up to {passband:.4g} Hz"
        )
    for part in recording.unusable(name):
        if part.low < top and limit.low * (1.0 - roll_off) < part.high:
            return part.why
    return ""


def _too_short(recording: Recording, limit: BandLimit, roll_off: float) -> str:
    needed = 2.0 * filter_reach(limit.low, limit.high, roll_off)
    if limit.low > 0.0:
        needed += MIN_CYCLES / limit.low
    return f"the filter is longer than the record of {recording.duration:.4g} s; {needed:.3g} s would do"


def _loud_ends_reason(history: BandHistory, limit: BandLimit, rate: float) -> str:
    """Reason why the ends of a record, which are the filter's transients, may hold a peak above the
    limit, as a clause; empty where they may not, or the rest does anyway.
    """
    height = history.ends if history.ends <= _AS_LOUD else _OF_PIECE * history.ends
    if height * history.largest <= limit.limit or history.largest > limit.limit:
        return ""
    times = f"up to {history.ends:.2g} times" if history.ends < 100.0 else "over 100 times"
    return (
        f"the first and the last {history.first / rate:.3g} s, which are the filter's transients, are {times}"
        " as loud as the rest (a longer record around it)"
    )


def _part_of_cycle_reason(looked_at: float, duration: float, cycle: float) -> str:
    """Reason why a record shows a part of a motion that repeats, as a clause; empty where it shows all."""
    if looked_at >= cycle:
        return ""
    needed = rounded_up(duration - looked_at + cycle)
    return (
        f"{looked_at:.4g} s are left behind the filter's transients, and the steady state repeats after"
        f" {cycle:.4g} s (record.duration >= {needed} s)"
    )


def _unseen_reason(limit: BandLimit, looked_at: float, gaps: Gaps) -> str:
    """Reason why more may be in a band than the record shows, as a clause; empty where not."""
    if limit.low == 0.0:
        least = MIN_CYCLES / looked_at
        return (
            "a band from 0 Hz holds changes slower than the record; from"
            f" {least:.3g} Hz on it is told"
        )
    if limit.low * looked_at < MIN_CYCLES:
        return (
            f"{limit.low * looked_at:.2g} cycles of the lower edge are left behind the filter's"
            f" transients; {MIN_CYCLES:g} are needed"
        )
    return next(iter(gaps(limit.low, limit.high, limit.limit)), "")
