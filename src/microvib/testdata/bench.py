"""A virtual test bench, and what its six-component force table reads of given loads.

The chain, in order: suspension rope of the array, platform on its air springs, table on its
sensors, charge amplifier (a high-pass), noise and mains pick-up, anti-aliasing filter, converter
with its own clock. Each stage is linear but the last; the motion of table and platform is not fed
back to the drive.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from microvib.model.part import Part, Six
from microvib.model.rigid import COMPONENTS
from microvib.testdata.bench_parts import (
    ChannelDensity,
    ChannelRms,
    MainsHarmonic,
    Mounted,
    Resonance,
    UsableBand,
    six_of,
    table_response,
)
from microvib.testdata.force_table import LARGEST_BIAS, ForceTable
from microvib.testdata.moved import moving_matrix, with_moved_torques
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import Quantity

OVERSAMPLING = 4  # rate of the analog stages over that of the converter
MAX_SAMPLES = 20_000_000

Ratio = Annotated[float, Quantity("", "damping ratio", "zeta", ge=0, le=2, display="percent")]


Coordinate = Annotated[float, Quantity("m", "coordinate")]


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
    mounted: Mounted | None = Field(
        default=None, description="what is bolted to the table: it lowers its resonances"
    )
    usable: UsableBand | None = Field(
        default=None, description="band in which the table is used; none: all that resonances leave"
    )
    largest_bias: Annotated[
        float,
        Quantity(
            "",
            "part by which resonances may change a reading that is judged",
            gt=0,
            le=1,
            display="percent",
        ),
    ] = LARGEST_BIAS
    offset: tuple[Coordinate, Coordinate, Coordinate] | None = Field(
        default=None,
        description="position of the interface point in the table's frame; none: at its origin",
    )
    torques_about: Literal["table", "interface"] = Field(
        default="table",
        description="point that recorded torques are about: the table's origin, or the interface, to which they are moved",
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
    noise_rms: ChannelRms | None = Field(
        default=None, description="noise of the readings of single channels, as RMS in a band"
    )
    noise_density: ChannelDensity | None = Field(
        default=None, description="noise of the readings of single channels, as density"
    )
    mains: Annotated[float, Quantity("Hz", "frequency of the mains", gt=0)] = 50.0
    mains_torque: Annotated[
        float, Quantity("N*m", "mains pick-up of the torque channels", ge=0)
    ] = 0.0
    mains_force: Annotated[float, Quantity("N", "mains pick-up of the force channels", ge=0)] = 0.0
    pick_up: tuple[MainsHarmonic, ...] = Field(
        default=(),
        max_length=100,
        description="mains pick-up of single channels and at multiples of its frequency",
    )
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
        yield from _platform_errors(self)
        yield from _mounted_errors(self)
        yield from _noise_errors(self)
        yield from _pick_up_errors(self)
        yield from _band_and_point_errors(self)
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
    def loaded_table(self) -> tuple[Resonance, ...]:
        """Resonances of the table under what is mounted on it."""
        return tuple(one.under(self.mounted) for one in self.table)

    @property
    def reading_noise(self) -> np.ndarray:
        """Densities above ``noise_corner`` of the noise of single channels' readings, (6,)
        [N/Hz^0.5, N m/Hz^0.5]; 0 without.
        """
        density = np.zeros(6)
        if self.noise_rms is not None:
            density += np.nan_to_num(self.noise_rms.densities(self.noise_corner))
        if self.noise_density is not None:
            density += np.nan_to_num(six_of(self.noise_density))
        return density

    @property
    def force_table(self) -> ForceTable:
        """The table as its readings have it, for those who analyse them."""
        density = np.array([self.force_noise] * 3 + [self.torque_noise] * 3)
        band, usable = (0.0, 0.5 * self.sample_rate), (0.0, math.inf)
        if self.noise_rms is not None:
            band = (self.noise_rms.lowest, self.noise_rms.highest)
        if self.usable is not None:
            usable = (self.usable.lowest, self.usable.highest)
        table = ForceTable(
            self.title or "the table",
            self.loaded_table,
            usable,
            self.largest_bias,
            np.diag(density**2 + self.reading_noise**2),
            self.noise_corner,
            band,
        )
        if self.torques_about == "table" or self.offset is None:
            return table
        A = moving_matrix(self.offset)
        return table.combined(A, A != 0.0)

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


def _platform_errors(bench: Bench) -> Iterator[str]:
    for k, one in enumerate(bench.platform):
        if one.moving is not None:
            name = "table_mass" if one.table_mass is not None else "table_inertia"
            yield f"platform.{k}.{name}: applies to resonances of the table; leave it out"


def _mounted_errors(bench: Bench) -> Iterator[str]:
    """Resonances of which it is not known by how much what is mounted lowers them."""
    if bench.mounted is None:
        return
    for k, one in enumerate(bench.table):
        if one.moving is None and bench.mounted.along(one.component) > 0.0:
            name, unit = (
                ("table_mass", "kg") if one.component[0] == "F" else ("table_inertia", "kg*m^2")
            )
            yield (
                f"table.{k}.{name}: missing, in {unit}; mounted lowers this resonance by what moves"
                " in it when the table is empty"
            )


def _noise_errors(bench: Bench) -> Iterator[str]:
    rms, density = bench.noise_rms, bench.noise_density
    if rms is not None and bench.noise_corner > 0.0 and rms.lowest == 0.0:
        yield (
            "noise_rms.lowest: 0 Hz does not go with noise_corner, since noise that grows with 1/f"
            " has no RMS down to 0 Hz; greater than 0 Hz is allowed"
        )
    for name in COMPONENTS:
        common = "force_noise" if name.startswith("F") else "torque_noise"
        given = [
            *(["noise_rms"] if rms is not None and getattr(rms, name) is not None else []),
            *(
                ["noise_density"]
                if density is not None and getattr(density, name) is not None
                else []
            ),
            *([common] if getattr(bench, common) > 0.0 else []),
        ]
        if len(given) > 1:
            yield f"{given[0]}.{name}: {given[1]} states noise of {name}, too; leave one of them out"


def _pick_up_errors(bench: Bench) -> Iterator[str]:
    for harmonic, count in Counter(one.harmonic for one in bench.pick_up).items():
        if count > 1:
            yield f"pick_up: harmonic {harmonic} is listed {count} times; list it once"
    for k, one in enumerate(bench.pick_up):
        if one.harmonic * bench.mains >= 0.5 * bench.sample_rate:
            yield (
                f"pick_up.{k}.harmonic: {one.harmonic * bench.mains:g} Hz is not below half the"
                f" sample rate, {0.5 * bench.sample_rate:g} Hz"
            )
        for name, size in zip(COMPONENTS, six_of(one), strict=True):
            common = "mains_force" if name.startswith("F") else "mains_torque"
            if one.harmonic == 1 and size > 0.0 and getattr(bench, common) > 0.0:
                yield f"pick_up.{k}.{name}: {common} states it, too; leave one of them out"


def _band_and_point_errors(bench: Bench) -> Iterator[str]:
    if bench.usable is not None and bench.usable.highest > 0.5 * bench.sample_rate:
        yield (
            f"usable.highest: {bench.usable.highest:g} Hz is above half the sample rate,"
            f" {0.5 * bench.sample_rate:g} Hz"
        )
    if bench.torques_about == "interface" and bench.offset is None:
        yield "torques_about: interface needs offset, the interface's position in the table's frame"


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
    stages = _Stages(bench, loads)
    x = loads + _rope(bench, twist, drive_axis, rng)
    stages.done("suspension rope", x)
    if bench.offset is not None:
        x = moving_matrix([-r for r in bench.offset]) @ x
        stages.done("moving to the table's origin", x)
    _filter_components(x, bench.analog_rate, bench.platform, _platform)
    stages.done("platform", x)
    _filter_components(x, bench.analog_rate, bench.loaded_table, table_response)
    stages.done("table resonances", x)
    if bench.cross_talk is not None:
        x = np.array(bench.cross_talk) @ x
        stages.done("cross-talk", x)
    if bench.high_pass > 0.0:  # charge amplifiers, reset at the start of the lead
        x = _butterworth(x - x[:, :1], 1, bench.high_pass, "highpass", bench.analog_rate)
    x = x + _noise(bench, x.shape[1], rng)
    if bench.filter_corner is not None:
        x = _butterworth(x, bench.filter_order, bench.filter_corner, "lowpass", bench.analog_rate)
    notes = [f"virtual bench: {bench.title or 'without a title'}, seed {seed}"]
    readings = _digitise(x, bench, seed, notes)
    stages.recorded("noise, pick-up and filters", readings)
    notes += [*_mass_notes(bench), *_noise_notes(bench), *stages.notes()]
    return _as_recording(bench, readings, notes)


def _as_recording(bench: Bench, readings: np.ndarray, notes: list[str]) -> Recording:
    """Readings (6, samples) about the point that the bench records torques about."""
    channels = dict(zip(COMPONENTS, readings, strict=True))
    units = {name: "N" if name.startswith("F") else "N*m" for name in COMPONENTS}
    at_table = bench.model_copy(update={"torques_about": "table"}).force_table
    recording = Recording(
        channels, bench.sample_rate, units, bench.title, tuple(notes), table=at_table
    )
    if bench.offset is None:
        return recording
    if bench.torques_about == "interface":
        return with_moved_torques(recording, bench.offset)
    return recording.noted(
        "torques are about the table's origin; to move them to the interface, write offset:"
        f" {list(bench.offset)} in the preparation file"
    )


class _Stages:
    """RMS about the mean of the six components after each stage of a bench."""

    def __init__(self, bench: Bench, loads: np.ndarray) -> None:
        self._lead = round(bench.lead * bench.analog_rate)
        self._after: list[tuple[str, np.ndarray]] = []
        self.done("load", loads)

    def done(self, stage: str, x: np.ndarray) -> None:
        """Note what an analog stage made of the components, (6, n) with the lead."""
        self.recorded(stage, x[:, self._lead :])

    def recorded(self, stage: str, x: np.ndarray) -> None:
        """Note what a stage made of the components, (6, n) without the lead."""
        self._after.append((stage, np.array([row.std() for row in x])))

    def notes(self) -> Iterator[str]:
        """Sentences on components whose RMS the bench changes, by which stage."""
        load, read = self._after[0][1], self._after[-1][1]
        for k, name in enumerate(COMPONENTS):
            if not load[k] > 0.0 or abs(read[k] / load[k] - 1.0) < _TOLD_CHANGE:
                continue
            steps = zip(self._after[:-1], self._after[1:], strict=True)
            told = [
                f"{1e3 * after[k]:.3g} after {stage}"
                for (_, before), (stage, after) in steps
                if abs(after[k] - before[k]) > 0.5 * _TOLD_CHANGE * before[k]
            ]
            unit = "mN" if name.startswith("F") else "mN m"
            yield f"{name}: the load has {1e3 * load[k]:.3g} {unit} RMS, its reading {', '.join(told)}"


_TOLD_CHANGE = 0.1
"""Part by which the bench changes a component's RMS from which it is told."""


