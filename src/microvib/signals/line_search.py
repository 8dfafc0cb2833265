"""Search for what a record contains besides the lines of its clock: ringing array modes and
unexpected lines.

The strongest peak of the residual is taken first, fitted jointly with everything near it, and the
search goes on with the new residual, until no peak exceeds the noise floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.model.record import PASSBAND
from microvib.signals.line_table import DETECTION_RATIO, Uncertainty
from microvib.signals.orders import ClockOrders
from microvib.signals.tone_kernel import REACH
from microvib.signals.tones import INTERACTION_DISTANCE, JointFit, decaying_tones, steady_tones
from microvib.signals.uncertainties import isolated_uncertainties

MAX_OTHERS = 12
MIN_RELATIVE_AMPLITUDE = (
    0.01  # fraction of the largest line above which an unexpected one is fitted
)
MIN_DECAY_E_FOLDINGS = 0.1  # e-foldings over the record above which a tone counts as decaying
_ATTEMPTS = 60
_MAX_GROUP_SIZE = 8  # array modes that are fitted at once
_SAME_TONE_DISTANCE = 0.7
"""Distance from another tone [bins] below which a further one is not a line, but a change of that
tone in the record.
"""
_MISFIT = 0.3
"""Fraction of a decaying tone that may be misfit: with friction, a mode does not ring down exactly
exponentially.
"""

_SIDEBAND_DECAY_TOLERANCE = 0.1
"""Part by which the decay of a sideband of a mode may be off that mode's: friction that both feel
depends on their size.
"""


def search(
    joint: JointFit,
    modes: Sequence[ExpectedLine],
    orders: ClockOrders | None,
    *,
    everywhere: bool = True,
) -> tuple[JointFit, dict[str, str]]:
    """Find ``modes`` and unexpected lines in the residual of ``joint``, the fit of the clock's
    lines; the strongest first.

    If there are expected lines, unexpected ones are only sought with ``orders``, which tell them
    from lines of the clock. Without ``everywhere`` they are only sought near other lines. The joint
    fit of everything found, and by their names the reasons why some modes have no figures of their
    own.
    """
    return _Search(joint, modes, orders, everywhere).found()


class _Search:
    def __init__(
        self,
        joint: JointFit,
        modes: Sequence[ExpectedLine],
        orders: ClockOrders | None,
        everywhere: bool,
    ) -> None:
        self.joint, self.orders = joint, orders
        self.unexpected = orders is not None or not (modes or len(joint.tones))
        self.duration = joint.spectrum.duration
        self.groups = _groups(modes, self.duration)
        self.refused: dict[str, str] = {}
        self.others = 0
        size = min(int(PASSBAND * joint.spectrum.samples), joint.spectrum.values.size)
        self.barred = np.zeros(size, dtype=bool)
        self.barred[:3] = True
        if not everywhere:
            centres = (
                np.concatenate([joint.tones.frequency, [m.frequency for m in modes]])
                * self.duration
            )
            near = np.zeros(size, dtype=bool)
            for centre in np.rint(centres).astype(int).tolist():
                near[max(centre - REACH, 0) : centre + REACH + 1] = True
            self.barred |= ~near

    def found(self) -> tuple[JointFit, dict[str, str]]:
        for _ in range(_ATTEMPTS):
            k = self._highest()
            if k is None:
                break
            group = next((g for g in self.groups if any(self._holds(line, k) for line in g)), None)
            if group is not None:
                self._fit_modes(group)
            elif not self._fit_other(k):
                self.barred[max(k - 4, 0) : k + 5] = True
        for group in list(self.groups):
            self._fit_modes(group)
        return self.joint, self.refused

    def _highest(self) -> int | None:
        """Bin of the highest peak of the residual above the floor; None if none does."""
        top = float(np.max(self.joint.sizes, initial=0.0))
        magnitude = np.where(self.barred, 0.0, self.joint.rest.magnitude[: self.barred.size])
        while magnitude.size:
            k = int(np.argmax(magnitude))
            if magnitude[k] < max(MIN_RELATIVE_AMPLITUDE * top, 1e-12):
                return None
            if magnitude[k] > DETECTION_RATIO * self.joint.rest.floor(k / self.duration):
                return k
            self.barred[max(k - 4, 0) : k + 5] = True
            magnitude[max(k - 4, 0) : k + 5] = 0.0
        return None

    def _fit_modes(self, group: list[ExpectedLine]) -> None:
        """Fit the modes of a group together, dropping the weakest until all exceed the floor; unseen ones
        stay where expected.
        """
        self.groups.remove(group)
        before, rest = self.joint, self.joint.rest
        peaks = [rest.peak(line.low, line.high) for line in group]
        floors = [rest.floor(line.frequency) for line in group]
        seen = [
            line
            for line, (_, a), floor in zip(group, peaks, floors, strict=True)
            if a > DETECTION_RATIO * floor and a > 0.0
        ]
        wanted = list(group) if seen else []
        while wanted:
            fit = self._best_start(before, wanted)
            names = {line.name for line in wanted}
            mine = np.array([line.name in names for line in fit.tones.lines])
            size, floor = fit.sizes[mine], fit.rest.floors(fit.tones.frequency[mine])
            weakest = int(np.argmin(size / np.maximum(floor, 1e-300)))
            if size[weakest] > DETECTION_RATIO * floor[weakest]:
                self.joint = fit
                break
            gone = [line.name for line, own in zip(fit.tones.lines, mine, strict=True) if own][
                weakest
            ]
            wanted = [line for line in wanted if line.name != gone]
        unseen = [line for line in group if line not in wanted]
        if unseen:
            self.joint = self.joint.with_tones(steady_tones(unseen))
        self._rename(wanted)

    def _best_start(self, before: JointFit, lines: list[ExpectedLine]) -> JointFit:
        """The joint fit of modes from their peaks, or from where they are expected, whichever
        leaves less.
        """
        peaks = np.array([before.rest.peak(line.low, line.high)[0] for line in lines])
        expected = np.array([line.frequency for line in lines])
        if len(lines) == 1:
            starts = [peaks]
        else:
            starts = [expected]
        if len(lines) > 1 and np.min(np.diff(np.sort(peaks)), initial=np.inf) * self.duration > 1.0:
            starts.append(peaks)
        decay = np.full(len(lines), 0.3 / self.duration)
        fits = [before.with_tones(decaying_tones(lines, start, decay)) for start in starts]
        near = before.spectrum.near(expected)
        return min(fits, key=lambda fit: float(np.sum(np.abs(fit.rest.values[near]) ** 2)))

    def _rename(self, modes: list[ExpectedLine]) -> None:
        """Array modes need evidence: decay, or a frequency off every simple order of the clock; and
        neither as a sideband of a larger mode has. Others become unexpected lines."""
        for line in modes:
            if self.orders is None:
                continue
            i = [other.name for other in self.joint.tones.lines].index(line.name)
            spread, frequency = self._spread(self.joint, i), float(self.joint.tones.frequency[i])
            fold = abs(self.joint.tones.decay[i]) * self.duration
            within = max(3.0 * spread.frequency[0], 0.02 / self.duration)
            falls = fold > max(0.05, 3.0 * spread.decay[0] * self.duration)
            if not falls and (name := self.orders.name(frequency, within)):
                self._put(i, self._other(frequency))
            elif name := self._beside(i, within, spread):
                lines = list(self.joint.tones.lines)
                lines[i] = self._other(frequency)
                self.joint = replace(
                    self.joint, tones=replace(self.joint.tones, lines=tuple(lines))
                )
            else:
                continue
            self.refused[line.name] = f"not separable from {name}"

    def _beside(self, i: int, within: float, spread: Uncertainty) -> str | None:
        """The clock's order about which tone ``i`` is a sideband that a larger mode may make: that
        far away, and falling alike.
        """
        tones, sizes, modes = self.joint.tones, self.joint.sizes, {}
        for j, line in enumerate(tones.lines):
            if line.is_mode and sizes[j] > sizes[i] and self.orders:
                own = self._spread(self.joint, j)
                three_sigma = 3.0 * float(
                    np.hypot(spread.decay[0], own.decay[0])
                ) + _SIDEBAND_DECAY_TOLERANCE * abs(tones.decay[j])
                if abs(tones.decay[i] - tones.decay[j]) <= three_sigma:
                    modes[line.name] = (
                        float(tones.frequency[j]),
                        float(np.hypot(within, 3.0 * own.frequency[0])),
                    )
        if self.orders:
            return self.orders.with_mode(float(tones.frequency[i]), modes)
        return None

    def _fit_other(self, k: int) -> bool:
        """Fit an unexpected line at bin ``k``, on the nearest order of the clock or anywhere; False
        if none fits.
        """
        if not self.unexpected or self.others >= MAX_OTHERS:
            return False
        at, height = self.joint.rest.peak(k / self.duration, k / self.duration, margin=0.0)
        if self.orders:
            order = self.orders.whole(at, 0.3 / self.duration)
        else:
            order = None
        if order is not None and not np.any(
            np.abs(self.joint.tones.frequency - order) * self.duration < 0.01
        ):
            fit = self.joint.with_tones(steady_tones([self._other(order)]))
            if self._explains(fit, k, height):
                self.joint, self.others = fit, self.others + 1
                return True
        found = self._steady_or_not(at, k, height)
        if found is None:
            return False
        self.joint, self.others = found, self.others + 1
        return True

    def _steady_or_not(self, at: float, k: int, height: float) -> JointFit | None:
        """The fit with an unexpected tone near a frequency: a steady one if that explains the peak,
        otherwise a decaying one.
        """
        one = decaying_tones([self._other(at)], np.array([at]), np.zeros(1))
        held = self.joint.with_tones(replace(one, falls=np.zeros(1, dtype=bool)))
        if (
            self._explains(held, k, 0.1 * height)
            and not held.tones.limited[-1]
            and not self._is_change(held)
        ):
            return held
        fit = self.joint.with_tones(replace(one, decay=np.array([0.3 / self.duration])))
        if fit.tones.limited[-1] or not self._explains(fit, k, height) or self._is_change(fit):
            return None
        fold = abs(fit.tones.decay[-1]) * self.duration
        falls = (
            fold > MIN_DECAY_E_FOLDINGS
            and fold > 3.0 * self._spread(fit, -1).decay[0] * self.duration
        )
        if falls:
            return fit
        return held

    def _explains(self, fit: JointFit, k: int, height: float) -> bool:
        return float(np.max(np.abs(fit.rest.values[max(k - 1, 0) : k + 2]))) < 0.5 * height

    def _is_change(self, fit: JointFit) -> bool:
        """Whether the last tone only compensates for another that changes, or does not decay
        exponentially.
        """
        tones, sizes = fit.tones, fit.sizes
        apart = np.abs(tones.frequency - tones.frequency[-1]) * self.duration
        apart[-1] = np.inf
        misfit = (apart < REACH) & tones.falls & (sizes[-1] < _MISFIT * sizes)
        return bool(
            np.any(apart < _SAME_TONE_DISTANCE) or np.any(misfit) or self._merges_others(fit)
        )

    def _merges_others(self, fit: JointFit) -> bool:
        """Whether unlisted tones have moved together in a fit: they then grow without bound and
        cancel.
        """
        return self._close_pairs(fit) > self._close_pairs(self.joint)

    def _close_pairs(self, fit: JointFit) -> int:
        """Unlisted tones next to which another free tone is not a line of its own."""
        free = fit.tones.only(fit.tones.free)
        apart = np.abs(free.frequency[:, None] - free.frequency) * self.duration
        np.fill_diagonal(apart, np.inf)
        other = np.array([line.kind == "other" for line in free.lines], dtype=bool)
        return int(np.count_nonzero(apart[other] < _SAME_TONE_DISTANCE))

    def _put(self, i: int, line: ExpectedLine) -> None:
        """Assign tone ``i`` to another line, and fit it again as a steady one."""
        tones = self.joint.tones
        keep = np.arange(len(tones)) != i
        local = self.joint.rest.without(tones.only(~keep), -self.joint.amplitudes[~keep])
        without = JointFit(
            self.joint.spectrum, tones.only(keep), self.joint.amplitudes[keep], local
        )
        free = decaying_tones([line], tones.frequency[~keep], np.zeros(1))
        self.joint = without.with_tones(replace(free, falls=np.zeros(1, dtype=bool)))

    def _other(self, frequency: float) -> ExpectedLine:
        bin_ = 1.0 / self.duration
        return ExpectedLine(
            f"other at {frequency!r}", "other", frequency, frequency - bin_, frequency + bin_, ""
        )

    def _spread(self, fit: JointFit, i: int) -> Uncertainty:
        return isolated_uncertainties(fit, [i])

    def _holds(self, line: ExpectedLine, k: int) -> bool:
        return line.low * self.duration - 1.5 <= k <= line.high * self.duration + 1.5


def _groups(modes: Sequence[ExpectedLine], duration: float) -> list[list[ExpectedLine]]:
    """Groups of modes whose bands are near each other, at most ``_MAX_GROUP_SIZE``, since the work
    grows with the third power.

    A longer row is split where its modes are farthest apart. A part is still fitted together with
    nearby modes of the others that were found before.
    """
    groups: list[list[ExpectedLine]] = []
    reach = -np.inf
    for line in sorted(modes, key=lambda line: line.low):
        if line.low * duration > reach:
            groups.append([])
        groups[-1].append(line)
        reach = max(reach, max(line.high, line.frequency) * duration + INTERACTION_DISTANCE)
    return [part for group in groups for part in _split_group(group)]


def _split_group(row: list[ExpectedLine]) -> list[list[ExpectedLine]]:
    """A row of modes, split into parts of at most ``_MAX_GROUP_SIZE``."""
    if len(row) <= _MAX_GROUP_SIZE:
        return [row]
    least = _MAX_GROUP_SIZE // 2  # so that no part is a mere end of the row
    gaps = np.diff([line.frequency for line in row])[least - 1 : len(row) - least]
    cut = least + int(np.argmax(gaps))
    return [*_split_group(row[:cut]), *_split_group(row[cut:])]
