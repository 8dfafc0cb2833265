"""Members of envelopes as routes name them to workers."""

from __future__ import annotations

from typing import NamedTuple

from microvib.web.jobs.campaigns import CAMPAIGN
from microvib.web.jobs.study_files import TABLES

FOLDERS = {"rates": TABLES, "angles": TABLES, "campaign": CAMPAIGN}
"""Folders, in that of its job, of what a kind of study has for an envelope."""


class PageMember(NamedTuple):
    """A member: its kind, the folder of its job or the file of a recording, and what its owner calls it."""

    kind: str
    path: str
    name: str
