"""What a test engineer does with a spectrum on the page: cursors, peaks, orders, units, and taking figures away."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.page import PAGE, QUICK, SHORT, amplitude, api, run, until

import microvib as mv

pytestmark = PAGE
READING = "[...document.querySelectorAll('#run .reading')][0]"
ROWS = f"() => [...{READING}.querySelectorAll('tr')].map((row) => [...row.cells].map((cell) => cell.innerText))"


def figure(text: str) -> float:
    return float(text.replace("−", "-"))


def at(page: Any, frequency: float) -> tuple[float, float]:
    """Where a frequency lies on the spectrum, in pixels of the window."""
    x, y = page.evaluate(
        """(f) => {
          const plot = document.querySelector("#spectrum-plot");
          plot.scrollIntoView({ block: "center" });
          const box = plot.getBoundingClientRect();
          const { xaxis, _size: size } = plot._fullLayout;
          return [box.left + size.l + xaxis.d2p(f), box.top + size.t + size.h / 2];
        }""",
        frequency,
    )
    return x, y


@pytest.fixture
def page(visit: Callable[..., Any]) -> Any:
    page = visit(QUICK)
    run(page)
    page.evaluate("() => localStorage.removeItem('microvib.units')")
    return page


@pytest.fixture(scope="module")
def rate() -> float:
    """Microstep rate of the run [Hz]."""
    return float(mv.load_scenario("state-1", dict(SHORT)).driving_frequency)


def cursor(page: Any, mode: str) -> None:
    page.locator("#run .cursor-bar select").first.select_option(mode)


def test_harmonic_cursor_reads_the_lines_of_the_clock(page: Any, rate: float) -> None:
    cursor(page, "harmonic")
    page.mouse.click(*at(page, rate))
    head, first, second, *_ = page.evaluate(ROWS)
    assert head[1:4] == ["Hz", "× microstep rate", "× electrical frequency"]
    assert abs(figure(first[1]) - rate) < 0.25  # a bin
    assert abs(figure(second[2]) - 2) < 0.01
    assert abs(figure(first[3]) - 64) < 0.5  # 4 full steps of 16 microsteps
    shown = float(amplitude(page, "drive_1"))
    assert 1e3 * figure(first[4]) == pytest.approx(shown, rel=0.16)  # the Hann window's scalloping


def test_delta_and_sidebands_go_by_mouse_and_by_keys(page: Any, rate: float) -> None:
    cursor(page, "delta")
    page.mouse.click(*at(page, rate))
    page.mouse.click(*at(page, 2 * rate))
    _, one, other, difference = page.evaluate(ROWS)
    assert figure(difference[1]) == pytest.approx(rate, abs=0.5)
    ratio = figure(other[4]) / figure(one[4])
    percent, decibel = (figure(part.split()[0]) for part in difference[4].split(","))
    assert percent == pytest.approx(100 * (ratio - 1), rel=1e-3)
    assert decibel == pytest.approx(20 * math.log10(ratio), rel=1e-3)
    page.locator("#run .cursor-holder").first.focus()
    before = figure(page.evaluate(ROWS)[1][1])
    page.keyboard.press("ArrowRight")
    after = figure(page.evaluate(ROWS)[1][1])
    assert 0 < after - before <= 0.51
    page.keyboard.press("Shift+ArrowLeft")
    assert figure(page.evaluate(ROWS)[1][1]) < after
    page.keyboard.press("Escape")
    until(page, f"{READING}.hidden")
    page.keyboard.press("c")
    assert len(page.evaluate(ROWS)) == 2
    cursor(page, "sideband")
    page.mouse.click(*at(page, rate))
    page.mouse.click(*at(page, rate + 3.3))
    rows = {row[0]: row for row in page.evaluate(ROWS)}
    spacing = figure(rows["+1"][1]) - figure(rows["0"][1])
    assert figure(rows["0"][1]) - figure(rows["−1"][1]) == pytest.approx(spacing, abs=1e-3)


def test_peaks_are_those_of_the_curve_and_lead_the_cursor(page: Any, rate: float) -> None:
    page.get_by_role("button", name="Peaks").first.click()
    rows = page.locator("#run .peaks").first.locator("tbody tr")
    values = [figure(text) for text in rows.locator("td[data-key=y]").all_inner_texts()]
    assert len(values) == 12
    assert values == sorted(values, reverse=True)
    curve = page.evaluate(
        "() => { const t = document.querySelector('#spectrum-plot').data.find((t) => t.mode === 'lines'); return [...t.y]; }"
    )
    highest = sorted(
        b for a, b, c in zip(curve, curve[1:], curve[2:], strict=False) if b > a and b >= c
    )
    assert values == pytest.approx(highest[-12:][::-1], rel=1e-3)
    rows.locator("button").first.click()
    assert len(page.evaluate(ROWS)) == 2


def test_the_axis_of_orders_has_the_clocks_lines_at_whole_numbers(page: Any, rate: float) -> None:
    page.select_option("#spectrum-orders", "microstep rate")
    ticks = "document.querySelector('#spectrum-plot').layout.xaxis"
    until(page, f"({ticks}.ticktext ?? []).includes('1')")
    places = page.evaluate(f"() => [{ticks}.tickvals, {ticks}.ticktext]")
    for value, text in zip(*places, strict=True):
        assert value == pytest.approx(float(text) * rate)


def test_one_switch_changes_all_plots_and_tables(page: Any) -> None:
    highest = "Math.max(...document.querySelector('#spectrum-plot').data.find((t) => t.mode === 'lines').y)"
    before, line = page.evaluate(highest), float(amplitude(page, "drive_1"))
    page.locator(".units summary").click()
    page.select_option("#units-torque", "mN*m")
    until(page, f"Math.abs({highest} / {1e3 * before} - 1) < 1e-9")
    page.select_option("#units-level", "rms")
    until(page, f"Math.abs({highest} / {1e3 * before / math.sqrt(2)} - 1) < 1e-9")
    assert float(amplitude(page, "drive_1")) == pytest.approx(line / math.sqrt(2), rel=2e-3)
    heads = page.locator("#run .wide[aria-label='All lines'] th").all_inner_texts()
    assert any("mN m RMS" in head for head in heads)
    page.select_option("#units-torque", "dB")
    level = 20 * math.log10(before / math.sqrt(2))
    until(page, f"Math.abs({highest} - {level}) < 1e-6")
    assert figure(amplitude(page, "drive_1")) == pytest.approx(
        20 * math.log10(1e-3 * line / math.sqrt(2)), abs=0.06
    )
    api.expect(page.locator(".facts")).to_contain_text("dB")
    page.reload()
    page.wait_for_selector("html[data-ready]")
    until(
        page,
        f"document.querySelector('#spectrum-plot').data && Math.abs({highest} - {level}) < 1e-6",
    )
    page.evaluate("() => localStorage.removeItem('microvib.units')")


def test_plots_tables_and_drawings_are_taken_away(page: Any, tmp_path: Path) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])

    def got(name: str) -> bytes:
        with page.expect_download() as coming:
            page.get_by_role("button", name=name, exact=True).first.click()
        coming.value.save_as(tmp_path / "got")
        return (tmp_path / "got").read_bytes()

    plot = "Amplitude spectrum of the runs"
    assert got(f"PNG of {plot}")[:8] == b"\x89PNG\r\n\x1a\n"
    assert b"<svg" in got(f"SVG of {plot}")[:200]
    rows = list(csv.reader(io.StringIO(got(f"CSV of {plot}").decode())))
    assert rows[0] == ["curve", "frequency [Hz]", "amplitude [N m]"]
    curve = page.evaluate("() => document.querySelector('#spectrum-plot').data[0].y.length")
    assert sum(row[0] == rows[1][0] for row in rows) == curve
    lines = list(csv.DictReader(io.StringIO(got("CSV of All lines").decode())))
    drive_1 = next(row for row in lines if row["line"] == "drive_1")
    assert drive_1["amplitude [mN m]"] == amplitude(page, "drive_1")
    for name in ("All lines", "Drive train"):
        assert got(f"PNG of {name}")[:4] == b"\x89PNG"
        assert got(f"SVG of {name}").startswith(b"<svg")
    page.get_by_role("button", name="Copy of All lines", exact=True).click()
    api.expect(page.locator("#status")).to_have_text("Copied.")
    copied = page.evaluate("() => navigator.clipboard.readText()")
    assert copied.split("\n")[0].split("\t")[0] == "line"
    assert len(copied.split("\n")) == len(lines) + 1


def test_a_cell_that_would_be_a_formula_is_a_text(visit: Callable[..., Any]) -> None:
    page = visit()
    made = page.evaluate(
        "() => import('/static/downloads.js').then(({ csvOf }) => csvOf([['=1+1', '-3.5', '−2', 'a,b', '@x', '-x']]))"
    )
    assert made == "'=1+1,-3.5,-2,\"a,b\",'@x,'-x\n"
