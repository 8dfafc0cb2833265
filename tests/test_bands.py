"""Peaks of a time history in bands against their limits: filters, bounds over filters, and what is not
judged."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tiers import at_a_release

import microvib as mv
from microvib.cli.main import main
from microvib.errors import MicrovibError, OptionError
from microvib.io.band_limits import BandLimit, read_band_limits
from microvib.signals.band_split import LEAK, roll_off_for, split_band
from microvib.studies.bands import judge_bands, judge_bands_of_run, verdict_on
from microvib.testdata.bench_parts import Resonance
from microvib.testdata.force_table import ForceTable
from microvib.testdata.recording import Recording

RATE = 512.0


def record(*tones, seconds=40.0, noise=0.0, rate=RATE, table=None):
    """A torque of tones (frequency, amplitude) and white noise."""
    t = np.arange(round(seconds * rate)) / rate
    x = noise * np.random.default_rng(5).normal(size=t.size) + 3.0
    for k, (f, a) in enumerate(tones):
        x += a * np.cos(2.0 * np.pi * f * t + k)
    return Recording({"Mz": x}, rate, {"Mz": "N*m"}, "tones", table=table)


def judged(recording, low, high, limit, **options):
    [one] = judge_bands(recording, [BandLimit(low, high, limit, "N*m")], **options)
    return one


def test_a_tone_inside_a_band_has_its_amplitude_there_and_none_elsewhere():
    tones = record((5.0, 1.0), (30.0, 0.5))
    inside = judged(tones, 1.0, 10.0, 1.02)
    assert inside.peak == pytest.approx(1.0, abs=2e-3)
    assert inside.least == pytest.approx(1.0, abs=5e-3)
    assert inside.largest == pytest.approx(1.0, abs=0.015)
    assert inside.verdict == "pass"
    outside = judged(tones, 50.0, 100.0, 0.05)
    assert outside.peak < 1.5 * LEAK
    assert outside.largest < 0.01 * 1.5
    assert outside.verdict == "pass"


@pytest.mark.parametrize(
    ("limit", "verdict"), [(0.9, "fail"), (0.99, "fail"), (1.02, "pass"), (1.1, "pass")]
)
def test_the_verdict_on_both_sides_of_a_tone(limit, verdict):
    assert judged(record((5.0, 1.0)), 1.0, 10.0, limit).verdict == verdict


def test_a_limit_that_a_tone_just_reaches_is_decided_by_nobody():
    """Within what the bounds leave open neither verdict is given."""
    one = judged(record((5.0, 1.0)), 1.0, 10.0, 1.0)
    assert one.verdict == "not judged"
    assert "the filter decides" in one.why


@pytest.mark.parametrize("f", [8.0, 9.0, 10.0, 11.0, 12.0])
def test_a_tone_on_the_edge_passes_only_where_every_filter_would_pass_it(f):
    tone = record((f, 1.0))
    assert judged(tone, 1.0, 10.0, 1.05).verdict == "pass"
    between = judged(tone, 1.0, 10.0, 0.6)
    assert between.verdict == "not judged"
    assert between.largest > 0.95
    inside = judged(tone, 1.0, 20.0, 0.6)
    assert inside.verdict == "fail"


def test_a_tone_beyond_the_roll_off_does_not_count():
    one = judged(record((13.5, 1.0)), 1.0, 10.0, 0.05)
    assert one.verdict == "pass"


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    low=st.floats(2.0, 10.0),
    ratio=st.floats(1.5, 10.0),
    shape=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6),
)
def test_no_filter_that_falls_within_the_roll_off_is_outside_the_bounds(seed, low, ratio, shape):
    """Filters of any falling shape, by the spectrum of a record that is longer than what is looked at."""
    rng = np.random.default_rng(seed)
    high = min(low * ratio, 100.0)
    roll_off = roll_off_for(low, high)
    n = round(40.0 * RATE)
    t = np.arange(n) / RATE
    x = 0.3 * rng.normal(size=n)
    for _ in range(4):
        f = np.exp(rng.uniform(math.log(0.5 * low), math.log(2.0 * high)))
        x += rng.uniform(0.2, 1.0) * np.cos(2.0 * np.pi * f * t + rng.uniform(0.0, 6.3))
    x -= x.mean()
    history = split_band(x, RATE, low, high, roll_off)
    f = np.fft.rfftfreq(n, 1.0 / RATE)
    steps = np.sort(np.array([0.0, *shape, 1.0]))

    def rising(edge):
        u = (f / edge - 1.0 + roll_off) / (2.0 * roll_off)
        return np.interp(u, np.linspace(0.0, 1.0, steps.size), steps, left=0.0, right=1.0)

    H = rising(low) * (1.0 - rising(high))
    y = np.fft.irfft(H * np.fft.rfft(x), n)
    # where the filter of a drawn shape rings longer than ours, ends of the record count in it
    margin = max(history.first, round(12.0 / (low * roll_off) * RATE * 0.1))
    inner = np.abs(y[margin:-margin])
    assert np.max(inner) <= 1.03 * history.largest
    assert np.max(np.abs(y[history.first : -history.first])) >= 0.97 * history.least
    assert history.least <= history.peak <= history.largest


@pytest.mark.parametrize(("low", "high"), [(5.0, 200.0), (20.0, 100.0)])
@pytest.mark.parametrize("part", [0.9, 0.3])
def test_what_the_ends_of_a_record_hold_passes_nothing(low, high, part):
    """A tone that is there only where the filter's transients are, for all of them or a part."""
    rate, seconds = 1024.0, 2.9
    quiet = record(seconds=seconds, noise=1e-3, rate=rate)
    assert judged(quiet, low, high, 0.05).verdict == "pass"
    reach = split_band(quiet["Mz"], rate, low, high, roll_off_for(low, high)).first
    t = np.arange(quiet["Mz"].size) / rate
    for on in (t < part * reach / rate, t > t[-1] - part * reach / rate):
        loud = replace(quiet, channels={"Mz": quiet["Mz"] + on * np.cos(2.0 * np.pi * 50.0 * t)})
        one = judged(loud, low, high, 0.9)
        assert one.verdict == "not judged"
        assert "the filter's transients" in one.why


