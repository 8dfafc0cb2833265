"""Shells against closed forms and a Ritz solution of plate theory that shares nothing with finite elements."""

import functools
import itertools

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.polynomial import polynomial as poly
from pyfe3d.shellprop_utils import isotropic_plate, laminated_plate
from scipy.linalg import eigh

from microvib.structures.fem.assembly import assemble
from microvib.structures.fem.modes import lowest_modes
from microvib.structures.fem.structure import Mesh

A, B = 1.2, 0.9
EDGES = {"free": (0, 0), "clamped": (2, 2), "cantilever": (2, 0)}


def thin(h=2e-3):
    return isotropic_plate(h, 70e9, 0.3, rho=2700.0)


def sandwich(G=10e6):
    """Cells, CFRP faces and a core so soft that shear rules."""
    face, core = (62e9, 62e9, 0.05, 5.5e9, 5.5e9, 5.5e9), (1e3, 1e3, 0.0, 5e2, 2.0 * G, G)
    return laminated_plate(
        [0, 0, 0], plyts=[2e-4, 25e-3, 2e-4], laminaprops=[face, core, face], rhos=[1550, 32, 1550]
    )


def angle_ply():
    ply = (140e9, 9e9, 0.3, 5e9, 5e9, 5e9)
    return laminated_plate([30, 30, 30, 30], plyt=0.5e-3, laminaprop=ply, rho=1600.0)


def frequencies(laminate, edges, nx, ny, count, only_bending=True):
    """Lowest frequencies [Hz] of an A x B plate; membrane motion held where only bending is wanted."""
    mesh = Mesh()
    x, y = np.linspace(0, A, nx + 1), np.linspace(0, B, ny + 1)
    _, xyz = mesh.rectangle("plate", x, y, 0.0, laminate)
    system = assemble(mesh.structure(0), clamped=False)
    held = np.zeros((len(xyz), 6), dtype=bool)
    held[:, [0, 1, 5]] = only_bending
    ends_x, ends_y = np.isin(xyz[:, 0], x[[0, -1]]), np.isin(xyz[:, 1], y[[0, -1]])
    if edges == "supported":
        held[ends_x | ends_y, 2] = held[ends_x, 3] = held[ends_y, 4] = True
    elif edges == "clamped":
        held[ends_x | ends_y] = True
    elif edges == "cantilever":
        held[xyz[:, 0] == 0.0] = True
    free = np.flatnonzero(~held.ravel())
    values, _ = lowest_modes(system.K[free][:, free], system.M[free][:, free], count)
    return np.sqrt(np.abs(values)) / 2 / np.pi


def navier(p, count):
    """First-order shear theory of a simply supported orthotropic plate; closed form for each pair of half waves."""

    def one(m, n):
        a, b = m * np.pi / A, n * np.pi / B
        K = [
            [p.A55 * a**2 + p.A44 * b**2, p.A55 * a, p.A44 * b],
            [p.A55 * a, p.D11 * a**2 + p.D66 * b**2 + p.A55, (p.D12 + p.D66) * a * b],
            [p.A44 * b, (p.D12 + p.D66) * a * b, p.D66 * a**2 + p.D22 * b**2 + p.A44],
        ]
        return (
            np.sqrt(eigh(K, np.diag([p.intrho, p.intrhoz2, p.intrhoz2]), eigvals_only=True)[0])
            / 2
            / np.pi
        )

    return np.sort([one(m, n) for m, n in itertools.product(range(1, 8), repeat=2)])[:count]


def kirchhoff(p, count):
    m, n = np.meshgrid(np.arange(1, 8), np.arange(1, 8))
    return np.sort((np.pi / 2 * (m**2 / A**2 + n**2 / B**2) * np.sqrt(p.D11 / p.intrho)).ravel())[
        :count
    ]


@functools.cache
def basis(low, high, order=13):
    """Integrals on [-1, 1] of products of derivatives of (1+s)^low (1-s)^high times Legendre polynomials."""
    edge = poly.polymul(poly.polypow([1, 1], low), poly.polypow([1, -1], high))
    f = [poly.polymul(edge, legendre.leg2poly([0] * k + [1])) for k in range(order)]
    d = [f, [poly.polyder(c) for c in f], [poly.polyder(c, 2) for c in f]]
    s, w = legendre.leggauss(40)
    v = [np.array([poly.polyval(s, c) for c in row]) for row in d]
    return {(i, j): (v[i] * w) @ v[j].T for i in range(3) for j in range(3)}


