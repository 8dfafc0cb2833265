"""Figures that a search makes small: a line, a band, the RMS, lines over a limit curve, or a requirement on
the line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.analysis.margins import frequency_error_bound
from microvib.errors import OptionError, did_you_mean
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.limit_files import read_limit
from microvib.model.expected import ExpectedLine, expected_lines
from microvib.model.scenario import Scenario
from microvib.results import TORQUE, Measure
from microvib.signals.limit_curve import LimitCurve
from microvib.signals.line_fit import SEPARATION
from microvib.signals.line_table import part_ends, twelfth_octave
from microvib.studies.budget.figures import evaluate_metric
from microvib.studies.budget.files import Requirement, Requirements, Statistic, read_file
from microvib.studies.budget.sums import ratio_to_curve
from microvib.studies.quiet.measure import DriveLines, UntoldLine
from microvib.units import Si, within_band
from microvib.units import band as ends

OF_LIMIT = Measure("% of the limit", 0.01, "#.4g")
RMS = "rms"
HARMONICS = 8
"""Members of each family of lines."""
_ANY_FREQUENCY = 1e9


@dataclass(frozen=True)
class Objective:
    """One figure of a drive's lines, to be made small."""

    text: str
    """In words."""
    measure: Measure = TORQUE
    """Measure of the figure: torques [N m], or parts of a limit."""
    line: str = ""
    """Name of a line."""
    band: tuple[float, float] | None = None
    """Ends [Hz] of a band whose largest line counts."""
    curve: LimitCurve | None = None
    """A limit over frequency [N m]."""
    requirements: tuple[Requirement, ...] = ()
    """On the line of sight, of which that counts which is nearest to its limit. Levels are replaced by
    bounds, which are a hundredth of the work and no lower."""

    @property
    def is_rms(self) -> bool:
        """Whether all lines count together."""
        return not (self.line or self.band or self.curve or self.requirements)

    @property
    def sees_pointing(self) -> bool:
        """Whether it is of the line of sight."""
        return bool(self.requirements)

    def highest(self, scenario: Scenario) -> float:
        """Frequency [Hz] up to which a record of a drive must show its lines: the end of the band or of
        the limit; where the named line is in this drive, 0 where it has none; of all lines together
        that of the first of each family.
        """
        if self.band is not None:
            return self.band[1]
        if self.curve is not None:
            return self.curve.high
        lines = drive_lines(scenario)
        if self.line:
            return max((x.frequency for x in lines if x.name == self.line), default=0.0)
        first = [x.frequency for x in lines if x.name.endswith("_1") and x.of_clock]
        return max(first, default=0.0)

    def lowest(self, scenario: Scenario) -> float:
        """Frequency [Hz] down to which a record of a drive must resolve lines: the lower end of a band or a
        limit; where the named line is; infinite where it is all the same.
        """
        if self.line:
            named = (x.frequency for x in drive_lines(scenario) if x.name == self.line)
            return min(named, default=math.inf)
        return self._lowest

    def of(self, found: DriveLines) -> float:
        """The figure of some lines of a record that reaches all that it asks for: infinite where the
        drive does not follow its command, nan where lines that the record does not tell may decide it.

        A named line that the drive does not have is 0.
        """
        if found.problem:
            return math.inf
        if any(x.name == self.line for x in found.untold):
            return math.nan
        told = self._of_told(found)
        return math.nan if self._with_untold(found) > _ALIKE * told else told

    def most(self, found: DriveLines) -> float:
        """Upper bound of the figure, with what the record does not tell."""
        return math.inf if found.problem else max(self._of_told(found), self._with_untold(found))

    def least(self, found: DriveLines) -> float:
        """Lower bound of the figure of a steady motion, by what is shown of it."""
        return math.inf if found.problem else self._of_told(found.shown)

    def duration(self, found: DriveLines) -> float:
        """Length of record [s] that would tell the lines that leave the figure open; nan where no length
        is known to.
        """
        told = self._of_told(found)
        needed = [x.duration for x in found.untold if self._of_untold(x, found) > told]
        if self._of_slow(found) > told:
            needed.append(SEPARATION / max(self._lowest, LOWEST))
        return max((x for x in needed if math.isfinite(x)), default=math.nan)

    @property
    def _lowest(self) -> float:
        """Lowest frequency [Hz] that a band or a limit holds; infinite without one."""
        if self.band is not None:
            return self.band[0]
        return math.inf if self.curve is None else self.curve.low

    def _of_told(self, found: DriveLines) -> float:
        """The figure of lines that are told, and of what is left beside them where the objective asks."""
        if self.requirements:
            assert found.los is not None
            return self._part_of_limits(found.los_frequency, found.los)
        if self.curve is not None:
            return _over_curve(found, self.curve)
        if self.band is not None:
            return _largest_within(found, *self.band)
        if self.line:
            return _amplitude_of(self.line, found)
        return found.rms

    def _with_untold(self, found: DriveLines) -> float:
        """The figure, or at least as much as the largest of lines that are not told, if each of them has
        all that it may have.
        """
        if self.requirements:
            return self._pointing_with_untold(found)
        each = [self._of_untold(x, found) for x in found.untold]
        if self.is_rms:
            return math.hypot(found.rms, *(math.sqrt(0.5) * x for x in each))
        return max(self._of_slow(found), *each, 0.0)

    def _pointing_with_untold(self, found: DriveLines) -> float:
        assert found.los is not None
        untold = [x for x in found.untold if x.is_made and not x.is_faint]
        bounds = [x.los for x in untold if x.los is not None]
        frequency = np.append(found.los_frequency, [x.frequency for x in untold])
        return self._part_of_limits(frequency, np.vstack([found.los, *bounds]))

    def _of_untold(self, line: UntoldLine, found: DriveLines) -> float:
        """The most that a line which is not told gives the figure by itself; 0 where it does not count."""
        if self.line:
            return line.most if line.name == self.line else 0.0
        if not line.is_made or line.is_faint:
            return 0.0
        if self.requirements:
            return 0.0 if line.los is None else self._part_of_limits(line.frequency, line.los)
        if self.curve is not None:
            return float(line.most / _allowed(self.curve, np.array([line.frequency]))[0])
        if self.band is not None:
            return line.most if line.may_be_within(*self.band) else 0.0
        return line.most if line.frequency < found.left.resolution else 0.0

    def _of_slow(self, found: DriveLines) -> float:
        """The most that lines give which are too slow for the record."""
        if not self._lowest < found.left.resolution:
            return 0.0
        if self.curve is None:
            return found.left.slow
        return found.left.slow / float(self.curve.strictest(0.0, found.left.resolution))

    def _part_of_limits(self, frequency: Any, los: np.ndarray) -> float:
        at, angles = np.atleast_1d(frequency), np.atleast_2d(los)
        return max(part_of_limit(one, at, angles) for one in self.requirements)


