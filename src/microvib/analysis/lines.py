"""From motion to lines: the scenario says which lines to expect, the samples say what is there.

Everything that asks for the lines of a torque asks here: of a motion, a steady state, samples or a
recording. Lines are expected up to the edge of the record's passband, ``model.record.PASSBAND``;
``signals.line_fit`` estimates them in samples and ``signals.fourier_lines`` reads them off a
Fourier series.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from microvib.analysis.accuracy import ErrorOfIntegration
from microvib.analysis.spectra import SAMPLED, samples_of
from microvib.analysis.spread import with_spread
from microvib.analysis.start import (
    full_step_time,
    has_decayed,
    may_still_ring,
    time_to_settle,
    with_full_steps,
)
from microvib.analysis.steadiness import steadiness_notes, with_excess
from microvib.analysis.usable import force_table_notes, with_force_table
from microvib.errors import OptionError, expect_channel, whole_number
from microvib.model.driven import (
    NoiseDrivenLine,
    noise_bands,
    noise_bin_amplitude,
    noise_density,
    noise_driven_lines,
)
from microvib.model.expected import ExpectedLine, expected_lines
from microvib.model.line_names import UNLISTED, LineName, driving_line
from microvib.model.linear import coupled_modes, sliding_growth
from microvib.model.record import PASSBAND, Start
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import (
    GivenScenario,
    Scenario,
    as_scenario,
    stands_for_scenario,
    with_start,
)
from microvib.model.slow_variations import slow_variations
from microvib.signals.clock import near_mains, search_wide_clock_ratio
from microvib.signals.fourier_lines import lines_of_series, order_of
from microvib.signals.intermittent import LOUDER, intermittent_peaks, peaks_of_period
from microvib.signals.line_fit import (
    NOT_SEPARABLE,
    SEPARATION,
    estimate_lines,
    lines_at_known_clock,
    with_background,
)
from microvib.signals.line_table import (
    BELOW_FLOOR,
    DISTORTED,
    NOISE_DRIVEN,
    Line,
    LineTable,
    ResidualPeaks,
)
from microvib.signals.tones import HannSpectrum
from microvib.solve.batch import Torque, torque_from_rest
from microvib.solve.integration import Progress, method_of, simulate_from_rest
from microvib.solve.motion import (
    SECOND_RUN_CHANNELS,
    Invariants,
    Motion,
    scalar_channel,
    unit_of,
)
from microvib.solve.steady.state import SteadyState, find_steady
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel
from microvib.units import Si

CLOCK_TOLERANCE, MODE_TOLERANCE = 0.02, 0.1
"""Parts of their frequencies by which lines of the clock and array modes of a measured torque may
be off.
"""
SIGNIFICANT_RATIO = 0.1
"""Part of the clock's largest line from which an unlisted line is not small."""
MAX_CLOCK_OFFSET = 1.1 * CLOCK_TOLERANCE
"""Part by which the clock of a measured torque may be off: its lines' bands reach a few bins
further.
"""
HARMONICS_RANGE = 0, 10_000
"""Allowed number of lines in a family."""
_MIN_SAMPLES = 128
"""Samples of a recording from which lines have a noise floor: bins 4 to 20 away on either side."""
_JUDGED_DURATION = 2.0
"""Length of a recording [s] from which verdicts are given on it, whichever lines it resolves."""


@dataclass(frozen=True)
class Steady:
    """Lines at constant rate, from the steady state or, where ``fallback`` says why not, from time
    integration.
    """

    lines: LineTable
    source: SteadyState | Torque
    fallback: str = ""

    def __repr__(self) -> str:
        return (
            f"{self.source!r}{f', since {self.fallback}' if self.fallback else ''}\n{self.lines!r}"
        )

    @property
    def state(self) -> SteadyState | None:
        """The steady state, if there is one."""
        if isinstance(self.source, SteadyState):
            return self.source
        return None

    @cached_property
    def invariants(self) -> Invariants:
        """Invariants; the motion is run once more for them, with all channels."""
        if isinstance(self.source, SteadyState):
            return self.source.invariants
        return simulate_from_rest(self.source.scenario, channels=("T_d",)).invariants

    @property
    def solver(self) -> dict[str, Any]:
        """How it was solved."""
        if isinstance(self.source, SteadyState):
            return self.source.solver
        return {**method_of(self.source.scenario), "steps": self.source.steps}


