"""Envelopes for those who read them: verdicts, bands, members, and pictures of members beneath their
statistics.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.reports import sheets
from microvib.reports.analysis_units import ENDINGS, table_in_unit
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.typography import file_name
from microvib.results import DECIBEL, TORQUE, Column, Measure, Table
from microvib.studies.envelope.members import DRIVE_TORQUE
from microvib.studies.envelope.statistics import QUANTILES, WORDS, members_needed
from microvib.studies.envelope.study import (
    DENSITY,
    NOT_DRAWN,
    ChannelEnvelope,
    CurvePoint,
    DensityBand,
    Envelope,
    FigureBand,
    LineBand,
    MemberRow,
    StatisticVerdict,
)
from microvib.units import pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN, _BRIEF = 24, 12
"""Rows of a table in a report and on a terminal."""
_DRAWN = 200
"""Members that are drawn one by one."""
_NAMED = 4
"""Lines of a picture that are named."""
_LETTERS = 32
"""Letters of a member's name in a picture."""
_COLOURS = {
    "max": sheets.BLUE, "p95": sheets.ORANGE, "p99": sheets.PURPLE, "mean": sheets.GREEN
}  # fmt: skip
_BANDS_CAPTION = (
    "Of each member the largest line that may be in the band, 0-to-peak; a line near an edge counts in both"
    " bands. At most: with what was not seen; ? where that is not known. The worst member is that whose line"
    " is nearest to the limit at its own frequency, or farthest above it; the margin is of the statistic of"
    " such ratios."
)
_MEMBERS_CAPTION = (
    "Nearest line: the one nearest to the limit at its own frequency, without a limit the largest. Looked to: the"
    " highest frequency at which lines were looked for. `members.csv` has all."
)
_POINTS_CAPTION = (
    "The envelope of the bands that a point is in, against the limit at that point. It is less than the margin of"
    " the lines where none stands at the point, and decides nothing."
)
_SPECTRUM_CAPTION = (
    "Highest amplitude of the spectrum in each band, flat-top window. Within five bins of an edge a tone shows"
    " in the band beside its own, too, smaller; lines, and the verdict, do not depend on it."
)
_DENSITY_CAPTION = (
    "Mean square between the edges over the width of the band: bands add up to the mean square of the record. A"
    " line at an edge is divided between two bands."
)


def envelope_outcome(found: Envelope) -> Outcome:
    """Envelopes for those who read them: the verdict on each statistic, the worst member of each band, what
    was not looked at, and the members.
    """
    parts = [Part("", tuple(_first_part(found)))]
    files: list[Table] = []
    for one in found.channels:
        parts += _parts(found, one)
        files += _files(found, one)
    return Outcome(
        "Envelope",
        f"Envelope of {count_text(found.members, 'member')}",
        _summary(found),
        found.verdict,
        tuple(_facts(found)),
        tuple(parts),
        files=tuple(files),
        data={"envelope": _data(found)},
    )


def channel_words(one: ChannelEnvelope) -> str:
    """A channel as readers know it."""
    return "the torque about the drive axis" if one.channel == DRIVE_TORQUE else one.channel


def _summary(found: Envelope) -> str:
    of = ", ".join(WORDS[x] for x in found.statistics)
    what = " and ".join(channel_words(x) for x in found.channels)
    return f"{of[0].upper()}{of[1:]} of {count_text(found.members, 'member')} in {found.bandwidth.words}: {what}."


def _first_part(found: Envelope) -> Iterator[Item]:
    pairs = [
        ("Bandwidth", found.bandwidth.words),
        ("Amplitude spectra", f"noise bandwidth {found.resolution:g} Hz, flat-top window"),
    ]
    if found.limit is not None:
        pairs.append(("Limit", f"{found.limit.words} {found.limit.band}".strip()))
    yield Pairs(tuple(pairs))
    for one in found.channels:
        for verdict in one.verdicts:
            yield Text(_sentence(found, one, verdict))
        yield _picture_of_lines(found, one)
    yield from (Text(x, note=True) for x in _notes(found))


