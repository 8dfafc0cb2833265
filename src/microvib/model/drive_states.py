"""States in which the drives of a craft may be, and the line of sight over all of them.

The linearised drives hold their shafts by springs of known stiffness. Some are not known: friction
that sticks locks a shaft or, with presliding, holds it by the stiffness of its contacts; elements of
a gear's hysteresis, or of a harness, stick or slide; teeth with backlash are in contact or not; detent torque is a
spring of either sign; references that are not sine and cosine make a spring that changes with the
electrical angle. How much of each acts depends on the motion. With s_i between its ends, of
springs g_i with the dynamic stiffness z_i, in coordinates of hub and wings,

    (Z(omega) + sum s_i z_i g_i g_i') x = F,   los = L x

Over one s_i the line of sight is a quotient of two linear functions, whose largest and smallest size
are known in closed form (``_extremes_over_one``); the others are taken at some values (``_levels``).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from microvib.model.coupling import Source, receiver_of, require_craft, source_of
from microvib.model.craft import hub_matrices
from microvib.model.drive_matrices import coordinates
from microvib.model.driver import motor_of_mean_spring, spring_factors
from microvib.model.friction import Friction
from microvib.model.linear import coupled_modes, dynamic_stiffness, frequency_blocks
from microvib.model.scenario import Scenario
from microvib.model.shaft_rates import ShaftRates
from microvib.model.sliding_elements import SlidingElements
from microvib.model.turning import dynamic_stiffness_of_windings, spring_over_turn

_MANY = 4
"""Springs from which the others are taken at their ends alone."""
_LEVELS = np.linspace(0.0, 1.0, 9)
"""Parts of the way between its ends at which the only other spring is taken."""
_RIGID = 1e3
"""Times the largest stiffness of the system, for the modes of a shaft that is locked."""
_LEAST_STIFFNESS = 1e-3
"""Part of the electromagnetic stiffness that detent torque leaves at the least."""
_FALLING = 4.0
"""By how much more friction whose torque falls as its rate grows (Stribeck) may make of loads than what
its energy bounds otherwise, in a steady motion; assumed: in drives that were integrated in time it made
no more than 14 % of that bound (``benchmarks/switching_friction.py``)."""
_RATES = 33
"""Rates at which the slope of a friction is taken."""
_GROWS = 1e-4
"""Negative damping ratio from which a mode grows; bodies that are free have next to none of their own."""
_NEGLIGIBLE_SLOPE = 1e-3
"""Part of the viscous friction below which the rest of its slope is left out."""
_DAMPER = 1j
"""Dynamic stiffness of a damper, over its size."""
_STICK_SLIP = np.exp(0.25j * np.pi * np.arange(1, 4))
"""Dynamic stiffness of friction that locks a shaft for a part of the time, over its size, as a sine sees it: a
damper, and an eighth of a turn to a spring or a mass on either side (assumed; beside a second wing that was
integrated in time it was a twelfth of a turn to a mass)."""
_WINDINGS, _RATIO = 1.1, 1.1
"""By how much more windings and another ratio of the gear may change the response than their own
equations to first order have it; assumed."""
_COUNTS = 1e-2
"""Part of a rotor's motion below which what they change of it is left out, at any frequency."""
_SLOW, _FAST, _TRIED = 0.05, 500.0, 161
"""Frequencies at which that is looked at [Hz], beside those of modes."""
_ALIKE = 1e-9
"""Part of the electromagnetic stiffness by which it may change and be as good as constant."""


