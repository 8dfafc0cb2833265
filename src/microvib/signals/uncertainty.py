"""How well fitted tones are known, from the floor of the spectrum about them."""

from __future__ import annotations

import numpy as np

from microvib.signals import tone_kernel as hann
from microvib.signals.line_table import Uncertainty
from microvib.signals.tones import HannSpectrum, Tones, mean_of_decay

_NUDGE = 1e-4
"""Step of difference quotients, in cycles or e-foldings over the record."""
_FEW = 1.08
"""Widens what follows from a floor: a median of some thirty bins, not all independent, is itself off by a sixth."""
_USUAL = 2.0
"""RMS of what is left in a tone's own bins, over that of the noise, which noise alone hardly exceeds."""
_HIDES = 5.0
"""What a line within a bin of another adds to it, over what it leaves: the fit of the one takes most of the other along."""


def uncertainties(
    tones: Tones, amplitudes: np.ndarray, ratio: float | None, spectrum: HannSpectrum, rest: HannSpectrum
) -> tuple[Uncertainty, float | None]:
    """Standard uncertainties of all that was fitted, jointly: amplitudes, phases, frequencies and decays, and the clock ratio.

    Noise is taken as Gaussian, with the local floor of ``rest`` (the spectrum without the tones) as its size and the
    correlation between neighbouring bins that a Hann window makes. Amplitudes of decaying tones are their means over the
    record. The clock ratio's is None without a ``ratio``.
    """
    m, duration = len(tones), spectrum.duration
    amplitude, phase, frequency, decay = (np.zeros(m) for _ in range(4))
    result = Uncertainty(amplitude, phase, frequency, decay)
    if m == 0:
        return result, None
    near = spectrum.near(tones.frequency)
    free, falls = (np.flatnonzero(some).tolist() for some in (tones.free, tones.falls))
    slopes = [_slope(tones, amplitudes, near, spectrum, k, moves=(_NUDGE, 0.0)) for k in free]
    slopes += [_slope(tones, amplitudes, near, spectrum, k, moves=(0.0, _NUDGE)) for k in falls]
    if ratio is not None:
        slopes.append(_ratio_slope(tones, amplitudes, ratio, near, spectrum))
    columns = np.vstack([spectrum.equations(tones, near), *slopes])
    covariance = _sandwich(columns, near, _noise(tones, near, rest))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    ratio_spread = None if ratio is None else float(spread[-1])
    frequency[:] = [(ratio_spread or 0.0) * line.frequency for line in tones.lines]
    first = 2 * m + 1
    frequency[free] = spread[first : first + len(free)] / duration
    place = first + len(free) + np.arange(len(falls))
    decay[falls] = spread[place] / duration
    mean, slope = mean_of_decay(tones.decay * duration)
    size, angle, each = np.abs(amplitudes), np.angle(amplitudes), np.arange(m)
    along, across = np.zeros((2, m, covariance.shape[0]))
    across[each, 2 * each], across[each, 2 * each + 1] = -np.sin(angle), np.cos(angle)
    along[each, 2 * each], along[each, 2 * each + 1] = mean * np.cos(angle), mean * np.sin(angle)
    along[falls, place] = size[falls] * slope[falls]
    amplitude[:] = _spread(along, covariance)
    phase[:] = np.divide(_spread(across, covariance), size, out=np.full(m, np.inf), where=size > 0.0)
    return result, ratio_spread


def _spread(directions: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard uncertainty along each of the ``directions`` (m, p), (m,)."""
    spread: np.ndarray = np.sqrt(np.maximum(np.sum((directions @ covariance) * directions, axis=1), 0.0))
    return spread


def _stack(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _slope(
    tones: Tones, amplitudes: np.ndarray, near: np.ndarray, spectrum: HannSpectrum, k: int, moves: tuple[float, float]
) -> np.ndarray:
    """Change of the model at the bins ``near`` with frequency or decay of tone ``k``, in cycles or e-foldings."""
    cycles, decay = tones.frequency[k] * spectrum.duration, tones.decay[k] * spectrum.duration
    base = hann.tone(cycles, decay, amplitudes[k], near, spectrum.table)
    moved = hann.tone(cycles + moves[0], decay + moves[1], amplitudes[k], near, spectrum.table)
    return _stack(moved - base) / sum(moves)


def _ratio_slope(
    tones: Tones, amplitudes: np.ndarray, ratio: float, near: np.ndarray, spectrum: HannSpectrum
) -> np.ndarray:
    """Change of the model with the clock ratio, which moves all lines of the clock together."""
    clock = [
        (line.frequency * spectrum.duration, a)
        for line, a, own in zip(tones.lines, amplitudes, tones.clock, strict=True)
        if own
    ]
    nudge = _NUDGE / max((cycles for cycles, _ in clock), default=1.0)
    total = np.zeros(near.size, dtype=complex)
    for cycles, a in clock:
        total += hann.tone(cycles * (ratio + nudge), 0.0, a, near, spectrum.table)
        total -= hann.tone(cycles * ratio, 0.0, a, near, spectrum.table)
    return _stack(total) / nudge


def _noise(tones: Tones, near: np.ndarray, rest: HannSpectrum) -> np.ndarray:
    """RMS of real and imaginary part of the noise at each bin of ``near``, from what is left about the closest tone.

    That is the floor; where the bins of the tone itself are left with more than noise leaves, the tone is not all that is there,
    and what it does not explain counts as noise.
    """
    floors, left = _floors(tones, rest)
    centres = tones.frequency * rest.duration
    closest = np.argmin(np.abs(near[:, None] - centres[None, :]), axis=1)
    noise = np.sqrt((_FEW * floors) ** 2 + _HIDES**2 * np.maximum(left**2 - (_USUAL * floors) ** 2, 0.0))
    result: np.ndarray = noise[closest]
    return result


def disturbed(tones: Tones, rest: HannSpectrum) -> np.ndarray:
    """Which tones are not all that is in their bins, or change within the record, (m,): more is left there than noise leaves."""
    floors, left = _floors(tones, rest)
    found: np.ndarray = left > _USUAL * floors
    return found


def _floors(tones: Tones, rest: HannSpectrum) -> tuple[np.ndarray, np.ndarray]:
    """RMS of real and imaginary part of the noise about each tone, and of what is left in its own bins, (m,) each."""
    # median of a Rayleigh distribution is sqrt(2 ln 2) times the RMS of one of its parts
    floors = rest.floors(tones.frequency) / np.sqrt(2.0 * np.log(2.0))
    return floors, hann.bin_rms(tones.frequency * rest.duration, rest.values) / np.sqrt(2.0)


def _sandwich(columns: np.ndarray, near: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of the least-squares solution, its ``columns`` (p, 2 n), under noise that a Hann window has correlated."""
    scale = np.sqrt(np.einsum("ij,ij->i", columns, columns))
    scale[scale == 0.0] = 1.0
    scaled = columns / scale[:, None]
    inverse = np.linalg.pinv(scaled @ scaled.T, rcond=1e-12, hermitian=True) / scale[:, None]
    result: np.ndarray = inverse @ (scaled @ hann.correlated(scaled, near, noise).T) @ inverse.T
    return result
