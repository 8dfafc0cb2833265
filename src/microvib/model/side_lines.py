"""Lines beside those of other sources, which drives that turn make of them.

A drive that turns has elements whose coefficients change over its electrical turn
(``model.sliding_elements``): the motor's spring, friction, errors of the gear. The linearised drive,
which moves by q in the directions along which they act, then has periodic coefficients. With Z(t) = sum
of Z_m exp(j m omega_e t), over all orders m of either sign, a load at f moves it at f + k f_e by q_k,

    q_k + Y(f + k f_e) sum_m Z_m q_(k-m) = q where k = 0, else 0,

where Y are the motions by torques along these directions of the linearised drive, and q its motion by the
load. It is solved for the orders that count (harmonic balance, Hill's determinant); the line of sight at
f + k f_e is that by the torques -sum_m Z_m q_(k-m).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from microvib.model.drive_states import SLIDES, DriveStates, Sticking, sliding_elements
from microvib.model.linear import frequency_blocks
from microvib.model.scenario import Scenario
from microvib.model.sliding_elements import ORDER_DIGITS, ROTOR, Remainder, SlidingElements, Varying
from microvib.model.switching_friction import frequencies_of_response
from microvib.model.turning import SpringOverTurn, spring_over_turn

_LEAST_PART = 1e-5
"""Part of a motion below which what varies is left out."""
_TYPICAL, _LOW, _HIGH, _BEYOND = 41, 0.1, 100.0, 10.0
"""Frequencies at which that part is looked at: how many, the lowest, and the highest of 100 Hz and so many
electrical turns [Hz]."""
_RISE = 3.0
"""By how much a resonance is taken to raise motion, for which orders count."""
_LEAST_WEIGHT = 1e-4
"""Part of the linear motion below which an order is left out."""
_MOST_ORDERS = 49
"""Orders that are solved together, at most."""
_MARGIN, _MARGIN_OF_VARIATION = 1.03, 0.2
"""By how much lines may be larger than the linearised drive makes them, and by how much more for
elements that vary by all of themselves; assumed: flux harmonics in the back-EMF are left out, and the
rotor's own motion by what varies is that of a constant spring."""
_LARGEST_LOOP = 0.02
"""Torque of back-EMF at f_e over that of the spring above which side lines have no bound: with a slow
current loop lines in time were up to 1.8 times as large as by harmonic balance."""
_LARGEST_MOTION = 0.35
"""Electrical angle [rad] by which what varies moves the rotor, above which side lines have no bound:
full steps, half steps, and steps on a resonance of the rotor. There lines in time were up to five
times as large as by harmonic balance."""
_LEAST_PULL = 0.05
"""Part of the largest torque that any side line is given besides: small ones are known less well
(``benchmarks/side_lines.py``)."""
_MOST_DOUBLED = 16
"""Orders, those that vary most, of which a doubling of the period is looked for."""
_LARGEST_RISE = 2.0
"""Motion of any order over the linear one of half the frequency of what varies, from which the drive is
near a doubling of its period; assumed. It is singular there."""
_ROUNDING = 1e-12
_SLOWEST = 1e-3
"""Frequency [Hz] in place of one that is zero."""


@dataclass(frozen=True)
class SideResponse:
    """Response at other frequencies to loads at frequencies (m,)."""

    orders: np.ndarray
    """Electrical turns k by which frequencies are moved, (k,); 0 is what comes beside the linear response."""
    frequency: np.ndarray
    """Frequencies |f + k f_e| [Hz], (k, m)."""
    los: np.ndarray
    """Largest line of sight [rad] by 1 rad of linear motion at f in each direction, (r, k, m, 2);
    infinite where nothing bounds it."""
    electrical: float
    """Electrical turns per second f_e [Hz]."""

    def of_motion(self, motion: np.ndarray) -> np.ndarray:
        """Largest line of sight [rad] by linear motion (r, m, ...) at f in each direction, (k, m, 2, ...)."""
        with np.errstate(invalid="ignore"):
            found = np.einsum("rkmx,rm->kmx", self.los, motion)
        return np.nan_to_num(found, nan=math.inf, posinf=math.inf)


