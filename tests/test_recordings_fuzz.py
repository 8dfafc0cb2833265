"""Mutated recordings of every format: a sentence, or the numbers that the file still holds; never a traceback, a warning or a hang."""

import warnings

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from microvib.errors import MicrovibError
from microvib.io.recordings import read_recording, write_recording
from microvib.io.sources import open_source
from microvib.studies.analyse import analyse
from microvib.testdata.recording import Recording

pytestmark = pytest.mark.long
RATE = 512.0
T = np.arange(2048) / RATE
MZ = 0.05 * np.cos(2 * np.pi * 14.505 * T) + np.random.default_rng(0).normal(0, 1e-3, T.size)
MADE = Recording({"Fx": 10.0 * MZ, "Mz": MZ}, RATE, {"Fx": "N", "Mz": "N*m"}, "made")
PIECES = (
    b"\xff\xff\xff\xff\xff\xff\xff\x7f", bytes(8), np.float64(np.nan).tobytes(), np.float64(np.inf).tobytes(),
    np.float64(1e308).tobytes(), np.int64(-1).tobytes(), np.uint32(2**31 - 1).tobytes(), b"1e999", b"nan", b"-", b";", b"\n",
)  # fmt: skip


def write_7_3(path):
    with h5py.File(path, "w") as f:
        f.create_dataset("Mz", data=MZ[None, :], chunks=(1, 500), compression="gzip", shuffle=True)
        f["fs"] = np.array([[RATE]])
        unit = f.create_dataset("units/Mz", data=[[ord(c)] for c in "N*m"], dtype="u2")
        unit.attrs["MATLAB_class"] = np.bytes_("char")


def write_netcdf(path):
    import h5netcdf

    with h5netcdf.File(path, "w") as f:
        f.dimensions = {"time": T.size}
        f.create_variable("time", ("time",), data=1e3 * T).attrs["units"] = "ms"
        variable = f.create_variable(
            "Mz", ("time",), data=np.round(MZ / 1e-6).astype("i4"), compression="gzip"
        )
        for key, value in (
            ("units", "N*m"),
            ("scale_factor", 1e-6),
            ("_FillValue", np.int32(-(2**31))),
        ):
            variable.attrs[key] = value


def write_tdms(path):
    from nptdms import ChannelObject, TdmsWriter

    properties = {"wf_increment": 1 / RATE, "unit_string": "N*m"}
    with TdmsWriter(str(path)) as writer:
        for half in (MZ[:1024], MZ[1024:]):
            writer.write_segment([ChannelObject("table", "Mz", half, properties=properties)])


def write_german(path):
    rows = "".join(f"{t:.6f};{x:.8f}\n".replace(".", ",") for t, x in zip(T, MZ, strict=True))
    path.write_bytes(("Prüfstand 3\nZeit;Mz\ns;Nm\n" + rows).encode("cp1252"))


STRUCT = {
    "data": np.column_stack([MZ, MZ]),
    "labels": np.array(["Mz", "My"], dtype=object),
    "units": "N*m",
    "fs": RATE,
}
FORMATS = {
    "own.uff": lambda path: write_recording(MADE, path),
    "own.mat": lambda path: write_recording(MADE, path),
    "own.csv": lambda path: write_recording(MADE, path),
    "packed.mat": lambda path: savemat(path, {"test": STRUCT}, do_compression=True),
    "seven.mat": write_7_3,
    "packed.nc": write_netcdf,
    "segments.tdms": write_tdms,
    "german.csv": write_german,
}


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    folder = tmp_path_factory.mktemp("originals")
    for name, write in FORMATS.items():
        write(folder / name)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def mutated(data: bytes, others: list[bytes], random) -> bytes:
    """Bits turned, cut off, a foreign header, extreme values, bytes taken out, doubled, inserted or zeroed."""
    out = bytearray(data)
    head = min(len(out), int(random.choice([128, 600, 2000, len(out)])))
    at, size = int(random.integers(0, head)), int(random.choice([1, 8, 100, 2000]))
    match int(random.integers(0, 8)):
        case 0:
            for k in random.integers(0, head, 4).tolist():
                out[k] ^= 1 << int(random.integers(0, 8))
        case 1:
            del out[at:]
        case 2:
            out[:size] = others[int(random.integers(0, len(others)))][:size]
        case 3:
            piece = PIECES[int(random.integers(0, len(PIECES)))]
            out[at : at + len(piece)] = piece
        case 4:
            del out[at : at + size]
        case 5:
            out[at:at] = out[at : at + size]
        case 6:
            out[at:at] = random.integers(0, 256, size, dtype=np.uint8).tobytes()
        case _:
            out[at : at + size] = bytes(len(out[at : at + size]))
    return bytes(out)


@pytest.mark.parametrize("name", FORMATS)
def test_mutated_recordings_are_refused_or_read(tmp_path, originals, name):
    random = np.random.default_rng(list(FORMATS).index(name))
    path, others = tmp_path / name, list(originals.values())
    path.write_bytes(originals[name])
    whole = read_recording(path)
    np.testing.assert_allclose(whole["Mz"], MZ, atol=1e-6)
    refused: list[str] = []
    for _ in range(30):
        data = mutated(originals[name], others, random)
        path.write_bytes(data)
        try:
            with warnings.catch_warnings(action="error"):
                found = analyse(open_source(str(path))).recording
        except MicrovibError as error:
            refused.append(str(error))
        else:
            assert found.sample_rate == RATE
            assert (
                np.count_nonzero(np.abs(found["Mz"] - MZ[: found.samples]) > 1e-6) <= 260
            )  # those of the bytes that changed
    assert len(refused) > 10
    assert not [sentence for sentence in refused if "\n" in sentence]
