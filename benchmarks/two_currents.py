"""How often intervals of detent torque, flux harmonic and its phase hold the truth, where all three
are identified from recordings at two currents that another code made.

``python benchmarks/two_currents.py [--draws N] [--seed N] [--only N ...] [--local]
[--one-current] [--results FILE]``

Each drive is state 1's with a detent torque, a third harmonic of the flux linkage, its phase and a
clock that are drawn. Its motion is that of ``benchmarks/open/integrator.py``, which shares no code
with microvib, at two currents, with noise, and figures of its lines are wrong by random parts of
the size that the identification states for them (as in ``intervals.py``). The search starts from
one scenario, whatever was drawn. With ``--local`` there is no search: one local fit from what was
drawn, with its linearised intervals, at a tenth of the time. With ``--one-current`` both recordings are at the same current:
then none must be called identifiable. With ``--results`` a run that was interrupted goes on. In
brackets are 95 % confidence limits of each share (Clopper and Pearson). Nothing is asserted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from intervals import counts, wrong_figures
from scipy.signal import firwin, oaconvolve
from scipy.stats import binomtest

import microvib as mv
from microvib.analysis.lines import lines_of_samples
from microvib.model.scenario import Scenario
from microvib.studies.evidence import Evidence, observations
from microvib.studies.identify import MODEL_ERROR, ErrorModel, identify, parse_fit
from microvib.studies.identify.fit import without_start_dependence
from microvib.studies.identify.goodness import goodness
from microvib.studies.identify.intervals import Z_95
from microvib.studies.identify.problem import Problem
from microvib.studies.identify.search import MAX_DESCENT_STEPS, Descent, linearise_at

sys.path.insert(0, str(Path(__file__).parent / "open"))
from cases import references
from integrator import Parameters, integrate

DETENT, FLUX, PHASE = (
    "motor.detent_torque",
    "motor.flux_harmonics.0.amplitude",
    "motor.flux_harmonics.0.phase",
)
KEYS = (DETENT, FLUX, PHASE)
DETENT_RANGE, FLUX_RANGE = (2e-3, 12e-3), (0.005, 0.04)
"""Between which they are drawn, evenly by their logarithm [N m, part of K_m]; the phase is any."""
CURRENTS = (0.6, 0.3)
NOISE = 2e-5
"""Standard deviation of each sample [N m]."""
SETTLE, DURATION, RATE = 30.0, 8.0, 4096.0
DENSE = 8
"""Interval means in a sample, of which a low-pass makes it."""
STARTS = 16
"""Points at which each search begins."""


def start() -> Scenario:
    """The scenario from which each search starts."""
    record = {"record.settle": SETTLE, "record.duration": DURATION, "record.sample_rate": RATE}
    harmonic = {"order": 3, "amplitude": 0.01, "phase": 0.0}
    own = {DETENT: 5e-3, "motor.flux_harmonics": [harmonic], "tracking.clock_ratio": 1.0}
    return mv.load_scenario("state-1").with_si(own | record)


def drive(scenario: Scenario, current: float, flux: tuple[float, float]) -> Parameters:
    """The integrator's drive, of a scenario with one array mode and a third flux harmonic."""
    motor, friction, ring = scenario.motor, scenario.friction, scenario.friction.slip_ring
    assert ring is not None
    assert scenario.array.rigid_inertia is not None
    (mode,) = scenario.array.modes
    contacts = ring.contact_pairs * ring.contact_force * ring.friction_factor * ring.ring_radius
    omega = math.tau * mode.frequency
    assert isinstance(scenario.reducer.stiffness, float)
    return Parameters(
        z=float(motor.rotor_teeth), K_m=motor.torque_constant, K_d=motor.detent_torque,
        R=motor.winding_resistance, L=motor.winding_inductance,
        J_m=motor.rotor_inertia + scenario.reducer.wave_generator_inertia,
        rotor_viscous=motor.friction.viscous, flux=np.array([[3.0, *flux]]),
        K_P=scenario.driver.proportional_gain, K_I=scenario.driver.integral_gain,
        h=scenario.reducer.ratio, K_g=scenario.reducer.stiffness, C_g=scenario.reducer.damping,
        sliding=friction.coulomb + contacts, excess=friction.breakaway - friction.coulomb,
        stribeck_rate=friction.stribeck_rate, viscous=friction.viscous, J_h=scenario.array.rigid_inertia,
        H=np.array([math.sqrt(scenario.array.inertia - scenario.array.rigid_inertia)]),
        Lambda=np.array([omega**2]), D=np.array([2.0 * mode.damping * omega]),
    )  # fmt: skip


def torque(scenario: Scenario, current: float, flux: tuple[float, float]) -> np.ndarray:
    """Disturbance torque (n,) [N m] of the integrator's drive at a current [A]."""
    errors = {"offset_a": 0.0, "offset_b": 0.0, "gain_b": 0.0, "quadrature": 0.0, "dac_bits": None}
    rows = references(current, scenario.driver.microsteps, errors)
    step, margin = 1.0 / (DENSE * RATE), 64
    count = round(DURATION * RATE) + 2 * margin
    edges = SETTLE - (margin * DENSE + 0.5) * step + step * np.arange(count * DENSE + 1)
    clock = scenario.driving_frequency
    assert clock is not None
    momentum, _, lost = integrate(drive(scenario, current, flux), rows, clock, edges)
    assert not lost
    low_pass = firwin(32 * DENSE + 1, 1.0 / DENSE, window=("kaiser", 10.0))
    passed = oaconvolve(-np.diff(momentum) / step, low_pass, "same")[::DENSE]
    return np.asarray(passed[margin : count - margin])


