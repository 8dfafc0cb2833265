"""Whether drives that are given as scenarios of their own are on one craft: each must carry the
arrays of the others, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.coupling import require_craft
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import DRIVE_GROUPS, SAME_POINT_DISTANCE, Interface

_NEAR = 1e-6
"""Distance of unit vectors, and of angles [rad], up to which they are the same."""
MAX_ARRAYS = 2
"""Largest number of arrays on a spacecraft."""
_INSTEAD = "or give one scenario of both with spacecraft.second_wing.drive: driven"


def check_places(name: str, scenario: Scenario, other_name: str, other: Scenario) -> None:
    """MicrovibError where two drives are at one interface point."""
    here, there = (require_craft(one).spacecraft.interface for one in (scenario, other))
    if _distance(here, there) <= SAME_POINT_DISTANCE:
        at = ", ".join(f"{x:g}" for x in here.position)
        raise MicrovibError(
            f"{name}: spacecraft.interface.position: [{at}] m is also where {other_name} is; two"
            " drives need places of their own"
            " (a second wing that is driven is not given once more as a scenario)"
        )


def lacking(scenario: Scenario, other_name: str, other: Scenario) -> Iterator[str]:
    """Sentence on the array of an ``other`` drive that the spacecraft of a drive lacks, "
    "which changes how the hub moves; without a stop."""
    mounted = scenario.mounted
    if mounted is None:
        wing = None
    else:
        wing = mounted.second_wing
    theirs = require_craft(other).spacecraft
    if wing is None or _distance(wing.interface, theirs.interface) > SAME_POINT_DISTANCE:
        yield (
            f"the hub is without the array of {other_name}, which changes how it moves; put"
            " each wing into"
            f" spacecraft.second_wing of the other's scenario, {_INSTEAD}"
        )
        return
    unlike = [f"spacecraft.second_wing.{key}" for key in _unlike(scenario, other)]
    if unlike:
        yield f"{', '.join(unlike)}: differs from that of {other_name}; use the value of that scenario, {_INSTEAD}"


def number_of_arrays(scenarios: Iterable[Scenario]) -> int:
    """How many arrays there are on the crafts of drives, those at one place counted once."""
    places: list[Interface] = []
    for scenario in scenarios:
        spacecraft = require_craft(scenario).spacecraft
        wing = spacecraft.second_wing
        for one in (spacecraft.interface, *(() if wing is None else (wing.interface,))):
            if all(_distance(one, other) > SAME_POINT_DISTANCE for other in places):
                places.append(one)
    return len(places)


def too_many_arrays(number: int) -> str:
    """Why nothing is judged with more arrays than a craft has, and what to do; without a stop."""
    return (
        f"the scenarios have {number} arrays, and a spacecraft has at most two here (make the "
        "others part of the hub, spacecraft.hub.modes from finite"
        " elements with their arrays on it, and give the motion from their drives as lines in a file of sources)"
    )


def _unlike(scenario: Scenario, other: Scenario) -> Iterator[str]:
    """Keys in which the second wing on the craft of a drive is not the wing of an ``other`` drive;
    friction apart, whose noise has a new seed for each."""
    mounted, theirs = scenario.mounted, require_craft(other).spacecraft
    if mounted is None:
        wing = None
    else:
        wing = mounted.second_wing
    assert wing is not None
    if not _turned_alike(wing.interface, theirs.interface):
        yield "interface"
    if (
        wing.array_angle is None
        or abs(np.exp(1j * (wing.array_angle - theirs.array_angle)) - 1.0) > _NEAR
    ):
        yield "array_angle"
    for key in DRIVE_GROUPS:
        mine, given = getattr(wing, key), getattr(other, key)
        if (
            key == "driver" and mine is not None
        ):  # when it steps makes no difference to how it holds
            mine = mine.model_copy(update={"delay": given.delay})
        if key != "friction" and mine != given:
            yield key


def _distance(one: Interface, other: Interface) -> float:
    return float(np.linalg.norm(np.subtract(one.position, other.position)))


def _turned_alike(one: Interface, other: Interface) -> bool:
    """Whether two interfaces have one drive axis and one reference."""
    along, across = (np.array(x.reference) / np.linalg.norm(x.reference) for x in (one, other))
    return bool(
        np.linalg.norm(one.axis - other.axis) <= _NEAR and np.linalg.norm(along - across) <= _NEAR
    )