@dataclass(frozen=True)
class UncertainSpring:
    """Spring beside those of the linearised drive: ``low`` to ``high`` times its stiffness."""

    on: np.ndarray
    """Stretch by the coordinates, (n,)."""
    stiffness: float
    """[N m/rad]."""
    low: float
    high: float
    """Infinite where it may be rigid."""
    damping: float = 0.0
    """[N m s/rad], which comes and goes with it."""
    switches: bool = False
    """Whether friction that sticks and slides, as its drive runs or by a load, makes it come and go."""
    largest: float = math.inf
    """Torque that such friction reaches at most [N m]."""
    dynamic: Callable[[np.ndarray], np.ndarray] | None = None
    """Dynamic stiffness [N m/rad] by the angular frequency (m,) [rad/s], where it is no spring with a
    damper; ``stiffness`` and ``damping`` are then those of modes alone."""
    above_energy: float = 1.0
    """By how much what it makes of loads may be above the bound that holds where its torque never falls
    as its rate grows (``model.switching_friction``); infinite where that tells nothing."""

    def dynamic_stiffness(self, omega: np.ndarray) -> np.ndarray:
        """Its dynamic stiffness [N m/rad] at ``omega`` (m,) [rad/s], complex, (m,)."""
        if self.dynamic is not None:
            return self.dynamic(omega)
        return np.asarray(self.stiffness + 1j * omega * self.damping)

    def falls_on(self, on: np.ndarray) -> bool:
        """Whether it is the falling friction of a shaft that always slides, whose angle is ``on`` (n,)."""
        return self.damping < 0.0 and bool(np.array_equal(self.on, on))


class Sticking(NamedTuple):
    """Which shafts of a drive may stick at times, so that friction without presliding locks them."""

    rotor: bool
    output: bool
    slowest_rotor: float = math.inf
    slowest_output: float = math.inf
    """Rates [rad/s] above which shafts that never stick stay; infinite where nobody looked."""
    repeats: bool = False
    """Whether the motion is a steady one that repeats with the steps, to which deviations return."""
    rates: ShaftRates | None = None
    """Rates over an electrical turn; None where nobody looked."""

    def or_as(self, other: Sticking) -> Sticking:
        """Shafts that may stick in either of two motions."""
        return Sticking(
            self.rotor or other.rotor,
            self.output or other.output,
            min(self.slowest_rotor, other.slowest_rotor),
            min(self.slowest_output, other.slowest_output),
            self.repeats and other.repeats,
            None if self.rates is None else self.rates.or_as(other.rates),
        )


MAY_STICK, SLIDES = Sticking(True, True), Sticking(False, False)


def springs_of_drive(scenario: Scenario, sticking: Sticking) -> list[UncertainSpring]:
    """Springs of a drive in its own coordinates, those of ``source_of``, by which of its shafts may
    stick.
    """
    reducer, motor, friction = scenario.reducer, scenario.motor, scenario.friction
    rotor, output = coordinates(reducer, len(scenario.array.modes))[:2]
    found = [
        *_of_friction(friction, output, sticking.output, sticking.repeats),
        *_of_friction(motor.friction, rotor, sticking.rotor, sticking.repeats),
    ]
    if scenario.rate:
        rate = abs(scenario.rate)
        found += _of_falling(friction, output, sticking.output, (sticking.slowest_output, rate))
        on_rotor = (sticking.slowest_rotor, reducer.ratio * rate)
        found += _of_falling(motor.friction, rotor, sticking.rotor, on_rotor)
    if friction.harness is not None and friction.harness.memory:
        stuck = _stuck_stiffness(friction.harness.memory)
        found.append(
            UncertainSpring(
                output, stuck, 0.0, 1.0, switches=sticking.output, largest=friction.harness.friction
            )
        )
    if not reducer.rigid:
        twist = -rotor / reducer.h - output
        stiffness = float(reducer.stiffness)
        if reducer.hysteresis is not None:
            stuck, largest = reducer.hysteresis.stiffness, reducer.hysteresis_torque
            switches = (
                (sticking.output and friction.largest_torque > 0.0)
                or (sticking.rotor and motor.friction.largest_torque > 0.0)
                or _elements_slide(scenario, sticking)
            )
            found.append(
                UncertainSpring(twist, stuck, 0.0, 1.0, switches=switches, largest=largest)
            )
        if reducer.backlash:
            gap = UncertainSpring(twist, stiffness, -1.0, 0.0, reducer.damping)
            found.append(replace(gap, above_energy=math.inf))
    return found


def _elements_slide(scenario: Scenario, sticking: Sticking) -> bool:
    """Whether elements of a gear's hysteresis stick and slide in turn as a drive turns, for all that is
    known: from one end of its limits to the other, by the swing of the gear's torque. Of a drive that
    stands a load may make them slide.
    """
    if sticking.rates is None:
        return True
    swing = sticking.rates.gear_swing / float(scenario.reducer.stiffness)
    limit = scenario.reducer.hysteresis_torque
    return any(k * swing >= 2.0 * share * limit for k, share in scenario.reducer.memory)


