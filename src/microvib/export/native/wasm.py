"""A drive as a WebAssembly module, for browsers and Node, with a loader in JavaScript."""

from __future__ import annotations

import os
from pathlib import Path

from microvib.export.native.drive import drive_image, exportable
from microvib.export.native.library import shared_library
from microvib.export.native.linking import SOURCES
from microvib.io.scenario_file import dump_scenario
from microvib.io.writing import check_folder, write_folder
from microvib.model.scenario import GivenScenario


def export_wasm(
    scenario: GivenScenario, path: str | os.PathLike[str], *, overwrite: bool = False
) -> Path:
    """Write a folder with the drive of a scenario as a WebAssembly module of 32-bit addresses.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is exported: it begins at rest, whatever its ``record`` says.
    path : str or path
        The folder.
    overwrite : bool
        Replace a folder that was written so before.

    Returns
    -------
    pathlib.Path
        The folder, with ``drive.wasm``, which imports nothing, ``drive.mjs``, which loads it, and
        the scenario.

    Raises
    ------
    MicrovibError
        For a scenario that cannot be exported, without Zig's compiler, and where the folder cannot
        be written.
    """
    folder = Path(path)
    check_folder(folder, overwrite)
    given = exportable(scenario)
    files: dict[str, str | bytes] = {
        "drive.wasm": shared_library("wasm32", drive_image(given)),
        "drive.mjs": (SOURCES / "drive.mjs").read_text(encoding="utf-8"),
        "scenario.yaml": dump_scenario(given),
    }
    write_folder(folder, files, overwrite)
    return folder
