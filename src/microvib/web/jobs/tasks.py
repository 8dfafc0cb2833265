"""Tasks of workers. Each leaves ``result.json`` in its folder, and what belongs to it; errors
are MicrovibErrors.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from microvib.analysis.accuracy import with_known_error
from microvib.analysis.band_levels import band_levels
from microvib.analysis.lines import steady_lines
from microvib.analysis.run import run_scenario
from microvib.errors import MicrovibError
from microvib.export.subject import subject_of
from microvib.export.targets import target_of_file
from microvib.io.runs import write_motion
from microvib.io.tables import to_json
from microvib.model.line_names import driving_line
from microvib.model.linear import linear_lines
from microvib.model.part import Part
from microvib.model.scenario import Scenario
from microvib.reports import rendering
from microvib.reports.angles import angles_outcome
from microvib.reports.identification import values_text
from microvib.reports.outcome import page_answer, page_facts, page_part, report
from microvib.reports.rates import rates_outcome
from microvib.reports.run.folder import run_summary, run_texts
from microvib.reports.run.outcome import judge_run, judged_parts, run_facts, run_outcome
from microvib.reports.sas import sizing_outcome
from microvib.reports.sensitivity import ranking_outcome
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import BELOW_FLOOR
from microvib.studies.angles import sweep_angles
from microvib.studies.campaign.design import Design
from microvib.studies.evidence import evidence_of
from microvib.studies.identify import identify, parse_key
from microvib.studies.rates import plan_rates
from microvib.studies.sensitivity import sensitivities
from microvib.studies.sizing import size_simulator
from microvib.studies.workers import parallel_calls
from microvib.units import Band, Si
from microvib.web.jobs import ProgressCallback, campaigns, results
from microvib.web.jobs.budgets import budget, budget_file  # noqa: F401 - as those below
from microvib.web.jobs.drawn_limits import drawn_limit
from microvib.web.jobs.envelopes import envelope  # noqa: F401 - as those below
from microvib.web.jobs.kept_runs import keep_run, kept_run
from microvib.web.jobs.processing import Preparing, RecordedFile
from microvib.web.jobs.quieter import quiet, quiet_problem  # noqa: F401 - as those above
from microvib.web.jobs.recording_tasks import (  # noqa: F401 - tasks are called by their names here
    analysis,
    batch,
    comparison,
    preparation,
    prepared,
    recording,
    repeated,
    samples,
    tracking,
)
from microvib.web.jobs.study_files import keep_tables
from microvib.web.jobs.table_tests import acceptance, hammer  # noqa: F401 - as those above
from microvib.web.routes.forms import Spec, array_structure, view_of


def _write(folder: str, data: dict[str, Any]) -> None:
    (Path(folder) / "result.json").write_text(to_json(data), encoding="utf-8")


def run(folder: str, scenario: Scenario, tell: ProgressCallback, seeds: int = 0) -> None:
    """Simulate a scenario, over ``seeds`` draws of its noise where they are given.

    Leaves channels as ``NAME.npy``, tables, and what ``file`` needs.
    """

    def progress(done: float, total: float) -> None:
        tell(done, total, "s", "simulating" if done < total else "finding the lines")

    result = run_scenario(
        scenario,
        seeds=seeds,
        progress=progress,
        drawn=lambda k: tell(k, seeds, "draws", "drawing the noise"),
    )
    motion = result.motion
    assert motion is not None
    texts = run_texts(result, run_summary(result))
    keep_run(Path(folder), result, motion)
    for name, text in texts.items():
        (Path(folder) / name).write_text(text, encoding="utf-8")
    _write(folder, results.run_result(result, motion) | {"files": list(texts)})


def file(
    folder: str, name: str, tell: ProgressCallback, mark: str = "", limit: Limit | None = None
) -> None:
    """``motion.nc``, ``report.html`` or ``report.pdf`` of a run's folder, made when it is asked
    for, as ``mark`` and its name.
    """
    where = Path(folder)
    result = kept_run(where)
    new = where / f"{os.getpid()}-{mark}{name}"  # two may ask at once
    if name == "motion.nc":
        assert result.motion is not None
        write_motion(result.motion, new)
    else:
        document = report(run_outcome(result, limit))
        if name == "report.pdf":
            new.write_bytes(rendering.pdf(document))
        else:
            new.write_text(rendering.html(document), encoding="utf-8")
    new.replace(where / (mark + name))


def export(folder: str, name: str, tell: ProgressCallback, options: Part, mark: str = "") -> None:
    """A run as a file of another tool, called by target and ending, such as ``nastran.bdf``; made as
    ``mark`` and its name.
    """
    where = Path(folder)
    found = target_of_file(name)
    assert found is not None
    target, ending = found
    with TemporaryDirectory(dir=where) as made:
        new = Path(made) / f"run{ending}"
        target.write(subject_of(kept_run(where)), new, options)
        new.replace(where / f"export-{mark}{name}")


def verdict(folder: str, limit: Limit, tell: ProgressCallback) -> dict[str, Any]:
    """Lines of a run against a limit."""
    result = kept_run(Path(folder))
    judged = judge_run(result, limit)
    levels = None
    if result.second is None:
        levels = asdict(band_levels(with_known_error(result.table), limit.low, limit.high))
    return drawn_limit(judged) | {
        "levels": levels,
        "facts": page_facts(run_facts(result, judged)),
        "parts": [page_part(part) for part in judged_parts(result, judged) if part.items],
    }


def lines_now(scenario: Scenario, linear: bool, tell: ProgressCallback) -> dict[str, Any]:
    """Lines of the steady state, or of the linearised drive, at once; ``reason`` says why the former
    are those of a run in time.
    """
    if linear:
        driving = linear_lines(scenario)
        if not driving:
            raise MicrovibError(
                "the linearised drive has lines at a constant rate only, and none of a pulse drive"
            )
        lines = [
            {"line": driving_line(x.order), "frequency": x.frequency, "amplitude": abs(x.amplitude)}
            for x in driving
        ]
        return {"lines": lines, "reason": ""}
    found = steady_lines(scenario)
    seen = [x for x in found.lines if x.status != BELOW_FLOOR and x.amplitude > 0.0]
    lines = [
        {"line": x.name, "frequency": x.frequency, "amplitude": x.amplitude}
        for x in seen
        if math.isfinite(x.frequency)
    ]
    return {"lines": lines, "reason": found.fallback}


def view(spec: dict[str, Any], tell: ProgressCallback) -> dict[str, Any]:
    """A scenario that needs finite elements, as the form shows it."""
    return view_of(Spec(**spec))


def identification(  # noqa: PLR0913 - what a process is sent
    folder: str,
    recordings: list[RecordedFile],
    scenario: Scenario,
    channel: str,
    fit: list[str],
    starts: int,
    tell: ProgressCallback,
    preparing: Preparing | None = None,
) -> None:
    """Parameters from recordings."""

    def progress(stage: str, simulations: int, cost: float, best: dict[str, float]) -> None:
        tell(simulations, None, "simulations", f"{stage} search, best so far: {values_text(best)}")

    keys = [parse_key(scenario, text) for text in fit]
    how = preparation(folder, preparing)
    tests: list[tuple[Any, dict[str, object]]] = [
        (evidence_of(prepared(one, how), scenario, channel), {}) for one in recordings
    ]
    found = identify(scenario, tests, keys, starts=starts, progress=progress)
    _write(folder, results.identification_result(found, scenario))


def rates(  # noqa: PLR0913 - what a process is sent
    folder: str, scenario: Scenario, rates: Sequence[Si], microsteps: list[int], limit: Limit | None, band: Band,
    linear: bool, tell: ProgressCallback,
) -> None:  # fmt: skip
    """A rate plan."""
    plan = plan_rates(
        scenario, rates, microsteps, limit=limit, band=band, linear=linear,
        progress=lambda done, total: tell(done, total, "cases", "solving"),
    )  # fmt: skip
    keep_tables(Path(folder), rates_outcome(plan))
    _write(folder, results.rates_result(plan))


def angles(
    folder: str,
    scenario: Scenario,
    angles: Sequence[Si],
    limit: Limit | None,
    tell: ProgressCallback,
) -> None:
    """A sweep over angles of the array, judged at each of them where there is a limit."""
    found = sweep_angles(
        scenario, angles, limit=limit, progress=lambda done, total: tell(done, total, "angles", "simulating"),
    )  # fmt: skip
    keep_tables(Path(folder), angles_outcome(found))
    _write(folder, results.angles_result(found))


def campaign(folder: str, tell: ProgressCallback, design: Design | None = None) -> None:
    """A campaign of ``design``, or the rest of the one that is in the folder."""
    _write(folder, campaigns.compute(Path(folder), design, tell))


def sweep(folder: str, design: Design, key: str, linear: bool, tell: ProgressCallback) -> None:
    """Lines of a scenario over one value: of the steady state, or of the linearised drive."""

    axis = campaigns.values_of_key(design, key)

    def lines(value: float) -> dict[str, Any]:
        text = f"{value!r} {axis['unit']}".strip()
        point = {"value": text, "lines": [], "reason": "", "error": ""}
        try:
            return point | lines_now(design.base.with_({key: text}), linear, tell)
        except MicrovibError as error:  # the other points have their lines nevertheless
            return point | {"error": str(error)}

    with parallel_calls(lambda done, total: tell(done, total, "points", "solving")) as calls:
        points = calls(lines, [(value,) for value in axis["values"]])
    if all(point["error"] for point in points):
        raise MicrovibError(points[0]["error"])
    _write(folder, axis | {"linear": linear, "points": points})


def campaign_case(folder: str, number: int, tell: ProgressCallback) -> dict[str, Any]:
    """A case of a campaign as changes of its scenario."""
    return campaigns.case(Path(folder), number)


def campaign_report(folder: str, name: str, tell: ProgressCallback) -> None:
    """``report.html`` or ``report.pdf`` of a campaign, made when it is asked for."""
    campaigns.write_report(Path(folder), name)


def shapes(
    folder: str, scenario: Scenario, of: str, spec: dict[str, Any], tell: ProgressCallback
) -> None:
    """Shapes of modes; ``spec`` is what the scenario was made of, which may name finite elements of
    the array.
    """
    tell(0, None, "", "finding the shapes")
    _write(folder, results.shapes_result(scenario, of, array_structure(Spec(**spec))))


def sensitivity(folder: str, scenario: Scenario, tell: ProgressCallback) -> None:
    """Which uncertain value matters most for each line."""
    found = sensitivities(
        scenario, progress=lambda done, total: tell(done, total, "runs", "simulating")
    )
    _write(folder, page_answer(ranking_outcome(found, scenario)))


def sas(folder: str, options: dict[str, Any], tell: ProgressCallback) -> None:
    """A simulator's sizing."""
    tell(0, None, "", "sizing, and checking with finite elements")
    given = {key: value for key, value in options.items() if value is not None}
    outcome = sizing_outcome(size_simulator(**given))
    _write(folder, page_answer(outcome, pictures=True))
