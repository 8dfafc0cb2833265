"""The folder of a campaign: its design, and one file per chunk of cases, written whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError, OutputError
from microvib.io.results import package_versions, to_json, write_folder
from microvib.io.scenario_file import dump_part, dump_scenario, load_scenario, read_text
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validated
from microvib.model.study import Study
from microvib.studies.campaign.cases import Chunk, Work
from microvib.studies.campaign.design import Design
from microvib.studies.campaign.variation import Levels, Uncertain

MANIFEST, STUDY, SCENARIO, SAMPLES, CHUNKS = "campaign.json", "study.yaml", "scenario.yaml", "samples.npy", "chunks"
SMALLEST_CHUNK, LARGEST_CHUNK = 8, 256
CHUNKS_WANTED = 64
HISTORY_BYTES = 64_000_000
"""Largest chunk, where histories are kept."""


@dataclass(frozen=True)
class Campaign:
    """An open campaign. All that is needed to compute any of its chunks is in its folder."""

    folder: Path
    design: Design
    chunk_size: int

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.design.cases // self.chunk_size)

    def cases_of(self, chunk: int) -> range:
        """Numbers of the cases of a chunk."""
        first = chunk * self.chunk_size
        return range(first, min(first + self.chunk_size, self.design.cases))

    def work(self, cases: Sequence[int], deadly: tuple[int, ...] = ()) -> Work:
        """Cases, ready to be sent to a worker."""
        study = self.design.study
        changes = tuple(self.design.changes(case) for case in cases)
        return Work(self.design.base, changes, study.solve, study.harmonics, study.keep, deadly)

    def file(self, chunk: int) -> Path:
        """File of a chunk, there or not."""
        return self.folder / CHUNKS / f"{chunk:06d}.npz"

    def done(self) -> list[int]:
        """Chunks that are there, in order."""
        names = {entry.name for entry in os.scandir(self.folder / CHUNKS)}
        return [k for k in range(self.chunks) if f"{k:06d}.npz" in names]

    def missing(self) -> list[int]:
        """Chunks that are not there, in order."""
        done = set(self.done())
        return [k for k in range(self.chunks) if k not in done]

    def write(self, chunk: int, data: bytes) -> None:
        """Put a chunk's file in place at once; OutputError where the disk does not take it, and nothing is left then."""
        target = self.file(chunk)
        temporary = None
        try:
            handle, temporary = tempfile.mkstemp(prefix=f".{chunk:06d}-", dir=target.parent)
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, target)
            temporary = None
        except OSError as error:
            raise OutputError(
                f"{target}: cannot be written: {error.strerror or error}; what was computed before is kept, go on with:"
                f" microvib campaign resume {self.folder}"
            ) from None
        finally:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)

    def read(self, chunk: int) -> Chunk:
        """Results of a chunk; MicrovibError where its file is damaged."""
        path = self.file(chunk)
        try:
            found = Chunk.from_bytes(path.read_bytes())
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise MicrovibError(
                f"{path}: is damaged ({error}); delete it, then: microvib campaign resume {self.folder}"
            ) from None
        if len(found.reasons) != len(self.cases_of(chunk)):
            raise MicrovibError(f"{path}: is of another campaign; delete it, then resume this one")
        return found

    def results(self) -> Iterator[tuple[range, Chunk]]:
        """All chunks that are there, in order, with the numbers of their cases."""
        for chunk in self.done():
            yield self.cases_of(chunk), self.read(chunk)

    @cached_property
    def identity(self) -> str:
        """SHA-256 of what is computed: the scenario, its cases, how they are solved."""
        return _identity(self.design)


def default_chunk(design: Design) -> int:
    """Cases of a chunk: some 64 chunks, none too small to fill the lanes of the kernel, none too large to be sent or lost."""
    size = min(max(-(-design.cases // CHUNKS_WANTED), SMALLEST_CHUNK), LARGEST_CHUNK)
    if design.study.keep:
        size = min(size, max(HISTORY_BYTES // (8 * design.base.record.samples), 1))
    return size


def create(design: Design, folder: Path, chunk_size: int | None = None) -> Campaign:
    """Write the folder of a new campaign; OutputError where something is in the way."""
    size = chunk_size or default_chunk(design)
    manifest = {
        "cases": design.cases,
        "chunk_size": size,
        "sha256": _identity(design),
        "versions": package_versions(),
        "combinations": design.combinations,
        "levels": [asdict(x) for x in design.levels],
        "uncertain": [asdict(x) for x in design.uncertain],
    }
    write_folder(folder, {
        STUDY: dump_part(design.study), SCENARIO: dump_scenario(design.base), MANIFEST: to_json(manifest),
        SAMPLES: lambda path: np.save(path, design.samples), CHUNKS: lambda path: path.mkdir(),
    })  # fmt: skip
    return open_campaign(folder)


def open_campaign(folder: Path) -> Campaign:
    """The campaign of a folder; MicrovibError where it is none, or not whole."""
    if not (folder / MANIFEST).is_file():
        raise MicrovibError(f"{folder}: is no campaign; make one with: microvib campaign create STUDY {folder}")
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        design = _design(folder, manifest)
        size = int(manifest["chunk_size"])
        (folder / CHUNKS).mkdir(exist_ok=True)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MicrovibError(f"{folder}: is no whole campaign: {error}") from None
    if manifest["sha256"] != _identity(design):
        raise MicrovibError(
            f"{folder}: study.yaml, scenario.yaml or samples.npy were changed after the campaign was made"
        )
    return Campaign(folder, design, size)


def _design(folder: Path, manifest: dict[str, Any]) -> Design:
    study = validated(Study, parse_yaml(read_text(folder / STUDY, "study", ()), STUDY), units_required=True)
    base = load_scenario(folder / SCENARIO)
    levels = [Levels(**x | {"values": tuple(x["values"]), "labels": tuple(x["labels"])}) for x in manifest["levels"]]
    # JSON knows no infinity: an open end is written as null.
    ends = [{"lower": _or(x["lower"], -np.inf), "upper": _or(x["upper"], np.inf)} for x in manifest["uncertain"]]
    uncertain = [
        Uncertain(**x | {"shape": tuple(x["shape"])} | end) for x, end in zip(manifest["uncertain"], ends, strict=True)
    ]
    samples = np.load(folder / SAMPLES, allow_pickle=False)
    return Design(study, base, tuple(manifest["combinations"]), tuple(levels), tuple(uncertain), samples)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def _identity(design: Design) -> str:
    digest = hashlib.sha256(dump_scenario(design.base).encode())
    settings: list[Any] = [design.study.solve, design.study.harmonics, design.study.keep, design.combinations]
    settings += [[x.key, x.values] for x in design.levels] + [x.key for x in design.uncertain]
    digest.update(json.dumps(settings, sort_keys=True).encode())
    digest.update(np.ascontiguousarray(design.samples, dtype="<f8").tobytes())
    return digest.hexdigest()
