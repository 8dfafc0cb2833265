"""The command line as a user meets it: files that appear whole, sentences instead of tracebacks."""

from __future__ import annotations

import ast
import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.commands import microvib
from support.scenarios import baseline

import microvib as mv
from microvib.cli.streams import status_of
from microvib.errors import MicrovibError, OptionError, OutputError
from microvib.io.writing import RUN_FILES, write_folder

SHORT = ["--set", "record.settle=1 s", "--set", "record.duration=4 s"]

BOLTED = sorted(
    name
    for name in RUN_FILES
    if name not in ("loads.csv", "pointing.csv", "densities.csv") and "wing_2" not in name
)
"""Files of a run without a craft."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[Path, str]:
    """A short run of state 1 and what it printed."""
    where = tmp_path_factory.mktemp("runs")
    done = microvib(
        "run", "state-1", *SHORT, "--set", "tracking.clock_ratio=0.994", "--out", "first", cwd=where
    )
    assert done.exit_code == 0, done.stderr
    return where / "first", done.stdout


def rows(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "lines.csv").open() as stream:
        return {row["line"]: row for row in csv.DictReader(stream)}


def test_a_run_writes_its_five_files(finished):
    folder, printed = finished
    assert sorted(p.name for p in folder.glob("[!.]*")) == BOLTED
    assert "drive_1" in printed
    assert "Tables 5 and 6" in printed


def test_lines_csv_has_the_promised_columns_and_lines(finished):
    table = rows(finished[0])
    assert {"array_mode_1", "drive_1", "drive_2", "drive_3", "full_step_1"} <= set(table)
    columns = [
        "line",
        "expected_hz",
        "frequency_hz",
        "amplitude_n_m",
        "phase_rad",
        "bin_frequency_hz",
        "bin_amplitude_n_m",
    ]
    assert list(table["drive_1"])[:7] == columns
    assert float(table["drive_1"]["expected_hz"]) == pytest.approx(53.0133, abs=1e-4)


def test_motion_file_opens_with_units(finished):
    import xarray as xr

    with xr.open_dataset(finished[0] / "motion.nc", engine="h5netcdf") as data:
        assert data.sizes == {"time": 16384, "mode": 1}
        assert data["T_d"].attrs["units"] == "N*m"
        assert float(np.abs(data["T_d"] - data["T_d_force"]).max()) < 1e-14
        assert float(data["time"][0]) == 1.0


def test_summary_says_how_far_to_trust(finished):
    summary = json.loads((finished[0] / "summary.json").read_text())
    assert summary["invariants"]["torque_forms"] < 1e-12
    assert summary["invariants"]["energy"] < 1e-4
    assert summary["versions"]["numba"]
    assert summary["solver"]["steps"] > 0


def test_report_is_self_contained(finished):
    page = (finished[0] / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 4
    assert "://" not in page
    for text in ("array_mode_1", "Torque budget", "assumed", "reducer", "N\u00a0m/rad"):
        assert text in page


def test_written_scenario_runs_to_the_same_result(finished, tmp_path):
    done = microvib(
        "run", str(finished[0] / "scenario.yaml"), "--out", str(tmp_path / "again"), cwd=tmp_path
    )
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "again" / "lines.csv").read_text() == (finished[0] / "lines.csv").read_text()


def test_lines_only_gives_the_same_lines(finished, tmp_path):
    done = microvib(
        "run", str(finished[0] / "scenario.yaml"), "--lines-only", "--out", "lean", cwd=tmp_path
    )
    assert done.exit_code == 0, done.stderr
    assert sorted(p.name for p in (tmp_path / "lean").glob("[!.]*")) == [
        "lines.csv",
        "scenario.yaml",
        "summary.json",
    ]
    assert (tmp_path / "lean" / "lines.csv").read_text() == (finished[0] / "lines.csv").read_text()


def test_without_out_a_new_folder_is_found_each_time(tmp_path):
    for name in ("state-1", "state-1-2"):
        done = microvib("run", "state-1", *SHORT, "--lines-only", cwd=tmp_path)
        assert done.exit_code == 0, done.stderr
        assert (tmp_path / name / "lines.csv").is_file()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "state-9"], "no such file and no catalog scenario"),
        (["run", "state-1", "--set", "motor.current"], "KEY=VALUE is expected"),
        (["run", "state-1", "--set", "driver.microsteps=0"], "driver.microsteps: 0 is not allowed"),
        (
            ["run", "state-1", "--set", "motor.rotor_inertia=-1 kg*m^2"],
            "must be greater than 0 kg*m^2",
        ),
        (["run", "state-1", "--set", "nonsense.key=1"], "nonsense: unknown key"),
        (["run", "state-1", "--set", "tracking.rate=400 deg/s"], "loss of synchronism at t ="),
        (["run", "state-1", "--out", "taken"], "holds other content (thesis.txt)"),
        (["run", "state-1", "--out", "taken/thesis.txt"], "is a file"),
        (["show", "taken"], "is a folder"),
        (["new", "taken/thesis.txt"], "already exists"),
    ],
)
def test_bad_input_is_one_sentence_and_a_status(arguments, sentence, tmp_path):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "thesis.txt").write_text("ten years of work")
    done = microvib(*arguments, cwd=tmp_path)
    assert done.exit_code == 1
    assert sentence in done.stderr
    assert done.stderr.count("Error:") == 1
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]
    assert (tmp_path / "taken" / "thesis.txt").read_text() == "ten years of work"


def test_an_old_run_is_replaced_only_on_request(tmp_path):
    arguments = ["run", "state-1", *SHORT, "--lines-only", "--out", "run"]
    assert microvib(*arguments, cwd=tmp_path).exit_code == 0
    again = microvib(*arguments, cwd=tmp_path)
    assert again.exit_code == 1
    assert "already holds results" in again.stderr
    assert microvib(*arguments, "--overwrite", cwd=tmp_path).exit_code == 0
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_failed_write_leaves_nothing_behind(tmp_path):
    def disk_full(path: Path) -> None:
        path.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device; nothing was left behind"):
        write_folder(tmp_path / "run", {"lines.csv": "a", "motion.nc": disk_full})
    assert list(tmp_path.iterdir()) == []


def test_a_failed_overwrite_keeps_the_old_run(tmp_path):
    def disk_full(path: Path) -> None:
        raise OSError(28, "No space left on device")

    write_folder(tmp_path / "run", {"lines.csv": "old"})
    with pytest.raises(OutputError):
        write_folder(tmp_path / "run", {"lines.csv": "new", "motion.nc": disk_full}, overwrite=True)
    assert (tmp_path / "run" / "lines.csv").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_to(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be made"):
        write_folder(tmp_path / "run", {"lines.csv": "a"})


def test_new_show_scenarios_schema(tmp_path):
    assert microvib("new", "drive.yaml", cwd=tmp_path).exit_code == 0
    shown = microvib("show", "drive.yaml", cwd=tmp_path)
    assert "driving frequency f_d 53.3333 Hz" in shown.stdout
    assert "state-5" in microvib("scenarios", cwd=tmp_path).stdout
    assert json.loads(microvib("schema", cwd=tmp_path).stdout)["title"] == "microvib scenario"


def test_measured_analysed_and_never_overwritten(tmp_path):
    """The virtual bench writes a recording, the reader finds the lines that went in."""
    measured = microvib(
        "measure", "state-1", *SHORT, "--bench", "force-table", "-o", "test.uff", cwd=tmp_path
    )
    assert measured.exit_code == 0, measured.stderr
    assert "no usable band is declared; from 151.5 Hz up" in measured.stdout
    assert "bench: force-table in the preparation file" in measured.stdout
    analysed = microvib(
        "analyse",
        "test.uff",
        "--scenario",
        "state-1",
        "--band",
        "0.5:5 Hz",
        "--resolution",
        "0.5 Hz",
        "--out",
        "seen",
        cwd=tmp_path,
    )
    assert analysed.exit_code == 0, analysed.stderr
    assert "Step clock over nominal: 0.99399" in analysed.stdout
    assert "15 averages" in analysed.stdout
    assert rows(tmp_path / "seen")["drive_1"]["status"] == "ok"
    names = [
        "density.csv", "density.png", "lines.csv", "report.html", "spectrum.csv", "spectrum.png",
        "third_octaves.csv", "waterfall.png",
    ]  # fmt: skip
    assert sorted(p.name for p in (tmp_path / "seen").glob("[!.]*")) == names
    before = (tmp_path / "test.uff").read_bytes()
    again = microvib("measure", "state-1", *SHORT, "-o", "test.uff", cwd=tmp_path)
    assert again.exit_code == 1
    assert "already exists; nothing was written" in again.stderr
    assert (tmp_path / "test.uff").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["analyse", "nothing.uff"], "nothing.uff: cannot be read: No such file"),
        (["analyse", "state-1", "--band", "5"], "write LOW:HIGH with a unit"),
        (
            ["analyse", "state-1", "--resolution", "1 s"],
            "--resolution: '1 s' has the wrong dimension",
        ),
        (
            ["measure", "state-1", "-o", "x.wav"],
            "'.wav' is not known; recordings are written to .uff, .mat, .csv",
        ),
        (
            ["measure", "state-1", "--bench", "shaker", "-o", "x.uff"],
            "shaker: there is no such file and no catalog bench of this name",
        ),
        (
            ["compare", "a.uff", "state-1", "--prepare", "how.yaml"],
            "how.yaml: there is no such file",
        ),
        (
            [
                "identify",
                "state-1",
                "state-1:measured",
                "--fit",
                "reducer.stiffness",
                "--model-error",
                "2",
            ],
            "at most 100 percent",
        ),
        *(
            (
                ["identify", "state-1", "state-1:measured", "--fit", "reducer.stiffness", *given],
                sentence,
            )
            for given, sentence in (
                (
                    ["--chain-error=-1 percent"],
                    "chain-error: -1 percent is not allowed; it must be at least 0",
                ),
                (["--chain-width=0 Hz"], "chain-width: '0 Hz' is not allowed"),
                (["--chain-width=2"], "chain-width: '2' needs a unit"),
            )
        ),
    ],
)
def test_bad_input_of_the_measurement_side(arguments, sentence, tmp_path):
    done = microvib(*arguments, cwd=tmp_path)
    assert done.exit_code == 1
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_help_does_not_import_numerics(tmp_path):
    code = "import sys; sys.argv = ['microvib', '--help']\nfrom microvib.cli.main import main\ntry: main()\nexcept SystemExit: pass\nprint(sorted(m for m in ('numpy', 'numba', 'scipy', 'xarray', 'matplotlib', 'pint', 'pydantic') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def imported_by(code: str, folder, *names: str) -> list[str]:
    """Which of the modules ``names`` are there after ``code`` in a process of its own."""
    asked = f"import sys\n{code}\nprint(sorted(m for m in {names!r} if m in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", asked], capture_output=True, text=True, check=True, cwd=folder
    )
    assert done.stderr == ""
    return ast.literal_eval(done.stdout.splitlines()[-1])


def test_a_run_does_not_import_what_it_does_not_use(tmp_path):
    words = [
        "microvib",
        "run",
        "state-1",
        "--set",
        "record.duration=1 s",
        "--set",
        "record.settle=0.5 s",
        "--out",
        "out",
    ]
    code = f"sys.argv = {words!r}\nfrom microvib.cli.main import main\ntry: main()\nexcept SystemExit: pass"
    unused = (
        "mpl_toolkits.mplot3d.axes3d",
        "microvib.structures.simulator_design",
        "microvib.structures.fem.structure",
    )
    assert imported_by(code, tmp_path, "matplotlib.figure", "xarray", "pint", "numba", *unused) == [
        "matplotlib.figure"
    ]
    assert (tmp_path / "out" / "report.html").read_text().count("data:image/svg") >= 4


def test_matplotlib_in_a_user_s_own_process_keeps_all_that_it_has(tmp_path):
    code = """
