"""Profile plans as text, tables and a picture: shapes of a manoeuvre, and what they leave ringing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from microvib.io.scenario_file import dump_scenario
from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Outcome, Part, Picture, Verdict
from microvib.results import (
    ARRAY_ANGLE,
    COUNT,
    FREQUENCY,
    RATE,
    SHARE,
    TIME,
    TORQUE,
    TORQUE_LIMIT,
    Column,
    Measure,
    Table,
)
from microvib.studies.profiles.modes import UncertainMode
from microvib.studies.profiles.plan import FRICTION_CHECK, FULL, ProfilePlan, Run, Shape

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST_DECIBEL = -100.0
"""Ringing below a step's under which figures say no more."""
_BELOW = Measure("dB", form=".1f")
_PERIODS = Measure(form=".3g")
_WIND_UP = Measure("deg", math.radians(1.0), ".3g")
_EXACT_TIME = Measure("s", form=".9g")
_CURVE_POINTS = 241
_BEYOND = 1.5
"""Frequency error up to which a picture shows curves, over the uncertainty."""


@dataclass(frozen=True)
class ShownShape:
    """A shape, as tables show it."""

    name: Annotated[str, Column("shape", "shape")]
    duration: Annotated[float, Column("duration_s", "duration", TIME)]
    periods: Annotated[float, Column("periods", "periods", _PERIODS)]
    delay: Annotated[float, Column("delay_s", "later than step", TIME)]
    lag: Annotated[float, Column("lag_deg", measure=ARRAY_ANGLE)]
    acceleration: Annotated[
        float,
        Column(
            "largest_acceleration_deg_s2",
            measure=Measure("deg/s^2", math.radians(1.0), file_size=math.radians(1.0)),
        ),
    ]
    linear_nominal: Annotated[
        float, Column("linear_nominal_db", "linear", _BELOW, report_only=True)
    ]
    linear_worst: Annotated[float, Column("linear_worst_db", "linear, worst", _BELOW)]
    measured_nominal: Annotated[float, Column("run_nominal_db", "run", _BELOW)]
    measured_worst: Annotated[float, Column("run_worst_db", "runs, worst", _BELOW)]
    largest: Annotated[float, Column("largest_n_m", "worst ringing", TORQUE)]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]


@dataclass(frozen=True)
class ShownMode:
    """A mode that a profile is shaped for."""

    name: Annotated[str, Column("mode", "mode")]
    frequency: Annotated[float, Column("frequency_hz", "frequency", FREQUENCY)]
    damping: Annotated[
        float, Column("damping_percent", "damping", Measure("%", 0.01, ".3g", file_size=0.01))
    ]
    step: Annotated[float, Column("step_n_m", "ringing of a step", TORQUE)]


@dataclass(frozen=True)
class ShownResidual:
    """Ringing of a mode after a shape in the linearised drive."""

    shape: Annotated[str, Column("shape", "shape")]
    mode: Annotated[str, Column("mode", "mode")]
    nominal: Annotated[float, Column("nominal_n_m", "nominal", TORQUE)]
    worst: Annotated[float, Column("worst_n_m", "worst", TORQUE)]
    limit: Annotated[float, Column("limit_n_m", "limit", TORQUE_LIMIT)]


@dataclass(frozen=True)
class ShownRun:
    """A mode in a run, as tables show it."""

    shape: Annotated[str, Column("shape")]
    case: Annotated[str, Column("drive", "drive")]
    mode: Annotated[str, Column("mode", "mode")]
    amplitude: Annotated[float, Column("ringing_n_m", "ringing", TORQUE)]
    most: Annotated[float, Column("at_most_n_m", "at most", TORQUE)]
    below: Annotated[float, Column("below_step_db", "against step", _BELOW)]
    limit: Annotated[float, Column("limit_n_m", "limit", TORQUE)]
    status: Annotated[str, Column("status", "status")]
    verdict: Annotated[str, Column("verdict", "verdict", role="verdict")]


