"""A run from scenario to folder: simulate, find the lines, write everything."""

from __future__ import annotations

import math
import os
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from microvib.analysis.accuracy import accuracy, noted
from microvib.analysis.limits import Limit
from microvib.analysis.lines import lines
from microvib.analysis.steady import find_steady
from microvib.errors import ScenarioError
from microvib.io.results import check_room, lines_csv, summary, to_json, write_folder, write_motion
from microvib.io.scenario_file import dump_scenario
from microvib.model.scenario import Scenario
from microvib.reports.document import Form
from microvib.signals.line_table import LineTable
from microvib.solve.motion import CHANNELS, Invariants
from microvib.solve.simulate import Progress, from_rest


@dataclass(frozen=True)
class RunResult:
    """What a run leaves in memory: its lines, how far it can be trusted, and the files that it wrote."""

    table: LineTable
    invariants: Invariants
    solver: dict[str, Any]
    files: tuple[str, ...]
    fallback: str = ""
    """Why a steady state that was asked for was not found; the run then began at rest."""


def run_scenario(
    scenario: Scenario,
    out: Path,
    *,
    overwrite: bool = False,
    lines_only: bool = False,
    harmonics: int = 8,
    steady: bool = False,
    limit: Limit | None = None,
    form: Form | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Simulate and write the run's folder; nothing is written unless all of it can be.

    With ``steady``, which sets ``record.start``, the lines are those of the steady state, and the record starts in it instead of
    settling. The report judges lines by ``limit``, and is also written as ``form`` says.
    """
    begun = time.perf_counter()
    if not lines_only:
        _check_size(scenario, out)
    if steady:
        scenario = scenario.with_({"record.start": "steady"})
    state, fallback = find_steady(scenario) if scenario.record.start == "steady" else (None, "")
    files: dict[str, Any] = {}
    if state is not None:
        table, invariants, solver = lines(state, harmonics=harmonics), state.invariants, state.solver
    elif lines_only:
        from microvib.analysis.stream import lines_of_stream

        table, invariants, solver = lines_of_stream(scenario, harmonics, progress)
    if not lines_only:
        motion = state.motion(progress=progress) if state is not None else from_rest(scenario, progress=progress)
        if state is None:
            table, invariants, solver = lines(motion, harmonics=harmonics), motion.invariants, motion.solver
        found = accuracy(motion, table)
        table, solver = noted(table, solver, found)
        motion = replace(motion, solver=noted(table, motion.solver, found)[1])
        from microvib.reports.rendering import report_files
        from microvib.reports.run.report import run_report

        form = form or Form()
        files = {"motion.nc": lambda path: write_motion(motion, path)}
        files |= report_files(run_report(motion, table, limit=limit, form=form), form)
    if fallback:
        solver = {**solver, "steady": f"not used: {fallback}"}
    files["lines.csv"] = lines_csv(table)
    files["scenario.yaml"] = dump_scenario(scenario)
    timings = {"simulate": solver["wall_s"], "total": time.perf_counter() - begun}
    judged_by = {"limit": None if limit is None else asdict(limit)}  # so that the report can be made again
    files["summary.json"] = to_json(summary(scenario, invariants, solver, table, **timings) | judged_by)
    write_folder(out, files, overwrite)
    return RunResult(table, invariants, solver, tuple(files), fallback)


def _check_size(scenario: Scenario, out: Path) -> None:
    """Refuse a record that cannot be held in memory or written, before it is simulated."""
    size = 8.0 * scenario.record.samples * (len(CHANNELS) + 1 + 2 * len(scenario.array.modes))
    try:
        available = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # not known on this system
        available = math.inf
    if 3.0 * size > available:
        raise ScenarioError(
            f"record: {scenario.record.samples:.3g} samples need about {3 * size / 1e9:.3g} GB of memory and"
            f" {available / 1e9:.3g} GB are free; shorten record.duration, lower record.sample_rate, or keep the lines only",
            remedy="lines_only",
        )
    check_room(out, 1.02 * size + 2e6)
