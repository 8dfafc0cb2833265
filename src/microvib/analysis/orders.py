"""Orders of a stated step clock in one channel, such as an accelerometer's beside a stepper.

Without a scenario the step rate alone is known: all that it makes repeats with the electrical
period or an integer part of it. Lines at these orders are fitted together, as those of a scenario
are (``microvib.signals.line_fit``), and each is above its noise floor or is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from microvib.analysis.lines import CLOCK_TOLERANCE
from microvib.analysis.steadiness import with_excess
from microvib.errors import whole_number
from microvib.model.expected import ExpectedLine
from microvib.model.line_names import LineName, electrical_line
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.results import (
    COUNT,
    LINE_FREQUENCY,
    TORQUE,
    TORQUE_UNCERTAINTY,
    Column,
    Measure,
)
from microvib.signals.line_fit import NOT_SEPARABLE, SEPARATION, estimate_lines
from microvib.signals.line_table import BELOW_FLOOR, DETECTION_RATIO, Line, LineTable
from microvib.signals.tones import HannSpectrum
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import GivenQuantity, quantity

ABOVE_FLOOR, IN_FLOOR = "above the noise floor", "below the noise floor"
"""Findings on an order: whether a line is there at all."""
ORDER_HEIGHT = Measure(form=".3g")
_NEAR = 1.0
"""Bins about an order in which the highest is its height, where its line has no amplitude."""
MAX_ORDERS = 16
"""Orders of the electrical period that are looked for."""
FULL_STEPS = 4
"""Steps per electrical period without microsteps, of a two-phase motor."""


@dataclass(frozen=True)
class StepClock:
    """Steps per second, and how many of them make an electrical period."""

    rate: float
    """Steps, or microsteps, per second [Hz]."""
    steps_per_period: int = FULL_STEPS
    """Four times the microsteps per full step, of a two-phase motor."""

    @classmethod
    def stated(cls, rate: GivenQuantity, steps_per_period: int = FULL_STEPS) -> StepClock:
        """The clock of a step rate such as ``"4000 Hz"``; OptionError where it is none."""
        whole_number("steps_per_period", steps_per_period, 1, 1_000_000)
        return cls(quantity("step_rate", rate, "Hz", positive=True), steps_per_period)

    @classmethod
    def of(cls, scenario: Scenario) -> StepClock | None:
        """The clock of a scenario; None where its rate is zero or changes."""
        f_d = scenario.driving_frequency
        if not f_d:
            return None
        return cls(f_d, scenario.driver.beats * scenario.driver.microsteps)

    @property
    def electrical_frequency(self) -> float:
        """Electrical periods per second, f_e [Hz]."""
        return self.rate / self.steps_per_period


@dataclass(frozen=True)
class OrderLine:
    """A line at an order of the electrical period, in the unit of its channel."""

    order: Annotated[int, Column("order", "order of f_e", COUNT)]
    frequency: Annotated[float, Column("frequency_hz", "frequency", LINE_FREQUENCY)]
    """Found [Hz], or expected where no clock is seen."""
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    uncertainty: Annotated[float, Column("amplitude_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    """Standard uncertainty, from the floor about the line."""
    bin_amplitude: Annotated[float, Column("bin_amplitude_n_m", "nearest bin", TORQUE)]
    """Amplitude of the nearest bin of a rectangular window."""
    floor: Annotated[float, Column("floor_n_m", "floor", TORQUE_UNCERTAINTY)]
    above: Annotated[float, Column("times_floor", "times the floor", ORDER_HEIGHT)]
    """Height over the floor."""
    finding: Annotated[str, Column("finding", "finding")]
    """Whether it is above its noise floor, or why that is not known."""


def lines_at_orders(recording: Recording, channel: str, clock: StepClock) -> LineTable:
    """Lines of a usable ``channel`` at the orders of a step ``clock``, and all others above the floor.

    The clock is searched within CLOCK_TOLERANCE of the stated one, for recorder and driver count
    time by clocks of their own. RecordingError where the record holds too few electrical periods to
    tell one order from the next, or none is in its passband.
    """
    f_e, highest = clock.electrical_frequency, PASSBAND * recording.sample_rate
    count = min(int(highest / ((1.0 + CLOCK_TOLERANCE) * f_e)), MAX_ORDERS)
    if count < 1:
        raise RecordingError(
            f"{recording.title}: channel {channel} shows lines up to {highest:.4g} Hz, and the"
            f" electrical period repeats at {f_e:.4g} Hz; a higher sample rate is needed"
        )
    periods = f_e * recording.duration
    if periods < SEPARATION:
        raise RecordingError(
            f"{recording.title}: channel {channel} lasts {recording.duration:.4g} s, which is"
            f" {periods:.2g} electrical periods of {1.0 / f_e:.4g} s; its orders are told apart from"
            f" {SEPARATION:g} periods on, {SEPARATION / f_e:.4g} s"
        )
    return _lines(recording, channel, [_expected(k, clock) for k in range(1, count + 1)])


def lines_without_clock(recording: Recording, channel: str) -> LineTable:
    """All lines of a usable ``channel`` that stand above the floor, without names."""
    return _lines(recording, channel, ())


def _lines(recording: Recording, channel: str, expected: Sequence[ExpectedLine]) -> LineTable:
    x = recording[channel]
    table = with_excess(estimate_lines(x, recording.sample_rate, expected), x)
    source = f"{channel} of {recording.name}"
    return replace(table, unit=recording.units[channel], source=source, harmonics=len(expected))


def _expected(order: int, clock: StepClock) -> ExpectedLine:
    f = order * clock.electrical_frequency
    low, high = (1.0 - CLOCK_TOLERANCE) * f, (1.0 + CLOCK_TOLERANCE) * f
    if order % clock.steps_per_period:
        origin = f"electrical period, order {order}"
    else:
        origin = f"electrical period, order {order}: {order // clock.steps_per_period} x step rate"
    return ExpectedLine(electrical_line(order), "electrical", f, low, high, origin)


def order_lines(table: LineTable, x: np.ndarray) -> tuple[OrderLine, ...]:
    """The orders of a table of ``lines_at_orders`` of the samples ``x`` (n,), from the first on.

    An order may also be above the floor that has no amplitude of its own, as of a line that comes and goes.
    """
    spectrum = HannSpectrum.of(x - x.mean(), table.sample_rate)
    return tuple(_order_line(line, spectrum) for line in table if line.of_clock)


def _order_line(line: Line, spectrum: HannSpectrum) -> OrderLine:
    ok = math.isfinite(line.amplitude)
    place = line.place
    floor = line.floor if ok else spectrum.floor(place)
    height = line.amplitude if ok else spectrum.height(place, _NEAR)
    above = height / floor if floor > 0.0 else math.nan
    return OrderLine(
        LineName.parse(line.name).order,
        place,
        line.amplitude,
        line.amplitude_uncertainty if ok else math.nan,
        line.bin_amplitude,
        floor,
        above,
        _finding(line, above),
    )


def _finding(line: Line, above: float) -> str:
    """Finding on an order that is so many times ``above`` its floor."""
    if line.status == BELOW_FLOOR or above <= DETECTION_RATIO:
        return IN_FLOOR
    if line.seen:
        return ABOVE_FLOOR
    if line.status.startswith(NOT_SEPARABLE):
        return f"{ABOVE_FLOOR}; {line.status}"
    return line.status
