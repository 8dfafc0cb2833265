"""Repeated tests: scatter of drawn runs comes back, estimates' own errors apart; outliers are named by the stated rule."""

import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from support.tiers import sweep

import microvib as mv
from microvib.cli.main import main
from microvib.io.recordings import Prepared, write_recording
from microvib.signals.scatter import OUTLIER_RATIO, median_factor, outliers, random_effects
from microvib.studies.acceptance import acceptance
from microvib.studies.repeatability import RecordedRun, repeatability
from microvib.testdata.recording import Recording

RATE, DURATION = 512.0, 8.0
FREQUENCIES = np.array([13.7, 27.4, 41.1, 61.3, 88.2, 120.9])
AMPLITUDES = np.array([0.04, 0.03, 0.02, 0.015, 0.012, 0.01])


def recorded(seed: int, gains=1.0, noise: float = 2e-3, unit: str = "N*m") -> Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(round(RATE * DURATION)) / RATE
    size = AMPLITUDES * gains
    phase = rng.uniform(0.0, 2.0 * np.pi, size.size)
    x = np.sum(
        size[:, None] * np.cos(2.0 * np.pi * FREQUENCIES[:, None] * t + phase[:, None]), axis=0
    )
    return Recording({"Mz": x + rng.normal(0.0, noise, t.size)}, RATE, {"Mz": unit}, f"run {seed}")


def run(seed: int, unit: str = "", **how) -> RecordedRun:
    return RecordedRun(f"r{seed}", Prepared(recorded(seed, **how)), unit)


def test_the_median_s_factors_are_those_of_normal_numbers():
    rng = np.random.default_rng(0)
    for n in (2, 3, 4, 5, 6, 7, 8, 12):
        x = rng.normal(size=(100_000, n))
        off = np.abs(x - np.median(x, axis=1)[:, None])
        assert median_factor(n) * float(np.median(off)) == pytest.approx(1.0, rel=0.03), n


def test_random_effects_of_drawn_units_and_runs():
    """Means over many draws of known scatters; 95 % intervals hold them about as often."""
    rng = np.random.default_rng(1)
    within, between, sigma = 0.03, 0.10, 0.02
    groups = [f"u{k}" for k in range(6) for _ in range(4)]
    runs, units, inside = [], [], []
    for _ in range(150):
        of_unit = np.repeat(rng.normal(0.0, between, 6), 4)
        x = 1.0 + of_unit + rng.normal(0.0, within, 24) + rng.normal(0.0, sigma, 24)
        got = random_effects(x, np.full(24, sigma), groups)
        runs.append(got.runs.value**2)
        units.append(got.groups.value**2)
        inside.append(
            (got.runs.low <= within <= got.runs.high, got.groups.low <= between <= got.groups.high)
        )
    assert math.sqrt(np.mean(runs)) == pytest.approx(within, rel=0.1)
    assert math.sqrt(np.mean(units)) == pytest.approx(between, rel=0.15)
    held = np.mean(inside, axis=0)
    assert np.all(held > 0.89)
    assert np.all(held < 0.99)


def test_estimates_errors_are_no_scatter():
    """Runs that differ by the noise of their records alone: no scatter beyond it, within its interval."""
    found = repeatability([run(k, noise=0.02) for k in range(5)])
    assert len(found.lines) >= 5
    for row in found.lines:
        assert row.run_low == 0.0
        assert row.estimate > 0.005
        assert row.run < 2.5 * row.estimate


def test_scatter_of_recordings_comes_back():
    """Six units of three runs each, 10 % from unit to unit and 2 % from run to run, in every line."""
    rng, runs, seed = np.random.default_rng(3), [], 0
    for k in range(8):
        of_unit = 1.0 + 0.10 * rng.normal(size=6)
        for _ in range(3):
            runs.append(
                run(
                    seed, f"unit {k}", gains=of_unit * (1.0 + 0.02 * rng.normal(size=6)), noise=1e-3
                )
            )
            seed += 1
    found = repeatability(runs)
    assert len(found.lines) == 6
    assert np.sqrt(np.mean([row.run**2 for row in found.lines])) == pytest.approx(0.02, rel=0.25)
    assert np.sqrt(np.mean([row.unit**2 for row in found.lines])) == pytest.approx(0.10, rel=0.25)
    for row in found.lines:
        k = int(np.argmin(np.abs(FREQUENCIES - row.frequency)))
        assert abs(row.mean - AMPLITUDES[k]) < 4.0 * row.uncertainty
        assert row.run_low < 0.02 < row.run_high


