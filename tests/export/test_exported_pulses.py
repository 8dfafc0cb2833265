"""Exports of a drive that steps by voltage pulses, with either clamp: they are the run, or say why not."""

import io
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.native_drive import Drive
from support.pulse_scenarios import HELD, drawn, scenario_of

import microvib as mv
from microvib.errors import MicrovibError
from microvib.solve.integration import channels_of
from microvib.solve.pack import pack
from microvib.solve.sampling import Decimator, sample_intervals

CLAMPS = ("unidirectional", "bidirectional")
STEPS = 6
NEAR = 1e-9
MAKES_ALL = {
    clamp: scenario_of(replace(drawn(3), four_windings=both, both_ways=both), STEPS)
    for clamp, both in zip(CLAMPS, (False, True), strict=True)
}
"""A drive that makes all its steps, by its clamp."""
PULSES = Path(__file__).parents[2] / "examples" / "pulses.yaml"
LOSES = mv.load_scenario(PULSES, {"record.settle": "0 s", "record.duration": "30 s"})
IN_SIX = {
    "array.modes": [
        {"frequency": 0.4, "damping": 0.01, "interface_participation": [0.3, 4, 0, 1, 0.5, 2]}
    ],
    "array.rigid_body": {
        "mass": 40.0,
        "center_of_mass": [0.0, 0.0, 1.0],
        "inertia": [200.0, 200.0, 60.0, 0.0, 0.0, 0.0],
    },
    "array.inertia": 60.0,
}


def off(found, expected):
    return np.max(np.abs(found - expected)) / np.max(np.abs(expected))


def samples_of(drive, scenario):
    """Samples of the channels from a record of an exported drive, through the filter of a run."""
    intervals, columns = sample_intervals(scenario), drive.call("columns")
    decimator = Decimator(intervals.factor)
    drive.ask("begin_record", intervals.first, intervals.width)
    room = decimator.room(intervals.missing + intervals.rows, columns)
    room[intervals.missing :] = drive.record(intervals.rows)
    room[: intervals.missing] = room[intervals.missing]
    rows = decimator.filtered()[: scenario.record.samples]
    return channels_of(rows[:, : pack(scenario).channels], scenario.load.H.size)


def amplitudes(torque, scenario):
    """Amplitudes of T_d at multiples of the step frequency, through a Hann window."""
    window = np.hanning(torque.size)
    t = np.arange(torque.size) / scenario.record.sample_rate
    f = np.arange(1, 21) * abs(scenario.driving_frequency)
    return np.abs(np.exp(-2j * np.pi * np.outer(f, t)) @ (window * torque)) / window.sum() * 2.0


@pytest.mark.parametrize("clamp", CLAMPS)
def test_samples_and_lines_are_those_of_a_run(native, clamp):
    scenario = MAKES_ALL[clamp]
    motion, drive = mv.simulate(scenario), Drive(native(scenario))
    found = samples_of(drive, scenario)
    for channel in ("i_A", "i_B", "u_A", "theta_m", "omega_l", "T_d_force"):
        assert off(found[channel], motion[channel]) < NEAR, channel
    expected = amplitudes(motion["T_d_force"], scenario)
    assert expected.min() > 1e-3 * expected.max()
    assert amplitudes(found["T_d_force"], scenario) == pytest.approx(expected, rel=1e-8)
    assert motion.steps.lost == motion.steps.gained == 0
    drive.free()


def test_the_clamps_are_two_drives(native):
    found = []
    for clamp in CLAMPS:
        drive = Drive(native(MAKES_ALL[clamp]))
        found.append(samples_of(drive, MAKES_ALL[clamp])["T_d_force"])
        drive.free()
    assert off(found[1], found[0]) > 0.01


def test_steps_that_are_lost_are_counted(native):
    expected, drive = mv.simulate(LOSES, channels="T_d").steps, Drive(native(LOSES))
    drive.step(LOSES.record.settle + LOSES.record.duration)
    counted = [drive[f"steps_{name}"] for name in ("judged", "lost", "gained")]
    assert counted == [expected.judged, expected.lost, expected.gained]
    assert expected.lost > 0
    drive.free()
    current = Drive(native(mv.load_scenario("state-1", {"record.start": "rest"})))
    assert not [name for name in current.names if name.startswith("steps_")]
    current.free()


@pytest.mark.parametrize("clamp", CLAMPS)
@pytest.mark.parametrize("part", [0.4, 1.05])
def test_a_state_in_a_pulse_or_behind_it_goes_on_in_another_instance(native, clamp, part):
    """Parts of the on-time: in the pulse, and while the windings that it left still conduct."""
    scenario = MAKES_ALL[clamp]
    library, drive = native(scenario), Drive(native(scenario))
    step = 1.0 / abs(scenario.driving_frequency)
    drive.step(2.5 * step + part * scenario.driver.on_time)
    assert max(abs(drive["i_A"]), abs(drive["i_B"])) > 1e-3 * scenario.driver.amplitude(
        scenario.motor
    )
    kept, other = drive.state, Drive(library)
    other.step(0.3 * step)
    other.state = kept
    for one in (drive, other):
        one.step(5.2 * step)
    assert other["T_d"] == drive["T_d"]
    assert other["steps_judged"] == drive["steps_judged"] == 4.0
    drive.free()
    other.free()


