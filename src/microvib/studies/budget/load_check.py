"""Loads of a recording beside those of the scenario's own run: where they are of another size, one of the two
is wrong, and nothing is judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from microvib.analysis.short_way import BlockedLines
from microvib.model.coupling import blocked_load_method, rotation_to_hub_axes
from microvib.model.rigid import COMPONENTS
from microvib.signals.line_table import DETECTION_RATIO
from microvib.studies.budget.figures import AXES, line_weights
from microvib.studies.budget.files import Requirement
from microvib.studies.budget.recording_source import line_of_sight_by_load
from microvib.studies.budget.sources import (
    Contribution,
    Unobserved,
    both_errors,
    open_gap,
)
from microvib.studies.chain_filter import ChainFilter, LineRatio, find_filter

MAX_LOAD_RATIO = 4.0
"""Factor between a recording's loads and the scenario's own from which one of them is wrong;
assumed. Friction, gains and the array seldom change the loads of all lines together by more."""
_CLOCK_OFF_TOLD = 1e-3
"""Relative difference of a step clock from the scenario's from which it is reported."""
_COUNTS = 0.1
"""Part of the line of sight's motion from which a component counts in it."""
_UNLIKE_PART = 0.2
"""Part of a requirement's figure that lines of another size may make: 2 % of its value, since squares add."""
_WELL, _OF_LARGEST = 3.0, 1e-3
"""Times its floor from which a line of a component tells of filters, and part of the component's largest line."""
_MOST_NAMED = 3
_FACTORS = {
    1e-6: "a spurious factor of one millionth in unit or scale",
    1e-3: "N or N*m labelled as mN or mN*m",
    1.0 / 9.80665: "kgf taken for N",
    1.0 / 4.4482: "lbf taken for N",
    1.0 / 8.8507: "N*m labelled as lbf*in",
    4.4482: "N labelled as lbf",
    8.8507: "lbf*in taken for N*m",
    9.80665: "N labelled as kgf",
    1e3: "mN or mN*m taken for N or N*m",
    1e6: "uN or uN*m taken for N or N*m",
}
"""Ratios of a recording's loads to the scenario's where a unit is wrong, with the cause."""


@dataclass(frozen=True)
class ComparedLoads:
    """Lines of a recording that the scenario's own run has, too, with the loads of both in the array's axes."""

    names: tuple[str, ...]
    frequency: np.ndarray
    """[Hz], (k,)."""
    seen: np.ndarray
    """Which lines stand above the recording's floor, (k,)."""
    amplitude: np.ndarray
    """Recorded, (k, 6) [N, N m]."""
    floor: np.ndarray
    """Below which nothing is detected of each, (k, 6)."""
    own: np.ndarray
    """Amplitudes of the scenario's own run, (k, 6)."""
    own_phase: np.ndarray
    """Its phases as complex numbers of amplitude 1, (k, 6)."""
    los_by_load: np.ndarray
    """Line of sight by one of each load, (k, 6, 2) [rad/N, rad/(N m)]."""

    @property
    def least(self) -> np.ndarray:
        """Recorded amplitudes as small as their noise leaves them."""
        return np.maximum(self.amplitude - self.floor, 0.0)

    @property
    def most(self) -> np.ndarray:
        """Recorded amplitudes as large as their noise leaves them."""
        return self.amplitude + self.floor

    def size(self, loads: np.ndarray) -> np.ndarray:
        """Line of sight that each component makes by all lines that are seen together, of ``loads`` (k, 6):
        root sum of squares, (6,) [rad].
        """
        by_load = np.linalg.norm(self.los_by_load, axis=2) * loads
        return np.asarray(np.linalg.norm(by_load[self.seen], axis=0))

    @property
    def unlike_components(self) -> np.ndarray:
        """Numbers of the components whose lines together are of another size than the scenario's, of those by
        which more than a tenth of the line of sight's motion may come.
        """
        large, small, size = (self.size(x) for x in (self.least, self.most, self.own))
        counts = np.maximum(large, size) > _COUNTS * np.max([large, size])
        return np.flatnonzero(
            counts & ((large > MAX_LOAD_RATIO * size) | (MAX_LOAD_RATIO * small < size))
        )

    def unlike_lines(self, r: Requirement) -> tuple[str, ...]:
        """Why a requirement is not judged: lines in its band are of another size than the scenario's, and
        make a part of the figure that matters. Empty where they do not, and where whole components are.

        Looked at are lines that the own run has above the recording's floors: what noise hides says nothing.
        """
        if self.unlike_components.size:
            return ()
        los = np.linalg.norm(self.los_by_load[:, :, AXES[r.axis]], axis=2)
        weight = line_weights(r, self.frequency)[:, None] * los
        size = weight * np.maximum(self.own, self.least)
        lacks = MAX_LOAD_RATIO * self.most < self.own
        exceeds = (self.least > MAX_LOAD_RATIO * self.own) & (self.own > self.floor)
        part = _UNLIKE_PART * float(np.linalg.norm(size))
        unlike = np.where(lacks | exceeds, size, 0.0)
        if not np.linalg.norm(unlike) > part:
            return ()
        return tuple(
            self._in_words(np.where(one, size, 0.0))
            for one in (lacks, exceeds)
            if np.any(unlike[one])
        )

    def _in_words(self, size: np.ndarray) -> str:
        """A sentence without a stop on lines of another size; ``size`` (k, 6) of each, 0 of others."""
        order = np.argsort(-size, axis=None)[:_MOST_NAMED]
        named = [np.unravel_index(at, size.shape) for at in order if size.flat[at] > 0.0]
        told = ", ".join(self._line_in_words(int(k), int(j)) for k, j in named)
        if self.own[named[0]] > self.amplitude[named[0]]:
            what = f"less than 1/{MAX_LOAD_RATIO:g}"
            cause = "a low-pass in the chain (response of the preparation file), the passband, a unit, a quieter drive"
        else:
            what = f"more than {MAX_LOAD_RATIO:g} times"
            cause = "a resonance of the table, a unit, another rate, a louder drive"
        return (
            f"the recording has {what} of lines of the scenario's own run that matter here, such as {told};"
            f" possible causes are {cause}"
        )

    def _line_in_words(self, k: int, j: int) -> str:
        """A line of a component with the amplitudes of both."""
        unit = "N" if COMPONENTS[j].startswith("F") else "N*m"
        there = f"{self.amplitude[k, j]:.3g}"
        if self.amplitude[k, j] < self.floor[k, j]:
            there = f"at most {self.most[k, j]:.3g}"
        return f"{self.names[k]} of {COMPONENTS[j]} {there} for {self.own[k, j]:.3g} {unit}"