def test_one_run_of_three_that_is_off_in_all_lines_is_named():
    off = [run(1), run(2), run(3, gains=1.5)]
    found = repeatability(off)
    assert set(found.outlying_runs) == {"r3"}
    assert found.outlying_runs["r3"] == pytest.approx(0.5, abs=0.03)
    assert {x.run for x in found.deviations if x.outlier} == {"r3"}


def test_one_line_of_one_run_of_three_is_named_alone():
    gains = np.where(FREQUENCIES == 41.1, 1.4, 1.0)
    found = repeatability([run(1), run(2, gains=gains), run(3)])
    named = [(row.line, row.outliers) for row in found.lines if row.outliers]
    assert len(named) == 1
    assert named[0][1] == "r2"
    assert "41.1" in named[0][0]
    assert found.outlying_runs == {}


def test_few_runs_that_are_alike_have_few_outliers():
    """The share of false ones in 100 sets of three runs that scatter by 3 % and their noise."""
    rng, false, count = np.random.default_rng(4), 0, 0
    for _ in range(100):
        sigma = np.full((6, 3), 0.01)
        x = 1.0 + rng.normal(0.0, 0.03, (6, 3)) + rng.normal(0.0, 0.01, (6, 3))
        over, out = outliers(x, sigma, ["A"] * 3)
        false += int(out.sum())
        count += out.size
    assert false / count < 0.05


def test_two_runs_have_no_outlier_and_a_bound_that_says_so():
    found = repeatability([run(1), run(2, gains=1.5)])
    assert not any(x.outlier for x in found.deviations)
    assert all(row.run_high > 5.0 for row in found.lines)  # one degree of freedom


def test_identical_runs_have_no_scatter_and_no_outlier():
    same = [RecordedRun(f"r{k}", Prepared(recorded(1))) for k in range(3)]
    found = repeatability(same)
    assert all(row.run == 0.0 for row in found.lines)
    assert not any(x.outlier for x in found.deviations)


@pytest.mark.parametrize(
    ("runs", "told"),
    [
        (lambda: [run(1)], "needs two or more"),
        (lambda: [run(1), run(1)], "r1: is given twice"),
    ],
)
def test_what_is_no_set_of_runs_is_refused(runs, told):
    with pytest.raises(mv.MicrovibError, match=told):
        repeatability(runs())


def test_on_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k, gain in enumerate((1.0, 1.01, 0.99, 1.3, 1.31, 1.29)):
        write_recording(recorded(k, gains=gain), tmp_path / f"{k}.uff")
    names = [f"{'A' if k < 3 else 'B'}={k}.uff" for k in range(6)]
    done = CliRunner().invoke(main, ["repeatability", *names, "-o", "out"])
    assert done.exit_code == 0, done.output
    assert "6 runs of 2 units, 6 lines" in done.output
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {
        "repeatability_Mz.csv",
        "repeatability_Mz.png",
        "deviations.csv",
        "report.html",
    }
    mixed = CliRunner().invoke(main, ["repeatability", "A=0.uff", "1.uff"])
    assert mixed.exit_code != 0


def test_a_run_that_is_off_is_an_outlier_by_the_rule_as_stated():
    """By hand: three runs, ten lines, all within 1 % but one value 20 % off."""
    rng = np.random.default_rng(0)
    x = 1.0 + 0.01 * rng.normal(size=(10, 3))
    x[4, 1] = 1.2
    over, out = outliers(x, np.zeros((10, 3)), ["A"] * 3)
    middle = np.median(x, axis=1)[:, None]
    off = (x - middle) / middle
    scale = median_factor(3) * float(np.median(np.abs(off)))
    np.testing.assert_allclose(over, off / scale)
    assert out[4, 1]
    assert np.array_equal(out, np.abs(off) > OUTLIER_RATIO * scale)


