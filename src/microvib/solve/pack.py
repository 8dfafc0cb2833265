"""From a scenario to the arrays that the kernel takes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from microvib.errors import SimulationError
from microvib.model.friction import Friction
from microvib.model.harness import Harness
from microvib.model.motor import Motor
from microvib.model.scenario import Scenario
from microvib.solve import kernel, nodes, propagate, propagators, replay
from microvib.solve.noise import roughness, torque_noise
from microvib.solve.sampling import ERROR_WEIGHTS
from microvib.solve.vector import whole_lanes

MAX_MIXED_CHANNELS = 8
"""Sums of channels that are made in every step, rather than picked from all channels' samples."""
SCRATCH_ROWS = 19
"""Rows of a run's scratch."""
MIN_STEP_RATIO = 0.01
"""Shortest step in units of the fastest part of the linear motion."""


ELECTRICAL_FIELDS = ("R", "L", "K_P", "K_I", "K_D", "K_V")
STEP_FIELDS = ("max_step", "layer", "shaped", "elements")
"""Fields of which the lengths of steps follow, or how equations are written; and friction's memory, which
``replay`` has none of."""
STRIBECK_FIELDS = {
    "m_stribeck": ("m_inv_rate", "m_shape"),
    "l_stribeck": ("l_inv_rate", "l_shape"),
}
"""Fields that do nothing where the Stribeck excess before them is 0."""
HARMONIC_FIELDS = ("detent_harmonics", "friction_harmonics", "te")
"""Fields with an order and two amplitudes for each harmonic."""
MODAL_FIELDS = ("H", "H_m", "V", "V_m", "D", "Lam")


@dataclass(frozen=True)
class Replayed:
    """Notes of a replay; see ``replay.replay``."""

    accuracy: float
    noted: bool
    modes: np.ndarray
    moments: np.ndarray
    span: np.ndarray