def compare_loads(recorded: Contribution, own: BlockedLines) -> ComparedLoads | None:
    """Lines of a recording beside the scenario's ``own``; None where they have none in common."""
    scenario, sought = recorded.scenario, recorded.sought
    if scenario is None or sought is None:
        return None
    both = [(k, own.names.index(name)) for k, name in enumerate(sought.names) if name in own.names]
    if not both:
        return None
    seen = np.array([sought.names[k] in recorded.names for k, _ in both], dtype=bool)
    mine, theirs = np.array(both).T
    turn, f = rotation_to_hub_axes(scenario), sought.frequency[mine]
    loads = own.loads[theirs] @ turn
    return ComparedLoads(
        tuple(sought.names[k] for k in mine),
        f,
        seen,
        sought.amplitude[mine],
        sought.floors[mine],
        np.abs(loads),
        np.exp(1j * np.angle(loads)),
        np.nan_to_num(line_of_sight_by_load(scenario, f, turn)).transpose(1, 0, 2),
    )


def with_filter_check(recorded: Contribution, own: BlockedLines) -> Contribution:
    """Lines of a recording, of which nothing is known where a filter of the measuring chain takes a part of them: one
    that amplitudes and phases of all lines beside the scenario's ``own`` tell, and that no preparation states.
    """
    scenario, loads = recorded.scenario, recorded.recorded
    if not recorded.chain_assumption or scenario is None or loads is None:
        return recorded
    if not scenario.driving_frequency:
        return recorded
    driver = scenario.driver
    repeats = scenario.driving_frequency / (driver.beats * driver.microsteps)
    ratios = list(_load_ratios(recorded, own))
    found = find_filter(tuple(ratio for _, ratio in ratios), repeats)
    if found is not None:
        return replace(recorded, gaps=(*recorded.gaps, _behind_filter(found, recorded.step_clock)))
    gaps = []
    for number, name in enumerate(COMPONENTS):
        of_channel = tuple(ratio for component, ratio in ratios if component == number)
        if of_channel and (found := find_filter(of_channel, repeats)) is not None:
            gaps.append(_behind_filter(found, recorded.step_clock, f"{name} of "))
    return replace(recorded, gaps=(*recorded.gaps, *gaps))


