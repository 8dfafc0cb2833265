"""Standard uncertainties of the lines of a joint fit, from what the fit leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microvib.signals import tone_kernel as hann
from microvib.signals.line_table import Uncertainty
from microvib.signals.tone_kernel import REACH
from microvib.signals.tones import JointFit, mean_of_decay

_CLOCK_STEPS = 3
_LONGEST_CLOCK_STEP, _CLOCK_FOUND = 0.1, 1e-5
"""Movements [bins] of the clock's highest line: the longest in a step, and that at which the clock
is found.
"""
_NUDGE = 1e-4  # step of difference quotients, in cycles or e-foldings over the record
# distance [bins] from a tone within which its fit takes away much of the noise, a third of it and
# more
_ABSORPTION_DISTANCE = 2.0
_NOISE_BIN_OFFSETS = np.concatenate(
    [np.arange(-20, -3), np.arange(4, 21)]
)  # bins about a tone over which its noise is taken
_MIN_NOISE_BINS = 6  # bins of those that no tone absorbs, below which all are taken
# RMS of the residual in a tone's own bins, over that of the noise, which noise alone hardly exceeds
_MAX_NOISE_RATIO = 2.0
_MAX_INVERSE_ENTRY = 1e4  # largest entry of an inverse that is taken as it is
# effect of a hidden line on one within a bin, over the residual it leaves: the fit absorbs most of
# it
_HIDDEN_LINE_FACTOR = 5.0


def uncertainties(
    joint: JointFit, ratio: float | None = None, telling: np.ndarray | None = None
) -> tuple[Uncertainty, float | None]:
    """Standard uncertainties of everything fitted, jointly: amplitudes, phases, frequencies and
    decays, and the clock ratio.

    With the columns X of the linearised least-squares fit, noise of covariance N gives the
    parameters the covariance E N E^T with E = (X X^T)^-1 X (``_estimators``). The clock ratio is
    that of ``with_weighted_clock``, from the lines ``telling`` (m,), and its error moves all else.
    The noise is taken as Gaussian; its size is the local floor of the residual spectrum, and
    neighbouring bins are correlated by the Hann window. Amplitudes of decaying tones are averages
    over the record. The uncertainty of the clock ratio is None without a ``ratio``.
    """
    tones, spectrum = joint.tones, joint.spectrum
    m, duration, near = len(tones), spectrum.duration, spectrum.near(tones.frequency)
    if m == 0:
        return Uncertainty(*np.zeros((4, 0))), None
    free, falls = np.flatnonzero(tones.free), np.flatnonzero(tones.falls)
    columns, noise = _columns(joint, near), _noise(joint, near)
    fold, by = tones.decay * duration, _estimators(columns)
    if ratio is not None and telling is not None:
        of_ratio = _ratio_estimator(joint, columns, near, noise, ratio, telling)
        moved = by @ _ratio_slope(joint, near, ratio, tones.clock)
        by = np.vstack([by - np.outer(moved, of_ratio), of_ratio])

    def spread(rows: np.ndarray) -> np.ndarray:
        return np.sqrt(np.maximum(np.sum(rows * hann.correlated(rows, near, noise), axis=1), 0.0))

    turns, decays = by[2 * m + 1 :][: free.size], np.zeros((m, by.shape[1]))
    decays[falls] = by[2 * m + 1 + free.size :][: falls.size]
    along, across = _directions(
        joint.amplitudes, fold, by[0 : 2 * m : 2], by[1 : 2 * m : 2], decays
    )
    if ratio is None:
        ratio_spread = None
    else:
        ratio_spread = float(spread(by[-1:])[0])
    frequency = (ratio_spread or 0.0) * np.array([line.frequency for line in tones.lines])
    frequency[free], decay = spread(turns) / duration, np.zeros(m)
    decay[falls] = spread(decays[falls]) / duration
    return _of_spreads(
        joint.amplitudes, spread(along), spread(across), frequency, decay
    ), ratio_spread


def isolated_uncertainties(joint: JointFit, which: Sequence[int]) -> Uncertainty:
    """``uncertainties`` of some tones, of each as if it were alone in what all tones leave beside
    it.
    """
    tones, table = joint.tones.only(np.array(which, dtype=int)), joint.spectrum.table
    amplitudes, duration, size = (
        joint.amplitudes[list(which)],
        joint.spectrum.duration,
        joint.spectrum.values.size,
    )
    cycles, fold, one = (
        tones.frequency * duration,
        tones.decay * duration,
        np.zeros(1, dtype=np.int64),
    )
    width = 2 * REACH + 1
    columns = np.zeros((len(which), 5, 2, width))  # bins beyond the spectrum's ends stay empty
    for i, centre in enumerate(np.rint(cycles).astype(int).tolist()):
        k = np.arange(max(centre - REACH, 0), min(centre + REACH + 1, size))
        found = hann.linearised(
            cycles[i : i + 1], fold[i : i + 1], amplitudes[i : i + 1], one, one, k, table
        )
        columns[i, :, :, : k.size] = found.reshape(5, 2, k.size)
    columns[:, 3] *= tones.free[:, None, None]
    columns[:, 4] *= tones.falls[:, None, None]
    by = _estimators(columns.reshape(-1, 5, 2 * width))
    along, across = _directions(amplitudes, fold, by[:, 0], by[:, 1], by[:, 4])
    rows = np.concatenate([along, across, by[:, 3], by[:, 4]])
    squares = np.sum(
        rows * hann.correlated(rows, np.arange(width), np.ones(width)), axis=1
    ).reshape(4, -1)
    spread = _noise_about(joint, tones.frequency) * np.sqrt(np.maximum(squares, 0.0))
    return _of_spreads(amplitudes, spread[0], spread[1], spread[2] / duration, spread[3] / duration)


def _directions(
    amplitudes: np.ndarray,
    fold: np.ndarray,
    cosine: np.ndarray,
    sine: np.ndarray,
    decay: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimators of amplitudes over the record and of phases, from those of real and imaginary parts and decays, (m, 2 n) each."""
    mean, slope = mean_of_decay(fold)
    size, x, y = np.abs(amplitudes), np.cos(np.angle(amplitudes)), np.sin(np.angle(amplitudes))
    along = (
        (mean * x)[:, None] * cosine + (mean * y)[:, None] * sine + (size * slope)[:, None] * decay
    )
    return along, x[:, None] * sine - y[:, None] * cosine