def _mass_notes(bench: Bench) -> Iterator[str]:
    """A note on the table's resonances under the mounted mass."""
    if bench.mounted is None:
        return
    moved = [
        f"{one.component} {empty.frequency:.4g} to {one.frequency:.4g} Hz"
        for empty, one in zip(bench.table, bench.loaded_table, strict=True)
        if one.frequency != empty.frequency
    ]
    kept = [one.component for one in bench.loaded_table if not bench.mounted.along(one.component)]
    text = f"{bench.mounted.mass:g} kg mounted lowers the table's resonances: {', '.join(moved)}"
    if kept:
        text += f"; those of {', '.join(dict.fromkeys(kept))} as empty, since no inertia is given"
    yield text


def _noise_notes(bench: Bench) -> Iterator[str]:
    """A note on noise beyond the band in which its RMS is declared."""
    rms = bench.noise_rms
    if rms is not None and rms.highest < 0.5 * bench.sample_rate:
        yield (
            f"noise declared from {rms.lowest:g} to {rms.highest:g} Hz is taken to go on up to"
            f" {0.5 * bench.sample_rate:g} Hz with the same density"
        )


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


def _platform(s: np.ndarray, w: float, resonance: Resonance) -> np.ndarray:
    """Reading over load: what moves above the sensors takes its share of the load above the
    resonance.
    """
    return 1.0 - resonance.share * s * s / (s * s + 2.0 * resonance.damping * w * s + w * w)


