"""A command in a pseudo-terminal, and what then stands on the screen."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

MICROVIB = (sys.executable, "-m", "microvib")
CTRL_C = b"\x03"
_PART = re.compile(r"\x1b\[([?\d;]*)([A-Za-z])|\x1b.|[\r\n\b]|[^\x1b\r\n\b]+")


class Shown(NamedTuple):
    """How a command ended and what it wrote to the terminal."""

    status: int
    raw: str
    columns: int

    @property
    def screen(self) -> list[str]:
        return screen(self.raw, self.columns)

    @property
    def text(self) -> str:
        return "\n".join(self.screen)


def screen(raw: str, columns: int) -> list[str]:
    """Lines of a terminal, those that scrolled away too, after what was written to it; empty ones
    at the end are left out.
    """
    lines, row, column = [""], 0, 0
    for part in _PART.finditer(raw):
        text, (count, command) = part[0], part.groups()
        number = int(count) if (count or "").isdigit() else 1
        if command == "A":
            row = max(row - number, 0)
        elif command == "K":
            lines[row] = "" if count == "2" else lines[row][:column]
        elif text == "\r":
            column = 0
        elif text == "\b":
            column = max(column - 1, 0)
        elif text == "\n":
            row += 1
        elif not text.startswith("\x1b"):
            for letter in text:
                if column >= columns:
                    row, column = row + 1, 0
                lines += [""] * (row + 1 - len(lines))
                lines[row] = lines[row][:column].ljust(column) + letter + lines[row][column + 1 :]
                column += 1
        lines += [""] * (row + 1 - len(lines))
    while lines and not lines[-1].strip():
        lines.pop()
    return lines


def in_terminal(
    *arguments: str,
    cwd: Path,
    program: Sequence[str] = MICROVIB,
    columns: int = 100,
    environment: Mapping[str, str] | None = None,
    until: Callable[[str], bool] | None = None,
    typed: Sequence[str] = (),
    seconds: float = 240.0,
) -> Shown:
    """Run ``microvib``, or another program, in a terminal of its own; as soon as ``until`` is true
    of what it wrote, press Ctrl-C.

    ``typed`` are lines that somebody types ahead.
    """
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    env = {
        "TERM": "xterm-256color",
        **{k: v for k, v in os.environ.items() if k not in ("TERM", "COLUMNS", "NO_COLOR")},
    }
    process = subprocess.Popen(
        [*program, *arguments], cwd=cwd, stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
        env=env | dict(environment or {}), preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )  # fmt: skip
    os.close(slave)
    os.write(master, "".join(f"{line}\n" for line in typed).encode())
    written, last = b"", time.monotonic() + seconds
    try:
        while time.monotonic() < last:
            if select.select([master], [], [], 0.05)[0]:
                try:
                    written += os.read(master, 65536)
                except OSError:  # the last one closed it
                    break
            if until is not None and until(written.decode(errors="replace")):
                os.write(master, CTRL_C)
                until = None
        return Shown(process.wait(max(last - time.monotonic(), 0.1)), written.decode(), columns)
    finally:
        process.kill()
        process.wait()
        os.close(master)
