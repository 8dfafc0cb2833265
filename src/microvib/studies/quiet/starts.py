"""Starts from which a drive may come to its rate: motions that coexist are reached from different
ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from microvib.analysis.start import not_moving_reason, not_sliding_reason
from microvib.errors import MicrovibError
from microvib.model.scenario import Scenario
from microvib.units import Si

FAST = 5.0
"""Times its rate at which a drive runs before it slows down to it."""
BEFORE = 4.0
"""Time [s] that a drive runs otherwise before it comes to its rate."""
QUARTER_TURN = 0.9
"""Full steps that the rotor is away from its command at the beginning."""


@dataclass(frozen=True)
class Start:
    """How a drive comes to its rate."""

    name: str
    change: Callable[[Scenario], dict[str, Any]]
    """Changes of the scenario, in SI."""

    def begun(self, scenario: Scenario) -> Scenario:
        """The scenario with this start; its record is as long after it as before."""
        changes = self.change(scenario)
        if not changes:
            return scenario
        return scenario.with_si(changes)


def _after(rate_before: float, scenario: Scenario) -> dict[str, Any]:
    """The rate after another one, to which a jump leads."""
    rate = scenario.tracking.rate
    assert rate is not None
    legs = [
        {"rate": Si(rate_before * rate), "hold": Si(BEFORE)},
        {"rate": Si(rate)},
    ]
    tracking = {"profile": legs, "clock_ratio": scenario.tracking.clock_ratio}
    settle = Si(scenario.record.settle + BEFORE)
    return {"tracking": tracking, "record.settle": settle}


STARTS = (
    Start("from rest", lambda scenario: {}),
    Start(f"from {FAST:g} times the rate", lambda scenario: _after(FAST, scenario)),
    Start("after a reversal", lambda scenario: _after(-1.0, scenario)),
    Start("from standstill under current", lambda scenario: _after(0.0, scenario)),
    Start(
        f"from rest, rotor {QUARTER_TURN:g} full steps ahead",
        lambda scenario: {"record.rotor_offset": QUARTER_TURN},
    ),
    Start(
        f"from rest, rotor {QUARTER_TURN:g} full steps behind",
        lambda scenario: {"record.rotor_offset": -QUARTER_TURN},
    ),
)
"""Starts that a design is judged from."""
SEARCHED = STARTS[:2]
"""Starts that a search looks at."""


def require_constant_rate(scenario: Scenario) -> None:
    """MicrovibError unless a drive runs at one rate from rest, as starts presume, and turns by the time of
    its record."""
    if scenario.tracking.rate is None:
        raise MicrovibError(
            "tracking.profile: a search for a quieter drive wants one rate; set tracking.rate, such"
            " as '0.06 deg/s'"
        )
    if not scenario.tracking.rate:
        raise MicrovibError("tracking.rate: is 0; a drive that does not turn makes no lines")
    if scenario.driver.pulsed:
        raise MicrovibError(
            "driver.drive: is pulse, of which no lines of a steady motion are searched for; current or"
            " voltage is expected"
        )
    if why := not_moving_reason(scenario) or not_sliding_reason(scenario):
        raise MicrovibError(f"the record begins too early for a search: {why}")
