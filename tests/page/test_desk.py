"""The page as a desk: two runs side by side in figures, a value that moves, keys, a phone, a way on where there are no modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from support.page import PAGE, QUICK, SHORT, api, drawn, run, until, write

import microvib as mv

pytestmark = PAGE
STEMS = "(document.querySelector('#live-plot').data ?? [])"


def figure(text: str) -> float:
    return float(text.replace("−", "-"))


def test_two_runs_are_compared_line_by_line(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    write(page, "motor.current", "0.5 A")
    run(page)
    row = page.locator("#ab tbody tr").filter(has=page.get_by_text("drive_1", exact=True))
    lines = [
        mv.find_lines(mv.simulate(mv.load_scenario("state-1", {**SHORT, **more})))["drive_1"]
        for more in ({}, {"motor.current": "0.5 A"})
    ]
    ratio = lines[1].amplitude / lines[0].amplitude
    text = row.locator("td[data-key=percent]").inner_text()
    assert figure(text) == round(100 * (ratio - 1), 2)
    decibel = row.locator("td[data-key=decibel]")
    assert abs(figure(decibel.inner_text()) - 20 * math.log10(ratio)) < 0.0051
    page.get_by_role("button", name="Swap").click()
    api.expect(decibel).not_to_have_text(text)
    assert abs(figure(decibel.inner_text()) + 20 * math.log10(ratio)) < 0.0051


@pytest.mark.release
def test_lines_that_only_a_frequency_tells_are_compared_by_it(visit: Callable[..., Any]) -> None:
    page = visit()
    found = page.evaluate(
        """() => import('/static/ab.js').then(({ alike }) => {
          const line = (name, f) => [name, { line: name, kind: "other", frequency_hz: f }];
          const a = new Map([line("other_1", 50), line("other_2", 60)]);
          const b = new Map([line("other_1", 60.05), line("other_2", 80)]);
          return [...alike(a, b, 0.25)].map(([name, { frequency_hz: f }]) => [name, f]);
        })"""
    )
    assert found == [["other_2", 60.05], ["other_2 of B", 80]]


def test_lines_move_with_a_value_over_those_of_the_form(visit: Callable[..., Any]) -> None:
    page = visit()
    page.locator("details:has(#live-plot) > summary").click()
    page.select_option("#live-way", "linear")
    until(page, f"{STEMS}.length === 1 && {STEMS}[0].x.length === 24")
    first = page.evaluate(f"() => {STEMS}[0].y[1]")
    page.locator("#live-slider").focus()
    page.keyboard.press("ArrowRight")
    until(page, f"{STEMS}.length === 2")  # each key is answered by itself, or with those after it
    for _ in range(19):
        page.keyboard.press("ArrowRight")
    api.expect(page.locator(".live output")).to_have_text("0.68922 A")
    moved = mv.load_scenario("state-1", {"motor.current": "0.68922 A"})
    from microvib.model.linear import linear_lines

    wanted = abs(linear_lines(moved)[0].amplitude)
    until(page, f"{STEMS}.length === 2 && Math.abs({STEMS}[1].y[1] / {wanted} - 1) < 1e-4")
    assert page.evaluate(f"() => {STEMS}[0].y[1]") == first
    page.get_by_role("button", name="Put into the form").click()
    until(page, "document.getElementById('field-motor.current').value === '0.68922 A'")
    page.select_option("#live-way", "steady")
    until(page, f"{STEMS}.length === 1 && {STEMS}[0].x.length > 24")


def test_everything_can_be_done_by_keys(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.keyboard.press("?")
    api.expect(page.locator("dialog.keys")).to_be_visible()
    page.keyboard.press("Escape")
    api.expect(page.locator("dialog.keys")).to_be_hidden()
    page.keyboard.press("/")
    assert page.evaluate("document.activeElement.id") == "search"
    page.keyboard.type("9")
    assert page.input_value("#search") == "9"  # in a field a key is a letter
    page.fill("#search", "")
    page.keyboard.press("Control+Enter")
    drawn(page, 1)
    page.locator(".chip .name").focus()
    outline = "getComputedStyle(document.activeElement).outlineStyle"
    page.keyboard.press("h")
    until(page, "document.querySelector('.chip .eye').getAttribute('aria-pressed') === 'false'")
    page.keyboard.press("h")
    page.keyboard.press("Tab")
    assert page.evaluate(outline) == "solid"
    page.locator(".chip .name").focus()
    page.keyboard.press("F2")
    page.keyboard.type("first")
    page.keyboard.press("Enter")
    api.expect(page.locator(".chip .name")).to_have_text("first")
    assert page.evaluate("document.activeElement.className") == "name"
    page.keyboard.press("4")
    api.expect(page.locator("#rates")).to_be_visible()
    page.keyboard.press("1")
    page.locator(".chip .name").focus()
    page.keyboard.press("Delete")
    api.expect(page.locator(".chip")).to_have_count(0)


def test_a_phone_sees_the_picture_before_names_and_switches(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.set_viewport_size({"width": 390, "height": 844})
    run(page)
    write(page, "motor.current", "0.5 A")
    run(page)
    page.evaluate("() => document.querySelector('#results').scrollIntoView()")
    top = "(selector) => document.querySelector(selector).getBoundingClientRect().top"
    plot, legend, bar, first = (
        page.evaluate(top, one)
        for one in (
            "#spectrum-plot .nsewdrag",
            "#spectrum-plot .legend",
            "#spectrum-channel",
            ".facts",
        )
    )
    assert first < plot < legend
    assert plot < bar
    assert plot < 844 / 2
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_a_laptop_sees_the_answer_and_the_lines_before_the_drawing(
    visit: Callable[..., Any],
) -> None:
    page = visit(QUICK)
    run(page)
    tops = page.evaluate(
        """() => [".facts", "#spectrum-plot", "#run .wide[aria-label='All lines']", "svg.drive"]
          .map((one) => document.querySelector(one).getBoundingClientRect().top)"""
    )
    assert tops == sorted(tops)
    assert tops[1] < 768 / 2


def test_a_rigid_array_and_a_bare_drive_are_led_on_to_modes(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&array.rigid_inertia=&array.modes=%5B%5D")
    page.click("#tab-modes")
    page.get_by_role("button", name="Array, interface clamped").click()
    api.expect(page.locator("#modes")).to_contain_text("the array is rigid")
    page.get_by_role("button", name="Give the array one mode at 1 Hz").click()
    api.expect(page.locator("#modes tbody tr")).to_have_count(1)
    page.get_by_role("button", name="Craft, hinges locked").click()
    api.expect(page.locator("#modes .error")).to_contain_text("spacecraft: missing")
    page.get_by_role("button", name="Put the reference array").click()
    api.expect(page.locator("#modes tbody tr")).to_have_count(13)
    hub = page.locator("[id='field-spacecraft.hub.mass']")
    assert hub.input_value() == "420 kg"  # and the form has the craft
    page.locator("#whole button", has_text="spacecraft is replaced").click()
    api.expect(hub).to_have_count(0)


def test_a_point_of_the_rate_map_is_a_run(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.click("#tab-rates")
    page.check("#rates-linear")
    page.fill("#rates-count", "12")
    page.fill("#rates-microsteps", "16")
    page.locator("#rates button.primary").click()
    page.locator("#largest-plot .main-svg").first.wait_for()
    place = """() => {
      const plot = document.querySelector("#largest-plot");
      plot.scrollIntoView({ block: "center" });
      const [box, { _size: size, xaxis, yaxis }, curve] = [plot.getBoundingClientRect(), plot._fullLayout, plot.data[0]];
      return [box.left + size.l + xaxis.d2p(curve.x[6]), box.top + size.t + yaxis.d2p(curve.y[6]), ...curve.customdata[6]];
    }"""
    x, y, rate, microsteps = page.evaluate(place)
    page.mouse.move(x, y)
    page.locator("#largest-plot .hoverlayer .hovertext").wait_for()
    page.mouse.click(x, y)
    name = page.locator("#rates .offer")
    api.expect(name).to_contain_text(f"{microsteps} microsteps")
    assert figure(name.inner_text().split()[0]) == float(f"{rate:.6g}")
    name.get_by_role("button").click()
    drawn(page, 1)
    assert f"{microsteps} microsteps" in page.locator(".chip .name").inner_text()


def test_a_value_of_the_form_is_moved_live(visit: Callable[..., Any]) -> None:
    page = visit()
    page.locator("[id='field-motor.torque_constant']").focus()
    page.get_by_role("button", name="Move it live").locator("visible=true").click()
    page.locator("#live-plot .main-svg").first.wait_for()
    assert page.input_value("#live-key") == "motor.torque_constant"
    assert page.evaluate("document.activeElement.id") == "live-slider"
