"""Everything that is compared of a published test, beside what the scenarios of its states give.

Lines from which parameters of the scenarios were identified are *calibrated*. What the publication
does not give and no line tells is *assumed* (``microvib.validation.assumptions``). All else is
*predicted*: nothing was fitted to it. Arithmetic and our own numerics are *computed*.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np

from microvib.analysis.lines import find_lines
from microvib.analysis.reference import compare_with_reference, is_calibrated
from microvib.errors import MicrovibError
from microvib.io.tables import rows_csv
from microvib.model.scenario import Scenario
from microvib.results import Column, Measure
from microvib.signals.line_table import LineTable
from microvib.solve.motion import Motion
from microvib.solve.simulate import simulate
from microvib.validation.assumptions import Calibrated
from microvib.validation.claims import (
    Claim,
    claims_of,
    line_names,
    power_on_states,
    reference_lines,
    scenario_of_state,
)
from microvib.validation.draws import Rows, fraction_holding, kept_draws
from microvib.validation.published import DEFAULT_TEST, PublishedTest, load_test

CALIBRATED, ASSUMED, PREDICTED, COMPUTED = "calibrated", "assumed", "predicted", "computed"
CENTRAL_BAR = 0.05
"""Relative difference from a measured line that a calibration under the central assumptions has at
most.
"""
CONVERGENCE_BAR = 0.01
_FIGURE = Measure(form=".5g")
_PART = Measure("%", 0.01, ".0f")


@dataclass(frozen=True)
class Check:
    """One claim: what the publication, its test and we say, and whether our figure meets its bar.
    nan where nothing is said.

    What is assumed, and a parameter that was calibrated, claims nothing: it neither holds nor
    fails.
    """

    item: Annotated[str, Column("item", "item")]
    source: Annotated[str, Column("source", "source", report_only=True)]
    paper: Annotated[float, Column("paper", "published", _FIGURE)]
    test: Annotated[float, Column("test", "test", _FIGURE)]
    ours: Annotated[float, Column("ours", "ours", _FIGURE)]
    error_percent: Annotated[float, Column("error_percent", "error", Measure("%", form=".3g"))]
    bar: Annotated[str, Column("bar", "bar")]
    holds: bool | None
    status: Annotated[str, Column("status", "status", role="group")]
    over_spread: Annotated[float, Column("over_spread", "over spread", _PART)] = math.nan
    """Part of the draws of the assumptions in which a prediction holds on the means over the noise."""
    single_records: Annotated[float, Column("single_records", "single records", _PART)] = math.nan
    """Part of single records, as the test was, in which it holds."""
    without: Annotated[float, Column("without", "without", Measure(form=".4g"))] = math.nan
    """Value from the scenarios alone, without the assumptions."""

    @property
    def verdict(self) -> Annotated[str, Column("holds", "verdict", role="verdict")]:
        """Whether it holds, in words; empty where it claims nothing."""
        if self.holds is None:
            return ""
        return "pass" if self.holds else "fail"


@dataclass(frozen=True)
class SimulatedState:
    """One state of the test, simulated."""

    motion: Motion
    table: LineTable

    def amplitude(self, line: str) -> float:
        """Amplitude of a line by the estimator of the reference lines, of the nearest bin without
        any; MicrovibError where the run has no such line.
        """
        if line not in {one.name for one in self.table}:
            raise MicrovibError(
                f"{line}: is not a line of {self.motion.scenario.title or 'a state'}, of which the"
                " test claims something"
            )
        reference = self.motion.scenario.reference
        if reference is not None and reference.estimator == "fitted":
            return float(self.table[line].amplitude)
        return float(self.table[line].bin_amplitude)


@dataclass(frozen=True)
class Validation:
    """A published test, all checks of it, and the states' motions that they come from."""

    test: PublishedTest
    checks: list[Check]
    states: dict[int, SimulatedState]


