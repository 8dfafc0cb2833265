"""Checks of a structure before and after it is solved."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from microvib.structures.fem.structure import (
    Link,
    Part,
    Shells,
    Spring,
    Structure,
    StructureError,
    nodes_of,
)

MAX_MECHANISM_FREQUENCY = 0.002  # frequency [Hz] below which a mode is taken for a mechanism


def check_structure(structure: Structure) -> None:
    """StructureError where parts are not connected to the interface, or links hang on each other."""
    _check_links(structure)
    _check_numbers(structure)
    n = len(structure.xyz)
    pairs = np.concatenate([_edges(part) for part in structure.parts])
    graph = sp.coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    held = component[structure.interface]
    loose = [part.name for part in structure.parts if np.any(component[nodes_of(part)] != held)]
    if loose:
        raise StructureError(
            f"{structure.title}: {', '.join(dict.fromkeys(loose))}: not connected to the interface;"
            " every part must be held by"
            " hinges or links, directly or through other parts"
        )
    if np.any(component != held):
        raise StructureError(
            f"{structure.title}: {np.sum(component != held)} nodes belong to no part"
        )


def _edges(part: Part) -> np.ndarray:
    if isinstance(part, Spring) and not any(part.stiffness):
        return np.zeros((0, 2), dtype=int)
    if isinstance(part, Shells):
        return np.concatenate([part.nodes[:, [k, (k + 1) % 4]] for k in range(4)])
    nodes = nodes_of(part)
    if isinstance(part, Link):
        return np.column_stack([np.full(len(part.slaves), part.master), part.slaves])
    return np.atleast_2d(getattr(part, "nodes", np.column_stack([nodes, nodes])))


def _check_links(structure: Structure) -> None:
    links = structure.of(Link)
    if links:
        slaves = np.concatenate([link.slaves for link in links])
    else:
        slaves = np.zeros(0, dtype=int)
    for link in links:
        if link.master in slaves or structure.interface in link.slaves:
            raise StructureError(
                f"{structure.title}: {link.name}: its reference node depends on another rigid link"
            )
    if len(np.unique(slaves)) != len(slaves):
        raise StructureError(
            f"{structure.title}: two rigid links share a node; make footprints smaller or farther"
            " apart"
        )


def _check_numbers(structure: Structure) -> None:
    for part in structure.of(Shells):
        h, density = part.laminate.h, part.laminate.intrho
        if not (h > 0.0 and density > 0.0 and part.laminate.D11 > 0.0):
            raise StructureError(
                f"{structure.title}: {part.name}: thickness {h:g} m and mass {density:g} kg/m^2"
                " must be greater than 0"
            )


def check_mechanisms(
    structure: Structure, frequency: np.ndarray, shapes: np.ndarray, masses: np.ndarray
) -> None:
    """StructureError naming the part that moves most where a mode has no stiffness.

    ``frequency`` (s,) [Hz], ``shapes`` (n, 6, s), ``masses`` of the nodes (n,) [kg].
    """
    loose = np.flatnonzero(frequency < MAX_MECHANISM_FREQUENCY)
    if not loose.size:
        return
    texts = [_what_moves(structure, shapes[:, :, k], masses) for k in loose[:3]]
    raise StructureError(
        f"{structure.title}: {loose.size} mode{'s' if loose.size > 1 else ''} without stiffness"
        f" (below {MAX_MECHANISM_FREQUENCY:g} Hz) with the"
        f" interface clamped: {'; '.join(texts)}; give the hinges or the shaft stiffness there"
    )


def _what_moves(structure: Structure, shape: np.ndarray, masses: np.ndarray) -> str:
    energy = masses[:, None] * shape[:, :3] ** 2
    moving = {
        part.name: energy[nodes_of(part)].sum()
        for part in structure.parts
        if not isinstance(part, (Link, Spring))
    }
    name = max(moving, key=lambda key: moving[key])
    return f"{name} moves along {'xyz'[int(np.argmax(energy.sum(axis=0)))]}"
