"""Shared scenarios and runs; a compiled kernel and one full run of state 1 serve the whole session."""

from __future__ import annotations

import pytest
from support.scenarios import baseline

import microvib as mv


@pytest.fixture(scope="session")
def state_1() -> mv.Scenario:
    return baseline()


@pytest.fixture(scope="session")
def motion_1(state_1: mv.Scenario) -> mv.Motion:
    """State 1 at the clock of the paper's test."""
    return mv.simulate(state_1.with_({"tracking.clock_ratio": 0.994}))
