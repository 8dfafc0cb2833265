"""Stiffness and mass of single elements, from pyfe3d; equal elements are computed once.

Shells are its Quad4R. Of the library's four-node and three-node shells it is the only one that
passed: Quad4 gives a free plate a seventh mode of zero frequency (an hourglass), Tria3DSG locks on
thin plates and Tria3R does not converge to theory (``benchmarks/fem.py --elements``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pyfe3d import DOUBLE, INT, BeamC, BeamCData, BeamCProbe, Quad4R, Quad4RData, Quad4RProbe
from pyfe3d.beamprop import BeamProp

from microvib.structures.fem.structure import Beams, Section, Shells

Matrices = tuple[np.ndarray, np.ndarray]

# The library's hourglass stiffness of rotations is ten times what the full integration of the
# bending energy would give to the same pattern, and makes coarse meshes as much stiffer.
HOURGLASS_ROTATION = 0.1


def element_matrices(
    part: Shells | Beams, xyz: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness and mass of the distinct elements of a part, each (c, d, d), and which of them each
    element has, (n,).
    """
    corners = xyz[part.nodes]
    relative = (corners - corners[:, :1]).reshape(len(corners), -1)
    size = np.abs(relative).max()
    _, first, which = np.unique(
        np.round(relative / size, 9), axis=0, return_index=True, return_inverse=True
    )
    if isinstance(part, Shells):
        one = _shell(part)
    else:
        one = _beam(part)
    matrices = [one(relative[k]) for k in first]
    return np.array([m[0] for m in matrices]), np.array([m[1] for m in matrices]), which.ravel()


def _shell(part: Shells) -> Callable[[np.ndarray], Matrices]:
    element, data, laminate = Quad4R(Quad4RProbe()), Quad4RData(), part.laminate
    factors = (1.0, 1.0, 1.0, HOURGLASS_ROTATION, HOURGLASS_ROTATION)
    return _filled(
        element,
        4,
        data,
        lambda x: element.update_rotation_matrix(x, *part.axis),
        laminate,
        (0, *factors),
    )


def _beam(part: Beams) -> Callable[[np.ndarray], Matrices]:
    element, data, prop = BeamC(BeamCProbe()), BeamCData(), beam_property(part.section)
    return _filled(
        element, 2, data, lambda x: element.update_rotation_matrix(*part.up, x), prop, ()
    )


def beam_property(section: Section) -> BeamProp:
    """The library's property of a section."""
    prop = BeamProp()
    prop.A, prop.E, prop.G, prop.J = section.A, section.E, section.G, section.J
    prop.Iyy, prop.Izz = section.I_yy, section.I_zz
    prop.G12, prop.G13 = section.shear_y * section.G, section.shear_z * section.G
    prop.intrho = section.density * section.A
    prop.intrhoy2, prop.intrhoz2 = section.density * section.I_zz, section.density * section.I_yy
    return prop


def _filled(
    element: Any,
    corners: int,
    data: Any,
    orient: Callable[[np.ndarray], None],
    prop: Any,
    options: tuple[Any, ...],
) -> Callable[[np.ndarray], Matrices]:
    """Dense stiffness and mass of ``element`` as a function of its corners' coordinates."""
    d = 6 * corners
    for k in range(corners):
        setattr(element, f"n{k + 1}", k)
        setattr(element, f"c{k + 1}", 6 * k)
    element.init_k_KC0 = element.init_k_M = 0

    def matrices(x: np.ndarray) -> Matrices:
        x = np.ascontiguousarray(x)
        orient(x)
        element.update_probe_xe(x)
        return (
            _dense(element.update_KC0, data.KC0_SPARSE_SIZE, d, prop, options),
            _dense(element.update_M, data.M_SPARSE_SIZE, d, prop, (0,)),
        )

    return matrices


def _dense(
    update: Callable[..., None], size: int, d: int, prop: Any, options: tuple[Any, ...]
) -> np.ndarray:
    rows, columns, values = np.zeros(size, INT), np.zeros(size, INT), np.zeros(size, DOUBLE)
    update(rows, columns, values, prop, *options)
    dense = np.zeros((d, d))
    np.add.at(dense, (rows, columns), values)
    return dense
