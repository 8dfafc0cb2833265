"""A drive with its array on a free hub, written again in untransformed coordinates: nothing here
comes from microvib.

Coordinates are displacement and rotation of the hub's centre of mass, the hub's flexible modes, the
array's fixed-interface modes, and the angles of shaft and rotor against the hub. The drive has
viscous friction only, so that nothing sticks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

ARRAY_MASS, ARRAY_CENTER = 36.15, np.array([0.04, 0.02, 3.2])
ARRAY_INERTIA = np.array([[420.0, 1.5, -4.0], [1.5, 430.0, -2.2], [-4.0, -2.2, 12.2]])
FREQUENCIES = np.array([0.45, 1.19, 3.1, 8.7])
DAMPING = np.array([0.004, 0.01, 0.006, 0.005])
PARTICIPATION = np.array(
    [  # columns are modes; Fx Fy Fz Mx My Mz, drive axis z
        [0.3, 0.1, 1.9, -0.2],
        [4.4, -0.1, -0.3, 1.3],
        [0.05, 0.02, 0.1, 0.4],
        [-16.0, 0.3, 1.1, -2.5],
        [0.8, -0.4, 11.5, 0.9],
        [0.12, 3.35, -0.25, 0.35],
    ]
)
HUB_MASS = 420.0
HUB_INERTIA = np.array([[180.0, 4.0, -6.0], [4.0, 150.0, 3.0], [-6.0, 3.0, 210.0]])
PLACE = np.array([0.35, 0.9, -0.2])
AXIS = np.array([0.0, 1.0, 0.0])
REFERENCE = np.array([1.0, 0.0, 0.0])


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """Matrix of the product v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@dataclass
class FullCraft:
    """The whole system, M x'' + C x' + K x = loads of the drive, with ``flexible`` hub modes
    (frequency, damping, shape).
    """

    angle: float = math.radians(30.0)
    axis: np.ndarray = field(default_factory=lambda: AXIS)
    reference: np.ndarray = field(default_factory=lambda: REFERENCE)
    hub_scale: float = 1.0
    bandwidth: float = 0.0
    control_damping: float = 0.7
    flexible: list[tuple[float, float, np.ndarray]] = field(default_factory=list)
    damping: np.ndarray = field(default_factory=lambda: DAMPING)
    ratio: float = 100.0
    stiffness: float = 8400.0
    gear_damping: float = 5.0
    rotor_inertia: float = 0.252e-4
    output_inertia: float = 0.01
    on_rotor: float = 0.0255
    on_output: float = 0.05
    teeth: int = 50
    torque_constant: float = 0.3
    detent: float = 0.01
    resistance: float = 6.0
    inductance: float = 13e-3
    gain: float = 500.0
    integral: float = 6000.0
    current: float = 0.6
    rate: float = math.radians(0.06)
    microsteps: int = 16

    def __post_init__(self) -> None:
        c, s = math.cos(self.angle), math.sin(self.angle)
        first = c * self.reference + s * np.cross(self.axis, self.reference)
        turn = np.column_stack(
            [first, np.cross(self.axis, first), self.axis]
        )  # array axes x, y, z in hub axes
        centre, about_root = turn @ ARRAY_CENTER, turn @ ARRAY_INERTIA @ turn.T
        P = np.vstack([turn @ PARTICIPATION[:3], turn @ PARTICIPATION[3:]])
        m, nf, s = ARRAY_MASS, len(self.flexible), P.shape[1]
        self.n_q = 6 + nf
        n = self.n_q + s + 2
        root = np.zeros((6, self.n_q))
        root[:3, :3], root[:3, 3:6], root[3:, 3:6] = np.eye(3), -cross_matrix(PLACE), np.eye(3)
        for k, (_, _, shape) in enumerate(self.flexible, 6):
            root[:, k] = shape
        # velocities of root (6), modes and shaft by the coordinates; the array's kinetic energy is
        # a quadratic form in them
        at_root = np.zeros((6, n))
        at_root[:, : self.n_q] = root
        at_root[3:, n - 2] = self.axis
        modes = np.zeros((s, n))
        modes[:, self.n_q : self.n_q + s] = np.eye(s)
        rigid = np.block(
            [[m * np.eye(3), -m * cross_matrix(centre)], [m * cross_matrix(centre), about_root]]
        )
        output, rotor = self.axis @ at_root[3:], np.zeros(n)
        rotor[:6], rotor[n - 1] = np.r_[0.0, 0.0, 0.0, self.axis], 1.0
        rotor[6 : self.n_q] = self.axis @ root[3:, 6:]
        self.M = np.zeros((n, n))
        self.M[:3, :3], self.M[3:6, 3:6] = (
            self.hub_scale * HUB_MASS * np.eye(3),
            self.hub_scale * HUB_INERTIA,
        )
        self.M[6 : self.n_q, 6 : self.n_q] = np.eye(nf)
        self.hub_M = self.M.copy()
        self.M += (
            at_root.T @ rigid @ at_root
            + modes.T @ modes
            + at_root.T @ P @ modes
            + modes.T @ P.T @ at_root
        )
        self.M += self.output_inertia * np.outer(output, output) + self.rotor_inertia * np.outer(
            rotor, rotor
        )
        self.K, self.C = np.zeros((n, n)), np.zeros((n, n))
        for k, (f, xi, _) in enumerate(self.flexible, 6):
            self.K[k, k], self.C[k, k] = (2 * math.pi * f) ** 2, 4 * math.pi * f * xi
        for k, (f, xi) in enumerate(zip(FREQUENCIES, self.damping, strict=True), self.n_q):
            self.K[k, k], self.C[k, k] = (2 * math.pi * f) ** 2, 4 * math.pi * f * xi
        w, held = 2 * math.pi * self.bandwidth, self.hub_scale * HUB_INERTIA
        self.K[3:6, 3:6] += w**2 * held
        self.C[3:6, 3:6] += 2 * self.control_damping * w * held
        self.invM, self.n, self.root = np.linalg.inv(self.M), n, root

    def torques(self, x: np.ndarray, v: np.ndarray, i_A: float, i_B: float) -> tuple[float, float]:
        """Torques on output and rotor, both against the hub."""
        theta_l, theta_m, omega_l, omega_m = x[-2], x[-1], v[-2], v[-1]
        phase = self.teeth * theta_m
        T_e = self.torque_constant * (
            i_B * math.cos(phase) - i_A * math.sin(phase)
        ) - self.detent * math.sin(4 * phase)
        T_g = self.stiffness * (-theta_m / self.ratio - theta_l) + self.gear_damping * (
            -omega_m / self.ratio - omega_l
        )
        return T_g - self.on_output * omega_l, T_e - self.on_rotor * omega_m + T_g / self.ratio

    def accelerations(self, y: np.ndarray) -> np.ndarray:
        """Second derivatives of the coordinates."""
        n = self.n
        x, v = y[:n], y[n : 2 * n]
        loads = -self.K @ x - self.C @ v
        on_output, on_rotor = self.torques(x, v, y[2 * n], y[2 * n + 1])
        loads[-2] += on_output
        loads[-1] += on_rotor
        return self.invM @ loads

    def derivative(self, y: np.ndarray, ref: tuple[float, float]) -> np.ndarray:
        """Of coordinates, rates, currents and integrals."""
        n = self.n
        v, i_A, i_B, x_A, x_B = y[n : 2 * n], *y[2 * n :]
        phase, omega_m = self.teeth * y[n - 1], v[-1]
        u_A, u_B = (
            self.gain * (r - i) + self.integral * x
            for r, i, x in zip(ref, (i_A, i_B), (x_A, x_B), strict=True)
        )
        e_A, e_B = (self.torque_constant * omega_m * g for g in (math.sin(phase), -math.cos(phase)))
        di_A, di_B = (
            (u_A - self.resistance * i_A + e_A) / self.inductance,
            (u_B - self.resistance * i_B + e_B) / self.inductance,
        )
        return np.concatenate([v, self.accelerations(y), [di_A, di_B, ref[0] - i_A, ref[1] - i_B]])

    def run(self, times: np.ndarray) -> np.ndarray:
        """States (len(times), ...) at ``times`` from rest, with the command's staircase."""
        full = 2 * math.pi / (4 * self.teeth)
        f_d = self.microsteps * self.ratio * self.rate / full
        jumps = (np.arange(int(f_d * times[-1]) + 2) + 0.5) / f_d
        y = np.zeros(2 * self.n + 4)
        y[2 * self.n], y[2 * self.n + 2] = (
            self.current,
            self.resistance * self.current / self.integral,
        )
        now, rows, k = 0.0, [], 0
        for stop in sorted({*times.tolist(), *(t for t in jumps if t < times[-1])}):
            angle = -k * 2 * math.pi / (4 * self.microsteps)
            ref = self.current * math.cos(angle), self.current * math.sin(angle)
            if stop > now:
                solved = solve_ivp(
                    lambda _, z, r=ref: self.derivative(z, r),
                    (now, stop),
                    y,
                    "DOP853",
                    rtol=1e-10,
                    atol=1e-14,
                )
                y, now = solved.y[:, -1], stop
            if stop in jumps:
                k += 1
            if stop in times:
                rows.append(y.copy())
        return np.array(rows)

    def hub_loads(self, y: np.ndarray) -> np.ndarray:
        """Load on the rigid hub at the interface, from the hub's own momentum and control torque."""
        n, a = self.n, self.accelerations(y)
        assert not self.flexible
        on_centre = (self.hub_M @ a + self.K @ y[:n] + self.C @ y[n : 2 * n])[:6]
        force = on_centre[:3]
        return np.concatenate([force, on_centre[3:] - np.cross(PLACE, force)])

    def momentum(self, y: np.ndarray) -> np.ndarray:
        """Linear and angular momentum of everything about the hub's centre of mass, for small
        motions.
        """
        return (self.M @ y[self.n : 2 * self.n])[:6]

    def powered(self) -> np.ndarray:
        """Stiffness and damping with the powered drive on the two shafts: the rotor's magnetic
        spring, the gear, frictions.
        """
        n, gear = self.n, np.array([-1.0, -1.0 / self.ratio])
        K, C = self.K.copy(), self.C.copy()
        K[n - 2 :, n - 2 :] += self.stiffness * np.outer(gear, gear)
        K[n - 1, n - 1] += self.teeth * self.torque_constant * self.current
        C[n - 2 :, n - 2 :] += self.gear_damping * np.outer(gear, gear) + np.diag(
            [self.on_output, self.on_rotor]
        )
        return np.array([K, C])
