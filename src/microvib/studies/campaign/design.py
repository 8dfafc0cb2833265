"""The cases of a campaign: drawn once, kept, and each the same whoever computes it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.seeds import seeds_of
from microvib.errors import OptionError, ScenarioError, error_context
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.limit_files import is_limit_file, read_limit
from microvib.io.named import read_text
from microvib.io.scenario_file import load_scenario
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import to_plain_data
from microvib.model.scenario import Scenario
from microvib.model.sentences import validate_part
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.studies.campaign.study_file import Correlation, Study
from microvib.studies.campaign.variation import (
    ARRAY,
    Levels,
    Uncertain,
    is_number,
    keys_of,
    variation,
)
from microvib.units import Quantity, Si

MAX_CASES = 10_000_000
TRIAL_QUANTILES = (0.001, 0.999)
"""Quantiles of a distribution at which the scenario is tried when the campaign is made."""
ONE_AT_A_TIME_QUANTILES = (0.05, 0.95)
"""Quantiles that one-at-a-time sampling goes to."""


@dataclass(frozen=True)
class Design:
    """All cases of a campaign. Case numbers run over combinations, then levels, then samples, the
    last fastest.
    """

    study: Study
    base: Scenario
    combinations: tuple[dict[str, Any], ...]
    levels: tuple[Levels, ...]
    uncertain: tuple[Uncertain, ...]
    samples: np.ndarray
    """Values of the sampled keys in SI, (points, keys)."""

    @property
    def shape(self) -> tuple[int, ...]:
        """How many combinations, levels of each key, and samples there are."""
        return len(self.combinations), *(len(x.values) for x in self.levels), self.samples.shape[0]

    @property
    def random(self) -> bool:
        """Whether the points of a sample are draws of anything."""
        return bool(self.uncertain) or self.study.sampling.noise == "each"

    @property
    def cases(self) -> int:
        """Number of cases."""
        return math.prod(self.shape)

    def changes(self, case: int) -> dict[str, Any]:
        """Dotted key of the scenario to value of one case, in SI."""
        parts: dict[str, Levels | Uncertain] = {x.key: x for x in self.levels} | {
            x.key: x for x in self.uncertain
        }
        drawn = self.study.sampling.noise == "each"
        if drawn:
            changed: dict[str, Any] = {**seeds_of(self.base, case % self.samples.shape[0])}
        else:
            changed = {}
        for key, value in self.values(case).items():
            if key in parts:
                changed |= parts[key].changes(value)
            else:
                changed |= _given(self.base, key, value)
        return changed

    def values(self, case: int) -> dict[str, Any]:
        """Value of each varied key in one case, by its name in the study, in SI; a factor to the
        factor.
        """
        combination, *numbers, point = np.unravel_index(case, self.shape)
        chosen = {x.key: x.values[k] for x, k in zip(self.levels, numbers, strict=True)}
        sampled = zip((x.key for x in self.uncertain), self.samples[point].tolist(), strict=True)
        return {**self.combinations[combination], **chosen, **dict(sampled)}

    def labels(self, case: int) -> dict[str, str]:
        """Dotted key to what a person reads of one case: levels as given, sampled values in their
        display unit.
        """
        shows: dict[str, Quantity | Uncertain | None] = {
            name: quantity for name, _, quantity in self.base.entries()
        }
        shows |= {x.key: x for x in self.uncertain}
        named: dict[str, dict[Any, str]] = {
            x.key: dict(zip(map(_hashable, x.values), x.labels, strict=True)) for x in self.levels
        }

        def text(key: str, value: Any) -> str:
            if key in named:
                return named[key][_hashable(value)]
            quantity = shows.get(key)
            if quantity is not None and isinstance(value, float):
                return quantity.show(value)
            return str(value)

        return {key: text(key, value) for key, value in self.values(case).items()}

    def level_text(self, number: int) -> str:
        """A combination of levels as a person reads it, of all that there are; empty where there is
        only one.
        """
        points = self.samples.shape[0]
        if self.cases == points:
            return ""
        sampled = {x.key for x in self.uncertain}
        chosen = {
            key: text for key, text in self.labels(number * points).items() if key not in sampled
        }
        return ", ".join(f"{key} {text}" for key, text in chosen.items())

    def scenario(self, case: int) -> Scenario:
        """Scenario of one case; ScenarioError where it is not allowed."""
        return self.base.with_si(self.changes(case))

    def level_numbers(self, key: str) -> np.ndarray:
        """Which level of a key each case has, (cases,)."""
        k = [x.key for x in self.levels].index(key)
        return self._along(1 + k, np.arange(self.shape[1 + k]))

    def column(self, key: str) -> np.ndarray:
        """Value of one key in every case, (cases,): SI numbers, or texts where they are not all
        numbers.
        """
        for k, uncertain in enumerate(self.uncertain):
            if uncertain.key == key:
                return self._along(-1, self.samples[:, k])
        for k, levels in enumerate(self.levels):
            if levels.key == key:
                return self._along(1 + k, _column(levels.values, levels.labels))
        values = [item.get(key) for item in self.combinations]
        return self._along(
            0, _column(values, ["" if value is None else str(value) for value in values])
        )

    def _along(self, axis: int, values: np.ndarray) -> np.ndarray:
        """Value of every case along one axis of the grid, (cases,)."""
        return np.moveaxis(
            np.broadcast_to(values, (*np.delete(self.shape, axis), values.size)), -1, axis
        ).ravel()

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys that vary."""
        combined = dict.fromkeys(key for combination in self.combinations for key in combination)
        return (*combined, *(x.key for x in self.levels), *(x.key for x in self.uncertain))


