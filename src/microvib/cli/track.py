"""The command that tracks orders through a rate sweep."""

from __future__ import annotations

from pathlib import Path

import click

from microvib.cli.common import (
    Target,
    load_guide,
    parse_limit,
    read_preparation,
    recording_options,
    section_options,
    target_options,
    with_precompilation,
)
from microvib.cli.progress import progress_bar
from microvib.errors import OptionError


@click.command()
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True)
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
@click.option(
    "--limit",
    metavar="TORQUE|FILE",
    help="Hold the order cuts against this amplitude, or a CSV file of a curve over frequency; a sweep fails, and passes nothing.",
)
@click.option(
    "--limit-band",
    metavar="LOW:HIGH",
    help="Band in which the limit applies, e.g. '0.5:150 Hz' [default: everywhere].",
)
@section_options
@with_precompilation
def track(
    sources: tuple[str, ...], orders: str, channel: str, prepare: Path | None, tacho: str | None, pulses_per_rev: float,
    speed: str | None, profile: str | None, scenario: str | None, strongest: float | None, clock: str,
    fixed: tuple[str, ...], bandwidth: str | None, start: str | None, stop: str | None, trigger: str | None,
    pre_trigger: str | None, limit: str | None, limit_band: str | None, target: Target,
) -> None:  # fmt: skip
    """Track orders through a rate sweep in each SOURCE, a recording, a run folder or a scenario: order
    cuts, order map, maxima and the resonances that they cross; of several, with one table of mean,
    spread and outliers.
    """
    from microvib.io.sources import open_source
    from microvib.reports.batch import batch_outcome
    from microvib.reports.order_tracking import order_outcome
    from microvib.studies.batch import batch_of
    from microvib.studies.cut_limits import cuts_against
    from microvib.studies.track import track_orders
    from microvib.testdata.section import Section

    asked, section = parse_orders(orders), Section.stated(start, stop, trigger, pre_trigger)
    allowed = parse_limit(limit, limit_band, "limit_band")
    prepared, guide = read_preparation(prepare), load_guide(scenario)
    found = []
    for source in sources:
        with progress_bar() as progress:
            tracked = track_orders(
                open_source(source, prepared),
                asked,
                name=source,
                channel=channel,
                tacho=tacho,
                pulses_per_rev=pulses_per_rev,
                speed=speed,
                profile=profile,
                scenario=guide,
                strongest=strongest,
                clock=clock,
                fixed=fixed,
                bandwidth=bandwidth,
                section=section,
                progress=progress,
            )
        found.append(tracked)
    outcomes = [
        order_outcome(one, None if allowed is None else cuts_against(one, allowed)) for one in found
    ]
    if len(found) == 1:
        target.present(outcomes[0])
    else:
        target.present(batch_outcome(batch_of(sources, found), outcomes))


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
