"""Limits over frequency: what a curve allows in an interval, verdicts by it, and files of it.

A notch, a step, the curve's end or a band's edge decide nothing by chance.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import Judgement, judge
from microvib.analysis.unseen import OutOfBandLines
from microvib.io.file_access import NO_FILES
from microvib.io.limit_files import given_limit, limit_from_text, read_limit
from microvib.signals.limit_curve import Limit, LimitCurve, in_band
from microvib.signals.line_table import BELOW_FLOOR, Line, LineTable, ResidualPeaks
from microvib.studies.rates import ABOVE_LIMIT, HIDDEN_LINE, STEP_OF_LIMIT, RateCase, RateLine

NOTHING = ResidualPeaks(np.zeros(0), np.zeros(0))
RATE = 4096.0


def curve_of(*points: tuple[float, float]) -> LimitCurve:
    return LimitCurve(*zip(*points, strict=True))


def allowed_densely(curve: LimitCurve, low: float, high: float) -> np.ndarray:
    """What a curve allows at very many frequencies of an interval, by its definition; at its points
    both that before and that after a step."""
    low, high = max(low, curve.low), min(high, curve.high)
    if low > high:
        return np.empty(0)
    found = [a for f, a in zip(curve.frequency, curve.amplitude, strict=True) if low <= f <= high]
    for f in np.linspace(low, high, 400):
        for (f0, a0), (f1, a1) in pairwise(zip(curve.frequency, curve.amplitude, strict=True)):
            if f0 <= f <= f1 and f0 < f1:
                part = math.log(f / f0) / math.log(f1 / f0)
                found.append(math.exp(math.log(a0) + part * (math.log(a1) - math.log(a0))))
    return np.array(found)


@st.composite
def curves(draw: st.DrawFn) -> LimitCurve:
    """A curve of 2 to 8 frequencies from 1 Hz on, some of them steps."""
    ratios = draw(st.lists(st.floats(1.001, 4.0), min_size=1, max_size=7))
    sizes = st.floats(1e-4, 1e-1)
    f, points = 1.0, [(1.0, draw(sizes))]
    for k, ratio in enumerate(ratios):
        f *= ratio
        points.append((f, draw(sizes)))
        if k < len(ratios) - 1 and draw(st.booleans()):
            after = draw(sizes)
            if after != points[-1][1]:
                points.append((f, after))
    return curve_of(*points)


@settings(deadline=None, max_examples=200)
@given(curves(), st.floats(0.3, 300.0), st.floats(1.0, 3.0))
def test_extremes_of_an_interval_are_those_of_very_many_frequencies(curve, low, ratio):
    high = low * ratio
    dense = allowed_densely(curve, low, high)
    if not dense.size:
        assert curve.strictest(low, high) == math.inf
        return
    assert curve.strictest(low, high) == pytest.approx(dense.min(), rel=1e-9)
    assert curve.most_lenient(low, high) == pytest.approx(dense.max(), rel=1e-9)


@settings(deadline=None, max_examples=100)
@given(curves(), st.floats(0.5, 50.0), st.floats(1.01, 20.0), st.floats(0.5, 300.0))
def test_a_part_of_a_curve_is_the_curve_there(curve, low, ratio, f):
    high = low * ratio
    part = curve.within(low, high)
    if part is None:
        assert high <= curve.low or low >= curve.high
        return
    f = min(max(f, part.low * 1.0001), part.high * 0.9999)
    if part.low < f < part.high:
        assert part.at(f) == pytest.approx(curve.at(f), rel=1e-9)
    assert curve.allows_all_of(curve)
    assert part.allows_all_of(curve)


def test_one_number_is_the_flat_curve_to_the_last_bit():
    flat = LimitCurve.flat(0.0123456789, 0.5, 150.0)
    f = np.geomspace(0.5, 150.0, 1001)
    assert np.all(flat.strictest(f, 1.1 * f) == 0.0123456789)
    split = curve_of((0.5, 0.0123456789), (3.0, 0.0123456789), (150.0, 0.0123456789))
    assert np.all(split.most_lenient(0.9 * f, f) == 0.0123456789)
    everywhere = LimitCurve.flat(0.01)
    assert everywhere.strictest(0.0, math.inf) == 0.01 == everywhere.at(1e9)


def test_a_curve_allows_all_of_a_stricter_one_that_reaches_as_far():
    wide, narrow = curve_of((1.0, 0.01), (100.0, 0.1)), curve_of((2.0, 0.03), (50.0, 0.09))
    assert narrow.allows_all_of(wide)
    assert not wide.allows_all_of(narrow)
    notched = curve_of((1.0, 0.01), (10.0, 0.0316), (10.0, 0.001), (10.1, 0.0316), (100.0, 0.1))
    assert not notched.allows_all_of(wide)
    assert LimitCurve.flat(0.1).allows_all_of(LimitCurve.flat(0.01))


# Verdicts


def lines_of(*lines: Line, rest: ResidualPeaks = NOTHING) -> LineTable:
    """Lines of a torque, exactly known."""
    return LineTable(tuple(lines), 1.0, 0.0, int(16 * RATE), RATE, rest=rest, own_error=0.0)


def line_at(
    f: float, amplitude: float, off: float = 0.0, name: str = "drive_1", **changes: object
) -> Line:
    return replace(
        Line(
            name=name,
            kind="drive",
            expected=f,
            frequency=f,
            frequency_uncertainty=off,
            amplitude=amplitude,
            amplitude_uncertainty=0.0,
            decay=0.0,
            status="ok",
        ),
        **changes,
    )


def verdict(table: LineTable, *points: tuple[float, float]) -> str:
    return judge(table, Limit.of_curves(curve_of(*points))).verdict


def verdict_densely(lines: list[Line], curve: LimitCurve) -> str:
    """The verdict on exactly known lines by its definition."""
    largest, found = max(x.amplitude for x in lines), set()
    for x in lines:
        off = max(4.0 * x.frequency_uncertainty, 1e-4 * x.frequency)
        dense = allowed_densely(curve, x.frequency - off, x.frequency + off)
        error = 1e-3 * max(x.amplitude, 0.25 * largest)
        if not dense.size or x.amplitude + error <= dense.min():
            continue
        found.add("fail" if x.amplitude - error > dense.max() else "not judged")
    if "fail" in found:
        return "fail"
    return "not judged" if found else "pass"


@settings(deadline=None, max_examples=150)
@given(
    curves(),
    st.lists(
        st.tuples(st.floats(0.8, 60.0), st.floats(1e-5, 5e-2), st.sampled_from([0.0, 0.002, 0.1])),
        min_size=1,
        max_size=5,
    ),
)
def test_the_verdict_by_any_curve_is_that_of_very_many_frequencies(curve, given_lines):
    passband = 0.35 * RATE
    if curve.high > passband:
        curve = in_band(curve, (0.0, passband))
    lines = [line_at(f, a, off, f"drive_{k}") for k, (f, a, off) in enumerate(given_lines)]
    expected = verdict_densely(lines, curve)
    assert judge(lines_of(*lines), Limit.of_curves(curve)).verdict == expected


def test_a_notch_between_two_grid_points_is_seen():
    notched = [(1.0, 0.1), (20.0, 0.1), (20.01, 0.001), (20.02, 0.1), (100.0, 0.1)]
    assert verdict(lines_of(line_at(20.01, 0.01, 1e-6)), *notched) != "pass"
    assert verdict(lines_of(line_at(19.5, 0.01, 1e-6)), *notched) == "pass"


def test_a_notch_narrower_than_the_frequency_is_known_is_neither_hit_nor_missed_by_chance():
    notched = [(1.0, 0.1), (20.0, 0.1), (20.001, 0.001), (20.002, 0.1), (100.0, 0.1)]
    for f in np.linspace(19.97, 20.03, 31):
        assert verdict(lines_of(line_at(f, 0.01, 0.01)), *notched) == "not judged"
        judged = judge(lines_of(line_at(f, 0.01, 0.01)), Limit.of_curves(curve_of(*notched)))
        assert "within the uncertainty of its frequency" in str(judged)
        assert verdict(lines_of(line_at(f, 0.11, 0.01)), *notched) == "fail"  # above all of it


def test_a_step_is_strict_and_lenient_on_either_side():
    step = [(1.0, 0.01), (10.0, 0.01), (10.0, 0.1), (100.0, 0.1)]
    found = {
        f: verdict(lines_of(line_at(f, 0.05, 0.0)), *step) for f in (9.9, 9.9995, 10.0005, 10.1)
    }
    assert found == {9.9: "fail", 9.9995: "not judged", 10.0005: "not judged", 10.1: "pass"}


def test_beyond_the_ends_nothing_is_limited_and_it_is_said():
    ends = [(5.0, 0.01), (50.0, 0.01), (50.5, 0.02)]
    told = judge(lines_of(line_at(60.0, 1.0)), Limit.of_curves(curve_of(*ends)))
    assert told.verdict == "pass"
    assert "Nothing is limited below 5 Hz and above 50.5 Hz." in str(told)
    assert verdict(lines_of(line_at(60.0, 1.0, 3.0)), *ends) != "pass"  # it may stand below 50.5 Hz


def test_a_curve_that_ends_above_the_passband_is_not_judged_there():
    passband = 0.35 * RATE
    table = lines_of(line_at(60.0, 1e-4))
    assert verdict(table, (1.0, 0.01), (0.99 * passband, 0.02)) == "pass"
    assert verdict(table, (1.0, 0.01), (1.01 * passband, 0.02)) == "not judged"


def test_an_unexplained_peak_counts_against_the_least_of_its_part_of_the_spectrum():
    """Of a twelfth of an octave the highest peak is known: another may stand in a notch in it."""
    rest = ResidualPeaks(np.array([20.0]), np.array([0.005]))
    table = lines_of(line_at(60.0, 1e-4), rest=rest)
    plain = [(1.0, 0.1), (100.0, 0.1)]
    assert verdict(table, *plain) == "pass"
    for f in (20.3, 20.5):  # the same twelfth of an octave, from 19.0 to 20.2 Hz, ends below
        notch = [(1.0, 0.1), (f, 0.1), (f, 0.001), (1.001 * f, 0.1), (100.0, 0.1)]
        assert verdict(table, *notch) == "pass"
    for f in (19.1, 19.6, 20.1):
        notch = [(1.0, 0.1), (f, 0.1), (f, 0.001), (1.001 * f, 0.1), (100.0, 0.1)]
        assert verdict(table, *notch) == "not judged"


def test_a_large_line_hides_others_in_a_notch_within_the_resolution():
    rest = replace(NOTHING, resolution=0.2)
    table = lines_of(line_at(20.0, 0.05, 1e-6), rest=rest)
    for f, expected in (
        (20.1, "not judged"),
        (19.85, "not judged"),
        (20.5, "pass"),
        (19.5, "pass"),
    ):
        notch = [(1.0, 0.1), (f, 0.1), (f, 0.001), (1.001 * f, 0.1), (100.0, 0.1)]
        judged = judge(table, Limit.of_curves(curve_of(*notch)))
        assert judged.verdict == expected
        assert ("masked by it" in str(judged)) == (expected == "not judged")


def test_a_line_below_the_floor_is_judged_by_what_its_floor_hides():
    hidden = line_at(20.0, math.nan, status=BELOW_FLOOR, frequency=math.nan, floor=0.001)
    table = lines_of(replace(hidden, amplitude=0.0005))
    assert verdict(table, (1.0, 0.1), (100.0, 0.1)) == "pass"
    notch = [(1.0, 0.1), (20.0, 0.1), (20.0, 0.003), (20.001, 0.1), (100.0, 0.1)]
    assert verdict(table, *notch) == "not judged"


def test_bounds_above_the_passband_count_up_to_their_neighbours():
    """Between frequencies that are looked at, others may stand."""
    lines = OutOfBandLines("lines", np.array([100.0, 200.0, 300.0]), np.full(3, 0.01), np.ones(3))
    notch = curve_of((1.0, 0.1), (240.0, 0.1), (240.0, 0.001), (241.0, 0.1), (1000.0, 0.1))
    assert not np.any(lines.may_exceed(notch))
    assert replace(lines, between=True).may_exceed(notch).tolist() == [False, True, True]
    above = curve_of((1.0, 0.1), (640.0, 0.1), (640.0, 0.001), (641.0, 0.1), (1000.0, 0.1))
    assert not np.any(replace(lines, between=True).may_exceed(above))
    assert replace(lines, between=True, falling=True).may_exceed(above).tolist() == [
        False,
        False,
        True,
    ]


def test_a_mode_that_rings_counts_between_its_coupled_and_its_clamped_frequency(state_1, motion_1):
    """As the shaft sticks, an array's mode moves from one to the other."""
    table = mv.find_lines(motion_1)
    mode = next(m for m in mv.coupled_modes(state_1) if m.name == "array_mode_1")
    assert mode.fixed_frequency is not None
    between = 0.5 * (mode.frequency + mode.fixed_frequency)
    ringing = replace(
        table,
        lines=(replace(table["array_mode_1"], status="decaying", amplitude=0.002, decay=0.05),),
        rest=NOTHING,
        own_error=0.0,
        find_error=None,
    )
    flat = curve_of((0.01, 0.1), (400.0, 0.1))
    assert judge(ringing, Limit.of_curves(flat), state_1).verdict == "pass"
    for f, expected in ((between, "not judged"), (1.5 * mode.fixed_frequency, "pass")):
        notch = curve_of((0.01, 0.1), (f, 0.1), (f, 1e-4), (1.0001 * f, 0.1), (400.0, 0.1))
        assert judge(ringing, Limit.of_curves(notch), state_1).verdict == expected


