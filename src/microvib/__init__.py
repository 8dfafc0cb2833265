"""microvib: disturbance torque of a sun-tracking solar array, from the drive's data sheet to its lines.

>>> import microvib as mv
>>> scenario = mv.load_scenario("state-1").with_({"tracking.clock_ratio": 0.994})
>>> motion = mv.simulate(scenario)
>>> table = mv.lines(motion)
>>> mv.plot(motion).savefig("state-1.png")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

# Loaded when first used: numerics and plotting take seconds to import, and `microvib --help` needs none of it.
_HOME = {
    "Scenario": "microvib.model.scenario",
    "load_scenario": "microvib.io.scenario_file",
    "catalog_names": "microvib.io.scenario_file",
    "dump_scenario": "microvib.io.scenario_file",
    "simulate": "microvib.solve.simulate",
    "steady": "microvib.analysis.steady",
    "Motion": "microvib.solve.motion",
    "coupled_modes": "microvib.model.linear",
    "expected_lines": "microvib.model.expected",
    "lines": "microvib.analysis.lines",
    "accuracy": "microvib.analysis.accuracy",
    "spectrum": "microvib.analysis.lines",
    "plot": "microvib.reports.figures",
    "MicrovibError": "microvib.errors",
    "ScenarioError": "microvib.errors",
    "SimulationError": "microvib.errors",
    "SynchronismLost": "microvib.errors",
}

if TYPE_CHECKING:
    __version__: str
    from microvib.analysis.accuracy import accuracy
    from microvib.analysis.lines import lines, spectrum
    from microvib.analysis.steady import steady
    from microvib.errors import MicrovibError, ScenarioError, SimulationError, SynchronismLost
    from microvib.io.scenario_file import catalog_names, dump_scenario, load_scenario
    from microvib.model.expected import expected_lines
    from microvib.model.linear import coupled_modes
    from microvib.model.scenario import Scenario
    from microvib.reports.figures import plot
    from microvib.solve.motion import Motion
    from microvib.solve.simulate import simulate

__all__ = [
    "MicrovibError",
    "Motion",
    "Scenario",
    "ScenarioError",
    "SimulationError",
    "SynchronismLost",
    "__version__",
    "accuracy",
    "catalog_names",
    "coupled_modes",
    "dump_scenario",
    "expected_lines",
    "lines",
    "load_scenario",
    "plot",
    "simulate",
    "spectrum",
    "steady",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'microvib' has no attribute {name!r}")


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # a third of the time that --help takes

    try:
        return version("microvib")
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "0+unknown"


def __dir__() -> list[str]:
    return sorted(__all__)
