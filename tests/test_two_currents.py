"""Detent torque and a third harmonic of the flux: their full-step line is the same at one current, and another at two."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import resample_poly
from support.phases import Phases
from support.scenarios import NO_FRICTION, baseline, recorded

import microvib as mv
from microvib.studies.identify import parse_fit
from microvib.studies.identify.coordinates import Coordinates
from microvib.studies.identify.fit import Fit
from microvib.studies.identify.selection import EFFECTS, effects_of, with_effects

HARMONIC = {"order": 3, "amplitude": 0.02, "phase": "20 deg"}
TRUTH = {"motor.detent_torque": "6 mN*m", "motor.flux_harmonics": [HARMONIC]}
START = {
    "motor.detent_torque": "9 mN*m",
    "motor.flux_harmonics": [{**HARMONIC, "amplitude": 0.01}],
}
KEYS = ["motor.detent_torque", "motor.flux_harmonics.0.amplitude"]
OTHER = {"motor.current": "0.3 A"}
FEW = {"starts": 8, "finishes": 1}


@pytest.fixture(scope="module")
def recordings() -> list[mv.Recording]:
    drive = baseline().with_(TRUTH)
    return [recorded(drive, 1, 2e-5), recorded(drive.with_(OTHER), 2, 2e-5)]


def estimates(fit: Fit) -> dict[str, tuple[float, float, bool]]:
    return {one.key: (one.estimate, one.standard_error, one.identifiable) for one in fit.estimates}


@pytest.mark.release
def test_two_currents_tell_them_apart(recordings: list[mv.Recording]) -> None:
    first, second = recordings
    found = estimates(mv.identify(baseline().with_(START), [first, (second, OTHER)], KEYS, **FEW))
    for key, truth in zip(KEYS, (6e-3, 0.02), strict=True):
        estimate, error, identifiable = found[key]
        assert identifiable
        assert abs(estimate - truth) < max(0.05 * truth, 2.0 * error)


PHASE_KEY = "motor.flux_harmonics.0.phase"
QUICK = {
    **NO_FRICTION,
    "sources": {},
    "array.modes": [],
    "array.rigid_inertia": None,
    "array.inertia": 0.13,
    "tracking.rate": math.radians(0.3),
    "record.settle": 2.0,
    "record.duration": 3.0,
    "record.sample_rate": 2048.0,
}


def of_other_code(drive: mv.Scenario, seed: int) -> mv.Recording:
    """A recording, with noise, of the windings integrated phase by phase."""
    s, dense, margin = drive.record, 8, 64
    times = s.settle + np.arange(-margin * dense, (s.samples + margin) * dense) / (
        dense * s.sample_rate
    )
    torque = Phases(drive, "apart").run(times)[:, 4]
    torque = resample_poly(torque, 1, dense, window=("kaiser", 10.0))[margin:-margin]
    noise = np.random.default_rng(seed).normal(0.0, 2e-5, torque.size)
    return mv.Recording({"Mz": torque + noise}, s.sample_rate, {"Mz": "N*m"}, "made")


@pytest.mark.release
def test_detent_harmonic_and_phase_are_found_in_recordings_of_another_code() -> None:
    start = baseline().with_si(QUICK).with_(START)
    drive = start.with_(TRUTH)
    recordings = [of_other_code(drive, 1), (of_other_code(drive.with_(OTHER), 2), OTHER)]
    fit = mv.identify(start, recordings, [*KEYS, PHASE_KEY], **FEW)
    found = estimates(fit)
    for key, truth in zip((*KEYS, PHASE_KEY), (6e-3, 0.02, math.radians(20.0)), strict=True):
        estimate, error, identifiable = found[key]
        assert identifiable
        assert abs(estimate - truth) < max(0.05 * truth, 2.0 * error)


@pytest.mark.long
def test_one_current_does_not_and_names_the_recording_that_would(
    recordings: list[mv.Recording],
) -> None:
    fit = mv.identify(baseline().with_(START), recordings[:1], KEYS, **FEW)
    for one in fit.estimates:
        assert not one.identifiable
        assert "not told apart at one current; add a recording at another one" in one.verdict


def test_flux_harmonics_are_a_candidate_of_the_order_that_makes_full_step_lines() -> None:
    name = "motor.flux_harmonics"
    assert effects_of(["all"]).count(name) == 1
    for phases, beats, order in ((2, 4, 3), (3, 12, 5), (5, 20, 9)):
        drive = baseline().with_({"motor.phases": phases, "driver.beats": beats})
        (harmonic,) = with_effects(drive, [name], [name]).motor.axis_flux_harmonics
        assert harmonic.order == order
        assert harmonic.torque_order == drive.motor.detent_periods
    without = with_effects(baseline().with_(TRUTH), [name], [])
    assert without.motor.flux_harmonics == ()
    assert EFFECTS[name].keys[1] == "motor.flux_harmonics.0.phase"


def coordinates(*keys: str) -> Coordinates:
    drive = baseline().with_(TRUTH)
    return Coordinates(tuple(parse_fit(drive, key) for key in keys))


@pytest.mark.parametrize("phase", ["", "=-100 deg:100 deg"])
def test_an_amplitude_and_its_phase_are_moved_by_their_cartesian_parts(phase: str) -> None:
    by_keys = coordinates(*KEYS, PHASE_KEY + phase)
    both = by_keys.cartesian()
    assert both.pairs == ((1, 2),)
    for values in ((6e-3, 0.02, 0.35), (6e-3, 0.02, -1.6), (2e-3, 0.2, 1.7)):
        assert both.values(both.point(values)) == pytest.approx(values)
        assert by_keys.values(by_keys.point(values)) == pytest.approx(values)
    # the same drive, written in another way
    same = by_keys.values(by_keys.point((6e-3, -0.02, 0.35 + math.pi)))
    assert same == pytest.approx((6e-3, 0.02, 0.35))
    # an amplitude of 0 is no border: half the way to the opposite is 0
    there, opposite = both.point((6e-3, 0.02, 0.35)), both.point((6e-3, -0.02, 0.35))
    assert both.values(0.5 * (there + opposite))[1] == pytest.approx(0.0, abs=1e-15)


def test_a_phase_whose_range_excludes_some_is_moved_by_itself() -> None:
    assert coordinates(KEYS[1], PHASE_KEY + "=0 deg:30 deg").cartesian().pairs == ()
    assert coordinates(PHASE_KEY).cartesian().pairs == ()
    narrow = coordinates(KEYS[1], PHASE_KEY + "=-100 deg:100 deg")
    values = narrow.values(narrow.point((0.02, 3.0)))
    assert values == pytest.approx((-0.02, 3.0 - math.pi))


def test_amplitudes_of_pairs_begin_at_all_sizes_and_phases_all_around() -> None:
    both = coordinates(KEYS[1], PHASE_KEY).cartesian()
    parts = np.random.default_rng(1).uniform(size=(4000, 2))
    sizes, phases = np.array([both.values(x) for x in both.spread(parts)]).T
    assert np.quantile(sizes, (0.0, 0.5, 1.0)) == pytest.approx((0.003, 0.03, 0.3), rel=0.1)
    assert abs(np.mean(np.exp(1j * phases))) < 0.05
