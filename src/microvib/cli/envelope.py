"""Command over many runs and recordings: envelope."""

from __future__ import annotations

from pathlib import Path

import click

from microvib.cli.common import (
    PATH,
    Target,
    limit_options,
    load_guide,
    parse_limit,
    read_preparation,
    target_options,
)
from microvib.cli.progress import progress_bar


@click.command()
@click.argument("members", nargs=-1, required=True, metavar="MEMBER...")
@target_options("Folder for tables, pictures and report [default: print only].")
@click.option(
    "--channel",
    "channels",
    multiple=True,
    help="Channel: T_d, the torque about the drive axis, or a load, Fx to Mz; may be given several times [default: those"
    " of the limit, or T_d].",
)
@click.option(
    "--statistic",
    "statistics",
    multiple=True,
    default=("max",),
    type=click.Choice(["max", "p95", "p99", "mean"]),
    help="Statistic over the members; may be given several times.",
)
@click.option(
    "--bandwidth",
    default="1/3 octave",
    help="Bands: a part of an octave, a width such as '2 Hz', or '5 percent'.",
)
@click.option(
    "--resolution",
    default="1 Hz",
    metavar="HZ",
    help="Noise bandwidth of the amplitude spectra.",
)
@click.option("--scenario", help="Scenario of recorded drives, which names their lines.")
@click.option(
    "--prepare", type=PATH, metavar="FILE", help="How to prepare recordings: a YAML file."
)
@limit_options
def envelope(
    members: tuple[str, ...], channels: tuple[str, ...], statistics: tuple[str, ...], bandwidth: str, resolution: str,
    scenario: str | None, prepare: Path | None, limit: str | None, band: str | None, target: Target,
) -> None:  # fmt: skip
    """Find envelopes of lines, amplitude spectra and densities over many runs, and judge them.

    Each MEMBER is the folder of a run, of `rates --out`, of a campaign, of `run --angles` or `--orbit`, a folder of
    such folders, a recording, or a table of lines. Nothing is simulated again.
    """
    from microvib.reports.envelope import envelope_outcome
    from microvib.studies.envelope.study import envelope as run_study

    with progress_bar("reading", "members") as progress:
        found = run_study(
            members,
            channels=channels,
            statistics=statistics,
            limit=parse_limit(limit, band),
            bandwidth=bandwidth,
            resolution=resolution,
            scenario=load_guide(scenario),
            preparation=read_preparation(prepare),
            progress=progress,
        )
    target.present(envelope_outcome(found))
