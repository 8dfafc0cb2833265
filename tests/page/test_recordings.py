"""A test engineer's day: a recording browsed, cut, processed, tracked and compared."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.page import PAGE, amplitude, api, served, until

import microvib as mv
from microvib.io.recordings import write_recording
from microvib.testdata.recording import Recording

pytestmark = PAGE
RATE = 1024.0
PLOT = "document.querySelector('#recorded-history-plot')"
SPAN = f"{PLOT}.dataset.shown.split(' ').slice(0, 2).map(Number)"


def a_test(seconds: float = 60.0, seed: int = 1) -> Recording:
    """A tone in noise with one large sample at a third of its time."""
    samples = int(seconds * RATE)
    t = np.arange(samples) / RATE
    x = 0.02 * np.sin(2.0 * np.pi * 53.0 * t)
    x += np.random.default_rng(seed).normal(0.0, 1e-3, samples)
    x[samples // 3] = 0.3
    return Recording({"Mz": x, "Fx": 2.0 * x}, RATE, {"Mz": "N*m", "Fx": "N"}, "test")


def load(page: Any, recording: Recording, folder: Path, name: str = "test.mat") -> None:
    """Choose a file and wait for its time history."""
    write_recording(recording, folder / name)
    page.click("#tab-recording")
    page.set_input_files("#recording-file", folder / name)
    page.locator("#recording p", has_text=f"{name}: ").wait_for()
    until(page, f"{PLOT}?.dataset.shown && {PLOT}.data?.length")


def span(page: Any) -> list[float]:
    found: list[float] = page.evaluate(SPAN)
    return found


def changed(page: Any, before: list[float]) -> list[float]:
    """The window that is seen next."""
    until(page, f"String({SPAN}) !== '{','.join(map(repr_of, before))}'")
    return span(page)


def repr_of(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(value)


def at(page: Any, part: float) -> tuple[float, float]:
    """A place in the time history, by a part of its axis."""
    place: list[float] = page.evaluate(
        f"""() => {{ const {{ _size: size }} = {PLOT}._fullLayout; const box = {PLOT}.getBoundingClientRect();
        return [box.left + size.l + {part} * size.w, box.top + size.t + size.h / 2]; }}"""
    )
    return place[0], place[1]


def drag(page: Any, start: float, stop: float) -> None:
    page.mouse.move(*at(page, start))
    page.mouse.down()
    page.mouse.move(*at(page, stop), steps=4)
    page.mouse.up()


def test_a_time_history_is_browsed_by_mouse_wheel_and_keys(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    load(page, a_test(), tmp_path)
    assert span(page) == [0, 60]
    assert page.evaluate(f"Math.max(...{PLOT}.data[0].y)") == pytest.approx(0.3, rel=1e-6)
    holder = page.locator("#recorded-history-plot").locator("..")
    holder.scroll_into_view_if_needed()
    holder.focus()
    page.mouse.move(*at(page, 1 / 3))
    page.mouse.wheel(0, -100)
    closer = changed(page, [0, 60])
    assert closer[1] - closer[0] == pytest.approx(48)
    assert (20 - closer[0]) / 48 == pytest.approx(1 / 3, abs=0.01)  # where the pointer is, it stays
    for key, expected in (("+", 24.0), ("-", 48.0), ("PageDown", 48.0), ("PageUp", 48.0)):
        before = span(page)
        page.keyboard.press(key)
        now = changed(page, before)
        assert now[1] - now[0] == pytest.approx(expected)
    page.keyboard.press("Home")
    until(page, f"{SPAN}[0] === 0 && {SPAN}[1] === 60")
    drag(page, 0.2, 0.6)
    now = changed(page, [0, 60])
    assert now == pytest.approx([12, 36], abs=0.5)
    page.get_by_role("button", name="Move", exact=True).click()
    until(page, f"{PLOT}._fullLayout.dragmode === 'pan'")
    drag(page, 0.6, 0.4)
    moved = changed(page, now)
    assert moved[0] - now[0] == pytest.approx(0.2 * 24, abs=0.5)
    for _ in range(12):
        before = span(page)
        page.get_by_role("button", name="See less time").click()
        changed(page, before)
    step = page.evaluate(f"{PLOT}.data[0].x[1] - {PLOT}.data[0].x[0]")
    assert step == pytest.approx(1 / RATE)  # every sample
    page.reload()
    until(page, f"{PLOT}?.dataset.shown && {PLOT}.data?.length")
    until(page, f"{SPAN}[1] - {SPAN}[0] < 1")


def test_what_is_being_sent_is_told_and_can_be_stopped(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    page.click("#tab-recording")
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send(
        "Network.emulateNetworkConditions",
        {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": 2_000_000},
    )
    x = np.random.default_rng(1).normal(size=3_000_000)
    write_recording(Recording({"Mz": x}, RATE, {"Mz": "N*m"}), tmp_path / "large.mat")
    page.set_input_files("#recording-file", tmp_path / "large.mat")
    api.expect(page.locator("#recording .job .words")).to_contain_text("of 24 MB")
    page.get_by_role("button", name="Cancel large.mat").click()
    api.expect(page.locator("#recording .job")).to_have_count(0)
    session.send(
        "Network.emulateNetworkConditions",
        {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1},
    )
    load(page, a_test(8.0), tmp_path)


def words(page: Any, place: str) -> str:
    found: str = page.locator(place).inner_text()
    return found


def in_two_halves(seed: int = 1, drive: bool = True) -> Recording:
    """The driving line of state 1, larger in the second half, with a harmonic of the mains."""
    t = np.arange(int(40 * RATE)) / RATE
    x = np.random.default_rng(seed).normal(0.0, 2e-4, t.size) + 2e-3 * np.cos(200.0 * np.pi * t)
    f_d = mv.load_scenario("state-1").driving_frequency
    if drive:
        x += np.where(t < 20.0, 0.04, 0.06) * np.cos(2.0 * np.pi * f_d * t)
    return Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "test")


def test_a_section_is_marked_and_processed_beside_its_background(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    load(page, in_two_halves(7, drive=False), tmp_path, "off.mat")
    load(page, in_two_halves(), tmp_path)
    page.locator("#recording-plot .main-svg").first.wait_for()
    page.locator("#processing-background option", has_text="off.mat").wait_for(state="attached")
    page.select_option("#processing-background", label="off.mat")
    page.locator(".bands-asked summary").click()
    page.fill("#processing-bands", "low_hz,high_hz,limit_mn_m\n20,80,50\n80,150,20")
    page.get_by_role("button", name="Mark a section").click()
    until(page, f"{PLOT}._fullLayout.dragmode === 'select'")
    page.locator("#recorded-history-plot").scroll_into_view_if_needed()
    drag(page, 0.6, 0.9)
    page.locator("#bands-plot .main-svg").first.wait_for()
    page.locator("#recording tr", has_text="drive_1").first.wait_for()
    start, stop = (
        float(page.input_value(f"#processing-{end}").removesuffix(" s")) for end in ("from", "to")
    )
    assert [start, stop] == pytest.approx([24.0, 36.0], abs=0.5)
    assert float(amplitude(page, "drive_1", "#recording")) == pytest.approx(60.0, rel=0.01)
    names = "document.querySelector('#recording-plot').data.map((curve) => curve.name)"
    until(page, f"{names}.includes('background, drive off')")
    marks = "document.querySelector('#recording-plot').layout.annotations.map((one) => one.text)"
    mains, *lines = page.evaluate(marks)
    assert mains == "mains? 2 x 50 Hz"
    assert lines[0].startswith("<b>drive_1</b>")
    assert "FAIL" in words(page, "#bands")
    assert "A shows none of the main lines of B (drive_2 " in words(page, "#bands")
    bands = "document.querySelector('#bands-plot')"
    verdicts = page.evaluate(f"{bands}.layout.annotations.map((one) => one.text)")
    assert [text.partition(",")[0] for text in verdicts] == ["<b>FAIL</b>", "<b>not judged</b>"]
    low, high = page.evaluate(f"[{bands}.data[0].x[0], {bands}.data[0].x.at(-1)]")
    assert start < low < high < stop
    levels = "document.querySelector('#waterfall-plot').data[0]"
    assert page.evaluate(f"{levels}.type") == "heatmap"
    assert start < page.evaluate(f"{levels}.y[0]") < page.evaluate(f"{levels}.y.at(-1)") < stop
    page.evaluate("Plotly.relayout('waterfall-plot', {'xaxis.range[0]': 50, 'xaxis.range[1]': 60})")
    until(page, f"{levels}.x.at(-1) < 61 && {levels}.x[0] > 49")
    page.select_option("#processing-average", "peak-hold")
    page.fill("#processing-resolution", "1 Hz")
    page.get_by_role("button", name="Process", exact=True).click()
    curve = "document.querySelector('#recording-plot').data.find((curve) => curve.name === 'Mz')"
    until(page, f"{curve}.x[1] === 1")
    page.fill("#processing-from", "two seconds")
    page.get_by_role("button", name="Process", exact=True).click()
    page.locator("#recording [role=alert]", has_text="from").wait_for()


def test_lines_of_a_recording_meet_a_limit_over_frequency(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    load(page, in_two_halves(), tmp_path)
    page.locator("#recording-plot .main-svg").first.wait_for()
    page.locator(".limit-asked summary").click()
    curve = tmp_path / "allowed.csv"
    curve.write_text("frequency_hz,t_mnm\n1,200\n52.9,200\n52.95,45\n53.05,45\n53.1,200\n150,200\n")
    page.set_input_files("#processing-limit-file", curve)
    page.fill("#processing-from", "20 s")
    page.get_by_role("button", name="Process", exact=True).click()
    found = page.locator("#recording")
    api.expect(found).to_contain_text("FAIL: 1 of 22 lines")
    api.expect(found).to_contain_text("where 45 mN m are allowed")
    drawn = "document.querySelector('#recording-plot').data.find((one) => one.name === 'limit')"
    until(page, f"{drawn} !== undefined")
    assert page.evaluate(f"Math.min(...{drawn}.y)") == pytest.approx(0.045)
    page.fill("#processing-limit", "90 mN*m")
    page.get_by_role("button", name="Process", exact=True).click()
    api.expect(found).not_to_contain_text("FAIL: 1 of 22 lines")
    names = "document.querySelector('#recording-plot').layout.annotations.map((one) => one.text)"
    until(page, f"{names}.some((one) => one.startsWith('limit 90'))")
    page.reload()
    api.expect(page.locator("#processing-limit")).to_have_value("90 mN*m")


def test_low_frequencies_of_a_recording_are_seen_on_a_logarithmic_axis(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    t = np.arange(round(40.0 * RATE)) / RATE
    x = sum(0.02 * np.sin(2.0 * np.pi * f * t) for f in (0.9, 1.3, 53.0))
    x += np.random.default_rng(2).normal(0.0, 1e-3, t.size)
    load(page, Recording({"Mz": x}, RATE, {"Mz": "N*m"}, "test"), tmp_path)
    page.locator("#recording-plot .main-svg").first.wait_for()
    card = page.locator(".card", has=page.locator("#recording-plot"))
    card.get_by_role("button", name="log f").click()
    layout = "document.querySelector('#recording-plot').layout"
    until(page, f"{layout}.xaxis.type === 'log'")
    low, high = page.evaluate(f"{layout}.xaxis.range")
    assert low == pytest.approx(-1.0)
    assert high == pytest.approx(np.log10(200.0))
    assert page.evaluate("Math.min(...document.querySelector('#recording-plot').data.find((one) => one.name === 'Mz').x)") > 0.0  # fmt: skip
    places = page.evaluate(f"{layout}.annotations.map((one) => [one.text, one.x])")
    named = [x for text, x in places if "0.9 Hz" in text or "0.9000 Hz" in text]
    assert named == pytest.approx([np.log10(0.9)], abs=1e-3)
    page.reload()
    until(page, f"{layout}?.xaxis.type === 'log'")


@pytest.mark.release
def test_a_trigger_finds_the_section(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = visit()
    load(page, in_two_halves(), tmp_path)
    page.locator("#recording-plot .main-svg").first.wait_for()
    page.fill("#processing-trigger", "Mz > 55 mN*m")
    page.fill("#processing-to", "10 s")
    page.get_by_role("button", name="Process", exact=True).click()
    until(page, f"{PLOT}.layout.shapes?.length === 1")
    shape = page.evaluate(f"[{PLOT}.layout.shapes[0].x0, {PLOT}.layout.shapes[0].x1]")
    assert shape == pytest.approx([20.0, 30.0], abs=0.05)


def sweep() -> Recording:
    """Orders 1 and 4 from 10 to 40 revolutions per second in 5 s, the clock 0.4 % fast."""
    t = np.arange(5001) / 1000.0
    turns = 1.004 * (10.0 * t + 3.0 * t**2)
    x = 0.5 * np.cos(2.0 * np.pi * turns) + 1.2 * np.cos(8.0 * np.pi * turns)
    x += 0.01 * np.random.default_rng(1).normal(size=t.size)
    return Recording({"Mz": x}, 1000.0, {"Mz": "N*m"}, "sweep")


@pytest.mark.release
def test_orders_of_a_sweep_outlast_the_server(chromium: Any, tmp_path: Path) -> None:
    library = tmp_path / "library"
    cuts = "document.querySelector('#cuts-plot')"
    named = f"{cuts}.data.filter((c) => c.name.startsWith('order'))"
    with served(library=library) as address:
        page = opened(chromium, address)
        load(page, sweep(), tmp_path, "sweep.mat")
        page.fill("#tracking-orders", "1,4")
        page.select_option("#tracking-reference", "profile")
        page.fill("#tracking-profile", "/etc/passwd.csv")
        page.get_by_role("button", name="Track orders").click()
        page.locator("#tracking [role=alert]", has_text="no files are opened here").wait_for()
        page.fill("#tracking-profile", "0 s:10 Hz, 5 s:40 Hz")
        page.fill("#tracking-limit", "frequency_hz,t_mnm\n5,700\n300,700")
        page.get_by_role("button", name="Track orders").click()
        page.locator("#tracking-waterfall-plot .main-svg").first.wait_for()
        before = page.evaluate(f"{named}.map((c) => c.y)")
        assert np.nanmean([y for y in before[1] if y is not None]) == pytest.approx(1.2, rel=0.01)
        maps = "document.querySelector('#order-map-plot').data[0]"
        assert page.evaluate(f"{maps}.type") == "heatmap"
        path = "document.querySelector('#tracking-waterfall-plot').data[2]"
        assert page.evaluate(f"{path}.x.at(-1)") == pytest.approx(160.6, rel=0.01)
        page.select_option("#cuts-along", "frequency")
        until(page, f"{cuts}.layout.xaxis.title.text === 'frequency [Hz]'")
    with served(int(re.findall(r":(\d+)/", address)[0]), library) as address:
        page = opened(chromium, address)
        page.click("#tab-library")
        page.locator("#library tr[data-title^='orders of sweep.mat']").get_by_role(
            "button", name="Open"
        ).click()
        page.locator("#tracking-waterfall-plot .main-svg").first.wait_for()
        assert page.evaluate(f"{named}.map((c) => c.y)") == before
        assert "FAIL, above the limit: order 4." in words(page, "#recording")
        until(page, f"{PLOT}?.dataset.shown && {PLOT}.data?.length")


def opened(chromium: Any, address: str) -> Any:
    """The page in a browser that has never seen it."""
    window = chromium.new_context(viewport={"width": 1366, "height": 768})
    window.set_default_timeout(240_000)
    page = window.new_page()
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    return page


@pytest.mark.release
def test_several_recordings_are_compared_repeated_and_processed_alike(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    steady = [a_test(20.0, seed) for seed in (1, 2, 3)]
    for k, recording in enumerate(steady):
        load(page, recording, tmp_path, f"unit-{k}.mat")
    several = page.locator("#several")
    for k in range(3):
        several.get_by_label(f"unit-{k}.mat", exact=True).check()
    several.get_by_role("button", name="Process alike").click()
    picture = "document.querySelector('#several-plot').data"
    page.locator("#several-plot .main-svg").first.wait_for()
    assert page.evaluate(f"{picture}.map((c) => c.name)") == [f"unit-{k}.mat" for k in range(3)]
    several.locator("h3", has_text="Figures of all records").wait_for()
    several.get_by_role("button", name="Repeatability").click()
    several.locator("h3", has_text="Lines of Mz").wait_for()
    assert several.locator("img").count() == 1
    several.get_by_role("button", name="Compare two").click()
    page.locator("#alert", has_text="Tick two recordings").wait_for()
    several.get_by_label("unit-2.mat", exact=True).uncheck()
    several.get_by_role("button", name="Compare two").click()
    several.locator("td[data-key=b_amplitude_n_m]").first.wait_for()
    assert "unit-1.mat (recording) against unit-0.mat (recording)" in several.inner_text()
