"""Microstep command and current loop (Eq. 1, 2, 25, 26), and how a driver's reference currents
differ from their ideal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from microvib.model.compensation import CompensationHarmonic
from microvib.model.microstep_shape import (
    MAX_PARTS,
    MicrostepPart,
    MicrostepShape,
    shape_errors,
    shape_of,
)
from microvib.model.motor import Motor
from microvib.model.part import Part
from microvib.units import Quantity

MAX_TABLE = 16_384  # rows of a table of currents, at most
MAX_CURRENT = 2.0  # largest current of a table, over I
_USUAL = (1e-5, 0.05)  # errors of a driver, over its current
_SWITCHED_OFF = 1e-9  # a current over I up to which a pulse leaves its winding open
PULSE_KEYS = ("on_time", "diode_voltage")
"""Keys that a pulse drive has and no other."""
_LEAST_SPRING = 1e-3  # mean of the electromagnetic spring over that of ideal currents, at the least
_NOISE = 1e-14  # error of a computed reference over the current, by floating point


class Imperfections(Part):
    """Errors of the reference currents; zeros make an ideal driver.

    With I the amplitude and theta_e the electrical angle: i_A* = I (cos theta_e + offset_a) and
    i_B* = I ((1 + gain_b) sin(theta_e + quadrature) + offset_b), zero where smaller than dead_band
    I, then rounded to whole multiples of I/(2^(dac_bits - 1) - 1). Of more phases B is the second,
    cos(theta_e + quadrature - 2 pi/phases); the others are as A, without its offset.
    """

    gain_b: Annotated[
        float,
        Quantity(
            "", "gain error of phase B relative to the other phases", ge=-0.5, le=0.5, usual=_USUAL
        ),
    ] = 0.0
    offset_a: Annotated[
        float, Quantity("", "offset of phase A over the current I", ge=-0.5, le=0.5, usual=_USUAL)
    ] = 0.0
    offset_b: Annotated[
        float, Quantity("", "offset of phase B over the current I", ge=-0.5, le=0.5, usual=_USUAL)
    ] = 0.0
    quadrature: Annotated[
        float,
        Quantity(
            "rad",
            "quadrature error: angle by which phase B leads",
            ge=-0.5,
            le=0.5,
            display="deg",
            usual=_USUAL,
        ),
    ] = 0.0
    dead_band: Annotated[
        float,
        Quantity("", "references smaller than this part of the current I are zero", ge=0, le=0.5),
    ] = 0.0
    dac_bits: (
        Annotated[
            int,
            Field(
                ge=2,
                le=24,
                strict=True,
                description="bits that references are rounded to, over -I..I",
            ),
        ]
        | None
    ) = Field(
        default=None,
        description="DAC resolution of the references in bits, over -I..I; null does not round",
    )


class Harmonic(Part):
    """One harmonic of an angle correction: amplitude x sin(order theta_e + phase)."""

    order: Annotated[
        int, Field(ge=1, le=10_000, strict=True, description="cycles per electrical turn")
    ]
    amplitude: Annotated[
        float, Quantity("rad", "amplitude, electrical angle", ge=-1.0, le=1.0, display="deg")
    ]
    phase: Annotated[float, Quantity("rad", "phase at theta_e = 0", display="deg")] = 0.0


class CurrentTable(Part):
    """Driver table in place of cos theta_e and sin theta_e: currents row by row, or a
    corrected angle.
    """

    harmonics: tuple[Harmonic, ...] = Field(
        default=(),
        max_length=1000,
        description="angle that is added to theta_e, harmonic by harmonic",
    )
    currents: tuple[tuple[float, float], ...] = Field(
        default=(),
        max_length=MAX_TABLE,
        description="currents of phases A and B (of more phases, along two axes) over I after each microstep of an electrical"
        " turn, from theta_e = 0",
    )

    def _consistency_errors(self) -> Iterator[str]:
        if bool(self.harmonics) == bool(self.currents):
            yield "give either harmonics, of the angle correction, or currents, a pair for each microstep"
        for k, pair in enumerate(self.currents):
            if not max(abs(pair[0]), abs(pair[1])) <= MAX_CURRENT:
                yield (
                    f"currents.{k}: {pair[0]:g}, {pair[1]:g} is not allowed; currents over I from"
                    f" {-MAX_CURRENT:g} to {MAX_CURRENT:g} are expected"
                )


NO_IMPERFECTIONS = Imperfections()


class Driver(Part):
    """Microstepping current driver with one PI(D) loop per phase (Table 3); or voltages, lasting or in
    pulses.
    """

    drive: Literal["current", "voltage", "pulse"] = Field(
        default="current",
        description="what drives the phases; current: closed current loop; voltage: phase voltages R"
        " times the current, no current loop; pulse: the supply voltage on a phase for the on-time of"
        " each step, whatever motor.current is, then open windings with diodes",
    )
    beats: Annotated[
        int, Field(ge=3, le=64, strict=True, description="full steps per electrical period, b")
    ]
    microsteps: Annotated[
        int, Field(ge=1, le=65_536, strict=True, description="microsteps per full step, n")
    ]
    proportional_gain: Annotated[
        float,
        Quantity("V/A", "proportional gain of the current loop", "K_P", ge=0, usual=(0.05, 1e5)),
    ] = 0.0
    integral_gain: Annotated[
        float,
        Quantity(
            "V/A/s",
            "integral gain of the current loop",
            "K_I",
            ge=0,
            display="V/(A*s)",
            usual=(0.05, 1e8),
        ),
    ] = 0.0
    derivative_gain: Annotated[
        float, Quantity("V*s/A", "derivative gain, on the measured current", "K_D", ge=0)
    ] = 0.0
    supply_voltage: (
        Annotated[
            float,
            Quantity(
                "V",
                "limit of the phase voltage; null is none; of a pulse drive the voltage of a pulse",
                "U",
                gt=0,
                usual=(1.0, 400.0),
            ),
        ]
        | None
    ) = None
    on_time: (
        Annotated[
            float,
            Quantity(
                "s",
                "on-time of a pulse, in which the supply voltage is on a winding, once a step",
                "t_on",
                gt=0,
                display="ms",
                usual=(1e-3, 1.0),
            ),
        ]
        | None
    ) = None
    diode_voltage: (
        Annotated[
            float,
            Quantity(
                "V",
                "voltage of the diodes or clamp, against which a winding conducts that no switch drives",
                "U_d",
                gt=0,
                usual=(0.2, 400.0),
            ),
        ]
        | None
    ) = None
    clamp: Literal["unidirectional", "bidirectional"] = Field(
        default="unidirectional",
        description="clamp of a pulse drive; unidirectional: as diodes do, of two windings wound"
        " against each other one conducts; bidirectional: both conduct, either way, and brake twice",
    )
    microstep_ramp: Annotated[
        float,
        Quantity(
            "",
            "fraction of a microstep's period in which references ramp to their new values; 0 is a step",
            ge=0,
            le=1,
        ),
    ] = 0.0
    microstep_shape: tuple[MicrostepPart, ...] = Field(
        default=(),
        max_length=MAX_PARTS,
        description="parts in which each microstep is made, between its references in a straight"
        " line; without any it is made at once",
    )
    compensation: tuple[CompensationHarmonic, ...] = Field(
        default=(),
        max_length=100,
        description="error of the gear that the instants of the microsteps make up for, harmonic by"
        " harmonic",
    )
    delay: Annotated[
        float,
        Quantity(
            "s", "delay from the command of a microstep to its references", ge=0, le=1, display="ms"
        ),
    ] = 0.0
    imperfections: Imperfections = Imperfections()
    table: CurrentTable | None = Field(
        default=None,
        description="table of currents that replaces cosine and sine, or the name of its file",
    )

    def _consistency_errors(self) -> Iterator[str]:
        gains = ("proportional_gain", "integral_gain", "derivative_gain")
        if self.drive != "current" and any(getattr(self, gain) for gain in gains):
            yield (
                f"drive: {self.drive} has no current loop; set {', '.join(gains)} to 0, or leave them"
                " out"
            )
        yield from shape_errors(self.microstep_shape)
        if self.microstep_shape and self.microstep_ramp:
            yield (
                "microstep_shape: cannot be combined with microstep_ramp, which spreads the whole"
                " microstep; leave out one of both"
            )
        if self.pulsed:
            yield from self._pulse_errors()
        else:
            for name in PULSE_KEYS:
                if getattr(self, name) is not None:
                    yield f"{name}: only acts with drive: pulse; set that, or leave {name} out"
            if self.clamp != "unidirectional":
                yield "clamp: only acts with drive: pulse; set that, or leave clamp out"
        rows, turn = len(self.table.currents) if self.table else 0, self.beats * self.microsteps
        if rows not in (0, turn):
            yield (
                f"table.currents: has {rows} rows; one for each microstep of an electrical turn is"
                " expected,"
                f" beats x microsteps = {turn}"
            )

    def _pulse_errors(self) -> Iterator[str]:
        for name in ("supply_voltage", *PULSE_KEYS):
            if getattr(self, name) is None:
                quantity = type(self).quantity_of(name)
                unit = (quantity.display or quantity.unit) if quantity else ""
                yield f"{name}: is null, but drive: pulse needs it; give it in {unit}"
        if self.microsteps != 1:
            yield (
                f"microsteps: {self.microsteps} is not allowed with drive: pulse, which switches whole"
                " steps; 1 is expected"
            )
        if self.beats not in (4, 8):
            yield (
                f"beats: {self.beats} is not allowed with drive: pulse; 4, of full steps, or 8, of half"
                " steps, is expected"
            )
        for name in ("microstep_ramp", "microstep_shape", "imperfections"):
            if getattr(self, name) != type(self).model_fields[name].default:
                yield (
                    f"{name}: shapes currents, which a pulse drive has no control of; leave it out"
                    " with drive: pulse"
                )
        if self.compensation:
            yield (
                "compensation: cannot be combined with drive: pulse, whose steps come evenly; leave"
                " it out"
            )
        if self.table is not None and not self.table.currents:
            yield (
                "table: an angle correction shapes currents, which a pulse drive has no control of;"
                " give currents, of which the signs count, or leave it out"
            )

    def _required_fields(self) -> tuple[str, ...]:
        if self.drive == "current":
            return ("proportional_gain", "integral_gain")
        if self.drive == "pulse":
            return ("supply_voltage", *PULSE_KEYS)
        return ()

    @property
    def pulsed(self) -> bool:
        """Whether voltages come in pulses, between which windings are open."""
        return self.drive == "pulse"

    def slow_decay(self, motor: Motor) -> float:
        """Decay [1/s] of the slow pole of the current loop, near K_I / (K_P + R); infinite without one."""
        if self.drive != "current" or self.integral_gain == 0.0:
            return math.inf
        return self.integral_gain / (self.proportional_gain + motor.winding_resistance)

    @property
    def switched_windings(self) -> int:
        """Windings of a pulse drive that conduct on their own: 2, each of them either way, or 4 with
        those wound against them; 0 of another drive.
        """
        if not self.pulsed:
            return 0
        return 4 if self.clamp == "bidirectional" else 2

    @property
    def voltage_limit(self) -> float:
        """Limit of the voltages that a loop may demand [V]; infinite where there is none."""
        if self.supply_voltage is None or self.pulsed:
            return math.inf
        return self.supply_voltage

    def full_step(self, motor: Motor) -> float:
        """Full step of the rotor Delta theta [rad] (Eq. 25)."""
        return 2.0 * math.pi / (self.beats * motor.rotor_teeth)

    def microstep(self, motor: Motor) -> float:
        """Microstep of the rotor [rad]."""
        return self.full_step(motor) / self.microsteps

    def driving_frequency(self, motor: Motor, omega_m: float) -> float:
        """Microsteps per second f_d [Hz] at the rotor rate ``omega_m`` [rad/s] (Eq. 26)."""
        return abs(omega_m) / self.microstep(motor)

    def electrical_angle(self, count: np.ndarray) -> np.ndarray:
        """Electrical angle theta_e [rad] after ``count`` microsteps, an array of any shape (Eq. 1,
        corrected).
        """
        return 2.0 * math.pi * count / (self.beats * self.microsteps)

    def reference_currents(self, motor: Motor, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reference currents i_A*, i_B* [A] after ``count`` microsteps (Eq. 1, corrected); of more
        phases, along the two axes.

        Of a pulse drive those to which the voltages of the pulse would lead, U/R, -U/R or 0.
        """
        if self.pulsed:
            turn = references_over_electrical_period(self, 1.0)
            sign = np.where(np.abs(turn) > _SWITCHED_OFF, np.sign(turn), 0.0)
            at = np.asarray(count, dtype=np.int64) % len(turn)
            A, B = self.amplitude(motor) * sign[at].T
            return A, B
        return self.references(motor, self.electrical_angle(count))

    def references(
        self, motor: Motor, electrical_angle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """References at electrical angles [rad], of any shape; with errors or a table only those of
        microsteps are known.
        """
        if not self.distorted:
            return motor.axis_current * np.cos(electrical_angle), motor.axis_current * np.sin(
                electrical_angle
            )
        turn = references_over_electrical_period(self, motor.axis_current, motor.phases)
        count = np.rint(np.asarray(electrical_angle) * (len(turn) / (2.0 * math.pi))).astype(
            np.int64
        ) % len(turn)
        return turn[count, 0], turn[count, 1]

    def amplitude(self, motor: Motor) -> float:
        """Amplitude of the currents of the two axes [A]; of a pulse drive that to which a pulse would
        lead.
        """
        if self.pulsed and self.supply_voltage is not None:
            return self.supply_voltage / motor.winding_resistance
        return motor.axis_current

    def least_amplitude(self, motor: Motor) -> float:
        """Least size of the currents of the two axes together, of all microsteps [A]."""
        if self.pulsed or not self.distorted:
            return self.amplitude(motor)
        turn = references_over_electrical_period(self, motor.axis_current, motor.phases)
        return float(np.min(np.hypot(turn[:, 0], turn[:, 1])))

    def largest_reference(self, motor: Motor) -> float:
        """Largest reference current of a phase [A], of two."""
        if self.distorted:
            return float(np.max(np.abs(references_over_electrical_period(self, motor.current))))
        return motor.current

    @property
    def distorted(self) -> bool:
        """Whether references after a microstep are not I cos theta_e and I sin theta_e."""
        return self.table is not None or self.imperfections != NO_IMPERFECTIONS

    @property
    def ideal(self) -> bool:
        """Whether references are always I cos theta_e and I sin theta_e, of whole microsteps."""
        return self.microstep_ramp == 0.0 and not self.microstep_shape and not self.distorted

    @property
    def shape(self) -> MicrostepShape:
        """The parts of a microstep, as fractions and times."""
        return shape_of(self.microstep_shape)

    @property
    def compensates(self) -> bool:
        """Whether microsteps come earlier or later than evenly, against an error of the gear."""
        return any(one.amplitude > 0.0 for one in self.compensation)

    def repeats_after(self, motor: Motor) -> int:
        """Microsteps after which references are as before, but turned, and the motor's torque too.

        For an ideal driver a period of the detent torque and of what flux harmonics add to it, or its
        least multiple that is a whole number of microsteps.
        """
        electrical = self.beats * self.microsteps
        quarter = electrical // math.gcd(electrical, motor.repeats_per_turn)
        if self.distorted:
            turn = references_over_electrical_period(self, 1.0, motor.phases)
            vector = turn[:, 0] + 1j * turn[:, 1]
            turned = vector * np.exp(2j * math.pi * quarter / electrical)
            if np.max(np.abs(np.roll(vector, -quarter) - turned)) > 1e-12:
                return electrical
        return quarter

    def time_constant(self, motor: Motor) -> float:
        """Fast time constant of the closed current loop [s]."""
        return (motor.winding_inductance + self.derivative_gain) / (
            self.proportional_gain + motor.winding_resistance
        )


@lru_cache(maxsize=32)
def references_over_electrical_period(
    driver: Driver, current: float, phases: int = 2
) -> np.ndarray:
    """References i_A*, i_B* [A] after each microstep of an electrical turn, from theta_e = 0 on, (b
    n, 2); not to be changed.

    Of more phases they are along the two axes, ``current`` being the amplitude there; each phase
    has its errors by itself.
    """
    errors, table = driver.imperfections, driver.table
    count = np.arange(driver.beats * driver.microsteps)
    theta_e = driver.electrical_angle(count)
    if table is not None and table.currents:
        along, across = np.array(table.currents).T
    else:
        corrections = (
            h.amplitude * np.sin(h.order * theta_e + h.phase)
            for h in (table.harmonics if table else ())
        )
        theta_e = theta_e + sum(corrections)
        along, across = np.cos(theta_e), np.sin(theta_e)
    place = np.array([(1.0, 0.0), (0.0, 1.0)] if phases == 2 else _phase_axes(phases))
    (c, s), lead = place[1], errors.quadrature
    led = place.copy()
    led[1] = c * math.cos(lead) + s * math.sin(lead), s * math.cos(lead) - c * math.sin(lead)
    turn = np.outer(along, led[:, 0]) + np.outer(across, led[:, 1])
    turn[:, 1] *= 1.0 + errors.gain_b
    turn[:, :2] += errors.offset_a, errors.offset_b
    turn[np.abs(turn) < errors.dead_band - _NOISE] = 0.0
    if errors.dac_bits is not None:
        turn = quantized(turn, 2 ** (errors.dac_bits - 1) - 1)
    turn = current * (2.0 / phases) * (turn @ place)
    turn.flags.writeable = False
    return turn


class SpringFactors(NamedTuple):
    """Stiffness of the electromagnetic spring over that of ideal currents, over an electrical turn."""

    low: float
    mean: float
    high: float


IDEAL_SPRING = SpringFactors(1.0, 1.0, 1.0)


def spring_factors(driver: Driver, motor: Motor) -> SpringFactors:
    """Stiffness that a driver's references make, over z K_m I; of a pulse drive as if always on.

    At the rotor's electrical angle theta_e it is z K_m (i_A cos theta_e + i_B sin theta_e). The mean
    is that of a rotor that turns evenly, by any constant angle from its command. The range is that
    of this rotor and of one that stands where the references put it, at z K_m |i|.
    """
    if driver.pulsed or not driver.distorted:
        return IDEAL_SPRING
    return _spring_of_turn(driver, motor.phases)


def motor_of_mean_spring(driver: Driver, motor: Motor) -> Motor:
    """The motor with the current whose spring is the mean that a driver's references make; the same
    where they are ideal.
    """
    mean = spring_factors(driver, motor).mean
    if mean == 1.0:
        return motor
    return motor.model_copy(update={"current": mean * motor.current})


@lru_cache(maxsize=32)
def _spring_of_turn(driver: Driver, phases: int) -> SpringFactors:
    turn = references_over_electrical_period(driver, 1.0, phases)
    theta_e = driver.electrical_angle(np.arange(len(turn)))
    currents = turn[:, 0] + 1j * turn[:, 1]
    each = [currents * np.exp(-1j * theta_e), currents * np.exp(1j * theta_e)]
    along = max(each, key=lambda x: abs(np.mean(x)))  # a table may turn the other way round
    mean = max(float(abs(np.mean(along))), _LEAST_SPRING)
    found = (along * np.conj(np.mean(along)) / mean).real
    both = np.concatenate([found, np.abs(currents), [mean]])
    return SpringFactors(float(both.min()), mean, float(both.max()))


def quantized(references: np.ndarray, levels: int) -> np.ndarray:
    """Round references over I, of any shape, to whole multiples of 1/``levels``, a half step away
    from zero.

    A reference within the noise of floating point of a half step is taken for it: references that
    are equal but for their sign, or by a symmetry of the phases, stay so.
    """
    steps = np.abs(references) * levels
    halves = np.rint(2.0 * steps)
    steps = np.where(np.abs(2.0 * steps - halves) <= 2.0 * _NOISE * levels, 0.5 * halves, steps)
    return np.asarray(np.copysign(np.floor(steps + 0.5), references) / levels)


def _phase_axes(phases: int) -> list[tuple[float, float]]:
    """Cosine and sine of the electrical angle of each phase's axis, of three phases or more."""
    angles = (2.0 * math.pi * k / phases for k in range(phases))
    return [(math.cos(angle), math.sin(angle)) for angle in angles]
