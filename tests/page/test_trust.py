"""Who gets in, and what foreign text may do: nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support.page import (
    PAGE,
    SHORT,
    api,
    downloads,
    run,
    until,
)
from support.scenarios import baseline

from microvib.io.scenario_file import dump_scenario
from microvib.reports.document import AnimatedMarkup, Document, Section
from microvib.reports.moving import AnimatedShape, markup
from microvib.reports.rendering import html
from microvib.web.server.access import Access, opening_file

pytestmark = PAGE


def test_the_token_goes_into_the_browser_and_out_of_the_address(
    chromium: Any, printed_address: str, address: str, tmp_path: Path
) -> None:
    """Through the file that the command opens: other users see a browser's address in the list of processes."""
    page = chromium.new_context().new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    api.expect(page.locator("#alert")).to_contain_text(
        "open the address that microvib serve printed"
    )
    token = printed_address.partition("token=")[2]
    page.goto(opening_file(tmp_path, address, Access(token=token)).as_uri())
    page.wait_for_selector("html[data-ready]")
    assert page.url.startswith(address)
    assert not any(token in url for url in [*asked, page.url, page.evaluate("document.referrer")])
    assert page.evaluate("document.cookie") == ""
    (cookie,) = page.context.cookies()
    assert (cookie["name"], cookie["httpOnly"], cookie["sameSite"]) == (
        f"microvib-{address[:-1].rpartition(':')[2]}",
        True,
        "Strict",
    )
    fragment = "#base=state-5"
    page.goto(printed_address + fragment)  # what a person may type
    page.wait_for_selector("html[data-ready]")
    assert page.url.startswith(address)
    assert page.url.endswith(fragment)
    assert token not in page.url


FOREIGN = """<a href="https://evil.example/">Press</a><img src="https://evil.example/x.png" onerror="alert(1)"><script>alert(1)</script><b>&lt;</b>"""


def test_a_foreign_title_is_text_wherever_it_stands(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    mine = baseline().with_(dict(SHORT)).model_copy(update={"title": FOREIGN})
    (tmp_path / "mine.yaml").write_text(dump_scenario(mine), encoding="utf-8")
    page.set_input_files("#upload", tmp_path / "mine.yaml")
    api.expect(page.locator("#title")).to_have_text(FOREIGN)
    run(page)
    page.evaluate(
        """async (title) => {
          const { draw } = await import("/static/plots.js");
          const data = [{ x: [1, 2], y: [1, 2], name: title, text: [title, title], hovertemplate: `%{text}<extra>%{fullData.name}</extra>` }];
          const place = document.querySelector("#spectrum-plot");
          await draw(place, data, { showlegend: true, title: { text: title }, annotations: [{ x: 1, y: 1, text: title }] });
          await window.Plotly.Fx.hover(place, [{ curveNumber: 0, pointNumber: 0 }]);
        }""",
        FOREIGN,
    )
    assert page.locator("#spectrum-plot .legendtext").inner_html().count("<") == 0
    assert page.locator("#spectrum-plot .legendtext").text_content() == FOREIGN
    assert "Press" in page.locator("#spectrum-plot .hoverlayer").text_content()
    assert "Press" in page.locator("#spectrum-plot .annotation").text_content()
    assert not page.locator("#results a[href*=evil], #results svg a, img[src*=evil]").count()
    report = tmp_path / "report.html"
    report.write_bytes(downloads(page, tmp_path)["report.html"])
    shown = page.context.new_page()
    asked: list[str] = []
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto(report.as_uri())
    assert shown.locator("h1").inner_text().startswith('<a href="https://evil.example/">')
    assert not shown.locator("a, script").count()
    assert not [url for url in asked if not url.startswith(("file:", "data:"))]
    shown.evaluate(
        "document.body.append(Object.assign(new Image(), { src: 'https://evil.example/y.png' }))"
    )
    shown.evaluate(
        "document.body.append(Object.assign(document.createElement('script'), { textContent: 'window.ran = 1' }))"
    )
    assert shown.evaluate("window.ran") is None  # nor would what might slip in later


def test_the_one_script_of_a_report_runs(chromium: Any, tmp_path: Path) -> None:
    """The report's policy lets mode shapes move, and names no more than their script."""
    ends = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    none = np.zeros((0, 2), dtype=int)
    beam = AnimatedShape(
        ends,
        np.array([[[0.0], [0.0], [0.0]], [[0.0], [0.0], [1.0]]]),
        np.zeros((0, 4), int),
        np.array([[0, 1]]),
        none,
    )
    section = Section("In motion", (AnimatedMarkup(markup(beam.data(), ["first"])),))
    document = Document("report", "modes", "", (), (), (section,), "")
    (tmp_path / "report.html").write_text(html(document), encoding="utf-8")
    page = chromium.new_context().new_page()
    page.goto((tmp_path / "report.html").as_uri())
    assert page.locator("#shape-mode option").all_text_contents() == ["first"]
    picture = "document.querySelector('canvas').toDataURL()"
    first = page.evaluate(picture)
    until(page, f"{picture} !== {first!r}")  # it moves
    page.get_by_role("button", name="Pause").click()
    still = page.evaluate(picture)
    page.wait_for_timeout(300)
    assert page.evaluate(picture) == still
