"""A scenario to start from: the commented file of the catalog, with what is known of a drive filled
in.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping

from microvib.io.data_sheet import EXAMPLE_SOURCE, FLUX, assumed, entries_of, read_sheet
from microvib.io.gears import Entry, find_gear
from microvib.io.named import catalog_text
from microvib.io.scenario_file import scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.scenario import Scenario
from microvib.model.slow_variations import CYCLES_SEEN, slow_variations

_LINE = re.compile(r"(?P<start>  (?P<key>\w+): )(?P<value>[^#]*?)(?P<space> *)(?P<comment>#.*)?")
_UNUSED = re.compile(r"  # (?P<key>\w+): [^#]*(?P<comment>#.*)")
"""A key that the file has as a comment, for it acts only with another."""
_ERROR, _HYSTERESIS = "reducer.transmission_error", "reducer.hysteresis"


def gear_assumed(gear: str) -> dict[str, Entry]:
    """Assumed values of a file with a gear of the catalog, dotted key to value and source.
    OptionError.
    """
    found, ratio = find_gear(gear)
    return assumed(found.entries(ratio, _example().output_inertia))


def new_text(gear: str | None = None, **sheet: str) -> str:
    """Text of a commented scenario file.

    ``gear`` alone is one of the catalog, such as ``size 14 ratio 100``. Further entries of a data
    sheet, texts with units such as ``holding_torque="0.5 N*m"``, make the file of that drive, in
    which all else is assumed: see ``DataSheet``. OptionError.
    """
    if sheet:
        return sheet_text({**sheet, **({} if gear is None else {"gear": gear})})[0]
    if gear is None:
        return catalog_text("new")
    found, ratio = find_gear(gear)
    return filled(_with_whole_cycles(found.entries(ratio, _example().output_inertia)))


def sheet_text(texts: dict[str, str]) -> tuple[str, dict[str, Entry]]:
    """Text of the file of a data sheet's entries, as a user wrote them, and what of it is assumed.
    OptionError, ScenarioError.
    """
    entries = entries_of(read_sheet(texts), _example().output_inertia)
    text = filled(_with_whole_cycles(entries, EXAMPLE_SOURCE), EXAMPLE_SOURCE)
    scenario_of(parse_yaml(text, "new"), "data sheet")
    return text, assumed(entries)


def new_scenario(gear: str | None = None, **sheet: str) -> Scenario:
    """Make a scenario from a data sheet; what the sheet does not say is assumed, and marked so.

    Parameters
    ----------
    gear : str, optional
        A gear of the catalog, such as ``"size 14 ratio 100"``.
    **sheet : str
        Entries of a data sheet with their units, such as ``holding_torque="0.5 N*m"``
        (``microvib new --from-datasheet`` lists them). Counts and ratios may be numbers.

    Returns
    -------
    Scenario
        A complete scenario; ``sources`` says of each value whether it was given or assumed.

    Raises
    ------
    OptionError
        For an entry or a gear that is not known, or a value that is not allowed.
    ScenarioError
        Where the entries contradict each other.

    Examples
    --------
    >>> import microvib as mv
    >>> scenario = mv.new_scenario(holding_torque="0.5 N*m", detent="5 percent", ratio="100")
    """
    return scenario_of(parse_yaml(new_text(gear, **sheet), "new"), "new")


def _example() -> Scenario:
    return scenario_of(parse_yaml(catalog_text("new"), "new"), "new")


_LONGEST_RECORD = 256.0
"""Length [s] up to which the file's record is made longer."""


def _with_whole_cycles(entries: Mapping[str, Entry], source: str = "") -> Mapping[str, Entry]:
    """Entries with the length of a record that shows what the gear's error makes, where the
    example's is too short for it: verdicts ask for two of its cycles.
    """
    scenario = scenario_of(parse_yaml(filled(entries, source), "new"), "new")
    longest = max((one.cycle for one in slow_variations(scenario)), default=0.0)
    wanted = CYCLES_SEEN * longest
    if not scenario.record.duration < wanted <= _LONGEST_RECORD:
        return entries
    return {**entries, "record.duration": Entry(f"{math.ceil(wanted)} s", "")}


def filled(entries: Mapping[str, Entry], source: str = "") -> str:
    """The commented file with ``entries``, dotted key to value and source, in place of its
    examples; ``source`` is of the rest.
    """
    text = catalog_text("new")
    example = parse_yaml(text, "new")
    sources = {key: said for key, said in example["sources"].items() if key not in entries}
    sources |= {key: entry.source for key, entry in entries.items() if entry.source}
    lines, group = [], ""
    for line in text.splitlines():
        if not line.startswith((" ", "#")):
            group = line.partition(":")[0]
        if group == "sources" and line.startswith("  "):
            continue
        if group == "source" and line and source:
            line = f"source: {_quoted(source)}"
        lines.append(_with_value(line, group, entries))
        if line.startswith("sources:"):
            lines += [f"  {key}: {_quoted(said)}" for key, said in sources.items()]
    return "\n".join(lines) + "\n"


def _with_value(line: str, group: str, entries: Mapping[str, Entry]) -> str:
    """A line of the file with its own value; the comment of a value stays in its column."""
    of_list = _with_listed_value(line, entries)
    if of_list is not None:
        return of_list
    unused = _UNUSED.fullmatch(line)
    if unused and f"{group}.{unused['key']}" in entries:
        line = f"  {unused['key']}: ".ljust(unused.start("comment")) + unused["comment"]
    found = _LINE.fullmatch(line)
    if found is None:
        return line
    entry = entries.get(f"{group}.{found['key']}")
    if entry is None or not entry.text:
        return line
    start, comment = found["start"], found["comment"]
    if not comment:
        return start + entry.text
    width = found.start("comment") - len(start)
    return start + f"{entry.text} ".ljust(width) + comment


def _with_listed_value(line: str, entries: Mapping[str, Entry]) -> str | None:
    """A commented line of a list or of a bound with its value; None for any other line."""
    amplitude = entries.get(f"{_ERROR}.0.amplitude")
    if amplitude is not None and "transmission_error:" in line:
        return line.replace("# transmission_error:", "transmission_error:  ")
    if amplitude is not None and line.startswith("  #   - {order:"):
        return f"    - {{order: 2, amplitude: {amplitude.text}, phase: 0 deg}}"
    flux = entries.get(f"{FLUX}.amplitude")
    if flux is not None and line.startswith("  # flux_harmonics:"):
        return f"  flux_harmonics: [{{order: 3, amplitude: {flux.text}, phase: 0 deg}}]"
    hysteresis = entries.get(_HYSTERESIS)
    if hysteresis is not None and line.startswith("  # hysteresis:"):
        return f"  # hysteresis: {hysteresis.text}  # a maker's bound on the loss; without the first # it acts"
    return None


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
