"""A test engineer's day: a recording browsed, cut, processed, tracked and compared."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.page import PAGE, api, until

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
