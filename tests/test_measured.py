"""What files say of units, time and rate: understood, or named with what the preparation must add; never read as something else."""

import numpy as np
import pytest
from scipy.io import savemat

from microvib.io.recordings import load_preparation, read_prepared, read_recording
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel

RATE = 4096.0
T = np.arange(2048) / RATE
MZ = 0.05 * np.cos(2 * np.pi * 53 * T) + np.random.default_rng(0).normal(0, 1e-3, T.size)


def table(*columns, separator=",", decimal=".", form="{:.9f}", end="\n"):
    rows = [
        separator.join(form.format(x) for x in row).replace(".", decimal)
        for row in zip(*columns, strict=True)
    ]
    return "\n".join(rows) + end


def read(tmp_path, text, name="test.csv", how=None) -> Recording:
    """A text file, or a function that writes one, read with or without a preparation."""
    path = tmp_path / name
    text(path) if callable(text) else path.write_bytes(
        text if isinstance(text, bytes) else text.encode()
    )
    if how is None:
        return read_recording(path)
    (tmp_path / "how.yaml").write_text(how)
    return read_prepared(path, load_preparation(tmp_path / "how.yaml")).recording


def assert_is_mz(recording: Recording, channel="Mz", rel=1e-6):
    assert recording.sample_rate == RATE
    require_usable_channel(recording, channel)
    np.testing.assert_allclose(recording[channel], MZ, rtol=rel, atol=2e-9)


TEXTS = {
    "lines on top": "Bench 3\nOperator: Smith\nDate,2026-11-21\n\nTime (s),Mz (N m)\n" + table(T, MZ),
    "round brackets, milli": "Time (ms),Mz (mNm)\n" + table(1e3 * T, 1e3 * MZ),
    "square brackets": "t [s],Mz [N*mm]\n" + table(T, 1e3 * MZ, form="{:.12g}"),
    "slash": "Zeit / s;Mz / Nm\n" + table(T, MZ, separator=";", decimal=","),
    "ending": "time_ms,Mz [lbf in]\n" + table(1e3 * T, MZ / 0.1129848290276167),
    "tab and a row of units": "Zeit\tMz\ns\tmN·m\n" + table(T, 1e3 * MZ, separator="\t"),
    "semicolon, decimal comma": "Zeit;Mz\ns;Nm\n" + table(T, MZ, separator=";", decimal=","),
    "tab, decimal comma": "Zeit [s]\tMz [Nm]\n" + table(T, MZ, separator="\t", decimal=","),
    "blanks": "time Mz\ns N*m\n" + table(T, MZ, separator="  "),
    "comment with the header": "# time [s],Mz [N*m]\n" + table(T, MZ),
    "quoted": '"Time [s]","Mz [N*m]"\n' + table(T, MZ, form='"{:.9f}"'),
    "separator at the end": "Time [s];Mz [Nm];\n" + table(T, MZ, separator=";", end=";\n").replace("\n", ";\n"),
    "rate on top": "Sample rate: 4096 Hz\nMz [N*m],Fx [N]\n" + table(MZ, MZ),
    "rate in German on top": "Abtastrate;4,096 kHz\nMz [Nm];Fx [N]\n" + table(MZ, MZ, separator=";", decimal=","),
    "kilohertz before the number": "Sampling rate [kHz]: 4.096\nMz [N*m],Fx [N]\n" + table(MZ, MZ),
    "in kilohertz": "Sample rate in kHz = 4.096\nMz [N*m],Fx [N]\n" + table(MZ, MZ),
    "no end of line": "time,Mz\ns,N*m\n" + table(T, MZ, end=""),
    "other encoding": "Zeit [s];Mz [µNm]\n".encode("cp1252") + table(T, 1e6 * MZ, separator=";").encode(),
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTS.values(), ids=list(TEXTS))
def test_text_as_people_write_it(tmp_path, text):
    if isinstance(text, str) and text.startswith("Time [s];Mz [Nm];"):
        text = "\n".join(line.rstrip(";") + ";" for line in text.strip().split("\n")) + "\n"
    assert_is_mz(read(tmp_path, text), rel=1e-5)


def test_text_without_a_header_says_what_to_add(tmp_path):
    text = table(T, MZ)
    with pytest.raises(
        RecordingError,
        match=r"has no header; .* time: column 1, units: {column 1: s, column 2: N\*m}",
    ):
        read(tmp_path, text)
    how = "time: column 1\nunits: {column 1: s, column 2: N*m}\nchannels: {Mz: column 2}\n"
    assert_is_mz(read(tmp_path, text, how=how))
    alone = "sample_rate: 4096 Hz\nunits: {column 1: N*m}\nchannels: {Mz: column 1}\n"
    assert_is_mz(read(tmp_path, table(MZ), how=alone))


