"""A sweep over a value of the form: from its label, by the keyboard, and a point of it into the form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from support.page import PAGE, QUICK, field, until

pytestmark = PAGE

CURVES = "document.querySelector('#sweep-plot')?.data ?? []"


def test_a_sweep_from_a_label_and_its_point_into_the_form(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.get_by_role("button", name="Sweep motor.current", exact=True).click()
    assert page.input_value("#sweep-key") == "motor.current"
    assert page.input_value("#sweep-from") == "0.48 A"
    page.fill("#sweep-from", "0.3 V")
    page.fill("#sweep-count", "4")
    page.select_option("#sweep-way", "linear")
    page.get_by_role("button", name="Sweep", exact=True).click()
    page.locator("[role=alert]").get_by_text("wrong dimension").first.wait_for()
    page.fill("#sweep-from", "0.3 A")
    page.fill("#sweep-to", "0.6 A")
    page.get_by_role("button", name="Sweep", exact=True).click()
    until(page, f"({CURVES}).length > 0")
    x, y = page.evaluate(f"[({CURVES})[0].x, ({CURVES})[0].y]")
    assert x == [0.3, 0.4, 0.5, 0.6]
    assert len(set(y)) == 4
    [marked] = page.evaluate("document.querySelector('#sweep-plot').layout.shapes")
    assert marked["x0"] == 0.6
    click = "{points: [{customdata: '0.4 A'}]}"
    page.evaluate(f"document.querySelector('#sweep-plot').emit('plotly_click', {click})")
    until(page, "location.hash.includes('motor.current=0.4')")
    until(page, "document.getElementById('field-motor.current').value === '0.4 A'")
    until(page, "document.querySelector('#sweep-plot').layout.shapes[0].x0 === 0.4")


def test_a_sweep_by_the_keyboard(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    field(page, "motor.torque_constant").focus()
    for _ in range(8):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent") == "Sweep it":
            break
    page.keyboard.press("Enter")
    assert page.input_value("#sweep-key") == "motor.torque_constant"
    assert page.evaluate("document.activeElement.id") == "sweep-from"
