"""A virtual test bench, and what its six-component force table reads of given loads.

The chain, in order: suspension rope of the array, platform on its air springs, table on its
sensors, charge amplifier (a high-pass), noise and mains pick-up, anti-aliasing filter, converter
with its own clock. Each stage is linear but the last; the motion of table and platform is not fed
back to the drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from microvib.model.part import Part, Six
from microvib.model.rigid import COMPONENTS
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import Quantity

OVERSAMPLING = 4  # rate of the analog stages over that of the converter
MAX_SAMPLES = 20_000_000

Ratio = Annotated[float, Quantity("", "damping ratio", "zeta", ge=0, le=2, display="percent")]


class Resonance(Part):
    """One resonance along or about one axis of the table."""

    component: Literal["Fx", "Fy", "Fz", "Mx", "My", "Mz"] = Field(
        description="along or about which axis"
    )
    frequency: Annotated[float, Quantity("Hz", "natural frequency", gt=0)]
    damping: Annotated[
        float, Quantity("", "damping ratio", "zeta", ge=1e-3, le=2, display="percent")
    ]
    share: Annotated[float, Quantity("", "fraction of the load that it carries", ge=0, le=1)] = 1.0


class Rope(Part):
    """The rope that carries the array against gravity."""

    length: Annotated[float, Quantity("m", "length", gt=0)]
    mass: Annotated[float, Quantity("kg", "suspended mass", gt=0)]
    sway: Annotated[
        float,
        Quantity("m", "amplitude of the sway at the start of the recording", ge=0, display="mm"),
    ]
    damping: Ratio
    torsional_stiffness: Annotated[
        float, Quantity("N*m/rad", "torsional stiffness about the drive axis", ge=0)
    ]


class Bench(Part):
    """A force table, its surroundings and its data acquisition."""

    title: str = Field(default="", max_length=500, description="short title")
    source: str = Field(default="", max_length=2000, description="source of the values")
    table: tuple[Resonance, ...] = Field(
        default=(), max_length=60, description="resonances of table and sensors: they amplify"
    )
    platform: tuple[Resonance, ...] = Field(
        default=(),
        max_length=60,
        description="rigid-body modes on the air springs; share is moving mass over platform's",
    )
    rope: Rope | None = None
    high_pass: Annotated[float, Quantity("Hz", "corner of the charge amplifiers", ge=0)] = 0.0
    force_noise: Annotated[
        float, Quantity("N/Hz^0.5", "noise density of the force channels", ge=0)
    ] = 0.0
    torque_noise: Annotated[
        float, Quantity("N*m/Hz^0.5", "noise density of the torque channels", ge=0)
    ] = 0.0
    noise_corner: Annotated[
        float, Quantity("Hz", "below it the noise power grows with 1/f", ge=0)
    ] = 0.0
    mains: Annotated[float, Quantity("Hz", "frequency of the mains", gt=0)] = 50.0
    mains_torque: Annotated[
        float, Quantity("N*m", "mains pick-up of the torque channels", ge=0)
    ] = 0.0
    mains_force: Annotated[float, Quantity("N", "mains pick-up of the force channels", ge=0)] = 0.0
    cross_talk: tuple[Six, Six, Six, Six, Six, Six] | None = Field(
        default=None, description="6 x 6 matrix: readings Fx Fy Fz Mx My Mz = matrix x loads"
    )
    filter_corner: (
        Annotated[float, Quantity("Hz", "corner of the anti-aliasing filter (Butterworth)", gt=0)]
        | None
    ) = None
    filter_order: int = Field(
        default=8, ge=1, le=12, description="order of the anti-aliasing filter"
    )
    force_range: Annotated[
        float, Quantity("N", "largest force the converter takes, either sign", gt=0)
    ] = 1000.0
    torque_range: Annotated[
        float, Quantity("N*m", "largest torque the converter takes, either sign", gt=0)
    ] = 100.0
    bits: int | None = Field(
        default=None, ge=4, le=32, description="resolution of the converter; none: not rounded"
    )
    clock_error: Annotated[
        float, Quantity("", "converter's clock over its nominal rate, less one", ge=-0.01, le=0.01)
    ] = 0.0
    sample_rate: Annotated[float, Quantity("Hz", "nominal sample rate", gt=0)] = 4096.0
    duration: Annotated[float, Quantity("s", "length of the recording", gt=0)] = 16.0
    lead: Annotated[
        float,
        Quantity("s", "time before the recording in which amplifiers and filters settle", ge=0),
    ] = 4.0

    def _consistency_errors(self) -> Iterator[str]:
        for name in ("table", "platform"):
            for k, resonance in enumerate(getattr(self, name)):
                if resonance.frequency >= self.sample_rate:
                    yield f"{name}.{k}.frequency: {resonance.frequency:g} Hz is not below the sample rate, {self.sample_rate:g} Hz"
        if self.filter_corner is not None and self.filter_corner >= 0.5 * self.sample_rate:
            yield (
                f"filter_corner: {self.filter_corner:g} Hz is not below half the sample rate,"
                f" {0.5 * self.sample_rate:g} Hz;"
                " it could not prevent aliasing"
            )
        if self.sample_rate * (self.lead + self.duration) * OVERSAMPLING > MAX_SAMPLES:
            yield (
                f"duration: {self.duration:g} s at {self.sample_rate:g} Hz is too much; a recording"
                " has at most"
                f" {MAX_SAMPLES // OVERSAMPLING} samples"
            )

    @property
    def samples(self) -> int:
        """Samples of each channel."""
        return round(self.duration * self.sample_rate)

    @property
    def analog_rate(self) -> float:
        """Rate [Hz] at which the loads are needed and the analog stages are computed."""
        return OVERSAMPLING * self.sample_rate

    @property
    def span(self) -> float:
        """Time [s] that the loads must cover: lead, recording, and a little for a clock that runs
        slow.
        """
        return self.lead + self.duration / (1.0 + self.clock_error) + 8.0 / self.sample_rate


GRAVITY = 9.80665
MAX_RINGING_TIME = 120.0  # seconds after which a resonance is taken to have rung down


def measure(
    bench: Bench, loads: np.ndarray, twist: np.ndarray, drive_axis: str = "z", seed: int = 1
) -> Recording:
    """Recording by ``bench`` of ``loads`` (6, n) [N, N m], given at ``bench.analog_rate`` over
    ``bench.span``.

    ``twist`` (n,) [rad] is the angle of the array, which twists its rope. The same ``seed`` gives
    the same noise.
    """
    if loads.shape != (6, twist.size) or twist.size < bench.span * bench.analog_rate - 1:
        raise RecordingError(
            f"bench: loads of shape (6, {math.ceil(bench.span * bench.analog_rate)}) are expected,"
            f" not {loads.shape}"
        )
    rng = np.random.default_rng(seed)
    x = loads + _rope(bench, twist, drive_axis, rng)
    for resonance in bench.platform:
        _filter_component(x, bench.analog_rate, resonance, _platform)
    for resonance in bench.table:
        _filter_component(x, bench.analog_rate, resonance, _table)
    if bench.cross_talk is not None:
        x = np.array(bench.cross_talk) @ x
    if bench.high_pass > 0.0:  # charge amplifiers, reset at the start of the lead
        x = _butterworth(x - x[:, :1], 1, bench.high_pass, "highpass", bench.analog_rate)
    x = x + _noise(bench, x.shape[1], rng)
    if bench.filter_corner is not None:
        x = _butterworth(x, bench.filter_order, bench.filter_corner, "lowpass", bench.analog_rate)
    notes = [f"virtual bench: {bench.title or 'without a title'}, seed {seed}"]
    channels = dict(zip(COMPONENTS, _digitise(x, bench, notes), strict=True))
    units = {name: "N" if name.startswith("F") else "N*m" for name in COMPONENTS}
    return Recording(channels, bench.sample_rate, units, bench.title, tuple(notes))


def _rope(bench: Bench, twist: np.ndarray, drive_axis: str, rng: np.random.Generator) -> np.ndarray:
    """Pendulum forces across the drive axis, and the torque of the twisted rope about it, (6, n)."""
    out = np.zeros((6, twist.size))
    if bench.rope is None:
        return out
    rope, axis = bench.rope, "xyz".index(drive_axis)
    omega = math.sqrt(GRAVITY / rope.length)
    t = np.arange(twist.size) / bench.analog_rate - bench.lead
    phase = omega * math.sqrt(max(1.0 - rope.damping**2, 0.0)) * t + rng.uniform(0.0, 2.0 * math.pi)
    pull = rope.mass * omega**2 * rope.sway * np.exp(-rope.damping * omega * t)
    out[(axis + 1) % 3], out[(axis + 2) % 3] = pull * np.cos(phase), pull * np.sin(phase)
    out[3 + axis] = -rope.torsional_stiffness * twist
    return out


def _table(s: np.ndarray, w: float, resonance: Resonance) -> np.ndarray:
    """Reading over load: the share that goes through the resonance is amplified."""
    return (
        resonance.share * w * w / (s * s + 2.0 * resonance.damping * w * s + w * w)
        + 1.0
        - resonance.share
    )


def _platform(s: np.ndarray, w: float, resonance: Resonance) -> np.ndarray:
    """Reading over load: what moves above the sensors takes its share of the load above the
    resonance.
    """
    return 1.0 - resonance.share * s * s / (s * s + 2.0 * resonance.damping * w * s + w * w)


Transfer = Callable[[np.ndarray, float, Resonance], np.ndarray]


def _filter_component(x: np.ndarray, rate: float, resonance: Resonance, transfer: Transfer) -> None:
    """One component of ``x`` through an analog resonance, in place; it starts in equilibrium with
    its first value.

    Computed in the frequency domain, exact up to half the rate; the padding takes what rings on
    after the end, at least.
    """
    from scipy.fft import next_fast_len

    row = x[COMPONENTS.index(resonance.component)]
    w = 2.0 * math.pi * resonance.frequency
    ringing = min(12.0 / (resonance.damping * w), MAX_RINGING_TIME)
    size = next_fast_len(row.size + math.ceil(ringing * rate), real=True)
    s = 2j * math.pi * np.fft.rfftfreq(size, 1.0 / rate)
    start = row[0]
    row[:] = (
        start
        + np.fft.irfft(np.fft.rfft(row - start, size) * transfer(s, w, resonance), size)[: row.size]
    )


def _butterworth(x: np.ndarray, order: int, corner: float, kind: str, rate: float) -> np.ndarray:
    from scipy.signal import butter, sosfilt

    return sosfilt(butter(order, corner, kind, fs=rate, output="sos"), x, axis=1)


def _noise(bench: Bench, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of given density with its 1/f part, and mains pick-up, (6, n)."""
    rate = bench.analog_rate
    white = rng.normal(size=(6, samples)) * math.sqrt(0.5 * rate)
    white *= np.array([bench.force_noise] * 3 + [bench.torque_noise] * 3)[:, None]
    if bench.noise_corner > 0.0:
        f = np.fft.rfftfreq(samples, 1.0 / rate)
        f[0] = f[1]
        white[:] = np.fft.irfft(np.fft.rfft(white) * np.sqrt(1.0 + bench.noise_corner / f), samples)
    angle = 2.0 * np.pi * bench.mains * np.arange(samples) / rate + rng.uniform(
        0.0, 2.0 * np.pi, (6, 1)
    )
    pick_up: np.ndarray = np.array([bench.mains_force] * 3 + [bench.mains_torque] * 3)[
        :, None
    ] * np.sin(angle)
    return white + pick_up


def _digitise(x: np.ndarray, bench: Bench, notes: list[str]) -> np.ndarray:
    """Samples at the converter's own clock, rounded and clipped as it does, (6, samples)."""
    first = round(bench.lead * bench.analog_rate)
    if bench.clock_error == 0.0:
        out = x[:, first : first + OVERSAMPLING * bench.samples : OVERSAMPLING].copy()
    else:
        from scipy.interpolate import CubicSpline

        at = first + np.arange(bench.samples) * OVERSAMPLING / (1.0 + bench.clock_error)
        out = CubicSpline(np.arange(x.shape[1]), x, axis=1)(at)
        notes.append(f"converter's clock {1e6 * bench.clock_error:+g} ppm off")
    limit = np.array([bench.force_range] * 3 + [bench.torque_range] * 3)[:, None]
    if bench.bits is not None:
        step = 2.0 * limit / 2**bench.bits
        out = np.round(out / step) * step
    clipped = [
        name
        for name, over in zip(COMPONENTS, np.any(np.abs(out) > limit, axis=1), strict=True)
        if over
    ]
    if clipped:
        notes.append(f"clipped at the range of the converter: {', '.join(clipped)}")
    return np.clip(out, -limit, limit)
