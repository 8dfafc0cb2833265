"""States of the hinge of the other wing on a craft, and what they change of the loads that a drive makes.

A run takes the shaft of the wing that it does not turn as held by its linearised drive. Dry friction may
lock that shaft, or a part of the gear's elements; teeth with backlash may be apart; detent torque makes its
motor's spring stiffer or softer where it stands. A load of frequency f in one of these states is to that
in the run as both are for a torque on the shafts of the drive, with the drives linearised
(``microvib.model.drive_states``).

Dry friction that locks a shaft between slides is, for a sine, a damper between none and a rigid one.
Presliding, hysteresis and detent torque are springs. Of both all between their ends are looked at: where two
paths nearly cancel, a damper between leaves less than both ends do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from microvib.model.coupling import receiver_of, require_craft, source_of
from microvib.model.drive_states import DriveStates, drive_states
from microvib.model.linear import CoupledMode
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import Interface

_LOCKED = "spacecraft.second_wing.drive: locked judges it locked"
_SLIDING = "a spacecraft.second_wing.friction without breakaway and slip_ring judges it free"
_EXCHANGED = f"with the wings exchanged, {_LOCKED}"
_SAME_MODE = 2e-3
"""Part of its frequency within which a mode is one that is known."""
_LARGEST = 1e9
"""Ratio that stands for one without bound."""
_INSIDE = 5
"""Frequencies at which a range of them is looked at, beside natural ones."""


@dataclass(frozen=True)
class OtherHinge:
    """Hinge of the other wing, seen from one drive."""

    states: DriveStates
    whose: str
    """Whose shaft it is, such as ``the second wing's``."""
    why: str
    """Causes that may hold the shaft otherwise than its linearised drive, in words."""
    remedy: str
    """Settings by which one state is judged."""

    @property
    def gap(self) -> str:
        """Why nothing is known of lines that differ between states, and what to do; a clause."""
        return (
            f"the state of {self.whose} hinge: {self.why} may hold that shaft otherwise than its linearised"
            f" drive, by which the run has it held ({self.remedy})"
        )

    def ratios(
        self, low: np.ndarray, high: np.ndarray, component: str = "", *, there: bool = False
    ) -> np.ndarray:
        """Least and largest load over all states, over that of the run, between frequencies (m,) and
        (m,) [Hz], (2, m).

        ``component`` is a load on the hub, ``Fx`` to ``Mz``, at the own interface or at that of the other
        wing (``there``); without it the torque about the own drive axis.
        """
        at, first = _frequencies_in(low, high, self._natural_frequencies)
        if not at.size:
            return np.ones((2, 0))
        forces = np.hstack([self.states.on_rotor, self.states.on_output])
        row = self.row(component, there=there)[None, :]
        run = np.abs(self.states.response(at, forces, row))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # without any damping
            found = self.states.extremes(at, forces, row, between=False) / run
        found = np.minimum(np.nan_to_num(found[:, :, 0], nan=1.0, posinf=_LARGEST), _LARGEST)
        least = np.minimum.reduceat(found[0].min(axis=1), first)
        return np.array([least, np.maximum.reduceat(found[1].max(axis=1), first)])

    def modes(self, known: Iterable[CoupledMode], least: float) -> Iterator[CoupledMode]:
        """Modes of other states, beside those that are ``known``, at which the torque of the drive may be
        more than ``least`` times that of the run.
        """
        seen = [mode.frequency for mode in known]
        for f, half_width in sorted(self.states.natural_frequencies.tolist()):
            if any(abs(f - x) <= _SAME_MODE * x for x in seen):
                continue
            seen.append(f)
            if self.ratios(np.array([f]), np.array([f]))[1, 0] > least:
                name = f"mode of {f:.5g} Hz in another state of {self.whose} hinge"
                yield CoupledMode(name, f, half_width / f, None)

    @cached_property
    def _natural_frequencies(self) -> np.ndarray:
        return np.sort(self.states.natural_frequencies[:, 0])

    def row(self, component: str | Interface, *, there: bool) -> np.ndarray:
        """Momentum at an interface by the rates of the coordinates, of one component or about the drive
        axis of an ``Interface``, without one about the own, (n,).
        """
        hub, own = receiver_of(self.states.scenario), source_of(self.states.scenario)
        wing, root, before = own, hub.root, hub.root.shape[1]
        if there:
            assert hub.second is not None
            assert hub.second_root is not None
            wing, root, before = hub.second, hub.second_root, before + own.G.shape[1]
        along = np.zeros(6)
        if isinstance(component, str) and component:
            along[COMPONENTS.index(component)] = 1.0
        else:
            own_interface = require_craft(self.states.scenario).spacecraft.interface
            along[3:] = (component or own_interface).axis
        found = np.zeros(self.states.on_rotor.shape[0])
        found[: root.shape[1]] = along @ wing.mass @ root
        found[before : before + wing.G.shape[1]] = along @ wing.G
        return found


