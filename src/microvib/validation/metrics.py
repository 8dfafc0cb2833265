"""Metrics of the cases of a published test: figures of a channel of a simulated record."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from microvib.analysis.lines import find_lines
from microvib.errors import ScenarioError, SimulationError, SynchronismLost
from microvib.model.record import PASSBAND
from microvib.model.scenario import Scenario
from microvib.signals.line_table import BELOW_FLOOR
from microvib.solve.motion import Motion
from microvib.solve.simulate import simulate
from microvib.validation.cases_file import COUNTS, Metric

MIN_ELECTRICAL_TURNS = 8
"""Electrical turns that a record holds at least, of which the amplitude of an order is taken."""
FILTER_ORDER = 4
"""Order of the Butterworth filter, run forwards and backwards, that limits a channel to a band."""


def case_metrics(scenario: Scenario, metrics: Mapping[str, Metric]) -> dict[str, float]:
    """Figures of a case by the names of its metrics, in SI.

    Parameters
    ----------
    scenario : Scenario
        The case.
    metrics : mapping of str to Metric
        What is taken of it.

    Returns
    -------
    dict of str to float
        Amplitudes 0-to-peak, RMS and largest values in the unit of the channel.

    Raises
    ------
    ScenarioError
        Where a record cannot have such a figure: too short for an order, sampled too slowly for a
        band, or of no constant rate.
    SimulationError
        What ``simulate`` raises.
    """
    channels = {one.channel for one in metrics.values() if one.what not in COUNTS}
    for name, metric in metrics.items():
        _check_record(scenario, name, metric)
    motion = simulate(scenario, channels=tuple(sorted(channels)) or ("T_d",))
    return {name: evaluate(metric, motion) for name, metric in metrics.items()}


def without_motion(metrics: Mapping[str, Metric], error: SimulationError) -> dict[str, float]:
    """Figures of a case that could not be simulated: none (nan), but infinitely many lost steps
    where the motor lost synchronism.
    """
    found = dict.fromkeys(metrics, math.nan)
    if isinstance(error, SynchronismLost):
        found |= {name: math.inf for name, one in metrics.items() if one.what == "lost steps"}
    return found


def evaluate(metric: Metric, motion: Motion) -> float:
    """Figure of a metric, in SI, of a motion that kept synchronism."""
    if metric.what in COUNTS:
        return _steps(metric, motion)
    if metric.what == "line":
        return _line_amplitude(metric, motion)
    samples = motion[metric.channel]
    rate = motion.sample_rate
    if metric.what == "order":
        assert metric.order is not None
        return amplitude_at(samples, rate, metric.order * electrical_frequency(motion.scenario))
    low, high = metric.edges
    limited = band_limited(samples, rate, low, high)
    if metric.what == "rms":
        return math.hypot(float(np.sqrt(np.mean(limited**2))), metric.noise)
    if metric.what == "sliding rms":
        assert metric.window is not None
        return largest_sliding_rms(limited, max(round(metric.window * rate), 1))
    return float(np.max(np.abs(samples)))


def _check_record(scenario: Scenario, name: str, metric: Metric) -> None:
    """ScenarioError where the record of a case cannot have a metric."""
    record, (_, high) = scenario.record, metric.edges
    if math.isfinite(high) and high > PASSBAND * record.sample_rate:
        raise ScenarioError(
            f"metric '{name}': its band ends at {high:g} Hz, and a record at"
            f" {record.sample_rate:g} Hz is flat to {PASSBAND * record.sample_rate:g} Hz; raise"
            " record.sample_rate"
        )
    if metric.window is not None and metric.window > record.duration:
        raise ScenarioError(
            f"metric '{name}': its window of {metric.window:g} s is longer than the record,"
            f" {record.duration:g} s"
        )
    if metric.what == "order":
        assert metric.order is not None
        place = metric.order * electrical_frequency(scenario)
        if place > PASSBAND * record.sample_rate:
            raise ScenarioError(
                f"metric '{name}': order {metric.order:g} is at {place:.4g} Hz, and a record at"
                f" {record.sample_rate:g} Hz is flat to {PASSBAND * record.sample_rate:g} Hz; raise"
                " record.sample_rate"
            )
        turns = record.duration * electrical_frequency(scenario)
        if turns < MIN_ELECTRICAL_TURNS:
            raise ScenarioError(
                f"metric '{name}': the record holds {turns:.3g} electrical turns, and"
                f" {MIN_ELECTRICAL_TURNS} are needed; make record.duration longer"
            )


def electrical_frequency(scenario: Scenario) -> float:
    """Electrical turns per second f_e [Hz]; ScenarioError where the rate changes or is zero."""
    f_d = scenario.driving_frequency
    if not f_d:
        raise ScenarioError(
            "an order is a multiple of the electrical frequency, and the rate of the record"
            " changes or is zero; a constant rate is expected"
        )
    return f_d / (scenario.driver.beats * scenario.driver.microsteps)


def amplitude_at(samples: np.ndarray, rate: float, frequency: float) -> float:
    """Amplitude, 0-to-peak, at a known frequency [Hz], of ``samples`` (n,) at ``rate`` [1/s].

    The samples under a Hann window are projected on that frequency, so that it need not lie on a
    bin; a line some bins away adds at most a few thousandths of itself.
    """
    n = samples.size
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * (np.arange(n) + 0.5) / n)
    turned = np.exp(-2j * math.pi * frequency / rate * np.arange(n))
    mean = np.average(samples, weights=window)
    return float(2.0 * np.abs(np.average((samples - mean) * turned, weights=window)))


def band_limited(samples: np.ndarray, rate: float, low: float, high: float) -> np.ndarray:
    """Samples (n,) between two frequencies [Hz], without delay; 0 and infinity are no ends."""
    from scipy import signal

    limited = samples - np.mean(samples)
    if low > 0.0:
        sections = signal.butter(FILTER_ORDER, low, "highpass", fs=rate, output="sos")
        limited = signal.sosfiltfilt(sections, limited)
    if math.isfinite(high):
        sections = signal.butter(FILTER_ORDER, high, "lowpass", fs=rate, output="sos")
        limited = signal.sosfiltfilt(sections, limited)
    result: np.ndarray = limited
    return result


def largest_sliding_rms(samples: np.ndarray, window: int) -> float:
    """Largest RMS over any ``window`` samples in a row, of ``samples`` (n,)."""
    squares = np.concatenate([[0.0], np.cumsum(samples**2)])
    means = (squares[window:] - squares[:-window]) / window
    return float(math.sqrt(max(float(np.max(means)), 0.0)))


def _steps(metric: Metric, motion: Motion) -> float:
    """Steps that a pulsed drive lost, or the number of the first that was not made, infinite where
    all were; of other drives, which either keep synchronism or fail, none.
    """
    steps = motion.steps
    if metric.what == "lost steps":
        return float(steps.lost if steps else 0)
    if steps is None or steps.first == 0:
        return math.inf
    return float(steps.first)


def _line_amplitude(metric: Metric, motion: Motion) -> float:
    """Fitted amplitude of a named line; 0 where it is below the floor of the record.

    ScenarioError where the drive has no such line, or the record does not tell it.
    """
    table = find_lines(motion, metric.channel)
    if metric.line not in {one.name for one in table}:
        raise ScenarioError(
            f"{metric.line}: is not a line of '{motion.scenario.title}'; there are"
            f" {', '.join(one.name for one in table)}"
        )
    line = table[metric.line]
    if line.status == BELOW_FLOOR:
        return 0.0
    if math.isnan(line.amplitude):
        raise ScenarioError(
            f"{metric.line}: has no amplitude in the record of '{motion.scenario.title}': {line.status}"
        )
    return float(line.amplitude)
