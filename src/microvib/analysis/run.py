"""A run: motion or steady state, its lines, and how far they are off; the same for the command
line, the page and a notebook.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from microvib.analysis.accuracy import (
    ERROR_ESTIMATE_KEY,
    Accuracy,
    add_error_estimate,
    error_of_motion,
    failed_invariants_reason,
    read_error_estimate,
    steady_accuracy,
    with_integration_error,
    with_known_error,
)
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.limits import Judgement, judge
from microvib.analysis.lines import (
    HARMONICS_RANGE,
    find_lines,
    lines_of_motion,
    lines_of_steady_state,
)
from microvib.analysis.other_states import SECOND_WING
from microvib.analysis.pointing import HubLines
from microvib.analysis.seeds import MAX_SEEDS, check_seeds, with_seeds
from microvib.analysis.start import mode_has_decayed, record_gap
from microvib.analysis.stream import lines_of_stream
from microvib.errors import ChannelError, expect, whole_number
from microvib.model.line_names import SECOND_DRIVE
from microvib.model.record import Start
from microvib.model.scenario import GivenScenario, Scenario, as_scenario, with_start
from microvib.signals.fourier_lines import TRANSIENT
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import LineTable
from microvib.solve.integration import Progress, simulate_from_rest
from microvib.solve.motion import Invariants, Motion
from microvib.solve.steady.state import SteadyState, find_steady


@dataclass(frozen=True)
class RunResult:
    """Result of a run."""

    scenario: Scenario
    table: LineTable
    """Lines of the disturbance torque; they know how far they are off."""
    invariants: Invariants
    solver: dict[str, Any]
    """How it was solved."""
    motion: Motion | None
    """None where lines alone were asked for."""
    state: SteadyState | None = None
    """The steady state, where the record starts in it: lines, invariants and account of the solver
    are then its own.
    """
    fallback: str = ""
    """Why a steady state that was asked for was not found; the run then began at rest."""
    second: RunResult | None = None
    """Result of the second wing's drive alone, where it is driven and more than lines of T_d
    was kept.
    """
    judgement: Judgement | None = None
    """Its lines against the limit that was given with the run."""

    @classmethod
    def of_motion(
        cls, motion: Motion, table: LineTable, second_table: LineTable | None = None
    ) -> RunResult:
        """A run of which motion and lines were kept, and those of a second wing's drive."""
        beside, second = motion.second_wing, None
        if beside is not None and second_table is not None:
            second = cls.of_motion(beside, second_table)
        return cls(motion.scenario, table, motion.invariants, motion.solver, motion, second=second)

    def __repr__(self) -> str:
        return f"Run of {self.scenario.brief}\n{self.table!r}"

    @property
    def drives(self) -> dict[str, RunResult]:
        """This result and that of the second wing's drive, by how texts call what is theirs."""
        if self.second is None:
            return {"": self}
        return {"": self, f" of {SECOND_DRIVE}": self.second}

    @cached_property
    def hub(self) -> HubLines | None:
        """Lines of what the hub of a craft feels and does; None on a fixed base, and where no more
        than T_d was kept.
        """
        source = self.state or self.motion
        if source is None or self.scenario.spacecraft is None:
            return None
        return hub_lines(source, self.table)

    def judge(self, limit: Limit) -> Judgement:
        """The lines of the run, those of a second wing's drive, and the loads that the limit has curves
        for, against a limit.
        """
        if self.second is not None:
            second: LineTable | None = self.second.table
        else:
            second = None if self.motion is None else lines_of_second(self.motion, self.table)
        return judge(self.table, limit, self.scenario, second, self.load_lines(limit))

    def load_lines(self, limit: Limit) -> dict[str, LineTable]:
        """Lines of the loads on the spacecraft that a limit has curves for, by their channels, at a
        second wing's interface, too; none of those that the run does not know.
        """
        source = self.state or self.motion
        if source is None:
            return {}
        found = {}
        for name in limit.loads:
            for channel in (name, f"{name}{SECOND_WING}"):
                with suppress(ChannelError):
                    table = find_lines(source, channel, self.table.harmonics)
                    found[channel] = self._as_steady(table)
        return found

    def _as_steady(self, table: LineTable) -> LineTable:
        """Lines of another channel, without the modes that do not ring as the record began in the
        steady state.
        """
        still = {line.name for line in self.table if line.status == TRANSIENT}
        lines = (replace(x, status=TRANSIENT) if x.name in still else x for x in table)
        return replace(table, lines=tuple(lines))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Parts of the lasting motion that its lines do not show, in words: for the tables that others
        may take for a source.
        """
        found = []
        if self.second is None and self.scenario.driven_wing is not None:
            found.append(f"what the record of {SECOND_DRIVE} tells of it")
        for drive in self.drives.values():
            steady = drive.state is not None
            gap = record_gap(drive.scenario.alone, drive.table.duration, steady=steady)
            found += [gap.why] if gap else []
            if drive.scenario.rate is None:
                found.append("lines of a rate that changes within the record")
            growing = [line.name for line in drive.table if line.status == "growing"]
            found += [f"{', '.join(growing)}, which grows within the record"] if growing else []
            if not steady and (unknown := drive._unknown_lines()):
                found.append(f"{', '.join(unknown)}, which could not be estimated")
            broken = failed_invariants_reason(drive.table.broken, drive.scenario)
            found += [broken] if broken else []
        return tuple(found)

    def _unknown_lines(self) -> list[str]:
        """Expected lines that its record does not tell and that may be there."""
        unknown = () if self.hub is None else self.hub.unknown
        return [
            line.name
            for line in self.table
            if line.name in unknown and not mode_has_decayed(line, self.scenario)
        ]

    @property
    def accuracy(self) -> Accuracy | None:
        """How far the integration may be off; None where that is not known."""
        return read_error_estimate(self.solver)


def run_scenario(  # noqa: PLR0913 - keyword options
    scenario: GivenScenario,
    *,
    start: Start | None = None,
    harmonics: int = 8,
    lines_only: bool = False,
    seeds: int = 0,
    limit: Limit | None = None,
    progress: Progress | None = None,
    drawn: Callable[[int], None] | None = None,
) -> RunResult:
    """Run a scenario as ``microvib run`` does: motion, lines, and how far they are off.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is run: a scenario, a name of the catalog, or the path of a scenario file.
    start : {"rest", "steady"}, optional
        How the motion begins; without it, as ``record.start`` says. Where there is no steady state
        it begins at rest, and ``fallback`` says why.
    harmonics : int
        Members of each family of lines that are looked for.
    lines_only : bool
        Keep no motion: memory stays bounded however long the record.
    seeds : int
        Draws of the noise that are run besides, so that the table knows its lines over them.
    limit : Limit, optional
        Limit that the lines are judged by (``judgement``): one torque, or curves over frequency.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.
    drawn : callable, optional
        Called as ``drawn(count)`` after each draw.

    Returns
    -------
    RunResult
        Table of lines, motion (None with ``lines_only``), steady state if there is one, invariants,
        and on a craft loads and pointing (``hub``).

    Raises
    ------
    SimulationError
        What ``simulate`` raises.
    OptionError
        For ``harmonics`` or ``seeds`` out of their range, and for seeds without noise.
    """
    scenario = with_start(as_scenario(scenario), start)
    whole_number("harmonics", harmonics, *HARMONICS_RANGE)
    if whole_number("seeds", seeds, 0, MAX_SEEDS):
        check_seeds(scenario, seeds)
    if progress is not None:  # a steady state tells nothing while it is sought
        progress(0.0, scenario.record.settle + scenario.record.duration)
    result = _solve_one(scenario, harmonics, lines_only, progress)
    if seeds:
        result = replace(result, table=with_seeds(result.table, scenario, seeds, drawn))
    if limit is not None:
        expect(limit, Limit, "a limit, such as mv.Limit('10 mN*m')")
        return replace(result, judgement=result.judge(limit))
    return result


def _solve_one(
    scenario: Scenario, harmonics: int, lines_only: bool, progress: Progress | None
) -> RunResult:
    if scenario.record.start == "steady":
        state, fallback = find_steady(scenario)
    else:
        state, fallback = (None, "")
    if fallback:
        not_used = {"steady": f"not used: {fallback}"}
    else:
        not_used = {}
    if lines_only and state is None:
        table, invariants, solver = lines_of_stream(scenario, harmonics, progress)
        return RunResult(scenario, table, invariants, solver | not_used, None, None, fallback)
    motion = None
    if not lines_only:
        if state is None:
            motion = simulate_from_rest(scenario, progress=progress)
        else:
            motion = state.motion(progress=progress)
        motion = replace(motion, solver=motion.solver | not_used)
    result = _result_of(state, motion, harmonics)
    return replace(result, solver=result.solver | not_used, fallback=fallback)


def _result_of(state: SteadyState | None, motion: Motion | None, harmonics: int) -> RunResult:
    """Result from a steady state, a motion or both, of one drive and of the second wing's."""
    source = state or motion
    assert source is not None
    if isinstance(source, SteadyState):
        table = lines_of_steady_state(source, "T_d", harmonics)
    else:
        table = lines_of_motion(source, "T_d", harmonics)
    solver, second = source.solver, None
    if source.second_wing is not None:
        second = _result_of(state and state.second_wing, motion and motion.second_wing, harmonics)
    if motion is not None:
        found = error_of_motion(motion, table)
        table, solver = with_integration_error(table, found), add_error_estimate(solver, found)
        if (
            state is not None
        ):  # lines are the steady state's, and the motion shows whether it is one
            table = replace(
                table, broken=tuple(dict.fromkeys((*table.broken, *motion.invariants.broken)))
            )
        motion = replace(
            motion,
            solver=add_error_estimate(motion.solver, found),
            second_wing=None if second is None else second.motion,
        )
    elif state is not None:
        found = steady_accuracy(state, table)
        table, solver = with_integration_error(table, found), add_error_estimate(solver, found)
    return RunResult(
        source.scenario, table, source.invariants, solver, motion, state, second=second
    )


def lines_of_second(motion: Motion, table: LineTable) -> LineTable | None:
    """Lines of the second wing's drive in a run's motion, as many as the first's ``table`` has,
    which know how far they are off where the run asked; None where it is not driven."""
    beside = motion.second_wing
    if beside is None:
        return None
    second = lines_of_motion(beside, "T_d", table.harmonics)
    if ERROR_ESTIMATE_KEY in beside.solver:
        return with_known_error(second)
    return second
