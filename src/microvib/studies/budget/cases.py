"""Sources beside a drive of which a campaign has cases: in each case on the craft of that case.

What a source of its own loads moves depends on drive, array and hub, of which a campaign may vary
any part. A case therefore counts with what its own craft makes of all sources, and with the density
that the noise of its own friction has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from microvib.analysis.pointing import noise_spectrum_of_wings
from microvib.io.file_access import FileAccess
from microvib.model.drive_states import MAY_STICK, Sticking
from microvib.model.scenario import Scenario
from microvib.studies.budget.files import OtherSource
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.sources import Contribution
from microvib.studies.campaign.design import Design
from microvib.studies.campaign.results import DONE, Results
from microvib.studies.campaign.statistics import independent_cases

_CRAFT_GROUPS = ("motor", "reducer", "friction", "array", "spacecraft")
"""Groups of a scenario that the response of its craft depends on."""
_KEPT = 4096
"""Crafts of which a source is kept, for the requirements that follow: some 0.1 MB each."""
_KEPT_RANGES = 4
"""Crafts of which a wheel with a range of speeds is kept: some 10 MB each."""


def drawn_cases(results: Results) -> np.ndarray:
    """Which cases of a campaign are independent and have a result, (cases,)."""
    return np.asarray(independent_cases(results.campaign.design) & (results.state == DONE))


def varied_craft_keys(design: Design) -> tuple[str, ...]:
    """Keys of the scenario that a campaign of distributions varies and that change its craft."""
    return tuple(
        key
        for key in design.changes(0)
        if key.split(".")[0] in _CRAFT_GROUPS and not key.endswith(".seed")
    )


def with_craft_of_cases(
    contributions: Sequence[Contribution],
    sources: Sequence[OtherSource],
    files: FileAccess,
    results: Results,
    sticking: tuple[Sticking, Sticking] = (MAY_STICK, MAY_STICK),
) -> list[Contribution]:
    """Contributions of other ``sources``, in the same order, with what they are in each case;
    ``sticking`` tells the shafts that may stick.
    """
    if not varied_craft_keys(results.campaign.design):
        return list(contributions)
    scenarios = _Scenarios(results)

    def on(source: OtherSource) -> Callable[[int], Contribution]:
        ranges = source.wheel is not None and source.wheel.speed_to is not None

        @lru_cache(maxsize=_KEPT_RANGES if ranges else _KEPT)
        def in_case(number: int) -> Contribution:
            return contribution_of_other(source, scenarios.of(number), files, sticking)

        return in_case

    return [
        replace(one, in_case=on(source)) for one, source in zip(contributions, sources, strict=True)
    ]


def with_density_of_cases(drive: Contribution, results: Results) -> Contribution:
    """A drive that has cases, with the density of its friction's noise in each of them."""
    if drive.density is None or not varied_craft_keys(results.campaign.design):
        return drive
    scenarios = _Scenarios(results)

    @lru_cache(maxsize=_KEPT)
    def in_case(number: int) -> Contribution:
        return replace(drive, density=noise_spectrum_of_wings(scenarios.of(number)))

    return replace(drive, in_case=in_case)


def with_nominal_craft(drive: Contribution, results: Results) -> Contribution:
    """Another drive beside the one that has cases: its lines were run on the nominal craft alone."""
    varied = varied_craft_keys(results.campaign.design)
    if not varied:
        return drive
    why = (
        f"the campaign varies {', '.join(varied)}, which change the craft, and {drive.source} was"
        " run on the nominal craft alone"
    )
    return replace(drive, cases_lack="; ".join(filter(None, (drive.cases_lack, why))))


class _Scenarios:
    """Scenarios of a campaign's cases by their number among those that are drawn."""

    def __init__(self, results: Results) -> None:
        self._design = results.campaign.design
        self._cases = np.flatnonzero(drawn_cases(results))

    def of(self, number: int) -> Scenario:
        """Scenario of one case."""
        return self._design.scenario(int(self._cases[number]))