def test_a_tone_that_falls_is_as_large_as_it_is_at_the_start():
    t = np.arange(round(5.62 * 1024)) / 1024.0
    x = np.exp(-t / 12.0) * np.sin(2.0 * np.pi * 21.66 * t)
    falling = Recording({"Mz": x}, 1024.0, {"Mz": "N*m"})
    one = judged(falling, 3.0, 100.0, 0.97)
    assert one.verdict == "not judged"
    assert one.largest < 0.93
    assert judged(falling, 3.0, 100.0, 1.03).verdict == "pass"


def test_a_tone_that_lasts_is_judged_whatever_it_has_below_the_band():
    """A slow line far larger than those of the band leaks into both ends as it does into the rest."""
    tones = record((50.0, 1.0), (1.2, 20.0), seconds=2.9, noise=1e-3)
    assert judged(tones, 20.0, 100.0, 1.1).verdict == "pass"


def test_peaks_between_samples_count():
    """A tone near the end of the passband, whose samples miss its crests where they stand."""
    t = np.arange(4096) / 128.0
    x = np.cos(2.0 * np.pi * 32.0 * t + np.pi / 4.0)  # samples at 0.71 only
    x[5] += 1e-3  # nor do they repeat to the last digit, as those of a converter that is stuck
    one = judged(Recording({"Mz": x}, 128.0, {"Mz": "N*m"}), 10.0, 38.0, 0.95, roll_off=0.1)
    assert one.peak == pytest.approx(1.0, abs=0.02)
    assert one.verdict == "fail"


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0.05, 1.0, "the filter is longer than the record"),
        (0.3, 1.0, "cycles of the lower edge are left"),
        (0.0, 1.0, "changes slower than the record"),
        (10.0, 200.0, "show loads up to 179.2 Hz"),
        (10.0, 400.0, "show loads up to 179.2 Hz"),
    ],
)
def test_where_the_record_cannot_tell_nothing_is_passed(low, high, words):
    one = judged(record((5.0, 1.0), (40.0, 1.0), seconds=35.0), low, high, 100.0)
    assert one.verdict == "not judged"
    assert words in one.why


