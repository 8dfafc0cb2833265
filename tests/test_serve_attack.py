"""The server under attack: by those who stall, by odd requests, by another user of the machine. Everything on 127.0.0.1."""

from __future__ import annotations

import gzip
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from support.server import opened

from microvib.io.writing import workspace
from microvib.web.jobs.store import Store
from microvib.web.jobs.worker import without_folders
from microvib.web.server.access import Access, opening_file
from microvib.web.server.application import create_app
from microvib.web.server.connection import Server, configuration
from microvib.web.server.limits import Limits

pytestmark = pytest.mark.long
STRANGERS = 8
LIMITS = replace(
    Limits(),
    pause_s=0.4,
    stranger_s=0.8,
    reading_s=0.4,
    slowest=1e6,
    strangers=STRANGERS,
    receiving=2,
    structure=5000,
)


@dataclass(frozen=True)
class Served:
    """A server in this process that is asked through sockets."""

    port: int
    access: Access
    store: Store
    server: Server

    def connect(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=240)

    def head(self, first: str, *headers: str, owner: bool = True) -> bytes:
        shown = [f"Authorization: Bearer {self.access.token}"] if owner else []
        return "\r\n".join(
            [first, f"Host: 127.0.0.1:{self.port}", *shown, *headers, "", ""]
        ).encode("latin-1")

    def ask(self, request: bytes) -> bytes:
        """All that is answered until the server ends the connection."""
        with self.connect() as client:
            client.sendall(request)
            return everything(client)

    def jobs(self) -> bytes:
        """What the owner is answered."""
        return self.ask(self.head("GET /api/jobs HTTP/1.1", "Connection: close"))

    def connections(self) -> int:
        return len(self.server.server_state.connections)


def everything(client: socket.socket) -> bytes:
    parts = []
    try:
        while part := client.recv(65_536):
            parts.append(part)
    except ConnectionResetError:
        pass
    return b"".join(parts)


def statuses(answer: bytes) -> list[int]:
    return [int(found) for found in re.findall(rb"HTTP/1\.1 (\d{3}) ", answer)]


@contextmanager
def serving(store: Store) -> Iterator[Served]:
    access = Access(cookie="microvib-1")
    server = Server(configuration(create_app(store, access), store.limits), lambda: None)
    with socket.create_server(("127.0.0.1", 0)) as sock:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.01)
        yield Served(sock.getsockname()[1], access, store, server)
        server.should_exit = True
        thread.join(20)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    with opened(tmp_path_factory.mktemp("store"), LIMITS) as store:
        yield store


@pytest.fixture(scope="module")
def served(store: Store) -> Iterator[Served]:
    with serving(store) as found:
        yield found


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 240
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


# Those who stall


def test_half_sent_requests_keep_nobody_out(served: Served) -> None:
    with ExitStack() as stack:
        for _ in range(10 * STRANGERS):
            stack.enter_context(served.connect()).sendall(
                b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "
            )
        assert statuses(served.jobs()) == [200]
        assert served.connections() <= STRANGERS + 1
        until(lambda: served.connections() == 0)  # and they end, although their clients do not


def test_a_head_that_trickles_comes_to_an_end_also_behind_a_good_request(served: Served) -> None:
    with served.connect() as client:
        client.sendall(served.head("GET /api/jobs HTTP/1.1"))
        while b"[]" not in client.recv(65_536):
            pass
        sent = 0
        with suppress(OSError):  # a reset, or a pipe that is closed
            for letter in served.head("GET /api/jobs HTTP/1.1"):
                client.sendall(bytes([letter]))
                sent += 1
                time.sleep(0.05)
        assert 3 < sent < 40


@pytest.mark.parametrize("path", ["/api/recordings?name=x.csv", "/api/scenario"])
@pytest.mark.parametrize("trickle", [False, True])
def test_a_body_that_stalls_or_trickles_is_given_up(
    served: Served, path: str, trickle: bool
) -> None:
    with ExitStack() as stack:
        for _ in range(LIMITS.receiving):
            client = stack.enter_context(served.connect())
            client.sendall(
                served.head(f"POST {path} HTTP/1.1", "Content-Length: 1000000") + b"t,Mz\n"
            )
        assert statuses(served.jobs()) == [200]
        client.settimeout(0.1)
        answer = b""
        with suppress(ConnectionError):  # what is sent after the answer is met by a reset
            while not answer:
                with suppress(TimeoutError):
                    answer = client.recv(65_536)
                if trickle and not answer:
                    client.sendall(b"0")
        assert statuses(answer) == [408] or (trickle and not answer)
    until(lambda: served.connections() == 0)
    assert not list(served.store.root.glob("*.csv"))
    body = b"a,b\n1,2\n"
    small = served.head(
        "POST /api/recordings?name=x.csv HTTP/1.1",
        "Connection: close",
        f"Content-Length: {len(body)}",
    )
    assert statuses(served.ask(small + body)) == [422]  # read, so there was room for it