def validate(name: str = DEFAULT_TEST, progress: Callable[[str], None] | None = None) -> Validation:
    """Check the published test ``name``, of the catalog or of a YAML file.

    Raises MicrovibError where it is not one, or a state cannot be simulated.
    """
    tell = progress or (lambda text: None)
    test = load_test(name)
    states = {}
    for number in range(1, len(test.states) + 1):
        tell(f"state {number}")
        states[number] = _simulated(scenario_of_state(test, number))
    tell("state 1 with steps half as long")
    first = states[1].motion.scenario
    finer = _simulated(first.with_({"solver.refinement": 2 * first.solver.refinement}))
    peaks = {}
    for number in power_on_states(test):
        tell(f"state {number} from power-on")
        peaks[number] = _peak_from_power_on(states[number].motion.scenario)
    kept = kept_draws(name, test)
    checks = [
        *_derived(test, first),
        *(check for n, state in states.items() for check in _lines_of_state(test, n, state)),
        *_assumptions(test, kept),
        *_claims(test, states, peaks, kept),
        *_numerics(test, states, finer),
    ]
    return Validation(test, checks, states)


def _simulated(scenario: Scenario) -> SimulatedState:
    motion = simulate(scenario, channels=("T_d",))
    return SimulatedState(motion, find_lines(motion))


def _peak_from_power_on(scenario: Scenario) -> float:
    """Largest torque [N m] of a record that begins at rest."""
    record = scenario.record
    whole = {"record.settle": 0.0, "record.duration": record.settle + record.duration}
    return float(np.abs(simulate(scenario.with_si(whole), channels=("T_d",))["T_d"]).max())


