"""The cost of an identification: weighted differences between measured and simulated figures."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Lock, current_thread, main_thread
from typing import TypeVar

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.expected import expected_lines
from microvib.model.scenario import Scenario
from microvib.solve.batch import Torque, simulate_torques
from microvib.solve.vector import WIDTH
from microvib.studies.evidence import Evidence, Simulated
from microvib.studies.identify.figures import as_tested, cost, difference, lines_of, weight
from microvib.studies.identify.keys import FREQUENCY_FACTOR, WIDENINGS, FitKey, around
from microvib.units import Si

Item = TypeVar("Item")
Done = TypeVar("Done")

PRIOR = 0.1
"""Weight of a prior near the start, per width of a range: it decides only where there is no evidence."""

FitProgress = Callable[[str, int, float, dict[str, float]], None]
"""stage, simulations so far, cost of the best, its parameters"""


@dataclass(frozen=True)
class Trust:
    """Standard deviations that amplitudes are trusted to beyond their own uncertainty, as parts of the amplitude."""

    each: float
    """Of each line by itself: model and instrument chain."""
    common: float = 0.0
    """Of all lines of a recording together: its scale."""


class Ledger:
    """Count of simulations and the best so far, through all that is done to a problem."""

    def __init__(self, progress: FitProgress) -> None:
        self.stage, self.simulations, self.stopped = "global", 0, False
        self.best: tuple[Problem, np.ndarray, np.ndarray] | None = None
        self._cost, self._progress, self._lock = math.inf, progress, Lock()

    def note(self, problem: Problem, x: np.ndarray, r: np.ndarray) -> None:
        """One point more; any thread may say so."""
        with self._lock:
            self.simulations += len(problem.tests)
            if cost(r) < self._cost or self.best is None:
                self._cost, self.best = cost(r), (problem, x, r)
            values = self.best[0].changes(self.best[1])
            self._progress(self.stage, self.simulations, self._cost, values)  # type: ignore[arg-type]


class Problem:
    """Residuals of all observations at points in the space of the fitted parameters' coordinates."""

    def __init__(
        self,
        scenario: Scenario,
        evidence: Sequence[tuple[Evidence, dict[str, object]]],
        keys: Sequence[FitKey],
        trust: Trust,
        progress: FitProgress | None = None,
        ledger: Ledger | None = None,
    ) -> None:
        self.scenario, self.evidence, self.keys, self.trust = scenario, evidence, list(keys), trust
        self.tests = [(one, as_tested(scenario, one, changes)) for one, changes in evidence]
        self.observed = [(k, o) for k, (one, _) in enumerate(self.tests) for o in one.observations]
        self.weights = np.array([weight(o, trust.each) for _, o in self.observed])
        own = {name: value for name, value, _ in scenario.entries()}
        self.start = np.array([key.coordinate(float(own[key.key])) for key in self.keys])
        self.spans = np.array([key.span for key in self.keys])
        self.low, self.high = np.array([key.reach for key in self.keys]).T
        self._ledger = ledger or Ledger(progress or (lambda *_: None))

    def again(self, keys: Sequence[FitKey]) -> Problem:
        """The same with other keys."""
        return Problem(self.scenario, self.evidence, keys, self.trust, ledger=self._ledger)

    def with_scenario(self, changes: dict[str, object]) -> Problem:
        """The same with a changed scenario, apart from the search: what it meets does not count as best so far."""
        return Problem(self.scenario.with_si(changes), self.evidence, self.keys, self.trust)

    def in_threads(self, work: Callable[[Item], Done], items: Sequence[Item]) -> list[Done]:
        """The work on each item, as many at a time as there are cores. An interrupt also ends work that is under way."""
        pool = ThreadPoolExecutor(os.cpu_count() or 1)
        try:
            return list(pool.map(work, items))
        except KeyboardInterrupt:
            self._ledger.stopped = True
            raise
        finally:
            pool.shutdown(cancel_futures=True)
            if current_thread() is main_thread():
                self._ledger.stopped = False

    def enters(self, stage: str) -> None:
        """Say what is being done."""
        self._ledger.stage = stage

    @property
    def simulations(self) -> int:
        """Simulations so far."""
        return self._ledger.simulations

    def so_far(self) -> tuple[Problem, np.ndarray, np.ndarray]:
        """The best point so far and its residuals, with the problem that it was met in; KeyboardInterrupt if there is none."""
        if self._ledger.best is None:
            raise KeyboardInterrupt
        return self._ledger.best

    def widened(self) -> Problem | None:
        """With ranges of ours that reach further both ways; None where all are stated."""
        keys = [key.widened() for key in self.keys]
        return None if keys == self.keys else self.again(keys)

    def within(self, x: np.ndarray) -> Problem:
        """With ranges of ours widened until ``x`` lies inside, as far as they may be."""
        keys = list(self.keys)
        for k, c in enumerate(x):
            for _ in range(WIDENINGS):
                keys[k] = keys[k] if keys[k].interior(float(c)) else keys[k].widened()
        return self.again(keys)

    def along(self) -> Problem | None:
        """With an array mode's clamped frequency as another key: of the first that was measured and is not fitted."""
        own = {name: (value, quantity) for name, value, quantity in self.scenario.entries() if quantity is not None}
        taken = {key.key for key in self.keys} | {name for _, changes in self.evidence for name in changes}
        for _, o in self.observed:
            if o.form != "frequency" or not o.line.startswith("array_mode_"):
                continue
            name = f"array.modes.{int(o.line.removeprefix('array_mode_')) - 1}.frequency"
            if name in own and name not in taken:
                key = around(name, *own[name], along=True)
                return self.again([*self.keys, replace(key, low=min(key.low, o.value / FREQUENCY_FACTOR))])
        return None

    def tuned(self, x: np.ndarray) -> np.ndarray:
        """``x`` with fitted clamped frequencies that bring array modes, through the drive, to where they were measured.

        By the linear model, as far as the ranges go; modes whose frequency was not measured stay.
        """
        x = x.copy()
        for k, key in enumerate(self.keys):
            mode = re.fullmatch(r"array\.modes\.(\d+)\.frequency", key.key)
            line = f"array_mode_{int(mode[1]) + 1}" if mode else ""
            measured = next(((j, o.value) for j, o in self.observed if (o.line, o.form) == (line, "frequency")), None)
            if measured and key.logarithmic:
                j, wanted = measured
                seen = self._seen(x, j, line)
                x[k] = np.clip(x[k] + math.log(wanted / seen), *key.range) if seen else x[k]
        return x

    def _seen(self, x: np.ndarray, j: int, line: str) -> float | None:
        """Frequency of an array mode through the drive [Hz], in a test."""
        try:
            expected = expected_lines(self.tests[j][1].with_si(self.changes(x)), Si(math.inf))
        except MicrovibError:
            return None
        return next((one.frequency for one in expected if one.name == line), None)

    @property
    def figures(self) -> int:
        """Observations."""
        return len(self.observed)

    def changes(self, x: np.ndarray) -> dict[str, object]:
        """The fitted keys' values at ``x``."""
        return {key.key: key.value(float(c)) for key, c in zip(self.keys, x, strict=True)}

    def simulated(self, changes: Sequence[dict[str, object]]) -> list[list[Simulated] | None]:
        """Lines of every test with each of the changes; None where the model cannot have them, or loses its motion.

        Many at a time: lanes share a core, and the kernel holds no lock.
        """
        cases: list[tuple[int, int, Scenario]] = []
        for k, changed in enumerate(changes):
            try:
                cases += [(k, j, test.with_si(changed)) for j, (_, test) in enumerate(self.tests)]
            except MicrovibError:
                continue
        chunks = self.in_threads(self._lines, [cases[k : k + WIDTH] for k in range(0, len(cases), WIDTH)])
        found: dict[tuple[int, int], Simulated] = {}
        for chunk in chunks:
            found |= chunk
        tests = range(len(self.tests))
        return [
            [found[k, j] for j in tests] if all((k, j) in found for j in tests) else None for k in range(len(changes))
        ]

    def _lines(self, cases: Sequence[tuple[int, int, Scenario]]) -> dict[tuple[int, int], Simulated]:
        torques = simulate_torques([scenario for _, _, scenario in cases])
        return {
            (k, j): lines_of(torque, scenario, self.tests[j][0])
            for (k, j, scenario), torque in zip(cases, torques, strict=True)
            if isinstance(torque, Torque)
        }

    def differences(self, tables: list[Simulated] | None) -> np.ndarray:
        """Measured and simulated figures' differences, (n,): logarithms of ratios, relative ones of frequencies, phases in rad."""
        return np.array([difference(o, None if tables is None else tables[k]) for k, o in self.observed])

    def residuals(self, points: Sequence[np.ndarray], also: Sequence[dict[str, object]] = ()) -> list[np.ndarray]:
        """Weighted differences of all observations, each recording's common error, and the prior's of all parameters.

        ``also`` are changes to other keys at each of the points.
        """
        if self._ledger.stopped:
            raise KeyboardInterrupt
        found = []
        changes = [self.changes(x) | more for x, more in zip(points, also or [{}] * len(points), strict=True)]
        for x, tables in zip(points, self.simulated(changes), strict=True):
            prior = PRIOR * (x - self.start) / self.spans
            r = np.concatenate([*self.weighted(self.differences(tables)), prior])
            found.append(r)
            if not also:
                self._ledger.note(self, x, r)
        return found

    def weighted(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Differences over their standard deviations, the most likely common error taken off; and that of each recording."""
        if self.trust.common == 0.0:
            return d / self.weights, np.zeros(0)
        r, errors = d / self.weights, np.zeros(len(self.tests))
        for k in range(len(self.tests)):
            mine = np.array([j == k and o.form in ("amplitude", "nearest_bin") for j, o in self.observed])
            w = self.weights[mine] ** -2
            common = float(d[mine] @ w) / (float(w.sum()) + self.trust.common**-2)
            r[mine] -= common / self.weights[mine]
            errors[k] = common / self.trust.common
        return r, errors
