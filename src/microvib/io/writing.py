"""Files and folders of results that appear whole or not at all, and never over something else.

They are written beside their place in a hidden folder, then moved into it.

The hidden folder is locked while its process lives. Where a process was killed, the next one that
writes at the same place finds the folder without its lock and clears it away; results that had been
set aside in it come back.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from microvib.errors import MicrovibError, OutputError

fcntl: Any = None
with contextlib.suppress(ImportError):  # Windows
    import fcntl

Writer = Callable[[Path], None]

_ENDING, _LOCK, _NEW, _OLD = ".microvib", "lock", "new", "old"


def write_files(out: Path, files: Mapping[str, str | bytes | Writer]) -> None:
    """Fill or replace the folder ``out`` with ``files``, together or not at all; OutputError leaves
    what was there.
    """
    out = real_path(out)  # where a link leads, not the link
    with _write_error(out, "; nothing was left behind"):
        out.parent.mkdir(parents=True, exist_ok=True)
        # An empty folder that is there may be a mount: it is filled, not replaced.
        fill = out.is_dir() and not any(out.iterdir())
        with workspace(out if fill else out.parent, out.name) as space:
            new = space / _NEW
            new.mkdir()
            for name, content in files.items():
                _write(new / name, content)
            if fill:
                for name in files:
                    os.replace(new / name, out / name)
            else:
                put_in_place(new, out, space)


def write_file(
    path: Path, content: str | bytes | Writer, overwrite: bool = False, after: str = ""
) -> None:
    """Write one file, whole or not at all; OutputError where it cannot be, or is there already
    without ``overwrite``.

    ``after`` ends the sentence of a failure: what is kept, and how to go on.
    """
    path = real_path(path)
    if path.exists() and not (overwrite and path.is_file()):
        raise OutputError(f"{path}: already exists; nothing was written")
    with (
        _write_error(path, after or "; nothing was left behind"),
        workspace(path.absolute().parent, path.name) as space,
    ):
        new = space / path.name  # with its ending, which some writers look at
        _write(new, content)
        os.replace(new, path)


def real_path(path: Path) -> Path:
    """Where a path leads; OutputError where its links lead nowhere."""
    try:
        resolved = path.resolve()
        circle = resolved.is_symlink() or any(folder.is_symlink() for folder in resolved.parents)
    except (OSError, RuntimeError):  # Python before 3.13 says so itself
        circle = True
    if circle:
        raise OutputError(f"{path}: its symbolic links form a loop")
    return resolved


@contextmanager
def workspace(parent: Path, name: str) -> Iterator[Path]:
    """A hidden folder in ``parent`` for what becomes ``name``, gone at the end; those of killed
    processes are cleared first.
    """
    clear_stale_workspaces(parent)
    lock = None
    while lock is None:
        space = Path(tempfile.mkdtemp(prefix=f".{name[:40]}-", suffix=_ENDING, dir=parent))
        lock = _locked(space / _LOCK)
    try:
        yield space
    finally:
        os.close(lock)
        shutil.rmtree(space, ignore_errors=True)


def clear_stale_workspaces(parent: Path) -> None:
    """Clear away the workspaces of killed processes in ``parent``, and put back what they had set
    aside.

    Not on Windows, where a lock does not tell whether its process lives.
    """
    for space in list(parent.glob(f".*{_ENDING}")) if fcntl else ():
        with contextlib.suppress(
            OSError
        ):  # in use, of somebody else, or cleared by another at the same time
            if _is_ours(space):
                _clear(space)


def put_in_place(new: Path, out: Path, space: Path) -> None:
    """Put the folder ``new`` of a workspace in the place of ``out``, which may be there."""
    if not out.exists():
        new.rename(out)
        return
    # What was there is set aside until the new is in place, so that one of them is there whatever
    # happens.
    old = space / _OLD / out.name
    old.parent.mkdir()
    out.rename(old)
    try:
        new.rename(out)
    except BaseException:  # an interrupt, too, must not cost the old results
        old.rename(out)
        raise


def _clear(space: Path) -> None:
    """Clear one workspace away. OSError where its process lives."""
    try:
        lock = os.open(space / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except FileNotFoundError:
        space.rmdir()  # killed before it was locked; who is about to lock it makes another
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for old in (space / _OLD).glob("*"):
            if not os.path.lexists(space.parent / old.name):
                old.rename(space.parent / old.name)
        shutil.rmtree(space, ignore_errors=True)
    finally:
        os.close(lock)


def _is_ours(space: Path) -> bool:
    found = space.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()


def _write(path: Path, content: str | bytes | Writer) -> None:
    if callable(content):
        content(path)
        return
    with path.open("wb") as stream:
        stream.write(content.encode() if isinstance(content, str) else content)
        stream.flush()
        os.fsync(stream.fileno())


@contextmanager
def _write_error(path: Path, after: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}{after}") from None


def _locked(path: Path) -> int | None:
    """The lock of a new workspace, held while the process lives; None where another cleared it away
    before it was taken.
    """
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    except FileNotFoundError:
        return None
    with contextlib.suppress(
        OSError
    ):  # a file system without locks: nobody clears away what he cannot lock
        if fcntl:
            fcntl.flock(lock, fcntl.LOCK_EX)
    if path.exists():
        return lock
    os.close(lock)
    return None


LISTING = ".microvib-files"
"""A result folder's list of the files that were written with it: SHA-256 and name, a line each, as
``sha256sum --check`` reads it; names alone before there were digests."""
_LISTED = re.compile(r"(?:(?P<digest>[0-9a-f]{64})  )?(?P<name>.+)")

EDITED_COPY = "put it back; figures of your own go into a file of another folder"
"""Remedy for a changed file of a result."""

_REPORTS = ("report.html", "report.pdf")
"""Files that a later command may add to a result folder, or make again."""

RUN_FILES = (
    "motion.nc", "lines.csv", "loads.csv", "pointing.csv", "summary.json", "scenario.yaml", "report.html",
    "motion_wing_2.nc", "lines_wing_2.csv", "loads_wing_2.csv", "densities.csv",
)  # fmt: skip
"""Files of a run's folder."""

