"""Verdicts of a comparison: which lines agree within their uncertainties, which do not, which cannot be judged."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest

import microvib as mv
from microvib.errors import MicrovibError
from microvib.io.recordings import Prepared
from microvib.io.runs import lines_csv
from microvib.io.sources import open_source
from microvib.reports.comparison import (
    clock_sentence,
    comparison_outcome,
    verdict_sentence,
)
from microvib.reports.document import Table, Text
from microvib.reports.outcome import study_contents, terminal_text, text_files
from microvib.reports.rendering import html
from microvib.reports.typography import file_name
from microvib.studies.analyse import analyse
from microvib.studies.compare import (
    Row,
    Side,
    SideLine,
    _match_unlisted_names,
    compare,
    misread,
)
from microvib.studies.evidence import evidence_of, select_evidence
from microvib.testdata.recording import Recording


def row(line: str, a: tuple[float, ...], b: tuple[float, ...]) -> Row:
    """Amplitude and uncertainty of both sides [N m]; of one that says nothing, nothing."""
    return Row(line, *(SideLine(10.0, *side) if side else SideLine() for side in (a, b)))


SHORT = {"record.settle": "2 s", "record.duration": "4 s", "record.sample_rate": "1024 Hz"}
ROWS = [
    row("drive_1", (1.0, 0.03), (1.09, 0.04)),  # 1.8 standard uncertainties
    row("drive_2", (0.5, 0.003), (0.5105, 0.004)),  # 2.1
    row("drive_3", (0.2, math.nan), (0.2, 0.001)),
    row("drive_4", (0.1, 0.001), ()),
    row("drive_5", (), (0.1, 0.001)),
    row("drive_6", (0.3, 0.0), (0.3, 0.0)),
]


def test_two_standard_uncertainties_of_the_difference_decide():
    verdicts = {r.line: r.verdict for r in ROWS}
    assert verdicts == {
        "drive_1": "agrees",
        "drive_2": "differs",
        "drive_3": "not judged",
        "drive_4": "only A",
        "drive_5": "only B",
        "drive_6": "not judged",  # nothing is known of how well
    }


def test_a_line_that_does_not_stand_out_agrees_with_nothing():
    """Under a floor that is high enough any two would."""
    loud = Row("drive_1", SideLine(10.0, 0.5, 0.4, seen=False), SideLine(10.0, 0.1, 0.001))
    assert loud.verdict == "hidden"
    assert Row("drive_1", loud.b, loud.a).verdict == "hidden"
    assert (
        Row("drive_1", loud.a, replace(loud.b, amplitude=5.0)).verdict == "differs"
    )  # larger than the floor allows
    assert (
        Row("drive_1", replace(loud.a, amplitude=2.0), loud.b).verdict == "hidden"
    )  # what noise alone may make
    assert verdict_sentence([loud]).startswith("No line is judged")
    assert "1 line hidden by the floor of one side (drive_1)" in verdict_sentence([*ROWS, loud])


def test_noise_does_not_agree_with_a_drive(state_1):
    """A recording of ten newton metres of noise, of a drive that may have stood still."""
    loud = np.random.default_rng(1).normal(size=16_384)
    rows = compare(
        Recording({"Mz": 10.0 * loud}, 1024.0, {"Mz": "N*m"}, "noise"), state_1.with_(SHORT)
    ).rows
    assert sum(row.verdict == "hidden" for row in rows) > 30
    assert not [row.line for row in rows if row.verdict in ("agrees", "differs")]


def heard(*tones: tuple[float, float]) -> Recording:
    t = np.arange(8192) / 1024.0
    x = 1e-3 * np.random.default_rng(2).normal(size=t.size)
    return Recording(
        {"Mz": x + sum(a * np.cos(2.0 * np.pi * f * t) for f, a in tones)},
        1024.0,
        {"Mz": "N*m"},
        "heard",
    )


@pytest.mark.parametrize(
    ("nominal", "tones", "told"),
    [
        (50.4, [(50.0, 0.05), (100.0, 0.02), (150.0, 0.03)], ["the drive may not have been moving"]),
        (51.5, [(51.5, 0.05), (103.0, 0.02), (154.5, 0.03)], []),
        (53.0, [(106.0, 0.05), (212.0, 0.02)], ["drive_2, drive_4 are detected: the drive may have run at 2 times"]),
        (53.0, [(53.0, 0.05), (106.0, 0.02)], []),
        (60.1, [(60.1, 0.05), (120.2, 0.02), (15.025, 0.01)], ["possible mains pick-up (50 or 60 Hz): drive_1, drive_2"]),
        (53.0, [(71.0, 0.05)], ["no line of the step clock is detected within 2 % of the scenario's rate"]),
        (53.0, [], ["no line of the step clock"]),
    ],
)  # fmt: skip
def test_what_speaks_against_a_clock_is_told(state_1, nominal, tones, told):
    scenario = state_1.with_(
        {
            "tracking.clock_ratio": nominal
            / (state_1.driving_frequency / state_1.tracking.clock_ratio)
        }
    )
    notes = analyse(Prepared(heard(*tones)), scenario=scenario).recording.notes
    assert len(notes) == len(told)
    assert all(words in note for words, note in zip(told, notes, strict=True))


@pytest.mark.parametrize("ratio", [0.9375, 0.5, 2.0, 1.06])
def test_a_clock_far_off_is_found_by_its_whole_comb_and_told(ratio):
    """A side line of the drive's comb may stand where a driving line is expected."""
    scenario = mv.load_scenario("state-1").with_({"record.settle": "4 s", "record.duration": "8 s"})
    drive = scenario.with_si({"tracking.clock_ratio": ratio})
    torque = mv.simulate(drive, channels=("T_d",))["T_d"]
    noise = np.random.default_rng(1).normal(0.0, 5e-6, torque.size)
    recording = Recording({"Mz": torque + noise}, 4096.0, {"Mz": "N*m"}, "far off")
    found = analyse(Prepared(recording), scenario=scenario)
    assert found.clock_ratio == pytest.approx(ratio, rel=1e-5)
    assert found.table["drive_1"].frequency == pytest.approx(drive.driving_frequency, rel=1e-5)
    assert found.table["drive_1"].expected == pytest.approx(scenario.driving_frequency)
    side = "above" if ratio > scenario.tracking.clock_ratio else "below"
    warnings = evidence_of(recording, scenario).warnings
    assert warnings[0] in found.recording.notes
    assert f"% {side} the scenario's: set tracking.rate" in warnings[0]