def _check(  # noqa: PLR0913 - a row of the checks
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
    """A check; the error is that against the test, or the publication where there is no test."""
    if math.isnan(test):
        error = 100 * (ours / paper - 1.0)
    else:
        error = 100 * (ours / test - 1.0)
    return Check(item, source, paper, test, ours, error, bar, holds, status)


def check_near(  # noqa: PLR0913 - a row of the checks
    item: str,
    source: str,
    ours: float,
    bar: float,
    status: str,
    *,
    paper: float,
    test: float = math.nan,
) -> Check:
    """A check that holds where the error is at most the ``bar``, a relative difference."""
    check = _check(
        item, source, ours, f"within {100 * bar:g} %", True, status, paper=paper, test=test
    )
    return replace(check, holds=abs(check.error_percent) <= 100 * bar)


def _derived(test: PublishedTest, scenario: Scenario) -> Iterator[Check]:
    """Checks of values that the publication derives from the drive's parameters."""
    nominal = scenario.with_({"tracking.clock_ratio": 1.0})
    if test.full_step is not None:
        said, step = test.full_step, math.degrees(nominal.driver.full_step(nominal.motor))
        published = math.degrees(said.value)
        yield check_near(
            "full step [deg]", said.source, step, said.within, COMPUTED, paper=published
        )
    if test.driving_frequency is not None:
        told, f_d = test.driving_frequency, nominal.driving_frequency or math.nan
        yield check_near(
            "driving frequency [Hz]", told.source, f_d, told.within, COMPUTED, paper=told.value
        )


def _lines_of_state(test: PublishedTest, number: int, state: SimulatedState) -> Iterator[Check]:
    """Reference lines of a state's scenario beside those of its run."""
    scenario = state.motion.scenario
    if test.lines is None or scenario.reference is None:
        return
    rows = compare_with_reference(scenario, state.table)
    resolution = state.motion.sample_rate / state.table.samples
    status = CALIBRATED if is_calibrated(scenario) else PREDICTED
    whose = "" if number == 1 else f" of state {number}"
    if scenario.reference.estimator == "nearest bin":
        estimator = "nearest-bin amplitude"
    else:
        estimator = "amplitude"
    for r in rows:
        yield _check(
            f"{r.line} line{whose}, frequency [Hz]",
            test.lines.frequencies,
            r.run_frequency,
            f"the test's bin, {resolution:g} Hz wide",
            abs(r.run_frequency - r.measured_frequency) < 0.5 * resolution,
            status,
            paper=r.model_frequency,
            test=r.measured_frequency,
        )
    for r in rows:
        yield check_near(
            f"{r.line} line{whose}, {estimator} [N m]",
            test.lines.amplitudes,
            r.run_amplitude,
            test.lines.within,
            status,
            paper=r.model_amplitude,
            test=r.measured_amplitude,
        )


def _assumptions(test: PublishedTest, kept: Rows) -> Iterator[Check]:
    """Basis of the predictions: assumptions with their ranges, and parameters calibrated under the central assumptions."""
    if test.assumed is None or not kept:
        return
    low, high = test.assumed.values("low"), test.assumed.values("high")
    for key, value in test.assumed.values("central").items():
        item, bar = f"{key} of the central assumptions", f"drawn from {low[key]:g} to {high[key]:g}"
        yield _check(item, "statements", value, bar, None, ASSUMED)
    row = kept[0]
    for key in (f.name for f in fields(Calibrated)):
        item = f"{key} under the central assumptions [SI]"
        yield _check(
            item, "statements", float(row[key]), "to state 1's four lines", None, CALIBRATED
        )
    source = "" if test.lines is None else test.lines.amplitudes
    for one in reference_lines(test):
        ours, model = float(row[f"state_1_{one.line}"]), one.model_amplitude or math.nan
        item = f"{one.line} of state 1 under the central assumptions [N m]"
        yield check_near(
            item, source, ours, CENTRAL_BAR, CALIBRATED, paper=model, test=one.amplitude
        )


def _claims(
    test: PublishedTest,
    states: dict[int, SimulatedState],
    peaks: dict[int, float],
    kept: Rows,
) -> Iterator[Check]:
    """The publication's claims under the central assumptions, how often they hold over the spread,
    and without any of it; of a test without draws, what its scenarios give.
    """
    names = line_names(test)
    bare = {
        n: np.array([*(x.amplitude(name) for name in names), np.abs(x.motion["T_d"]).max()])
        for n, x in states.items()
    }
    for number, peak in peaks.items():
        bare[-number] = np.array([*[math.nan] * len(names), peak])
    for k, claim in enumerate(claims_of(test)):
        without = claim.value(bare)
        if kept:
            check = _claimed(claim, float(kept[0][f"value_{k}"]))
            spread, single = fraction_holding(kept, k)
            yield replace(check, over_spread=spread, single_records=single, without=without)
        else:
            yield _claimed(claim, without)


def _claimed(claim: Claim, ours: float) -> Check:
    check = _check(
        claim.item,
        claim.source,
        ours,
        claim.bar,
        claim.holds(ours),
        PREDICTED,
        test=claim.published,
    )
    if claim.is_measured:
        return check
    return replace(check, error_percent=math.nan)


def _numerics(
    test: PublishedTest, states: dict[int, SimulatedState], finer: SimulatedState
) -> Iterator[Check]:
    """Whether steps are fine enough, and momentum and energy balanced."""
    names = [one.line for one in reference_lines(test)] or line_names(test)
    changes = [abs(finer.amplitude(x) / states[1].amplitude(x) - 1.0) for x in names]
    all_states = f"states 1-{len(states)}" if len(states) > 1 else "state 1"
    invariants = [state.motion.invariants for state in states.values()]
    rows = (
        (
            "largest change of a line when steps are halved, state 1 [1]",
            "convergence",
            max(changes, default=0.0),
            CONVERGENCE_BAR,
            f"{100 * CONVERGENCE_BAR:g} %",
        ),
        (
            f"momentum form against force form of T_d, {all_states} [1]",
            "Eq. 20",
            max(one.torque_forms for one in invariants),
            1e-9,
            "1e-09",
        ),
        (
            f"energy balance beyond Joule heat, {all_states} [1]",
            "Eq. 20",
            max(one.energy_mechanical for one in invariants),
            1e-3,
            "0.001",
        ),
    )
    for item, source, ours, most, bar in rows:
        yield _check(item, source, ours, f"at most {bar}", ours <= most, COMPUTED)


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
