"""`microvib serve` as a program."""

from __future__ import annotations

import asyncio
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import httpx2 as httpx
import pytest
from support.server import LONG, start, wait
from support.tiers import sweep

from microvib.web.server.serve import listening_socket


@contextmanager
def microvib(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "microvib", "serve", "--no-browser", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        try:
            yield server
        finally:
            server.kill()


def told(*arguments: str) -> tuple[int, str]:
    """Exit status and what is said of a server that should not start."""
    with microvib(*arguments) as server:
        said = server.communicate(timeout=240)[1]
        return server.returncode, said


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("end", sweep([signal.SIGTERM, signal.SIGINT], signal.SIGTERM))
def test_the_command_serves_and_ends_cleanly(tmp_path, monkeypatch, end):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with microvib("--port", "0") as server:
        url, port, token = re.search(
            r"(http://127.0.0.1:(\d+))/\?token=(\S+)", server.stdout.readline()
        ).groups()
        with httpx.Client(
            base_url=url, timeout=240.0, headers={"authorization": f"Bearer {token}"}
        ) as client:
            assert "<html" in client.get("/").text
            assert (
                client.get("/static/plotly.min.js")
                .headers["content-type"]
                .startswith("text/javascript")
            )
            if end == signal.SIGTERM:
                used = f"Error: --port {port}: is in use; choose another, or end what uses it\n"
                assert told("--port", port) == (1, used)
                wait(client, start(client, LONG), "running")
            server.send_signal(end)
            _, said = server.communicate(timeout=240)
        assert (server.returncode, said) == (0, "")
    assert not list(tmp_path.glob(".page-*"))


def test_an_address_that_is_not_of_this_machine_is_refused():
    status, said = told("--port", "0", "--host", "no.such.host.invalid")
    assert (status, said.count("\n")) == (1, 1)
    assert "is not an address of this machine" in said


def test_answers_are_sent_at_once():
    # what a connection sends would otherwise wait for the client's delayed acknowledgement, 40 ms
    async def option_of_a_connection() -> int:
        accepted: asyncio.Queue[int] = asyncio.Queue()

        async def look(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            sock = writer.get_extra_info("socket")
            accepted.put_nowait(sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
            writer.close()

        listening = listening_socket("127.0.0.1", 0, remote=False)
        async with await asyncio.start_server(look, sock=listening):
            _, writer = await asyncio.open_connection(*listening.getsockname())
            try:
                return await accepted.get()
            finally:
                writer.close()

    assert asyncio.run(option_of_a_connection())