_ALIKE = 1.01
"""Ratio of the bounds of a figure up to which it is known."""
LOWEST = 1e-6
"""Frequency [Hz] below which no band is resolved by any record."""


def _amplitude_of(name: str, found: DriveLines) -> float:
    """Amplitude of a line [N m], 0 where it is not told, or there is none."""
    sizes = dict(zip(found.names, found.amplitude.tolist(), strict=True))
    return float(sizes.get(name, 0.0))


def _largest_within(found: DriveLines, low: float, high: float) -> float:
    """Largest line of a band [Hz], or what is left in it beside the lines [N m]."""
    inside = within_band(found.frequency, low, high, frequency_error_bound(found.frequency))
    faint = (
        x.most for x in found.untold if x.is_faint and x.is_made and x.may_be_within(low, high)
    )
    return float(
        np.max(found.amplitude[inside], initial=max(found.left.tone(low, high), *faint, 0.0))
    )


def _over_curve(found: DriveLines, curve: LimitCurve) -> float:
    """Largest part of what a limit over frequency allows that a line has, or what is left beside the lines
    in each twelfth of an octave.
    """
    ratios = found.amplitude / _allowed(curve, found.frequency)  # 0 where nothing is limited
    faint = [x for x in found.untold if x.is_faint and x.is_made]
    bounds = np.array([x.most for x in faint]) / _allowed(
        curve, np.array([x.frequency for x in faint])
    )
    return float(max(np.max(ratios, initial=0.0), np.max(bounds, initial=_left_over(found, curve))))


def _left_over(found: DriveLines, curve: LimitCurve) -> float:
    """Largest part of a limit that what is left has in a twelfth of an octave."""
    left = found.left
    at = left.frequency[left.frequency > 0.0]
    if not at.size:
        return 0.0
    _, first = np.unique(twelfth_octave(at), return_index=True)
    low, high = part_ends(at[first])
    allowed = curve.strictest(low - left.resolution, high + left.resolution)
    return float(np.max(left.tone(low, high) / allowed))


def _allowed(curve: LimitCurve, frequency: np.ndarray) -> np.ndarray:
    """The least that a limit allows to lines [N m]; infinite where it limits nothing."""
    about = frequency_error_bound(frequency)
    return np.asarray(curve.strictest(frequency - about, frequency + about))


def part_of_limit(one: Requirement, frequency: np.ndarray, los: np.ndarray) -> float:
    """Part of its limit that a requirement's figure reaches with lines of one clock, (k,) [Hz] and
    complex (k, 2) [rad].
    """
    if one.curve is not None:
        return float(ratio_to_curve(one, frequency, np.abs(los)).max(initial=0.0))
    assert one.limit is not None
    clock = np.zeros(los.shape, dtype=int)
    return evaluate_metric(one, frequency, los, clock=clock) / one.limit


