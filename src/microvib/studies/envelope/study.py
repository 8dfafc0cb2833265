"""Envelopes of lines, amplitude spectra and densities over many runs or recordings, band by band, and
their verdict against a limit.

Lines are the truth: each counts at its own frequency, in every band that it may be in. Whatever is
known of a member is an interval, from what was seen to what may be there at most; a statistic of such
intervals is one again, and passes or fails only as a whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from microvib.analysis.margins import NoVerdict, Verdict, worst_verdict
from microvib.errors import OptionError
from microvib.model.scenario import GivenScenario
from microvib.results import (
    COUNT,
    DECIBEL,
    FREQUENCY,
    LINE_FREQUENCY,
    TIME,
    TORQUE,
    TORQUE_LIMIT,
    Column,
    Measure,
)
from microvib.signals.frequency_bands import Bandwidth
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.solve.integration import Progress
from microvib.studies.envelope.evidence import Evidence, Judged, SeenLine
from microvib.studies.envelope.members import (
    DRIVE_TORQUE,
    GivenMember,
    Member,
    Opened,
    Reading,
    members_of,
)
from microvib.studies.envelope.spectra import (
    NO_SAMPLES,
    InBands,
    amplitudes_in_bands,
    densities_in_bands,
    mean_square,
)
from microvib.studies.envelope.statistics import (
    QUANTILES,
    WORDS,
    Interval,
    Statistic,
    checked_statistics,
    members_needed,
    statistic_of,
)
from microvib.testdata.preparation import Preparation
from microvib.units import GivenQuantity, quantity

BANDWIDTH, RESOLUTION = "1/3 octave", "1 Hz"
NOT_DRAWN = (
    "rates, angles and levels are chosen and not drawn by chance: of them a percentile says nothing"
)
_EDGE = Measure("Hz", form=".5g")
DENSITY = Measure(
    "N² m²/Hz", form=".4g", units=(("N² m²/Hz", 1.0), ("mN² m²/Hz", 1e-6), ("µN² m²/Hz", 1e-12))
)


@dataclass(frozen=True)
class LineBand:
    """A statistic of the members' lines in one band, against the limit."""

    statistic: Annotated[
        Statistic, Column("statistic", "of members", words=WORDS.__getitem__, role="group")
    ]
    low: Annotated[float, Column("low_hz", "from", _EDGE)]
    high: Annotated[float, Column("high_hz", "to", _EDGE)]
    value: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE, absent="?")]
    """Statistic of each member's largest line in the band; one without a line counts as 0."""
    at_least: Annotated[float, Column("at_least_n_m", measure=TORQUE)]
    at_most: Annotated[float, Column("at_most_n_m", "at most", TORQUE, absent="?")]
    """With what was not seen; nan where that is not known."""
    members: Annotated[int, Column("members", "members", COUNT)]
    """Members that have such a line."""
    worst: Annotated[str, Column("worst", "worst member")]
    """The one of all members, whatever the statistic."""
    line: Annotated[str, Column("line", "its line")]
    frequency: Annotated[float, Column("frequency_hz", "at", LINE_FREQUENCY)]
    worst_amplitude: Annotated[float, Column("worst_amplitude_n_m", measure=TORQUE)]
    allowed: Annotated[float, Column("limit_n_m", "limit", TORQUE_LIMIT)]
    """The least that is allowed where the worst member's line may be."""
    ratio: float
    """The statistic of amplitudes over what is allowed at each one's own frequency; nan without a
    limit."""
    margin_of_band: Annotated[float, Column("margin_of_band_db", measure=DECIBEL)]
    """Least limit anywhere in the band over the largest amplitude in it [dB]: what a reader of the
    picture sees, and less than the margin where a notch is beside the line."""
    lower_edge_limit: Annotated[float, Column("limit_at_low_n_m", measure=TORQUE_LIMIT)]
    upper_edge_limit: Annotated[float, Column("limit_at_high_n_m", measure=TORQUE_LIMIT)]
    verdict: Annotated[Verdict | NoVerdict, Column("verdict", "verdict", role="verdict")]
    why: Annotated[str, Column("why")]
    bandwidth: Annotated[str, Column("bandwidth")]

    @property
    def margin(self) -> Annotated[float, Column("margin_db", "margin", DECIBEL)]:
        """The limit over the statistic [dB]; nan without one, and where there is no line."""
        return _decibel(self.ratio)


