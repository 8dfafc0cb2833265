"""What is open in a budget counts where it may cost most: noise towards the ends of a window, lines that
meet between zeros of a weight, clocks, sources that are small in the nominal case of a campaign alone.
"""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.tiers import sweep

from microvib.io.file_access import FileAccess
from microvib.io.scenario_file import load_scenario
from microvib.model.drive_states import MAY_STICK, SLIDES
from microvib.model.spacecraft import SecondWing
from microvib.signals.pointing import (
    METRICS,
    WHOLE_WINDOW,
    Metric,
    mean_square_of_density,
    mean_squares_at_instants,
    metric_weight,
    row_shares,
)
from microvib.studies.budget.cases import with_craft_of_cases
from microvib.studies.budget.files import OtherSource, Requirement, Requirements
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.sources import Contribution
from microvib.studies.budget.study import pointing_budget
from microvib.studies.budget.sums import Assessment, assess
from microvib.studies.campaign.results import DONE
from microvib.units import Si

URAD = 1e-6
EXAMPLES = Path(__file__).parents[1] / "examples"


def requirement(**keys: object) -> Requirement:
    return Requirement(**{"metric": "ape", "limit": "1 urad", "axis": "x", **keys})


def source(name: str, *lines: tuple[float, float], **keys: object) -> Contribution:
    """Lines about x: frequency [Hz] and amplitude [urad]."""
    f = np.array([line[0] for line in lines])
    los = np.array([[line[1], 0.0] for line in lines], dtype=complex).reshape(-1, 2) * URAD
    names = tuple(f"{name}_{k}" for k in range(len(lines)))
    return Contribution(name, "given", names, f, los, **keys)  # type: ignore[arg-type]


# ---- Noise in a window ----

SLOW_SHAPES = {
    "rpe": lambda t: math.sqrt(3.0) * np.abs(t),
    "smear": lambda t: math.sqrt(3.0) * np.abs(t),
    "jitter": lambda t: 1.5 * math.sqrt(5.0) * np.abs(t**2 - 1.0 / 3.0),
}
"""Sigma of noise that is slow against the window, over that of the whole window: it moves about its
mean along a straight line, and about that line along a parabola."""


def noise(density: float, *band: float) -> Contribution:
    f = np.array(band)
    return replace(source("noise"), density=(f, np.full((f.size, 2), density * URAD**2)))


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.997, 0.9999])
@pytest.mark.parametrize("metric", ["rpe", "smear", "jitter"])
def test_levels_of_slow_noise_are_those_of_all_instants(metric: str, confidence: float) -> None:
    """Against the average of normal distributions of which sigma is known at each instant in closed form."""
    r = requirement(metric=metric, window="0.1 s", statistic="level", confidence=confidence)
    sigma = assess(r.model_copy(update={"statistic": "rms"}), [noise(1.0, 0.1, 0.5)], "rss").value
    t = (np.arange(20000) + 0.5) / 20000
    at = np.maximum(SLOW_SHAPES[metric](t), 1e-9)
    level = brentq(lambda x: np.mean(2.0 * norm.sf(x / at)) - (1.0 - confidence), 1e-6, 20.0)
    found = assess(r, [noise(1.0, 0.1, 0.5)], "rss")
    assert (found.least, found.value, found.most) == pytest.approx((level * sigma,) * 3, rel=3e-3)
    below, above = (
        assess(r.model_copy(update={"limit": part * level * sigma}), [noise(1.0, 0.1, 0.5)], "rss")
        for part in (0.98, 1.02)
    )
    assert (below.verdict, above.verdict) == ("fail", "pass")


@pytest.mark.parametrize(
    ("metric", "part"), [("rpe", math.sqrt(3.0)), ("smear", math.sqrt(3.0)), ("jitter", 5.0**0.5)]
)
def test_a_bound_has_the_noise_of_the_worst_instant(metric: str, part: float) -> None:
    """At its ends a window sees 1.7 times the sigma of all of it, and 2.2 times about a fitted line."""
    r = requirement(metric=metric, window="0.1 s", statistic="bound")
    sigma = assess(r.model_copy(update={"statistic": "rms"}), [noise(1.0, 0.1, 0.5)], "rss").value
    assert assess(r, [noise(1.0, 0.1, 0.5)], "rss").most == pytest.approx(
        3.0 * part * sigma, rel=3e-3
    )


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("window", [1e-3, 0.3, 40.0])
def test_noise_at_instants_is_that_of_a_window_together(metric: Metric, window: float) -> None:
    f = np.geomspace(0.5, 60.0, 40)
    S = 1.0 / f
    rows = mean_squares_at_instants(metric, f, S, window, instants=WHOLE_WINDOW.instants)
    together = row_shares(metric, WHOLE_WINDOW) @ rows
    assert together == pytest.approx(mean_square_of_density(metric, f, S, window), rel=2e-3)


