"""One server and one browser for all tests of the page, which are skipped where there is no browser to drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

QUIET = [
    "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--no-first-run",
]  # fmt: skip


@pytest.fixture(scope="session")
def printed_address() -> Iterator[str]:
    from support.page import served

    with served() as address:
        yield address


@pytest.fixture(scope="session")
def address(printed_address: str) -> str:
    """Where the server listens."""
    return printed_address.partition("?")[0]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    from support.page import CHROMIUM, api

    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def browser(chromium: Any, printed_address: str) -> Any:
    """A window of a browser that was let in; its pages share a cache, cookie and key, and no more."""
    window = chromium.new_context(viewport={"width": 1366, "height": 768}, accept_downloads=True)
    window.set_default_timeout(240_000)
    page = window.new_page()
    page.goto(printed_address)
    page.wait_for_selector("html[data-ready]")
    page.close()
    return window


@pytest.fixture
def visit(browser: Any, address: str) -> Iterator[Callable[..., Any]]:
    """Opens the page; at the end nothing must be on the console, and nothing asked from anywhere else."""
    trouble: list[str] = []

    def heard(message: Any) -> None:
        refusal = (
            "status of 422" in message.text
        )  # an answer with a sentence, which Chromium reports
        if message.type in ("error", "warning") and not refusal:
            trouble.append(message.text)

    def open_page(fragment: str = "") -> Any:
        page = browser.new_page()
        page.set_default_timeout(240_000)
        page.on("console", heard)
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.on(
            "request",
            lambda r: (
                None if r.url.startswith((address, "blob:", "data:")) else trouble.append(r.url)
            ),
        )
        page.goto(address + fragment)
        page.wait_for_selector("html[data-ready]")
        return page

    yield open_page
    for page in browser.pages:
        page.close()
    assert trouble == []