def ritz(p, edges_x, edges_y, count, a=A, b=B):
    """Kirchhoff plate with any bending stiffness, D16 and D26 included, in Legendre polynomials."""
    X, Y = basis(*edges_x), basis(*edges_y)
    sx, sy = 2 / a, 2 / b

    def term(i, j, k, m):  # integral of d^i/dx d^j/dy f times d^k/dx d^m/dy f
        return np.kron(X[i, k], Y[j, m]) * sx ** (i + k) * sy ** (j + m)

    xx, yy, xy = (2, 0), (0, 2), (1, 1)
    D = {(xx, xx): p.D11, (yy, yy): p.D22, (xy, xy): 4 * p.D66}
    D |= {(xx, yy): p.D12, (yy, xx): p.D12, (xx, xy): 2 * p.D16, (xy, xx): 2 * p.D16}
    D |= {(yy, xy): 2 * p.D26, (xy, yy): 2 * p.D26}
    K = sum(d * term(*one, *two) for (one, two), d in D.items())
    M = p.intrho * term(0, 0, 0, 0)
    return np.sqrt(np.abs(eigh(K, M, eigvals_only=True)[:count])) / 2 / np.pi


def test_the_ritz_solution_against_tabulated_plates():
    """Leissa's square clamped plate 35.99, and his completely free one at 13.47 (three digits)."""
    p = thin()
    scale = 2 * np.pi * A**2 * np.sqrt(p.intrho / p.D11)
    for edges, k, tabulated in (((2, 2), 0, 35.985), ((0, 0), 3, 13.468)):
        assert ritz(p, edges, edges, 6, A, A)[k] * scale == pytest.approx(tabulated, rel=2e-4)


@pytest.mark.parametrize("kind", ["supported", "clamped", "cantilever"])
def test_a_thin_plate(kind):
    p = thin()
    edges_y = (2, 2) if kind == "clamped" else (0, 0)
    reference = kirchhoff(p, 5) if kind == "supported" else ritz(p, EDGES[kind], edges_y, 5)
    np.testing.assert_allclose(frequencies(p, kind, 48, 36, 5), reference, rtol=0.012)


@pytest.mark.parametrize(
    "laminate", [thin(), sandwich(), angle_ply()], ids=["thin", "sandwich", "angle-ply"]
)
def test_a_free_plate_has_six_zero_modes(laminate):
    f = frequencies(laminate, "free", 16, 12, 8, only_bending=False)
    assert np.all(f[:6] < 1e-3 * f[6])
    assert f[6] > 1.0


def test_a_free_thin_plate():
    reference = ritz(thin(), (0, 0), (0, 0), 9)[3:]
    np.testing.assert_allclose(
        frequencies(thin(), "free", 40, 30, 12, False)[6:], reference, rtol=0.01
    )


@pytest.mark.parametrize("G", [1e6, 10e6, 95e6])
def test_a_sandwich_whose_core_shears(G):
    p = sandwich(G)
    np.testing.assert_allclose(p.A44, G * 25.2e-3**2 / 25e-3, rtol=2e-2)  # thin faces: G d^2/t
    reference = navier(p, 4)
    np.testing.assert_allclose(frequencies(p, "supported", 48, 36, 4), reference, rtol=0.006)
    assert reference[0] < 0.98 * np.pi / 2 * (A**-2 + B**-2) * np.sqrt(
        p.D11 / p.intrho
    )  # shear is seen


def test_bending_twist_coupling_of_a_laminate():
    p = angle_ply()
    assert p.D16 > 0.3 * p.D11
    reference = ritz(p, EDGES["cantilever"], (0, 0), 5)
    np.testing.assert_allclose(frequencies(p, "cantilever", 48, 36, 5), reference, rtol=0.012)
    p.D16 = p.D26 = 0.0
    assert abs(ritz(p, EDGES["cantilever"], (0, 0), 5)[0] / reference[0] - 1) > 0.1


@pytest.mark.parametrize(
    ("laminate", "reference"), [(thin(), kirchhoff(thin(), 3)), (sandwich(), navier(sandwich(), 3))]
)
def test_the_mesh_converges_with_the_second_order(laminate, reference):
    errors = [frequencies(laminate, "supported", n, n, 3) / reference - 1 for n in (12, 24, 48)]
    order = np.log2((errors[0] - errors[1]) / (errors[1] - errors[2]))
    np.testing.assert_allclose(order, 2.0, atol=0.15)
