"""Everything that the paper claims of its test and simulation, beside what the catalog's scenarios
give.

The drive's unknown parameters were identified from state 1's lines (Tables 5 and 6), so those rows
are *calibrated*. What the paper does not give and no line tells is *assumed*
(``microvib.studies.statements``). The other states are *predicted*: nothing was fitted to them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace

import numpy as np

from microvib.analysis.lines import find_lines
from microvib.analysis.reference import compare_with_reference
from microvib.io.scenario_file import load_scenario
from microvib.io.tables import rows_csv
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.solve.motion import Motion
from microvib.solve.simulate import simulate
from microvib.studies.statements import (
    ASSUMPTION_RANGES,
    CENTRAL_ASSUMPTIONS,
    LARGEST_RANGE,
    NAMES,
    PAPER_PEAK_TORQUE,
    STATEMENTS,
    Calibrated,
    Rows,
    fraction_holding,
    kept_draws,
    reference_lines,
)

CALIBRATED, ASSUMED, PREDICTED, COMPUTED = "calibrated", "assumed", "predicted", "computed"
AMPLITUDE_BAR, CENTRAL_BAR = 0.1, 0.05
CONVERGENCE_BAR = 0.01


@dataclass(frozen=True)
class Check:
    """One claim: what the paper, its test and we say, and whether our figure meets its bar. nan
    where nothing is said.

    What is assumed, and a parameter that was calibrated, claims nothing: it neither holds nor
    fails.
    """

    item: str
    source: str
    paper: float
    test: float
    ours: float
    error_percent: float
    bar: str
    holds: bool | None
    status: str
    over_spread: float = math.nan
    """Part of the draws of the assumptions in which a prediction holds on the means over the noise."""
    single_records: float = math.nan
    """Part of single records, as the test was, in which it holds."""
    without: float = math.nan
    """What the catalog's states give, without noise, moving masses and power-on."""


@dataclass(frozen=True)
class SimulatedState:
    """One of the paper's test states, simulated."""

    motion: Motion
    table: LineTable


def validate(
    progress: Callable[[str], None] | None = None,
) -> tuple[list[Check], dict[int, SimulatedState]]:
    """All checks, and the states' motions that they come from."""
    tell = progress or (lambda text: None)
    states = {}
    for number in range(1, 6):
        tell(f"state {number}")
        states[number] = _state(load_scenario(f"state-{number}"))
    tell("state 1 with steps half as long")
    first = states[1].motion.scenario
    finer = _state(first.with_({"solver.refinement": 2 * first.solver.refinement}))
    tell("state 1 from power-on")
    whole = {"record.settle": 0.0, "record.duration": first.record.settle + first.record.duration}
    start = float(np.abs(simulate(first.with_si(whole), channels=("T_d",))["T_d"]).max())
    kept = kept_draws()
    checks = [
        *_equations(first),
        *_tables(states[1]),
        *_assumptions(kept),
        *_statements(states, start, kept),
        *_numerics(states, finer),
    ]
    return checks, states


def _state(scenario: Scenario) -> SimulatedState:
    motion = simulate(scenario, channels=("T_d",))
    return SimulatedState(motion, find_lines(motion))


def _claim(
    item: str,
    source: str,
    ours: float,
    bar: str,
    holds: bool | None,
    status: str,
    *,
    paper: float = math.nan,
    test: float = math.nan,
) -> Check:
    """A claim; the error is that against the test, or the paper where there is no test."""
    error = 100 * (ours / (paper if math.isnan(test) else test) - 1.0)
    return Check(item, source, paper, test, ours, error, bar, holds, status)


def _near(
    item: str,
    source: str,
    ours: float,
    bar: float,
    status: str,
    *,
    paper: float,
    test: float = math.nan,
) -> Check:
    claim = _claim(
        item, source, ours, f"within {100 * bar:g} %", True, status, paper=paper, test=test
    )
    return replace(claim, holds=abs(claim.error_percent) <= 100 * bar)


def _equations(scenario: Scenario) -> Iterable[Check]:
    nominal = scenario.with_({"tracking.clock_ratio": 1.0})
    step, f_d = (
        math.degrees(nominal.driver.full_step(nominal.motor)),
        nominal.driving_frequency or math.nan,
    )
    yield _near("full step [deg]", "Eq. 25", step, 1e-6, COMPUTED, paper=1.8)
    yield _near("driving frequency [Hz]", "Eq. 26", f_d, 1e-4, COMPUTED, paper=53.33)


