"""Contributions of drives to the line of sight by their runs, with their gaps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from microvib.analysis.accuracy import failed_invariants_reason
from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.limits import unknown_error_reason
from microvib.analysis.lines import expected_in
from microvib.analysis.margins import (
    ABOVE_PASSBAND_FACTOR,
    RINGING_FACTOR,
    amplitude_error_bound,
    frequency_error_bound,
    may_ring,
    ringing_reason,
)
from microvib.analysis.pointing import HubLines
from microvib.analysis.run import RunResult
from microvib.analysis.spread import spread_sentence
from microvib.analysis.start import (
    mode_has_decayed,
    record_gap,
    rounded_up,
    steady_start_advice,
)
from microvib.analysis.unseen import out_of_band_lines
from microvib.model.coupling import (
    MIN_FREQUENCY_WITHOUT_CONTROL,
    Receiver,
    blocked_load_method,
    line_of_sight_noise_spectrum,
    receiver_of,
    require_craft,
    rotation_to_hub_axes,
    source_of,
)
from microvib.model.drive_matrices import coordinates
from microvib.model.drive_states import (
    MAY_STICK,
    SLIDES,
    DriveStates,
    Sticking,
    craft_of_drives,
    drive_states,
)
from microvib.model.driven import noise_bands
from microvib.model.driven import noise_density as density_of_friction
from microvib.model.expected import is_made
from microvib.model.hub_edge import HubEdge
from microvib.model.linear import coupled_modes
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.line_table import (
    NOISE_DRIVEN,
    Line,
    LineTable,
    ResidualPeaks,
)
from microvib.solve.steady.period import common_period
from microvib.studies.budget.errors import SourceError
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.side_lines import SideLines, TurningDrives

BLOCKED_LOAD_UNCERTAINTY = 0.03
"""Relative error of lines that went the blocked-load method, for a drive that is not quite the scenario's;
assumed. What detent torque, friction and current loop change as the hub yields comes on top, from
runs of the scenario (``study.with_method_error``)."""
HELD_DRIVE_UNCERTAINTY = 0.03
"""Relative error of lines of a craft on which another drive holds its wing, for its friction;
assumed. What its detent torque and its friction where it sticks change comes on top, by the states
in which it may be (``model.drive_states``) or by its steps (``with_side_lines_of_other``)."""
_FREE_BODY_REASON = f"below {MIN_FREQUENCY_WITHOUT_CONTROL:g} Hz, where without spacecraft.attitude_control lines mean nothing"
_FREE_BODY_REMEDIES = (
    "spacecraft.attitude_control",
    f"lowest: {MIN_FREQUENCY_WITHOUT_CONTROL:g} Hz or more in the requirement",
)


@dataclass(frozen=True)
class Unobserved:
    """Gap in the knowledge of a source: why, where, and how large a line it may be at most."""

    why: str
    low: float
    high: float
    """Between which frequencies [Hz]."""
    frequency: np.ndarray
    """Frequencies of lines that it may hide [Hz], (m,)."""
    most: np.ndarray
    """Their largest amplitudes [rad], (m, 2); infinite where nothing bounds them."""
    between: bool = False
    """Whether lines between these, ascending, are no larger than their neighbours; else there are
    none.
    """
    of_squares: bool = False
    """Whether they add to mean squares alone, since their crests are those of lines that are
    counted anyway.
    """

    def inside(self, low: float, high: float) -> Unobserved:
        """Part of the gap from ``low`` to ``high`` [Hz]."""
        if not self.between:
            return self
        near = slice(
            max(np.searchsorted(self.frequency, low) - 1, 0),
            np.searchsorted(self.frequency, high, "right") + 1,
        )
        return replace(
            self, frequency=np.clip(self.frequency[near], low, high), most=self.most[near]
        )

    def about(self, axes: Sequence[int]) -> Unobserved:
        """Part of the gap about ``axes`` of the line of sight, 0 and 1."""
        return replace(self, most=np.where(np.isin([0, 1], axes), self.most, 0.0))


def open_gap(why: str, low: float = 0.0, high: float = math.inf) -> Unobserved:
    """A gap in which nothing bounds what there may be."""
    return Unobserved(why, low, high, np.array([low]), np.full((1, 2), math.inf))


def unseen_axes(axes: Sequence[str], why: str) -> tuple[Unobserved, ...]:
    """The gap of ``axes`` of the line of sight, ``x`` and ``y``, about which nothing is known."""
    most = np.array([[math.inf if axis in axes else 0.0 for axis in "xy"]])
    said = f"the line of sight is unknown about {' and '.join(axes)}: {why}"
    if axes:
        return (Unobserved(said, 0.0, math.inf, np.zeros(1), most),)
    return ()


class Sweep(Protocol):
    """A source whose lines pass ranges of frequencies together, such as a wheel with a range of
    speeds.
    """

    def worst(self, r: Requirement, figure: Callable[[Contribution], float]) -> Contribution:
        """Its lines where they are worst for a requirement, of which ``figure`` is the figure."""
        ...

    def swept(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Frequencies that each line passes, ascending (n,) [Hz], and amplitudes (n, 2)
        [rad].
        """
        ...


