"""A file to start from: gears of the catalog, and what a data sheet says."""

import csv
import math
import re
from importlib import resources
from itertools import pairwise
from pathlib import Path

import pytest
from support.commands import microvib

import microvib as mv
from microvib.io.gears import catalog_gears
from microvib.io.new_scenario import new_text
from microvib.io.scenario_file import catalog_text
from microvib.units import convert

SIZES = (14, 17, 20, 25, 32)


def test_the_page_of_the_motor_has_the_catalog_of_gears():
    with (resources.files("microvib.catalog") / "harmonic_gears.csv").open() as stream:
        rows = [[float(x) for x in row.values()] for row in csv.DictReader(stream)]
    page = (Path(__file__).parents[1] / "docs/howto/motor.md").read_text()
    told = [re.sub(r"(?<=\d) (?=\d)", "", line.strip("| ")) for line in page.splitlines()]
    printed = [[float(x) for x in line.split("|")] for line in told if line[:2].isdigit() and line.count("|") == 7]
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
    assert (error.order, error.amplitude) == (2, pytest.approx(convert(f"{gear.accuracy} arcmin", "rad") / 2))
    critical = 2.0 * math.sqrt(reducer.stiffness * scenario.output_inertia)
    assert reducer.damping == pytest.approx(0.02 * critical, rel=6e-3)  # written with three digits


def test_of_the_gear_the_file_says_what_is_of_the_data_sheet_and_what_is_assumed():
    scenario = mv.new_scenario(gear="Size 20, ratio 100")
    assert scenario.source_of("reducer.stiffness").startswith("data sheet: K1 of size 20")
    assert "T1 = 7 N m" in scenario.source_of("reducer.stiffness")
    for key in (
        "damping",
        "transmission_error.0.order",
        "transmission_error.0.phase",
        "transmission_error.0.amplitude",
    ):
        assert scenario.source_of(f"reducer.{key}").startswith("assumed: ")
    others = [key for key, *_ in scenario.entries() if not key.startswith("reducer.")]
    plain = mv.new_scenario()
    assert all(scenario[key] == plain[key] and scenario.source_of(key) == plain.source_of(key) for key in others)


def test_the_commented_file_stays_as_it_is_but_for_the_gear():
    assert new_text() == catalog_text("new")
    plain, geared = (set(text.splitlines()) for text in (new_text(), new_text("size 14 ratio 100")))
    assert {line.split(":")[0].strip(" #") for line in plain - geared} == {
        "reducer.stiffness", "reducer.damping", "stiffness", "damping", "transmission_error", "- {order",
    }  # fmt: skip


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
