"""What stands in a record besides the lines of its clock: array modes that ring, and lines that nobody listed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.model.record import PASSBAND
from microvib.signals.line_table import DETECTION, Uncertainty
from microvib.signals.orders import Orders
from microvib.signals.tone_kernel import REACH
from microvib.signals.tones import NEAR, Joint, falling, steady, uncertainties

MAX_OTHERS = 12
LEAST = 0.01
"""Part of the largest line from which an unlisted one is fitted."""
FALLS = 0.1
"""e-foldings over the record from which a tone is said to decay."""
_ATTEMPTS = 60
_TOGETHER = 8
"""Array modes that are looked for at once."""
_ALIKE = 0.7
"""Bins from another tone at which a further one is not a line, but that other's change within the record."""
_MISFIT = 0.3
"""Part of a decaying tone that its misfit may have: with friction, a mode does not ring down exactly exponentially."""


@dataclass(frozen=True)
class Found:
    """A joint fit of all that was found, and why some modes have no figures of their own."""

    joint: Joint
    refused: dict[str, str]


def search(joint: Joint, modes: Sequence[ExpectedLine], orders: Orders | None, *, everywhere: bool = True) -> Found:
    """Find ``modes`` and unlisted lines in what ``joint``, the fit of the clock's lines, leaves; the strongest first.

    Beside listed lines, unlisted ones need a clock against which they are none of it, so ``orders``. Not ``everywhere`` means
    only where they are near other lines.
    """
    return _Search(joint, modes, orders, everywhere).found()