def _sentence(found: Envelope, one: ChannelEnvelope, of: StatisticVerdict) -> str:
    """The verdict on one statistic, in words."""
    name = WORDS[of.statistic]
    head = f"{name[0].upper()}{name[1:]} of {count_text(found.members, 'member')}"
    if len(found.channels) > 1:
        head += f", {channel_words(one)}"
    if one.curve is None:
        return f"{head}: {_largest(one, of.statistic)}."
    verdict = "FAIL" if of.verdict == "fail" else of.verdict
    text = f"{head}: {verdict}{_worst_words(one, of)}."
    if of.why:
        text += f" Reason: {of.why}."
    unknown = sum(x.verdict == "not judged" for x in one.members)
    if of.verdict == "fail" and unknown:
        text += f" {unknown} of {found.members} are not judged."
    if of.statistic != "max":
        above = sum(x.verdict == "fail" for x in one.members)
        text += f" This says nothing of a single member; {above} of {found.members} are above the limit."
    return text


def _largest(one: ChannelEnvelope, statistic: str) -> str:
    own = [x for x in one.bands if x.statistic == statistic and math.isfinite(x.value)]
    if not own:
        return "not known"
    top = max(own, key=lambda x: x.value)
    return f"largest {_figure(one, top.value)} from {top.low:.4g} to {top.high:.4g} Hz"


def _worst_words(one: ChannelEnvelope, of: StatisticVerdict) -> str:
    worst = of.worst
    if worst is None:
        return ""
    where = (
        f"{worst.worst}, {worst.line} at {worst.frequency:.5g} Hz, {_figure(one, worst.worst_amplitude)} of"
        f" {_figure(one, worst.allowed)}"
    )
    if of.statistic == "max":
        return f"; smallest margin {DECIBEL.figure(worst.margin)} ({where})"
    return (
        f"; smallest margin {DECIBEL.figure(worst.margin)} from {worst.low:.4g} to {worst.high:.4g} Hz (worst"
        f" member {where})"
    )


def _figure(one: ChannelEnvelope, amplitude: float) -> str:
    return f"{TORQUE.text(amplitude)} m{pretty(one.unit)}"


def _notes(found: Envelope) -> Iterator[str]:
    """Sentences on how far the figures can be relied on."""
    percentiles = [x for x in found.statistics if x in QUANTILES]
    if percentiles:
        yield from _percentile_notes(found, percentiles)
    kinds = {x.kind for one in found.channels for x in one.members}
    if kinds & {"rate", "angle"}:
        yield "Looked at are the rates and angles of the folders; between them a narrow resonance may be larger."
    for one in found.channels:
        yield from _channel_notes(found, one)


def _percentile_notes(found: Envelope, percentiles: Sequence[str]) -> Iterator[str]:
    if not found.drawn:
        if found.limit is None:
            yield f"{NOT_DRAWN[0].upper()}{NOT_DRAWN[1:]}; theirs here are of these members alone."
        return
    few = [x for x in percentiles if found.members < members_needed(x)]
    if few:
        needed = ", ".join(f"{members_needed(x)} for {WORDS[x]}" for x in few)
        yield (
            f"{' and '.join(WORDS[x] for x in few)} of {found.members} members are not known: an upper bound"
            f" with 95 % confidence, whatever the distribution, needs more ({needed})."
        )
    yield "Percentiles hold if the members are drawn by chance, independently and from one population."


def _channel_notes(found: Envelope, one: ChannelEnvelope) -> Iterator[str]:
    if found.limit is not None and one.curve is None:
        column = {"T": "t_nm", "F": f"{one.channel.lower()}_n"}.get(
            one.channel[0], f"{one.channel.lower()}_nm"
        )
        yield (
            f"The limit has no curve for {channel_words(one)}, which is not judged; a limit file"
            f" with the column {column} has one."
        )
        if one.channel != DRIVE_TORQUE and not found.limit.loads:
            yield "This limit is of the torque about the drive axis: channel T_d."
    if one.without_samples and (one.spectrum or one.density):
        name, why = one.without_samples[0]
        more = len(one.without_samples) - 1
        others = f" and {more} more" if more else ""
        yield f"Not in every spectrum and density: {name}{others} ({why})."


def _facts(found: Envelope) -> Iterator[Fact]:
    if found.verdict:
        word = (
            "FAIL" if found.verdict == "fail" else f"{found.verdict[0].upper()}{found.verdict[1:]}"
        )
        what = ", ".join(WORDS[x] for x in found.statistics)
        status = found.verdict if found.verdict in ("pass", "fail") else ""
        yield Fact(word, f"{what} against the limit", status)
    yield Fact(str(found.members), "members")
    for one in found.channels:
        for of in one.verdicts:
            if of.worst is not None:
                status = of.verdict if of.verdict in ("pass", "fail") else ""
                what = f"margin of the {WORDS[of.statistic]}, {of.worst.worst}"
                yield Fact(DECIBEL.figure(of.worst.margin), what, status)


