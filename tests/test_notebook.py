"""What a notebook sees: completion, tables that show themselves, sentences for what is typed wrong."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

import microvib as mv
from microvib.errors import LineError
from microvib.model.tracking import Tracking
from microvib.solve.batch import simulate_torques
from microvib.units import Si


@pytest.fixture(scope="module")
def table(motion_1):
    return mv.find_lines(motion_1)


def test_keys_of_a_scenario_complete_and_give_their_values(state_1):
    keys = state_1._ipython_key_completions_()
    assert "tracking.rate" in keys
    for key, value, _ in state_1.entries():
        assert key in keys
        assert state_1[key] == value
    assert state_1["reducer"] is state_1.reducer
    assert {"stiffness", "ratio", "rigid"} <= set(dir(state_1.reducer))
    assert not [name for name in dir(state_1.reducer) if name.startswith(("model_", "_", "parse_"))]


@pytest.mark.parametrize(
    ("key", "sentence"),
    [
        (
            "reducer.stifness",
            "reducer.stifness: unknown key; did you mean reducer.stiffness? allowed here are ratio, ",
        ),
        ("traking.rate", "traking: unknown key; did you mean tracking? allowed here are title, "),
        (
            "stiffness",
            "stiffness: unknown key; did you mean reducer.stiffness? allowed here are title, ",
        ),
        (
            "array.modes.0.freqency",
            "did you mean array.modes.0.frequency? allowed here are frequency, damping",
        ),
    ],
)
def test_a_misspelt_key_is_told_what_it_may_mean(state_1, key, sentence):
    with pytest.raises(mv.ScenarioError) as error:
        state_1.with_({key: "1 deg/s"})
    assert sentence in str(error.value)


def test_a_key_that_is_looked_up_and_is_not_there(state_1):
    for key in ("reducer.stifness", "array.modes.1.frequency", "array.modes.x", "reducer.ratio.a"):
        with pytest.raises(mv.ScenarioError, match=f"{key}: unknown key; .*allowed here are"):
            state_1[key]


def test_parts_ask_for_units_as_files_do(state_1):
    with pytest.raises(mv.ScenarioError, match=r"^rate: 0\.05 needs a unit, such as '0\.05 deg/s'"):
        Tracking(rate=0.05)
    given = Tracking(rate="0.05 deg/s")
    assert given == Tracking(rate=Si(np.radians(0.05)))
    assert state_1.with_(tracking=given) == state_1.with_si(tracking={"rate": np.radians(0.05)})


def test_a_table_shows_what_is_notable(table):
    rows = repr(table).splitlines()
    assert rows[0] == f"{len(table)} lines of T_d of {STATE_1}, 16 s at 4096 Hz"
    assert [row.split()[0] for row in rows[2:-1]] == [line.name for line in table.notable()]
    assert rows[-1] == f"and {len(table) - len(table.notable())} small ones (print shows them)"
    assert len(str(table).splitlines()) == len(table) + 1
    shown = ElementTree.fromstring(f"<div>{table._repr_html_()}</div>")
    cells = [[cell.text for cell in row] for row in shown.iter("tr")]
    assert [row[0] for row in cells] == ["line", *(line.name for line in table.notable())]
    assert float(dict(zip(cells[0], cells[1], strict=True))["N m"]) == pytest.approx(
        table.notable()[0].amplitude, 1e-3
    )


def test_a_table_becomes_a_frame_and_a_dataset(table):
    frame, data = table.to_dataframe(), table.to_xarray()
    assert list(frame.index) == [line.name for line in table] == list(data["line"].values)
    assert frame.loc["drive_1", "amplitude_n_m"] == table["drive_1"].amplitude
    assert data["amplitude_n_m"].attrs["units"] == "N*m"
    assert data["phase_uncertainty_rad"].attrs["units"] == "rad"
    assert data["decay_per_s"].attrs["units"] == "1/s"
    assert data["bin_frequency_hz"].attrs["units"] == "Hz"
    assert data.attrs["clock_ratio"] == table.clock_ratio


def test_amplitudes_of_another_channel_carry_its_unit(motion_1):
    data = mv.find_lines(motion_1, "omega_l").to_xarray()
    assert data["amplitude_n_m"].attrs["units"] == data["floor_n_m"].attrs["units"] == "rad/s"


def test_a_line_that_a_table_does_not_have(table):
    assert table._ipython_key_completions_() == [line.name for line in table]
    with pytest.raises(
        LineError,
        match=r"^no line 'drive1' in this table; did you mean drive_1\? there are array_mode_1, ",
    ):
        table["drive1"]
    with pytest.raises(KeyError):
        table["drive1"]


def test_every_public_name_is_there_and_has_a_docstring():
    for name in mv.__all__:
        assert getattr(mv, name).__doc__ or name == "__version__", name
    assert set(dir(mv)) == set(mv.__all__)


STATE_1 = "'SADA driving the solar array simulator, test state 1', 0.05964 deg/s, array of 8.18 kg m², 1 mode"
SHORT = {"record.settle": "1 s", "record.duration": "3 s"}


def test_lines_of_all_that_has_some(state_1, motion_1, table):
    assert mv.find_lines(state_1, start="steady")["drive_1"].amplitude == pytest.approx(
        mv.find_lines(mv.steady_state(state_1))["drive_1"].amplitude
    )
    motion, (torque,) = mv.simulate(state_1.with_(SHORT)), mv.simulate_many([state_1.with_(SHORT)])
    assert mv.find_lines(torque)["drive_1"].amplitude == pytest.approx(
        mv.find_lines(motion)["drive_1"].amplitude, rel=1e-3
    )
    recording = mv.Recording({"Mz": motion_1["T_d"]}, motion_1.sample_rate, {"Mz": "N*m"}, "mine")
    named, unnamed = mv.find_lines(recording, scenario=state_1), mv.find_lines(recording)
    assert named["drive_1"].amplitude == pytest.approx(table["drive_1"].amplitude, rel=1e-3)
    assert named.clock_ratio == pytest.approx(0.994, rel=1e-5)
    assert {line.kind for line in unnamed} == {"other"}


def test_lines_and_spectra_of_a_force(state_1):
    six = {"array.modes.0.interface_participation": (0.5, 3.0, 0.0, 0.0, 0.0, state_1.array.H[0])}
    motion = mv.simulate(state_1.with_({**SHORT, **six}))
    assert (
        mv.find_lines(motion, "Fy").unit
        == mv.spectrum(motion, "Fy").unit
        == mv.psd(motion, "Fy").unit
        == "N"
    )
    assert mv.find_lines(motion, "Fx")["drive_1"].amplitude > 0.0
    recording = mv.Recording({"Fy": motion["Fy"]}, motion.sample_rate, {"Fy": "N"}, "mine")
    assert mv.find_lines(recording, "Fy", scenario=motion.scenario).unit == "N"


def test_spectra_of_all_that_has_samples(motion_1):
    recording = mv.Recording({"Mz": motion_1["T_d"]}, motion_1.sample_rate, {"Mz": "N*m"}, "mine")
    for source in (motion_1, recording):
        assert mv.psd(source, resolution="1 Hz").resolution == pytest.approx(1.0)
        assert mv.waterfall(source, resolution="1 Hz").amplitude.shape[0] > 10
        np.testing.assert_array_equal(
            mv.spectrum(source).amplitude, mv.spectrum(motion_1).amplitude
        )
    assert repr(mv.psd(motion_1, resolution="1 Hz")).startswith(
        "power spectral density (Welch), one-sided; Hann window"
    )


def test_what_a_cell_ends_with_is_shown_in_a_line_or_as_its_lines(motion_1):
    scenario = motion_1.scenario
    state, (torque,) = mv.steady_state(scenario), simulate_torques([scenario.with_(SHORT)])
    assert repr(state).startswith(f"Steady state of {STATE_1}: repeats every ")
    assert str(scenario) == repr(scenario)
    assert repr(scenario).splitlines() == [
        f"Scenario '{scenario.title}'",
        "  drive: 2 phases, 50 rotor teeth, 16 microsteps a full step, gear 100:1",
        "  rate: 0.05964 deg/s, 53.01 microsteps/s",
        "  array: 8.18 kg m², 1 mode: 1.19 Hz",
        "  record: 16 s at 4096 Hz after 30 s, start: rest",
    ]
    named, sampled, kept = repr(motion_1).splitlines()
    assert named == f"Motion of {STATE_1}"
    assert sampled == "  65536 samples at 4096 Hz, 16 s, start: rest"
    assert kept.startswith(f"  {len(motion_1.channels)} channels: i_A, i_B, ")
    assert repr(torque) == f"Torque of {STATE_1}: 12288 samples at 4096 Hz"
    run = mv.run_scenario(scenario.with_(SHORT), lines_only=True)
    assert repr(run) == f"Run of {STATE_1}\n{run.table!r}"
    plan = mv.plan_rates(scenario, ["0.06 deg/s"], linear=True)
    best, amplitude = plan.best()
    assert repr(plan).splitlines() == [
        f"Rate plan of {STATE_1}",
        "  1 case from 0.06 to 0.06 deg/s with 16 microsteps, linearised",
        "  0 resonances, 0 forbidden bands of rates",
        f"  best rate 0.06 deg/s with 16 microsteps: largest line {1e3 * amplitude:.4g} mN m",
    ]


def test_a_recording_a_limit_and_a_verdict_show_what_they_are(motion_1, table):
    recording = mv.Recording(
        {"Mz": motion_1["T_d"], "lid": motion_1["T_d"]}, 4096.0, {"Mz": "N*m"}, "run 7"
    )
    assert repr(recording).splitlines() == [
        "Recording 'run 7'",
        "  65536 samples at 4096 Hz, 16 s",
        "  2 channels: Mz [N*m], lid [no unit]",
    ]
    assert mv.find_lines(recording).source == "Mz of recording 'run 7'"
    assert repr(mv.Limit("10 mN*m", "0.5 Hz", "150 Hz")) == "Limit of 10 mN m from 0.5 to 150 Hz"
    assert repr(mv.Limit("1 mN*m", "5 Hz")) == "Limit of 1 mN m from 5 Hz"
    assert repr(mv.Limit("1 mN*m")) == "Limit of 1 mN m at all frequencies"
    verdict, counted = repr(mv.judge(table, mv.Limit("60 mN*m", "0.5 Hz", "150 Hz"))).splitlines()
    assert verdict.startswith("Limit 60 mN m from 0.5 to 150 Hz: pass; smallest margin +")
    assert counted == "  22 lines judged, 0 without an amplitude"


def test_a_comparison_and_a_budget_show_their_verdicts(motion_1):
    found = mv.compare(motion_1, motion_1, names=("one", "other"))
    first, verdicts = repr(found).splitlines()
    assert first == f"Comparison of one with other: {len(found.rows)} lines"
    assert "agrees: " in verdicts
    here = Path(__file__).parents[1] / "examples"
    budget = mv.pointing_budget(here / "spacecraft.yaml", here / "requirement.yaml", steady=True)
    title, sources, angle, *requirements = repr(budget).splitlines()
    assert title.startswith(
        "Pointing budget of 'Small craft, array at 30 degrees', 0.06 deg/s, arr"
    )
    assert title.endswith(f": {budget.verdict}")
    assert (sources, angle) == ("  sources: spacecraft", "  at an array angle of 30 deg only")
    for row, one in zip(requirements, budget.judged, strict=True):
        assert row.startswith(f"  requirement '{one.requirement.name}': {one.verdict}, ")


def recorded(x, rate=4096.0, unit="N*m", **channels):
    return mv.Recording({"Mz": x, **channels}, rate, {"Mz": unit}, "mine")


@pytest.mark.parametrize(
    "form", [list, pd.Series, np.float32, lambda x: pd.Series(x, np.arange(x.size) / 4096.0 + 5.0)]
)
def test_samples_of_ones_own_come_in_many_forms(motion_1, form):
    x, expected = motion_1["T_d"], mv.find_lines(motion_1)["drive_1"].amplitude
    for one in (recorded(form(x)), recorded(form(1e3 * x), rate="4.096 kHz", unit="mN*m")):
        table = mv.find_lines(one, scenario=motion_1.scenario)
        assert table.unit == "N*m"
        assert table["drive_1"].amplitude == pytest.approx(expected, rel=1e-4)


def test_numbers_of_numpy_are_numbers(state_1):
    assert state_1.with_(
        {"driver.microsteps": np.int64(8), "tracking.clock_ratio": np.array(0.99)}
    ) == state_1.with_({"driver.microsteps": 8, "tracking.clock_ratio": 0.99})
    assert state_1.with_(pd.Series({"driver.microsteps": 8}))["driver.microsteps"] == 8
    assert mv.plan_rates(state_1, ["0.06 deg/s"], np.array([8, 16]), linear=True).counts == (8, 16)


WRONG = {
    "a number for a scenario, in a list": (lambda m: mv.simulate_many([3]), "3 is of type int; expected a scenario (mv.load_sc"),
    "a motion for a scenario": (lambda m: mv.plan_rates(m, ["1 deg/s"]), "is of type Motion; expected a scenario (mv.load_scenario), or"),
    "a name that is none": (lambda m: mv.find_lines("state-9"), "state-9: there is no such file and no catalog scenario of this"),
    "a start of a motion": (lambda m: mv.find_lines(m, start="steady"), "start: applies to a scenario; this source is already"),
    "a start that is none": (lambda m: mv.simulate("state-1", start="stead"), "record.start: 'stead' is not allowed; "),
    "a name for a motion's spectrum": (lambda m: mv.psd("out/"), "'out/' is a name; expected a motion (mv.simulate) or a rec"),
    "a motion for a table": (lambda m: mv.judge(m, mv.Limit("10 mN*m")), "is of type Motion; expected a table of lines"),
    "a name, simulated": (lambda m: mv.simulate("state-9"), "state-9: there is no such file and no catalog scenario of th"),
    "a name, compared": (lambda m: mv.compare(m, "papers"), "papers: is not known; expected a scenario (of the catalog, or"),
    "a name, as evidence": (lambda m: mv.identify(m.scenario, ["a.uff"], ["reducer.damping"]), "'a.uff' is a name; expected a"),
    "a key that is not fitted": (lambda m: mv.identify(m.scenario, [], ["reducer.dampin"]), "is not a key of the scenario; did you mean reducer.damping? allowed are"),
    "a motion, written": (lambda m: mv.write_run(m, "out"), "of type Motion; expected what a run found (mv.run_scenario)"),
    "a table, plotted": (lambda m: mv.plot(mv.find_lines(m)), "is of type LineTable; expected a motion, spectrum, density, "),
    "channels as a number": (lambda m: mv.simulate(m.scenario, channels=3), "channels: 3 is not a list; one is expected, such as ["),
    "errors of another kind": (lambda m: mv.simulate_many([m.scenario], errors="skip"), "errors skip: is not allowed; write one"),
    "a component, kept": (lambda m: mv.simulate(m.scenario, channels=("Fx",)), "'Fx' is made of others; keep alpha_l, eta, "),
    "a channel that is not kept": (lambda m: mv.simulate(m.scenario, channels=("T_D",)), "'T_D' does not exist; did you mean T_d?"),
    "a number for a limit": (lambda m: mv.judge(mv.find_lines(m), 0.01), "expected a limit, such as mv.Limit('10 mN*m')"),
    "a channel that is not there": (lambda m: mv.find_lines(m, "T_x"), "channel 'T_x' is not in this motion; there are i_A, "),
    "a channel of a mode each": (lambda m: mv.psd(m, "eta"), "channel 'eta' has a column for each mode; there are i_A, "),
    "a scenario, loaded": (lambda m: mv.load_scenario(m.scenario), "is of type Scenario; expected a name of the catalog, or"),
    "a scenario, opened": (lambda m: mv.open_source(m.scenario), "is of type Scenario; expected the name of a scenario, a run"),
    "a list of changes": (lambda m: mv.load_scenario("state-1", ["tracking.rate=1 deg/s"]), "expected keys with their values"),
    "a number for a file": (lambda m: mv.read_recording(3), "3 is of type int; expected the name of a file"),
    "a table for its motion": (lambda m: mv.find_lines(mv.find_lines(m)), "is of type LineTable; expected a scenario, a steady state, a m"),
    "a bare time": (lambda m: mv.identify(m.scenario, [], ["reducer.damping"], settle_error=0.05), "needs a unit, such as '0.05 s'"),
    "a number of numpy": (lambda m: m.scenario.with_({"tracking.rate": np.float64(0.05)}), "tracking.rate: 0.05 needs a unit, "),
    "a speed, judged as a torque": (
        lambda m: mv.judge(mv.find_lines(m, "omega_l"), mv.Limit("10 mN*m")), "limit: is a torque, and these lines are in rad/s; ",
    ),
    "a parameter, set": (lambda m: setattr(m.scenario.motor, "current", 1.0), "current: cannot be set, scenarios are frozen; "),
    "a band from high to low": (lambda m: mv.Limit("1 mN*m", "150 Hz", "0.5 Hz"), "the first bound must be at least 0 and below"),
    "a limit below zero": (lambda m: mv.Limit("-1 mN*m"), "torque: '-1 mN*m' is not allowed; it must be greater than 0"),
    "samples in columns": (lambda m: recorded(np.ones((9, 2))), "channel Mz is float64 of shape (9, 2); real numbers one after"),
    "complex samples": (lambda m: recorded(np.ones(9) * 1j), "channel Mz is complex128 of shape (9,); real numbers one after"),
    "words for samples": (lambda m: recorded(["a"] * 9), "real numbers one after another, (n,), are expected"),
    "channels of two lengths": (lambda m: recorded([1.0, 2.0], Fx=[1.0]), "its channels differ in length: {'Mz': 2, 'Fx': 1}"),
    "no sample rate": (lambda m: recorded([1.0, 2.0], rate=0.0), "sample rate 0 Hz is not allowed; it must be greater than 0"),
    "masked samples": (
        lambda m: mv.find_lines(recorded(np.ma.masked_less(m["T_d"], -0.05))), "samples that are not numbers, the first at ",
    ),
    "a component that is not there": (lambda m: mv.find_lines(m, "Fx"), "whose array has no participation in six components"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", WRONG)
def test_what_is_wrong_is_told_in_a_sentence(motion_1, mistake):
    wrong, sentence = WRONG[mistake]
    with pytest.raises(mv.MicrovibError) as error:
        wrong(motion_1)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.release
def test_a_shell_completes_keys_lines_channels_and_names(state_1, motion_1, table):
    from IPython.core.completer import provisionalcompleter
    from IPython.core.interactiveshell import InteractiveShell

    shell = InteractiveShell()
    shell.user_ns.update(mv=mv, scenario=state_1, table=table, motion=motion_1)
    for typed, expected in {
        "scenario.reducer.sti": "stiffness",
        'scenario["array.modes.0.fr': "array.modes.0.frequency",
        'table["drive_1_mi': "drive_1_minus_1",
        "table.to_": "to_dataframe",
        'motion["omega_': "omega_m",
        "mv.read_rec": "read_recording",
        "mv.plan_rates(scenario, keep": "keep_away=",
    }.items():
        with provisionalcompleter():
            found = [each.text for each in shell.Completer.completions(typed, len(typed))]
        assert any(expected in each for each in found), (typed, found)


OUTSIDE = """
import microvib as mv

