"""Assumptions of a published test, drawn from their ranges, and the scenarios of its cases under
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from microvib.errors import ScenarioError, error_context
from microvib.io.file_access import WORKING_FOLDER
from microvib.io.named import test_names
from microvib.io.scenario_file import load_scenario, scenario_of
from microvib.model.scenario import Scenario
from microvib.studies.campaign.variation import keys_of, number
from microvib.units import Quantity, convert
from microvib.validation.cases_file import AssumedRange, Case, CasesTest

SEED = 20180516
"""Seed of the design from which assumptions are drawn: every test has the same."""


@dataclass(frozen=True)
class Assumption:
    """One assumption with its range in SI."""

    name: str
    range: AssumedRange
    quantity: Quantity
    """Unit and meaning of its values."""
    low: float
    central: float
    high: float
    factor: float = 1.0
    """Size of the unit, where it sets a key: the key is value times factor times the keys ``of``."""

    def at(self, part: float) -> float:
        """Value at a part of the range, from 0 to 1."""
        if self.range.spacing == "logarithmic":
            return self.low * (self.high / self.low) ** part
        return self.low + part * (self.high - self.low)

    def show(self, value: float) -> str:
        """A value with its unit."""
        return self.quantity.show(value)


@dataclass(frozen=True)
class Deciding:
    """An assumption, or a combination of some, with its values over draws: it may decide what
    holds.
    """

    name: str
    quantity: Quantity
    values: np.ndarray
    """In SI, (draws,)."""
    logarithmic: bool


@dataclass(frozen=True)
class DescribedDrive:
    """The drive of a test: its scenario, cases and assumptions."""

    test: CasesTest
    base: Scenario

    @cached_property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Assumptions in the order of the file, read by the units of their keys."""
        found = []
        for name, given in self.test.assumed.items():
            with error_context(f"assumed.{name}"):
                found.append(self._assumption(name, given))
        return tuple(found)

    def _assumption(self, name: str, given: AssumedRange) -> Assumption:
        quantity, factor = self._quantity(name, given)
        low, central, high = (
            number(getattr(given, end), quantity, end) for end in ("low", "central", "high")
        )
        if not low < high or not low <= central <= high:
            raise ScenarioError(
                f"low, central and high: {quantity.show(low)}, {quantity.show(central)} and"
                f" {quantity.show(high)} do not rise in this order"
            )
        if given.spacing == "logarithmic" and not low > 0.0:
            raise ScenarioError("low: must be greater than 0 where spacing is logarithmic")
        return Assumption(name, given, quantity, low, central, high, factor)

    def _quantity(self, name: str, given: AssumedRange) -> tuple[Quantity, float]:
        if given.scale:
            for key in given.scale:
                self._declared(key)
            return Quantity("", "factor"), 1.0
        if not given.sets:
            return self._declared(name), 1.0
        unit = self._declared(given.sets).unit
        product = "*".join(filter(None, [*(self._declared(x).unit for x in given.of), given.unit]))
        try:
            factor = convert(f"1 {product}", unit)
        except ValueError as error:
            raise ScenarioError(
                f"unit: the product of {', '.join([*given.of, given.unit or 'a plain number'])}"
                f" {error} ({given.sets})"
            ) from None
        return Quantity(
            given.unit, f"{given.sets} over the product of {', '.join(given.of)}"
        ), factor

    def _declared(self, key: str) -> Quantity:
        """Declaration of a key of the scenario or of a case; ScenarioError where it has none."""
        for scenario in self._trials:
            declared = {name: quantity for name, _, quantity in scenario.entries()}
            try:
                names = keys_of(scenario, key)
            except ScenarioError:
                continue
            if names[0] in declared and isinstance(declared[names[0]], Quantity):
                found = declared[names[0]]
                assert found is not None
                return found
        raise ScenarioError(
            f"{key}: is no physical quantity of the scenario in any case; a dotted key with a"
            " number, such as motor.current, is expected"
        )

    @cached_property
    def _trials(self) -> tuple[Scenario, ...]:
        """The scenario, and those of all cases before assumptions."""
        return (self.base, *(self._set(name, case) for name, case in self.test.cases.items()))

    def _set(self, name: str, case: Case) -> Scenario:
        with error_context(f"cases.{name}.set"):
            return self.base.with_(case.set)

    def check_cases(self) -> None:
        """Read each case by itself, so that what is wrong with one is told as its own."""
        for name, case in self.test.cases.items():
            self._set(name, case)

    def central_values(self) -> dict[str, float]:
        """Central value of each assumption."""
        return {one.name: one.central for one in self.assumptions}

    def drawn_values(self, draws: int) -> list[dict[str, float]]:
        """Values of so many draws: points of a scrambled Sobol sequence with a fixed seed, so that
        more draws begin with the same ones.
        """
        from scipy.stats import qmc

        if not self.assumptions:
            return [{} for _ in range(draws)]
        sequence = qmc.Sobol(len(self.assumptions), scramble=True, seed=SEED)
        points = sequence.random(2 ** math.ceil(math.log2(max(draws, 1))))[:draws]
        return [
            {one.name: one.at(float(u)) for one, u in zip(self.assumptions, point, strict=True)}
            for point in points
        ]

    def deciding(self, drawn: np.ndarray) -> list[Deciding]:
        """Assumptions and their combinations over draws, whose values are ``drawn`` (draws,
        assumptions).
        """
        columns = dict(zip(self.test.assumed, drawn.T, strict=True))
        alone = [
            Deciding(x.name, x.quantity, columns[x.name], x.range.spacing == "logarithmic")
            for x in self.assumptions
        ]
        return alone + [
            Deciding(
                name,
                Quantity(one.unit, ""),
                one.factor * np.prod([columns[x] ** p for x, p in one.powers.items()], axis=0),
                True,
            )
            for name, one in self.test.combined.items()
        ]

    def scenario(self, name: str, values: Mapping[str, float]) -> Scenario:
        """Scenario of a case under values of the assumptions: what the case sets, then the
        assumptions in their order, then what it scales.
        """
        case = self.test.cases[name]
        scenario = self._set(name, case)
        changes: dict[str, float] = {}
        for one in self.assumptions:
            with error_context(f"assumed.{one.name}"):
                changes |= _assumed_values(scenario, changes, one, values[one.name])
        with error_context(f"cases.{name}.scale"):
            for pattern, factor in case.scale.items():
                keys = keys_of(scenario, pattern)
                changes |= {key: factor * _value(scenario, changes, key) for key in keys}
        return scenario.with_si(changes) if changes else scenario

    def held_keys(self) -> Iterator[str]:
        """Keys of drive and load that are neither given nor assumed: held at one value."""
        assumed = [
            pattern
            for one in self.test.assumed.items()
            for pattern in (one[1].scale or (one[1].sets or one[0],))
        ]
        set_in_cases = [
            key for case in self.test.cases.values() for key in (*case.set, *case.scale)
        ]
        told = [*self.test.given, *assumed, *set_in_cases]
        for key, value, quantity in self.base.entries():
            group = key.split(".")[0]
            if group in ("record", "solver", "spacecraft") or quantity is None:
                continue
            if not isinstance(value, float) or value == 0.0:
                continue
            if not any(_covers(pattern, key) for pattern in told):
                yield key


