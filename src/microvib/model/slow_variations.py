"""Changes of a drive over longer than a full step of its motor, by an error of the gear, friction over
the angle or unequal phases: after which time each repeats, and which a record does not show.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from microvib.model.driver import Driver
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario

CYCLES_SEEN = 2.0
"""Cycles of a variation from which a record shows what lines are over it: a Hann window over two
weighs all parts of a cycle alike, sin^2 + cos^2.
"""
COMPENSATION = "driver.compensation"
"""Key of what changes the time from microstep to microstep."""
HARNESS = "friction.harness"
"""Key of what pulls at the output the more it has turned."""
_WHOLE_CYCLES = 0.99
"""Part of these cycles that counts as all of them: a record is a whole number of samples."""
NEGLIGIBLE_SHARE = 1e-3
"""Part of the rate, or of the friction, below which a change counts for nothing: the least relative
error of lines.
"""
_NEGLIGIBLE_LINE = 1e-6
"""Part of the rate, or of the friction, below which a change counts for nothing as a line of its own:
friction may be a thousand times the lines, and a gear's stiffness makes much of a small angle.
"""
_NEGLIGIBLE_SHIFT = 0.5
"""Bins of a record by which compensation may shift lines of the step clock and count for nothing: a
line that drifts by so much over a record reads 1 % too small at most.
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


def slow_variations(scenario: Scenario, duration: float | None = None) -> list[SlowVariation]:
    """Changes of the drive over longer than a full step, the longest first, without those that
    amount to nothing in a record of ``duration`` [s], or the scenario's; none where the rate is not
    constant, or zero.

    An error of the gear changes the rate of the output by its slope, its compensation that of the
    rotor, friction over the angle the friction by its amplitude. Compensation shifts lines of the
    step clock, too, and the higher they are the more. Of each the longest cycle counts:
    that of its order, or the beat of one of its first multiples with what else the drive has over its
    angle, which it meets at other angles from cycle to cycle. However little it changes the drive, it
    makes a line of its own, which beats with those beside it.
    """
    if not scenario.driving_frequency:
        return []
    electrical = scenario.driver.beats * scenario.driver.microsteps / scenario.driving_frequency
    full_step = electrical / scenario.motor.full_steps
    errors, compensation, friction = (
        list(each(scenario)) for each in (_errors_of_gear, _compensation, _friction_over_angle)
    )
    lasts = scenario.record.duration if duration is None else duration
    harmonics = [
        *_significant(errors),
        *_significant(compensation, _negligible_compensation(scenario, lasts)),
        *_significant(friction),
    ]
    found = [
        *(_variation(scenario, one) for one in harmonics),
        *_beats_of_two(scenario, harmonics),
        *_beats_of_lines(scenario, [*errors, *compensation, *friction], lasts),
        *_roughness(scenario),
        *_harness(scenario),
        *_unequal_phases(scenario),
    ]
    return sorted((x for x in found if x.cycle > full_step), key=lambda one: -one.cycle)


def unseen_variations(scenario: Scenario, duration: float) -> list[SlowVariation]:
    """Changes of the drive of which a record of ``duration`` [s] holds fewer than CYCLES_SEEN cycles,
    the longest first.
    """
    seen = duration / (_WHOLE_CYCLES * CYCLES_SEEN)
    return [one for one in slow_variations(scenario, duration) if one.cycle > seen]


class _Harmonic(NamedTuple):
    """Something that the drive has over its angle."""

    key: str
    what: str
    order: Fraction
    """Cycles per turn of the rotor."""
    share: float
    """Part of the rate, or of the friction, by which it changes."""


def _negligible_compensation(scenario: Scenario, duration: float) -> float:
    """Part of the rate up to which compensation counts for nothing: it hardly shifts the highest line
    of a record of a ``duration`` [s].
    """
    bins = PASSBAND * scenario.record.sample_rate * duration
    return min(NEGLIGIBLE_SHARE, _NEGLIGIBLE_SHIFT / bins)


def _significant(
    found: Iterable[_Harmonic], negligible: float = NEGLIGIBLE_SHARE
) -> list[_Harmonic]:
    """Harmonics of one kind, but for those of the slowest that together are ``negligible``."""
    kept = sorted(found, key=lambda one: one.order)
    shares = np.cumsum([one.share for one in kept])
    return kept[int(np.searchsorted(shares, negligible, side="right")) :]


def _errors_of_gear(scenario: Scenario) -> Iterator[_Harmonic]:
    """Harmonics of the transmission error."""
    for error in scenario.reducer.errors:
        share = float(error.order) * error.amplitude * scenario.reducer.ratio
        key = "reducer.transmission_error"
        if not error.line.startswith("wave_generator"):
            key = "reducer.train"
        yield _Harmonic(key, f"{key} ({error.origin})", Fraction(error.order), share)


def _compensation(scenario: Scenario) -> Iterator[_Harmonic]:
    """Harmonics of the driver's compensation, which change the rate of the rotor and the time from
    microstep to microstep.
    """
    for one in scenario.driver.compensation:
        share = one.order * one.amplitude * scenario.reducer.ratio
        what = f"{COMPENSATION} (order {one.order})"
        yield _Harmonic(COMPENSATION, what, Fraction(one.order), share)


