"""A few cases of a campaign, computed: what goes to a worker and what comes back."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from microvib.analysis.accuracy import failed_invariants_reason
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.limits import Judgement, judge, record_gap_of_table
from microvib.analysis.lines import find_lines, steady_lines
from microvib.errors import MicrovibError, error_context
from microvib.io.tables import package_versions
from microvib.model.scenario import Scenario
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import Line, LineTable
from microvib.solve.batch import Torque, simulate_torques
from microvib.solve.integration import SECOND_WING, simulate_from_rest
from microvib.solve.on_craft import LINE_OF_SIGHT_ACCELERATIONS
from microvib.solve.steady.state import find_steady
from microvib.studies.campaign.design import limit_of
from microvib.studies.campaign.study_file import Study

BATCH_SIZE = 32
"""Cases that are simulated together; bounds the memory of a worker."""
FIGURES = ("amplitude", "frequency", "bin_amplitude", "phase", "decay")
"""Stored figures of every line."""
LINE_OF_SIGHT = ("los_x", "los_y")
"""Stored figures of a spacecraft with a line of sight."""
BASE_TIME_LIMIT = 60.0
"""Time [s] that any case may take, in addition to what it simulates."""
STARTUP_ALLOWANCE = 120.0
"""Time [s] on top for the cases that are computed together, the first of which may have to wait for
a compiler (docs/design.md).
"""
VERDICTS = ("not judged", "pass", "fail")
"""Verdicts of cases, by their numbers."""
RECORDS = (
    "shows tracking",
    "does not show all lines of it",
    "begins before the array turns",
    "holds a part of a slow cycle",
)
"""Kinds of a case's record, by their numbers."""
LEAVES_OPEN, HELD_RECORD, PART_OF_CYCLE = 1, 2, 3
SCALARS = ("peak", "rms", "stuck_output")
"""Stored figures of every case: largest and RMS torque of the record [N m], part of the time that the
shaft sticks.
"""


class Label(NamedTuple):
    """Identity of a chunk, so that it cannot be taken for another."""

    campaign: str
    """Identity of its campaign."""
    chunk: int
    manifest: str
    """The campaign's manifest, from which a lost one is made again."""


class WorkPackage(NamedTuple):
    """Cases to compute, complete in itself: it needs no file."""

    study: Study
    base: Scenario
    changes: tuple[dict[str, Any], ...]
    label: Label
    crashing: tuple[int, ...] = ()
    """Positions of cases that ended the worker when they were tried alone; they are not tried
    again.
    """

    @property
    def steady(self) -> bool:
        """Whether cases are solved for their steady states."""
        return self.study.solve == "steady" or self.base.record.start == "steady"


@dataclass(frozen=True)
class Chunk:
    """Results of consecutive cases; a case that failed has its reason, and no figures."""

    label: Label
    lines: tuple[str, ...]
    figures: dict[str, np.ndarray]
    """Figures of every line, (cases, lines) each; nan where a case has no such line. With LINE_OF_SIGHT
    where a craft has one.
    """
    status: np.ndarray
    """Index of the line's status in ``statuses``, (cases, lines)."""
    statuses: tuple[str, ...]
    scalars: dict[str, np.ndarray]
    """Figures of every case, (cases,) each."""
    verdict: np.ndarray
    """Index in ``VERDICTS`` of what a run of the case would be judged, (cases,)."""
    record: np.ndarray
    """Index in ``RECORDS`` of what its record is, (cases,)."""
    gaps: tuple[str, ...]
    """Gaps in the judgement and their remedies; empty where nothing was left out."""
    reasons: tuple[str, ...]
    """Why a case failed; empty where it did not."""
    notes: tuple[str, ...]
    """Notes on a case, such as that it has no steady state."""
    histories: dict[int, np.ndarray]
    """T_d [N m] by position in the chunk, where it is kept."""

    def to_bytes(self) -> bytes:
        """Serialise the chunk; equal chunks give equal bytes."""
        texts = {
            key: list(getattr(self, key))
            for key in ("label", "lines", "statuses", "gaps", "reasons", "notes")
        }
        arrays = {f"figure_{name}": values for name, values in self.figures.items()}
        arrays |= {f"scalar_{name}": values for name, values in self.scalars.items()}
        arrays |= {f"history_{k}": values for k, values in self.histories.items()}
        kept = {key: getattr(self, key) for key in ("status", "verdict", "record")}
        stream = io.BytesIO()
        text = np.frombuffer(json.dumps(texts).encode(), dtype=np.uint8)
        content = {"texts": text, **kept, **arrays}
        digest = np.array(_digest(content))
        np.savez(stream, sha256=digest, **content)
        return stream.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> Chunk:
        """Raises whatever the reader of the archive does where the data are not whole."""
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            named = dict(file)
        stated = named.pop("sha256", None)  # none of a chunk that an older version wrote
        if stated is not None and str(stated) != _digest(named):
            raise ValueError("its figures were changed since it was computed")
        texts = {
            key: tuple(values) for key, values in json.loads(named.pop("texts").tobytes()).items()
        }
        return cls(
            label=Label(*texts.pop("label")),
            figures={
                name[7:]: values for name, values in named.items() if name.startswith("figure_")
            },
            status=named["status"],
            scalars={name: named[f"scalar_{name}"] for name in SCALARS},
            verdict=named["verdict"],
            record=named["record"],
            histories={
                int(name[8:]): values
                for name, values in named.items()
                if name.startswith("history_")
            },
            **texts,
        )


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    """SHA-256 of arrays by their names."""
    found = hashlib.sha256()
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {values.dtype.str} {values.shape}\n".encode())
        found.update(values.tobytes())
    return found.hexdigest()


