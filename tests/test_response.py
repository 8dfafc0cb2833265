"""A chain's response: its closed forms, its removal from a recording, and what the virtual bench does."""

import math

import numpy as np
import pytest
from support.scenarios import in_si

from microvib.errors import MicrovibError
from microvib.io.recordings import load_preparation, read_prepared, write_recording
from microvib.signals.spectrum import complex_tone, power_spectral_density, tone_amplitude
from microvib.testdata.bench import Bench, measure
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.response import response

RATE = 4096.0
T = np.arange(8 * 4096) / RATE
TONES = {14.505: 0.02, 53.3: 0.05, 373.1: 0.03, 1210.7: 0.01}


def prepared(x: np.ndarray, **how) -> Recording:
    return in_si(Preparation, **how).apply(Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "made"))


def test_a_boxcar_is_taken_out():
    """Samples that are exact means over their interval, lines beyond a rising ramp."""
    h = 1.0 / RATE
    x = 0.3 * T + sum(
        a * (np.sin(2 * np.pi * f * (T + h)) - np.sin(2 * np.pi * f * T)) / (2 * np.pi * f * h)
        for f, a in TONES.items()
    )
    assert tone_amplitude(x, RATE, 373.1) == pytest.approx(0.03 * 0.98644, rel=1e-4)
    found = prepared(x, response="boxcar")
    for f, a in TONES.items():
        assert tone_amplitude(found["Mz"] - 0.3 * T, RATE, f) == pytest.approx(a, rel=1e-4)
    assert "response of the measuring chain removed (boxcar) from 0 to 2048 Hz" in found.notes[-1]
    assert "at most 1.571" in found.notes[-1]


def test_means_over_another_interval():
    h = 4.0 / RATE
    x = sum(a * np.sinc(f * h) * np.cos(2 * np.pi * f * T) for f, a in TONES.items() if f < 500.0)
    found = prepared(x, response=[{"kind": "boxcar", "length": h}])
    assert tone_amplitude(found["Mz"], RATE, 373.1) == pytest.approx(0.03, rel=1e-4)


@pytest.mark.parametrize("kind", ["butterworth", "bessel"])
def test_filters_have_their_corner_and_are_taken_out_with_their_phase(kind):
    chain = [
        {"kind": kind, "order": 6, "corner": 800.0},
        {"kind": kind, "order": 1, "corner": 3.0, "passes": "high"},
    ]
    stages = in_si(Preparation, response=chain).response
    at = response(stages, np.array([3.0, 800.0]), RATE)
    assert np.abs(at) == pytest.approx([math.sqrt(0.5)] * 2, rel=1e-3)
    if kind == "butterworth":
        f = np.array([7.0, 373.1])
        assert np.abs(response(stages[:1], f, RATE)) == pytest.approx(
            1 / np.sqrt(1 + (f / 800.0) ** 12), rel=1e-9
        )
        assert response(stages[1:], f, RATE) == pytest.approx(
            1j * f / 3.0 / (1 + 1j * f / 3.0), rel=1e-9
        )
    low = {f: a for f, a in TONES.items() if f < 500.0}
    x = sum(
        (a * response(stages, np.array([f]), RATE)[0] * np.exp(2j * np.pi * f * T)).real
        for f, a in low.items()
    )
    found = prepared(x, response=chain)
    for f, a in low.items():
        assert complex_tone(found["Mz"], RATE, f) == pytest.approx(a, abs=2e-3 * a)


def test_a_table_from_a_file(tmp_path):
    rows = [(f, 1.0 / (1.0 + f / 2000.0), -0.02 * f) for f in (1.0, 10.0, 100.0, 500.0)]
    text = "frequency_hz,magnitude,phase_deg\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows)
    (tmp_path / "chain.csv").write_text(text)
    (tmp_path / "how.yaml").write_text("response:\n  - {kind: table, file: chain.csv}\n")
    x = 0.05 * rows[2][1] * np.cos(2 * np.pi * 100.0 * T + np.deg2rad(rows[2][2])) + 0.01 * np.cos(
        2 * np.pi * 900.0 * T
    )
    write_recording(Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "made"), tmp_path / "test.uff")
    found = read_prepared(tmp_path / "test.uff", load_preparation(tmp_path / "how.yaml")).recording
    assert complex_tone(found["Mz"], RATE, 100.0) == pytest.approx(0.05, abs=1e-4)
    assert tone_amplitude(found["Mz"], RATE, 900.0) == pytest.approx(
        0.01, rel=1e-3
    )  # not in the table: as recorded
    assert "from 1 to 500 Hz" in found.notes[-1]


