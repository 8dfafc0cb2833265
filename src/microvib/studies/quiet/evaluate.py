"""Figures of designs: every case from every start, on all cores, each computed once and kept."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from microvib.errors import MicrovibError, OutputError, ScenarioError
from microvib.io.tables import package_versions
from microvib.model.line_names import is_unlisted
from microvib.model.part import to_plain_data
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.line_fit import SEPARATION
from microvib.studies.quiet.measure import DriveLines, measure_lines
from microvib.studies.quiet.objective import LOWEST, Objective, drive_lines
from microvib.studies.quiet.starts import STARTS, Start
from microvib.studies.workers import Calls, parallel_calls

SEARCH_DURATION = 4.0
"""Longest record [s] of a run in a search; those that judge have the scenario's."""
KEPT = 3e-3
"""Part of the largest line from which lines are kept."""
UNEXPECTED = "largest other line"
"""Name of the largest line that no order of the drive explains, whose frequency is each case's own."""
MOST_SAMPLES = 4_000_000
"""Samples up to which a record is made denser for what an objective asks for."""
_ROOM = 1.001
FULL_STEPS = 8.0
"""Full steps that a record has at least."""


def searched_record(scenario: Scenario, objective: Objective) -> Scenario:
    """The scenario with a record that is as short as its full steps, and the lowest frequency that an
    objective asks for, allow.
    """
    rate = abs(scenario.rate or 0.0) * abs(scenario.reducer.h)
    step = scenario.driver.full_step(scenario.motor) / rate
    resolving = _ROOM * SEPARATION / max(objective.lowest(scenario), LOWEST)
    duration = max(SEARCH_DURATION, FULL_STEPS * step, resolving)
    if scenario.record.duration <= duration:
        return scenario
    return scenario.with_si({"record.duration": duration})


class LineFigure(NamedTuple):
    """A line of one drive from one start."""

    name: str
    frequency: float
    """[Hz]."""
    amplitude: float
    """[N m]; nan where the record does not tell it, or it is above the passband."""
    most: float = math.inf
    """Upper bound of an amplitude that is not told [N m]."""


class Figure(NamedTuple):
    """The objective's figure of one drive from one start, with its larger lines."""

    value: float
    """Infinite where the drive does not come to its rate, nan where its record does not tell."""
    lines: tuple[LineFigure, ...] = ()
    most: float = math.inf
    """Upper bound of the value: itself where it is known."""
    least: float = 0.0
    """Lower bound of the figure of a steady motion, by what is shown of it."""
    duration: float = math.nan
    """Length of record [s] from which the value is told; nan where no length is known to help."""


_KIND = "by what may be in a band"
"""Mark in the keys of figures that are kept: earlier ones had all that is unexplained in every band."""
HEAD = '["figures of microvib quiet"]\n'
"""First line of a file that keeps figures."""
NOTHING = Figure(math.inf, least=math.inf)
"""Figure of a drive that there is not, or that does not come to its rate."""


def figure_of(scenario: Scenario, start: str, objective: Objective) -> Figure:
    """The figure of one drive; its start goes to another process by name."""
    begun = next(x for x in STARTS if x.name == start).begun(scenario)
    found = measure_lines(begun, pointing=objective.sees_pointing)
    if found.problem:
        return NOTHING
    lines = (*_larger_lines(found), *_lines_above_passband(begun))
    value, least = objective.of(found), objective.least(found)
    if not shows(scenario, objective):
        return Figure(math.nan, lines, math.inf, least)
    if math.isnan(value):
        return Figure(value, lines, objective.most(found), least, objective.duration(found))
    return Figure(value, lines, value, least)


def shows(scenario: Scenario, objective: Objective) -> bool:
    """Whether the record of a drive shows all lines that an objective asks for."""
    return objective.highest(scenario) <= PASSBAND * scenario.record.sample_rate


def with_record_for(objective: Objective, scenario: Scenario) -> Scenario:
    """The drive with samples as dense as it takes to show the lines that an objective asks for, if
    these are not too many.
    """
    if shows(scenario, objective):
        return scenario
    rate = _ROOM * objective.highest(scenario) / PASSBAND
    if not rate * scenario.record.duration <= MOST_SAMPLES:
        return scenario
    return scenario.with_si({"record.sample_rate": rate})


def _lines_above_passband(scenario: Scenario) -> Iterator[LineFigure]:
    top = PASSBAND * scenario.record.sample_rate
    for line in drive_lines(scenario):
        if line.frequency > top:
            yield LineFigure(line.name, line.frequency, math.nan)


def _larger_lines(found: DriveLines) -> Iterator[LineFigure]:
    """Lines with a name, those among them that may be as large and are not told, and the largest of
    those that nothing expects.
    """
    least = KEPT * float(found.amplitude.max(initial=0.0))
    nameless: list[tuple[float, float]] = []
    for name, f, a in zip(
        found.names, found.frequency.tolist(), found.amplitude.tolist(), strict=True
    ):
        if a < least:
            continue
        if is_unlisted(name):
            nameless.append((a, f))
        else:
            yield LineFigure(name, f, a)
    for line in found.untold:
        if line.most > least:
            yield LineFigure(
                line.name, line.frequency, math.nan, line.most if line.is_made else math.inf
            )
    if nameless:
        amplitude, frequency = max(nameless)
        yield LineFigure(UNEXPECTED, frequency, amplitude)