RANDOM = np.random.default_rng(34)


@pytest.mark.parametrize("kind", ["record", "steady"])
def test_no_stricter_curve_is_better_and_a_flat_one_is_one_number(state_1, motion_1, kind):
    scenario = state_1.with_({"tracking.clock_ratio": 0.994})
    table = mv.find_lines(motion_1 if kind == "record" else scenario, start=None)
    if kind == "steady":
        table = mv.find_lines(scenario, start="steady")
    table = replace(table, own_error=1e-3, find_error=None)
    order = {"fail": 0, "not judged": 1, "pass": 2}
    seen = set()
    for _ in range(8):
        f = np.unique(np.append(RANDOM.uniform(0.3, 2000.0, RANDOM.integers(2, 6)), [0.3, 1400.0]))
        a = 10.0 ** RANDOM.uniform(-3.0, -0.5, f.size)
        strict = LimitCurve(tuple(f), tuple(a))
        lenient = LimitCurve(tuple(f), tuple(a * RANDOM.uniform(1.0, 4.0, f.size)))
        worse, better = (judge(table, Limit.of_curves(x), scenario) for x in (strict, lenient))
        seen |= {worse.verdict, better.verdict}
        assert order[worse.verdict] <= order[better.verdict]
        inside = limit_of(strict.least, strict.low, strict.high)
        assert order[judge(table, inside, scenario).verdict] <= order[worse.verdict]
        most = limit_of(strict.most, strict.low, strict.high)
        assert order[worse.verdict] <= order[judge(table, most, scenario).verdict]
        split = curve_of(*((float(x), strict.least) for x in f))
        assert str(judge(table, Limit.of_curves(split), scenario)) == str(
            judge(table, inside, scenario)
        )
    assert len(seen) > 1


