"""Angles of an array, shapes that move, and lines over seeds, as a person meets them."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.page import PAGE, QUICK, api, drawn, until, write
from support.tiers import sweep

import microvib as mv
from microvib.io.named import catalog_names

pytestmark = PAGE
EXAMPLE = Path(__file__).parents[2] / "examples" / "spacecraft.yaml"
PICTURE = "document.querySelector('#modes canvas').toDataURL()"
ELEMENTS = "#base=state-1&array=%7Bfem%3A+reference-array%2C+modes%3A+4%7D"


def craft_page(visit: Callable[..., Any], tmp_path: Path) -> Any:
    path = tmp_path / "craft.yaml"
    path.write_text(
        EXAMPLE.read_text().replace("settle: 30 s, duration: 16 s", "settle: 1 s, duration: 4 s")
    )
    page = visit("#base=state-1")
    page.set_input_files("#upload", path)
    api.expect(page.locator("#title")).to_contain_text("Small craft")
    return page


def shapes(page: Any, of: str) -> Any:
    page.click("#tab-modes")
    page.get_by_role("button", name=of).click()
    return page.locator("#modes canvas")


def test_modes_of_a_craft_move_and_stand_still(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = craft_page(visit, tmp_path)
    shapes(page, "Craft, hinges locked").wait_for()
    craft = mv.load_scenario(EXAMPLE).craft
    assert craft is not None
    assert page.locator("#modes tbody tr").count() == craft.frequency.size
    first = page.evaluate(PICTURE)
    until(page, f"{PICTURE} !== {first!r}")
    page.get_by_role("button", name="Pause").press("Enter")
    still = page.evaluate(PICTURE)
    page.wait_for_timeout(300)
    assert page.evaluate(PICTURE) == still
    page.get_by_role("button", name="Show mode 3").press("Enter")
    other = page.evaluate(PICTURE)
    assert other != still
    page.get_by_role("slider", name="Amplitude").press("End")
    wide = page.evaluate(PICTURE)
    assert wide != other
    page.locator("#modes canvas").press("ArrowLeft")
    assert page.evaluate(PICTURE) != wide
    page.reload()
    page.wait_for_selector("html[data-ready]")
    api.expect(page.get_by_role("button", name="Show mode 3")).to_have_attribute(
        "aria-pressed", "true"
    )


@pytest.mark.release
def test_shapes_stand_still_where_motion_is_not_wanted(visit: Callable[..., Any]) -> None:
    page = visit(ELEMENTS)
    page.emulate_media(reduced_motion="reduce")
    shapes(page, "Array, interface clamped").wait_for()
    api.expect(page.locator("#modes")).to_contain_text("mesh of its finite elements")
    still = page.evaluate(PICTURE)
    page.wait_for_timeout(300)
    assert page.evaluate(PICTURE) == still
    page.get_by_role("button", name="Play").click()
    until(page, f"{PICTURE} !== {still!r}")


def test_a_late_answer_does_not_take_the_place_of_a_newer_one(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = craft_page(visit, tmp_path)

    def late(route: Any) -> None:
        if '"of":"array"' in (route.request.post_data or ""):
            time.sleep(1.5)
        route.continue_()

    page.route("**/api/shapes", late)
    shapes(page, "Array, interface clamped")
    shapes(page, "Craft, hinges locked").wait_for()
    page.wait_for_timeout(2500)
    assert (
        page.locator("#modes h2", has_text="Modes of").inner_text()
        == "Modes of the craft, hinges locked"
    )


@pytest.mark.release
def test_what_is_dropped_is_asked_about_no_more(visit: Callable[..., Any], tmp_path: Path) -> None:
    """A question under way when its computation is dropped would be answered with a refusal."""
    page = craft_page(visit, tmp_path)
    held: list[Any] = []

    def hold_the_first(route: Any) -> None:
        if held:
            route.continue_()
        else:
            held.append(route)

    page.route("**/api/jobs/*/result", hold_the_first)
    with page.expect_request("**/api/jobs/*/result"):
        shapes(page, "Array, interface clamped")
    with page.expect_response(lambda answer: answer.request.method == "DELETE"):
        shapes(page, "Craft, hinges locked").wait_for()
    held[0].continue_()
    page.wait_for_timeout(300)
    api.expect(page.locator("#modes h2", has_text="Modes of")).to_have_text(
        "Modes of the craft, hinges locked"
    )


@pytest.mark.parametrize("name", sweep(catalog_names(), "state-1"))
def test_every_scenario_of_the_catalog_has_modes_that_move(
    visit: Callable[..., Any], name: str
) -> None:
    page = visit(f"#base={name}")
    shapes(page, "Array, interface clamped").wait_for()
    assert page.locator("#modes tbody tr").count() == len(mv.load_scenario(name).array.modes)
    api.expect(page.locator("#modes")).to_contain_text("The panel stands for the array")
    first = page.evaluate(PICTURE)
    until(page, f"{PICTURE} !== {first!r}")


def test_firm_ground_gets_a_sentence(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1")
    shapes(page, "Craft, hinges locked")
    api.expect(page.locator("#modes .error")).to_have_text(
        "spacecraft: missing; a scenario on a spacecraft is expected, as examples/spacecraft.yaml"
    )


def test_angles_are_swept_with_progress_in_two_windows(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page, other = craft_page(visit, tmp_path), craft_page(visit, tmp_path)
    for window, angles in ((page, "0:180"), (other, "0,45")):
        window.click("#tab-angles")
        window.fill("#angles-angles", angles)
        window.locator("#angles-angles").press("Enter")
    api.expect(page.locator("#angles .error")).to_contain_text("write FIRST:LAST:STEP in degrees")
    api.expect(page.locator("#angles-angles")).to_be_focused()
    api.expect(other.locator("#angles tbody tr")).to_have_count(4, timeout=240_000)
    with other.expect_download() as coming:
        other.get_by_role("button", name="angles.csv").click()
    coming.value.save_as(tmp_path / "angles.csv")
    assert (tmp_path / "angles.csv").read_text().startswith("angle_deg,line,")
    page.fill("#angles-angles", "0:360:1")
    page.locator("#angles-angles").press("Enter")
    page.get_by_role("button", name="Cancel Sweep").click()
    api.expect(page.locator("#angles")).to_contain_text("Sweep was cancelled.")


@pytest.mark.release
def test_lines_over_seeds(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.fill("#seeds", "many")
    page.click("#go")
    api.expect(page.locator("#seeds-error")).to_contain_text(
        "a whole number of draws from 2 to 1000 is expected"
    )
    api.expect(page.locator("#seeds")).to_be_focused()
    page.fill("#seeds", "3")
    page.click("#go")
    api.expect(page.locator("#seeds-error")).to_contain_text("this scenario has no noise")
    write(page, "friction.torque_noise", "{density: 1e-7 N^2*m^2/Hz, highest: 200 Hz}")
    page.click("#go")
    drawn(page, 1)
    card = page.locator("#run .card", has_text="Lines over draws of the noise")
    api.expect(card).to_contain_text("3 draws")
    page.get_by_text("Download", exact=True).click()
    with page.expect_download() as coming:
        page.get_by_role("link", name="lines over the seeds (CSV)").click()
    assert coming.value.suggested_filename == "seeds.csv"
    page.fill("#seeds", "")
