"""Ringing after a manoeuvre in the full model: microsteps, friction, detent torque and all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from microvib.analysis.lines import find_lines
from microvib.analysis.noise import ringing_by_noise
from microvib.errors import MicrovibError, OptionError, SimulationError
from microvib.model.friction import Friction
from microvib.model.linear import CoupledMode, coupled_modes, rate_step_response
from microvib.model.scenario import Scenario
from microvib.model.tracking import Leg, Tracking
from microvib.signals.line_table import BELOW_FLOOR, Line
from microvib.solve.batch import torque_from_rest
from microvib.studies.profiles.rate_profile import RateProfile
from microvib.units import Si

MAX_LEGS = 1000
"""Legs that ``tracking.profile`` takes."""
_PERIODS_RECORDED = 10.0
"""Periods of the slowest mode that are recorded after a manoeuvre, at least."""
_RESOLVED = 4.0
"""Record length over the reciprocal of the distance of two modes, at least."""
_LONGEST_RECORD = 300.0
"""Seconds up to which a record is made longer than the scenario's."""
_NO_DURATION = 1e-9
"""Time [s] below which two points of a profile are one."""


@dataclass(frozen=True)
class Case:
    """A drive whose modes and friction are off by factors, with the modes that matter."""

    scenario: Scenario
    names: tuple[str, ...]
    """Names of the modes, the one that rings most first."""
    frequency: float = 1.0
    """Frequency of the first mode over its nominal one."""
    damping: float = 1.0
    friction: float = 1.0
    late: float = 0.0
    """Part of a full step by which the manoeuvre begins later."""

    @cached_property
    def modes(self) -> tuple[CoupledMode, ...]:
        """The modes, in the order of their names."""
        found = {mode.name: mode for mode in coupled_modes(self.scenario)}
        return tuple(found[name] for name in self.names)

    @cached_property
    def gains(self) -> np.ndarray:
        """T_d that a step of the commanded rate by one leaves ringing in the linearised drive,
        complex (n,) [N m s/rad].
        """
        clock = self.scenario.tracking.clock_ratio
        return clock * rate_step_response(self.scenario, self.modes)

    @cached_property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of the modes [1/s], complex (n,)."""
        return np.array([mode.eigenvalue for mode in self.modes])

    @property
    def text(self) -> str:
        """Errors of the case, in words."""
        parts = [
            f"{what} {100.0 * (factor - 1.0):+.3g} %"
            for what, factor in (
                ("frequency", self.frequency), ("damping", self.damping), ("friction", self.friction),
            )
            if factor != 1.0
        ]  # fmt: skip
        if self.late:
            parts.append(f"begun {self.late:g} full step later")
        return ", ".join(parts) or "nominal"


@dataclass(frozen=True)
class Ringing:
    """Ringing of a mode at the end of a manoeuvre, in one run."""

    amplitude: float
    """0-to-peak [N m]; nan where it is not known."""
    phase: float
    """Phase of the cosine then [rad]."""
    most: float
    """Largest amplitude that it may have [N m]; infinite where nothing is known."""
    status: str

    @property
    def value(self) -> complex:
        """Amplitude and phase as a complex number; 0 where it is below the floor."""
        if math.isnan(self.amplitude):
            return 0j
        return complex(self.amplitude * np.exp(1j * self.phase))


def case_of(
    scenario: Scenario, names: tuple[str, ...], frequency: float, damping: float, friction: float
) -> Case:
    """A drive whose first mode, as seen through the drive, is at ``frequency`` times its nominal
    one.

    Frequencies of all modes of the array, clamped, are changed by one factor, dampings by
    ``damping``, friction on the output by ``friction``. Raises OptionError where the drive's own
    stiffness does not let the mode go there.
    """
    base = _with_friction(_with_modes(scenario, 1.0, damping), friction)
    if frequency == 1.0:
        return Case(base, names, 1.0, damping, friction)
    nominal = _frequency_of(scenario, names[0])
    factor = _clamped_factor(base, names[0], frequency * nominal, frequency)
    return Case(_with_modes(base, factor, 1.0), names, frequency, damping, friction)


def _clamped_factor(scenario: Scenario, name: str, wanted: float, about: float) -> float:
    """Factor on the clamped frequencies with which a mode is at ``wanted`` [Hz]."""
    from scipy.optimize import brentq

    def off(log_factor: float) -> float:
        return _frequency_of(_with_modes(scenario, math.exp(log_factor), 1.0), name) - wanted

    low, high = math.log(about) - 0.7, math.log(about) + 0.7
    if off(low) * off(high) > 0.0:
        raise OptionError(
            "frequency_uncertainty",
            f"{name} cannot be at {wanted:.4g} Hz through this drive, whatever the array's own"
            " frequency is; give a smaller one",
        )
    return math.exp(float(brentq(off, low, high, xtol=1e-10)))


def _frequency_of(scenario: Scenario, name: str) -> float:
    found = [mode.frequency for mode in coupled_modes(scenario) if mode.name == name]
    return found[0] if found else math.nan


def _with_modes(scenario: Scenario, frequency: float, damping: float) -> Scenario:
    """Array modes with other clamped frequencies and dampings, by factors."""
    if frequency == damping == 1.0:
        return scenario
    modes = tuple(
        mode.model_copy(
            update={
                "frequency": frequency * mode.frequency,
                "damping": min(damping * mode.damping, 0.99),
            }
        )
        for mode in scenario.array.modes
    )
    array = scenario.array.model_copy(update={"modes": modes})
    return scenario.model_copy(update={"array": array})


def _with_friction(scenario: Scenario, factor: float) -> Scenario:
    """Coulomb, breakaway and slip ring friction on the output times a factor."""
    if factor == 1.0:
        return scenario
    own: Friction = scenario.friction
    changed: dict[str, object] = {
        "coulomb": factor * own.coulomb, "breakaway": factor * own.breakaway,
    }  # fmt: skip
    if own.slip_ring is not None:
        force = factor * own.slip_ring.contact_force
        changed["slip_ring"] = own.slip_ring.model_copy(update={"contact_force": force})
    return scenario.model_copy(update={"friction": own.model_copy(update=changed)})


def legs_of(profile: RateProfile) -> tuple[Leg, ...]:
    """A profile from rest as legs of ``tracking.profile``; the last one lasts.

    Raises
    ------
    MicrovibError
        Where there are more than ``MAX_LEGS``.
    """
    legs: list[Leg] = []
    rate = 0.0
    for k in range(profile.times.size - 1):
        span = float(profile.times[k + 1] - profile.times[k])
        if span < _NO_DURATION:
            continue
        first, last = float(profile.rates[k]), float(profile.rates[k + 1])
        if first != rate or not legs:
            legs.append(Leg(rate=Si(first), ramp=Si(0.0), hold=Si(0.0)))
        if last == first:
            held = float(legs[-1].hold or 0.0) + span
            legs[-1] = legs[-1].model_copy(update={"hold": held})
        else:
            legs.append(Leg(rate=Si(last), ramp=Si(span), hold=Si(0.0)))
        rate = last
    end = float(profile.rates[-1])
    if end != rate or not legs:
        legs.append(Leg(rate=Si(end), ramp=Si(0.0)))
    kept = [leg for leg in legs if leg.ramp > 0.0 or leg.hold != 0.0]
    kept[-1] = kept[-1].model_copy(update={"hold": None})
    if len(kept) > MAX_LEGS:
        raise MicrovibError(
            f"tracking.profile: {len(kept)} legs are needed; at most {MAX_LEGS} are taken"
        )
    return tuple(kept)


def with_profile(scenario: Scenario, profile: RateProfile) -> Scenario:
    """The scenario with a profile from rest; its record begins where the profile ends."""
    tracking = Tracking(profile=legs_of(profile), clock_ratio=Si(scenario.tracking.clock_ratio))
    record = scenario.record.model_copy(
        update={"settle": float(profile.times[-1]) + scenario.driver.delay, "start": "rest"}
    )
    return scenario.model_copy(update={"tracking": tracking, "record": record})


def recorded(scenario: Scenario, modes: Sequence[CoupledMode]) -> Scenario:
    """The scenario with a record that tells the ``modes`` from each other, without a second drive
    and without noise.
    """
    every = sorted(mode.frequency for mode in coupled_modes(scenario))
    mine = {mode.frequency for mode in modes}
    apart = [b - a for a, b in pairwise(every) if {a, b} & mine and b > a]
    slowest = min(mine)
    wanted = max([_PERIODS_RECORDED / slowest, *(_RESOLVED / gap for gap in apart)])
    record = scenario.record
    duration = max(record.duration, min(wanted, _LONGEST_RECORD))
    return scenario.alone.model_copy(
        update={
            "record": record.model_copy(update={"duration": duration}),
            "friction": scenario.friction.without_noise,
        }
    )


def measure(case: Case, profile: RateProfile) -> tuple[Ringing, ...]:
    """Ringing of each mode of a case at the end of a ``profile`` from rest, by a run of the full model without
    noise of the friction, whose ringing at the rate that follows may come on top.
    """
    run = with_profile(recorded(case.scenario, case.modes), profile)
    try:
        torque = torque_from_rest(run)
    except SimulationError as error:
        return (Ringing(math.nan, math.nan, math.inf, str(error)),) * len(case.names)
    table = find_lines(torque)
    lines = {line.name: line for line in table}
    follows = Tracking(rate=Si(float(profile.rates[-1])), clock_ratio=run.tracking.clock_ratio)
    steady = case.scenario.alone.model_copy(update={"tracking": follows})
    return tuple(
        _ringing(lines.get(mode.name), table.duration, ringing_by_noise(steady, mode.frequency))
        for mode in case.modes
    )


def _ringing(line: Line | None, duration: float, by_noise: float) -> Ringing:
    """Ringing that a line says, of a mode to which noise may add."""
    if line is None:
        return Ringing(math.nan, math.nan, math.inf, "above the passband of the record")
    if line.seen:
        amplitude = line.amplitude_at_start(duration)
        return Ringing(amplitude, line.phase, amplitude + by_noise, line.status)
    if line.status == BELOW_FLOOR:
        return Ringing(math.nan, math.nan, line.hidden + by_noise, line.status)
    return Ringing(math.nan, math.nan, math.inf, line.status)
