"""Commands on a force table and several tests on it: hammer, repeatability."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click

from microvib.cli.common import PATH, Target, load_guide, read_preparation, target_options
from microvib.errors import OptionError
from microvib.units import quantity

_LOAD = re.compile(r"([FM][xyz])(?:@([^=]+))?=(.+)", re.DOTALL)


@click.command()
@click.argument("hits", nargs=-1, required=True, metavar="LOAD[@ARM]=FILE...")
@target_options("Folder for responses, bench file and report [default: print only].")
@click.option("--impact", default="hammer", help="Channel of the hammer's force.")
@click.option(
    "--prepare", type=PATH, metavar="FILE", help="How to prepare the recordings: a YAML file."
)
@click.option(
    "--mounted-mass",
    required=True,
    metavar="MASS",
    help="Mass on the table in the test, such as '12 kg'; 0 kg where it was empty.",
)
@click.option(
    "--block",
    metavar="TIME",
    help="Length of a block, such as '0.5 s' [default: 0.9 of the usual time between blows, at most 2 s].",
)
@click.option(
    "--estimator", type=click.Choice(["H1", "H2"]), default="H1", help="Estimate of the response."
)
def hammer(
    hits: tuple[str, ...], impact: str, prepare: Path | None, mounted_mass: str, block: str | None,
    estimator: Any, target: Target,
) -> None:  # fmt: skip
    """Find a force table's responses and resonances in recordings of a hammer's blows.

    Each recording is of blows along or about one axis, with the hammer's force and the table's reading:
    Fz=up.uff, or Mz@0.2m=twist.uff for blows with a lever arm of 0.2 m.
    """
    from microvib.io.recordings import read_prepared
    from microvib.reports.hammer import hammer_outcome
    from microvib.studies.hammer import Hits, hammer_test

    preparation = read_preparation(prepare)
    read = []
    for given in hits:
        load, arm, file = _parse_hits(given)
        read.append(Hits(load, read_prepared(file, preparation).recording, arm))
    test = hammer_test(read, impact, mounted_mass=mounted_mass, block=block, estimator=estimator)
    target.present(hammer_outcome(test))


def _parse_hits(given: str) -> tuple[str, float, str]:
    """Component, lever arm [m] and file of LOAD[@ARM]=FILE."""
    found = _LOAD.fullmatch(given)
    if found is None:
        raise OptionError(
            "hits",
            f"'{given}' is not allowed; LOAD=FILE is expected, such as Fz=up.uff or Mz@0.2m=twist.uff",
        )
    load, arm, file = found.groups()
    if load.startswith("F"):
        if arm is not None:
            raise OptionError("hits", f"'{given}': a force has no lever arm; leave @{arm} out")
        return load, 1.0, file
    if arm is None:
        raise OptionError(
            "hits", f"'{given}': a torque needs a lever arm, such as {load}@0.2m={file}"
        )
    length = quantity(f"{load}, lever arm", arm, "m")
    if length == 0.0:
        raise OptionError("hits", f"'{given}': a lever arm of 0 m makes no torque")
    return load, length, file


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="[UNIT=]FILE...")
@target_options("Folder for tables, picture and report [default: print only].")
@click.option(
    "--channel",
    "channels",
    multiple=True,
    default=("Mz",),
    help="Channel that is looked at; may be given several times.",
)
@click.option(
    "--prepare", type=PATH, metavar="FILE", help="How to prepare the recordings: a YAML file."
)
@click.option("--scenario", help="Scenario of the recorded drive, which names its lines.")
def repeatability(
    runs: tuple[str, ...], channels: tuple[str, ...], prepare: Path | None, scenario: str | None,
    target: Target,
) -> None:  # fmt: skip
    """Find mean and spread of the lines of several recordings, scatter from run to run and from unit to
    unit, and outliers.

    Runs of one unit are repetitions: A=run1.uff A=run2.uff B=run3.uff B=run4.uff.
    """
    from microvib.io.recordings import read_prepared
    from microvib.reports.repeatability import repeatability_outcome
    from microvib.studies.repeatability import Run
    from microvib.studies.repeatability import repeatability as run_study

    preparation = read_preparation(prepare)
    read = []
    for given in runs:
        unit, file = _parse_run(given)
        read.append(Run(file, read_prepared(file, preparation), unit))
    if len({bool(run.unit) for run in read}) > 1:
        raise OptionError(
            "runs", "some have a unit and some have none; give a unit to all, UNIT=FILE, or to none"
        )
    found = run_study(read, scenario=load_guide(scenario), channels=channels)
    target.present(repeatability_outcome(found))


def _parse_run(given: str) -> tuple[str, str]:
    """Unit and file of [UNIT=]FILE."""
    unit, equals, file = given.partition("=")
    if not equals or Path(given).exists():
        return "", given
    return unit.strip(), file
