"""A file to start from: gears of the catalog, and what a data sheet says."""

import csv
import math
import re
import time
from importlib import resources
from itertools import combinations, pairwise, product
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pty", reason="pseudo-terminals are of POSIX")

from support.commands import SHORT, microvib
from support.terminal import in_terminal

import microvib as mv
from microvib.errors import OptionError
from microvib.io.data_sheet import read_entry
from microvib.io.gears import catalog_gears
from microvib.io.named import catalog_text
from microvib.io.new_scenario import new_text
from microvib.reports.parameters import provenance
from microvib.units import convert

SIZES = (14, 17, 20, 25, 32)


def test_the_page_of_the_motor_has_the_catalog_of_gears():
    with (resources.files("microvib.catalog") / "harmonic_gears.csv").open() as stream:
        rows = [[float(x) for x in row.values()] for row in csv.DictReader(stream)]
    page = (Path(__file__).parents[1] / "docs/howto/motor.md").read_text()
    told = [re.sub(r"(?<=\d) (?=\d)", "", line.strip("| ")) for line in page.splitlines()]
    printed = [
        [float(x) for x in line.split("|")]
        for line in told
        if line[:2].isdigit() and line.count("|") == 7
    ]
    assert printed == rows
    assert tuple(catalog_gears()) == SIZES


def test_gears_get_stiffer_with_torque_and_with_size():
    gears = list(catalog_gears().values())
    for gear in gears:
        assert gear.stiffnesses == tuple(sorted(gear.stiffnesses))
        assert gear.torques[0] < gear.torques[1]
    for small, large in pairwise(gears):
        assert small.stiffnesses < large.stiffnesses
        assert small.torques < large.torques
        assert small.accuracy >= large.accuracy


@pytest.mark.parametrize("size", SIZES)
def test_a_gear_gives_its_stiffness_and_half_of_its_accuracy(size):
    scenario, gear = mv.new_scenario(gear=f"size {size} ratio 120"), catalog_gears()[size]
    reducer = scenario.reducer
    (error,) = reducer.transmission_error
    assert (reducer.ratio, reducer.stiffness) == (120.0, gear.stiffnesses[0])
    assert (error.order, error.amplitude) == (
        2,
        pytest.approx(convert(f"{gear.accuracy} arcmin", "rad") / 2),
    )
    critical = 2.0 * math.sqrt(reducer.stiffness * scenario.output_inertia)
    assert reducer.damping == pytest.approx(0.02 * critical, rel=6e-3)  # written with three digits


def test_of_the_gear_the_file_says_what_is_of_the_data_sheet_and_what_is_assumed():
    scenario = mv.new_scenario(gear="Size 20, ratio 100")
    assert scenario.source_of("reducer.stiffness").startswith("data sheet: K1 of size 20")
    assert "T1 = 7 N m" in scenario.source_of("reducer.stiffness")
    for key in (
        "damping",
        "wave_generator_inertia",
        "transmission_error.0.order",
        "transmission_error.0.phase",
        "transmission_error.0.amplitude",
    ):
        assert scenario.source_of(f"reducer.{key}").startswith("assumed: ")
    others = [key for key, *_ in scenario.entries() if not key.startswith("reducer.")]
    plain = mv.new_scenario()
    others.remove("record.duration")
    cycle = 2.0 * math.pi / (2 * 100 * scenario.rate)
    assert (
        plain.record.duration < 2.0 * cycle <= scenario.record.duration < 2.0 * cycle + 1.0 + 1e-6
    )
    assert all(
        scenario[key] == plain[key] and scenario.source_of(key) == plain.source_of(key)
        for key in others
    )


def test_the_commented_file_stays_as_it_is_but_for_the_gear():
    assert new_text() == catalog_text("new")
    plain, geared = (set(text.splitlines()) for text in (new_text(), new_text("size 14 ratio 100")))
    assert {line.split(":")[0].strip(" #") for line in plain - geared} == {
        "reducer.stiffness", "reducer.damping", "stiffness", "damping", "wave_generator_inertia", "transmission_error", "- {order", "hysteresis",
        "duration",
    }  # fmt: skip


