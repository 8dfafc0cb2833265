"""Side lines of a source: what drives that turn make of its lines and densities at other frequencies
(``model.side_lines``), for each requirement where it costs most.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Protocol, TypeVar

import numpy as np

from microvib.analysis.margins import CLOCK_UNCERTAINTY
from microvib.model.coupling import receiver_of, source_of
from microvib.model.drive_states import (
    MAY_STICK,
    DriveStates,
    Sticking,
    craft_of_drives,
)
from microvib.model.friction import Friction
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.model.side_lines import (
    SideResponse,
    VaryingDrive,
    remainders_of_drives,
    unknown_drives,
    varying_drives,
)
from microvib.model.switching_friction import (
    MotorSine,
    SwitchingFriction,
    drives_that_stand,
    drives_that_turn,
    frequencies_of_response,
    motor_sines,
)
from microvib.signals.pointing import Metric, mean_square_of_lines, windowed_amplitudes
from microvib.studies.budget.files import Requirement
from microvib.units import within_band

MAX_METRIC_GAIN: dict[Metric, float] = {
    "ape": 1.0, "mpe": 1.0, "rpe": 2.0, "smear": 1.31, "jitter": 3.31, "stability": 2.0, "pde": 2.0,
}  # fmt: skip
"""No amplitude in a window is larger than the line's own by more than this factor."""
MAX_METRIC_WEIGHT: dict[Metric, float] = {
    "ape": 1.0, "mpe": 1.0, "rpe": 1.0, "smear": 0.5705, "jitter": 1.0, "stability": 4.0, "pde": 4.0,
}  # fmt: skip
_AXES = {"x": [0], "y": [1], "radial": [0, 1]}
_OFFSETS = np.linspace(-1.0, 1.0, 17)
"""Parts of what a frequency may be off at which side lines are looked at."""
_OFFSET_SPACING = 2e-4
"""Relative distance of these for lines that are farther off than clocks; assumed."""
_COARSE = 0.05
"""Cycles of a metric's weight between neighbours of a grid, above which the largest weight counts."""
_INSTANTS = np.array([0.0, 0.5, 1.0])
_NEAR = np.sinh(np.linspace(-4.0, 4.0, 41))
"""Frequencies about a resonance, in half-widths, for densities."""
_MAIN = 12
"""Orders about whose resonances a density is refined."""
_UNBOUNDED = (
    "what varying elements of a drive make of the density at other frequencies has no bound"
)
_LARGEST_SWING = 0.35
"""Electrical angle [rad] by which loads may move a rotor and be taken for small: beyond, the sine of the
motor's torque makes other lines of them. The rotor's own motion by its steps is held to the same."""
_LARGEST_RATE = 0.2
"""Part of its commanded rate by which loads may change that of a shaft with dry friction; beyond, they
may turn it back within its own steps, and friction makes other lines of them. Assumed."""
_PEAKS = 4.0
"""Deviations of noise that count as its largest values."""
_RATES = 33
"""Rates at which the slope of a friction is taken."""
_MARGIN = 1.25
"""By how much motion may be larger than the linearised drives make it; assumed, as of friction that
sticks (``model.switching_friction``)."""
_LEAST_SHARE = 1e-4
"""Part of a linear line below which what comes beside it at its own frequency is left out."""