def test_a_comb_of_half_the_driving_frequency_is_not_taken_for_a_faster_clock():
    """A motion that repeats after two driving periods has lines at all multiples of half its driving
    frequency, of which a clock four times as fast lists more.
    """
    scenario = mv.load_scenario("state-1").with_({"record.settle": "2 s", "record.duration": "8 s"})
    drive = scenario.with_si(
        {"tracking.clock_ratio": 0.9908, "reducer.stiffness": 4400.0, "motor.detent_torque": 0.0}
    )
    torque = mv.simulate(drive, channels=("T_d",))["T_d"]
    noise = np.random.default_rng(1).normal(0.0, 5e-4, torque.size)
    recording = Recording({"Mz": torque + noise}, 4096.0, {"Mz": "N*m"}, "half orders")
    found = analyse(Prepared(recording), scenario=scenario)
    assert found.table["full_step_8"].amplitude > 0.5 * found.table["drive_1"].amplitude
    assert found.table["drive_1"].frequency == pytest.approx(drive.driving_frequency, rel=1e-5)


def test_a_comb_of_another_machine_larger_than_the_drives_is_told_and_not_taken_for_it(state_1):
    own = [(53.0, 0.005), (106.0, 0.002), (3.3125, 0.001), (49.6875, 0.001), (56.3125, 0.001)]
    wheel = [(37.3 * k, 0.05 / k) for k in range(1, 5)]
    scenario = state_1.with_({"tracking.clock_ratio": 53.0 / (state_1.driving_frequency / 0.994)})
    found = analyse(Prepared(heard(*own, *wheel)), scenario=scenario)
    assert found.table["drive_1"].frequency == pytest.approx(53.0, rel=1e-4)
    (note,) = (note for note in found.recording.notes if "multiples" in note)
    assert "other_4, multiples of 37.3 Hz, are larger than all lines of the step clock" in note
    assert not any(
        "multiples" in n for n in analyse(Prepared(heard(*own)), scenario=scenario).recording.notes
    )


def ringing(duration: float, scale: float = 1.0) -> Recording:
    """A mode that rings down and a driving line, as a record of some length that begins at one time."""
    t = np.arange(int(1024 * duration)) / 1024.0
    x = 0.02 * np.exp(-0.1 * t) * np.cos(2.0 * np.pi * 1.19 * t) + 0.05 * np.cos(
        2.0 * np.pi * 53.0 * t
    )
    x += 1e-5 * np.random.default_rng(int(duration)).normal(size=t.size)
    return Recording({"Mz": scale * x}, 1024.0, {"Mz": "N*m"}, f"{duration:g} s")


