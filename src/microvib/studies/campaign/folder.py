"""The folder of a campaign: its design, the identity that every chunk carries, and one file per
chunk of cases, written whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.io.named import read_text
from microvib.io.scenario_file import dump_part, dump_scenario, load_scenario
from microvib.io.tables import package_versions, to_json
from microvib.io.writing import write_file, write_folder
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validate_part
from microvib.studies.campaign.cases import Chunk, Label, WorkPackage
from microvib.studies.campaign.design import Design
from microvib.studies.campaign.study_file import Study
from microvib.studies.campaign.variation import Levels, Uncertain

MANIFEST, STUDY, SCENARIO, SAMPLES = "campaign.json", "study.yaml", "scenario.yaml", "samples.npy"
CHUNKS = "chunks"
SMALLEST_CHUNK, MAX_FILTER_CHUNK = 8, 256
TARGET_CHUNKS = 64
HISTORY_BYTES = 64_000_000
"""Largest chunk, where histories are kept."""
_CHUNK_FILE = re.compile(r"\d{6,}\.npz")


@dataclass(frozen=True)
class Campaign:
    """An open campaign. All that is needed to compute any of its chunks is in its folder."""

    folder: Path
    design: Design
    chunk_size: int
    """Cases of every chunk but the last."""
    microvib: str
    """Version of microvib that made the campaign, and that must compute it."""
    manifest: str
    """Content of ``campaign.json`` that the other files lack, as one line of JSON: cases, chunks, versions,
    and what varies.
    """
    identity: str
    """SHA-256 of what is computed, and with which version."""
    repair_note: str = ""
    """Repair made when the folder was opened; empty where nothing was."""

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.design.cases // self.chunk_size)

    def cases_of(self, chunk: int) -> range:
        """Numbers of the cases of a chunk."""
        first = chunk * self.chunk_size
        return range(first, min(first + self.chunk_size, self.design.cases))

    def work(
        self, chunk: int, cases: Sequence[int] | None = None, crashing: tuple[int, ...] = ()
    ) -> WorkPackage:
        """A chunk, or some cases of it, ready to be sent to a worker."""
        changes = tuple(map(self.design.changes, self.cases_of(chunk) if cases is None else cases))
        label = Label(self.identity, chunk, self.manifest)
        return WorkPackage(self.design.study, self.design.base, changes, label, crashing)

    def file(self, chunk: int) -> Path:
        """File of a chunk, there or not."""
        return self.folder / CHUNKS / f"{chunk:06d}.npz"

    def done(self) -> list[int]:
        """Chunks that are there, in order."""
        names = {entry.name for entry in os.scandir(self.folder / CHUNKS)}
        return [k for k in range(self.chunks) if self.file(k).name in names]

    def missing(self) -> list[int]:
        """Chunks that are not there, in order."""
        return sorted(set(range(self.chunks)).difference(self.done()))

    def check_version(self) -> None:
        """MicrovibError unless this is the version that made the campaign: its cases must not be
        computed by two.
        """
        here = package_versions()["microvib"]
        if here != self.microvib:
            raise MicrovibError(
                f"{self.folder}: was made by microvib {self.microvib}, and this is {here}; continue"
                " with that version,"
                " or make the campaign again"
            )

    def write(self, chunk: int, data: bytes) -> None:
        """Put a chunk's file in place at once; OutputError where the disk does not take it, and
        nothing is left then.
        """
        after = f"; what was computed before is kept, continue with: microvib campaign resume {shlex.quote(str(self.folder))}"
        write_file(self.file(chunk), data, overwrite=True, after=after)

    def read(self, chunk: int) -> Chunk:
        """Results of a chunk; MicrovibError where its file is damaged, or is not that chunk of this
        campaign.
        """
        path = self.file(chunk)
        found = _chunk_of(
            path, f"delete it, then: microvib campaign resume {shlex.quote(str(self.folder))}"
        )
        if found.label.campaign != self.identity:
            raise MicrovibError(f"{path}: is of another campaign; delete it, then resume this one")
        if found.label.chunk != chunk or len(found.reasons) != len(self.cases_of(chunk)):
            remedy = "rename it, or delete it and resume"
            raise MicrovibError(f"{path}: is chunk {found.label.chunk} of this campaign; {remedy}")
        return found

    def results(self) -> Iterator[tuple[range, Chunk]]:
        """All chunks that are there, in order, with the numbers of their cases."""
        for chunk in self.done():
            yield self.cases_of(chunk), self.read(chunk)


def _chunk_of(path: Path, remedy: str) -> Chunk:
    try:
        return Chunk.from_bytes(path.read_bytes())
    except Exception as error:  # a damaged archive is whatever its reader stumbles over
        raise MicrovibError(f"{path}: is damaged ({error}); {remedy}") from None


def default_chunk(design: Design) -> int:
    """Cases of a chunk: some 64 chunks, none too small to be worth its file, none too large to be
    sent or lost.
    """
    size = min(max(-(-design.cases // TARGET_CHUNKS), SMALLEST_CHUNK), MAX_FILTER_CHUNK)
    if design.study.keep:
        size = min(size, max(HISTORY_BYTES // (8 * design.base.record.samples), 1))
    return size


def create(design: Design, folder: Path, chunk_size: int | None = None) -> Campaign:
    """Write the folder of a new campaign; OutputError where something is in the way."""
    entries = {
        "cases": design.cases, "chunk_size": chunk_size or default_chunk(design), "versions": package_versions(),
        "combinations": design.combinations, "levels": [asdict(x) for x in design.levels],
        "uncertain": [asdict(x) for x in design.uncertain],
    }  # fmt: skip
    identity = _identity(json.dumps(json.loads(to_json(entries))), design)
    write_folder(folder, {
        STUDY: dump_part(design.study), SCENARIO: dump_scenario(design.base),
        MANIFEST: to_json({"sha256": identity, **entries}),
        SAMPLES: lambda path: np.save(path, design.samples), CHUNKS: lambda path: path.mkdir(),
    })  # fmt: skip
    return open_campaign(folder)


def open_campaign(folder: Path) -> Campaign:
    """The campaign of a folder; MicrovibError where it is not one, not whole, or was changed after
    it was made.

    A manifest that is lost is made again from what every chunk carries.
    """
    if (folder / MANIFEST).is_file():
        repair_note = ""
    else:
        repair_note = _restore_manifest(folder)
    try:
        entries = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        stated, size, microvib = (
            entries.pop("sha256"),
            entries["chunk_size"],
            str(entries["versions"]["microvib"]),
        )
        if not isinstance(size, int) or size < 1:
            raise ValueError(f"chunk_size {size!r} is not a whole number of at least 1")
        design, manifest = _design(folder, entries), json.dumps(entries)
        identity = _identity(manifest, design)
        (folder / CHUNKS).mkdir(exist_ok=True)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MicrovibError(f"{folder}: is not a whole campaign: {error}") from None
    if stated != identity:
        raise MicrovibError(
            f"{folder}: {MANIFEST}, {STUDY}, {SCENARIO} or {SAMPLES} were changed after the"
            " campaign was made; put them back,"
            " or make a new campaign (another limit needs none: give it to `microvib campaign"
            " report`)"
        )
    return Campaign(folder, design, size, microvib, manifest, identity, repair_note)


def _design(folder: Path, entries: dict[str, Any]) -> Design:
    """The design that the manifest's entries describe together with the other files of ``folder``."""
    study = validate_part(Study, parse_yaml(read_text(folder / STUDY, "study", ()), STUDY))
    levels = tuple(Levels(**_as_tuples(x)) for x in entries["levels"])
    uncertain = tuple(Uncertain(**_as_tuples(x)) for x in entries["uncertain"])
    samples = np.load(folder / SAMPLES, allow_pickle=False)
    return Design(
        study,
        load_scenario(folder / SCENARIO),
        tuple(entries["combinations"]),
        levels,
        uncertain,
        samples,
    )


