"""A run from scenario to folder: solve it, write everything."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from microvib.analysis.run import RunResult, run_scenario
from microvib.errors import ScenarioError, expect, expect_path
from microvib.io.band_limits import BandLimit
from microvib.io.runs import (
    SECOND_LINES,
    SECOND_MOTION,
    SEED_PEAKS,
    account_of_drive,
    lines_csv,
    seed_peaks_csv,
    seeds_csv,
    summary,
    write_motion,
)
from microvib.io.scenario_file import dump_scenario
from microvib.io.tables import rows_csv, to_json
from microvib.io.writing import check_room, write_folder
from microvib.model.line_names import SECOND_DRIVE
from microvib.model.scenario import Scenario
from microvib.reports.bands import bands_files, with_bands
from microvib.reports.densities import densities_csv
from microvib.reports.document import Form
from microvib.reports.outcome import Outcome, report
from microvib.reports.rendering import report_files
from microvib.reports.run.outcome import run_outcome
from microvib.signals.limit_curve import Limit
from microvib.solve.integration import Progress
from microvib.solve.motion import record_bytes
from microvib.studies.bands import judge_bands_of_run


def run_to_folder(  # noqa: PLR0913 - keyword options
    scenario: Scenario,
    out: Path,
    *,
    overwrite: bool = False,
    lines_only: bool = False,
    harmonics: int = 8,
    seeds: int = 0,
    limit: Limit | None = None,
    band_limits: Sequence[BandLimit] = (),
    roll_off: float | None = None,
    form: Form | None = None,
    progress: Progress | None = None,
) -> tuple[RunResult, Outcome, tuple[str, ...]]:
    """``run_scenario`` into a folder; the result, what is said of it, and the names of its files.

    A record that has no room is refused before it is simulated, and nothing is written unless all
    of it can be.
    """
    begun = time.perf_counter()
    if not lines_only:
        _check_size(scenario, out)
    result = run_scenario(
        scenario, harmonics=harmonics, lines_only=lines_only, seeds=seeds, progress=progress
    )
    peaks = judge_bands_of_run(result, band_limits, roll_off)
    outcome = with_bands(run_outcome(result, limit), peaks)
    judged_by = _judged_by(limit, band_limits, roll_off)
    files = _contents(result, outcome, judged_by, form or Form(), begun) | bands_files(peaks)
    write_folder(out, files, overwrite)
    return result, outcome, tuple(files)


def write_run(
    result: RunResult,
    out: Path | str,
    *,
    overwrite: bool = False,
    limit: Limit | None = None,
    form: Form | None = None,
) -> tuple[str, ...]:
    """Write a run's folder, all of it or nothing.

    Parameters
    ----------
    result : RunResult
        What ``run_scenario`` found.
    out : str or path
        The folder.
    overwrite : bool
        Replace a folder that is there.
    limit : Limit, optional
        Limit by which the report judges the lines.
    form : Form, optional
        How the report is written besides.

    Returns
    -------
    tuple of str
        Names of the files.

    Raises
    ------
    OutputError
        Where the folder is there, or cannot be written.
    ObjectError
        For what is no run.
    """
    expect(result, RunResult, "what a run found (mv.run_scenario)")
    expect_path(out)
    files = _contents(result, run_outcome(result, limit), _judged_by(limit), form or Form())
    write_folder(Path(out), files, overwrite)
    return tuple(files)


def _judged_by(
    limit: Limit | None, band_limits: Sequence[BandLimit] = (), roll_off: float | None = None
) -> dict[str, Any]:
    """Limits that a run was judged by, for ``summary.json``, so that its report can be made again."""
    told: dict[str, Any] = {"limit": None if limit is None else limit.as_dict()}
    if band_limits:
        told["band_limits"] = {
            "roll_off": roll_off,
            "bands": [asdict(one) for one in band_limits],
        }
    return told


def _contents(
    result: RunResult,
    outcome: Outcome,
    judged_by: dict[str, Any],
    form: Form,
    begun: float | None = None,
) -> dict[str, Any]:
    """Files of a run that ``begun`` [s] on the clock of ``time.perf_counter``, by name."""
    files: dict[str, Any] = {}
    if result.motion is not None:
        files["motion.nc"] = partial(write_motion, result.motion)
        if result.motion.second_wing is not None:
            files[SECOND_MOTION] = partial(write_motion, result.motion.second_wing)
        files |= report_files(report(outcome), form)
    total = {} if begun is None else {"total": time.perf_counter() - begun}
    summed = run_summary(result, **total)
    summed |= {**outcome.data, **judged_by}
    return files | run_texts(result, summed) | dict(outcome.other_files)


def run_summary(result: RunResult, **timings: float) -> dict[str, Any]:
    """Summary of a run for ``summary.json``."""
    timings = {"simulate": result.solver["wall_s"], **timings}
    second = result.second
    told = summary(result.scenario, result.invariants, result.solver, result.table, **timings)
    if second is None:
        return told
    return told | {SECOND_DRIVE: account_of_drive(second.invariants, second.solver, second.table)}


def run_texts(result: RunResult, summed: dict[str, Any]) -> dict[str, str]:
    """The files of a run that are text, by name; ``summed`` is its summary."""
    files, of_hub = {"lines.csv": lines_csv(result.table)}, result.hub
    if result.table.seeds:
        files["seeds.csv"] = seeds_csv(result.table)
    if result.table.seed_peaks is not None:
        files[SEED_PEAKS] = seed_peaks_csv(result.table.seed_peaks)
    if of_hub is not None:
        if result.second is not None:
            files[SECOND_LINES] = lines_csv(result.second.table)
        files["loads.csv"] = rows_csv(*of_hub.loads_table(result.left_out))
        if result.motion is not None:
            files["densities.csv"] = densities_csv(result.motion)
        if of_hub.second is not None:
            files["loads_wing_2.csv"] = rows_csv(*of_hub.loads_table(result.left_out, second=True))
        if of_hub.los is not None:
            files["pointing.csv"] = rows_csv(*of_hub.pointing_table(result.left_out))
            summed = summed | {"pointing": of_hub.summary()}
    return files | {
        "scenario.yaml": dump_scenario(result.scenario),
        "summary.json": to_json(summed),
    }


def _check_size(scenario: Scenario, out: Path) -> None:
    size = record_bytes(scenario)
    try:
        available = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # not known on this system
        available = math.inf
    if 3.0 * size > available:
        raise ScenarioError(
            f"record: {scenario.record.samples:.3g} samples need about {3 * size / 1e9:.3g} GB of"
            " memory and"
            f" {available / 1e9:.3g} GB are free; shorten record.duration, lower"
            " record.sample_rate, or keep the lines only",
            remedy="lines_only",
        )
    check_room(out, 1.02 * size + 2e6)
