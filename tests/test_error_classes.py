"""Errors by their class in a pointing budget: constants, random errors, periodic ones and drifts in
every metric and interpretation, against closed forms and draws; what is not judged, and what is
refused.
"""

import math
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

from microvib.errors import MicrovibError, ScenarioError
from microvib.io.file_access import NO_FILES
from microvib.signals.pointing import metric_weight
from microvib.studies.budget.files import OtherSource, Requirement, Requirements, Sources, read_file
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.sources import Contribution
from microvib.studies.budget.study import read_sources
from microvib.studies.budget.sums import Assessment, assess

_DRAWS = 400_000


_UNITS = {
    **dict.fromkeys(("frequency", "lowest", "highest"), "Hz"),
    **dict.fromkeys(("window", "apart", "duration", "correlation_time"), "s"),
    **dict.fromkeys(("x", "y", "spread_x", "spread_y", "limit"), "rad"),
}


def with_units(keys: dict[str, Any], rate: bool = False) -> dict[str, Any]:
    """Keys with numbers as texts in SI units; angles are rates in a drift."""
    found = dict(keys)
    for key, value in keys.items():
        if isinstance(value, dict):
            found[key] = with_units(value, rate=key == "drift")
        elif key in _UNITS and isinstance(value, int | float):
            unit = "rad/s" if rate and _UNITS[key] == "rad" else _UNITS[key]
            found[key] = f"{value!r} {unit}"
    return found


def requirement(**keys: Any) -> Requirement:
    return Requirement.model_validate(with_units({"axis": "x", "limit": 1.0, **keys}))


def given(name: str = "one", **keys: Any) -> Contribution:
    source = OtherSource.model_validate(with_units({"name": name, **keys}))
    return contribution_of_other(source, None, NO_FILES)  # type: ignore[arg-type]


def constant(name: str = "one", group: str = "", **keys: Any) -> Contribution:
    return given(name, group=group, constant=keys)


def line(name: str, frequency: float, amplitude: float) -> Contribution:
    los = np.array([[amplitude, 0.0]], dtype=complex)
    return Contribution(name, "", ("line",), np.array([frequency]), los)


def judged(asked: dict[str, Any], *sources: Contribution) -> Assessment:
    return assess(requirement(**asked), sources, "rss")


UNIFORM = {"distribution": "uniform", "spread_x": 1.0, "spread_y": 0.5}
NORMAL = {"distribution": "normal", "spread_x": 0.4, "spread_y": 0.1}


@pytest.mark.parametrize(
    ("metric", "weight"),
    [("ape", 1), ("mpe", 1), ("rpe", 0), ("smear", 0), ("jitter", 0), ("stability", 0), ("pde", 0)],
)
def test_a_constant_counts_where_what_stays_counts(metric: str, weight: float) -> None:
    one = judged({"metric": metric, "window": 0.1}, constant(x=-0.7, y=0.2))
    assert (one.least, one.value, one.most) == pytest.approx([0.7 * weight] * 3)
    level = {"metric": metric, "window": 0.1, "statistic": "level"}
    one = judged(level, constant(x=-0.7, y=0.2))
    assert (one.least, one.value, one.most) == pytest.approx([0.7 * weight] * 3)
    both = judged({"metric": metric, "window": 0.1, "axis": "radial"}, constant(x=-0.7, y=0.2))
    assert both.value == pytest.approx(math.hypot(0.7, 0.2) * weight)


def test_known_constants_add_with_their_signs_and_spreads_as_squares() -> None:
    one = judged({}, constant("a", x=1.0, y=0.0), constant("b", x=-0.4, y=0.0))
    assert one.value == pytest.approx(0.6)
    mixed = {"interpretation": "mixed"}
    two = judged(mixed, constant("a", **UNIFORM), constant("b", x=0.3, **NORMAL))
    assert two.value == pytest.approx(math.sqrt(1.0 / 3.0 + 0.4**2 + 0.3**2))


