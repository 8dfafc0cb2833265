"""One integration in time, block by block: ``Simulation``; from rest, from a given state, and what
must have held.
"""

from __future__ import annotations

import math
import time as clock_time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microvib.errors import (
    ChannelError,
    SimulationError,
    SynchronismLost,
    did_you_mean,
    error_context,
)
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.solve import kernel
from microvib.solve.channels import CHANNELS, LINE_OF_SIGHT, MODAL
from microvib.solve.command import Command
from microvib.solve.motion import (
    INTERFACE_LOAD_CHANNELS,
    STEP_KEYS,
    InitialState,
    Invariants,
    Motion,
)
from microvib.solve.on_craft import (
    ACCELERATIONS,
    ANGLES,
    LINE_OF_SIGHT_ACCELERATIONS,
    line_of_sight_acceleration_weights,
)
from microvib.solve.pack import Packed, pack
from microvib.solve.sampling import (
    Decimator,
    SampleIntervals,
    max_driving_frequency,
    sample_buffer,
    sample_intervals,
)
from microvib.solve.vector import whole_lanes

Progress = Callable[[float, float], None]
CHUNK_TIME, CHUNK_STEPS = 16.0, 1_000_000
"""Simulated seconds between two reports of progress, and microsteps, at most."""
METHOD = "exact propagation of the linear part, with event location for friction"
BALANCE_MICROSTEPS, MAX_BALANCE_FRACTION = 16.0, 0.02
"""Microsteps over which the energies of a run of the torque alone are balanced, and the part of the
run that they are at most.
"""
SECOND_WING = "spacecraft.second_wing"
"""How sentences on a second wing's run begin."""
CHUNK_BYTES, CHUNK_ROWS = 4_000_000, 8192
"""Memory of the rows of one chunk of a record, what stays in a processor's reach; of many modes
rather so many rows, if they take no more than MOST_BYTES."""
MAX_CHUNK_BYTES = 8 * CHUNK_BYTES


def simulate_from_rest(
    scenario: Scenario,
    *,
    progress: Progress | None = None,
    channels: tuple[str, ...] | None = None,
    balanced: bool = True,
) -> Motion:
    """``simulate`` from rest at t = 0, whatever ``record.start`` says; not ``balanced``, invariants
    are those of the record.
    """
    if keeps_hub_motion(channels):
        other = scenario.driven_wing
    else:
        other = None
    if other is None:
        first, second = (progress, None)
    else:
        first, second = split_progress(progress)
    run = Simulation(scenario, progress=first, channels=channels, balanced=balanced)
    motion = record_motion(run)
    if other is None:
        return motion
    with error_context(SECOND_WING):
        return replace(
            motion,
            second_wing=simulate_from_rest(
                other, progress=second, channels=channels, balanced=balanced
            ),
        )


def keeps_hub_motion(channels: tuple[str, ...] | None) -> bool:
    """Whether the hub's motion follows from the ``channels`` that are kept."""
    return channels is None or any(
        set(made) <= set(channels) for made in (ACCELERATIONS, LINE_OF_SIGHT_ACCELERATIONS)
    )


def record_motion(run: Simulation) -> Motion:
    """All of a simulation as a motion."""
    record, blocks = run.scenario.record, list(run)
    joined = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    t = record.settle + np.arange(record.samples) / record.sample_rate
    return Motion(run.scenario, t, joined, run.invariants, run.solver, run.beginning)


def split_progress(progress: Progress | None) -> tuple[Progress | None, Progress | None]:
    """The ``progress`` of two runs one after the other."""
    if progress is None:
        return None, None
    return (lambda done, total: progress(done, 2.0 * total)), (
        lambda done, total: progress(total + done, 2.0 * total)
    )


def rerun_refined(
    scenario: Scenario, beginning: InitialState, finer: int, duration: float
) -> np.ndarray:
    """T_d [N m] over the first ``duration`` [s] of a record, from where a run began, with steps
    ``finer`` times finer.

    Nothing else is sampled.

    Raises SimulationError as ``simulate`` does.
    """
    changed = scenario.with_si(
        {"solver.refinement": finer * scenario.solver.refinement, "record.duration": duration}
    )
    packed = pack(changed)
    own = packed.state.y, packed.state.stick, packed.state.clock, packed.state.levels
    for mine, given in zip(
        own, np.split(beginning.state, np.cumsum([x.size for x in own[:-1]])), strict=True
    ):
        mine[:] = given
    run = Simulation(changed, packed=packed, command=beginning.command, torque_only=True)
    return np.concatenate([block["T_d"] for block in run])