WHOLE = "time,Mz\ns,N*m\n"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (WHOLE + table(T, MZ)[:-4], r"truncated; its last number"),
        (WHOLE + table(T, MZ)[:-14], r"row 2048 of its numbers.*truncated|'' is not a number"),
        (WHOLE + table(T, MZ, form="{:.12g}")[:-9], "truncated; its last number"),
        (WHOLE + table(T, MZ, form="{:.6e}")[:-2], "truncated; its last number"),
        (
            WHOLE + table(T, MZ) + "0.5,7,8\n" + table(T + 0.6, MZ),
            "row 2049 of its numbers has 3 of 2 columns",
        ),
        (WHOLE + table(T, MZ) + "0.6\n", "row 2049 of its numbers has 1 of 2 columns"),
        (WHOLE + table(T, MZ) + "0.6,\n", "row 2049"),
        (WHOLE + table(T, MZ) + "end of record\n", "row 2049"),
        ("time,Mz,Mz\n" + table(T, MZ, MZ), "channel Mz occurs twice"),
        ("time,Mz\nparsec,N*m\n" + table(T, MZ), "row 1|not a unit of time|no header"),
        ("time [V],Mz [N*m]\n" + table(T, MZ), r"time axis time is in 'V'.* units: {time: s}"),
        (
            "Sample rate: 2048 Hz\ntime [s],Mz [N*m]\n" + table(T, MZ),
            "has contradictory sample rates: 2048 Hz by",
        ),
        (WHOLE + table(np.round(T, 3), MZ), "too few digits to tell the samples apart"),
        (WHOLE + table(np.where(T > 0.3, T - 0.1, T), MZ), "does not increase"),
        (WHOLE + table(T + 1e-4 * np.sin(40 * T) * (T > 0.2), MZ), "varies by|missing"),
        (
            "Sample rate: 4,096 Hz\nMz [N*m]\n" + table(MZ),
            "give the sample rate in Hz",
        ),  # thousands
        (
            "Abtastrate: 4.096 Hz\nMz [Nm]\n" + table(1e4 * MZ, form="{:.0f}"),
            "give the sample rate in Hz",
        ),
        ("Sample rate divider: 4\nMz [N*m]\n" + table(MZ), "give the sample rate in Hz"),
        ("date,Mz\n" + "2026-11-21 12:00:00.1,0.5\n" * 20, "does not increase throughout"),
    ],
)
def test_text_that_is_cut_or_contradicts_itself(tmp_path, text, complaint):
    with pytest.raises(RecordingError, match=complaint):
        read(tmp_path, text)


def test_a_cut_among_whole_numbers_costs_the_row_and_is_told(tmp_path):
    counts = np.round(1e4 * MZ)
    text = "Sample rate: 4096 Hz\nMz [counts],Fx [counts]\n" + table(
        counts, counts, form="{:.0f}", end=""
    )
    found = read(tmp_path, text)
    assert found.samples == 2047
    assert "the last row has no end of line" in " ".join(found.notes)


def mat(**variables):
    return lambda path: savemat(path, variables)


STRUCT = {"data": np.column_stack([MZ, 2 * MZ]), "fs": RATE, "labels": np.array(["Mz", "Fx"], dtype=object), "units": np.array(["Nm", "kN"], dtype=object)}  # fmt: skip
LMS = {
    "x_values": {
        "start_value": 0.0,
        "increment": 1 / RATE,
        "number_of_values": 2048.0,
        "quantity": {"label": "s"},
    },
    "y_values": {
        "values": 1e3 * MZ,
        "quantity": {"label": "mNm", "unit_transformation": {"factor": 1e-3}},
    },
    "function_record": {"name": "Mz", "type": "Time"},
}
CATMAN = {
    "Channel_1_Header": {"SampleFrequency": RATE, "Unit": "Nm", "SignalName": "Mz"},
    "Channel_1_Data": MZ,
}
DEWESOFT = {"Sample_rate": RATE, "Data1_Mz": MZ, "Data1_time_Mz": T, "units": {"Mz": "N*m"}}
COUNTS = {"data": np.round(1e4 * MZ).astype(np.int16), "unit": "N*m"}
ONE_EACH = np.array(
    [{"name": "Mz", "data": MZ, "unit": "N*m"}, {"name": "Fx", "data": MZ, "unit": "N"}],
    dtype=object,
)

