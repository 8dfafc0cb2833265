"""Files of recorders and data acquisition: LabVIEW, sound files, catman; and units and rates as their makers write them."""

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from microvib.io.recordings import load_preparation, read_prepared, read_recording
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel

RATE = 4096.0
T = np.arange(2048) / RATE
MZ = 0.05 * np.cos(2 * np.pi * 53 * T) + np.random.default_rng(0).normal(0, 1e-3, T.size)


def read(tmp_path, write, name, how=None) -> Recording:
    path = tmp_path / name
    write(path) if callable(write) else path.write_bytes(
        write if isinstance(write, bytes) else write.encode()
    )
    if how is None:
        return read_recording(path)
    (tmp_path / "how.yaml").write_text(how)
    return read_prepared(path, load_preparation(tmp_path / "how.yaml")).recording


def assert_is_mz(recording, channel="Mz", atol=2e-9):
    assert recording.sample_rate == pytest.approx(RATE, rel=1e-5)
    require_usable_channel(recording, channel)
    np.testing.assert_allclose(recording[channel], MZ, atol=atol)


def lvm(
    x="One",
    dimension="Time",
    decimal=".",
    separator="Tab",
    units=("N*m", "N"),
    step=1 / RATE,
    segments=1,
    x0=0.0,
):
    """A LabVIEW measurement file of two channels."""
    s = {"Tab": "\t", "Comma": ","}[separator]
    top = ["LabVIEW Measurement", s.join(["Writer_Version", "2"]), s.join(["Reader_Version", "2"]), s.join(["Separator", separator]),
           s.join(["Decimal_Separator", decimal]), s.join(["Multi_Headings", "No"]), s.join(["X_Columns", x]),
           s.join(["Time_Pref", "Relative"]), "***End_of_Header***", ""]  # fmt: skip
    part = [s.join(["Channels", "2", "", ""]), s.join(["Samples", "2048", "2048", ""]), s.join(["Y_Unit_Label", *units, ""]),
            s.join(["X_Dimension", dimension, dimension, ""]), s.join(["X0", f"{x0:.9E}", f"{x0:.9E}", ""]),
            s.join(["Delta_X", f"{step:.9E}", f"{step:.9E}", ""]), "***End_of_Header***" + s]  # fmt: skip
    heads = {"No": ["X_Value", "Mz", "Fx", "Comment"], "One": ["X_Value", "Mz", "Fx", "Comment"],
             "Multi": ["X_Value", "Mz", "X_Value", "Fx", "Comment"]}[x]  # fmt: skip
    rows = [s.join(heads)]
    for t, m in zip(x0 + T, MZ, strict=True):
        cells = {"No": ["", f"{m:.9f}", f"{2 * m:.9f}"], "One": [f"{t:.6f}", f"{m:.9f}", f"{2 * m:.9f}"],
                 "Multi": [f"{t:.6f}", f"{m:.9f}", f"{t:.6f}", f"{2 * m:.9f}"]}[x]  # fmt: skip
        rows.append(s.join(cells))
    body = [line.replace(".", decimal) for line in part + rows] * segments
    return "\r\n".join(top + body) + "\r\n"


@pytest.mark.parametrize("x", ["No", "One", "Multi"])
@pytest.mark.parametrize(("decimal", "separator"), [(".", "Tab"), (",", "Tab"), (".", "Comma")])
def test_labview_measurement_files(tmp_path, x, decimal, separator):
    found = read(tmp_path, lvm(x, decimal=decimal, separator=separator), "a.lvm")
    assert list(found.channels) == ["Mz", "Fx"]
    assert_is_mz(found)
    assert found["Fx"] == pytest.approx(2 * MZ, abs=2e-9)


def test_labview_files_that_are_something_else(tmp_path):
    with pytest.raises(RecordingError, match="not a time history: its axis is called 'Frequency'"):
        read(tmp_path, lvm(dimension="Frequency", step=2.0, x="No"), "a.lvm")
    with pytest.raises(RecordingError, match="has 2 segments"):
        read(tmp_path, lvm(segments=2), "b.lvm")
    with pytest.raises(RecordingError, match="contradictory sample rates"):
        read(tmp_path, lvm(step=1e-3), "c.lvm")
    with pytest.raises(RecordingError, match="truncated"):
        read(tmp_path, lvm()[:150], "d.lvm")
    plain = "time [s]\tMz [N*m]\n" + "".join(
        f"{t:.9f}\t{m:.9f}\n" for t, m in zip(T, MZ, strict=True)
    )
    assert_is_mz(read(tmp_path, plain, "e.lvm"))


