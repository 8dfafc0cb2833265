"""How fast, and how accurate: microvib beside general-purpose solvers on the same drive.

``python benchmarks/solvers.py [--seconds S] [--full] [--epsilon E] [--tolerance T]
[--basilisk-python PATH]``

Nothing is asserted. Machines differ: only the ratios mean something elsewhere. Every solver is
compiled before its clock starts, and the best of several runs counts where a run is short.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import peers

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support import rodas4

import microvib as mv
from microvib.solve.batch import Torque, simulate_torques
from microvib.units import Si

CLOCK = ("drive_1", "drive_2", "drive_3")
ALL = (*CLOCK, "full_step_1", "array_mode_1")
CONVERGED = 8
"""Refinement of the run that the others are compared with; by RODAS4 (tests/support/rodas4)."""
OWN = (
    ("microvib", {}),
    ("microvib, refinement 2", {"solver.refinement": 2}),
)
"""microvib's rows with all channels: name and settings; the first is what others are compared with."""
PERIOD = 1.5
"""Records are multiples of this [s]: 80 microsteps and 5 full steps of state-1, whole numbers of
samples.
"""
ENOUGH, MAX_RUNS = 2.0, 20
"""A run is repeated until it has taken this many seconds in all, or so many times."""
NOT_INSTALLED = "not installed: pip install"


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    solver: str
    wall: float
    simulated: float
    error: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Protocol:
    """One scenario, the lines that are compared, and their converged amplitudes [N m]."""

    scenario: mv.Scenario
    lines: tuple[str, ...]
    converged: dict[float, np.ndarray]
    """By sample rate: what a rectangular window leaks into a bin depends on it, slightly."""

    @property
    def span(self) -> float:
        """Simulated time [s]."""
        return self.scenario.record.settle + self.scenario.record.duration

    def error(self, torque: np.ndarray, rate: float, averaged: bool = False) -> float:
        """Largest relative deviation of the lines in ``torque`` (n,) [N m].

        Samples that are means over their interval (``averaged``) read a line low by its sinc, which
        is corrected.
        """
        found = amplitudes(self.scenario, self.lines, torque, rate)
        if averaged:
            found = found / np.sinc(_frequencies(self.scenario, self.lines, rate) / rate)
        return float(np.max(np.abs(found / self.converged[rate] - 1.0)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all and print the table."""
    options = _options(arguments)
    settings = peers.Settings(options.epsilon, options.tolerance, options.tolerance)
    state = mv.load_scenario("state-1")
    full = _protocol(state, ALL)
    short = full if options.full else _protocol(_shortened(state, options.seconds), CLOCK)
    tables = [(full, _own(full))]
    if short is not full:
        tables.append((short, _own(short)))
    tables[-1][1].extend(_peers(short, settings))
    tables[0][1].append(_basilisk(full.scenario, full.span, options.basilisk_python))
    for protocol, rows in tables:
        print(_table(protocol, rows))
    print(_explanation(settings))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="microvib beside general-purpose solvers, on state-1"
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=2.0,
        help="simulated span of the slow peers [s] (default: 2)",
    )
    parser.add_argument(
        "--full", action="store_true", help="the peers, too, run the whole protocol of 46 s"
    )
    parser.add_argument(
        "--epsilon",
        type=float,
        default=1e-6,
        help="the peers' friction width [rad/s] (default: 1e-6)",
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=1e-6,
        help="relative tolerance of the peers (default: 1e-6)",
    )
    parser.add_argument("--basilisk-python", help="interpreter of an environment with Basilisk")
    options = parser.parse_args(arguments)
    if options.seconds < PERIOD + 0.1:
        parser.error(
            f"--seconds: {options.seconds:g} is too short; at least {PERIOD + 0.1:g} s are needed"
        )
    return options


def _shortened(state: mv.Scenario, seconds: float) -> mv.Scenario:
    duration = PERIOD * max(int(seconds // 2.0), 1)
    return state.with_si({"record.settle": seconds - duration, "record.duration": duration})


def _protocol(scenario: mv.Scenario, lines: tuple[str, ...]) -> Protocol:
    converged = {}
    for rate in (scenario.record.sample_rate, peers.RATE):
        _say(
            f"RODAS4, refinement {CONVERGED}, {_span(scenario):g} s at {rate:g} Hz, for comparison"
        )
        fine = scenario.with_si({"solver.refinement": CONVERGED, "record.sample_rate": rate})
        converged[rate] = amplitudes(
            fine, lines, rodas4.simulate(fine, channels=("T_d",))["T_d"], rate
        )
    return Protocol(scenario, lines, converged)


def amplitudes(
    scenario: mv.Scenario, names: tuple[str, ...], torque: np.ndarray, rate: float
) -> np.ndarray:
    """Bin amplitudes of the lines [N m], (m,): rectangular window, bin nearest to the expected
    frequency.
    """
    # The bins are fixed: the frequency that is fitted to the array mode lies so near to the border
    # of two bins that runs a hair apart would read different ones.
    bins = 2.0 / torque.size * np.abs(np.fft.rfft(torque - torque.mean()))
    return bins[np.round(_frequencies(scenario, names, rate) * torque.size / rate).astype(int)]


def _frequencies(scenario: mv.Scenario, names: tuple[str, ...], rate: float) -> np.ndarray:
    expected = {line.name: line.frequency for line in mv.expected_lines(scenario, Si(0.5 * rate))}
    return np.array([expected[name] for name in names])


def _own(protocol: Protocol) -> list[Row]:
    rows = []
    for name, settings in OWN:
        scenario = protocol.scenario.with_(settings)
        rows.append(
            _own_row(name, protocol, lambda scenario=scenario: mv.simulate(scenario)["T_d"])
        )
    rows.append(_own_row("microvib, torque only", protocol, lambda: _torque(protocol.scenario)))
    return rows


def _own_row(name: str, protocol: Protocol, run: Callable[[], np.ndarray]) -> Row:
    _say(f"{name}, {protocol.span:g} s")
    run()  # compiles, or loads what was compiled
    wall, torque = _best(run)
    return Row(
        name, wall, protocol.span, protocol.error(torque, protocol.scenario.record.sample_rate)
    )


def _torque(scenario: mv.Scenario) -> np.ndarray:
    """What ``simulate_torques`` gives for a list of one, as the peers, which compute nothing else
    either.
    """
    (found,) = simulate_torques([scenario])
    assert isinstance(found, Torque), found
    return found.T_d


def _peers(protocol: Protocol, settings: peers.Settings) -> list[Row]:
    rows = []
    for name, (package, maker) in peers.SOLVERS.items():
        if importlib.util.find_spec(package) is None:
            rows.append(Row(name, 0.0, 0.0, note=f"{NOT_INSTALLED} {peers.INSTALL[package]}"))
            continue
        _say(f"{name}, {protocol.span:g} s")
        try:
            wall, torque = _best(peers.prepare(protocol.scenario, maker, settings))
        except RuntimeError as error:
            rows.append(Row(name, 0.0, 0.0, note=f"failed: {error}"))
            continue
        rows.append(
            Row(name, wall, protocol.span, protocol.error(torque, peers.RATE, averaged=True))
        )
    return rows


def _basilisk(scenario: mv.Scenario, span: float, interpreter: str | None) -> Row:
    """Basilisk's stepper motor, in a process of its own: its environment need not be ours."""
    name = "Basilisk stepperMotor"
    if interpreter is None and importlib.util.find_spec("Basilisk") is None:
        return Row(name, 0.0, 0.0, note=f"{NOT_INSTALLED} bsk (or give --basilisk-python)")
    _say(f"{name}, {span:g} s")
    script = Path(__file__).with_name("basilisk_stepper.py")
    numbers = (
        scenario.driver.microstep(scenario.motor),
        scenario.driving_frequency,
        span,
        scenario.record.sample_rate,
    )
    command = [
        interpreter or sys.executable,
        str(script),
        *(repr(float(number or 0.0)) for number in numbers),
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        reason = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
        return Row(name, 0.0, 0.0, note=f"does not run: {reason}")
    result = json.loads(done.stdout.strip().splitlines()[-1])
    note = f"kinematic: no load, no torque; {result['steps_missed']:.2g} steps off its command"
    return Row(name, result["wall_s"], result["simulated_s"], note=note)


def _best(run: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Best wall time [s] of several runs, of one if that is long, and what the last of them
    returned.
    """
    walls: list[float] = []
    while not walls or (sum(walls) < ENOUGH and len(walls) < MAX_RUNS):
        begun = time.perf_counter()
        result = run()
        walls.append(time.perf_counter() - begun)
    return min(walls), result


def _table(protocol: Protocol, rows: list[Row]) -> str:
    record = protocol.scenario.record
    own = rows[0].wall / rows[0].simulated
    head = f"state-1: {record.settle:g} s + {record.duration:g} s recorded; error over {', '.join(protocol.lines)}"
    columns = f"{'solver':24s} {'wall s':>9s} {'simulated s':>12s} {'x real time':>12s} {'/ microvib':>11s} {'error':>9s}"
    lines = ["", head, columns, "-" * len(columns)]
    for row in rows:
        if row.simulated == 0.0:
            lines.append(f"{row.solver:24s} {row.note}")
            continue
        each = row.wall / row.simulated
        error = "-" if row.error is None else f"{100.0 * row.error:.3f} %"
        text = f"{row.solver:24s} {row.wall:9.4f} {row.simulated:12.3g} {1.0 / each:12.3g} {each / own:11.3g} {error:>9s}"
        lines.append(f"{text}  {row.note}".rstrip())
    return "\n".join(lines)


def _explanation(settings: peers.Settings) -> str:
    return f"""
error: largest relative deviation of the lines' bin amplitudes from RODAS4's, refinement {CONVERGED}.
/ microvib: wall time per simulated second over that of microvib's default settings on the same protocol.
SciPy and SUNDIALS: compiled right-hand side, restarted at each microstep, Jacobian by differences; friction smoothed
as tanh(omega / {settings.epsilon:g} rad/s); rtol {settings.rtol:g}, atol {settings.atol:g} of a microstep's motion.
They give the disturbance torque only, as the row "torque only" does; the other rows of microvib give all channels, both forms of
the torque and the energy balance."""


def _span(scenario: mv.Scenario) -> float:
    return scenario.record.settle + scenario.record.duration


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
