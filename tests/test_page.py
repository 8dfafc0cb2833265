"""The page in a real Chromium, against the real server: what a person does with it."""

from __future__ import annotations

import csv
import io
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.scenarios import baseline

import microvib as mv
from microvib.analysis.limits import Limit, judge
from microvib.errors import ScenarioError
from microvib.io.recordings import write_recording
from microvib.io.scenario_file import dump_scenario
from microvib.reports.document import Document, Live, Section
from microvib.reports.rendering import html
from microvib.studies.analyse import analyse
from microvib.testdata.recording import Recording
from microvib.web.server.access import Access
from microvib.web.server.entrance import opening_file

pytest.importorskip("fastapi", reason="the page's server is not installed (microvib[serve])")
api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")

SHORT = {"record.settle": "1 s", "record.duration": "4 s"}
QUIET = [
    "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--no-first-run",
]  # fmt: skip


@contextmanager
def served(port: int = 0) -> Iterator[str]:
    """A server of its own; what it prints, with its token."""
    command = [sys.executable, "-m", "microvib", "serve", "--port", str(port), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found is not None
        yield found.group()
        process.terminate()


@pytest.fixture(scope="module")
def printed_address() -> Iterator[str]:
    with served() as address:
        yield address


@pytest.fixture(scope="module")
def address(printed_address: str) -> str:
    """Where the server listens."""
    return printed_address.partition("?")[0]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def browser(chromium: Any, printed_address: str) -> Any:
    """A window of a browser that was let in; its pages share a cache, cookie and key, and no more."""
    window = chromium.new_context(viewport={"width": 1366, "height": 768}, accept_downloads=True)
    page = window.new_page()
    page.goto(printed_address)
    page.wait_for_selector("html[data-ready]")
    page.close()
    return window


@pytest.fixture
def visit(browser: Any, address: str) -> Iterator[Callable[..., Any]]:
    """Opens the page; at the end nothing must be on the console, and nothing asked from anywhere else."""
    trouble: list[str] = []

    def heard(message: Any) -> None:
        refusal = "status of 422" in message.text  # an answer with a sentence, which Chromium reports
        if message.type in ("error", "warning") and not refusal:
            trouble.append(message.text)

    def open_page(fragment: str = "") -> Any:
        page = browser.new_page()
        page.set_default_timeout(30_000)
        page.on("console", heard)
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.on("request", lambda r: None if r.url.startswith((address, "blob:", "data:")) else trouble.append(r.url))
        page.goto(address + fragment)
        page.wait_for_selector("html[data-ready]")
        return page

    yield open_page
    for page in browser.pages:
        page.close()
    assert trouble == []


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
    page.locator(".chip.done").nth(runs - 1).wait_for(timeout=240_000)
    end = time.monotonic() + 20
    while len((page.locator(".figures[data-drawn]").first.get_attribute("data-drawn") or "").split()) < runs:
        assert time.monotonic() < end
        page.wait_for_timeout(30)


def amplitude(page: Any, line: str, tab: str = "#run") -> str:
    """Amplitude of a line [mN m] as the page shows it."""
    row = (
        page.locator(f"{tab} tr").filter(has=page.locator("td[data-key=line]", has_text=re.compile(f"^{line}$"))).first
    )
    return str(row.locator("td[data-key=amplitude_n_m]").inner_text())


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """``lines.csv`` of the command line, for state 1 with one value changed, short."""
    where = tmp_path_factory.mktemp("command")
    changes = {**SHORT, "reducer.stiffness": "9000 N*m/rad"}
    options = [text for key, value in changes.items() for text in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "microvib", "run", "state-1", *options, "--out", "run"]
    subprocess.run(command, cwd=where, check=True, capture_output=True, timeout=300)
    return (where / "run" / "lines.csv").read_text(encoding="utf-8")


def test_edit_run_and_read_what_the_command_line_says(visit: Callable[..., Any], printed: str, tmp_path: Path) -> None:
    page = visit()
    shorten(page)
    write(page, "reducer.stiffness", "9000 N*m/rad")
    run(page)
    lines = {row["line"]: row["amplitude_n_m"] for row in csv.DictReader(io.StringIO(printed))}
    assert amplitude(page, "drive_1") == f"{1e3 * float(lines['drive_1']):#.5g}"
    assert amplitude(page, "drive_2") == f"{1e3 * float(lines['drive_2']):#.5g}"
    assert page.locator("#spectrum-plot .main-svg").count()
    assert page.locator("#history-plot .main-svg").count()
    assert "mean" in page.locator("svg.drive").get_attribute("aria-label")
    found = downloads(page, tmp_path)
    assert found["lines.csv"].decode() == printed
    assert mv.load_scenario(str(tmp_path / "scenario.yaml")).reducer.stiffness == 9000.0
    assert found["motion.nc"][1:4] == b"HDF"
    assert b"<html" in found["report.html"]


def downloads(page: Any, tmp_path: Path) -> dict[str, bytes]:
    """Files of the chosen run, as a person gets them."""
    found = {}
    for name in ("scenario.yaml", "lines.csv", "motion.nc", "report.html"):
        page.locator("details.menu summary").click()
        with page.expect_download() as coming:
            page.locator(f"details.menu a[download='{name}']").click()
        coming.value.save_as(tmp_path / name)
        found[name] = (tmp_path / name).read_bytes()
    return found


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
    modes.fill(f"[{{frequency: 1.2 Hz, {damped}: 6 kg*m^2}}, {{frequency: 4 Hz, {damped}: 2 kg*m^2}}]")
    api.expect(field(page, "array.modes.1.frequency")).to_have_value("4 Hz")
    api.expect(modes).to_be_focused()  # the form has grown while it was typed in
    page.locator(".field[data-key='array.modes'] .undo").click()
    api.expect(field(page, "array.modes.1.frequency")).to_have_count(0)


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


def test_upload_a_scenario(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = visit()
    mine = baseline().with_si({"motor.current": 0.45, **SHORT}).model_copy(update={"title": "my own drive"})
    (tmp_path / "mine.yaml").write_text(dump_scenario(mine), encoding="utf-8")
    (tmp_path / "broken.yaml").write_text("motor: [", encoding="utf-8")
    wrong = dump_scenario(mine.with_sources({})).replace("sources: {}\n", "").replace("0.45 A", "3 parsec")
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
    table = mv.lines(mv.simulate(mine))
    assert amplitude(page, "drive_1") == f"{1e3 * table['drive_1'].amplitude_n_m:#.5g}"


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


def test_two_tabs_at_once(visit: Callable[..., Any]) -> None:
    first = visit("#base=state-1&record.settle=1+s&record.duration=4+s")
    second = visit("#base=state-5&record.settle=1+s&record.duration=4+s")
    first.click("#go")
    second.click("#go")
    drawn(first, 1)
    drawn(second, 1)
    for page, name in ((first, "state-1"), (second, "state-5")):
        changed = mv.load_scenario(name, dict(SHORT))
        expected = mv.lines(mv.simulate(changed))["drive_1"].amplitude_n_m
        assert amplitude(page, "drive_1") == f"{1e3 * expected:#.5g}"
        assert page.locator(".chip").count() == 1


def test_runs_are_kept_overlaid_and_removed(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&record.settle=1+s&record.duration=4+s")
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


def test_zoom_asks_for_the_window_and_keeps_peaks(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&record.settle=1+s&record.duration=4+s")
    run(page)
    motion = mv.simulate(mv.load_scenario("state-1", dict(SHORT)))
    whole = page.evaluate("document.querySelector('#history-plot').data[0].y")
    assert max(whole) == pytest.approx(motion["T_d"].max(), rel=1e-12)
    assert min(whole) == pytest.approx(motion["T_d"].min(), rel=1e-12)
    page.get_by_role("button", name="4 microsteps").click()
    page.get_by_text("every sample").wait_for()
    t, y = page.evaluate("(({x, y}) => [x, y])(document.querySelector('#history-plot').data[0])")
    assert np.diff(t) == pytest.approx(1 / 4096)
    assert y == pytest.approx(motion["T_d"][: len(y)])
    page.get_by_role("button", name="Slow motion").click()
    page.get_by_role("button", name="Pause").click()
    page.get_by_label("Instant of the record").fill("10")
    shown = f"{1e3 * motion['T_d'][10]:+#.4g} mN m".replace("-", "−")
    api.expect(page.locator("svg.drive .whole")).to_contain_text(shown)


def test_upload_a_recording(visit: Callable[..., Any], tmp_path: Path) -> None:
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "record.sample_rate": "2048 Hz"}))
    noise = np.random.default_rng(1).normal(0.0, 1e-4, motion.time.size)
    recording = Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"})
    write_recording(recording, tmp_path / "test.csv")
    table = analyse(str(tmp_path / "test.csv"), scenario="state-1").table
    assert table is not None
    page = visit("#base=state-1&record.settle=1+s&record.duration=4+s")
    run(page)
    page.click("#tab-recording")
    page.set_input_files("#recording-file", tmp_path / "test.csv")
    page.locator("#recording td").first.wait_for(timeout=240_000)
    assert amplitude(page, "drive_1", "#recording") == f"{1e3 * table['drive_1'].amplitude_n_m:#.4g}"
    page.get_by_role("button", name="Compare with the current run").click()
    page.locator("#recording td[data-key=b_n_m]").first.wait_for(timeout=240_000)
    (tmp_path / "test.exe").write_bytes(b"MZ")
    page.set_input_files("#recording-file", tmp_path / "test.exe")
    page.get_by_text("'.exe' is not known").wait_for()


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


def test_keyboard_only(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&record.settle=1+s&record.duration=4+s")

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
    assert page.locator("#recording").is_visible()
    page.keyboard.press("ArrowLeft")
    assert page.locator("#run").is_visible()
    tab_to("[id='field-motor.current']")
    page.keyboard.press("Control+A")
    page.keyboard.type("0.5 A")
    page.keyboard.press("Enter")
    drawn(page, 1)
    assert "current 0.5 A" in page.locator(".chip.done .name").inner_text()


def test_narrow_window(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&record.settle=1+s&record.duration=4+s")
    page.set_viewport_size({"width": 400, "height": 800})
    run(page)
    for tab in ("run", "recording", "rates", "sas"):
        page.click(f"#tab-{tab}")
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.click("#tab-run")
    assert page.locator("#spectrum-plot").bounding_box()["width"] > 300


def test_everything_that_takes_input_has_a_name(visit: Callable[..., Any]) -> None:
    page = visit()
    nameless = page.evaluate(
        """[...document.querySelectorAll('input, select, button, progress')]
        .filter(e => !(e.labels?.length || e.ariaLabel || e.innerText?.trim() || e.textContent.trim())).map(e => e.outerHTML)"""
    )
    assert nameless == []


def test_the_token_goes_into_the_browser_and_out_of_the_address(
    chromium: Any, printed_address: str, address: str, tmp_path: Path
) -> None:
    """Through the file that the command opens: other users see a browser's address in the list of processes."""
    page = chromium.new_context().new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    api.expect(page.locator("#alert")).to_contain_text("open the address that microvib serve printed")
    token = printed_address.partition("token=")[2]
    page.goto(opening_file(tmp_path, address, Access(token=token)).as_uri())
    page.wait_for_selector("html[data-ready]")
    assert page.url.startswith(address)
    assert not any(token in url for url in [*asked, page.url, page.evaluate("document.referrer")])
    assert page.evaluate("document.cookie") == ""
    (cookie,) = page.context.cookies()
    assert (cookie["name"], cookie["httpOnly"], cookie["sameSite"]) == (
        f"microvib-{address[:-1].rpartition(':')[2]}",
        True,
        "Strict",
    )
    fragment = "#base=state-5"
    page.goto(printed_address + fragment)  # what a person may type
    page.wait_for_selector("html[data-ready]")
    assert page.url.startswith(address)
    assert page.url.endswith(fragment)
    assert token not in page.url


FOREIGN = """<a href="https://evil.example/">Press</a><img src="https://evil.example/x.png" onerror="alert(1)"><script>alert(1)</script><b>&lt;</b>"""


def test_a_foreign_title_is_text_wherever_it_stands(visit: Callable[..., Any], tmp_path: Path) -> None:
    page = visit()
    mine = baseline().with_(dict(SHORT)).model_copy(update={"title": FOREIGN})
    (tmp_path / "mine.yaml").write_text(dump_scenario(mine), encoding="utf-8")
    page.set_input_files("#upload", tmp_path / "mine.yaml")
    api.expect(page.locator("#title")).to_have_text(FOREIGN)
    run(page)
    page.evaluate(
        """async (title) => {
          const { draw } = await import("/static/plots.js");
          const data = [{ x: [1, 2], y: [1, 2], name: title, text: [title, title], hovertemplate: `%{text}<extra>%{fullData.name}</extra>` }];
          const place = document.querySelector("#spectrum-plot");
          await draw(place, data, { showlegend: true, title: { text: title }, annotations: [{ x: 1, y: 1, text: title }] });
          await window.Plotly.Fx.hover(place, [{ curveNumber: 0, pointNumber: 0 }]);
        }""",
        FOREIGN,
    )
    assert page.locator("#spectrum-plot .legendtext").inner_html().count("<") == 0
    assert page.locator("#spectrum-plot .legendtext").text_content() == FOREIGN
    assert "Press" in page.locator("#spectrum-plot .hoverlayer").text_content()
    assert "Press" in page.locator("#spectrum-plot .annotation").text_content()
    assert not page.locator("#results a[href*=evil], #results svg a, img[src*=evil]").count()
    report = tmp_path / "report.html"
    report.write_bytes(downloads(page, tmp_path)["report.html"])
    shown = page.context.new_page()
    asked: list[str] = []
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto(report.as_uri())
    assert shown.locator("h1").inner_text().startswith('<a href="https://evil.example/">')
    assert not shown.locator("a, script").count()
    assert not [url for url in asked if not url.startswith(("file:", "data:"))]
    shown.evaluate("document.body.append(Object.assign(new Image(), { src: 'https://evil.example/y.png' }))")
    shown.evaluate(
        "document.body.append(Object.assign(document.createElement('script'), { textContent: 'window.ran = 1' }))"
    )
    assert shown.evaluate("window.ran") is None  # nor would what might slip in later


def test_the_one_script_of_a_report_runs(chromium: Any, tmp_path: Path) -> None:
    """The report's policy lets mode shapes move, and names no more than their script."""
    moving = (resources.files("microvib.reports") / "templates" / "shapes.html").read_text(encoding="utf-8")
    section = Section("In motion", (Live(moving.replace("__DATA__", '{"names": ["first"]}')),))
    document = Document("report", "modes", "", (), (), (section,), "")
    (tmp_path / "report.html").write_text(html(document), encoding="utf-8")
    page = chromium.new_context().new_page()
    page.goto((tmp_path / "report.html").as_uri())
    assert page.locator("#shape-mode option").all_text_contents() == ["first"]


class Held:
    """Answers that the server has given and that have not arrived; what comes later may overtake them."""

    def __init__(self, page: Any, address: str, method: str = "GET") -> None:
        self._page, self._method, self._holds = page, method, True
        self._waiting: list[tuple[Any, Any]] = []
        page.route(address, self._hold)

    def _hold(self, route: Any) -> None:
        if self._holds and route.request.method == self._method:
            self._waiting.append((route, route.fetch()))
        else:
            route.continue_()

    def wait(self) -> None:
        """Until one is held."""
        end = time.monotonic() + 30
        while not self._waiting:
            assert time.monotonic() < end
            self._page.wait_for_timeout(20)

    def release(self) -> None:
        """Let all arrive, and what comes after them go by."""
        self._holds = False
        for route, answer in self._waiting:
            route.fulfill(response=answer)


QUICK = "#base=state-1&record.settle=1+s&record.duration=4+s"


def delay(page: Any, milliseconds: int) -> None:
    """Each request takes so much longer."""
    network = page.context.new_cdp_session(page)
    conditions = {"latency": milliseconds, "downloadThroughput": -1, "uploadThroughput": -1, "offline": False}
    network.send("Network.emulateNetworkConditions", conditions)


def test_an_answer_from_before_a_start_says_nothing_of_it(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    held = Held(page, "**/api/jobs*")
    page.click("#go")
    held.wait()  # a list of all jobs, asked for before the second run
    with page.expect_response("**/api/runs"):
        page.click("#go")
    page.wait_for_timeout(50)
    held.release()
    page.locator(".chip.done").nth(1).wait_for(timeout=60_000)
    assert page.locator(".chip").count() == 2


def test_run_change_run_again_and_cancel_over_a_slow_line(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    delay(page, 200)
    page.click("#go")
    write(page, "motor.current", "0.5 A")
    page.click("#go")
    write(page, "record.settle", "5000 s")
    page.click("#go")
    page.locator(".chip.running").get_by_text("settle 5000 s").wait_for(timeout=60_000)
    page.get_by_role("button", name="Cancel").last.click()
    page.locator(".chip.cancelled").wait_for()
    drawn(page, 2)
    page.locator(".chip .name").nth(1).click()
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "motor.current": "0.5 A"}))
    api.expect(page.locator("#run tr", has_text="drive_1").first).to_contain_text(
        f"{1e3 * mv.lines(motion)['drive_1'].amplitude_n_m:#.5g}"
    )
    page.reload()
    page.locator(".chip.done").nth(1).wait_for(timeout=60_000)


def test_run_takes_the_form_as_it_was_at_the_click(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    write(page, "motor.current", "0.5 A")
    held = Held(page, "**/api/scenario", "POST")
    page.click("#go")
    write(page, "motor.current", "0.7 A")  # while nothing has been answered
    held.wait()
    held.release()
    drawn(page, 1)
    page.locator("details.menu summary").click()
    with page.expect_download() as coming:
        page.locator("details.menu a[download='scenario.yaml']").click()
    assert mv.load_scenario(str(coming.value.path())).motor.current == 0.5


def test_a_late_answer_about_another_run_is_not_shown(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    write(page, "motor.current", "0.5 A")
    run(page)
    page.locator(".chip .name").first.click()
    held = Held(page, "**/series?channels=T_e*")
    page.get_by_role("button", name="Slow motion").click()
    held.wait()
    page.locator(".chip .name").last.click()
    held.release()
    page.get_by_role("button", name="Slow motion").click()
    page.get_by_role("button", name="Pause").click()
    page.get_by_label("Instant of the record").fill("10")
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "motor.current": "0.5 A"}))
    shown = f"{1e3 * motion['T_d'][10]:+#.4g} mN m".replace("-", "−")
    api.expect(page.locator("svg.drive .whole")).to_contain_text(shown)


def test_a_server_that_was_started_again_says_so(chromium: Any) -> None:
    with served() as address:
        page = chromium.new_context().new_page()
        page.goto(address + QUICK)
        page.wait_for_selector("html[data-ready]")
        run(page)
    api.expect(page.locator("#server")).to_contain_text("does not answer", timeout=20_000)
    with served(int(re.findall(r":(\d+)/", address)[0])) as address:
        api.expect(page.locator("#server")).to_contain_text("was started again", timeout=20_000)
        page.locator(".chip.gone").wait_for()
        other = page.context.new_page()
        other.goto(address)  # lets the browser in
        other.wait_for_selector("html[data-ready]")
        page.get_by_role("button", name="Run it again").click()
        drawn(page, 1)
        assert page.locator(".chip").count() == 1


def test_no_colour_comes_twice(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    colours = page.evaluate("import('/static/styles.js').then(m => [...Array(60).keys()].map(k => m.style(k)[0]))")
    assert len(set(colours)) == 60
    run(page)
    traces = page.evaluate("document.querySelector('#history-plot').data.map(t => t.line.color)")
    assert len(traces) == len(set(traces)) == 7
    assert not set(traces[1:]) & set(colours)


def limit(page: Any, text: str) -> Any:
    page.fill("#limit", text)
    page.locator("#limit").blur()
    return page.locator("output.verdict")


def test_a_limit_gives_a_verdict_here_and_in_the_report(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    run(page)
    motion = mv.simulate(mv.load_scenario("state-1", dict(SHORT)))
    half = float(f"{0.5 * mv.lines(motion)['drive_1'].amplitude_n_m:.4g}")
    judged = judge(mv.lines(motion), Limit(half), motion.scenario)
    worst = next(m for m in judged.margins if m.verdict != "not judged")
    drive_1 = next(m for m in judged.margins if m.line.line == "drive_1")
    assert drive_1.fails
    minus = "\N{MINUS SIGN}"
    api.expect(limit(page, f"{half!r} N*m")).to_contain_text("FAIL")
    api.expect(page.locator(".facts .fail")).to_contain_text(f"{worst.decibel:.1f} dB".replace("-", minus))
    row = page.locator("#run tr").filter(has=page.locator("td[data-key=line]", has_text=re.compile("^drive_1$"))).first
    api.expect(row.locator("td[data-key=margin_db]")).to_have_text(f"{drive_1.decibel:.1f} FAIL".replace("-", minus))
    drawn_at = f"Math.abs(s.y0 / {half} - 1) < 1e-3"
    until(page, f"document.querySelector('#spectrum-plot').layout.shapes.some(s => {drawn_at})")
    address = page.locator("details.menu a[download='report.html']").get_attribute("href")
    assert "limit" in page.evaluate("async a => (await fetch(a)).text()", address)
    api.expect(limit(page, "30 kg")).to_contain_text("30 kg")
    api.expect(limit(page, "20 N*m")).to_contain_text("Limit 2e+04 mN m")
    page.reload()
    api.expect(page.locator("output.verdict")).to_contain_text("Limit 2e+04 mN m")


def test_the_spectrum_is_on_the_first_screen_of_a_laptop_and_names_are_apart(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1")
    run(page)
    limit(page, "30 mN*m")
    api.expect(page.locator("output.verdict")).to_contain_text("Limit 30")
    box = page.locator("#spectrum-plot").bounding_box()
    assert box["y"] + box["height"] < 768
    for width in (1366, 390):
        page.set_viewport_size({"width": width, "height": 844})
        page.wait_for_timeout(1200)
        boxes = page.evaluate(
            """[...document.querySelectorAll('#spectrum-plot .annotation-text')].map(e => e.getBoundingClientRect())
            .map(b => [b.left, b.right, b.top, b.bottom])"""
        )
        assert len(boxes) > 3
        for k, a in enumerate(boxes):
            for b in boxes[:k]:
                assert not (a[0] < b[1] - 2 and b[0] < a[1] - 2 and a[2] < b[3] - 2 and b[2] < a[3] - 2), (a, b)


def test_the_array_view_shows_the_mode_that_the_drive_excites(visit: Callable[..., Any]) -> None:
    page = visit("#base=state-1&array.fem=reference-array&record.settle=1+s&record.duration=4+s")
    found = page.evaluate(
        """import('/static/channels.js').then(m => m.excited({
          modes: [1, 2, 3].map(k => ({name: `array_mode_${k}`, frequency: k})),
          lines: [{line: 'array_mode_2', kind: 'array mode', status: 'below the floor', amplitude_n_m: 9},
                  {line: 'array_mode_3', kind: 'array mode', status: 'decaying', amplitude_n_m: 2},
                  {line: 'array_mode_1', kind: 'array mode', status: 'ok', amplitude_n_m: 1}]}).name)"""
    )
    assert found == "array_mode_3"
    names = page.evaluate(
        "import('/static/labels.js').then(m => m.modeNames([1, 2, 3, 7].map(k => ({name: `array_mode_${k}`}))))"
    )
    assert names == "array modes 1–3, 7"


def until(page: Any, condition: str) -> None:
    """Wait for a condition of the page, whose policy lets nobody evaluate texts in it."""
    end = time.monotonic() + 60
    while not page.evaluate(condition):
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def test_a_recording_is_refined_on_zoom_and_kept_over_a_reload(visit: Callable[..., Any], tmp_path: Path) -> None:
    motion = mv.simulate(mv.load_scenario("state-1", {**SHORT, "record.sample_rate": "2048 Hz"}))
    noise = np.random.default_rng(1).normal(0.0, 1e-4, motion.time.size)
    recording = Recording({"Mz": motion["T_d"] + noise}, motion.sample_rate, {"Mz": "N*m"})
    write_recording(recording, tmp_path / "test.csv")
    expected = analyse(str(tmp_path / "test.csv"), scenario="state-1").spectrum
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


def test_tables_keep_their_columns_on_a_phone(visit: Callable[..., Any]) -> None:
    page = visit(QUICK)
    page.set_viewport_size({"width": 390, "height": 844})
    run(page)
    edges = page.evaluate("[...document.querySelectorAll('#run td')].map(e => e.getBoundingClientRect().right)")
    assert len(edges) > 50
    assert max(edges) <= 390
    row = page.locator("#run tr", has_text="drive_1").first
    assert row.locator("td[data-key=amplitude_n_m]").get_attribute("data-label") == "amplitude [mN m]"
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
