"""A pointing budget: what moves the line of sight of a craft, summed and judged."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from microvib.analysis.hub_lines import combine_wings
from microvib.analysis.margins import Verdict, frequency_error_bound, worst_verdict
from microvib.analysis.pointing import FREQUENCY_TOLERANCE, HubLines
from microvib.analysis.run import RunResult, run_scenario
from microvib.analysis.short_way import (
    Difference,
    blocked_load_solution,
    method_differences,
)
from microvib.analysis.start import both_drives_reason, steady_state_fallback_note
from microvib.analysis.sticking import sticking_of
from microvib.errors import MicrovibError, ObjectError, OptionError, expect_list, quoted_value
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.model.coupling import require_craft, source_of
from microvib.model.drive_states import MAY_STICK, SLIDES, Sticking
from microvib.model.hub_edge import hub_edge
from microvib.model.line_names import SECOND_DRIVE, is_unlisted
from microvib.model.parametric import modes_fed_together
from microvib.model.scenario import GivenScenario, Scenario, as_scenario, stands_for_scenario
from microvib.signals.pointing import METRICS, Metric
from microvib.solve.integration import Progress
from microvib.studies.budget.arrays import (
    MAX_ARRAYS,
    check_places,
    lacking,
    number_of_arrays,
    too_many_arrays,
)
from microvib.studies.budget.cases import (
    drawn_cases,
    with_craft_of_cases,
    with_density_of_cases,
    with_nominal_craft,
)
from microvib.studies.budget.figures import CombinedLines, evaluate_errors, evaluate_metric
from microvib.studies.budget.files import (
    OtherSource,
    Requirement,
    Requirements,
    Sources,
    group_errors,
    read_file,
)
from microvib.studies.budget.load_check import (
    ComparedLoads,
    compare_loads,
    with_filter_check,
    with_load_check,
    with_phase_check,
)
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.recording_source import contribution_of_recording
from microvib.studies.budget.side_lines import TurningDrives
from microvib.studies.budget.sources import (
    Contribution,
    Unobserved,
    both_errors,
    contribution_of_run,
    open_gap,
    unseen_axes,
    with_held_drive,
    with_side_density,
    with_side_lines_of_other,
    with_side_lines_of_recording,
)
from microvib.studies.budget.sums import Assessment, Rule, assess, combine_lines, worst_alternative
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import DONE, Results, open_results
from microvib.studies.campaign.statistics import independent_cases
from microvib.testdata.recording import Recording

RULES: tuple[Rule, ...] = ("rss", "coherent", "bound")
_COMPARED_GROUPS = ("motor", "driver", "reducer", "friction", "array", "tracking", "spacecraft")
"""Groups of a scenario in which a campaign must agree with it."""
FAINT_LINE = 1e-3
"""Part of the largest line from which a line must be in all cases of a campaign."""


@dataclass(frozen=True)
class Window:
    """One metric in one window: rms of all sources [rad] about both axes and radial; lines,
    densities, errors, and all together.
    """

    metric: Metric
    window: float
    lines: tuple[float, float, float]
    noise: tuple[float, float, float]
    errors: tuple[float, float, float]
    """Errors of sources by their class, over time and units."""
    both: tuple[float, float, float]


@dataclass(frozen=True)
class Budget:
    """Sources, what they add up to, and the verdict on each requirement."""

    scenario: Scenario
    """The first drive's, with the craft."""
    requirements: Requirements | None
    rule: Rule
    contributions: tuple[Contribution, ...]
    tones: CombinedLines
    judged: tuple[Assessment, ...]
    windows: tuple[Window, ...]
    short_way: tuple[Difference, ...] = ()
    """The blocked-load method against the coupled run of the first drive, line by line, where that was asked
    for.
    """
    angles: tuple[float, ...] = ()
    """Angles of the first drive's array [rad] that were judged, of which each requirement has the
    worst of each figure; empty for one angle.
    """
    orbit: bool = False
    """Whether these stand for all angles between them, too."""
    notes: tuple[str, ...] = ()
    """Notes on an orbit, in sentences."""
    without_steady: tuple[str, ...] = ()
    """Sentences on drives that have no steady state to start in: why, and what was done instead.
    """

    def __repr__(self) -> str:
        rows = [
            f"Pointing budget of {self.scenario.brief}: {self.verdict}",
            f"sources: {', '.join(one.source for one in self.contributions)}",
            self.holds_at,
            *(f"{one!r}" for one in self.judged),
        ]
        return "\n  ".join(rows)

    @property
    def holds_at(self) -> str:
        """For which angles of the array this holds, in words."""
        if not self.angles:
            return f"at an array angle of {_degrees(require_craft(self.scenario).spacecraft.array_angle)} deg only"
        first, last = _degrees(self.angles[0]), _degrees(self.angles[-1])
        if self.orbit:
            return f"the worst over an orbit, judged at {len(self.angles)} array angles from {first} to {last} deg"
        return f"the worst of {len(self.angles)} array angles from {first} to {last} deg, and at these only"

    def angle_of(self, one: Assessment) -> float:
        """Angle of the array [deg] with a requirement's verdict."""
        return self._given_or_own(one.angle)

    def angle_of_value(self, one: Assessment) -> float:
        """Angle of the array [deg] with a requirement's value."""
        return self._given_or_own(one.value_angle)

    def _given_or_own(self, angle: float | None) -> float:
        """An angle of the array [rad], or without one that of the scenario, in degrees."""
        if angle is None:
            angle = require_craft(self.scenario).spacecraft.array_angle
        return math.degrees(angle)

    @property
    def verdict(self) -> Verdict:
        """On all requirements together; without one nothing is judged."""
        return worst_verdict(one.verdict for one in self.judged) or "not judged"


