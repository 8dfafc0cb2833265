"""The exported drive as a C library: the same motion as in Python, by the same compiled code."""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.native_drive import Drive, load

import microvib as mv
from microvib.errors import MicrovibError
from microvib.export.native.drive import drive_image, exportable
from microvib.export.native.library import export_c_library
from microvib.export.native.linking import SOURCES, WRAPPER, compiler, host
from microvib.export.native.objects import code_objects, image_object, platform_of
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.integration import CHUNK_TIME, channels_of, chunk_rows
from microvib.solve.motion import interface_loads
from microvib.solve.pack import pack
from microvib.solve.sampling import Decimator, sample_buffer, sample_intervals

STATE = mv.load_scenario("state-1", {"record.start": "rest", "record.duration": "2 s"})
SIX = STATE.with_(
    {"array.modes.0.interface_participation": [0.4, 3.0, 0.0, 1.2, 0.0, float(STATE.array.H[0])]}
)
SCENARIOS = {
    "state-1": STATE,
    "profile": STATE.with_(
        {
            "tracking.rate": None,
            "tracking.profile": [
                {"rate": "0.1 deg/s", "ramp": "0.5 s", "hold": "0.5 s"},
                {"rate": "-0.07 deg/s", "ramp": "0.7 s"},
            ],
        }
    ),
    "delayed ramps": STATE.with_({"driver.microstep_ramp": 0.5, "driver.delay": "3 ms"}),
    "noise": STATE.with_(
        {"friction.torque_noise": {"density": "1e-6 N^2*m^2/Hz", "highest": "40 Hz"}}
    ),
    "pulses": mv.load_scenario(Path(__file__).parents[2] / "examples" / "pulses.yaml"),
    "distorted": STATE.with_({"driver.imperfections": {"gain_b": 0.02, "dac_bits": 8}}),
}
NEAR = 1e-9
"""Part of the largest value by which figures may be off."""


def off(found, expected):
    """Largest difference over the largest value expected."""
    return np.max(np.abs(found - expected)) / max(np.max(np.abs(expected)), 1e-300)


def rows_in_python(scenario, first, width, count):
    """Interval means as the solver makes them, (count, columns)."""
    packed, command, rows = pack(scenario), Command(scenario), None
    stops = (first, first + count * width)
    rows = np.zeros((count, packed.columns))
    for begun, stop, here in ((0.0, stops[0], rows[:0]), (*stops, rows)):
        samples = sample_buffer(here, first, width)
        assert packed.advance(stop, samples, *command.microsteps(begun, stop)) == kernel.OK
    return rows, packed


@pytest.mark.parametrize("name", SCENARIOS)
def test_rows_are_those_of_python(native, name):
    scenario, width = SCENARIOS[name], 1.0 / 4096.0
    expected, packed = rows_in_python(scenario, 0.5, width, 6144)
    drive = Drive(native(scenario))
    drive.ask("begin_record", 0.5, width)
    found = np.concatenate([drive.record(6144)])
    assert drive.call("time") == 2.0
    for k, channel in enumerate(kernel.CHANNELS):
        assert off(found[:, k], expected[:, k]) < NEAR, channel
    shown = packed.snapshot()
    for k, channel in enumerate(kernel.CHANNELS[: kernel.POWERS]):
        assert drive[channel] == pytest.approx(shown[k], rel=1e-9, abs=1e-15), channel
    drive.free()


def test_samples_are_those_of_a_run(native):
    """Rows through the run's filter, with the run's internal steps: its samples of every channel."""
    motion, intervals = mv.simulate(STATE), sample_intervals(STATE)
    drive, decimator = Drive(native(STATE)), Decimator(intervals.factor)
    drive.ask("begin_record", intervals.first, intervals.width)
    columns = drive.call("columns")
    most = chunk_rows(columns, int(np.ceil(CHUNK_TIME / intervals.width)))
    blocks, done = [], 0
    while done < intervals.rows:
        count, missing = min(most, intervals.rows - done), 0 if done else intervals.missing
        room = decimator.room(missing + count, columns)
        room[missing:] = drive.record(count)
        room[:missing] = room[missing]
        blocks.append(decimator.filtered()[:, : columns - columns % 2])
        done += count
    rows = np.concatenate(blocks)[: STATE.record.samples]
    named = channels_of(rows[:, : pack(STATE).channels], STATE.load.H.size)
    for channel in ("T_d", "T_d_force", "theta_l", "omega_m", "i_A", "T_g"):
        assert off(named[channel], motion[channel]) < NEAR, channel
    drive.free()


