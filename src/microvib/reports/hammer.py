"""A hammer test of a force table for those who read it: resonances, responses, blows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from microvib.io.scenario_file import dump_part
from microvib.io.table_responses import table_response_csv
from microvib.reports import sheets
from microvib.reports.document import Fact, Text
from microvib.reports.numbers import count_text
from microvib.reports.outcome import Item, Outcome, Pairs, Part, Picture
from microvib.results import FREQUENCY, SHARE, Table
from microvib.studies.hammer import FittedResonance, FoundBlow, HammerTest
from microvib.testdata.table_response import (
    MIN_COHERENCE,
    STATIC_ERROR_TOLD,
    USABLE_PART,
    TableResponseError,
    static_mistake,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_CHAIN_ERROR_TOLD = 0.005
"""Relative error by a filter of the hammer's channel from which it is reported."""


def hammer_outcome(test: HammerTest) -> Outcome:
    """A hammer test for those who read it: resonances with uncertainties, responses with coherence, and
    which blows were left out and why; files for the correction of recordings and for the virtual bench.
    """
    left_out = [x for x in test.blows if x.rejected]
    first: list[Item] = [
        Pairs(tuple(_about(test))),
        Table.of("resonances", FittedResonance, test.resonances, caption=_RESONANCES_CAPTION),
        *(Text(sentence) for sentence in _remarks(test)),
    ]
    pictures = tuple(
        Picture(
            f"response_{name}",
            lambda name=name: draw_response(test, name),  # type: ignore[misc]
            f"Response of {name}: magnitude, phase and coherence",
            _PICTURE_CAPTION,
        )
        for name in test.each
    )
    return Outcome(
        "Hammer test",
        "Hammer test of the force table",
        f"Responses of {', '.join(test.each)} over their loads, with {test.mounted_mass:g} kg on the table.",
        "",
        tuple(_facts(test)),
        (
            Part("", tuple(first)),
            Part("Responses", pictures),
            Part("Blows left out", (Table.of("", FoundBlow, left_out),) if left_out else ()),
            Part("How to use it", (Text(_USE),)),
        ),
        files=(Table.of("blows", FoundBlow, test.blows, for_readers=()),),
        other_files={
            "frf.csv": table_response_csv(test.responses),
            "table.yaml": dump_part(test.bench),
        },
    )


_RESONANCES_CAPTION = (
    "± are relative standard uncertainties of the fit, enlarged where it misfits. Misfit: 1 where only noise"
    " is left; from 3 on the bench's model does not describe the response, and the resonance is left out of"
    " `table.yaml`."
)
_PICTURE_CAPTION = (
    f"Dots, measured; line, the fitted resonances; dashed, half of the first resonance, up to which recordings"
    f" are corrected; dotted, a coherence of {MIN_COHERENCE:g}."
)
_USE = (
    "`frf.csv` takes the table's dynamics out of recordings: `table_frf: {file: frf.csv, mounted_mass: ...,"
    " test_mass: ...}` in the preparation file. `table.yaml` is a bench: `microvib measure SCENARIO --bench"
    " table.yaml`."
)


def _about(test: HammerTest) -> Iterator[tuple[str, str]]:
    yield "Mass on the table", f"{test.mounted_mass:g} kg; the responses hold for it"
    yield "Estimate", test.estimator
    for name, one in test.each.items():
        found = f"{one.averages} of {count_text(len(one.blows), 'blow')} count"
        bins = f"bins of {one.frequency[0]:.4g} Hz"
        window = "rung down at the end of its blocks"
        if one.window_decay > 0.0:
            window = (
                f"not rung down at the end of its blocks: an exponential of {one.window_decay:.3g} 1/s,"
                " which the damping ratios leave out and uncertainties include"
            )
        yield name, f"{found}, {bins}, {window}"


