"""HDF5 and MATLAB files that were made to read other files, or to fill the memory: refused in one sentence, and nothing read."""

import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

from microvib.errors import MicrovibError
from microvib.io import hdf5
from microvib.io.hdf5 import open_hdf5
from microvib.io.matlab import read_matlab
from microvib.io.recordings import read_recording
from microvib.testdata.recording import RecordingError

SAMPLES = 4096


@pytest.fixture
def secret(tmp_path):
    """A file that is not the uploader's: plain bytes, and HDF5."""
    path = tmp_path / "secret.h5"
    with h5py.File(path, "w") as f:
        f["Mz"] = np.arange(float(SAMPLES))
    return path


def external_storage(f, secret):
    f.create_dataset("Mz", shape=(64,), dtype="u1", external=[(str(secret), 0, 64)])


def external_storage_in_a_group(f, secret):
    f.create_dataset("data/Mz", shape=(64,), dtype="u1", external=[(str(secret), 0, 64)])


def external_link(f, secret):
    f["Mz"] = h5py.ExternalLink(str(secret), "/Mz")


def external_group(f, secret):
    f["data"] = h5py.ExternalLink(str(secret), "/")


def soft_link(f, secret):
    f["Mz"] = h5py.SoftLink("/fs")


def soft_link_that_leads_out(f, secret):
    f["out"] = h5py.ExternalLink(str(secret), "/")
    f["Mz"] = h5py.SoftLink("/out/Mz")


def virtual(f, secret):
    layout = h5py.VirtualLayout(shape=(SAMPLES,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(secret), "Mz", shape=(SAMPLES,))
    f.create_virtual_dataset("Mz", layout)


def virtual_of_many(f, secret):
    """Unlimited: asking for its shape opens the sources."""
    layout = h5py.VirtualLayout(shape=(SAMPLES,), dtype="f8", maxshape=(None,))
    source = h5py.VirtualSource(str(secret), "Mz", shape=(SAMPLES,), maxshape=(None,))
    layout[: h5py.h5s.UNLIMITED] = source[: h5py.h5s.UNLIMITED]
    f.create_virtual_dataset("Mz", layout)


def referred(f, secret):
    hidden = f.create_dataset("#refs#/a", shape=(64,), dtype="u1", external=[(str(secret), 0, 64)])
    f.create_dataset("cells", data=[hidden.ref], dtype=h5py.ref_dtype)


def foreign_filter(f, secret):
    f.create_dataset("Mz", data=np.arange(8.0), chunks=(8,), compression="lzf")


TRICKS = [
    (external_storage, "/Mz is stored in other files"),
    (external_storage_in_a_group, "/data/Mz is stored in other files"),
    (external_link, "/Mz is a link to another file"),
    (external_group, "/data is a link to another file"),
    (soft_link, "/Mz is a soft link"),
    (soft_link_that_leads_out, "link"),
    (virtual, "/Mz is stored in other files"),
    (virtual_of_many, "/Mz is stored in other files"),
    (referred, "stored in other files"),
    (foreign_filter, "packed with filters number 32000"),
]


@pytest.mark.parametrize("ending", [".mat", ".nc"])
@pytest.mark.parametrize(
    ("trick", "complaint"), TRICKS, ids=[trick.__name__ for trick, _ in TRICKS]
)
def test_a_file_that_leads_out_is_refused(tmp_path, secret, trick, complaint, ending):
    path = tmp_path / f"upload{ending}"
    with h5py.File(path, "w") as f:
        f["fs"] = 4096.0
        f["own"] = np.arange(64.0)
        trick(f, secret)
    if trick in (referred, external_storage_in_a_group) and ending == ".nc":  # nothing looks there
        assert set(read_recording(path).channels) == {"own"}
        return
    with pytest.raises(RecordingError, match=complaint):
        read_recording(path)


def test_a_link_of_an_unknown_kind_and_a_name_that_is_a_path(tmp_path, secret):
    with h5py.File(tmp_path / "link.h5", "w") as f:
        f["ext"] = h5py.ExternalLink("other.h5", "/Mz")
    data = bytearray((tmp_path / "link.h5").read_bytes())
    at = data.index(b"\x40\x03ext")  # kind of the link, length of its name, the name
    data[at] = 0x41
    (tmp_path / "link.h5").write_bytes(data)
    with (
        open_hdf5(tmp_path / "link.h5") as root,
        pytest.raises(MicrovibError, match="/ext is a link to another file"),
    ):
        root.members()

    with h5py.File(tmp_path / "name.h5", "w") as f:
        f["out_Mz"] = np.arange(4.0)
        f["other"] = np.arange(4.0)
    whole = (tmp_path / "name.h5").read_bytes()
    for name in (b"out/Mz", b"..\0\0\0\0", b".\0\0\0\0\0"):
        (tmp_path / "name.h5").write_bytes(whole.replace(b"out_Mz", name))
        with (
            pytest.raises(MicrovibError, match="not a name"),
            open_hdf5(tmp_path / "name.h5") as root,
        ):
            root.members()


def test_loops_and_depth_end(tmp_path):
    with h5py.File(tmp_path / "loop.mat", "w") as f:
        for k in range(4):
            f[f"g/{k}"] = f.require_group("g")
        f["g/fs"] = 1.0
    with pytest.raises(RecordingError, match="nested more than 10 deep"):
        read_recording(tmp_path / "loop.mat")


def test_many_objects_end(tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5, "MAX_OBJECTS", 20)
    with h5py.File(tmp_path / "wide.mat", "w") as f:
        for k in range(15):
            f.create_group(f"g{k}/h")
    with pytest.raises(RecordingError, match="more than 20 groups"):
        read_recording(tmp_path / "wide.mat")


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"shape": (10**12,), "chunks": (1000,)}, r"unpacks to 8e\+03 GB"),
        ({"shape": (10**12,), "chunks": None}, r"unpacks to 8e\+03 GB"),
        ({"shape": (10**8,), "chunks": (10**8,), "compression": "gzip"}, "chunks of 800 MB"),
    ],
)
def test_sizes_are_bounded_before_reading(tmp_path, settings, complaint):
    with h5py.File(tmp_path / "large.nc", "w") as f:
        f.create_dataset("Mz", dtype="f8", **settings)
    with pytest.raises(RecordingError, match=complaint):
        read_recording(tmp_path / "large.nc", "1 Hz")