@pytest.mark.parametrize("clamp", CLAMPS)
def test_independent_steps_do_not_hang_on_communication(native, clamp):
    scenario = MAKES_ALL[clamp]
    times = np.arange(1, 9) * 0.25

    def motion(each):
        drive, found = Drive(native(scenario)), []
        drive.ask("set_independent", 1)
        for time in times:
            for stop in [*np.arange(time - 0.25, time - 1e-9, each)[1:], time]:
                drive.step(stop)
            found.append([drive[name] for name in ("T_d", "theta_m", "i_A", "omega_l")])
        drive.free()
        return np.array(found)

    expected, found = motion(0.25), motion(7e-3)
    largest = np.max(np.abs(expected), axis=0)
    assert np.all(np.max(np.abs(found - expected), axis=0) <= NEAR * largest)


@pytest.mark.parametrize("clamp", CLAMPS)
def test_a_step_from_outside_is_a_pulse(native, clamp):
    """Current of a held rotor in closed form; the next step, in the middle of the pulse, ends it."""
    both = clamp == "bidirectional"
    held = replace(
        HELD, K_d=0.0, rotor=replace(HELD.rotor, coulomb=10.0), four_windings=both, both_ways=both
    )
    drive, tau, part = Drive(native(scenario_of(held, 1))), held.L / held.R, 0.01
    drive.ask("set_microsteps", 1)
    drive.step(part)
    final, against = held.voltage / held.R, held.diode_voltage / held.R
    risen = final * -np.expm1(-part / tau)
    assert drive["i_B"] == pytest.approx(risen, rel=1e-6)
    assert drive["i_A"] == 0.0
    drive.ask("set_microsteps", 2)
    drive.step(part + 1e-3)
    falling = (risen + against) * np.exp(-1e-3 / tau) - against
    assert drive["i_B"] == pytest.approx(falling, rel=1e-5)
    assert drive["i_A"] == pytest.approx(-final * -np.expm1(-1e-3 / tau), rel=1e-5)
    drive.free()


def test_a_rate_at_which_pulses_are_cut_short_is_refused(native):
    scenario = MAKES_ALL["unidirectional"]
    most = (
        scenario.driver.microstep(scenario.motor) / scenario.reducer.ratio / scenario.driver.on_time
    )
    drive = Drive(native(scenario))
    drive.ask("set_rate", 0.999 * most)
    allowed = f"{1.0 / scenario.driver.on_time:.7g}"
    with pytest.raises(RuntimeError, match=re.escape(f"at most {allowed} are followed")):
        drive.ask("set_rate", 1.001 * most)
    with pytest.raises(RuntimeError, match=re.escape(f"at most {allowed} are followed")):
        drive.set_parameter("tracking.rate", 1.001 * most)
    drive.free()
    as_exported = Drive(native(scenario.with_si({"tracking.rate": most})))
    as_exported.set_parameter("motor.detent_torque", 0.01)
    as_exported.free()


@pytest.mark.parametrize("clamp", CLAMPS)
@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_simulates_what_the_solver_does(version, clamp, tmp_path):
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    scenario = MAKES_ALL[clamp]
    fmu = mv.export_as(scenario, f"fmu{version}", tmp_path / "drive.fmu")
    assert validate_fmu(str(fmu)) == []
    with zipfile.ZipFile(fmu) as archive:
        content = archive.read("documentation/reference.csv")
        assert f"pulses and clamp ({clamp})" in archive.read("modelDescription.xml").decode()
    expected = np.genfromtxt(io.BytesIO(content), delimiter=",", names=True)
    asked = ["T_d", "T_d_mean", "steps_judged", "steps_lost"]
    found = fmpy.simulate_fmu(
        str(fmu), stop_time=5.0, step_size=0.01, output_interval=0.01, output=asked
    )
    for name in ("T_d", "T_d_mean"):
        assert off(found[name][1:], expected[name]) < NEAR, name
    per_second = abs(scenario.driving_frequency)
    assert found["steps_judged"][-1] == np.floor(5.0 * per_second + 0.5) - 1
    assert found["steps_lost"][-1] == 0.0


@pytest.mark.parametrize("target", ["fmu2", "fmu3"])
def test_lines_alone_are_not_the_torque_of_pulses(target, tmp_path):
    with pytest.raises(
        MicrovibError, match=r"^driver\.drive: pulse .* kind tones cannot have them"
    ):
        mv.export_as(LOSES, target, tmp_path / "lines.fmu", kind="tones")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("clamp", CLAMPS)
@pytest.mark.parametrize("target", ["state-space", "source-sheet", "nastran"])
def test_what_needs_a_linear_drive_is_refused_by_a_sentence(target, clamp, tmp_path):
    scenario = MAKES_ALL[clamp].with_si(IN_SIX)
    file, said = {
        "state-space": ("a.mat", "a pulse drive has no linearised form"),
        "source-sheet": ("a.h5", r"a current loop \(current\)$"),
        "nastran": ("a.bdf", r"drive=locked .* contents=\[lines, densities\] loads alone$"),
    }[target]
    with pytest.raises(MicrovibError, match=rf"^driver\.drive: .*{said}"):
        mv.export_as(scenario, target, tmp_path / file)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("clamp", CLAMPS)
def test_loads_of_a_run_are_written_for_nastran(clamp, tmp_path):
    pytest.importorskip("pyyeti")
    scenario = MAKES_ALL[clamp].with_si(IN_SIX)
    locked = mv.export_as(scenario, "nastran", tmp_path / "locked.bdf", drive="locked")
    assert "M2GG" in locked.read_text()
    alone = mv.export_as(scenario, "nastran", tmp_path / "loads.bdf", contents=["lines", "time"])
    assert "TLOAD1" in alone.read_text()