@dataclass(frozen=True)
class _Result:
    """One case."""

    table: LineTable | None = None
    scalars: tuple[float, ...] = (math.nan,) * len(SCALARS)
    verdict: int = 0
    record: int = 0
    gaps: str = ""
    reason: str = ""
    note: str = ""
    T_d: np.ndarray | None = None
    los: dict[str, np.ndarray] | None = None
    """Amplitudes of both angles of the line of sight [rad] and frequency [Hz], (3,), by line."""

    @property
    def lines(self) -> tuple[Line, ...]:
        """Its lines; none of a case that failed."""
        return () if self.table is None else tuple(self.table)


WORKER_DIED = _Result(
    reason="its worker died each time it was computed (memory exhausted, killed, crashed, or slower than time_limit)"
)


def compute(work: WorkPackage, begin: Callable[[float], None] = lambda seconds: None) -> Chunk:
    """Compute cases. A case that cannot be computed has its reason and does not stop the others.

    The figures of a case do not depend on what it is computed with. ``begin`` is told, before some
    cases are computed together, what time [s] they may take. MicrovibError where another version
    made the campaign.
    """
    made_by, here = (
        json.loads(work.label.manifest)["versions"]["microvib"],
        package_versions()["microvib"],
    )
    if made_by != here:
        raise MicrovibError(
            f"this is microvib {here}, but the campaign was made by {made_by}; one version must"
            " compute all of it"
        )
    cases, together = range(len(work.changes)), 1 if work.steady else BATCH_SIZE
    parts = [_run_batch(work, cases[k : k + together], begin) for k in cases[::together]]
    return gather([result for part in parts for result in part], work.label)


def compute_bytes(work: WorkPackage) -> bytes:
    """The chunk of ``compute`` as bytes, which pass between processes and machines and into a file.

    The process ends where cases take longer than they may: compiled code cannot be interrupted from
    within.
    """
    watch = _Watch()
    try:
        return compute(work, watch.begin).to_bytes()
    finally:
        watch.stop()


class _Watch:
    """Ends the process unless it is told in time that the next cases have begun, or that all are
    through.
    """

    def __init__(self) -> None:
        self._timer: threading.Timer | None = None

    def begin(self, seconds: float) -> None:
        self.stop()
        self._timer = threading.Timer(STARTUP_ALLOWANCE + seconds, _kill_process)
        self._timer.daemon = True
        self._timer.start()

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


def _kill_process() -> None:
    os._exit(1)


def _run_batch(
    work: WorkPackage, positions: Sequence[int], begin: Callable[[float], None]
) -> list[_Result]:
    """Cases that run together, one after the other, or one that is solved alone."""
    results = {k: WORKER_DIED for k in positions if k in work.crashing}
    scenarios: dict[int, Scenario] = {}
    for k in (k for k in positions if k not in results):
        try:
            scenarios[k] = work.base.with_si(work.changes[k])
        except MicrovibError as error:
            results[k] = _failed(error)
    own = [BASE_TIME_LIMIT + s.record.settle + s.record.duration for s in scenarios.values()]
    begin(sum(own) if work.study.time_limit is None else len(own) * work.study.time_limit)
    alone = work.steady or _has_line_of_sight(work.base)
    torques = [None] * len(scenarios) if alone else _torques(list(scenarios.values()))
    for (k, scenario), torque in zip(scenarios.items(), torques, strict=True):
        results[k] = _solved(work, scenario, torque)
    return [results[k] for k in positions]


def _torques(scenarios: list[Scenario]) -> list[Torque | Exception]:
    """Torques of cases together or, where they fail together, one by one: one case may want more
    memory than there is.
    """
    try:
        return list(simulate_torques(scenarios, balanced=True))
    except Exception as error:
        if len(scenarios) == 1:
            return [error]
        return [torque for scenario in scenarios for torque in _torques([scenario])]


