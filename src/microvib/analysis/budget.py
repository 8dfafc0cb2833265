"""The torque budget of a run: what the housing feels adds up to the disturbance torque, line by
line as phasors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.model.scenario import Scenario
from microvib.signals.spectrum import complex_tone
from microvib.solve.motion import Motion


@dataclass(frozen=True)
class TorqueContribution:
    """One torque over a record [N m]."""

    factor: float
    """Factor on the housing; 1 for T_d itself and for torques that are not in its sum."""
    mean: float
    rms: float
    """About the mean."""
    peak: float
    """Largest absolute value."""
    tones: np.ndarray
    """Complex amplitudes at the frequencies asked for, (k,); phases are those of cosines at the
    first sample.
    """

    @property
    def on_housing(self) -> TorqueContribution:
        """Contribution as it acts on the housing."""
        f = self.factor
        return TorqueContribution(
            1.0, f * self.mean, abs(f) * self.rms, abs(f) * self.peak, f * self.tones
        )


def housing_factors(scenario: Scenario) -> dict[str, float]:
    """Factor of each torque on the housing, by channel: T_d = -T_e + T_f,m + T_f - (1 + 1/h) T_g."""
    return {"T_e": -1.0, "T_f_m": 1.0, "T_f": 1.0, "T_g": -1.0 - 1.0 / scenario.reducer.h}


def torque_budget(motion: Motion, frequencies: Sequence[float]) -> dict[str, TorqueContribution]:
    """T_d, the torques that add up to it, and the array's load, by channel; tones at each of the
    ``frequencies`` [Hz].
    """
    parts = {"T_d": 1.0, **housing_factors(motion.scenario), "T_l": 1.0}
    torques = np.array([motion[name] for name in parts])
    tones = (
        np.array([complex_tone(torques, motion.sample_rate, f) for f in frequencies])
        .reshape(-1, len(parts))
        .T
    )
    return {
        name: TorqueContribution(
            factor, float(x.mean()), float(x.std()), float(np.abs(x).max()), at
        )
        for (name, factor), x, at in zip(parts.items(), torques, tones, strict=True)
    }
