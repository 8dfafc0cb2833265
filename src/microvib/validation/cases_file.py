"""A published test as data, described by cases: what was measured, what is given of the drive, what
is assumed with its range, and what of it is compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from microvib.errors import OptionError
from microvib.model.part import Part
from microvib.solve.channels import ALL_CHANNELS
from microvib.units import Quantity, band, convert

Text = Annotated[str, Field(max_length=2000)]
Name = Annotated[str, Field(min_length=1, max_length=100)]
CaseName = Annotated[Name, Field(description="name of one of the cases")]
MetricName = Annotated[Name, Field(description="name of one of the metrics")]
Number = str | float
Kind = Literal["line", "order", "rms", "sliding rms", "peak", "lost steps", "first lost step"]
COUNTS = ("lost steps", "first lost step")
"""Kinds of metrics that are counts of steps, and of no channel."""
Direction = Literal["rises", "falls", "level"]
_NEEDED: dict[str, tuple[str, ...]] = {
    "line": ("line",),
    "order": ("order",),
    "rms": ("band",),
    "sliding rms": ("band", "window"),
    "peak": (),
    "lost steps": (),
    "first lost step": (),
}
"""Keys that each kind of metric needs; it has no others but ``channel``."""
COMPARED = ("figure", "bound", "ratio", "trend", "ranking", "exceeds", "onset", "not_comparable")
"""Keys of which a comparison has one."""


class Measured(Part):
    """One finding of the test."""

    finding: Text
    value: Text = ""
    source: Text = ""


class AssumedRange(Part):
    """A value that the publication does not give: where it lies, and where it is drawn from, each
    value of the range as likely as another.

    It is the value of the key that it stands under; or, under a name of its own, a factor on keys
    (``scale``), or the key that it ``sets`` over the product of the keys ``of``.
    """

    low: Number
    central: Number
    high: Number
    spacing: Literal["linear", "logarithmic"] = Field(
        default="linear", description="logarithmic: each factor is as likely as another"
    )
    scale: tuple[str, ...] = Field(
        default=(), description="keys of the scenario that it is a factor on"
    )
    sets: str = Field(default="", description="key of the scenario that it sets")
    of: tuple[str, ...] = Field(
        default=(), description="keys, by the product of which it is multiplied"
    )
    unit: str = Field(default="", description="unit of the value, where it sets a key")
    why: Text = Field(default="", description="reason for the range")

    def _consistency_errors(self) -> Iterator[str]:
        if self.scale and self.sets:
            yield "scale: is not allowed beside sets; give one of them"
        if bool(self.of) and not self.sets:
            yield "of: needs sets, the key that is set"
        if self.unit and not self.sets:
            yield "unit: belongs to sets; a key has its own unit, and a factor has none"


class Combination(Part):
    """A product of powers of assumptions, such as a ratio that decides: not drawn by itself, but
    looked at where draws are parted.
    """

    powers: dict[str, float] = Field(description="names of assumptions and their powers")
    factor: float = Field(default=1.0, description="factor, with the values of assumptions in SI")
    unit: str = Field(default="", max_length=50, description="unit of the product, in words")


class Case(Part):
    """One case: changes of the scenario."""

    set: dict[str, Any] = Field(
        default_factory=dict,
        description="keys of the scenario and their values, before assumptions",
    )
    scale: dict[str, float] = Field(
        default_factory=dict,
        description="keys of the scenario and factors on them, after assumptions",
    )


class Metric(Part):
    """A figure of a case: of one channel of its record, or steps that it lost."""

    what: Kind = Field(description="kind of figure")
    channel: str = Field(default="T_d", description="channel of the motion")
    line: str = Field(default="", description="name of the line, such as full_step_1")
    order: (
        Annotated[float, Quantity("", "multiple of the electrical frequency f_e", gt=0)] | None
    ) = None
    band: str | None = Field(default=None, description="band, such as 1.2:500 Hz")
    window: (
        Annotated[float, Quantity("s", "time over which the mean square is taken", gt=0)] | None
    ) = None
    floor: Number | None = Field(
        default=None, description="RMS of the instrument's noise in the band, which adds by power"
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.channel not in ALL_CHANNELS:
            yield f"channel: {self.channel!r} is not a channel of a motion, such as T_d or alpha_l"
        needed = _NEEDED[self.what]
        if self.floor is not None and self.what != "rms":
            yield f"floor: does not go with what: {self.what}; it adds to an rms"
        for key in ("line", "order", "band", "window"):
            given = getattr(self, key) not in ("", None)
            if key in needed and not given:
                yield f"{key}: missing; what: {self.what} needs it"
            if given and key not in needed:
                yield f"{key}: does not go with what: {self.what}"
        if self.band is not None:
            try:
                band(self.band)
            except OptionError as error:
                yield str(error)
        if self.floor is not None and self.channel in ALL_CHANNELS:
            try:
                convert(str(self.floor), self.unit)
            except ValueError as error:
                yield f"floor: {self.floor!r} {error}"

    @property
    def edges(self) -> tuple[float, float]:
        """Ends of the band [Hz]; all frequencies without one."""
        if self.band is None:
            return 0.0, math.inf
        low, high = band(self.band)
        return float(low), float(high)

    @property
    def noise(self) -> float:
        """RMS of the instrument's noise, in the unit of the figure."""
        return 0.0 if self.floor is None else convert(str(self.floor), self.unit)

    @property
    def unit(self) -> str:
        """Unit of the figure."""
        if self.what in COUNTS:
            return ""
        return ALL_CHANNELS[self.channel].unit


