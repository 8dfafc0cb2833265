"""What may stand above the highest frequency that a record shows, line by line, and how large it may be at most.

Of what the step clock makes, the linearised drive says how large it gets from what pulls at the rotor: the command's staircase and
its side lines, the detent torque, errors of the driver. What goes on from the highest octave of the record does so no stronger than
there, through the same drive. Lines of a gear train's errors are not bounded by any model here, those of friction by its breakaway.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from microvib.analysis.margins import BEYOND
from microvib.analysis.start import CALM, calm_for
from microvib.model.driven import noise_bands, response
from microvib.model.expected import SIDEBANDS, angle_errors
from microvib.model.linear import coupled_modes, dynamic_stiffness, linear_lines, momentum_row, pulls
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.line_table import LineTable

CONTINUES = 3.0
"""Factor on what stands in the highest octave of a record for what may stand above it, beside what the drive amplifies."""
_MAX_ORDERS = 5000
_MOST = 600
"""Frequencies at which one family of lines is looked at: all of its lines, or those near modes and others spread evenly."""
_MANY = 60
"""Modes from which a tenth of that is enough of a wait."""


@dataclass(frozen=True)
class Unseen:
    """Lines of one cause above the record's passband, and how large they may be; infinite where nothing bounds them."""

    what: str
    """One of them, without its frequency."""
    frequency: np.ndarray
    """[Hz], (n,), ascending."""
    most: np.ndarray
    """[N m], 0-to-peak, (n,)."""


def unseen(scenario: Scenario, table: LineTable, start: float, high: float) -> Iterator[Unseen]:
    """What the drive of ``scenario`` may have between ``start``, the edge of the passband of the record, and ``high`` [Hz].

    ``table`` has the lines of the record.
    """
    modes = [m for m in coupled_modes(scenario) if start < m.frequency <= high]
    yield from _of_clock(scenario, start, high)
    yield _going_on(scenario, table, start, high)
    yield from _by_noise(scenario, start, high)
    if any(x.status == TRANSIENT for x in table):  # in the steady state nothing rings
        return
    held = scenario.friction.breakaway_torque + scenario.reducer.ratio * scenario.motor.friction.breakaway_torque
    if held > 0.0:
        for mode in modes:
            size = 4.0 / math.pi * held * abs(response(scenario, mode.frequency))
            yield Unseen(f"stick and slip of {mode.name}", np.array([mode.frequency]), np.array([size]))
    for mode in modes:
        if mode.damping > 0.0 and mode.decay * calm_for(scenario) < CALM:
            yield Unseen(f"ringing of {mode.name}", np.array([mode.frequency]), np.array([math.inf]))


def _of_clock(scenario: Scenario, start: float, high: float) -> Iterator[Unseen]:
    """What the step clock makes: driving lines and their side lines, full-step and electrical lines, lines of the gear train."""
    f_d, motor, driver = scenario.driving_frequency, scenario.motor, scenario.driver
    if not f_d:
        return
    electrical = f_d / (driver.beats * driver.microsteps)
    detent = electrical * motor.detent_periods
    fastest = max((m.frequency for m in coupled_modes(scenario)), default=0.0)
    end = min(2.0 * max(start, fastest) + 20.0 * f_d, high)
    count = min(math.ceil(end / f_d) + 1, _MAX_ORDERS)
    found = [x for x in linear_lines(scenario, count) if start < x.frequency <= high]
    if found:
        yield Unseen(
            "a driving line", np.array([x.frequency for x in found]), BEYOND * np.abs([x.amplitude for x in found])
        )
    if motor.detent_torque > 0.0:
        orders = np.arange(1, count + 1)
        k = np.tile(orders, 2 * SIDEBANDS)
        side = np.repeat([j for j in range(-SIDEBANDS, SIDEBANDS + 1) if j], orders.size)
        yield _pulled(
            scenario, "a side line of a driving line", k * f_d + side * detent, np.abs(pulls(scenario, k)), start, high
        )
        m = np.arange(1, min(math.ceil(end / detent) + 1, _MAX_ORDERS))
        yield _pulled(scenario, "a full-step line", m * detent, motor.detent_torque / m, start, high)
    errors = angle_errors(driver, motor.phases)
    if errors:
        at = np.array([e.order * electrical for e in errors])
        pull = np.array([e.amplitude for e in errors]) * motor.electromagnetic_stiffness / motor.rotor_teeth
        yield _pulled(scenario, "an electrical line", at, pull, start, high)
    turn = driver.beats * driver.microsteps * motor.rotor_teeth
    for e in scenario.reducer.errors:
        f = float(e.order) * f_d / turn
        if e.amplitude > 0.0 and start < f <= high:
            yield Unseen(e.line, np.array([f]), np.array([math.inf]))


