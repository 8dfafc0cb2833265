"""What a drive that turns and always slides makes of other sources' lines: each element against integration
in time, or against matrices; and budgets, which do not pass by what they leave out.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.sliding_in_time import integrated
from support.tiers import sweep
from support.turning_in_time import LOADS, PLACE, amplitudes, smooth_drive

import microvib as mv
from microvib.io.file_access import WORKING_FOLDER
from microvib.model.array import Array
from microvib.model.drive_states import (
    SLIDES,
    DriveStates,
    Sticking,
    craft_of_drives,
    drive_states,
    sliding_elements,
)
from microvib.model.driver import Driver
from microvib.model.friction import Friction
from microvib.model.gear_train import GearStage
from microvib.model.harness import Harness
from microvib.model.linear import coupled_modes
from microvib.model.motor import Motor
from microvib.model.reducer import Reducer
from microvib.model.shaft_rates import ShaftRates, rates_over_turn
from microvib.model.side_lines import VaryingDrive, varying_drives
from microvib.model.turning import turning_drive
from microvib.studies.budget.files import OtherSource, Requirement
from microvib.studies.budget.other_sources import contribution_of_other
from microvib.studies.budget.side_lines import SideLines, anywhere_together
from microvib.studies.budget.sums import assess

LOOP = {"driver.proportional_gain": "100 V/A"}
RUBS = {
    "friction.coulomb": "0.05 N*m",
    "friction.breakaway": "0.08 N*m",
    "friction.stribeck_rate": "0.1 deg/s",
    "friction.viscous": "2 N*m*s/rad",
    "driver.microsteps": 8,
}
ERRORS = {
    "reducer.transmission_error": [
        {"order": 2, "amplitude": "30 arcsec"},
        {"order": 4, "amplitude": "10 arcsec", "phase": "1 rad"},
    ],
    "driver.microsteps": 16,
}
OVER_ANGLE = {
    "friction.coulomb": "0.3 N*m",
    "friction.breakaway": "0.3 N*m",
    "friction.viscous": "2 N*m*s/rad",
    "friction.position": {
        "harmonics": [{"order": 200, "amplitude": 0.2}, {"order": 3000, "amplitude": 0.1}]
    },
    "driver.microsteps": 16,
    "motor.current": "0.4 A",
}
SLOW_LOOP = {"driver.proportional_gain": "7 V/A", "driver.integral_gain": "5 V/(A*s)"}
DRIVES: dict[str, dict[str, object]] = {
    "falling friction": {**LOOP, **RUBS},
    "gear errors": {**LOOP, **ERRORS},
    "friction over the angle": {**LOOP, **OVER_ANGLE},
    "slow loop": {**SLOW_LOOP, "motor.current": "0.4 A", "driver.imperfections.gain_b": -0.2},
}
F = 7.31


@pytest.fixture(scope="module")
def ideal() -> mv.Scenario:
    return smooth_drive()


def forces_on(scenario: mv.Scenario, size: float = 0.01) -> np.ndarray:
    return size * (DriveStates(scenario, ()).on_hub(PLACE) @ LOADS)


def lines_of(drive: VaryingDrive, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (k,) of lines that a drive makes, and lines (k, 2) at most and by harmonic balance."""
    at = np.array([F])
    motion = drive.motion(at, forces[:, None])[:, :, 0].T
    found = drive.response(at)
    balance = replace(drive, with_margins=False).response(at).of_motion(motion)[:, 0]
    return found.frequency[:, 0], found.of_motion(motion)[:, 0], balance


