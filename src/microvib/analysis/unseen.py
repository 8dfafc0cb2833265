"""Upper bounds, line by line, above the highest frequency of a record.

Of what the step clock makes, the linearised drive says how large it gets from what pulls at the
rotor: the command's staircase and its side lines, the detent torque, errors of the driver. What
goes on from the highest octave of the record does so no stronger than there, through the same
drive. Lines of a gear train's errors are not bounded by any model here, but their side lines are,
which they make with the motor's torques. Friction, backlash and
hysteresis may make lines at any frequency, also between those of the clock, no larger than a torque
of their size makes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.margins import ABOVE_PASSBAND_FACTOR, CLOCK_UNCERTAINTY
from microvib.analysis.start import may_still_ring
from microvib.model.commanded_torque import commanded_torque, spring_orders
from microvib.model.drive_matrices import coordinates
from microvib.model.driven import noise_bands, noise_density
from microvib.model.expected import SIDEBANDS
from microvib.model.hub_edge import HubEdge
from microvib.model.linear import (
    coupled_modes,
    disturbance_torque_response,
    dynamic_stiffness,
    gear_error_response,
    linear_lines,
    staircase_torque,
)
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_table import LineTable

EXTRAPOLATION_FACTOR = 3.0
"""Factor on what stands in the highest octave of a record for what may stand above it, beside what
the drive amplifies.
"""
_SWITCHING_SEEN_RATIO = 2.0
"""Times the frequency at which friction may switch that a record must reach: then it shows the
largest of the lines that this makes, and what is above follows from them.
"""
_MAX_ORDERS = 5000
_MAX_SIDE_ORDERS = 100
_MAX_FREQUENCIES = 600
"""Frequencies at which one family of lines is looked at: all of its lines, or those near modes and
others spread evenly.
"""
_MANY_MODES = 60
"""Modes from which a tenth of that is enough of a wait."""
_NOISE_POINTS = 4001
"""Frequencies at which a density is added up over a band."""
_NOISE_SIGMAS = 3.0
"""Times its root mean square that noise reads as a line, at most."""
_LOWEST_FREQUENCY_RATIO = 0.01
"""Part of the lowest mode's frequency below which the drive's response is not looked at."""


@dataclass(frozen=True)
class OutOfBandLines:
    """Lines of one cause above the record's passband, and how large they may be; infinite where
    nothing bounds them.
    """

    what: str
    """One of them, without its frequency."""
    frequency: np.ndarray
    """[Hz], (n,), ascending."""
    most: np.ndarray
    """Upper bounds in T_d [N m], 0-to-peak, (n,)."""
    pull: np.ndarray
    """Torques that make them, by which the line of sight follows [N m], (n,)."""
    on_output: bool = False
    """Whether these act on the output; else on the rotor."""
    number: np.ndarray | None = None
    """How many lines each stands for, (n,); None where that is one."""
    between: bool = False
    """Whether there may be lines between these, no larger than their neighbours."""
    falling: bool = False
    """Whether there may be lines above these, too, no larger than the last."""
    up_to: float = 0.0
    """Other end of the range of frequencies [Hz] that each of them may have; 0 where it is known."""

    def may_exceed(self, limit: LimitCurve) -> np.ndarray:
        """Which of them may be above the strictest limit at the frequencies that they may have, (n,)."""
        return np.asarray(self.most > self.least_allowed(limit))

    def least_allowed(self, limit: LimitCurve) -> np.ndarray:
        """The strictest limit at the frequencies that each of them may have, (n,): about its own, and
        where there may be lines between these, up to both neighbours.
        """
        low, high = self.frequency.astype(float), self.frequency.astype(float)
        if self.between and low.size:
            low = np.concatenate([low[:1], self.frequency[:-1]])
            high = np.concatenate([self.frequency[1:], high[-1:]])
        if self.falling and high.size:
            high[-1] = math.inf
        if self.up_to:
            low, high = np.minimum(low, self.up_to), np.maximum(high, self.up_to)
        about = CLOCK_UNCERTAINTY * self.frequency
        return np.asarray(limit.strictest(low - about, high + about))

    def above_hub(self, edge: HubEdge) -> OutOfBandLines:
        """Lines above the frequency up to which the hub is known, as large as they may be there."""
        there = self.within(edge.frequency, math.inf)
        return replace(there, most=edge.factor * there.most)

    def within(self, low: float, high: float) -> OutOfBandLines:
        """Lines between two frequencies [Hz], which are included."""
        first = int(np.searchsorted(self.frequency, low))
        last = int(np.searchsorted(self.frequency, high, "right"))
        if self.between and self.frequency.size and high >= self.frequency[0]:
            last += 1
            if low <= self.frequency[-1] or self.falling:
                first = max(first - 1, 0)
        part = slice(first, last)
        if self.number is None:
            number = None
        else:
            number = self.number[part]
        at = np.clip(self.frequency[part], low, high)
        return replace(
            self, frequency=at, most=self.most[part], pull=self.pull[part], number=number
        )


def out_of_band_lines(
    scenario: Scenario, table: LineTable, start: float, high: float
) -> Iterator[OutOfBandLines]:
    """Upper bounds on lines of the drive of ``scenario`` between ``start``, the edge of the passband of the
    record, and ``high`` [Hz].

    ``table`` has the lines of the record.
    """
    modes = [m for m in coupled_modes(scenario) if start < m.frequency <= high]
    yield from clock_line_bounds(scenario, start, high)
    yield from _extrapolated_bounds(scenario, table, start, high)
    yield from _noise_bounds(scenario, start, high)
    shown = PASSBAND * table.sample_rate
    if shown < _SWITCHING_SEEN_RATIO * _switching_frequency(scenario):
        yield from nonlinear_torque_bounds(scenario, start, high)
    if any(x.status == TRANSIENT for x in table):  # in the steady state nothing rings
        return
    for mode in modes:
        if mode.damping > 0.0 and may_still_ring(mode, scenario):
            ringing = _unbounded(f"ringing of {mode.name}", mode.frequency)
            yield replace(ringing, up_to=mode.fixed_frequency or 0.0)


def nonlinear_torque_bounds(
    scenario: Scenario, start: float, high: float
) -> Iterator[OutOfBandLines]:
    """Upper bounds of the torques of friction, backlash and hysteresis at any frequency between two [Hz].

    Each is a torque beside the linear drive that never exceeds a size of its own: whatever it does,
    the root mean square of its lines together is at most that size, and one line at most sqrt(2)
    times it. It switches at most twice in a period of the drive's fastest mode and twice in a
    microstep; lines of such a torque fall with their frequency above that.
    """
    reducer = scenario.reducer
    in_gear = sum(share for _, share in reducer.memory)
    if reducer.backlash and not reducer.rigid:
        in_gear += 0.5 * float(reducer.stiffness) * reducer.backlash
    at = _frequency_grid(scenario, start, high)
    falling = math.sqrt(2.0) * np.minimum(1.0, 2.0 * _switching_frequency(scenario) / at)
    # What acts in the gear acts on both shafts at once: either is given twice its torque, which
    # bounds their sum.
    for what, size, on_output in (
        ("a line of the rotor's friction", scenario.motor.friction.largest_torque, False),
        ("a line of the output's friction", scenario.friction.largest_torque, True),
        ("a line of backlash or hysteresis", 2.0 * in_gear / reducer.ratio, False),
        ("a line of backlash or hysteresis", 2.0 * in_gear, True),
    ):
        if size > 0.0 and at.size:
            found = _bounds_by_torque(scenario, what, at, size * falling, on_output=on_output)
            yield replace(found, between=True, falling=True)


def _switching_frequency(scenario: Scenario) -> float:
    """How often friction or a gap may switch at most [Hz]: once a microstep or with the fastest
    mode.
    """
    modes = (m.frequency for m in coupled_modes(scenario))
    return max(scenario.driving_frequency or 0.0, *modes, 0.0)


def _frequency_grid(scenario: Scenario, start: float, high: float) -> np.ndarray:
    """Frequencies [Hz], ascending, between whose neighbours the drive amplifies no more than at
    one of them: evenly spread, and those of its modes.
    """
    modes = np.array([m.frequency for m in coupled_modes(scenario)])
    end = min(2.0 * max(start, modes.max(initial=0.0)), high)
    start = max(start, _LOWEST_FREQUENCY_RATIO * modes.min(initial=end))
    if not end > start > 0.0:
        return np.empty(0)
    even = np.geomspace(start, end, 50 if modes.size < _MANY_MODES else 10)
    return np.union1d(even, modes[(modes > start) & (modes < end)])


def clock_line_bounds(
    scenario: Scenario, start: float, high: float, known: int = 0
) -> Iterator[OutOfBandLines]:
    """Upper bounds on lines of the step clock: driving lines and their side lines, full-step and electrical
    lines, lines of the gear train.

    The first ``known`` driving lines are left out.
    """
    f_d, driver = scenario.driving_frequency, scenario.driver
    if not f_d:
        return
    fastest = max((m.frequency for m in coupled_modes(scenario)), default=0.0)
    end = min(2.0 * max(start, fastest) + 20.0 * f_d, high)
    count = min(math.ceil(end / f_d) + 1, _MAX_ORDERS)
    yield from _driving_lines(scenario, start, high, range(known + 1, count + 1))
    if scenario.motor.torque_comb is not None:
        yield from _lines_of_motor_torques(scenario, start, high, end)
    if driver.distorted or driver.compensates:
        yield from _lines_of_references(scenario, start, high, end)
    turn = driver.beats * driver.microsteps * scenario.motor.rotor_teeth
    for e in scenario.rotor_harmonics:
        f = float(e.order) * f_d / turn
        if e.amplitude > 0.0 and start < f <= high:
            yield _unbounded(e.line, f)
    yield from _side_lines_of_gear_errors(scenario, start, high, count)
    yield from _lines_of_friction_over_angle(scenario, start, high)


def _driving_lines(
    scenario: Scenario, start: float, high: float, orders: range
) -> Iterator[OutOfBandLines]:
    """Upper bounds on driving lines of some orders between two frequencies [Hz]."""
    found = [
        x
        for x in linear_lines(scenario, orders.stop - 1)
        if start < x.frequency <= high and x.order in orders
    ]
    if found:
        size, order = np.abs([x.amplitude for x in found]), np.array([x.order for x in found])
        pull = np.abs(staircase_torque(scenario, order))
        yield OutOfBandLines(
            "a driving line",
            float(scenario.driving_frequency or 0.0) * order,
            ABOVE_PASSBAND_FACTOR * size,
            ABOVE_PASSBAND_FACTOR * pull,
        )


def _lines_of_motor_torques(
    scenario: Scenario, start: float, high: float, end: float
) -> Iterator[OutOfBandLines]:
    """Upper bounds on lines between two frequencies [Hz], up to ``end`` [Hz], of detent torque and flux
    harmonics, and on the side lines that they make of driving lines.
    """
    motor, driver, f_d = scenario.motor, scenario.driver, float(scenario.driving_frequency or 0.0)
    electrical, torques = f_d / (driver.beats * driver.microsteps), motor.torque_orders
    comb = motor.torque_comb or 1
    orders = np.arange(1, min(math.ceil(end / f_d) + 1, _MAX_ORDERS) + 1)
    sides = [j * n for n in torques for j in range(-SIDEBANDS, SIDEBANDS + 1) if j]
    k, side = np.tile(orders, len(sides)), np.repeat(sides, orders.size)
    pull = ABOVE_PASSBAND_FACTOR * np.abs(staircase_torque(scenario, k))
    yield _line_family_bounds(
        scenario, "a side line of a driving line", k * f_d + side * electrical, pull, start, high
    )
    m = np.arange(1, min(math.ceil(end / (electrical * comb)) + 1, _MAX_ORDERS))
    each = [size / np.maximum(m * (comb / n), 1.0) for n, size in torques.items()]
    pull = ABOVE_PASSBAND_FACTOR * np.sum(each, axis=0)
    yield _line_family_bounds(
        scenario, "a full-step line", m * (electrical * comb), pull, start, high
    )


def _lines_of_references(
    scenario: Scenario, start: float, high: float, end: float
) -> Iterator[OutOfBandLines]:
    """Upper bounds on lines between two frequencies [Hz] of references that are not those of an ideal
    driver, up to ``end`` [Hz], and on side lines that the motor's torques and the varying spring
    make of them.
    """
    torque = commanded_torque(scenario, end)
    pull = ABOVE_PASSBAND_FACTOR * torque.amplitude
    at = torque.frequency * np.arange(1, pull.size + 1)
    electrical, turn = pull.copy(), 1  # periods of the lines
    if scenario.driver.compensates:
        turn = scenario.motor.rotor_teeth
    else:
        microsteps = scenario.driver.beats * scenario.driver.microsteps
        electrical[microsteps - 1 :: microsteps] = 0.0  # driving lines
    yield _line_family_bounds(scenario, "an electrical line", at, electrical, start, high)
    side = np.zeros_like(pull)
    varies = spring_orders(scenario.driver, scenario.motor)
    for order in dict.fromkeys([*scenario.motor.torque_orders, *varies]):
        for distance in (j * order * turn for j in range(1, SIDEBANDS + 1)):
            side[distance:] = np.maximum(side[distance:], pull[:-distance])
            side[:-distance] = np.maximum(side[:-distance], pull[distance:])
    if np.any(side):
        yield _line_family_bounds(
            scenario, "a side line of an electrical line", at, side, start, high
        )


def _lines_of_friction_over_angle(
    scenario: Scenario, start: float, high: float
) -> Iterator[OutOfBandLines]:
    """Upper bounds on lines between two frequencies [Hz] of the output's friction over its angle: its
    harmonics and their multiples.
    """
    position, rate = scenario.friction.position, abs(scenario.rate or 0.0) / (2.0 * math.pi)
    if position is None:
        return
    torque = ABOVE_PASSBAND_FACTOR * scenario.friction.largest_torque
    multiples = np.arange(1, SIDEBANDS + 2)
    for harmonic in position.harmonics:
        at = float(harmonic.order) * rate * multiples
        pull = torque * harmonic.amplitude / multiples
        there = (at > start) & (at <= high)
        what = "a line of friction over the angle"
        yield _bounds_by_torque(scenario, what, at[there], pull[there], on_output=True)


def _side_lines_of_gear_errors(
    scenario: Scenario, start: float, high: float, count: int
) -> Iterator[OutOfBandLines]:
    """Upper bounds on lines between two frequencies [Hz] that errors of the gear train make together
    with the motor's torques: of order n per electrical turn, and of the staircase up to its order
    ``count``, or _MAX_SIDE_ORDERS, above which it hardly moves the rotor.

    A torque at the frequency g moves the rotor by x, and an error e sin(N theta) then has side lines
    at distances of j g with the size e J_j(N x). An error at the frequency f moves it by y, and a
    torque A sin(n z theta) has side lines at distances of j f with the size A J_j(n z y). J_j(u) is
    below 1 and below (u/2)^j / j! (Jacobi-Anger expansion). To the staircase n = 1 applies.
    """
    f_d, motor, driver = scenario.driving_frequency or 0.0, scenario.motor, scenario.driver
    errors = [e for e in scenario.reducer.errors if e.amplitude > 0.0]
    if not errors:
        return
    turn = driver.beats * driver.microsteps
    orders, torques = np.arange(1, min(count, _MAX_SIDE_ORDERS) + 1), motor.torque_orders
    n = np.concatenate([np.ones(orders.size), list(torques)])
    g = np.concatenate([f_d * orders, f_d / turn * np.array(list(torques))])
    size = np.concatenate([np.abs(staircase_torque(scenario, orders)), list(torques.values())])
    if driver.distorted:
        own = commanded_torque(scenario, f_d * orders[-1])
        n = np.concatenate([n, np.ones(own.amplitude.size)])
        g = np.concatenate([g, own.frequency * np.arange(1, own.amplitude.size + 1)])
        size = np.concatenate([size, own.amplitude])
    compliance = np.abs(np.linalg.inv(dynamic_stiffness(scenario, g))[:, 0, 0])
    for e in errors:
        f = float(e.order) * f_d / (turn * motor.rotor_teeth)
        moved = e.amplitude * float(gear_error_response(scenario, np.array([f])).rotor[0])
        what = f"a side line of {e.line}"
        for j in range(1, SIDEBANDS + 1):
            part = _side_line_part(n * motor.rotor_teeth * moved, j)
            at = np.concatenate([np.abs(g - j * f), g + j * f])
            pull = ABOVE_PASSBAND_FACTOR * np.tile(size * part, 2)
            yield _line_family_bounds(scenario, what, at, pull, start, high)
            part = _side_line_part(float(e.order) * size * compliance, j)
            at = np.concatenate([np.abs(f - j * g), f + j * g])
            wrong = ABOVE_PASSBAND_FACTOR * e.amplitude * np.tile(part, 2)
            yield _lines_of_errors(scenario, what, at, wrong, (start, high))


def _side_line_part(depth: np.ndarray, j: int) -> np.ndarray:
    """Upper bounds on the Bessel function J_j of phases (n,) [rad] by which a line is modulated."""
    return np.minimum(1.0, (0.5 * depth) ** j / math.factorial(j))


def _lines_of_errors(
    scenario: Scenario,
    what: str,
    frequency: np.ndarray,
    wrong: np.ndarray,
    ends: tuple[float, float],
) -> OutOfBandLines:
    """Lines between the ``ends`` [Hz], of those at ``frequency`` (n,), that errors ``wrong`` (n,)
    [rad] of the gear train make.
    """
    there = np.flatnonzero((frequency > ends[0]) & (frequency <= ends[1]))
    there = there[np.argsort(frequency[there], kind="stable")]
    at = frequency[there]
    most = wrong[there] * gear_error_response(scenario, at).torque
    pull = most / np.maximum(output_torque_gain(scenario, at), 1e-300)
    return OutOfBandLines(what, at, most, pull, on_output=True)


def _line_family_bounds(
    scenario: Scenario,
    what: str,
    frequency: np.ndarray,
    pull: np.ndarray,
    start: float,
    high: float,
) -> OutOfBandLines:
    """Lines from ``start`` to ``high`` [Hz], of those at ``frequency`` (n,), that torques ``pull``
    (n,) [N m] on the rotor make.
    """
    there = np.flatnonzero((frequency > start) & (frequency <= high))
    there = there[np.argsort(frequency[there], kind="stable")]
    kept = _select_near_modes(scenario, frequency[there])
    number = np.diff(
        np.concatenate([[0], (kept[1:] + kept[:-1] + 1) // 2, [there.size]])[: kept.size + 1]
    )
    first = np.cumsum(number) - number
    largest = np.maximum.reduceat(pull[there], first) if kept.size else pull[there]
    found = _bounds_by_torque(scenario, what, frequency[there[kept]], largest)
    return replace(found, number=number, between=kept.size < there.size)


def _bounds_by_torque(
    scenario: Scenario,
    what: str,
    frequency: np.ndarray,
    pull: np.ndarray,
    *,
    on_output: bool = False,
) -> OutOfBandLines:
    """Lines at each ``frequency`` (n,) [Hz] that torques ``pull`` (n,) [N m] on rotor or output
    make.
    """
    if on_output:
        by = output_torque_gain
    else:
        by = rotor_torque_gain
    return OutOfBandLines(what, frequency, pull * by(scenario, frequency), pull, on_output)


def _unbounded(what: str, frequency: float) -> OutOfBandLines:
    """A line that nothing bounds."""
    return OutOfBandLines(what, np.array([frequency]), np.array([math.inf]), np.array([math.inf]))


def _select_near_modes(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """Which of the frequencies (n,), ascending, are looked at, where there are many: those next to
    modes, and others.
    """
    modes = np.array([m.frequency for m in coupled_modes(scenario)])
    if modes.size < _MANY_MODES:
        many = _MAX_FREQUENCIES
    else:
        many = _MAX_FREQUENCIES // 10
    if frequency.size <= many:
        return np.arange(frequency.size)
    near = np.searchsorted(frequency, modes[:, None]) + np.arange(-2, 3)
    even = np.linspace(0, frequency.size - 1, many // 2).astype(int)
    return np.unique(np.clip(np.append(near, even), 0, frequency.size - 1))


def rotor_torque_gain(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """T_d over a torque on the rotor at each ``frequency`` (n,) [Hz], by the linearised drive."""
    return disturbance_torque_response(
        scenario, frequency, coordinates(scenario.reducer, len(scenario.load.H))[0]
    )


def output_torque_gain(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """T_d over a torque on the output at each ``frequency`` (n,) [Hz], by the linearised drive."""
    return disturbance_torque_response(
        scenario, frequency, coordinates(scenario.reducer, len(scenario.load.H))[1]
    )


def _extrapolated_bounds(
    scenario: Scenario, table: LineTable, start: float, high: float
) -> Iterator[OutOfBandLines]:
    """Extrapolation of the two highest octaves of the record, as torques on rotor or output would
    carry it on.

    Such torques have jumps at most, whose lines fall as their frequency rises.
    """
    edge = PASSBAND * table.sample_rate
    known = [(x.place, max(x.amplitude, x.hidden)) for x in table if math.isfinite(x.amplitude)]
    if table.rest is not None:
        known += zip(table.rest.frequency.tolist(), table.rest.amplitude.tolist(), strict=True)
    octaves = np.array([row for row in known if 0.25 * edge <= row[0] <= edge]).reshape(-1, 2)
    seen, size = octaves.T
    fallen = np.where(seen < 0.5 * edge, seen / edge, 1.0)
    at = _frequency_grid(scenario, start, high)
    for on_output, by in ((False, rotor_torque_gain), (True, output_torque_gain)):
        level = np.max(fallen * size / np.maximum(by(scenario, seen), 1e-300), initial=0.0)
        pull = EXTRAPOLATION_FACTOR * level * edge / at
        found = _bounds_by_torque(
            scenario, "a continuation of the highest octaves' lines", at, pull, on_output=on_output
        )
        yield replace(found, between=True, falling=True)


def _noise_bounds(scenario: Scenario, start: float, high: float) -> Iterator[OutOfBandLines]:
    """Bounds on what reads as a line between two frequencies [Hz] where friction is noisy: any is taken to
    have all of its noise there.
    """
    for key, (low, top) in noise_bands(scenario).items():
        first, last = max(start, low), min(high, top)
        if not first < last:
            continue
        frequency = np.linspace(first, last, _NOISE_POINTS)
        power = float(np.trapezoid(noise_density(scenario, frequency), frequency))
        at = np.union1d(_frequency_grid(scenario, first, last), [first, last])
        pull = np.full(at.size, _NOISE_SIGMAS * math.sqrt(2.0 * power))
        found = _bounds_by_torque(scenario, f"noise of {key}", at, pull, on_output=True)
        yield replace(found, between=True)
