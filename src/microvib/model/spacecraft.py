"""The spacecraft that carries the drive: hub, where and how arrays sit on it, attitude control,
line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from microvib.model.array import Array
from microvib.model.driver import Driver
from microvib.model.friction import Friction
from microvib.model.motor import Motor
from microvib.model.part import Part, Six
from microvib.model.reducer import Reducer
from microvib.model.rigid import (
    Direction,
    Inertia,
    Position,
    inertia_error,
    perpendicular_unit_vector,
    tensor,
)
from microvib.model.tracking import Tracking
from microvib.units import Quantity

PERPENDICULAR_TOLERANCE = 1e-3
"""Cosine of the angle between the drive axis and ``reference`` up to which they count as
perpendicular; the rest is taken out.
"""
ROUNDING = 1e-6
"""Part of the own damping of a hub's modes that is rounding."""
SAME_POINT_DISTANCE = 1e-3
"""Distance [m] within which a point with known shapes is the interface point."""
INTERFACE, CENTER = "interface", "center"
"""Names of points that every hub has: the interface point, and its centre of mass."""
SECOND_INTERFACE = "second_interface"
"""Name of the interface point of a second wing."""
DRIVE_GROUPS = ("motor", "driver", "reducer", "friction", "array")
"""Groups of a scenario that are a drive and its array."""
HELD_WING_SETTINGS: dict[str, Any] = {
    "drive": "held",
    "stagger": 0.0,
    "clock_ratio": 1.0,
    "tracking": None,
}
"""Settings that hold a second wing."""


class HubPoint(Part):
    """A named point of the hub."""

    name: str = Field(
        min_length=1, max_length=60, pattern=r"^[A-Za-z0-9_.-]+$", description="name of the point"
    )
    position: Position = Field(description="position from the hub's centre of mass, hub axes")


def _control(given: Any) -> Any:
    """None for ``none``; ValueError for other words."""
    if isinstance(given, str | bool) and given != "none":
        raise ValueError(
            "write none, or bandwidth and damping, such as {bandwidth: 0.02 Hz, damping: 0.7}"
        )
    if given == "none":
        return None
    return given


class HubMode(Part):
    """One flexible free-free mode of the hub alone, mass-normalised."""

    frequency: Annotated[
        float, Quantity("Hz", "natural frequency of the free hub", "Omega/2pi", gt=0)
    ]
    damping: Annotated[
        float,
        Quantity(
            "", "modal damping ratio", "xi", ge=0, le=0.99, display="percent", usual=(1e-4, 0.15)
        ),
    ]
    shapes: tuple[Six, ...] = Field(
        max_length=10_000,
        description="at each of hub.points: displacements [kg^-0.5] and rotations [kg^-0.5 m^-1] about hub axes",
    )
    coupling: tuple[float, ...] = Field(
        default=(),
        max_length=2000,
        description="damping that couples it with each mode before it [1/s]; none without it",
    )


