"""The page's steps of docs/howto/test-day.md and docs/howto/systems-evening.md, in a browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.days import begun, blocks, prepared
from support.page import PAGE, amplitude, api, drawn, served, until, write

pytestmark = PAGE
ROOT = Path(__file__).parents[2]
PLOT = "document.querySelector('#recorded-history-plot')"
FOUR = ["a1.uff", "a2.uff", "b1.uff", "off.uff"]
AT = """([name, part, frequency]) => {
  const plot = document.querySelector(name);
  plot.scrollIntoView({ block: "center" });
  const box = plot.getBoundingClientRect();
  const { xaxis, _size: size } = plot._fullLayout;
  const x = frequency === null ? part * size.w : xaxis.d2p(frequency);
  return [box.left + size.l + x, box.top + size.t + size.h / 2];
}"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the first commands of the test engineer's day make."""
    return prepared("docs/howto/test-day.md", tmp_path_factory.mktemp("day"))


@pytest.fixture
def opened(chromium: Any, tmp_path: Path) -> Iterator[Any]:
    """The page of a server with a library of its own, without messages on its console."""
    trouble: list[str] = []
    with served(library=tmp_path / "library") as address:
        window = chromium.new_context(viewport={"width": 1366, "height": 768})
        window.set_default_timeout(240_000)
        page = window.new_page()
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.goto(address)
        page.wait_for_selector("html[data-ready]")
        yield page
        window.close()
    assert trouble == []


def at(page: Any, plot: str, part: float = 0.0, frequency: float | None = None) -> Any:
    return page.evaluate(AT, [plot, part, frequency])


def send(page: Any, folder: Path, *names: str) -> None:
    page.click("#tab-recording")
    page.set_input_files("#recording-file", [folder / name for name in names])
    page.locator("#recording p", has_text=f"{names[-1]}: ").wait_for()
    until(page, f"{PLOT}?.dataset.shown && {PLOT}.data?.length")
    page.locator("#recording-plot .main-svg").first.wait_for()


def the_drive(page: Any, folder: Path) -> None:
    page.set_input_files("#upload", folder / "my-drive.yaml")
    api.expect(page.locator("#title")).to_have_text("my drive")


def process(page: Any) -> None:
    page.get_by_role("button", name="Process", exact=True).click()


def reading(page: Any) -> list[list[str]]:
    """Rows of the cursor of the recording's spectrum."""
    rows: list[list[str]] = page.evaluate(
        """() => [...document.querySelector('#recording-plot').closest('.card').querySelectorAll('.reading tr')]
        .map((row) => [...row.cells].map((cell) => cell.innerText))"""
    )
    return rows


def figure(text: str) -> float:
    return float(text.replace("−", "-"))


