"""Variation of keys: levels taken one by one, and distributions that are sampled."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np

from microvib.errors import ScenarioError, did_you_mean, quoted_value
from microvib.model.scenario import Scenario
from microvib.units import Quantity, convert

MAX_LEVELS = 1_000_000
ARRAY = ("array.from", "array.fem")
"""Keys whose levels are arrays, read when the campaign is made."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,59}")
RESERVED_NAMES = (
    "array", "case", "line", "state", "reason", "note", "status", "amplitude", "frequency", "bin_amplitude", "phase", "decay",
    "peak", "rms", "stuck_output", "verdict", "record", "gaps",
)  # fmt: skip
"""Names that columns of the results have, which no factor may have."""
_FACTOR = Quantity("", "factor on the scenario's values")
_ScenarioEntries = dict[str, tuple[Any, Quantity | None]]


def is_number(value: Any) -> bool:
    """Whether a value is a number; True and False are words."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


@dataclass(frozen=True)
class Varied:
    """Varied quantity: a key of the scenario, several that take one value, or a factor on several."""

    key: str
    _: KW_ONLY
    unit: str = ""
    display: str = ""
    keys: tuple[str, ...] = ()
    """Keys of the scenario that it stands for, where that is not ``key`` alone."""
    base: tuple[float, ...] = ()
    """Values of those keys that it is a factor on; none where it is their value."""

    @property
    def numeric(self) -> bool:
        """Whether all its values are numbers."""
        return True

    def changes(self, value: Any) -> dict[str, Any]:
        """Changes of the scenario's keys for ``value``."""
        if self.base:
            return {key: value * base for key, base in zip(self.keys, self.base, strict=True)}
        return dict.fromkeys(self.keys or (self.key,), value)


@dataclass(frozen=True)
class Levels(Varied):
    """Values of one key, each combined with all levels of the others."""

    values: tuple[Any, ...]
    """SI numbers, texts, or for an array its parameters."""
    labels: tuple[str, ...]

    @property
    def numeric(self) -> bool:
        """Whether all its values are numbers."""
        return all(map(is_number, self.values))


