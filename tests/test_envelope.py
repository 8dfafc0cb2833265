"""Envelopes over members: known lines come back whatever record, rate or order; edges and notches decide nothing by
chance; nothing passes that was not looked at."""

import csv
import json
import math
import re
import shlex
import shutil
import textwrap
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.commands import SHORT

import microvib as mv
from microvib.cli.main import main
from microvib.io.recordings import write_recording
from microvib.io.tables import rows_csv
from microvib.reports.envelope import draw_lines, envelope_outcome
from microvib.reports.outcome import study_contents, terminal_text
from microvib.signals.frequency_bands import OCTAVE, Bandwidth
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import open_results
from microvib.studies.campaign.statistics import ABOVE, BELOW, case_verdicts
from microvib.studies.envelope.members import Reading, members_of
from microvib.studies.envelope.spectra import densities_in_bands, mean_square
from microvib.studies.envelope.statistics import members_needed, statistic_of

RATE, DURATION = 1024.0, 8.0
WIDE = mv.Limit("15 mN*m", "5 Hz", "200 Hz")


def recorded(
    *lines, name="run", duration=DURATION, rate=RATE, noise=1e-5, seed=0, unit="N*m", channel="Mz"
):
    """A recording of lines (frequency, amplitude) with noise of an rms."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(rate * duration)) / rate
    x = rng.normal(0.0, noise, t.size)
    for k, (frequency, amplitude) in enumerate(lines):
        x += amplitude * np.cos(2.0 * np.pi * frequency * t + 0.7 * k + seed)
    return mv.Recording({channel: x}, rate, {channel: unit}, name)


def bands(found, statistic="max"):
    return [x for x in found.channels[0].bands if x.statistic == statistic]


def band_at(found, frequency, statistic="max"):
    return next(x for x in bands(found, statistic) if x.low <= frequency < x.high)


def verdict(found, statistic="max"):
    return next(x.verdict for x in found.channels[0].verdicts if x.statistic == statistic)


@pytest.mark.parametrize(
    "given", ["1/3 octave", "octave", "1/2 octave", "1/12 octave", "2 Hz", "7 percent", "5 %"]
)
def test_bands_tile_the_axis(given):
    width = Bandwidth.of(given)
    numbers = width.touching(0.5, 500.0)
    ends = [width.ends(k) for k in numbers]
    assert all(a[1] == b[0] for a, b in pairwise(ends))
    assert ends[0][0] <= 0.5
    assert ends[-1][1] >= 500.0
    rng = np.random.default_rng(0)
    for f in rng.uniform(0.5, 500.0, 300):
        low, high = width.ends(width.number(f))
        assert low <= f < high


def test_octave_bands_are_those_of_the_standard():
    """IEC 61260-1: exact mid-band frequencies 1000 G^(k/3), edges half a band away."""
    width = Bandwidth.of("1/3 octave")
    low, high = width.ends(width.number(50.0))
    assert (low * high) ** 0.5 == pytest.approx(1000.0 * OCTAVE ** (-13 / 3))  # nominally 50 Hz
    assert high / low == pytest.approx(OCTAVE ** (1 / 3))
    half = Bandwidth.of("1/2 octave")
    assert half.edge(0) == pytest.approx(1000.0)


@pytest.mark.parametrize(
    "given", ["1/0 octave", "0 Hz", "-1 Hz", "2", "3 kg", "wide", "200 percent", ""]
)
def test_what_is_no_bandwidth_is_refused(given):
    with pytest.raises(mv.OptionError, match="bandwidth"):
        Bandwidth.of(given)


def test_maximum_and_mean_of_known_lines():
    sizes = [0.004, 0.010, 0.007]
    runs = [recorded((53.0, a), name=f"u{k}", seed=k) for k, a in enumerate(sizes)]
    found = mv.envelope(runs, statistics=["max", "mean"], limit=WIDE)
    assert band_at(found, 53.0).value == pytest.approx(max(sizes), rel=1e-3)
    assert band_at(found, 53.0).worst == "u1"
    assert band_at(found, 53.0, "mean").value == pytest.approx(np.mean(sizes), rel=1e-3)
    assert band_at(found, 53.0).margin == pytest.approx(20 * math.log10(15 / 10), abs=0.01)
    assert band_at(found, 53.0, "mean").margin == pytest.approx(20 * math.log10(15 / 7), abs=0.01)
    assert verdict(found) == verdict(found, "mean") == "pass"


def test_neither_grid_nor_length_nor_order_decides():
    """The same line in records of other lengths and rates, some of which no bin falls on."""
    runs = [
        recorded((53.017, 0.01), name=f"{T} s at {rate:g} Hz", duration=T, rate=rate, seed=7)
        for T, rate in ((8.0, 1024.0), (5.37, 777.0), (41.3, 2048.0), (2.31, 600.0))
    ]
    each = [band_at(mv.envelope([run], limit=WIDE), 53.0) for run in runs]
    assert [x.value for x in each] == pytest.approx([0.01] * 4, rel=2e-3)
    spectra = [mv.envelope([run]).channels[0].spectrum for run in runs[:3]]
    tops = [max(x.value for x in one) for one in spectra]
    assert tops == pytest.approx([0.01] * 3, rel=2e-3)  # flat top: 0.01 dB
    one, other = mv.envelope(runs, limit=WIDE), mv.envelope(runs[::-1], limit=WIDE)
    assert one.channels[0].bands == other.channels[0].bands
    assert one.verdict == other.verdict == "pass"


def test_wider_and_narrower_bands_have_one_verdict_on_the_maximum():
    run = recorded((44.67, 0.0149), (150.0, 0.004))
    for width in ("octave", "1/3 octave", "1/24 octave", "10 Hz", "3 percent"):
        assert mv.envelope([run], limit=WIDE, bandwidth=width).verdict == "pass"
        assert mv.envelope([run], limit=mv.Limit("14.8 mN*m"), bandwidth=width).verdict == "fail"


def test_a_line_at_an_edge_counts_in_both_bands():
    edge = Bandwidth.of("1/3 octave").edge(Bandwidth.of("1/3 octave").number(53.0))
    clock = 1e-4 * edge  # to which any frequency is known
    for off, both in ((0.0, True), (0.5 * clock, True), (-0.5 * clock, True), (5 * clock, False)):
        found = mv.envelope([recorded((edge + off, 0.01))])
        beside = [
            x.value for x in bands(found) if math.isclose(x.high, edge) or math.isclose(x.low, edge)
        ]
        assert len(beside) == (2 if both else 1), off
        assert beside == pytest.approx([0.01] * len(beside), rel=1e-3)


NOTCHED = LimitCurve((10.0, 49.0, 50.0, 51.0, 100.0), (0.02, 0.02, 0.005, 0.02, 0.02))


@pytest.mark.parametrize(
    ("frequency", "expected"), [(53.0, "pass"), (50.0, "fail"), (49.99, "fail")]
)
def test_a_notch_decides_by_the_lines_own_frequency(frequency, expected):
    limit = Limit.of_curves(NOTCHED)
    runs = [recorded((frequency, 0.01), name="a"), recorded((80.0, 0.001), name="b", seed=1)]
    found = mv.envelope(runs, limit=limit)
    assert found.verdict == expected
    row = band_at(found, frequency)
    assert row.verdict == expected
    assert row.worst == "a"
    assert row.margin == pytest.approx(20 * math.log10(NOTCHED.at(frequency) / 0.01), abs=0.1)
    # What a reader of the picture sees is stricter, and decides nothing.
    assert row.margin_of_band == pytest.approx(20 * math.log10(0.5), abs=0.01)
    at_notch = next(x for x in found.channels[0].points if x.frequency == 50.0)
    assert at_notch.margin == pytest.approx(20 * math.log10(0.5), abs=0.01)


def test_a_notch_narrower_than_the_frequency_is_known_is_not_judged():
    narrow = LimitCurve((10.0, 53.0, 53.0005, 53.001, 100.0), (0.02, 0.02, 0.005, 0.02, 0.02))
    assert (
        mv.envelope([recorded((53.002, 0.01))], limit=Limit.of_curves(narrow)).verdict
        == "not judged"
    )


def test_a_step_of_the_limit_at_an_edge_of_a_band_is_on_neither_side():
    """A line that may be on either side of a step fails in no band, and passes in none."""
    width = Bandwidth.of("1/3 octave")
    edge = width.edge(width.number(53.0))
    stepped = LimitCurve((10.0, edge, edge, 100.0), (0.02, 0.02, 0.005, 0.005))
    run = recorded((edge * (1.0 + 2e-5), 0.01))
    found = mv.envelope([run], limit=Limit.of_curves(stepped), statistics=["max", "mean"])
    for statistic in ("max", "mean"):
        beside = [x for x in bands(found, statistic) if x.value > 0.0]
        assert [x.verdict for x in beside] == ["not judged"] * 2
        assert verdict(found, statistic) == "not judged"
    clear = mv.envelope([recorded((edge * 1.001, 0.01))], limit=Limit.of_curves(stepped))
    assert clear.verdict == "fail"


def test_without_a_band_what_is_above_the_passband_is_not_judged():
    assert mv.envelope([recorded((53.0, 0.001))], limit=mv.Limit("15 mN*m")).verdict == "not judged"


def test_the_density_conserves_the_mean_square():
    """Bands of white noise have its density, whatever the record; all bands together, its mean square."""
    width = Bandwidth.of("1/3 octave")
    for rate, duration in ((1024.0, 64.0), (777.0, 200.0), (4096.0, 40.0)):
        x = recorded((53.0, 0.02), noise=0.01, duration=duration, rate=rate)["Mz"]
        found = densities_in_bands(x, rate, width)
        ends = [width.ends(k) for k in found.figures]
        low, high = min(ends)[0], max(ends)[1]
        white = 0.01**2 / (0.5 * rate)
        assert mean_square(found, width) == pytest.approx(
            white * (high - low) + 0.5 * 0.02**2, rel=0.01
        )
        top = [found.figures[k] for k in found.figures if width.ends(k)[0] > 70.0]
        assert np.mean(top) == pytest.approx(white, rel=0.03)
        assert (
            mean_square(densities_in_bands(x, rate, Bandwidth.of("9 Hz")), Bandwidth.of("9 Hz"))
            > 0.0
        )


def test_percentiles_of_a_known_distribution():
    """The upper bound is above the true percentile in 95 of 100 samples or more, and hardly more."""
    rng = np.random.default_rng(3)
    assert members_needed("p95") == 59
    assert members_needed("p99") == 299
    for statistic, n, true in (
        ("p95", 59, -math.log(0.05)),
        ("p95", 200, -math.log(0.05)),
        ("p99", 299, -math.log(0.01)),
    ):
        draws = rng.exponential(size=(2000, n))
        found = [statistic_of(statistic, x, x, x) for x in draws]
        above = np.mean([x.high >= true for x in found])
        below = np.mean([x.low <= true for x in found])
        assert 0.94 < above < 0.985, (statistic, n)
        assert below > 0.94
        assert np.median([x.value for x in found]) == pytest.approx(true, rel=0.15)
    few = statistic_of("p95", *[rng.exponential(size=58)] * 3)
    assert math.isnan(few.value)
    assert math.isnan(few.high)


def many(count, size=0.01):
    return [
        recorded((53.0, size * (0.9 + 0.002 * k)), name=f"u{k}", seed=k, duration=2.5, rate=512.0)
        for k in range(count)
    ]


@pytest.mark.release
def test_a_percentile_is_judged_from_59_members_on():
    limit = mv.Limit("15 mN*m", "5 Hz", "100 Hz")
    few = mv.envelope(many(58), statistics=["p95"], limit=limit)
    assert few.verdict == "not judged"
    assert "59 or more" in few.channels[0].verdicts[0].why
    assert math.isnan(band_at(few, 53.0, "p95").value)
    enough = mv.envelope(many(59), statistics=["p95", "mean"], limit=limit)
    assert verdict(enough, "p95") == "pass"
    row = band_at(enough, 53.0, "p95")
    assert row.at_most == pytest.approx(0.01 * (0.9 + 0.002 * 58), rel=2e-3)  # the largest of 59
    strict = mv.envelope(many(59), statistics=["p95"], limit=mv.Limit("9.2 mN*m", "5 Hz", "100 Hz"))
    assert strict.verdict == "fail"


def test_a_mean_that_passes_is_no_pass_of_each():
    runs = [recorded((53.0, a), name=f"u{k}", seed=k) for k, a in enumerate((0.020, 0.002, 0.003))]
    found = mv.envelope(runs, statistics=["max", "mean"], limit=WIDE)
    assert (verdict(found), verdict(found, "mean")) == ("fail", "pass")
    assert found.verdict == "fail"
    alone = envelope_outcome(mv.envelope(runs, statistics=["mean"], limit=WIDE))
    assert alone.verdict == "pass"
    assert "nothing of a single member; 1 of 3 are above the limit" in terminal_text(alone)


def test_a_member_whose_passband_ends_below_is_not_judged():
    low = recorded((53.0, 0.002), name="slow", rate=256.0, seed=1)
    limit = mv.Limit("15 mN*m", "5 Hz", "150 Hz")
    assert mv.envelope([recorded((53.0, 0.002))], limit=limit).verdict == "pass"
    for statistic in ("max", "mean"):
        found = mv.envelope([recorded((53.0, 0.002)), low], limit=limit, statistics=[statistic])
        assert found.verdict == "not judged"
        assert "slow" in found.channels[0].verdicts[0].why
        assert band_at(found, 53.0, statistic).verdict == "pass"
        assert band_at(found, 140.0, statistic).verdict == "not judged"
        assert math.isnan(band_at(found, 140.0, statistic).at_most)


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (recorded((53.0, 0.001), name="x", duration=0.9), "lasts 0.9004 s"),
        (recorded((53.0, 0.001), name="x", channel="Fx", unit="N"), "no channel 'Mz'"),
        (recorded((53.0, 0.001), name="x", unit="N"), "force"),
        (recorded((53.0, 0.001), (53.4, 0.02), name="x", duration=2.2), ""),
    ],
)
def test_a_member_that_was_not_looked_at_is_no_pass(other, says):
    found = mv.envelope(
        [recorded((53.0, 0.002)), other],
        limit=mv.Limit("15 mN*m", "5 Hz", "200 Hz"),
        statistics=["max", "mean"],
    )
    assert verdict(found) in ("not judged", "fail")
    assert verdict(found, "mean") == "not judged" or not says
    if says:
        assert verdict(found) == "not judged"
        assert says in next(x.why for x in found.channels[0].members if x.name == "x")


def test_a_failure_stands_beside_members_that_were_not_looked_at():
    missing = recorded((53.0, 0.001), name="x", channel="Fx", unit="N")
    found = mv.envelope([recorded((53.0, 0.02)), missing], limit=WIDE, statistics=["max", "mean"])
    assert verdict(found) == "fail"
    assert verdict(found, "mean") == "not judged"
    # The margin of the mean is of the members that are known, not of nothing in place of the other.
    assert band_at(found, 53.0, "mean").margin == pytest.approx(20 * math.log10(15 / 20), abs=0.05)


def test_loads_have_curves_of_their_own():
    limit = Limit.of_curves(None, {"Fx": LimitCurve.flat(0.5, 5.0, 200.0)})
    runs = [recorded((60.0, a), name=f"{a}", channel="Fx", unit="N", seed=3) for a in (0.2, 0.6)]
    found = mv.envelope(runs, limit=limit)
    assert [x.channel for x in found.channels] == ["Fx"]
    assert found.verdict == "fail"
    files, _ = study_contents(envelope_outcome(found))
    assert "amplitude_n" in files["envelope.csv"].splitlines()[0].split(",")
    assert "density_n_squared_per_hz" in files["density.csv"].splitlines()[0]
    with pytest.raises(mv.OptionError, match="Fy is in no member"):
        mv.envelope(runs, channels=["Fy"])


def test_members_of_one_name_are_told_apart_and_none_counts_twice(tmp_path):
    found = mv.envelope([recorded((53.0, 0.001)), recorded((53.0, 0.002), seed=1)])
    assert [x.name for x in found.channels[0].members] == ["run", "run (2)"]
    assert band_at(found, 53.0).value == pytest.approx(0.002, rel=1e-2)
    write_recording(recorded((53.0, 0.001)), tmp_path / "a.csv")
    with pytest.raises(mv.MicrovibError, match="given twice"):
        mv.envelope([tmp_path / "a.csv", tmp_path / "." / "a.csv"])


def test_a_copy_of_a_recording_is_no_further_draw(tmp_path):
    write_recording(recorded((53.0, 0.001)), tmp_path / "a.csv")
    copies = [shutil.copy(tmp_path / "a.csv", tmp_path / f"copy_{k}.csv") for k in range(59)]
    with pytest.raises(mv.MicrovibError, match=r"copy_1.csv: is given twice"):
        mv.envelope(copies, statistics=["p95"], limit=WIDE)


def test_a_campaign_drawn_again_has_no_further_draws(tmp_path):
    study = """
        scenario: state-1
        solve: steady
        vary: {motor.detent_torque: {distribution: uniform, within: 10 percent}}
        sampling: {method: random, count: 2}
    """
    for name, limit in (("first", 50), ("again", 60)):
        file, folder = tmp_path / f"{name}.yaml", str(tmp_path / name)
        file.write_text(f"{textwrap.dedent(study)}limit: {limit} mN*m\n")
        for line in (
            ["create", str(file), folder],
            ["run", folder, "--workers", "1"],
            ["merge", folder],
        ):
            told = CliRunner().invoke(main, ["campaign", *line])
            assert told.exit_code == 0, told.output
    assert len(members_of([tmp_path / "first"], Reading())) == 2
    with pytest.raises(mv.MicrovibError, match="again, case 0: is given twice"):
        members_of([tmp_path / "first", tmp_path / "again"], Reading())


RATES = ["rates", "state-1", "--from", "0.05 deg/s", "--to", "0.06 deg/s", "--count", "2"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folders of a run, of its lines alone, and of a rate plan, of the full model and linear."""
    folder = tmp_path_factory.mktemp("members")
    for line in (
        ["run", "state-1", "--steady", "--out", "run"],
        ["run", "state-1", "--lines-only", *SHORT, "--out", "lines"],
        [*RATES, "--out", "plan"],
        [*RATES, "--linear", "--out", "linear"],
    ):
        line[-1] = str(folder / line[-1])
        done = CliRunner().invoke(main, line)
        assert done.exit_code == 0, done.output
    return folder