def test_a_wave_generator_grows_with_the_size_of_its_gear_and_is_assumed():
    """As bodies of one shape, by the fifth power."""
    found = {}
    for size in SIZES:
        scenario = mv.new_scenario(gear=f"size {size} ratio 100")
        found[size] = scenario.reducer.wave_generator_inertia
        said = scenario.source_of("reducer.wave_generator_inertia")
        assert said.startswith(f"assumed: of size {size}")
        assert "range " in said
    for size in SIZES:
        assert found[size] == pytest.approx(found[14] * (size / 14) ** 5, rel=0.01)
    sheet = mv.new_scenario(holding_torque="0.5 N*m", gear="size 32 ratio 100")
    assert sheet.reducer.wave_generator_inertia == found[32]


def test_what_is_assumed_of_a_gear_is_told(tmp_path):
    alone = microvib("new", "a.yaml", "--gear", "size 25 ratio 100", cwd=tmp_path)
    sheet = microvib(
        "new", "b.yaml", "--from-datasheet", "--gear", "size 25 ratio 100", cwd=tmp_path
    )
    for done in (alone, sheet):
        for key in (
            "wave_generator_inertia: 0.599 kg*cm^2",
            "damping: ",
            "transmission_error.0.amplitude: 24 arcsec",
        ):
            assert f"  reducer.{key}" in done.stdout
        assert "The gear's hysteresis is in the file as a comment" in done.stdout
    assert "friction (with the gear's)" in alone.stdout


def test_a_gear_on_the_command_line(tmp_path):
    done = microvib("new", "my.yaml", "--gear", "size 14 ratio 100", cwd=tmp_path)
    assert done.exit_code == 0, done.output
    assert mv.load_scenario(tmp_path / "my.yaml") == mv.new_scenario(gear="size 14 ratio 100")


@pytest.mark.parametrize(
    ("gear", "sentence"),
    [
        ("size 15 ratio 100", "size 15 is not in the catalog; sizes are 14, 17, 20, 25, 32"),
        ("size 14", "has no ratio; write 'size 14 ratio 100'"),
        ("size 14 ratio 50", "are for ratios from 80 to 160, not 50"),
        ("a big one", "is not a gear; write 'size 14 ratio 100', sizes are 14, 17, 20, 25, 32"),
        ("size " + 5000 * "9", "is not a gear"),
    ],
)
def test_a_gear_that_is_none_is_told_in_one_sentence(tmp_path, gear, sentence):
    done = microvib("new", "my.yaml", "--gear", gear, cwd=tmp_path)
    assert done.exit_code == 1
    assert str(done.stderr).startswith("Error: --gear: ")
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


# -- a data sheet ----------------------------------------------------------------------------------------------------

SHEET = {
    "holding_torque": "0.5 N*m", "phases_on": "2", "current": "0.8 A", "detent": "4 percent", "step_angle": "0.0075 deg",
    "ratio": "120", "resistance": "5 ohm", "inductance": "9 mH", "rotor_inertia": "0.11 kg*cm^2", "microsteps": "32",
    "gear": "size 17",
}  # fmt: skip
OPTIONS = [word for key, text in SHEET.items() for word in (f"--{key.replace('_', '-')}", text)]


def largest_torque(scenario: mv.Scenario, i_A: float, i_B: float) -> float:
    """Of Eq. 4 over the rotor's angle, without detent torque [N m]."""
    motor = scenario.motor
    theta = np.linspace(0.0, 2.0 * math.pi / motor.rotor_teeth, 100_001)
    z = motor.rotor_teeth
    return float(
        np.max(motor.torque_constant * (i_B * np.cos(z * theta) - i_A * np.sin(z * theta)))
    )


@pytest.mark.parametrize(("on", "currents"), [("2", (0.8, 0.8)), ("1", (0.8, 0.0))])
def test_a_holding_torque_is_what_the_motor_then_holds(on, currents):
    scenario = mv.new_scenario(**{**SHEET, "phases_on": on})
    assert scenario.motor.current == 0.8
    assert largest_torque(scenario, *currents) == pytest.approx(0.5, rel=1e-5)
    assert scenario.motor.detent_torque == pytest.approx(0.02)


