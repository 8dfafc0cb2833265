"""Lines that a steady state has for a part of its cycle only: none passes a limit that a shorter record of the
same motion exceeds.
"""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from support.scenarios import limit_of

import microvib as mv
from microvib.analysis.limits import judge
from microvib.cli.main import main
from microvib.signals.intermittent import peaks_of_period
from microvib.signals.line_table import LineTable
from microvib.studies.campaign.cases import VERDICTS
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import merge, open_results
from microvib.studies.rates import PART_OF_TIME, full_case
from microvib.units import Si

COMPENSATION = {"driver.compensation": [{"order": 2, "amplitude": "30 arcsec"}]}
ERROR = {"reducer.transmission_error": [{"order": 2, "amplitude": "600 arcsec"}]}
BAND = (0.5, 150.0)


def series_of(x: np.ndarray) -> np.ndarray:
    """Complex amplitudes of one period's samples, up to two fifths of their rate."""
    return (np.fft.rfft(x) * (2.0 / x.size))[: round(0.4 * x.size)]


TIME = np.arange(8192) / 8192
COMB = 32
"""Order whose multiples a motion has that does not change."""


@pytest.mark.parametrize("depth", [0.1, 0.5, 2.0])
def test_a_line_that_comes_and_goes_has_its_largest_amplitude(depth):
    x = (1.0 + depth * np.cos(2.0 * np.pi * TIME)) * np.cos(2.0 * np.pi * 16 * COMB * TIME + 0.7)
    x += 0.2 * np.cos(2.0 * np.pi * 17 * COMB * TIME)  # which is there at all times
    frequency, amplitude = peaks_of_period(series_of(x), 2.0, COMB, 1.0 / 32.0)
    k = int(np.argmax(amplitude))
    assert amplitude[k] == pytest.approx(1.0 + depth, rel=0.02)
    assert frequency[k] == pytest.approx(16 * COMB * 2.0, abs=2.0)
    beside = np.abs(frequency - 17 * COMB * 2.0) < 8.0
    assert amplitude[beside].max(initial=0.0) < 0.25


def test_a_line_that_wanders_has_its_whole_amplitude_in_a_piece():
    x = np.cos(2.0 * np.pi * 16 * COMB * TIME + 20.0 * np.cos(2.0 * np.pi * TIME))
    series = series_of(x)
    assert np.abs(series).max() < 0.3
    frequency, amplitude = peaks_of_period(series, 1.0, COMB, 1.0 / 16.0)
    k = int(np.argmax(amplitude))
    assert amplitude[k] == pytest.approx(1.0, rel=0.1)
    assert abs(abs(frequency[k] - 16 * COMB) - 20.0) < 6.0  # where it turns back, and so stays


def test_nothing_is_larger_in_a_piece_of_what_is_there_at_all_times():
    x = sum(np.cos(2.0 * np.pi * k * COMB * TIME + k**2) / k for k in range(1, 60))
    assert not peaks_of_period(series_of(x), 1.0, COMB, 1.0 / 16.0)[0].size