class Hub(Part):
    """The craft without its array: a rigid body, and its flexible free-free modes at named points."""

    mass: Annotated[
        float, Quantity("kg", "mass of the hub, without the array", gt=0, usual=(1.0, 1e6))
    ]
    inertia: Inertia = Field(
        description="inertia about the hub's centre of mass, hub axes: xx yy zz xy xz yz, tensor elements"
    )
    points: tuple[HubPoint, ...] = Field(default=(), max_length=10_000, description="named points")
    modes: tuple[HubMode, ...] = Field(
        default=(), max_length=2000, description="flexible modes; none make it rigid"
    )
    left_out_from: (
        Annotated[
            float,
            Quantity(
                "Hz",
                "natural frequency of the first flexible mode that is left out of modes, near which and above"
                " budgets judge nothing",
                gt=0,
            ),
        ]
        | None
    ) = None

    def _consistency_errors(self) -> Iterator[str]:
        misfit = inertia_error(tensor(self.inertia))
        if misfit:
            yield f"inertia: {misfit}"
        names = [point.name for point in self.points]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            yield f"points: '{twice}' is defined twice; each point needs a unique name"
        for k, mode in enumerate(self.modes):
            if len(mode.shapes) != len(self.points):
                yield (
                    f"modes.{k}.shapes: has {len(mode.shapes)} points and hub.points"
                    f" {len(self.points)}; six components for"
                    " each point are expected"
                )
            if len(mode.coupling) not in (0, k):
                yield f"modes.{k}.coupling: has {len(mode.coupling)} values; one for each mode before it, {k}, is expected"
                return
        if any(mode.coupling for mode in self.modes):
            size = np.sqrt(np.maximum(np.diag(self.damping), 1e-300))
            least = float(np.linalg.eigvalsh(self.damping / np.outer(size, size)).min())
            if not least > -ROUNDING:
                yield (
                    "modes: the damping matrix is not positive semi-definite and would add energy"
                    f" (eigenvalue {least:.3g} of the own damping, 0 at least)"
                )

    @property
    def damping(self) -> np.ndarray:
        """Damping matrix of the flexible modes, (s, s) [1/s]."""
        C = np.zeros((len(self.modes), len(self.modes)))
        for k, mode in enumerate(self.modes):
            C[k, : len(mode.coupling)] = C[: len(mode.coupling), k] = mode.coupling
            C[k, k] = 4.0 * math.pi * mode.damping * mode.frequency
        return C


class Interface(Part):
    """Where the drive sits on the hub, and how the array is turned at angle 0."""

    position: Position = Field(
        description="interface point from the hub's centre of mass, hub axes"
    )
    drive_axis: Direction = Field(description="direction of array.drive_axis in hub axes")
    reference: Direction = Field(
        description="direction, at angle 0, of the array axis that follows the drive axis cyclically (x for z)"
    )

    def _consistency_errors(self) -> Iterator[str]:
        for name, given in (("drive_axis", self.drive_axis), ("reference", self.reference)):
            if not _is_direction(given):
                yield f"{name}: {list(given)} is not a direction; three components, not all 0, are expected"
        if abs(_unit(self.drive_axis) @ _unit(self.reference)) > PERPENDICULAR_TOLERANCE:
            yield (
                f"reference: {list(self.reference)} is not perpendicular to drive_axis"
                f" {list(self.drive_axis)}; the array"
                " axis that follows the drive axis lies across it"
            )

    @property
    def axis(self) -> np.ndarray:
        """Unit vector along the drive axis, hub axes, (3,)."""
        return _unit(self.drive_axis)

    def turn(self, drive_axis: str, angle: float) -> np.ndarray:
        """Axes of the array at an ``angle`` [rad], as columns in hub axes, (3, 3): hub components =
        turn @ array components.
        """
        a, first = self.axis, _unit(self.reference)
        first = _unit(first - (first @ a) * a)
        first = math.cos(angle) * first + math.sin(angle) * np.cross(a, first)
        k = "xyz".index(drive_axis)
        turn = np.empty((3, 3))
        turn[:, k], turn[:, (k + 1) % 3], turn[:, (k + 2) % 3] = a, first, np.cross(a, first)
        return turn


class SecondWing(Part):
    """A second drive with its array on the hub: it holds its shaft, or steps as the first does.

    Groups that are not given are those of the first drive.
    """

    drive: Literal["held", "driven", "locked"] = Field(
        default="held",
        description="held: motor energised at standstill; driven: it steps as well; locked: its dry"
        " friction, or a brake, does not let its shaft turn",
    )
    interface: Interface
    array_angle: (
        Annotated[
            float,
            Quantity(
                "rad",
                "angle of its array from its mounting's zero, about its own drive axis; without it"
                " that of the first, in the"
                " same sense about hub axes",
                "psi_2",
                display="deg",
            ),
        ]
        | None
    ) = None
    stagger: Annotated[
        float,
        Quantity(
            "",
            "delay of a driven wing's steps after the first's, in microsteps",
            ge=0,
            le=1e5,
        ),
    ] = 0.0
    clock_ratio: Annotated[
        float,
        Quantity(
            "", "step clock of a driven wing over the first's", gt=0, le=10, usual=(0.8, 1.25)
        ),
    ] = 1.0
    tracking: Tracking | None = Field(
        default=None,
        description="commanded motion of a driven wing, about its own drive axis; without it that of the first, in the same"
        " sense about hub axes",
    )
    motor: Motor | None = None
    driver: Driver | None = None
    reducer: Reducer | None = None
    friction: Friction | None = Field(default=None, description="friction on its output shaft")
    array: Array | None = None


