"""The documentation site: opened from the package, and how it gets there from a checkout."""

from __future__ import annotations

from pathlib import Path

import click

from microvib.errors import MicrovibError, OutputError

PACKAGE = Path(__file__).parents[1]
SITE = PACKAGE / "site"
SOURCE = PACKAGE.parents[1] / "docs"


def site_index() -> Path:
    """First page of the site; MicrovibError where it was not built into this installation."""
    index = SITE / "index.html"
    if not index.is_file():
        raise MicrovibError(
            "the site is not in this installation; build it in a checkout with: microvib docs"
            " --build (its pages can be read"
            " there as plain files, in docs)"
        )
    return index


def build_site() -> None:
    """Build the site from the checkout that this package is installed from, and put it into the
    package.
    """
    from microvib.io.writing import put_in_place, workspace

    if not (SOURCE / "conf.py").is_file():
        raise MicrovibError(
            "building needs a checkout of the repository, installed with: pip install -e '.[docs]';"
            " this installation is not one"
        )
    from sphinx.cmd.build import build_main

    doctrees = SOURCE / "_build" / "doctrees"
    try:
        with workspace(PACKAGE, SITE.name) as space:
            new = space / "new"
            if (
                build_main(["-W", "--keep-going", "-q", "-d", str(doctrees), str(SOURCE), str(new)])
                != 0
            ):
                raise MicrovibError(
                    "the site was not built (reasons above); the previous one is unchanged"
                )
            put_in_place(new, SITE, space)
    except OSError as error:
        raise OutputError(f"{SITE}: cannot be written: {error.strerror or error}") from None


@click.command()
@click.option(
    "--path", "path_only", is_flag=True, help="Print the location of the site without opening it."
)
@click.option(
    "--build",
    is_flag=True,
    help="Build the site into the package first: in a checkout, with the extra 'docs'.",
)
def docs(path_only: bool, build: bool) -> None:
    """Open the documentation, a site that needs no network, in the browser."""
    import webbrowser

    if build:
        build_site()
    index = site_index()
    opened = not path_only and webbrowser.open(index.as_uri())
    click.echo(index if opened or path_only else f"No browser could be started; open {index}")
