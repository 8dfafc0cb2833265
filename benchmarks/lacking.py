"""How often an identification calls figures identifiable that are wrong, where the drive has
something that the model lacks.

``python benchmarks/lacking.py [--recordings N] [--seed N] [--state N] [--only KIND] [--results
FILE]``

Each recording is of a drive whose fitted parameters, rate and clock are drawn, and which has one
thing that the identification's scenario lacks: torque noise, presliding, a supply voltage that
saturates, a third harmonic of the flux linkage, backlash, a resonance of the table, or a low-pass
in the chain. Counted are figures that are called identifiable and are off by more than 5 % and three of their standard
errors. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import bilinear, butter, lfilter

import microvib as mv
from microvib.model.scenario import Scenario
from microvib.studies.evidence import evidence_of, select_evidence
from microvib.studies.identify import Fit, identify
from microvib.testdata.recording import Recording

RATE = 4096.0
"""Sample rate [Hz]."""
NOISE = 5e-6
"""Standard deviation of the samples' noise [N m]."""
FITTED = ("reducer.stiffness", "reducer.damping", "motor.friction.viscous", "array.rigid_inertia")
"""Of which one to three are drawn and fitted; the others have the model's values."""
SPREAD = 0.2
"""Part by which these are off the model's at most."""
ENOUGH, SURE = 0.05, 3.0
"""Relative error, and standard errors, above both of which a figure is wrong."""

Changed = dict[str, object]


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(random.uniform(math.log(low), math.log(high))))


def _nothing(_: np.random.Generator) -> Changed:
    return {}


def _noise(random: np.random.Generator) -> Changed:
    seed = int(random.integers(1, 10_000))
    return {"friction.torque_noise": {"density": _log(random, 1e-10, 1e-6), "seed": seed}}


def _presliding(random: np.random.Generator) -> Changed:
    return {"friction.presliding": {"stiffness": _log(random, 3e3, 3e5)}}


def _saturation(random: np.random.Generator) -> Changed:
    return {"driver.supply_voltage": _log(random, 3.7, 40.0)}


def _flux(random: np.random.Generator) -> Changed:
    size, phase = _log(random, 0.001, 0.03), random.uniform(-math.pi, math.pi)
    return {"motor.flux_harmonics": [{"order": 3, "amplitude": size, "phase": phase}]}


def _backlash(random: np.random.Generator) -> Changed:
    return {"reducer.backlash": _log(random, 1e-7, 3e-5)}


LACKING: dict[str, Callable[[np.random.Generator], Changed]] = {
    "noise": _noise,
    "presliding": _presliding,
    "saturation": _saturation,
    "flux harmonic": _flux,
    "backlash": _backlash,
    "table resonance": _nothing,
    "filter": _nothing,
}
"""What the drive has, in SI units; the last two change what is recorded of it."""