@pytest.mark.parametrize("kind", ["int16", "int32", "float32", "float64", "uint8"])
def test_sound_files_ask_what_full_scale_is(tmp_path, kind):
    full = 0.1
    x = np.column_stack([MZ, -MZ]) / full
    size = {"int16": 32768.0, "int32": 2.0**31, "uint8": 128.0}.get(kind, 1.0)
    data = (np.round(x * size) + (128 if kind == "uint8" else 0) if size > 1 else x).astype(kind)

    def write(path):
        wavfile.write(path, int(RATE), data)

    found = read(tmp_path, write, "a.wav")
    with pytest.raises(RecordingError, match=r"parts of full scale.* units: {channel 1: 20 N\*m}"):
        found.load("channel 1")
    how = "units: {channel 1: 0.1 N*m, channel 2: 0.1 N*m}\nchannels: {Mz: channel 1, My: channel 2}\n"
    prepared = read(tmp_path, write, "a.wav", how)
    np.testing.assert_allclose(prepared["Mz"], MZ, atol=1.01 * full / size if size > 1 else 1e-8)
    assert prepared["My"] == pytest.approx(-prepared["Mz"], abs=2 * full / size)
    with pytest.raises(RecordingError, match="has no number; write what full scale is"):
        read(tmp_path, write, "a.wav", "units: {channel 1: N*m}\n")


def test_a_sound_file_that_is_cut_off_is_refused(tmp_path):
    wavfile.write(tmp_path / "a.wav", int(RATE), (MZ / 0.1 * 32767).astype(np.int16))
    whole = (tmp_path / "a.wav").read_bytes()
    with pytest.raises(RecordingError, match="truncated"):
        read(tmp_path, whole[:-1000], "b.wav")


CATMAN = "\t".join
ROWS = "".join(f"{t:.8f}\t{m:.9f}\t{2 * m:.9f}\n" for t, m in zip(T, MZ, strict=True))


@pytest.mark.parametrize(
    "head",
    [
        "Time  1 - default sample rate\tMz\tFx\ns\tN*m\tN\n",
        "Time  1 - default sample rate [s]\tMz [N*m]\tFx [N]\n",
        "HBM_CATMAN_DATAFILE_40\nT0 = 5.3.2024 10:15:30\nTime  1 - default sample rate\tMz\tFx\ns\tNm\tN\n",
        "Zeit  1 - Standardmessrate\tMz\tFx\ns\tNm\tN\n",
        "Time 2 - slow sample rate (s)\tMz (N*m)\tFx (N)\n",
    ],
)
def test_the_time_axis_of_catman(tmp_path, head):
    found = read(tmp_path, head + ROWS, "a.txt")
    assert list(found.channels) == ["Mz", "Fx"]
    assert_is_mz(found, atol=2e-8)
    assert_is_mz(read(tmp_path, (head + ROWS).replace(".", ","), "b.asc"), atol=2e-8)


def test_catman_in_matlab_with_its_time_channel(tmp_path):
    time = {"SignalName": "Time  1 - default sample rate", "Unit": "s", "SampleFrequency": "4096"}
    header = {"SignalName": "Mz", "Unit": "Nm", "SampleFrequency": "4096"}
    data = {
        "File_Header": {"SampleFrequency": "4096", "NumberOfChannels": "2"},
        "Channel_1_Header": time,
        "Channel_1_Data": T,
    }
    found = read(
        tmp_path,
        lambda p: savemat(p, data | {"Channel_2_Header": header, "Channel_2_Data": MZ}),
        "a.mat",
    )
    assert list(found.channels) == ["Mz"]
    assert_is_mz(found)


UNITS = {
    "units beside one channel": {"Mz": 1e3 * MZ, "fs": RATE, "units": "mN*m"},
    "units beside one channel and its time": {"Mz": 1e3 * MZ, "t": T, "units": "mN*m"},
    "Mz_unit": {"Mz": 1e3 * MZ, "fs": RATE, "Mz_unit": "mNm"},
    "Mz_units, text in a column": {
        "Mz": 1e3 * MZ[:, None],
        "fs": RATE,
        "Mz_units": np.array(["mNm"], dtype=object),
    },
    "unit in the name": {"Mz_mNm": 1e3 * MZ, "fs": RATE},
}


@pytest.mark.parametrize("variables", UNITS.values(), ids=list(UNITS))
def test_units_in_matlab_as_people_write_them(tmp_path, variables):
    assert_is_mz(read(tmp_path, lambda p: savemat(p, variables), "a.mat"))


def test_a_unit_at_the_end_of_a_column_name(tmp_path):
    text = "time_ms,Mz_mNm,Fx_N\n" + "".join(
        f"{1e3 * t:.6f},{1e3 * m:.7f},{m:.9f}\n" for t, m in zip(T, MZ, strict=True)
    )
    found = read(tmp_path, text, "a.csv")
    assert list(found.channels) == ["Mz", "Fx"]
    assert_is_mz(found, atol=1e-7)
    how = "units: {Mz_mNm: mN*m}\nchannels: {Mz: Mz_mNm}\n"  # as one had to write before
    assert_is_mz(read(tmp_path, text, "a.csv", how), atol=1e-7)


def test_the_page_takes_every_kind_of_recording_that_is_read():
    from microvib.io.files import RECORDINGS
    from microvib.io.formats import READERS

    assert set(RECORDINGS) == set(READERS)


def test_what_a_library_prints_is_no_output(capfd):
    import sys
    import threading

    from microvib.io.files import suppress_output

    with suppress_output():
        print("of a library")
        print("of a library", file=sys.stderr)
        other = threading.Thread(target=lambda: print("of another thread"))
        other.start()
        other.join()
    assert capfd.readouterr() == ("of another thread\n", "")