def _failed(error: MicrovibError) -> _Result:
    return _Result(reason=" ".join(str(error).splitlines()))


def _solved(work: WorkPackage, scenario: Scenario, torque: Torque | Exception | None) -> _Result:
    """A case with its torque, or what came of it; without one its steady state is searched."""
    try:
        if isinstance(torque, Exception):
            raise torque
        if torque is not None:
            return _of_torque(work, scenario, torque)
        if _has_line_of_sight(scenario):
            return _with_line_of_sight(work, scenario)
        return _of_steady_state(work, scenario)
    except MicrovibError as error:
        return _failed(error)
    except MemoryError:
        return _Result(
            reason="out of memory: record.duration is too long, or record.sample_rate too high"
        )
    except Exception as error:  # one bad case of a million must not stop the others, whatever it is
        return _Result(reason=f"unexpected {type(error).__name__}: {error}")


def _of_torque(work: WorkPackage, scenario: Scenario, torque: Torque) -> _Result:
    table = find_lines(torque, harmonics=work.study.harmonics)
    second = _second_wing_lines(work, scenario)
    return _result(work.study, scenario, _Motion(table, torque.T_d, torque.stuck_output, second))


def _of_steady_state(work: WorkPackage, scenario: Scenario) -> _Result:
    # A case is one of many: their lines need no spread of their own.
    found = steady_lines(scenario.with_sources({}), harmonics=work.study.harmonics)
    stuck = math.nan if found.state is None else found.state.stuck_output
    second = _second_wing_lines(work, scenario)
    motion = _Motion(found.lines, found.source["T_d"], stuck, second, found.fallback)
    return _result(work.study, scenario, motion)


def _has_line_of_sight(scenario: Scenario) -> bool:
    """Whether it has a line of sight."""
    return scenario.spacecraft is not None and scenario.spacecraft.line_of_sight is not None


def _second_wing_lines(work: WorkPackage, scenario: Scenario) -> LineTable | None:
    """Lines of the second wing's drive, by its torque alone, where it is driven and a limit judges
    them.
    """
    other = scenario.driven_wing
    if other is None or limit_of(work.study) is None:
        return None
    with error_context(SECOND_WING):
        if work.steady:
            return steady_lines(other, harmonics=work.study.harmonics).lines
        (torque,) = _torques([other])
        if isinstance(torque, Exception):
            raise torque
        return find_lines(torque, harmonics=work.study.harmonics)


def _with_line_of_sight(work: WorkPackage, scenario: Scenario) -> _Result:
    """A case of a craft, with the lines of its line of sight."""
    harmonics = work.study.harmonics
    state, fallback = find_steady(scenario) if work.steady else (None, "")
    kept = ("T_d", "stuck_output", "alpha_l", "alpha_m", *LINE_OF_SIGHT_ACCELERATIONS)
    source = state or simulate_from_rest(scenario, channels=kept, balanced=False)
    table = find_lines(source, harmonics=harmonics)
    if state is None:
        stuck = float(np.mean(source["stuck_output"]))
    else:
        stuck = state.stuck_output
    on_hub = hub_lines(source, table, los_only=True)
    los = dict(
        zip(on_hub.names, np.column_stack([on_hub.amplitude, on_hub.frequency]), strict=True)
    )
    second = (
        None if source.second_wing is None else find_lines(source.second_wing, harmonics=harmonics)
    )
    motion = _Motion(table, source["T_d"], stuck, second, fallback)
    return replace(_result(work.study, scenario, motion), los=los)


@dataclass(frozen=True)
class _Motion:
    """The motion of a case that was solved."""

    table: LineTable
    T_d: np.ndarray
    """[N m]"""
    stuck_output: float
    second: LineTable | None
    """Lines of a second wing's drive."""
    note: str = ""


def _result(study: Study, scenario: Scenario, motion: _Motion) -> _Result:
    """A case whose motion is known, judged as its run would be.

    One whose motion is not sound has failed: it counts as a case of which nothing is known.
    """
    table, second, T_d = motion.table, motion.second, motion.T_d
    broken = (*table.broken, *(() if second is None else second.broken))
    if why := failed_invariants_reason(broken, scenario):
        return _Result(reason=why)
    verdict, gaps, limit = 0, "", limit_of(study)
    if limit is not None:
        judgement = _judged(table, limit, scenario, second)
        verdict, gaps = VERDICTS.index(judgement.verdict), judgement.not_judged(1).strip()
    return _Result(
        replace(table, find_error=None),  # with it goes the motion, which no process needs
        (float(np.abs(T_d).max()), float(T_d.std()), motion.stuck_output),
        verdict,
        _record_number(table, scenario),
        gaps,
        note=motion.note,
        T_d=T_d if "T_d" in study.keep else None,
    )