@dataclass(frozen=True)
class FigureBand:
    """A statistic of an amplitude spectrum in one band."""

    statistic: Annotated[
        Statistic, Column("statistic", "of members", words=WORDS.__getitem__, role="group")
    ]
    low: Annotated[float, Column("low_hz", "from", _EDGE)]
    high: Annotated[float, Column("high_hz", "to", _EDGE)]
    value: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE, absent="?")]
    at_most: Annotated[float, Column("at_most_n_m", "at most", TORQUE, absent="?")]
    """Upper bound of a percentile, with 95 % confidence."""
    members: Annotated[int, Column("members", "members", COUNT)]
    """Members whose record shows this band."""
    worst: Annotated[str, Column("worst", "worst member")]
    bandwidth: Annotated[str, Column("bandwidth")]
    noise_bandwidth: Annotated[float, Column("noise_bandwidth_hz", measure=FREQUENCY)]


@dataclass(frozen=True)
class DensityBand:
    """A statistic of the density in one band."""

    statistic: Annotated[
        Statistic, Column("statistic", "of members", words=WORDS.__getitem__, role="group")
    ]
    low: Annotated[float, Column("low_hz", "from", _EDGE)]
    high: Annotated[float, Column("high_hz", "to", _EDGE)]
    value: Annotated[float, Column("density_per_hz", "density", DENSITY, absent="?")]
    at_most: Annotated[float, Column("at_most_per_hz", "at most", DENSITY, absent="?")]
    members: Annotated[int, Column("members", "members", COUNT)]
    worst: Annotated[str, Column("worst", "worst member")]
    bandwidth: Annotated[str, Column("bandwidth")]


@dataclass(frozen=True)
class CurvePoint:
    """A point of the limit's curve, and the envelope there."""

    statistic: Annotated[
        Statistic, Column("statistic", "of members", words=WORDS.__getitem__, role="group")
    ]
    frequency: Annotated[float, Column("frequency_hz", "point", _EDGE)]
    allowed: Annotated[float, Column("limit_n_m", "limit", TORQUE_LIMIT)]
    value: Annotated[float, Column("amplitude_n_m", "envelope there", TORQUE, absent="?")]
    """The largest of the bands that the point is in."""
    line: Annotated[str, Column("line", "nearest line")]
    """Line of any member that is nearest to the point, by the ratio of frequencies."""
    line_frequency: Annotated[float, Column("line_hz", "at", LINE_FREQUENCY)]

    @property
    def margin(self) -> Annotated[float, Column("margin_db", "margin", DECIBEL)]:
        """The limit over the envelope [dB]."""
        return _decibel(self.value / self.allowed)


