"""Runs on the page: the command line's figures, several at once, cancelled, a limit's verdict."""

from __future__ import annotations

import csv
import io
import re
import subprocess
import sys
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
    downloads,
    drawn,
    limit,
    run,
    shorten,
    until,
    write,
)

import microvib as mv
from microvib.analysis.limits import Limit, judge
from microvib.export.targets import TARGETS
from microvib.units import Si

pytestmark = PAGE


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """``lines.csv`` of the command line, for state 1 with one value changed, short."""
    where = tmp_path_factory.mktemp("command")
    changes = {**SHORT, "reducer.stiffness": "9000 N*m/rad"}
    options = [text for key, value in changes.items() for text in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "microvib", "run", "state-1", *options, "--out", "run"]
    subprocess.run(command, cwd=where, check=True, capture_output=True, timeout=300)
    return (where / "run" / "lines.csv").read_text(encoding="utf-8")


def test_edit_run_and_read_what_the_command_line_says(
    visit: Callable[..., Any], printed: str, tmp_path: Path
) -> None:
    page = visit()
    shorten(page)
    write(page, "reducer.stiffness", "9000 N*m/rad")
    run(page)
    lines = {row["line"]: row["amplitude_n_m"] for row in csv.DictReader(io.StringIO(printed))}
    assert amplitude(page, "drive_1") == f"{1e3 * float(lines['drive_1']):#.4g}"
    assert amplitude(page, "drive_2") == f"{1e3 * float(lines['drive_2']):#.4g}"
    shown = page.locator("#run .wide[aria-label='All lines'] tbody tr")
    assert shown.count() < len(lines)
    page.get_by_role("button", name=f"Show all {len(lines)} rows").click()
    api.expect(shown).to_have_count(len(lines))
    assert page.locator("#spectrum-plot .main-svg").count()
    assert page.locator("#history-plot .main-svg").count()
    assert page.get_by_text("Beside measured lines").count()
    assert "mean" in page.locator("svg.drive").get_attribute("aria-label")
    found = downloads(page, tmp_path)
    assert found["lines.csv"].decode() == printed
    assert mv.load_scenario(str(tmp_path / "scenario.yaml")).reducer.stiffness == 9000.0
    assert found["motion.nc"][1:4] == b"HDF"
    assert b"<html" in found["report.html"]


def test_cancel(visit: Callable[..., Any]) -> None:
    page = visit()
    write(page, "record.settle", "5000 s")
    page.click("#go")
    page.locator(".job progress[value]").wait_for(timeout=240_000)  # it moves
    page.click(".job .cancel")
    page.locator(".chip.cancelled").wait_for()
    assert "was cancelled" in page.locator("#run").inner_text()
    shorten(page)
    run(page)  # and the server goes on


def test_two_tabs_at_once(visit: Callable[..., Any]) -> None:
    first = visit(QUICK)
    second = visit("#base=state-5&record.settle=1+s&record.duration=4+s")
    first.click("#go")
    second.click("#go")
    drawn(first, 1)
    drawn(second, 1)
    for page, name in ((first, "state-1"), (second, "state-5")):
        changed = mv.load_scenario(name, dict(SHORT))
        expected = mv.find_lines(mv.simulate(changed))["drive_1"].amplitude
        assert amplitude(page, "drive_1") == f"{1e3 * expected:#.4g}"
        assert page.locator(".chip").count() == 1


