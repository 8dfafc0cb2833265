"""What somebody in front of the page waits for: its first paint, *Run* that can be pressed, a run's picture with few and many
runs beside it, how much comes over the line, and a long recording's time history, from its file to each window.

Needs a Chromium and playwright, as the tests of the page do.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import microvib as mv
from microvib.io.recordings import write_recording

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.page import api, served

RUN = "#base=state-1"
PAINT = """() => new Promise((told) => {
  const paint = performance.getEntriesByName("first-contentful-paint")[0];
  if (paint) return told(paint.startTime);
  new PerformanceObserver((list) => told(list.getEntries()[0].startTime)).observe({ type: "paint", buffered: true });
})"""
PACKED = """() => performance.getEntriesByType("resource").concat(performance.getEntriesByType("navigation"))
  .reduce((sum, one) => [sum[0] + one.encodedBodySize, sum[1] + one.decodedBodySize, sum[2] + one.transferSize], [0, 0, 0])"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=30, help="runs that are there in the end")
    parser.add_argument("--openings", type=int, default=5, help="openings of the page")
    parser.add_argument("--slow", type=int, default=0, help="a line of so many kbit/s, 0 for none")
    parser.add_argument(
        "--samples", type=int, default=10_000_000, help="samples of the recording, 0 for none"
    )
    parser.add_argument("--format", default="mat", help="of its file: mat, uff or csv")
    asked = parser.parse_args()
    with served() as address, api.sync_playwright() as playwright:
        chromium = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        window = browser.new_context(viewport={"width": 1366, "height": 768})
        window.set_default_timeout(240_000)
        page = window.new_page()
        page.goto(address)
        page.wait_for_selector("html[data-ready]")
        openings(window, address.partition("?")[0], asked.openings, asked.slow)
        if asked.runs:
            clicks(page, asked.runs)
        if asked.samples:
            browsing(page, asked.samples, asked.format)
        browser.close()


def openings(window: Any, address: str, times: int, kbits: int) -> None:
    """First paint and *Run*, cold and from the cache."""
    print(
        "opening                     first paint ms   Run after it ms   over the line kB   unpacked kB"
    )
    for words, cold in (("nothing in the cache", True), ("all in the cache", False)):
        found = [opening(window, address, cold, kbits) for _ in range(times)]
        row = [statistics.median(column) for column in zip(*found, strict=True)]
        print(
            f"{words:26s} {row[0]:14.0f} {row[1]:17.0f} {row[2]:18.0f} {row[3]:13.0f}", flush=True
        )


def opening(window: Any, address: str, cold: bool, kbits: int) -> tuple[float, float, float, float]:
    page = window.new_page()
    session = window.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Network.setCacheDisabled", {"cacheDisabled": cold})
    if kbits:
        session.send(
            "Network.emulateNetworkConditions",
            {"offline": False, "latency": 30, "downloadThroughput": 125 * kbits, "uploadThroughput": 125 * kbits},
        )  # fmt: skip
    page.add_init_script(
        """new MutationObserver((_, watch) => {
          const go = document.querySelector("#go");
          if (!go || go.disabled) return;
          performance.mark("run-enabled");
          watch.disconnect();
        }).observe(document, { subtree: true, childList: true, attributes: true, attributeFilter: ["disabled"] })"""
    )
    page.goto(address + RUN)
    page.wait_for_selector("html[data-ready]")
    paint = page.evaluate(PAINT)
    enabled = page.evaluate('() => performance.getEntriesByName("run-enabled")[0].startTime')
    page.wait_for_function("() => window.Plotly")
    packed, unpacked, moved = page.evaluate(PACKED)
    page.close()
    return paint, enabled - paint, (packed if cold else moved) / 1e3, unpacked / 1e3


def clicks(page: Any, runs: int) -> None:
    """From the click to the run's result and picture, with more and more runs beside it."""
    print("\nruns     click to result ms: least, median     to picture ms: least, median")
    found = []
    for k in range(1, runs + 1):
        found.append(click(page, k))
        if k % 5 == 0:
            result, picture = (
                (min(column), statistics.median(column)) for column in zip(*found[-5:], strict=True)
            )
            print(
                f"{k - 4:2d}-{k:2d} {result[0]:25.0f} {result[1]:8.0f} {picture[0]:23.0f} {picture[1]:8.0f}",
                flush=True,
            )


DRAWN = """() => {
  const [done] = performance.getEntriesByName("run-done");
  return done && performance.getEntriesByName("run-drawn").some(({ startTime }) => startTime > done.startTime);
}"""
ALL_DRAWN = "(k) => (document.querySelector('#run .figures').dataset.drawn ?? '').split(' ').filter(Boolean).length >= k"
MARKS = """() => {
  const [click] = performance.getEntriesByName("click");
  const [done] = performance.getEntriesByName("run-done");
  const drawn = performance.getEntriesByName("run-drawn").find(({ startTime }) => startTime > done.startTime);
  return [done.startTime - click.startTime, drawn.startTime - click.startTime];
}"""


def click(page: Any, k: int) -> tuple[float, float]:
    page.evaluate(
        """() => {
          performance.clearMarks();
          document.querySelector("#go").addEventListener("click", () => performance.mark("click"), { once: true, capture: true });
        }"""
    )
    page.locator("[id='field-motor.current']").fill(f"{0.4 + 0.005 * k:.3f} A")
    page.click("#go")
    page.wait_for_function(DRAWN, polling=20)
    found = page.evaluate(MARKS)
    page.wait_for_function(ALL_DRAWN, arg=k, polling=50)
    return tuple(found)


SHOWN = "#recorded-history-plot"
DRAWN_WINDOW = f"document.querySelector('{SHOWN}')?.dataset.shown"
WINDOWS = 40


def browsing(page: Any, samples: int, ending: str) -> None:
    """From a recording's file to its picture, and from a turn of the wheel or a key to the next."""
    x = np.random.default_rng(1).normal(size=samples)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"long.{ending}"
        write_recording(mv.Recording({"Mz": x}, 4096.0, {"Mz": "N*m"}), file)
        page.click("#tab-recording")
        begun = time.perf_counter()
        page.set_input_files("#recording-file", file)
        page.locator(f"{SHOWN}[data-shown]").wait_for()
        print(f"\n{samples} samples, {file.stat().st_size / 1e6:.0f} MB as {ending}")
        print(f"from the file to its picture {time.perf_counter() - begun:8.1f} s")
    holder = page.locator(SHOWN).locator("..")
    holder.focus()
    box = page.locator(SHOWN).bounding_box()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    turns = [lambda: page.mouse.wheel(0, -100)] * (WINDOWS // 2)
    keys = [lambda key=key: page.keyboard.press(key) for key in ("PageDown", "-", "PageUp", "+")]
    for name, actions in (("wheel", turns), ("keys", keys * (WINDOWS // 8))):
        each = [window(page, action) for action in actions]
        found = f"median {1e3 * statistics.median(each):5.0f} ms, slowest {1e3 * max(each):5.0f} ms"
        print(f"window by {name:6s} {found}, of {len(each)}", flush=True)


def window(page: Any, action: Any) -> float:
    """Seconds from what is done to the picture of the next window."""
    before = page.evaluate(DRAWN_WINDOW)
    begun = time.perf_counter()
    action()
    while page.evaluate(DRAWN_WINDOW) == before:
        time.sleep(0.002)
    return time.perf_counter() - begun


if __name__ == "__main__":
    main()