def _record_number(table: LineTable, scenario: Scenario) -> int:
    """Index in ``RECORDS`` of what the record of a case is."""
    gap = record_gap_of_table(table, scenario)
    if gap is None:
        return 0
    if not gap.turns:
        return HELD_RECORD
    return PART_OF_CYCLE if gap.overstated > 1.0 else LEAVES_OPEN


_MAX_SEEN_ERROR = 0.25
"""Part of an amplitude by which no integration was seen to be off (``analysis.accuracy``)."""


def _judged(
    table: LineTable, limit: Limit, scenario: Scenario, second: LineTable | None
) -> Judgement:
    """A case against the limit; it is run again with finer steps only where their error may decide
    the verdict.
    """

    def off_by(error: float) -> Judgement:
        known = replace(table, own_error=error, find_error=None)
        other = second and replace(second, own_error=error, find_error=None)
        return judge(known, limit, scenario, other)

    exact = off_by(0.0)
    if exact.verdict == off_by(_MAX_SEEN_ERROR).verdict:
        return exact
    return judge(table, limit, scenario, second)


def gather(results: Sequence[_Result], label: Label) -> Chunk:
    """Results of single cases as one chunk; unexpected lines by their rank in the case (``other_1``
    is the largest).
    """
    names = _line_names(results)
    figures = _line_figures(results, names) | _line_of_sight_figures(results, names)
    _fill_second_wing_frequencies(figures["frequency"], results, names)
    statuses, status = _statuses(results, names)
    return Chunk(
        label=label,
        lines=tuple(names),
        figures=figures,
        status=status,
        statuses=statuses,
        scalars={name: np.array([r.scalars[k] for r in results]) for k, name in enumerate(SCALARS)},
        verdict=np.array([r.verdict for r in results], dtype=np.int8),
        record=np.array([r.record for r in results], dtype=np.int8),
        gaps=tuple(r.gaps for r in results),
        reasons=tuple(r.reason for r in results),
        notes=tuple(r.note for r in results),
        histories={k: r.T_d for k, r in enumerate(results) if r.T_d is not None},
    )


def _line_names(results: Sequence[_Result]) -> dict[str, int]:
    """Columns of the lines of all cases, those of the line of sight alone behind the others: a
    second wing's drive has lines of its own.
    """
    names: dict[str, None] = {}
    for result in results:
        names |= dict.fromkeys(line.name for line in result.lines)
    for result in results:
        names |= dict.fromkeys(result.los or ())
    return {name: k for k, name in enumerate(names)}


def _line_figures(results: Sequence[_Result], column: dict[str, int]) -> dict[str, np.ndarray]:
    """FIGURES of every line, (cases, lines) each; nan where a case has no such line."""
    figures = {name: np.full((len(results), len(column)), math.nan) for name in FIGURES}
    for name, values in figures.items():
        for i, result in enumerate(results):
            here = [column[line.name] for line in result.lines]
            values[i, here] = [getattr(line, name) for line in result.lines]
    return figures


def _line_of_sight_figures(
    results: Sequence[_Result], column: dict[str, int]
) -> dict[str, np.ndarray]:
    """LINE_OF_SIGHT of every line, (cases, lines) each; nothing where no case has one."""
    if all(result.los is None for result in results):
        return {}
    figures = {name: np.full((len(results), len(column)), math.nan) for name in LINE_OF_SIGHT}
    for k, values in enumerate(figures.values()):
        for i, result in enumerate(results):
            for line, amplitudes in (result.los or {}).items():
                values[i, column[line]] = amplitudes[k]
    return figures


def _statuses(
    results: Sequence[_Result], column: dict[str, int]
) -> tuple[tuple[str, ...], np.ndarray]:
    """Statuses of lines, and the number of each line's status, (cases, lines); -1 where a case has no
    such line.
    """
    said = [[_status_without_values(line.status) for line in result.lines] for result in results]
    statuses = tuple(sorted({text for each in said for text in each}))
    number = {text: k for k, text in enumerate(statuses)}
    status = np.full((len(results), len(column)), -1, dtype=np.int16)
    for i, result in enumerate(results):
        here = [column[line.name] for line in result.lines]
        status[i, here] = [number[text] for text in said[i]]
    return statuses, status


def _fill_second_wing_frequencies(
    frequency: np.ndarray, results: Sequence[_Result], column: dict[str, int]
) -> None:
    """Fill in frequencies (cases, lines) [Hz] of lines of the line of sight that are no lines of
    the first drive's torque.
    """
    for i, result in enumerate(results):
        for line, (_, _, f) in (result.los or {}).items():
            if math.isnan(frequency[i, column[line]]):
                frequency[i, column[line]] = f


def _status_without_values(status: str) -> str:
    """A status without the figures of its case, so that a million cases share a few."""
    return status.partition(":")[0].partition(";")[0]
