"""Verdicts on recordings pass nothing that preparation, force table or background do not let them show."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from support.tiers import at_a_release, sweep

import microvib as mv
from microvib.errors import OptionError
from microvib.io.recordings import Prepared
from microvib.signals.limit_curve import Limit
from microvib.studies.acceptance import AcceptanceTest
from microvib.studies.recording_limits import judge_recording, judge_sides
from microvib.testdata.bench_parts import Resonance
from microvib.testdata.force_table import ForceTable
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording
from microvib.units import Si

RATE = 1000.0


def recording(
    *lines: tuple[float, float], seconds: float = 16.0, channel: str = "Mz", seed: int = 1
) -> Recording:
    """Lines of a frequency [Hz] and an amplitude each, and little noise."""
    t = np.arange(round(seconds * RATE)) / RATE
    x = 1e-5 * np.random.default_rng(seed).standard_normal(t.size)
    for f, size in lines:
        x += size * np.cos(2.0 * math.pi * f * t + f)
    unit = "N" if channel.startswith("F") else "N*m"
    return Recording({channel: x}, RATE, {channel: unit}, "test")


def butterworth(f: float, corner: float, order: int) -> float:
    """Amplitude of a low-pass."""
    return 1.0 / math.sqrt(1.0 + (f / corner) ** (2 * order))


def test_a_line_that_the_measuring_chain_hardly_passes_is_not_judged():
    load, corner = 0.05, "60 Hz"
    read = recording((40.0, 0.005), (100.0, load * butterworth(100.0, 60.0, 8)))
    how = Preparation(response=[{"kind": "butterworth", "order": 8, "corner": corner}])
    prepared = how.apply(read)
    judged = judge_recording(prepared, Limit("10 mN*m", "1 Hz", "300 Hz"))
    assert judged.verdict == "not judged"
    assert "the measuring chain passes less than 0.25 of a load above 71.05 Hz" in str(judged)
    (status,) = {m.line.status for m in judged.margins if m.line.frequency > 90.0}
    assert status == "beyond the measuring chain"
    assert judge_recording(prepared, Limit("10 mN*m", "1 Hz", "70 Hz")).verdict == "pass"


def test_a_high_pass_hides_slow_lines():
    load, f, corner = 0.03, 1.0, 5.0
    read = recording((f, load * math.sqrt(1.0 - butterworth(f, corner, 1) ** 2)), (40.0, 0.005))
    stage = {"kind": "butterworth", "order": 1, "corner": "5 Hz", "passes": "high"}
    prepared = Preparation(response=[stage]).apply(read)
    assert judge_recording(prepared, Limit("10 mN*m", "0.8 Hz", "300 Hz")).verdict == "not judged"
    assert judge_recording(prepared, Limit("10 mN*m", "2 Hz", "300 Hz")).verdict == "pass"


def test_a_chain_that_passes_all_of_the_band_leaves_it_judged():
    prepared = Preparation(response="boxcar").apply(recording((40.0, 0.005)))
    assert prepared.unusable("Mz") == ()
    assert judge_recording(prepared, Limit("10 mN*m", "1 Hz", "300 Hz")).verdict == "pass"


@pytest.mark.parametrize("order", [3, 5, 8])
def test_a_slow_line_in_a_removed_trend_is_not_judged(order):
    cycles, seconds = 2.6, 8.0
    read = recording((cycles / seconds, 0.03), (40.0, 0.005), seconds=seconds)
    limit = Limit("10 mN*m", "0.31 Hz", "100 Hz")
    assert judge_recording(read, limit).verdict == "fail"
    prepared = read.detrended(order)
    judged = judge_recording(prepared, limit)
    assert judged.verdict != "pass"
    assert f"the polynomial of order {order} that was removed" in str(judged.all_gaps)
    assert judge_recording(prepared, Limit("10 mN*m", "2 Hz", "100 Hz")).verdict == "pass"


@pytest.mark.parametrize("order", sweep(range(9), 0, 1, 5))
def test_what_a_trend_takes_of_a_line_is_as_stated(order):
    n = 20_000
    lost = Recording({"Mz": np.arange(float(n))}, RATE, {"Mz": "N*m"}).detrended(order).lost
    cycles = 2.5 if not lost else lost[0].high * n / RATE
    t = np.arange(n) / n
    kept = []
    for c in (cycles, 1.01 * cycles, 1.3 * cycles, 2.0 * cycles):
        for phase in np.linspace(0.0, math.pi, 25):
            x = np.cos(2.0 * math.pi * c * t + phase)
            left = Recording({"Mz": x}, RATE, {"Mz": "N*m"}).detrended(order)["Mz"]
            kept.append(np.dot(left, x) / np.dot(x, x))
    assert min(kept) > 0.947
    assert order < 2 or min(kept) < 0.953


@pytest.mark.parametrize("channel", ["Fx", "Mx"])
@pytest.mark.parametrize("scenario", [None, "state-1"])
def test_other_loads_ask_the_force_table_and_the_background(channel, scenario):
    read = recording((250.0, 0.5), channel=channel)
    unit = "N" if channel == "Fx" else "N*m"
    limit = Limit.of_curves(
        None, {channel: Limit.over_frequency([("2 Hz", "1 N*m"), ("300 Hz", "1 N*m")]).curve}
    )
    judge = {"channel": channel, "scenario": scenario}
    assert judge_recording(read, limit, **judge).verdict == "pass"
    resonance = Resonance(component=channel, frequency="150 Hz", damping="1 percent")
    table = ForceTable("soft", (resonance,))
    on_table = Recording(dict(read.channels), RATE, {channel: unit}, "test", table=table)
    judged = judge_recording(on_table, limit, **judge)
    assert judged.verdict == "not judged"
    assert "near a table resonance" in str(judged)
    off = recording((250.0, 0.6), channel=channel, seed=2)
    judged = judge_recording(Prepared(read, background=off), limit, **judge)
    assert judged.verdict == "not judged"
    assert "in the background" in str(judged)


@pytest.mark.parametrize(("limit", "verdict"), [("14.5 mN*m", "not judged"), ("15.5 mN*m", "pass")])
def test_a_line_in_the_background_passes_where_both_together_are_below_the_limit(limit, verdict):
    on, off = recording((90.0, 0.007)), recording((90.0, 0.008), seed=2)
    judged = judge_recording(Prepared(on, background=off), Limit(limit, "2 Hz", "300 Hz"))
    assert judged.verdict == verdict


@pytest.mark.parametrize(("limit", "verdict"), [("7.5 mN*m", "not judged"), ("8.5 mN*m", "pass")])
def test_a_line_of_the_background_that_the_recording_has_not_may_hide_one(limit, verdict):
    """The drive's and the background's may be of opposite phases."""
    on, off = recording((40.0, 0.002)), recording((90.0, 0.008), seed=2)
    judged = judge_recording(Prepared(on, background=off), Limit(limit, "2 Hz", "300 Hz"))
    assert judged.verdict == verdict
    beside = judge_recording(Prepared(on, background=off), Limit("7.5 mN*m", "2 Hz", "80 Hz"))
    assert beside.verdict == "pass"
    assert verdict == "pass" or "background's line at 90 Hz may hide" in str(judged.all_gaps)


def test_a_curve_of_the_torque_judges_no_other_axis():
    read = recording((90.0, 0.007), channel="Mx")
    curve = Limit.over_frequency([("2 Hz", "1 N*m"), ("300 Hz", "2 N*m")])
    assert judge_recording(read, curve, channel="Mx").verdict == "pass"  # said to be the drive's
    with pytest.raises(OptionError, match="has no curve of Mx"):
        judge_recording(read, curve, channel="Mx", scenario="state-1")


def test_a_band_beyond_half_the_sample_rate_has_no_rms():
    read = recording((90.0, 0.007))
    with pytest.raises(OptionError, match="frequencies up to half its sample rate, 500 Hz"):
        mv.analyse(read, bands=["450:900 Hz"])
    narrow = mv.analyse(read, bands=["90.3:90.31 Hz"])
    assert any("narrower than 4 bins" in note for note in narrow.recording.notes)
    wide = mv.analyse(read, bands=["10:500 Hz"])
    assert not any("narrower" in note for note in wide.recording.notes)


@pytest.fixture(scope="module")
def torque():
    """Torque of state 1 in its steady state, (16384,) at 2048 Hz."""
    record = {"record.sample_rate": "2048 Hz", "record.duration": "8 s"}
    return mv.simulate(mv.load_scenario("state-1").with_(record), start="steady")["T_d"]


def beside_scenario(
    samples: np.ndarray,
    noise: float,
    limit: str = "30 mN*m",
    seed: int = 0,
    band=("1 Hz", "350 Hz"),
):
    """Judgement beside state 1, and what the comparison with it says; the noise is white."""
    x = samples + noise * np.random.default_rng(seed).normal(size=samples.size)
    recorded = Recording({"Mz": x}, 2048.0, {"Mz": "N*m"}, "made")
    judged = judge_recording(recorded, Limit(limit, *band), scenario="state-1")
    return judged.verdict, "".join(one for one in judged.gaps if "beside the scenario" in one)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1e-3, ["1000 would be like B, as in N*m taken for mN*m"] * 4),
        at_a_release(1e-2, ["100 would be like B, as in N*m taken for N*cm"] * 4),
        (1.0 / 9.80665, ["9.80665 would be like B, as in kgf*m taken for N*m"] * 2 + ["", ""]),
    ],
)
def test_a_unit_is_told_by_the_lines_that_noise_leaves(torque, factor, told):
    """The largest line is 48 mN m, above the limit. In noise of twice and four times its amplitude it is
    known to 3 and 6 %, which does not tell 9.81 from 8.85.
    """
    for seed, (noise, by) in enumerate(zip((0.03, 0.05, 0.1, 0.2), told, strict=True)):
        verdict, said = beside_scenario(factor * torque, noise * factor, seed=seed)
        assert verdict == "not judged"
        if by:
            assert f"A multiplied by {by}: check" in said
        else:
            assert "A has far less than B of every main line that its noise does not hide" in said
            assert re.search(r"\(drive_1 at (9|1\d)\.?\d* %,", said)


@pytest.mark.parametrize("noise", sweep([1e-5, 1e-3, 0.1, 0.2], 1e-3, 0.2))
def test_a_record_without_the_drive_passes_no_limit(torque, noise):
    verdict, said = beside_scenario(0.0 * torque, noise, "45 mN*m")
    assert verdict == "not judged"
    assert "A shows none of the main lines of B (drive_1 at most at " in said


def without(samples: np.ndarray, frequencies, factor: float) -> np.ndarray:
    """Samples with lines times a factor."""
    spectrum, f = np.fft.rfft(samples), np.fft.rfftfreq(samples.size, 1.0 / 2048.0)
    for line in frequencies:
        spectrum[np.abs(f - line) < 0.6] *= factor
    return np.fft.irfft(spectrum, samples.size)


@pytest.mark.parametrize(
    ("lines", "decibel"),
    [
        (1, -20),
        (8, -10),
        (0, -10),
        at_a_release(1, -10),
        at_a_release(2, -20),
        at_a_release(8, -20),
    ],
)
def test_a_quieter_drive_passes(torque, lines, decibel):
    """Some driving lines are smaller than the scenario's, or (0) everything is by 10 dB."""
    factor = 10.0 ** (decibel / 20.0)
    quieter = without(torque, [53.333 * k for k in range(1, lines + 1)], factor)
    if not lines:
        quieter = factor * torque
    for noise in (1e-6, 1e-3, 0.03):
        assert beside_scenario(quieter, noise, "60 mN*m") == ("pass", "")