def _column(values: Sequence[Any], labels: Sequence[str]) -> np.ndarray:
    if all(map(is_number, values)):
        return np.array(values, dtype=float)
    return np.array(labels, dtype=object)


def _hashable(value: Any) -> Any:
    if isinstance(value, (dict, list)):
        return str(value)
    return value


def read_study(file: Path, files: FileAccess | None = None) -> Study:
    """A study file; ScenarioError with one sentence per problem. What it names is opened with the
    permission ``files``, without one in its own folder.
    """
    if files is None:
        files = WORKING_FOLDER.in_folder_of(str(file))
    data = parse_yaml(read_text(file, "study", ()), str(file))
    with error_context(file):
        data = _with_limit_curve(data, files)
    return validate_part(Study, data, origin=str(file))


def _with_limit_curve(data: Any, files: FileAccess) -> Any:
    """A study's data with the points of the file that its limit names, so that a campaign has all
    that it is judged by.
    """
    if not isinstance(data, Mapping) or not is_limit_file(data.get("limit")):
        return data
    limit = read_limit(files.under("limit").path(data["limit"]))
    curve = limit.torque_curve("a campaign")
    points = [
        {"frequency": f"{f!r} Hz", "amplitude": f"{a!r} N*m"}
        for f, a in zip(curve.frequency, curve.amplitude, strict=True)
    ]
    return {**data, "limit": None, "limit_curve": points}


def read_design(file: Path) -> Design:
    """Design of a study file; ScenarioError with one sentence per problem."""
    return design(read_study(file), WORKING_FOLDER.in_folder_of(str(file)), str(file))


def limit_of(study: Study) -> Limit | None:
    """The limit that a study's cases are judged by; ScenarioError where its band is none, or it has
    a band and no limit.
    """
    try:
        if study.limit_curve is not None:
            points = [(point.frequency, point.amplitude) for point in study.limit_curve]
            return Limit.of_curves(LimitCurve(*zip(*points, strict=True))).within(study.band)
        return Limit.of(None if study.limit is None else Si(study.limit), study.band)
    except OptionError as error:
        raise ScenarioError(str(error)) from None


def design(
    study: Study,
    files: FileAccess = WORKING_FOLDER,
    origin: str = "study",
    scenario: Scenario | None = None,
) -> Design:
    """Draw the cases of a study; its scenario, and arrays that vary, are names of the catalog or of
    ``files``. Another ``scenario`` can take the place of the study's.

    Every level and the ends of every distribution are tried, one by one, so that what cannot be
    computed is known now.
    """
    if scenario is not None:
        with error_context(origin):
            return _draw_cases(study, scenario, files)
    file = files.under("scenario").path(study.scenario)
    base = load_scenario(str(file) if file.is_file() else study.scenario, dict(study.set))
    with error_context(origin):
        return _draw_cases(study, base, files)