@pytest.mark.parametrize("apart", [None, 60.0, 60.004, 37.0, 500.0, 0.002])
@pytest.mark.parametrize("metric", ["mpe", "smear", "pde"])
def test_a_density_far_above_a_long_window_is_little_and_not_nothing(
    metric: Metric, apart: float | None
) -> None:
    """200 to 201 Hz in a minute, 12 000 periods; against the weight itself, sampled densely."""
    f, S = np.array([200.0, 200.3, 201.0]), np.array([1.0, 2.0, 0.5])
    at = np.linspace(200.0, 201.0, 400_001)
    wanted = float(np.trapezoid(np.interp(at, f, S) * metric_weight(metric, at, 60.0, apart), at))
    assert mean_square_of_density(metric, f, S, 60.0, apart) == pytest.approx(wanted, rel=0.02)


# ---- Lines that meet ----


def test_lines_that_beat_count_between_the_zeros_of_a_weight() -> None:
    """20 Hz and 20.001 Hz change by nothing in 1000 s as they are given, and by four amplitudes where clocks are off."""
    pair = [source("a", (20.0, 1.0)), source("b", (20.001, 1.0))]
    found = assess(requirement(metric="stability", apart="1000 s", limit="2.5 urad"), pair, "rss")
    assert found.verdict == "not judged"
    assert found.most == pytest.approx(4.0 / math.sqrt(2.0) * URAD, rel=1e-3)


def test_lines_that_beat_at_the_end_of_a_band_count() -> None:
    """Clocks that are off by 1e-4 take both into the band."""
    pair = [source("a", (19.9995, 1.0)), source("b", (19.9993, 1.0))]
    found = assess(requirement(lowest="20 Hz", limit="1.2 urad"), pair, "rss")
    assert found.verdict == "not judged"
    assert found.most == pytest.approx(2.0 / math.sqrt(2.0) * URAD)


def moving(*frequencies: float) -> Contribution:
    """A line of 1 urad that is at one of several frequencies."""
    each = tuple(source("wheel", (f, 1.0)) for f in frequencies)
    return replace(each[0], alternatives=each)


def test_a_line_that_is_met_counts_between_the_zeros_of_a_weight() -> None:
    met = [source("a", (20.0, 1.0)), moving(19.9, 20.0005, 20.1)]
    found = assess(requirement(metric="stability", apart="1000 s", limit="2.5 urad"), met, "rss")
    assert found.most >= 4.0 / math.sqrt(2.0) * URAD * (1.0 - 1e-3)
    assert found.verdict == "not judged"


def test_two_lines_that_are_met_together_both_add() -> None:
    """1 urad meets two lines of 1 urad, 0.005 Hz apart: 3 urad together, beside what the two make."""
    met = [source("a", (20.0, 1.0), (20.005, 1.0)), moving(19.0, 20.0, 21.0)]
    found = assess(requirement(lowest="18 Hz"), met, "rss")
    assert found.most >= 3.0 / math.sqrt(2.0) * URAD * (1.0 - 1e-9)


def test_a_line_that_is_met_in_a_notch_of_a_curve_is_judged_there() -> None:
    """At 20 Hz a curve allows 3 urad, and 0.001 Hz above 1.5 urad: two lines of 1 urad may be there."""
    points = ((19.0, 3.0), (20.0, 3.0), (20.001, 1.5), (21.0, 1.5))
    curve = [{"frequency": f"{f} Hz", "amplitude": f"{a} urad"} for f, a in points]
    pair = [source("a", (19.9999, 1.0)), source("b", (19.9998, 1.0))]
    asked = requirement(limit=None, curve=curve)
    assert assess(asked, pair, "rss").verdict == "not judged"


def test_a_line_given_as_nothing_may_be_as_large_as_its_table_says(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "frequency_hz,los_x_rad,los_y_rad,los_x_most_rad\n20,0,1e-7,1e-6\n30,1e-7,1e-7,\n"
    )
    given = OtherSource(name="a", lines="a.csv")
    craft = scenario_of(whole.FullCraft())
    one = contribution_of_other(given, craft, FileAccess(tmp_path))
    found = assess(requirement(highest="25 Hz", limit="0.5 urad"), [one], "rss")
    assert found.value < 1e-6 * URAD
    assert found.most == pytest.approx(URAD / math.sqrt(2.0), rel=1e-6)
    assert found.verdict == "not judged"