import microvib.cli.main
from microvib.reports.sheets import new_figure
new_figure(3.0, 2.0)
from matplotlib.lines import Line2D
from matplotlib.projections import get_projection_class
assert "linewidth" in Line2D.set.__doc__
assert get_projection_class("3d").name == "3d"
"""
    assert imported_by(code, tmp_path, "mpl_toolkits.mplot3d.axes3d") == [
        "mpl_toolkits.mplot3d.axes3d"
    ]


def test_the_five_lines_of_a_notebook(motion_1):
    table = mv.find_lines(motion_1)
    assert table["drive_1"].bin_frequency == 53.0
    assert mv.spectrum(motion_1).resolution == 0.0625
    assert len(mv.plot(motion_1, table).axes) == 4
    assert motion_1.dataset["T_d"].attrs["units"] == "N*m"


def test_modes_of_the_reference_array(tmp_path):
    pytest.importorskip("pyfe3d", reason="plates need microvib[fem]")
    done = microvib("modes", "reference-array", "--count", "4", "--out", "out", cwd=tmp_path)
    assert done.exit_code == 0, done.stderr
    assert "90 % of the inertia about x is reached with 3 modes" in done.stdout
    assert {p.name for p in (tmp_path / "out").glob("[!.]*")} == {
        "modes.csv",
        "modes.png",
        "report.html",
    }
    report = (tmp_path / "out" / "report.html").read_text().replace("<wbr>", "")
    assert "://" not in report
    for words in (
        "In motion",
        "Convergence",
        "Second-order terms",
        "Effective mass in six directions",
        "hinges.root.0.position",
    ):
        assert words in report
    again = microvib("modes", "out/modes.csv", "--count", "3", "--out", "table", cwd=tmp_path)
    assert again.exit_code == 0, again.stderr
    assert "Mx" in again.stdout
    assert {p.name for p in (tmp_path / "table").glob("[!.]*")} == {"modes.csv", "report.html"}
    full = microvib("modes", "reference-array", "--out", "out", cwd=tmp_path)
    assert full.exit_code == 1
    assert "(--overwrite)" in full.stderr


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            "reference-arry",
            "is not a source of modes; allowed are reference-array, reference-sas, a description",
        ),
        ("none.yaml", "no such file"),
        ("none.csv", "cannot be read"),
    ],
)
def test_a_wrong_source_of_modes(tmp_path, source, words):
    done = microvib("modes", source, cwd=tmp_path)
    assert done.exit_code == 1
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "option", [("--damping", "2 percent"), ("--drive-axis", "y", "--units", "SI")]
)
def test_options_of_an_import_are_refused_where_nothing_is_imported(tmp_path, option):
    done = microvib("modes", "reference-array", *option, cwd=tmp_path)
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith(
        "Error: reference-array: needs no options; units, interface, axis and damping are for .op2"
    )


def test_a_steady_run_starts_in_its_steady_state(tmp_path):
    (tmp_path / "drive.yaml").write_text(mv.dump_scenario(baseline()))
    done = microvib("run", "drive.yaml", *SHORT, "--steady", "--out", "steady", cwd=tmp_path)
    assert done.exit_code == 0, done.stderr
    assert "Steady state: repeats every 0.3 s (16 microsteps)" in done.stdout
    assert sorted(p.name for p in (tmp_path / "steady").glob("[!.]*")) == BOLTED
    lines = rows(tmp_path / "steady")
    assert float(lines["drive_1"]["amplitude_n_m"]) == pytest.approx(0.05422, rel=0.01)
    assert lines["array_mode_1"]["status"] == "not in a steady state"
    assert (
        json.loads((tmp_path / "steady" / "summary.json").read_text())["solver"]["multiplier"] < 1.0
    )


def test_a_steady_run_that_cannot_be_says_so_and_runs_in_time(tmp_path):
    uneven = ["--set", "friction.position={harmonics: [{order: 1, amplitude: 0.05}]}"]
    done = microvib(
        "run",
        "state-1",
        *SHORT,
        *uneven,
        "--steady",
        "--lines-only",
        "--out",
        "lines",
        cwd=tmp_path,
    )
    assert done.exit_code == 0, done.stderr
    assert (
        "No steady state: friction that varies with the angle does not repeat with the command"
        in done.stdout
    )
    assert "friction.position: null leaves it out" in done.stdout
    assert "record.start" not in done.stdout
    summary = json.loads((tmp_path / "lines" / "summary.json").read_text())
    assert summary["solver"]["steady"].startswith("not used: friction that varies")
    assert rows(tmp_path / "lines")["array_mode_1"]["status"] == "decaying"


def test_unusual_values_are_told_once_on_standard_error(tmp_path):
    done = microvib("show", "state-1", "--set", "array.modes.0.damping=50 %", cwd=tmp_path)
    assert done.exit_code == 0
    assert done.stderr.splitlines() == [
        "Note: state-1: array.modes.0.damping: 50 % is unusual; 0.01 % to 15 % is expected (modal damping ratio)"
    ]
    assert "damping: 0.5\n" in done.stdout


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            OptionError("model_error", "2 is not allowed"),
            "Error: --model-error: 2 is not allowed\n",
        ),
        (OptionError("fit", "is named twice", "a.b"), "Error: --fit a.b: is named twice\n"),
        (
            OptionError("band", "says where", remedy="limit"),
            "Error: --band: says where (--limit)\n",
        ),
        (
            MicrovibError("x: is full\ny: too", remedy="lines_only"),
            "Error: x: is full\nError: y: too (--lines-only)\n",
        ),
    ],
)
def test_options_are_named_as_they_are_typed_here_and_nowhere_below(error, words, capfd):
    assert "--" not in str(error)

    def command():
        raise error

    assert status_of(command) == 1
    assert capfd.readouterr().err == words
