"""How well fitted tones are known, from the floor of the spectrum about them."""

from __future__ import annotations

import numpy as np

from microvib.signals import hann
from microvib.signals.table import Uncertainty
from microvib.signals.tones import HannSpectrum, Tones, mean_of_decay

_NUDGE = 1e-4
"""Step of difference quotients, in cycles or e-foldings over the record."""


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
    modes = np.flatnonzero(tones.modes).tolist()
    slopes = [_slopes(tones, amplitudes, near, spectrum, k) for k in modes]
    if ratio is not None:
        slopes.append(_ratio_slope(tones, amplitudes, ratio, near, spectrum))
    J = np.column_stack([spectrum.equations(tones, near), *slopes])
    covariance = _sandwich(J, near, _noise(tones, near, rest))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    ratio_spread = None if ratio is None else float(spread[-1])
    frequency[:] = [(ratio_spread or 0.0) * line.frequency for line in tones.lines]
    columns = {k: 2 * m + 1 + 2 * i for i, k in enumerate(modes)}
    for k, column in columns.items():
        frequency[k], decay[k] = spread[column : column + 2] / duration
    mean, slope = mean_of_decay(tones.decay * duration)
    for k, a in enumerate(amplitudes):
        size, angle = abs(a), np.angle(a)
        along, across = np.zeros(J.shape[1]), np.zeros(J.shape[1])
        across[2 * k : 2 * k + 2] = -np.sin(angle), np.cos(angle)
        along[2 * k : 2 * k + 2] = np.cos(angle), np.sin(angle)
        if k in columns:
            along *= mean[k]
            along[columns[k] + 1] = size * slope[k]
        amplitude[k] = np.sqrt(max(float(along @ covariance @ along), 0.0))
        phase[k] = np.sqrt(max(float(across @ covariance @ across), 0.0)) / size if size > 0.0 else np.inf
    return result, ratio_spread


def _stack(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _slopes(tones: Tones, amplitudes: np.ndarray, near: np.ndarray, spectrum: HannSpectrum, k: int) -> np.ndarray:
    """Change of the model at the bins ``near`` with frequency and with decay of tone ``k``, in cycles and e-foldings."""
    cycles, decay = tones.frequency[k] * spectrum.duration, tones.decay[k] * spectrum.duration
    base = hann.tone(cycles, decay, amplitudes[k], near, spectrum.table)
    higher = hann.tone(cycles + _NUDGE, decay, amplitudes[k], near, spectrum.table)
    faster = hann.tone(cycles, decay + _NUDGE, amplitudes[k], near, spectrum.table)
    return np.column_stack([_stack(higher - base), _stack(faster - base)]) / _NUDGE


def _ratio_slope(
    tones: Tones, amplitudes: np.ndarray, ratio: float, near: np.ndarray, spectrum: HannSpectrum
) -> np.ndarray:
    """Change of the model with the clock ratio, which moves all lines of the clock together."""
    clock = [
        (line.frequency * spectrum.duration, a)
        for line, a in zip(tones.lines, amplitudes, strict=True)
        if line.kind != "array mode"
    ]
    nudge = _NUDGE / max(cycles for cycles, _ in clock)
    total = np.zeros(near.size, dtype=complex)
    for cycles, a in clock:
        total += hann.tone(cycles * (ratio + nudge), 0.0, a, near, spectrum.table)
        total -= hann.tone(cycles * ratio, 0.0, a, near, spectrum.table)
    return _stack(total) / nudge


def _noise(tones: Tones, near: np.ndarray, rest: HannSpectrum) -> np.ndarray:
    """RMS of real and imaginary part of the noise at each bin of ``near``, from the floor about the closest tone."""
    # median of a Rayleigh distribution is sqrt(2 ln 2) times the RMS of one of its parts
    floors = rest.floors(tones.frequency) / np.sqrt(2.0 * np.log(2.0))
    centres = tones.frequency * rest.duration
    closest = np.argmin(np.abs(near[:, None] - centres[None, :]), axis=1)
    result: np.ndarray = floors[closest]
    return result


def _sandwich(J: np.ndarray, near: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of the least-squares solution under noise that a Hann window has correlated from bin to bin."""
    scale = np.sqrt(np.einsum("ij,ij->j", J, J))
    scale[scale == 0.0] = 1.0
    scaled = J / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True) @ scaled.T
    m = near.size
    correlated = np.zeros((inverse.shape[0], inverse.shape[0]))
    for lag, correlation in ((0, 1.0), (1, -2.0 / 3.0), (2, 1.0 / 6.0)):
        first = np.flatnonzero(np.isin(near + lag, near))
        second = np.searchsorted(near, near[first] + lag)
        for offset in (0, m):
            left = inverse[:, offset + first] * noise[first]
            right = inverse[:, offset + second] * noise[second]
            product = correlation * left @ right.T
            correlated += product if lag == 0 else product + product.T
    result: np.ndarray = correlated / np.outer(scale, scale)
    return result