# ---- Clocks ----


def carrying(one: object, other: object) -> object:
    wing = SecondWing(drive="held", interface=other.spacecraft.interface, array_angle=Si(other.spacecraft.array_angle))  # type: ignore[attr-defined] # fmt: skip
    return one.with_({"spacecraft.second_wing": wing})  # type: ignore[attr-defined]


@pytest.mark.parametrize("start", ["steady", "rest"])
def test_drives_of_one_clock_have_phases_of_one_instant(start: str) -> None:
    """Where the record of one begins later, by a part of a step, the two still step together."""
    near = scenario_of(
        whole.FullCraft(damping=np.full(4, 0.05), bandwidth=0.1),
        **{"record.start": start, "record.settle": Si(40.0), "record.duration": Si(8.0)},
    )
    place, axis = near.spacecraft.interface.position, near.spacecraft.interface.drive_axis  # type: ignore[union-attr]
    far = near.with_si({
        "spacecraft.interface.position": [place[0], -place[1], place[2]],
        "spacecraft.interface.drive_axis": [-x for x in axis],
    })  # fmt: skip
    near, far = carrying(near, far), carrying(far, near)  # type: ignore[assignment]
    later = far.with_si({"record.settle": 40.0 + 0.37 / near.driving_frequency})
    limit = Requirements(requirements=[{"metric": "ape", "limit": "1 urad", "lowest": "5 Hz"}])
    same, shifted = (
        pointing_budget([near, other], limit, one_clock=True).judged[0] for other in (far, later)
    )
    assert shifted.value == pytest.approx(same.value, rel=1e-3)


def test_a_clock_of_a_file_is_not_that_of_a_drive(tmp_path: Path) -> None:
    """A file with the drive's own line, the other way round, does not take it away by the name of its clock."""
    craft = scenario_of(whole.FullCraft(bandwidth=0.1), **{"record.start": "steady"})
    drive = pointing_budget(craft).contributions[0]
    k = drive.names.index("drive_1")
    size, phase = np.abs(drive.los[k]), np.angle(-drive.los[k])
    (tmp_path / "a.csv").write_text(
        "frequency_hz,los_x_rad,los_y_rad,los_x_phase_rad,los_y_phase_rad\n"
        f"{drive.frequency[k]!r},{size[0]!r},{size[1]!r},{phase[0]!r},{phase[1]!r}\n".replace(
            "np.float64(", ""
        ).replace(")", "")
    )
    f = float(drive.frequency[k])
    asked = Requirements(
        requirements=[
            {"metric": "ape", "lowest": f"{0.9 * f} Hz", "highest": f"{1.1 * f} Hz", "limit": "1 urad"}
        ]
    )  # fmt: skip

    def judged(clock: str) -> Assessment:
        given = OtherSource(name="a", lines=str(tmp_path / "a.csv"), clock=clock)
        return pointing_budget(craft, asked, sources=[given]).judged[0]

    own = judged("mine")
    assert own.most > 1.9 * math.hypot(*size) / math.sqrt(2.0)
    for name in (drive.source, drive.clock, "all", "all drives"):
        assert judged(name).most == pytest.approx(own.most)


# ---- Campaigns ----


def test_a_percentile_holds_where_the_nominal_case_has_nothing_in_the_band() -> None:
    """In a tenth of the cases the rate takes a line into a band in which the nominal case has none."""
    f = np.where(np.arange(200) % 10 == 0, 11.0, 5.0)[:, None]
    one = source("a", (5.0, 1.0), cases=np.full((200, 1, 2), URAD), cases_frequency=f)
    asked = requirement(lowest="10 Hz", percentile="95 percent", limit="0.5 urad")
    found = assess(asked, [one], "rss")
    assert found.value == pytest.approx(URAD / math.sqrt(2.0))
    assert found.verdict == "fail"
    rare = asked.model_copy(update={"percentile": 0.5})
    assert assess(rare, [one], "rss").verdict == "pass"