def test_a_run_is_an_outlier_of_its_own_unit_and_a_unit_among_units():
    """B is 10 % larger than A, and one run of B 30 %: the median of all runs would hide it."""
    gains = (1.0, 1.01, 0.99, 1.1, 1.11, 1.3)
    found = repeatability([run(k, "AB"[k // 3], gains=g) for k, g in enumerate(gains)])
    assert set(found.outlying_runs) == {"r5"}
    more = [
        run(k, f"u{k // 3}", gains=(1.5 if k // 3 == 2 else 1.0) * (1.0 + 0.01 * (k % 3)))
        for k in range(15)
    ]
    rows = repeatability(more).lines
    assert all(row.outliers == "unit u2" for row in rows)


def test_the_uncertainty_of_one_table_is_no_scatter_and_hides_none():
    """All runs corrected by one response that is known to 2 %: runs that scatter by 1 % are seen to."""
    from microvib.testdata.table_correction import TableFrf, without_table_dynamics
    from microvib.testdata.table_response import TableResponse

    f = np.arange(1.0, 250.0)
    H = np.full((f.size, 6, 6), np.nan, dtype=complex)
    H[:, 5, 5] = 1.0 / (1.0 - (f / 1000.0) ** 2)
    known = TableResponse("stiff", f, H, 0.02 * np.abs(H), np.full((f.size, 6), 0.99))
    how = TableFrf.model_construct(
        file="x.csv",
        mounted_mass=0.0,
        test_mass=0.0,
        table_mass=None,
        uncertainty=None,
        averages=None,
    )
    rng = np.random.default_rng(8)
    runs = [
        RecordedRun(
            f"r{k}",
            Prepared(
                without_table_dynamics(
                    recorded(k, 1.0 + 0.01 * rng.normal(size=6), 5e-4), known, how
                )
            ),
        )
        for k in range(8)
    ]
    rows = repeatability(runs).lines
    assert len(rows) == 6
    assert np.sqrt(np.mean([row.run**2 for row in rows])) == pytest.approx(0.01, rel=0.3)
    assert all(row.run_high > 0.005 for row in rows)
    assert all(row.uncertainty > 0.019 * row.mean for row in rows)


def judged(*runs: RecordedRun):
    limit = mv.Limit("60 mN*m", "5 Hz", "150 Hz")
    return acceptance(runs, limit=limit)


@pytest.mark.parametrize(
    ("gains", "noise"), [(0.0, 2e-3), (1e-3, 2e-6), (0.3, 2e-3), ([0, 0, 0, 1, 1, 1], 2e-3)]
)
@pytest.mark.parametrize("others", sweep([1, 2, 3], 1))
def test_a_test_is_not_passed_with_a_run_that_lacks_what_the_others_show(gains, noise, others):
    alike = [run(seed, "A") for seed in range(others)]
    odd = run(9, "A", gains=np.asarray(gains), noise=noise)
    found = judged(*alike, odd)
    assert [one.verdict for one in found.runs] == ["pass"] * (others + 1)
    assert found.verdict == "not judged"
    assert found.run_warnings[0].startswith("r9 has far less of the lines at ")
    assert judged(*alike, run(9, "A")).verdict == "pass"


def test_a_run_with_other_gain_is_questioned():
    found = judged(run(1), run(2), run(3), run(4, gains=1.4))
    assert found.verdict == "pass"
    limit = mv.Limit("400 mN*m", "5 Hz", "150 Hz")
    found = acceptance([run(1), run(2), run(3), run(4, gains=5.0)], limit=limit)
    assert found.verdict == "not judged"
    assert re.match(
        r"r4 has (5|4.99|5.01) times the amplitudes of the other runs", found.run_warnings[0]
    )


def test_units_may_differ_and_a_record_that_cannot_show_a_line_lacks_none():
    assert judged(run(1, "A"), run(2, "B", gains=0.4)).verdict == "pass"
    assert judged(run(1, "A"), run(2, "B", gains=0.02)).verdict == "not judged"
    noisy = run(3, "A", noise=0.05)
    assert noisy.name not in repeatability([run(1, "A"), run(2, "A"), noisy]).absent
    slow = Prepared(recorded(4).decimated(8))  # shows lines up to 22 Hz
    assert not repeatability([run(1), run(2), RecordedRun("slow", slow)]).absent


@pytest.mark.parametrize(
    ("gains", "verdict"),
    [
        ((1.0, 1.0, 0.5, 0.5), "not judged"),
        ((1.0, 0.7, 0.6, 0.4), "not judged"),
        ((1.0, 1.0, 0.7, 0.7), "pass"),
        ((1.0, 1.0, 1.0, 1.0), "pass"),
    ],
)
def test_a_unit_whose_runs_are_a_factor_of_two_apart_does_not_pass(gains, verdict):
    """Two of four at half: none is an outlier of the others, and it is not known which are right."""
    runs = [run(k, "A", gains=gain) for k, gain in enumerate(gains)]
    found = judged(*runs, run(8, "B"), run(9, "B"))
    assert found.verdict == verdict
    assert [one.verdict for one in found.runs] == ["pass"] * 6
    if verdict != "pass":
        assert "of the same unit: do unit of measure, gain and mounting" in found.run_warnings[-1]
        times = float(re.search(r"has ([\d.]+) times", found.run_warnings[-1])[1])
        assert times == pytest.approx(max(gains) / min(gains), rel=0.05)
