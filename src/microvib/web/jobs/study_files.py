"""Files of a study in the folder of its job: the page's answer, its reports, its tables."""

from __future__ import annotations

from pathlib import Path

from microvib.io.tables import to_json
from microvib.reports import rendering
from microvib.reports.document import Document
from microvib.reports.outcome import Outcome, page_answer, report, text_files

TABLES = "tables"
"""Folder of a study's tables in that of its job, as its command writes them into a folder."""


def keep_tables(folder: Path, outcome: Outcome) -> None:
    """Leave the tables of a study for envelopes."""
    (folder / TABLES).mkdir()
    for name, text in text_files(outcome).items():
        (folder / TABLES / name).write_text(text, encoding="utf-8")


def keep_study(folder: Path, outcome: Outcome, document: Document | None = None) -> None:
    """Leave ``result.json``, with the tables as files, ``report.html``, and ``report.pdf`` where the
    library that makes it is installed; the report is the ``document`` where one is given.
    """
    if document is None:
        document = report(outcome)
    reports = ["report.html"]
    (folder / "report.html").write_text(rendering.html(document), encoding="utf-8")
    try:
        (folder / "report.pdf").write_bytes(rendering.pdf(document))
        reports.append("report.pdf")
    except ModuleNotFoundError:  # an installation without the extra `report`
        pass
    answer = page_answer(outcome, pictures=True)
    whole = answer | {"files": text_files(outcome), "reports": reports}
    (folder / "result.json").write_text(to_json(whole), encoding="utf-8")
