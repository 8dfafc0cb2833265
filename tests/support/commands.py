"""Ways to run ``microvib``: in the test's own process, and several commands in one process of their
own.
"""

from contextlib import chdir
from pathlib import Path

import numpy as np
from click.testing import CliRunner, Result

from microvib.cli.main import main
from microvib.io.named import catalog_text
from microvib.io.recordings import write_recording
from support.hammer import blows, resonance
from support.wheel_waterfalls import RPM, KnownWheel, write_matrix

ONE_AFTER_ANOTHER = """
import json, sys
from microvib.cli.main import main
for name, arguments in json.loads(sys.argv[1]).items():
    status = 0
    try:
        main(arguments, prog_name="microvib")
    except SystemExit as end:
        status = end.code
    print(f"== {name} == {status}", flush=True)
"""
"""A program that runs commands by name, and says with which status each has ended."""


SHORT = ["--set", "record.settle=0.5 s", "--set", "record.duration=2 s"]
_STUDY = """
harmonics: 2
scenario: state-1
set: {record.settle: 0.2 s, record.duration: 1 s, record.sample_rate: 1024 Hz}
"""
_FILES = {
    "study.yaml": _STUDY
    + "vary: {driver.microsteps: [8, 16]}\nsampling: {method: random, count: 1}\n",
    "long.yaml": _STUDY
    + """vary: {friction.breakaway: {distribution: uniform, within: 20 percent}}
sampling: {method: random, count: 4000}
""",
    "bench.yaml": catalog_text("benches/force-table").replace("duration: 16 s", "duration: 4 s"),
    "craft.yaml": (Path(__file__).parents[2] / "examples" / "spacecraft.yaml").read_text(
        encoding="utf-8"
    ),
    "report.md": "# Acceptance test\n\n{{ test.verdict }}\n",
    "modes.csv": "frequency_hz,damping,effective_inertia_kg_m2,inertia_kg_m2\n1.19,0.01,8,9\n",
}
_BEFORE = (
    ["run", "state-1", *SHORT, "--out", "old"],
    ["measure", "state-1", "--bench", "bench.yaml", *SHORT, "-o", "old.csv"],
    ["measure", "state-1", "--bench", "bench.yaml", *SHORT, "--seed", "2", "-o", "again.csv"],
    ["campaign", "create", "study.yaml", "batch"],
    ["campaign", "create", "long.yaml", "long"],
    ["campaign", "run", "batch", "--workers", "1"],
)


def work_in(folder: Path) -> Path:
    """Make what commands work on: study files, a finished run, two recordings and one of blows, a
    wheel's waterfall, a campaign that is computed and one that is not.
    """
    for name, text in _FILES.items():
        (folder / name).write_text(text)
    write_recording(blows([resonance()], count=4, gap=0.5), folder / "blows.csv")
    speeds = RPM * np.linspace(500.0, 3000.0, 24)
    f, values = KnownWheel().waterfall("axial_force", speeds, 512.0, 512, np.random.default_rng(0))
    write_matrix(folder / "wheel.csv", speeds, values, f)
    for arguments in _BEFORE:
        done = microvib(*arguments, cwd=folder)
        assert done.exit_code == 0, done.output
    return folder


def microvib(*arguments: str, cwd: Path) -> Result:
    """A command in a folder, in this process, whose imports it shares; test_commands.py runs each
    as a program, too.
    """
    with chdir(cwd):
        return CliRunner().invoke(main, arguments, prog_name="microvib")
