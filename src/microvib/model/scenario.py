"""The assembly: a SADA, its load, its command and what is recorded of it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from fractions import Fraction
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from microvib.errors import ScenarioError, did_you_mean, expect, expect_mapping
from microvib.model.array import Array
from microvib.model.compensation import largest_slope
from microvib.model.craft import Craft, craft_of, shaft_load
from microvib.model.driver import NO_IMPERFECTIONS, Driver
from microvib.model.friction import Friction
from microvib.model.load import Load
from microvib.model.motor import Motor
from microvib.model.part import Part, flatten_parameters, nudged_part, to_plain_data
from microvib.model.record import Record, Solver, Start
from microvib.model.reducer import KinematicError, Reducer
from microvib.model.reference import Reference
from microvib.model.sentences import validate_part
from microvib.model.spacecraft import DRIVE_GROUPS, HELD_WING_SETTINGS, Spacecraft
from microvib.model.tracking import Tracking
from microvib.text_tables import counted
from microvib.units import GivenQuantity, Quantity, quantity

if TYPE_CHECKING:
    from typing_extensions import TypeIs

TEXT_KEYS = ("title", "source", "sources", "reference")  # fields that hold no parameters
ASSUMED_UNLESS_SOURCED = ("motor.eddy_damping", "friction.harness")
"""Keys and groups that hardly any data sheet gives: assumed, unless ``sources`` says where they come
from themselves, whatever the source of the scenario, of its motor or of its friction is.
"""
ASSUMED_SOURCE = "assumed: no source is given"
USER_SOURCE = "set by the user"
"""Source of a value that was changed: it no longer comes from where the scenario's does."""