def _remarks(test: HammerTest) -> Iterator[str]:
    for name in test.each:
        own = [x for x in test.resonances if x.component == name]
        highest = test.responses.highest(name)
        if not own:
            yield (
                f"{name}: no resonance rises above the noise; recordings can be corrected up to"
                f" {highest:.4g} Hz, half of what the response covers."
            )
        elif not all(x.trusted for x in own):
            yield f"{name}: the fitted resonances do not describe the response; use frf.csv, not table.yaml."
        yield from _about_static_value(test, name)
        yield from _about_hammer_filter(test, name, highest)


def _about_hammer_filter(test: HammerTest, name: str, highest: float) -> Iterator[str]:
    """A sentence where the hammer's channel seems to have a filter of its own."""
    error = test.responses.chain_error(name)[test.responses.frequency <= highest]
    if (largest := float(np.nanmax(error, initial=0.0))) > _CHAIN_ERROR_TOLD:
        yield (
            f"{name} leads its load, or lags it too much: the hammer's channel has a filter or a delay of its own."
            f" The response may be {100.0 * largest:.2g} % off up to {highest:.4g} Hz by it, which is in the"
            " uncertainty of recordings; take it out of the hammer's channel (response in the preparation file)."
        )


def _about_static_value(test: HammerTest, name: str) -> Iterator[str]:
    """A sentence where a reading at low frequencies is not its load."""
    with suppress(TableResponseError):  # where it cannot be seen
        value = test.responses.static_value(name)
        if abs(value - 1.0) > STATIC_ERROR_TOLD:
            yield (
                f"{name} reads {value:.3g} times its load at low frequencies{static_mistake(value)}: a"
                " sensitivity of hammer or table, a sign or an arm is wrong. Correct it; else recordings are"
                " not corrected, or this difference is in their uncertainty."
            )


def _facts(test: HammerTest) -> Iterator[Fact]:
    if test.resonances:
        first = min(test.resonances, key=lambda x: x.frequency)
        yield Fact(FREQUENCY.figure(first.frequency), f"first resonance, {first.component}")
        yield Fact(SHARE.figure(first.damping), "its damping ratio")
        yield Fact(FREQUENCY.figure(USABLE_PART * first.frequency), "highest that is corrected")
    rejected = sum(bool(x.rejected) for x in test.blows)
    yield Fact(f"{len(test.blows) - rejected} of {len(test.blows)}", "blows count")


def draw_response(test: HammerTest, name: str) -> Figure:
    """Magnitude, phase and coherence of one response over frequency, with the fitted resonances."""
    one = test.each[name]
    f = one.frequency
    top = min(f[-1], 3.0 * _last(test, name, float(f[-1])))
    shown = f <= top
    drawing, axes = sheets.plain_sheet(6.0, 3, 1)
    magnitude, phase, coherence = axes[:, 0]
    H = one.H[shown]
    magnitude.semilogy(f[shown], np.abs(H), ".", ms=2, color="0.55")
    phase.plot(f[shown], np.degrees(np.angle(H)), ".", ms=2, color="0.55")
    coherence.plot(f[shown], one.coherence[shown], ".", ms=2, color="0.55")
    coherence.axhline(MIN_COHERENCE, ls=":", color="k", lw=0.8)
    model = test.model(name, f[shown])
    if model is not None:
        magnitude.semilogy(f[shown], np.abs(model), lw=1.0)
        phase.plot(f[shown], np.degrees(np.angle(model)), lw=1.0)
    for ax in (magnitude, phase, coherence):
        ax.set_xlim(0.0, top)
        ax.axvline(test.responses.highest(name), ls="--", color="k", lw=0.8)
    magnitude.set_ylabel(f"{name} over its load")
    phase.set_ylabel("phase [deg]")
    phase.set_ylim(-190.0, 190.0)
    phase.set_yticks([-180, -90, 0, 90, 180])
    coherence.set_ylabel("coherence")
    coherence.set_ylim(0.0, 1.05)
    coherence.set_xlabel("frequency [Hz]")
    return drawing


def _last(test: HammerTest, name: str, otherwise: float) -> float:
    return max((x.frequency for x in test.resonances if x.component == name), default=otherwise)
