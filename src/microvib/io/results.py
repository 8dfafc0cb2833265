"""Result folders: written whole or not at all, and never over something else."""

from __future__ import annotations

import shutil
from pathlib import Path

from microvib.errors import OutputError
from microvib.io.writing import Writer, real_path, workspace, write_files

RUN_FILES = ("motion.nc", "lines.csv", "summary.json", "scenario.yaml", "report.html")
"""Files of a run's folder; only a folder that holds nothing else may be replaced."""

STUDY_FILES = (
    "compare.csv", "fit.json", "validation.csv", "spectrum.csv", "density.csv", "third_octaves.csv", "modes.csv", "modes.png",
    "rates.csv", "resonances.csv", "forbidden.csv", "campbell.png", "largest.png",
    "sas.csv", "sas.json", "simulator.yaml", "drawing.png", "report.pdf",
    "statistics.csv", "worst.csv", "failed.csv", "effects.csv", "envelopes.png", "exceedance.png", "histograms.png",
    "tornado.png", "sobol.png", "scatter.png", "levels.png",
)  # fmt: skip
"""Further files of the folders of studies."""


def check_folder(out: Path, overwrite: bool = False) -> None:
    """OutputError unless ``out`` is free: absent, empty, or with ``overwrite`` a folder that holds results and no more."""
    try:
        with workspace(_nearest_folder(real_path(out)), out.name):
            pass  # it can be written to
        exists = out.exists()
    except OSError as error:
        raise OutputError(f"{str(out)[:200]}: cannot be made or written to: {error.strerror or error}") from None
    if not exists:
        return
    if not out.is_dir():
        raise OutputError(f"{out}: is a file; a folder is expected")
    content = sorted(p.name for p in out.iterdir())
    if not content:
        return
    foreign = [name for name in content if name not in (*RUN_FILES, *STUDY_FILES) or not (out / name).is_file()]
    if foreign:
        raise OutputError(
            f"{out}: holds other content ({foreign[0]}); nothing was written; choose an empty or new folder"
        )
    if not overwrite:
        raise OutputError(
            f"{out}: already holds results; nothing was written; choose another folder, or allow them to be replaced",
            remedy="overwrite",
        )


def free_folder(stem: str) -> Path:
    """``stem``, or ``stem-2``, ``stem-3``, ... whichever does not exist yet in the current folder."""
    candidate, k = Path(stem), 1
    while candidate.exists():
        k += 1
        candidate = Path(f"{stem}-{k}")
    return candidate


def _nearest_folder(path: Path) -> Path:
    """The folder itself, or what there is of the way to it."""
    return path if path.is_dir() else next(parent for parent in path.absolute().parents if parent.exists())


def check_room(out: Path, size: float) -> None:
    """OutputError where the disk of ``out`` has no room for ``size`` bytes."""
    free = shutil.disk_usage(_nearest_folder(out)).free
    if size > free:
        raise OutputError(
            f"{out}: needs about {size / 1e6:.0f} MB, but the disk has {free / 1e6:.0f} MB free; shorten record.duration, lower"
            " record.sample_rate, or keep the lines only",
            remedy="lines_only",
        )


def write_folder(out: Path, files: dict[str, str | Writer], overwrite: bool = False) -> None:
    """Write a folder of results, whole or not at all, where ``check_folder`` allows it."""
    check_folder(out, overwrite)
    write_files(out, files)
