"""The command that tracks orders through a rate sweep."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from microvib.cli.common import (
    Target,
    load_guide,
    options,
    read_preparation,
    recording_options,
    target_options,
    with_precompilation,
)
from microvib.cli.progress import progress_bar
from microvib.errors import OptionError

section_options: Callable[[Any], Any] = options(
    click.option(
        "--from",
        "start",
        metavar="TIME",
        help="Start of the section of the record, such as '2 s' [default: its start].",
    ),
    click.option(
        "--to",
        "stop",
        metavar="TIME",
        help="End of the section; after a trigger, time since it [default: the end of the record].",
    ),
    click.option(
        "--trigger",
        metavar="'CHANNEL > LEVEL'",
        help="Begin the section where a channel first rises through a level, such as 'Mz > 5 mN*m'; < where it falls.",
    ),
    click.option(
        "--pre-trigger", metavar="TIME", help="Time before the trigger that is kept, too."
    ),
)


@click.command()
@click.argument("source")
@click.option(
    "--orders",
    required=True,
    metavar="ORDER,ORDER",
    help="Orders to track, cycles per revolution of the reference, such as 0.5,1,4,6.",
)
@target_options("Folder for tables, pictures and report [default: print only].")
@recording_options
@click.option("--tacho", metavar="CHANNEL", help="Reference: channel with the pulses of a tacho.")
@click.option(
    "--pulses-per-rev", type=float, default=1.0, help="Pulses of the tacho per revolution."
)
@click.option(
    "--speed", metavar="CHANNEL", help="Reference: channel that is the speed, in rpm, Hz or deg/s."
)
@click.option(
    "--profile",
    metavar="POINTS|FILE",
    help="Reference: speed profile, '0 s:10 Hz, 5 s:40 Hz' (also rpm), or a CSV file of times and speeds.",
)
@click.option(
    "--scenario",
    help="Reference: command of a scenario; order 1 is once per electrical period.",
)
@click.option(
    "--strongest",
    type=float,
    metavar="ORDER",
    help="Reference: the strongest component of the record, which is followed and is this order.",
)
@click.option(
    "--clock",
    type=click.Choice(["found", "stated"]),
    default="found",
    help="Look for the clock of a profile or scenario in the record, within 2 %, or take it as stated.",
)
@click.option(
    "--fixed",
    multiple=True,
    metavar="FREQUENCY",
    help="Line that does not follow the speed, such as '50 Hz': tracked alongside where orders cross it.",
)
@click.option(
    "--bandwidth",
    metavar="FREQUENCY",
    help="Width about each order within which all is taken for it [default: by the distance of the orders].",
)
@section_options
@with_precompilation
def track(
    source: str, orders: str, channel: str, prepare: Path | None, tacho: str | None, pulses_per_rev: float,
    speed: str | None, profile: str | None, scenario: str | None, strongest: float | None, clock: str,
    fixed: tuple[str, ...], bandwidth: str | None, start: str | None, stop: str | None, trigger: str | None,
    pre_trigger: str | None, target: Target,
) -> None:  # fmt: skip
    """Track orders through a rate sweep in SOURCE, a recording, a run folder or a scenario: order
    cuts, order map, maxima and the resonances that they cross.
    """
    from microvib.io.sources import open_source
    from microvib.reports.order_tracking import order_outcome
    from microvib.studies.track import track_orders
    from microvib.testdata.section import Section

    with progress_bar() as progress:
        found = track_orders(
            open_source(source, read_preparation(prepare)),
            parse_orders(orders),
            name=source,
            channel=channel,
            tacho=tacho,
            pulses_per_rev=pulses_per_rev,
            speed=speed,
            profile=profile,
            scenario=load_guide(scenario),
            strongest=strongest,
            clock=clock,
            fixed=fixed,
            bandwidth=bandwidth,
            section=Section.stated(start, stop, trigger, pre_trigger),
            progress=progress,
        )
    target.present(order_outcome(found))


def parse_orders(text: str) -> list[float]:
    """Orders of a text such as ``0.5,1,4``; OptionError where one is no number."""
    found = []
    for part in text.split(","):
        try:
            found.append(float(part))
        except ValueError:
            raise OptionError(
                "orders", f"{part.strip()!r} is not a number; write orders such as 0.5,1,4,6"
            ) from None
    return found
