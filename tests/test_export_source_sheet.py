"""Source sheets: coupled again with a hub they give the lines of the coupled run; what is broken is refused."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import microvib as mv
from microvib.export.source_sheet import (
    SourceSheet,
    SourceSheetError,
    read_source_sheet,
    source_sheet,
    write_sheet,
)
from microvib.export.subject import subject_of
from microvib.reports.source_sheet import source_sheet_document

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
LOAD = "lines/load_re"


@pytest.fixture(scope="module")
def sheet() -> SourceSheet:
    return source_sheet(subject_of(CRAFT))


@pytest.fixture
def file(sheet: SourceSheet, tmp_path: Path) -> Path:
    write_sheet(sheet, tmp_path / "source.h5")
    return tmp_path / "source.h5"


def test_a_sheet_is_read_back_to_the_last_bit(sheet: SourceSheet, file: Path) -> None:
    found = mv.read_source_sheet(file)
    for name in ("frequency", "loads", "by_integration", "by_parameters", "powered", "locked"):
        assert np.array_equal(getattr(found, name), getattr(sheet, name), equal_nan=True)
    for name in ("mass", "G", "M", "C", "K"):
        assert np.array_equal(getattr(found.source, name), getattr(sheet.source, name))
    assert (found.names, found.scenario, found.clock) == (sheet.names, sheet.scenario, sheet.clock)


def test_coupled_again_it_gives_the_lines_of_the_coupled_run(file: Path) -> None:
    """Driving lines within 2e-4, the largest full-step line within 1e-3; what is left is the detent torque
    (below).
    """
    hub = mv.run_scenario(CRAFT).hub
    assert hub is not None
    names, found = read_source_sheet(file).on(CRAFT)
    for name, nearness in [
        *((f"drive_{k}", 2e-4) for k in range(1, 9)),
        ("full_step_1", 1e-3),
        ("full_step_6", 0.1),
    ]:
        k, j = names.index(name), hub.names.index(name)
        for part in (slice(0, 3), slice(3, 6)):
            difference = np.linalg.norm(found.loads[k, part] - hub.loads[j, part])
            assert difference < nearness * np.linalg.norm(hub.loads[j, part]), name
        assert found.los is not None
        assert hub.los is not None
        los = np.linalg.norm(found.los[k] - hub.los[j])
        assert los < nearness * np.linalg.norm(hub.los[j]), name


def _off(changes: dict[str, object], line: str) -> float:
    """Moments of a line by the sheet against those of the coupled run, over the latter."""
    scenario = mv.load_scenario(CRAFT).with_(changes)
    hub = mv.run_scenario(scenario).hub
    assert hub is not None
    names, found = source_sheet(subject_of(scenario)).on(scenario)
    by_run = hub.loads[hub.names.index(line), 3:]
    return float(
        np.linalg.norm(found.loads[names.index(line), 3:] - by_run) / np.linalg.norm(by_run)
    )


@pytest.mark.release
def test_what_is_left_is_the_detent_torque() -> None:
    """Which makes of a motion at one line a torque beside it: without it driving lines agree, and without
    dry friction small full-step lines are as far off as with it.
    """
    smooth = {"friction.coulomb": "0 N*m", "friction.breakaway": "0 N*m"}
    assert _off(smooth, "full_step_6") == pytest.approx(_off({}, "full_step_6"), rel=0.02)
    assert _off({}, "full_step_6") > 0.05
    assert _off({}, "drive_1") > 5e-5
    assert _off({"motor.detent_torque": "0 N*m"}, "drive_1") < 5e-6


def test_what_rings_is_not_coupled(sheet: SourceSheet) -> None:
    names, _ = sheet.on(CRAFT)
    assert "array_mode_2" in sheet.names
    assert not [name for name in names if name.startswith("array_mode")]


def _changed(name: str, change: object) -> object:
    def do(f: h5py.File) -> None:
        values = f[name][()]
        change(values)  # type: ignore[operator]
        f[name][...] = values

    return do


def _delete(name: str) -> object:
    return lambda f: f.__delitem__(name)


def _first_nan(values: np.ndarray) -> None:
    values.flat[0] = np.nan


def _skew(values: np.ndarray) -> None:
    values[0, 0, 1] += 1.0


def _scaled(values: np.ndarray) -> None:
    values *= 1.001


def _reversed(values: np.ndarray) -> None:
    values[:] = values[::-1].copy()


def _light(values: np.ndarray) -> None:
    values[0, 0] = 1e-3


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda f: f.attrs.__setitem__("format", "other"), "is no source sheet"),
        (lambda f: f.attrs.__setitem__("version", 2), "has version 2 of the format; 1 is read"),
        (lambda f: f.attrs.__delitem__("clock_hz"), "attribute clock_hz is missing; a number"),
        (_delete(LOAD), "lines/load_re is missing"),
        (_delete("matrices"), "matrices/coordinate is missing"),
        (lambda f: f[LOAD].attrs.__setitem__("units", "lbf"), "lines/load_re: its units are 'lbf'"),
        (_changed(LOAD, _first_nan), "lines/load: a number is missing"),
        (_changed("lines/frequency", _reversed), "lines/frequency: positive frequencies in ascending order"),
        (_changed("apparent_mass/powered_re", _skew), "apparent_mass/powered: is not symmetric"),
        (_changed("apparent_mass/powered_re", _scaled), "apparent_mass/powered: is not what the matrices give"),
        (_changed("matrices/mass", _light), "matrices: D_0: the residual mass"),
        (_changed("lines/uncertainty_integration", lambda v: v.__imul__(-1.0)), "uncertainty_integration: is negative"),
    ],
)  # fmt: skip
def test_a_sheet_that_contradicts_itself_is_refused(
    change: object, sentence: str, file: Path
) -> None:
    with h5py.File(file, "r+") as f:
        change(f)  # type: ignore[operator]
    with pytest.raises(SourceSheetError, match=sentence) as said:
        read_source_sheet(file)
    assert str(said.value).startswith(str(file))


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(b"nothing")
    with pytest.raises(SourceSheetError, match="not HDF5"):
        read_source_sheet(tmp_path / "a.h5")
    with pytest.raises(SourceSheetError, match="cannot be read"):
        read_source_sheet(tmp_path / "none.h5")


def test_it_is_printed_on_two_pages(sheet: SourceSheet, tmp_path: Path) -> None:
    pytest.importorskip("typst")
    pypdf = pytest.importorskip("pypdf")
    from microvib.reports.rendering import pdf

    many = replace(sheet, title="A long title " * 8)
    for each in (sheet, many):
        (tmp_path / "pages.pdf").write_bytes(pdf(source_sheet_document(each)))
        pages = pypdf.PdfReader(tmp_path / "pages.pdf").pages
        assert len(pages) == 2
        assert "drive_1" in pages[0].extract_text()
        assert "Blocked loads" in pages[1].extract_text()
