"""Errors, as sentences for the person who can fix them."""

from __future__ import annotations

import copyreg
import difflib
import os
import re
import reprlib
import sys
from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import contextmanager, suppress
from operator import index
from typing import Any


class MicrovibError(Exception):
    """Base of all errors that are meant for the user; the text is one clear sentence.

    ``remedy`` names the option that would help, where there is one; whoever asks for options says
    how it is written.
    """

    def __init__(self, text: str = "", *, remedy: str = "") -> None:
        super().__init__(text)
        self.remedy = remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as text and attributes, whatever a constructor takes: errors come back from other
        processes.
        """
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


def missing_library(error: ImportError) -> str:
    """Sentence on a library that is not installed, with the command that installs it; empty for a
    module of microvib or Python.

    The extra that brings it is the smallest one that this package declares it in.
    """
    from importlib import metadata

    name = (error.name or "").partition(".")[0]
    if not name or name == "microvib" or name in sys.stdlib_module_names:
        return ""
    try:
        declared = metadata.requires("microvib") or []
    except metadata.PackageNotFoundError:  # imported from a folder that pip knows nothing of
        declared = []
    brought: dict[str, list[str]] = {}  # by each extra
    for line in declared:
        library, _, marker = line.partition(";")
        if extra := re.search(r"extra\s*==\s*['\"]([\w-]+)", marker):
            brought.setdefault(extra[1], []).append(
                re.split(r"[^\w.-]", library)[0].lower().replace("-", "_")
            )
    extras = [extra for extra, libraries in brought.items() if name.lower() in libraries]
    if extras:
        wanted = f"microvib[{min(extras, key=lambda extra: len(brought[extra]))}]"
    else:
        wanted = "microvib"
    return f"this needs {name}, which is not installed; pip install '{wanted}'"


class OptionError(MicrovibError):
    """An option of a study that is wrong: which one, by its ``key``, perhaps its value, and what is
    allowed.
    """

    def __init__(self, key: str, problem: str, value: str = "", *, remedy: str = "") -> None:
        super().__init__(f"{f'{key} {value}'.rstrip()}: {problem}", remedy=remedy)
        self.key = key


class ScenarioError(MicrovibError):
    """A scenario that cannot be read or is not valid: says which key, what was found and what is
    allowed.
    """


class SimulationError(MicrovibError):
    """A simulation that could not be completed."""


class SynchronismLost(SimulationError):
    """The motor no longer follows its command; ``time`` [s] is when the rotor was half an
    electrical turn away from it.
    """

    def __init__(self, message: str, time: float) -> None:
        super().__init__(message)
        self.time = time


class ChannelError(MicrovibError, KeyError):
    """A channel that a motion does not have: says which, why where that is known, and which there
    are.
    """

    __str__ = Exception.__str__


class OutputError(MicrovibError):
    """A result that could not be written; nothing was overwritten."""


class ObjectError(MicrovibError, TypeError):
    """Wrong kind of object, such as its name: the message has what was given, what is expected and what makes it."""


def expect(given: Any, kinds: type | tuple[type, ...], expected: str) -> None:
    """ObjectError where what was given is of none of the ``kinds``; ``expected`` says in words what
    is, and what makes it.
    """
    if not isinstance(given, kinds):
        if isinstance(given, (str, os.PathLike)):
            what = "a name"
        else:
            what = f"of type {type(given).__name__}"
        raise ObjectError(f"{quoted_value(given)} is {what}; expected {expected}")


def expect_list(given: Any, key: str, example: str) -> None:
    """ObjectError where one thing, or text, stands in place of a list; ``example`` is one."""
    several = isinstance(given, (Sequence, Set, Iterator)) or hasattr(given, "tolist")
    if not several or isinstance(given, (str, bytes)):
        raise ObjectError(
            f"{key}: {quoted_value(given)} is not a list; one is expected, such as {example}"
        )


def expect_path(given: Any) -> None:
    """ObjectError where what was given is not the name of a file or folder."""
    if not isinstance(given, (str, os.PathLike)) or not os.fspath(given):
        raise ObjectError(
            f"{quoted_value(given)} is not the name of a file or folder; one is expected, such as"
            " 'state-1'"
        )


def expect_channel(name: Any) -> None:
    """ObjectError where what was given is not the name of a channel."""
    if not isinstance(name, str):
        raise ObjectError(
            f"{quoted_value(name)} is not the name of a channel; one is expected, such as 'T_d'"
        )


def expect_mapping(given: Any, key: str, example: str) -> None:
    """ObjectError where what was given has no keys; ``example`` is one that has."""
    if not hasattr(given, "keys"):
        raise ObjectError(
            f"{key}: {quoted_value(given)} is not a mapping; names and values are expected, such as"
            f" {example}"
        )


def whole_number(key: str, given: Any, least: int, most: int) -> int:
    """Check the value of ``key``; OptionError where it is no whole number from ``least`` to
    ``most``.
    """
    number = None
    with suppress(TypeError):  # of what is no whole number
        if isinstance(given, bool):
            number = None
        else:
            number = index(given)
    if number is None or not least <= number <= most:
        raise OptionError(
            key,
            f"{quoted_value(given)} is not allowed; a whole number from {least} to {most} is"
            " expected",
        )
    return number


class LineError(MicrovibError, KeyError):
    """A line that a table does not have: says which, and which there are."""

    __str__ = Exception.__str__


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The known name that a misspelt one probably stands for, as part of a sentence; empty if none
    is close.
    """
    names = {each.lower(): each for each in known}
    near = difflib.get_close_matches(name.lower(), list(names), 1, 0.7)
    if near:
        return f"did you mean {names[near[0]]}? "
    return ""


@contextmanager
def error_context(where: object) -> Iterator[None]:
    """Errors raised within begin, line by line, with the file or key that they are about, unless
    they name it already.
    """
    try:
        yield
    except MicrovibError as error:
        start = f"{where}: "
        lines = str(error).splitlines()
        error.args = (
            "\n".join(line if line.startswith(start) else start + line for line in lines),
        )
        raise


def quoted_value(value: Any) -> str:
    """A value as sentences quote it, of any size and kind: at most 60 characters."""
    quoting = reprlib.Repr()
    quoting.maxstring = quoting.maxother = 1000
    quoting.maxlevel = 3
    value = (
        value.item() if hasattr(value, "item") and getattr(value, "ndim", 1) == 0 else value
    )  # a number of numpy's
    try:
        if isinstance(value, (int, float)):
            text = repr(value)
        else:
            text = quoting.repr(value)
    except ValueError:  # of an integer that has too many digits to be written
        if isinstance(value, int):
            text = f"a number of {value.bit_length() * 0.30103:.0f} digits"
        else:
            text = "something"
    if "\n" in text:
        text = " ".join(text.split())
    if len(text) < 60:
        return text
    return f"{text[:57]}..."
