"""Results as the page gets them: plain data, SI units."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from microvib.analysis.budget import TorqueContribution, torque_budget
from microvib.analysis.pointing import HubLines
from microvib.analysis.reference import compare_with_reference
from microvib.analysis.run import RunResult
from microvib.errors import MicrovibError
from microvib.export.targets import TARGETS, Target
from microvib.io.modal_sources import ModalSource, modal_source
from microvib.model.array import Array
from microvib.model.line_names import driving_line
from microvib.model.linear import coupled_modes
from microvib.model.part import to_plain_data
from microvib.model.scenario import Scenario
from microvib.reports.angles import angles_outcome
from microvib.reports.craft import craft_words, draw_craft
from microvib.reports.identification import fit_outcome
from microvib.reports.modes import mode_kinds
from microvib.reports.moving import (
    array_modes,
    craft_modes,
    shape_description,
    shape_of_array,
    shape_of_craft,
)
from microvib.reports.outcome import page_answer, text_files
from microvib.reports.quiet import quiet_outcome
from microvib.reports.rates import rates_outcome
from microvib.reports.rendering import address
from microvib.reports.run.outcome import run_outcome
from microvib.reports.sheets import svg
from microvib.results import file_record
from microvib.solve.channels import CHANNELS
from microvib.solve.motion import Motion
from microvib.studies.angles import AngleSweep
from microvib.studies.identify import Fit
from microvib.studies.quiet.study import QuietDrive
from microvib.studies.rates import RateCase, RatePlan
from microvib.web.routes.forms import values_of

_MAX_MODES = 40


def run_result(result: RunResult, motion: Motion) -> dict[str, Any]:
    """Everything of a run but the samples of its ``motion``: its outcome, and what the page draws
    of it.
    """
    scenario, table, hub = result.scenario, result.table, result.hub
    first = [x.frequency for x in table if x.name == driving_line(1) and math.isfinite(x.frequency)]
    shares = torque_budget(motion, first)
    return page_answer(run_outcome(result)) | {
        "title": scenario.title,
        "values": values_of(scenario),
        "lines": [file_record(line) for line in table],
        "budget": [_budget_row(name, share) for name, share in shares.items()],
        "measured": [file_record(row) for row in compare_with_reference(scenario, table)],
        "drivetrain": _drivetrain(motion, shares),
        "modes": [asdict(mode) for mode in coupled_modes(scenario)],
        "craft": None if hub is None else _craft(hub),
        "exports": [_export(target, scenario) for target in TARGETS.values()],
        "channels": [asdict(channel) for channel, x in motion.variables() if x.ndim == 1],
        "t0": float(motion.time[0]),
        "t1": float(motion.time[-1]),
        "sample_rate": motion.sample_rate,
    }


def _export(target: Target, scenario: Scenario) -> dict[str, Any]:
    """A format of another tool: its files and options, and why a run of this scenario cannot have them."""
    return {
        "target": target.name,
        "gives": target.gives,
        "files": [f"{target.name}{ending}" for ending in target.endings],
        "missing": target.missing or target.refuses(scenario),
        "options": [asdict(option) for option in target.offered],
    }


def _craft(hub: HubLines) -> dict[str, Any]:
    """The craft's drawing, lines of the line of sight, and what its pixels are."""
    spacecraft, locked = hub.scenario.spacecraft, hub.scenario.craft
    assert spacecraft is not None
    assert locked is not None
    los = spacecraft.line_of_sight
    lines = zip(hub.names, hub.frequency.tolist(), hub.amplitude.tolist(), strict=True)
    return {
        "words": craft_words(spacecraft),
        "drawing": address(svg(draw_craft(hub.scenario))),
        "lines": [
            {
                "line": name,
                "frequency_hz": f,
                "los": angles if los is not None else None,
                "rings": name in hub.rings,
                "noise": name in hub.driven,
            }
            for name, f, angles in lines
        ],
        "noise": hub.density is not None,
        "windows": list(hub.windows),
        "pixel": None if los is None else los.pixel,
    }


def _statistics(share: TorqueContribution) -> dict[str, float]:
    return {"mean": share.mean, "rms": share.rms, "peak": share.peak}


def _budget_row(name: str, share: TorqueContribution) -> dict[str, Any]:
    """A torque's statistics, and its part in the first driving line: amplitude, and phase at the
    first sample.
    """
    if share.tones.size:
        tone = complex(share.tones[0])
    else:
        tone = complex(math.nan, math.nan)
    phase = {"drive_1_amplitude": abs(tone), "drive_1_phase": math.atan2(tone.imag, tone.real)}
    return {"torque": name, "meaning": CHANNELS[name].meaning, **_statistics(share), **phase}


def _drivetrain(motion: Motion, shares: dict[str, TorqueContribution]) -> dict[str, Any]:
    """Which torque goes where, in numbers."""
    span = float(motion.time[-1] - motion.time[0])
    energies = {name: motion[name] for name in motion.channels if name.startswith("E_")}
    return {
        "u_rms": _rms(motion["u_A"], motion["u_B"]),
        "i_rms": _rms(motion["i_A"], motion["i_B"]),
        **{name: _statistics(share) for name, share in shares.items()},
        "stuck_rotor": float(motion["stuck_rotor"].mean()),
        "stuck_output": float(motion["stuck_output"].mean()),
        "power": {name[2:]: float(E[-1] - E[0]) / span for name, E in energies.items()},
        "rate": motion.scenario.rate,
        "f_d": motion.scenario.driving_frequency,
    }


