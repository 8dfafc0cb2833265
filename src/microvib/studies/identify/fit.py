"""The entry point: ``identify(scenario, evidence, keys)``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.errors import MicrovibError, OptionError, expect, expect_list
from microvib.former_names import FormerName
from microvib.io.recordings import Prepared
from microvib.io.sources import ReferenceLines
from microvib.model.line_names import LineName
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.line_table import LineTable
from microvib.studies.evidence import Evidence, Observation, Simulated, evidence_of, require_lines
from microvib.studies.identify import verdict, whole
from microvib.studies.identify.equivalent import equivalents
from microvib.studies.identify.goodness import (
    Deviation,
    Goodness,
    deviations,
    goodness,
    required_model_error,
)
from microvib.studies.identify.hints import model_deficiency_hints
from microvib.studies.identify.intervals import profiles
from microvib.studies.identify.keys import FitKey, IntegerKey, parse_key
from microvib.studies.identify.lacking import unmodelled_effects
from microvib.studies.identify.misread import diagnose_units_signs
from microvib.studies.identify.problem import (
    BestSoFar,
    ErrorModel,
    FitProgress,
    Problem,
    TestOverrides,
    as_tested,
    cost,
    with_overrides,
)
from microvib.studies.identify.scattered import is_noisy, noisy_objective
from microvib.studies.identify.search import (
    Optimum,
    confirm,
    confirm_scaled,
    eased,
    least_misfit,
    linearise_at,
    search,
    significant_gain,
)
from microvib.studies.identify.selection import (
    EFFECTS,
    Candidate,
    Selector,
    effects_of,
    with_effects,
)
from microvib.studies.identify.verdict import (
    SETTLE_KEY,
    Dependence,
    Estimate,
    Findings,
    correlations,
)
from microvib.testdata.recording import Recording
from microvib.units import GivenQuantity, quantity

CHAIN_WIDTH = "2 Hz"
"""Distance of frequencies over which a measuring chain's gain error stays nearly the same."""
MODEL_ERROR = 0.004
"""Limit on the relative accuracy of any amplitude, from model and instrument chain: filters, steps,
window.
"""


IN_TIME = "runs in time"
STEADY_THEN_IN_TIME = "steady states for the search, runs in time at its end and for intervals"
STEADY = "steady states, confirmed by runs in time and corrected to them"
"""Kind of the simulations, in words."""


@dataclass(frozen=True)
class Fit:
    """Result of an identification."""

    estimates: tuple[Estimate, ...]
    correlation: np.ndarray
    sensitivities: dict[str, tuple[float, ...]]
    """Relative change of each observed figure for a relative change of each parameter (d ln figure
    / d ln parameter).
    """
    before: tuple[tuple[Evidence, Simulated], ...]
    after: tuple[tuple[Evidence, Simulated], ...]
    scenarios: tuple[Scenario, ...]
    """With what was fitted: one, or one for each recording where some values are its own."""
    cost: float
    observations: int
    simulations: int
    seed: int
    interrupted: bool
    goodness: Goodness
    deviations: tuple[Deviation, ...]
    """All figures, with those of the fitted model."""
    dependences: tuple[Dependence, ...]
    """Parameters not fitted that move the estimates, strongest first."""
    leanings = FormerName("dependences")
    converged: bool
    """Whether a second, finer search found nothing better."""
    alternatives: tuple[dict[str, float], ...] = ()
    """Other values of all fitted keys that explain the evidence as well, in SI units."""
    method: str = IN_TIME
    """Whether runs in time were compared with the evidence, or steady states in their place."""
    notes: tuple[str, ...] = ()
    """Notes on the preparation of the evidence."""
    selection: tuple[Candidate, ...] = ()
    """Candidate effects, with whether the evidence supports them."""
    whole: tuple[Estimate, ...] = ()
    """Whole numbers, each of which was tried; between the ends of their intervals are those that
    explain the evidence as well.
    """

    def __repr__(self) -> str:
        found = ", ".join(f"{e.key} {e.estimate:.6g}" for e in self.parameters)
        return f"Fit of {self.observations} observations, {'usable' if self.usable else 'not usable'}: {found}"

    @property
    def scenario(self) -> Scenario:
        """With what was fitted; that of the first recording, where some values are its own."""
        return self.scenarios[0]

    @property
    def parameters(self) -> tuple[Estimate, ...]:
        """All that was fitted."""
        return (*self.estimates, *self.whole)

    @property
    def usable(self) -> bool:
        """Whether anything is identified: the least that is required before results are adopted."""
        sure = any(e.identifiable for e in self.parameters)
        return sure and self.goodness.explained and self.converged and not self.interrupted

    @property
    def sentence(self) -> str:
        """Leading sentence: how good the fit is, and whether it identifies anything."""
        if not self.goodness.explained or any(e.identifiable for e in self.parameters):
            return self.goodness.sentence
        verdicts = (e.verdict.removesuffix(verdict.ADDED_FREQUENCY_NOTE) for e in self.parameters)
        reasons = list(dict.fromkeys(one.removeprefix("not identifiable") for one in verdicts))
        why = reasons[0] if len(reasons) == 1 else ""
        value = (
            f"chi-square {self.goodness.ratio:.3g} per degree of freedom, {self.goodness.counted}"
        )
        return (
            f"Nothing is identified{why}. Agreement of the model with the data ({value}) does "
            "not validate it: other values or other models agree as well."
        )