@dataclass(frozen=True)
class VaryingDrive:
    """A drive that turns, by its number on the craft, and what of it varies as it does."""

    craft: DriveStates
    """The craft, with the springs that are not known besides."""
    wing: int
    """0 the first drive, 1 that of the second wing."""
    elements: SlidingElements
    with_margins: bool = True
    """Whether lines are as large as they may be, or as harmonic balance has them."""
    with_windings: bool = True
    """Whether windings take part, or currents are those that are asked for."""

    @property
    def spring(self) -> SpringOverTurn:
        """The motor's spring over the electrical turn."""
        return self.elements.spring

    @property
    def linear(self) -> float:
        """Stiffness of the linearised drive [N m/rad]."""
        return self.elements.linear

    @cached_property
    def _all(self) -> dict[float, Varying]:
        """Coefficients by orders, without those that make next to nothing."""
        parts = self._parts
        return {m: one for m, one in self.elements.varying.items() if m == 0.0 or m in parts}

    @cached_property
    def _parts(self) -> dict[float, float]:
        """Part of a motion that each order but 0 makes as a rule: of the motor's spring that of
        the mean, of others the median over frequency.
        """
        omega = 2.0 * math.pi * self._typical_frequencies
        by = self.craft.response(self._typical_frequencies, self._every.T, self._every)
        found = {}
        for m, one in self.elements.varying.items():
            of_spring = abs(one.spring[ROTOR, ROTOR]) / self.linear
            moved = omega + 2.0 * math.pi * m * self.spring.frequency
            beside = one._replace(spring=one.spring.copy())
            beside.spring[ROTOR, ROTOR] = 0.0
            part = of_spring
            if any(one.any() for one in beside):
                each = np.abs(by @ beside.at(omega, moved)).max(axis=(1, 2))
                part += float(np.median(each))
            if m != 0.0 and part > _LEAST_PART:
                found[m] = part
        return found

    @property
    def _typical_frequencies(self) -> np.ndarray:
        highest = max(_BEYOND * self.spring.frequency, _HIGH)
        return np.geomspace(_LOW, highest, _TYPICAL)

    @property
    def varies(self) -> bool:
        """Whether anything changes by more than is left out."""
        return bool(self._parts)

    @property
    def unbounded(self) -> str:
        """Why its lines have no bound, with the keys that change it; empty where they have one."""
        varying = [abs(one.spring[ROTOR, ROTOR]) for m, one in self._all.items() if m]
        if self.spring.motion > _LARGEST_MOTION:
            return "its steps move the rotor far (more driver.microsteps, or another rate)"
        if self.loop > _LARGEST_LOOP:
            return "its current loop is slow (driver.proportional_gain)"
        if not math.fsum(varying) < self.linear:
            return (
                "its motor may be without stiffness at some angle (motor.detent_torque, driver.table,"
                " driver.imperfections)"
            )
        return ""

    @cached_property
    def margin(self) -> float:
        """Factor on lines; infinite where these have no bound."""
        if self.unbounded:
            return math.inf
        return _MARGIN + _MARGIN_OF_VARIATION * min(math.fsum(self._parts.values()), 1.0)

    @property
    def loop(self) -> float:
        """Torque that back-EMF makes at f_e of the rotor's motion, over that of the spring."""
        drive = self.elements.drive
        resistance = drive.motor.winding_resistance + drive.driver.proportional_gain
        emf = drive.motor.axis_torque_constant**2 / resistance
        return emf * 2.0 * math.pi * self.spring.frequency / self.linear

    @cached_property
    def orders(self) -> np.ndarray:
        """Orders k of f + k f_e that count, ascending, (k,)."""
        weights, new = {0.0: 1.0}, {0.0: 1.0}
        while new:
            reached: dict[float, float] = {}
            for k, weight in new.items():
                for m, part in self._parts.items():
                    at = round(k + m, ORDER_DIGITS) + 0.0
                    reached[at] = max(reached.get(at, 0.0), weight * min(_RISE * part, 0.9))
            new = {
                k: weight
                for k, weight in reached.items()
                if weight > _LEAST_WEIGHT and weight > weights.get(k, 0.0)
            }
            weights.update(new)
            largest = sorted(weights, key=lambda k: -weights[k])[:_MOST_ORDERS]
            new = {k: weight for k, weight in new.items() if k in largest}
        return np.array(sorted(sorted(weights, key=lambda k: -weights[k])[:_MOST_ORDERS]))

    @cached_property
    def directions(self) -> tuple[int, ...]:
        """Directions along which anything varies, of ``sliding_elements.DIRECTIONS``."""
        acts = sum(
            (np.abs(np.array(one)).max(axis=0) for one in self._all.values()), np.zeros((3, 3))
        )
        return tuple(k for k in range(3) if acts[k].any() or acts[:, k].any() or k == ROTOR)

    def motion(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Largest motion in each direction [rad] by ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), of the linearised drives, in any state, (m, r, c).
        """
        return np.asarray(self.craft.extremes(frequency, forces, rows=self.on)[1])

    @cached_property
    def _every(self) -> np.ndarray:
        """Directions by the coordinates, (3, n)."""
        drive = self.elements.drive
        rotor = self.craft.on_rotor_of(self.wing)[:, 0]
        output = self.craft.on_output_of(self.wing, drive)[:, 0]
        return np.array([rotor, output, -rotor / drive.reducer.h - output])

    @property
    def on(self) -> np.ndarray:
        """Directions along which anything varies, by the coordinates, (r, n)."""
        return np.asarray(self._every[list(self.directions)])

    @cached_property
    def nearly_doubles(self) -> bool:
        """Whether a deviation of twice the period of something that varies is raised so much that the drive
        is near to moving with it by itself.
        """
        if self.craft.springs or self.unbounded:
            return False
        f = self.spring.frequency
        largest = sorted((m for m in self._parts if m > 0.0), key=lambda m: -self._parts[m])
        at = 0.5 * f * np.array(largest[:_MOST_DOUBLED])
        moved = (self.orders[:, None] * f + at).ravel()
        size = np.maximum(np.abs(moved), _SLOWEST)
        by = self.craft.response(size, self.on.T, self.on)
        by = np.where((moved < 0.0)[:, None, None], by.conj(), by)
        r = len(self.directions)
        whole = self._whole(self._mixing(at), by.reshape(-1, at.size, r, r), 1.0)
        q = np.linalg.solve(whole, np.broadcast_to(self._unit() + 0j, (at.size, whole.shape[1], r)))
        scale = np.array(
            [1.0, self.elements.drive.reducer.ratio, self.elements.drive.reducer.ratio]
        )
        own = scale[list(self.directions)]
        raised = np.abs(q.reshape(at.size, -1, r, r)) * own[:, None] / own
        return bool(np.max(raised) > _LARGEST_RISE)

    def response(self, frequency: np.ndarray) -> SideResponse:
        """Response to loads at frequencies (m,) [Hz], by the linear motion in each direction."""
        size = max(256 // len(self.directions) ** 2, 1)
        each = [self._part(frequency[x]) for x in frequency_blocks(frequency.size, size)]
        moved = self.orders[:, None] * self.spring.frequency + frequency
        none = np.zeros((len(self.directions), self.orders.size, 0, 2))
        los = np.concatenate([none, *each], axis=2)
        return SideResponse(self.orders, np.abs(moved), los, self.spring.frequency)

    def _part(self, frequency: np.ndarray) -> np.ndarray:
        k, m, r = self.orders.size, frequency.size, len(self.directions)
        if self.with_margins and math.isinf(self.margin):
            return np.full((r, k, m, 2), math.inf)
        at = (self.orders[:, None] * self.spring.frequency + frequency).ravel()
        size = np.maximum(np.abs(at), _SLOWEST)
        torque, rows = self.on.T, np.vstack([self.craft.line_of_sight, self.on])
        if self.craft.springs:
            by = self.craft.extremes(size, torque, rows=rows)[1].reshape(k, m, 2 + r, r)
            pull = self._pull_at_most(frequency, by[:, :, 2:])
            with np.errstate(invalid="ignore"):
                los = _by_torques(by[:, :, :2], pull) * self.margin
            return np.nan_to_num(los, nan=math.inf, posinf=math.inf)
        by = self.craft.response(size, torque, rows).reshape(k, m, 2 + r, r)
        by = np.where((at < 0.0).reshape(k, m, 1, 1), by.conj(), by)
        pull = self._pull(frequency, by[:, :, 2:])
        los = np.abs(_by_torques(by[:, :, :2], pull))
        if not self.with_margins:
            return np.asarray(los)
        largest = _LEAST_PULL * np.abs(pull).max(axis=1, keepdims=True)
        least = np.where(self.orders == 0.0, 0.0, 1.0)[None, :, None, None] * largest
        beside = _by_torques(np.abs(by[:, :, :2]), least)
        return np.asarray(los * self.margin + beside)

    @cached_property
    def _coefficients(self) -> np.ndarray:
        """Springs, and dampings before and after the change of frequency, from order j to order k, each
        with all directions, (3, k r, k r).
        """
        k, r = self.orders.size, len(self.directions)
        chosen = np.ix_(self.directions, self.directions)
        none = np.zeros((3, r, r), dtype=complex)
        apart = np.round(np.subtract.outer(self.orders, self.orders), ORDER_DIGITS) + 0.0
        orders, place = np.unique(apart, return_inverse=True)
        each = [
            none if (one := self._all.get(m)) is None else np.array([part[chosen] for part in one])
            for m in orders.tolist()
        ]
        found = np.array(each)[place.reshape(k, k)]  # (k, k, 3, r, r)
        return found.transpose(2, 0, 3, 1, 4).reshape(3, k * r, k * r)

    def _mixing(self, frequency: np.ndarray) -> np.ndarray:
        """Stiffness from order j to order k of loads at frequencies (m,) [Hz], (m, k r, k r)."""
        omega = 2.0 * np.pi * (frequency[:, None] + self.orders * self.spring.frequency)
        r = len(self.directions)
        spring, before, after = self._coefficients
        each = 1j * np.repeat(omega, r, axis=1)
        found = np.repeat(spring[None], frequency.size, axis=0)
        if before.any():
            found += each[:, None, :] * before
        if after.any():
            found += each[:, :, None] * after
        rotor = r * np.arange(self.orders.size)  # it is the first of the directions
        found[:, rotor, rotor] += self._windings(omega)
        return found

    def _windings(self, omega: np.ndarray) -> np.ndarray:
        """Stiffness [N m/rad] that windings add on the rotor at ``omega`` [rad/s]."""
        return self.elements.windings(omega) * self.with_windings

    def _whole(self, mixing: np.ndarray, Y: np.ndarray, sign: float) -> np.ndarray:
        """Matrix of the harmonic balance, with motions by torques Y (k, m, r, r), (m, k r, k r)."""
        k, m, r, _ = Y.shape
        moved = sign * np.moveaxis(Y, 0, 1)[..., None] * mixing.reshape(m, k, 1, r, k * r)
        whole = moved[:, :, :, 0] if r == 1 else moved.sum(axis=3)
        whole = whole.reshape(m, k * r, k * r)
        each = np.arange(k * r)
        whole[:, each, each] += 1.0
        return np.asarray(whole)

    def _unit(self) -> np.ndarray:
        """Motion of order 0 in each direction by itself, (k r, r)."""
        r = len(self.directions)
        return np.kron((self.orders == 0.0).astype(float)[:, None], np.eye(r))

    def _pull(self, frequency: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """Torques along each direction [N m] at f + k f_e by a linear motion of 1 rad at f in each, with
        motions by torques Y (k, m, r, r), (m, k, r, r).

        At f the windings' own are left out: they act on whatever turns the rotor.
        """
        mixing, (k, m, r, _) = self._mixing(frequency), Y.shape
        unit = np.broadcast_to(self._unit().astype(complex), (m, k * r, r))
        q = np.linalg.solve(self._whole(mixing, Y, 1.0), unit)
        pull = (mixing @ q).reshape(m, k, r, r)
        zero = int(np.flatnonzero(self.orders == 0.0)[0])
        loop = self._windings(2.0 * np.pi * frequency)
        pull[:, zero, 0] -= (loop / (1.0 + loop * Y[zero, :, 0, 0]))[:, None] * (np.arange(r) == 0)
        return np.asarray(pull)

    def _pull_at_most(self, frequency: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """Bound on these where Y (k, m, r, r) is known at most: repeated mixing, each time with the worst
        phases; infinite where the series does not converge.
        """
        mixing, (k, m, r, _) = np.abs(self._mixing(frequency)), Y.shape
        known = np.where(np.isfinite(Y), Y, 0.0)
        unit = np.broadcast_to(self._unit(), (m, k * r, r))
        q = np.linalg.solve(self._whole(mixing, known, -1.0), unit)
        # of matrices without negative elements the series converges where no sum of it is negative
        bounded = np.all(q >= -_ROUNDING, axis=(1, 2)) & np.all(np.isfinite(Y), axis=(0, 2, 3))
        q = np.where(bounded[:, None, None], np.maximum(q, 0.0), 0.0)
        pull = (mixing @ q).reshape(m, k, r, r)
        return np.where(bounded[:, None, None, None], pull, math.inf)


def _by_torques(los: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Lines of sight (r, k, m, 2) by torques ``pull`` (m, k, r, r), of ``los`` (k, m, 2, r) by a unit of each."""
    return np.moveaxis(los @ np.moveaxis(pull, 1, 0), 3, 0)


