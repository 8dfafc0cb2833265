"""Noise, mains and resonances of the virtual bench, and what analyses make of them, against closed forms."""

import math

import numpy as np
import pytest
from scipy import signal, stats
from support.scenarios import baseline, in_si, limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.usable import force_table_notes
from microvib.io.named import bench_names
from microvib.io.recordings import Prepared, load_preparation, read_prepared, write_recording
from microvib.io.scenario_file import load_bench
from microvib.model.rigid import COMPONENTS
from microvib.reports.comparison import verdict_sentence
from microvib.signals.spectrum import tone_amplitude
from microvib.signals.tones import HannSpectrum
from microvib.studies.analyse import analyse
from microvib.studies.compare import compare
from microvib.studies.measure import measure as measure_scenario
from microvib.testdata.bench import Bench, measure
from microvib.testdata.bench_parts import ChannelRms, Resonance
from microvib.testdata.floors import floor_of
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording

PUBLISHED = {"Fx": 29e-3, "Fy": 29e-3, "Fz": 37e-3, "Mx": 3.8e-3, "My": 3.2e-3, "Mz": 1.2e-3}
IN_CHAMBER = {"Fx": 35e-3, "Fy": 49e-3, "Fz": 170e-3, "Mx": 4.4e-3, "My": 2.1e-3, "Mz": 2.2e-3}
IDEAL = {"sample_rate": 1024.0, "duration": 16.0, "lead": 1.0}
FAST = {"sample_rate": 4096.0, "duration": 4.0}
UNITS = {name: "N" if name.startswith("F") else "N*m" for name in COMPONENTS}


def bench_of(**settings) -> Bench:
    return in_si(Bench, **{**IDEAL, **settings})


def no_load(bench: Bench, seed: int = 1) -> Recording:
    """Recording of a table that nothing loads."""
    quiet = np.zeros((6, math.ceil(bench.span * bench.analog_rate)))
    return measure(bench, quiet, quiet[0], seed=seed)


def tone_through(bench: Bench, frequency: float, component: str = "Mz") -> Recording:
    """Recording of a tone of amplitude 1 in one component."""
    n = math.ceil(bench.span * bench.analog_rate)
    loads = np.zeros((6, n))
    t = np.arange(n) / bench.analog_rate
    loads[COMPONENTS.index(component)] = np.cos(2 * np.pi * frequency * t)
    return measure(bench, loads, np.zeros(n))


def rms_in(x: np.ndarray, rate: float, low: float, high: float) -> float:
    """RMS between two frequencies, by Parseval."""
    f = np.fft.rfftfreq(x.size, 1.0 / rate)
    power = 2.0 * np.abs(np.fft.rfft(x) / x.size) ** 2
    return math.sqrt(power[(f > max(low, 0.0)) & (f <= high)].sum())


# Noise of the channels


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("calibration-mechanism-table", PUBLISHED),
        ("calibration-mechanism-table-in-chamber", IN_CHAMBER),
    ],
)
@pytest.mark.parametrize("rate", [1024.0, 4096.0, 10_000.0])
def test_each_channel_has_its_published_rms_at_any_sample_rate(name, published, rate):
    """16 s hold 8000 bins of the band: their mean square is good to 1.1 %, the RMS to 0.6 %."""
    bench = load_bench(name).model_copy(
        update={"sample_rate": rate, "filter_corner": None, "lead": 1.0}
    )
    recording = no_load(bench)
    for channel, rms in published.items():
        found = rms_in(recording[channel], rate, 0.0, 500.0)
        assert found == pytest.approx(rms, rel=4 * 0.0056), channel


def test_no_filter_and_no_rounding_changes_the_declared_noise():
    """It is that of the readings, also with a corner inside of the band that the RMS is of."""
    rms = {"highest": 500.0, "Mz": 2e-3}
    found = no_load(bench_of(sample_rate=4096.0, filter_corner=200.0, noise_rms=rms, bits=24))
    assert rms_in(found["Mz"], 4096.0, 0.0, 500.0) == pytest.approx(2e-3, rel=0.025)
    assert np.all(found["Mx"] == 0.0)


