"""What makes a campaign the one that it is: its design as files, and the identity that every chunk carries."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.scenario_file import dump_part, dump_scenario, load_scenario, read_text
from microvib.io.tables import package_versions, to_json
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validated
from microvib.studies.campaign.design import Design
from microvib.studies.campaign.study_file import Study
from microvib.studies.campaign.variation import Levels, Uncertain

MANIFEST, STUDY, SCENARIO, SAMPLES = "campaign.json", "study.yaml", "scenario.yaml", "samples.npy"


@dataclass(frozen=True)
class Manifest:
    """What ``campaign.json`` adds to the other files: cases, chunks, versions, and what varies."""

    entries: dict[str, Any]

    @classmethod
    def of(cls, design: Design, chunk_size: int) -> Manifest:
        """Manifest of a new campaign."""
        entries = {
            "cases": design.cases,
            "chunk_size": chunk_size,
            "versions": package_versions(),
            "combinations": design.combinations,
            "levels": [asdict(x) for x in design.levels],
            "uncertain": [asdict(x) for x in design.uncertain],
        }
        return cls(json.loads(to_json(entries)))

    @cached_property
    def text(self) -> str:
        """The manifest as one line of JSON."""
        return json.dumps(self.entries)

    @property
    def chunk_size(self) -> int:
        """Cases of a chunk; ValueError where it is not a number of them."""
        size = self.entries["chunk_size"]
        if not isinstance(size, int) or size < 1:
            raise ValueError(f"chunk_size {size!r} is not a whole number from 1 on")
        return size

    @property
    def microvib(self) -> str:
        """Version of microvib that made the campaign, and that must compute it."""
        return str(self.entries["versions"]["microvib"])

    def design(self, folder: Path) -> Design:
        """The design that it describes together with the other files of ``folder``."""
        study = validated(Study, parse_yaml(read_text(folder / STUDY, "study", ()), STUDY))
        base = load_scenario(folder / SCENARIO)
        levels = [Levels(**_frozen(x)) for x in self.entries["levels"]]
        # JSON knows no infinity: an open end is written as null.
        ends = [
            {"lower": _or(x["lower"], -np.inf), "upper": _or(x["upper"], np.inf)} for x in self.entries["uncertain"]
        ]
        uncertain = [Uncertain(**_frozen(x) | end) for x, end in zip(self.entries["uncertain"], ends, strict=True)]
        samples = np.load(folder / SAMPLES, allow_pickle=False)
        return Design(study, base, tuple(self.entries["combinations"]), tuple(levels), tuple(uncertain), samples)

    def identity(self, design: Design) -> str:
        """SHA-256 over all of it: study, scenario, samples, and the manifest with its versions."""
        digest = hashlib.sha256(self.text.encode())
        digest.update(dump_part(design.study).encode())
        digest.update(dump_scenario(design.base).encode())
        digest.update(np.ascontiguousarray(design.samples, dtype="<f8").tobytes())
        return digest.hexdigest()


def _frozen(entry: dict[str, Any]) -> dict[str, Any]:
    """Lists of JSON as the tuples that they were."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}


def _or(value: float | None, default: float) -> float:
    return default if value is None else value