STUDY_FILES = (
    "compare.csv", "fit.json", "validation.csv", "spectrum.csv", "density.csv", "third_octaves.csv", "modes.csv", "modes.png",
    "rates.csv", "best.csv", "resonances.csv", "forbidden.csv", "campbell.png", "largest.png",
    "sas.csv", "sas.json", "tolerances.csv", "simulator.yaml", "drawing.png", "report.pdf",
    "statistics.csv", "worst.csv", "failed.csv", "effects.csv", "envelopes.png", "exceedance.png", "histograms.png",
    "budget.csv", "sources.csv", "budget.json", "budget.png", "angles.csv", "angles.json", "angles.png",
    "summary.csv", "orbit.csv", "orbit_lines.csv", "orbit_windows.csv", "orbit.json", "orbit.png", "seeds.csv",
    "parameters.csv", "selection.csv", "alternatives.csv", "dependences.csv", "correlation.csv", "sensitivities.csv",
    "amplitudes.png", *(f"left_{k}.png" for k in range(1, 7)),
    "spectra.png", "spectrum.png", "density.png", "waterfall.png",
    "ranking.csv", "not_ranked.csv", "tornado.png", "sobol.png", "scatter.png", "levels.png",
    "contributors.csv", "windows.csv", "source_list.csv", "blocked_loads.csv", "cumulative.png",
)  # fmt: skip
"""Further files of the folders of studies that were written before folders had a listing; closed."""


