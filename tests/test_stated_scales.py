"""Names, numbers and texts beside samples that may say that these are scaled: no limit is judged, in any format."""

import numpy as np
import pytest
from scipy.io import savemat

from microvib.io.band_limits import BandLimit
from microvib.io.recordings import read_recording, write_recording
from microvib.io.stated_scales import name_may_scale, remark_may_scale
from microvib.signals.limit_curve import Limit
from microvib.studies.bands import judge_bands
from microvib.studies.recording_limits import judge_recording
from microvib.testdata.recording import Recording, RecordingError

RATE = 1000.0
T = np.arange(4000) / RATE
MZ = 1e-4 * np.sin(2.0 * np.pi * 37.3 * T) + 1e-6 * np.random.default_rng(1).normal(size=T.size)
LIMIT = Limit("90 mN*m", "5 Hz", "300 Hz")


def verdict_on(path):
    recording = read_recording(path)
    return judge_recording(recording, LIMIT, channel=next(iter(recording.channels))).verdict


@pytest.mark.parametrize(
    "name",
    ["Mz/1000", "Mz x 0.001", "Mz*1e-3", "Mz (/1000)", "Mz_div1000", "Mz 1:1000", "Mz (gain 0.001)", "1000*Mz", "Mz 10^-3 x",
     "Mz mal 10", "Mz scale 100"],
)  # fmt: skip
def test_a_name_with_a_factor_lets_nothing_pass(tmp_path, name):
    assert name_may_scale(name)
    rows = "\n".join(f"{t:.4f},{x:.9g}" for t, x in zip(T, MZ, strict=True))
    (tmp_path / "a.csv").write_text(f"Time [s],{name} [N m]\n{rows}\n")
    assert verdict_on(tmp_path / "a.csv") == "not judged"


@pytest.mark.parametrize(
    "name",
    ["Mz", "Fx10", "Mx 10", "CH1/Mz", "10:+RZ", "Torque 1", "Mz calibrated", "Group 3/Mz", "Mz_1000Hz", "Run 10/Mz", "Scaled Mz",
     "Kistler 9255C Mz", "Mz 10 Nm range", "0.1 deg/s Mz"],
)  # fmt: skip
def test_a_name_with_another_number_is_no_factor(name):
    assert not name_may_scale(name)


@pytest.mark.parametrize(
    "remark",
    ["full scale 1000 Nm = 1", "values in % of range", "amplitude in per mille", "normiert auf 1 kNm",
     "Normalised to rated torque (1000 Nm)", "Messbereich 1000 Nm; Ausgabe in Anteilen", "Torque values are in thousands",
     "prefix k", "Mz/kNm"],
)  # fmt: skip
def test_parts_of_something_are_told_from_its_range(remark):
    assert remark_may_scale(remark, ["N m"])
    assert not remark_may_scale("full scale 1000 Nm", ["N m"])


def test_numbers_that_are_no_samples_of_the_load_are_told():
    for remark in (
        "Data type: peak-to-peak",
        "Quantity: RMS",
        "values: envelope",
        "Werte: Effektivwerte",
    ):
        assert remark_may_scale(remark, ["N m"])
    assert not remark_may_scale("noise of the table 5e-6 N m RMS", ["N m"])


def of_mat(path, **beside):
    savemat(path, {"Mz": {"values": MZ, "unit": "Nm"} | beside, "fs": RATE})


def of_tdms(path, **beside):
    write_tdms(path, {}, {}, beside)


def of_tdms_group(path, **beside):
    write_tdms(path, {}, beside, {})


def of_tdms_file(path, **beside):
    write_tdms(path, beside, {}, {})


def write_tdms(path, file, group, channel):
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    own = {"wf_increment": 1.0 / RATE, "unit_string": "Nm"} | channel
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(
            [RootObject(file), GroupObject("a", group), ChannelObject("a", "Mz", MZ, own)]
        )


def of_netcdf(path, **beside):
    import h5netcdf

    with h5netcdf.File(path, "w") as f:
        f.dimensions = {"time": T.size}
        f.create_variable("time", ("time",), data=T).attrs["units"] = "s"
        f.create_variable("Mz", ("time",), data=MZ).attrs["units"] = "N m"
        for key, value in beside.items():
            f["Mz"].attrs[key] = value


def of_labview(path, **beside):
    names = {"description": "Description", "comment": "Notes"}
    own = [f"{names.get(key, key.capitalize())}\t{value}" for key, value in beside.items()]
    top = [
        "LabVIEW Measurement",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "X_Columns\tNo",
        "***End_of_Header***",
    ]
    part = [
        "Channels\t1",
        f"Samples\t{T.size}",
        "Y_Unit_Label\tNm",
        *own,
        "X0\t0",
        f"Delta_X\t{1.0 / RATE}",
    ]
    rows = "".join(f"\t{x:.9g}\n" for x in MZ)
    path.write_text(
        "\n".join([*top, *part, "***End_of_Header***", "X_Value\tMz\tComment"]) + "\n" + rows
    )