class _Bounds(Part):
    """Bounds of a value; one of them, or both."""

    at_least: Number | None = None
    at_most: Number | None = None

    def _consistency_errors(self) -> Iterator[str]:
        if self.at_least is None and self.at_most is None:
            yield "at_least: missing; a comparison needs at_least or at_most"


class FigureComparison(Part):
    """A metric of a case is the published figure, within a factor either way."""

    metric: MetricName
    case: CaseName
    value: Number = Field(description="published figure, with its unit")
    factor: Annotated[float, Quantity("", "factor that is allowed either way", gt=1)]


class BoundComparison(_Bounds):
    """A metric of a case is at least, or at most, some value."""

    metric: MetricName
    case: CaseName


class RatioComparison(_Bounds):
    """A metric over another one, of two cases or of one."""

    metric: MetricName
    case: CaseName
    over: Name = Field(description="case that it is compared with")
    over_metric: str = Field(default="", description="metric there; without it the same")


class TrendComparison(Part):
    """A metric rises, falls or stays level from case to case."""

    metric: MetricName
    cases: tuple[Name, ...] = Field(
        description="names of two or more cases", min_length=2, max_length=100
    )
    direction: Direction = Field(description="rises, falls or level")
    within: (
        Annotated[float, Quantity("", "largest over smallest, less 1, of what is level", gt=0)]
        | None
    ) = None

    def _consistency_errors(self) -> Iterator[str]:
        if (self.direction == "level") != (self.within is not None):
            yield "within: goes with direction: level, which needs it"


class RankingComparison(Part):
    """Cases by a metric, the smallest first; or one case that is smaller than all the others."""

    metric: MetricName
    cases: tuple[Name, ...] = Field(
        description="names of two or more cases", min_length=2, max_length=100
    )
    first_only: bool = Field(
        default=False, description="whether only the first case is compared with the others"
    )


class ExceedsComparison(Part):
    """Each of some metrics of a case is larger than each of others."""

    case: CaseName
    metrics: tuple[Name, ...] = Field(
        description="names of metrics that are larger", min_length=1, max_length=100
    )
    others: tuple[Name, ...] = Field(
        description="names of those that they exceed", min_length=1, max_length=100
    )
    by: Annotated[float, Quantity("", "factor by which they are larger", gt=0)]


class OnsetComparison(Part):
    """A count, as of lost steps, is 0 in one case and not in another."""

    metric: MetricName
    none: Name = Field(description="case in which it is 0")
    some: Name = Field(description="case in which it is not")

    def _consistency_errors(self) -> Iterator[str]:
        if self.none == self.some:
            yield f"some: is '{self.some}', as none is; another case is expected"


