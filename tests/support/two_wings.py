"""Two drives with their arrays on one free hub, in untransformed coordinates and in one system:
nothing here comes from microvib.

Coordinates are displacement and rotation of the hub's centre of mass, both arrays' fixed-interface
modes, and shaft and rotor of both drives against the hub. Hub, arrays and drives are those of
``support.craft``, with viscous friction only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

from support import craft as whole


@dataclass
class Wing:
    """One drive with its array: where it sits, at which angle [rad], and how it steps."""

    place: np.ndarray
    axis: np.ndarray
    reference: np.ndarray
    angle: float
    rate: float
    """Of the array about ``axis`` [rad/s]; 0 holds."""
    late: float = 0.0
    """Microsteps by which it steps later."""
    drive: whole.FullCraft = field(default_factory=whole.FullCraft)
    """Its parameters."""

    @property
    def jumps_per_second(self) -> float:
        """Microsteps per second."""
        d = self.drive
        return d.microsteps * d.ratio * abs(self.rate) * 4 * d.teeth / (2 * math.pi)

    def reference_currents(self, t: float) -> tuple[float, float]:
        """At the time ``t`` [s], from rest."""
        k = max(math.floor(self.jumps_per_second * t + 0.5 - self.late), 0)
        angle = -math.copysign(k * 2 * math.pi / (4 * self.drive.microsteps), self.rate)
        return self.drive.current * math.cos(angle), self.drive.current * math.sin(angle)


class BothDrives:
    """The whole system, M x'' + C x' + K x = torques of both motors."""

    def __init__(
        self, wings: tuple[Wing, Wing], bandwidth: float = 0.0, control_damping: float = 0.7
    ) -> None:
        s, n = len(whole.FREQUENCIES), 6 + 2 * len(whole.FREQUENCIES) + 4
        self.wings, self.n = wings, n
        self.M, self.K, self.C = (np.zeros((n, n)) for _ in range(3))
        self.M[:3, :3], self.M[3:6, 3:6] = whole.HUB_MASS * np.eye(3), whole.HUB_INERTIA
        w = 2 * math.pi * bandwidth
        self.K[3:6, 3:6], self.C[3:6, 3:6] = (
            w**2 * whole.HUB_INERTIA,
            2 * control_damping * w * whole.HUB_INERTIA,
        )
        self.part: list[np.ndarray] = []
        for k, wing in enumerate(wings):
            d, c, sin = wing.drive, math.cos(wing.angle), math.sin(wing.angle)
            first = c * wing.reference + sin * np.cross(wing.axis, wing.reference)
            turn = np.column_stack([first, np.cross(wing.axis, first), wing.axis])
            centre = whole.cross_matrix(turn @ whole.ARRAY_CENTER)
            m, about = whole.ARRAY_MASS, turn @ whole.ARRAY_INERTIA @ turn.T
            P = np.vstack([turn @ whole.PARTICIPATION[:3], turn @ whole.PARTICIPATION[3:]])
            modes, out, r = slice(6 + k * s, 6 + (k + 1) * s), n - 4 + 2 * k, n - 3 + 2 * k
            root = np.zeros((6, n))
            root[:3, :3], root[:3, 3:6], root[3:, 3:6] = (
                np.eye(3),
                -whole.cross_matrix(wing.place),
                np.eye(3),
            )
            root[3:, out] = wing.axis
            eta = np.eye(n)[modes]
            rigid = np.block([[m * np.eye(3), -m * centre], [m * centre, about]])
            rotor = np.eye(n)[r] + np.r_[np.zeros(3), wing.axis, np.zeros(n - 6)]
            part = root.T @ rigid @ root + eta.T @ eta + root.T @ P @ eta + eta.T @ P.T @ root
            output = wing.axis @ root[3:]
            part += d.output_inertia * np.outer(output, output) + d.rotor_inertia * np.outer(
                rotor, rotor
            )
            self.part.append(part)
            self.M += part
            for j, (f, xi) in enumerate(
                zip(whole.FREQUENCIES, d.damping, strict=True), modes.start
            ):
                self.K[j, j], self.C[j, j] = (2 * math.pi * f) ** 2, 4 * math.pi * f * xi
            gear = -np.eye(n)[r] / d.ratio - np.eye(n)[out]
            self.K += d.stiffness * np.outer(gear, gear)
            self.C += d.gear_damping * np.outer(gear, gear)
            self.C[out, out] += d.on_output
            self.C[r, r] += d.on_rotor
        self.rotors = [n - 3, n - 1]
        self.A = -np.linalg.solve(self.M, np.hstack([self.K, self.C]))
        self.by_torque = np.linalg.inv(self.M)[:, self.rotors]

    def torques(self, y: np.ndarray) -> np.ndarray:
        """Of both motors at their rotors, with the currents of state ``y``."""
        found = []
        for k, wing in enumerate(self.wings):
            d, phase = wing.drive, wing.drive.teeth * y[self.rotors[k]]
            i_A, i_B = y[2 * self.n + 4 * k : 2 * self.n + 4 * k + 2]
            T_e = d.torque_constant * (i_B * math.cos(phase) - i_A * math.sin(phase))
            found.append(T_e - d.detent * math.sin(4 * phase))
        return np.array(found)

    def accelerations(self, y: np.ndarray) -> np.ndarray:
        """Second derivatives of the coordinates."""
        return np.asarray(self.A @ y[: 2 * self.n] + self.by_torque @ self.torques(y))

    @property
    def springs(self) -> np.ndarray:
        """Stiffness with both drives' electromagnetic springs, (n, n): currents that do not change,
        no detent torque.
        """
        K = self.K.copy()
        for k, wing in zip(self.rotors, self.wings, strict=True):
            K[k, k] += wing.drive.teeth * wing.drive.torque_constant * wing.drive.current
        return K

    def derivative(self, y: np.ndarray, references: list[tuple[float, float]]) -> np.ndarray:
        """Of coordinates, rates, and currents and integrals of both drives."""
        n, out = self.n, np.empty_like(y)
        out[:n], out[n : 2 * n] = y[n : 2 * n], self.accelerations(y)
        for k, (wing, ref) in enumerate(zip(self.wings, references, strict=True)):
            d, at = wing.drive, 2 * n + 4 * k
            phase, rate = d.teeth * y[self.rotors[k]], y[n + self.rotors[k]]
            for j, gain in enumerate((math.sin(phase), -math.cos(phase))):
                i, x = y[at + j], y[at + 2 + j]
                u = d.gain * (ref[j] - i) + d.integral * x
                out[at + j] = (
                    u - d.resistance * i + d.torque_constant * rate * gain
                ) / d.inductance
                out[at + 2 + j] = ref[j] - i
        return out

    def run(self, times: np.ndarray, rtol: float = 1e-8) -> np.ndarray:
        """States (len(times), ...) at ``times`` from rest, with both commands' staircases."""
        y = np.zeros(2 * self.n + 8)
        for k, wing in enumerate(self.wings):
            d, at = wing.drive, 2 * self.n + 4 * k
            y[at], y[at + 2] = d.current, d.resistance * d.current / d.integral
        jumps = [
            (np.arange(int(w.jumps_per_second * times[-1]) + 2) + 0.5 + w.late) / w.jumps_per_second
            for w in self.wings
            if w.rate
        ]
        stops = sorted(
            {*times.tolist(), *(t for each in jumps for t in each.tolist() if t < times[-1])}
        )
        now, rows, wanted = 0.0, [], set(times.tolist())
        for stop in stops:
            if stop - now > 1e-12:
                refs = [wing.reference_currents(0.5 * (now + stop)) for wing in self.wings]
                solved = solve_ivp(
                    lambda _, z, r=refs: self.derivative(z, r),
                    (now, stop),
                    y,
                    "LSODA",
                    rtol=rtol,
                    atol=1e-13,
                )
                y, now = solved.y[:, -1], stop
            if stop in wanted:
                rows.append(y.copy())
        return np.array(rows)

    def loads(self, y: np.ndarray, wing: int) -> np.ndarray:
        """Load of one wing on the hub about its interface point: minus the rate of momentum of all
        that it is made of.
        """
        on_centre = -(self.part[wing] @ self.accelerations(y))[:6]
        return np.concatenate(
            [on_centre[:3], on_centre[3:] - np.cross(self.wings[wing].place, on_centre[:3])]
        )