def test_errors_of_one_group_add_as_amplitudes() -> None:
    mixed = {"interpretation": "mixed"}
    apart = judged(mixed, constant("a", **NORMAL), constant("b", **NORMAL))
    together = judged(mixed, *(constant(name, group="thermal", **NORMAL) for name in "ab"))
    assert apart.value == pytest.approx(math.sqrt(2.0) * 0.4)
    assert together.value == pytest.approx(0.8)
    periodic = {"x": 0.3, "y": 0.1, "frequency": 2.0}
    apart = judged({}, given("a", periodic=periodic))
    together = judged({}, *(given(name, group="g", periodic=periodic) for name in "ab"))
    assert together.value == pytest.approx(2.0 * apart.value) == pytest.approx(0.6 / math.sqrt(2.0))


@pytest.mark.parametrize("confidence", [0.68, 0.95, 0.997, 0.9999])
def test_a_mixed_level_is_that_of_draws_over_time_and_units(confidence: float) -> None:
    rng = np.random.default_rng(3)
    sources = [
        constant("a", x=0.5, **UNIFORM),
        constant("b", **NORMAL),
        constant("c", distribution="arcsine", spread_x=0.6, spread_y=0.0),
        given("d", random={"distribution": "uniform", "spread_x": 0.3, "spread_y": 0.0}),
        given("e", drift={"x": 0.002, "y": 0.0, "duration": 100.0}),
        line("f", 3.0, 0.8),
    ]
    drawn = (
        0.5 + rng.uniform(-1, 1, _DRAWS) + rng.normal(0.0, 0.4, _DRAWS)
        + 0.6 * np.sin(rng.uniform(0, 2 * np.pi, _DRAWS)) + rng.uniform(-0.3, 0.3, _DRAWS)
        + 0.002 * rng.uniform(0, 100, _DRAWS) + 0.8 * np.sin(rng.uniform(0, 2 * np.pi, _DRAWS))
    )  # fmt: skip
    asked = {"statistic": "level", "confidence": confidence, "interpretation": "mixed"}
    one = judged(asked, *sources)
    wanted = float(np.quantile(np.abs(drawn), confidence))
    assert one.value == pytest.approx(wanted, rel=0.02 if confidence > 0.999 else 0.008)
    assert one.least * (1.0 - 2e-3) <= one.value <= one.most * (1.0 + 2e-3)
    rms = judged({"interpretation": "mixed"}, *sources)
    assert rms.value == pytest.approx(float(np.sqrt(np.mean(drawn**2))), rel=0.005)


def test_a_level_of_a_uniform_error_is_not_three_sigma() -> None:
    asked = {"statistic": "level", "confidence": 0.997, "interpretation": "mixed"}
    one = judged(asked, constant(**UNIFORM))
    assert one.value == pytest.approx(0.997, rel=2e-3)
    assert one.most < 1.005  # three sigma would be 1.73
    normal = judged(asked, constant(**NORMAL))
    assert normal.value == pytest.approx(2.9677 * 0.4, rel=2e-3)


@pytest.mark.parametrize("kind", ["uniform", "normal", "arcsine"])
def test_a_drift_whose_rate_is_spread_is_the_product_of_rate_and_time(kind: str) -> None:
    rng = np.random.default_rng(5)
    unit = {
        "uniform": rng.uniform(-1, 1, _DRAWS),
        "normal": rng.normal(size=_DRAWS),
        "arcsine": np.sin(rng.uniform(0, 2 * np.pi, _DRAWS)),
    }[kind]
    keys = {"x": 0.01, "y": 0.0, "distribution": kind, "spread_x": 0.02, "spread_y": 0.0}
    drawn = (0.01 + 0.02 * unit) * rng.uniform(0, 50.0, _DRAWS)
    for confidence in (0.7, 0.95, 0.997):
        asked = {"statistic": "level", "confidence": confidence, "interpretation": "mixed"}
        one = judged(asked, given(drift={**keys, "duration": 50.0}))
        assert one.value == pytest.approx(np.quantile(np.abs(drawn), confidence), rel=0.012)
    rms = judged({"interpretation": "mixed"}, given(drift={**keys, "duration": 50.0}))
    assert rms.value == pytest.approx(float(np.sqrt(np.mean(drawn**2))), rel=0.005)


