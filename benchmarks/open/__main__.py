"""The open benchmark of line estimates and identified parameters.

``python benchmarks/open make DIR [--count N] [--salt TEXT]`` makes the recordings,
``python benchmarks/open estimate DIR`` runs the five estimators on them,
``python benchmarks/open identify DIR [--most N]`` identifies parameters with microvib,
``python benchmarks/open manifest DIR`` prints names, halves and seeds, as ``manifest.csv`` has them,
``python benchmarks/open check DIR [--count N]`` puts the integrator beside microvib's own simulation,
``python benchmarks/open score DIR [FILE.csv ...]`` prints the tables, also of another's estimates, and
``python benchmarks/open all DIR`` makes, estimates, identifies and scores. What is there already is not made again.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from cases import CASES, OPEN, SALT, WITHHELD, Case, Ripple, Test, case_of, cases, draw, manifest
from estimators import ESTIMATORS
from recordings import Made, make
from scoring import (
    COVERAGE_HEADER,
    LINE_HEADER,
    PARAMETER_HEADER,
    Score,
    Truth,
    coverage_row,
    line_row,
    parameter_rows,
)  # fmt: skip

COLUMNS = (
    "case", "frequency_hz", "amplitude_n_m", "phase_rad", "frequency_sd_hz", "amplitude_sd_n_m", "phase_sd_rad",
)  # fmt: skip
PARAMETERS = ("case", "key", "estimate", "low", "high", "identifiable", "explained")
OURS = "microvib"
TASKS = ("make", "estimate", "identify", "score", "check", "manifest")
UNITS = {
    "current": "A", "torque_constant": "N*m/A", "detent_torque": "N*m", "winding_resistance": "ohm",
    "winding_inductance": "H", "rotor_inertia": "kg*m^2", "coulomb": "N*m", "breakaway": "N*m",
    "stribeck_rate": "rad/s", "viscous": "N*m*s/rad", "proportional_gain": "V/A", "integral_gain": "V/(A*s)",
    "derivative_gain": "V*s/A", "quadrature": "rad", "wave_generator_inertia": "kg*m^2", "stiffness": "N*m/rad",
    "damping": "N*m*s/rad", "phase": "rad", "output_inertia": "kg*m^2", "inertia": "kg*m^2", "rigid_inertia": "kg*m^2",
    "effective_inertia": "kg*m^2", "frequency": "Hz", "rate": "rad/s", "settle": "s", "duration": "s",
    "sample_rate": "Hz",
}  # fmt: skip


def make_all(out: Path, every: Sequence[Case]) -> None:
    """Write the recordings that are not there."""
    for case in every:
        folder = out / case.name
        if (folder / "truth.json").exists():
            continue
        begun = time.process_time()
        test, made = made_case(case)
        write_case(folder, test, made)
        took = time.process_time() - begun
        print(f"{case.name} ({case.half}): {len(made.lines)} lines, {took:.1f} s", file=sys.stderr)


def made_case(case: Case, tries: int = 20) -> tuple[Test, Made]:
    """A case's recording: of the first of its draws whose drive keeps in step and repeats itself."""
    for k in range(tries):
        test = draw(Case(case.name, case.half, case.seed + k))
        try:
            return test, make(test)
        except ValueError as reason:
            print(f"{case.name}, draw {k + 1}: {reason}", file=sys.stderr)
    raise ValueError(f"{case.name}: no drive repeats its motion")


def write_case(folder: Path, test: Test, made: Made) -> None:
    """A case's recording, scenario and truth; the truth comes last."""
    folder.mkdir(parents=True, exist_ok=True)
    _write_recording(folder / f"recording{test.suffix}", made.x, test.sample_rate)
    text = yaml.safe_dump(_with_units(test.scenario), sort_keys=False)
    (folder / "scenario.yaml").write_text(text)
    truth = {
        "half": test.case.half, "duration": test.duration, "parameters": test.truth,
        "flux_harmonics": test.drive.flux.tolist(), "clock_hz": test.f_d, "recorder_ratio": test.recorder_ratio,
        "modes": (np.sqrt(test.drive.Lambda) / (2.0 * np.pi)).tolist(), "events": made.events,
        "unscored": list(made.unsteady),
        "lines": [[x.frequency, x.amplitude, x.phase, x.sigma] for x in made.lines],
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth))