def _friction_over_angle(scenario: Scenario) -> Iterator[_Harmonic]:
    """Harmonics of the output's friction over its angle."""
    friction = scenario.friction
    if friction.position is None or not friction.torque(abs(scenario.rate or 0.0)):
        return
    key, ratio = "friction.position", Fraction(scenario.reducer.ratio)
    for harmonic in friction.position.harmonics:
        what = f"{key} (order {harmonic.order})"
        yield _Harmonic(key, what, harmonic.order / ratio, harmonic.amplitude)


def _variation(scenario: Scenario, one: _Harmonic) -> SlowVariation:
    """A harmonic by itself, or as it meets the steps and the motor's torques."""
    multiples = [k * one.order for k in range(1, _BEATS + 1)]
    slowest = _slowest_order([one.order], multiples, _combs(scenario))
    return SlowVariation(one.key, one.what, _turn_of_rotor(scenario) / slowest, one.share)


def _beats_of_two(scenario: Scenario, harmonics: Sequence[_Harmonic]) -> Iterator[SlowVariation]:
    """Harmonics as they meet each other, and their sums and differences as these meet the steps and the
    motor's torques.
    """
    combs = _combs(scenario)
    for one, other in itertools.combinations(harmonics, 2):
        share = min(one.share, other.share)
        if share < NEGLIGIBLE_SHARE:
            continue
        times = range(1, _BEATS + 1)
        beats = [abs(i * one.order - j * other.order) for i in times for j in times]
        own = [one.order, other.order]
        same = _SAME_ORDER * max(own)
        together = [one.order + other.order, abs(one.order - other.order)]
        slowest = _slowest_order([*own, *(x for x in beats if x > same)], together, combs)
        if slowest < _slowest_order(own, [], combs):
            what = f"{one.what} beside {other.what}"
            yield SlowVariation(one.key, what, _turn_of_rotor(scenario) / slowest, share)


def _beats_of_lines(
    scenario: Scenario, harmonics: Sequence[_Harmonic], duration: float
) -> Iterator[SlowVariation]:
    """Beats of the lines that harmonics make by themselves, with lines of the steps and with each other.
    A harmonic that takes longer than ``duration`` [s] for one cycle is left out.
    """
    turn, combs = _turn_of_rotor(scenario), _combs(scenario)
    lines = [
        one for one in harmonics if one.share >= _NEGLIGIBLE_LINE and one.order * duration >= turn
    ]
    for one in lines:
        multiples = [(round(one.order / comb), comb) for comb in combs]
        beats = [abs(one.order - k * comb) for k, comb in multiples if k > 0]
        if slow := [beat for beat in beats if beat > _SAME_ORDER * one.order]:
            yield SlowVariation(one.key, one.what, turn / float(min(slow)), one.share)
    for one, other in itertools.combinations(lines, 2):
        beat = abs(one.order - other.order)
        if _SAME_ORDER * one.order < beat < min(one.order, other.order):
            what = f"{one.what} beside {other.what}"
            share = min(one.share, other.share)
            yield SlowVariation(one.key, what, turn / float(beat), share)


def _roughness(scenario: Scenario) -> Iterator[SlowVariation]:
    """Roughness of the output's friction, which is alike after a turn of the output only."""
    position = scenario.friction.position
    if position is None or position.roughness is None:
        return
    highest = math.floor(min(position.roughness.band[1], _LARGEST_ORDER))
    orders = np.arange(1.0, highest + 1.0)
    share = _ROUGHNESS_SIGMAS * math.sqrt(float(np.sum(position.roughness.at(orders))))
    beside_steps = highest >= min(_combs(scenario)) * scenario.reducer.ratio - 1.0
    if share >= (_NEGLIGIBLE_LINE if beside_steps else NEGLIGIBLE_SHARE):
        key = "friction.position.roughness"
        yield SlowVariation(key, key, _turn_of_output(scenario), share)


def _harness(scenario: Scenario) -> Iterator[SlowVariation]:
    """Torque of a harness, against which the rotor lags by other angles as the array turns."""
    harness = scenario.friction.harness
    if harness is None:
        return
    full = scenario.motor.axis_torque_constant * scenario.motor.axis_current
    share = harness.stiffness * 2.0 * math.pi / (scenario.reducer.ratio * full)
    if share >= NEGLIGIBLE_SHARE:
        yield SlowVariation(HARNESS, HARNESS, _turn_of_output(scenario), share)


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


def _turn_of_output(scenario: Scenario) -> float:
    """Seconds that a turn of the output takes."""
    return scenario.reducer.ratio * _turn_of_rotor(scenario)


def _combs(scenario: Scenario) -> list[int]:
    """Orders, in cycles per turn of the rotor, all multiples of which the drive has by its steps, its
    motor's torques and its driver's errors.
    """
    driver, motor = scenario.driver, scenario.motor
    combs = [order * motor.rotor_teeth for order in motor.torque_orders]
    if driver.distorted:
        combs.append(motor.rotor_teeth)
    return [_microsteps_of_turn(driver, motor.rotor_teeth), *combs]


def _slowest_order(
    own: Sequence[Fraction], beside: Sequence[Fraction], combs: Sequence[int]
) -> float:
    """Least of the orders ``own`` and of the beats of those ``beside`` with multiples of ``combs``."""
    beats = [abs(one - round(one / comb) * comb) for one in beside for comb in combs]
    same = _SAME_ORDER * max(own)
    return float(min([*own, *(beat for beat in beats if beat > same)]))
