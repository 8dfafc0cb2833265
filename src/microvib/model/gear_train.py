"""Gear trains of spur and planetary stages: ratios and orders by their teeth, exact as fractions.

A stage turns its input into its output; speeds are over that of the stage's input, and keep their signs.
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

MEMBERS = ("sun", "ring", "carrier")
_TERM = re.compile(r"\s*([+-]?)\s*(\d{0,4})\s*\*?\s*([a-z_]+)")

Teeth = Annotated[int, Field(ge=4, le=10_000, strict=True)]


class Order(NamedTuple):
    """Cycles per turn of the stage's input, and the formula in words."""

    cycles: Fraction
    words: str


class StageError(Part):
    """Kinematic error of a stage at one of its orders: amplitude x sin(order angle + phase), added to the output's angle."""

    order: str = Field(
        max_length=100, description="one of the stage's orders by name, a multiple, or a sum such as 2 mesh + carrier"
    )
    amplitude: Annotated[
        float, Quantity("rad", "amplitude at the stage's output", ge=0, display="arcsec", usual=(1e-7, 0.02))
    ]
    phase: Annotated[float, Quantity("rad", "phase at the rotor's zero", display="deg")] = 0.0


class GearStage(Part):
    """A spur stage (pinion and wheel) or a planetary one (sun, planets on a carrier, ring), from input to output."""

    pinion: Teeth | None = Field(default=None, description="teeth of the driving wheel of a spur stage")
    wheel: Teeth | None = Field(default=None, description="teeth of the driven wheel of a spur stage")
    internal: bool = Field(default=False, description="whether the driven wheel has its teeth inside")
    sun: Teeth | None = Field(default=None, description="teeth of the sun of a planetary stage")
    planet: Teeth | None = Field(default=None, description="teeth of a planet; null is half of ring less sun")
    ring: Teeth | None = Field(default=None, description="teeth of the ring of a planetary stage")
    planets: Annotated[int, Field(ge=1, le=20, strict=True, description="number of planets")] = 3
    equally_spaced: bool = Field(default=True, description="whether planets stand at equal angles")
    fixed: Literal["ring", "carrier", "sun"] = Field(
        default="ring", description="member of a planetary stage that stands"
    )
    input: Literal["sun", "ring", "carrier"] | None = Field(
        default=None, description="member that is driven; null is the sun, or the ring where the sun stands"
    )
    input_inertia: Annotated[
        float, Quantity("kg*m^2", "inertia of pinion or driven member with its shaft", ge=0, display="kg*cm^2")
    ] = 0.0
    output_inertia: Annotated[
        float, Quantity("kg*m^2", "inertia of wheel or output member with its shaft", ge=0, display="kg*cm^2")
    ] = 0.0
    planet_inertia: Annotated[
        float, Quantity("kg*m^2", "inertia of each planet about its own axis", ge=0, display="kg*cm^2")
    ] = 0.0
    stiffness: (
        Annotated[
            float,
            Quantity("N*m/rad", "torsional stiffness at the stage's output; null is rigid", gt=0, usual=(1.0, 1e7)),
        ]
        | None
    ) = None
    backlash: Annotated[
        float,
        Quantity("rad", "angle between the flanks, at the stage's output", ge=0, display="arcsec", usual=(1e-6, 0.1)),
    ] = 0.0
    errors: tuple[StageError, ...] = Field(
        default=(), max_length=100, description="kinematic errors at orders of this stage"
    )

    def _misfits(self) -> Iterator[str]:
        given = [name for name in ("pinion", "wheel", "sun", "planet", "ring") if getattr(self, name) is not None]
        if given not in (["pinion", "wheel"], ["sun", "ring"], ["sun", "planet", "ring"]):
            yield (
                f"has the teeth of {', '.join(given) or 'nothing'}; pinion and wheel are expected, or sun and ring, of which planet"
                " may be given too"
            )
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
                f"planet: ring less sun is {ring - sun}, odd, so that planets have shifted profiles; give their number of teeth"
            )
        elif self.planet is not None and abs(2 * self.planet - (ring - sun)) > 4:
            yield f"planet: {self.planet} teeth do not fit between a sun of {sun} and a ring of {ring}"
        elif self.equally_spaced and (sun + ring) % self.planets:
            yield (
                f"planets: {self.planets} cannot be assembled at equal angles between a sun of {sun} and a ring of {ring}, since"
                f" {sun + ring} teeth are no multiple of {self.planets}; if they stand at others, equally_spaced: false"
            )
        else:
            # teeth of both mesh with a planet's at multiples of a turn over sun + ring; tips stand a module beyond the pitch circle
            places, apart = sun + ring, (planet + 2) / max(sun + planet, ring - planet)
            room = max(n for n in range(1, 21) if n == 1 or math.sin(math.pi * (places // n) / places) > apart)
            if self.planets > room:
                yield f"planets: {self.planets} of {planet} teeth overlap about a sun of {sun}; at most {room} have room"
        if self.driven == self.fixed:
            yield f"input: the {self.fixed} stands (fixed); another member is expected"

    @property
    def planetary(self) -> bool:
        """Whether this is a planetary stage."""
        return self.sun is not None

    @property
    def teeth(self) -> dict[str, int]:
        """Numbers of teeth by wheel."""
        if not self.planetary:
            return {"pinion": int(self.pinion or 0), "wheel": int(self.wheel or 0)}
        sun, ring = int(self.sun or 0), int(self.ring or 0)
        return {"sun": sun, "planet": self.planet or (ring - sun) // 2, "ring": ring}

    @property
    def driven(self) -> str:
        """The member that is the input."""
        if not self.planetary:
            return "pinion"
        return self.input or ("ring" if self.fixed == "sun" else "sun")

    @property
    def output(self) -> str:
        """The member that is the output."""
        return next(m for m in MEMBERS if m not in (self.fixed, self.driven)) if self.planetary else "wheel"

    @property
    def speeds(self) -> dict[str, Fraction]:
        """Speed of each wheel, and of a carrier, over that of the input; a planet's is its own turning in space."""
        t = self.teeth
        if not self.planetary:
            return {"pinion": Fraction(1), "wheel": Fraction(t["pinion"], t["wheel"]) * (1 if self.internal else -1)}
        # Willis: sun and ring turn oppositely as seen from the carrier, S (sun - carrier) + R (ring - carrier) = 0
        weights = {"sun": t["sun"], "ring": t["ring"], "carrier": -(t["sun"] + t["ring"])}
        speed = {self.fixed: Fraction(0), self.driven: Fraction(1)}
        speed[self.output] = -Fraction(weights[self.driven], weights[self.output])
        speed["planet"] = speed["carrier"] - (speed["sun"] - speed["carrier"]) * Fraction(t["sun"], t["planet"])
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
                "hunting": Order(mesh / math.lcm(*t.values()), "the same two teeth meet: mesh / lcm(pinion, wheel)"),
            }
        of_sun, of_ring = abs(w["sun"] - w["carrier"]), abs(w["ring"] - w["carrier"])
        mesh, n = t["sun"] * of_sun, self.planets
        turns = {m: Order(abs(w[m]), f"turns of the {m}") for m in MEMBERS if m != self.fixed}
        return turns | {
            "planet": Order(mesh / t["planet"], "turns of a planet on the carrier: mesh / planet"),
            "mesh": Order(mesh, "teeth of the sun x its turns against the carrier, as of the ring"),
            "sun_tooth": Order(of_sun, "a tooth of the sun meets a planet again: mesh / sun"),
            "ring_tooth": Order(of_ring, "a tooth of the ring meets a planet again: mesh / ring"),
            "sun_pass": Order(n * of_sun, "planets pass a tooth of the sun: planets x mesh / sun"),
            "ring_pass": Order(n * of_ring, "planets pass a tooth of the ring: planets x mesh / ring"),
            "hunting_sun": Order(mesh / math.lcm(t["sun"], t["planet"]), "the same teeth of sun and planet meet"),
            "hunting_ring": Order(mesh / math.lcm(t["ring"], t["planet"]), "the same teeth of ring and planet meet"),
        }

    def order(self, text: str) -> Fraction:
        """Cycles per turn of the input of a name, a multiple, or a sum, such as ``2 mesh - carrier``; ValueError."""
        at, total = 0, Fraction(0)
        while at < len(text.rstrip()):
            term = _TERM.match(text, at)
            if term is None or (at > 0 and not term[1]) or term[3] not in self.orders:
                raise ValueError(
                    f"'{text}' is none of this stage's; names are {', '.join(self.orders)}, to be multiplied and added such as"
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
    rows = []
    for k, (stage, speed) in enumerate(zip(train, speeds(train), strict=False), 1):
        told = {name: order.words for name, order in stage.orders.items()}
        if stage.planetary:
            told |= {
                "2 planet": "a tooth of a planet meets sun and ring",
                f"{stage.planets} mesh": "mesh of all planets",
            }
        told |= {f"{n} mesh": f"harmonic {n} of the mesh" for n in (2, 3) if f"{n} mesh" not in told}
        aside = ("ring_tooth", "ring_pass", "sun_tooth") if stage.planetary else ("pinion", "wheel")
        told |= {f"mesh {sign} {name}": f"sideband of the mesh, {name}" for name in aside for sign in "-+"}
        rows += [StageOrder(k, name, words, abs(speed) * stage.order(name)) for name, words in told.items()]
    return rows


def input_inertia(train: tuple[GearStage, ...]) -> float:
    """Inertia of a train's wheels as the rotor feels it, each by the square of its speed [kg m^2]."""
    total = 0.0
    for stage, speed in zip(train, speeds(train), strict=False):
        total += float(speed) ** 2 * (stage.input_inertia + float(stage.lead) ** 2 * stage.output_inertia)
        if stage.planetary:
            total += float(speed * stage.speeds["planet"]) ** 2 * stage.planets * stage.planet_inertia
    return total


def backlash(train: tuple[GearStage, ...]) -> float:
    """Backlash of the stages at the output, one after the other [rad]."""
    through = speeds(train)
    return sum(abs(float(through[-1] / speed)) * s.backlash for s, speed in zip(train, through[1:], strict=True))


def stiffness(train: tuple[GearStage, ...]) -> float | None:
    """Stiffness of the stages in series at the output [N m/rad]; None where all are rigid."""
    through = speeds(train)
    compliances = [
        float(through[-1] / speed) ** 2 / stage.stiffness
        for stage, speed in zip(train, through[1:], strict=True)
        if stage.stiffness is not None
    ]
    return 1.0 / sum(compliances) if compliances else None
