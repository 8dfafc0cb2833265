"""What commands share: reading a scenario with its changes, options, progress on a terminal."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib.cli.streams import echo
from microvib.errors import OptionError
from microvib.reports.document import Form

if TYPE_CHECKING:
    from microvib.model.scenario import Scenario
    from microvib.testdata.preparation import Preparation

set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a dotted key, e.g. reducer.stiffness='9000 N*m/rad'.",
)

prepare_option = click.option(
    "--prepare",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="How to prepare recordings: a YAML file with units, channels, response, cross_talk, axes, trimming, background.",
)
channel_option = click.option(
    "--channel", default="Mz", show_default=True, help="Channel of a recording with the drive-axis torque."
)
limit_option = click.option(
    "--limit", metavar="TORQUE", help="Largest line that is allowed, e.g. '10 mN*m': margins in the report."
)
band_option = click.option(
    "--band", metavar="LOW:HIGH", help="Where the limit holds, e.g. '0.5:150 Hz' [default: everywhere]."
)


def _form(pdf: bool, report_data: Path | None) -> Form:
    """What is asked of the report; a library that is missing and wrong data are told before anything is computed."""
    if pdf:
        import typst  # noqa: F401
    from microvib.reports.title_block import TitleBlock, read_title_block

    block = TitleBlock() if report_data is None else read_title_block(report_data)
    return Form(pdf, click.get_current_context().find_root().obj or "", block)


def check_target(out: Path | None, overwrite: bool, form: Form) -> None:
    """OptionError or OutputError where the results could not be written at the end."""
    from microvib.io.results import check_folder

    if out is not None:
        check_folder(out, overwrite)
    elif form.pdf:
        raise OptionError("pdf", "the report is written into a folder; name one", remedy="out")


def report_options(command: Callable[..., None]) -> Callable[..., None]:
    """Options of every command with a report; the command gets them as ``form``."""

    @click.option("--pdf", is_flag=True, help="Write the report as PDF too (extra `report`).")
    @click.option(
        "--report-data",
        type=click.Path(path_type=Path),
        metavar="FILE",
        envvar="MICROVIB_REPORT_DATA",
        help="Author, document number, issue, date and signatures of the report: a YAML file.",
    )
    @wraps(command)
    def with_form(*arguments: Any, pdf: bool, report_data: Path | None, **options: Any) -> None:
        command(*arguments, form=_form(pdf, report_data), **options)

    return with_form


MAX_DOUBTS = 8
overwrite_option = click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")


def load(source: str, settings: tuple[str, ...]) -> Scenario:
    """Scenario of a file or catalog name, with ``--set KEY=VALUE`` applied; what is doubtful in it is said on standard error."""
    from microvib.io.scenario_file import load_scenario, parse_value

    changes = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise OptionError("set", "KEY=VALUE is expected, such as reducer.stiffness='9000 N*m/rad'", setting)
        changes[key.strip()] = parse_value(value)
    loaded = load_scenario(source, changes)
    say_doubts(loaded, source)
    return loaded


def say_doubts(scenario: Scenario, name: str) -> None:
    """Tell values that are allowed but unusual, on standard error."""
    found = scenario.doubts()
    for text in found[:MAX_DOUBTS]:
        click.echo(f"Note: {name}: {text}", err=True)
    if len(found) > MAX_DOUBTS:
        click.echo(f"Note: {name}: and {len(found) - MAX_DOUBTS} more unusual values", err=True)


def preparation(file: Path | None) -> Preparation | None:
    """What a preparation file says; None without one."""
    from microvib.io.recordings import load_preparation

    return None if file is None else load_preparation(file)


def deliver(text: str, out: Path | None, write: Callable[[Path], tuple[str, ...]]) -> None:
    """Write a study's folder, where there is one, then print: a reader who leaves early does not cost the results."""
    files = () if out is None else write(out)
    echo(text)
    if files:
        echo(f"\nWritten: {', '.join(str(out / name) for name in files if out is not None)}")
