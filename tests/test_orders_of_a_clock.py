"""Orders of a stated step clock: of an accelerometer's record of others, of records made in its shape;
and how short a record may be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.real_files import real_file
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.lines import lines_of_recording, shortest_judged_record, shortest_record
from microvib.analysis.orders import ABOVE_FLOOR, IN_FLOOR
from microvib.cli.main import main
from microvib.io.recordings import Prepared, read_prepared
from microvib.studies.analyse import Analysis, analyse
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import Si

COUNTS_PER_G = 16384
CLOCK = {"step_rate": "4000 Hz", "steps_per_period": 64}
COLUMNS = {"ax": "column 1", "ay": "column 2", "az": "column 3"}
HOW = Preparation(
    sample_rate=Si(4000.0),
    sensitivity=dict.fromkeys(COLUMNS.values(), f"{COUNTS_PER_G} counts/g"),
    channels=COLUMNS,
)
PUBLISHED = {
    "ax": {1: 0.2, 2: 11.6, 3: 3.4, 4: 37.1, 6: 5.1, 8: 3.0},
    "ay": {1: 0.5, 2: 35.0, 3: 3.4, 4: 7.9, 6: 1.4, 8: 1.2},
    "az": {1: 0.3, 2: 14.5, 3: 0.4, 4: 6.9, 6: 1.4, 8: 1.1},
}
"""Amplitudes [mg] at orders of f_e, as they are known of the record: bins of the whole."""
MADE = {2: 11.6, 3: 3.4, 4: 37.1, 6: 5.1, 8: 3.0}


def findings(found: Analysis) -> dict[int, str]:
    return {line.order: line.finding for line in found.orders}


@pytest.mark.parametrize("channel", PUBLISHED)
def test_orders_of_a_measured_stepper(channel):
    record = read_prepared(real_file("stepper/250usec_slew.txt"), HOW)
    found = analyse(record, channel=channel, **CLOCK)
    assert found.recording.duration == 0.8
    assert found.unit == "g"
    for order, finding in findings(found).items():
        if order in (2, 4, 6, 8):
            assert finding.startswith(ABOVE_FLOOR), order
        if order == 1:
            assert finding == IN_FLOOR
    by_order = {line.order: 1e3 * line.bin_amplitude for line in found.orders}
    for order, published in PUBLISHED[channel].items():
        assert by_order[order] == pytest.approx(published, abs=0.06), (
            order
        )  # of one decimal, from two
    assert any("not steady" in note for note in found.recording.notes)


def counts(ratio: float = 1.0, samples: int = 3200) -> np.ndarray:
    """An axis of a record in the shape of the measured one, in whole counts."""
    t = np.arange(samples) / 4000.0
    x = np.random.default_rng(3).normal(0.0, 0.7, samples) - 900.0
    for order, size in MADE.items():
        x += 1e-3 * size * COUNTS_PER_G * np.cos(2.0 * np.pi * 62.5 * ratio * order * t + order)
    return np.rint(x)


def written(folder: Path, x: np.ndarray) -> Path:
    """A text file of three columns without header or time axis."""
    path = folder / "slew.txt"
    np.savetxt(path, np.column_stack([x, x[::-1], x]), fmt="%d")
    return path


@pytest.mark.parametrize("ratio", [1.0, 0.994, 1.013])
def test_orders_of_a_record_of_the_same_shape(tmp_path, ratio):
    found = analyse(read_prepared(written(tmp_path, counts(ratio)), HOW), channel="ax", **CLOCK)
    assert found.clock_ratio == pytest.approx(ratio, abs=5e-5)
    for line in found.orders:
        assert line.finding == (ABOVE_FLOOR if line.order in MADE else IN_FLOOR)
        if line.order in MADE:
            assert line.uncertainty < 0.01e-3
            assert abs(line.amplitude - 1e-3 * MADE[line.order]) < 4.0 * line.uncertainty


def test_a_drive_that_stands_still_shows_no_order(tmp_path):
    still = np.rint(np.random.default_rng(5).normal(0.0, 3.0, 3200))
    found = analyse(read_prepared(written(tmp_path, still), HOW), channel="ax", **CLOCK)
    assert set(findings(found).values()) == {IN_FLOOR}
    assert found.clock_ratio is None
    assert any(
        "no order of 62.5 Hz is above the noise floor" in note for note in found.recording.notes
    )


def test_an_order_that_comes_and_goes_stands_out_without_an_amplitude(tmp_path):
    x = counts()
    x[:1600] += 0.02 * COUNTS_PER_G * np.cos(2.0 * np.pi * 250.0 * np.arange(1600) / 4000.0 + 4.0)
    found = analyse(read_prepared(written(tmp_path, x), HOW), channel="ax", **CLOCK)
    fourth = found.orders[3]
    assert fourth.finding.startswith(ABOVE_FLOOR)
    assert np.isnan(fourth.amplitude) or fourth.uncertainty > 1e-3
    assert any("not steady" in note for note in found.recording.notes)


def test_a_scenario_names_the_orders_of_an_acceleration(state_1):
    f_e = state_1.driving_frequency / 64.0
    t = np.arange(20000) / 1000.0
    x = np.random.default_rng(1).normal(0.0, 1e-4, t.size) + 0.01 * np.cos(
        2.0 * np.pi * 4.0 * f_e * t
    )
    found = analyse(
        Prepared(Recording({"tip": x}, 1000.0, {"tip": "mm/s²"}, "tip").in_si()),
        scenario=state_1, channel="tip",
    )  # fmt: skip
    assert found.unit == "m/s^2"
    assert [k for k, finding in findings(found).items() if finding == ABOVE_FLOOR] == [4]
    assert found.orders[3].amplitude == pytest.approx(1e-5, rel=0.01)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"step_rate": "4000"}, "--step-rate: '4000' needs a unit"),
        ({"step_rate": "0 Hz"}, "must be greater than 0 Hz"),
        ({"step_rate": "100 Hz"}, "1.2 electrical periods of 0.64 s"),
        ({"step_rate": "40000 Hz", "steps_per_period": "2"}, "a higher sample rate is needed"),
        ({"step_rate": "4000 Hz", "scenario": "state-1"}, "give one of the two"),
    ],
)
def test_what_does_not_go_is_a_sentence(tmp_path, how, said):
    path = written(tmp_path, counts())
    prepare = tmp_path / "how.yaml"
    prepare.write_text(
        "sample_rate: 4000 Hz\nsensitivity: {column 1: 16384 counts/g}\nchannels: {ax: column 1}\n"
    )
    how = {"steps_per_period": "64"} | how
    options = [text for key, value in how.items() for text in (f"--{key.replace('_', '-')}", value)]
    told = CliRunner().invoke(
        main, ["analyse", str(path), "--prepare", str(prepare), "--channel", "ax", *options]
    )
    assert told.exit_code != 0
    assert said in told.output
    assert "Traceback" not in told.output


def test_files_are_in_the_unit_of_the_channel(tmp_path):
    path = written(tmp_path, counts())
    prepare = tmp_path / "how.yaml"
    prepare.write_text(
        "sample_rate: 4000 Hz\nunits: {column 1: 0.001 m/s^2}\nchannels: {ax: column 1}\n"
    )
    out = tmp_path / "seen"
    done = CliRunner().invoke(
        main, ["analyse", str(path), "--prepare", str(prepare), "--channel", "ax", "--step-rate", "4000 Hz",
               "--steps-per-period", "64", "--out", str(out)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    for name in ("orders.csv", "lines.csv", "spectrum.csv"):
        header = (out / name).read_text().splitlines()[0]
        assert "amplitude_m_s2" in header
        assert not any(key.endswith("_n_m") for key in header.split(","))


@pytest.mark.parametrize(
    ("unit", "kept", "factor"),
    [
        ("mg", "g", 1e-3),
        ("g", "g", 1.0),
        ("mm/s^2", "m/s^2", 1e-3),
        ("µg", "g", 1e-6),
        ("kg", "kg", 1.0),
    ],
)
def test_units_of_accelerations(unit, kept, factor):
    recording = Recording({"a": np.arange(9.0)}, 100.0, {"a": unit}).in_si()
    assert recording.units["a"] == kept
    assert recording["a"][4] == pytest.approx(4.0 * factor)


def test_an_acceleration_is_no_load(state_1):
    rng = np.random.default_rng(1)
    recording = Recording({"Mz": rng.normal(size=4000)}, 1000.0, {"Mz": "g"}, "made").in_si()
    with pytest.raises(RecordingError, match="neither a force nor a torque"):
        analyse(Prepared(recording))
    named = Recording({"tip": recording["Mz"]}, 1000.0, {"tip": "g"}, "made").in_si()
    with pytest.raises(RecordingError, match="neither a force nor a torque"):
        lines_of_recording(named, "tip", state_1)


def shortened(motion: mv.Motion, duration: float) -> Recording:
    x = motion["T_d"][: round(duration * motion.sample_rate)]
    x = x + 1e-5 * np.random.default_rng(2).normal(size=x.size)
    return Recording({"Mz": x}, motion.sample_rate, {"Mz": "N*m"}, f"{duration:g} s")


def test_a_short_record_shows_what_it_resolves_and_says_what_it_does_not(motion_1, state_1):
    found = analyse(Prepared(shortened(motion_1, 0.5)), scenario=state_1)
    whole = mv.find_lines(motion_1)
    assert found.table["drive_1"].seen
    assert found.table["drive_1"].amplitude == pytest.approx(whole["drive_1"].amplitude, rel=0.02)
    assert found.table["full_step_1"].status == "not resolved: requires a record of at least 0.75 s"
    assert found.table["electrical_1"].status.startswith("not resolved: requires")


def test_a_record_that_resolves_nothing_is_refused(motion_1, state_1):
    with pytest.raises(
        RecordingError, match=r"lasts 0\.004883 s; the lines asked for need 0\.03125 s"
    ):
        analyse(Prepared(shortened(motion_1, 0.005)), scenario=state_1)


def test_verdicts_need_a_record_of_all_lines_or_of_two_seconds(motion_1, state_1):
    short = shortened(motion_1, 1.9)
    assert shortest_record(short, state_1) < 0.1
    assert shortest_judged_record(short, state_1) == 2.0
    with pytest.raises(RecordingError, match=r"lasts 1\.9.* s; the lines asked for need 2 s"):
        lines_of_recording(short, "Mz", state_1)
    fast = state_1.with_({"tracking.rate": "4.5 deg/s"})
    assert fast.driving_frequency / 64.0 == pytest.approx(62.5, rel=0.01)
    fast = fast.with_({"record.sample_rate": "16384 Hz"})
    quick = replace(short, sample_rate=16384.0)
    assert shortest_judged_record(quick, fast) == pytest.approx(
        2.5 / (fast.driving_frequency / 64.0), rel=1e-6
    )


@pytest.mark.parametrize("duration", [0.1, 0.3, 0.6, 1.0, 1.5])
def test_limits_on_a_short_recording_do_not_contradict_a_long_one(motion_1, state_1, duration):
    long = mv.find_lines(
        shortened(motion_1, motion_1["T_d"].size / motion_1.sample_rate), scenario=state_1
    )
    short = mv.find_lines(shortened(motion_1, duration), scenario=state_1)
    largest, judged = max(x.amplitude for x in long if x.seen), 0
    for part in (0.02, 0.1, 0.3, 0.7, 0.95, 1.05):
        for low, high in ((0.5, 2.0), (2.0, 10.0), (0.5, 30.0), (40.0, 60.0), (60.0, 120.0)):
            limit = limit_of(part * largest, low, high)
            verdicts = {mv.judge(table, limit, state_1).verdict for table in (short, long)}
            assert verdicts != {"pass", "fail"}, (limit, verdicts)
            judged += verdicts <= {"pass", "fail"}
    assert judged or duration < 1.0