@pytest.mark.parametrize("shortest", [1.0 / 8.1, 1.0 / 11.0, 1.0 / 15.9])
def test_pieces_are_as_short_as_tells_lines_apart_whatever_part_of_the_cycle_that_is(shortest):
    """What is there for a short time is the smaller the longer the piece is in which it is looked at."""
    swells = np.cos(np.pi * TIME) ** 80 * np.cos(2.0 * np.pi * 16 * COMB * TIME)
    _, amplitude = peaks_of_period(series_of(swells), 1.0, COMB, shortest)
    size = round(shortest * TIME.size)
    window, around = np.hanning(size), np.tile(swells, 2)
    largest = max(
        np.abs(np.fft.rfft(around[start : start + size] * window, 8 * size)).max()
        * 2.0
        / window.sum()
        for start in range(0, TIME.size, size // 16)
    )
    assert amplitude.max() == pytest.approx(largest, rel=0.05)


def largest_of_records(scenario: mv.Scenario, low: float, high: float) -> float:
    """Largest amplitude [N m] between two frequencies in any 1.25 to 5 s of a cycle of a run that has
    settled, by an own spectrum.
    """
    run = {"record.settle": "400 s", "record.duration": "35 s", "record.sample_rate": "512 Hz"}
    x = np.asarray(mv.simulate(scenario.with_(run), channels=("T_d",))["T_d"])
    found = 0.0
    for size in (640, 1280, 2560):
        at = np.fft.rfftfreq(4 * size, 1.0 / 512.0)
        for start in range(0, x.size - size, size // 8):
            piece = x[start : start + size]
            spectrum = np.abs(np.fft.rfft((piece - piece.mean()) * np.hanning(size), 4 * size))
            found = max(found, spectrum[(at > low) & (at < high)].max() * 4.0 / size)
    return float(found)


@pytest.fixture(scope="module")
def compensated(state_1) -> mv.Scenario:
    return state_1.with_(COMPENSATION | {"record.settle": "300 s"})


@pytest.fixture(scope="module")
def table(compensated) -> LineTable:
    return mv.find_lines(compensated, start="steady")


def test_a_steady_state_has_in_a_piece_what_a_short_record_has(compensated, table):
    largest = largest_of_records(compensated, 48.0, 58.0)
    assert table.pieces is not None
    assert max(x.amplitude for x in table if x.seen) < 0.3 * largest
    assert table.pieces.within(48.0, 58.0)[1] == pytest.approx(largest, rel=0.02)


def test_a_large_error_of_the_gear_makes_a_line_larger_in_a_piece(state_1):
    uneven = state_1.with_(ERROR | {"record.settle": "300 s"})
    found = mv.find_lines(uneven, start="steady")
    largest = largest_of_records(uneven, 52.0, 54.0)
    assert largest > 1.4 * found["drive_1"].amplitude
    assert found.pieces is not None
    assert found.pieces.within(52.9, 53.1)[1] == pytest.approx(largest, rel=0.02)
    assert judge(found, limit_of(0.9 * largest, 52.0, 54.0), uneven).verdict == "not judged"
    assert judge(found, limit_of(1.1 * largest, 52.0, 54.0), uneven).verdict == "pass"


def test_a_limit_that_a_piece_exceeds_is_not_passed(compensated, table):
    largest = max(x.amplitude for x in table if x.seen)
    judged = judge(table, limit_of(1.1 * largest, *BAND), compensated)
    assert judged.verdict == "not judged"
    assert "driver.compensation (order 2) changes the drive, up to 55" in str(judged)
    assert judge(table, limit_of(0.9 * largest, *BAND), compensated).verdict == "fail"
    assert judge(table, limit_of(0.060, *BAND), compensated).verdict == "pass"


def test_the_settling_time_decides_no_verdict_of_a_steady_state(state_1):
    """A steady state has no transient to wait for."""
    for settle in ("30 s", "300 s"):
        drive = state_1.with_(COMPENSATION | {"record.settle": settle})
        found = mv.find_lines(drive, start="steady")
        judged = judge(found, limit_of(0.060, 52.9, 53.1), drive)
        assert judged.verdict == "pass", str(judged)


def test_a_drive_that_nothing_changes_slowly_has_no_pieces(state_1):
    assert mv.find_lines(state_1, start="steady").pieces is None


def test_a_rate_at_which_a_piece_exceeds_the_limit_is_not_allowed(compensated):
    case = full_case(compensated, Si(compensated.rate or 0.0), 16)
    assert case.verdict(BAND, 0.014) == PART_OF_TIME
    assert case.verdict(BAND, 0.060) == ""


@pytest.mark.release
def test_a_campaign_of_steady_states_asks_for_pieces(tmp_path, compensated):
    (tmp_path / "study.yaml").write_text(
        "title: t\nscenario: state-1\n"
        "set: {driver.compensation: [{order: 2, amplitude: 30 arcsec}]}\n"
        "vary:\n  friction.viscous: {distribution: uniform, within: 20 percent}\n"
        "sampling: {method: random, count: 2, seed: 1}\n"
        'solve: steady\nlimit: 12 mN*m\nband: "53.5:56 Hz"\n'
    )
    folder = str(tmp_path / "campaign")
    for command in (
        ["create", str(tmp_path / "study.yaml"), folder],
        ["run", folder, "--workers", "1"],
    ):
        done = CliRunner().invoke(main, ["campaign", *command])
        assert done.exit_code == 0, done.output
    merge(open_campaign(tmp_path / "campaign"))
    found = open_results(open_campaign(tmp_path / "campaign"))
    assert [VERDICTS[k] for k in found.verdicts] == ["not judged"] * 2


def test_a_run_that_is_read_again_knows_its_pieces(tmp_path, compensated, table):
    out, limit = str(tmp_path / "run"), ["--limit", "10 mN*m", "--band", "0.5:150 Hz"]
    short = ["--set", "record.duration=2 s", "--set", "record.sample_rate=512 Hz"]
    given = ["--set", "driver.compensation=[{order: 2, amplitude: 30 arcsec}]", *short]
    done = CliRunner().invoke(main, ["run", "state-1", *given, "--steady", "-o", out, *limit])
    assert "lines of a part of the time" in done.output
    again = mv.read_run(out)
    assert again.table.pieces is not None
    judged = judge(again.table, limit_of(0.010, *BAND), again.motion.scenario)
    assert judged.verdict == "not judged"
    assert "in a piece of the steady state's cycle" in str(judged)
