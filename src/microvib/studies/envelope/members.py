"""Members of an envelope: what the names that a user gives stand for, one run or recording each.

A folder may hold many: those of a rate plan, a campaign, a sweep over angles or an orbit, or other
folders. Nothing is simulated again.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from microvib.analysis.limits import judge, judge_channel
from microvib.analysis.orders import lines_without_clock
from microvib.analysis.other_states import SECOND_WING
from microvib.analysis.run import RunResult, lines_of_second
from microvib.analysis.spectra import samples_of
from microvib.errors import ChannelError, MicrovibError
from microvib.io.line_sets import (
    ANGLES,
    ORBIT,
    RATES,
    LineSet,
    Unseen,
    read_rate_lines,
    read_swept_lines,
)
from microvib.io.recordings import Prepared
from microvib.io.runs import Run, read_run
from microvib.io.scenario_file import dump_scenario
from microvib.io.sources import RunFolder, Source, open_source
from microvib.model.line_names import of_second_wing
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.signals.line_table import Line, LineTable
from microvib.solve.channels import LOAD_COLUMNS
from microvib.studies.campaign import statistics
from microvib.studies.campaign.design import Design
from microvib.studies.campaign.folder import MANIFEST, STUDY, open_campaign
from microvib.studies.campaign.results import DONE, Results, open_results
from microvib.studies.envelope.evidence import (
    NO_SEARCH,
    Bound,
    Evidence,
    Judge,
    Judged,
    SeenLine,
    StatedLines,
    evidence_of_table,
    judged_of,
)
from microvib.studies.recording_limits import beside_scenario, lines_of_channel, misread_gaps
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, require_usable_channel

DRIVE_TORQUE = "T_d"
"""Channel of the disturbance torque about the drive axis, whatever a member calls it."""
MOTION, LINES = "motion.nc", "lines.csv"
Kind = Literal["run", "recording", "lines", "rate", "angle", "case"]
UnnamedMember = str | os.PathLike[str] | Recording | Prepared | Run | RunResult


@dataclass(frozen=True)
class NamedMember:
    """A file, folder, run or recording under the name that its owner gave it."""

    name: str
    given: UnnamedMember
    files: tuple[Path, ...] = ()
    """Files that tell it from others, where it is one that was read already: a copy counts once."""


GivenMember = UnnamedMember | NamedMember
_EXPECTED = (
    "the folder of a run, of a rate plan, of a campaign or of a sweep over angles, a folder of such"
    " folders, a recording or a table of lines is expected"
)
_NO_TORQUE = (
    "a sweep over angles keeps the loads on the spacecraft and not the torque about the drive axis;"
    " name a channel, Fx to Mz"
)
_ALL_UNKNOWN = Bound(0.0, math.inf, math.inf, NO_SEARCH)


def unit_of_channel(channel: str) -> str:
    """Unit that a load or the torque about the drive axis is in; empty for another channel."""
    if channel == DRIVE_TORQUE or channel in COMPONENTS:
        return "N" if channel.startswith("F") else "N*m"
    return ""


@dataclass(frozen=True)
class Samples:
    """Samples of a channel, (n,), and their rate [Hz]."""

    values: np.ndarray
    rate: float


@dataclass(frozen=True)
class Opened:
    """A member that was read: what it tells of a channel."""

    evidence: Callable[[str], Evidence]
    samples: Callable[[str], Samples | None]


@dataclass(frozen=True)
class Member:
    """One run, recording or case."""

    name: str
    """As a reader knows it: file or folder, and what the run was at."""
    kind: Kind
    values: str
    """Values that the run was at, such as its rate, angle or drawn ones; empty where not stated."""
    drawn: bool
    """Whether it may be one of several draws by chance, as units and campaigns' cases are and the
    rates of a plan are not."""
    key: tuple[str, str]
    """Its identity: the same run counts once."""
    open: Callable[[], Opened]
    """Reads it."""


@dataclass(frozen=True)
class Reading:
    """How members are read."""

    scenario: Scenario | None = None
    """Names the lines of recordings."""
    preparation: Preparation | None = None

    @classmethod
    def of(cls, scenario: GivenScenario | None, preparation: Preparation | None) -> Reading:
        """Reading with a scenario, which may be a name."""
        return cls(None if scenario is None else as_scenario(scenario), preparation)


def members_of(given: Sequence[GivenMember], reading: Reading) -> list[Member]:
    """All members that some names or objects stand for, in their order.

    Parameters
    ----------
    given : sequence of str, path, Recording, Prepared, Run, RunResult or NamedMember
        Files, folders, and what was read of them already.
    reading : Reading
        How they are read.

    Returns
    -------
    list of Member
        One for each run, recording and case.

    Raises
    ------
    MicrovibError
        Where a name stands for none, or a member is given twice.
    """
    found: list[Member] = []
    for k, each in enumerate(given, 1):
        found += _of_given(each, k, reading)
    seen: set[tuple[str, str]] = set()
    for member in found:
        if member.key in seen:
            raise MicrovibError(f"{member.name}: is given twice; a member counts once")
        seen.add(member.key)
    if not found:
        raise MicrovibError("no member was given; one or more are expected")
    return _named_once(found)


def _of_given(given: Any, number: int, reading: Reading) -> list[Member]:
    if isinstance(given, NamedMember):
        return _of_named(given, number, reading)
    if isinstance(given, (str, os.PathLike)):
        return _of_path(Path(os.fspath(given)), reading)
    return [_of_object(given, number, reading)]


def _of_named(named: NamedMember, number: int, reading: Reading) -> list[Member]:
    """Members under the name of their owner, which takes the place of the path."""
    given = named.given
    if not isinstance(given, (str, os.PathLike)):
        found = replace(_of_object(given, number, reading), name=named.name)
        return [replace(found, key=_content_key(*named.files)) if named.files else found]
    path = str(Path(given))
    try:
        members = _of_path(Path(path), reading)
    except MicrovibError as error:
        raise MicrovibError(str(error).replace(path, named.name)) from None
    return [replace(x, name=f"{named.name}{x.name.removeprefix(path)}") for x in members]


def _named_once(members: Sequence[Member]) -> list[Member]:
    """Members, of which those with one name get numbers."""
    count: dict[str, int] = {}
    found = []
    for member in members:
        count[member.name] = count.get(member.name, 0) + 1
        k = count[member.name]
        found.append(replace(member, name=f"{member.name} ({k})") if k > 1 else member)
    return found


def _of_object(given: Any, number: int, reading: Reading) -> Member:
    """A recording or a run that was read already."""
    key = ("object", str(id(given)))
    if isinstance(given, Recording):
        given = Prepared(given)
    if isinstance(given, Prepared):
        name = given.recording.title or f"recording {number}"
        source = given
        return Member(name, "recording", "", True, key, lambda: _opened_recording(source, reading))
    if isinstance(given, Run):
        given = RunResult.of_motion(given.motion, given.table, given.second_table)
    if not isinstance(given, RunResult):
        raise MicrovibError(f"member {number}: is a {type(given).__name__}; {_EXPECTED}")
    result = given
    name = result.scenario.title or f"run {number}"
    return Member(name, "run", "", True, key, lambda: _opened_run(result))


def _of_path(path: Path, reading: Reading) -> list[Member]:
    if path.is_dir():
        try:
            found = _of_folder(path, reading)
        except OSError as error:
            raise MicrovibError(f"{path}: cannot be read: {error.strerror or error}") from None
        if found is None:
            raise MicrovibError(f"{path}: holds nothing that is a member; {_EXPECTED}")
        return found
    return [_of_file(path, reading)]


def _of_folder(path: Path, reading: Reading, depth: int = 0) -> list[Member] | None:
    """Members of a folder; None where there is none in it."""
    there = {x.name for x in path.iterdir()}
    if there & {MANIFEST, STUDY}:
        return _of_campaign(path)
    if RATES in there:
        return [_rate(path, each) for each in read_rate_lines(path)]
    if there & {ORBIT, ANGLES}:
        return [_angle(path, each) for each in read_swept_lines(path, LOAD_COLUMNS)]
    if there & {MOTION, LINES}:
        return [_of_run_folder(path, reading)]
    if depth:
        return None
    return _below(path, reading)


def _below(path: Path, reading: Reading) -> list[Member] | None:
    """Members of the folders in a folder; None where there is none."""
    below = sorted(x for x in path.iterdir() if x.is_dir() and not x.name.startswith("."))
    found = [_of_folder(x, reading, 1) for x in below]
    return [member for each in found if each is not None for member in each] or None


def _key(path: Path, values: str = "") -> tuple[str, str]:
    return str(path.resolve()), values


def _content_key(*files: Path) -> tuple[str, str]:
    """Identity of a member by what its files hold, wherever they are: a copy is no further draw."""
    found = hashlib.sha256()
    for file in files:
        try:
            with file.open("rb") as stream:
                found.update(hashlib.file_digest(stream, "sha256").digest())
        except OSError:  # said where the member is read
            return _key(file)
    return "content", found.hexdigest()


def _run_files(path: Path) -> tuple[Path, ...]:
    """Files of a run's folder that tell it from other runs."""
    names = ("scenario.yaml", LINES) if (path / LINES).is_file() else (MOTION,)
    return tuple(path / name for name in names if (path / name).is_file())