@pytest.mark.parametrize(
    ("metric", "wanted"),
    [
        ("ape", 0.1 * 20.0 / math.sqrt(3.0)),
        ("rpe", 0.1 * 2.0 / math.sqrt(12.0)),
        ("smear", 0.1 * 2.0 / math.sqrt(12.0)),
        ("jitter", 0.0),
        ("stability", 0.1 * 5.0),
        ("pde", 0.1 * 5.0),
    ],
)
def test_a_drift_is_a_straight_line_in_a_window(metric: str, wanted: float) -> None:
    drift = given(drift={"x": -0.1, "y": 0.0, "duration": 20.0})
    asked = {"metric": metric, "window": 2.0}
    if metric in ("stability", "pde"):
        asked["apart"] = 5.0
    one = judged(asked, drift)
    assert (one.least, one.value, one.most) == pytest.approx([wanted] * 3, abs=1e-12)
    bound = judged({**asked, "statistic": "bound"}, drift)
    largest = {"ape": 2.0, "rpe": 0.1, "smear": 0.1, "jitter": 0.0, "stability": 0.5, "pde": 0.5}
    assert bound.value == pytest.approx(largest[metric], abs=1e-12)


def _lines_in_a_window(rng: np.random.Generator, tau: np.ndarray, window: float) -> np.ndarray:
    """A line of 1 at 1.3 Hz about its mean over windows, at instants tau of each."""
    phase, u = rng.uniform(0, 2 * np.pi, tau.size), np.pi * 1.3 * window
    return np.cos(u * tau + phase) - np.sinc(u / np.pi) * np.cos(phase)


@pytest.mark.parametrize("confidence", [0.9, 0.997])
def test_a_drift_and_a_line_in_a_window_are_those_of_draws(confidence: float) -> None:
    rng = np.random.default_rng(7)
    tau, rate = rng.uniform(-1, 1, _DRAWS), rng.normal(0.5, 0.6, _DRAWS)
    drawn = _lines_in_a_window(rng, tau, 0.9) + 0.45 * rate * tau
    drift = {"x": 0.5, "y": 0.0, "distribution": "normal", "spread_x": 0.6, "spread_y": 0.0}
    asked = {"metric": "rpe", "window": 0.9, "statistic": "level", "confidence": confidence}
    one = judged({**asked, "interpretation": "mixed"}, line("l", 1.3, 1.0), given(drift=drift))
    wanted = float(np.quantile(np.abs(drawn), confidence))
    assert one.value == pytest.approx(wanted, rel=0.01)
    assert one.least <= wanted <= one.most <= 1.1 * wanted


def _gauss_markov(rng: np.random.Generator, tau: float, step: float, count: int) -> np.ndarray:
    decay = math.exp(-step / tau)
    rows = np.empty((4000, count))
    rows[:, 0] = rng.normal(size=4000)
    kicks = math.sqrt(1.0 - decay**2) * rng.normal(size=rows.shape)
    for k in range(1, count):
        rows[:, k] = decay * rows[:, k - 1] + kicks[:, k]
    return rows


@pytest.mark.parametrize("tau", [0.02, 0.2, 2.0])
def test_a_random_error_with_a_correlation_time_is_weighed_by_its_spectrum(tau: float) -> None:
    window = 1.0
    a = window / tau
    mean = 2.0 / a**2 * (a - 1.0 + math.exp(-a))  # mean square of the mean over the window
    random = {"spread_x": 0.5, "spread_y": 0.1, "correlation_time": tau}
    for metric, wanted in (
        ("mpe", mean),
        ("rpe", 1.0 - mean),
        ("stability", 2.0 - 2.0 * math.exp(-a)),
    ):
        one = judged({"metric": metric, "window": window}, given(random=random))
        assert one.value == pytest.approx(0.5 * math.sqrt(wanted), rel=1e-3)
    # jitter about a fitted line, against draws of the process itself
    rows = _gauss_markov(np.random.default_rng(1), tau, 1.0 / 256, 257)
    t = np.linspace(-1, 1, 257)
    left = rows - np.polynomial.polynomial.polyval(
        t, np.polynomial.polynomial.polyfit(t, rows.T, 1)
    )
    jitter = judged({"metric": "jitter", "window": window}, given(random=random))
    assert jitter.value == pytest.approx(0.5 * math.sqrt(np.mean(left**2)), rel=0.03)