def low_passed(samples: np.ndarray, corner: float, order: int) -> np.ndarray:
    """Samples behind a low-pass, by its magnitude alone."""
    spectrum, f = np.fft.rfft(samples), np.fft.rfftfreq(samples.size, 1.0 / 2048.0)
    return np.fft.irfft(spectrum / np.sqrt(1.0 + (f / corner) ** (2 * order)), samples.size)


@pytest.mark.parametrize(
    ("order", "band", "told"),
    [
        (2, ("40 Hz", "200 Hz"), "from 40 Hz to 200 Hz A has far less than B of every main line"),
        (2, ("1 Hz", "350 Hz"), "A has far less than B of its upper main lines, and the less the"),
        at_a_release(1, ("40 Hz", "200 Hz"), "A has far less than B of every main line"),
        at_a_release(1, ("1 Hz", "350 Hz"), "A has far less than B of its upper main lines"),
    ],
)
@pytest.mark.parametrize("noise", [1e-7, 1e-4])
def test_a_recording_behind_a_low_pass_passes_no_limit_above_it(torque, order, band, told, noise):
    """State 1 has its slow lines then, and of those above a thirtieth and less."""
    verdict, said = beside_scenario(low_passed(torque, 10.0, order), noise, "30 mN*m", band=band)
    assert verdict == "not judged"
    assert told in said
    assert "does a filter in the chain or its passband hold them back" in said


