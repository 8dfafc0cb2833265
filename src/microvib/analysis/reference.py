"""Lines of a run beside the reference lines of its scenario, and what the comparison is worth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from microvib.model.reference import Reference
from microvib.model.scenario import USER_SOURCE, Scenario
from microvib.results import DIFFERENCE, TORQUE, Column, Measure
from microvib.signals.line_table import Line, LineTable

SAME_LINE = 0.06
"""Relative difference of frequencies within which a line of a run is the reference's."""
_FREQUENCY = Measure("Hz", form=".7g")


@dataclass(frozen=True)
class ReferenceRow:
    """One reference line, as measured and by the publication's own model, and that of a run."""

    line: Annotated[str, Column("line", "line")]
    measured_frequency: Annotated[float, Column("measured_hz", "measured", _FREQUENCY)]
    model_frequency: Annotated[float, Column("model_hz", "model", _FREQUENCY)]
    run_frequency: Annotated[float, Column("run_hz", "this run", _FREQUENCY)]
    measured_amplitude: Annotated[float, Column("measured_n_m", "measured", TORQUE)]
    model_amplitude: Annotated[float, Column("model_n_m", "model", TORQUE)]
    run_amplitude: Annotated[float, Column("run_n_m", "this run", TORQUE)]

    @property
    def model_error(
        self,
    ) -> Annotated[float, Column("model_error", "model over measured", DIFFERENCE)]:
        """Relative error of the publication's model against the measured amplitude."""
        return self.model_amplitude / self.measured_amplitude - 1.0

    @property
    def run_error(
        self,
    ) -> Annotated[float, Column("run_error", "this run over measured", DIFFERENCE)]:
        """Relative error of the run against the measured amplitude."""
        return self.run_amplitude / self.measured_amplitude - 1.0


def compare_with_reference(scenario: Scenario, table: LineTable) -> list[ReferenceRow]:
    """Reference lines of the scenario beside those of a run that has them at the same place.

    A run's frequency and amplitude are by the reference's own estimator. Empty where the scenario
    has no reference lines, or where it runs at another rate.
    """
    reference = scenario.reference
    if reference is None:
        return []
    known = {line.name: line for line in table}
    rows = []
    for one in reference.lines:
        line = known.get(one.line)
        if line is None or not line.amplitude > 0.0:
            continue
        if abs(line.place / one.frequency - 1.0) > SAME_LINE:
            continue
        run_frequency, run_amplitude = _by_estimator(line, reference)
        rows.append(
            ReferenceRow(
                one.line,
                one.frequency,
                _known(one.model_frequency),
                run_frequency,
                one.amplitude,
                _known(one.model_amplitude),
                run_amplitude,
            )
        )
    return rows


def comparison_worth(scenario: Scenario) -> str:
    """Status of a comparison with the reference lines: whether parameters were identified from
    them, are assumed, or changed since.
    """
    texts = {
        scenario.source_of(key)
        for key, _, _ in scenario.entries()
        if key.split(".")[0] not in ("record", "solver")
    }
    if USER_SOURCE in texts:
        return "some parameters were changed by the user: neither calibrated nor a prediction of the catalog's drive"
    if is_calibrated(scenario):
        return "calibrated, not predicted: parameters were identified from these same measurements"
    return "assumed parameters: neither calibrated nor a prediction that the test can confirm"


def is_calibrated(scenario: Scenario) -> bool:
    """Whether parameters were identified from the reference lines themselves."""
    reference = scenario.reference
    return reference is not None and any(
        text.startswith("identified") and reference.source in text
        for text in scenario.sources.values()
    )


def estimator_text(reference: Reference) -> str:
    """How amplitudes of the reference lines were estimated."""
    if reference.estimator == "nearest bin":
        return "nearest bin, rectangular window"
    return "fitted lines"


def _by_estimator(line: Line, reference: Reference) -> tuple[float, float]:
    if reference.estimator == "nearest bin":
        return line.bin_frequency, line.bin_amplitude
    return line.frequency, line.amplitude


def _known(value: float | None) -> float:
    if value is None:
        return math.nan
    return value
