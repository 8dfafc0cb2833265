"""The cost of an identification: weighted differences between measured and simulated figures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from threading import Lock, current_thread, main_thread
from typing import TypeVar

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.expected import expected_lines
from microvib.model.line_names import ARRAY_MODE, LineName
from microvib.model.scenario import Scenario
from microvib.solve.steady.state import SteadyState
from microvib.studies.evidence import Evidence, Observation, Simulated, predicted
from microvib.studies.identify.cases import Case, has_steady_states
from microvib.studies.identify.coordinates import Coordinates
from microvib.studies.identify.keys import (
    FREQUENCY_RANGE_FACTOR,
    MAX_WIDENINGS,
    FitKey,
    range_around,
)
from microvib.studies.interrupts import result, threads
from microvib.studies.relative_phase import phase_multiples
from microvib.units import Si

Item = TypeVar("Item")
Done = TypeVar("Done")

FREQUENCY_FLOOR, DECAY_FLOOR, PHASE_FLOOR = 2e-4, 0.01, 0.01
"""Relative accuracy of frequencies and decays, and that of the phase of each line [rad], that no
observation is trusted beyond.
"""
HUBER_THRESHOLD = 5.0
"""Standard deviations from which a residual counts in proportion, not by its square: a start far
off still shows the way.
"""
TORQUE_FORMS = ("amplitude", "nearest_bin", "level")
"""Forms of figures in N m."""
FULL_STEPS = 4
"""Full steps in an electrical period of two phases."""
_MISSING_DIFFERENCE = (
    dict.fromkeys((*TORQUE_FORMS, "decay"), 5.0)
    | dict.fromkeys(("phase", "branch", "turn"), math.pi)
    | {"frequency": 1.0}
)
"""Difference of a figure that a simulation does not have: as large as those of the worst that do."""
_LEAST_VARIANCE = 1e-9  # of an error that lines share, over that of the largest
MIN_BEAT_PERIODS = 10.0
"""Length of a short record in periods of the least difference between observed lines."""
MAX_SHORTENING = 0.7
"""Part of the motion that a short record may take at most to be worth it."""
PRIOR_WEIGHT = 0.1
"""Weight of a prior near the start, per width of a range: it decides only where there is no
evidence.
"""

FitProgress = Callable[[str, int, float, dict[str, float]], None]
"""stage, simulations so far, cost of the best, its parameters"""


TestOverrides = dict[str, object] | Scenario
"""Settings of a single test: changes of the scenario, or a scenario."""


def with_overrides(scenario: Scenario, own: TestOverrides) -> Scenario:
    """The scenario of a test."""
    if isinstance(own, Scenario):
        return own
    if own:
        return scenario.with_(own)
    return scenario


def as_tested(scenario: Scenario, evidence: Evidence, own: TestOverrides) -> Scenario:
    """The scenario as a test had it: the test's own, its clock, and its record."""
    test = with_overrides(scenario, own)
    record = {"record.duration": evidence.duration, "record.sample_rate": evidence.sample_rate}
    if evidence.clock_ratio is not None:
        record["tracking.clock_ratio"] = test.tracking.clock_ratio * evidence.clock_ratio
    return test.with_si(record)


def with_short_record(test: Scenario, evidence: Evidence) -> Scenario:
    """The test with a record, and a time before it, just long enough to tell its observed lines
    apart; itself, if it has no longer.

    The time before it is shorter by whole electrical periods, so that lines of the clock keep their
    phases. Where the rate changes in it, the test stays as it is.
    """
    from scipy.fft import next_fast_len

    if not test.driving_frequency:
        return test
    observed = {o.line for o in evidence.observations}
    at = sorted(
        {0.0}
        | {
            x.frequency
            for x in expected_lines(test, Si(math.inf), evidence.harmonics)
            if x.name in observed
        }
    )
    gap = min((b - a for a, b in pairwise(at)), default=0.0)
    if gap:
        enough = min(MIN_BEAT_PERIODS / gap, evidence.duration)
    else:
        enough = evidence.duration
    period = test.driver.beats * test.driver.microsteps / test.driving_frequency
    settle = (
        test.record.settle - max(math.floor((test.record.settle - enough) / period), 0.0) * period
    )
    samples = next_fast_len(math.ceil(enough * evidence.sample_rate))
    duration = min(evidence.duration, samples / evidence.sample_rate)
    if settle + duration > MAX_SHORTENING * (test.record.settle + evidence.duration):
        return test
    short = test.with_si({"record.settle": settle, "record.duration": duration})
    if short.driving_frequency == test.driving_frequency:
        return short
    return test


