"""Uvicorn, with what it leaves without an end: connections that do not get on are cut, and
strangers give way.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from microvib.web.server.limits import Limits

WAITING = 1024  # clients that the system keeps until they are accepted


class Connection(H11Protocol):
    """A connection that must get on.

    Uvicorn bounds the pause between two requests. Here the head of a request, the reading of an
    answer, and everything of a stranger, who has shown no token yet, are bounded as well; a further
    stranger takes the place of the oldest, so that no number of them keeps the owner out.
    """

    limits: Limits
    strangers: dict[Connection, None]
    """In the order of their arrival; shared by the connections of one server."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.app_state = {**self.app_state, "connection": self}  # how the guard finds it
        self._timers: dict[str, asyncio.TimerHandle] = {}

    def owned(self) -> None:
        """Its client has shown the token, or what was given for it."""
        self.strangers.pop(self, None)
        self._end("stranger")

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A client is there."""
        super().connection_made(transport)
        self.strangers[self] = None
        self._begin("stranger", self.limits.stranger_s)
        if len(self.strangers) > self.limits.strangers:
            next(iter(self.strangers)).cut()

    def data_received(self, data: bytes) -> None:
        """Data of a client between two requests, which is the head of one; the guard looks after its
        body.
        """
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._end("head")
        else:
            self._begin("head", self.limits.pause_s)

    def pause_writing(self) -> None:
        """The client does not read."""
        super().pause_writing()
        self._begin("reading", self.limits.reading_s)

    def resume_writing(self) -> None:
        """It does again."""
        super().resume_writing()
        self._end("reading")

    def connection_lost(self, exc: Exception | None) -> None:
        """The client is gone."""
        super().connection_lost(exc)
        self.strangers.pop(self, None)
        for name in list(self._timers):
            self._end(name)

    def cut(self) -> None:
        """End it, whatever is under way."""
        self.strangers.pop(self, None)
        self.transport.abort()

    def _begin(self, name: str, seconds: float) -> None:
        if name not in self._timers:
            self._timers[name] = self.loop.call_later(seconds, self.cut)

    def _end(self, name: str) -> None:
        timer = self._timers.pop(name, None)
        if timer is not None:
            timer.cancel()


def configuration(app: Any, limits: Limits) -> uvicorn.Config:
    """How uvicorn is to serve."""
    kind = type("Connection", (Connection,), {"limits": limits, "strangers": {}})
    # Of those who wait to be accepted few are taken at a time: one is heard before others push it
    # out.
    return uvicorn.Config(
        app, log_level="error", access_log=False, server_header=False, lifespan="off", ws="none", http=kind,
        limit_concurrency=limits.connections, backlog=limits.strangers // 8, timeout_graceful_shutdown=3,
    )  # fmt: skip


class Server(uvicorn.Server):
    """A server that lets its computations go first when it ends, so that nothing waits for them."""

    def __init__(self, config: uvicorn.Config, leave: Callable[[], None]) -> None:
        super().__init__(config)
        self._leave = leave

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen; who comes while others are being accepted waits in the system's queue."""
        await super().startup(sockets)
        for sock in sockets or []:
            sock.listen(WAITING)

    def handle_exit(self, sig: int, frame: Any) -> None:
        """End."""
        self._leave()
        super().handle_exit(sig, frame)