@dataclass(frozen=True)
class Packed:
    """One scenario as the kernel takes it: its parameters, its state (updated in place) and
    scratch.
    """

    drive: Any
    state: Any
    propagators: Any
    sizes: np.ndarray
    """Motion of each state per microstep; inf for a state that no gain moves."""
    scratch: np.ndarray
    lanes: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Scratch of the propagators."""
    held: np.ndarray
    """The state ``y`` at rest with holding currents."""

    def advance(self, stop: float, samples: Any, steps_t: np.ndarray, steps_ref: np.ndarray) -> int:
        """Advance to the time ``stop`` [s]; see ``propagate.advance``."""
        n, columns = samples.rows.shape
        assert n == 0 or columns in (
            self.torque_columns,
            kernel.STEP_COLUMNS,
            whole_lanes(columns),
        )
        samples = self._remembered(samples)
        own = self.state, self.drive, self.propagators
        return int(
            propagate.advance(
                stop, *own, samples, steps_t, steps_ref, *self.lanes, self.scratch.ravel()
            )
        )

    def advance_each(
        self,
        y: np.ndarray,
        begun: np.ndarray,
        steps: np.ndarray,
        stops: np.ndarray,
        samples: Any,
        *microsteps: np.ndarray,
    ) -> tuple[int, np.ndarray, np.ndarray]:
        """Advance from each of many states, which the ends replace, by propagators; see
        ``propagate.advance_each``.

        Returns a status, the modes of rotor and output at the beginning and at the end, (k, 4), and
        how often the rotor and how often either has come to rest, (k, 2).
        """
        sticks, sticking = np.zeros((len(y), 4)), np.zeros((len(y), 2), dtype=np.int64)
        samples = self._remembered(samples)
        found, own = (
            (y, begun, steps, stops, sticks, sticking),
            (self.state, self.drive, self.propagators),
        )
        status = propagate.advance_each(
            *found, *own, samples, *microsteps, *self.lanes, self.scratch.ravel()
        )
        return int(status), sticks, sticking

    def _remembered(self, samples: Any) -> Any:
        """Samples with rates that count inside steps at least as where they are sampled, if the
        drive remembers them.

        Elements of friction and backlash keep the angle at which an event fell, and events fall
        inside steps: what a torque forgets by the end of a step, they do not.
        """
        if not self.drive.elements.size:
            return samples
        return samples._replace(rates_shown=max(samples.rates_shown, ERROR_WEIGHTS[0]))

    def replay(self, stop: float, plan: np.ndarray, results: Replayed, period: Any) -> int:
        """Advance to the time ``stop`` [s] by the recorded steps ``plan``; see ``replay.replay``."""
        tables = self.propagators._replace(accuracy=results.accuracy)
        return int(
            replay.replay(
                stop,
                plan,
                results.noted,
                results.modes,
                results.moments,
                results.span,
                self.state,
                self.drive,
                tables,
                period.times,
                period.commands,
                *self.lanes,
                self.scratch.ravel(),
            )
        )

    def beside(self, scenario: Scenario) -> Packed:
        """Another drive with the state, the linear part and the scratch of this one; with tables of
        its own for modes that differ. For replays alone, and so little another that it is finite.
        """
        drive = _drive(scenario)
        drive = drive._replace(shaped=drive.shaped or self.drive.shaped)
        return replace(self, drive=drive, propagators=self._tables_for(drive))

    def _tables_for(self, drive: Any) -> Any:
        """Propagators of this drive as another takes them: with its modes, and with its currents,
        which decay within a step, so that deficits by them would be no cubics.
        """
        t, modal = self.propagators, moments(2, 2 if drive.H_m.size else 1)
        t = t._replace(current=t.current + drive.current - self.drive.current)
        if self._differs(drive, ELECTRICAL_FIELDS):
            A = _linear_part(drive, self.state._replace(y=self.held))
            others = {x: np.zeros_like(getattr(t, x)) for x in ("nodes", "pieces", "modes", "sums")}
            t = t._replace(A=A, columns=_columns_of(A), **others)
            propagators.tabulate(t, drive, moments(kernel.MODES, 6), modal)
        elif self._differs(drive, MODAL_FIELDS):
            t = t._replace(**{x: np.zeros_like(getattr(t, x)) for x in ("modes", "sums")})
            propagators.tabulate_modes(t, drive, modal)
        return t

    def _differs(self, drive: Any, fields: tuple[str, ...]) -> bool:
        """Whether another drive differs from this one in some of its fields."""
        for name in fields:
            own, other = getattr(self.drive, name), getattr(drive, name)
            if isinstance(own, np.ndarray):
                same = own is other or np.array_equal(own, other)
            else:
                same = own == other
            if not same:
                return True
        return False

    @property
    def numbers(self) -> list[np.ndarray]:
        """All numbers of the drive that a motion with given steps follows from: one of each field, (n,),
        and then arrays of numbers of a kind.
        """
        drive, left_out = self.drive, {*STEP_FIELDS}
        for excess, curve in STRIBECK_FIELDS.items():
            if getattr(drive, excess) == 0.0:
                left_out.update(curve)
        single, found = [], []
        for name, value in zip(drive._fields, drive, strict=True):
            if name in left_out:
                continue
            if not isinstance(value, np.ndarray):
                single.append(value)
            elif name in HARMONIC_FIELDS:
                found += [value[::3], value[1::3], value[2::3]]
            elif value.size:
                found.append(value)
        return [np.array(single, dtype=float), *found]

    def snapshot(self) -> np.ndarray:
        """All channels of the present state, (channels,)."""
        out = np.zeros(self.channels)
        kernel.snapshot(self.state, self.drive, self.scratch, out)
        return out

    @property
    def channels(self) -> int:
        """Number of channels of a sample, modal ones included."""
        return kernel.N_CHANNELS + 2 * int(self.drive.H.size)

    @property
    def torque_columns(self) -> int:
        """Number of columns of samples of the torque alone (``torque_of``)."""
        return 2

    def torque_of(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Disturbance torque [N m] and the output's stick in such samples, (n,) each."""
        return rows[:, 0], rows[:, 1]

    @property
    def columns(self) -> int:
        """Number of columns of samples of all channels; propagators fill whole lanes."""
        return whole_lanes(self.channels)

    def mixes(self, mix: np.ndarray) -> bool:
        """Whether it pays, and is allowed, to sample sums of channels, (columns, channels), instead
        of the channels.

        Energies add up over steps, which no sum of one step shows.
        """
        energies = mix[:, kernel.POWERS : kernel.N_CHANNELS]
        return len(mix) <= MAX_MIXED_CHANNELS and not np.any(energies)

    @property
    def momentum(self) -> float:
        """Angular momentum L of all that moves [N m s]."""
        y, p = self.state.y, self.drive
        own = float(p.J_m * y[kernel.WM] + p.J_L * y[kernel.WL] + p.H @ y[kernel.MODES + 1 :: 2])
        if not p.H_m.size and p.J_c == 0.0:
            return own
        modes = p.H_m @ y[kernel.MODES + 1 :: 2] + (p.V + p.V_m) @ y[kernel.MODES :: 2]
        return own + float(p.J_c * (y[kernel.WM] + y[kernel.WL]) + modes)


