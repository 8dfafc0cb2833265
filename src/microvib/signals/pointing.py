"""Pointing errors over windows of time: exact weights on lines and densities, amplitudes at which
they exceed, blur (MTF).

A window of T sees a motion of frequency f with the weights that follow from averaging over all
phases; with u = pi f T and the spherical Bessel functions j_n they are

    ape        1                             the motion itself
    mpe        j_0(u)^2                      its mean over the window (displacement)
    rpe        1 - j_0(u)^2                  what moves about this mean
    smear      3 j_1(u)^2                    of that, the part of the straight line that fits best
    jitter     1 - j_0(u)^2 - 3 j_1(u)^2     what moves about this line
    stability  2 (1 - cos 2 pi f T_s)        change from one instant to another T_s later
    pde        2 (1 - cos 2 pi f T_s) j_0^2  change of the mean from one window to another that begins T_s later

on the mean square, A^2/2 of a line or a one-sided density over frequency. Names are those of
ECSS-E-ST-60-10C. Angles are in rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from microvib.errors import MicrovibError
from microvib.signals.error_rows import ErrorRows
from microvib.signals.in_step import bases

Metric = Literal["ape", "mpe", "rpe", "smear", "jitter", "stability", "pde"]
METRICS: tuple[Metric, ...] = get_args(Metric)


def metric_name(metric: str) -> str:
    """A metric as requirements name it: abbreviations in capitals."""
    if len(metric) == 3:
        return metric.upper()
    return metric


_TERMS = (
    14  # terms of the sum over (2 n + 1) j_n(u)^2, which is 1; at u < 1 the next is below 1e-40
)
_PER_PERIOD = (
    16.0  # pieces in which a density is integrated, for each period that a weight goes through
)
# periods within a window from which on a weight is its mean over a period, within 1e-9 of 1
_FAST = 1e4
_MEAN: dict[Metric, float] = {
    "ape": 1.0,
    "rpe": 1.0,
    "jitter": 1.0,
    "stability": 2.0,
}
_AVERAGED = 1e3
"""Periods within a window from which on noise is as large at every instant of it, within 1e-3."""
_MOST_RELATED = 1_000_000
"""Pieces of a density up to which it is looked at what two windows that are far apart have in common."""
_SHARE_OF_FREQUENCY = 0.02
"""Longest step of a grid, as a part of the frequency, on which 1 over its square is integrated."""
_MAX_PIECES = 20_000_000
_TERMS_OF_LEVEL = 1 << 12  # of the Fourier series of a distribution
_INSTANTS = (
    32749,
    32719,
    32717,
    32713,
    32707,
    32693,
    32687,
    32653,
)  # in one repetition of lines in step: primes, one of them
_VANISHING = 1e-16  # of a transform, which is 1 at most: terms below change no part of the time
_SMALL = 3e-3  # of the largest line: those below count as noise of their mean square
_AT_ONCE = 4_000_000  # instants times lines that are summed at a time
_HALVINGS = 60  # of the interval in which a level lies
UNIFORM_INSTANTS = np.linspace(0.0, 1.0, 201)
"""Instants in half a window, both ends among them."""


class WindowCells(NamedTuple):
    """Parts of a window, from -1 at its beginning to 1 at its end."""

    instants: np.ndarray
    """Their middles, (n,)."""
    shares: np.ndarray
    """Their lengths as parts of the time, (n,)."""
    reach: np.ndarray
    """From their middles to their ends, (n,)."""


def window_cells(count: int, *, both_halves: bool) -> WindowCells:
    """``count`` cells of the second half of a window, or of each half.

    They are short towards the end, where what moves about a mean or a line is largest: it decides
    high levels, and changes there by half a percent in a 64th of the half.
    """
    edges = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, count + 1))
    if both_halves:
        edges = np.r_[-edges[:0:-1], edges]
    length = np.diff(edges)
    return WindowCells(0.5 * (edges[1:] + edges[:-1]), length / length.sum(), 0.5 * length)


HALF_WINDOW, WHOLE_WINDOW = (window_cells(64, both_halves=both) for both in (False, True))
"""Cells for levels: of lines without known phases either half tells both, and of harmonics that
keep their phases neither."""


def metric_weight(
    metric: Metric, frequency: np.ndarray | float, window: float, apart: float | None = None
) -> np.ndarray:
    """Weight of ``metric`` on the mean square at ``frequency`` [Hz], any shape, for a ``window`` T
    [s].

    ``apart`` is T_s [s] of stability and pde, from the start of one window to that of the next;
    without it they are adjacent, T.
    """
    if not window > 0.0 or not math.isfinite(window) or (apart is not None and not apart > 0.0):
        raise MicrovibError(
            f"window: {window:g} s (apart: {apart}) is not allowed; times greater than 0 s are"
            " expected"
        )
    f = np.asarray(frequency, dtype=float)
    u = np.pi * np.abs(f) * window
    mean = np.sinc(u / np.pi) ** 2
    if metric == "ape":
        return np.ones_like(u)
    if metric == "mpe":
        return mean
    if metric == "smear":
        return 3.0 * _spherical(1, u) ** 2
    if metric in ("rpe", "jitter"):
        return _beyond(1 if metric == "rpe" else 2, u, mean)
    change = 4.0 * np.sin(np.pi * f * (window if apart is None else apart)) ** 2
    if metric == "stability":
        return change
    return change * mean


def _spherical(order: int, u: np.ndarray) -> np.ndarray:
    from scipy.special import spherical_jn

    return np.asarray(spherical_jn(order, u), dtype=float)


def _beyond(first: int, u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """1 less the first ``first`` terms of the sum of (2 n + 1) j_n(u)^2; the others where u is
    small and the difference is lost.
    """
    if first == 1:
        left = 1.0 - mean
    else:
        left = 1.0 - mean - 3.0 * _spherical(1, u) ** 2
    small = u < 1.0
    if np.any(small):
        terms = sum((2 * n + 1) * _spherical(n, u[small]) ** 2 for n in range(first, _TERMS))
        left = np.array(left)
        left[small] = terms
    return np.asarray(left)


def mean_square_of_lines(
    metric: Metric,
    frequency: np.ndarray,
    amplitude: np.ndarray,
    window: float,
    apart: float | None = None,
) -> np.ndarray:
    """Mean square [rad^2] of each line of ``amplitude`` 0-to-peak (k, ...) at ``frequency`` (k,)
    [Hz] in a ``window`` [s].
    """
    amplitude = np.asarray(amplitude, dtype=float)
    w = metric_weight(metric, frequency, window, apart)
    return np.asarray(w.reshape(w.shape + (1,) * (amplitude.ndim - w.ndim)) * 0.5 * amplitude**2)


def mean_square_of_density(
    metric: Metric,
    frequency: np.ndarray,
    density: np.ndarray,
    window: float,
    apart: float | None = None,
) -> float:
    """Mean square [rad^2] of a one-sided ``density`` (n,) [rad^2/Hz], linear between the
    frequencies (n,) [Hz], ascending.

    Nothing is assumed outside them. The weight is integrated as finely as it varies. Raises
    MicrovibError.
    """
    f, S = _checked_density(frequency, density)
    far = apart is not None and f[-1] * apart > 1.000001 * _FAST
    if metric == "pde" and apart is not None:  # of adjacent windows one ends where the other begins
        far = far and f[-1] * abs(apart - window) > _FAST
    if metric in ("stability", "pde") and apart is not None and far:
        return _with_unrelated_instants(metric, f, S, window, apart)
    first_averaged = int(np.searchsorted(f, _FAST / window))
    averaged = _averaged_integral(metric, f[first_averaged:], S[first_averaged:], window, apart)
    f, S = f[: first_averaged + 1], S[: first_averaged + 1]
    if f.size < 2:
        return averaged
    return averaged + _weighted_integral(metric, f, S, window, apart)


def _checked_density(frequency: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    f, S = np.asarray(frequency, dtype=float), np.asarray(density, dtype=float)
    if f.ndim != 1 or f.shape != S.shape or f.size < 2 or np.any(np.diff(f) <= 0.0) or f[0] < 0.0:
        raise MicrovibError(
            "density: frequencies that ascend from 0 Hz or more are expected, and a density for"
            " each"
        )
    if np.any(S < 0.0) or not np.all(np.isfinite(S)):
        raise MicrovibError(
            "density: a value is negative or not finite; rad^2/Hz of 0 or more are expected"
        )
    return f, S


def _with_unrelated_instants(
    metric: Metric, f: np.ndarray, S: np.ndarray, window: float, apart: float
) -> float:
    """Mean square where the two instants are more than ``_FAST`` periods of the highest frequency
    apart: above, each counts by itself, less what a density that is narrow beside the inverse of that time
    still relates.
    """
    limit = max(min(_FAST / apart, f[-1]), f[0])
    at_limit = np.interp(limit, f, S)
    below, above = f < limit, f > limit
    unrelated = 0.0
    if above.any():
        single: Metric = "ape" if metric == "stability" else "mpe"
        upper, density = np.r_[limit, f[above]], np.r_[at_limit, S[above]]
        unrelated = 2.0 * mean_square_of_density(single, upper, density, window)
        unrelated -= 2.0 * _related_part(single, upper, density, window, apart)
    if not below.any():
        return unrelated
    related = mean_square_of_density(
        metric, np.r_[f[below], limit], np.r_[S[below], at_limit], window, apart
    )
    return unrelated + related


def _related_part(
    single: Metric, f: np.ndarray, S: np.ndarray, window: float, apart: float
) -> float:
    """Integral of a density, of ``mpe`` with its weight, times cos(2 pi f T_s) of instants that are so far apart: in
    closed form of what is straight between frequencies.
    """
    if single == "mpe":
        pieces = np.ceil(np.diff(f) * window * _PER_PERIOD).astype(int)
        if pieces.sum() > _MOST_RELATED:
            return 0.0
        fine = [
            np.linspace(a, b, n, endpoint=False)
            for a, b, n in zip(f[:-1], f[1:], pieces, strict=True)
        ]
        grid = np.r_[np.concatenate(fine), f[-1]]
        f, S = grid, np.interp(grid, f, S) * metric_weight("mpe", grid, window)
    a = 2.0 * math.pi * apart
    ends = (S[-1] * math.sin(a * f[-1]) - S[0] * math.sin(a * f[0])) / a
    return float(ends + np.sum(np.diff(S) / np.diff(f) * np.diff(np.cos(a * f))) / a**2)


def _averaged_integral(
    metric: Metric, f: np.ndarray, S: np.ndarray, window: float, apart: float | None
) -> float:
    """Integral of density times weight where a window has so many periods that the weight is its
    mean over them: with u = pi f T, 1/(2 u^2) of mpe and 3/(2 u^2) of smear.
    """
    if f.size < 2:
        return 0.0
    if metric in _MEAN:
        return _MEAN[metric] * float(np.trapezoid(S, f))
    steps = max(int(math.log(f[-1] / f[0]) / _SHARE_OF_FREQUENCY), 1)
    grid = np.union1d(f, np.geomspace(f[0], f[-1], steps + 1))
    mean, ripples = {"mpe": (0.5, {}), "smear": (1.5, {})}.get(
        metric, (1.0, _ripples_of_pde(f[-1], window, apart))
    )
    total = 0.0
    for at, squares in _quadrature(grid, np.interp(grid, f, S), max(ripples, default=0.0), 200_000):
        weight = mean + sum(part * np.cos(2.0 * np.pi * at * T) for T, part in ripples.items())
        total += float(np.sum(squares * weight / (np.pi * at * window) ** 2))
    return total


def _ripples_of_pde(highest: float, window: float, apart: float | None) -> dict[float, float]:
    """Parts of (1 - cos 2 pi f T_s) (1 - cos 2 pi f T), the weight of pde times u^2, that are beside 1 and
    have few periods up to the ``highest`` frequency [Hz], by times [s] of which they are
    cosines.
    """
    later = window if apart is None else apart
    parts = {later: -1.0, abs(later - window): 0.5}
    return {T: part for T, part in parts.items() if highest * T <= _FAST}


def _weighted_integral(
    metric: Metric, f: np.ndarray, S: np.ndarray, window: float, apart: float | None
) -> float:
    """Integral of density times weight, on pieces far shorter than its ripple."""
    longest = max(window, apart or 0.0)
    return sum(
        float(np.sum(squares * metric_weight(metric, at, window, apart)))
        for at, squares in _quadrature(f, S, longest, 200_000)
    )


def _quadrature(
    f: np.ndarray, S: np.ndarray, longest: float, at_once: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frequencies [Hz] and shares of the mean square at them, (m, 3) each, by Gauss' rule on pieces
    of which a time of ``longest`` [s] has 16 a period; no more than ``at_once`` pieces together.
    """
    pieces = np.maximum(np.ceil(np.diff(f) * longest * _PER_PERIOD), 1.0)
    if pieces.sum() > _MAX_PIECES:
        raise MicrovibError(
            f"window: {longest:g} s with a density up to {f[-1]:g} Hz takes {pieces.sum():.2g}"
            " pieces; at most"
            f" {_MAX_PIECES:.0e} are allowed; cut the density above, or shorten the window"
        )
    count = pieces.astype(int)
    first_piece = np.cumsum(count) - count
    interval = np.repeat(np.arange(count.size), count)
    nodes, shares = np.polynomial.legendre.leggauss(3)
    for part in np.array_split(np.arange(interval.size), max(interval.size // at_once, 1)):
        k = interval[part]
        before = (part - first_piece[k]) / count[k]  # share of the interval before the piece
        u = before[:, None] + 0.5 * (1.0 + nodes) / count[k, None]
        at = f[k, None] + u * np.diff(f)[k, None]
        value = S[k, None] + u * np.diff(S)[k, None]
        width = (np.diff(f) / count)[k]
        yield at, width[:, None] * value * (0.5 * shares)


def mean_squares_at_instants(
    metric: Metric,
    frequency: np.ndarray,
    density: np.ndarray,
    window: float,
    apart: float | None = None,
    instants: np.ndarray = HALF_WINDOW.instants,
) -> np.ndarray:
    """Mean squares [rad^2] of a one-sided ``density``, as ``mean_square_of_density`` takes it, at
    ``instants`` of a window, (n,), from -1 at its beginning to 1 at its end.

    What moves about the mean or the fitted line is larger towards both ends: of what is slow
    against the window the fitted line has 3 times its mean there. Metrics that are one value of a
    window have one row, as in ``windowed_amplitudes``. Raises MicrovibError.
    """
    whole = mean_square_of_density(metric, frequency, density, window, apart)
    if metric not in WITHIN_WINDOW:
        return np.array([whole])
    tau = np.asarray(instants, dtype=float)
    if metric == "smear":
        return np.asarray(3.0 * tau**2 * whole)
    f, S = _checked_density(frequency, density)
    limit = min(max(_AVERAGED / window, f[0]), f[-1])
    found = np.zeros(tau.size)
    if limit > f[0]:
        grid = np.r_[f[f < limit], limit]
        for at, squares in _quadrature(grid, np.interp(grid, f, S), window, 4_000):
            ones = np.ones(at.size)
            rows = windowed_amplitudes(metric, at.ravel(), ones, window, apart, tau)
            found += np.abs(rows) ** 2 @ squares.ravel()
    if limit < f[-1]:
        grid = np.r_[limit, f[f > limit]]
        found += mean_square_of_density(metric, grid, np.interp(grid, f, S), window, apart)
    return found


def cumulative_rms(
    frequency: np.ndarray, density: np.ndarray, *, falling: bool = False
) -> np.ndarray:
    """Root of the integral of a one-sided ``density`` (n,) from the lowest frequency up to each, or
    down from the highest, (n,).
    """
    f, S = np.asarray(frequency, dtype=float), np.asarray(density, dtype=float)
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (S[1:] + S[:-1]) * np.diff(f))])
    return np.asarray(np.sqrt(np.maximum(steps[-1] - steps if falling else steps, 0.0)))


