"""What it does to intervals that lines share the gain error of a measuring chain, and that the
identification is told so.

``python benchmarks/chain_error.py [--draws N] [--seed N] [--gain PART] [--width HZ]
[--repeated] [--linear]``

Each drive is state 1's with a detent torque, a third harmonic of the flux linkage and a clock that
are drawn: what tells them apart is how lines at 0.6 and 0.3 A compare. With ``--repeated`` the array's
rigid inertia and the rotor's viscous friction are drawn in their place, which the sizes of lines tell,
and four recordings are all at 0.6 A. All lines come from one measuring chain, whose gain
errs by PART, smoothly over WIDTH (white noise through a Gaussian filter), and are wrong by what
``MODEL_ERROR`` states besides. Three statements of these errors are compared on the same lines: that
there is no chain's, that each line errs independently by PART, and what is so. One local fit from
the truth each, with its linearised intervals of 95 %. In brackets are 95 % confidence limits of each
share (Clopper and Pearson). With ``--linear`` nothing is fitted: beside the standard error that each
statement leads to stands what the estimate's own is over it, by the slopes of all figures at one
drive. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

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

COMPARED = {DETENT: (4e-3, 12e-3), FLUX: (0.01, 0.04)}
SIZES = {"array.rigid_inertia": (0.11, 0.17), "motor.friction.viscous": (0.011, 0.019)}
"""What is drawn, and between which ends, evenly [N m, part of K_m; kg m^2, N m s/rad]."""
REPEATED = (0.6, 0.6, 0.6, 0.6)
SPACING = 0.05
"""Of the frequencies at which a chain's gain is drawn [Hz]."""
Tests = list[tuple[Evidence, dict[str, object]]]


class Chain(NamedTuple):
    """Gain error of a measuring chain: standard deviation, and within which distance it is alike [Hz]."""

    gain: float
    width: float


def log_gains(chain: Chain, random: np.random.Generator) -> np.ndarray:
    """Logarithms of a chain's gain (n,) at multiples of SPACING."""
    count, sigma = round(0.5 * RATE / SPACING), chain.width / math.sqrt(2.0) / SPACING
    reach = math.ceil(5.0 * sigma)
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    white = random.normal(size=count + 2 * reach)
    return np.asarray(chain.gain * np.convolve(white, taps / np.linalg.norm(taps), "valid"))


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
    model: Scenario, repeated: bool, chain: Chain, random: np.random.Generator
) -> tuple[dict[str, float], Tests]:
    """What was drawn, and its lines at the currents through one chain."""
    ranges = SIZES if repeated else COMPARED
    truth = {key: float(random.uniform(*ends)) for key, ends in ranges.items()}
    clock = {"tracking.clock_ratio": random.uniform(0.995, 1.005)}
    log_gain, tests = log_gains(chain, random), []
    for current in REPEATED if repeated else CURRENTS:
        own: dict[str, object] = {"motor.current": f"{current} A"}
        real = model.with_(own).with_si({**truth, **clock})
        tests.append((measured(model.with_(own), real, log_gain, random), own))
    return truth, tests


def fitted(
    model: Scenario, truth: dict[str, float], tests: Tests, trust: ErrorModel
) -> tuple[bool, np.ndarray]:
    """Whether a local fit from the truth explains the lines; errors and standard errors, (keys, 2)."""
    keys = [parse_fit(model, key) for key in truth]
    kept, _ = without_start_dependence(tests, model, keys, trust)
    problem = Problem(model, kept, keys, trust)
    best = Descent(problem, problem.point(truth)).run(MAX_DESCENT_STEPS)
    spread = linearise_at(problem, best).spread
    rows = []
    for key, value, one in zip(keys, problem.values(best.x), spread, strict=True):
        rows.append((value - truth[key.key], key.slope(value) * float(one)))
    return goodness(problem, best.r).explained, np.array(rows)


def by_slopes(model: Scenario, repeated: bool, statements: dict[str, ErrorModel]) -> None:
    """Print standard errors by the slopes at one drive: as stated, and what those of the estimates are
    over these where the last statement is so.
    """
    truth, tests = drawn(model, repeated, Chain(0.0, 1.0), np.random.default_rng(0))
    keys = [parse_fit(model, key) for key in truth]
    problems = {}
    for said, trust in statements.items():
        kept, _ = without_start_dependence(tests, model, keys, trust)
        problems[said] = Problem(model, kept, keys, trust)
    *_, so = problems.values()
    slopes, actual = slopes_at(so, so.point(truth)), covariance(so)
    for said, problem in problems.items():
        weighted = np.linalg.solve(covariance(problem), slopes)
        stated = np.linalg.inv(slopes.T @ weighted)
        own = stated @ weighted.T @ actual @ weighted @ stated
        for k, key in enumerate(keys):
            error = abs(key.slope(truth[key.key])) * math.sqrt(stated[k, k])
            ratio = math.sqrt(own[k, k] / stated[k, k])
            print(
                f"{said}: {key.key}: stated standard error {error:.3g}, its own over that {ratio:.2f}"
            )


def slopes_at(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Slopes of the figures' differences over the coordinates at ``x``, (figures, keys)."""
    step = 0.01 * np.minimum(problem.spans, 1.0)
    points = [x + sign * row for row in np.diag(step) for sign in (1.0, -1.0)]
    differences = np.array([problem.differences(problem.lines(one)) for one in points])
    return np.asarray(((differences[::2] - differences[1::2]) / (2.0 * step[:, None])).T)


def covariance(problem: Problem) -> np.ndarray:
    """Covariance of the figures' differences, (n, n)."""
    return np.asarray(np.diag(problem.weights**2) + problem.shared @ problem.shared.T)


def tell(said: str, keys: Sequence[str], explained: Sequence[bool], rows: np.ndarray) -> None:
    """Print what came of one statement of the errors, from ``rows`` (draws, keys, 2)."""
    print(f"{said}: {sum(explained)} of {len(explained)} explained")
    for k, key in enumerate(keys):
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
    parser.add_argument("--repeated", action="store_true", help="at one current")
    parser.add_argument("--linear", action="store_true", help="by slopes, without draws")
    options = parser.parse_args(arguments)
    chain = Chain(options.gain, options.width)
    statements = {
        "no chain's error stated": ErrorModel(MODEL_ERROR),
        "as a model error of each line": ErrorModel(math.hypot(MODEL_ERROR, chain.gain)),
        "as the chain's": ErrorModel(MODEL_ERROR, chain=chain.gain, chain_width=chain.width),
    }
    if options.linear:
        by_slopes(start(), options.repeated, statements)
        return
    model, found = start(), {said: ([], []) for said in statements}  # type: ignore[var-annotated]
    for k in range(options.draws):
        random = np.random.default_rng([options.seed, k])
        truth, tests = drawn(model, options.repeated, chain, random)
        for said, trust in statements.items():
            explained, rows = fitted(model, truth, tests, trust)
            found[said][0].append(explained)
            found[said][1].append(rows)
    for said, (explained, each) in found.items():
        tell(said, list(SIZES if options.repeated else COMPARED), explained, np.array(each))


if __name__ == "__main__":
    main()