def decibel(factor: float) -> float:
    """A factor in dB, not below ``LEAST_DECIBEL``; nan where it is not known."""
    if math.isnan(factor):
        return math.nan
    return max(20.0 * math.log10(max(factor, 1e-300)), LEAST_DECIBEL)


def profile_outcome(plan: ProfilePlan) -> Outcome:
    """A plan for those who read it: shapes beside each other, the best with its runs, profile and
    microsteps as files.
    """
    chosen = plan.nearest
    shapes = [_shown(plan, shape) for shape in plan.shapes]
    every_run = [run for shape in plan.shapes for run in shape.runs]
    picture = Picture("profile", lambda: draw_profiles(plan), "Rate profiles and ringing", _CAPTION)
    return Outcome(
        "Profile plan",
        f"Rate profile: {plan.scenario.title or 'drive'}",
        _summary(plan),
        _verdict(plan),
        tuple(_facts(plan)),
        (
            Part(
                "",
                (
                    Table.of("shapes", ShownShape, shapes),
                    *map(Text, _sentences(plan)),
                    Text(_HOW_TO_READ, note=True),
                    picture,
                ),
            ),
            Part("Modes", (Table.of("modes", ShownMode, _modes(plan)),)),
            Part(f"Runs of the full model: {chosen.name}", tuple(_run_items(plan, every_run))),
        ),
        plan.scenario,
        files=(
            Table.of("linear", ShownResidual, _residuals(plan), for_readers=()),
            _profile_table(chosen),
            _instants_table(plan, chosen),
        ),
        other_files={"scenario.yaml": dump_scenario(plan.commanded(chosen))},
    )


_HOW_TO_READ = (
    "Ringing is that of a mode in T_d at the end of the manoeuvre, 0-to-peak, against what the largest"
    " change of rate leaves ringing as a step in the linearised drive. Linear: closed form without"
    " friction, detent torque and microsteps; worst: a bound over the whole uncertainty of frequency"
    f" and damping; {LEAST_DECIBEL:g} dB stands for less, too. Runs: the full model, without noise of"
    " the friction, which the ringing at most has on top."
)
_CAPTION = (
    "Left, rates of the array. Right, ringing against a step over the error of the mode's frequency:"
    " curves by the linearised drive, markers by runs of the full model."
)


def _shown(plan: ProfilePlan, shape: Shape) -> ShownShape:
    step, change = plan.shapes[0].duration, plan.manoeuvre.final_rate - plan.manoeuvre.initial_rate
    lag = math.nan
    if plan.manoeuvre.angle is None:
        lag = (plan.manoeuvre.final_rate * shape.duration - shape.profile.angle) * math.copysign(
            1.0, change
        )
    fastest = shape.profile.largest_acceleration
    return ShownShape(
        shape.name,
        shape.duration,
        shape.duration / plan.period,
        shape.duration - step,
        lag,
        fastest if math.isfinite(fastest) else math.nan,
        decibel(shape.linear_nominal),
        decibel(shape.linear_worst),
        decibel(shape.measured_nominal),
        decibel(shape.measured_worst),
        shape.largest_ringing,
        shape.verdict,
    )


def _modes(plan: ProfilePlan) -> list[ShownMode]:
    change = plan.manoeuvre.largest_change
    return [ShownMode(x.name, x.frequency, x.damping, x.gain * change) for x in plan.modes]


def _residuals(plan: ProfilePlan) -> list[ShownResidual]:
    return [
        ShownResidual(one.shape, one.mode, one.nominal, one.worst, one.limit)
        for shape in plan.shapes
        for one in shape.residuals
    ]


def _run_items(plan: ProfilePlan, runs: list[Run]) -> Iterator[Table]:
    if not runs:
        return
    chosen = plan.nearest.name
    shown = [_shown_run(run) for run in runs]
    yield Table.of(
        "runs", ShownRun, shown, for_readers=[run for run in shown if run.shape == chosen]
    )