@dataclass(frozen=True)
class Uncertain(Varied):
    """A key with a distribution; truncated, its probability lies between ``lower`` and ``upper``."""

    kind: str
    shape: tuple[float, ...]
    """normal: mean, deviation; uniform: low, high; triangular: low, peak, high; log-normal: median,
    factor.
    """
    lower: float
    upper: float

    def show(self, value: float) -> str:
        """A value in the display unit."""
        return Quantity(self.unit, "", display=self.display).show(value)

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Values (n,) at the probabilities ``u`` (n,)."""
        frozen = self._frozen()
        low, high = frozen.cdf(self.lower), frozen.cdf(self.upper)
        return np.clip(frozen.ppf(low + u * (high - low)), self.lower, self.upper)

    @property
    def inside(self) -> float:
        """Probability of the whole distribution that lies between ``lower`` and ``upper``."""
        frozen = self._frozen()
        return float(frozen.cdf(self.upper) - frozen.cdf(self.lower))

    def _frozen(self) -> Any:
        from scipy import stats

        return _KINDS[self.kind].frozen(stats, *self.shape)

    @property
    def text(self) -> str:
        """The distribution in words, in the display unit."""
        values = _KINDS[self.kind].words.format(
            *map(self.show, self.shape), plain=f"{self.shape[1]:.4g}"
        )
        if math.isfinite(self.lower):
            cut = [f"from {self.show(self.lower)}"]
        else:
            cut = []
        if math.isfinite(self.upper):
            cut += [f"to {self.show(self.upper)}"]
        else:
            cut += []
        if self.base:
            on = f"factor on {', '.join(self.keys)}; "
        else:
            on = ""
        return f"{on}{self.kind}, {values}" + (f", cut {' '.join(cut)}" if cut else "")


def variation(scenario: Scenario, key: str, spec: Any) -> Levels | Uncertain:
    """Variation of one key from the study; ScenarioError where it is invalid."""
    where = f"vary.{key}"
    found = _entries(scenario)
    if isinstance(spec, dict) and "scale" in spec:
        return _factor(found, key, spec, where)
    if any(name.startswith(f"{key}.") for name in found):  # a group, which has values whole
        return _of_one_key(key, None, spec, None, where)
    keys = _matching(found, key, where)
    values = {found[name][0] for name in keys}
    value, quantity = values.pop() if len(values) == 1 else None, found[keys[0]][1]
    part = _of_one_key(key, value, spec, quantity, where)
    if "*" in key:
        return replace(part, keys=keys)
    return part


def _factor(
    found: _ScenarioEntries, name: str, spec: dict[str, Any], where: str
) -> Levels | Uncertain:
    """A factor by its own name, which scales several numbers of the scenario."""
    if name in found or name in RESERVED_NAMES or not _NAME.fullmatch(name):
        raise ScenarioError(
            f"{where}: is not allowed as the name of a factor; it has one of its own, up to 60"
            " letters, digits, blanks, dots and"
            f" hyphens, and not {', '.join(RESERVED_NAMES)}"
        )
    keys = _scaled_keys(found, spec["scale"], f"{where}.scale")
    part = _of_one_key(name, 1.0, _factor_values(spec, where), _FACTOR, where)
    return replace(part, keys=keys, base=tuple(found[key][0] for key in keys))


def _scaled_keys(found: _ScenarioEntries, given: Any, where: str) -> tuple[str, ...]:
    """Keys of the numbers that a factor scales, each once."""
    patterns = given if isinstance(given, list) else [given]
    if not patterns or not all(isinstance(pattern, str) for pattern in patterns):
        raise ScenarioError(
            f"{where}: {quoted_value(given)} is not allowed; a list of keys is expected"
        )
    matching = (_matching(found, pattern, f"{where}: {pattern}") for pattern in patterns)
    keys = tuple(dict.fromkeys(key for keys in matching for key in keys))
    for key in keys:
        value, quantity = found[key]
        if not isinstance(value, float) or quantity is None:
            raise ScenarioError(
                f"{where}: {key} is {quoted_value(value)}, not a number that could be scaled"
            )
    return keys


def _factor_values(spec: dict[str, Any], where: str) -> Any:
    """Values of a factor: a list of its own, or the distribution that stands beside ``scale``."""
    rest = {key: value for key, value in spec.items() if key != "scale"}
    if "values" not in rest:
        return rest
    _Reader(where, rest, _FACTOR, 1.0).only(("values",))
    if not isinstance(rest["values"], list):
        raise ScenarioError(
            f"{where}.values: {quoted_value(rest['values'])} is not allowed; a list of factors is"
            " expected"
        )
    return rest["values"]


def _matching(found: _ScenarioEntries, pattern: str, where: str) -> tuple[str, ...]:
    """Keys that a key means in which ``*`` stands for any one step; ScenarioError if there is none."""
    steps = pattern.split(".")
    split = {key: key.split(".") for key in found}
    keys = [
        key
        for key, names in split.items()
        if len(names) == len(steps) and all(map(fnmatchcase, names, steps))
    ]
    if keys:
        return tuple(keys)
    near = [name for name in found if name.split(".")[0] == steps[0]] or list(found)
    suggestion = did_you_mean(pattern, found)
    raise ScenarioError(
        f"{where}: is not a key of the scenario; {suggestion}allowed are {', '.join(near)}"
    )


def keys_of(scenario: Scenario, pattern: str) -> tuple[str, ...]:
    """Keys of the scenario that a key, perhaps with ``*``, means."""
    if "*" in pattern:
        return _matching(_entries(scenario), pattern, pattern)
    return (pattern,)


def _entries(scenario: Scenario) -> _ScenarioEntries:
    return {name: (value, quantity) for name, value, quantity in scenario.entries()}


def _of_one_key(
    key: str, value: Any, spec: Any, quantity: Quantity | None, where: str
) -> Levels | Uncertain:
    if isinstance(spec, list):
        return _levels_of_list(key, spec, quantity, where)
    if not isinstance(spec, dict):
        raise ScenarioError(
            f"{where}: {spec!r} is not allowed; write a list of values, a grid or a distribution"
        )
    if quantity is None:
        raise ScenarioError(
            f"{where}: is not a physical quantity; write a list of its values, such as [{value}]"
        )
    reader = _Reader(where, spec, quantity, value)
    if "distribution" in spec:
        return _distribution(key, reader)
    return _grid(key, reader)


def _levels_of_list(key: str, values: list[Any], quantity: Quantity | None, where: str) -> Levels:
    if not values:
        raise ScenarioError(f"{where}: the list is empty; at least one value is expected")
    read = tuple(_level(item, quantity, f"{where}.{k}") for k, item in enumerate(values))
    return Levels(key, read, tuple(map(str, values)), **(_shown_in(quantity) if quantity else {}))


def _shown_in(quantity: Quantity) -> dict[str, Any]:
    return {"unit": quantity.unit, "display": quantity.display or quantity.unit}


def _level(item: Any, quantity: Quantity | None, where: str) -> Any:
    """A value of a list in SI; what is not a number (a word such as ``rigid``) is left to the
    scenario's own check.
    """
    if quantity is None or not (isinstance(item, str) or is_number(item)):
        return item
    if isinstance(item, str) and not any(c.isdigit() for c in item):
        return item
    return number(item, quantity, where)


def number(item: Any, quantity: Quantity, where: str) -> float:
    """A number with its unit as SI; ScenarioError if it is not one."""
    if isinstance(item, str):
        try:
            return convert(item, quantity.unit)
        except ValueError as error:
            raise ScenarioError(f"{where}: {item!r} {error} ({quantity.meaning})") from None
    if not is_number(item) or not math.isfinite(item):
        raise ScenarioError(f"{where}: {item!r} is not a quantity ({quantity.meaning})")
    if quantity.unit and item != 0:  # nought is nought in every unit
        raise ScenarioError(
            f"{where}: {item} needs a unit, such as '{item} {quantity.display or quantity.unit}'"
        )
    return float(item)


@dataclass(frozen=True)
class _Reader:
    """Reads the numbers of one entry, each asked for by its name."""

    where: str
    spec: dict[str, Any]
    quantity: Quantity
    now: Any
    """The scenario's own value."""

    def only(self, allowed: tuple[str, ...]) -> None:
        unknown = [name for name in self.spec if name not in allowed]
        if unknown:
            raise ScenarioError(
                f"{self.where}.{unknown[0]}: unknown key; allowed here are {', '.join(allowed)}"
            )

    def number(self, name: str, default: float | None = None) -> float:
        if name not in self.spec and default is not None:
            return default
        if name not in self.spec:
            raise ScenarioError(f"{self.where}.{name}: missing ({self.quantity.meaning})")
        return number(self.spec[name], self.quantity, f"{self.where}.{name}")

    def ratio(self, name: str) -> float:
        value = number(
            self.spec[name], Quantity("", "a plain number or percent"), f"{self.where}.{name}"
        )
        if not value > 0.0:
            raise ScenarioError(
                f"{self.where}.{name}: {self.spec[name]!r} is not allowed; it must be greater than"
                " 0"
            )
        return value

    def centre(self, name: str) -> float:
        """The value ``name``, or the scenario's own."""
        known = self.now is not None or name in self.spec
        self.check(
            known, f"has no one value in the scenario to start from; give {name}, or scale the keys"
        )
        return self.number(name, self.now if isinstance(self.now, float) else None)

    def check(self, right: bool, text: str) -> None:
        if not right:
            raise ScenarioError(f"{self.where}: {text}")