def _write_recording(path: Path, x: np.ndarray, rate: float) -> None:
    if path.suffix == ".tdms":
        from nptdms import ChannelObject, TdmsWriter

        properties = {"unit_string": "N*m", "wf_increment": 1.0 / rate, "wf_xunit_string": "s"}
        with TdmsWriter(str(path)) as writer:
            writer.write_segment([ChannelObject("table", "Mz", x, properties=properties)])
        return
    import microvib as mv
    from microvib.io.recordings import write_recording

    path.unlink(missing_ok=True)
    write_recording(mv.Recording({"Mz": x}, rate, {"Mz": "N*m"}, "open benchmark"), path)


def _with_units(tree: Any, key: str = "", above: str = "") -> Any:
    """A scenario in SI as a file has it: with units."""
    if isinstance(tree, dict):
        return {name: _with_units(value, name, key) for name, value in tree.items()}
    if isinstance(tree, list):
        return [_with_units(value, key, key) for value in tree]
    unit = UNITS.get(key, "")
    if key == "damping" and above == "modes":
        unit = ""
    if unit and isinstance(tree, float):
        return f"{tree!r} {unit}"
    return tree


def estimate_all(out: Path, every: Sequence[Case]) -> None:
    """Run the five estimators on recordings of which they have no estimates yet."""
    import ours

    import microvib as mv

    for name in (*ESTIMATORS, OURS):
        path = out / f"lines of {name}.csv"
        done = {row["case"] for row in _rows(path)}
        for case in every:
            if case.name in done:
                continue
            folder = out / case.name
            if name == OURS:
                found = ours.lines(folder)
            else:
                recording = mv.read_recording(ours.recording_of(folder))
                scenario = _in_si(yaml.safe_load((folder / "scenario.yaml").read_text()))
                found = ESTIMATORS[name](recording["Mz"], recording.sample_rate, scenario)
            _append(path, COLUMNS, [[case.name, *map(repr, map(float, row))] for row in found])


def _in_si(tree: Any) -> Any:
    """The numbers of a scenario file that was written in SI."""
    if isinstance(tree, dict):
        return {name: _in_si(value) for name, value in tree.items()}
    if isinstance(tree, list):
        return [_in_si(value) for value in tree]
    if isinstance(tree, str) and tree[:1] in "-0123456789":
        return float(tree.split()[0])
    return tree


def identify_all(out: Path, every: Sequence[Case], most: int) -> None:
    """Identify parameters of the first ``most`` of the plain cases of each half."""
    import ours

    path = out / f"parameters of {OURS}.csv"
    done = {row["case"] for row in _rows(path)}
    for case in _for_parameters(out, every, most):
        if case.name in done:
            continue
        begun = time.process_time()
        keys = list(_truth(out, case)["parameters"])
        rows = list(ours.parameters(out / case.name, keys, 1))
        _append(path, PARAMETERS, [[row[key] for key in PARAMETERS] for row in rows])
        print(f"{case.name}: identified, {time.process_time() - begun:.1f} s", file=sys.stderr)


def _for_parameters(out: Path, every: Sequence[Case], most: int) -> list[Case]:
    """Cases to identify: alternately of each half, the first with one array mode and without flux
    harmonics.
    """
    plain = [case for case in every if _is_plain(_truth(out, case))]
    halves = ([x for x in plain if x.half == half][:most] for half in (OPEN, WITHHELD))
    return [case for pair in zip_longest(*halves) for case in pair if case is not None]


def _is_plain(truth: dict[str, Any]) -> bool:
    return not truth["flux_harmonics"] and len(truth["modes"]) == 1