def _rms(*phases: np.ndarray) -> float:
    """Root mean square of one phase, over both."""
    return math.sqrt(float(np.mean([np.mean(x**2) for x in phases])))


def identification_result(fit: Fit, scenario: Scenario) -> dict[str, Any]:
    """Result of an identification, and the changes to take over."""
    quantities = {key: quantity for key, _, quantity in fit.scenario.entries()}
    fitted = {e.key: quantities[e.key] for e in fit.estimates}
    changes = {
        e.key: q.format(e.estimate) for e in fit.estimates if (q := fitted[e.key]) is not None
    }
    changes |= {e.key: f"{e.estimate:.0f}" for e in fit.whole}
    return page_answer(fit_outcome(fit, scenario)) | {
        "scenario_changes": changes,
        "usable": fit.usable,
    }


def rates_result(plan: RatePlan) -> dict[str, Any]:
    """Result of a plan, with the page's drawings: lines over rate and microstep count, rates
    in rad/s."""
    cases = [
        {
            "rate": case.rate,
            "microsteps": case.microsteps,
            "lines": [
                {"line": x.name, "frequency": x.frequency, "amplitude": x.amplitude}
                for x in case.lines
            ],
            "nearest": _nearest(plan, case),
        }
        for case in plan.cases
    ]
    return page_answer(rates_outcome(plan)) | {
        "cases": cases,
        "modes": [asdict(mode) for mode in plan.modes],
        "resonances": [asdict(r) for r in plan.resonances],
        "forbidden": [asdict(b) for b in plan.forbidden],
        "limit": plan.limit,
        "band": list(plan.band),
    }


def _nearest(plan: RatePlan, case: RateCase) -> dict[str, Any] | None:
    """The line of a case that is nearest to a limit over frequency, and what that allows it; None without
    such a limit or a line."""
    line = None if plan.curve is None else plan.governing(case)
    if line is None:
        return None
    return {"line": line.name, "amplitude": line.amplitude, "allowed": plan.allowed_to(case)}


def angles_result(sweep: AngleSweep) -> dict[str, Any]:
    """Result of a sweep, its pictures and files."""
    outcome = angles_outcome(sweep)
    return page_answer(outcome, pictures=True) | {"files": text_files(outcome)}


def quiet_result(found: QuietDrive, limit: float | None) -> dict[str, Any]:
    """Result of a search, its pictures and files, and the changes that make the drive quieter."""
    outcome = quiet_outcome(found, limit)
    return page_answer(outcome, pictures=True) | {
        "files": text_files(outcome),
        "scenario_changes": _lever_changes(found),
        "searched": found.setting is not None,
    }


def _lever_changes(found: QuietDrive) -> dict[str, str]:
    """The keys that the levers set as texts that one would type; a table, also one that was judged, as a
    whole.
    """
    texts = values_of(found.quieter)
    changes = {key: texts[key] for lever in found.levers for key in lever.keys if key in texts}
    table = found.quieter.driver.table
    if table != found.scenario.driver.table and table is not None:
        changes["driver.table"] = json.dumps(to_plain_data(table, text=True))
    return changes


def shapes_result(scenario: Scenario, of: str, structure: str | None) -> dict[str, Any]:
    """Modes of array or craft: their figures, and shapes that move. ``structure`` is what the
    array's finite elements are of.
    """
    source = _elements(scenario.array, structure)
    modes = source.modes if source else None
    if of == "craft":
        moving = shape_of_craft(scenario, modes)
    else:
        moving = shape_of_array(scenario.array, modes)
    if not moving.shapes.shape[2]:
        raise MicrovibError(
            "array.modes: is empty, the array is rigid; give modes, or take it from finite elements"
            " (array.fem)"
        )
    kept = slice(_MAX_MODES)
    if of == "craft":
        columns = craft_modes(scenario, moving)
    else:
        columns = array_modes(scenario.array, mode_kinds(source) if source else None)
    return {
        "header": list(columns),
        "rows": [list(row) for row in zip(*columns.values(), strict=True)][kept],
        "words": shape_description(scenario, of, modes is not None),
        "moving": replace(moving, shapes=moving.shapes[:, :, kept]).data(),
    }


def _elements(array: Array, structure: str | None) -> ModalSource | None:
    """The finite elements that the array's modes come from; None where there are none, or the modes
    are others by now.
    """
    if structure is None or not array.modes or array.interface is None:
        return None
    source = modal_source(structure, len(array.modes))
    found, told = source.model, [mode.frequency for mode in array.modes]
    same = np.allclose(found.frequency, told, 1e-6, 0.0) and np.allclose(
        found.participation, array.interface, 1e-6, 1e-6
    )
    if same:
        return source
    return None