@dataclass(frozen=True)
class MemberRow:
    """One member and its own verdict."""

    name: Annotated[str, Column("member", "member")]
    kind: Annotated[str, Column("kind")]
    values: Annotated[str, Column("values")]
    duration: Annotated[float, Column("record_s", "record", TIME)]
    sample_rate: Annotated[float, Column("sample_rate_hz", measure=FREQUENCY)]
    looked_from: Annotated[float, Column("looked_from_hz", measure=FREQUENCY)]
    looked_to: Annotated[float, Column("looked_to_hz", "looked to", FREQUENCY)]
    """Frequencies between which lines were looked for."""
    lines: Annotated[int, Column("lines", "lines", COUNT)]
    line: Annotated[str, Column("line", "nearest line")]
    """Without a limit the largest."""
    frequency: Annotated[float, Column("frequency_hz", "at", LINE_FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    allowed: Annotated[float, Column("limit_n_m", measure=TORQUE_LIMIT)]
    mean_square: Annotated[float, Column("mean_square")]
    """Mean square of all bands of its density, in the channel's unit squared."""
    verdict: Annotated[Verdict | NoVerdict, Column("verdict", "verdict", role="verdict")]
    why: Annotated[str, Column("why", "why", report_only=True)]

    @property
    def margin(self) -> Annotated[float, Column("margin_db", "margin", DECIBEL)]:
        """The limit over that line [dB]."""
        return _decibel(self.amplitude / self.allowed)


@dataclass(frozen=True)
class StatisticVerdict:
    """The verdict on one statistic in all of the limit's range."""

    statistic: Statistic
    verdict: Verdict | NoVerdict
    why: str
    """Why it is not judged."""
    worst: LineBand | None
    """Band with the smallest margin."""


@dataclass(frozen=True)
class ChannelEnvelope:
    """Envelopes of one channel."""

    channel: str
    unit: str
    curve: LimitCurve | None
    """The part of the limit that it is judged by."""
    bands: tuple[LineBand, ...]
    spectrum: tuple[FigureBand, ...]
    density: tuple[DensityBand, ...]
    points: tuple[CurvePoint, ...]
    members: tuple[MemberRow, ...]
    verdicts: tuple[StatisticVerdict, ...]
    levels: dict[str, dict[tuple[float, float], float]]
    """Largest line of each member by its name and the edges [Hz] of bands, for pictures."""
    spectra: dict[str, dict[tuple[float, float], float]]
    """Amplitude spectrum of each member that has one, likewise."""
    densities: dict[str, dict[tuple[float, float], float]]
    """Density of each member that has one, likewise."""
    lines: tuple[tuple[str, SeenLine], ...]
    """All lines that were seen, each with the member that has it."""
    without_samples: tuple[tuple[str, str], ...]
    """Members that are in no spectrum or density, and why."""

    @property
    def verdict(self) -> Verdict | NoVerdict:
        """The verdict on all statistics together."""
        return worst_verdict(x.verdict for x in self.verdicts)


@dataclass(frozen=True)
class Envelope:
    """Envelopes over members."""

    bandwidth: Bandwidth
    resolution: float
    """Noise bandwidth of the amplitude spectra [Hz]."""
    statistics: tuple[Statistic, ...]
    members: int
    drawn: bool
    """Whether all members may be draws of one population."""
    limit: Limit | None
    channels: tuple[ChannelEnvelope, ...]

    @property
    def verdict(self) -> Verdict | NoVerdict:
        """The verdict on all channels together."""
        return worst_verdict(x.verdict for x in self.channels)

    def __repr__(self) -> str:
        judged = f", {self.verdict}" if self.verdict else ""
        return f"Envelope of {self.members} members in {self.bandwidth.words}{judged}"


def envelope(  # noqa: PLR0913 - keyword options
    members: Sequence[GivenMember],
    *,
    channels: Sequence[str] = (),
    statistics: Sequence[str] = ("max",),
    limit: Limit | None = None,
    bandwidth: GivenQuantity = BANDWIDTH,
    resolution: GivenQuantity = RESOLUTION,
    scenario: GivenScenario | None = None,
    preparation: Preparation | None = None,
    progress: Progress | None = None,
) -> Envelope:
    """Find the envelopes of lines, amplitude spectra and densities over runs and recordings.

    Parameters
    ----------
    members : sequence of str, path, Recording, Prepared, Run, RunResult or NamedMember
        Folders of runs, rate plans, campaigns, sweeps over angles and orbits, folders of such
        folders, recordings and tables of lines.
    channels : sequence of str
        ``"T_d"``, the torque about the drive axis, loads ``"Fx"`` to ``"Mz"``, or other channels of
        recordings; without any those that the limit has curves for, or T_d.
    statistics : sequence of {"max", "p95", "p99", "mean"}
        Statistics over the members.
    limit : Limit, optional
        Largest amplitude of a line, 0-to-peak.
    bandwidth : str or Si
        Bands, such as ``"1/3 octave"``, ``"2 Hz"`` or ``"5 percent"``.
    resolution : str or Si
        Noise bandwidth of the amplitude spectra.
    scenario : Scenario, str or path, optional
        Names the lines of recordings.
    preparation : Preparation, optional
        What is done to recordings before they are used.
    progress : callable, optional
        Called as ``progress(done, total)``, with the number of members.

    Returns
    -------
    Envelope
        Statistics in each band with their verdicts, and what each member tells.

    Raises
    ------
    MicrovibError
        Where a member cannot be read, is given twice, or there is none.
    OptionError
        For a channel, statistic, bandwidth or resolution that is none.

    Examples
    --------
    >>> import microvib as mv
    >>> import numpy as np
    >>> t = np.arange(8192) / 1024.0
    >>> runs = [
    ...     mv.Recording({"Mz": a * np.sin(2.0 * np.pi * 53.0 * t + a)}, 1024.0, {"Mz": "N*m"}, f"run {a}")
    ...     for a in (0.01, 0.02)
    ... ]
    >>> found = mv.envelope(runs, limit=mv.Limit("15 mN*m", "40 Hz", "70 Hz"))
    >>> found.verdict, found.channels[0].verdicts[0].worst.worst
    ('fail', 'run 0.02')
    """
    asked = checked_statistics(statistics)
    bands = Bandwidth.of(bandwidth)
    noise_width = quantity("resolution", resolution, "Hz", positive=True)
    found = members_of(members, Reading.of(scenario, preparation))
    named = _channels(channels, limit)
    told = _read(found, named, bands, noise_width, progress)
    drawn = all(member.drawn for member in found)
    how = (bands, noise_width, asked, drawn)
    each = (_Channel(name, _curve_of(name, limit), *how, told[name]).envelope() for name in named)
    return Envelope(bands, noise_width, asked, len(found), drawn, limit, tuple(each))


def _channels(given: Sequence[str], limit: Limit | None) -> tuple[str, ...]:
    """Channels that are looked at, each once."""
    if isinstance(given, str):
        raise OptionError("channel", f"'{given}' is text; a list of channels is expected")
    if given:
        return tuple(dict.fromkeys(given))
    if limit is None:
        return (DRIVE_TORQUE,)
    return (*((DRIVE_TORQUE,) if limit.curve is not None else ()), *limit.loads)


def _curve_of(channel: str, limit: Limit | None) -> LimitCurve | None:
    if limit is None:
        return None
    return limit.curve if channel == DRIVE_TORQUE else limit.loads.get(channel)


@dataclass(frozen=True)
class _Told:
    """One member's evidence of a channel, and its spectra in bands."""

    member: Member
    evidence: Evidence
    spectrum: InBands
    density: InBands

    @property
    def without_samples(self) -> str:
        """Why it is not in a spectrum or density; empty where it is in both."""
        return self.spectrum.why or self.density.why


def _read(
    members: Sequence[Member],
    channels: Sequence[str],
    bandwidth: Bandwidth,
    resolution: float,
    progress: Progress | None,
) -> dict[str, list[_Told]]:
    """Evidence of each member on each channel; of its samples nothing is kept."""
    told: dict[str, list[_Told]] = {name: [] for name in channels}
    for done, member in enumerate(members):
        if progress is not None:
            progress(done, len(members))
        opened = member.open()
        for name in channels:
            told[name].append(_told(member, opened, name, bandwidth, resolution))
    if progress is not None:
        progress(len(members), len(members))
    return told


def _told(
    member: Member, opened: Opened, channel: str, bandwidth: Bandwidth, resolution: float
) -> _Told:
    evidence = opened.evidence(channel)
    if evidence.missing:
        nothing = InBands({}, evidence.missing)
        return _Told(member, evidence, nothing, nothing)
    samples = opened.samples(channel)
    if samples is None:
        return _Told(member, evidence, NO_SAMPLES, NO_SAMPLES)
    x = np.asarray(samples.values, dtype=float)
    return _Told(
        member,
        evidence,
        amplitudes_in_bands(x, samples.rate, bandwidth, resolution),
        densities_in_bands(x, samples.rate, bandwidth),
    )


class _InBand(NamedTuple):
    """One member in one band."""

    amplitude: Interval
    """Amplitude of its largest line; 0 without one."""
    ratio: Interval
    """Amplitude of the line that is nearest to its limit, over what is allowed to it."""
    line: SeenLine | None
    """That line; without a limit the largest."""
    verdict: Verdict | NoVerdict
    why: str


_NO_LINE = SeenLine("", math.nan, math.nan, math.nan, math.nan)
_NOTHING_KNOWN = Interval(0.0, 0.0, math.inf)
_NO_RATIO = Interval(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class _Channel:
    """One channel of all members, from which envelopes are made."""

    name: str
    curve: LimitCurve | None
    bandwidth: Bandwidth
    resolution: float
    statistics: tuple[Statistic, ...]
    drawn: bool
    told: list[_Told]

    def envelope(self) -> ChannelEnvelope:
        """The envelopes with all that they are made of."""
        whole, ends = self._whole(), self._ends()
        judged = [
            self._judged_in(ends, x.evidence, own) for x, own in zip(self.told, whole, strict=True)
        ]
        by_band = [self._members_in(k, each, whole, judged) for k, each in enumerate(ends)]
        bands = [
            self._line_band(statistic, *each, found)
            for statistic in self.statistics
            for each, found in zip(ends, by_band, strict=True)
        ]
        lines = tuple((x.member.name, line) for x in self.told for line in x.evidence.lines)
        return ChannelEnvelope(
            self.name,
            self._unit(),
            self.curve,
            tuple(bands),
            tuple(self._spectra()),
            tuple(self._densities()),
            tuple(self._points(bands, lines)),
            tuple(self._member_row(*each) for each in zip(self.told, whole, strict=True)),
            tuple(self._verdict(x, bands, whole) for x in self.statistics),
            self._levels(ends, by_band),
            self._by_member([x.spectrum for x in self.told]),
            self._by_member([x.density for x in self.told]),
            lines,
            tuple((x.member.name, x.without_samples) for x in self.told if x.without_samples),
        )

    def _whole(self) -> list[Judged | None]:
        """Each member's verdict against all of the limit; None without one."""
        if self.curve is None:
            return [None] * len(self.told)
        return [x.evidence.judge(self.curve) for x in self.told]

    def _unit(self) -> str:
        """The unit that all members have that show the channel."""
        known = {x.evidence.unit for x in self.told if not x.evidence.missing}
        if len(known) > 1:
            raise OptionError(
                "channel", f"{self.name} is in different units: {', '.join(sorted(known))}"
            )
        if known:
            return next(iter(known))
        named = [x.evidence.unit for x in self.told if x.evidence.unit]
        if self.curve is None or not named:
            reasons = "; ".join(dict.fromkeys(x.evidence.missing for x in self.told))
            raise OptionError("channel", f"{self.name} is in no member: {reasons}")
        return named[0]

    def _ends(self) -> list[tuple[float, float]]:
        """Edges [Hz] of the bands that have a line or are limited, cut at the ends of the limit."""
        low, high = (0.0, math.inf) if self.curve is None else (self.curve.low, self.curve.high)
        numbers: set[int] = set()
        for each in self.told:
            for x in each.evidence.lines:
                first, last = max(x.low, low), min(x.high, high)
                if first <= last:
                    numbers.update(self.bandwidth.touching(first, last))
        if self.curve is not None:
            top = high if math.isfinite(high) else self._highest()
            if low < top:
                numbers.update(self.bandwidth.touching(low, top))
        ends = [self.bandwidth.ends(k) for k in sorted(numbers)]
        cut = [(max(a, low), min(b, high)) for a, b in ends]
        return [(a, b) for a, b in cut if b > a * (1.0 + 1e-8)]

    def _highest(self) -> float:
        """Highest frequency [Hz] that is looked at."""
        tops = (x.evidence.high for x in self.told if math.isfinite(x.evidence.high))
        return max(
            [*tops, *(line.high for x in self.told for line in x.evidence.lines)], default=0.0
        )

    def _judged_in(
        self, ends: Sequence[tuple[float, float]], of: Evidence, whole: Judged | None
    ) -> list[Judged | None]:
        """A member's verdicts on what is in each band, beside lines at its edges: where many bands
        together pass, each does.
        """
        found: list[Judged | None] = [whole] * len(ends)
        if whole is None or whole.verdict == "pass" or of.missing:
            return found
        parts = [(0, len(ends))]
        while parts:
            first, stop = parts.pop()
            if first == stop:
                continue
            assert self.curve is not None
            part = self.curve.within(ends[first][0], ends[stop - 1][1])
            judged = None if part is None else of.judge(part)
            if stop - first == 1 or judged is None or judged.verdict == "pass":
                found[first:stop] = [judged] * (stop - first)
            else:
                middle = (first + stop) // 2
                parts += [(first, middle), (middle, stop)]
        return found

    def _members_in(
        self,
        k: int,
        ends: tuple[float, float],
        whole: Sequence[Judged | None],
        judged: Sequence[Sequence[Judged | None]],
    ) -> list[_InBand]:
        """All members in the band with the index ``k``."""
        return [
            self._member_in(ends, x.evidence, whole[n], judged[n][k])
            for n, x in enumerate(self.told)
        ]

    def _member_in(
        self, ends: tuple[float, float], of: Evidence, whole: Judged | None, judged: Judged | None
    ) -> _InBand:
        low, high = ends
        part = None if self.curve is None else self.curve.within(low, high)
        if of.missing:
            verdict: Verdict | NoVerdict = "" if part is None else "not judged"
            ratio = _NO_RATIO if part is None else _NOTHING_KNOWN
            return _InBand(_NOTHING_KNOWN, ratio, None, verdict, of.missing if verdict else "")
        there = _within(of.lines, low, high)
        amplitude = _largest(there, of.at_most(low, high))
        if part is None or whole is None or judged is None:
            largest = max(there, key=lambda x: x.amplitude, default=None)
            return _InBand(amplitude, _NO_RATIO, largest, "", "")
        lines = _within(whole.lines, low, high)
        return _InBand(
            amplitude,
            _ratio(lines, judged, of.hidden_over(part)),
            max((x for x in lines if x.seen), key=_over_allowed, default=None),
            *_verdict_of_member(lines, judged),
        )

    def _line_band(
        self, statistic: Statistic, low: float, high: float, found: Sequence[_InBand]
    ) -> LineBand:
        value = statistic_of(statistic, *_columns(x.amplitude for x in self._known(found)))
        most = statistic_of(statistic, *_columns(x.amplitude for x in found)).high
        member, line = self._worst(found)
        against = self._against_limit(statistic, low, high, found)
        return LineBand(
            statistic,
            low,
            high,
            value.value,
            value.low,
            most if math.isfinite(most) else math.nan,
            sum(x.amplitude.value > 0.0 for x in found),
            member,
            line.name,
            line.frequency,
            line.amplitude,
            line.allowed,
            *against,
            self.bandwidth.words,
        )

    def _against_limit(
        self, statistic: Statistic, low: float, high: float, found: Sequence[_InBand]
    ) -> tuple[float, float, float, float, Verdict | NoVerdict, str]:
        """Ratio of a statistic to the limit, margin of the band [dB], limit at both edges, verdict and
        why it is not judged.
        """
        curve = self.curve
        if curve is None:
            return math.nan, math.nan, math.nan, math.nan, "", ""
        ratio = statistic_of(statistic, *_columns(x.ratio for x in found))
        value = statistic_of(statistic, *_columns(x.ratio for x in self._known(found))).value
        top = max((x.amplitude.value for x in found), default=0.0)
        of_band = _decibel(top / float(curve.strictest(low, high)))
        edges = float(curve.at(low)), float(curve.at(high))
        return value, of_band, *edges, *self._verdict_in(statistic, ratio, found)

    def _known(self, found: Sequence[_InBand]) -> list[_InBand]:
        """Members of a band that show the channel."""
        return [x for x, of in zip(found, self.told, strict=True) if not of.evidence.missing]

    def _worst(self, found: Sequence[_InBand]) -> tuple[str, SeenLine]:
        """The member nearest to the limit, or without one that with the largest line, and that line; of
        equal ones the first by name, so that their order does not matter.
        """

        def rank(k: int) -> tuple[float, str]:
            size = found[k].amplitude.value if self.curve is None else found[k].ratio.value
            return -size, self.told[k].member.name

        k = min(range(len(found)), key=rank)
        line = found[k].line
        if line is None:
            return "", _NO_LINE
        return self.told[k].member.name, line

    def _verdict_in(
        self, statistic: Statistic, ratio: Interval, found: Sequence[_InBand]
    ) -> tuple[Verdict, str]:
        """The verdict on a statistic in one band, and why it is not judged."""
        unknown = self._unknown(found)
        if statistic == "max":
            verdict = worst_verdict(x.verdict for x in found) or "pass"
            return verdict, unknown if verdict == "not judged" else ""
        if statistic in QUANTILES and not self.drawn:
            return "not judged", NOT_DRAWN
        if ratio.low > 1.0:
            return "fail", ""
        if unknown:
            return "not judged", unknown
        if statistic in QUANTILES and math.isnan(ratio.high):
            return "not judged", _too_few(statistic, len(found))
        if ratio.high <= 1.0:
            return "pass", ""
        return "not judged", (
            f"the {WORDS[statistic]} lies between {ratio.low:.4g} and {ratio.high:.4g} of the limit"
        )

    def _unknown(self, found: Iterable[_InBand | Judged]) -> str:
        """Reasons why members are not judged; empty where all are."""
        return _reasons(
            (of.member.name, x.why)
            for x, of in zip(found, self.told, strict=True)
            if x.verdict == "not judged"
        )

    def _verdict(
        self, statistic: Statistic, bands: Sequence[LineBand], whole: Sequence[Judged | None]
    ) -> StatisticVerdict:
        """The verdict on a statistic in all of the limit's range. That on the maximum is of each member
        as a whole, and so does not depend on the bands."""
        if self.curve is None:
            return StatisticVerdict(statistic, "", "", None)
        own = [x for x in bands if x.statistic == statistic]
        worst = max((x for x in own if x.ratio > 0.0), key=lambda x: x.ratio, default=None)
        judged = [x for x in whole if x is not None]
        unknown = self._unknown(judged)
        if statistic == "max":
            verdict = worst_verdict(x.verdict for x in judged) or "pass"
            return StatisticVerdict(statistic, verdict, unknown if verdict != "fail" else "", worst)
        return StatisticVerdict(statistic, *_over_bands(own, unknown), worst)

    def _spectra(self) -> Iterable[FigureBand]:
        for each in self._figures([x.spectrum for x in self.told]):
            yield FigureBand(*each, self.resolution)

    def _densities(self) -> Iterable[DensityBand]:
        for each in self._figures([x.density for x in self.told]):
            yield DensityBand(*each)

    def _figures(
        self, found: Sequence[InBands]
    ) -> Iterable[tuple[Statistic, float, float, float, float, int, str, str]]:
        """Statistics of figures in the bands that any member has."""
        numbers = sorted({k for x in found for k in x.figures})
        for statistic in self.statistics:
            for k in numbers:
                there = {
                    of.member.name: x.figures[k]
                    for x, of in zip(found, self.told, strict=True)
                    if k in x.figures
                }
                values = np.array(list(there.values()))
                of_all = statistic_of(statistic, values, values, values)
                worst = min(there, key=lambda name: (-there[name], name))
                yield (
                    statistic,
                    *self.bandwidth.ends(k),
                    of_all.value,
                    of_all.high,
                    len(there),
                    worst,
                    self.bandwidth.words,
                )

    def _points(
        self, bands: Sequence[LineBand], lines: Sequence[tuple[str, SeenLine]]
    ) -> Iterable[CurvePoint]:
        """The envelope at the curve's own points."""
        if self.curve is None or self.curve.is_flat:
            return
        for statistic in self.statistics:
            own = [x for x in bands if x.statistic == statistic]
            for f, allowed in zip(self.curve.frequency, self.curve.amplitude, strict=True):
                there = [x.value for x in own if x.low * (1 - 1e-9) <= f <= x.high * (1 + 1e-9)]
                near = min(
                    (x for _, x in lines if x.frequency > 0.0),
                    key=lambda x, f=f: (abs(math.log(x.frequency / f)), x.name),  # type: ignore[misc]
                    default=None,
                )
                yield CurvePoint(
                    statistic,
                    f,
                    allowed,
                    max(there, default=math.nan),
                    "" if near is None else near.name,
                    math.nan if near is None else near.frequency,
                )

    def _member_row(self, told: _Told, judged: Judged | None) -> MemberRow:
        of = told.evidence
        if judged is None:
            top = max(of.lines, key=lambda x: x.amplitude, default=_NO_LINE)
        else:
            seen = (x for x in judged.lines if x.seen)
            top = max(seen, key=_over_allowed, default=_NO_LINE)
        return MemberRow(
            told.member.name,
            told.member.kind,
            told.member.values,
            of.duration,
            of.sample_rate,
            of.low if math.isfinite(of.low) else math.nan,
            of.high if 0.0 < of.high < math.inf else math.nan,
            len(of.lines),
            top.name,
            top.frequency,
            top.amplitude,
            top.allowed,
            mean_square(told.density, self.bandwidth),
            "" if judged is None else judged.verdict,
            of.missing or ("" if judged is None else judged.why),
        )

    def _by_member(self, found: Sequence[InBands]) -> dict[str, dict[tuple[float, float], float]]:
        """Figures of each member that has some."""
        return {
            of.member.name: {self.bandwidth.ends(k): value for k, value in x.figures.items()}
            for x, of in zip(found, self.told, strict=True)
            if x.figures
        }

    def _levels(
        self, ends: Sequence[tuple[float, float]], by_band: Sequence[Sequence[_InBand]]
    ) -> dict[str, dict[tuple[float, float], float]]:
        return {
            x.member.name: {
                band: found[k].amplitude.value for band, found in zip(ends, by_band, strict=True)
            }
            for k, x in enumerate(self.told)
        }


def _within(lines: Iterable[SeenLine], low: float, high: float) -> list[SeenLine]:
    """Lines that may be between two frequencies [Hz]."""
    return [x for x in lines if x.low <= high * (1 + 1e-9) and x.high >= low * (1 - 1e-9)]


def _verdict_of_member(lines: Sequence[SeenLine], judged: Judged) -> tuple[Verdict, str]:
    """The verdict on a member in a band: of its lines there by the whole limit, since one at an edge may
    be on either side, and of what else is there.
    """
    if any(x.verdict == "fail" for x in lines):
        return "fail", ""
    undecided = [x.name for x in lines if x.verdict == "not judged"]
    if undecided:
        return "not judged", judged.why or f"{', '.join(undecided[:2])} may be above the limit"
    return judged.verdict, judged.why


def _over_bands(bands: Sequence[LineBand], unknown: str) -> tuple[Verdict, str]:
    """The verdict on a statistic over all bands, and why it is not judged: where members are ``unknown``
    that no band shows, too.
    """
    verdict = worst_verdict(x.verdict for x in bands) or "pass"
    if verdict == "fail" or (verdict == "pass" and not unknown):
        return verdict, ""
    return "not judged", next((x.why for x in bands if x.verdict == "not judged"), unknown)


def _largest(lines: Sequence[SeenLine], beside: float) -> Interval:
    """The largest amplitude of some lines, of which ``beside`` may be larger ones."""
    return Interval(
        max((x.amplitude for x in lines), default=0.0),
        max((max(x.amplitude - x.error, 0.0) for x in lines), default=0.0),
        max([beside, *(x.amplitude + x.error for x in lines)]),
    )


def _over_allowed(line: SeenLine) -> float:
    return line.amplitude / line.allowed


def _ratio(lines: Sequence[SeenLine], judged: Judged, hidden: float) -> Interval:
    """The largest of the lines' amplitudes over what is allowed to each; at most what else may be
    there, which is all within the limit where the member passes.
    """
    if judged.complete:
        hidden = min(hidden, 1.0)
    else:
        hidden = math.inf
    seen = [x for x in lines if x.seen]
    return Interval(
        max((_over_allowed(x) for x in seen), default=0.0),
        max(((x.amplitude - x.error) / x.lenient for x in seen), default=0.0),
        max([hidden, *((x.amplitude + x.error) / x.allowed for x in lines)]),
    )


def _columns(intervals: Iterable[Interval]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower ends, values and upper ends."""
    found = [(x.low, x.value, x.high) for x in intervals]
    low, value, high = np.array(found).reshape(-1, 3).T
    return low, value, high


def _decibel(ratio: float) -> float:
    """A limit over an amplitude [dB] of the amplitude over the limit; nan where there is none."""
    if not ratio > 0.0 or math.isinf(ratio):
        return math.nan
    return -20.0 * math.log10(ratio)


def _reasons(of: Iterable[tuple[str, str]]) -> str:
    """Reasons why members are not judged, each with a member that it is of and how many more."""
    by_reason: dict[str, list[str]] = {}
    for name, why in of:
        by_reason.setdefault(why, []).append(name)
    told = []
    for why, names in by_reason.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        told.append(f"{min(names)}{more}: {why}")
    others = f"; and {len(told) - 2} more reasons" if len(told) > 2 else ""
    return f"{'; '.join(told[:2])}{others}"


def _too_few(statistic: Statistic, count: int) -> str:
    return (
        f"{WORDS[statistic]} of {count} members is not known: {members_needed(statistic)} or more are"
        " needed for an upper bound with 95 % confidence"
    )
