"""Parameters for reports: each with its value, its meaning, and where it comes from."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from microvib.model.compensation import largest_slope
from microvib.model.driver import motor_of_mean_spring
from microvib.model.expected import angle_errors
from microvib.model.line_names import electrical_line, full_step_line
from microvib.model.linear import coupled_modes
from microvib.model.orders import drive_orders
from microvib.model.part import Part, flatten_parameters
from microvib.model.scenario import Scenario
from microvib.model.winding_up import wind_up
from microvib.reports.document import Text
from microvib.reports.outcome import Item, Pairs
from microvib.results import Column, Measure, Table
from microvib.text_tables import text_table
from microvib.units import Quantity

_STATUS = (
    ("identified", r"identified\b"),
    ("assumed", r"assumed\b"),
    ("default", r"default\b"),
    ("set by the user", r"set by the user\b"),
    ("computed", r"(computed|finite elements)\b"),
    ("data sheet", r".*\bdata ?sheet\b"),
    ("paper", r".*(\bAppl\. Sci\.|\bdoi\b|\bTable \d)"),
)
"""Words by which a source tells the status of its values; a source without such words, or none at
all, makes them given.
"""
STATUSES = (*(name for name, _ in _STATUS), "given")
_UNEXPLAINED_STATUSES = ("default", "set by the user")
_NOT_IDEAL = ("driver.imperfections.", "driver.microstep_ramp", "driver.delay")


@dataclass(frozen=True)
class Provenance:
    """Status of one value, and what it rests on."""

    status: str
    detail: str = ""
    reference: str = ""


def provenance(source: str) -> Provenance:
    """Status, detail (a value with its standard error, a reason) and reference in the text of a
    source.
    """
    status = next(
        (name for name, words in _STATUS if re.match(words, source, re.IGNORECASE)), "given"
    )
    if status in _UNEXPLAINED_STATUSES:
        return Provenance(status)
    if status == "identified":
        reference, _, detail = source.rpartition(": ")
        printed = detail.replace("^2", "²").replace("*", " ").replace(" percent", " %")
        if reference:
            return Provenance(status, printed, reference)
        return Provenance(status, "", source)
    if status in ("assumed", "computed") and source.lower().startswith(status):
        return Provenance(
            status, source.partition(":")[2].strip() or source.removeprefix(status).strip(" ;,")
        )
    return Provenance(status, "", source)


def _parameter_rows(part: Part) -> Iterator[tuple[str, str, str]]:
    """Key, value as text and meaning of every parameter of a part that has a value; of what an
    ideal driver lacks, nothing.
    """
    for key, value, quantity in (
        part.entries() if isinstance(part, Scenario) else flatten_parameters("", part, None)
    ):
        key = key.lstrip(".")
        if value is not None and value != () and not (key.startswith(_NOT_IDEAL) and value == 0.0):
            yield (
                key,
                _shown(value, quantity),
                quantity.meaning if quantity else _description(part, key),
            )


def parameter_items(scenario: Scenario) -> Iterator[Item]:
    """Every parameter with status and basis, and the list of references."""
    rows: list[tuple[str, ...]] = []
    references: dict[str, int] = {}
    for key, shown, meaning in _parameter_rows(scenario):
        found = provenance(scenario.source_of(key))
        basis = found.detail
        if found.reference:
            number = references.setdefault(found.reference, len(references) + 1)
            basis = f"{basis} [{number}]".strip()
        group, _, name = key.partition(".")
        rows.append((group, name, shown, found.status, basis, meaning))
    yield Table("", _PARAMETER_COLUMNS, tuple(rows))
    if references:
        yield Text("References of the column `basis`:")
        yield Pairs(tuple((f"[{number}]", text) for text, number in references.items()))


_PARAMETER_COLUMNS = (
    Column("group", "group", role="group"),
    Column("key", "key", role="key"),
    Column("value", "value", Measure()),
    Column("status", "status"),
    Column("basis", "basis"),
    Column("meaning", "meaning"),
)


def _shown(value: Any, quantity: Quantity | None) -> str:
    """A value with its unit, which stays on its line; of several, four digits each."""
    if quantity and isinstance(value, float):
        return quantity.show(value).replace(" ", "\u00a0")
    if isinstance(value, tuple):
        return ", ".join(f"{v:.4g}" if isinstance(v, float) else str(v) for v in value)
    return str(value)


def status_sentence(scenario: Scenario) -> str:
    """How many parameters are of which status."""
    found = [provenance(scenario.source_of(key)).status for key, *_ in _parameter_rows(scenario)]
    counts = [f"{found.count(status)} {status}" for status in STATUSES if status in found]
    return f"{len(found)} parameters: {', '.join(counts)}."


def parameter_table(part: Part) -> Table:
    """Key, value and meaning of every parameter of a part."""
    columns = (
        Column("key", "parameter", role="key"),
        Column("value", "value", Measure()),
        Column("meaning", "meaning"),
    )
    apart = ("title", "source", "reference")
    rows = (row for row in _parameter_rows(part) if row[0].split(".")[0] not in apart)
    return Table("", columns, tuple(rows))


def _description(part: Any, key: str) -> str:
    *path, last = key.split(".")
    for name in path:
        if name.isdigit():
            part = part[int(name)]
        else:
            part = getattr(part, name)
    if isinstance(part, Part):
        field = type(part).model_fields.get(last)
    else:
        field = None
    if field:
        return field.description or ""
    return ""


def derived_table(scenario: Scenario) -> Table:
    """Derived values, and how each follows."""
    columns = (
        Column("quantity", "quantity"),
        Column("value", "value", Measure()),
        Column("by", "by"),
    )
    return Table("", columns, tuple(derived_values(scenario)))


def derived_values(scenario: Scenario) -> list[tuple[str, str, str]]:
    """Values that follow from a scenario and that an engineer wants to see before running it: name,
    value, how.
    """
    driver, array, f_d = scenario.driver, scenario.array, scenario.driving_frequency
    step, spring = (
        math.degrees(driver.full_step(scenario.motor)),
        motor_of_mean_spring(driver, scenario.motor).electromagnetic_stiffness,
    )
    of_currents = ", mean of the driver's currents" if driver.distorted else ""
    if scenario.motor.phases == 2:
        half = ""
    else:
        half = f"{scenario.motor.phases}/2 "
    breakaway = scenario.friction.breakaway_torque
    if f_d:
        rate = (f"{f_d:.6g} Hz", "Eq. 26")
    else:
        rate = ("none", "the rate is zero or changes in the record")
    values = [
        ("full step at the rotor", f"{step:.6g} deg", "Eq. 25"),
        ("microstep at the rotor", f"{step / driver.microsteps:.6g} deg", "Eq. 25"),
        ("driving frequency f_d", *rate),
        (
            "electromagnetic spring at the rotor",
            f"{spring:.6g} N m/rad",
            f"{half}z K_m I{of_currents}",
        ),
        (
            "electromagnetic spring at the output",
            f"{spring * scenario.reducer.ratio**2:.6g} N m/rad",
            f"h² {half}z K_m I{of_currents}",
        ),
        (
            "breakaway torque of the output",
            f"{breakaway:.6g} N m",
            "slip ring included, Eq. 6 and 7",
        ),
        *_wind_up_rows(scenario),
        (
            "rigidly attached inertia J_h",
            f"{array.J_h:.6g} kg m²",
            f"of J {array.inertia:.6g} kg m²",
        ),
        *_second_wing(scenario),
    ]
    return values + _microstep_rows(scenario) + _driver_orders(scenario)


def _microstep_rows(scenario: Scenario) -> list[tuple[str, str, str]]:
    """Part of the first driving line that parts of microsteps leave, and frequencies over which
    compensation spreads it; nothing of ordinary microsteps."""
    driver, f_d, rows = scenario.driver, scenario.driving_frequency, []
    if driver.microstep_shape and f_d:
        left = float(np.abs(driver.shape.spectrum(np.array([f_d]))[0]))
        rows.append(
            (
                "drive_1 by the parts of a microstep",
                f"{100.0 * left:.3g} %",
                "driver.microstep_shape",
            )
        )
    if driver.compensates and f_d:
        microstep = driver.microstep(scenario.motor)
        share = scenario.reducer.ratio * largest_slope(driver.compensation)
        moved = scenario.reducer.ratio * sum(one.amplitude for one in driver.compensation)
        rows.append(
            (
                "drive_1 is spread by",
                f"{share * f_d:.3g} Hz to both sides",
                "driver.compensation, by which microsteps come up to"
                f" {moved / microstep:.3g} of their periods early or late",
            )
        )
    return rows


def _wind_up_rows(scenario: Scenario) -> list[tuple[str, str, str]]:
    """How far the drive is wound up before the output turns; nothing where no friction holds it."""
    angle, name = wind_up(scenario), "wind-up before the output turns"
    if math.isinf(angle):
        return [(name, "none is enough", "the motor is weaker than the friction")]
    if scenario.rate:
        after = f"after {angle / abs(scenario.rate):.3g} s"
    else:
        after = "on gear and electromagnetic spring"
    if angle > 0.0:
        return [(name, f"{math.degrees(angle):.3g} deg", after)]
    return []


def _second_wing(scenario: Scenario) -> list[tuple[str, str, str]]:
    """Where the second wing's array is and how it steps."""
    other = scenario.other_wing
    if other is None or other.spacecraft is None:
        return []
    rows = [
        (
            "second wing, angle of its array",
            f"{math.degrees(other.spacecraft.array_angle):.6g} deg",
            "about its drive axis",
        )
    ]
    f_d, wing = other.driving_frequency, scenario.spacecraft and scenario.spacecraft.second_wing
    if scenario.second_is_locked:
        rows.append(("second wing, its drive", "locked", "its shaft does not turn"))
    elif scenario.driven_wing is None:
        rows.append(
            ("second wing, its drive", "held", "springs and dampers of its linearised drive")
        )
    else:
        if other.rate is not None:
            rows.append(
                (
                    "second wing, rate of its shaft",
                    f"{math.degrees(other.rate):.6g} deg/s",
                    "about its drive axis",
                )
            )
        if wing and wing.stagger:
            steps = f"{wing.stagger:g} microsteps after the first's"
        else:
            steps = "steps with the first's"
        rows.append(("second wing, driving frequency", f"{f_d:.6g} Hz" if f_d else "none", steps))
    return [*rows, *_energy_shares(scenario, other)]


