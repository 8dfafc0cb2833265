"""Gaps that were filled, with the last value, with lines or by holding a lower rate, and what is calm of itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.signal import butter, sosfilt
from support.made_signals import RATE, Signal, T, drive, noise, sine

import microvib as mv
from microvib.testdata.gaps import gap_faults
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel


def faults(x: Signal) -> list[str]:
    return list(gap_faults(x, RATE))


def gaps_at(length: int, count: int, seed: int = 0) -> list[int]:
    """First samples of gaps that do not touch each other."""
    places = np.random.default_rng(seed).choice(T.size // (3 * length) - 1, count, replace=False)
    return sorted((3 * length * (places + 1)).tolist())


def held(x: Signal, first: list[int], length: int) -> Signal:
    """The signal with the last value in gaps."""
    y = x.copy()
    for at in first:
        y[at : at + length] = y[at - 1]
    return y


SIGNALS = {
    "drive": drive(),
    "slow sine": sine(0.7),
    "sine": sine(4.0),
    "triangle": np.abs(2.0 * ((1.3 * T) % 1.0) - 1.0) - 0.5,
    "sawtooth": (3.2 * T) % 1.0,
    "square": np.sign(sine(5.1)),
    "square behind an anti-alias filter": sosfilt(
        butter(8, 800.0, fs=RATE, output="sos"), np.sign(sine(5.1))
    ),
    "rounded square": np.tanh(5.0 * sine(5.1)),
    "staircase": np.floor(6.0 * ((3.2 * T) % 1.0)),
    "blows": np.exp(-8.0 * (T % 1.0)) * np.sin(2.0 * np.pi * 40.0 * (T % 1.0)),
    "pulses of one sign": np.maximum(sine(5.0), 0.0),
    "bursts": np.exp(-40.0 * (T % 0.5)) * np.sin(2.0 * np.pi * 600.0 * (T % 0.5)),
    "nothing": np.zeros(T.size),
}


@pytest.mark.parametrize("size", [1e-4, 1e-2])
def test_a_gap_that_was_filled_with_a_line_is_told(size: float) -> None:
    x = drive() + noise(size)
    keep = (T % 0.1) < 0.05
    filled = np.where(keep, x, np.interp(T, T[keep], x[keep]))[: np.flatnonzero(keep)[-1] + 1]
    with pytest.raises(RecordingError, match=r"is exactly straight over (50|51) % of its samples"):
        require_usable_channel(Recording({"Mz": filled}, RATE, {"Mz": "N*m"}, "made"), "Mz")


@pytest.mark.parametrize("kind", ["drive", "sine", "nothing"])
@pytest.mark.parametrize(
    ("size", "length", "count"), [(1e-3, 7, 100), (3e-2, 7, 1), (3e-2, 20, 20)]
)
def test_short_holds_are_told_where_the_rest_has_noise(
    kind: str, size: float, length: int, count: int
) -> None:
    """Fewer than nine equal samples in a row, which a crest may have where there is no noise."""
    x = SIGNALS[kind] + noise(size)
    assert faults(x) == []
    assert faults(held(x, gaps_at(length, count), length)) != []


@pytest.mark.parametrize("kind", ["drive", "sine", "nothing"])
@pytest.mark.parametrize(("part", "length"), [(0.02, 40), (0.05, 60), (0.05, 400)])
def test_a_hold_need_not_be_exact(kind: str, part: float, length: int) -> None:
    """The converter adds a part of the noise that the rest has."""
    x = held(SIGNALS[kind] + noise(1e-2), gaps_at(length, 10), length) + noise(1e-2 * part, 1)
    told = next(one for one in faults(x) if "lacks the noise of the rest over" in one)
    share = float(told.split("over ")[1].split(" %")[0])
    assert share == pytest.approx(100.0 * 10 * length / T.size, rel=0.25)


def test_smooth_lines_in_gaps_are_told_beside_noise() -> None:
    x = drive() + noise(1e-2)
    keep = (T % 0.5) < 0.45
    filled = np.where(keep, x, PchipInterpolator(T[keep], x[keep])(T))
    cut = filled[: np.flatnonzero(keep)[-1] + 1]
    assert any("lacks the noise of the rest" in one for one in faults(cut))


@pytest.mark.parametrize("size", [1e-4, 2e-3])
def test_noise_behind_the_hold_hides_no_level(size: float) -> None:
    x = held(drive(), gaps_at(100, 40), 100) + noise(size)
    assert any("stands at a level, and leaves it at once" in one for one in faults(x))


@pytest.mark.parametrize("times", [2, 3, 4, 7])
@pytest.mark.parametrize("size", [0.0, 1e-3])
def test_a_record_at_a_lower_rate_that_was_held_is_told(times: int, size: float) -> None:
    x = drive() + noise(size)
    slower = np.repeat(x[::times], times)
    told = next(one for one in faults(slower) if "sampled at a lower rate and held" in one)
    share = float(told.split("has ")[1].split(" %")[0])
    assert share == pytest.approx(100.0 * (1.0 - 1.0 / times), abs=1.0)


@pytest.mark.parametrize("kind", ["slow sine", "sine", "drive", "triangle", "sawtooth", "blows"])
@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3])
def test_what_is_straight_of_itself_was_not_filled(kind: str, size: float) -> None:
    x = SIGNALS[kind] + noise(size)
    require_usable_channel(Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "made"), "Mz")


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("kind", [*SIGNALS])
def test_what_rests_or_is_calm_of_itself_was_not_filled(kind: str, size: float) -> None:
    assert faults(SIGNALS[kind] + noise(size)) == []


@pytest.mark.parametrize("kind", ["drive", "sine", "nothing"])
@pytest.mark.parametrize("bits", [8, 10, 12])
@pytest.mark.parametrize("steps", [0.6, 1.0, 3.0, 10.0])
def test_a_converters_steps_are_no_gaps(kind: str, bits: int, steps: float) -> None:
    """Noise of some steps: neighbours are equal by chance; where it is less than a step nine are."""
    step = 2.2 / 2**bits
    x = SIGNALS[kind] + noise(steps * step)
    found = faults(np.round(x / step) * step)
    assert found == [] or (steps <= 1.0 and "repeats one value" in found[0] and len(found) == 1)


@pytest.mark.parametrize("draw", ["normal", "uniform", "laplace", "standard_cauchy"])
def test_noise_alone_has_no_gaps(draw: str) -> None:
    for seed in range(5):
        assert faults(getattr(np.random.default_rng(seed), draw)(size=T.size)) == []


def test_fast_lines_that_cease_are_a_drive_that_stops() -> None:
    fast = sine(410.0) + 0.7 * sine(533.0, 1.0) + 0.5 * sine(771.0, 2.0)
    runs = (0.7 * T) % 1.0 < 0.5
    assert faults(np.where(runs, fast, 0.0) + noise(1e-3)) == []


def test_friction_that_sticks_makes_no_gaps() -> None:
    """Without a sensor's noise a simulated torque is calm while the shaft sticks, by and by."""
    loud = {"friction.torque_noise.density": "3e-6 N^2*m^2/Hz", "record.duration": "8 s"}
    motion = mv.simulate(mv.load_scenario("state-1").with_(loud))
    assert list(gap_faults(motion["T_d"], motion.sample_rate)) == []


@pytest.mark.parametrize("size", [1e-6, 1e-4])
@pytest.mark.parametrize("length", [6, 20])
def test_short_gaps_at_one_level_are_told_below_the_noise_of_the_amplifier(
    size: float, length: int
) -> None:
    x = drive()
    for first in np.random.default_rng(3).integers(0, x.size - length, x.size // 100).tolist():
        x[first : first + length] = 0.0
    assert any("falls to one level again and again" in one for one in faults(x + noise(size)))
