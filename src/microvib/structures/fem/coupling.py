"""Second-order terms of a rotating array (Eq. 8-13, 15), and their size against what Eq. 16 keeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microvib.structures.fem.modes import Modes


@dataclass(frozen=True)
class Coupling:
    """Structural coupling of modes that turn about the drive axis, for a rate of 1 rad/s."""

    F: np.ndarray  # Coriolis coupling F_omega: sum of m phi_i . (e x phi_j), antisymmetric (s, s)
    N: (
        np.ndarray
    )  # centrifugal coupling -F_omega_omega: sum of m phi_i . phi_j across the axis, (s, s)
    # centrifugal load H_omega about the axis: sum of m rho . phi_i across the axis [kg^0.5 m], (s,)
    C: np.ndarray


@dataclass(frozen=True)
class Size:
    """How much Eq. 15's coupling terms change at one rate, each relative to what is kept."""

    rate: float  # [rad/s]
    coriolis: float  # largest 2 omega |F_ij| / sqrt(Omega_i Omega_j): Coriolis against inertia
    centrifugal: float  # largest omega^2 N_ii / Omega_i^2: centrifugal against elastic force
    frequency: float  # largest change of a natural frequency
    torque: float  # largest change of T_l over the acceleration of the shaft, 0.01 to 200 Hz


def coupling(modes: Modes, axis: int = 0) -> Coupling:
    """Coupling matrices of Eq. 13, from the nodes' masses as the paper sums them (Eq. 12)."""
    e = np.eye(3)[axis]
    m = modes.node_masses
    u = modes.shapes[:, :3, :]
    across = u - np.einsum("k,nks,l->nls", e, u, e)
    turned = np.cross(e, u, axisb=1, axisc=1)
    rho = modes.structure.xyz - modes.structure.xyz[modes.structure.interface]
    return Coupling(
        F=np.einsum("n,nks,nkt->st", m, u, turned),
        N=np.einsum("n,nks,nkt->st", m, across, across),
        C=np.einsum("n,nk,nks->s", m, rho, across),
    )


def coupling_size(modes: Modes, rate: float, damping: np.ndarray, axis: int = 0) -> Size:
    """Size of the second-order terms at a steady ``rate`` [rad/s]; ``damping`` are the modes'
    ratios, (s,).
    """
    terms = coupling(modes, axis)
    Omega = 2.0 * np.pi * modes.frequency
    turning = rotating_frequencies(terms, Omega, rate)
    without, with_ = (_response(terms, modes, Omega, damping, w, axis) for w in (0.0, rate))
    return Size(
        rate=rate,
        coriolis=float(np.max(2.0 * rate * np.abs(terms.F) / np.sqrt(np.outer(Omega, Omega)))),
        centrifugal=float(np.max(rate**2 * np.diag(terms.N) / Omega**2)),
        frequency=float(np.max(np.abs(turning / np.sort(Omega) - 1.0))),
        torque=float(np.max(np.abs(with_ / without - 1.0))),
    )


def rotating_frequencies(terms: Coupling, Omega: np.ndarray, rate: float) -> np.ndarray:
    """Angular natural frequencies, (s,) ascending, of modes that turn at ``rate``, undamped, the
    shaft at a steady rate.
    """
    s = Omega.size
    stiffness = np.diag(Omega**2) - rate**2 * terms.N
    first_order = np.block([[np.zeros((s, s)), np.eye(s)], [-stiffness, -2.0 * rate * terms.F]])
    return np.sort(np.abs(np.linalg.eigvals(first_order).imag))[::2]


def _response(
    terms: Coupling, modes: Modes, Omega: np.ndarray, damping: np.ndarray, rate: float, axis: int
) -> np.ndarray:
    """Torque over acceleration of the shaft [kg m^2] about a steady rate, with the deflection that
    it holds.
    """
    stiffness = np.diag(Omega**2) - rate**2 * terms.N
    held = np.linalg.solve(stiffness, rate**2 * terms.C)
    H = modes.participation[3 + axis] + terms.F @ held
    C = terms.C + terms.N @ held
    J = modes.mass[3 + axis, 3 + axis] + 2.0 * terms.C @ held + held @ terms.N @ held
    out = []
    for p in 2j * np.pi * np.geomspace(0.01, 200.0, 2000):
        dynamic = (
            p**2 * np.eye(Omega.size)
            + p * (np.diag(2.0 * damping * Omega) + 2.0 * rate * terms.F)
            + stiffness
        )
        eta = np.linalg.solve(dynamic, -(H - 2.0 * rate * C / p))
        out.append(J + (H * p**2 + 2.0 * rate * C * p) @ eta)
    return np.array(out)