def parse_objective(
    given: str,
    scenario: Scenario,
    requirement: str | Path | None = None,
    files: FileAccess = WORKING_FOLDER,
) -> Objective:
    """Read an objective.

    Parameters
    ----------
    given : str
        ``rms``, the name of a line such as ``drive_1``, a band such as ``"0.5:150 Hz"``, or a CSV
        file of a limit over frequency, as of ``read_limit``.
    scenario : Scenario
        The drive, whose lines have names.
    requirement : str or path, optional
        File of requirements on the line of sight, as of ``microvib budget``; in place of ``given``.
    files : FileAccess
        Permission to open files.

    Raises
    ------
    OptionError
        For what is none of these.
    """
    if requirement is not None:
        return _pointing(files.under("requirement").path(str(requirement)), scenario)
    text = given.strip()
    if text == RMS:
        return Objective("RMS of all lines in the passband")
    if text.endswith(".csv") and files.folder is None:
        raise OptionError(
            "objective",
            f"names a file, and {files.refusal}; rms, a line such as drive_1, or a band such as"
            " '0.5:150 Hz' is expected",
            text,
        )
    if text.endswith(".csv"):
        file = files.under("objective").path(text)
        return _limit_curve(file, file.name if files.takes_names else "curve")
    if ":" in text:
        low, high = _band(text)
        return Objective(f"largest line from {low:g} to {high:g} Hz", band=(low, high))
    names = line_names(scenario)
    if text not in names:
        near = did_you_mean(text, names)
        limit = " a CSV file of a limit," if files.takes_names else ""
        raise OptionError(
            "objective",
            f"is not a line of this drive; {near}allowed are rms, a band such as '0.5:150 Hz',{limit}"
            f" or a line: {', '.join(names)}",
            text,
        )
    return Objective(f"line {text}", line=text)


def _band(text: str) -> tuple[float, float]:
    """Ends [Hz] of a band; OptionError names the objective that it is."""
    try:
        return ends(text)
    except OptionError:
        raise OptionError(
            "objective",
            "is not a band; two frequencies of which the second is higher are expected, such as"
            " '0.5:150 Hz'",
            text,
        ) from None


def line_names(scenario: Scenario) -> list[str]:
    """Names of the lines of a drive that an objective may be."""
    return [x.name for x in drive_lines(scenario)]


def drive_lines(scenario: Scenario) -> tuple[ExpectedLine, ...]:
    """Lines that a drive is expected to have, whatever its record shows."""
    return expected_lines(scenario, Si(_ANY_FREQUENCY), HARMONICS)


def _pointing(file: Path, scenario: Scenario) -> Objective:
    chosen = quickly_judged(read_file(file, Requirements).requirements, scenario)
    named = ", ".join(one.name or f"no. {k}" for k, one in enumerate(chosen, 1))
    return Objective(f"requirement nearest to its limit, of {named}", OF_LIMIT, requirements=chosen)


NO_LINE_OF_SIGHT = (
    "is on a line of sight, which this scenario has not; spacecraft.line_of_sight is expected"
)


def has_line_of_sight(scenario: Scenario) -> bool:
    """Whether a scenario has what requirements are on."""
    return scenario.spacecraft is not None and scenario.spacecraft.line_of_sight is not None


def quickly_judged(
    requirements: Sequence[Requirement], scenario: Scenario
) -> tuple[Requirement, ...]:
    """Requirements as many cases are compared by: a bound in place of a level, and no percentiles.

    OptionError where one lacks a window, or the scenario a line of sight.
    """
    if not has_line_of_sight(scenario):
        raise OptionError("requirement", NO_LINE_OF_SIGHT)
    for k, one in enumerate(requirements, 1):
        if one.incomplete:
            raise OptionError("requirement", f"lacks {one.incomplete}", one.name or f"no. {k}")
    return tuple(
        one.model_copy(update={"percentile": None, "statistic": _quick(one)})
        for one in requirements
    )


def _quick(one: Requirement) -> Statistic:
    """Statistic by which a search judges a requirement: a bound in place of a level."""
    if one.statistic == "level":
        return "bound"
    return one.statistic


def _limit_curve(file: Path, name: str) -> Objective:
    """Lines over a limit that a CSV file has, which is called ``name``."""
    try:
        curve = read_limit(file).torque_curve("a search")
    except OptionError as error:
        raise OptionError("objective", str(error).removeprefix("limit: ")) from None
    return Objective(f"lines over the limit {name}", OF_LIMIT, curve=curve)
