"""The paper's statements on its test states 1 to 5, under assumptions on what it does not give, and
over their spread.

Three mechanisms that the catalog's states lack: inertia on the shaft that grows with the arm of the simulator's weights, noise of
the slip ring's friction, and a rotor that aligns with its command at power-on. What state 1 carries is *calibrated* to its four
lines: J_h, stiffness of the reducer, viscous friction of the rotor, and the noise's density, to the mode's line alone. The rest is
*assumed*, and drawn. Nothing is fitted to states 2 to 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.lines import lines_by_name
from microvib.analysis.seeds import seeds_of
from microvib.errors import OutputError, SimulationError
from microvib.io.scenario_file import load_scenario
from microvib.io.tables import dict_rows, read_table, rows_csv
from microvib.model.linear import coupled_modes
from microvib.model.reference import ReferenceLine
from microvib.model.scenario import Scenario
from microvib.solve.batch import Torque, simulate_torques, torque_from_rest

MODE, FULL_STEP_LINE = "array_mode_1", "full_step_1"
DRIVE = ("drive_1", "drive_2", "drive_3")
NAMES = (MODE, *DRIVE, FULL_STEP_LINE)
PAPER_PEAK_TORQUE = 1.643
"""Peak of the disturbance torque about the drive axis in state 1 [N m] (text to Figure 9)."""
LARGEST_RANGE = 0.00166
"""Largest range of the lines at the driving frequency and its harmonics over states 1-3 [N m] (text
to Figure 11).
"""
CALIBRATION_TOLERANCE, MAX_CALIBRATION_ERROR = 0.03, 0.15
"""Parts of a line by which a calibration is near enough, and may miss it at most."""
PRIOR = 0.15
"""Standard deviation of each calibrated parameter, in logarithms, before the lines are known."""
_ROUNDS = 6
_SETTLED = 30.0
"""Time [s] after which the start no longer moves the driving lines."""


@dataclass(frozen=True)
class Assumed:
    """What is assumed of the test."""

    kappa: float = 0.06
    """J_h = J_h,1 [1 + kappa (l^2/l_1^2 - 1)], with l the arm of the sized simulator; all that
    moves with its arm is 0.142.

    The central value lies where an earlier trial on the five states worked: rows that it decides
    are consistent, not evidence."""
    damping: float = 0.01041
    """Modal damping ratio."""
    settle: float = 75.0
    """Time before the record [s]."""
    exponent: float = 2.0
    """The noise's density falls with this power of the frequency."""
    lowest: float = 0.3
    highest: float = 5.0
    """Band of the noise [Hz]."""
    rotor_offset: float = 1.0
    """Rotor off its first command at power-on [full steps]; an unpowered rotor rests at whole ones."""
    missed_1: float = 0.0
    missed_2: float = 0.0
    missed_3: float = 0.0
    """By how much the test's driving lines may be misread, in logarithms."""
    seed: int = 1


CENTRAL_ASSUMPTIONS = Assumed()
Rows = Sequence[Mapping[str, str]]
"""Rows of a kept table; the central assumptions come first."""
ASSUMPTION_RANGES: dict[str, tuple[float, float]] = {
    "kappa": (0.0, 0.142),
    "damping": (0.005, 0.02),
    "settle": (45.0, 105.0),
    "exponent": (0.0, 2.0),
    "lowest": (0.1, 0.8),
    "highest": (2.0, 20.0),
    "rotor_offset": (-1.95, 1.95),
}
"""Ranges of what is assumed, each value as likely as another; the test's amplitudes are good to 5 %
(standard deviation).
"""
TEST_READING_ERROR = 0.05


def draw_assumptions(number: int) -> Assumed:
    """Draw ``number`` of the assumptions; 0 is the central one."""
    if number == 0:
        return CENTRAL_ASSUMPTIONS
    rng = np.random.default_rng(number)
    values = {name: float(rng.uniform(*ends)) for name, ends in ASSUMPTION_RANGES.items()}
    missed = {
        f"missed_{k + 1}": float(x)
        for k, x in enumerate(TEST_READING_ERROR * rng.standard_normal(3))
    }
    return Assumed(**values, **missed, seed=1000 * number)


@dataclass(frozen=True)
class Calibrated:
    """What state 1's four lines give."""

    inertia: float
    """J_h in state 1 [kg m^2]."""
    stiffness: float
    """Of the reducer [N m/rad]."""
    viscous: float
    """Friction of the rotor [N m s/rad]."""
    density: float
    """Of the noise at the mode's frequency [N^2 m^2/Hz]."""