def _frequencies_in(
    low: np.ndarray, high: np.ndarray, natural: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies at which ranges (m,) are looked at, one range behind another, and where each begins."""
    count = np.where(high > low, _INSIDE, 1)
    each = [
        np.concatenate([np.linspace(a, b, n), natural[(natural > a) & (natural < b)]])
        for a, b, n in zip(low.tolist(), high.tolist(), count.tolist(), strict=True)
    ]
    first = np.cumsum([0, *(len(x) for x in each)])[:-1]
    return np.concatenate([np.zeros(0), *each]), first


@lru_cache(maxsize=8)  # asked for by each judgement of one run
def other_hinge(scenario: Scenario, *, first: bool = True) -> OtherHinge | None:
    """The other wing's hinge; None where its linearised drive is all that holds its shaft.

    Not ``first``: the scenario is that of a second wing's drive, whose other wing is the first.
    """
    other = scenario.other_wing
    if other is None or scenario.second_is_locked:
        return None
    steps = bool(other.rate) if not first else scenario.driven_wing is not None and bool(other.rate)
    states = drive_states(_with_currents(scenario), own=False, steps=steps)
    if states is None:
        return None
    causes = _causes(other, steps=steps)
    if first:
        return OtherHinge(states, "the second wing's", causes, f"{_LOCKED}, {_SLIDING}")
    return OtherHinge(states, "the first wing's", causes, _EXCHANGED)


def torque_at_other_interface(scenario: Scenario, frequency: np.ndarray) -> np.ndarray:
    """Torque about the drive axis of the other wing, at its interface, over that about the own drive's at
    each frequency (m,) [Hz], (m,).

    By a torque on the rotor of the drive, while the other one stands.
    """
    wing = require_craft(scenario).spacecraft.second_wing
    assert wing is not None
    return _over_torque(scenario, frequency, wing.interface, there=True)


def load_over_torque(
    scenario: Scenario, frequency: np.ndarray, component: str, *, there: bool
) -> np.ndarray:
    """Load on the hub, ``Fx`` to ``Mz``, at the own interface or at that of the other wing (``there``), over
    the torque about the own drive's axis at each frequency (m,) [Hz], (m,); as ``torque_at_other_interface``.
    """
    return _over_torque(scenario, frequency, component, there=there)


def _over_torque(
    scenario: Scenario, frequency: np.ndarray, component: str | Interface, *, there: bool
) -> np.ndarray:
    seen = OtherHinge(DriveStates(_with_currents(scenario), ()), "", "", "")
    rows = np.array([seen.row("", there=False), seen.row(component, there=there)])
    moved = np.abs(seen.states.response(frequency, seen.states.on_rotor, rows))[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(moved[:, 1] / moved[:, 0], posinf=_LARGEST))


def _with_currents(scenario: Scenario) -> Scenario:
    """A scenario whose driver gives currents: windings are taken for the spring of these."""
    if scenario.driver.drive == "current":
        return scenario
    driver = scenario.driver.model_copy(update={"drive": "current"})
    return scenario.model_copy(update={"driver": driver})


def _causes(other: Scenario, *, steps: bool) -> str:
    """Causes that may hold a shaft otherwise than its linearised drive."""
    reducer = other.reducer
    torque = other.friction.largest_torque + reducer.ratio * other.motor.friction.largest_torque
    acts = {
        f"dry friction of up to {torque:.3g} N m": torque > 0.0,
        "hysteresis of its gear": reducer.hysteresis_torque > 0.0,
        "backlash": bool(reducer.backlash),
        "detent torque": other.motor.detent_stiffness > 0.0 and not steps,
    }
    return " or ".join(what for what, does in acts.items() if does) or "currents of its motor"
