"""Names of the release before on public classes, which warn and go with the next release."""

from __future__ import annotations

from typing import Any
from warnings import warn


class FormerName:
    """An attribute under its former name; using it gives a FutureWarning.

    Parameters
    ----------
    new : str
        Name of the attribute now.
    """

    def __init__(self, new: str) -> None:
        self._new, self._old = new, ""

    def __set_name__(self, owner: type, name: str) -> None:
        self._old = f"{owner.__name__}.{name}"

    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        text = f"{self._old} is called {self._new}; the old name goes with the next release"
        warn(text, FutureWarning, stacklevel=2)
        return getattr(instance, self._new)
