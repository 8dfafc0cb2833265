"""Gear trains of spur and planetary stages: ratios and orders by their teeth, exact as fractions.

A stage turns its input into its output; speeds are over that of the stage's input, and keep their
signs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from microvib.model.part import Part
from microvib.units import Quantity

Member = Literal["sun", "ring", "carrier", "sun_2", "ring_2"]
_TERM = re.compile(r"\s*([+-]?)\s*(\d{0,4})\s*\*?\s*([a-z_]+(?:2[a-z_]*)?)")
_KINDS = (
    {"pinion", "wheel"},
    {"sun", "ring"},
    {"sun", "planet", "ring"},
    {"sun", "planet", "planet_2", "ring"},
    {"ring", "planet", "planet_2", "ring_2"},
    {"sun", "planet", "planet_2", "sun_2"},
)
"""Wheels whose teeth make a stage."""

Teeth = Annotated[int, Field(ge=4, le=10_000, strict=True)]


class Order(NamedTuple):
    """Cycles per turn of the stage's input, and the formula in words."""

    cycles: Fraction
    words: str


class StageError(Part):
    """Kinematic error of a stage at one of its orders: amplitude x sin(order angle + phase), added
    to the output's angle.
    """

    order: str = Field(
        max_length=100,
        description="one of the stage's orders by name, a multiple, or a sum such as 2 mesh + carrier",
    )
    amplitude: Annotated[
        float,
        Quantity(
            "rad", "amplitude at the stage's output", ge=0, display="arcsec", usual=(1e-7, 0.02)
        ),
    ]
    phase: Annotated[float, Quantity("rad", "phase at zero rotor angle", display="deg")] = 0.0