@dataclass
class _TorqueSums:
    """Sums over the torque alone, chunk by chunk; the record is rows ``start`` to ``stop``."""

    start: int
    stop: int
    stuck: float = 0.0
    """Rows of the record in which the output sticks."""
    largest: float = 0.0
    """[N m]"""

    def add(self, T_d: np.ndarray, output: np.ndarray, done: int) -> None:
        """Count rows from the number ``done`` on."""
        own = output[max(self.start - done, 0) : max(self.stop - done, 0)]
        self.stuck += float(np.sum(own))
        self.largest = max(self.largest, float(np.max(np.abs(T_d))))


def _check_channels(scenario: Scenario, channels: tuple[str, ...] | None) -> None:
    """ChannelError where a channel cannot be kept."""
    if isinstance(channels, str):
        raise ChannelError(
            f"channels: a list of names is expected, such as ('T_d',), not the text {channels!r}"
        )
    craft = scenario.craft
    looks = craft is not None and craft.spacecraft.line_of_sight is not None
    known = (*CHANNELS, *MODAL, *(LINE_OF_SIGHT_ACCELERATIONS if looks else ()))
    for name in channels or ():
        if name in known:
            continue
        if name in (*COMPONENTS, *LINE_OF_SIGHT):
            needed = INTERFACE_LOAD_CHANNELS if craft is None else (*ACCELERATIONS, *ANGLES)
            raise ChannelError(f"channel '{name}' is made of others; keep {', '.join(needed)}")
        near = did_you_mean(name, known)
        raise ChannelError(
            f"channel '{name}' does not exist; {near}available channels: {', '.join(known)}"
        )


def _line_of_sight_weights(scenario: Scenario, channels: Sequence[str]) -> np.ndarray | None:
    """Weights of the channels in what the line of sight does; None where that is not kept."""
    craft = scenario.craft
    if craft is None or not set(channels) & set(LINE_OF_SIGHT_ACCELERATIONS):
        return None
    return line_of_sight_acceleration_weights(craft, tuple(CHANNELS))


