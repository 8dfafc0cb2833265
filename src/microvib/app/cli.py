"""The command line. Commands import what they need when they run, so that help is instant."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from microvib import __version__
from microvib.app.modal_options import import_from, modal_options
from microvib.app.options import band_of, counts_of, quantity
from microvib.errors import MicrovibError, ScenarioError

# The matrices here are small: threads of BLAS would only wait for each other. Set before NumPy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from microvib.app.running import RunResult
    from microvib.model.scenario import Scenario
    from microvib.signals.lines import LineTable
    from microvib.signals.preparation import Preparation


_EXTRAS = {"pyfe3d": "fem", "pyyeti": "fem", "pyuff": "test-data", "nptdms": "test-data"}
"""Extra of the package that brings a library."""


class _Sentences(click.Group):
    """Turns errors meant for the user into sentences on standard error and an exit status."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MicrovibError as error:
            for line in str(error).splitlines():
                click.echo(f"Error: {line}", err=True)
            ctx.exit(1)
        except ModuleNotFoundError as error:
            extra = _EXTRAS.get((error.name or "").split(".")[0])
            if extra is None:
                raise
            click.echo(
                f"Error: this needs {error.name}, which is not installed; pip install 'microvib[{extra}]'", err=True
            )
            ctx.exit(1)
        except KeyboardInterrupt:
            click.echo("Interrupted; nothing was written.", err=True)
            ctx.exit(130)
        except MemoryError:
            click.echo("Error: memory is exhausted; shorten record.duration, or use --lines-only", err=True)
            ctx.exit(1)


@click.group(cls=_Sentences, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="microvib")
def main() -> None:
    """Disturbance torque of a sun-tracking solar array: from the drive's data sheet to its lines.

    Start with `microvib run state-1`, or write a file of your own with `microvib new my-drive.yaml`.
    """


_set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a dotted key, e.g. reducer.stiffness='9000 N*m/rad'.",
)


