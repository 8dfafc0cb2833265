"""Blows of a hammer in a force's samples, and the frequency response that they tell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from microvib.errors import MicrovibError

Estimator = Literal["H1", "H2"]
MIN_BLOWS = 3
"""Blows from which a response has a coherence worth its name: that of one is 1, whatever it is."""
DOUBLE_RATIO = 0.05
"""Part of a blow's peak from which another rise of the force within its block is a second blow."""
_WEAK_RATIO = 0.2
"""Part of the median peak below which a blow is left out."""
_BLOW_RATIO, _NOISE_RATIO = 0.1, 10.0
"""Part of the largest peak, and times the noise, from which a force is a blow."""
_BEFORE = 0.05
"""Part of a block before the blow."""
_AT_REST, _QUIET_RATIO = 0.05, 3.0
"""RMS of the response before a blow, over its peak in the block, and times the noise, up to which the
structure is at rest."""
_RUNG_DOWN = 0.02
"""RMS of the last tenth of a block over the response's peak, up to which it has rung down."""
_LEFT_AT_END = 0.01
"""Part that the exponential window leaves at the end of a block that has not rung down."""
_LONGEST_BLOCK = 2.0
_TOP_NOISE, _TOP_PART, _TOP_SAMPLES = 6.0, 2e-3, 4
"""Times the noise, and part of the peak, within which samples are at a blow's top; and how many in a row may be a
level at which it was cut off.
"""
_CUT_OFF = 6.0
"""Times that by which the force has fallen a quarter of the top's length beyond it on both sides: a crest of the form
|t|^m has by 1.5^m times, 2.3 where it is a parabola, 5.1 with m of 4.
"""


class ImpactError(MicrovibError):
    """Blows that tell no response: says why."""


@dataclass(frozen=True)
class Blow:
    """One blow of the hammer."""

    time: float
    """Time of its peak, from the first sample [s]."""
    peak: float
    """Largest force, with its sign."""
    rejected: str = ""
    """Why it is left out; empty where it counts."""


@dataclass(frozen=True, eq=False)
class ImpactResponse:
    """Response over force by the blows that count."""

    frequency: np.ndarray
    """[Hz], (m,), without 0."""
    H: np.ndarray
    """Response over force, (m,), complex."""
    coherence: np.ndarray
    """(m,)."""
    uncertainty: np.ndarray
    """Standard uncertainty of the magnitude, (m,)."""
    blows: tuple[Blow, ...]
    """All that were found."""
    window_decay: float = 0.0
    """Decay rate [1/s] of the exponential window: H is that at s = i w + decay."""

    @property
    def averages(self) -> int:
        """Blows that count."""
        return sum(not blow.rejected for blow in self.blows)


def impact_response(
    force: np.ndarray,
    response: np.ndarray,
    sample_rate: float,
    block: float | None = None,
    estimator: Estimator = "H1",
) -> ImpactResponse:
    """Frequency response of samples ``response`` (n,) over those of a hammer's ``force`` (n,) [N].

    Each blow is a block: the force is kept at the blow alone, the response is multiplied by an
    exponential where it has not rung down at the block's end. H1 is the mean cross spectrum over the
    force's power, for noise in the response; H2 the response's power over the cross spectrum. Double,
    weak and clipped blows, those on a structure that still rings and those without a whole block are
    left out.

    Parameters
    ----------
    force, response : numpy.ndarray
        Samples, (n,) each.
    sample_rate : float
        Samples per second [Hz].
    block : float, optional
        Length of a block [s]; without it, the shortest time between two blows, at most 2 s.
    estimator : {"H1", "H2"}
        Which estimate.

    Returns
    -------
    ImpactResponse
        Response, coherence and uncertainty by bins, and all blows.

    Raises
    ------
    ImpactError
        With fewer than three blows that count.
    """
    x = np.asarray(force, dtype=float) - float(np.median(force))
    peaks, noise = _peaks(x, sample_rate)
    if not peaks:
        raise ImpactError("the force channel has no blow above its noise")
    size = _block_samples(peaks, x.size, sample_rate, block)
    before = round(_BEFORE * size)
    blows, segments = [], []
    usual = float(np.median([abs(x[k]) for k in peaks]))
    for k in peaks:
        segment = slice(k - before, k - before + size)
        why = _fault(x, np.asarray(response), segment, (k, usual, noise), sample_rate)
        blows.append(Blow(k / sample_rate, float(x[k]), why))
        if not why:
            segments.append(segment)
    if len(segments) < MIN_BLOWS:
        left = "; ".join(f"at {one.time:.3f} s: {one.rejected}" for one in blows if one.rejected)
        raise ImpactError(
            f"{len(segments)} blows count, and {MIN_BLOWS} are needed for a coherence"
            + (f" (left out: {left})" if left else "")
        )
    forces = np.array([_force_window(x[s], noise) for s in segments])
    replies = np.array([_from_rest(np.asarray(response, dtype=float)[s], before) for s in segments])
    decay = _window_decay(replies, before, size / sample_rate)
    window = np.exp(-decay * np.maximum(np.arange(size) - before, 0) / sample_rate)
    F, X = np.fft.rfft(forces * window)[:, 1:], np.fft.rfft(replies * window)[:, 1:]
    f = np.fft.rfftfreq(size, 1.0 / sample_rate)[1:]
    return ImpactResponse(f, *_averaged(F, X, estimator), tuple(blows), decay)


