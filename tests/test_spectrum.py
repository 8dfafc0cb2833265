"""Spectra of made signals: what a tone, a noise and a mixture must read."""

import numpy as np
import pytest

from microvib.signals.spectrum import (
    SpectrumError,
    Window,
    amplitude_spectrum,
    leakage,
    noise_bandwidth,
    power_spectral_density,
    waterfall,
    window_values,
)

RATE, SAMPLES = 4096.0, 65536
T = np.arange(SAMPLES) / RATE


@pytest.mark.parametrize("window", ["rectangular", "hann", "flat-top"])
def test_a_tone_on_a_bin_reads_its_amplitude(window):
    s = amplitude_spectrum(0.3 * np.cos(2 * np.pi * 53.0 * T) + 5.0, RATE, window)
    assert s.amplitude[np.argmax(s.amplitude)] == pytest.approx(0.3, rel=1e-9)
    assert s.frequency[np.argmax(s.amplitude)] == 53.0


@pytest.mark.parametrize(
    ("window", "loss"), [("rectangular", 0.363), ("hann", 0.151), ("flat-top", 0.002)]
)
def test_worst_picket_fence_loss(window, loss):
    s = amplitude_spectrum(np.cos(2 * np.pi * (848.5 / 16) * T), RATE, window)
    assert 1.0 - s.amplitude.max() == pytest.approx(loss, abs=0.002)


def test_density_of_white_noise_and_of_a_tone():
    x = np.random.default_rng(1).normal(0.0, 2.0, SAMPLES) + 0.5 * np.sin(2 * np.pi * 500.0 * T)
    psd = power_spectral_density(x, RATE, "1.0 Hz")
    quiet = (psd.frequency > 600) & (psd.frequency < 1900)
    assert psd.density[quiet].mean() == pytest.approx(4.0 / (RATE / 2), rel=0.02)
    assert psd.cumulative_rms[-1] == pytest.approx(x.std(), rel=5e-3)
    noise = psd.density[quiet].mean() * 10.0
    assert psd.band_rms("495.0 Hz", "505.0 Hz") ** 2 - noise == pytest.approx(0.125, rel=0.03)
    assert psd.averages == 31
    assert "31 averages" in str(psd)
    assert "Hann window, 4096 samples" in str(psd)


def test_band_rms_does_not_depend_on_where_bins_fall():
    x = np.random.default_rng(2).normal(0.0, 1.0, SAMPLES)
    psd = power_spectral_density(x, RATE, "4.0 Hz")
    assert psd.band_rms("100.0 Hz", "333.0 Hz") ** 2 + psd.band_rms(
        "333.0 Hz", "901.3 Hz"
    ) ** 2 == pytest.approx(psd.band_rms("100 Hz", "901.3 Hz") ** 2)
    assert psd.band_rms("0.0 Hz", "1e6 Hz") == pytest.approx(psd.cumulative_rms[-1])


def test_third_octaves_of_white_noise_grow_with_the_root_of_frequency():
    x = np.random.default_rng(3).normal(0.0, 1.0, 4 * SAMPLES)
    centre, rms = power_spectral_density(x, RATE, "0.25 Hz").third_octaves()
    assert 1000.0 in np.round(centre, 6)
    width = centre * (10**0.05 - 10**-0.05)
    np.testing.assert_allclose(rms**2 / width, 2 / RATE, rtol=0.35)
    assert width[0] >= 2 * 0.25
    assert centre[-1] * 10**0.05 <= RATE / 2


def test_background_power_is_subtracted():
    rng = np.random.default_rng(4)
    tone = 0.1 * np.sin(2 * np.pi * 80.0 * T)
    noise = power_spectral_density(rng.normal(0, 1, SAMPLES), RATE, "1.0 Hz")
    both = power_spectral_density(tone + rng.normal(0, 1, SAMPLES), RATE, "1.0 Hz").less(noise)
    assert both.band_rms("77.0 Hz", "83.0 Hz") == pytest.approx(0.1 / np.sqrt(2), rel=0.1)
    with pytest.raises(SpectrumError, match="same sample rate and segment"):
        both.less(power_spectral_density(tone, RATE, "2.0 Hz"))


def test_waterfall_follows_a_tone_that_dies():
    w = waterfall(np.exp(-0.2 * T) * np.cos(2 * np.pi * 40.0 * T), RATE, "1.0 Hz")
    k = int(np.argmin(abs(w.frequency - 40.0)))
    np.testing.assert_allclose(w.amplitude[:, k], np.exp(-0.2 * w.time), rtol=0.01)
    assert w.amplitude.shape == (w.time.size, w.frequency.size)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda x: amplitude_spectrum(x, RATE, "kaiser"), "window: 'kaiser' is not known; allowed are rectangular, hann"),
        (lambda x: power_spectral_density(x, RATE, "0.01 Hz"), "needs a record of 100 s; it has 16 s"),
        (lambda x: power_spectral_density(x, RATE, "-1.0 Hz"), "must be greater than 0 and at most 512 Hz"),
        (lambda x: power_spectral_density(x, RATE).band_rms("5.0 Hz", "2.0 Hz"), "below its upper end"),
    ],
)  # fmt: skip
def test_bad_settings_are_named(call, words):
    with pytest.raises(SpectrumError, match=words):
        call(np.sin(T))


@pytest.mark.parametrize("window", ["rectangular", "hann", "flat-top"])
def test_leakage_is_the_envelope_of_the_side_lobes_of_a_window(window: Window) -> None:
    n, finer = 256, 64
    power = np.abs(np.fft.rfft(window_values(window, n), n * finer)) ** 2 / n**2
    power /= noise_bandwidth(window)
    distance = np.arange(power.size) / finer
    beyond = np.maximum.accumulate(power[::-1])[::-1]
    outside = (distance > 8.0) & (distance < 40.0)
    ratio = leakage(window, distance[outside]) / beyond[outside]
    assert np.all(ratio > 0.9)
    assert np.median(ratio) < 1.6