def steady_lines(
    scenario: GivenScenario,
    *,
    harmonics: int = 8,
    confirmed: bool = False,
    full_steps: int = 0,
    progress: Progress | None = None,
) -> Steady:
    """Lines of the disturbance torque of ``scenario`` in its steady state, without simulating how
    it settles.

    It is the steady state that a start from rest leads to; ``confirmed``, by a run that is waited
    for until it has arrived there. Where there is none, the scenario is simulated in time instead,
    and ``fallback`` says why; its record is made longer where it holds fewer ``full_steps`` and that
    takes little (``with_full_steps``). Raises what ``simulate`` raises.
    """
    scenario = as_scenario(scenario)
    whole_number("harmonics", harmonics, *HARMONICS_RANGE)
    state, why = find_steady(
        scenario, whole=False, confirmed=confirmed
    )  # of T_d, which is the first drive's
    source = state or torque_from_rest(
        with_full_steps(scenario, full_steps), progress, balanced=True
    )
    return Steady(find_lines(source, harmonics=harmonics), source, why)


def find_lines(
    source: GivenScenario | Motion | SteadyState | Steady | Torque | Recording,
    channel: str = "",
    harmonics: int = 8,
    *,
    start: Start | None = None,
    scenario: GivenScenario | None = None,
    every_order: bool = False,
) -> LineTable:
    """Find every line that the physics predicts in the disturbance torque, and all others above
    the noise floor: named, with frequency, amplitude and phase.

    Of a steady state lines are exact; of samples they are estimated
    (``microvib.signals.line_fit``). What is looked for follows from the scenario
    (``microvib.model.expected``). How far simulated lines are off by the integration is found when
    a verdict first asks (``judge``), by runs with finer steps.

    Parameters
    ----------
    source : Scenario, str, path, Motion, SteadyState or Recording
        Where lines are found. A scenario, or its name, is simulated: from rest, or in its steady
        state, without waiting for it to settle.
    channel : str, optional
        Any channel that is one value at a time, or a load on the spacecraft, ``"Fx"`` to ``"Mz"``,
        of an array with participation in six components. Without it, it is T_d, or the torque
        about the drive axis in a recording.
    harmonics : int
        Members of each family of lines that are looked for.
    start : {"rest", "steady"}, optional
        Of a scenario: how its motion begins. Without it, as ``record.start`` says. Where there is
        no steady state the scenario is simulated from rest, and ``table.source`` says why.
    scenario : Scenario, str or path, optional
        Of a recording: the drive that was measured. Its clock is then searched within
        CLOCK_TOLERANCE. Without it, lines above the noise floor are found and not named.
    every_order : bool
        Of a recording of a ``scenario``: add a row for each further order of the electrical period
        at which a line stands above the floor, as errors make them that the scenario does not have.

    Returns
    -------
    LineTable
        Lines by name: frequencies [Hz], amplitudes, 0-to-peak, in the unit of the channel
        (``table.unit``, also where columns of its files end in ``n_m``), phases [rad].

    Raises
    ------
    ChannelError
        For a channel that the source has not, or that is not one value at a time.
    OptionError
        For ``harmonics`` out of their range, and a ``start`` or ``scenario`` of what has its own.
    SimulationError
        What ``simulate`` raises, of a scenario.

    Examples
    --------
    >>> import microvib as mv
    >>> table = mv.find_lines("state-1", start="steady")
    >>> print(f"{table['drive_1'].frequency:.4f} Hz")
    53.0133 Hz
    """
    expect_channel(channel)
    whole_number("harmonics", harmonics, *HARMONICS_RANGE)
    if every_order and not (isinstance(source, Recording) and scenario is not None):
        raise OptionError("every_order", "applies to a recording of a scenario")
    if stands_for_scenario(source):
        source, why = _solve(with_start(as_scenario(source), start), channel)
        table = find_lines(source, channel, harmonics)
        return replace(table, source=f"{table.source}{why}")
    if start is not None:
        raise OptionError(
            "start", "applies to a scenario; this source is already simulated or recorded"
        )
    if isinstance(source, Steady):
        source = source.source
    if isinstance(source, SteadyState) and _adds_second_drive(source.scenario, channel):
        source = source.motion()  # of two drives, which have no period in common
    if isinstance(source, SteadyState):
        return lines_of_steady_state(source, channel or "T_d", harmonics)
    if isinstance(source, Recording):
        guide = None if scenario is None else as_scenario(scenario)
        return _of_recording(source.in_si(), channel, harmonics, guide, every_order)
    return lines_of_motion(source, channel or "T_d", harmonics)


def lines_of_motion(source: Motion | Torque, channel: str, harmonics: int) -> LineTable:
    """Lines of a ``channel`` of a simulated motion, as ``find_lines``."""
    x, rate, unit = samples_of(source, channel, f"a scenario, a steady state, {SAMPLED}")
    scenario = source.scenario
    expected = expected_in(scenario, rate, harmonics)
    table = simulated_lines(x, rate, scenario, expected, disturbance=channel == "T_d")
    if isinstance(source, Torque):
        broken = source.broken
    else:
        broken = source.invariants.broken
    return replace(
        table,
        unit=unit,
        source=f"{channel} of {scenario.brief}",
        harmonics=harmonics,
        broken=broken,
        find_error=ErrorOfIntegration(source, channel == "T_d"),
    )


