"""Whether lines and floor account for all that a recording holds, at every time of it: power is
conserved, band by band.

Lines are found in the whole of a record. A record of which a drive runs for a part only, whose rate
ripples or whose load comes and goes holds more than its lines say: they are smeared, hidden by the
floor that they raise, or parted into others beside them. Here the mean square of samples is
therefore compared, in bands and in pieces of the record, with that of the lines that are counted
and of the floor; what is more than both is told with its place.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import gammainccinv

from microvib.model.record import PASSBAND
from microvib.signals.line_table import Line

BANDS = 3.0
"""Bands to the octave."""
LINE_ERROR = 0.03
"""Part of their amplitude by which lines may be larger before the rest counts as more; their own
uncertainty comes on top.
"""
_PIECES = 2, 4, 8, 16, 32, 64
"""Into how many pieces a record is parted, one after another: short ones show what comes and goes,
long ones what is weak.
"""
_BINS = 4
"""Bins of a piece that a band must have, so that a Hann window keeps it apart from its neighbours."""
_LOBE = 1
"""Bins on either side over which a Hann window spreads nearly all of a tone at the end of a band."""
_FIRST = 3
"""First bin of a piece that its mean does not reach."""
_PIECES_OF_LINES = 2, 3, 4, 6, 8
"""Into how many pieces a record is parted in which lines are looked at one by one."""
_SIGMAS_OF_LINES = 2.0
"""Standard deviations of noise by which a line may be larger in one of them and still count as steady."""
_BY_CHANCE = 1e-6
"""Probability with which noise of the floor's density makes more in one piece and band."""
_SIGMAS = 5.0
"""Deviations by which noise under a line may make it seem larger in a piece."""
_WIDE = 1.5
"""Bins of noise that one bin of a Hann window holds."""
_EVEN = 0.7
"""Part of the loudest piece's RMS from which all others are taken for equally loud."""
_FEW = 8
"""Bins of a band between the lines that tell its floor."""
_UNSURE = 4.0 * 1.44 * math.sqrt(_WIDE)
"""Over the root of the number of such bins: part by which the floor may be higher, four deviations
of a median of squares.
"""


_HEIGHT = math.sqrt(48.0 / 35.0)
"""Height of a tone that swells and fades within a piece as its Hann window does, over what its RMS
there says: the root of mean sin^4 over mean sin^8, 3/8 over 35/128.
"""
_STARTS = 4
"""Pieces that begin within the length of one."""
_LASTS = 0.9
"""Part of the loudest piece's excess above which what is half a piece away is taken for as loud."""
_BESIDE_IMAGE = 1.5
"""Factor on what a tone's height at an end of the record may be: it and its mirror image meet at any phase."""
_BENT = 0.1
"""Part of what lines do not account for in a piece beside a mirror image, above which a band of it counts: where
that bends what is not known, it is heard in other bands by half as much.
"""
_TOLD = 24
"""Bins of the whole record that a band must have to tell noise from a tone that sweeps through it. In
the bands below these, wherever the tone is, it may be in all bins of all pieces."""
_BESIDE = 3
"""Bands from there on whose floors bound those below."""
_MAX_UNSURE = 0.9
"""The most of that by which the floor of pieces must be lower: a tenth of it is lower in any case."""


_LEAST_REGRESSED, _REGRESSIONS, _AT_ENDS = 1024, 16, 2
"""Samples from which it is asked whether what lines leave goes with them, in how many pieces, and how many of
these at either end do not count, where a window fades.
"""
_LEAST_VARYING, _SIGNIFICANT = 0.02, 3.5
"""Part of the lines' mean square from which that counts, and standard errors of it."""
_PEAK, _ABOUT = 15.0, 201
"""Times the median of so many bins from which a bin is of a line: of noise one in 30 000."""


