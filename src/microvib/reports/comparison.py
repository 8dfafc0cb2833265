"""A comparison for those who read it: which lines agree, spectra, nearest bins."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Annotated

from microvib.analysis.limits import Judgement
from microvib.model.line_names import is_sideband, is_unlisted
from microvib.reports.blocks import OVERLAY_CAPTION, draw_overlay
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.reports.run.margins import margin_tables
from microvib.reports.typography import file_name
from microvib.results import (
    DIFFERENCE,
    LINE_FREQUENCY,
    SHARE,
    TORQUE,
    TORQUE_UNCERTAINTY,
    Column,
    Measure,
    Table,
    columns_of,
)
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
    misread,
)

_MAX_NAMES = 4
"""Lines that a sentence names."""
_SIGNIFICANCE = Measure(form=".1f")


@dataclass(frozen=True)
class ComparedLine:
    """One line of both sides, wherever the bins fall, and its nearest bins."""

    line: Annotated[str, Column("line", "line")]
    a_frequency: Annotated[float, Column("a_frequency_hz", "A", LINE_FREQUENCY)]
    b_frequency: Annotated[float, Column("b_frequency_hz", "B", LINE_FREQUENCY)]
    a_amplitude: Annotated[float, Column("a_amplitude_n_m", "A", TORQUE)]
    a_uncertainty: Annotated[float, Column("a_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    b_amplitude: Annotated[float, Column("b_amplitude_n_m", "B", TORQUE)]
    b_uncertainty: Annotated[float, Column("b_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)]
    difference: Annotated[float, Column("difference_n_m", measure=TORQUE)]
    error: Annotated[float, Column("relative_error", "B against A", DIFFERENCE)]
    significance: Annotated[float, Column("significance", "over uncertainty", _SIGNIFICANCE)]
    a_bin_frequency: Annotated[float, Column("a_bin_frequency_hz", "A", LINE_FREQUENCY)]
    b_bin_frequency: Annotated[float, Column("b_bin_frequency_hz", "B", LINE_FREQUENCY)]
    a_bin_amplitude: Annotated[float, Column("a_bin_amplitude_n_m", "A", TORQUE)]
    b_bin_amplitude: Annotated[float, Column("b_bin_amplitude_n_m", "B", TORQUE)]
    bin_error: Annotated[float, Column("bin_relative_error", "B against A", DIFFERENCE)]
    verdict: Annotated[
        str,
        Column("verdict", "verdict", role="verdict"),
    ]


_BINS = (
    "line", "a_bin_frequency_hz", "b_bin_frequency_hz", "a_bin_amplitude_n_m",
    "b_bin_amplitude_n_m", "bin_relative_error",
)  # fmt: skip
"""Columns of the table of bins; that of lines has the others."""
_LINES = ("line", *(x.key for x in columns_of(ComparedLine).values() if x.key not in _BINS))


def comparison_outcome(
    a: Side, b: Side, rows: Sequence[Row], judged: Sequence[Judgement | None] = ()
) -> Outcome:
    """A comparison for those who read it: verdict line by line wherever the bins fall, spectra, and
    the nearest bins. The file has all lines, readers see the significant ones.

    ``judged`` are the verdicts on both sides by a limit, where one is given.
    """
    shown = significant_rows(rows)
    told = [r for r in shown if math.isfinite(r.a.amplitude) or math.isfinite(r.b.amplitude)]
    binned = [r for r in shown if math.isfinite(r.bin_error)]
    first: list[Item] = [
        Pairs(tuple(_about(a, b))),
        Text(" ".join([*misread(a, b, rows), verdict_sentence(told or shown)])),
        _table(told, _LINES_CAPTION).only(_LINES),
    ]
    torques = [
        (f"{mark}: {file_name(s.name)}", s.torque, s.sample_rate)
        for mark, s in (("A", a), ("B", b))
        if s.torque is not None
    ]
    if torques:
        caption = f"Both sides. {OVERLAY_CAPTION}"
        first += [Picture("spectra", lambda: draw_overlay(torques), "Spectra: both sides", caption)]
    bins = _table(binned, "All of them are in `compare.csv`.").only(_BINS)
    return Outcome(
        "Comparison report",
        "Comparison of disturbance lines",
        f"B against A: {_called(b)} against {_called(a)}.",
        "",
        tuple(_facts(told, shown)),
        (
            Part("", tuple(first)),
            Part("Against the limit", tuple(_against_limit((a, b), judged))),
            Part("Nearest bins", (Text(_BINS_TEXT), bins) if binned else ()),
        ),
        files=(Table.of("compare", ComparedLine, map(_compared, rows), for_readers=()),),
        descriptions={
            f"{mark}, scenario": s.scenario
            for mark, s in (("A", a), ("B", b))
            if s.scenario is not None
        },
    )


def _against_limit(sides: Sequence[Side], judged: Sequence[Judgement | None]) -> Iterator[Item]:
    """The verdict on each side, and its lines with the smallest margins."""
    for mark, side, one in zip("AB", sides, judged, strict=False):
        if one is None:
            yield Text(f"{mark}, {_called(side)}: not judged, as it is no recording.")
            continue
        yield Text(f"{mark}, {_called(side)}: {one}")
        yield from margin_tables(one)


_LINES_CAPTION = (
    "Amplitudes 0-to-peak, independent of the bins; ± is one standard uncertainty. Over uncertainty:"
    " the difference over its standard uncertainty. Hidden: below the noise floor of one "
    "side. Names with _of_b are lines of B only."
    f" Of equal lines one in twenty differs by more than {COVERAGE:g} standard uncertainties by"
    " chance. The uncertainties are those of the records, from the floor about each line: they"
    " include neither the calibration of a test nor the parameters of a model."
)
_BINS_TEXT = (
    "Amplitudes as a rectangular window's nearest bins read them, up to 36 % low between bins."
)


def _table(rows: Sequence[Row], caption: str) -> Table:
    return Table.of("", ComparedLine, map(_compared, rows), caption=caption)


def _compared(r: Row) -> ComparedLine:
    return ComparedLine(
        r.line,
        r.a.frequency,
        r.b.frequency,
        r.a.amplitude,
        r.a.uncertainty,
        r.b.amplitude,
        r.b.uncertainty,
        r.b.amplitude - r.a.amplitude,
        r.error,
        r.significance,
        r.a.bin_frequency,
        r.b.bin_frequency,
        r.a.bin_amplitude,
        r.b.bin_amplitude,
        r.bin_error,
        r.verdict,
    )


def _about(a: Side, b: Side) -> Iterator[tuple[str, str]]:
    """Sides of the comparison, preparation of their recordings, and clocks."""
    yield "A", _called(a)
    yield "B", _called(b)
    for mark, side in (("A", a), ("B", b)):
        for note in side.notes:
            yield f"{mark}, prepared", note
    yield "Clock", clock_sentence(a, b)


def _called(side: Side) -> str:
    return f"{file_name(side.name)} ({side.kind})"


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
    unusable = [r for r in of[UNJUDGED] if not r.usable]
    if unusable:
        rest += (
            f" {count_text(len(unusable), 'line')} beyond the usable band of the force table or"
            f" near its resonances, where it was not corrected, or in the background{_names(unusable)}."
        )
    unsteady = [r for r in of[UNJUDGED] if r.usable and not r.steady]
    if unsteady:
        rest += (
            f" {count_text(len(unsteady), 'line')} in records or bands that are not"
            f" steady{_names(unsteady)}."
        )
    others = [r for r in of[UNJUDGED] if r not in (*unusable, *unsteady)]
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
    return f"{text}; B is {1e6 * (second / first - 1.0):+z.1f} ppm off A."


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
                SHARE.figure(median(abs(e) for _, e, _ in errors)),
                "median difference of amplitudes",
            )
        )
    largest = sorted(errors, key=lambda item: -item[2])[:2]
    return [
        *facts,
        *(Fact(DIFFERENCE.figure(e), f"{r.line}, amplitude of B over A") for r, e, _ in largest),
    ]