def _case_keys(design: Design) -> list[tuple[str, str]]:
    """Identity of each case by its scenario: cases of another campaign may be the same draws. Those of
    one campaign that are alike are told apart.
    """
    whole = f"{dump_scenario(design.base)} {design.study.solve}"
    count: dict[str, int] = {}
    keys = []
    for case in range(design.cases):
        text = f"{whole} {sorted(design.changes(case).items())}"
        count[text] = count.get(text, 0) + 1
        keys.append(("case", hashlib.sha256(f"{text} {count[text]}".encode()).hexdigest()))
    return keys


def _of_run_folder(path: Path, reading: Reading) -> Member:
    def opened() -> Opened:
        if (path / MOTION).is_file() and (path / "summary.json").is_file():
            kept = read_run(path)
            return _opened_run(RunResult.of_motion(kept.motion, kept.table, kept.second_table))
        return _opened_source(open_source(str(path)), path, reading)

    key = _content_key(*_run_files(path))
    return Member(str(path), "run", "", True, key, opened)


def _of_file(path: Path, reading: Reading) -> Member:
    """A recording or a table of lines; what it is, is seen when it is read."""

    def opened() -> Opened:
        return _opened_source(open_source(str(path), reading.preparation), path, reading)

    if path.suffix.lower() in (".yaml", ".yml") or not path.exists():
        raise MicrovibError(f"{path}: is no run that was kept, nor a recording; {_EXPECTED}")
    return Member(str(path), "recording", "", True, _content_key(path), opened)