def test_runs_are_kept_overlaid_and_removed(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    write(page, "motor.current", "0.5 A")
    run(page)
    names = page.locator("#spectrum-plot .legendtext").all_text_contents()
    assert len(names) == len(set(names)) >= 2
    colours = page.evaluate(
        "document.querySelector('#spectrum-plot').data.filter(t => t.mode === 'lines').map(t => t.line)"
    )
    assert len({c["color"] for c in colours}) == len({c["dash"] for c in colours}) == 2
    page.reload()
    drawn(page, 2)
    page.locator(".chip .close").first.click()
    api.expect(page.locator(".chip")).to_have_count(1)


def test_a_run_that_is_started_while_the_page_loads_is_chosen_and_kept(
    visit: Callable[..., Any],
) -> None:
    """Run can be pressed before the other tabs' scripts are there."""
    page, held = visit(QUICK), []
    run(page)
    page.route("**/angles.js*", lambda route: held.append(route))
    page.reload(wait_until="commit")
    page.wait_for_selector("#go:enabled")
    page.click("#go")
    drawn(page, 2)
    assert held
    assert page.locator("html[data-ready]").count() == 0
    for route in held:
        route.continue_()
    page.wait_for_selector("html[data-ready]")
    api.expect(page.locator("#run .facts")).to_be_visible()
    assert float(amplitude(page, "drive_1")) > 1.0
    page.reload()
    drawn(page, 2)


def test_a_limit_gives_a_verdict_here_and_in_the_report(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    motion = mv.simulate(mv.load_scenario("state-1", dict(SHORT)))
    half = float(f"{0.5 * mv.find_lines(motion)['drive_1'].amplitude:.4g}")
    judged = judge(mv.find_lines(motion), Limit(Si(half)), motion.scenario)
    worst = next(m for m in judged.margins if m.verdict != "not judged")
    drive_1 = next(m for m in judged.margins if m.line.name == "drive_1")
    assert drive_1.fails
    minus = "\N{MINUS SIGN}"
    api.expect(limit(page, f"{half!r} N*m")).to_contain_text("FAIL")
    api.expect(page.locator(".facts .fail")).to_contain_text("FAIL: ")
    api.expect(page.locator(".facts")).to_contain_text(
        f"{worst.decibel:.1f} dB".replace("-", minus)
    )
    row = (
        page.locator("#run tr")
        .filter(has=page.locator("td[data-key=line]", has_text=re.compile("^drive_1$")))
        .first
    )
    api.expect(row.locator("td[data-key=margin_db]")).to_have_text(
        f"{drive_1.decibel:.1f}".replace("-", minus)
    )
    api.expect(row.locator("td[data-key=verdict] .fail")).to_have_text("FAIL")
    drawn_at = f"Math.abs(s.y0 / {half} - 1) < 1e-3"
    until(page, f"document.querySelector('#spectrum-plot').layout.shapes.some(s => {drawn_at})")
    address = page.locator("details.menu a[download='report.html']").get_attribute("href")
    assert "limit" in page.evaluate("async a => (await fetch(a)).text()", address)
    api.expect(limit(page, "30 kg")).to_contain_text("30 kg")
    api.expect(limit(page, "20 N*m")).to_contain_text("Limit 2e+04 mN m")
    page.reload()
    api.expect(page.locator("output.verdict")).to_contain_text("Limit 2e+04 mN m")


def test_a_run_is_exported_to_other_tools(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = visit(QUICK)
    page.click("#go")
    drawn(page, 1)
    page.get_by_text("Export", exact=True).click()
    menu = page.locator(".exports")
    api.expect(menu).to_contain_text("array.rigid_body: missing")  # of the source sheet
    api.expect(menu.get_by_role("link", name="source-sheet")).to_have_count(0)
    with page.expect_download() as coming:
        menu.get_by_role("link", name="state-space (.mat)").click()
    assert coming.value.suggested_filename == "state-space.mat"
    coming.value.save_as(tmp_path / "a.mat")
    assert (tmp_path / "a.mat").read_bytes().startswith(b"MATLAB 5.0 MAT-file")


def test_options_of_a_format_are_those_of_the_command(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    """Each has its field; what is chosen is in the file, and what is wrong is told in a sentence."""
    page = visit(QUICK)
    page.click("#go")
    drawn(page, 1)
    page.get_by_text("Export", exact=True).click()
    menu = page.locator(".exports")
    for target in TARGETS.values():
        group = menu.get_by_role(
            "group", name=f"Options of {target.name}", exact=True, include_hidden=True
        )
        keys = [option.key for option in target.offered]
        found = group.locator("[name]").evaluate_all("all => all.map((one) => one.name)")
        offered = not target.missing and target.name != "source-sheet"  # which this run cannot have
        assert list(dict.fromkeys(found)) == (keys if offered else []), target.name
    menu.get_by_label("Options of nastran").first.click()
    options = menu.get_by_role("group", name="Options of nastran")
    options.get_by_label("grid", exact=True).fill("4711", timeout=20_000)
    options.get_by_label("units").select_option("mm-t-s")
    options.get_by_label("lines").check()
    link = menu.get_by_role("link", name="nastran (.bdf)")
    with page.expect_download() as coming:
        link.click()
    assert coming.value.suggested_filename == "nastran.bdf"
    coming.value.save_as(tmp_path / "a.bdf")
    text = (tmp_path / "a.bdf").read_text()
    assert "at grid point 4711" in text
    assert "Units mm-t-s" in text
    assert "RLOAD1" in text
    assert "RANDPS" not in text
    page.get_by_text("Export", exact=True).click()  # as it was left
    options.get_by_label("grid", exact=True).fill("none", timeout=20_000)
    link.click()
    api.expect(page.locator("#alert")).to_contain_text("nastran: grid: 'none' is not allowed")


def test_a_limit_over_frequency_is_pasted(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    table = "frequency [Hz],torque [mN m]\n1,100\n40,100\n60,1\n400,1\n"
    verdict = limit(page, table)
    api.expect(verdict).to_contain_text("FAIL")
    curve = "document.querySelector('#spectrum-plot').data.find((one) => one.name === 'limit')"
    until(page, f"Boolean({curve})")
    points = page.evaluate(f"() => [{curve}.x, {curve}.y]")
    assert points[0] == [1, 40, 60, 400]
    assert points[1] == pytest.approx([0.1, 0.1, 0.001, 0.001])
