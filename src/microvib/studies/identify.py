"""Identification: parameters of the drive from measured lines, with what they are worth.

Global start (a Sobol sequence over the ranges), local finish (trust-region least squares from the best starts), both on the
lines of complete simulations with converged steps. Parameters that are positive are fitted by their logarithm. The clock is not
fitted: the evidence tells it directly.

A calibration is not a prediction: parameters that are fitted to some lines say nothing new about these lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from microvib.errors import MicrovibError
from microvib.model.expected import expected_lines
from microvib.model.scenario import Scenario
from microvib.signals.lines import PASSBAND, lines_at_known_clock
from microvib.signals.spectrum import amplitude_spectrum
from microvib.solve.simulate import simulate
from microvib.studies.evidence import Evidence, Observation, Simulated, predicted
from microvib.units import convert

MODEL_FLOOR = 0.004
"""Relative accuracy of model and instrument chain that no observation is trusted beyond: filters, steps, window."""
PHASE_FLOOR = 0.01
PRIOR = 0.1
"""Weight of the wish to stay near the start, per width of a range: it decides only where the evidence says nothing."""
UNEXPLAINED = 5.0
"""Standard deviations, root mean square, from which a fit does not explain its evidence."""
EXPLAINED = 3.0
"""Standard deviations, root mean square, below which no further start is tried."""
FIRST_LOOK, FULL = 10, 60
"""Steps of a local fit: to see whether the ranges suffice, and to the end."""
DIFFERENCE = 2e-3
"""Step of differences, over the width of a range."""
MOST_WIDENINGS = 3
_NOWHERE = 30.0
"""Residual of a line that a simulation does not have."""

Progress = Callable[[str, int, float, dict[str, float]], None]
"""stage, simulations so far, cost of the best, its parameters"""


@dataclass(frozen=True)
class FitKey:
    """A parameter that is fitted, by its dotted key, within a range in SI units."""

    key: str
    low: float
    high: float
    unit: str
    stated: bool = True
    """Whether the user stated the range; one that is ours is widened where the best lies at its end."""
    along: bool = False
    """Whether it is fitted along without being asked for."""

    @property
    def logarithmic(self) -> bool:
        """Positive ranges are fitted by their logarithm."""
        return self.low > 0.0

    def to_unit(self, value: float) -> float:
        """Value to 0 ... 1 over the range."""
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def from_unit(self, u: float) -> float:
        """0 ... 1 to a value."""
        if self.logarithmic:
            return self.low * math.exp(u * math.log(self.high / self.low))
        return self.low + u * (self.high - self.low)

    def widened(self, u: float) -> FitKey:
        """Four times further on the side where the best lies, at ``u`` of the range."""
        if self.stated or 0.02 < u < 0.98:
            return self
        low, high = (self.low / 4.0, self.high) if u <= 0.02 else (self.low, 4.0 * self.high)
        return replace(self, low=low, high=high)

    def slope(self, value: float) -> float:
        """Derivative of the value by its place in the range."""
        return value * math.log(self.high / self.low) if self.logarithmic else self.high - self.low


@dataclass(frozen=True)
class Estimate:
    """One identified parameter."""

    key: str
    unit: str
    estimate: float
    standard_error: float
    low: float
    high: float
    identifiable: bool
    verdict: str


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


def parse_fit(scenario: Scenario, text: str) -> FitKey:
    """``KEY`` or ``KEY=LOW:HIGH`` with units; without a range a factor of four each way, ten per cent for a frequency."""
    key, _, span = text.partition("=")
    key = key.strip()
    entries = {name: (value, quantity) for name, value, quantity in scenario.entries()}
    if key not in entries:
        raise MicrovibError(f"--fit {key}: is no key of the scenario; allowed are {', '.join(_fittable(scenario))}")
    value, quantity = entries[key]
    if quantity is None or not isinstance(value, float):
        raise MicrovibError(f"--fit {key}: is {value!r}, not a number; start it from a number with --set {key}=...")
    if span:
        first, colon, last = span.partition(":")
        try:
            limits = [convert(part, quantity.unit) if quantity.unit else float(part) for part in (first, last)]
        except ValueError as error:
            raise MicrovibError(f"--fit {text}: {error}; write KEY=LOW:HIGH with units ({quantity.unit})") from None
        if not colon or not limits[0] < limits[1]:
            raise MicrovibError(
                f"--fit {text}: LOW must be below HIGH; write KEY=LOW:HIGH with units ({quantity.unit})"
            )
        return FitKey(key, limits[0], limits[1], quantity.unit)
    if value <= 0.0:
        raise MicrovibError(f"--fit {key}: starts at {value:g}; give its range as {key}=LOW:HIGH in {quantity.unit}")
    factor = 1.1 if key.endswith("frequency") else 4.0
    high = value * factor if quantity.le is None else min(value * factor, quantity.le)
    return FitKey(key, value / factor, high, quantity.unit, stated=quantity.le is not None or factor < 2.0)


def _fittable(scenario: Scenario) -> list[str]:
    return [name for name, value, quantity in scenario.entries() if quantity is not None and isinstance(value, float)]


def identify(
    scenario: Scenario,
    evidence: Sequence[tuple[Evidence, dict[str, object]]],
    keys: Sequence[FitKey],
    *,
    seed: int = 1,
    starts: int = 96,
    finishes: int = 3,
    model_error: float = MODEL_FLOOR,
    progress: Progress | None = None,
) -> Fit:
    """Fit ``keys`` of ``scenario`` to all the evidence at once.

    Each evidence comes with the changes of the scenario that make its test (another state, another rate). ``model_error`` is the
    relative standard deviation that amplitudes are trusted to beyond their own uncertainty. Interrupting (Ctrl-C) ends the search
    and returns what was best so far. Same seed, same result.

    A range that the user did not state is widened where the best lies at its end. Where the fit does not explain the evidence
    and an array mode's frequency was measured, its clamped frequency is fitted along, and said to be.
    """
    problem = _Problem(scenario, evidence, keys, model_error, progress)
    if not problem.weights:
        raise MicrovibError("the evidence has no observation that stands out of its floor")
    interrupted = False
    try:
        problem.search(_sobol(len(keys), starts, seed), finishes)
        for _ in range(MOST_WIDENINGS):
            wider = problem.widened()
            if wider is None:
                break
            problem = wider
            problem.search(_sobol(len(problem.keys), max(starts // 2, 2), seed), finishes)
    except KeyboardInterrupt:
        if problem.best_u is None:
            raise
        interrupted = True
        problem.stage = "interrupted, uncertainties of the best so far"
    return problem.result(seed, interrupted)


def _sobol(dimensions: int, count: int, seed: int) -> np.ndarray:
    from scipy.stats import qmc

    points = qmc.Sobol(dimensions, seed=seed).random_base2(max(math.ceil(math.log2(count)), 1))
    return np.vstack([np.full(dimensions, np.nan), points[: count - 1]])


class _Problem:
    """Residuals of all observations as a function of the parameters' places in their ranges."""

    def __init__(
        self,
        scenario: Scenario,
        evidence: Sequence[tuple[Evidence, dict[str, object]]],
        keys: Sequence[FitKey],
        model_error: float,
        progress: Progress | None,
    ) -> None:
        self.scenario, self.evidence, self.keys, self.model_error = scenario, evidence, list(keys), model_error
        self.tests = [(one, _as_tested(scenario, one, changes)) for one, changes in evidence]
        self.first = self.tests
        self.weights = [_weight(o, model_error) for one, _ in self.tests for o in one.observations]
        self.progress = progress or (lambda *_: None)
        self.stage = "global"
        self.simulations = 0
        own = {name: value for name, value, _ in scenario.entries()}
        self.start = np.array([np.clip(key.to_unit(max(float(own[key.key]), 1e-12)), 0.0, 1.0) for key in self.keys])
        self.best_u: np.ndarray | None = None
        self.best_cost = math.inf
        self.lock = Lock()

    def search(self, points: np.ndarray, finishes: int) -> None:
        """Global search over ``points``, a first look from the best, then finishes from several unless ranges are too narrow."""
        self.stage = "global"
        starts = self.best_of(points, finishes)
        self.stage = "local"
        self.finish(starts[0], FIRST_LOOK)
        if self.wider_keys() != self.keys:
            return
        for u in (self.best_u, *starts[1:]):
            assert u is not None
            self.finish(u, FULL)
            if math.sqrt(self.best_cost / len(self.weights)) < EXPLAINED:
                break  # as near as the evidence is known: another start can only end here

    def wider_keys(self) -> list[FitKey]:
        """The keys with wider ranges where the best lies at their end, or with a mode's frequency fitted along."""
        u = self.best_u
        assert u is not None
        keys = [key.widened(float(x)) for key, x in zip(self.keys, u, strict=True)]
        missed = self._missed_mode(u) if keys == self.keys else None
        if missed is not None:
            f = float(next(value for name, value, _ in self.scenario.entries() if name == missed))
            keys.append(FitKey(missed, f / 1.1, f * 1.1, "Hz", along=True))
        return keys

    def widened(self) -> _Problem | None:
        """The problem with wider ranges, started from the best so far; None where they suffice."""
        keys = self.wider_keys()
        if keys == self.keys:
            return None
        assert self.best_u is not None
        wider = _Problem(
            self.scenario.with_si(self.changes(self.best_u)), self.evidence, keys, self.model_error, self.progress
        )
        wider.simulations, wider.first = self.simulations, self.first
        return wider

    def _missed_mode(self, u: np.ndarray) -> str | None:
        """Key of an array mode whose frequency was measured and is not fitted, where the fit does not explain the evidence."""
        r = self.residuals(u)[: len(self.weights)]
        if math.sqrt(float(r @ r) / r.size) < UNEXPLAINED:
            return None
        fitted = [key.key for key in self.keys]
        seen = [o.line for one, _ in self.tests for o in one.observations if o.form == "frequency"]
        modes = [
            f"array.modes.{int(name.rsplit('_', 1)[1]) - 1}.frequency"
            for name in seen
            if name.startswith("array_mode_")
        ]
        return next((key for key in modes if key not in fitted), None)

    def changes(self, u: np.ndarray) -> dict[str, object]:
        return {key.key: key.from_unit(float(x)) for key, x in zip(self.keys, u, strict=True)}

    def tables(self, u: np.ndarray) -> list[Simulated]:
        """Lines of every test at the parameters ``u``."""
        return [_lines(test.with_si(self.changes(u)), one) for one, test in self.tests]

    def residuals(self, u: np.ndarray) -> np.ndarray:
        """Weighted differences of all observations, and the prior's of all parameters, (n + m,)."""
        prior = PRIOR * (u - self.start)
        try:
            tables = self.tables(np.clip(u, 0.0, 1.0))
        except MicrovibError:  # out of what the model can do: as bad as can be, but finite
            return np.concatenate([np.full(len(self.weights), _NOWHERE), prior])
        pairs = [
            (o, predicted(table, o))
            for (one, _), table in zip(self.tests, tables, strict=True)
            for o in one.observations
        ]
        differences = [_difference(o, p) / w for (o, p), w in zip(pairs, self.weights, strict=True)]
        r = np.concatenate([differences, prior])
        cost = float(_soft(r) @ _soft(r))
        with self.lock:
            self.simulations += len(self.tests)
            if cost < self.best_cost:
                self.best_cost, self.best_u = cost, np.clip(u, 0.0, 1.0)
            best = self.changes(self.best_u) if self.best_u is not None else {}
            self.progress(self.stage, self.simulations, self.best_cost, best)  # type: ignore[arg-type]
        return r

    def best_of(self, points: np.ndarray, count: int) -> list[np.ndarray]:
        """The ``count`` best of ``points``; the first stands for the scenario's own values."""
        points = points.copy()
        points[0] = self.start
        costs = [float(_soft(r) @ _soft(r)) for r in self.several(list(points))]
        return [points[k] for k in np.argsort(costs, kind="stable")[:count]]

    def finish(self, u: np.ndarray, steps: int) -> None:
        """Trust-region least squares from ``u``, at most ``steps`` steps."""
        from scipy.optimize import least_squares

        inside = np.clip(u, 1e-3, 1.0 - 1e-3)
        least_squares(
            lambda v: _soft(self.residuals(v)), inside, jac=self.slopes, bounds=(0.0, 1.0), x_scale=0.1,
            xtol=1e-5, ftol=1e-6, max_nfev=steps,
        )  # fmt: skip

    def result(self, seed: int, interrupted: bool) -> Fit:
        u = self.best_u
        assert u is not None
        r = self.residuals(u)
        J = self.jacobian(u)
        n, m = len(self.weights), len(self.keys)
        scatter = max(float(r[:n] @ r[:n]) / max(n - m, 1), 1.0)
        covariance = np.linalg.pinv(J.T @ J, rcond=1e-12) * scatter
        spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        correlation = covariance / np.outer(np.maximum(spread, 1e-300), np.maximum(spread, 1e-300))
        estimates = [self.estimate(k, u, spread, correlation) for k in range(m)]
        found = [(one, o) for one, _ in self.tests for o in one.observations]
        relative = self.relative(J[:n], u)
        sensitivities = {
            f"{o.line} {o.form}" + (f" [{one.name}]" if len(self.tests) > 1 else ""): tuple(row)
            for (one, o), row in zip(found, relative, strict=True)
        }
        names = ", ".join(one.name for one, _ in self.tests)
        fitted = self.scenario.with_si(self.changes(u))
        sources = dict(self.scenario.sources) | {
            e.key: f"identified from {names}: {e.estimate:.6g} ± {e.standard_error:.2g} {e.unit}".rstrip()
            for e in estimates
        }
        before, after = [_lines(test, one) for one, test in self.first], self.tables(u)
        return Fit(
            tuple(estimates), correlation, sensitivities,
            tuple(zip((one for one, _ in self.tests), before, strict=True)),
            tuple(zip((one for one, _ in self.tests), after, strict=True)),
            fitted.with_sources(sources), float(r[:n] @ r[:n]), n, self.simulations, seed, interrupted,
        )  # fmt: skip

    def slopes(self, u: np.ndarray) -> np.ndarray:
        """One-sided differences of the softened residuals, into the range, (n + m, m); the columns run two at a time."""
        away = np.where(u < 0.5, DIFFERENCE, -DIFFERENCE)
        r = self.several([u, *(u + step * e for step, e in zip(away, np.eye(u.size), strict=True))])
        return np.column_stack([(_soft(x) - _soft(r[0])) / step for x, step in zip(r[1:], away, strict=True)])

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Central differences of the residuals, one-sided at the ends of the range, (n + m, m)."""
        ends = [np.clip(u + step * e, 0.0, 1.0) for e in np.eye(u.size) for step in (DIFFERENCE, -DIFFERENCE)]
        r = self.several(ends)
        pairs = zip(ends[::2], ends[1::2], r[::2], r[1::2], strict=True)
        return np.column_stack([(above - below) / float(np.sum(up - down)) for up, down, above, below in pairs])

    def several(self, points: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Residuals at several points, two at a time: the kernel holds no lock while it runs."""
        pool = ThreadPoolExecutor(max_workers=2)
        try:
            return list(pool.map(self.residuals, points))
        finally:  # an interrupt, too, must not wait for what has not begun
            pool.shutdown(cancel_futures=True)

    def relative(self, J: np.ndarray, u: np.ndarray) -> np.ndarray:
        values = np.array([key.from_unit(float(x)) for key, x in zip(self.keys, u, strict=True)])
        slopes = np.array([key.slope(v) for key, v in zip(self.keys, values, strict=True)])
        result: np.ndarray = J * np.array(self.weights)[:, None] * (values / slopes)[None, :]
        return result

    def estimate(self, k: int, u: np.ndarray, spread: np.ndarray, correlation: np.ndarray) -> Estimate:
        key = self.keys[k]
        value = key.from_unit(float(u[k]))
        error = abs(key.slope(value)) * float(spread[k])
        others = np.abs(np.delete(correlation[k], k))
        partner = int(np.argmax(np.abs(correlation[k]) - np.eye(len(u))[k])) if others.size else k
        if u[k] < 1e-3 or u[k] > 1.0 - 1e-3:
            verdict, good = "at the end of its range", False
        elif error > 0.2 * abs(value):
            verdict, good = "not identifiable: the evidence hardly changes with it", False
        elif others.size and float(others.max()) > 0.995:
            verdict, good = f"not identifiable apart from {self.keys[partner].key}", False
        else:
            verdict, good = "identifiable", True
        if key.along:
            verdict += "; fitted along, for with the scenario's value the evidence was not explained"
        return Estimate(key.key, key.unit, value, error, key.low, key.high, good, verdict)