def pack(scenario: Scenario) -> Packed:
    """Parameters, and the state at rest at theta = 0 with holding currents."""
    drive = _require_finite(_drive(scenario))
    size = kernel.MODES + 2 * scenario.load.H.size
    state = kernel.State(
        y=np.zeros(size),
        stick=np.zeros(2 + 2 * len(drive.elements) + drive.windings),
        clock=np.zeros(kernel.N_CLOCK),
        counters=np.zeros(kernel.N_COUNTERS, dtype=np.int64),
        energy=np.zeros(kernel.N_POWERS),
        levels=propagate.INITIAL_STEP_LEVELS.astype(np.int64),
    )
    width = max(kernel.N_CHANNELS + size, 32)
    _set_holding_state(scenario, drive, state)
    sizes, held = _state_sizes(scenario), state.y.copy()
    tables = _propagators(scenario, drive, state, sizes)
    if scenario.record.rotor_offset != 0.0:
        _set_holding_state(
            scenario,
            drive,
            state,
            scenario.record.rotor_offset * scenario.driver.full_step(scenario.motor),
        )
    margins = len(drive.elements) + drive.windings
    lanes = np.zeros((75 + 3 * size + kernel.N_CHANNELS + margins, 4))
    by_node = np.zeros((4, whole_lanes(kernel.N_CHANNELS + size - kernel.MODES)))
    return Packed(
        drive,
        state,
        tables,
        sizes,
        np.zeros((SCRATCH_ROWS, width)),
        (lanes, lanes.ravel(), by_node),
        held,
    )


_NO_HARNESS = Harness()
_LONG_RAMP = 0.95
"""Part of a microstep's period from which a ramp lasts almost until the next one begins."""


def _refinement(scenario: Scenario) -> int:
    """Refinement of the steps: twice the solver's where ramps follow each other.

    From one such ramp to the next the slope of the references changes so little that the torque's
    error lets steps grow beyond the current loop's transient, and the electrical energy is then off
    by a hundred times what it is otherwise.
    """
    own = scenario.solver.refinement
    if scenario.driver.microstep_ramp > _LONG_RAMP:
        return 2 * own
    return own


