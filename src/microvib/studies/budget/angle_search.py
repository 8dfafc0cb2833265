"""The angles of an orbit that are worst for requirements where other sources act beside the drives,
and a bound on what lies between the angles that were tried.

Lines of other sources keep their frequencies while natural frequencies of the craft move with the
array's angle, so that a resonance may pass a line between two angles. What a source does at an angle
is a matter of the craft's response and needs no simulation, nor does what the drives do between the
angles that were run. Each interval between two angles has a bound: the larger amplitude at its ends, times what
the natural frequencies that pass may add. Intervals whose bound is above the largest figure are
halved until none is left.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.other_sources import Excitation
from microvib.studies.budget.side_lines import SideLines
from microvib.studies.budget.sources import Contribution
from microvib.studies.budget.sums import Rule, most_of_sources, worst_alternative
from microvib.units import Si

TOLERANCE = 0.01
"""Part by which a figure between the angles that were tried may be above the largest found, and up
to which intervals are halved.
"""
_FIRST_STEP, _MODES_STEP = math.radians(15.0), math.radians(3.0)
"""Steps between angles at which sources and natural frequencies are looked at first."""
_MIN_STEP = math.radians(1e-4)
"""Below which none is halved."""
_MAX_ANGLES, _AT_ONCE = 400, 16
"""Angles that are tried at most, and intervals that are halved at a time, those with the largest
bounds first.
"""
_MIN_DAMPING = 1e-6
_RISE_FACTOR = 2.0
"""By how much more amplitudes may rise than a single mode does: others may cancel it at both ends."""
_PATH_POINTS = 9
"""Points of a natural frequency's path at which a density is weighed, besides its own peaks."""
_MAX_PEAKS = 16

Contributions = Callable[[float], list[Contribution]]


@dataclass(frozen=True)
class WorstAngle:
    """Where an orbit is worst for a requirement."""

    angle: float
    """[rad]"""
    excess: float
    """Part by which the figure between the angles that were tried may be above that found here."""
    most: float
    """Above which the figure is nowhere, of lines and densities as they are given; 0 where it is not
    of the kind that is required.
    """


def worst_angles(
    requirements: Sequence[Requirement],
    scenario: Scenario,
    ends: tuple[float, float],
    sources: Contributions,
    excitations: Sequence[Excitation],
    rule: Rule,
) -> list[WorstAngle | None]:
    """The worst angle for each requirement; None for one that says too little.

    Parameters
    ----------
    requirements : sequence of Requirement
        What is required.
    scenario : Scenario
        The first drive on its craft.
    ends : pair of float
        The lowest and the highest angle [rad] between which is looked.
    sources : callable
        What the drives and the other sources do at an angle [rad], one ``Contribution`` each.
    excitations : sequence of Excitation
        Where their loads act, in the same order.
    rule : {"rss", "coherent", "bound"}
        How lines of one frequency add.
    """
    judged = [plain_statistic(r) for r in requirements if not r.incomplete]
    if not judged:
        return [None for _ in requirements]
    found = iter(_Search(judged, scenario, sources, excitations, rule).run(*ends))
    return [None if r.incomplete else next(found) for r in requirements]


def plain_statistic(r: Requirement) -> Requirement:
    """A requirement with the rms in place of a level, which takes long and grows with it."""
    if r.statistic == "level":
        return r.model_copy(update={"statistic": "rms"})
    return r