MATS = {
    "matrix with names": mat(x=np.column_stack([MZ, MZ]), names=np.array(["Mz", "Fx"], dtype=object), units=np.array(["N*m", "N"], dtype=object), fs=RATE),
    "channels along rows": mat(x=np.vstack([MZ, MZ]), names=np.array(["Mz", "Fx"], dtype=object), units=np.array(["N*m", "N"], dtype=object), fs=RATE),
    "matrix with its time": mat(x=np.column_stack([1e3 * T, MZ]), names=np.array(["time", "Mz"], dtype=object), units=np.array(["ms", "N*m"], dtype=object)),
    "struct of data, fs, labels, units": mat(test=STRUCT),
    "Simcenter": mat(Signal=LMS),
    "catman": mat(**CATMAN),
    "structs in a list": mat(fs=RATE, ch=ONE_EACH),
    "signals with time": mat(out={"time": T, "signals": {"values": MZ, "label": "Mz", "unit": "N*m"}}),
    "time in milliseconds by its name": mat(Mz=MZ, t_ms=1e3 * T, units={"Mz": "N*m"}),
    "a vector of something else": mat(Mz=MZ, t=T, units={"Mz": "N*m"}, calibration=np.arange(7.0)),
    "step": mat(Mz=1e3 * MZ, dt=1 / RATE, units={"Mz": "mN*m"}),
    "cells": mat(x=np.array([MZ, MZ, 0], dtype=object)[:2], names=np.array(["Mz", "Fx"], dtype=object), units=np.array(["N*m", "N"], dtype=object), fs=RATE),
}  # fmt: skip


@pytest.mark.parametrize("write", MATS.values(), ids=list(MATS))
def test_matlab_as_test_software_writes_it(tmp_path, write):
    assert_is_mz(read(tmp_path, write, "test.mat"))


def test_matlab_with_a_time_axis_to_each_channel(tmp_path):
    found = read(tmp_path, mat(**DEWESOFT), "test.mat", how="units: {Mz: N*m}")
    assert_is_mz(found)


@pytest.mark.parametrize(
    ("write", "complaint"),
    [
        (
            mat(Mz=MZ, fs=RATE, Fs=2048.0),
            "has contradictory sample rates: 4096 Hz by fs, 2048 Hz by Fs",
        ),
        (mat(Mz=MZ, fs=RATE, t=2 * T), "4096 Hz by fs, 2048 Hz by the time axis t"),
        (mat(Mz=MZ, t=T, time=2 * T), "contradictory sample rates"),
        (
            mat(Data1_Mz=MZ, Data1_time_Mz=T, Data1_Fx=MZ, Data1_time_Fx=T + 0.5),
            "start at different times, 0 to 0.5 s",
        ),
        (mat(Mz=MZ, fs=np.nan), "fs gives a sample rate of nan Hz"),
        (mat(Mz=MZ, fs=0.0), "fs gives a sample rate of 0 Hz"),
        (mat(Mz=MZ, fs=-4096.0), "fs gives a sample rate of -4096 Hz"),
        (mat(Mz=MZ, dt=0.0), "dt gives a sample rate of inf Hz"),
        (mat(Mz=MZ), "give the sample rate in Hz: add to the preparation"),
        (
            mat(fs=RATE, Mz=COUNTS | {"scale": 1e-4}),
            "Mz.data has whole numbers beside Mz.scale: counts of a converter",
        ),
        (mat(fs=RATE, Mz=COUNTS | {"offset": 0.5}), "beside Mz.offset"),
    ],
)
def test_matlab_that_contradicts_itself(tmp_path, write, complaint):
    with pytest.raises(RecordingError, match=complaint):
        read(tmp_path, write, "test.mat")


def test_a_matrix_without_names_says_what_to_add(tmp_path):
    write = mat(x=np.column_stack([MZ, MZ]), fs=RATE, slow=np.ones(9))
    with pytest.raises(
        RecordingError,
        match=r"there are x\(1\), x\(2\); say .* channels: {Mz: x\(2\)}; left out, .*: slow \(9\)",
    ):
        require_usable_channel(read(tmp_path, write, "test.mat"), "Mz")
    assert_is_mz(read(tmp_path, write, "test.mat", "units: {x(2): N*m}\nchannels: {Mz: x(2)}"))


def test_older_netcdf_is_named(tmp_path):
    with pytest.raises(
        RecordingError, match=r"is netCDF 3; netCDF 4 is read, made by: nccopy -k nc4 test\.nc"
    ):
        read(tmp_path, b"CDF\x01" + bytes(100), "test.nc")


