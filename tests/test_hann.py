"""Compiled tones under a Hann window, against the discrete Fourier transform of samples."""

import numpy as np
import pytest

from microvib.model.expected import ExpectedLine
from microvib.signals import tone_fit
from microvib.signals import tone_kernel as hann
from microvib.signals.spectrum import window_values
from microvib.signals.tone_algebra import half_turns
from microvib.signals.tones import HannSpectrum, steady_tones


def samples_of(cycles, decay, amplitude, n):
    u = np.arange(n) / n
    return np.real(amplitude * np.exp((2j * np.pi * cycles - decay) * u))


def transformed(x):
    return np.fft.rfft(x * window_values("hann", x.size)) * (2.0 / x.size)


@pytest.mark.parametrize("n", [1024, 1025])
@pytest.mark.parametrize("decay", [0.0, 1e-14, 0.3, 40.0, -6.0])
@pytest.mark.parametrize(
    "cycles", [0.0, 1e-13, 0.4, 3.0, 100.49, 100.5, 511.7, 512.0, 512.5, 700.2, 3000.3]
)
def test_tone_is_the_transform_of_its_samples(cycles, decay, n):
    amplitude = 1.2 - 0.3j
    expected = transformed(samples_of(cycles, decay, amplitude, n))
    found = hann.tone(cycles, decay, amplitude, np.arange(expected.size), half_turns(n))
    assert found == pytest.approx(
        expected, abs=2e-14 * max(cycles, 10.0) * np.exp(max(-decay, 0.0))
    )


def test_tone_at_bins_that_lie_apart_is_that_of_all_bins():
    table = half_turns(4096)
    bins = np.array([0, 3, 4, 5, 90, 92, 93, 2048])
    every = hann.tone(92.3, 0.2, 1.0 + 2.0j, np.arange(2049), table)
    assert np.array_equal(hann.tone(92.3, 0.2, 1.0 + 2.0j, bins, table), every[bins])


@pytest.mark.parametrize("n", [8, 9, 4096, 4097])
def test_spectrum_is_the_windowed_transform(n):
    x = np.random.default_rng(2).normal(size=n)
    spectrum = HannSpectrum.of(x, 100.0)
    assert spectrum.values == pytest.approx(transformed(x), abs=1e-14)
    assert spectrum.unwindowed == pytest.approx(np.fft.rfft(x) * (2.0 / n), abs=1e-14)


def test_amplitudes_of_tones_that_decay_or_not():
    cycles, decay = np.array([20.3, 24.1, 300.0]), np.array([0.0, 2.5, 0.0])
    truth = np.array([1.0 + 0.5j, -0.02j, 1e-5])
    x = sum(samples_of(f, d, a, 2048) for f, d, a in zip(cycles, decay, truth, strict=True))
    assert hann.amplitudes(cycles, decay, transformed(x), half_turns(2048)) == pytest.approx(
        truth, rel=1e-9
    )


def test_least_squares_are_those_of_an_orthogonal_method():
    r = np.random.default_rng(3)
    alike, right, scale = r.normal(size=(7, 40)), r.normal(size=40), np.logspace(-6, 6, 7)
    exact = np.linalg.lstsq(alike.T, right, rcond=None)[0] / scale
    assert hann.least_squares(alike * scale[:, None], right) == pytest.approx(exact, rel=1e-10)


def test_a_column_that_others_make_up_gets_nothing():
    r = np.random.default_rng(4)
    two, right = r.normal(size=(2, 30)), r.normal(size=30)
    columns = np.array([two[0], np.zeros(30), two[1], two[0] - 2.0 * two[1]])
    found = hann.least_squares(columns, right)
    assert found[[1, 3]].tolist() == [0.0, 0.0]
    assert found[[0, 2]] == pytest.approx(np.linalg.lstsq(two.T, right, rcond=None)[0])


@pytest.mark.parametrize("cycles", [2.0, 5.4, 12.5, 40.0, 62.0, 64.0])
def test_floor_is_the_median_of_the_bins_about(cycles):
    values = np.random.default_rng(5).normal(size=65) + 0j
    centre = round(cycles)
    about = [abs(values[k]) for k in range(1, 65) if 4 <= abs(k - centre) <= 20]
    assert hann.floors(np.array([cycles]), values) == np.median(about)


def test_floor_without_bins_is_nothing():
    assert hann.floors(np.array([2.0]), np.ones(5) + 0j) == 0.0