class AttitudeControl(Part):
    """A torque -I (w^2 angle + 2 z w rate) on the hub's rigid rotation, I the hub's own inertia
    about its centre of mass.
    """

    bandwidth: Annotated[
        float, Quantity("Hz", "bandwidth with the hub alone, w/2pi", gt=0, usual=(1e-5, 10.0))
    ]
    damping: Annotated[float, Quantity("", "damping ratio with the hub alone", "z", gt=0, le=5)]


class Sensitivity(Part):
    """Sensitivity of one axis of the line of sight to the motion of one point."""

    axis: Literal["x", "y"] = Field(description="axis of the line of sight")
    point: str = Field(description="a name of hub.points, interface, or center")
    by: Six = Field(
        description="change by displacements [rad/m] and rotations [rad/rad] of the point, hub axes"
    )


Seconds = Annotated[float, Quantity("s", "length of a window", gt=0, display="ms")]


class LineOfSight(Part):
    """How the line of sight follows the hub, and the windows in which it is judged."""

    boresight: Direction | None = Field(
        default=None,
        description="boresight of a rigid payload, hub axes; its rotations move the line of sight",
    )
    point: str = Field(
        default=CENTER,
        description="point whose rotation moves the boresight: a name of hub.points, or center",
    )
    rows: tuple[Sensitivity, ...] | None = Field(
        default=None, max_length=10_000, description="sensitivities to points"
    )
    windows: tuple[Seconds, ...] = Field(default=(), max_length=100, description="exposures")
    pixel: Annotated[float, Quantity("rad", "angle of a pixel", gt=0, display="urad")] | None = None

    def _consistency_errors(self) -> Iterator[str]:
        if (self.boresight is None) == (self.rows is None):
            yield "give either boresight, a direction in hub axes, or rows, sensitivities to motions of named points"
        if self.boresight is not None and not _is_direction(self.boresight):
            yield f"boresight: {list(self.boresight)} is not a direction; three components, not all 0, are expected"
        if self.rows == ():
            yield "rows: an empty list defines no line of sight; give at least one row"
        if len(set(self.windows)) != len(self.windows):
            yield "windows: an exposure is listed twice"

    def wanted(self) -> Iterator[tuple[str, str]]:
        """Key and name of each point whose motion is asked for."""
        if self.rows is None:
            yield "point", self.point
        else:
            yield from ((f"rows.{k}.point", row.point) for k, row in enumerate(self.rows))

    def renamed(self, names: dict[str, str]) -> LineOfSight:
        """Line of sight with points renamed by ``names``."""
        rows = self.rows and tuple(
            x.model_copy(update={"point": names.get(x.point, x.point)}) for x in self.rows
        )
        return self.model_copy(update={"point": names.get(self.point, self.point), "rows": rows})

    def axes(self) -> np.ndarray:
        """For a boresight, the unit vectors about which los_x and los_y turn, in hub axes, (2, 3).

        The first is hub x made perpendicular to the boresight (hub y where x is near it), the
        second boresight cross first: hub x and y for a boresight along z.
        """
        b = _unit(self.boresight or (0.0, 0.0, 1.0))
        first = perpendicular_unit_vector(b)
        return np.array([first, np.cross(b, first)])


