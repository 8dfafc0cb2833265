"""Changes of a drive over longer than a full step of its motor, by an error of the gear, friction over
the angle or unequal phases: after which time each repeats, and which a record does not show.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from microvib.model.driver import Driver
from microvib.model.scenario import Scenario

CYCLES_SEEN = 2.0
"""Cycles of a variation from which a record shows what lines are over it: a Hann window over two
weighs all parts of a cycle alike, sin^2 + cos^2.
"""
COMPENSATION = "driver.compensation"
"""Key of what changes the time from microstep to microstep."""
_WHOLE_CYCLES = 0.99
"""Part of these cycles that counts as all of them: a record is a whole number of samples."""
NEGLIGIBLE_SHARE = 1e-3
"""Part of the rate, or of the friction, below which a change counts for nothing: the least relative
error of lines.
"""
_ROUGHNESS_SIGMAS = 3.0
"""Standard deviations of a roughness that count as its change."""
_BEATS = 3
"""Multiples of an order that may lie beside one of the step clock."""
_SAME_ORDER = 1e-9
"""Part of an order by which it may differ from a multiple of the clock's and still be it."""
_LARGEST_ORDER = 1_000_000


@dataclass(frozen=True)
class SlowVariation:
    """A change of the drive that repeats after longer than a full step."""

    key: str
    """Key of the scenario."""
    what: str
    """Key with its order."""
    cycle: float
    """Time after which it repeats [s]."""
    share: float
    """Part of the rate, or of the friction, by which it changes."""


def slow_variations(scenario: Scenario) -> list[SlowVariation]:
    """Changes of the drive over longer than a full step, the longest first, without those that
    amount to nothing; none where the rate is not constant, or zero.

    An error of the gear changes the rate of the output by its slope, its compensation that of the
    rotor, friction over the angle the
    friction by its amplitude. Of each the longest cycle counts: that of its order, or the beat of
    one of its first multiples with the steps, over which it meets them at other angles.
    """
    if not scenario.driving_frequency:
        return []
    electrical = scenario.driver.beats * scenario.driver.microsteps / scenario.driving_frequency
    full_step = electrical / scenario.motor.full_steps
    found = [
        *_significant(_errors_of_gear(scenario)),
        *_significant(_compensation(scenario)),
        *_significant(_friction_over_angle(scenario)),
        *_roughness(scenario),
        *_unequal_phases(scenario),
    ]
    return sorted((x for x in found if x.cycle > full_step), key=lambda one: -one.cycle)


def unseen_variations(scenario: Scenario, duration: float) -> list[SlowVariation]:
    """Changes of the drive of which a record of ``duration`` [s] holds fewer than CYCLES_SEEN cycles,
    the longest first.
    """
    seen = duration / (_WHOLE_CYCLES * CYCLES_SEEN)
    return [one for one in slow_variations(scenario) if one.cycle > seen]


def _significant(found: Iterable[SlowVariation]) -> list[SlowVariation]:
    """Changes of one kind, the longest first, but for the longest that together are negligible."""
    kept = sorted(found, key=lambda one: -one.cycle)
    shares = np.cumsum([one.share for one in kept])
    return kept[int(np.searchsorted(shares, NEGLIGIBLE_SHARE, side="right")) :]


def _errors_of_gear(scenario: Scenario) -> Iterator[SlowVariation]:
    """Harmonics of the transmission error."""
    for error in scenario.reducer.errors:
        share = float(error.order) * error.amplitude * scenario.reducer.ratio
        key = "reducer.transmission_error"
        if not error.line.startswith("wave_generator"):
            key = "reducer.train"
        cycle = _turn_of_rotor(scenario) / _slowest_order(scenario, error.order)
        yield SlowVariation(key, f"{key} ({error.origin})", cycle, share)


def _compensation(scenario: Scenario) -> Iterator[SlowVariation]:
    """Harmonics of the driver's compensation, which change the rate of the rotor and the time from
    microstep to microstep.
    """
    for one in scenario.driver.compensation:
        share = one.order * one.amplitude * scenario.reducer.ratio
        cycle = _turn_of_rotor(scenario) / _slowest_order(scenario, Fraction(one.order))
        yield SlowVariation(COMPENSATION, f"{COMPENSATION} (order {one.order})", cycle, share)


def _friction_over_angle(scenario: Scenario) -> Iterator[SlowVariation]:
    """Harmonics of the output's friction over its angle."""
    friction = scenario.friction
    if friction.position is None or not friction.torque(abs(scenario.rate or 0.0)):
        return
    key, ratio = "friction.position", Fraction(scenario.reducer.ratio)
    for harmonic in friction.position.harmonics:
        cycle = _turn_of_rotor(scenario) / _slowest_order(scenario, harmonic.order / ratio)
        yield SlowVariation(key, f"{key} (order {harmonic.order})", cycle, harmonic.amplitude)


def _roughness(scenario: Scenario) -> Iterator[SlowVariation]:
    """Roughness of the output's friction: of its cycles per turn the fewest that count."""
    position = scenario.friction.position
    if position is None or position.roughness is None:
        return
    orders = np.arange(1.0, math.floor(min(position.roughness.band[1], _LARGEST_ORDER)) + 1.0)
    shares = _ROUGHNESS_SIGMAS * np.sqrt(np.cumsum(position.roughness.at(orders)))
    first = int(np.searchsorted(shares, NEGLIGIBLE_SHARE, side="right"))
    if first == orders.size:
        return
    key, turn = "friction.position.roughness", scenario.reducer.ratio * _turn_of_rotor(scenario)
    what = f"{key} ({orders[first]:g} cycles per turn)"
    yield SlowVariation(key, what, turn / float(orders[first]), float(shares[-1]))


def _unequal_phases(scenario: Scenario) -> Iterator[SlowVariation]:
    """Unequal full steps, by errors of the driver or by what else repeats with the electrical period."""
    driver, motor = scenario.driver, scenario.motor
    after = driver.repeats_after(motor)
    if after * motor.full_steps <= driver.beats * driver.microsteps:
        return
    cycle = after / float(scenario.driving_frequency or math.inf)
    yield SlowVariation("driver", "the sequence of unequal full steps", cycle, math.inf)


def _turn_of_rotor(scenario: Scenario) -> float:
    """Seconds that a turn of the rotor takes."""
    microsteps = _microsteps_of_turn(scenario.driver, scenario.motor.rotor_teeth)
    return microsteps / float(scenario.driving_frequency or math.inf)


def _microsteps_of_turn(driver: Driver, teeth: int) -> int:
    return driver.beats * driver.microsteps * teeth


def _slowest_order(scenario: Scenario, order: Fraction) -> float:
    """Least of the orders, in cycles per turn of the rotor, that one of ``order`` has by itself or as a
    beat of its first multiples with the steps.
    """
    driver, motor = scenario.driver, scenario.motor
    combs = [_microsteps_of_turn(driver, motor.rotor_teeth)]
    if motor.detent_torque > 0.0:
        combs.append(motor.detent_periods * motor.rotor_teeth)
    if driver.distorted:
        combs.append(motor.rotor_teeth)
    multiples = [k * order for k in range(1, _BEATS + 1)]
    beats = [abs(one - round(one / comb) * comb) for one in multiples for comb in combs]
    return float(min([order, *(beat for beat in beats if beat > _SAME_ORDER * order)]))
