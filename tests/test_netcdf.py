"""NetCDF files on a disk that fills up at any point: an error, never a crash of the process."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

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


LIMITED = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_netcdf import write
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, resource.RLIM_INFINITY))
try:
    write(Path({path!r}))
except OSError as error:
    sys.exit(error.errno)
"""


@pytest.mark.parametrize("room", [0, 100, 1000, 4000, 8000, 12_000, 16_000, 20_000, 24_000, 28_000])
def test_a_disk_that_fills_up_is_an_error_with_its_reason(tmp_path, room):
    """In a process of its own: its own files may be no larger either, and it is the process that used to crash."""
    write(tmp_path / "whole.nc")
    assert (tmp_path / "whole.nc").stat().st_size > room
    code = LIMITED.format(tests=str(Path(__file__).parent), room=room, path=str(tmp_path / "a.nc"))
    done = subprocess.run(
        [sys.executable, "-B", "-c", code],
        capture_output=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        timeout=60,
        check=False,
    )
    assert done.returncode == errno.EFBIG, done.stderr
