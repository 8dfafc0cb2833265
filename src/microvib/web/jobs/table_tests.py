"""Tasks of workers about force tables and acceptance: a hammer test, a report from a template. Recordings are
those of the page, and no other file is opened.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from microvib.errors import MicrovibError
from microvib.io.sources import Source
from microvib.model.scenario import Scenario
from microvib.reports.acceptance import acceptance_contents, acceptance_outcome, words_of
from microvib.reports.hammer import hammer_outcome
from microvib.signals.limit_curve import Limit
from microvib.studies.acceptance import acceptance as run_acceptance
from microvib.studies.hammer import HammerTest, Hits, hammer_test
from microvib.studies.repeatability import RecordedRun
from microvib.web.jobs import ProgressCallback
from microvib.web.jobs.processing import Blows, Preparing, RecordedFile
from microvib.web.jobs.recording_tasks import preparation, prepared, recorded
from microvib.web.jobs.study_files import keep_study

TEMPLATE = "template"
"""Name of a template in messages."""


def hammer(folder: str, blows: Blows, tell: ProgressCallback) -> None:
    """A hammer test of a force table: responses with coherence, resonances, blows left out."""
    tell(0, None, "", "finding the blows")
    keep_study(Path(folder), hammer_outcome(_hammer_test(blows)))


def _hammer_test(blows: Blows) -> HammerTest:
    read = [Hits(load, recorded(file), arm) for load, arm, file in blows.hits]
    return hammer_test(
        read,
        blows.impact,
        mounted_mass=blows.mounted_mass,
        block=blows.block,
        estimator=blows.estimator,
    )


def acceptance(  # noqa: PLR0913 - what a process is sent
    folder: str,
    runs: Sequence[tuple[RecordedFile, str]],
    channel: str,
    scenario: Scenario | None,
    limit: Limit | None,
    reference: Scenario | RecordedFile | None,
    blows: Blows | None,
    preparing: Preparing | None,
    template: str,
    words: str,
    tell: ProgressCallback,
) -> None:
    """An acceptance report of several recordings, of the text of a ``template`` and ``words`` (YAML)."""
    data = words_of(words, "data") if words.strip() else {}
    how = preparation(folder, preparing)
    second: Source | None = None
    name = ""
    if isinstance(reference, Scenario):
        second, name = reference, reference.title or "scenario"
    elif reference is not None:
        second, name = prepared(reference, how), reference[1]
    tell(0, None, "", "finding the lines of all recordings")
    test = run_acceptance(
        [RecordedRun(file[1], prepared(file, how), unit) for file, unit in runs],
        scenario=scenario,
        channel=channel,
        limit=limit,
        reference=second,
        reference_name=name,
        hammer=None if blows is None else _hammer_test(blows),
        progress=lambda done, total: tell(done, total, "s", "simulating the reference"),
    )
    tell(0, None, "", "writing the report")
    try:
        _, document = acceptance_contents(test, template, TEMPLATE, data)
    except (RecursionError, MemoryError):
        raise MicrovibError(
            f"{TEMPLATE}: takes too much memory, or calls itself without an end"
        ) from None
    keep_study(Path(folder), acceptance_outcome(test), document)