def _opened_source(source: Source, path: Path, reading: Reading) -> Opened:
    match source:
        case Prepared():
            return _opened_recording(source, reading)
        case LineTable():
            return _opened_lines(source)
        case RunFolder() if source.lines is not None:
            return _opened_lines(source.lines)
        case RunFolder() if source.motion is not None:
            return _opened_recording(Prepared(source.motion), reading)
        case _:
            raise MicrovibError(f"{path}: is no run that was kept, nor a recording; {_EXPECTED}")


def _of_torque_only(channel: str, evidence: Callable[[], Evidence]) -> Evidence:
    """The evidence of a member that knows the torque about the drive axis alone."""
    if channel != DRIVE_TORQUE:
        return Evidence.none(unit_of_channel(channel), f"{channel} is not kept there")
    return evidence()


def _no_samples(channel: str) -> Samples | None:
    return None


def _opened_lines(table: LineTable) -> Opened:
    """Lines alone, as a table has them."""

    def evidence() -> Evidence:
        known, unknown = [], []
        for line in table:
            place, size = line.place, line.amplitude
            if not math.isfinite(place):
                continue
            if math.isfinite(size) and line.status in ("ok", ""):
                known.append((line.name, place, size))
            else:
                unknown.append(Bound(place, place, math.inf, f"{line.name} ({line.status})"))
        return StatedLines("N*m", tuple(known), (_ALL_UNKNOWN, *unknown)).evidence()

    return Opened(lambda channel: _of_torque_only(channel, evidence), _no_samples)


