"""The example for Basilisk, where that is installed (``pip install bsk``)."""

import importlib.util
from pathlib import Path

import pytest

pytest.importorskip("Basilisk")


def test_the_hub_in_basilisk_has_the_lines_of_the_free_craft():
    """Steps of 1 ms: lines at 53, 107 and 160 Hz within 0.5 %, RMS within 5 %."""
    path = Path(__file__).parents[2] / "examples" / "basilisk_array.py"
    found = importlib.util.spec_from_file_location("basilisk_array", path)
    example = importlib.util.module_from_spec(found)
    found.loader.exec_module(example)
    jitter, lines = example.compare(settle=8.0, duration=8.0)
    assert abs(jitter) < 0.05
    assert len(lines) == 3
    assert max(abs(lines)) < 0.005