def varying_drives(
    scenario: Scenario,
    craft: DriveStates,
    second: Scenario | None = None,
    sticking: tuple[Sticking, Sticking] = (SLIDES, SLIDES),
) -> list[VaryingDrive]:
    """Drives of a craft that turn and of which something varies.

    Parameters
    ----------
    scenario : Scenario
        The first drive on its craft; the second wing's counts where it steps.
    craft : DriveStates
        The same craft, with what is not known of its springs besides.
    second : Scenario, optional
        How the drive of the second wing steps, whatever the scenario says.
    sticking : pair of Sticking
        Shafts of the first drive and of the second that may stick, and their rates.
    """
    found = [
        VaryingDrive(craft, wing, elements)
        for wing, _, elements in sliding_elements(scenario, sticking, second)
    ]
    return [one for one in found if one.varies]


def unknown_drives(
    scenario: Scenario,
    sticking: tuple[Sticking, Sticking] = (SLIDES, SLIDES),
    second: Scenario | None = None,
) -> Iterator[tuple[int, str]]:
    """Why it is not known what drives that turn make of loads, each with the number of the drive;
    arguments as for ``varying_drives``.
    """
    names = {0: "the drive", 1: "the second wing's drive"}
    for wing, drive in enumerate([scenario, second or scenario.driven_wing]):
        if drive is None or drive.rate == 0.0 or spring_over_turn(drive) is not None:
            continue
        what = "changes its rate" if drive.rate is None else "cannot carry its friction"
        yield wing, f"{names[wing]} {what}, and what its spring makes of lines is not known"
    for wing, _, elements in sliding_elements(scenario, sticking, second):
        for why in elements.reasons:
            yield wing, why


