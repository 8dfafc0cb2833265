"""Parameters that are fitted: by which key, within which range."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microvib.errors import MicrovibError, OptionError, did_you_mean
from microvib.model.scenario import Scenario
from microvib.units import Quantity, convert

RANGE_FACTOR, FREQUENCY_RANGE_FACTOR = 4.0, 1.1
"""How far a range of ours reaches each way from the scenario's value, and by how much it is widened
each way.
"""
MAX_WIDENINGS = 3
"""How often a range of ours is widened at most; local fits may go as far from the beginning."""
BOUND_MARGIN = 0.05
"""Part of a range at each of its ends within which a best value is not in its inside."""
DAC_BITS = "driver.imperfections.dac_bits"
DEFAULT_INTEGER_RANGES = {DAC_BITS: (4, 14)}
"""Whole numbers that are tried where no range is stated."""
MAX_INTEGERS = 32
"""Whole numbers that are tried at most."""
_SETTINGS = {"record.duration", "record.sample_rate"}
"""Keys that the recording sets."""


@dataclass(frozen=True)
class FitKey:
    """A parameter that is fitted, by its dotted key, within a range in SI units.

    A fit moves it by a coordinate: the logarithm of the value where the range is positive, else the
    value over the range's width.
    """

    key: str
    low: float
    high: float
    unit: str
    stated: bool = True
    """Whether the user stated the range; one that is ours is widened where the best lies at its
    end.
    """
    along: bool = False
    """Whether it is fitted as well without being asked for."""
    factor: float = RANGE_FACTOR
    """By how much a range of ours is widened each way."""
    floor: float = 0.0
    ceiling: float = math.inf
    """Between which a range of ours may be widened at all."""
    test: int | None = None
    """Number of the recording whose own it is; None where all share one value."""
    recording: str = ""
    """That recording's name."""
    around: float = 0.0
    """Value that a range of ours was made about."""
    periodic: bool = False
    """Whether it is a phase that may have any value, the range being one turn."""

    @property
    def label(self) -> str:
        """The key, and the recording whose own it is."""
        if self.recording:
            return f"{self.key} [{self.recording}]"
        return self.key

    @property
    def logarithmic(self) -> bool:
        """Positive ranges are fitted by their logarithm."""
        return self.low > 0.0

    @property
    def is_phase(self) -> bool:
        """Whether it is a phase: an angle, of which 0 is a value like any other."""
        return self.key.endswith(".phase")

    def relative_to(self, value: float) -> float:
        """Size that changes of a value are relative to: the value, or 1 rad for a phase."""
        if self.is_phase:
            return 1.0
        return value

    def coordinate(self, value: float) -> float:
        """The coordinate of a value; a value that has no logarithm counts as the lower end."""
        if self.logarithmic:
            return math.log(value if value > 0.0 else self.low)
        return value / (self.high - self.low)

    def value(self, x: float) -> float:
        """The value at a coordinate."""
        if self.logarithmic:
            return math.exp(x)
        return x * (self.high - self.low)

    def slope(self, value: float) -> float:
        """Derivative of the value by its coordinate."""
        if self.logarithmic:
            return value
        return self.high - self.low

    @property
    def range(self) -> tuple[float, float]:
        """Coordinates of the range."""
        return self.coordinate(self.low), self.coordinate(self.high)

    @property
    def span(self) -> float:
        """Width of the range that it began with, in the coordinate."""
        low, high = self.range
        if self.stated:
            return high - low
        return 2.0 * math.log(self.factor)

    @property
    def reach(self) -> tuple[float, float]:
        """Coordinates between which a local fit may move: a stated range, or as far as ours would
        be widened at most.
        """
        if self.periodic:
            low, high = self.range
            return 2.0 * low, 2.0 * high
        if self.stated:
            return self.range
        far = self.factor**MAX_WIDENINGS
        return self.coordinate(max(self.low / far, self.floor)), self.coordinate(
            min(self.high * far, self.ceiling)
        )

    def interior(self, x: float) -> bool:
        """Whether a coordinate lies inside the range, off its ends."""
        if self.periodic:
            return True
        low, high = self.range
        rim = (1e-3 if self.stated else BOUND_MARGIN) * (high - low)
        return low + rim < x < high - rim

    def as_begun(self) -> FitKey:
        """With the range that it began with, where that is ours and was widened."""
        if self.stated:
            return self
        low, high = self.around / self.factor, self.around * self.factor
        return replace(self, low=max(self.low, low), high=min(self.high, high))

    def widened(self) -> FitKey:
        """With a range that reaches further both ways, where it is ours."""
        if self.stated:
            return self
        low, high = (
            max(self.low / self.factor, self.floor),
            min(self.high * self.factor, self.ceiling),
        )
        return replace(self, low=low, high=high)


@dataclass(frozen=True)
class IntegerKey:
    """A whole number that is sought among ``low`` to ``high``, each of which is tried."""

    key: str
    low: int
    high: int

    @property
    def numbers(self) -> range:
        """All of them."""
        return range(self.low, self.high + 1)


def parse_key(scenario: Scenario, text: str) -> FitKey | IntegerKey:
    """Parse a key as ``parse_fit`` does, or a whole number, ``KEY=LOW:HIGH``; the driver's bits without a
    range, too.
    """
    key, _, span = (part.strip() for part in text.partition("="))
    value = {name: value for name, value, _ in scenario.entries()}.get(key)
    if key != DAC_BITS and (not isinstance(value, int) or isinstance(value, bool)):
        return parse_fit(scenario, text)
    if not span and key not in DEFAULT_INTEGER_RANGES:
        raise OptionError("fit", f"is an integer; give its range, {key}=LOW:HIGH", key)
    if span:
        low, high = _whole(text, span)
    else:
        low, high = DEFAULT_INTEGER_RANGES[key]
    _check_fittable(scenario, key, value)
    for end in (low, high):
        try:
            scenario.with_si({key: end})
        except MicrovibError as error:
            raise OptionError("fit", str(error), text) from None
    return IntegerKey(key, low, high)


