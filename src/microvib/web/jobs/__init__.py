"""Computations of the page: their store, their processes, their tasks."""

from collections.abc import Callable

ProgressCallback = Callable[[float, float | None, str, str], None]
"""Tells how far a task is: done, total (None where it is not known), unit, text."""
