"""Two tests of one drive: hints where a unit, a sign, an order of samples or an axis explains the difference, and what
stands in a background is not the drive's.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.tiers import sweep

import microvib as mv
from microvib.io.recordings import Prepared
from microvib.io.scenario_file import load_bench
from microvib.signals.line_table import IN_BACKGROUND
from microvib.studies.analyse import analyse
from microvib.studies.compare import misread
from microvib.studies.measure import measure
from microvib.studies.misreading import (
    ShownLine,
    common_scale,
    consensus,
    lacking_lines,
    unit_of_lacking,
)
from microvib.testdata.bench import measure as bench_measure
from microvib.testdata.recording import Recording

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def tests():
    """The drive on one bench on two days, without what is known of the table, as files have it."""
    scenario, bench = mv.load_scenario("state-1"), load_bench("force-table")
    later = scenario.with_({"record.settle": "41.3 s"})
    both = [measure(one, bench, seed=k) for k, one in enumerate((scenario, later), 1)]
    return scenario, *(replace(one, table=None, title=f"day {k}") for k, one in enumerate(both, 1))


@pytest.fixture(scope="module")
def off() -> Recording:
    bench = load_bench("force-table")
    n = math.ceil(bench.span * bench.analog_rate)
    return replace(bench_measure(bench, np.zeros((6, n)), np.zeros(n), seed=7), table=None)


def with_tones(recording: Recording, tones) -> Recording:
    t = np.arange(recording.samples) / recording.sample_rate
    more = sum(a * np.cos(2.0 * np.pi * f * t + 1.0) for f, a in tones)
    return replace(recording, channels={**recording.channels, "Mz": recording["Mz"] + more})


def times(recording: Recording, factor: float) -> Recording:
    return replace(recording, channels={**recording.channels, "Mz": factor * recording["Mz"]})


def swapped(recording: Recording, other: str) -> Recording:
    x = recording.channels
    return replace(recording, channels={**x, other: x["Mz"], "Mz": x[other]})


def hints(a, b, scenario=None) -> str:
    return " ".join(misread(*mv.compare(a, b, scenario=scenario)))


def test_two_tests_that_are_alike_have_no_hint(tests):
    scenario, a, b = tests
    assert hints(a, b, scenario) == hints(a, b) == ""


@pytest.mark.parametrize("factor", sweep([1e3, 1e-3], 1e3))
def test_a_factor_of_a_thousand_is_told(tests, factor):
    scenario, a, b = tests
    for guide in (scenario, None):
        assert "by 1000" in hints(a, times(b, factor), guide)
        assert "mN*m" in hints(times(a, factor), b, guide)


def test_a_sign_is_told_and_so_is_a_sign_with_a_unit(tests):
    scenario, a, b = tests
    assert "A with its sign reversed would be like B: check" in hints(a, times(b, -1.0), scenario)
    both = hints(a, times(b, -1e3), scenario)
    assert "with its sign reversed and multiplied by 1000" in both


def test_samples_in_reverse_order_are_told(tests):
    scenario, a, b = tests
    back = replace(b, channels={name: x[::-1] for name, x in b.channels.items()})
    assert "with its time reversed" in hints(a, back, scenario)


@pytest.mark.parametrize("other", sweep(["Mx", "My"], "My"))
def test_swapped_axes_are_told(tests, other):
    scenario, a, b = tests
    for guide in (scenario, None):
        assert f"{other} of B has the lines of Mz of A" in hints(a, swapped(b, other), guide)
        assert f"{other} of A has the lines of Mz of B" in hints(swapped(a, other), b, guide)
    assert "by 1000, as in mN*m taken for N*m" in hints(a, swapped(times(b, 1e3), other), scenario)


@pytest.fixture(scope="module")
def on_soft_table(tests) -> Recording:
    """The drive on a table with a resonance amid its lines: three lines in five are off by more than 25 %."""
    scenario, *_ = tests
    bench = load_bench(str(ROOT / "examples" / "acceptance" / "bench.yaml"))
    return replace(measure(scenario, bench, seed=5), table=None, title="soft table")


def test_a_resonance_of_a_table_is_no_factor_no_sign_and_no_axis(tests, on_soft_table):
    scenario, a, _ = tests
    assert hints(a, on_soft_table, scenario) == hints(on_soft_table, a, scenario) == ""
    assert hints(on_soft_table, scenario) == ""


@pytest.mark.parametrize("factor", [1e3, -1e-3])
def test_a_factor_is_told_beside_a_resonance_of_the_table(tests, on_soft_table, factor):
    scenario, a, _ = tests
    how = "with its sign reversed and " if factor < 0.0 else ""
    times_or_over = "divided" if abs(factor) > 1.0 else "multiplied"
    for other in (a, scenario):
        said = hints(times(on_soft_table, factor), other, scenario)
        assert f"A {how}{times_or_over} by 1000 would be like B, as in" in said
        assert "lines follow within 10 %: check" in said


@pytest.mark.release
def test_a_sign_and_an_axis_are_told_beside_a_resonance_of_the_table(tests, on_soft_table):
    scenario, a, _ = tests
    for other in (a, scenario):
        said = hints(times(on_soft_table, -1.0), other, scenario)
        assert said.startswith("A with its sign reversed would be like B: check")
    said = hints(swapped(times(on_soft_table, 1e-3), "My"), a, scenario)
    assert "My of A has the lines of Mz of B, multiplied by 1000, as in N*m taken for mN*m" in said


@pytest.mark.parametrize("part", [0.01, 1.0 / 30.0])
def test_an_axis_is_told_where_the_named_one_has_a_part_of_its_lines(tests, part):
    """Cross-talk: all lines are in the named channel at one scale, and as they are in another one."""
    scenario, a, b = tests
    x = b.channels
    leaking = replace(b, channels={**x, "Mx": x["Mz"], "Mz": part * x["Mz"]})
    for guide in (scenario, None):
        said = hints(a, leaking, guide)
        assert f"Mx of B has the lines of Mz of A, and its Mz has them at {part:.2f}" in said
        assert "divided" not in said
    assert "Mx" not in hints(a, replace(b, channels={**x, "Mx": 0.01 * x["Mz"]}), scenario)


def shown(*lines) -> list[ShownLine]:
    """Lines as (expected, amplitude, uncertainty); above the floor from seven uncertainties."""
    return [ShownLine(f"line_{k}", a, b, s, b > 7.0 * s) for k, (a, b, s) in enumerate(lines)]


def test_hidden_lines_vote_neither_for_nor_against_a_unit():
    seen, hidden = (1.0, 1.02e-3, 2e-5), (0.3, 6e-5, 2e-5)
    small = [(0.15, 4e-5, 2e-5), (1e-4, 4e-5, 2e-5)]  # at more than its size, and no main line
    lines = lacking_lines(shown(seen, hidden, *small))
    assert [x.name for x in lines] == ["line_0", "line_1", "line_2"]
    assert (
        unit_of_lacking(lines) == 0.0
    )  # 0.3 in the thousand is 15 uncertainties, and is not there
    lines = lacking_lines(shown(seen, (0.3, 2.6e-4, 2e-5), *small))
    assert unit_of_lacking(lines) == 0.0  # 0.15 is not there
    lines = lacking_lines(shown((1.0, 1.1e-3, 1e-4), (0.3, 5e-4, 1e-4), (0.15, 5e-5, 1e-4)))
    assert unit_of_lacking(lines) == pytest.approx(math.log(1e3))
    lines = lacking_lines(shown((1.0, 0.107, 4e-3), (0.3, 0.04, 1.2e-2)))
    assert lines
    assert unit_of_lacking(lines) == 0.0  # 8.85 and 9.81 fit both


def test_one_main_line_as_it_should_be_or_too_much_noise_lacks_nothing():
    small = [(1.0, 1e-3, 1e-5), (0.5, 5e-4, 1e-5)]
    assert lacking_lines(shown(*small))
    assert not lacking_lines(shown(*small, (0.2, 0.1, 1e-5)))
    assert lacking_lines(shown(*small, (0.05, 0.05, 1e-5)))  # may be another machine's
    assert not lacking_lines(shown((1.0, 0.1, 0.2), (0.5, 0.1, 0.2)))
    assert not lacking_lines([])


FREQUENCIES = [3.3, 6.7, *(53.3 * k + 3.3 * m for k in range(1, 9) for m in (-1, 0, 1))]


def resonant(frequencies, at: float, damping: float = 0.02):
    """Logarithms of the amplification of a resonance."""
    r = np.array(frequencies) / at
    return -0.5 * np.log((1.0 - r * r) ** 2 + (2.0 * damping * r) ** 2)


@pytest.mark.parametrize("at", [90.0, 160.0, 200.0, 310.0, 600.0])
@pytest.mark.parametrize("factor", [1e3, 1e-3, 100.0])
def test_a_factor_is_found_wherever_the_resonance_is(at, factor):
    """At 90 Hz lines above fall far below the factor, at 600 Hz none is off by more than double."""
    logs = resonant(FREQUENCIES, at)
    rng = np.random.default_rng(round(at))
    logs = logs + rng.normal(0.0, 0.01, logs.size) + math.log(factor)
    found = common_scale(list(zip(FREQUENCIES, logs, strict=True)))
    if at >= 160.0:
        assert found == pytest.approx(math.log(factor), abs=1e-12)
    else:  # two places alone follow it: no round factor is told then, but no other one either
        assert found == 0.0 or not any(
            math.isclose(found, math.log(f) * sign, abs_tol=1e-9)
            for f in (1e3, 1e6, 100.0)
            for sign in (1.0, -1.0)
        )


def test_one_resonant_line_hides_no_factor_and_makes_none():
    logs = np.zeros(len(FREQUENCIES))
    logs[5] = math.log(40.0)
    assert common_scale(list(zip(FREQUENCIES, logs, strict=True))) == 0.0
    found = common_scale(list(zip(FREQUENCIES, logs + math.log(1e3), strict=True)))
    assert found == pytest.approx(math.log(1e3), abs=1e-12)
    few = [
        (10.0, math.log(1e3)),
        (30.0, math.log(1e3)),
        (90.0, math.log(4e4)),
        (200.0, math.log(1e3)),
    ]
    assert common_scale(few) == pytest.approx(math.log(1e3), abs=1e-12)


def test_a_minority_of_lines_in_another_unit_is_no_factor_of_all():
    part = len(FREQUENCIES) // 3
    logs = np.zeros(len(FREQUENCIES))
    logs[:part] = math.log(1e3)
    assert common_scale(list(zip(FREQUENCIES, logs, strict=True))) == 0.0


@pytest.mark.parametrize("spread", [0.3, 0.7, 1.2, 2.0])
def test_no_factor_is_made_of_scatter(spread):
    """Lines that are off one by one: two drives that differ, or a model that is bad."""
    for seed in range(300):
        rng = np.random.default_rng(seed)
        logs = rng.normal(0.0, spread, len(FREQUENCIES))
        assert common_scale(list(zip(FREQUENCIES, logs, strict=True))) == 0.0


def test_no_unit_is_named_where_two_are_as_near():
    """8.85 lbf in and 9.81 kgf m (of a newton metre) are 10 % apart, which no scatter of 20 % parts."""
    logs = math.log(9.3) + np.array([-0.25, -0.12, 0.0, 0.13, 0.24])
    places = [10.0, 20.0, 40.0, 80.0, 160.0]
    found = common_scale(list(zip(places, logs, strict=True)))
    assert found == pytest.approx(float(np.median(logs)))


def test_a_line_and_its_sidebands_are_one_place():
    alike = [(100.0 + k, 0.7) for k in range(8)]
    others = [(3.0 * 2.0**k, 0.0) for k in range(4)]
    found = consensus([*alike, *others])
    assert found is not None
    assert (found.logarithm, found.lines, found.of, found.places) == (0.0, 4, 12, 4)
    assert not found.most
    assert consensus(alike) is None


def test_another_drive_has_no_hint_of_axes(tests):
    """Lines differ one by one: nothing explains them all."""
    scenario, a, _ = tests
    other = measure(
        scenario.with_({"reducer.stiffness": "4000 N*m/rad"}), load_bench("force-table")
    )
    assert "axes" not in hints(a, replace(other, table=None), scenario)


def test_what_stands_in_the_background_is_not_judged_as_the_drives(tests, off):
    scenario, a, b = tests
    line = mv.find_lines(a, scenario=scenario)["drive_5"]
    fan = [(line.frequency, 0.9 * line.amplitude)]
    loud = with_tones(off, fan)
    prepared = Prepared(with_tones(a, fan), loud)
    found = mv.compare(prepared, b, scenario=scenario)
    verdicts = {row.line: row.verdict for row in found.rows}
    assert verdicts["drive_5"] == "not judged"
    assert verdicts["drive_1"] in ("agrees", "differs")
    seen = analyse(prepared, scenario=scenario)
    assert seen.table["drive_5"].status == IN_BACKGROUND
    ends = (f"{line.frequency - 0.5} Hz", f"{line.frequency + 0.5} Hz")
    recorded = seen.table["drive_5"]
    together = 1e3 * (recorded.amplitude + recorded.background)  # the two may cancel in part
    for torque, verdict in (
        ("0.01 mN*m", "not judged"),  # what the drive did not do is no failure of it
        (f"{0.999 * together} mN*m", "not judged"),
        (f"{1.02 * together} mN*m", "pass"),  # by more than three standard uncertainties
    ):
        judged = mv.judge(seen.table, mv.Limit(torque, *ends))
        assert judged.verdict == verdict, torque


def test_a_fan_that_drifts_between_the_two_is_the_background_s_all_the_same(tests, off):
    scenario, a, _ = tests
    line = mv.find_lines(a, scenario=scenario)["drive_7"]
    drifted = with_tones(off, [(line.frequency * 1.0006, 0.9 * line.amplitude)])
    seen = analyse(Prepared(a, drifted), scenario=scenario)
    assert seen.table["drive_7"].status == IN_BACKGROUND
    assert seen.table["drive_1"].status == "ok"


def test_lines_of_the_background_are_listed_with_the_mains(tests, off):
    scenario, a, _ = tests
    loud = with_tones(off, [(31.4, 2e-3), (150.0, 1.5e-3)])
    seen = analyse(Prepared(with_tones(a, [(31.41, 2.0e-3)]), loud), scenario=scenario)
    by_size = seen.background_lines
    assert by_size[0].frequency == pytest.approx(31.4, abs=0.01)
    assert by_size[0].amplitude == pytest.approx(2e-3, rel=0.02)
    assert by_size[0].recorded == pytest.approx(2e-3, rel=0.05)
    assert by_size[1].mains == "3 x 50 Hz"
    assert by_size[0].mains == ""


def test_a_drive_that_ran_in_the_background_is_said(tests):
    scenario, a, b = tests
    seen = analyse(Prepared(a, b), scenario=scenario)
    notes = " ".join(seen.recording.notes)
    assert "was the drive running in it" in notes
    assert not any(
        x.seen and x.of_clock and x.status == "ok" and x.amplitude > 1e-3 for x in seen.table
    )


def test_a_background_that_is_louder_than_the_recording_is_said(tests, off):
    scenario, a, _ = tests
    noise = np.random.default_rng(3).normal(0.0, 0.2, off.samples)
    loud = replace(off, channels={**off.channels, "Mz": off["Mz"] + noise})
    seen = analyse(Prepared(a, loud), scenario=scenario)
    assert any("as loud as the recording" in note for note in seen.recording.notes)