def test_loads_are_those_of_a_motion(native):
    scenario = SIX
    drive = Drive(native(scenario))
    before = rows_in_python(scenario, 0.25, 1.0, 0)[1].momentum
    expected, packed = rows_in_python(scenario, 0.25, 0.25, 1)
    row = expected[0, kernel.T_D]
    expected[0, kernel.T_D] = (before - packed.momentum) / 0.25
    assert row == pytest.approx(expected[0, kernel.T_D], rel=1e-3)
    drive.step(0.25)
    drive.step(0.5)
    means = channels_of(expected[:, : packed.channels], scenario.load.H.size)
    at = channels_of(packed.snapshot()[None], scenario.load.H.size)
    for values, ending in ((at, ""), (means, "_mean")):
        loads = interface_loads(values, scenario)[0]
        for name, value in zip(("Fx", "Fy", "Fz", "Mx", "My", "Mz"), loads, strict=True):
            assert drive[name + ending] == pytest.approx(value, rel=1e-9, abs=1e-12), name
    drive.free()


def test_lines_do_not_hang_on_communication_steps(native):
    """Lines to 500 Hz of a record that is asked for in pieces, each of which ends a step."""
    width, settle, seconds = 1e-4, 6.0, 16

    def lines(rows_each):
        drive = Drive(native(STATE))
        drive.ask("begin_record", settle, width)
        count = round(seconds / width) // rows_each
        torque = [drive.record(rows_each)[:, kernel.T_D] for _ in range(count)]
        drive.free()
        windowed = np.concatenate(torque) * np.hanning(round(seconds / width))
        return np.fft.rfft(windowed)[: 500 * seconds]

    whole = lines(round(seconds / width))
    largest = np.max(np.abs(whole))
    for rows_each in (1, 10, 100, 1000, 10_000):  # 1e-4 s to 1 s
        assert np.max(np.abs(lines(rows_each) - whole)) < 1e-5 * largest, rows_each


@pytest.mark.parametrize("step", [1e-3, 7e-3, 0.05, 0.5])
def test_independent_steps_do_not_hang_on_communication_steps(native, step):
    """Impulses over half seconds and the state at their ends, without an input, against one step each."""

    def motion(each):
        drive, found = Drive(native(STATE)), []
        drive.ask("set_independent", 1)
        for half in range(8):
            stops = [*np.arange(0.5 * half, 0.5 * (half + 1) - 1e-9, each)[1:], 0.5 * (half + 1)]
            impulse, now = 0.0, 0.5 * half
            for stop in stops:
                drive.step(stop)
                impulse, now = impulse + drive["T_d_mean"] * (stop - now), stop
            found.append((impulse, *(drive[name] for name in ("T_d", "theta_l", "omega_l", "i_A"))))
        drive.free()
        return np.array(found)

    expected = motion(0.5)
    found = motion(step)
    assert np.all(
        np.max(np.abs(found - expected), axis=0) < NEAR * np.max(np.abs(expected), axis=0)
    )


def test_independent_steps_end_where_an_input_changes(native):
    """States are saved and restored with what is kept; a change of the rate acts at its time."""
    drive, other = Drive(native(STATE)), Drive(native(STATE))
    for one in (drive, other):
        one.ask("set_independent", 1)
        for time in (0.1, 0.2234):
            one.step(time)
    kept = drive.state
    drive.step(0.5)
    drive.state = kept
    for one in (drive, other):
        one.ask("set_rate", 2e-3)
        one.step(0.7)
    assert drive["T_d"] == other["T_d"]
    plain = Drive(native(STATE))
    plain.step(0.2234)
    plain.ask("set_rate", 2e-3)
    plain.step(0.7)
    assert other["theta_l"] == pytest.approx(plain["theta_l"], rel=1e-5)
    assert other["microsteps"] == plain["microsteps"]
    with pytest.raises(RuntimeError, match="before the first step alone"):
        drive.ask("set_independent", 0)
    for one in (drive, other, plain):
        one.free()


def test_state_goes_back_to_the_middle_of_a_stick(native):
    drive = Drive(native(STATE))
    time = 1.0
    drive.step(time)
    while drive["stuck_output"] != 1.0:
        time += 1e-3
        assert time < 3.0
        drive.step(time)
    kept = drive.state
    drive.ask("begin_record", time, 1e-3)
    first = drive.record(800)
    other = Drive(native(STATE))
    other.step(0.3)
    other.state = kept
    assert other.call("time") == time
    assert other["stuck_output"] == 1.0
    other.ask("begin_record", time, 1e-3)
    assert np.array_equal(other.record(800), first)
    assert len(np.unique(first[:, kernel.CHANNELS.index("stuck_output")])) > 1
    drive.free()
    other.free()


