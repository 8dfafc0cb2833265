"""A pointing budget over angles of the array: of each requirement the worst angle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.margins import Verdict
from microvib.errors import OptionError
from microvib.io.file_access import WORKING_FOLDER
from microvib.model.drive_states import Sticking
from microvib.model.scenario import GivenScenario, Scenario, as_scenario, stands_for_scenario
from microvib.solve.integration import Progress
from microvib.studies.budget.angle_search import WorstAngle, worst_angles
from microvib.studies.budget.files import Requirements
from microvib.studies.budget.other_sources import (
    Excitation,
    contribution_of_other,
    excitation_of,
)
from microvib.studies.budget.recording_source import contribution_of_recording, recording_at_angle
from microvib.studies.budget.sources import (
    Contribution,
)
from microvib.studies.budget.study import (
    Budget,
    pointing_budget,
    read_requirements,
    read_sources,
)
from microvib.studies.budget.sums import Assessment
from microvib.studies.orbit import Orbit, analyse_orbit
from microvib.testdata.recording import Recording
from microvib.units import GivenQuantity, Si, quantity

_MAX_ANGLE_STEP = math.radians(30.0)
"""Step between angles of an orbit at which everything is judged, at most."""
_VERDICT_RANK: dict[Verdict, int] = {"pass": 0, "not judged": 1, "fail": 2}


def budget_over_angles(
    scenarios: GivenScenario | Sequence[GivenScenario],
    requirements: Requirements | str | Path | None = None,
    *,
    angles: Sequence[GivenQuantity] | None = None,
    orbit: bool = False,
    progress: Progress | None = None,
    **keys: Any,
) -> Budget:
    """The pointing budget with each requirement at the angle of the first drive's array that is
    worst for it.

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
    if stands_for_scenario(scenarios):
        listed = [scenarios]
    else:
        listed = list(scenarios)
    if not listed:
        return pointing_budget(listed, requirements)
    first = as_scenario(listed[0])
    if keys.get("campaign") is not None:
        raise OptionError(
            "campaign",
            "is of one angle of the array, and the budget is over several; leave one of them out",
        )
    required = read_requirements(requirements, keys.get("files", WORKING_FOLDER))
    turned: Orbit | None = None
    worst: list[WorstAngle | None] = []
    if orbit:
        turned, worst = _over_orbit(first, required, angles, keys)
        each = _angles_of(turned, worst)
    else:
        each = np.array(
            [quantity("angles", angle, "rad", example="deg") for angle in angles or ()], dtype=float
        )
    if not each.size:
        raise OptionError("angles", "missing; angles of the array are expected, such as 0:330:30")
    names = list(keys.pop("names", ())) or _names_of(listed)
    found = []
    for k, angle in enumerate(each.tolist()):
        there = [first.at_angle(Si(angle)), *listed[1:]]
        tell = _part_of(progress, k, each.size)
        found.append(pointing_budget(there, required, names=names, progress=tell, **keys))
    return _worst(found, each, turned, worst)


def _over_orbit(
    first: Scenario,
    required: Requirements | None,
    angles: Sequence[GivenQuantity] | None,
    keys: Mapping[str, Any],
) -> tuple[Orbit, list[WorstAngle | None]]:
    """An orbit, and the angle between those that it runs that is worst for each requirement, by the
    lines of the drives and of the other sources; ``keys`` as for ``budget_over_angles``.
    """
    listed_sources, files = read_sources(keys.get("sources"), keys.get("files", WORKING_FOLDER))
    harmonics = keys.get("harmonics", 8)
    turned = analyse_orbit(first, angles, harmonics=harmonics)
    first_drive, second_drive = zip(*turned.runs.sticking, strict=True)
    sticking = reduce(Sticking.or_as, first_drive), reduce(Sticking.or_as, second_drive)
    drives = _drives_at_angles(first, turned, keys.get("recording"), harmonics)

    def sources(angle: float) -> list[Contribution]:
        there = first.at_angle(Si(angle))
        others = [contribution_of_other(one, there, files, sticking) for one in listed_sources]
        return [*(drive(angle) for drive in drives), *others]

    low, high = sorted((float(turned.sweep.angles[0]), float(turned.sweep.angles[-1])))
    excitations = [
        *(Excitation(f, f) for f in (drive(low).frequency for drive in drives)),
        *(excitation_of(source, files) for source in listed_sources),
    ]
    asked = () if required is None else required.requirements
    rule = keys.get("rule", "rss")
    return turned, worst_angles(asked, first, (low, high), sources, excitations, rule)


def _drives_at_angles(
    first: Scenario, orbit: Orbit, recording: Recording | None, harmonics: int
) -> list[Callable[[float], Contribution]]:
    """Contributions of the drives at any angle [rad] between those of an orbit.

    A recording takes the place of the first drive. Where a second wing steps, the orbit has the lines
    of both together, which then count beside the recording.
    """
    names, f = orbit.sweep.lines[0].names, orbit.sweep.lines[0].frequency

    def simulated(angle: float) -> Contribution:
        return Contribution("drives", "", names, f, orbit.los_at(angle))

    if recording is None:
        return [simulated]
    start = first.at_angle(Si(float(orbit.sweep.angles[0]))).alone
    measured = contribution_of_recording("recording", start, recording, harmonics)

    def recorded(angle: float) -> Contribution:
        return recording_at_angle(measured, first.at_angle(Si(angle)).alone)

    if first.driven_wing is None:
        return [recorded]
    return [recorded, simulated]