@pytest.mark.long
@pytest.mark.parametrize("name", sweep(DRIVES, "friction over the angle"))
def test_side_lines_are_those_in_time(ideal, name):
    """The largest within 6 %, and none that is above a hundredth of it is above the bound."""
    scenario = ideal.with_(DRIVES[name])
    forces = forces_on(scenario)
    found = integrated(scenario, F, forces, 20.0, 10.0)
    sticking = found.sticking, SLIDES
    (drive,) = varying_drives(scenario, craft_of_drives(scenario, sticking), sticking=sticking)
    at, most, balance = lines_of(drive, forces)
    beside = drive.orders != 0.0
    large = balance.max(axis=1) > 0.01 * balance[beside].max()
    counts = np.flatnonzero(beside & large & (at > 0.05) & (at < 400.0))
    there = amplitudes(found.time, found.los, np.r_[F, at[counts]])[1:]
    largest = np.unravel_index(np.argmax(there), there.shape)
    assert there[largest] == pytest.approx(balance[counts][largest], rel=0.06)
    assert np.all(there <= most[counts] + 1e-4 * there.max())


def line_of(folder: Path, size: float = 1e-3) -> OtherSource:
    names = ("fx_n", "fy_n", "fz_n", "mx_n_m", "my_n_m", "mz_n_m")
    path = folder / "lines.csv"
    path.write_text(f"frequency_hz,{','.join(names)}\n{F}{6 * f',{size}'}\n")
    return OtherSource(name="cooler", position=["0.3 m", "-0.2 m", "0.5 m"], lines=str(path))


def verdict(
    source: OtherSource,
    scenario: mv.Scenario,
    sticking: Sticking,
    low: float,
    high: float,
    limit: float,
) -> str:
    one = contribution_of_other(source, scenario, WORKING_FOLDER, (sticking, SLIDES))
    asked = Requirement(name="x", metric="ape", axis="radial", lowest=f"{low} Hz", highest=f"{high} Hz", limit=f"{limit} rad")  # fmt: skip
    return assess(asked, [one], "rss").verdict


def even(scenario: mv.Scenario, swing: float = 0.0) -> Sticking:
    """A drive whose output's rate swings by a part once in each microstep, and repeats."""
    rate = float(scenario.rate)
    steps = scenario.driver.beats * scenario.driver.microsteps
    turn = np.cos(2.0 * np.pi * steps * np.arange(16 * steps) / (16 * steps))
    rotor = -scenario.reducer.h * rate * np.ones(turn.size)
    rates = ShaftRates(rotor, rate * (1.0 + swing * turn), least_gear_torque=1.0, gear_swing=0.0)
    slowest = abs(rate) * (1.0 - swing)
    return Sticking(False, False, abs(rotor[0]), slowest, rates=rates)


@pytest.mark.parametrize("name", ["falling friction", "gear errors", "friction over the angle"])
def test_a_band_beside_a_line_does_not_pass_by_what_an_element_makes_there(ideal, tmp_path, name):
    """A limit below the side line by harmonic balance is not judged, one far above it passes."""
    scenario = ideal.with_(DRIVES[name])
    sticking = even(scenario, 0.5)
    craft = craft_of_drives(scenario, (sticking, SLIDES))
    (drive,) = varying_drives(scenario, craft, sticking=(sticking, SLIDES))
    source = line_of(tmp_path)
    forces = craft.on_hub(PLACE) @ (1e-3 * np.ones(6))
    at, most, balance = lines_of(drive, forces)
    beside = (drive.orders != 0.0) & (at > 0.05)
    k = int(np.flatnonzero(beside)[np.argmax(balance[beside].max(axis=1))])
    band = (at[k] - 0.02, at[k] + 0.02)
    below = 0.5 * float(np.hypot(*balance[k])) / math.sqrt(2.0)
    assert verdict(source, scenario, sticking, *band, below) == "not judged"
    above = 100.0 * float(np.hypot(*most[k]))
    assert verdict(source, scenario, sticking, *band, above) == "pass"


def test_friction_of_next_to_no_slope_lets_a_budget_pass(ideal, tmp_path):
    """An element of negligible size does not keep a budget from being judged."""
    scenario = ideal.with_({**LOOP, **RUBS, "friction.breakaway": "0.0500001 N*m"})
    assert verdict(line_of(tmp_path), scenario, even(scenario, 0.5), 80.0, 90.0, 1e-15) == "pass"


