"""YAML text as plain data, within bounds that are checked while it is read."""

from __future__ import annotations

from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import CollectionEndEvent, CollectionStartEvent
from ruamel.yaml.parser import Parser

from microvib.errors import ScenarioError

MAX_DEPTH = 100  # levels of lists and mappings in each other, at most
MAX_ENTRIES = 60_000
"""Keys and values of a file, at most: twice what 2000 modes with six participations need, read in
some 2 s.
"""


class _Bounded(Parser):
    """Reads no more than the bounds; what only hides values, or multiplies them, is refused."""

    def __init__(self, loader: Any) -> None:
        super().__init__(loader)
        self._depth = self._entries = 0

    def get_event(self) -> Any:
        event = super().get_event()
        self._entries += 1
        if self._entries > MAX_ENTRIES:
            raise ValueError(f"it has more than {MAX_ENTRIES} keys and values")
        if isinstance(event, CollectionStartEvent):
            self._depth += 1
        elif isinstance(event, CollectionEndEvent):
            self._depth -= 1
        if self._depth > MAX_DEPTH:
            raise ValueError("it is nested too deeply")
        if getattr(event, "anchor", None):
            raise ValueError("anchors and aliases (&, *) are not used; write values out")
        if getattr(event, "tag", None):
            raise ValueError(f"tags ({str(event.tag)[:60]}) are not used; write the value alone")
        return event


def parse_yaml(text: str, origin: str) -> Any:
    """YAML 1.2 data of a file's text; ScenarioError if it is not one, has anchors or tags, or goes
    beyond the bounds.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.Parser = _Bounded
    try:
        return yaml.load(text.removeprefix("\ufeff"))
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        if mark:
            where = f", line {mark.line + 1}, column {mark.column + 1}"
        else:
            where = ""
        reason = (
            getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
        )
        raise ScenarioError(f"{origin}{where}: is not valid YAML: {reason}") from None
    except (RecursionError, ValueError, TypeError) as error:
        raise ScenarioError(f"{origin}: is not valid YAML: {str(error)[:200]}") from None