class GearStage(Part):
    """A spur stage (pinion and wheel) or a planetary one (sun, planets on a carrier, ring), from
    input to output.
    """

    pinion: Teeth | None = Field(
        default=None, description="teeth of the driving wheel of a spur stage"
    )
    wheel: Teeth | None = Field(
        default=None, description="teeth of the driven wheel of a spur stage"
    )
    internal: bool = Field(
        default=False, description="whether the driven wheel is an internal gear"
    )
    sun: Teeth | None = Field(default=None, description="teeth of the sun of a planetary stage")
    planet: Teeth | None = Field(
        default=None, description="teeth of a planet; null is half of ring less sun"
    )
    ring: Teeth | None = Field(default=None, description="teeth of the ring of a planetary stage")
    planet_2: Teeth | None = Field(
        default=None,
        description="teeth of a second wheel on each planet's shaft, which meshes with the second central wheel",
    )
    sun_2: Teeth | None = Field(
        default=None, description="teeth of a second sun, of stepped planets without a ring"
    )
    ring_2: Teeth | None = Field(
        default=None, description="teeth of a second ring, of stepped planets without a sun"
    )
    planets: Annotated[int, Field(ge=1, le=20, strict=True, description="number of planets")] = 3
    equally_spaced: bool = Field(default=True, description="whether planets are equally spaced")
    fixed: Member = Field(default="ring", description="fixed member of a planetary stage")
    input: Member | None = Field(
        default=None,
        description="member that is driven; null is the sun, or the ring where the sun stands, or the carrier between two rings or"
        " two suns",
    )
    input_inertia: Annotated[
        float,
        Quantity(
            "kg*m^2", "inertia of pinion or driven member with its shaft", ge=0, display="kg*cm^2"
        ),
    ] = 0.0
    output_inertia: Annotated[
        float,
        Quantity(
            "kg*m^2", "inertia of wheel or output member with its shaft", ge=0, display="kg*cm^2"
        ),
    ] = 0.0
    planet_inertia: Annotated[
        float,
        Quantity("kg*m^2", "inertia of each planet about its own axis", ge=0, display="kg*cm^2"),
    ] = 0.0
    stiffness: (
        Annotated[
            float,
            Quantity(
                "N*m/rad",
                "torsional stiffness at the stage's output; null is rigid",
                gt=0,
                usual=(1.0, 1e7),
            ),
        ]
        | None
    ) = None
    backlash: Annotated[
        float,
        Quantity(
            "rad",
            "free play from flank to flank, at the stage's output",
            ge=0,
            display="arcsec",
            usual=(1e-6, 0.1),
        ),
    ] = 0.0
    errors: tuple[StageError, ...] = Field(
        default=(), max_length=100, description="kinematic errors at orders of this stage"
    )

    def _consistency_errors(self) -> Iterator[str]:
        wheels = ("pinion", "wheel", "sun", "planet", "ring", "planet_2", "sun_2", "ring_2")
        given = [name for name in wheels if getattr(self, name) is not None]
        if set(given) not in _KINDS:
            yield (
                f"has the teeth of {', '.join(given) or 'nothing'}; pinion and wheel are expected,"
                " or sun and ring, of which planet"
                " may be given too; of stepped planets planet and planet_2 with sun and ring, ring"
                " and ring_2, or sun and sun_2"
            )
            return
        if self.stepped:
            yield from self._unlike_steps()
            yield from self._unlike_members()
            return
        if self.planetary:
            yield from self._unlike_planets()
        elif self.planet_inertia:
            yield "planet_inertia: a spur stage has no planets"
        if self.internal and (self.planetary or self.teeth["wheel"] <= self.teeth["pinion"]):
            yield "internal: is of a spur stage whose wheel has more teeth than its pinion"
        for k, error in enumerate(self.errors):
            try:
                self.order(error.order)
            except ValueError as problem:
                yield f"errors.{k}.order: {problem}"

    def _unlike_planets(self) -> Iterator[str]:
        sun, planet, ring = self.teeth.values()
        if ring <= sun + 2:
            yield f"ring: {ring} teeth leave no room for planets about a sun of {sun}"
        elif self.planet is None and (ring - sun) % 2:
            yield (
                f"planet: ring less sun is {ring - sun}, odd, so that planets have shifted"
                " profiles; give their number of teeth"
            )
        elif self.planet is not None and abs(2 * self.planet - (ring - sun)) > 4:
            yield f"planet: {self.planet} teeth do not fit between a sun of {sun} and a ring of {ring}"
        elif self.equally_spaced and (sun + ring) % self.planets:
            yield (
                f"planets: {self.planets} cannot be assembled at equal angles between a sun of"
                f" {sun} and a ring of {ring}, since"
                f" {sun + ring} teeth are no multiple of {self.planets}; if they are spaced unequally, set equally_spaced: false"
            )
        else:
            # teeth of both mesh with a planet's at multiples of a turn over sun + ring; tips stand
            # a module beyond the pitch circle
            places, apart = sun + ring, (planet + 2) / max(sun + planet, ring - planet)
            room = max(
                n
                for n in range(1, 21)
                if n == 1 or math.sin(math.pi * (places // n) / places) > apart
            )
            if self.planets > room:
                yield f"planets: {self.planets} of {planet} teeth overlap about a sun of {sun}; at most {room} have room"
        yield from self._unlike_members()

    def _unlike_members(self) -> Iterator[str]:
        for key, member in (("fixed", self.fixed), ("input", self.driven)):
            if member not in self.members:
                yield f"{key}: this stage has no {member}; its members are {', '.join(self.members)}"
                return
        if self.driven == self.fixed:
            yield f"input: the {self.fixed} is the fixed member; another one is expected"

    def _unlike_steps(self) -> Iterator[str]:
        """Inconsistencies of stepped planets; whether their axes are equally far from both wheels
        is a matter of modules.
        """
        n = self.planets
        for wheel, planet in self._meshes:
            own, turning = self.teeth[wheel], self.teeth[planet]
            inside = wheel.startswith("ring")
            if inside and own <= turning:
                yield f"{wheel}: {own} teeth leave no room for a planet of {turning}"
                return
            if inside:
                apart = own - turning
            else:
                apart = own + turning
            if n > 1 and apart * math.sin(math.pi / n) <= turning + 2:
                yield f"planets: {n} of {turning} teeth overlap; fewer have room"
                return
        (first, planet), (second, planet_2) = self._meshes
        t = self.teeth
        if first.startswith("ring") == second.startswith("ring"):
            way = -1
        else:
            way = 1
        if way < 0 and t[first] * t[planet_2] == t[second] * t[planet]:
            yield (
                f"planet_2: {first} and {second} turn at the same speed about the carrier with"
                " these tooth numbers; the ratio is infinite"
            )
            return
        places = t[first] * t[planet_2] + way * t[second] * t[planet]
        step = n * math.gcd(t[planet], t[planet_2])
        if self.equally_spaced and places % step:
            yield (
                f"planets: {n} alike cannot be assembled at equal angles, since {abs(places)} is no"
                f" multiple of {step}"
                f" ({first} x planet_2 {'-' if way < 0 else '+'} {second} x planet, over {n} times"
                " the greatest common divisor of"
                " planet and planet_2); if they are spaced unequally, set equally_spaced: false"
            )

    @property
    def planetary(self) -> bool:
        """Whether this is a planetary stage."""
        return self.pinion is None and self.wheel is None

    @property
    def stepped(self) -> bool:
        """Whether each planet has two wheels on its shaft."""
        return self.planet_2 is not None

    @property
    def members(self) -> tuple[str, str, str]:
        """The two central wheels of a planetary stage, and its carrier."""
        if self.sun is not None:
            first = "sun"
        else:
            first = "ring"
        if self.sun_2 is not None:
            second = "sun_2"
        elif self.ring_2 is not None:
            second = "ring_2"
        else:
            second = "ring"
        return first, second, "carrier"

    @property
    def _meshes(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Each central wheel with the planet's wheel that it meshes with."""
        first, second, _ = self.members
        return (first, "planet"), (second, "planet_2" if self.stepped else "planet")

    @property
    def teeth(self) -> dict[str, int]:
        """Numbers of teeth by wheel."""
        if not self.planetary:
            return {"pinion": int(self.pinion or 0), "wheel": int(self.wheel or 0)}
        if self.stepped:
            return {name: int(getattr(self, name)) for mesh in self._meshes for name in mesh}
        sun, ring = int(self.sun or 0), int(self.ring or 0)
        return {"sun": sun, "planet": self.planet or (ring - sun) // 2, "ring": ring}

    @property
    def driven(self) -> str:
        """The member that is the input."""
        if not self.planetary:
            return "pinion"
        if self.input is not None:
            return self.input
        if "sun" not in self.members or "sun_2" in self.members:
            return "carrier"
        if self.fixed == "sun":
            return "ring"
        return "sun"

    @property
    def output(self) -> str:
        """The member that is the output."""
        if self.planetary:
            return next(m for m in self.members if m not in (self.fixed, self.driven))
        return "wheel"

    @property
    def speeds(self) -> dict[str, Fraction]:
        """Speed of each wheel, and of a carrier, over that of the input; a planet's is its own
        turning in space.
        """
        t = self.teeth
        if not self.planetary:
            return {
                "pinion": Fraction(1),
                "wheel": Fraction(t["pinion"], t["wheel"]) * (1 if self.internal else -1),
            }
        # Willis: as seen from the carrier, each central wheel turns the planet by its teeth over
        # the planet's, a sun backwards
        (first, planet), (second, planet_2) = self._meshes
        own = {
            wheel: Fraction(t[wheel] * (1 if wheel.startswith("ring") else -1), t[p])
            for wheel, p in self._meshes
        }
        weights = {first: own[first], second: -own[second], "carrier": own[second] - own[first]}
        speed = {self.fixed: Fraction(0), self.driven: Fraction(1)}
        speed[self.output] = -weights[self.driven] / weights[self.output]
        speed["planet"] = speed["carrier"] + (speed[first] - speed["carrier"]) * own[first]
        return speed

    @property
    def lead(self) -> Fraction:
        """Speed of the output over that of the input; negative where they turn oppositely."""
        return self.speeds[self.output]

    @property
    def orders(self) -> dict[str, Order]:
        """Orders of the stage by name."""
        t, w = self.teeth, self.speeds
        if not self.planetary:
            mesh = Fraction(t["pinion"])
            return {
                "pinion": Order(abs(w["pinion"]), "turns of the pinion"),
                "wheel": Order(abs(w["wheel"]), "turns of the wheel"),
                "mesh": Order(mesh, "teeth of the pinion x its turns"),
                "hunting": Order(
                    mesh / math.lcm(*t.values()),
                    "the same two teeth meet: mesh / lcm(pinion, wheel)",
                ),
            }
        if self.stepped:
            return self._orders_of_steps()
        of_sun, of_ring = abs(w["sun"] - w["carrier"]), abs(w["ring"] - w["carrier"])
        mesh, n = t["sun"] * of_sun, self.planets
        turns = {m: Order(abs(w[m]), f"turns of the {m}") for m in self.members if m != self.fixed}
        return turns | {
            "planet": Order(mesh / t["planet"], "turns of a planet on the carrier: mesh / planet"),
            "mesh": Order(mesh, "teeth of the sun x its turns against the carrier, as of the ring"),
            "sun_tooth": Order(of_sun, "a tooth of the sun meets a planet again: mesh / sun"),
            "ring_tooth": Order(of_ring, "a tooth of the ring meets a planet again: mesh / ring"),
            "sun_pass": Order(n * of_sun, "planets pass a tooth of the sun: planets x mesh / sun"),
            "ring_pass": Order(
                n * of_ring, "planets pass a tooth of the ring: planets x mesh / ring"
            ),
            "hunting_sun": Order(
                mesh / math.lcm(t["sun"], t["planet"]), "the same teeth of sun and planet meet"
            ),
            "hunting_ring": Order(
                mesh / math.lcm(t["ring"], t["planet"]), "the same teeth of ring and planet meet"
            ),
        }

    def _orders_of_steps(self) -> dict[str, Order]:
        """Orders of a stage with stepped planets: a mesh at each of the two central wheels."""
        t, w, n = self.teeth, self.speeds, self.planets
        found = {m: Order(abs(w[m]), f"turns of the {m}") for m in self.members if m != self.fixed}
        found["planet"] = Order(abs(w["planet"] - w["carrier"]), "turns of a planet on the carrier")
        for (wheel, planet), name in zip(self._meshes, ("mesh", "mesh_2"), strict=True):
            past = abs(w[wheel] - w["carrier"])
            found |= {
                name: Order(
                    t[wheel] * past, f"teeth of the {wheel} x its turns against the carrier"
                ),
                f"{wheel}_tooth": Order(
                    past, f"a tooth of the {wheel} meets a planet again: {name} / {wheel}"
                ),
                f"{wheel}_pass": Order(
                    n * past, f"planets pass a tooth of the {wheel}: planets x {name} / {wheel}"
                ),
                f"hunting_{wheel}": Order(
                    t[wheel] * past / math.lcm(t[wheel], t[planet]),
                    f"the same teeth of {wheel} and {planet} meet",
                ),
            }
        return found

    def order(self, text: str) -> Fraction:
        """Cycles per turn of the input of a name, a multiple, or a sum, such as ``2 mesh -
        carrier``; ValueError.
        """
        at, total = 0, Fraction(0)
        while at < len(text.rstrip()):
            term = _TERM.match(text, at)
            if term is None or (at > 0 and not term[1]) or term[3] not in self.orders:
                raise ValueError(
                    f"'{text}' is not an order of this stage; the orders are"
                    f" {', '.join(self.orders)}, which may be multiplied and added, such as"
                    f" '2 mesh + {'carrier' if 'carrier' in self.orders else next(iter(self.orders))}'"
                )
            total += int(term[2] or 1) * self.orders[term[3]].cycles * (-1 if term[1] == "-" else 1)
            at = term.end()
        if total == 0:
            raise ValueError(f"'{text}' is no order; a frequency above 0 is expected")
        return abs(total)


class StageOrder(NamedTuple):
    """An order of one stage of a train."""

    stage: int
    name: str
    words: str
    cycles: Fraction
    """Per turn of the rotor."""


def speeds(train: tuple[GearStage, ...]) -> list[Fraction]:
    """Speeds of the stages' inputs and of the last output over the rotor's, one more than stages."""
    found = [Fraction(1)]
    for stage in train:
        found.append(found[-1] * stage.lead)
    return found


def train_orders(train: tuple[GearStage, ...]) -> list[StageOrder]:
    """Orders of every stage: its own, harmonics of the mesh, and the mesh's sidebands."""
    return [
        StageOrder(k, name, words, abs(speed) * stage.order(name))
        for k, (stage, speed) in enumerate(zip(train, speeds(train), strict=False), 1)
        for name, words in _words_of_orders(stage).items()
    ]


def _words_of_orders(stage: GearStage) -> dict[str, str]:
    """Descriptions of the orders of a stage."""
    words = {name: order.words for name, order in stage.orders.items()}
    if stage.stepped:
        return words | _words_of_stepped_meshes(stage)
    if stage.planetary:
        words["2 planet"] = "a tooth of a planet meets sun and ring"
        words[f"{stage.planets} mesh"] = "mesh of all planets"
    for n in (2, 3):
        words.setdefault(f"{n} mesh", f"harmonic {n} of the mesh")
    aside = ("ring_tooth", "ring_pass", "sun_tooth") if stage.planetary else ("pinion", "wheel")
    for name in aside:
        for sign in "-+":
            words[f"mesh {sign} {name}"] = f"sideband of the mesh, {name}"
    return words


def _words_of_stepped_meshes(stage: GearStage) -> dict[str, str]:
    """Harmonics and sidebands of both meshes of stepped planets."""
    words = {}
    for mesh in ("mesh", "mesh_2"):
        for n in (2, 3):
            words[f"{n} {mesh}"] = f"harmonic {n} of {mesh}"
    for wheel, mesh in zip(stage.members, ("mesh", "mesh_2"), strict=False):
        for name in (f"{wheel}_tooth", f"{wheel}_pass", "planet"):
            for sign in "-+":
                words[f"{mesh} {sign} {name}"] = f"sideband of {mesh}, {name}"
    return words


def input_inertia(train: tuple[GearStage, ...]) -> float:
    """Inertia of a train's wheels as the rotor feels it, each by the square of its speed [kg m^2]."""
    total = 0.0
    for stage, speed in zip(train, speeds(train), strict=False):
        total += float(speed) ** 2 * (
            stage.input_inertia + float(stage.lead) ** 2 * stage.output_inertia
        )
        if stage.planetary:
            total += (
                float(speed * stage.speeds["planet"]) ** 2 * stage.planets * stage.planet_inertia
            )
    return total


def backlash(train: tuple[GearStage, ...]) -> float:
    """Backlash of the stages at the output, one after the other [rad]."""
    through = speeds(train)
    return sum(
        abs(float(through[-1] / speed)) * s.backlash
        for s, speed in zip(train, through[1:], strict=True)
    )


def stiffness(train: tuple[GearStage, ...]) -> float | None:
    """Stiffness of the stages in series at the output [N m/rad]; None where all are rigid."""
    through = speeds(train)
    compliances = [
        float(through[-1] / speed) ** 2 / stage.stiffness
        for stage, speed in zip(train, through[1:], strict=True)
        if stage.stiffness is not None
    ]
    if compliances:
        return 1.0 / sum(compliances)
    return None
