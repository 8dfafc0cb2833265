"""One quantity has one unit in a report: in its figures, texts, tables and pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.text
import pytest
from support.tiers import at_a_release

import microvib as mv
from microvib.analysis.limits import Limit
from microvib.io.sources import open_source
from microvib.model.sentences import validate_part
from microvib.reports.angles import angles_outcome
from microvib.reports.budget import budget_outcome
from microvib.reports.comparison import comparison_outcome
from microvib.reports.document import Text
from microvib.reports.orbit import orbit_outcome
from microvib.reports.outcome import Outcome, Pairs, Picture, terminal_text
from microvib.reports.rates import rates_outcome
from microvib.reports.run.outcome import run_outcome
from microvib.results import Table
from microvib.studies.angles import sweep_angles
from microvib.studies.budget.files import Requirements
from microvib.studies.compare import compare
from microvib.studies.orbit import analyse_orbit
from microvib.units import Si

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
SHORT = {"record.settle": "0.5 s", "record.duration": "2 s"}
OF_OTHERS = ("Parameters", "Derived values")
"""Parts on other torques and angles, those of the scenario, in the units that it is written in."""
TORQUES = re.compile(r"(?<!\w)([kmµn]?N m)(?![\w/²])")
ANGLES = re.compile(r"(?<![\w/])((?:[mµn]?rad|arcsec)(?![\w/²]))")
PHASES = re.compile(r"phase \[rad\]")


def craft() -> mv.Scenario:
    return mv.load_scenario(CRAFT, dict(SHORT))


def run() -> Outcome:
    """A limit above one newton metre."""
    result = mv.run_scenario(mv.load_scenario("state-1", dict(SHORT)))
    return run_outcome(result, Limit("1.5 N*m"))


def run_of_craft() -> Outcome:
    return run_outcome(mv.run_scenario(craft()), Limit("40 mN*m"))


def rates() -> Outcome:
    given = [Si(x) for x in (1e-3, 2e-3)]
    plan = mv.plan_rates(mv.load_scenario("state-1"), given, [16], limit="1.5 N*m", linear=True)
    return rates_outcome(plan)


def requirements(limit: str) -> Requirements:
    asked = [
        {"name": "P-1", "metric": "rpe", "window": "1 s", "limit": limit},
        {"name": "P-2", "limit": "0.2 urad"},
        {
            "name": "P-3",
            "curve": [
                {"frequency": "0.1 Hz", "amplitude": "0.5 urad"},
                {"frequency": "1 kHz", "amplitude": "1 nrad"},
            ],
        },
    ]
    return validate_part(Requirements, {"requirements": asked})


def budget(limit: str) -> Outcome:
    return budget_outcome(mv.pointing_budget(craft(), requirements(limit), steady=True))


def budget_in_arcsec() -> Outcome:
    return budget("0.1 arcsec")


def budget_in_nrad() -> Outcome:
    return budget("500 nrad")


def budget_of_nothing_asked() -> Outcome:
    return budget_outcome(mv.pointing_budget(craft(), steady=True))


def angles() -> Outcome:
    return angles_outcome(sweep_angles(craft(), [Si(0.0), Si(1.3)]))


def orbit() -> Outcome:
    return orbit_outcome(analyse_orbit(craft(), [Si(0.0), Si(0.5), Si(1.0)]))


def comparison() -> Outcome:
    return comparison_outcome(
        *compare(open_source("state-1:measured"), open_source("state-1:model"))
    )


def said(outcome: Outcome) -> Iterator[str]:
    """All texts of a report but those of its scenario."""
    yield outcome.summary
    for fact in outcome.facts:
        yield from (fact.value, fact.label)
    for part in outcome.parts:
        if part.title not in OF_OTHERS:
            for item in part.shown:
                yield from texts(item)
    yield terminal_text(outcome)


def texts(item: object) -> Iterator[str]:
    if isinstance(item, Text):
        yield item.text
    elif isinstance(item, Pairs):
        yield from item.lines
    elif isinstance(item, Table):
        yield item.caption
        yield from (column.title for column in item.shown)
        yield from (cell for row in item.texts() for cell in row)
    elif isinstance(item, Picture):
        yield from (item.title, item.caption)
        drawn = item.draw().findobj(matplotlib.text.Text)
        yield from (one.get_text() for one in drawn)


def units(outcome: Outcome, of: re.Pattern[str]) -> set[str]:
    return {unit for text in said(outcome) for unit in of.findall(PHASES.sub("", text))}


@pytest.mark.parametrize(
    ("made", "torque", "angle"),
    [
        at_a_release(run, {"mN m"}, set()),
        (run_of_craft, {"mN m"}, {"nrad"}),
        at_a_release(rates, {"mN m"}, set()),
        (comparison, {"mN m"}, set()),
        (budget_in_arcsec, set(), {"arcsec"}),
        at_a_release(budget_in_nrad, set(), {"nrad"}),
        at_a_release(budget_of_nothing_asked, set(), {"nrad"}),
        at_a_release(angles, set(), {"nrad"}),
        at_a_release(orbit, set(), {"nrad"}),
    ],
)
def test_one_quantity_has_one_unit(
    made: Callable[[], Outcome], torque: set[str], angle: set[str]
) -> None:
    outcome = made()
    assert units(outcome, TORQUES) == torque
    assert units(outcome, ANGLES) == angle


def test_a_limit_is_answered_in_the_unit_that_it_is_given_in() -> None:
    table, *_ = [x for x in budget_in_arcsec().parts[0].items if isinstance(x, Table)]
    assert table.shown[1].title == "limit [arcsec]"
    assert table.texts()[0][1] == "0.1"
