"""Which cases of a sweep run every time, and which at a release."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def at_a_release(*values: Any, **keys: Any) -> Any:
    """A case that shows once more what others of its sweep show: values as in ``pytest.param``."""
    return pytest.param(*values, marks=pytest.mark.release, **keys)


def sweep(cases: Iterable[Any], *always: Any) -> list[Any]:
    """Cases of one argument each: those named in ``always`` run every time, the others at a release."""
    every = list(cases)
    unknown = [one for one in always if one not in every]
    assert not unknown, f"no cases of the sweep: {unknown}"
    return [one if one in always else at_a_release(one) for one in every]
