"""What it does to intervals that lines share the gain error of a measuring chain, and that the
identification is told so.

``python benchmarks/chain_error.py [--draws N] [--seed N] [--gain PART] [--width HZ]``

Each drive is state 1's with a detent torque, a third harmonic of the flux linkage and a clock that
are drawn. Its lines at 0.6 and 0.3 A come from one measuring
chain, whose gain errs by PART, smoothly over WIDTH (white noise through a Gaussian filter), and are
wrong by what ``MODEL_ERROR`` states besides. Three statements of these errors are compared on the
same lines: that there is no chain's, that each line errs independently by PART, and what is so.
One local fit from the truth each, with its linearised intervals of 95 %. In brackets are 95 %
confidence limits of each share (Clopper and Pearson). Nothing is asserted.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from intervals import wrong_figures
from scipy.stats import binomtest
from two_currents import CURRENTS, DETENT, DURATION, FLUX, NOISE, RATE, start

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.model.expected import expected_lines
from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence, observations
from microvib.studies.identify import MODEL_ERROR, ErrorModel, parse_fit
from microvib.studies.identify.fit import without_start_dependence
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.intervals import Z_95
from microvib.studies.identify.problem import Problem
from microvib.studies.identify.search import MAX_DESCENT_STEPS, Descent, linearise_at
from microvib.units import Si

KEYS = (DETENT, FLUX)
RANGES = {DETENT: (4e-3, 12e-3), FLUX: (0.01, 0.04)}
"""Between which they are drawn, evenly [N m, part of K_m]."""
SPACING = 0.05
"""Of the frequencies at which a chain's gain is drawn [Hz]."""
Tests = list[tuple[Evidence, dict[str, object]]]


def smooth_errors(width: float, random: np.random.Generator) -> np.ndarray:
    """Gain errors (n,) of unit standard deviation at multiples of SPACING, alike within ``width`` [Hz]."""
    count, sigma = round(0.5 * RATE / SPACING), width / math.sqrt(2.0) / SPACING
    reach = math.ceil(5.0 * sigma)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    white = random.normal(size=count + 2 * reach)
    return np.convolve(white, taps / np.linalg.norm(taps), "valid")


def measured(
    model: Scenario, truth: Scenario, log_gain: np.ndarray, random: np.random.Generator
) -> Evidence:
    """Lines of a recording of ``truth``, as an identification with ``model`` gets them."""
    torque = mv.simulate(truth, channels=("T_d",))["T_d"]
    table = lines_of_samples(
        torque + random.normal(0.0, NOISE, torque.size), RATE, model, measured=True
    )
    found = wrong_figures(observations(table), model, random)
    evidence = Evidence("made", found, table.clock_ratio, DURATION, RATE)
    at = {x.name: x.frequency for x in expected_lines(truth, Si(math.inf), evidence.harmonics)}
    shown = tuple(
        replace(o, value=o.value * math.exp(log_gain[round(at[o.line] / SPACING)]))
        if o.form == "amplitude"
        else o
        for o in found
    )
    return replace(evidence, observations=shown)


def drawn(
    model: Scenario, gain: float, width: float, random: np.random.Generator
) -> tuple[dict[str, float], Tests]:
    """What was drawn, and its lines at both currents through one chain."""
    truth = {key: float(random.uniform(*ends)) for key, ends in RANGES.items()}
    clock = {"tracking.clock_ratio": random.uniform(0.995, 1.005)}
    log_gain = gain * smooth_errors(width, random)
    tests: Tests = []
    for current in CURRENTS:
        own: dict[str, object] = {"motor.current": f"{current} A"}
        real = model.with_(own).with_si({**truth, **clock})
        tests.append((measured(model.with_(own), real, log_gain, random), own))
    return truth, tests


def fitted(
    model: Scenario, truth: dict[str, float], tests: Tests, trust: ErrorModel
) -> tuple[bool, np.ndarray]:
    """Whether a local fit from the truth explains the lines; errors and standard errors, (keys, 2)."""
    keys = [parse_fit(model, key) for key in KEYS]
    kept, _ = without_start_dependence(tests, model, keys, trust)
    problem = Problem(model, kept, keys, trust)
    best = Descent(problem, problem.point(truth)).run(MAX_DESCENT_STEPS)
    spread = linearise_at(problem, best).spread
    rows = []
    for key, value, one in zip(keys, problem.values(best.x), spread, strict=True):
        rows.append((value - truth[key.key], key.slope(value) * float(one)))
    return goodness(problem, best.r).explained, np.array(rows)


def tell(said: str, explained: Sequence[bool], rows: np.ndarray) -> None:
    """Print what came of one statement of the errors, from ``rows`` (draws, keys, 2)."""
    print(f"{said}: {sum(explained)} of {len(explained)} explained")
    for k, key in enumerate(KEYS):
        error, sd = rows[:, k].T
        inside, count = int(np.sum(np.abs(error) <= Z_95 * sd)), len(error)
        low, high = binomtest(inside, count).proportion_ci(0.95)
        print(
            f"    {key}: truth in the interval {inside} of {count} ({100 * low:.0f} to {100 * high:.0f} %),"
            f" errors over standard errors {np.sqrt(np.mean((error / sd) ** 2)):.2f} RMS,"
            f" standard error {np.median(sd):.3g}"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw, fit, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=60, help="drives (default: 60)")
    parser.add_argument("--seed", type=int, default=1, help="of drives and chains (default: 1)")
    parser.add_argument(
        "--gain", type=float, default=0.02, help="the chain's error (default: 0.02)"
    )
    parser.add_argument("--width", type=float, default=2.0, help="in Hz (default: 2)")
    options = parser.parse_args(arguments)
    statements = {
        "no chain's error stated": ErrorModel(MODEL_ERROR),
        "as a model error of each line": ErrorModel(math.hypot(MODEL_ERROR, options.gain)),
        "as the chain's": ErrorModel(MODEL_ERROR, chain=options.gain, chain_width=options.width),
    }
    model, found = start(), {said: ([], []) for said in statements}  # type: ignore[var-annotated]
    for k in range(options.draws):
        random = np.random.default_rng([options.seed, k])
        truth, tests = drawn(model, options.gain, options.width, random)
        for said, trust in statements.items():
            explained, rows = fitted(model, truth, tests, trust)
            found[said][0].append(explained)
            found[said][1].append(rows)
    for said, (explained, each) in found.items():
        tell(said, explained, np.array(each))


if __name__ == "__main__":
    main()