scenario: mv.Scenario = mv.load_scenario("state-1").with_({"tracking.rate": "0.05 deg/s"})
table: mv.LineTable = mv.find_lines(scenario, start="steady")
largest: float = max(line.amplitude for line in table)
verdict: str = mv.judge(table, mv.Limit("10 mN*m", "0.5 Hz", mv.Si(150.0)), scenario).verdict
plan = mv.plan_rates(scenario, mv.rate_grid("0.01 deg/s", "0.1 deg/s"), limit="10 mN*m", band="0.5:5 Hz")
mv.plot(plan).savefig("plan.png")
rows: list[str] = [row.verdict for row in mv.compare(mv.simulate(scenario), mv.read_recording("a.uff")).rows]
mv.rate_grid(0.01, 0.1)
"""


@pytest.mark.release
def test_types_are_seen_from_outside_and_tell_bare_numbers(tmp_path):
    (tmp_path / "outside.py").write_text(OUTSIDE)
    (tmp_path / "mypy.ini").write_text("[mypy]\nstrict = true\n")
    home = Path(mv.__file__).parents[1]
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", f"--cache-dir={os.devnull}", "outside.py"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(home)},
        text=True, stdout=subprocess.PIPE, check=False,
    )  # fmt: skip
    errors = [line for line in checked.stdout.splitlines() if ": error:" in line]
    assert len(errors) == 2
    assert all("rate_grid" in line and 'expected "str | Si"' in line for line in errors)


@pytest.mark.parametrize("estimate", [mv.spectrum, mv.psd, mv.waterfall])
@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (
            lambda x: np.where(np.arange(x.size) == 700, np.nan, x),
            "has 1 samples that are not numbers",
        ),
        (lambda x: np.clip(x, -0.03, 0.03), "is clipped"),
        (
            lambda x: np.where((np.arange(x.size) > 700) & (np.arange(x.size) < 900), 0.0, x),
            "repeats one value",
        ),
        (lambda x: x[:0], "is empty"),
    ],
    ids=["nan", "clipped", "dropped", "empty"],
)
def test_spectra_of_a_recording_look_at_its_samples(motion_1, estimate, spoil, complaint):
    whole = motion_1["T_d"] + np.random.default_rng(1).normal(0.0, 1e-5, motion_1["T_d"].size)
    for channel, unit in (("Mz", "N*m"), ("acceleration", "m/s^2"), ("Mz", "")):
        assert estimate(mv.Recording({channel: whole}, 4096.0, {channel: unit}), channel)
        with pytest.raises(mv.MicrovibError, match=f"^channel {channel} .*{complaint}"):
            estimate(mv.Recording({channel: spoil(whole)}, 4096.0, {channel: unit}), channel)
