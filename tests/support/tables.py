"""A table as a netCDF file, for a process that may be ended while it writes."""

import h5py
import numpy as np

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