class _Search:
    def __init__(self, joint: Joint, modes: Sequence[ExpectedLine], orders: Orders | None, everywhere: bool) -> None:
        self.joint, self.orders = joint, orders
        self.unlisted = orders is not None or not (modes or len(joint.tones))
        self.duration = joint.spectrum.duration
        self.groups = _groups(modes, self.duration)
        self.refused: dict[str, str] = {}
        self.others = 0
        size = min(int(PASSBAND * joint.spectrum.samples), joint.spectrum.values.size)
        self.barred = np.zeros(size, dtype=bool)
        self.barred[:3] = True
        if not everywhere:
            centres = np.concatenate([joint.tones.frequency, [m.frequency for m in modes]]) * self.duration
            near = np.zeros(size, dtype=bool)
            for centre in np.rint(centres).astype(int).tolist():
                near[max(centre - REACH, 0) : centre + REACH + 1] = True
            self.barred |= ~near

    def found(self) -> Found:
        for _ in range(_ATTEMPTS):
            k = self._highest()
            if k is None:
                break
            group = next((g for g in self.groups if any(_holds(line, k, self.duration) for line in g)), None)
            if group is not None:
                self._fit_modes(group)
            elif not self._fit_other(k):
                self.barred[max(k - 4, 0) : k + 5] = True
        for group in list(self.groups):
            self._fit_modes(group)
        return Found(self.joint, self.refused)

    def _highest(self) -> int | None:
        """Bin of the highest peak that stands out of what is left."""
        top = float(np.max(self.joint.sizes, initial=0.0))
        magnitude = np.where(self.barred, 0.0, self.joint.rest.magnitude[: self.barred.size])
        while magnitude.size:
            k = int(np.argmax(magnitude))
            if magnitude[k] < max(LEAST * top, 1e-12):
                return None
            if magnitude[k] > DETECTION * self.joint.rest.floor(k / self.duration):
                return k
            self.barred[max(k - 4, 0) : k + 5] = True
            magnitude[max(k - 4, 0) : k + 5] = 0.0
        return None

    def _fit_modes(self, group: list[ExpectedLine]) -> None:
        """Fit the modes of a group together; those that are not seen stay where they are expected."""
        self.groups.remove(group)
        before, rest = self.joint, self.joint.rest
        peaks = [rest.peak(line.low, line.high) for line in group]
        floors = [rest.floor(line.frequency) for line in group]
        seen = [
            line for line, (_, a), floor in zip(group, peaks, floors, strict=True) if a > DETECTION * floor and a > 0.0
        ]
        wanted = list(group) if seen else []
        while wanted:
            fit = self._best_start(before, wanted)
            names = {line.name for line in wanted}
            mine = np.array([line.name in names for line in fit.tones.lines])
            size, floor = fit.sizes[mine], fit.rest.floors(fit.tones.frequency[mine])
            weakest = int(np.argmin(size / np.maximum(floor, 1e-300)))
            if size[weakest] > DETECTION * floor[weakest]:
                self.joint = fit
                break
            gone = [line.name for line, own in zip(fit.tones.lines, mine, strict=True) if own][weakest]
            wanted = [line for line in wanted if line.name != gone]
        unseen = [line for line in group if line not in wanted]
        if unseen:
            self.joint = self.joint.with_tones(steady(unseen))
        self._rename(wanted)

    def _best_start(self, before: Joint, lines: list[ExpectedLine]) -> Joint:
        """The joint fit of modes from their peaks, or from where they are expected, whichever leaves less."""
        peaks = np.array([before.rest.peak(line.low, line.high)[0] for line in lines])
        expected = np.array([line.frequency for line in lines])
        starts = [peaks] if len(lines) == 1 else [expected]
        if len(lines) > 1 and np.min(np.diff(np.sort(peaks)), initial=np.inf) * self.duration > 1.0:
            starts.append(peaks)
        decay = np.full(len(lines), 0.3 / self.duration)
        fits = [before.with_tones(falling(lines, start, decay)) for start in starts]
        near = before.spectrum.near(expected)
        return min(fits, key=lambda fit: float(np.sum(np.abs(fit.rest.values[near]) ** 2)))

    def _rename(self, modes: list[ExpectedLine]) -> None:
        """An array mode has evidence: it decays, or it is off every simple order of the clock. Else its line is unlisted."""
        for line in modes:
            i = self._place(line.name)
            spread = self._spread(self.joint, i)
            fold = abs(self.joint.tones.decay[i]) * self.duration
            if self.orders is None or fold > max(0.05, 3.0 * spread.decay[0] * self.duration):
                continue
            name = self.orders.name(float(self.joint.tones.frequency[i]), self._within(spread.frequency[0]))
            if name is not None:
                self.refused[line.name] = f"not separable from {name}"
                self._put(i, self._other(float(self.joint.tones.frequency[i])))

    def _fit_other(self, k: int) -> bool:
        """Fit an unlisted line about bin ``k``; False where it is none, or where there are enough."""
        if not self.unlisted or self.others >= MAX_OTHERS:
            return False
        at, height = self.joint.rest.peak(k / self.duration, k / self.duration, margin=0.0)
        order = self.orders.whole(at, 0.3 / self.duration) if self.orders else None
        if order is not None and not np.any(np.abs(self.joint.tones.frequency - order) * self.duration < 0.01):
            fit = self.joint.with_tones(steady([self._other(order)]))
            if self._explains(fit, k, height):
                self.joint, self.others = fit, self.others + 1
                return True
        found = self._steady_or_not(at, k, height)
        if found is None:
            return False
        self.joint, self.others = found, self.others + 1
        return True

    def _steady_or_not(self, at: float, k: int, height: float) -> Joint | None:
        """The fit with an unlisted tone about a frequency: a steady one if that says it all, or else one that decays."""
        one = falling([self._other(at)], np.array([at]), np.zeros(1))
        held = self.joint.with_tones(replace(one, falls=np.zeros(1, dtype=bool)))
        if self._explains(held, k, 0.1 * height) and not held.tones.limited[-1] and not self._is_change(held, -1):
            return held
        fit = self.joint.with_tones(replace(one, decay=np.array([0.3 / self.duration])))
        if fit.tones.limited[-1] or not self._explains(fit, k, height) or self._is_change(fit, -1):
            return None
        fold = abs(fit.tones.decay[-1]) * self.duration
        falls = fold > max(FALLS, 3.0 * self._spread(fit, -1).decay[0] * self.duration)
        return fit if falls else held

    def _explains(self, fit: Joint, k: int, height: float) -> bool:
        return float(np.max(fit.rest.magnitude[max(k - 1, 0) : k + 2])) < 0.5 * height

    def _is_change(self, fit: Joint, i: int) -> bool:
        """Whether tone ``i`` only makes up for what another tone does not say: that it changes, or does not decay exponentially."""
        tones, sizes = fit.tones, fit.sizes
        apart = np.abs(tones.frequency - tones.frequency[i]) * self.duration
        apart[i] = np.inf
        misfit = (apart < REACH) & tones.falls & (sizes[i] < _MISFIT * sizes)
        return bool(np.any(apart < _ALIKE) or np.any(misfit))

    def _hold(self, i: int) -> None:
        """Fit tone ``i`` again as a steady one."""
        tones = self.joint.tones
        line, frequency = tones.lines[i], float(tones.frequency[i])
        keep = np.arange(len(tones)) != i
        local = self.joint.rest.without(tones.only(~keep), -self.joint.amplitudes[~keep])
        without = Joint(self.joint.spectrum, tones.only(keep), self.joint.amplitudes[keep], local)
        free = falling([line], np.array([frequency]), np.zeros(1))
        self.joint = without.with_tones(replace(free, falls=np.zeros(1, dtype=bool)))

    def _put(self, i: int, line: ExpectedLine) -> None:
        """Call tone ``i`` another line."""
        lines = list(self.joint.tones.lines)
        lines[i] = line
        self.joint = replace(self.joint, tones=replace(self.joint.tones, lines=tuple(lines)))
        self._hold(i)

    def _other(self, frequency: float) -> ExpectedLine:
        bin_ = 1.0 / self.duration
        return ExpectedLine(f"other at {frequency!r}", "other", frequency, frequency - bin_, frequency + bin_, "")

    def _place(self, name: str) -> int:
        return next(i for i, line in enumerate(self.joint.tones.lines) if line.name == name)

    def _spread(self, fit: Joint, i: int) -> Uncertainty:
        return uncertainties(fit.alone(i))[0]

    def _within(self, spread: float) -> float:
        """How far from an order a frequency of this standard uncertainty may be on it [Hz]."""
        return max(3.0 * spread, 0.02 / self.duration)


