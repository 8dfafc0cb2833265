"""Names and units of channels as files write them."""

from __future__ import annotations

import contextlib
import json
import math
import re

from microvib.units import convert

LOADS = ("N", "N*m")  # units of what verdicts are given on: forces and torques
ACCELERATIONS = ("m/s^2", "g")
"""Units in which accelerations are kept, as they were given; g is that of standard gravity."""
COUNTS = (
    "counts",
    "count",
    "lsb",
    "digit",
    "digits",
    "bit",
    "bits",
    "eu",
)  # units of a converter that nobody scaled
FULL_SCALE = "FS"  # unit of samples that are parts of a recorder's full scale
_OTHERS = (
    "s",
    "V",
    "C",
    "m/s^2",
    "degC",
    "m",
    "rad",
    "A",
    "Hz",
    "Pa",
    "K",
    "rad/s",
    "rad/s^2",
    "kg^0.5*m",
    "kg^0.5*m/s",
)  # units of what else recordings hold
_TIME_UNITS = {
    **dict.fromkeys(
        (
            "s",
            "sec",
            "secs",
            "second",
            "seconds",
            "sek",
            "sekunde",
            "sekunden",
            "seconde",
            "secondes",
        ),
        "s",
    ),
    **dict.fromkeys(
        ("ms", "msec", "msecs", "msek", "millisec", "millisecond", "milliseconds", "millisekunden"),
        "ms",
    ),
    **dict.fromkeys(
        (
            "us",
            "usec",
            "µs",
            "µsec",
            "μs",
            "μsec",
            "microsec",
            "microsecond",
            "microseconds",
            "mikrosekunden",
        ),
        "us",
    ),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten"), "min"),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "stunde", "stunden", "std"), "h"),
    **dict.fromkeys(("d", "day", "days", "tag", "tage"), "day"),
}
"""Units of time, in lower case, as people and programs write them."""
_TIME = re.compile(
    r"(time|zeit|temps|tiempo|tempo|abscissa|t)([ _-]?(axis|achse|vector|stamp))?", re.IGNORECASE
)
_ENDING = re.compile(r"(.*\w)[ _]((?:[munµ]?s|sec|min|h))", re.IGNORECASE)
_CATMAN_TIME = re.compile(r"(time|zeit|temps|tiempo|tempo)\s+\d{1,3}(\s*-\s.*)?", re.IGNORECASE)
"""A time axis of catman, such as ``Time  1 - default sample rate``."""
_LOAD_ENDING = re.compile(
    r"(.*?[A-Za-z0-9])[ _]([kmunµM]?N[*·._-]?(?:mm|cm|m)|(?:lbf|ozf|kgf)[*·._-]?(?:in|ft|m)|kN|(?<=^F.[ _])m?N)"
)
_BEHIND = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*(?:\([^()]*\))?[^()]*)\))")
_BELOW = re.compile(r"(.*[^\s/])\s*/\s*([A-Za-zµΩ°%][^/]*)")


def is_time(name: str) -> bool:
    """Whether a column of this name is a time axis."""
    name = name.strip()
    ending = _ENDING.fullmatch(name)
    return bool(_TIME.fullmatch(ending[1] if ending else name) or _CATMAN_TIME.fullmatch(name))


def seconds_per(unit: str) -> float | None:
    """Seconds in a unit of time as files write it (``s``, ``msec``, ``Sekunden``, ``MS`` of older
    programs); None if it is none.
    """
    plain = unit.strip().strip("[]()").rstrip(".")
    plain = _TIME_UNITS.get(plain.lower(), plain)
    try:
        return convert(f"1 {plain}", "s")
    except ValueError:
        return None


def what_is_measured_in(unit: str) -> str:
    """Words for what a unit of an axis other than time measures; empty where it is not known."""
    plain = unit.strip().strip("[]()")
    plain = {
        "hz": "Hz",
        "khz": "kHz",
        "u/min": "rpm",
        "1/min": "rpm",
        "r/min": "rpm",
        "rev/min": "rpm",
    }.get(plain.lower(), plain)
    if plain.lower() in ("order", "orders", "ordnung", "ord", "ev"):
        return "an order of the speed"
    kinds = (
        ("Hz", "a frequency"),
        ("rad/s", "a speed of rotation"),
        ("rad", "an angle"),
        ("m", "a length"),
    )
    if plain:
        return next((words for known, words in kinds if _is_compatible(f"1 {plain}", known)), "")
    return ""


def named_unit(header: str) -> tuple[str, str]:
    """Name and unit of a header such as ``Fx [N]``, ``Time (s)``, ``F_x / N`` or ``time_ms``; no
    unit where there is none.
    """
    header = header.strip()
    behind = _BEHIND.fullmatch(header)
    if behind:
        return behind[1].strip(), (behind[2] or behind[3] or "").strip()
    below = _BELOW.fullmatch(header)
    if below and is_unit(below[2]):
        return below[1].strip(), below[2].strip()
    ending = _ENDING.fullmatch(header)
    if ending and is_time(header):
        return header, ending[2]
    return header, ""


