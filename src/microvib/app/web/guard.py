"""Who may ask what: host, origin, token, size; and what every answer carries."""

from __future__ import annotations

import ipaddress
import json
import logging
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.requests import ClientDisconnect

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:;"
    " connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Scripts are files of ours; styles may stand in elements, because Plotly writes them there."""
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
]
FAULT = "the server met a fault of its own; its log says more"
_SAFE = ("GET", "HEAD", "OPTIONS")


@dataclass(frozen=True)
class Access:
    """From where the server may be asked."""

    names: frozenset[str] = frozenset({"localhost"})
    """Host names that it goes by, beside addresses."""
    remote: bool = False
    token: str = ""
    """What every request must carry; empty: none is wanted."""
    cookie: str = "microvib"


class Guard:
    """Refuses what may not be asked, with a sentence, before it reaches the application."""

    def __init__(self, app: App, access: Access, body: int, recording: int) -> None:
        self._app, self._access, self._body, self._recording = app, access, body, recording

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one HTTP request."""
        headers = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]}
        begun = False

        async def answer(message: MutableMapping[str, Any]) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                message = {**message, "headers": [*message["headers"], *_HEADERS, *_caching(scope, message)]}
            await send(message)

        refusal = self._refusal(scope, headers)
        if refusal is not None:
            await _say(answer, *refusal)
        elif self._enters(scope):
            await self._enter(answer)
        else:
            try:
                await self._app(scope, receive, answer)
            except ClientDisconnect:
                return
            except Exception as error:
                logging.getLogger("microvib.serve").exception("%s %s: %s", scope["method"], scope["path"], error)
                if not begun:
                    await _say(answer, 500, FAULT)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if not self._known(host):
            return 403, f"this server does not go by the name '{host[:100]}'"
        origin = headers.get("origin")
        if scope["method"] not in _SAFE and origin is not None and origin.partition("://")[2] != host:
            return 403, "requests of other pages are refused"
        if not self._may(scope, headers):
            return 401, "the token of the printed address is wanted"
        return self._too_large(scope, headers)

    def _known(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self._access.names:
            return True
        try:  # names can be made to lead here by others, addresses cannot
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._access.remote or address.is_loopback

    def _may(self, scope: Scope, headers: dict[str, str]) -> bool:
        if not self._access.token or self._enters(scope):
            return True
        bearer = headers.get("authorization", "").removeprefix("Bearer ")
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(self._access.cookie)
        except CookieError:
            morsel = None
        return self._same(bearer) or (morsel is not None and self._same(morsel.value))

    def _same(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._access.token.encode())

    def _enters(self, scope: Scope) -> bool:
        """Whether this is the printed address, with its token."""
        if not self._access.token or scope["path"] != "/" or scope["method"] != "GET":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return self._same(given)

    async def _enter(self, send: Send) -> None:
        """The token moves from the address into a cookie."""
        cookie = f"{self._access.cookie}={self._access.token}; Path=/; HttpOnly; SameSite=Strict"
        headers = [(b"location", b"/"), (b"set-cookie", cookie.encode()), (b"content-length", b"0")]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})

    def _too_large(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        if "transfer-encoding" in headers:
            return 411, "the length of the request is wanted (Content-Length)"
        length = headers.get("content-length", "0")
        limit = self._recording if scope["path"] == "/api/recordings" else self._body
        if not length.isdigit() or int(length) > limit:
            return 413, f"the request is too large: at most {limit / 1e6:g} MB are taken here"
        return None


def _caching(scope: Scope, message: MutableMapping[str, Any]) -> list[tuple[bytes, bytes]]:
    kept = scope["path"].startswith("/static/") or scope["path"] == "/"
    return [(b"cache-control", b"no-cache" if kept else b"no-store")]


async def _say(send: Send, status: int, sentence: str) -> None:
    body = json.dumps({"error": sentence, "key": None}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
