"""Modes that are fed by stiffness which varies over the angles of the shafts (parametric resonance).

Each variation is a tone of the 2 x 2 stiffness on rotor and output, A exp(j omega_a t) and its conjugate:
detent torque and flux harmonics on the rotor; friction over the angle, of its slope, on the output; and errors
of the gear, which vary its ratio. Deviations of modes i and j grow where one tone, or the product of two, comes
at the sum of their frequencies,

    rate = |phi_i A phi_j| / (2 (omega_i omega_j)^(1/2))

with phi what modes of unit modal mass move of both shafts. To first order A is the tone's own; two tones, or one
twice, act by the motion that the first makes at the frequency between, A = A_ab - A_b R A_a, with R the
receptance there and A_ab what they vary together; one tone three times likewise. What detent torque and flux
harmonics do by themselves is exact in ``microvib.model.turning``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from microvib.model.line_names import electrical_line
from microvib.model.linear import CoupledMode, coupled_modes, dynamic_stiffness, matrices
from microvib.model.scenario import Scenario
from microvib.model.turning import turning_drive

_LEAST_GROWTH = 0.3
"""Growth over a mode's own decay from which it may be kept ringing."""
_DETUNED = 0.01
"""Part of its frequency by which a variation may be off the sum of two modes' and feed them in full: what is
not linear shifts them."""
_OFF_BEYOND_FIRST_ORDER = 1.5
"""Factor by which rates of the second order and above may be off, as higher ones are left out; assumed."""
_STRONGEST = 24
"""Tones that are taken in pairs, those that feed modes most by themselves."""
_NEGLIGIBLE = 0.05
"""Part of the decay of modes, and of its square, below which one tone, or the product of two, feeds nothing."""
_RINGS = 0.1
"""Damping ratio below which a mode rings."""
_STIFF_GEAR = 1e4
"""Stiffness of a gear in place of a rigid one, over that by which what it carries follows the fastest mode."""


def decay_in_motion(mode: CoupledMode, scenario: Scenario) -> float:
    """Rate [1/s] at which the ringing of a mode dies away while the drive turns, at least that by
    its damping where the variation of the motor's stiffness adds to that; negative where it grows.
    """
    over_angle = growth_over_angle(scenario)
    return min(
        mode.decay,
        turning_drive(scenario).decay.get(mode.name, math.inf),
        mode.decay - max((x.rate for x in over_angle if mode.name in x.modes), default=0.0),
    )


class ParametricResonance(NamedTuple):
    """A mode, or two, that varying stiffness may keep ringing at some rate."""

    mode: CoupledMode
    """The one, or the lower of the two."""
    frequency: float
    """Frequency of the variation there [Hz]: twice the mode's, or the sum of both."""
    order: float
    """Cycles of what varies per turn of the output."""
    line: str
    """Name of the line that rings, of half that order."""


class GrowthOverAngle(NamedTuple):
    """Rate by which what varies over the angle of a shaft feeds one mode, or two."""

    what: str
    """Key of what varies, or both."""
    modes: tuple[str, ...]
    rate: float
    """[1/s], before the modes' own decay; at most."""
    may_grow: bool
    """Whether that is more than the modes' own decay."""
    growth: float
    """Growth [1/s] with the modes' own decay at least; 0 where they may die away."""


def parametric_resonances(scenario: Scenario) -> tuple[ParametricResonance, ...]:
    """Modes that what varies over the angle may keep ringing, at whatever rate; the torque of friction is
    that at the rate of the record. What is well below their own decay is left out.
    """
    shapes = _shapes(scenario)
    if shapes is None:
        return ()
    found = []
    for product in _products(shapes, _tones(scenario)):
        for i, j in shapes.pairs:
            both = shapes.frequency[i] + shapes.frequency[j]
            rate = shapes.fed(product, i, j, both / product.order)
            if rate > _LEAST_GROWTH * shapes.decay_of(i, j):
                lower = shapes.modes[min(i, j)]
                found.append(ParametricResonance(lower, both, product.order, product.half_line))
    return tuple(found)