def load_in_name(name: str) -> tuple[str, str]:
    """Name and unit of a force's or torque's channel that is called ``Mz_mNm`` or ``Mz [mNm]``; no
    unit where there is none.
    """
    own, unit = named_unit(name)
    if unit:
        if as_load(f"1 {unit}") is not None:
            return (own, unit)
        return (name, "")
    ending = _LOAD_ENDING.fullmatch(name.strip())
    if ending is None or as_load(f"1 {ending[2].replace('_', '*')}") is None:
        return name, ""
    return ending[1], ending[2].replace("_", "*")


def is_unit(text: str) -> bool:
    """Whether a text is a unit of what recordings hold."""
    text = text.strip(" []()")
    return (
        text.lower() in COUNTS
        or as_load(f"1 {text}") is not None
        or any(_is_compatible(f"1 {text}", unit) for unit in _OTHERS)
    )


def units_contradict(one: str, other: str) -> bool:
    """Whether two units that a file gives to one channel are not the same; no texts that are none."""
    one, other = (x.strip().strip("[]()").strip() for x in (one, other))
    if one.lower() == other.lower() and one[:1] == other[:1]:
        return False
    if not (is_unit_of_anything(one) and is_unit_of_anything(other)):
        return False
    sizes = [_sizes(x) for x in (one, other)]
    return not any(
        kind in sizes[1] and math.isclose(size, sizes[1][kind], rel_tol=1e-6)
        for kind, size in sizes[0].items()
    )


def is_unit_of_anything(text: str) -> bool:
    """Whether a text is a unit of what recordings hold, or of their time axis."""
    return bool(text) and (is_unit(text) or seconds_per(text) is not None)


def _sizes(unit: str) -> dict[str, float]:
    """Size of a unit in each of those that it goes with; of counts 1."""
    if unit.lower() in COUNTS:
        return {"count": 1.0}
    sizes = {"s": seconds_per(unit)}
    for known in (*LOADS, *_OTHERS[1:]):
        with contextlib.suppress(ValueError):
            sizes[known] = convert(f"1 {unit}", known)
    return {known: size for known, size in sizes.items() if size is not None}


def _is_compatible(text: str, unit: str) -> bool:
    try:
        convert(text, unit)
    except ValueError as error:
        return "start at zero" in str(error)  # such as degrees Celsius
    return True


def as_load(text: str) -> tuple[float, str] | None:
    """A quantity in N or N m, and which of the two; None where it is neither."""
    for unit in LOADS:
        try:
            return convert(text, unit), unit
        except ValueError:
            continue
    return None


_IN_GRAVITY = re.compile(r"(?<![A-Za-zµμ])[munµμ]?g(?![A-Za-z])")
"""A unit of acceleration in parts of standard gravity, which no channel means as grams."""


def as_acceleration(text: str) -> tuple[float, str] | None:
    """A quantity in m/s^2 or in g, and which of the two; None where it is neither."""
    for unit in _acceleration_units(text):
        try:
            return convert(text, unit), unit
        except ValueError:
            continue
    return None


def _acceleration_units(text: str) -> tuple[str, ...]:
    """Units of acceleration that a text may be in; g only where it names it."""
    return ACCELERATIONS if _IN_GRAVITY.search(text) else ACCELERATIONS[:1]


def as_measured(text: str) -> tuple[float, str] | None:
    """A force, torque or acceleration, and its unit as it is kept; None where it is none of them."""
    return as_load(text) or as_acceleration(text)


def plain_load(unit: str) -> str:
    """``N`` or ``N*m`` for any way to write it, such as ``N m``, ``Nm`` or ``N·m``; other units as
    they are.
    """
    if isinstance(unit, str) and unit.strip() not in ("", *LOADS):
        found = as_load(f"1 {unit.strip()}")
    else:
        found = None
    if found is not None and found[0] == 1.0:
        return found[1]
    return unit


def as_denominator(unit: str) -> str:
    """A channel's unit as the denominator of a sensitivity."""
    if not unit or unit.lower() in COUNTS or unit == FULL_SCALE:
        return "count"
    if re.search(r"[*/ ]", unit):
        return f"({unit})"
    return unit


def measured_per(text: str, unit: str) -> tuple[float, str] | None:
    """Force, torque or acceleration per ``unit`` of a channel, in the unit that it is kept in, from
    '0.5 N*m/V' or the reverse, '2 V/N', '16384 counts/g'; None where it is none of them.
    """
    for load in (*LOADS, *_acceleration_units(text)):
        for wanted, power in ((f"{load}/({unit})", 1), (f"({unit})/({load})", -1)):
            try:
                value = convert(text, wanted)
            except ValueError:
                continue
            if value != 0.0:
                return value**power, load
    return None


def yaml_quoted(name: str) -> str:
    """A name as one writes it in YAML."""
    if re.fullmatch(r"[A-Za-z_][\w .()/-]*", name):
        return name
    return json.dumps(name, ensure_ascii=False)
