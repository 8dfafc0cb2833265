"""The entry point: ``identify(scenario, evidence, keys)``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.errors import MicrovibError, OptionError, expect
from microvib.io.recordings import Prepared
from microvib.io.tables import PaperLines
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.studies.evidence import Evidence, Simulated, evidence_of
from microvib.studies.identify.figures import cost
from microvib.studies.identify.goodness import Deviation, Goodness, deviations, goodness
from microvib.studies.identify.intervals import Interval, profiles
from microvib.studies.identify.keys import FitKey, parse_fit
from microvib.studies.identify.problem import FitProgress, Problem, Trust
from microvib.studies.identify.search import Local, Optimum, confirm, local_at, material, search
from microvib.studies.identify.verdict import (
    SETTLE,
    Estimate,
    Findings,
    Leaning,
    correlations,
    estimates,
    leanings,
    rival,
)
from microvib.testdata.recording import Recording

MODEL_ERROR = 0.004
"""Limit on the relative accuracy of any amplitude, from model and instrument chain: filters, steps, window."""


@dataclass(frozen=True)
class Fit:
    """Result of an identification."""

    estimates: tuple[Estimate, ...]
    correlation: np.ndarray
    sensitivities: dict[str, tuple[float, ...]]
    """Relative change of each observed figure for a relative change of each parameter (d ln figure / d ln parameter)."""
    before: tuple[tuple[Evidence, Simulated], ...]
    after: tuple[tuple[Evidence, Simulated], ...]
    scenario: Scenario
    cost: float
    observations: int
    simulations: int
    seed: int
    interrupted: bool
    goodness: Goodness
    deviations: tuple[Deviation, ...]
    """All figures, with those of the fitted model."""
    leanings: tuple[Leaning, ...]
    """Parameters not fitted that move the estimates, strongest first."""
    converged: bool
    """Whether a second, finer search found nothing better."""
    notes: tuple[str, ...] = ()
    """What was done to the evidence, in words."""

    @property
    def usable(self) -> bool:
        """Whether the model explains the data and the search converged: the least that is required before results are adopted."""
        return self.goodness.explained and self.converged and not self.interrupted


Tells = Evidence | Recording | Prepared | LineTable | PaperLines
Test = Tells | tuple[Tells, dict[str, object]]


def identify(
    scenario: Scenario,
    evidence: Sequence[Test],
    keys: Sequence[FitKey | str],
    *,
    seed: int = 1,
    starts: int = 96,
    finishes: int = 3,
    model_error: float = MODEL_ERROR,
    common_error: float = 0.0,
    progress: FitProgress | None = None,
) -> Fit:
    """Fit ``keys`` of ``scenario`` to all the evidence at once.

    Evidence is a recording, a table of lines or what ``evidence_of`` or ``chosen`` made of one; in a pair it comes with the changes
    of the scenario that make its test (another state, another rate). Keys are as ``parse_fit`` takes them. ``model_error`` is
    the relative standard deviation that each amplitude is trusted to beyond its own uncertainty, ``common_error`` that of all
    amplitudes of a recording together. Interrupting (Ctrl-C) ends the search and returns what was best so far. Same seed, same
    result.

    A range that the user did not state is widened until the best lies inside. Where the fit does not explain the evidence
    and an array mode's frequency was measured, its clamped frequency is fitted as well, and the verdict says so.
    """
    expect(scenario, Scenario, "a scenario (mv.load_scenario)")
    fitted = [parse_fit(scenario, key) if isinstance(key, str) else key for key in keys]
    told = [_told(one, scenario) for one in evidence]
    _check(told, fitted)
    tests, notes = _without_the_start(told, fitted)
    problem = Problem(scenario, tests, fitted, Trust(model_error, common_error), progress)
    if not problem.figures:
        raise MicrovibError("the evidence has no observation above its floor")
    found = _Found(problem)
    interrupted = False
    try:
        found.find(seed, starts, finishes)
    except KeyboardInterrupt:
        interrupted = True
    return found.fit(scenario, seed, interrupted, notes)


def _told(test: Test, scenario: Scenario) -> tuple[Evidence, dict[str, object]]:
    """The evidence of a test, and the changes that make it."""
    told, changes = test if isinstance(test, tuple) else (test, {})
    if isinstance(told, Evidence):
        return told, changes
    expect(
        told,
        (Recording, LineTable, Prepared, PaperLines),
        "a recording, a table of lines or evidence of one (mv.open_source)",
    )
    return evidence_of(told, scenario.with_(changes) if changes else scenario), changes


def _check(evidence: Sequence[tuple[Evidence, dict[str, object]]], keys: Sequence[FitKey]) -> None:
    """Refuse a key that is fitted twice, or that a test sets."""
    twice = [name for name, count in Counter(key.key for key in keys).items() if count > 1]
    if twice:
        raise OptionError("fit", "is named twice; name each key once", twice[0])
    for one, changes in evidence:
        for key in keys:
            if key.key in changes:
                raise OptionError("fit", f"the test {one.name} sets it itself; fit it or set it", key.key)


def _without_the_start(
    evidence: Sequence[tuple[Evidence, dict[str, object]]], keys: Sequence[FitKey]
) -> tuple[list[tuple[Evidence, dict[str, object]]], tuple[str, ...]]:
    """The evidence without amplitudes of ringing modes: they depend on how long ago the start was, which nobody measured.

    Of a mode whose decay was measured, that tells the damping. Where the settling time is fitted, its amplitude counts.
    """
    tests, notes = [], []
    for one, changes in evidence:
        ringing = (
            {o.line for o in one.observations if o.form == "decay"} if SETTLE not in {k.key for k in keys} else set()
        )
        kept = tuple(o for o in one.observations if not (o.line in ringing and o.form in ("amplitude", "nearest_bin")))
        tests.append((replace(one, observations=kept), changes))
        notes += [
            f"{one.name}: the amplitude of {line} is not used, since it depends on the time since the start; its decay is"
            for line in sorted(ringing)
        ]
    return tests, tuple(notes)


class _Found:
    """What has been found so far; an interrupted search leaves what it has."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.best: Optimum | None = None
        self.local: Local | None = None
        self.intervals: tuple[Interval, ...] | None = None
        self.leanings: tuple[Leaning, ...] = ()
        self.rival: Optimum | None = None
        self.converged = False

    def find(self, seed: int, starts: int, finishes: int) -> None:
        """Search, second search and, if the model explains the evidence, intervals."""
        self.problem, optima = search(self.problem, seed, starts, finishes)
        self.best = optima[0]
        self.best, self.local, self.converged = confirm(self.problem, self.best)
        self.problem = self.problem.within(self.best.x)
        if self.converged and goodness(self.problem, self.best.r).explained:
            self._intervals()
        self.rival = rival(self.problem, self.best, optima, self.local)
        if self.intervals is not None:
            self.leanings = leanings(self.problem, self.best, self.local)

    def _intervals(self) -> None:
        """Intervals; where their profiles meet something better, from there again."""
        assert self.best is not None
        assert self.local is not None
        for _ in range(2):
            found = profiles(self.problem, self.best, self.local)
            if self.best.cost - found.best.cost < material(self.best.cost):
                self.intervals = found.intervals
                return
            self.best, self.local, self.converged = confirm(self.problem, found.best)
        self.converged = False

    def fit(self, scenario: Scenario, seed: int, interrupted: bool, notes: tuple[str, ...]) -> Fit:
        """Everything as a result."""
        if self.best is None:
            self.problem, x, r = self.problem.so_far()
            self.best = Optimum(x, r, cost(r))
        problem, best = self.problem, self.best
        local = self.local or local_at(problem, best)
        findings = Findings(problem, best, local, self.intervals, self.leanings, self.converged, self.rival)
        found = estimates(findings)
        names = [one.name for one, _ in problem.tests]
        sources = dict(scenario.sources) | {e.key: source(e, ", ".join(names)) for e in found}
        before, after = problem.simulated([{}, problem.changes(best.x)])
        assert after is not None
        tests = [one for one, _ in problem.tests]
        fit = goodness(problem, best.r)
        return Fit(
            found, correlations(local), _sensitivities(findings),
            tuple(zip(tests, before or after, strict=True)), tuple(zip(tests, after, strict=True)),
            scenario.with_si(problem.changes(best.x)).with_sources(sources), fit.chi_square, problem.figures,
            problem.simulations, seed, interrupted, fit, deviations(problem, best.x), self.leanings, self.converged, notes,
        )  # fmt: skip


def source(e: Estimate, names: str) -> str:
    """What a fitted value's source says: identified only where it is."""
    value = f"{e.estimate:.6g} {e.unit}".rstrip()
    if not e.identifiable:
        return f"assumed: fitted to {names}, {e.verdict}: {value}"
    return f"identified from {names}: {e.estimate:.6g} ± {e.standard_error:.2g} {e.unit}".rstrip()


def _sensitivities(findings: Findings) -> dict[str, tuple[float, ...]]:
    problem = findings.problem
    values = [float(v) for v in problem.changes(findings.best.x).values()]  # type: ignore[arg-type]
    scale = np.array([v / key.slope(v) for key, v in zip(problem.keys, values, strict=True)])
    rows = findings.local.J[: problem.figures] * problem.weights[:, None] * scale[None, :]
    several = len(problem.tests) > 1
    names = [f"{o.line} {o.form}" + (f" [{problem.tests[k][0].name}]" if several else "") for k, o in problem.observed]
    return {name: tuple(row) for name, row in zip(names, rows, strict=True)}
