"""Lines and spectra of a motion: the scenario says which lines to expect, the samples say what is there."""

from __future__ import annotations

from dataclasses import replace

from microvib.analysis.steady import steady_lines
from microvib.model.expected import expected_lines
from microvib.signals.line_fit import estimate_lines
from microvib.signals.line_table import LineTable
from microvib.signals.spectrum import Spectrum, Window, amplitude_spectrum
from microvib.solve.motion import Motion, series_of, unit_of
from microvib.solve.sampling import PASSBAND
from microvib.solve.steady.state import SteadyState


def lines(motion: Motion | SteadyState, channel: str = "T_d", harmonics: int = 8) -> LineTable:
    """Every line that the physics predicts in the disturbance torque, named and estimated [Hz, N m, rad].

    ``channel`` may be any channel that is one value at a time, or a load on the spacecraft, ``Fx`` to ``Mz``, of an array with
    participation in six components. Amplitudes are in the unit of the channel, ``table.unit``, also where their names end in
    ``n_m``. ``harmonics`` bounds each family of lines. See ``microvib.model.expected`` for the families and
    ``microvib.signals.line_fit`` for the estimators; of a steady state the lines are exact. Raises ChannelError.
    """
    if isinstance(motion, SteadyState):
        return steady_lines(motion, channel, harmonics)
    expected = expected_lines(motion.scenario, PASSBAND * motion.sample_rate, harmonics)
    samples = series_of(motion.channels, channel, motion.scenario.array)
    return replace(estimate_lines(samples, motion.sample_rate, expected), unit=unit_of(channel))


def spectrum(motion: Motion, channel: str = "T_d", window: Window = "rectangular") -> Spectrum:
    """One-sided amplitude spectrum, 0-to-peak, of a channel, or a load ``Fx`` to ``Mz``, over the whole record."""
    samples = series_of(motion.channels, channel, motion.scenario.array)
    return amplitude_spectrum(samples, motion.sample_rate, window)
