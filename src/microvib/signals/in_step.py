"""Lines that keep their phases to each other: whole multiples of one frequency.

Of lines that are stepped by one clock, but not at whole multiples of one frequency, phases drift:
10 Hz and 20.00001 Hz go through all phases to each other in a day, and an observation may fall
where all crest together.
"""

from __future__ import annotations

import numpy as np

SLOW = 0.01
"""Frequency [Hz] above which that is of which lines in step are multiples: what they do together
repeats within 100 s, and an observation sees all of it."""
LOCKED = 1e-8
"""Part by which a frequency may miss a whole multiple: tables have nine digits. At 10 Hz a phase
then drifts for months.
"""


def bases(frequency: np.ndarray, size: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Groups of lines that keep their phases to each other.

    Parameters
    ----------
    frequency : ndarray
        Of lines of one clock [Hz], (k,).
    size : ndarray
        Their sizes, (k,): a group begins with the largest line that is in none.

    Returns
    -------
    list of (ndarray, float)
        Numbers of the lines of each group, and the frequency [Hz] of which they are whole multiples. A line that is in step with no
        other is alone, with its own.
    """
    found: list[tuple[list[int], float]] = []
    for k in np.argsort(-np.asarray(size, dtype=float), kind="stable").tolist():
        f = float(frequency[k])
        for n, (lines, base) in enumerate(found):
            divided = _divided(base, f)
            if divided is not None:
                found[n] = ([*lines, k], divided)
                break
        else:
            found.append(([k], f))
    return [(np.array(sorted(lines)), base) for lines, base in found]


def _divided(base: float, frequency: float) -> float | None:
    """The largest frequency [Hz] of which both are whole multiples; None where it is too low, or
    there is none.
    """
    if not (base > 0.0 and frequency > 0.0):
        return None
    ratio = frequency / base
    before, divisor, left = 0, 1, ratio
    while divisor == 1 or base / divisor >= SLOW:
        whole = ratio * divisor
        if round(whole) > 0 and abs(whole - round(whole)) <= LOCKED * whole:
            return base / divisor
        rest = left - np.floor(left)  # of the continued fraction of the ratio
        if rest <= 0.0:
            return None
        left = 1.0 / rest
        before, divisor = divisor, int(np.floor(left)) * divisor + before
    return None


def in_step(frequency: np.ndarray, clock: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Numbers (k,) that lines share which keep their phases to each other; -1 for those of no
    clock.

    Lines have frequencies (k,) [Hz], sizes (k,) and a ``clock`` (k,), by number, below 0 where
    there is none.
    """
    found = np.full(len(clock), -1)
    number = 0
    for one in np.unique(clock[clock >= 0]):
        of = np.flatnonzero(clock == one)
        for lines, _ in bases(frequency[of], size[of]):
            found[of[lines]] = number
            number += 1
    return found