def _pulled(
    scenario: Scenario, what: str, frequency: np.ndarray, pull: np.ndarray, start: float, high: float
) -> Unseen:
    """Lines at each ``frequency`` (n,) [Hz] that torques ``pull`` (n,) [N m] on the rotor make, BEYOND times."""
    there = np.flatnonzero((frequency > start) & (frequency <= high))
    there = there[np.argsort(frequency[there], kind="stable")]
    kept = there[_chosen(scenario, frequency[there])]
    return Unseen(what, frequency[kept], BEYOND * pull[kept] * _by_rotor(scenario, frequency[kept]))


def _chosen(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """Which of the frequencies (n,), ascending, are looked at, where there are many: those next to modes, and others."""
    modes = np.array([m.frequency for m in coupled_modes(scenario)])
    many = _MOST if modes.size < _MANY else _MOST // 10
    if frequency.size <= many:
        return np.arange(frequency.size)
    near = np.searchsorted(frequency, modes[:, None]) + np.arange(-2, 3)
    even = np.linspace(0, frequency.size - 1, many // 2).astype(int)
    return np.unique(np.clip(np.append(near, even), 0, frequency.size - 1))


def _by_rotor(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """T_d over a torque on the rotor at each ``frequency`` (n,) [Hz], by the linearised drive."""
    return _by_torque(scenario, frequency, 0, 1.0)


def _by_output(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """T_d over a torque on the output at each ``frequency`` (n,) [Hz], by the linearised drive."""
    if scenario.reducer.rigid:
        return _by_torque(scenario, frequency, 0, 1.0 / abs(scenario.reducer.h))
    return _by_torque(scenario, frequency, 1, 1.0)


def _by_torque(scenario: Scenario, frequency: np.ndarray, coordinate: int, torque: float) -> np.ndarray:
    """Size of T_d at each ``frequency`` (n,) [Hz] by a ``torque`` [N m] on one coordinate of the linearised drive."""
    if not frequency.size:
        return np.zeros(0)
    dynamic = dynamic_stiffness(scenario, frequency)
    pull = torque * np.eye(dynamic.shape[-1])[:, [coordinate]]
    motion = np.linalg.solve(dynamic, np.broadcast_to(pull, (*dynamic.shape[:-1], 1)))[..., 0]
    moved = np.sum(momentum_row(scenario, frequency) * motion, axis=-1)
    return np.asarray((2.0 * math.pi * frequency) ** 2 * np.abs(moved))


def _going_on(scenario: Scenario, table: LineTable, start: float, high: float) -> Unseen:
    """What stands in the highest octave of the record, as torques on rotor or output would carry it on.

    Such torques have jumps at most, whose lines fall as their frequency rises.
    """
    edge = PASSBAND * table.sample_rate
    known = [(x.place_hz, max(x.amplitude_n_m, x.hidden_n_m)) for x in table if math.isfinite(x.amplitude_n_m)]
    if table.rest is not None:
        known += zip(table.rest.frequency.tolist(), table.rest.amplitude.tolist(), strict=True)
    octave = np.array([row for row in known if 0.5 * edge <= row[0] <= edge]).reshape(-1, 2)
    modes = np.array([m.frequency for m in coupled_modes(scenario)])
    end = min(2.0 * max(start, modes.max(initial=0.0)), high)
    even = np.geomspace(start, end, 50 if modes.size < _MANY else 10)
    at = np.union1d(even, modes[(modes > start) & (modes < end)])
    most = np.zeros(at.size)
    for by in (_by_rotor, _by_output):
        level = np.max(octave[:, 1] / np.maximum(by(scenario, octave[:, 0]), 1e-300), initial=0.0)
        most = np.maximum(most, CONTINUES * level * by(scenario, at) * edge / at)
    return Unseen("a line of what the highest octave has", at, most)


def _by_noise(scenario: Scenario, start: float, high: float) -> Iterator[Unseen]:
    """Modes that noise of the output's friction drives."""
    for mode in coupled_modes(scenario):
        for key, (low, top) in noise_bands(scenario).items():
            if max(start, low) < mode.frequency <= min(high, top):
                yield Unseen(f"{mode.name}, which {key} drives,", np.array([mode.frequency]), np.array([math.inf]))
