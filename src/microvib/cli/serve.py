"""The command that serves the page."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.option(
    "--port", default=8321, type=click.IntRange(0, 65_535), help="Port; 0 picks a free one."
)
@click.option("--host", default="127.0.0.1", help="Address to listen on.")
@click.option(
    "--allow-remote",
    is_flag=True,
    help="Let other machines connect to --host, with the token in the address.",
)
@click.option("--no-browser", is_flag=True, help="Do not open a browser.")
@click.option(
    "--library",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder that keeps results and recordings; usually one of your own data folder.",
)
@click.option("--no-library", is_flag=True, help="Keep nothing when the server ends.")
def serve(
    port: int,
    host: str,
    allow_remote: bool,
    no_browser: bool,
    library: Path | None,
    no_library: bool,
) -> None:
    """Serve the page: scenarios, runs, recordings, rate maps and sizing in a browser, on this
    machine and offline.
    """
    from microvib.web.server.serve import Serving
    from microvib.web.server.serve import serve as run_server

    asked = Serving(host, port, allow_remote, not no_browser, library, not no_library)
    run_server(asked, click.echo)
