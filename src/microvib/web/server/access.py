"""Who may ask: the names that the server goes by, what shows that a request is its owner's, and how
a browser comes in.

The token is exchanged for a cookie and a key, and stays in no address.
"""

from __future__ import annotations

import ipaddress
import re
import secrets
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.responses import HTMLResponse

from microvib.web.jobs.store import private

_LINKED = re.compile(
    r"/api/runs/[0-9a-f]{16}/(files|exports)/[a-z0-9.-]+"
)  # what a link may lead to, which can carry no header


def _secret() -> str:
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class Access:
    """From where and with what the server may be asked.

    A script shows the token. A browser is given a cookie and a key for it. Scripts cannot read the
    cookie, but browsers send it to every port of a host, so also to servers of other users; the key
    is in the page's storage, which belongs to this host and port alone. Neither opens anything
    without the other, but that links to files go with the cookie: nobody else knows the id in them.
    """

    names: frozenset[str] = frozenset(
        {"localhost"}
    )  # host names that it goes by, besides addresses
    remote: bool = False
    cookie: str = "microvib"
    """Name of the cookie; it has the port in it, because servers at other ports of the host have
    their own.
    """
    token: str = field(default_factory=_secret, repr=False)
    session: str = field(default_factory=_secret, repr=False)  # value of the cookie
    key: str = field(default_factory=_secret, repr=False)

    def known(self, host: str) -> bool:
        """Whether the server goes by this Host: names can be made to lead here by others, addresses
        cannot.
        """
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self.names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self.remote or address.is_loopback

    def may(self, path: str, headers: Mapping[str, str]) -> bool:
        """Whether a request shows that it is the owner's."""
        if self._bears(headers):
            return True
        whole = _LINKED.fullmatch(path) is not None or _same(
            headers.get("x-microvib-key", ""), self.key
        )
        return whole and self._has_cookie(headers)

    def greets(self, headers: Mapping[str, str]) -> bool:
        """Whether a request comes from somebody who has been let in, which opens nothing yet."""
        return self._bears(headers) or self._has_cookie(headers)

    def opens(self, token: str) -> bool:
        """Whether this is the token."""
        return _same(token, self.token)

    def _bears(self, headers: Mapping[str, str]) -> bool:
        return self.opens(headers.get("authorization", "").removeprefix("Bearer "))

    def _has_cookie(self, headers: Mapping[str, str]) -> bool:
        # By hand: http.cookies gives up at the first odd cookie, and other servers of the host have
        # theirs in the same header.
        pairs = (part.strip().partition("=") for part in headers.get("cookie", "").split(";"))
        return any(name == self.cookie and _same(value, self.session) for name, _, value in pairs)


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


_MAX_LENGTH = 500
_OPENING = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>microvib</title></head><body>
<form method="post" action="{action}"><input type="hidden" name="token" value="{token}"><button>Open microvib</button></form>
<script>document.forms[0].submit()</script>
</body></html>
"""
_INSIDE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>microvib</title><meta name="key" content="{key}">
<script type="module" src="/static/enter.js"></script></head>
<body><noscript>This page needs JavaScript.</noscript></body></html>
"""


def opening_file(root: Path, url: str, access: Access) -> Path:
    """A file that sends its reader's browser in.

    A browser is started with an address, which every user of the machine sees in the list of
    processes; the file is for its owner alone, and what it sends stays in no history.
    """
    path = root / "open.html"
    text = _OPENING.format(action=escape(f"{url}enter"), token=escape(access.token))
    with open(path, "x", encoding="utf-8", opener=private) as stream:
        stream.write(text)
    return path


def leads_in(scope: MutableMapping[str, Any]) -> bool:
    """Whether this is the way in: the printed address, or what the file sends."""
    at = (scope["method"], scope["path"])
    return at == ("POST", "/enter") or (at == ("GET", "/") and b"token=" in scope["query_string"])


async def token_of(scope: MutableMapping[str, Any], receive: Any) -> str:
    """The token that somebody at the way in shows."""
    given = bytes(scope["query_string"])
    if scope["method"] == "POST":
        given, more = b"", True
        while more and len(given) < _MAX_LENGTH:
            message = await receive()
            given += message.get("body", b"")
            more = message.get("more_body", False)
    return parse_qs(given[:_MAX_LENGTH].decode("latin-1")).get("token", [""])[0]


def inside(access: Access) -> HTMLResponse:
    """Credentials that admit a browser.

    A page and no redirection: a browser that comes from elsewhere would not take a strict cookie
    along on one.
    """
    cookie = f"{access.cookie}={access.session}; Path=/; HttpOnly; SameSite=Strict"
    return HTMLResponse(_INSIDE.format(key=access.key), headers={"set-cookie": cookie})