@pytest.mark.parametrize("torque", ["60 mN*m", "45 mN*m", "30 mN*m"])
def test_a_rate_plan_is_judged_as_the_plan_itself(folders, torque):
    limit = mv.Limit(torque, "1 Hz", "150 Hz")
    plan = mv.plan_rates("state-1", mv.rate_grid("0.05 deg/s", "0.06 deg/s", 2))
    curve = limit.curve
    own = sorted(
        (f"{math.degrees(x.rate):.4g}", x.verdict((curve.low, curve.high), curve))
        for x in plan.cases
    )
    found = mv.envelope([folders / "plan"], limit=limit)
    told = sorted(
        (f"{float(x.values.split()[0]):.4g}", x.verdict) for x in found.channels[0].members
    )
    assert [name for name, _ in told] == [name for name, _ in own]
    assert [x == "pass" for _, x in told] == [not why for _, why in own]
    assert [x == "fail" for _, x in told] == ["above" in why for _, why in own]


def test_what_a_folder_does_not_tell_is_not_judged(folders, tmp_path):
    limit = mv.Limit("60 mN*m", "1 Hz", "150 Hz")
    assert mv.envelope([folders / "run"], limit=limit).verdict == "pass"
    assert mv.envelope([folders / "lines"], limit=limit).verdict == "not judged"
    high = mv.Limit("200 mN*m", "1 Hz", "150 Hz")
    assert mv.envelope([folders / "linear"], limit=high).verdict == "not judged"
    assert mv.envelope([folders / "plan"], limit=high).verdict == "pass"
    assert mv.envelope([folders / "plan"], limit=mv.Limit("60 mN*m")).verdict == "not judged"
    old = tmp_path / "old"
    old.mkdir()
    (old / "rates.csv").write_text((folders / "plan" / "rates.csv").read_text())
    found = mv.envelope([old], limit=limit)
    assert found.verdict == "not judged"
    assert "does not tell what else" in found.channels[0].verdicts[0].why
    assert mv.envelope([old], limit=mv.Limit("20 mN*m", "1 Hz", "150 Hz")).verdict == "fail"


