"""The page in a real Chromium, against the real server: what a person does with it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the page's server is not installed (microvib[serve])")
api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
# s that a condition may take to come true, for whoever shares the machine; most take milliseconds
PATIENCE = int(os.environ.get("MICROVIB_PATIENCE", "240"))
api.expect.set_options(timeout=1000 * PATIENCE)
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
PAGE = [
    pytest.mark.long,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
]
SHORT = {"record.settle": "1 s", "record.duration": "4 s"}
QUICK = "#base=state-1&record.settle=1+s&record.duration=4+s"


@contextmanager
def served(port: int = 0, library: Path | None = None) -> Iterator[str]:
    """A server of its own, which keeps nothing unless it gets a library; what it prints, with its token."""
    keeps = ["--no-library"] if library is None else ["--library", str(library)]
    command = [
        sys.executable,
        "-m",
        "microvib",
        "serve",
        "--port",
        str(port),
        "--no-browser",
        *keeps,
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found is not None
            yield found.group()
        finally:  # or leaving the process would wait for its end, which nobody asks for
            process.terminate()


def field(page: Any, key: str) -> Any:
    return page.locator(f"[id='field-{key}']")


def write(page: Any, key: str, text: str) -> None:
    """Type a value into its field; its group is opened first, as a person would."""
    group = page.locator(f"details[data-group={key.split('.')[0]}]")
    if group.get_attribute("open") is None:
        group.locator("summary").first.click()
    field(page, key).fill(text)
    field(page, key).blur()


def shorten(page: Any) -> None:
    for key, text in SHORT.items():
        write(page, key, text)


def run(page: Any) -> None:
    """Press Run and wait for the picture of the run."""
    done = page.locator(".chip.done").count()
    page.click("#go")
    drawn(page, done + 1)


def drawn(page: Any, runs: int) -> None:
    page.locator(".chip.done").nth(runs - 1).wait_for(timeout=1000 * PATIENCE)
    end = time.monotonic() + PATIENCE
    while (
        len((page.locator(".figures[data-drawn]").first.get_attribute("data-drawn") or "").split())
        < runs
    ):
        assert time.monotonic() < end
        page.wait_for_timeout(30)


def amplitude(page: Any, line: str, tab: str = "#run") -> str:
    """Amplitude of a line [mN m] as the page shows it."""
    row = (
        page.locator(f"{tab} tr")
        .filter(has=page.locator("td[data-key=line]", has_text=re.compile(f"^{line}$")))
        .first
    )
    return str(row.locator("td[data-key=amplitude_n_m]").inner_text())


def downloads(page: Any, tmp_path: Path) -> dict[str, bytes]:
    """Files of the chosen run, as a person gets them."""
    found = {}
    for name in ("scenario.yaml", "lines.csv", "motion.nc", "report.html"):
        page.locator("details.files summary").click()
        with page.expect_download() as coming:
            page.locator(f"details.files a[download='{name}']").click()
        coming.value.save_as(tmp_path / name)
        found[name] = (tmp_path / name).read_bytes()
    return found


def limit(page: Any, text: str) -> Any:
    page.fill("#limit", text)
    page.locator("#limit").blur()
    return page.locator("output.verdict")


def until(page: Any, condition: str) -> None:
    """Wait for a condition of the page, whose policy lets nobody evaluate texts in it.

    What the condition asks of may not be there yet: its error counts only once the wait is over.
    """
    end = time.monotonic() + PATIENCE
    while not holds(page, condition, last=time.monotonic() >= end):
        page.wait_for_timeout(50)


def holds(page: Any, condition: str, *, last: bool) -> bool:
    """Truth of a condition of the page; the last time it is asked it must be true."""
    try:
        found = bool(page.evaluate(condition))
    except api.Error:
        if last:
            raise
        return False
    assert found or not last, condition
    return found
