"""Designs of budgets as routes hand them to workers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from microvib.model.scenario import Scenario
from microvib.studies.budget.files import OtherSource


class Design(NamedTuple):
    """A design: its scenario and its sources beside the drive."""

    scenario: Scenario
    sources: Sequence[OtherSource]
