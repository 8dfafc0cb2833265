"""Comparison from command to folder: text, tables, verdict and report."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from statistics import median

from microvib.model.line_names import is_sideband, is_unlisted
from microvib.reports.blocks import overlay_block, study_report
from microvib.reports.document import (
    Block,
    Contents,
    Document,
    Fact,
    Mark,
    Section,
    Table,
    Text,
    pairs,
    table,
)
from microvib.reports.numbers import brief_number, count_text, format_number, milli, percent
from microvib.reports.typography import file_name
from microvib.studies.compare import (
    AGREES,
    COVERAGE,
    DIFFERS,
    HIDDEN,
    ONLY_A,
    ONLY_B,
    UNJUDGED,
    Row,
    Side,
    comparison_csv,
    misread,
)
from microvib.text_tables import text_table

_MAX_FIRST_PAGE = 10
"""Lines on the first page."""
_MAX_NAMES = 4
"""Lines that a sentence names."""


def comparison_text(a: Side, b: Side, rows: Sequence[Row]) -> str:
    """Tables 5 and 6 for any pair, as text: the form that does not depend on bins with a verdict,
    and the nearest bins.
    """
    shown = significant_rows(rows)
    lines = [
        text
        for mark, s in (("A", a), ("B", b))
        for text in (f"{mark}: {s.name} ({s.kind})", *(f"  {n}" for n in s.notes))
    ]
    head = (
        "line",
        "A Hz",
        "B Hz",
        "A N m",
        "B N m",
        "B/A %",
        "verdict",
        "A bin N m",
        "B bin N m",
        "bin B/A %",
    )
    listed: list[tuple[str, ...]] = []
    for r in shown:
        hz = (
            brief_number(x.frequency if math.isfinite(x.frequency) else x.bin_frequency, 8)
            for x in (r.a, r.b)
        )
        found = (
            brief_number(r.a.amplitude),
            brief_number(r.b.amplitude),
            percent(r.error),
            r.verdict,
        )
        bins = (
            brief_number(r.a.bin_amplitude),
            brief_number(r.b.bin_amplitude),
            percent(r.bin_error),
        )
        listed.append((r.line, *hz, *found, *bins))
    lines += [
        clock_sentence(a, b),
        "",
        text_table(head, listed, left=1),
    ]
    return "\n".join([*lines, "", *misread(a, b, rows), verdict_sentence(shown)])


def significant_rows(rows: Sequence[Row]) -> list[Row]:
    """Lines of at least a thousandth of the largest on either side; sidebands and unexpected lines
    a fiftieth.
    """

    def size(row: Row) -> float:
        values = [
            x.amplitude if math.isfinite(x.amplitude) else x.bin_amplitude for x in (row.a, row.b)
        ]
        return max((v for v in values if math.isfinite(v)), default=0.0)

    def least(row: Row) -> float:
        if is_sideband(row.line) or is_unlisted(row.line):
            return 0.02
        return 1e-3

    top = max((size(row) for row in rows), default=0.0)
    return [row for row in rows if size(row) >= least(row) * top]


def verdict_sentence(rows: Sequence[Row]) -> str:
    """How many lines agree within the uncertainties, which do not, and what that is worth."""
    of = {
        v: [r for r in rows if r.verdict == v]
        for v in (AGREES, DIFFERS, HIDDEN, ONLY_A, ONLY_B, UNJUDGED)
    }
    agree, differ = (
        f"{verb}{'s' if len(of[v]) == 1 else ''}"
        for verb, v in (("agree", AGREES), ("differ", DIFFERS))
    )
    judged = len(of[AGREES]) + len(of[DIFFERS])
    rest = "No line is judged: on one side the uncertainty is unknown or the lines are below the noise floor."
    if judged:
        rest = (
            f"{len(of[AGREES])} of {count_text(judged, 'line')} {agree} within {COVERAGE:g}"
            " standard uncertainties of the"
            f" difference{_names(of[AGREES])}; {len(of[DIFFERS])} {differ}{_names(of[DIFFERS])}."
        )
    for v, text in (
        (HIDDEN, "hidden by the floor of one side"),
        (ONLY_A, "only A has"),
        (ONLY_B, "only B has"),
    ):
        if of[v]:
            rest += f" {count_text(len(of[v]), 'line')} {text}{_names(of[v])}."
    unsteady = [r for r in of[UNJUDGED] if not (r.a.steady and r.b.steady)]
    if unsteady:
        rest += (
            f" {count_text(len(unsteady), 'line')} in bands that are not steady{_names(unsteady)}."
        )
    others = [r for r in of[UNJUDGED] if r not in unsteady]
    if others and judged:
        rest += f" {count_text(len(others), 'line')} without uncertainties{_names(others)}."
    return rest


def _names(rows: Sequence[Row]) -> str:
    """The largest of some lines by name, in parentheses."""
    by_size = sorted(
        rows,
        key=lambda r: -max(x for x in (r.a.amplitude, r.b.amplitude, 0.0) if not math.isnan(x)),
    )
    names = [r.line for r in by_size[:_MAX_NAMES]]
    if len(rows) > len(names):
        more = f" and {len(rows) - len(names)} more"
    else:
        more = ""
    if names:
        return f" ({', '.join(names)}{more})"
    return ""


def clock_sentence(a: Side, b: Side) -> str:
    """Step clocks of both sides, and whether the comparison set one to the other."""
    known = [(mark, s) for mark, s in (("A", a), ("B", b)) if s.clock_ratio is not None]
    if not known:
        return "Step clock: not known on either side."
    text = "Step clock over nominal: " + ", ".join(
        f"{mark} {s.clock_ratio:.7f}" for mark, s in known
    )
    if len(known) < 2:
        return f"{text}; not known on the other side."
    simulated = [mark for mark, s in known if s.kind == "simulation"]
    if len(simulated) == 1 and any(s.kind == "recording" for _, s in known):
        agree = "their frequencies agree by construction"
        return f"{text}; {simulated[0]} was simulated at the recording's clock: {agree}."
    first, second = (float(s.clock_ratio or math.nan) for _, s in known)
    return f"{text}; B is {1e6 * (second / first - 1.0):+.1f} ppm off A."


def comparison_folder(a: Side, b: Side, rows: Sequence[Row]) -> Contents:
    """``compare.csv`` and the report of a comparison."""
    return {"compare.csv": comparison_csv(rows)}, comparison_report(a, b, rows)


def comparison_report(a: Side, b: Side, rows: Sequence[Row]) -> Document:
    """The report of a comparison: verdict line by line wherever the bins fall, spectra, the nearest-bin
    nearest bins.
    """
    shown = significant_rows(rows)
    told = [r for r in shown if math.isfinite(r.a.amplitude) or math.isfinite(r.b.amplitude)]
    main = sorted((r for r in told if math.isfinite(r.error)), key=lambda r: -r.a.amplitude)[
        :_MAX_FIRST_PAGE
    ]
    binned = [r for r in shown if math.isfinite(r.bin_error) and (r in main or not main)]
    sides = {"A": a, "B": b}
    called = {mark: f"{file_name(s.name)} ({s.kind})" for mark, s in sides.items()}
    notes = [(f"{mark}, prepared", note) for mark, s in sides.items() for note in s.notes]
    first_page: list[Block] = [pairs((*called.items(), *notes, ("Clock", clock_sentence(a, b))))]
    first_page += [
        Text(" ".join([*misread(a, b, rows), verdict_sentence(told or shown), _UNCERTAINTY_NOTE]))
    ]
    if main:
        first_page += [_line_table([r for r in told if r in main])]
    else:
        first_page += []
    torques = [
        (f"{k}: {file_name(s.name)}", s.torque, s.sample_rate)
        for k, s in sides.items()
        if s.torque is not None
    ]
    if torques:
        first_page += [overlay_block(torques, "Both sides")]
    else:
        first_page += []
    if len(main) < len(told):
        sections = [Section("All lines", (_line_table(told),), new_page=True)]
    else:
        sections = []
    if binned:
        sections += [Section("Nearest bins (as Tables 5 and 6)", _bin_blocks(binned))]
    else:
        sections += []
    return study_report(
        "Comparison report",
        "Comparison of disturbance lines",
        f"B against A: {called['B']} against {called['A']}.",
        facts=_facts(told, shown),
        first_page=first_page,
        sections=sections,
        parts={
            f"{mark}, scenario": s.scenario for mark, s in sides.items() if s.scenario is not None
        },
    )


_UNCERTAINTY_NOTE = (
    f"Of equal lines one in twenty differs by more than {COVERAGE:g} standard uncertainties by"
    " chance. The uncertainties"
    " are those of the records, from the floor about each line: they include neither the"
    " calibration of a test nor the parameters"
    " of a model."
)


def _facts(told: Sequence[Row], shown: Sequence[Row]) -> list[Fact]:
    verdicts = Counter(r.verdict for r in told)
    judged = verdicts[AGREES] + verdicts[DIFFERS]
    facts = [Fact("not judged", "one side has no known uncertainty")]
    if judged:
        facts = [
            Fact(
                f"{verdicts[AGREES]} of {judged}",
                f"lines agree within {COVERAGE:g} standard uncertainties",
            )
        ]
    errors = [
        (r, r.error, r.a.amplitude) for r in told if math.isfinite(r.error) and r.verdict != HIDDEN
    ]
    errors = errors or [
        (r, r.bin_error, r.a.bin_amplitude) for r in shown if math.isfinite(r.bin_error)
    ]
    if errors:
        facts.append(
            Fact(
                f"{100 * median(abs(e) for _, e, _ in errors):.3g} %",
                "median difference of amplitudes",
            )
        )
    largest = sorted(errors, key=lambda item: -item[2])[:2]
    return [
        *facts,
        *(Fact(f"{percent(e)} %", f"{r.line}, amplitude of B over A") for r, e, _ in largest),
    ]


def _line_table(rows: Sequence[Row]) -> Table:
    header = ["line", "A [Hz]", "B [Hz]", "A [mN m]", "± [mN m]", "B [mN m]", "± [mN m]", "B against A [%]",
              "over uncertainty [1]", "verdict"]  # fmt: skip
    cells = [
        [r.line, format_number(r.a.frequency, 6), format_number(r.b.frequency, 6), milli(r.a.amplitude), _spread(r.a.uncertainty),
         milli(r.b.amplitude), _spread(r.b.uncertainty), percent(r.error), _times(r.significance), r.verdict]
        for r in rows
    ]  # fmt: skip
    caption = (
        "Amplitudes 0-to-peak, wherever the bins fall; ± is one standard uncertainty. Over"
        " uncertainty: the difference over its"
        " standard uncertainty. Hidden: does not stand out of the floor of one side. Names with"
        " _of_b are lines that only B has."
    )
    looks: dict[str, Mark] = {AGREES: "pass", DIFFERS: "off"}
    return table(header, cells, caption, {k: looks.get(r.verdict, "") for k, r in enumerate(rows)})


def _spread(value: float) -> str:
    if not value > 0.0:
        return ""
    if value < 1e-6:
        return "< 0.001"
    return brief_number(1e3 * value, 2)


def _times(value: float) -> str:
    """A multiple of an uncertainty; beyond a hundred its digits say nothing."""
    if value > 100.0:
        return "> 100"
    return format_number(value, 2)


def _bin_blocks(rows: Sequence[Row]) -> tuple[Text | Table, ...]:
    header = ["line", "A [Hz]", "B [Hz]", "A [mN m]", "B [mN m]", "B − A [mN m]", "B against A [%]"]
    cells = [
        [r.line, format_number(r.a.bin_frequency, 7), format_number(r.b.bin_frequency, 7), milli(r.a.bin_amplitude),
         milli(r.b.bin_amplitude), milli(r.b.bin_amplitude - r.a.bin_amplitude, 3), percent(r.bin_error)]
        for r in rows
    ]  # fmt: skip
    text = "Rectangular window, nearest bin. Between bins it reads up to 36 % low."
    return Text(text), table(header, cells, "All of them are in `compare.csv`.")