def test_a_peak_above_the_limit_is_one_however_short_the_record():
    one = judged(record((0.6, 1.0), seconds=40.0), 0.3, 1.5, 0.5)
    assert one.cycles < 5.0
    assert one.verdict == "fail"


def test_a_band_about_which_the_table_says_nothing_is_not_judged():
    table = ForceTable("small table", usable=(1.0, 50.0))
    tones = record((5.0, 1.0), table=table)
    assert judged(tones, 2.0, 10.0, 2.0).verdict == "pass"
    beyond = judged(tones, 20.0, 60.0, 2.0)
    assert beyond.verdict == "not judged"
    assert "beyond the usable band of small table" in beyond.why
    below = judged(tones, 1.1, 10.0, 2.0)  # whose slope reaches below 1 Hz
    assert below.verdict == "not judged"


def test_a_background_neither_fails_a_band_nor_is_one_passed_that_it_may_hide_the_drive_in():
    drive_on, drive_off = record((5.0, 1.0)), record((5.0, 0.8))
    options = {"background": drive_off}
    for limit, verdict in ((0.1, "fail"), (0.9, "not judged"), (1.5, "not judged"), (1.9, "pass")):
        assert judged(drive_on, 1.0, 10.0, limit, **options).verdict == verdict
    assert "the background has a peak of" in judged(drive_on, 1.0, 10.0, 1.5, **options).why
    elsewhere = {"background": record((50.0, 0.8))}
    assert judged(drive_on, 1.0, 10.0, 1.1, **elsewhere).verdict == "pass"
    short = {"background": record((50.0, 0.8), seconds=1.0)}
    assert judged(drive_on, 1.0, 10.0, 1.1, **short).verdict == "not judged"


@pytest.mark.parametrize(("limit", "verdict"), [(0.8, "fail"), (1.03, "not judged"), (1.2, "pass")])
def test_what_the_table_changes_of_a_band_is_in_its_verdict(limit, verdict):
    resonance = Resonance(component="Mz", frequency="50 Hz", damping="1 percent")
    assert judged(record((5.0, 1.0)), 2.0, 7.0, limit).verdict != "not judged"
    on_table = record((5.0, 1.0), table=ForceTable("table", (resonance,)))
    assert judged(on_table, 2.0, 7.0, limit).verdict == verdict


def test_bands_of_a_recording_in_which_the_drive_does_not_run_are_not_judged(state_1):
    off = record((17.0, 0.002), noise=1e-4, rate=1024.0)
    limits = [BandLimit(20.0, 80.0, 0.1, "N*m")]
    alone = mv.analyse(off, band_limits=limits)
    assert [peak.verdict for peak in alone.band_peaks] == ["pass"]
    [peak] = mv.analyse(off, scenario=state_1, band_limits=limits).band_peaks
    assert peak.verdict == "not judged"
    assert "no line of the step clock is detected" in peak.why


def behind_low_pass(x, corner, order, rate=2048.0):
    """Samples behind a low-pass, by its magnitude alone."""
    spectrum, f = np.fft.rfft(x), np.fft.rfftfreq(x.size, 1.0 / rate)
    return np.fft.irfft(spectrum / np.sqrt(1.0 + (f / corner) ** (2 * order)), x.size)


@pytest.fixture(scope="module")
def torque():
    """Torque of state 1 in its steady state, (16384,) at 2048 Hz."""
    settings = {"record.sample_rate": "2048 Hz", "record.duration": "8 s"}
    return mv.simulate(mv.load_scenario("state-1").with_(settings), start="steady")["T_d"]


ENDS = [(2.0, 20.0), (20.0, 80.0), (80.0, 150.0)]


def bands_beside_state_1(x):
    """Verdicts and reasons in three bands with limits above all lines of state 1."""
    x = x + 1e-5 * np.random.default_rng(0).normal(size=x.size)
    recorded = Recording({"Mz": x}, 2048.0, {"Mz": "N*m"}, "made")
    limits = [BandLimit(low, high, 0.1, "N*m") for low, high in ENDS]
    return mv.analyse(recorded, scenario="state-1", band_limits=limits).band_peaks


