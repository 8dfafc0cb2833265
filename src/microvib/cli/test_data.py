"""Commands that work with test data: analyse, compare, measure, identify."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from microvib.cli.common import (
    PATH,
    Target,
    band_limit_options,
    load,
    load_guide,
    parse_limit,
    read_bands,
    read_preparation,
    recording_limit_options,
    recording_options,
    section_options,
    set_option,
    target_options,
    with_precompilation,
)
from microvib.cli.progress import progress_bar
from microvib.cli.streams import INTERRUPTED, echo
from microvib.errors import OptionError
from microvib.units import quantity


@click.command()
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True)
@target_options("Folder for tables and report [default: print only].")
@recording_options
@click.option(
    "--scenario",
    help="Scenario of the recorded drive, which predicts its lines [default: none].",
)
@click.option(
    "--step-rate",
    metavar="RATE",
    help="Steps per second of the recorded motor, in place of a scenario, such as '4000 Hz': gives a table of orders.",
)
@click.option(
    "--steps-per-period",
    type=click.IntRange(1, 1_000_000),
    default=4,
    show_default=True,
    help="Steps of that rate per electrical period: of a two-phase motor 4 x microsteps per full step.",
)
@click.option(
    "--window",
    type=click.Choice(["rectangular", "hann", "flat-top"]),
    default="hann",
    help="Window of the spectra.",
)
@click.option(
    "--resolution",
    metavar="HZ",
    help="Bin width of density and waterfall, such as '0.5 Hz' [default: 8 / record].",
)
@click.option(
    "--band",
    "bands",
    multiple=True,
    metavar="LOW:HIGH",
    help="Also give the RMS in this band, such as '0.5:5 Hz'.",
)
@click.option(
    "--average",
    type=click.Choice(["none", "linear", "peak-hold", "exponential"]),
    default="none",
    help="Average of amplitude spectra of stretches of 1 / resolution; none: one spectrum of all samples.",
)
@click.option(
    "--overlap",
    type=click.FloatRange(0.0, 0.95),
    default=0.5,
    help="Part of a stretch that the next one shares.",
)
@section_options
@band_limit_options
@recording_limit_options
def analyse(
    sources: tuple[str, ...], channel: str, prepare: Path | None, scenario: str | None, step_rate: str | None,
    steps_per_period: int, window: Any, resolution: str | None, bands: tuple[str, ...], average: Any, overlap: float,
    start: str | None, stop: str | None, trigger: str | None, pre_trigger: str | None, band_file: Path | None,
    roll_off: float | None, limit: str | None, limit_band: str | None, target: Target,
) -> None:  # fmt: skip
    """Find lines with uncertainties, and spectra, in each SOURCE: a scenario, a run folder or a
    recording; of several, with one table of mean, spread and outliers;
    --limit judges the lines of recordings.
    """
    from microvib.io.sources import open_source
    from microvib.reports.analysis import analysis_outcome
    from microvib.reports.batch import batch_outcome
    from microvib.studies.analyse import analyse as run_analysis
    from microvib.studies.analyse import section_of
    from microvib.studies.batch import batch_of
    from microvib.studies.recording_limits import judge_recording
    from microvib.testdata.section import Section

    section = Section.stated(start, stop, trigger, pre_trigger)
    limits = read_bands(band_file, roll_off)
    allowed = parse_limit(limit, limit_band, "limit_band")
    prepared, guide = read_preparation(prepare), load_guide(scenario)
    found, outcomes = [], []
    for source in sources:
        opened, judged = section_of(open_source(source, prepared), section), None
        if allowed is not None:
            judged = judge_recording(opened, allowed, channel=channel, scenario=guide)
        with progress_bar() as progress:
            analysis = run_analysis(
                opened,
                name=source,
                scenario=guide,
                channel=channel,
                step_rate=step_rate,
                steps_per_period=steps_per_period,
                window=window,
                resolution=resolution,
                bands=bands,
                average=average,
                overlap=overlap,
                band_limits=limits,
                roll_off=roll_off,
                progress=progress,
            )
        found.append(analysis)
        outcomes.append(analysis_outcome(analysis, judged))
    if len(found) == 1:
        target.present(outcomes[0])
    else:
        target.present(batch_outcome(batch_of(sources, found), outcomes))


@click.command()
@click.argument("a")
@click.argument("b")
@target_options("Folder for table and report [default: print only].")
@recording_options
@click.option(
    "--scenario", help="Scenario of the recorded drive, if neither A nor B is a scenario."
)
@click.option(
    "--band",
    "bands",
    multiple=True,
    metavar="LOW:HIGH",
    help="Compare only lines in this band, such as '0.5:200 Hz'.",
)
@recording_limit_options
def compare(
    a: str, b: str, channel: str, prepare: Path | None, scenario: str | None, bands: tuple[str, ...],
    limit: str | None, limit_band: str | None, target: Target,
) -> None:  # fmt: skip
    """Compare the lines of A and B, each of them a scenario, run folder, recording, table of lines,
    or the reference lines of a scenario (state-1:measured, state-1:model)."""
    from microvib.io.sources import open_source
    from microvib.reports.comparison import comparison_outcome
    from microvib.studies.compare import compare as run_comparison
    from microvib.studies.recording_limits import judge_sides

    prepared, allowed = read_preparation(prepare), parse_limit(limit, limit_band, "limit_band")
    first = open_source(a, prepared)
    if a == b:
        second = first
    else:
        second = open_source(b, prepared)
    guide = load_guide(scenario)
    with progress_bar() as progress:
        found = run_comparison(
            first,
            second,
            names=(a, b),
            scenario=guide,
            channel=channel,
            bands=bands,
            progress=progress,
        )
    judged = judge_sides((first, second), allowed, channel, guide)
    target.present(comparison_outcome(*found, judged=judged))


@click.command()
@click.argument("scenario")
@set_option
@click.option("--bench", default="force-table", help="Bench: a catalog name or a YAML file.")
@click.option(
    "-o", "--output", type=PATH, required=True, help="Recording to write: .uff, .mat or .csv."
)
@click.option(
    "--seed", default=1, help="Seed of the noise; the same seed gives the same recording."
)
@recording_limit_options
@with_precompilation
def measure(
    scenario: str, settings: tuple[str, ...], bench: str, output: Path, seed: int,
    limit: str | None, limit_band: str | None,
) -> None:  # fmt: skip
    """Predict what a six-component force table records of SCENARIO, and write it as a recording."""
    from microvib.io.recordings import check_output, write_recording
    from microvib.io.scenario_file import load_bench
    from microvib.studies.measure import measure as run_bench
    from microvib.studies.recording_limits import judge_components

    check_output(output)
    allowed = parse_limit(limit, limit_band, "limit_band")
    tested = load(scenario, settings)
    with progress_bar() as progress:
        recording = run_bench(tested, load_bench(bench), seed=seed, progress=progress)
    write_recording(recording, output)
    for name, x in recording.channels.items():
        echo(f"{name}: RMS about the mean {x.std():.4g} {recording.units[name]}")
    for note in recording.notes_on(f"M{tested.array.drive_axis}"):
        echo(note)
    if allowed is not None:
        for judged in judge_components(recording, allowed, tested):
            echo(str(judged))
    echo(
        f"The file does not say so: where it is analysed, bench: {bench} in the preparation file"
        " does (--prepare)."
    )
    echo(f"Written: {output}, {recording.samples} samples at {recording.sample_rate:g} Hz")


@click.command()
@click.argument("scenario")
@click.argument("evidence", nargs=-1, required=True)
@click.option(
    "--fit",
    "keys",
    multiple=True,
    required=True,
    metavar="KEY[=LOW:HIGH]",
    help="Parameter to identify, with its range; of an integer, every value in the range is tried.",
)
@set_option
@target_options("Folder for fit, scenario and report [default: print only].")
@recording_options
@click.option(
    "--band",
    "bands",
    multiple=True,
    metavar="LOW:HIGH",
    help="Fit only to lines in this band, such as '0.5:200 Hz'.",
)
@click.option(
    "--share",
    multiple=True,
    metavar="KEY[,KEY]",
    help="With several recordings: fitted keys that share one value; all others are fitted per recording [default: all shared].",
)
@click.option(
    "--select",
    multiple=True,
    metavar="EFFECT[,EFFECT]",
    help="Effects to add to the model and fit if the evidence supports them, such as motor.detent_torque; or all."
    " False-alarm rates are known for detent torque, driver errors, bits and presliding; take other effects as a hint.",
)
@click.option("--without", multiple=True, metavar="LINE", help="A line to leave out, by its name.")
@click.option(
    "--starts", default=96, type=click.IntRange(2, 100_000), help="Points of the global search."
)
@click.option(
    "--seed", default=1, help="Seed of the global search; the same seed gives the same result."
)
@click.option(
    "--model-error",
    default="0.4 percent",
    help="Model error of each amplitude, in addition to its own uncertainty (standard deviation).",
)
@click.option(
    "--common-error",
    default="0 percent",
    help="Scale error of a recording, common to all its amplitudes (standard deviation).",
)
@click.option(
    "--chain-error",
    default="0 percent",
    help="Gain error of the measuring chain, which lines near each other share, in all recordings (standard deviation).",
)
@click.option(
    "--chain-width",
    metavar="FREQUENCY",
    default="2 Hz",
    help="How far apart lines are that still share the chain's error.",
)
@click.option(
    "--settle-error",
    metavar="TIME",
    help="Error of record.settle, the time before a recording (standard deviation) [default: not known].",
)
@with_precompilation
def identify(
    scenario: str, evidence: tuple[str, ...], keys: tuple[str, ...], settings: tuple[str, ...], channel: str,
    prepare: Path | None, bands: tuple[str, ...], without: tuple[str, ...], starts: int, seed: int, model_error: str,
    common_error: str, chain_error: str, chain_width: str, settle_error: str | None, share: tuple[str, ...],
    select: tuple[str, ...], target: Target,
) -> None:  # fmt: skip
    """Identify parameters of SCENARIO from EVIDENCE: recordings, tables of lines, or measured
    reference lines (state-1:measured).

    Several tests at once, each with its own state: FILE@SCENARIO, FILE@KEY=VALUE@KEY=VALUE or both,
    e.g. b.uff@state-2 or b.uff@array.inertia='15.69 kg*m^2'@record.settle='12 s'.
    """
    from microvib.io.scenario_file import parse_value
    from microvib.io.sources import open_source
    from microvib.reports.identification import fit_outcome
    from microvib.studies.evidence import evidence_of, select_evidence
    from microvib.studies.identify import effects_of, parse_key, with_effects
    from microvib.studies.identify import identify as run_identification

    loaded = load(scenario, settings)
    fit_keys = [parse_key(loaded, key) for key in keys]
    each, common, chain = (
        _parse_relative_sd("model_error", model_error, 0.0),
        _parse_relative_sd("common_error", common_error, -1.0),
        _parse_relative_sd("chain_error", chain_error, -1.0),
    )
    width = quantity("chain_width", chain_width, "Hz", positive=True)
    prepared = read_preparation(prepare)
    effects = effects_of(_split_names(select))
    read, owned, tests = [], [], []
    for item in evidence:
        name, own = _parse_source(item)
        scenarios = [one for one in own if "=" not in one]
        changes = {
            key: parse_value(value)
            for key, equals, value in (one.partition("=") for one in own)
            if equals
        }
        if scenarios:
            test = load(scenarios[-1], settings)
        else:
            test = loaded
        tests.append(test.with_(changes) if changes else test)
        owned.append(tests[-1] if scenarios else changes)
        tests[-1] = with_effects(tests[-1], effects, effects)  # whose lines are to be looked for
        read.append(evidence_of(open_source(name, prepared), tests[-1], channel, name))
    told = list(zip(select_evidence(read, tests, bands, without), owned, strict=True))
    with progress_bar("searching") as progress:
        fit = run_identification(
            loaded, told, fit_keys, share=_split_names(share) or None, select=effects, seed=seed, starts=starts,
            model_error=each, common_error=common, chain_error=chain, chain_width=width,
            settle_error=settle_error, progress=_best_so_far(progress),
        )  # fmt: skip
    target.present(fit_outcome(fit, loaded))
    if fit.interrupted:
        sys.exit(INTERRUPTED)


def _parse_source(item: str) -> tuple[str, list[str]]:
    """Name and what stands behind it, parted by @; those of a file that is there are its own."""
    parts = item.split("@")
    whole = (k for k in range(len(parts), 0, -1) if Path("@".join(parts[:k])).exists())
    k = next(whole, 1)
    return "@".join(parts[:k]), parts[k:]


def _split_names(given: tuple[str, ...]) -> list[str]:
    """Names that were given one by one, or with commas."""
    return [name.strip() for names in given for name in names.split(",")]


def _parse_relative_sd(option: str, text: str, above: float) -> float:
    """A relative standard deviation above ``above``, at most 1."""
    value = quantity(option, text, "")
    if not above < value <= 1.0 or value < 0.0:
        if above < 0.0:
            least = "at least 0"
        else:
            least = "greater than 0"
        raise OptionError(
            option, f"{text} is not allowed; it must be {least} and at most 100 percent"
        )
    return value


def _best_so_far(progress: progress_bar) -> Callable[[str, int, float, dict[str, float]], None]:
    """The best fit so far, in the bar's words."""
    from microvib.reports.identification import values_text

    def report(stage: str, simulations: int, cost: float, best: dict[str, float]) -> None:
        found = f"{stage}: {simulations} simulations, cost {cost:.4g}; {values_text(best)}"
        progress.say(found if simulations else "searching (compiles on first use)")

    return report
