"""A craft over an orbit, its array turning: lines and windows over the time, the angles that need
it run, the others in between.

Lines settle in seconds and the array passes its angles in minutes, so that at each instant the
lines are those of the angle that the array has then. Steady states are found at some angles, what
lies between them follows as in ``analysis.turning``, and the steps between the runs are halved
until what was expected half way is found there. What the turning itself changes is stated beside
it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from microvib.analysis.lines import expected_in
from microvib.analysis.pointing import FREQUENCY_TOLERANCE, HubLines
from microvib.analysis.turning import HubResponse, hub_response, shaft_torques
from microvib.errors import MicrovibError, OptionError
from microvib.model.coupling import require_craft
from microvib.model.driven import noise_bands
from microvib.model.line_names import LineName, is_unlisted
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.results import ARRAY_ANGLE, POINTING_ANGLE, SHARE, TIME, Column
from microvib.signals.limit_curve import Limit
from microvib.signals.pointing import (
    METRICS,
    Metric,
    mean_square_of_lines,
    metric_name,
    metric_weight,
)
from microvib.solve.integration import Progress
from microvib.studies.angles import MAX_ANGLES, AngleSweep, check_sweep, sweep_angles
from microvib.units import GivenQuantity, Si, quantity

STEP = math.radians(30.0)
"""First step between angles that are run, where none are given."""
TOLERANCE = 0.01
"""Difference half way between two runs, over the rms of the orbit, from which their step is halved
again.
"""
MAX_QUASI_STATIC_CHANGE = 0.05
"""Part of the rms of the orbit from which what the turning itself changes is too much for taking
the angles one by one.
"""
_MIN_ANGLE_STEP = math.radians(0.25)
"""Step between angles that are run, below which none is halved: there a motion changes its kind."""
_MIN_ANGLES, _MAX_REFINEMENTS = 121, 6
"""Angles of the orbit, and how often the step between them is halved where the line of sight
changes fast.
"""
_NEGLIGIBLE_MEAN_SQUARE = 1e-8
"""Part of the mean square in any window below which a line is left out between the runs."""


@dataclass(frozen=True)
class RefinementRound:
    """One round of halved steps."""

    angles: int
    """Angles that were run before."""
    tried: int
    """Middles of their steps that were run then."""
    error: float
    """Largest difference of the line of sight there from what was expected, over the rms of the
    orbit.
    """


_WHERE = replace(ARRAY_ANGLE, form=".4g")
_PART = replace(SHARE, form=".2g")


@dataclass(frozen=True)
class WindowOverOrbit:
    """One metric in one window over the orbit, radial [rad]."""

    metric: Annotated[Metric, Column("metric", "metric", words=metric_name)]
    window: Annotated[float, Column("window_s", "window", TIME)]
    """[s]"""
    worst: Annotated[float, Column("worst_rad", "worst", POINTING_ANGLE)]
    at: int
    """Where: index of the angle."""
    angle: Annotated[float, Column("worst_deg", "at angle", _WHERE)]
    """There [rad]."""
    time: Annotated[float, Column("worst_s", "at time", TIME)]
    """There [s]."""
    rms: Annotated[float, Column("rms_rad", "rms over orbit", POINTING_ANGLE)]
    turning: Annotated[float, Column("turning", "turning", _PART)]
    """Largest change from the array's rotation, over ``rms``."""


@dataclass(frozen=True)
class ExpectedExcess:
    """A line that is expected to be above a limit at an angle that was not run."""

    component: str
    line: str
    frequency: float
    """[Hz]"""
    angle: float
    """[rad]"""
    amplitude: float
    """Expected there, 0-to-peak [N], [N m]."""
    allowed: float
    """[N], [N m]"""