def recorded(kind: str, T_d: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Samples of a torque ``T_d`` (n,) [N m]."""
    if kind == "table resonance":
        omega, damping = 2.0 * math.pi * _log(random, 60.0, 3000.0), _log(random, 0.003, 0.05)
        T_d = lfilter(*bilinear([omega**2], [1.0, 2.0 * damping * omega, omega**2], RATE), T_d)
    if kind == "filter":
        T_d = lfilter(*butter(int(random.integers(1, 5)), _log(random, 60.0, 1500.0), fs=RATE), T_d)
    return np.asarray(T_d + random.normal(0.0, NOISE, T_d.size))


BANDS = (None, "0.5:60 Hz", "0.5:200 Hz")
"""In which lines are fitted to; in turn with all."""


def one(kind: str, state: int, random: np.random.Generator, starts: int) -> dict[str, Any]:
    """One recording and its identification."""
    rate, duration = math.radians(_log(random, 0.01, 0.2)), _log(random, 3.0, 30.0)
    record = {
        "record.settle": _log(random, 5.0, 30.0),
        "record.duration": duration,
        "record.sample_rate": RATE,
    }
    model = mv.load_scenario(f"state-{state}").with_si({"tracking.rate": rate, **record})
    keys = [str(key) for key in random.choice(FITTED, int(random.integers(1, 4)), replace=False)]
    truth = {key: float(model[key]) * random.uniform(1.0 - SPREAD, 1.0 + SPREAD) for key in keys}
    clock = {"tracking.clock_ratio": model.tracking.clock_ratio * random.uniform(0.995, 1.005)}
    has = LACKING[kind](random)
    drive = _without_the_start(kind, model.with_si({**truth, **clock, **has}))
    T_d = mv.simulate(drive, channels=("T_d",))["T_d"]
    samples = recorded(kind, T_d, random)[-model.record.samples :]
    told = {"kind": kind, "has": has, "rate": rate, **record, "truth": truth}
    recording, began = Recording({"Mz": samples}, RATE, {"Mz": "N*m"}, kind), time.perf_counter()
    try:
        band = BANDS[int(random.integers(len(BANDS)))]
        told["band"] = band
        evidence = select_evidence([evidence_of(recording, model)], model, [band] if band else [])
        fit = identify(model, evidence, keys, starts=starts, seed=1)
    except mv.MicrovibError as error:
        return told | {"refused": str(error)}
    return told | _said(fit) | {"seconds": time.perf_counter() - began}


def _without_the_start(kind: str, drive: Scenario) -> Scenario:
    """The drive with a record that begins two seconds earlier, which a filter needs to begin."""
    if kind not in ("table resonance", "filter"):
        return drive
    record = drive.record
    return drive.with_si(
        {"record.settle": record.settle - 2.0, "record.duration": record.duration + 2.0}
    )


def _said(fit: Fit) -> dict[str, Any]:
    keys = {
        e.key: {"estimate": e.estimate, "standard_error": e.standard_error, "identifiable": e.identifiable, "verdict": e.verdict}
        for e in fit.estimates
    }  # fmt: skip
    return {
        "explained": fit.goodness.explained, "ratio": fit.goodness.ratio, "figures": fit.goodness.figures,
        "freedom": fit.goodness.freedom, "converged": fit.converged, "keys": keys, "notes": list(fit.notes),
    }  # fmt: skip


def wrong(row: dict[str, Any]) -> list[str]:
    """Sentences on the identifiable figures that are wrong."""
    found = []
    for key, value in row["truth"].items():
        e = row.get("keys", {}).get(key)
        if e is None or not e["identifiable"]:
            continue
        off = e["estimate"] - value
        if abs(off) > max(ENOUGH * abs(value), SURE * e["standard_error"]):
            found.append(
                f"{key} {100.0 * off / value:+.0f} %, {abs(off) / e['standard_error']:.1f} standard errors"
            )
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, identify, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=40, help="how many (default: 40)")
    parser.add_argument("--seed", type=int, default=1, help="of drives and noise (default: 1)")
    parser.add_argument("--state", type=int, default=1, help="state of the catalog (default: 1)")
    parser.add_argument(
        "--starts", type=int, default=32, help="points of each global search (default: 32)"
    )
    parser.add_argument(
        "--only",
        choices=list(LACKING),
        help="one thing that the model lacks (default: each in turn)",
    )
    parser.add_argument(
        "--results",
        type=Path,
        help="file to add each recording to; those that it has are not made again",
    )
    options = parser.parse_args(arguments)
    asked = {name: getattr(options, name) for name in ("seed", "state", "starts")}
    lines = (
        options.results.read_text().splitlines()
        if options.results and options.results.exists()
        else []
    )
    known = {row["recording"]: row for line in lines if (row := json.loads(line))["of"] == asked}
    kinds, rows = list(LACKING), []
    for k in range(options.recordings):
        kind = kinds[k % len(kinds)]
        if options.only not in (None, kind):
            continue
        if k not in known:
            random = np.random.default_rng([options.seed, k])
            known[k] = {
                "of": asked,
                "recording": k,
                **one(kind, options.state, random, options.starts),
            }
            if options.results:
                with options.results.open("a") as file:
                    file.write(json.dumps(known[k]) + "\n")
        rows.append(known[k])
        print(told(known[k]), file=sys.stderr, flush=True)
    figures = [e for row in rows for e in row.get("keys", {}).values()]
    print(f"{len(rows)} recordings, {sum('refused' in row for row in rows)} refused")
    print(f"{sum(row.get('explained', False) for row in rows)} explained")
    print(f"{sum(e['identifiable'] for e in figures)} of {len(figures)} figures identifiable")
    print(
        f"{sum(len(wrong(row)) for row in rows)} of these off by more than 5 % and three standard errors"
    )


def told(row: dict[str, Any]) -> str:
    """One recording in a line."""
    found = "; ".join(wrong(row)) or "nothing wrong"
    sure = sum(e["identifiable"] for e in row.get("keys", {}).values())
    fit = (
        row.get("refused")
        or f"chi-square {row['ratio']:.3g} of {row['figures']} figures, {sure} of {len(row['keys'])} sure"
    )
    at = f"{row['record.duration']:.1f} s at {math.degrees(row['rate']):.3f} deg/s"
    return f"{row['recording']:3d} {row['kind']}, {at}, {row.get('seconds', 0.0):.0f} s: {fit}: {found}"


if __name__ == "__main__":
    main()
