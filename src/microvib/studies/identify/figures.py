"""Figures of lines, measured and simulated: their differences, and how far each is trusted."""

from __future__ import annotations

import math

import numpy as np

from microvib.analysis.lines import lines_among
from microvib.model.scenario import Scenario
from microvib.signals.spectrum import amplitude_spectrum
from microvib.solve.batch import Torque
from microvib.studies.evidence import Evidence, Observation, Simulated, predicted

FREQUENCY_FLOOR, DECAY_FLOOR, PHASE_FLOOR = 2e-4, 0.01, 0.01
"""Relative accuracy of frequencies and decays, and that of phases [rad], that no observation is trusted beyond."""
ROBUST = 5.0
"""Standard deviations from which a residual counts in proportion, not by its square: a start far off still shows the way."""
_AMISS = {"amplitude": 5.0, "nearest_bin": 5.0, "phase": math.pi, "frequency": 1.0, "decay": 5.0}
"""Difference of a figure that a simulation does not have: as large as those of the worst that do."""


def as_tested(scenario: Scenario, evidence: Evidence, changes: dict[str, object]) -> Scenario:
    """The scenario as a test had it: the test's own changes, its clock, and its record."""
    test = scenario.with_(changes) if changes else scenario
    record = {"record.duration": evidence.duration, "record.sample_rate": evidence.sample_rate}
    if evidence.clock_ratio is not None:
        record["tracking.clock_ratio"] = test.tracking.clock_ratio * evidence.clock_ratio
    return test.with_si(record)


def lines_of(torque: Torque, test: Scenario, evidence: Evidence) -> Simulated:
    """Lines of a simulated test for which there is evidence."""
    asked = {o.line for o in evidence.observations} | {"drive_1"}
    spectrum = amplitude_spectrum(torque.T_d, torque.sample_rate)
    table = lines_among(torque.T_d, torque.sample_rate, test, asked)
    return Simulated(table, spectrum.amplitude, spectrum.resolution)


def cost(r: np.ndarray) -> float:
    """Sum of squares; of residuals beyond ROBUST, of what grows in proportion (Huber)."""
    size = np.abs(r)
    return float(np.sum(np.where(size < ROBUST, size**2, 2.0 * ROBUST * size - ROBUST**2)))


def difference(o: Observation, simulated: Simulated | None) -> float:
    """Logarithm of the ratio of amplitudes, relative difference of frequency and decay, difference of phases."""
    value = math.nan if simulated is None else predicted(simulated, o)
    if not math.isfinite(value):
        return _AMISS[o.form]
    if o.form in ("amplitude", "nearest_bin"):
        return math.log(max(value, 1e-12) / o.value)
    if o.form == "phase":
        return math.remainder(value - o.value, 2.0 * math.pi)
    return (value - o.value) / max(abs(o.value), 1e-6)


def weight(o: Observation, each: float) -> float:
    """Standard deviation that the difference of one observation is measured by: its own, and the model's."""
    if o.form in ("amplitude", "nearest_bin"):
        return math.hypot(o.uncertainty / o.value, each)
    if o.form == "frequency":
        return math.hypot(o.uncertainty / o.value, FREQUENCY_FLOOR)
    if o.form == "decay":
        return math.hypot(o.uncertainty / max(abs(o.value), 1e-6), DECAY_FLOOR)
    return math.hypot(o.uncertainty, PHASE_FLOOR)
