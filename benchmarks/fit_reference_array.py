"""Where the numbers of the catalog's reference-array come from: a fit of its geometry to Table 1.

The paper gives frequencies and effective inertias but no geometry. Stiffnesses and dimensions within the ranges of a designer are
varied from random starts until frequencies, torsional fractions and inertia agree. Modes are matched by kind, so that the order follows
from the fit. Which kinds modes 8 to 10 have is not printed; the assignments tried are listed in ``ASSIGNMENTS``. The best is then
fitted again on a finer mesh, with the panels off the axis and one side's hinges stiffer (harness), to all ten rows in their order.

    python benchmarks/fit_reference_array.py [--starts N] [--assignment NAME] [--seed S]
"""

from __future__ import annotations

import argparse
import copy
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from microvib.errors import MicrovibError
from microvib.fem.array import structure_of
from microvib.fem.modes import kinds, solve
from microvib.io.results import read_table
from microvib.io.scenario_file import catalog_text, parse_yaml
from microvib.model.design import ArrayDesign
from microvib.model.sentences import validated

INERTIA = 7.694  # kg m^2: 7.44/0.967 of Table 1
TORSION = (0.967, 0.0269, 0.00285, 0.00192)
BEYOND = 12.5  # Hz: modes that Table 1 does not have lie above
ASSIGNMENTS = {
    "torsion-bending-torsion": {"B": (0.22, 1.28, 4.17, 9.09), "I": (0.55, 2.46, None), "T": (1.18, 4.45, 8.98, 11.6)},
    "torsion-inplane-torsion": {"B": (0.22, 1.28, 4.17, None), "I": (0.55, 2.46, 9.09), "T": (1.18, 4.45, 8.98, 11.6)},
    "torsion-bending-inplane": {"B": (0.22, 1.28, 4.17, 9.09), "I": (0.55, 2.46, 11.6), "T": (1.18, 4.45, 8.98, None)},
}
# name: (low, high) of what is varied; SI units
RANGES: dict[str, tuple[float, float]] = {
    "chord": (1.55, 1.85), "span": (1.4, 2.1), "gap": (0.002, 0.1), "nonstructural": (1.2, 3.2), "core": (0.012, 0.03), "face_shear": (4e9, 1.5e10),
    "length": (0.8, 2.8), "drive": (0.03, 0.3), "panel": (0.15, 0.6),
    "leg_width": (0.02, 0.06), "leg_height": (0.02, 0.06), "leg_wall": (0.8e-3, 3e-3),
    "bar_width": (0.012, 0.06), "bar_height": (0.012, 0.06), "bar_wall": (0.8e-3, 3e-3),
    "root_translation": (3e4, 3e6), "root_about_x": (30.0, 5e4), "root_about_y": (300.0, 5e4),
    "position": (0.15, 0.7), "translation": (3e4, 3e6), "about_x": (30.0, 5e4), "about_y": (300.0, 1e4), "about_z": (10.0, 5e3),
}  # fmt: skip
START = {
    "chord": 1.675, "span": 1.721, "gap": 0.09, "nonstructural": 2.441, "core": 0.0217, "face_shear": 6e9,
    "length": 2.75, "drive": 0.23, "panel": 0.27, "leg_width": 0.0307, "leg_height": 0.0423, "leg_wall": 0.9e-3,
    "bar_width": 0.014, "bar_height": 0.0125, "bar_wall": 0.9e-3,
    "root_translation": 1.35e5, "root_about_x": 3860.0, "root_about_y": 4e4,
    "position": 0.25, "translation": 3e5, "about_x": 3.8e4, "about_y": 2200.0, "about_z": 12.0,
}  # fmt: skip
"""First guess, rounded from earlier random starts."""
SMALL = {"offset": (1e-3, 8e-3), "harness": (1.0003, 1.1)}
"""What breaks the symmetry: offset of the panels, stiffness about the hinge line of one side over that of the other."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--assignment", choices=list(ASSIGNMENTS), default="torsion-bending-inplane")
    options = parser.parse_args()
    targets = ASSIGNMENTS[options.assignment]
    rng = np.random.default_rng(options.seed)
    low, high = np.log(np.array(list(RANGES.values())).T)
    best = None
    for start in range(options.starts + 1):
        drawn = [rng.uniform(low, high) for _ in range(40)]
        x0 = min(drawn, key=lambda x: np.sum(residuals(x, targets) ** 2)) if start else np.log(list(START.values()))
        fit = least_squares(residuals, x0, bounds=(low, high), args=(targets,), diff_step=1e-3, max_nfev=30)
        print(f"start {start}: cost {fit.cost:.4g}", flush=True)
        if best is None or fit.cost < best.cost:
            best = fit
            show(fit.x, targets)
    assert best is not None
    refine(best.x, low, high)


def refine(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    """Fit all ten rows of Table 1 in their order, from the best of the symmetric arrays."""
    small = np.log(np.array(list(SMALL.values())).T)
    x0 = np.r_[x, np.log([3.2e-3, 1.02])]
    bounds = (np.r_[low, small[0]], np.r_[high, small[1]])
    x0 = np.clip(x0, bounds[0] + 1e-6, bounds[1] - 1e-6)
    fit = least_squares(row_residuals, x0, bounds=bounds, diff_step=1e-3, max_nfev=12)
    print(f"all rows: cost {fit.cost:.4g}")
    names = (*RANGES, *SMALL)
    print("  " + ", ".join(f"{name} {value:.4g}" for name, value in zip(names, np.exp(fit.x), strict=True)))
    modes = solve(structure_of(design_of(fit.x, 0.1)), 14)
    for k, kind in enumerate(kinds(modes)):
        print(f"  {k + 1} {kind} {modes.frequency[k]:.4f} {modes.participation[3, k] ** 2 / modes.mass[3, 3]:.3g}")
    print(f"  J {modes.mass[3, 3]:.4f}", flush=True)


def row_residuals(x: np.ndarray) -> np.ndarray:
    """Deviations of the ten rows over what is aimed at: 1 % of frequency, 0.2 % of the inertia.

    Fractions of torsion modes count with 0.2 to 30 %, those of modes 2, 4, 5 and 6 as factors of 1.5 and 10; modes 1, 9 and 10 are left free.
    """
    rows = list(read_table("table1_array_modes"))
    modes = solve(structure_of(design_of(x, 0.25)), 14)
    J = modes.mass[3, 3]
    f = np.array([float(row["frequency_hz"]) for row in rows])
    fraction = np.array([float(row["effective_fraction"]) for row in rows])
    found = modes.participation[3, :10] ** 2 / J
    scale = np.array([np.inf, np.log(1.5), 0.002, *[np.log(10.0)] * 3, 0.1, 0.3, np.inf, np.inf])
    out = [np.log(modes.frequency[:10] / f) / 0.01, np.log(np.maximum(found, 1e-9) / fraction) / scale]
    return np.concatenate([*out, [np.log(J / INERTIA) / 0.002]])


def residuals(x: np.ndarray, targets: dict[str, tuple[float | None, ...]]) -> np.ndarray:
    """Deviations over what is aimed at: 2 % of frequency, and of the torsional fractions 0.3 % to 30 %."""
    try:
        found = by_kind(design_of(x))
    except MicrovibError:
        return np.full(sum(map(len, targets.values())) + len(TORSION) + 2, 1e3)
    out = []
    for kind, frequencies in targets.items():
        for k, wanted in enumerate(frequencies):
            f = found[kind][k][0] if k < len(found[kind]) else 40.0
            out.append(min(np.log(f / BEYOND), 0.0) / 0.02 if wanted is None else np.log(f / wanted) / 0.02)
    axial = found["A"][0][0] if found["A"] else 40.0
    out.append(min(np.log(axial / BEYOND), 0.0) / 0.02)
    torsion = [fraction for _, fraction in found["T"]] + [1e-4] * len(TORSION)
    scales = (0.003, 0.1, 0.3, 0.3)
    out += [np.log(max(f, 1e-9) / w) / s for f, w, s in zip(torsion, TORSION, scales, strict=False)]
    out.append(np.log(found["J"] / INERTIA) / 0.002)
    return np.array(out)


def by_kind(design: ArrayDesign) -> dict[str, Any]:
    """Frequency and torsional fraction of the modes of each kind, and the inertia."""
    modes = solve(structure_of(design), 20)
    J = modes.mass[3, 3]
    found: dict[str, Any] = {kind: [] for kind in "BITPA"}
    for k, kind in enumerate(kinds(modes)):
        found[kind].append((modes.frequency[k], modes.participation[3, k] ** 2 / J))
    return {**found, "J": J}


def design_of(x: np.ndarray, mesh: float = 0.6) -> ArrayDesign:
    """The catalog's description with the varied values put in."""
    v = dict(zip((*RANGES, *SMALL), np.exp(x), strict=False))
    data = copy.deepcopy(catalog())
    data["panels"].update(chord=v["chord"], span=v["span"], gap=v["gap"])
    data["sandwich"]["nonstructural_mass"] = v["nonstructural"]
    data["sandwich"]["core"]["thickness"] = v["core"]
    data["sandwich"]["face"][0]["shear_modulus"] = v["face_shear"]
    data["yoke"].update(length=v["length"], half_width_drive=v["drive"], half_width_panel=v["panel"])
    data["yoke"]["leg"] = {"width": v["leg_width"], "height": v["leg_height"], "wall": v["leg_wall"]}
    data["yoke"]["crossbar"] = {"width": v["bar_width"], "height": v["bar_height"], "wall": v["bar_wall"]}
    root = springs(v["root_translation"], v["root_about_x"], v["root_about_y"], v["about_z"])
    line = springs(v["translation"], v["about_x"], v["about_y"], v["about_z"])
    data["hinges"]["root"] = [hinge(side * v["panel"], root) for side in (-1, 1)]
    stiffer = {**line, "about_y": line["about_y"] * v.get("harness", 1.0)}
    data["hinges"]["between"] = [hinge(-v["position"], line), hinge(v["position"], stiffer)]
    data["offset"] = v.get("offset", 3.2e-3)
    data["mesh"] = mesh
    return validated(ArrayDesign, data)


@cache
def catalog() -> Any:
    data: Any = parse_yaml(catalog_text("reference-array"), "reference-array")
    return data


def springs(translation: float, about_x: float, about_y: float, about_z: float) -> dict[str, float]:
    return {"along_x": translation, "along_y": translation, "along_z": translation,
            "about_x": about_x, "about_y": about_y, "about_z": about_z}  # fmt: skip


def hinge(position: float, stiffness: dict[str, float]) -> dict[str, Any]:
    return {"position": position, "footprint": 0.08, "stiffness": stiffness}


def show(x: np.ndarray, targets: dict[str, tuple[float | None, ...]]) -> None:
    found = by_kind(design_of(x))
    print("  " + ", ".join(f"{name} {value:.4g}" for name, value in zip(RANGES, np.exp(x), strict=True)))
    for kind in "BIT":
        print(f"  {kind} " + " ".join(f"{f:.3f} ({q:.2g})" for f, q in found[kind][:5]), "wanted", targets[kind])
    print(f"  A {[round(f, 2) for f, _ in found['A']]} J {found['J']:.4f}", flush=True)


if __name__ == "__main__":
    main()