def _propagators(scenario: Scenario, drive: Any, state: Any, sizes: np.ndarray) -> Any:
    """Tables of ``microvib.solve.propagate`` for a drive, at rest in ``state``."""
    n, s, solver = kernel.MODES, drive.H.size, scenario.solver
    per_size = 1.0 / sizes  # 0 for what no gain moves
    refinement = _refinement(scenario)
    A, longest = _linear_part(drive, state), solver.max_step / refinement
    fastest = float(
        np.max(
            np.sum(
                np.abs(A) * per_size[:n, None] / np.where(per_size[:n] > 0.0, per_size[:n], np.inf),
                axis=2,
            )
        )
    )
    for stribeck, inv_rate, inertia in (
        (drive.m_stribeck, drive.m_inv_rate, drive.J_m),
        (drive.l_stribeck, drive.l_inv_rate, max(drive.J_L, drive.J_m if drive.rigid else 0.0)),
    ):
        fastest = max(fastest, stribeck * inv_rate / inertia if inertia > 0.0 else 0.0)
    accuracy = solver.accuracy / refinement**4
    shortest = shortest_ratio(drive, accuracy)
    levels = min(
        max(1 + math.ceil(math.log2(longest * fastest / shortest)), 8), propagators.MOST_LEVELS
    )
    current, windup = _holding_current(scenario, scenario.motor.axis_current)
    tables = propagators.Propagators(
        longest=longest,
        accuracy=accuracy,
        current=current,
        windup=windup,
        inputs=6 if math.isfinite(drive.U_max) or drive.windings > 2 else 4,
        levels=levels,
        A=A,
        columns=_columns_of(A),
        per_size=per_size[propagators.INPUTS],
        per_layer=np.maximum(per_size[propagators.INPUTS], _friction_layer_rates(drive)),
        nodes=np.zeros((propagators.PATTERNS * levels * propagators.NODE_ROWS, 4)),
        pieces=np.zeros((propagators.PATTERNS * levels * propagators.PIECE_ROWS, 4)),
        modes=np.zeros((levels * s * propagators.MODE_ROWS, 4)),
        sums=np.zeros((levels * propagators.SUM_ROWS, 4)),
        momentum=nodes.HERMITE.T.reshape(16, 4).copy(),
        onwards=nodes.ONWARDS.reshape(16, 4).copy(),
        fractions=nodes.CUBES[None].copy(),
        integrals=(nodes.LAGRANGE / np.arange(1, 5)).T.copy(),
    )
    propagators.tabulate(tables, drive, moments(n, 6), moments(2, 2 if drive.H_m.size else 1))
    return tables


def shortest_ratio(drive: Any, accuracy: float) -> float:
    """Shortest step in units of the fastest part of the linear motion."""
    if math.isfinite(
        drive.U_max
    ):  # what the supply limits jumps, inside a step that is as short as the accuracy asks
        return MIN_STEP_RATIO * min(1.0, math.sqrt(accuracy / 1e-3))
    return MIN_STEP_RATIO


def _columns_of(A: np.ndarray) -> np.ndarray:
    """Columns of the matrices of all patterns, in two rows of four each."""
    return A.transpose(0, 2, 1).reshape(-1, 4).copy()


def _friction_layer_rates(drive: Any) -> np.ndarray:
    """1 / (rate within which friction falls), (6,), of the states with deficits that are rates."""
    if drive.m_stribeck > 0.0:
        m = drive.m_inv_rate
    else:
        m = 0.0
    if drive.l_stribeck > 0.0:
        output = drive.l_inv_rate
    else:
        output = 0.0
    if drive.rigid:
        m = max(m, output * abs(drive.inv_h))
    return np.array([0.0, 0.0, m, output, 0.0, 0.0])


def moments(n: int, inputs: int) -> Any:
    """Scratch of ``propagators.tabulate`` for ``n`` states and so many ``inputs``."""
    square = np.zeros((n, n))
    return propagators.Moments(
        square,
        np.zeros((n, inputs)),
        square.copy(),
        np.zeros((4, n, inputs)),
        square.copy(),
        square.copy(),
    )


def _linear_part(drive: Any, state: Any) -> np.ndarray:
    """Derivative of the equations of motion by the state, without modes, detent, flux harmonics, dry
    friction and supply limit, at rest.
    """
    A = np.zeros((propagators.PATTERNS, kernel.MODES, kernel.MODES))
    propagators.linear_part(*linear_part_arguments(drive, state, A))
    if drive.windings:
        _leave_windings_apart(A, drive)
    return A