@dataclass(frozen=True)
class Orbit:
    """Lines over an orbit."""

    sweep: AngleSweep
    """At angles [rad] as they are passed, (n,)."""
    runs: AngleSweep
    """At those that were run."""
    time: np.ndarray
    """[s], (n,), from the first angle."""
    halvings: tuple[RefinementRound, ...]
    interpolation: float
    """Largest error half way of the steps that were not halved again, over the rms of the orbit."""
    turning: np.ndarray
    """Size of what the turning changes in each line of the line of sight [rad], (n, k, 2), of
    ``sweep.lines``.
    """
    los_at: Callable[[float], np.ndarray]
    """Lines of the line of sight at any angle [rad] between, (k, 2), complex [rad]."""
    judged: AngleSweep | None = None
    """The scenario as it was given, its noise included, judged at the angles of ``runs``; None without a
    limit.
    """

    @property
    def rate(self) -> float:
        """Rate of the array [rad/s]."""
        assert self.sweep.scenario.rate is not None
        return abs(self.sweep.scenario.rate)

    def mean(self, squares: np.ndarray) -> float:
        """Root of the mean over the orbit's time of ``squares`` (n,)."""
        return math.sqrt(float(np.trapezoid(squares, self.time)) / float(self.time[-1]))

    def size(self, metric: Metric, window: float) -> np.ndarray:
        """Radial rms of all lines [rad] in a ``window`` [s], (n,)."""
        return self._radial(np.array([one.amplitude for one in self.sweep.lines]), metric, window)

    def _radial(self, amplitude: np.ndarray, metric: Metric, window: float) -> np.ndarray:
        """Radial rms (n,) of amplitudes (n, k, 2)."""
        by = metric_weight(metric, self.sweep.lines[0].frequency, window)
        return np.asarray(np.sqrt(0.5 * np.sum(amplitude**2, axis=2) @ by))

    @cached_property
    def windows(self) -> tuple[WindowOverOrbit, ...]:
        """Worst, where, and rms of each metric in each window."""
        rows = []
        for metric, window in _metrics_and_windows(self.sweep.scenario):
            size = self.size(metric, window)
            rms, at = self.mean(size**2), int(np.argmax(size))
            turning = float(self._radial(self.turning, metric, window).max())
            rows.append(
                WindowOverOrbit(
                    metric,
                    window,
                    float(size[at]),
                    at,
                    float(self.sweep.angles[at]),
                    float(self.time[at]),
                    rms,
                    turning / rms if rms else 0.0,
                )
            )
        return tuple(rows)

    @cached_property
    def excess(self) -> ExpectedExcess | None:
        """Line of a load that is expected between the runs, and is farthest above its curve; None where there is
        none, or no load has a curve.
        """
        if self.judged is None:
            return None
        frequency = self.sweep.lines[0].frequency
        found = []
        for component, curve in self.judged.judgements[0].limit.loads.items():
            size = np.abs([one.loads[:, COMPONENTS.index(component)] for one in self.sweep.lines])
            allowed = np.asarray(curve.strictest(*_clock_interval(frequency)))
            n, k = np.unravel_index(int(np.argmax(size / allowed)), size.shape)
            if size[n, k] > allowed[k]:
                name, angle = self.sweep.lines[n].names[k], float(self.sweep.angles[n])
                found.append(
                    ExpectedExcess(
                        component,
                        name,
                        float(frequency[k]),
                        angle,
                        float(size[n, k]),
                        float(allowed[k]),
                    )
                )
        return max(found, key=lambda one: one.amplitude / one.allowed, default=None)

    @property
    def quasi_static(self) -> bool:
        """Whether the angles may be taken one by one."""
        return all(w.turning <= MAX_QUASI_STATIC_CHANGE for w in self.windows)

    @property
    def turned_in_decay(self) -> float:
        """Angle [rad] that the array turns while the mode that rings longest falls to 1/e; infinite
        without damping.
        """
        drives = [drive.scenario for one in self.runs.lines for drive in one.drives or (one,)]
        least = min((float(np.min(require_craft(one).load.decay)) for one in drives), default=0.0)
        if least > 0.0:
            return self.rate / least
        return math.inf

    def notes(self) -> list[str]:
        """Notes on the results, in sentences."""
        said = []
        if self.interpolation > TOLERANCE:
            said.append(
                f"Not converged: between {len(self.runs.angles)} runs the line of sight is off by"
                " up to"
                f" {100 * self.interpolation:.2g} % of the rms of the orbit."
            )
        if not self.quasi_static:
            worst = max(self.windows, key=lambda w: w.turning)
            said.append(
                f"The quasi-static sweep does not hold here: while a mode settles the array turns by up to"
                f" {math.degrees(self.turned_in_decay):.2g} deg, which changes {worst.metric} in"
                f" {worst.window:g} s by some"
                f" {100 * worst.turning:.2g} % of the rms of the orbit (allowed:"
                f" {100 * MAX_QUASI_STATIC_CHANGE:g} %)."
            )
        if any(noise_bands(one) for one in _drives(self.sweep.scenario)):
            said.append(
                "Torque noise and roughness of the friction are left out here; a sweep over angles"
                " has them."
            )
        without = [
            (math.degrees(a), why)
            for a, why in zip(self.runs.angles, self.runs.fallbacks, strict=True)
            if why
        ]
        if without:
            at = [a for a, _ in without]
            said.append(
                f"No steady state at {len(without)} of {len(self.runs.angles)} angles, from"
                f" {min(at):.4g} to {max(at):.4g} deg:"
                f" {without[0][1]}. Their lines are those of runs from rest, which depend on the"
                " start."
            )
        return said


