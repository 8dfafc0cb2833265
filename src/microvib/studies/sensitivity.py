"""Which uncertain value matters most for each line: what a line does while one value at a time goes
through its range.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from microvib.analysis.lines import expected_in, lines_of_samples, lines_of_steady_state
from microvib.analysis.margins import MIN_RELATIVE_ERROR
from microvib.errors import MicrovibError, SimulationError
from microvib.model.linear import dynamic_stiffness, momentum_row
from microvib.model.ranges import noted_ranges, values_without_range
from microvib.model.record import Start
from microvib.model.scenario import GivenScenario, Scenario, as_scenario, with_start
from microvib.results import FREQUENCY, TORQUE, Column
from microvib.signals.line_table import Line, LineTable
from microvib.solve.batch import simulate_torques
from microvib.solve.integration import Progress
from microvib.solve.steady.recorded import NotDifferentiable
from microvib.solve.steady.state import SteadyState, find_steady
from microvib.studies.workers import parallel_calls

STEP = 0.02
"""Part by which a value is changed for the derivative, to both sides."""
SLOPE_TOLERANCES = 0.2, 0.5
"""By how much the slopes on both sides may differ, and by what part of the larger, for a
derivative.
"""
EQUAL_SPAN_RATIO = 0.9
"""Part of the largest span from which another counts as large: spans come from ends and peaks, not
from all between.
"""
SCAN_POINTS, REFINED_POINTS, MIN_EXTREME_RATIO = 41, 21, 1.1
"""Values of a range at which the linearised drive is looked at, then about its extremes; and the
factor by which one must exceed the ends to be run."""
MAX_LINES = 8
"""Lines that are looked at, the largest."""
STEADY_HARMONICS = 8
"""Members of each family of lines of a steady state."""
NOT_RANKED = (
    "sources: no value of this scenario has a range to vary it over; note the range of a value that"
    " is not well known, such as  sources: {reducer.stiffness: 'assumed; range 8000 N*m/rad to"
    " 10000 N*m/rad'}"
)


@dataclass(frozen=True)
class Effect:
    """Effect of one value on one line, the others unchanged; amplitudes nan where a run failed or
    has no such line.
    """

    key: str
    value: float
    """In SI, like the range."""
    range: tuple[float, float]
    sensitivity: float
    """d ln amplitude / d ln value, by central difference over STEP; nan where the slopes on both
    sides differ beyond BENDS: there the line jumps to another motion, or bends, and has no
    derivative."""
    slopes: tuple[float, float]
    """Sensitivities below and above the value."""
    amplitudes: tuple[float, float]
    """Amplitudes [N m] at both ends of the range."""
    between: tuple[tuple[float, float], ...] = ()
    """Values [SI] within the range where the linearised drive's line has an extreme, and amplitudes
    [N m] there.
    """

    def span(self, amplitude: float) -> float:
        """How far the line, ``amplitude`` [N m] with the value itself, moves within the range [N
        m].
        """
        known = [
            x
            for x in (amplitude, *self.amplitudes, *(x for _, x in self.between))
            if math.isfinite(x)
        ]
        return max(known) - min(known)

    @property
    def lost(self) -> bool:
        """Whether the line is not known somewhere in the range."""
        return not all(map(math.isfinite, (*self.amplitudes, *(x for _, x in self.between))))


@dataclass(frozen=True)
class LineEffects:
    """Effects on one line, ranked: the one that moves it farthest over its range first."""

    line: Annotated[str, Column("line", "line")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)]
    effects: tuple[Effect, ...]

    @property
    def verdict(self) -> Annotated[str, Column("verdict", "verdict")]:
        """Which value matters most, in words, as far as that is told."""
        spans = [effect.span(self.amplitude) for effect in self.effects]
        most = [
            e.key
            for e, span in zip(self.effects, spans, strict=True)
            if span >= EQUAL_SPAN_RATIO * max(spans)
        ]
        lost = [e.key for e in self.effects if e.lost]
        said = f"{' and '.join(most)} matter{'s' if len(most) == 1 else ''} most"
        if len(most) > 2:
            said = f"{len(most)} of {len(spans)} values change it equally: the most influential one is not resolved"
        if max(spans) <= 2.0 * MIN_RELATIVE_ERROR * self.amplitude:
            said = "no value changes it by more than the error of a run"
        return said + (f"; it is unknown in part of the range of {', '.join(lost)}" if lost else "")


@dataclass(frozen=True)
class Failed:
    """A changed scenario that could not be simulated."""

    key: str
    value: float
    """In SI."""
    reason: str


@dataclass(frozen=True)
class Ranking:
    """Effects on each line; what was looked at without result, and what was not looked at."""

    lines: tuple[LineEffects, ...]
    failed: tuple[Failed, ...]
    left_out: dict[str, str]
    """Values of which the file says that they are assumed, or notes a range, by dotted key, and why
    they do not take part.
    """
    how: str = ""
    """How lines and sensitivities were found, where it was not from runs that begin at rest."""

    def __iter__(self) -> Iterator[LineEffects]:
        return iter(self.lines)


def sensitivities(
    scenario: GivenScenario, *, start: Start | None = None, progress: Progress | None = None
) -> Ranking:
    """Rank values whose source notes a range by their effect on the MAX_LINES largest lines.

    Each takes four runs or more: two beside the value, two at the ends of its range, and more where
    the linearised drive has a resonance or its opposite for a line in between. Runs begin at rest
    and have the scenario's record. A changed scenario that fails has no amplitudes and is listed.
    Integers are not ranked.

    In the steady state, lines are exact, and sensitivities are its derivatives (``mv.SteadyState``),
    for which nothing is run; differences are taken of values by which a line has none.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive: a scenario, a name of the catalog, or the path of a scenario file.
    start : {"rest", "steady"}, optional
        Whether lines are those of runs from rest or of steady states; without it, as
        ``record.start`` says. Where there is no steady state runs begin at rest, and ``how`` says
        why.
    progress : callable, optional
        Called as ``progress(done, total)``, with the number of runs.

    Returns
    -------
    Ranking
        Of each line the effects, the largest first; what failed; and what was not ranked.

    Raises
    ------
    MicrovibError
        Where no source notes a range.
    SimulationError
        What ``simulate`` raises for the scenario itself.
    """
    scenario = with_start(as_scenario(scenario), start)
    ranges = noted_ranges(scenario)
    if not ranges:
        raise MicrovibError(NOT_RANKED)
    base = _Base.of(scenario, list(ranges))
    scenario = base.scenario
    if progress is not None:
        progress(0, 4 * len(ranges))
    names = [line.name for line in base.lines]
    scans = [
        _Scan(
            key,
            float(scenario[key]),
            ends,
            _extremes(scenario, key, float(scenario[key]), ends, names),
            base.derivatives.get(key),
        )
        for key, ends in ranges.items()
    ]
    points = [(scan.key, value) for scan in scans for value in scan.points]
    with parallel_calls(progress) as calls:
        runs = calls(_amplitudes, ((scenario, *point) for point in points))
    failed = [
        Failed(*point, why) for point, why in zip(points, runs, strict=True) if isinstance(why, str)
    ]
    each = iter({} if isinstance(found, str) else found for found in runs)
    found = [[next(each) for _ in scan.points] for scan in scans]
    lines = tuple(_effects_on(line, scans, found) for line in base.lines)
    return Ranking(lines, tuple(failed), values_without_range(scenario), base.how)


def _effects_on(
    line: Line, scans: Sequence[_Scan], found: Sequence[Sequence[Mapping[str, float]]]
) -> LineEffects:
    """Effects on one line, the largest first; ``found`` are amplitudes by line at the values of each
    scan.
    """
    effects = [
        _effect(scan, line, [run.get(line.name, math.nan) for run in its])
        for scan, its in zip(scans, found, strict=True)
    ]
    ranked = tuple(sorted(effects, key=lambda effect: -effect.span(line.amplitude)))
    return LineEffects(line.name, line.frequency, line.amplitude, ranked)


@dataclass(frozen=True)
class _Scan:
    """Values [SI] of one key that are simulated."""

    key: str
    value: float
    """The scenario's."""
    ends: tuple[float, float]
    inside: tuple[float, ...]
    """Where the linearised drive has extremes."""
    derivatives: Mapping[str, float] | None = None
    """d ln amplitude / d ln value by line, where nothing needs to be run for them."""

    @property
    def points(self) -> tuple[float, ...]:
        """Beside the value, unless derivatives are known; at the ends of its range, and inside."""
        beside = _perturbed_values(self.value) if self.derivatives is None else ()
        return (*beside, *self.ends, *self.inside)