@pytest.mark.parametrize("statistic", ["rms", "bound"])
def test_phases_that_are_not_known_count_in_each_case(statistic: str) -> None:
    """Two sources of one line are a hundredth of the drive on the nominal craft, and all of the figure in cases."""
    drive = source("a", (5.0, 1.0), cases=np.full((100, 1, 2), URAD))
    beside = [
        replace(source(name, (7.0, 0.01)), in_case=lambda _, name=name: source(name, (7.0, 3.0)))
        for name in "bc"
    ]
    asked = requirement(statistic=statistic, percentile="50 percent")
    found = assess(asked, [drive, *beside], "rss")
    if statistic == "rms":
        most, value = math.sqrt(0.5 * (1.0 + 36.0)), math.sqrt(0.5 * (1.0 + 18.0))
    else:
        most, value = 7.0, 1.0 + 3.0 * math.sqrt(2.0)
    assert found.value == pytest.approx(value * URAD)
    assert found.most == pytest.approx(most * URAD)
    assert found.least <= URAD * (1.0 + 1e-9)


def test_lines_that_beat_count_in_each_case() -> None:
    drive = source("a", (5.0, 1.0), cases=np.full((100, 1, 2), URAD))
    other = replace(source("b", (5.001, 0.01)), in_case=lambda _: source("b", (5.001, 3.0)))
    found = assess(requirement(percentile="50 percent"), [drive, other], "rss")
    assert found.most == pytest.approx(4.0 / math.sqrt(2.0) * URAD, rel=2e-3)


def test_states_of_drives_count_on_the_craft_of_each_case(tmp_path: Path) -> None:
    """A shaft that sticks at times may do so in every case, and not in the nominal one alone."""
    craft = load_scenario(EXAMPLES / "spacecraft.yaml")
    (tmp_path / "l.csv").write_text("frequency_hz,my_n_m\n1.25,1e-3\n")
    cooler = OtherSource(name="cooler", lines="l.csv", position=["0 m", "0 m", "0 m"])
    files, softer = FileAccess(tmp_path), craft.with_({"array.modes.1.frequency": "1.1 Hz"})
    results = SimpleNamespace(
        state=np.full(2, DONE),
        campaign=SimpleNamespace(
            design=SimpleNamespace(
                samples=np.zeros((2, 1)),
                cases=2,
                uncertain=(1,),
                changes=lambda _: {"array.modes.1.frequency": 1.1},
                scenario=lambda _: softer,
                study=SimpleNamespace(sampling=SimpleNamespace(method="random", count=2)),
            )
        ),
    )
    nominal = contribution_of_other(cooler, craft, files)
    (beside,) = with_craft_of_cases([nominal], [cooler], files, results, (MAY_STICK, SLIDES))  # type: ignore[arg-type]
    assert beside.in_case is not None
    found = beside.in_case(1)
    stuck, slides = (
        contribution_of_other(cooler, softer, files, (own, SLIDES)) for own in (MAY_STICK, SLIDES)
    )
    assert found.relative_errors == pytest.approx(stuck.relative_errors)
    assert np.max(stuck.relative_errors) > 1.05 * np.max(slides.relative_errors)


# ---- Correlation ----


@pytest.mark.parametrize("axis", sweep("xy", "x"))
def test_loads_of_a_density_may_be_of_one_cause(tmp_path: Path, axis: str) -> None:
    """A force 1 m above the origin, given as force and moment: both add as amplitudes or cancel, and the truth is between."""
    craft = scenario_of(whole.FullCraft(bandwidth=0.2, damping=np.full(4, 0.01)))
    (tmp_path / "force.csv").write_text("frequency_hz,fx_n2_hz\n20,1e-4\n40,1e-4\n")
    (tmp_path / "both.csv").write_text(
        "frequency_hz,fx_n2_hz,my_n2_m2_hz\n20,1e-4,1e-4\n40,1e-4,1e-4\n"
    )

    def given(table: str, height: float) -> Contribution:
        place = ["0 m", "0 m", f"{height} m"]
        other = OtherSource(name="n", density=table, position=place)
        return contribution_of_other(other, craft, FileAccess(tmp_path))

    r = requirement(axis=axis)
    truth = assess(r, [given("force.csv", 1.0)], "rss")
    below = assess(r, [given("force.csv", -1.0)], "rss")  # the moment the other way round
    found = assess(r, [given("both.csv", 0.0)], "rss")
    assert truth.least == pytest.approx(truth.most)  # of one load there is no question
    for one in (truth.value, below.value):
        assert found.least * (1.0 - 1e-6) <= one <= found.most * (1.0 + 1e-6)
    assert found.most == pytest.approx(max(truth.value, below.value), rel=0.3)
    assert found.value == pytest.approx(
        math.sqrt(0.5 * (truth.value**2 + below.value**2)), rel=1e-3
    )