def test_rates_that_do_not_repeat_are_bounded_beside(ideal, tmp_path):
    """Off their mean over the turn by a part: lines anywhere, where nothing else is."""
    scenario = ideal.with_({**LOOP, **RUBS})
    steady = even(scenario)
    off = 0.2 * abs(float(scenario.rate))
    rings = steady._replace(rates=replace(steady.rates, output_remainder=off))
    source = line_of(tmp_path)
    assert verdict(source, scenario, steady, 50.0, 50.2, 1e-15) == "pass"
    assert verdict(source, scenario, rings, 50.0, 50.2, 1e-15) == "not judged"
    one = contribution_of_other(source, scenario, WORKING_FOLDER, (rings, SLIDES))
    assert any("friction changes within a step" in x.why for x in one.side.anywhere)


def test_sources_that_turn_a_shaft_back_together_are_not_judged(ideal, tmp_path):
    """Though each by itself does not."""
    scenario = ideal.with_({**LOOP, **RUBS})
    sticking = even(scenario)
    unit = contribution_of_other(line_of(tmp_path), scenario, WORKING_FOLDER, (sticking, SLIDES))
    fastest = max(one.speed / one.shaft.rate for one in unit.side.shafts if one.shaft.rubs)
    size = 1e-3 * 0.15 / fastest  # of the fifth of the rate that one may change
    asked = Requirement(name="x", metric="ape", lowest="40 Hz", highest="41 Hz", limit="1 rad")
    sources = []
    for k in range(2):
        folder = tmp_path / str(k)
        folder.mkdir()
        source = line_of(folder, size)
        sources.append(contribution_of_other(source, scenario, WORKING_FOLDER, (sticking, SLIDES)))
    assert assess(asked, sources[:1], "rss").verdict == "pass"
    both = assess(asked, sources, "rss")
    assert both.verdict == "not judged"
    assert any("all sources together" in why for why in both.why)


def test_windings_with_a_slow_loop_change_the_response(ideal):
    """Against the dynamic stiffness with the windings solved as circuits; with a fast loop nothing is said."""
    damped = ideal.with_({"motor.friction.viscous": "0.0255 N*m*s/rad", "motor.current": "0.6 A"})
    assert drive_states(damped, sticking=(SLIDES, SLIDES)) is None
    scenario = ideal.with_({"driver.proportional_gain": "2 V/A", "driver.integral_gain": "5 V/(A*s)", "motor.current": "0.4 A"})  # fmt: skip
    states = drive_states(scenario, sticking=(SLIDES, SLIDES))
    assert states is not None
    at = np.linspace(1.0, 200.0, 60)
    rotor = states.on_rotor[:, 0]
    M, C, K = DriveStates(scenario, ())._system
    forces = states.on_hub(PLACE)
    low, high = states.extremes(at, forces)
    for k, f in enumerate(at.tolist()):
        w = 2.0 * np.pi * f
        z = circuit(scenario, w)
        Z = K - w**2 * M + 1j * w * C + z * np.outer(rotor, rotor)
        true = np.abs(states.line_of_sight @ np.linalg.solve(Z, forces + 0j))
        assert np.all(true <= high[k] * (1.0 + 1e-9))
        assert np.all(true >= low[k] * (1.0 - 1e-9))


def circuit(scenario: mv.Scenario, w: float) -> complex:
    """Torque against a rotor that swings by exp(j w t) beside that of the spring, of two phases whose
    equations are averaged over an electrical turn in the time domain.
    """
    motor, driver = scenario.motor, scenario.driver
    omega_e = motor.rotor_teeth * scenario.reducer.ratio * abs(float(scenario.rate))
    K_m, L, R = motor.axis_torque_constant, motor.winding_inductance, motor.winding_resistance

    def impedance(x: float) -> complex:
        s = 1j * x
        return R + s * L + driver.proportional_gain + driver.integral_gain / s

    # flux -sin p and cos p at p = omega_e t: linked by K_m cos p and K_m sin p, of which a swing theta
    # changes the voltage by -K_m d/dt(theta flux)
    torque = 0.0j
    for flux in ({1: 0.5j, -1: -0.5j}, {1: 0.5, -1: 0.5}):
        for k, phi in flux.items():
            x = w + k * omega_e
            current = -K_m * 1j * x * phi / impedance(x)
            torque += K_m * current * flux[-k]
    return -torque