@pytest.mark.parametrize(
    ("corner", "order", "judged_bands"),
    [(10.0, 2, 0), at_a_release(10.0, 1, 0), (30.0, 8, 1), (80.0, 8, 1), (200.0, 4, 3)],
)
def test_bands_above_a_low_pass_do_not_pass(torque, corner, order, judged_bands):
    peaks = bands_beside_state_1(behind_low_pass(torque, corner, order))
    verdicts = ["pass"] * judged_bands + ["not judged"] * (len(ENDS) - judged_bands)
    assert [peak.verdict for peak in peaks] == verdicts
    for peak in peaks[judged_bands:]:
        told = (
            "far less than B of every main line",
            "shows none of the main lines",
            "behind a low-pass",
        )
        assert any(each in peak.why for each in told)


@pytest.mark.parametrize("factor", [1.0, 0.3, 3.0])
def test_bands_of_a_drive_that_is_louder_or_quieter_are_judged(torque, factor):
    verdicts = [peak.verdict for peak in bands_beside_state_1(factor * torque)]
    assert verdicts == ["pass", "fail" if factor > 1.0 else "pass", "pass"]


def test_bands_of_a_recording_in_another_unit_do_not_pass(torque):
    peaks = bands_beside_state_1(1e-3 * torque)
    assert [peak.verdict for peak in peaks] == ["not judged"] * len(ENDS)
    assert "as in N*m taken for mN*m" in peaks[0].why


def test_the_first_seconds_of_a_filter_are_left_out():
    """A step at the start of the record is the filter's transient, not a peak."""
    tones = record((5.0, 1.0))
    x = tones["Mz"].copy()
    x[:3] += 500.0
    history = split_band(x - x.mean(), RATE, 2.0, 10.0, 0.2)
    assert history.first == pytest.approx(0.5 * 9.1 / 2.0 * RATE, rel=0.02)
    assert history.peak == pytest.approx(1.0, abs=0.05)


def test_a_smaller_roll_off_tells_what_a_larger_one_leaves_open():
    tone = record((11.0, 1.0), seconds=120.0)
    assert judged(tone, 1.0, 10.0, 0.3).verdict == "not judged"
    assert judged(tone, 1.0, 10.0, 0.3, roll_off=0.05).verdict == "pass"
    narrow = judged(tone, 10.0, 12.0, 2.0, roll_off=0.2)
    assert narrow.verdict == "not judged"
    assert "narrower than the filter's roll-off" in narrow.why
    with pytest.raises(OptionError, match="roll_off"):
        judged(tone, 1.0, 10.0, 1.0, roll_off=0.7)


def test_the_verdict_on_all_bands_is_the_worst():
    tones = record((5.0, 1.0))
    limits = [BandLimit(1.0, 10.0, limit, "N*m") for limit in (2.0, 1.0, 0.5)]
    peaks = judge_bands(tones, limits)
    assert [one.verdict for one in peaks] == ["pass", "not judged", "fail"]
    assert verdict_on(peaks) == "fail"
    assert verdict_on(peaks[:2]) == "not judged"
    assert verdict_on([]) == ""


def test_files_of_limits(tmp_path):
    file = tmp_path / "bands.csv"
    file.write_text("LOW_HZ,High_Hz,Limit_mN_m,limit_n,channel,comment\n1,10,4,,,a\n10,50,,2,Fx,\n")
    first, second = read_band_limits(file)
    assert first == BandLimit(1.0, 10.0, 4e-3, "N*m")
    assert second == BandLimit(10.0, 50.0, 2.0, "N", "Fx")
    for text, sentence in (
        ("low_hz,high_hz,limit_mn_m\n10,1,4\n", "row 2: a band from 10 to 1 Hz"),
        ("low_hz,high_hz,limit_mn_m\n1,10,-4\n", "more than 0"),
        ("low_hz,high_hz,limit_mn_m\n1,10,\n", "has 0 limits"),
        ("low_hz,high_hz,limit_mnm\n1,10,4\n", "'limit_mnm' is not known"),
        ("low_hz,high_hz,limit_mn_m\n1,nan,4\n", "finite"),
        ("low_hz,limit_mn_m\n1,4\n", "high_hz is missing"),
        (
            "low_hz,high_hz,limit_MN_m\n1,10,4\n",
            "limit_MN_m' has a prefix of 1e6 .mega.; limit_mn_m",
        ),
    ):
        file.write_text(text)
        with pytest.raises(MicrovibError, match=sentence):
            read_band_limits(file)


