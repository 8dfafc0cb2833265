"""Sizing of a solar array simulator: stock springs, arm, counterweights and preload for a frequency
and an inertia (Eq. 21-24).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.io.tables import read_table
from microvib.model.sentences import validate_part
from microvib.structures import springs
from microvib.structures.modal import ModalModel
from microvib.structures.simulator_design import COUNTERWEIGHTS, CoilSpring, SimulatorDesign
from microvib.structures.springs import SPRINGS, torsion_stiffness
from microvib.units import Si

SLACK_RESERVE = 1.5
"""Preload over the largest move of a spring: none goes slack up to that multiple of the amplitude."""
SETTING_RESOLUTION = 1e-4
"""To what a person sets arm, radius and preload [m]."""


class SizingError(MicrovibError):
    """State beyond the simulator's reach; the message has the limit that binds and what is allowed."""


@dataclass(frozen=True)
class TargetState:
    """State that a simulator represents: torsional frequency [Hz] and whole inertia about the drive
    axis [kg m^2].
    """

    name: str
    frequency: float
    inertia: float


@dataclass(frozen=True)
class Setting:
    """A simulator set to a state, and what its springs bear at an amplitude."""

    state: TargetState
    design: SimulatorDesign
    amplitude: float
    """Largest angle between frame and plate [rad]."""

    @property
    def move(self) -> float:
        """Change of length of a spring [m]."""
        return self.design.arm * self.amplitude

    @property
    def forces(self) -> tuple[float, float]:
        """Smallest and largest tension of a spring [N]."""
        F, change = self.design.spring_force, self.design.spring.rate * self.move
        return F - change, F + change

    @property
    def stress(self) -> float:
        """Largest shear stress in a spring's coils [Pa]."""
        return springs.coil_stress(self.forces[1], self.design.spring.wire, self.design.spring.coil)

    @property
    def allowable(self) -> float:
        """Allowable stress [Pa]."""
        return springs.allowable_stress(self.design.spring.wire)

    @property
    def margin(self) -> float:
        """Distance of the arm from the nearer end of its range, over the range."""
        a, arm = self.design.adjustment, self.design.arm
        return min(arm - a.arm_min, a.arm_max - arm) / (a.arm_max - a.arm_min)

    @cached_property
    def finite_elements(self) -> tuple[float, float]:
        """Torsional frequency [Hz] and inertia [kg m^2] of the meshed simulator."""
        from microvib.structures.fem.described import solve_design

        modes = solve_design(self.design, 4)
        torsion = int(np.argmax(np.abs(modes.participation[5])))
        return float(modes.frequency[torsion]), float(modes.mass[5, 5])

    @property
    def equations(self) -> dict[str, float]:
        """Eq. 21 to 24 at this setting, as they stand: without what tension adds, J_SAS the inertia
        that the springs hold.
        """
        d = self.design
        printed = 2.0 * d.arm * math.sqrt(2.0 * d.spring.rate / d.moving_inertia)
        return {
            "kinetic_energy_j": springs.kinetic_energy(d.moving_inertia, printed * self.amplitude),
            "spring_energy_j": springs.spring_energy(
                d.spring.rate, d.arm, d.preload, self.amplitude
            ),
            "stiffness_n_m_per_rad": torsion_stiffness(d.spring.rate, d.arm),
            "printed_eq_24_rad_per_s": printed,
            "frequency_hz": springs.torsion_frequency(d.spring.rate, d.arm, d.moving_inertia),
        }


@dataclass(frozen=True)
class Sizing:
    """A sized simulator: set to its target, and to the further states."""

    target: Setting
    states: tuple[Setting, ...]

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The target's setting and those of the further states."""
        return (self.target, *self.states)

    @property
    def one_spring(self) -> bool:
        """Whether no state asks for other springs."""
        return len({s.design.spring for s in self.settings}) == 1


def stock_springs() -> tuple[CoilSpring, ...]:
    """Springs of the catalog's table: rates in steps of E12, which a maker winds to order or has in
    stock.
    """
    return tuple(
        CoilSpring(
            name=row["name"],
            rate=Si(row["rate_n_m"]),
            wire=Si(float(row["wire_mm"]) * 1e-3),
            coil=Si(float(row["coil_mm"]) * 1e-3),
            coils=float(row["coils"]),
            free_length=Si(float(row["free_length_mm"]) * 1e-3),
            initial_tension=Si(row["initial_tension_n"]),
        )
        for row in read_table("stock_springs")
    )


