"""What is run without being named, and runs that serve the whole session."""

from __future__ import annotations

import gc
import os
import re
import shutil
import signal
import tempfile
from pathlib import Path

# As the command line does: matrices are small here, and threads of BLAS wait for each other at the cost of other tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# The page's library, which servers of tests must not share with this user's.
os.environ["XDG_DATA_HOME"] = tempfile.mkdtemp(prefix="microvib-tests-")

import pytest
from support.scenarios import baseline

import microvib as mv

LONG = re.compile(r"pytest\.mark\.long|^pytestmark = PAGE", re.M)
GROUPS = {"": "not long and not release", "long": "long and not release"}
"""What a bare command and ``-m long`` run: a test of a long file that is marked ``release`` waits for a release."""


def pytest_configure(config: pytest.Config) -> None:
    """Where nothing is named, long tests and those of a release are left to commands of their own; Ctrl-C works in what tests start.

    Where the tests themselves were started in the background, the interrupt is ignored, which would be handed on.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.pop("COLUMNS", None)  # workers of xdist have it; tables are as wide as in a pipe
    if config.args_source is not config.ArgsSource.ARGS or config.option.markexpr:
        config.option.markexpr = GROUPS.get(config.option.markexpr, config.option.markexpr)


def pytest_unconfigure() -> None:
    shutil.rmtree(os.environ["XDG_DATA_HOME"], ignore_errors=True)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``-m long`` the files without such tests are not imported, which takes as long as many of the tests."""
    if config.option.markexpr != GROUPS["long"] or collection_path.suffix != ".py":
        return None
    return None if LONG.search(collection_path.read_text(encoding="utf-8")) else True


def pytest_collection_finish() -> None:
    """What was imported and collected stays: looking through it for garbage takes a twentieth of the tests' time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 10)


@pytest.fixture(scope="session")
def state_1() -> mv.Scenario:
    return baseline()


@pytest.fixture(scope="session")
def motion_1(state_1: mv.Scenario) -> mv.Motion:
    """State 1 at the clock of the paper's test."""
    return mv.simulate(state_1.with_({"tracking.clock_ratio": 0.994}))


@pytest.fixture(scope="session")
def worked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that commands work on; what they write goes elsewhere."""
    from support.commands import work_in

    return work_in(tmp_path_factory.mktemp("worked"))