@lru_cache(maxsize=32)
def growth_over_angle(scenario: Scenario) -> tuple[GrowthOverAngle, ...]:
    """Find the modes that errors of the gear, or friction over the angle, feed at the rate of the record, by
    themselves or together with detent torque and flux harmonics; less the more the frequency of the
    variation is off the sum of theirs, to within a hundredth. Roughness is left out.
    """
    shapes = _shapes(scenario)
    if shapes is None or not scenario.rate:
        return ()
    by_motor = turning_drive(scenario).decay
    return tuple(
        _growth([shapes.modes[k] for k in pair], feeding, by_motor)
        for pair, feeding in _feeding(scenario, shapes).items()
        if not all(one.of_spring for one in feeding)  # exact in turning_drive
    )


def _growth(
    modes: Sequence[CoupledMode], feeding: Sequence[_Feeding], by_motor: Mapping[str, float]
) -> GrowthOverAngle:
    """Growth of two modes, or one twice, by all that feeds them; decays ``by_motor`` hold what the motor's
    spring does.
    """
    decay = [mode.decay for mode in modes]
    if not any(one.of_spring for one in feeding):
        decay = [min(mode.decay, by_motor.get(mode.name, math.inf)) for mode in modes]
    most = sum(one.most for one in feeding)
    least = feeding[0].least if len(feeding) == 1 else 0.0  # several may cancel
    return GrowthOverAngle(
        what=" with ".join(dict.fromkeys(one.key for one in feeding)),
        modes=tuple(dict.fromkeys(mode.name for mode in modes)),
        rate=most,
        may_grow=_growth_of(most, *decay) > 0.0,
        growth=max(_growth_of(least, *decay), 0.0),
    )


@lru_cache(maxsize=32)
def modes_fed_by_both_drives(scenario: Scenario) -> tuple[str, ...]:
    """Modes of a craft with two driven wings of which ``modes_fed_together`` tells; none where one wing is driven."""
    second = scenario.driven_wing
    if second is None:
        return ()
    return modes_fed_together(scenario.alone, second.alone)


def modes_fed_together(first: Scenario, second: Scenario) -> tuple[str, ...]:
    """Find the modes of a craft that two drives which step feed by more than their decay together.

    Of a mode in which both wings swing each drive sees half the energy while the other one stands: together
    they may keep ringing what neither does alone, by what varies over the angle, by windings that take damping
    away, or by friction that falls with the rate. Phases are taken as those that feed most.

    Parameters
    ----------
    first, second : Scenario
        Each drive on the craft, while the other one stands.
    """
    drives = first, second
    modes = [sorted(coupled_modes(one), key=lambda mode: mode.frequency) for one in drives]
    if len(modes[0]) != len(modes[1]):
        return ()
    named = [[mode for mode in each if mode.frequency > 0.0] for each in modes]
    grows = _fed_by_both(drives, named[0])
    lost = zip(
        *(_lost_damping(one, own) for one, own in zip(drives, named, strict=True)), strict=True
    )
    undamped = [
        mode.name
        for mode, parts in zip(named[0], lost, strict=True)
        if _lose_all(mode.decay, *parts)
    ]
    return tuple(dict.fromkeys([*grows, *undamped]))


def _fed_by_both(drives: Sequence[Scenario], modes: Sequence[CoupledMode]) -> Iterator[str]:
    """Names of modes that the tones of both drives feed by more than their decay."""
    first, second = (_rates_of_feeding(one) for one in drives)
    for pair in sorted(first.keys() & second.keys()):
        if _growth_of(first[pair] + second[pair], *(modes[k].decay for k in pair)) > 0.0:
            yield from (modes[k].name for k in pair)