Transfer = Callable[[np.ndarray, float, Resonance], np.ndarray]


def _filter_components(
    x: np.ndarray, rate: float, resonances: Sequence[Resonance], transfer: Transfer
) -> None:
    """Components (6, n) through the resonances of one stage, in place."""
    for resonance in resonances:
        _filter_component(x, rate, resonance, transfer)


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


def _reading_noise(bench: Bench, seed: int) -> np.ndarray:
    """Noise and mains pick-up of single channels as they are read, (6, samples).

    Its densities are those of the samples, at any sample rate: it is added behind the filter, and
    nothing of it is aliased. The draw is another one than that of the analog stages.
    """
    rng, rate, n = np.random.default_rng([seed, 1]), bench.sample_rate, bench.samples
    x = rng.normal(size=(6, n)) * math.sqrt(0.5 * rate)
    if bench.noise_corner > 0.0:
        longer = np.concatenate([x, rng.normal(size=(6, n)) * math.sqrt(0.5 * rate)], axis=1)
        f = np.fft.rfftfreq(2 * n, 1.0 / rate)
        f[0] = f[1]
        gain = np.sqrt(1.0 + bench.noise_corner / f)
        x = np.fft.irfft(np.fft.rfft(longer) * gain, 2 * n)[:, :n]
    x = x * bench.reading_noise[:, None]
    t = np.arange(n) / (rate * (1.0 + bench.clock_error))
    for one in bench.pick_up:
        phase = rng.uniform(0.0, 2.0 * np.pi, (6, 1))
        x += six_of(one)[:, None] * np.sin(
            2.0 * np.pi * one.harmonic * bench.mains * t[None, :] + phase
        )
    return x


def _digitise(x: np.ndarray, bench: Bench, seed: int, notes: list[str]) -> np.ndarray:
    """Samples at the converter's own clock, rounded and clipped as it does, (6, samples)."""
    first = round(bench.lead * bench.analog_rate)
    if bench.clock_error == 0.0:
        out = x[:, first : first + OVERSAMPLING * bench.samples : OVERSAMPLING].copy()
    else:
        from scipy.interpolate import CubicSpline

        at = first + np.arange(bench.samples) * OVERSAMPLING / (1.0 + bench.clock_error)
        out = CubicSpline(np.arange(x.shape[1]), x, axis=1)(at)
        notes.append(f"converter's clock {1e6 * bench.clock_error:+g} ppm off")
    if bench.pick_up or np.any(bench.reading_noise > 0.0):
        out = out + _reading_noise(bench, seed)
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
