"""Hints on effects that a fitted model lacks: torque noise, a motion that repeats after several microsteps,
rounding of references.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from microvib.model.line_names import FULL_STEP, LineName
from microvib.model.scenario import Scenario
from microvib.signals.line_table import DETECTION_RATIO
from microvib.studies.evidence import SUBHARMONICS, Evidence, Simulated, subharmonic_amplitudes
from microvib.studies.identify.goodness import Deviation

MIN_SUBHARMONIC_RATIO, MIN_ASYMMETRY_RATIO = 0.02, 4.0
"""Part of the driving line from which a line at a part of its frequency counts; times of the
other's, from which one lacks it.
"""
MIN_EXCESS_RATIO, MIN_FULL_STEP_ORDER = 10.0, 3
"""Times of the model's line, from which one of the full step stands above it, and the first order
that counts.
"""

MIN_NOISE_RATIO = 0.005
"""Root mean square of torque noise up to UP_TO over the breakaway torque, from which it frees what
sticks and so moves lines.
"""
NOISE_BANDWIDTH = 200.0
"""[Hz]."""


def noise_may_release_stiction(one: Evidence, scenario: Scenario) -> bool:
    """Whether torque noise that the scenario has not, and the floor of its recording may be, would
    move its lines.
    """
    return (
        math.sqrt(NOISE_BANDWIDTH * one.noise)
        > MIN_NOISE_RATIO * scenario.friction.breakaway_torque
        > 0.0
    )


def model_deficiency_hints(
    tests: Sequence[tuple[Evidence, Scenario]],
    after: Sequence[Simulated],
    deviations: Sequence[Deviation],
) -> tuple[str, ...]:
    """Sentences on what the model, whose lines of each test are ``after``, seems to lack."""
    found = [
        sentence
        for each in zip(tests, after, strict=True)
        for sentence in period_mismatch_warnings(*each)
    ]
    for one, scenario in tests:
        if noise_may_release_stiction(one, scenario):
            found.append(f"{one.name}: {_of_noise(one.noise)}")
    lines = {line.name: line.frequency for simulated in after for line in simulated.table}
    rounded = sorted(
        name
        for name in _far_above_model(deviations)
        if _order(name) >= MIN_FULL_STEP_ORDER and not _is_subharmonic(lines[name], tests)
    )
    if rounded and any(scenario.driver.imperfections.dac_bits is None for _, scenario in tests):
        found.append(
            f"{', '.join(rounded)}: more than {MIN_EXCESS_RATIO:g} times the model's, as where a"
            " driver rounds its references;"
            " fit driver.imperfections.dac_bits, too, or name it among the effects to select from."
        )
    return tuple(found)


def _far_above_model(deviations: Sequence[Deviation]) -> set[str]:
    """Lines that are many times the model's."""
    return {
        d.line
        for d in deviations
        if d.off and d.form == "amplitude" and d.measured > MIN_EXCESS_RATIO * d.fitted
    }


def _is_subharmonic(frequency: float, tests: Sequence[tuple[Evidence, Scenario]]) -> bool:
    """Whether a frequency [Hz] is where a motion of several microsteps has a line in any test."""
    driving = [scenario.driving_frequency for _, scenario in tests if scenario.driving_frequency]
    parts = (f_d / part for f_d in driving for part in SUBHARMONICS)
    return any(abs(frequency / part - 1.0) < 1e-3 for part in parts)


def _of_noise(density: float) -> str:
    """Hint on torque noise up to a density [N^2 m^2/Hz] that a recording does not rule out."""
    if math.isinf(density):
        return (
            "it is too short to tell whether there is torque noise, which releases stiction and so changes lines: take a longer"
            " record."
        )
    return (
        f"its floor between the lines may be torque noise of some {density:.1g} N^2*m^2/Hz, "
        "which releases stiction and so changes lines: give the scenario friction.torque_noise to start from, and fit"
        " its density."
    )


def _order(name: str) -> int:
    """Order of a line of the full step; 0 of others."""
    line = LineName.parse(name)
    if line.family == FULL_STEP:
        return line.order
    return 0


def _floor(one: Evidence, frequency: float) -> float:
    """Floor of a recording at a frequency [Hz]; 0 of a table."""
    if one.rest is None or one.rest.floor is None or not one.rest.floor.size:
        return 0.0
    return float(np.interp(frequency, one.rest.frequency, one.rest.floor))


def period_mismatch_warnings(
    test: tuple[Evidence, Scenario], simulated: Simulated
) -> Iterator[str]:
    """Sentences where the recording or the model alone repeats after several microsteps."""
    (one, scenario), clock = test, test[1].driving_frequency or 0.0
    model = subharmonic_amplitudes(
        simulated.torque, simulated.sample_rate, scenario.driving_frequency
    )
    for k, (part, word) in enumerate(SUBHARMONICS.items(), 1):
        if (
            not one.parts
            or not model
            or max(one.parts[k], model[k]) < MIN_SUBHARMONIC_RATIO * one.parts[0]
        ):
            continue
        if max(one.parts[k], model[k]) < 2.0 * DETECTION_RATIO * _floor(one, clock / part):
            continue
        if max(one.parts[k], model[k]) > MIN_ASYMMETRY_RATIO * min(one.parts[k], model[k]):
            if one.parts[k] > model[k]:
                mine, other = ("recording", "model")
            else:
                mine, other = ("model", "recording")
            sizes = f"{1e3 * one.parts[k]:.3g} and {1e3 * model[k]:.3g} mN m at 1/{part} of the driving frequency"
            yield (
                f"{one.name}: the {mine}'s motion repeats every {word} microstep, the {other}'s"
                f" does not (both have {sizes});"
                " a search ends among motions of the wrong kind then: start from other values, or"
                " give ranges and more starts."
            )