@pytest.mark.parametrize("chunks", [(1000,), None])
def test_what_was_never_written_is_not_read_as_zeros(tmp_path, chunks):
    with h5py.File(tmp_path / "empty.mat", "w") as f:
        f["fs"] = 4096.0
        f.create_dataset("Mz", shape=(100_000_000,), dtype="f8", chunks=chunks)
    with pytest.raises(RecordingError, match="/Mz: not all of its values were written"):
        read_recording(tmp_path / "empty.mat")


def test_a_chunk_that_unpacks_to_more_than_it_says(tmp_path):
    with h5py.File(tmp_path / "bomb.nc", "w") as f:
        bomb = f.create_dataset("Mz", shape=(64,), chunks=(64,), dtype="f8", compression="gzip")
        bomb.id.write_direct_chunk((0,), zlib.compress(bytes(10_000_000)))
    with pytest.raises(RecordingError, match="/Mz: unpacks to more than it says"):
        read_recording(tmp_path / "bomb.nc", "1 Hz")


def test_large_texts_are_not_read_all_at_once(tmp_path, monkeypatch):
    """Many elements of variable length may share one large text."""
    monkeypatch.setattr(hdf5, "MAX_BYTES", 100_000)
    with h5py.File(tmp_path / "texts.h5", "w") as f:
        f.create_dataset("line", data=["x" * 10_000] * 20, dtype=h5py.string_dtype())
    with pytest.raises(MicrovibError, match="unpacks to"), open_hdf5(tmp_path / "texts.h5") as root:
        root.dataset("line").texts()


def test_references_and_attributes_lead_nowhere(tmp_path, secret):
    """References to regions and attributes that are lists or references are not followed."""
    with h5py.File(tmp_path / "made.mat", "w") as f:
        f["fs"], f["Mz"] = 4096.0, np.arange(64.0)
        hidden = f.create_dataset(
            "#refs#/a", shape=(64,), dtype="u1", external=[(str(secret), 0, 64)]
        )
        f.create_dataset("region", data=[hidden.regionref[:]], dtype=h5py.regionref_dtype)
        f["Mz"].attrs["DIMENSION_LIST"] = np.array([hidden.ref], dtype=h5py.ref_dtype)
        f["Mz"].attrs["units"] = ["N*m", "N"]
        f["Mz"].attrs["MATLAB_class"] = hidden.ref
    assert read_matlab(tmp_path / "made.mat")["region"] is None
    assert set(read_recording(tmp_path / "made.mat").channels) == {"Mz"}
    with open_hdf5(tmp_path / "made.mat") as root:
        member = root.dataset("Mz")
        assert [
            member.attribute(name) for name in ("DIMENSION_LIST", "units", "MATLAB_class", "none")
        ] == [None] * 4


