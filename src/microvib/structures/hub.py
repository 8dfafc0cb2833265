"""A hub from its free-free modes: mass properties out of the six rigid ones, flexible shapes about
the centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, eigh

from microvib.model.rigid import elements, inertia_about_center, rigid_motion_at
from microvib.model.sentences import validate_part
from microvib.model.spacecraft import Hub
from microvib.structures.modal import ModalError, ModalModel, natural_frequency

RIGID_MODE_GAP = 20.0
"""Ratio of the seventh to the sixth frequency from which the first six are those of a rigid body."""
MAX_RIGID_MODE_FREQUENCY = 0.02
"""Frequency [Hz] below which a mode is one of a rigid body wherever the seventh lies."""
RIGID_BODY_TOLERANCE = 1e-3
"""Relative size of what a rigid body's modes and mass cannot have."""
MAX_RESIDUAL_MODES = 48
"""Residual modes at most: those of eight points."""
RESIDUAL_TOLERANCE = 1e-6
"""Part of the largest residual compliance below which one is nothing."""


@dataclass(frozen=True)
class FreeModes:
    """Free-free modes, mass-normalised, in SI and in hub axes from whatever origin."""

    frequency: np.ndarray
    """[Hz], (s,), with the six of the rigid body, in any order."""
    damping: np.ndarray
    """(s,)."""
    names: tuple[str, ...]
    positions: np.ndarray
    """Positions of the named points [m], (p, 3)."""
    shapes: np.ndarray
    """Displacements [kg^-0.5] and rotations [kg^-0.5 m^-1] of the points, (p, 6, s)."""
    coupling: np.ndarray | None = None
    """Damping that couples them, (s, s) [1/s]; None where there is none."""
    left_out_from: float | None = None
    """Frequency of the first flexible mode that is left out [Hz]; None where none is known to be."""


def hub_of(modes: FreeModes, damping: float | None = None, count: int | None = None) -> Hub:
    """The hub with its first ``count`` flexible modes and the static compliance of the others, all of
    them damped by ``damping`` where it is given.

    Modes that are given a ``damping`` are not coupled by it. ModalError where there are not six
    rigid modes, or they are not those of a rigid body.
    """
    modes = _ascending(modes)
    f, shapes = modes.frequency, modes.shapes
    coupled = None if damping is not None else modes.coupling
    _check_rigid(f)
    motions = np.array([rigid_motion_at(position) for position in modes.positions])
    rigid = shapes[:, :, :6].reshape(-1, 6)
    # Rigid modes come in any combination; B (6, 6) says how the origin moves in each.
    B, *_ = np.linalg.lstsq(motions.reshape(-1, 6), rigid, rcond=None)
    off = (
        np.abs(rigid - motions.reshape(-1, 6) @ B).reshape(-1, 6, 6).max(axis=(1, 2))
        / np.abs(rigid).max()
    )
    if off.max() > RIGID_BODY_TOLERANCE:
        k = int(off.argmax())
        raise ModalError(
            f"the six rigid modes move point {modes.names[k]} as no rigid body does (by"
            f" {off[k]:.2g} of their motion): its"
            " position, the units or the axes of its shapes do not belong to them"
        )
    if np.linalg.cond(B) > 1e12:
        raise ModalError(
            "the six modes of lowest frequency do not move the hub in six ways: one of them is a"
            " mechanism"
        )
    mass_matrix = np.linalg.inv(B @ B.T)
    mass = float(np.trace(mass_matrix[:3, :3]) / 3.0)
    coupling = mass_matrix[:3, 3:] / mass
    if np.abs(mass_matrix[:3, :3] / mass - np.eye(3)).max() > RIGID_BODY_TOLERANCE:
        raise ModalError(
            "the six rigid modes have another mass in each direction: they are not mass-normalised,"
            " or not in one unit system"
        )
    turned = 0.5 * (coupling - coupling.T)
    center = np.array([turned[1, 2], turned[2, 0], turned[0, 1]])
    inertia = inertia_about_center(
        mass, center, 0.5 * (mass_matrix[3:, 3:] + mass_matrix[3:, 3:].T)
    )
    kept = modes if count is None else condense(modes, count)
    f, shapes, coupled = kept.frequency, kept.shapes, None if coupled is None else kept.coupling
    return validate_part(
        Hub,
        {
            "mass": mass,
            "inertia": elements(inertia),
            "points": [
                {"name": name, "position": (position - center).tolist()}
                for name, position in zip(modes.names, modes.positions, strict=True)
            ],
            "modes": [
                {
                    "frequency": float(f[k]),
                    "damping": float(kept.damping[k]) if damping is None else damping,
                    "shapes": shapes[:, :, k].tolist(),
                    "coupling": () if coupled is None else coupled[k, 6:k].tolist(),
                }
                for k in range(6, f.size)
            ],
            "left_out_from": kept.left_out_from,
        },
        si=True,
    )