def test_a_mode_that_rings_is_the_same_in_a_longer_record(state_1):
    found = compare(ringing(16.0), ringing(12.0), scenario=state_1)
    mode = {row.line: row for row in found.rows}["array_mode_1"]
    assert mode.verdict == "agrees"
    assert mode.a.amplitude == pytest.approx(mode.b.amplitude, rel=1e-3)
    assert "array_mode_1: mean over its first 12 s, as long as the other record" in found.a.notes
    louder = compare(ringing(16.0, 1.05), ringing(12.0), scenario=state_1)
    assert {row.line: row.verdict for row in louder.rows}["array_mode_1"] == "differs"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda x: 1e3 * x, "B divided by 1000 would be like A, as in mN*m taken for N*m"),
        (lambda x: -x, "B with its sign reversed would be like A:"),
        (
            lambda x: -1e-3 * x,
            "B with its sign reversed and multiplied by 1000 would be like A, as in N*m taken for mN*m",
        ),
        (lambda x: x[::-1], "B with its time reversed would be like A:"),
        (lambda x: 1.3 * x, ""),
    ],
)
def test_a_recording_of_another_unit_sign_or_order_is_told(change, told):
    scenario = mv.load_scenario("state-1").with_({"record.settle": "4 s", "record.duration": "8 s"})
    drive = scenario.with_({"motor.friction.viscous": "0.0155 N*m*s/rad", "record.settle": "6 s"})
    samples = change(mv.simulate(drive, channels=("T_d",))["T_d"])
    found = compare(scenario, Recording({"Mz": samples}, 4096.0, {"Mz": "N*m"}, "changed"))
    said = misread(*found)
    assert len(said) == bool(told)
    assert all(one.startswith(told) for one in said)
    assert all(one in terminal_text(comparison_outcome(*found)) for one in said)


def test_the_axis_that_shows_the_drive_is_told(state_1):
    table, quiet = (
        heard((53.0, 0.05), (106.0, 0.02), (3.3125, 0.004), (159.0, 0.003), (212.0, 0.004)),
        heard(),
    )
    channels = {"Mx": table["Mz"], "Mz": quiet["Mz"]}
    both = replace(table, channels=channels, units=dict.fromkeys(channels, "N*m"))
    scenario = state_1.with_(SHORT)
    (warning,) = (text for text in evidence_of(both, scenario).warnings if "Mx" in text)
    assert "channel Mx shows" in warning
    assert warning in compare(both, scenario).a.notes
    with pytest.raises(
        MicrovibError,
        match=r"no line of the scenario's drive is above the noise floor in channel Mz .*Mx",
    ):
        select_evidence([evidence_of(both, scenario)], scenario)


def test_bands_and_bins_without_a_reference(state_1):
    """The bin at 0 Hz holds the mean, which is taken off; of what a floor hides there is no relative difference either."""
    a, b = ringing(8.0), state_1.with_(SHORT)
    rows = compare(a, b, bands=["50:60 Hz"]).rows
    assert {"drive_1", "drive_1_plus_1"} <= {row.line for row in rows}
    assert all(50.0 <= row.b.place <= 60.0 for row in rows)
    with pytest.raises(
        MicrovibError, match=r"band: no line of either side lies in it; lines are from"
    ):
        compare(a, b, bands=["600:700 Hz"])
    mean = Row(
        "electrical_1",
        SideLine(bin_frequency=0.0, bin_amplitude=1e-19),
        SideLine(bin_frequency=0.0, bin_amplitude=1.0),
    )
    assert math.isnan(mean.bin_error)
    assert math.isnan(
        Row("drive_1", SideLine(10.0, 1e-9, 1e-9, seen=False), SideLine(10.0, 1.0, 1e-9)).error
    )
    assert math.isnan(Row("drive_1", SideLine(10.0, 0.0, 0.0), SideLine(10.0, 1.0, 1e-9)).error)


def test_a_limit_is_not_passed_by_a_drive_that_stood_still(state_1):
    scenario, limit = state_1.with_(SHORT), mv.Limit("20 mN*m", "10 Hz", "300 Hz")
    judged = mv.judge(mv.find_lines(heard(), scenario=scenario), limit, scenario)
    assert judged.verdict == "not judged"
    assert judged.gaps[0].startswith("no line of the step clock is detected within 2 %")
    moved = heard((53.0, 0.015), (106.0, 0.01), (159.0, 0.002))
    assert mv.judge(mv.find_lines(moved, scenario=scenario), limit, scenario).verdict == "pass"
    twice = mv.judge(
        mv.find_lines(heard((106.0, 0.01), (212.0, 0.005)), scenario=scenario), limit, scenario
    )
    assert (twice.verdict, len(twice.gaps)) == ("not judged", 1)


def test_lines_under_the_floor_of_a_table_are_no_evidence(state_1, tmp_path):
    """Their amplitudes are those of the noise."""
    found = analyse(Prepared(heard((53.0, 0.05), (106.0, 0.02))), scenario=state_1)
    (tmp_path / "lines.csv").write_text(lines_csv(found.table))
    told = {
        o.line for o in evidence_of(open_source(str(tmp_path / "lines.csv")), state_1).observations
    }
    assert {"drive_1", "drive_2"} <= told <= {x.name for x in found.table if x.seen}
    assert len(told) < 10 < len(found.table)