def test_a_run_is_judged_as_microvib_run_does(folders):
    kept = mv.read_run(folders / "run")
    for torque in ("60 mN*m", "47.8 mN*m", "40 mN*m"):
        limit = mv.Limit(torque, "0.5 Hz", "150 Hz")
        own = mv.judge(kept.table, limit, kept.motion.scenario)
        assert mv.envelope([kept], limit=limit).verdict == own.verdict


def test_percentiles_of_a_sweep_say_nothing(folders):
    limit = mv.Limit("60 mN*m", "1 Hz", "150 Hz")
    found = mv.envelope([folders / "plan"], limit=limit, statistics=["p95", "max"])
    assert verdict(found, "p95") == "not judged"
    assert verdict(found) == "pass"
    assert "not drawn by chance" in found.channels[0].verdicts[1].why


def test_a_folder_of_folders_and_a_changed_one(folders, tmp_path):
    assert mv.envelope([folders]).members == 1 + 1 + 2 + 2
    changed = tmp_path / "plan"
    changed.mkdir()
    for file in (folders / "plan").iterdir():
        (changed / file.name).write_bytes(file.read_bytes())
    with (changed / "rates.csv").open("a") as stream:
        stream.write("0.05,16,mine,drive,1,53,1,,steady\n")
    with pytest.raises(mv.MicrovibError, match="was changed"):
        mv.envelope([changed])


