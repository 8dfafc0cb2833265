"""A record that holds a part of what changes the drive slowly: its verdicts never contradict those of
whole cycles.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner
from support.scenarios import baseline, limit_of
from support.slow_drives import ERROR_OF_GEAR, ERROR_OF_TWO_CYCLES, FRICTION_OVER_ANGLE, drawn

import microvib as mv
from microvib.analysis.limits import judge
from microvib.analysis.start import VARIATION_FACTOR, record_gap, with_full_steps
from microvib.cli.main import main
from microvib.model.slow_variations import slow_variations, unseen_variations
from microvib.signals.intermittent import intermittent_peaks
from microvib.signals.line_table import Line, LineTable
from microvib.signals.tones import HannSpectrum
from microvib.studies.campaign.cases import RECORDS, VERDICTS
from microvib.studies.campaign.folder import open_campaign
from microvib.studies.campaign.results import merge, open_results
from microvib.studies.campaign.statistics import ABOVE, UNKNOWN, line_verdicts
from microvib.studies.rates import RECORD_GAP, RateCase, RateLine, full_case
from microvib.units import Si

THIRD_MICROSTEPS = (31.6, 33.4)
"""Band [Hz] in which the drive has a line where it slips at every third microstep."""
SETTLES = ("14.6 s", "20 s", "26 s", "32 s", "38 s", "44 s", "50 s", "56 s")
"""Times over a cycle of the friction."""


@pytest.fixture(scope="module")
def over_angle() -> mv.Scenario:
    return drawn(FRICTION_OVER_ANGLE)


@pytest.fixture(scope="module")
def of_gear() -> mv.Scenario:
    return drawn(ERROR_OF_GEAR)


def lines_of(scenario: mv.Scenario, **record: str) -> LineTable:
    changed = scenario.with_({f"record.{key}": value for key, value in record.items()})
    return mv.find_lines(mv.simulate(changed, channels=("T_d",)))


def largest_of_a_part(scenario: mv.Scenario, band: tuple[float, float]) -> float:
    """Largest amplitude [N m] in the band in any 6 s of two cycles, from their own spectra."""
    whole = scenario.with_({"record.duration": "91.2 s", "record.sample_rate": "512 Hz"})
    x = np.asarray(mv.simulate(whole, channels=("T_d",))["T_d"])
    size, found = 6 * 512, 0.0
    for start in range(0, x.size - size, size // 8):
        piece = x[start : start + size]
        spectrum = np.abs(np.fft.rfft((piece - piece.mean()) * np.hanning(size))) * 4.0 / size
        at = np.fft.rfftfreq(size, 1.0 / 512.0)
        found = max(found, float(spectrum[(at > band[0]) & (at < band[1])].max()))
    return found


@pytest.mark.parametrize("settle", SETTLES)
def test_no_part_of_a_cycle_passes_what_another_part_fails(over_angle, settle):
    for duration in ("1.826 s", "6 s"):
        table = lines_of(over_angle, settle=settle, duration=duration)
        judged = judge(table, limit_of(0.1, *THIRD_MICROSTEPS), over_angle)
        assert judged.verdict != "pass"
        assert "friction.position (order 71) repeats after 45.59 s" in str(judged)
        assert "record.duration >= 91.2 s" in str(judged)


def test_whole_cycles_pass_only_what_no_part_of_them_exceeds(over_angle):
    largest = largest_of_a_part(over_angle, THIRD_MICROSTEPS)
    assert largest > 0.2
    for settle in ("14.6 s", "32 s"):
        table = lines_of(over_angle, settle=settle, duration="91.3 s", sample_rate="512 Hz")
        lines = [x.amplitude for x in table if 31.6 < x.place < 33.4]
        assert max(lines, default=0.0) < 0.5 * largest
        for part, verdict in ((0.5, "not judged"), (0.9, "not judged"), (1.4, "pass")):
            judged = judge(table, limit_of(part * largest, *THIRD_MICROSTEPS), over_angle)
            assert judged.verdict == verdict, (settle, part)
    assert "friction.position (order 71) changes the drive" in str(
        judge(table, limit_of(0.9 * largest, *THIRD_MICROSTEPS), over_angle)
    )


def test_rates_record_whole_cycles_and_forbid_what_a_part_of_them_makes(over_angle):
    plan = mv.plan_rates(
        over_angle, ["0.111213 deg/s"], limit="100 mN*m", band=THIRD_BAND, workers=None
    )
    (case,) = plan.cases
    assert case.gap is None
    assert plan.forbidden


THIRD_BAND = "31.6:33.4 Hz"


@pytest.mark.release
def test_a_campaign_of_short_records_passes_nothing(tmp_path):
    (tmp_path / "drive.yaml").write_text(FRICTION_OVER_ANGLE)
    (tmp_path / "study.yaml").write_text(
        "title: t\nscenario: drive.yaml\nset: {record.settle: 47 s, record.duration: 3 s}\n"
        "vary:\n  reducer.stiffness: {distribution: uniform, within: 0.1 percent}\n"
        "sampling: {method: random, count: 3, seed: 1}\n"
        'limit: 100 mN*m\nband: "31.6:33.4 Hz"\n'
    )
    folder = str(tmp_path / "campaign")
    done = CliRunner().invoke(main, ["campaign", "create", str(tmp_path / "study.yaml"), folder])
    assert done.exit_code == 0, done.output
    done = CliRunner().invoke(main, ["campaign", "run", folder, "--workers", "1"])
    assert done.exit_code == 0, done.output
    merge(open_campaign(tmp_path / "campaign"))
    found = open_results(open_campaign(tmp_path / "campaign"))
    assert [VERDICTS[k] for k in found.verdicts] == ["not judged"] * 3
    assert {RECORDS[k] for k in found.records} == {"holds a part of a slow cycle"}
    everywhere = np.full(3, UNKNOWN)
    drive_1 = found.of("drive_1")
    for part, verdict in ((0.9, UNKNOWN), (1.1, UNKNOWN), (0.9 / VARIATION_FACTOR, ABOVE)):
        limit = part * float(np.median(drive_1))
        verdicts = line_verdicts(found, "drive_1", limit, (0.0, math.inf), everywhere)
        assert set(verdicts.tolist()) == {verdict}, part


def test_an_error_of_the_gear_is_not_judged_by_a_fifth_of_its_cycle(of_gear):
    short = lines_of(of_gear, duration="3.401 s")
    known = lines_of(of_gear, duration="64.3 s", sample_rate="512 Hz")["drive_2"].amplitude
    assert short["drive_2"].amplitude < 0.9 * known
    judged = judge(short, limit_of(0.9 * known, 60.0, 70.0), of_gear)
    assert judged.verdict == "not judged"
    assert "reducer.transmission_error (order 3) repeats after 16.06 s" in str(judged)
    assert "record.start: steady" in str(judged)


def test_a_line_smaller_over_whole_cycles_does_not_fail_by_a_part():
    drive = drawn(ERROR_OF_TWO_CYCLES)
    short, long = (lines_of(drive, duration=t)["drive_2"].amplitude for t in ("9.873 s", "60.5 s"))
    assert short > 1.03 * long
    limit = limit_of(0.5 * (short + long), 30.0, 34.0)
    table = lines_of(drive)
    assert judge(table, limit, drive).verdict == "not judged"
    assert judge(lines_of(drive, duration="60.5 s"), limit, drive).verdict != "fail"
    far = limit_of(0.9 * short / VARIATION_FACTOR, 30.0, 34.0)
    assert judge(table, far, drive).verdict == "fail"


def test_two_parts_of_a_cycle_do_not_differ_significantly(of_gear):
    parts = [
        mv.simulate(of_gear.with_({"record.settle": settle}), channels=("T_d",))
        for settle in ("107.6 s", "115.6 s")
    ]
    found = mv.compare(*parts)
    (row,) = (x for x in found.rows if x.line == "drive_2")
    assert row.significance > 5.0
    assert row.verdict == "not judged"
    assert "hold at the angles of the record alone" in " ".join(found.a.notes)


def test_a_steady_state_has_whole_cycles(of_gear):
    """Between the line of whole cycles and the largest of a part it is not judged."""
    table = mv.find_lines(of_gear, start="steady")
    line = table["drive_2"]
    assert 1.05 * line.amplitude < largest_of_a_part(of_gear, (60.0, 70.0)) < 1.3 * line.amplitude
    for part, verdict in ((0.9, "fail"), (1.05, "not judged"), (1.3, "pass")):
        assert judge(table, limit_of(part * line.amplitude, 60.0, 70.0), of_gear).verdict == verdict


def test_cycles_of_an_error_of_the_gear(state_1):
    turn = 50 * 4 * state_1.driver.microsteps / state_1.driving_frequency

    def longest(order: int, **more: object) -> float:
        error = [{"order": order, "amplitude": "5 arcsec"}]
        changed = state_1.with_({"reducer.transmission_error": error, **more})
        return slow_variations(changed)[0].cycle

    assert longest(2) == pytest.approx(turn / 2)
    assert longest(199) == pytest.approx(turn)  # one less than the full steps of a turn
    assert longest(101) == pytest.approx(turn / 2)  # twice that is two more than they are
    assert longest(71) == pytest.approx(turn / 13)  # three times it is 13 more
    no_detent = state_1.with_({"motor.detent_torque": "0 N*m"})
    error = {"reducer.transmission_error": [{"order": 230, "amplitude": "5 arcsec"}]}
    assert slow_variations(no_detent.with_(error)) == []  # faster than a full step takes


def test_friction_over_the_angle_repeats_with_the_output(state_1):
    turn = 2.0 * math.pi / state_1.rate
    uneven = {"friction.position": {"harmonics": [{"order": 3, "amplitude": 0.1}]}}
    (found,) = slow_variations(state_1.with_(uneven))
    assert found.cycle == pytest.approx(turn / 3)
    frictionless = {"friction.slip_ring": None, "friction.coulomb": "0 N*m"} | {
        "friction.breakaway": "0 N*m",
        "friction.viscous": "0 N*m*s/rad",
    }
    assert slow_variations(state_1.with_({**uneven, **frictionless})) == []


def test_roughness_repeats_after_a_turn_whatever_its_cycles_are(state_1):
    turn = 2.0 * math.pi / state_1.rate
    for lowest, highest in ((1.0, 1000.0), (15000.0, 15040.0)):
        rough = {"density": 1e-6, "lowest": lowest, "highest": highest}
        (found,) = slow_variations(state_1.with_({"friction.position.roughness": rough}))
        assert found.cycle == pytest.approx(turn)
        weak = {**rough, "density": 1e-12 if highest < 5000.0 else 1e-18}
        assert slow_variations(state_1.with_({"friction.position.roughness": weak})) == []


def test_what_is_negligible_together_is_left_out(state_1):
    def cycles(*amplitudes: float) -> list[float]:
        rows = [{"order": k, "amplitude": a} for k, a in enumerate(amplitudes, 1) if a]
        return [x.cycle for x in slow_variations(state_1.with_({"friction.position.harmonics": rows}))]  # fmt: skip

    turn = 2.0 * math.pi / state_1.rate
    assert cycles(0.0004, 0.0004) == []
    assert cycles(0.0004, 0.0008) == pytest.approx([turn / 2])
    assert cycles(0.0004, 0.0, 0.1) == pytest.approx([turn / 3])


def test_a_thousandth_of_a_large_friction_is_a_line_beside_that_of_the_full_steps(state_1):
    """Three cycles a turn from the order of the full steps it adds to their line and takes from it for an hour."""
    order = round(4.0 * 50.0 * state_1.reducer.ratio) + 3
    rows = [{"order": order, "amplitude": 5e-4}]
    large = {"friction.coulomb": "5 N*m", "friction.breakaway": "5 N*m"}
    rubbing = state_1.with_({**large, "friction.position.harmonics": rows})
    (found,) = slow_variations(rubbing)
    assert found.cycle == pytest.approx(2.0 * math.pi / state_1.rate / 3.0)
    assert record_gap(rubbing, 30.0)


@pytest.mark.parametrize("key", ["driver.compensation", "reducer.transmission_error"])
def test_a_small_error_is_a_line_beside_that_of_the_full_steps(state_1, key):
    """It changes the rate by less than a thousandth, and once a turn of the rotor it cancels their line."""
    full_steps = 4 * state_1.motor.rotor_teeth
    rows = [{"order": full_steps + 1, "amplitude": Si(4.7e-8)}]
    found = slow_variations(state_1.with_({key: rows}))[0]
    assert found.share < 1e-3
    turn = 2.0 * math.pi / (state_1.rate * state_1.reducer.ratio)
    assert found.cycle == pytest.approx(turn)
    far = [{"order": full_steps // 2 + 1, "amplitude": Si(4.7e-8)}]
    assert not unseen_variations(state_1.with_({"reducer.transmission_error": far}), 2.0)


def test_two_small_errors_are_lines_beside_each_other(state_1):
    orders = (15_003, 15_004)
    rows = [{"order": order, "amplitude": 4e-4} for order in orders]
    found = slow_variations(state_1.with_({"friction.position.harmonics": rows}))
    assert found[0].cycle == pytest.approx(2.0 * math.pi / state_1.rate)


def test_unequal_phases_take_an_electrical_turn(state_1):
    (found,) = slow_variations(state_1.with_({"driver.imperfections.gain_b": "2 percent"}))
    electrical = 4 * state_1.driver.microsteps / state_1.driving_frequency
    assert found.cycle == pytest.approx(0.5 * electrical) or found.cycle == pytest.approx(
        electrical
    )
    assert slow_variations(state_1) == []


def test_two_cycles_are_enough_and_less_is_not(of_gear):
    cycle = slow_variations(of_gear)[0].cycle
    assert unseen_variations(of_gear, 2.0 * cycle) == []
    assert [one.cycle for one in unseen_variations(of_gear, 1.9 * cycle)] == [cycle]
    share = slow_variations(of_gear)[0].share
    assert record_gap(of_gear, 1.9 * cycle).overstated == pytest.approx(1.0 + 6.0 * share)


def test_a_hann_window_over_two_cycles_weighs_all_parts_of_a_cycle_alike():
    cycle, fs, m = 4.0, 256.0, 0.4

    def amplitude(cycles: float, phase: float) -> float:
        t = np.arange(round(cycles * cycle * fs)) / fs
        swells = 1.0 + m * np.cos(2.0 * math.pi * t / cycle + phase)
        spectrum = HannSpectrum.of(swells * np.cos(2.0 * math.pi * 32.0 * t), fs)
        return float(spectrum.magnitude[round(32.0 * cycles * cycle)])

    phases = np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False)
    whole, half = ([amplitude(n, p) for p in phases] for n in (2.0, 1.0))
    assert np.ptp(whole) < 1e-3
    assert whole[0] == pytest.approx(1.0, abs=1e-3)
    assert np.ptp(half) > 0.9 * m


def tone(t: np.ndarray, frequency: float) -> np.ndarray:
    return np.cos(2.0 * math.pi * frequency * t + 0.7)


def test_a_tone_of_a_part_of_the_time_is_found_with_its_amplitude():
    fs, cycle = 256.0, 32.0
    t = np.arange(round(2 * cycle * fs)) / fs
    there = (t % cycle > 10.0) & (t % cycle < 15.0)
    x = 0.3 * tone(t, 20.0) + there * tone(t, 33.3)
    f, a = intermittent_peaks(x, fs, (), cycle, 1.0)
    k = int(np.argmax(a))
    assert f[k] == pytest.approx(33.3, abs=0.3)
    assert a[k] == pytest.approx(1.0, abs=0.05)
    assert np.max(a[np.abs(f - 20.0) < 1.0], initial=0.0) < 0.1  # steady, of 0.3


def test_nothing_comes_and_goes_in_steady_tones_nor_in_noise():
    fs, cycle = 256.0, 32.0
    t = np.arange(round(2 * cycle * fs)) / fs
    x = 0.3 * tone(t, 20.0) + tone(t, 33.3)
    assert np.max(intermittent_peaks(x, fs, (), cycle, 1.0)[1], initial=0.0) < 1e-3
    noise = np.random.default_rng(1).standard_normal(t.size)
    bins = HannSpectrum.of(noise, fs).magnitude
    floor = np.array([1.0, 128.0]), np.full(2, float(np.median(bins)))
    assert not intermittent_peaks(noise, fs, (), cycle, 1.0, noise=floor)[0].size


def test_a_plan_records_two_cycles_where_that_takes_little(of_gear):
    longer = with_full_steps(of_gear, 4).record.duration
    assert longer == pytest.approx(2.0 * slow_variations(of_gear)[0].cycle)
    slow = of_gear.with_({"tracking.rate": "0.001 deg/s"})
    assert with_full_steps(slow, 4).record.duration < 300.0
    assert with_full_steps(of_gear, 0) is of_gear


def test_a_rate_with_a_part_of_a_cycle_is_not_called_above_the_limit_for_a_line_near_it(over_angle):
    line = RateLine("drive_1", "drive", 1.0, 100.0, 0.12)
    gap = record_gap(over_angle, 3.0)
    case = RateCase(1e-3, 16, (line,), "no steady state", gap=gap)
    assert case.verdict((0.0, math.inf), 0.1) == RECORD_GAP
    assert case.verdict((0.0, math.inf), 0.02) == "a line is above the limit"


def test_a_rate_whose_cycle_takes_too_long_is_not_judged(state_1):
    uneven = {"friction.position": {"harmonics": [{"order": 1, "amplitude": 0.05}]}}
    short = state_1.with_({**uneven, "record.settle": "30 s", "record.duration": "4 s"})
    case = full_case(short, Si(state_1.rate), 16)
    assert case.gap is not None
    assert "friction.position: null" in case.gap.why
    assert case.verdict((0.0, math.inf), 10.0) == RECORD_GAP


def test_a_line_that_swells_counts_with_what_it_has_at_all_times():
    fs = 256.0
    t = np.arange(16384) / fs
    swells = (1.0 + 0.5 * np.sign(np.sin(2.0 * math.pi * t / 32.0))) * np.cos(
        2.0 * math.pi * 20.0 * t
    )
    steady = Line("drive_1", "drive", frequency=20.0, amplitude=1.0, phase=0.0, decay=0.0)
    with_line = intermittent_peaks(swells, fs, (), 32.0, 1.0)[1].max()
    without = intermittent_peaks(swells, fs, (steady,), 32.0, 1.0)[1]
    assert with_line == pytest.approx(1.5, abs=0.05)
    assert np.max(without, initial=0.0) == pytest.approx(1.5, abs=0.05)


def slowest_of(drive: mv.Scenario) -> tuple[str, float]:
    """What changes the drive slowest, and its cycle [s]."""
    first = slow_variations(drive)[0]
    return first.what, first.cycle


def friction_of_orders(*orders: int) -> dict[str, object]:
    return {
        "friction.coulomb": 1.0,
        "friction.breakaway": 1.0,
        "friction.position": {"harmonics": [{"order": n, "amplitude": 0.1} for n in orders]},
    }


def test_two_variations_that_hardly_differ_repeat_after_their_beat():
    """At 0.06 deg/s a turn takes 6000 s; two lines a turn apart, 2.5 Hz, make one that swells over it."""
    drive = baseline().with_si(friction_of_orders(15010, 15011))
    turn = 2.0 * math.pi / abs(drive.rate)
    what, cycle = slowest_of(drive)
    assert what == "friction.position (order 15010) beside friction.position (order 15011)"
    assert cycle == pytest.approx(turn, rel=1e-9)
    assert slowest_of(baseline().with_si(friction_of_orders(15010)))[1] < 0.11 * turn


@pytest.mark.parametrize(
    "torque",
    [
        {"motor.detent_torque": 0.01},
        {"motor.detent_torque": 0.0, "motor.detent": [{"order": 4, "amplitude": 0.01}]},
        {"motor.detent_torque": 0.0, "motor.flux_harmonics": [{"order": 3, "amplitude": 0.05}]},
    ],
    ids=["detent torque", "detent harmonics", "flux harmonics"],
)
def test_friction_beside_a_torque_of_the_motor_repeats_after_their_beat(torque):
    """20000 cycles per turn of the output are a full step; ten more meet it anew ten times a turn."""
    drive = baseline().with_si({**torque, **friction_of_orders(20010)})
    assert slowest_of(drive)[1] == pytest.approx(2.0 * math.pi / abs(drive.rate) / 10.0, rel=1e-9)


def test_a_harness_pulls_more_as_the_array_turns():
    drive = baseline().with_si({"friction.harness": {"stiffness": 4.0}})
    gap = record_gap(drive, 300.0)
    assert gap is not None
    assert "friction.harness pulls more" in gap.why
    assert record_gap(baseline().with_si({"friction.harness": {"stiffness": 1e-4}}), 300.0) is None