def _adds_second_drive(scenario: Scenario, channel: str) -> bool:
    """Whether the second wing's drive adds to a channel, as it does to what the hub feels."""
    return scenario.driven_wing is not None and channel in SECOND_RUN_CHANNELS


def _solve(scenario: Scenario, channel: str) -> tuple[Motion | SteadyState, str]:
    """The steady state of a scenario that starts in it, if there is one; else its motion, and why
    there is none.
    """
    torque_alone, why = channel in ("", "T_d"), ""
    if scenario.record.start == "steady":
        state, reason = find_steady(scenario, whole=not torque_alone)
        if state is not None:
            return state, ""
        why = f" (from rest, because there is no steady state: {reason})"
    return simulate_from_rest(scenario, channels=("T_d",) if torque_alone else None), why


def _of_recording(
    recording: Recording,
    channel: str,
    harmonics: int,
    scenario: Scenario | None,
    every_order: bool,
) -> LineTable:
    """Lines of a recording in SI units."""
    name = channel or f"M{scenario.array.drive_axis if scenario else 'z'}"
    require_usable_channel(recording, name, shortest_record(recording, scenario, harmonics))
    table = _measured_lines(
        recording[name], recording.sample_rate, scenario, harmonics, every_order=every_order
    )
    table = replace(table, unit=recording.units[name], source=f"{name} of {recording.name}")
    return with_force_table(table, recording, name)


def lines_of_samples(
    x: np.ndarray, sample_rate: float, scenario: Scenario | None, harmonics: int = 8, *, measured: bool = False,
    disturbance: bool = True,
) -> LineTable:  # fmt: skip
    """Lines of a torque ``x`` (n,) [N m] at ``sample_rate`` [Hz], which need not be that of the
    ``scenario``'s record.

    The clock of a simulated torque is the scenario's. That of a ``measured`` one is searched within
    CLOCK_TOLERANCE, its array modes within MODE_TOLERANCE. Without a scenario, those above the floor
    are found and not named. What noise alone gives a line is known of the ``disturbance`` torque.
    """
    if measured:
        return _measured_lines(x, sample_rate, scenario, harmonics, disturbance=disturbance)
    if scenario is None:
        return replace(estimate_lines(x, sample_rate, ()), harmonics=harmonics)
    expected = expected_in(scenario, sample_rate, harmonics)
    table = simulated_lines(x, sample_rate, scenario, expected, disturbance)
    return replace(table, harmonics=harmonics)


def _measured_lines(
    x: np.ndarray,
    sample_rate: float,
    scenario: Scenario | None,
    harmonics: int,
    *,
    disturbance: bool = True,
    every_order: bool = False,
) -> LineTable:
    """``lines_of_samples`` of a measured torque; ``every_order`` as in ``find_lines``."""
    expected = () if scenario is None else expected_in(scenario, sample_rate, harmonics, True)
    table = estimate_lines(x, sample_rate, expected, every_order)
    table = _refit_clock(table, x, sample_rate, expected, every_order)
    table = replace(with_excess(with_transient_uncertainty(table), x), harmonics=harmonics)
    if scenario is None:
        return table
    return _with_noise_statistics(table, scenario, expected, disturbance)


def simulated_lines(
    x: np.ndarray,
    sample_rate: float,
    scenario: Scenario,
    expected: tuple[ExpectedLine, ...],
    disturbance: bool = True,
) -> LineTable:
    """Lines of a simulated torque, as ``lines_of_samples``, of which those that are ``expected`` are
    known (``expected_in``).
    """
    # A simulation's clock is known also where no line of it is seen.
    table = replace(estimate_lines(x, sample_rate, expected), clock_ratio_uncertainty=0.0)
    table = _with_noise_statistics(table, scenario, expected, disturbance)
    ringing = {mode.name for mode in coupled_modes(scenario) if may_still_ring(mode, scenario)}
    settled = time_to_settle(scenario)
    ended = {
        line.name
        for line in expected
        if line.is_mode and line.name not in ringing and has_decayed(line.decay, settled)
    }
    table = _relabel_lasting_lines(table, ended)
    return _with_intermittent_peaks(table, x, scenario)


_FULL_STEPS_RESOLVED = 4.0
"""Full steps from which a piece of a record tells the lines of the clock apart."""
_NEGLIGIBLE_LINE = 1e-3
"""Part of the largest line below which a steady one need not be taken out to see what is not."""