def test_what_is_whole_in_itself_is_read(tmp_path):
    """Chunks, filters, a hard link, a named type, and MATLAB's texts, cells and structs."""
    values = np.random.default_rng(0).normal(size=SAMPLES)
    with h5py.File(tmp_path / "good.mat", "w") as f:
        f.create_dataset(
            "a", data=values, chunks=(500,), compression="gzip", shuffle=True, fletcher32=True
        )
        f["b"] = f["a"]
        f["kind"] = np.dtype("f8")
        f.create_dataset("test/label", data=[[ord(c)] for c in "table"], dtype="u2").attrs[
            "MATLAB_class"
        ] = np.bytes_("char")
        one = f.create_dataset("#refs#/b", data=[[ord("N")]], dtype="u2")
        one.attrs["MATLAB_class"] = np.bytes_("char")
        cells = f.create_dataset("cells", data=[[one.ref, f["a"].ref]], dtype=h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
    data = read_matlab(tmp_path / "good.mat")
    np.testing.assert_array_equal(data["a"], values)
    np.testing.assert_array_equal(data["b"], values)
    assert data["test"] == {"label": "table"}
    assert data["cells"][0] == "N"
    np.testing.assert_array_equal(data["cells"][1], values)


def _element(kind: int, body: bytes) -> bytes:
    return struct.pack("<2I", kind, len(body)) + body + bytes(-len(body) % 8)


def _matrix(kind: int, dimensions: tuple[int, ...], name: bytes, *parts: bytes) -> bytes:
    flags = _element(6, struct.pack("<2I", kind, 0))
    return _element(
        14,
        flags
        + _element(5, struct.pack(f"<{len(dimensions)}i", *dimensions))
        + _element(1, name)
        + b"".join(parts),
    )


def _mat_5(*elements: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements)


def _nested(depth: int) -> bytes:
    """Cells within cells: all that is before the next one is the same but for the length."""
    inner, cell = (
        _matrix(6, (1, 1), b"", _element(9, struct.pack("<d", 1.0))),
        _matrix(1, (1, 1), b""),
    )
    lengths = (len(inner) + k * len(cell) - 8 for k in range(depth, 0, -1))
    return b"".join(struct.pack("<2I", 14, length) + cell[8:] for length in lengths) + inner


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (_mat_5(_nested(50_000)), "nested more than 10 deep"),
        (_mat_5(_matrix(1, (1_000_000, 1000), b"c")), "cells or unpacks to more than"),
        (_mat_5(_matrix(4, (1_000_000, 1000), b"c", _element(16, b""))), "unpacks to more than"),
        (_mat_5(_matrix(6, (4, 1), b"Mz", _element(9, bytes(32))), _matrix(6, (4, 1), b"Mz", _element(9, bytes(32)))), "Mz twice"),
        (_mat_5(_matrix(6, (4, 1), b"Mz", _element(9, bytes(32))))[:-20], "truncated"),
        (struct.pack("<5i", 0, 2_000_000_000, 1000, 0, 3) + b"Mz\0" + bytes(100), "its last matrix has"),
    ],
)  # fmt: skip
def test_matlab_files_that_say_more_than_they_hold(tmp_path, content, complaint):
    path = tmp_path / "made.mat"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=complaint):
        read_recording(path)


def test_a_packed_matlab_file_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("microvib.io.matlab.MAX_BYTES", 1_000_000)
    packed = zlib.compress(bytes(10_000_000))
    (tmp_path / "bomb.mat").write_bytes(_mat_5(struct.pack("<2I", 15, len(packed)) + packed))
    with pytest.raises(RecordingError, match=r"unpacks to more than 0\.001 GB"):
        read_recording(tmp_path / "bomb.mat")


@pytest.mark.parametrize("form", ["4", "5"])
def test_matlab_files_of_older_versions_are_read(tmp_path, form):
    values = np.random.default_rng(0).normal(size=SAMPLES)
    scipy.io.savemat(
        tmp_path / "old.mat", {"Mz": values, "fs": 4096.0}, format=form, do_compression=form == "5"
    )
    np.testing.assert_array_equal(read_matlab(tmp_path / "old.mat")["Mz"], values)
