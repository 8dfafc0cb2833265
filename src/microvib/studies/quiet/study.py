"""Search for what makes a drive quieter, and proof of what was found: ``quiet(scenario, ...)``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from microvib.errors import OptionError, ScenarioError, error_context, expect_list, whole_number
from microvib.io.current_table import read_current_table
from microvib.io.file_access import NO_FILES, WORKING_FOLDER, FileAccess
from microvib.model.driver import MAX_TABLE
from microvib.model.scenario import GivenScenario, Scenario, as_scenario
from microvib.model.sentences import validate_part
from microvib.model.torque_margin import (
    MotorisationFactors,
    TorqueMargin,
    lag_of_array,
    torque_margin,
)
from microvib.results import COUNT, DECIBEL, FREQUENCY, TORQUE, Column
from microvib.solve.integration import Progress
from microvib.studies.campaign.statistics import quantile
from microvib.studies.quiet.cases import JUDGE_CASES, DrawnCases, draw_cases
from microvib.studies.quiet.evaluate import Evaluations, Figure, drawn, evaluations, searched_record
from microvib.studies.quiet.lever_options import parse_levers
from microvib.studies.quiet.levers import (
    Lever,
    Setting,
    TableLimits,
    with_levers,
)
from microvib.studies.quiet.objective import Objective, parse_objective
from microvib.studies.quiet.search import Drives, Search, Tried
from microvib.studies.quiet.starts import SEARCHED, STARTS, require_constant_rate
from microvib.units import quantity

DEFAULT_EFFORT, EFFORT_RANGE = 200, (4, 100_000)
"""Settings that a search tries over the drawn cases."""
CASES_RANGE = (8, 10_000)
ALONE_EFFORT = 24
"""Settings of each lever alone that are tried on the nominal drive."""
COEXISTING = 1.25
"""Ratio of the figures from two starts from which they have led to different motions."""
P95 = 0.95


@dataclass(frozen=True)
class Constraints:
    """Bounds that every setting must keep."""

    margin: float = 0.0
    """Least torque margin, with its factors."""
    factors: MotorisationFactors = field(default_factory=MotorisationFactors)
    lag: float = math.inf
    """Largest quasi-static angle [rad] by which the array stays behind its command."""

    @classmethod
    def of_texts(
        cls, margin: str = "0", factors: Iterable[str] = (), lag: str | None = None
    ) -> Constraints:
        """Constraints as they are typed: factors as ``friction=1.5``, the lag with a unit.

        OptionError for what is none.
        """
        return cls(
            quantity("margin", margin, ""),
            _factors(factors),
            math.inf if lag is None else quantity("lag", lag, "rad", positive=True, example="deg"),
        )

    def why_not(self, scenario: Scenario) -> str:
        """Why a drive does not keep them; empty where it does."""
        found = torque_margin(scenario, self.factors)
        if found.margin < self.margin:
            return f"torque margin {found.margin:.2f}, below {self.margin:.2f}"
        lag = lag_of_array(scenario)
        if lag > self.lag:
            return f"the array stays {math.degrees(lag):.3g} deg behind its command"
        driver, motor = scenario.driver, scenario.motor
        if driver.supply_voltage is not None and driver.drive == "current":
            needed = driver.largest_reference(motor) * motor.winding_resistance
            if needed > driver.supply_voltage:
                return f"the currents take {needed:.3g} V, above the supply of {driver.supply_voltage:.3g} V"
        return ""


def _factors(given: Iterable[str]) -> MotorisationFactors:
    values = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals:
            raise OptionError(
                "factor", "is not allowed; write NAME=NUMBER, such as friction=1.5", text
            )
        values[name.strip()] = quantity("factor", value.strip(), "")
    try:
        return validate_part(MotorisationFactors, values)
    except ScenarioError as error:
        raise OptionError("factor", str(error)) from None


@dataclass(frozen=True)
class Spread:
    """The figure of one design: of the nominal drive, and over cases, each from its worst start."""

    design: Annotated[str, Column("design", "design")]
    nominal: float
    """Figure of the nominal drive, from its worst start."""
    from_rest: float
    cases: np.ndarray
    """Figures of the cases, each from its worst start, (cases,); infinite where it does not come to its
    rate, nan where it is not known: a record does not show what is asked for."""
    most: np.ndarray
    """Upper bounds of them, (cases,); infinite where nothing is known."""
    least: np.ndarray
    """Lower bounds of them, (cases,): what the record shows of a steady motion; of cases that are known
    their figures."""
    coexisting: Annotated[int, Column("coexisting", "cases with several motions", COUNT)]
    """Cases in which different starts are shown to lead to different motions."""
    duration: float = math.nan
    """Length of record [s] from which cases and the nominal drive are known; nan where they are, or where
    no length is known to help."""

    @property
    def median(self) -> float:
        """Median over cases; nan where cases that are not known decide it."""
        return _known(*(float(np.median(x)) for x in (self.least, self.most)))

    @property
    def p95(self) -> float:
        """95 % quantile over cases; nan where cases that are not known decide it."""
        return _known(self.p95_least, upper_quantile(self.most, P95))

    @property
    def p95_least(self) -> float:
        """The quantile if cases that are not known had no more than what is shown of them."""
        return upper_quantile(self.least, P95)

    @property
    def p95_most(self) -> float:
        """Upper end of its two-sided 95 % interval between order statistics; nan where there are
        too few cases for one. Cases that are not known count with what they are at most.
        """
        return quantile(self.most, P95).high

    @property
    def unknown(self) -> int:
        """Cases whose figure is not known."""
        return int(np.sum(np.isnan(self.cases)))

    @property
    def worst(self) -> float:
        """Largest of all cases; nan where one that is not known decides it."""
        return _known(float(self.least.max()), float(self.most.max()))

    @property
    def failed(self) -> int:
        """Cases that do not come to their rate."""
        return int(np.sum(np.isinf(self.cases)))


def upper_quantile(values: np.ndarray, part: float) -> float:
    """Least of some values (n,) that a further one exceeds with a probability of at most 1 - ``part``;
    the largest where they are too few for that; nan where one is.

    The k-th smallest of n values is exceeded with the probability 1 - k/(n + 1), whatever their
    distribution is.
    """
    if np.any(np.isnan(values)):
        return math.nan
    k = min(math.ceil(part * (values.size + 1)), values.size)
    return float(np.sort(values)[k - 1])


def _known(least: float, most: float) -> float:
    """A figure whose bounds are the same, nan where they are not."""
    return least if least == most else math.nan


@dataclass(frozen=True)
class LeverAlone:
    """Gain that one lever brings by itself, on the nominal drive."""

    lever: str
    setting: str
    figure: float
    """From its worst start."""
    from_rest: float
    why_not: str = ""


_NOT_KNOWN = "not known"
"""Stands for a line that a record does not tell, or of a drive that does not come to its rate."""


@dataclass(frozen=True)
class LineChange:
    """One line before and after, 0-to-peak [N m], each case from its worst start; nan where the record
    does not tell it (hidden by others, not resolved, above the passband), of a quantile where such
    cases decide it; infinite of a drive that does not come to its rate.
    """

    name: Annotated[str, Column("line", "line")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    before: Annotated[float, Column("before_n_m", "before", TORQUE, absent=_NOT_KNOWN)]
    after: Annotated[float, Column("after_n_m", "after", TORQUE, absent=_NOT_KNOWN)]
    before_median: Annotated[float, Column("before_median_n_m", measure=TORQUE)]
    after_median: Annotated[float, Column("after_median_n_m", measure=TORQUE)]
    before_p95: Annotated[float, Column("before_p95_n_m", "before, P95", TORQUE, absent=_NOT_KNOWN)]
    after_p95: Annotated[float, Column("after_p95_n_m", "after, P95", TORQUE, absent=_NOT_KNOWN)]
    bound: float = 0.0
    """Upper bound of the nominal drive's, where that is not told [N m]."""

    @property
    def largest(self) -> float:
        """Largest that it is, or may be, in the nominal drive and by the quantiles [N m]."""
        sizes = (self.before, self.after, self.before_p95, self.after_p95, self.bound)
        return max((x for x in sizes if math.isfinite(x)), default=0.0)

    @property
    def change(self) -> Annotated[float, Column("change_db", "change", DECIBEL)]:
        """Change of the nominal drive, from rest [dB]; nan where the line is not there."""
        return _decibel(self.before, self.after)

    @property
    def change_p95(self) -> Annotated[float, Column("change_p95_db", "change, P95", DECIBEL)]:
        """Change of the 95 % quantile [dB]."""
        return _decibel(self.before_p95, self.after_p95)


