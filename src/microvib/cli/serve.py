"""The command that serves the page."""

from __future__ import annotations

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
def serve(port: int, host: str, allow_remote: bool, no_browser: bool) -> None:
    """Serve the page: scenarios, runs, recordings, rate maps and sizing in a browser, on this
    machine and offline.
    """
    from microvib.web.server.serve import serve as run_server

    run_server(host, port, allow_remote, not no_browser, click.echo)