def test_noise_with_a_corner_has_the_rms_and_the_slope():
    """1 + f_c/f between 2 and 200 Hz: RMS as declared, a hundred times the power at 1/100 of f_c."""
    rms = {"lowest": 2.0, "highest": 200.0, "Fx": 1.0}
    bench = bench_of(duration=256.0, noise_rms=rms, noise_corner=50.0)
    x = no_load(bench)["Fx"]
    assert rms_in(x, 1024.0, 2.0, 200.0) == pytest.approx(1.0, rel=0.02)
    density = 1.0 / (198.0 + 50.0 * math.log(100.0))
    f, psd = signal.welch(x, 1024.0, nperseg=16384)
    for low, high in ((0.4, 0.6), (4.0, 6.0), (100.0, 400.0)):
        band = (f > low) & (f < high)
        expected = np.mean(density * (1.0 + 50.0 / f[band]))
        assert psd[band].mean() == pytest.approx(expected, rel=0.25)


def test_a_density_is_that_of_the_reading():
    bench = bench_of(noise_density={"My": 3e-4}, duration=64.0)
    f, psd = signal.welch(no_load(bench)["My"], 1024.0, nperseg=4096)
    assert math.sqrt(psd[10:-10].mean()) == pytest.approx(3e-4, rel=0.02)


