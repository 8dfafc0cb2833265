"""Tables as spreadsheets save them where a comma is the decimal mark: columns parted by semicolons or tabs."""

import csv

import pytest
from support.commands import microvib

from microvib.errors import MicrovibError
from microvib.io.current_table import read_current_table
from microvib.io.hub_sources import read_hub_table
from microvib.io.modal_table import read_modes
from microvib.io.row_table import read_row_table
from microvib.io.tables import plain_lines, read_lines
from microvib.studies.sizing import read_states

LOOP = [(0.0, 0.0), (1e-3, 0.02), (2e-3, 0.03), (0.0, -0.02), (-2e-3, -0.03), (0.0, 0.02), (2e-3, 0.03)]


def saved(rows, separator, decimal, head=""):
    lines = [separator.join(f"{x!r}".replace(".", decimal) for x in row) for row in rows]
    return "\n".join([*([head.replace(",", separator)] if head else []), *lines]) + "\n"


@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), ("\t", ","), (";", "."), ("\t", "."), (",", ".")])
@pytest.mark.parametrize("head", ["", "angle,torque"])
def test_a_loop_is_the_same_however_it_was_saved(tmp_path, separator, decimal, head):
    (tmp_path / "loop.csv").write_text("\ufeff" + saved(LOOP, separator, decimal, head), encoding="utf-8")
    found = read_row_table(tmp_path / "loop.csv", ("angle", "rad"), ("torque", "N*m"))
    assert [tuple(row) for row in found] == LOOP


def test_currents_and_modes_are_the_same_however_they_were_saved(tmp_path):
    (tmp_path / "currents.csv").write_text("i_a;i_b\n1,0;0,0\n0,0;1,0\n-1,0;0,0\n0,0;-1,0\n")
    table = read_current_table(tmp_path / "currents.csv")
    assert table == {"currents": [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]}
    (tmp_path / "modes.csv").write_text("frequency_hz;effective_inertia_kg_m2;inertia_kg_m2\n1,19;8,05;8,18\n")
    assert read_modes(tmp_path / "modes.csv").frequency.tolist() == [1.19]


def test_a_comma_that_may_part_thousands_is_no_decimal_mark():
    assert list(csv.reader(plain_lines("f;a\n1,234;0.5\n"))) == [["f", "a"], ["1,234", "0.5"]]
    assert plain_lines("a,b; c\n1,2\n") == ["a,b; c", "1,2"]
    assert plain_lines("") == []


def test_a_loop_that_mixes_both_is_a_sentence(tmp_path):
    (tmp_path / "loop.csv").write_text("angle;torque\n1,234;0.5\n")
    done = microvib("show", "state-1", "--set", "friction.presliding={loop: loop.csv}", cwd=tmp_path)
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
