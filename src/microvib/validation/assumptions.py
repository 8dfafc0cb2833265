"""Assumptions on a test with a solar array simulator, drawn and calibrated to its first state.

Three mechanisms that scenarios of the catalog lack: inertia on the shaft that grows with the arm of
the simulator's weights, noise of the slip ring's friction, and a rotor that aligns with its command
at power-on. What the first state carries is *calibrated* to its four lines: J_h, stiffness of the
reducer, viscous friction of the rotor, and the noise's density, to the mode's line alone. The rest
is *assumed*, and drawn. Nothing is fitted to the other states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from microvib.analysis.lines import lines_by_name
from microvib.analysis.seeds import seeds_of
from microvib.errors import SimulationError
from microvib.io.modal_sources import load_design
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.solve.batch import Torque, simulate_torques
from microvib.structures.simulator_design import SimulatorDesign
from microvib.studies.sas import TargetState, size
from microvib.validation.claims import line_names, reference_lines, scenario_of_state
from microvib.validation.published import Assumptions, PublishedTest

CALIBRATION_TOLERANCE, MAX_CALIBRATION_ERROR = 0.03, 0.15
"""Parts of a line by which a calibration is near enough, and may miss it at most."""
PRIOR = 0.15
"""Standard deviation of each calibrated parameter, in logarithms, before the lines are known."""
_SIZED_FOR = math.radians(2.0)
"""Amplitude [rad] for which the simulator is sized."""
_ROUNDS = 6
_SETTLED = 30.0
"""Time [s] after which the start no longer moves the driving lines."""


@dataclass(frozen=True)
class Assumed:
    """One draw of what is assumed of the test."""

    kappa: float
    """J_h = J_h,1 [1 + kappa (l^2/l_1^2 - 1)], with l the arm of the sized simulator."""
    damping: float
    """Modal damping ratio."""
    settle: float
    """Time before the record [s]."""
    exponent: float
    """The noise's density falls with this power of the frequency."""
    lowest: float
    highest: float
    """Band of the noise [Hz]."""
    rotor_offset: float
    """Rotor off its first command at power-on [full steps]; an unpowered rotor rests at whole ones."""
    missed_1: float = 0.0
    missed_2: float = 0.0
    missed_3: float = 0.0
    """By how much the test's driving lines may be misread, in logarithms."""
    seed: int = 1


def assumptions_of(test: PublishedTest) -> Assumptions:
    """Assumptions of the test; SimulationError where it has none."""
    if test.assumed is None:
        raise SimulationError(f"{test.title}: nothing is assumed of this test, so nothing is drawn")
    return test.assumed


def draw_assumptions(test: PublishedTest, number: int) -> Assumed:
    """Draw ``number`` of the assumptions; 0 is the central one."""
    assumed = assumptions_of(test)
    if number == 0:
        return Assumed(**assumed.values("central"))
    rng = np.random.default_rng(number)
    low, high = assumed.values("low"), assumed.values("high")
    values: dict[str, Any] = {x: float(rng.uniform(low[x], high[x])) for x in low}
    first, second, third = (test.reading_error * rng.standard_normal(3)).tolist()
    drawn = Assumed(**values)
    return replace(drawn, missed_1=first, missed_2=second, missed_3=third, seed=1000 * number)


@dataclass(frozen=True)
class Calibrated:
    """Parameters calibrated to the first state's four lines."""

    inertia: float
    """J_h in the first state [kg m^2]."""
    stiffness: float
    """Stiffness of the reducer [N m/rad]."""
    viscous: float
    """Friction of the rotor [N m s/rad]."""
    density: float
    """Density of the noise at the mode's frequency [N^2 m^2/Hz]."""


def initial_calibration(test: PublishedTest) -> Calibrated:
    """Where a calibration begins: the scenario of the first state."""
    first = scenario_of_state(test, 1)
    assert test.noise_density is not None
    return Calibrated(
        first["array.rigid_inertia"],
        first["reducer.stiffness"],
        first["motor.friction.viscous"],
        test.noise_density,
    )


@cache
def _square_arms(test: PublishedTest) -> tuple[float, ...]:
    """(l/l_1)^2 of the simulator sized for the states."""
    first, *others = (
        TargetState(f"state {number}", state.mode_frequency or 0.0, state.inertia or 0.0)
        for number, state in enumerate(test.states, 1)
    )
    design = load_design(test.simulator)
    assert isinstance(design, SimulatorDesign)
    arms = [setting.design.arm for setting in size(first, others, design, _SIZED_FOR).settings]
    return tuple((arm / arms[0]) ** 2 for arm in arms)


