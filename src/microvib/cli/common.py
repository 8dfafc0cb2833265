"""Shared parts of the commands: options, scenarios with their changes, the folder that results go into."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib.cli.streams import echo
from microvib.errors import OptionError

if TYPE_CHECKING:
    from microvib.io.band_limits import BandLimit
    from microvib.model.scenario import Scenario
    from microvib.reports.document import Contents, Form
    from microvib.reports.outcome import Outcome
    from microvib.signals.limit_curve import Limit
    from microvib.testdata.preparation import Preparation

Command = Callable[..., None]
PATH = click.Path(path_type=Path)
MAX_WARNINGS = 8  # values of a scenario that are told as unusual

set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a dotted key, e.g. reducer.stiffness='9000 N*m/rad'.",
)
harmonics_option = click.option(
    "--harmonics",
    default=8,
    type=click.IntRange(1, 200),
    help="Lines to look for in each family (drive_1 to drive_N, ...).",
)


def options(*each: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Several options as one, in the order of the help."""

    def with_all(command: Any) -> Any:
        for option in reversed(each):
            command = option(command)
        return command

    return with_all


recording_options = options(
    click.option(
        "--channel", default="Mz", help="Channel of a recording that holds the drive-axis torque."
    ),
    click.option(
        "--prepare",
        type=PATH,
        metavar="FILE",
        help="How to prepare recordings: a YAML file with units, channels, response, cross_talk, axes, trimming, background.",
    ),
)
section_options = options(
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
band_limit_options = options(
    click.option(
        "--bands",
        "band_file",
        type=PATH,
        metavar="FILE",
        help="Judge the peak of the time history in bands: a CSV file with low_hz, high_hz and limit_mn_m (or limit_n_m,"
        " limit_n, limit_m_s2, limit_g).",
    ),
    click.option(
        "--roll-off",
        type=float,
        metavar="PART",
        help="Part of an edge's frequency, on both sides, within which the bands' filters fall from 1 to 0 [default: 0.2,"
        " less for narrow bands].",
    ),
)
limit_options = options(
    click.option(
        "--limit",
        metavar="TORQUE|FILE",
        help="Largest line allowed, e.g. '10 mN*m', or a CSV file of a curve over frequency: margins in the report.",
    ),
    click.option(
        "--band",
        metavar="LOW:HIGH",
        help="Band in which the limit applies, e.g. '0.5:150 Hz' [default: everywhere].",
    ),
)


recording_limit_options = options(
    click.option(
        "--limit",
        metavar="TORQUE|FILE",
        help="Judge the recording's lines: largest line allowed, e.g. '10 mN*m', or a CSV file of a curve over frequency.",
    ),
    click.option(
        "--limit-band",
        metavar="LOW:HIGH",
        help="Band in which the limit applies, e.g. '0.5:150 Hz' [default: everywhere].",
    ),
)


def with_precompilation(command: Command) -> Command:
    """A command that simulates in this process, whatever it is told: compiled code is on its way
    while the rest is imported.
    """

    @wraps(command)
    def begun(*arguments: Any, **options: Any) -> None:
        from microvib.analysis.ahead import start_compilation

        start_compilation()
        command(*arguments, **options)

    return begun


def _form(pdf: bool, report_data: Path | None) -> Form:
    """Form of the report that is asked for; a library that is missing and wrong data are told before
    anything is computed.
    """
    if pdf:
        import typst  # noqa: F401
    from microvib.reports.document import Form
    from microvib.reports.title_block import TitleBlock, read_title_block

    if report_data is None:
        block = TitleBlock()
    else:
        block = read_title_block(report_data)
    return Form(pdf, click.get_current_context().find_root().obj or "", block)


def report_options(command: Command) -> Command:
    """Options of every command with a report; the command gets them as ``form``."""

    @click.option("--pdf", is_flag=True, help="Also write the report as PDF (extra `report`).")
    @click.option(
        "--report-data",
        type=PATH,
        metavar="FILE",
        envvar="MICROVIB_REPORT_DATA",
        help="Author, document number, issue, date and signatures of the report: a YAML file.",
    )
    @wraps(command)
    def with_form(*arguments: Any, pdf: bool, report_data: Path | None, **options: Any) -> None:
        command(*arguments, form=_form(pdf, report_data), **options)

    return with_form


@dataclass(frozen=True)
class Target:
    """Where a study's results go: printed, and written into a folder where there is one."""

    out: Path | None
    overwrite: bool
    form: Form

    def present(self, outcome: Outcome) -> None:
        """Print an outcome, after its files and its report are written."""
        from microvib.reports.outcome import study_contents, terminal_text

        self.deliver(terminal_text(outcome), study_contents, outcome)

    def deliver(self, text: str, contents: Callable[..., Contents], *result: Any) -> None:
        """Write the ``contents`` of a result, then print: a reader who leaves early does not cost
        the results.
        """
        from microvib.reports.rendering import write_study

        files = (
            ()
            if self.out is None
            else write_study(self.out, contents(*result), self.form, self.overwrite)
        )
        echo(text)
        if self.out is not None:
            echo(f"\nWritten: {', '.join(str(self.out / name) for name in files)}")


def target_options(
    text: str, folder: Callable[[Mapping[str, Any]], str] | None = None
) -> Callable[[Command], Command]:
    """Options of a command that writes a folder, checked before anything is computed; the command
    gets them as ``target``.

    ``folder`` makes its name of the other options, where it has one without --out.
    """

    def with_options(command: Command) -> Command:
        @click.option("-o", "--out", type=PATH, help=text)
        @click.option("--overwrite", is_flag=True, help="Replace existing results in the folder.")
        @report_options
        @wraps(command)
        def with_target(
            *arguments: Any, out: Path | None, overwrite: bool, form: Form, **options: Any
        ) -> None:
            from microvib.io.writing import check_folder, free_folder

            if out is None and folder is not None:
                out = free_folder(folder(options))
            if out is not None:
                check_folder(out, overwrite)
            elif form.pdf:
                raise OptionError(
                    "pdf", "the report is written into a folder; give one", remedy="out"
                )
            command(*arguments, target=Target(out, overwrite, form), **options)

        return with_target

    return with_options


def parse_limit(limit: str | None, band: str | None, key: str = "band") -> Limit | None:
    """The limit of ``--limit`` and the option of its band, called ``key``: a torque, or a CSV file of
    curves over frequency.
    """
    from microvib.io.limit_files import given_limit

    try:
        return given_limit(limit, band)
    except OptionError as error:
        if error.key != "band" or key == "band":
            raise
        problem = str(error).removeprefix("band: ")
        raise OptionError(key, problem, remedy=error.remedy) from None


def load(source: str, settings: tuple[str, ...]) -> Scenario:
    """Scenario of a file or catalog name, with ``--set KEY=VALUE`` applied; unusual values
    is said on standard error.
    """
    from microvib.io.scenario_file import load_scenario, parse_value

    changes = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise OptionError(
                "set", "KEY=VALUE is expected, such as reducer.stiffness='9000 N*m/rad'", setting
            )
        changes[key.strip()] = parse_value(value)
    loaded = load_scenario(source, changes)
    print_scenario_warnings(loaded, source)
    return loaded


def print_scenario_warnings(scenario: Scenario, name: str) -> None:
    """Tell values that are allowed but unusual, on standard error."""
    found = scenario.unusual_values()
    for text in found[:MAX_WARNINGS]:
        click.echo(f"Note: {name}: {text}", err=True)
    if len(found) > MAX_WARNINGS:
        click.echo(f"Note: {name}: and {len(found) - MAX_WARNINGS} more unusual values", err=True)


def load_guide(source: str | None) -> Scenario | None:
    """The scenario that says which lines to look for; None without one."""
    from microvib.io.scenario_file import load_scenario

    if source is None:
        return None
    return load_scenario(source)


def read_preparation(file: Path | None) -> Preparation | None:
    """Contents of a preparation file; None without one."""
    from microvib.io.recordings import load_preparation

    if file is None:
        return None
    return load_preparation(file)


def read_bands(file: Path | None, roll_off: float | None) -> tuple[BandLimit, ...]:
    """Bands and limits of a file; none without one."""
    from microvib.io.band_limits import read_band_limits

    if file is None:
        if roll_off is not None:
            raise OptionError("roll_off", "is that of filters of bands; give bands", remedy="bands")
        return ()
    return read_band_limits(file)