FORMATS = [
    (of_labview, ".lvm"),
    (of_mat, ".mat"),
    (of_tdms, ".tdms"),
    (of_tdms_group, ".tdms"),
    (of_tdms_file, ".tdms"),
    (of_netcdf, ".nc"),
]
BESIDE = [{"slope": 1000.0}, {"cal": 1000.0}, {"attenuation": 1000.0}, {"gain": 1000.0}, {"exponent": 3.0}, {"prefix": "k"},
          {"volts_per_unit": 1e-3}, {"description": "torque in kNm"}, {"comment": "all data divided by 1000"}]  # fmt: skip


@pytest.mark.parametrize(("write", "suffix"), FORMATS)
def test_what_stands_beside_samples_lets_nothing_pass_in_any_format(tmp_path, write, suffix):
    for k, beside in enumerate(BESIDE):
        path = tmp_path / f"{k}{suffix}"
        write(path, **beside)
        assert verdict_on(path) == "not judged", beside


@pytest.mark.parametrize(("write", "suffix"), FORMATS)
def test_what_is_of_something_else_leaves_a_limit_judged(tmp_path, write, suffix):
    for k, beside in enumerate(
        [{}, {"description": "test of the drive"}, {"slope": 1.0}, {"comment": "range 1000 Nm"}]
    ):
        path = tmp_path / f"{k}{suffix}"
        write(path, **beside)
        assert verdict_on(path) == "pass", beside


def test_a_factor_beside_an_acceleration_lets_nothing_pass(tmp_path):
    from nptdms import ChannelObject, TdmsWriter

    for gain, verdict in ((1000.0, "not judged"), (1.0, "pass")):
        path = tmp_path / f"{gain:g}.tdms"
        own = {"wf_increment": 1.0 / RATE, "unit_string": "m/s^2", "gain": gain}
        with TdmsWriter(str(path)) as writer:
            writer.write_segment([ChannelObject("a", "ax", MZ, own)])
        judged = judge_bands(read_recording(path), [BandLimit(5.0, 200.0, 0.09, "m/s^2")], "ax")
        assert [band.verdict for band in judged] == [verdict]


def test_free_lines_of_a_universal_file_are_read(tmp_path):
    path = tmp_path / "a.uff"
    write_recording(Recording({"Mz": MZ}, RATE, {"Mz": "N*m"}), path)
    assert verdict_on(path) == "pass"
    lines = path.read_bytes().split(b"\n")
    lines[3] = b"data divided by 1000"
    path.write_bytes(b"\n".join(lines))
    assert verdict_on(path) == "not judged"


@pytest.mark.parametrize(
    "write",
    [
        lambda path: savemat(
            path, {"Mz": {"values": MZ, "unit": "Nm"}, "Mz_unit": "kNm", "fs": RATE}
        )
    ],
)
def test_a_unit_beside_a_struct_that_contradicts_its_own_is_refused(tmp_path, write):
    write(tmp_path / "a.mat")
    with pytest.raises(
        RecordingError, match="channel Mz has two units, 'kNm' in a field beside the struct"
    ):
        read_recording(tmp_path / "a.mat")


def test_a_unit_of_the_group_that_contradicts_the_channels_is_refused(tmp_path):
    for write in (of_tdms_group, of_tdms_file):
        write(tmp_path / "a.tdms", unit_string="kNm")
        with pytest.raises(
            RecordingError, match="channel Mz has two units, 'kNm' in unit_string of its"
        ):
            read_recording(tmp_path / "a.tdms")
    of_tdms(tmp_path / "a.tdms", Einheit="kNm")
    with pytest.raises(RecordingError, match="channel Mz has two units, 'kNm' in its Einheit"):
        read_recording(tmp_path / "a.tdms")


def test_two_attributes_or_fields_of_a_unit_that_contradict_each_other_are_refused(tmp_path):
    of_netcdf(tmp_path / "a.nc", unit="kN m")
    with pytest.raises(RecordingError, match="channel Mz has two units, 'kN m' in its unit"):
        read_recording(tmp_path / "a.nc")
    savemat(tmp_path / "a.mat", {"Mz": MZ, "Mz_unit": "Nm", "Mz_units": "kNm", "fs": RATE})
    with pytest.raises(RecordingError, match="channel Mz has two units, 'kNm' in Mz_units"):
        read_recording(tmp_path / "a.mat")