def test_a_verdict_names_the_line_the_frequency_and_what_is_allowed(motion_1, state_1):
    scenario = state_1.with_({"tracking.clock_ratio": 0.994})
    steep = [(1.0, 0.2), (40.0, 0.2), (40.0, 0.01), (60.0, 0.01), (60.0, 0.2), (300.0, 0.2)]
    judged = judge(mv.find_lines(motion_1), Limit.of_curves(curve_of(*steep)), scenario)
    assert judged.verdict == "fail"
    assert judged.worst is not None
    assert judged.worst.limit == 0.01
    assert "(drive_1 at 53.01" in str(judged) or "(drive_1 at 52.7" in str(judged)
    assert "where 10 mN m are allowed" in str(judged)


# Rates


def test_rates_are_judged_by_a_curve_as_runs_are():
    lines = (
        RateLine("drive_1", "drive", 1.0, 20.0, 0.05),
        RateLine("drive_2", "drive", 2.0, 40.0, 0.01),
    )
    case = RateCase(0.001, 16, lines)
    everywhere = (0.0, math.inf)
    rising = curve_of((1.0, 0.06), (30.0, 0.06), (30.0, 0.005), (100.0, 0.005))
    assert case.verdict(everywhere, 0.06) == ""
    assert case.verdict(everywhere, rising) == ABOVE_LIMIT
    assert case.largest(everywhere).name == "drive_1"
    assert case.largest(everywhere, limit=rising).name == "drive_2"
    assert case.verdict((1.0, 30.0), rising) == ""  # --band with a curve: its part there
    at_step = curve_of((1.0, 0.06), (40.001, 0.06), (40.001, 0.005), (100.0, 0.005))
    assert case.verdict(everywhere, at_step) == STEP_OF_LIMIT
    hidden = replace(case, hidden=(RateLine("peak", "other", 1.5, 30.0, 0.02, away=2.0),))
    notch = curve_of((1.0, 0.06), (31.0, 0.06), (31.0, 0.015), (31.1, 0.06), (100.0, 0.06))
    assert case.verdict(everywhere, notch) == ""
    assert hidden.verdict(everywhere, notch) == HIDDEN_LINE