EvidenceSource = Evidence | Recording | Prepared | LineTable | ReferenceLines
EvidenceWithOverrides = EvidenceSource | tuple[EvidenceSource, TestOverrides]


def identify(  # noqa: PLR0913 - keyword options
    scenario: GivenScenario,
    evidence: Sequence[EvidenceWithOverrides],
    keys: Sequence[FitKey | IntegerKey | str],
    *,
    share: Sequence[str] | None = None,
    select: Sequence[str] = (),
    seed: int = 1,
    starts: int = 96,
    finishes: int = 3,
    model_error: float = MODEL_ERROR,
    common_error: float = 0.0,
    chain_error: float = 0.0,
    chain_width: GivenQuantity = CHAIN_WIDTH,
    settle_error: GivenQuantity | None = None,
    progress: FitProgress | None = None,
) -> Fit:
    """Fit parameters of a scenario to all the evidence at once.

    Interrupting (Ctrl-C) ends the search and returns what was best so far. Same seed, same result.
    A range that the user did not state is widened until the best lies inside. Where the fit does
    not explain the evidence and an array mode's frequency was measured, its clamped frequency is
    fitted as well, and the verdict says so.

    Parameters
    ----------
    scenario : Scenario, str or path
        The model: a scenario, a name of the catalog, or the path of a scenario file.
    evidence : sequence
        Recordings, tables of lines, or what ``evidence_of`` or ``chosen`` made of one; in a pair
        with the changes of the scenario that make its test (another state, another rate), or with
        its own scenario.
    keys : sequence of str
        Dotted keys that are fitted, as ``parse_key`` takes them, such as ``"reducer.stiffness"`` or
        ``"reducer.stiffness=4000:6000 N*m/rad"``. Of a whole number, one in all recordings, each
        that may be is tried.
    share : sequence of str, optional
        Keys that have one value in all recordings, others one in each; without it all are shared.
    select : sequence of str
        Effects (``selection.EFFECTS``) of which those are taken in, and fitted, that the evidence
        asks for.
    seed : int
        Seed of the search.
    starts, finishes : int
        Points at which the search begins, and best ones that are followed to the end.
    model_error : float
        Relative standard deviation that each amplitude is trusted to beyond its own uncertainty.
    common_error : float
        The same of all amplitudes of a recording together.
    chain_error : float
        The same of the gain of the measuring chain at a frequency, which is one for all recordings.
    chain_width : str or Si
        Distance of frequencies, such as ``"2 Hz"``, over which the chain's error stays nearly the
        same: at this distance the correlation is 0.6, at twice as much 0.14.
    settle_error : str or Si, optional
        Standard deviation of ``record.settle``, such as ``"50 ms"``. Without it nobody knows in
        which quarter of the electrical turn a recording begins, and the driver's errors are known
        up to such quarters only (``Fit.alternatives``).
    progress : callable, optional
        Called as ``progress(stage, count, cost, values)``.

    Returns
    -------
    Fit
        Estimates with their intervals, how well they explain the evidence, and what the evidence
        cannot tell.

    Raises
    ------
    MicrovibError
        For a key that cannot be fitted, evidence that cannot be used, or an effect that is not
        known.
    """
    scenario = as_scenario(scenario)
    for name, given, example in (
        ("evidence", evidence, "[recording]"),
        ("keys", keys, "['reducer.stiffness']"),
        ("share", share or (), "['reducer.stiffness']"),
        ("select", select, "['friction.presliding']"),
    ):
        expect_list(given, name, example)
    effects = effects_of(select)
    every = with_effects(scenario, effects, effects)
    told = [_as_evidence(one, every) for one in evidence]
    fitted, wholes = _keys_by_recording(every, told, keys, share)
    _check_not_selected([*(key.key for key in fitted), *(key.key for key in wholes)], effects)
    trust = ErrorModel(
        model_error,
        common_error,
        _settle_uncertainty(settle_error),
        chain_error,
        quantity("chain_width", chain_width, "Hz", positive=True),
    )
    tests, notes = without_start_dependence(told, scenario, fitted, trust)
    notes = (*_craft_warnings(tests, scenario), *notes)
    asked: tuple[Candidate, ...] = ()
    if progress is not None:
        progress("global", 0, math.inf, {})
    if effects or wholes:
        selector = Selector(scenario, tests, fitted, effects, trust, seed, starts, progress, wholes)
        scenario, tests, fitted, asked = selector.run()
        wholes += [its for one in asked if one.selected and (its := EFFECTS[one.effect].whole)]
    problem = Problem(scenario, tests, fitted, trust, BestSoFar(progress))
    require_lines([one for one, _ in tests])
    found, interrupted = _last_stage(_with_integer_stages(problem, wholes, seed, starts, finishes))
    return replace(
        _fit(found or _best_so_far(problem), wholes, seed, interrupted, notes), selection=asked
    )