def test_a_held_gear_with_errors_has_another_ratio_at_each_angle(ideal):
    """The line of sight at any angle of a parked drive is within the bounds."""
    parked = ideal.with_({**LOOP, **ERRORS, "tracking.rate": "0 deg/s"})
    states = drive_states(parked)
    assert states is not None
    M, C, K = (part.copy() for part in DriveStates(parked, ())._system)
    reducer, rotor, output = parked.reducer, states.on_rotor[:, 0], states.on_output[:, 0]
    gear = -rotor / reducer.h - output
    at = np.geomspace(0.3, 60.0, 80)
    forces = states.on_hub(PLACE)
    low, high = states.extremes(at, forces)
    slopes = [
        sum(float(e.order) * e.amplitude * math.cos(float(e.order) * angle + e.phase) for e in reducer.errors)
        for angle in np.linspace(0.0, np.pi, 9)
    ]  # fmt: skip
    plain = np.array([gear @ gear])
    assert plain > 0.0
    changed = 0.0
    for slope in slopes:
        there = gear + slope * rotor
        more = np.outer(there, there) - np.outer(gear, gear)
        for k, f in enumerate(at.tolist()):
            w = 2.0 * np.pi * f
            Z = K - w**2 * M + 1j * w * C
            own = np.abs(states.line_of_sight @ np.linalg.solve(Z, forces + 0j))
            Z = Z + (float(reducer.stiffness) + 1j * w * reducer.damping) * more
            true = np.abs(states.line_of_sight @ np.linalg.solve(Z, forces + 0j))
            changed = max(changed, float(np.max(np.abs(true / own - 1.0))))
            assert np.all(true <= high[k] * (1.0 + 1e-4))
            assert np.all(true >= low[k] * (1.0 - 1e-4))
    assert changed > 0.02


def test_what_comes_beside_a_line_takes_off_its_least(ideal, tmp_path):
    """Friction of the rotor makes the motor lag, and lowers its spring: the truth with that spring is not
    below the least."""
    friction = {"coulomb": "10 mN*m", "breakaway": "10 mN*m", "stribeck_rate": "1 deg/s"}
    scenario = ideal.with_({**LOOP, **{f"motor.friction.{key}": x for key, x in friction.items()}})
    sticking = even(scenario)
    ((_, _, drive),) = sliding_elements(scenario, (sticking, SLIDES))
    lowered = drive.spring.mean / drive.linear
    assert lowered < 0.99
    states = DriveStates(scenario, ())
    M, C, K = states._system
    rotor = states.on_rotor[:, 0]
    w = 2.0 * np.pi * F
    Z = K - w**2 * M + 1j * w * C + (drive.spring.mean - drive.linear) * np.outer(rotor, rotor)
    loads = states.on_hub(PLACE) @ (1e-3 * np.ones(6))
    true = float(np.abs(states.line_of_sight @ np.linalg.solve(Z, loads + 0j))[0]) / math.sqrt(2.0)
    one = contribution_of_other(phased_line(tmp_path), scenario, WORKING_FOLDER, (sticking, SLIDES))
    asked = Requirement(name="x", metric="ape", axis="x", lowest="7 Hz", highest="8 Hz", limit="1 rad")  # fmt: skip
    found = assess(asked, [one], "rss")
    assert found.least <= true * (1.0 + 1e-6)
    assert found.most >= true * (1.0 - 1e-6)


def phased_line(folder: Path) -> OtherSource:
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    units = ("n", "n", "n", "n_m", "n_m", "n_m")
    path = folder / "phased.csv"
    head = [*(f"{a}_{b}" for a, b in zip(names, units, strict=True)), *(f"{a}_phase_rad" for a in names)]  # fmt: skip
    path.write_text(f"frequency_hz,{','.join(head)}\n{F}{6 * ',1e-3'}{6 * ',0'}\n")
    return OtherSource(name="cooler", position=["0.3 m", "-0.2 m", "0.5 m"], lines=str(path))