def test_another_component_than_the_drives_is_not_compared(state_1):
    table = heard((53.0, 0.05))
    six = replace(
        table,
        channels={"Mx": table["Mz"], "Mz": 0.01 * table["Mz"]},
        units={"Mx": "N*m", "Mz": "N*m"},
    )
    about_x = state_1.with_({"array.drive_axis": "x", **SHORT})
    for look in (lambda: compare(six, about_x), lambda: evidence_of(six, about_x)):
        with pytest.raises(
            MicrovibError,
            match="heard: the scenario's drive axis is x: its torque is channel Mx, not Mz",
        ):
            look()
    assert {row.line: row for row in compare(six, about_x, channel="Mx").rows}[
        "drive_1"
    ].a.amplitude > 0.049
    assert (
        "not the torque about the drive axis"
        in analyse(Prepared(six), scenario=about_x).recording.notes[-1]
    )


def test_unexpected_lines_are_the_same_within_their_uncertainty():
    a = Side("a", "table", {"other_1": SideLine(2.0, 1.0, frequency_uncertainty=1e-3)})
    b = Side("b", "table", {"other_1": SideLine(2.003, 1.0, frequency_uncertainty=1e-3)})
    assert list(_match_unlisted_names(a, b).lines) == ["other_1"]
    apart = replace(b, lines={"other_1": replace(b.lines["other_1"], frequency=2.01)})
    assert list(_match_unlisted_names(a, apart).lines) == ["other_1_of_b"]


def test_the_sentence_counts_and_names():
    assert verdict_sentence(ROWS) == (
        "1 of 2 lines agrees within 2 standard uncertainties of the difference (drive_1); 1 differs (drive_2)."
        " 1 line only A has (drive_4). 1 line only B has (drive_5). 2 lines without uncertainties (drive_6, drive_3)."
    )
    assert (
        verdict_sentence(ROWS[2:3])
        == "No line is judged: on one side the uncertainty is unknown or the lines are below the noise floor."
    )


def outcome_of(rows):
    return comparison_outcome(*(Side(name, "table", {}) for name in "ab"), rows)


def test_the_file_keeps_all_digits_and_the_verdict():
    rows = list(csv.DictReader(io.StringIO(text_files(outcome_of(ROWS))["compare.csv"])))
    assert [r["verdict"] for r in rows] == [r.verdict for r in ROWS]
    assert rows[1]["b_amplitude_n_m"] == "0.5105"
    assert rows[0]["a_uncertainty_n_m"] == "0.03"


def test_reference_lines_are_not_judged():
    a, b, rows = compare(open_source("state-1:measured"), open_source("state-1:model"))
    found = comparison_outcome(a, b, rows)
    assert found.facts[0].value == "not judged"
    assert "agree" not in terminal_text(found)


def test_the_first_page_says_which_lines_agree():
    a, b = (Side(name, "table", {}) for name in ("/home/me/secret/a.csv", "b.csv"))
    _, document = study_contents(comparison_outcome(a, b, ROWS))
    assert document.facts[0].value == "1 of 2"
    assert any(
        isinstance(x, Text) and x.text.startswith(verdict_sentence(ROWS))
        for x in document.first_page
    )
    noise = Row("drive_9", SideLine(10.0, 0.4, 0.3, seen=False), SideLine(10.0, 0.1, 0.001))
    assert (
        comparison_outcome(a, b, [*ROWS, noise, noise, noise]).facts == document.facts
    )  # no figure is made of noise
    main = next(
        x for x in document.first_page if isinstance(x, Table) and x.columns[0].title == "line"
    )
    verdicts = {r.cells[0]: (r.cells[-1], r.mark) for r in main.rows}
    assert verdicts["drive_1"] == ("agrees", "pass")
    assert verdicts["drive_2"] == ("differs", "off")
    assert verdicts["drive_3"] == ("not judged", "off")
    page = html(document)
    assert "a.csv" in page
    assert "secret" not in page


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (("recording", 0.99), ("simulation", 0.99), "B was simulated at the recording's clock"),
        (("simulation", 1.0), ("simulation", 0.999), "B is -1000.0 ppm off A"),
        (("recording", 0.99), ("table", None), "not known on the other side"),
        (("table", None), ("reference", None), "not known on either side"),
    ],
)
def test_the_clock_is_told(a, b, words):
    assert words in clock_sentence(*(Side("x", kind, {}, clock) for kind, clock in (a, b)))


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("a.uff", "a.uff"),
        ("/x/y/a.uff", "a.uff"),
        ("C:\\x\\a b.uff", "a b.uff"),
        ("runs/one/", "one"),
        ("state-1", "state-1"),
    ],
)
def test_titles_and_legends_name_files(source, name):
    assert file_name(source) == name
