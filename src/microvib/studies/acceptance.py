"""Acceptance test of drives on a force table: every run analysed and judged against a limit, all of them for
repeatability, one against a reference, and the table's own hammer test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.analysis.limits import Judgement
from microvib.analysis.margins import Verdict, worst_verdict
from microvib.errors import MicrovibError
from microvib.io.recordings import Prepared
from microvib.io.sources import Source
from microvib.model.scenario import GivenScenario, as_scenario
from microvib.signals.clock import near_mains
from microvib.signals.limit_curve import Limit
from microvib.signals.line_table import NOT_THE_DRIVES
from microvib.solve.integration import Progress
from microvib.studies.analyse import Analysis, analyse
from microvib.studies.compare import Comparison, compare, lacking_within, misreads_amplitudes
from microvib.studies.hammer import HammerTest
from microvib.studies.recording_limits import judge_recording
from microvib.studies.repeatability import RecordedRun, Repeatability, repeatability


@dataclass(frozen=True, eq=False)
class JudgedRun:
    """One run: what it says, and how it stands against the limit."""

    run: RecordedRun
    analysis: Analysis
    judgement: Judgement | None

    @property
    def verdict(self) -> Verdict:
        """Against the limit; not judged without one."""
        return "not judged" if self.judgement is None else self.judgement.verdict


@dataclass(frozen=True, eq=False)
class AcceptanceTest:
    """All runs of an acceptance test."""

    runs: tuple[JudgedRun, ...]
    channel: str
    limit: Limit | None
    repeatability: Repeatability | None
    """None of a single run."""
    comparison: Comparison | None
    """The first run against the reference; None without one."""
    hammer: HammerTest | None

    @property
    def verdict(self) -> Verdict:
        """Fail where one run does; pass where all do and none is questioned beside the others; else not judged."""
        found = worst_verdict(run.verdict for run in self.runs) or "not judged"
        if found == "pass" and (self.run_warnings or self.is_misread):
            return "not judged"
        return found

    @property
    def is_misread(self) -> bool:
        """Whether the first run is in another unit or on another axis than the reference, or lacks its lines."""
        if self.comparison is None:
            return False
        return misreads_amplitudes(*self.comparison) or bool(self.lacking_in_band)

    @property
    def lacking_in_band(self) -> tuple[str, ...]:
        """Sentences on main lines of the reference, in the limit's band, of which the first run has far too
        little; empty where it has of all lines.
        """
        curve = None if self.limit is None else self.limit.loads.get(self.channel, self.limit.curve)
        if self.comparison is None or curve is None or misreads_amplitudes(*self.comparison):
            return ()
        return lacking_within(*self.comparison, curve.low, curve.high)

    @property
    def run_warnings(self) -> tuple[str, ...]:
        """Sentences without a stop on runs of which it is not known that they show what the others do."""
        beside = () if self.repeatability is None else self.repeatability.run_warnings
        return (*beside, *filter(None, map(_silence_of, self.runs)))


def _silence_of(run: JudgedRun) -> str:
    """Sentence on a run in which nothing is heard that a drive may make; empty where something is."""
    table = run.analysis.table
    if table is None:
        return ""
    heard = (x for x in table if x.seen and not near_mains(x.frequency, table.duration))
    if any(x.status not in NOT_THE_DRIVES for x in heard):
        return ""
    return (
        f"{run.run.name}: no line but the mains' stands above the noise: the drive may not have run (a scenario"
        " tells)"
    )


def _expect_different_records(runs: Sequence[RecordedRun], channel: str) -> None:
    """MicrovibError where two runs are one record: no two have the same noise, sample for sample."""
    seen: dict[bytes, str] = {}
    for run in runs:
        if not isinstance(run.source, Prepared) or channel not in run.source.recording.channels:
            continue
        samples = np.ascontiguousarray(run.source.recording[channel]).tobytes()
        if samples in seen:
            raise MicrovibError(
                f"{run.name}: channel {channel} is that of {seen[samples]}, sample for sample; give each run's own"
                " recording, once"
            )
        seen[samples] = run.name


def acceptance(  # noqa: PLR0913 - keyword options
    runs: Sequence[RecordedRun],
    *,
    scenario: GivenScenario | None = None,
    channel: str = "Mz",
    limit: Limit | None = None,
    reference: Source | None = None,
    reference_name: str = "reference",
    hammer: HammerTest | None = None,
    progress: Progress | None = None,
) -> AcceptanceTest:
    """Analyse every run of an acceptance test, judge it, and compare all of them.

    Parameters
    ----------
    runs : sequence of RecordedRun
        Recordings that were prepared, with their backgrounds; those of one unit are repetitions.
    scenario : Scenario, str or path, optional
        The drive, which names the lines.
    channel : str
        Channel of the torque about the drive axis.
    limit : Limit, optional
        Largest line that is accepted; nothing is judged without it.
    reference : Source, optional
        What the first run is compared with: a scenario, a recording, a table of lines, reference lines.
    reference_name : str
        What it is called.
    hammer : HammerTest, optional
        Hammer test of the table.
    progress : callable, optional
        Called as ``progress(done, total)``, with simulated seconds.

    Returns
    -------
    AcceptanceTest
        Runs with their verdicts, repeatability, comparison.

    Raises
    ------
    MicrovibError
        Without a run, or where one cannot be used.
    """
    if not runs:
        raise MicrovibError("no recording was given; an acceptance test needs one or more")
    _expect_different_records(runs, channel)
    guide = None if scenario is None else as_scenario(scenario)
    judged_runs = []
    for run in runs:
        found = analyse(run.source, name=run.name, scenario=guide, channel=channel)
        judgement = None
        if limit is not None:
            judgement = judge_recording(run.source, limit, channel=channel, scenario=guide)
        judged_runs.append(JudgedRun(run, found, judgement))

    compared = None
    if reference is not None:
        compared = compare(
            reference,
            runs[0].source,
            names=(reference_name, runs[0].name),
            scenario=guide,
            channel=channel,
            progress=progress,
        )
    repeated = None
    if len(runs) > 1:
        repeated = repeatability(runs, scenario=guide, channels=[channel])
    return AcceptanceTest(tuple(judged_runs), channel, limit, repeated, compared, hammer)
