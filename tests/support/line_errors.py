"""How far the lines of one run are from those of another."""

from microvib.analysis.accuracy import MIN_LINE_RATIO
from microvib.signals.line_table import LineTable


def worst_change(table: LineTable, exact: LineTable) -> tuple[float, str]:
    """Largest relative change of a line of the clock that both have, of those at least LEAST of the
    largest, and its name.
    """
    listed = {
        x.name: x for x in table if x.kind not in ("array mode", "other") and x.status == "ok"
    }
    pairs = [(listed[x.name], x) for x in exact if x.name in listed and x.status == "ok"]
    top = max((x.amplitude for _, x in pairs), default=0.0)
    changes = [
        (abs(x.amplitude / y.amplitude - 1.0), y.name)
        for x, y in pairs
        if y.amplitude >= MIN_LINE_RATIO * top
    ]
    return max(changes, default=(0.0, ""))
