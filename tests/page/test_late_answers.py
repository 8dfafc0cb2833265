"""Answers that come late, lines that are slow, a server that is started again."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

import pytest
from support.page import (
    PAGE,
    QUICK,
    SHORT,
    api,
    drawn,
    run,
    served,
    write,
)

import microvib as mv

pytestmark = PAGE


class Held:
    """Answers that the server has given and that have not arrived; what comes later may overtake them."""

    def __init__(self, page: Any, address: str, method: str = "GET") -> None:
        self._page, self._method, self._holds = page, method, True
        self._waiting: list[tuple[Any, Any]] = []
        page.route(address, self._hold)

    def _hold(self, route: Any) -> None:
        if self._holds and route.request.method == self._method:
            self._waiting.append((route, route.fetch()))
        else:
            route.continue_()

    def wait(self) -> None:
        """Until one is held."""
        end = time.monotonic() + 30
        while not self._waiting:
            assert time.monotonic() < end
            self._page.wait_for_timeout(20)

    def release(self) -> None:
        """Let all arrive, and what comes after them go by."""
        self._holds = False
        for route, answer in self._waiting:
            route.fulfill(response=answer)


def delay(page: Any, milliseconds: int, bytes_per_second: int = -1) -> Any:
    """Each request takes so much longer, and what comes is no faster; the session in which that can be changed."""
    network = page.context.new_cdp_session(page)
    conditions = {
        "latency": milliseconds,
        "downloadThroughput": bytes_per_second,
        "uploadThroughput": -1,
        "offline": False,
    }
    network.send("Network.emulateNetworkConditions", conditions)
    return network


def test_an_answer_from_before_a_start_says_nothing_of_it(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    held = Held(page, "**/api/jobs*")
    page.click("#go")
    held.wait()  # a list of all jobs, asked for before the second run
    with page.expect_response("**/api/runs"):
        page.click("#go")
    page.wait_for_timeout(50)
    held.release()
    page.locator(".chip.done").nth(1).wait_for(timeout=240_000)
    assert page.locator(".chip").count() == 2


def test_what_is_drawn_of_a_run_is_asked_for_once(visit: Callable[..., Any]) -> None:
    """Its spectrum, as soon as it is done; what is drawn with the result is that answer."""
    page = visit(QUICK)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    for k in (1, 2):
        page.click("#go")
        drawn(page, k)
        assert sum("/spectrum?" in url for url in asked) == k


def test_run_change_run_again_and_cancel_over_a_slow_line(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    delay(page, 200)
    page.click("#go")
    write(page, "motor.current", "0.5 A")
    page.click("#go")
    write(page, "record.settle", "5000 s")
    page.click("#go")
    page.locator(".chip.running").get_by_text("settle 5000 s").wait_for(timeout=240_000)
    page.get_by_role("button", name="Cancel").last.click()
    page.locator(".chip.cancelled").wait_for()
    drawn(page, 2)
    page.locator(".chip .name").nth(1).click()
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "motor.current": "0.5 A"}))
    api.expect(page.locator("#run tr", has_text="drive_1").first).to_contain_text(
        f"{1e3 * mv.find_lines(motion)['drive_1'].amplitude:#.4g}"
    )
    page.reload()
    page.locator(".chip.done").nth(1).wait_for(timeout=240_000)


@pytest.mark.release
def test_a_long_answer_over_a_slow_line_is_waited_for(visit: Callable[..., Any]) -> None:
    """It takes longer than the server may be silent, and is heard of all the while."""
    page = visit(QUICK)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    network = delay(page, 0, 850)
    page.click("#go")
    page.locator(".chip.done").wait_for(timeout=240_000)
    assert sum(url.endswith("/result") for url in asked) == 1
    network.detach()


def test_nothing_is_run_before_there_is_a_scenario(browser: Any, address: str) -> None:
    page = browser.new_page()
    held = Held(page, "**/api/scenario", "POST")
    page.goto(address)
    held.wait()
    assert page.locator("#go").is_disabled()
    assert page.locator("#form").inner_text() == "Loading …"
    held.release()
    page.wait_for_selector("html[data-ready]")
    assert page.locator("#go").is_enabled()
    page.close()


def test_run_takes_the_form_as_it_was_at_the_click(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    write(page, "motor.current", "0.5 A")
    held = Held(page, "**/api/scenario", "POST")
    page.click("#go")
    write(page, "motor.current", "0.7 A")  # while nothing has been answered
    held.wait()
    held.release()
    drawn(page, 1)
    page.locator("details.menu summary", has_text="Download").click()
    with page.expect_download() as coming:
        page.locator("details.menu a[download='scenario.yaml']").click()
    assert mv.load_scenario(str(coming.value.path())).motor.current == 0.5


def test_a_late_answer_about_another_run_is_not_shown(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    write(page, "motor.current", "0.5 A")
    run(page)
    page.locator(".chip .name").first.click()
    held = Held(page, "**/series?channels=T_e*")
    page.get_by_role("button", name="Slow motion").click()
    held.wait()
    page.locator(".chip .name").last.click()
    held.release()
    page.get_by_role("button", name="Slow motion").click()
    page.get_by_role("button", name="Pause").click()
    page.get_by_label("Instant of the record").fill("10")
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "motor.current": "0.5 A"}))
    shown = f"{1e3 * motion['T_d'][10]:+#.4g} mN m".replace("-", "−")
    api.expect(page.locator("svg.drive .whole")).to_contain_text(shown)


def test_a_server_that_was_started_again_says_so(chromium: Any) -> None:
    with served() as address:
        page = chromium.new_context().new_page()
        page.goto(address + QUICK)
        page.wait_for_selector("html[data-ready]")
        run(page)
    api.expect(page.locator("#server")).to_contain_text("does not answer", timeout=240_000)
    with served(int(re.findall(r":(\d+)/", address)[0])) as address:
        api.expect(page.locator("#server")).to_contain_text("was restarted", timeout=240_000)
        other = page.context.new_page()
        other.goto(address)  # lets the browser in
        other.wait_for_selector("html[data-ready]")
        page.locator(".chip.gone").wait_for()
        page.get_by_role("button", name="Run it again").click()
        drawn(page, 1)
        assert page.locator(".chip").count() == 1
