"""The command line. Commands import what they need when they run, so that help is instant."""

from __future__ import annotations

import os
import shlex
from typing import Any

import click

from microvib import __version__
from microvib.app.commands import arrays, campaign, docs, families, reports, scenarios, test_data, web
from microvib.errors import MicrovibError

# The matrices here are small: threads of BLAS would only wait for each other. Set before NumPy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_EXTRAS = {
    "pyfe3d": "fem",
    "pyyeti": "fem",
    "pyuff": "test-data",
    "nptdms": "test-data",
    "typst": "report",
    "distributed": "dask",
    "sphinx": "docs",
    "fastapi": "serve",
    "uvicorn": "serve",
}
"""Extra of the package that brings a library."""


class _Sentences(click.Group):
    """Turns errors meant for the user into sentences on standard error and an exit status."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.obj = shlex.join(["microvib", *args])  # a report says by which command it was made
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MicrovibError as error:
            for line in str(error).splitlines():
                click.echo(f"Error: {line}", err=True)
            ctx.exit(1)
        except ModuleNotFoundError as error:
            extra = _EXTRAS.get((error.name or "").split(".")[0])
            if extra is None:
                raise
            click.echo(
                f"Error: this needs {error.name}, which is not installed; pip install 'microvib[{extra}]'", err=True
            )
            ctx.exit(1)
        except KeyboardInterrupt:
            click.echo("Interrupted; nothing was written.", err=True)
            ctx.exit(130)
        except MemoryError:
            click.echo("Error: memory is exhausted; shorten record.duration, or use --lines-only", err=True)
            ctx.exit(1)


@click.group(cls=_Sentences, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="microvib")
def main() -> None:
    """Disturbance torque of a sun-tracking solar array: from the drive's data sheet to its lines.

    Start with `microvib run state-1`, or write a file of your own with `microvib new my-drive.yaml`.
    """


for _command in (
    scenarios.run,
    reports.report,
    test_data.compare,
    test_data.analyse,
    test_data.measure,
    test_data.identify,
    test_data.validate,
    families.rates,
    campaign.campaign,
    arrays.modes,
    arrays.sas,
    web.serve,
    scenarios.scenarios,
    scenarios.show,
    scenarios.new,
    scenarios.schema,
    docs.docs,
):
    main.add_command(_command)
