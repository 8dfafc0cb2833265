"""The two files of a pointing budget: what is required, and what moves the line of sight besides
the drives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from statistics import NormalDist
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, Field, ModelWrapValidatorHandler, PrivateAttr, model_validator

from microvib.io.named import read_text
from microvib.io.yaml_text import parse_yaml
from microvib.model.part import Part
from microvib.model.rigid import Direction, Position
from microvib.model.sentences import validate_part
from microvib.signals.error_rows import SIGMAS
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.pointing import Metric
from microvib.units import Quantity, unit_of

AXES = ("x", "y", "radial")
Statistic = Literal["rms", "level", "bound"]
Interpretation = Literal["temporal", "ensemble", "mixed"]


class CurvePoint(Part):
    """A point of a curve of allowed amplitudes; between points it is straight on logarithmic
    scales.
    """

    frequency: Annotated[float, Quantity("Hz", "frequency", gt=0)]
    amplitude: Annotated[
        float, Quantity("rad", "largest amplitude of a line, 0-to-peak", gt=0, le=1, display="urad")
    ]


class Requirement(Part):
    """Limit on one metric of the line of sight."""

    name: str = Field(
        default="", max_length=200, description="its number or name in the specification"
    )
    metric: Metric = Field(
        default="ape", description="pointing error metric: of the error itself, or in a window"
    )
    window: (
        Annotated[
            float,
            Quantity(
                "s", "exposure T; all metrics but ape and stability need it", gt=0, display="ms"
            ),
        ]
        | None
    ) = None
    apart: (
        Annotated[
            float,
            Quantity("s", "T_s of stability and pde; without it the window", gt=0, display="ms"),
        ]
        | None
    ) = None
    axis: Literal["x", "y", "radial"] = Field(
        default="radial", description="axis of the line of sight, or both together"
    )
    statistic: Statistic = Field(
        default="rms",
        description="rms; level, within which the error is for a part confidence of the time; bound, all lines peaking together",
    )
    confidence: Annotated[
        float, Quantity("", "part of the time", ge=0.5, display="percent", le=0.999999)
    ] = 0.997
    interpretation: Interpretation | None = Field(
        default=None,
        description="over what rms and level are taken where errors of sources have spreads over units:"
        " temporal, the time, of the worst unit; ensemble, units, each at its largest over the time"
        " (level); mixed, time and units together",
    )
    percentile: (
        Annotated[
            float,
            Quantity("", "fraction of a campaign's cases that must comply; without it the nominal case is judged", ge=0.5,
                     display="percent", le=0.9999),
        ]
        | None
    ) = None  # fmt: skip
    lowest: Annotated[float, Quantity("Hz", "frequency below which nothing counts", ge=0)] = 0.0
    highest: (
        Annotated[float, Quantity("Hz", "frequency above which nothing counts", ge=0)] | None
    ) = None
    limit: (
        Annotated[float, Quantity("rad", "largest value allowed", gt=0, le=1, display="urad")]
        | None
    ) = None
    curve: tuple[CurvePoint, ...] | None = Field(
        default=None,
        max_length=1000,
        description="in place of limit, for each line: amplitudes allowed over frequency",
    )

    _unit: str = PrivateAttr("")

    @model_validator(mode="wrap")
    @classmethod
    def _with_unit(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        made = handler(data)
        if isinstance(data, Mapping):
            BaseModel.__setattr__(made, "_unit", _angle_unit(data))  # parts are frozen
        return made

    @property
    def unit(self) -> str:
        """The unit that its angles are given in; empty where they are numbers."""
        return self._unit

    def _consistency_errors(self) -> Iterator[str]:
        if (self.limit is None) == (self.curve is None):
            yield "limit: give either limit, an angle such as '0.2 urad', or curve, amplitudes allowed over frequency"
        if self.highest is not None and self.highest <= self.lowest:
            yield f"highest: {self.highest:g} Hz is not above lowest, {self.lowest:g} Hz"
        if self.percentile is not None and self.statistic == "level":
            yield "percentile: goes with statistic rms or bound; a level of each case of a campaign is not computed"
        yield from self._errors_of_interpretation()
        yield from self._keys_without_effect()
        if self.curve is not None:
            yield from self._errors_of_curve(self.curve)

    def _errors_of_interpretation(self) -> Iterator[str]:
        if self.interpretation == "ensemble" and self.statistic == "rms":
            yield "interpretation: ensemble is of the largest error over the time; it goes with statistic level or bound"
        if self.interpretation == "ensemble" and self.percentile is not None:
            yield "percentile: is over a campaign's cases; interpretation: ensemble does not go with it"
        if self.interpretation is not None and self.curve is not None:
            yield "interpretation: does not go with curve, which limits each line"

    def _keys_without_effect(self) -> Iterator[str]:
        """Sentences on keys that were given and say nothing of the metric or statistic."""
        given = self.model_fields_set
        if "confidence" in given and self.curve is not None:
            yield "confidence: does not go with curve, which limits amplitudes of lines (leave it out)"
        elif "confidence" in given and self.statistic == "rms" and self.interpretation is None:
            yield "confidence: goes with statistic level or bound, and statistic is rms (statistic: level)"
        if "statistic" in given and self.curve is not None:
            yield "statistic: does not go with curve, which limits amplitudes of lines (leave it out)"
        if self.apart is not None and self.metric not in ("stability", "pde"):
            yield f"apart: goes with metric stability or pde, and metric is {self.metric}"

    def _errors_of_curve(self, curve: tuple[CurvePoint, ...]) -> Iterator[str]:
        steps = [point.frequency for point in curve]
        if len(steps) < 2 or any(b <= a for a, b in pairwise(steps)):
            yield "curve: two points or more with ascending frequencies are expected"
        if self.metric != "ape" or self.percentile is not None:
            yield "curve: is of the amplitudes of lines; metric, window and percentile do not go with it"
        top = math.inf if self.highest is None else self.highest
        if steps and (steps[-1] <= self.lowest or steps[0] >= top):
            band = f"from {self.lowest:g} Hz" + ("" if self.highest is None else f" to {top:g} Hz")
            yield (
                f"curve: its points, {steps[0]:g} to {steps[-1]:g} Hz, are outside of lowest and highest,"
                f" {band}, so that nothing would be judged; move one of them"
            )

    @cached_property
    def allowed(self) -> LimitCurve:
        """Its curve over frequency, of angles [rad]."""
        points = [(point.frequency, point.amplitude) for point in self.curve or ()]
        return LimitCurve(*zip(*points, strict=True))

    @property
    def sigmas(self) -> float:
        """Standard deviations of what is normal that count as its most: three, or as many as hold the
        ``confidence`` if these are more.
        """
        return max(SIGMAS, NormalDist().inv_cdf(0.5 + 0.5 * self.confidence))

    @property
    def incomplete(self) -> str:
        """The key without which it cannot be judged; empty where none is missing."""
        if self.metric == "ape":
            return ""
        if self.metric == "stability":
            if self.apart or self.window:
                return ""
            return "apart"
        if self.window:
            return ""
        return "window"

    @property
    def text(self) -> str:
        """Requirement in words."""
        if self.window is None or self.metric == "ape":
            window = ""
        else:
            window = f" {_time(self.window)}"
        if self.apart and self.metric in ("stability", "pde"):
            apart = f" after {_time(self.apart)}"
        else:
            apart = ""
        if self.curve and self.axis == "radial":
            axis = ""
        else:
            axis = f", {self.axis}"
        if self.statistic == "level":
            level = f"{100 * self.confidence:g} % {self.statistic}"
        else:
            level = self.statistic
        if self.percentile is None:
            ensemble = ""
        else:
            ensemble = f", P{100 * self.percentile:g}"
        if self.curve:
            kind = "lines"
        else:
            kind = f"{self.metric.upper()}{window}{apart}"
        if self.interpretation is not None:
            level = f"{level}, {self.interpretation}"
        return f"{kind}{axis}, {'amplitude over frequency' if self.curve else level}{ensemble}"


def _angle_unit(data: Mapping[str, Any]) -> str:
    """The unit of a requirement's limit, or of the first point of its curve."""
    given, curve = data.get("limit"), data.get("curve")
    if given is None and curve and isinstance(curve[0], Mapping):
        given = curve[0].get("amplitude")
    return unit_of(given) if isinstance(given, str) else ""