def _shown_run(run: Run) -> ShownRun:
    most = run.ringing.most if math.isfinite(run.ringing.most) else math.nan
    return ShownRun(
        run.shape,
        run.case.text,
        run.mode,
        run.ringing.amplitude,
        most,
        decibel(run.below_step),
        run.limit,
        run.ringing.status,
        run.verdict if run.counts else "",
    )


def _profile_table(shape: Shape) -> Table:
    columns = (Column("time_s", measure=_EXACT_TIME), Column("rate_deg_s", measure=RATE))
    times = shape.profile.times - shape.profile.times[0]
    rows = tuple(zip(times.tolist(), shape.profile.rates.tolist(), strict=True))
    return Table("profile", columns, rows, for_readers=())


def _instants_table(plan: ProfilePlan, shape: Shape) -> Table:
    columns = (Column("time_s", measure=_EXACT_TIME), Column("count", measure=COUNT))
    instants = plan.instants(shape)
    rows = tuple(zip(instants.times.tolist(), instants.counts.tolist(), strict=True))
    return Table("instants", columns, rows, for_readers=())


def _summary(plan: ProfilePlan) -> str:
    shapes = count_text(len(plan.shapes), "shape")
    runs = sum(len({run.case.text for run in shape.runs}) for shape in plan.shapes)
    how = f"{runs} runs of the full model" if runs else "linearised drive only"
    return (
        f"{_manoeuvre_text(plan)}: {shapes}, {count_text(len(plan.modes), 'mode')},"
        f" limit {_limit_text(plan)} with {_uncertainty_text(plan)}; {how}."
    )


def _manoeuvre_text(plan: ProfilePlan) -> str:
    manoeuvre = plan.manoeuvre
    first, last = RATE.figure(manoeuvre.initial_rate), RATE.figure(manoeuvre.final_rate)
    if manoeuvre.angle is None:
        return f"From {first} to {last}"
    angle = ARRAY_ANGLE.figure(manoeuvre.angle)
    return (
        f"{angle} gained between {first} and {last}, at most {RATE.figure(manoeuvre.largest_rate)}"
    )


def _limit_text(plan: ProfilePlan) -> str:
    if plan.limit is None:
        return f"{plan.attenuation:g} dB below a step"
    if plan.curve is None:
        return TORQUE_LIMIT.figure(plan.limit)
    least, most = TORQUE_LIMIT.text(plan.curve.least), TORQUE_LIMIT.figure(plan.curve.most)
    return f"{least} to {most} from {plan.curve.low:g} to {plan.curve.high:g} Hz"


def _uncertainty_text(plan: ProfilePlan) -> str:
    parts = [
        f"{what} ± {SHARE.figure(part)}"
        for what, part in (
            ("frequencies", plan.frequency_uncertainty),
            ("dampings", plan.damping_uncertainty),
            ("friction", plan.friction_uncertainty),
        )
        if part > 0.0
    ]
    return ", ".join(parts) or "nominal values"


def _verdict(plan: ProfilePlan) -> Verdict:
    if plan.best is not None:
        return "pass"
    if all(shape.verdict == "fail" for shape in plan.shapes):
        return "fail"
    return "not judged"


def _facts(plan: ProfilePlan) -> Iterator[Fact]:
    shape, best = plan.nearest, plan.best
    duration = f"{TIME.figure(shape.duration)}"
    if best is None:
        yield Fact("None", "no shape is known to keep the limit", "" if not shape.runs else "fail")
        yield Fact(shape.name, "shape that comes nearest")
    else:
        yield Fact(duration, f"duration of the best shape: {shape.name}")
        yield Fact(f"{shape.duration / plan.period:.3g}", "periods of the slowest mode")
    if not math.isnan(shape.largest_ringing):
        yield Fact(TORQUE.figure(shape.largest_ringing), "its worst ringing")
        yield Fact(f"{decibel(shape.measured_worst):.1f} dB", "that against a step of the rate")


