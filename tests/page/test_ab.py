"""Two designs: the verdict of each against one limit, and which is quieter, where both were looked at."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from support.page import PAGE, QUICK, SHORT, drawn, limit, run, until, write

import microvib as mv
from microvib.analysis.lines import steady_lines

pytestmark = PAGE

QUIETER = (
    "[...document.querySelectorAll('#ab-verdict td[data-key=quieter]')].map((td) => td.textContent)"
)


@pytest.mark.release
def test_of_two_steady_runs_the_quieter_is_named_and_each_is_judged(
    visit: Callable[..., Any],
) -> None:
    page = visit(QUICK)
    page.check("#steady")
    run(page)
    write(page, "driver.microsteps", "32")
    page.click("#go")
    drawn(page, 2)
    until(page, f"({QUIETER}).length === 2")
    worst, rms = page.evaluate(QUIETER)
    lines = [
        steady_lines(mv.load_scenario("state-1", {**SHORT, "driver.microsteps": n})).lines
        for n in (16, 32)
    ]
    before, after = (max(x.amplitude for x in of if x.status == "ok") for of in lines)
    decibel = 20.0 * math.log10(before / after)
    assert worst.startswith(f"B, by {decibel:.2f} dB")
    assert rms.startswith("B, by ")
    limit(page, f"{500.0 * (before + after):.4g} mN*m")
    until(page, f"({QUIETER}).length === 3")
    assert page.evaluate(QUIETER)[0] == "B passes, A fails"
    page.get_by_role("button", name="Swap").click()
    until(page, f"({QUIETER})[0] === 'A passes, B fails'")


def test_a_run_in_which_a_mode_still_rings_is_not_judged_quieter(
    visit: Callable[..., Any],
) -> None:
    page = visit(QUICK)
    run(page)
    page.check("#steady")
    page.click("#go")
    drawn(page, 2)
    until(page, f"({QUIETER}).length === 2")
    assert page.evaluate(QUIETER) == ["not judged", "not judged"]
    assert "A: lines while array_mode_1 still rings" in page.locator("#ab-verdict").inner_text()