def radial_rms(mean_squares: np.ndarray) -> np.ndarray:
    """Root mean square of the distance from the axis, from mean squares about both axes (..., 2)."""
    return np.asarray(np.sqrt(np.sum(mean_squares, axis=-1)))


# ---- Statistics: a line is at its amplitude most of the time, noise hardly ever beyond three sigma ----


@dataclass(frozen=True)
class Distribution:
    """How the sum of lines and noise is spread over time, in rows: shares of the time with
    amplitudes of their own.
    """

    angle: np.ndarray
    """[rad], ascending from 0, (m,), up to what is hardly ever passed."""
    inside: np.ndarray
    """Part of the time within each angle, (n, m)."""
    shares: np.ndarray
    """Shares of the time, (n,)."""

    def within(self, confidence: float, beside: np.ndarray | float = 0.0) -> float:
        """Angle [rad] that it stays within for a part ``confidence`` of the time.

        ``beside`` (n,) [rad] is what there is at most besides, of which neither phases nor
        frequencies are known: the angle then is the one that all together certainly stay within; where
        ``beside`` is negative, the one that they certainly pass for the rest of the time, 0 where
        there is none.
        """
        if not 0.0 < confidence < 1.0:
            raise MicrovibError(
                f"confidence: {confidence:g} is not allowed; a part between 0 and 1 is expected"
            )
        other = np.broadcast_to(beside, len(self.inside))
        low, high = 0.0, max(float(self.angle[-1] + other.max()), 0.0)
        if self._part(0.0, other) >= confidence:
            return 0.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self._part(middle, other) < confidence:
                low = middle
            else:
                high = middle
        return high

    def part_within(self, angle: float) -> float:
        """Part of the time within an angle [rad]."""
        return self._part(angle, np.zeros(len(self.inside)))

    def _part(self, angle: float, beside: np.ndarray) -> float:
        """Part of the time within an angle, less what is ``beside`` (n,)."""
        x, rows = angle - beside, np.arange(len(self.inside))
        if self.angle.size == 1:
            return float(self.shares @ (x >= 0.0))
        below = np.clip(np.searchsorted(self.angle, x) - 1, 0, self.angle.size - 2)
        left, right = self.angle[below], self.angle[below + 1]
        share = np.clip((x - left) / (right - left), 0.0, 1.0)
        low, high = self.inside[rows, below], self.inside[rows, below + 1]
        return float(self.shares @ np.where(x >= 0.0, low + share * (high - low), 0.0))