def check_folder(out: Path, overwrite: bool = False) -> None:
    """OutputError unless ``out`` is free: absent, empty, or with ``overwrite`` a folder that holds
    results and no more.
    """
    try:
        with workspace(_nearest_folder(real_path(out)), out.name):
            pass  # it can be written to
        exists = out.exists()
    except OSError as error:
        raise OutputError(
            f"{str(out)[:200]}: cannot be created or written to: {error.strerror or error}"
        ) from None
    if not exists:
        return
    if not out.is_dir():
        raise OutputError(f"{out}: is a file; a folder is expected")
    content = sorted(p.name for p in out.iterdir())
    if not content:
        return
    own = _own_files(out)
    foreign = [name for name in content if name not in own or not (out / name).is_file()]
    if foreign:
        raise OutputError(
            f"{out}: holds other content ({foreign[0]}); nothing was written; choose an empty or"
            " new folder"
        )
    if not overwrite:
        raise OutputError(
            f"{out}: already holds results; nothing was written; choose another folder, or allow"
            " them to be replaced",
            remedy="overwrite",
        )


def _own_files(out: Path) -> set[str]:
    """Names of the files in a result folder that may be replaced: those that it lists; where it has
    no listing, those that folders had before there was one.
    """
    listing = out / LISTING
    if not listing.is_file():
        return {*RUN_FILES, *STUDY_FILES}
    return {LISTING, *_REPORTS, *_listed(listing)}


def _listed(listing: Path) -> dict[str, str]:
    """Digests of a folder's files by their names; empty where the listing has none."""
    lines = listing.read_text(encoding="utf-8", errors="replace").splitlines()
    found = filter(None, map(_LISTED.fullmatch, lines))
    return {line["name"]: line["digest"] or "" for line in found}


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def require_unchanged(path: Path, remedy: str) -> bool:
    """Refuse a file of a result folder that was changed since it was written.

    Parameters
    ----------
    path : Path
        The file.
    remedy : str
        What to do, as the sentence ends.

    Returns
    -------
    bool
        Whether its folder knows what was written; where it does not, nothing is checked.

    Raises
    ------
    MicrovibError
        Where the file is not as it was written.
    """
    listing = path.parent / LISTING
    try:
        wanted = _listed(listing).get(path.name, "") if listing.is_file() else ""
        if not wanted:
            return False
        changed = digest_of(path) != wanted
    except OSError as error:
        raise MicrovibError(f"{path}: cannot be read ({error.strerror})") from None
    if changed:
        raise MicrovibError(f"{path}: was changed since it was written; {remedy}")
    return True


def free_folder(stem: str) -> Path:
    """``stem``, or ``stem-2``, ``stem-3``, ... whichever does not exist yet in the current folder."""
    candidate, k = Path(stem), 1
    while candidate.exists():
        k += 1
        candidate = Path(f"{stem}-{k}")
    return candidate


def _nearest_folder(path: Path) -> Path:
    """The folder itself, or what there is of the way to it."""
    if path.is_dir():
        return path
    return next(parent for parent in path.absolute().parents if parent.exists())


def check_room(out: Path, size: float) -> None:
    """OutputError where the disk of ``out`` has no room for ``size`` bytes."""
    free = shutil.disk_usage(_nearest_folder(out)).free
    if size > free:
        raise OutputError(
            f"{out}: needs about {size / 1e6:.0f} MB, but the disk has {free / 1e6:.0f} MB free;"
            " shorten record.duration, lower"
            " record.sample_rate, or keep the lines only",
            remedy="lines_only",
        )


def write_folder(
    out: Path, files: Mapping[str, str | bytes | Writer], overwrite: bool = False
) -> None:
    """Write a folder of results with its listing, whole or not at all, where ``check_folder`` allows
    it.
    """
    check_folder(out, overwrite)
    write_files(out, {**files, LISTING: partial(_write_listing, sorted(files))})


def _write_listing(names: Sequence[str], listing: Path) -> None:
    """Write the listing of the files beside it; of folders among them the names alone."""
    found = ((name, listing.parent / name) for name in names)
    lines = (
        f"{digest_of(path)}  {name}\n" if path.is_file() else f"{name}\n" for name, path in found
    )
    listing.write_text("".join(lines), encoding="utf-8")