def _suffix(found: Envelope, one: ChannelEnvelope) -> str:
    return f"_{one.channel}" if len(found.channels) > 1 else ""


def _parts(found: Envelope, one: ChannelEnvelope) -> Iterator[Part]:
    """Bands, curve, spectrum, density and members of one channel."""
    end = _suffix(found, one)
    of = f" of {channel_words(one)}" if end else ""
    bands = Table.of(
        f"envelope{end}",
        LineBand,
        one.bands,
        for_readers=_worst_first(found, one),
        brief=_BRIEF,
        caption=_BANDS_CAPTION,
    )
    yield Part(f"Lines{of} by band, the smallest margins first", (table_in_unit(bands, one.unit),))
    if one.points:
        points = Table.of(
            f"points{end}", CurvePoint, one.points, brief=_BRIEF, caption=_POINTS_CAPTION
        )
        yield Part(f"At the points of the limit{of}", (table_in_unit(points, one.unit),))
    if one.spectrum:
        yield Part(f"Amplitude spectrum{of}", (_picture_of_spectrum(found, one),))
    if one.density:
        yield Part(f"Power spectral density{of}", (_picture_of_density(found, one),))
    members = Table.of(
        f"members{end}",
        MemberRow,
        one.members,
        for_readers=_members_first(one)[:_SHOWN],
        caption=_MEMBERS_CAPTION,
        brief=_BRIEF,
    )
    title = f"Members{of}, those nearest to the limit first" if one.curve else f"Members{of}"
    yield Part(title, (table_in_unit(members, one.unit),))


def _worst_first(found: Envelope, one: ChannelEnvelope) -> list[LineBand]:
    """Bands of each statistic with lines and those that are not judged, what is above the limit or nearest to
    it first; without a limit the largest first.
    """
    rank = {"fail": 0, "not judged": 1, "pass": 1}

    def order(x: LineBand) -> tuple[int, float]:
        if one.curve is None:
            return 0, -float(np.nan_to_num(x.value))
        return rank.get(x.verdict, 2), -float(np.nan_to_num(x.ratio))

    shown = [x for x in one.bands if x.value > 0.0 or x.verdict in ("fail", "not judged")]
    each = (
        sorted((x for x in shown if x.statistic == statistic), key=order)[:_SHOWN]
        for statistic in found.statistics
    )
    return [x for own in each for x in own]


def _members_first(one: ChannelEnvelope) -> list[MemberRow]:
    def rank(x: MemberRow) -> float:
        size = x.amplitude if one.curve is None else x.amplitude / x.allowed
        return -float(np.nan_to_num(size))

    return sorted(one.members, key=rank)


def _files(found: Envelope, one: ChannelEnvelope) -> Iterator[Table]:
    end = _suffix(found, one)
    if one.spectrum:
        spectrum = Table.of(f"spectrum{end}", FigureBand, one.spectrum, for_readers=())
        yield table_in_unit(spectrum, one.unit)
    if one.density:
        density = Table.of(f"density{end}", DensityBand, one.density, for_readers=())
        columns = tuple(_density_column(x, one.unit) for x in density.columns)
        yield replace(density, columns=columns)


def _density_column(column: Column, unit: str) -> Column:
    """A column of densities as one of the channel's unit."""
    if column.measure != DENSITY:
        return column
    key = column.key.replace("_per_hz", f"_{ENDINGS[unit]}_squared_per_hz")
    return replace(column, key=key, measure=Measure(f"{pretty(unit)} squared per Hz"))


def _data(found: Envelope) -> dict[str, Any]:
    return {
        "bandwidth": found.bandwidth.words,
        "noise_bandwidth_hz": found.resolution,
        "members": found.members,
        "members_drawn_by_chance": found.drawn,
        "limit": None if found.limit is None else found.limit.as_dict(),
        "verdict": found.verdict,
        "channels": [
            {
                "channel": one.channel,
                "unit": one.unit,
                "verdict": one.verdict,
                "statistics": [_verdict_data(of) for of in one.verdicts],
            }
            for one in found.channels
        ],
    }