@dataclass(frozen=True)
class Correction:
    """Difference of residuals of runs from those of steady states, to first order about a point."""

    x: np.ndarray
    """The point, (m,)."""
    at: np.ndarray
    """Difference of residuals there, (rows,)."""
    slopes: np.ndarray
    """Difference of their slopes, (rows, m)."""


def _are_steady(tables: Sequence[Simulated] | None) -> bool:
    """Whether all tests were simulated, and as steady states."""
    return tables is not None and all(simulated.state is not None for simulated in tables)


def cost(r: np.ndarray) -> float:
    """Sum of squares; of residuals beyond ROBUST, of what grows in proportion (Huber)."""
    size = np.abs(r)
    return float(
        np.sum(
            np.where(
                size < HUBER_THRESHOLD, size**2, 2.0 * HUBER_THRESHOLD * size - HUBER_THRESHOLD**2
            )
        )
    )


def difference(o: Observation, simulated: Simulated | None) -> float:
    """Logarithm of the ratio of amplitudes, relative difference of frequency and decay, difference
    of phases.
    """
    if simulated is None:
        value = math.nan
    else:
        value = predicted(simulated, o)
    if not math.isfinite(value):
        return _MISSING_DIFFERENCE[o.form]
    if o.form in TORQUE_FORMS:
        return math.log(max(value, 1e-12) / o.value)
    if o.is_angle:
        return math.remainder(value - o.value, 2.0 * math.pi)
    return (value - o.value) / max(abs(o.value), 1e-6)


def total_standard_deviation(
    o: Observation, each: float, less: float = 1.0, steps: int = FULL_STEPS
) -> float:
    """Standard deviation that the difference of one observation is measured by: its own, divided by
    ``less``, and the model's.

    Of a phase (m phi_j - n phi_k, ``relative_phase``, with ``steps`` full steps in an electrical
    period) that of m phi_j: the error of phi_k is shared by all phases against this line.
    """
    own = o.uncertainty / less
    if o.form in TORQUE_FORMS:
        return math.hypot(own / o.value, each)
    if o.form == "frequency":
        return math.hypot(own / o.value, FREQUENCY_FLOOR)
    if o.form == "decay":
        return math.hypot(own / max(abs(o.value), 1e-6), DECAY_FLOOR)
    return math.hypot(own, PHASE_FLOOR * _multiples(o, steps)[0])


def _multiples(o: Observation, steps: int) -> tuple[int, int]:
    """Times that the phases of a line and of the one that it is against count in an angle."""
    if not o.against:
        return 1, 0
    return phase_multiples(o.line, o.against, steps)


def shared_errors(
    observed: Sequence[tuple[int, Observation]],
    tests: Sequence[tuple[Evidence, Scenario]],
    trust: ErrorModel,
) -> np.ndarray:
    """Standard deviations (figures, errors) by which errors that figures share move their
    differences.

    There is one of each recording's scale, where its ``common`` deviation is not 0, those of the
    measuring chain's gain over frequency (``chain_errors``), and one of the phase of each line that
    others are relative to.
    """
    columns = []
    if trust.common:
        for k in range(len(tests)):
            columns.append(
                [trust.common * (j == k and o.form in TORQUE_FORMS) for j, o in observed]
            )
    if trust.chain:
        columns += chain_errors(observed, tests, trust).T.tolist()
    for k, name in dict.fromkeys((j, o.against) for j, o in observed if o.against):
        steps = tests[k][1].motor.alike_per_turn
        columns.append(
            [
                -PHASE_FLOOR * _multiples(o, steps)[1] if (j, o.against) == (k, name) else 0.0
                for j, o in observed
            ]
        )
    return np.array(columns).reshape(len(columns), len(observed)).T


def chain_errors(
    observed: Sequence[tuple[int, Observation]],
    tests: Sequence[tuple[Evidence, Scenario]],
    trust: ErrorModel,
) -> np.ndarray:
    """Standard deviations (figures, errors) by which errors of the measuring chain's gain move the
    differences of amplitudes.

    One chain measured all recordings. Its gain errors at two frequencies f and g have the correlation
    exp(-((f - g)/chain_width)^2 / 2): the same at one frequency, whatever the recording, and
    independent far apart.
    """
    rows = [k for k, (_, o) in enumerate(observed) if o.form in TORQUE_FORMS]
    at = _frequencies([observed[k] for k in rows], tests)
    apart = np.subtract.outer(at, at) / trust.chain_width
    variances, directions = np.linalg.eigh(np.exp(-0.5 * apart**2))
    kept = variances > _LEAST_VARIANCE * variances[-1:]
    found = np.zeros((len(observed), int(np.count_nonzero(kept))))
    found[rows] = trust.chain * directions[:, kept] * np.sqrt(variances[kept])
    return found