def _time(seconds: float) -> str:
    if seconds >= 1.0:
        return f"{seconds:g} s"
    return f"{1e3 * seconds:g} ms"


class Requirements(Part):
    """A requirement file."""

    title: str = Field(default="", max_length=500, description="short title")
    source: str = Field(default="", max_length=2000, description="specification that states it")
    requirements: tuple[Requirement, ...] = Field(max_length=200, description="what is required")

    def _consistency_errors(self) -> Iterator[str]:
        if not self.requirements:
            yield "requirements: the list is empty; give at least one"


_PER_SPEED = {"force": "N*s^2/rad^2", "torque": "N*m*s^2/rad^2"}


LOADS_OF_WHEEL = ("radial_force", "radial_torque", "axial_force", "axial_torque")
"""Keys of the coefficients of a harmonic."""


MAX_ORDER_ERROR = 0.1
"""Part of its order by which a harmonic may be off at most."""


class WheelHarmonic(Part):
    """Disturbance of a wheel at ``order`` times its speed: coefficient times the square of the
    speed.
    """

    order: Annotated[float, Quantity("", "cycles per turn", gt=0, le=100)]
    order_error: Annotated[
        float,
        Quantity("", "by how much its order may be smaller or larger, in cycles per turn", ge=0),
    ] = 0.0
    radial_force: Annotated[
        float, Quantity(_PER_SPEED["force"], "rotating force across the axis", ge=0)
    ] = 0.0
    radial_torque: Annotated[
        float, Quantity(_PER_SPEED["torque"], "rotating torque across the axis", ge=0)
    ] = 0.0
    axial_force: Annotated[float, Quantity(_PER_SPEED["force"], "force along the axis", ge=0)] = 0.0
    axial_torque: Annotated[
        float, Quantity(_PER_SPEED["torque"], "torque about the axis", ge=0)
    ] = 0.0
    radial_force_least: (
        Annotated[float, Quantity(_PER_SPEED["force"], "smallest that it may be", ge=0)] | None
    ) = None
    radial_force_most: (
        Annotated[float, Quantity(_PER_SPEED["force"], "largest that it may be", ge=0)] | None
    ) = None
    radial_torque_least: (
        Annotated[float, Quantity(_PER_SPEED["torque"], "smallest that it may be", ge=0)] | None
    ) = None
    radial_torque_most: (
        Annotated[float, Quantity(_PER_SPEED["torque"], "largest that it may be", ge=0)] | None
    ) = None
    axial_force_least: (
        Annotated[float, Quantity(_PER_SPEED["force"], "smallest that it may be", ge=0)] | None
    ) = None
    axial_force_most: (
        Annotated[float, Quantity(_PER_SPEED["force"], "largest that it may be", ge=0)] | None
    ) = None
    axial_torque_least: (
        Annotated[float, Quantity(_PER_SPEED["torque"], "smallest that it may be", ge=0)] | None
    ) = None
    axial_torque_most: (
        Annotated[float, Quantity(_PER_SPEED["torque"], "largest that it may be", ge=0)] | None
    ) = None

    def _consistency_errors(self) -> Iterator[str]:
        loads = {f"{load}{end}" for load in LOADS_OF_WHEEL for end in ("", "_least", "_most")}
        if not loads & self.model_fields_set:
            yield f"has no coefficient: one of {', '.join(LOADS_OF_WHEEL)} is expected"
        if self.order_error > MAX_ORDER_ERROR * self.order:
            yield (
                f"order_error: {self.order_error:g} is more than {MAX_ORDER_ERROR:g} of order, {self.order:g}; give the"
                " order more exactly, or several harmonics"
            )
        for load in LOADS_OF_WHEEL:
            value, (least, most) = getattr(self, load), self.ends(load)
            if least > value:
                yield f"{load}_least: {least:g} is above {load}, {value:g}"
            if most < value:
                yield f"{load}_most: {most:g} is below {load}, {value:g}"

    def ends(self, load: str) -> tuple[float, float]:
        """Between which the coefficient of a load is."""
        value = getattr(self, load)
        given = [getattr(self, f"{load}_{end}") for end in ("least", "most")]
        least, most = (value if one is None else one for one in given)
        return least, most

    @property
    def uncertain(self) -> bool:
        """Whether a coefficient may differ from its value."""
        return any(end != getattr(self, load) for load in LOADS_OF_WHEEL for end in self.ends(load))

    @property
    def at_most(self) -> WheelHarmonic:
        """The harmonic with its largest coefficients."""
        most = {load: self.ends(load)[1] for load in LOADS_OF_WHEEL}
        none = {f"{load}_{end}": None for load in LOADS_OF_WHEEL for end in ("least", "most")}
        return self.model_copy(update=most | none)