def _opened_recording(prepared: Prepared, reading: Reading) -> Opened:
    recording, guide = prepared.recording, reading.scenario

    def name_of(channel: str) -> str:
        if channel != DRIVE_TORQUE:
            return channel
        return "Mz" if guide is None else f"M{guide.array.drive_axis}"

    def evidence(channel: str) -> Evidence:
        own, expected = name_of(channel), unit_of_channel(channel)
        try:
            if expected:
                table = lines_of_channel(prepared, own, guide)
            else:
                require_usable_channel(recording, own, 0.0, acceleration=True)
                table = lines_without_clock(recording, own)
        except MicrovibError as error:
            return Evidence.none(expected, " ".join(str(error).split()))
        table = replace(table, unit=recording.units.get(own, table.unit))
        if expected and table.unit != expected:
            return Evidence.none(expected, f"{own} is in {table.unit}, and {expected} is expected")
        component = own if channel in COMPONENTS else ""
        beside = cache(partial(beside_scenario, prepared, own, guide))

        def judged(curve: LimitCurve) -> Judged:
            if component:
                limit = Limit.of_curves(None, {component: curve})
            else:
                limit = Limit.of_curves(curve)
            found = judge_channel(table, limit, component)
            found = replace(found, gaps=(*found.gaps, *misread_gaps(beside(), curve)))
            return judged_of(found, [(table, None)], curve)

        return evidence_of_table(table, None, judged)

    def samples(channel: str) -> Samples | None:
        own, expected = name_of(channel), unit_of_channel(channel)
        if own not in recording.channels or (expected and recording.units.get(own) != expected):
            return None
        values, rate, _ = samples_of(recording, own)
        return Samples(values, rate)

    return Opened(evidence, samples)


def _opened_run(result: RunResult) -> Opened:
    def evidence(channel: str) -> Evidence:
        scenario = result.scenario
        if channel == DRIVE_TORQUE:
            return _torque_of_run(result)
        if channel not in COMPONENTS:
            return Evidence.none("", f"a run has no channel {channel}")
        unlimited = LimitCurve.flat(math.inf)
        tables = result.load_lines(Limit.of_curves(None, {channel: unlimited}))
        if not tables:
            if scenario.spacecraft is None and channel == f"M{scenario.array.drive_axis}":
                return _torque_of_run(result)
            why = f"no load {channel} is known of the run"
            return Evidence.none(unit_of_channel(channel), why)
        return _load_of_run(result, channel, tables)

    def samples(channel: str) -> Samples | None:
        if result.motion is None:
            return None
        try:
            own = "" if channel == DRIVE_TORQUE else channel
            values, rate, _ = samples_of(result.motion, own)
        except ChannelError:
            return None
        return Samples(values, rate)

    return Opened(evidence, samples)


def _torque_of_run(result: RunResult) -> Evidence:
    """The evidence of a run on the torque of its drive, and that of a second wing's."""
    table, scenario = result.table, result.scenario
    second = None
    if result.second is not None:
        second = result.second.table
    elif result.motion is not None:
        second = lines_of_second(result.motion, table)
    if second is not None and second.find_error is not None:
        second = replace(second, find_error=None, own_error=math.nan)
    tables: list[tuple[LineTable, Scenario | None]] = [(table, scenario)]
    if second is not None:
        tables.append((_of_second(second), scenario.driven_wing))

    def judged(curve: LimitCurve) -> Judged:
        found = judge(table, Limit.of_curves(curve), scenario, second)
        return judged_of(found, tables, curve)

    return _together(tables, judged)


def _of_second(table: LineTable) -> LineTable:
    lines = (replace(x, name=of_second_wing(x.name)) for x in table)
    return replace(table, lines=tuple(lines))


