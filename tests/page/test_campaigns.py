"""A campaign on the page: what varies, stopped and gone on with, and a case from its point to a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from support.page import PAGE, QUICK, drawn, until

pytestmark = PAGE

POINTS = "document.querySelector('#campaign-scatter')?.data?.[0]"


def start(page: Any, count: int) -> None:
    page.click("#tab-campaign")
    page.fill("#campaign-count", str(count))
    page.select_option("#campaign-solve", "record")
    page.fill("#campaign-limit", "60 mN*m")
    page.locator("#campaign button.primary").first.click()


def test_a_campaign_is_stopped_gone_on_with_and_its_cases_are_runs(
    visit: Callable[..., Any],
) -> None:
    page = visit(QUICK)
    start(page, 64)
    until(page, f"({POINTS})?.x.length > 0")
    page.locator("#campaign .cancel").click()
    more = page.get_by_role("button", name="Go on")
    more.wait_for()
    computed = page.evaluate(f"{POINTS}.x.length")
    assert 0 < computed < 64
    page.reload()
    more.wait_for()
    until(page, f"({POINTS})?.x.length >= {computed}")
    more.click()
    until(page, f"({POINTS})?.x.length === 64")
    page.get_by_text("64 of 64 cases").first.wait_for()
    page.get_by_role("button", name="results.nc").wait_for()

    page.select_option("#campaign-y", "drive_1")
    until(
        page,
        "document.querySelector('#campaign-scatter').layout.yaxis.title.text.includes('drive_1')",
    )
    x, y = page.evaluate(f"[{POINTS}.x, {POINTS}.y]")
    assert len(set(x)) == 64
    other = int(page.input_value("#campaign-case")) ^ 1
    click = f"{{points: [{{customdata: {other}}}]}}"
    page.evaluate(f"document.querySelector('#campaign-scatter').emit('plotly_click', {click})")
    stems = "document.querySelector('#campaign-lines').data[1]"
    until(page, f"{stems}.name === 'case {other}'")
    drive_1 = page.evaluate(f"{stems}.y[{stems}.text.findIndex((t) => t.startsWith('drive_1,'))]")
    assert abs(drive_1 - y[other]) <= 1e-9
    page.locator("#campaign").get_by_role("button", name="Run", exact=True).first.click()
    drawn(page, 1)
    assert page.locator(".chip.done").get_by_text(f"case {other}").count()
    lines = page.evaluate("document.querySelector('#spectrum-plot').data.length")
    assert lines


def test_what_cannot_vary_is_said_beside_the_form(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.click("#tab-campaign")
    page.fill("#campaign input[name=relative_deviation]", "much")
    page.locator("#campaign button.primary").first.click()
    page.locator("#campaign [role=alert]").get_by_text("vary.motor.torque_constant").wait_for()