# Files


def write(folder: Path, text: str, name: str = "allowed.csv") -> str:
    (folder / name).write_text(text, encoding="utf-8")
    return str(folder / name)


GOOD = {
    "frequency_hz,t_nm\n1,0.005\n100,0.05\n": ("", 0.005, 0.05),
    "frequency_hz,t_mnm\n1,5\n100,50\n": ("", 0.005, 0.05),
    "frequency_hz,amplitude_n_m\n1,0.005\n100,0.05\n": ("", 0.005, 0.05),
    "Frequency [kHz];Torque [mN m]\n0,001;5\n0,1;50\n": ("", 0.005, 0.05),
    "frequency_hz,mz_mnm,comment\n1,5,first\n100,50,\n": ("Mz", 0.005, 0.05),
    "frequency_hz,Fx [mN]\n1,5\n100,50\n": ("Fx", 0.005, 0.05),
    "# a remark, of two\nfrequency_hz,t_mnm\n# another\n1,5\n\n100,50\n": ("", 0.005, 0.05),
    "frequency_hz,F_y_n\n1,5\n100,50\n": ("Fy", 5.0, 50.0),
}


@pytest.mark.parametrize("text", GOOD)
def test_a_file_is_read_in_its_units(tmp_path, text):
    component, least, most = GOOD[text]
    limit = read_limit(write(tmp_path, text))
    curve = limit.loads[component] if component else limit.curve
    assert curve.frequency == pytest.approx((1.0, 100.0))
    assert (curve.least, curve.most) == pytest.approx((least, most))
    assert limit_from_text(text, "x").as_dict()["low"] == pytest.approx(1.0)