def _load_of_run(result: RunResult, channel: str, tables: Mapping[str, LineTable]) -> Evidence:
    """The evidence of a run on one load, at the interfaces of all wings."""
    own = {
        name: replace(x, own_error=result.table.own_error, find_error=None)
        for name, x in tables.items()
    }
    each: list[tuple[LineTable, Scenario | None]] = [
        (_of_second(x) if name.endswith(SECOND_WING) else x, result.scenario)
        for name, x in own.items()
    ]

    def judged(curve: LimitCurve) -> Judged:
        limit = Limit.of_curves(None, {channel: curve})
        found = judge(result.table, limit, result.scenario, None, own)
        return judged_of(found, each, curve)

    return replace(_together(each, judged), unit=unit_of_channel(channel))


def _together(tables: Sequence[tuple[LineTable, Scenario | None]], judged: Judge) -> Evidence:
    """The evidence of several tables of one record."""
    first, *others = [evidence_of_table(*each, judged) for each in tables]
    for other in others:
        first = replace(
            first,
            lines=(*first.lines, *other.lines),
            bounds=(*first.bounds, *other.bounds),
            low=max(first.low, other.low),
            high=min(first.high, other.high),
        )
    return first


def _rate(folder: Path, of: LineSet) -> Member:
    """A rate of a plan."""
    rate, microsteps = of.values["rate_deg_s"], of.values["microsteps"]
    values = f"{_brief(rate)} deg/s, {microsteps} microsteps"

    def evidence() -> Evidence:
        if of.status.startswith("failed"):
            return Evidence.none("N*m", f"the run {of.status}")
        lines, unknown = _known_lines(of, "amplitude_n_m")
        if of.not_seen is None:
            return StatedLines("N*m", lines, (_ALL_UNKNOWN, *unknown)).evidence()
        bounds = (*unknown, *_bounds_of(of.not_seen))
        undecided = next((x.what for x in of.not_seen if x.overstated > 1.0), "")
        return StatedLines("N*m", lines, bounds, undecided=undecided).evidence()

    opened = Opened(lambda channel: _of_torque_only(channel, evidence), _no_samples)
    name = f"{folder}, {values}"
    key = _key(folder, f"{rate} {microsteps}")
    return Member(name, "rate", values, False, key, lambda: opened)


def _known_lines(
    of: LineSet, column: str
) -> tuple[tuple[tuple[str, float, float], ...], tuple[Bound, ...]]:
    """Lines with an amplitude in a column of a table, and those without one, which may have any."""
    sizes = [(name, f, told[column]) for name, f, told in of.lines]
    known = tuple(x for x in sizes if math.isfinite(x[2]))
    unknown = (Bound(f, f, math.inf, name) for name, f, size in sizes if not math.isfinite(size))
    return known, tuple(unknown)


def _bounds_of(unseen: Iterable[Unseen]) -> tuple[Bound, ...]:
    return tuple(Bound(x.low, x.high, x.at_most, x.what) for x in unseen)


def _brief(number: str) -> str:
    """A figure of a file as a name has it."""
    try:
        return f"{float(number):.6g}"
    except ValueError:
        return number


def _angle(folder: Path, of: LineSet) -> Member:
    """An angle of a sweep or an instant of an orbit."""
    values = f"{_brief(of.values['angle_deg'])} deg"
    if "time_s" in of.values:
        values += f" after {_brief(of.values['time_s'])} s"

    def evidence(channel: str) -> Evidence:
        if channel not in COMPONENTS:
            return Evidence.none(unit_of_channel(channel), _NO_TORQUE)
        column = LOAD_COLUMNS[COMPONENTS.index(channel)]
        lines, unknown = _known_lines(of, column)
        bounds = (_ALL_UNKNOWN, *unknown)
        return StatedLines(unit_of_channel(channel), lines, bounds).evidence()

    name = f"{folder}, {values}"
    opened = Opened(evidence, _no_samples)
    key = _key(folder, " ".join(of.values.values()))
    return Member(name, "angle", values, False, key, lambda: opened)


