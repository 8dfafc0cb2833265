"""The axis that samples run along, and counts of a converter: converted, or refused for what they are; never N m over seconds."""

import numpy as np
import pytest
from scipy.io import savemat

from microvib.io.recordings import load_preparation, read_prepared, read_recording
from microvib.testdata.recording import Recording, RecordingError, require_usable_channel

RATE = 4096.0
T = np.arange(2048) / RATE
MZ = 0.05 * np.cos(2 * np.pi * 53 * T) + np.random.default_rng(0).normal(0, 1e-3, T.size)
LSB = 1e-5
COUNTS = np.round(MZ / LSB)


def read(tmp_path, write, name="test.mat", how=None) -> Recording:
    path = tmp_path / name
    write(path) if callable(write) else path.write_text(write)
    if how is None:
        return read_recording(path)
    (tmp_path / "how.yaml").write_text(how)
    return read_prepared(path, load_preparation(tmp_path / "how.yaml")).recording


def assert_is_mz(recording: Recording, channel="Mz", atol=2e-9):
    assert recording.sample_rate == pytest.approx(RATE, rel=1e-9)
    require_usable_channel(recording, channel)
    np.testing.assert_allclose(recording[channel], MZ, rtol=1e-6, atol=atol)


def mat(**variables):
    return lambda path: savemat(path, variables)


def tdms(*channels):
    def write(path):
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(str(path)) as writer:
            writer.write_segment([ChannelObject("a", n, x, properties=p) for n, x, p in channels])

    return write


def netcdf(along, values, units, name="time", **attributes):
    def write(path):
        import h5netcdf

        with h5netcdf.File(path, "w") as f:
            f.dimensions = {name: len(along)}
            f.create_variable(name, (name,), data=along).attrs["units"] = units[0]
            f.create_variable("Mz", (name,), data=values)
            for key, value in ({"units": units[1]} | attributes).items():
                f["Mz"].attrs[key] = value

    return write


def simcenter(step=1 / RATE, unit="s", values=MZ, label="N*m", y=None, x=None, **record):
    """A function as Simcenter exports it."""
    quantity = {"label": label} | (y or {})
    along = {
        "start_value": 0.0,
        "increment": step,
        "number_of_values": float(np.shape(values)[0]),
        "quantity": {"label": unit},
    }
    return {"x_values": along | (x or {}), "y_values": {"values": values, "quantity": quantity}, "function_record": {"name": "Mz"} | record}  # fmt: skip


FREQUENCIES = np.arange(T.size) * 2.0
TDMS = {"wf_increment": 1e3 / RATE, "unit_string": "N*m"}
ROWS = "".join(f"{1e3 * t:.7f},{m:.9f}\n" for t, m in zip(T, MZ, strict=True))

IN_MILLISECONDS = {
    "Simcenter": ("a.mat", mat(Signal=simcenter(1e3 / RATE, "ms"))),
    "Simcenter, explicit values": ("b.mat", mat(Signal=simcenter(x={"values": 1e3 * T, "quantity": {"label": "ms"}}))),
    "TDMS": ("c.tdms", tdms(("Mz", MZ, TDMS | {"wf_xunit_string": "ms"}))),
    "TDMS, unit in words": ("d.tdms", tdms(("Mz", MZ, TDMS | {"wf_xunit_string": "msec"}))),
    "netCDF": ("e.nc", netcdf(1e3 * T, MZ, ("ms", "N*m"))),
    "netCDF, coordinate of another name": ("f.nc", netcdf(1e3 * T, MZ, ("milliseconds", "N*m"), name="x")),
    "CSV": ("g.csv", "Time [msec],Mz [N*m]\n" + ROWS),
    "CSV, axis known by its unit alone": ("h.csv", "X_Value [ms],Mz [N*m]\n" + ROWS),
    "CSV, step on top": ("i.csv", f"Sampling interval [ms]: {1e3 / RATE!r}\nMz [N*m],Fx [N]\n" + "".join(f"{m:.9f},{m:.9f}\n" for m in MZ)),
    "struct with its axis' unit": ("j.mat", mat(ch={"data": MZ, "unit": "N*m", "name": "Mz", "dt": 1e3 / RATE, "xunit": "ms"})),
    "struct with a time axis and its unit": ("k.mat", mat(ch={"Mz": MZ, "time": 1e3 * T, "units": {"Mz": "N*m", "time": "ms"}})),
    "time_unit": ("l.mat", mat(ch={"Mz": MZ, "t": 1e3 * T, "t_unit": "ms", "Mz_unit": "N*m"})),
    "unit in the step's name": ("m.mat", mat(Mz=MZ, dt_ms=1e3 / RATE, units={"Mz": "N*m"})),
    "rate as text": ("n.mat", mat(Mz=MZ, fs="4.096 kHz", units={"Mz": "N*m"})),
    "rate as text without a unit": ("o.mat", mat(Mz=MZ, SampleRate="4096", units={"Mz": "N*m"})),
    "samples per second": ("p.mat", mat(Mz=MZ, fs="4096 S/s", units={"Mz": "N*m"})),
}  # fmt: skip