def linear_part_arguments(drive: Any, state: Any, A: np.ndarray) -> tuple[Any, ...]:
    """Arguments of ``propagators.linear_part`` to fill ``A`` for a drive at rest in ``state``."""
    none, n = np.zeros(0), kernel.MODES
    bare = drive._replace(
        K_d=0.0,
        flux=none,
        detent_harmonics=none,
        m_slide=0.0,
        m_stribeck=0.0,
        l_slide=0.0,
        l_stribeck=0.0,
        U_max=math.inf,
        H=none,
        H_m=none,
        V=none,
        V_m=none,
        D=none,
        Lam=none,
        te=none,
    )
    steps = 1e-4 * np.maximum(np.abs(state.y[:n]), 1.0)
    steps[kernel.TM] /= drive.z
    rest = state._replace(y=state.y.copy(), stick=np.zeros_like(state.stick))
    return rest, bare, drive, steps, A, np.zeros(n), np.zeros(n), np.zeros(7)


def _leave_windings_apart(A: np.ndarray, drive: Any) -> None:
    """Leave of windings that are switched the decay of their own current alone, whatever their mode:
    one table then serves all modes, and the current of one that is open stays exactly zero.
    """
    windings = [kernel.IA, kernel.IB, kernel.XA, kernel.XB]
    A[:, windings, :] = 0.0
    A[:, :, windings] = 0.0
    for i in windings[: drive.windings]:
        A[:, i, i] = -drive.R / drive.L


def _require_finite(drive: Any) -> Any:
    """The drive, if compiled code may see it: parameters that are finite can give constants that
    are not.
    """
    bounded = drive._replace(U_max=0.0)  # one look at all of them: this is asked for each drive
    arrays = [x.ravel() for x in bounded if isinstance(x, np.ndarray)]
    if math.isfinite(sum(x for x in bounded if not isinstance(x, np.ndarray))) and math.isfinite(
        float(np.sum(np.concatenate(arrays)))
    ):
        return drive
    for name, value in zip(drive._fields, drive, strict=True):
        finite = math.isfinite(value) if isinstance(value, float) else np.all(np.isfinite(value))
        if name != "U_max" and not finite:
            raise SimulationError(
                f"this drive cannot be computed: its constant {name} is not a finite number;"
                " its parameters are inconsistent in order of magnitude"
            )
    return drive


def _set_holding_state(scenario: Scenario, drive: Any, state: Any, theta_m: float = 0.0) -> None:
    """State before t = 0: at rest, the rotor at ``theta_m``, the phases at their holding currents,
    the loop in equilibrium.
    """
    A, B = (float(x) for x in scenario.driver.references(scenario.motor, np.zeros(())))
    state.y[kernel.IA], state.y[kernel.XA] = _holding_current(scenario, A)
    state.y[kernel.IB], state.y[kernel.XB] = _holding_current(scenario, B)
    # The transmission error may be non-zero there; the gear is relaxed.
    state.y[kernel.TM] = theta_m
    state.y[kernel.TL] = scenario.reducer.kinematic_error(theta_m) - theta_m * drive.inv_h
    if not drive.windings:  # those that are switched are open between pulses
        state.clock[kernel.REF_A], state.clock[kernel.REF_B] = A, B
    state.clock[kernel.NEXT_STEP] = drive.layer
    kernel.initial_friction(state, drive)


def _holding_current(scenario: Scenario, reference: float) -> tuple[float, float]:
    """Current [A] and integral of its error [A s] at rest under a reference [A]."""
    driver, R = scenario.driver, scenario.motor.winding_resistance
    if driver.drive == "pulse":
        return 0.0, 0.0
    if driver.drive == "voltage":
        return reference, 0.0
    if driver.integral_gain > 0.0:
        return reference, R * reference / driver.integral_gain
    return reference * driver.proportional_gain / (driver.proportional_gain + R), 0.0


