"""The exported drive as a WebAssembly module, in Node and in a browser; Zig makes it in a minute or more."""

import functools
import http.server
import json
import shutil
import subprocess
import threading
from dataclasses import replace

import numpy as np
import pytest
from support.pulse_scenarios import drawn, scenario_of

import microvib as mv
from microvib.export.native.wasm import export_wasm
from microvib.solve import kernel
from microvib.solve.command import Command
from microvib.solve.pack import pack
from microvib.solve.sampling import sample_buffer

pytestmark = pytest.mark.long
pytest.importorskip("ziglang")

STATE = mv.load_scenario("state-1", {"record.start": "rest"})
RATE, SETTLE, SECONDS = 1024, 6, 16
NEAR = 1e-9
NODE_IS_THERE = pytest.mark.skipif(shutil.which("node") is None, reason="Node is not installed")
SCRIPT = """
import { loadModule } from "./drive.mjs";
export async function run(bytes, begins, width, count) {
  const module = await loadModule(bytes);
  const drive = module.open();
  drive.beginRecord(begins, width);
  const kept = drive.state;
  const torque = drive.channels.indexOf("T_d"), columns = drive.channels.length;
  const rows = drive.record(count);
  const other = module.open();
  other.state = kept;
  const again = other.record(count);
  let said = "";
  try { drive.doStep(0.0); } catch (error) { said = error.message; }
  return {
    torque: Array.from({ length: count }, (_, k) => rows[k * columns + torque]),
    same: rows.every((value, k) => value === again[k]),
    said,
  };
}
"""
NODE = """
import { readFileSync } from "fs";
import { run } from "./script.mjs";
const [begins, width, count] = process.argv.slice(2).map(Number);
process.stdout.write(JSON.stringify(await run(readFileSync("drive.wasm"), begins, width, count)));
"""


def exported(scenario, tmp_path_factory):
    made = export_wasm(scenario, tmp_path_factory.mktemp("wasm") / "drive")
    (made / "script.mjs").write_text(SCRIPT)
    (made / "node.mjs").write_text(NODE)
    return made


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return exported(STATE, tmp_path_factory)


@pytest.fixture(scope="module")
def expected():
    return torque_of(STATE)


def torque_of(scenario):
    """T_d of the solver in Python."""
    packed = pack(scenario)
    rows = np.zeros((RATE * SECONDS, packed.columns))
    for begun, stop, here in ((0.0, SETTLE, rows[:0]), (SETTLE, SETTLE + SECONDS, rows)):
        samples = sample_buffer(here, float(SETTLE), 1.0 / RATE)
        command = Command(scenario).microsteps(float(begun), float(stop))
        assert packed.advance(float(stop), samples, *command) == kernel.OK
    return rows[:, kernel.T_D]


def check(found, expected):
    torque, largest = np.array(found["torque"]), np.max(np.abs(expected))
    assert np.max(np.abs(torque - expected)) < NEAR * largest
    lines, exactly = np.abs(np.fft.rfft(torque)), np.abs(np.fft.rfft(expected))
    shown = exactly > 1e-4 * np.max(exactly)
    assert np.count_nonzero(shown) > 10
    assert np.max(np.abs(lines / exactly - 1.0)[shown]) < NEAR
    assert found["same"]
    assert "a record has begun" in found["said"] or "not after" in found["said"]


def torque_in_node(folder, rows):
    done = subprocess.run(
        ["node", "node.mjs", str(SETTLE), str(1.0 / RATE), str(rows)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


@NODE_IS_THERE
def test_lines_in_node_are_those_of_python(folder, expected):
    check(torque_in_node(folder, len(expected)), expected)


@NODE_IS_THERE
@pytest.mark.parametrize("both", [False, True])
def test_lines_of_pulses_in_node_are_those_of_python(both, tmp_path_factory):
    """With diodes, and with a clamp that conducts either way."""
    drive = replace(drawn(3), four_windings=both, both_ways=both)
    scenario = scenario_of(drive, 60)
    expected = torque_of(scenario)
    check(torque_in_node(exported(scenario, tmp_path_factory), len(expected)), expected)


def test_lines_in_a_browser_are_those_of_python(folder, expected):
    page_support = pytest.importorskip("support.page")
    if page_support.CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    Quiet.extensions_map = {**Quiet.extensions_map, ".mjs": "text/javascript"}
    (folder / "index.html").write_text("<!DOCTYPE html><title>drive</title>")
    handler = functools.partial(Quiet, directory=str(folder))
    with (
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server,
        page_support.api.sync_playwright() as playwright,
    ):
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        browser = playwright.chromium.launch(
            executable_path=page_support.CHROMIUM, args=["--no-sandbox"]
        )
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{server.server_port}/index.html")
        found = page.evaluate(
            """async ([begins, width, count]) => {
                const { run } = await import("./script.mjs");
                const bytes = await (await fetch("drive.wasm")).arrayBuffer();
                return run(bytes, begins, width, count);
            }""",
            [SETTLE, 1.0 / RATE, len(expected)],
        )
        browser.close()
        server.shutdown()
    check(found, expected)
