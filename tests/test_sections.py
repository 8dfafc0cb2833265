"""Sections of a record, triggers, averages of spectra, and several records at once."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

import microvib as mv
from microvib.cli.main import main
from microvib.errors import MicrovibError, OptionError
from microvib.io.recordings import Prepared, write_recording
from microvib.signals.spectrum import (
    SpectrumError,
    averaged_spectrum,
    noise_bandwidth,
    power_spectral_density,
    window_values,
)
from microvib.studies.analyse import analyse
from microvib.studies.batch import Figure, batch_of, spread_of
from microvib.testdata.recording import Recording
from microvib.testdata.section import Section, Trigger

RATE = 256.0


def record(scale=1.0, seed=0, seconds=40.0):
    """Quiet for 4 s, then a tone of 8 Hz."""
    t = np.arange(round(seconds * RATE)) / RATE
    x = scale * np.cos(2.0 * np.pi * 8.0 * t) * (t >= 4.0)
    x += 1e-3 * np.random.default_rng(seed).normal(size=t.size)
    return Recording(
        {"Mz": x, "key": 5.0 * (t >= 10.0) + 0.1}, RATE, {"Mz": "N*m", "key": "V"}, "r"
    )


def test_a_section_between_two_times():
    cut, offset = Section.stated("5 s", "15 s").cut(record())
    assert (cut.duration, offset) == (10.0, 5.0)
    assert np.array_equal(cut["Mz"], record()["Mz"][1280:3840])
    assert Section.stated() is None
    with pytest.raises(MicrovibError, match="not within its 40 s"):
        Section.stated("5 s", "41 s").cut(record())
    with pytest.raises(MicrovibError, match="is empty"):
        Section.stated("5 s", "5 s").cut(record())
    with pytest.raises(OptionError, match="before the record"):
        Section.stated("-1 s")


@pytest.mark.parametrize(
    ("trigger", "at"),
    [("key > 2.5 V", 10.0), ("Mz > 500 mN*m", 4.0), ("Mz < -0.5 N*m", 4.0 + 1 / 24)],
)
def test_a_trigger_by_level_and_slope(trigger, at):
    cut, offset = Section.stated(None, "6 s", trigger, "0.5 s").cut(record())
    assert offset == pytest.approx(at - 0.5, abs=1.5 / RATE)
    assert cut.duration == pytest.approx(6.5, abs=1.5 / RATE)
    assert any(note.startswith(f"trigger: {trigger.partition(' ')[0]}") for note in cut.notes)


def test_the_sample_of_the_trigger_is_the_first_beyond_it():
    given = record()
    k = Trigger.stated("Mz > 0.5 N*m").place(given)
    assert given["Mz"][k] >= 0.5 > given["Mz"][k - 1]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"trigger": "Mz 5"}, "is not a trigger"),
        ({"trigger": "Mz > 7 N*m"}, "Mz never rises through 7 N[*]m; it goes from"),
        ({"trigger": "Mz > 7 N"}, "is not in the channel's unit, N[*]m"),
        ({"trigger": "Mx > 7 N"}, "no channel 'Mx'"),
        ({"pre_trigger": "1 s"}, "needs a trigger"),
        ({"trigger": "Mz > 0.5 N*m", "start": "1 s"}, "does not go with a trigger"),
        ({"trigger": "Mz > 0.5 N*m", "pre_trigger": "5 s"}, "less than the 5 s before it"),
        ({"trigger": "Mz > 0.5 N*m", "stop": "50 s"}, "not within"),
    ],
)
def test_what_does_not_go_is_said(options, sentence):
    with pytest.raises(MicrovibError, match=sentence):
        Section.stated(**options).cut(record())


def test_faults_outside_a_section_do_not_count():
    given = record()
    x = given["Mz"].copy()
    x[:200] = np.nan
    broken = Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "broken")
    with pytest.raises(MicrovibError):
        analyse(Prepared(broken))
    found = analyse(Prepared(broken), section=Section.stated("5 s", "35 s"))
    assert found.recording.duration == 30.0
    assert max(x.amplitude for x in found.table if x.seen) == pytest.approx(1.0, abs=1e-3)


def test_sections_are_of_recordings():
    with pytest.raises(OptionError, match=r"record\.settle"):
        analyse("state-1", section=Section.stated("1 s"))


@pytest.mark.parametrize("window", ["rectangular", "hann", "flat-top"])
def test_the_noise_bandwidth_of_windows(window):
    w = window_values(window, 4096)
    assert noise_bandwidth(window) == pytest.approx(w.size * np.sum(w**2) / np.sum(w) ** 2)
    x = np.random.default_rng(1).normal(size=20000)
    made = averaged_spectrum(x, RATE, "linear", "1 Hz", window)
    assert f"noise bandwidth {noise_bandwidth(window):.4g} Hz" in str(made)
    # white noise of variance 1: 2 RMS^2 over the half of the sample rate, in each noise bandwidth
    expected = np.sqrt(2.0 * noise_bandwidth(window) / (0.5 * RATE))
    assert np.sqrt(np.mean(made.amplitude[4:-4] ** 2)) == pytest.approx(expected, rel=0.03)


def test_averages_against_their_definitions():
    t = np.arange(round(40 * RATE)) / RATE
    x = np.where(t < 20.0, 1.0, 3.0) * np.cos(2.0 * np.pi * 8.0 * t)
    at = {kind: averaged_spectrum(x, RATE, kind, "1 Hz", overlap=0.0).amplitude[8]
          for kind in ("linear", "peak-hold", "exponential")}  # fmt: skip
    assert at["linear"] == pytest.approx(np.sqrt(5.0), rel=1e-6)
    assert at["peak-hold"] == pytest.approx(3.0, rel=1e-6)
    k = np.arange(40)
    weight = 0.5 ** ((39 - k) / 5.0)
    expected = np.sqrt(np.sum(weight * np.where(k < 20, 1.0, 9.0)) / weight.sum())
    assert at["exponential"] == pytest.approx(expected, rel=1e-6)
    with pytest.raises(SpectrumError, match="average: 'mean' is not known"):
        averaged_spectrum(x, RATE, "mean")
    with pytest.raises(SpectrumError, match=r"overlap: 0\.99"):
        power_spectral_density(x, RATE, "1 Hz", overlap=0.99)


def test_overlap_makes_more_averages():
    x = np.random.default_rng(1).normal(size=4096)
    assert averaged_spectrum(x, RATE, "linear", "1 Hz", overlap=0.0).averages == 16
    assert averaged_spectrum(x, RATE, "linear", "1 Hz", overlap=0.75).averages == 61
    assert power_spectral_density(x, RATE, "1 Hz", overlap=0.75).averages == 61


def test_one_record_of_many_that_falls_out_of_line():
    scales = [1.0, 1.01, 0.99, 1.005, 1.5, 0.995]
    names = [f"run-{k}.csv" for k in range(6)]
    options = {"step_rate": "32 Hz", "section": Section.stated("5 s")}
    found = [analyse(Prepared(record(scale, k)), **options) for k, scale in enumerate(scales)]
    batch = batch_of(names, found)
    by_name = {one.name: one for one in batch.spreads}
    order = by_name["order 1"]
    assert order.mean == pytest.approx(np.mean(scales), rel=1e-3)
    assert order.deviation == pytest.approx(np.std(scales, ddof=1), rel=0.01)
    assert order.outliers == "run-4.csv"
    assert order.highest_in == "run-4.csv"
    assert "order 7" not in by_name  # which is in the floor of all


def test_a_record_that_is_given_twice_counts_twice():
    found = [analyse(Prepared(record()), step_rate="32 Hz")] * 2
    batch = batch_of(["a.csv", "a.csv"], found)
    assert all(one.records == 2 for one in batch.spreads)
    assert batch.names == ("a.csv", "a.csv (2)")


def test_scatter_within_the_uncertainty_names_no_outlier():
    rng = np.random.default_rng(7)
    named = 0
    for _ in range(200):
        figures = {f"{k}": Figure(1.0 + 0.01 * rng.normal(), 0.01) for k in range(8)}
        named += bool(spread_of("x", figures).outliers)
    assert named < 20
    three = {f"{k}": Figure(float(k**4)) for k in range(3)}
    assert spread_of("x", three).outliers == "not told of 3"
    alike = {f"{k}": Figure(1.0) for k in range(5)}
    assert spread_of("x", alike).outliers == ""


def test_one_command_over_several_files(tmp_path):
    files = []
    for k, scale in enumerate([1.0, 1.02, 0.98, 1.4]):
        file = tmp_path / f"unit-{k}.csv"
        write_recording(record(scale, k, 20.0), file)
        files.append(str(file))
    bands = tmp_path / "bands.csv"
    bands.write_text("low_hz,high_hz,limit_n_m\n2,20,1.2\n")
    out = tmp_path / "out"
    done = CliRunner().invoke(main, [
        "analyse", *files, "--trigger", "Mz > 0.5 N*m", "--to", "15 s", "--average", "peak-hold",
        "--resolution", "1 Hz", "--step-rate", "32 Hz", "--bands", str(bands), "-o", str(out),
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    assert ", FAIL" in done.output
    names = {path.name for path in out.iterdir()}
    assert {
        "comparison.csv",
        "figures.csv",
        "unit-0_orders.csv",
        "unit-3_band_peaks.csv",
        "report.html",
    } <= names
    rows = (out / "comparison.csv").read_text().splitlines()
    assert any(row.startswith("order 1,4,") and row.endswith("unit-3.csv") for row in rows)


def test_orders_of_several_sweeps(tmp_path):
    files = []
    t = np.arange(6000) / 600.0
    for k in range(4):
        x = (1.0 + 0.01 * k) * np.cos(2.0 * np.pi * 4.0 * (5.0 * t + t**2))
        x += 0.01 * np.random.default_rng(k).normal(size=t.size)
        file = tmp_path / f"sweep-{k}.csv"
        write_recording(mv.Recording({"Mz": x}, 600.0, {"Mz": "N*m"}), file)
        files.append(str(file))
    out = tmp_path / "out"
    done = CliRunner().invoke(
        main,
        ["track", *files, "--orders", "4,6", "--profile", "0 s:5 Hz, 10 s:25 Hz", "-o", str(out)],
    )
    assert done.exit_code == 0, done.output
    [row] = [x for x in (out / "comparison.csv").read_text().splitlines() if "order 4, mean" in x]
    assert float(row.split('"')[2].split(",")[2]) == pytest.approx(1.015, abs=2e-3)
    assert (out / "sweep-2_order_cuts.csv").is_file()


def test_a_section_between_two_samples_is_said_to_be_empty():
    record = mv.Recording({"Mz": np.zeros(4096)}, 1024.0, {"Mz": "N*m"}, "zeros")
    with pytest.raises(mv.MicrovibError, match=r"holds no sample; samples are 0\.000977 s apart"):
        record.trimmed(1.0, 1.0001)
