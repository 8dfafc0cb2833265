"""What the page draws: zoom, colours, names, narrow windows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.page import (
    PAGE,
    QUICK,
    SHORT,
    api,
    limit,
    run,
    until,
)

import microvib as mv

pytestmark = PAGE


def test_zoom_asks_for_the_window_and_keeps_peaks(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    motion = mv.simulate(mv.load_scenario("state-1", dict(SHORT)))
    whole = page.evaluate("document.querySelector('#history-plot').data[0].y")
    assert max(whole) == pytest.approx(motion["T_d"].max(), rel=1e-12)
    assert min(whole) == pytest.approx(motion["T_d"].min(), rel=1e-12)
    page.get_by_role("button", name="4 microsteps").click()
    page.get_by_text("every sample").wait_for()
    t, y = page.evaluate("(({x, y}) => [x, y])(document.querySelector('#history-plot').data[0])")
    assert np.diff(t) == pytest.approx(1 / 4096)
    assert y == pytest.approx(motion["T_d"][: len(y)])
    page.get_by_role("button", name="Slow motion").click()
    page.get_by_role("button", name="Pause").click()
    page.get_by_label("Instant of the record").fill("10")
    shown = f"{1e3 * motion['T_d'][10]:+#.4g} mN m".replace("-", "−")
    api.expect(page.locator("svg.drive .whole")).to_contain_text(shown)


def test_no_colour_comes_twice(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    colours = page.evaluate(
        "import('/static/styles.js').then(m => [...Array(60).keys()].map(k => m.style(k)[0]))"
    )
    assert len(set(colours)) == 60
    run(page)
    traces = page.evaluate("document.querySelector('#history-plot').data.map(t => t.line.color)")
    assert len(traces) == len(set(traces)) == 7
    assert not set(traces[1:]) & set(colours)


NAMES_APART = """(() => {
    const boxes = [...document.querySelectorAll('#spectrum-plot .annotation-text')].map(e => e.getBoundingClientRect());
    const meet = (a, b) => a.left < b.right - 2 && b.left < a.right - 2 && a.top < b.bottom - 2 && b.top < a.bottom - 2;
    return document.querySelector('#spectrum-plot .main-svg').getBoundingClientRect().width <= innerWidth && boxes.length > 3
        && boxes.every((a, k) => boxes.slice(0, k).every(b => !meet(a, b)));
})()"""


def test_the_spectrum_is_on_the_first_screen_of_a_laptop_and_names_are_apart(
    visit: Callable[..., Any],
) -> None:
    page = visit("#base=state-1")
    run(page)
    limit(page, "30 mN*m")
    api.expect(page.locator("output.verdict")).to_contain_text("Limit 30")
    box = page.locator("#spectrum-plot").bounding_box()
    assert box["y"] + box["height"] < 768
    for width in (1366, 390):
        page.set_viewport_size({"width": width, "height": 844})
        until(page, NAMES_APART)  # plots follow the window
        page.wait_for_timeout(300)
        assert page.evaluate(NAMES_APART)


def test_the_array_view_shows_the_mode_that_the_drive_excites(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&array.fem=reference-array&record.settle=1+s&record.duration=4+s")
    found = page.evaluate(
        """import('/static/channels.js').then(m => m.excited({
          modes: [1, 2, 3].map(k => ({name: `array_mode_${k}`, frequency: k})),
          lines: [{line: 'array_mode_2', kind: 'array mode', status: 'below the floor', amplitude_n_m: 9},
                  {line: 'array_mode_3', kind: 'array mode', status: 'decaying', amplitude_n_m: 2},
                  {line: 'array_mode_1', kind: 'array mode', status: 'ok', amplitude_n_m: 1}]}).name)"""
    )
    assert found == "array_mode_3"
    names = page.evaluate(
        "import('/static/labels.js').then(m => m.modeNames([1, 2, 3, 7].map(k => ({name: `array_mode_${k}`}))))"
    )
    assert names == "array modes 1–3, 7"


@pytest.mark.release
def test_narrow_window(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.set_viewport_size({"width": 400, "height": 800})
    run(page)
    for tab in ("run", "recording", "rates", "sas"):
        page.click(f"#tab-{tab}")
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.click("#tab-run")
    assert page.locator("#spectrum-plot").bounding_box()["width"] > 300


def test_tables_keep_their_columns_on_a_phone(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.set_viewport_size({"width": 390, "height": 844})
    run(page)
    edges = page.evaluate(
        "[...document.querySelectorAll('#run td')].map(e => e.getBoundingClientRect().right)"
    )
    assert len(edges) > 50
    assert max(edges) <= 390
    row = page.locator("#run tr", has_text="drive_1").first
    assert (
        row.locator("td[data-key=amplitude_n_m]").get_attribute("data-label") == "amplitude [mN m]"
    )
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
