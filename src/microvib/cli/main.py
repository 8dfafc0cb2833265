"""The command line. Commands import what they need when they run, so that help is instant."""

from __future__ import annotations

try:
    from microvib.cli import signals

    _held = (
        signals.exit_on_interrupt()
    )  # until all is imported; nothing has begun that could be left half done
    import os
    import shlex
    import sys
    from functools import partial
    from typing import Any

    import click

    from microvib.cli import (
        budget,
        campaign,
        docs,
        envelope,
        export,
        margin,
        new,
        profile,
        quiet,
        rates,
        scenarios,
        sensitivity,
        serve,
        structures,
        table_tests,
        test_data,
        track,
        validation,
        wheel,
    )
    from microvib.cli.streams import status_of
    from microvib.reports.drawing import import_matplotlib_lean
except KeyboardInterrupt:
    raise SystemExit(130) from None

# The matrices here are small: threads of BLAS would only wait for each other. Set before NumPy is
# first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Drawings go into files: which window system a user's other programs draw on, or whether it exists,
# is nothing to us.
os.environ["MPLBACKEND"] = "agg"


class _Command(click.Group):
    """The command ``microvib``; called as a program it ends with a status, and says errors in
    sentences.
    """

    def main(self, *arguments: Any, standalone_mode: bool = True, **settings: Any) -> Any:
        run = partial(super().main, *arguments, standalone_mode=False, **settings)
        if not standalone_mode:
            return run()
        program = (
            not arguments and "args" not in settings
        )  # rather than called from Python with arguments
        if program:
            signals.redeliver_unraisable_interrupts()
            import_matplotlib_lean()
        status = status_of(run)
        if program:
            signals.exit_on_interrupt()
        return sys.exit(status)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.obj = shlex.join(["microvib", *args])  # a report says by which command it was made
        return super().parse_args(ctx, args)


_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True}


def _show_version(context: click.Context, parameter: click.Parameter, asked: bool) -> None:
    if asked:
        from microvib import __version__

        click.echo(f"microvib, version {__version__}")
        context.exit()


@click.group(cls=_Command, context_settings=_SETTINGS)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version and exit.",
)
def main() -> None:
    """Disturbance torque of a sun-tracking solar array: from the drive's data sheet to its lines.

    Start with `microvib run state-1`, or write a file of your own with `microvib new
    my-drive.yaml`.
    """


for _command in (
    scenarios.run, scenarios.report, test_data.compare, test_data.analyse, test_data.measure, test_data.identify,
    track.track, wheel.wheel,
    validation.validate, validation.statements, rates.rates, profile.profile, margin.margin, campaign.campaign,
    structures.modes, structures.sas, table_tests.hammer, table_tests.repeatability, table_tests.acceptance, envelope.envelope,
    serve.serve, scenarios.scenarios, scenarios.show, new.new, scenarios.schema, docs.docs, sensitivity.sensitivity, budget.budget,
    quiet.quiet, export.export,
):  # fmt: skip
    main.add_command(_command)

if _held:
    signals.restore_keyboard_interrupt()