def pointing_budget(  # noqa: PLR0913 - keyword options
    scenarios: GivenScenario | Sequence[GivenScenario],
    requirements: Requirements | str | Path | None = None,
    *,
    sources: str | Path | Sequence[OtherSource] | None = (),
    campaign: str | Path | None = None,
    recording: Recording | None = None,
    rule: Rule = "rss",
    one_clock: bool = False,
    short_way: bool = False,
    steady: bool = False,
    harmonics: int = 8,
    names: Sequence[str] = (),
    files: FileAccess = WORKING_FOLDER,
    progress: Progress | None = None,
) -> Budget:
    """Budget the line of sight of one craft: what its drives and other sources add up to, against
    requirements.

    A second wing that is driven is a drive of its own, ``NAME wing_2``, and keeps its phases where
    both have one clock. Of several scenarios each has the other's wing as its ``second_wing``, or
    nothing is judged: arrays change how the hub moves.

    Parameters
    ----------
    scenarios : Scenario, str, path or a sequence of them
        The drives of the craft, each with the craft as its own array sees it.
    requirements : Requirements, str or path, optional
        What is required, or its file. Without it nothing is judged.
    sources : str, path or sequence of OtherSource, optional
        What moves the line of sight besides: a file of sources, or a list.
    campaign : str or path, optional
        Folder of a merged campaign of the first scenario, for medians and percentiles, in which
        both wings count as one source.
    recording : Recording, optional
        Loads of the first drive on a force table, which then takes the blocked-load way.
    rule : {"rss", "coherent", "bound"}
        How lines of one frequency in several sources add (``studies.budget.sums``).
    one_clock : bool
        The drives step together and keep their phases.
    short_way : bool
        Compare the blocked-load method with the first drive's coupled run.
    steady : bool
        Start runs in the steady state.
    harmonics : int
        Members of each family of lines that are looked for.
    names : sequence of str, optional
        Names of the drives.
    files : FileAccess
        Permission to open the files above, and the tables that ``sources`` name.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    Budget
        The verdict on each requirement, the largest contributors, and what all sources add up to in
        each window [rad].

    Raises
    ------
    MicrovibError
        Where a scenario has no craft or no line of sight, crafts differ, or a file cannot be read.
    SimulationError
        What ``simulate`` raises.
    """
    if rule not in RULES:
        raise OptionError("sum", f"is not allowed; write one of {', '.join(RULES)}", str(rule))
    whole, drives = _drives(scenarios, names, steady)
    first, two = drives[0], _has_second_wing(drives)
    required = read_requirements(requirements, files)
    # What can be refused is looked at before anything is simulated.
    _other_contributions(sources, whole, (SLIDES, SLIDES), files)
    if two and campaign is not None and recording is not None:
        raise OptionError(
            "campaign",
            "covers both wings together, and a recording one of them; leave one out",
        )
    ensemble = None
    if campaign is not None:
        ensemble = ensemble_of(whole, files.under("campaign").path(os.fspath(campaign)))
    for drive in drives:
        source_of(drive.scenario)
    measured = None
    if recording is not None:
        measured = contribution_of_recording(first.name, first.scenario, recording, harmonics)
        # of the settled drive; the run beside it tells what the blocked-load method misses
        drives[0] = first._replace(scenario=first.scenario.with_({"record.start": "steady"}))

    runs = _runs(drives, harmonics, progress)
    sticking = _sticking(runs, drives, ensemble)
    beside = _other_contributions(sources, whole, sticking, files)
    compared: tuple[Difference, ...] = ()
    loads: ComparedLoads | None = None
    if short_way or measured is not None:
        blocked, by_blocked_loads = blocked_load_solution(
            drives[0].scenario, harmonics=harmonics, progress=progress
        )
        compared = tuple(method_differences(blocked, by_blocked_loads, runs[0].lines))
    found = [
        _with_clock(run.contribution, drive, first, one_clock)
        for run, drive in zip(runs, drives, strict=True)
    ]
    if measured is not None:
        loads = compare_loads(measured, blocked)
        checked = with_filter_check(measured, blocked)
        of_recording = with_phase_check(with_method_error(checked, compared), loads)
        found[0] = with_load_check(of_recording, loads)
        found[0] = with_side_lines_of_recording(found[0], whole)
    if ensemble is not None:
        if two:
            found[:2] = [both_wings(whole, found[0], found[1], runs[0].lines, runs[1].lines)]
        found[0] = with_density_of_cases(with_campaign(found[0], ensemble), ensemble)
        found[1:] = [with_nominal_craft(one, ensemble) for one in found[1:]]
        beside = with_craft_of_cases(beside, *read_sources(sources, files), ensemble, sticking)
        if measured is not None:
            found[0] = _with_cases_of_another(found[0])
    of_craft = (*_unobserved_axes(first.scenario), *_fed_by_two_drives(drives))
    found[0] = replace(found[0], gaps=(*found[0].gaps, *of_craft))
    found, without = _with_lacking(found, drives)
    found = [*(replace(one, edge=hub_edge(first.scenario)) for one in found), *beside]
    return Budget(
        first.scenario,
        required,
        rule,
        tuple(found),
        combine_lines(found, rule, with_errors=False),
        _assessments(required, found, rule, without, loads),
        tuple(_windows(first.scenario, found, rule)),
        compared if short_way else (),
        without_steady=tuple(_without_steady(runs, drives)),
    )