def _whole(text: str, span: str) -> tuple[int, int]:
    first, _, last = (part.strip() for part in span.partition(":"))
    if not (
        first.isdecimal()
        and last.isdecimal()
        and int(first) < int(last) < int(first) + MAX_INTEGERS
    ):
        raise OptionError(
            "fit",
            f"write KEY=LOW:HIGH with whole numbers, LOW below HIGH, and at most {MAX_INTEGERS} of"
            " them",
            text,
        )
    return int(first), int(last)


def parse_fit(scenario: Scenario, text: str) -> FitKey:
    """``KEY`` or ``KEY=LOW:HIGH`` with units; without a range a factor of four each way, ten per
    cent for a frequency.

    What may be of either sign is fitted within its usual sizes to both sides of zero, or a factor
    of four beyond its value; a phase may have any value.
    """
    key, _, span = text.partition("=")
    key = key.strip()
    entries = {name: (value, quantity) for name, value, quantity in scenario.entries()}
    off = next(
        (
            name
            for name, (value, _) in entries.items()
            if value is None and key.startswith(f"{name}.")
        ),
        None,
    )
    if off is not None:
        raise OptionError(
            "fit",
            f"the scenario has no {off}; give it one to start from, {off}.KEY=...",
            key,
            remedy="set",
        )
    if key not in entries:
        allowed = fittable(scenario)
        near = did_you_mean(key, allowed)
        raise OptionError(
            "fit", f"is not a key of the scenario; {near}allowed are {', '.join(allowed)}", key
        )
    value, quantity = entries[key]
    if quantity is None or not isinstance(value, float):
        raise OptionError(
            "fit",
            f"is {value!r}, not a number; start it from a number, {key}=...",
            key,
            remedy="set",
        )
    _check_fittable(scenario, key, value)
    if span:
        return _stated(text, key, span, quantity)
    if key.endswith(".phase"):
        return FitKey(key, -math.pi, math.pi, quantity.unit, periodic=True)
    if quantity.usual is not None and quantity.ge is not None and quantity.ge < 0.0:
        far = max(quantity.usual[1], RANGE_FACTOR * abs(value))
        return FitKey(key, max(-far, quantity.ge), min(far, quantity.le or far), quantity.unit)
    if value <= 0.0:
        raise OptionError(
            "fit", f"starts at {value:g}; give its range as {key}=LOW:HIGH in {quantity.unit}", key
        )
    return range_around(key, value, quantity)


def range_around(key: str, value: float, quantity: Quantity, along: bool = False) -> FitKey:
    """A range of ours about a value, to be widened where it turns out too narrow."""
    if key.endswith("frequency"):
        factor = FREQUENCY_RANGE_FACTOR
    else:
        factor = RANGE_FACTOR
    floor = max(quantity.ge or 0.0, quantity.gt or 0.0, 1e-300)
    if quantity.le is None:
        ceiling = math.inf
    else:
        ceiling = quantity.le
    low, high = max(value / factor, floor), min(value * factor, ceiling)
    return FitKey(key, low, high, quantity.unit, False, along, factor, floor, ceiling, around=value)


def _stated(text: str, key: str, span: str, quantity: Quantity) -> FitKey:
    first, colon, last = span.partition(":")
    write = f"write KEY=LOW:HIGH with units ({quantity.unit})"
    try:
        low, high = [convert(part, quantity.unit) for part in (first, last)]
    except ValueError as error:
        raise OptionError("fit", f"{error}; {write}", text) from None
    if not colon or not low < high:
        raise OptionError("fit", f"LOW must be below HIGH; {write}", text)
    return FitKey(key, low, high, quantity.unit)


def _check_fittable(scenario: Scenario, key: str, value: object) -> None:
    """Refuse what the recording itself gives, and what is not a property of the drive."""
    if key in _SETTINGS:
        raise OptionError("fit", "belongs to the recording and is not fitted", key)
    if key.startswith("solver."):
        raise OptionError(
            "fit", "is a setting of the solver, not a property of the drive, and is not fitted", key
        )
    if changes_clock_rate(scenario, key, value):
        text = (
            "sets the step clock, which the recording's lines give far more precisely "
            "than a fit: the clock is measured, and this key is not fitted; change it instead"
        )
        raise OptionError("fit", text, key, remedy="set")


def changes_clock_rate(scenario: Scenario, key: str, value: object) -> bool:
    """Whether the step clock, microsteps per second, changes with a key."""
    if key == "tracking.clock_ratio":
        return True
    if isinstance(value, float):
        other: float = value * 1.001 if value else 1e-3
    elif isinstance(value, int):
        other = 2 * value
    else:
        return False
    try:
        moved = scenario.with_si({key: other})
    except MicrovibError:
        return False
    return moved.driving_frequency != scenario.driving_frequency


def fittable(scenario: Scenario) -> list[str]:
    """Keys that can be fitted."""
    numbers = {
        name: value
        for name, value, q in scenario.entries()
        if q is not None and isinstance(value, float)
    }
    drive = (name for name in numbers if name not in _SETTINGS and not name.startswith("solver."))
    return [name for name in drive if not changes_clock_rate(scenario, name, numbers[name])]