def springs_of_motor(scenario: Scenario, *, stands: bool) -> list[UncertainSpring]:
    """Spring of a motor beside that of the linearised drive, wherever in an electrical turn it is.

    By the references, if they are not sine and cosine; of a rotor that stands also by detent torque
    and flux harmonics, and by errors of the gear, which give it another ratio; and by its windings, in
    which it drives currents.
    """
    motor, factors = scenario.motor, spring_factors(scenario.driver, scenario.motor)
    part = 0.0
    if stands:
        largest = max(abs(factors.low), abs(factors.high), 1.0)
        part = largest * motor.detent_stiffness / motor.electromagnetic_stiffness
    low, high = factors.low - factors.mean - part, factors.high - factors.mean + part
    rotor = coordinates(scenario.reducer, len(scenario.array.modes))[0]
    found = [] if scenario.driver.drive != "current" else [_of_windings(scenario, rotor, stands)]
    if stands:
        found.append(_of_ratio(scenario, rotor))
    counts = [one for one in found if one is not None]
    if high - low <= _ALIKE:
        return counts
    least = max(low, min(_LEAST_STIFFNESS - factors.mean, 0.0))
    return [UncertainSpring(rotor, motor.electromagnetic_stiffness, least, high), *counts]


def _of_windings(scenario: Scenario, rotor: np.ndarray, stands: bool) -> UncertainSpring | None:
    """Spring that windings make of a rotor that swings, from none to somewhat more than they do."""

    def dynamic(omega: np.ndarray) -> np.ndarray:
        return dynamic_stiffness_of_windings(scenario, omega, stands=stands)

    return _where_it_counts(scenario, UncertainSpring(rotor, 0.0, 0.0, _WINDINGS, dynamic=dynamic))


def _of_ratio(scenario: Scenario, rotor: np.ndarray) -> UncertainSpring | None:
    """Spring and inertia of a rotor that stands where errors of its gear make another ratio 1/h - d eps/d
    theta_m: as that of a rotor that moves so much more or less, of twice the part, to first order.
    """
    reducer, motor = scenario.reducer, scenario.motor
    part = reducer.ratio * math.fsum(float(e.order) * e.amplitude for e in reducer.errors)
    if part == 0.0:
        return None
    spring = motor_of_mean_spring(scenario.driver, motor).electromagnetic_stiffness
    size, inertia = part * (2.0 + part), motor.rotor_inertia + reducer.input_inertia

    def dynamic(omega: np.ndarray) -> np.ndarray:
        return size * (spring + 1j * omega * motor.viscous - omega**2 * inertia)

    return _where_it_counts(scenario, UncertainSpring(rotor, 0.0, -_RATIO, _RATIO, dynamic=dynamic))


def _where_it_counts(scenario: Scenario, spring: UncertainSpring) -> UncertainSpring | None:
    """A spring on a rotor with its stiffness and damping for modes, those where it changes the rotor's
    motion most; None where that is next to nothing at any frequency.
    """
    modes = [mode.frequency for mode in coupled_modes(scenario)]
    f = np.union1d(np.geomspace(_SLOW, _FAST, _TRIED), [x for x in modes if x > _SLOW])
    moved = np.linalg.inv(dynamic_stiffness(scenario, f))[:, 0, 0]
    each = spring.dynamic_stiffness(2.0 * np.pi * f)
    changes = np.abs(each * moved)
    worst = int(np.argmax(changes))
    if spring.high * changes[worst] < _COUNTS:
        return None
    own, omega = complex(each[worst]), 2.0 * math.pi * float(f[worst])
    return replace(spring, stiffness=own.real, damping=max(own.imag, 0.0) / omega)


def _of_friction(
    friction: Friction, on: np.ndarray, sticks: bool, repeats: bool
) -> Iterator[UncertainSpring]:
    """Spring of a shaft's friction that sticks, in a motion that repeats or not."""
    above = 1.0
    if friction.position is not None:
        above = math.inf
    elif friction.stribeck_torque > 0.0:
        above = _FALLING if repeats else math.inf
    of_friction = UncertainSpring(
        on,
        1.0,
        0.0,
        math.inf,
        switches=sticks,
        largest=friction.largest_torque,
        above_energy=above,
    )
    if friction.memory:
        yield replace(of_friction, stiffness=_stuck_stiffness(friction.memory), high=1.0)
    elif sticks and friction.largest_torque > 0.0:
        yield of_friction


