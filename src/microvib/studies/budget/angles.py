"""A pointing budget over angles of the array: of each requirement the worst angle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.margins import Verdict
from microvib.errors import OptionError
from microvib.io.scenario_file import load_scenario
from microvib.model.scenario import Scenario, expect_scenario
from microvib.solve.integration import Progress
from microvib.studies.budget.figures import figure
from microvib.studies.budget.files import Requirements, read_file
from microvib.studies.budget.study import Budget, pointing_budget
from microvib.studies.budget.sums import Judged
from microvib.studies.orbit import Orbit, over_orbit
from microvib.units import Given, Si, quantity

_EVERY = math.radians(30.0)
"""Step between angles of an orbit at which everything is judged, at most."""
_WORSE: dict[Verdict, int] = {"pass": 0, "not judged": 1, "fail": 2}


def budget_over_angles(
    scenarios: Scenario | str | Sequence[Scenario | str],
    requirements: Requirements | str | Path | None = None,
    *,
    angles: Sequence[Given] | None = None,
    orbit: bool = False,
    progress: Progress | None = None,
    **keys: Any,
) -> Budget:
    """The pointing budget with each requirement at the angle of the first drive's array that is worst for it.

    Parameters
    ----------
    angles : sequence of str or Si, optional
        Angles of the array that are judged, such as ``"30 deg"``; with ``orbit`` those between which it turns.
    orbit : bool
        Judge a whole turn: at the angles at which ``over_orbit`` runs and at those that are worst in between by its lines. What
        these lines may be off counts in what a figure may be at most.
    **keys
        What ``pointing_budget`` takes.

    Returns
    -------
    Budget
        Of the angle that decides, with ``judged`` of the worst angle each, and ``angles``.

    Raises
    ------
    MicrovibError
        Whatever ``pointing_budget`` and ``over_orbit`` raise.
    """
    listed = [scenarios] if isinstance(scenarios, Scenario | str) else list(scenarios)
    if not listed:
        return pointing_budget(listed, requirements)
    first = load_scenario(listed[0]) if isinstance(listed[0], str) else listed[0]
    expect_scenario(first)
    if keys.get("campaign") is not None:
        raise OptionError(
            "campaign", "is of one angle of the array, and the budget is over several; leave one of them out"
        )
    required = (
        requirements if isinstance(requirements, Requirements | None) else read_file(Path(requirements), Requirements)
    )
    turned: Orbit | None = None
    if orbit:
        turned = over_orbit(first, angles, harmonics=keys.get("harmonics", 8))
        each = _angles_of(turned, required)
    else:
        each = np.array([quantity("angles", angle, "rad", example="deg") for angle in angles or ()], dtype=float)
    if not each.size:
        raise OptionError("angles", "missing; angles of the array are expected, such as 0:330:30")
    names = list(keys.pop("names", ())) or [
        Path(x).stem if isinstance(x, str) else f"drive {k}" for k, x in enumerate(listed, 1)
    ]
    found = []
    for k, angle in enumerate(each.tolist()):
        there = [first.at_angle(Si(angle)), *listed[1:]]
        tell = None if progress is None else lambda done, total, k=k: progress(k * total + done, each.size * total)
        found.append(pointing_budget(there, required, names=names, progress=tell, **keys))
    return _worst(found, each, turned)


def _angles_of(orbit: Orbit, required: Requirements | None) -> np.ndarray:
    """Angles [rad] of an orbit that are judged, each once, ascending."""
    dense, whole = orbit.sweep.angles, [*orbit.runs.angles.tolist()]
    steps = math.ceil(abs(dense[-1] - dense[0]) / _EVERY)
    whole += np.linspace(dense[0], dense[-1], steps + 1).tolist()
    for r in () if required is None else required.requirements:
        if r.incomplete:
            continue
        plain = r.model_copy(update={"statistic": "rms", "curve": None}) if r.statistic == "level" or r.curve else r
        sizes = [figure(plain, one.frequency, one.amplitude) for one in orbit.sweep.lines]
        whole.append(float(dense[int(np.argmax(sizes))]))
    turn = 2.0 * math.pi
    kept: list[float] = []
    for angle in sorted(whole):
        if not any(abs(math.remainder(angle - other, turn)) < 1e-6 for other in kept):
            kept.append(angle)
    return np.array(kept)


def _worst(found: Sequence[Budget], angles: np.ndarray, orbit: Orbit | None) -> Budget:
    """Of each requirement the angle with the worst verdict, and of those the one whose figure may be largest over its limit."""

    def rank(one: Judged) -> tuple[int, float, float]:
        return _WORSE[one.verdict], _over(one.most, one.limit), _over(one.value, one.limit)

    judged = []
    for rows in zip(*(one.judged for one in found), strict=True):
        each = [_between(one, orbit) for one in rows]
        k = max(range(len(each)), key=lambda k: rank(each[k]))
        judged.append(replace(each[k], angle=float(angles[k])))
    decides = max(judged, key=rank, default=None)
    at = 0 if decides is None else int(np.argmin(np.abs(angles - (decides.angle or 0.0))))
    notes = () if orbit is None else tuple(orbit.notes())
    without = tuple(dict.fromkeys(why for one in found for why in one.without_steady))
    whole = replace(
        found[at], judged=tuple(judged), angles=tuple(angles.tolist()), orbit=orbit is not None, notes=notes
    )
    return replace(whole, without_steady=without)


def _over(value: float, limit: float) -> float:
    return math.inf if math.isnan(value) else value / limit


def _between(one: Judged, orbit: Orbit | None) -> Judged:
    """What was found at an angle of an orbit, with what figures between the angles may be above it."""
    if orbit is None or one.verdict == "fail" or not math.isfinite(one.most):
        return one
    turning = max((w.turning for w in orbit.windows), default=0.0)
    most = one.most * (1.0 + orbit.interpolation + turning)
    if most <= one.limit:
        return replace(one, most=most)
    why = f"between the angles that were run the line of sight is known to {100 * (orbit.interpolation + turning):.2g} % only"
    return replace(one, most=most, verdict="not judged", why=(*one.why, why))