@dataclass(frozen=True)
class Excess:
    """Excess of a band of a record over the counted lines and the floor, in the piece where that
    is most.
    """

    low: float
    high: float
    """Ends of the band [Hz]."""
    rms: float
    """RMS of the excess, in the unit of the samples."""
    level: float
    """RMS of all samples in that piece and band."""
    counted: float
    """RMS of the lines that are counted there."""
    start: float
    stop: float
    """Between which times [s] samples are about as loud as in that piece."""
    times: float
    """Their RMS there over that in the rest of the record; 1 where the record is equally loud all
    along.
    """
    height: float = 1.0
    """Height of the excess over what its RMS says, where it does not last longer than its piece."""
    certain: bool = True
    """Whether it is there; else noise may make it, or hide that it is there."""
    varies: float = 0.0
    """Mean square of what is left of the record over that of its lines, where that goes up and down with these."""

    @property
    def amplitude(self) -> float:
        """Amplitude of a tone with this RMS, at its height where it swells and fades."""
        return self.height * math.sqrt(2.0) * self.rms

    def sentence(self, channel: str = "") -> str:
        """A sentence without a stop: what is wrong, and what to do."""
        at = f"at {self.low:.3g} to {self.high:.3g} Hz" + (
            f" in channel {channel}" if channel else ""
        )
        if self.varies:
            return (
                f"what the lines leave of the recording goes up and down with them ({100.0 * math.sqrt(self.varies):.2g}"
                f" % of them), which noise does not: samples are lost or repeated, or the gain varies (check contacts,"
                " ranges and the link of the recorder)"
            )
        if not self.certain:
            return (
                f"the noise does not exclude that the line {at} is {self.times:.2g} times as large"
                f" between {self.start:.3g} and {self.stop:.3g} s (a longer record, or less noise)"
            )
        if self.times > 1.0:
            if self.times < 100.0:
                times = f"{self.times:.2g} times"
            else:
                times = "over 100 times"
            return (
                f"the recording is not steady: between {self.start:.3g} and {self.stop:.3g} s its"
                f" RMS {at} is {times} that in the"
                " rest (trim it to a steady part, start and stop in the preparation file)"
            )
        part = 100.0 * min(self.counted / self.level, 1.0)
        return (
            f"significant lines account for {part:.2g} % of the recording's RMS {at}: the "
            "rest may come from a varying rate or load, a ringing mode, lines of higher order (--harmonics N) or another machine"
            " (record at a steady rate, with"
            " nothing else running)"
        )


