"""Units and figures of the page in the characters of reports, and nothing of it cut off on a phone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from support.page import PAGE, QUICK, run, until

from microvib.solve.channels import ALL_CHANNELS
from microvib.units import pretty

pytestmark = PAGE
UNITS = sorted(
    {channel.unit for channel in ALL_CHANNELS.values()} - {"", "1"}
    | {"kg^0.5*m", "ohm", "s^-1", "deg/s", "percent"}
)
CUT = """() => {
  const wide = document.documentElement.clientWidth;
  const cells = [...document.querySelectorAll("td.n")].filter((cell) => cell.offsetParent && /\\d/.test(cell.textContent));
  const lines = (cell) => {
    const range = document.createRange();
    range.selectNodeContents(cell);
    return new Set([...range.getClientRects()].map((box) => Math.round(box.top))).size;
  };
  return {
    beyond: document.documentElement.scrollWidth - wide,
    cells: cells.length,
    broken: cells.filter((cell) => lines(cell) > 1).map((cell) => cell.textContent),
  };
}"""


def test_units_are_printed_as_in_reports(visit: Callable[..., Any]) -> None:
    page = visit()
    printed = page.evaluate(
        "(units) => import('/static/dom.js').then((dom) => units.map((unit) => dom.unitText(unit)))",
        UNITS,
    )
    assert printed == [pretty(unit) for unit in UNITS]
    shown = page.evaluate(
        "() => import('/static/dom.js').then(({ quantity }) =>"
        " [quantity(0.0366, 'N*m'), quantity(1e-5, 'mV'), quantity(2e-6, 'rad'), quantity(0.5, 'percent')])"
    )
    assert shown == ["36.6 mN m", "1.00e−5 mV", "2.00 µrad", "0.500 %"]
    figures = page.evaluate(
        "() => import('/static/dom.js').then(({ number, percent }) =>"
        " [number(99.97, 2), percent(5.9e-7), percent(-1e-6), percent(-0.0123), percent(0.5), percent(null)])"
    )
    assert figures == ["100", "+0.00 %", "+0.00 %", "−1.23 %", "+50.0 %", "–"]


def test_figures_are_whole_on_a_phone_and_a_tab_shows_its_results(
    visit: Callable[..., Any],
) -> None:
    page = visit(QUICK)
    page.set_viewport_size({"width": 390, "height": 844})
    run(page)
    page.locator("#run td").first.wait_for()
    found = page.evaluate(CUT)
    assert found["cells"] > 20
    assert (found["beyond"], found["broken"]) == (0, [])
    page.evaluate("() => scrollTo(0, 0)")
    page.click("#tab-rates")
    button = page.locator("#rates button.primary").bounding_box()
    assert button["y"] + button["height"] <= 844  # where a person sees it without scrolling


BROKEN = """() => [...document.querySelectorAll("#rates tbody td")].filter((cell) => {
  const range = document.createRange();
  range.selectNodeContents(cell);
  const wide = cell.getBoundingClientRect().width - range.getBoundingClientRect().width;
  return cell.previousElementSibling && cell.dataset.label.length > 2 && wide < 24;
}).map((cell) => cell.dataset.label)"""


@pytest.mark.release
def test_diagrams_and_names_of_figures_follow_a_window_that_becomes_narrow(
    visit: Callable[..., Any],
) -> None:
    page = visit()
    page.click("#tab-rates")
    page.fill("#rates-count", "12")
    page.fill("#rates-limit", "30 mN*m")
    page.check("#rates-linear")
    page.locator("#rates button.primary").click()
    rows = "document.querySelector('#campbell-plot')?.layout?.grid?.rows"
    until(page, f"{rows} === 1")
    page.set_viewport_size({"width": 390, "height": 844})
    until(page, f"{rows} === 2")
    assert page.locator("#rates tbody td[data-key=why]").count()
    assert page.evaluate(BROKEN) == []