def _grid(key: str, r: _Reader) -> Levels:
    r.only(("from", "to", "count", "spacing"))
    first, last = r.number("from"), r.number("to")
    count: Any = r.spec.get("count")
    spacing = r.spec.get("spacing", "linear")
    right = is_number(count) and isinstance(count, int) and 2 <= count <= MAX_LEVELS
    r.check(
        right, f"count: {count!r} is not allowed; a whole number from 2 to {MAX_LEVELS} is expected"
    )
    r.check(
        spacing in ("linear", "logarithmic"),
        f"spacing: {spacing!r} is not allowed; write linear or logarithmic",
    )
    positive = spacing == "linear" or (first > 0.0 and last > 0.0)
    r.check(positive, "a logarithmic grid goes from and to values greater than 0")
    values = (np.linspace if spacing == "linear" else np.geomspace)(first, last, count)
    return Levels(
        key, tuple(values.tolist()), tuple(map(r.quantity.show, values)), **_shown_in(r.quantity)
    )


def _normal(r: _Reader) -> tuple[float, ...]:
    mean = r.centre("mean")
    r.check(
        ("deviation" in r.spec) != ("relative_deviation" in r.spec),
        "give deviation or relative_deviation",
    )
    if "deviation" in r.spec:
        deviation = r.number("deviation")
    else:
        deviation = abs(mean) * r.ratio("relative_deviation")
    r.check(deviation > 0.0, "deviation: must be greater than 0")
    return mean, deviation