def _tables(state: SimulatedState) -> Iterable[Check]:
    rows = compare_with_reference(state.motion.scenario, state.table)
    resolution = state.motion.sample_rate / state.table.samples
    for r in rows:
        bar, holds = (
            f"the test's bin, {resolution:g} Hz wide",
            abs(r.run_hz - r.measured_hz) < 0.5 * resolution,
        )
        item = f"{r.line} line, frequency [Hz]"
        yield _claim(
            item, "Table 5", r.run_hz, bar, holds, CALIBRATED, paper=r.model_hz, test=r.measured_hz
        )
    for r in rows:
        item = f"{r.line} line, nearest-bin amplitude [N m]"
        yield _near(
            item,
            "Table 6",
            r.run_n_m,
            AMPLITUDE_BAR,
            CALIBRATED,
            paper=r.model_n_m,
            test=r.measured_n_m,
        )


def _amplitude(state: SimulatedState, line: str) -> float:
    return float(state.table[line].bin_amplitude_n_m)


def _assumptions(kept: Rows) -> Iterable[Check]:
    """What the predictions rest on: what is assumed, with its range, and what is calibrated under
    the central assumptions.
    """
    for key, (low, high) in ASSUMPTION_RANGES.items():
        claim = _claim(
            f"{key} of the central assumptions",
            "statements",
            getattr(CENTRAL_ASSUMPTIONS, key),
            "",
            None,
            ASSUMED,
        )
        yield replace(claim, bar=f"drawn from {low:g} to {high:g}")
    row = kept[0]
    for key in (f.name for f in fields(Calibrated)):
        claim = _claim(
            f"{key} under the central assumptions [SI]",
            "statements",
            float(row[key]),
            "",
            None,
            CALIBRATED,
        )
        yield replace(claim, bar="to state 1's four lines")
    for one in reference_lines():
        ours, model = float(row[f"state_1_{one.line}"]), one.model_amplitude or math.nan
        item = f"{one.line} of state 1 under the central assumptions [N m]"
        yield _near(item, "Table 6", ours, CENTRAL_BAR, CALIBRATED, paper=model, test=one.amplitude)


def _statements(states: dict[int, SimulatedState], start: float, kept: Rows) -> Iterable[Check]:
    """The paper's statements under the central assumptions, how often they hold over the spread,
    and without any of it.
    """
    bare = {
        n: np.array([*(_amplitude(x, name) for name in NAMES), np.abs(x.motion["T_d"]).max()])
        for n, x in states.items()
    }
    bare[0] = np.array([*[math.nan] * len(NAMES), start])
    for k, statement in enumerate(STATEMENTS):
        ours, (spread, single) = float(kept[0][f"value_{k}"]), fraction_holding(kept, k)
        said = {LARGEST_RANGE: "range", PAPER_PEAK_TORQUE: "largest"}
        test = next((value for value, word in said.items() if word in statement.item), math.nan)
        claim = _claim(
            statement.item, statement.source, ours, statement.bar, statement.holds(ours), PREDICTED
        )
        yield replace(
            claim,
            test=test,
            error_percent=100.0 * (ours / test - 1.0) if "largest" in statement.item else math.nan,
            over_spread=spread,
            single_records=single,
            without=statement.value(bare),
        )


def _numerics(states: dict[int, SimulatedState], finer: SimulatedState) -> Iterable[Check]:
    change = max(abs(_amplitude(finer, x) / _amplitude(states[1], x) - 1.0) for x in NAMES[:4])
    forms = max(s.motion.invariants.torque_forms for s in states.values())
    energy = max(s.motion.invariants.energy_mechanical for s in states.values())
    for item, source, ours, most, bar in (
        ("largest change of a line when steps are halved, state 1 [1]", "convergence", change, CONVERGENCE_BAR,
         f"{100 * CONVERGENCE_BAR:g} %"),
        ("momentum form against force form of T_d, states 1-5 [1]", "Eq. 20", forms, 1e-9, "1e-09"),
        ("energy balance beyond Joule heat, states 1-5 [1]", "Eq. 20", energy, 1e-3, "0.001"),
    ):  # fmt: skip
        yield _claim(item, source, ours, f"at most {bar}", ours <= most, COMPUTED)


def checks_csv(checks: Iterable[Check]) -> str:
    """CSV text of the checks; ``holds`` is yes or no, what is not said is empty."""
    names = [f.name for f in fields(Check)]
    return rows_csv(names, ([_cell(getattr(check, name)) for name in names] for check in checks))


def _cell(value: object) -> str:
    if isinstance(value, bool | np.bool_):
        if value:
            return "yes"
        return "no"
    if value is None:
        return ""
    if isinstance(value, float):
        if math.isnan(value):
            return ""
        return f"{value:.6g}"
    return str(value)
