"""Checks that an analyst makes of a modal model before using it; what is fatal is an error, the
rest is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from microvib.model.array import ROUNDING_TOLERANCE, TABLE_ROUNDING_TOLERANCE
from microvib.model.rigid import COMPONENTS
from microvib.structures.modal import ModalError, ModalModel

RIGID = 1e-3  # Hz; below it no array is meant
GAP = 100.0  # ratio of the seventh to the sixth frequency from which the six are a free body's
# share of the rigid-body mass that the modes should hold (the 90 % rule; paper, section 3.1)
MIN_EFFECTIVE_MASS_FRACTION = 0.9
MASSES, HIGHEST, LENGTHS = (0.1, 2000.0), 1e4, (0.01, 100.0)
"""Plausible masses of arrays [kg], highest frequency of use [Hz], and radii of gyration [m]."""


def check_deck(frequency: np.ndarray, mass: np.ndarray) -> None:
    """ModalError for a free body, a mechanism, or an invalid mass matrix."""
    if not frequency.size:
        raise ModalError("has no modes")
    if not (np.all(np.isfinite(frequency)) and np.all(np.isfinite(mass))):
        raise ModalError("holds values that are not finite numbers")
    check_clamped(frequency)
    diagonal = np.diag(mass)
    if np.any(diagonal < 0.0):
        k = int(np.argmin(diagonal))
        raise ModalError(
            f"rigid-body mass in {COMPONENTS[k]} is {diagonal[k]:.4g}; it must not be negative"
        )
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    unit = mass / np.outer(size, size)
    if np.abs(unit - unit.T).max() > TABLE_ROUNDING_TOLERANCE:
        i, j = np.unravel_index(int(np.abs(unit - unit.T).argmax()), (6, 6))
        raise ModalError(
            f"rigid-body mass matrix is not symmetric: {COMPONENTS[i]}-{COMPONENTS[j]} is"
            f" {mass[i, j]:.4g} one way"
            f" and {mass[j, i]:.4g} the other"
        )
    least = float(np.linalg.eigvalsh(unit + unit.T).min() / 2.0)
    if least < -TABLE_ROUNDING_TOLERANCE:
        raise ModalError(
            f"rigid-body mass matrix has a negative eigenvalue ({least:.2g} of its diagonal)"
        )


def check_clamped(frequency: np.ndarray) -> None:
    """ModalError where there are rigid-body modes; the frequencies need no order."""
    frequency = np.sort(frequency)
    rigid = int((frequency < RIGID).sum())
    if frequency.size > 6 and frequency[6] > GAP * frequency[5]:
        rigid = max(rigid, 6)
    if not rigid:
        return
    if rigid >= 6:
        what = "free"
    else:
        what = "not constrained in all directions, or contains a mechanism or a disconnected part"
    raise ModalError(
        f"{rigid} of {frequency.size} modes are rigid-body modes (up to {frequency[rigid - 1]:.3g}"
        " Hz): the model is"
        f" {what}; modes with the interface point clamped (SPC in all six directions) are expected"
    )


def check_mass(model: ModalModel) -> ModalModel:
    """The model, freed of rounding; ModalError where its modes and its mass cannot belong together.

    What is left of the rigid-body mass when the modes are taken out must be a mass.
    """
    if model.inertia <= 0.0:
        raise ModalError(
            f"has no moment of inertia about the drive axis ({model.drive_axis}); is the drive axis"
            " right?"
        )
    size = np.sqrt(np.where(np.diag(model.mass) > 0.0, np.diag(model.mass), 1.0))
    rest = (model.mass - model.participation @ model.participation.T) / np.outer(size, size)
    over = float(-np.linalg.eigvalsh(rest).min())
    if over > TABLE_ROUNDING_TOLERANCE:
        share = np.nan_to_num(model.fraction.sum(axis=1))
        k = int(share.argmax())
        if share[k] > 1.0:
            most = f", {100.0 * share[k]:.4g} % of it in {COMPONENTS[k]}"
        else:
            most = ""
        raise ModalError(
            f"the modes hold more than the mass of the rigid body{most}: mass, participation,"
            " reference point or"
            " normalisation do not belong together"
        )
    if over <= ROUNDING_TOLERANCE:
        return model
    said = f"Participation factors were reduced by {over / 2:.1g} of their value: rounding had made them hold more than all mass."
    return replace(
        model, participation=model.participation / np.sqrt(1.0 + over), notes=(*model.notes, said)
    )


def with_plausibility_notes(model: ModalModel, units: str) -> ModalModel:
    """The model with what is implausible in its notes."""
    return replace(
        model, notes=(*model.notes, *_shares(model), *_rigid_body(model), *_plausible(model, units))
    )


def _shares(model: ModalModel) -> Iterator[str]:
    share = model.fraction.sum(axis=1)
    low = [
        f"{COMPONENTS[k]} {100.0 * share[k]:.1f} %"
        for k in range(6)
        if share[k] < MIN_EFFECTIVE_MASS_FRACTION
    ]
    if low:
        yield (
            f"The {model.frequency.size} modes hold less than 90 % of the rigid-body mass in:"
            f" {', '.join(low)}; more modes are"
            " needed where these directions matter."
        )
    if share[model.axis] < 1e-6:
        yield f"No mode moves about the drive axis ({model.drive_axis}): is the drive axis right?"
    bare = [COMPONENTS[k] for k in range(6) if model.spatial and not np.isfinite(share[k])]
    if bare:
        yield f"The model has no mass in {', '.join(bare)}: these directions are missing."


def _rigid_body(model: ModalModel) -> Iterator[str]:
    """Whether the matrix is that of a rigid body: one mass, the same in all directions, with its
    centre.
    """
    m, coupling = np.diag(model.mass)[:3], model.mass[:3, 3:]
    if not model.spatial or not m.all():
        return
    skew = np.abs(coupling + coupling.T).max()
    if np.ptp(m) > 0.01 * m.max():
        values = ", ".join(f"{v:.4g} kg" for v in m)
        yield f"The mass differs by direction ({values} along x, y, z): scalar masses, or degrees of freedom left out."
    elif skew > 0.01 * max(
        np.abs(coupling).max(), np.sqrt(m.max() * np.diag(model.mass)[3:].max())
    ):
        yield "The coupling of translation and rotation is not that of a rigid body: degrees of freedom were left out."


def _plausible(model: ModalModel, units: str) -> Iterator[str]:
    """Magnitudes that another unit system than the declared one would explain."""
    question = f"is the deck really in {units}?"
    if model.frequency[-1] > HIGHEST:
        yield f"The highest frequency is {model.frequency[-1]:.4g} Hz, above {HIGHEST:g} Hz: {question}"
    m = float(np.diag(model.mass)[:3].max())
    if not model.spatial or m <= 0.0:
        return
    (light, heavy), (short, long) = MASSES, LENGTHS
    if not light <= m <= heavy:
        yield f"The mass is {m:.4g} kg, not within {light:g} to {heavy:g} kg as arrays are: {question}"
    radius = float(np.sqrt(np.diag(model.mass)[3:].max() / m))
    if not short <= radius <= long:
        yield f"The largest radius of gyration is {radius:.4g} m, not within {short:g} to {long:g} m: {question}"