def _decibel(before: float, after: float) -> float:
    if 0.0 < before < math.inf and 0.0 < after < math.inf:
        return 20.0 * math.log10(after / before)
    return math.nan


@dataclass(frozen=True)
class QuietDrive:
    """Result of a search, judged on drawn cases that it had not seen."""

    scenario: Scenario
    """As it was."""
    quieter: Scenario
    """With the levers set."""
    objective: Objective
    levers: tuple[Lever, ...]
    setting: Setting | None
    """None of a table that was only checked."""
    constraints: Constraints
    cases: DrawnCases
    before: Spread
    after: Spread
    best_nominal: Spread | None
    """The setting that is best for the nominal drive, where that is another."""
    best_nominal_text: str
    alone: tuple[LeverAlone, ...]
    lines: tuple[LineChange, ...]
    tried: tuple[Tried, ...]
    runs: int
    bits: int | None = None

    @cached_property
    def margins(self) -> tuple[TorqueMargin, TorqueMargin]:
        """Torque margins before and after."""
        factors = self.constraints.factors
        return torque_margin(self.scenario, factors), torque_margin(self.quieter, factors)

    @property
    def setting_text(self) -> str:
        """The setting in words."""
        if self.setting is None:
            return "the table that was given"
        return in_words(self.scenario, self.levers, self.setting)

    @cached_property
    def why_not(self) -> str:
        """Why the constraints forbid the quieter drive; empty where they do not."""
        return self.constraints.why_not(self.quieter)

    @property
    def trap(self) -> bool:
        """Whether the setting that is best for the nominal drive is worse over the cases."""
        one = self.best_nominal
        return one is not None and one.p95 > 1.05 * self.after.p95

    def __repr__(self) -> str:
        figure = self.objective.measure.figure
        return (
            f"{self.objective.text} of {self.scenario.brief}: {figure(self.before.nominal)} before,"
            f" {figure(self.after.nominal)} after; P95 of {self.after.cases.size} cases"
            f" {figure(self.before.p95)} before, {figure(self.after.p95)} after\n  {self.setting_text}"
        )