def test_the_preparation_settles_which_rate_is_right(tmp_path):
    how = "units: {Mz: N*m}\nsample_rate: 4096 Hz"
    found = read(tmp_path, mat(Mz=MZ, fs=RATE, Fs=2048.0), "test.mat", how)
    assert_is_mz(found)
    assert "the file says 4096 Hz by fs, 2048 Hz by Fs" in " ".join(found.notes)
    with pytest.raises(RecordingError, match="but the preparation says 1000 Hz"):
        read(tmp_path, mat(Mz=MZ, fs=RATE), "test.mat", "sample_rate: 1000 Hz")


def test_what_is_left_out_is_told(tmp_path):
    found = read(tmp_path, mat(Mz=MZ, fs=RATE, taps=np.ones(7)), "test.mat")
    assert "left out, not of 2048 samples at 4096 Hz: taps (7)" in found.notes


@pytest.mark.parametrize(
    ("values", "how"),
    [
        (MZ / 0.02, "units: {Mz: V}\nsensitivity: {Mz: 0.02 N*m/V}"),
        (MZ / 0.02, "units: {Mz: m/s^2}\nsensitivity: {Mz: 0.02 N*m/(m/s^2)}"),
        (1e3 * MZ / 0.02, "units: {Mz: mV}\nsensitivity: {Mz: 50 V/(N*m)}"),
        (MZ / 3e-5, "units: {Mz: counts}\nsensitivity: {Mz: 0.03 mN*m/count}"),
        (MZ / 3e-5, "units: {Mz: 0.03 mN*m}"),
        (MZ / 3e-5, "sensitivity: {Mz: 0.03 mN*m/count}"),
        (1e3 * MZ, "units: {Mz: N mm}"),
        (MZ / 0.1129848290276167, "units: {Mz: lbf in}"),
    ],
)
def test_sensitivities_and_units_in_the_preparation(tmp_path, values, how):
    assert_is_mz(read(tmp_path, mat(Mz=values, fs=RATE), "test.mat", how))


@pytest.mark.parametrize(
    ("how", "complaint"),
    [
        (
            "units: {Mz: V}\nsensitivity: {Mz: 0.02 N*m/pC}",
            "sensitivity.Mz: '0.02 N.m/pC' does not go with a channel in V",
        ),
        (
            "units: {Mz: m/s^2}\nsensitivity: {Mz: 1 V}",
            r"such as 0.01 N\*m/\(m/s\^2\) or 100 \(m/s\^2\)/\(N\*m\)",
        ),
        ("units: {Mz: V}\nsensitivity: {Mz: 0 N*m/V}", "does not go with a channel in V"),
        ("units: {Mz: apples}", "units.Mz: 'apples' is not a unit"),
        ("units: {Mz: 2 kg}", "neither a force nor a torque"),
        ("units: {Mq: N}", "there is no channel 'Mq'; there are Mz"),
        ("time: clock", "time: there is no column 'clock'; there are Mz"),
    ],
)
def test_preparations_that_do_not_go(tmp_path, how, complaint):
    with pytest.raises(RecordingError, match=complaint):
        read(tmp_path, mat(Mz=MZ, fs=RATE), "test.mat", how)


def test_what_the_preparation_did_is_noted_in_words(tmp_path):
    how = "channels: {Mz: -b, Fx: a}\nunits: {a: 20 N, b: V}\nsensitivity: {b: 0.02 N*m/V}"
    notes = read(tmp_path, mat(a=MZ, b=MZ, fs=RATE), "test.mat", how).notes
    assert "channels: Mz from b with its sign reversed, Fx from a" in notes
    assert "a in units of 20 N, b in units of V" in notes
    assert "b with a sensitivity of 0.02 N*m/V" in notes
    assert not any("{" in note for note in notes)


def test_a_unit_of_the_preparation_takes_the_place_of_the_files(tmp_path):
    """It is not applied on top of it."""
    text = "time [s],Mz [kN*m]\n" + table(T, 1e3 * MZ)
    assert_is_mz(read(tmp_path, text, how="units: {Mz: mN*m}"))


def test_every_channel_is_converted_whatever_its_name(tmp_path):
    assert_is_mz(
        read(tmp_path, "time [s],TAB_MZ [kN*m]\n" + table(T, 1e-3 * MZ, form="{:.12g}")), "TAB_MZ"
    )


def netcdf(time, values, units, **attributes):
    def write(path):
        import h5netcdf

        with h5netcdf.File(path, "w") as f:
            f.dimensions = {"time": T.size}
            f.create_variable("time", ("time",), data=time).attrs["units"] = units[0]
            f.create_variable("Mz", ("time",), data=values)
            for key, value in ({"units": units[1]} | attributes).items():
                f["Mz"].attrs[key] = value

    return write