def _with_clock(
    contribution: Contribution, drive: _Drive, first: _Drive, one_clock: bool
) -> Contribution:
    """Contribution of a drive with its clock; by ``one_clock`` with phases at the instant at which the
    record of the ``first`` begins, for all begin to step together, and records begin later.
    """
    if not one_clock:
        return replace(contribution, clock=f"drive {drive.clock}")
    later = drive.scenario.record.settle - first.scenario.record.settle
    turned = np.exp(-2j * np.pi * contribution.frequency * later)[:, None]
    return replace(contribution, clock="all drives", los=contribution.los * turned)


def read_requirements(
    given: Requirements | str | Path | None, files: FileAccess
) -> Requirements | None:
    """Requirements, or those of the file that is named."""
    if given is None or isinstance(given, Requirements):
        return given
    return read_file(files.under("requirement").path(os.fspath(given)), Requirements)


def _without_steady(runs: Sequence[_Run], drives: Sequence[_Drive]) -> Iterator[str]:
    """Why drives did not start in their steady states, a sentence each."""
    for run, drive in zip(runs, drives, strict=True):
        if run.without_steady:
            yield f"{drive.name}: {run.without_steady}"


class _Run(NamedTuple):
    """Contribution of one drive to the line of sight, with its lines."""

    contribution: Contribution
    lines: HubLines
    without_steady: str
    """Why it did not start in its steady state, where it was to."""
    sticking: Sticking
    """Which of its shafts stick at times."""


_OF_WING = ("", " of the second wing")
"""Names of the wings of a craft, behind those of their shafts."""