@main.command()
@click.argument("scenario")
@_set_option
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the results [default: the scenario's name].")
@click.option("--overwrite", is_flag=True, help="Replace a run that is in the folder already.")
@click.option("--lines-only", is_flag=True, help="No motion and no report: memory stays bounded however long the run.")
@click.option(
    "--harmonics", default=8, show_default=True, type=click.IntRange(1, 200), help="Members of each family of lines."
)
@click.option(
    "--steady", is_flag=True, help="Find the periodic steady state directly, without settling; lines are then exact."
)
def run(
    scenario: str, settings: tuple[str, ...], out: Path | None, overwrite: bool, lines_only: bool, harmonics: int,
    steady: bool,
) -> None:  # fmt: skip
    """Simulate SCENARIO (a file, or a catalog name) and write motion, lines, summary and report."""
    from microvib.app.running import run_scenario
    from microvib.io.results import check_folder, free_folder

    loaded = _load(scenario, settings)
    out = out or free_folder(Path(scenario).stem)
    check_folder(out, overwrite)
    with _progress() as progress:
        result = run_scenario(
            loaded,
            out,
            overwrite=overwrite,
            lines_only=lines_only,
            harmonics=harmonics,
            steady=steady,
            progress=progress,
        )
    _print_lines(loaded, result.table)
    if steady:
        click.echo(_steady_sentence(result))
    i = result.invariants
    click.echo(
        f"\nInvariants: torque forms {i.torque_forms:.1e}, energy balance {i.energy:.1e}, momentum {i.momentum:.1e}."
        f" {result.solver['simulated_s']:.4g} s simulated in {result.solver['wall_s']:.2g} s."
    )
    click.echo(f"Written: {', '.join(str(out / name) for name in result.files)}")


def _steady_sentence(result: RunResult) -> str:
    solver = result.solver
    if result.fallback:
        return f"\nNo steady state: {result.fallback}. Simulated from rest instead."
    return (
        f"\nSteady state: repeats every {solver['period_s']:.6g} s ({solver['period_microsteps']} microsteps); found with"
        f" {solver['periods_evaluated']:.3g} periods; of a deviation {solver['multiplier']:.3g} is left after a period."
    )


_prepare_option = click.option(
    "--prepare",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="How to prepare recordings: a YAML file with units, channels, cross_talk, axes, trimming, background.",
)
_channel_option = click.option(
    "--channel", default="Mz", show_default=True, help="Channel of a recording with the drive-axis torque."
)


@main.command()
@click.argument("a")
@click.argument("b")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for table and report [default: print only].")
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
@_channel_option
@_prepare_option
@click.option("--scenario", default="state-1", show_default=True, help="Which lines to look for in two recordings.")
def compare(
    a: str, b: str, out: Path | None, overwrite: bool, channel: str, prepare: Path | None, scenario: str
) -> None:
    """Compare the lines of A and B: each a scenario, run folder, recording, table of lines, paper-test or paper-simulation."""
    from microvib.app.studies import comparison_text, write_comparison
    from microvib.io.results import check_folder
    from microvib.studies.compare import compare as run_comparison

    if out is not None:
        check_folder(out, overwrite)
    with _progress() as progress:
        first, second, rows = run_comparison(
            a, b, scenario=scenario, channel=channel, preparation=_preparation(prepare), progress=progress
        )
    click.echo(comparison_text(first, second, rows))
    if out is not None:
        files = write_comparison(out, first, second, rows, overwrite)
        click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


@main.command()
@click.argument("source")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for tables and report [default: print only].")
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
@_channel_option
@_prepare_option
@click.option("--scenario", default="state-1", show_default=True, help="Which lines to look for in a recording.")
@click.option(
    "--window",
    type=click.Choice(["rectangular", "hann", "flat-top"]),
    default="hann",
    show_default=True,
    help="Window.",
)
@click.option(
    "--resolution", metavar="HZ", help="Bins of density and waterfall, such as '0.5 Hz' [default: 8 / record]."
)
@click.option("--band", "bands", multiple=True, metavar="LOW:HIGH", help="RMS of a band, such as '0.5:5 Hz'.")
def analyse(
    source: str, out: Path | None, overwrite: bool, channel: str, prepare: Path | None, scenario: str, window: Any,
    resolution: str | None, bands: tuple[str, ...],
) -> None:  # fmt: skip
    """Lines with uncertainties and spectra of SOURCE: a scenario, a run folder or a recording."""
    from microvib.app.analyses import analysis_text, write_analysis
    from microvib.io.results import check_folder
    from microvib.studies.analyse import analyse as run_analysis

    if out is not None:
        check_folder(out, overwrite)
    with _progress() as progress:
        analysis = run_analysis(
            source, scenario=scenario, channel=channel, preparation=_preparation(prepare), window=window,
            resolution=None if resolution is None else quantity("--resolution", resolution, "Hz"),
            bands=[band_of(text) for text in bands], progress=progress,
        )  # fmt: skip
    click.echo(analysis_text(analysis))
    if out is not None:
        files = write_analysis(out, analysis, overwrite)
        click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


@main.command()
@click.argument("scenario")
@_set_option
@click.option("--bench", default="force-table", show_default=True, help="Bench: a catalog name or a YAML file.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, help="Recording to write: .uff, .mat or .csv."
)
@click.option("--seed", default=1, show_default=True, help="Seed of the noise; the same seed gives the same recording.")
def measure(scenario: str, settings: tuple[str, ...], bench: str, output: Path, seed: int) -> None:
    """Predict what a six-component force table records of SCENARIO, and write it as a recording."""
    from microvib.io.recordings import check_output, write_recording
    from microvib.io.scenario_file import load_bench
    from microvib.studies.measure import measure as run_bench

    check_output(output)
    with _progress() as progress:
        recording = run_bench(_load(scenario, settings), load_bench(bench), seed=seed, progress=progress)
    write_recording(recording, output)
    for name, x in recording.channels.items():
        click.echo(f"{name}: RMS about the mean {x.std():.4g} {recording.units[name]}")
    for note in recording.notes:
        click.echo(note)
    click.echo(f"Written: {output}, {recording.samples} samples at {recording.sample_rate:g} Hz")


@main.command()
@click.argument("scenario")
@click.argument("evidence", nargs=-1, required=True)
@click.option(
    "--fit",
    "keys",
    multiple=True,
    required=True,
    metavar="KEY[=LOW:HIGH]",
    help="A parameter to identify, with its range.",
)
@_set_option
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for fit, scenario and report [default: print only]."
)
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
@_channel_option
@_prepare_option
@click.option(
    "--starts", default=96, show_default=True, type=click.IntRange(2, 100_000), help="Points of the global search."
)
@click.option(
    "--seed", default=1, show_default=True, help="Seed of the global search; the same seed gives the same result."
)
@click.option(
    "--model-error",
    default="0.4 percent",
    show_default=True,
    help="How far amplitudes are trusted beyond their own uncertainty (standard deviation).",
)
def identify(
    scenario: str, evidence: tuple[str, ...], keys: tuple[str, ...], settings: tuple[str, ...], out: Path | None,
    overwrite: bool, channel: str, prepare: Path | None, starts: int, seed: int, model_error: str,
) -> None:  # fmt: skip
    """Identify parameters of SCENARIO from EVIDENCE: recordings, tables of lines, or `paper` (Tables 5 and 6).

    Several tests at once, each with its own state: FILE@KEY=VALUE@KEY=VALUE, e.g. b.uff@array.inertia='15.69 kg*m^2'.
    """
    from microvib.app.studies import fit_text, write_fit
    from microvib.io.results import check_folder
    from microvib.io.scenario_file import parse_value
    from microvib.studies.evidence import read_evidence
    from microvib.studies.identify import identify as run_identification
    from microvib.studies.identify import parse_fit

    if out is not None:
        check_folder(out, overwrite)
    loaded = _load(scenario, settings)
    fit_keys = [parse_fit(loaded, key) for key in keys]
    preparation = _preparation(prepare)
    tests = []
    for item in evidence:
        source, *changes = item.split("@")
        changed = {key: parse_value(value) for key, _, value in (change.partition("=") for change in changes)}
        tests.append(
            (read_evidence(source, loaded.with_(changed) if changed else loaded, channel, preparation), changed)
        )
    trusted = quantity("--model-error", model_error, "")
    if not 0.0 < trusted <= 1.0:
        raise MicrovibError(
            f"--model-error: {model_error} is not allowed; it must be greater than 0 and at most 100 percent"
        )
    fit = run_identification(
        loaded, tests, fit_keys, seed=seed, starts=starts, model_error=trusted, progress=_best_so_far()
    )
    click.echo(fit_text(fit))
    if out is not None:
        files = write_fit(out, fit, overwrite)
        click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


