"""The entry points of the solver: ``simulate(scenario)``, and ``simulate_many`` for lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, overload

from microvib.errors import (
    OptionError,
    SimulationError,
    error_context,
    expect_channel,
    expect_list,
)
from microvib.model.record import Start
from microvib.model.scenario import GivenScenario, as_scenario, with_start
from microvib.solve.integration import Progress, simulate_from_rest
from microvib.solve.motion import Motion

Channels = str | Sequence[str]
"""Channels to keep: one, or a list of them."""
ERRORS = ("raise", "return")
"""Allowed treatments of an error in ``simulate_many``."""


def simulate(
    scenario: GivenScenario,
    *,
    start: Start | None = None,
    channels: Channels | None = None,
    progress: Progress | None = None,
) -> Motion:
    """Simulate one motion over its record, sampled without aliasing.

    Samples are taken at ``record.settle + k / sample_rate``, through the filter that
    ``microvib.solve.sampling`` describes: flat to 0.35 of the sample rate.

    Parameters
    ----------
    scenario : Scenario, str or path
        What is simulated: a scenario, a name of the catalog, or the path of a scenario file.
    start : {"rest", "steady"}, optional
        How the motion begins: at rest, or in the steady state where there is one, and otherwise at
        rest; ``motion.solver["steady"]`` says which. Without it, as ``record.start`` says.
    channels : str or sequence of str, optional
        Channels to keep, such as ``"T_d"`` or ``["T_d", "omega_m"]``, which saves memory. Without
        it all are kept.
    progress : callable, optional
        Called as ``progress(done, total)`` with simulated seconds.

    Returns
    -------
    Motion
        Channels by name, (n,) each, modal ones (n, s), in SI units, at ``sample_rate`` [Hz].

    Raises
    ------
    SynchronismLost
        Where the motor no longer follows its command.
    SimulationError
        Where the solution does not stay finite.
    ScenarioError
        Where a name stands for no scenario, or ``start`` is another word.
    ChannelError
        For a channel that is not there, or that is made of others.

    Examples
    --------
    >>> import microvib as mv
    >>> motion = mv.simulate("state-1", channels="T_d")
    >>> motion["T_d"].shape
    (65536,)
    """
    scenario = with_start(as_scenario(scenario), start)
    kept = _kept_channels(channels)
    if scenario.record.start == "rest":
        return simulate_from_rest(scenario, progress=progress, channels=kept)
    from microvib.solve.steady.state import (
        find_steady,
    )  # which imports what a start from rest does without

    state, why = find_steady(scenario)
    if state is None:
        motion, said = (
            simulate_from_rest(scenario, progress=progress, channels=kept),
            f"not used: {why}",
        )
    else:
        motion, said = state.motion(progress=progress, channels=kept), "used"
    return replace(motion, solver={**motion.solver, "steady": said})


@overload
def simulate_many(
    scenarios: Sequence[GivenScenario],
    *,
    start: Start | None = None,
    channels: Channels | None = "T_d",
    errors: Literal["raise"] = "raise",
    progress: Progress | None = None,
) -> list[Motion]: ...


@overload
def simulate_many(
    scenarios: Sequence[GivenScenario],
    *,
    start: Start | None = None,
    channels: Channels | None = "T_d",
    errors: Literal["return"],
    progress: Progress | None = None,
) -> list[Motion | SimulationError]: ...


def simulate_many(
    scenarios: Sequence[GivenScenario],
    *,
    start: Start | None = None,
    channels: Channels | None = "T_d",
    errors: Literal["raise", "return"] = "raise",
    progress: Progress | None = None,
) -> list[Motion] | list[Motion | SimulationError]:
    """Simulate each of a list of scenarios; each motion is what ``simulate`` gives.

    One core is used; the interpreter's lock is released meanwhile, so that threads may share a
    list.

    Parameters
    ----------
    scenarios : sequence of Scenario, str or path
        What is simulated, each as ``simulate`` takes it.
    start : {"rest", "steady"}, optional
        How the motions begin, as in ``simulate``.
    channels : str or sequence of str, optional
        Channels to keep: the disturbance torque alone, unless others are named; None keeps all.
    errors : {"raise", "return"}
        What becomes of a simulation that fails: the error is raised, and says which scenario of the
        list it is of, counted from 0; or it stands in the list in place of the motion.
    progress : callable, optional
        Called as ``progress(done, total)`` with the number of scenarios.

    Returns
    -------
    list of Motion
        In the order of ``scenarios``; with ``errors="return"`` a SimulationError for each that
        failed.

    Raises
    ------
    SimulationError
        What ``simulate`` raises, unless errors are returned.
    MicrovibError
        For what is no list, no scenario or no channel, before anything is simulated.

    Examples
    --------
    >>> import microvib as mv
    >>> scenario = mv.load_scenario("state-1")
    >>> rates = ("0.05 deg/s", "0.06 deg/s")
    >>> motions = mv.simulate_many([scenario.with_({"tracking.rate": rate}) for rate in rates])
    >>> [motion["T_d"].size for motion in motions]
    [65536, 65536]
    """
    expect_list(scenarios, "scenarios", "['state-1', 'state-2']")
    if errors not in ERRORS:
        raise OptionError("errors", f"is not allowed; write one of {', '.join(ERRORS)}", errors)
    each = [with_start(as_scenario(one), start) for one in scenarios]
    kept = _kept_channels(channels)
    found: list[Motion | SimulationError] = []
    for k, scenario in enumerate(each):
        try:
            with error_context(f"scenario {k}"):
                found.append(simulate(scenario, channels=kept))
        except SimulationError as error:
            if errors == "raise":
                raise
            found.append(error)
        if progress is not None:
            progress(k + 1, len(each))
    return found


def _kept_channels(given: Channels | None) -> tuple[str, ...] | None:
    """Names of the channels that are kept; None for all."""
    if given is None:
        return None
    if isinstance(given, str):
        return (given,)
    expect_list(given, "channels", "['T_d', 'theta_l']")
    for name in given:
        expect_channel(name)
    return tuple(given)