def test_strangers_send_no_bodies(served: Served) -> None:
    for first in ("POST /api/recordings?name=x.csv HTTP/1.1", "POST /api/scenario HTTP/1.1"):
        assert statuses(served.ask(served.head(first, "Content-Length: 1000000", owner=False))) == [
            401
        ]
    stalled = served.head("POST /enter HTTP/1.1", "Content-Length: 400", owner=False)
    assert statuses(served.ask(stalled)) in ([408], [])
    assert statuses(
        served.ask(served.head("POST /enter HTTP/1.1", "Content-Length: 3000000", owner=False))
    ) == [413]


@pytest.mark.parametrize("owner", [True, False])
def test_who_does_not_read_is_cut_off(served: Served, owner: bool) -> None:
    with socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect(("127.0.0.1", served.port))
        client.sendall(served.head("GET /static/plotly.min.js HTTP/1.1", owner=owner))
        assert client.recv(10)
        until(lambda: served.connections() == 0)
    assert statuses(served.jobs()) == [200]


# Odd requests


SMUGGLED = b"GET /api/smuggled HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@pytest.mark.parametrize(
    "headers",
    [
        [f"Content-Length: {len(SMUGGLED)}", "Transfer-Encoding: chunked"],
        ["Content-Length: 0", f"Content-Length: {len(SMUGGLED)}"],
        ["Content-Length: +0"],
        ["Content-Length: -1"],
        ["Content-Length: ²"],
        ["Content-Length: 0x10"],
        ["Transfer-Encoding: xchunked"],
        ["Transfer-Encoding : chunked"],
        ["Transfer-Encoding: chunked", "Transfer-Encoding: identity"],
        ["X: a\r\n folded", "Content-Length : 5"],
        ["Host: evil.example"],
    ],
    ids=str,
)
def test_nothing_is_smuggled(served: Served, headers: list[str]) -> None:
    answer = served.ask(
        served.head("POST /api/scenario HTTP/1.1", *headers) + b"0\r\n\r\n" + SMUGGLED
    )
    (status,) = statuses(answer)
    assert status in (400, 411, 413)


@pytest.mark.parametrize(
    "request_",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET /\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\0" * 200,
        b"GET / HTTP/1.1\nHost: 127.0.0.1\nHost: evil.example\n\n",
        b"GET /api/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nX: \0\r\n\r\n",
        b"GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\n\r\n",
        b"CONNECT evil.example:443 HTTP/1.1\r\nHost: evil.example:443\r\n\r\n",
        b"A" * 300_000,
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"a" * 300_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"X: a\r\n" * 50_000 + b"\r\n",
    ],
    ids=lambda request: repr(request[:30]),
)
def test_what_is_no_request_is_refused(served: Served, request_: bytes) -> None:
    with served.connect() as client:
        try:
            client.sendall(request_)
            client.shutdown(socket.SHUT_WR)
        except OSError:  # it has heard enough
            pass
        assert statuses(everything(client)) in ([400], [403], [])
    assert statuses(served.jobs()) == [200]