def _frequencies(
    observed: Sequence[tuple[int, Observation]], tests: Sequence[tuple[Evidence, Scenario]]
) -> np.ndarray:
    """Frequencies [Hz] of observed amplitudes, (n,): of a level the middle of its bins, of a line as
    measured, else as expected of its test.
    """
    of_lines: list[dict[str, float]] = []
    for evidence, test in tests:
        lines = expected_lines(test, Si(math.inf), evidence.harmonics)
        measured = {o.line: o.value for o in evidence.observations if o.form == "frequency"}
        of_lines.append({line.name: line.frequency for line in lines} | measured)
    return np.array(
        [
            float(np.mean(o.bins)) / tests[k][0].duration if o.bins else of_lines[k][o.line]
            for k, o in observed
        ]
    )


@dataclass(frozen=True)
class ErrorModel:
    """Standard deviations of what evidence tells; of amplitudes beyond their own uncertainty, as
    parts of the amplitude.
    """

    each: float
    """Error of each line: model and instrument chain."""
    common: float = 0.0
    """Error common to all lines of a recording: its scale."""
    settle: float = math.inf
    """Error of the time before a recording [s]; infinite where it was not measured."""
    chain: float = 0.0
    """Error of the measuring chain's gain at a frequency, which lines near it share."""
    chain_width: float = 2.0
    """Distance of frequencies over which that error stays nearly the same [Hz]."""


class BestSoFar:
    """Count of simulations and the best so far, through all that is done to a problem."""

    def __init__(self, progress: FitProgress | None = None) -> None:
        self.stage, self.simulations, self.stopped = "global", 0, False
        # of the simulations, tests of which the steady state stood for a run
        self.steady = 0
        # a point and its residuals, with the problem that it was met in
        self.best: tuple[Problem, np.ndarray, np.ndarray] | None = None
        self._progress: FitProgress = progress or (lambda *_: None)
        self._cost, self._lock = math.inf, Lock()

    def more(self, simulations: int) -> None:
        """Simulations that are no point of a search."""
        with self._lock:
            self.simulations += simulations
            self._tell()

    def _tell(self) -> None:
        if self.best is not None:
            problem, x, _ = self.best
            self._progress(self.stage, self.simulations, self._cost, problem.named(x))

    def note(
        self, problem: Problem, x: np.ndarray, r: np.ndarray, tables: Sequence[Simulated] | None
    ) -> None:
        """One point more; any thread may say so."""
        with self._lock:
            self.simulations += len(problem.tests)
            self.steady += sum(one.state is not None for one in tables or ())
            worth = problem.whole is not None, cost(r)  # whole records before short ones
            if self.best is None or worth < (self.best[0].whole is not None, self._cost):
                self._cost, self.best = cost(r), (problem, x, r)
            self._tell()


def _start_values(
    scenario: Scenario, tests: Sequence[Scenario], keys: Sequence[FitKey]
) -> list[float]:
    """The scenario's values or, of a key with one in each test, its test's."""
    shared = {name: value for name, value, _ in scenario.entries()}
    own = [{name: value for name, value, _ in test.entries()} for test in tests]
    return [float((shared if key.test is None else own[key.test])[key.key]) for key in keys]