def _runs(drives: Sequence[_Drive], harmonics: int, progress: Progress | None) -> list[_Run]:
    """Every drive simulated, those of two wings of one craft with what their springs mix."""
    results = [
        run_scenario(drive.scenario, harmonics=harmonics, progress=progress) for drive in drives
    ]
    two = _has_second_wing(drives)
    sticking = [
        sticking_of(result.motion or result.state, repeats=result.state is not None)
        for result in results
    ]
    runs = []
    for k, (drive, result) in enumerate(zip(drives, results, strict=True)):
        beside = sticking[1 - k] if two and k < 2 else None
        runs.append(_run_of(drive, result, sticking[k], beside))
    if two:
        wings = drives[0].scenario, drives[1].scenario
        for k, other in ((0, 1), (1, 0)):
            run = runs[k]
            both = sticking[k], sticking[other]
            mixed = with_side_lines_of_other(
                run.contribution, run.lines, wings[k], wings[other], both, _OF_WING[other]
            )
            runs[k] = run._replace(contribution=mixed)
    return runs


def _run_of(drive: _Drive, result: RunResult, sticking: Sticking, beside: Sticking | None) -> _Run:
    """One drive simulated, whose shafts may stick as ``sticking`` says, and as ``beside`` those of the drive
    of the second wing, if that steps; with what its springs, or the second drive if that holds, mix.
    """
    other = MAY_STICK if beside is None else beside
    steps = beside is not None
    found, lines = contribution_of_run(
        drive.name, drive.scenario, result, other_steps=steps, other_sticking=other
    )
    if found.density is not None:
        turning = TurningDrives(drive.scenario, (sticking, MAY_STICK), other_steps=steps)
        found = with_side_density(found, drive.scenario, turning, own=True)
    if not steps:
        found = with_held_drive(found, lines, drive.scenario, sticking)
    return _Run(found, lines, steady_state_fallback_note(result.solver), sticking)


def _assessments(
    required: Requirements | None,
    contributions: Sequence[Contribution],
    rule: Rule,
    without: Sequence[str],
    loads: ComparedLoads | None,
) -> tuple[Assessment, ...]:
    """Every requirement judged; none where ``without`` says that nothing can be, or in whose band a
    recording's ``loads`` are others than the scenario's.
    """
    if required is None:
        return ()
    unlike = [() if loads is None else loads.unlike_lines(one) for one in required.requirements]
    return tuple(
        _undecided(assess(one, contributions, rule), (*without, *told))
        for one, told in zip(required.requirements, unlike, strict=True)
    )


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.6g}"


class _Drive(NamedTuple):
    name: str
    scenario: Scenario
    """Scenario of this drive alone."""
    clock: str
    """By which it steps."""
    number: int
    """Number of its scenario."""


def _drives(
    given: GivenScenario | Sequence[GivenScenario], names: Sequence[str], steady: bool
) -> tuple[Scenario, list[_Drive]]:
    """The first scenario, and the drives of all, which are on one hub. Two driven wings are two
    drives.
    """
    if not stands_for_scenario(given):
        expect_list(given, "scenario", "[scenario, other]")
    each = [given] if stands_for_scenario(given) else list(given)
    if not each:
        raise OptionError(
            "scenario",
            "missing; the drive on its spacecraft is expected, such as examples/spacecraft.yaml",
        )
    found: list[_Drive] = []
    whole: list[Scenario] = []
    for k, one in enumerate(each, 1):
        scenario = as_scenario(one)
        name = names[k - 1] if names else _default_name(one, k)
        if any(name == drive.name for drive in found):
            name = f"{name} {k}"
        if steady:
            scenario = scenario.with_({"record.start": "steady"})
        _check_craft(name, scenario, found)
        if scenario.second_is_locked:
            raise MicrovibError(
                f"{name}: spacecraft.second_wing.drive: locked is not taken by a budget, which looks at the"
                " locked hinge beside the held one; use held"
            )
        whole.append(scenario)
        found += _drives_of_craft(name, scenario, k)
    for drive, other_drive in _of_two_scenarios(found):
        check_places(drive.name, drive.scenario, other_drive.name, other_drive.scenario)
    return whole[0], found


def _default_name(given: GivenScenario, number: int) -> str:
    if isinstance(given, Scenario):
        return f"drive {number}"
    return Path(given).stem


def _drives_of_craft(name: str, scenario: Scenario, number: int) -> Iterator[_Drive]:
    """The drive of a scenario, and that of a second wing that is driven."""
    yield _Drive(name, scenario.alone, name, number)
    other, wing = scenario.driven_wing, require_craft(scenario).spacecraft.second_wing
    if other is not None and wing is not None:
        second = _second_wing_drive(name)
        yield _Drive(second, other, name if wing.clock_ratio == 1.0 else second, number)


