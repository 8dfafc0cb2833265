"""The paper's own figures beside ours: Tables 5 and 6 for test state 1."""

from __future__ import annotations

import re
from dataclasses import dataclass

from microvib.io.tables import PAPER_LINES, read_table
from microvib.model.scenario import Scenario
from microvib.signals.line_table import LineTable


@dataclass(frozen=True)
class PaperRow:
    """One line of Tables 5 and 6, with our nearest-bin figure, which is what the paper's estimator would read."""

    line: str
    test_hz: float
    paper_hz: float
    ours_hz: float
    test_n_m: float
    paper_n_m: float
    ours_n_m: float

    @property
    def paper_error(self) -> float:
        """Relative error of the paper's simulation against its test."""
        return self.paper_n_m / self.test_n_m - 1.0

    @property
    def our_error(self) -> float:
        """Relative error of our nearest-bin figure against the test."""
        return self.ours_n_m / self.test_n_m - 1.0


def paper_state(scenario: Scenario) -> int | None:
    """Number of the paper's test state that a scenario says it is, by its title; None for others."""
    match = re.search(r"\btest state ([1-5])\b", scenario.title)
    return int(match.group(1)) if match else None


def comparison_worth(scenario: Scenario) -> str:
    """What a comparison with the test is worth: whether parameters were identified from it, are assumed, or changed since."""
    texts = {scenario.source_of(key) for key, _, _ in scenario.entries()}
    if any(text == "set by the user" for text in texts):
        return "some parameters were changed by the user: neither calibrated nor a prediction of the catalog's drive"
    if any(text.startswith("identified from the test's lines") for text in texts):
        return "calibrated, not predicted: parameters were identified from these very figures"
    return "with assumed parameters: neither calibrated nor a prediction that the test could confirm"


def compare_with_paper(scenario: Scenario, table: LineTable) -> list[PaperRow]:
    """Tables 5 and 6 beside our lines; empty unless the scenario is test state 1, the only one that the paper tabulates."""
    f_d = scenario.driving_frequency
    if paper_state(scenario) != 1 or f_d is None or not 50.0 < f_d < 56.0:
        return []
    frequencies = {row["line"]: row for row in read_table("table5_line_frequencies")}
    rows = []
    for row in read_table("table6_line_amplitudes"):
        name = PAPER_LINES[row["line"]]
        if name not in {line.line for line in table} or not table[name].amplitude_n_m > 0.0:
            continue
        line, hz = table[name], frequencies[row["line"]]
        figures = [(float(hz[f"{who}_hz"]), float(row[f"{who}_n_m"])) for who in ("test", "simulation")]
        frequency, amplitude = zip(*figures, (line.bin_frequency_hz, line.bin_amplitude_n_m), strict=True)
        rows.append(PaperRow(name, *frequency, *amplitude))
    return rows