def _energy_shares(scenario: Scenario, other: Scenario) -> Iterator[tuple[str, str, str]]:
    """Distribution of each mode's elastic energy over arrays, second drive and hub, with the first shaft locked."""
    craft = scenario.craft
    assert craft is not None
    assert craft.second is not None
    first, second = len(scenario.array.modes), len(other.array.modes)
    own, beside = len(craft.shapes) - first, len(craft.shapes) - first - second
    shafts = len(craft.second.K) - second
    drive = craft.shapes[beside - shafts : beside]
    parts = {
        "first array": scenario.array.Lambda @ craft.shapes[own:] ** 2,
        "second array": other.array.Lambda @ craft.shapes[beside:own] ** 2,
        "second drive": np.sum(drive * (craft.second.K[:shafts, :shafts] @ drive), axis=0),
    }
    parts["hub and its control"] = craft.squares - sum(parts.values())
    for k, f in enumerate(craft.frequency[:SHOWN_MODES]):
        shares = sorted(
            ((float(x[k] / craft.squares[k]), name) for name, x in parts.items()), reverse=True
        )
        told = ", ".join(f"{name} {100.0 * share:.0f} %" for share, name in shares if share > 0.1)
        yield f"mode at {f:.4g} Hz, first shaft locked", told, "parts of its elastic energy"


