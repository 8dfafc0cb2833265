"""The simulator's sizing: its text, tables, drawing and report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from microvib.io.scenario_file import dump_part
from microvib.io.tables import rows_csv, to_json
from microvib.reports.blocks import figure_block, study_report
from microvib.reports.document import Contents, Document, Fact, Section, Text, table
from microvib.reports.parameters import parameter_table
from microvib.reports.sas_drawing import draw_simulator
from microvib.studies.sas import Setting, Sizing, tolerance
from microvib.studies.sizing import SizingResult
from microvib.text_tables import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADER = (
    "state", "f [Hz]", "J [kg m²]", "spring", "k [N/m]", "arm [mm]", "weight [kg]", "radius [mm]", "J_h [kg m²]",
    "FE f [Hz]", "off [%]", "FE J [kg m²]", "off [%]",
)  # fmt: skip


def setting_rows(sizing: Sizing) -> list[list[str]]:
    """Rows under ``HEADER``."""
    found = [(x.design, x.state, *x.finite_elements) for x in sizing.settings]
    return [
        [s.name, f"{s.frequency:.4g}", f"{s.inertia:.4g}", d.spring.name, f"{d.spring.rate:g}", f"{1e3 * d.arm:.1f}",
         f"{d.counterweight.mass:g}", f"{1e3 * d.counterweight.radius:.1f}", f"{d.J_h:.3f}", f"{f:.4f}",
         f"{100 * (f / s.frequency - 1):+.2f}", f"{J:.4f}", f"{100 * (J / s.inertia - 1):+.2f}"]
        for d, s, f, J in found
    ]  # fmt: skip


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


def tolerance_rows(setting: Setting) -> list[list[str]]:
    """What each kind of part may change in f and J, and all together."""
    found = tolerance(setting.design)
    two = tuple(2.0 * v for v in found.deviation)
    rows = {**found.contributions, "worst case, all": found.worst, "two standard deviations": two}
    return [[name, f"{100 * f:.2f}", f"{100 * J:.2f}"] for name, (f, J) in rows.items()]


def array_sentence(result: SizingResult) -> str:
    """What of the array the simulator does not have."""
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


TOLERANCE_HEADER = ("off by its tolerance", "f [%]", "J [%]")


def sizing_text(result: SizingResult) -> str:
    """What is printed."""
    blocks = [
        text_table(HEADER, setting_rows(result.sizing)),
        "",
        *spring_sentences(result),
        array_sentence(result),
    ]
    blocks += [equation_sentence(result.sizing.target), ""]
    return "\n".join(
        [*blocks, text_table(TOLERANCE_HEADER, tolerance_rows(result.sizing.target)), ""]
    )


def sizing_folder(result: SizingResult) -> Contents:
    """``sas.csv``, ``sas.json``, ``simulator.yaml`` (a source of modes), ``drawing.png``, the
    report.
    """
    figure, settings = (
        draw_simulator(result.sizing.target),
        [_values(setting) for setting in result.sizing.settings],
    )
    files: dict[str, Any] = {
        "sas.csv": rows_csv(list(settings[0]), [list(row.values()) for row in settings]),
        "sas.json": to_json(sas_data(result)),
        "simulator.yaml": dump_part(result.sizing.target.design),
        "drawing.png": lambda path: figure.savefig(path, format="png"),
    }
    return files, sizing_report(result, figure)


def _values(setting: Setting) -> dict[str, Any]:
    """A setting's row of ``sas.csv``; SI units."""
    d, s, (f, J), (low, high) = (
        setting.design,
        setting.state,
        setting.finite_elements,
        setting.forces,
    )
    return {
        "state": s.name, "frequency_hz": s.frequency, "inertia_kg_m2": s.inertia, "spring": d.spring.name,
        "rate_n_m": d.spring.rate, "arm_m": d.arm, "counterweight_kg": d.counterweight.mass, "radius_m": d.counterweight.radius,
        "rigid_inertia_kg_m2": d.J_h, "preload_m": d.preload, "force_min_n": low, "force_max_n": high,
        "stress_pa": setting.stress, "allowable_pa": setting.allowable, "elements_frequency_hz": f, "elements_inertia_kg_m2": J,
    }  # fmt: skip


def sas_data(result: SizingResult) -> dict[str, Any]:
    """All figures of a sizing, SI units, angles in rad."""
    target, found = result.sizing.target, tolerance(result.sizing.target.design)
    return {
        "amplitude_rad": target.amplitude,
        "settings": [_values(setting) for setting in result.sizing.settings],
        "equations": target.equations,
        "tolerance": {
            "relative_frequency_and_inertia": {
                name: list(pair) for name, pair in found.contributions.items()
            },
            "worst_case": list(found.worst),
            "standard_deviation": list(found.deviation),
        },
    }


def sizing_report(result: SizingResult, drawing: Figure) -> Document:
    """The report of a sizing: settings, springs, tolerances, drawing."""
    target = result.sizing.target
    caption = (
        "Requested, set by hand calculation (arm l, radius r), checked with finite elements (FE)."
    )
    rows = [row[:3] + row[4:] for row in setting_rows(result.sizing)]
    settings = table(HEADER[:3] + HEADER[4:], rows, caption)
    springs = [Text(text) for text in (*spring_sentences(result), array_sentence(result)) if text]
    tolerances = (
        "First order. Worst case: all parts at their limits; standard deviation: each of the eight"
        " springs, four arms and four"
        " weights independently, anywhere within its limits. Springs of one batch deviate together,"
        " as in the worst case; the arm"
        " can trim that."
    )
    unchecked = "Bending of the springs' hooks, their fatigue, play and friction of bearing and sliders, sag of the frame"
    scale = "Set to the target; to scale, dimensions in mm."
    origin = (Text(target.design.source),) if target.design.source else ()
    return study_report(
        "Simulator report",
        "Solar array simulator, sized",
        f"Torsion mode {target.state.frequency:.4g} Hz with {target.state.inertia:.4g} kg m² about"
        " the drive axis.",
        facts=_facts(result),
        first_page=(settings, *springs),
        sections=(
            Section("Equations 21 to 24", (Text(equation_sentence(target)),)),
            Section(
                "Tolerances", (Text(tolerances), table(TOLERANCE_HEADER, tolerance_rows(target)))
            ),
            Section("Not checked", (Text(f"{unchecked}."),)),
            Section("Drawing", (figure_block(drawing, "Dimensioned drawing", scale, turned=True),)),
            Section("Description", (*origin, parameter_table(target.design))),
        ),
        parts={"simulator": target.design},
    )


def _facts(result: SizingResult) -> list[Fact]:
    target, settings = result.sizing.target, result.sizing.settings
    d, used = target.design, max(x.stress / x.allowable for x in settings)
    holds = Fact(f"{100 * used:.0f} %", "of the allowed stress, no spring slack", "pass")
    if used > 1.0 or min(x.forces[0] for x in settings) <= 0.0:
        holds = Fact("does NOT hold", "a spring goes slack or is overstressed", "fail")
    return [
        holds,
        Fact(f"{d.spring.rate:g} N/m", f"eight springs {d.spring.name}"),
        Fact(f"{1e3 * d.arm:.1f} mm", "arm l"),
        Fact(
            f"{d.counterweight.mass:g} kg at {1e3 * d.counterweight.radius:.1f} mm",
            "each counterweight",
        ),
    ]
