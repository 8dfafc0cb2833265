"""Powers of a wheel's loads over speed and frequency, from matrices of test software or a run-up."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from microvib.errors import MicrovibError, OptionError
from microvib.io.recordings import read_recording
from microvib.io.waterfall_files import ENDINGS, SpectraOverSpeed, read_waterfall
from microvib.signals.ridges import PowerMap
from microvib.signals.spectrum import Window, noise_bandwidth, window_values
from microvib.studies.speed_reference import of_tacho
from microvib.units import GivenQuantity, convert, quantity

LOADS = ("radial_force", "axial_force", "radial_torque", "axial_torque")
SPEED_UNITS = {
    "rpm": 2.0 * np.pi / 60.0,
    "rad/s": 1.0,
    "rps": 2.0 * np.pi,
    "deg/s": np.pi / 180.0,
}
AMPLITUDES = ("peak", "rms", "power", "psd")
"""Amplitudes 0-to-peak, rms, squares of the rms, or densities."""
LOBES: dict[Window, int] = {"rectangular": 6, "hann": 2, "flat-top": 4}
"""Bins on either side of a line that hold its power."""
_SPEED_WORDS = {
    "rpm": "rpm", "1/min": "rpm", "min-1": "rpm", "r/min": "rpm", "u/min": "rpm", "rev/min": "rpm",
    "rad/s": "rad/s", "rps": "rps", "rev/s": "rps", "1/s": "rps", "deg/s": "deg/s", "°/s": "deg/s",
}  # fmt: skip
"""Units of speeds as files have them, without blanks and brackets."""
_AMPLITUDE_WORD = re.compile(r"[\s_(\[]+(rms|peak|pk|0-pk)[)\]]?\s*$", re.I)
_NAMED = re.compile(rf"(.*?(?:{'|'.join(re.escape(x) for x in ENDINGS)}|\.\w+))(?::(.+))?", re.I)
_NEAR_HELD = 0.25
"""Part of the change of speed in a slice within which its ends are held speeds, and these are held."""
_SLICES = 0.5
"""Overlap of the slices of a run-up."""


@dataclass(frozen=True)
class Given:
    """Meaning of the numbers of matrices; None where it was not said."""

    speeds: str | None = None
    amplitude: str | None = None
    window: Window | None = None
    force_unit: str | None = None
    torque_unit: str | None = None
    layout: str | None = None


def maps_of_files(files: Mapping[str, Sequence[str]], given: Given) -> dict[str, PowerMap]:
    """Powers of each load from its files, ``FILE`` or ``FILE:NAME``, two of which are both axes across the
    spin axis.

    OptionError where it was not said what the numbers are; MicrovibError where files do not go together.
    """
    _require_stated(files, given)
    read = {
        load: [(text, read_waterfall(*_file_and_name(text), given.layout)) for text in texts]
        for load, texts in files.items()
        if texts
    }
    _require_alike([one for each in read.values() for one in each])
    _require_stated_units(read, given)
    found, window = {}, given.window or "hann"
    for load, each in read.items():
        unit = given.torque_unit if load.endswith("torque") else given.force_unit
        size = convert(f"1 {unit}", "N*m" if load.endswith("torque") else "N")
        powers = [_power(one, given, size) for _, one in each]
        first = each[0][1]
        speed = first.speed * SPEED_UNITS[given.speeds or ""]
        found[load] = PowerMap(
            speed, first.frequency, np.mean(powers, axis=0), LOBES[window],
            axes=tuple(powers) if len(powers) > 1 else (), window=window,
        )  # fmt: skip
    return found


def _require_stated(files: Mapping[str, Sequence[str]], given: Given) -> None:
    """OptionError where it was not said what the numbers of matrices are."""
    if not any(files.values()):
        raise OptionError("radial_force", "no load is given; give the file of one or more")
    missing = {
        "speeds": (given.speeds, f"the unit of the speeds is not said; {_or(tuple(SPEED_UNITS))}"),
        "amplitude": (
            given.amplitude,
            "it is not said what the numbers are: peak (0-to-peak), rms, power (rms squared) or psd",
        ),
        "window": (given.window, f"the window of the spectra is not said; {_or(tuple(LOBES))}"),
    }
    for kind in ("force", "torque"):
        if any(texts for load, texts in files.items() if load.endswith(kind)):
            example = "N or mN" if kind == "force" else "N*m or mN*m"
            stated = given.force_unit if kind == "force" else given.torque_unit
            missing[f"{kind}_unit"] = (stated, f"the unit is not said, such as {example}")
    for key, (value, problem) in missing.items():
        if value is None:
            raise OptionError(key, problem)
    for load, texts in files.items():
        if len(texts) > (2 if load.startswith("radial") else 1):
            raise OptionError(
                load, "is given too often; a radial load has two axes, an axial one has one"
            )


def _require_stated_units(
    read: Mapping[str, Sequence[tuple[str, SpectraOverSpeed]]], given: Given
) -> None:
    """OptionError where a file says another unit of its speeds or values than was stated."""
    for load, each in read.items():
        for name, one in each:
            _require_same_units(name, one, given, load)


def _require_same_units(name: str, one: SpectraOverSpeed, given: Given, load: str) -> None:
    speeds = _SPEED_WORDS.get(re.sub(r"[\s().^]", "", one.speed_unit.lower()), "")
    if speeds and speeds != given.speeds:
        raise OptionError("speeds", f"is {given.speeds}, and {name} has them in {one.speed_unit}")
    if given.amplitude not in ("peak", "rms"):
        return
    key = "torque_unit" if load.endswith("torque") else "force_unit"
    stated = getattr(given, key)
    said = _AMPLITUDE_WORD.search(one.unit)
    if said is not None and (said[1].lower() == "rms") != (given.amplitude == "rms"):
        raise OptionError("amplitude", f"is {given.amplitude}, and {name} is in {one.unit}")
    unit = _AMPLITUDE_WORD.sub("", one.unit).strip()
    if unit and not _is_same(unit, stated, key):
        raise OptionError(key, f"is {stated}, and {name} is in {one.unit}")


def _is_same(unit: str, stated: str, key: str) -> bool:
    """Whether a unit that a file says is as large as the stated one; also where nobody knows it."""
    si = "N*m" if key == "torque_unit" else "N"
    try:
        return math.isclose(convert(f"1 {unit}", si), convert(f"1 {stated}", si), rel_tol=1e-6)
    except ValueError as why:
        return "unknown unit" in str(why) or "is not a quantity" in str(why)


def _or(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}"


def _file_and_name(text: str) -> tuple[Path, str | None]:
    found = _NAMED.fullmatch(text)
    if found is None:
        return Path(text), None
    return Path(found[1]), found[2]


def _require_alike(read: Sequence[tuple[str, SpectraOverSpeed]]) -> None:
    """MicrovibError where two files are not of the same speeds and frequencies."""
    (first_name, first), *others = read
    for name, one in others:
        for what in ("speed", "frequency"):
            a, b = getattr(first, what), getattr(one, what)
            if a.shape != b.shape or not np.allclose(a, b, rtol=1e-4):
                raise MicrovibError(
                    f"{name}: its values of {what} differ from those of {first_name}; all loads are to be from"
                    " one test"
                )


def _power(one: SpectraOverSpeed, given: Given, size: float) -> np.ndarray:
    """Half of the squared amplitudes by bin [N^2, N^2 m^2], (n, m)."""
    bandwidth = noise_bandwidth(given.window or "hann")
    values = one.values
    if given.amplitude == "psd":
        return np.asarray(values * size**2 * np.mean(np.diff(one.frequency)))
    if given.amplitude == "power":
        return np.asarray(values * size**2 / bandwidth)
    square = (values * size) ** 2 / bandwidth
    return np.asarray(0.5 * square if given.amplitude == "peak" else square)


# ---- Run-ups ----


def _crosses(slices: Sequence[np.ndarray], mean: np.ndarray) -> np.ndarray:
    """Slices in which the speed goes from one that is held in others to another such, (n,): at their mean
    speed the wheel hardly is, and the lines of both are beside those of the mean.
    """
    low, high = np.array([(x.min(), x.max()) for x in slices]).T
    spread = high - low
    found = np.zeros(mean.size, dtype=bool)
    for k, reach in enumerate(_NEAR_HELD * spread):
        held = mean[spread < reach]
        near = [np.any(np.abs(held - end) < reach) for end in (low[k], high[k])]
        found[k] = all(near)
    return found


def maps_of_recording(
    path: str,
    channels: Mapping[str, Sequence[str]],
    tacho: str,
    *,
    pulses_per_rev: float = 1.0,
    resolution: GivenQuantity = "1 Hz",
    highest: float = 0.45,
) -> dict[str, PowerMap]:
    """Powers of each load from its channels of a recorded run-up, or of speeds held one after the
    other, by slices of 1 / ``resolution``; up to a part ``highest`` of the sample rate.

    RecordingError where a channel is missing or the tacho has no pulses, OptionError where the record is
    too short.
    """
    if not any(channels.values()):
        raise OptionError("radial_force", "no load is given; name the channel of one or more")
    recording = read_recording(path)
    rate = recording.sample_rate
    width = quantity("resolution", resolution, "Hz", positive=True)
    samples = round(rate / width)
    reference = of_tacho(recording, tacho, pulses_per_rev)
    count = reference.phase.size
    starts = np.arange(0, count - samples + 1, max(int(samples * (1.0 - _SLICES)), 1))
    if starts.size < 8 or samples < 128:
        raise OptionError(
            "resolution",
            f"{width:g} Hz makes {starts.size} slices of {samples} samples; at least 8 of 128 are needed",
        )
    speed = 2.0 * np.pi * reference.speed(rate)
    window = window_values("hann", samples)
    f = np.fft.rfftfreq(samples, 1.0 / rate)
    kept = f <= highest * rate
    slices = [speed[k : k + samples] for k in starts]
    # Powers of lines that go with the fourth power of the speed are those of this mean.
    squares = window**2 / np.sum(window**2)
    mean = np.array([float(squares @ x**4) ** 0.25 for x in slices])
    kept_slices = ~_crosses(slices, mean)
    starts, mean = starts[kept_slices], mean[kept_slices]
    slices = [x for x, keep in zip(slices, kept_slices, strict=True) if keep]
    spread = np.array([float(np.ptp(x)) for x in slices])
    # The mean frequency of a spectrum is that of its instants by their power, in which later ones of a
    # run-up have more.
    centre = np.array([float(squares @ x**5) / float(squares @ x**4) for x in slices])
    order = np.argsort(mean)
    found = {}
    for load, names in channels.items():
        powers = []
        for name in names:
            x = recording[name][reference.part]
            spectra = np.array(
                [
                    np.fft.rfft((x[k : k + samples] - x[k : k + samples].mean()) * window)
                    for k in starts
                ]
            )
            powers.append(2.0 * np.abs(spectra) ** 2 / (samples * np.sum(window**2)))
        if powers:
            each = [power[np.ix_(order, kept)] for power in powers]
            found[load] = PowerMap(
                mean[order], f[kept], np.mean(each, axis=0), LOBES["hann"], spread[order],
                axes=tuple(each) if len(each) > 1 else (), centre=centre[order],
            )  # fmt: skip
    return found
