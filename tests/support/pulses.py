"""An oracle for pulsed voltage drives: windings that are driven, freewheel, are open or regenerate, by SciPy.

Written from the windings' equations alone; it shares no code with ``microvib.solve``. Each winding
w has its own current, with k_w its torque per current and p = z theta_m:

    v_w = R i_w + L di_w/dt + k_w omega_m,    torque = sum of i_w k_w - K_d sin 4p

Two windings (A, B) are driven either way, as in a bridge; four (a, b, and c, d wound against them)
one way each, by one switch each. A winding that is switched off goes on conducting against the
diodes' voltage until its current is zero; then it is open, until its back-EMF exceeds the diodes'.
Every change of mode is located by the dense output of DOP853, and ends an integration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

DRIVEN, CONDUCTS, OPEN = "driven", "conducts", "open"
TM, WM, TL, WL, CURRENTS = range(5)
LONGEST = 5e-4
"""Step [s] that passes over no two changes of one mode."""
HAIR = 1e-9
"""Relative width in which a mode that has just ended does not begin anew, by rounding."""
NOTHING = 1e-12
"""Rate [rad/s] and current [A] past zero at which a mode ends, so that one that begins at zero is not
found to end there.
"""


@dataclass(frozen=True)
class Friction:
    """Coulomb level [N m], what is held above it at rest [N m] and the rate [rad/s] in which that
    fades, viscous part [N m s/rad].
    """

    coulomb: float = 0.0
    excess: float = 0.0
    stribeck_rate: float = 1.0
    viscous: float = 0.0

    @property
    def held(self) -> float:
        return self.coulomb + self.excess

    def torque(self, sign: float, rate: float) -> float:
        """While slipping in the direction ``sign``; continued past zero rate."""
        fading = self.excess * math.exp(-max(sign * rate / self.stribeck_rate, -1.0))
        return sign * (self.coulomb + fading) + self.viscous * rate


@dataclass(frozen=True)
class PulsedDrive:
    """A two-phase stepping motor, full steps with one phase on, on a reducer with torsional
    stiffness, and a rigid load; SI units.
    """

    voltage: float
    on_time: float
    diode_voltage: float
    step_time: float
    R: float
    L: float
    K_m: float
    K_d: float
    J_m: float
    J_l: float
    K_g: float
    C_g: float
    ratio: float = 200.0
    teeth: int = 50
    rotor: Friction = Friction()
    output: Friction = Friction()
    four_windings: bool = False
    both_ways: bool = False
    """Whether each of four windings conducts either way, where its diodes really conduct one way,
    below -diode_voltage. Two windings do either way in any case."""

    @property
    def full_step(self) -> float:
        return 2.0 * math.pi / (4 * self.teeth)

    @property
    def one_way(self) -> bool:
        return self.four_windings and not self.both_ways

    @property
    def windings(self) -> int:
        return 4 if self.four_windings else 2

    def constants(self, theta_m: float) -> tuple[float, ...]:
        """Torque per current of each winding."""
        s, c = math.sin(self.teeth * theta_m), math.cos(self.teeth * theta_m)
        own = -self.K_m * s, self.K_m * c
        return (*own, -own[0], -own[1]) if self.four_windings else own

    def driven(self, step: int) -> tuple[int, float]:
        """Which winding a step drives, and its voltage."""
        if self.four_windings:
            return step % 4, self.voltage
        return step % 2, self.voltage if step % 4 < 2 else -self.voltage


@dataclass
class _Modes:
    windings: list[tuple[str, float]]
    """Mode of each winding with its voltage (driven) or the sign of its current."""
    rotor: float = 0.0
    output: float = 0.0
    """1, -1: slips; 0: sticks."""


@dataclass
class Run:
    """What came out: samples at the asked times, (n, 4 + windings), where the rotor stood before
    each step, and energies [J].
    """

    t: np.ndarray
    y: np.ndarray
    before_step: np.ndarray
    """Angle of the rotor before each pulse and at the end, in full steps, (steps + 1,)."""
    events: int
    electrical: float = 0.0
    joule: float = 0.0
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def lag(self) -> np.ndarray:
        """Whole full steps by which the rotor is behind its command before each pulse and at the
        end, (steps + 1,).
        """
        return np.rint(np.arange(self.before_step.size) - self.before_step).astype(int)

    @property
    def lost(self) -> int:
        """Full steps lost, one after another."""
        return int(np.sum(np.maximum(np.diff(self.lag), 0)))

    @property
    def gained(self) -> int:
        return int(np.sum(np.maximum(-np.diff(self.lag), 0)))

    @property
    def first(self) -> int:
        """Number of the first step that was not made as commanded, from 1; 0 where all were."""
        wrong = np.flatnonzero(np.diff(self.lag))
        return int(wrong[0]) + 1 if wrong.size else 0


def _friction_of(
    drive: PulsedDrive, modes: _Modes, y: np.ndarray
) -> tuple[float, float, float, float]:
    """Torques on rotor and output without friction, and their frictions."""
    k = drive.constants(y[TM])
    torque = sum(i * own for i, own in zip(y[CURRENTS:], k, strict=True))
    torque -= drive.K_d * math.sin(4 * drive.teeth * y[TM])
    gear = drive.K_g * (-y[TM] / drive.ratio - y[TL]) + drive.C_g * (-y[WM] / drive.ratio - y[WL])
    torque += gear / drive.ratio
    held_m = torque if modes.rotor == 0.0 else drive.rotor.torque(modes.rotor, y[WM])
    held_l = gear if modes.output == 0.0 else drive.output.torque(modes.output, y[WL])
    return torque, gear, held_m, held_l


def _rates(drive: PulsedDrive, modes: _Modes) -> Callable[[float, np.ndarray], list[float]]:
    def rates(_: float, y: np.ndarray) -> list[float]:
        torque, gear, held_m, held_l = _friction_of(drive, modes, y)
        turning = 0.0 if modes.rotor == 0.0 else y[WM]
        output = 0.0 if modes.output == 0.0 else y[WL]
        found = [turning, (torque - held_m) / drive.J_m, output, (gear - held_l) / drive.J_l]
        for i, k, (mode, of) in zip(
            y[CURRENTS:], drive.constants(y[TM]), modes.windings, strict=True
        ):
            if mode == OPEN:
                found.append(0.0)
            else:
                v = of if mode == DRIVEN else -of * drive.diode_voltage
                found.append((v - drive.R * i - k * y[WM]) / drive.L)
        return found

    return rates


def _margin_of_winding(drive: PulsedDrive, w: int, mode: str, sign: float):
    def margin(_: float, y: np.ndarray) -> float:
        if mode == CONDUCTS:
            return sign * y[CURRENTS + w] + NOTHING
        emf = drive.constants(y[TM])[w] * y[WM]
        return (1.0 + 2.0 * HAIR) * drive.diode_voltage - (-emf if drive.one_way else abs(emf))

    return margin


def _margin_of_body(drive: PulsedDrive, modes: _Modes, which: int):
    friction, mode = (drive.rotor, modes.rotor) if which == 0 else (drive.output, modes.output)

    def margin(_: float, y: np.ndarray) -> float:
        if mode != 0.0:
            return mode * y[WM if which == 0 else WL] + NOTHING
        return (1.0 + 2.0 * HAIR) * friction.held - abs(_friction_of(drive, modes, y)[which])

    return margin


def _margins(drive: PulsedDrive, modes: _Modes) -> list[tuple[tuple[str, int], Callable]]:
    found = []
    for w, (mode, sign) in enumerate(modes.windings):
        if mode != DRIVEN:
            found.append((("winding", w), _margin_of_winding(drive, w, mode, sign)))
    for which, friction in enumerate((drive.rotor, drive.output)):
        if friction.held > 0.0:
            found.append((("body", which), _margin_of_body(drive, modes, which)))
    for _, margin in found:
        margin.terminal, margin.direction = True, -1.0
    return found


def _switch_off(drive: PulsedDrive, modes: _Modes, y: np.ndarray) -> None:
    for w, (mode, _) in enumerate(modes.windings):
        if mode == DRIVEN:
            modes.windings[w] = _undriven(drive, w, y)


def _undriven(drive: PulsedDrive, w: int, y: np.ndarray) -> tuple[str, float]:
    """Mode of a winding that no switch drives."""
    i, emf = y[CURRENTS + w], drive.constants(y[TM])[w] * y[WM]
    if i != 0.0:
        return CONDUCTS, math.copysign(1.0, i)
    limit = (1.0 + HAIR) * drive.diode_voltage  # one that has just ceased does not begin anew
    if -emf > limit or (not drive.one_way and emf > limit):
        return CONDUCTS, -math.copysign(1.0, emf)
    return OPEN, 0.0


def _decide(drive: PulsedDrive, modes: _Modes, event: tuple[str, int], y: np.ndarray) -> None:
    """The mode after an event."""
    kind, which = event
    if kind == "winding":
        mode, _ = modes.windings[which]
        if mode == CONDUCTS:
            y[CURRENTS + which] = 0.0
            modes.windings[which] = _undriven(drive, which, y)
        else:
            emf = drive.constants(y[TM])[which] * y[WM]
            modes.windings[which] = CONDUCTS, -math.copysign(1.0, emf)
        return
    friction, was = (drive.rotor, modes.rotor) if which == 0 else (drive.output, modes.output)
    y[WM if which == 0 else WL] = 0.0
    pull = _friction_of(drive, modes, y)[which]
    sticks = was != 0.0 and abs(pull) <= (1.0 + HAIR) * friction.held
    after = 0.0 if sticks else math.copysign(1.0, pull)
    if which == 0:
        modes.rotor = after
    else:
        modes.output = after


def _at_rest(drive: PulsedDrive, y: np.ndarray) -> _Modes:
    modes = _Modes([(OPEN, 0.0)] * drive.windings)
    torque, gear, _, _ = _friction_of(drive, modes, y)
    if abs(torque) > drive.rotor.held or drive.rotor.held == 0.0:
        modes.rotor = math.copysign(1.0, torque)
    if abs(gear) > drive.output.held or drive.output.held == 0.0:
        modes.output = math.copysign(1.0, gear)
    return modes


def integrate(
    drive: PulsedDrive,
    steps: int,
    times: np.ndarray | None = None,
    rtol: float = 1e-9,
    first: float = 0.0,
) -> Run:
    """From rest at theta = 0, without current; ``steps`` full steps forwards, one every
    ``step_time`` from ``first`` on, each followed by its free motion.
    """
    y = np.zeros(CURRENTS + drive.windings)
    modes, t, events = _at_rest(drive, y), 0.0, 0
    asked = np.zeros(0) if times is None else np.asarray(times, dtype=float)
    rows: list[np.ndarray] = []
    stood = []
    edges = [(first + n * drive.step_time, "on") for n in range(steps)]
    edges += [(at + drive.on_time, "off") for at, _ in edges]
    edges.append((first + steps * drive.step_time, "end"))
    atol = 1e-12 * np.array([1.0, 1e3, 1.0, 10.0] + [1.0] * drive.windings)
    step = 0
    for until, what in sorted(edges):
        while t < until:
            margins = _margins(drive, modes)
            found = solve_ivp(
                _rates(drive, modes), (t, until), y, method="DOP853", rtol=rtol, atol=atol, max_step=LONGEST,
                events=[margin for _, margin in margins], dense_output=asked.size > 0,
            )  # fmt: skip
            here = found.t[-1]
            if asked.size:
                within = asked[(asked >= t) & (asked < here)]
                if within.size:
                    rows.append(found.sol(within).T)
            t, y = here, found.y[:, -1].copy()
            if modes.rotor == 0.0:
                y[WM] = 0.0
            if modes.output == 0.0:
                y[WL] = 0.0
            for w, (mode, _) in enumerate(modes.windings):
                if mode == OPEN:
                    y[CURRENTS + w] = 0.0
            if found.status == 1:
                events += 1
                for (event, margin), at in zip(margins, found.t_events, strict=True):
                    # two windings on one axis have the same back-EMF, and change together
                    scale = drive.diode_voltage
                    if event[0] == "winding" and modes.windings[event[1]][0] == CONDUCTS:
                        scale = drive.diode_voltage / drive.R
                    if at.size or (event[0] == "winding" and margin(t, y) <= HAIR * scale):
                        _decide(drive, modes, event, y)
        if what == "off":
            _switch_off(drive, modes, y)
        else:
            stood.append(y[TM] / drive.full_step)
        if what == "on":
            step += 1
            w, v = drive.driven(step)
            modes.windings[w] = DRIVEN, v
    sampled = np.concatenate(rows) if rows else np.zeros((0, y.size))
    return Run(asked, sampled, np.array(stood), events)
