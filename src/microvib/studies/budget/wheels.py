"""Reaction wheels: their lines at a speed, and the worst of a range of speeds for each requirement,
with a bound on what it may be.

The range is divided at every speed at which something may change at once: where an order passes an
end of a band or a point of a curve. Of each interval an upper bound is formed, from the largest
amplitude of each order in it and the largest weight of the metric; intervals whose bound is above
the largest figure found are halved until none is left, so that what lies between the speeds that
were tried is known to ``TOLERANCE``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from microvib.analysis.margins import CLOCK_UNCERTAINTY, frequency_error_bound
from microvib.analysis.start import rounded_up
from microvib.model.coupling import line_of_sight_transfer, receiver_of
from microvib.model.drive_states import MAY_STICK, DriveStates, Sticking, drive_states
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.model.side_lines import VaryingDrive
from microvib.signals.pointing import (
    UNIFORM_INSTANTS,
    excess_between_instants,
    metric_weight,
    windowed_amplitudes,
)
from microvib.studies.budget.figures import frequencies_that_count_most
from microvib.studies.budget.files import Requirement, Wheel, WheelMode
from microvib.studies.budget.side_lines import (
    MAX_METRIC_GAIN,
    MAX_METRIC_WEIGHT,
    Anywhere,
    SideLines,
    TurningDrives,
    spread,
    turning_drives,
)
from microvib.studies.budget.sources import (
    Contribution,
    Unobserved,
    both_errors,
    low_frequency_gap,
    natural_frequencies,
    open_gap,
    response_uncertainty,
)
from microvib.studies.budget.wheel_modes import (
    MOVED_BY,
    Amplification,
    Resonance,
    amplification,
    resonances,
)
from microvib.units import within_band as in_band

SPEEDS = 101
"""Speeds that tables show of a range, besides those at which an order meets a mode."""
TOLERANCE = 0.005
"""Part by which the figure of a range of speeds may be above the largest that was found."""
_ENVELOPE = 0.002
"""Part by which amplitudes may be above the larger of two neighbours of the grid on which they are
known.
"""
_GRID = 2e-3
"""Relative distance of frequencies of that grid apart from resonances."""
_LEAST_SHARE = 1e-4
"""Part of an order's amplitude below which what varying springs add to it is left out."""
_NEAR = 25
"""Speeds tried about the best, for figures that are not largest where the score is."""
_TRACE = 1e-9
"""Part of the largest that a coefficient may be that one counts with which was not seen."""
_CYCLES, _MOST_PARTS = 0.05, 64
"""Cycles in a window by which the ends of parts of an interval differ, and how many parts there are."""
_MAX_BISECTIONS = 40
"""How often intervals are halved, those with the largest bounds first."""
_BESIDE_RESONANCE = 0.03
"""Part of its frequency by which the gap of a resonance is wider than its speeds say, for its order's error."""
_AXES = {"x": [0], "y": [1], "radial": [0, 1]}


_CREST_INSTANTS = UNIFORM_INSTANTS[::2]


