"""How a browser comes in: the token is exchanged for a cookie and a key, and stays in no address."""

from __future__ import annotations

from collections.abc import MutableMapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from microvib.web.jobs.store import private
from microvib.web.server.access import Access

_LONGEST = 500
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

    A browser is started with an address, which every user of the machine sees in the list of processes; the file is for its owner
    alone, and what it sends stays in no history.
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
        while more and len(given) < _LONGEST:
            message = await receive()
            given += message.get("body", b"")
            more = message.get("more_body", False)
    return parse_qs(given[:_LONGEST].decode("latin-1")).get("token", [""])[0]


def inside(access: Access) -> tuple[list[tuple[bytes, bytes]], bytes]:
    """Headers and body that let a browser in.

    A page and no redirection: a browser that comes from elsewhere would not take a strict cookie along on one.
    """
    cookie = f"{access.cookie}={access.session}; Path=/; HttpOnly; SameSite=Strict"
    body = _INSIDE.format(key=access.key).encode()
    return [(b"content-type", b"text/html; charset=utf-8"), (b"set-cookie", cookie.encode())], body
