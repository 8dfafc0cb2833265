"""Description of a solar array as its designer has it: panels, sandwich, hinges, yoke, shaft."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from microvib.model.part import Part
from microvib.structures.reference_modes import ReferenceMode
from microvib.units import Quantity


class Panels(Part):
    """Equal rectangular panels in line along the drive axis."""

    count: int = Field(ge=1, le=30, description="number of panels of the whole array")
    span: Annotated[float, Quantity("m", "size of a panel along the drive axis", gt=0, le=100)]
    chord: Annotated[float, Quantity("m", "size of a panel across the drive axis", gt=0, le=100)]
    gap: Annotated[float, Quantity("m", "distance between neighbours", ge=0, le=10)] = 0.0
    missing: tuple[int, ...] = Field(
        default=(), description="missing panels, counted from 1 at the yoke"
    )

    def _consistency_errors(self) -> Iterator[str]:
        wrong = (k for k in self.missing if not 1 <= k <= self.count)
        yield from (f"missing: there is no panel {k}; allowed are 1 to {self.count}" for k in wrong)
        if len(set(self.missing)) >= self.count:
            yield "missing: no panel is left; at least one must be there"


class Ply(Part):
    """One ply of a face sheet."""

    thickness: Annotated[
        float, Quantity("m", "thickness of the ply", "t", gt=0, le=0.1, display="mm")
    ]
    angle: Annotated[
        float,
        Quantity("rad", "angle of direction 1 from the drive axis", ge=-6.3, le=6.3, display="deg"),
    ]
    modulus_1: Annotated[
        float, Quantity("Pa", "Young's modulus in direction 1", "E_1", gt=0, display="GPa")
    ]
    modulus_2: Annotated[
        float, Quantity("Pa", "Young's modulus in direction 2", "E_2", gt=0, display="GPa")
    ]
    shear_modulus: Annotated[
        float, Quantity("Pa", "shear modulus in the plane", "G_12", gt=0, display="GPa")
    ]
    poisson: Annotated[float, Quantity("", "Poisson's ratio", "nu_12", ge=-0.9, le=0.9)]
    density: Annotated[float, Quantity("kg/m^3", "density", gt=0)]


class Core(Part):
    """Honeycomb core."""

    thickness: Annotated[float, Quantity("m", "thickness of the core", gt=0, le=1, display="mm")]
    density: Annotated[float, Quantity("kg/m^3", "density", ge=0)]
    shear_xz: Annotated[
        float, Quantity("Pa", "shear modulus along the drive axis", "G_xz", gt=0, display="MPa")
    ]
    shear_yz: Annotated[
        float, Quantity("Pa", "shear modulus across the drive axis", "G_yz", gt=0, display="MPa")
    ]


class Sandwich(Part):
    """Lay-up of the panels."""

    face: tuple[Ply, ...] = Field(
        min_length=1, max_length=100, description="plies of each face, from outside to the core"
    )
    core: Core
    nonstructural_mass: Annotated[
        float, Quantity("kg/m^2", "cells, cover glass, harness, adhesive, by panel area", ge=0)
    ] = 0.0

    @property
    def areal_mass(self) -> float:
        """Mass by panel area [kg/m^2]."""
        faces = 2.0 * sum(ply.thickness * ply.density for ply in self.face)
        return faces + self.core.thickness * self.core.density + self.nonstructural_mass


class Stiffness(Part):
    """Springs along and about the axes: x along the drive axis, y across, z normal to the panels."""

    along_x: Annotated[float, Quantity("N/m", "stiffness along the drive axis", ge=0)]
    along_y: Annotated[float, Quantity("N/m", "stiffness across, in the plane of the panels", ge=0)]
    along_z: Annotated[float, Quantity("N/m", "stiffness along the normal", ge=0)]
    about_x: Annotated[float, Quantity("N*m/rad", "stiffness about the drive axis", ge=0)]
    about_y: Annotated[float, Quantity("N*m/rad", "stiffness about the hinge line", ge=0)]
    about_z: Annotated[float, Quantity("N*m/rad", "stiffness about the normal", ge=0)]

    @property
    def values(self) -> tuple[float, float, float, float, float, float]:
        """The six stiffnesses in order [N/m, N m/rad]."""
        return (self.along_x, self.along_y, self.along_z, self.about_x, self.about_y, self.about_z)


class Hinge(Part):
    """A locked hinge on a hinge line."""

    position: Annotated[float, Quantity("m", "place on the hinge line, from the drive axis", "y")]
    footprint: Annotated[
        float,
        Quantity("m", "side of the square of panel that moves rigidly with it", gt=0, display="mm"),
    ]
    stiffness: Stiffness


class Hinges(Part):
    """Hinge lines: one between yoke and first panel, one between neighbours."""

    root: tuple[Hinge, ...] = Field(
        min_length=1, max_length=20, description="hinges between yoke and first panel"
    )
    between: tuple[Hinge, ...] = Field(
        default=(), max_length=20, description="hinges between neighbouring panels"
    )


class Tube(Part):
    """Rectangular thin-walled tube."""

    width: Annotated[
        float, Quantity("m", "outer width, in the plane of the panels", gt=0, le=1, display="mm")
    ]
    height: Annotated[
        float, Quantity("m", "outer height, along the normal", gt=0, le=1, display="mm")
    ]
    wall: Annotated[float, Quantity("m", "wall thickness", gt=0, le=0.1, display="mm")]

    def _consistency_errors(self) -> Iterator[str]:
        if 2.0 * self.wall >= min(self.width, self.height):
            yield f"wall: {self.wall:g} m fills the tube; it must be less than half of width and height"


class Yoke(Part):
    """V-shaped connecting rod: two legs from the drive, and a cross-bar that carries the root
    hinges.
    """

    length: Annotated[float, Quantity("m", "from the interface to the cross-bar", gt=0, le=50)]
    half_width_drive: Annotated[
        float, Quantity("m", "of each leg from the drive axis at the drive", ge=0, le=10)
    ]
    half_width_panel: Annotated[
        float, Quantity("m", "of each leg from the drive axis at the cross-bar", gt=0, le=10)
    ]
    leg: Tube
    crossbar: Tube
    modulus: Annotated[float, Quantity("Pa", "Young's modulus", "E", gt=0, display="GPa")]
    poisson: Annotated[float, Quantity("", "Poisson's ratio", "nu", ge=0, le=0.49)]
    density: Annotated[float, Quantity("kg/m^3", "density", gt=0)]


class Mass(Part):
    """A mass on the panel that is nearest, such as a sensor or a tip plate."""

    mass: Annotated[float, Quantity("kg", "mass", gt=0)]
    x: Annotated[float, Quantity("m", "from the interface, along the drive axis", ge=0)]
    y: Annotated[float, Quantity("m", "from the drive axis, across")]


class Damping(Part):
    """Modal damping: ratio + mass/(2 Omega) + stiffness Omega/2, or mode by mode."""

    ratio: Annotated[
        float, Quantity("", "damping ratio of all modes", "xi", ge=0, le=0.5, display="percent")
    ] = 0.01
    mass: Annotated[
        float, Quantity("s^-1", "Rayleigh damping in proportion to mass", "alpha", ge=0)
    ] = 0.0
    stiffness: Annotated[
        float, Quantity("s", "Rayleigh damping in proportion to stiffness", "beta", ge=0)
    ] = 0.0
    modes: tuple[
        Annotated[float, Quantity("", "damping ratio", ge=0, le=0.99, display="percent")], ...
    ] = Field(default=(), description="damping ratios of the first modes, instead of the rule")

    def of(self, frequency: np.ndarray) -> np.ndarray:
        """Damping ratios of modes at ``frequency`` [Hz], (s,)."""
        Omega = 2.0 * np.pi * frequency
        xi = self.ratio + self.mass / (2.0 * Omega) + self.stiffness * Omega / 2.0
        given = self.modes[: xi.size]
        xi[: len(given)] = given
        return np.minimum(xi, 0.99)


class ArrayDesign(Part):
    """A solar array: x along the drive axis, y across, z normal to the panels; the interface at the
    origin.
    """

    title: str = Field(default="", max_length=500, description="short title")
    source: str = Field(default="", max_length=4000, description="source of the values")
    panels: Panels
    sandwich: Sandwich
    hinges: Hinges
    yoke: Yoke
    shaft: Stiffness | None = Field(
        default=None, description="compliance of the drive-shaft interface; none is rigid"
    )
    offset: Annotated[
        float, Quantity("m", "of the panels' mid-plane from the drive axis", display="mm")
    ] = 0.0
    masses: tuple[Mass, ...] = Field(
        default=(), max_length=1000, description="single masses on the panels"
    )
    damping: Damping = Damping()
    mesh: Annotated[float, Quantity("m", "largest side of an element", gt=0, display="mm")] = 0.1
    drive_axis: Literal["x"] = Field(default="x", description="drive axis of the description")
    reference: tuple[ReferenceMode, ...] = Field(
        default=(), max_length=1000, description="modes that it is to have, in their order"
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.panels.count > 1 and not self.hinges.between:
            yield "hinges.between: missing; several panels need hinges between them"
        for name in ("root", "between"):
            for k, hinge in enumerate(getattr(self.hinges, name)):
                reach = abs(hinge.position) + hinge.footprint / 2.0
                if (
                    reach > self.panels.chord / 2.0 * (1.0 + 1e-9)
                    or 2.0 * hinge.footprint > self.panels.span
                ):
                    yield (
                        f"hinges.{name}.{k}: its footprint reaches {reach:g} m from the drive axis,"
                        " beyond the panel; allowed is"
                        f" {self.panels.chord / 2.0:g} m across and half of the span along"
                    )