def _of_spreads(
    amplitudes: np.ndarray,
    along: np.ndarray,
    across: np.ndarray,
    frequency: np.ndarray,
    decay: np.ndarray,
) -> Uncertainty:
    size = np.abs(amplitudes)
    phase = np.divide(across, size, out=np.full(size.size, np.inf), where=size > 0.0)
    return Uncertainty(along, phase, frequency, decay)


def _stack(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def with_weighted_clock(
    joint: JointFit, ratio: float, telling: np.ndarray
) -> tuple[JointFit, float]:
    """The fit and its clock ratio after Gauss-Newton steps of the ratio in which each bin has the
    weight that its noise gives it, from the tones of the clock that are ``telling`` (m,).

    Equal weights would let what is left beside large lines of low order, such as a mode that rings
    there, pull lines of high order, which tell the clock sharply.
    """
    highest = float(np.max(joint.tones.frequency[telling], initial=0.0)) * joint.spectrum.duration
    if highest == 0.0:
        return joint, ratio
    for _ in range(_CLOCK_STEPS):
        near = joint.spectrum.near(joint.tones.frequency)
        columns, noise = _columns(joint, near), _noise(joint, near)
        estimator = _ratio_estimator(joint, columns, near, noise, ratio, telling)
        step = float(estimator @ _stack(joint.rest.values[near]))
        limit = _LONGEST_CLOCK_STEP * ratio / highest
        step = min(max(step, -limit), limit)
        tones = joint.tones
        frequency = np.where(tones.clock, tones.frequency * (1.0 + step / ratio), tones.frequency)
        joint = JointFit.of(joint.spectrum, replace(tones, frequency=frequency))
        ratio += step
        if abs(step) * highest < _CLOCK_FOUND * ratio:
            break
    return joint, ratio


def _columns(joint: JointFit, near: np.ndarray) -> np.ndarray:
    """Columns of the linearised fit at the bins ``near`` and a known clock."""
    tones, duration = joint.tones, joint.spectrum.duration
    cycles, fold = tones.frequency * duration, tones.decay * duration
    free, falls = np.flatnonzero(tones.free), np.flatnonzero(tones.falls)
    return hann.linearised(cycles, fold, joint.amplitudes, free, falls, near, joint.spectrum.table)


def _ratio_estimator(
    joint: JointFit,
    columns: np.ndarray,
    near: np.ndarray,
    noise: np.ndarray,
    ratio: float,
    telling: np.ndarray,
) -> np.ndarray:
    """Estimator (2 n,) of the clock ratio from what a fit leaves, each bin with the weight of its
    ``noise`` (n,): what the ratio changes in the lines ``telling``, less what all else in the fit,
    its ``columns``, can make of that.
    """
    weight = 1.0 / np.maximum(np.tile(noise, 2), 1e-300)
    others, slope = columns * weight, _ratio_slope(joint, near, ratio, telling) * weight
    alone = slope - (_estimators(others) @ slope) @ others
    size = float(alone @ alone)
    if size == 0.0:
        return np.zeros_like(alone)
    return alone / size * weight


def _ratio_slope(joint: JointFit, near: np.ndarray, ratio: float, moving: np.ndarray) -> np.ndarray:
    """Change of the model with the clock ratio, which moves the tones ``moving`` (m,) together."""
    tones, spectrum = joint.tones, joint.spectrum
    cycles = tones.frequency[moving] * spectrum.duration / ratio
    clock = list(zip(cycles.tolist(), joint.amplitudes[moving].tolist(), strict=True))
    nudge = _NUDGE / max((cycles for cycles, _ in clock), default=1.0)
    total = np.zeros(near.size, dtype=complex)
    for cycles, a in clock:
        total += hann.tone(cycles * (ratio + nudge), 0.0, a, near, spectrum.table)
        total -= hann.tone(cycles * ratio, 0.0, a, near, spectrum.table)
    return _stack(total) / nudge


def _noise(joint: JointFit, near: np.ndarray) -> np.ndarray:
    """RMS of real and imaginary part of the noise at each bin of ``near``, from the residual about
    the closest tone.

    That is the floor. Where the residual in the bins of the tone itself is larger than noise, the
    tone does not explain everything there, and the rest counts as noise.
    """
    centres = joint.tones.frequency * joint.spectrum.duration
    closest = np.argmin(np.abs(near[:, None] - centres[None, :]), axis=1)
    return _noise_about(joint, joint.tones.frequency)[closest]


def _noise_about(joint: JointFit, frequency: np.ndarray) -> np.ndarray:
    """Noise about tones at each ``frequency`` [Hz]."""
    floors, left = _floors(joint, frequency)
    return np.sqrt(
        floors**2
        + _HIDDEN_LINE_FACTOR**2 * np.maximum(left**2 - (_MAX_NOISE_RATIO * floors) ** 2, 0.0)
    )


def poorly_fitted_tones(joint: JointFit) -> np.ndarray:
    """Which tones (m,) do not explain their bins, or change within the record: the residual there
    is larger than noise.
    """
    floors, left = _floors(joint, joint.tones.frequency)
    return left > _MAX_NOISE_RATIO * floors


def _floors(joint: JointFit, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """RMS of real and imaginary part of the noise about each ``frequency`` (m,) [Hz], and of the
    residual in its bins.

    The median of the bins that no tone absorbs: what fits take away is not missing in the noise. Of
    n bins, dependent by the Hann window, it is a scale of n/2 degrees of freedom, and wider by
    Student's t over a normal deviate, both at 95 %.
    """
    rest, size = joint.rest, joint.rest.values.size
    cycles = joint.tones.frequency * rest.duration
    near = np.rint(cycles).astype(int)[:, None] + np.arange(-3, 4)
    quiet = np.ones(size + 1, dtype=bool)
    quiet[
        near[(np.abs(near - cycles[:, None]) < _ABSORPTION_DISTANCE) & (near >= 0) & (near < size)]
    ] = False
    quiet[[0, 1, size]] = False  # the mean is absorbed, too
    k = np.rint(frequency * rest.duration).astype(int)[:, None] + _NOISE_BIN_OFFSETS
    k = np.where((k >= 1) & (k < size), k, size)
    free = quiet[k] | (np.count_nonzero(quiet[k], axis=1) < _MIN_NOISE_BINS)[:, None] & (k < size)
    values, count = (
        np.where(free, np.append(rest.magnitude, 0.0)[k], np.inf),
        np.count_nonzero(free, axis=1),
    )
    half = np.maximum(count, 2) / 2.0
    student = 1.0 + 1.21 / half + 1.44 / half**2  # Cornish and Fisher's expansion
    # median of a Rayleigh distribution is sqrt(2 ln 2) times the RMS of one of its parts
    floors = student * _medians(values, count) / np.sqrt(2.0 * np.log(2.0))
    return floors, hann.bin_rms(frequency * rest.duration, rest.values) / np.sqrt(2.0)


def _medians(values: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Median of the finite values of each row, of which there are ``count``; 0 where there are
    none. The rest is infinite.
    """
    values.sort(axis=1)
    each = np.arange(count.size)
    return np.where(
        count > 0, 0.5 * (values[each, (count - 1) // 2] + values[each, count // 2]), 0.0
    )


def _estimators(columns: np.ndarray) -> np.ndarray:
    """Estimators of the least-squares solution with ``columns`` (..., p, 2 n) from a right-hand side:
    (X X^T)^-1 X.
    """
    scale = np.sqrt(np.einsum("...ij,...ij->...i", columns, columns))
    empty = scale == 0.0
    scale[empty] = 1.0
    scaled = columns / scale[..., None]
    normal = scaled @ np.swapaxes(scaled, -1, -2)
    diagonal = np.einsum("...ii->...i", normal)
    diagonal[empty] = 1.0
    return (_inverse(normal) / scale[..., None]) @ scaled


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverse of matrices with ones on their diagonals; where tones can hardly be told apart, of
    what is left of them.
    """
    try:
        inverse = np.linalg.inv(normal)
        if np.max(np.abs(inverse), initial=0.0) < _MAX_INVERSE_ENTRY:
            return inverse
    except np.linalg.LinAlgError:
        pass
    return np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