def _covers(pattern: str, key: str) -> bool:
    """Whether a key, perhaps with ``*``, or a group is or holds a key."""
    steps, names = pattern.split("."), key.split(".")
    return len(steps) <= len(names) and all(
        step in ("*", name) for step, name in zip(steps, names, strict=False)
    )


def _value(scenario: Scenario, changes: Mapping[str, float], key: str) -> float:
    """Value of a key, as it was changed or as the scenario has it."""
    value = changes[key] if key in changes else scenario[key]
    if not isinstance(value, float):
        raise ScenarioError(f"{key}: is {value!r}, not a number that could be scaled")
    return value


def _assumed_values(
    scenario: Scenario, changes: Mapping[str, float], one: Assumption, value: float
) -> dict[str, float]:
    """Values of the keys under one assumption; keys that a case has not are left out."""
    given = one.range
    if given.scale:
        keys = [key for pattern in given.scale for key in _there(scenario, pattern)]
        return {key: value * _value(scenario, changes, key) for key in keys}
    if not given.sets:
        return dict.fromkeys(_there(scenario, one.name), value)
    product = math.prod(_value(scenario, changes, key) for key in given.of)
    return dict.fromkeys(_there(scenario, given.sets), value * one.factor * product)


def _there(scenario: Scenario, pattern: str) -> tuple[str, ...]:
    """Keys that a key means; none where a ``*`` finds none in this case."""
    if "*" not in pattern:
        return (pattern,)
    try:
        return keys_of(scenario, pattern)
    except ScenarioError:
        return ()


def described_drive(test: CasesTest, name: str) -> DescribedDrive:
    """Drive of a test that was read from the catalog or the file ``name``.

    Raises ScenarioError for a scenario, a case or an assumption that is not allowed: one sentence.
    """
    where = WORKING_FOLDER
    if name not in test_names():
        where = WORKING_FOLDER.in_folder_of(name)
    if isinstance(test.scenario, dict):
        base = scenario_of(dict(test.scenario), "scenario", dict(test.set), where)
    else:
        file = where.under("scenario").path(test.scenario)
        source = str(file) if Path(file).is_file() else test.scenario
        base = load_scenario(source, dict(test.set))
    drive = DescribedDrive(test, base)
    drive.check_cases()
    for key in test.given:
        with error_context(f"given.{key}"):
            base[key]
    for case in test.cases:
        drive.scenario(case, drive.central_values())
    return drive