def test_a_random_error_of_a_band_is_even_in_it() -> None:
    random = {"spread_x": 0.5, "spread_y": 0.1, "lowest": 10.0, "highest": 30.0}
    one = judged({"metric": "ape", "lowest": 20.0, "highest": 100.0}, given(random=random))
    assert one.value == pytest.approx(0.5 * math.sqrt(0.5))
    window = judged({"metric": "rpe", "window": 0.02}, given(random=random))
    f = np.linspace(10.0, 30.0, 2001)
    wanted = 0.5 * math.sqrt(float(np.mean(metric_weight("rpe", f, 0.02))))
    assert window.value == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_an_ensemble_is_of_units_at_their_largest(confidence: float) -> None:
    rng = np.random.default_rng(9)
    bias = 0.2 + rng.uniform(-1, 1, _DRAWS)
    end = bias + 30.0 * rng.normal(0.01, 0.02, _DRAWS)
    largest = np.maximum(np.abs(bias), np.abs(end)) + 0.3  # a line comes to its crest
    wanted = float(np.quantile(largest, confidence))
    keys = {"x": 0.01, "y": 0.0, "distribution": "normal", "spread_x": 0.02, "spread_y": 0.0}
    sources = [
        constant("a", x=0.2, **UNIFORM),
        given("b", drift={**keys, "duration": 30.0}),
        line("l", 2.0, 0.3),
    ]
    asked = {"statistic": "level", "confidence": confidence, "interpretation": "ensemble"}
    one = judged(asked, *sources)
    assert one.value == pytest.approx(wanted, rel=0.03)
    assert one.least <= wanted <= one.most <= 1.1 * wanted


@pytest.mark.parametrize("confidence", [0.9, 0.997, 0.9999, 0.999999])
@pytest.mark.parametrize("kind", ["random", "constant"])
def test_the_worst_of_units_or_instants_is_not_below_the_level_of_all(
    confidence: float, kind: str
) -> None:
    """At 99.99 percent three sigma passed what 3.89 sigma fail."""
    if kind == "random":
        source = given(random={"spread_x": 0.33, "spread_y": 0.0})
        worst = "ensemble"
    else:
        source = constant("a", x=0.0, y=0.0, distribution="normal", spread_x=0.33, spread_y=0.0)
        worst = "temporal"
    asked = {"statistic": "level", "confidence": confidence}
    mixed = judged({**asked, "interpretation": "mixed"}, source)
    largest = judged({**asked, "interpretation": worst}, source)
    bound = judged({**asked, "statistic": "bound"}, source)
    assert mixed.value == pytest.approx(
        0.33 * NormalDist().inv_cdf(0.5 + 0.5 * confidence), rel=2e-3
    )
    for one in (largest, bound):
        assert one.value >= mixed.value * (1.0 - 2e-3)
        assert one.most >= mixed.value * (1.0 - 2e-3)


@pytest.mark.parametrize("confidence", [0.68, 0.95])
def test_a_temporal_level_is_that_of_the_worst_unit(confidence: float) -> None:
    wave = 0.5 * np.sin((np.arange(100_000) + 0.5) * 2.0 * np.pi / 100_000)
    units = np.linspace(-0.7, 1.3, 81)
    levels = [float(np.quantile(np.abs(bias + wave), confidence)) for bias in units]
    asked = {"statistic": "level", "confidence": confidence, "interpretation": "temporal"}
    one = judged(asked, constant("a", x=0.3, **UNIFORM), line("l", 2.0, 0.5))
    assert one.value == pytest.approx(max(levels), rel=0.01)
    assert one.least <= max(levels) * 1.002
    assert one.most >= max(levels) * (1.0 - 1e-4)  # the draws' own steps
    mixed = judged(
        {**asked, "interpretation": "mixed"}, constant("a", x=0.3, **UNIFORM), line("l", 2.0, 0.5)
    )
    assert mixed.value < one.value
    rms = judged(
        {"interpretation": "temporal"}, constant("a", x=0.3, **UNIFORM), line("l", 2.0, 0.5)
    )
    assert rms.value == pytest.approx(math.sqrt(1.3**2 + 0.5 * 0.5**2))