def test_columns_have_their_own_points(tmp_path):
    text = "frequency_hz,t_mnm,fx_mn\n1,5,\n10,,3\n50,7,4\n100,50,\n"
    limit = read_limit(write(tmp_path, text))
    assert limit.curve.frequency == (1.0, 50.0, 100.0)
    assert limit.loads["Fx"].frequency == (10.0, 50.0)
    again = Limit.from_dict(limit.as_dict())
    assert again == limit


BAD = {
    "": "is empty",
    "frequency_hz,t_mnm\n": "has 0 points; two or more are expected",
    "frequency_hz,t_mnm\n1,5\n": "has 1 points; two or more are expected",
    "frequency_hz,t_mnm\n100,5\n1,50\n": "goes from 100 Hz to 1 Hz; frequencies that never fall",
    "frequency_hz,t_mnm\n1,5\n10,-5\n": "row 3: t_mnm: -5 is not above 0",
    "# a remark\n\nfrequency_hz,t_mnm\n1,5\n10,-5\n": "row 5: t_mnm: -5 is not above 0",
    "frequency_hz,t_mnm\n1,5\n10,0\n": "row 3: t_mnm: 0 is not above 0",
    "frequency_hz,t_mnm\n0,5\n10,5\n": "row 2: frequency_hz: 0 is not above 0",
    "frequency_hz,t_mnm\n1,5\n10,nan\n": "row 3: t_mnm: is nan; a finite number is expected",
    "frequency_hz,t_mnm\n1,5\ninf,5\n": "row 3: frequency_hz: is inf; a finite number",
    "frequency_hz,t_mnm\n1,5\n10,x\n": "row 3: t_mnm: 'x' is not a number",
    "frequency_hz,t_mnm\n1,5\n10,5\n10,5\n50,5\n": "has the point 10 Hz twice",
    "frequency_hz,t_mnm\n1,5\n10,5\n10,6\n10,7\n50,5\n": "more than two points at 10 Hz",
    "frequency_hz,t_mnm\n1,5\n1,6\n10,5\n": "begins or ends with a step",
    "frequency_hz,t_mnm\n1,5\n,6\n10,5\n": "row 3: frequency_hz: is empty",
    "frequency_hz,t_mnm\n1,5,3\n10,5,3\n": "row 2: has 3 cells, and the first line names 2 columns",
    "frequency_hz,t\n1,5\n10,5\n": "column 't' has no unit",
    "frequency,t_mnm\n1,5\n10,5\n": "column 'frequency' has no unit; frequency_hz is expected",
    "frequency_s,t_mnm\n1,5\n10,5\n": "is not known",
    "Frequency [s],t_mnm\n1,5\n10,5\n": "is in s; a frequency in Hz or kHz is expected",
    "frequency_hz,Mz [N]\n1,5\n10,5\n": "is in N; a torque, in N m",
    "frequency_hz,fx_nm\n1,5\n10,5\n": "is in nm; a force, in N",
    "frequency_hz,t_mnm,t_nm\n1,5,5\n10,5,5\n": "are of the same; leave one of them out",
    "frequency_hz,mq_nm\n1,5\n10,5\n": "column 'mq_nm' is not known",
    "frequency_hz\n1\n10\n": "has no column of amplitudes",
    "t_mnm\n1\n10\n": "has no column of frequencies",
}