class Problem:
    """Residuals of all observations at points in the space of the fitted parameters' coordinates."""

    def __init__(
        self,
        scenario: Scenario,
        evidence: Sequence[tuple[Evidence, TestOverrides]],
        keys: Sequence[FitKey],
        trust: ErrorModel,
        best_so_far: BestSoFar | None = None,
        whole: Problem | None = None,
    ) -> None:
        self.scenario, self.evidence, self.keys, self.trust = scenario, evidence, list(keys), trust
        # whose records this one has shortened
        self.whole = whole
        tests = [(one, as_tested(scenario, one, own)) for one, own in evidence]
        self.tests = tests
        if whole is not None:
            self.tests = [(one, with_short_record(test, one)) for one, test in tests]
        self.observed = [(k, o) for k, (one, _) in enumerate(self.tests) for o in one.observations]
        self.weights = self.tight = np.array(
            [
                total_standard_deviation(o, trust.each, steps=self.tests[k][1].motor.alike_per_turn)
                for k, o in self.observed
            ]
        )
        self.shared = shared_errors(self.observed, self.tests, trust)
        self.coordinates = Coordinates(tuple(self.keys))
        self.start = self.coordinates.start(
            _start_values(scenario, [test for _, test in tests], self.keys)
        )
        self.spans = self.coordinates.spans
        self.low, self.high = self.coordinates.limits
        self.best_so_far = best_so_far or BestSoFar()
        self.solved = False
        """Whether steady states stand for runs."""
        self.begun: list[SteadyState | None] = [None] * len(tests)
        """Steady states from which others are searched."""
        self.runs_else = True
        """Whether tests are run where no such state is found."""
        self.correction: Correction | None = None

    def again(
        self, keys: Sequence[FitKey] | None = None, evidence: Sequence[tuple[Evidence, TestOverrides]] | None = None,
        trust: ErrorModel | None = None, scenario: Scenario | None = None,
    ) -> Problem:  # fmt: skip
        """Problem with other keys, evidence, error model or scenario."""
        if evidence is None:
            evidence = self.evidence
        keys = self.keys if keys is None else keys
        return Problem(
            scenario or self.scenario,
            evidence,
            keys,
            trust or self.trust,
            best_so_far=self.best_so_far,
        ).with_cartesian(self.is_cartesian)

    @property
    def is_cartesian(self) -> bool:
        """Whether amplitudes and phases are moved by their Cartesian parts."""
        return bool(self.coordinates.pairs)

    def with_cartesian(self, cartesian: bool = True) -> Problem:
        """The problem with Cartesian parts for amplitudes that are fitted with their phases, or
        without; itself where that changes nothing.
        """
        coordinates = Coordinates(tuple(self.keys))
        if cartesian:
            coordinates = coordinates.cartesian()
        if coordinates == self.coordinates:
            return self
        other = copy(self)
        other.coordinates, other.spans = coordinates, coordinates.spans
        other.low, other.high = coordinates.limits
        other.start = coordinates.start(self.values(self.start))
        return other

    def looser(self, factors: np.ndarray) -> Problem:
        """Problem with each figure's standard deviation ``factors`` (figures,) times as large;
        ``tight`` are those of before.
        """
        other = copy(self)
        other.weights = self.tight * factors
        return other

    def rough(self) -> Problem:
        """For a search: with records that just tell the observed lines apart; itself where that
        changes what is observed.
        """
        if not self._is_timeless:
            return self
        short = Problem(
            self.scenario,
            self.evidence,
            self.keys,
            self.trust,
            best_so_far=self.best_so_far,
            whole=self,
        ).with_cartesian(self.is_cartesian)
        if all(a is b for (_, a), (_, b) in zip(self.tests, short.tests, strict=True)):
            return self
        return short

    def steady(self) -> Problem | None:
        """For a search: with steady states in place of runs, and nothing where there are none. None
        where the tests have none at the start, or where it would change what is observed.
        """
        other = self.in_steady_state(self.start)
        if other is None:
            return None
        other.begun, other.runs_else = [None] * len(self.tests), False
        return other

    @property
    def _is_timeless(self) -> bool:
        """Whether no figure depends on how long ago the start was, or on the length of the record."""
        timed = any(
            o.form in ("nearest_bin", "level")
            or (LineName.parse(o.line).is_mode and o.form == "amplitude")
            for _, o in self.observed
        )
        return not timed and "record.settle" not in self.taken

    def in_steady_state(self, x: np.ndarray) -> Problem | None:
        """For what is near ``x``: with steady states in place of runs, searched from those there.
        None where a test has none.
        """
        if self.whole is not None or not self._is_timeless:
            return None
        if not all(has_steady_states(test) for _, test in self.tests):
            return None
        other = copy(self)
        other.whole, other.solved = self, True
        other = other.beginning_at(x)
        if any(state is None for state in other.begun):
            return None
        return other

    def beginning_at(self, x: np.ndarray) -> Problem:
        """With steady states that are searched from those at ``x``, if there are any."""
        if not self.solved:
            return self
        tables, other = self.lines(x), copy(self)
        other.begun = [None] * len(self.tests)
        if tables is not None:
            other.begun = [simulated.state for simulated in tables]
        return other

    def corrected(self, correction: Correction | None) -> Problem:
        """With residuals that are corrected to those of runs, or without."""
        other = copy(self)
        other.correction = correction
        return other

    def corrected_to(self, runs: Problem, x: np.ndarray) -> Problem:
        """With residuals that are those of other ``runs`` at ``x``; with the same slopes as before."""
        (r,), (own,) = runs.residuals([x]), self.corrected(None).residuals([x])
        slopes = np.zeros((r.size, x.size)) if self.correction is None else self.correction.slopes
        return self.corrected(Correction(x, self.least(r - own), slopes))

    def in_threads(self, work: Callable[[Item], Done], items: Sequence[Item]) -> list[Done]:
        """The work on each item, as many at a time as there are cores. An interrupt also ends work
        that is under way.
        """
        try:
            with threads() as pool:
                try:
                    return [
                        result(future) for future in [pool.submit(work, item) for item in items]
                    ]
                except KeyboardInterrupt:
                    self.best_so_far.stopped = True
                    raise
        finally:
            if current_thread() is main_thread():
                self.best_so_far.stopped = False

    def widened(self) -> Problem | None:
        """With ranges of ours that reach further both ways; None where all are stated."""
        keys = [key.widened() for key in self.keys]
        if keys == self.keys:
            return None
        return self.again(keys)

    def within(self, x: np.ndarray) -> Problem:
        """With ranges of ours widened until ``x`` lies inside, as far as they may be."""
        keys = list(self.keys)
        pairs = {k for pair in self.coordinates.pairs for k in pair}
        for k, c in enumerate(x):
            if k in pairs:
                continue
            for _ in range(MAX_WIDENINGS):
                if not keys[k].interior(float(c)):
                    keys[k] = keys[k].widened()
        return self.again(keys)

    def along(self) -> Problem | None:
        """With an array mode's clamped frequency as another key: of the first that was measured and
        is not fitted.
        """
        own = {
            name: (value, quantity)
            for name, value, quantity in self.scenario.entries()
            if quantity is not None
        }
        for _, o in self.observed:
            line = LineName.parse(o.line)
            if o.form == "frequency" and line.family == ARRAY_MODE:
                name = f"array.modes.{line.order - 1}.frequency"
                if name in own and name not in self.taken:
                    key = range_around(name, *own[name], along=True)
                    return self.again(
                        [
                            *self.keys,
                            replace(key, low=min(key.low, o.value / FREQUENCY_RANGE_FACTOR)),
                        ]
                    )
        return None

    @property
    def taken(self) -> set[str]:
        """Keys that are fitted, or set by a test."""
        whole, taken = (
            {name: value for name, value, _ in self.scenario.entries()},
            {key.key for key in self.keys},
        )
        for _, own in self.evidence:
            if isinstance(own, Scenario):
                taken |= {
                    name
                    for name, value, _ in own.entries()
                    if name not in whole or value != whole[name]
                }
            else:
                taken |= set(own)
        return taken

    def tuned(self, x: np.ndarray) -> np.ndarray:
        """``x`` with fitted clamped frequencies that bring array modes, through the drive, to where
        they were measured.

        By the linear model, as far as the ranges go; modes whose frequency was not measured stay.
        """
        x = x.copy()
        for k, key in enumerate(self.keys):
            mode = re.fullmatch(r"array\.modes\.(\d+)\.frequency", key.key)
            if mode:
                line = f"array_mode_{int(mode[1]) + 1}"
            else:
                line = ""
            seen = ((j, o) for j, o in self.observed if key.test in (None, j))
            measured = next(
                ((j, o.value) for j, o in seen if (o.line, o.form) == (line, "frequency")), None
            )
            if measured and key.logarithmic:
                j, wanted = measured
                at = self._seen(x, j, line)
                if at:
                    x[k] = np.clip(x[k] + math.log(wanted / at), *key.range)
        return x

    def point(self, values: dict[str, float]) -> np.ndarray:
        """Coordinates of the fitted keys' values, by label, within their reach."""
        return self.coordinates.point([values[key.label] for key in self.keys])

    def _seen(self, x: np.ndarray, j: int, line: str) -> float | None:
        """Frequency of an array mode through the drive [Hz], in a test."""
        with suppress(MicrovibError):
            expected = expected_lines(self.tests[j][1].with_si(self.changes(x, j)), Si(math.inf))
            return next((one.frequency for one in expected if one.name == line), None)
        return None

    @property
    def figures(self) -> int:
        """Observations."""
        return len(self.observed)

    def values(self, x: np.ndarray) -> list[float]:
        """The fitted keys' values at ``x``, in their order."""
        return self.coordinates.values(x)

    def named(self, x: np.ndarray) -> dict[str, float]:
        """The fitted keys' values at ``x``, by label."""
        return dict(zip((key.label for key in self.keys), self.values(x), strict=True))

    def labels(self, j: int) -> dict[str, str]:
        """Keys that are fitted in a test, with their labels."""
        return {key.key: key.label for key in self.keys if key.test in (None, j)}

    def changes(self, x: np.ndarray, j: int) -> dict[str, float]:
        """Values at ``x`` of the keys that are fitted in a test."""
        named = self.named(x)
        return {key: named[label] for key, label in self.labels(j).items()}

    def lines(self, x: np.ndarray) -> list[Simulated] | None:
        """Lines of every test at ``x``."""
        return self.simulated([[self.changes(x, j) for j in range(len(self.tests))]])[0]

    def simulated(
        self, changes: Sequence[Sequence[Mapping[str, object]]]
    ) -> list[list[Simulated] | None]:
        """Lines of every test with each of the changes to it; None where the model cannot have
        them, or loses its motion.

        Many at a time: the kernel holds no lock.
        """
        cases: list[Case] = []
        for k, changed in enumerate(changes):
            with suppress(MicrovibError):
                each = zip(changed, self.tests, self.begun, strict=True)
                cases += [
                    Case(k, test.with_si(dict(mine)), one, self.solved, begun, self.runs_else)
                    for mine, (one, test), begun in each
                ]
        found: list[list[Simulated]] = [[] for _ in changes]
        for case, simulated in zip(cases, self.in_threads(Case.simulated, cases), strict=True):
            if simulated is not None:
                found[case.point].append(simulated)
        return [tables if len(tables) == len(self.tests) else None for tables in found]

    def differences(self, tables: list[Simulated] | None) -> np.ndarray:
        """Measured and simulated figures' differences, (n,): logarithms of ratios, relative ones of
        frequencies, phases in rad.
        """
        return np.array(
            [difference(o, None if tables is None else tables[k]) for k, o in self.observed]
        )

    def residuals(
        self, points: Sequence[np.ndarray], also: Sequence[Sequence[Mapping[str, object]]] = ()
    ) -> list[np.ndarray]:
        """Weighted differences of all observations, the errors that they share, and the prior's of
        all parameters.

        ``also`` are changes to other keys at each of the points, of each test.
        """
        if self.best_so_far.stopped:
            raise KeyboardInterrupt
        found = []
        none: list[Mapping[str, object]] = [{}] * len(self.tests)
        changes = [
            [{**self.changes(x, j), **own} for j, own in enumerate(more)]
            for x, more in zip(points, also or [none] * len(points), strict=True)
        ]
        for x, tables in zip(points, self.simulated(changes), strict=True):
            prior = PRIOR_WEIGHT * (x - self.start) / self.spans
            r = np.concatenate([*self.weighted(self.differences(tables)), prior])
            if self.correction is not None and _are_steady(tables):
                r += self.correction.at + self.correction.slopes @ (x - self.correction.x)
            found.append(r)
            if not also:
                self.best_so_far.note(self, x, r, tables)
        return found

    def least(self, change: np.ndarray) -> np.ndarray:
        """A change of residuals, (rows,) or several (n, rows), without whole turns of angles."""
        n, q = self.shared.shape
        angles = np.flatnonzero([o.is_angle for _, o in self.observed])
        d = change[..., :n] * self.weights + change[..., n : n + q] @ self.shared.T
        turns = np.rint(d[..., angles] / math.tau)
        if not np.any(turns):
            return change
        d[..., angles] -= math.tau * turns
        return np.concatenate([*self.weighted(d), change[..., n + q :]], axis=-1)

    def weighted(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Differences (..., figures) over their standard deviations, the most likely errors that
        they share taken off; and these over their standard deviations, (..., errors).

        The sum of squares of both is that of the differences with their whole covariance.
        """
        part = self.shared / self.weights[:, None]
        normal = part.T @ part + np.eye(part.shape[1])
        errors = np.linalg.solve(normal, part.T @ (d / self.weights).T).T
        return (d - errors @ self.shared.T) / self.weights, errors