def _names_of(drives: Sequence[GivenScenario]) -> list[str]:
    """Names of drives that were given without: those of their files, else numbers."""
    return [
        f"drive {k}" if isinstance(drive, Scenario) else Path(drive).stem
        for k, drive in enumerate(drives, 1)
    ]


def _part_of(progress: Progress | None, k: int, count: int) -> Progress | None:
    """Progress of the ``k``-th of ``count`` equal parts of the work."""
    if progress is None:
        return None

    def tell(done: float, total: float) -> None:
        progress(k * total + done, count * total)

    return tell


def _angles_of(orbit: Orbit, worst: Sequence[WorstAngle | None]) -> np.ndarray:
    """Angles [rad] of an orbit that are judged, each once, ascending."""
    dense, whole = orbit.sweep.angles, [*orbit.runs.angles.tolist()]
    steps = math.ceil(abs(dense[-1] - dense[0]) / _MAX_ANGLE_STEP)
    whole += np.linspace(dense[0], dense[-1], steps + 1).tolist()
    whole += [one.angle for one in worst if one is not None]
    turn = 2.0 * math.pi
    kept: list[float] = []
    for angle in sorted(whole):
        if not any(abs(math.remainder(angle - other, turn)) < 1e-6 for other in kept):
            kept.append(angle)
    return np.array(kept)


def _worst(
    found: Sequence[Budget],
    angles: np.ndarray,
    orbit: Orbit | None,
    worst: Sequence[WorstAngle | None],
) -> Budget:
    """Budget of the angle that decides, with the worst of all angles for each requirement."""
    judged = []
    for number, rows in enumerate(zip(*(one.judged for one in found), strict=True)):
        if orbit is None:
            each = list(rows)
        else:
            each = [_with_what_lies_between(one, orbit, worst[number]) for one in rows]
        judged.append(_worst_assessment(each, angles.tolist()))
    decides = max(judged, key=_rank, default=None)
    if decides is None:
        at = 0
    else:
        at = int(np.argmin(np.abs(angles - (decides.angle or 0.0))))
    notes = () if orbit is None else tuple(orbit.notes())
    without = tuple(dict.fromkeys(why for one in found for why in one.without_steady))
    whole = replace(
        found[at],
        judged=tuple(judged),
        angles=tuple(angles.tolist()),
        orbit=orbit is not None,
        notes=notes,
    )
    return replace(whole, without_steady=without)


def _rank(one: Assessment) -> tuple[int, float, float]:
    """How bad an assessment is: its verdict first, then its figures over the limit."""
    return (
        _VERDICT_RANK[one.verdict],
        _limit_ratio(one.most, one.limit),
        _limit_ratio(one.value, one.limit),
    )


def _worst_assessment(each: Sequence[Assessment], angles: Sequence[float]) -> Assessment:
    """A requirement at several ``angles`` [rad]: the worst verdict with its reasons and, each over all
    angles, the largest value with what contributes to it, the largest least and the largest most.

    Of a curve, whose limit is that at the worst line of each angle, figures count over it.
    """
    k = max(range(len(each)), key=lambda k: _rank(each[k]))
    found = replace(each[k], angle=angles[k], value_angle=angles[k])
    if math.isnan(found.value) or not found.limit > 0.0:
        return found
    j = max(range(len(each)), key=lambda j: (each[j].value / each[j].limit, j == k))
    return replace(
        each[j],
        least=each[j].limit * max(one.least / one.limit for one in each),
        most=each[j].limit * max(one.most / one.limit for one in each),
        verdict=found.verdict,
        why=found.why,
        angle=found.angle,
        value_angle=angles[j],
    )


def _limit_ratio(value: float, limit: float) -> float:
    if math.isnan(value):
        return math.inf
    return value / limit


def _with_what_lies_between(one: Assessment, orbit: Orbit, worst: WorstAngle | None) -> Assessment:
    """Assessments at an angle of an orbit, with an allowance for the angles between those judged."""
    if worst is None or one.verdict == "fail" or not math.isfinite(one.most):
        return one
    turning = max((w.turning for w in orbit.windows), default=0.0)
    factor = 1.0 + orbit.interpolation + turning
    most = factor * max(one.most * (1.0 + worst.excess), _bound_of_orbit(one, worst))
    if most <= one.limit:
        return replace(one, most=most)
    part = 100 * (most / one.most - 1.0) if one.most > 0.0 else math.inf
    why = f"between the angles that were judged the value may be {part:.2g} % larger"
    return replace(one, most=most, verdict="not judged", why=(*one.why, why))


def _bound_of_orbit(one: Assessment, worst: WorstAngle) -> float:
    """Above which the figure is at no angle [rad]; a level is not told by it."""
    if one.requirement.curve is not None:
        return worst.most * one.limit
    if one.requirement.statistic == "level":
        return 0.0
    return worst.most
