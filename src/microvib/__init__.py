"""microvib: disturbance torque of a sun-tracking solar array, from the drive's data sheet to its
lines.

>>> import microvib as mv
>>> scenario = mv.load_scenario("state-1").with_({"tracking.clock_ratio": 0.994})
>>> motion = mv.simulate(scenario)
>>> table = mv.find_lines(motion)
>>> mv.plot(motion).savefig("state-1.png")
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # that of typing, whose import takes a tenth of the time that --help takes

# Loaded when first used: numerics and plotting take seconds to import, and `microvib --help` needs
# none of it.
_HOME = {
    "BandLimit": "io.band_limits",
    "ChannelError": "errors",
    "Limit": "signals.limit_curve",
    "LineError": "errors",
    "LineTable": "signals.line_table",
    "MicrovibError": "errors",
    "Motion": "solve.motion",
    "NotDifferentiable": "solve.steady.recorded",
    "NotPeriodic": "solve.steady.period",
    "ObjectError": "errors",
    "OptionError": "errors",
    "Recording": "testdata.recording",
    "RecordingError": "testdata.recording",
    "Scenario": "model.scenario",
    "ScenarioError": "errors",
    "Section": "testdata.section",
    "Si": "units",
    "SimulationError": "errors",
    "SynchronismLost": "errors",
    "accuracy": "analysis.accuracy",
    "analyse": "studies.analyse",
    "catalog_names": "io.scenario_file",
    "compare": "studies.compare",
    "coupled_modes": "model.linear",
    "dump_scenario": "io.scenario_file",
    "expected_lines": "model.expected",
    "envelope": "studies.envelope.study",
    "export_as": "export.exporting",
    "find_lines": "analysis.lines",
    "identify": "studies.identify.fit",
    "judge": "analysis.limits",
    "judge_bands": "studies.bands",
    "load_scenario": "io.scenario_file",
    "new_scenario": "io.new_scenario",
    "open_source": "io.sources",
    "plan_profile": "studies.profiles.plan",
    "plan_rates": "studies.rates",
    "plan_rates_by_pointing": "studies.rates_by_pointing",
    "plot": "reports.plots",
    "pointing_budget": "studies.budget.study",
    "psd": "analysis.spectra",
    "quiet": "studies.quiet.study",
    "rate_grid": "studies.rates",
    "read_limit": "io.limit_files",
    "read_band_limits": "io.band_limits",
    "read_recording": "io.recordings",
    "read_run": "io.runs",
    "read_source_sheet": "export.source_sheet",
    "run_scenario": "analysis.run",
    "simulate": "solve.simulate",
    "simulate_many": "solve.simulate",
    "spectrum": "analysis.spectra",
    "state_space": "export.state_space",
    "steady_state": "solve.steady.state",
    "track_orders": "studies.track",
    "waterfall": "analysis.spectra",
    "write_run": "reports.run.folder",
}
"""Module of each name."""

_FORMER = {
    "batch": ("solve.batch:simulate_torques", "simulate_many"),
    "budget": ("studies.budget.study:pointing_budget", "pointing_budget"),
    "lines": ("analysis.lines:find_lines", "find_lines"),
    "rates": ("studies.rates:plan_rates", "plan_rates"),
    "run": ("analysis.run:run_scenario", "run_scenario"),
    "steady": (
        "analysis.lines:steady_lines",
        'find_lines(scenario, start="steady"), or microvib.steady_state',
    ),
}
"""Object behind each former name, and the present name; former names go with the release after this one.
"""

if TYPE_CHECKING:
    __version__: str
    from microvib.analysis.accuracy import accuracy
    from microvib.analysis.limits import judge
    from microvib.analysis.lines import find_lines
    from microvib.analysis.run import run_scenario
    from microvib.analysis.spectra import psd, spectrum, waterfall
    from microvib.errors import (
        ChannelError,
        LineError,
        MicrovibError,
        ObjectError,
        OptionError,
        ScenarioError,
        SimulationError,
        SynchronismLost,
    )
    from microvib.export.exporting import export_as
    from microvib.export.source_sheet import read_source_sheet
    from microvib.export.state_space import state_space
    from microvib.io.band_limits import BandLimit, read_band_limits
    from microvib.io.limit_files import read_limit
    from microvib.io.named import catalog_names
    from microvib.io.new_scenario import new_scenario
    from microvib.io.recordings import read_recording
    from microvib.io.runs import read_run
    from microvib.io.scenario_file import dump_scenario, load_scenario
    from microvib.io.sources import open_source
    from microvib.model.expected import expected_lines
    from microvib.model.linear import coupled_modes
    from microvib.model.scenario import Scenario
    from microvib.reports.plots import plot
    from microvib.reports.run.folder import write_run
    from microvib.signals.limit_curve import Limit
    from microvib.signals.line_table import LineTable
    from microvib.solve.motion import Motion
    from microvib.solve.simulate import simulate, simulate_many
    from microvib.solve.steady.period import NotPeriodic
    from microvib.solve.steady.recorded import NotDifferentiable
    from microvib.solve.steady.state import steady_state
    from microvib.studies.analyse import analyse
    from microvib.studies.bands import judge_bands
    from microvib.studies.budget.study import pointing_budget
    from microvib.studies.compare import compare
    from microvib.studies.envelope.study import envelope
    from microvib.studies.identify.fit import identify
    from microvib.studies.profiles.plan import plan_profile
    from microvib.studies.quiet.study import quiet
    from microvib.studies.rates import plan_rates, rate_grid
    from microvib.studies.rates_by_pointing import plan_rates_by_pointing
    from microvib.studies.track import track_orders
    from microvib.testdata.recording import Recording, RecordingError
    from microvib.testdata.section import Section
    from microvib.units import Si

__all__ = [
    "BandLimit",
    "ChannelError",
    "Limit",
    "LineError",
    "LineTable",
    "MicrovibError",
    "Motion",
    "NotDifferentiable",
    "NotPeriodic",
    "ObjectError",
    "OptionError",
    "Recording",
    "RecordingError",
    "Scenario",
    "ScenarioError",
    "Section",
    "Si",
    "SimulationError",
    "SynchronismLost",
    "__version__",
    "accuracy",
    "analyse",
    "catalog_names",
    "compare",
    "coupled_modes",
    "dump_scenario",
    "envelope",
    "expected_lines",
    "export_as",
    "find_lines",
    "identify",
    "judge",
    "judge_bands",
    "load_scenario",
    "new_scenario",
    "open_source",
    "plan_profile",
    "plan_rates",
    "plan_rates_by_pointing",
    "plot",
    "pointing_budget",
    "psd",
    "quiet",
    "rate_grid",
    "read_band_limits",
    "read_limit",
    "read_recording",
    "read_run",
    "read_source_sheet",
    "run_scenario",
    "simulate",
    "simulate_many",
    "spectrum",
    "state_space",
    "steady_state",
    "track_orders",
    "waterfall",
    "write_run",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return _version()
    if name in _HOME:
        return getattr(import_module(f"microvib.{_HOME[name]}"), name)
    if name in _FORMER:
        return _former(name)
    raise AttributeError(f"module 'microvib' has no attribute {name!r}")


def _former(name: str) -> object:
    """Object behind a former name; gives a FutureWarning."""
    from warnings import warn

    path, new = _FORMER[name]
    text = f"microvib.{name} is called microvib.{new}; the old name goes with the next release"
    warn(text, FutureWarning, stacklevel=3)
    module, _, called = path.partition(":")
    return getattr(import_module(f"microvib.{module}"), called)


def _version() -> str:
    from importlib.metadata import (
        PackageNotFoundError,
        version,
    )  # a third of the time that --help takes

    try:
        return version("microvib")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"


def __dir__() -> list[str]:
    return sorted(__all__)