class SoughtLoads(NamedTuple):
    """Loads of each line that was sought in a recording, below its floors or not."""

    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    amplitude: np.ndarray
    """In the array's axes, (k, 6) [N, N m]."""
    floors: np.ndarray
    """Floors of the amplitudes, (k, 6)."""


@dataclass(frozen=True)
class Contribution:
    """Contribution of one source to the line of sight: lines, complex and 0-to-peak, and a one-sided
    density.
    """

    source: str
    how: str
    """Method of solution, in words."""
    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    los: np.ndarray
    """[rad], (k, 2)."""
    clock: str = ""
    """Sources of one clock: their lines of one frequency keep their phases to each other; empty
    where there is none.
    """
    unlocked: np.ndarray | None = None
    """Which lines are not the clock's, (k,): their phases to the others are those of one record;
    None where all are.
    """
    rings: np.ndarray | None = None
    """Which lines ring and die away, or are driven by noise, (k,): no part of the settled motion."""
    density: tuple[np.ndarray, np.ndarray] | None = None
    """Frequencies (n,) [Hz] and densities (n, 2) [rad^2/Hz]."""
    density_bounds: tuple[np.ndarray, np.ndarray] | None = None
    """Smallest and largest densities (n, 2) at these frequencies; None where they are known."""
    errors: tuple[SourceError, ...] = ()
    """Errors of a class without lines."""
    gaps: tuple[Unobserved, ...] = ()
    side: SideLines | None = None
    """Side lines that drives that turn may make of its lines and densities."""
    relative_error: float | np.ndarray = 0.0
    """Relative error of its amplitudes; of each, (k, 2), where they differ, and (2, k, 2) where
    less and more do.
    """
    frequency_error: np.ndarray | None = None
    """By how much its frequencies may be off [Hz], (k,), where that is more than clocks are."""
    crests: tuple[float, float, float] | None = None
    """Upper bound, for one of several alternatives, of the lines of any about x, about y and about both as
    required [rad], at any instant of a window; None where its own lines tell that."""
    phased: bool = True
    """Whether its lines have phases; those that have none keep none to each other, whatever is
    asked for.
    """
    spins: bool = False
    """Whether it is a wheel, whose spin momentum is not in the craft."""
    scenario: Scenario | None = None
    edge: HubEdge | None = None
    """Where the model of the hub ends that it acts on."""
    torque_spreads: Mapping[str, float] = field(default_factory=dict)
    """How far the drive's torque moves in each of its lines, by name, within the ranges that its sources
    note, to first order and over the line (``microvib.analysis.spread``); nan where that is not
    known."""
    ranges: str = ""
    """Sentence on these ranges; empty where no source notes one."""
    cases: np.ndarray | None = None
    """Amplitudes of its lines over the cases of a campaign, (cases, j, 2): the first k are those
    above, the others of lines that only cases have."""
    cases_frequency: np.ndarray | None = None
    """Their frequencies [Hz], (cases, j), where cases do not all have the nominal ones."""
    cases_lack: str = ""
    """Reason why the campaign's cases give no percentile, in words; no percentile is judged then."""
    recording: str = ""
    """Title of the recording that its loads are of; empty without one."""
    recorded: tuple[np.ndarray, np.ndarray] | None = None
    """Recorded loads of its lines on a fixed base, complex, and floors of their amplitudes, in the
    array's axes, (k, 6) [N, N m].
    """
    chain_assumption: str = ""
    """Assumption about the measuring chain of its recording, a sentence; empty where its filters are stated."""
    step_clock: float = 1.0
    """Step clock of a recording over the scenario's."""
    sought: SoughtLoads | None = None
    """Recorded loads of all lines that its status does not leave open, also of those that the floor hides."""
    alternatives: tuple[Contribution, ...] = ()
    """Where it is one of several, such as speeds of a wheel, all of them; the one that costs most
    counts.
    """
    sweep: Sweep | None = None
    """Search for the worst between the alternatives."""
    in_case: Callable[[int], Contribution] | None = None
    """Contribution on the craft of a case of a campaign, by its number among those that are drawn;
    None where it is the same in all. Of a drive with ``cases`` it tells the density alone."""

    @property
    def relative_errors(self) -> np.ndarray:
        """By which part each line may be smaller and larger about both axes, (2, k, 2)."""
        return np.broadcast_to(self.relative_error, (2, len(self.frequency), 2))

    @property
    def off(self) -> np.ndarray:
        """By how much its frequencies may be off [Hz], (k,)."""
        if self.frequency_error is None:
            return np.asarray(frequency_error_bound(self.frequency))
        return self.frequency_error

    @property
    def least_density(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The density as small as it may be."""
        if self.density is None or self.density_bounds is None:
            return self.density
        return self.density[0], self.density_bounds[0]

    @property
    def most_density(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The density as large as it may be."""
        if self.density is None or self.density_bounds is None:
            return self.density
        return self.density[0], self.density_bounds[1]

    @property
    def clocks(self) -> list[str]:
        """Clock to which each line keeps its phase; empty where it keeps none."""
        if self.unlocked is None:
            loose = np.zeros(len(self.names), dtype=bool)
        else:
            loose = self.unlocked
        return ["" if x else self.clock for x in loose.tolist()]

    @property
    def settled(self) -> np.ndarray:
        """Which lines belong to the settled motion, (k,)."""
        if self.rings is None:
            return np.ones(len(self.names), dtype=bool)
        return ~self.rings


def contribution_of_run(
    name: str,
    scenario: Scenario,
    result: RunResult,
    *,
    other_steps: bool = False,
    other_sticking: Sticking = MAY_STICK,
) -> tuple[Contribution, HubLines]:
    """A drive by its run on the craft, on which that of a second wing holds or, as is said, steps
    and may stick; and all lines of its loads.
    """
    source = result.state or result.motion
    assert source is not None
    found = hub_lines(source, result.table)
    assert found.los is not None
    rows = {line.name: line for line in result.table}
    own = [rows[name] for name in found.names]
    unknown = _unknown_reason(scenario, result)
    reasons = map(open_gap, filter(None, (unknown, _between_clock_lines(result))))
    states = drive_states(
        scenario, own=False, steps=other_steps, sticking=(MAY_STICK, other_sticking)
    )
    relative_error = _error_of_run(scenario, result, own, found.frequency, states)
    rings = np.array([name in (*found.rings, *found.driven) for name in found.names], dtype=bool)
    at_start = np.where(rings, _start_ratios(scenario, own, result.table.duration), 1.0)
    own_frequency = [0.0 if x.of_clock else x.frequency_uncertainty for x in own]
    return Contribution(
        name,
        "steady state of the coupled run" if result.state else "coupled run",
        found.names,
        found.frequency,
        np.nan_to_num(found.los) * at_start[:, None],
        unlocked=np.array([not x.of_clock for x in own], dtype=bool),
        rings=rings,
        density=line_of_sight_noise_spectrum(scenario),
        gaps=(*reasons, *_gaps(scenario, result.table, found, result.state is not None)),
        relative_error=np.maximum(relative_error, 1.0) if unknown else relative_error,
        frequency_error=frequency_error_bound(found.frequency, np.array(own_frequency)),
        scenario=scenario,
        torque_spreads={x.name: x.spread / x.amplitude for x in own if x.amplitude > 0.0},
        ranges=spread_sentence(result.table),
    ), found


def _unknown_reason(scenario: Scenario, result: RunResult) -> str:
    """Why it is not known how far the lines of a run are off; empty where it is."""
    broken = [name for drive in result.drives.values() for name in drive.table.broken]
    return failed_invariants_reason(broken, scenario) or unknown_error_reason(
        result.table, scenario
    )


def _error_of_run(
    scenario: Scenario,
    result: RunResult,
    lines: Sequence[Line],
    frequency: np.ndarray,
    states: DriveStates | None,
) -> np.ndarray:
    """Relative error of lines of a run, (2, k, 2), by all that it leaves open: ``states`` are those
    in which a second drive may be.
    """
    found = both_errors(
        _run_uncertainty(scenario, result.table, lines),
        _resonance_uncertainty(scenario, lines, frequency, states),
    )
    gap = None if result.state is not None else record_gap(scenario, result.table.duration)
    if gap is not None:
        found[0] = np.maximum(found[0], 1.0 - 1.0 / gap.overstated)
    return found


def both_errors(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Relative error of lines by two causes that act on them at once, (2, ...), less and more: a line
    that each may double may be four times as large.
    """
    less = 1.0 - np.maximum(1.0 - first[0], 0.0) * np.maximum(1.0 - second[0], 0.0)
    more = (1.0 + first[1]) * (1.0 + second[1]) - 1.0
    return np.array([less, more])


def _start_ratios(scenario: Scenario, lines: Sequence[Line], duration: float) -> np.ndarray:
    """Amplitudes at the start of the record over those of the lines, (k,): of what dies away; where
    the fit shows no decay, by the mode's damping.
    """
    decay = {mode.name: mode.decay for mode in coupled_modes(scenario)}
    found = np.ones(len(lines))
    for k, line in enumerate(lines):
        falls = line
        if line.status != "decaying":
            falls = replace(line, decay=decay.get(line.name, 0.0))
        if line.amplitude > 0.0:
            found[k] = falls.amplitude_at_start(duration) / line.amplitude
    return np.nan_to_num(found, nan=1.0)


def _between_clock_lines(result: RunResult) -> str:
    """Why lines of a steady state may be missing between those of the clock; empty where none can be.

    A motion that repeats only after several periods of the command has lines at all multiples of
    its own frequency. Those that are small in the torque are not listed, and may be large in the
    line of sight, next to a mode.
    """
    for drive in result.drives.values():
        if drive.state is None:
            continue
        command, _ = common_period(drive.state.scenario)
        if drive.state.microsteps > command:
            return (
                f"the steady motion repeats only every {drive.state.microsteps} microsteps, the command"
                f" every {command}: lines at other multiples of {drive.state.frequency:.3g} Hz are not"
                " in the sum (simulate in time, without a steady start)"
            )
    return ""


def _run_uncertainty(scenario: Scenario, table: LineTable, lines: Sequence[Line]) -> np.ndarray:
    """Relative error of lines of a run, (2, k, 2): of its integration, of what rings meanwhile, of a
    floor that hides them, and of lines of the clock that nothing in the drive makes, which noise or what
    rings takes the place of.
    """
    T, held = table.duration, HELD_DRIVE_UNCERTAINTY if require_craft(scenario).second else 0.0
    stirs = (
        x for x in table if x.status == NOISE_DRIVEN or (x.seen and may_ring(x, table, scenario))
    )
    rings = RINGING_FACTOR * sum(
        x.amplitude if x.status == NOISE_DRIVEN else x.amplitude_at_start(T) for x in stirs
    )
    size = np.maximum([x.amplitude for x in lines], 1e-300)
    hidden = np.array([x.hidden for x in lines])
    own = (
        np.array([amplitude_error_bound(x, table) for x in lines]) / size
    )  # of small lines, too, as the run's own verdict has it
    more = (
        own + held + np.minimum(rings / size, RINGING_FACTOR) + np.maximum(hidden / size - 1.0, 0.0)
    )
    dies_away = np.array([bool(ringing_reason(x, table, scenario)) for x in lines], dtype=bool)
    nothing_makes = np.array([not is_made(x.name, scenario) for x in lines], dtype=bool)
    less = np.where((hidden > 0.0) | dies_away | nothing_makes, 1.0, np.minimum(more, 1.0))
    return np.tile(np.nan_to_num([less, more])[:, :, None], 2)


def _resonance_uncertainty(
    scenario: Scenario, lines: Sequence[Line], frequency: np.ndarray, states: DriveStates | None
) -> np.ndarray:
    """Relative error of lines of the clock, (2, k, 2), by the response at frequencies that they may
    have, and by the ``states`` in which a second drive may be."""
    off = np.asarray(frequency_error_bound(frequency))
    found = drive_uncertainty(scenario, states, frequency, off)
    return found * np.array([line.of_clock for line in lines])[:, None]


def drive_uncertainty(
    scenario: Scenario, states: DriveStates | None, frequency: np.ndarray, off: np.ndarray
) -> np.ndarray:
    """Relative error of lines that a torque on the rotor makes, (2, k, 2), in a scenario of whose
    drives the ``states`` are not known, where frequencies (k,) [Hz] may be ``off`` (k,) [Hz].
    """
    responses: list[Callable[[np.ndarray], np.ndarray]] = [partial(los_per_rotor_torque, scenario)]
    if states is not None:
        responses.append(lambda f: states.extremes(f, states.on_rotor)[..., 0])
    return response_uncertainty(responses, frequency, off, natural_frequencies(scenario, states))


def los_per_rotor_torque(scenario: Scenario, f: np.ndarray) -> np.ndarray:
    """Line of sight by a torque on the rotor at frequencies (m,) [Hz], (m, 2) [rad/(N m)]."""
    return _by_torque(scenario, f)


def los_per_output_torque(scenario: Scenario, f: np.ndarray) -> np.ndarray:
    """Line of sight by a torque on the output at frequencies (m,) [Hz], (m, 2) [rad/(N m)]."""
    return _by_torque(scenario, f, coordinates(scenario.reducer, len(scenario.array.modes))[1])


def _by_torque(scenario: Scenario, f: np.ndarray, on: np.ndarray | None = None) -> np.ndarray:
    los = blocked_load_method(scenario, f, source_of(scenario).blocked(f, np.ones(f.size), on)).los
    assert los is not None
    return np.abs(los)


def natural_frequencies(scenario: Scenario, states: DriveStates | None = None) -> np.ndarray:
    """Natural frequencies of drive and spacecraft [Hz], also at the ends of ``states``."""
    own = [mode.frequency for mode in coupled_modes(scenario)]
    if states is None:
        return np.array(own)
    return np.concatenate([own, states.natural_frequencies[:, 0]])


_FREQUENCY_OFFSETS = np.linspace(-1.0, 1.0, 17)
"""Parts of what a frequency may be off at which responses are looked at, besides resonances."""


_NEAREST_MODES = 4
"""Resonances within what a frequency may be off that are looked at."""


def response_uncertainty(
    responses: Sequence[Callable[[np.ndarray], np.ndarray]],
    frequency: np.ndarray,
    off: np.ndarray,
    modes: np.ndarray,
) -> np.ndarray:
    """By which part lines may be smaller and larger since they, or the resonance beside them, may
    lie elsewhere.

    Parameters
    ----------
    responses : sequence of callable
        Sizes (k n, 2) of what lines move at frequencies (k n,) [Hz], n for each line, one line after another: first of what was
        run, then of what it may be instead, or several of these, (j, k n, 2).
    frequency, off : ndarray
        Frequencies [Hz], (k,), and by how much each may be off [Hz].
    modes : ndarray
        Natural frequencies [Hz], where responses are largest.

    Returns
    -------
    ndarray
        Relative error, (2, k, 2): less and more.
    """
    f = np.asarray(frequency, dtype=float)
    if not f.size:
        return np.zeros((2, 0, 2))
    order = np.argsort(np.abs(modes - f[:, None]), axis=1)[:, :_NEAREST_MODES]
    nearest = np.clip(modes[order].T, f - off, f + off).T
    at = np.column_stack([f, f[:, None] + off[:, None] * _FREQUENCY_OFFSETS, nearest])
    size = np.concatenate(
        [np.nan_to_num(each(at.ravel())).reshape(-1, *at.shape, 2) for each in responses]
    )
    size = np.concatenate([*size], axis=1)
    own = size[:, 0]
    ratio = np.divide(size, own[:, None], out=np.ones_like(size), where=own[:, None] > 0.0)
    return np.array([1.0 - ratio.min(axis=1), ratio.max(axis=1) - 1.0])


def with_side_lines_of_other(
    one: Contribution,
    lines: HubLines,
    scenario: Scenario,
    other: Scenario,
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
    name: str = " of the second wing",
) -> Contribution:
    """Lines and density of a drive, with what a second drive that steps makes of them.

    The hub's motion by a line turns the second rotor.

    Parameters
    ----------
    one : Contribution
        Lines of the first drive.
    lines : HubLines
        The same lines, with their loads on the hub.
    scenario, other : Scenario
        Of each drive, with the other's wing held.
    sticking : pair of Sticking
        Shafts of the first drive and of the other that may stick.
    name : str
        Of the other's wing, in words behind its shafts.
    """
    turning = _second_drive(scenario, other, sticking, name)
    if not turning.acts:
        return one
    hub = receiver_of(scenario)
    moves = _moves_hub(one, hub)
    at, coordinates = _motion_of_second_wing(one, lines, hub)
    width, norm = coordinates.shape[1], _norm_of_second_wing(turning, at, coordinates)
    torque = np.zeros(at.size)
    if turning.craft.springs or turning.craft.dampers:  # as if a torque on its rotor made each line
        by = np.maximum(np.abs(los_per_rotor_torque(scenario, at)).max(axis=1), 1e-300)
        torque = np.abs(one.los[moves]).max(axis=1) / by

    def motion(rows: np.ndarray) -> np.ndarray:
        """Motion along rows (r, n) of the coordinates by each line, (r, k)."""
        moved = np.abs(coordinates @ rows[:, -width:].T).T
        if not torque.any():
            return np.asarray(moved)
        unit = turning.craft.extremes(at, turning.craft.on_rotor, rows=rows)[1][:, :, 0]
        return np.maximum(moved, (unit * torque[:, None]).T)

    side = turning.of_motion(at, motion, norm)
    if side is not None:
        one = replace(one, side=side.joined(one.side))
    return with_side_density(one, scenario, turning)


def with_held_drive(
    one: Contribution, lines: HubLines, scenario: Scenario, sticking: Sticking
) -> Contribution:
    """Lines of a drive, with what the drive that holds the second wing makes of them: the hub's motion by a
    line may make its friction slide, part its teeth or swing its rotor. ``lines`` are the same with their
    loads on the hub, and ``sticking`` tells which shafts of the drive itself may stick.
    """
    hub = receiver_of(scenario)
    if hub.second is None or scenario.driven_wing is not None:
        return one
    turning = TurningDrives(scenario, (sticking, MAY_STICK))
    at, coordinates = _motion_of_second_wing(one, lines, hub)
    width, norm = coordinates.shape[1], _norm_of_second_wing(turning, at, coordinates)
    side = turning.of_held(at, lambda row: coordinates @ row[-width:], norm)
    return one if side is None else replace(one, side=side.joined(one.side))


def _norm_of_second_wing(
    turning: TurningDrives, frequency: np.ndarray, coordinates: np.ndarray
) -> float:
    """Norm for frictions that stick and slide in turn, of lines (k,) [Hz] that move the second wing's
    ``coordinates`` (k, w); 0 where none do.
    """
    if not turning.friction.switches:
        return 0.0
    on = turning.friction.on[-coordinates.shape[1] :]
    elongation = (coordinates @ on)[:, :, None]
    return float(turning.friction.norm_of_motion(frequency, elongation).sum())


def _moves_hub(one: Contribution, hub: Receiver) -> np.ndarray:
    """Which lines of a drive move the hub, (k,): all that are settled, but those that are too slow for a
    hub without attitude control.
    """
    return np.asarray(one.settled & ~hub.too_slow(one.frequency))


def _motion_of_second_wing(
    one: Contribution, lines: HubLines, hub: Receiver
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] of a drive's lines that move the hub (k,), and amplitudes of the second wing's
    coordinates by each (k, w), with its drive as linearised.
    """
    moves = _moves_hub(one, hub)
    at, loads = one.frequency[moves], np.nan_to_num(lines.loads[moves])
    assert hub.second is not None
    assert hub.second_root is not None
    there = -((2.0 * np.pi * at[:, None]) ** 2) * (
        np.einsum("mnk,mk->mn", hub.moved(at), loads) @ hub.second_root.T
    )
    return at, hub.second.coordinates_by_acceleration(at, there)


def _second_drive(
    scenario: Scenario, other: Scenario, sticking: tuple[Sticking, Sticking], name: str
) -> TurningDrives:
    """The second drive of a craft, ``other`` telling how it steps, of the wing with a ``name``."""
    both = drive_states(scenario, steps=True, sticking=sticking, turning=False)
    friction = DriveStates(scenario, ()) if both is None else both
    return TurningDrives(scenario, sticking, second=other, second_name=name, friction=friction)


def with_side_density(
    one: Contribution, scenario: Scenario, turning: TurningDrives, *, own: bool = False
) -> Contribution:
    """A drive's torque noise, with what drives that turn make of it at other frequencies; how it moves its
    ``own`` shafts is in its run.
    """
    if one.density is None:
        return one
    f, linear = one.density
    torque = density_of_friction(scenario, f)[:, None]
    side = turning.of_density(f, torque, turning.craft.on_output, linear)
    if side is None:
        return one
    if own:
        side = replace(side, shafts=())
    return replace(one, side=side.joined(one.side))


def with_side_lines_of_recording(recorded: Contribution, scenario: Scenario) -> Contribution:
    """Lines of a recording, with what the varying springs of the drives of a ``scenario`` make of the
    hub's motion by them.
    """
    if recorded.recorded is None:
        return recorded
    others = craft_of_drives(scenario, (SLIDES, MAY_STICK))  # its own friction is in the record
    turning = TurningDrives(scenario, friction=others)
    loads = recorded.recorded[0] @ rotation_to_hub_axes(scenario).T
    forces = turning.craft.on_interface @ loads[:, :, None]
    side = turning.of_lines(recorded.frequency, forces)
    if side is None:
        return recorded
    off = 1.0 + np.max(recorded.relative_errors[1], initial=0.0)
    others_shafts = tuple(one for one in side.shafts if one.shaft.wing)  # its own are in the record
    side = replace(side, shafts=others_shafts).times(off)
    return replace(recorded, side=side.joined(recorded.side))


def _gaps(
    scenario: Scenario, table: LineTable, found: HubLines, steady: bool
) -> Iterator[Unobserved]:
    """Gaps of a run with respect to the line of sight."""
    record = scenario.record
    yield from _slow_lines_gap(scenario, table)
    for line in table:
        if line.name in found.unknown and not steady and not mode_has_decayed(line, scenario):
            f = line.expected
            yield open_gap(
                f"{line.name} ({line.status}; a longer"
                f" record.duration{steady_start_advice(scenario)})",
                f,
                f,
            )
    for line in table:
        if line.status == "growing" and line.amplitude > _MIN_GROWING_RATIO * table.largest:
            yield open_gap(f"{line.name} grows within the record (increase record.settle)")
    if gap := record_gap(scenario, table.duration, steady=steady):
        yield open_gap(gap.why)
    for key, band in noise_bands(scenario).items():
        yield open_gap(
            f"{key} is propagated through the linearised drive without stiction; a run is a single"
            " noise draw",
            *band,
        )
    if scenario.rate is None:
        yield open_gap(
            "the rate changes within the record, so that there are no lines of the step clock"
        )
    if table.rest is None:
        yield open_gap("lines that are not in the table were not sought")
    elif table.rest.frequency.size:
        at = table.rest.frequency
        known = at >= receiver_of(scenario).lowest
        yield Unobserved(
            "unexplained peaks of T_d",
            0.0,
            math.inf,
            at[known],
            (_largest_los_over_torque(scenario, table.rest) * table.rest.in_sum[:, None])[known],
            between=True,
        )
    yield from _low_frequency_gaps(scenario, table)
    yield from above_passband_gaps(scenario, table, PASSBAND * record.sample_rate)


def _slow_lines_gap(scenario: Scenario, table: LineTable) -> tuple[Unobserved, ...]:
    """Gap of the drive's lines, expected or found, that are too slow for a hub without attitude control."""
    lines = {
        line.name: line.frequency
        for line in expected_in(scenario, scenario.record.sample_rate, table.harmonics)
    }
    lines |= {x.name: x.frequency for x in table if x.kind == "other" and x.frequency > 0.0}
    f = np.array([*lines.values()])
    slow = receiver_of(scenario).too_slow(f)
    first = next((name for name, of in zip(lines, slow, strict=True) if of), "")
    return low_frequency_gap(scenario, f, what=first)


_MIN_GROWING_RATIO = 0.01
"""Part of the largest line above which one that grows leaves everything open: nothing bounds its
multiples."""
_SIGNIFICANT_RATIO = 0.01
"""Part of the largest of some lines above the passband from which a record is to show them."""


def above_passband_gaps(scenario: Scenario, table: LineTable, top: float) -> Iterator[Unobserved]:
    """Bound on lines of the drive above ``top``, the edge of the passband of the lines in the
    ``table``.
    """
    if top < 2.0 * (scenario.driving_frequency or 0.0):
        few = ", where not even two driving lines are seen"
    else:
        few = ""
    found, reaches = [], dict[str, float]()
    for one in out_of_band_lines(scenario, table, top, math.inf):
        if not one.frequency.size:
            continue
        if one.on_output:
            by = los_per_output_torque(scenario, one.frequency)
        else:
            by = los_per_rotor_torque(scenario, one.frequency)
        with np.errstate(invalid="ignore"):
            most = np.where(by > 0.0, by * one.pull[:, None], 0.0)
        if (
            one.between and one.number is not None
        ):  # each stands for those beside it, no larger than it or its neighbours
            beside = np.pad(most, ((1, 1), (0, 0)), mode="edge")
            most = np.max([beside[:-2], most, beside[2:]], axis=0) * one.number[:, None]
        size = most.max(axis=1)
        counts = np.flatnonzero(size >= _SIGNIFICANT_RATIO * size.max())
        what = f"{one.what} at {one.frequency[0]:.4g} Hz"
        highest = float(one.frequency[counts[-1]]) + 0.5 * (scenario.driving_frequency or 0.0)
        reaches[what] = max(
            highest, reaches.get(what, 0.0)
        )  # what may act on either shaft is told once, for both
        found.append(
            (what, Unobserved("", top, math.inf, one.frequency, most, between=one.between))
        )
    for what, gap in found:
        remedy = f"record.sample_rate >= {rounded_up(reaches[what] / PASSBAND)} Hz"
        yield replace(gap, why=f"lines above {top:.4g} Hz{few}, such as {what} ({remedy})")


def _low_frequency_gaps(scenario: Scenario, table: LineTable) -> Iterator[Unobserved]:
    """Gap below the lowest frequency that a record's length resolves."""
    if table.rest is None or table.rest.slow <= 0.0 or not table.rest.frequency.size:
        return
    lowest = float(table.rest.frequency.min())
    f = np.geomspace(1e-3, 1.0, 31) * lowest
    most = los_over_torque(scenario, f) * ABOVE_PASSBAND_FACTOR * table.rest.slow
    known = f >= receiver_of(scenario).lowest
    why = (
        f"lines below {lowest:.3g} Hz, for which the record is too short (increase record.duration)"
    )
    k = int(np.argmax(np.hypot(*np.where(known[:, None], most, 0.0).T)))
    yield Unobserved(why, 0.0, lowest, f[[k]], most[[k]])


def _largest_los_over_torque(scenario: Scenario, rest: ResidualPeaks) -> np.ndarray:
    """The largest line of sight (m, 2) over T_d in each part of the spectrum in which something is
    left [rad/(N m)]: at its ends, in it, and at modes of the craft in it.
    """
    places = rest.places()
    modes = np.array([mode.frequency for mode in coupled_modes(scenario)])
    nearest = modes[np.argmin(np.abs(modes - rest.frequency[:, None]), axis=1)][:, None]
    low, high = places.min(axis=1, keepdims=True), places.max(axis=1, keepdims=True)
    places = np.hstack([places, np.clip(nearest, low, high)])
    found = los_over_torque(scenario, places.ravel())
    return np.asarray(found.reshape(*places.shape, 2).max(axis=1))


def los_over_torque(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """Line of sight (m, 2) over T_d, both made by the shaft's motion, at each ``frequency`` (m,)
    [Hz] [rad/(N m)].
    """
    craft = require_craft(scenario)
    torque = np.maximum(
        np.abs(craft.transfer(craft.loads(), frequency)[:, :, 0] @ craft.axis), 1e-300
    )
    return np.asarray(
        np.abs(craft.transfer(craft.line_of_sight(), frequency)[:, :, 0]) / torque[:, None]
    )


def low_frequency_gap(
    scenario: Scenario,
    low: np.ndarray,
    high: np.ndarray | None = None,
    *,
    what: str = "",
    remedy: str = "",
) -> tuple[Unobserved, ...]:
    """The gap of lines that reach below the lowest frequency at which the motion of a hub without
    attitude control means something; none where no line does.

    Parameters
    ----------
    scenario : Scenario
        A drive on its craft.
    low, high : ndarray
        Between which frequencies each line may be, (k,) [Hz]; without ``high`` it is at ``low``, as
        well as clocks are known.
    what : str
        What is there, in words; without it the source itself is meant.
    remedy : str
        What helps besides attitude control and a narrower requirement.
    """
    hub = receiver_of(scenario)
    slow = hub.too_slow(low)
    if not slow.any():
        return ()
    low = np.asarray(low, dtype=float)[slow]
    high = low if high is None else np.asarray(high, dtype=float)[slow]
    # A line that goes on above is known there, one that ends below may be off by its clock.
    ends = np.where(
        hub.too_slow(high), high + frequency_error_bound(high), np.nextafter(hub.lowest, 0.0)
    )
    said = ", ".join(filter(None, (what, _FREE_BODY_REASON)))
    *others, last = filter(None, (*_FREE_BODY_REMEDIES, remedy))
    helps = f"give {', '.join(others)}, or {last}"
    return (open_gap(f"{said} ({helps})", float(low.min()), float(ends.max())),)
