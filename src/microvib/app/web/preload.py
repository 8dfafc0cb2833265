"""What a worker has ready before it is asked: imported, and the kernel loaded. Importing this module does it."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _warm() -> None:
    from microvib.app import analysis, report  # noqa: F401
    from microvib.io.scenario_file import load_scenario
    from microvib.solve.simulate import simulate
    from microvib.studies import analyse, compare, identify, rates  # noqa: F401

    short = {"record.settle": "0 s", "record.duration": "0.1 s"}
    analysis.lines(simulate(load_scenario("state-1", short)))


_warm()
