"""The documentation site."""

from __future__ import annotations

import click


@click.command()
@click.option("--path", "path_only", is_flag=True, help="Print the location of the site without opening it.")
@click.option(
    "--build", is_flag=True, help="Build the site into the package first: in a checkout, with the extra 'docs'."
)
def docs(path_only: bool, build: bool) -> None:
    """Open the documentation, a site that needs no network, in the browser."""
    import webbrowser

    from microvib.cli.site import build_site, site_index

    if build:
        build_site()
    index = site_index()
    opened = not path_only and webbrowser.open(index.as_uri())
    click.echo(index if opened or path_only else f"No browser could be started; open {index}")