def _with_intermittent_peaks(table: LineTable, x: np.ndarray, scenario: Scenario) -> LineTable:
    """Lines of samples ``x`` (n,), among whose residual peaks are those of a part of the time, where
    something changes the drive slowly, or stick-slip comes in bursts.

    Those are amplitudes of lines, and so count without the factor on what no line is fitted to.
    """
    varies, rest = slow_variations(scenario), table.rest
    bursts = sliding_growth(scenario) > 0.0
    if not (varies or bursts) or rest is None or rest.floor is None:
        return table
    if bursts:
        cycle = 2.0 * table.duration
    else:
        cycle = max((x.cycle for x in varies if x.cycle <= table.duration), default=table.duration)
    noise = (rest.frequency, rest.floor) if noise_bands(scenario) and rest.frequency.size else None
    frequency, amplitude = intermittent_peaks(
        x,
        table.sample_rate,
        _lines_at_all_times(table, bursts=bursts),
        cycle,
        _FULL_STEPS_RESOLVED * full_step_time(scenario),
        noise=noise,
        louder=0.0 if bursts else LOUDER,  # of a long record, this may be a block that is all loud
    )
    if not frequency.size:
        return table
    return replace(table, rest=rest.with_peaks(frequency, amplitude / rest.factor))


def _lines_at_all_times(table: LineTable, *, bursts: bool) -> list[Line]:
    """Lines to take out of a record to see what is there for a part of the time: modes that stick-slip
    excites in ``bursts`` are not among them.
    """
    least = _NEGLIGIBLE_LINE * table.largest
    named = (line for line in table if line.kind != "other" and line.seen)
    return [x for x in named if x.amplitude > least and not (bursts and x.is_mode)]


def _with_peaks_of_pieces(table: LineTable, series: np.ndarray, state: SteadyState) -> LineTable:
    """Lines of the Fourier ``series`` of a steady state, with peaks of pieces of its period where
    something changes the drive slowly within it.
    """
    scenario = state.scenario
    if not slow_variations(scenario) and sliding_growth(scenario) == 0.0:
        return table
    comb = _orders_of_electrical_period(state)
    if comb <= 1:
        return table
    shortest = 2.0 / (comb * state.frequency)
    found = peaks_of_period(series, state.frequency, comb, shortest)
    return replace(table, pieces=ResidualPeaks.of(*found))