STUDY = """
harmonics: 2
scenario: state-1
set: {record.settle: 0.2 s, record.duration: 2 s, record.sample_rate: 1024 Hz}
vary: {friction.breakaway: {distribution: uniform, within: 20 percent}}
sampling: {method: random, count: 2}
solve: steady
limit: 70 mN*m
band: 10:100 Hz
"""


def test_a_campaigns_cases_are_judged_as_its_report_does(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    folder = str(tmp_path / "batch")
    for line in (
        ["create", str(tmp_path / "study.yaml"), folder],
        ["run", folder, "--workers", "1"],
        ["merge", folder],
    ):
        done = CliRunner().invoke(main, ["campaign", *line])
        assert done.exit_code == 0, done.output
    results = open_results(open_campaign(Path(folder)))
    for torque in ("70 mN*m", "60 mN*m", "20 mN*m"):
        limit = mv.Limit(torque, "10 Hz", "100 Hz")
        own = case_verdicts(results, limit.curve, (10.0, 100.0))
        words = {BELOW: "pass", ABOVE: "fail"}
        found = mv.envelope([folder], limit=limit, statistics=["max", "p95"])
        assert [x.verdict for x in found.channels[0].members] == [
            words.get(x, "not judged") for x in own
        ]
        # Few cases bound P95 from below: where all are above the limit, it is.
        assert verdict(found, "p95") == ("fail" if np.all(own == ABOVE) else "not judged")
        assert found.drawn
    top = np.nanmax(results.of("drive_1"))
    assert band_at(
        mv.envelope([folder]), results.of("drive_1", "frequency")[0]
    ).value == pytest.approx(top)


def test_angles_keep_loads_and_pass_nothing(tmp_path):
    keys = [
        "angle_deg",
        "line",
        "frequency_hz",
        "fx_n",
        "fy_n",
        "fz_n",
        "mx_n_m",
        "my_n_m",
        "mz_n_m",
        "los_x_rad",
        "los_y_rad",
    ]
    rows = [[a, "drive_1", 53.0, 0.1 + a / 100, 0, 0, 0, 0, 0.01, 0, 0] for a in (0.0, 30.0)]
    rows.append(
        [30.0, "array_mode_1", 1.2, 0.1, 0, 0, 0, 0, "", 0, 0]
    )  # one that could not be estimated
    (tmp_path / "angles.csv").write_text(rows_csv(keys, rows))
    found = mv.envelope(
        [tmp_path],
        channels=["Fx"],
        limit=Limit.of_curves(None, {"Fx": LimitCurve.flat(0.5, 5.0, 200.0)}),
    )
    assert found.verdict == "not judged"
    assert band_at(found, 53.0).value == pytest.approx(0.4)
    assert "30 deg" in band_at(found, 53.0).worst
    low = Limit.of_curves(None, {"Fx": LimitCurve.flat(0.3, 5.0, 200.0)})
    assert mv.envelope([tmp_path], limit=low).verdict == "fail"
    with pytest.raises(mv.OptionError, match="name a channel, Fx to Mz"):
        mv.envelope([tmp_path])


def test_all_forms_say_the_same(folders, tmp_path):
    write_recording(recorded((53.0, 0.07)), tmp_path / "loud.csv")
    out = tmp_path / "seen"
    done = CliRunner().invoke(
        main,
        ["envelope", str(tmp_path / "loud.csv"), str(folders / "plan"), "--statistic", "max", "--statistic", "mean",
         "--limit", "60 mN*m", "--band", "1:150 Hz", "--out", str(out)],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "Maximum of 3 members: FAIL" in done.output
    assert "1/3-octave bands" in done.output
    assert {x.name for x in out.glob("[!.]*")} == {
        "envelope.csv", "members.csv", "spectrum.csv", "density.csv", "envelope.json", "envelope.png",
        "spectrum.png", "density.png", "report.html",
    }  # fmt: skip
    for name in ("envelope", "spectrum", "density"):
        with (out / f"{name}.csv").open() as stream:
            assert {row["bandwidth"] for row in csv.DictReader(stream)} == {"1/3-octave bands"}
    told = json.loads((out / "envelope.json").read_text())
    assert told["verdict"] == "fail"
    assert told["bandwidth"] == "1/3-octave bands"
    with (out / "envelope.csv").open() as stream:
        worst = min(
            (x for x in csv.DictReader(stream) if x["margin_db"]),
            key=lambda x: float(x["margin_db"]),
        )
    assert worst["worst"].endswith("loud.csv")
    assert worst["verdict"] == "fail"
    assert float(worst["margin_db"]) == pytest.approx(20 * math.log10(60 / 70), abs=0.02)
    report = (out / "report.html").read_text()
    assert "FAIL" in report
    assert "1/3-octave bands" in report


def test_the_picture_names_the_line_that_fails():
    found = mv.envelope([recorded((53.0, 0.07), name="loud")], limit=WIDE)
    [ax] = draw_lines(found, found.channels[0]).axes
    [worst] = [x for x in found.channels[0].bands if x.verdict == "fail"]
    assert worst.line in [x.get_text() for x in ax.texts]
    assert any(x.startswith(f"{worst.line} of loud") for x in ax.get_legend_handles_labels()[1])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere.uff"], "nowhere.uff: is no run that was kept"),
        (["."], "holds nothing that is a member"),
        (["a.csv", "--bandwidth", "wide"], "'wide' is not known"),
        (["a.csv", "--bandwidth", "0.0001 Hz"], "wider ones are expected"),
        (["a.csv", "--resolution", "1 kg"], "wrong dimension"),
        (["a.csv", "--channel", "Fx"], "Fx is in no member"),
        (["a.csv", "--limit", "60 kg"], "wrong dimension"),
        (["a.csv", "a.csv"], "is given twice"),
        (["scenario.yaml"], "is no run that was kept"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    if arguments != ["."]:
        write_recording(recorded((53.0, 0.001)), tmp_path / "a.csv")
    done = CliRunner().invoke(main, ["envelope", *arguments, "--out", "made"])
    assert done.exit_code == 1
    assert says in done.output
    assert "Traceback" not in done.output
    assert not (tmp_path / "made").exists()


def test_an_interrupt_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(3):
        write_recording(recorded((53.0, 0.001), seed=k), tmp_path / f"{k}.csv")

    def interrupted(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mv.envelope(["0.csv", "1.csv", "2.csv"], progress=interrupted)
    seen = []
    mv.envelope(["0.csv", "1.csv"], progress=lambda done, total: seen.append((done, total)))
    assert seen == [(0, 2), (1, 2), (2, 2)]


@pytest.mark.release
def test_the_how_to_runs_as_it_stands(tmp_path, monkeypatch):
    """Its commands, in order, give the sentence that it quotes, and its Python the verdict."""
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[1] / "docs" / "howto" / "envelopes.md").read_text("utf-8")
    lines = [
        x.strip() for x in page.replace("\\\n", " ").splitlines() if x.startswith("    microvib")
    ]
    assert len(lines) == 5
    for line in lines:
        done = CliRunner().invoke(main, shlex.split(line)[1:])
        assert done.exit_code == 0, done.output
    quoted = " ".join(re.search(r"    (Maximum of .*?\.)\n\n", page, re.DOTALL)[1].split())
    assert quoted in " ".join(done.output.split())
    told = {}
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], told)
    assert told["found"].verdict == "pass"
