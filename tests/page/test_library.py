"""The library in a browser: what ended before a restart is there after it, can be renamed, deleted, brought back."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.page import PAGE, QUICK, api, drawn, run, served, until

from microvib.io.recordings import write_recording
from microvib.testdata.recording import Recording

pytestmark = PAGE
DATA = "(document.querySelector('#spectrum-plot').data ?? [])"
DRAWN = f"() => {DATA}.find((trace) => trace.mode === 'lines')?.y.slice(0, 50)"


def opened(chromium: Any, address: str, fragment: str = QUICK) -> Any:
    """The page in a browser that has never seen it."""
    window = chromium.new_context(viewport={"width": 1366, "height": 768})
    window.set_default_timeout(240_000)
    page = window.new_page()
    page.goto(address + fragment)
    page.wait_for_selector("html[data-ready]")
    return page


def row(page: Any, name: str) -> Any:
    return page.locator(f"#library tr[data-title='{name}']")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    time = np.arange(8000) / 400
    tone = 0.02 * np.sin(2 * np.pi * 12 * time)
    write_recording(Recording({"Mz": tone}, 400.0, {"Mz": "N*m"}), tmp_path / "test.csv")
    return tmp_path / "test.csv"


@pytest.mark.release
def test_runs_and_recordings_are_there_after_a_restart(
    chromium: Any, tmp_path: Path, recording: Path
) -> None:
    library = tmp_path / "library"
    with served(library=library) as address:
        page = opened(chromium, address)
        run(page)
        before = page.evaluate(DRAWN)
        page.locator(".chip .pen").click()
        page.locator(".chip .rename").fill("qualification unit")
        page.locator(".chip .rename").press("Enter")
        api.expect(page.locator(".chip .name")).to_have_text("qualification unit")
        page.click("#tab-recording")
        page.set_input_files("#recording-file", recording)
        page.locator("#recording-plot .main-svg").first.wait_for()
        page.click("#tab-rates")
        page.check("#rates-linear")
        page.locator("#rates button.primary").click()
        page.locator("#campbell-plot .main-svg").first.wait_for()
    with served(int(re.findall(r":(\d+)/", address)[0]), library) as address:
        api.expect(page.locator("#server")).to_contain_text("was restarted", timeout=240_000)
        page.goto(address)  # in the same browser: what the tab had
        page.wait_for_selector("html[data-ready]")
        page.click("#tab-run")
        drawn(page, 1)
        assert page.evaluate(DRAWN) == before
        page.click("#tab-rates")
        page.locator("#campbell-plot .main-svg").first.wait_for()

        page = opened(chromium, address)  # in another: from the library
        assert page.locator(".chip").count() == 0
        page.click("#tab-library")
        row(page, "qualification unit").get_by_role("button", name="Open").click()
        drawn(page, 1)
        assert page.evaluate(DRAWN) == before
        api.expect(page.locator(".chip .name")).to_have_text("qualification unit")
        page.fill("#limit", "30 mN*m")
        page.locator("#limit").blur()
        api.expect(page.locator("output.verdict")).to_contain_text("Limit")
        page.click("#tab-library")
        page.locator("#library tr").filter(has_text="rate map").get_by_role(
            "button", name="Open"
        ).click()
        page.locator("#campbell-plot .main-svg").first.wait_for()
        page.click("#tab-library")
        row(page, "test.csv").get_by_role("button", name="Open").click()
        page.locator("#recording-plot .main-svg").first.wait_for()


def test_entries_are_renamed_found_deleted_and_brought_back(
    chromium: Any, tmp_path: Path, recording: Path
) -> None:
    with served(library=tmp_path / "library") as address:
        page = opened(chromium, address)
        run(page)
        page.click("#tab-recording")
        page.set_input_files("#recording-file", recording)
        page.locator("#recording-plot .main-svg").first.wait_for()
        page.click("#tab-library")
        attributes = row(page, "test.csv").get_by_label(re.compile("Attributes"))
        attributes.fill("unit: 2, axis: +Z")
        attributes.blur()
        page.reload()
        page.wait_for_selector("html[data-ready]")
        page.fill("#library-search", "+Z")
        api.expect(page.locator("#library tbody tr")).to_have_count(1)
        page.fill("#library-search", "")
        kind = page.locator("td", has_text=re.compile("^run$"))
        name = page.locator("#library tr").filter(has=kind).get_by_label(re.compile("Name"))
        name.fill("first light")
        name.blur()
        row(page, "first light").wait_for()
        api.expect(page.locator(".chip .name span")).to_have_text("first light")
        row(page, "first light").get_by_role("button", name="Delete").click()
        page.get_by_role("button", name="Undo", exact=True).wait_for()
        api.expect(row(page, "first light")).to_have_count(0)
        until(page, "document.querySelectorAll('.chip').length === 0")
        page.get_by_role("button", name="Undo", exact=True).click()
        row(page, "first light").get_by_role("button", name="Open").click()
        drawn(page, 1)


def test_a_server_without_a_library_says_so(visit: Callable[..., Any]) -> None:
    page = visit()
    page.click("#tab-library")
    api.expect(page.locator("#library")).to_contain_text("This server keeps nothing")