def test_a_bound_is_the_worst_of_all() -> None:
    one = judged(
        {"statistic": "bound"},
        constant("a", x=-0.2, **UNIFORM),
        constant("b", **NORMAL),
        given("c", random={"distribution": "uniform", "spread_x": 0.1, "spread_y": 0.0}),
        given("d", random={"spread_x": 0.3, "spread_y": 0.0}),
        line("l", 2.0, 0.5),
    )
    assert one.value == pytest.approx(0.2 + 1.0 + 0.1 + 0.5 + 3.0 * 0.5)
    assert one.most == pytest.approx(one.value, rel=1e-3)


def test_a_uniform_random_error_in_a_window_has_a_level_that_holds_for_any_process() -> None:
    """A square wave has the levels of a bimodal error, noise those of a normal one: both are within."""
    random = {"distribution": "uniform", "spread_x": 1.0, "spread_y": 0.0, "correlation_time": 1.0}
    asked = {"metric": "mpe", "window": 0.01, "statistic": "level", "confidence": 0.95}
    one = judged(asked, given(random=random))
    assert one.most >= 0.95  # in a window far shorter than its memory it is what it is: uniform
    assert one.least <= 0.95 <= one.most


@pytest.mark.parametrize(
    ("asked", "source", "says"),
    [
        ({"metric": "ape"}, {"drift": {"x": 1e-3, "y": 0.0}}, "drift.duration: missing; ape needs it"),
        ({"metric": "mpe", "window": 1.0}, {"drift": {"x": 1e-3, "y": 0.0}}, "drift.duration"),
        ({"metric": "rpe", "window": 1.0}, {"random": {"spread_x": 1e-3, "spread_y": 0.0}}, "random.correlation_time: missing; rpe needs it"),
        ({"lowest": 1.0}, {"random": {"spread_x": 1e-3, "spread_y": 0.0}}, "a band of frequencies needs it"),
        ({"lowest": 1.0}, {"drift": {"x": 1e-3, "y": 0.0, "duration": 1.0}}, "leave lowest out"),
        ({}, {"constant": {"distribution": "normal", "spread_x": 1e-3, "spread_y": 0.0}}, "interpretation is missing"),
        ({"statistic": "level"}, {"constant": {"distribution": "normal", "spread_x": 1e-3, "spread_y": 0.0}}, "interpretation is missing"),
        ({"percentile": 0.95, "interpretation": "mixed"}, {"constant": {"distribution": "uniform", "spread_x": 1e-3, "spread_y": 0.0}}, "leave percentile out"),
        ({"statistic": "bound", "lowest": 1.0},
         {"random": {"distribution": "uniform", "spread_x": 1e-3, "spread_y": 0.0, "correlation_time": 1.0}}, "has no bound"),
    ],
)  # fmt: skip
def test_a_class_that_does_not_tell_a_metric_is_not_judged(
    asked: dict[str, Any], source: dict[str, Any], says: str
) -> None:
    one = judged({**asked, "limit": 1.0}, given("alignment", **source))
    assert one.verdict == "not judged"
    assert any(why.startswith("alignment: ") and says in why for why in one.why)
    # where the requirement does not ask for it, it does not stand in its way
    passes = {"metric": "jitter", "window": 1.0} if "random" not in source else {"metric": "ape"}
    assert judged({**passes, "limit": 1.0}, given("alignment", **source)).verdict == "pass"


def test_an_error_about_one_axis_leaves_the_other_alone() -> None:
    one = judged({"axis": "y"}, constant(x=1.0, y=0.0), line("l", 2.0, 0.5))
    assert one.value == 0.0


