"""The motion history: labelled channels with units, and how it was computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from microvib.errors import ChannelError, expect_channel
from microvib.former_names import FormerName
from microvib.model.rigid import COMPONENTS
from microvib.model.scenario import Scenario
from microvib.model.spacecraft import INTERFACE, SECOND_INTERFACE
from microvib.solve.channels import (
    ALL_CHANNELS,
    CHANNELS,
    LINE_OF_SIGHT,
    LOADS,
    SECOND_LOADS,
    TIME,
    Channel,
)
from microvib.solve.command import Command
from microvib.solve.on_craft import channel_on_craft, evaluate_outputs, hub_motion, missing_channels
from microvib.text_tables import counted

INTERFACE_LOAD_CHANNELS = ("alpha_l", "eta", "eta_rate", "T_d")
"""Channels of which the loads at the interface are made."""


BALANCE_TOLERANCE = 1e-3
"""Largest allowed residual of a balance of momentum or of energy; forms of one torque may differ by
``ROUNDING``.
"""
ROUNDING = 1e-9
JOULE_HEAT_TOLERANCE = 5e-6
"""Part of the electrical energy that its balance may leave over besides, however little passes the
shaft: supply and Joule heat are sums of powers over the steps, each with its own error. Of 600
random drives at most 2.9e-6 where that counts (benchmarks/invariants.py)."""


@dataclass(frozen=True)
class Invariants:
    """Balances that hold for any parameters, and how well they did."""

    torque_forms: float
    """Largest difference of the two forms of T_d over the largest T_d (algebra: rounding is
    expected).
    """
    momentum: float
    """Mean torque that the change of momentum leaves over, ``|Delta L + integral of T_d dt| / t``,
    over the largest T_d.
    """
    energy: float
    """``|energy in - stored - dissipated|`` over the electrical energy supplied."""
    energy_mechanical: float
    """Energy residual over the energy that passed the shaft of the motor (without Joule heat, so the
    stricter figure).
    """
    energy_in: float
    energy_dissipated: float
    energy_stored: float

    @property
    def bars(self) -> dict[str, float]:
        """Tolerance of each invariant; of ``energy_mechanical`` more where hardly any energy passes
        the shaft, by ``JOULE_HEAT_TOLERANCE``.
        """
        supplied = (
            self.energy_mechanical / self.energy if self.energy > 0.0 else 0.0
        )  # over what passes the shaft
        return {
            "torque_forms": ROUNDING,
            "momentum": BALANCE_TOLERANCE,
            "energy": BALANCE_TOLERANCE,
            "energy_mechanical": BALANCE_TOLERANCE + JOULE_HEAT_TOLERANCE * supplied,
        }

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of those that do not hold, or are not known."""
        return tuple(name for name, bar in self.bars.items() if not getattr(self, name) <= bar)


@dataclass(frozen=True)
class InitialState:
    """Where a run begins, so that it can be run again."""

    state: np.ndarray
    """State, friction modes and clock of the kernel, one after another."""
    command: Command


@dataclass(frozen=True)
class StepCount:
    """Full steps of a pulsed drive over a run, each judged when the next begins."""

    judged: int
    lost: int
    """Full steps that left the rotor behind its command."""
    gained: int
    """Full steps that left it ahead."""
    first: int
    """Number of the first step that was not made as commanded, from 1; 0 where all were."""

    def __str__(self) -> str:
        judged = counted(self.judged, "step")
        if not self.judged:
            return "no step judged: none is followed by another"
        if not self.first:
            return f"{judged} judged, none lost"
        gained = f", {self.gained} gained" if self.gained else ""
        return f"{judged} judged, {self.lost} lost{gained}; the first not made is step {self.first}"


STEP_KEYS = ("steps_judged", "steps_lost", "steps_gained", "first_step_not_made")
"""Names of the counts of steps in the solver's account, in the order of ``StepCount``."""