def _preparation(file: Path | None) -> Preparation | None:
    from microvib.io.recordings import load_preparation

    return None if file is None else load_preparation(file)


def _best_so_far() -> Callable[[str, int, float, dict[str, float]], None] | None:
    """Every two seconds a line on standard error with the best fit so far, where that is a terminal."""
    if not sys.stderr.isatty():
        return None
    last = 0.0

    def report(stage: str, simulations: int, cost: float, best: dict[str, float]) -> None:
        nonlocal last
        if time.monotonic() - last > 2.0:
            last = time.monotonic()
            values = ", ".join(f"{key} {value:.4g}" for key, value in best.items())
            click.echo(f"{stage}: {simulations} simulations, cost {cost:.4g}; {values}", err=True)

    return report


@main.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for table and report [default: print only].")
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
def validate(out: Path | None, overwrite: bool) -> None:
    """Run all that the paper claims, and print it beside the paper's and the test's figures."""
    from microvib.app.validation import validation_text, write_validation
    from microvib.io.results import check_folder
    from microvib.studies.validate import validate as run_validation

    if out is not None:
        check_folder(out, overwrite)
    tell = (lambda text: click.echo(f"running {text}", err=True)) if sys.stderr.isatty() else None
    checks, states = run_validation(tell)
    click.echo(validation_text(checks))
    if out is not None:
        files = write_validation(out, checks, states, overwrite)
        click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