def _friction(friction: Friction) -> tuple[float, float, float, float, float]:
    return (
        friction.sliding_torque,
        friction.stribeck_torque,
        1.0 / friction.stribeck_rate,
        friction.stribeck_shape,
        friction.viscous,
    )


def _drive(scenario: Scenario) -> Any:
    motor, driver, reducer, solver = (
        scenario.motor,
        scenario.driver,
        scenario.reducer,
        scenario.solver,
    )
    rotor, output = _friction(motor.friction), _friction(scenario.friction)
    L, L_D = motor.winding_inductance, motor.winding_inductance + driver.derivative_gain
    load = scenario.load
    moves = load.moves
    J_m, J_L, J_c = load.rotor_left, load.output_left, load.cross_left
    noise, noise_rate = torque_noise(scenario)
    rough, rough_rate = roughness(scenario)
    harness = scenario.friction.harness or _NO_HARNESS
    memories = (
        motor.friction.memory,
        scenario.friction.memory,
        reducer.memory,
        harness.memory,
    )
    elements = [np.array(memory, dtype=float).reshape(-1, 2) for memory in memories]
    gap = 0.5 * (reducer.backlash or 0.0)
    fast = driver.time_constant(motor)
    if driver.integral_gain > 0.0:
        fast = min(fast, math.sqrt(L_D / driver.integral_gain))
    return kernel.Drive(
        z=float(motor.rotor_teeth),
        current=motor.axis_current,
        ideal=driver.ideal or driver.pulsed,
        K_m=motor.axis_torque_constant,
        K_d=motor.detent_torque,
        detent=motor.detent_periods,
        flux=_flux(motor),
        detent_harmonics=_detent_harmonics(motor),
        R=motor.winding_resistance,
        L=L,
        K_P=driver.proportional_gain,
        K_I=driver.integral_gain,
        K_D=driver.derivative_gain,
        K_V=0.0 if driver.drive == "current" else motor.winding_resistance,
        U_max=driver.voltage_limit,
        windings=driver.switched_windings,
        diode_voltage=driver.diode_voltage or 0.0,
        step=driver.full_step(motor),
        J_m=J_m,
        J_L=J_L,
        J_h=load.array_left,
        J_c=J_c,
        K_g=0.0 if reducer.rigid else float(reducer.stiffness),
        C_g=0.0 if reducer.rigid else reducer.damping,
        rigid=reducer.rigid,
        shaped=rotor[3] != 1.0 or output[3] != 1.0,
        m_slide=rotor[0],
        m_stribeck=rotor[1],
        m_inv_rate=rotor[2],
        m_shape=rotor[3],
        m_viscous=motor.viscous,
        l_slide=output[0],
        l_stribeck=output[1],
        l_inv_rate=output[2],
        l_shape=output[3],
        l_viscous=output[4],
        inv_K_P=1.0 / driver.proportional_gain if driver.proportional_gain > 0.0 else 0.0,
        inv_L=1.0 / L,
        inv_L_D=1.0 / L_D,
        inv_J_m=1.0 / J_m,
        inv_J_L=1.0 / J_L if J_L > 0.0 else 0.0,
        inv_J_both=1.0 / (J_L - J_c**2 / J_m) if J_L > 0.0 else 0.0,
        inv_h=1.0 / reducer.h,
        inv_z=1.0 / motor.rotor_teeth,
        max_step=solver.max_step / _refinement(scenario),
        layer=fast / 3.0 / _refinement(scenario),
        m_elements=len(elements[0]),
        l_elements=len(elements[1]),
        g_elements=len(elements[2]),
        harness_elements=len(elements[3]),
        harness_limit=harness.friction,
        harness_stiffness=harness.stiffness,
        harness_angle=harness.neutral_angle,
        g_limit=reducer.hysteresis_torque,
        gap=gap,
        elements=np.concatenate([*elements, np.zeros((1 if gap > 0.0 else 0, 2))]),
        noise=noise,
        noise_rate=noise_rate,
        friction_harmonics=_harmonics(scenario.friction),
        rough=rough,
        rough_rate=rough_rate,
        H=load.H,
        H_m=load.R if moves else np.zeros(0),
        V=load.V_l if moves else np.zeros(0),
        V_m=load.V_m if moves else np.zeros(0),
        D=load.D,
        Lam=load.Lambda,
        te=_transmission_error(scenario),
    )