def _check_not_selected(keys: Sequence[str], effects: Sequence[str]) -> None:
    """Refuse a key that is fitted, and with an effect in question."""
    for key in keys:
        if any(key in (name, *EFFECTS[name].keys) for name in effects):
            raise OptionError(
                "select", "is fitted, so it is no candidate; name it in one place", key
            )


def _settle_uncertainty(given: GivenQuantity | None) -> float:
    """Standard uncertainty of the settling time [s]; infinite where none is given."""
    if given is None:
        return math.inf
    return quantity("settle_error", given, "s", positive=True)


def _last_stage(stages: Iterator[Findings]) -> tuple[Findings | None, bool]:
    """Findings of the last stage, and whether an interrupt ended the stages; None where it came
    within the first.
    """
    found = None
    try:
        for stage in stages:
            found = stage
    except KeyboardInterrupt:
        return found, True
    return found, False


def _best_so_far(problem: Problem) -> Findings:
    """The best point of a search that was interrupted, in the whole records; KeyboardInterrupt
    again where it has met none.
    """
    if problem.best_so_far.best is None:
        raise KeyboardInterrupt
    problem, x, r = problem.best_so_far.best
    posed = (problem.whole or problem).with_cartesian(False)
    if posed is not problem:
        problem, x = posed, posed.point(problem.named(x))
        r = problem.residuals([x])[0]
    return Findings(problem, Optimum(x, r, cost(r)))


def _as_evidence(test: EvidenceWithOverrides, scenario: Scenario) -> tuple[Evidence, TestOverrides]:
    if isinstance(test, tuple):
        told, own = test
    else:
        told, own = (test, {})
    if isinstance(told, Evidence):
        return told, own
    kinds = Recording, LineTable, Prepared, ReferenceLines
    expect(told, kinds, "a recording, a table of lines or evidence of one (mv.open_source)")
    return evidence_of(told, with_overrides(scenario, own)), own


