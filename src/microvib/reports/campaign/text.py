"""How far a campaign is; one of its cases, computed again."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path

from microvib.io.scenario_file import dump_scenario
from microvib.io.writing import write_file
from microvib.reports.campaign.report import MAX_REASONS, reason_without_values
from microvib.studies.campaign.cases import FIGURES, Chunk, compute
from microvib.studies.campaign.folder import Campaign
from microvib.studies.campaign.slurm import job_state


def state_text(campaign: Campaign, reasons: bool = False) -> str:
    """How far a campaign is: cases done, failed, missing, and with ``reasons`` why cases failed."""
    computed, why = 0, Counter[str]()
    examples: dict[str, int] = {}
    for cases, chunk in campaign.results():
        computed += len(cases)
        for case, reason in zip(cases, chunk.reasons, strict=True):
            if reason:
                kind = reason_without_values(reason)
                why[kind] += 1
                examples.setdefault(kind, case)
    total = campaign.design.cases
    lines = [f"{computed} of {total} cases computed, {why.total()} of them failed"]
    if computed < total:
        lines[0] += (
            f"; {total - computed} to do: microvib campaign resume"
            f" {shlex.quote(str(campaign.folder))}"
        )
    if queued := job_state(campaign):
        lines.append(f"Slurm: {queued}")
    if reasons:
        lines += [
            f"  {count} x {kind} (case {examples[kind]})"
            for kind, count in why.most_common(MAX_REASONS)
        ]
    return "\n".join(lines)


def recomputed_case_text(campaign: Campaign, case: int) -> str:
    """A case computed alone, its lines, and whether they are the very numbers that are kept."""
    chunk = case // campaign.chunk_size
    alone = compute(campaign.work(chunk, [case]))
    lines = [
        f"Case {case}: "
        + "; ".join(f"{key} {text}" for key, text in campaign.design.labels(case).items())
    ]
    if alone.reasons[0]:
        lines.append(f"Failed: {alone.reasons[0]}")
    for k, name in enumerate(alone.lines):
        amplitude, frequency = alone.figures["amplitude"][0, k], alone.figures["frequency"][0, k]
        lines.append(f"{name:16s} {frequency:12.5f} Hz {amplitude:12.6e} N m")
    if not campaign.file(chunk).is_file():
        return "\n".join([*lines, "It is not computed in the campaign yet."])
    kept, place = campaign.read(chunk), case % campaign.chunk_size
    differing = [
        name for name in alone.lines if _figures(alone, 0, name) != _figures(kept, place, name)
    ]
    if alone.reasons[0] != kept.reasons[place] and not differing:
        differing += ["its reason"]
    else:
        differing += []
    same = "Identical to the campaign, to the last bit."
    lines.append(f"Differs from the campaign in {', '.join(differing)}." if differing else same)
    return "\n".join(lines)


def _figures(chunk: Chunk, k: int, line: str) -> bytes:
    """All that is kept of a line of the k-th case, as bytes; none where the chunk has no such line."""
    if line in chunk.lines:
        at = chunk.lines.index(line)
    else:
        at = None
    if at is None:
        return b""
    return b"".join(chunk.figures[name][k, at].tobytes() for name in FIGURES)


def write_case(campaign: Campaign, case: int, path: Path) -> None:
    """Write a case's scenario to a new file; OutputError where there is one already."""
    write_file(path, dump_scenario(campaign.design.scenario(case)))