def _lose_all(decay: float, first: float, second: float) -> bool:
    """Whether two drives take away all of a mode's ``decay`` [1/s], which neither does by itself."""
    part = min(first, second)
    return part > _NEGLIGIBLE * decay and max(first, second) < decay < first + second


def _lost_damping(drive: Scenario, modes: Sequence[CoupledMode]) -> list[float]:
    """Decay [1/s] that modes lose by the windings of a drive, and by its friction's slope; 0 of those that do
    not ring.
    """
    on_slope = turning_drive(drive).decay_on_slope
    return [
        max(mode.decay - on_slope.get(mode.name, math.inf), 0.0) if mode.damping < _RINGS else 0.0
        for mode in modes
    ]


def _rates_of_feeding(drive: Scenario) -> dict[tuple[int, int], float]:
    """Rates [1/s] by which a drive feeds each pair of modes; without those that it does not."""
    shapes = _shapes(drive)
    if shapes is None or not drive.rate:
        return {}
    found = _feeding(drive, shapes).items()
    return {pair: sum(one.most for one in each) for pair, each in found}


class _Feeding(NamedTuple):
    """Rate by which tones feed two modes, or one twice."""

    key: str
    of_spring: bool
    """Whether the motor's spring alone does."""
    most: float
    """[1/s]."""
    least: float
    """[1/s]."""


def _feeding(drive: Scenario, shapes: _Shapes) -> dict[tuple[int, int], list[_Feeding]]:
    """Find what feeds each pair of modes at the rate of the record."""
    turns = abs(float(drive.rate or 0.0)) / (2.0 * math.pi)
    found: dict[tuple[int, int], list[_Feeding]] = {}
    for product in _products(shapes, _tones(drive)):
        of_spring = all(tone.of_spring for tone in product.tones)
        if of_spring and len(product.tones) > 1:
            continue  # exact in turning_drive
        off = 1.0 if len(product.tones) == 1 else _OFF_BEYOND_FIRST_ORDER
        for i, j in shapes.pairs:
            rate = _rate_beside(product, shapes, (i, j), turns)
            if rate > _NEGLIGIBLE * shapes.decay_of(i, j):
                one = _Feeding(product.keys, of_spring, rate * off, rate / off)
                found.setdefault((i, j), []).append(one)
    return found


def _rate_beside(product: _Product, shapes: _Shapes, pair: tuple[int, int], turns: float) -> float:
    """Rate [1/s] by which tones feed two modes, less what their frequency is off the sum of theirs."""
    i, j = pair
    frequency = product.order * turns
    off = abs(shapes.frequency[i] + shapes.frequency[j] - frequency) - _DETUNED * frequency
    lost = math.pi * max(off, 0.0)
    if lost >= product.most_fed:
        return 0.0
    fed = shapes.fed(product, i, j, turns)
    return math.sqrt(max(fed**2 - lost**2, 0.0))


def _growth_of(rate: float, a: float, b: float) -> float:
    """Growth [1/s] of two modes, or one twice, of decays ``a`` and ``b`` [1/s] that are fed by a ``rate``."""
    return math.hypot(rate, 0.5 * (a - b)) - 0.5 * (a + b)


class _Tone(NamedTuple):
    """One cycle of a stiffness that varies over the angle of a shaft, at positive or negative order."""

    key: str
    line: str
    order: float
    """Cycles per turn of the output."""
    stiffness: np.ndarray
    """Complex amplitude on rotor and output, (2, 2) [N m/rad], of exp(j omega t); its conjugate goes along."""
    of_gear: complex = 0.0
    """Complex amplitude of the gear's ratio, times the root of its stiffness."""
    of_spring: bool = False
    """Whether it is the motor's."""

    @property
    def conjugate(self) -> _Tone:
        """Tone at the negative order."""
        of_gear = self.of_gear.conjugate() if self.of_gear else 0.0
        return self._replace(order=-self.order, stiffness=self.stiffness.conj(), of_gear=of_gear)


