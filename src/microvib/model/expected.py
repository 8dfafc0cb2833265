"""Which lines the physics puts into the disturbance torque, and where."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario

Kind = Literal["array mode", "drive", "full step", "electrical", "wave generator", "sideband", "other"]

SIDEBANDS = 2
"""Sidebands on each side of a driving line, at full-step distance, that are looked for."""


@dataclass(frozen=True)
class ExpectedLine:
    """A line that is looked for: its name, where it should be and how far to search about there [Hz]."""

    name: str
    kind: Kind
    frequency: float
    low: float
    high: float
    origin: str


def expected_lines(
    scenario: Scenario, highest: float, harmonics: int = 8, clock_tolerance: float = 0.0, mode_tolerance: float = 0.0
) -> tuple[ExpectedLine, ...]:
    """Lines up to ``highest`` [Hz]: array modes as seen through the drive, and all that the step clock makes.

    Of the clock there are, each with up to ``harmonics`` members: the driving frequency f_d (Eq. 26); the detent period
    4 f_d/(b n), which with four beats is the full-step rate f_d/n; the electrical period f_d/(b n); the wave generator's
    turns, for each transmission-error harmonic; and the sidebands that the detent torque makes about the driving lines. A
    frequency that belongs to several families carries the name of the first. Where the rate changes within the record, or is
    zero, there are modes only.

    ``clock_tolerance`` and ``mode_tolerance`` widen the bands that are searched, as fractions of the frequency: zero for a
    simulation, whose clock is known, a per cent for a test.
    """
    lines = [
        replace(line, low=line.low * (1.0 - mode_tolerance), high=line.high * (1.0 + mode_tolerance))
        for line in _array_lines(scenario, highest)
    ]
    f_d = scenario.driving_frequency
    if not f_d:
        return tuple(lines)
    n, b, z = scenario.driver.microsteps, scenario.driver.beats, scenario.motor.rotor_teeth
    turn = b * n * z  # microsteps per turn of the wave generator, in which every line of the clock has a whole order
    detent = (
        4 * z
    )  # order of the detent torque, sin(4 z theta_m): a quarter electrical turn, for four beats a full step
    families: list[tuple[str, Kind, int, list[int], str]] = [
        ("drive", "drive", turn, list(range(1, harmonics + 1)), "microstep"),
        ("full_step", "full step", detent, list(range(1, harmonics + 1)), "full step" if b == 4 else "detent period"),
        ("electrical", "electrical", z, [1, 2, 3], "electrical period"),
    ]
    orders = [e.order for e in scenario.reducer.transmission_error]
    if orders:
        families.append(("wave_generator", "wave generator", 1, orders, "transmission error"))
    taken: set[int] = set()
    for stem, kind, unit, members, origin in families:
        for k in members:
            _add(lines, taken, f"{stem}_{k}", kind, k * unit, f_d / turn, highest, f"{origin}, order {k}")
    if scenario.motor.detent_torque > 0.0 and turn > 2 * SIDEBANDS * detent:
        for k in range(1, harmonics + 1):
            for j in (j for m in range(1, SIDEBANDS + 1) for j in (-m, m)):
                name = f"drive_{k}_{'plus' if j > 0 else 'minus'}_{abs(j)}"
                _add(
                    lines,
                    taken,
                    name,
                    "sideband",
                    k * turn + j * detent,
                    f_d / turn,
                    highest,
                    f"drive_{k} {j:+d} full step",
                )
    low, high = 1.0 - clock_tolerance, 1.0 + clock_tolerance
    return tuple(
        line if line.kind == "array mode" else replace(line, low=low * line.frequency, high=high * line.frequency)
        for line in lines
    )


def _add(
    lines: list[ExpectedLine],
    taken: set[int],
    name: str,
    kind: Kind,
    order: int,
    base: float,
    highest: float,
    origin: str,
) -> None:
    """Add the line of one order of the wave generator's turns, unless that order has a name already."""
    frequency = order * base
    if order not in taken and frequency <= highest:
        taken.add(order)
        lines.append(ExpectedLine(name, kind, frequency, frequency, frequency, origin))


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