def _of_campaign(folder: Path) -> list[Member]:
    """Every case of a campaign, computed or not."""
    campaign = open_campaign(folder)
    merged = open_results(campaign)
    cases = _Cases(_KeptResults(merged.campaign, merged.path))
    drawn = statistics.independent_cases(campaign.design)
    keys = _case_keys(campaign.design)
    one_level = len(statistics.levels_of(cases.results)) == 1

    def member(case: int) -> Member:
        told = campaign.design.labels(case)
        values = ", ".join(f"{key} {text}" for key, text in told.items())
        opened = Opened(
            lambda channel: _of_torque_only(channel, lambda: cases.evidence(case)), _no_samples
        )
        by_chance = bool(drawn[case]) and one_level and campaign.design.random
        name = f"{folder}, case {case}"
        return Member(name, "case", values, by_chance, keys[case], lambda: opened)

    return [member(case) for case in range(campaign.design.cases)]


@dataclass(frozen=True)
class _KeptResults(Results):
    """Merged results whose figures are read once, for an envelope asks for them in every band that it judges."""

    @cached_property
    def _figures(self) -> dict[tuple[str, str], np.ndarray]:
        return {}

    @cached_property
    def _each_status(self) -> dict[str, np.ndarray]:
        return {}

    def of(self, line: str, figure: str = "amplitude") -> np.ndarray:
        """One figure of one line over all cases, (cases,); nan where a case has no such line."""
        if (line, figure) not in self._figures:
            self._figures[line, figure] = super().of(line, figure)
        return self._figures[line, figure]

    def status(self, line: str) -> np.ndarray:
        """Status of one line in each case, texts (cases,); empty where a case has no such line."""
        if line not in self._each_status:
            self._each_status[line] = super().status(line)
        return self._each_status[line]

    @cached_property
    def verdicts(self) -> np.ndarray:
        """Verdict on each case against the study's limit, an index in VERDICTS, (cases,)."""
        return super().verdicts


@dataclass(frozen=True)
class _Cases:
    """Lines of a campaign's cases, read line by line and kept."""

    results: Results

    @cached_property
    def _lines(self) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Name, amplitude, frequency, bin's amplitude and status of every line, (cases,) each."""
        r = self.results
        return [
            (x, r.of(x), r.of(x, "frequency"), r.of(x, "bin_amplitude"), r.status(x))
            for x in r.lines
        ]

    @cached_property
    def _reasons(self) -> list[str]:
        return self.results.reasons

    @cached_property
    def _gaps(self) -> list[str]:
        return self.results.gaps

    def evidence(self, case: int) -> Evidence:
        """Evidence of a case on the torque about the drive axis."""
        if self.results.state[case] != DONE:
            why = self._reasons[case] or "the case is not computed"
            return Evidence.none("N*m", why)
        lines, unknown = [], []
        for name, amplitude, frequency, _, status in self._lines:
            size, f, state = float(amplitude[case]), float(frequency[case]), str(status[case])
            if not math.isfinite(f) or not state:
                continue
            if Line(name, status=state).seen and math.isfinite(size):
                lines.append((name, f, size))
            else:
                unknown.append(Bound(f, f, math.inf, f"{name} ({state})"))
        stated = StatedLines("N*m", tuple(lines), (_ALL_UNKNOWN, *unknown))

        def judged(curve: LimitCurve) -> Judged:
            return self._judged(case, stated, curve)

        return replace(stated.evidence(), judge=judged)

    def _judged(self, case: int, stated: StatedLines, curve: LimitCurve) -> Judged:
        """The verdict of a case as a campaign's report gives it."""
        verdict = int(self._verdicts(curve)[case])
        lines: tuple[SeenLine, ...] = stated.judged_lines(curve)
        if verdict == statistics.ABOVE:
            return Judged("fail", "", lines, False)
        if verdict == statistics.BELOW:
            kept = tuple(replace(x, verdict="pass") for x in lines)
            return Judged("pass", "", kept, True)
        why = self._gaps[case] or "the campaign was judged by another limit, or by none"
        return Judged("not judged", why, lines, False)

    def _verdicts(self, curve: LimitCurve) -> np.ndarray:
        if curve not in self._kept:
            self._kept[curve] = statistics.case_verdicts(
                self.results, curve, (curve.low, curve.high)
            )
        return self._kept[curve]

    @cached_property
    def _kept(self) -> dict[LimitCurve, np.ndarray]:
        return {}
