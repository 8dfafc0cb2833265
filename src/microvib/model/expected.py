"""Which lines the physics predicts in the disturbance torque, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.units import Given, quantity

Kind = Literal["array mode", "drive", "full step", "electrical", "wave generator", "sideband", "other"]

SIDEBANDS = 2  # sidebands on each side of a driving line, at full-step distance, that are expected


@dataclass(frozen=True)
class ExpectedLine:
    """An expected line: its name, its frequency and the band to search [Hz]."""

    name: str
    kind: Kind
    frequency: float
    low: float
    high: float
    origin: str


def expected_lines(
    scenario: Scenario, highest: Given, harmonics: int = 8, clock_tolerance: float = 0.0, mode_tolerance: float = 0.0
) -> tuple[ExpectedLine, ...]:
    """Lines up to ``highest``, a frequency: array modes as seen through the drive, and all that the step clock makes.

    Of the clock there are, each with up to ``harmonics`` members: the driving frequency f_d (Eq. 26); the detent period
    4 f_d/(b n), which with four beats is the full-step rate f_d/n; the electrical period f_d/(b n); the wave generator's
    turns, for each transmission-error harmonic; and the sidebands that the detent torque makes about the driving lines. A
    frequency that belongs to several families carries the name of the first. Where the rate changes within the record, or is
    zero, there are modes only.

    ``clock_tolerance`` and ``mode_tolerance`` widen the bands that are searched, as fractions of the frequency: zero for a
    simulation, whose clock is known, a per cent for a test.
    """
    highest = quantity("highest", highest, "Hz")
    modes = [
        replace(line, low=line.low * (1.0 - mode_tolerance), high=line.high * (1.0 + mode_tolerance))
        for line in _array_lines(scenario, highest)
    ]
    f_d = scenario.driving_frequency
    if not f_d:
        return tuple(modes)
    driver, motor = scenario.driver, scenario.motor
    errors = tuple(e.order for e in scenario.reducer.transmission_error)
    turn, orders = _orders(
        driver.microsteps, driver.beats, motor.rotor_teeth, motor.detent_torque > 0.0, errors, harmonics
    )
    base, low, high = f_d / turn, 1.0 - clock_tolerance, 1.0 + clock_tolerance
    clock = [
        ExpectedLine(name, kind, order * base, low * (order * base), high * (order * base), origin)
        for order, (name, kind, origin) in orders.items()
        if order * base <= highest
    ]
    return (*modes, *clock)


@lru_cache(maxsize=64)
def _orders(
    n: int, b: int, z: int, detent_torque: bool, errors: tuple[int, ...], harmonics: int
) -> tuple[int, dict[int, tuple[str, Kind, str]]]:
    """Microsteps per turn of the wave generator, in which every line of the clock has a whole order; and name, kind and origin of
    the line of each order, that of the first family where several have it."""
    turn = b * n * z
    detent = (
        4 * z
    )  # order of the detent torque, sin(4 z theta_m): a quarter electrical turn, for four beats a full step
    families: list[tuple[str, Kind, int, Sequence[int], str]] = [
        ("drive", "drive", turn, range(1, harmonics + 1), "microstep"),
        ("full_step", "full step", detent, range(1, harmonics + 1), "full step" if b == 4 else "detent period"),
        ("electrical", "electrical", z, (1, 2, 3), "electrical period"),
        ("wave_generator", "wave generator", 1, errors, "transmission error"),
    ]
    orders: dict[int, tuple[str, Kind, str]] = {}
    for stem, kind, unit, members, origin in families:
        for k in members:
            orders.setdefault(k * unit, (f"{stem}_{k}", kind, f"{origin}, order {k}"))
    if detent_torque and turn > 2 * SIDEBANDS * detent:
        for k in range(1, harmonics + 1):
            for j in (j for m in range(1, SIDEBANDS + 1) for j in (-m, m)):
                name = f"drive_{k}_{'plus' if j > 0 else 'minus'}_{abs(j)}"
                orders.setdefault(k * turn + j * detent, (name, "sideband", f"drive_{k} {j:+d} full step"))
    return turn, orders


def _array_lines(scenario: Scenario, highest: float) -> list[ExpectedLine]:
    lines = []
    for mode in coupled_modes(scenario):
        if mode.fixed_frequency is None or mode.frequency > highest:
            continue
        # While the shaft sticks the mode is at its clamped frequency, while it slips at the coupled one.
        low, high = sorted((mode.frequency, mode.fixed_frequency))
        if high > 1.1 * low:  # above the hub's resonance they lie far apart, with other lines between
            low = high = mode.frequency
        origin = f"clamped {mode.fixed_frequency:.4g} Hz, seen through the drive"
        lines.append(ExpectedLine(mode.name, "array mode", mode.frequency, low, high, origin))
    return lines