def test_shares_of_errors_are_told() -> None:
    one = judged({"interpretation": "mixed"}, constant("a", **NORMAL), line("l", 2.0, 0.5))
    assert {x.source: x.share for x in one.sources} == pytest.approx(
        {"a": 0.16 / (0.16 + 0.125), "l": 0.125 / (0.16 + 0.125)}
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("constant: {x: 1 urad}", "y: missing; give it about both axes"),
        ("constant: {x: 1 urad, y: 0 urad, spread_x: 1 urad}", "spread_x: goes with distribution"),
        ("constant: {distribution: uniform, spread_x: 1 urad}", "spread_y: missing"),
        ("constant: {x: 0 urad, y: 0 urad}", "makes no error"),
        ("constant: {x: 1 s, y: 0 urad}", "constant.x"),
        ("constant: {x: 1 urad, y: 0 urad, sigma: 1 urad}", "sigma"),
        ("drift: {x: 1 urad, y: 0 urad/s}", "drift.x"),
        ("random: {spread_x: 1 urad, spread_y: 0 urad, lowest: 1 Hz}", "give lowest and highest"),
        ("random: {spread_x: -1 urad, spread_y: 0 urad}", "spread_x"),
        ("periodic: {x: 1 urad, y: 0 urad}", "frequency"),
        ("constant: {x: 1 urad, y: 0 urad}\n    point: root", "point: is where loads act"),
        ("lines: a.csv\n    group: thermal", "group: is of errors by their class"),
        ("constant: {x: 1 urad, y: 0 urad}\n    drift: {x: 1 urad/s, y: 0 urad/s}", "drift: give one of"),
        ("constant: {x: 1 urad, y: 0 urad}\n    group: g\n  - name: b\n    group: g\n    drift: {x: 1 urad/s, y: 0 urad/s}",
         "group: 'g' has a and b, which differ in class"),
        ("periodic: {x: 1 urad, y: 0 urad, frequency: 1 Hz}\n    group: g\n  - name: b\n    group: g\n    periodic: {x: 1 urad, y: 0 urad, frequency: 2 Hz}",
         "differ in frequency"),
    ],
)  # fmt: skip
def test_wrong_errors_are_a_sentence(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "sources.yaml"
    path.write_text(f"sources:\n  - name: a\n    {text}\n")
    with pytest.raises(ScenarioError, match=says.replace("(", r"\(")):
        read_file(path, Sources)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("constant: {distribution: triangular, x: 1 urad, y: 0 urad}", "distribution: 'triangular'"),
        ("position: [0 m, 0 m, 0 m]\n    wheel: {speed: 1 rpm, axis: [0, 0, .nan], table: a.csv}",
         "nan] is not a direction"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_sentence(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "sources.yaml"
    path.write_text(f"sources:\n  - name: a\n    {text}\n")
    with pytest.raises(ScenarioError) as found:
        read_file(path, Sources)
    assert says in str(found.value)
    assert str(found.value).count("sources.0.") == 1


def test_groups_of_a_list_are_checked_as_those_of_a_file() -> None:
    bias = {"x": 1.0, "y": 0.0}
    listed = [
        OtherSource.model_validate(with_units({"name": name, "group": "g", kind: bias}))
        for name, kind in (("a", "constant"), ("b", "drift"))
    ]
    with pytest.raises(MicrovibError, match="differ in class"):
        read_sources(listed)


def test_an_interpretation_that_does_not_go_with_a_statistic_is_refused() -> None:
    with pytest.raises(ValueError, match="goes with statistic level or bound"):
        requirement(interpretation="ensemble")


def test_contributors_tell_the_value_without_them() -> None:
    """Of sources, and of their parts; the most costly first."""
    noise = given("n", random={"spread_x": 0.3, "spread_y": 0.0})
    two = Contribution(
        "l", "", ("a", "b"), np.array([2.0, 5.0]), np.array([[0.5, 0.0], [0.2, 0.0]], dtype=complex)
    )
    one = judged({"interpretation": "mixed"}, constant("c", **NORMAL), two, noise)
    squares = {"c": 0.16, "l": 0.5 * (0.25 + 0.04), "n": 0.09}
    whole = sum(squares.values())
    for x in one.sources:
        assert x.without == pytest.approx(math.sqrt(whole - squares[x.source]))
    assert [x.source for x in one.sources] == ["c", "l", "n"]
    assert [x.line for x in one.ranking] == [
        "constant error, normal",
        "a",
        "random error, normal",
        "b",
    ]
    assert one.ranking[1].without == pytest.approx(math.sqrt(whole - 0.125))
    curve = [
        {"frequency": "1 Hz", "amplitude": "1 rad"},
        {"frequency": "9 Hz", "amplitude": "1 rad"},
    ]
    worst = assess(Requirement.model_validate({"axis": "x", "curve": curve}), [two, noise], "rss")
    assert worst.ranking[0].line == "a"
    assert worst.ranking[0].without == pytest.approx(0.2)
    level = {"statistic": "level", "confidence": 0.95, "interpretation": "mixed"}
    one = judged(level, constant("c", **NORMAL), two)
    assert one.sources[0].without == pytest.approx(judged(level, two).value)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_drifts_of_one_duration_begin_together(sign: float) -> None:
    """Known rates of one sign are as large together as one of their sum, and of two signs cancel."""
    two = [
        given("a", drift={"x": 0.03, "y": 0.0, "duration": 10.0}),
        given("b", drift={"x": sign * 0.02, "y": 0.0, "duration": 10.0}),
    ]
    level = {"statistic": "level", "confidence": 0.99}
    whole = 10.0 * (0.03 + sign * 0.02)
    one = judged(level, *two)
    assert one.value == pytest.approx(0.99 * whole, rel=2e-3)
    assert one.most == pytest.approx(one.value)
    assert judged({}, *two).value == pytest.approx(whole / math.sqrt(3.0))
    rng = np.random.default_rng(13)
    spread = {"distribution": "normal", "spread_x": 0.04, "spread_y": 0.0, "duration": 10.0}
    drawn = (0.03 + 0.04 * rng.normal(size=_DRAWS) + sign * 0.02) * rng.uniform(0, 10.0, _DRAWS)
    mixed = judged(
        {**level, "interpretation": "mixed"}, given("c", drift={"x": 0.03, **spread}), two[1]
    )
    assert mixed.value == pytest.approx(np.quantile(np.abs(drawn), 0.99), rel=0.012)


def test_drifts_of_two_durations_are_not_judged() -> None:
    two = [
        given("a", drift={"x": 0.03, "y": 0.0, "duration": 10.0}),
        given("b", drift={"x": 0.02, "y": 0.0, "duration": 20.0}),
    ]
    one = judged({}, *two)
    assert one.verdict == "not judged"
    assert any("drift.duration: differs" in why for why in one.why)
    assert judged({"metric": "rpe", "window": 1.0}, *two).verdict == "pass"


@pytest.mark.parametrize(("metric", "part"), [("rpe", 1 / 3), ("smear", 0.3), ("jitter", 2 / 15)])
def test_a_slow_random_error_is_larger_at_the_ends_of_a_window(metric: str, part: float) -> None:
    """Slow against the window a Gauss-Markov process is a random walk, of the mean square 2 t / tau."""
    tau = 1e4
    slow = given(random={"spread_x": 1.0, "spread_y": 0.0, "correlation_time": tau})
    asked = {"metric": metric, "window": 1.0}
    one = judged({**asked, "statistic": "bound"}, slow)
    assert one.most == pytest.approx(3.0 * math.sqrt(2.0 / tau * part), rel=2e-3)
    draws = np.random.default_rng(3)
    walk = np.cumsum(draws.standard_normal((20_000, 200)), axis=1) * math.sqrt(2.0 / tau / 200)
    tau_at = np.linspace(-1.0, 1.0, 200)
    about = walk - walk.mean(axis=1, keepdims=True)
    line = np.outer(about @ tau_at / (tau_at @ tau_at), tau_at)
    moved = {"rpe": about, "smear": line, "jitter": about - line}[metric]
    for confidence in (0.68, 0.997):
        level = judged({**asked, "statistic": "level", "confidence": confidence}, slow)
        reached = float(np.quantile(np.abs(moved), confidence))
        assert [level.least, level.value, level.most] == pytest.approx([reached] * 3, rel=0.02)


def test_a_random_error_has_the_mean_square_of_its_whole_window_in_rms() -> None:
    slow = given(random={"spread_x": 1.0, "spread_y": 0.0, "correlation_time": 1e4})
    one = judged({"metric": "rpe", "window": 1.0}, slow)
    assert one.value == pytest.approx(math.sqrt(2e-4 / 6.0), rel=2e-3)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"confidence": 0.99}, "confidence: goes with statistic level or bound"),
        (
            {"metric": "rpe", "window": 1.0, "apart": 2.0},
            "apart: goes with metric stability or pde",
        ),
    ],
)
def test_keys_that_say_nothing_of_the_metric_are_refused(
    keys: dict[str, object], says: str
) -> None:
    """A level of 99 % was meant, and its rms passed."""
    with pytest.raises(ValueError, match=says):
        judged(keys, constant("a", **NORMAL))