def _draw_cases(study: Study, base: Scenario, files: FileAccess) -> Design:
    limit_of(study)
    parts = [_variation(base, key, spec, files) for key, spec in study.vary.items()]
    levels = tuple(x for x in parts if isinstance(x, Levels))
    uncertain = tuple(x for x in parts if isinstance(x, Uncertain))
    each = study.sampling.noise == "each"
    if each and not seeds_of(base, 0):
        raise ScenarioError(
            "sampling.noise: the scenario has none; a friction.torque_noise is expected, or no"
            " draws of it"
        )
    if not parts and not study.cases and not each:
        raise ScenarioError("vary: missing; at least one key to vary, or cases, is expected")
    combinations = list(_combinations(base, study))
    _check_one_place(base, parts, combinations)
    total = (
        max(len(combinations), 1)
        * math.prod(len(x.values) for x in levels)
        * _points(study, len(uncertain))
    )
    if total > MAX_CASES:
        raise ScenarioError(f"makes {total:.3g} cases; at most {MAX_CASES:.0e} are computed")
    _validate_scenario(base, parts)
    return Design(
        study, base, tuple(combinations) or ({},), levels, uncertain, _sample(study, uncertain)
    )


def _combinations(base: Scenario, study: Study) -> Iterator[dict[str, Any]]:
    """Cases that a study lists, each checked in the scenario."""
    for k, item in enumerate(study.cases):
        with error_context(f"cases.{k}"):
            yield _checked(base, item)


def _check_one_place(
    base: Scenario, parts: Sequence[Levels | Uncertain], combinations: Sequence[dict[str, Any]]
) -> None:
    """Refuse a key that is varied twice, or in cases, too."""
    named = [key for part in parts for key in part.keys or (part.key,)]
    twice = {key for key in named if named.count(key) > 1}
    if twice:
        raise ScenarioError(f"{min(twice)} occurs twice in vary; one place is expected")
    patterns = {pattern for item in combinations for pattern in item}
    both = {key for pattern in patterns for key in keys_of(base, pattern)} & set(named)
    if both:
        raise ScenarioError(f"{min(both)} occurs in vary and in cases; one place is expected")


def _variation(base: Scenario, key: str, spec: Any, files: FileAccess) -> Levels | Uncertain:
    if key not in ARRAY:
        return variation(base, key, spec)
    if not isinstance(spec, list) or not spec:
        raise ScenarioError(
            f"vary.{key}: {spec!r} is not allowed; a list of files or names is expected"
        )
    from microvib.io.array_files import with_array

    arrays = []
    for name in spec:
        data = to_plain_data(base, text=True) | {"array": {key.split(".")[1]: str(name)}}
        arrays.append(with_array(data, files, f"vary.{key}")["array"])
    return Levels("array", tuple(arrays), tuple(str(name) for name in spec))


def _checked(base: Scenario, combination: dict[str, Any]) -> dict[str, Any]:
    """A combination with its quantities in SI, tried on the scenario."""
    found = {key: variation(base, key, [value]) for key, value in combination.items()}
    read = {key: x.values[0] for key, x in found.items() if isinstance(x, Levels)}
    base.with_si({k: v for key, value in read.items() for k, v in _given(base, key, value).items()})
    return read


def _given(base: Scenario, key: str, value: Any) -> dict[str, Any]:
    return dict.fromkeys(keys_of(base, key), value)


def _validate_scenario(base: Scenario, parts: Sequence[Levels | Uncertain]) -> None:
    for part in parts:
        if isinstance(part, Levels):
            values: Sequence[Any] = part.values
        else:
            values = part.quantile(np.array(TRIAL_QUANTILES)).tolist()
        if len(values) > 64 and isinstance(values[0], float):
            values = values[:: len(values) - 1]
        with error_context(f"vary.{part.key}"):
            for value in values:
                base.with_si(part.changes(value))