class _Product(NamedTuple):
    """Tones that act together, in the orders of time in which they may."""

    tones: tuple[_Tone, ...]
    most_fed: float
    """Bound on the rate [1/s] by which it feeds modes."""

    @property
    def order(self) -> float:
        """Cycles of all together per turn of the output."""
        return sum(tone.order for tone in self.tones)

    @property
    def keys(self) -> str:
        """Keys of what varies."""
        return " with ".join(dict.fromkeys(tone.key for tone in self.tones))

    @property
    def half_line(self) -> str:
        """Name of a line of half its order."""
        if len(self.tones) == 1 and self.tones[0].of_spring:
            return self.tones[0].line
        names = [f"{'-' if tone.order < 0.0 else ''}{tone.line}" for tone in self.tones]
        return f"half of {' and '.join(names)}"

    @property
    def sequences(self) -> tuple[tuple[_Tone, ...], ...]:
        """Orders of time in which the tones may act."""
        if len(set(map(id, self.tones))) == 1:
            return (self.tones,)
        return self.tones, self.tones[::-1]


class _Shapes:
    """Modes of a drive, what they move of both shafts, and how the drive answers between them."""

    def __init__(self, scenario: Scenario, modes: Sequence[CoupledMode]) -> None:
        from scipy.linalg import eigh  # slow to import

        self.modes = sorted(modes, key=lambda mode: mode.frequency)
        self.frequency = [mode.frequency for mode in self.modes]
        count = len(self.modes)
        self.pairs = [(i, j) for i in range(count) for j in range(i, count)]
        self._drive = _with_elastic_gear(scenario, self.frequency[-1])
        self._matrices = M, _, K = matrices(self._drive)
        squares, shapes = eigh(K, M)
        natural = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi)
        nearest = [int(np.argmin(np.abs(natural - f))) for f in self.frequency]
        omega = 2.0 * math.pi * np.array(self.frequency)
        self.moved = shapes[:2, nearest] / np.sqrt(omega)
        """Motion of both shafts in each, over the root of its angular frequency, (2, k)."""
        self.least_decay = max(min(mode.decay for mode in self.modes), 0.0)

    def decay_of(self, i: int, j: int) -> float:
        """Decay [1/s] of two modes together."""
        return math.sqrt(max(self.modes[i].decay, 0.0) * max(self.modes[j].decay, 0.0))

    def largest_fed(self, stiffness: np.ndarray) -> float:
        """Largest rate [1/s] by which a stiffness (2, 2) feeds modes."""
        return 0.5 * float(np.max(np.abs(self.moved.T @ stiffness @ self.moved)))

    def fed(self, product: _Product, i: int, j: int, turns: float) -> float:
        """Rate [1/s] by which tones feed two modes where the output makes so many ``turns`` a second [Hz]."""
        total = _varied_together(product)
        for tones in product.sequences:
            frequency = -self.frequency[j]
            stiffness = tones[0].stiffness
            for tone, before in zip(tones[1:], tones[:-1], strict=True):
                frequency += before.order * turns
                stiffness = -tone.stiffness @ self._receptance(frequency) @ stiffness
            total = total + stiffness
        return 0.5 * float(np.abs(self.moved[:, i] @ total @ self.moved[:, j]))

    def _receptance(self, frequency: float) -> np.ndarray:
        """Angles of both shafts by torques on them at a ``frequency`` [Hz] of either sign, (2, 2)."""
        dynamic = dynamic_stiffness(self._drive, abs(frequency), self._matrices)
        found = np.linalg.solve(dynamic, np.eye(dynamic.shape[-1])[:, :2])[:2]
        return np.asarray(found if frequency >= 0.0 else found.conj())


