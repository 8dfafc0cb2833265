"""What a notebook sees: completion, tables that show themselves, sentences for what is typed wrong."""

from xml.etree import ElementTree

import numpy as np
import pytest

import microvib as mv
from microvib.errors import LineError
from microvib.model.tracking import Tracking
from microvib.units import Si


@pytest.fixture(scope="module")
def table(motion_1):
    return mv.lines(motion_1)


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
        ("reducer.stifness", "reducer.stifness: unknown key; did you mean reducer.stiffness? allowed here are ratio, "),
        ("traking.rate", "traking: unknown key; did you mean tracking? allowed here are title, "),
        ("stiffness", "stiffness: unknown key; did you mean reducer.stiffness? allowed here are title, "),
        ("array.modes.0.freqency", "did you mean array.modes.0.frequency? allowed here are frequency, damping"),
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
    assert [row.split()[0] for row in rows[1:-1]] == [line.line for line in table.notable()]
    assert rows[-1] == f"and {len(table) - len(table.notable())} small ones (print shows them)"
    assert len(str(table).splitlines()) == len(table) + 1
    shown = ElementTree.fromstring(f"<div>{table._repr_html_()}</div>")
    cells = [[cell.text for cell in row] for row in shown.iter("tr")]
    assert [row[0] for row in cells] == ["line", *(line.line for line in table.notable())]
    assert float(dict(zip(cells[0], cells[1], strict=True))["N m"]) == pytest.approx(
        table.notable()[0].amplitude_n_m, 1e-3
    )


def test_a_table_becomes_a_frame_and_a_dataset(table):
    frame, data = table.to_dataframe(), table.to_xarray()
    assert list(frame.index) == [line.line for line in table] == list(data["line"].values)
    assert frame.loc["drive_1", "amplitude_n_m"] == table["drive_1"].amplitude_n_m
    assert data["amplitude_n_m"].attrs["units"] == "N*m"
    assert data["phase_uncertainty_rad"].attrs["units"] == "rad"
    assert data["decay_per_s"].attrs["units"] == "1/s"
    assert data["bin_frequency_hz"].attrs["units"] == "Hz"
    assert data.attrs["clock_ratio"] == table.clock_ratio


def test_amplitudes_of_another_channel_carry_its_unit(motion_1):
    data = mv.lines(motion_1, "omega_l").to_xarray()
    assert data["amplitude_n_m"].attrs["units"] == data["floor_n_m"].attrs["units"] == "rad/s"


def test_a_line_that_a_table_does_not_have(table):
    assert table._ipython_key_completions_() == [line.line for line in table]
    with pytest.raises(
        LineError, match=r"^no line 'drive1' in this table; did you mean drive_1\? there are array_mode_1, "
    ):
        table["drive1"]
    with pytest.raises(KeyError):
        table["drive1"]
