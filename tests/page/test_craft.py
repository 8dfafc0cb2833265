"""A run on a craft: picture, window as a slider, ranking, loads."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.page import PAGE, api, run, until

import microvib as mv
from microvib.analysis.hub_lines import hub_lines
from microvib.signals.pointing import METRICS, metric_weight

pytestmark = PAGE
EXAMPLE = Path(__file__).parents[2] / "examples" / "spacecraft.yaml"


def short(text: str) -> str:
    return text.replace("settle: 30 s, duration: 16 s", "settle: 2 s, duration: 8 s")


def test_the_window_is_a_slider_and_its_figures_are_those_of_the_library(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    path = tmp_path / "craft.yaml"
    path.write_text(short(EXAMPLE.read_text()))
    page = visit("#base=state-1")
    page.set_input_files("#upload", path)
    api.expect(page.locator("#title")).to_contain_text("Small craft")
    run(page)
    card = page.locator(".craft")
    api.expect(card).to_contain_text("hub of 420 kg, rigid; array at 30°")
    assert page.evaluate("document.querySelector('.craft img').naturalWidth") > 300
    result = mv.run_scenario(mv.load_scenario(path))
    assert result.motion is not None
    hub = hub_lines(result.motion, result.table)
    card.get_by_role("button", name="100 ms").click()
    squares = hub.mean_squares("rpe", 0.1).sum()
    said = card.locator(".seen")
    api.expect(said).to_contain_text("RPE in 100 ms")
    api.expect(said).to_contain_text(f"{np.sqrt(squares) / 0.5e-6:.3g}"[:4])
    api.expect(card.locator(".ranking li").first).to_contain_text(hub.ranking("rpe", 0.1)[0][0])
    page.get_by_label("in a window of").fill("0")
    api.expect(said).to_contain_text("RPE in 1 s")
    card.locator("#craft-metric").select_option("jitter")
    api.expect(said).to_contain_text("jitter in 1 s")
    api.expect(card.locator(".ranking li").first).to_contain_text(hub.ranking("jitter", 1.0)[0][0])
    loads = page.locator("#run .wide[aria-label='Loads on the hub']")
    name = page.locator("td[data-key=line]", has_text=re.compile("^drive_1$"))
    row = loads.locator("tr").filter(has=name)
    k = hub.names.index("drive_1")
    api.expect(row.locator("[data-key=My]")).to_have_text(f"{1e3 * abs(hub.loads[k, 4]):#.4g}")
    with page.expect_download() as download:
        page.get_by_text("Download", exact=True).click()
        page.get_by_role("link", name="line of sight (CSV)").click()
    assert download.value.suggested_filename == "pointing.csv"
    page.set_viewport_size({"width": 390, "height": 844})
    until(page, "document.documentElement.scrollWidth <= 390")  # plots follow the window


def test_weights_of_the_page_are_those_of_the_library(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1")
    at = [1e-4, 1e-2, 0.1, 0.157, 0.16, 0.5, 1.0, 1.4303, 7.7]
    for metric in METRICS:
        call = "([metric, at]) => import('/static/craft.js').then(m => at.map(f => m.weight(metric, f, 1)))"
        assert page.evaluate(call, [metric, at]) == pytest.approx(
            metric_weight(metric, np.array(at), 1.0), rel=1e-5, abs=1e-15
        )


@pytest.mark.release
def test_firm_ground_has_no_such_card(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&record.settle=1+s&record.duration=4+s")
    run(page)
    assert page.locator(".craft").count() == 0
