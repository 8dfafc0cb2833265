"""Description of a solar array simulator: what is built, how it is set, how far its settings go,
and its inertia by hand.

The drive axis is z; the interface is the origin. Two rails along x at y = +-``rail`` carry four
spring seats at x = +-``arm``; arms along y make the frame a cross. The plate on the shaft carries
four sliders, two at each x = +-``arm``, above and below it; from each slider a spring runs to
either rail. Counterweights sit on the cross at ``radius``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from microvib.model.part import Part
from microvib.structures.array_design import Damping, Tube
from microvib.structures.reference_modes import ReferenceMode
from microvib.structures.springs import SPRINGS, preload_stiffness, torsion_stiffness
from microvib.units import Quantity

WIRE_DENSITY = 7850.0  # kg/m^3
COUNTERWEIGHTS = 4


class Material(Part):
    """Isotropic material of shaft, plate and frame."""

    modulus: Annotated[float, Quantity("Pa", "Young's modulus", "E", gt=0, display="GPa")]
    poisson: Annotated[float, Quantity("", "Poisson's ratio", "nu", ge=0, le=0.49)]
    density: Annotated[float, Quantity("kg/m^3", "density", gt=0)]

    @property
    def shear_modulus(self) -> float:
        """Shear modulus [Pa]."""
        return self.modulus / (2.0 * (1.0 + self.poisson))


class CoilSpring(Part):
    """Extension spring with hooks."""

    name: str = Field(default="", max_length=100, description="name in the table of stock springs")
    rate: Annotated[float, Quantity("N/m", "spring rate", "k", gt=0)]
    wire: Annotated[float, Quantity("m", "diameter of the wire", gt=0, le=0.05, display="mm")]
    coil: Annotated[float, Quantity("m", "mean diameter of the coil", gt=0, le=0.5, display="mm")]
    coils: Annotated[float, Quantity("", "active coils", "n", gt=0)]
    free_length: Annotated[
        float, Quantity("m", "between the hooks, unloaded", gt=0, le=5, display="mm")
    ]
    initial_tension: Annotated[float, Quantity("N", "force at which the coils part", ge=0)] = 0.0

    @property
    def mass(self) -> float:
        """Mass of the wire [kg], hooks taken as one coil."""
        return WIRE_DENSITY * math.pi**2 / 4.0 * self.wire**2 * self.coil * (self.coils + 1.0)


class Counterweight(Part):
    """One of four equal discs, lying centred in the plane of the frame."""

    mass: Annotated[float, Quantity("kg", "mass of each, without its seat", "m", ge=0)]
    radius: Annotated[
        float, Quantity("m", "of its centre from the drive axis", "r", gt=0, display="mm")
    ]
    diameter: Annotated[float, Quantity("m", "diameter of the disc", gt=0, display="mm")]
    density: Annotated[float, Quantity("kg/m^3", "density", gt=0)] = 7850.0

    @property
    def height(self) -> float:
        """Height of the disc [m]."""
        return self.mass / (self.density * math.pi / 4.0 * self.diameter**2)


class Shaft(Part):
    """Central shaft from the drive, with its connector, plate and bearing."""

    diameter: Annotated[float, Quantity("m", "outer diameter", gt=0, le=1, display="mm")]
    bore: Annotated[float, Quantity("m", "inner diameter", ge=0, le=1, display="mm")] = 0.0
    plate_at: Annotated[
        float, Quantity("m", "of the plate from the interface", "z", gt=0, le=5, display="mm")
    ]
    bearing_at: Annotated[
        float, Quantity("m", "of the bearing from the interface", "z", gt=0, le=5, display="mm")
    ]
    connector_mass: Annotated[float, Quantity("kg", "connector to the drive", ge=0)]
    connector_diameter: Annotated[
        float, Quantity("m", "diameter of the connector", ge=0, display="mm")
    ]

    def _consistency_errors(self) -> Iterator[str]:
        if self.bore >= self.diameter:
            yield f"bore: {self.bore:g} m leaves no wall; it must be less than the diameter, {self.diameter:g} m"
        if math.isclose(self.plate_at, self.bearing_at):
            yield "bearing_at: the bearing is where the plate is; it must lie above or below it"

    @property
    def length(self) -> float:
        """From the interface to its end [m]."""
        return max(self.plate_at, self.bearing_at)


class Plate(Part):
    """Central plate, along x, with four sliders on columns along its middle line."""

    length: Annotated[float, Quantity("m", "along x", gt=0, le=10, display="mm")]
    width: Annotated[float, Quantity("m", "along y", gt=0, le=10, display="mm")]
    thickness: Annotated[float, Quantity("m", "thickness", gt=0, le=0.5, display="mm")]
    hub: Annotated[
        float, Quantity("m", "side of the square that is bolted to the shaft", gt=0, display="mm")
    ]
    slider_mass: Annotated[float, Quantity("kg", "of each of four sliders", ge=0)]
    slider_width: Annotated[
        float, Quantity("m", "side of the square of plate a slider holds", gt=0, display="mm")
    ]
    hook: Annotated[
        float, Quantity("m", "of the hooks from the middle line", "a", ge=0, display="mm")
    ]
    level: Annotated[
        float, Quantity("m", "of the springs above and below the plate", gt=0, display="mm")
    ]


class Bearing(Part):
    """Bearing between shaft and frame; free about the shaft."""

    radial: Annotated[float, Quantity("N/m", "stiffness across the shaft", gt=0)]
    axial: Annotated[float, Quantity("N/m", "stiffness along the shaft", gt=0)]
    rocking: Annotated[float, Quantity("N*m/rad", "stiffness against rocking of the frame", gt=0)]


class Frame(Part):
    """Inertia frame: a cross of pairs of rails with ties at its ends, bridged at the bearing."""

    half_length: Annotated[
        float,
        Quantity("m", "of the cross from the drive axis to its ends", gt=0, le=20, display="mm"),
    ]
    rail: Annotated[
        float, Quantity("m", "of each rail from the middle line", "b", gt=0, le=10, display="mm")
    ]
    tube: Tube
    bridge: Annotated[
        float, Quantity("m", "width of the bridge at the bearing", gt=0, display="mm")
    ]
    bridge_mass: Annotated[
        float, Quantity("kg", "of the bridge, with the bearing's outer part", gt=0)
    ]
    spring_seat_mass: Annotated[float, Quantity("kg", "of each of four spring seats", ge=0)]
    weight_seat_mass: Annotated[float, Quantity("kg", "of each of four counterweight seats", ge=0)]


class Rope(Part):
    """Rope with a swivel, which hangs the frame up at the bridge, along the drive axis."""

    length: Annotated[float, Quantity("m", "free length", gt=0, le=100)]
    tension: Annotated[float, Quantity("N", "tension", ge=0)]
    axial: Annotated[
        float,
        Quantity("N/m", "stiffness along the rope, with a soft spring where there is one", ge=0),
    ]
    twist: Annotated[
        float, Quantity("N*m/rad", "stiffness of rope and swivel about the drive axis", ge=0)
    ] = 0.0


class Adjustment(Part):
    """How far the settings go."""

    arm_min: Annotated[float, Quantity("m", "shortest arm", gt=0, display="mm")]
    arm_max: Annotated[float, Quantity("m", "longest arm", gt=0, display="mm")]
    radius_min: Annotated[
        float, Quantity("m", "smallest radius of the counterweights", gt=0, display="mm")
    ]
    radius_max: Annotated[
        float, Quantity("m", "largest radius of the counterweights", gt=0, display="mm")
    ]
    masses: tuple[Annotated[float, Quantity("kg", "stock mass of a counterweight", gt=0)], ...] = (
        Field(min_length=1, max_length=100, description="stock masses of a counterweight")
    )
    screw: Annotated[
        float, Quantity("m", "least length of the preload screw at the rail", ge=0, display="mm")
    ] = 0.0

    def _consistency_errors(self) -> Iterator[str]:
        for name in ("arm", "radius"):
            low, high = getattr(self, f"{name}_min"), getattr(self, f"{name}_max")
            if low >= high:
                yield f"{name}_max: {high:g} m is not allowed; it must be greater than {name}_min, {low:g} m"


class Tolerances(Part):
    """Limits of what the parts and settings may be off by, each way."""

    rate: Annotated[float, Quantity("", "rate of a spring", ge=0, le=0.5, display="percent")] = 0.05
    arm: Annotated[float, Quantity("m", "arm of a slider and its seats", ge=0, display="mm")] = (
        0.5e-3
    )
    mass: Annotated[
        float, Quantity("", "mass of a counterweight", ge=0, le=0.5, display="percent")
    ] = 0.005
    radius: Annotated[float, Quantity("m", "radius of a counterweight", ge=0, display="mm")] = 1e-3
    frame: Annotated[
        float, Quantity("", "inertia of the bare frame", ge=0, le=0.5, display="percent")
    ] = 0.01
    preload: Annotated[
        float, Quantity("", "extension of the springs", ge=0, le=0.5, display="percent")
    ] = 0.1


class SimulatorDesign(Part):
    """A solar array simulator as it is set; z is the drive axis, the interface the origin."""

    title: str = Field(default="", max_length=500, description="short title")
    source: str = Field(default="", max_length=4000, description="source of the values")
    arm: Annotated[
        float, Quantity("m", "of the springs from the drive axis", "l", gt=0, display="mm")
    ]
    preload: Annotated[
        float, Quantity("m", "extension of the springs at rest", "d", ge=0, display="mm")
    ]
    spring: CoilSpring
    counterweight: Counterweight
    frame: Frame
    plate: Plate
    shaft: Shaft
    bearing: Bearing
    material: Material
    rope: Rope | None = Field(default=None, description="rope that hangs the frame up; optional")
    adjustment: Adjustment
    tolerances: Tolerances = Tolerances()
    damping: Damping = Damping()
    mesh: Annotated[float, Quantity("m", "largest side of an element", gt=0, display="mm")] = 0.1
    drive_axis: Literal["z"] = Field(default="z", description="drive axis of the description")
    reference: tuple[ReferenceMode, ...] = Field(
        default=(), max_length=1000, description="modes that it is to have, in their order"
    )

    def _consistency_errors(self) -> Iterator[str]:
        a, f, p = self.adjustment, self.frame, self.plate
        shortest = max(f.bridge, p.hub + p.slider_width) / 2.0
        longest = (p.length - p.slider_width) / 2.0
        room = f.rail - a.screw
        if f.bridge / 2.0 >= f.rail:
            yield f"frame.bridge: {f.bridge:g} m is wider than the rails are apart, {2 * f.rail:g} m"
        if p.slider_width > p.width or p.hub > p.width:
            yield f"plate.width: {p.width:g} m is less than its sliders and hub need, {max(p.slider_width, p.hub):g} m"
        if a.arm_min <= shortest:
            at = "under the bridge or at the plate's hub"
            yield f"adjustment.arm_min: {a.arm_min:g} m, {at}; allowed is more than {shortest:g} m"
        if a.arm_max > longest:
            yield f"adjustment.arm_max: {a.arm_max:g} m, off the plate; allowed is at most {longest:g} m"
        if a.radius_min <= a.arm_max:
            yield f"adjustment.radius_min: {a.radius_min:g} m, at the spring seats; allowed is more than arm_max, {a.arm_max:g} m"
        if a.radius_max > f.half_length:
            yield f"adjustment.radius_max: {a.radius_max:g} m, off the frame; allowed is at most {f.half_length:g} m"
        if self.hook_end > room:
            yield (
                f"preload: the springs end {self.hook_end:.4g} m from the middle line; allowed is"
                f" at most {room:g} m,"
                " frame.rail less adjustment.screw"
            )
        for key, value, low, high in (
            ("arm", self.arm, a.arm_min, a.arm_max),
            ("counterweight.radius", self.counterweight.radius, a.radius_min, a.radius_max),
        ):
            if not low <= value <= high:
                yield f"{key}: {value:g} m is not allowed; the adjustment goes from {low:g} to {high:g} m"

    @property
    def hook_end(self) -> float:
        """Distance of the springs' ends at the frame from the middle line [m]."""
        return self.plate.hook + self.spring.free_length + self.preload

    @property
    def spring_force(self) -> float:
        """Tension of a spring at rest [N]."""
        return self.spring.initial_tension + self.spring.rate * self.preload

    @property
    def stiffness(self) -> float:
        """Stiffness between shaft and frame about the drive axis [N m/rad] (Eq. 23), with what the
        tension adds.
        """
        tension: float = preload_stiffness(
            self.spring_force, self.plate.hook, self.hook_end - self.plate.hook
        )
        return torsion_stiffness(self.spring.rate, self.arm) + tension

    @property
    def J_h(self) -> float:
        """Inertia on the shaft [kg m^2]: connector, shaft, plate, sliders, half of the springs."""
        return (
            self.shaft_inertia
            + SPRINGS / 2 * self.plate.slider_mass * self.arm**2
            + self._springs(self.plate.hook)
        )

    @property
    def shaft_inertia(self) -> float:
        """Part of J_h that does not depend on settings [kg m^2]: connector, shaft, plate."""
        s, p, rho = self.shaft, self.plate, self.material.density
        shaft = rho * s.length * math.pi * (s.diameter**4 - s.bore**4) / 32.0
        plate = rho * p.length * p.width * p.thickness * (p.length**2 + p.width**2) / 12.0
        return s.connector_mass * s.connector_diameter**2 / 8.0 + shaft + plate

    @property
    def frame_inertia(self) -> float:
        """Inertia of the frame without seats, springs and counterweights [kg m^2]."""
        f = self.frame
        A, b, rho = f.half_length, f.rail, self.material.density
        t = f.tube
        bi, hi = t.width - 2.0 * t.wall, t.height - 2.0 * t.wall
        area, edge = t.width * t.height - bi * hi, (t.height * t.width**3 - hi * bi**3) / 12.0

        def rod(length: float, offset: float) -> float:
            """Inertia of a tube whose middle is ``offset`` from the axis."""
            return rho * length * (area * (length**2 / 12.0 + offset**2) + edge)

        rails, arms, ties = (
            2 * rod(2 * A, b),
            4 * rod(A - b, math.hypot(b, (A + b) / 2)),
            4 * rod(2 * b, A),
        )
        return rails + arms + ties + f.bridge_mass * (f.bridge**2 + 4.0 * b**2) / 12.0

    @property
    def seats_inertia(self) -> float:
        """Inertia of spring seats and the frame's half of the springs [kg m^2]."""
        seats = 4 * self.frame.spring_seat_mass * (self.arm**2 + self.frame.rail**2)
        return seats + self._springs(self.hook_end)

    @property
    def weights_inertia(self) -> float:
        """Inertia of the four counterweights, 4 m r^2 and about their own axes, with their seats
        [kg m^2].
        """
        w, seat = self.counterweight, self.frame.weight_seat_mass
        own = w.mass * w.diameter**2 / 8.0 + seat * self.frame.rail**2 / 3.0
        return COUNTERWEIGHTS * ((w.mass + seat) * w.radius**2 + own)

    def _springs(self, hook: float) -> float:
        return SPRINGS * 0.5 * self.spring.mass * (self.arm**2 + hook**2)

    @property
    def moving_inertia(self) -> float:
        """Inertia that the springs hold [kg m^2]: J_SAS of Eq. 21."""
        return self.frame_inertia + self.seats_inertia + self.weights_inertia

    @property
    def inertia(self) -> float:
        """Whole inertia about the drive axis [kg m^2], as measured at the interface: J_h included."""
        return self.moving_inertia + self.J_h

    @property
    def frequency(self) -> float:
        """Torsional frequency with the interface clamped [Hz], shaft, plate and frame rigid (Eq. 24
        with 1/2pi).
        """
        return math.sqrt(self.stiffness / self.moving_inertia) / (2.0 * math.pi)