@dataclass(frozen=True)
class _Base:
    """The scenario as it is: its largest lines, and derivatives of these that are known."""

    scenario: Scenario
    lines: list[Line]
    derivatives: dict[str, dict[str, float]]
    """d ln amplitude / d ln value by key, then by line."""
    how: str

    @classmethod
    def of(cls, scenario: Scenario, keys: Sequence[str]) -> _Base:
        """Base of a scenario: its steady state where the record starts in one, else a run from rest."""
        why = ""
        if scenario.record.start == "steady":
            state, why = find_steady(scenario, whole=False)
            if state is not None:
                lines = _largest_lines(lines_of_steady_state(state, "T_d", STEADY_HARMONICS))
                found = _derivatives(state, keys, lines)
                return cls(scenario, lines, found, _how(keys, found))
            why = f"Runs begin at rest, because there is no steady state: {why}."
        scenario = scenario.with_({"record.start": "rest"})
        torque = simulate_torques([scenario])[0]
        if isinstance(torque, SimulationError):
            raise torque
        table = lines_of_samples(torque.T_d, torque.sample_rate, scenario)
        return cls(scenario, _largest_lines(table), {}, why)


def _derivatives(
    state: SteadyState, keys: Sequence[str], lines: Sequence[Line]
) -> dict[str, dict[str, float]]:
    """d ln amplitude / d ln value by key, then by line, of those keys by which all lines have one."""
    orders = [round(line.frequency / state.frequency) for line in lines]
    able = [key for key in keys if state.scenario[key] != 0.0]
    try:
        found = state.derivatives(able, orders).relative.real
    except NotDifferentiable:
        return {}
    return {
        key: {line.name: x for line, x in zip(lines, row, strict=True)}
        for key, row in zip(able, found.tolist(), strict=True)
        if all(map(math.isfinite, row))
    }