@pytest.mark.parametrize(
    ("keys", "change", "said"),
    [
        ({"reducer.stiffness": "rigid", "reducer.transmission_error": [{"order": 2, "amplitude": "30 arcsec"}]}, {}, "reducer.stiffness"),
        ({"reducer.backlash": "10 arcsec"}, {"least_gear_torque": 0.0}, "reducer.backlash"),
        ({}, {"at_supply_limit": True}, "driver.supply_voltage"),
    ],
    ids=["errors of a rigid gear", "teeth that part", "supply"],
)  # fmt: skip
def test_what_is_not_known_is_said_with_its_key(ideal, tmp_path, keys, change, said):
    scenario = ideal.with_({**LOOP, **keys})
    sticking = even(scenario)
    sticking = sticking._replace(rates=replace(sticking.rates, **change))
    one = contribution_of_other(line_of(tmp_path), scenario, WORKING_FOLDER, (sticking, SLIDES))
    asked = Requirement(name="x", metric="ape", lowest="40 Hz", highest="41 Hz", limit="1 rad")
    found = assess(asked, [one], "rss")
    assert found.verdict == "not judged"
    assert any(said in why for why in found.why)


def test_teeth_that_loads_may_part_are_not_judged(ideal, tmp_path):
    """And teeth that the drive's own load keeps together are."""
    scenario = ideal.with_({**LOOP, "reducer.backlash": "10 arcsec"})
    asked = Requirement(name="x", metric="ape", lowest="40 Hz", highest="41 Hz", limit="1 rad")
    found = {}
    for size in (1e-6, 1e3):
        sticking = even(scenario)
        one = contribution_of_other(line_of(tmp_path, size), scenario, WORKING_FOLDER, (sticking, SLIDES))  # fmt: skip
        found[size] = assess(asked, [one], "rss")
    assert not any("teeth" in why for why in found[1e-6].why)
    assert any("teeth" in why for why in found[1e3].why)


def test_a_drive_near_a_doubling_of_its_period_is_not_judged(ideal, tmp_path):
    """Where by Floquet's theory detent torque of four periods in an electrical turn makes a mode of half its
    frequency grow, and below; far from it, it is."""
    damping = {f"array.modes.{i}.damping": 0.002 for i in range(4)}
    light = {"driver.proportional_gain": "2000 V/A", "motor.friction.viscous": "2e-5 N*m*s/rad", "reducer.damping": "0.02 N*m*s/rad"}  # fmt: skip
    drive = ideal.with_({**damping, **light, "driver.microsteps": 64, "motor.current": "0.4 A"})
    (mode,) = [one for one in coupled_modes(drive) if one.name == "drive_resonance_1"]
    rate = 2.0 * mode.frequency / 4.0 * 2.0 * np.pi / (50 * drive.reducer.ratio)
    for detent, grows, near in ((5e-3, True, True), (3e-3, False, True), (2e-4, False, False)):
        scenario = drive.with_si({"tracking.rate": rate, "motor.detent_torque": detent})
        assert (turning_drive(scenario).growth > 0.0) == grows
        one = contribution_of_other(line_of(tmp_path), scenario, WORKING_FOLDER, (even(scenario), SLIDES))  # fmt: skip
        assert any("doubling" in why for why in one.side.unknown) == near


def test_loads_that_change_the_slope_of_friction_are_bounded_together(ideal, tmp_path):
    """Twice the sources, four times as much of what their squares make."""
    scenario = ideal.with_({**LOOP, **RUBS})
    sticking = even(scenario)
    source = line_of(tmp_path, 1e-3)
    one = contribution_of_other(source, scenario, WORKING_FOLDER, (sticking, SLIDES)).side
    asked = Requirement(name="x", metric="ape", lowest="40 Hz", highest="41 Hz", limit="1 rad")

    def of_slope(*sides: SideLines) -> float:
        found = [x for x in anywhere_together(sides) if "slope of friction" in x.why]
        return sum(x.largest(asked) for x in found)

    assert of_slope(one) > 0.0
    assert of_slope(one, one) == pytest.approx(4.0 * of_slope(one), rel=0.01)


