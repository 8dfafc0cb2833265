"""Where modes come from: a structure of the catalog, a description of an array or a simulator, a
table of modes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from microvib.errors import ScenarioError, missing_library
from microvib.io.file_access import NO_FILES, FileAccess
from microvib.io.named import named_text, reference_names
from microvib.io.yaml_text import parse_yaml
from microvib.model.sentences import validate_part
from microvib.structures.array_design import ArrayDesign
from microvib.structures.modal import ModalModel
from microvib.structures.simulator_design import SimulatorDesign

if TYPE_CHECKING:
    from microvib.structures.deck import ImportOptions
    from microvib.structures.fem.modes import Modes

DEFAULT_MODES = 10  # modes taken of finite elements where their number is not given
StructureDesign = ArrayDesign | SimulatorDesign
DESCRIPTIONS = (".yaml", ".yml")
TABLES = (".csv",)
RESULTS = (
    ".op2",
    ".op4",
    ".pch",
    ".f06",
    ".out",
    ".txt",
)  # endings of what Nastran and Ansys write


@dataclass(frozen=True)
class ModalSource:
    """A modal model, with the finite elements that it comes from where they are known."""

    name: str
    model: ModalModel
    design: StructureDesign | None = None
    modes: Modes | None = None


def modal_source(
    source: str,
    count: int | None = None,
    files: FileAccess = NO_FILES,
    options: ImportOptions | None = None,
) -> ModalSource:
    """Modal model of ``source``: a catalog name, or one of the ``files``, whose ending says what it
    is.

    ``count`` is how many modes are needed; of a table without it, all. ``options`` say how results
    of a finite-element program are meant. Raises a sentence where there is none.
    """
    ending = Path(source).suffix.lower()
    if options is not None:
        expect_results(source)
    if source in reference_names() or ending in DESCRIPTIONS:
        return _from_design(
            load_design(source, files), source, DEFAULT_MODES if count is None else count
        )
    if ending in (*TABLES, *RESULTS):
        from microvib.io.nastran import read_modal_model

        model = read_modal_model(files.path(source, reference_names()), options)
        return ModalSource(source, model if count is None else model.first(count))
    raise ScenarioError(
        f"{source}: is not a source of modes; allowed are {', '.join(reference_names())}, a"
        " description of an array or a"
        f" simulator ({', '.join(DESCRIPTIONS)}), a table of modes ({', '.join(TABLES)})"
        f" and results of Nastran or Ansys ({', '.join(RESULTS)})"
    )


def expect_results(source: str) -> None:
    """ScenarioError where options of an import are given for what is not the results of a
    finite-element program.
    """
    if Path(source).suffix.lower() not in RESULTS:
        raise ScenarioError(
            f"{source}: needs no options; units, interface, axis and damping are for"
            f" {', '.join(RESULTS)}"
        )


def load_design(source: str, files: FileAccess = NO_FILES) -> StructureDesign:
    """Description of an array or a simulator (what has a frame): one of the ``files``, or of the
    catalog. Raises ScenarioError.
    """
    data = parse_yaml(
        named_text(source, files, kind="structure", published=reference_names()), source
    )
    if isinstance(data, dict) and "frame" in data:
        kind: type[StructureDesign] = SimulatorDesign
    else:
        kind = ArrayDesign
    return validate_part(kind, data, origin=source)


def _from_design(design: StructureDesign, name: str, count: int) -> ModalSource:
    with elements_of(name):
        from microvib.structures.fem.described import modal_model, solve_design
    return ModalSource(name, modal_model(design, count), design, solve_design(design, count))


@contextmanager
def elements_of(name: str) -> Iterator[None]:
    """ScenarioError where what finite elements of ``name`` take cannot be imported."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ScenarioError(f"{name}: {missing_library(error) or error}") from None