@dataclass(frozen=True)
class Motion:
    """Sampled motion of one scenario: channels by name, each (n,), modal ones (n, s), at
    ``sample_rate`` [Hz].

    Where a second wing is driven, what the hub feels and does is the sum of both drives' runs, and
    ``channels`` are the first's.
    """

    scenario: Scenario
    time: np.ndarray
    """Times from the start of the command [s], (n,)."""
    channels: dict[str, np.ndarray]
    invariants: Invariants
    solver: dict[str, Any] = field(default_factory=dict)
    beginning: InitialState | None = None
    """None in a motion that was read from a file."""
    second_wing: Motion | None = None
    """Run of the second wing's drive, where it is driven."""
    beside = FormerName("second_wing")

    def __getitem__(self, name: str) -> np.ndarray:
        own = channel_of(self.channels, name, self.scenario, self.time)
        there = SECOND_RUN_CHANNELS.get(name)
        if self.second_wing is None or there is None:
            return own
        return own + self.second_wing[there]

    @property
    def alone(self) -> Motion:
        """Motion of the first drive alone."""
        return replace(self, second_wing=None)

    def __repr__(self) -> str:
        duration, kept = self.time.size / self.sample_rate, self._ipython_key_completions_()
        return (
            f"Motion of {self.scenario.brief}\n"
            f"  {self.time.size} samples at {self.sample_rate:g} Hz, {duration:g} s,"
            f" start: {self.scenario.record.start}\n"
            f"  {counted(len(kept), 'channel')}: {', '.join(kept)}"
        )

    @property
    def steps(self) -> StepCount | None:
        """Steps that a pulsed drive made, lost and gained since its run began; None of other drives."""
        return step_count(self.solver)

    def _ipython_key_completions_(self) -> list[str]:
        return [*self.channels, *_derivable_channels(self.channels, self.scenario)]

    @property
    def sample_rate(self) -> float:
        """Samples per second [Hz]."""
        return self.scenario.record.sample_rate

    def interface_loads(self) -> np.ndarray | None:
        """Compute the loads on the spacecraft at the interface.

        The drive axis carries T_d; the others are what modes and interface inertia push back with.
        On a fixed base their axes are the array's, on a craft the hub's.

        Returns
        -------
        numpy.ndarray or None
            Fx Fy Fz [N], Mx My Mz [N m], (n, 6); None without 6 x s participation.
        """
        if self.second_wing is not None:
            return np.column_stack([self[name] for name in COMPONENTS])
        return interface_loads(self.channels, self.scenario)

    def hub(self, point: str = "interface", *, accelerations: bool = False) -> np.ndarray:
        """Compute how a named point of the craft moves, without the mean motion that the command
        makes.

        Parameters
        ----------
        point : str
            Name of the point.
        accelerations : bool
            Give second derivatives, [m/s^2] and [rad/s^2].

        Returns
        -------
        numpy.ndarray
            Displacement [m] and rotation [rad], (n, 6), hub axes.

        Raises
        ------
        ChannelError
            Without a spacecraft, or for a point that it has not.
        """
        if self.scenario.craft is None:
            raise ChannelError(
                "this motion is one on a fixed base; a scenario with a spacecraft is expected"
            )
        own = hub_motion(
            self.scenario.craft, point, self.channels, self.scenario, self.time, accelerations
        )
        if self.second_wing is None:
            return own
        named = {p.name for p in self.scenario.craft.spacecraft.hub.points}
        if point in named:
            there = point
        else:
            there = {INTERFACE: SECOND_INTERFACE, SECOND_INTERFACE: INTERFACE}.get(point, point)
        return own + self.second_wing.hub(there, accelerations=accelerations)

    def variables(self) -> Iterator[tuple[Channel, np.ndarray]]:
        """Iterate over every channel with its samples, loads at the interface among them where they
        are known.

        Yields
        ------
        channel : Channel
            Name, unit and meaning.
        samples : numpy.ndarray
            Samples, (n,) or modal (n, s).
        """
        yield from ((ALL_CHANNELS[name], x) for name, x in self.channels.items())
        loads = self.interface_loads()
        if loads is not None:
            yield from zip(LOADS.values(), loads.T, strict=True)
        derived = [
            name
            for name in _derivable_channels(self.channels, self.scenario)
            if name in (*SECOND_LOADS, "los_x", "los_y")
        ]
        yield from ((ALL_CHANNELS[name], self[name]) for name in derived)

    @property
    def dataset(self) -> Any:
        """Motion as an ``xarray.Dataset`` with dimensions ``time`` and ``mode`` and a unit on
        every variable.
        """
        import xarray as xr

        data = {
            channel.name: (
                ("time", "mode")[: x.ndim],
                x,
                {"units": channel.unit, "long_name": channel.meaning},
            )
            for channel, x in self.variables()
        }
        coords = {"time": ("time", self.time, {"units": TIME.unit, "long_name": TIME.meaning})}
        return xr.Dataset(
            data, coords, {"title": self.scenario.title, "sample_rate": self.sample_rate}
        )


def step_count(solver: Mapping[str, Any]) -> StepCount | None:
    """Steps that a solver's account tells of; None where it tells of none."""
    if not set(STEP_KEYS) <= set(solver):
        return None
    return StepCount(*(int(solver[key]) for key in STEP_KEYS))


SECOND_RUN_CHANNELS = {
    **dict(zip(COMPONENTS, SECOND_LOADS, strict=True)),
    **dict(zip(SECOND_LOADS, COMPONENTS, strict=True)),
    **{name: name for name in LINE_OF_SIGHT},
}
"""Channels that add up over two wings: of each its name in the second's run, where the first is the
second.
"""


