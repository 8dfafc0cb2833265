"""The title block of a report: who made which document, when, in which issue, and who signs it."""

from __future__ import annotations

import datetime
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError

ROLES = ("prepared", "checked", "approved")
"""Who signs where nothing else is said."""
_MAX_LENGTH = 80
_MAX_ROLES = 6


def today() -> str:
    """Today's date in UTC as in ISO 8601; SOURCE_DATE_EPOCH [s since 1970] sets another, so that a
    report repeats byte for byte.
    """
    text = os.environ.get("SOURCE_DATE_EPOCH", "").strip()
    if not text:
        return datetime.datetime.now(datetime.UTC).date().isoformat()
    try:
        return datetime.datetime.fromtimestamp(int(text), datetime.UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):
        raise MicrovibError(
            f"SOURCE_DATE_EPOCH: '{text[:40]}' is not allowed; whole seconds since 1970 are"
            " expected"
        ) from None


@dataclass(frozen=True)
class TitleBlock:
    """Identification of a document; empty entries are filled in by hand."""

    author: str = ""
    organisation: str = ""
    number: str = ""
    issue: str = "draft"
    date: str = field(default_factory=today)
    signatures: tuple[tuple[str, str], ...] = tuple((role, "") for role in ROLES)
    """Roles with names."""

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Titles and texts of the block's fields; empty ones are kept to be filled in, but for the
        organisation.
        """
        own = (("Organisation", self.organisation),) if self.organisation else ()
        rest = (
            ("Document no.", self.number),
            ("Issue", self.issue),
            ("Date", self.date),
            ("Author", self.author),
        )
        return own + rest


KEYS = tuple(f.name for f in fields(TitleBlock))


def read_title_block(path: Path) -> TitleBlock:
    """The title block that a YAML file describes; MicrovibError with the key and what is allowed."""
    from microvib.io.named import read_text
    from microvib.io.yaml_text import parse_yaml

    data = parse_yaml(read_text(path, "report data", ()), str(path))
    if data is None:
        return TitleBlock()
    if not isinstance(data, dict):
        raise MicrovibError(
            f"{path}: is not report data; lines such as 'author: A. Engineer' are expected"
        )
    unknown = [key for key in data if key not in KEYS]
    if unknown:
        allowed = ", ".join(KEYS)
        raise MicrovibError(
            f"{path}: '{_shown(unknown[0])}' is not a key of report data; allowed are {allowed}"
        )
    texts = {key: _text(path, key, value) for key, value in data.items() if key != "signatures"}
    if "signatures" in data:
        signatures = _signatures(path, data["signatures"])
    else:
        signatures = TitleBlock.signatures
    return TitleBlock(**texts, signatures=signatures)


def _text(path: Path, key: str, value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool | list | dict) or len(str(value)) > _MAX_LENGTH:
        allowed = f"a text of at most {_MAX_LENGTH} characters is"
        raise MicrovibError(f"{path}: {key}: '{_shown(value)}' is not allowed; {allowed}")
    return " ".join(str(value).split())


def _signatures(path: Path, value: Any) -> tuple[tuple[str, str], ...]:
    names = isinstance(value, list) and all(isinstance(role, str) for role in value)
    if isinstance(value, Mapping):
        roles = value
    elif names:
        roles = dict.fromkeys(value)
    else:
        roles = {}
    if not 1 <= len(roles) <= _MAX_ROLES:
        raise MicrovibError(
            f"{path}: signatures: '{_shown(value)}' is not allowed; 1 to {_MAX_ROLES} roles with"
            " names are, such as"
            " {prepared: A. Engineer, approved: B. Head}"
        )
    at = "signatures"
    return tuple(
        (_text(path, at, role), _text(path, f"{at}.{role}", name)) for role, name in roles.items()
    )


def _shown(value: Any) -> str:
    text = str(value)
    if len(text) <= 60:
        return text
    return text[:57] + "..."