def test_below_a_low_pass_lines_are_judged(torque):
    passed = low_passed(torque, 30.0, 4)
    assert beside_scenario(passed, 1e-6, "30 mN*m", band=("1 Hz", "20 Hz")) == ("pass", "")


@pytest.mark.parametrize("off", [0.985, 1.012])
def test_a_line_is_judged_where_it_is_read_and_where_the_step_clock_should_have_it(torque, off):
    """The drive may be off, or the recorder; a notch at either place fails or leaves it open."""
    read = Recording({"Mz": torque}, off * 2048.0, {"Mz": "N*m"}, "test")
    line = mv.find_lines("state-1", start="steady")["drive_1"]
    for at in (line.frequency, off * line.frequency):
        low, high = 0.999 * at, 1.001 * at
        inside = f"{0.5 * line.amplitude} N*m"
        ends = [
            ("1 Hz", "1 N*m"),
            (f"{low} Hz", "1 N*m"),
            (f"{high} Hz", "1 N*m"),
            ("300 Hz", "1 N*m"),
        ]
        notch = Limit.over_frequency(
            [*ends[:2], (f"{low} Hz", inside), (f"{high} Hz", inside), *ends[2:]]
        )
        assert judge_recording(read, notch, scenario="state-1").verdict != "pass"
        own = Limit(Si(0.5 * line.amplitude), Si(low), Si(high))
        assert judge_recording(read, own, scenario="state-1").verdict == "not judged"
        sides = (Prepared(read), mv.load_scenario("state-1"))
        assert judge_sides(sides, own, "Mz", None)[0].verdict == "not judged"
    both = Limit(Si(0.5 * line.amplitude), Si(40.0), Si(60.0))
    assert judge_recording(read, both, scenario="state-1").verdict == "fail"


def test_an_acceptance_test_looks_at_the_band_of_its_limit(torque):
    """The first run beside a reference that is a recording, too."""
    x = low_passed(torque, 30.0, 4) + 1e-6 * np.random.default_rng(0).normal(size=torque.size)
    sides = [Prepared(Recording({"Mz": y}, 2048.0, {"Mz": "N*m"}, "made")) for y in (torque, x)]
    compared = mv.compare(*sides, scenario="state-1")
    for ends, misread in (("40:200 Hz", True), ("1:20 Hz", False)):
        limit = Limit.of("30 mN*m", ends)
        found = AcceptanceTest((), "Mz", limit, None, compared, None)
        assert found.is_misread == misread
        assert bool(found.lacking_in_band) == misread