def _how(keys: Sequence[str], derivatives: Mapping[str, object]) -> str:
    """How sensitivities were found, in a sentence."""
    rest = [key for key in keys if key not in derivatives]
    if not rest:
        return "Lines are those of steady states, and d ln/d ln their derivatives."
    taken = f"by {', '.join(rest)} differences, since a line has a kink there or no derivative"
    if len(rest) == len(keys):
        return f"Lines are those of steady states, and d ln/d ln {taken}."
    return f"Lines are those of steady states, and d ln/d ln their derivatives; {taken}."


def _largest_lines(table: LineTable) -> list[Line]:
    """Lines of the scenario as it is, the largest first."""
    known = [
        line
        for line in table.notable()
        if line.kind not in ("sideband", "other") and math.isfinite(line.amplitude)
    ]
    return sorted(known, key=lambda line: -line.amplitude)[:MAX_LINES]


def _perturbed_values(value: float) -> tuple[float, float]:
    return value * (1.0 - STEP), value * (1.0 + STEP)


def _extremes(
    scenario: Scenario, key: str, value: float, ends: tuple[float, float], lines: Sequence[str]
) -> tuple[float, ...]:
    """Values within the range at which the linearised drive's ``lines`` are larger, or smaller,
    than at its ends and ``value``.
    """
    grid = np.linspace(*ends, SCAN_POINTS)
    gains = _gains(scenario, key, [*grid, value], lines)
    step, found = grid[1] - grid[0], set[float]()
    for k in np.flatnonzero(np.any(np.isfinite(gains), axis=0)).tolist():
        for sign in (1.0, -1.0):
            known = sign * np.log(gains[:, k])
            at = int(np.nanargmax(known[:-1]))
            close = np.linspace(
                max(grid[at] - step, ends[0]), min(grid[at] + step, ends[1]), REFINED_POINTS
            )
            finer = sign * np.log(_gains(scenario, key, close, [lines[k]])[:, 0])
            if np.nanmax(finer) > np.nanmax(known[[0, -2, -1]]) + math.log(MIN_EXTREME_RATIO):
                found.add(float(f"{close[int(np.nanargmax(finer))]:.4g}"))
    return tuple(sorted(x for x in found if ends[0] < x < ends[1]))