@pytest.mark.release
def test_a_day_with_recordings(opened: Any, recordings: Path) -> None:
    """Tasks 1 to 6: library, section, averages, cursors, background, bands."""
    page = opened
    the_drive(page, recordings)
    send(page, recordings, *FOUR[::-1])
    page.click("#tab-library")
    api.expect(page.locator("#library tr[data-title$='.uff']")).to_have_count(4)
    attributes = page.get_by_label("Attributes of b1.uff")
    attributes.fill("unit: B")
    attributes.blur()
    page.fill("#library-search", "unit: B")
    api.expect(page.locator("#library tbody tr")).to_have_count(1)

    page.click("#tab-recording")
    page.get_by_role("button", name="Mark a section").click()
    until(page, f"{PLOT}._fullLayout.dragmode === 'select'")
    page.mouse.move(*at(page, "#recorded-history-plot", 0.25))
    page.mouse.down()
    page.mouse.move(*at(page, "#recorded-history-plot", 0.75), steps=4)
    page.mouse.up()
    until(page, "document.querySelector('#processing-from').value !== ''")
    ends = [float(page.input_value(f"#processing-{x}").removesuffix(" s")) for x in ("from", "to")]
    assert ends == pytest.approx([4.0, 12.0], abs=0.3)
    page.locator("#recording tr", has_text="drive_1").first.wait_for()

    page.select_option("#processing-average", "peak-hold")
    page.fill("#processing-resolution", "1 Hz")
    process(page)
    curve = "document.querySelector('#recording-plot').data.find((c) => c.name === 'Mz')"
    until(page, f"{curve}.x[1] === 1")
    assert float(amplitude(page, "drive_1", "#recording")) == pytest.approx(55.86, rel=1e-3)

    page.locator(".processing").get_by_role("button", name="Whole record").click()
    page.select_option("#processing-average", "none")
    page.fill("#processing-resolution", "")
    process(page)
    until(page, f"{curve}.x[1] < 0.1")
    card = page.locator("#recording-plot").locator("xpath=ancestor::*[contains(@class,'card')][1]")
    bar = card.locator(".cursor-bar select").first
    bar.select_option("harmonic")
    page.mouse.click(*at(page, "#recording-plot", frequency=53.333))
    until(page, "document.querySelectorAll('#recording .reading tr').length > 2")
    first, second = (figure(row[1]) for row in reading(page)[1:3])
    assert [first, second] == pytest.approx([53.333, 106.667], abs=0.1)
    bar.select_option("delta")
    page.mouse.click(*at(page, "#recording-plot", frequency=53.333))
    page.mouse.click(*at(page, "#recording-plot", frequency=106.667))
    assert figure(reading(page)[3][1]) == pytest.approx(53.333, abs=0.1)
    bar.select_option("sideband")
    page.mouse.click(*at(page, "#recording-plot", frequency=53.333))
    page.mouse.click(*at(page, "#recording-plot", frequency=56.667))
    rows = {row[0]: row for row in reading(page)}
    assert figure(rows["−1"][1]) == pytest.approx(50.0, abs=0.1)
    card.get_by_role("button", name="Peaks").click()
    assert card.locator(".peaks tbody tr").count() == 12

    page.locator("#processing-background option", has_text="off.uff").wait_for(state="attached")
    page.select_option("#processing-background", label="off.uff")
    page.locator(".bands-asked summary").click()
    page.fill("#processing-bands", (recordings / "bands.csv").read_text())
    process(page)
    names = "document.querySelector('#recording-plot').data.map((c) => c.name)"
    until(page, f"{names}.includes('background, drive off')")
    marks = "document.querySelector('#recording-plot').layout.annotations.map((one) => one.text)"
    assert "mains? 3 x 50 Hz" in page.evaluate(marks)
    page.locator("#bands-plot .main-svg").first.wait_for()
    verdicts = """document.querySelector('#bands-plot').layout.annotations
        .map((one) => one.text.split(',')[0].replace(/<.*?>/g, '')).join()"""
    until(page, f"{verdicts} === 'pass,not judged,not judged'")  # the background may add 1.3 mN m
    page.select_option("#processing-background", "")
    process(page)
    until(page, f"{verdicts} === 'pass,pass,not judged'")


def test_a_day_with_several_tests(opened: Any, recordings: Path) -> None:
    """Tasks 7, 10 and 11: orders of a sweep, repeatability, comparison."""
    page = opened
    page.set_input_files("#upload", recordings / "sweep.yaml")
    api.expect(page.locator("#title")).to_have_text("my drive")
    send(page, recordings, "sweep.uff")
    page.fill("#tracking-orders", "4,64,128")
    page.fill("#tracking-limit", "60 mN*m")
    page.get_by_role("button", name="Track orders").click()
    page.locator("#tracking-waterfall-plot .main-svg").first.wait_for()
    api.expect(page.locator("#recording")).to_contain_text("FAIL, above the limit: order 64.")

    the_drive(page, recordings)
    send(page, recordings, "a1.uff", "a2.uff", "b1.uff")
    several = page.locator("#several")
    for name, unit in (("a1.uff", "A"), ("a2.uff", "A"), ("b1.uff", "B")):
        several.get_by_label(name, exact=True).check()
        several.get_by_label(f"Unit of {name}").fill(unit)
    several.get_by_role("button", name="Repeatability").click()
    several.locator("h3", has_text="Lines of Mz").wait_for()
    api.expect(several).to_contain_text("3 runs of 2 units")
    several.get_by_label("a2.uff", exact=True).uncheck()
    several.get_by_role("button", name="Compare two").click()
    several.locator("td[data-key=b_amplitude_n_m]").first.wait_for()
    api.expect(several).to_contain_text("b1.uff (recording) against a1.uff (recording)")