@dataclass(frozen=True)
class Case:
    """One drive and one start to evaluate, or the reason why the drive is not allowed."""

    scenario: Scenario | None
    start: Start
    problem: str = ""


class Evaluations:
    """Figures of one objective, each computed once; those of a file are not computed again."""

    def __init__(self, objective: Objective, calls: Calls, file: Path | None) -> None:
        self.objective, self._calls, self._file = objective, calls, file
        self._known = _read(file)
        self._of = f"{package_versions()['microvib']} {_KIND} {objective!r}"
        self.runs = 0
        """Runs that were simulated."""

    def values(self, cases: Sequence[Case]) -> np.ndarray:
        """Upper bound of the figure of each case, (cases,); infinite where there is no motion at the
        rate, or nothing is known of it.
        """
        return np.array([one.most for one in self.figures(cases)])

    def figures(self, cases: Sequence[Case]) -> list[Figure]:
        """The figure of each case with its lines."""
        cases = [self._recorded(case) for case in cases]
        keys = [self._key(case) for case in cases]
        new = {
            key: case
            for key, case in zip(keys, cases, strict=True)
            if key not in self._known and case.scenario is not None
        }
        arguments = [(case.scenario, case.start.name, self.objective) for case in new.values()]
        found = self._calls(figure_of, arguments) if new else []
        self._keep(dict(zip(new, found, strict=True)))
        self.runs += len(found)
        return [self._known.get(key, NOTHING) for key in keys]

    def _recorded(self, case: Case) -> Case:
        if case.scenario is None:
            return case
        return replace(case, scenario=with_record_for(self.objective, case.scenario))

    def _key(self, case: Case) -> str:
        if case.scenario is None:
            return ""
        data = to_plain_data(case.scenario)
        for words in ("title", "source", "sources", "reference"):
            data.pop(words, None)
        text = f"{self._of} {case.start.name} {json.dumps(data, sort_keys=True, default=str)}"
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def _keep(self, found: dict[str, Figure]) -> None:
        self._known |= found
        if self._file is None or not found:
            return
        rows = ([key, *one] for key, one in found.items())
        lines = "".join(f"{json.dumps([*row, _check_of(row)])}\n" for row in rows)
        try:
            new = not self._file.exists() or not self._file.stat().st_size
            with self._file.open("a", encoding="utf-8") as file:
                file.write(f"{HEAD if new else ''}{lines}")
        except OSError as error:
            raise OutputError(f"{self._file}: cannot be written ({error.strerror})") from None


def _read(file: Path | None) -> dict[str, Figure]:
    """Figures of a file by their keys; a last line that was cut off is left out."""
    if file is None or not file.exists():
        return {}
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MicrovibError(f"{file}: cannot be read as figures of a search ({error})") from None
    if text and not text.startswith(HEAD):
        raise MicrovibError(f"{file}: was not written by a search (`keep`); give another name")
    known: dict[str, Figure] = {}
    *whole, cut_off = text.split("\n")
    if cut_off:  # by a power failure: what is kept next begins a line
        _rewrite(file, text.removesuffix(cut_off))
    for k, line in enumerate(whole[1:], 2):
        try:
            key, value, lines, *rest = json.loads(line)
            numbers = [x for x in rest if not isinstance(x, str)]
            check = [x for x in rest if isinstance(x, str)]
            kept = tuple(LineFigure(str(name), *map(float, own)) for name, *own in lines)
            known[str(key)] = Figure(float(value), kept, *map(float, numbers))
            if check and check != [_check_of([key, value, lines, *numbers])]:
                raise MicrovibError(
                    f"{file}, line {k}: was changed since the search wrote it; put it back, or delete"
                    " the line, and its figure is computed again"
                )
        except (ValueError, TypeError):
            raise MicrovibError(
                f"{file}, line {k}: cannot be read as a figure of a search; the file is damaged"
            ) from None
    return known


def _check_of(row: Sequence[Any]) -> str:
    """Digest of a line of a file of figures; older lines have none."""
    return hashlib.sha256(json.dumps(row).encode()).hexdigest()[:16]


def _rewrite(file: Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{file}: cannot be written ({error.strerror})") from None


@contextmanager
def evaluations(
    objective: Objective,
    file: Path | None = None,
    workers: int | None = None,
    on_run: Callable[[], None] = lambda: None,
) -> Iterator[Evaluations]:
    """Figures on all cores, or on threads without ``workers``; ``on_run`` is called after each run."""
    told = 0

    def progress(done: float, total: float) -> None:
        nonlocal told
        for _ in range(int(done) - told):
            on_run()
        told = int(done)

    with parallel_calls(progress, workers) as calls:
        yield Evaluations(objective, calls, file)


def drawn(
    base: Scenario,
    cases: Iterable[dict[str, Any]],
    starts: Sequence[Start],
    change: Callable[[Scenario], Scenario],
) -> list[Case]:
    """Every case from every start, cases first, after a ``change`` of each."""
    found = []
    for changes in cases:
        try:
            scenario: Scenario | None = change(base.with_si(changes) if changes else base)
            problem = ""
        except ScenarioError as error:
            scenario, problem = None, str(error)
        found += [Case(scenario, start, problem) for start in starts]
    return found
