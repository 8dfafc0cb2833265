"""Where the command line meets its surroundings: standard streams, interrupts, and errors that
become sentences and a status.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from microvib.errors import MicrovibError, OptionError, missing_library
from microvib.text_tables import columns, set_columns, wrapped

FAILED, BUG, INTERRUPTED = 1, 70, 128 + signal.SIGINT
CLOSED_PIPE = 128 + 13  # as the shell counts a program that SIGPIPE ended
TRACEBACK = "MICROVIB_TRACEBACK"  # environment variable that asks for the traceback of a bug


def status_of(command: Callable[[], Any]) -> int:
    """Run a command to its exit status; whatever ends it is said in sentences on standard error."""
    with _streams():
        set_columns(max(_columns(sys.stdout), 20) if sys.stdout.isatty() else None)
        try:
            status = command() or 0
            sys.stdout.flush()
        except BaseException as error:
            status = _report_error(error)
        return int(status)


def _report_error(error: BaseException) -> int:
    """Say in sentences what ended a command, and return its status."""
    match error:
        case SystemExit():
            return _exit_status(error)
        case KeyboardInterrupt() | click.Abort():
            if isinstance(error, click.Abort) and sys.stderr.isatty():
                click.echo(err=True)  # behind the prompt that was left
            return _say("Interrupted; no file was left half-written.", INTERRUPTED)
        case click.BadParameter() if not isinstance(error, click.MissingParameter):
            sentence = " ".join(error.format_message().split())
            return _say(f"Error: {sentence}")
        case click.ClickException():
            error.show()
            return error.exit_code
        case StdoutWriteError() if isinstance(error.args[0], BrokenPipeError):
            return CLOSED_PIPE  # who reads has enough: nothing is wrong
        case MicrovibError():
            return _say("\n".join(f"Error: {line}" for line in _error_text(error).splitlines()))
    if sentence := _sentence(error):
        return _say(f"Error: {sentence}")
    return _bug_report(error)


def _exit_status(error: SystemExit) -> int:
    if isinstance(error.code, int):
        return error.code
    return FAILED if error.code else 0


def _sentence(error: BaseException) -> str:
    """Sentence on a fault of the machine that a user can repair; empty for anything else."""
    match error:
        case ModuleNotFoundError():
            return missing_library(error)
        case MemoryError():
            return "out of memory; shorten record.duration or run fewer cases at a time"
        case StdoutWriteError():
            cause = error.args[0]
            return f"standard output cannot be written: {cause.strerror or cause}"
        case OSError() if error.filename is not None:
            return f"{error.filename}: {error.strerror or error}"
    return ""


def _error_text(error: MicrovibError) -> str:
    """The sentences of an error; options are written as they are typed."""
    text = str(error)
    if isinstance(error, OptionError) and text.startswith(error.key):  # else a file comes first
        text = f"--{error.key.replace('_', '-')}{text.removeprefix(error.key)}"
    if error.remedy:
        return f"{text} (--{error.remedy.replace('_', '-')})"
    return text


def _bug_report(error: BaseException) -> int:
    """Report an unforeseen exception as a bug in microvib, not in the input."""
    if os.environ.get(TRACEBACK):
        _say("".join(traceback.format_exception(error)).rstrip())
    what = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return _say(
        f"Error: a bug in microvib, not in your input ({what}); please report it to its developers,"
        " with the command, its"
        f" files, and what it prints when {TRACEBACK}=1 is set",
        BUG,
    )


def _say(text: str, status: int = FAILED) -> int:
    echo(text, err=True)
    return status


def echo(text: str, err: bool = False) -> None:
    """Print; where a terminal is narrower than a line, the line is broken between words and not
    inside figures.
    """
    stream = sys.stderr if err else sys.stdout
    if stream.isatty():
        width = max(columns() or _columns(stream), 20)
        text = "\n".join(part for line in text.split("\n") for part in _wrap(line, width))
    click.echo(text, err=err)


def _wrap(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    return wrapped(line, width, indent=4)


def _columns(stream: Any) -> int:
    try:
        return (
            os.get_terminal_size(stream.fileno()).columns or 80
        )  # 0: a terminal that does not tell
    except (OSError, ValueError):
        return 80


class StdoutWriteError(Exception):
    """Standard output does not take what is written to it. Not an OSError, which libraries on the
    way would answer.
    """


class _Output(io.FileIO):
    def write(self, data: Any) -> Any:
        try:
            return super().write(data)
        except OSError as error:
            os.dup2(
                _null(), self.fileno()
            )  # what is left goes nowhere, and the interpreter's end is quiet
            raise StdoutWriteError(error) from None


class _Messages(io.FileIO):
    def write(self, data: Any) -> Any:
        try:
            return super().write(data)
        except OSError:  # nobody listens: the work goes on, and the status tells
            return memoryview(data).nbytes


def _null() -> int:
    return os.open(os.devnull, os.O_RDWR)


@contextmanager
def _streams() -> Iterator[None]:
    """Standard streams that are there, whatever the caller closed, and that tell their own failures
    from those of files.
    """
    before = {name: getattr(sys, name) for name in ("stdin", "stdout", "stderr")}
    for name, mode, kind in (
        ("stdin", "r", None),
        ("stdout", "w", _Output),
        ("stderr", "w", _Messages),
    ):
        if before[name] is None:  # its number must not go to the next file that is opened
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
            os.set_inheritable(getattr(sys, name).fileno(), True)
        elif kind is not None:
            setattr(sys, name, _wrap_stream(before[name], kind))
    try:
        yield
    finally:
        for name, stream in before.items():
            setattr(sys, name, stream or getattr(sys, name))


def _wrap_stream(stream: Any, kind: type[io.FileIO]) -> Any:
    """Stream over a file of another kind; unchanged if it is not that of a file."""
    buffer = getattr(stream, "buffer", None)
    if not isinstance(getattr(buffer, "raw", buffer), io.FileIO):
        return stream
    stream.flush()
    raw = io.BufferedWriter(kind(stream.fileno(), "w", closefd=False))
    # What a terminal or a file of another encoding cannot hold is a question mark there, and no
    # error.
    if stream.errors == "strict":
        errors = "replace"
    else:
        errors = stream.errors
    return io.TextIOWrapper(raw, stream.encoding, errors, line_buffering=True)