@dataclass(frozen=True)
class _Paths:
    """How natural frequencies move between two angles [Hz], (m,) each."""

    ends: tuple[np.ndarray, np.ndarray]
    low: np.ndarray
    high: np.ndarray
    width: np.ndarray
    """Half-widths of the resonances [Hz]."""

    def rise(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Factor by which lines between frequencies ``low`` and ``high`` (k,) [Hz] may be larger on
        the way than at the better of the ends, (k,).
        """
        if not low.size or not self.low.size:
            return np.ones(low.size)
        low, high = low[:, None], high[:, None]
        at_ends = np.min([_outside(low, high, f, f) for f in self.ends], axis=0)
        nearest = _outside(low, high, self.low, self.high)
        rise = np.hypot(at_ends, self.width) / np.hypot(nearest, self.width)
        return np.asarray(1.0 + _RISE_FACTOR * (rise.max(axis=1) - 1.0))

    def rise_of_density(self, f: np.ndarray, S: np.ndarray, low: float, high: float) -> float:
        """Rise of the root mean square of densities (n, c) at frequencies (n,) [Hz], from
        ``low`` to ``high``.
        """
        low, high = max(low, float(f[0])), min(high, float(f[-1]))
        if low >= high:
            return 1.0
        grid = np.r_[low, f[(f > low) & (f < high)], high]
        columns = [np.interp(grid, f, column) for column in S.T if column.any()]
        largest = 1.0
        for k, width in enumerate(self.width.tolist()):
            path = np.linspace(self.low[k], self.high[k], _PATH_POINTS)
            passed = (grid > self.low[k]) & (grid < self.high[k])
            for column in columns:
                peaks = grid[passed][np.argsort(-column[passed])[:_MAX_PEAKS]]
                on_way = _through_resonance(grid, column, np.r_[path, peaks], width).max()
                at = _through_resonance(grid, column, np.array([e[k] for e in self.ends]), width)
                largest = max(largest, float(on_way / max(at.max(), 1e-300)))
        return 1.0 + _RISE_FACTOR * (math.sqrt(largest) - 1.0)


def _outside(low: np.ndarray, high: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Distance between ranges, 0 where they meet."""
    return np.maximum(np.maximum(low - last, first - high), 0.0)


def _through_resonance(f: np.ndarray, S: np.ndarray, at: np.ndarray, width: float) -> np.ndarray:
    """Mean squares that a density (n,), linear between frequencies (n,) [Hz], makes through a
    resonance ``at`` each of (p,) [Hz]: its integral over 1/((f - at)^2 + width^2).
    """
    slope = np.diff(S) / np.maximum(np.diff(f), 1e-300)
    x = f - at[:, None]
    level = S[:-1] + slope * (at[:, None] - f[:-1])
    angles = np.diff(np.arctan(x / width), axis=1) / width
    logs = 0.5 * np.diff(np.log(x**2 + width**2), axis=1)
    return np.asarray(np.sum(level * angles + slope * logs, axis=1))


class _Modes:
    """Natural frequencies over the angle."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._at: dict[float, np.ndarray] = {}

    def add(self, angle: float) -> None:
        """Look at one more angle [rad]."""
        if angle not in self._at:
            modes = coupled_modes(self._scenario.at_angle(Si(angle)).alone)
            self._at[angle] = np.array(
                [[m.frequency, m.frequency * max(m.damping, _MIN_DAMPING)] for m in modes]
            ).reshape(-1, 2)

    def paths(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angles, ascending, (n,), frequencies [Hz], ascending, and half-widths [Hz], (n, m)."""
        angles = sorted(self._at)
        count = min(len(self._at[angle]) for angle in angles)
        # Where one no longer oscillates at some angles, the least damped are those that count.
        kept = [
            at[np.argsort(at[:, 1] / at[:, 0])[:count]]
            for at in (self._at[angle] for angle in angles)
        ]
        rows = np.array([at[np.argsort(at[:, 0])] for at in kept]).reshape(len(angles), count, 2)
        return np.array(angles), rows[:, :, 0], rows[:, :, 1]


class _ModePaths:
    """Natural frequencies between angles, by those at some."""

    def __init__(self, modes: _Modes) -> None:
        self._angles, self._f, self._width = modes.paths()
        bend = _bend(self._angles, self._f)
        self._low = np.minimum(self._f[:-1], self._f[1:]) - bend
        self._high = np.maximum(self._f[:-1], self._f[1:]) + bend

    def between(self, a: float, b: float) -> _Paths:
        """From one of the angles to another."""
        first, last = np.searchsorted(self._angles, [a, b]).tolist()
        return _Paths(
            (self._f[first], self._f[last]),
            self._low[first:last].min(axis=0),
            self._high[first:last].max(axis=0),
            self._width[first : last + 1].min(axis=0),
        )


def _bend(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """By how much values (n, ...) at ``x`` (n,) may leave the range of both ends between each two,
    (n - 1, ...), by the larger of the second differences beside.
    """
    if x.size < 3:
        return np.zeros((x.size - 1, *y.shape[1:]))
    wide = (slice(None), *(None,) * (y.ndim - 1))
    h = np.diff(x)[wide]
    second = np.abs(np.diff(np.diff(y, axis=0) / h, axis=0)) / (x[2:] - x[:-2])[wide]
    beside = np.maximum(np.concatenate([second[:1], second]), np.concatenate([second, second[-1:]]))
    return np.asarray(0.25 * beside * h**2)


class _Search:
    """Angles tried, with what all sources do there, and bounds between them."""

    def __init__(
        self,
        requirements: Sequence[Requirement],
        scenario: Scenario,
        sources: Contributions,
        excitations: Sequence[Excitation],
        rule: Rule,
    ) -> None:
        self._requirements, self._sources = requirements, sources
        self._excitations, self._rule = excitations, rule
        self._modes = _Modes(scenario)
        self._chosen: dict[float, list[list[Contribution]]] = {}
        self._figures: dict[float, np.ndarray] = {}
        self._bounds: dict[tuple[float, float], np.ndarray] = {}

    def run(self, first: float, last: float) -> list[WorstAngle]:
        """From a first angle [rad] to a last, halve until nothing between is more than
        ``TOLERANCE`` above what was found.
        """
        for step, look in ((_MODES_STEP, self._modes.add), (_FIRST_STEP, self._try)):
            for angle in np.linspace(first, last, math.ceil((last - first) / step) + 1).tolist():
                look(angle)
        while True:
            angles = sorted(self._figures)
            figures = np.array([self._figures[angle] for angle in angles])
            bounds = self._between(angles, figures)
            best = np.maximum(figures.max(axis=0), 1e-300)
            over = (bounds / best).max(axis=1)
            wide = np.diff(angles) > _MIN_STEP
            halve = np.flatnonzero((over > 1.0 + TOLERANCE) & wide)
            if not halve.size or len(angles) >= _MAX_ANGLES:
                break
            for k in halve[np.argsort(-over[halve])[:_AT_ONCE]].tolist():
                self._try(0.5 * (angles[k] + angles[k + 1]))
        most = np.maximum(bounds.max(axis=0), figures.max(axis=0))
        return [
            WorstAngle(
                angles[int(np.argmax(figures[:, k]))],
                float(most[k] / best[k]) - 1.0 if best[k] > 1e-300 else 0.0,
                float(most[k]),
            )
            for k in range(len(self._requirements))
        ]

    def _try(self, angle: float) -> None:
        """Look at all sources at an angle."""
        self._modes.add(angle)
        found = self._sources(angle)
        self._chosen[angle] = [
            [worst_alternative(r, one) for one in found] for r in self._requirements
        ]
        self._figures[angle] = np.array(
            [
                most_of_sources(r, chosen, self._rule)
                for r, chosen in zip(self._requirements, self._chosen[angle], strict=True)
            ]
        )

    def _between(self, angles: Sequence[float], figures: np.ndarray) -> np.ndarray:
        """Bounds on the figures from each angle to the next, (n - 1, requirements)."""
        steps = list(itertools.pairwise(angles))
        missing = [step for step in steps if step not in self._bounds]
        if missing:
            paths = _ModePaths(self._modes)
            for a, b in missing:
                self._bounds[a, b] = self._bound(a, b, paths.between(a, b))
        bounds = np.array([self._bounds[step] for step in steps])
        return np.asarray(bounds + _bend(np.array(angles), figures))

    def _bound(self, a: float, b: float, paths: _Paths) -> np.ndarray:
        """Bounds on the figures between two angles by resonances that pass, (requirements,)."""
        found = []
        for k, r in enumerate(self._requirements):
            each = zip(self._chosen[a][k], self._chosen[b][k], self._excitations, strict=True)
            largest = [self._largest(r, one, other, on, paths) for one, other, on in each]
            found.append(most_of_sources(r, largest, self._rule))
        return np.array(found)

    def _largest(
        self, r: Requirement, a: Contribution, b: Contribution, on: Excitation, paths: _Paths
    ) -> Contribution:
        """The largest that a source may be between two angles, by what it is at each."""
        low, high = r.lowest, math.inf if r.highest is None else r.highest
        if on.density is not None:
            rise = paths.rise_of_density(*on.density, low, high)
        elif np.any(on.low < on.high):
            # Of a range of speeds that part counts in which a line is in the band.
            meets = (on.low <= high) & (on.high >= low)
            ranges = np.clip(on.low[meets], low, high), np.clip(on.high[meets], low, high)
            rise = float(paths.rise(*ranges).max(initial=1.0))
        else:
            larger = _larger_lines(a, b, paths.rise(on.low, on.high))
            return replace(larger, side=_larger_side_lines(a, b, paths))
        best = max(a, b, key=lambda one: most_of_sources(r, [one], self._rule))
        most = best.most_density
        density = most and (most[0], most[1] * rise**2)
        los = np.abs(best.los) * rise
        side = best.side and best.side.times(rise * _rise_of_side_lines(best, paths))
        return replace(best, los=los, density=density, density_bounds=None, side=side)


def _rise_of_side_lines(one: Contribution, paths: _Paths) -> float:
    """Rise of side lines and of a side density where they are."""
    if one.side is None:
        return 1.0
    low, high = _ranges(one.side.frequency)
    rise = max(float(paths.rise(low, high).max(initial=1.0)), _rise_anywhere(one.side, paths))
    if one.side.density is not None:
        f, S = one.side.density
        rise = max(rise, paths.rise_of_density(f, S, float(f[0]), float(f[-1])))
    return rise


def _rise_anywhere(side: SideLines, paths: _Paths) -> float:
    """Rise of motion at frequencies that are not known: that of any resonance that passes."""
    if not side.anywhere:
        return 1.0
    low, high = (
        np.zeros(1),
        np.array([one.frequency[-1] for one in side.anywhere]).max(keepdims=True),
    )
    return float(paths.rise(low, high).max(initial=1.0))


def _ranges(frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest of the frequencies that each line may have, (j, m)."""
    if not frequency.size:
        return np.zeros(0), np.zeros(0)
    return frequency.min(axis=1), frequency.max(axis=1)


def _larger_side_lines(a: Contribution, b: Contribution, paths: _Paths) -> SideLines | None:
    """Side lines as large as those at either of two angles, by resonances that pass where they come
    from and where they are.
    """
    found = None
    for one in (a.side, b.side):
        if one is not None:
            rise = paths.rise(*_ranges(one.source)) * paths.rise(*_ranges(one.frequency))
            larger = one.times(rise)
            own = _rise_anywhere(one, paths) ** 2  # of what loads make, and of what is made of it
            anywhere = tuple(each.times(own) for each in one.anywhere)
            found = replace(larger, anywhere=anywhere).joined(found)
    return found


def _larger_lines(a: Contribution, b: Contribution, rise: np.ndarray) -> Contribution:
    """Lines as large as the larger of two of one frequency, times their ``rise`` (k,)."""
    if a.density is not None or not rise.size:  # of the line of sight itself, alike at all angles
        return a
    size = np.maximum(np.abs(a.los), np.abs(b.los)) * rise[:, None]
    errors = np.maximum(a.relative_errors, b.relative_errors)
    return replace(a, los=size, relative_error=errors)