class Spacecraft(Part):
    """The craft that carries the drive. Without it the drive stands on a fixed base."""

    hub: Hub
    array_angle: Annotated[
        float,
        Quantity(
            "rad",
            "angle of the array from the mounting's zero, about the drive axis",
            "psi",
            display="deg",
        ),
    ] = 0.0
    interface: Interface
    attitude_control: Annotated[
        AttitudeControl | None,
        BeforeValidator(_control, json_schema_input_type=AttitudeControl | Literal["none"] | None),
    ] = Field(
        default=None,
        description="null leaves the spacecraft free; lines far below the array's first mode are then meaningless",
    )
    line_of_sight: LineOfSight | None = None
    second_wing: SecondWing | None = Field(
        default=None, description="a second array with its drive"
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.second_wing is None:
            second = {}
        else:
            second = {"second_wing.": self.second_wing.interface}
        for key, place in {"": self.interface, **second}.items():
            if self.hub.modes and self.point_at(place) is None:
                at = ", ".join(f"{x:g}" for x in place.position)
                yield (
                    f"{key}interface.position: no point of the hub's modes lies at [{at}] m (within"
                    f" {1e3 * SAME_POINT_DISTANCE:g} mm);"
                    " shapes at the interface point are needed"
                )
        if self.second_wing is not None and abs(self.second_sense) <= PERPENDICULAR_TOLERANCE:
            yield (
                "second_wing.interface.drive_axis: is perpendicular to interface.drive_axis, and"
                " two wings that turn with the sun"
                " have axes along each other, or nearly so"
            )
        for key, name in () if self.line_of_sight is None else self.line_of_sight.wanted():
            if name not in self.points:
                if name == CENTER:
                    why = " (the centre of mass of a flexible hub has no shapes)"
                else:
                    why = ""
                yield f"line_of_sight.{key}: '{name}' is not a point of the hub{why}; there are {', '.join(self.points)}"

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points whose motion is known; of a flexible hub the centre of mass is none
        of them.
        """
        second, center = (
            (() if self.second_wing is None else (SECOND_INTERFACE,)),
            (() if self.hub.modes else (CENTER,)),
        )
        return (INTERFACE, *second, *center, *(point.name for point in self.hub.points))

    @property
    def second_sense(self) -> float:
        """Cosine between both drive axes: which way the second shaft turns where the first turns
        positively.
        """
        if self.second_wing is None:
            return 0.0
        return float(self.interface.axis @ self.second_wing.interface.axis)

    def from_second(self, first: dict[str, Part]) -> Spacecraft:
        """Spacecraft with both wings exchanged: the ``first``, told by its groups, is the second and
        holds.
        """
        wing = self.second_wing
        if wing is None:
            raise ValueError("this spacecraft has no second wing")
        held = wing.model_copy(
            update={
                **first,
                **HELD_WING_SETTINGS,
                "interface": self.interface,
                "array_angle": self.array_angle,
            }
        )
        los = self.line_of_sight and self.line_of_sight.renamed(
            {
                a: b
                for a, b in ((INTERFACE, SECOND_INTERFACE), (SECOND_INTERFACE, INTERFACE))
                if a not in {p.name for p in self.hub.points}
            }
        )
        exchanged = {
            "interface": wing.interface,
            "array_angle": wing.array_angle,
            "second_wing": held,
        }
        return self.model_copy(update={**exchanged, "line_of_sight": los})

    def point_at(self, interface: Interface) -> int | None:
        """Index of the point of ``hub.points`` that is an interface, or None where none is there."""
        here = np.array(interface.position)
        near = (
            k
            for k, p in enumerate(self.hub.points)
            if np.linalg.norm(np.array(p.position) - here) <= SAME_POINT_DISTANCE
        )
        return next(near, None)


def _is_direction(given: Direction) -> bool:
    return bool(np.all(np.isfinite(given)) and np.any(given))


def _unit(direction: Direction | np.ndarray) -> np.ndarray:
    vector = np.array(direction, dtype=float)
    vector /= np.abs(vector).max()  # squares of very large and very small numbers are none
    return np.asarray(vector / np.linalg.norm(vector))
