"""Drives as they may be: cases that a search is made for, and others that its result is judged on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from microvib.errors import OptionError
from microvib.io.file_access import NO_FILES, FileAccess
from microvib.model.part import to_plain_data
from microvib.model.scenario import Scenario
from microvib.model.sentences import validate_part
from microvib.studies.campaign.design import Design, design, read_study
from microvib.studies.campaign.study_file import Study
from microvib.studies.quiet.levers import Lever, fixed

SEARCH_SEED, CHOICE_SEED, JUDGE_SEED = 1, 3, 2
"""Seeds of the cases that are searched on, of those by which one of the best settings is chosen, and
of those that judge it."""
SEARCH_CASES, JUDGE_CASES = 16, 80
"""How many there are of the first and of the last."""
CHOICE_RATIO = 1.2
"""Cases by which a setting is chosen, for each that judges: what is rare should be seen before."""
STIFFNESS, FRICTION, DETENT = "30 percent", "50 percent", "20 percent"
"""By how much values may be off either way where no study says so."""
DAMPING_RANGE = "0.2 percent", "2 percent"
"""Damping of array modes between which it may be where no study says so."""
STICKING_ANGLE = math.radians(20.0 / 3600.0)
"""Breakaway torque over the stiffness of a contact that sticks [rad] where no study says so."""


@dataclass(frozen=True)
class DrawnCases:
    """Cases of one spread, as changes of a scenario's keys in SI."""

    text: tuple[str, ...]
    """Variations, in sentences without a stop."""
    assumed: bool
    """Whether nobody stated the spread."""
    searched: tuple[dict[str, Any], ...]
    chosen_by: tuple[dict[str, Any], ...]
    judged: tuple[dict[str, Any], ...]


def draw_cases(
    scenario: Scenario,
    levers: Sequence[Lever],
    study: Path | None = None,
    count: int = JUDGE_CASES,
    files: FileAccess = NO_FILES,
) -> DrawnCases:
    """Draw cases for a search and others to judge it by.

    Parameters
    ----------
    scenario : Scenario
        The drive as it is.
    levers : sequence of Lever
        What is changed, which no study may vary.
    study : path, optional
        Study file of a campaign, whose ``vary``, ``cases`` and ``correlations`` count; without it a
        spread is assumed.
    count : int
        How many cases judge.
    files : FileAccess
        Permission to open what the study names.

    Raises
    ------
    OptionError
        Where a lever and the study change the same key.
    ScenarioError
        Where the study does not fit the scenario.
    """
    if study is None:
        spread, origin = _assumed_spread(scenario), "the assumed spread"
    else:
        spread, origin = read_study(study, files), str(study)

    def drawn(seed: int, wanted: int) -> Design:
        sampling = {"method": "sobol", "count": 1, "seed": seed}
        one = validate_part(Study, {**_plain(spread), "sampling": sampling})
        combinations = max(design(one, files, origin, scenario).cases, 1)
        sampling["count"] = max(1, math.ceil(wanted / combinations))
        return design(
            validate_part(Study, {**_plain(spread), "sampling": sampling}), files, origin, scenario
        )

    searched, chosen_by = (
        drawn(SEARCH_SEED, SEARCH_CASES),
        drawn(CHOICE_SEED, round(CHOICE_RATIO * count)),
    )
    judged = drawn(JUDGE_SEED, count)
    cases = _changes(judged)
    _require_free_levers(levers, cases[0])
    return DrawnCases(
        tuple(_in_words(judged)),
        study is None,
        _changes(searched),
        _changes(chosen_by),
        cases,
    )


def _changes(drawn: Design) -> tuple[dict[str, Any], ...]:
    return tuple(drawn.changes(k) for k in range(drawn.cases))


def _plain(study: Study) -> dict[str, Any]:
    correlations = [
        {"keys": list(one.keys), "coefficient": one.coefficient} for one in study.correlations
    ]
    return {
        "scenario": study.scenario,
        "vary": study.vary,
        "cases": list(study.cases),
        "correlations": correlations,
    }


def _require_free_levers(levers: Sequence[Lever], varied: Mapping[str, Any]) -> None:
    for lever in levers:
        for key in fixed(lever, varied):
            raise OptionError(
                "lever",
                f"sets {key}, which the cases vary, too; leave it out of one of them",
                lever.name,
            )


def _in_words(drawn: Design) -> Iterator[str]:
    for one in drawn.uncertain:
        yield f"{one.key}: {one.text}"
    for level in drawn.levels:
        yield f"{level.key}: {', '.join(level.labels)}"
    for key in dict.fromkeys(key for each in drawn.combinations for key in each):
        values = dict.fromkeys(_text(each.get(key)) for each in drawn.combinations)
        yield f"{key}: {' or '.join(values)}"


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(part)}" for name, part in value.items() if part != [])
    if isinstance(value, list):
        return f"of {len(value)} rows"
    return str(value)


# ---- The spread where nobody states one ----


def _assumed_spread(scenario: Scenario) -> Study:
    data = {
        "scenario": "assumed",
        "vary": dict(_assumed_distributions(scenario)),
        "cases": list(_with_and_without_presliding(scenario)),
    }
    return validate_part(Study, data)


def _assumed_distributions(scenario: Scenario) -> Iterator[tuple[str, Any]]:
    if isinstance(scenario.reducer.stiffness, float):
        yield "reducer.stiffness", {"distribution": "uniform", "within": STIFFNESS}
    if scenario.array.modes:
        low, high = DAMPING_RANGE
        damping = {"distribution": "log-normal", "median": "0.63 percent", "factor": 1.8}
        yield "array.modes.*.damping", {**damping, "lower": low, "upper": high}
    dry = [key for key in _DRY_FRICTION if _number(scenario, key)]
    if dry:
        yield "dry friction", {"scale": dry, "distribution": "uniform", "within": FRICTION}
    if scenario.motor.detent_torque > 0.0:
        yield "motor.detent_torque", {"distribution": "uniform", "within": DETENT}


_DRY_FRICTION = (
    "friction.coulomb",
    "friction.breakaway",
    "friction.slip_ring.friction_factor",
    "motor.friction.coulomb",
    "motor.friction.breakaway",
)


def _number(scenario: Scenario, key: str) -> float:
    values = {name: value for name, value, _ in scenario.entries()}
    value = values.get(key)
    return value if isinstance(value, float) else 0.0


def _with_and_without_presliding(scenario: Scenario) -> Iterator[dict[str, Any]]:
    """Friction on the output with and without memory."""
    breakaway = scenario.friction.breakaway_torque
    if not breakaway:
        return
    own = scenario.friction.presliding
    if own is not None:
        yield {"friction.presliding": to_plain_data(own, text=True)}
    else:
        stiffness = breakaway / STICKING_ANGLE
        yield {"friction.presliding": {"stiffness": f"{stiffness:.6g} N*m/rad"}}
    yield {"friction.presliding": None}
