"""Lines and spectra of a motion: the scenario says which lines to expect, the samples say what is there."""

from __future__ import annotations

from microvib.errors import MicrovibError
from microvib.model.expected import expected_lines
from microvib.signals.lines import estimate_lines
from microvib.signals.spectrum import Spectrum, Window, amplitude_spectrum
from microvib.signals.table import LineTable
from microvib.solve.decimate import PASSBAND
from microvib.solve.motion import Motion
from microvib.solve.steady import SteadyState
from microvib.studies.steady import steady_lines


def lines(motion: Motion | SteadyState, channel: str = "T_d", harmonics: int = 8) -> LineTable:
    """Every line that the physics predicts in the disturbance torque, named and estimated [Hz, N m, rad].

    ``channel`` may be any torque; ``harmonics`` bounds each family of lines. See ``microvib.model.expected`` for the
    families and ``microvib.signals.lines`` for the estimators; of a steady state the lines are exact.
    """
    if isinstance(motion, SteadyState):
        return steady_lines(motion, channel, harmonics)
    expected = expected_lines(motion.scenario, PASSBAND * motion.sample_rate, harmonics)
    return estimate_lines(_samples(motion, channel), motion.sample_rate, expected)


def spectrum(motion: Motion, channel: str = "T_d", window: Window = "rectangular") -> Spectrum:
    """One-sided amplitude spectrum, 0-to-peak, of a channel over the whole record."""
    return amplitude_spectrum(_samples(motion, channel), motion.sample_rate, window)


def _samples(motion: Motion, channel: str):  # type: ignore[no-untyped-def]
    samples = motion.channels.get(channel)
    if samples is None or samples.ndim != 1:
        names = ", ".join(name for name, values in motion.channels.items() if values.ndim == 1)
        raise MicrovibError(f"channel '{channel}' is not in this motion; there are {names}")
    return samples
