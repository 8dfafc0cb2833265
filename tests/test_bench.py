"""The virtual bench: each stage against its closed form, and the chain through file and reader."""

import math

import numpy as np
import pytest
from support.scenarios import in_si

import microvib as mv
from microvib.analysis.lines import lines_of_recording
from microvib.io.named import bench_names
from microvib.io.recordings import read_prepared, read_recording, write_recording
from microvib.io.scenario_file import load_bench
from microvib.model.rigid import COMPONENTS
from microvib.signals.spectrum import tone_amplitude
from microvib.studies.measure import measure as measure_scenario
from microvib.testdata.bench import GRAVITY, Bench, Resonance, Rope, measure
from microvib.testdata.preparation import Preparation

IDEAL = {"sample_rate": 1024.0, "duration": 8.0, "lead": 4.0}


def loads_of(
    bench: Bench, frequency: float, amplitude: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    n = math.ceil(bench.span * bench.analog_rate)
    t = np.arange(n) / bench.analog_rate
    return np.tile(amplitude * np.cos(2 * np.pi * frequency * t), (6, 1)), np.zeros(n)


def reading(frequency: float, channel: str = "Mz", **settings) -> float:
    bench = in_si(Bench, **{**IDEAL, **settings})
    return tone_amplitude(
        measure(bench, *loads_of(bench, frequency))[channel], bench.sample_rate, frequency
    )


def test_an_ideal_bench_changes_nothing():
    bench = in_si(Bench, **IDEAL)
    loads, twist = loads_of(bench, 37.3)
    np.testing.assert_array_equal(
        measure(bench, loads, twist)["Fx"], loads[0, 16384::4][: bench.samples]
    )


@pytest.mark.parametrize("f", [20.0, 99.0, 180.0])
def test_a_table_resonance_amplifies(f):
    r = f / 100.0
    expected = 1.0 / math.hypot(1 - r * r, 2 * 0.05 * r)
    table = (in_si(Resonance, component="Mz", frequency=100.0, damping=0.05),)
    assert reading(f, table=table) == pytest.approx(expected, rel=1e-4)
    assert reading(f, "Mx", table=table) == pytest.approx(1.0, rel=1e-6)


def test_nothing_is_felt_before_it_happens():
    """A blow near the end rings on beyond it, and not round to the beginning."""
    table = (in_si(Resonance, component="Mz", frequency=30.0, damping=0.004),)
    bench = in_si(Bench, sample_rate=1024.0, duration=4.0, lead=0.0, table=table)
    loads, twist = loads_of(bench, 30.0)
    since = np.arange(twist.size) / bench.analog_rate - 3.0
    loads *= np.where((since > 0.0) & (since < 0.5), np.sin(2.0 * np.pi * since) ** 4, 0.0)
    recorded = np.abs(measure(bench, loads, twist)["Mz"])
    assert recorded.max() > 10.0
    assert recorded[: 3 * 1024 - 100].max() < 1e-4 * recorded.max()


def test_a_platform_takes_its_share_above_its_resonance():
    platform = (in_si(Resonance, component="Fx", frequency=2.0, damping=0.1, share=0.03),)
    assert reading(100.0, "Fx", platform=platform) == pytest.approx(0.97, rel=1e-3)
    s = 2j * np.pi * 2.2
    w = 2 * np.pi * 2.0
    expected = abs(1 - 0.03 * s**2 / (s**2 + 2 * 0.1 * w * s + w**2))
    assert reading(2.2, "Fx", platform=platform) == pytest.approx(expected, rel=1e-3)


def test_high_pass_and_anti_aliasing_filter():
    assert reading(1.0, high_pass=1.0) == pytest.approx(math.sqrt(0.5), rel=2e-3)
    assert reading(200.0, filter_corner=200.0, filter_order=6) == pytest.approx(
        math.sqrt(0.5), rel=2e-3
    )
    bench = in_si(Bench, **IDEAL, filter_corner=400.0, filter_order=8)
    out = measure(bench, *loads_of(bench, 1024.0 - 50.0))["Mz"]
    assert tone_amplitude(out, 1024.0, 50.0) < 2e-3  # would alias to 50 Hz


def test_noise_floor_has_its_density():
    bench = in_si(Bench, **IDEAL, torque_noise=1e-3, force_noise=2e-3, filter_corner=400.0)
    quiet = np.zeros_like(loads_of(bench, 1.0)[0])
    out = measure(bench, quiet, quiet[0], seed=3)
    from microvib.signals.spectrum import power_spectral_density

    for name, density in (("Mz", 1e-3), ("Fy", 2e-3)):
        psd = power_spectral_density(out[name], 1024.0, "1 Hz")
        band = (psd.frequency > 10) & (psd.frequency < 300)
        assert math.sqrt(psd.density[band].mean()) == pytest.approx(density, rel=0.05)
    np.testing.assert_array_equal(out["Mz"], measure(bench, quiet, quiet[0], seed=3)["Mz"])


def test_rope_sways_and_twists():
    rope = in_si(Rope, length=4.0, mass=40.0, sway=1e-3, damping=0.0, torsional_stiffness=0.5)
    bench = in_si(Bench, **(IDEAL | {"duration": 40.0}), rope=rope)
    quiet = np.zeros((6, math.ceil(bench.span * bench.analog_rate)))
    twist = np.linspace(0.0, 0.2, quiet.shape[1])
    out = measure(bench, quiet, twist)
    f = math.sqrt(GRAVITY / 4.0) / (2 * np.pi)
    assert tone_amplitude(out["Fx"], 1024.0, f) == pytest.approx(40 * GRAVITY / 4 * 1e-3, rel=1e-3)
    assert out["Mz"][-1] == pytest.approx(-0.5 * 0.2, rel=1e-3)


def test_converter_rounds_clips_and_runs_at_its_own_clock():
    bench = in_si(Bench, **IDEAL, bits=8, torque_range=1.28)
    out = measure(bench, *loads_of(bench, 37.3, 0.7))["Mz"]
    assert np.allclose(out / 0.01, np.round(out / 0.01))
    loud = measure(bench, *loads_of(bench, 37.3, 2.0))
    assert loud["Mz"].max() == 1.28
    assert any("clipped" in note and "Mz" in note for note in loud.notes)
    fast = in_si(Bench, **IDEAL, clock_error=1e-3)
    out = measure(fast, *loads_of(fast, 37.3))["Mz"]
    t = np.arange(out.size) / (1024.0 * 1.001)
    np.testing.assert_allclose(out, np.cos(2 * np.pi * 37.3 * (4.0 + t)), atol=2e-6)


@pytest.fixture(scope="module")
def measured():
    scenario = mv.load_scenario("state-1").with_({"tracking.clock_ratio": 0.9965})
    return scenario, measure_scenario(scenario, load_bench("force-table"))


@pytest.mark.parametrize("suffix", [".uff", ".mat", ".csv"])
def test_what_goes_in_comes_out(tmp_path, measured, suffix):
    """Written, read and estimated: the lines of the run, through the bench's known stages, within their uncertainties."""
    scenario, recording = measured
    path = tmp_path / f"test{suffix}"
    write_recording(recording, path)
    back = read_recording(path)
    assert back.sample_rate == 4096.0
    np.testing.assert_allclose(back["Mz"], recording["Mz"], rtol=1e-11, atol=1e-12)
    table = lines_of_recording(back, "Mz", mv.load_scenario("state-1"))
    truth = mv.find_lines(mv.simulate(scenario, channels=("T_d",)))
    assert table.clock_ratio * 0.994 == pytest.approx(0.9965 / (1 + 10e-6), abs=3e-7)
    for name in ("drive_1", "drive_2", "drive_3"):
        f = truth[name].frequency
        s, w = 2j * np.pi * f, 2 * np.pi * 700.0
        through = abs(w**2 / (s**2 + 0.04 * w * s + w**2)) * 0.998
        spread = table[name].amplitude_uncertainty
        assert table[name].amplitude == pytest.approx(
            truth[name].amplitude * through, abs=4 * spread, rel=5e-4
        )


def test_cross_talk_is_taken_out_again():
    rng = np.random.default_rng(1)
    matrix = np.eye(6) + 0.03 * rng.normal(size=(6, 6))
    bench = in_si(Bench, **IDEAL, cross_talk=tuple(map(tuple, matrix.tolist())))
    n = math.ceil(bench.span * bench.analog_rate)
    loads = rng.normal(size=(6, n))
    seen = measure(bench, loads, np.zeros(n))
    back = Preparation(cross_talk=bench.cross_talk).apply(seen)
    for k, name in enumerate(COMPONENTS):
        np.testing.assert_allclose(back[name], loads[k, 16384::4][: bench.samples], atol=1e-12)


def test_catalog_benches_are_sound():
    assert "force-table" in bench_names()
    assert load_bench("force-table").samples == 65536


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("high_pass: 1 N", "high_pass: '1 N' has the wrong dimension"),
        ("filter_corner: 3 kHz", "not below half the sample rate, 2048 Hz"),
        ("table: [{component: Mq, frequency: 1 Hz, damping: 0.1}]", "table.0.component"),
        (
            "table: [{component: Mx, frequency: 9 kHz, damping: 0.1}]",
            "table.0.frequency: 9000 Hz is not below",
        ),
        ("gain: 2", "gain: unknown key"),
        ("duration: 1e9 s", "too much"),
        ("[1, 2]", "keys with their values are expected"),
    ],
)
def test_bad_benches_are_named(tmp_path, text, words):
    path = tmp_path / "bench.yaml"
    path.write_text(text)
    with pytest.raises(mv.ScenarioError, match=words.replace("[", "\\[")):
        load_bench(path)