def catalog_states() -> tuple[TargetState, ...]:
    """The five states of the catalog, state-1 to state-5."""
    rows = read_table("simulator_states")
    return tuple(
        TargetState(
            f"state {row['state']}", float(row["mode_frequency_hz"]), float(row["inertia_kg_m2"])
        )
        for row in rows
    )


def state_of_array(model: ModalModel, name: str) -> TargetState:
    """State that represents an array: the frequency of its dominant torsion mode, and
    its inertia.
    """
    dominant = int(np.argmax(model.effective[model.axis]))
    return TargetState(name, float(model.frequency[dominant]), model.inertia)


def size(
    target: TargetState, states: Sequence[TargetState], base: SimulatorDesign, amplitude: float
) -> Sizing:
    """``base`` with springs, preload, arm and counterweights for ``target`` and ``states``;
    ``amplitude`` [rad].

    One spring for all where a stock spring reaches all, that whose arms stay farthest from the ends
    of their range. Raises SizingError.
    """
    fitted = [_fitted(base, spring, amplitude) for spring in stock_springs()]
    usable = [design for design in fitted if _springs_suffice(design, amplitude)]
    if not usable:
        raise SizingError(_amplitude_sentence(base, amplitude))
    wanted = (target, *states)
    reached = [
        [s for state in wanted if (s := _setting_for_state(design, state, amplitude))]
        for design in usable
    ]
    complete = [row for row in reached if len(row) == len(wanted)]
    best = max(complete, key=lambda row: min(s.margin for s in row), default=None)
    if best is None:
        best = [
            _best(state, usable, [s for row in reached for s in row if s.state is state])
            for state in wanted
        ]
    return Sizing(best[0], tuple(best[1:]))


def _fitted(base: SimulatorDesign, spring: CoilSpring, amplitude: float) -> SimulatorDesign:
    preload = _round_to_setting(SLACK_RESERVE * base.adjustment.arm_max * amplitude)
    own = {"spring": spring, "preload": preload, "reference": ()}  # it is no longer that simulator
    return base.model_copy(update=own)


def _round_to_setting(length: float) -> float:
    return round(round(length / SETTING_RESOLUTION) * SETTING_RESOLUTION, 9)


def _springs_suffice(design: SimulatorDesign, amplitude: float) -> bool:
    """Whether the springs fit between slider and rail and bear their largest stretch at the longest
    arm.
    """
    fits = design.hook_end + design.adjustment.screw <= design.frame.rail
    longest = design.model_copy(update={"arm": design.adjustment.arm_max})
    setting = Setting(TargetState("", 0.0, 0.0), longest, amplitude)
    return fits and setting.stress <= setting.allowable


def _best(
    state: TargetState, usable: Sequence[SimulatorDesign], found: Sequence[Setting]
) -> Setting:
    if not found:
        raise SizingError(_state_sentence(state, usable))
    return max(found, key=lambda s: s.margin)


def _setting_for_state(
    design: SimulatorDesign, state: TargetState, amplitude: float
) -> Setting | None:
    """The design set to a state, or None where that is out of its reach."""
    arm = arm_for(design, state)
    a = design.adjustment
    if not a.arm_min <= arm <= a.arm_max:
        return None
    placed = design.model_copy(
        update={"arm": min(max(_round_to_setting(arm), a.arm_min), a.arm_max)}
    )
    middle = 0.5 * (a.radius_min + a.radius_max)
    radii = {
        m: r
        for m in a.masses
        if a.radius_min <= (r := radius_for(placed, state, m)) <= a.radius_max
    }
    if not radii:
        return None
    mass = min(radii, key=lambda m: abs(radii[m] - middle))
    radius = min(max(_round_to_setting(radii[mass]), a.radius_min), a.radius_max)
    weight = design.counterweight.model_copy(update={"mass": mass, "radius": radius})
    title = f"Solar array simulator set to {state.frequency:.4g} Hz, {state.inertia:.4g} kg m²"
    source = f"Sized by microvib from: {design.title}. {design.source}"[:4000]
    final = placed.model_copy(update={"counterweight": weight, "title": title, "source": source})
    return Setting(state, validate_part(SimulatorDesign, final.model_dump(), si=True), amplitude)