@dataclass(frozen=True)
class Anywhere:
    """Motion of the line of sight whose frequencies are not known."""

    why: str
    """Where it comes from, a sentence without a stop."""
    frequency: np.ndarray
    """Frequencies [Hz], ascending, (m,)."""
    most: np.ndarray
    """Amplitude [rad] that a line there has at most, (m, 2). All lines together have no larger mean
    square than one line has at the frequency where it costs most."""
    crest: float = 30.0
    """Times their root mean square that all together crest at most, but for what a metric makes of
    crests; as a rule some 450 lines of one size, assumed."""

    def times(self, factor: float) -> Anywhere:
        """With amplitudes times a factor."""
        return replace(self, most=factor * self.most)

    def crest_in(self, metric: Metric) -> float:
        """Crest over root mean square in a metric, at most."""
        return self.crest * MAX_METRIC_GAIN[metric]

    def largest(self, r: Requirement) -> float:
        """The most that it makes of a requirement's metric, as root mean square [rad]; of a curve
        as part of it.
        """
        at, squares = self._in_band(r)
        if not at.size:
            return 0.0
        if r.curve is not None:
            least = _over_neighbours(r.allowed.at(at), np.minimum)
            return float(np.max(np.sqrt(squares) / least, initial=0.0))
        window = r.window or r.apart or 1.0
        weight = mean_square_of_lines(r.metric, at, np.ones((at.size, 1)), window, r.apart)[:, 0]
        highest = 0.5 * MAX_METRIC_WEIGHT[r.metric]
        step = _over_neighbours(np.diff(at, append=at[-1]), np.maximum)
        coarse = step * max(window, r.apart or 0.0) > _COARSE
        weight = np.where(coarse, highest, _over_neighbours(weight, np.maximum))
        return math.sqrt(float(np.max(weight * squares, initial=0.0)))

    def _in_band(self, r: Requirement) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies of a requirement's band, its ends and points of its curve among them, (k,), and
        squares of the largest amplitudes about its axes next to these.
        """
        highest = max(self.frequency[-1], r.lowest) if r.highest is None else r.highest
        of_curve = [] if r.curve is None else [point.frequency for point in r.curve]
        low = max(r.lowest, min(self.frequency[0], highest))
        if r.curve is not None:
            low, highest = max(low, min(of_curve)), min(highest, max(of_curve))
        between = np.concatenate([self.frequency, of_curve])
        inside = between[(between > low) & (between < highest)]
        at = np.unique(np.concatenate([[low, highest], inside])) if low <= highest else np.zeros(0)
        squares = np.sum(self.most[:, _AXES[r.axis]] ** 2, axis=1)
        above = np.clip(np.searchsorted(self.frequency, at), 0, squares.size - 1)
        largest = np.maximum.reduce(
            [squares[np.clip(above + k, 0, squares.size - 1)] for k in (-2, -1, 0, 1)]
        )
        return at, largest


def _over_neighbours(values: np.ndarray, extreme: np.ufunc) -> np.ndarray:
    """Extreme of each value and those beside it."""
    padded = np.pad(values, 1, mode="edge")
    return np.asarray(extreme.reduce([padded[:-2], padded[1:-1], padded[2:]]))


@dataclass(frozen=True)
class SideLines:
    """Lines that may each be at one of several frequencies, and a density."""

    source: np.ndarray
    """Frequencies of the lines that they come from [Hz], (j, m)."""
    frequency: np.ndarray
    """Where they are then [Hz], (j, m)."""
    most: np.ndarray
    """Largest amplitudes [rad], (j, m, 2); infinite where nothing bounds them."""
    density: tuple[np.ndarray, np.ndarray] | None = None
    """Frequencies (n,) [Hz] and densities (n, 2) [rad^2/Hz] at most."""
    beside: tuple[np.ndarray, np.ndarray] | None = None
    """Densities of what comes at most beside the linear response at its own frequencies, as ``density``;
    it may take off as much."""
    unknown: tuple[str, ...] = ()
    """Why nothing is known, a sentence each."""
    anywhere: tuple[Anywhere, ...] = ()
    """Motion of which it is known how large it is, but not where."""
    unbounded: tuple[str, ...] = ()
    """Why infinite amplitudes have no bound, in words."""
    shafts: tuple[MovedShaft, ...] = ()
    """How far and fast the lines and densities that they come from move the shafts of the drives."""

    def worst(self, r: Requirement) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (j,) [Hz] and amplitudes (j, 2) [rad] that cost a requirement most."""
        if not self.frequency.size:
            return np.zeros(0), np.zeros((0, 2))
        highest = math.inf if r.highest is None else r.highest
        inside = within_band(self.frequency, r.lowest, highest) & (self.frequency > 0.0)
        most = np.where(inside[:, :, None], self.most, 0.0)
        cost, largest = self._cost(r, most)
        each = np.arange(len(cost))
        at = np.argmax(cost, axis=1)
        found = most[each, at]
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = np.sqrt(np.maximum(largest / cost[each, at], 1.0))
        rise = np.where(np.isfinite(rise), rise, 1.0)
        return self.frequency[each, at], found * rise[:, None]

    @property
    def at_source(self) -> np.ndarray:
        """Whether lines are of the frequency of those that they come from, (j,)."""
        return np.all(self.source == self.frequency, axis=1)

    def _cost(self, r: Requirement, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean squares that lines make (j, m), and the most between these (j,)."""
        f, axes = np.maximum(self.frequency, 1e-9), _AXES[r.axis]
        squares = np.sum(most[:, :, axes] ** 2, axis=2)
        if r.curve is not None:
            found = squares / r.allowed.at(f) ** 2
            return found, found.max(axis=1)
        window = r.window or r.apart or 1.0
        unit = np.ones(f.size)
        if r.statistic == "rms":
            weight = mean_square_of_lines(r.metric, f.ravel(), unit[:, None], window, r.apart)[:, 0]
            highest = 0.5 * MAX_METRIC_WEIGHT[r.metric]
        else:
            rows = windowed_amplitudes(r.metric, f.ravel(), unit, window, r.apart, _INSTANTS)
            weight, highest = np.max(np.abs(rows) ** 2, axis=0), MAX_METRIC_GAIN[r.metric] ** 2
        found = np.where(squares > 0.0, squares * weight.reshape(f.shape), 0.0)
        step = np.abs(np.diff(self.frequency, axis=1)).max(axis=1, initial=0.0)
        coarse = step * max(window, r.apart or 0.0) > _COARSE
        largest = np.where(coarse, highest * squares.max(axis=1), found.max(axis=1))
        return found, largest

    def joined(self, other: SideLines | None) -> SideLines:
        """Side lines of two sources, or of two drives."""
        if other is None:
            return self
        parts = self._padded(other), other._padded(self)
        densities = [x.density for x in (self, other) if x.density is not None]
        return SideLines(
            np.concatenate([one.source for one in parts]),
            np.concatenate([one.frequency for one in parts]),
            np.concatenate([one.most for one in parts]),
            _sum_of_densities(densities),
            _sum_of_densities([x.beside for x in (self, other) if x.beside is not None]),
            tuple(dict.fromkeys((*self.unknown, *other.unknown))),
            (*self.anywhere, *other.anywhere),
            tuple(dict.fromkeys((*self.unbounded, *other.unbounded))),
            (*self.shafts, *other.shafts),
        )

    def _padded(self, other: SideLines) -> SideLines:
        """With as many frequencies of each line as another, the last one repeated."""
        more = max(other.frequency.shape[1] - self.frequency.shape[1], 0)
        if not more:
            return self
        wide = ((0, 0), (0, more))
        return replace(
            self,
            source=np.pad(self.source, wide, mode="edge"),
            frequency=np.pad(self.frequency, wide, mode="edge"),
            most=np.pad(self.most, (*wide, (0, 0)), mode="edge"),
        )

    def times(self, factor: np.ndarray | float) -> SideLines:
        """With amplitudes times a factor, of all or of each line, (j,)."""
        of_density = float(np.max(factor, initial=1.0)) ** 2
        density, beside = (x and (x[0], x[1] * of_density) for x in (self.density, self.beside))
        each = np.broadcast_to(factor, (len(self.most),))[:, None, None]
        root = math.sqrt(of_density)
        return replace(
            self,
            most=self.most * each,
            density=density,
            beside=beside,
            anywhere=tuple(one.times(root) for one in self.anywhere),
            shafts=tuple(one.times(root) for one in self.shafts),
        )


def _sum_of_densities(
    densities: Sequence[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray] | None:
    if len(densities) < 2:
        return densities[0] if densities else None
    grid = np.unique(np.concatenate([f for f, _ in densities]))
    return grid, sum((_on_grid(grid, f, S) for f, S in densities), np.zeros((grid.size, 2)))


def _on_grid(grid: np.ndarray, f: np.ndarray, S: np.ndarray) -> np.ndarray:
    """A density (n, 2) at frequencies (n,), linear between them and 0 beyond, on another grid."""
    return np.array([np.interp(grid, f, column, left=0.0, right=0.0) for column in S.T]).T


@dataclass(frozen=True)
class Shaft:
    """A shaft of a drive, by its motion relative to what carries its drive."""

    craft: DriveStates
    on: np.ndarray
    """Its angle by the coordinates, (n,)."""
    name: str
    rate: float
    """Commanded rate [rad/s]; 0 of a drive that stands."""
    teeth: int
    """Electrical turns in one of its own; 0 of an output."""
    rubs: bool
    """Whether dry friction acts on it."""
    slowest: float = math.inf
    """Rate [rad/s] below which it is at no time without the loads; infinite where nobody looked."""
    wing: int = 0
    """0 the first drive's, 1 that of the second wing's."""
    sine: MotorSine | None = None
    """Torque of the motor on it."""
    friction: Friction | None = None
    """Friction whose slope changes with its rate, while it always slides."""

    def motion(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Largest motion [rad] by ``forces`` on the coordinates (n, c), or at each frequency (m, n, c),
        at frequencies (m,) [Hz], in any state, (m, c).
        """
        return self.craft.extremes(frequency, forces, rows=self.on[None, :])[1][:, 0]

    def beside(self, motion: float, speed: float, *, several: bool) -> Iterator[Anywhere]:
        """Motion that comes beside the linear response to loads of all sources, which move it so far [rad]
        and fast [rad/s], at frequencies that are not known.

        What the sine of its motor makes of each source is bounded there; of ``several`` together it is
        more.
        """
        if several and self.sine is not None:
            yield Anywhere(_OF_MOTOR, self.sine.frequency, self.sine.los(motion, motion))
        torque = 0.5 * self._change_of_slope(speed) * speed
        if torque > 0.0:
            yield Anywhere(_OF_SLOPE, self._frequency, _MARGIN * torque * self._los)

    def _change_of_slope(self, speed: float) -> float:
        """Change of the slope of its friction by a change of its rate [N m s/rad], at most."""
        if self.friction is None:
            return 0.0
        slowest = min(self.slowest, self.rate)
        least = min(1e-3 * self.rate, slowest)
        rates = np.linspace(slowest, 2.0 * self.rate - slowest, _RATES)
        slopes, *others = (
            np.array([self.friction.slope(max(x, least)) for x in (rates + part * speed).tolist()])
            for part in (0.0, -1.0, -0.5, 0.5, 1.0)
        )
        return float(np.max(np.abs(np.array(others) - slopes)))

    @cached_property
    def _frequency(self) -> np.ndarray:
        return frequencies_of_response(self.craft.natural_frequencies)

    @cached_property
    def _los(self) -> np.ndarray:
        """Largest line of sight at each frequency by 1 N m on it, (m, 2)."""
        return np.asarray(self.craft.extremes(self._frequency, self.on[:, None])[1][:, :, 0])

    def reason(self, motion: float, speed: float, whose: str = "its loads") -> str:
        """Reason why the response to loads that move it so far [rad] and fast [rad/s] is not linear; empty
        where it is.
        """
        if self.teeth * motion > _LARGEST_SWING:
            return (
                f"{whose} may swing {self.name} by {self.teeth * motion:.2g} rad of the electrical"
                " angle, of which the motor's torque is no linear function"
            )
        if self.rubs and speed > min(_LARGEST_RATE * self.rate, self.slowest):
            return (
                f"{whose} may change the rate of {self.name} by {speed / self.rate:.2g} times what is"
                " commanded and turn it back, and what friction makes of that is not known"
            )
        return ""


@dataclass(frozen=True)
class Teeth(Shaft):
    """Teeth of a gear with backlash, by its twist, that the load of a drive which turns keeps together."""

    stiffness: float = 0.0
    """[N m/rad]."""
    least: float = 0.0
    """Torque [N m] that the gear carries at all times."""

    def reason(self, motion: float, speed: float, whose: str = "its loads") -> str:
        """Reason as of a shaft."""
        if self.stiffness * motion <= self.least:
            return ""
        remedy = "reducer.backlash: 0" + (", or more friction on the output" if self.rate else "")
        return (
            f"{whose} may part the teeth of {self.name}, and what these make of them is not known"
            f" ({remedy})"
        )


@dataclass(frozen=True)
class StuckShaft(Shaft):
    """A shaft that stands and that friction holds until loads overcome it; its ``motion`` is the torque
    [N m] that holds it.

    Friction takes power from a motion that loads keep up. Loads of no more than its torque that does not
    depend on the rate, all together, cannot: the shaft then stays where it is, or comes to rest.
    """

    free: DriveStates | None = None
    """The craft on which it may turn."""
    holds: float = 0.0
    """Torque [N m] that it has at any rate."""
    largest: float = 0.0
    """Torque [N m] that it reaches at most."""

    def motion(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Largest torque [N m] that holds it against ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), at frequencies (m,) [Hz], in any state, (m, c).
        """
        return self.craft.lock_stiffness * super().motion(frequency, forces)

    def reason(self, motion: float, speed: float, whose: str = "its loads") -> str:
        """Nothing: what it makes has a bound."""
        return ""

    def beside(self, motion: float, speed: float, *, several: bool) -> Iterator[Anywhere]:
        """Motion by the torque of its friction, where loads may make it slide."""
        assert self.free is not None
        if _MARGIN * motion > self.holds:
            grid = frequencies_of_response(self.free.natural_frequencies)
            by_torque = self.free.extremes(grid, self.on[:, None])[1][:, :, 0]
            yield Anywhere(_OF_STANDING, grid, _MARGIN * math.sqrt(2.0) * self.largest * by_torque)


@dataclass(frozen=True)
class MovedShaft:
    """How far and fast the loads of a source move a shaft at most."""

    shaft: Shaft
    motion: float
    """[rad]."""
    speed: float
    """[rad/s]."""

    def times(self, factor: float) -> MovedShaft:
        """With motion times a factor."""
        return MovedShaft(self.shaft, factor * self.motion, factor * self.speed)


def _by_shaft(sides: Sequence[SideLines | None]) -> Iterator[tuple[list[MovedShaft], MovedShaft]]:
    """Each shaft as the sources move it, and as all of them together do."""
    by_name: dict[str, list[MovedShaft]] = {}
    for side in sides:
        for one in () if side is None else side.shafts:
            by_name.setdefault(one.shaft.name, []).append(one)
    for each in by_name.values():
        motion, speed = math.fsum(x.motion for x in each), math.fsum(x.speed for x in each)
        yield each, MovedShaft(each[0].shaft, motion, speed)


def reasons_together(sides: Sequence[SideLines | None]) -> tuple[str, ...]:
    """Why the response to the loads of all sources together is not linear, though that to each is, a
    sentence each; empty where it is.
    """
    found = []
    for each, total in _by_shaft(sides):
        if any(one.shaft.reason(one.motion, one.speed) for one in each):
            continue
        found.append(total.shaft.reason(total.motion, total.speed, "all sources together"))
    return tuple(why for why in found if why)


def anywhere_together(sides: Sequence[SideLines | None]) -> Iterator[Anywhere]:
    """Motion that all sources together make beside the linear response, at frequencies that are not
    known.
    """
    for each, total in _by_shaft(sides):
        yield from total.shaft.beside(total.motion, total.speed, several=len(each) > 1)


def _slowest(sticks: bool, rate: float) -> float:
    """Rate below which a shaft is at no time; of one that sticks its friction tells what loads make."""
    return math.inf if sticks else rate


def shafts_of(
    scenario: Scenario,
    craft: DriveStates,
    sticking: tuple[Sticking, Sticking],
    second: Scenario | None = None,
    names: tuple[str, str] = ("", " of the second wing"),
) -> list[Shaft]:
    """Shafts of the drives of a craft that turn at a constant rate, or stand; ``second`` is how the drive
    of the second wing steps, whatever the scenario says, and ``names`` tell their wings.
    """
    sines = {one.wing: one for one in motor_sines(scenario, craft, second)}
    found: list[Shaft] = []
    for wing, drive in drives_that_turn(scenario, second):
        rotor, output = (
            on[:, 0] for on in (craft.on_rotor_of(wing), craft.on_output_of(wing, drive))
        )
        rate, motor, stick, name = abs(drive.rate or 0.0), drive.motor, sticking[wing], names[wing]
        found += [
            Shaft(
                craft, rotor, f"the rotor{name}", rate * drive.reducer.ratio, motor.rotor_teeth,
                _rubs(motor.friction), _slowest(stick.rotor, stick.slowest_rotor), wing, sines[wing],
                _curved(motor.friction, stick.rotor),
            ),
            Shaft(
                craft, output, f"the output{name}", rate, 0, _rubs(drive.friction),
                _slowest(stick.output, stick.slowest_output), wing, None,
                _curved(drive.friction, stick.output),
            ),
        ]  # fmt: skip
        reducer, least = (
            drive.reducer,
            0.0 if stick.rates is None else stick.rates.least_gear_torque,
        )
        if reducer.backlash and least > 0.0:
            twist = -rotor / reducer.h - output
            found.append(
                Teeth(
                    craft, twist, f"the gear{name}", rate, 0, rubs=False, wing=wing,
                    stiffness=float(reducer.stiffness), least=least,
                )
            )  # fmt: skip
    for wing, drive in drives_that_stand(scenario, second):
        found += _shafts_that_stand(craft, wing, drive, sines[wing], names[wing])
    return found


def _shafts_that_stand(
    craft: DriveStates, wing: int, drive: Scenario, sine: MotorSine, name: str
) -> Iterator[Shaft]:
    """Shafts of a drive that is parked or holds: nothing keeps the teeth of its gear together."""
    rotor, output = craft.on_rotor_of(wing)[:, 0], craft.on_output_of(wing, drive)[:, 0]
    motor, reducer = drive.motor, drive.reducer
    yield Shaft(
        craft, rotor, f"the rotor{name}", 0.0, motor.rotor_teeth, rubs=False, wing=wing, sine=sine
    )
    dry = [
        (on, friction, which)
        for on, friction, which in (
            (rotor, motor.friction, f"friction of the rotor{name}"),
            (output, drive.friction, f"friction of the output{name}"),
        )
        if friction.largest_torque > 0.0 and not friction.memory
    ]
    held = replace(craft, locks=tuple(on for on, _, _ in dry))
    for on, friction, which in dry:
        always = 0.0 if friction.position is not None else friction.sliding_torque
        yield StuckShaft(
            held, on, which, 0.0, 0, rubs=False, wing=wing,
            free=craft, holds=always, largest=friction.largest_torque,
        )  # fmt: skip
    if reducer.backlash:
        twist = -rotor / reducer.h - output
        stiffness = float(reducer.stiffness)
        yield Teeth(
            craft, twist, f"the gear{name}", 0.0, 0, rubs=False, wing=wing, stiffness=stiffness
        )


def _curved(friction: Friction, sticks: bool) -> Friction | None:
    """Friction of a shaft that always slides, where its slope changes with the rate."""
    return None if sticks or friction.stribeck_torque == 0.0 else friction


def _rubs(friction: Friction) -> bool:
    return bool(friction.memory) or friction.largest_torque > 0.0


def _sums(each: Sequence[np.ndarray]) -> list[float]:
    """Sum over all lines for each shaft: their phases are not known."""
    return [float(np.sum(values)) for values in each]


def _peaks_of(f: np.ndarray, densities: Sequence[np.ndarray]) -> list[float]:
    """Largest values of noise with each of some densities (m,) over frequencies (m,)."""
    return [_PEAKS * math.sqrt(float(np.trapezoid(one, f))) for one in densities]


_OF_FRICTION = (
    "friction that sticks for a part of each step, or of a drive that holds and that a load makes slide,"
    " makes lines of these loads at frequencies that are not known (finer microsteps, microstep_ramp or a"
    " faster rate, with which shafts slide at all times; a higher lowest)"
)
_OF_FALLING_FRICTION = (
    "friction that sticks for a part of each step, or of a drive that holds and that a load makes slide,"
    " makes lines of these loads at frequencies that are not known, and as it falls with the rate, only a"
    " start in the steady state, of a drive that runs, bounds them closely"
    " (record.start: steady; finer microsteps, microstep_ramp or a faster rate, with which shafts slide"
    " at all times)"
)
_OF_STANDING = (
    "friction of a shaft that stands slides by these loads, and makes lines of them at frequencies that are"
    " not known (friction that holds the shaft, or a higher lowest)"
)
_OF_SLOPE = (
    "the slope of friction changes with the rate, which loads change, and makes lines of them at"
    " frequencies that are not known"
)
_OF_MOTOR = (
    "the motor's torque is a sine of its angle and makes lines of these loads at frequencies that are"
    " not known"
)


def _with_anywhere(lines: SideLines | None, anywhere: Sequence[Anywhere]) -> SideLines | None:
    """Side lines with motion at frequencies that are not known."""
    counts = tuple(one for one in anywhere if np.any(one.most))
    if not counts:
        return lines
    if lines is None:
        none = np.zeros((0, 1))
        return SideLines(none, none, np.zeros((0, 1, 2)), anywhere=counts)
    return replace(lines, anywhere=(*lines.anywhere, *counts))


_NEARLY_DOUBLES = (
    "the drive is near a doubling of its period, and loads may send it to another motion (finer"
    " microsteps, microstep_ramp or another rate)"
)
_FED_BY_FRICTION = (
    "friction that falls with the rate may feed a mode of the craft while a shaft is slow (finer"
    " microsteps, microstep_ramp or a faster rate)"
)


def _with_own_switching(craft: DriveStates) -> DriveStates:
    """A craft of whose frictions those of the first drive alone may stick and slide in turn."""
    own = receiver_of(craft.scenario).root.shape[1] + source_of(craft.scenario).M.shape[0]
    springs = [
        spring if np.any(spring.on[:own]) else replace(spring, switches=False)
        for spring in craft.springs
    ]
    return replace(craft, springs=tuple(springs))


def spread(frequency: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Frequencies [Hz] at which lines (k,) are looked at that may be ``off`` (k,) [Hz], (k, m): as near to each
    other, for those that are farthest off, as resonances are wide.
    """
    part = float(np.max(off / np.maximum(frequency, 1e-300), initial=0.0))
    number = max(_OFFSETS.size, 2 * math.ceil(part / _OFFSET_SPACING) + 1)
    return np.asarray(frequency[:, None] + off[:, None] * np.linspace(-1.0, 1.0, number))


def _largest_motion(one: Shaft | MotorSine, at: np.ndarray, each: np.ndarray) -> np.ndarray:
    """Largest motion [rad] of lines that may be at (k, m) [Hz] by forces ``each`` (k m, n, c), (k,)."""
    moved = one.motion(at.ravel(), each).sum(axis=1).reshape(at.shape)
    return np.asarray(moved.max(axis=1, initial=0.0))


class _OfWing(Protocol):
    """Something of the drive of a wing, by its number."""

    @property
    def wing(self) -> int:
        """0 the first drive, 1 that of the second wing."""
        ...


_Of = TypeVar("_Of", bound=_OfWing)


def _of_wings(wings: Sequence[int], each: Sequence[_Of]) -> list[_Of]:
    """Parts that belong to the drives of some wings."""
    return [one for one in each if one.wing in wings]


class TurningDrives:
    """Drives of a craft that turn and of which something varies: what they make of lines and densities."""

    def __init__(
        self,
        scenario: Scenario,
        sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
        *,
        second: Scenario | None = None,
        second_name: str = " of the second wing",
        friction: DriveStates | None = None,
        other_steps: bool = False,
    ) -> None:
        """Drives of a ``scenario``, of which ``sticking`` tells the shafts that may stick; or the second
        drive alone, where ``second`` tells how that steps, with the name of its wing. ``friction`` is the
        craft with the frictions that sources act on, where that is another. Of a scenario that holds a second
        wing whose drive steps as ``other_steps`` says, the first drive alone.
        """
        self.scenario = scenario
        alone, names = second is not None, ("", second_name)
        self.craft = craft_of_drives(scenario, sticking, second, own=not alone)
        given = scenario, self.craft, second, sticking

        wings = (1,) if alone else (0, 1)
        if other_steps:
            wings, friction = (0,), _with_own_switching(self.craft)
        self.drives = _of_wings(wings, varying_drives(*given))
        self.sines = _of_wings(wings, motor_sines(scenario, self.craft, second))
        self.shafts = _of_wings(wings, shafts_of(scenario, self.craft, sticking, second, names))
        remainders = _of_wings(wings, remainders_of_drives(*given))
        self.remainders = [one for one in remainders if one.bounded]
        self.unknown = (
            *(why for wing, why in unknown_drives(scenario, sticking, second) if wing in wings),
            *((_FED_BY_FRICTION,) if self.craft.feeds_a_mode else ()),
            *(one.remainder.why for one in remainders if not one.bounded),
            *(_NEARLY_DOUBLES for one in self.drives if one.nearly_doubles),
        )
        self.friction = SwitchingFriction(self.craft if friction is None else friction)
        self._last: dict[int, tuple[np.ndarray, SideResponse]] = {}

    @property
    def acts(self) -> bool:
        """Whether anything is, or may be, made of loads."""
        each = self.drives, self.remainders, self.sines, self.unknown, self.friction.switches
        return any(map(bool, each))

    def norm(self, frequency: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Norm of lines at frequencies (m,) [Hz] by ``forces`` on the coordinates (n, c), or at each
        frequency (m, n, c), of unknown phases, for ``model.switching_friction``, (m,).
        """
        if not self.friction.switches:
            return np.zeros(frequency.size)
        return np.asarray(self.friction.norm_of_forces(frequency, forces).sum(axis=1))

    def anywhere(
        self,
        norm: float,
        swings: Sequence[float],
        peaks: Sequence[float],
        torques: Sequence[float],
    ) -> tuple[Anywhere, ...]:
        """Motion that friction which sticks makes of loads of a ``norm``, the sine of each motor of loads that
        swing its rotor by root mean squares ``swings`` and ``peaks`` [rad] at most, and each remainder by
        amplitudes of its torque [N m].
        """
        found = []
        if norm > 0.0:
            grid = self.friction.frequency
            why = _OF_FRICTION
            if math.isinf(self.friction.by_energy):
                why = _OF_FALLING_FRICTION
            found.append(Anywhere(why, grid, self.friction.los(norm)))
        for one, swing, peak in zip(self.sines, swings, peaks, strict=True):
            crest = peak / max(swing, 1e-300)
            found.append(Anywhere(_OF_MOTOR, one.frequency, one.los(swing, peak), crest))
        for beyond, torque in zip(self.remainders, torques, strict=True):
            found.append(Anywhere(beyond.remainder.why, beyond.frequency, beyond.los(torque)))
        return tuple(found)

    def of_held(
        self,
        frequency: np.ndarray,
        elongation: Callable[[np.ndarray], np.ndarray],
        norm: float,
    ) -> SideLines | None:
        """Lines that a drive which holds the second wing makes of lines (k,) [Hz] of a ``norm``, which move
        what is along a row (n,) of its coordinates by a complex ``elongation`` (k,) [rad].
        """
        stuck = [x for x in self.shafts if isinstance(x, StuckShaft) and x.wing == 1]
        torques = dict(
            zip([x.name for x in stuck], self._holding(stuck, frequency, elongation), strict=True)
        )
        none = np.zeros(frequency.size)
        moved = {x.name: np.abs(elongation(x.on)) for x in self.shafts if x.wing == 1} | torques
        shafts = [moved.get(x.name, none) for x in self.shafts]
        speeds = [2.0 * np.pi * frequency * u for u in shafts]
        found = self._with_shafts(None, _sums(shafts), _sums(speeds))
        swings = [
            float(np.sum(np.abs(elongation(x.on)))) if x.wing == 1 else 0.0 for x in self.sines
        ]
        remainders = [0.0] * len(self.remainders)
        return _with_anywhere(found, self.anywhere(norm, swings, swings, remainders))

    def _holding(
        self,
        stuck: Sequence[StuckShaft],
        frequency: np.ndarray,
        elongation: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Torques [N m] that hold shafts which lines move, if they are free, by an ``elongation``, (e, k)."""
        if not stuck:
            return np.zeros((0, frequency.size))
        on = np.array([x.on for x in stuck])
        moved = np.array([elongation(row) for row in on]).T[:, :, None]
        return np.abs(np.linalg.solve(self.craft.response(frequency, on.T, on), moved)[:, :, 0]).T

    def of_lines(
        self, frequency: np.ndarray, forces: np.ndarray, off: np.ndarray | None = None
    ) -> SideLines | None:
        """Side lines of lines at frequencies (k,) [Hz] by ``forces`` (k, n, c) on the coordinates,
        whose c parts have unknown phases; these may be ``off`` (k,) [Hz], or by their clocks.
        """
        at = self._spread(frequency) if off is None else spread(frequency, off)
        each = np.repeat(forces, at.shape[1], axis=0)
        found = self._of(at, self._on(at, each))
        motions = [_largest_motion(one, at, each) for one in self.shafts]
        speeds = [2.0 * np.pi * at.max(axis=1, initial=0.0) * u for u in motions]
        found = self._with_shafts(found, _sums(motions), _sums(speeds))
        return _with_anywhere(found, self._of_all_lines(at, each))

    def _of_all_lines(self, at: np.ndarray, each: np.ndarray) -> tuple[Anywhere, ...]:
        """Motion that friction and motors make of lines at frequencies that are not known: of those that
        may be at (k, m) [Hz] by forces ``each`` (k m, n, c).
        """
        norms = self.norm(at.ravel(), each).reshape(at.shape).max(axis=1, initial=0.0)
        swings = [_largest_motion(one, at, each) for one in self.sines]
        peaks = [float(np.sum(u)) for u in swings]
        torques = [
            float(one.torque(at.ravel(), one.motion(at.ravel(), each)).sum(axis=1).reshape(at.shape).max(axis=1, initial=0.0).sum())
            for one in self.remainders
        ]  # fmt: skip
        # lines of one frequency may be of one phase: no more than the sum of amplitudes
        return self.anywhere(float(np.sum(norms)), peaks, peaks, torques)

    def _with_shafts(
        self, lines: SideLines | None, motions: Sequence[float], speeds: Sequence[float]
    ) -> SideLines | None:
        """Side lines of loads that move the shafts so far [rad] and fast [rad/s], with why the response to
        them is not linear, where it is not.
        """
        moved = tuple(
            MovedShaft(one, u, v)
            for one, u, v in zip(self.shafts, motions, speeds, strict=True)
            if u > 0.0
        )
        if not moved:
            return lines
        none = np.zeros((0, 1))
        found = lines or SideLines(none, none, np.zeros((0, 1, 2)))
        reasons = [one.shaft.reason(one.motion, one.speed) for one in moved]
        unknown = (*found.unknown, *(why for why in reasons if why))
        return replace(found, unknown=unknown, shafts=moved)

    def _spread(self, frequency: np.ndarray) -> np.ndarray:
        """Frequencies that lines (k,) may have, (k, m)."""
        return spread(frequency, CLOCK_UNCERTAINTY * frequency)

    def _on(self, at: np.ndarray, each: np.ndarray) -> list[np.ndarray]:
        """Motion of each drive in its directions (r, k, m) by forces (k m, n, c) at frequencies (k, m)."""
        moved = [one.motion(at.ravel(), each).sum(axis=2).T for one in self.drives]
        return [u.reshape(len(u), *at.shape) for u in moved]

    def of_motion(
        self,
        frequency: np.ndarray,
        motion: Callable[[np.ndarray], np.ndarray],
        norm: float,
    ) -> SideLines | None:
        """Side lines of lines (k,) [Hz] that have a ``norm`` and move what is along rows (r, n) of the
        coordinates by ``motion`` (r, k) [rad].
        """
        at = self._spread(frequency)
        moved = [motion(one.on) for one in self.drives]
        found = self._of(at, [np.repeat(u[:, :, None], at.shape[1], axis=2) for u in moved])
        shafts = [motion(one.on[None, :])[0] for one in self.shafts]
        speeds = [2.0 * np.pi * frequency * u for u in shafts]
        found = self._with_shafts(found, _sums(shafts), _sums(speeds))
        swings = [float(np.sum(motion(one.on[None, :]))) for one in self.sines]
        torques = [float(np.sum(one.torque(frequency, motion(one.on[None, :])[0]))) for one in self.remainders]  # fmt: skip
        return _with_anywhere(found, self.anywhere(norm, swings, swings, torques))

    def of_sweep(
        self,
        grid: np.ndarray,
        motions: Sequence[np.ndarray],
        shafts: Sequence[np.ndarray],
        anywhere: tuple[Anywhere, ...] = (),
    ) -> SideLines | None:
        """Side lines of lines that pass a grid (m,) [Hz], and move each drive in its directions by (r, o,
        m) [rad], and its shafts; without what comes beside them at their own frequencies (``beside``),
        and with what is found ``anywhere``.
        """
        furthest = [float(u.max(axis=1).sum()) for u in shafts]
        fastest = [float((2.0 * np.pi * grid * u).max(axis=1).sum()) for u in shafts]
        if motions:
            lines = self._of(np.tile(grid, (motions[0].shape[1], 1)), list(motions), own=False)
        else:
            lines = self._of(np.zeros((0, grid.size)), [])
        return _with_anywhere(self._with_shafts(lines, furthest, fastest), anywhere)

    def beside(self, grid: np.ndarray, motions: Sequence[np.ndarray]) -> np.ndarray:
        """Amplitudes that come at most beside the linear response at their own frequencies, (o, m, 2) [rad]."""
        found = np.zeros((motions[0].shape[1], grid.size, 2))
        for one, u in zip(self.drives, motions, strict=True):
            response = self._response(one, grid)
            of_own = response.los[:, response.orders == 0][:, 0]
            found += np.einsum("rmx,rom->omx", of_own, u)
        return found

    def _response(self, one: VaryingDrive, frequency: np.ndarray) -> SideResponse:
        """Response of a drive, kept until another grid is asked for."""
        last = self._last.get(one.wing)
        if last is None or not np.array_equal(last[0], frequency):
            last = frequency, one.response(frequency)
            self._last[one.wing] = last
        return last[1]

    def _of(
        self, at: np.ndarray, motions: Sequence[np.ndarray], *, own: bool = True
    ) -> SideLines | None:
        k, m = at.shape
        none = SideLines(np.zeros((0, m)), np.zeros((0, m)), np.zeros((0, m, 2)))
        found = replace(none, unknown=self.unknown)
        each, back = np.unique(at.ravel(), return_inverse=True)
        for one, u in zip(self.drives, motions, strict=True):
            response = self._response(one, each)
            kept = np.ones(response.orders.size, dtype=bool) if own else response.orders != 0
            count = int(kept.sum())
            los = np.zeros((count, k, m, 2))
            for by, moved in zip(response.los[:, kept], u, strict=True):
                with np.errstate(invalid="ignore"):
                    los += by[:, back].reshape(count, k, m, 2) * moved[None, :, :, None]
            at_most = np.nan_to_num(los, nan=math.inf, posinf=math.inf)
            at_side = response.frequency[kept][:, back].reshape(count, k, m)
            source = np.broadcast_to(at, at_side.shape)
            shape = (count * k, m)
            lines = SideLines(source.reshape(shape), at_side.reshape(shape), at_most.reshape(*shape, 2))  # fmt: skip
            found = found.joined(lines)
        if not found.unknown and not found.frequency.size:
            return None
        return replace(found, unbounded=self._unbounded)

    @property
    def _unbounded(self) -> tuple[str, ...]:
        """Why what drives make has no bound, each once."""
        return tuple(dict.fromkeys(why for one in self.drives if (why := one.unbounded)))

    def of_density(
        self, f: np.ndarray, S: np.ndarray, forces: np.ndarray, linear: np.ndarray
    ) -> SideLines | None:
        """Side density of densities (m, c) at frequencies (m,) [Hz] of ``forces`` (n, c) on the
        coordinates, which make ``linear`` (m, 2) [rad^2/Hz] at their own frequencies.
        """
        moved = [one.motion(f, forces) * np.sqrt(S) for one in self.shafts]
        squares = [np.sum(u, axis=1) ** 2 for u in moved]
        speeds = [(2.0 * np.pi * f) ** 2 * u for u in squares]
        strong = _peaks_of(f, squares), _peaks_of(f, speeds)
        anywhere = self._of_noise(f, S, forces)
        if not self.drives:
            lines = self._with_shafts(self._of(np.zeros((0, 1)), []), *strong)
            return _with_anywhere(lines, anywhere)
        parts = [x for one in self.drives for x in self._density(one, f, S, forces, linear)]
        bounded = [part for part in parts if np.all(np.isfinite(part[1]))]
        unknown = self.unknown
        if len(bounded) < len(parts):
            unknown = (*unknown, "; ".join((_UNBOUNDED, *self._unbounded)))
        none = np.zeros((0, 1))
        density = _sum_of_densities(bounded)
        beside = _sum_of_densities([x for one in self.drives for x in self._beside_density(one, f, S, forces)])  # fmt: skip
        found = SideLines(none, none, np.zeros((0, 1, 2)), density, beside, unknown)
        return _with_anywhere(self._with_shafts(found, *strong), anywhere)

    def _of_noise(self, f: np.ndarray, S: np.ndarray, forces: np.ndarray) -> tuple[Anywhere, ...]:
        """Motion that friction and motors make of densities (m, c) at frequencies (m,) [Hz] of ``forces`` (n, c),
        at frequencies that are not known.
        """
        size = np.sqrt(S)
        norm = 0.0
        if self.friction.switches:
            grid = np.union1d(f, self.friction.frequency)
            grid = grid[(grid >= max(f[0], 1e-6)) & (grid <= f[-1])]
            each = np.array([np.interp(grid, f, column) for column in size.T]).T
            of_all = np.sum(self.friction.norm_of_forces(grid, forces) * each, axis=1) ** 2
            norm = math.sqrt(2.0 * float(np.trapezoid(of_all, grid)))  # as that of an amplitude
        squares = [np.sum(one.motion(f, forces) * size, axis=1) ** 2 for one in self.sines]
        swings = [math.sqrt(float(np.trapezoid(one, f))) for one in squares]
        torques = [
            math.sqrt(2.0 * float(np.trapezoid(np.sum(one.torque(f, one.motion(f, forces) * size), axis=1) ** 2, f)))
            for one in self.remainders
        ]  # fmt: skip
        return self.anywhere(norm, swings, [_PEAKS * u for u in swings], torques)

    def _density(
        self,
        one: VaryingDrive,
        f: np.ndarray,
        S: np.ndarray,
        forces: np.ndarray,
        linear: np.ndarray,
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        grid = self._grid(one, f)
        given = np.array([np.interp(grid, f, column) for column in S.T]).T
        own = _on_grid(grid, f, linear)
        size = np.sqrt(given)[:, None, :]
        moved = np.sum(
            one.motion(grid, forces) * size, axis=2
        )  # of one cause they add as amplitudes
        response, found = one.response(grid), []
        each = response.of_motion(moved.T)
        for order, los in zip(response.orders.tolist(), each, strict=True):
            if order == 0 and one.craft.springs:
                continue  # a change of the spring, which its largest response over all springs has
            side = los**2
            if order == 0:
                side = side + 2.0 * np.sqrt(side * own)
            at = grid + order * response.electrical
            for part in (at > 0.0, at < 0.0):
                if np.count_nonzero(part) > 1:
                    way = np.argsort(np.abs(at[part]))
                    found.append((np.abs(at[part])[way], side[part][way]))
        return found

    def _beside_density(
        self, one: VaryingDrive, f: np.ndarray, S: np.ndarray, forces: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Density that comes at most beside the linear response at its own frequencies."""
        if one.craft.springs:
            return []
        moved = np.sum(one.motion(f, forces) * np.sqrt(S)[:, None, :], axis=2)
        response = self._response(one, f)
        los = response.of_motion(moved.T)[response.orders == 0][0]
        return [(f, np.nan_to_num(los**2, posinf=math.inf))]

    def _grid(self, one: VaryingDrive, f: np.ndarray) -> np.ndarray:
        """Frequencies [Hz] of a density that resolve resonances, where they are and where side lines
        meet them.
        """
        modes = [(m.frequency, m.frequency * max(m.damping, 1e-5)) for m in coupled_modes(self.scenario)]  # fmt: skip
        near = np.concatenate([f0 + width * _NEAR for f0, width in modes] or [np.zeros(0)])
        main = one.orders[np.argsort(np.abs(one.orders))[:_MAIN]] * one.spring.frequency
        met = np.concatenate([near - main[:, None], -near - main[:, None]], axis=None)
        grid = np.union1d(f, np.concatenate([near, met]))
        return grid[(grid >= max(f[0], 1e-6)) & (grid <= f[-1])]


@lru_cache(maxsize=4)
def turning_drives(scenario: Scenario, sticking: tuple[Sticking, Sticking]) -> TurningDrives:
    """Drives of a scenario's craft that turn, which every other source of a budget acts on."""
    return TurningDrives(scenario, sticking)
