"""What an exported drive costs beside ``simulate``, in one run on one machine.

``python benchmarks/exported.py [SCENARIO] [--seconds N] [--turns N] [--no-wasm]``

Rows are the C library and the FMU at several communication steps, with T_d and its mean asked for
at each, the C library's record of all channels, and the WebAssembly module's in Node. Speed is that
of ``simulate`` from rest, with all channels sampled, over the row's time: 1 is as fast, more is
faster. Nothing is asserted on time.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import fmpy

import microvib as mv
from microvib.export.native.fmu import export_fmu
from microvib.export.native.library import export_c_library
from microvib.export.native.linking import host
from microvib.export.native.wasm import export_wasm
from microvib.model.scenario import Scenario

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.native_drive import Drive, load

STEPS = (1.0, 0.1, 0.01, 0.001, 0.0001)
"""Communication steps [s]."""
RECORD_RATE = 8192
"""Rows a second of a record."""
NODE = """
import { readFileSync } from "fs";
import { loadModule } from "./drive.mjs";
const module = await loadModule(readFileSync("drive.wasm"));
const [seconds, turns, rate] = process.argv.slice(2).map(Number);
let best = Infinity;
for (let turn = 0; turn < turns; turn++) {
  const drive = module.open();
  const begun = performance.now();
  drive.beginRecord(0, 1 / rate);
  for (let k = 0; k < seconds; k++) drive.record(rate);
  best = Math.min(best, (performance.now() - begun) / 1000);
  drive.free();
}
console.log(best);
"""


def best(turns: int, call: Callable[[], object]) -> float:
    """The shortest time [s] of several calls."""
    times = []
    for _ in range(turns):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return min(times)


def in_c(library: object, seconds: int, step: float) -> None:
    """Steps of the C library, called by ctypes."""
    drive = Drive(library)
    ask, at = library.microvib_output, drive.at
    torque, mean = (drive.call("find_output", name) for name in (b"T_d", b"T_d_mean"))
    for k in range(1, round(seconds / step) + 1):
        drive.step(step * k)
        ask(at, torque)
        ask(at, mean)
    drive.free()


def record_in_c(library: object, seconds: int) -> None:
    """Rows of all channels."""
    drive = Drive(library)
    drive.ask("begin_record", 0.0, 1.0 / RECORD_RATE)
    for _ in range(seconds):
        drive.record(RECORD_RATE)
    drive.free()


def in_fmu(folder: str, seconds: int, step: float) -> None:
    """Steps of the FMU, called by fmpy."""
    description = fmpy.read_model_description(folder)
    asked = [v.valueReference for v in description.modelVariables if v.name.startswith("T_d")][:2]
    fmu = fmpy.fmi2.FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
    )
    fmu.instantiate()
    fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    for k in range(round(seconds / step)):
        fmu.doStep(step * k, step)
        fmu.getReal(asked)
    fmu.terminate()
    fmu.freeInstance()


def rows(scenario: Scenario, seconds: int, turns: int, wasm: bool) -> Iterator[tuple[str, float]]:
    """Names and times [s]."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        export_c_library(scenario, place / "c")
        library = load(next((place / "c").glob(f"drive-{host()}.*")))
        yield "C, record of all channels", best(turns, lambda: record_in_c(library, seconds))
        unzipped = fmpy.extract(str(export_fmu(scenario, place / "drive.fmu")))
        for step in STEPS:
            yield f"C, steps of {step:g} s", best(turns, lambda: in_c(library, seconds, step))  # noqa: B023
            yield f"FMU, steps of {step:g} s", best(turns, lambda: in_fmu(unzipped, seconds, step))  # noqa: B023
        if wasm and shutil.which("node"):
            made = export_wasm(scenario, place / "wasm")
            (made / "run.mjs").write_text(NODE)
            command = ["node", "run.mjs", str(seconds), str(turns), str(RECORD_RATE)]
            said = subprocess.run(command, cwd=made, capture_output=True, text=True, check=True)
            yield "WebAssembly in Node, record", float(said.stdout)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenario", nargs="?", default="state-1")
    parser.add_argument("--seconds", type=int, default=40)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--no-wasm", action="store_true")
    given = parser.parse_args()
    scenario = mv.load_scenario(given.scenario)
    run = scenario.with_(
        {
            "record.start": "rest",
            "record.settle": "0 s",
            "record.duration": f"{given.seconds} s",
        }
    )
    mv.simulate(run)
    simulated = best(given.turns, lambda: mv.simulate(run))
    whole = best(given.turns, lambda: mv.run_scenario(run))
    print(f"{given.seconds} s of {given.scenario}: simulate takes {simulated:.3f} s,"
          f" the whole run with its lines and their error {whole:.3f} s")  # fmt: skip
    print(f"{'':36}{'time [s]':>10}{'speed over simulate':>22}{'over a run':>13}")
    for name, seconds in rows(run, given.seconds, given.turns, not given.no_wasm):
        print(f"{name:36}{seconds:10.3f}{simulated / seconds:22.2f}{whole / seconds:13.2f}")


if __name__ == "__main__":
    main()
