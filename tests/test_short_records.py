"""A record too short for the lines of a drive: its verdicts never contradict those of a long one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner
from support.scenarios import limit_of
from support.tiers import sweep

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.lines import simulated_lines
from microvib.analysis.start import full_step_time
from microvib.analysis.stream import lines_of_stream
from microvib.cli.main import main
from microvib.io.runs import read_run
from microvib.model.slow_variations import slow_variations
from microvib.signals.line_fit import CANCELLED, SEPARATION, estimate_lines

SIMPLE = {"tracking.clock_ratio": 1.0, "motor.detent_torque": 0.02, "record.settle": 60.0}
DRIVES = {
    "full steps 1.16 Hz apart": SIMPLE
    | {
        "tracking.rate": 3.6335e-4,
        "reducer.stiffness": 1435.0,
        "friction.coulomb": 0.1,
        "friction.breakaway": 0.1,
        "array.rigid_inertia": None,
        "array.modes": [
            {"frequency": 0.3808, "damping": 0.0272, "effective_inertia": 2.305},
            {"frequency": 7.3, "damping": 0.0258, "effective_inertia": 2.51},
            {"frequency": 39.84, "damping": 0.0136, "effective_inertia": 2.685},
        ],
    },
    "three phases, driving lines 3.7 Hz apart": SIMPLE
    | {
        "motor.phases": 3,
        "driver.beats": 6,
        "driver.microsteps": 8,
        "driver.imperfections.gain_b": 0.0766,
        "tracking.rate": 9.7568e-5,
        "reducer.stiffness": 16549.0,
        "friction.coulomb": 0.0,
        "friction.breakaway": 0.0,
        "array.modes.0.frequency": 1.775,
        "array.modes.0.damping": 0.0202,
    },
}
TOP = 85.0
"""Edge of the passband of the short records [Hz], and a little less."""


@pytest.fixture(scope="module", params=DRIVES)
def drive(request, state_1) -> mv.Scenario:
    return state_1.with_si(DRIVES[request.param] | {"record.sample_rate": 256.0})


def recorded(drive: mv.Scenario, duration: float) -> mv.Motion:
    return mv.simulate(drive.with_si({"record.duration": duration}), channels=("T_d",))


@pytest.fixture(scope="module")
def known(drive: mv.Scenario) -> mv.LineTable:
    """Lines of a long record."""
    return mv.find_lines(recorded(drive, 30.0), harmonics=40)


def bands(frequency: float, resolution: float) -> list[tuple[float, float]]:
    """Bands about a line, narrower than the record resolves and wider, and all of the passband."""
    widths = (0.02 * resolution, 0.5 * resolution, 4.0 * resolution)
    each = [(max(frequency - 0.3 * w, 0.0), frequency + 0.7 * w) for w in widths]
    return [*each, (0.0, TOP)]


TWO_FULL_STEPS = "two full steps"


@pytest.mark.parametrize("duration", sweep([1.0, 1.5, TWO_FULL_STEPS], 1.5))
def test_a_short_record_does_not_contradict_a_long_one(drive, known, duration):
    enough = duration == TWO_FULL_STEPS
    if enough:
        slower = [one.cycle for one in slow_variations(drive)]
        duration = 2.05 * max(full_step_time(drive), *slower, 0.0)
    short = recorded(drive, duration)
    lines = [x for x in known if x.seen and x.place < TOP]
    lines = sorted(lines, key=lambda x: -x.amplitude)[:24:2]
    tables = [mv.find_lines(short, harmonics=harmonics) for harmonics in (1, 8)]
    judged = 0
    for x in lines:
        for part in (0.72, 0.95, 1.05, 30.0):
            for low, high in bands(x.place, 1.0 / duration):
                limit = limit_of(part * x.amplitude, low, min(high, TOP))
                of_long = judge(known, limit, drive).verdict
                for table in tables:
                    found = judge(table, limit, drive).verdict
                    assert {found, of_long} != {"pass", "fail"}, limit
                    judged += found != "not judged"
    assert judged > 20 or not enough


def of_tone(frequency: float, duration: float) -> mv.LineTable:
    """Lines of a tone of 13 mN m, of which nothing is known before."""
    t = np.arange(round(300.0 * duration)) / 300.0
    return estimate_lines(0.013 * np.cos(2.0 * math.pi * frequency * t + 0.4), 300.0, ())


def test_a_band_narrower_than_the_resolution_does_not_pass_beside_a_larger_line():
    limit = limit_of(0.001, 8.6577, 8.7271)
    for frequency in (6.4, 8.3, 8.9, 11.0):
        judged = judge(of_tone(frequency, 1.0), limit)
        assert judged.margins == ()
        assert judged.verdict == "not judged"
    needed = float(str(judge(of_tone(8.3, 1.0), limit)).split("record.duration >= ")[1].split()[0])
    assert needed == pytest.approx(SEPARATION / (8.6577 - 8.3), rel=0.01)
    assert judge(of_tone(8.3, 1.1 * needed), limit).verdict == "pass"
    assert judge(of_tone(15.0, 1.0), limit).verdict == "pass"


def test_lines_that_are_exact_leave_nothing_open_beside_them(state_1):
    exact = mv.find_lines(state_1, start="steady")
    assert exact.rest.resolution == 0.0
    line = exact["drive_1"]
    band = (line.place + 0.01, line.place + 0.02)
    assert judge(exact, limit_of(0.01 * line.amplitude, *band), state_1).verdict == "pass"


def test_a_peak_without_a_line_counts_with_what_it_may_hide(motion_1):
    table = mv.find_lines(motion_1, harmonics=1)
    assert table.rest.resolution == SEPARATION / table.duration
    frequency, amplitude = table.rest.within(60.0, 150.0)
    told = judge(table, limit_of(2.0 * amplitude, 0.999 * frequency, 1.001 * frequency))
    assert told.gaps[0].startswith("unexplained peaks, up to ")
    assert "where a line may have 3 times as much" in told.gaps[0]


def test_an_unlisted_line_beside_the_band_does_not_fail():
    table = of_tone(8.3, 1.0)
    line = table["other_1"]
    doubtful = limit_of(0.001, 8.3 + 2.0 * max(line.frequency_uncertainty, 1e-3), 9.0)
    assert judge(table, doubtful).verdict == "not judged"
    assert judge(table, limit_of(0.001, 8.2, 9.0)).verdict == "fail"


def test_blocks_of_a_long_record_resolve_no_more_than_one_of_them(state_1, monkeypatch):
    monkeypatch.setattr("microvib.analysis.stream.BLOCK_SAMPLES", 1024)
    short = state_1.with_si({"record.sample_rate": 256.0, "record.duration": 16.0})
    table = lines_of_stream(short, 3)[0]
    assert table.rest.resolution == pytest.approx(SEPARATION / 4.0)


@pytest.mark.parametrize("varies", [True, False])
def test_a_line_that_is_louder_in_a_block_counts_with_what_it_has_there(
    state_1, monkeypatch, varies
):
    """A limit between a line's mean over blocks and its loudest block passed it."""
    louder = iter([1.0, 1.5, 1.0, 1.0])
    monkeypatch.setattr("microvib.analysis.stream.BLOCK_SAMPLES", 4096)
    monkeypatch.setattr(
        "microvib.analysis.stream.simulated_lines",
        lambda x, *others: simulated_lines(next(louder) * x, *others),
    )
    slow = state_1.with_si({"record.sample_rate": 256.0, "record.duration": 64.0})
    if varies:
        slow = slow.with_si({"friction.position.harmonics": [{"order": 83, "amplitude": 0.01}]})
    table = lines_of_stream(slow, 3)[0]
    line = table["drive_1"]
    near = np.abs(table.rest.frequency - line.place) < 0.5
    loudest = table.rest.factor * np.max(table.rest.amplitude[near], initial=0.0)
    if varies:
        assert loudest == pytest.approx(1.5 / 1.125 * line.amplitude, rel=0.01)
    else:
        assert loudest < line.amplitude