def _verdict_data(of: StatisticVerdict) -> dict[str, Any]:
    worst = of.worst
    told: dict[str, Any] = {
        "statistic": of.statistic,
        "verdict": of.verdict,
        "why": of.why,
        "members_needed": members_needed(of.statistic),
    }
    if worst is not None:
        told |= {
            "margin_db": worst.margin,
            "worst_member": worst.worst,
            "line": worst.line,
            "frequency_hz": worst.frequency,
        }
    return told


def _picture_of_lines(found: Envelope, one: ChannelEnvelope) -> Picture:
    end = _suffix(found, one)
    title = f"Lines of {count_text(found.members, 'member')} and their envelope"
    caption = (
        f"Dots: lines of members; thin: largest line of each member in {found.bandwidth.words}; thick: statistics"
        f" over members{_left_out(one)}."
    )
    return Picture(f"envelope{end}", lambda: draw_lines(found, one), title, caption)


def _left_out(one: ChannelEnvelope) -> str:
    count = len(one.levels)
    return (
        f"; the {_DRAWN} nearest to the limit of {count} members are drawn"
        if count > _DRAWN
        else ""
    )


def _picture_of_spectrum(found: Envelope, one: ChannelEnvelope) -> Picture:
    caption = (
        f"Noise bandwidth {found.resolution:g} Hz, {found.bandwidth.words}. {_SPECTRUM_CAPTION}"
    )
    return Picture(
        f"spectrum{_suffix(found, one)}",
        lambda: draw_spectrum(found, one),
        "Amplitude spectra of members and their envelope",
        caption,
    )


def _picture_of_density(found: Envelope, one: ChannelEnvelope) -> Picture:
    return Picture(
        f"density{_suffix(found, one)}",
        lambda: draw_density(found, one),
        "Densities of members and their envelope",
        f"{found.bandwidth.words[0].upper()}{found.bandwidth.words[1:]}. {_DENSITY_CAPTION}",
    )


def draw_lines(found: Envelope, one: ChannelEnvelope) -> Figure:
    """Lines of the members and their envelope over frequency, with the limit; the lines that decide are
    named.
    """
    figure, ax = sheets.one_axes(3.8)
    drawn = [x.name for x in _members_first(one)[:_DRAWN]]
    shown = [x for name, x in one.lines if name in set(drawn)]
    _draw_members(
        ax, [{k: v for k, v in one.levels[name].items() if v > 0.0} for name in drawn], 1e3
    )
    ax.plot(
        [x.frequency for x in shown],
        [1e3 * x.amplitude for x in shown],
        ".",
        color=sheets.GREY,
        markersize=2.5,
        alpha=0.6,
    )
    for statistic in found.statistics:
        own = {
            (x.low, x.high): x.value
            for x in one.bands
            if x.statistic == statistic and x.value > 0.0
        }
        _draw_steps(ax, own, WORDS[statistic], color=_COLOURS[statistic], linewidth=1.9)
    _finish(ax, one, [1e3 * x.amplitude for x in shown])
    _draw_limit(ax, one)
    _name_deciding(ax, one)
    _draw_legend(ax, ncols=2)
    return figure


def _draw_members(
    ax: Axes, members: Iterable[Mapping[tuple[float, float], float]], scale: float
) -> None:
    for own in members:
        _draw_steps(ax, own, "", scale, color=sheets.GREY, linewidth=0.5, alpha=0.5)


def _draw_steps(
    ax: Axes,
    levels: Mapping[tuple[float, float], float],
    label: str,
    scale: float = 1e3,
    **style: Any,
) -> None:
    """Levels of bands as steps, with gaps where there is none."""
    x: list[float] = []
    y: list[float] = []
    for (low, high), value in sorted(levels.items()):
        if x and abs(x[-1] / max(low, 1e-9) - 1.0) > 1e-6:
            x.append(math.nan)
            y.append(math.nan)
        x += [max(low, 1e-3), high]
        y += [scale * value, scale * value]
    if np.any(np.isfinite(y)):
        ax.plot(x, y, label=label or None, **style)


