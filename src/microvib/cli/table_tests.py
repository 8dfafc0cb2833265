"""Commands on a force table and several tests on it: hammer, repeatability, acceptance."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib.cli.common import (
    PATH,
    Target,
    limit_options,
    load_guide,
    parse_limit,
    read_preparation,
    recording_options,
    target_options,
)
from microvib.cli.progress import progress_bar
from microvib.errors import MicrovibError, OptionError
from microvib.units import quantity

if TYPE_CHECKING:
    from microvib.studies.hammer import HammerTest
    from microvib.studies.repeatability import RecordedRun
    from microvib.testdata.preparation import Preparation

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
    from microvib.reports.hammer import hammer_outcome

    test = _hammer_test(
        hits, impact, mounted_mass, prepare=prepare, block=block, estimator=estimator
    )
    target.present(hammer_outcome(test))


def _hammer_test(
    hits: tuple[str, ...],
    impact: str,
    mounted_mass: str,
    *,
    prepare: Path | None = None,
    **how: Any,
) -> HammerTest:
    """The hammer test of LOAD[@ARM]=FILE."""
    from microvib.io.recordings import read_prepared
    from microvib.studies.hammer import Hits, hammer_test

    preparation = read_preparation(prepare)
    read = []
    for given in hits:
        load, arm, file = _parse_hits(given)
        read.append(Hits(load, read_prepared(file, preparation).recording, arm))
    return hammer_test(read, impact, mounted_mass=mounted_mass, **how)


def _parse_hits(given: str) -> tuple[str, float, str]:
    """Component, lever arm [m] and file of LOAD[@ARM]=FILE."""
    found = _LOAD.fullmatch(given)
    if found is None:
        raise MicrovibError(
            f"'{given}' is not allowed; LOAD=FILE is expected, such as Fz=up.uff or Mz@0.2m=twist.uff",
        )
    load, arm, file = found.groups()
    if load.startswith("F"):
        if arm is not None:
            raise MicrovibError(f"'{given}': a force has no lever arm; leave @{arm} out")
        return load, 1.0, file
    if arm is None:
        raise MicrovibError(f"'{given}': a torque needs a lever arm, such as {load}@0.2m={file}")
    try:
        length = quantity("lever arm", arm, "m")
    except OptionError as error:
        raise MicrovibError(f"'{given}': {error}") from None
    if length == 0.0:
        raise MicrovibError(f"'{given}': a lever arm of 0 m makes no torque")
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
    from microvib.reports.repeatability import repeatability_outcome
    from microvib.studies.repeatability import repeatability as run_study

    read = _read_runs(runs, read_preparation(prepare))
    found = run_study(read, scenario=load_guide(scenario), channels=channels)
    target.present(repeatability_outcome(found))


def _read_runs(runs: tuple[str, ...], preparation: Preparation | None) -> list[RecordedRun]:
    """Recordings of [UNIT=]FILE."""
    from microvib.io.recordings import read_prepared
    from microvib.studies.repeatability import RecordedRun

    parsed = [_parse_run(given) for given in runs]
    if len({bool(unit) for unit, _ in parsed}) > 1:
        raise MicrovibError(
            "some recordings have a unit and some have none; give a unit to all, UNIT=FILE, or to none"
        )
    return [RecordedRun(file, read_prepared(file, preparation), unit) for unit, file in parsed]


def _parse_run(given: str) -> tuple[str, str]:
    """Unit and file of [UNIT=]FILE."""
    unit, equals, file = given.partition("=")
    if not equals or Path(given).exists():
        return "", given
    return unit.strip(), file


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="[UNIT=]FILE...")
@click.option(
    "--template",
    type=PATH,
    required=True,
    metavar="FILE",
    help="Template of the report: Markdown with parts such as {{ test.verdicts }} and {{ runs[0].lines }}.",
)
@target_options("Folder for the report, its tables and pictures [required].")
@recording_options
@click.option("--scenario", help="Scenario of the recorded drive, which names its lines.")
@limit_options
@click.option(
    "--reference",
    metavar="SOURCE",
    help="What the first run is compared with: a scenario, a recording, a table of lines, state-1:measured.",
)
@click.option(
    "--hits",
    multiple=True,
    metavar="LOAD[@ARM]=FILE",
    help="Hammer test of the table, as the command hammer takes it; with --mounted-mass.",
)
@click.option("--impact", default="hammer", help="Channel of the hammer's force.")
@click.option("--mounted-mass", metavar="MASS", help="Mass on the table in the hammer test.")
@click.option(
    "--data", type=PATH, metavar="FILE", help="Words for the template: a YAML file, as data.KEY."
)
def acceptance(
    runs: tuple[str, ...], template: Path, channel: str, prepare: Path | None, scenario: str | None,
    limit: str | None, band: str | None, reference: str | None, hits: tuple[str, ...], impact: str,
    mounted_mass: str | None, data: Path | None, target: Target,
) -> None:  # fmt: skip
    """Make an acceptance report of several recordings from a template.

    Every run is analysed and judged against the limit, all of them for repeatability.
    """
    from microvib.io.sources import open_source
    from microvib.reports.acceptance import (
        acceptance_contents,
        conclusion_text,
        read_template,
        read_words,
    )
    from microvib.studies.acceptance import acceptance as run_acceptance

    if target.out is None:
        raise OptionError(
            "out", "is missing; the report and its pictures are written into a folder"
        )
    text = read_template(template)
    words = {} if data is None else read_words(data)
    preparation = read_preparation(prepare)
    table = None
    if hits:
        if mounted_mass is None:
            raise OptionError("mounted_mass", "is missing, in kg; the hammer test holds for it")
        table = _hammer_test(hits, impact, mounted_mass)
    elif mounted_mass is not None:
        raise OptionError("mounted_mass", "goes with hits, the hammer test of the table")
    with progress_bar() as progress:
        test = run_acceptance(
            _read_runs(runs, preparation),
            scenario=load_guide(scenario),
            channel=channel,
            limit=parse_limit(limit, band),
            reference=None if reference is None else open_source(reference, preparation),
            reference_name=reference or "",
            hammer=table,
            progress=progress,
        )
    target.deliver(conclusion_text(test), acceptance_contents, test, text, str(template), words)