@pytest.mark.parametrize("key", ["statistic: level", "confidence: 50 percent"])
def test_a_curve_takes_no_statistic(key: str, tmp_path: Path) -> None:
    curve = "curve: [{frequency: 1 Hz, amplitude: 1 urad}, {frequency: 9 Hz, amplitude: 1 urad}]"
    path = tmp_path / "r.yaml"
    path.write_text(f"requirements:\n  - {{{curve}, {key}}}\n")
    with pytest.raises(MicrovibError, match=f"{key.split(':')[0]}: does not go with curve"):
        read_file(path, Requirements)


@pytest.mark.parametrize("metric", ["stability", "pde", "rpe"])
def test_a_drift_that_ends_within_a_window_is_not_judged(metric: str) -> None:
    """Ten seconds of it counted as a hundred, and failed."""
    window = {"apart": 100.0} if metric == "stability" else {"window": 100.0}
    asked = {"metric": metric, **window}
    short, long = (
        judged(asked, given(drift={"x": 1e-3, "y": 0.0, "duration": T})) for T in (10.0, 100.0)
    )
    assert short.verdict == "not judged"
    assert any("ends within the 100 s" in why for why in short.why)
    assert long.verdict == "pass"


@pytest.mark.parametrize("metric", ["ape", "mpe"])
def test_the_bound_of_an_opposing_drift_is_at_its_begin_or_its_end(metric: str) -> None:
    """A constant of 0.1 falls to between 0.09 and -0.07: the spread at the end was added at the begin."""
    drift = {"x": -9e-5, "y": 0.0, "duration": 1e3, "distribution": "uniform", "spread_x": 8e-5}
    asked = {"metric": metric, "statistic": "bound"} | ({"window": 1.0} if metric == "mpe" else {})
    sources = constant("a", x=0.1, y=0.0), given("b", drift={**drift, "spread_y": 0.0})
    found = judged(asked, *sources)
    assert (found.least, found.value, found.most) == pytest.approx([0.1] * 3)


