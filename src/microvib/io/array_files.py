"""Arrays of which a scenario names the file, or the description, that their modes come from."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from microvib.errors import ScenarioError, error_context, quoted_value
from microvib.io.file_access import FileAccess
from microvib.io.named import reference_names
from microvib.model.part import to_plain_data
from microvib.units import convert

if TYPE_CHECKING:
    from microvib.structures.modal import ModalModel

ARRAY_ORIGINS = ("from", "fem")
"""Keys of ``array`` that name where its modes come from, instead of the modes themselves: a table,
a description.
"""


def with_array(data: dict[str, Any], files: FileAccess, origin: str) -> dict[str, Any]:
    """Scenario data with ``array: {from: FILE}`` or ``array: {fem: DESCRIPTION}`` replaced by the
    modes of that source.

    Names are those of ``files`` or of the catalog. ``modes: N`` keeps the first N modes,
    ``damping`` replaces their damping ratios; beside results of a finite-element program stand the
    keys of ``Import``. Raises ScenarioError or ModalError.
    """
    group = data.get("array")
    if not isinstance(group, dict) or not any(key in group for key in ARRAY_ORIGINS):
        return data
    with error_context(origin):
        model, source = _modes_of(group, files)
        given = data.get("sources") or {}
        if not isinstance(given, dict):
            raise ScenarioError(
                f"sources: {given!r} is not allowed; keys are expected here: text to text"
            )
    sources = {key: text for key, text in given.items() if not str(key).startswith("array.")} | {
        "array": source
    }
    if model.notes:
        sources["array.inertia"] = " ".join([f"{source}.", *model.notes])  # once, not at each mode
    return {**data, "array": to_plain_data(model.array(), text=True), "sources": sources}


def _modes_of(group: dict[str, Any], files: FileAccess) -> tuple[ModalModel, str]:
    """Modal model that ``array.from`` or ``array.fem`` names, and what to say of its source."""
    from microvib.io.modal_sources import DEFAULT_MODES, DESCRIPTIONS, TABLES, modal_source
    from microvib.io.modal_table import MAX_MODES

    key, *others = [key for key in group if key in ARRAY_ORIGINS]
    files, name = files.under(f"array.{key}"), group[key]
    if name not in reference_names():
        files.path(name, reference_names())
    if key == "from" and not others and Path(name).suffix.lower() not in (*TABLES, *DESCRIPTIONS):
        from microvib.io.nastran import read_modal_model
        from microvib.structures.deck import import_options

        said = {option: value for option, value in group.items() if option not in ARRAY_ORIGINS}
        return read_modal_model(files.path(name), import_options(said, "array")), name
    unknown = [*others, *(key for key in group if key not in (*ARRAY_ORIGINS, "modes", "damping"))]
    if unknown:
        raise ScenarioError(
            f"array.{unknown[0]}: does not go with array.{key}, which supplies the modes; "
            "allowed with it are modes (their number) and damping"
        )
    if key == "from":
        model = modal_source(name, files=files).model
        return _damped(model.first(_count(group, model.frequency.size)), group), name
    count = _count({"modes": DEFAULT_MODES, **group}, MAX_MODES)
    model = modal_source(name, max(count, 1), files).model
    return _damped(model.first(count), group), f"finite elements of {name}, {count} modes"


def _count(group: dict[str, Any], available: int) -> int:
    count = group.get("modes", available)
    if not isinstance(count, int) or isinstance(count, bool) or not 0 <= count <= available:
        raise ScenarioError(
            f"array.modes: {count!r} is not allowed; a whole number from 0 to {available} is"
            " expected"
        )
    return count


def _damped(model: ModalModel, group: dict[str, Any]) -> ModalModel:
    if "damping" not in group:
        return model
    return replace(
        model,
        damping=np.full(model.frequency.size, damping_ratio("array.damping", group["damping"])),
    )


def damping_ratio(key: str, given: Any) -> float:
    """A damping ratio as a user wrote it beside the name of a file; ScenarioError where it is none."""
    try:
        if isinstance(given, str):
            xi = convert(given, "")
        else:
            xi = float(given)
    except (TypeError, ValueError):
        xi = math.nan
    if not 0.0 <= xi <= 0.99:
        raise ScenarioError(
            f"{key}: {quoted_value(given)} is not allowed; a damping ratio from 0 to 99 percent is"
            " expected"
        )
    return xi
