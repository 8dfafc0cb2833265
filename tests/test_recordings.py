"""Recordings: read and written in every format, prepared, and refused for what is wrong with them."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from microvib.errors import MicrovibError, OutputError
from microvib.io.recordings import read_prepared, read_recording, write_recording
from microvib.model.rigid import COMPONENTS
from microvib.signals.limit_curve import Limit
from microvib.studies.recording_limits import judge_recording
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel
from microvib.testdata.time_axis import regular_rate

RATE = 4096.0
T = np.arange(4096) / RATE


def made(**changes) -> Recording:
    noise = np.random.default_rng(0).normal(0, 1e-3, (6, T.size))
    channels = {
        name: noise[k] + 0.1 * (k + 1) * np.cos(2 * np.pi * 53 * T)
        for k, name in enumerate(COMPONENTS)
    }
    units = {name: "N" if name.startswith("F") else "N*m" for name in COMPONENTS}
    return Recording(channels | changes, RATE, units, "made")


@pytest.mark.parametrize("ending", ["uff", "mat", "csv"])
def test_what_is_written_is_read(tmp_path, ending):
    path = tmp_path / f"test.{ending}"
    write_recording(made(), path)
    back = read_recording(path)
    assert back.sample_rate == RATE
    for name in COMPONENTS:
        assert back[name] == pytest.approx(made()[name], abs=1e-11)
    with pytest.raises(OutputError, match="already exists"):
        write_recording(made(), path)


LONG = np.arange(4096) / 512.0
TONE = 0.1 * np.cos(2 * np.pi * 53 * LONG) + np.random.default_rng(0).normal(0, 1e-4, LONG.size)
"""0.1 N m at 53 Hz for 8 s."""


def _csv_of(path: Path, *top: str) -> Path:
    """A file of TONE, in decimals, below lines on ``top``."""
    rows = [f"{t:.9g},{x:.9g}" for t, x in zip(LONG, TONE, strict=True)]
    path.write_text("\n".join([*top, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("top", "said"),
    [
        (
            ("Time [s],Mz [N m]", "s,mN m"),
            "channel Mz has two units, 'N m' in its header and 'mN m'",
        ),
        (
            ("Time [s],Mz [mN m]", "s,N m"),
            "channel Mz has two units, 'mN m' in its header and 'N m'",
        ),
        (("Time [s],Mz [N m]", "s,counts"), "channel Mz has two units, 'N m' in its header"),
        (("Time [s],Mz [N m]", "s,V"), "channel Mz has two units, 'N m' in its header and 'V'"),
        (("Time [s],Mz [N m]", "ms,N m"), "channel Time has two units, 's' in its header and 'ms'"),
        (("Time,Mz_mNm", "s,N m"), "channel Mz_mNm has two units, 'mNm' in its name and 'N m'"),
    ],
)
def test_units_of_a_column_that_contradict_each_other_are_refused(tmp_path, top, said):
    """The row below won without a word: 0.1 N m passed 60 mN m as 0.1 mN m."""
    with pytest.raises(RecordingError, match=re.escape(said)) as refused:
        read_recording(_csv_of(tmp_path / "a.csv", *top))
    assert "add the right one to the preparation file, such as units: {" in str(refused.value)


@pytest.mark.parametrize(
    "top",
    [
        ("Time [s],Mz [N m]", "s,N*m"),
        ("Time [s],Mz [Nm]", "sec,N·m"),
        ("Time [s],Mz [filtered]", "s,N m"),
        ("Time [s],Mz", "s,N m"),
        ("Time [s],Mz [N m]", "s,-"),
    ],
)
def test_one_unit_in_two_places_is_read(tmp_path, top):
    back = read_recording(_csv_of(tmp_path / "a.csv", *top))
    assert back["Mz"] == pytest.approx(TONE, rel=1e-6)
    assert back.units["Mz"] == "N*m"


def test_the_preparation_decides_between_two_units(tmp_path):
    path = _csv_of(tmp_path / "a.csv", "Time [s],Mz [N m]", "s,mN m")
    read = read_prepared(path, Preparation(units={"Mz": "N*m"})).recording
    assert np.ptp(read["Mz"]) == pytest.approx(np.ptp(TONE), rel=1e-6)


def test_a_unit_in_a_list_and_another_one_in_a_field_are_refused(tmp_path):
    path, of_units = tmp_path / "a.mat", np.array(["mN*m", "N"], dtype=object)
    names = np.array(["Mz", "Fx"], dtype=object)
    said = {"Mz": made()["Mz"], "Fx": made()["Fx"], "fs": RATE, "names": names, "units": of_units}
    scipy.io.savemat(path, said)
    assert read_recording(path)["Mz"] == pytest.approx(1e-3 * made()["Mz"])
    scipy.io.savemat(path, said | {"Mz_unit": "N*m"})
    with pytest.raises(
        RecordingError, match="channel Mz has two units, 'mN\\*m' in the list of units"
    ):
        read_recording(path)


@pytest.mark.parametrize(
    "line",
    [
        "Scale: 1000",
        "Amplifier gain 10",
        "Multiplier,10",
        "Calibration factor: 250 N m/V",
        "Sensitivity (V/Nm),4",
    ],
)
def test_a_factor_on_top_of_decimals_is_noted_and_lets_no_limit_be_judged(tmp_path, line):
    path, limit = (
        _csv_of(tmp_path / "a.csv", line, "Time [s],Mz [N m]"),
        Limit("10 N*m", "10 Hz", "100 Hz"),
    )
    read = read_recording(path)
    assert any(
        "not whether the samples of Mz are already multiplied by it" in x for x in read.notes
    )
    judged = judge_recording(read, limit)
    assert judged.verdict == "not judged"
    assert "already multiplied by it" in str(judged)
    for unit, verdict in (("N*m", "pass"), ("1000 N*m", "fail")):
        known = read_prepared(path, Preparation(units={"Mz": unit})).recording
        assert judge_recording(known, limit).verdict == verdict


@pytest.mark.parametrize(
    "line",
    [
        "Scale: 1",
        "Gain,1.0",
        "Calibration date: 2024-05-01",
        "Full scale: 10 V",
        "Range 5",
        "Test run 7",
    ],
)
def test_lines_on_top_that_are_no_factor_leave_no_doubt(tmp_path, line):
    read = read_recording(_csv_of(tmp_path / "a.csv", line, "Time [s],Mz [N m]"))
    assert judge_recording(read, Limit("10 N*m", "10 Hz", "100 Hz")).verdict == "pass"


@pytest.mark.parametrize("ending", ["uff", "mat", "csv"])
def test_a_rate_that_is_no_whole_number_comes_back(tmp_path, ending):
    write_recording(replace(made(), sample_rate=4000.7), tmp_path / f"test.{ending}")
    back = read_recording(tmp_path / f"test.{ending}")
    assert back.sample_rate == pytest.approx(4000.7, rel=1e-9)
    assert back["Mz"] == pytest.approx(made()["Mz"], abs=1e-11)


@pytest.mark.parametrize("ending", ["uff", "mat", "csv"])
def test_a_disk_that_fills_up_is_a_sentence(tmp_path, ending):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        with pytest.raises(
            OutputError, match=rf"test\.{ending}: cannot be written: .*nothing was left behind"
        ):
            write_recording(made(), tmp_path / f"test.{ending}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_ascii_uff(tmp_path):
    import pyuff

    path = tmp_path / "binary.uff"
    write_recording(made(), path)
    sets = pyuff.UFF(str(path)).read_sets()
    for s in sets:
        s["binary"] = 0
    pyuff.UFF(str(tmp_path / "ascii.uff")).write_sets(sets, mode="add")
    back = read_recording(tmp_path / "ascii.uff")
    assert back["Mz"] == pytest.approx(made()["Mz"], rel=1e-9, abs=1e-9)


def test_matlab_7_3(tmp_path):
    import h5py

    with h5py.File(tmp_path / "new.mat", "w") as f:
        f["Mz"] = made()["Mz"][None, :]
        f["fs"] = np.array([[RATE]])
    assert read_recording(tmp_path / "new.mat")["Mz"] == pytest.approx(made()["Mz"])


def test_tdms(tmp_path):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(str(tmp_path / "test.tdms")) as writer:
        properties = {"wf_increment": 1 / RATE, "unit_string": "mNm"}
        writer.write_segment(
            [ChannelObject("table", "Mz", 1e3 * made()["Mz"], properties=properties)]
        )
    back = read_recording(tmp_path / "test.tdms")
    assert back.sample_rate == RATE
    assert back["Mz"] == pytest.approx(made()["Mz"])  # mN m became N m


def test_csv_with_decimal_comma_and_unit_row(tmp_path):
    rows = [
        "time;Mz",
        "s;mNm",
        *(f"{t:.8f};{1e3 * x:.6f}".replace(".", ",") for t, x in zip(T, made()["Mz"], strict=True)),
    ]
    (tmp_path / "german.csv").write_text("\n".join(rows))
    back = read_recording(tmp_path / "german.csv")
    assert back.sample_rate == pytest.approx(RATE, rel=1e-6)
    assert back["Mz"] == pytest.approx(made()["Mz"], abs=1e-8)


def test_a_single_column_with_decimal_commas_is_not_two(tmp_path):
    """The comma that parts numbers in other files is their decimal mark where the header has one name."""
    path = tmp_path / "test.csv"
    numbers = [f"{v:.6f}".replace(".", ",") for v in 1e3 * made()["Mz"][:100]]
    path.write_text(
        "Abtastrate: 4096 Hz\nMz [mN*m]\n" + "\n".join(numbers) + "\n", encoding="utf-8"
    )
    back = read_recording(path)
    assert list(back.channels) == ["Mz"]
    assert back["Mz"] == pytest.approx(made()["Mz"][:100], abs=1e-9)


@pytest.mark.parametrize(
    ("said", "how"),
    [
        ({"fs": 4.096}, {"sample_rate": "4096 Hz"}),
        ({"t": 1e3 * T}, {"units": {"t": "ms"}}),
        ({"time": 738000.0 + T / 86400.0}, {"units": {"time": "day"}}),
    ],
    ids=["kilohertz", "milliseconds", "days"],
)
def test_a_rate_that_no_recording_of_loads_has_is_asked_about(tmp_path, said, how):
    """Kilohertz, milliseconds and days that the file does not call so; the preparation can say it."""
    path = tmp_path / "test.mat"
    scipy.io.savemat(path, said | {"Mz": made()["Mz"], "units": {"Mz": "N*m"}})
    with pytest.raises(
        RecordingError, match=r"has a sample rate of .*; 20 Hz to 10 MHz is expected"
    ):
        read_recording(path)
    told = read_prepared(path, Preparation.model_validate(how)).recording
    assert told.sample_rate == RATE


def test_columns_that_end_early_are_told_as_another_rate(tmp_path):
    path = tmp_path / "test.csv"
    rows = [
        f"{t:.6f},{t:.3f}" + (f",{2 * t:.6f},1.5" if k < 50 else "") for k, t in enumerate(T[:100])
    ]
    path.write_text("t [s],Mz [N*m],t2 [s],Fx [N]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    with pytest.raises(
        RecordingError, match=r"row 51 .* save columns with another sample rate in a separate file"
    ):
        read_recording(path)


def test_a_channel_measured_against_its_direction_is_told(tmp_path):
    import pyuff

    path = tmp_path / "test.uff"
    write_recording(made(), path)
    sets = pyuff.UFF(str(path)).read_sets()
    for one in sets:
        one["rsp_dir"] = -6 if one["id1"] == "Mz" else 0
    path.unlink()
    pyuff.UFF(str(path)).write_sets(sets, "add")
    told = [note for note in read_recording(path).notes if "direction" in note]
    assert told == ["channel Mz: measured against its direction"]


def test_our_own_motion(tmp_path, motion_1):
    from microvib.io.runs import write_motion

    write_motion(motion_1, tmp_path / "motion.nc")
    back = read_recording(tmp_path / "motion.nc")
    assert back.sample_rate == 4096.0
    assert back["Mz"] == pytest.approx(motion_1["T_d"])


def test_axis_map_and_cross_talk():
    mixing = np.eye(6) + 0.02 * np.random.default_rng(1).normal(size=(6, 6))
    loads = np.array([made()[name] for name in COMPONENTS])
    readings = made(**dict(zip(COMPONENTS, mixing @ loads, strict=True)))
    assert readings.without_cross_talk(mixing)["My"] == pytest.approx(made()["My"])
    turned = made().mapped({"Mz": "-Mx", "Mx": "Mz"})
    assert turned["Mz"] == pytest.approx(-made()["Mx"])
    assert "channels" in turned.notes[0]


def test_a_point_is_given_in_metres_or_with_units():
    assert Preparation(offset=("20 cm", 0.0, "120 mm")).offset == (0.2, 0.0, 0.12)
    for bad, why in (("1 s", "offset.0: '1 s' has the wrong dimension; a unit compatible with m"),
                     ("0.2", "offset.0: '0.2' needs a unit"), (math.nan, "offset.0: nan is not allowed")):  # fmt: skip
        with pytest.raises(MicrovibError, match=re.escape(why)):
            Preparation(offset=(bad, 0.0, 0.0))


@pytest.mark.parametrize(("noise", "times"), [(0.1, 20.0), (1e-4, None)])
def test_torques_that_are_moved_say_by_how_much_their_floor_rises(noise, times):
    """The noise of a force on a lever of 0.2 m."""
    rng = np.random.default_rng(4)
    fy, mz = noise * rng.normal(size=T.size), 1e-3 * rng.normal(size=T.size)
    moved = Preparation(offset=(0.2, 0.0, 0.0)).apply(made(Fy=fy, Mz=mz))
    assert moved["Mz"] == pytest.approx(mz - 0.2 * fy)
    told = " ".join(moved.notes)
    assert ("raises the floor of Mz" in told) == (times is not None)
    if times is not None:
        floor = 1e-3 / np.sqrt(RATE / 2)
        low, high = (
            float(x) for x in told.split("the floor of Mz from ")[1].split(" N*m")[0].split(" to ")
        )
        assert low == pytest.approx(floor, rel=0.05)
        assert high == pytest.approx(times * floor, rel=0.05)


def test_axes_that_are_turned_raise_no_floor():
    turned = Preparation(axes=("y", "z", "x")).apply(made())
    assert "floor" not in " ".join(turned.notes)


def test_trim_detrend_decimate():
    drift = made(Mz=made()["Mz"] + 3.0 + 2.0 * T).detrended(1)
    assert abs(drift["Mz"].mean()) < 1e-12
    assert made().trimmed(0.25, 0.75).samples == 2048
    slow = made().decimated(8)
    assert slow.sample_rate == 512.0
    middle = slice(50, -50)
    expected = 0.6 * np.cos(2 * np.pi * 53 * np.arange(512) / 512.0)
    assert slow["Mz"][middle] == pytest.approx(expected[middle], abs=2e-3)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (
            lambda x: np.where(np.arange(x.size) == 7, np.nan, x),
            "has 1 samples that are not numbers, the first at 0.001709 s",
        ),
        (lambda x: np.clip(x, -0.3, 0.3), "is clipped"),
        (
            lambda x: np.concatenate([x[:1000], np.full(50, x[1000]), x[1050:]]),
            "repeats one value for",
        ),
        (lambda x: np.zeros_like(x), "is constant"),
    ],
)
def test_bad_channels_are_named_as_what_they_are(change, complaint):
    with pytest.raises(RecordingError, match=complaint):
        require_usable_channel(made(Mz=change(made()["Mz"])), "Mz")


CLIPPED = np.clip(made()["Mz"], -0.3, 0.3)


@pytest.mark.parametrize(
    ("changes", "how", "complaint"),
    [
        ({"Mz": CLIPPED}, {"detrend": 1}, "Mz is clipped"),
        ({"Mz": CLIPPED}, {"response": "boxcar"}, "Mz is clipped"),
        ({"Mz": CLIPPED}, {"decimate": 2, "channels": {"Mz": "-Mz"}}, "Mz is clipped"),
        (
            {"Mz": np.where((T > 0.5) & (T < 0.52), 0.1, made()["Mz"])},
            {"detrend": 1},
            "Mz repeats one value",
        ),
        ({"Mz": np.full_like(T, 0.1)}, {"detrend": 1}, "Mz is constant"),
        (
            {"Mz": np.where(np.arange(T.size) == 7, np.nan, T)},
            {"detrend": 1},
            "has 1 samples that are not numbers, the first at",
        ),
        ({"Fx": CLIPPED}, {"offset": (0.0, 1.0, 0.0)}, "Mz is made of Fx, which is clipped"),
        ({"Mx": CLIPPED}, {"axes": ("y", "z", "x")}, "Mz is made of Mx, which is clipped"),
    ],
)
def test_what_is_wrong_is_told_whatever_is_done_to_it(changes, how, complaint):
    with pytest.raises(RecordingError, match=complaint):
        require_usable_channel(Preparation(**how).apply(made(**changes)), "Mz")


@pytest.mark.parametrize(
    ("changes", "how"),
    [
        (
            {"Mz": np.where(T < 0.2, CLIPPED, made()["Mz"])},
            {"start": "0.25 s", "detrend": 1},
        ),  # cut away
        ({"Fx": CLIPPED}, {"offset": (1.0, 0.0, 0.0)}),  # no part of it
        ({"Fx": 1e-6 * np.round(10 * CLIPPED)}, {"offset": (0.0, 1.0, 0.0)}),  # of no account
    ],
)
def test_what_is_wrong_elsewhere_does_not_count(changes, how):
    require_usable_channel(Preparation(**how).apply(made(**changes)), "Mz")


def test_good_channels_pass_and_short_ones_do_not():
    require_usable_channel(made(), "Mz")
    with pytest.raises(RecordingError, match=r"lasts 1 s; the lines asked for need 16 s"):
        require_usable_channel(made(), "Mz", shortest=16.0)
    with pytest.raises(RecordingError, match="there is no channel 'Mq'; there are Fx"):
        require_usable_channel(made(), "Mq")


def test_units_of_another_kind_are_refused():
    with pytest.raises(RecordingError, match=r"channel Mz is in 'N', but N\*m"):
        Recording({"Mz": T}, RATE, {"Mz": "N"}, "made").in_si()
    assert Recording({"Fx": T}, RATE, {"Fx": "lbf"}, "made").in_si()["Fx"] == pytest.approx(
        4.4482216 * T
    )
    with pytest.raises(
        RecordingError, match=r"channel Fx is in 'mV', .* sensitivity: {Fx: 0.01 N/mV}"
    ):
        require_usable_channel(Recording({"Fx": T}, RATE, {"Fx": "mV"}, "made").in_si(), "Fx")
    with pytest.raises(RecordingError, match=r"channel Mz has no unit; .* units: {Mz: N\*m}"):
        require_usable_channel(Recording({"Mz": T}, RATE, {}, "made").in_si(), "Mz")
    assert Recording({"Fx": T}, RATE, {"Fx": "kN"}, "made").in_si()["Fx"] == pytest.approx(1e3 * T)


def test_time_axes():
    assert regular_rate(np.round(T, 9))[0] == 4096.0
    with pytest.raises(RecordingError, match="about 3 samples are missing, the first at"):
        regular_rate(np.delete(T, [100, 101, 102]))
    late = 100.0 + T
    assert regular_rate(np.round(late, 4))[0] == pytest.approx(
        RATE, rel=1e-3
    )  # written to its last digit
    for t in (T + 1e-4 * np.sin(7 * T), late + 2e-4 * np.sin(7 * T)):
        with pytest.raises(RecordingError, match="varies by"):
            regular_rate(t)


@pytest.mark.parametrize(("name", "content"), [("a.uff", b"no uff"), ("a.mat", b"MATLAB 5.0 broken"), ("a.tdms", b"TDSm?"), ("a.nc", b"\x89HDF"), ("a.csv", b"Mz\n1\n2\n"), ("a.wav", b"RIFF")])  # fmt: skip
def test_broken_files_are_one_sentence(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=str(path)):
        read_recording(path)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_recording(tmp_path / "nothing.uff")


def test_a_truncated_uff_is_refused(tmp_path):
    write_recording(made(), tmp_path / "whole.uff")
    whole = (tmp_path / "whole.uff").read_bytes()
    Path(tmp_path / "half.uff").write_bytes(whole[: int(0.55 * len(whole))])
    with pytest.raises(RecordingError, match=r"truncated|differ in length"):
        read_recording(tmp_path / "half.uff")


def test_without_time_axis_a_rate_is_asked_for(tmp_path):
    scipy.io.savemat(tmp_path / "bare.mat", {"Mz": made()["Mz"]})
    with pytest.raises(RecordingError, match="give the sample rate in Hz"):
        read_recording(tmp_path / "bare.mat")
    assert read_recording(tmp_path / "bare.mat", sample_rate="100 Hz").sample_rate == 100.0


@pytest.mark.parametrize(
    "line",
    ["Units: kN m", "Einheit: kN m", "Mz in kNm", "data divided by 1000", "Teiler 1000", "preamp 1000",
     "Mz: 1000 x", "m = 1000, b = 0", "normalised to 1000 N m", "mV/Nm 1", "V/EU 0.001", "x 10^-3",
     "unit multiplier: k", "Slope: 0.5"],
)  # fmt: skip
def test_a_line_on_top_that_may_scale_the_samples_lets_nothing_pass(tmp_path, line):
    verdict, notes = _verdict_below(tmp_path, line)
    assert verdict == "not judged"
    assert any("may scale the samples of Mz" in x or "already multiplied by it" in x for x in notes)


@pytest.mark.parametrize(
    "line",
    ["Units: N m", "Range: 1000 N m", "Samples: 1000", "Sample rate: 1000 Hz", "Date: 2026-10-03 10:00",
     "Test 1000 of the unit in mm", "Supply 28 V", "Mz in Nm", "Gear ratio 1000", "Run 12, table A"],
)  # fmt: skip
def test_a_line_on_top_that_scales_nothing_leaves_a_limit_judged(tmp_path, line):
    assert _verdict_below(tmp_path, line)[0] == "pass"


def _verdict_below(tmp_path, line):
    """Verdict on 0.1 mN m against 90 of a file with a line above its columns, and the file's notes."""
    t = np.arange(4000) / 1000.0
    x = 1e-4 * np.sin(2.0 * np.pi * 37.3 * t) + 1e-6 * np.random.default_rng(1).normal(size=t.size)
    rows = "\n".join(f"{a:.4f},{b:.9g}" for a, b in zip(t, x, strict=True))
    file = tmp_path / "x.csv"
    file.write_text(f"# {line}\nTime [s],Mz [N m]\n{rows}\n")
    recording = read_recording(file)
    judged = judge_recording(recording, Limit("90 mN*m", "5 Hz", "300 Hz"))
    return judged.verdict, recording.notes