@pytest.mark.release
def test_a_day_on_the_force_table(opened: Any, recordings: Path) -> None:
    """Tasks 8, 9 and 12: a hammer test, recordings without the table's dynamics and about another point, the
    acceptance report."""
    page = opened
    the_drive(page, recordings)
    send(page, recordings, "hits.uff", "off.uff", "b1.uff", "a1.uff")
    assert float(amplitude(page, "drive_1", "#recording")) == pytest.approx(55.87, rel=1e-3)
    blows = page.locator("#hammer")
    blows.get_by_label("hits.uff", exact=True).check()
    blows.get_by_label("Lever arm of hits.uff").fill("0.2 m")
    page.fill("#hammer-mounted_mass", "12 kg")
    blows.get_by_role("button", name="Find the response").click()
    page.get_by_role("button", name="Correct recordings by it").click()
    found = page.locator("#recording")
    api.expect(found).to_contain_text("9 of 10 blows count")
    api.expect(found).to_contain_text("double hit: 28 % again after 30 ms")
    with page.expect_download() as coming:
        found.get_by_role("button", name="CSV of Response of Mz").click()
    table = Path(coming.value.path()).read_text().splitlines()
    assert table[0] == "shown,curve,x,y"
    assert sum(row.startswith("coherence against frequency [Hz]") for row in table) > 100
    process(page)
    corrected = "corrected from 1.113 to 154.7 Hz for the table's dynamics, by at most 24.9 %"
    api.expect(found).to_contain_text(corrected)
    assert float(amplitude(page, "drive_1", "#recording")) == pytest.approx(54.27, rel=1e-3)
    assert float(amplitude(page, "drive_2", "#recording")) == pytest.approx(9.543, rel=1e-3)

    several = page.locator("#several")
    for name, unit in (("a1.uff", "A"), ("b1.uff", "B")):
        several.get_by_label(name, exact=True).check()
        several.get_by_label(f"Unit of {name}").fill(unit)
    for field, name in (("template", "report.md"), ("data", "unit.yaml")):
        page.set_input_files(f"#acceptance-{field}-file", recordings / name)
        api.expect(page.locator(f"#acceptance-{field}")).to_have_value(
            (recordings / name).read_text()
        )
    page.fill("#acceptance-limit", "60 mN*m")
    page.fill("#acceptance-band", "1.5:120 Hz")
    page.select_option("#acceptance-reference", "scenario")
    page.check("#acceptance-hammer")
    page.get_by_role("button", name="Make the report").click()
    api.expect(found).to_contain_text("Limit of 60 mN m from 1.5 to 120 Hz: 2 runs, 2 pass.")
    report = page.locator(
        ".figures", has=page.get_by_role("heading", name="Acceptance", exact=True)
    )
    with page.expect_download() as coming:
        report.get_by_role("button", name="report.html").click()
    text = Path(coming.value.path()).read_text()
    for words in ("Acceptance test of SADA of the example", "XY-SPEC-12", "Against the prediction"):
        assert words in text, words

    page.set_input_files("#recording-prepare-file", recordings / "moved.yaml")
    process(page)
    api.expect(found).to_contain_text("torques about [0.1, 0.05, 0.12] m")
    page.fill("#recording-prepare", (recordings / "how.yaml").read_text())
    process(page)
    refused = "table_frf.file: 'table/frf.csv' names a file, and it did not come with the request"
    api.expect(page.locator("#recording [role=alert]").first).to_contain_text(refused)
    page.reload()
    api.expect(found).to_contain_text("9 of 10 blows count")
    api.expect(page.locator("#recording-prepare")).to_have_value(
        (recordings / "how.yaml").read_text()
    )
    page.click("#tab-library")
    kept = page.locator("#library tbody tr")
    for kind in ("hammer test", "acceptance report"):
        api.expect(kept.filter(has_text=kind)).to_have_count(1)
    kept.filter(has_text="hammer test").get_by_role("button", name="Open").click()
    page.get_by_role("button", name="Correct recordings by it").click()
    api.expect(page.locator("#recording-prepare")).to_have_value(
        re.compile("file: frf.csv\n  mounted_mass: 12 kg")
    )


SHEET = {
    "holding_torque": "0.5 N*m",
    "phases_on": "2",
    "current": "0.6 A",
    "detent": "5 percent",
    "step_angle": "0.018 deg",
    "ratio": "100",
    "gear": "size 14",
}