def interface_loads(channels: Mapping[str, np.ndarray], scenario: Scenario) -> np.ndarray | None:
    """Loads on the spacecraft, (n, 6), of which ``channels`` and the array tell; None where they do
    not (docs/signs.md).
    """
    array, craft = scenario.array, scenario.craft
    if craft is not None:
        if missing_channels(channels, "Fx"):
            return None
        return evaluate_outputs(craft.loads(), channels, scenario)
    P = array.interface
    if P is None or not set(INTERFACE_LOAD_CHANNELS) <= set(channels):
        return None
    alpha = channels["alpha_l"]
    w_rate = -(channels["eta_rate"] * array.D + channels["eta"] * array.Lambda)
    acceleration = w_rate - np.outer(alpha, array.H)
    loads: np.ndarray = -acceleration @ P.T
    if array.coupling is not None:
        loads -= np.outer(alpha, array.coupling)
    loads[:, 3 + "xyz".index(array.drive_axis)] = channels["T_d"]
    return loads


def _load_on_fixed_base(
    name: str, channels: Mapping[str, np.ndarray], scenario: Scenario, time: np.ndarray | None
) -> np.ndarray | None:
    """A load at the interface, (n,); None where there is none of it."""
    if name in COMPONENTS:
        loads = interface_loads(channels, scenario)
    else:
        loads = None
    if loads is None:
        return None
    return loads[:, COMPONENTS.index(name)]


def unit_of(name: str) -> str:
    """Unit of a channel or of a load at the interface."""
    return ALL_CHANNELS[name].unit


def record_bytes(scenario: Scenario) -> float:
    """Size of all samples of a record, times included [bytes]."""
    return 8.0 * scenario.record.samples * (len(CHANNELS) + 1 + 2 * scenario.load.H.size)


def channel_of(
    channels: Mapping[str, np.ndarray], name: str, scenario: Scenario, time: np.ndarray
) -> np.ndarray:
    """A channel by its name, (n,) or modal (n, s), a load at the interface or an angle of the line
    of sight at its times [s], (n,).

    ChannelError where there is none of it.
    """
    expect_channel(name)
    if name in channels:
        return channels[name]
    if scenario.craft is None:
        derived = _load_on_fixed_base
    else:
        derived = channel_on_craft
    values = derived(name, channels, scenario, time)
    if values is not None:
        return values
    raise ChannelError(
        f"channel '{name}' is not in this"
        f" motion{_missing_channel_reason(channels, name, scenario)}; there are"
        f" {_names(channels, scenario)}"
    )


def scalar_channel(
    channels: Mapping[str, np.ndarray], name: str, scenario: Scenario, time: np.ndarray
) -> np.ndarray:
    """Channel with one value at a time, (n,): ChannelError for a modal channel."""
    values = channel_of(channels, name, scenario, time)
    if values.ndim != 1:
        raise ChannelError(
            f"channel '{name}' has a column for each mode; there are {_names(channels, scenario)}"
        )
    return values


def _missing_channel_reason(
    channels: Mapping[str, np.ndarray], name: str, scenario: Scenario
) -> str:
    if name in SECOND_LOADS and (scenario.craft is None or scenario.craft.second is None):
        return ", whose scenario has no spacecraft with a second_wing"
    if (
        scenario.craft is not None
        and name in (*COMPONENTS, *SECOND_LOADS, *LINE_OF_SIGHT)
        and missing_channels(channels, name)
    ):
        return f", of which {', '.join(missing_channels(channels, name))} were not kept"
    if name in LINE_OF_SIGHT:
        return ", whose scenario has no spacecraft with a line_of_sight"
    if name not in COMPONENTS:
        return ""
    if not set(INTERFACE_LOAD_CHANNELS) <= set(channels):
        return f", of which {', '.join(INTERFACE_LOAD_CHANNELS)} were not kept"
    return ", whose array has no participation in six components (interface_participation of its modes)"


def _names(channels: Mapping[str, np.ndarray], scenario: Scenario) -> str:
    """Channels that are one value at a time, in words."""
    own = (key for key, values in channels.items() if values.ndim == 1)
    return ", ".join((*own, *_derivable_channels(channels, scenario)))


def _derivable_channels(channels: Mapping[str, np.ndarray], scenario: Scenario) -> Iterator[str]:
    """Names of what the kept channels tell of the spacecraft."""
    first, at = {key: values[:1] for key, values in channels.items()}, np.zeros(1)
    if scenario.craft is None:
        derived = _load_on_fixed_base
    else:
        derived = channel_on_craft
    for name in (*COMPONENTS, *SECOND_LOADS, *LINE_OF_SIGHT):
        if derived(name, first, scenario, at) is not None:
            yield name
