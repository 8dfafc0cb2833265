"""A run from scenario to folder: simulate, find the lines, write everything."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from microvib.app.analysis import lines
from microvib.io.results import lines_csv, summary, to_json, write_folder, write_motion
from microvib.io.scenario_file import dump_scenario
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.signals.lines import LineTable
from microvib.solve.motion import Invariants
from microvib.solve.simulate import Progress, simulate


@dataclass(frozen=True)
class RunResult:
    """What a run leaves in memory: its lines, how far it can be trusted, and the files that it wrote."""

    table: LineTable
    invariants: Invariants
    solver: dict[str, Any]
    files: tuple[str, ...]


def run_scenario(
    scenario: Scenario,
    out: Path,
    *,
    overwrite: bool = False,
    lines_only: bool = False,
    harmonics: int = 8,
    progress: Progress | None = None,
) -> RunResult:
    """Simulate and write the run's folder; nothing is written unless all of it can be."""
    begun = time.perf_counter()
    if lines_only:
        from microvib.app.long_runs import lines_of_stream

        table, invariants, solver = lines_of_stream(scenario, harmonics, progress)
        files: dict[str, Any] = {}
    else:
        motion = simulate(scenario, progress=progress)
        table, invariants, solver = lines(motion, harmonics=harmonics), motion.invariants, motion.solver
        from microvib.app.report import run_report

        files = {"motion.nc": lambda path: write_motion(motion, path), "report.html": run_report(motion, table)}
    files["lines.csv"] = lines_csv(table)
    files["scenario.yaml"] = dump_scenario(scenario)
    timings = {"simulate": solver["wall_s"], "total": time.perf_counter() - begun}
    files["summary.json"] = to_json(summary(scenario, invariants, solver, table, **timings))
    write_folder(out, files, overwrite)
    return RunResult(table, invariants, solver, tuple(files))


def derived(scenario: Scenario) -> list[str]:
    """Values that follow from a scenario and that an engineer wants to see before running it."""
    motor, driver, reducer, array = scenario.motor, scenario.driver, scenario.reducer, scenario.array
    step, f_d = driver.full_step(motor), scenario.driving_frequency
    texts = [
        f"full step {math.degrees(step):.6g} deg, microstep {math.degrees(step) / driver.microsteps:.6g} deg at the rotor (Eq. 25)",
        f"driving frequency f_d {f_d:.6g} Hz (Eq. 26)"
        if f_d
        else "driving frequency: the rate is zero or changes in the record",
        f"electromagnetic spring z K_m I {motor.electromagnetic_stiffness:.6g} N m/rad at the rotor,"
        f" {motor.electromagnetic_stiffness * reducer.ratio**2:.6g} N m/rad at the output",
        f"breakaway torque of the output {scenario.friction.breakaway_torque:.6g} N m, slip ring included (Eq. 6, 7)",
        f"rigidly attached inertia J_h {array.J_h:.6g} kg m², of J {array.inertia:.6g} kg m²",
    ]
    for mode in coupled_modes(scenario)[:12]:
        clamped = "" if mode.fixed_frequency is None else f", clamped {mode.fixed_frequency:.6g} Hz"
        texts.append(
            f"{mode.name}: {mode.frequency:.6g} Hz through the drive{clamped}, damping ratio {mode.damping:.4g}"
        )
    return texts