def arm_for(design: SimulatorDesign, state: TargetState) -> float:
    """Arm l [m] that gives a state's frequency, with the sliders on the shaft at that arm, too; 0
    where no arm is short enough.
    """
    W2 = (2.0 * math.pi * state.frequency) ** 2
    with_arm = SPRINGS / 2 * (design.plate.slider_mass + design.spring.mass)
    fixed = design.J_h - with_arm * design.arm**2
    tension = design.stiffness - torsion_stiffness(design.spring.rate, design.arm)
    square = (W2 * (state.inertia - fixed) - tension) / (
        SPRINGS * design.spring.rate + W2 * with_arm
    )
    return math.sqrt(max(square, 0.0))


def radius_for(design: SimulatorDesign, state: TargetState, mass: float) -> float:
    """Radius [m] at which counterweights of ``mass`` [kg] give a state's inertia; 0 where the frame
    alone has more.
    """
    needed = (state.inertia - _with_weights(design, mass, 0.0)) / COUNTERWEIGHTS
    return math.sqrt(max(needed, 0.0) / (mass + design.frame.weight_seat_mass))


def _with_weights(design: SimulatorDesign, mass: float, radius: float) -> float:
    """Whole inertia [kg m^2] with counterweights of ``mass`` [kg] at ``radius`` [m]."""
    weight = design.counterweight.model_copy(update={"mass": mass, "radius": radius})
    return design.model_copy(update={"counterweight": weight}).inertia


def _amplitude_sentence(base: SimulatorDesign, amplitude: float) -> str:
    low, high = 0.0, amplitude
    for _ in range(40):  # halving: both limits grow with the amplitude
        middle = 0.5 * (low + high)
        works = any(
            _springs_suffice(_fitted(base, spring, middle), middle) for spring in stock_springs()
        )
        if works:
            low = middle
        else:
            high = middle
    preload = SLACK_RESERVE * base.adjustment.arm_max * amplitude
    return (
        f"an amplitude of {math.degrees(amplitude):.4g} deg at an arm of"
        f" {1e3 * base.adjustment.arm_max:g} mm requires a preload of"
        f" {1e3 * preload:.3g} mm, for which every stock spring is too long between slider and rail"
        " or too highly stressed;"
        f" allowed is at most {math.degrees(low):.3g} deg"
    )


def _state_sentence(state: TargetState, usable: Sequence[SimulatorDesign]) -> str:
    """Which limit keeps a state out of reach: inertia first, then frequency."""
    a, what = usable[0].adjustment, f"{state.name}: "
    arms = [min(max(arm_for(design, state), a.arm_min), a.arm_max) for design in usable]
    placed = [
        design.model_copy(update={"arm": arm}) for design, arm in zip(usable, arms, strict=True)
    ]
    least = min(_with_weights(design, min(a.masses), a.radius_min) for design in placed)
    most = max(_with_weights(design, max(a.masses), a.radius_max) for design in placed)
    masses = ", ".join(f"{m:g}" for m in a.masses)
    if not least <= state.inertia <= most:
        low = state.inertia < least
        if low:
            m, r, J = (min(a.masses), a.radius_min, least)
        else:
            m, r, J = (max(a.masses), a.radius_max, most)
        return (
            f"{what}an inertia of {state.inertia:g} kg*m^2 is out of reach: counterweights of {m:g}"
            f" kg at {1e3 * r:g} mm give"
            f" {J:.4g} kg*m^2; allowed are {least:.4g} to {most:.4g} kg*m^2"
        )
    if not any(
        a.radius_min <= radius_for(d, state, m) <= a.radius_max for d in placed for m in a.masses
    ):
        return (
            f"{what}an inertia of {state.inertia:g} kg*m^2 lies between what counterweights of"
            f" {masses} kg reach from"
            f" {1e3 * a.radius_min:g} to {1e3 * a.radius_max:g} mm; add a mass to adjustment.masses"
        )
    slow = min(_frequency_at(design, state, a.arm_min) for design in usable)
    fast = max(_frequency_at(design, state, a.arm_max) for design in usable)
    if state.frequency < slow:
        which, end, given = ("softest", a.arm_min, slow)
    else:
        which, end, given = ("stiffest", a.arm_max, fast)
    return (
        f"{what}a frequency of {state.frequency:g} Hz with {state.inertia:g} kg*m^2 is out of"
        f" reach: the {which} stock springs at"
        f" an arm of {1e3 * end:g} mm give {given:.4g} Hz; allowed are {slow:.4g} to {fast:.4g} Hz"
    )