@pytest.mark.parametrize(("phases", "on"), [(3, 1), (3, 2), (3, 3), (5, 4), (5, 5)])
def test_a_holding_torque_of_more_phases_is_what_they_then_hold(phases, on):
    """Over all ways to feed I forward or backward into so many of the phases, and over the rotor's angle."""
    scenario = mv.new_scenario(
        **{**SHEET, "phases": str(phases), "phases_on": str(on), "step_angle": "0.01 deg"}
    )
    assert (scenario.motor.phases, scenario.driver.beats) == (phases, 2 * phases)
    assert scenario.motor.rotor_teeth == 360 / (2 * phases * 120 * 0.01)
    axes = np.exp(2j * math.pi * np.arange(phases) / phases)
    best = max(
        abs(sum(sign * axes[k] for sign, k in zip(signs, chosen, strict=True)))
        for chosen in combinations(range(phases), on)
        for signs in product((1, -1), repeat=on)
    )
    assert scenario.motor.torque_constant * 0.8 * best == pytest.approx(0.5, rel=1e-5)


def test_a_data_sheet_of_a_drive_without_a_loop_has_no_gains():
    scenario = mv.new_scenario(**SHEET, drive="voltage")
    assert scenario.driver.drive == "voltage"
    assert (scenario.driver.proportional_gain, scenario.driver.integral_gain) == (0.0, 0.0)
    assert scenario.driver.time_constant(scenario.motor) == pytest.approx(9e-3 / 5.0)


PULSED = {
    "drive": "pulse", "holding_torque": "0.3 N*m", "phases_on": "1", "current": "0.25 A", "ratio": "200",
    "resistance": "280 ohm", "supply_voltage": "71 V", "on_time": "45 ms", "diode_voltage": "9 V",
    "clamp": "bidirectional",
}  # fmt: skip


def test_a_data_sheet_of_a_pulse_drive_becomes_one(tmp_path):
    options = [word for k, text in PULSED.items() for word in (f"--{k.replace('_', '-')}", text)]
    done = microvib("new", "my.yaml", "--from-datasheet", *options, cwd=tmp_path)
    assert done.exit_code == 0, done.output
    scenario = mv.load_scenario(tmp_path / "my.yaml")
    driver = scenario.driver
    assert (driver.drive, driver.microsteps, driver.beats) == ("pulse", 1, 4)
    assert (driver.supply_voltage, driver.on_time, driver.diode_voltage) == (71.0, 0.045, 9.0)
    assert (driver.proportional_gain, driver.integral_gain) == (0.0, 0.0)
    assert driver.clamp == "bidirectional"
    for key in ("supply_voltage", "on_time", "diode_voltage"):
        assert scenario.source_of(f"driver.{key}").startswith("data sheet: ")
        assert f"driver.{key}" not in done.stdout
    assert "tracking.rate" in done.stdout  # an example
    assert mv.simulate(scenario.with_si({"record.duration": 20.0}), channels="T_d").steps.judged > 9


def test_what_a_sheet_of_a_pulse_drive_does_not_say_is_assumed_with_its_range():
    few = {key: PULSED[key] for key in ("drive", "resistance", "current")}
    scenario = mv.new_scenario(**few)
    assert scenario.driver.supply_voltage == pytest.approx(280.0 * 0.25)
    for key in ("supply_voltage", "on_time", "diode_voltage"):
        assert re.search(r"^assumed: .*; range .+ to ", scenario.source_of(f"driver.{key}"))


@pytest.mark.parametrize(("ratio", "on_time"), [("1", "60 ms"), ("1000", "60 ms"), ("100", "3 s")])
def test_the_example_of_a_command_leaves_time_between_pulses(ratio, on_time):
    gear = {"gear": "none"} if ratio == "1" else {"ratio": ratio}
    scenario = mv.new_scenario(drive="pulse", on_time=on_time, **gear)
    step = scenario.driver.full_step(scenario.motor) / scenario.reducer.ratio / scenario.rate
    assert step >= 3.9 * scenario.driver.on_time
    assert scenario.record.duration > 49.0 * step


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"drive": "current"}, "on_time: belongs to drive pulse, but current is stated; state pulse"),
        ({"phases": "3"}, "phases: 3 is not allowed with drive pulse; 2 are expected, or none"),
        ({"clamp": "8 V"}, "clamp: '8 V' is not allowed; write 'unidirectional' or 'bidirectional'"),
        ({"microsteps": "16"}, "microsteps: 16 is not allowed with drive pulse"),
        ({"on_time": "60"}, "on_time: '60' needs a unit, such as"),
        ({"diode_voltage": "0 V"}, "diode_voltage: '0 V' is not allowed; it must be greater than 0"),
        ({"supply_voltage": "-70 V"}, "supply_voltage: '-70 V' is not allowed"),
    ],
)  # fmt: skip
def test_an_entry_that_does_not_go_with_pulses_is_told(changes, words):
    with pytest.raises(OptionError) as caught:
        mv.new_scenario(**{**PULSED, **changes})
    assert words in str(caught.value)