@main.command()
@click.argument("scenario")
@click.option("--from", "low", required=True, metavar="RATE", help="Lowest rate of the array, e.g. '0.01 deg/s'.")
@click.option("--to", "high", required=True, metavar="RATE", help="Highest rate of the array.")
@click.option("--count", default=200, show_default=True, type=click.IntRange(2, 10_000), help="Rates in the range.")
@click.option("--microsteps", metavar="N,N,...", help="Microsteps per full step to compare [default: the scenario's].")
@click.option("--limit", metavar="TORQUE", help="Largest line that is allowed, e.g. '10 mN*m'.")
@click.option("--band", metavar="LOW:HIGH", help="Look at lines in this band only, e.g. '0.5:5 Hz'.")
@click.option("--linear", is_flag=True, help="Linearised drive in closed form: instant, driving lines only.")
@_set_option
@click.option("--out", type=click.Path(path_type=Path), help="Folder for tables and pictures [default: print only].")
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
def rates(
    scenario: str, low: str, high: str, count: int, microsteps: str | None, limit: str | None, band: str | None,
    linear: bool, settings: tuple[str, ...], out: Path | None, overwrite: bool,
) -> None:  # fmt: skip
    """Plan the rate of SCENARIO: lines against modes over rate (Campbell diagram), forbidden and best rates."""
    import math

    from microvib.app.rates import linear_text, plan_text, write_plan
    from microvib.io.results import check_folder
    from microvib.studies.rates import plan_rates, rate_grid

    if out is not None:
        check_folder(out, overwrite)
    grid = rate_grid(quantity("--from", low, "rad/s"), quantity("--to", high, "rad/s"), count)
    most = None if limit is None else quantity("--limit", limit, "N*m")
    if most is not None and not most > 0.0:
        raise ScenarioError(f"--limit {limit}: must be greater than 0 N*m")
    within = (0.0, math.inf) if band is None else band_of(band)
    loaded = _load(scenario, settings)
    counts = (loaded.driver.microsteps,) if microsteps is None else counts_of(microsteps)
    with _progress("solving", "cases") as progress:
        plan = plan_rates(loaded, grid, counts, limit=most, band=within, linear=linear, progress=progress)
        text = linear_text(plan) if linear else ""
    click.echo("\n".join(filter(None, (plan_text(plan), text))))
    if out is not None:
        files = write_plan(out, plan, text, overwrite)
        click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


@main.command()
@click.argument("source")
@click.option("--count", type=click.IntRange(1, 2000), help="How many modes [default: 10; of a table, all].")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for table, pictures, report [default: the name].")
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
@modal_options
def modes(source: str, count: int | None, out: Path | None, overwrite: bool, **deck: str | None) -> None:
    """Modes of SOURCE as in the paper's Table 1: `reference-array`, `reference-sas`, a description of an array or a simulator,
    a table of modes, or results of Nastran or Ansys, for which the options say how the deck is meant.

    A scenario takes them as `array: {from: modes.csv}`, or directly as `array: {fem: reference-array, modes: 10}`.
    """
    from microvib.app.modes import table_text, write_modes
    from microvib.io.modal_sources import modal_source
    from microvib.io.results import check_folder, free_folder

    out = out or free_folder(f"{Path(source).stem}-modes")
    check_folder(out, overwrite)
    found = modal_source(source, count, options=import_from(Path(source), deck))
    click.echo(table_text(found))
    files = write_modes(out, found, overwrite)
    click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


@main.group()
def sas() -> None:
    """The solar array simulator: springs, arm and counterweights that stand for an array."""


@sas.command("size")
@click.option("--inertia", help="Inertia about the drive axis, e.g. '8.18 kg*m^2'.")
@click.option("--frequency", help="Torsional frequency, e.g. '1.19 Hz'.")
@click.option("--array", help="Stand for this array instead: a table of modes, a description, or reference-array.")
@click.option("--state", "states", multiple=True, metavar="F:J", help="A further state to reach, e.g. 1.19:15.69.")
@click.option("--states", "file", type=click.Path(path_type=Path), help="Table of them [default: the paper's Table 2].")
@click.option("--amplitude", default="2 deg", show_default=True, help="Largest angle between frame and plate.")
@click.option("--rate", default="0.06 deg/s", show_default=True, help="Rate at which the drive starts and stops.")
@click.option("--design", default="reference-sas", show_default=True, help="Simulator to set: a description.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for tables, drawing, report [default: sas].")
@click.option("--overwrite", is_flag=True, help="Replace results that are in the folder already.")
def sas_size(out: Path | None, overwrite: bool, **options: Any) -> None:
    """Size a simulator for --inertia and --frequency, or for --array, and say how it is set for further states.

    The folder's simulator.yaml is a source of modes: `microvib modes sas/simulator.yaml`, or `array: {fem: sas/simulator.yaml}`.
    """
    from microvib.app.sas import sized, sizing_text, write_sizing
    from microvib.io.results import check_folder, free_folder

    out = out or free_folder("sas")
    check_folder(out, overwrite)
    result = sized(**options)
    click.echo(sizing_text(result))
    files = write_sizing(out, result, overwrite)
    click.echo(f"\nWritten: {', '.join(str(out / name) for name in files)}")