def test_a_state_has_the_parameters_and_how_steps_are_made(native):
    """Put into another instance of the drive, whose own were others, it goes on as the first does."""
    drive, other = Drive(native(STATE)), Drive(native(STATE))
    drive.set_parameter("reducer.stiffness", 9000.0)
    drive.set_parameter("driver.microsteps", 48.0)
    drive.set_parameter("tracking.rate", 2e-3)
    drive.ask("set_independent", 1)
    other.set_parameter("motor.detent_torque", 0.0)
    other.step(0.2)
    drive.step(0.5)
    kept = drive.state
    drive.step(0.9)
    other.state = kept
    assert other.state == kept
    other.step(0.9)
    assert other["T_d"] == drive["T_d"] != 0.0
    assert other["microsteps"] == drive["microsteps"]
    drive.free()
    other.free()


def test_a_state_of_another_drive_is_refused(native):
    drive = Drive(native(STATE))
    other = Drive(native(STATE.with_({"motor.detent_torque": "1 mN*m"})))
    drive.step(0.1)
    assert drive.call("state_bytes") == other.call("state_bytes")
    with pytest.raises(RuntimeError, match=r"^the state is none of this drive's$"):
        other.state = drive.state
    assert other.call("time") == 0.0
    drive.free()
    other.free()


def test_a_thousand_instances_share_nothing(native):
    library = native(STATE)
    drives = [Drive(library) for _ in range(1000)]
    for k, drive in enumerate(drives):
        drive.step(0.01 + 1e-5 * (k % 7))
    alone = []
    for k in range(7):
        drive = Drive(library)
        drive.step(0.01 + 1e-5 * k)
        alone.append(drive["T_d"])
        drive.free()
    assert [drive["T_d"] for drive in drives] == [alone[k % 7] for k in range(1000)]
    for drive in drives:
        drive.free()


def test_two_libraries_in_one_process_keep_apart(c_library):
    """However they are loaded: each has its own drive."""
    found = []
    for scenario in (STATE, SIX):
        (path,) = c_library(scenario).glob("drive-*")
        found.append(load(path, ctypes.RTLD_GLOBAL))
    outputs = [Drive(library).call("outputs") for library in found]
    assert outputs[1] == outputs[0] + 12  # six loads and their means


def test_rate_from_outside_is_the_profile(native):
    inside, outside = Drive(native(STATE)), Drive(native(STATE))
    outside.ask("set_rate", float(STATE.tracking.rate))
    for time in (0.3, 0.9):
        inside.step(time)
        outside.step(time)
        assert outside["T_d"] == inside["T_d"]
    outside.ask("set_rate", 0.0)
    held = outside.call("microsteps")
    outside.step(4.0)
    assert outside.call("microsteps") == held
    assert abs(outside["omega_l"]) < 1e-6
    inside.free()
    outside.free()


def test_microsteps_from_outside_are_the_profile(native):
    inside, outside = Drive(native(STATE)), Drive(native(STATE))
    times, counts, *_ = Command(STATE).crossings(0.0, 1.0)
    for time, count in zip(times, counts, strict=True):
        outside.step(time)
        outside.ask("set_microsteps", int(count))
    for drive in (inside, outside):
        drive.step(1.0)
    assert outside["theta_l"] == pytest.approx(inside["theta_l"], rel=1e-6)
    assert outside["microsteps"] == inside["microsteps"] == counts[-1]
    inside.free()
    outside.free()


