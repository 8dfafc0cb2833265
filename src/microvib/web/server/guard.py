"""Guard of the server: host, origin, credentials, size and pace of requests, and headers of answers."""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse, Response

from microvib.web.server.access import Access, inside, leads_in, token_of
from microvib.web.server.limits import Limits

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:"
    " blob:; font-src 'self' data:;"
    " connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors"
    " 'none'"
)
"""Scripts are files of ours; styles may stand in elements, because Plotly writes them there."""
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"microvib-server", secrets.token_hex(8).encode()),
]
"""The last is drawn at each start: by it a page sees that another server has taken the place of the
one it knew.
"""
FAULT = "internal error of the server; its log says more"
_STRANGER = (
    "open the address that microvib serve printed last: it carries the token that is needed here"
)
_SAFE = ("GET", "HEAD", "OPTIONS")
_RECORDINGS = "/api/recordings"
_MAX_STRINGS = 10_000
_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*+"?', re.DOTALL)


class Guard:
    """Refuses what may not be asked, with a sentence, before it reaches the application."""

    def __init__(self, app: App, access: Access, limits: Limits) -> None:
        self._app, self._access, self._limits = app, access, limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one HTTP request."""
        headers = {
            key.decode("latin-1").lower(): value.decode("latin-1")
            for key, value in scope["headers"]
        }
        reply = _Reply(scope, receive, send)
        body = _Body(receive, reply, self._limits)
        refusal = self._refusal(scope, headers)
        try:
            if refusal is not None:
                await reply.say(*refusal)
                return
            if self._access.greets(headers):
                _let_stay(scope)
            if leads_in(scope):
                await self._enter(scope, body, reply)
            elif scope["path"] == _RECORDINGS:
                await self._app(scope, body, reply)
            else:
                await self._with_whole(scope, body, reply)
        except ClientDisconnect:
            return
        except Exception as error:
            logging.getLogger("microvib.serve").exception(
                "%s %s: %s", scope["method"], scope["path"], error
            )
            await reply.say(500, FAULT)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        host = headers.get("host", "")
        if not self._access.known(host):
            return 403, f"this server is not called '{host[:100]}'"
        if _is_public(scope) or leads_in(scope):
            return self._too_large(scope, headers)
        if _foreign(scope["method"], headers, host):
            return 403, "requests of other pages are refused"
        if not self._access.may(scope["path"], headers):
            return 401, _STRANGER
        return self._too_large(scope, headers)

    async def _enter(self, scope: Scope, receive: Receive, reply: _Reply) -> None:
        """Let in who shows the token."""
        if not self._access.opens(await token_of(scope, receive)):
            await reply.say(401, _STRANGER)
            return
        _let_stay(scope)
        await reply.give(inside(self._access))

    async def _with_whole(self, scope: Scope, receive: _Body, reply: _Reply) -> None:
        """Have a request answered whose body is all here and simple: while it is parsed, all others
        wait.
        """
        body = await receive.whole()
        if b"\0" in body:  # or UTF-16, in which structure could be hidden
            await reply.say(422, "the request is not JSON in UTF-8")
        elif len(_STRINGS.sub(b"", body, count=_MAX_STRINGS)) > self._limits.structure:
            most = f"{self._limits.structure / 1e3:g} kB"
            await reply.say(
                413, f"the request holds too many values: beside texts at most {most} are taken"
            )
        else:
            await self._app(scope, receive, reply)

    def _too_large(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        if "transfer-encoding" in headers:
            return 411, "the length of the request is needed (Content-Length)"
        length = headers.get("content-length", "0")
        if scope["path"] == _RECORDINGS:
            limit = self._limits.recording
        else:
            limit = self._limits.body
        if not (length.isascii() and length.isdigit()) or int(length[:20]) > limit:
            return 413, f"the request is too large: at most {limit / 1e6:g} MB are taken here"
        return None


def _let_stay(scope: Scope) -> None:
    """Tell the connection that its client is not a stranger."""
    connection = scope.get("state", {}).get("connection")
    if connection is not None:
        connection.owned()


def _is_public(scope: Scope) -> bool:
    """Whether anybody may have this: the page without anything in it."""
    return scope["method"] in ("GET", "HEAD") and (
        scope["path"] == "/" or scope["path"].startswith("/static/")
    )


def _foreign(method: str, headers: dict[str, str], host: str) -> bool:
    """Whether another page asks; its origin differs by name or port."""
    origin = headers.get("origin")
    if method not in _SAFE and origin is not None and origin.partition("://")[2] != host:
        return True
    return headers.get("sec-fetch-site", "none") not in ("same-origin", "none")


class _Reply:
    """The way back: every answer gets its headers; the first one counts."""

    def __init__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self._scope, self._receive, self._send = scope, receive, send
        self._begun = self._whole = False

    async def __call__(self, message: MutableMapping[str, Any]) -> None:
        if self._whole:
            return
        if message["type"] == "http.response.start":
            self._begun = True
            own = message["headers"]
            caching = [] if _says_caching(own) else [_caching(self._scope)]
            message = {**message, "headers": [*own, *_HEADERS, *caching]}
        await self._send(message)

    async def give(self, response: Response) -> None:
        """A whole answer, unless one has begun."""
        if not self._begun:
            await response(self._scope, self._receive, self)
            self._whole = True

    async def say(self, status: int, sentence: str) -> None:
        """A sentence, after which the connection ends: what is not taken is not read to its end."""
        await self.give(
            JSONResponse({"error": sentence, "key": None}, status, {"connection": "close"})
        )


class _Body:
    """Body that a client sends, as long as it keeps coming; one that lets it wait is told so, and has
    gone for the application.
    """

    def __init__(self, receive: Receive, reply: _Reply, limits: Limits) -> None:
        self._receive, self._reply, self._limits = receive, reply, limits
        self._taken, self._began, self._more = 0, 0.0, True
        self._kept: bytes | None = None

    async def __call__(self) -> MutableMapping[str, Any]:
        if self._kept is not None:
            body, self._kept = self._kept, None
            return {"type": "http.request", "body": body, "more_body": False}
        if (
            not self._more
        ):  # all is here: what comes next is the client's end, which may take as long as it likes
            return await self._receive()
        now = asyncio.get_running_loop().time()
        self._began = self._began or now
        due = self._began + self._taken / self._limits.slowest
        try:
            async with asyncio.timeout_at(min(due, now) + self._limits.pause_s):
                message = await self._receive()
        except TimeoutError:
            await self._reply.say(408, "the request came too slowly")
            raise ClientDisconnect from None
        self._taken += len(message.get("body", b""))
        self._more = message.get("more_body", False)
        return message

    async def whole(self) -> bytes:
        """All of it, which is then given again."""
        parts = []
        while self._more:
            message = await self()
            if message["type"] == "http.disconnect":
                raise ClientDisconnect
            parts.append(message.get("body", b""))
        self._kept = b"".join(parts)
        return self._kept


def _says_caching(headers: list[tuple[bytes, bytes]]) -> bool:
    """Whether an answer says itself how long it may be kept, as files of the page do."""
    return any(name == b"cache-control" for name, _ in headers)


def _caching(scope: Scope) -> tuple[bytes, bytes]:
    return b"cache-control", b"no-cache" if _is_public(scope) and not leads_in(
        scope
    ) else b"no-store"
