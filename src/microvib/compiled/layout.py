"""How arguments and results of compiled functions lie in memory: in words of eight bytes, one after
the other.

A compiled function takes the address of its arguments' words and of its result's, which is the same
on every machine. A number is a word, a complex number two, a tuple its fields. An array among the
arguments is the address of numpy's own record of it (place of the data, count of dimensions, place
of these), which is where numpy's binary interface has it, behind what begins every object: to ask
Python for the data takes ten times as long. An array in a result is its owner, its data and its
shape.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np

Vector = Annotated[np.ndarray, np.float64, 1]
Matrix = Annotated[np.ndarray, np.float64, 2]
Cube = Annotated[np.ndarray, np.float64, 3]
Counts = Annotated[np.ndarray, np.int64, 1]
CountMatrix = Annotated[np.ndarray, np.int64, 2]
Complexes = Annotated[np.ndarray, np.complex128, 1]


DTYPES = {name: np.dtype(name) for name in ("float64", "int64", "complex128")}
Deliver = Callable[[int, int, int, int], None]
"""Copies the data of a result to a new array's, and gives the result's memory back: owner, data,
record, bytes.
"""
HEAD = object.__basicsize__
"""Bytes that begin every object."""


def sound() -> bool:
    """Whether this interpreter has arrays where they are expected."""
    array = np.zeros(3)
    return ctypes.c_void_p.from_address(id(array) + HEAD).value == array.ctypes.data


def place(array: np.ndarray, dtype: np.dtype[Any], ndim: int) -> int:
    """The word of an array, if it is such a one."""
    if array.dtype != dtype or array.ndim != ndim or not array.flags.c_contiguous:
        raise TypeError(
            f"an array of {array.ndim} dimensions of {array.dtype} where a contiguous one of {ndim}"
            f" of {dtype} is expected"
        )
    return id(array) + HEAD


@dataclass(frozen=True)
class Number:
    """A float, an int (of 64 bits) or a bool."""

    type: type
    code: str

    def words(self, value: str) -> list[str]:
        """Expressions for the words of a value, itself an expression."""
        return [value]

    def read(self, words: Iterator[Any], deliver: Deliver) -> Any:
        """The value whose words come next."""
        return next(words)


@dataclass(frozen=True)
class Complex:
    """A complex number."""

    code: str = "dd"

    def words(self, value: str) -> list[str]:
        """Expressions for the words of a value, itself an expression."""
        return [f"{value}.real", f"{value}.imag"]

    def read(self, words: Iterator[Any], deliver: Deliver) -> complex:
        """The value whose words come next."""
        return complex(next(words), next(words))


@dataclass(frozen=True)
class Array:
    """A contiguous array."""

    dtype: np.dtype[Any]
    ndim: int
    result: bool = False

    @property
    def code(self) -> str:
        """Format of the words, as of ``struct``."""
        if self.result:
            return "q" * (2 + self.ndim)
        return "q"

    def words(self, value: str) -> list[str]:
        """Expressions for the words of a value, itself an expression."""
        return [f"place({value}, {self.dtype.name}, {self.ndim})"]

    def read(self, words: Iterator[Any], deliver: Deliver) -> np.ndarray:
        """A copy of the array whose words come next."""
        owner, data = next(words), next(words)
        array = np.empty([next(words) for _ in range(self.ndim)], self.dtype)
        deliver(owner, data, id(array) + HEAD, array.nbytes)
        return array


@dataclass(frozen=True)
class Record:
    """A tuple, of a class with named fields or of none."""

    type: Any
    fields: tuple[Any, ...]

    @property
    def code(self) -> str:
        """Format of the words, as of ``struct``."""
        return "".join(field.code for field in self.fields)

    def words(self, value: str) -> list[str]:
        """Expressions for the words of a value, itself an expression."""
        return [
            word for k, field in enumerate(self.fields) for word in field.words(f"{value}[{k}]")
        ]

    def read(self, words: Iterator[Any], deliver: Deliver) -> tuple[Any, ...]:
        """The tuple whose words come next."""
        return tuple(field.read(words, deliver) for field in self.fields)


NUMBERS = {
    float: Number(float, "d"),
    int: Number(int, "q"),
    bool: Number(bool, "?7x"),
    complex: Complex(),
}


def kind(hint: Any, result: bool = False) -> Any:
    """Layout of what is annotated so; None for nothing. Arrays of a ``result`` come otherwise."""
    if hint in (None, type(None)):
        return None
    if get_origin(hint) is Annotated:
        _, dtype, ndim = get_args(hint)
        return Array(np.dtype(dtype), ndim, result)
    if get_origin(hint) is tuple:
        return Record(None, tuple(kind(part, result) for part in get_args(hint)))
    if hint in NUMBERS:
        return NUMBERS[hint]
    return Record(
        hint, tuple(kind(part) for part in get_type_hints(hint, include_extras=True).values())
    )


class Signature:
    """Arguments and result of a function, as its annotations say."""

    def __init__(self, python: Callable[..., Any]) -> None:
        hints = get_type_hints(python, include_extras=True)
        self.result = kind(hints.pop("return"), result=True)
        self.arguments = Record(None, tuple(kind(hint) for hint in hints.values()))

    def caller(self, address: int, deliver: int) -> Callable[..., Any]:
        """The compiled function at ``address``; ``deliver`` is the address of what brings a
        result's arrays.
        """
        function = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_char_p, ctypes.c_void_p)(address)
        bring = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4)(deliver)
        # An expression made once: a call takes microseconds, which walking through the layouts
        # would multiply.
        names = {
            "place": place,
            "pack": struct.Struct("=" + self.arguments.code).pack,
            "function": function,
            **DTYPES,
        }
        run = eval(
            "lambda arguments, into:"
            f" function(pack({', '.join(self.arguments.words('arguments'))}), into)",
            names,
        )
        result = self.result
        words = struct.Struct("=" + (result.code if result else ""))
        room = ctypes.c_char * words.size

        def call(*arguments: Any) -> Any:
            into = room()
            if run(arguments, into):
                raise MemoryError("no memory for a compiled function's arrays")
            if result:
                return result.read(iter(words.unpack(into)), bring)
            return None

        return call