def _keys_by_recording(
    scenario: Scenario,
    evidence: Sequence[tuple[Evidence, TestOverrides]],
    keys: Sequence[FitKey | IntegerKey | str],
    share: Sequence[str] | None,
) -> tuple[list[FitKey], list[IntegerKey]]:
    """The keys, those that are not shared once for each recording; refuses one that is fitted
    twice, or that a test sets.
    """
    fitted = [parse_key(scenario, key) if isinstance(key, str) else key for key in keys]
    names = [key.key for key in fitted]
    shared = _shared_keys(names, share)
    found: list[FitKey] = []
    for key, asked in zip(fitted, keys, strict=True):
        if names.count(key.key) > 1:
            raise OptionError("fit", "is named twice; name each key once", key.key)
        if key.key in shared or len(evidence) == 1:
            for one, own in evidence:
                _check_can_be_fitted(key.key, one, own)
            if isinstance(key, FitKey):
                found.append(key)
        elif isinstance(key, IntegerKey):
            raise OptionError(
                "share",
                "is an integer with one value in all recordings; name it as well",
                key.key,
            )
        else:
            found += _once_for_each(key, asked, evidence, scenario)
    wholes = [key for key in fitted if isinstance(key, IntegerKey)]
    if not found:
        raise OptionError("fit", "is an integer; fit a continuous parameter with it", names[0])
    return found, wholes


def _shared_keys(names: Sequence[str], share: Sequence[str] | None) -> set[str]:
    """Keys that have one value in all recordings: all, where none are named."""
    if share is None:
        return set(names)
    for name in set(share) - set(names):
        raise OptionError("share", "is not fitted; name it among the keys to fit, too", name)
    return set(share)


def _once_for_each(
    key: FitKey,
    asked: FitKey | IntegerKey | str,
    evidence: Sequence[tuple[Evidence, TestOverrides]],
    scenario: Scenario,
) -> Iterator[FitKey]:
    """A key that has a value of its own in each recording, as its test changes the scenario."""
    for test, (one, own) in enumerate(evidence):
        _check_can_be_fitted(key.key, one, own)
        alone: FitKey | IntegerKey = key
        if isinstance(asked, str):
            alone = parse_key(with_overrides(scenario, own), asked)
        assert isinstance(alone, FitKey)
        yield replace(alone, test=test, recording=_recording_name(evidence, test))


def _check_can_be_fitted(key: str, evidence: Evidence, own: TestOverrides) -> None:
    """Refuse a key that a test sets itself, or that its own scenario does not have."""
    if not isinstance(own, Scenario):
        if key in own:
            raise OptionError(
                "fit", f"the test {evidence.name} sets it itself; fit it or set it", key
            )
    elif key not in {name for name, _, _ in own.entries()}:
        raise OptionError("fit", f"the scenario of {evidence.name} does not have it", key)


def _recording_name(evidence: Sequence[tuple[Evidence, TestOverrides]], test: int) -> str:
    """Name of a recording, with its number where several have the name."""
    names = [one.name for one, _ in evidence]
    if names.count(names[test]) > 1:
        return f"{names[test]} {test + 1}"
    return names[test]


def _craft_warnings(
    tests: Sequence[tuple[Evidence, TestOverrides]], scenario: Scenario
) -> Iterator[str]:
    """Warnings on evidence that is compared with lines of a spacecraft; MicrovibError where
    two drives make them.
    """
    for one, own in tests:
        tested = as_tested(scenario, one, own)
        if tested.driven_wing is not None:
            raise MicrovibError(
                f"{one.name}: spacecraft.second_wing.drive: driven is not supported by "
                "identification, which simulates one drive; hold it "
                f"({one.name}@spacecraft.second_wing.drive=held), or leave the spacecraft out"
                f" ({one.name}@spacecraft=null)"
            )
        if tested.spacecraft is not None:
            yield (
                f"{one.name}: compared with the drive on its spacecraft. For a recording of a "
                f"force table, whose base is fixed, give {one.name}@spacecraft=null."
            )


def without_start_dependence(
    evidence: Sequence[tuple[Evidence, TestOverrides]],
    scenario: Scenario,
    keys: Sequence[FitKey],
    trust: ErrorModel,
) -> tuple[list[tuple[Evidence, TestOverrides]], tuple[str, ...]]:
    """The evidence without what depends on how long ago the start was, as far as nobody measured
    that.

    Of a mode whose decay was measured, that tells the damping; its amplitude counts where the
    settling time is fitted. Turns of the electrical period count, as accurately as the settling
    time is known, where its error is stated.
    """
    fitted, known = SETTLE_KEY in {key.key for key in keys}, trust.settle < math.inf
    if fitted and known:
        raise OptionError("settle_error", f"{SETTLE_KEY} is fitted; fit it or state its error")
    tests, notes = [], []
    for one, own in evidence:
        ringing: set[str] = set()
        if not fitted:
            ringing = {o.line for o in one.observations if o.form == "decay"}
        clock = as_tested(scenario, one, own).driving_frequency or 0.0
        kept = [
            _with_settle_uncertainty(o, scenario, clock, trust) if o.form == "turn" else o
            for o in one.observations
            if _counts_without_start(o, ringing, known)
        ]
        tests.append((replace(one, observations=tuple(kept)), own))
        notes += [
            f"{one.name}: the amplitude of {line} is not used, since it depends on the time since"
            " the start; its decay is used."
            for line in sorted(ringing)
        ]
    return tests, tuple(notes)