def test_example_in_c_compiles_and_runs(c_library, cc, tmp_path):
    folder = c_library(STATE)
    (library,) = folder.glob("drive-*")
    program = tmp_path / "example"
    subprocess.run(
        [cc, "-Wall", "-Werror", str(folder / "example.c"), str(library), "-o", str(program)],
        check=True,
    )
    said = subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout
    in_python = subprocess.run(
        [sys.executable, str(folder / "example.py"), str(library)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    rows = np.array([line.split(",") for line in said.splitlines()[1:]], dtype=float)
    same = np.array([line.split(",") for line in in_python.splitlines()[1:]], dtype=float)
    assert np.array_equal(rows[:, :2], same)
    assert np.ptp(rows[:, 1]) > 1e-3


@pytest.mark.release
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_valgrind_finds_nothing(c_library, cc, tmp_path):
    folder = c_library(STATE)
    (library,) = folder.glob("drive-*")
    program = tmp_path / "example"
    subprocess.run([cc, str(folder / "example.c"), str(library), "-o", str(program)], check=True)
    done = subprocess.run(
        ["valgrind", "--error-exitcode=9", "--leak-check=full", str(program)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("host_program", ["example.c", "fmi2_host.c"])
def test_sanitizers_find_nothing(host_program, c_library, cc, tmp_path):
    """Wrapper, FMI's functions and hosts under AddressSanitizer and the sanitizer of undefined behaviour,
    where the compiler has them; the compiled equations are looked at by valgrind."""
    platform, sources = platform_of(host()), [SOURCES / name for name in WRAPPER]
    if host_program == "example.c":
        program = c_library(STATE) / host_program
    else:
        program = Path(__file__).with_name(host_program)
        sources.append(SOURCES / "fmu.c")
    objects = code_objects(platform) | {"image": image_object(platform, drive_image(STATE))}
    for name, content in objects.items():
        (tmp_path / f"{name}.o").write_bytes(content)
    two = ["-DMICROVIB_TWO_PROCESSORS"] if len(platform.processors) > 1 else []
    built = subprocess.run(
        [
            cc, "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", f"-I{SOURCES}",
            "-DMICROVIB_BUILT_IN", '-DMICROVIB_GUID="token"', *two, str(program), *map(str, sources),
            *(str(tmp_path / f"{name}.o") for name in objects), "-lm", "-o", str(tmp_path / "made"),
        ],
        capture_output=True,
        text=True,
    )  # fmt: skip
    if "asan" in built.stderr or "ubsan" in built.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert built.returncode == 0, built.stderr
    done = subprocess.run([str(tmp_path / "made")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_bad_calls_are_sentences(native):
    drive = Drive(native(STATE))
    drive.step(0.5)
    for name, arguments, said in (
        ("do_step", (0.2,), "not after the present one, 0.5 s"),
        ("do_step", (float("nan"),), "not after"),
        ("record", (1, None), "no record has begun"),
        ("set_rate", (float("inf"),), "not a finite number"),
        ("set_rate", (1e200,), "at most 5000000 are followed"),
        ("set_shaft_torque", (float("nan"),), "not a finite number"),
    ):
        with pytest.raises(RuntimeError, match=said):
            drive.ask(name, *arguments)
    drive.ask("set_rate", 1.0)
    with pytest.raises(RuntimeError, match="loss of synchronism"):
        drive.step(2.0)
    drive.free()


def test_an_image_is_looked_at_before_it_is_opened(native):
    library, image = native(STATE), drive_image(STATE)
    assert library.microvib_memory(image, len(image)) > len(image)
    words = np.frombuffer(image, dtype=np.int64)
    for word, value in (
        (0, 1),
        (1, 99),
        (2, 1 << 40),
        (3, 1 << 40),
        (4, -1),
        (5, -8),
        (6, 1 << 30),
        (9, -1),
    ):
        broken = words.copy()
        broken[word] = value
        assert library.microvib_memory(broken.tobytes(), len(image)) == 0, word
    wild = words.copy()
    wild[words[7]] = 1 << 50  # an address outside
    assert library.microvib_memory(wild.tobytes(), len(image)) == 0
    assert library.microvib_memory(image[:-8], len(image) - 8) == 0
    room, why = (
        ctypes.create_string_buffer(library.microvib_memory(image, len(image))),
        ctypes.create_string_buffer(256),
    )
    assert library.microvib_open(image, len(image), room, why, 256)
    assert not library.microvib_open(image, len(image), None, why, 256)
    assert b"there is no memory for a drive" in why.value
    assert not library.microvib_open(image[:-8], len(image) - 8, room, why, 256)
    assert b"none of microvib's, cut off, or of another version than 1" in why.value


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"driver.microstep_shape": [{}, {"fraction": 0.5, "after": "1 ms"}]}, "microstep_shape"),
        ({"driver.compensation": [{"order": 2, "amplitude": "1 arcsec"}]}, "compensation"),
    ],
)
def test_what_cannot_be_exported_is_said(changes, said):
    with pytest.raises(MicrovibError, match=f"^driver.{said}: .* leave {said} out$"):
        exportable(STATE.with_(changes))


def test_other_content_of_a_folder_stays(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(MicrovibError, match="holds other content"):
        export_c_library(STATE, tmp_path)


def test_a_missing_compiler_is_one_sentence(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MicrovibError, match=r"win64: this needs ziglang.*microvib\[export\]'$"):
        compiler(platform_of("win64"))
    assert compiler(platform_of(host()))
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(MicrovibError, match=f"{host()}: this needs ziglang"):
        compiler(platform_of(host()))
    with pytest.raises(MicrovibError, match="amiga is not known; write some of linux64"):
        platform_of("amiga")
