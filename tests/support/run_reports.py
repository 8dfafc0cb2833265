"""A run as text and as a report."""

from __future__ import annotations

from microvib.analysis.limits import Limit
from microvib.analysis.run import RunResult
from microvib.reports.document import Document
from microvib.reports.outcome import report, terminal_text
from microvib.reports.run.outcome import run_outcome
from microvib.signals.line_table import LineTable
from microvib.solve.motion import Motion


def run_text(result: RunResult, limit: Limit | None = None) -> str:
    """What a terminal shows of a run."""
    return terminal_text(run_outcome(result, limit))


def run_report(motion: Motion, lines: LineTable, *, limit: Limit | None = None) -> Document:
    """The report of a motion and its lines."""
    return report(run_outcome(RunResult.of_motion(motion, lines), limit))