@pytest.mark.release
def test_an_evening_from_a_data_sheet_to_two_designs(
    opened: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Tasks 1, 2 and 11: a scenario from a data sheet, a limit over frequency, a verdict on two designs."""
    page = opened
    files = {n: t for kind, n, t in blocks("docs/howto/systems-evening.md") if kind == "file"}
    page.click("#tab-sheet")
    for key, text in SHEET.items():
        page.fill(f"#sheet-{key}", text)
    page.get_by_role("button", name="Use as the scenario").click()
    api.expect(page.locator("#title")).to_have_text("my drive")
    page.check("#steady")
    page.click("#go")
    drawn(page, 1)
    page.fill("#limit", files["allowed.csv"])
    page.locator("#limit").blur()
    api.expect(page.locator("output.verdict")).to_contain_text("pass")
    assert float(amplitude(page, "drive_1")) == pytest.approx(41.24, rel=1e-3)
    assert float(amplitude(page, "full_step_1")) == pytest.approx(6.053, rel=1e-3)
    write(page, "driver.microsteps", "64")
    page.click("#go")
    drawn(page, 2)
    quieter = "[...document.querySelectorAll('#ab-verdict td[data-key=quieter]')].length"
    until(page, f"{quieter} === 3")


@pytest.fixture
def evening(tmp_path: Path) -> Path:
    """A folder with the files of the systems engineer's evening."""
    page, folder = "docs/howto/systems-evening.md", tmp_path / "evening"
    folder.mkdir()
    begun(page, folder)
    for kind, name, text in blocks(page):
        if kind == "file":
            (folder / name).write_text(text)
    return folder


@pytest.mark.release
def test_an_evening_on_a_craft(opened: Any, evening: Path) -> None:
    """Tasks 3, 4 and 10: rates that put a line on a mode, one envelope over them against a curve, and what
    contributes most to the line of sight."""
    page = opened
    page.set_input_files("#upload", ROOT / "examples" / "spacecraft.yaml")
    api.expect(page.locator("#title")).to_contain_text("Small craft")
    page.click("#tab-rates")
    for key, text in (("from", "0.06 deg/s"), ("to", "0.064 deg/s"), ("count", "3")):
        page.fill(f"#rates-{key}", text)
    page.fill("#rates-microsteps", "16")
    page.set_input_files("#rates-limit-file", evening / "allowed.csv")
    api.expect(page.locator("#rates-limit")).to_have_value(re.compile("^frequency_hz,t_mnm"))
    page.get_by_role("button", name="Map", exact=True).click()
    page.locator("#campbell-plot .main-svg").first.wait_for()
    api.expect(page.locator("#rates")).to_contain_text("array_mode_3")
    api.expect(page.locator("#rates")).to_contain_text("for a limit of 8 to 80 mN m")
    limits = (
        "document.querySelector('#largest-plot').data.filter((c) => c.name.startsWith('limit'))"
    )
    assert max(page.evaluate(f"{limits}[0].y")) == pytest.approx(80e-3)
    page.click("#tab-envelope")
    page.locator("#envelope").get_by_label("rates of Small craft").check()
    page.set_input_files("#envelope-limit-file", evening / "allowed.csv")
    api.expect(page.locator("#envelope-limit")).to_have_value(re.compile("^frequency_hz,t_mnm"))
    page.get_by_role("button", name="Find the envelope").click()
    found = page.locator("#envelope .figures")
    api.expect(found).to_contain_text("Maximum of 7 members")
    api.expect(found).to_contain_text("FAIL; smallest margin -8.5 dB")
    api.expect(found).to_contain_text("full_step_1 at 3.4659 Hz, 21.40 mN m of 8.000 mN m")
    page.click("#tab-run")
    page.check("#steady")
    page.click("#go")
    drawn(page, 1)
    craft = page.locator(".craft")
    craft.get_by_role("button", name="100 ms").click()
    api.expect(craft.locator(".ranking li").first).to_contain_text("full_step_1")


def choose(page: Any, field: str, file: Path) -> None:
    """Fill a field from a file, as its button does."""
    page.set_input_files(f"#budget-{field}-file", file)
    api.expect(page.locator(f"#budget-{field}")).to_have_value(file.read_text())


def assess(page: Any, *told: str) -> Any:
    """Assess the budget, and wait until the page says what is told; its results."""
    page.get_by_role("button", name="Assess").press("Enter")
    found = page.locator("#budget .figures")
    for words in told:
        api.expect(found).to_contain_text(words)
    return found


def contributors(page: Any, *wanted: str) -> list[str]:
    """Rows of the largest contributors that have some words."""
    card = page.locator(
        "#budget .card", has=page.get_by_role("heading", name="Largest contributors")
    )
    rows: list[str] = card.locator("tbody tr").all_inner_texts()
    return [row for row in rows if all(word in row for word in wanted)]


@pytest.mark.release
def test_an_evening_with_the_budget_of_a_craft(opened: Any, evening: Path) -> None:
    """Tasks 6 to 10: a wheel beside the drive, the worst angle, errors by class, a table of harmonics, and
    all lines at their crests; downloaded it is what the command line writes."""
    page = opened
    page.set_input_files("#upload", evening / "spacecraft.yaml")
    api.expect(page.locator("#title")).to_contain_text("Small craft")
    page.click("#tab-budget")
    page.check("#budget-steady")
    choose(page, "requirement", evening / "requirement.yaml")
    choose(page, "sources", evening / "sources.yaml")
    found = assess(page, "Pass: of 5 requirements, 5 pass, at an array angle of 30 deg only.")
    row = found.locator("tr", has_text="lines, x, amplitude over frequency").first
    assert re.sub(r"\s+", " ", row.inner_text()).startswith(
        "P-5 0.1468 0.132 0.134 +0.9 pass lines, x"
    )
    with page.expect_download() as coming:
        found.get_by_role("button", name="report.html").click()
    assert "Pointing of a small craft" in Path(coming.value.path()).read_text()

    page.fill("#budget-sources", "")
    page.fill("#budget-angles", "0,45,90")
    assess(
        page,
        "FAIL: of 5 requirements, 3 fail, 2 pass, the worst of 3 array angles from 0 to 90 deg, and at these only.",
    )

    page.fill("#budget-angles", "")
    choose(page, "requirement", evening / "absolute.yaml")
    choose(page, "sources", evening / "errors.yaml")
    assess(page, "Pass: of 2 requirements, 2 pass, at an array angle of 30 deg only.")
    assert contributors(page, "P-1", "alignment", "constant error, uniform", "0.2082")

    choose(page, "requirement", evening / "requirement.yaml")
    choose(page, "sources", evening / "wheel.yaml")
    page.get_by_role("button", name="Assess").click()
    said = page.locator("#budget [role=alert]")
    api.expect(said).to_contain_text(
        "'harmonics.csv' names a file, and it did not come with the request"
    )
    page.set_input_files("#budget-tables", evening / "harmonics.csv")
    api.expect(page.locator("#budget .sent li")).to_have_count(1)
    page.select_option("#budget-rule", "bound")
    assess(page, "add with the worst phases", "wheel 2")
    assert contributors(page, "P-1", "full_step_1", "3.333")
    page.reload()
    api.expect(page.locator("#budget .sent li")).to_have_count(1)
    api.expect(page.locator("#budget .figures")).to_contain_text("wheel 2")
    page.click("#tab-library")
    budgets = page.locator("#library tbody tr", has_text="pointing budget")
    api.expect(budgets).to_have_count(4)
    budgets.last.get_by_role("button", name="Open").click()
    api.expect(page.locator("#budget .figures")).to_contain_text("wheel 1")


def test_an_evening_with_two_designs_of_a_craft(opened: Any, evening: Path) -> None:
    """Task 11 on the line of sight: the form is kept as one design and changed into the other."""
    page = opened
    page.set_input_files("#upload", evening / "spacecraft.yaml")
    api.expect(page.locator("#title")).to_contain_text("Small craft")
    page.click("#tab-budget")
    page.check("#budget-steady")
    choose(page, "requirement", evening / "requirement.yaml")
    page.locator("#budget summary", has_text="Two designs").click()
    page.get_by_role("button", name="Keep the scenario on the left as design B").click()
    api.expect(page.locator("#budget-other")).to_have_value(re.compile("^title: Small craft"))
    write(page, "driver.microsteps", "64")
    found = assess(page, "Both designs pass all of 5 requirements.", "the second scenario")
    row = re.sub(r"\s+", " ", found.locator("tr", has_text="P-1").first.inner_text())
    assert row.startswith("P-1 0.02 0.005983 0.006014 +10.5 pass 0.006556 0.006639 +9.7 pass"), row
    api.expect(found.get_by_role("button", name="designs.csv")).to_have_count(1)
