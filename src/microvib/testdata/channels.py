"""Names and units of channels as files write them."""

from __future__ import annotations

import json
import re

from microvib.units import convert

LOADS = ("N", "N*m")  # units of what is analysed: forces and torques
COUNTS = ("counts", "count", "lsb", "digit", "digits", "bit", "bits", "eu")  # units of a converter that nobody scaled
_OTHERS = ("s", "V", "C", "m/s^2", "degC", "m", "rad", "A", "Hz", "Pa", "K")  # units of what else recordings hold
_TIME = re.compile(r"(time|zeit|temps|tiempo|tempo|abscissa|t)([ _-]?(axis|achse|vector|stamp))?", re.IGNORECASE)
_ENDING = re.compile(r"(.*\w)[ _]((?:[munµ]?s|sec|min|h))", re.IGNORECASE)
_BEHIND = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*(?:\([^()]*\))?[^()]*)\))")
_BELOW = re.compile(r"(.*[^\s/])\s*/\s*([A-Za-zµΩ°%][^/]*)")


def is_time(name: str) -> bool:
    """Whether a column of this name is a time axis."""
    ending = _ENDING.fullmatch(name.strip())
    return bool(_TIME.fullmatch(ending[1] if ending else name.strip()))


def named_unit(header: str) -> tuple[str, str]:
    """Name and unit of a header such as ``Fx [N]``, ``Time (s)``, ``F_x / N`` or ``time_ms``; no unit where there is none."""
    header = header.strip()
    behind = _BEHIND.fullmatch(header)
    if behind:
        return behind[1].strip(), (behind[2] or behind[3] or "").strip()
    below = _BELOW.fullmatch(header)
    if below and is_unit(below[2]):
        return below[1].strip(), below[2].strip()
    ending = _ENDING.fullmatch(header)
    return (header, ending[2]) if ending and is_time(header) else (header, "")


def is_unit(text: str) -> bool:
    """Whether a text is a unit of what recordings hold."""
    text = text.strip(" []()")
    return (
        text.lower() in COUNTS or as_load(f"1 {text}") is not None or any(_goes(f"1 {text}", unit) for unit in _OTHERS)
    )


def _goes(text: str, unit: str) -> bool:
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


def per(unit: str) -> str:
    """A channel's unit as the denominator of a sensitivity."""
    if not unit or unit.lower() in COUNTS:
        return "count"
    return f"({unit})" if re.search(r"[*/ ]", unit) else unit


def load_per(text: str, unit: str) -> tuple[float, str] | None:
    """What a channel's ``unit`` stands for, in N or N m, from '0.5 N*m/V' or the reverse, '2 V/N'; None where it is neither."""
    for load in LOADS:
        for wanted, power in ((f"{load}/({unit})", 1), (f"({unit})/({load})", -1)):
            try:
                value = convert(text, wanted)
            except ValueError:
                continue
            if value != 0.0:
                return value**power, load
    return None


def in_yaml(name: str) -> str:
    """A name as one writes it in YAML."""
    return name if re.fullmatch(r"[A-Za-z_][\w .()/-]*", name) else json.dumps(name, ensure_ascii=False)