def assumed_scenario(
    test: PublishedTest, number: int, assumed: Assumed, found: Calibrated
) -> Scenario:
    """State ``number`` under the assumptions; its mode, seen through the drive, is at the measured
    frequency.
    """
    first, mode = test.states[0].mode_frequency, test.states[number - 1].mode_frequency
    assert first is not None
    assert mode is not None
    band = np.array([assumed.lowest, assumed.highest])
    density = found.density * (band / first) ** -assumed.exponent
    noise = {"table": np.column_stack([band, density]).tolist(), "seed": assumed.seed}
    grown = 1.0 + assumed.kappa * (_square_arms(test)[number - 1] - 1.0)
    scenario = scenario_of_state(test, number).with_si(
        {
            "array.rigid_inertia": found.inertia * grown,
            "array.modes.0.damping": assumed.damping,
            "reducer.stiffness": found.stiffness,
            "motor.friction.viscous": found.viscous,
            "friction.torque_noise": noise if found.density > 0.0 else None,
            "record.settle": assumed.settle,
        }
    )
    for _ in range(20):
        seen = coupled_modes(scenario)[0].frequency
        if abs(seen / mode - 1.0) < 1e-9:
            break
        clamped = scenario.array.modes[0].frequency * mode / seen
        scenario = scenario.with_si({"array.modes.0.frequency": clamped})
    return scenario


def amplitudes(scenario: Scenario, names: tuple[str, ...], seeds: int = 1) -> np.ndarray:
    """Nearest-bin amplitudes of the lines ``names`` and the largest torque [N m], for each of
    ``seeds`` draws of the noise, (seeds, names + 1).
    """
    rows = []
    for k in range(seeds if scenario.friction.torque_noise else 1):
        one = scenario.with_(seeds_of(scenario, k))
        (torque,) = simulate_torques([one])
        if not isinstance(torque, Torque):
            raise torque
        table = lines_by_name(torque, one, names)
        found = [table[name].bin_amplitude for name in names]
        rows.append([*found, float(np.abs(torque.T_d).max())])
    return np.array(rows)


def calibrate(test: PublishedTest, assumed: Assumed, seeds: int, start: Calibrated) -> Calibrated:
    """Calibrate to the first state's four lines under the assumptions; SimulationError where nothing
    does.

    The three driving lines by Gauss-Newton steps in logarithms, each to the reading error and each
    parameter to ``PRIOR`` about the catalog's value, for the third line is near a null and tells
    little; then the mode's line, whose mean square over draws grows with the density; both once
    more, since noise moves the driving lines a little.
    """
    measured = np.array([one.amplitude for one in reference_lines(test)])
    goals = np.log(measured[1:4]) + np.array([assumed.missed_1, assumed.missed_2, assumed.missed_3])
    found = replace(start, density=0.0)
    for _ in range(2):
        found = _driving_lines(test, assumed, found, goals)
        first = found.density or start.density
        density = _density(test, assumed, found, float(measured[0]), seeds, first)
        found = replace(found, density=density)
    return found


def _driving_lines(
    test: PublishedTest, assumed: Assumed, found: Calibrated, goals: np.ndarray
) -> Calibrated:
    settled, names, error = replace(assumed, settle=_SETTLED), line_names(test), test.reading_error
    before = initial_calibration(test)
    about = np.log([before.inertia, before.stiffness, before.viscous])

    def at(x: np.ndarray) -> Calibrated:
        inertia, stiffness, viscous = np.exp(x).tolist()
        return Calibrated(inertia, stiffness, viscous, found.density)

    def missed(x: np.ndarray) -> np.ndarray:
        simulated = amplitudes(assumed_scenario(test, 1, settled, at(x)), names)[0, 1:4]
        return np.concatenate([(np.log(simulated) - goals) / error, (x - about) / PRIOR])

    x = np.log([found.inertia, found.stiffness, found.viscous])
    r = missed(x)
    for _ in range(_ROUNDS):
        if np.max(np.abs(r[:3])) * error < CALIBRATION_TOLERANCE:
            break
        J = np.column_stack([(missed(x + step) - r) / 0.02 for step in 0.02 * np.eye(3)])
        step = -np.linalg.lstsq(J, r, rcond=None)[0]
        step *= min(1.0, 0.1 / np.max(np.abs(step)))
        trials = ((x + part * step, missed(x + part * step)) for part in 0.5 ** np.arange(4))
        better = next(((at_x, off) for at_x, off in trials if off @ off < 0.99 * (r @ r)), None)
        if better is None:
            break
        x, r = better
    if np.max(np.abs(r[:3])) * error > MAX_CALIBRATION_ERROR:
        raise SimulationError("state 1's driving lines are not reached under these assumptions")
    return at(x)


def _density(
    test: PublishedTest,
    assumed: Assumed,
    found: Calibrated,
    goal: float,
    seeds: int,
    first: float,
) -> float:
    """Density with which the mean over draws of the mode's line is that of the test."""
    names = line_names(test)

    def square(density: float) -> float:
        scenario = assumed_scenario(test, 1, assumed, replace(found, density=density))
        return float(np.mean(amplitudes(scenario, names, seeds)[:, 0]) ** 2)

    quiet, density = square(0.0), first
    if quiet > goal**2:
        raise SimulationError("the start alone makes state 1's mode larger than the test's")
    for _ in range(_ROUNDS):
        seen = square(density)
        if abs(math.sqrt(seen) / goal - 1.0) < CALIBRATION_TOLERANCE:
            return density
        density *= min(max((goal**2 - quiet) / max(seen - quiet, 1e-3 * goal**2), 0.1), 10.0)
    return density