def test_channels_are_independent_and_seeds_are_draws():
    bench = bench_of(noise_rms={"highest": 500.0, **PUBLISHED})
    first, again, other = (no_load(bench, seed).six() for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.max(np.abs(np.corrcoef(first) - np.eye(6))) < 5 / math.sqrt(first.shape[1])
    assert abs(np.corrcoef(first[0], other[0])[0, 1]) < 5 / math.sqrt(first.shape[1])


def test_noise_of_single_channels_leaves_the_other_stages_as_they_are():
    """A bench without the new keys, and the noise and phases of one with them, are the same draws."""
    common = {"force_noise": 1e-3, "mains_force": 0.1, "noise_corner": 2.0}
    before = no_load(bench_of(**common)).six()
    after = no_load(bench_of(**common, noise_rms={"lowest": 1.0, "highest": 9.0, "Mz": 1.0})).six()
    np.testing.assert_array_equal(before[:5], after[:5])
    assert np.std(after[5] - before[5]) > 1.0


def test_the_bench_of_the_catalog_reads_what_it_always_read():
    """Samples of a release that knew nothing of channels' noise."""
    bench = load_bench("force-table")
    n = math.ceil(bench.span * bench.analog_rate)
    t = np.arange(n) / bench.analog_rate
    loads = np.array([0.1 * (k + 1) * np.cos(2 * np.pi * 11.3 * (k + 1) * t) for k in range(6)])
    read = measure(bench, loads, 1e-3 * t, "z", 7).six()[:, 1000]
    assert read == pytest.approx(
        [
            0.027477741241455078,
            0.0002980232238769531,
            -0.03165006637573242,
            -0.15475749969482422,
            -0.33650994300842285,
            -0.5779743194580078,
        ],
        abs=1e-9,
    )


# Mains


@pytest.mark.parametrize("clock_error", [0.0, 1e-4])
def test_mains_lines_have_their_amplitudes(clock_error):
    pick_up = [{"harmonic": 1, "Fx": 5e-3, "Mz": 2e-4}, {"harmonic": 3, "Mz": 7e-4}]
    bench = bench_of(pick_up=pick_up, clock_error=clock_error, filter_corner=100.0)
    found = no_load(bench)
    for channel, harmonic, amplitude in (("Fx", 1, 5e-3), ("Mz", 1, 2e-4), ("Mz", 3, 7e-4)):
        f = 50.0 * harmonic / (1.0 + clock_error)
        assert tone_amplitude(found[channel], 1024.0, f) == pytest.approx(amplitude, rel=1e-3)
    assert tone_amplitude(found["Fx"], 1024.0, 150.0) < 1e-6
    assert np.all(found["My"] == 0.0)


# Moved torques


def test_a_moved_torque_has_the_noise_of_its_levers():
    """sqrt(M_z^2 + x^2 F_y^2 + y^2 F_x^2), and M_x and M_y share that of F_z: -x y F_z^2."""
    x, y, z = 0.7, 0.9, 0.12
    bench = bench_of(
        noise_rms={"highest": 500.0, **PUBLISHED}, duration=64.0, offset=[x, y, z],
        torques_about="interface",
    )  # fmt: skip
    moved = no_load(bench)
    Fx, Fy, Fz, Mx, My, Mz = PUBLISHED.values()
    expected = {
        "Mx": math.sqrt(Mx**2 + (y * Fz) ** 2 + (z * Fy) ** 2),
        "My": math.sqrt(My**2 + (z * Fx) ** 2 + (x * Fz) ** 2),
        "Mz": math.sqrt(Mz**2 + (x * Fy) ** 2 + (y * Fx) ** 2),
    }
    for channel, rms in expected.items():
        assert moved.table.rms(channel) == pytest.approx(rms, rel=1e-12)
        assert rms_in(moved[channel], 1024.0, 0.0, 500.0) == pytest.approx(rms, rel=0.015)
    shared = -x * y * Fz**2 / (expected["Mx"] * expected["My"])
    assert np.corrcoef(moved["Mx"], moved["My"])[0, 1] == pytest.approx(shared, abs=0.02)
    told = "; ".join(moved.notes)
    assert f"Mx and My then share noise of Fz (correlation {shared:.2f})" in told
    assert (
        f"noise of Mz rises from 1.2 mN m to {1e3 * expected['Mz']:.3g} mN m RMS from 0 to 500 Hz"
        in told
    )


def test_the_bench_and_the_preparation_move_torques_alike():
    """The bench reads about the table's origin; both ways lead back to the interface's load."""
    settings = {"offset": [0.3, -0.2, 0.1], "noise_rms": {"highest": 500.0, **PUBLISHED}}
    bench = bench_of(**settings)
    n = math.ceil(bench.span * bench.analog_rate)
    loads = np.random.default_rng(3).normal(size=(6, n))
    read = measure(bench, loads, np.zeros(n))
    at_interface = measure(bench_of(**settings, torques_about="interface"), loads, np.zeros(n))
    prepared = Preparation(offset=(0.3, -0.2, 0.1)).apply(read)
    np.testing.assert_array_equal(prepared.six(), at_interface.six())
    np.testing.assert_array_equal(prepared.table.noise, at_interface.table.noise)
    first = round(bench.lead * bench.analog_rate)
    ideal = measure(bench_of(offset=[0.3, -0.2, 0.1]), loads, np.zeros(n))
    lever = np.cross([0.3, -0.2, 0.1], loads[:3, first].T)
    assert [ideal[c][0] for c in COMPONENTS[3:]] == pytest.approx(loads[3:, first] + lever)
    back = Preparation(offset=(0.3, -0.2, 0.1)).apply(ideal)
    np.testing.assert_allclose(back.six(), loads[:, first::4][:, : bench.samples], atol=1e-12)


def test_torques_are_not_moved_twice():
    bench = bench_of(offset=[0.0, 0.0, 0.1], torques_about="interface")
    recording = no_load(bench_of(noise_rms={"highest": 500.0, **PUBLISHED}))
    with pytest.raises(mv.MicrovibError, match="offset: the bench records torques about the inter"):
        in_si(Preparation, bench=bench.model_dump(), offset=(0.0, 0.0, 0.1)).apply(recording)
    told = no_load(bench_of(offset=[0.0, 0.0, 0.1])).notes
    assert any("write offset: [0.0, 0.0, 0.1] in the preparation file" in note for note in told)


def test_noise_that_fills_a_part_of_the_band_is_told_when_it_is_moved():
    """Noise of a force up to 256 of 2048 Hz: the median of the whole record does not show it."""
    rng = np.random.default_rng(5)
    n, rate = 65536, 4096.0
    low_pass = signal.butter(8, 256.0, fs=rate, output="sos")
    channels = {name: 1e-6 * rng.normal(size=n) for name in COMPONENTS}
    channels["Mz"] *= 1e3
    channels["Fy"] += signal.sosfilt(low_pass, rng.normal(size=n))
    channels["Mz"] += 0.5 * signal.sosfilt(low_pass, rng.normal(size=n))
    moved = Preparation(offset=(1.12, 0.0, 0.0)).apply(Recording(channels, rate, UNITS))
    (told,) = (note for note in moved.notes if "raises the floor of Mz" in note)
    times = float(told.split("floor of Mz")[1].split(" times")[0].split(", ")[-1])
    assert times == pytest.approx(math.hypot(0.5, 1.12) / 0.5, rel=0.1)
    low, high = told.split("(RMS of the whole floor ")[-1].split(" N*m")[0].split(" to ")
    assert float(low) == pytest.approx(channels["Mz"].std(), rel=0.1)
    assert float(high) == pytest.approx(moved["Mz"].std(), rel=0.1)


def test_the_floor_of_white_noise_is_its_density_in_every_octave():
    x = 0.3 * np.random.default_rng(1).normal(size=65536)
    floor = floor_of(x, 1000.0)
    density = 0.3 * math.sqrt(2.0 / 1000.0)
    assert floor.whole == pytest.approx(density, rel=0.02)
    assert floor.octaves == pytest.approx(density, rel=0.35)
    assert floor.octaves[-4:] == pytest.approx(density, rel=0.05)
    assert floor.rms == pytest.approx(0.3, rel=0.02)


def test_a_line_below_the_moved_floor_is_below_the_floor():
    """What detects lines sees the moved noise: 0.8 mN m stands out, and no longer when moved."""
    bench = bench_of(noise_rms={"highest": 500.0, **PUBLISHED}, offset=[0.9, 0.9, 0.0])
    n = math.ceil(bench.span * bench.analog_rate)
    loads = np.zeros((6, n))
    loads[5] = 0.8e-3 * np.cos(2 * np.pi * 53.0 * np.arange(n) / bench.analog_rate)
    read = measure(bench, loads, np.zeros(n))
    moved = Preparation(offset=(0.9, 0.9, 0.0)).apply(read)
    seen = [
        [x for x in mv.find_lines(one) if x.seen and abs(x.frequency - 53.0) < 0.1]
        for one in (read, moved)
    ]
    assert len(seen[0]) == 1
    assert not seen[1]
    spectra = [HannSpectrum.of(one["Mz"], 1024.0) for one in (read, moved)]
    floors = [np.mean([s.floor(f) for f in np.arange(100.0, 400.0, 5.0)]) for s in spectra]
    expected = math.hypot(1.2, 0.9 * 29, 0.9 * 29) / 1.2
    assert floors[1] / floors[0] == pytest.approx(expected, rel=0.1)


# Resonances


def test_a_mounted_mass_lowers_a_resonance():
    """Published: 1250 Hz empty, 1000 Hz under 10 kg; the table reads k/(k - M w^2) of a force."""
    table = load_bench("source-requirements-table")
    assert table.loaded_table[0].frequency == pytest.approx(1000.0, rel=1e-3)
    bench = bench_of(
        sample_rate=4096.0, mounted={"mass": 7.0, "inertia": [0.0, 0.0, 0.2]},
        table=[
            {"component": "Fx", "frequency": 500.0, "damping": 0.005, "table_mass": 5.0},
            {"component": "Mz", "frequency": 400.0, "damping": 0.005, "table_inertia": 0.1},
        ],
    )  # fmt: skip
    k, c = 5.0 * (2 * np.pi * 500.0) ** 2, 0.0
    for f in (90.0, 200.0, 300.0, 420.0):
        w = 2 * np.pi * f
        loaded = 500.0 * math.sqrt(5.0 / 12.0)
        c = 2 * 0.005 * (2 * np.pi * loaded) * 12.0
        expected = abs(k / (k - 12.0 * w**2 + 1j * c * w))
        read = tone_through(bench, f, "Fx")["Fx"]
        assert tone_amplitude(read, 4096.0, f) == pytest.approx(expected, rel=1e-3)
    assert bench.loaded_table[1].frequency == pytest.approx(400.0 / math.sqrt(3.0))


def at_part(part: float, **settings) -> tuple[Bench, float]:
    """A bench with a resonance of 400 Hz about z, and a frequency at a part of it."""
    table = (in_si(Resonance, component="Mz", frequency=400.0, damping=0.005),)
    return in_si(Bench, **{**IDEAL, **FAST, "table": table, **settings}), part * 400.0


@pytest.mark.parametrize("part", [0.1, 0.2, 0.3, 0.6, 1.5])
def test_a_line_is_biased_by_the_closed_form_and_the_answer_says_so(part):
    """At 0.3 of the resonance 1/(1 - 0.09) = 1.0989; beyond 5 % it is marked, below it is uncertain."""
    bench, f = at_part(part)
    recording = tone_through(bench, f)
    closed = 1.0 / math.hypot(1.0 - part**2, 2.0 * 0.005 * part)
    table = mv.find_lines(recording)
    line = min(table, key=lambda x: abs(x.frequency - f))
    assert line.amplitude == pytest.approx(closed, rel=1e-3)
    if abs(closed - 1.0) > 0.05:
        assert line.status == "near a table resonance"
        assert not line.seen
        (told,) = force_table_notes(table, recording, "Mz")
        assert f"resonance of Mz at 400 Hz makes the reading {closed:.3g} times the load" in told
    else:
        assert line.status == "ok"
        assert line.amplitude_uncertainty == pytest.approx(closed * (closed - 1.0), rel=0.05)
        assert abs(line.amplitude - 1.0) < 1.1 * line.amplitude_uncertainty
    assert table.unusable


def test_a_limit_near_a_resonance_is_not_judged():
    """Neither passed nor failed: the load is 1, the reading at 0.3 of the resonance 1.099."""
    bench, f = at_part(0.3)
    table = mv.find_lines(tone_through(bench, f))
    for torque in (0.5, 1.05, 2.0):
        judged = judge(table, limit_of(torque, 100.0, 150.0))
        assert judged.verdict == "not judged"
        assert "the table's resonance (Mz at 400 Hz)" in str(judged)
    bench, f = at_part(0.2)
    table = mv.find_lines(tone_through(bench, f))
    assert judge(table, limit_of(2.0, 60.0, 85.0)).verdict == "pass"
    assert judge(table, limit_of(0.5, 60.0, 85.0)).verdict == "fail"


def test_the_ends_of_what_is_judged_are_those_of_the_closed_form():
    """1/(1 - r^2) = 1.05 at r = sqrt(1 - 1/1.05). Above the resonance nothing is usable: where the
    amplitude is right, at r = sqrt(2), the sign is not."""
    table = at_part(0.3)[0].force_table
    (one,) = table.unusable("Mz")
    assert one.low == pytest.approx(400.0 * math.sqrt(1.0 - 1.0 / 1.05), rel=1e-3)
    assert math.isinf(one.high)
    assert table.unusable("Mx") == ()


def test_beyond_the_usable_band_nothing_is_judged():
    bench = bench_of(**FAST, usable={"lowest": 1.0, "highest": 350.0})
    recording = tone_through(bench, 371.0)
    table = mv.find_lines(recording)
    (line,) = (x for x in table if abs(x.frequency - 371.0) < 0.1)
    assert line.status == "beyond the usable band"
    assert judge(table, limit_of(2.0, 360.0, 380.0)).verdict == "not judged"
    assert judge(table, limit_of(2.0, 0.5, 300.0)).verdict == "not judged"
    assert judge(table, limit_of(2.0, 1.0, 300.0)).verdict == "pass"


def test_a_moved_torque_resonates_with_its_forces():
    """The torque about z has no resonance; moved, it is made of Fy, which has."""
    table = [{"component": "Fy", "frequency": 400.0, "damping": 0.005}]
    still = bench_of(table=table, offset=[0.5, 0.0, 0.0])
    n = math.ceil(still.span * still.analog_rate)
    t = np.arange(n) / still.analog_rate
    loads = np.zeros((6, n))
    loads[1] = np.cos(2 * np.pi * 120.0 * t)
    read = measure(still, loads, np.zeros(n))
    moved = Preparation(offset=(0.5, 0.0, 0.0)).apply(read)
    assert read.table.objection("Mz", 120.0) == ""
    assert "resonance of Fy at 400 Hz" in moved.table.objection("Mz", 120.0)
    line = min(mv.find_lines(moved), key=lambda x: abs(x.frequency - 120.0))
    expected = 0.5 * (1.0 / (1.0 - 0.3**2) - 1.0)  # the load there has no torque about z
    assert line.amplitude == pytest.approx(expected, rel=1e-3)
    assert line.status == "near a table resonance"


# From the file to the answer


def test_a_bench_in_the_preparation_file_reaches_every_answer(tmp_path):
    scenario = baseline()
    bench = load_bench("calibration-mechanism-table").model_copy(update={"duration": 8.0})
    write_recording(measure_scenario(scenario, bench), tmp_path / "test.uff")
    (tmp_path / "how.yaml").write_text("bench: calibration-mechanism-table\n")
    prepared = read_prepared(tmp_path / "test.uff", load_preparation(tmp_path / "how.yaml"))
    analysis = analyse(prepared, scenario=scenario)
    assert analysis.table["drive_7"].status == "beyond the usable band"
    assert analysis.table["drive_1"].status == "ok"
    told = "\n".join(analysis.recording.notes_on("Mz"))
    assert "drive_7" in told
    assert "usable from 1 to 350 Hz" in told
    verdicts = {row.line: row.verdict for row in compare(prepared, scenario).rows}
    assert verdicts["drive_7"] == "not judged"
    assert verdicts["drive_1"] != "not judged"
    compared = compare(prepared, scenario)
    assert "beyond the usable band of the force table" in verdict_sentence(compared.rows)
    unknown = analyse(Prepared(prepared.recording), scenario=scenario)
    assert unknown.table["drive_7"].status == "beyond the usable band"
    bare = analyse(read_prepared(tmp_path / "test.uff"), scenario=scenario)
    assert bare.table["drive_7"].status == "ok"


def test_a_bench_file_is_relative_to_the_preparation_file(tmp_path):
    (tmp_path / "bench.yaml").write_text("usable: {lowest: 1 Hz, highest: 99 Hz}\n")
    (tmp_path / "how.yaml").write_text("bench: bench.yaml\n")
    (tmp_path / "own.yaml").write_text("bench: {usable: {highest: 98 Hz}}\n")
    assert load_preparation(tmp_path / "how.yaml").bench.usable.highest == 99.0
    assert load_preparation(tmp_path / "own.yaml").bench.usable.highest == 98.0
    (tmp_path / "wrong.yaml").write_text("bench: shaker\n")
    with pytest.raises(mv.ScenarioError, match="no catalog bench of this name"):
        load_preparation(tmp_path / "wrong.yaml")


def test_the_bench_says_what_it_makes_of_the_load():
    bench, f = at_part(0.6, mounted={"mass": 3.0})
    told = "\n".join(tone_through(bench, f).notes)
    assert "3 kg mounted" in told
    assert "Mz: the load has 707 mN m RMS, its reading" in told
    assert "after table resonances" in told


def test_published_benches_are_in_the_catalog():
    assert {"calibration-mechanism-table", "calibration-mechanism-table-in-chamber"} < set(
        bench_names()
    )
    for name in bench_names():
        load_bench(name)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("noise_rms: {Fx: 29 mN}", "noise_rms.highest: missing"),
        ("noise_rms: {highest: 500 Hz, Fx: 29 mN*m}", "noise_rms.Fx: '29 mN.m' has the wrong dim"),
        ("noise_rms: {highest: 500 Hz, Mz: -1 mN*m}", "noise_rms.Mz: '-1 mN.m' is not allowed"),
        ("noise_rms: {lowest: 9 Hz, highest: 5 Hz}", "noise_rms.lowest: 9 Hz is not below highest"),
        (
            "{noise_corner: 2 Hz, noise_rms: {highest: 500 Hz, Fx: 1 N}}",
            "noise_rms.lowest: 0 Hz does not go with noise_corner",
        ),
        (
            "{force_noise: 1 N/Hz^0.5, noise_rms: {highest: 500 Hz, Fx: 1 N}}",
            "noise_rms.Fx: force_noise states noise of Fx, too",
        ),
        (
            "{noise_density: {Fx: 1 N/Hz^0.5}, noise_rms: {highest: 500 Hz, Fx: 1 N}}",
            "noise_rms.Fx: noise_density states noise of Fx, too",
        ),
        ("pick_up: [{harmonic: 41, Fx: 1 N}]", "pick_up.0.harmonic: 2050 Hz is not below half"),
        ("pick_up: [{harmonic: 0}]", "pick_up.0.harmonic: 0 is not allowed"),
        ("pick_up: [{Fx: 1 N}, {Fx: 2 N}]", "pick_up: harmonic 1 is listed 2 times"),
        ("{mains_force: 1 N, pick_up: [{Fx: 1 N}]}", "pick_up.0.Fx: mains_force states it, too"),
        ("usable: {highest: 5 kHz}", "usable.highest: 5000 Hz is above half the sample rate"),
        ("torques_about: interface", "torques_about: interface needs offset"),
        ("offset: [0, 0, 1]", "offset.2"),
        ("mounted: {mass: 0 kg}", "mounted.mass: '0 kg' is not allowed"),
        (
            "{mounted: {mass: 1 kg}, table: [{component: Fx, frequency: 9 Hz, damping: 0.1}]}",
            "table.0.table_mass: missing, in kg",
        ),
        (
            "table: [{component: Mx, frequency: 9 Hz, damping: 0.1, table_mass: 1 kg}]",
            "table.0.table_mass: does not go with Mx",
        ),
        (
            "platform: [{component: Fx, frequency: 9 Hz, damping: 0.1, table_mass: 1 kg}]",
            "platform.0.table_mass: applies to resonances of the table",
        ),
        ("largest_bias: 0", "largest_bias"),
    ],
)
def test_bad_benches_are_named(tmp_path, text, words):
    path = tmp_path / "bench.yaml"
    path.write_text(text)
    with pytest.raises(mv.ScenarioError, match=words) as told:
        load_bench(path)
    assert len(str(told.value).splitlines()) == 1


def test_an_rms_in_a_band_is_a_density():
    part = in_si(ChannelRms, lowest=0.0, highest=500.0, Fx=29e-3)
    density = part.densities(0.0)
    assert density[0] == pytest.approx(29e-3 / math.sqrt(500.0))
    assert np.all(np.isnan(density[1:]))


def test_samples_of_the_noise_are_normal():
    x = no_load(bench_of(noise_rms={"highest": 500.0, "Fx": 1.0}))["Fx"]
    assert stats.kstest(x / x.std(), "norm").pvalue > 1e-3
