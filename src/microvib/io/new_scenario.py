"""A scenario to start from: the commented file of the catalog, with what is known of a drive filled in."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

from microvib.io.gears import Entry, find_gear
from microvib.io.scenario_file import catalog_text, scenario_of
from microvib.io.yaml_text import parse_yaml
from microvib.model.scenario import Scenario

_LINE = re.compile(r"(?P<start>  (?P<key>\w+): )(?P<value>[^#]*?)(?P<space> *)(?P<comment>#.*)?")
_ERROR = "reducer.transmission_error"


def new_text(gear: str | None = None) -> str:
    """Text of a commented scenario file; ``gear`` is one of the catalog, such as ``size 14 ratio 100``. OptionError."""
    if gear is None:
        return catalog_text("new")
    found, ratio = find_gear(gear)
    return filled(found.entries(ratio, _example().output_inertia))


def new_scenario(gear: str | None = None) -> Scenario:
    """The scenario that ``new_text`` is the file of: ``new_scenario(gear="size 14 ratio 100")``."""
    return scenario_of(parse_yaml(new_text(gear), "new"), "new")


def _example() -> Scenario:
    return scenario_of(parse_yaml(catalog_text("new"), "new"), "new")


def filled(entries: Mapping[str, Entry], source: str = "") -> str:
    """The commented file with ``entries``, dotted key to value and source, in place of its examples; ``source`` is of the rest."""
    text = catalog_text("new")
    example = parse_yaml(text, "new")
    sources = {key: said for key, said in example["sources"].items() if key not in entries}
    sources |= {key: entry.source for key, entry in entries.items()}
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
    amplitude = entries.get(f"{_ERROR}.0.amplitude")
    if amplitude is not None and "transmission_error:" in line:
        return line.replace("# transmission_error:", "transmission_error:  ")
    if amplitude is not None and line.startswith("  #   - {order:"):
        return f"    - {{order: 2, amplitude: {amplitude.text}, phase: 0 deg}}"
    found = _LINE.fullmatch(line)
    entry = entries.get(f"{group}.{found['key']}") if found else None
    if found is None or entry is None:
        return line
    start, comment = found["start"], found["comment"] or ""
    wide = found.start("comment") - len(start) if comment else 0
    return f"{start}{f'{entry.text} '.ljust(wide) if comment else entry.text}{comment}"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