class Simulation:
    """One simulation as a stream of blocks ``{channel: samples}``; invariants are known when it is
    through.

    It starts at rest at t = 0, or goes on from the state ``packed`` at its time, under ``command``.
    """

    invariants: Invariants
    solver: dict[str, Any]
    beginning: InitialState
    stuck_output: float
    momentum: float

    def __init__(  # noqa: PLR0913 - keyword options
        self,
        scenario: Scenario,
        *,
        progress: Progress | None = None,
        channels: tuple[str, ...] | None = None,
        packed: Packed | None = None,
        command: Command | None = None,
        torque_only: bool = False,
        balanced: bool = True,
    ) -> None:
        """With ``torque_only`` nothing but ``T_d`` is sampled, which takes a fraction of the time;
        then there are no invariants, but ``stuck_output`` and ``momentum`` (see
        ``microvib.solve.batch.Torque``). Not ``balanced``, nothing is until the record begins, and
        invariants are those of the record."""
        self.scenario = scenario
        self._progress = progress or (lambda done, total: None)
        _check_channels(scenario, channels)
        self._wanted = channels or None
        self.packed = packed or pack(scenario)
        self._of_states = _line_of_sight_weights(scenario, channels or ())
        self._torque_only, self._balanced = torque_only, balanced
        self._command, self._known_until = command or Command(scenario), -math.inf
        self._chunk = min(CHUNK_TIME, CHUNK_STEPS / max(max_driving_frequency(scenario), 1.0))

    def __iter__(self) -> Iterator[dict[str, np.ndarray]]:
        begun = clock_time.perf_counter()
        samples, packed = self.scenario.record.samples, self.packed
        start = float(packed.state.clock[kernel.NOW])
        self.beginning = self.initial_state
        intervals = sample_intervals(self.scenario, start)
        self._factor = intervals.factor
        self._progress(start, intervals.end)
        before, momentum_before = packed.snapshot(), packed.momentum
        reached = self._advance_to_record(intervals, start)
        if not self._balanced:
            before, momentum_before, start = packed.snapshot(), packed.momentum, reached
            packed.state.clock[kernel.IMPULSE], packed.state.energy[:] = 0.0, 0.0
        lead = round((self.scenario.record.settle - intervals.first) / intervals.width)
        torque = _TorqueSums(lead, lead + self._factor * samples)
        made = 0
        for whole in self._blocks(intervals, torque):
            block = whole[: samples - made]
            made += block.shape[0]
            if block.shape[0]:
                yield {"T_d": block[:, 0]} if self._torque_only else self._name(block)
            if made >= samples:
                break
        if self._torque_only:
            lost = packed.momentum - momentum_before + float(packed.state.clock[kernel.IMPULSE])
            self.stuck_output = torque.stuck / (torque.stop - torque.start)
            self.momentum = 0.0
            if torque.largest > 0.0:
                self.momentum = abs(lost) / (torque.largest * (intervals.end - start))
            return
        span = intervals.end - start
        self.invariants = compute_invariants(packed, before, momentum_before, span)
        self._finish(span, clock_time.perf_counter() - begun)

    def _advance_to_record(self, intervals: SampleIntervals, start: float) -> float:
        """Go on from ``start`` to the first interval of the record [s], and say where that is."""
        packed, t = self.packed, start
        if self._torque_only or not self._balanced:
            silent = np.zeros((0, packed.torque_columns))
        else:
            silent = np.zeros((0, packed.columns))
        while t < intervals.first:
            t = self._advance(
                min(t + self._chunk, intervals.first),
                intervals.end,
                sample_buffer(silent, intervals.first, intervals.width),
            )
        return t

    def _blocks(self, intervals: SampleIntervals, torque: _TorqueSums) -> Iterator[np.ndarray]:
        """Samples of the record and beyond, (n, columns), chunk by chunk without end."""
        packed, width, first = self.packed, intervals.width, intervals.first
        mix = self._mix()
        columns = self._columns(mix)
        decimator = Decimator(self._factor)
        # As long whatever is kept, since a step ends where a chunk does.
        per_chunk = chunk_rows(
            columns if self._torque_only else packed.columns, math.ceil(self._chunk / width)
        )
        # Channels are picked before they are filtered, which takes its time.
        picks = self._wanted is not None and mix is None and not self._torque_only
        # Where rows are filtered as they are, they are written where the filter takes them.
        selected = self._torque_only or picks or columns != whole_lanes(columns)
        buffer = np.zeros((per_chunk if selected else 0, columns))
        samples = sample_buffer(buffer[:0], first, width, mix)
        done = 0
        while done < intervals.rows:
            count = min(per_chunk, intervals.rows - done)
            missing = 0 if done else intervals.missing
            if selected:
                rows = buffer[:count]
            else:
                rows = decimator.room(missing + count, columns)[missing:]
            samples = samples._replace(rows=rows)
            samples.cursor[:] = 0, done
            self._advance(first + (done + count) * width, intervals.end, samples)
            assert samples.cursor[0] == count
            if self._torque_only:
                T_d, output = packed.torque_of(rows)
                torque.add(T_d, output, done)
                rows = T_d[:, None]
            elif picks:
                rows = self._picked(rows[:, : packed.channels], self._wanted or ())
            room = decimator.room(missing + count, rows.shape[1])
            if selected:
                room[missing:, : rows.shape[1]] = rows
            room[:missing] = room[missing]
            done += count
            yield decimator.filtered()
        while True:
            yield decimator.end()

    def _columns(self, mix: np.ndarray | None) -> int:
        """Columns of the rows that the kernel fills."""
        if self._torque_only:
            return self.packed.torque_columns
        if mix is None:
            return self.packed.columns
        return whole_lanes(len(mix))

    @property
    def initial_state(self) -> InitialState:
        """Where it begins, before it has begun."""
        x = self.packed.state
        return InitialState(np.concatenate([x.y, x.stick, x.clock, x.levels]), self._command)

    def balance_after(self) -> Invariants | None:
        """Invariants of the motion that follows for some microsteps, at most SHORT of what was
        simulated; None where it stops.

        A run of the torque alone, which has no energies, is so checked at a small part of its cost.
        """
        packed, clock = self.packed, self.packed.state.clock
        start, f_d = float(clock[kernel.NOW]), self.scenario.driving_frequency
        if not f_d:
            span = MAX_BALANCE_FRACTION * start
        else:
            span = min(MAX_BALANCE_FRACTION * start, BALANCE_MICROSTEPS / f_d)
        packed.state.energy[:] = 0.0
        clock[[kernel.IMPULSE, kernel.MISMATCH, kernel.LARGEST]] = 0.0
        before, momentum_before = packed.snapshot(), packed.momentum
        self._progress = lambda done, total: None
        try:
            self._advance(
                start + span,
                start + span,
                sample_buffer(np.zeros((0, packed.columns)), start, span),
            )
        except SimulationError:
            return None
        return compute_invariants(packed, before, momentum_before, span)

    def _advance(self, stop: float, end: float, samples: Any) -> float:
        clock = self.packed.state.clock
        now = float(clock[kernel.NOW])
        if stop > self._known_until:
            self._known_until = max(stop, now + self._chunk)
            self._microsteps = self._command.microsteps(now, self._known_until)
        times, references = self._microsteps
        due = slice(*np.searchsorted(times, [now, stop]))
        status = self.packed.advance(stop, samples, times[due], references[due])
        now = float(clock[kernel.NOW])
        if status != kernel.OK:
            raise status_error(self.scenario, status, now)
        self._progress(stop, end)
        return stop

    def _picked(self, rows: np.ndarray, wanted: tuple[str, ...]) -> np.ndarray:
        """Kept columns of the kernel's rows (n, channels), or combinations of them."""
        block = channels_of(rows, self.packed.drive.H.size)
        if self._of_states is not None:
            block |= dict(zip(LINE_OF_SIGHT_ACCELERATIONS, self._of_states.T @ rows.T, strict=True))
        return np.vstack([block[name].T for name in wanted]).T

    def _mix(self) -> np.ndarray | None:
        """Wanted outputs as sums of the channels (wanted, channels); None where propagators do not
        make them (``Packed.mixes``).
        """
        packed = self.packed
        if self._wanted is None or set(self._wanted) & set(MODAL):
            return None
        mix = np.zeros((len(self._wanted), packed.channels))
        for row, name in zip(mix, self._wanted, strict=True):
            if name in CHANNELS:
                row[list(CHANNELS).index(name)] = 1.0
            elif self._of_states is not None:
                row[:] = self._of_states[:, LINE_OF_SIGHT_ACCELERATIONS.index(name)]
        if packed.mixes(mix):
            return mix
        return None

    def _name(self, samples: np.ndarray) -> dict[str, np.ndarray]:
        modes = self.packed.drive.H.size
        if self._wanted is None:
            whole = channels_of(samples[:, : self.packed.channels], modes)
            return {name: np.ascontiguousarray(x) for name, x in whole.items()}
        ends = np.cumsum([modes if name in MODAL else 1 for name in self._wanted])
        parts = zip(self._wanted, np.split(samples[:, : ends[-1]], ends[:-1], axis=1), strict=True)
        return {name: np.ascontiguousarray(x if name in MODAL else x[:, 0]) for name, x in parts}

    def _finish(self, simulated: float, seconds: float) -> None:
        count = self.packed.state.counters
        self.solver = {
            **method_of(self.scenario),
            "steps": int(count[kernel.STEPS]),
            "rejected_steps": int(count[kernel.REJECTED]),
            "event_location_steps": int(count[kernel.EVENT_STEPS]),
            "iterations": int(count[kernel.ITERATIONS_MADE]),
            "microsteps": math.ceil(
                int(count[kernel.MICROSTEPS]) / len(self.scenario.driver.shape.after)
            ),
            "sticks": int(count[kernel.STICKS]),
            "breakaways": int(count[kernel.BREAKAWAYS]),
            "sampling": (
                f"interval means at {self._factor} x the sample rate, then a linear-phase filter,"
                " flat within 1e-4 to"
                f" {PASSBAND} x the sample rate"
            ),
            "simulated_s": simulated,
            "wall_s": seconds,
            "times_real_time": simulated / seconds,
        }
        if self.scenario.driver.pulsed:
            of_steps = kernel.STEPS_JUDGED, kernel.STEPS_LOST, kernel.STEPS_GAINED
            made = [int(count[k]) for k in (*of_steps, kernel.FIRST_NOT_MADE)]
            self.solver |= dict(zip(STEP_KEYS, made, strict=True))