class Scenario(Part):
    """One drive, one array, one command, one record. Frozen; ``with_`` makes a changed copy."""

    title: str = Field(default="", max_length=500, description="short title")
    source: str = Field(default="", max_length=2000, description="source of the values")
    sources: dict[str, str] = Field(
        default_factory=dict,
        description="source and status of single keys or groups, as dotted key: text",
    )
    motor: Motor
    driver: Driver
    reducer: Reducer
    friction: Friction = Field(description="friction on the output shaft, against omega_l")
    array: Array
    tracking: Tracking
    record: Record
    solver: Solver = Solver()
    spacecraft: Spacecraft | None = Field(
        default=None, description="spacecraft that carries the drive; null is a fixed base"
    )
    reference: Reference | None = Field(
        default=None, description="measured lines of this drive, to compare with those of a run"
    )

    def _consistency_errors(self) -> Iterator[str]:
        yield from self._array_errors()
        yield from self._wing_errors()
        yield from self._drive_errors()
        yield from (
            f"sources: '{key}' is not a key of this scenario"
            for key in self.sources
            if not self._has(key)
        )

    def _array_errors(self) -> Iterator[str]:
        if self.spacecraft is not None and (
            self.array.mass is None or self.array.interface is None
        ):
            if self.array.interface is None:
                missing = "interface_participation of every mode"
            else:
                missing = "rigid_body"
            yield (
                f"array: has no {missing}, but a spacecraft needs all six components; give"
                " interface_participation of all modes and"
                " rigid_body, or take the array from finite elements (array.fem, array.from)"
            )
        if (
            not self.reducer.rigid
            and self.reducer.output_inertia + self.array.J_h < 1e-6 * self.array.inertia
        ):
            yield self._has_negligible_inertia(self.reducer.output_inertia + self.array.J_h)

    def _has_negligible_inertia(self, rigid: float) -> str:
        return (
            "array: almost no inertia is rigidly attached to the shaft (J_h and"
            " reducer.output_inertia add up to"
            f" {rigid:.3g} kg*m^2, under a millionth of the inertia); a compliant"
            " reducer needs some; lower the modes' participation, give reducer.output_inertia or"
            " use reducer.stiffness: rigid"
        )

    def _drive_errors(self) -> Iterator[str]:
        if not self.reducer.rigid and self.output_inertia < 1e-6 * self.array.inertia:
            yield self._has_negligible_inertia(self.output_inertia)
        yield from self._noise_errors()
        yield from self._rotor_offset_errors()
        if self.driver.pulsed:
            yield from self._pulse_errors()
        if self.driver.drive == "current":
            yield from self._current_loop_errors()
        yield from self._phase_errors()
        yield from self._second_plane_errors()
        yield from self._instant_errors()
        yield from self._supply_errors()

    def _noise_errors(self) -> Iterator[str]:
        noise, rate = self.friction.torque_noise, self.record.sample_rate
        if not noise:
            return
        low, high = noise.band(rate)
        if low >= high:
            yield (
                f"friction.torque_noise.lowest: {low:g} Hz is not below half the sample rate,"
                f" {0.5 * rate:g} Hz, where noise"
                " without a highest frequency ends; lower it, or give friction.torque_noise.highest"
            )

    def _rotor_offset_errors(self) -> Iterator[str]:
        half_turn = 0.5 * self.driver.beats  # [full steps]
        if not abs(self.record.rotor_offset) < half_turn:
            yield (
                f"record.rotor_offset: {self.record.rotor_offset:g} full steps are half an"
                " electrical turn or more, from where the"
                f" rotor aligns with another tooth; it must be between -{half_turn:g} and"
                f" {half_turn:g}"
            )

    def _current_loop_errors(self) -> Iterator[str]:
        driver = self.driver
        if driver.proportional_gain != 0.0:
            return
        if driver.integral_gain == 0.0:
            yield "driver: proportional_gain and integral_gain are both 0; one of them must be greater, or no current flows"
        if driver.supply_voltage is not None:
            yield "driver: proportional_gain is 0 with a supply_voltage; it must be greater, since its anti-windup needs it"

    def _phase_errors(self) -> Iterator[str]:
        driver, motor = self.driver, self.motor
        if motor.phases == 2:
            return
        if driver.supply_voltage is not None and not driver.pulsed:
            yield (
                f"driver: supply_voltage {driver.supply_voltage:g} V limits each of the"
                f" {motor.phases} phases, which the two-axis equations cannot represent; leave it out"
            )
        if driver.beats % motor.phases:
            yield (
                f"driver: beats {driver.beats} is not allowed with {motor.phases} phases; a"
                " multiple of their number is expected,"
                f" such as {motor.full_steps} for full steps"
            )

    def _supply_errors(self) -> Iterator[str]:
        driver, motor = self.driver, self.motor
        largest = driver.largest_reference(motor)
        needed = motor.winding_resistance * largest
        if driver.voltage_limit < needed:
            yield (
                f"driver: supply_voltage {driver.supply_voltage:g} V cannot drive {largest:g} A"
                " through"
                f" {motor.winding_resistance:g} ohm; it must be at least {needed:g} V"
            )

    def _pulse_errors(self) -> Iterator[str]:
        driver, motor = self.driver, self.motor
        if motor.phases != 2:
            yield (
                f"driver.drive: pulse is not known of a motor with {motor.phases} phases; 2 are"
                " expected"
            )
        fastest = max(abs(float(rate)) for rate in self.tracking.breakpoints()[1])
        per_second = driver.driving_frequency(motor, self.reducer.ratio * fastest)
        on_time = driver.on_time or 0.0
        if on_time * per_second > 1.0 + 1e-9:
            yield (
                f"driver.on_time: {1e3 * on_time:g} ms is longer than a step, which takes"
                f" {1e3 / per_second:.6g} ms at the fastest rate of the command; shorten it, or lower"
                " the rate"
            )

    def _instant_errors(self) -> Iterator[str]:
        """Compensation that would turn back, and parts of a microstep later than the next one."""
        driver = self.driver
        slope = largest_slope(driver.compensation)
        if slope >= 1.0 / self.reducer.ratio:
            yield (
                f"driver.compensation: the sum of order x amplitude is {slope:g} rad; it must be below"
                f" 1/ratio, {1.0 / self.reducer.ratio:g} rad, or microsteps would come out of order"
            )
            return
        lasts, most = driver.shape.lasts, self.highest_driving_frequency
        if driver.compensates:
            where = "at the fastest rate of the command and the steepest driver.compensation"
        else:
            where = "at the fastest rate of the command"
        if lasts * most > 1.0 - 1e-9:
            yield (
                f"driver.microstep_shape.{len(driver.microstep_shape) - 1}.after: {1e3 * lasts:g} ms is"
                f" not before the next microstep, which comes after {1e3 / most:.6g} ms {where};"
                " shorten it, or lower the rate"
            )

    def _second_plane_errors(self) -> Iterator[str]:
        """Flux harmonics of five phases with currents in their second plane that are more than the
        back-EMF makes.
        """
        driver = self.driver
        orders = self.motor.second_plane_orders
        if not orders:
            return
        if driver.drive == "voltage":
            made = "voltages without a current loop (driver.drive: voltage) let flow"
        elif driver.imperfections != NO_IMPERFECTIONS:
            made = "errors of the driver (driver.imperfections) make"
        else:
            return
        yield (
            f"motor.flux_harmonics: order {orders[0]} of five phases acts on currents in their second"
            f" plane, which {made} and the two-axis equations cannot represent; leave out one of both"
        )

    def _wing_errors(self) -> Iterator[str]:
        other, craft = self.other_wing, self.spacecraft
        if other is None or craft is None or craft.second_wing is None:
            return
        for part in (other._array_errors, other._drive_errors):
            yield from (f"spacecraft.second_wing: {text}" for text in part())
        wing = craft.second_wing
        driven = {other.driver.drive, *([self.driver.drive] if wing.drive == "driven" else [])}
        for drive in sorted(driven - {"current"}):
            yield (
                "spacecraft.second_wing: a held shaft is modelled by the stiffness and "
                "damping of its drive, which needs a current loop (not "
                f"driver.drive: {drive}); use drive: current, in both drives if both step"
            )
        if wing.stagger and not other.driving_frequency:
            yield (
                f"spacecraft.second_wing.stagger: {wing.stagger:g} microsteps are no fixed "
                "delay if the rate is zero or changes in the record; leave it out, or track at a constant rate"
            )
        late = other.driver.delay - self.driver.delay
        if wing.stagger > 1.0 and self.record.start == "rest" and late >= self.record.settle:
            yield (
                f"spacecraft.second_wing.stagger: {wing.stagger:g} microsteps take {late:.4g} s,"
                " and record.settle is"
                f" {self.record.settle:g} s; it must be longer, or record.start be steady"
            )

    def __repr__(self) -> str:
        motor, driver, record = self.motor, self.driver, self.record
        rows = (
            f"Scenario {self._name}",
            f"drive: {motor.phases} phases, {motor.rotor_teeth} rotor teeth, {driver.microsteps}"
            f" microsteps a full step, gear {self.reducer.ratio:g}:1",
            f"rate: {self._rate_in_words}",
            f"array: {self._array_in_words}",
            f"record: {record.duration:g} s at {record.sample_rate:g} Hz after {record.settle:g} s,"
            f" start: {record.start}",
        )
        return "\n  ".join(rows)

    def __str__(self) -> str:
        return repr(self)

    @property
    def brief(self) -> str:
        """Title, rate and array in a line, by which results name the scenario that they are of."""
        rate, array = self._rate_in_words.partition(",")[0], self._array_in_words.partition(":")[0]
        return f"{self._name}, {rate}, array of {array}"

    @property
    def _name(self) -> str:
        if self.title:
            return f"'{self.title}'"
        return "an untitled scenario"

    @property
    def _rate_in_words(self) -> str:
        """Rate of the array and microsteps per second."""
        rate = self.rate
        if rate is None:
            return "rate that changes in the record"
        return f"{math.degrees(rate):.4g} deg/s, {self.driving_frequency:.4g} microsteps/s"

    @property
    def _array_in_words(self) -> str:
        """Inertia and modes of the array, and what carries it."""
        modes = [mode.frequency for mode in self.array.modes]
        text = f"{self.array.inertia:.4g} kg m², {counted(len(modes), 'mode')}"
        if modes:
            text += f": {', '.join(f'{f:.4g}' for f in modes[:3])}{', ...' if modes[3:] else ''} Hz"
        if self.spacecraft is not None:
            text += ", on a spacecraft"
        return text

    def __hash__(self) -> int:
        return hash(
            tuple(getattr(self, name) for name in type(self).model_fields if name != "sources")
        )  # a dict

    @property
    def rotor_inertia(self) -> float:
        """J_m = J_r + J_wg [kg m^2]."""
        return self.motor.rotor_inertia + self.reducer.input_inertia

    @property
    def output_inertia(self) -> float:
        """J_flex + J_h, all that is rigid on the output [kg m^2]; on a spacecraft, what is in none
        of its modes.
        """
        return self.load.output_left

    @property
    def load(self) -> Load:
        """Structure on the two shafts: the array on a fixed base, or with the craft that carries
        the drive.
        """
        return shaft_load(self.array, self.mounted, self.reducer.output_inertia, self.rotor_inertia)

    @property
    def craft(self) -> Craft | None:
        """Drive, array and hub with both hinges locked; None without a ``spacecraft``."""
        return craft_of(self.array, self.mounted, self.reducer.output_inertia, self.rotor_inertia)

    @property
    def mounted(self) -> Spacecraft | None:
        """The spacecraft with all that its second wing takes over from the first."""
        craft = self.spacecraft
        if craft is None or craft.second_wing is None:
            return craft
        wing = craft.second_wing
        first = {name: getattr(self, name) for name in DRIVE_GROUPS} | {
            "friction": self.friction.with_new_seed
        }
        taken: dict[str, Any] = {
            name: group for name, group in first.items() if getattr(wing, name) is None
        }
        if wing.array_angle is None:
            taken["array_angle"] = math.copysign(1.0, craft.second_sense) * craft.array_angle
        return craft.model_copy(update={"second_wing": wing.model_copy(update=taken)})

    @property
    def other_wing(self) -> Scenario | None:
        """The second wing's drive on the same craft, on which the first is now the second and
        holds; None where there is one wing.

        It steps as ``tracking``, ``clock_ratio`` and ``stagger`` say, whether ``drive`` is driven
        or held; its noise is its own.
        """
        craft = self.mounted
        if craft is None or craft.second_wing is None:
            return None
        wing = craft.second_wing
        tracking = wing.tracking or (
            self.tracking if craft.second_sense > 0.0 else self.tracking.reversed
        )
        tracking = tracking.model_copy(
            update={"clock_ratio": tracking.clock_ratio * wing.clock_ratio}
        )
        own = {name: getattr(wing, name) for name in DRIVE_GROUPS}
        first = {name: getattr(self, name) for name in DRIVE_GROUPS}
        if self.title:
            title = f"{self.title}, second wing"
        else:
            title = "second wing"
        update: dict[str, Any] = {
            "title": title,
            "sources": {},
            "reference": None,
            "spacecraft": craft.from_second(first),
            "tracking": tracking,
        }
        other = self.model_copy(update=own | update)
        f_d = other.driving_frequency
        if not wing.stagger or not f_d:
            return other
        late = other.driver.model_copy(update={"delay": other.driver.delay + wing.stagger / f_d})
        return other.model_copy(update={"driver": late})

    @property
    def driven_wing(self) -> Scenario | None:
        """``other_wing`` where its drive steps; None where it holds."""
        if self.spacecraft is None:
            wing = None
        else:
            wing = self.spacecraft.second_wing
        if wing is None or wing.drive != "driven":
            return None
        return self.other_wing

    @property
    def second_is_locked(self) -> bool:
        """Whether there is a second wing whose shaft does not turn at all."""
        wing = None if self.spacecraft is None else self.spacecraft.second_wing
        return wing is not None and wing.drive == "locked"

    @property
    def alone(self) -> Scenario:
        """Scenario of this drive alone: a second wing, if there is one, is held."""
        craft = self.spacecraft
        if self.driven_wing is None or craft is None or craft.second_wing is None:
            return self
        wing = craft.second_wing.model_copy(update=HELD_WING_SETTINGS)
        return self.model_copy(
            update={"spacecraft": craft.model_copy(update={"second_wing": wing})}
        )

    def at_angle(self, angle: GivenQuantity) -> Scenario:
        """Turn the array to an angle, on a craft.

        A second wing without ``array_angle`` turns with it; a driven one with its own does by its
        rate, from where it is. Friction over the angle turns with the first array's shaft; its
        ``roughness``, a random field, is drawn alike at every angle.

        Parameters
        ----------
        angle : str or Si
            The angle, such as ``"30 deg"``.

        Returns
        -------
        Scenario
            The changed copy.
        """
        craft = self.spacecraft
        assert craft is not None
        angle = quantity("angle", angle, "rad", example="deg")
        turn = float(angle) - craft.array_angle
        update: dict[str, Any] = {"array_angle": angle}
        wing, other = craft.second_wing, self.driven_wing
        if (
            wing is not None
            and wing.array_angle is not None
            and other is not None
            and self.rate
            and other.rate
        ):
            there = wing.array_angle + turn * other.rate / self.rate
            update["second_wing"] = wing.model_copy(update={"array_angle": there})
        return self.model_copy(
            update={
                "spacecraft": craft.model_copy(update=update),
                "friction": self.friction.turned(turn),
            }
        )

    @property
    def has_memory(self) -> bool:
        """Whether a friction, the gear or the harness remembers how it got there (``presliding``,
        ``hysteresis``, ``backlash``).
        """
        reducer, harness = self.reducer, self.friction.harness
        return bool(
            self.motor.friction.memory
            or self.friction.memory
            or reducer.memory
            or reducer.backlash
            or (harness is not None and harness.memory)
        )

    @property
    def rate(self) -> float | None:
        """Rate of the array [rad/s] while it is recorded, or None where it changes."""
        return self.tracking.constant_rate(
            self.record.settle, self.record.settle + self.record.duration
        )

    @property
    def driving_frequency(self) -> float | None:
        """Microsteps per second f_d [Hz] while recording (Eq. 26), or None where the rate changes."""
        rate = self.rate
        if rate is None:
            return None
        return self.driver.driving_frequency(self.motor, self.reducer.ratio * rate)

    @property
    def highest_driving_frequency(self) -> float:
        """Most microsteps per second [Hz] at any time, between two that follow each other; with
        ``driver.compensation`` a bound.
        """
        fastest = float(np.max(np.abs(self.tracking.breakpoints()[1])))
        evenly = self.driver.driving_frequency(self.motor, self.reducer.ratio * fastest)
        return evenly / (1.0 - self.reducer.ratio * largest_slope(self.driver.compensation))

    @property
    def rotor_harmonics(self) -> tuple[KinematicError, ...]:
        """Harmonics of the rotor's turn: errors of the gear, and compensation of orders that these do
        not have.
        """
        errors = self.reducer.errors
        known = {one.order for one in errors}
        added = {
            one.order: KinematicError(
                Fraction(one.order),
                one.amplitude,
                one.phase,
                f"{'rotor' if self.reducer.train else 'wave_generator'}_{one.order}",
                f"order {one.order}",
                "compensation",
            )
            for one in self.driver.compensation
            if one.order not in known
        }
        return (*errors, *added.values())

    def with_(self, changes: dict[str, Any] | None = None, **groups: Any) -> Scenario:
        """Make a changed copy.

        Parameters
        ----------
        changes : dict, optional
            Dotted keys to values as in a file: text with a unit, numbers where there is no unit.
        **groups : object
            Whole groups, such as ``tracking={"rate": "0.05 deg/s"}``.

        Returns
        -------
        Scenario
            The changed copy.

        Raises
        ------
        ScenarioError
            For a key or a value that is not allowed, also for a bare number where a unit decides:
            ``with_si`` takes those.

        Examples
        --------
        >>> import microvib as mv
        >>> scenario = mv.load_scenario("state-1")
        >>> changed = scenario.with_({"reducer.stiffness": "9000 N*m/rad"})
        """
        return self._changed(changes, groups, si=False)

    def with_si(self, changes: dict[str, Any] | None = None, **groups: Any) -> Scenario:
        """Make a changed copy, for programs that compute in SI: a bare number is in the SI unit of
        its key.

        Parameters
        ----------
        changes : dict, optional
            Dotted keys to values as in a file: text with a unit, numbers where there is no unit, or
            in SI.
        **groups : object
            Whole groups, such as ``tracking={"rate": "0.05 deg/s"}``.

        Returns
        -------
        Scenario
            The changed copy.

        Raises
        ------
        ScenarioError
            For a key or a value that is not allowed.

        Examples
        --------
        >>> import microvib as mv
        >>> scenario = mv.load_scenario("state-1")
        >>> scenario.with_si({"tracking.rate": 0.001})["tracking.rate"]
        0.001
        """
        return self._changed(changes, groups, si=True)

    def _changed(
        self, changes: dict[str, Any] | None, groups: dict[str, Any], si: bool
    ) -> Scenario:
        if changes is not None:
            expect_mapping(changes, "changes", "{'reducer.stiffness': '9000 N*m/rad'}")
        data: dict[str, Any] = {name: getattr(self, name) for name in type(self).model_fields}
        data["sources"] = dict(self.sources)
        for key, value in {**({} if changes is None else changes), **groups}.items():
            expect(key, str, "a dotted key, such as reducer.stiffness")
            group = key.split(".")[0]
            if isinstance(data.get(group), Part):  # what is not changed has been validated
                data[group] = to_plain_data(data[group])
            set_key(data, key, to_plain_data(value))
            if (
                group not in TEXT_KEYS and group in data
            ):  # what was said of the value before is not said of this one
                kept = {
                    k: text
                    for k, text in data["sources"].items()
                    if k != key and not k.startswith(f"{key}.")
                }
                data["sources"] = {**kept, key: USER_SOURCE}
        return validate_part(Scenario, {**data, "sources": {}}, si=si).with_sources(data["sources"])

    def nudged(self, key: str, value: float) -> Scenario:
        """Make a copy with one number [SI] changed so little that it needs no check, which would
        take longer than what is done with the copy; fields that follow from others are renewed.

        Parameters
        ----------
        key : str
            Dotted key, one of ``entries``.
        value : float
            The number, in SI.

        Returns
        -------
        Scenario
            The changed copy, with sources as they were.
        """
        result: Scenario = nudged_part(self, key.split("."), value)
        return result

    def with_sources(self, sources: dict[str, str]) -> Scenario:
        """Make a copy with the sources of those keys that the scenario has; others are dropped.

        Parameters
        ----------
        sources : dict of str to str
            Source and status of single keys or groups, as dotted key: text.

        Returns
        -------
        Scenario
            The copy.
        """
        return self.model_copy(
            update={"sources": {key: text for key, text in sources.items() if self._has(key)}}
        )

    def __getitem__(self, key: str) -> Any:
        """A value in SI, or a group, by its dotted key: ``scenario["reducer.stiffness"]``. Raises
        ScenarioError.
        """
        expect(key, str, "a dotted key, such as reducer.stiffness")
        node: Any = self
        for name in key.split("."):
            listed = isinstance(node, tuple) and node and isinstance(node[0], Part)
            if listed:
                known = [str(k) for k in range(len(node))]
            else:
                known = list(getattr(type(node), "model_fields", ()))
            if name not in known:
                near = did_you_mean(key, self._ipython_key_completions_())
                raise ScenarioError(
                    f"{key}: unknown key; {near}allowed here are {', '.join(known) or 'none'}"
                )
            if listed:
                node = node[int(name)]
            else:
                node = getattr(node, name)
        return node

    def _has(self, key: str) -> bool:
        """Whether a parameter, or a group of them, has this dotted key."""
        try:
            self[key]
        except ScenarioError:
            return False
        return key.split(".")[0] not in TEXT_KEYS

    def _ipython_key_completions_(self) -> list[str]:
        return [key for key, _, _ in self.entries()]

    def entries(self) -> Iterator[tuple[str, Any, Quantity | None]]:
        """Iterate over every parameter, in the order of the file.

        Yields
        ------
        key : str
            Dotted key.
        value : object
            Value, in SI.
        quantity : Quantity or None
            Declaration with unit, meaning and range; None where there is none.
        """
        for name in type(self).model_fields:
            if name not in TEXT_KEYS and (name != "spacecraft" or self.spacecraft is not None):
                yield from flatten_parameters(
                    name, getattr(self, name), type(self).quantity_of(name)
                )

    def shown(self, key: str, value: Any) -> str:
        """Write a value of a key as tables show it.

        Parameters
        ----------
        key : str
            Dotted key.
        value : object
            The value, in SI.

        Returns
        -------
        str
            A number in its unit, all else as it is.
        """
        quantity = next((quantity for name, _, quantity in self.entries() if name == key), None)
        if quantity and isinstance(value, float):
            return quantity.show(value)
        return str(value)

    def unusual_values(self) -> tuple[str, ...]:
        """Find values that are allowed but not of a usual size: often another unit was meant.

        Returns
        -------
        tuple of str
            A sentence for each.
        """
        said = (
            (key, quantity.unusual(value))
            for key, value, quantity in self.entries()
            if quantity and isinstance(value, float)
        )
        return tuple(f"{key}: {text}" for key, text in said if text)

    def source_of(self, key: str) -> str:
        """Tell where the value of a key comes from.

        Parameters
        ----------
        key : str
            Dotted key.

        Returns
        -------
        str
            Its own source, or that of the closest group above it, or the scenario's; of
            eddy-current damping and of a harness ``assumed`` where they have none of their own.
        """
        own = next(
            (name for name in ASSUMED_UNLESS_SOURCED if f"{key}.".startswith(f"{name}.")), ""
        )
        parts = key.split(".")
        for n in range(len(parts), own.count("."), -1):
            text = self.sources.get(".".join(parts[:n]))
            if text is not None:
                return text
        return ASSUMED_SOURCE if own else self.source