def _sentences(plan: ProfilePlan) -> Iterator[str]:
    shape = plan.nearest
    yield _best_text(plan, shape)
    if shape.start > 0.0:
        yield (
            f"In `scenario.yaml` {TIME.figure(shape.start)} come before it that bring the array from rest to"
            f" {RATE.figure(plan.manoeuvre.initial_rate)} and let the start die away; times in `profile.csv`"
            " and `instants.csv` count from the begin of the manoeuvre."
        )
    if shape.name == FULL and plan.manoeuvre.initial_rate == 0.0:
        yield (
            f"It begins with {_WIND_UP.figure(plan.wind_up)} at the full rate that wind the drive up, while"
            " friction holds the array: nine tenths of the angle at which it breaks away."
        )
    elif shape.name == FULL:
        begin = plan.microsteps_into_full_step(shape)
        yield f"It is made for a begin {begin:.2f} microsteps after a full step."
    yield from _search_text(plan, shape)
    yield from _beside_the_verdict(shape)
    if plan.curve is not None:
        yield _by_curve_text(plan)
    for why in dict.fromkeys(one.unknown for one in plan.shapes if one.unknown):
        yield f"Not judged: {why}."
    for name in plan.too_long:
        yield f"{name}: too long at every length that keeps the limit."


def _by_curve_text(plan: ProfilePlan) -> str:
    """How a limit over frequency was used, and which modes it says nothing of."""
    text = (
        "Each mode passes by the strictest limit within the uncertainty of its frequency, and fails by the most"
        " lenient one at its frequency in a run; what lies between is not judged."
    )
    if not plan.not_limited:
        return text
    names = ", ".join(plan.not_limited)
    return f"{text} Not limited, since the limit has no value at their frequencies: {names}."


def _best_text(plan: ProfilePlan, shape: Shape) -> str:
    if not shape.runs:
        return "Not judged: the full model was not run, and friction, detent torque and microsteps are left out."
    periods = f"{TIME.figure(shape.duration)}, {shape.duration / plan.period:.3g} periods of the slowest mode"
    worst = TORQUE.figure(shape.largest_ringing) or "unknown"
    what = f"{shape.name}, {periods}, worst ringing {worst}"
    if not math.isnan(shape.measured_worst):
        what += f", {decibel(shape.measured_worst):.1f} dB against a step"
    if plan.best is None:
        return f"Best: none keeps {_limit_text(plan)} as far as is known. Nearest: {what}."
    return f"Best: {what}."


def _search_text(plan: ProfilePlan, shape: Shape) -> Iterator[str]:
    """Remainder that the search for the worst drive leaves open."""
    counted = [run for run in shape.runs if run.counts]
    if (
        not counted
        or math.isinf(shape.over_limit)
        or not (plan.frequency_uncertainty or plan.damping_uncertainty or plan.friction_uncertainty)
    ):
        return
    worst = max(counted, key=lambda run: run.ringing.most / run.limit)
    if not shape.searched:
        yield f"Its worst run is {worst.case.text}; a shape that fails is not searched further."
        return
    drives = count_text(len({run.case.text for run in counted}), "drive")
    yield (
        f"The worst of {drives} is {worst.case.text}, where a mode rings with"
        f" {100.0 * shape.over_limit:.3g} % of its limit; between the runs it may be up to"
        f" {100.0 * shape.between:.2g} % of the limit more, by their second differences."
    )


def _beside_the_verdict(shape: Shape) -> Iterator[str]:
    """Sentences on runs that are not part of the verdict: friction that is off, another begin."""
    beside = [run for run in shape.runs if not run.counts]
    friction = [run for run in beside if run.case.friction != 1.0]
    late = [run for run in beside if run.case.late]
    if friction:
        yield (
            f"With friction {SHARE.figure(FRICTION_CHECK)} less or more, which is not part of the verdict, the"
            f" worst ringing is {_worst_text(friction)}"
            " (`--friction-uncertainty` makes it part of the shape)."
        )
    if late:
        yield (
            "Begun a quarter, half or three quarters of a full step later, which is not part of the verdict"
            f" either, the worst ringing is {_worst_text(late)}: detent torque is then another one."
        )


