"""Waterfalls of a wheel that is known: harmonics, structural modes, noise and a mains line."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from microvib.signals.spectrum import window_values

RPM = 2.0 * np.pi / 60.0
KINDS = ("radial_force", "axial_force", "radial_torque", "axial_torque")
COEFFICIENTS = {
    "radial_force": {1.0: 2e-6, 2.0: 8e-7, 3.16: 6e-7, 5.6: 5e-7},
    "axial_force": {1.0: 3e-7, 2.0: 7e-7, 5.6: 4e-7},
    "radial_torque": {1.0: 4e-7, 2.0: 2e-7, 3.16: 1.5e-7, 5.6: 1e-7},
    "axial_torque": {2.0: 1e-7},
}
"""Of harmonics by order [N s^2/rad^2, N m s^2/rad^2]."""
NOISE = {"radial_force": 4e-3, "axial_force": 4e-3, "radial_torque": 8e-4, "axial_torque": 8e-4}
"""Standard deviation of the samples [N, N m]."""


@dataclass
class KnownWheel:
    """A wheel on a table: what its waterfalls are made of."""

    coefficients: dict[str, dict[float, float]] = field(default_factory=lambda: COEFFICIENTS)
    rocking: tuple[float, float, float] | None = (85.0, 0.01, 1.6)
    """Frequency [Hz], damping and ratio of moments of inertia."""
    radial: tuple[float, float] | None = (190.0, 0.01)
    axial: tuple[float, float] | None = (120.0, 0.012)
    ways: dict[float, float] = field(
        default_factory=lambda: {1.0: 1.0, 2.0: -1.0, 3.16: -1.0, 5.6: 1.0}
    )
    """Direction in which each order goes round: 1 with the wheel, -1 against it."""
    noise: dict[str, float] = field(default_factory=lambda: NOISE)
    mains: float = 2e-3
    """Amplitude of a line at 50 Hz [N, N m]."""
    scatter: float = 0.0
    """Standard deviation of the coefficients from speed to speed, over themselves."""
    excited: float = 0.0
    """Noise that the rocking mode answers, over that of the table."""

    def factor(self, kind: str, order: float, speed: float) -> float:
        """By how much the modes amplify a load."""
        w = order * speed
        if kind == "radial_torque" and self.rocking:
            f0, xi, r = self.rocking
            w0 = 2.0 * np.pi * f0
            stiff = w0**2 + 2j * xi * w0 * w
            return abs(stiff / (stiff - w**2 + self.ways[order] * r * speed * w))
        mode = {"radial_force": self.radial, "axial_force": self.axial}.get(kind)
        if not mode:
            return 1.0
        w0, xi = 2.0 * np.pi * mode[0], mode[1]
        stiff = w0**2 + 2j * xi * w0 * w
        return abs(stiff / (stiff - w**2))

    def waterfall(
        self, kind: str, speeds: np.ndarray, rate: float, samples: int, rng: np.random.Generator,
        *, averages: int = 4, scaling: str = "peak", window: str = "hann",
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Frequencies (m,) [Hz] and spectra (n, m) at speeds (n,) [rad/s]: amplitudes 0-to-peak or rms,
        or densities.
        """
        t, win = np.arange(samples) / rate, window_values(window, samples)
        f = np.fft.rfftfreq(samples, 1.0 / rate)
        each = []
        for speed in speeds:
            total = 0.0
            own = 1.0 + self.scatter * rng.standard_normal(20)
            for _ in range(averages):
                x = self.noise[kind] * rng.standard_normal(samples)
                x += self.mains * np.cos(2.0 * np.pi * 50.0 * t + rng.uniform(0, 7))
                for part, (order, c) in zip(
                    own, self.coefficients.get(kind, {}).items(), strict=False
                ):
                    size = part * c * speed**2 * self.factor(kind, order, speed)
                    x += size * np.cos(order * speed * t + rng.uniform(0, 7))
                X = np.fft.rfft(x * win)
                if self.excited and kind == "radial_torque" and self.rocking:
                    X = X + self._answer(f, speed, rng) * self.noise[kind] * np.sqrt(np.sum(win**2))
                total = total + np.abs(X) ** 2
            power = total / averages
            if scaling == "psd":
                each.append(2.0 * power / (rate * np.sum(win**2)))
            else:
                peak = 2.0 * np.sqrt(power) / np.sum(win)
                each.append(peak if scaling == "peak" else peak / np.sqrt(2.0))
        return f, np.array(each)

    def _answer(self, f: np.ndarray, speed: float, rng: np.random.Generator) -> np.ndarray:
        """Spectrum of a rocking mode that noise excites, 1 at rest and below it."""
        f0, xi, r = self.rocking or (1.0, 0.01, 0.0)
        w, w0 = 2.0 * np.pi * f, 2.0 * np.pi * f0
        total = np.zeros(f.size, dtype=complex)
        for way in (1.0, -1.0):
            noise = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
            total += noise * w0**2 / (w0**2 - w**2 + way * r * speed * w + 2j * xi * w0 * w)
        return self.excited * total


def write_matrix(
    path: Path, speeds: np.ndarray, values: np.ndarray, f: np.ndarray, *,
    corner: str = "rpm \\ Hz", unit: float = RPM, turned: bool = False,
) -> Path:  # fmt: skip
    """Write spectra (n, m) as a matrix in CSV, with speeds (n,) [rad/s] in ``unit`` and frequencies
    (m,) [Hz], speeds in the first row where it is ``turned``.
    """
    table = np.column_stack([speeds / unit, values])
    table = np.vstack([np.r_[0.0, f], table])
    if turned:
        table = table.T
    rows = [",".join(f"{x:.9g}" for x in row) for row in table.tolist()]
    rows[0] = ",".join([corner, *rows[0].split(",")[1:]])
    path.write_text("\n".join(rows) + "\n")
    return path