def test_densities_are_corrected_too():
    x = (
        np.random.default_rng(1).normal(0, 1e-3, 16 * T.size).reshape(-1, 16).mean(axis=1)
    )  # means over 16 fine samples
    found = prepared(x, response="boxcar")["Mz"]
    raw, corrected = (power_spectral_density(y, RATE, "16 Hz") for y in (x, found))
    k = np.searchsorted(raw.frequency, 1500.0)
    assert corrected.density[k] / raw.density[k] == pytest.approx(
        np.sinc(1500.0 / RATE) ** -2, rel=0.02
    )


def test_where_little_is_left_nothing_is_blown_up():
    x = 0.05 * np.cos(2 * np.pi * 53.3 * T) + np.random.default_rng(0).normal(0, 1e-4, T.size)
    found = prepared(x, response=[{"kind": "butterworth", "order": 8, "corner": 400.0}])
    assert np.std(found["Mz"] - x) < 0.05
    assert "outside, lines are as recorded" in found.notes[-1]
    assert tone_amplitude(found["Mz"], RATE, 1500.0) == pytest.approx(
        tone_amplitude(x, RATE, 1500.0), rel=0.05
    )


def test_the_virtual_bench_agrees():
    """Its amplifiers and its filter, told to the preparation, give back the loads."""
    bench = in_si(Bench, duration=8.0, lead=4.0, high_pass=1.0, filter_corner=800.0, filter_order=8)
    t = np.arange(math.ceil(bench.span * bench.analog_rate)) / bench.analog_rate
    tones = {5.3: 0.02, 53.3: 0.05, 373.1: 0.03, 700.3: 0.01}
    loads = np.tile(sum(a * np.cos(2 * np.pi * f * t) for f, a in tones.items()), (6, 1))
    recording = measure(bench, loads, np.zeros(t.size))
    chain = [
        {"kind": "butterworth", "order": 8, "corner": bench.filter_corner},
        {"kind": "butterworth", "order": 1, "corner": bench.high_pass, "passes": "high"},
    ]
    found = in_si(Preparation, response=chain).apply(recording)
    assert tone_amplitude(recording["Mz"], RATE, 700.3) < 0.96 * tones[700.3]
    for f, a in tones.items():
        assert tone_amplitude(found["Mz"], RATE, f) == pytest.approx(a, rel=4e-3)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("response: sinc", "response.0.kind: 'sinc' is not allowed"),
        ("response: [{kind: butterworth, order: 4}]", "corner: missing; butterworth needs it"),
        ("response: [{kind: boxcar, order: 4}]", "order: does not go with boxcar"),
        ("response: [{kind: bessel, order: 40, corner: 1 kHz}]", "order"),
        ("response: [{kind: bessel, order: 4, corner: 1}]", "corner: 1 needs a unit"),
        ("response: [{kind: table, file: none.csv}]", "none.csv: cannot be read: No such file"),
        ("response: [{kind: table, file: bad.csv}]", "bad.csv, row 3: expected numbers"),
        ("response: [{kind: table, file: falling.csv}]", "at least two frequencies, rising"),
    ],
)
def test_bad_responses_are_named(tmp_path, text, complaint):
    (tmp_path / "bad.csv").write_text("frequency_hz,magnitude\n1,1\n2,nan\n")
    (tmp_path / "falling.csv").write_text("frequency_hz,magnitude\n2,1\n1,1\n")
    (tmp_path / "how.yaml").write_text(text)
    with pytest.raises(MicrovibError, match=complaint):
        load_preparation(tmp_path / "how.yaml")


def test_what_cannot_be_corrected_is_told():
    x = np.cos(2 * np.pi * 53.3 * T)
    with pytest.raises(RecordingError, match=r"it is below 0\.25 at all frequencies"):
        prepared(x, response=[{"kind": "butterworth", "order": 8, "corner": 1e-3}])
    with pytest.raises(RecordingError, match="not numbers; its response cannot be removed"):
        prepared(np.where(T == 0.0, np.nan, x), response="boxcar")
