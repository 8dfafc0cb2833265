"""Lines at orders of the electrical period that no scenario expects.

All that a drive in steady motion does repeats with the electrical period. What a driver or a motor
has beyond its data sheet, such as errors of the references, therefore makes lines at its orders,
hundreds of them about the driving lines. Their frequencies are known as soon as the clock is, so that
each needs an amplitude and a phase alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.model.line_names import electrical_line
from microvib.model.record import PASSBAND
from microvib.signals.line_table import DETECTION_RATIO, Uncertainty
from microvib.signals.tones import JointFit, Tones, steady_tones
from microvib.signals.uncertainties import isolated_uncertainties

_PASSES = 4
"""Searches, each in what the one before has left: a floor among many lines is too high at first."""
_TOGETHER = 8
"""Neighbouring orders that are added to a fit at once, with all that is near them."""


@dataclass(frozen=True)
class FurtherOrders:
    """Lines at orders of the electrical period that are not expected, and the fit of all lines."""

    joint: JointFit
    lines: tuple[ExpectedLine, ...] = ()
    faint: frozenset[str] = frozenset()
    """Names of tones of the fit that other lines had raised above the floor, and that are not."""

    @property
    def expected_alone(self) -> JointFit:
        """The fit of all else, to what these lines leave of the spectrum."""
        names = {line.name for line in self.lines}
        tones = self.joint.tones
        mine = np.array([line.name in names for line in tones.lines], dtype=bool)
        faint = np.array([line.name in self.faint for line in tones.lines], dtype=bool)
        rest = self.joint.spectrum.without(tones.only(mine), self.joint.amplitudes[mine])
        return JointFit.of(rest, tones.only(~mine & ~faint))

    def uncertainties(self, ratio_spread: float) -> Uncertainty:
        """Uncertainties of the lines, each as if it were alone, since no neighbour is nearer than two
        lines are told apart; with the error of the clock (``with_clock_error``).
        """
        place = {line.name: k for k, line in enumerate(self.joint.tones.lines)}
        which = [place[line.name] for line in self.lines]
        alone = isolated_uncertainties(self.joint, which)
        mine = self.joint.tones.only(np.array(which, dtype=int))
        return with_clock_error(alone, mine, ratio_spread, self.joint.spectrum.duration)


def with_clock_error(
    known: Uncertainty, tones: Tones, ratio_spread: float, duration: float
) -> Uncertainty:
    """Uncertainties of ``tones`` (m,) at a known clock, and those that a clock gives them whose ratio
    has a deviation: it turns a phase at the first sample by the cycles of half the record, and hardly
    anything in its middle, of which the amplitudes tell.
    """
    clock = tones.clock
    own = np.array([line.frequency for line in tones.lines], dtype=float) * ratio_spread
    turned = math.pi * duration * own
    return replace(
        known,
        phase=np.where(clock, np.hypot(known.phase, turned), known.phase),
        frequency=np.where(clock, own, known.frequency),
    )


def further_orders(
    joint: JointFit,
    electrical: float,
    ratio: float,
    expected: Sequence[ExpectedLine],
    separation: float,
) -> FurtherOrders:
    """Lines at all orders of the ``electrical`` frequency [Hz] that stand above the floor where a fit
    has none and none is ``expected``.

    ``electrical`` is that of the record, at its clock ``ratio``. There is none that is nearer than
    the ``separation`` [bins] to a tone of the fit, nor any where orders are nearer to each other.
    """
    added: list[ExpectedLine] = []
    names = {line.name for line in expected}
    if electrical * joint.spectrum.duration < separation:
        return FurtherOrders(joint)
    for _ in range(_PASSES):
        found = [_line(k, electrical / ratio) for k in _standing(joint, electrical, separation)]
        lines = [line for line in found if line.name not in names]
        if not lines:
            break
        for first in range(0, len(lines), _TOGETHER):
            joint = joint.with_tones(steady_tones(lines[first : first + _TOGETHER], ratio))
        added += lines
    sizes = dict(zip((line.name for line in joint.tones.lines), joint.sizes, strict=True))
    floors = joint.rest.floors(np.array([line.frequency * ratio for line in added]))
    tall = np.array([sizes[line.name] for line in added]) > DETECTION_RATIO * floors
    seen = [line for line, there in zip(added, tall.tolist(), strict=True) if there]
    faint = frozenset(
        line.name for line, there in zip(added, tall.tolist(), strict=True) if not there
    )
    return FurtherOrders(joint, tuple(sorted(seen, key=lambda line: line.frequency)), faint)


def _line(order: int, electrical: float) -> ExpectedLine:
    f = order * electrical
    origin = f"electrical period, order {order}; not expected"
    return ExpectedLine(electrical_line(order), "electrical", f, f, f, origin)


def _standing(joint: JointFit, electrical: float, separation: float) -> list[int]:
    """Orders of the ``electrical`` frequency [Hz] at which what a fit leaves stands above its floor, far
    enough from the fit's tones.
    """
    rest, duration = joint.rest, joint.spectrum.duration
    highest = min(PASSBAND * rest.samples, rest.values.size - 2) / duration
    orders = np.arange(1, int(highest / electrical) + 1)
    cycles = orders * electrical * duration
    there = np.sort(joint.tones.frequency) * duration
    after = np.searchsorted(there, cycles)
    ends = np.concatenate([[-np.inf], there, [np.inf]])
    apart = np.minimum(cycles - ends[after], ends[after + 1] - cycles)
    orders, cycles = orders[apart >= separation], cycles[apart >= separation]
    below = np.floor(cycles).astype(int)
    height = np.maximum(rest.magnitude[below], rest.magnitude[below + 1])
    found: list[int] = orders[height > DETECTION_RATIO * rest.floors(cycles / duration)].tolist()
    return found
