"""Which of several effects the evidence asks for: likelihood ratios between models with and without
each, forwards and back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from microvib.errors import OptionError, did_you_mean
from microvib.model.scenario import Scenario
from microvib.results import COUNT, Column, Measure
from microvib.studies.evidence import Evidence
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.images import (
    IMPERFECTIONS_PREFIX,
    PHASE_IMBALANCE_NAMES,
    symmetric_solutions,
)
from microvib.studies.identify.keys import (
    DAC_BITS,
    DEFAULT_INTEGER_RANGES,
    FitKey,
    IntegerKey,
    parse_fit,
)
from microvib.studies.identify.problem import (
    BestSoFar,
    ErrorModel,
    FitProgress,
    Problem,
    TestOverrides,
    cost,
)
from microvib.studies.identify.scattered import minus_two_log_likelihood, refine_noisy_optimum
from microvib.studies.identify.search import (
    COARSE_COST_TOLERANCE,
    MAX_DESCENT_STEPS,
    Descent,
    Optimum,
    descend_all,
)
from microvib.studies.identify.whole import with_integers

FALSE_ALARM_PROBABILITY = 0.05
"""Probability that evidence without any of the effects asks for one."""
POINTS, ENDS = 8, 2
"""Points at which a new effect is looked at, and how many of them are fitted from."""


@dataclass(frozen=True)
class Effect:
    """Optional effect of a drive, by its key."""

    without: dict[str, object]
    """Changes that make a drive without it."""
    typical: Callable[[Scenario], dict[str, object]]
    """Changes that make one with a typical size of it; unused where the scenario has it already."""
    keys: tuple[str, ...] = ()
    """Fitted keys of the effect."""
    whole: IntegerKey | None = None
    """Its whole number, each of which is tried."""

    @property
    def parameters(self) -> int:
        """Parameters of the effect."""
        return len(self.keys) + (self.whole is not None)


def _detent(scenario: Scenario) -> dict[str, object]:
    return {"motor.detent_torque": 0.05 * scenario.motor.torque_constant * scenario.motor.current}


def _flux(scenario: Scenario) -> dict[str, object]:
    order = scenario.motor.detent_periods - 1
    return {"motor.flux_harmonics": [{"order": order, "amplitude": 0.01, "phase": 0.0}]}


def _presliding(scenario: Scenario) -> dict[str, object]:
    return {"friction.presliding": {"stiffness": _stiffness(scenario)}}


def _hysteresis(scenario: Scenario) -> dict[str, object]:
    return {"reducer.hysteresis": {"loss": 1e-4, "stiffness": 0.5 * _stiffness(scenario)}}


def _stiffness(scenario: Scenario) -> float:
    if scenario.reducer.stiffness == "rigid":
        return 1e4
    return scenario.reducer.stiffness


_IMPERFECT = tuple(IMPERFECTIONS_PREFIX + name for name in PHASE_IMBALANCE_NAMES)
EFFECTS = {
    "driver.imperfections": Effect(
        dict.fromkeys(_IMPERFECT, 0.0), lambda _: dict.fromkeys(_IMPERFECT[1:3], 1e-3), _IMPERFECT
    ),
    DAC_BITS: Effect(
        {DAC_BITS: None},
        lambda _: {DAC_BITS: 8},
        whole=IntegerKey(DAC_BITS, *DEFAULT_INTEGER_RANGES[DAC_BITS]),
    ),
    "motor.detent_torque": Effect({"motor.detent_torque": 0.0}, _detent, ("motor.detent_torque",)),
    "motor.flux_harmonics": Effect(
        {"motor.flux_harmonics": []},
        _flux,
        ("motor.flux_harmonics.0.amplitude", "motor.flux_harmonics.0.phase"),
    ),
    "friction.presliding": Effect(
        {"friction.presliding": None}, _presliding, ("friction.presliding.stiffness",)
    ),
    "reducer.hysteresis": Effect(
        {"reducer.hysteresis": None},
        _hysteresis,
        ("reducer.hysteresis.loss", "reducer.hysteresis.stiffness"),
    ),
    "reducer.transmission_error": Effect(
        {"reducer.transmission_error": []},
        lambda _: {"reducer.transmission_error": [{"order": 2, "amplitude": 1e-4}]},
        ("reducer.transmission_error.0.amplitude",),
    ),
}
"""The effects that may be candidates."""

_CHI_SQUARE = Measure(form=".3g")


@dataclass(frozen=True)
class Candidate:
    """How much the evidence asks for one effect."""

    effect: Annotated[str, Column("effect", "effect", role="key")]
    selected: bool
    gain: Annotated[float, Column("chi_square_lower_by", "chi-square lower by", _CHI_SQUARE)]
    """By how much chi-square is lower with it: beside all others that were selected."""
    parameters: Annotated[int, Column("parameters", "parameters", COUNT)]
    """Fitted for it."""
    limit: Annotated[float, Column("asked_above", "asked for above", _CHI_SQUARE)]
    """Threshold that its gain must exceed."""
    explained: bool = True
    """Whether the model with all that was selected explains the evidence; where not, an effect that
    is not selected is not told.
    """

    @property
    def answer(self) -> Annotated[str, Column("evidence", "evidence")]:
        """Answer of the evidence."""
        if self.explained:
            unasked = "does not support it"
        else:
            unasked = "not told"
        if self.selected:
            return "asks for it"
        return unasked

    @property
    def sentence(self) -> str:
        """In words."""
        if self.selected or self.explained:
            what = f"the evidence {self.answer}"
        else:
            what = f"{self.answer}: no model explains the evidence"
        fitted = f"{self.parameters} parameter{'s' if self.parameters > 1 else ''}"
        return f"{self.effect}: {what} (chi-square lower by {self.gain:.3g} with {fitted}; more than {self.limit:.3g} is asked)"


def effects_of(names: Sequence[str]) -> list[str]:
    """Names of candidates, ``all`` being all of them; OptionError for another."""
    found = list(
        dict.fromkeys(one for name in names for one in (EFFECTS if name == "all" else [name]))
    )
    for name in found:
        if name == "friction.torque_noise":
            raise OptionError(
                "select",
                "not identifiable from lines: its own are random; see the noise floor in the report",
                name,
            )
        if name not in EFFECTS:
            near = did_you_mean(name, list(EFFECTS))
            raise OptionError(
                "select",
                f"is not a candidate; {near}allowed are {', '.join(EFFECTS)} and all",
                name,
            )
    return found


def with_effects(scenario: Scenario, candidates: Sequence[str], on: Sequence[str]) -> Scenario:
    """The scenario with those of the candidates that are ``on`` and without the others."""
    for name in candidates:
        effect = EFFECTS[name]
        has = any(
            scenario[key] != value and scenario[key] != () for key, value in effect.without.items()
        )
        if name not in on:
            scenario = scenario.with_si(effect.without)
        elif not has:
            scenario = scenario.with_si(effect.typical(scenario))
    return scenario


Known = tuple[Problem, Optimum]


@dataclass
class Selector:
    """Models with some of the candidates, and with all of the whole numbers in ``wholes``, fitted
    to the evidence.
    """

    scenario: Scenario
    evidence: Sequence[tuple[Evidence, TestOverrides]]
    keys: Sequence[FitKey]
    candidates: Sequence[str]
    trust: ErrorModel
    seed: int
    starts: int
    progress: FitProgress | None
    wholes: Sequence[IntegerKey] = ()
    known: dict[frozenset[str], Known] = field(default_factory=dict)

    def run(
        self,
    ) -> tuple[Scenario, list[tuple[Evidence, TestOverrides]], list[FitKey], tuple[Candidate, ...]]:
        """Scenario, evidence with what its tests have of their own, the keys, and what is said of
        each candidate.
        """
        chosen: list[str] = []
        while left := [name for name in self.candidates if name not in chosen]:
            told = {name: self.raw_gain([*chosen, name], name) for name in left}
            best = max(left, key=lambda name: told[name] / self.limit(name))
            if told[best] <= self.limit(best):
                break
            chosen.append(best)
        # off again: what a later one explains as well, and what is no more than the scatter that is
        # left
        for name in list(chosen):
            if self.gain(chosen, name) <= self.limit(name):
                chosen.remove(name)
        said = []
        for name in self.candidates:
            gain = self.gain([*chosen, *([] if name in chosen else [name])], name)
            problem, end = self.fitted(chosen)
            fit = goodness(problem, end.r).explained
            said.append(
                Candidate(
                    name, name in chosen, gain, EFFECTS[name].parameters, self.limit(name), fit
                )
            )
        scenario, tests = self.with_(chosen, self._numbers(self.fitted(chosen)))
        return scenario, tests, [*self.keys, *self.keys_of(scenario, chosen)], tuple(said)

    def limit(self, name: str) -> float:
        """Gain that one candidate reaches without reason so seldom that all of them together do in
        CHANCE of all cases.

        Each of several whole numbers is a candidate by itself: against a model that is as simple, a
        gain above a limit has at most the chance of a normal deviation above its root.
        """
        from scipy.stats import chi2

        effect, chance = EFFECTS[name], FALSE_ALARM_PROBABILITY / len(self.candidates)
        if effect.whole is not None:
            chance *= 2.0 / len(effect.whole.numbers)
        return float(chi2.isf(chance, effect.parameters))

    def raw_gain(self, models: Sequence[str], name: str) -> float:
        """By how much chi-square is lower with an effect beside others; where that counts, those
        are fitted again from there.
        """
        fewer, whole = [one for one in models if one != name], self.fitted(models)
        problem, best = self.fitted(fewer)
        if minus_two_log_likelihood(problem, best) - minus_two_log_likelihood(*whole) > self.limit(
            name
        ):
            there = whole[0].named(whole[1].x)
            start = problem.point(
                {label: there.get(label, value) for label, value in problem.named(best.x).items()}
            )
            again = refine_noisy_optimum(
                problem, [Descent(problem, start).run(MAX_DESCENT_STEPS, COARSE_COST_TOLERANCE)]
            )
            self.known[self._what(fewer)] = min(
                (problem, best), again, key=lambda known: minus_two_log_likelihood(*known)
            )
        return max(
            minus_two_log_likelihood(*self.fitted(fewer)) - minus_two_log_likelihood(*whole), 0.0
        )

    def gain(self, models: Sequence[str], name: str) -> float:
        """Gain over the scatter that the larger model leaves, as what is asked for must be
        where nothing more comes.
        """
        problem, best = self.fitted(models)
        return self.raw_gain(models, name) / max(goodness(problem, best.r).ratio, 1.0)

    def with_(
        self, on: Sequence[str], numbers: Mapping[str, object]
    ) -> tuple[Scenario, list[tuple[Evidence, TestOverrides]]]:
        """Scenario and tests with those effects and whole numbers."""
        tests: list[tuple[Evidence, TestOverrides]] = [
            (one, with_effects(own, self.candidates, on) if isinstance(own, Scenario) else own)
            for one, own in self.evidence
        ]
        return with_integers(with_effects(self.scenario, self.candidates, on), tests, numbers)

    def keys_of(self, scenario: Scenario, on: Sequence[str]) -> list[FitKey]:
        """Fitted keys of those effects."""
        return [parse_fit(scenario, text) for name in on for text in EFFECTS[name].keys]

    def fitted(self, on: Iterable[str]) -> Known:
        """The model with those effects and all whole numbers; see ``_fitted``."""
        return self._fitted(self._what(on))

    def _what(self, on: Iterable[str]) -> frozenset[str]:
        return frozenset(on) | {key.key for key in self.wholes}

    def _fitted(self, what: frozenset[str]) -> Known:
        """The model from all that is known without one of its effects, with each whole number of
        that; the best of these.

        Modes' frequencies are fitted in all.
        """
        if what not in self.known:
            wholes = {name: whole for name in what if (whole := self._whole(name))}
            for name in wholes:  # none of its numbers is a place to begin a search
                self._fitted(what - {name})
            before: list[tuple[str, Known | None]] = [
                (name, known) for name in sorted(what) if (known := self.known.get(what - {name}))
            ]
            found: list[Known] = []
            for name, one in before or [("", None)]:
                numbers = self._numbers(one) if one else {}
                key = wholes.get(name)
                if key:
                    each = [{key.key: number} for number in key.numbers]
                else:
                    each = [{}]
                found += [self._best(self._problem(what, numbers | number), one) for number in each]
            self.known[what] = min(found, key=lambda known: minus_two_log_likelihood(*known))
        return self.known[what]

    def _whole(self, name: str) -> IntegerKey | None:
        fitted = next((key for key in self.wholes if key.key == name), None)
        return fitted or EFFECTS[name].whole

    def _numbers(self, known: Known) -> dict[str, object]:
        """Whole numbers of a model, of all that may be tried."""
        tried = {whole.key for name in self._what(self.candidates) if (whole := self._whole(name))}
        return {name: value for name, value, _ in known[0].scenario.entries() if name in tried}

    def _problem(self, what: frozenset[str], numbers: Mapping[str, object]) -> Problem:
        models = [name for name in self.candidates if name in what]
        scenario, tests = self.with_(models, numbers)
        problem = Problem(
            scenario,
            tests,
            [*self.keys, *self.keys_of(scenario, models)],
            self.trust,
            BestSoFar(self.progress),
        ).with_cartesian()
        while (along := problem.along()) is not None:
            problem = along
        return problem

    def _best(self, problem: Problem, before: Known | None) -> Known:
        """The best of local fits from a smaller model's optimum, with what is new without effect
        and in several sizes.
        """
        from scipy.stats import qmc

        if before:
            then = before[0].named(before[1].x)
        else:
            then = {}
        points = [problem.point(problem.named(problem.start) | then)]
        new = [k for k, key in enumerate(problem.keys) if key.label not in then]
        if new:
            count = POINTS if before else self.starts
            parts = np.zeros((count, len(problem.keys)))
            power = math.ceil(math.log2(count))
            parts[:, new] = qmc.Sobol(len(new), seed=self.seed).random_base2(power)[:count]
            points += [points[0].copy() for _ in parts]
            for point, there in zip(points[1:], problem.coordinates.spread(parts), strict=True):
                point[new] = there[new]
            if before:
                points[0][new] = problem.coordinates.start(
                    [_value_without_effect(key) for key in problem.keys]
                )[new]
        points = [problem.tuned(point) for point in points]
        costs = [cost(r) for r in problem.residuals(points)]
        ends = descend_all(problem, [points[k] for k in np.argsort(costs, kind="stable")[:ENDS]])
        best = min(ends, key=lambda o: o.cost)
        return refine_noisy_optimum(
            problem, [best, *descend_all(problem, symmetric_solutions(problem, best.x))]
        )


def _value_without_effect(key: FitKey) -> float:
    """Value at which an effect does least: 0, the largest stiffness, or else the lower end of a
    range.
    """
    if not key.logarithmic:
        return min(max(0.0, key.low), key.high)
    if key.key.endswith("stiffness"):
        return key.high
    return key.low