@cache
def _square_arms() -> tuple[float, ...]:
    """(l/l_1)^2 of the simulator sized for the five states."""
    from microvib.io.modal_sources import load_design
    from microvib.studies.sas import paper_states, size

    first, *others = paper_states()
    design: Any = load_design("reference-sas")
    arms = [
        setting.design.arm for setting in size(first, others, design, math.radians(2.0)).settings
    ]
    return tuple((arm / arms[0]) ** 2 for arm in arms)


def scenario_of(number: int, assumed: Assumed, found: Calibrated) -> Scenario:
    """Test state ``number`` under the assumptions; its mode, seen through the drive, is at the
    frequency of Table 2.
    """
    from microvib.studies.sas import paper_states

    wanted = paper_states()[number - 1]
    mode = wanted.frequency
    band = np.array([assumed.lowest, assumed.highest])
    table = np.column_stack(
        [band, found.density * (band / paper_states()[0].frequency) ** -assumed.exponent]
    ).tolist()
    scenario = load_scenario(f"state-{number}").with_si(
        {
            "array.rigid_inertia": found.inertia
            * (1.0 + assumed.kappa * (_square_arms()[number - 1] - 1.0)),
            "array.modes.0.damping": assumed.damping,
            "reducer.stiffness": found.stiffness,
            "motor.friction.viscous": found.viscous,
            "friction.torque_noise": {"table": table, "seed": assumed.seed}
            if found.density > 0.0
            else None,
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


def amplitudes(scenario: Scenario, seeds: int = 1) -> np.ndarray:
    """Nearest-bin amplitudes of ``NAMES`` and the largest torque [N m], for each of ``seeds``
    draws, (seeds, names + 1).
    """
    rows = []
    for k in range(seeds if scenario.friction.torque_noise else 1):
        one = scenario.with_(seeds_of(scenario, k))
        (torque,) = simulate_torques([one])
        if not isinstance(torque, Torque):
            raise torque
        table = lines_by_name(torque.T_d, torque.sample_rate, one, NAMES)
        rows.append(
            [*(table[name].bin_amplitude_n_m for name in NAMES), float(np.abs(torque.T_d).max())]
        )
    return np.array(rows)


def reference_lines() -> tuple[ReferenceLine, ...]:
    """Lines of state 1 that were measured, in the order of ``NAMES``."""
    reference = load_scenario("state-1").reference
    assert reference is not None
    return reference.lines


def calibrate(assumed: Assumed, seeds: int, start: Calibrated) -> Calibrated:
    """What state 1's four lines give under the assumptions; SimulationError where nothing does.

    The three driving lines by Gauss-Newton steps in logarithms, each to 5 % and each parameter to
    ``PRIOR`` about the catalog's value, for the third line is near a null and tells little; then
    the mode's line, whose mean square over draws grows with the density; both once more, since
    noise moves the driving lines a little.
    """
    test = np.array([one.amplitude for one in reference_lines()])
    goals = np.log(test[1:4]) + np.array([assumed.missed_1, assumed.missed_2, assumed.missed_3])
    found = replace(start, density=0.0)
    for _ in range(2):
        found = _driving_lines(assumed, found, goals)
        found = replace(
            found,
            density=_density(assumed, found, float(test[0]), seeds, found.density or start.density),
        )
    return found


def _driving_lines(assumed: Assumed, found: Calibrated, goals: np.ndarray) -> Calibrated:
    settled = replace(assumed, settle=_SETTLED)
    about = np.log(
        [INITIAL_CALIBRATION.inertia, INITIAL_CALIBRATION.stiffness, INITIAL_CALIBRATION.viscous]
    )

    def at(x: np.ndarray) -> Calibrated:
        inertia, stiffness, viscous = np.exp(x).tolist()
        return Calibrated(inertia, stiffness, viscous, found.density)

    def missed(x: np.ndarray) -> np.ndarray:
        off = np.log(amplitudes(scenario_of(1, settled, at(x)))[0, 1:4]) - goals
        return np.concatenate([off / TEST_READING_ERROR, (x - about) / PRIOR])

    x = np.log([found.inertia, found.stiffness, found.viscous])
    r = missed(x)
    for _ in range(_ROUNDS):
        if np.max(np.abs(r[:3])) * TEST_READING_ERROR < CALIBRATION_TOLERANCE:
            break
        J = np.column_stack([(missed(x + step) - r) / 0.02 for step in 0.02 * np.eye(3)])
        step = -np.linalg.lstsq(J, r, rcond=None)[0]
        step *= min(1.0, 0.1 / np.max(np.abs(step)))
        trials = ((x + part * step, missed(x + part * step)) for part in 0.5 ** np.arange(4))
        better = next(((at_x, off) for at_x, off in trials if off @ off < 0.99 * (r @ r)), None)
        if better is None:
            break
        x, r = better
    if np.max(np.abs(r[:3])) * TEST_READING_ERROR > MAX_CALIBRATION_ERROR:
        raise SimulationError("state 1's driving lines are not reached under these assumptions")
    return at(x)


def _density(assumed: Assumed, found: Calibrated, goal: float, seeds: int, first: float) -> float:
    """Density with which the mean over draws of the mode's line is that of the test."""

    def square(density: float) -> float:
        return float(
            np.mean(
                amplitudes(scenario_of(1, assumed, replace(found, density=density)), seeds)[:, 0]
            )
            ** 2
        )

    quiet, density = square(0.0), first
    if quiet > goal**2:
        raise SimulationError("the start alone makes state 1's mode larger than the test's")
    for _ in range(_ROUNDS):
        seen = square(density)
        if abs(math.sqrt(seen) / goal - 1.0) < CALIBRATION_TOLERANCE:
            return density
        density *= min(max((goal**2 - quiet) / max(seen - quiet, 1e-3 * goal**2), 0.1), 10.0)
    return density


@dataclass(frozen=True)
class Statement:
    """One statement of the paper: what is compared, and whether it holds."""

    item: str
    source: str
    bar: str
    value: Callable[[Mapping[int, np.ndarray]], float]
    """Of the amplitudes (names + 1,) in each state."""
    holds: Callable[[float], bool]


def _ratio(line: str, first: int, second: int) -> Callable[[Mapping[int, np.ndarray]], float]:
    k = NAMES.index(line)
    return lambda of: float(of[second][k] / of[first][k])


def _range(line: str) -> Callable[[Mapping[int, np.ndarray]], float]:
    k = NAMES.index(line)
    return lambda of: float(np.ptp([of[number][k] for number in (1, 2, 3)]))


def _peak(state: int) -> Callable[[Mapping[int, np.ndarray]], float]:
    return lambda of: float(of[state][-1])


def _increases(value: float) -> bool:
    return value > 1.0


def _like_the_peak(value: float) -> bool:
    return 0.5 <= value / PAPER_PEAK_TORQUE <= 2.0


def _statements() -> Iterator[Statement]:
    for line in DRIVE:
        item, bar = (
            f"{line}, range of amplitudes over states 1-3 [N m]",
            f"at most {LARGEST_RANGE:g} N m",
        )
        yield Statement(
            item, "text to Figure 11", bar, _range(line), lambda value: value <= LARGEST_RANGE
        )
    for first, second in ((1, 2), (2, 3)):
        item = f"{MODE} grows with the mode's frequency: state {second} over state {first} [1]"
        yield Statement(
            item, "text to Figure 11", "greater than 1", _ratio(MODE, first, second), _increases
        )
    for line in (MODE, *DRIVE):
        for first, second in ((1, 4), (4, 5)):
            item = f"{line} grows with inertia: state {second} over state {first} [1]"
            yield Statement(
                item, "text to Figure 12", "greater than 1", _ratio(line, first, second), _increases
            )
    for when, state in (("in the record", 1), ("from power-on", 0)):
        item = f"largest disturbance torque {when} [N m]"
        yield Statement(
            item, "text to Figure 9", "within a factor of 2", _peak(state), _like_the_peak
        )
    item = (
        "line at the full-step rate, 3.313 Hz, which the paper does not list, over the mode's [1]"
    )
    k = NAMES.index(FULL_STEP_LINE)
    yield Statement(
        item,
        "detent torque, Eq. 4",
        "greater than 1",
        lambda of: float(of[1][k] / of[1][0]),
        _increases,
    )


STATEMENTS = tuple(_statements())


@dataclass(frozen=True)
class Outcome:
    """The five states under one set of assumptions."""

    assumed: Assumed
    calibrated: Calibrated
    records: dict[int, np.ndarray]
    """Amplitudes of each state, (seeds, names + 1); 0: state 1 from power-on, its largest torque
    alone is told.
    """

    @property
    def means(self) -> dict[int, np.ndarray]:
        """Means over the seeds."""
        return {number: rows.mean(axis=0) for number, rows in self.records.items()}

    def value(self, statement: Statement) -> float:
        """What the means over the seeds say of a statement."""
        return statement.value(self.means)

    def single(self, statement: Statement) -> float:
        """Part of the single records, one in each state, in which it holds."""
        seeds = min(len(self.records[number]) for number in range(1, 6))
        each = (
            {n: rows[min(k, len(rows) - 1)] for n, rows in self.records.items()}
            for k in range(seeds)
        )
        return float(np.mean([statement.holds(statement.value(record)) for record in each]))


def outcome(assumed: Assumed, found: Calibrated, seeds: int) -> Outcome:
    """Run the five states, each with so many draws of the noise, and state 1 from power-on."""
    records = {
        number: amplitudes(scenario_of(number, assumed, found), seeds) for number in range(1, 6)
    }
    on = {"record.settle": 0.0, "record.duration": 2.0, "record.rotor_offset": assumed.rotor_offset}
    peak = float(np.abs(torque_from_rest(scenario_of(1, assumed, found).with_si(on)).T_d).max())
    return Outcome(assumed, found, {0: np.array([[*[math.nan] * len(NAMES), peak]]), **records})


def row_of(number: int, seeds: int, start: Calibrated) -> dict[str, Any]:
    """Draw ``number`` as a row of the kept table: assumptions, calibrated values, and of each
    statement value, whether it holds on the means, and in which part of single records; without
    them where state 1 cannot be calibrated."""
    assumed = draw_assumptions(number)
    row: dict[str, Any] = {"draw": number, "seeds": seeds, **asdict(assumed)}
    try:
        found = calibrate(assumed, seeds, start)
        reached = outcome(assumed, found, seeds)
    except SimulationError as error:
        return row | {"refused": str(error)}
    row |= {"refused": "", **asdict(found)}
    row |= {
        f"state_{n}_{name}": float(x)
        for n in range(1, 6)
        for name, x in zip(NAMES, reached.means[n], strict=False)
    }
    for k, statement in enumerate(STATEMENTS):
        value = reached.value(statement)
        row |= {
            f"value_{k}": value,
            f"holds_{k}": float(statement.holds(value)),
            f"single_{k}": reached.single(statement),
        }
    return row


INITIAL_CALIBRATION = Calibrated(0.1407, 5053.0, 0.01442, 4e-6)
"""Where a calibration begins: the catalog's state 1."""


def extend_table(
    path: Path, draws: int, seeds: int, progress: Callable[[int, int], None] | None = None
) -> list[dict[str, str]]:
    """Rows of the table ``path``: the central assumptions and ``draws`` others; what it lacks is
    computed and added, row by row.

    ``progress`` is called with the rows that are there and those that there will be, before the
    first and after each.
    """
    from microvib.io.writing import write_file

    if path.is_file():
        rows = dict_rows(path, _COLUMNS, OutputError, ignored=".*")
    else:
        rows = []
    if rows and list(rows[0]) != _COLUMNS:
        raise OutputError(
            f"{path}: is not a table of draws of this version; nothing was written; choose another"
            " file"
        )
    lacking = sorted(set(range(draws + 1)) - {int(row["draw"]) for row in rows})
    total = len(rows) + len(lacking)
    if progress:
        progress(len(rows), total)
    for number in lacking:
        made = row_of(number, seeds, INITIAL_CALIBRATION)
        rows.append({name: _cell(made.get(name, "")) for name in _COLUMNS})
        write_file(
            path,
            rows_csv(_COLUMNS, ([row[name] for name in _COLUMNS] for row in rows)),
            overwrite=True,
        )
        if progress:
            progress(len(rows), total)
    return rows


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)


_COLUMNS = [
    "draw", "seeds", *(f.name for f in fields(Assumed)), "refused", *(f.name for f in fields(Calibrated)),
    *(f"state_{n}_{name}" for n in range(1, 6) for name in NAMES),
    *(f"{what}_{k}" for k in range(len(STATEMENTS)) for what in ("value", "holds", "single")),
]  # fmt: skip


def kept_draws() -> list[dict[str, str]]:
    """The table of the catalog, of which ``microvib statements`` says how it is made."""
    return read_table("statements")


def fraction_holding(rows: Rows, statement: int) -> tuple[float, float]:
    """Part of the draws, the central one apart, in which a statement holds on the means; and of
    their single records.
    """
    of = [row for row in rows if int(row["draw"]) > 0 and not row["refused"]]
    on_means, single = (
        float(np.mean([float(row[f"{what}_{statement}"]) for row in of])) if of else math.nan
        for what in ("holds", "single")
    )
    return on_means, single
