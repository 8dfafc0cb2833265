"""Names of points in pictures, and tables of the terminal: nothing lies on or runs into anything else."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np

import microvib as mv
from microvib.reports import sheets
from microvib.reports.budget import draw_budget
from microvib.reports.comparison import comparison_outcome
from microvib.reports.outcome import terminal_text
from microvib.studies.compare import compare
from microvib.text_tables import text_table

CRAFT = Path(__file__).parents[1] / "examples" / "spacecraft.yaml"
REQUIREMENT = """
requirements:
  - name: curve
    axis: x
    curve: [{frequency: 0.1 Hz, amplitude: 1 nrad}, {frequency: 1000 Hz, amplitude: 1 nrad}]
"""


def test_names_of_points_keep_clear_of_each_other_and_the_first_is_there() -> None:
    figure, ax = sheets.one_axes(3.0)
    ax.set(xlim=(0.0, 760.0), ylim=(1e-3, 600.0), yscale="log")
    points = [(53.0 * k, 3.0, f"drive_{k}\n{53.0 * k:.4g} Hz", k == 13) for k in range(1, 14)]
    said = sheets.name_points(ax, points[::-1])
    assert said[0] == points[-1][2]
    assert 4 <= len(said) < 13
    figure.canvas.draw()
    turn = np.radians(-35.0)
    along = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    boxes = []
    for text in ax.texts:
        text.set_rotation(0.0)
        wide = text.get_window_extent()
        low = along @ ax.transData.transform(text.xy)
        boxes.append((low, low + np.array([wide.width, wide.height])))
    for k, (low, high) in enumerate(boxes):
        assert not any(np.all(low < b) and np.all(a < high) for a, b in boxes[:k])


def test_a_budget_names_the_line_that_fails_its_curve(tmp_path: Path) -> None:
    path = tmp_path / "requirement.yaml"
    path.write_text(REQUIREMENT)
    scenario = mv.load_scenario(CRAFT).with_(
        {"record.start": "steady", "record.settle": "0 s", "record.duration": "4 s"}
    )
    budget = mv.pointing_budget(scenario, requirements=path)
    failing = [one for one in budget.judged if one.verdict == "fail"]
    assert failing
    assert failing[0].ranking
    names = draw_budget(budget).axes[0].texts
    assert names[0].get_text().split("\n")[0] == failing[0].ranking[0].line
    assert names[0].get_fontweight() == "bold"


def test_columns_never_run_together_however_long_a_cell_is() -> None:
    rows = [["a_name_that_is_much_longer_than_others", "1.23456789012345"], ["b", "2"]]
    text = text_table(["line", "Hz"], rows, left=1)
    assert [re.split(r" {2,}", line) for line in text.splitlines()] == [["line", "Hz"], *rows]


def test_a_comparison_keeps_a_long_name_from_its_figures() -> None:
    state = mv.load_scenario("state-1").with_({"record.settle": "1 s", "record.duration": "4 s"})
    a, b, rows = (lambda c: (c.a, c.b, c.rows))(compare(state, mv.open_source("state-1:measured")))
    name = "an_unexpected_line_of_the_other_wing"
    rows = [dataclasses.replace(rows[0], line=name), *rows[1:]]
    text = terminal_text(comparison_outcome(a, b, rows))
    assert re.search(rf"^{name}  +\d", text, re.MULTILINE)