class WhirlPoint(Part):
    """Measured whirl frequencies of a rocking mode at a speed."""

    speed: Annotated[float, Quantity("rad/s", "speed", ge=0, display="rpm")]
    backward: Annotated[float, Quantity("Hz", "frequency of the backward whirl", gt=0)]
    forward: Annotated[float, Quantity("Hz", "frequency of the forward whirl", gt=0)]


class WheelMode(Part):
    """Structural mode of a wheel: its rotor on its bearings, which amplifies its harmonics near it."""

    motion: Literal["rocking", "radial", "axial"] = Field(
        description="rocking amplifies radial torques, radial radial forces, axial axial forces"
    )
    frequency: Annotated[float, Quantity("Hz", "natural frequency at rest", gt=0)] | None = None
    frequency_error: Annotated[
        float,
        Quantity(
            "",
            "part by which its frequency, or those of its whirl, may be smaller or larger",
            ge=0,
            le=0.45,
            display="percent",
        ),
    ] = 0.0
    damping: Annotated[float, Quantity("", "modal damping ratio", gt=0, le=0.5)]
    damping_least: (
        Annotated[float, Quantity("", "smallest that it may be", gt=0, le=0.5)] | None
    ) = None
    damping_most: Annotated[float, Quantity("", "largest that it may be", gt=0, le=0.5)] | None = (
        None
    )
    inertia_ratio: (
        Annotated[
            float,
            Quantity(
                "",
                "of a rocking mode: polar over transverse moment of inertia of the rotor, which splits it into"
                " backward and forward whirl",
                ge=0,
                le=2,
            ),
        ]
        | None
    ) = None
    whirl: tuple[WhirlPoint, ...] | None = Field(
        default=None,
        max_length=1000,
        description="of a rocking mode, in place of frequency and inertia_ratio: measured whirl frequencies over"
        " the speed, straight between points",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if self.motion != "rocking":
            for key in ("inertia_ratio", "whirl"):
                if getattr(self, key) is not None:
                    yield f"{key}: is of a rocking mode; a mode that is {self.motion} does not whirl"
        elif (self.inertia_ratio is None) == (self.whirl is None):
            yield "inertia_ratio: give polar over transverse inertia, or whirl, the measured whirl frequencies"
        if (self.frequency is None) == (self.whirl is None):
            yield "frequency: give the natural frequency at rest, or whirl"
        least, most = self.dampings
        if least > self.damping:
            yield f"damping_least: {least:g} is above damping, {self.damping:g}"
        if most < self.damping:
            yield f"damping_most: {most:g} is below damping, {self.damping:g}"
        yield from self._errors_of_points()

    @property
    def dampings(self) -> tuple[float, float]:
        """Between which its damping is."""
        given = (self.damping_least, self.damping_most)
        least, most = (self.damping if one is None else one for one in given)
        return least, most

    @property
    def uncertain(self) -> bool:
        """Whether it may differ from what is given."""
        return self.frequency_error > 0.0 or self.dampings != (self.damping, self.damping)

    def _errors_of_points(self) -> Iterator[str]:
        """Sentences on measured whirl frequencies."""
        points = self.whirl or ()
        if self.whirl is not None and len(points) < 2:
            yield "whirl: two speeds or more are expected"
        if any(b.speed <= a.speed for a, b in pairwise(points)):
            yield "whirl: ascending speeds are expected"
        for point in points:
            if point.forward < point.backward:
                yield f"whirl: forward, {point.forward:g} Hz, is below backward, {point.backward:g} Hz"


class WheelResonance(Part):
    """Speeds between which a load of a measured wheel has a resonance that none of its modes explains."""

    load: Literal["radial_force", "radial_torque", "axial_force", "axial_torque"] = Field(
        description="load that shows it"
    )
    order: Annotated[float, Quantity("", "order that shows it, cycles per turn", gt=0)]
    speed: Annotated[float, Quantity("rad/s", "lowest speed", gt=0, display="rpm")]
    speed_to: Annotated[float, Quantity("rad/s", "highest speed", gt=0, display="rpm")]

    def _consistency_errors(self) -> Iterator[str]:
        if self.speed_to <= self.speed:
            yield f"speed_to: {self.speed_to:g} rad/s is not above speed, {self.speed:g} rad/s"


class Wheel(Part):
    """A reaction wheel by its harmonic coefficients, rigid or with its structural modes."""

    speed: Annotated[float, Quantity("rad/s", "speed", gt=0, display="rpm")]
    speed_to: (
        Annotated[
            float,
            Quantity(
                "rad/s", "end of a range of speeds, the worst of which counts", gt=0, display="rpm"
            ),
        ]
        | None
    ) = None
    measured_from: (
        Annotated[
            float,
            Quantity(
                "rad/s",
                "lowest speed that was measured; nothing is judged below",
                gt=0,
                display="rpm",
            ),
        ]
        | None
    ) = None
    measured_to: (
        Annotated[
            float,
            Quantity(
                "rad/s",
                "highest speed that was measured; nothing is judged above",
                gt=0,
                display="rpm",
            ),
        ]
        | None
    ) = None
    measured_up_to: (
        Annotated[
            float,
            Quantity("Hz", "highest frequency that was measured; above it nothing is known", gt=0),
        ]
        | None
    ) = None
    not_measured: tuple[
        Literal["radial_force", "radial_torque", "axial_force", "axial_torque"], ...
    ] = Field(
        default=(),
        max_length=4,
        description="loads that were not measured; nothing passes while one is named",
    )
    one_axis: tuple[Literal["radial_force", "radial_torque"], ...] = Field(
        default=(),
        max_length=2,
        description="loads across the spin axis that were measured about one of two axes; nothing passes"
        " while one is named, as the other may differ",
    )
    resonances: tuple[WheelResonance, ...] = Field(
        default=(),
        max_length=100_000,
        description="speeds between which loads have a resonance that no mode explains; nothing is judged there",
    )
    axis: Direction = Field(description="spin axis, hub axes")
    harmonics: tuple[WheelHarmonic, ...] = Field(
        default=(), max_length=200, description="its disturbances"
    )
    table: str | None = Field(
        default=None, max_length=1000, description="CSV file of harmonics, in their place"
    )
    modes: tuple[WheelMode, ...] = Field(
        default=(),
        max_length=50,
        description="structural modes; harmonics are those far below them",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if not self.harmonics and self.table is None:
            yield "harmonics: an empty list makes no disturbance; give at least one, or table"
        if self.harmonics and self.table is not None:
            yield "table: is an alternative of harmonics; give one of them"
        yield from self._errors_of_whirl()
        if not (any(self.axis) and all(map(math.isfinite, self.axis))):
            given = ", ".join(f"{x:g}" for x in self.axis)
            yield f"axis: [{given}] is not a direction; three components, not all 0, are expected"
        if (self.measured_to or math.inf) <= (self.measured_from or 0.0):
            yield "measured_to: is not above measured_from"
        if self.speed_to is not None and self.speed_to <= self.speed:
            yield f"speed_to: {self.speed_to:g} rad/s is not above speed, {self.speed:g} rad/s"

    @property
    def at_most(self) -> Wheel:
        """The wheel with its largest coefficients."""
        return self.model_copy(update={"harmonics": tuple(one.at_most for one in self.harmonics)})

    def _errors_of_whirl(self) -> Iterator[str]:
        low, high = self.speed, self.speed_to or self.speed
        for mode in (mode for mode in self.modes if mode.whirl):
            points = mode.whirl or ()
            if points and (points[0].speed > low or points[-1].speed < high):
                yield (
                    f"modes: whirl is given from {points[0].speed:g} to {points[-1].speed:g} rad/s, and the"
                    f" wheel turns from {low:g} to {high:g} rad/s"
                )


_SPREAD = "half-width of a uniform distribution, standard deviation of a normal, amplitude of an arcsine (bimodal)"


class ConstantError(Part):
    """Constant error of the line of sight, about x and about y: a bias, known or with a spread over
    units.
    """

    x: Annotated[float, Quantity("rad", "known part, or centre of the spread", display="urad")] = (
        0.0
    )
    y: Annotated[float, Quantity("rad", "the same about y", display="urad")] = 0.0
    distribution: Literal["fixed", "uniform", "normal", "arcsine"] = Field(
        default="fixed", description="how it is spread over units; fixed: it is x and y"
    )
    spread_x: Annotated[float, Quantity("rad", _SPREAD, ge=0, display="urad")] | None = None
    spread_y: Annotated[float, Quantity("rad", "the same about y", ge=0, display="urad")] | None = (
        None
    )

    def _consistency_errors(self) -> Iterator[str]:
        yield from _errors_of_spread(self)


class RandomError(Part):
    """Random error of the line of sight, about zero, that changes with time."""

    distribution: Literal["normal", "uniform"] = Field(
        default="normal", description="how it is spread over time"
    )
    spread_x: Annotated[
        float,
        Quantity(
            "rad", "standard deviation, of a uniform one its half-width", ge=0, display="urad"
        ),
    ]
    spread_y: Annotated[float, Quantity("rad", "the same about y", ge=0, display="urad")]
    correlation_time: (
        Annotated[
            float,
            Quantity(
                "s",
                "time constant of its autocorrelation, exponential (first-order Gauss-Markov); this or a"
                " band is needed by windows",
                gt=0,
                display="s",
            ),
        ]
        | None
    ) = None
    lowest: (
        Annotated[float, Quantity("Hz", "beginning of the band in which it is even", ge=0)] | None
    ) = None
    highest: Annotated[float, Quantity("Hz", "end of that band", gt=0)] | None = None

    def _consistency_errors(self) -> Iterator[str]:
        if not self.spread_x and not self.spread_y:
            yield "spread_x: 0 about both axes makes no error; give spread_x or spread_y"
        if (self.lowest is None) != (self.highest is None):
            yield "highest: a band has two ends; give lowest and highest"
        if self.lowest is not None and self.correlation_time is not None:
            yield "correlation_time: is an alternative of lowest and highest; give one of them"
        if self.lowest is not None and self.highest is not None and self.highest <= self.lowest:
            yield f"highest: {self.highest:g} Hz is not above lowest, {self.lowest:g} Hz"


class PeriodicError(Part):
    """Periodic error of the line of sight: a line whose phase is not known."""

    x: Annotated[float, Quantity("rad", "amplitude about x, 0-to-peak", ge=0, display="urad")]
    y: Annotated[float, Quantity("rad", "amplitude about y, 0-to-peak", ge=0, display="urad")]
    frequency: Annotated[float, Quantity("Hz", "frequency", gt=0)]

    def _consistency_errors(self) -> Iterator[str]:
        if not self.x and not self.y:
            yield "x: 0 about both axes makes no error; give x or y"


class DriftError(Part):
    """Drift of the line of sight: an even rate from zero on, known or with a spread over units."""

    x: Annotated[float, Quantity("rad/s", "known rate, or centre of the spread")] = 0.0
    y: Annotated[float, Quantity("rad/s", "the same about y")] = 0.0
    distribution: Literal["fixed", "uniform", "normal", "arcsine"] = Field(
        default="fixed", description="how the rate is spread over units; fixed: it is x and y"
    )
    spread_x: Annotated[float, Quantity("rad/s", _SPREAD, ge=0)] | None = None
    spread_y: Annotated[float, Quantity("rad/s", "the same about y", ge=0)] | None = None
    duration: (
        Annotated[
            float,
            Quantity("s", "how long it drifts, such as from one calibration to the next; ape and mpe need it", gt=0),
        ]
        | None
    ) = None  # fmt: skip

    def _consistency_errors(self) -> Iterator[str]:
        yield from _errors_of_spread(self)


def _errors_of_spread(one: ConstantError | DriftError) -> Iterator[str]:
    """Sentences on what does not go together in a constant or a drift."""
    spreads = {"spread_x": one.spread_x, "spread_y": one.spread_y}
    if one.distribution == "fixed":
        for key in (key for key, value in spreads.items() if value is not None):
            yield f"{key}: goes with distribution uniform, normal or arcsine; fixed has none"
        missing = [key for key in ("x", "y") if key not in one.model_fields_set]
    else:
        missing = [key for key, value in spreads.items() if value is None]
    for key in missing:
        yield f"{key}: missing; give it about both axes, 0 where there is none"
    if not missing and not any((one.x, one.y, one.spread_x, one.spread_y)):
        yield "x: 0 about both axes makes no error"


ErrorClass = ConstantError | RandomError | DriftError
"""Classes of errors that are no lines."""
_CLASSES = ("constant", "random", "periodic", "drift")
_KINDS = ("wheel", "lines", "density", *_CLASSES)


class OtherSource(Part):
    """Source of line-of-sight motion besides the drives: a wheel, lines or a density from a file, or
    an error by its class.
    """

    name: str = Field(min_length=1, max_length=100, description="what it is")
    wheel: Wheel | None = None
    lines: str | None = Field(
        default=None,
        max_length=1000,
        description="CSV file of lines of loads, or of the line of sight",
    )
    density: str | None = Field(
        default=None, max_length=1000, description="CSV file of one-sided densities of the same"
    )
    constant: ConstantError | None = None
    random: RandomError | None = None
    periodic: PeriodicError | None = None
    drift: DriftError | None = None
    group: str = Field(
        default="",
        max_length=60,
        description="errors of one group are fully correlated: amplitudes, spreads and rates add",
    )
    point: str | None = Field(
        default=None, max_length=60, description="where loads act: a named point of the hub"
    )
    position: Position | None = Field(
        default=None,
        description="where loads act on a rigid hub, from its centre of mass, hub axes",
    )
    clock: str = Field(
        default="",
        max_length=60,
        description="sources of one clock, lines from files: those of one frequency are added with their phases",
    )

    def _consistency_errors(self) -> Iterator[str]:
        yield from self._errors_of_kind()
        if self.point is not None and self.position is not None:
            yield "position: is an alternative of point; give one of them"
        if self.clock and self.lines is None:
            yield "clock: keeps the phases of lines from a file; those of a wheel or a density are not known"
        if self.wheel is not None and self.point is None and self.position is None:
            yield "position: missing; a wheel needs its place on the hub, position or point"

    def _errors_of_kind(self) -> Iterator[str]:
        """Sentences on what it is, and on keys that go with other kinds."""
        given = [key for key in _KINDS if getattr(self, key) is not None]
        if len(given) != 1:
            first = given[1] if given else "wheel"
            yield f"{first}: give one of {', '.join(_KINDS[:-1])} and {_KINDS[-1]}"
        of_class = [key for key in given if key in _CLASSES]
        if self.group and not of_class:
            yield f"group: is of errors by their class: {', '.join(_CLASSES[:-1])} or {_CLASSES[-1]}"
        for key in ("point", "position"):
            if of_class and getattr(self, key) is not None:
                yield f"{key}: is where loads act; {of_class[0]} is an error of the line of sight"

    @property
    def error(self) -> ErrorClass | None:
        """Its error, where it is one of a class without lines."""
        return self.constant or self.random or self.drift

    @property
    def has_place(self) -> bool:
        """Whether its loads act at a place on the hub."""
        return self.point is not None or self.position is not None

    @property
    def tables(self) -> dict[str, str]:
        """Names of the tables that it takes, by the keys that name them."""
        named = {
            "wheel.table": None if self.wheel is None else self.wheel.table,
            "lines": self.lines,
            "density": self.density,
        }
        return {key: name for key, name in named.items() if name is not None}


def group_errors(sources: Sequence[OtherSource]) -> Iterator[str]:
    """Sentences on groups whose errors cannot be fully correlated: they differ in class, distribution,
    frequency, spectrum or duration.
    """
    of_group: dict[str, tuple[str, tuple[tuple[str, Any], ...]]] = {}
    for one in sources:
        if not one.group:
            continue
        kind = next(key for key in _CLASSES if getattr(one, key) is not None)
        error = getattr(one, kind)
        alike = {
            key: getattr(error, key)
            for key in type(error).model_fields
            if key not in ("x", "y", "spread_x", "spread_y")
        }
        own = (one.name, (("class", kind), *alike.items()))
        name, first = of_group.setdefault(one.group, own)
        differs = [key for key, value in own[1] if dict(first).get(key) != value]
        if differs:
            yield (
                f"group: '{one.group}' has {name} and {one.name}, which differ in {differs[0]}; errors of"
                " one group are of one class with the same distribution, frequency, spectrum and"
                " duration (give the others a group of their own, or none)"
            )


class Sources(Part):
    """A file of sources."""

    sources: tuple[OtherSource, ...] = Field(
        max_length=200, description="sources besides the drives"
    )

    def _consistency_errors(self) -> Iterator[str]:
        names = [one.name for one in self.sources]
        if not names:
            yield "sources: the list is empty; give at least one, or leave the file out"
        for name in (name for name in names if names.count(name) > 1):
            yield f"sources: '{name}' occurs twice; each source needs its own name"
        yield from group_errors(self.sources)


Kind = TypeVar("Kind", Requirements, Sources)


def read_file(path: Path, kind: type[Kind]) -> Kind:
    """A requirement file or a file of sources; ScenarioError with one sentence per problem."""
    if kind is Requirements:
        what = "requirement"
    else:
        what = "source"
    return from_text(read_text(path, what, ()), kind, str(path))


def from_text(text: str, kind: type[Kind], name: str) -> Kind:
    """As ``read_file``, of the contents of a file that its owner calls ``name``."""
    return validate_part(kind, parse_yaml(text, name), origin=name)