@pytest.mark.parametrize("text", BAD)
def test_what_is_no_limit_is_refused_in_one_sentence(tmp_path, text):
    with pytest.raises(mv.OptionError) as found:
        read_limit(write(tmp_path, text))
    assert BAD[text] in str(found.value)
    assert str(found.value).startswith("limit: ")
    assert "\n" not in str(found.value)


def test_files_are_opened_by_the_one_door_and_numbers_are_not_files(tmp_path):
    name = write(tmp_path, "frequency_hz,t_mnm\n1,5\n100,50\n")
    assert given_limit(name, "2:50 Hz").curve.low == 2.0
    with pytest.raises(mv.ScenarioError, match="names a file"):
        given_limit(name, None, NO_FILES)
    assert given_limit("10 mN*m", "0.5:5 Hz", NO_FILES) == Limit("10 mN*m", "0.5 Hz", "5 Hz")
    with pytest.raises(mv.OptionError, match="band: 200 to 300 Hz has no part of the limit"):
        given_limit(name, "200:300 Hz")
    with pytest.raises(mv.OptionError, match="cannot be read"):
        given_limit(str(tmp_path / "none.csv"))


# Loads


def test_a_load_that_the_run_lacks_is_not_judged_and_said_so(motion_1, state_1):
    table = mv.find_lines(motion_1)
    loose = LimitCurve.flat(10.0, 1.0, 100.0)
    limit = Limit.of_curves(loose, {"Fx": loose})
    judged = judge(table, limit, state_1)
    assert judged.verdict == "not judged"
    assert "Limit of Fx" in str(judged)
    assert "not judged: no load of this name is known of the run" in str(judged)
    axis = state_1.array.drive_axis
    alone = judge(table, Limit.of_curves(None, {f"M{axis}": loose}), state_1)
    assert alone.verdict == "pass"  # on a fixed base that is the torque about the drive axis
    strict = LimitCurve.flat(1e-4, 1.0, 100.0)
    assert judge(table, Limit.of_curves(loose, {f"M{axis}": strict}), state_1).verdict == "fail"


