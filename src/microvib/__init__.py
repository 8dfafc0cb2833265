"""microvib: disturbance torque of a sun-tracking solar array, from the drive's data sheet to its
lines.

>>> import microvib as mv
>>> scenario = mv.load_scenario("state-1").with_({"tracking.clock_ratio": 0.994})
>>> motion = mv.simulate(scenario)
>>> table = mv.lines(motion)
>>> mv.plot(motion).savefig("state-1.png")
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # that of typing, whose import takes a tenth of the time that --help takes

# Loaded when first used: numerics and plotting take seconds to import, and `microvib --help` needs
# none of it.
_HOME = {
    "ChannelError": "errors",
    "Limit": "analysis.limits",
    "LineError": "errors",
    "LineTable": "signals.line_table",
    "MicrovibError": "errors",
    "Motion": "solve.motion",
    "ObjectError": "errors",
    "OptionError": "errors",
    "Recording": "testdata.recording",
    "Scenario": "model.scenario",
    "ScenarioError": "errors",
    "Si": "units",
    "SimulationError": "errors",
    "SynchronismLost": "errors",
    "accuracy": "analysis.accuracy",
    "batch": "solve.batch:simulate_torques",
    "budget": "studies.budget.study:pointing_budget",
    "catalog_names": "io.scenario_file",
    "compare": "studies.compare",
    "coupled_modes": "model.linear",
    "dump_scenario": "io.scenario_file",
    "expected_lines": "model.expected",
    "identify": "studies.identify.fit",
    "judge": "analysis.limits",
    "lines": "analysis.lines",
    "load_scenario": "io.scenario_file",
    "new_scenario": "io.new_scenario",
    "open_source": "io.sources",
    "plot": "reports.plots",
    "psd": "analysis.spectra",
    "rate_grid": "studies.rates",
    "rates": "studies.rates:plan_rates",
    "read_recording": "io.recordings",
    "read_run": "io.runs",
    "run": "analysis.run:solve_run",
    "simulate": "solve.simulate",
    "spectrum": "analysis.spectra",
    "steady": "analysis.lines",
    "waterfall": "analysis.spectra",
    "write_run": "reports.run.folder",
}
"""Module of each name, and what it is called there where that is another word."""

if TYPE_CHECKING:
    __version__: str
    from microvib.analysis.accuracy import accuracy
    from microvib.analysis.limits import Limit, judge
    from microvib.analysis.lines import lines, steady
    from microvib.analysis.run import solve_run as run
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
    from microvib.signals.line_table import LineTable
    from microvib.solve.batch import simulate_torques as batch
    from microvib.solve.motion import Motion
    from microvib.solve.simulate import simulate
    from microvib.studies.budget.study import pointing_budget as budget
    from microvib.studies.compare import compare
    from microvib.studies.identify.fit import identify
    from microvib.studies.rates import plan_rates as rates
    from microvib.studies.rates import rate_grid
    from microvib.testdata.recording import Recording
    from microvib.units import Si

__all__ = [
    "ChannelError",
    "Limit",
    "LineError",
    "LineTable",
    "MicrovibError",
    "Motion",
    "ObjectError",
    "OptionError",
    "Recording",
    "Scenario",
    "ScenarioError",
    "Si",
    "SimulationError",
    "SynchronismLost",
    "__version__",
    "accuracy",
    "batch",
    "budget",
    "catalog_names",
    "compare",
    "coupled_modes",
    "dump_scenario",
    "expected_lines",
    "identify",
    "judge",
    "lines",
    "load_scenario",
    "new_scenario",
    "open_source",
    "plot",
    "psd",
    "rate_grid",
    "rates",
    "read_recording",
    "read_run",
    "run",
    "simulate",
    "spectrum",
    "steady",
    "waterfall",
    "write_run",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        return _version()
    if name in _HOME:
        module, _, called = _HOME[name].partition(":")
        return getattr(import_module(f"microvib.{module}"), called or name)
    raise AttributeError(f"module 'microvib' has no attribute {name!r}")


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
