"""Detent torque and a third harmonic of the flux: their full-step line is the same at one current, and another at two."""

from __future__ import annotations

import pytest
from support.scenarios import baseline, recorded

import microvib as mv
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


@pytest.mark.long
def test_two_currents_tell_them_apart(recordings: list[mv.Recording]) -> None:
    first, second = recordings
    found = estimates(mv.identify(baseline().with_(START), [first, (second, OTHER)], KEYS, **FEW))
    for key, truth in zip(KEYS, (6e-3, 0.02), strict=True):
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
    assert EFFECTS[name].fitted[1] == "motor.flux_harmonics.0.phase=-100 deg:100 deg"
