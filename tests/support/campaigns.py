"""Small campaigns, and backends that compute them in the test's own process."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np

from microvib.model.sentences import validate_part
from microvib.studies.campaign.design import design
from microvib.studies.campaign.folder import Campaign, create
from microvib.studies.campaign.results import merge, open_results
from microvib.studies.campaign.run import compute_missing
from microvib.studies.campaign.study_file import Study

SHORT = {"record.settle": "0.2 s", "record.duration": "1 s", "record.sample_rate": "1024 Hz"}
EVERYTHING = (0.0, np.inf)


def study(**keys) -> Study:
    """A study of two levels; with two members of each family of lines, of which most of the time
    goes into the fit.
    """
    data = {
        "scenario": "state-1",
        "set": SHORT,
        "vary": {"driver.microsteps": [8, 16]},
        "harmonics": 2,
        **keys,
    }
    return validate_part(Study, data)


def spread(count: int = 6, **keys) -> Study:
    vary = {
        "driver.microsteps": [8, 16],
        "reducer.stiffness": {
            "distribution": "normal",
            "relative_deviation": "5 percent",
            "lower": "4000 N*m/rad",
        },
        "friction.breakaway": {"distribution": "uniform", "within": "20 percent"},
    }
    return study(
        **{"vary": vary, "sampling": {"method": "random", "count": count, "seed": 3}, **keys}
    )


class Inline(Executor):
    """Computes at once; dies of the cases in ``crashing``, by the value of what varies."""

    def __init__(self, crashing=()) -> None:
        self.crashing, self.died = crashing, False

    def submit(self, fn, /, work):
        future: Future[bytes] = Future()
        lethal = [
            k
            for k, item in enumerate(work.changes)
            if item.get("driver.microsteps") in self.crashing
        ]
        if self.died:
            raise BrokenPipeError("this executor is broken")
        if any(k not in work.crashing for k in lethal):
            self.died = True
            future.set_exception(BrokenPipeError("the worker died"))
        else:
            future.set_result(fn(work))
        return future


class Fragile:
    """A backend whose workers die of certain cases."""

    workers = 1
    deaths = (BrokenPipeError,)

    def __init__(self, crashing=()) -> None:
        self.crashing = crashing

    def executor(self) -> Executor:
        return Inline(self.crashing)

    def watch(self) -> None:
        pass


def made(tmp_path: Path, of: Study, name: str = "c", chunk: int | None = None) -> Campaign:
    return create(design(of), tmp_path / name, chunk)


def bytes_of(campaign: Campaign) -> list[bytes]:
    return [campaign.file(k).read_bytes() for k in campaign.done()]


def computed(tmp_path: Path, of: Study):
    campaign = made(tmp_path, of)
    compute_missing(campaign, Fragile())
    merge(campaign)
    return open_results(campaign)