def test_netcdf_conventions(tmp_path):
    packed = np.round((MZ - 1.0) / 1e-9).astype(np.int32)
    write = netcdf(1e3 * T, packed, ("ms", "kN*m"), scale_factor=1e-12, add_offset=1e-3)
    assert_is_mz(read(tmp_path, write, "test.nc"), rel=1e-5)
    write = netcdf(
        T,
        np.where(np.arange(T.size) == 5, -999.0, MZ),
        ("seconds since 2026-01-01", "N*m"),
        _FillValue=-999.0,
    )
    found = read(tmp_path, write, "test.nc")
    assert np.flatnonzero(np.isnan(found["Mz"])).tolist() == [5]
    assert "channel Mz: 1 of 2048 samples are not numbers" in found.notes
    with pytest.raises(RecordingError, match="has 1 samples that are not numbers"):
        require_usable_channel(found, "Mz")


def tdms(*channels):
    def write(path):
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(str(path)) as writer:
            writer.write_segment([ChannelObject(g, n, x, properties=p) for g, n, x, p in channels])

    return write


def test_tdms(tmp_path):
    at = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0}
    write = tdms(
        ("a", "Mz", 1e3 * MZ, at | {"unit_string": "mNm"}),
        ("b", "Mz", -MZ, at | {"unit_string": "Nm"}),
    )
    found = read(tmp_path, write, "test.tdms")
    assert_is_mz(found, "a/Mz")
    assert_is_mz(Recording({"x": -found["b/Mz"]}, RATE, {"x": "N*m"}), "x")
    assert_is_mz(read(tmp_path, tdms(("a", "Mz", 1e3 * MZ, at | {"unit": "mNm"})), "unit.tdms"))
    assert_is_mz(
        read(
            tmp_path,
            tdms(("a", "Time", T, {}), ("a", "Mz", MZ, {"unit_string": "Nm"})),
            "time.tdms",
        )
    )
    for channels, complaint in (
        (
            [("a", "Mz", MZ, at | {"unit_string": "mNm", "unit": "Nm"})],
            "has two units, 'Nm' in its unit and 'mNm' beside it; add the right one",
        ),
        (
            [("a", "Mz", MZ, at), ("a", "Fx", MZ, at | {"wf_start_offset": 0.01})],
            "start at different times, 0 to 0.01 s",
        ),
        ([("a", "Mz", MZ, {"wf_increment": 0.0})], "wf_increment gives a sample rate of inf"),
        ([("a", "Mz", MZ, at), ("a", "Time", 2 * T, {})], "contradictory sample rates"),
    ):
        with pytest.raises(RecordingError, match=complaint):
            read(tmp_path, tdms(*channels), f"{len(complaint)}.tdms")


def test_tdms_that_says_more_than_it_holds(tmp_path):
    write = tdms(("a", "Mz", MZ, {"wf_increment": 1 / RATE, "unit_string": "Nm"}))
    write(tmp_path / "whole.tdms")
    whole = (tmp_path / "whole.tdms").read_bytes()
    count = np.uint64(MZ.size).tobytes()
    assert whole.count(count) == 1
    with pytest.raises(RecordingError, match="corrupt or truncated"):
        read(tmp_path, whole.replace(count, np.uint64(10**8).tobytes()), "more.tdms")


def test_uff_in_milliseconds_and_of_spectra(tmp_path):
    from microvib.io.recordings import write_recording

    pyuff = pytest.importorskip("pyuff")
    write_recording(Recording({"Mz": MZ}, RATE, {"Mz": "N*m"}, "made"), tmp_path / "made.uff")
    data = pyuff.UFF(str(tmp_path / "made.uff")).read_sets()
    data |= {
        "x": 1e3 * data["x"],
        "abscissa_inc": 1e3 * data["abscissa_inc"],
        "abscissa_axis_units_lab": "ms",
    }
    pyuff.UFF(str(tmp_path / "ms.uff")).write_sets([data], mode="add")
    assert_is_mz(read_recording(tmp_path / "ms.uff"))
    pyuff.UFF(str(tmp_path / "psd.uff")).write_sets([data | {"func_type": 2}], mode="add")
    with pytest.raises(RecordingError, match="channel Mz is not a time history"):
        read_recording(tmp_path / "psd.uff")


def test_a_pipe_and_a_folder_are_not_recordings(tmp_path):
    import os

    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.mat").mkdir()
    for name in ("pipe.csv", "folder.mat"):
        with pytest.raises(RecordingError, match="is not a file"):
            read_recording(tmp_path / name)
