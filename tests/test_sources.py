"""The door from a name to what it stands for."""

from __future__ import annotations

import numpy as np
import pytest

from microvib.cli.test_data import _parse_source
from microvib.errors import MicrovibError
from microvib.io.named import catalog_text
from microvib.io.recordings import Prepared, write_recording
from microvib.io.sources import ReferenceLines, RunFolder, open_source
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable
from microvib.testdata.preparation import Preparation
from microvib.testdata.recording import Recording

LINES = "line,frequency_hz,amplitude_n_m,phase_rad,status\ndrive_1,53.1,0.04,unread,ok\ndrive_2,,0.01,,below the floor\n"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "mine.YAML").write_text(catalog_text("state-1"))
    (tmp_path / "lines.csv").write_text(LINES)
    x = np.random.default_rng(1).normal(size=64)
    write_recording(Recording({"Mz": x}, 64.0, {"Mz": "N*m"}, "made"), tmp_path / "record.csv")
    for name, content in (
        ("run", {"lines.csv": LINES, "scenario.yaml": catalog_text("state-2")}),
        ("other", {}),
    ):
        (tmp_path / name).mkdir()
        for file, text in content.items():
            (tmp_path / name / file).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("mine.YAML", Scenario),
        ("lines.csv", LineTable),
        ("record.csv", Prepared),
        ("run", RunFolder),
    ],
)
def test_a_file_is_what_it_holds(files, name, kind):
    assert isinstance(open_source(str(files / name)), kind)


def test_names_of_the_catalog_and_of_its_reference_lines():
    assert "test state 3" in open_source("state-3").title
    test, model = (open_source(f"state-1:{column}") for column in ("measured", "model"))
    assert isinstance(test, ReferenceLines)
    assert (test.column, model.column) == ("measured", "model")
    assert test.table["drive_1"].bin_amplitude == 0.04344  # Table 6
    assert model.table["drive_1"].bin_amplitude == 0.03661


@pytest.mark.parametrize(
    ("former", "name"),
    [
        ("paper", "state-1:measured"),
        ("paper-test", "state-1:measured"),
        ("paper-simulation", "state-1:model"),
    ],
)
def test_names_of_the_release_before_are_read(former, name):
    assert open_source(former).table == open_source(name).table


def test_a_table_of_lines_says_what_it_says_and_no_more(files):
    table = open_source(str(files / "lines.csv"))
    assert (table["drive_1"].frequency, table["drive_1"].amplitude) == (53.1, 0.04)
    assert [line.status for line in table] == ["ok", "below the floor"]
    assert np.isnan(
        [
            table["drive_2"].frequency,
            table["drive_1"].phase,
            table["drive_1"].bin_amplitude,
        ]
    ).all()


def test_a_table_from_a_spreadsheet_is_the_same(files):
    (files / "saved.csv").write_text(LINES.replace(",", ";").replace(".", ","))
    assert open_source(str(files / "saved.csv"))["drive_1"].amplitude == 0.04


def test_a_folder_is_read_as_far_as_it_is_there(files):
    run = open_source(str(files / "run"))
    assert (len(run.lines), run.motion, run.scenario.array.modes[0].frequency > 0.0) == (
        2,
        None,
        True,
    )
    with pytest.raises(MicrovibError, match=r"neither lines\.csv nor motion\.nc"):
        open_source(str(files / "other"))


def test_an_at_in_the_name_of_a_file_belongs_to_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "me@work").mkdir()
    (tmp_path / "me@work" / "a.uff").touch()
    assert _parse_source("me@work/a.uff@state-2@record.settle=1 s") == (
        "me@work/a.uff",
        ["state-2", "record.settle=1 s"],
    )
    assert _parse_source("b.uff@state-2") == ("b.uff", ["state-2"])
    assert _parse_source("state-1:measured") == ("state-1:measured", [])


def test_recordings_are_prepared(files):
    prepared = open_source(str(files / "record.csv"), Preparation(detrend=0))
    assert abs(prepared.recording["Mz"].mean()) < 1e-12
    assert abs(open_source(str(files / "record.csv")).recording["Mz"].mean()) > 1e-3


@pytest.mark.parametrize("name", ["nothing", "thesis.docx", "state-9", ""])
def test_what_is_not_known_is_one_sentence(files, monkeypatch, name):
    monkeypatch.chdir(files / "other")
    with pytest.raises(MicrovibError) as failed:
        open_source(name)
    assert "\n" not in str(failed.value)


def test_a_negative_amplitude_in_a_table_of_lines_is_refused(files):
    (files / "lines.csv").write_text(LINES.replace("0.01,", "-0.01,"))
    told = "row 3: amplitude_n_m: -0.01 is negative; an amplitude is 0 or more"
    with pytest.raises(MicrovibError, match=told):
        open_source(str(files / "lines.csv"))