def _counts_without_start(o: Observation, ringing: set[str], settle_known: bool) -> bool:
    """Whether a figure counts: turns where the settling time is known, no amplitude of what
    rings.
    """
    if o.form == "turn":
        return settle_known
    return o.line not in ringing or o.form not in ("amplitude", "nearest_bin")


def _with_settle_uncertainty(
    o: Observation, scenario: Scenario, clock: float, trust: ErrorModel
) -> Observation:
    """A turn as uncertain as the settling time makes it, for microsteps at ``clock`` [Hz]."""
    order = LineName.parse(o.line).order
    turn = scenario.driver.beats * scenario.driver.microsteps
    return replace(
        o, uncertainty=math.hypot(o.uncertainty, math.tau * order * clock / turn * trust.settle)
    )


def _with_integer_stages(
    problem: Problem, wholes: Sequence[IntegerKey], seed: int, starts: int, finishes: int
) -> Iterator[Findings]:
    """Findings after each stage, at last with whole numbers; where another is better, from
    there again.
    """
    for _ in range(2):
        for found in _stages(problem, seed, starts, finishes):
            yield found
        if not goodness(found.problem, found.best.r).explained:
            yield replace(found, misread=diagnose_units_signs(problem))
        if not wholes or verdict.not_identifiable_reason(found):
            return
        tried, better = whole.try_integers(found, wholes)
        if better is None:
            yield replace(found, whole=tried)
            return
        problem = better
    yield replace(found, converged=False)


def _stages(problem: Problem, seed: int, starts: int, finishes: int) -> Iterator[Findings]:
    """Findings after the search, after a second one and, if the model explains the evidence,
    with intervals.
    """
    problem, optima = search(problem, seed, starts, finishes)
    yield Findings(problem, optima[0])
    explained = goodness(problem, optima[0].r).explained
    if not explained:
        problem, optima = least_misfit(problem, optima, seed)
        problem = problem.within(optima[0].x)
        explained = goodness(problem, optima[0].r).explained
        yield Findings(problem, optima[0])
    # errors that are stated too small make jumps of what is small beside the misfit
    if explained:
        posed, there = (problem, optima[0])
    else:
        posed, there = eased(problem, optima[0])
    local = linearise_at(posed, there)
    if is_noisy(posed, there, local):
        found = noisy_objective(problem, optima)
        yield replace(
            found,
            lacking=unmodelled_effects(found.problem, found.best, found.local, simulated=False),
        )
        return
    if explained:
        best, local, converged = confirm(problem, optima[0], local)
    else:
        best, local, converged = confirm_scaled(problem, optima[0])
    found = Findings(problem.within(best.x), best, local, converged)
    yield found
    if converged and goodness(found.problem, best.r).explained:
        for better in _with_intervals(found):
            yield (found := better)
    found = replace(
        found,
        alternatives=verdict.alternative_optima(found.problem, found.best, optima, found.local),
    )
    yield found
    if found.intervals is not None:
        found = replace(
            found,
            lacking=unmodelled_effects(found.problem, found.best, found.local),
            alike=equivalents(found.problem, found.best, found.local),
        )
        yield replace(
            found, dependences=verdict.dependences(found.problem, found.best, found.local)
        )


def _with_intervals(found: Findings) -> Iterator[Findings]:
    """Intervals; where their profiles meet something better, from there again."""
    for _ in range(2):
        met = profiles(found.problem, found.best, found.local)
        if found.best.cost - met.best.cost < significant_gain(found.best.cost):
            yield replace(found, intervals=met.intervals)
            return
        best, local, converged = confirm(
            found.problem, met.best, linearise_at(found.problem, met.best)
        )
        found = replace(found, best=best, confirmed=local, converged=converged)
        yield found
    yield replace(found, converged=False)


