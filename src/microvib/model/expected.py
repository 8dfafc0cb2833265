"""Which lines the physics predicts in the disturbance torque, and where."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Literal

import numpy as np

from microvib.model.driver import Driver, Imperfections, references_over_electrical_period
from microvib.model.line_names import DRIVE, ELECTRICAL, FULL_STEP, LineName, driving_line
from microvib.model.linear import coupled_modes
from microvib.model.motor import Motor
from microvib.model.reducer import KinematicError
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.units import GivenQuantity, quantity

Kind = Literal[
    "array mode",
    "drive",
    "full step",
    "electrical",
    "wave generator",
    "gear train",
    "sideband",
    "other",
]

SPREAD = "spread by compensation"
"""Words in the origin of a line that ``driver.compensation`` makes into many, closely together."""
_SAME_LINE = 1e-6
"""Part by which frequencies of one line may differ."""
SIDEBANDS = 2  # sidebands on each side of a driving line, at full-step distance, that are expected


class LineKindProperties:
    """Properties of a line by its kind, expected or found."""

    kind: str

    @property
    def is_mode(self) -> bool:
        """Whether it is an array mode as seen through the drive."""
        return self.kind == "array mode"

    @property
    def of_clock(self) -> bool:
        """Whether the step clock makes it; modes, and what is not expected, have frequencies of
        their own.
        """
        return self.kind not in ("array mode", "other")


@dataclass(frozen=True)
class ExpectedLine(LineKindProperties):
    """An expected line: its name, its frequency and the band to search [Hz]."""

    name: str
    kind: Kind
    frequency: float
    low: float
    high: float
    origin: str
    decay: float = 0.0
    """Decay rate [1/s] of a mode by the linearised drive; 0 for what the step clock makes."""


def expected_lines(
    scenario: GivenScenario,
    highest: GivenQuantity,
    harmonics: int = 8,
    clock_tolerance: float = 0.0,
    mode_tolerance: float = 0.0,
) -> tuple[ExpectedLine, ...]:
    """List the lines that the physics predicts: array modes as seen through the drive, and all that
    the step clock makes.

    Of the clock there are, each with up to ``harmonics`` members: the driving frequency f_d (Eq.
    26); the detent period 4 f_d/(b n), of three phases 6 f_d/(b n), of five 10 f_d/(b n), which is
    the full-step rate f_d/n where b is that number; the electrical period f_d/(b n); the wave
    generator's turns, for each transmission-error harmonic; and the sidebands that the detent
    torque makes about the driving lines. A frequency that belongs to several families carries the
    name of the first. Of the electrical period an ideal driver has no lines, and three are listed;
    one with errors has ``harmonics``, and the origin says which error makes a line. Where the rate
    changes within the record, or is zero, there are modes only.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive: a scenario, a name of the catalog, or the path of a scenario file.
    highest : str or Si
        Frequency up to which lines are listed, such as ``"500 Hz"``.
    harmonics : int
        Members of each family.
    clock_tolerance, mode_tolerance : float
        Fractions of the frequency by which the bands that are searched are widened: zero for a
        simulation, whose clock is known, a per cent for a test.

    Returns
    -------
    tuple of ExpectedLine
        Name, kind, frequency and band to search [Hz], and origin of each.

    Raises
    ------
    OptionError
        For a frequency without a unit.
    ScenarioError
        Where a name stands for no scenario.
    """
    scenario = as_scenario(scenario)
    highest = quantity("highest", highest, "Hz")
    modes = [
        replace(
            line, low=line.low * (1.0 - mode_tolerance), high=line.high * (1.0 + mode_tolerance)
        )
        for line in _array_lines(scenario, highest)
    ]
    f_d = scenario.driving_frequency
    if not f_d:
        return tuple(modes)
    driver, motor = scenario.driver, scenario.motor
    errors = tuple(e._replace(phase=0.0) for e in scenario.rotor_harmonics)
    turn, orders = _orders(driver, motor, errors, harmonics)
    base, low, high = f_d / turn, 1.0 - clock_tolerance, 1.0 + clock_tolerance
    clock = [
        ExpectedLine(
            name,
            kind,
            float(order) * base,
            low * (float(order) * base),
            high * (float(order) * base),
            origin,
        )
        for order, (name, kind, origin) in orders.items()
        if float(order) * base <= highest
    ]
    return (*modes, *clock)


def distance_to_clock_line(scenario: Scenario, frequency: float, tolerance: float = 0.0) -> float:
    """Distance [Hz] from a ``frequency`` [Hz], known to within ``tolerance`` [Hz], to the nearest line that
    the step clock can make, of any order, but one at that frequency; infinite without a clock.
    """
    f_d = scenario.driving_frequency
    if not f_d:
        return math.inf
    driver, motor = scenario.driver, scenario.motor
    electrical = f_d / (driver.beats * driver.microsteps)
    combs = [f_d]
    if motor.torque_comb is not None:
        combs.append(electrical * motor.torque_comb)
    if driver.distorted:
        combs.append(electrical)
    rotor = electrical / motor.rotor_teeth
    distances = [abs(float(e.order) * rotor - frequency) for e in scenario.rotor_harmonics]
    for comb in combs:
        off = abs(frequency - round(frequency / comb) * comb)
        distances += [off, comb - off]
    same = max(tolerance, _SAME_LINE * frequency)
    return min((d for d in distances if d > same), default=math.inf)


def is_made(name: str, scenario: Scenario) -> bool:
    """Whether anything in a drive makes a line of a name: all but those of the electrical period at orders
    that neither the references nor the torques of the motor have, where no backlash locks a mode to them.
    """
    line = LineName.parse(name)
    driver, motor = scenario.driver, scenario.motor
    if line.family != ELECTRICAL or scenario.reducer.backlash:
        return True
    errors = (error.order for error in angle_errors(driver, motor.phases))
    comb = math.gcd(motor.full_steps, *motor.torque_orders, *errors)
    return driver.compensates or line.order % comb == 0


@lru_cache(maxsize=64)
def _orders(
    driver: Driver, motor: Motor, errors: tuple[KinematicError, ...], harmonics: int
) -> tuple[int, dict[Fraction | int, tuple[str, Kind, str]]]:
    """Microsteps per turn of the rotor; and name, kind and origin of the line of each order of such
    a turn, a whole one but of gear trains, that of the first family where several have it."""
    turn = driver.beats * driver.microsteps * motor.rotor_teeth
    orders: dict[Fraction | int, tuple[str, Kind, str]] = {}
    for order, line in (
        *_family_lines(driver, motor, turn, harmonics),
        *_error_lines(errors),
        *_side_lines(motor, turn, harmonics),
    ):
        orders.setdefault(order, line)
    return turn, orders


_Family = tuple[str, Kind, int, Sequence[int], str]
"""Stem of the names, kind, cycles per turn of the first member, members, and what makes them."""
_OrderLine = tuple[Fraction | int, tuple[str, Kind, str]]
"""Order per turn of the rotor, with name, kind and origin of its line."""


def _families(driver: Driver, motor: Motor, turn: int, harmonics: int) -> list[_Family]:
    """Families of lines of the steps, of the full steps and of the electrical period."""
    z, steps, members = motor.rotor_teeth, motor.full_steps, range(1, harmonics + 1)
    uneven = driver.distorted or any(order % steps for order in motor.torque_orders)
    electrical = members if uneven else range(1, 4)
    full_step = "full step" if driver.beats == steps else "detent period"
    return [
        (DRIVE, "drive", turn, members, "microstep"),
        (FULL_STEP, "full step", steps * z, members, full_step),
        (ELECTRICAL, "electrical", z, electrical, "electrical period"),
        *_motor_families(motor, harmonics),
    ]


def _family_lines(driver: Driver, motor: Motor, turn: int, harmonics: int) -> Iterator[_OrderLine]:
    """Lines of all families, each with what is known to make it."""
    makers = {error.order: error.causes for error in angle_errors(driver, motor.phases)}
    for order, causes in _motor_makers(motor).items():
        makers[order] = (*makers.get(order, ()), *causes)
    everywhere = (SPREAD,) if driver.compensates else ()
    for stem, kind, unit, members, origin in _families(driver, motor, turn, harmonics):
        for k in members:
            own = makers.get(k * unit // motor.rotor_teeth, ()) if stem != DRIVE else ()
            made = ", ".join((*own, *everywhere))
            whole = f"{origin}, order {k}: {made}" if made else f"{origin}, order {k}"
            yield k * unit, (str(LineName(stem, k)), kind, whole)


def _error_lines(errors: tuple[KinematicError, ...]) -> Iterator[_OrderLine]:
    """Lines of the kinematic errors of gear and wave generator."""
    for error in errors:
        kind: Kind = "wave generator" if error.line.startswith("wave_generator") else "gear train"
        yield error.order, (error.line, kind, f"{error.cause}, {error.origin}")


def _side_lines(motor: Motor, turn: int, harmonics: int) -> Iterator[_OrderLine]:
    """Side lines of the driving lines, a full step's frequency apart."""
    side = motor.side_line_order
    if side is None or turn <= 2 * SIDEBANDS * side * motor.rotor_teeth:
        return
    for k in range(1, harmonics + 1):
        for j in (j for m in range(1, SIDEBANDS + 1) for j in (-m, m)):
            name, origin = (
                str(LineName(DRIVE, k, sideband=j)),
                f"{driving_line(k)} {j:+d} full step",
            )
            yield k * turn + j * side * motor.rotor_teeth, (name, "sideband", origin)


