"""NetCDF files on a disk that fills up at any point: an error, never a crash of the process."""

from __future__ import annotations

import resource
import signal

import h5netcdf
import h5py
import numpy as np
import pytest

from microvib.io.netcdf import new_netcdf

CASES, LINES = 200, 8


def write(path) -> None:
    with new_netcdf(path) as f:
        f.dimensions = {"case": CASES, "line": LINES}
        f.attrs["title"] = "a table"
        table = f.create_variable("amplitude", ("case", "line"), dtype=float, chunks=(50, 1))
        for start in range(0, CASES, 50):
            table[start : start + 50, :] = start + np.arange(50.0 * LINES).reshape(50, LINES)
        names = np.array([f"case {k}" for k in range(CASES)], dtype=object)
        f.create_variable("name", ("case",), dtype=h5py.string_dtype(), data=names)


def test_what_is_written_is_read(tmp_path):
    write(tmp_path / "a.nc")
    with h5netcdf.File(tmp_path / "a.nc") as f:
        assert f["amplitude"][199, 7] == 150 + 399.0
        assert f["name"][3] == b"case 3"


@pytest.mark.parametrize("room", [0, 100, 1000, 4000, 8000, 12_000, 16_000, 20_000, 24_000, 28_000])
def test_a_disk_that_fills_up_is_an_error_with_its_reason(tmp_path, room):
    whole = tmp_path / "whole.nc"
    write(whole)
    assert whole.stat().st_size > room
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            write(tmp_path / "a.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
