"""``microvib serve``: one process that answers, until it is told to end."""

from __future__ import annotations

import contextlib
import errno
import logging
import signal
import socket
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

from microvib.errors import MicrovibError, OptionError
from microvib.io.writing import workspace
from microvib.web.jobs.library import Library, opened_library, usual_folder
from microvib.web.jobs.store import Store
from microvib.web.routes import forms
from microvib.web.routes.scenarios import catalog_entries, form_groups
from microvib.web.server.access import Access, opening_file
from microvib.web.server.application import create_app
from microvib.web.server.assets import Assets
from microvib.web.server.connection import WAITING, Server, configuration
from microvib.web.server.limits import Limits

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Serving:
    """How a server is to be started."""

    host: str
    port: int
    remote: bool
    """Whether other machines may reach it."""
    browser: bool
    """Whether a browser is opened."""
    library: Path | None
    """Folder that keeps results and recordings; None for this user's own."""
    keeps: bool = True
    """Whether anything outlasts the server."""


def serve(asked: Serving, tell: Tell) -> None:
    """Serve the page until SIGINT or SIGTERM; MicrovibError where the address, or the library that is
    named, cannot be had.
    """
    host, port, remote = asked.host, asked.port, asked.remote
    sock = listening_socket(host, port, remote)
    address, port = sock.getsockname()[:2]
    access = _access(host, port, remote)
    url = _url(address, port)
    logging.basicConfig(stream=sys.stderr, format="%(message)s")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with ExitStack() as open_folders:
        library = _library(asked, open_folders, tell)
        temporary = Path(tempfile.gettempdir())
        parent = temporary if library is None else library.root  # of the same disk
        root = open_folders.enter_context(workspace(parent, "page"))  # its mode keeps others out
        store = Store(root, Limits(), library)
        assets = Assets()
        app = create_app(store, access, assets)
        server = Server(configuration(app, store.limits), store.close)
        try:
            with contextlib.suppress(KeyboardInterrupt):
                threading.Thread(target=_warm, args=(assets,), daemon=True).start()
                tell(f"microvib serves at {url}?token={access.token}   (Ctrl-C ends it)")
                if asked.browser:
                    way_in = open_folders.enter_context(workspace(temporary, "page"))
                    opening = opening_file(way_in, url, access)
                    threading.Timer(0.5, webbrowser.open, [opening.as_uri()]).start()
                server.run(sockets=[sock])
        finally:
            store.close()
            store.join()
            sock.close()


def _library(asked: Serving, open_folders: ExitStack, tell: Tell) -> Library | None:
    """The library; where the usual one cannot be had, nothing is kept, which is said."""
    if not asked.keeps:
        return None
    try:
        return open_folders.enter_context(opened_library(asked.library or usual_folder()))
    except MicrovibError as error:
        if asked.library is not None:
            raise
        tell(f"Nothing is kept when this server ends. {error}")
        return None


def _url(address: str, port: int) -> str:
    """Address to open; where it listens at every address, by the name of this machine."""
    ip = ip_address(address)
    if ip.is_unspecified:
        shown = socket.gethostname()
    elif ip.version == 6:
        shown = f"[{address}]"
    else:
        shown = address
    return f"http://{shown}:{port}/"


def _warm(assets: Assets) -> None:
    """Load what the form needs while the page is being opened."""
    catalog_entries()
    form_groups()
    forms.view_of(forms.Spec(base="state-1"))
    assets.pack()


def _access(host: str, port: int, remote: bool) -> Access:
    names = {"localhost"}
    if remote:
        names |= {host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
    return Access(frozenset(names), remote, f"microvib-{port}")


def listening_socket(host: str, port: int, remote: bool) -> socket.socket:
    """A listening socket at the address."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise OptionError(
            "host", f"is not an address of this machine ({error.strerror})", host
        ) from None
    if not ip_address(str(address[0]).split("%")[0]).is_loopback and not remote:
        raise OptionError(
            "host",
            "others could reach the server there; allow that if it is intended",
            host,
            remedy="allow_remote",
        )
    # asyncio sends small answers at once (TCP_NODELAY) only where the socket says that it is TCP;
    # otherwise each of them waits for the client's delayed acknowledgement, 40 ms.
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        if sys.platform != "win32":  # there it would share the port
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
        sock.listen(WAITING)
    except OSError as error:
        sock.close()
        if error.errno == errno.EADDRINUSE:
            raise OptionError(
                "port", "is in use; choose another, or end what uses it", str(port)
            ) from None
        raise OptionError(
            "host", f"cannot be used with port {port}: {error.strerror}", host
        ) from None
    return sock