@pytest.mark.parametrize(("name", "write"), IN_MILLISECONDS.values(), ids=list(IN_MILLISECONDS))
def test_the_unit_of_the_axis_is_minded_in_every_format(tmp_path, name, write):
    found = read(tmp_path, write, name)
    assert_is_mz(found, next(iter(found.channels)))


SPECTRA = {
    "Simcenter, Hz": ("a.mat", mat(Signal=simcenter(2.0, "Hz"))),
    "Simcenter, rpm": ("b.mat", mat(Signal=simcenter(50.0, "rpm"))),
    "Simcenter, by its type alone": ("c.mat", mat(AutoPower=simcenter(2.0, "", type="AutoPowerSpectrum"))),
    "Simcenter, complex": ("d.mat", mat(FRF=simcenter(values=MZ + 1j * MZ))),
    "TDMS, Hz": ("e.tdms", tdms(("Mz", MZ, TDMS | {"wf_xunit_string": "Hz", "wf_increment": 50.0}))),
    "TDMS, by its name": ("f.tdms", tdms(("Mz", MZ, TDMS | {"wf_xname": "Frequency"}))),
    "netCDF": ("g.nc", netcdf(FREQUENCIES, MZ, ("Hz", "N*m"), name="frequency")),
    "MAT with f and fs": ("h.mat", mat(Mz=MZ, f=FREQUENCIES, fs=RATE, units={"Mz": "N*m"})),
    "CSV": ("i.csv", "Sample rate: 4096 Hz\nFrequency [Hz],Mz [N*m]\n" + "".join(f"{f},{m:.9f}\n" for f, m in zip(FREQUENCIES, MZ, strict=True))),
    "CSV, orders": ("j.csv", "Sample rate: 4096 Hz\nOrder,Mz [N*m]\n" + "".join(f"{f},{m:.9f}\n" for f, m in zip(FREQUENCIES, MZ, strict=True))),
    "an angle": ("k.mat", mat(Signal=simcenter(0.1, "deg"))),
}  # fmt: skip


@pytest.mark.parametrize(("name", "write"), SPECTRA.values(), ids=list(SPECTRA))
@pytest.mark.parametrize("how", [None, "sample_rate: 4096 Hz\n"])
def test_what_is_not_over_time_is_refused_with_what_it_is(tmp_path, name, write, how):
    with pytest.raises(RecordingError, match="not a time history") as caught:
        read(tmp_path, write, name, how)
    assert "export the time history" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "what"),
    [("Angle [deg]", "an angle"), ("Speed [rpm]", "a speed of rotation"), ("Way [mm]", "a length")],
)
def test_a_first_column_of_something_else_that_rises_evenly_is_told(tmp_path, name, what):
    text = f"{name},Mz [N*m]\n" + "".join(f"{0.1 * k:.1f},{m:.9f}\n" for k, m in enumerate(MZ))
    with pytest.raises(
        RecordingError,
        match=f"channel Mz is not a time history but given over .*, {what} that rises evenly",
    ):
        read(tmp_path, text, "a.csv")
    assert_is_mz(read(tmp_path, text, "a.csv", "sample_rate: 4096 Hz\n"))