_REMAINDER_MARGIN = 1.25
"""By how much motion by what is known by its size alone may be larger; assumed, as of friction that
sticks (``model.switching_friction``)."""
_LARGEST_GAIN = 0.99
"""Part of a motion that the torque of such a remainder may move and have a bound."""
_TRACE = 1e-6
"""Part of a motion below which such a remainder makes nothing that counts."""


@dataclass(frozen=True)
class RemainderOfDrive:
    """Part of an element that makes lines of loads at frequencies that are not known: a torque of no more
    than |K + j omega C| times the motion along its direction.
    """

    craft: DriveStates
    on: np.ndarray
    """Direction by the coordinates, (n,)."""
    remainder: Remainder
    wing: int
    """0 the first drive, 1 that of the second wing."""

    def torque(self, frequency: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """Amplitudes of the torque [N m] by amplitudes of linear motion [rad] at frequencies (m,) [Hz],
        (m, ...), what it moves itself included.
        """
        omega = 2.0 * np.pi * frequency.reshape(-1, *[1] * (motion.ndim - 1))
        return np.asarray(
            np.hypot(self.remainder.spring, omega * self.remainder.damping) * motion * self._gain
        )

    def motion(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Largest motion along its direction [rad] by ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), at frequencies (m,) [Hz], in any state, (m, c).
        """
        return np.asarray(self.craft.extremes(frequency, forces, rows=self.on[None, :])[1][:, 0])

    @cached_property
    def frequency(self) -> np.ndarray:
        """Frequencies [Hz] at which the response is looked at, ascending, (m,)."""
        return frequencies_of_response(self.craft.natural_frequencies)

    @cached_property
    def _largest(self) -> float:
        """Part of a motion that its torque moves, at most."""
        moved = self.motion(self.frequency, self.on[:, None])
        omega = 2.0 * np.pi * self.frequency[:, None]
        return float(
            np.max(np.hypot(self.remainder.spring, omega * self.remainder.damping) * moved)
        )

    @property
    def counts(self) -> bool:
        """Whether it makes anything that counts."""
        return self._largest > _TRACE

    @property
    def bounded(self) -> bool:
        """Whether what it makes has a bound: its torque moves less than what moved it (small gain)."""
        return self._largest < _LARGEST_GAIN

    @property
    def _gain(self) -> float:
        """Whole motion over the linear one at most."""
        return 1.0 / (1.0 - self._largest)

    @cached_property
    def _los(self) -> np.ndarray:
        return np.asarray(self.craft.extremes(self.frequency, self.on[:, None])[1][:, :, 0])

    def los(self, torque: float) -> np.ndarray:
        """Amplitude (m, 2) [rad] that a line at each frequency has at most by an amplitude of the torque,
        and above the root mean square of all such lines.
        """
        return _REMAINDER_MARGIN * torque * self._los


def remainders_of_drives(
    scenario: Scenario,
    craft: DriveStates,
    second: Scenario | None = None,
    sticking: tuple[Sticking, Sticking] = (SLIDES, SLIDES),
) -> list[RemainderOfDrive]:
    """Parts of the elements of the drives of a craft that make lines at frequencies that are not known; arguments as for
    ``varying_drives``.
    """
    found = []
    for wing, drive, elements in sliding_elements(scenario, sticking, second):
        directions = craft.on_rotor_of(wing)[:, 0], craft.on_output_of(wing, drive)[:, 0]
        found += [
            RemainderOfDrive(craft, directions[remainder.direction], remainder, wing)
            for remainder in elements.remainders
        ]
    return [one for one in found if one.counts]
