"""The report of a run: one HTML file that opens without a network."""

from __future__ import annotations

import base64
import io
import math
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.app import plots
from microvib.io.results import package_versions, scenario_hash
from microvib.model.linear import coupled_modes
from microvib.model.part import Part, entries
from microvib.model.scenario import Scenario
from microvib.signals.lines import FAINT, Line, LineTable
from microvib.signals.spectrum import tone_amplitude
from microvib.solve.motion import Motion
from microvib.studies.paper import compare_with_paper, standing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BUDGET = {
    "T_d": "T_d on the spacecraft",
    "T_e": "T_e motor",
    "T_f_m": "T_f,m rotor friction",
    "T_f": "T_f output friction",
    "T_g": "T_g gear on the output",
    "T_l": "T_l load of the array",
}
_INVARIANTS = {
    "torque_forms": "largest difference of momentum form and force form of T_d, over the largest T_d (algebra: rounding)",
    "momentum": "mean torque that the change of angular momentum does not account for, over the largest T_d",
    "energy": "|energy in - stored - dissipated| over the electrical energy put in",
    "energy_mechanical": "the same over the energy beyond Joule heat, which is the sharper figure",
    "energy_in": "electrical energy put in [J]",
    "energy_dissipated": "energy dissipated [J]",
    "energy_stored": "change of stored energy [J]",
}


def run_report(motion: Motion, table: LineTable) -> str:
    """HTML text of the report on one run."""
    scenario = motion.scenario
    versions = package_versions()
    shown = table.notable()
    return render(
        "report.html",
        title=scenario.title or "microvib run",
        axis=scenario.array.drive_axis,
        command=_command(scenario),
        source=scenario.source,
        facts=_facts(motion, table),
        lines=[_line_row(line) for line in shown],
        hidden_lines=_left_out(table, shown),
        paper=_paper_rows(scenario, table),
        standing=standing(scenario),
        figures=_figures(motion, table),
        budget=_budget(motion, shown),
        modes=_modes(scenario),
        parameters=_parameters(scenario),
        invariants=_invariant_rows(motion),
        solver=[(k, f"{v:.4g}" if isinstance(v, float) else v) for k, v in motion.solver.items()],
        version=versions.pop("microvib"),
        versions=list(versions.items()),
        hash=scenario_hash(scenario),
    )  # fmt: skip


def render(template: str, **values: Any) -> str:
    """A template of this package, filled in, with the common style."""
    from jinja2 import Environment
    from markupsafe import Markup

    folder = resources.files("microvib.app") / "templates"
    text = (folder / template).read_text(encoding="utf-8")
    style = Markup((folder / "style.css").read_text(encoding="utf-8"))
    return Environment(autoescape=True).from_string(text).render(style=style, **values)


def _command(scenario: Scenario) -> str:
    rate, record = scenario.rate, scenario.record
    what = (
        "with a rate that changes in the record" if rate is None else f"at {math.degrees(rate):.6g} deg/s of the array"
    )
    return f"Recorded for {record.duration:g} s at {record.sample_rate:g} Hz after {record.settle:g} s, {what}."


def _facts(motion: Motion, table: LineTable) -> list[dict[str, str]]:
    seen = [line for line in table if line.status in ("ok", "decaying", "growing")]
    facts = [{"value": f"{1e3 * np.abs(motion['T_d']).max():.4g} mN m", "label": "largest disturbance torque"}]
    facts.append({"value": f"{1e3 * motion['T_d'].std():.4g} mN m", "label": "RMS about the mean"})
    for line in sorted(seen, key=lambda x: -x.amplitude_n_m)[:2]:
        facts.append(
            {"value": f"{1e3 * line.amplitude_n_m:.4g} mN m", "label": f"{line.line} at {line.frequency_hz:.5g} Hz"}
        )
    if "stuck_output" in motion.channels:
        facts.append({"value": f"{100 * motion['stuck_output'].mean():.3g} %", "label": "of the time the shaft sticks"})
    return facts


def _left_out(table: LineTable, shown: tuple[Line, ...]) -> str:
    """A sentence on the lines that are left to the CSV file."""
    faint = [line.line for line in table if line.status == FAINT]
    small = [line for line in table if line not in shown and line.status != FAINT]
    parts = []
    if small:
        parts.append(f"{len(small)} small ones are in lines.csv only.")
    if faint:
        parts.append(f"Looked for and not found above the floor: {', '.join(faint)}.")
    return " ".join(parts)


def _number(value: float, digits: int = 4, scale: float = 1.0) -> str:
    return "" if not math.isfinite(value) else f"{value * scale:#.{digits}g}".rstrip(".")


