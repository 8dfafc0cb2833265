"""From the kernel's interval means to samples without aliasing.

The kernel gives every channel as its mean over intervals of 1/(4 f_s), jumps included: that is a boxcar filter, exact, with
zeros at all multiples of 4 f_s. A symmetric FIR filter then takes the band of the record, makes good the boxcar's droop,
and every fourth value is kept. Up to 0.35 f_s a tone keeps its amplitude within 1e-4 and its phase exactly. What would fold
into that band is 80 dB down, but for the neighbourhoods of the multiples of 4 f_s: there the boxcar alone holds it back, by
20 dB at 0.35 f_s from the multiple and ever more towards it. The torques themselves are small there: of a
jump of height a, f_d times a second, an order k line has a / (pi k).
"""

from __future__ import annotations

import numpy as np

from microvib.solve.kernel import filter_and_decimate

FACTOR = 4
PASSBAND = 0.35
"""Edge of the flat band, as a fraction of the sample rate."""

HALF = 9 * FACTOR
_BETA = 7.86  # Kaiser window, 80 dB


def _taps() -> np.ndarray:
    """Linear-phase low-pass at f_s/2 with the inverse of the boxcar's response in its passband, by frequency sampling."""
    grid = 4096
    f = np.arange(grid // 2 + 1) / grid  # in cycles per internal interval; f_s / 2 is 1/8
    response = np.where(f <= 0.5 / FACTOR, 1.0 / np.sinc(f), 0.0)
    kernel = np.roll(np.fft.irfft(response, grid), HALF)[: 2 * HALF + 1]
    taps: np.ndarray = kernel * np.kaiser(2 * HALF + 1, _BETA)
    return taps / taps.sum()


class Decimator:
    """Streaming filter over rows (time, channel); keeps what the next block needs."""

    def __init__(self) -> None:
        self._taps = _taps()
        self._left = np.zeros((0, 0))

    def push(self, rows: np.ndarray) -> np.ndarray:
        """Samples that can be made once ``rows`` (n, channels) have come; the first belongs to input row ``HALF``."""
        rows = np.concatenate([self._left, rows]) if self._left.size else rows
        out = np.empty((max((rows.shape[0] - self._taps.size) // FACTOR + 1, 0), rows.shape[1]))
        # Compiled, not a matrix product: threads of BLAS collapse where other processes keep the cores busy.
        filter_and_decimate(rows, self._taps, FACTOR, out)
        self._left = rows[out.shape[0] * FACTOR :].copy()
        return out
