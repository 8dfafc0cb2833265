"""NetCDF files on a disk that fills up at any point: an error, never a crash of the process."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import h5netcdf
from support.tables import write


def test_what_is_written_is_read(tmp_path):
    write(tmp_path / "a.nc")
    with h5netcdf.File(tmp_path / "a.nc") as f:
        assert f["amplitude"][199, 7] == 150 + 399.0
        assert f["name"][3] == b"case 3"


LIMITED = """
import json, os, resource, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from support.tables import write
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
ended = {}
for room in json.loads(sys.argv[2]):
    child = os.fork()
    if not child:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
        try:
            write(Path(f"{room}.nc"))
        except OSError as error:
            os._exit(error.errno)
        os._exit(0)
    ended[room] = os.waitpid(child, 0)[1]
print(json.dumps(ended))
"""
ROOMS = [0, 100, 1000, 4000, 8000, 12_000, 16_000, 20_000, 24_000, 28_000]


def test_a_disk_that_fills_up_is_an_error_with_its_reason(tmp_path):
    """In processes of their own: their own files may be no larger either, and it is the process that used to crash."""
    write(tmp_path / "whole.nc")
    assert (tmp_path / "whole.nc").stat().st_size > max(ROOMS)
    program = [sys.executable, "-B", "-c", LIMITED, str(Path(__file__).parent), json.dumps(ROOMS)]
    done = subprocess.run(
        program, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    ended = json.loads(done.stdout)
    assert {room: os.waitstatus_to_exitcode(status) for room, status in ended.items()} == {
        str(room): errno.EFBIG for room in ROOMS
    }, done.stderr
