"""What finite elements of the reference array cost, with several sparse factorisations; and which
shells of pyfe3d pass.

    python benchmarks/fem.py [--mesh 0.0315 0.015] [--solvers qdldl superlu ...]
    python benchmarks/fem.py --elements

Each solver runs in a process of its own, so that its peak memory is its own. Solvers that are not
installed are left out.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Solve = Callable[[np.ndarray], np.ndarray]


def microvib(A: Any) -> Solve:
    """SuperLU told that the matrix is symmetric, as microvib calls it."""
    from microvib.structures.fem.modes import factorise

    solve: Solve = factorise(A)
    return solve


def qdldl(A: Any) -> Solve:
    from qdldl import Solver

    solve: Solve = Solver(A).solve
    return solve


def superlu(A: Any) -> Solve:
    from scipy.sparse.linalg import splu

    solve: Solve = splu(A).solve
    return solve


def cholespy(A: Any) -> Solve:
    from cholespy import CholeskySolverD, MatrixType

    A = A.tocoo()
    factor = CholeskySolverD(A.shape[0], A.row, A.col, A.data, MatrixType.COO)

    def solve(b: np.ndarray) -> np.ndarray:
        x = np.zeros_like(b)
        factor.solve(np.ascontiguousarray(b), x)
        return x

    return solve


def pardiso(A: Any) -> Solve:
    import pypardiso
    import scipy.sparse as sp

    solver = pypardiso.PyPardisoSolver(mtype=2)  # real, symmetric positive definite: upper triangle
    upper = sp.triu(A, format="csr")
    solver.factorize(upper)
    return lambda b: solver.solve(upper, b)


HEADER = "\nsolver                  dof  assemble   factor    eigen  total s    CPU s  / ours     GB  f3, f20 [Hz]"
SOLVERS = {f.__name__: f for f in (microvib, superlu, qdldl, cholespy, pardiso)}


def one(name: str, mesh: float, count: int = 20) -> dict[str, Any]:
    """Seconds and peak memory of the lowest modes of the reference array on one mesh."""
    from scipy.sparse.linalg import LinearOperator, eigsh

    from microvib.io.modal_sources import load_design
    from microvib.structures.fem.array_mesh import structure_of
    from microvib.structures.fem.assembly import assemble
    from microvib.structures.fem.modes import SHIFT

    design = load_design("reference-array").model_copy(update={"mesh": mesh})
    times, cpu = [time.perf_counter()], time.process_time()
    system = assemble(structure_of(design))
    times.append(time.perf_counter())
    solve = SOLVERS[name](system.K + SHIFT**2 * system.M)
    times.append(time.perf_counter())
    m = system.K.shape[0]
    operator = LinearOperator((m, m), matvec=solve, dtype=float)
    start = np.random.default_rng(1).standard_normal(m)
    values, _ = eigsh(system.K, count, system.M, sigma=-(SHIFT**2), OPinv=operator, v0=start)
    times.append(time.perf_counter())
    f = np.sqrt(np.sort(values)) / 2 / np.pi
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    parts = np.diff(times).tolist()
    return {
        "dof": m,
        "parts": parts,
        "cpu": time.process_time() - cpu,
        "GB": peak,
        "f3": float(f[2]),
        "f20": float(f[-1]),
    }


def solvers(meshes: list[float], names: list[str]) -> None:
    for mesh in meshes:
        print(HEADER)
        first = None
        for name in names:
            command = [sys.executable, __file__, "--one", name, "--mesh", str(mesh)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                print(f"{name:18s} left out: {done.stderr.strip().splitlines()[-1][:90]}")
                continue
            r = json.loads(done.stdout)
            first = first or r["cpu"]
            seconds = (*r["parts"], sum(r["parts"]), r["cpu"], r["cpu"] / first)
            print(f"{name:18s} {r['dof']:8d} {seconds[0]:9.2f} " + " ".join(f"{s:8.2f}" for s in seconds[1:])
                  + f" {r['GB']:6.2f}  {r['f3']:.5f}, {r['f20']:.5f}", flush=True)  # fmt: skip


def elements() -> None:
    """First frequency of a simply supported plate over theory, and modes below 1e-3 of the first
    elastic one when free.
    """
    import pyfe3d
    from pyfe3d.shellprop_utils import isotropic_plate

    p = isotropic_plate(1e-3, 70e9, 0.3, rho=2700.0)
    print(
        "thin square plate, n by n; error of the first supported frequency [%], and modes without stiffness when free (six)"
    )
    for name in ("Quad4", "Quad4R", "Tria3R", "Tria3DSG"):
        element, data, probe = (getattr(pyfe3d, name + part) for part in ("", "Data", "Probe"))
        errors, zero = zip(
            *(plate(element, data(), probe(), n, p) for n in (8, 16, 32)), strict=True
        )
        print(f"{name:9s} " + "  ".join(f"{n:2d}: {100 * e:+7.2f}" for n, e in zip((8, 16, 32), errors, strict=True))
              + f"   {zero[0]} zero modes")  # fmt: skip


def plate(element: Any, data: Any, probe: Any, n: int, p: Any) -> tuple[float, int]:
    import scipy.sparse as sp
    from pyfe3d import DOUBLE, INT

    from microvib.structures.fem.modes import lowest_modes

    x = np.linspace(0.0, 1.0, n + 1)
    xyz = np.array([(a, b, 0.0) for a in x for b in x])
    grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.column_stack(
        [c.ravel() for c in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])]
    )
    corners = (
        quads
        if hasattr(element, "n4")
        else np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    )
    sizes = (data.KC0_SPARSE_SIZE, data.M_SPARSE_SIZE)
    K, M = ([np.zeros(s * len(corners), t) for t in (INT, INT, DOUBLE)] for s in sizes)
    for k, nodes in enumerate(corners):
        e = element(probe)
        for i, node in enumerate(nodes, 1):
            setattr(e, f"n{i}", node)
            setattr(e, f"c{i}", 6 * node)
        e.init_k_KC0, e.init_k_M = k * sizes[0], k * sizes[1]
        e.update_rotation_matrix(xyz.ravel(), 1.0, 0.0, 0.0)
        e.update_probe_xe(xyz.ravel())
        e.update_KC0(*K, p)
        e.update_M(*M, p)
    size = 6 * len(xyz)
    K, M = (sp.coo_array((v, (r, c)), shape=(size, size)).tocsc() for r, c, v in (K, M))
    held = np.zeros((len(xyz), 6), dtype=bool)
    ends_x, ends_y = np.isin(xyz[:, 0], (0.0, 1.0)), np.isin(xyz[:, 1], (0.0, 1.0))
    held[:, [0, 1, 5]] = True
    held[ends_x | ends_y, 2] = held[ends_x, 3] = held[ends_y, 4] = True
    free = np.flatnonzero(~held.ravel())
    value = lowest_modes(K[free][:, free], M[free][:, free], 1)[0][0]
    theory = 2.0 * np.pi**2 * np.sqrt(p.D11 / p.intrho)
    loose = lowest_modes(K, M, 10)[0]
    return float(np.sqrt(value) / theory - 1.0), int(np.sum(np.abs(loose) < 1e-6 * loose[-1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=float, nargs="+", default=[0.0315, 0.015])
    parser.add_argument("--solvers", nargs="+", choices=list(SOLVERS), default=list(SOLVERS))
    parser.add_argument("--elements", action="store_true")
    parser.add_argument("--one", choices=list(SOLVERS))
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one(options.one, options.mesh[0])))
    elif options.elements:
        elements()
    else:
        solvers(options.mesh, options.solvers)


if __name__ == "__main__":
    main()