def _of_falling(
    friction: Friction, on: np.ndarray, sticks: bool, rates: tuple[float, float]
) -> Iterator[UncertainSpring]:
    """Damping, mostly negative, that friction of a shaft which always slides has beside its viscous part:
    between its least and its steepest slope from the slowest of its ``rates`` [rad/s] to as far above the
    commanded one, the other. Of a shaft that sticks the switching friction is bounded instead.
    """
    slowest, commanded = rates
    if sticks or friction.stribeck_torque == 0.0 or not commanded > 0.0:
        return
    slowest = min(slowest, commanded)
    fastest = 2.0 * commanded - slowest
    slopes = [friction.slope(x) for x in np.linspace(slowest, fastest, _RATES).tolist() if x > 0.0]
    steepest, least = (slope(slopes) - friction.viscous for slope in (min, max))
    if steepest < -_NEGLIGIBLE_SLOPE * friction.viscous:
        yield UncertainSpring(on, 0.0, least / steepest, 1.0, steepest)


def _stuck_stiffness(memory: Sequence[tuple[float, float]]) -> float:
    """Stiffness [N m/rad] of friction all of whose elements stick."""
    return math.fsum(stiffness for stiffness, _ in memory)


@dataclass(frozen=True)
class DriveStates:
    """Craft of a scenario with what is not known of its drives; hub and wings in one system."""

    scenario: Scenario
    springs: tuple[UncertainSpring, ...]
    """In the coordinates of hub, own wing and second wing."""
    feeds_a_mode: bool = False
    """Whether friction that falls with the rate, which is left out then, may feed a mode."""
    dampers: tuple[tuple[np.ndarray, float], ...] = ()
    """Known dampers beside those of the linearised drives: elongation by the coordinates (n,) and
    damping [N m s/rad]."""
    locks: tuple[np.ndarray, ...] = ()
    """Elongations by the coordinates (n,) that are held, by a stiffness of ``lock_stiffness``."""

    @cached_property
    def _system(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, damping and stiffness of hub, own wing and second wing, (n, n)."""
        hub = receiver_of(self.scenario)
        M, K, C, _ = hub_matrices(require_craft(self.scenario).spacecraft)
        wings = [(source_of(self.scenario), hub.root)]
        if hub.second is not None and hub.second_root is not None:
            wings.append((hub.second, hub.second_root))
        for wing, root in wings:
            M, C, K = _with_wing(M, C, K, wing, root)
        for on, damping in self.dampers:
            C = C + damping * np.outer(on, on)
        for on in self.locks:
            K = K + self.lock_stiffness * np.outer(on, on)
        return M, C, K

    @cached_property
    def lock_stiffness(self) -> float:
        """Stiffness of the locks [N m/rad]."""
        without = replace(self, locks=())
        return _RIGID * float(np.abs(np.diag(without._system[2])).max())

    @cached_property
    def _los(self) -> np.ndarray:
        """Line of sight by the coordinates, (2, n)."""
        los = receiver_of(self.scenario).los
        assert los is not None
        return np.hstack([los, np.zeros((2, self._system[0].shape[0] - los.shape[1]))])

    def on_hub(self, place: np.ndarray) -> np.ndarray:
        """Forces on the coordinates by loads where the hub moves by ``place`` (6, h), (n, 6)."""
        n = self._system[0].shape[0]
        return np.vstack([place.T, np.zeros((n - place.shape[1], place.shape[0]))])

    @property
    def on_interface(self) -> np.ndarray:
        """Forces on the coordinates by blocked loads at the own wing's interface, (n, 6)."""
        return self.on_hub(receiver_of(self.scenario).root)

    @property
    def on_rotor(self) -> np.ndarray:
        """Forces on the coordinates by a torque on the own rotor, (n, 1)."""
        found = np.zeros((self._system[0].shape[0], 1))
        found[receiver_of(self.scenario).root.shape[1]] = 1.0
        return found

    def on_rotor_of(self, wing: int) -> np.ndarray:
        """Forces on the coordinates by a torque on the rotor of the first drive, 0, or of the
        second wing's, 1, (n, 1).
        """
        found = np.zeros((self._system[0].shape[0], 1))
        before = source_of(self.scenario).M.shape[0] if wing else 0
        found[receiver_of(self.scenario).root.shape[1] + before] = 1.0
        return found

    @property
    def on_output(self) -> np.ndarray:
        """Forces on the coordinates by a torque on the own output, (n, 1)."""
        return self.on_output_of(0, self.scenario)

    def on_output_of(self, wing: int, drive: Scenario) -> np.ndarray:
        """Forces on the coordinates by a torque on the output of the first drive, 0, or of the second
        wing's ``drive``, 1, (n, 1).
        """
        found = np.zeros((self._system[0].shape[0], 1))
        way = coordinates(drive.reducer, len(drive.array.modes))[1]
        before = source_of(self.scenario).M.shape[0] if wing else 0
        first = receiver_of(self.scenario).root.shape[1] + before
        found[first : first + way.size, 0] = way
        return found

    @property
    def line_of_sight(self) -> np.ndarray:
        """Line of sight by the coordinates, (2, n)."""
        return self._los

    def response(self, frequency: np.ndarray, forces: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Response that ``rows`` (r, n) see of the coordinates without the springs that are not known,
        by ``forces`` (n, c), at frequencies (m,) [Hz], complex, (m, r, c).
        """
        M, C, K = self._system
        found = [np.zeros((0, rows.shape[0], forces.shape[-1]), dtype=complex)]
        for part in frequency_blocks(frequency.size, M.shape[0]):
            omega = 2.0 * np.pi * frequency[part, None, None]
            found.append(rows @ np.linalg.solve(K - omega**2 * M + 1j * omega * C, forces + 0j))
        return np.concatenate(found)

    def extremes(
        self,
        frequency: np.ndarray,
        forces: np.ndarray,
        rows: np.ndarray | None = None,
        *,
        between: bool = True,
    ) -> np.ndarray:
        """Smallest and largest line of sight [rad] over all states by ``forces`` on the coordinates
        (n, c), or at each frequency (m, n, c), at frequencies (m,) [Hz], (2, m, 2, c).

        ``rows`` (r, n) of the coordinates take the place of the line of sight, (2, m, r, c). Not ``between``:
        friction that locks a shaft does so, slides, or does both in turn, and holds it by no spring between.
        """
        each = np.broadcast_to(forces, (frequency.size, *forces.shape[-2:]))
        n, seen = self._system[0].shape[0], self._los if rows is None else rows
        found = [
            self._extremes(frequency[part], each[part], seen, between)
            for part in frequency_blocks(frequency.size, n)
        ]
        return np.concatenate([np.zeros((2, 0, seen.shape[0], forces.shape[-1])), *found], axis=1)

    def _extremes(
        self, frequency: np.ndarray, forces: np.ndarray, seen: np.ndarray, between: bool
    ) -> np.ndarray:
        M, C, K = self._system
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[:, None, None]
        G = np.array([spring.on for spring in self.springs]).reshape(-1, K.shape[0]).T
        right = np.concatenate([forces, np.broadcast_to(G, (len(frequency), *G.shape))], axis=2)
        moved = np.linalg.solve(K - omega**2 * M + 1j * omega * C, right.astype(complex))
        c, z = forces.shape[2], [s.dynamic_stiffness(omega[:, 0, 0]) for s in self.springs]
        start = _Reduced(
            seen @ moved[:, :, :c],
            seen @ moved[:, :, c:],
            G.T @ moved[:, :, c:],
            G.T @ moved[:, :, :c],
        )
        least, most = np.abs(start.los), np.abs(start.los)
        for k, spring in enumerate(self.springs):
            others = [j for j in range(len(self.springs)) if j != k]
            for levels in itertools.product(*(self._levels(j, between) for j in others)):
                at = start
                for j, level in zip(others, levels, strict=True):
                    at = at.with_spring(j, level, z[j])
                if between or math.isfinite(spring.high):
                    low, high = _extremes_over_one(at, k, z[k], spring.low, spring.high)
                else:
                    ends = [np.abs(at.with_spring(k, x, z[k]).los) for x in (spring.low, math.inf)]
                    low, high = np.minimum(*ends), np.maximum(*ends)
                least, most = np.minimum(least, low), np.maximum(most, high)
                if math.isinf(spring.high):
                    low, high = _extremes_of_stick_slip(at, k)
                    least, most = np.minimum(least, low), np.maximum(most, high)
        return np.array([least, most])

    def _levels(self, k: int, between: bool) -> list[float]:
        """Values at which a spring is taken while another takes all between its ends."""
        spring, count = self.springs[k], len(self.springs)
        if not between and math.isinf(spring.high):
            return [spring.low, spring.high]
        if count >= _MANY:
            return [spring.low, spring.high]
        parts = _LEVELS if count == 2 else _LEVELS[::4]
        if math.isfinite(spring.high):
            found = spring.low + (spring.high - spring.low) * parts
        else:  # from nothing to rigid, by how stiff it is beside what it is fixed to
            M, _, K = self._system
            own = float(spring.on @ K @ spring.on) / spring.stiffness
            with np.errstate(divide="ignore"):
                found = spring.low + own * np.divide(parts, 1.0 - parts)
        return sorted({0.0, *found.tolist()})

    @cached_property
    def grows(self) -> bool:
        """Whether deviations grow where friction falls most with the rate."""
        falling = [s for s in self.springs if s.damping < 0.0]
        if not falling:
            return False
        M, C, K = self._system
        C = C + sum(s.damping * np.outer(s.on, s.on) for s in falling)
        values = _eigenvalues(M, C, K)
        return bool(np.any(values.real > _GROWS * np.abs(values)))

    @cached_property
    def natural_frequencies(self) -> np.ndarray:
        """Natural frequencies [Hz] and half-widths of resonances [Hz] where all springs are at one
        of their ends, (m, 2).
        """
        rigid = _RIGID * float(np.abs(np.diag(self._system[2])).max())
        ends = [
            (s.low, s.high if math.isfinite(s.high) else rigid / s.stiffness) for s in self.springs
        ]
        found = [self._modes(state) for state in itertools.product(*ends)]
        return np.concatenate([np.zeros((0, 2)), *found])

    def _modes(self, state: Sequence[float]) -> np.ndarray:
        M, C, K = self._system
        for level, s in zip(state, self.springs, strict=True):
            K = K + level * s.stiffness * np.outer(s.on, s.on)
            C = C + level * s.damping * np.outer(s.on, s.on)
        values = _eigenvalues(M, C, K)
        values = values[values.imag > 1e-6 * np.abs(values)]
        return np.column_stack([np.abs(values), -values.real]) / (2.0 * np.pi)


def _eigenvalues(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Eigenvalues [1/s] of a system of mass, damping and stiffness (n, n), (2 n,)."""
    n = K.shape[0]
    inverse = np.linalg.solve(M, np.hstack([K, C]))
    return np.linalg.eigvals(
        np.block([[np.zeros((n, n)), np.eye(n)], [-inverse[:, :n], -inverse[:, n:]]])
    )


def drive_states(
    scenario: Scenario,
    *,
    own: bool = True,
    steps: bool = False,
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
    turning: bool = True,
) -> DriveStates | None:
    """States in which the drives of a craft may be; None where all is known.

    Parameters
    ----------
    scenario : Scenario
        The first drive on its craft.
    own : bool
        Of the first drive, too; else it is as linearised.
    steps : bool
        The second drive steps, whatever the scenario says: its detent torque is none of the springs.
    sticking : pair of Sticking
        Shafts of the first drive and of the second that may stick. Those of a drive that does not
        step may in any case.
    turning : bool
        With the springs of motors that turn, anything that these are over the electrical turn.
    """
    n = receiver_of(scenario).root.shape[1]
    mine = _springs_of_own(scenario, sticking[0], turning) if own else []
    other, beside = scenario.other_wing, list[UncertainSpring]()
    if other is not None and not scenario.second_is_locked:
        wing = require_craft(scenario).spacecraft.second_wing
        held = not steps and wing is not None and wing.drive == "held"
        beside = _springs_that_stand(other) if held else springs_of_drive(other, sticking[1])
        steps = steps or (not turning and not held and bool(other.rate))
        beside += springs_of_motor(other, stands=True) if not steps else []
        beside += springs_of_motor(other, stands=False) if steps and turning else []
    if not mine and not beside:
        return None
    n_own = source_of(scenario).M.shape[0]
    second = receiver_of(scenario).second
    n_other = 0 if second is None else second.M.shape[0]
    springs = [
        *(_placed(one, n, n_other) for one in mine),
        *(_placed(one, n + n_own, 0) for one in beside),
    ]
    return _without_feeding(DriveStates(scenario, tuple(springs)))


def _without_feeding(states: DriveStates) -> DriveStates:
    """States without the damping of falling friction where that may feed a mode, whose response then has
    no bound; they say so.
    """
    if not states.grows:
        return states
    left = tuple(one for one in states.springs if one.damping >= 0.0)
    return DriveStates(states.scenario, left, feeds_a_mode=True)


def craft_of_drives(
    scenario: Scenario,
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
    second: Scenario | None = None,
    *,
    own: bool = True,
) -> DriveStates:
    """The craft with its springs that are not known, but for elements of drives that turn which are
    known over the electrical turn (``model.sliding_elements``); the mean slopes of their frictions
    are dampers. ``second`` is how the drive of the second wing steps, whatever the scenario says;
    other arguments as for ``drive_states``.
    """
    steps = second is not None
    found = drive_states(scenario, sticking=sticking, own=own, steps=steps, turning=False)
    states = DriveStates(scenario, ()) if found is None else found
    springs, dampers = list(states.springs), []
    for wing, drive, elements in sliding_elements(scenario, sticking, second):
        if not own and wing == 0:
            continue
        shafts = states.on_rotor_of(wing)[:, 0], states.on_output_of(wing, drive)[:, 0]
        for on, damping, slides in zip(shafts, elements.mean_damping, elements.slides, strict=True):
            if slides:
                springs = [one for one in springs if not one.falls_on(on)]
            if damping:
                dampers.append((on, damping))
    return replace(states, springs=tuple(springs), dampers=tuple(dampers))


def sliding_elements(
    scenario: Scenario,
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
    second: Scenario | None = None,
) -> Iterator[tuple[int, Scenario, SlidingElements]]:
    """Drives of a craft that turn at a constant rate, by their numbers, with their elements; arguments as
    for ``craft_of_drives``.
    """
    for wing, drive in enumerate([scenario, second or scenario.driven_wing]):
        spring = None if drive is None else spring_over_turn(drive)
        if drive is None or spring is None:
            continue
        own = sticking[wing]
        slides = not own.rotor, not own.output
        slowest = own.slowest_rotor, own.slowest_output
        yield wing, drive, SlidingElements(drive, spring, own.rates, slides, slowest)


def _springs_of_own(scenario: Scenario, sticking: Sticking, turning: bool) -> list[UncertainSpring]:
    """Springs of the first drive; one that is parked holds its array as a second wing's does."""
    if scenario.rate == 0.0:
        return [*_springs_that_stand(scenario), *springs_of_motor(scenario, stands=True)]
    found = springs_of_drive(scenario, sticking)
    return [*found, *springs_of_motor(scenario, stands=False)] if turning else found


def _springs_that_stand(scenario: Scenario) -> list[UncertainSpring]:
    """Springs of a drive that is parked or holds. Friction without presliding holds its shaft until loads
    overcome it, which depends on all of them together (``studies.budget.side_lines``).
    """
    return [
        one if math.isfinite(one.high) else replace(one, switches=False)
        for one in springs_of_drive(scenario, MAY_STICK)
    ]


def _placed(spring: UncertainSpring, before: int, behind: int) -> UncertainSpring:
    """A spring of a wing by the coordinates of all."""
    return replace(spring, on=np.concatenate([np.zeros(before), spring.on, np.zeros(behind)]))


def _with_wing(
    M: np.ndarray, C: np.ndarray, K: np.ndarray, wing: Source, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices of a structure with a wing on it, where its interface moves by ``root`` (6, h) with
    the first coordinates.
    """
    n, s = M.shape[0], wing.M.shape[0]
    there = np.hstack([root, np.zeros((6, n - root.shape[1]))])
    stirred, apart = there.T @ wing.G, np.zeros((n, s))
    return (
        np.block([[M + there.T @ wing.mass @ there, stirred], [stirred.T, wing.M]]),
        np.block([[C, apart], [apart.T, wing.C]]),
        np.block([[K, apart], [apart.T, wing.K]]),
    )


@dataclass(frozen=True)
class _Reduced:
    """Line of sight and stretch of springs by forces on the coordinates and by those of the springs."""

    los: np.ndarray  # (m, 2, c)
    los_by_springs: np.ndarray  # (m, 2, p)
    stretch_by_springs: np.ndarray  # (m, p, p)
    stretch: np.ndarray  # (m, p, c)

    def with_spring(self, k: int, level: float, z: np.ndarray) -> _Reduced:
        """Line of sight and stretch with a spring at ``level`` times its dynamic stiffness (m,)."""
        own = self.stretch_by_springs[:, k, k]
        if math.isinf(level):
            pull = 1.0 / own
        else:
            pull = level * z / (1.0 + level * z * own)
        of_forces = (pull[:, None] * self.stretch[:, k])[:, None, :]
        of_springs = (pull[:, None] * self.stretch_by_springs[:, k])[:, None, :]
        by, to = self.los_by_springs[:, :, [k]], self.stretch_by_springs[:, :, [k]]
        return _Reduced(
            self.los - by * of_forces,
            self.los_by_springs - by * of_springs,
            self.stretch_by_springs - to * of_springs,
            self.stretch - to * of_forces,
        )


def _extremes_of_stick_slip(at: _Reduced, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest line of sight, (m, 2, c), over friction that locks the place of a spring at times; the
    largest of a damper alone.
    """
    one = np.ones(at.los.shape[0])
    least = np.min(
        [_extremes_over_one(at, k, turned * one, 0.0, math.inf)[0] for turned in _STICK_SLIP],
        axis=0,
    )
    return least, _extremes_over_one(at, k, _DAMPER * one, 0.0, math.inf)[1]


def _extremes_over_one(
    at: _Reduced, k: int, z: np.ndarray, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest line of sight, (m, 2, c), over one spring between ``low`` and ``high``
    times its dynamic stiffness (m,).

    It is (a + b s) / (1 + e s), whose square is a quotient of two real quadratics of s: extreme at an
    end, or where the derivative of that is zero, a quadratic equation.
    """
    own = at.stretch_by_springs[:, k, k]
    e = (z * own)[:, None, None]
    a = at.los
    b = z[:, None, None] * (
        own[:, None, None] * a - at.los_by_springs[:, :, [k]] * at.stretch[:, [k], :]
    )
    n0, n1, n2 = np.abs(a) ** 2, 2.0 * (a.conj() * b).real, np.abs(b) ** 2
    d0, d1, d2 = (
        np.ones_like(n0),
        2.0 * e.real * np.ones_like(n0),
        np.abs(e) ** 2 * np.ones_like(n0),
    )

    def squared(s: np.ndarray) -> np.ndarray:
        """Square of the line of sight at s, which may be infinite."""
        inside = np.abs(s) <= 1.0
        s, u = np.where(inside, s, 1.0), np.where(inside, 1.0, 1.0 / np.where(s == 0.0, 1.0, s))
        top = np.where(inside, n0 + s * (n1 + s * n2), n2 + u * (n1 + u * n0))
        bottom = np.where(inside, d0 + s * (d1 + s * d2), d2 + u * (d1 + u * d0))
        return np.asarray(np.maximum(top, 0.0) / np.maximum(bottom, 1e-300))

    A, B, C = n2 * d1 - n1 * d2, 2.0 * (n2 * d0 - n0 * d2), n1 * d0 - n0 * d1
    root = np.sqrt(np.maximum(B**2 - 4.0 * A * C, 0.0))
    q = -0.5 * (B + np.copysign(root, B))
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.nan_to_num(np.array([q / A, C / q]), nan=low, posinf=low, neginf=low)
    tried = [*np.clip(turns, low, high), np.full(n0.shape, low), np.full(n0.shape, high)]
    sizes = np.sqrt([squared(s) for s in tried])
    return sizes.min(axis=0), sizes.max(axis=0)