def _gains(
    scenario: Scenario, key: str, values: Sequence[float] | np.ndarray, lines: Sequence[str]
) -> np.ndarray:
    """T_d of the linearised drive for 1 N m on the rotor at each line of the clock, (values,
    lines); nan of others.
    """
    gains = np.full((len(values), len(lines)), np.nan)
    for row, value in zip(gains, values, strict=True):
        try:
            changed = scenario.with_si({key: float(value)})
        except MicrovibError:
            continue
        at = {
            x.name: x.frequency
            for x in expected_in(changed, changed.record.sample_rate)
            if not x.is_mode
        }
        for k, f in (
            (k, at[name]) for k, name in enumerate(lines) if name in at and at[name] > 0.0
        ):
            dynamic = dynamic_stiffness(changed, f)
            moved = np.linalg.solve(dynamic, np.eye(dynamic.shape[0])[0])
            row[k] = (2.0 * math.pi * f) ** 2 * abs(momentum_row(changed, f) @ moved)
    return gains


def _effect(scan: _Scan, line: Line, found: Sequence[float]) -> Effect:
    """Effect of one key on a line, ``found`` at the points of its scan [N m]."""
    if scan.derivatives is not None:
        slope = scan.derivatives[line.name]
        sides = (slope, slope)
        low, high, *between = found
    else:
        below, above, low, high, *between = found
        slope, sides = _slopes(scan.value, line.amplitude, below, above)
    return Effect(
        scan.key,
        scan.value,
        scan.ends,
        slope,
        sides,
        (low, high),
        tuple(zip(scan.inside, between, strict=True)),
    )


def _slopes(
    value: float, amplitude: float, below: float, above: float
) -> tuple[float, tuple[float, float]]:
    """Sensitivity of a line of this ``amplitude``, by its amplitudes beside the value, and those to
    both sides; nan where there is none.
    """
    if not (below > 0.0 and above > 0.0 and amplitude > 0.0 and value != 0.0):
        return math.nan, (math.nan, math.nan)
    sides = (
        math.log(below / amplitude) / math.log(1.0 - STEP),
        math.log(above / amplitude) / math.log(1.0 + STEP),
    )
    if abs(sides[1] - sides[0]) > max(
        SLOPE_TOLERANCES[0], SLOPE_TOLERANCES[1] * max(map(abs, sides))
    ):
        return math.nan, sides
    return math.log(above / below) / math.log((1.0 + STEP) / (1.0 - STEP)), sides


def _amplitudes(scenario: Scenario, key: str, value: float) -> dict[str, float] | str:
    """Amplitudes [N m] of lines with one value changed; the reason where it cannot be simulated."""
    try:
        changed = scenario.with_si({key: value})
    except MicrovibError as error:
        return str(error)
    if changed.record.start == "steady":
        state, why = find_steady(changed.with_sources({}), whole=False)
        if state is None:
            return why
        table = lines_of_steady_state(state, "T_d", STEADY_HARMONICS)
        return {line.name: line.amplitude for line in table}
    torque = simulate_torques([changed])[0]
    if isinstance(torque, SimulationError):
        return str(torque)
    table = lines_of_samples(torque.T_d, torque.sample_rate, changed)
    return {line.name: line.amplitude for line in table}
