"""The page's form: fields, units, links, uploads, the keyboard."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.page import (
    PAGE,
    QUICK,
    SHORT,
    amplitude,
    api,
    drawn,
    field,
    run,
    write,
)
from support.scenarios import baseline

import microvib as mv
from microvib.errors import ScenarioError
from microvib.io.scenario_file import dump_scenario

pytestmark = PAGE


def test_a_wrong_unit_is_told_beside_its_field(visit: Callable[..., Any]) -> None:
    page = visit()
    write(page, "motor.current", "0.6 kg")
    sentence = page.locator("[id='field-motor.current-error']")
    api.expect(sentence).not_to_be_empty()
    with pytest.raises(ScenarioError) as told:
        mv.load_scenario("state-1", {"motor.current": "0.6 kg"})
    assert sentence.inner_text() in str(told.value)
    assert field(page, "motor.current").get_attribute("aria-invalid") == "true"
    page.click("#go")
    api.expect(field(page, "motor.current")).to_be_focused()
    assert not page.locator(".chip").count()
    field(page, "motor.current").press("Escape")
    api.expect(field(page, "motor.current")).to_have_value("0.6 A")
    api.expect(sentence).to_be_empty()


def test_changes_are_marked_found_and_undone(visit: Callable[..., Any]) -> None:
    page = visit()
    write(page, "motor.current", "0.5 A")
    row = page.locator(".field[data-key='motor.current']")
    api.expect(row).to_have_class("field changed")
    page.check("#only-changed")
    assert page.locator(".field:visible").count() == 1
    page.uncheck("#only-changed")
    page.fill("#search", "reducer stiffness")
    assert page.locator(".field:visible").count() == 1
    page.fill("#search", "")
    row.locator(".undo").click()
    api.expect(field(page, "motor.current")).to_have_value("0.6 A")
    api.expect(row).to_have_class("field")


def test_a_list_is_edited_as_a_whole_and_its_items_appear(visit: Callable[..., Any]) -> None:
    page = visit()
    write(page, "array.rigid_inertia", "")
    page.get_by_role("button", name="Add or take out modes").click()
    modes = field(page, "array.modes")
    api.expect(modes).to_have_value("[{frequency: 1.2459 Hz, damping: 1.041 percent}]")
    damped = "damping: 1 percent, effective_inertia"
    modes.fill(
        f"[{{frequency: 1.2 Hz, {damped}: 6 kg*m^2}}, {{frequency: 4 Hz, {damped}: 2 kg*m^2}}]"
    )
    api.expect(field(page, "array.modes.1.frequency")).to_have_value("4 Hz")
    api.expect(modes).to_be_focused()  # the form has grown while it was typed in
    page.locator(".field[data-key='array.modes'] .undo").click()
    api.expect(field(page, "array.modes.1.frequency")).to_have_count(0)


def test_upload_a_scenario(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = visit()
    mine = (
        baseline()
        .with_si({"motor.current": 0.45, **SHORT})
        .model_copy(update={"title": "my own drive"})
    )
    (tmp_path / "mine.yaml").write_text(dump_scenario(mine), encoding="utf-8")
    (tmp_path / "broken.yaml").write_text("motor: [", encoding="utf-8")
    wrong = (
        dump_scenario(mine.with_sources({}))
        .replace("sources: {}\n", "")
        .replace("0.45 A", "3 parsec")
    )
    (tmp_path / "wrong.yaml").write_text(wrong, encoding="utf-8")
    page.set_input_files("#upload", tmp_path / "mine.yaml")
    api.expect(page.locator("#title")).to_have_text("my own drive")
    api.expect(field(page, "motor.current")).to_have_value("0.45 A")
    page.set_input_files("#upload", tmp_path / "broken.yaml")
    api.expect(page.locator("#alert")).to_contain_text("broken.yaml: ")
    api.expect(page.locator("#title")).to_have_text("my own drive")
    page.set_input_files("#upload", tmp_path / "wrong.yaml")
    api.expect(page.locator("[id='field-motor.current-error']")).to_contain_text("parsec")
    write(page, "motor.current", "0.45 A")  # mended
    run(page)
    table = mv.find_lines(mv.simulate(mine))
    assert amplitude(page, "drive_1") == f"{1e3 * table['drive_1'].amplitude:#.4g}"


@pytest.mark.release
def test_a_link_restores_the_scenario(visit: Callable[..., Any]) -> None:
    page = visit()
    write(page, "motor.current", "0.5 A")
    write(page, "reducer.stiffness", "rigid")
    api.expect(page).to_have_url(re.compile("rigid"))
    again = visit("#" + page.url.split("#")[1])
    api.expect(field(again, "motor.current")).to_have_value("0.5 A")
    api.expect(again.locator("#changed-count")).to_have_text("2")
    again.reload()
    again.wait_for_selector("html[data-ready]")
    api.expect(field(again, "reducer.stiffness")).to_have_value("rigid")
    page.go_back()
    api.expect(page.locator("#changed-count")).to_have_text("1")
    api.expect(field(page, "reducer.stiffness")).to_have_value("5053 N*m/rad")
    page.go_forward()
    api.expect(field(page, "reducer.stiffness")).to_have_value("rigid")


def test_a_link_restores_an_uploaded_scenario(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = visit()
    mine = baseline().model_copy(update={"title": "Antrieb für μ, ±"})
    (tmp_path / "mine.yaml").write_text(dump_scenario(mine), encoding="utf-8")
    page.set_input_files("#upload", tmp_path / "mine.yaml")
    api.expect(page.locator("#title")).to_have_text(mine.title)
    write(page, "motor.current", "0.5 A")
    api.expect(page).to_have_url(re.compile("motor.current"))
    again = visit("#" + page.url.split("#")[1])
    api.expect(again.locator("#title")).to_have_text(mine.title)
    api.expect(field(again, "motor.current")).to_have_value("0.5 A")


def test_keyboard_only(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)

    def tab_to(selector: str) -> None:
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("s => document.activeElement.matches(s)", selector):
                outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
                assert outline == "solid"  # focus is seen
                return
        raise AssertionError(f"{selector} is not reached with the Tab key")

    tab_to("#tab-run")
    page.keyboard.press("ArrowRight")
    assert page.locator("#sheet").is_visible()
    page.keyboard.press("ArrowLeft")
    assert page.locator("#run").is_visible()
    tab_to("[id='field-motor.current']")
    page.keyboard.press("Control+A")
    page.keyboard.type("0.5 A")
    page.keyboard.press("Enter")
    drawn(page, 1)
    assert "current 0.5 A" in page.locator(".chip.done .name").inner_text()


def test_everything_that_takes_input_has_a_name(visit: Callable[..., Any]) -> None:
    page = visit()
    nameless = page.evaluate(
        """[...document.querySelectorAll('input, select, button, progress')]
        .filter(e => !(e.labels?.length || e.ariaLabel || e.innerText?.trim() || e.textContent.trim())).map(e => e.outerHTML)"""
    )
    assert nameless == []


def test_a_pulse_drive_is_made_in_the_form_and_run(visit: Callable[..., Any]) -> None:
    """What leaves no choice is set by one button; what is missing is told until it is there."""
    page = visit(QUICK)
    write(page, "motor.current", "0.6 A")
    page.locator("details[data-group=driver] summary").first.click()
    field(page, "driver.drive").select_option("pulse")
    page.get_by_role("button", name="Set whole steps and all gains to 0").click()
    api.expect(field(page, "driver.microsteps")).to_have_value("1")
    api.expect(field(page, "driver.integral_gain")).to_have_value("0 V/(A*s)")
    api.expect(page.locator("#by-drive button")).to_have_count(0)
    missing = page.locator("[id='field-driver.on_time-error']")
    api.expect(missing).to_contain_text("on_time: missing (on-time of a pulse")
    api.expect(missing).to_contain_text("diode_voltage is missing, too")
    pulse = {"supply_voltage": "3.6 V", "on_time": "60 ms", "diode_voltage": "0.7 V"}
    for key, text in pulse.items():
        write(page, f"driver.{key}", text)
    api.expect(page.locator("details[data-group=driver] .mark")).to_have_text("7")
    run(page)
    field(page, "driver.drive").select_option("voltage")
    api.expect(page.locator("[id='field-driver.on_time-error']")).to_contain_text(
        "only acts with drive: pulse"
    )
    field(page, "driver.drive").select_option("current")
    api.expect(page.locator("[id='field-driver.on_time-error']")).to_contain_text(
        "only acts with drive: pulse"
    )
