"""The simulator's sizing for those who read it: settings, springs, tolerances, drawing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from microvib.io.scenario_file import dump_part
from microvib.reports.document import Fact, Text
from microvib.reports.outcome import Outcome, Part, Picture
from microvib.reports.parameters import parameter_table
from microvib.reports.sas_drawing import draw_simulator
from microvib.results import DIFFERENCE, FREQUENCY, Column, Measure, Table
from microvib.structures.simulator_design import SimulatorDesign
from microvib.studies.sas import Setting, Sizing, Tolerance, tolerance
from microvib.studies.sizing import SizingResult

INERTIA = Measure("kg m²")
SET_LENGTH = Measure("mm", 1e-3, ".1f")
FORCE = Measure("N")
MASS = Measure("kg")
SPRING_RATE = Measure("N/m")
STRESS = Measure("MPa", 1e6)
TOLERANCE = Measure("%", 0.01, ".2f")


@dataclass(frozen=True)
class SettingOfState:
    """The simulator set to one state."""

    state: Annotated[str, Column("state", "state")]
    frequency: Annotated[float, Column("frequency_hz", "f", FREQUENCY)]
    inertia: Annotated[float, Column("inertia_kg_m2", "J", INERTIA)]
    spring: Annotated[str, Column("spring", "spring")]
    rate: Annotated[float, Column("rate_n_m", "k", SPRING_RATE)]
    arm: Annotated[float, Column("arm_m", "arm l", SET_LENGTH)]
    counterweight: Annotated[float, Column("counterweight_kg", "weight", MASS)]
    radius: Annotated[float, Column("radius_m", "radius r", SET_LENGTH)]
    rigid_inertia: Annotated[float, Column("rigid_inertia_kg_m2", "J_h", INERTIA)]
    preload: Annotated[float, Column("preload_m", measure=SET_LENGTH)]
    force_min: Annotated[float, Column("force_min_n", measure=FORCE)]
    force_max: Annotated[float, Column("force_max_n", measure=FORCE)]
    stress: Annotated[float, Column("stress_pa", measure=STRESS)]
    allowable: Annotated[float, Column("allowable_pa", measure=STRESS)]
    elements_frequency: Annotated[float, Column("elements_frequency_hz", "FE f", FREQUENCY)]
    elements_inertia: Annotated[float, Column("elements_inertia_kg_m2", "FE J", INERTIA)]
    frequency_error: Annotated[float, Column("frequency_error", "f error", DIFFERENCE)]
    inertia_error: Annotated[float, Column("inertia_error", "J error", DIFFERENCE)]


@dataclass(frozen=True)
class EffectOfTolerance:
    """Effect of the tolerance of parts of one kind."""

    kind: Annotated[str, Column("part", "off by its tolerance")]
    frequency: Annotated[float, Column("relative_frequency", "f", TOLERANCE)]
    inertia: Annotated[float, Column("relative_inertia", "J", TOLERANCE)]


def sizing_outcome(result: SizingResult) -> Outcome:
    """A sizing for those who read it: the settings, what the springs bear, Eq. 21 to 24,
    tolerances, drawing and description.

    The file ``simulator.yaml`` is a source of modes.
    """
    sizing, design = result.sizing, result.sizing.target.design
    settings = Table.of(
        "sas", SettingOfState, map(_setting_of_state, sizing.settings), caption=_SETTINGS
    )
    found = tolerance(design)
    springs = [text for text in (*spring_sentences(result), array_sentence(result)) if text]
    drawing = Picture(
        "drawing",
        lambda: draw_simulator(sizing.target),
        "Dimensioned drawing",
        "Set to the target; to scale, dimensions in mm.",
        turned=True,
    )
    holds = _holds(sizing)
    return Outcome(
        "Simulator report",
        "Solar array simulator, sized",
        f"Torsion mode {FREQUENCY.figure(sizing.target.state.frequency)} with"
        f" {INERTIA.figure(sizing.target.state.inertia)} about the drive axis.",
        "pass" if holds else "fail",
        (_stress_fact(sizing, holds), *_design_facts(design)),
        (
            Part("", (settings, *map(Text, springs))),
            Part("Equations 21 to 24", (Text(equation_sentence(sizing.target)),)),
            Part("Tolerances", (Text(_TOLERANCES), _tolerance_table(found))),
            Part("Not checked", (Text(_NOT_CHECKED),)),
            Part("Drawing", (drawing,)),
            Part("Description", _description(design), report_only=True),
        ),
        descriptions={"simulator": design},
        data={"sas": _sizing_data(sizing.target, settings, found)},
        other_files={"simulator.yaml": dump_part(design)},
    )


_SETTINGS = (
    "Requested (f, J), set by hand calculation (arm l, radius r), checked with finite elements (FE);"
    " errors are those of FE against what was requested."
)
_TOLERANCES = (
    "First order. Worst case: all parts at their limits; standard deviation: each of the eight"
    " springs, four arms and four weights independently, anywhere within its limits. Springs of one"
    " batch deviate together, as in the worst case; the arm can trim that."
)
_NOT_CHECKED = (
    "Bending of the springs' hooks, their fatigue, play and friction of bearing and sliders, sag of"
    " the frame."
)


def _setting_of_state(x: Setting) -> SettingOfState:
    (f, J), (low, high) = x.finite_elements, x.forces
    return SettingOfState(
        x.state.name,
        x.state.frequency,
        x.state.inertia,
        x.design.spring.name,
        x.design.spring.rate,
        x.design.arm,
        x.design.counterweight.mass,
        x.design.counterweight.radius,
        x.design.J_h,
        x.design.preload,
        low,
        high,
        x.stress,
        x.allowable,
        f,
        J,
        f / x.state.frequency - 1.0,
        J / x.state.inertia - 1.0,
    )


def _tolerance_table(found: Tolerance) -> Table:
    two = tuple(2.0 * v for v in found.deviation)
    rows = {**found.contributions, "worst case, all": found.worst, "two standard deviations": two}
    return Table.of(
        "tolerances",
        EffectOfTolerance,
        [EffectOfTolerance(kind, f, J) for kind, (f, J) in rows.items()],
    )


def _description(design: SimulatorDesign) -> tuple[Text | Table, ...]:
    origin = (Text(design.source),) if design.source else ()
    return (*origin, parameter_table(design))


def _sizing_data(target: Setting, settings: Table, found: Tolerance) -> Mapping[str, Any]:
    """All figures of a sizing, SI units, angles in rad."""
    return {
        "amplitude_rad": target.amplitude,
        "settings": settings.records(),
        "equations": target.equations,
        "tolerance": {
            "relative_frequency_and_inertia": {
                name: list(pair) for name, pair in found.contributions.items()
            },
            "worst_case": list(found.worst),
            "standard_deviation": list(found.deviation),
        },
    }


def _holds(sizing: Sizing) -> bool:
    """Whether no spring goes slack or is overstressed."""
    return all(x.stress <= x.allowable and x.forces[0] > 0.0 for x in sizing.settings)


def _stress_fact(sizing: Sizing, holds: bool) -> Fact:
    if not holds:
        return Fact("does NOT hold", "a spring goes slack or is overstressed", "fail")
    used = max(x.stress / x.allowable for x in sizing.settings)
    return Fact(f"{100 * used:.0f} %", "of the allowed stress, no spring slack", "pass")


def _design_facts(design: SimulatorDesign) -> tuple[Fact, ...]:
    weight = design.counterweight
    return (
        Fact(SPRING_RATE.figure(design.spring.rate), f"eight springs {design.spring.name}"),
        Fact(SET_LENGTH.figure(design.arm), "arm l"),
        Fact(
            f"{MASS.figure(weight.mass)} at {SET_LENGTH.figure(weight.radius)}",
            "each counterweight",
        ),
    )


def spring_sentences(result: SizingResult) -> list[str]:
    """Springs, their load, and what a start of the drive asks of them."""
    setting = result.sizing.target
    d, s = setting.design, setting.design.spring
    worst = max(result.sizing.settings, key=lambda x: x.stress / x.allowable)
    low = min(x.forces[0] for x in result.sizing.settings)
    stretch = max(x.design.preload + x.move for x in result.sizing.settings)
    start = 2.0 * result.rate / (2.0 * math.pi * setting.state.frequency)
    springs = (
        f"Springs: eight {s.name}, k = {s.rate:g} N/m, wire {1e3 * s.wire:g} mm, coil"
        f" {1e3 * s.coil:g} mm, {s.coils:g} coils,"
        f" free length {1e3 * s.free_length:g} mm."
    )
    if not result.sizing.one_spring:
        springs += " Some states need other springs: see the table."
    tension = 100 * (d.stiffness / setting.equations["stiffness_n_m_per_rad"] - 1)
    return [
        springs,
        f"Preload: {1e3 * d.preload:.3g} mm, {d.spring_force:.3g} N, which stiffens torsion by"
        f" {tension:.2g} % (hooks {1e3 * d.plate.hook:g} mm off the middle line).",
        f"At {math.degrees(setting.amplitude):.3g} deg, all settings: tension at least {low:.3g} N,"
        " no spring slack; stretch at"
        f" most {1e3 * stretch:.3g} mm; shear stress at most {worst.stress / 1e6:.3g} MPa (Wahl"
        " factor"
        f" included) of {worst.allowable / 1e6:.3g} MPa allowed.",
        f"A start and a stop of the drive at {math.degrees(result.rate):.3g} deg/s, in the worst"
        " phase, move the frame by"
        f" {math.degrees(start):.2g} deg.",
        _adjustment_sentence(result.sizing),
    ]


def _adjustment_sentence(sizing: Sizing) -> str:
    a, designs = sizing.target.design.adjustment, [setting.design for setting in sizing.settings]
    arms, radii = [d.arm for d in designs], [d.counterweight.radius for d in designs]
    return (
        f"Adjustment: the settings use arms from {1e3 * min(arms):.1f} to {1e3 * max(arms):.1f} mm"
        f" of {1e3 * a.arm_min:g} to"
        f" {1e3 * a.arm_max:g} mm, radii from {1e3 * min(radii):.1f} to {1e3 * max(radii):.1f} mm"
        f" of {1e3 * a.radius_min:g} to"
        f" {1e3 * a.radius_max:g} mm."
    )


def equation_sentence(setting: Setting) -> str:
    """Eq. 21 to 24 with this setting's numbers."""
    e, d = setting.equations, setting.design
    return (
        f"Eq. 21, 22 at {math.degrees(setting.amplitude):.3g} deg: kinetic energy"
        f" {e['kinetic_energy_j']:.4g} J, spring energy"
        f" {e['spring_energy_j']:.4g} J. Eq. 23: 8 k l² = {e['stiffness_n_m_per_rad']:.4g} N m/rad"
        f" on {d.moving_inertia:.4g} kg m²"
        f" (the springs hold J less J_h = {d.J_h:.3g} kg m²). Eq. 24 as printed:"
        f" {e['printed_eq_24_rad_per_s']:.4g}, in rad/s;"
        f" with 1/2π {e['frequency_hz']:.4g} Hz, with the tension of the springs {d.frequency:.4g}"
        " Hz."
    )


def array_sentence(result: SizingResult) -> str:
    """Sentence on the part of the array that the simulator lacks."""
    model = result.array
    if model is None:
        return ""
    effective = model.effective[model.axis]
    k = int(effective.argmax())
    return (
        f"Of the array, mode {k + 1} at {model.frequency[k]:.4g} Hz holds"
        f" {100 * effective[k] / model.inertia:.1f} % of"
        f" {model.inertia:.4g} kg m². On the shaft the array has J_h = {model.J_h:.3g} kg m² with"
        f" {model.frequency.size} modes, the"
        f" simulator {result.sizing.target.design.J_h:.3g}: the drive's lines above the torsion"
        " mode are the simulator's own."
    )
