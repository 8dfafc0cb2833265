"""Beams, springs, masses and links against closed forms and the exact dynamic stiffness of a frame."""

import numpy as np
import pytest
from scipy.optimize import brentq
from support.scenarios import in_si

from microvib.structures.array_design import Yoke
from microvib.structures.fem.array_mesh import tube_section
from microvib.structures.fem.assembly import assemble
from microvib.structures.fem.modes import lowest_modes, solve
from microvib.structures.fem.structure import Link, Lump, Mesh, Section, Spring

E, G, RHO = 70e9, 26.3e9, 2700.0


def bar(b=0.03, h=0.02):
    """Solid rectangle; y of the section along the normal."""
    J = b * h**3 * (1 / 3 - 0.21 * h / b * (1 - h**4 / 12 / b**4))  # Roark, h < b
    return Section(E, G, RHO, b * h, I_yy=h * b**3 / 12, I_zz=b * h**3 / 12, J=J)


def cantilever(section, length, size):
    mesh = Mesh()
    ends = mesh.add([(0, 0, 0), (length, 0, 0)])
    mesh.line("beam", tuple(ends), section, size)
    return mesh, ends


def test_a_cantilever_bends_twists_and_stretches():
    section, L = bar(0.012, 0.008), 1.5  # slender: shear and rotary inertia are below 0.1 %
    mesh, _ = cantilever(section, L, 0.05)
    modes = solve(mesh.structure(0), 40)
    m = RHO * section.A
    roots = np.array([1.8751041, 4.6940911, 7.8547574])
    bending = [
        roots**2 / L**2 * np.sqrt(E * second / m) / 2 / np.pi
        for second in (section.I_zz, section.I_yy)
    ]
    twist = np.sqrt(G * section.J / (RHO * (section.I_yy + section.I_zz))) / (4 * L)
    expected = np.sort(np.r_[bending[0], bending[1], twist, np.sqrt(E / RHO) / (4 * L)])
    for f in expected[expected < modes.frequency[-1]]:
        assert np.min(np.abs(modes.frequency / f - 1)) < 2e-3


def test_a_short_beam_shears():
    """Simply supported Timoshenko beam, closed form of both branches."""
    section, L, n = bar(0.04, 0.04), 0.4, 40
    mesh, ends = cantilever(section, L, L / n)
    system = assemble(mesh.structure(0), clamped=False)
    held = np.zeros((n + 1, 6), dtype=bool)
    held[:, [0, 1, 3, 5]] = True
    held[ends, 2] = True
    free = np.flatnonzero(~held.ravel())
    values, _ = lowest_modes(system.K[free][:, free], system.M[free][:, free], 3)
    for k, value in enumerate(values, 1):
        q = k * np.pi / L
        kGA, EI, m, j = 5 / 6 * G * section.A, E * section.I_yy, RHO * section.A, RHO * section.I_yy
        exact = np.roots([m * j, -(m * (EI * q**2 + kGA) + j * kGA * q**2), kGA * EI * q**4]).min()
        assert value == pytest.approx(exact, rel=2e-3)
        assert exact < 0.98 * EI / m * q**4