GivenScenario = Scenario | str | os.PathLike[str]
"""A scenario, a name of the catalog or the path of a scenario file: what every public function that
wants a scenario takes.
"""
_READER = "microvib.io.scenario_file"
"""Module that reads scenarios by their names: of a room above this one, asked only where a name was
given.
"""


def stands_for_scenario(given: object) -> TypeIs[GivenScenario]:
    """Whether what was given is a scenario, or the name of something."""
    return isinstance(given, (Scenario, str, os.PathLike))


def as_scenario(given: GivenScenario) -> Scenario:
    """The scenario that was given, or that a name of the catalog or of a file stands for.

    Raises ObjectError for what is neither, ScenarioError where the name stands for none.
    """
    if isinstance(given, (str, os.PathLike)):
        found: Scenario = import_module(_READER).load_scenario(given)
        return found
    expect(given, Scenario, "a scenario (mv.load_scenario), or its name")
    return given


def with_start(scenario: Scenario, start: Start | None) -> Scenario:
    """A scenario whose record starts at ``"rest"`` or in the ``"steady"`` state, whatever
    ``record.start`` says; without a ``start`` the same.

    Raises ScenarioError for another word.
    """
    if start is None or start == scenario.record.start:
        return scenario
    return scenario.with_({"record.start": start})