def _uniform(r: _Reader) -> tuple[float, ...]:
    r.check(
        ("within" in r.spec) != ("low" in r.spec),
        "give low and high, or within (a fraction of the value)",
    )
    if "within" in r.spec:
        part, value = r.ratio("within"), r.centre("value")
        low, high = sorted((value * (1.0 - part), value * (1.0 + part)))
    else:
        low, high = r.number("low"), r.number("high")
    r.check(low < high, "low: must be below high")
    return low, high


def _triangular(r: _Reader) -> tuple[float, ...]:
    low, peak, high = r.number("low"), r.centre("peak"), r.number("high")
    r.check(low <= peak <= high and low < high, "low, peak and high: must rise in this order")
    return low, peak, high


def _log_normal(r: _Reader) -> tuple[float, ...]:
    median = r.centre("median")
    r.check(
        "factor" in r.spec, "factor: missing (68 % lie between median / factor and median x factor)"
    )
    factor = r.ratio("factor")
    r.check(median > 0.0, "median: must be greater than 0")
    r.check(factor > 1.0, f"factor: {r.spec['factor']!r} is not allowed; it must be greater than 1")
    return median, factor


class _Kind(NamedTuple):
    """A kind of distribution."""

    allowed: tuple[str, ...]
    """Keys that a study may give, besides ``distribution``, ``lower`` and ``upper``."""
    read: Callable[[_Reader], tuple[float, ...]]
    """Its shape."""
    frozen: Callable[..., Any]
    """The distribution of a shape, of ``scipy.stats``, which takes long to import."""
    words: str
    """The shape in words; ``plain`` is its second number without a unit."""


_KINDS = {
    "normal": _Kind(
        ("mean", "deviation", "relative_deviation"), _normal,
        lambda stats, mean, deviation: stats.norm(mean, deviation), "mean {0}, deviation {1}",
    ),
    "uniform": _Kind(
        ("low", "high", "within"), _uniform, lambda stats, low, high: stats.uniform(low, high - low), "{0} to {1}",
    ),
    "triangular": _Kind(
        ("low", "peak", "high"), _triangular,
        lambda stats, low, peak, high: stats.triang((peak - low) / (high - low), low, high - low), "{0} to {2}, peak {1}",
    ),
    "log-normal": _Kind(
        ("median", "factor"), _log_normal,
        lambda stats, median, factor: stats.lognorm(math.log(factor), scale=median), "median {0}, factor {plain}",
    ),
}  # fmt: skip


def _distribution(key: str, r: _Reader) -> Uncertain:
    kind = r.spec["distribution"]
    known = isinstance(kind, str) and kind in _KINDS
    r.check(known, f"distribution: {kind!r} is not allowed; write {', '.join(_KINDS)}")
    r.only(("distribution", *_KINDS[kind].allowed, "lower", "upper"))
    shape = _KINDS[kind].read(r)
    lower, upper = r.number("lower", -math.inf), r.number("upper", math.inf)
    r.check(lower < upper, "lower: must be below upper")
    uncertain = Uncertain(key, kind, shape, lower, upper, **_shown_in(r.quantity))
    r.check(
        uncertain.inside > 1e-6, "lower and upper leave nothing of the distribution between them"
    )
    return uncertain
