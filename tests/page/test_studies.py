"""Recordings, rate maps and sizing on the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.page import (
    PAGE,
    QUICK,
    SHORT,
    amplitude,
    api,
    drawn,
    run,
    until,
)
from support.tiers import sweep

import microvib as mv
from microvib.io.recordings import write_recording
from microvib.io.sources import open_source
from microvib.studies.analyse import analyse
from microvib.testdata.recording import Recording

pytestmark = PAGE


def test_upload_a_recording(visit: Callable[..., Any], tmp_path: Path) -> None:
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "record.sample_rate": "2048 Hz"}))
    noise = np.random.default_rng(1).normal(0.0, 1e-4, motion.time.size)
    recording = Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"})
    write_recording(recording, tmp_path / "test.csv")
    table = analyse(
        open_source(str(tmp_path / "test.csv")), scenario=mv.load_scenario("state-1")
    ).table
    assert table is not None
    page = visit(QUICK)
    run(page)
    page.click("#tab-recording")
    page.set_input_files("#recording-file", tmp_path / "test.csv")
    page.locator("#recording td").first.wait_for(timeout=240_000)
    assert amplitude(page, "drive_1", "#recording") == f"{1e3 * table['drive_1'].amplitude:#.4g}"
    page.get_by_role("button", name="Compare with the current run").click()
    page.locator("#recording td[data-key=b_amplitude_n_m]").first.wait_for(timeout=240_000)
    (tmp_path / "test.exe").write_bytes(b"MZ")
    page.set_input_files("#recording-file", tmp_path / "test.exe")
    page.get_by_text("'.exe' is not known").wait_for()


@pytest.mark.parametrize("unit", sweep(["N m", "mN·m"], "mN·m"))
def test_the_run_is_drawn_under_a_recording_however_its_unit_is_written(
    visit: Callable[..., Any], tmp_path: Path, unit: str
) -> None:
    motion = mv.simulate(mv.load_scenario("state-1", SHORT), channels=("T_d",))
    size = 1e3 if unit.startswith("m") else 1.0
    write_recording(
        Recording({"Mz": size * motion["T_d"]}, motion.sample_rate, {"Mz": unit}),
        tmp_path / "test.csv",
    )
    page = visit(QUICK)
    run(page)
    page.click("#tab-recording")
    page.set_input_files("#recording-file", tmp_path / "test.csv")
    drawn = "document.querySelector('#recording-plot')?.data?.map((curve) => curve.name) ?? []"
    until(page, f"({drawn}).includes('Mz')")
    names = page.evaluate(drawn)
    assert names[0].startswith("T_d of state-1")
    below, above = page.evaluate(
        "document.querySelector('#recording-plot').data.slice(0, 2).map((c) => Math.max(...c.y))"
    )
    assert below == pytest.approx(above, rel=1e-6)  # the same samples, both in N m


def test_a_recording_is_refined_on_zoom_and_kept_over_a_reload(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "record.sample_rate": "2048 Hz"}))
    noise = np.random.default_rng(1).normal(0.0, 1e-4, motion.time.size)
    recording = Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"})
    write_recording(recording, tmp_path / "test.csv")
    expected = analyse(
        open_source(str(tmp_path / "test.csv")), scenario=mv.load_scenario("state-1")
    ).spectrum
    page = visit(QUICK)
    page.click("#tab-recording")
    page.set_input_files("#recording-file", tmp_path / "test.csv")
    page.locator("#recording-plot .main-svg").first.wait_for(timeout=240_000)
    page.get_by_role("button", name="Add a parameter").click()
    page.evaluate("Plotly.relayout('recording-plot', {'xaxis.range[0]': 50, 'xaxis.range[1]': 60})")
    shown = "document.querySelector('#recording-plot').data[0].x"
    until(page, f"{shown}.at(-1) < 61")
    assert np.diff(page.evaluate(shown)) == pytest.approx(expected.resolution)
    page.reload()
    until(page, f"document.querySelector('#recording-plot')?.data && {shown}.at(-1) < 61")
    page.locator("#recording td").first.wait_for()
    assert amplitude(page, "drive_1", "#recording")
    assert page.locator(".fit").count() == 2


def test_rate_map_and_sizing(visit: Callable[..., Any]) -> None:
    page = visit()
    page.click("#tab-rates")
    page.fill("#rates-count", "12")
    page.fill("#rates-limit", "30 mN*m")
    page.check("#rates-linear")
    page.locator("#rates button.primary").click()
    page.locator("#campbell-plot .main-svg").first.wait_for(timeout=240_000)
    assert page.locator("#rates td[data-key=mode]").count()
    page.fill("#rates-from", "0.01 kg")
    page.locator("#rates button.primary").click()
    page.locator("#rates [role=alert]").get_by_text("0.01 kg").wait_for()
    page.click("#tab-sas")
    page.locator("#sas button.primary").click()
    page.locator("#sas td").first.wait_for(timeout=240_000)
    assert "state 5" in page.locator("#sas table").first.inner_text()


WOUND_UP = "#base=state-1&record.settle=6+s&record.duration=4+s"
"""A record that begins when friction has let go of the array in every case."""


@pytest.mark.release
def test_a_quieter_drive_over_the_one_before(visit: Callable[..., Any]) -> None:
    """A wrong range is said; what a search finds goes into the form and lies over the run before."""
    page = visit(WOUND_UP)
    page.click("#tab-quiet")
    page.fill("#quiet-effort", "4")
    page.fill("#quiet-cases", "8")
    page.fill("#quiet-range-current", "0.6:0.3 A")
    page.locator("#quiet button.primary").first.click()
    page.locator("#quiet [role=alert]").get_by_text("LOW must be below HIGH").wait_for()
    page.uncheck("#quiet-lever-current")
    page.locator("#quiet button.primary").first.click()
    page.get_by_role("button", name="Use this drive").click()
    until(page, "location.hash.includes('driver.microstep_ramp=')")
    assert page.get_by_role("button", name="scenario.yaml").count() == 1
    page.get_by_role("button", name="Run before and after").click()
    drawn(page, 2)
    near_drive_1 = "c.y.filter((_, k) => Math.abs(c.x[k] - 53) < 2)"
    before, after = page.evaluate(
        "document.querySelector('#spectrum-plot').data.filter((c) => c.mode === 'lines')"
        f".map((c) => Math.max(...{near_drive_1}))"
    )
    assert after < 0.01 * before
    near_mode = near_drive_1.replace("53) < 2", "1.19) < 0.5")
    for ringing in page.evaluate(
        "document.querySelector('#spectrum-plot').data.filter((c) => c.mode === 'lines')"
        f".map((c) => Math.max(...{near_mode}))"
    ):
        assert ringing < 0.1 * before  # both begin in their steady states, where no mode rings


CURVE = "frequency_hz,t_mnm\n1,100\n40,100\n40,1\n500,1\n"


@pytest.mark.release
def test_a_search_by_a_curve_with_a_margin_and_a_table_that_is_judged(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    """A curve from a file and constraints bring a verdict; a table that is judged goes into the form."""
    (tmp_path / "allowed.csv").write_text(CURVE)
    page = visit(WOUND_UP)
    page.click("#tab-quiet")
    for key, text in (("effort", "4"), ("cases", "8")):
        page.fill(f"#quiet-{key}", text)
    page.select_option("#quiet-objective", label="requirements on the line of sight")
    page.get_by_text("which the scenario on the left does not have").wait_for()
    assert not page.locator("#quiet-requirement").is_visible()
    page.select_option("#quiet-objective", label="lines over a limit curve")
    assert not page.get_by_label("limit for 95 % of cases").is_visible()
    page.set_input_files("#quiet-curve-file", tmp_path / "allowed.csv")
    api.expect(page.locator("#quiet-curve")).to_have_value(CURVE)
    page.get_by_text("Scatter and constraints").click()
    page.get_by_label("motorisation factors").fill("friction=0.5, total=1.2")
    page.locator("#quiet button.primary").first.click()
    page.locator("#quiet [role=alert]").get_by_text("must be at least 1").wait_for()
    api.expect(page.get_by_label("motorisation factors")).to_be_focused()
    page.get_by_label("motorisation factors").fill("friction=1.5, total=1.2")
    page.get_by_label("least torque margin").fill("1")
    page.locator("#quiet button.primary").first.click()
    facts = page.locator("#quiet .figures .facts").first
    facts.get_by_text("lines over the limit curve").wait_for()
    assert "% of the limit" in facts.inner_text()
    assert facts.locator(".fail b").inner_text() == "Fail"
    page.select_option("#quiet-action", label="judge a table of currents")
    page.fill("#quiet-check", "order,amplitude_deg,phase_deg\n4,2.5,0\n")
    page.get_by_role("button", name="Judge").click()
    page.get_by_role("heading", name="The table over the cases").wait_for()
    page.get_by_role("button", name="Use this drive").click()
    until(page, "location.hash.includes('driver.table=')")
    page.reload()
    page.get_by_role("heading", name="The table over the cases").wait_for()
    assert page.get_by_role("button", name="Judge").count() == 1
    assert page.locator("#quiet-check").input_value().startswith("order")
    assert page.get_by_label("least torque margin").is_visible()  # it has a figure


def test_a_cancelled_search_says_its_best_so_far(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.click("#tab-quiet")
    page.fill("#quiet-effort", "1000")
    page.locator("#quiet button.primary").first.click()
    best = page.locator("#quiet .job .words").get_by_text("best so far")
    best.wait_for()
    page.locator("#quiet .cancel").click()
    page.locator("#quiet [role=alert]").get_by_text("Search was cancelled; best so far").wait_for()


@pytest.mark.release
def test_a_point_of_a_rate_map_is_run(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.click("#tab-rates")
    page.fill("#rates-count", "4")
    page.fill("#rates-microsteps", "16")
    page.check("#rates-linear")
    page.locator("#rates button.primary").click()
    page.get_by_text("A click on a point offers its run").wait_for()
    until(page, "document.querySelector('#largest-plot')?.data?.length > 0")
    until(page, "document.querySelector('#largest-plot')._ev?._events?.plotly_click !== undefined")
    click = "{points: [{customdata: [0.05, 16]}]}"
    page.evaluate(f"document.querySelector('#largest-plot').emit('plotly_click', {click})")
    page.get_by_role("button", name="Run it in its steady state").click()
    drawn(page, 1)
    assert page.locator(".chip.done").get_by_text("0.05 deg/s, 16 microsteps").count() == 1
