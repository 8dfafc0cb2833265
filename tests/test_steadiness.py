"""Recordings that are not steady pass nothing that is larger than their lines; those that are stay judged."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from support import craft as whole
from support.craft_scenarios import scenario_of
from support.scenarios import limit_of
from support.tiers import sweep

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.lines import recording_warnings
from microvib.analysis.steadiness import may_be_larger
from microvib.io.recordings import Prepared
from microvib.io.scenario_file import load_bench
from microvib.reports.comparison import verdict_sentence
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_fit import estimate_lines
from microvib.signals.unaccounted import excesses
from microvib.studies.budget.files import Requirements
from microvib.studies.budget.study import pointing_budget
from microvib.studies.compare import compare
from microvib.studies.measure import measure
from microvib.studies.recording_limits import judge_recording
from microvib.testdata.bench_parts import Resonance
from microvib.testdata.force_table import ForceTable
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import Si

FS = 1024.0
Change = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _noise(x: np.ndarray) -> np.ndarray:
    """What a table reads while nothing runs."""
    return 1e-3 * np.std(x) * np.random.default_rng(1).standard_normal(x.size)


def _on_from(part: float) -> Change:
    return lambda t, x: np.where(t >= part * t[-1], x, 0.0) + _noise(x)


def _on_until(part: float) -> Change:
    return lambda t, x: np.where(t < part * t[-1], x, 0.0) + _noise(x)


def _ripple(part: float, frequency: float) -> Change:
    """The rate goes up and down by a part of it."""

    def changed(t: np.ndarray, x: np.ndarray) -> np.ndarray:
        late = part / (2.0 * np.pi * frequency) * np.sin(2.0 * np.pi * frequency * t)
        return np.asarray(CubicSpline(t, x)(np.clip(t + late, t[0], t[-1]))) + _noise(x)

    return changed


def _bursts(part: float, frequency: float) -> Change:
    return lambda t, x: np.where((t * frequency) % 1.0 < part, x, 0.0) + _noise(x)


def _modulated(part: float, frequency: float) -> Change:
    return lambda t, x: x * (1.0 + part * np.cos(2.0 * np.pi * frequency * t)) + _noise(x)


UNSTEADY = {
    "on in the last 30 %": _on_from(0.7),
    "on in the last 25 %": _on_from(0.75),
    "on in the first 30 %": _on_until(0.3),
    "on in the last 90 %": _on_from(0.1),
    "rate ripple": _ripple(0.01, 0.5),
    "slow rate ripple": _ripple(0.002, 0.2),
    "on and off": _bursts(0.5, 0.7),
    "on for a fifth of each second": _bursts(0.2, 1.0),
    "90 % up and down": _modulated(0.9, 0.7),
    "grows": lambda t, x: x * (0.2 + 1.6 * t / t[-1]) + _noise(x),
}
MOST_DIFFERENT = ("on in the last 30 %", "slow rate ripple", "on for a fifth of each second")
"""Part of the record, a frequency that wanders, bursts shorter than the pieces."""


@pytest.fixture(scope="module")
def scenario() -> mv.Scenario:
    return mv.load_scenario("state-1").with_(
        {"record.settle": "30 s", "record.duration": "16 s", "record.sample_rate": "1024 Hz"}
    )


@pytest.fixture(scope="module")
def torque(scenario: mv.Scenario) -> np.ndarray:
    return np.array(mv.simulate(scenario, channels=("T_d",))["T_d"])


def recorded(x: np.ndarray) -> Recording:
    return Recording({"Mz": x}, FS, {"Mz": "N*m"}, "table")


@pytest.mark.parametrize("name", sweep(UNSTEADY, *MOST_DIFFERENT))
def test_no_limit_below_the_torque_of_the_running_drive_is_passed(
    name: str, torque: np.ndarray, scenario: mv.Scenario
) -> None:
    t = np.arange(torque.size) / FS
    running = mv.find_lines(recorded(torque + _noise(torque)), scenario=scenario)[
        "drive_1"
    ].amplitude
    table = mv.find_lines(recorded(UNSTEADY[name](t, torque)), scenario=scenario)
    for part in (0.3, 0.5, 0.7, 0.9):
        assert judge(table, limit_of(part * running, 40.0, 60.0), scenario).verdict != "pass"


@pytest.mark.parametrize("part", [0.29, 0.4])
def test_a_drive_that_runs_on_and_off_with_its_electrical_periods_is_as_large_as_while_it_runs(
    part: float, scenario: mv.Scenario
) -> None:
    """Eight times in the record, once in eight full steps: its lines are all at fractions of the clock."""
    rate = 53.01333 / 16.0 / 8.0
    longer = scenario.with_({"record.settle": "120 s", "record.duration": f"{8.0 / rate} s"})
    whole = np.array(mv.simulate(longer, channels=("T_d",))["T_d"])
    t = np.arange(whole.size) / FS
    table = mv.find_lines(recorded(_bursts(part, rate)(t, whole)), scenario=scenario)
    running = mv.find_lines(recorded(whole + _noise(whole)), scenario=scenario)["drive_1"].amplitude
    assert table["drive_1"].amplitude < 0.5 * running
    for least in (0.5, 0.7, 0.9):
        assert judge(table, limit_of(least * running, 40.0, 65.0)).verdict == "not judged"


@pytest.mark.parametrize("frequency", [50.1, 99.97, 120.0])
@pytest.mark.parametrize("part", [0.15, 0.5])
def test_what_comes_and_goes_at_a_multiple_of_the_mains_is_no_line_of_theirs(
    frequency: float, part: float
) -> None:
    t = np.arange(30 * 1000) / 1000.0
    width = part * t[-1]
    loud = np.where(np.abs(t - 14.0) < 0.5 * width, np.cos(np.pi * (t - 14.0) / width) ** 2, 0.0)
    x = 0.01 * loud * np.cos(2.0 * np.pi * frequency * t + 1.0)
    x += 1e-6 * np.random.default_rng(3).standard_normal(t.size)
    limit = mv.Limit("8 mN*m", "20 Hz", "300 Hz")
    table = mv.Recording({"Mz": x}, 1000.0, {"Mz": "N*m"}, "burst")
    assert judge_recording(table, limit).verdict != "pass"


@pytest.mark.parametrize(
    ("frequency", "periods", "duration"),
    [(0.87, 3.5, 8.0), (1.66, 5.5, 16.0), (2.2, 4.0, 16.0), (3.86, 8.6, 16.0), (2.58, 19.0, 30.0)],
)
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
def test_a_short_burst_at_a_low_frequency_is_no_smaller_than_its_height(
    frequency: float, periods: float, duration: float, phase: float
) -> None:
    """No band of a third of an octave is resolved within it, and lines beside one another may make it up."""
    t = np.arange(round(duration * 200)) / 200.0
    width = periods / frequency
    part = np.abs(t - 0.55 * duration) < 0.5 * width
    loud = np.where(part, np.cos(np.pi * (t - 0.55 * duration) / width) ** 2, 0.0)
    x = 0.01 * loud * np.cos(2.0 * np.pi * frequency * t + phase)
    x += 1e-6 * np.random.default_rng(3).standard_normal(t.size)
    limit = mv.Limit("8.5 mN*m", f"{6.1 / duration} Hz", "60 Hz")
    table = mv.Recording({"Mz": x}, 200.0, {"Mz": "N*m"}, "burst")
    assert judge_recording(table, limit).verdict == "not judged"


GROWN = 20e-3


def _growing(frequency: float, after: float, phase: float) -> Recording:
    """A tone that grows e-fold in a time ``after`` [s] up to the end of a record, beside a line and noise."""
    t = np.arange(16 * int(FS)) / FS
    x = GROWN * np.cos(2.0 * np.pi * frequency * t + phase) * np.exp((t - t[-1]) / after)
    x += 4e-3 * np.cos(2.0 * np.pi * 50.3 * t)
    x += 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    return Recording({"Mz": x}, FS, {"Mz": "N*m"}, "growing")


@pytest.mark.parametrize("phase", [0.3, 1.7, 3.0])
@pytest.mark.parametrize(("frequency", "after"), [(1.2, 2.0), (2.3, 1.0), (5.1, 0.5), (13.0, 0.5)])
@pytest.mark.parametrize("reversed_in_time", [False, True])
def test_what_grows_up_to_the_end_of_a_record_is_as_large_as_it_is_there(
    frequency: float, after: float, phase: float, reversed_in_time: bool
) -> None:
    """It may be the beginning of an instability, and the window of a spectrum sees none of it there."""
    recording = _growing(frequency, after, phase)
    if reversed_in_time:
        recording = replace(recording, channels={"Mz": recording["Mz"][::-1]})
    table = mv.find_lines(recording)
    assert judge(table, limit_of(0.95 * GROWN, 0.5, 350.0)).verdict == "not judged"
    if not any(line.status == "growing" for line in table):  # such a line passes nothing
        assert judge(table, limit_of(5.0 * GROWN, 0.5, 350.0)).verdict == "pass"


@pytest.mark.parametrize(
    ("frequency", "periods", "part"), [(1.41, 4.6, 0.65), (3.3, 4.0, 0.8), (9.7, 6.0, 0.9)]
)
def test_bursts_of_a_few_periods_are_no_smaller_than_their_height(
    frequency: float, periods: float, part: float
) -> None:
    t = np.arange(32 * int(FS)) / FS
    on = (t * frequency * part / periods) % 1.0 < part
    x = GROWN * np.where(on, np.cos(2.0 * np.pi * frequency * t + 1.0), 0.0)
    x += 4e-3 * np.cos(2.0 * np.pi * 50.3 * t)
    x += 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    table = mv.find_lines(Recording({"Mz": x}, FS, {"Mz": "N*m"}, "bursts"))
    assert judge(table, limit_of(0.95 * GROWN, 0.5, 350.0)).verdict == "not judged"


@pytest.mark.parametrize(("start", "part"), [(0.3, 0.3), (0.36, 0.3), (0.4, 0.3), (0.44, 0.43)])
def test_a_tone_that_is_parted_into_lines_beside_each_other_is_as_large_as_all_of_them(
    start: float, part: float
) -> None:
    """A tone of 1 N m that is there for a part of the record, near the mains."""
    f, rate, duration = 49.5, 512.0, 2.16
    t = np.arange(round(duration * rate)) / rate
    on = (t >= start * duration) & (t < (start + part) * duration)
    noise = 1e-4 * np.random.default_rng(3).standard_normal(t.size)
    x = on * np.cos(2.0 * np.pi * f * t + 1.0) + noise
    recorded = Recording({"Mz": x}, rate, {"Mz": "N*m"})
    limit = mv.Limit("0.8 N*m", f"{0.9 * f} Hz", f"{1.25 * f} Hz")
    assert judge_recording(recorded, limit).verdict == "not judged"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["two heights", "falls"])
def test_noise_that_may_hide_that_a_line_is_larger_for_a_time_lets_nothing_below_that_pass(
    kind: str, seed: int
) -> None:
    """A tone of 10 mN m for 57 % of the time and of 4.8 in the rest, or one that falls, in noise of 20."""
    rng = np.random.default_rng(seed)
    rate, duration, f = (512.0, 9.48, 7.95) if kind == "two heights" else (512.0, 20.0, 40.0)
    t = np.arange(round(rate * duration)) / rate
    if kind == "two heights":
        height = np.where((t / duration * 1.5038) % 1.0 < 0.4287, 1.0, 0.48)
    else:
        height = np.exp(-2.0 * t / duration)
    x = 0.01 * (
        height * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.0)) + 2.0 * rng.normal(size=t.size)
    )
    limit = mv.Limit("7 mN*m", f"{0.6 * f} Hz", f"{2.0 * f} Hz")
    judged = judge_recording(Recording({"Mz": x}, rate, {"Mz": "N*m"}), limit)
    assert judged.verdict == "not judged"


def test_a_steady_line_in_noise_stays_judged() -> None:
    """With as much noise as lines can have; a limit that noise could reach in a piece is not judged."""
    rng = np.random.default_rng(5)
    t = np.arange(round(20.0 * 512.0)) / 512.0
    verdicts = []
    for _ in range(20):
        x = np.cos(2.0 * np.pi * rng.uniform(30.0, 50.0) * t) + 2.0 * rng.normal(size=t.size)
        recording = Recording({"Mz": x}, 512.0, {"Mz": "N*m"})
        verdicts.append(judge_recording(recording, mv.Limit("1.5 N*m", "20 Hz", "60 Hz")).verdict)
    assert verdicts.count("pass") >= 18


def test_a_line_that_is_larger_for_a_time_is_as_large_as_it_is_then() -> None:
    t = np.arange(round(20.0 * 512.0)) / 512.0
    x = np.where(t < 7.0, 1.3, 1.0) * np.cos(2.0 * np.pi * 41.37 * t + 1.0)
    x += 1e-3 * np.random.default_rng(3).normal(size=t.size)
    table = mv.find_lines(Recording({"Mz": x}, 512.0, {"Mz": "N*m"}))
    [larger] = [one for one in table.excess if not one.certain]
    assert larger.start + 0.5 * (larger.stop - larger.start) < 7.0
    assert np.sqrt(2.0) * larger.level == pytest.approx(1.3, rel=2e-3)


def test_two_tones_that_a_record_parts_are_judged_by_what_they_are_together() -> None:
    """As close as three bins, they may be one that comes and goes: nothing passes below their sum."""
    t = np.arange(round(10.0 * FS)) / FS
    tones = 0.5 * np.cos(2.0 * np.pi * 40.0 * t) + 0.4 * np.cos(2.0 * np.pi * 40.3 * t)
    noise = 1e-3 * np.random.default_rng(4).standard_normal(t.size)
    recorded = Recording({"Mz": tones + noise}, FS, {"Mz": "N*m"})
    verdicts = {
        limit: judge_recording(recorded, mv.Limit(f"{limit} N*m", "35 Hz", "45 Hz")).verdict
        for limit in (0.45, 0.6, 0.85, 1.0)
    }
    assert verdicts == {0.45: "fail", 0.6: "not judged", 0.85: "not judged", 1.0: "pass"}


def test_the_mains_beside_a_line_of_the_drive_are_a_line_of_their_own() -> None:
    t = np.arange(16 * 1000) / 1000.0
    x = 0.01 * np.cos(2.0 * np.pi * 53.0 * t) + 0.006 * np.cos(2.0 * np.pi * 50.0 * t + 1.0)
    x += 1e-5 * np.random.default_rng(3).standard_normal(t.size)
    table = mv.Recording({"Mz": x}, 1000.0, {"Mz": "N*m"}, "mains")
    limit = mv.Limit("10.5 mN*m", "20 Hz", "300 Hz")
    assert judge_recording(table, limit).verdict == "pass"


def test_a_steady_recording_stays_judged(torque: np.ndarray, scenario: mv.Scenario) -> None:
    recording = recorded(torque + _noise(torque))
    table = mv.find_lines(recording, scenario=scenario)
    size = table["drive_1"].amplitude
    assert judge(table, limit_of(1.05 * size, 40.0, 60.0), scenario).verdict == "pass"
    assert judge(table, limit_of(0.95 * size, 40.0, 60.0), scenario).verdict == "fail"
    assert not any(
        "steady" in note for note in recording_warnings(recording, "Mz", scenario, table)
    )


@pytest.mark.parametrize(
    "name", sorted(UNSTEADY.keys() - {"on in the last 90 %"})
)  # lines a tenth off
def test_what_is_not_steady_is_said_beside_the_lines(
    name: str, torque: np.ndarray, scenario: mv.Scenario
) -> None:
    """Also where the lines are so smeared that none of them stands out."""
    recording = recorded(UNSTEADY[name](np.arange(torque.size) / FS, torque))
    table = mv.find_lines(recording, scenario=scenario)
    told = list(recording_warnings(recording, "Mz", scenario, table))
    assert any("not steady" in note or "significant lines account for" in note for note in told), (
        told
    )


def test_a_recording_of_the_bench_stays_judged() -> None:
    """With noise, drift and pick-up of the mains, and a mode that rings."""
    scenario = mv.load_scenario("state-1")
    recording = measure(scenario, load_bench("force-table"))
    table = mv.find_lines(recording, "Mz", scenario=scenario)
    size = table["drive_1"].amplitude
    assert judge(table, limit_of(1.1 * size, 5.0, 150.0), scenario).verdict == "pass"
    whole = judge(table, limit_of(1.1 * size, 5.0, 1000.0), scenario)
    assert whole.verdict == "not judged"
    assert any("the table's resonance" in gap for gap in whole.gaps)
    without = replace(recording, table=None)
    table = mv.find_lines(without, "Mz", scenario=scenario)
    assert judge(table, limit_of(1.1 * size, 5.0, 1000.0), scenario).verdict == "pass"
    assert not any(
        "steady" in note for note in recording_warnings(recording, "Mz", scenario, table)
    )


def test_the_reason_says_when_and_where_and_trimming_helps(
    torque: np.ndarray, scenario: mv.Scenario
) -> None:
    whole = recorded(UNSTEADY["on in the last 30 %"](np.arange(torque.size) / FS, torque))
    table = mv.find_lines(whole, scenario=scenario)
    (why,) = may_be_larger(table, LimitCurve.flat(0.5 * np.std(torque), 45.0, 58.0))
    assert "between 11.1 and 16 s" in why
    assert "start and stop in the preparation file" in why
    size = mv.find_lines(recorded(torque), scenario=scenario)["drive_1"].amplitude
    kept = mv.find_lines(Preparation(start="11.5 s").apply(whole), scenario=scenario)
    assert judge(kept, limit_of(1.1 * size, 52.0, 54.0), scenario).verdict == "pass"


@pytest.mark.parametrize("name", ["rate ripple", "on and off", "90 % up and down"])
def test_lines_of_what_is_not_steady_are_not_compared(
    name: str, torque: np.ndarray, scenario: mv.Scenario
) -> None:
    steady = Prepared(recorded(torque + _noise(torque)))
    changed = Prepared(recorded(UNSTEADY[name](np.arange(torque.size) / FS, torque)))
    rows = {row.line: row.verdict for row in compare(steady, changed, scenario=scenario).rows}
    assert rows["drive_1"] == "not judged"
    told = verdict_sentence(compare(steady, changed, scenario=scenario).rows)
    assert re.search(r"in records or bands that are not steady \([^)]*drive_1", told)
    same = {row.line: row.verdict for row in compare(steady, steady, scenario=scenario).rows}
    assert same["drive_1"] == "agrees"


@pytest.mark.parametrize("name", UNSTEADY)
def test_lines_floor_and_excess_are_no_less_than_the_samples(name: str) -> None:
    """In every band and piece: of a line alone, whose loudest piece is known."""
    t = np.arange(16384) / FS
    line = 0.1 * np.cos(2.0 * np.pi * 53.0 * t)
    x = UNSTEADY[name](t, line)
    table = estimate_lines(x, FS, ())
    seen = [one for one in table if one.seen][:1]
    found = max(
        (one.amplitude for one in excesses(x, FS, seen, table) if one.low < 53.0 < one.high),
        default=0.0,
    )
    ends = (
        one.amplitude_at_start(table.duration) * np.exp(-one.decay * t[[0, -1]]) for one in seen
    )
    counted = max((max(x) for x in ends), default=0.0)
    # Of a fifth of a second the shortest piece that a third of an octave at 53 Hz resolves, half a second, shows three quarters.
    loudest = 0.1 * {
        "90 % up and down": 1.8,
        "grows": 1.7,
        "on for a fifth of each second": 0.7,
    }.get(name, 0.97)
    assert np.hypot(counted, found) >= loudest


def _lost(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    kept = np.ones(x.size)
    for first in rng.integers(0, x.size - 10, x.size // 60).tolist():
        kept[first : first + 8] = 0.0
    return kept * x


def _of_random_gain(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    blocks = rng.choice([1.0, 0.3], x.size // 16 + 1, p=[0.7, 0.3])
    return np.repeat(blocks, 16)[: x.size] * x


def _sent_twice(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    found = x.copy()
    for k in rng.integers(1, x.size // 16, x.size // 60).tolist():
        found[16 * k : 16 * k + 16] = found[16 * k - 16 : 16 * k]
    return found


@pytest.mark.parametrize("fault", [_lost, _of_random_gain, _sent_twice])
@pytest.mark.parametrize("noise", [1e-3, 0.05])
def test_nothing_passes_below_a_torque_of_which_samples_are_lost_or_repeated(
    torque: np.ndarray, scenario: mv.Scenario, fault: Callable[..., np.ndarray], noise: float
) -> None:
    rng = np.random.default_rng(5)
    whole_torque = max(line.amplitude for line in estimate_lines(torque, FS, ()) if line.seen)
    x = fault(torque, rng) + noise * np.std(torque) * rng.standard_normal(torque.size)
    for guide in (scenario, None):
        limit = mv.Limit(Si(0.97 * whole_torque), "2 Hz", "300 Hz")
        try:
            verdict = judge_recording(recorded(x), limit, scenario=guide).verdict
        except RecordingError:
            verdict = "refused"
        assert verdict != "pass"


@pytest.mark.parametrize("seed", sweep(range(20), *range(5)))
def test_noise_has_no_excess(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(16384)
    assert excesses(x, FS, ()) == ()
    t = np.arange(x.size) / FS
    y = 0.1 * x + np.cos(2.0 * np.pi * 53.01 * t + 1.0)
    table = estimate_lines(y, FS, ())
    assert excesses(y, FS, [one for one in table if one.seen], table) == ()


@pytest.mark.parametrize(
    "ends",
    [
        *((20.0, 45.0), (10.0, 60.0), (60.0, 10.0), (24.0, 30.0), (0.5, 3.0)),
        *((1.0, 1.2), (0.9, 1.3), (1.4, 1.8), (2.0, 3.0)),
    ],
)
@pytest.mark.parametrize("noise", [1e-3, 0.05])
def test_a_tone_that_sweeps_through_a_band_is_no_floor(
    ends: tuple[float, float], noise: float
) -> None:
    """A tone of amplitude 1 passes a band once, or goes through one during the whole record: in every
    band that it crosses within the record in 2 s or more it is told with most of its size.
    """
    t, (first, last) = np.arange(16384) / FS, ends
    phase = 2.0 * np.pi * (first * t + 0.5 * (last - first) * t**2 / 16.0)
    x = np.cos(phase) + noise * np.random.default_rng(1).standard_normal(t.size)
    rate, (low, high) = abs(last - first) / 16.0, sorted(ends)
    found = {(one.low, one.high): one.amplitude for one in excesses(x, FS, ())}
    edges = np.array([*(3.0 / 8.0 + 0.5 * k for k in range(5)), 2.375 * 2.0 ** (1.0 / 3.0)])
    while edges[-1] < 60.0:
        edges = np.append(edges, max(edges[-1] + 0.5, edges[-1] * 2.0 ** (1.0 / 3.0)))
    crossed = 0
    for a, b in pairwise(edges.tolist()):
        within = a > low and b < high and b - a > 2.0 * rate
        if not within and not a < low < high < b:
            continue
        crossed += 1
        (size,) = (size for (f, g), size in found.items() if f < 0.5 * (a + b) < g)
        assert size >= 0.7
    assert crossed >= 1


@pytest.mark.parametrize(
    ("middle", "duration"), [(0.6, 16.0), *((f, T) for f in (1.1, 1.6, 2.5) for T in (8.0, 16.0))]
)
def test_a_tone_that_goes_to_and_fro_at_low_frequencies_is_no_floor(
    middle: float, duration: float
) -> None:
    """A tone of amplitude 1 by a fifth of its frequency to either side every five seconds, which fills
    the bins of all pieces; noise whose density falls with the frequency remains a floor.
    """
    t = np.arange(round(duration * FS)) / FS
    noise = np.random.default_rng(2).standard_normal(t.size)
    phase = 2.0 * np.pi * middle * t + middle * np.sin(2.0 * np.pi * t / 5.0)
    found = excesses(np.cos(phase) + 1e-3 * noise, FS, ())
    inside = [one.amplitude for one in found if one.high > 0.8 * middle and one.low < 1.2 * middle]
    assert np.hypot.reduce(inside) >= 0.7
    f = np.fft.rfftfreq(t.size, 1.0 / FS)
    pink = np.fft.irfft(np.fft.rfft(noise) / np.sqrt(np.maximum(f, f[1])), t.size)
    assert excesses(pink, FS, ()) == ()


def test_excess_is_that_of_the_part_that_is_loud() -> None:
    t = np.arange(16384) / FS
    x = np.where(t < 4.0, 1.0, 0.1) * np.cos(2.0 * np.pi * 53.0 * t) + 1e-3 * np.random.default_rng(
        1
    ).standard_normal(t.size)
    (one,) = (each for each in excesses(x, FS, ()) if each.low < 53.0 < each.high)
    assert one.amplitude == pytest.approx(1.0, rel=0.02)
    assert one.times == pytest.approx(10.0, rel=0.05)
    assert one.start == 0.0
    assert one.stop == pytest.approx(4.0, abs=0.5)
    assert replace(one, times=1.0).sentence() != one.sentence()


@pytest.fixture(scope="module")
def craft() -> mv.Scenario:
    full = whole.FullCraft(damping=np.full(4, 0.05), bandwidth=0.1)
    return scenario_of(full, **{"record.settle": Si(20.0), "record.duration": Si(16.0)})


@pytest.fixture(scope="module")
def loads(craft: mv.Scenario) -> dict[str, np.ndarray]:
    ground = mv.simulate(craft.model_copy(update={"spacecraft": None}))
    return {name: np.array(ground[name]) for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")}


def on_a_table(loads: dict[str, np.ndarray]) -> Recording:
    return Recording(loads, FS, {name: "N" if name[0] == "F" else "N*m" for name in loads}, "table")


JITTER = {"axis": "x", "lowest": "10 Hz", "highest": "60 Hz", "limit": "1 urad"}


@pytest.fixture(scope="module")
def running(craft: mv.Scenario, loads: dict[str, np.ndarray]) -> float:
    """Jitter of the drive that runs all the time [rad]."""
    one = Requirements(requirements=[JITTER])
    return pointing_budget(craft, one, recording=on_a_table(loads)).judged[0].value


@pytest.mark.parametrize("name", sweep(UNSTEADY, *MOST_DIFFERENT))
def test_no_budget_below_the_jitter_of_the_running_drive_is_passed(
    name: str, craft: mv.Scenario, loads: dict[str, np.ndarray], running: float
) -> None:
    t = np.arange(next(iter(loads.values())).size) / FS
    changed = on_a_table({n: UNSTEADY[name](t, x) for n, x in loads.items()})
    parts = (0.1, 0.3, 0.5, 0.7, 0.9)
    several = Requirements(
        requirements=[{**JITTER, "limit": f"{part * running} rad"} for part in parts]
    )
    found = pointing_budget(craft, several, recording=changed).judged
    assert all(judged.verdict != "pass" for judged in found)
    # Of the drive that runs for a fifth of a second the shortest pieces show two thirds; parts that are loud show all of it.
    assert found[0].most >= (0.6 if "fifth" in name else 1.0) * running


def test_a_steady_recording_is_judged_against_a_budget(
    craft: mv.Scenario, loads: dict[str, np.ndarray]
) -> None:
    band = {"axis": "x", "lowest": "10 Hz", "highest": "60 Hz", "limit": "1 urad"}
    recording = on_a_table({name: x + _noise(x) for name, x in loads.items()})
    value = (
        pointing_budget(craft, Requirements(requirements=[band]), recording=recording)
        .judged[0]
        .value
    )
    limits = {1.5 * value: "pass", 0.5 * value: "fail"}
    several = Requirements(requirements=[{**band, "limit": f"{limit} rad"} for limit in limits])
    found = pointing_budget(craft, several, recording=recording).judged
    assert [one.verdict for one in found] == list(limits.values())


def test_a_budget_judges_nothing_that_the_force_table_does_not_show(
    craft: mv.Scenario, loads: dict[str, np.ndarray]
) -> None:
    """Usable beyond the band it is judged; with an end in it, or a resonance of a force, it is not."""
    band = {"axis": "x", "lowest": "10 Hz", "highest": "60 Hz", "limit": "1 rad"}
    recording = on_a_table({name: x + _noise(x) for name, x in loads.items()})
    verdicts = {}
    for name, table in {
        "usable": ForceTable("table", usable=(5.0, 100.0)),
        "cut": ForceTable("table", usable=(5.0, 50.0)),
        "resonance": ForceTable(
            "table",
            (Resonance(component="Fy", frequency="200 Hz", damping="1 percent"),),
            usable=(5.0, 100.0),
        ),
    }.items():
        asked = Requirements(requirements=[band])
        found = pointing_budget(craft, asked, recording=replace(recording, table=table))
        verdicts[name] = found.judged[0].verdict
    assert verdicts == {"usable": "pass", "cut": "not judged", "resonance": "not judged"}