def test_an_entry_of_pulses_says_that_the_drive_is_pulsed():
    for key in ("on_time", "diode_voltage", "clamp"):
        assert mv.new_scenario(**{key: PULSED[key]}).driver.pulsed


def test_a_supply_voltage_limits_a_current_loop():
    assert mv.new_scenario(**SHEET, supply_voltage="28 V").driver.supply_voltage == 28.0


def test_a_gear_brings_its_hysteresis_as_a_comment_that_can_be_made_to_act(tmp_path):
    text = new_text("size 17 ratio 100")
    line = next(line for line in text.splitlines() if "hysteresis:" in line and "loss" in line)
    assert line.startswith("  # hysteresis: {loss: 1 arcmin, stiffness: 10000 N*m/rad}  #")
    path = tmp_path / "my.yaml"
    path.write_text(text.replace("  # hysteresis:", "  hysteresis:"))
    reducer = mv.load_scenario(path).reducer
    assert reducer.hysteresis.loss == pytest.approx(math.radians(1 / 60))
    assert reducer.hysteresis_torque == pytest.approx(0.5 * math.radians(1 / 60) * 10_000)


def test_a_data_sheet_becomes_a_scenario():
    scenario = mv.new_scenario(**SHEET)
    motor, driver = scenario.motor, scenario.driver
    assert math.degrees(driver.full_step(motor)) / scenario.reducer.ratio == pytest.approx(0.0075)
    assert (motor.rotor_teeth, driver.microsteps, scenario.reducer.ratio) == (100, 32, 120.0)
    assert (motor.winding_resistance, motor.winding_inductance) == (5.0, pytest.approx(9e-3))
    assert motor.rotor_inertia == pytest.approx(1.1e-5)
    assert scenario.reducer.stiffness == 10_000.0
    # the zero of the current loop cancels the winding's pole; its bandwidth is assumed
    assert driver.integral_gain / driver.proportional_gain == pytest.approx(5.0 / 9e-3, rel=1e-5)
    stated = {
        key
        for key, *_ in scenario.entries()
        if provenance(scenario.source_of(key)).status == "data sheet"
    }
    assert stated == {
        "motor.rotor_teeth", "motor.current", "motor.torque_constant", "motor.detent_torque", "motor.winding_resistance",
        "motor.winding_inductance", "motor.rotor_inertia", "driver.microsteps", "reducer.ratio", "reducer.stiffness",
    }  # fmt: skip
    others = [key for key, *_ in scenario.entries() if key not in stated]
    assert all(provenance(scenario.source_of(key)).status == "assumed" for key in others)


@pytest.mark.parametrize("missing", list(SHEET))
def test_what_is_missing_is_assumed_and_lies_in_its_range(missing):
    scenario = mv.new_scenario(
        **{key: text for key, text in SHEET.items() if key not in (missing, "gear")}
    )
    ranged = 0
    for key, value, quantity in scenario.entries():
        found = re.search(r"; range (.+) to (.+)$", scenario.source_of(key))
        if found:
            low, high = (
                convert(text, quantity.unit if quantity else "") for text in found.groups()
            )
            assert low <= value <= high * 1.001
            assert low < high
            (
                scenario.with_si({key: low if quantity else int(low)}),
                scenario.with_si({key: high if quantity else int(high)}),
            )
            ranged += 1
    assert ranged >= 8


def test_without_a_ratio_the_step_at_the_output_says_it():
    scenario = mv.new_scenario(step_angle="0.02 deg")
    assert (scenario.motor.rotor_teeth, scenario.reducer.ratio) == (50, pytest.approx(90.0))
    assert scenario.source_of("reducer.ratio").startswith("assumed: ")


