"""Orders through a rate sweep against what the record was made of, a Vold-Kalman filter, and runs at
constant rates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import bilinear, lfilter
from support.tiers import sweep
from support.vold_kalman import vold_kalman

import microvib as mv
from microvib.errors import MicrovibError, OptionError
from microvib.io.recordings import Prepared
from microvib.signals.order_spectrum import at_equal_angles, order_map
from microvib.signals.order_tracking import track_components
from microvib.signals.sweep_clock import revolutions
from microvib.studies.speed_reference import of_tacho, stated_speed
from microvib.studies.track import (
    BEYOND,
    IN_FLOOR,
    NOT_SEPARABLE,
    TRACKED,
    OrderTracking,
    track_orders,
)
from microvib.testdata.section import Section

CHIRP = {0.5: 0.5, 1.0: 1.0, 4.0: np.sqrt(2.0), 6.0: 2.0}
"""Orders and amplitudes of the chirp in the documentation of MATLAB's ``ordertrack``: 10 to 40
revolutions per second in 5 s, 600 samples a second."""
PROFILE = "0 s:10 Hz, 5 s:40 Hz"


def chirp(ratio=1.0, noise=0.0, seed=0, late=0.0, orders=CHIRP):
    """The published chirp; its clock faster by ``ratio``, and as many seconds ``late``."""
    rng = np.random.default_rng(seed)
    t = np.arange(3001) / 600.0
    turns = ratio * (10.0 * (t - late) + 3.0 * (t - late) ** 2)
    x = noise * rng.normal(size=t.size)
    for order, size in orders.items():
        x += size * np.cos(2.0 * np.pi * order * turns + rng.uniform(0.0, 6.3))
    return mv.Recording({"Mz": x, "turns": turns, "rpm": 60.0 * ratio * (10.0 + 6.0 * (t - late))},
                        600.0, {"Mz": "N*m", "turns": "rad", "rpm": "rpm"}, "chirp")  # fmt: skip


def errors(found: OrderTracking, truth=CHIRP) -> dict[float, np.ndarray]:
    """Relative errors of the amplitudes, where they are told."""
    return {x.order: x.amplitude[x.known] / truth[x.order] - 1.0 for x in found.cuts}


def test_the_published_chirp_without_noise():
    found = track_orders(Prepared(chirp()), list(CHIRP), profile=PROFILE, clock="stated")
    for order, error in errors(found).items():
        assert np.max(np.abs(error)) < 1e-4, order
        assert np.all(found.cut(order).finding == TRACKED)


@pytest.mark.parametrize("reference", [{"profile": PROFILE}, {"speed": "rpm"}, {"strongest": 6.0}])
def test_the_published_chirp_with_noise_is_recovered_within_a_percent(reference):
    found = track_orders(Prepared(chirp(1.004, 0.1, late=0.02)), list(CHIRP), **reference)
    for order, error in errors(found).items():
        assert abs(np.mean(error)) < 0.01, order
        cut = found.cut(order)
        away = (cut.amplitude - CHIRP[order]) / cut.uncertainty
        assert np.mean(np.abs(away) < 2.0) > 0.8, order
        assert np.std(error) < 0.02 / CHIRP[order]


@settings(max_examples=15, deadline=None)
@given(
    ratio=st.floats(0.985, 1.015),
    late=st.floats(-0.04, 0.04),
    noise=st.floats(0.0, 0.12),
    seed=st.integers(0, 10_000),
)
def test_drawn_clock_errors_are_found(ratio, late, noise, seed):
    record = chirp(ratio, noise, seed, late)
    found = track_orders(Prepared(record), list(CHIRP), profile=PROFILE)
    true = ratio * (10.0 + 6.0 * (np.arange(3001) / 600.0 - late))
    assert np.max(np.abs(found.reference.speed(600.0) / true - 1.0)[3:-3]) < 1e-3
    for order, error in errors(found).items():
        # four standard errors of a mean of some 20 independent points, of what the noise makes of each
        allowed = 0.002 + 4.0 * np.mean(found.cut(order).uncertainty) / np.sqrt(20.0) / CHIRP[order]
        assert abs(np.mean(error)) < allowed, order


def test_a_clock_taken_as_stated_loses_what_one_that_is_found_does_not():
    record = Prepared(chirp(1.012, 0.02))
    lost = track_orders(record, list(CHIRP), profile=PROFILE, clock="stated", bandwidth="2 Hz")
    found = track_orders(record, list(CHIRP), profile=PROFILE, bandwidth="2 Hz")
    assert np.mean(errors(lost)[6.0]) < -0.3
    assert abs(np.mean(errors(found)[6.0])) < 0.01


def test_a_clock_that_is_not_near_the_profile_is_refused():
    noise = mv.Recording({"Mz": np.random.default_rng(1).normal(size=3001)}, 600.0, {"Mz": "N*m"})
    with pytest.raises(MicrovibError, match="no order is above the noise floor within 2 %"):
        track_orders(Prepared(noise), [1.0, 4.0], profile=PROFILE)


@pytest.mark.parametrize(
    "profile", ["0 s:40 Hz, 5 s:10 Hz", "0 s:12 Hz, 5 s:40 Hz", "0 s:10 Hz, 5 s:45 Hz"]
)
def test_a_wrong_profile_does_not_wander_to_other_orders(profile):
    with pytest.raises(MicrovibError, match="no order is above the noise floor within 2 %"):
        track_orders(chirp(1.004, 0.1), [1, 4], profile=profile)


def test_orders_that_are_not_separable_do_not_pull_the_clock():
    close = {4.0: 1.0, 4.02: 0.7, 6.0: 2.0}
    found = track_orders(chirp(noise=0.02, orders=close), list(close), profile=PROFILE)
    assert np.max(np.abs(found.reference.clock.correction)) < 5e-3


def test_a_line_beyond_the_bandwidth_is_no_noise():
    """Ten times as large, and twice the bandwidth away: what is beside it is told as well as ever."""
    t = np.arange(3001) / 600.0
    rng = np.random.default_rng(3)
    x = np.cos(2.0 * np.pi * 50.0 * t) + 0.01 * rng.normal(size=t.size)
    near = x + 10.0 * np.cos(2.0 * np.pi * 52.2 * t)
    u = []
    for samples in (x, near):
        record = mv.Recording({"Mz": samples}, 600.0, {"Mz": "N*m"}, "r")
        found = track_orders(record, [5], profile="0 s:10 Hz", clock="stated", bandwidth="1 Hz")
        inner = slice(4, -4)
        u.append(np.median(found.cuts[0].uncertainty[inner]))
        assert np.max(np.abs(found.cuts[0].amplitude - 1.0)[inner]) < 0.1
    assert u[1] < 0.1


def test_a_vold_kalman_filter_finds_the_same():
    record = chirp(noise=0.05, seed=4)
    phases = 2.0 * np.pi * np.outer(list(CHIRP), record["turns"])
    ours = track_components(record["Mz"], 600.0, phases, np.ones(phases.shape, bool), 2.0)
    theirs = np.abs(vold_kalman(record["Mz"], 600.0, phases, 2.0))
    inner = (ours.time > 0.5) & (ours.time < 4.5)
    at = np.rint(ours.time * 600.0).astype(int)[inner]
    for k, size in enumerate(CHIRP.values()):
        own = np.abs(ours.amplitude[k])[inner] - size
        other = theirs[k, at] - size
        assert np.sqrt(np.mean((own - other) ** 2)) < 2.0 * np.mean(ours.noise[k])
        assert np.sqrt(np.mean(own**2)) < 1.5 * np.sqrt(np.mean(other**2))


def resonant_sweep(seed=0, noise=0.02, crossing=0.0):
    """Orders 1, 2 and 4 from 4 to 16 Hz in 60 s, which a resonance of 24 Hz answers to (2 % of
    critical damping); and a line of 31 Hz."""
    rate, duration = 256.0, 60.0
    t = np.arange(round(rate * duration)) / rate
    speed = 4.0 + 12.0 * t / duration
    turns = revolutions(speed, rate)
    rng = np.random.default_rng(seed)
    x = noise * rng.normal(size=t.size) + crossing * np.cos(2.0 * np.pi * 31.0 * t + 1.0)
    truth = {}
    for order in (1.0, 2.0, 4.0):
        r = order * speed / 24.0
        H = 1.0 / (1.0 - r**2 + 0.1j * r)
        truth[order] = np.abs(H)
        x += np.real(H * np.exp(2j * np.pi * order * turns))
    return mv.Recording({"Mz": x}, rate, {"Mz": "N*m"}, "sweep"), truth, speed


def test_orders_that_cross_a_resonance():
    record, truth, speed = resonant_sweep()
    found = track_orders(
        Prepared(record), [1, 2, 4], profile="0 s:4 Hz, 60 s:16 Hz", bandwidth="2.5 Hz"
    )
    at = np.minimum(np.rint(256.0 * found.cuts[0].time).astype(int), speed.size - 1)
    for cut in found.cuts:
        away = np.abs(cut.amplitude - truth[cut.order][at])
        assert np.mean(away[cut.known] < 2.5 * cut.uncertainty[cut.known] + 1e-3) > 0.9
    [only] = [one for one in found.resonances if "several" in one.what]
    assert only.orders == "2, 4" or only.orders == "4, 2"
    assert only.frequency == pytest.approx(24.0, rel=0.01)
    for one in found.maxima:
        if one.order in ("2", "4"):
            assert one.amplitude == pytest.approx(10.0, abs=max(3.0 * one.uncertainty, 0.1))
            assert "crosses 2" in one.what


def test_an_order_that_crosses_a_line_is_told_from_it():
    record, truth, speed = resonant_sweep(crossing=1.0)
    profile = {"profile": "0 s:4 Hz, 60 s:16 Hz", "bandwidth": "1 Hz"}
    alone = track_orders(Prepared(record), [1, 2, 4], **profile)
    both = track_orders(Prepared(record), [1, 2, 4], fixed=["31 Hz"], **profile)

    def worst(found):
        cut = found.cut(4.0)
        at = np.rint(256.0 * cut.time).astype(int)
        near = np.abs(cut.frequency - 31.0) < 1.5
        return np.max(np.abs(cut.amplitude - truth[4.0][np.minimum(at, speed.size - 1)])[near])

    assert worst(alone) > 0.3
    assert worst(both) < 0.2
    # and alone, the line that is not tracked is in the uncertainty
    cut = alone.cut(4.0)
    near = np.abs(cut.frequency - 31.0) < 1.0
    far = (cut.frequency > 40.0) & (cut.frequency < 50.0)
    assert np.max(cut.uncertainty[near]) > 5.0 * np.median(cut.uncertainty[far])


def test_orders_too_close_for_the_record_are_not_separable():
    close = {4.0: 1.0, 4.02: 0.7, 6.0: 2.0}
    found = track_orders(Prepared(chirp(noise=0.02, orders=close)), list(close), profile=PROFILE)
    assert np.mean(found.cut(4.0).finding == NOT_SEPARABLE) > 0.9
    assert np.mean(found.cut(6.0).finding == TRACKED) > 0.95
    assert any("order 4 is not separable from order 4.02" in note for note in found.notes)
    words = {one.order: one.what for one in found.maxima}
    assert "not judged" in words["4"] or "of the" in words["4"]


def test_orders_that_become_separable_with_the_speed():
    close = {4.0: 1.0, 4.3: 0.7, 6.0: 2.0}
    found = track_orders(
        Prepared(chirp(noise=0.02, orders=close)), list(close), profile=PROFILE, bandwidth="5 Hz"
    )
    cut = found.cut(4.0)
    lost = cut.finding == NOT_SEPARABLE
    assert np.all(lost[cut.speed < 12.0])
    assert not np.any(lost[(cut.speed > 25.0) & (cut.speed < 38.0)])
    told = cut.finding == TRACKED
    away = np.abs(cut.amplitude - 1.0) / cut.uncertainty
    assert np.mean(away[told] < 3.0) > 0.85


def test_an_order_that_is_not_there_is_in_the_floor():
    found = track_orders(Prepared(chirp(noise=0.1)), [*CHIRP, 2.5], profile=PROFILE)
    absent = found.cut(2.5)
    assert np.mean(absent.finding == IN_FLOOR) > 0.8
    assert np.median(absent.amplitude) < 0.1


def test_orders_above_the_usable_frequencies_are_not_tracked_there():
    found = track_orders(Prepared(chirp()), [1, 8], profile=PROFILE, clock="stated")
    cut = found.cut(8.0)
    assert np.all(cut.finding[cut.frequency > 271.0] == BEYOND)
    assert any("not tracked from 27" in note for note in found.notes)
    with pytest.raises(MicrovibError, match=r"order 60 is at 600\.3 Hz and above"):
        track_orders(Prepared(chirp()), [1, 60], profile=PROFILE, clock="stated")


def test_a_tacho_whose_edges_are_known_to_a_sample():
    record = chirp(noise=0.05)
    pulses = 5.0 * (np.cos(4.0 * np.pi * record["turns"]) > 0.2)
    channels = {**record.channels, "tacho": pulses}
    given = mv.Recording(channels, 600.0, {**record.units, "tacho": "V"}, "chirp")
    found = track_orders(Prepared(given), list(CHIRP), tacho="tacho", pulses_per_rev=2)
    for order, error in errors(found).items():
        assert abs(np.mean(error)) < 0.01, order
    missing = pulses.copy()
    missing[1500:1520] = 0.0
    broken = mv.Recording({**channels, "tacho": missing}, 600.0, given.units, "chirp")
    with pytest.raises(MicrovibError, match="pulses are missing or doubled, the first at 2"):
        of_tacho(broken, "tacho", 2)


def test_resampling_at_equal_angles():
    t = np.arange(6000) / 600.0
    turns = 5.0 * t + t**2
    y, _ = at_equal_angles(np.cos(2.0 * np.pi * 7.0 * turns), turns, 128)
    angle = np.arange(y.size) / 128.0
    assert np.max(np.abs(y - np.cos(2.0 * np.pi * 7.0 * angle))[200:-200]) < 2e-3
    made = order_map(np.cos(2.0 * np.pi * 7.0 * turns), 600.0, turns, [7.0], 10.0)
    assert np.allclose(made.order[np.argmax(made.amplitude, axis=1)], 7.0)
    assert np.max(made.amplitude, axis=1) == pytest.approx(1.0, abs=5e-3)
    assert np.all(np.diff(made.speed) > 0.0)


def test_profiles_in_any_unit_of_speed(tmp_path):
    t = np.array([0.0, 2.5, 5.0, 9.0])
    expected = [10.0, 25.0, 40.0, 40.0]
    assert stated_speed(PROFILE, t) == pytest.approx(expected)
    assert stated_speed("0 s:600 rpm, 5 s:2400 rpm", t) == pytest.approx(expected)
    assert stated_speed("0 ms:3600 deg/s, 5000 ms:14400 deg/s", t) == pytest.approx(expected)
    for head, rows in (("time,speed [rpm]", "0,600\n5,2400\n"), ("", "0,10\n5,40\n")):
        file = tmp_path / "profile.csv"
        file.write_text(f"{head}\n{rows}".lstrip())
        assert stated_speed(str(file), t) == pytest.approx(expected)
    for wrong in ("10 Hz", "0 s:10 Nm", "5 s:10 Hz, 0 s:20 Hz", "0 s:-3 Hz"):
        with pytest.raises(OptionError, match="profile"):
            stated_speed(wrong, t)


def test_a_section_takes_the_profile_along():
    record = Prepared(chirp(noise=0.02))
    section = Section.stated("1 s", "4 s")
    found = track_orders(record, list(CHIRP), profile=PROFILE, clock="stated", section=section)
    assert found.recording.duration == pytest.approx(3.0)
    assert found.cuts[0].speed[0] == pytest.approx(16.0, abs=0.1)
    for order, error in errors(found).items():
        assert abs(np.mean(error)) < 0.01, order


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "no reference is given"),
        ({"profile": PROFILE, "strongest": 6.0}, "several references"),
        ({"profile": PROFILE, "clock": "guessed"}, "clock: 'guessed' is not known"),
        ({"profile": PROFILE, "bandwidth": "0.1 Hz"}, "needs a record of 40 s; it has 5.002 s"),
        ({"speed": "turns"}, "rpm, Hz or deg/s is expected"),
        ({"tacho": "Mz"}, "pulses are missing"),
        ({"strongest": -1.0}, "more than 0"),
        ({"profile": PROFILE, "fixed": ["280 Hz"]}, "fixed: 280 Hz is not allowed; at most 270 Hz"),
    ],
)
def test_what_does_not_go_is_said(options, sentence):
    with pytest.raises(MicrovibError, match=sentence):
        track_orders(Prepared(chirp()), list(CHIRP), **options)


SWEPT = {
    "record.settle": "6 s",
    "record.sample_rate": "1024 Hz",
    "record.duration": "60 s",
    "tracking": {
        "profile": [
            {"rate": "0.05 deg/s", "ramp": "2 s", "hold": "4 s"},
            {"rate": "0.1 deg/s", "ramp": "60 s", "hold": "2 s"},
        ]
    },
}


def test_a_simulated_sweep_has_the_lines_of_constant_rates(state_1):
    """Driving lines and full steps of a sweep of 60 s against steady states at the rates passed, away
    from resonances, where a sweep is quasi-steady."""
    sweep = state_1.with_(SWEPT)
    motion = mv.simulate(sweep, channels=("T_d",))
    record = Prepared(mv.Recording({"Mz": motion["T_d"]}, 1024.0, {"Mz": "N*m"}, "sweep"))
    found = track_orders(record, [4, 64, 128], scenario=sweep, clock="stated")
    assert found.reference.name == "electrical period"
    compared = 0
    for rate in (0.065, 0.075, 0.085, 0.095):
        steady = mv.find_lines(state_1.with_({"tracking.rate": f"{rate} deg/s"}), start="steady")
        for order, name in ((4, "full_step_1"), (64, "drive_1"), (128, "drive_2")):
            line, cut = steady[name], found.cut(order)
            amplitude, uncertainty = (
                np.interp(line.frequency, cut.frequency, of)
                for of in (cut.amplitude, cut.uncertainty)
            )
            away = abs(amplitude - line.amplitude)
            assert away < 0.01 * line.amplitude + 2.0 * uncertainty, (rate, name)
            compared += uncertainty < 0.02 * line.amplitude
    assert compared >= 10


def test_a_measured_sweep_whose_clock_is_off(state_1):
    sweep = state_1.with_({**SWEPT, "tracking.clock_ratio": 1.008})
    motion = mv.simulate(sweep, channels=("T_d",))
    noise = np.random.default_rng(2).normal(0.0, 1e-3, motion["T_d"].size)
    record = mv.Recording({"Mz": motion["T_d"] + noise}, 1024.0, {"Mz": "N*m"}, "sweep")
    found = track_orders(Prepared(record), [4, 64, 128], scenario=state_1.with_(SWEPT))
    assert np.mean(found.reference.clock.correction) == pytest.approx(0.008, abs=2e-4)
    true = track_orders(Prepared(record), [4, 64, 128], scenario=sweep, clock="stated")
    for order in (4, 64, 128):
        ours, theirs = found.cut(order), true.cut(order)
        away = ours.amplitude - theirs.amplitude
        assert np.median(np.abs(away / theirs.amplitude)) < 0.01


@pytest.mark.parametrize("orders", [[4, 8], [16], [4, 64]])
@pytest.mark.parametrize("seed", sweep(range(4), 0))
def test_the_clock_is_as_good_as_stated_through_a_structure_s_resonance(orders, seed):
    """Orders that a resonance turns by up to half a turn, and makes several times as large."""
    rng = np.random.default_rng(seed)
    seconds, begin, end, ratio = 8.0, 6.0, 17.0, 1.0 + rng.uniform(-0.01, 0.01)
    rate = max(2.6 * end * max(orders), 400.0)
    t = np.arange(round(seconds * rate)) / rate
    turns = ratio * (begin * t + 0.5 * (end - begin) / seconds * t**2)
    x = sum(np.cos(2.0 * np.pi * order * turns + rng.uniform(0.0, 6.0)) for order in orders)
    w, zeta = 2.0 * np.pi * rng.uniform(7.0, 16.0) * orders[0], 10.0 ** rng.uniform(-1.5, -1.0)
    numerator, denominator = bilinear([w**2], [1.0, 2.0 * zeta * w, w**2], fs=rate)
    read = 0.3 * x + lfilter(numerator, denominator, x) + rng.normal(0.0, 0.03, t.size)
    record = mv.Recording({"Mz": read}, rate, {"Mz": "N*m"}, "sweep")
    found = track_orders(record, orders, profile=f"0 s:{begin:g} Hz, {seconds:g} s:{end:g} Hz")
    clock = found.reference.clock
    mean = (clock.phase[-1] - clock.phase[0]) / (turns[-1] - turns[0])
    assert abs(mean - 1.0) < 3.0 * clock.uncertainty