def test_a_limit_in_the_unit_of_another_channel_is_refused():
    with pytest.raises(MicrovibError, match="is in N, and channel Mz is in N m"):
        judge_bands(record((5.0, 1.0)), [BandLimit(1.0, 10.0, 1.0, "N")])


QUICK = [
    "--set",
    "record.settle=1 s",
    "--set",
    "record.duration=8 s",
    "--set",
    "record.sample_rate=1024 Hz",
]


def test_bands_of_a_run_and_of_its_folder_are_the_same(tmp_path):
    file = tmp_path / "bands.csv"
    file.write_text("low_hz,high_hz,limit_mn_m\n20,80,100\n20,80,10\n3,80,100\n")
    out, again = tmp_path / "run", tmp_path / "again"
    made = CliRunner().invoke(
        main, ["run", "state-1", *QUICK, "--bands", str(file), "-o", str(out)]
    )
    assert made.exit_code == 0, made.output
    assert "Peaks in bands: 2 pass, 1 FAIL" in made.output or "FAIL" in made.output
    analysed = CliRunner().invoke(
        main, ["analyse", str(out), "--bands", str(file), "-o", str(again)]
    )
    assert analysed.exit_code == 0, analysed.output
    assert (out / "band_peaks.csv").read_text() == (again / "band_peaks.csv").read_text()
    rows = (out / "band_peaks.csv").read_text().splitlines()
    assert ",fail," in rows[2]


def test_a_run_whose_lines_are_not_judged_passes_no_band(state_1):
    """A record of half a second does not resolve what the drive does: lines there are not judged."""
    from microvib.analysis.run import run_scenario

    short = state_1.with_(
        {"record.settle": "0 s", "record.duration": "2 s", "record.sample_rate": "1024 Hz"}
    )
    result = run_scenario(short)
    limits = [BandLimit(5.0, 150.0, 0.05, "N*m"), BandLimit(5.0, 150.0, 10.0, "N*m")]
    tight, wide = judge_bands_of_run(result, limits)
    assert tight.verdict != "pass"
    lines = mv.judge(result.table, mv.Limit("10 N*m", "5 Hz", "150 Hz"), short)
    assert (wide.verdict == "pass") == (not lines.gaps)


@pytest.mark.parametrize(("settle", "duration", "verdict"), [
    ("64.2 s", "4 s", "not judged"), ("62 s", "4 s", "fail"), ("60 s", "32 s", "fail"),
])  # fmt: skip
def test_a_part_of_a_steady_states_cycle_passes_no_band(settle, duration, verdict):
    """Where the record fell decided: 7 mN m in a part of six seconds that reach 488."""
    slow = mv.load_scenario("state-1").with_(
        {
            "tracking.rate": "0.003 deg/s", "driver.microsteps": 4, "motor.detent_torque": "0.05 N*m",
            "record.settle": settle, "record.duration": duration,
        }
    )  # fmt: skip
    from microvib.analysis.run import run_scenario

    result = run_scenario(slow, start="steady")
    [band] = judge_bands_of_run(result, [BandLimit(8.0, 100.0, 0.35, "N*m")])
    assert result.solver["period_s"] == pytest.approx(6.036, rel=1e-3)
    assert band.verdict == verdict
    if verdict == "not judged":
        assert "the steady state repeats after 6.036 s (record.duration >= " in band.why


@pytest.mark.release
def test_a_report_that_is_made_again_has_its_bands_again(tmp_path):
    short = ["record.settle=2 s", "record.duration=4 s"]
    (tmp_path / "bands.csv").write_text("low_hz,high_hz,limit_mn_m\n20,80,70\n80,150,0.1\n")
    out = str(tmp_path / "run")
    command = ["run", "state-1", "--bands", str(tmp_path / "bands.csv"), "--roll-off", "0.1"]
    command += ["-o", out, *(part for one in short for part in ("--set", one))]
    made = CliRunner().invoke(main, command)
    assert made.exit_code == 0, made.output
    first = (tmp_path / "run" / "report.html").read_text()
    assert "Peaks in bands" in first
    again = CliRunner().invoke(main, ["report", out])
    assert again.exit_code == 0, again.output
    second = (tmp_path / "run" / "report.html").read_text()
    said = re.compile(r"Peaks in bands: [^<]*")
    assert said.findall(second) == said.findall(first) != []