def condense(modes: FreeModes, count: int) -> FreeModes:
    """The six rigid modes, the first ``count`` flexible ones of ascending ``modes``, and residual
    modes that have the static compliance of the others at the points.

    Residual modes are combinations of those that are left out, which are as they are where they are
    no more than the loads at the points.
    """
    kept = 6 + count
    if kept >= modes.frequency.size:
        return modes
    omega = 2.0 * np.pi * modes.frequency[kept:]
    at_points = modes.shapes[:, :, kept:].reshape(-1, omega.size)
    static = at_points.T / omega[:, None] ** 2
    weights = residual_weights(at_points @ static, modes.positions)
    squares, combined = residual_modes(static @ weights)
    basis = np.eye(modes.frequency.size)[:, : kept + squares.size]
    basis[kept:, kept:] = combined
    own = 4.0 * np.pi * modes.damping * modes.frequency
    damping = np.diag(own) if modes.coupling is None else modes.coupling
    frequency = np.append(modes.frequency[:kept], natural_frequency(squares))
    xi = modes.damping[:kept]
    if squares.size:
        projected = np.diag(basis.T @ damping @ basis)[kept:]
        xi = np.append(xi, projected / (4.0 * np.pi * frequency[kept:]))
    return replace(
        modes,
        frequency=frequency,
        damping=xi,
        shapes=modes.shapes @ basis,
        coupling=None if modes.coupling is None else basis.T @ damping @ basis,
        left_out_from=_first_left_out(modes.frequency[kept:], at_points, squares.size),
    )


def _ascending(modes: FreeModes) -> FreeModes:
    """Modes by ascending frequency."""
    order = np.argsort(modes.frequency, kind="stable")
    coupling = modes.coupling
    return replace(
        modes,
        frequency=modes.frequency[order],
        damping=modes.damping[order],
        shapes=modes.shapes[:, :, order],
        coupling=None if coupling is None else coupling[np.ix_(order, order)],
    )


def _first_left_out(frequency: np.ndarray, at_points: np.ndarray, number: int) -> float | None:
    """Lowest ``frequency`` (c,) [Hz] of modes that move the points, ``at_points`` (6 p, c), where
    they are more than the ``number`` of residual modes; else None.
    """
    moves = np.any(at_points != 0.0, axis=0)
    if np.count_nonzero(moves) <= number:
        return None
    return float(frequency[moves].min())


def residual_weights(compliance: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Combinations of loads at the points, (6 p, r), that do unit work, each on its own static
    response alone.

    ``compliance`` is that of the modes that are left out, at the points at ``positions`` (p, 3) [m],
    (6 p, 6 p) [m/N, rad/N, rad/(N m)]. At most ``MAX_RESIDUAL_MODES`` are taken, those that yield
    most: torques of as many N m as the points are metres apart count as forces of 1 N.
    """
    reach = max(float(np.ptp(positions, axis=0).max()), 1.0)
    scale = np.tile(np.repeat([1.0, reach], 3), positions.shape[0])
    work, loads = np.linalg.eigh(compliance * np.outer(scale, scale))
    most = np.argsort(work)[::-1][:MAX_RESIDUAL_MODES]
    most = most[work[most] > max(RESIDUAL_TOLERANCE * work.max(initial=0.0), 1e-300)]
    return np.asarray(scale[:, None] * loads[:, most] / np.sqrt(work[most]))


def residual_modes(responses: np.ndarray, M: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """Squares of angular frequency, (r,) [rad^2/s^2] ascending, and mass-normalised vectors, (m, r),
    of static ``responses`` (m, r) of unit elastic energy that nothing couples (``residual_weights``).

    ``M`` is the mass matrix (m, m); without it the coordinates are mass-normalised modes.
    """
    moved = responses if M is None else M @ responses
    inverse, vectors = np.linalg.eigh(responses.T @ moved)
    return 1.0 / inverse[::-1], responses @ (vectors / np.sqrt(inverse))[:, ::-1]


def free_free_modes(model: ModalModel) -> FreeModes:
    """Free-free modes of what is known by its modes with the interface clamped, at the interface,
    which is called ``root``.

    The interface is the origin. ModalError where the modes hold more than the mass.
    """
    n = model.frequency.size
    mass = np.block([[model.mass, model.participation], [model.participation.T, np.eye(n)]])
    stiffness = np.concatenate([np.zeros(6), (2.0 * np.pi * model.frequency) ** 2])
    try:
        squares, shapes = eigh(np.diag(stiffness), mass)
    except LinAlgError:
        raise ModalError(
            f"{model.title}: the modal effective mass equals or exceeds the total mass; mass,"
            " participation and interface are inconsistent"
        ) from None
    omega = np.sqrt(np.maximum(squares, 0.0))
    damping = (shapes[6:].T * (2.0 * model.damping * np.sqrt(stiffness[6:]))) @ shapes[6:]
    xi = np.divide(0.5 * np.diag(damping), omega, out=np.zeros_like(omega), where=omega > 0.0)
    xi[:6] = 0.0
    return FreeModes(
        natural_frequency(squares), xi, ("root",), np.zeros((1, 3)), shapes[None, :6], damping
    )


def _check_rigid(f: np.ndarray) -> None:
    """ModalError unless exactly six of the frequencies (s,) [Hz], ascending, are those of a free
    rigid body.
    """
    count = int(np.sum(f < MAX_RIGID_MODE_FREQUENCY))
    if f.size > 6 and f[6] > RIGID_MODE_GAP * max(f[5], 1e-12):
        count = 6
    if count == 6:
        return
    if f.size > 6:
        seen = f", the sixth at {f[5]:.3g} Hz and the seventh at {f[6]:.3g} Hz"
    else:
        seen = ""
    raise ModalError(
        f"{count} of {f.size} modes are those of a free rigid body{seen}; a hub's modes need all"
        " six (no SPC, no SUPORT left"
        " out), and no mechanism beside them"
    )