def _frequency_at(design: SimulatorDesign, state: TargetState, arm: float) -> float:
    placed = design.model_copy(update={"arm": arm})
    return math.sqrt(placed.stiffness / max(state.inertia - placed.J_h, 1e-9)) / (2.0 * math.pi)


@dataclass(frozen=True)
class Tolerance:
    """How far frequency and inertia may be off, relative, and what from."""

    contributions: dict[str, tuple[float, float]]
    """Worst case of each kind of part alone: (frequency, inertia)."""
    worst: tuple[float, float]
    deviation: tuple[float, float]
    """Standard deviation, each part for itself anywhere within its limits."""


def parts_of(design: SimulatorDesign) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Values that may be off, part by part, their limits each way, and their kinds, (p,)."""
    t, w = design.tolerances, design.counterweight
    table = [
        ("rate", SPRINGS, design.spring.rate, t.rate * design.spring.rate),
        ("arm", 4, design.arm, t.arm),
        ("mass", COUNTERWEIGHTS, w.mass, t.mass * w.mass),
        ("radius", COUNTERWEIGHTS, w.radius, t.radius),
        ("frame", 1, design.frame_inertia, t.frame * design.frame_inertia),
        ("preload", 1, design.preload, t.preload * design.preload),
    ]
    kinds, values, limits = zip(
        *(row[:1] + row[2:] for row in table for _ in range(row[1])), strict=True
    )
    return np.array(values), np.array(limits), kinds


def response(design: SimulatorDesign, values: np.ndarray) -> tuple[Any, Any]:
    """Torsional frequency [Hz] and inertia [kg m^2] with single parts off: ``values`` (..., p) as
    ``parts_of`` orders them.
    """
    rate, arm, mass, radius, frame, preload = np.split(
        values, np.cumsum([SPRINGS, 4, 4, 4, 1]), axis=-1
    )
    d, f, w = design, design.frame, design.counterweight
    force = d.spring.initial_tension + rate * preload
    length = d.spring.free_length + preload
    stiffness = (
        rate * np.repeat(arm, 2, axis=-1) ** 2
        + springs.preload_stiffness(force, d.plate.hook, length) / SPRINGS
    )
    seats = (f.spring_seat_mass + d.spring.mass) * (arm**2 - d.arm**2)
    weights = (
        (mass + f.weight_seat_mass) * radius**2
        + mass * w.diameter**2 / 8.0
        + f.weight_seat_mass * f.rail**2 / 3
    )
    moving = frame[..., 0] + d.seats_inertia + seats.sum(-1) + weights.sum(-1)
    on_shaft = d.J_h + ((d.plate.slider_mass + d.spring.mass) * (arm**2 - d.arm**2)).sum(-1)
    return np.sqrt(stiffness.sum(-1) / moving) / (2.0 * np.pi), moving + on_shaft


def tolerance(design: SimulatorDesign) -> Tolerance:
    """First-order propagation of the parts' tolerances."""
    values, limits, kinds = parts_of(design)
    steps = np.diag(1e-3 * limits)
    nominal = np.array(response(design, values))
    up, down = (np.array(response(design, values + side * steps)) for side in (1.0, -1.0))
    change = (up - down) / 2e-3 / nominal[:, None]  # of each part at its limit, (2, p)
    size = np.abs(change)
    groups = {
        kind: tuple(size[:, [k == kind for k in kinds]].sum(axis=1).tolist())
        for kind in dict.fromkeys(kinds)
    }
    deviation = np.sqrt(
        (size**2).sum(axis=1) / 3.0
    )  # variance of a uniform distribution: a third of limit^2
    return Tolerance(groups, tuple(size.sum(axis=1).tolist()), tuple(deviation.tolist()))