def bound_over_phases(
    sizes: np.ndarray, smallest: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Largest amplitudes (...) that parts (p, ...) of a line make whose phases to each other are
    not known, and by which part of them the line may be smaller and larger, (2, ...); ``smallest``
    are the parts as small as they may be, where they are not known.
    """
    most = np.sum(sizes, axis=0)
    least = np.maximum(2.0 * np.max(sizes, axis=0) - most, 0.0)
    if smallest is not None:
        least = np.maximum(np.max(smallest + sizes, axis=0) - most, 0.0)
    less = np.divide(most - least, most, out=np.zeros_like(most), where=most > 0.0)
    return most, np.array([less, 0.0 * less])


def _along(one: VaryingDrive, k: int, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Motion of a drive in one of its directions, (m, c)."""
    return one.motion(frequency, forces)[:, k]


@dataclass(frozen=True)
class WheelOnCraft:
    """A wheel at its place on the hub of a scenario with drive and array."""

    name: str
    wheel: Wheel
    scenario: Scenario
    place: np.ndarray
    """Motion of the place by the hub's coordinates, (6, n)."""
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK)
    """Shafts of the first drive and of the second that may stick."""

    @cached_property
    def states(self) -> DriveStates | None:
        """States in which the drives of the craft may be; None where these are known."""
        return drive_states(self.scenario, sticking=self.sticking)

    @cached_property
    def turning(self) -> TurningDrives:
        """Drives that turn and whose springs vary."""
        return turning_drives(self.scenario, self.sticking)

    def _forces(self) -> np.ndarray:
        """Forces on the coordinates by the square of the speed, either way round, (2, o, n, p)."""
        most = self._ends_of_parts[1][:, None, None] * self._parts
        return np.asarray(self.turning.craft.on_hub(self.place) @ most.transpose(0, 2, 3, 1))

    def _side_lines(self) -> SideLines | None:
        """Side lines of each order at its speed, of both ways round together: a bound on those of either."""
        speed, _ = self.speeds
        (f,) = self.frequencies(np.array([speed]))
        off = self._off(f)
        gain = self._gain(spread(f, off)).most.max(axis=-1).transpose(0, 2, 1)
        forces = self._forces() * gain[:, :, None, :] * speed**2
        return self.turning.of_lines(f, np.concatenate([*forces], axis=2), off)

    @cached_property
    def _motions(self) -> list[np.ndarray]:
        """Motion of each drive in its directions by each order over the grid [rad], (r, o, m)."""
        return [
            np.array([self._over_grid(partial(_along, one, k)) for k in range(len(one.directions))])
            for one in self.turning.drives
        ]

    def _over_grid(self, motion: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """Motion by each order over the grid, (o, m), as forces at frequencies make it."""
        speed = 2.0 * np.pi * self.grid / self.orders[:, None]
        gains = self._gain_on_grid.most.transpose(0, 2, 3, 1)
        ways = [
            [motion(self.grid, on) * gain for on, gain in zip(*way, strict=True)]
            for way in zip(self._forces(), gains, strict=True)
        ]
        return np.asarray(np.sum(np.max(ways, axis=0), axis=2) * speed**2)

    @cached_property
    def _swept_side_lines(self) -> SideLines | None:
        shafts = [self._over_grid(one.motion) for one in self.turning.shafts]
        return self.turning.of_sweep(self.grid, self._motions, shafts, self._anywhere())

    def _anywhere(self) -> tuple[Anywhere, ...]:
        """Motion that friction and motors make of the orders at frequencies that are not known."""
        friction, norm = self.turning.friction, 0.0
        if friction.switches:
            norm = float(self._over_grid(friction.norm_of_forces).max(axis=1).sum())
        swings = [self._over_grid(one.motion) for one in self.turning.sines]
        peaks = [float(u.max(axis=1).sum()) for u in swings]
        torques = [
            float(one.torque(self.grid, self._over_grid(one.motion).T).max(axis=0).sum())
            for one in self.turning.remainders
        ]
        return self.turning.anywhere(norm, peaks, peaks, torques)

    @cached_property
    def _beside(self) -> np.ndarray:
        """Amplitudes that varying springs add at most at the frequency of each order over the grid [rad], (o,
        m, 2).
        """
        if not self.turning.drives:
            return np.zeros((self.orders.size, self.grid.size, 2))
        return self.turning.beside(self.grid, self._motions)

    @cached_property
    def known(self) -> bool:
        """Whether its lines are those of the linearised drives alone."""
        if self.uncertain or self.states is not None:
            return False
        return not np.any(self._beside > _LEAST_SHARE * self.amplitudes)

    @cached_property
    def orders(self) -> np.ndarray:
        """Cycles per turn, ascending, (o,)."""
        return np.unique([h.order for h in self.wheel.harmonics])

    @cached_property
    def order_errors(self) -> np.ndarray:
        """Part by which each order may be off, as stated, (o,)."""
        stated = [
            max(h.order_error for h in self.wheel.harmonics if h.order == order)
            for order in self.orders.tolist()
        ]
        return np.asarray(np.array(stated) / self.orders)

    @property
    def searched_errors(self) -> np.ndarray:
        """Part by which each order is off at most in a search over speeds, (o,)."""
        return np.zeros(self.orders.size)

    def _off(self, frequency: np.ndarray) -> np.ndarray:
        """By how much frequencies (o,) [Hz] of the orders may be off, by their speed and by themselves."""
        return np.asarray(frequency_error_bound(frequency) + self.order_errors * frequency)

    @cached_property
    def _parts(self) -> np.ndarray:
        """Loads by the square of the speed, each with a phase of its own, as they are where they go round
        forward, and backward, (2, p, o, 6).
        """
        forward = self._parts_by_key[1]
        return np.array([forward, forward.conj()])

    @cached_property
    def _each_part(self) -> list[tuple[str, np.ndarray, tuple[float, float], float]]:
        """Key of each load, the load (o, 6), between which coefficients it is, and which it has."""
        axis = np.array(self.wheel.axis) / np.linalg.norm(self.wheel.axis)
        first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        first /= np.linalg.norm(first)
        turning = first - 1j * np.cross(axis, first)
        shapes = [
            ("radial_force", np.r_[turning, 0, 0, 0]),
            ("radial_torque", np.r_[0, 0, 0, turning]),
        ]
        shapes += [("axial_force", np.r_[axis, 0, 0, 0]), ("axial_torque", np.r_[0, 0, 0, axis])]
        parts = [
            (key, size * shape * (self.orders == h.order)[:, None], h.ends(key), size)
            for h in self.wheel.harmonics
            for key, shape in shapes
            for size in [max(getattr(h, key), _TRACE * h.ends(key)[1])]
        ]
        return [one for one in parts if one[1].any()] or parts[:1]

    @cached_property
    def _parts_by_key(self) -> tuple[list[str], np.ndarray]:
        """Key of each load's coefficient, and the loads (p, o, 6) that go round forward."""
        return [one[0] for one in self._each_part], np.array([one[1] for one in self._each_part])

    @cached_property
    def _ends_of_parts(self) -> np.ndarray:
        """Smallest and largest of each part over itself, (2, p)."""
        each = [np.divide(ends, size or 1.0) for _, _, ends, size in self._each_part]
        return np.array(each).T

    @cached_property
    def uncertain(self) -> bool:
        """Whether coefficients, orders or modes have intervals."""
        by_coefficients = any(one.uncertain for one in self.wheel.harmonics)
        by_modes = any(one.uncertain for one in self.wheel.modes)
        return by_coefficients or by_modes or bool(self.order_errors.any())

    def _gain(self, frequency: np.ndarray) -> Amplification:
        """Factor of the wheel's modes on the parts of each order at its frequencies (o, n) [Hz], either
        way round, (2, p, o, n).
        """
        keys, parts = self._parts_by_key
        found = np.ones((3, 2, len(parts), *frequency.shape))
        for mode in self.wheel.modes:
            of_mode = amplification(mode, np.maximum(frequency, 1e-12), self.orders)
            for k, key in enumerate(keys):
                if key in MOVED_BY[mode.motion]:
                    found[:, :, k] *= of_mode
        return Amplification(*found)

    @cached_property
    def _gain_on_grid(self) -> Amplification:
        """Factor of the wheel's modes over the grid, either way round, (2, p, o, m)."""
        return self._gain(np.broadcast_to(self.grid, (self.orders.size, self.grid.size)))

    @cached_property
    def resonances(self) -> list[Resonance]:
        """Where an order meets a mode of the wheel."""
        found: list[Resonance] = []
        for mode in self.wheel.modes:
            found += resonances(mode, self._orders_of(mode))
        return found

    def _orders_of(self, mode: WheelMode) -> np.ndarray:
        """Orders whose loads a mode passes on."""
        moved = [any(h.ends(key)[1] for key in MOVED_BY[mode.motion]) for h in self.wheel.harmonics]
        return np.unique([h.order for h, of in zip(self.wheel.harmonics, moved, strict=True) if of])

    @property
    def natural_frequencies(self) -> np.ndarray:
        """Natural frequencies of drive, spacecraft and wheel as its orders meet them [Hz]."""
        own = natural_frequencies(self.scenario, self.states)
        return np.concatenate([own, [one.frequency for one in self.resonances]])

    def _sizes(self, frequency: np.ndarray) -> Amplification:
        """Amplitudes [rad] of the parts of each order at its frequencies (o, n) [Hz], (p, o, n, 2), with the
        factor of the wheel's modes: the larger of both ways round, and of the least the smaller.
        """
        by = line_of_sight_transfer(self.scenario, frequency.ravel(), self.place).reshape(
            *frequency.shape, 2, 6
        )
        speed = 2.0 * np.pi * frequency / self.orders[:, None]
        sizes = np.abs(np.einsum("onkc,wpoc->wponk", by, self._parts)) * speed[:, :, None] ** 2
        least, value, most = (gain[..., None] * sizes for gain in self._gain(frequency))
        return Amplification(np.minimum(*least), np.maximum(*value), np.maximum(*most))

    @cached_property
    def _not_measured(self) -> tuple[Unobserved, ...]:
        """Gaps of a measured wheel: all, where it turns at other speeds or a load was not measured, and above
        what was measured."""
        low, high = self.speeds
        first, last = self.wheel.measured_from or 0.0, self.wheel.measured_to or math.inf
        found = []
        slack = 1.0 + CLOCK_UNCERTAINTY
        if low * slack < first or high > last * slack:
            what = (
                f"from {_rpm(first):.5g} rpm"
                if math.isinf(last)
                else (f"from {_rpm(first):.5g} to {_rpm(last):.5g} rpm")
            )
            found.append(open_gap(f"the wheel was measured {what} only"))
        if self.wheel.measured_up_to is not None:
            why = f"the wheel was measured up to {self.wheel.measured_up_to:.5g} Hz"
            found.append(open_gap(why, self.wheel.measured_up_to))
        found += list(self._resonances_without_mode())
        if self.wheel.not_measured:
            loads = " and ".join(load.replace("_", " ") for load in self.wheel.not_measured)
            found.append(open_gap(f"the wheel's {loads}: not measured (wheel.not_measured)"))
        if self.wheel.one_axis:
            loads = " and ".join(load.replace("_", " ") for load in self.wheel.one_axis)
            found.append(
                open_gap(f"the wheel's {loads}: measured about one of two axes (wheel.one_axis)")
            )
        return tuple(found)

    def _resonances_without_mode(self) -> Iterator[Unobserved]:
        """The gaps of resonances that no mode explains, at the speeds that it has."""
        slack = 1.0 + CLOCK_UNCERTAINTY
        for one in self.wheel.resonances:
            low = max(self.speeds[0] / slack, one.speed)
            high = min(self.speeds[1] * slack, one.speed_to)
            if low > high:
                continue
            ends = one.order * low / (2.0 * np.pi), one.order * high / (2.0 * np.pi)
            yield open_gap(
                f"the wheel's {one.load.replace('_', ' ')} of order {one.order:.5g} has a resonance between"
                f" {_rpm(one.speed):.5g} and {_rpm(one.speed_to):.5g} rpm that none of its modes explains (measure"
                " there at speeds closer together, or with finer frequencies, or give the mode in place of"
                " wheel.resonances)",
                ends[0] * (1.0 - _BESIDE_RESONANCE),
                ends[1] * (1.0 + _BESIDE_RESONANCE),
            )

    @cached_property
    def _too_slow(self) -> tuple[Unobserved, ...]:
        """Gap of orders that reach below what means something on a hub without attitude control, at
        any speed of the range.
        """
        low, high = self._first_and_last
        lowest = receiver_of(self.scenario).lowest
        from_speed = rounded_up(60.0 * lowest / float(self.orders[0]))
        remedy = f"wheel.speed: {from_speed} rpm or more"
        return low_frequency_gap(self.scenario, low, high, remedy=remedy)

    @property
    def speeds(self) -> tuple[float, float]:
        """Ends of the range [rad/s]."""
        return self.wheel.speed, self.wheel.speed_to or self.wheel.speed

    @property
    def _first_and_last(self) -> np.ndarray:
        """Lowest and highest frequency of each order over all speeds, by its own error, (2, o) [Hz]."""
        ends = 1.0 + np.outer([-1.0, 1.0], self.order_errors)
        return np.asarray(self.frequencies(np.array(self.speeds)) * ends)

    def frequencies(self, speeds: np.ndarray) -> np.ndarray:
        """Frequencies of each order [Hz] at speeds (n,) [rad/s], (n, o)."""
        return np.asarray(speeds[:, None] * self.orders / (2.0 * np.pi))

    def at(self, speeds: np.ndarray) -> tuple[Contribution, ...]:
        """Its lines at each of the speeds (n,) [rad/s]."""
        f = self.frequencies(speeds)
        small, given, large = np.array(self._sizes(f.T)).transpose(0, 1, 3, 2, 4)
        ends = self._ends_of_parts[:, :, None, None, None]
        los, relative_error = bound_over_phases(given, ends[0] * small)
        most = np.sum(ends[1] * large, axis=0)
        relative_error[1] = np.divide(most, los, out=np.ones_like(los), where=los > 0.0) - 1.0
        names = tuple(f"order {order:g}" for order in self.orders)
        return tuple(
            Contribution(
                self.name, f"wheel at {_rpm(speed):.5g} rpm", names, f[k], np.nan_to_num(los[k]),
                gaps=(*self._too_slow, *self._not_measured),
                relative_error=np.nan_to_num(relative_error[:, k]), phased=False,
                frequency_error=np.zeros(self.orders.size), spins=True,
            )
            for k, speed in enumerate(speeds)
        )  # fmt: skip

    def contribution(self) -> Contribution:
        """At its speed, known as well as speeds are; or of a range, of which each requirement takes
        the worst.
        """
        low, high = self.speeds
        if low == high:
            (one,) = self.at(np.array([low]))
            off = self._off(one.frequency)
            return replace(
                one,
                relative_error=both_errors(
                    one.relative_errors, self._response_error(one.frequency, off)
                ),
                frequency_error=off,
                side=self._side_lines(),
            )
        # what tables and pictures show: a grid, and where an order meets a mode
        modes = [
            m.frequency * (1.0 + max(m.damping, 1e-5) * x)
            for m in coupled_modes(self.scenario)
            for x in (-0.5, 0.0, 0.5)
        ]
        modes += [x.frequency for x in self.resonances]
        met = np.outer(2.0 * np.pi * np.array(modes), 1.0 / self.orders).ravel()
        each = self.at(np.union1d(np.linspace(low, high, SPEEDS), met[(met > low) & (met < high)]))
        largest = max(each, key=lambda one: float(np.sum(np.abs(one.los) ** 2)))
        how = f"wheel, the worst of {_rpm(low):.5g} to {_rpm(high):.5g} rpm"
        return replace(largest, how=how, alternatives=each, sweep=self, side=self._swept_side_lines)

    def _response_error(self, frequency: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Relative error of each order (2, o, 2) by what it may be ``off`` [Hz], and by where a
        drive that holds may stand.
        """
        responses: list[Callable[[np.ndarray], np.ndarray]] = [self._response]
        if self.states is not None:
            responses.append(lambda at: self._responses_of_states(at, self._gain_at(at).value))
        if not self.order_errors.any():
            return response_uncertainty(responses, frequency, off, self.natural_frequencies)

        def at_speed(response: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
            given = np.repeat(frequency, at.size // frequency.size)
            return np.asarray(response(at) * (given / at)[:, None] ** 2)

        # Where the order is off and not the speed, its loads are those of the speed.
        responses += [partial(at_speed, each) for each in responses]
        found = response_uncertainty(responses, frequency, off, self.natural_frequencies)
        by_speed = np.full_like(found, 2.0 * CLOCK_UNCERTAINTY)
        return both_errors(found, by_speed)

    def _response(self, at: np.ndarray) -> np.ndarray:
        """Amplitudes (o n, 2) at frequencies (o n,) of one order after another."""
        return np.asarray(
            bound_over_phases(self._sizes(at.reshape(self.orders.size, -1)).value)[0].reshape(-1, 2)
        )

    def _gain_at(self, at: np.ndarray) -> Amplification:
        """Factor of the wheel's modes at frequencies (o n,) of one order after another, either way round,
        (2, p, o, n).
        """
        return self._gain(at.reshape(self.orders.size, -1))

    def _responses_of_states(self, at: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Smallest and largest of these over all states of the drives, (2, o n, 2), with factors ``gain``
        (2, p, o, n) of the wheel's modes.
        """
        assert self.states is not None
        order = np.repeat(np.arange(self.orders.size), at.size // self.orders.size)
        forces = self.states.on_hub(self.place) @ self._parts.transpose(0, 2, 3, 1)
        each = gain.reshape(2, len(self._each_part), -1).transpose(0, 2, 1)
        ways = [
            self.states.extremes(at, of_way[order]) * factor[:, None, :]
            for of_way, factor in zip(forces, each, strict=True)
        ]
        (least, other_least), (most, other_most) = zip(*ways, strict=True)
        found = np.array([np.minimum(least, other_least), np.maximum(most, other_most)]).sum(
            axis=-1
        )
        speed = 2.0 * np.pi * at / self.orders[order]
        return np.asarray(found * speed[:, None] ** 2)

    # ---- A range of speeds ----

    @cached_property
    def grid(self) -> np.ndarray:
        """Frequencies [Hz] that resolve every resonance, ascending, (m,)."""
        low, high = float(self._first_and_last[0].min()), float(self._first_and_last[1].max())
        low, high = low * (1.0 - 2.0 * CLOCK_UNCERTAINTY), high * (1.0 + 2.0 * CLOCK_UNCERTAINTY)
        found = [np.geomspace(low, high, int(math.log(high / low) / _GRID) + 3), self._ends]
        modes = [(mode.frequency, mode.damping) for mode in coupled_modes(self.scenario)]
        if self.states is not None:
            modes += [(f, width / f) for f, width in self.states.natural_frequencies.tolist()]
        modes += [(one.frequency, one.damping) for one in self.resonances]
        for frequency, damping in ((f, max(x, 1e-6)) for f, x in modes):
            reach = math.asinh(max(30.0, 2.0 * _GRID / damping))
            found.append(
                frequency
                * (1.0 + damping * np.sinh(np.linspace(-reach, reach, 2 * int(10.0 * reach) + 1)))
            )
        grid = np.unique(np.concatenate(found))
        return grid[(grid >= low) & (grid <= high)]

    @property
    def _ends(self) -> np.ndarray:
        """Frequencies [Hz] at which an order begins and ends, and how far they may be off: two
        ranges may meet just there.
        """
        ends = self.frequencies(np.array(self.speeds))
        off = CLOCK_UNCERTAINTY + self.order_errors
        return np.concatenate([ends * (1.0 - off), ends, ends * (1.0 + off)], axis=None)

    @cached_property
    def amplitudes(self) -> np.ndarray:
        """Amplitudes of each order over the grid [rad], (o, m, 2), 0 where they mean nothing."""
        return self._amplitudes_with(self._gain_on_grid.value)

    def _amplitudes_with(self, gains: np.ndarray) -> np.ndarray:
        """Amplitudes over the grid [rad], (o, m, 2), with factors of the wheel's modes (2, p, o, m)."""
        by = np.nan_to_num(line_of_sight_transfer(self.scenario, self.grid, self.place))
        found = np.zeros((self.orders.size, self.grid.size, 2))
        for part in range(len(self._each_part)):
            ways = [
                np.abs(np.einsum("mkc,oc->omk", by, of_way[part])) * gain[part, :, :, None]
                for of_way, gain in zip(self._parts, gains, strict=True)
            ]
            found += np.maximum(*ways)
        speed = 2.0 * np.pi * self.grid / self.orders[:, None]
        return np.asarray(found * speed[:, :, None] ** 2)

    @cached_property
    def in_any_state(self) -> WheelOnCraft:
        """The wheel with the largest amplitudes over all states of the drives."""
        if self.known:
            return self
        return _WheelInAnyState(
            self.name, self.wheel.at_most, self.scenario, self.place, self.sticking
        )

    def swept(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Frequencies that each order passes, (n,) [Hz], and its amplitudes there, (n, 2)
        [rad].
        """
        found = []
        passes = zip(*self._first_and_last, self.in_any_state.amplitudes, strict=True)
        for low, high, size in passes:
            passed = in_band(self.grid, low, high, frequency_error_bound(self.grid))
            found.append((self.grid[passed], size[passed]))
        return found

    def worst(self, r: Requirement, figure: Callable[[Contribution], float]) -> Contribution:
        """The speed that is worst for a requirement, with the error of what lies between the speeds
        that were tried.

        ``figure`` is what the requirement asks of lines, or for a curve their largest part of it.
        """
        scores: list[_Score] = []
        if r.curve is not None:
            scores = [_CurveRatio(self, r)]
        else:
            if r.statistic != "bound":
                scores = [_Rms(self, r)]
            else:
                scores = []
            if r.statistic != "rms":
                scores += [_Crest(self, r)]
            else:
                scores += []
        found = [_maximise_over_speed(self, score) for score in scores]
        each = self.at(np.unique(np.concatenate([one.speeds for one in found])))
        sizes = [figure(one) for one in each]
        best = each[int(np.argmax(sizes))]
        if max(sizes) == 0.0:
            best = replace(best, gaps=(*best.gaps, *self._beyond(r)))
        own = float(scores[0].at(self.frequencies(np.array([self._speed_of(best)])))[0])
        if own > 0.0:
            ratio = found[0].upper / own
        else:
            ratio = 1.0 + TOLERANCE
        best = replace(
            best, relative_error=best.relative_errors * np.array([1.0, 0.0])[:, None, None]
        )
        # the largest coefficients count at the speed at which they are worst, in ``in_any_state``
        less, more = both_errors(
            best.relative_errors,
            self._response_error(best.frequency, np.zeros(self.orders.size)),
        )
        less = less + self._part_beside(best)
        if self.order_errors.any() and own > 0.0:
            best, less = self._off_its_orders(best, less, r, figure)
        largest = np.maximum(
            (1.0 + more) * max(ratio, 1.0), self._ratio_in_any_state(scores[0], own)
        )
        if r.curve is None and r.statistic != "rms":
            known = more if self.known else best.relative_errors[1]
            best = replace(best, crests=self._crests(r, 1.0 + known.max(axis=0, initial=0.0)))
        return replace(
            best, relative_error=np.array([less, largest - 1.0]), side=self._swept_side_lines
        )

    def _part_beside(self, one: Contribution) -> np.ndarray:
        """Part of each order's line (o, 2) at a speed that varying elements may take off it."""
        off = np.array(
            [
                [np.interp(f, self.grid, column) for column in beside.T]
                for f, beside in zip(one.frequency, self._beside, strict=True)
            ]
        )
        size = np.abs(one.los)
        return np.divide(off, size, out=np.zeros_like(size), where=size > 0.0)

    def _ratio_in_any_state(self, score: _Score, own: float) -> float:
        """The most that the figure of a score is at any speed in any state of the drives, over its
        ``own`` as found; 1 where these are known.
        """
        if self.known or own <= 0.0:
            return 1.0
        wheel = self.in_any_state
        return _maximise_over_speed(wheel, type(score)(wheel, score.r)).upper / own

    def _speed_of(self, one: Contribution) -> float:
        """[rad/s]."""
        return float(2.0 * np.pi * one.frequency[0] / self.orders[0])

    def _crests(self, r: Requirement, factor: np.ndarray) -> tuple[float, float, float]:
        """Most that its lines reach at any speed and instant about x, about y and both [rad], times
        a ``factor`` for either axis.

        What is worst for all sources together need not be so for the wheel alone: nor its speed,
        nor the axis, nor the instant.
        """
        found, wheel = [0.0, 0.0], self.in_any_state
        for axis in _AXES[r.axis]:
            score = _Crest(wheel, r.model_copy(update={"axis": "xy"[axis]}))
            found[axis] = float(factor[axis]) * _maximise_over_speed(wheel, score).upper
        together = float(factor.max()) * _maximise_over_speed(wheel, _Crest(wheel, r)).upper
        return found[0], found[1], together

    def _off_its_orders(
        self,
        best: Contribution,
        less: np.ndarray,
        r: Requirement,
        figure: Callable[[Contribution], float],
    ) -> tuple[Contribution, np.ndarray]:
        """The ``best`` speed with by how much its frequencies may be off, and by which part its lines (o, 2)
        may be smaller than by ``less``, as orders may be off.

        There are two bounds below, of which the better one counts. Wherever the range holds another speed
        at which an order has the frequency found, its line alone is what it is there. And at this
        speed all lines are what they are at any of the frequencies that they may have.
        """
        error, f, speed = self.order_errors, best.frequency, self._speed_of(best)
        certain = np.abs(best.los) * np.maximum(1.0 - less, 0.0)
        alone = self._alone(best, certain, figure)
        low, high = self.speeds[0] * (1.0 + error.max()), self.speeds[1] * (1.0 - error.max())
        if low < high and not low <= speed <= high:
            (near,) = self.at(np.clip([speed], low, high))
            lost = both_errors(
                near.relative_errors, self._response_error(near.frequency, np.zeros_like(f))
            )[0] + self._part_beside(near)
            known = np.abs(near.los) * np.maximum(1.0 - lost, 0.0)
            alone = max(alone, self._alone(near, known, figure))
        off = error * f
        known = np.array([less, np.zeros_like(less)])
        displaced = both_errors(known, self._response_error(f, off))[0]
        highest = math.inf if r.highest is None else r.highest
        stays = in_band(f - off, r.lowest, highest) & in_band(f + off, r.lowest, highest)
        here = figure(
            replace(best, los=np.abs(best.los) * np.maximum(1.0 - displaced, 0.0) * stays[:, None])
        )
        whole = figure(replace(best, los=certain))
        if alone < here or whole == 0.0:
            return replace(best, frequency_error=off), displaced
        return best, 1.0 - np.maximum(1.0 - less, 0.0) * min(alone / whole, 1.0)

    def _alone(
        self, one: Contribution, los: np.ndarray, figure: Callable[[Contribution], float]
    ) -> float:
        """The figure of the largest order alone of those (o, 2) at a speed whose frequency there another
        speed of the range has, if the order is off.
        """
        speed, (low, high) = self._speed_of(one), self.speeds
        found = 0.0
        for order, error in zip(self.orders, self.order_errors, strict=True):
            if low * (1.0 + error) <= speed <= high * (1.0 - error):
                of_order = los * (self.orders == order)[:, None]
                found = max(found, figure(replace(one, los=of_order)) / (1.0 + error) ** 2)
        return found

    def _beyond(self, r: Requirement) -> tuple[Unobserved, ...]:
        """Gap of lines that are in the band only as speeds and orders are off."""
        highest = math.inf if r.highest is None else r.highest
        off = np.array([1.0 - CLOCK_UNCERTAINTY, 1.0 + CLOCK_UNCERTAINTY])[:, None]
        low, high = np.clip(self._first_and_last * off, r.lowest, highest)
        wheel = self.in_any_state
        both = r.model_copy(update={"axis": "radial"})
        (most,) = _Rms(wheel, both).largest(low[None], high[None])
        within = in_band(low, *(self._first_and_last * off))
        if not np.any(most[within]):
            return ()
        at = frequencies_that_count_most(r, 0.5 * (low + high), 0.5 * (high - low))
        why = f"its range of speeds ends nearer to the band than speeds are known ({CLOCK_UNCERTAINTY:g})"
        if self.order_errors.any():
            why = "its range of speeds ends nearer to the band than speeds and orders are known"
        return (Unobserved(why, 0.0, math.inf, at[within], most[within]),)


class _WheelInAnyState(WheelOnCraft):
    """A wheel of which each order is as large as it is in the state of the drives that is worst for it
    at its frequency.
    """

    @cached_property
    def amplitudes(self) -> np.ndarray:
        """Largest amplitudes of each order over the grid [rad], (o, m, 2)."""
        at = np.tile(self.grid, self.orders.size)
        if self.states is None:
            found = self._amplitudes_with(self._gain_on_grid.most)
        else:
            found = self._responses_of_states(at, self._gain_at(at).most)[1].reshape(
                self.orders.size, -1, 2
            )
        at_speed = (1.0 + self.order_errors)[:, None, None] ** 2  # the grid takes orders as given
        return np.asarray(found + self._beside) * at_speed

    @property
    def searched_errors(self) -> np.ndarray:
        """Part by which each order is off at most, (o,)."""
        return self.order_errors


def _rpm(speed: float) -> float:
    return 60.0 * speed / (2.0 * math.pi)


@dataclass(frozen=True)
class _WorstSpeed:
    speeds: np.ndarray
    """The best that were tried, within the range [rad/s], and others near the best of all."""
    value: float
    upper: float
    """Above which nothing in the range is."""


class _Score:
    """A figure of the lines at a speed, and a bound on it between two."""

    halved = 1024
    """Intervals that are halved at a time."""

    def __init__(self, wheel: WheelOnCraft, r: Requirement) -> None:
        self.wheel, self.r = wheel, r
        self.axes = _AXES[r.axis]
        self.window = r.window or r.apart or 1.0
        self.low, self.high = r.lowest, math.inf if r.highest is None else r.highest
        self.sizes = np.ascontiguousarray(wheel.amplitudes[:, :, self.axes])
        self.off = wheel.searched_errors

    def breaks(self) -> Sequence[float]:
        """Frequencies [Hz] at which something changes at once."""
        modes = self.wheel.natural_frequencies.tolist()
        return [f for f in (self.low, self.high, *modes) if 0.0 < f < math.inf]

    def amplitude(self, f: np.ndarray) -> np.ndarray:
        """Amplitude of each order at its frequencies (n, o), (n, o, axes); 0 outside of the band."""
        found = np.empty((*f.shape, len(self.axes)))
        for k, size in enumerate(self.sizes):
            for j in range(len(self.axes)):
                found[:, k, j] = np.interp(f[:, k], self.wheel.grid, size[:, j])
        return found * in_band(f, self.low, self.high)[:, :, None]

    def largest(self, f: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Bound on the amplitudes of each order between frequencies ``f`` and ``g`` (n, o), (n, o,
        axes); 0 outside of the band.
        """
        last = self.wheel.grid.size - 1
        found = np.empty((*f.shape, len(self.axes)))
        first = np.clip(np.searchsorted(self.wheel.grid, f) - 1, 0, last)
        behind = np.clip(np.searchsorted(self.wheel.grid, g) + 1, first + 1, last + 1)
        for k, size in enumerate(self.sizes):
            padded = np.vstack([size, size[-1:]])
            pairs = np.column_stack([first[:, k], behind[:, k]]).ravel()
            found[:, k] = np.maximum.reduceat(padded, pairs, axis=0)[::2]
        touches = (g >= self.low * (1.0 - 1e-9)) & (f <= self.high * (1.0 + 1e-9))
        return found * (1.0 + _ENVELOPE) * touches[:, :, None]

    def steepest(self, f: np.ndarray, g: np.ndarray, *, crest: bool) -> np.ndarray:
        """Largest change with frequency [1/Hz], from ``f`` to ``g``, of a line of 1 in a window: of
        its rms, or at any instant.
        """
        last, first = np.pi * g * self.window, np.maximum(np.pi * f * self.window, 1e-12)
        mean = np.minimum(
            0.44, 1.0 / first + 1.0 / first**2
        )  # of the spherical Bessel function j_0, and of 3 j_1
        slope = np.minimum(1.0, 3.0 / first + 6.0 / first**2 + 6.0 / first**3)
        by_window, by_change = np.zeros_like(first), np.zeros_like(first)
        match self.r.metric:
            case "mpe" | "pde":
                by_window = mean * (2.0 if self.r.metric == "pde" else 1.0)
            case "rpe":
                by_window = np.full_like(first, 1.44 if crest else math.sqrt(1.0 / 3.0))
            case "smear":
                by_window = slope * (1.0 if crest else math.sqrt(1.0 / 3.0))
            case "jitter":
                if crest:
                    by_window = np.minimum(2.44, 0.9 * last)
                else:
                    by_window = np.minimum(math.sqrt(1.0 / 3.0), 0.35 * last)
        if self.r.metric in ("stability", "pde"):
            by_change = 2.0 * (
                np.minimum(1.0, 1.0 / first) if self.r.metric == "pde" else np.ones_like(first)
            )
        return np.asarray(
            math.pi * (by_window * self.window + by_change * (self.r.apart or self.window))
        )

    def figure(self, f: np.ndarray) -> np.ndarray:
        """The figure of orders at frequencies (n, o), each as far off as costs most, (n,)."""
        return self.bound(f, f) if self.off.any() else self.at(f)

    def bound(self, f: np.ndarray, g: np.ndarray) -> np.ndarray:
        """A bound on it between frequencies (n, o), (n,)."""
        return self.between(f * (1.0 - self.off), g * (1.0 + self.off))

    def at(self, f: np.ndarray) -> np.ndarray:
        """The figure of orders at frequencies (n, o), (n,)."""
        raise NotImplementedError

    def between(self, f: np.ndarray, g: np.ndarray) -> np.ndarray:
        """A bound on it between frequencies (n, o), (n,)."""
        raise NotImplementedError


class _Rms(_Score):
    def _parts_of(self, f: np.ndarray, g: np.ndarray) -> int:
        """Into how many parts intervals are divided that orders which are off keep from being halved."""
        if not self.off.any():
            return 1
        cycles = float(np.max(g - f)) * max(self.window, self.r.apart or 0.0)
        return int(np.clip(math.ceil(cycles / _CYCLES), 1, _MOST_PARTS))

    def at(self, f: np.ndarray) -> np.ndarray:
        w = metric_weight(self.r.metric, f, self.window, self.r.apart)
        return np.asarray(np.sqrt(0.5 * np.einsum("no,noa->n", w, self.amplitude(f) ** 2)))

    def between(self, f: np.ndarray, g: np.ndarray) -> np.ndarray:
        parts = self._parts_of(f, g)
        half, slope = 0.5 * (g - f) / parts, self.steepest(f, g, crest=False)
        w = np.zeros_like(f)
        # a weight is the mean square of an amplitude: its root changes no faster than that
        for k in range(parts):
            weight = metric_weight(self.r.metric, f + (2 * k + 1) * half, self.window, self.r.apart)
            w = np.maximum(w, (np.sqrt(np.maximum(weight, 0.0)) + slope * half) ** 2)
        w = np.minimum(w, MAX_METRIC_WEIGHT[self.r.metric])
        return np.asarray(np.sqrt(0.5 * np.einsum("no,noa->n", w, self.largest(f, g) ** 2)))


class _Crest(_Score):
    """All lines at their crests at the worst instant of the window."""

    halved = 192

    def _factors(self, f: np.ndarray) -> np.ndarray:
        """Amplitudes in the window of lines of 1, at its instants, (t, n, o)."""
        found = np.abs(
            windowed_amplitudes(
                self.r.metric,
                f.ravel(),
                np.ones(f.size),
                self.window,
                self.r.apart,
                _CREST_INSTANTS,
            )
        )
        return found.reshape(-1, *f.shape)

    def _excess(self, f: np.ndarray) -> np.ndarray:
        """By how much these may be larger between the instants, (n, o)."""
        spacing = float(_CREST_INSTANTS[1])
        return excess_between_instants(self.r.metric, f, self.window, spacing)

    def _total(self, factors: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        each = np.einsum("tno,noa->tna", factors, sizes).max(axis=0)
        return np.asarray(np.linalg.norm(each, axis=1))

    def at(self, f: np.ndarray) -> np.ndarray:
        return self._total(self._factors(f), self.amplitude(f))

    def between(self, f: np.ndarray, g: np.ndarray) -> np.ndarray:
        middle, half = 0.5 * (f + g), 0.5 * (g - f)
        factors = self._factors(middle) + self._excess(middle)
        factors = factors + self.steepest(f, g, crest=True) * half
        return self._total(np.minimum(factors, MAX_METRIC_GAIN[self.r.metric]), self.largest(f, g))


class _CurveRatio(_Score):
    """Largest part of what a curve allows."""

    def __init__(self, wheel: WheelOnCraft, r: Requirement) -> None:
        super().__init__(wheel, r)
        self._allowed = r.allowed
        self.low, self.high = max(self.low, r.allowed.low), min(self.high, r.allowed.high)

    def breaks(self) -> Sequence[float]:
        return [*super().breaks(), *self._allowed.frequency]

    def _over(self, f: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        within = np.clip(f, self._allowed.low, self._allowed.high)  # beyond, nothing counts
        return np.asarray(np.linalg.norm(sizes, axis=2) / self._allowed.at(within))

    def at(self, f: np.ndarray) -> np.ndarray:
        return np.asarray(self._over(f, self.amplitude(f)).max(axis=1))

    def between(self, f: np.ndarray, g: np.ndarray) -> np.ndarray:
        sizes = self.largest(f, g)
        # between points of the curve what it allows is least at an end
        ends = [f, g, *(np.clip(x, f, g) for x in self._allowed.frequency if self.off.any())]
        return np.asarray(np.max([self._over(x, sizes) for x in ends], axis=0).max(axis=1))


def _maximise_over_speed(wheel: WheelOnCraft, score: _Score) -> _WorstSpeed:
    """The largest figure of a range of speeds: where, what was found and a bound above which it is
    not.
    """
    low, high = wheel.speeds
    ends = np.array([low * (1.0 - CLOCK_UNCERTAINTY), low, high, high * (1.0 + CLOCK_UNCERTAINTY)])
    breaks = np.outer(2.0 * np.pi * np.array(score.breaks()), 1.0 / wheel.orders).ravel()
    edges = np.unique(np.concatenate([ends, np.geomspace(low, high, SPEEDS), breaks]))
    edges = edges[(edges >= ends[0]) & (edges <= ends[-1])]
    tried = edges[(edges >= low) & (edges <= high)]
    values = score.figure(wheel.frequencies(tried))
    starts, stops = edges[:-1], edges[1:]
    bounds = score.bound(wheel.frequencies(starts), wheel.frequencies(stops))
    # just beyond the range, where speeds may be off, nothing is chosen, but halving what is known
    # there would gain nothing
    beyond = float(score.figure(wheel.frequencies(ends[[0, -1]])).max())
    closed = 0.0  # largest bound of intervals that need no halving
    for _ in range(_MAX_BISECTIONS):
        best = max(float(values.max()), beyond)
        open_ = bounds > best * (1.0 + TOLERANCE)
        closed = max(closed, float(bounds[~open_].max(initial=0.0)))
        starts, stops, bounds = starts[open_], stops[open_], bounds[open_]
        if not bounds.size:
            break
        order = np.argsort(-bounds)
        first, later = order[: score.halved], order[score.halved :]
        middles = 0.5 * (starts[first] + stops[first])
        within = middles[(middles >= low) & (middles <= high)]
        if within.size:
            tried, values = (
                np.r_[tried, within],
                np.r_[values, score.figure(wheel.frequencies(within))],
            )
        new = np.r_[starts[first], middles], np.r_[middles, stops[first]]
        halved = score.bound(*(wheel.frequencies(x) for x in new))
        starts, stops = np.r_[starts[later], new[0]], np.r_[stops[later], new[1]]
        bounds = np.r_[bounds[later], halved]
    value = float(values.max())
    upper = max(closed, float(bounds.max(initial=0.0)), value)
    order, place = np.sort(tried), np.argsort(-values)
    k = int(np.searchsorted(order, tried[place[0]]))
    first, last = order[max(k - 1, 0)], order[min(k + 1, order.size - 1)]
    count = _NEAR if last - first > CLOCK_UNCERTAINTY * first else 1  # closer than speeds are known
    near = np.linspace(first, last, count)
    return _WorstSpeed(np.r_[tried[place[:8]], near], value, upper)