def _motor_makers(motor: Motor) -> dict[int, tuple[str, ...]]:
    """Flux harmonics and further harmonics of the detent torque, by the cycles per electrical turn
    of the torque that they make.
    """
    makers: dict[int, tuple[str, ...]] = {}
    made = [(h.torque_order, f"flux harmonic {h.order}") for h in motor.axis_flux_harmonics]
    made += [(h.order, f"detent harmonic {h.order}") for h in motor.detent if h.amplitude]
    for order, cause in made:
        makers[order] = (*makers.get(order, ()), cause)
    return makers


def _motor_families(
    motor: Motor, harmonics: int
) -> list[tuple[str, Kind, int, Sequence[int], str]]:
    """Families of those torques of the motor that lie beyond the members of the others."""
    z, steps = motor.rotor_teeth, motor.full_steps
    families: list[tuple[str, Kind, int, Sequence[int], str]] = []
    for order in _motor_makers(motor):
        times, rest = divmod(order, steps)
        if rest and order > harmonics:
            families.append((ELECTRICAL, "electrical", z, (order,), "electrical period"))
        elif not rest and times > harmonics:
            families.append((FULL_STEP, "full step", steps * z, (times,), "detent period"))
    return families


@dataclass(frozen=True)
class AngleError:
    """A harmonic of the electrical angle of a driver's references, less theta_e."""

    order: int
    """Cycles per electrical turn."""
    amplitude: float
    """Electrical angle [rad]."""
    causes: tuple[str, ...]
    """Keys under ``driver`` of what makes it."""