def _flux(motor: Motor) -> np.ndarray:
    """Factors of sine and cosine of the odd multiples of the electrical angle, from the third to the
    highest that acts: two of phase A's flux rate and two of phase B's each (``kernel.flux_shapes``).
    """
    acting = motor.axis_flux_harmonics
    highest = max((h.order for h in acting), default=1)
    factors = np.zeros(((highest - 1) // 2, 4))
    for h in acting:
        s, c = h.amplitude * math.sin(h.phase), h.amplitude * math.cos(h.phase)
        factors[(h.order - 3) // 2] += c, s, -h.sequence * s, h.sequence * c
    return factors.ravel()


def _detent_harmonics(motor: Motor) -> np.ndarray:
    rows = [
        [float(h.order), h.amplitude * math.cos(h.phase), h.amplitude * math.sin(h.phase)]
        for h in motor.detent
        if h.amplitude
    ]
    return np.array(rows, dtype=float).ravel()


def _harmonics(friction: Friction) -> np.ndarray:
    """Order, cosine and sine amplitude of each harmonic of friction over the angle."""
    if friction.position:
        listed = friction.position.harmonics
    else:
        listed = ()
    rows = [
        [h.order, h.amplitude * math.cos(h.phase), -h.amplitude * math.sin(h.phase)]
        for h in listed
        if h.amplitude
    ]
    return np.array(rows, dtype=float).ravel()


def _transmission_error(scenario: Scenario) -> np.ndarray:
    rows = [
        [float(e.order), e.amplitude * math.cos(e.phase), e.amplitude * math.sin(e.phase)]
        for e in scenario.reducer.errors
    ]
    return np.array(rows, dtype=float).ravel()


def rotor_rate_of(scenario: Scenario) -> float:
    """Natural rate [rad/s] of the rotor on its electromagnetic spring."""
    motor, driver = scenario.motor, scenario.driver
    stiffness = motor.rotor_teeth * motor.axis_torque_constant * driver.amplitude(motor)
    turned = scenario.rotor_inertia
    if scenario.reducer.rigid:
        turned += scenario.output_inertia / scenario.reducer.ratio**2
    return math.sqrt(stiffness / turned)


def _state_sizes(scenario: Scenario) -> np.ndarray:
    """Motion of each state per microstep; inf for a state that no gain moves."""
    motor, driver, array = scenario.motor, scenario.driver, scenario.array
    step, current = driver.microstep(motor), driver.amplitude(motor)
    rotor_rate = rotor_rate_of(scenario)
    output_rate = rotor_rate
    if not scenario.reducer.rigid:
        output_rate = min(
            rotor_rate, math.sqrt(float(scenario.reducer.stiffness) / scenario.output_inertia)
        )
    angle = step / scenario.reducer.ratio
    rate = angle * output_rate
    if driver.integral_gain > 0.0:
        integral = motor.winding_resistance * current / driver.integral_gain
    elif driver.switched_windings > 2:
        integral = current  # of the windings that are wound against the others
    else:
        integral = math.inf
    H = np.maximum(
        np.hypot(scenario.load.H, scenario.load.V_l / scenario.load.Omega),
        1e-3 * math.sqrt(array.inertia),
    )
    return np.concatenate(
        [
            [
                current,
                current,
                integral,
                integral,
                step,
                step * rotor_rate,
                angle,
                rate,
            ],
            np.column_stack([H * angle, H * rate]).ravel(),
        ]
    )