def test_a_run_that_is_read_again_knows_its_resolution(tmp_path):
    out = tmp_path / "run"
    fast = ("record.settle=1 s", "record.duration=2 s", "record.sample_rate=256 Hz")
    options = [part for setting in fast for part in ("--set", setting)]
    done = CliRunner().invoke(main, ["run", "state-1", *options, "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert read_run(out).table.rest.resolution == SEPARATION / 2.0


def of_falling_tone(frequency: float, fall: np.ndarray) -> np.ndarray:
    """Samples (512,) at 128 Hz of a tone of 1 N m that falls, not exponentially, beside a steady one
    of 0.2 N m."""
    t = np.arange(fall.size) / 128.0
    beside = 0.2 * np.cos(2.0 * math.pi * 1.1 * frequency * t)
    return fall * np.cos(2.0 * math.pi * frequency * t + 0.7) + beside


FALLS = {
    "linear": lambda t, most: np.maximum(1.0 - t / most, 0.0),
    "Gaussian": lambda t, most: np.exp(-((t / most) ** 2)),
}


@pytest.mark.parametrize("fall", FALLS)
def test_no_line_is_larger_than_what_is_recorded(fall):
    """Tones on one frequency that cancel describe a tone that falls unlike an exponential."""
    t = np.arange(512) / 128.0
    for most in np.linspace(1.0, 6.0, 11):
        for frequency in (7.3946, 15.0348, 20.6584, 30.1926):
            x = of_falling_tone(frequency, FALLS[fall](t, most))
            for line in estimate_lines(x, 128.0, ()):
                assert not line.amplitude > 3.0, (most, frequency)


def test_lines_that_cancel_are_told_and_not_failed(monkeypatch):
    """Where the search lets two tones become one, each far larger than what is recorded."""
    monkeypatch.setattr("microvib.signals.line_search._SAME_TONE_DISTANCE", 0.0)
    t = np.arange(512) / 128.0
    tables = [
        estimate_lines(of_falling_tone(f, FALLS["linear"](t, most)), 128.0, ())
        for most in np.linspace(1.0, 6.0, 11)
        for f in (7.3946, 15.0348, 20.6584, 30.1926)
    ]
    cancelled = [x for x in tables if any(line.status == CANCELLED for line in x)]
    assert cancelled
    for table in cancelled:
        assert table.largest < 3.0
        line = next(x for x in table if x.status == CANCELLED)
        band = line.place - 0.1, line.place + 0.1
        bound = 10.0 * line.bin_amplitude
        told = f"{line.name} ({CANCELLED})"
        assert told in judge(table, limit_of(0.5 * bound, *band)).gaps
        assert told not in judge(table, limit_of(1.01 * bound, *band)).gaps
