"""One drive on its craft at several angles of the array, one run each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microvib.analysis.hub_lines import hub_lines
from microvib.analysis.limits import Judgement
from microvib.analysis.lines import find_lines
from microvib.analysis.pointing import HubLines
from microvib.analysis.run import run_scenario
from microvib.analysis.sticking import sticking_of
from microvib.errors import MicrovibError, OptionError
from microvib.model.coupling import require_craft
from microvib.model.drive_states import Sticking
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.signals.limit_curve import Limit
from microvib.signals.pointing import Metric, radial_rms
from microvib.solve.integration import Progress
from microvib.solve.motion import Motion
from microvib.solve.steady.state import SteadyState, find_steady
from microvib.studies.workers import parallel_calls
from microvib.units import GivenQuantity, Si, quantity

MAX_ANGLES = 361
_EXAMPLE = "write FIRST:LAST:STEP in degrees, such as 0:180:15, or a list, 0,45,90"


@dataclass(frozen=True)
class AngleSweep:
    """Lines at each angle [rad], (p,)."""

    scenario: Scenario
    angles: np.ndarray
    lines: tuple[HubLines, ...]
    fallbacks: tuple[str, ...]
    """Why there is no steady state at an angle where one was asked for; empty elsewhere."""
    sticking: tuple[tuple[Sticking, Sticking], ...] = ()
    """Which shafts of the first drive and of a second one stick at each angle; empty where that is
    not known.
    """
    judgements: tuple[Judgement, ...] = ()
    """The run at each angle against a limit; empty without one. Nothing is judged between the angles."""

    @property
    def names(self) -> tuple[str, ...]:
        """All lines of all angles, the one that gets largest in the line of sight first."""
        size: dict[str, float] = {}
        for one in self.lines:
            for name, value in zip(one.names, np.linalg.norm(one.amplitude, axis=1), strict=True):
                size[name] = max(size.get(name, 0.0), float(value))
        return tuple(sorted(size, key=lambda name: -size[name]))

    def los(self, name: str) -> np.ndarray:
        """Radial amplitude of a line at each angle [rad], (p,); nan where it is not there."""
        found = np.full(len(self.lines), np.nan)
        for k, one in enumerate(self.lines):
            if name in one.names:
                found[k] = np.linalg.norm(one.amplitude[one.names.index(name)])
        return found

    def rms(self, metric: Metric, window: float) -> np.ndarray:
        """Radial rms of all lines, and of torque noise, at each angle [rad], (p,)."""
        return np.array(
            [float(radial_rms(one.sums(metric, window).sum(axis=0))) for one in self.lines]
        )


def sweep_angles(
    scenario: GivenScenario,
    angles: Sequence[GivenQuantity],
    *,
    harmonics: int = 8,
    limit: Limit | None = None,
    progress: Progress | None = None,
) -> AngleSweep:
    """Run a scenario at each of several angles of its array.

    The angle is constant in each run: an array that turns by it in minutes stays there for many
    periods of every line.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive on its craft: a scenario, a name of the catalog, or the path of a scenario file.
    angles : sequence of str or Si
        Angles of the array, such as ``"30 deg"``.
    harmonics : int
        Members of each family of lines that are looked for.
    limit : Limit, optional
        Limit by which the run at each angle is judged.
    progress : callable, optional
        Called as ``progress(done, total)``, with the number of angles.

    Returns
    -------
    AngleSweep
        Lines of loads and line of sight at each angle.

    Raises
    ------
    MicrovibError
        Where the scenario has no craft.
    SimulationError
        What ``simulate`` raises.
    """
    scenario = as_scenario(scenario)
    check_sweep(scenario)
    turns = [quantity("angles", angle, "rad", example="deg") for angle in angles]

    with parallel_calls(progress) as calls:
        found = calls(_at_angle, ((scenario, angle, harmonics, limit) for angle in turns))
    lines, fallbacks, sticking, judgements = zip(*found, strict=True)
    return AngleSweep(
        scenario,
        np.array(turns, dtype=float),
        lines,
        fallbacks,
        sticking,
        tuple(x for x in judgements if x is not None),
    )


_AtAngle = tuple[HubLines, str, tuple[Sticking, Sticking], Judgement | None]
"""Lines, why there is no steady state, which shafts stick, and the verdict."""


def _at_angle(scenario: Scenario, angle: Si, harmonics: int, limit: Limit | None) -> _AtAngle:
    """The drive at one angle: from its steady state alone where that is asked for and nothing is judged."""
    turned = scenario.at_angle(angle)
    steady, fallback = turned.record.start == "steady", ""
    if steady and limit is None:
        state, fallback = find_steady(turned)
        if state is not None:
            found = hub_lines(state, find_lines(state, harmonics=harmonics))
            return found, "", _sticking(state), None
        turned = turned.with_si({"record.start": "rest"})
    result = run_scenario(turned, harmonics=harmonics, limit=limit)
    assert result.motion is not None
    assert result.hub is not None
    why = fallback or result.fallback
    return result.hub, why, _sticking(result.state or result.motion), result.judgement


def _sticking(source: SteadyState | Motion) -> tuple[Sticking, Sticking]:
    repeats = isinstance(source, SteadyState)
    return (
        sticking_of(source, repeats=repeats),
        sticking_of(source.second_wing, repeats=repeats),
    )


def check_sweep(scenario: Scenario) -> None:
    """MicrovibError where a scenario has no craft, or no line of sight, to look at."""
    if require_craft(scenario).spacecraft.line_of_sight is None:
        raise MicrovibError("spacecraft.line_of_sight: missing; a sweep over angles requires it")


def angles_in(text: str) -> tuple[Si, ...]:
    """Angles [rad] of ``0:180:15`` (first, last, step) or ``0,45,90``, in degrees or with a unit at
    the end. OptionError.
    """
    if not text.strip():
        raise OptionError("angles", f"missing; {_EXAMPLE}")
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz°µ ")
    unit = text[len(number) :].strip() or "deg"
    if ":" in number:
        parts = number.split(":")
    else:
        parts = number.split(",")
    values = tuple(
        quantity("angles", f"{part.strip()} {unit}", "rad", example="deg") for part in parts
    )
    if ":" not in number:
        if len(values) <= MAX_ANGLES:
            return values
        return _range_error(text)
    if len(values) != 3 or values[2] == 0.0 or (values[1] - values[0]) / values[2] < 0.0:
        raise OptionError("angles", f"{text!r} is not a range; {_EXAMPLE}")
    steps = (values[1] - values[0]) / values[2] + 1e-6  # perhaps infinite
    if steps < MAX_ANGLES:
        return tuple(Si(values[0] + k * values[2]) for k in range(int(steps) + 1))
    return _range_error(text)


def _range_error(text: str) -> tuple[Si, ...]:
    raise OptionError(
        "angles", f"{text!r} makes too many runs; at most {MAX_ANGLES} angles are expected"
    )