def _has_second_wing(drives: Sequence[_Drive]) -> bool:
    """Whether the second drive is that of the first scenario's second wing."""
    return len(drives) > 1 and drives[1].name == _second_wing_drive(drives[0].name)


def _of_two_scenarios(drives: Sequence[_Drive]) -> Iterator[tuple[_Drive, _Drive]]:
    """Each drive with each that is given by another scenario."""
    yield from ((one, other) for one in drives for other in drives if one.number != other.number)


def _with_lacking(
    found: Sequence[Contribution], drives: Sequence[_Drive]
) -> tuple[list[Contribution], tuple[str, ...]]:
    """Lines of drives, with the gap that their crafts lack arrays of others; and the reasons, by
    the names of the drives.
    """
    arrays = number_of_arrays(drive.scenario for drive in drives)
    if arrays > MAX_ARRAYS:
        why = too_many_arrays(arrays)
        return [replace(one, gaps=(*one.gaps, open_gap(why))) for one in found], (why,)
    told = [
        (one.name, why)
        for one, other in _of_two_scenarios(drives)
        for why in lacking(one.scenario, other.name, other.scenario)
    ]
    gaps = {name: tuple(open_gap(why) for who, why in told if who == name) for name, _ in told}
    with_gaps = [replace(one, gaps=(*one.gaps, *gaps.get(one.source, ()))) for one in found]
    return with_gaps, tuple(f"{name}: {why}" for name, why in told)


def _undecided(one: Assessment, why: Sequence[str]) -> Assessment:
    """Assessment without verdict, where there is a reason ``why``."""
    if not why:
        return one
    return replace(
        one,
        least=0.0,
        most=math.inf,
        verdict="not judged",
        why=tuple(dict.fromkeys([*why, *one.why])),
    )


def _check_craft(name: str, scenario: Scenario, before: Sequence[_Drive]) -> None:
    """MicrovibError where a craft has no line of sight, or is another than that of the drives
    ``before``.
    """
    spacecraft = require_craft(scenario).spacecraft
    if spacecraft.line_of_sight is None:
        raise MicrovibError(
            f"{name}: spacecraft.line_of_sight: missing; a pointing budget needs it"
        )
    for first in before[:1]:
        for key in ("hub", "line_of_sight", "attitude_control"):
            if getattr(require_craft(first.scenario).spacecraft, key) != getattr(spacecraft, key):
                raise MicrovibError(
                    f"{name}: spacecraft.{key}: differs from that of {first.name}; all drives are on one spacecraft"
                )


def read_sources(
    sources: str | Path | Sequence[OtherSource] | None, files: FileAccess = WORKING_FOLDER
) -> tuple[list[OtherSource], FileAccess]:
    """Other sources of a file, whose own files are relative to it, or of a list, and the permission
    to open their tables.
    """
    if sources is None:
        return [], files
    if isinstance(sources, str | Path):
        name, named = os.fspath(sources), files.under("sources")
        return list(read_file(named.path(name), Sources).sources), named.in_folder_of(name)
    expect_list(
        sources,
        "sources",
        "[OtherSource(name='wheel', wheel=...)], or the name of a file of sources",
    )
    for source in sources:
        if not isinstance(source, OtherSource):
            raise ObjectError(
                f"sources: {quoted_value(source)} is not an OtherSource; one for each source is"
                " expected"
            )
    for why in group_errors(sources):
        raise ObjectError(f"sources: {why}")
    return list(sources), files


def _other_contributions(
    sources: str | Path | Sequence[OtherSource] | None,
    scenario: Scenario,
    sticking: tuple[Sticking, Sticking],
    files: FileAccess,
) -> list[Contribution]:
    """Contributions of other sources to the line of sight of a ``scenario``."""
    listed, tables = read_sources(sources, files)
    each = (
        (source, contribution_of_other(source, scenario, tables, sticking)) for source in listed
    )
    edge = hub_edge(scenario)
    return [replace(one, edge=edge) if source.has_place else one for source, one in each]


def _sticking(
    runs: Sequence[_Run], drives: Sequence[_Drive], ensemble: Results | None
) -> tuple[Sticking, Sticking]:
    """Shafts of the first drive and of a second wing's that stick in their runs, or may in a case of
    a campaign, which tells it of the first output alone.
    """
    own = runs[0].sticking
    if ensemble is not None:
        stuck = ensemble.scalar("stuck_output")[drawn_cases(ensemble)]
        return own.or_as(Sticking(True, not np.all(stuck == 0.0))), MAY_STICK
    return own, runs[1].sticking if _has_second_wing(drives) else MAY_STICK