@pytest.mark.parametrize(
    "path",
    [
        "/static/../api.py",
        "/static/..%2fapi.py",
        "/static/%2e%2e/%2e%2e/web/api.py",
        "/static/..%5capi.py",
        "/static//etc/passwd",
        "/static/%00",
        "//etc/passwd",
        "/static/..;/api.py",
        "/api/runs/../../etc/passwd",
        "/api/runs/0123456789abcdef/files/..%2frun.pickle",
        "/api/runs/0123456789abcdef/files/%2fetc%2fpasswd",
        "/api/runs/%2e%2e/files/lines.csv",
        "/api/jobs/..%2f..%2fetc%2fpasswd/result",
        "/api/jobs/0123456789abcdef%00/result",
        "/api/jobs/٠١٢٣٤٥٦٧٨٩٠١٢٣٤٥/result",
        "/api/runs/0123456789abcdef/series?channels=..%2f..%2fetc%2fpasswd",
        "/api/studies/0123456789abcdef/files/..%2f..%2fetc%2fpasswd",
        "/api/studies/%2e%2e/files/report.html",
    ],
)
def test_no_path_leads_out(served: Served, path: str) -> None:
    quoted = "".join(c if c.isascii() else "".join(f"%{b:02x}" for b in c.encode()) for c in path)
    answer = served.ask(served.head(f"GET {quoted} HTTP/1.1", "Connection: close"))
    assert statuses(answer)[0] in (403, 404, 422)
    assert b"import" not in answer
    assert b"root:" not in answer


@pytest.mark.parametrize(
    "name",
    [
        "../../x.csv",
        "/etc/x.csv",
        "..\\..\\x.csv",
        "C:\\x.csv",
        "\0.csv",
        "a" * 150 + ".csv",
        ".csv",
        "%2e%2e/x.csv",
    ],
)
def test_names_of_recordings_are_names_only(served: Served, name: str) -> None:
    before = sorted(served.store.root.iterdir())
    quoted = "".join(f"%{b:02x}" for b in name.encode())
    body = b"a,b\n1,2\n"
    first = f"POST /api/recordings?name={quoted} HTTP/1.1"
    answer = served.ask(
        served.head(first, "Connection: close", f"Content-Length: {len(body)}") + body
    )
    assert statuses(answer) == [422]
    assert str(served.store.root).encode() not in answer
    assert sorted(served.store.root.iterdir()) == before


@pytest.mark.parametrize(
    "name", ["../../x.csv", "/etc/x.csv", "..\\..\\x.csv", "C:\\x.csv", "\0.csv", "a" * 150, ".csv", ".."]
)  # fmt: skip
def test_names_of_tables_are_names_only(served: Served, name: str) -> None:
    """Of the tables of a budget's sources nothing is written before their names are seen."""
    before = sorted(served.store.root.iterdir())
    craft = (Path(__file__).parents[1] / "examples" / "spacecraft.yaml").read_text()
    body = json.dumps({"scenario": {"text": craft}, "tables": {name: "a,b\n1,2\n"}}).encode()
    headers = ["Content-Type: application/json", f"Content-Length: {len(body)}"]
    first = served.head("POST /api/budgets HTTP/1.1", "Connection: close", *headers)
    answer = served.ask(first + body)
    assert statuses(answer) == [422]
    assert b"the name of a table such as" in answer or b"at most" in answer
    assert str(served.store.root).encode() not in answer
    assert sorted(served.store.root.iterdir()) == before


def test_whether_an_id_exists_is_not_told_to_strangers(served: Served) -> None:
    body = json.dumps({"inertia": "8 kg*m^2", "frequency": "1 Hz"}).encode()
    typed = ["Content-Type: application/json", "Connection: close", f"Content-Length: {len(body)}"]
    id = json.loads(
        served.ask(served.head("POST /api/sas HTTP/1.1", *typed) + body).partition(b"\r\n\r\n")[2]
    )["id"]
    answers = {
        re.sub(rb"date: .*\r\n", b"", served.ask(served.head(f"{method} /api/jobs/{one} HTTP/1.1", "Connection: close", owner=False)))
        for one in (id, "0" * 16) for method in ("GET", "DELETE")
    }  # fmt: skip
    assert len(answers) == 1
    assert statuses(answers.pop()) == [401]
    assert id.encode() in served.jobs()
    served.ask(served.head(f"DELETE /api/jobs/{id} HTTP/1.1", "Connection: close"))


@pytest.mark.parametrize(
    "method", ["HEAD", "OPTIONS", "TRACE", "PUT", "PATCH", "DELETE", "PROPFIND"]
)
@pytest.mark.parametrize("path", ["/", "/enter", "/static/app.js", "/api/jobs", "/api/scenario"])
def test_other_methods(served: Served, method: str, path: str) -> None:
    answer = served.ask(served.head(f"{method} {path} HTTP/1.1", "Connection: close"))
    assert statuses(answer)[0] in (200, 404, 405)
    assert b"access-control" not in answer.lower()
    assert served.access.token.encode() not in answer