def evidence(model: Scenario, x: np.ndarray, random: np.random.Generator) -> Evidence:
    """Lines of a recording (n,) [N m] as the identification gets them."""
    noisy = x + random.normal(0.0, NOISE, x.size)
    table = lines_of_samples(noisy, RATE, model, measured=True)
    found = wrong_figures(observations(table), model, random)
    return Evidence("made", found, table.clock_ratio, DURATION, RATE)


def one(
    model: Scenario, currents: Sequence[float], random: np.random.Generator, local: bool
) -> dict[str, Any]:
    """One drive, its recordings and what is identified of them."""
    low, high = np.log(DETENT_RANGE), np.log(FLUX_RANGE)
    detent, part = math.exp(random.uniform(*low)), math.exp(random.uniform(*high))
    phase = float(random.uniform(-math.pi, math.pi))
    clock = {"tracking.clock_ratio": random.uniform(0.995, 1.005)}
    real = model.with_si({DETENT: detent} | clock)
    tests: Tests = []
    for current in currents:
        own: dict[str, object] = {"motor.current": f"{current} A"}
        x = torque(real, current, (part, phase))
        tests.append((evidence(model.with_(own), x, random), own))
    truth, began = dict(zip(KEYS, (detent, part, phase), strict=True)), time.perf_counter()
    found = fitted_from(truth, model, tests) if local else searched(truth, model, tests)
    return found | {"seconds": time.perf_counter() - began}


Tests = list[tuple[Evidence, dict[str, object]]]


def searched(truth: dict[str, float], model: Scenario, tests: Tests) -> dict[str, Any]:
    """The whole identification."""
    fit = identify(model, tests, KEYS, starts=STARTS, finishes=1)
    told = {
        e.key: {
            "truth": near(truth[e.key], e.estimate, e.key), "estimate": e.estimate,
            "standard_error": e.standard_error, "interval": e.interval,
            "identifiable": e.identifiable, "profiled": e.profiled, "verdict": e.verdict,
        }
        for e in fit.estimates
    }  # fmt: skip
    said = {"explained": fit.goodness.explained, "ratio": fit.goodness.ratio}
    return said | {"converged": fit.converged, "keys": told}


def fitted_from(truth: dict[str, float], model: Scenario, tests: Tests) -> dict[str, Any]:
    """A local fit from the truth, with linearised intervals."""
    keys, trust = [parse_fit(model, key) for key in KEYS], ErrorModel(MODEL_ERROR)
    kept, _ = without_start_dependence(tests, model, keys, trust)
    problem = Problem(model, kept, keys, trust)
    best = Descent(problem, problem.point(truth)).run(MAX_DESCENT_STEPS)
    local, fit, told = linearise_at(problem, best), goodness(problem, best.r), {}
    each = zip(keys, problem.values(best.x), local.spread, strict=True)
    for key, value, spread in each:
        error = key.slope(value) * float(spread)
        told[key.key] = {
            "truth": near(truth[key.key], value, key.key), "estimate": value, "standard_error": error,
            "interval": (value - Z_95 * error, value + Z_95 * error),
            "identifiable": fit.explained, "profiled": False, "verdict": "linearised",
        }  # fmt: skip
    return {"explained": fit.explained, "ratio": fit.ratio, "converged": True, "keys": told}


def near(truth: float, estimate: float, key: str) -> float:
    """The truth; of a phase the one that is nearest to the estimate, whole turns away."""
    if key == PHASE:
        return estimate + math.remainder(truth - estimate, math.tau)
    return truth


def counted(row: dict[str, Any]) -> dict[str, Any]:
    """A drive's results with the phase's truth in its interval, where one of those that are whole
    turns apart is there: the interval of a phase that is not told is wider than a turn about any.
    """
    told = row["keys"][PHASE]
    low, high = told["interval"]
    turned = told["truth"] + math.tau * math.ceil((low - told["truth"]) / math.tau)
    if low <= told["truth"] <= high or not math.isfinite(turned) or turned > high:
        return row
    return row | {"keys": row["keys"] | {PHASE: told | {"truth": turned}}}


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, identify, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100, help="drives (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="of drives and noise (default: 1)")
    parser.add_argument("--local", action="store_true", help="one local fit from the truth each")
    parser.add_argument("--only", type=int, nargs="*", help="draws of these numbers, from 0")
    parser.add_argument("--one-current", action="store_true", help="both at the same current")
    parser.add_argument(
        "--results",
        type=Path,
        help="file to add each drive to; those that it has are not made again",
    )
    options = parser.parse_args(arguments)
    currents = (CURRENTS[0], CURRENTS[0] if options.one_current else CURRENTS[1])
    asked = {"seed": options.seed, "currents": list(currents), "local": options.local}
    lines = []
    if options.results and options.results.exists():
        lines = options.results.read_text().splitlines()
    known = {row["draw"]: row for line in lines if (row := json.loads(line))["of"] == asked}
    model = start()
    draws = options.only or range(options.draws)
    for k in draws:
        if k not in known:
            random = np.random.default_rng([options.seed, k])
            known[k] = {"of": asked, "draw": k, **one(model, currents, random, options.local)}
            if options.results:
                with options.results.open("a") as file:
                    file.write(json.dumps(known[k]) + "\n")
        print(f"drive {k}, {known[k]['seconds']:.0f} s", file=sys.stderr)
    for what, (n, of) in counts([counted(known[k]) for k in draws]).items():
        low, high = binomtest(n, of).proportion_ci(0.95) if of else (math.nan, math.nan)
        print(f"{n:4d} of {of:4d}  {what} ({100.0 * low:.0f} to {100.0 * high:.0f} %)")


if __name__ == "__main__":
    main()
