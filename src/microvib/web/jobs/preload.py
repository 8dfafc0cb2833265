"""Preparation of a worker before its first task: imported, and the kernel loaded. Importing this
module does it.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _warm() -> None:
    from importlib import import_module

    from microvib.analysis.lines import find_lines
    from microvib.io.scenario_file import load_scenario
    from microvib.solve.simulate import simulate

    # With what its modules import when they need it.
    for name in (
        "microvib.web.jobs.tasks",
        "scipy.signal",
        "scipy.stats",
        "matplotlib.backends.backend_agg",
        "h5netcdf",
    ):
        import_module(name)
    find_lines(
        simulate(load_scenario("state-1", {"record.settle": "0 s", "record.duration": "0.1 s"}))
    )


_warm()
