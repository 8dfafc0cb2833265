"""What the tests stand on."""

import re
import sys
import time
from pathlib import Path

import pytest

TESTS = Path(__file__).parent


IMPORTS = re.compile(r"^\s*(?:from|import) (\w+)", re.M)


def test_no_test_imports_from_another_or_from_benchmarks():
    """What several need is in ``support``."""
    folders = (TESTS, TESTS.parent / "benchmarks", TESTS.parent / "examples")
    theirs = {
        path.stem
        for folder in folders
        for path in folder.rglob("*.py")
        if "support" not in path.parts
    }
    theirs |= {
        path.name for folder in folders for path in (folder, *folder.iterdir()) if path.is_dir()
    } - {"support"}
    files = list(TESTS.rglob("*.py"))
    assert len(files) > 50
    assert {
        path.name: both
        for path in files
        if (both := theirs & set(IMPORTS.findall(path.read_text("utf-8"))))
    } == {}


@pytest.mark.skipif(
    sys.platform == "win32", reason="a script of a POSIX shell stands for the server"
)
def test_a_test_that_fails_ends_its_server(tmp_path, monkeypatch):
    from support.page import served

    server = tmp_path / "server"
    server.write_text("#!/bin/sh\necho http://127.0.0.1:1/?token=x\nexec sleep 30\n")
    server.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(server))
    begun = time.monotonic()
    with pytest.raises(ZeroDivisionError), served():
        raise ZeroDivisionError
    assert time.monotonic() - begun < 20.0