def test_judgements_of_one_number_read_as_before():
    told = judge(lines_of(line_at(20.0, 0.005)), limit_of(0.01, 1.0, 100.0))
    assert isinstance(told, Judgement)
    assert (
        str(told)
        == "Limit 10 mN m from 1 to 100 Hz: pass; smallest margin +6.0 dB, factor 2 (drive_1)."
    )


def test_no_record_passes_a_notch_at_a_line_that_the_drive_has(state_1):
    """Records that are short, slow or begin at rest, against curves with a notch at a line of the whole
    motion, just below it: none of them may pass."""
    random = np.random.default_rng(5)
    whole = mv.find_lines(state_1.with_({"record.sample_rate": "8192 Hz"}), start="steady")
    lines = [x for x in whole if x.seen and x.amplitude > 2e-5 and 0.5 < x.place < 1500.0]
    told = {"pass": 0, "not judged": 0, "fail": 0}
    for changes in (
        {"record.duration": "2 s", "record.settle": "3 s"},
        {"record.duration": "4 s", "record.sample_rate": "256 Hz", "record.settle": "20 s"},
        {"record.duration": "8 s", "record.settle": "30 s"},
    ):
        changed = state_1.with_(changes)
        table = mv.find_lines(mv.simulate(changed, channels=("T_d",)))
        table = replace(table, own_error=1e-3, find_error=None)
        for line in random.choice(np.array(lines, dtype=object), 12, replace=False):
            f, width = line.place, 10.0 ** random.uniform(-5.0, -2.0)
            low = 0.9 * line.amplitude
            low_end, high_end = f * (1.0 - random.uniform(0.1, 0.9) * width), f * (1.0 + width)
            notch = curve_of(
                (0.1, 1.0), (low_end, 1.0), (low_end, low), (high_end, low), (high_end, 1.0), (2e3, 1.0)
            )  # fmt: skip
            found = judge(table, Limit.of_curves(notch), changed).verdict
            told[found] += 1
            assert found != "pass", (changes, line.name, f, width)
        far = curve_of((0.1, 10.0), (2e3, 10.0))
        told[judge(table, Limit.of_curves(far), changed).verdict] += 1
    assert told["fail"]


def test_a_limit_whose_unit_is_a_slip_is_refused():
    with pytest.raises(
        mv.OptionError, match=r"limit: 1\.5e\+07 N\*m is not allowed; at most 100000 N\*m"
    ):
        mv.Limit("15 MN*m")


@pytest.mark.parametrize("heading", ["t_MNm", "T_MNm", "T [MN m]", "Mz [MN m]", "Fx [MN]"])
def test_a_curve_in_mega_is_refused_as_one_number_is(heading):
    with pytest.raises(mv.OptionError, match=r"4e\+07 N.* is not allowed; at most 100000 N"):
        limit_from_text(f"frequency_hz,{heading}\n0.5,40\n400,40\n")


def test_a_number_has_no_underscores():
    with pytest.raises(mv.OptionError, match="'4_0' is not a number"):
        limit_from_text("frequency_hz,t_mnm\n0.5,4_0\n400,40\n")