def test_a_file_of_a_data_sheet_reads_back_and_runs(tmp_path):
    done = microvib("new", "my.yaml", "--from-datasheet", *OPTIONS, cwd=tmp_path)
    assert done.exit_code == 0, done.output
    told = {
        line.split(":")[0].strip() for line in done.stdout.splitlines() if line.startswith("  ")
    }
    assert told == {
        "driver.proportional_gain", "driver.integral_gain", "reducer.damping", "reducer.transmission_error.0.amplitude",
        "reducer.wave_generator_inertia",
    }  # fmt: skip
    scenario = mv.load_scenario(tmp_path / "my.yaml")
    assert scenario == mv.new_scenario(**SHEET)
    ran = microvib("run", "my.yaml", *SHORT, "--lines-only", "--out", "out", cwd=tmp_path)
    assert ran.exit_code == 0, ran.output
    assert "drive_1" in ran.stdout


def test_a_person_at_a_terminal_is_asked_and_asked_again(tmp_path):
    answers = [
        "0.5",
        "0.5 N*m",
        "",
        "6",
        "2",
        "0.8 A",
        "4 percent",
        "0.0075 deg",
        "120",
        "5 ohm",
        "9 mH",
        "",
        "",
        "",
        "",
        "",
        "",
        "32",
        "size 17",
        "",
    ]
    shown = in_terminal(
        "new", "my.yaml", "--from-datasheet", cwd=tmp_path, columns=300, typed=answers
    )
    assert shown.status == 0, shown.text
    assert "needs a unit, such as '0.5 N*m'" in shown.text
    assert "6 is not allowed; a whole number from 1 to 5 is expected" in shown.text
    sheet = {key: text for key, text in SHEET.items() if key != "rotor_inertia"}
    assert mv.load_scenario(tmp_path / "my.yaml") == mv.new_scenario(**sheet)


def test_answers_that_contradict_each_other_are_asked_for_again(tmp_path):
    """The motor's step in place of the output's is known to be wrong only in the end; the other answers stay."""
    answers = ["0.5 N*m", "", "", "", "", "1.8 deg", "1:100", *[""] * 11, "0.018 deg"]
    shown = in_terminal(
        "new", "my.yaml", "--from-datasheet", cwd=tmp_path, columns=300, typed=answers
    )
    assert shown.status == 0, shown.text
    assert (
        "Full step at the output: 1.8 deg at the output is 180 deg at the motor with ratio 100"
        in shown.text
    )
    expected = mv.new_scenario(holding_torque="0.5 N*m", step_angle="0.018 deg", ratio="100")
    assert mv.load_scenario(tmp_path / "my.yaml") == expected


@pytest.mark.parametrize("text", ["100", "1:100", "100:1", "1 : 100"])
def test_a_ratio_is_read_as_data_sheets_write_it(text):
    assert read_entry("ratio", text) == 100.0


def test_a_person_who_gives_up_leaves_no_file(tmp_path):
    def waiting(written: str) -> bool:
        return "Holding" in written and not time.sleep(
            0.5
        )  # until it reads: before, the interrupt is seen with the next key

    shown = in_terminal(
        "new", "my.yaml", "--from-datasheet", cwd=tmp_path, until=waiting, seconds=30.0
    )
    assert shown.status == 130
    assert list(tmp_path.iterdir()) == []