def dynamic_stiffness(L, EA, EI, m, w, c, s):
    """Exact stiffness of a Bernoulli beam at w [rad/s] with ends (u, v, r) in the plane, turned by (c, s)."""
    a, b = w * np.sqrt(m / EA) * L, L * (m * w**2 / EI) ** 0.25
    k = np.zeros((6, 6))
    axial = EA / L * a / np.sin(a)
    k[np.ix_([0, 3], [0, 3])] = axial * np.array([[np.cos(a), -1], [-1, np.cos(a)]])
    S, C, Sh, Ch = np.sin(b), np.cos(b), np.sinh(b), np.cosh(b)
    d = 1 - C * Ch
    F = EI * b / (d * L) * np.array([
        b**2 / L**2 * (S * Ch + C * Sh), b / L * S * Sh, -(b**2) / L**2 * (S + Sh), b / L * (Ch - C), S * Ch - C * Sh, Sh - S,
    ])  # fmt: skip
    t, u, v, x, p, q = F
    k[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = [
        [t, u, v, x],
        [u, p, -x, q],
        [v, -x, t, -u],
        [x, q, -u, p],
    ]
    R = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return R.T @ k @ R


def test_a_frame_of_two_beams():
    """An L of two beams, clamped at one foot; in its plane the exact dynamic stiffness is singular at the frequencies."""
    section, L1, L2 = bar(0.01, 0.01), 1.0, 0.7
    mesh = Mesh()
    nodes = mesh.add([(0, 0, 0), (L1, 0, 0), (L1, L2, 0)])
    mesh.line("post", (nodes[0], nodes[1]), section, 0.02)
    mesh.line("arm", (nodes[1], nodes[2]), section, 0.02)
    modes = solve(mesh.structure(0), 12)
    EA, EI, m = E * section.A, E * section.I_yy, RHO * section.A

    def determinant(f):
        w = 2 * np.pi * f
        K = np.zeros((6, 6))
        K[:3, :3] += dynamic_stiffness(L1, EA, EI, m, w, 1, 0)[3:, 3:]
        K += dynamic_stiffness(L2, EA, EI, m, w, 0, 1)
        return np.linalg.det(K / EI)

    grid = np.linspace(1.0, 80.0, 600)
    values = np.array([determinant(f) for f in grid])
    cross = np.flatnonzero(np.diff(np.sign(values)) != 0)
    roots = np.array([brentq(determinant, grid[k], grid[k + 1]) for k in cross])
    roots = [f for f in roots if abs(determinant(f)) < 1e-3 * np.abs(values).max()][:3]
    in_plane = modes.frequency[(modes.shapes[:, 1] ** 2).sum(0) > (modes.shapes[:, 2] ** 2).sum(0)]
    assert len(roots) == 3
    np.testing.assert_allclose(in_plane[:3], roots, rtol=2e-3)


def test_a_mass_on_six_springs():
    """Each direction is an oscillator of its own; the link carries the mass away from the spring."""
    mesh = Mesh()
    a, b, c = (int(mesh.add(p)[0]) for p in [(0, 0, 0), (0, 0, 0), (0.5, 0, 0)])
    k = (1e4, 2e4, 3e4, 100.0, 200.0, 300.0)
    mesh.parts += [
        Spring("hub", (a, b), k),
        Link("arm", b, np.array([c])),
        Lump("tip", c, 2.0, (0.1, 0.2, 0.3)),
    ]
    mesh.parts.append(Lump("hub mass", b, 1.0, (0.05, 0.05, 0.05)))
    structure = mesh.structure(a)
    modes = solve(structure, 4)
    f_x, f_twist = np.sqrt(1e4 / 3.0) / 2 / np.pi, np.sqrt(100.0 / 0.15) / 2 / np.pi
    for f in (f_x, f_twist):
        assert np.min(np.abs(modes.frequency / f - 1)) < 1e-9
    assert modes.mass[4, 4] == pytest.approx(0.05 + 0.2 + 2.0 * 0.25)
    assert modes.mass[1, 5] == pytest.approx(2.0 * 0.5)


def test_rigid_body_mass_of_a_beam_is_exact():
    section, L = bar(), 2.0
    mesh, _ = cantilever(section, L, 0.3)
    mass = solve(mesh.structure(0), 3).mass
    m = RHO * section.A * L
    expected = np.diag(
        [
            m,
            m,
            m,
            RHO * L * (section.I_yy + section.I_zz),
            m * L**2 / 3 + RHO * section.I_zz * L,
            m * L**2 / 3 + RHO * section.I_yy * L,
        ]
    )
    expected[1, 5] = expected[5, 1] = m * L / 2
    expected[2, 4] = expected[4, 2] = -m * L / 2
    np.testing.assert_allclose(mass, expected, rtol=1e-9, atol=1e-9 * m)


def test_the_section_of_a_tube():
    """A thin square tube: A = 4 b t, I = 2/3 b^3 t, J = b^3 t with b of the mid-line."""
    tube = {"width": 0.03, "height": 0.03, "wall": 1e-4}
    yoke = in_si(Yoke, length=1, half_width_drive=0.1, half_width_panel=0.2, leg=tube,
                crossbar=tube, modulus=E, poisson=0.33, density=RHO)  # fmt: skip
    s = tube_section(yoke.leg, yoke)
    b, t = 0.03 - 1e-4, 1e-4
    assert (s.A, s.I_yy, s.I_zz, s.J) == pytest.approx(
        (4 * b * t, 2 / 3 * b**3 * t, 2 / 3 * b**3 * t, b**3 * t), rel=1e-4
    )
