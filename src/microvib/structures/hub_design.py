"""Description of a craft without its array: a box of sandwich panels, equipment on it, a payload on
a bench on mounts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from microvib.model.part import Part
from microvib.model.rigid import Position
from microvib.structures.array_design import Damping, Sandwich
from microvib.units import Quantity

BENCH_POINT = "payload"
"""Name of the point that the payload is; the first of ``points`` is the one that carries the drive."""


class Bus(Part):
    """Box of six panels and a shear wall across x = 0; its middle is the origin."""

    length: Annotated[float, Quantity("m", "along x", gt=0, le=20)]
    width: Annotated[float, Quantity("m", "along y", gt=0, le=20)]
    height: Annotated[float, Quantity("m", "along z", gt=0, le=20)]
    panel: Sandwich

    @property
    def size(self) -> tuple[float, float, float]:
        """Its three sides [m]."""
        return self.length, self.width, self.height


Reach = Annotated[
    float, Quantity("m", "distance up to which the panels move rigidly with it", gt=0, display="mm")
]


class Equipment(Part):
    """A unit: a mass on a panel."""

    name: str = Field(max_length=100, description="what it is")
    mass: Annotated[float, Quantity("kg", "mass", gt=0)]
    position: Position = Field(description="where it is bolted, from the middle of the box")
    reach: Reach


class Mount(Part):
    """Each of the mounts between top panel and bench."""

    x: Annotated[float, Quantity("m", "place along x")]
    y: Annotated[float, Quantity("m", "place along y")]
    axial: Annotated[float, Quantity("N/m", "stiffness along z", gt=0)]
    lateral: Annotated[float, Quantity("N/m", "stiffness along x and y", gt=0)]
    rotational: Annotated[float, Quantity("N*m/rad", "stiffness about all axes", gt=0)]
    reach: Reach


class Bench(Part):
    """Plate above the top panel, centred on z, with the payload on its middle."""

    length: Annotated[float, Quantity("m", "along x", gt=0, le=20)]
    width: Annotated[float, Quantity("m", "along y", gt=0, le=20)]
    above: Annotated[
        float, Quantity("m", "of its mid-plane above the top panel's", gt=0, le=5, display="mm")
    ]
    panel: Sandwich
    mounts: tuple[Mount, ...] = Field(min_length=3, max_length=20)
    payload_mass: Annotated[float, Quantity("kg", "mass of the payload", gt=0)]
    payload_inertia: tuple[
        Annotated[float, Quantity("kg*m^2", "about x through its centre of mass", gt=0)],
        Annotated[float, Quantity("kg*m^2", "about y", gt=0)],
        Annotated[float, Quantity("kg*m^2", "about z", gt=0)],
    ]
    payload_above: Annotated[
        float, Quantity("m", "of the payload's centre of mass above the bench", ge=0, le=5)
    ]
    payload_reach: Reach

    def _consistency_errors(self) -> Iterator[str]:
        for k, mount in enumerate(self.mounts):
            if abs(mount.x) > 0.5 * self.length or abs(mount.y) > 0.5 * self.width:
                yield f"mounts.{k}: lies beside the bench, which ends at {0.5 * self.length:g} m and {0.5 * self.width:g} m"


class Fitting(Part):
    """A named point of the box."""

    name: str = Field(
        min_length=1, max_length=60, pattern=r"^[A-Za-z0-9_.-]+$", description="name of the point"
    )
    position: Position = Field(description="where it is, from the middle of the box")
    reach: Reach


class HubDesign(Part):
    """A craft without its array, axes of the hub; the origin is the middle of the box."""

    title: str = Field(default="", max_length=500, description="short title")
    source: str = Field(default="", max_length=4000, description="source of the values")
    bus: Bus
    equipment: tuple[Equipment, ...] = Field(default=(), max_length=1000)
    bench: Bench
    points: tuple[Fitting, ...] = Field(
        min_length=1, max_length=100, description="the first one carries the drive"
    )
    damping: Damping = Damping()
    mesh: Annotated[float, Quantity("m", "largest side of an element", gt=0, display="mm")] = 0.1

    def _consistency_errors(self) -> Iterator[str]:
        names = [BENCH_POINT, *(point.name for point in self.points)]
        if len(set(names)) < len(names):
            yield f"points: each needs a name of its own, none of them '{BENCH_POINT}'"
        if (
            max(abs(m.x) for m in self.bench.mounts) > 0.5 * self.bus.length
            or max(abs(m.y) for m in self.bench.mounts) > 0.5 * self.bus.width
        ):
            yield "bench.mounts: one lies beside the top panel"