def _as_tuples(entry: dict[str, Any]) -> dict[str, Any]:
    """Lists of JSON as the tuples that they were, and its nulls, of which only open ends are some,
    as infinite.
    """
    known = {
        key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()
    }
    ends = {"lower": -np.inf, "upper": np.inf}
    return known | {key: end for key, end in ends.items() if key in known and known[key] is None}


def _identity(manifest: str, design: Design) -> str:
    """SHA-256 over all of it: the manifest with its versions, study, scenario and samples."""
    digest = hashlib.sha256(manifest.encode())
    digest.update(dump_part(design.study).encode())
    digest.update(dump_scenario(design.base).encode())
    digest.update(np.ascontiguousarray(design.samples, dtype="<f8").tobytes())
    return digest.hexdigest()


def _restore_manifest(folder: Path) -> str:
    """Write a lost manifest again from a chunk; what was done, in words. MicrovibError where there
    is no chunk to take it from.
    """
    found = sorted(p for p in (folder / CHUNKS).glob("*.npz") if _CHUNK_FILE.fullmatch(p.name))
    if not found or not (folder / STUDY).is_file():
        raise MicrovibError(
            f"{folder}: is not a campaign; make one with: microvib campaign create STUDY"
            f" {shlex.quote(str(folder))}"
        )
    label = _chunk_of(found[0], "delete it, and try again").label
    write_file(folder / MANIFEST, to_json({"sha256": label.campaign, **json.loads(label.manifest)}))
    return f"{folder / MANIFEST}: was missing and was written again from {found[0].name}."