def _orders_of_electrical_period(state: SteadyState) -> int:
    """How often the electrical period, or else a full step, goes into the period of a steady state; 0
    where neither does.
    """
    driver, motor = state.scenario.driver, state.scenario.motor
    electrical = driver.beats * driver.microsteps
    for part in (electrical, electrical // motor.full_steps):
        if part and state.microsteps % part == 0:
            return state.microsteps // part
    return 0


def intermittency_cause(scenario: Scenario | None) -> str:
    """Key of what changes the drive slowest, or the stick-slip that may come in bursts; empty where
    nothing does.
    """
    if scenario is None:
        return ""
    if sliding_growth(scenario) > 0.0:
        return "stick-slip"
    return next((one.what for one in slow_variations(scenario)), "")


def _refit_clock(
    table: LineTable,
    x: np.ndarray,
    sample_rate: float,
    expected: tuple[ExpectedLine, ...],
    every_order: bool,
) -> LineTable:
    """The lines at a clock far from the expected one, where the record shows that; else those of
    the ``table``.

    A drive whose motion repeats after several driving periods only has a comb of fractions of its
    driving frequency, and a clock at a multiple lists more of these lines. It is told by its first
    driving line, which is then none of the large ones.
    """
    if not any(line.of_clock for line in expected) or not _clock_is_questionable(table):
        return table
    spectrum, highest = HannSpectrum.of(x - x.mean(), sample_rate), PASSBAND * sample_rate
    ratio = search_wide_clock_ratio(expected, table.clock_ratio, highest, spectrum)
    if ratio is None or abs(ratio - 1.0) <= CLOCK_TOLERANCE:
        return table
    moved = [_at_clock_ratio(line, ratio) for line in expected]
    within = [line for line in moved if line.frequency <= highest]
    there = estimate_lines(x, sample_rate, within, every_order)
    if there.clock_ratio is None or there.clock_ratio_uncertainty is None:
        return table
    if _driving_line_is_small(there) and not _driving_line_is_small(table):
        return table
    return replace(
        there,
        lines=tuple(_with_own_expectation(line, ratio) for line in there.lines),
        clock_ratio=ratio * there.clock_ratio,
        clock_ratio_uncertainty=ratio * there.clock_ratio_uncertainty,
    )


def _with_own_expectation(line: Line, ratio: float) -> Line:
    """A line found at a clock of this ``ratio``, with the frequency that the scenario expects."""
    if line.of_clock:
        return replace(line, expected=line.expected / ratio)
    return line


def _clock_is_questionable(table: LineTable) -> bool:
    """Whether another clock might explain more: where unlisted lines are not small beside the
    clock's, or its first line is.
    """
    largest = max(_clock_amplitudes(table).values(), default=0.0)
    others = max((line.amplitude for line in table if line.kind == "other"), default=0.0)
    return others > SIGNIFICANT_RATIO * largest or _driving_line_is_small(table)


def _driving_line_is_small(table: LineTable) -> bool:
    """Whether the clock's first driving line is small beside its largest line, or not seen."""
    clock = _clock_amplitudes(table)
    small = SIGNIFICANT_RATIO * max(clock.values(), default=0.0)
    return clock.get(driving_line(1), 0.0) <= small


def _clock_amplitudes(table: LineTable) -> dict[str, float]:
    """Amplitudes of the lines of the clock that are seen, by name."""
    return {line.name: line.amplitude for line in table if line.of_clock and line.seen}


def _at_clock_ratio(line: ExpectedLine, ratio: float) -> ExpectedLine:
    """The line as a clock of this ``ratio`` to the scenario's makes it."""
    if not line.of_clock:
        return line
    return replace(
        line, frequency=ratio * line.frequency, low=ratio * line.low, high=ratio * line.high
    )


TRANSIENT_PHASE_DRIFT = 1e-3
"""Cycles of the clock's largest line over a record by which a mode as large as it moves it while it
rings: a standard deviation, from simulations of states 1, 2 and 4 of the catalog with reducers,
frictions and drivers drawn at random."""


def with_transient_uncertainty(table: LineTable) -> LineTable:
    """Measured lines with what rings in the uncertainties of the clock: it shifts all its lines in
    time, as its size squared.
    """
    clock = [x for x in table if x.of_clock and x.seen]
    rings = max((x.amplitude for x in table if x.is_mode and x.seen), default=0.0)
    if not clock or not rings or table.clock_ratio_uncertainty is None:
        return table
    largest = max(clock, key=lambda x: x.amplitude)
    late = (
        TRANSIENT_PHASE_DRIFT * min(rings / largest.amplitude, 1.0) ** 2 / largest.frequency
    )  # [s] over the record
    slower = late / table.duration

    def wider(x: Line) -> Line:
        if x not in clock:
            return x
        frequency = math.hypot(x.frequency_uncertainty, slower * x.frequency)
        phase = math.hypot(x.phase_uncertainty, math.pi * late * x.frequency)
        return replace(x, frequency_uncertainty=frequency, phase_uncertainty=phase)

    ratio = math.hypot(table.clock_ratio_uncertainty, slower)
    return replace(table, lines=tuple(map(wider, table)), clock_ratio_uncertainty=ratio)


def _relabel_lasting_lines(table: LineTable, ended: Collection[str]) -> LineTable:
    """Lines of a simulation, of which one that lasts is not called after a mode that has died away
    by its damping, as those that are called ``ended`` have.

    Such a line is a sideband, or what friction keeps going: it is listed as found and not expected.
    """
    rows, number = list(table), sum(x.kind == "other" for x in table)
    for k, x in enumerate(rows[:]):
        if not (x.is_mode and x.status == "ok" and x.name in ended):
            continue
        number += 1
        name = str(LineName(UNLISTED, number))
        origin = f"steady, at the frequency of {x.name}, which has decayed: a sideband, or self-excited by friction"
        rows.append(replace(x, name=name, kind="other", origin=origin, expected=x.frequency))
        nothing: dict[str, Any] = dict.fromkeys(
            ("frequency", "amplitude", "phase", "decay"), math.nan
        )
        rows[k] = replace(x, **nothing, status=f"{NOT_SEPARABLE} {name}")
    return replace(table, lines=tuple(rows))


_NEGLIGIBLE_NOISE_RATIO = 0.1
"""Part of a mode's line below which noise that 95 % of the draws stay below leaves the line to what
else makes it.
"""
_MAX_NOISE_RATIO = 10.0
"""Times what noise gives a bin of the linearised drive, from which an unlisted line is not made by
it.
"""


def _with_noise_statistics(
    table: LineTable, scenario: Scenario, expected: Sequence[ExpectedLine], disturbance: bool
) -> LineTable:
    """Lines with what the noise of the output's friction gives them in closed form; *driven by
    noise* where that is much of them.

    Of another channel than the ``disturbance`` torque no closed form is known: all that the noise's
    band reaches is driven by it.
    """
    if scenario.friction.torque_noise is None and scenario.friction.position is None:
        return table
    in_closed_form: dict[str, NoiseDrivenLine] = {}
    if disturbance:
        in_closed_form = {x.name: x for x in noise_driven_lines(scenario, table.duration, expected)}
    rows = []
    for line in table:
        noise = in_closed_form.get(line.name)
        if noise is not None:
            rows.append(_with_noise_in_closed_form(line, noise))
        elif line.seen and _is_made_by_noise(line, scenario, table.duration, disturbance):
            rows.append(replace(line, status=NOISE_DRIVEN))
        else:
            rows.append(line)
    return replace(table, lines=tuple(rows))


def _with_noise_in_closed_form(line: Line, noise: NoiseDrivenLine) -> Line:
    """A line with the statistics of what noise gives it, driven by it where that is not
    negligible.
    """
    negligible = _NEGLIGIBLE_NOISE_RATIO * line.amplitude
    if line.status == BELOW_FLOOR:
        negligible = line.floor
    is_driven = (line.seen or line.status == BELOW_FLOOR) and noise.quantile > negligible
    return replace(
        line,
        noise_mean=noise.mean,
        noise_deviation=noise.deviation,
        noise_p95=noise.quantile,
        status=NOISE_DRIVEN if is_driven else line.status,
    )


def _is_made_by_noise(line: Line, scenario: Scenario, duration: float, disturbance: bool) -> bool:
    """Whether noise may be all that is seen of a line without statistics in closed form."""
    if line.of_clock or not line.frequency > 0.0:
        return False
    if not disturbance:
        return bool(noise_density(scenario, np.array([line.frequency]))[0] > 0.0)
    in_bin = noise_bin_amplitude(scenario, line.frequency, duration)
    return line.amplitude < _MAX_NOISE_RATIO * in_bin


def lines_by_name(
    torque: Torque, scenario: Scenario, names: Collection[str], harmonics: int = 8
) -> LineTable:
    """Lines of a simulated torque, as ``lines_of_samples``, that are called by these ``names`` or
    are array modes.

    They have no uncertainties, and take a fraction of the time.
    """
    return lines_at_known_clock(
        torque.T_d,
        torque.sample_rate,
        named_or_modes(expected_in(scenario, torque.sample_rate, harmonics), names),
    )


def lines_by_name_of_steady_state(
    state: SteadyState, names: Collection[str], harmonics: int = 8
) -> LineTable:
    """Lines of a steady state that are called by these ``names``, and array modes as a small
    deviation rings about it: with their frequencies and decays, without amplitudes.

    They have no uncertainties, as those of ``lines_by_name``, and no nearest bins.
    """
    record = state.scenario.record
    expected = named_or_modes(expected_in(state.scenario, record.sample_rate, harmonics), names)
    size = int(PASSBAND * record.sample_rate / state.frequency) + 1
    orders = [0 if line.is_mode else order_of(line, state.frequency, size) for line in expected]
    found = np.array(sorted({*orders, 1} - {0}))
    tone_of = dict(zip(found.tolist(), state.integrated_harmonics(found).tolist(), strict=True))
    rows = []
    for line, order in zip(expected, orders, strict=True):
        named = Line(line.name, line.kind, expected=line.frequency)
        if line.is_mode:
            frequency, decay = state.ringing(line.frequency, line.decay)
            rows.append(replace(named, frequency=frequency, decay=decay))
        else:
            tone = tone_of.get(order, 0.0j)
            own = {"amplitude": abs(tone), "phase": cmath.phase(tone), "decay": 0.0}
            rows.append(replace(named, frequency=line.frequency, **own, status="ok"))
    return LineTable(tuple(rows), 1.0, 0.0, record.samples, record.sample_rate)


def named_or_modes(
    expected: Sequence[ExpectedLine], names: Collection[str]
) -> tuple[ExpectedLine, ...]:
    """Select the ``expected`` lines that are called by these ``names`` or are array modes."""
    return tuple(line for line in expected if line.name in names or line.is_mode)


def lines_of_recording(
    recording: Recording,
    channel: str,
    scenario: Scenario | None,
    background: Recording | None = None,
    harmonics: int = 8,
    *,
    judged: bool = True,
) -> LineTable:
    """Lines of the drive-axis torque that was measured in ``channel`` [N m], what stands in the
    ``background`` accounted for.

    Those that are to be ``judged`` need a longer record: ``shortest_judged_record``.

    RecordingError where the channel cannot be used, or another component is about the scenario's
    drive axis.
    """
    if scenario is None:
        about = channel
    else:
        about = f"M{scenario.array.drive_axis}"
    if channel in COMPONENTS and channel != about and about in recording.channels:
        text = f"the scenario's drive axis is {about[1:]}: its torque is channel {about}, not {channel}; name that channel"
        raise RecordingError(f"{recording.title}: {text}", remedy="channel")
    if judged:
        shortest = shortest_judged_record(recording, scenario, harmonics)
    else:
        shortest = shortest_record(recording, scenario, harmonics)
    require_usable_channel(recording, channel, shortest)
    if recording.units[channel] != "N*m":
        expected = "the torque about the drive axis is expected"
        raise RecordingError(f"{recording.title}: channel {channel} is a force; {expected}")
    table = lines_of_samples(
        recording[channel], recording.sample_rate, scenario, harmonics, measured=True
    )
    if background is not None:
        require_usable_channel(background, channel, shortest)
        table = with_background(table, background[channel])
    return with_force_table(table, recording, channel)


def shortest_record(recording: Recording, scenario: Scenario | None, harmonics: int = 8) -> float:
    """Length [s] from which a recording has a noise floor and resolves one of the lines that the
    clock of a ``scenario`` makes.

    Each line that is not resolved says so in its status, with the length that resolves it.
    """
    floor = _MIN_SAMPLES / recording.sample_rate
    fastest = max(_clock_frequencies(recording, scenario, harmonics), default=math.inf)
    return max(floor, SEPARATION / fastest)


def shortest_judged_record(
    recording: Recording, scenario: Scenario | None, harmonics: int = 8
) -> float:
    """Length [s] from which lines of a recording are compared, fitted or budgeted: 2 s, or less
    where all lines that the clock of a ``scenario`` makes are resolved from zero.
    """
    slowest = min(_clock_frequencies(recording, scenario, harmonics), default=0.0)
    if slowest * _JUDGED_DURATION <= SEPARATION:
        return _JUDGED_DURATION
    return max(shortest_record(recording, scenario, harmonics), SEPARATION / slowest)


def _clock_frequencies(
    recording: Recording, scenario: Scenario | None, harmonics: int
) -> list[float]:
    """Frequencies [Hz] of the lines that the clock of a scenario makes in a recording's passband."""
    if scenario is None:
        return []
    expected = expected_in(scenario, recording.sample_rate, harmonics)
    return [line.frequency for line in expected if line.of_clock]


_MIN_COMB_LINES = 3
"""Unlisted lines at multiples of one frequency that are no chance."""


def _largest_harmonic_series(others: Sequence[Line], duration: float) -> Iterator[Line]:
    """Largest set of lines that are multiples of one of them, mains harmonics left out."""
    each = [x for x in others if not near_mains(x.frequency, duration)]
    combs: list[list[Line]] = [
        [x for x in each if abs(x.frequency - round(x.frequency / first.frequency) * first.frequency) * duration < 0.5]
        for first in each
    ]  # fmt: skip
    combs.sort(key=len)
    yield from sorted(combs[-1] if combs else [], key=lambda x: x.frequency)


def rate_warnings(clock_ratio: float | None) -> Iterator[str]:
    """A sentence where the step clock is farther off the scenario's than clocks are."""
    if clock_ratio is None:
        off = 0.0
    else:
        off = clock_ratio - 1.0
    if abs(off) > MAX_CLOCK_OFFSET:
        yield (
            f"the step clock is {100.0 * abs(off):.2g} % {'above' if off > 0.0 else 'below'} the"
            " scenario's: set tracking.rate to the rate commanded in this recording, or use the recording of this scenario"
        )


def clock_warnings(table: LineTable) -> Iterator[str]:
    """Reasons to question that a recording is of the scenario's drive at its rate, a sentence each."""
    clock = [x for x in table if x.kind and x.of_clock]
    yield from rate_warnings(table.clock_ratio)
    yield from _no_motion_warnings(table, clock)
    yield from _other_machinery_warnings(table, clock)
    yield from _multiple_of_rate_warnings(clock)


def _no_motion_warnings(table: LineTable, clock: Sequence[Line]) -> Iterator[str]:
    """Where no line of the ``clock`` is seen, or those alone that the mains may make."""
    seen = [x for x in clock if x.seen]
    if table.clock_ratio is None and any(x.status == BELOW_FLOOR for x in clock):
        yield f"no line of the step clock is detected within {100 * CLOCK_TOLERANCE:g} % of the scenario's rate"
    elif seen and all(near_mains(x.frequency, table.duration) for x in seen):
        yield "all detected lines of the step clock coincide with mains harmonics (50 or 60 Hz): the drive may not have been moving"


def _other_machinery_warnings(table: LineTable, clock: Sequence[Line]) -> Iterator[str]:
    """Where lines larger than all of the ``clock`` are multiples of one frequency."""
    largest = max((x.amplitude for x in clock if x.seen), default=math.inf)
    larger = [x for x in table if x.kind == "other" and x.amplitude > largest]
    comb = list(_largest_harmonic_series(larger, table.duration))
    if len(comb) >= _MIN_COMB_LINES:
        yield (
            f"{', '.join(x.name for x in comb)}, multiples of {comb[0].frequency:.5g} Hz, are"
            " larger than all lines of the step"
            " clock: the drive may have run at another rate, or other machinery may have been"
            " running nearby"
        )


def _multiple_of_rate_warnings(clock: Sequence[Line]) -> Iterator[str]:
    """Where of the driving lines those alone are seen that a multiple of the rate has."""
    drive = {LineName.parse(x.name).order: x for x in clock if x.kind == "drive"}
    seen = {k: x.name for k, x in drive.items() if x.seen}
    common = math.gcd(*seen)
    if common > 1 and all(x.status == BELOW_FLOOR for k, x in drive.items() if k % common):
        yield (
            f"only the driving lines {', '.join(seen.values())} are detected: the drive may have"
            f" run at {common} times the scenario's rate"
        )


def clock_and_mains_warnings(table: LineTable) -> Iterator[str]:
    """``clock_warnings`` and, where there are none, which lines of the clock pick-up of the mains
    may stand in.
    """
    warnings = tuple(clock_warnings(table))
    clock = (x for x in table if x.of_clock and x.seen)
    hum = [x.name for x in clock if near_mains(x.frequency, table.duration)]
    if hum and not warnings:
        yield f"possible mains pick-up (50 or 60 Hz): {', '.join(hum[:6])}{' ...' if len(hum) > 6 else ''}"
    yield from warnings


_MIN_CLOCK_LINES = 3
"""Lines of the clock above the noise floor from which a channel may be the one about the drive axis."""


def channel_warnings(
    recording: Recording, channel: str, scenario: Scenario, table: LineTable
) -> Iterator[str]:
    """Other channels of torque that show the drive's lines, where ``channel``, whose lines the
    ``table`` has, hardly shows any.
    """
    mine = _count_clock_lines(table)
    if mine >= _MIN_CLOCK_LINES or not scenario.driving_frequency:
        return
    for other in (
        name for name, unit in recording.units.items() if unit == "N*m" and name != channel
    ):
        with suppress(RecordingError):
            require_usable_channel(recording, other, shortest_record(recording, scenario))
            x = recording[other]
            its = _count_clock_lines(
                lines_of_samples(x, recording.sample_rate, scenario, measured=True)
            )
            if its > max(_MIN_CLOCK_LINES, 2 * mine):
                yield (
                    f"channel {other} shows {its} lines of the step clock and {channel} {mine}:"
                    " check the drive axis, and specify"
                    f" the channel of the torque about it"
                )


def _count_clock_lines(table: LineTable) -> int:
    return sum(
        line.of_clock and line.kind != "other" and (line.seen or line.status in DISTORTED)
        for line in table
    )


def recording_warnings(
    recording: Recording, channel: str, scenario: Scenario | None, table: LineTable
) -> Iterator[str]:
    """``clock_and_mains_warnings``, which lines the force table does not show, whether the recording
    is steady, and what speaks against the channel.
    """
    yield from clock_and_mains_warnings(table)
    yield from force_table_notes(table, recording, channel)
    if scenario is not None:
        yield from steadiness_notes(table)
        yield from channel_warnings(recording, channel, scenario, table)


def expected_in(
    scenario: Scenario, sample_rate: float, harmonics: int = 8, measured: bool = False
) -> tuple[ExpectedLine, ...]:
    """Lines that are expected up to the edge of the passband of a record at ``sample_rate`` [Hz]."""
    if measured:
        tolerances = (CLOCK_TOLERANCE, MODE_TOLERANCE)
    else:
        tolerances = (0.0, 0.0)
    return expected_lines(scenario, Si(PASSBAND * sample_rate), harmonics, *tolerances)


def lines_of_steady_state(state: SteadyState, channel: str, harmonics: int) -> LineTable:
    """Lines of a ``channel`` of a steady state, as ``find_lines``: named as those of a record, with
    its bins and its first sample's phases.
    """
    if channel != "T_d":
        scalar_channel(state.channels, channel, state.scenario, state.time)
    record = state.scenario.record
    expected = expected_in(state.scenario, record.sample_rate, harmonics)
    series = state.harmonics(channel, int(PASSBAND * record.sample_rate / state.frequency) + 1)
    table = lines_of_series(
        series, state.frequency, state.microsteps, expected, record.samples, record.sample_rate
    )
    if channel == "T_d":
        table = with_spread(state, _with_peaks_of_pieces(table, series, state))
    return replace(
        table,
        unit=unit_of(channel),
        source=f"{channel} in the steady state of {state.scenario.brief}",
        harmonics=harmonics,
        broken=state.invariants.broken,
        find_error=ErrorOfIntegration(state, channel == "T_d"),
    )