def test_nobody_is_asked_through_a_pipe(tmp_path):
    done = microvib("new", "my.yaml", "--from-datasheet", cwd=tmp_path)
    assert done.exit_code == 1
    assert done.stderr.startswith(
        "Error: --from-datasheet: no terminal to ask questions on; give at least one of --holding-torque,"
    )
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--holding-torque", "0.5"], "--holding-torque: '0.5' needs a unit, such as '0.5 N*m'"),
        (
            ["--detent", "80 percent"],
            "--detent: '80 percent' is not allowed; it must be at least 0 and at most 0.5",
        ),
        (
            ["--phases-on", "6"],
            "--phases-on: 6 is not allowed; a whole number from 1 to 5 is expected",
        ),
        (
            ["--phases-on", "3"],
            "--phases-on: 3 is not allowed with 2 phases; 1 to that number is expected",
        ),
        (["--phases", "4"], "--phases: 4 is not allowed; write 2, 3 or 5"),
        (
            ["--drive", "power"],
            "--drive: 'power' is not allowed; write 'current', 'voltage' or 'pulse'",
        ),
        (
            ["--resistance", "-1 ohm"],
            "--resistance: '-1 ohm' is not allowed; it must be greater than 0 ohm",
        ),
        (
            ["--microsteps", "many"],
            "--microsteps: 'many' is not allowed; a whole number from 1 to 65536 is expected",
        ),
        (["--step-angle", "1.8 deg"], "--step-angle: 1.8 deg at the output would be ratio 1"),
        (
            ["--step-angle", "0.018 deg", "--ratio", "170"],
            "is 3.06 deg at the motor with ratio 170: 90 deg over a whole",
        ),
        (
            ["--gear", "size 14 ratio 100", "--ratio", "120"],
            "has another ratio than the one given separately, 120",
        ),
        (["--gear", "size 13"], "size 13 is not in the catalog"),
        (
            ["--gear", "none", "--ratio", "5"],
            "--ratio: 5 is not allowed without a gear; 1 is expected, or none",
        ),
        (
            ["--gear", "spur"],
            "write 'size 14 ratio 100', sizes are 14, 17, 20, 25, 32; or of a data sheet planetary or none",
        ),
        (
            ["--holding-torque", "0.5 N*m", "--detent", "0.3 N*m"],
            "--detent: 0.3 N m is 60 % of the holding torque; at most 50 % is expected",
        ),
    ],
)
def test_a_data_sheet_that_is_wrong_is_told_in_one_sentence(tmp_path, arguments, sentence):
    done = microvib("new", "my.yaml", "--from-datasheet", *arguments, cwd=tmp_path)
    assert done.exit_code == 1
    assert sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "sheet", [{"ratio": "1"}, {"gear": "none"}, {"gear": "None", "step_angle": "1.8 deg"}]
)
def test_a_drive_without_a_gear_gets_none(sheet):
    reducer = mv.new_scenario(holding_torque="0.8 N*m", **sheet).reducer
    assert (reducer.rigid, reducer.h, reducer.input_inertia, reducer.errors) == (
        True,
        -1.0,
        0.0,
        (),
    )


@pytest.mark.parametrize("sheet", [{"ratio": "50", "gear": "planetary"}, {"ratio": "5"}])
def test_a_planetary_gear_has_no_errors_of_a_wave_generator(sheet):
    drive = mv.new_scenario(holding_torque="0.8 N*m", **sheet)
    assert (drive.reducer.h, drive.reducer.errors, drive.reducer.rigid) == (
        -float(sheet["ratio"]),
        (),
        False,
    )
    assert drive.source_of("reducer.same_way").startswith("assumed")
    assert "range 2000 N*m/rad" in drive.source_of("reducer.stiffness")


def test_a_detent_torque_is_read_as_data_sheets_write_it():
    drive = mv.new_scenario(holding_torque="0.4 N*m", detent="18 mNm")
    assert drive["motor.detent_torque"] == pytest.approx(0.018)
    assert (
        drive.source_of("motor.detent_torque")
        == "data sheet: detent torque, taken for the amplitude"
    )
    assert (
        drive["motor.detent_torque"]
        == mv.new_scenario(holding_torque="0.4 N*m", detent="4.5 percent")["motor.detent_torque"]
    )


def test_the_third_harmonic_of_the_back_emf_becomes_one_of_the_flux(tmp_path):
    done = microvib(
        "new", "my.yaml", "--from-datasheet", "--third-harmonic", "2 percent", cwd=tmp_path
    )
    assert done.exit_code == 0, done.stderr
    drive = mv.load_scenario(tmp_path / "my.yaml")
    assert [(h.order, h.amplitude, h.phase) for h in drive.motor.flux_harmonics] == [(3, 0.02, 0.0)]
    assert "phase is assumed" in drive.source_of("motor.flux_harmonics.0.amplitude")


def test_the_command_that_comes_next_can_be_copied(tmp_path):
    done = microvib("new", "Antrieb Süd 1.yaml", cwd=tmp_path)
    assert done.stdout.rstrip().endswith("microvib run 'Antrieb Süd 1.yaml'")


def test_entries_of_a_data_sheet_want_to_be_called_so(tmp_path):
    done = microvib("new", "my.yaml", "--ratio", "100", cwd=tmp_path)
    assert (done.exit_code, done.stderr) == (
        1,
        "Error: --ratio: belongs to a data sheet; it needs --from-datasheet\n",
    )