PREPARED = """
units: {CH1: 0.5 N*m, CH2: mN*m}
channels: {Mz: -CH1, Mx: CH2}
start: 1 s
stop: 3 s
detrend: 0
decimate: 4
"""


def test_a_recording_is_prepared_from_a_file(tmp_path):
    from microvib.io.recordings import load_preparation
    from microvib.testdata.recording import Recording

    t = np.arange(4096) / 1024.0
    x = np.sin(2 * np.pi * 8 * t)
    write_recording(Recording({"CH1": x + 4.0, "CH2": 2e3 * x}, 1024.0), tmp_path / "raw.csv")
    (tmp_path / "how.yaml").write_text(PREPARED)
    out = read_prepared(tmp_path / "raw.csv", load_preparation(tmp_path / "how.yaml")).recording
    assert out.sample_rate == 256.0
    assert out.duration == 2.0
    inner = slice(20, -20)
    np.testing.assert_allclose(out["Mz"][inner], -0.5 * x[1024:3072:4][inner], atol=2e-4)
    np.testing.assert_allclose(out["Mx"][inner], 2.0 * x[1024:3072:4][inner], atol=1e-3)
    assert len(out.notes) >= 5


def test_axes_and_offset_turn_the_frame():
    from microvib.testdata.recording import Recording

    one = {name: np.full(8, float(k + 1)) for k, name in enumerate(COMPONENTS)}
    units = {name: "N" if name[0] == "F" else "N*m" for name in COMPONENTS}
    table = Recording(one, 1.0, units)
    turned = Preparation(axes=("y", "-x", "z")).apply(table)
    assert [turned[n][0] for n in COMPONENTS] == [2, -1, 3, 5, -4, 6]
    moved = in_si(Preparation, offset=(0.0, 0.0, 2.0)).apply(table)
    np.testing.assert_allclose(
        [moved[n][0] for n in COMPONENTS[3:]], np.array([4, 5, 6]) - np.cross([0, 0, 2], [1, 2, 3])
    )
    with pytest.raises(mv.MicrovibError, match="not a right-handed frame"):
        Preparation(axes=("y", "x", "z")).apply(table)


def test_a_line_that_is_in_the_background_is_named():
    from microvib.model.expected import ExpectedLine
    from microvib.signals.line_fit import estimate_lines, with_background

    t = np.arange(65536) / 4096.0
    hum = 1e-3 * np.cos(2 * np.pi * 50.0 * t)
    noise = np.random.default_rng(1).normal(0, 1e-4, (2, t.size))
    lines = [ExpectedLine("drive_1", "drive", f, f, f, "made") for f in (50.0,)]
    lines.append(ExpectedLine("drive_2", "drive", 100.0, 100.0, 100.0, "made"))
    x = hum + 4e-3 * np.cos(2 * np.pi * 100.0 * t) + noise[0]
    table = with_background(estimate_lines(x, 4096.0, lines), hum + noise[1])
    assert table["drive_1"].status == "in the background"
    assert table["drive_1"].background == pytest.approx(1e-3, rel=0.01)
    assert table["drive_1"].amplitude_uncertainty == pytest.approx(1e-3 / np.sqrt(2), rel=0.02)
    assert table["drive_2"].status == "ok"