def test_attributes_of_other_programs_in_matlab_7_3(tmp_path):
    import h5py

    def write(**attributes):
        def to(path):
            with h5py.File(path, "w") as f:
                f["Mz"] = (COUNTS if "lsb" in attributes else 1e3 * MZ)[None, :]
                f["fs"] = np.array([[RATE]])
                for key, value in attributes.items():
                    f["Mz"].attrs[key] = value

        return to

    with pytest.raises(RecordingError, match="Mz has whole numbers beside Mz_lsb"):
        read(tmp_path, write(units="N*m", lsb=LSB), "a.mat")
    assert_is_mz(read(tmp_path, write(units="mN*m"), "b.mat"))


def test_what_may_be_meant_otherwise_is_told(tmp_path):
    found = read(tmp_path, mat(Mz=COUNTS, fs=50.0, units={"Mz": "N*m"}))
    assert "fs has no unit and is read in Hz: 50 Hz" in found.notes
    assert (
        "channel Mz contains only integers: are these N*m, or counts of a converter?" in found.notes
    )


def test_a_wrong_unit_of_the_axis_can_be_put_right(tmp_path):
    wrong = mat(Signal=simcenter(1e3 / RATE, "Hz"))
    assert_is_mz(read(tmp_path, wrong, how="units: {x_values: ms}\n"))
    assert_is_mz(
        read(tmp_path, tdms(("Mz", MZ, TDMS)), "a.tdms", how="units: {wf_increment: ms}\n")
    )


def test_a_spectrum_beside_time_histories_is_left_out_and_named(tmp_path):
    write = mat(Signal=simcenter(), FRF=simcenter(2.0, "Hz", 2 * MZ, name="H"))
    found = read(tmp_path, write)
    assert_is_mz(found)
    assert list(found.channels) == ["Mz"]
    assert "channel H" in " ".join(found.notes)


def test_a_missing_unit_of_the_axis_is_told_as_an_assumption(tmp_path):
    found = read(
        tmp_path, tdms(("Mz", MZ, {"wf_increment": 1 / RATE, "unit_string": "N*m"})), "a.tdms"
    )
    assert "wf_increment has no unit and is read in seconds" in found.notes
    assert (
        "x_values has no unit and is read in seconds"
        in read(tmp_path, mat(Signal=simcenter(unit=""))).notes
    )


@pytest.mark.parametrize(
    ("values", "change"),
    [
        (1e3 * MZ, {}),  # samples in the label's unit
        (1e3 * MZ, {"factor": 1.0, "offset": 0.0}),
        (1e3 * MZ, {"factor": 1e-3, "offset": 0.0}),  # from the label's unit to SI
        (MZ, {"factor": 1e3, "offset": 0.0}),  # samples in SI, shown in the label's unit
    ],
)
def test_the_factor_of_simcenter_tells_in_what_its_samples_are(tmp_path, values, change):
    y = {"unit_transformation": change} if change else {}
    assert_is_mz(read(tmp_path, mat(Signal=simcenter(values=values, label="mNm", y=y))))


def test_a_factor_of_simcenter_that_fits_neither_is_refused(tmp_path):
    y = {"unit_transformation": {"factor": 0.02, "offset": 0.0}}
    with pytest.raises(
        RecordingError, match="in what its samples are is not known; export it in N"
    ):
        read(tmp_path, mat(Signal=simcenter(label="mNm", y=y)))


@pytest.mark.parametrize(
    "name",
    ["scale", "Sensitivity", "LSB", "resolution", "ScaleFactor", "conversion", "cal", "calFactor", "adc_lsb", "Mz_gain",
     "slope", "offset", "FullScale", "volts_per_count", "Empfindlichkeit", "multiplier", "range"],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["int16", "float64", "single"])
def test_counts_beside_a_scale_are_never_newton_metres(tmp_path, name, kind):
    x = COUNTS.astype(kind)
    for where, write in enumerate(
        (
            mat(fs=RATE, Mz=x, units={"Mz": "N*m"}, **{name: LSB}),
            mat(fs=RATE, Mz={"data": x, "unit": "N*m", name: LSB}),
            mat(fs=RATE, test={"data": np.column_stack([x, x]), "names": np.array(["Mz", "Fx"], dtype=object), "units": np.array(["N*m", "N"], dtype=object), name: [LSB, LSB]}),
            mat(fs=RATE, Mz={"data": x, "unit": "N*m", "sensor": {name: f"{LSB} N*m/count"}}),
            mat(**{name: LSB}, ch={"data": x, "unit": "N*m", "name": "Mz", "fs": RATE}),
        )
    ):  # fmt: skip
        with pytest.raises(RecordingError, match=r"whole numbers beside .*: counts of a converter"):
            read(tmp_path, write, f"{where}.mat")
        how = (
            f"units: {{Mz: {LSB} N*m}}\n"
            if where % 2
            else f"sensitivity: {{Mz: {LSB} N*m/count}}\n"
        )
        assert_is_mz(read(tmp_path, write, f"{where}.mat", how), atol=LSB)


