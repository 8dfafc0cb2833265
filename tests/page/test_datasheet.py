"""From a data sheet to a ranking: sentences beside the fields, the file, the scenario, what matters most."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from support.page import PAGE, api, field, until, write

from microvib.io.new_scenario import sheet_text

RANKED = re.compile("matters? most|the most influential")

pytestmark = PAGE


def test_a_data_sheet_becomes_a_scenario_and_its_assumptions_are_ranked(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    page = visit()
    page.get_by_role("button", name="from a data sheet").click()
    torque, ratio = (
        page.locator("#sheet").get_by_label(x)
        for x in ("Holding torque of the motor", "Reduction ratio")
    )
    torque.fill("0.5 kg")
    ratio.fill("0.2")
    api.expect(page.locator("#sheet-holding_torque-error")).to_contain_text(
        "a unit compatible with N*m is expected"
    )
    api.expect(page.locator("#sheet-ratio-error")).to_contain_text("at least 1 and at most 1000")
    use = page.get_by_role("button", name="Use as the scenario")
    use.click()
    api.expect(torque).to_be_focused()
    api.expect(page.locator("#title")).not_to_have_text("my drive")
    torque.fill("0.5 N*m")
    ratio.fill("100")
    with page.expect_download() as coming:
        page.get_by_role("button", name="Download (YAML)").click()
    coming.value.save_as(tmp_path / "my.yaml")
    assert (tmp_path / "my.yaml").read_text() == sheet_text(
        {"holding_torque": "0.5 N*m", "ratio": "100"}
    )[0]
    ratio.press("Enter")
    api.expect(page.locator("#title")).to_have_text("my drive")
    api.expect(page.locator(".field[data-key='motor.winding_resistance'] .tag")).to_have_text(
        "assumed"
    )
    write(page, "record.settle", "1 s")
    write(page, "record.duration", "4 s")
    page.get_by_role("button", name="Rank", exact=True).click()
    first = page.locator("#sheet td[data-key='verdict']").first
    api.expect(first).to_contain_text(RANKED, timeout=240_000)
    assert page.locator("#sheet details").first.locator("tbody tr").count() == 15
    page.reload()
    page.wait_for_selector("html[data-ready]")
    api.expect(torque).to_have_value("0.5 N*m")
    api.expect(first).to_contain_text(RANKED)
    api.expect(field(page, "record.settle")).to_have_value("1 s")
    page.set_viewport_size({"width": 390, "height": 844})
    until(page, "document.documentElement.scrollWidth <= 390")
