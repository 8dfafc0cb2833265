"""Hammer tests of a virtual table with known resonances: responses, resonances, blows that are left out."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from support.hammer import blows, resonance

import microvib as mv
from microvib.analysis.lines import lines_of_recording
from microvib.cli.main import main
from microvib.io.recordings import load_preparation, read_prepared, write_recording
from microvib.io.scenario_file import load_bench
from microvib.reports.hammer import hammer_outcome
from microvib.reports.outcome import terminal_text
from microvib.signals.impacts import ImpactError, impact_response
from microvib.studies.hammer import HammerTest, Hits, hammer_test
from microvib.testdata.bench_parts import table_response
from microvib.testdata.recording import Recording, RecordingError


def found(recording: Recording, load: str = "Mz", **how) -> HammerTest:
    return hammer_test([Hits(load, recording)], "hammer", mounted_mass="0 kg", **how)


def test_resonances_of_drawn_tables_lie_within_their_uncertainties():
    """Frequency and damping of twelve drawn tables, over their standard uncertainties."""
    rng, off = np.random.default_rng(1), []
    for seed in range(12):
        f, damping = rng.uniform(150.0, 800.0), 10.0 ** rng.uniform(-2.3, -1.3)
        noise = 10.0 ** rng.uniform(-2.5, -0.8)
        test = found(blows([resonance("Mz", f, damping)], noise=noise, seed=seed))
        assert len(test.resonances) == 1
        got = test.resonances[0]
        assert got.frequency == pytest.approx(f, rel=1e-3)
        assert got.damping == pytest.approx(damping, rel=0.05)
        off += [
            (got.frequency / f - 1.0) / got.frequency_uncertainty,
            (got.damping / damping - 1.0) / got.damping_uncertainty,
        ]
    assert 0.4 < float(np.sqrt(np.mean(np.square(off)))) < 1.7
    assert np.max(np.abs(off)) < 5.0


def test_two_resonances_with_shares_are_told_apart():
    two = [resonance("Fz", 420.0, 0.01, 0.3), resonance("Fz", 640.0, 0.008)]
    test = found(blows(two, noise=0.02), "Fz")
    got = sorted(test.resonances, key=lambda x: x.frequency)
    assert [x.frequency for x in got] == pytest.approx([420.0, 640.0], rel=1e-3)
    assert [x.damping for x in got] == pytest.approx([0.01, 0.008], rel=0.1)
    assert [x.share for x in got] == pytest.approx([0.3, 1.0], abs=0.03)
    assert test.responses.first_resonance("Fz") == pytest.approx(420.0, rel=0.01)


@pytest.mark.parametrize(
    ("factor", "told"),
    [(0.85, "0.85 times its load"), (-1.0, "its sign is reversed"), (1.0, "")],
)
def test_a_reading_that_is_not_its_load_at_low_frequencies_is_told(factor, told):
    recording = blows([resonance()], noise=0.01)
    scaled = replace(
        recording, channels={**recording.channels, "Mz": factor * recording.channels["Mz"]}
    )
    said = terminal_text(hammer_outcome(found(scaled)))
    assert ("at low frequencies" in said) == bool(told)
    assert told in said


def test_the_response_is_within_its_uncertainty():
    one = resonance("Mz", 300.0, 0.02)
    got = found(blows([one], noise=0.1, seed=4)).each["Mz"]
    w = 2.0 * math.pi * one.frequency
    exact = table_response(2j * math.pi * got.frequency, w, one)
    within = (got.frequency < 400.0) & (got.coherence > 0.8)
    z = np.abs(got.H - exact)[within] / got.uncertainty[within]
    # real and imaginary parts have this deviation each, estimated with nine degrees of freedom
    assert float(np.sqrt(np.median(z**2) / (2.0 * math.log(2.0)))) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("later", [0.02, 1.5e-3, 0.3])
def test_a_double_hit_is_left_out_and_named(later):
    recording = blows([resonance()], second=(3, later), noise=0.01)
    test = found(recording)
    left_out = [x for x in test.blows if x.rejected]
    assert len(left_out) == (
        2 if later > 0.1 else 1
    )  # far apart they are two blows, and neither counts
    assert left_out[0].time == pytest.approx(3.5, abs=0.1)
    assert "double hit" in left_out[0].rejected
    assert test.each["Mz"].averages == 9


CRESTS = {
    "half sine": lambda t: np.where(abs(t) < 0.5, np.cos(np.pi * np.clip(t, -0.5, 0.5)), 0.0),
    "raised cosine": lambda t: np.where(
        abs(t) < 0.5, np.cos(np.pi * np.clip(t, -0.5, 0.5)) ** 2, 0.0
    ),
    "flat": lambda t: np.maximum(1.0 - (2.0 * t) ** 4, 0.0),
}


def clipped_blows(crest, samples: int, level: float, noise: float) -> list[str]:
    """Why the ten blows of a hammer whose force is cut off at a ``level`` are left out; its noise is behind that."""
    rng, n = np.random.default_rng(2), 11 * 1024
    t = np.arange(n) / samples
    force = sum(crest(t - (600.0 + 1024.0 * k + rng.random()) / samples) for k in range(10))
    reading = np.sin(0.3 * np.arange(n)) * np.exp(-0.05 * (np.arange(n) % 1024 - 600.0).clip(0.0))
    reading = np.where(np.arange(n) % 1024 >= 600, reading, 0.0)
    seen = np.minimum(force, level) + noise * rng.normal(size=n)
    try:
        test = impact_response(seen, reading, 1024.0)
    except ImpactError as error:
        return re.findall(r"s: (\w+)", str(error))
    return [blow.rejected for blow in test.blows]


@pytest.mark.parametrize("crest", [*CRESTS])
@pytest.mark.parametrize(
    ("samples", "level", "noise"), [(40, 0.8, 1e-3), (40, 0.5, 3e-3), (100, 0.9, 1e-3)]
)
def test_a_clipped_force_is_told_whatever_noise_lies_on_it(crest, samples, level, noise):
    left_out = clipped_blows(CRESTS[crest], samples, level, noise)
    assert left_out.count("clipped") >= 8
    assert "clipped" not in clipped_blows(CRESTS[crest], samples, 2.0, noise)


@pytest.mark.parametrize("crest", [*CRESTS])
@pytest.mark.parametrize("samples", [5, 10, 20, 60])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-3, 2e-2])
def test_a_crest_of_a_blow_is_not_called_clipped(crest, samples, noise):
    assert "clipped" not in clipped_blows(CRESTS[crest], samples, 2.0, noise)


def test_clipped_weak_and_unsettled_blows_are_left_out():
    plain = blows([resonance()], noise=0.01)
    force = plain["hammer"].copy()
    clipped = np.minimum(force, 60.0)
    told = [
        x.rejected
        for x in found(replace(plain, channels={**plain.channels, "hammer": clipped})).blows
    ]
    assert "clipped" in told
    reading = plain["Mz"]
    limit = 0.5 * np.max(np.abs(reading))
    over = {**plain.channels, "Mz": np.clip(reading, -limit, limit)}
    told = [x.rejected for x in found(replace(plain, channels=over)).blows]
    assert any("reading is clipped" in one for one in told)
    ringing = blows([resonance("Mz", 40.0, 0.003)], noise=0.01)
    with pytest.raises(RecordingError, match="not at rest"):
        found(ringing)


def test_a_long_ringing_is_windowed_and_its_damping_is_not_the_window_s():
    one = resonance("Mz", 60.0, 0.002)
    test = found(blows([one], count=6, gap=20.0, noise=0.01), block="2 s")
    got = test.resonances[0]
    assert test.each["Mz"].window_decay > 0.0
    assert got.damping == pytest.approx(0.002, rel=0.05)  # the window alone has 0.006


def test_noise_alone_has_no_resonance():
    """A rigid table, over twenty draws: no peak of noise is called a resonance."""
    for seed in range(20):
        rigid = blows([resonance("Mz", 4000.0, 0.5)], noise=0.15, seed=seed)
        assert found(rigid).resonances == ()


def test_h2_is_h1_over_the_coherence_and_h1_is_right_under_noise_of_the_reading():
    rng = np.random.default_rng(0)
    n, rate = 40 * 4096, 4096.0
    force = np.zeros(n)
    force[2000::4096] = 100.0
    reading = 2.0 * force + rng.normal(size=n) * 2.0
    one, two = (impact_response(force, reading, rate, 0.9, which) for which in ("H1", "H2"))
    np.testing.assert_allclose(np.abs(two.H), np.abs(one.H) / one.coherence, rtol=1e-9)
    assert float(np.mean(one.H.real)) == pytest.approx(2.0, rel=0.01)
    assert float(np.median(np.abs(two.H))) > 2.1


def test_fewer_than_three_blows_are_refused():
    with pytest.raises(RecordingError, match="2 blows count, and 3 are needed"):
        found(blows([resonance()], count=2))


def test_a_hammer_in_volts_is_refused_with_what_to_add():
    recording = blows([resonance()])
    units = {**recording.units, "hammer": "V"}
    with pytest.raises(RecordingError, match="sensitivity"):
        found(replace(recording, units=units))


def test_its_files_correct_a_recording_and_make_a_bench(tmp_path, monkeypatch):
    """From blows and a run on the same virtual table to the run's own lines, by both files."""
    monkeypatch.chdir(tmp_path)
    write_recording(
        blows([resonance("Mz", 300.0, 0.02)], noise=0.03, arm=0.2, count=20), tmp_path / "mz.uff"
    )
    command = ["hammer", "Mz@0.2m=mz.uff", "--mounted-mass", "30 kg", "-o", "table"]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    bench = load_bench(str(tmp_path / "table" / "table.yaml"))
    assert bench.table[0].frequency == pytest.approx(300.0, rel=1e-3)
    scenario = mv.load_scenario("state-1")
    from microvib.studies.measure import measure

    write_recording(measure(scenario, bench), tmp_path / "run.uff")
    truth = mv.find_lines(mv.simulate(scenario, channels=("T_d",)))
    for text in (
        "table_frf: {file: table/frf.csv, mounted_mass: 30 kg, test_mass: 30 kg}",
        "bench: table/table.yaml\ntable_frf: {}",
    ):
        (tmp_path / "how.yaml").write_text(text)
        read = read_prepared(tmp_path / "run.uff", load_preparation(tmp_path / "how.yaml"))
        table = lines_of_recording(read.recording, "Mz", scenario)
        for name in ("drive_1", "drive_2"):
            assert table[name].seen
            assert table[name].amplitude == pytest.approx(truth[name].amplitude, rel=0.02)
        assert table["drive_3"].status == "beyond the table's FRF"


@pytest.mark.parametrize(
    ("hits", "told"),
    [
        ("Fz", "LOAD=FILE is expected"),
        ("Mz=a.uff", "needs a lever arm"),
        ("Fz@0.2m=a.uff", "has no lever arm"),
        ("Mz@0m=a.uff", "makes no torque"),
        ("Mz@2=a.uff", "unit"),
    ],
)
def test_wrong_hits_are_a_sentence(hits, told):
    done = CliRunner().invoke(main, ["hammer", hits, "--mounted-mass", "0 kg"])
    assert done.exit_code != 0
    assert told in str(done.exception) + done.output