@main.command()
def scenarios() -> None:
    """List the published scenarios of the catalog."""
    from microvib.io.scenario_file import catalog_names, load_scenario

    for name in catalog_names():
        loaded = load_scenario(name)
        mode = loaded.array.modes[0]
        click.echo(
            f"{name:10s} {loaded.title}: {loaded.array.inertia:g} kg m², first mode {mode.frequency:g} Hz [{loaded.source}]"
        )


@main.command()
@click.argument("scenario")
@_set_option
def show(scenario: str, settings: tuple[str, ...]) -> None:
    """Print SCENARIO complete, checked, with derived values."""
    from microvib.app.running import derived
    from microvib.io.scenario_file import dump_scenario

    loaded = _load(scenario, settings)
    click.echo(dump_scenario(loaded), nl=False)
    click.echo("\n# Derived:")
    for text in derived(loaded):
        click.echo(f"#   {text}")


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
def new(file: Path) -> None:
    """Write FILE, a commented scenario to start from. Never overwrites."""
    from microvib.errors import OutputError
    from microvib.io.scenario_file import catalog_text

    made = False
    try:
        with file.open("x", encoding="utf-8") as stream:
            made = True
            stream.write(catalog_text("new"))
    except FileExistsError:
        raise OutputError(f"{file}: exists already; nothing was written") from None
    except OSError as error:
        if made:
            file.unlink(missing_ok=True)
        raise OutputError(f"{file}: cannot be written: {error.strerror}") from None
    click.echo(f"Written: {file}. Edit it, then: microvib run {file}")


@main.command()
def schema() -> None:
    """Print the JSON Schema of scenario files."""
    from microvib.io.results import to_json
    from microvib.io.scenario_file import json_schema

    click.echo(to_json(json_schema()), nl=False)


def _load(source: str, settings: tuple[str, ...]) -> Scenario:
    from microvib.io.scenario_file import load_scenario, parse_value

    changes = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {setting}: KEY=VALUE is wanted, such as reducer.stiffness='9000 N*m/rad'")
        changes[key.strip()] = parse_value(value)
    return load_scenario(source, changes)


class _progress:
    """A progress bar on standard error where that is a terminal, and nothing otherwise."""

    def __init__(self, doing: str = "simulating", unit: str = "s") -> None:
        self._doing, self._unit = doing, unit

    def __enter__(self) -> Callable[[float, float], None] | None:
        self._bar: Any = None
        if not sys.stderr.isatty():
            return None
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f} of {task.total:.0f} " + self._unit),
        )
        self._bar = Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True)
        self._bar.start()
        task = self._bar.add_task(f"{self._doing} (compiles on first use)", total=None)
        last = 0.0

        def report(done: float, total: float) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last > 0.1 or done >= total:
                last = now
                text = "writing lines and report" if done >= total else self._doing
                self._bar.update(task, completed=done, total=total, description=text)

        return report

    def __exit__(self, *args: object) -> None:
        if self._bar is not None:
            self._bar.stop()


def _print_lines(loaded: Scenario, table: LineTable) -> None:
    from microvib.studies.paper import compare_with_paper, paper_state, standing

    click.echo(f"\n{loaded.title or 'Lines'}: amplitudes 0-to-peak\n")
    click.echo(table.text(notable=True))
    if not any(line.status in ("ok", "decaying", "growing") for line in table):
        click.echo("No line stands out: the record is too short, its sample rate too low, or nothing moves.")
    rows = compare_with_paper(loaded, table)
    if rows:
        click.echo(f"\nBeside the paper's Tables 5 and 6 (nearest bin, rectangular window), {standing(loaded)}:\n")
        click.echo(
            f"{'line':14s} {'test Hz':>9s} {'paper Hz':>10s} {'ours Hz':>9s} {'test N m':>10s} {'paper N m':>10s}"
            f" {'ours N m':>10s} {'paper %':>8s} {'ours %':>8s}"
        )
        for r in rows:
            click.echo(
                f"{r.line:14s} {r.test_hz:9.4f} {r.paper_hz:10.5f} {r.ours_hz:9.4f} {r.test_n_m:10.5f} {r.paper_n_m:10.6f}"
                f" {r.ours_n_m:10.6f} {100 * r.paper_error:+8.1f} {100 * r.our_error:+8.1f}"
            )
    elif paper_state(loaded) not in (None, 1):
        click.echo("\nThe paper tabulates the lines of state 1 only; for the other states it gives statements.")
