"""Writing netCDF 4 files (HDF5) so that a disk that fills up is an error and not a crash."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def new_netcdf(path: Path) -> Iterator[Any]:
    """An ``h5netcdf.File`` to fill, written to ``path``; OSError, with its reason, where the disk
    did not take it whole.
    """
    import h5netcdf

    with _FailureRecordingFile(path, "wb+") as kept:
        try:
            with h5netcdf.File(kept, "w") as file:
                yield file
        except (
            OSError,
            RuntimeError,
        ):  # HDF5 misses what the disk did not take; the disk's own reason is the true one
            if kept.failure is None:
                raise
        if kept.failure is not None:
            raise kept.failure


class _FailureRecordingFile(io.FileIO):
    """A file that remembers its first failure to write and lets HDF5 finish: the library crashes if
    told while it closes.
    """

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        size = len(data)
        end = self.tell() + size
        if self.failure is None:
            try:
                left = memoryview(data)
                while left:  # a write may be taken in part
                    left = left[super().write(left) :]
            except OSError as error:
                self.failure = error
        self.seek(end)
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            if size is None:
                return self.tell()
            return size