def in_words(scenario: Scenario, levers: Sequence[Lever], setting: Setting) -> str:
    """A setting of levers in words."""
    return "; ".join(
        lever.show(scenario, numbers)
        for lever, numbers in zip(levers, setting.numbers, strict=True)
    )


def quiet(  # noqa: PLR0913 - keyword options
    scenario: GivenScenario,
    objective: str = "rms",
    levers: Sequence[str] = (),
    *,
    requirement: str | Path | None = None,
    study: str | Path | None = None,
    check: str | Path | None = None,
    constraints: Constraints | None = None,
    bits: int | None = None,
    table_rows: int = MAX_TABLE,
    cases: int = JUDGE_CASES,
    effort: int = DEFAULT_EFFORT,
    keep: str | Path | None = None,
    files: FileAccess = WORKING_FOLDER,
    workers: int | None = None,
    progress: Progress | None = None,
    on_best: Callable[[str], None] | None = None,
) -> QuietDrive:
    """Search for the setting of levers that makes a drive quietest over how it may be.

    The search makes the worst of some drawn cases small, each from rest and from a higher rate. One of
    its best settings is chosen by more cases and from more starts, and judged on others again, since
    motions coexist: a drive that is quiet from rest may slip and stick after a reversal. Array modes
    that ring from the start and die away do not count.

    Parameters
    ----------
    scenario : Scenario, str or path
        The drive at a constant rate.
    objective : str
        What is made small: ``rms`` of all lines, a line such as ``drive_1``, the largest line of a
        band such as ``"0.5:150 Hz"``, or lines over a limit of a CSV file.
    levers : sequence of str
        What may be changed (``studies.quiet.lever_options.parse_levers``), such as
        ``["ramp", "table", "reducer.damping=0.5:5 N*m*s/rad"]``.
    requirement : str or path, optional
        Requirements on the line of sight in place of the objective, as of ``pointing_budget``, for
        the drive's lines alone.
    study : str or path, optional
        Study file of a campaign, whose variations are those of the cases; without it a spread is
        assumed.
    check : str or path, optional
        Table of currents that is judged in place of a search.
    constraints : Constraints, optional
        Least torque margin, largest lag of the array.
    bits, table_rows : int, optional
        What the driver's table can hold.
    cases : int
        Cases that judge.
    effort : int
        Settings that are tried over the cases of the search.
    keep : str or path, optional
        File in which every figure is kept; a search that was interrupted goes on from it.
    files : FileAccess
        Permission to open the files above.
    workers : int, optional
        Processes that simulate; without it threads of this one do.
    progress : callable, optional
        Called as ``progress(done, total)``, with runs, from the first moment. Settings that are
        given up early, and figures that are known, count as all their runs.
    on_best : callable, optional
        Called with a sentence for each setting that is better than those before.

    Returns
    -------
    QuietDrive
        The quieter drive, before and after over the cases, every line, what each lever brings.

    Raises
    ------
    OptionError
        For an objective, lever or number that is not allowed.
    ScenarioError
        Where study or table do not fit the scenario.
    MicrovibError
        For a drive without a constant rate.
    """
    scenario = as_scenario(scenario)
    require_constant_rate(scenario)
    expect_list(levers, "levers", '["ramp", "table"]')
    whole_number("effort", effort, *EFFORT_RANGE)
    whole_number("cases", cases, *CASES_RANGE)
    if bits is not None:
        whole_number("bits", bits, 2, 24)
    constraints = constraints or Constraints()
    wanted = parse_objective(objective, scenario, requirement, files)
    table, spread, kept = (
        _file(files, key, name)
        for key, name in (("check", check), ("study", study), ("keep", keep))
    )
    given = None
    if table is not None:
        require_table_alone(levers, bits)
        given = with_given_table(scenario, table, table_rows)
        parsed: tuple[Lever, ...] = ()
    else:
        parsed = parse_levers(levers, scenario, TableLimits(bits, table_rows))
        require_seen(parsed, wanted)
    sampled = draw_cases(scenario, parsed, spread, cases, files_of_study(files, study))
    told = _Told(progress, on_best)
    with evaluations(wanted, kept, workers, told.run) as figures:
        task = _Task(scenario, wanted, parsed, constraints, sampled, figures, bits, effort, told)
        if given is not None:
            return task.checked(given)
        return task.searched()