def _worst_text(runs: list[Run]) -> str:
    worst = max(run.ringing.most for run in runs)
    if math.isinf(worst):
        return "unknown"
    below = max(decibel(run.below_step) for run in runs)
    return f"{TORQUE.figure(worst)}, {below:.1f} dB against a step"


def draw_profiles(plan: ProfilePlan) -> Figure:
    """Rates of the shapes over time, and ringing over the error of the largest mode's frequency."""
    figure, axes = sheets.sheet(3.4, 1, 2)
    left, right = axes[0]
    drawn = [shape for shape in plan.shapes if shape.name not in ("ZVDD", "EI")]
    longest = max((shape.duration for shape in drawn if shape.name != "trapezoid"), default=1.0)
    for k, shape in enumerate(drawn):
        colour = sheets.COLOURS[k % len(sheets.COLOURS)]
        heavy = 2.2 if shape.name == plan.nearest.name else 1.1
        _draw_rate(left, plan, shape, longest, {"color": colour, "linewidth": heavy})
        _draw_ringing(right, plan, shape, colour)
    limit = -plan.attenuation
    if plan.limit is not None:
        limit = decibel(_drawn_limit(plan) / (plan.modes[0].gain * plan.manoeuvre.largest_change))
    right.axhline(limit, color="black", linewidth=1.2, linestyle="--")
    right.set(
        xlabel="error of the frequency [%]",
        ylabel="ringing against a step [dB]",
        title=plan.modes[0].name,
        ylim=(-60.0, 10.0),
    )
    left.set(xlabel="time [s]", ylabel="rate of the array [deg/s]", title="Profiles")
    left.set_xlim(-0.1 * longest, 1.15 * longest)
    figure.legend(
        *left.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7.5
    )
    return figure


def _drawn_limit(plan: ProfilePlan) -> float:
    """Limit of the mode whose ringing is drawn [N m], before it is lowered for the linearised drive."""
    name = plan.modes[0].name
    each = [one.limit for shape in plan.shapes for one in shape.residuals if one.mode == name]
    return (1.0 + plan.frequency_uncertainty) * each[0]


def _draw_rate(
    ax: Axes, plan: ProfilePlan, shape: Shape, longest: float, style: dict[str, Any]
) -> None:
    profile, manoeuvre = shape.profile, plan.manoeuvre
    times = np.concatenate(
        [[-longest, 0.0], profile.times, [max(2.0 * longest, profile.times[-1])]]
    )
    ends = [manoeuvre.initial_rate] * 2, [manoeuvre.final_rate]
    rates = np.concatenate([ends[0], profile.rates, ends[1]])
    ax.plot(times, np.degrees(rates), label=shape.name, **style)


def _draw_ringing(ax: Axes, plan: ProfilePlan, shape: Shape, colour: str) -> None:
    mode, change = plan.modes[0], plan.manoeuvre.largest_change
    spread = _BEYOND * (plan.frequency_uncertainty or 0.1)
    if shape.residuals:
        x = np.linspace(-spread, spread, _CURVE_POINTS)
        size = np.abs(shape.profile.residual(_eigenvalues(mode, x))) / change
        ax.plot(100.0 * x, 20.0 * np.log10(np.maximum(size, 1e-6)), color=colour, linewidth=1.1)
    found = [
        (100.0 * (run.case.frequency - 1.0), decibel(run.below_step))
        for run in shape.runs
        if run.counts and run.mode == mode.name and run.case.damping == run.case.friction == 1.0
    ]
    if found:
        x, y = np.array(sorted(found)).T
        ax.plot(x, y, "o", color=colour, markersize=4)


def _eigenvalues(mode: UncertainMode, off: np.ndarray) -> np.ndarray:
    return np.array([mode.eigenvalue(1.0 + x) for x in off.tolist()])