def _line_row(line: Line) -> dict[str, str]:
    return {
        "line": line.line,
        "expected": _number(line.expected_hz, 7),
        "found": _number(line.frequency_hz, 7),
        "amplitude": _number(line.amplitude_n_m, 4, 1e3),
        "phase": f"{line.phase_rad:.3f}" if math.isfinite(line.phase_rad) else "",
        "bin_hz": _number(line.bin_frequency_hz, 7),
        "bin": _number(line.bin_amplitude_n_m, 4, 1e3),
        "origin": line.origin,
        "status": line.status,
    }


def _paper_rows(scenario: Scenario, table: LineTable) -> list[dict[str, str]]:
    return [
        {
            "line": row.line,
            "test_hz": f"{row.test_hz:g}",
            "paper_hz": f"{row.paper_hz:g}",
            "ours_hz": f"{row.ours_hz:g}",
            "test": _number(row.test_n_m, 4, 1e3),
            "paper": _number(row.paper_n_m, 4, 1e3),
            "ours": _number(row.ours_n_m, 4, 1e3),
            "paper_error": f"{100 * row.paper_error:+.1f} %",
            "our_error": f"{100 * row.our_error:+.1f} %",
        }
        for row in compare_with_paper(scenario, table)
    ]


def _figures(motion: Motion, table: LineTable) -> dict[str, str]:
    history, axes = plots.new_figure(11.0, 3.3, 1, 2)
    plots.draw_history(axes[0, 0], motion)
    plots.draw_stretch(axes[0, 1], motion)
    whole, axes = plots.new_figure(11.0, 4.2)
    plots.draw_spectrum(axes[0, 0], motion, table)
    zoom, axes = plots.new_figure(11.0, 3.4)
    plots.draw_array_zoom(axes[0, 0], motion, table)
    torques, axes = plots.new_figure(11.0, 3.8, 1, 2)
    plots.draw_torques(axes[0, 0], motion)
    plots.draw_motor_torques(axes[0, 1], motion)
    return {
        "history": picture(history), "spectrum": picture(whole), "zoom": picture(zoom), "torques": picture(torques),
    }  # fmt: skip


def picture(figure: Figure) -> str:
    """A figure as a data address, so that the page needs no other file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()


def _budget(motion: Motion, shown: tuple[Line, ...]) -> dict[str, Any]:
    main = sorted((x for x in shown if np.isfinite(x.amplitude_n_m)), key=lambda x: -x.amplitude_n_m)[:5]
    main.sort(key=lambda x: x.frequency_hz)
    rows = []
    for name, label in _BUDGET.items():
        x = motion[name]
        amplitudes = [_number(tone_amplitude(x, motion.sample_rate, line.frequency_hz), 4, 1e3) for line in main]
        rows.append(
            {
                "label": label,
                "mean": _number(float(x.mean()), 4, 1e3),
                "peak": _number(float(np.abs(x).max()), 4, 1e3),
                "amplitudes": amplitudes,
            }
        )
    return {"lines": [line.line for line in main], "rows": rows}


def _modes(scenario: Scenario) -> list[dict[str, str]]:
    return [
        {
            "name": mode.name,
            "fixed": "" if mode.fixed_frequency is None else f"{mode.fixed_frequency:.6g}",
            "coupled": f"{mode.frequency:.6g}",
            "damping": f"{mode.damping:.4g}",
        }
        for mode in coupled_modes(scenario)[:40]
    ]


def _parameters(scenario: Scenario) -> list[dict[str, Any]]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for key, value, quantity in scenario.entries():
        if value is None or value == ():
            continue
        source = scenario.source_of(key)
        groups.setdefault(key.split(".")[0], []).append(
            {
                "key": key.split(".", 1)[-1],
                "value": quantity.show(value) if quantity and isinstance(value, float) else str(value),
                "meaning": quantity.meaning if quantity else _description(scenario, key),
                "source": source,
                "assumed": source.startswith("assumed"),
            }
        )
    return [{"name": name, "entries": entries} for name, entries in groups.items()]


def parameter_rows(part: Part) -> list[list[str]]:
    """Key, value and meaning of every parameter of a part."""
    rows = []
    for key, value, quantity in entries("", part, None):
        key = key.lstrip(".")
        if value is None or value == () or key in ("title", "source"):
            continue
        shown = quantity.show(value) if quantity and isinstance(value, float) else str(value)
        rows.append([key, shown, quantity.meaning if quantity else _description(part, key)])
    return rows


def _description(part: Any, key: str) -> str:
    *path, last = key.split(".")
    for name in path:
        part = part[int(name)] if name.isdigit() else getattr(part, name)
    field = type(part).model_fields.get(last) if isinstance(part, Part) else None
    return (field.description or "") if field else ""


def _invariant_rows(motion: Motion) -> list[dict[str, str]]:
    values = vars(motion.invariants)
    return [{"name": name, "value": f"{values[name]:.3g}", "meaning": meaning} for name, meaning in _INVARIANTS.items()]