def _groups(modes: Sequence[ExpectedLine], duration: float) -> list[list[ExpectedLine]]:
    """Modes whose bands are near each other's, together: no more than ``_TOGETHER``, for the work grows with their third power.

    A longer row is parted where its modes are farthest from each other. A part is still fitted with those modes of the others
    that are near it and were found before.
    """
    groups: list[list[ExpectedLine]] = []
    reach = -np.inf
    for line in sorted(modes, key=lambda line: line.low):
        if line.low * duration > reach:
            groups.append([])
        groups[-1].append(line)
        reach = max(reach, max(line.high, line.frequency) * duration + NEAR)
    return [part for group in groups for part in _parted(group)]


def _parted(row: list[ExpectedLine]) -> list[list[ExpectedLine]]:
    """A row of modes in parts of at most ``_TOGETHER``."""
    if len(row) <= _TOGETHER:
        return [row]
    least = _TOGETHER // 2  # that no part is but an end of the row
    gaps = np.diff([line.frequency for line in row])[least - 1 : len(row) - least]
    cut = least + int(np.argmax(gaps))
    return [*_parted(row[:cut]), *_parted(row[cut:])]


def _holds(line: ExpectedLine, k: int, duration: float) -> bool:
    return line.low * duration - 1.5 <= k <= line.high * duration + 1.5
