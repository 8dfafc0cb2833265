"""Files and folders appear whole or not at all, and what a killed process left is cleared away by the next."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from microvib.errors import OutputError
from microvib.io.writing import (
    LISTING,
    RUN_FILES,
    STUDY_FILES,
    check_folder,
    clear_stale_workspaces,
    workspace,
    write_file,
    write_files,
    write_folder,
)

posix = pytest.mark.skipif(sys.platform == "win32", reason="locks and signals of POSIX")
KILLED = """
import os, signal, sys
from pathlib import Path
from microvib.io import writing

def killed(*arguments):
    os.kill(os.getpid(), signal.SIGKILL)

where, when = Path(sys.argv[1]), sys.argv[2]
if when == "writing":
    writing.write_files(where, {"lines.csv": "half", "motion.nc": killed})
elif when == "file":
    writing.write_file(where / "one.csv", killed)
elif when == "replacing":
    rename = Path.rename
    Path.rename = lambda old, new: killed() if old.name == "new" else rename(old, new)
    writing.write_files(where, {"lines.csv": "new"})
"""


def killed(where: Path, when: str) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, str(where), when], check=False)
    assert done.returncode == -9


def names(where: Path) -> list[str]:
    return sorted(p.name for p in where.iterdir())


@posix
def test_what_a_killed_write_left_is_cleared_by_the_next(tmp_path):
    for _ in range(3):
        killed(tmp_path / "run", "writing")
        assert len(names(tmp_path)) == 1, "leftovers pile up"
    write_folder(tmp_path / "other", {"lines.csv": "a"})
    assert names(tmp_path) == ["other"]


@posix
def test_results_that_a_killed_process_had_set_aside_come_back(tmp_path):
    run = tmp_path / "run"
    write_files(run, {"lines.csv": "old"})
    killed(run, "replacing")
    assert not run.exists()
    with pytest.raises(OutputError, match="already holds results"):
        check_folder(run)
    assert (run / "lines.csv").read_text() == "old"
    assert names(tmp_path) == ["run"]


@posix
def test_an_empty_folder_that_was_being_filled_is_empty_again(tmp_path):
    mount = tmp_path / "mount"
    mount.mkdir()
    killed(mount, "writing")
    killed(mount, "file")
    check_folder(mount)
    assert names(mount) == []
    write_folder(mount, {"lines.csv": "a"})
    assert names(mount) == [LISTING, "lines.csv"]


@posix
def test_a_workspace_in_use_and_folders_of_others_are_left_alone(tmp_path):
    (tmp_path / ".mine.microvib").mkdir()
    (tmp_path / ".mine.microvib" / "thesis.txt").write_text("ten years of work")
    (tmp_path / ".link.microvib").symlink_to(tmp_path / ".mine.microvib")
    with workspace(tmp_path, "run") as space:
        (space / "half").write_text("half")
        clear_stale_workspaces(tmp_path)
        assert (space / "half").exists()
    clear_stale_workspaces(tmp_path)
    assert names(tmp_path) == [".link.microvib", ".mine.microvib"]
    assert (tmp_path / ".mine.microvib" / "thesis.txt").exists()


@pytest.mark.parametrize(
    "write",
    [lambda p: write_folder(p, {"lines.csv": "a"}), lambda p: write_file(p, "a"), check_folder],
)
def test_links_in_a_circle_are_a_sentence(tmp_path, write):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    for path in (tmp_path / "a", tmp_path / "a" / "run"):
        with pytest.raises(OutputError, match="symbolic links form a loop"):
            write(path)
    assert names(tmp_path) == ["a", "b"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_file(tmp_path / "link", "one")
    write_file(tmp_path / "link", "two", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "two"


@posix
def test_results_have_the_permissions_that_the_user_s_other_files_have(tmp_path):
    before = os.umask(0o077)
    try:
        write_folder(tmp_path / "run", {"lines.csv": "a"})
        write_file(tmp_path / "one.csv", "a")
    finally:
        os.umask(before)
    modes = [
        (tmp_path / name).stat().st_mode & 0o777 for name in ("run", "run/lines.csv", "one.csv")
    ]
    assert modes == [0o700, 0o600, 0o600]


def test_a_file_that_cannot_be_written_keeps_the_old_one(tmp_path):
    def disk_full(path: Path) -> None:
        path.write_text("half")
        raise OSError(28, "No space left on device")

    write_file(tmp_path / "one.csv", "old")
    with pytest.raises(
        OutputError, match="cannot be written: No space left on device; go on with x"
    ):
        write_file(tmp_path / "one.csv", disk_full, overwrite=True, after="; go on with x")
    with pytest.raises(OutputError, match="already exists; nothing was written"):
        write_file(tmp_path / "one.csv", "new")
    assert names(tmp_path) == ["one.csv"]
    assert (tmp_path / "one.csv").read_text() == "old"


def test_a_folder_lists_its_files_and_others_are_not_replaced(tmp_path):
    out = tmp_path / "run"
    write_folder(out, {"new_study.csv": "a\n", "report.html": "first"})
    (out / "report.pdf").write_bytes(b"made later")
    write_folder(out, {"new_study.csv": "b\n"}, overwrite=True)
    assert names(out) == [LISTING, "new_study.csv"]
    (out / "spectrum.png").write_bytes(b"mine, though studies have files of this name")
    with pytest.raises(OutputError, match=r"holds other content \(spectrum.png\)"):
        write_folder(out, {"new_study.csv": "c\n"}, overwrite=True)
    assert (out / "new_study.csv").read_text() == "b\n"


def test_a_folder_of_before_there_were_listings_is_replaced(tmp_path):
    out = tmp_path / "run"
    out.mkdir()
    for name in (*RUN_FILES, *STUDY_FILES):
        (out / name).write_text("old")
    write_folder(out, {"lines.csv": "new"}, overwrite=True)
    assert names(out) == [LISTING, "lines.csv"]
    (out / LISTING).unlink()
    (out / "mine.csv").write_text("mine")
    with pytest.raises(OutputError, match=r"holds other content \(mine.csv\)"):
        write_folder(out, {"lines.csv": "newer"}, overwrite=True)