def _as_tested(scenario: Scenario, evidence: Evidence, changes: dict[str, object]) -> Scenario:
    test = scenario.with_(changes) if changes else scenario
    record = {"record.duration": evidence.duration, "record.sample_rate": evidence.sample_rate}
    if evidence.clock_ratio is not None:
        record["tracking.clock_ratio"] = test.tracking.clock_ratio * evidence.clock_ratio
    return test.with_si(record)


def _lines(test: Scenario, evidence: Evidence) -> Simulated:
    motion = simulate(test, channels=("T_d",))
    wanted = {o.line for o in evidence.observations} | {"drive_1"}
    expected = [
        line
        for line in expected_lines(test, PASSBAND * motion.sample_rate)
        if line.name in wanted or line.kind == "array mode"
    ]
    spectrum = amplitude_spectrum(motion["T_d"], motion.sample_rate)
    table = lines_at_known_clock(motion["T_d"], motion.sample_rate, expected)
    return Simulated(table, spectrum.amplitude, spectrum.resolution)


def _weight(o: Observation, model_error: float) -> float:
    """Standard deviation that the difference of one observation is measured by: its own, and the model's."""
    if o.form in ("amplitude", "nearest_bin"):
        return math.hypot(o.uncertainty / o.value, model_error)
    if o.form == "frequency":
        return math.hypot(o.uncertainty / o.value, 2e-4)
    if o.form == "decay":
        return math.hypot(o.uncertainty / max(abs(o.value), 1e-6), 0.01)
    return math.hypot(o.uncertainty, PHASE_FLOOR)


def _difference(o: Observation, value: float) -> float:
    """Logarithm of the ratio of amplitudes, relative difference of frequency and decay, difference of phases."""
    if not math.isfinite(value):
        return _NOWHERE * _weight(o, MODEL_FLOOR)
    if o.form in ("amplitude", "nearest_bin"):
        return math.log(max(value, 1e-12) / o.value)
    if o.form == "phase":
        return math.remainder(value - o.value, 2.0 * math.pi)
    return (value - o.value) / max(abs(o.value), 1e-6)


def _soft(r: np.ndarray) -> np.ndarray:
    """Large residuals count by their square root, so that a start far off still shows the way."""
    size = np.abs(r)
    result: np.ndarray = np.sign(r) * np.where(size < 5.0, size, np.sqrt(np.maximum(10.0 * size - 25.0, 0.0)))
    return result