def test_bins_near_tones():
    tones = np.array([3.4, 11.0, 100.0])
    assert hann.bins_in(tones, tones, 6, 105).tolist() == [*range(18), *range(94, 105)]
    assert hann.bins_in(tones[2:], tones[2:] + 50.0, 2, 120).tolist() == [*range(98, 120)]
    assert (
        hann.bins_in(tones[:0], tones[:0], 6, 105).size
        == hann.bins_in(tones, tones, -1, 105).size
        == 0
    )
    assert hann.bins_in(10.0 * tones[2:], 10.0 * tones[2:], 6, 105).size == 0


def test_a_known_tone_is_taken_out_whole():
    line = ExpectedLine("drive_1", "drive", 53.3, 53.3, 53.3, "made")
    spectrum = HannSpectrum.of(samples_of(53.3 * 16.0, 0.0, 0.7 + 0.1j, 16384), 1024.0)
    tones = steady_tones([line])
    rest = spectrum.without(tones, spectrum.amplitudes(tones))
    assert spectrum.magnitude.max() > 0.5
    assert rest.magnitude.max() < 1e-8
    assert spectrum.peak(53.0, 54.0)[0] == pytest.approx(53.3, abs=0.01)


def test_lines_beyond_the_spectrum_have_no_amplitude():
    spectrum = HannSpectrum.of(np.random.default_rng(6).normal(size=64), 64.0)
    line = ExpectedLine("drive_9", "drive", 500.0, 500.0, 500.0, "made")
    assert spectrum.amplitudes(steady_tones([line])).tolist() == [0.0]


def test_a_fit_finds_tones_near_each_other_and_a_shift_of_others_together():
    n = 2048
    cycles, decay = np.array([20.2, 22.9, 100.0, 200.0]), np.array([0.4, 1.5, 0.0, 0.0])
    truth = cycles * np.array([1.0, 1.0, 1.001, 1.001])
    x = sum(
        samples_of(f, d, a, n)
        for f, d, a in zip(truth, decay, (1.0, 0.7j, 0.3, 0.2 - 0.1j), strict=True)
    )
    two, none = np.arange(2), np.zeros(2)
    k = hann.bins_in(cycles, cycles, hann.REACH, n // 2 + 1)
    start = np.array([20.0, 23.2, 100.0, 200.0])
    low, high = (
        np.array([18.0, 21.0, -8.0, -8.0, -np.inf]),
        np.array([22.0, 25.0, 60.0, 60.0, np.inf]),
    )
    there, fold, at = tone_fit.fit(
        start, 0.3 * (start < 50.0), two, two, two + 2, low, high, k, transformed(x), half_turns(n)
    )
    assert there == pytest.approx(truth, rel=1e-7)
    assert fold == pytest.approx([0.4, 1.5, *none], abs=1e-6)
    assert at[-1] == pytest.approx(0.2, rel=1e-5)


def test_slopes_of_a_fit_give_the_derivative_of_what_is_left():
    table, k = half_turns(4096), np.arange(80, 140)
    random = np.random.default_rng(4)
    values = sum(
        hann.tone(c, d, a, np.arange(2049), table)
        for c, d, a in [(100.2, 0.4, 1.0), (104.0, 0.0, 2j)]
    )
    values = values + 0.05 * random.normal(size=2049)
    cycles, decay = np.array([100.0, 103.7, 121.3]), np.array([0.3, 0.0, 0.0])
    beside = *tone_fit.known(np.array([112.6]), np.array([0.7]), k, values, table), table
    free, falls, clock = np.array([0]), np.array([0]), np.array([1, 2])

    def left(p):
        moved = np.array([p[0], *cycles[1:] * (1 + p[2] / cycles[2])])
        rest = tone_fit.residual(moved, np.array([p[1], 0.0, 0.0]), k, *beside)
        return rest @ rest

    slopes = np.zeros((3, 2 * k.size))
    tone_fit._slopes(cycles, decay, free, falls, clock, k, *beside, slopes)
    at, steps = np.array([100.0, 0.3, 0.0]), 1e-4 * np.eye(3)
    expected = [(left(at + step) - left(at - step)) / 2e-4 for step in steps]
    assert 2 * slopes @ tone_fit.residual(cycles, decay, k, *beside) == pytest.approx(
        expected, rel=1e-5
    )
