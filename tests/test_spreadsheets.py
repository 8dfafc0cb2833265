"""Tables as spreadsheets save them where a comma is the decimal mark: columns parted by semicolons or tabs."""

import csv

import pytest
from support.commands import microvib

from microvib.errors import MicrovibError
from microvib.io.current_table import read_current_table
from microvib.io.hub_sources import COLUMNS as HUB_COLUMNS
from microvib.io.hub_sources import read_hub_table
from microvib.io.modal_table import read_modes
from microvib.io.recordings import load_preparation
from microvib.io.row_table import read_row_table
from microvib.io.tables import plain_lines, read_lines
from microvib.studies.sizing import read_states

LOOP = [
    (0.0, 0.0),
    (1e-3, 0.02),
    (2e-3, 0.03),
    (0.0, -0.02),
    (-2e-3, -0.03),
    (0.0, 0.02),
    (2e-3, 0.03),
]


def saved(rows, separator, decimal, head=""):
    lines = [separator.join(f"{x!r}".replace(".", decimal) for x in row) for row in rows]
    return "\n".join([*([head.replace(",", separator)] if head else []), *lines]) + "\n"


@pytest.mark.parametrize(
    ("separator", "decimal"), [(";", ","), ("\t", ","), (";", "."), ("\t", "."), (",", ".")]
)
@pytest.mark.parametrize("head", ["", "angle,torque"])
def test_a_loop_is_the_same_however_it_was_saved(tmp_path, separator, decimal, head):
    (tmp_path / "loop.csv").write_text(
        "\ufeff" + saved(LOOP, separator, decimal, head), encoding="utf-8"
    )
    found = read_row_table(tmp_path / "loop.csv", ("angle", "rad"), ("torque", "N*m"))
    assert [tuple(row) for row in found] == LOOP


def test_currents_and_modes_are_the_same_however_they_were_saved(tmp_path):
    (tmp_path / "currents.csv").write_text("i_a;i_b\n1,0;0,0\n0,0;1,0\n-1,0;0,0\n0,0;-1,0\n")
    table = read_current_table(tmp_path / "currents.csv")
    assert table == {"currents": [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]}
    (tmp_path / "modes.csv").write_text(
        "frequency_hz;effective_inertia_kg_m2;inertia_kg_m2\n1,19;8,05;8,18\n"
    )
    assert read_modes(tmp_path / "modes.csv").frequency.tolist() == [1.19]


def test_a_comma_that_may_part_thousands_is_no_decimal_mark():
    assert list(csv.reader(plain_lines("f;a\n1,234;0.5\n"))) == [["f", "a"], ["1,234", "0.5"]]
    assert plain_lines("a,b; c\n1,2\n") == ["a,b; c", "1,2"]
    assert plain_lines("") == []


def test_a_loop_that_mixes_both_is_a_sentence(tmp_path):
    (tmp_path / "loop.csv").write_text("angle;torque\n1,234;0.5\n")
    done = microvib(
        "show", "state-1", "--set", "friction.presliding={loop: loop.csv}", cwd=tmp_path
    )
    assert done.exit_code == 1
    assert "loop.csv, row 2: angle '1,234' is not a number" in done.stderr


@pytest.mark.parametrize(
    "read", [lambda path: read_row_table(path, ("angle", "rad")), read_current_table, read_modes, read_hub_table, read_lines, read_states]
)  # fmt: skip
def test_what_is_no_table_is_one_sentence(tmp_path, read):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "wide.csv").write_text('frequency_hz,"' + 200_000 * "x" + '"\n1,2\n')
    (tmp_path / "coded.csv").write_bytes("frequency_hz".encode("utf-16"))
    refused = {
        "none": "cannot be read: No such file", "folder": "is not a file", "wide": "is not a table as text",
        "coded": "is not a table as text",
    }  # fmt: skip
    for name, said in refused.items():
        with pytest.raises(MicrovibError, match=f"{name}.csv: .*{said}"):
            read(tmp_path / f"{name}.csv")


@pytest.mark.parametrize(
    ("read", "text", "says"),
    [
        (read_modes, "frequency_hz,effective_inertia_kg_m2,inertia_kg_m2,damping_percent\n1,2,3,0.5\n", "damping_percent"),
        (read_modes, "frequency_hz,effective_inertia_kg_m2,inertia_kg_m2,Damping\n1,2,3,0.05,9\n", "row 2: has 5 cells"),
        (read_lines, "line,frequency_hz,amplitude_nm\ndrive_1,1,2\n", "amplitude_nm' is not known; did you mean amplitude_n_m?"),
        (read_lines, "line,amplitude_n_m,amplitude_n_m\ndrive_1,1,2\n", "'amplitude_n_m' occurs twice"),
        (read_states, "mode_frequency_hz,inertia_kg_m2,states\n1,2,3\n", "did you mean state?"),
        (read_hub_table, f"{','.join(HUB_COLUMNS)},dampings\n{'1,' * 13}\n", "did you mean damping?"),
        (lambda path: load_preparation(path.with_suffix(".yaml")), "frequency_hz,magnitude,phase_rad\n1,2,3\n", "did you mean phase_deg?"),
    ],
)  # fmt: skip
def test_a_column_that_is_not_read_is_refused(tmp_path, read, text, says):
    """It would count as nothing, or as its default."""
    (tmp_path / "t.csv").write_text(text)
    (tmp_path / "t.yaml").write_text("response: [{kind: table, file: t.csv}]")
    with pytest.raises(MicrovibError) as caught:
        read(tmp_path / "t.csv")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_of_columns_may_have_capitals_and_blanks_and_spreadsheets_leave_empty_ones(tmp_path):
    (tmp_path / "t.csv").write_text(
        "Mode_Frequency_Hz , INERTIA_kg_m2,comment,,\n1.5,8,of the test,,\n"
    )
    (state,) = read_states(tmp_path / "t.csv")
    assert (state.frequency, state.inertia) == (1.5, 8.0)


def test_units_in_names_of_two_columns_count(tmp_path):
    path = tmp_path / "loop.csv"
    path.write_text("angle_mrad,torque_mnm\n1,20\n")
    assert read_row_table(path, ("angle", "rad"), ("torque", "N*m")) == [
        [pytest.approx(1e-3), pytest.approx(0.02)]
    ]
    path.write_text("torque_nm,angle_mrad\n20,1\n")
    with pytest.raises(MicrovibError, match="column 'torque_nm' has the wrong dimension"):
        read_row_table(path, ("angle", "rad"), ("torque", "N*m"))