def files_of_study(files: FileAccess, study: str | Path | None) -> FileAccess:
    """Permission to open what a study names in turn."""
    return NO_FILES if study is None else files.in_folder_of(str(study))


def require_table_alone(levers: Sequence[str], bits: int | None) -> None:
    """OptionError where something is given that a table to judge leaves no room for."""
    for key, value in (("lever", levers), ("bits", bits)):
        if value:
            raise OptionError(key, "does not go with check, which judges a table as it is")


def with_given_table(scenario: Scenario, file: Path, room: int) -> Scenario:
    """The scenario with the table of currents of a file; OptionError where a driver has no room for its
    rows.
    """
    table = {"driver.table": read_current_table(file)}
    with error_context(file):
        given = scenario.with_(table)
    rows = given.driver.beats * given.driver.microsteps
    if rows > room:
        raise OptionError(
            "table_rows", f"is less than the {rows} rows that the table takes", str(room)
        )
    return given


def require_seen(levers: Sequence[Lever], objective: Objective) -> None:
    """OptionError where a lever acts on nothing that the objective is of."""
    for lever in levers:
        if lever.name == "wings" and not objective.sees_pointing:
            raise OptionError(
                "lever",
                "acts on what two wings do to the craft together; give requirement in place of an"
                " objective, which is of the first drive's torque",
                "wings",
            )