def test_a_peak_at_the_end_of_what_is_looked_at_is_none_of_the_interpolation():
    """A record that is cut where a tone is large has no peak that the tone has not."""
    for seconds in np.linspace(8.0, 8.05, 12):
        cut = record((66.0, 1.0), seconds=float(seconds), rate=1024.0)
        one = judged(cut, 13.5, 90.0, 1.02, roll_off=0.1)
        assert one.peak == pytest.approx(1.0, abs=5e-3)
        assert one.verdict == "pass"
        assert judged(cut, 13.5, 90.0, 0.98, roll_off=0.1).verdict == "fail"


def test_a_band_whose_own_peak_is_above_its_limit_does_not_pass():
    """Bursts on the slopes of the edges, of whose parts some are larger than their envelope."""
    rng = np.random.default_rng(4)
    t = np.arange(round(8.0 * RATE)) / RATE
    for _ in range(300):
        low = float(np.exp(rng.uniform(math.log(4.0), math.log(40.0))))
        roll_off = float(rng.choice([0.05, 0.1, 0.2]))
        x = 1e-6 * rng.normal(size=t.size)
        for edge in (low, low, 3.0 * low):
            f, begin = edge * rng.uniform(0.85, 1.2), rng.uniform(2.0, 6.0)
            burst = (t > begin) & (t < begin + rng.uniform(0.02, 1.0))
            x += rng.uniform(0.1, 1.0) * burst * np.cos(2.0 * np.pi * f * t + rng.uniform(0.0, 6.3))
        bursts = Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "bursts")
        one = judged(bursts, low, 3.0 * low, 1e6, roll_off=roll_off)
        if math.isnan(one.peak):
            continue
        assert one.least <= one.peak <= one.largest
        if one.peak < 0.99 * one.largest:
            continue
        assert judged(bursts, low, 3.0 * low, 0.999 * one.peak, roll_off=roll_off).verdict != "pass"


@pytest.mark.parametrize("beside", [0.3, 2.0, 4.0])
@pytest.mark.parametrize("at", [0.15, 7.6, 7.85])
def test_a_burst_at_an_end_is_heard_beside_loud_tones_outside_the_band(beside, at):
    """Of 3 mN m at 40 Hz in a band with a limit of 1 mN m, and steady tones below and above the band."""
    rate = 2048.0
    t = np.arange(int(8.0 * rate)) / rate
    burst = 3e-3 * np.cos(2.0 * np.pi * 40.0 * t) * np.exp(-0.5 * ((t - at) / 0.05) ** 2)
    steady = np.cos(2.0 * np.pi * 5.0 * t) + np.cos(2.0 * np.pi * 90.0 * t + 1.0)
    noise = 1e-5 * np.random.default_rng(1).normal(size=t.size)
    for heard, verdict in ((1.0, "not judged"), (0.0, "pass")):
        x = heard * burst + 3e-3 * beside * steady + noise
        recording = Recording({"Mz": x}, rate, {"Mz": "N*m"})
        (peak,) = judge_bands(recording, [BandLimit(8.0, 64.0, 1e-3, "N*m")])
        assert peak.verdict == verdict


@pytest.mark.parametrize("at_start", [False, True])
@pytest.mark.parametrize("periods", [3, 6, 25])
@pytest.mark.parametrize(
    ("low", "high", "frequency"), [(2.0, 100.0, 80.0), (5.0, 200.0, 150.0), (30.0, 300.0, 280.0)]
)
def test_a_burst_that_is_short_beside_the_ends_is_heard_in_them(
    low, high, frequency, periods, at_start
):
    """It is at the very end, where a window would see none of it, or amid what is left out there."""
    rate, length = 2048.0, periods / frequency
    t = np.arange(int(16.0 * rate)) / rate
    for gap in (0.0, 0.02, max(1.5 / low - length, 0.1)):
        on = (t >= t[-1] - gap - length) & (t < t[-1] - gap)
        burst = 20e-3 * on * np.cos(2.0 * np.pi * frequency * t)
        x = burst + 5e-4 * np.cos(2.0 * np.pi * 40.0 * t)
        x += 1e-5 * np.random.default_rng(1).normal(size=t.size)
        recording = Recording({"Mz": x[::-1] if at_start else x}, rate, {"Mz": "N*m"})
        limits = [BandLimit(low, high, limit, "N*m") for limit in (2e-3, 10e-3)]
        assert {peak.verdict for peak in judge_bands(recording, limits)} == {"not judged"}