def score(out: Path, every: Sequence[Case], others: Sequence[Path]) -> str:
    """The tables of all estimates that are there, and of those of others."""
    files = {name: out / f"lines of {name}.csv" for name in (*ESTIMATORS, OURS)}
    files = {name: path for name, path in files.items() if path.exists()}
    files |= {path.stem: path for path in others}
    parts = []
    scores: dict[str, list[Score]] = {name: [] for name in files}
    for half in (OPEN, WITHHELD):
        mine = [case for case in every if case.half == half]
        for name, path in files.items():
            scores[name].append(line_score(out, mine, path))
        rows = [line_row(name, of[-1]) for name, of in scores.items()]
        parts.append(f"Lines, {half} half, {len(mine)} recordings\n\n{_table(LINE_HEADER, rows)}")
        truths = {case.name: _truth(out, case)["parameters"] for case in mine}
        for path in sorted(out.glob("parameters of *.csv")):
            found = [row for row in _rows(path) if row["case"] in truths]
            table = _table(PARAMETER_HEADER, parameter_rows(truths, found))
            explained = len({row["case"] for row in found if row["explained"] == "yes"})
            cases_ = len({row["case"] for row in found})
            parts.append(
                f"Parameters, {half} half, {explained} of {cases_} recordings explained\n\n{table}"
            )
    rows = [coverage_row(name, of) for name, of in scores.items()]
    parts.append(
        f"Intervals of lines, both halves, {len(every)} recordings\n\n{_table(COVERAGE_HEADER, rows)}"
    )
    return "\n\n".join(parts)


def line_score(out: Path, every: Sequence[Case], path: Path) -> Score:
    """Score of a file of estimates on some cases."""
    of: dict[str, list[list[float]]] = {case.name: [] for case in every}
    for row in _rows(path):
        if row["case"] in of:
            of[row["case"]].append([float(row.get(key) or "nan") for key in COLUMNS[1:]])
    total = Score()
    for case in every:
        data = _truth(out, case)
        arrays = (
            np.array(data["lines"]).reshape(-1, 4),
            np.array(data["unscored"]),
            np.array(data["modes"]),
        )
        total.add(Truth(data["duration"], *arrays), np.array(of[case.name]).reshape(-1, 6))
    return total


def check(every: Sequence[Case]) -> None:
    """Print by how much lines of microvib's own simulation of the true drives differ from the
    integrator's: of all from a hundredth of the largest.
    """
    import ours

    for case in every:
        test, _ = made_case(case)
        quiet = replace(test, ripple=Ripple(0.0, 0.0))
        scenario = _with_units(quiet.true_scenario())
        off, count = ours.largest_difference(
            scenario, make(quiet).lines, quiet.f_e, quiet.recorder_ratio
        )
        print(f"{case.name}: {count} lines, the largest difference {100.0 * off:.3g} %", flush=True)


def _truth(out: Path, case: Case) -> dict[str, Any]:
    return dict(json.loads((out / case.name / "truth.json").read_text()))


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in lines)


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _append(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.writer(file)
        if new:
            writer.writerow(header)
        writer.writerows(rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Do what is asked, one after the other."""
    parser = argparse.ArgumentParser(prog="python benchmarks/open", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("task", choices=(*TASKS, "all"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("estimates", type=Path, nargs="*", help="files of estimates of others")
    parser.add_argument("--count", type=int, default=CASES)
    parser.add_argument("--only", nargs="*", metavar="NAME", help="these cases, such as case-002")
    parser.add_argument("--salt", default=SALT, help="seeds of the withheld half depend on it")
    parser.add_argument("--most", type=int, default=12, help="identified recordings of each half")
    asked = parser.parse_args(arguments)
    every = cases(asked.count, asked.salt)
    if asked.only:
        every = [case_of(name, asked.salt) for name in asked.only]
    actions: dict[str, Callable[[], None]] = {
        "make": lambda: make_all(asked.folder, every),
        "estimate": lambda: estimate_all(asked.folder, every),
        "identify": lambda: identify_all(asked.folder, every, asked.most),
        "score": lambda: print(score(asked.folder, every, asked.estimates)),
        "check": lambda: check(every),
        "manifest": lambda: print(manifest(asked.count, asked.salt), end=""),
    }
    for task in TASKS[:4] if asked.task == "all" else (asked.task,):
        actions[task]()


if __name__ == "__main__":
    main()