def test_counts_beside_a_scale_in_other_formats(tmp_path):
    at = {"wf_increment": 1 / RATE, "wf_xunit_string": "s", "unit_string": "N*m"}
    cases = {
        "a.tdms": tdms(("Mz", COUNTS.astype(np.int16), at | {"scale": LSB})),
        "b.tdms": tdms(("Mz", COUNTS, at | {"Gain": LSB})),
        "c.nc": netcdf(T, COUNTS.astype(np.int32), ("s", "N*m"), sensitivity=LSB),
        "d.csv": f"Sample rate: 4096 Hz\nSensitivity: {LSB} N*m/count\nMz [N*m],Fx [N]\n" + "".join(f"{x:.0f},{x:.0f}\n" for x in COUNTS),
    }  # fmt: skip
    for name, write in cases.items():
        with pytest.raises(RecordingError, match=r"whole numbers beside .*: counts of a converter"):
            read(tmp_path, write, name)
        assert_is_mz(read(tmp_path, write, name, f"units: {{Mz: {LSB} N*m}}\n"), atol=LSB)


def test_a_scale_of_one_or_of_another_channel_is_none(tmp_path):
    write = mat(
        fs=RATE,
        Mz=COUNTS,
        Fx=MZ,
        units={"Mz": "N*m", "Fx": "N"},
        gain=1.0,
        offset=0.0,
        Fx_sensitivity=3.0,
    )
    assert read(tmp_path, write)["Mz"] == pytest.approx(COUNTS)
    scaled = mat(fs=RATE, Mz={"data": MZ, "unit": "N*m", "sensitivity": LSB})
    assert_is_mz(read(tmp_path, scaled, "b.mat"))


def test_channels_of_counts_beside_others_are_left_out_and_named(tmp_path):
    write = mat(
        fs=RATE,
        a={"name": "Mz", "data": MZ, "unit": "N*m"},
        b={"name": "Fx", "data": COUNTS, "unit": "N", "lsb": LSB},
    )
    found = read(tmp_path, write)
    assert_is_mz(found)
    with pytest.raises(RecordingError, match=r"left out: b\.data has whole numbers beside b\.lsb"):
        require_usable_channel(found, "Fx")


START = np.datetime64("2026-03-05T10:15:30.000000")


def test_tdms_channels_that_start_at_other_times_are_aligned(tmp_path):
    late = 100
    at = {"wf_increment": 1 / RATE, "wf_xunit_string": "s"}
    later = START + np.timedelta64(round(late / RATE * 1e6), "us")
    write = tdms(
        ("Mz", MZ, at | {"unit_string": "N*m", "wf_start_time": START}),
        ("Fx", MZ[late:], at | {"unit_string": "N", "wf_start_time": later}),
    )
    found = read(tmp_path, write, "a.tdms")
    assert found["Mz"] == pytest.approx(MZ[late:])
    assert found["Fx"] == pytest.approx(MZ[late:])
    assert "start at different times, 0 to 0.0244" in " ".join(found.notes)


@pytest.mark.parametrize("offset", [100.4 / RATE, 3600.0])
def test_tdms_channels_that_cannot_be_aligned_are_refused_with_the_way_out(tmp_path, offset):
    at = {"wf_increment": 1 / RATE, "wf_xunit_string": "s"}
    later = START + np.timedelta64(round(offset * 1e6), "us")
    write = tdms(
        ("Mz", MZ, at | {"unit_string": "N*m", "wf_start_time": START}),
        ("Fx", MZ, at | {"unit_string": "N", "wf_start_time": later}),
    )
    with pytest.raises(RecordingError, match=r"start at different times.* channels: {Mz: "):
        read(tmp_path, write, "a.tdms")
    assert_is_mz(read(tmp_path, write, "a.tdms", "channels: {Mz: Mz}\n"))
