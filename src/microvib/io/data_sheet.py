"""Values of a scenario from a drive's data sheet; missing ones are assumed, with a range."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from microvib.errors import OptionError, ScenarioError, quoted_value
from microvib.io.gears import NON_CATALOG_GEARS, Entry, Gear, catalog_gears, find_gear
from microvib.io.questions import QUESTIONS
from microvib.model.driver import PULSE_KEYS, Driver
from microvib.model.motor import Motor
from microvib.model.part import Part
from microvib.model.reducer import Reducer
from microvib.model.sentences import validate_part
from microvib.units import Quantity, convert

EXAMPLE_SOURCE = "assumed: an example, Appl. Sci. 2021, 11, 9076, Tables 2 and 3; put yours here"
"""Source of all that no data sheet of a drive says."""


class DataSheet(Part):
    """Entries of a data sheet; what it does not state is left out."""

    holding_torque: (
        Annotated[float, Quantity("N*m", "holding torque of the motor", gt=0)] | None
    ) = None
    phases: Literal[2, 3, 5] | None = Field(default=None, description="number of phases")
    phases_on: (
        Annotated[
            int, Field(ge=1, le=5, strict=True, description="phases on at the holding torque")
        ]
        | None
    ) = None
    drive: Literal["current", "voltage", "pulse"] | None = Field(
        default=None, description="current loop, voltages without one, or voltage pulses"
    )
    supply_voltage: (
        Annotated[float, Quantity("V", "supply voltage: of a pulse drive that of its pulses", gt=0)]
        | None
    ) = None
    on_time: (
        Annotated[float, Quantity("s", "on-time of the pulse of a step", gt=0, display="ms")] | None
    ) = None
    diode_voltage: (
        Annotated[float, Quantity("V", "voltage of the diodes or clamp of a pulse drive", gt=0)]
        | None
    ) = None
    current: (
        Annotated[float, Quantity("A", "current per phase at the holding torque", gt=0)] | None
    ) = None
    detent: (
        Annotated[
            float,
            Quantity("", "detent torque over holding torque", ge=0, le=0.5, display="percent"),
        ]
        | None
    ) = None
    detent_torque: Annotated[float, Quantity("N*m", "detent torque", ge=0)] | None = None
    third_harmonic: (
        Annotated[
            float,
            Quantity(
                "",
                "third harmonic of a phase's back-EMF over its fundamental",
                ge=0,
                le=0.5,
                display="percent",
            ),
        ]
        | None
    ) = None
    step_angle: (
        Annotated[float, Quantity("rad", "full step at the output", gt=0, display="deg")] | None
    ) = None
    ratio: Annotated[float, Quantity("", "reduction ratio", ge=1, le=1000)] | None = None
    resistance: Annotated[float, Quantity("ohm", "resistance of one winding", gt=0)] | None = None
    inductance: (
        Annotated[float, Quantity("H", "inductance of one winding", gt=0, display="mH")] | None
    ) = None
    rotor_inertia: (
        Annotated[
            float, Quantity("kg*m^2", "moment of inertia of the rotor", gt=0, display="kg*cm^2")
        ]
        | None
    ) = None
    clamp: Literal["unidirectional", "bidirectional"] | None = Field(
        default=None, description="clamp of a pulse drive"
    )
    microsteps: (
        Annotated[int, Field(ge=1, le=65_536, strict=True, description="microsteps per full step")]
        | None
    ) = None
    gear: str | None = Field(
        default=None, description="size of the harmonic gear, planetary or none"
    )


class TypicalRange(NamedTuple):
    """A value in SI, and between which it may lie; the three are equal where it is known."""

    low: float
    value: float
    high: float

    def times(self, other: TypicalRange) -> TypicalRange:
        """Product of two, which need not be known."""
        return TypicalRange(*(a * b for a, b in zip(self, other, strict=True)))


_ONE_TO = re.compile(r"^1\s*:\s*(?=\d)|(?<=\d)\s*:\s*1$")
TYPICAL = {
    "holding_torque": TypicalRange(0.1, 0.25, 1.0),
    "detent": TypicalRange(0.02, 0.05, 0.1),
    "resistance": TypicalRange(2.0, 6.0, 20.0),
    "microsteps": TypicalRange(4, 16, 64),
}
"""Assumed values of missing entries."""
TIME_CONSTANT = TypicalRange(1e-3, 2e-3, 4e-3)  # L/R of windings [s]
INERTIA = TypicalRange(
    1e-5, 3e-5, 1e-4
)  # of the rotor over the holding torque of hybrid stepping motors [kg m^2 / (N m)]
BANDWIDTH = TypicalRange(300.0, 1000.0, 3000.0)  # of current loops [Hz]
STIFFNESS = (2000.0, 16_000.0)  # K1 of gears up to size 20, of any ratio [N m/rad]
CURRENT, TEETH, RATIO, SIZE = 0.6, 50, 100.0, 14  # assumed where the data sheet is silent
HARMONIC = 20.0  # no harmonic gear has a lower ratio
MAX_DETENT = 0.5  # of the holding torque
PHASES_ON = {2: 2, 3: 2, 5: 4}  # assumed of the holding torque
# of pulse drives
PULSE_VOLTAGE = TypicalRange(0.8, 1.0, 1.2)  # over resistance times current
ON_TIME = TypicalRange(0.03, 0.06, 0.1)  # [s]
DIODE_VOLTAGE = TypicalRange(1.0, 8.0, 30.0)  # a diode, or a clamp [V]
STEP_TIME, STEPS = 2.0, 50  # of the example of a command [s]


def read_entry(key: str, text: str) -> Any:
    """Value of one entry in SI from what a user wrote; OptionError with a sentence that names the
    option.
    """
    if isinstance(text, Real) and not isinstance(text, bool):
        text = f"{text}"  # a count or a ratio of a program; a quantity then lacks its unit
    if not isinstance(text, str):
        raise OptionError(
            key,
            f"{quoted_value(text)} is not allowed; a text as in the data sheet is expected:"
            f" {QUESTIONS[key]}",
        )
    if key == "detent" and _is_torque(text):
        key = "detent_torque"  # as most data sheets state it
    try:
        value = getattr(validate_part(DataSheet, {key: _plain_entry(key, text.strip())}), key)
    except ScenarioError as error:
        raise OptionError(key, str(error).removeprefix(f"{key}: ")) from None
    if key == "gear" and value.lower() not in NON_CATALOG_GEARS:
        find_gear(value, None if "ratio" in value.lower() else RATIO)
    return value


def _plain_entry(key: str, text: str) -> str | int:
    """A whole number of a count, a ratio without its one, or the text as it is."""
    if key in ("phases", "phases_on", "microsteps") and text.isdecimal():
        return int(text)
    if key == "ratio":
        return _ONE_TO.sub("", text)[:200]  # data sheets write 1:100 and 100:1
    return text[:200]


def read_sheet(texts: dict[str, str]) -> DataSheet:
    """Data sheet of entries as a user wrote them; OptionError names the first that is wrong."""
    values = {key: read_entry(key, text) for key, text in texts.items()}
    if _is_torque(str(texts.get("detent", ""))):
        values["detent_torque"] = values.pop("detent")
    return validate_part(DataSheet, values, si=True)


def _is_torque(text: str) -> bool:
    try:
        convert(text, "N*m")
    except ValueError:
        return False
    return True


def entries_of(sheet: DataSheet, inertia: float) -> dict[str, Entry]:
    """Dotted key to value and source, for a scenario with ``inertia`` [kg m^2] rigidly on the
    output.

    The holding torque is that of currents I in so many of the phases, in the directions that add up
    best (Eq. 4): with two phases sqrt(2) K_m I if both are on and K_m I with one. Sources begin
    with ``data sheet`` or ``assumed``, and what is assumed notes its range. OptionError where
    entries contradict each other.
    """
    torque = _known(sheet, "holding_torque")
    if (sheet.phases_on or 1) > (sheet.phases or 2):
        raise OptionError(
            "phases_on",
            f"{sheet.phases_on} is not allowed with {sheet.phases or 2} phases; 1 to that number is"
            " expected",
        )
    sheet = _with_drive(sheet)
    entries = dict([*_motor(sheet, torque), *_driver(sheet), *_train(sheet, inertia), *_examples()])
    if sheet.drive == "pulse":
        entries |= _pulsed_example(sheet, entries)
    return entries


def _with_drive(sheet: DataSheet) -> DataSheet:
    """The sheet with a pulse drive where an entry of pulses says so; OptionError where that is stated
    otherwise.
    """
    of_pulses = [key for key in (*PULSE_KEYS, "clamp") if getattr(sheet, key) is not None]
    if not of_pulses or sheet.drive == "pulse":
        return sheet
    if sheet.drive is None:
        return sheet.model_copy(update={"drive": "pulse"})
    raise OptionError(
        of_pulses[0],
        f"belongs to drive pulse, but {sheet.drive} is stated; state pulse, or leave this out",
    )


def assumed(entries: dict[str, Entry]) -> dict[str, Entry]:
    """Entries that the data sheet does not give."""
    return {
        key: entry
        for key, entry in entries.items()
        if entry.text and entry.source.startswith("assumed")
    }


FLUX = "motor.flux_harmonics.0"
"""Key of the harmonic that the third harmonic of the back-EMF makes."""
_Found = tuple[str, Entry]


def _motor(sheet: DataSheet, torque: TypicalRange) -> Iterator[_Found]:
    phases, current = sheet.phases or 2, sheet.current or CURRENT
    if sheet.phases is not None:
        yield "motor.phases", Entry(f"{phases}", "data sheet: phases")
        yield (
            "driver.beats",
            Entry(
                f"{2 * phases}", "data sheet: twice the phases, full steps per electrical period"
            ),
        )
    stated = (
        "data sheet: current per phase at the holding torque, taken for the amplitude of microsteps"
    )
    lacking = "assumed: no range: torque depends on its product with motor.torque_constant, which the holding torque gives"
    yield (
        "motor.current",
        Entry(_text(Motor, "current", current), stated if sheet.current else lacking),
    )
    constant, said = _torque_constant(sheet, torque)
    yield "motor.torque_constant", _entry(Motor, "torque_constant", constant, said)
    detent, said = _detent(sheet, torque)
    yield "motor.detent_torque", _entry(Motor, "detent_torque", detent, said)
    if sheet.third_harmonic:
        said = "data sheet: third harmonic of the back-EMF; its phase is assumed"
        yield f"{FLUX}.amplitude", Entry(f"{sheet.third_harmonic:.6g}", said)
    if sheet.rotor_inertia is None:
        rotor = torque.times(INERTIA)
        said = "0.3 kg cm² per N m of holding torque, of hybrid stepping motors"
    else:
        rotor = _exactly(sheet.rotor_inertia)
        said = "rotor"
    yield "motor.rotor_inertia", _entry(Motor, "rotor_inertia", rotor, said)


def _torque_constant(sheet: DataSheet, torque: TypicalRange) -> tuple[TypicalRange, str]:
    """Torque constant [N m/A] from the holding torque, and where it is from."""
    phases, current = sheet.phases or 2, sheet.current or CURRENT
    count = sheet.phases_on or PHASES_ON[phases]
    spring, most = (
        math.sin(0.5 * math.pi * j / phases) / math.sin(0.5 * math.pi / phases) * current
        for j in (count, phases)
    )
    if sheet.phases_on:
        per_current = _exactly(1.0 / spring)
    else:
        per_current = TypicalRange(1.0 / most, 1.0 / spring, 1.0 / current)
    assumed_current = "" if sheet.current else ", assumed"
    said = (
        f"holding torque of {torque.value:.4g} N m with {_phases_on_text(sheet)}, over"
        f" {spring:.4g} A{assumed_current}"
    )
    return torque.times(per_current), said


def _phases_on_text(sheet: DataSheet) -> str:
    """How many phases are on at the holding torque, and whether that is assumed."""
    phases = sheet.phases or 2
    count = sheet.phases_on or PHASES_ON[phases]
    if count == 1:
        on = "one phase on"
    elif phases == 2:
        on = "both phases on"
    else:
        on = f"{count} of {phases} phases on"
    if sheet.phases_on:
        return on
    if phases == 2:
        return f"{on}, the usual convention"
    return f"{on}, assumed"


def _detent(sheet: DataSheet, torque: TypicalRange) -> tuple[TypicalRange, str]:
    """Amplitude of the detent torque [N m], and where it is from; OptionError where it is no small
    part of the holding torque.
    """
    stated = sheet.detent_torque
    if stated is None:
        part = _known(sheet, "detent")
        return part.times(torque), f"{100.0 * part.value:.3g} % of the holding torque"
    if sheet.holding_torque is not None and stated > MAX_DETENT * torque.value:
        share = f"{100.0 * stated / torque.value:.3g} % of the holding torque"
        raise OptionError(
            "detent", f"{stated:g} N m is {share}; at most {100.0 * MAX_DETENT:g} % is expected"
        )
    return _exactly(stated), "detent torque, taken for the amplitude"


def _driver(sheet: DataSheet) -> Iterator[_Found]:
    """Windings, and what drives them."""
    resistance = _known(sheet, "resistance")
    yield (
        "motor.winding_resistance",
        _entry(Motor, "winding_resistance", resistance, "resistance of one winding"),
    )
    own = sheet.inductance is not None
    if sheet.inductance is not None:
        inductance = _exactly(sheet.inductance)
    else:
        inductance = resistance.times(TIME_CONSTANT)
    if own:
        said = "inductance of one winding"
    else:
        said = "a time constant L/R of 2 ms, 1 to 4 ms"
    yield "motor.winding_inductance", _entry(Motor, "winding_inductance", inductance, said)
    if sheet.drive == "pulse":
        yield from _pulses(sheet, resistance)
        return
    if sheet.drive is not None:
        yield "driver.drive", Entry(sheet.drive, "data sheet: drive")
    if sheet.drive == "voltage":
        yield from _no_gains()
    else:
        yield from _gains(resistance, inductance)
    if sheet.supply_voltage is not None:
        supply = _exactly(sheet.supply_voltage)
        yield "driver.supply_voltage", _entry(Driver, "supply_voltage", supply, "supply voltage")
    steps = _known(sheet, "microsteps")
    if steps.low < steps.high:
        range_ = f"; range {steps.low:g} to {steps.high:g}"
    else:
        range_ = ""
    yield (
        "driver.microsteps",
        Entry(
            f"{steps.value:g}",
            f"{'assumed' if range_ else 'data sheet'}: microsteps per full step{range_}",
        ),
    )


def _no_gains() -> Iterator[_Found]:
    yield "driver.proportional_gain", Entry("0 V/A", "data sheet: no current loop")
    yield "driver.integral_gain", Entry("0 V/(A*s)", "data sheet: no current loop")


def _gains(resistance: TypicalRange, inductance: TypicalRange) -> Iterator[_Found]:
    """Gains of the current loop, by its bandwidth."""
    loop = f"2π f_c {{}}, bandwidth f_c of the current loop {BANDWIDTH.value:g} Hz"
    rate = BANDWIDTH.times(_exactly(2.0 * math.pi))
    for key, name, winding in (
        ("proportional_gain", "L", inductance),
        ("integral_gain", "R", resistance),
    ):
        yield f"driver.{key}", _entry(Driver, key, rate.times(winding), loop.format(name))


def _pulses(sheet: DataSheet, resistance: TypicalRange) -> Iterator[_Found]:
    """A driver of voltage pulses; OptionError where an entry does not go with it."""
    if sheet.phases not in (None, 2):
        raise OptionError(
            "phases", f"{sheet.phases} is not allowed with drive pulse; 2 are expected, or none"
        )
    if sheet.microsteps not in (None, 1):
        raise OptionError(
            "microsteps",
            f"{sheet.microsteps} is not allowed with drive pulse, which switches whole steps; 1 is"
            " expected, or none",
        )
    yield "driver.drive", Entry("pulse", "data sheet: pulses")
    yield from _no_gains()
    yield "driver.microsteps", Entry("1", "data sheet: pulses switch whole steps")
    current = sheet.current or CURRENT
    usual = {
        "supply_voltage": (
            resistance.times(_exactly(current)).times(PULSE_VOLTAGE),
            f"supply voltage, resistance times {current:g} A",
        ),
        "on_time": (ON_TIME, "on-time of the pulse of a step"),
        "diode_voltage": (DIODE_VOLTAGE, "voltage of the diodes or the clamp"),
    }
    for key, (lacking, said) in usual.items():
        stated = getattr(sheet, key)
        if stated is None:
            yield f"driver.{key}", _entry(Driver, key, lacking, said)
        else:
            yield f"driver.{key}", _entry(Driver, key, _exactly(stated), said.partition(",")[0])
    if sheet.clamp is not None:
        yield "driver.clamp", Entry(sheet.clamp, "data sheet: clamp")


def _pulsed_example(sheet: DataSheet, entries: dict[str, Entry]) -> Iterator[_Found]:
    """A command that leaves time between pulses, and a record of many of them."""
    ratio, teeth = (float(entries[key].text) for key in ("reducer.ratio", "motor.rotor_teeth"))
    step_time = max(STEP_TIME, 4.0 * (sheet.on_time or ON_TIME.value))
    rate = 360.0 / (4.0 * teeth * ratio) / step_time
    told = f"assumed: no range: an example, a step every {step_time:g} s; put yours here"
    yield "tracking.rate", Entry(f"{rate:.6g} deg/s", told)
    yield "record.duration", Entry(f"{math.ceil(STEPS * step_time)} s", "")


@dataclass(frozen=True)
class _Reduction:
    """Ratio between motor and output."""

    ratio: float
    is_stated: bool
    gear: Gear | None = None  # of the catalog


def _train(sheet: DataSheet, inertia: float) -> Iterator[_Found]:
    """Rotor teeth, ratio and gear."""
    steps = 2 * (sheet.phases or 2)
    reduction = _reduction(sheet, steps)
    yield (
        "motor.rotor_teeth",
        _teeth(sheet.step_angle, reduction.ratio, reduction.is_stated, steps),
    )
    yield from _reducer(reduction, (sheet.gear or "").lower() == "planetary", inertia)
    if reduction.gear is None or not reduction.is_stated:
        yield "reducer.ratio", Entry(f"{reduction.ratio:g}", _ratio_source(sheet, reduction, steps))


def _reduction(sheet: DataSheet, steps: int) -> _Reduction:
    """Ratio of the data sheet, of its gear's name or of its step; OptionError where they
    contradict each other.
    """
    kind = (sheet.gear or "").lower()
    if kind == "none":
        if sheet.ratio not in (None, 1.0):
            raise OptionError(
                "ratio", f"{sheet.ratio:g} is not allowed without a gear; 1 is expected, or none"
            )
        return _Reduction(1.0, is_stated=True)
    is_stated = sheet.ratio is not None
    if sheet.ratio is not None:
        ratio = sheet.ratio
    elif sheet.step_angle is not None:
        ratio = _usual_ratio(sheet.step_angle, steps)
    else:
        ratio = RATIO
    if kind in ("", *NON_CATALOG_GEARS):
        return _Reduction(ratio, is_stated)
    if "ratio" in kind and not is_stated:
        gear, ratio = find_gear(kind, None)
        return _Reduction(ratio, is_stated=True, gear=gear)
    gear, ratio = find_gear(kind, ratio)
    return _Reduction(ratio, is_stated, gear)


def _reducer(reduction: _Reduction, is_planetary: bool, inertia: float) -> Iterator[_Found]:
    """Entries of the reducer, and its ratio where a gear of the catalog gives it."""
    ratio = reduction.ratio
    if ratio == 1.0:
        yield from _no_gear()
    elif reduction.gear is not None:
        yield from reduction.gear.entries(ratio, inertia).items()
    elif is_planetary or ratio < HARMONIC:
        yield from _planetary(ratio, inertia)
    else:
        yield from catalog_gears()[SIZE].entries(ratio, inertia).items()
        yield (
            "reducer.stiffness",
            _entry(Reducer, "stiffness", _stiffness(), f"K1 of a harmonic gear of size {SIZE}"),
        )


def _ratio_source(sheet: DataSheet, reduction: _Reduction, steps: int) -> str:
    if reduction.is_stated:
        return "data sheet: no gear" if reduction.ratio == 1.0 else "data sheet: reduction ratio"
    if sheet.step_angle is None:
        return "assumed: no range: a usual one"
    return f"assumed: no range: of a motor with steps of {_usual_step(steps):g} deg"


def _no_gear() -> Iterator[_Found]:
    """The rotor is on the output: nothing yields, errs or turns round."""
    texts = {
        "same_way": "true",
        "stiffness": "rigid",
        "damping": "0 N*m*s/rad",
        "wave_generator_inertia": "0 kg*cm^2",
    }
    for key, text in texts.items():
        yield f"reducer.{key}", Entry(text, "data sheet: no gear")


def _planetary(ratio: float, inertia: float) -> Iterator[_Found]:
    """A gear whose teeth the data sheet does not say: without errors, whose orders are those of
    teeth, and without backlash.
    """
    told = "assumed: no range: as of most planetary gears; errors and backlash are left out, for reducer.train and reducer.backlash"
    yield "reducer.same_way", Entry("true", told)
    yield (
        "reducer.wave_generator_inertia",
        Entry("0 kg*cm^2", "assumed: no range: small compared with the rotor"),
    )
    yield (
        "reducer.stiffness",
        _entry(
            Reducer,
            "stiffness",
            _stiffness(),
            f"a planetary gear as stiff as a harmonic one of size {SIZE}",
        ),
    )
    yield "reducer.damping", catalog_gears()[SIZE].entries(ratio, inertia)["reducer.damping"]


def _stiffness() -> TypicalRange:
    return TypicalRange(STIFFNESS[0], catalog_gears()[SIZE].stiffnesses[0], STIFFNESS[1])


def _usual_step(steps: int) -> float:
    """Full step [deg] of the usual motor."""
    return 360.0 / (steps * TEETH)


def _teeth(step_angle: float | None, ratio: float, known: bool, steps: int) -> Entry:
    """Rotor teeth from the step at the output [rad]; OptionError where they are not a whole number."""
    if step_angle is None:
        return Entry(
            f"{TEETH}", f"assumed: no range: steps of {_usual_step(steps):g} deg, the usual motor"
        )
    exact, step = 2.0 * math.pi / (steps * ratio * step_angle), math.degrees(step_angle)
    teeth = round(min(exact, 1e6))  # which may be infinite
    if not 1 <= teeth <= 1000 or abs(exact - teeth) > 0.01 * teeth:
        raise OptionError(
            "step_angle",
            f"{step:g} deg at the output is {step * ratio:g} deg at the motor with ratio {ratio:g}:"
            f" {360 // steps} deg over a whole"
            " number of rotor teeth from 1 to 1000 is expected there, at the output such as"
            f" {_usual_step(steps) / ratio:g} deg",
        )
    said = (
        f"step of {step:g} deg at the output, ratio {ratio:g}: {step * ratio:.4g} deg at the motor"
    )
    return Entry(f"{teeth}", f"{'data sheet' if known else 'assumed: no range'}: {said}")


def _usual_ratio(step_angle: float, steps: int) -> float:
    """Ratio with which a step of the usual motor is ``step_angle`` [rad] at the output; OptionError
    where that is no reducer's.
    """
    ratio = float(f"{2.0 * math.pi / (steps * TEETH * step_angle):.6g}")
    if not 5.0 <= ratio <= 1000.0:
        raise OptionError(
            "step_angle",
            f"{math.degrees(step_angle):g} deg at the output would be ratio {ratio:g} with a motor"
            f" of {_usual_step(steps):g}"
            f" deg per step; {_usual_step(steps) / 1000:g} to {_usual_step(steps) / 5:g} deg at the"
            " output is expected, or the"
            " ratio too",
        )
    return ratio


def _examples() -> Iterator[_Found]:
    """Ranges of what no data sheet says; the values are those of the commented file."""
    ranges = {
        "motor.friction.viscous": "range 0.005 N*m*s/rad to 0.05 N*m*s/rad",
        "friction.slip_ring.friction_factor": "range 0.5 to 2",
        "array.rigid_inertia": "range 0.05 kg*m^2 to 0.3 kg*m^2",
        "array.modes.0.damping": "range 0.3 percent to 2 percent",
    }
    for key, text in ranges.items():
        yield key, Entry("", f"{EXAMPLE_SOURCE}; {text}")


def _known(sheet: DataSheet, key: str) -> TypicalRange:
    value = getattr(sheet, key)
    if value is None:
        return TYPICAL[key]
    return _exactly(value)


def _exactly(value: float) -> TypicalRange:
    return TypicalRange(value, value, value)


def _entry(part: type[Part], name: str, value: TypicalRange, said: str) -> Entry:
    """A value that is known, or assumed with its range."""
    if value.low == value.high:
        return Entry(_text(part, name, value.value), f"data sheet: {said}")
    low, high = (
        _text(part, name, x, 6 if x == value.value else 3) for x in (value.low, value.high)
    )
    return Entry(_text(part, name, value.value), f"assumed: {said}; range {low} to {high}")


def _text(part: type[Part], name: str, value: float, digits: int = 6) -> str:
    """A value in SI as the file has it."""
    quantity = part.quantity_of(name)
    assert quantity is not None
    unit = quantity.display or quantity.unit
    number = float(f"{value / convert(f'1 {unit}', quantity.unit):.{digits}g}")
    return f"{number:.10g} {unit}"