def within_all(spreads: Sequence[Distribution], confidence: float) -> float:
    """Angle [rad] that all of several errors certainly stay within for a part ``confidence`` of what
    they are spread over: the parts in which they pass it add, as if they never did so together.
    """
    if len(spreads) == 1:
        return spreads[0].within(confidence)
    low = max(one.within(confidence) for one in spreads)
    high = max(one.within(1.0 - (1.0 - confidence) / len(spreads)) for one in spreads)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if sum(1.0 - one.part_within(middle) for one in spreads) > 1.0 - confidence:
            low = middle
        else:
            high = middle
    return high


def confidence_level_angle(
    amplitudes: Sequence[float] | np.ndarray,
    sigma: np.ndarray | float,
    confidence: float = 0.997,
    *,
    frequency: np.ndarray | None = None,
    clock: np.ndarray | None = None,
    shares: np.ndarray | None = None,
) -> float:
    """Angle [rad] that the sum of lines and Gaussian noise stays within for a part ``confidence``
    of the time.

    Of lines and noise as ``distribution`` takes them.
    """
    spread = distribution(amplitudes, sigma, frequency=frequency, clock=clock, shares=shares)
    return spread.within(confidence)


def distribution(
    amplitudes: Sequence[float] | np.ndarray,
    sigma: np.ndarray | float | ErrorRows,
    *,
    frequency: np.ndarray | None = None,
    clock: np.ndarray | None = None,
    shares: np.ndarray | None = None,
    noise_ratio: float = _SMALL,
) -> Distribution:
    """How the sum of lines and Gaussian noise is spread over time.

    ``amplitudes`` of lines 0-to-peak, each arcsine-distributed, of unrelated phases; ``sigma`` of
    the noise, of all rows or of each (n,), or independent errors of other kinds, noise among them
    (then over time and over all that may be). Several rows (n, k) are ``shares`` (n,) of the time with
    amplitudes of their own,
    equal ones where none are given. Lines below ``noise_ratio`` of the largest count as noise. The
    densities are convolved as products of their characteristic functions, J_0(x A) and exp(-(x
    sigma)^2/2), in a Fourier series over twice what can be reached: within 1e-3 of the angle. Lines
    of one ``clock`` (k,), a number of 0 or more, keep their phases to each other where they are
    harmonics (``in_step.bases``): with their complex amplitudes and their ``frequency`` (k,) [Hz]
    the density of their sum takes the place of theirs. Those that are none drift, and count as
    unrelated.
    """
    moved = np.atleast_2d(np.asarray(amplitudes))
    lines = np.abs(moved)
    f, of = (
        np.full(lines.shape[1], -1) if x is None else np.asarray(x) for x in (frequency, clock)
    )
    if shares is None:
        shares = np.full(len(lines), 1.0 / len(lines))
    small = _lines_counted_as_noise(lines, of, noise_ratio)
    errors = sigma if isinstance(sigma, ErrorRows) else None
    gaussian = 0.0 if isinstance(sigma, ErrorRows) else np.asarray(sigma)
    noise = np.hypot(gaussian, np.sqrt(0.5 * np.sum(lines[:, small] ** 2, axis=1)))
    lines, moved, f, of = lines[:, ~small], moved[:, ~small], f[~small], of[~small]
    beside = 0.0 if errors is None else errors.reach
    reach = 1.02 * float(np.max(lines.sum(axis=1) + 8.0 * noise + beside, initial=0.0))
    if not noise.any() and (closed := _in_closed_form(lines, errors, shares)) is not None:
        return closed
    at = np.pi * np.arange(1, _TERMS_OF_LEVEL) / reach
    each = np.exp(-0.5 * np.outer(noise, at) ** 2)
    if errors is not None:
        # noise of one cell of the angle keeps the series of a narrow spread about a mean from ringing
        each = each * errors.with_noise(reach / _TERMS_OF_LEVEL).transform(at)
    # without errors sums are taken as even: which sign they have then does not matter
    sums, alone = _transform_of_harmonics(moved, f, of, reach, even=errors is None)
    each = each * sums
    _multiply_unrelated(each, lines[:, alone], at)
    return Distribution(*_integral_of_series(each.real, reach), shares)