def test_no_process_within_bounds_jitters_by_more_than_its_bound() -> None:
    """At the end of a window what is left about the fitted line is largest for a process of two values."""
    noise = given(random={**UNIFORM, "correlation_time": 0.1})
    found = judged({"metric": "jitter", "window": 0.5, "statistic": "bound"}, noise)
    x = np.linspace(-1.0, 1.0, 200_001)
    worst = 1.0 + float(np.trapezoid(np.abs(0.5 + 1.5 * x), x))
    assert found.most == pytest.approx(worst, rel=1e-6)


@pytest.mark.parametrize(
    ("centre", "apart"), [(10.0005, 1000.0), (10.0001, 1000.0), (10.0005, 400.0)]
)
def test_narrow_noise_between_instants_that_are_far_apart(centre: float, apart: float) -> None:
    """Of many cycles the mean weight was taken, however narrow the noise is: 14.1 for 19.7."""
    low, high = centre - 1e-4, centre + 1e-4
    noise = given(
        random={
            "spread_x": 1.0,
            "spread_y": 1.0,
            "lowest": f"{low!r} Hz",
            "highest": f"{high!r} Hz",
        }
    )
    f = np.linspace(low, high, 200_001)
    wanted = math.sqrt(np.mean(2.0 * (1.0 - np.cos(2.0 * np.pi * f * apart))))
    found = judged({"metric": "stability", "apart": apart}, noise)
    assert found.value == pytest.approx(wanted, rel=1e-3)