def _finish(ax: Axes, one: ChannelEnvelope, sizes: Iterable[float]) -> None:
    """Scales and labels; four decades of amplitude."""
    top = max((x for x in sizes if x > 0.0), default=1.0)
    low, high = 1e-4 * top, 40.0 * top
    if one.curve is not None:
        low, high = min(low, 0.5e3 * one.curve.least), max(high, 10e3 * one.curve.most)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]")
    ax.set_ylabel(f"amplitude, 0-to-peak [m{pretty(one.unit)}]")
    ax.set_ylim(low, high)
    places = [x.frequency for _, x in one.lines]
    left, right = min(places, default=1.0), max(places, default=100.0)
    if one.curve is not None:
        left = one.curve.low or left
        right = one.curve.high if math.isfinite(one.curve.high) else right
    ax.set_xlim(0.8 * left, 1.35 * right)
    sheets.plain_numbers(ax.xaxis)


def _draw_limit(ax: Axes, one: ChannelEnvelope) -> None:
    if one.curve is not None:
        low, high = ax.get_xlim()
        part = one.curve.within(low, high) or one.curve
        ax.plot(
            part.frequency,
            1e3 * np.array(part.amplitude),
            color="black",
            linewidth=1.4,
            linestyle="--",
            label="limit",
            zorder=4.5,
        )


def _draw_legend(ax: Axes, ncols: int) -> None:
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper left", fontsize=7.5, ncols=ncols)


def _deciding(one: ChannelEnvelope) -> list[LineBand]:
    """Bands of the first statistic whose lines are above the limit, the worst first, or one that is nearest
    to it.
    """
    own = [x for x in one.bands if x.statistic == one.verdicts[0].statistic and x.line]
    if one.curve is None:
        return sorted(own, key=lambda x: -x.worst_amplitude)[:1]
    ranked = sorted(own, key=lambda x: x.allowed / x.worst_amplitude)
    failing = [x for x in ranked if x.worst_amplitude > x.allowed]
    return (failing or ranked[:1])[:_NAMED]


def _name_deciding(ax: Axes, one: ChannelEnvelope) -> None:
    places = []
    for x in _deciding(one):
        above = one.curve is not None and x.worst_amplitude > x.allowed
        places.append((x.frequency, 1e3 * x.worst_amplitude, x.line, True))
        ax.plot(
            x.frequency,
            1e3 * x.worst_amplitude,
            "s",
            ms=6,
            mfc="none",
            color=sheets.RED if above else sheets.BLUE,
            zorder=6,
            label=f"{x.line} of {_short(x.worst, one)}",
        )
    sheets.name_points(ax, places)


def _short(name: str, one: ChannelEnvelope) -> str:
    """Values that a member was at, or its name, as short as a picture needs it."""
    values = next((x.values for x in one.members if x.name == name), "")
    text = values.partition(",")[0] or file_name(name)
    return text if len(text) <= _LETTERS else f"{text[: _LETTERS - 1]}…"


def draw_spectrum(found: Envelope, one: ChannelEnvelope) -> Figure:
    """The statistics of the amplitude spectra over frequency, and the members beneath."""
    figure, ax = sheets.one_axes(2.8)
    _draw_figures(ax, found, one.spectra, one.spectrum, 1e3)
    ax.set_ylabel(f"amplitude, 0-to-peak [m{pretty(one.unit)}]")
    _draw_limit(ax, one)
    _draw_legend(ax, ncols=4)
    return figure


def draw_density(found: Envelope, one: ChannelEnvelope) -> Figure:
    """The statistics of the densities over frequency, and the members beneath."""
    figure, ax = sheets.one_axes(2.8)
    _draw_figures(ax, found, one.densities, one.density, 1.0)
    ax.set_ylabel(f"density [({pretty(one.unit)})²/Hz]")
    ax.legend(loc="upper right", fontsize=7.5, ncols=4)
    return figure


def _draw_figures(
    ax: Axes,
    found: Envelope,
    members: Mapping[str, Mapping[tuple[float, float], float]],
    bands: Sequence[FigureBand | DensityBand],
    scale: float,
) -> None:
    """Figures of members in bands, thin, and their statistics, thick, with room for a legend."""
    _draw_members(ax, list(members.values())[:_DRAWN], scale)
    for statistic in found.statistics:
        own = {(x.low, x.high): x.value for x in bands if x.statistic == statistic}
        _draw_steps(ax, own, WORDS[statistic], scale, color=_COLOURS[statistic], linewidth=1.9)
    values = [scale * x for own in members.values() for x in own.values() if x > 0.0]
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]")
    ax.set_ylim(0.5 * min(values, default=0.1), 20.0 * max(values, default=1.0))
    sheets.plain_numbers(ax.xaxis)
