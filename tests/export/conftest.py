"""Libraries that the tests of this folder share: made once."""

import shutil

import pytest
from support.native_drive import load

from microvib.export.native.library import NAME, export_c_library
from microvib.export.native.linking import host


@pytest.fixture(scope="session")
def c_library(tmp_path_factory):
    """A function from a scenario to the folder of its C library."""
    made = {}

    def folder(scenario):
        key = scenario if isinstance(scenario, str) else id(scenario)
        if key not in made:
            path = tmp_path_factory.mktemp("library") / "drive"
            made[key] = (export_c_library(scenario, path), scenario)
        return made[key][0]

    return folder


@pytest.fixture(scope="session")
def native(c_library):
    """A function from a scenario to its loaded C library."""
    loaded = {}

    def library(scenario):
        folder = c_library(scenario)
        if folder not in loaded:
            (path,) = folder.glob(f"{NAME}-{host()}.*")
            loaded[folder] = load(path)
        return loaded[folder]

    return library


@pytest.fixture(scope="session")
def cc():
    """A C compiler of this machine."""
    found = shutil.which("gcc") or shutil.which("cc")
    if found is None:
        pytest.skip("there is no C compiler")
    return found