class Comparison(Part):
    """One claim of the publication, and what is compared of it."""

    claim: Text
    source: Text = ""
    published: Text = Field(default="", description="what the publication says, in words")
    calibrated: Text = Field(default="", description="what was fitted to it; empty of a prediction")
    figure: FigureComparison | None = None
    bound: BoundComparison | None = None
    ratio: RatioComparison | None = None
    trend: TrendComparison | None = None
    ranking: RankingComparison | None = None
    exceeds: ExceedsComparison | None = None
    onset: OnsetComparison | None = None
    not_comparable: Text = Field(default="", description="reason why nothing can be compared")

    def _consistency_errors(self) -> Iterator[str]:
        given = [name for name in COMPARED if getattr(self, name)]
        if not given:
            yield (f"what is compared is missing; one of {', '.join(COMPARED)} is expected")
        if len(given) > 1:
            yield f"{given[1]}: stands beside {given[0]}; a comparison has one of them"

    @property
    def needs(self) -> tuple[tuple[str, str], ...]:
        """Cases and their metrics that it needs."""
        if self.figure or self.bound:
            one = self.figure or self.bound
            assert one is not None
            return ((one.case, one.metric),)
        if self.ratio:
            ratio = self.ratio
            return (ratio.case, ratio.metric), (ratio.over, ratio.over_metric or ratio.metric)
        if self.trend or self.ranking:
            several = self.trend or self.ranking
            assert several is not None
            return tuple((case, several.metric) for case in several.cases)
        if self.onset:
            onset = self.onset
            return (onset.none, onset.metric), (onset.some, onset.metric)
        if self.exceeds:
            out = self.exceeds
            return tuple((out.case, metric) for metric in (*out.metrics, *out.others))
        return ()


class Shown(Part):
    """Figures that are shown besides those that are compared."""

    cases: tuple[Name, ...]
    metrics: tuple[Name, ...]


class CasesTest(Part):
    """A published test that is described by cases of one scenario."""

    title: str = Field(max_length=500)
    citation: str = Field(max_length=2000, description="where the test is published")
    remarks: Text = Field(default="", description="what readers should know of it")
    measured: tuple[Measured, ...] = Field(description="what was measured", max_length=100)
    scenario: str | dict[str, Any] = Field(
        description="drive: a name of the catalog, a scenario file, or the scenario itself"
    )
    set: dict[str, Any] = Field(
        default_factory=dict, description="changes of the scenario, the same in all cases"
    )
    given: dict[str, Text] = Field(
        default_factory=dict,
        description="keys of the scenario that the publication gives, with the source",
    )
    assumed: dict[str, AssumedRange] = Field(
        default_factory=dict, description="values that it does not give, with their ranges"
    )
    combined: dict[str, Combination] = Field(
        default_factory=dict, description="combinations of assumptions that may decide"
    )
    cases: dict[str, Case] = Field(description="cases by name", min_length=1, max_length=200)
    metrics: dict[str, Metric] = Field(description="metrics by name", max_length=200)
    compare: tuple[Comparison, ...] = Field(
        description="what is compared", min_length=1, max_length=200
    )
    shown: tuple[Shown, ...] = ()

    def _consistency_errors(self) -> Iterator[str]:
        for k, comparison in enumerate(self.compare):
            yield from self._missing(f"compare.{k}", comparison.needs)
        for k, shown in enumerate(self.shown):
            pairs = tuple((case, metric) for case in shown.cases for metric in shown.metrics)
            yield from self._missing(f"shown.{k}", pairs)
        for name, combination in self.combined.items():
            unknown = [x for x in combination.powers if x not in self.assumed]
            if unknown:
                yield (
                    f"combined.{name}.powers: '{unknown[0]}' is not assumed; there are"
                    f" {', '.join(self.assumed) or 'none'}"
                )
        for name, case in self.cases.items():
            both = [key for key in case.set if key in self.assumed]
            if both:
                yield (
                    f"cases.{name}.set: {both[0]} is assumed, too, and would be drawn over it;"
                    " use scale, or leave one of them out"
                )

    def _missing(self, where: str, pairs: tuple[tuple[str, str], ...]) -> Iterator[str]:
        for case, metric in pairs:
            if case not in self.cases:
                yield f"{where}: there is no case '{case}'; there are {', '.join(self.cases)}"
            if metric not in self.metrics:
                names = ", ".join(self.metrics) or "none"
                yield f"{where}: there is no metric '{metric}'; there are {names}"

    @property
    def needs(self) -> dict[str, tuple[str, ...]]:
        """Metrics that the comparisons need of each case, in the order of the file."""
        return self._in_order([pair for comparison in self.compare for pair in comparison.needs])

    @property
    def shows(self) -> dict[str, tuple[str, ...]]:
        """Metrics of each case that are compared or shown."""
        pairs = [pair for comparison in self.compare for pair in comparison.needs]
        for shown in self.shown:
            pairs += [(case, metric) for case in shown.cases for metric in shown.metrics]
        return self._in_order(pairs)

    def _in_order(self, pairs: Sequence[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
        found = {
            case: tuple(metric for metric in self.metrics if (case, metric) in pairs)
            for case in self.cases
        }
        return {case: metrics for case, metrics in found.items() if metrics}