def angle_errors(driver: Driver, phases: int = 2) -> tuple[AngleError, ...]:
    """Harmonics of the angle error of a driver's references, from order 1 to half a turn's
    microsteps; none for an ideal one.

    Those below a hundredth of the largest are left out. Each is given the causes that make at least
    a tenth of it when they act alone.
    """
    if not driver.distorted:
        return ()
    size, alone = (
        _angle_error(driver, phases),
        {key: _angle_error(one, phases) for key, one in _single_causes(driver)},
    )
    told = [k for k in range(1, size.size) if size[k] > max(0.01 * np.max(size[1:]), 1e-9)]
    return tuple(
        AngleError(
            k, float(size[k]), tuple(key for key, own in alone.items() if own[k] > 0.1 * size[k])
        )
        for k in told
    )


def _angle_error(driver: Driver, phases: int) -> np.ndarray:
    """Amplitudes of the angle error's harmonics, (b n // 2 + 1,) [rad]."""
    turn = references_over_electrical_period(driver, 1.0, phases)
    n = len(turn)
    vector = (turn[:, 0] + 1j * turn[:, 1]) * np.exp(-2j * math.pi * np.arange(n) / n)
    amplitudes: np.ndarray = np.abs(np.fft.rfft(np.angle(vector))) * (2.0 / n)
    return amplitudes


def _single_causes(driver: Driver) -> Iterator[tuple[str, Driver]]:
    """Each of a driver's errors, with a driver that has it alone."""
    none = {"imperfections": Imperfections(), "table": None}
    if driver.table is not None:
        yield "table", driver.model_copy(update=none | {"table": driver.table})
    for name, default in Imperfections():
        value = getattr(driver.imperfections, name)
        if value != default:
            yield (
                name,
                driver.model_copy(
                    update=none
                    | {"imperfections": Imperfections().model_copy(update={name: value})}
                ),
            )


def _array_lines(scenario: Scenario, highest: float) -> list[ExpectedLine]:
    lines = []
    for mode in coupled_modes(scenario):
        if mode.fixed_frequency is None or mode.frequency > highest:
            continue
        # While the shaft sticks the mode is at its clamped frequency, while it slips at the coupled
        # one.
        low, high = sorted((mode.frequency, mode.fixed_frequency))
        if (
            high > 1.1 * low
        ):  # above the drive resonance they lie far apart, with other lines between
            low = high = mode.frequency
        origin = f"clamped {mode.fixed_frequency:.4g} Hz, seen through the drive"
        lines.append(
            ExpectedLine(mode.name, "array mode", mode.frequency, low, high, origin, mode.decay)
        )
    return lines