def chunk_rows(columns: int, longest: int) -> int:
    """Rows of one chunk, at most as many as the ``longest`` has."""
    row = 8 * columns
    return min(max(CHUNK_BYTES // row, min(CHUNK_ROWS, MAX_CHUNK_BYTES // row), 512), longest)


def method_of(scenario: Scenario) -> dict[str, Any]:
    """The method of integration and its settings, as a report says them."""
    solver = scenario.solver
    return {
        "method": METHOD,
        "accuracy": solver.accuracy,
        "max_step_s": solver.max_step,
        "refinement": solver.refinement,
    }


def compute_invariants(
    packed: Packed, before: np.ndarray, momentum_before: float, span: float
) -> Invariants:
    """Invariants over the last ``span`` [s], since the snapshot ``before`` and its
    angular momentum [N m s].
    """
    state = packed.state
    change = packed.snapshot() - before
    stored = float(np.sum(change[kernel.ENERGIES : kernel.POWERS]))
    energy_in, joule, friction, damping = (float(e) for e in state.energy)
    dissipated = joule + friction + damping
    residual = abs(energy_in - stored - dissipated)
    passed = max(
        abs(energy_in - joule) + friction + damping, 1e-9 * energy_in
    )  # nothing passes a drive that holds
    unbalanced = float(abs(packed.momentum - momentum_before + state.clock[kernel.IMPULSE]))
    torque = float(state.clock[kernel.LARGEST])
    return Invariants(
        torque_forms=float(state.clock[kernel.MISMATCH]) / torque if torque > 0.0 else 0.0,
        momentum=unbalanced / (torque * span) if torque > 0.0 else 0.0,
        energy=residual / energy_in if energy_in > 0.0 else 0.0,
        energy_mechanical=residual / passed if passed > 0.0 else 0.0,
        energy_in=energy_in,
        energy_dissipated=dissipated,
        energy_stored=stored,
    )


_CROSSING_SHORTER = 0.01
"""Part of the longest step that is advised where the gear crosses its backlash within one."""


_FINER = 2
"""Factor of the refinement that is advised where a run stops."""


def status_error(scenario: Scenario, status: int, now: float) -> SimulationError:
    """Sentence for the user on a status of the kernel at the time ``now`` [s]."""
    if status == kernel.LOST_SYNCHRONISM:
        return SynchronismLost(_synchronism_lost_message(scenario, now), now)
    if status == kernel.ENDLESS_EVENTS:
        return SimulationError(
            f"simulation stopped at t = {now:.6g} s: a friction sticks and breaks away without end;"
            f" set solver.refinement to {_FINER * scenario.solver.refinement:g}, or, where that does not help, as its"
            " law has no solution there, vary friction.position, or what presliding, hysteresis or backlash"
            " there is, more slowly with the angle"
        )
    if status == kernel.NOT_FINITE:
        what = "the solution is not finite"
    elif scenario.reducer.backlash:
        shorter = 1e6 * _CROSSING_SHORTER * scenario.solver.max_step
        return SimulationError(
            f"simulation stopped at t = {now:.6g} s: the gear crosses its backlash within one step;"
            f" set solver.max_step to {shorter:.3g} us or less"
        )
    else:
        what = "the step became too small"
    return SimulationError(
        f"simulation stopped at t = {now:.6g} s: {what}; set solver.refinement to"
        f" {_FINER * scenario.solver.refinement:g}, or check the orders of magnitude of the drive's parameters"
    )


def _synchronism_lost_message(scenario: Scenario, now: float) -> str:
    times, rates = scenario.tracking.breakpoints()
    rate = float(np.interp(now, times, rates))
    f_d = scenario.driver.driving_frequency(scenario.motor, scenario.reducer.ratio * rate)
    return (
        f"loss of synchronism at t = {now:.4g} s: the rotor is half an electrical period away from"
        " its commanded angle, at a commanded array"
        f" rate of {np.degrees(rate):.4g} deg/s ({f_d:.4g} microsteps per second); lower"
        " tracking.rate, ramp up to it, or raise"
        " motor.current"
    )


def channels_of(rows: np.ndarray, modes: int) -> dict[str, np.ndarray]:
    """Rows of the kernel (n, channels) by name; its powers come out as energies, modal channels are
    (n, modes).
    """
    named = {name: rows[:, k] for k, name in enumerate(CHANNELS)}
    named["eta"] = rows[:, kernel.N_CHANNELS : kernel.N_CHANNELS + modes]
    named["eta_rate"] = rows[:, kernel.N_CHANNELS + modes :]
    return named
