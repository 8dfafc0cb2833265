"""A number type that holds WIDTH numbers: the kernel's functions, called with it, evaluate the
nodes of a step at once.

A ``Lanes`` is an LLVM vector, which LLVM splits into the registers of the machine at hand.
Arithmetic, comparisons and the functions below act on each lane separately, by the same instruction
for all: a lane's value never depends on its neighbours. The same functions take floats, so that one
source serves one state and four. Such a source does not branch on a value: it uses ``where``, and
``if some(...)`` to skip work, which floats do and lanes never do.

What numba is told of lanes is in ``microvib.solve.vector_type``.
"""

from __future__ import annotations

import math
from typing import Any

WIDTH = 4
"""Lanes."""


def whole_lanes(columns: int) -> int:
    """Numbers of a row of so many ``columns`` where it fills whole lanes."""
    return -(-columns // WIDTH) * WIDTH


def where(condition: Any, a: Any, b: Any) -> Any:
    """``a`` where the condition holds, else ``b``; both are computed."""
    return a if condition else b


def some(condition: Any) -> bool:
    """Whether work for this condition cannot be skipped: the condition itself for floats, always
    for lanes.
    """
    return bool(condition)


def rows(array: Any, first: int, size: int, columns: int) -> Any:
    """``size`` rows of an array (m, WIDTH), from row ``first`` on, as lanes; also indexed in two
    dimensions with ``columns``.
    """
    return array[first : first + size]


def sincos(x: Any) -> Any:
    """Sine and cosine."""
    return math.sin(x), math.cos(x)


def exp(x: Any) -> Any:
    """Exponential function; for lanes only where x < 700, and no smaller than exp(-700)."""
    return math.exp(x)


def picked(array: Any, index: Any) -> Any:
    """Entry of an array (n,) of numbers at a whole number, which is a float."""
    return array[int(index)]


def floor(x: float) -> float:
    """The whole number below."""
    return math.floor(x)


def nearest(x: float) -> float:
    """The nearest whole number."""
    return float(round(x))


def exponent(n: float) -> float:
    """2^n for whole n, |n| < 1000."""
    return math.ldexp(1.0, int(n))
