"""Swing of attitude control that a start leaves, told from two states of a run, so that it need not
be waited for.

The torque by which a run is taken for settled hardly knows of it: the modes of attitude control are
slow and hardly move the shaft, but they turn the hub. They are those of the linearised drive on its
craft, M q'' + C q' + K q = 0 with symmetric matrices, so that the part c of a mode u exp(s t) in a
deviation q of the motion is

    c = u.(M q' + (s M + C) q) / u.(2 s M + C) u.

Over a time T it changes by c (exp(s T) - 1), and from that change it is known.
"""

from __future__ import annotations

import math

import numpy as np

from microvib.model.drive_matrices import coordinates
from microvib.model.line_names import CONTROL_MODE, LineName
from microvib.model.linear import coupled_modes, matrices
from microvib.model.scenario import Scenario
from microvib.solve import kernel

_BANDWIDTHS = 4.0
"""Size of an eigenvalue of attitude control, over its bandwidth, at most."""
_SAME = 1e-6
"""Relative distance of eigenvalues that are the same."""


class AttitudeModes:
    """Modes of attitude control on the craft of a scenario; none on a fixed base and without it."""

    def __init__(self, scenario: Scenario) -> None:
        self._M, self._C, K = matrices(scenario)
        n = len(self._M)
        control = None if scenario.spacecraft is None else scenario.spacecraft.attitude_control
        self._full = coordinates(scenario.reducer, len(scenario.load.H))
        self._load = scenario.load
        if control is None:
            self.eigenvalues, self._shapes = np.zeros(0, complex), np.zeros((n, 0), complex)
            return
        companion = np.block(
            [
                [np.zeros((n, n)), np.eye(n)],
                [-np.linalg.solve(self._M, K), -np.linalg.solve(self._M, self._C)],
            ]
        )
        values, vectors = np.linalg.eig(companion)
        others = [
            mode.eigenvalue
            for mode in coupled_modes(scenario)
            if LineName.parse(mode.name).family != CONTROL_MODE
        ]
        slow = np.abs(values) < _BANDWIDTHS * 2.0 * math.pi * control.bandwidth
        slow &= np.abs(values) > 0.0
        for other in others:
            slow &= np.abs(values - other) > _SAME * abs(other)
            slow &= np.abs(values - other.conjugate()) > _SAME * abs(other)
        self.eigenvalues, self._shapes = values[slow], vectors[:n, slow]

    def deviation(self, before: np.ndarray, after: np.ndarray, time: float) -> np.ndarray:
        """By how much the kernel's state ``after`` (n,), seen from the command, is off a motion that
        repeats, by the state a ``time`` [s] ``before``, whole periods ago.
        """
        found: np.ndarray = np.zeros_like(after)
        if not self.eigenvalues.size:
            return found
        q, rate = self._linear(after - before)
        s, u = self.eigenvalues, self._shapes
        momentum = self._M @ rate[:, None] + (s * (self._M @ q[:, None]) + (self._C @ q)[:, None])
        size = np.sum(u * (2.0 * s * (self._M @ u) + self._C @ u), axis=0)
        part = np.sum(u * momentum, axis=0) / size
        # What is left at the end, of what it was at the beginning: c exp(s T).
        now = part * np.exp(s * time) / np.expm1(s * time)
        self._put(found, (u @ now).real, (u @ (s * now)).real)
        return found

    def _linear(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of the matrices (n,) and their rates, of the kernel's state."""
        load, eta, w = self._load, y[kernel.MODES :: 2], y[kernel.MODES + 1 :: 2]
        rate = w - load.H * y[kernel.WL] - load.R * y[kernel.WM]
        shafts = np.array([[y[kernel.TM], y[kernel.TL]], [y[kernel.WM], y[kernel.WL]]])
        if self._full.shape[1] < self._full.shape[0]:
            shafts = shafts[:, :1]
        return np.concatenate([shafts[0], eta]), np.concatenate([shafts[1], rate])

    def _put(self, y: np.ndarray, q: np.ndarray, rate: np.ndarray) -> None:
        """Write coordinates of the matrices and their rates into the kernel's state."""
        full, speed = self._full @ q, self._full @ rate
        y[kernel.TM], y[kernel.TL] = full[:2]
        y[kernel.WM], y[kernel.WL] = speed[:2]
        y[kernel.MODES :: 2] = full[2:]
        y[kernel.MODES + 1 :: 2] = speed[2:] + self._load.H * speed[1] + self._load.R * speed[0]