def test_ends_of_a_record_with_little_between_them_are_heard():
    """The filter leaves 1.9 s of 20 to look at."""
    rate = 512.0
    t = np.arange(int(20.0 * rate)) / rate
    burst = 3e-3 * np.cos(2.0 * np.pi * 5.0 * t) * np.exp(-0.5 * ((t - 18.0) / 0.4) ** 2)
    x = burst + 1e-5 * np.random.default_rng(1).normal(size=t.size)
    recording = Recording({"Mz": x}, rate, {"Mz": "N*m"})
    (peak,) = judge_bands(recording, [BandLimit(4.0, 9.0, 1e-3, "N*m")], roll_off=0.025)
    assert 1.0 < peak.looked_at < 3.0
    assert peak.verdict == "not judged"
    assert "as loud as the rest" in peak.why


def test_a_peak_with_noise_is_one_draw_of_many():
    """One draw passed 4.2 mN m, and six of six others had more."""
    noisy = mv.load_scenario("state-1").with_(
        {
            "friction.torque_noise": {"density": "2e-6 N^2*m^2/Hz", "lowest": "0.5 Hz", "seed": 3},
            "record.settle": "150 s",
            "record.duration": "60 s",
            "record.sample_rate": "256 Hz",
        }
    )
    result = mv.run_scenario(noisy)
    peaks = [
        judge_bands_of_run(result, [BandLimit(0.7, 2.0, limit, "N*m")])[0]
        for limit in (4.2e-3, 15e-3)
    ]
    assert [peak.verdict for peak in peaks] == ["not judged", "pass"]
    assert "one draw" in peaks[0].why


@pytest.mark.parametrize(("limit", "verdict"), [(0.34, "not judged"), (5.0, "pass")])
def test_a_peak_is_judged_in_other_states_of_the_other_hinge(limit, verdict):
    """Each line stayed below the limit in either state of the hinge, their sum did not: 292 and 447 mN m."""
    friction = {"coulomb": "0.5 N*m", "breakaway": "0.6 N*m", "viscous": "0.0255 N*m*s/rad"}
    place = {
        "position": ["0.35 m", "-0.9 m", "-0.2 m"],
        "drive_axis": [0, -1, 0],
        "reference": [1, 0, 0],
    }
    wing = {
        "interface": place,
        "friction": friction | {"stribeck_rate": "0.003 deg/s"},
        "drive": "held",
    }
    craft = mv.load_scenario("examples/spacecraft.yaml").with_(
        {
            "tracking.rate": "0.0209 deg/s",
            "record.duration": "60 s",
            "record.sample_rate": "1024 Hz",
            "record.start": "steady",
            "spacecraft.second_wing": wing,
        }
    )
    [peak] = judge_bands_of_run(mv.run_scenario(craft), [BandLimit(0.8, 250.0, limit, "N*m")])
    assert peak.verdict == verdict
    assert (verdict == "pass") or "second wing's hinge" in peak.why


def test_bands_of_a_run_on_a_craft_are_of_its_torque_alone():
    """Mz of a craft is a load on the hub, and T_d was judged in its place: 0.6 for 5 mN m."""
    craft = mv.load_scenario("examples/spacecraft.yaml").with_(
        {"record.duration": "30 s", "record.start": "steady"}
    )
    result = mv.run_scenario(craft)
    [peak] = judge_bands_of_run(result, [BandLimit(2.5, 100.0, 5.0, "N*m")])
    assert peak.channel == "T_d"
    with pytest.raises(OptionError, match="channel Mz is a load that a run's bands do not judge"):
        judge_bands_of_run(result, [BandLimit(2.5, 100.0, 5.0, "N*m", channel="Mz")])