def _file(files: FileAccess, key: str, name: str | Path | None) -> Path | None:
    """Path of the file that an option names, if it names one."""
    if name is None:
        return None
    return files.under(key).path(str(name))


CANDIDATES = 6
"""Settings of a search of which one is chosen by more cases."""
AS_GOOD = 1.1
"""Ratio of their worst figures up to which settings are taken for equally good."""


class _Told:
    """How far a search is, in runs, and its best setting so far."""

    def __init__(self, progress: Progress | None, on_best: Callable[[str], None] | None) -> None:
        self._progress, self._on_best, self._total = progress, on_best, 1
        self._before = self._expected = self._done = self._within = 0
        self._best = 0, 0.0
        self._tell()

    def expect(self, runs: int) -> None:
        """So many runs are ahead in all parts together, about."""
        self._total = runs
        self._tell()

    def begin(self, runs: int) -> None:
        """A part of the work begins that takes so many runs, about."""
        self._before += self._expected
        self._expected, self._done, self._within = runs, 0, 0
        self._tell()

    def run(self) -> None:
        """One run more is made."""
        self._within += 1
        self._tell()

    def step(self, runs: int) -> None:
        """Count so many runs as done, whether all of them were made or not."""
        self._done, self._within = self._done + runs, 0
        self._tell()

    def _tell(self) -> None:
        done = self._before + min(self._done + self._within, self._expected)
        if self._progress is not None:
            self._progress(min(done, self._total), self._total)

    def tried(self, cases: int, worst: float, text: Callable[[], str]) -> None:
        """Tell a setting, in words, that is better than those before over as many cases, or over more."""
        reached = cases, -worst
        if self._on_best is not None and math.isfinite(worst) and reached > self._best:
            self._best = reached
            self._on_best(text())


