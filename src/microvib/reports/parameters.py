"""Parameters for reports: each with its value, its meaning, and where it comes from."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

from microvib.model.linear import coupled_modes
from microvib.model.part import Part, entries
from microvib.model.scenario import Scenario
from microvib.reports.document import Block, Row, Table, Text, pairs, table
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
"""Words by which a source tells the status of its values; a source without such words, or none at all, makes them given."""
STATUSES = (*(name for name, _ in _STATUS), "given")
_PLAIN = ("default", "set by the user")


@dataclass(frozen=True)
class Provenance:
    """Status of one value, and what it rests on."""

    status: str
    detail: str = ""
    reference: str = ""


def provenance(source: str) -> Provenance:
    """Status, detail (a value with its standard error, a reason) and reference in the text of a source."""
    status = next((name for name, words in _STATUS if re.match(words, source, re.IGNORECASE)), "given")
    if status in _PLAIN:
        return Provenance(status)
    if status == "identified":
        reference, _, detail = source.rpartition(": ")
        return Provenance(status, _printed(detail), reference) if reference else Provenance(status, "", source)
    if status in ("assumed", "computed") and source.lower().startswith(status):
        return Provenance(status, source.partition(":")[2].strip() or source.removeprefix(status).strip(" ;,"))
    return Provenance(status, "", source)


def _printed(detail: str) -> str:
    """A value with its standard error as print shows it."""
    return detail.replace("^2", "²").replace("*", " ").replace(" percent", " %")


def parameter_blocks(scenario: Scenario) -> tuple[Block, ...]:
    """Every parameter with status and basis, and the list of references."""
    rows: list[Row] = []
    references: dict[str, int] = {}
    group = ""
    for key, value, quantity in scenario.entries():
        if value is None or value == ():
            continue
        first, _, rest = key.partition(".")
        if first != group:
            group = first
            rows.append(Row((group,), "group"))
        shown = _shown(value, quantity)
        meaning = quantity.meaning if quantity else _description(scenario, key)
        found = provenance(scenario.source_of(key))
        rows.append(Row((rest, shown, found.status, _basis(found, references), meaning)))
    columns = table(("`key`", "value [1]", "status", "basis", "meaning"), ()).columns
    listed = pairs((f"[{number}]", text) for text, number in references.items())
    return (Table(columns, tuple(rows)), *((Text("References of the column `basis`:"), listed) if references else ()))


def _shown(value: Any, quantity: Quantity | None) -> str:
    """A value with its unit, which stays on its line; of several, four digits each."""
    if quantity and isinstance(value, float):
        return quantity.show(value).replace(" ", "\u00a0")
    if isinstance(value, tuple):
        return ", ".join(f"{v:.4g}" if isinstance(v, float) else str(v) for v in value)
    return str(value)


def _basis(found: Provenance, references: dict[str, int]) -> str:
    if not found.reference:
        return found.detail
    number = references.setdefault(found.reference, len(references) + 1)
    return f"{found.detail} [{number}]".strip()


def status_sentence(scenario: Scenario) -> str:
    """How many parameters are of which status."""
    found = [
        provenance(scenario.source_of(key)).status for key, value, _ in scenario.entries() if value not in (None, ())
    ]
    counts = [f"{found.count(status)} {status}" for status in STATUSES if status in found]
    return f"{len(found)} parameters: {', '.join(counts)}."


def parameter_table(part: Part) -> Table:
    """Key, value and meaning of every parameter of a part."""
    rows = []
    for key, value, quantity in entries("", part, None):
        key = key.lstrip(".")
        if value is None or value == () or key in ("title", "source"):
            continue
        shown = _shown(value, quantity)
        rows.append((key, shown, quantity.meaning if quantity else _description(part, key)))
    return table(("`parameter`", "value [1]", "meaning"), rows)


def _description(part: Any, key: str) -> str:
    *path, last = key.split(".")
    for name in path:
        part = part[int(name)] if name.isdigit() else getattr(part, name)
    field = type(part).model_fields.get(last) if isinstance(part, Part) else None
    return (field.description or "") if field else ""


def derived_values(scenario: Scenario) -> list[tuple[str, str, str]]:
    """Values that follow from a scenario and that an engineer wants to see before running it: name, value, how."""
    motor, driver, reducer, array = scenario.motor, scenario.driver, scenario.reducer, scenario.array
    step, f_d, spring = (
        math.degrees(driver.full_step(motor)),
        scenario.driving_frequency,
        motor.electromagnetic_stiffness,
    )
    return [
        ("full step at the rotor", f"{step:.6g} deg", "Eq. 25"),
        ("microstep at the rotor", f"{step / driver.microsteps:.6g} deg", "Eq. 25"),
        ("driving frequency f_d", f"{f_d:.6g} Hz", "Eq. 26")
        if f_d
        else ("driving frequency f_d", "none", "the rate is zero or changes in the record"),
        ("electromagnetic spring at the rotor", f"{spring:.6g} N m/rad", "z K_m I"),
        ("electromagnetic spring at the output", f"{spring * reducer.ratio**2:.6g} N m/rad", "h² z K_m I"),
        (
            "breakaway torque of the output",
            f"{scenario.friction.breakaway_torque:.6g} N m",
            "slip ring included, Eq. 6 and 7",
        ),
        ("rigidly attached inertia J_h", f"{array.J_h:.6g} kg m²", f"of J {array.inertia:.6g} kg m²"),
    ]


def derived(scenario: Scenario) -> list[str]:
    """Derived values and natural frequencies as sentences."""
    texts = [f"{name} {value} ({how})" for name, value, how in derived_values(scenario)]
    for mode in coupled_modes(scenario)[:12]:
        clamped = "" if mode.fixed_frequency is None else f", clamped {mode.fixed_frequency:.6g} Hz"
        texts.append(
            f"{mode.name}: {mode.frequency:.6g} Hz through the drive{clamped}, damping ratio {mode.damping:.4g}"
        )
    return texts
