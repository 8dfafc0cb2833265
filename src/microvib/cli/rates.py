"""Commands over families of runs: rates."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from microvib.cli.common import PATH, Target, load, parse_limit, set_option, target_options
from microvib.cli.progress import progress_bar
from microvib.errors import OptionError
from microvib.units import Si, quantity

if TYPE_CHECKING:
    from microvib.model.scenario import Scenario
    from microvib.reports.outcome import Outcome

MIN_CASES_FOR_PROCESSES = 40
"""Cases that take longer than to start processes for them."""


@click.command()
@click.argument("scenario")
@click.option(
    "--from",
    "low",
    required=True,
    metavar="RATE",
    help="Lowest rate of the array, e.g. '0.01 deg/s'.",
)
@click.option("--to", "high", required=True, metavar="RATE", help="Highest rate of the array.")
@click.option(
    "--count", default=200, type=click.IntRange(2, 10_000), help="Number of rates in the range."
)
@click.option(
    "--microsteps",
    metavar="N,N,...",
    help="Microsteps per full step to compare [default: the scenario's].",
)
@click.option(
    "--limit",
    metavar="TORQUE|FILE",
    help="Largest line allowed, e.g. '10 mN*m', or a CSV file of a curve over frequency.",
)
@click.option(
    "--band", metavar="LOW:HIGH", help="Consider only lines in this band, e.g. '0.5:5 Hz'."
)
@click.option(
    "--keep-away",
    metavar="PART",
    help="Smallest separation of the rate from resonances, e.g. '5 percent' of the rate.",
)
@click.option(
    "--requirement",
    type=PATH,
    metavar="FILE",
    help="Plan by the line of sight: requirements as of `budget`, in place of --limit.",
)
@click.option(
    "--sources",
    type=PATH,
    metavar="FILE",
    help="With --requirement: other sources, as of `budget`, at the rates that are judged.",
)
@click.option(
    "--judge",
    default=1,
    type=click.IntRange(1, 100),
    help="With --requirement: how many of the best rates a budget judges.",
)
@click.option(
    "--linear",
    is_flag=True,
    help="Use the linearised drive in closed form: instant, but driving lines only.",
)
@set_option
@target_options("Folder for tables and pictures [default: print only].")
def rates(
    scenario: str, low: str, high: str, count: int, microsteps: str | None, limit: str | None, band: str | None,
    keep_away: str | None, requirement: Path | None, sources: Path | None, judge: int, linear: bool,
    settings: tuple[str, ...], target: Target,
) -> None:  # fmt: skip
    """Plan the rate of SCENARIO: lines against modes over rate (Campbell diagram), forbidden and
    best rates.
    """
    from microvib.reports.rates import linear_text, rates_outcome
    from microvib.studies.rates import plan_rates, rate_grid

    grid = rate_grid(low, high, count)
    if keep_away is None:
        away = 0.0
    else:
        away = quantity("keep_away", keep_away, "")
    if not 0.0 <= away < 1.0:
        raise OptionError("keep_away", "must be at least 0 and below 100 percent", str(keep_away))
    loaded = load(scenario, settings)
    if microsteps is None:
        counts = None
    else:
        counts = _counts(microsteps)
    many = not linear and count * (1 if counts is None else len(counts)) >= MIN_CASES_FOR_PROCESSES
    workers = os.cpu_count() if many else None
    if requirement is not None:
        for name, given in (("limit", limit), ("band", band), ("keep_away", keep_away)):
            if given is not None:
                raise OptionError(
                    name, "is of a torque, and requirement of the line of sight; leave one out"
                )
        if linear:
            raise OptionError("linear", "has no line of sight; leave it out with requirement")
        target.present(_by_pointing(loaded, grid, counts, requirement, sources, judge, workers))
        return
    allowed = parse_limit(limit, None)
    with progress_bar("solving", "cases") as progress:
        plan = plan_rates(
            loaded,
            grid,
            counts,
            limit=allowed,
            band=band,
            linear=linear,
            keep_away=away,
            workers=workers,
            progress=progress,
        )
        note = linear_text(plan) if linear else ""
    target.present(rates_outcome(plan, note))


def _by_pointing(
    scenario: Scenario, grid: Sequence[Si], counts: tuple[int, ...] | None, requirement: Path,
    sources: Path | None, judge: int, workers: int | None,
) -> Outcome:  # fmt: skip
    """A plan by the line of sight."""
    from microvib.reports.rates_by_pointing import pointing_rates_outcome
    from microvib.studies.rates_by_pointing import plan_rates_by_pointing

    with progress_bar("solving", "cases") as progress:
        plan = plan_rates_by_pointing(
            scenario,
            grid,
            requirement,
            counts,
            sources=sources,
            judged=judge,
            workers=workers,
            progress=progress,
        )
    return pointing_rates_outcome(plan)


def _counts(text: str) -> tuple[int, ...]:
    """Microsteps per full step, separated by commas."""
    try:
        counts = tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError:
        counts = (0,)
    if min(counts) < 1 or max(counts) > 65_536:
        raise OptionError(
            "microsteps",
            f"{text!r} is not allowed; write whole numbers from 1 to 65536, such as 8,16,32",
        )
    return counts