def _fit(
    found: Findings,
    wholes: Sequence[IntegerKey],
    seed: int,
    interrupted: bool,
    notes: tuple[str, ...],
) -> Fit:
    problem, best = found.problem, found.best
    of_each = tuple(verdict.estimate(found, k) for k in range(best.x.size))
    whole_numbers = tuple(whole.estimate(found, key) for key in wholes)
    tests = [one for one, _ in problem.tests]
    names = ", ".join(one.name for one in tests)
    before, after = problem.simulated([[{}] * len(tests)])[0], problem.lines(best.x)
    assert after is not None
    fit, off = goodness(problem, best.r), deviations(problem, best.x)
    notes = (
        *_notes_before(found, tests),
        *notes,
        *model_deficiency_hints(problem.tests, after, off),
        *filter(None, [found.note]),
    )
    return Fit(
        of_each, correlations(found.local), _sensitivities(found),
        tuple(zip(tests, before or after, strict=True)), tuple(zip(tests, after, strict=True)),
        _fitted(found, of_each, whole_numbers, names), fit.chi_square, problem.figures,
        problem.best_so_far.simulations, seed, interrupted, fit, off, found.dependences, found.converged,
        tuple(problem.named(o.x) for o in found.alternatives), method=_method(found),
        notes=notes, whole=whole_numbers,
    )  # fmt: skip


def _method(found: Findings) -> str:
    """Kind of simulations that were compared with the evidence, in words."""
    if found.confirmed is not None and found.confirmed.steady is not None:
        return STEADY
    if found.problem.best_so_far.steady:
        return STEADY_THEN_IN_TIME
    return IN_TIME


def _notes_before(found: Findings, tests: Sequence[Evidence]) -> tuple[str, ...]:
    """Reasons to question the evidence, or else the model error that would explain it."""
    warnings = tuple(f"{one.name}: {text}." for one in tests for text in one.warnings)
    if warnings or found.misread:
        return (*warnings, *found.misread)
    return tuple(required_model_error(found.problem, found.best.r))


def _fitted(
    found: Findings, of_each: Sequence[Estimate], wholes: Sequence[Estimate], names: str
) -> tuple[Scenario, ...]:
    """Scenarios with what was fitted: the one that all have, or one for each recording, where some
    values are its own.
    """
    problem, said = found.problem, {e.key: source_text(e, e.recording or names) for e in of_each}
    also = {e.key: source_text(e, names) for e in wholes}
    alike = all(key.test is None for key in problem.keys)
    if alike:
        each = [problem.scenario]
    else:
        each = [with_overrides(problem.scenario, own) for _, own in problem.evidence]
    return tuple(
        one.with_si(dict(problem.changes(found.best.x, j))).with_sources(
            dict(one.sources)
            | {key: said[label] for key, label in problem.labels(j).items()}
            | also
        )
        for j, one in enumerate(each)
    )


def source_text(e: Estimate, names: str) -> str:
    """Source text of a fitted value: identified only where it is."""
    value = f"{e.estimate:.6g} {e.unit}".rstrip()
    if not e.identifiable:
        return f"assumed: fitted to {names}, {e.verdict}: {value}"
    if math.isfinite(e.standard_error):
        error = f" ± {e.standard_error:.2g}"
    else:
        error = ""
    return f"identified from {names}: {e.estimate:.6g}{error} {e.unit}".rstrip()


def _sensitivities(findings: Findings) -> dict[str, tuple[float, ...]]:
    problem = findings.problem
    values = problem.values(findings.best.x)
    scale = np.array(
        [key.relative_to(v) / key.slope(v) for key, v in zip(problem.keys, values, strict=True)]
    )
    rows = findings.local.J[: problem.figures] * problem.weights[:, None] * scale[None, :]
    several = len(problem.tests) > 1
    names = [
        f"{o.line} {o.form}" + (f" [{problem.tests[k][0].name}]" if several else "")
        for k, o in problem.observed
    ]
    return dict(zip(names, map(tuple, rows), strict=True))
