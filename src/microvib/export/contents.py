"""Contents of a run that every format of data writes: time histories, lines, densities, frequency
responses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microvib.analysis.hub_lines import channel_lines
from microvib.analysis.lines import expected_in
from microvib.analysis.run import RunResult
from microvib.analysis.spectra import psd
from microvib.errors import MicrovibError
from microvib.export.state_space import StateSpace, state_space
from microvib.export.subject import Subject
from microvib.model.coupling import resonance_frequency_grid
from microvib.model.expected import ExpectedLine
from microvib.model.record import PASSBAND
from microvib.model.rigid import COMPONENTS
from microvib.signals.line_fit import modes_near_clock_lines
from microvib.signals.line_table import Line
from microvib.solve.channels import ALL_CHANNELS, CHANNELS, LINE_OF_SIGHT, LOADS, MODAL, Channel
from microvib.solve.motion import Motion

_ABOUT_RESONANCES = np.linspace(-8.0, 8.0, 65)
"""Frequencies about a resonance, in parts of its damping."""
_LOWEST, _FREQUENCIES = 0.01, 2000
"""Lowest frequency [Hz] of frequency responses, and how many there are besides those about resonances."""


@dataclass(frozen=True)
class TimeHistories:
    """Samples of channels, (n,) each."""

    start: float
    """Time of the first sample from the start of the command [s]."""
    sample_rate: float
    """[Hz]."""
    channels: tuple[Channel, ...]
    values: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Phasors:
    """Lines as complex amplitudes, 0-to-peak: x(t) = Re(A exp(2 pi j f t)), t = 0 at the first sample."""

    names: tuple[str, ...]
    origins: tuple[str, ...]
    """Cause of each, in words."""
    frequency: np.ndarray
    """[Hz], (k,)."""
    channels: tuple[Channel, ...]
    values: np.ndarray
    """Complex amplitudes, (k, channels); nan where a line was not found."""
    uncertainty: np.ndarray
    """Standard uncertainty of their size, (k, channels); nan where it is not known."""
    of_clock: np.ndarray
    """Whether each is forced by the clock of the steps, (k,); the others ring."""

    @property
    def known(self) -> np.ndarray:
        """Complex amplitudes with 0 where a line was not found, (k, channels)."""
        return np.nan_to_num(self.values)


@dataclass(frozen=True)
class Densities:
    """One-sided power spectral densities (Welch)."""

    frequency: np.ndarray
    """[Hz], (m,)."""
    channels: tuple[Channel, ...]
    values: tuple[np.ndarray, ...]
    """Unit of the channel squared per Hz, (m,) each."""
    window: str


@dataclass(frozen=True)
class FrequencyResponses:
    """Responses of the linearised drive, outputs by inputs."""

    frequency: np.ndarray
    """[Hz], (m,)."""
    system: StateSpace
    values: np.ndarray
    """Complex, (m, outputs, inputs)."""


def time_histories(motion: Motion) -> TimeHistories:
    """All channels of a motion, modal ones mode by mode."""
    channels: list[Channel] = []
    values: list[np.ndarray] = []
    for channel, x in motion.variables():
        if x.ndim == 1:
            channels.append(channel)
            values.append(x)
            continue
        for k, column in enumerate(x.T):
            name = f"{channel.name}_{k + 1}"
            channels.append(Channel(name, channel.unit, f"{channel.meaning}: mode {k + 1}"))
            values.append(np.ascontiguousarray(column))
    start = float(motion.time[0]) if motion.time.size else 0.0
    return TimeHistories(start, motion.sample_rate, tuple(channels), tuple(values))


def disturbances(motion: Motion) -> tuple[Channel, ...]:
    """T_d, the loads on the spacecraft and the line of sight, as far as a motion has them."""
    found = [
        channel for channel, _ in motion.variables() if channel.name not in (*CHANNELS, *MODAL)
    ]
    return (CHANNELS["T_d"], *found)


def phasors(result: RunResult) -> Phasors:
    """Lines of a run in T_d and all that it exerts on the spacecraft."""
    if result.scenario.spacecraft is None:
        return _phasors_on_fixed_base(result)
    return _phasors_on_craft(result)


def _phasors_on_craft(result: RunResult) -> Phasors:
    hub = result.hub
    if hub is None:
        raise MicrovibError("this run kept lines of T_d only; one with its motion is expected")
    channels, columns = list(LOADS.values()), [hub.loads]
    if hub.second is not None:
        channels += [ALL_CHANNELS[f"{name}_2"] for name in COMPONENTS]
        columns.append(hub.second)
    if hub.los is not None:
        channels += [LINE_OF_SIGHT["los_x"], LINE_OF_SIGHT["los_y"]]
        columns.append(hub.los)
    scenario = result.scenario
    expected = {
        line.name: line
        for line in expected_in(scenario, scenario.record.sample_rate, result.table.harmonics)
    }
    of_table = {line.name: line.origin for line in result.table}
    values = np.hstack(columns)
    return Phasors(
        hub.names,
        tuple(expected[n].origin if n in expected else of_table.get(n, "") for n in hub.names),
        hub.frequency,
        tuple(channels),
        values,
        np.full(values.shape, np.nan),
        np.array([n in expected and expected[n].of_clock for n in hub.names], dtype=bool),
    )


def _phasors_on_fixed_base(result: RunResult) -> Phasors:
    source = result.state or result.motion
    if source is None:
        raise MicrovibError("this run kept lines only; one with its motion is expected")
    scenario, table = result.scenario, result.table
    expected = (
        *expected_in(scenario, scenario.record.sample_rate, table.harmonics),
        *_others(table),
    )
    channels = [CHANNELS["T_d"]]
    if scenario.array.interface is not None:
        channels += LOADS.values()
    rows = modes_near_clock_lines(table)
    columns = [channel_lines(source, c.name, expected, rows) for c in channels]
    values = np.array([[_phasor(line) for line in column] for column in columns]).T
    # Lines at a known clock have no uncertainty of estimation, which tables write as 0.
    spread = np.array(
        [[line.amplitude_uncertainty or np.nan for line in column] for column in columns]
    ).T
    frequency = np.array([_frequency(line, columns[0][k]) for k, line in enumerate(expected)])
    keep = np.flatnonzero(np.any(np.isfinite(values) & (values != 0.0), axis=1))
    order = keep[np.argsort(frequency[keep], kind="stable")]
    lines = [expected[k] for k in order]
    return Phasors(
        tuple(line.name for line in lines),
        tuple(line.origin for line in lines),
        frequency[order],
        tuple(channels),
        values[order],
        spread[order],
        np.array([line.of_clock for line in lines], dtype=bool),
    )


def _others(table: object) -> tuple[ExpectedLine, ...]:
    """Lines that were found in T_d and not expected."""
    return tuple(
        ExpectedLine(x.name, "other", x.frequency, x.frequency, x.frequency, x.origin)
        for x in table  # type: ignore[attr-defined]
        if x.kind == "other" and np.isfinite(x.frequency)
    )


def _phasor(line: Line) -> complex:
    return complex(line.amplitude * np.exp(1j * line.phase))


def _frequency(expected: ExpectedLine, found: Line) -> float:
    """Frequency [Hz] of a line: of what rings, as T_d shows it."""
    if expected.of_clock or not np.isfinite(found.frequency):
        return expected.frequency
    return found.frequency


def densities(motion: Motion) -> Densities:
    """Densities of T_d and all that a motion exerts on the spacecraft."""
    channels = disturbances(motion)
    found = [psd(motion, channel.name) for channel in channels]
    return Densities(
        found[0].frequency, channels, tuple(each.density for each in found), found[0].window
    )


def frequency_responses(subject: Subject) -> FrequencyResponses:
    """Frequency responses of the linearised drive up to the edge of the record's passband, at points
    that resolve its resonances.
    """
    scenario = subject.scenario
    system, high = state_space(scenario), PASSBAND * scenario.record.sample_rate
    near = resonance_frequency_grid(scenario, _ABOUT_RESONANCES)
    grid = np.unique(np.concatenate([np.geomspace(_LOWEST, high, _FREQUENCIES), near]))
    f = grid[(grid >= _LOWEST) & (grid <= high)]
    return FrequencyResponses(f, system, system.response(f))
