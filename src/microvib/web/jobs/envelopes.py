"""Envelopes of the page: runs, studies and recordings of the store as members, under the names that their
owner gave them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError
from microvib.io.recordings import Prepared
from microvib.model.scenario import Scenario
from microvib.reports.envelope import envelope_outcome
from microvib.signals.limit_curve import Limit
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import merge
from microvib.studies.envelope.members import LINES, NamedMember
from microvib.studies.envelope.study import envelope as find_envelope
from microvib.web.jobs import ProgressCallback
from microvib.web.jobs.kept_runs import kept_run
from microvib.web.jobs.page_members import FOLDERS, PageMember
from microvib.web.jobs.recording_tasks import recorded
from microvib.web.jobs.study_files import keep_study


def envelope(  # noqa: PLR0913 - what a process is sent
    folder: str,
    members: Sequence[PageMember],
    channels: Sequence[str],
    statistics: Sequence[str],
    limit: Limit | None,
    bandwidth: str,
    resolution: str,
    scenario: Scenario | None,
    tell: ProgressCallback,
) -> None:
    """An envelope over members, and its verdict against a limit."""
    found = find_envelope(
        [_named(one) for one in members], channels=channels, statistics=statistics, limit=limit,
        bandwidth=bandwidth, resolution=resolution, scenario=scenario,
        progress=lambda done, total: tell(done, total, "members", "reading"),
    )  # fmt: skip
    tell(0, None, "", "drawing")
    keep_study(Path(folder), envelope_outcome(found))


def _named(one: PageMember) -> NamedMember:
    """The member as an envelope takes it; MicrovibError where nothing of it was kept."""
    path = Path(one.path)
    given: Any
    if one.kind == "recording":
        return NamedMember(one.name, Prepared(recorded((one.path, one.name))), (path,))
    if one.kind == "run":
        files = tuple(path / name for name in ("scenario.yaml", LINES))
        return NamedMember(one.name, kept_run(path), files)
    given = path / FOLDERS[one.kind]
    if not given.is_dir():
        raise MicrovibError(f"{one.name}: has no tables of its lines here; make it again")
    if one.kind == "campaign":
        merge(open_campaign(given))  # with what was computed before it was stopped
    return NamedMember(one.name, given)
