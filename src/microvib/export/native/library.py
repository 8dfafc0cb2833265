"""A drive as a C library: header, shared libraries, image, and an example in C and in Python."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from microvib.errors import MicrovibError
from microvib.export.native.drive import drive_image, exportable
from microvib.export.native.linking import SOURCES, WRAPPER, host, link
from microvib.export.native.objects import code_objects, image_object, platform_of
from microvib.io.scenario_file import dump_scenario
from microvib.io.writing import check_folder, write_folder
from microvib.model.scenario import GivenScenario

NAME = "drive"
"""Name of the libraries, before their platform."""


def export_c_library(
    scenario: GivenScenario,
    path: str | os.PathLike[str],
    *,
    platforms: Sequence[str] = (),
    overwrite: bool = False,
) -> Path:
    """Write a folder with the drive of a scenario as a library that C calls, without Python.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is exported: it begins at rest at time 0, whatever its ``record`` says.
    path : str or path
        The folder.
    platforms : sequence of str, optional
        Platforms that libraries are made for, names of ``objects.PLATFORMS``; without any this
        machine's.
    overwrite : bool
        Replace a folder that was written so before.

    Returns
    -------
    pathlib.Path
        The folder, with ``microvib.h``, a library for each platform, the image, which
        ``microvib_open`` takes as well, the scenario, ``example.c`` and ``example.py``.

    Raises
    ------
    MicrovibError
        For a scenario that cannot be exported, where there is no compiler for a platform, and where
        the folder cannot be written.
    """
    folder = Path(path)
    check_folder(folder, overwrite)
    given = exportable(scenario)
    image = drive_image(given)
    files: dict[str, str | bytes] = {
        name: (SOURCES / name).read_text(encoding="utf-8")
        for name in ("microvib.h", "example.c", "example.py")
    }
    for name in platforms_or_host(platforms):
        files[f"{NAME}-{platform_of(name).library.format(name)}"] = shared_library(name, image)
    files |= {"drive.image": image, "scenario.yaml": dump_scenario(given)}
    write_folder(folder, files, overwrite)
    return folder


def shared_library(name: str, image: bytes) -> bytes:
    """The library of an image for the platform of a ``name``."""
    platform = platform_of(name)
    objects = code_objects(platform) | {"image": image_object(platform, image)}
    return link(platform, WRAPPER, objects, ("MICROVIB_BUILDS_LIBRARY", "MICROVIB_BUILT_IN"))


def platforms_or_host(platforms: Sequence[str]) -> list[str]:
    """The platforms, once each, or this machine's where there are none."""
    if platforms:
        return list(dict.fromkeys(platforms))
    if not host():
        raise MicrovibError(
            "platforms: code cannot be made for this machine's platform; name the platforms to build for"
        )
    return [host()]
