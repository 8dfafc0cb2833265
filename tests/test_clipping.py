"""Clipping, told by the distribution of samples at a channel's extremes, and what is not clipped."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import butter, lfilter, resample_poly, sosfilt
from support.made_signals import RATE, Signal, T, drive, noise, sine

from microvib.testdata.clipping import find_plateaus
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel


def sides(x: Signal) -> list[str]:
    return [one.side for one in find_plateaus(x)]


@pytest.mark.parametrize("size", [0.0, 1e-7, 1e-4, 3e-3])
@pytest.mark.parametrize("part", [0.2, 0.35, 0.6, 0.8])
def test_a_level_is_told_whatever_noise_lies_on_it(part: float, size: float) -> None:
    x = np.clip(drive(), -part, part)
    found = find_plateaus(x + noise(part * size))
    assert [one.side for one in found] == ["largest", "smallest"]
    for one, sign in zip(found, (1.0, -1.0), strict=True):
        assert one.level == pytest.approx(sign * part, rel=0.01)
        assert one.share == pytest.approx(np.mean(sign * x >= part), abs=0.04)


@pytest.mark.parametrize("size", [0.0, 1e-4, 3e-3])
@pytest.mark.parametrize("offset", [0.0, 2.0, -5.0])
def test_one_side_is_told_alone(offset: float, size: float) -> None:
    upper, lower = np.minimum(drive(), 0.4) + offset, np.maximum(drive(), -0.4) + offset
    assert sides(upper + noise(size)) == ["largest"]
    assert sides(lower + noise(size)) == ["smallest"]


@pytest.mark.parametrize("frequency", [0.5, 4.0, 53.3, 200.3])
def test_every_pace_is_clipped_alike(frequency: float) -> None:
    assert sides(np.clip(sine(frequency), -0.6, 0.6) + noise(1e-3)) == ["largest", "smallest"]


@pytest.mark.parametrize("part", [0.35, 0.6])
def test_a_converters_filter_behind_the_amplifier_hides_nothing(part: float) -> None:
    fine = np.arange(8 * T.size // 2) / (8.0 * RATE)
    x = sum(
        a * np.sin(2.0 * np.pi * f * fine + p) for f, a, p in ((3.33, 1.0, 0.1), (53.3, 0.4, 1.0))
    )
    x = np.clip(x, -part, part)
    anti_alias = butter(8, 0.4 * RATE, fs=8.0 * RATE, output="sos")
    for behind in (resample_poly(x, 1, 8), sosfilt(anti_alias, x)[::8]):
        assert sides(behind + noise(1e-3)[: behind.size]) == ["largest", "smallest"]


GENUINE = {
    "slow sine": sine(0.7),
    "sine": sine(4.0),
    "fast sine": sine(256.0),
    "drive": drive(),
    "triangle": np.abs(2.0 * ((1.3 * T) % 1.0) - 1.0) - 0.5,
    "sawtooth": (3.2 * T) % 1.0,
    "square": np.sign(sine(5.1)),
    "square behind a low-pass": lfilter(*butter(1, 100.0, fs=RATE), np.sign(sine(5.1))),
    "square behind an anti-alias filter": sosfilt(
        butter(8, 800.0, fs=RATE, output="sos"), np.sign(sine(5.1))
    ),
    "rounded square": np.tanh(5.0 * sine(5.1)),
    "square of 80 samples": np.tanh(2.0 * sine(25.6)),
    "staircase": np.floor(6.0 * ((3.2 * T) % 1.0)),
    "staircase up and down": np.floor(6.0 * np.abs(2.0 * ((3.2 * T) % 1.0) - 1.0)),
    "blows": np.exp(-8.0 * (T % 1.0)) * np.sin(2.0 * np.pi * 40.0 * (T % 1.0)),
    "pulses of one sign": np.maximum(sine(5.0), 0.0),
    "nothing": np.zeros(T.size),
}


@pytest.mark.parametrize("size", [1e-6, 1e-3, 3e-2])
@pytest.mark.parametrize("kind", [*GENUINE])
def test_what_is_not_clipped_is_not_called_so(kind: str, size: float) -> None:
    assert find_plateaus(GENUINE[kind] + noise(size)) == ()


@pytest.mark.parametrize("kind", ["slow sine", "sine", "fast sine", "drive", "triangle", "blows"])
def test_crests_without_noise_are_not_clipped(kind: str) -> None:
    assert find_plateaus(GENUINE[kind]) == ()


@pytest.mark.parametrize("draw", ["normal", "uniform", "laplace"])
def test_noise_alone_is_not_clipped(draw: str) -> None:
    rng = np.random.default_rng(0)
    assert find_plateaus(getattr(rng, draw)(size=T.size)) == ()


@pytest.mark.parametrize("kind", ["slow sine", "sine", "drive", "triangle"])
@pytest.mark.parametrize("part", [0.0, 0.3])
@pytest.mark.parametrize("bits", [8, 12])
def test_a_converters_steps_are_no_plateaus(kind: str, part: float, bits: int) -> None:
    """Crests are at one value for many samples; where the range ends within the signal they are clipped."""
    step = 2.2 / 2**bits
    x = GENUINE[kind] + noise(part * step)
    assert find_plateaus(np.round(x / step) * step) == ()
    limit = round(0.6 * np.max(x) / step) * step
    assert "largest" in sides(np.minimum(np.round(x / step) * step, limit))


def test_the_sentence_says_how_much_where_and_on_which_side() -> None:
    x = np.clip(0.05 * drive(), -0.02, None) + noise(1e-6)
    with pytest.raises(RecordingError) as told:
        require_usable_channel(Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "made"), "Mz")
    share = float(np.mean(0.05 * drive() < -0.02))
    sentence = r"made: channel Mz is clipped: (\S+) % of its samples lie at its smallest value, -0.02\d* N\*m"
    said = re.fullmatch(sentence, str(told.value))
    assert said is not None
    assert 0.01 * float(said[1]) == pytest.approx(share, rel=0.02)