def _behind_filter(found: ChainFilter, step_clock: float, channel: str = "") -> Unobserved:
    """The gap of lines of all channels, or of one, that a filter takes a part of."""
    why = (
        f"{channel}the recording has the lines of the scenario's own run behind {found} (a response in the preparation"
        " file that takes it out, or states that there is none"
    )
    if off := off_clock_words(step_clock):
        why += f"; or the step clock, {off}, which moves lines beside a resonance"
    return open_gap(f"{why})", *found.taken_from)


def off_clock_words(ratio: float) -> str:
    """By how much a step clock is off the scenario's, of its ``ratio`` to it; empty where they agree."""
    if abs(ratio - 1.0) < _CLOCK_OFF_TOLD:
        return ""
    side = "above" if ratio > 1.0 else "below"
    return f"{100.0 * abs(ratio - 1.0):.2g} % {side} the scenario's"


def _load_ratios(recorded: Contribution, own: BlockedLines) -> Iterator[tuple[int, LineRatio]]:
    """Number of a component, and its recorded lines over the scenario's own, of those that both show well."""
    assert recorded.recorded is not None
    assert recorded.scenario is not None
    turn = rotation_to_hub_axes(recorded.scenario)
    loads, floors = recorded.recorded
    theirs = {name: own.loads[k] @ turn for k, name in enumerate(own.names)}
    largest = np.max(np.abs(own.loads @ turn), axis=0, initial=0.0)
    for name, f, mine, floor in zip(recorded.names, recorded.frequency, loads, floors, strict=True):
        its = theirs.get(name, np.zeros(6))
        shown = (np.abs(mine) > _WELL * floor) & (np.abs(its) > _WELL * floor)
        for j in np.flatnonzero(shown & (np.abs(its) > _OF_LARGEST * largest)).tolist():
            ratio = complex(mine[j] / its[j])
            off = float(floor[j] / np.abs(mine[j])) / DETECTION_RATIO
            yield j, LineRatio(float(f), ratio, off)


def with_load_check(recorded: Contribution, loads: ComparedLoads | None) -> Contribution:
    """Lines of a recording, of which nothing is known where its ``loads`` are of another size than the
    scenario's.

    Channels are compared one by one over the lines that both have. A wrong unit or scale makes a verdict of any
    kind wrong, so that nothing bounds these lines then, above or below.
    """
    if loads is None or not loads.unlike_components.size:
        return recorded
    unlike = loads.unlike_components
    ratio = (loads.size(loads.amplitude) / np.maximum(loads.size(loads.own), 1e-300))[unlike]
    told = ", ".join(f"{COMPONENTS[k]} {x:.3g}" for k, x in zip(unlike, ratio, strict=True))
    whole = float(np.exp(np.mean(np.log(np.maximum(ratio, 1e-300)))))
    near = min(_FACTORS, key=lambda factor: abs(math.log(factor / whole)))
    explains = abs(math.log(near / whole)) < math.log(2.0)
    if explains:
        cause = f"a factor of {near:.4g} would explain it, {_FACTORS[near]}"
    else:
        cause = "check units, rate and array"
    why = f"its lines in {told} times those of the scenario's own run ({cause})"
    relative_error = recorded.relative_errors + np.array([1.0, 0.0])[:, None, None]
    return replace(
        recorded,
        gaps=(*recorded.gaps, open_gap(why)),
        relative_error=np.minimum(relative_error, [[[1.0]], [[math.inf]]]),
    )


def with_phase_check(recorded: Contribution, loads: ComparedLoads | None) -> Contribution:
    """Lines of a recording that may as well have the phases between channels of the scenario's own run.

    A channel of the wrong sign, a drive that was mounted half a turn about its axis, or channels that are
    sampled one after another leave all amplitudes right, and loads that cancel add.
    """
    if loads is None or recorded.scenario is None or recorded.recorded is None:
        return recorded
    common = [
        (k, loads.names.index(name)) for k, name in enumerate(recorded.names) if name in loads.names
    ]
    if not common:
        return recorded
    mine, theirs = np.array(common).T
    f, amplitude = recorded.frequency[mine], np.abs(recorded.recorded[0][mine])
    in_hub_axes = (amplitude * loads.own_phase[theirs]) @ rotation_to_hub_axes(recorded.scenario).T
    los = blocked_load_method(recorded.scenario, f, in_hub_axes).los
    assert los is not None
    ratio = np.ones(recorded.los.shape)
    ratio[mine] = np.abs(los) / np.maximum(np.abs(recorded.los[mine]), 1e-300)
    by_phases = np.array([np.maximum(1.0 - ratio, 0.0), np.maximum(ratio - 1.0, 0.0)])
    return replace(recorded, relative_error=both_errors(recorded.relative_errors, by_phases))