def test_rates_are_folded_over_the_electrical_turn():
    """From the instants at which the rotor's even motion passes the angle 0."""
    rate, step = 2.0 * np.pi * 3.0, 1e-3
    t = step * np.arange(2000)
    angle = 1.0 + rate * t
    made = 5.0 + np.cos(2.0 * angle) + 0.1 * np.cos(rate * t / 7.0)
    found = rates_over_turn(angle + 0.01 * np.cos(angle), (made, 2.0 * made), rate, step)
    at = 2.0 * np.pi * np.arange(found.rotor.size) / found.rotor.size
    assert found.rotor == pytest.approx(5.0 + np.cos(2.0 * at), abs=0.06)
    assert 0.05 < found.rotor_remainder < 0.2
    period = slice(0, 167)  # half a turn, of a motion that repeats with it
    again = rates_over_turn(angle[period], (made[period], made[period]), rate, step, repeats=True)
    assert again.rotor.size == found.rotor.size
    assert rates_over_turn(angle[period], (made[period], made[period]), rate, step) is None


LINEAR, COMPUTED, BOUNDED, NOT_JUDGED = "linear", "computed", "bounded", "not judged"
KEYS: dict[type, dict[str, str]] = {
    Motor: {
        "rotor_teeth": LINEAR, "phases": LINEAR, "current": COMPUTED, "torque_constant": COMPUTED,
        "detent_torque": COMPUTED, "detent_order": COMPUTED, "flux_harmonics": COMPUTED, "detent": COMPUTED,
        "winding_resistance": COMPUTED, "winding_inductance": COMPUTED, "rotor_inertia": LINEAR,
        "eddy_damping": LINEAR, "friction": COMPUTED,
    },
    Driver: {
        "drive": NOT_JUDGED, "beats": COMPUTED, "microsteps": COMPUTED, "proportional_gain": COMPUTED,
        "integral_gain": COMPUTED, "derivative_gain": COMPUTED, "supply_voltage": NOT_JUDGED,
        "on_time": NOT_JUDGED, "diode_voltage": NOT_JUDGED, "clamp": NOT_JUDGED, "microstep_ramp": COMPUTED,
        "microstep_shape": COMPUTED, "compensation": COMPUTED, "delay": COMPUTED, "imperfections": COMPUTED,
        "table": COMPUTED,
    },
    Reducer: {
        "ratio": LINEAR, "wave_generator_inertia": LINEAR, "stiffness": LINEAR, "damping": LINEAR,
        "same_way": LINEAR, "output_inertia": LINEAR, "transmission_error": COMPUTED, "backlash": NOT_JUDGED,
        "hysteresis": BOUNDED, "train": COMPUTED,
    },
    Friction: {
        "coulomb": BOUNDED, "breakaway": COMPUTED, "stribeck_rate": COMPUTED, "stribeck_shape": COMPUTED,
        "viscous": LINEAR, "slip_ring": BOUNDED, "presliding": BOUNDED, "torque_noise": BOUNDED,
        "position": COMPUTED, "harness": BOUNDED,
    },
    Harness: {"stiffness": LINEAR, "neutral_angle": LINEAR, "friction": BOUNDED, "presliding": BOUNDED},
    GearStage: {
        **dict.fromkeys(GearStage.model_fields, LINEAR), "backlash": NOT_JUDGED, "errors": COMPUTED,
    },
    Array: dict.fromkeys(("inertia", "rigid_inertia", "modes", "interface_inertia", "drive_axis", "rigid_body"), LINEAR),
}  # fmt: skip
"""How each key of a drive acts on what it makes of other sources' loads while it slides."""


@pytest.mark.parametrize("part", KEYS, ids=lambda part: part.__name__)
def test_every_key_of_a_drive_has_its_place(part):
    """A new key needs one: linear, computed or bounded in ``model.sliding_elements``, or not judged."""
    assert set(KEYS[part]) == set(part.model_fields)