SHOWN_MODES = 16
"""Modes of a craft with two wings of which it is told who moves."""
SHOWN_ERRORS = 8
"""Harmonics of a driver's angle error that are listed, the largest."""


def _driver_orders(scenario: Scenario) -> list[tuple[str, str, str]]:
    """Orders of the electrical period at which errors of the driver make lines, with their angle
    errors and causes.
    """
    driver, motor, f_d = scenario.driver, scenario.motor, scenario.driving_frequency
    found = sorted(angle_errors(driver, motor.phases), key=lambda error: -error.amplitude)[
        :SHOWN_ERRORS
    ]
    rows = []
    for error in sorted(found, key=lambda error: error.order):
        steps, rest = divmod(error.order, motor.full_steps)
        if rest == 0:
            name = full_step_line(steps)
        else:
            name = electrical_line(error.order)
        if f_d:
            at = f" at {error.order * f_d / (driver.beats * driver.microsteps):.6g} Hz"
        else:
            at = ""
        rows.append(
            (
                f"angle error of the references, {name}{at}",
                f"{error.amplitude:.3g} rad",
                ", ".join(error.causes) or "together",
            )
        )
    return rows


def order_lines(scenario: Scenario, indent: int = 0) -> list[str]:
    """Orders of the drive as a table of text: name, cycles per turn of the output, frequency, what
    it is and which mode is near.

    The lines leave room for an ``indent`` of so many columns.
    """
    if scenario.rate is None:
        rate = "rate changes"
    else:
        rate = f"Hz at {math.degrees(scenario.rate):.6g} deg/s"
    rows = []
    for order in drive_orders(scenario):
        if order.near:
            near = f" <- near {', '.join(order.near)}"
        else:
            near = ""
        if math.isnan(order.frequency):
            at = "-"
        else:
            at = f"{order.frequency:.7g}"
        rows.append((order.name, f"{order.per_turn:.9g}", at, f"{order.words}{near}"))
    header = ("name", "per output turn", rate, "what it is")
    return text_table(header, rows, left=1, last_left=True, indent=indent).splitlines()


def derived(scenario: Scenario) -> list[str]:
    """Derived values and natural frequencies as sentences."""
    texts = [f"{name} {value} ({how})" for name, value, how in derived_values(scenario)]
    for m in coupled_modes(scenario)[:12]:
        if m.fixed_frequency is None:
            clamped = ""
        else:
            clamped = f", clamped {m.fixed_frequency:.6g} Hz"
        texts.append(
            f"{m.name}: {m.frequency:.6g} Hz through the drive{clamped}, damping ratio"
            f" {m.damping:.4g}"
        )
    return texts