def set_key(data: Any, key: str, value: Any) -> None:
    """Set a dotted key in nested dicts and lists, in place; ScenarioError where the way to it does
    not exist.
    """
    *path, last = key.split(".")
    node = data
    walked: list[str] = []
    for part in path:
        child = _child(node, part, walked, key)
        if child is None:
            child = {}
            node[part] = child
        elif isinstance(child, tuple):
            child = list(child)
            node[_index(node, part, walked, key)] = child
        node = child
        walked.append(part)
    if isinstance(node, list):
        node[_index(node, last, walked, key)] = value
    elif isinstance(node, dict):
        node[last] = value
    else:
        raise ScenarioError(f"{key}: {'.'.join(walked)} is a single value and has no key '{last}'")


def _child(node: Any, part: str, walked: list[str], key: str) -> Any:
    if isinstance(node, list):
        return node[_index(node, part, walked, key)]
    if isinstance(node, dict):
        return node.get(part)
    raise ScenarioError(f"{key}: {'.'.join(walked)} is a single value and has no key '{part}'")


def _index(node: Any, part: str, walked: list[str], key: str) -> Any:
    if isinstance(node, dict):
        return part
    if not part.isdigit() or int(part) >= len(node):
        if len(node) > 1:
            has = f"has entries 0 to {len(node) - 1}"
        elif node:
            has = "has the one entry 0"
        else:
            has = "is empty"
        raise ScenarioError(f"{key}: there is no entry '{part}'; {'.'.join(walked)} {has}")
    return int(part)