@dataclass
class _Task:
    """A search, or a check, with all that it needs."""

    scenario: Scenario
    objective: Objective
    levers: tuple[Lever, ...]
    constraints: Constraints
    cases: DrawnCases
    figures: Evaluations
    bits: int | None
    effort: int
    told: _Told

    @property
    def _runs_alone(self) -> int:
        """Runs of one lever alone."""
        return min(ALONE_EFFORT, self.effort) * len(SEARCHED) + len(STARTS)

    @property
    def _runs_nominal(self) -> int:
        """Runs of the search over the nominal drive."""
        return self._effort_nominal * len(SEARCHED)

    @property
    def _effort_nominal(self) -> int:
        return max(self.effort // 2, 4)

    @property
    def _runs_searched(self) -> int:
        """Runs of the search over drawn cases."""
        return self.effort * len(self.cases.searched) * len(SEARCHED)

    @property
    def _runs_chosen(self) -> int:
        """Runs by which one of the best settings is chosen."""
        return CANDIDATES * len(self.cases.chosen_by) * len(STARTS)

    @property
    def _runs_judged(self) -> int:
        """Runs by which one design is judged."""
        return (1 + len(self.cases.judged)) * len(STARTS)

    def checked(self, given: Scenario) -> QuietDrive:
        """The drive with a table that was given, judged."""
        self.told.expect(2 * self._runs_judged)
        return self._judged(None, given, (), (), None)

    def searched(self) -> QuietDrive:
        """The best setting, judged, with what each lever brings alone."""
        ahead = len(self.levers) * self._runs_alone + self._runs_nominal
        self.told.expect(ahead + self._runs_searched + self._runs_chosen + 3 * self._runs_judged)
        alone = tuple(self._alone(lever) for lever in self.levers)
        nominal = self._search([{}], self.levers)
        self.told.begin(self._runs_nominal)
        best = nominal.run(self._effort_nominal, tuple(nominal.as_it_is()))
        search = self._search(self.cases.searched, self.levers)
        self.told.begin(self._runs_searched)
        search.run(self.effort, (best.setting, *search.as_it_is()))
        found = self._chosen(search, best.setting)
        if not math.isfinite(found.worst):
            why = found.why_not or (
                "no setting brings all cases to their rate before the record begins; increase"
                " record.settle"
            )
            raise OptionError(
                "lever", f"no setting is allowed: {why}", ", ".join(x.name for x in self.levers)
            )
        quieter = with_levers(self.scenario, self.levers, found.setting)
        return self._judged(found.setting, quieter, alone, search.tried, best.setting)

    def _chosen(self, search: Search, nominal: Setting) -> Tried:
        """The one of the best settings, and of the ``nominal`` drive's best, whose worst is least over
        more cases and all starts; of those that are as good, that with the least median.
        """
        drives = Drives(search.drives.base, self.cases.chosen_by, STARTS, self.constraints.why_not)
        choice = Search(drives, self.levers, self.figures)
        self.told.begin(self._runs_chosen)
        for setting in dict.fromkeys((*search.unlike(CANDIDATES - 1), nominal)):
            choice.worst(setting, AS_GOOD * choice.best)
            self.told.step(len(drives.cases) * len(STARTS))
        finished = [one for one in choice.tried if math.isfinite(one.median)]
        alike = [one for one in finished if one.worst <= AS_GOOD * choice.best]
        return min(alike, key=lambda one: one.median, default=search.tried[0])

    def _search(self, cases: Sequence[dict[str, Any]], levers: tuple[Lever, ...]) -> Search:
        base = searched_record(self.scenario, self.objective)
        drives = Drives(base, cases, SEARCHED, self.constraints.why_not)

        def on_tried(one: Tried) -> None:
            self.told.step(len(cases) * len(SEARCHED))
            self.told.tried(len(cases), one.worst, lambda: self._in_words(one, levers, len(cases)))

        return Search(drives, levers, self.figures, on_tried)

    def _in_words(self, one: Tried, levers: tuple[Lever, ...], cases: int) -> str:
        figure = self.objective.measure.figure(one.worst)
        text = in_words(self.scenario, levers, one.setting)
        judged = f"in the worst of {cases} cases" if cases > 1 else "of the nominal drive"
        return f"{figure} {judged}: {text}"

    def _alone(self, lever: Lever) -> LeverAlone:
        search = self._search([{}], (lever,))
        self.told.begin(self._runs_alone)
        best = search.run(min(ALONE_EFFORT, self.effort), tuple(search.as_it_is()))
        if best.why_not:
            return LeverAlone(lever.name, "", math.inf, math.inf, best.why_not)
        changed = with_levers(
            searched_record(self.scenario, self.objective), (lever,), best.setting
        )
        from_starts = self.figures.values(drawn(changed, [{}], STARTS, _unchanged))
        text = in_words(self.scenario, (lever,), best.setting)
        return LeverAlone(lever.name, text, float(from_starts.max()), float(from_starts[0]))

    def _judged(
        self,
        setting: Setting | None,
        quieter: Scenario,
        alone: tuple[LeverAlone, ...],
        tried: tuple[Tried, ...],
        best_nominal: Setting | None,
    ) -> QuietDrive:
        before, lines_before = self._over_cases("before", self.scenario, None)
        if setting is None:
            after, lines_after = self._over_cases("with the table", self.scenario, quieter)
        else:
            after, lines_after = self._over_cases("quieter", self.scenario, setting)
        other, text = None, ""
        if best_nominal is not None and best_nominal != setting:
            other, _ = self._over_cases("best nominal", self.scenario, best_nominal)
            text = in_words(self.scenario, self.levers, best_nominal)
        return QuietDrive(
            self.scenario,
            quieter,
            self.objective,
            self.levers,
            setting,
            self.constraints,
            self.cases,
            before,
            after,
            other,
            text,
            alone,
            tuple(_line_changes(lines_before, lines_after)),
            tried,
            self.figures.runs,
            self.bits,
        )

    def _over_cases(
        self, name: str, base: Scenario, change: Setting | Scenario | None
    ) -> tuple[Spread, list[list[Figure]]]:
        """A design over the cases that judge: its spread, and figures of the nominal drive and of
        every case by starts.
        """

        def changed(scenario: Scenario) -> Scenario:
            if change is None:
                return scenario
            if isinstance(change, Scenario):
                return scenario.with_si({"driver.table": change.driver.table})
            return with_levers(scenario, self.levers, change)

        every = drawn(base, [{}, *self.cases.judged], STARTS, changed)
        self.told.begin(len(every))
        found = self.figures.figures(every)
        self.told.step(len(every))
        by_case = [found[k : k + len(STARTS)] for k in range(0, len(found), len(STARTS))]
        return _spread(name, by_case), by_case


def _spread(name: str, by_case: Sequence[Sequence[Figure]]) -> Spread:
    """The spread of a design of which the nominal drive comes first, then every case, by starts."""
    values, most, shown = (
        np.array([[getattr(one, what) for one in starts] for starts in by_case])
        for what in ("value", "most", "least")
    )
    needed = [one.duration for starts in by_case for one in starts if math.isfinite(one.duration)]
    least = np.where(np.isnan(values), shown, values).max(axis=1)
    known = np.where(least == most.max(axis=1), least, math.nan)
    several = shown.max(axis=1) > COEXISTING * most.min(axis=1)
    return Spread(
        name,
        float(known[0]),
        float(values[0, 0]),
        known[1:],
        most.max(axis=1)[1:],
        least[1:],
        int(np.sum(several[1:])),
        max(needed, default=math.nan),
    )


def _unchanged(scenario: Scenario) -> Scenario:
    return scenario


def _line_changes(
    before: Sequence[Sequence[Figure]], after: Sequence[Sequence[Figure]]
) -> Iterator[LineChange]:
    """Every line of either, those of the nominal drive from rest and over cases; the largest first."""
    names: dict[str, float] = {}
    for by_starts in (*before, *after):
        for figure in by_starts:
            for line in figure.lines:
                if math.isfinite(line.amplitude) or math.isfinite(line.most):
                    names.setdefault(line.name, line.frequency)
    rows = [_line_change(name, frequency, before, after) for name, frequency in names.items()]
    yield from sorted(rows, key=lambda row: -row.largest)


def _line_change(
    name: str,
    frequency: float,
    before: Sequence[Sequence[Figure]],
    after: Sequence[Sequence[Figure]],
) -> LineChange:
    nominal = before[0][0], after[0][0]
    bound = max(_untold_bound(one, name) for one in nominal)
    amplitudes = [_amplitude(one, name) for one in nominal]
    quantiles = _quantiles(before[1:], after[1:], name)
    return replace(LineChange(name, frequency, *amplitudes, *quantiles), bound=bound)


def _quantiles(
    before: Sequence[Sequence[Figure]], after: Sequence[Sequence[Figure]], name: str
) -> Iterator[float]:
    """Medians before and after, then 95 % quantiles, of a line in each case from its worst start; nan
    where cases that do not tell it decide them.
    """
    bounds = [
        np.array([np.max([_bounds(one, name) for one in starts], axis=0) for starts in cases])
        for cases in (before, after)
    ]
    for part in (0.5, P95):
        for each in bounds:
            yield _known(*(upper_quantile(values, part) for values in each.T))


def _bounds(figure: Figure, name: str) -> tuple[float, float]:
    """Least and most amplitude that a line may have [N m]."""
    amplitude = _amplitude(figure, name)
    if not math.isnan(amplitude):
        return amplitude, amplitude
    return 0.0, max(one.most for one in figure.lines if one.name == name)


def _untold_bound(figure: Figure, name: str) -> float:
    """Upper bound of a line that is not told [N m]; 0 of others."""
    low, high = _bounds(figure, name)
    return high if low < high else 0.0


def _amplitude(figure: Figure, name: str) -> float:
    """Amplitude of a line; nan where the record does not tell it, 0 where it is not there or small, and
    infinite where the drive does not come to its rate.
    """
    if figure.value == math.inf and not figure.lines:
        return math.inf
    sizes = [one.amplitude for one in figure.lines if one.name == name]
    return math.nan if any(map(math.isnan, sizes)) else max(sizes, default=0.0)