def test_a_websocket_is_not_opened(served: Served) -> None:
    upgrade = [
        "Connection: Upgrade, close",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
    ]
    assert statuses(served.ask(served.head("GET /api/jobs HTTP/1.1", *upgrade))) == [200]
    assert statuses(served.ask(served.head("GET /api/jobs HTTP/1.1", *upgrade, owner=False))) == [
        401
    ]


PART = b'--x\r\nContent-Disposition: form-data; name="file"; filename="../x.csv"\r\n\r\n1,2'


@pytest.mark.parametrize(
    ("path", "kind", "body"),
    [
        ("/api/scenario", "multipart/form-data; boundary=x", PART),
        ("/api/scenario", "multipart/form-data", PART),
        ("/api/recordings?name=x.csv", "multipart/form-data; boundary=" + "x" * 5000, PART),
        ("/api/scenario", "application/json\r\nContent-Encoding: gzip", gzip.compress(b'{"base": "state-1"}', mtime=0)),
        ("/api/scenario", "application/json\r\nContent-Encoding: gzip", gzip.compress(b"\0" * 10**7, mtime=0)),
        ("/api/recordings?name=x.csv", "text/csv\r\nContent-Encoding: gzip", gzip.compress(b"1" * 10**7, mtime=0)),
        ("/api/scenario", "application/x-www-form-urlencoded", b"a=b&" * 100_000),
        ("/api/scenario", "application/json", b'{"base": "\\ud800", "changes": {"' + b"[" * 100_000),
        ("/api/scenario", "application/json; charset=utf-16", '{"base": "state-1"}'.encode("utf-16")),
        ("/api/scenario", "application/json", b"9" * 4900),
        ("/api/scenario", "application/json", b"1e" + b"9" * 4900),
    ],
)  # fmt: skip
def test_odd_bodies(served: Served, path: str, kind: str, body: bytes) -> None:
    headers = [f"Content-Type: {kind}", "Connection: close", f"Content-Length: {len(body)}"]
    answer = served.ask(served.head(f"POST {path} HTTP/1.1", *headers) + body)
    assert statuses(answer)[0] in (400, 413, 422), answer
    assert b"Traceback" not in answer
    assert b'{"error":' in answer


def test_two_servers_know_nothing_of_each_other(served: Served) -> None:
    """A browser shows the cookies of one port to all ports of a host."""
    with serving(served.store) as other:
        for key in (served.access.key, other.access.key):
            for session, status in ((served.access.session, 200), (other.access.session, 401)):
                shown = [
                    f"Cookie: microvib-1={session}; theme={'x' * 4000}",
                    f"X-Microvib-Key: {key}",
                    "Connection: close",
                ]
                expected = status if key == served.access.key else 401
                assert statuses(
                    served.ask(served.head("GET /api/jobs HTTP/1.1", *shown, owner=False))
                ) == [expected]


def test_texts_name_files_without_their_folders() -> None:
    assert (
        without_folders("/tmp/microvib-1/ab/guide.yaml: motor: '2 kg*m^2/s'")
        == "guide.yaml: motor: '2 kg*m^2/s'"
    )
    assert (
        without_folders(r"cannot read 'C:\Users\me\x.uff' (/etc/x/y.csv)")
        == "cannot read 'x.uff' (y.csv)"
    )
    assert without_folders("5 N*m/rad/s, and/or 1/2") == "5 N*m/rad/s, and/or 1/2"


# Other users of the machine