def excesses(
    x: np.ndarray, sample_rate: float, counted: Iterable[Line], others: Iterable[Line] = ()
) -> tuple[Excess, ...]:
    """Excess of the samples ``x`` (n,) at ``sample_rate`` [Hz] over lines and floor, by bands of
    a third of an octave, ascending.

    Parameters
    ----------
    x : ndarray
        Samples of one channel, in the unit of the lines.
    sample_rate : float
        [Hz].
    counted : iterable of Line
        Lines of this channel that a verdict counts, those that fall as they fall.
    others : iterable of Line
        Further lines that do not belong to the floor.
    """
    counted = [line for line in counted if math.isfinite(line.amplitude)]
    n, duration = x.size, x.size / sample_rate
    edges = _edges(duration, PASSBAND * sample_rate)
    if edges.size < 2:
        return ()
    x = x - x.mean()
    model = samples_of_lines(counted, n, sample_rate)
    at = [line.place for line in (*counted, *others)]
    floor = _floors(x - model, sample_rate, edges, at)
    own = (line.amplitude_uncertainty / line.amplitude for line in counted if line.amplitude > 0.0)
    line_error = LINE_ERROR + 2.0 * min(max((y for y in own if math.isfinite(y)), default=0.0), 0.1)
    bands = _Bands(edges, floor, line_error)
    worst: dict[int, Excess] = {}
    for pieces in _PIECES:
        for k, found in _in_pieces(n // pieces, sample_rate, x, model, bands):
            if k not in worst or found.rms > worst[k].rms:
                worst[k] = found
    by_bands = [worst[k] for k in sorted(worst)]
    steady = [line for line in counted if not line.decay and line.amplitude > 0.0]
    return (
        *by_bands,
        *_lines_in_pieces(x - model, sample_rate, steady, bands),
        *_of_varying_gain(x - model, model, sample_rate, edges, counted),
    )


def _of_varying_gain(
    rest: np.ndarray,
    model: np.ndarray,
    sample_rate: float,
    edges: np.ndarray,
    lines: Sequence[Line],
) -> Iterator[Excess]:
    """Excesses of bands with ``lines``, where what these leave of samples goes up and down with them (n,)."""
    varies = varying_part(rest, model)
    if not varies:
        return
    n, of_lines = rest.size, math.sqrt((1.0 + 2.0 * varies) ** 2 - 1.0)
    for low, high in pairwise(edges.tolist()):
        largest = max((x.amplitude for x in lines if low <= x.place <= high), default=0.0)
        if largest > 0.0:
            more, level = math.sqrt(0.5) * largest * of_lines, math.sqrt(0.5) * largest
            yield Excess(low, high, more, level, level, 0.0, n / sample_rate, 1.0, varies=varies)


def varying_part(rest: np.ndarray, model: np.ndarray) -> float:
    """Mean square of what is left of samples over that of their lines, where it goes up and down with these; 0
    where it does not.

    Noise does not know of lines. What is left where samples are lost or repeated, or where the gain varies, does:
    regressions of its square on those of the lines and of their slopes, in the pieces of a record. Lines that
    were not found are left out by their peaks in its spectrum.

    Parameters
    ----------
    rest : ndarray
        What the lines leave of the samples, (n,).
    model : ndarray
        The lines, (n,).
    """
    slope = np.gradient(model)
    if rest.size < _LEAST_REGRESSED or not np.any(slope):
        return 0.0
    window = hann_window(rest.size)
    noise, weight = _without_peaks(rest * window), window**2
    slope *= np.std(model) / np.std(slope)
    found = [_regressed(noise**2, weight, weight * x**2) for x in (model, slope)]
    return max(found)


def _regressed(y: np.ndarray, steady: np.ndarray, varying: np.ndarray) -> float:
    """Part of ``varying`` beside ``steady`` in y (n,), by least squares in the pieces of a record; 0 where it is
    small or not significant.
    """
    columns = np.column_stack([steady, varying])
    pieces = zip(
        np.array_split(columns, _REGRESSIONS), np.array_split(y, _REGRESSIONS), strict=True
    )
    found = [np.linalg.lstsq(a, b, rcond=None)[0][1] for a, b in pieces][_AT_ENDS:-_AT_ENDS]
    mean, error = float(np.mean(found)), float(np.std(found, ddof=1)) / math.sqrt(len(found))
    return mean if mean > max(_LEAST_VARYING, _SIGNIFICANT * error) else 0.0


def _without_peaks(x: np.ndarray) -> np.ndarray:
    """Samples (n,), which fade towards their ends, without lines and what is slow."""
    from scipy.ndimage import binary_dilation, median_filter

    spectrum = np.fft.rfft(x)
    power = np.abs(spectrum) ** 2
    lines = power > _PEAK * median_filter(power, _ABOUT, mode="reflect")
    spectrum[binary_dilation(lines, iterations=_FIRST)] = 0.0
    spectrum[: 2 * _BINS] = 0.0
    return np.fft.irfft(spectrum, x.size)


def slow_rms(x: np.ndarray, sample_rate: float) -> tuple[float, float]:
    """Frequency [Hz] below which a record ``x`` (n,) is too short for bands, and the RMS that it has
    there beside its mean.
    """
    duration = x.size / sample_rate
    low = _FIRST * _PIECES[0] / duration
    power = _power((x - x.mean())[None, :], sample_rate)[0]
    return low, math.sqrt(float(np.sum(power[1 : math.ceil(low * duration)])))


def joined(found: Sequence[Excess]) -> list[list[Excess]]:
    """Excesses of one channel, or of several, joined where their bands touch."""
    groups: list[list[Excess]] = []
    for one in sorted(found, key=lambda x: x.low):
        if groups and one.low <= max(x.high for x in groups[-1]) * (1.0 + 1e-9):
            groups[-1].append(one)
        else:
            groups.append([one])
    return groups


def _edges(duration: float, highest: float) -> np.ndarray:
    """Ends of the bands [Hz]: of a third of an octave, the lowest as wide as the longest pieces
    resolve.
    """
    longest = duration / _PIECES[0]
    first, least = _FIRST / longest, _BINS / longest
    found = [first]
    while found[-1] < highest:
        found.append(max(found[-1] + least, found[-1] * 2.0 ** (1.0 / BANDS)))
    if first < highest:
        return np.array(found)
    return np.zeros(0)


def samples_of_lines(
    lines: Sequence[Line], n: int, sample_rate: float, duration: float | None = None
) -> np.ndarray:
    """The samples (n,) of lines alone, which were found in the first ``duration`` [s] of them, or in all."""
    t, found = np.arange(n) / sample_rate, np.zeros(n)
    for line in lines:
        size = line.amplitude_at_start(n / sample_rate if duration is None else duration)
        falls = np.exp(-line.decay * t) if line.decay else 1.0
        found += size * falls * np.cos(2.0 * np.pi * line.frequency * t + line.phase)
    return found


def _floors(
    rest: np.ndarray, sample_rate: float, edges: np.ndarray, lines: Sequence[float]
) -> np.ndarray:
    """Density of the floor in each band, from the median of the bins that no line is near, and what
    it may be at most, (2, m).

    A tone that sweeps through a band fills the bins of the whole record as noise does. In a short
    piece it fills few of them, or none. So the floor is not above the median over the bins of all
    pieces, of any length, where that is less than the whole record's by more than medians scatter.
    """
    found = []
    whole = _power(rest[None, :], sample_rate)
    for band in pairwise(edges.tolist()):
        own = _cells(whole, rest.size / sample_rate, band, lines)
        found.append((_floor(own, rest.size / sample_rate), _UNSURE / math.sqrt(max(own.size, 1))))
    floors, unsure = np.array(found).T
    bins = np.diff(edges) * rest.size / sample_rate
    for pieces in _PIECES:
        length = rest.size // pieces
        if length < 4 * _BINS:
            break
        duration = length / sample_rate
        windows = np.lib.stride_tricks.sliding_window_view(rest, length)
        power = _power(windows[:: max(length // 2, 1)], sample_rate)
        for k, band in enumerate(pairwise(edges.tolist())):
            if min(band[0], band[1] - band[0]) * duration < 1.0:  # not a bin, or the mean's
                continue
            there = _floor(_cells(power, duration, band, lines), duration)
            if there < floors[k] * (1.0 - min(unsure[k], _MAX_UNSURE)):
                floors[k] = there
    floors = _no_steeper_than_pink(floors, edges, bins >= _TOLD)
    return np.array([floors, floors * (1.0 + unsure)])


def _no_steeper_than_pink(floors: np.ndarray, edges: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Floors (m,) of which those of bands that are not ``told``, below others, are no higher than
    noise whose density falls with the frequency would make them.
    """
    if not told.any() or told[0]:
        return floors
    first, middle = int(np.argmax(told)), np.sqrt(edges[:-1] * edges[1:])
    pink = np.min((floors * middle)[first : first + _BESIDE])
    found = floors.copy()
    found[:first] = np.minimum(floors[:first], pink / middle[:first])
    return found


def _cells(
    power: np.ndarray, duration: float, band: tuple[float, float], lines: Sequence[float]
) -> np.ndarray:
    """Mean squares (m,) of the bins of a ``band`` [Hz] that no line is near, or of all where these
    are few, of pieces (p, l) of a ``duration`` [s].
    """
    bins = slice(math.ceil(band[0] * duration), min(math.ceil(band[1] * duration), power.shape[1]))
    clear = np.ones(power.shape[1], dtype=bool)
    for f in lines:
        k = round(f * duration)
        clear[max(k - 3, 0) : k + 4] = False
    own = power[:, bins][:, clear[bins]]
    if own.size < _FEW:
        own = power[:, bins]
    return own.ravel()


def _floor(cells: np.ndarray, duration: float) -> float:
    """Density of noise of which bins of a ``duration`` [s] have the mean squares (m,)."""
    if not cells.size:
        return 0.0
    # The median of the square of noise in a bin is ln 2 of its mean.
    return float(np.median(cells)) / math.log(2.0) * duration


def _power(pieces: np.ndarray, sample_rate: float) -> np.ndarray:
    """Mean squares of bins of Hann-windowed pieces (m, l), (m, l//2 + 1): their sum is that of the
    samples.
    """
    length = pieces.shape[1]
    window = hann_window(length)
    values = np.fft.rfft(pieces * window, axis=1)
    return 2.0 * np.abs(values) ** 2 / (length * np.sum(window**2))


@dataclass(frozen=True)
class _Bands:
    """Levels and floors of frequency bands."""

    edges: np.ndarray  # [Hz], (k + 1,)
    floor: np.ndarray  # power density, the mean and at most, (2, k)
    line_error: float  # relative, of amplitudes


def _in_pieces(
    length: int, sample_rate: float, x: np.ndarray, model: np.ndarray, bands: _Bands
) -> Iterator[tuple[int, Excess]]:
    """Numbers of bands that pieces of ``length`` samples resolve and that hold more than lines and
    floor, and what is more.
    """
    if length < 4 * _BINS:
        return
    duration = length / sample_rate
    starts = np.arange(0, x.size - length + 1, length // _STARTS)
    if starts[-1] != x.size - length:
        starts = np.append(starts, x.size - length)
    samples, lines = (_power_of_pieces(y, length, starts, sample_rate) for y in (x, model))
    begun = np.concatenate([[0.0], starts / sample_rate, [(x.size - length // 2) / sample_rate]])
    own = np.ones(begun.size)  # part of a piece that is not an image of the rest
    own[[0, -1]] = 0.5
    unknown = np.maximum(np.sum((samples - lines)[..., _FIRST:], axis=-1), 0.0)
    bent = np.where(own < 1.0, _BENT**2 * unknown, 0.0)
    for k, after in _wide_enough(bands.edges, duration):
        low, high = float(bands.edges[k]), float(bands.edges[after])
        bins = slice(math.ceil(low * duration) - _LOBE, math.ceil(high * duration) + _LOBE)
        all_of, of_lines = samples[..., bins].sum(axis=-1), lines[..., bins].sum(axis=-1)
        density = bands.floor[:, k:after]
        noise, at_most = density @ np.diff(bands.edges[k : after + 1])
        noise, at_most = np.array([noise, at_most]) + density.max(axis=1) * 2.0 * _LOBE / duration
        free = max((high - low) * duration / _WIDE, 1.0)  # pairs of degrees of freedom
        by_chance = at_most * gammainccinv(free * own, _BY_CHANCE) / (free * own)
        scatter = density[1].max() * _WIDE / (duration * own)
        under = _SIGMAS * np.sqrt(2.0 * of_lines * scatter)
        known = (1.0 + bands.line_error) ** 2 * of_lines
        if not np.any(all_of > known + under + by_chance):
            continue
        more = np.where(all_of > known + under + by_chance, all_of - known - noise, 0.0)
        more[more < bent] = 0.0
        image = np.argmin(more, axis=0)  # the one beside which less is left
        least = image, np.arange(begun.size)
        more, all_of, of_lines = more[least], all_of[least], of_lines[least]
        i = int(np.argmax(more))
        if more[i] == 0.0:
            continue
        loudest = samples[image[i], i], lines[image[i], i]
        part = _loudest_part(*loudest, bands.edges[k : after + 1] * duration)
        if part is None:
            continue
        start, stop, times = _loud(all_of, i, begun, duration)
        stop = min(stop, x.size / sample_rate)
        band = k + part
        height = _height(more, i) if times > 1.0 else 1.0
        yield band, Excess(
            float(bands.edges[band]), float(bands.edges[band + 1]),
            math.sqrt(more[i]), math.sqrt(all_of[i]), math.sqrt(of_lines[i]), start, stop, times,
            height,
        )  # fmt: skip


def _power_of_pieces(
    x: np.ndarray, length: int, starts: np.ndarray, sample_rate: float
) -> np.ndarray:
    """Mean squares of bins of pieces of a ``length`` of samples ``x`` (n,), in the order of time, that begin at
    their ``starts`` (p,), and first and last of half a piece at an end of the record beside its mirror image:
    upright, and turned over, (2, p + 2, length//2 + 1).

    A window fades towards the ends of its piece: what grows up to the end of the record is at its largest
    where no piece of the record itself would see it. What is slow is bent by one of the mirror images only.
    """
    half, other = length // 2, length - length // 2
    before, after = x[:half][::-1], x[-half:][::-1]
    inside = _power(np.lib.stride_tricks.sliding_window_view(x, length)[starts], sample_rate)

    def with_images(before: np.ndarray, after: np.ndarray) -> np.ndarray:
        ends = np.concatenate([before, x[:other]]), np.concatenate([x[-other:], after])
        first, last = _power(np.stack(ends), sample_rate)
        return np.vstack([first, inside, last])

    upright = with_images(before, after)
    turned_over = with_images(2.0 * x[0] - before, 2.0 * x[-1] - after)
    return np.stack([upright, turned_over])


def _lines_in_pieces(
    rest: np.ndarray, sample_rate: float, lines: Sequence[Line], bands: _Bands
) -> Iterator[Excess]:
    """Steady lines that are larger in a piece of the record than in all of it, by more than noise lets
    expect, each with the piece in which it is largest; ``rest`` (n,) is what the lines leave of the samples.
    """
    found: dict[str, Excess] = {}
    for pieces in _PIECES_OF_LINES:
        length = rest.size // pieces
        if length < 4 * _BINS:
            break
        for line, larger in _larger_in_pieces(length, rest, sample_rate, lines, bands):
            if line.name not in found or larger.level > found[line.name].level:
                found[line.name] = larger
    yield from found.values()


def _larger_in_pieces(
    length: int, rest: np.ndarray, sample_rate: float, lines: Sequence[Line], bands: _Bands
) -> Iterator[tuple[Line, Excess]]:
    """Lines that are larger in a piece of ``length`` samples, and the largest piece of each."""
    duration = length / sample_rate
    starts = np.arange(0, rest.size - length + 1, length // 2)
    windows = np.lib.stride_tricks.sliding_window_view(rest, length)[starts]
    values = np.fft.rfft(windows * hann_window(length), axis=1)
    for line in lines:
        nearest, band = round(line.frequency * duration), _band_of(line.frequency, bands)
        if band is None or not _FIRST <= nearest < values.shape[1] - _LOBE:
            continue
        own = _windowed_tone(line, nearest, length, starts, sample_rate)
        sizes = line.amplitude * np.abs(1.0 + values[:, nearest] / own)
        k = int(np.argmax(sizes))
        scatter = math.sqrt(_WIDE * float(bands.floor[1, band]) / duration)
        if sizes[k] > (1.0 + LINE_ERROR) * line.amplitude + _SIGMAS_OF_LINES * scatter:
            yield (
                line,
                _larger_line(line, float(sizes[k]), float(starts[k]) / sample_rate, duration),
            )


def hann_window(length: int) -> np.ndarray:
    """A Hann window whose ends lie half a sample beyond the first and the last, (length,)."""
    return np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2


def _band_of(frequency: float, bands: _Bands) -> int | None:
    """Number of the band that a frequency [Hz] is in; None where it is in none."""
    number = int(np.searchsorted(bands.edges, frequency, side="right")) - 1
    if 0 <= number < bands.edges.size - 1:
        return number
    return None


def _windowed_tone(
    line: Line, number: int, length: int, starts: np.ndarray, sample_rate: float
) -> np.ndarray:
    """Values in the bin of this ``number`` of the Hann-windowed pieces (p,) of a steady line that begin with the samples
    ``starts`` (p,).
    """
    off = line.frequency * length / sample_rate - number
    # sinc(d)/(1 - d^2) is the Hann window's transform, here no further than half a bin away
    tone = (
        0.25
        * length
        * np.sinc(off)
        / (1.0 - off**2)
        * np.exp(1j * np.pi * off * (1.0 - 1.0 / length))
    )
    begun = 2.0 * np.pi * line.frequency * starts / sample_rate + line.phase
    return np.asarray(line.amplitude * tone * np.exp(1j * begun))


def _larger_line(line: Line, size: float, start: float, duration: float) -> Excess:
    """Excess of a line that is as large as ``size`` in a piece of the record."""
    rms = math.sqrt(0.5 * (size**2 - line.amplitude**2))
    level, counted = math.sqrt(0.5) * size, math.sqrt(0.5) * line.amplitude
    low, high = line.frequency - 1.0 / duration, line.frequency + 1.0 / duration
    times = size / line.amplitude
    return Excess(low, high, rms, level, counted, start, start + duration, times, certain=False)


def _loudest_part(power: np.ndarray, of_lines: np.ndarray, edges: np.ndarray) -> int | None:
    """Number of the band between ``edges`` [bins] in which a piece holds most beyond its lines; None
    where that is beside them, in a band of its own.
    """
    more = power - of_lines
    first, last = math.ceil(edges[0]), math.ceil(edges[-1])
    ends = [(math.ceil(a), max(math.ceil(b), math.ceil(a) + 1)) for a, b in pairwise(edges)]
    sums = [np.sum(more[a:b]) for a, b in ends]
    below, above = np.sum(more[first - _LOBE : first]), np.sum(more[last : last + _LOBE])
    if first - _LOBE < _FIRST:  # no band is below
        below = -math.inf
    if max(below, above) > max(sums):
        return None
    return int(np.argmax(sums))


def _height(excess: np.ndarray, i: int) -> float:
    """Height of the excess of piece ``i`` over what its RMS says: 1 where it is as large half a piece
    before or after; at an end of the record that of what grows, or decays, exponentially.
    """
    if i in (0, excess.size - 1):
        inside = (excess[1] if i == 0 else excess[-2]) / excess[i]
        if inside >= _LASTS**2:
            return 1.0
        return _BESIDE_IMAGE * float(np.interp(-inside, -_INSIDE, _HEIGHT_AT_END))
    half = _STARTS // 2
    beside = [excess[k] for k in (i - half, i + half) if 0 < k < excess.size - 1]
    if max(beside, default=0.0) >= _LASTS**2 * excess[i]:
        return 1.0
    return _HEIGHT


def _growing_to_the_end() -> tuple[np.ndarray, np.ndarray]:
    """Tones that grow exponentially to the end of a record, by up to sixteen e-foldings of their square in a
    piece: the mean square in the last piece over that at the end, mirrored; the height there over what the
    latter says. (m,) each.
    """
    u = np.linspace(0.0, 1.0, 2001)
    falls = np.exp(-np.linspace(0.0, 16.0, 65)[:, None] * u)
    own = np.mean(np.sin(np.pi * u) ** 4 * falls, axis=1)
    at_end = 2.0 * np.mean(np.where(u <= 0.5, np.cos(np.pi * u) ** 4, 0.0) * falls, axis=1)
    return own / at_end, np.sqrt(0.375 / at_end)


_INSIDE, _HEIGHT_AT_END = _growing_to_the_end()


def _wide_enough(edges: np.ndarray, duration: float) -> Iterator[tuple[int, int]]:
    """Bands of a piece of a ``duration`` [s], as numbers of their edges: those that it resolves, and
    several together where it does not resolve one, so that what is short and slow is seen, too.
    """
    for k, low in enumerate(edges[:-1].tolist()):
        if low * duration < _FIRST:
            continue
        after = int(np.searchsorted(edges, low + _BINS / duration * (1.0 - 1e-9)))
        after = max(after, k + 1)
        if after < edges.size:
            yield k, after


def _loud(
    power: np.ndarray, i: int, starts: np.ndarray, duration: float
) -> tuple[float, float, float]:
    """Between which times pieces beside piece ``i`` are about as loud, and how many times as loud
    as the others.
    """
    quiet = power < 0.5 * power[i]
    if quiet.any():
        rest = float(np.median(power[quiet]))
    else:
        rest = power[i]
    if rest > _EVEN**2 * power[i]:
        return float(starts[0]), float(starts[-1]) + duration, 1.0
    before, after = np.flatnonzero(quiet[:i]), np.flatnonzero(quiet[i:])
    if before.size:
        first = int(before[-1]) + 1
    else:
        first = 0
    if after.size:
        last = i + int(after[0]) - 1
    else:
        last = power.size - 1
    return (
        float(starts[first]),
        float(starts[last]) + duration,
        math.sqrt(power[i] / max(rest, 1e-300)),
    )