def _second_wing_drive(name: str) -> str:
    """The drive of the second wing of the craft that is called ``name``."""
    return f"{name} {SECOND_DRIVE}"


def with_method_error(recorded: Contribution, compared: Sequence[Difference]) -> Contribution:
    """Lines of a recording, doubted besides by what the blocked-load method misses in each of the scenario's
    own; of others by the most.
    """
    missed = {d.line: d.los_error * d.los[1] / max(d.los[0], 1e-300) for d in compared}
    most = max(missed.values(), default=0.0)
    each = np.array([missed.get(name, most) for name in recorded.names])
    by_method = np.broadcast_to(each[:, None], recorded.relative_errors.shape)
    return replace(recorded, relative_error=both_errors(recorded.relative_errors, by_method))


def _unobserved_axes(scenario: Scenario) -> tuple[Unobserved, ...]:
    """The gap of an axis of the line of sight to which no motion of the hub is assigned."""
    los = require_craft(scenario).spacecraft.line_of_sight
    assert los is not None
    seen = {row.axis for row in los.rows or () if any(row.by)}
    if los.rows is None:
        missing = []
    else:
        missing = [axis for axis in "xy" if axis not in seen]
    return unseen_axes(
        missing, f"spacecraft.line_of_sight.rows has no sensitivity of {' and '.join(missing)}"
    )


def _fed_by_two_drives(drives: Sequence[_Drive]) -> Iterator[Unobserved]:
    """The gaps of modes that two drives of a craft keep ringing together."""
    for one, other in combinations(drives, 2):
        if fed := modes_fed_together(one.scenario, other.scenario):
            yield open_gap(both_drives_reason(fed))


def both_wings(
    scenario: Scenario, first: Contribution, second: Contribution, *tables: HubLines
) -> Contribution:
    """Both drives of one craft as the one source whose cases a campaign keeps: lines of one
    frequency with their phases.

    ``tables`` are the lines of each drive, in the order of the contributions, ``scenario`` is that
    of both.
    """

    def added(of: Callable[[Contribution], np.ndarray]) -> HubLines:
        return combine_wings(
            *(
                replace(t, los=of(one).astype(complex))
                for t, one in zip(tables, (first, second), strict=True)
            )
        )

    def amplitude(lines: HubLines) -> np.ndarray:
        return np.abs(np.nan_to_num(lines.los if lines.los is not None else 0.0))

    def of_other_clock(one: Contribution) -> np.ndarray:
        return np.array([clock != first.clock for clock in one.clocks])[:, None]

    lines = added(lambda one: one.los)
    assert lines.los is not None
    less = amplitude(added(lambda one: one.relative_errors[0] * np.abs(one.los)))
    more = amplitude(added(lambda one: one.relative_errors[1] * np.abs(one.los)))
    relative_error = np.array([less, more])
    rings = amplitude(added(lambda one: np.abs(one.los) * ~one.settled[:, None]))
    loose = amplitude(added(lambda one: np.abs(one.los) * of_other_clock(one)))
    size = amplitude(lines)
    return replace(
        first,
        how=f"{first.how}, both wings",
        names=lines.names,
        frequency=lines.frequency,
        los=np.nan_to_num(lines.los),
        unlocked=np.any(loose > 0.0, axis=1),
        rings=np.any(rings > 0.0, axis=1),
        frequency_error=np.array(
            [_frequency_error_at(float(f), (first, second)) for f in lines.frequency]
        ),
        density=replace(lines, scenario=scenario).density,
        gaps=(*first.gaps, *second.gaps),
        side=second.side if first.side is None else first.side.joined(second.side),
        relative_error=np.divide(
            relative_error, size, out=np.zeros_like(relative_error), where=size > 0.0
        ),
        scenario=scenario,
    )


def _frequency_error_at(frequency: float, contributions: Sequence[Contribution]) -> float:
    """By how much lines of a frequency [Hz] may be off it, in any of some sources."""
    errors = [
        float(off)
        for one in contributions
        for line, off in zip(one.frequency, one.off, strict=True)
        if abs(line - frequency) <= FREQUENCY_TOLERANCE * frequency
    ]
    return max(errors, default=float(frequency_error_bound(frequency)))