def _varied_together(product: _Product) -> np.ndarray:
    """Stiffness of the second order in the gear's ratio that two tones vary together, (2, 2)."""
    result = np.zeros((2, 2), dtype=complex)
    if len(product.tones) == 2:
        first, second = product.tones
        result[0, 0] = len(product.sequences) * first.of_gear * second.of_gear
    return result


def _shapes(scenario: Scenario) -> _Shapes | None:
    """Modes of a drive; None where nothing varies, or nothing rings."""
    modes = [mode for mode in coupled_modes(scenario) if mode.frequency > 0.0]
    position = scenario.friction.position
    varies = scenario.motor.stiffness_orders or scenario.reducer.errors
    if not modes or not (varies or (position and position.harmonics)):
        return None
    return _Shapes(scenario, modes)


def _with_elastic_gear(scenario: Scenario, fastest: float) -> Scenario:
    """A scenario with a stiff gear in place of a rigid one, beside modes up to the ``fastest`` [Hz]."""
    reducer = scenario.reducer
    if not reducer.rigid:
        return scenario
    stiffness = _STIFF_GEAR * (2.0 * math.pi * fastest) ** 2 * float(scenario.load.output)
    elastic = reducer.model_copy(update={"stiffness": stiffness, "damping": 0.0})
    return scenario.model_copy(update={"reducer": elastic})


def _tones(scenario: Scenario) -> list[_Tone]:
    """All tones of a drive, each at positive order."""
    reducer, friction, motor = scenario.reducer, scenario.friction, scenario.motor
    electrical_turns = motor.rotor_teeth * abs(reducer.h)
    on_rotor, on_output = np.diag([1.0, 0.0]), np.diag([0.0, 1.0])
    found: list[_Tone] = []
    for order, stiffness in motor.stiffness_orders.items():
        line, turns = electrical_line(order // 2), float(order * electrical_turns)
        of_motor = 0.5 * stiffness * on_rotor
        found.append(_Tone("motor.detent_torque", line, turns, of_motor, of_spring=True))
    held = abs(friction.torque(float(scenario.rate or 0.0)))
    modes = [mode.frequency for mode in coupled_modes(scenario)]
    K = float(_with_elastic_gear(scenario, max(modes, default=1.0)).reducer.stiffness)
    for one in reducer.errors:
        cycles = float(one.order)
        slope, bend = 0.5j * cycles * one.amplitude, -0.5 * cycles**2 * one.amplitude
        across = -K * slope
        spring = np.array([[2.0 * across / reducer.h + held * bend, across], [across, 0.0]])
        turns, of_gear = cycles * abs(reducer.h), math.sqrt(K) * slope
        found.append(_Tone("reducer.transmission_error", one.line, turns, spring, of_gear))
    for each in friction.position.harmonics if friction.position else ():
        of_slope = 0.5j * each.order * each.amplitude * held * on_output
        line = f"friction_{each.order}"
        found.append(_Tone("friction.position", line, float(each.order), of_slope))
    return found


def _products(shapes: _Shapes, tones: Sequence[_Tone]) -> Iterator[_Product]:
    """Tones one by one, several times over, and the strongest in pairs, of positive order together.

    Two tones feed modes most where the motion between is a resonance, by the product of what each feeds over
    the decay of that; pairs that are weaker even so are left out.
    """
    fed = {id(tone): shapes.largest_fed(tone.stiffness) for tone in tones}
    for tone in tones:
        yield _Product((tone,), fed[id(tone)])
    strongest = sorted(tones, key=lambda tone: -fed[id(tone)])[:_STRONGEST]
    for first, second in combinations_with_replacement(strongest, 2):
        if fed[id(first)] * fed[id(second)] < _NEGLIGIBLE * shapes.least_decay**2:
            continue
        yield _Product((first, second), math.inf)
        if first is second:
            yield _Product((first,) * 3, math.inf)
        low, high = sorted((first, second), key=lambda tone: tone.order)
        if high.order > low.order:
            yield _Product((high, low.conjugate), math.inf)