def _clock_interval(frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Intervals [Hz] in which lines of the clock are known to be."""
    return frequency * (1.0 - FREQUENCY_TOLERANCE), frequency * (1.0 + FREQUENCY_TOLERANCE)


def _drives(scenario: Scenario) -> tuple[Scenario, ...]:
    """Each drive that steps, with the other wing held."""
    other = scenario.driven_wing
    if other is None:
        return (scenario,)
    return (scenario.alone, other)


def _metrics_and_windows(scenario: Scenario) -> list[tuple[Metric, float]]:
    """Metrics and windows [s]; the motion itself needs no window."""
    los = require_craft(scenario).spacecraft.line_of_sight
    windows = () if los is None else los.windows
    return [
        ("ape", 1.0),
        *((metric, window) for window in windows for metric in METRICS if metric != "ape"),
    ]


def analyse_orbit(
    scenario: GivenScenario,
    angles: Sequence[GivenQuantity] | None = None,
    *,
    harmonics: int = 8,
    limit: Limit | None = None,
    progress: Progress | None = None,
) -> Orbit:
    """Run the craft at the angles through which its array turns, one after another, at the
    scenario's rate.

    Steps between the angles are halved where it is needed.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive on its craft: a scenario, a name of the catalog, or the path of a scenario file.
    angles : sequence of str or Si, optional
        Angles of the array, such as ``"30 deg"``; without them one turn from ``array_angle``.
    harmonics : int
        Members of each family of lines that are looked for.
    limit : Limit, optional
        Limit by which the scenario is judged at each angle that is run.
    progress : callable, optional
        Called as ``progress(done, total)``, with the number of angles.

    Returns
    -------
    Orbit
        Lines at each angle and between them.

    Raises
    ------
    MicrovibError
        Where a rate is zero or changes.
    OptionError
        Where the array does not turn this way.
    """
    scenario = as_scenario(scenario)
    turns = check_orbit(scenario, angles)
    # Noise has no steady state; it is said that it is left out.
    changes = {"record.start": "steady", "friction": scenario.friction.without_noise}
    wing = scenario.spacecraft and scenario.spacecraft.second_wing
    if wing and wing.friction:
        changes["spacecraft.second_wing.friction"] = wing.friction.without_noise
    steady = scenario.with_si(changes)
    runs, halvings, off = _run(steady, turns, harmonics, progress)
    judged = None
    if limit is not None:
        angles_run = [Si(angle) for angle in runs.angles.tolist()]
        with_noise = scenario.with_si({"record.start": "steady"})
        judged = sweep_angles(
            with_noise, angles_run, harmonics=harmonics, limit=limit, progress=progress
        )
    between = _AngleInterpolator(runs)
    psi, moved = between.dense()
    lines = tuple(
        HubLines(
            steady.at_angle(Si(angle)),
            between.names,
            between.frequency,
            one.loads,
            one.los,
            np.empty((0, 2)),
        )
        for angle, one in zip(psi.tolist(), moved, strict=True)
    )
    rates = [abs(one.rate or 0.0) for one in _drives(scenario)]
    turning = _rotation_effect(psi, moved, max(rates), between.frequency)
    sweep = AngleSweep(scenario, psi, lines, ("",) * psi.size)
    return Orbit(
        sweep,
        runs,
        np.abs(psi - psi[0]) / rates[0],
        halvings,
        off,
        turning,
        lambda angle: between(angle).los,
        judged,
    )


def check_orbit(scenario: Scenario, angles: Sequence[GivenQuantity] | None = None) -> np.ndarray:
    """The ``angles`` [rad], or those of one turn, (n,).

    MicrovibError where a rate is zero or changes, OptionError where the array does not turn this
    way.
    """
    check_sweep(scenario)
    for key, one in zip(
        ("tracking", "spacecraft.second_wing.tracking"), _drives(scenario), strict=False
    ):
        if not one.rate or not one.driving_frequency:
            raise MicrovibError(
                f"{key}: over an orbit the array turns at a constant rate; one other than 0 deg/s"
                " is expected"
            )
    rate = float(scenario.rate or 0.0)
    if angles is None:
        step = math.copysign(STEP, rate)
        return float(require_craft(scenario).spacecraft.array_angle) + step * np.arange(
            round(2.0 * math.pi / STEP) + 1
        )
    turns = np.array(
        [quantity("angles", angle, "rad", example="deg") for angle in angles], dtype=float
    )
    if turns.size < 2 or np.any(np.diff(turns) * rate <= 0.0):
        raise OptionError(
            "angles",
            f"over an orbit the array turns at {math.degrees(rate):g} deg/s; angles in this order"
            " are expected",
        )
    return turns


def _run(
    scenario: Scenario, angles: np.ndarray, harmonics: int, progress: Progress | None
) -> tuple[AngleSweep, tuple[RefinementRound, ...], float]:
    """Runs at ``angles`` (p,) and wherever the steps between them had to be halved; the rounds, and
    the error that is left.
    """

    def sweep(at: np.ndarray, before: int) -> AngleSweep:
        def tell(done: float, total: float) -> None:
            if progress is not None:
                progress(before + done, before + total)

        return sweep_angles(
            scenario, [Si(float(x)) for x in at], harmonics=harmonics, progress=tell
        )

    runs, rounds, left = sweep(angles, 0), list[RefinementRound](), 0.0
    steps = list(itertools.pairwise(angles.tolist()))
    while steps and len(runs.angles) + len(steps) <= MAX_ANGLES:
        middles = np.array([0.5 * (a + b) for a, b in steps])
        between, more = _AngleInterpolator(runs), sweep(middles, len(runs.angles))
        errors = [
            between.off(angle, one) for angle, one in zip(middles.tolist(), more.lines, strict=True)
        ]
        rounds.append(RefinementRound(len(runs.angles), len(middles), max(errors)))
        # What is no steady state depends on its start, and closer steps say no more of it.
        again = [
            error > TOLERANCE and not why and abs(b - a) > _MIN_ANGLE_STEP
            for error, why, (a, b) in zip(errors, more.fallbacks, steps, strict=True)
        ]
        left = max(
            [left, *(error for error, halve in zip(errors, again, strict=True) if not halve)]
        )
        halves = [((a, m), (m, b)) for (a, b), m in zip(steps, middles.tolist(), strict=True)]
        steps = [step for two, halve in zip(halves, again, strict=True) if halve for step in two]
        runs = _merge_sweeps(runs, more)
    return runs, tuple(rounds), rounds[-1].error if steps else left


def _merge_sweeps(a: AngleSweep, b: AngleSweep) -> AngleSweep:
    """Both, in the order of their angles as the array passes them."""
    angles = np.concatenate([a.angles, b.angles])
    order = np.argsort(angles * math.copysign(1.0, a.angles[-1] - a.angles[0])).tolist()
    lines, fallbacks = a.lines + b.lines, a.fallbacks + b.fallbacks
    sticking = a.sticking + b.sticking
    return AngleSweep(
        a.scenario,
        angles[order],
        tuple(lines[k] for k in order),
        tuple(fallbacks[k] for k in order),
        tuple(sticking[k] for k in order),
    )


class _AngleInterpolator:
    """Lines of the clock at any angle, from runs at some."""

    def __init__(self, runs: AngleSweep) -> None:
        self._runs = runs
        known = [
            _steady_lines(one, why) for one, why in zip(runs.lines, runs.fallbacks, strict=True)
        ]
        judged = _metrics_and_windows(runs.scenario)
        squares = [
            {key: one.mean_squares(*key).sum(axis=1) for key in judged} for one in runs.lines
        ]
        whole = {key: max(float(each[key].sum()) for each in squares) for key in judged}
        count = {
            name: float(one.frequency[k])
            for one, each, rows in zip(runs.lines, squares, known, strict=True) for name, k in rows.items()
            if any(each[key][k] > _NEGLIGIBLE_MEAN_SQUARE * whole[key] for key in judged)
        }  # fmt: skip
        self.names, self.frequency = tuple(count), np.array(list(count.values()))
        self._rms = {
            key: math.sqrt(np.mean([each[key].sum() for each in squares])) for key in judged
        }
        each = zip(*(one.drives or (one,) for one in runs.lines), strict=True)
        self._torques = [np.array([self._torque(one) for one in drive]) for drive in each]

    def _torque(self, drive: HubLines) -> np.ndarray:
        """Torques of one drive on its shafts, (k, c), of the lines of all."""
        steady = _steady_lines(drive, "").values()
        rows = {
            name: k for name, f in zip(self.names, self.frequency.tolist(), strict=True) for k in steady
            if abs(drive.frequency[k] - f) <= FREQUENCY_TOLERANCE * f
        }  # fmt: skip
        return self._in_order(rows, shaft_torques(drive))

    def _in_order(self, rows: dict[str, int], values: np.ndarray) -> np.ndarray:
        """Values (..., c) of lines in the order of all names; 0 where a line is not there."""
        found = np.zeros((len(self.names), values.shape[1]), dtype=complex)
        for k, name in enumerate(self.names):
            if name in rows:
                found[k] = np.nan_to_num(values[rows[name]])
        return found

    def __call__(self, angle: float) -> HubResponse:
        angles = self._runs.angles
        way = math.copysign(1.0, angles[-1] - angles[0])
        k = int(np.clip(np.searchsorted(way * angles, way * angle), 1, angles.size - 1))
        part = (angle - angles[k - 1]) / (angles[k] - angles[k - 1])
        first, *second = (
            hub_response(
                drive,
                self.frequency,
                (1.0 - part) * torque[k - 1] + part * torque[k],
                at_second=n > 0,
            )
            for n, (drive, torque) in enumerate(
                zip(_drives(self._runs.scenario.at_angle(Si(angle))), self._torques, strict=True)
            )
        )
        return sum(second, first)

    def off(self, angle: float, found: HubLines) -> float:
        """Largest rms, over that of all runs, of what a run at an ``angle`` differs by from what is
        expected there.
        """
        assert found.los is not None
        apart = np.abs(self(angle).los - self._in_order(_steady_lines(found, ""), found.los))
        errors = (
            (key, math.sqrt(mean_square_of_lines(key[0], self.frequency, apart, key[1]).sum()))
            for key in self._rms
        )
        return max(error / self._rms[key] for key, error in errors if self._rms[key] > 0.0)

    def dense(self) -> tuple[np.ndarray, list[HubResponse]]:
        """Angles as they are passed, (n,), and the lines there, dense enough for straight lines
        between them.
        """
        angles = np.linspace(self._runs.angles[0], self._runs.angles[-1], _MIN_ANGLES).tolist()
        moved = {angle: self(angle) for angle in angles}
        top = max(_size(one) for one in moved.values())
        steps = list(itertools.pairwise(angles))
        for _ in range(_MAX_REFINEMENTS):
            rough = []
            for a, b in steps:
                middle = 0.5 * (a + b)
                moved[middle] = self(middle)
                straight = 0.5 * (_size(moved[a]) + _size(moved[b]))
                if abs(_size(moved[middle]) - straight) > 0.5 * TOLERANCE * top:
                    rough += [(a, middle), (middle, b)]
            steps = rough
        order = sorted(moved, reverse=angles[-1] < angles[0])
        return np.array(order), [moved[angle] for angle in order]


def _size(one: HubResponse) -> float:
    return float(np.linalg.norm(one.los))


def _steady_lines(one: HubLines, fallback: str) -> dict[str, int]:
    """Names and places of lines that last; unlisted ones are ranked by their size, and here told by
    their frequency.

    Of a run from rest, those of the clock.
    """
    rings = {
        line.name
        for drive in one.drives or (one,)
        for line in expected_in(drive.scenario, drive.scenario.record.sample_rate)
        if line.is_mode
    }
    alone = [str(LineName.parse(name).of_own_drive) for name in one.names]
    return {
        f"other {f:.6g} Hz" if is_unlisted(own) else name: k
        for k, (name, own, f) in enumerate(zip(one.names, alone, one.frequency.tolist(), strict=True))
        if own not in rings and not (fallback and is_unlisted(own))
    }  # fmt: skip


def _rotation_effect(
    psi: np.ndarray, moved: list[HubResponse], rate: float, frequency: np.ndarray
) -> np.ndarray:
    """Size of what the turning changes in each line, (n, k, 2) [rad], of first order in the
    ``rate`` [rad/s].

    The structure's change while it settles, rate d2 los/(d omega d psi), and the gyroscopic terms
    left out, which are up to 2 rate/omega of those of inertia: times the response's own sensitivity
    to these, at least its size.
    """
    los, slope = (np.array([getattr(one, name) for one in moved]) for name in ("los", "slope"))
    change = np.abs(np.gradient(slope, psi, axis=0))
    gyroscopic = np.maximum(np.abs(slope), np.abs(los) / (np.pi * frequency[:, None]))
    return np.asarray(rate * (change + gyroscopic))