def _in_closed_form(
    lines: np.ndarray, errors: ErrorRows | None, shares: np.ndarray
) -> Distribution | None:
    """Distribution without noise: of nothing, of a known error alone, or of one line (n, 1); None of
    others.
    """
    if not lines.any() and (errors is None or not np.any(errors.reach)):
        return Distribution(np.zeros(1), np.ones((len(lines), 1)), shares)
    if errors is not None and errors.known and not lines.any():
        return _of_known(np.broadcast_to(np.abs(errors.mean), len(lines)), shares)
    if errors is None and lines.shape[1] == 1:
        largest = float(lines.max())
        angle = largest * np.sin(np.linspace(0.0, 0.5 * np.pi, _TERMS_OF_LEVEL))
        over = angle / np.maximum(lines, 1e-300)
        return Distribution(angle, 2.0 / np.pi * np.arcsin(np.minimum(over, 1.0)), shares)
    return None


def _transform_of_harmonics(
    moved: np.ndarray, f: np.ndarray, of: np.ndarray, reach: float, *, even: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Characteristic function (n, _TERMS_OF_LEVEL - 1) of lines (n, k) that are harmonics of one
    clock, each sum as often with either sign where taken as ``even``, and which lines (k,) are not
    among them.
    """
    found = np.ones((len(moved), _TERMS_OF_LEVEL - 1), dtype=float if even else complex)
    alone = of < 0
    for one in np.unique(of[~alone]):
        its = np.flatnonzero(of == one)
        for group, base in bases(f[its], np.abs(moved[:, its]).max(axis=0)):
            if group.size == 1:
                alone[its[group]] = True
            else:
                sums = _transform_of_sum(f[its[group]] / base, moved[:, its[group]], reach)
                found *= sums.real if even else sums
    return found, alone


def _integral_of_series(transform: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles (t,) [rad] and the part of the time (n, t) within them, of a characteristic function
    (n, t - 1) at pi n / reach.

    On (-reach, reach) the density is a series of cosines c_n cos(pi n x / reach) with c_n the
    characteristic function; this is its integral from -x to x.
    """
    n = np.arange(1, _TERMS_OF_LEVEL)
    terms = np.zeros((len(transform), 2 * _TERMS_OF_LEVEL))
    terms[:, 1:_TERMS_OF_LEVEL] = 2.0 / (np.pi * n) * transform
    x = np.arange(_TERMS_OF_LEVEL) / _TERMS_OF_LEVEL
    inside = x - np.fft.rfft(terms, axis=1)[:, :_TERMS_OF_LEVEL].imag
    return reach * x, np.clip(np.maximum.accumulate(inside, axis=1), 0.0, 1.0)


def _of_known(size: np.ndarray, shares: np.ndarray) -> Distribution:
    """Distribution of what is ``size`` (n,) [rad] in each row, with either sign."""
    just_below = size * (1.0 - 1e-12)
    angle = np.unique(np.concatenate([np.zeros(1), size, just_below]))
    return Distribution(angle, (angle >= size[:, None]).astype(float), shares)


def _multiply_unrelated(each: np.ndarray, lines: np.ndarray, at: np.ndarray) -> None:
    """Multiply transforms (n, m) at ``at`` (m,) by those of ``lines`` (n, k) of unrelated phases,
    the largest first: of many lines the product soon vanishes, and its tail is not computed.
    """
    from scipy.special import j0

    for k in np.argsort(-lines.max(axis=0, initial=0.0)):
        counts = np.flatnonzero(np.abs(each).max(axis=0) > _VANISHING)
        end = counts[-1] + 1 if counts.size else 0
        each[:, end:] = 0.0
        each[:, :end] *= j0(np.outer(lines[:, k], at[:end]))


def _lines_counted_as_noise(lines: np.ndarray, clock: np.ndarray, noise_ratio: float) -> np.ndarray:
    """Which of the lines (n, k) count as noise of their mean square, (k,): of a ``clock`` (k,) only
    as many as together, at their crests, are that small, for they may all crest at once."""
    crests = lines.max(axis=0, initial=0.0)
    most = noise_ratio * crests.max(initial=0.0)
    small = np.asarray(crests < most)
    for one in np.unique(clock[clock >= 0]):
        its = np.flatnonzero(clock == one)
        order = its[np.argsort(crests[its])]
        small[order] = np.cumsum(crests[order]) < most
    return small


def _instants(orders: np.ndarray) -> int:
    """Number of instants at which no two of the harmonics (k,) are one, and none is still: a prime,
    so that none skips any.
    """
    for instants in _INSTANTS:
        left = orders % instants
        seen = np.minimum(left, instants - left)
        if seen.all() and np.unique(seen).size == np.unique(orders).size:
            return instants
    return _INSTANTS[0]


def _transform_of_sum(ratio: np.ndarray, rows: np.ndarray, half: float) -> np.ndarray:
    """Characteristic function of the sum of lines that keep their phases, at pi
    n/``half``, of each row (m, k).

    They are the harmonics ``ratio`` (k,), whole numbers but for rounding, of what they repeat with.
    """
    orders = np.rint(ratio).astype(np.int64)
    instants = _instants(orders)
    parts = np.array_split(np.arange(instants), max(instants * ratio.size // _AT_ONCE, 1))
    roots = np.exp(2j * np.pi / instants * np.arange(instants))
    sums = np.vstack([(roots[np.outer(part, orders) % instants] @ rows.T).real for part in parts])
    cells, found = 2 * _TERMS_OF_LEVEL, []
    for moved in sums.T:
        place = (moved / half + 1.0) * _TERMS_OF_LEVEL
        left = np.floor(place).astype(int)
        share = place - left
        density = np.bincount(left, 1.0 - share, cells) + np.bincount(
            (left + 1) % cells, share, cells
        )
        found.append(np.fft.rfft(density)[1:_TERMS_OF_LEVEL].conj() / instants)
    return np.array(found) * (-1.0) ** np.arange(1, _TERMS_OF_LEVEL)


def windowed_amplitudes(
    metric: Metric,
    frequency: np.ndarray,
    amplitude: np.ndarray,
    window: float,
    apart: float | None = None,
    instants: np.ndarray = HALF_WINDOW.instants,
) -> np.ndarray:
    """Complex amplitudes [rad] that lines (k,), 0-to-peak, have in a window, (n, k): rows for
    ``confidence_level_angle`` and ``worst_case_angle``.

    What moves about the mean or the fitted line is not the same throughout a window: rows are
    ``instants`` in it, from 0 in its middle to 1 at its end, and from -1 for lines that keep their
    phases, which tell both halves apart. Those of ``WindowCells`` go with their shares of the time
    (``row_shares``); ``UNIFORM_INSTANTS`` are for ``worst_case_angle``. Metrics that are one value
    of a window have one row.
    """
    A, f = np.asarray(amplitude), np.asarray(frequency, dtype=float)
    u = np.pi * f * window
    if metric not in WITHIN_WINDOW:
        change = np.exp(2j * np.pi * f * (window if apart is None else apart)) - 1.0
        mean = np.sinc(u / np.pi) if metric in ("mpe", "pde") else 1.0
        return np.asarray(A * mean * (change if metric in ("stability", "pde") else 1.0))[None]
    tau = instants[:, None]
    slope = 3.0j * _spherical(1, u) * tau
    about = {"smear": slope, "rpe": np.exp(1j * u * tau) - np.sinc(u / np.pi)}
    if metric in about:
        moved = about[metric]
    else:
        moved = about["rpe"] - slope
    return np.asarray(A * moved)


WITHIN_WINDOW: tuple[Metric, ...] = ("rpe", "smear", "jitter")
"""Metrics that differ from one instant of a window to another."""


def row_shares(metric: Metric, cells: WindowCells) -> np.ndarray:
    """Shares of the time, (n,), of the rows of ``windowed_amplitudes`` at the cells' instants."""
    if metric in WITHIN_WINDOW:
        return cells.shares
    return np.ones(1)


def slope_in_window(
    metric: Metric, frequency: np.ndarray, window: float, instants: np.ndarray
) -> np.ndarray:
    """How fast lines (k,) of amplitude 1 change with the instant in a window, (n, k), from -1 to 1.

    A shift in time, the same for all lines, changes no distribution over time, and turns a line
    exp(i u tau) that moves about its mean into 1: what is left is the change of 1 less the mean or
    fitted line, over exp(i u tau).
    """
    u = np.pi * np.asarray(frequency, dtype=float) * window
    mean, slope = u * np.sinc(u / np.pi), 3.0 * _spherical(1, u)
    tau = instants[:, None]
    found = {
        "rpe": np.abs(mean) * np.ones_like(tau),
        "smear": np.abs(slope) * np.ones_like(tau),
        "jitter": np.hypot(slope - mean, u * slope * tau),
    }
    return np.asarray(found[metric])


def curvature_in_window(metric: Metric, frequency: np.ndarray, window: float) -> np.ndarray:
    """Largest second derivative of the same, (k,)."""
    u = np.pi * np.asarray(frequency, dtype=float) * window
    mean, slope = np.abs(u**2 * np.sinc(u / np.pi)), 3.0 * np.abs(u * _spherical(1, u))
    found = {"rpe": mean, "smear": np.zeros_like(u), "jitter": mean + (2.0 + u) * slope}
    return np.asarray(found[metric])


def change_within_cells(
    metric: Metric, frequency: np.ndarray, window: float, cells: WindowCells
) -> np.ndarray:
    """By how much lines (k,) of amplitude 1 differ within cells from what they are in the middle,
    at most, (n, k).
    """
    if metric not in WITHIN_WINDOW:
        return np.zeros((1, np.size(frequency)))
    reach = cells.reach[:, None]
    return reach * slope_in_window(
        metric, frequency, window, cells.instants
    ) + 0.5 * reach**2 * curvature_in_window(metric, frequency, window)


def excess_between_instants(
    metric: Metric, frequency: np.ndarray, window: float, spacing: float
) -> np.ndarray:
    """By how much lines (k,) of amplitude 1 may be larger between two instants ``spacing`` apart
    than at both of them, (k,).
    """
    u = np.pi * np.asarray(frequency, dtype=float) * window
    if metric not in WITHIN_WINDOW or metric == "smear":  # a straight line is largest at its end
        return np.zeros_like(u)
    left = np.abs(np.sinc(u / np.pi))
    if metric == "jitter":
        left = left + 3.0 * np.abs(_spherical(1, u))
    # 1 less the mean or fitted line is between 1 - left and 1 + left everywhere
    curved = spacing**2 / 8.0 * curvature_in_window(metric, frequency, window)
    return np.asarray(np.minimum(curved, 2.0 * left))


def worst_case_angle(
    amplitudes: Sequence[float] | np.ndarray, sigma: np.ndarray | float, sigmas: float = 3.0
) -> float:
    """Angle [rad] that is passed only by the noise's own excess: at the worst instant all lines at
    their crests, and ``sigmas`` times the ``sigma`` that noise has there, a number or (n,).
    """
    crests = np.sum(np.abs(np.atleast_2d(amplitudes)), axis=1)
    return float(np.max(crests + sigmas * np.asarray(sigma), initial=0.0))


# ---- Image: modulation transfer ----


def transfer_of_line(amplitude: float, nu: np.ndarray | float) -> np.ndarray:
    """MTF of a sinusoidal motion of ``amplitude`` [rad], fast against the exposure, at ``nu``
    [cycles/rad].
    """
    from scipy.special import j0

    return np.asarray(j0(2.0 * np.pi * amplitude * np.asarray(nu, dtype=float)))


def transfer_of_smear(length: float, nu: np.ndarray | float) -> np.ndarray:
    """MTF of a steady motion over ``length`` [rad] during the exposure."""
    return np.sinc(length * np.asarray(nu, dtype=float))


def transfer_of_noise(sigma: float, nu: np.ndarray | float) -> np.ndarray:
    """MTF of a random motion of standard deviation ``sigma`` [rad], fast against the exposure."""
    return np.asarray(np.exp(-2.0 * (np.pi * sigma * np.asarray(nu, dtype=float)) ** 2))


def transfer_in_window(
    frequency: np.ndarray,
    amplitude: np.ndarray,
    sigma: float,
    window: float,
    nu: np.ndarray | float,
    smear: float = 0.0,
) -> np.ndarray:
    """MTF of lines and noise in an exposure of ``window`` [s]: of each line its jitter as a
    sinusoid, of all together the smear.

    The smear's length is that of a steady motion with the same mean square, sqrt(12 x mean square);
    the lines' phases count as unrelated. ``sigma`` is the noise's jitter in this window, ``smear``
    the rms of its straight-line motion.
    """
    jitter = np.sqrt(2.0 * mean_square_of_lines("jitter", frequency, amplitude, window))
    straight = float(np.sum(mean_square_of_lines("smear", frequency, amplitude, window)))
    length = math.sqrt(12.0 * (straight + smear**2))
    total = transfer_of_smear(length, nu) * transfer_of_noise(sigma, nu)
    for one in jitter:
        total = total * transfer_of_line(float(one), nu)
    return np.asarray(total)
