"""Formats of the compiled drive, by the one door of all formats."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from support.tiers import sweep

import microvib as mv
from microvib.errors import MicrovibError
from microvib.export.targets import TARGETS

IN_THE_ARCHIVE = {
    "c": {"microvib.h", "example.c", "example.py", "drive.image", "scenario.yaml"},
    "wasm": {"drive.wasm", "drive.mjs", "scenario.yaml"},
}


def names_in(file: Path) -> set[str]:
    with zipfile.ZipFile(file) as archive:
        return {Path(name).name for name in archive.namelist()}


@pytest.mark.parametrize("target", ["fmu2", "fmu3"])
def test_an_fmu_is_valid_whatever_its_file_is_called(target: str, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    file = mv.export_as("state-1", target, tmp_path / "my drive.fmu", kind="tones", model="lines")
    assert validate_fmu(str(file)) == []
    assert fmpy.read_model_description(str(file)).coSimulation.modelIdentifier == "lines"


@pytest.mark.parametrize("target", sweep(["c", "wasm"], "c"))
def test_a_folder_is_written_as_an_archive(target: str, tmp_path: Path) -> None:
    if TARGETS[target].missing:
        pytest.skip(TARGETS[target].missing)
    file = mv.export_as("state-1", target, tmp_path / "drive.zip")
    assert names_in(file) >= IN_THE_ARCHIVE[target]


def test_what_has_no_compiled_form_is_told_before_anything_is_made(tmp_path: Path) -> None:
    shaped = mv.load_scenario("state-1").with_(
        {"driver.microstep_shape": [{"fraction": 0.5}, {"fraction": 0.5, "after": "5 ms"}]}
    )
    for target in ("c", "wasm", "fmu2"):
        with pytest.raises(MicrovibError, match=r"driver\.microstep_shape: microsteps in parts"):
            mv.export_as(shaped, target, tmp_path / f"a{TARGETS[target].endings[0]}")
    assert not list(tmp_path.iterdir())
    with pytest.raises(MicrovibError, match="platforms"):
        mv.export_as("state-1", "fmu2", tmp_path / "a.fmu", platforms=["amiga"])