@pytest.mark.skipif(sys.platform == "win32", reason="modes of POSIX")
def test_folders_are_their_owners_alone(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with workspace(tmp_path, "page") as folder:
            store = Store(folder, LIMITS)
            store.submit("sas", "", options={})
            opening = opening_file(folder, "http://127.0.0.1:1/", Access())
            modes = {
                path.stat().st_mode & 0o777 for path in (folder, *folder.iterdir()) if path.is_dir()
            }
            assert (modes, opening.stat().st_mode & 0o777) == ({0o700}, 0o600)
            store.close()
            store.join()
    finally:
        os.umask(before)


def python_of_nobody() -> str | None:
    """An interpreter that nobody may run."""
    for found in (
        sys.executable,
        os.path.realpath(sys.executable),
        "/usr/bin/python3",
        "/usr/local/bin/python3",
    ):
        with suppress(OSError, KeyError):
            if (
                subprocess.run(
                    [found, "-I", "-c", ""], user="nobody", extra_groups=[], check=False
                ).returncode
                == 0
            ):
                return found
    return None


NOBODY = """
import glob, os, socket, sys
from pathlib import Path
port, id, shared = int(sys.argv[1]), sys.argv[2], sys.argv[3]
library = shared + "/library"
def ask(request, *headers):
    with socket.create_connection(("127.0.0.1", port), timeout=60) as s:
        s.sendall("\\r\\n".join([request + " HTTP/1.1", f"Host: 127.0.0.1:{port}", "Connection: close", *headers, "", ""]).encode())
        return s.recv(12).split()[1].decode()
assert os.getuid() != 0
print(ask("GET /api/jobs"), ask(f"GET /api/jobs/{id}/result"), ask(f"GET /api/runs/{id}/files/lines.csv"), ask(f"DELETE /api/jobs/{id}"))
folder, = glob.glob(shared + "/.page-*")
for path in (folder, f"{folder}/open.html", library, f"{library}/entries/{id}", f"{library}/entries/{id}/result.json"):
    try:
        Path(path).is_dir() and os.listdir(path)
        Path(path).read_bytes()
        print("read", path)
    except PermissionError:
        print("refused")
seen = b"".join(Path(p).read_bytes() for p in glob.glob("/proc/[0-9]*/cmdline") if os.path.exists(p))
print(seen.replace(b"\\0", b" ").decode(errors="replace"))
"""


@pytest.mark.skipif(
    not (sys.platform == "linux" and os.getuid() == 0), reason="only root can become another user"
)
def test_another_user_of_the_machine_gets_nothing(tmp_path: Path) -> None:
    python = python_of_nobody()
    if python is None:
        pytest.skip("there is no nobody here that may run Python")
    shared = tempfile.mkdtemp()
    os.chmod(shared, 0o1777)
    browser = tmp_path / "browser"  # shows with what it is started, and stays
    browser.write_text(
        f'#!/bin/sh\necho "$@" > {tmp_path}/opened.part\nmv {tmp_path}/opened.part {tmp_path}/opened\nexec sleep 60\n'
    )
    browser.chmod(0o755)
    command = [sys.executable, "-m", "microvib", "serve", "--port", "0"]
    command += ["--library", f"{shared}/library"]
    environment = {**os.environ, "TMPDIR": shared, "BROWSER": f"{browser} %s &"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as server:
        try:
            assert server.stdout is not None
            port, token = re.search(r":(\d+)/\?token=(\S+)", server.stdout.readline()).groups()
            asked = Served(int(port), Access(token=token), None, None)  # type: ignore[arg-type]
            body = json.dumps({"inertia": "8 kg*m^2", "frequency": "1 Hz"}).encode()
            typed = [
                "Content-Type: application/json",
                "Connection: close",
                f"Content-Length: {len(body)}",
            ]
            id = json.loads(
                asked.ask(asked.head("POST /api/sas HTTP/1.1", *typed) + body).partition(
                    b"\r\n\r\n"
                )[2]
            )["id"]
            until(lambda: (tmp_path / "opened").exists())
            opened = (tmp_path / "opened").read_text()
            until(lambda: Path(shared, "library", "entries", id, "result.json").exists())
            assert opened.startswith("file://")
            program = [python, "-I", "-c", NOBODY, port, id, shared]
            found = subprocess.run(
                program,
                user="nobody",
                group="nogroup",
                extra_groups=[],
                capture_output=True,
                text=True,
                check=False,
            )
            assert found.returncode == 0, found.stderr
            said = found.stdout.splitlines()
            assert said[0] == "401 401 401 401"
            assert said[1:6] == ["refused"] * 5
            assert "microvib serve --port 0" in found.stdout  # it did see the processes
            assert token not in found.stdout + opened
            assert token not in (
                Path(f"/proc/{server.pid}/cmdline").read_text()
                + Path(f"/proc/{server.pid}/environ").read_text()
            )
            assert id.encode() in asked.jobs()
        finally:
            os.killpg(server.pid, signal.SIGKILL)
    shutil.rmtree(shared, ignore_errors=True)