def _points(study: Study, keys: int) -> int:
    count = study.sampling.count
    special = {"sobol-indices": count * (keys + 2), "one-at-a-time": 1 + 2 * keys}
    if keys or study.sampling.noise == "each":
        return special.get(study.sampling.method, count)
    return 1


def _sample(study: Study, uncertain: Sequence[Uncertain]) -> np.ndarray:
    """Values of the sampled keys, (points, keys)."""
    if not uncertain:
        if study.correlations:
            raise ScenarioError("correlations: nothing is sampled; give the keys distributions")
        return np.zeros((_points(study, 0), 0))
    u = _correlated(_probabilities(study, len(uncertain)), study, uncertain)
    return np.column_stack([x.quantile(u[:, k]) for k, x in enumerate(uncertain)])


def _probabilities(study: Study, d: int) -> np.ndarray:
    """Points of the unit cube, (points, d)."""
    from scipy.stats import qmc

    sampling = study.sampling
    rng = np.random.default_rng(sampling.seed)
    if sampling.method == "one-at-a-time":
        u = np.full((1 + 2 * d, d), 0.5)
        u[np.arange(1, 1 + 2 * d), np.repeat(np.arange(d), 2)] = np.tile(ONE_AT_A_TIME_QUANTILES, d)
        return u
    if sampling.method == "sobol-indices":
        return _decomposition(study, d, rng)
    if sampling.method == "random":
        return rng.random((sampling.count, d))
    if sampling.method == "sobol":  # a balanced set is a power of two; its first points are taken
        points = qmc.Sobol(d, rng=rng).random_base2((sampling.count - 1).bit_length())[
            : sampling.count
        ]
    else:
        points = qmc.LatinHypercube(d, rng=rng).random(sampling.count)
    return _clip_probabilities(points)


def _clip_probabilities(u: np.ndarray) -> np.ndarray:
    """Probabilities kept off 0 and 1, where an unbounded distribution has no value."""
    return np.clip(u, 1e-12, 1.0 - 1e-12)


def _decomposition(study: Study, d: int, rng: np.random.Generator) -> np.ndarray:
    """A, B, and A with one column of B each (A. Saltelli et al., Comput. Phys. Commun. 181, 2010),
    (n (d + 2), d).
    """
    from scipy.stats import qmc

    n = study.sampling.count
    if study.correlations:
        raise ScenarioError(
            "sampling.method: sobol-indices needs independent keys; leave out correlations"
        )
    if n < 2 or n & (n - 1):
        raise ScenarioError(
            f"sampling.count: {n} is not allowed; sobol-indices needs a power of 2, such as 128"
        )
    both = _clip_probabilities(qmc.Sobol(2 * d, rng=rng).random_base2(n.bit_length() - 1))
    A, B = both[:, :d], both[:, d:]
    mixed = [np.where(np.arange(d) == k, B, A) for k in range(d)]
    return np.concatenate([A, B, *mixed])


def _correlated(u: np.ndarray, study: Study, uncertain: Sequence[Uncertain]) -> np.ndarray:
    """Probabilities whose normal scores have the correlations of the study (Gaussian copula)."""
    if not study.correlations:
        return u
    from scipy.special import ndtr, ndtri

    R = _matrix(study.correlations, [x.key for x in uncertain])
    try:
        L = np.linalg.cholesky(R + 1e-12 * np.eye(R.shape[0]))
    except np.linalg.LinAlgError:
        raise ScenarioError(
            "correlations: contradict each other; no distribution has them all"
        ) from None
    joined: np.ndarray = ndtr(ndtri(u) @ L.T)
    return _clip_probabilities(joined)


def _matrix(correlations: Sequence[Correlation], keys: list[str]) -> np.ndarray:
    R = np.eye(len(keys))
    for item in correlations:
        for key in item.keys:
            if key not in keys:
                raise ScenarioError(
                    f"correlations: {key} has no distribution; allowed are {', '.join(keys)}"
                )
        a, b = (keys.index(key) for key in item.keys)
        if a == b:
            raise ScenarioError(
                f"correlations: {item.keys[0]} is named twice; two keys are expected"
            )
        R[a, b] = R[b, a] = item.coefficient
    return R
