"""Power spectral densities of what a hub feels and does, and what they add up to from either end,
as a table.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from microvib.io.tables import columns_csv
from microvib.model.rigid import COMPONENTS
from microvib.signals.pointing import cumulative_rms
from microvib.signals.spectrum import power_spectral_density
from microvib.solve.motion import Motion

POINTS = 20
"""Named points whose accelerations are in the table, at most; a motion tells those of all."""
_AXES = ("x", "y", "z")


def densities_csv(motion: Motion) -> str:
    """Densities (Hann, bins 8 / record) and cumulative rms, upwards and downwards, by frequency
    [Hz].
    """
    columns: dict[str, np.ndarray] = {}
    for name, unit, samples in _channels(motion):
        found = power_spectral_density(samples, motion.sample_rate)
        f, density = found.frequency, found.density
        if (
            unit == "rad"
        ):  # from accelerations, which no drift leaks into; the first bins would be drift over f^4
            density = (
                np.where(f >= 3.0 * f[1], density, 0.0) / (2.0 * np.pi * np.maximum(f, f[1])) ** 4
            )
        columns |= {
            "frequency_hz": f,
            f"{name}_psd_{unit}2_hz": density,
            f"{name}_rms_up_{unit}": cumulative_rms(f, density),
            f"{name}_rms_down_{unit}": cumulative_rms(f, density, falling=True),
        }
    return columns_csv(columns)


def _channels(motion: Motion) -> Iterator[tuple[str, str, np.ndarray]]:
    """Name, unit and samples (n,): loads at the interface, the line of sight's accelerations,
    accelerations of points.
    """
    spacecraft = motion.scenario.spacecraft
    assert spacecraft is not None
    for name in COMPONENTS:
        yield name.lower(), "n" if name.startswith("F") else "n_m", motion[name]
    if spacecraft.line_of_sight is not None:
        yield from ((f"los_{axis}", "rad", motion[f"los_a{axis}"]) for axis in "xy")
    for point in spacecraft.points[:POINTS]:
        moved = motion.hub(point, accelerations=True)
        yield from ((f"{point}_a{axis}", "m_s2", moved[:, k]) for k, axis in enumerate(_AXES))
        yield from (
            (f"{point}_alpha_{axis}", "rad_s2", moved[:, 3 + k]) for k, axis in enumerate(_AXES)
        )