def _averaged(
    F: np.ndarray, X: np.ndarray, estimator: Estimator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Response, coherence and uncertainty of the magnitude of spectra (blows, m) each.

    The uncertainty is sqrt((1 - c)/(2 (n - 1) c)) |H|: of a complex regression over n blows.
    """
    cross = np.mean(F.conj() * X, axis=0)
    of_force, of_reply = np.mean(np.abs(F) ** 2, axis=0), np.mean(np.abs(X) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        c = np.abs(cross) ** 2 / (of_force * of_reply)
        H = cross / of_force if estimator == "H1" else of_reply / cross.conj()
        spread = np.abs(H) * np.sqrt(np.maximum(1.0 - c, 0.0) / (2.0 * (F.shape[0] - 1) * c))
    return H, np.nan_to_num(c), spread


def _peaks(x: np.ndarray, rate: float) -> tuple[list[int], float]:
    """Samples of the highest force of each blow, and the RMS of the force's noise."""
    noise = 1.4826 * float(np.median(np.abs(x)))
    least = max(_BLOW_RATIO * float(np.max(np.abs(x))), _NOISE_RATIO * noise)
    above = np.flatnonzero(np.abs(x) >= least)
    if above.size == 0 or not least > 0.0:
        return [], noise
    apart = round(0.1 * rate)
    groups = np.split(above, np.flatnonzero(np.diff(above) > apart) + 1)
    return [int(g[np.argmax(np.abs(x[g]))]) for g in groups], noise


def _block_samples(peaks: list[int], n: int, rate: float, block: float | None) -> int:
    """Samples of a block, an even number."""
    if block is not None:
        size = round(block * rate)
        if not 64 <= size <= n:
            raise ImpactError(
                f"a block of {block:g} s has {size} samples; between 64 and the recording's {n} are allowed"
            )
    else:
        gaps = np.diff([*peaks, n])
        typical = float(np.median(gaps[:-1])) if gaps.size > 1 else float(gaps[0])
        size = int(min(0.9 * typical, _LONGEST_BLOCK * rate))
    return max(size - size % 2, 64)


def _fault(
    x: np.ndarray,
    response: np.ndarray,
    segment: slice,
    blow: tuple[int, float, float],
    rate: float,
) -> str:
    """Why a blow is left out, in words; empty where it counts."""
    k, usual, noise = blow
    if segment.start < 0 or segment.stop > x.size:
        return "no whole block within the recording"
    if abs(x[k]) < _WEAK_RATIO * usual:
        return f"weak, {100.0 * abs(x[k]) / usual:.2g} % of the median blow"
    at_limit = np.abs(x[segment]) == float(np.max(np.abs(x)))
    if np.count_nonzero(at_limit) >= 2 or _is_cut_off(x, k, noise):
        return "clipped"
    second = _second_blow(x[segment], k - segment.start, noise)
    if second is not None:
        part, later = second
        if part > 1.0:
            return f"within {1e3 * later / rate:.3g} ms of a harder blow"
        return f"double hit: {100.0 * part:.2g} % again after {1e3 * later / rate:.3g} ms"
    return _fault_of_response(response, segment, k)


def _fault_of_response(response: np.ndarray, segment: slice, k: int) -> str:
    """Fault of the response to a blow at the sample ``k``, in words."""
    own = response[segment]
    away = np.abs(own - float(np.median(response)))
    at_ends = ((own == response.max()) | (own == response.min())) & (away > 0.5 * away.max())
    if np.count_nonzero(at_ends) >= 3:
        return "the reading is clipped"
    rest = own[: max(k - segment.start - 8, 8)]
    pieces = response[: response.size - response.size % rest.size].reshape(-1, rest.size)
    quiet = float(np.min(np.std(pieces, axis=1)))
    largest = float(np.max(np.abs(own - rest.mean())))
    if float(np.std(rest)) > max(_AT_REST * largest, _QUIET_RATIO * quiet):
        return "the structure was not at rest before it"
    return ""


def _is_cut_off(x: np.ndarray, k: int, noise: float) -> bool:
    """Whether a blow with its peak at the sample ``k`` stays at its top for several samples, to the ``noise``, and
    leaves it at once on both sides.
    """
    peak = abs(float(x[k]))
    tolerance = max(_TOP_NOISE * noise, _TOP_PART * peak)
    first, last = _pulse(x, k, peak - tolerance)
    beyond = max((last - first + 1) // 4, 1)
    if last - first + 1 < _TOP_SAMPLES or first < beyond or last + beyond >= x.size:
        return False
    sides = np.abs(x[[first - beyond, last + beyond]])
    return bool(np.max(sides) <= peak - _CUT_OFF * tolerance)


def _pulse(x: np.ndarray, k: int, least: float) -> tuple[int, int]:
    """First and last sample about the peak ``k`` at which the force is above ``least``."""
    sign = math.copysign(1.0, x[k])
    first = last = k
    while first > 0 and sign * x[first - 1] > least:
        first -= 1
    while last < x.size - 1 and sign * x[last + 1] > least:
        last += 1
    return first, last


def _second_blow(x: np.ndarray, k: int, noise: float) -> tuple[float, int] | None:
    """Part of the peak, and samples from it, of another rise of the force in a block; None without one.

    A rise that comes within the pulse's own width is the ringing of a filter, not a blow.
    """
    sign, peak = math.copysign(1.0, x[k]), abs(float(x[k]))
    least = max(DOUBLE_RATIO * peak, 5.0 * noise)
    first, last = _pulse(x, k, least)
    width = last - first + 1
    others = np.flatnonzero(sign * x > least)
    others = others[(others < first - width) | (others > last + width)]
    if others.size == 0:
        return _notch(sign * x[first : last + 1], peak)
    at = int(others[np.argmax(sign * x[others])])
    return sign * float(x[at]) / peak, abs(at - k)


def _notch(pulse: np.ndarray, peak: float) -> tuple[float, int] | None:
    """Two tops of one pulse with a dip between them, as of a blow that follows before the first ends."""
    tops = np.flatnonzero((pulse[1:-1] > pulse[:-2]) & (pulse[1:-1] >= pulse[2:])) + 1
    for a, b in zip(tops[:-1].tolist(), tops[1:].tolist(), strict=True):
        lower = min(pulse[a], pulse[b])
        if lower - float(np.min(pulse[a : b + 1])) > DOUBLE_RATIO * peak:
            return float(lower) / peak, b - a
    return None


def _force_window(x: np.ndarray, noise: float) -> np.ndarray:
    """The force of a block at its blow alone, fading out over the pulse's width on either side."""
    k = int(np.argmax(np.abs(x)))
    first, last = _pulse(x, k, max(0.01 * abs(float(x[k])), 3.0 * noise))
    width = last - first + 1
    at = np.arange(x.size)
    outside = np.maximum(np.maximum(first - width - at, at - last - width), 0) / (2.0 * width)
    return x * 0.5 * (1.0 + np.cos(np.pi * np.minimum(outside, 1.0)))


def _from_rest(x: np.ndarray, before: int) -> np.ndarray:
    """A response less its mean before the blow."""
    return x - float(np.mean(x[: max(before - 8, 8)]))


def _window_decay(replies: np.ndarray, before: int, length: float) -> float:
    """Decay rate [1/s] of the exponential window; 0 where responses have rung down."""
    tail = replies[:, -replies.shape[1] // 10 :]
    quiet = replies[:, : max(before - 8, 8)].std()
    left = max(float(np.sqrt(np.mean(tail**2))) - 2.0 * float(quiet), 0.0)
    if left <= _RUNG_DOWN * float(np.max(np.abs(replies))):
        return 0.0
    return -math.log(_LEFT_AT_END) / length