def ensemble_of(scenario: Scenario, folder: Path) -> Results:
    """Results of a merged campaign of a ``scenario`` over distributions alone; MicrovibError where
    it is none.
    """
    campaign = open_campaign(folder)
    for key in _COMPARED_GROUPS:
        if getattr(campaign.design.base, key) != getattr(scenario, key):
            raise MicrovibError(f"{folder}: is a campaign of another scenario: {key} differs")
    if campaign.design.cases != campaign.design.samples.shape[0]:
        raise MicrovibError(
            f"{folder}: has levels, which are no ensemble; a campaign of distributions alone is"
            " expected"
        )
    results = open_results(campaign)
    if not np.any(independent_cases(campaign.design) & (results.state == DONE)):
        raise MicrovibError(f"{folder}: has no independent case that was computed")
    return results


def with_campaign(drive: Contribution, results: Results) -> Contribution:
    """A drive with the amplitudes of all its lines over the independent cases of a campaign.

    Lines that were found and not expected are numbered by size in each case: they are the drive's
    where frequencies agree, and lines of their own beside them where not.
    """
    counted, drawn = independent_cases(results.campaign.design), drawn_cases(results)
    los = {
        name: np.array([results.of(name, key)[drawn] for key in ("los_x", "los_y")]).T
        for name in results.lines
    }
    found, at = _lines_in_cases(drive, los, results, drawn)
    width = len(drive.names)
    kept = np.append(np.ones(width, dtype=bool), np.nan_to_num(found[:, width:]).any(axis=(0, 2)))
    nominal = np.append(drive.frequency, [_median_frequency(x) for x in at[:, width:].T])
    at = np.where(np.isfinite(at), at, nominal)[:, kept]
    lack = []
    if np.any(counted & ~drawn):
        lack = [f"{int(np.sum(counted & ~drawn))} cases have no result"]
    lack += _missing_line_reasons(drive, los, results, drawn)
    return replace(
        drive, cases=np.nan_to_num(found[:, kept]), cases_frequency=at, cases_lack="; ".join(lack)
    )


def _with_cases_of_another(recorded: Contribution) -> Contribution:
    """A recorded drive, of which a campaign's cases tell no percentile: they are the scenario's."""
    why = (
        "the campaign's cases are those of the scenario's drive, not of the recorded one (leave the"
        " recording out, or the percentile)"
    )
    return replace(recorded, cases_lack="; ".join(filter(None, (recorded.cases_lack, why))))


