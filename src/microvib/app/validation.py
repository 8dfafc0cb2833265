"""Validation from command to folder: one table, and the figures of the paper with ours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from microvib.app import plots
from microvib.app.report import picture
from microvib.app.studies import number, page
from microvib.io.results import write_folder
from microvib.studies.validate import Check, State, checks_csv

_LEAD = (
    "The paper's claims on its test states 1 to 5, beside what the catalog's scenarios give. Rows marked calibrated were fitted to"
    " the test's lines of state 1 and are no evidence; rows marked predicted were not fitted to anything; rows marked computed"
    " are arithmetic or numerics."
)


def validation_text(checks: list[Check]) -> str:
    """All checks as a table, and how many hold."""
    width = max(len(check.item) for check in checks)
    rows = [
        f"{'item':{width}s} {'paper':>9s} {'test':>9s} {'ours':>10s} {'error %':>8s}  {'holds':5s} {'status':10s} bar"
    ]
    rows += [
        f"{c.item:{width}s} {number(c.paper, 6):>9s} {number(c.test, 6):>9s} {number(c.ours, 5):>10s}"
        f" {number(c.error_percent, 3):>8s}  {'yes' if c.holds else 'NO':5s} {c.status:10s} {c.bar}"
        for c in checks
    ]
    return "\n".join([*rows, "", summary(checks)])


def summary(checks: list[Check]) -> str:
    """How many checks of each status hold."""
    parts = []
    for status in dict.fromkeys(c.status for c in checks):
        of = [c for c in checks if c.status == status]
        parts.append(f"{sum(c.holds for c in of)} of {len(of)} {status} rows hold")
    return "; ".join(parts) + "."


def write_validation(out: Path, checks: list[Check], states: dict[int, State], overwrite: bool) -> tuple[str, ...]:
    """``validation.csv`` and ``report.html``; names of the files."""
    files: dict[str, Any] = {"validation.csv": checks_csv(checks), "report.html": _report(checks, states)}
    write_folder(out, files, overwrite)
    return tuple(files)


def _report(checks: list[Check], states: dict[int, State]) -> str:
    header = ["item", "source", "paper []", "test []", "ours []", "error [%]", "bar", "holds", "status"]
    rows = [
        [c.item, c.source, number(c.paper, 6), number(c.test, 6), number(c.ours, 5), number(c.error_percent, 3), c.bar,
         "yes" if c.holds else "NO", c.status]
        for c in checks
    ]  # fmt: skip
    header = [h.replace(" []", " [ ]") for h in header]
    sections: list[dict[str, Any]] = [{"title": "All claims", "text": summary(checks), "header": header, "rows": rows}]
    for title, numbers in (("States 1, 2, 3: frequency of the mode (as Figure 11)", (1, 2, 3)),
                           ("States 1, 4, 5: inertia (as Figure 12)", (1, 4, 5))):  # fmt: skip
        figure, axes = plots.new_figure(11.0, 4.2, 1, 2)
        sides = [(f"state {k}", states[k].motion["T_d"], states[k].motion.sample_rate) for k in numbers]
        for ax, highest in zip(axes[0], (5.0, 200.0), strict=True):
            plots.draw_overlay(ax, sides, highest)
        caption = "One-sided amplitude spectra, 0-to-peak, of the records that the table is made from."
        sections.append({"title": title, "figure": picture(figure), "caption": caption})
    return page("Validation against the paper", _LEAD, sections)