def _lines_in_cases(
    drive: Contribution, los: dict[str, np.ndarray], results: Results, drawn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes (cases, lines, 2) [rad] and frequencies (cases, lines) [Hz] of the drive's lines
    and, behind them, of others of the campaign; nan where a case has no such line.
    """
    width = len(drive.names)
    listed = [name for name in drive.names if not is_unlisted(name) and name in results.lines]
    names = [*drive.names, *(name for name in results.lines if name not in listed)]
    found = np.full((int(drawn.sum()), len(names), 2), np.nan)
    at = np.full(found.shape[:2], np.nan)
    for k, name in enumerate(names):
        if k >= width or name in listed:
            found[:, k], at[:, k] = los[name], results.of(name, "frequency")[drawn]
    unlisted = [k for k, name in enumerate(names) if is_unlisted(name)]
    for k in (k for k in unlisted if k < width):
        for j in (j for j in unlisted if j >= width):
            same = np.abs(at[:, j] - drive.frequency[k]) <= FREQUENCY_TOLERANCE * drive.frequency[k]
            found[same, k], found[same, j] = found[same, j], np.nan
    return found, at


def _missing_line_reasons(
    drive: Contribution, los: dict[str, np.ndarray], results: Results, drawn: np.ndarray
) -> Iterator[str]:
    """Which lines of the line of sight, ``los`` (cases, 2) [rad] each, the ``drawn`` cases do not
    tell; a sentence each.
    """
    size = np.hypot(*np.abs(drive.los).T)
    least = FAINT_LINE * size.max()
    large = [name for k, name in enumerate(drive.names) if drive.settled[k] and size[k] > least]
    large += [
        name
        for name in los
        if name not in drive.names and np.nanmax(los[name], initial=0.0) > least
    ]
    missing = [x for x in large if not is_unlisted(x) and (x not in los or np.isnan(los[x]).any())]
    if missing:
        yield f"{', '.join(missing[:3])} is not in all cases"
    ringing = np.zeros(int(drawn.sum()), dtype=bool)
    for name in filter(is_unlisted, los):
        lasts = np.isin(results.status(name)[drawn], ("ok", ""))
        ringing |= ~lasts & (np.nan_to_num(los[name]).max(axis=1) > least)
    if ringing.any():
        remedy = "a longer record.settle, or solve: steady"
        yield f"an unlisted line rings or is driven by noise in {int(ringing.sum())} cases ({remedy})"


def _median_frequency(frequency: np.ndarray) -> float:
    """Median of a line's frequencies (cases,) [Hz], for cases that do not have it; any where none
    has.
    """
    known = frequency[np.isfinite(frequency)]
    if known.size:
        return float(np.median(known))
    return 1.0


def _windows(
    scenario: Scenario, contributions: Sequence[Contribution], rule: Rule
) -> Iterator[Window]:
    """Rms of each metric in each window of the line of sight."""
    densities = [one.density for one in contributions if one.density is not None]
    los = require_craft(scenario).spacecraft.line_of_sight
    assert los is not None
    for window in los.windows:
        for metric in METRICS:
            asked = [
                Requirement.model_construct(metric=metric, window=window, apart=window, axis=axis)
                for axis in ("x", "y", "radial")
            ]
            tones = combine_lines(
                [worst_alternative(asked[-1], one) for one in contributions],
                rule,
                with_errors=False,
            )
            lines = [evaluate_metric(r, tones.frequency, tones.value) for r in asked]
            noise = [evaluate_metric(r, np.zeros(0), np.zeros((0, 2)), densities) for r in asked]
            errors = [evaluate_errors(r, tones.errors) for r in asked]
            both = np.sqrt(np.square(lines) + np.square(noise) + np.square(errors))
            yield Window(
                metric,
                window,
                *((float(x[0]), float(x[1]), float(x[2])) for x in (lines, noise, errors, both)),
            )


def summary(budget: Budget) -> dict[str, Any]:
    """Contents of ``budget.json``; angles in rad."""
    return {
        "verdict": budget.verdict,
        "holds": budget.holds_at,
        "array_angles_deg": [
            math.degrees(x) for x in budget.angles or (require_craft(budget.scenario).spacecraft.array_angle,)
        ],
        "notes": [*budget.notes, *budget.without_steady],
        "sum": budget.rule,
        "requirements": [
            {
                **_row(one), "array_angle_deg": budget.angle_of(one),
                "value_angle_deg": budget.angle_of_value(one),
            }
            for one in budget.judged
        ],
        "sources": [
            {
                "source": one.source, "how": one.how, "lines": len(one.names),
                "not_known": list(dict.fromkeys(gap.why for gap in one.gaps)),
            }
            for one in budget.contributions
        ],
        "windows": [
            {"metric": w.metric, "window_s": w.window, **{
                f"{part}_{axis}_rad": value
                for part in ("lines", "noise", "errors", "both")
                for axis, value in zip(("x", "y", "radial"), getattr(w, part), strict=True)
            }}
            for w in budget.windows
        ],
        "short_way": [
            {"line": d.line, "frequency_hz": d.frequency, "short_rad": d.los[0], "coupled_rad": d.los[1], "los_error": d.los_error,
             "load_error": d.load_error, "share": d.share}
            for d in budget.short_way
        ],
    }  # fmt: skip


def _row(one: Assessment) -> dict[str, Any]:
    spread = one.spread or ()
    return {
        "name": one.requirement.name, "requirement": one.requirement.text, "limit_rad": one.limit, "value_rad": one.value,
        "least_rad": one.least, "most_rad": one.most, "lines_rad": one.lines, "noise_rad": one.noise, "errors_rad": one.errors,
        "margin": one.margin,
        "verdict": one.verdict, "why": list(one.why),
        "ensemble": {name: {"value_rad": e.value, "low_rad": e.low, "high_rad": e.high}
                     for name, e in zip(("median", "p95", "p99"), spread, strict=False)},
        "sources": [{"source": c.source, "rms_rad": c.rms, "share": c.share, "without_rad": c.without} for c in one.sources],
        "ranking": [{"source": c.source, "line": c.line, "frequency_hz": c.frequency, "rms_rad": c.rms, "share": c.share,
                     "without_rad": c.without}
                    for c in one.ranking[:20]],
    }  # fmt: skip
