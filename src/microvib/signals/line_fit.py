"""Amplitude, frequency and phase of expected lines, wherever the bins fall.

1. Lines of the step clock have exact ratios to each other, so one clock ratio is estimated from all of them together
   (``microvib.signals.clock``).
2. Array modes ring down while they are recorded, so they are fitted as decaying tones; unexpected lines are searched for
   (``microvib.signals.line_search``).
3. Clock ratio and tones are refined in turn, until the lines stay where they are.
4. All amplitudes come from one least-squares fit to the bins about the lines, in which every line is present,
   and uncertainties from its residual (``microvib.signals.tones``).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from microvib.model.expected import ExpectedLine
from microvib.model.record import PASSBAND
from microvib.signals import tone_kernel as hann
from microvib.signals.clock import MAX_CLOCK_LINES, consistent_lines, estimate_clock_ratio
from microvib.signals.further_orders import FurtherOrders, further_orders, with_clock_error
from microvib.signals.line_search import MIN_DECAY_E_FOLDINGS, search
from microvib.signals.line_table import (
    BELOW_FLOOR,
    DETECTION_RATIO,
    IN_BACKGROUND,
    Line,
    LineEstimates,
    LineTable,
    MaskedLine,
    ResidualPeaks,
    Uncertainty,
)
from microvib.signals.orders import ClockOrders
from microvib.signals.spectrum import tone_amplitude
from microvib.signals.tones import (
    INTERACTION_DISTANCE,
    HannSpectrum,
    JointFit,
    Tones,
    amplitudes_in,
    known_decaying_tones,
    mean_of_decay,
    refine_clock_and_tones,
    steady_tones,
)
from microvib.signals.uncertainties import (
    isolated_uncertainties,
    poorly_fitted_tones,
    uncertainties,
    with_weighted_clock,
)

NOT_SEPARABLE = "not separable from"
SEPARATION = 2.5  # distance [bins] from which two lines can be told apart
# array modes that are fitted in one record: the work grows with the third power of their number
MAX_MODES = 300
_RANK = {"array mode": 1, "electrical": 2}
_ROUNDS = 3
_CLOCK_CONVERGENCE = (
    0.01  # movement [bins] of the highest line in a round below which the clock counts as found
)
_CROWDING_RATIO = 2.0
"""Standard uncertainty next to a larger line, over that without it, above which that line is given
as the reason.
"""
_SCALLOP = 1.18  # amplitude of a tone over its highest bin, at most
UNLISTED_LINE = "an unlisted line"
CANCELLED = f"{NOT_SEPARABLE} a line that it cancels; requires a longer record"
_CANCELLING_RATIO = 3.0
"""Tone that is fitted over what the record shows in its bins, above which others on almost the same
frequency cancel it."""
NO_ORDER = "not a low-order multiple of the driving frequency"
MAX_RELATIVE_UNCERTAINTY = 0.2  # standard uncertainty over amplitude above which a line cannot be resolved from its neighbour


def estimate_lines(
    x: np.ndarray,
    sample_rate: float,
    expected: Sequence[ExpectedLine],
    every_order: bool = False,
) -> LineTable:
    """Estimate the ``expected`` lines in the samples ``x`` (n,) [N m] taken at ``sample_rate``
    [Hz], and find further ones; with ``every_order`` all orders of the electrical period above the
    floor, where the clock is found.

    If none are expected, all lines above the noise floor are found, without names. If the bands of the clock's
    lines have a width, the clock is searched within them; otherwise it is known, as in a
    simulation.
    """
    joint, refused, ratio = _fit_all_lines(x, sample_rate, expected)
    if _is_searched(expected) and ratio is not None:
        joint, ratio = _with_weighted_clock(joint, expected, ratio)
    spread, ratio_spread = _spread(joint, expected, ratio)
    orders, further = ClockOrders.of(expected, ratio), FurtherOrders(joint)
    if every_order and orders is not None and ratio is not None:
        further = further_orders(joint, orders.electrical, ratio, expected, SEPARATION)
    if further.lines:
        # The clock stays as it was told, with these lines in its noise: beside them lines of the
        # clock tell it less than they would alone.
        joint = further.expected_alone
        spread = with_clock_error(
            uncertainties(joint)[0], joint.tones, ratio_spread or 0.0, joint.spectrum.duration
        )
    refused |= _inseparable_lines(joint, spread)
    joint, others = _name_unlisted_lines(joint, spread, orders)
    refused |= _cancelled_lines(joint)
    lines = (*_note_inseparable_modes(expected, refused), *others)
    rows = _figures(lines, joint, refused).rows(_uncertainties_by_line(spread, lines, joint.tones))
    if further.lines:
        alone = further.uncertainties(ratio_spread or 0.0)
        rows += _figures(further.lines, further.joint, {}).rows(alone)
    return LineTable(
        rows,
        ratio,
        ratio_spread,
        joint.spectrum.samples,
        sample_rate,
        rest=_residual_peaks(joint.rest),
    )


def _with_weighted_clock(
    joint: JointFit, expected: Sequence[ExpectedLine], ratio: float
) -> tuple[JointFit, float]:
    """``with_weighted_clock`` by all lines that agree on it."""
    return with_weighted_clock(joint, ratio, _lines_fixing_clock(joint, expected, ratio))


def _spread(
    joint: JointFit, expected: Sequence[ExpectedLine], ratio: float | None
) -> tuple[Uncertainty, float | None]:
    """Uncertainties, and that of the clock ratio: 0 of a clock that is known, None without one."""
    if ratio is None:
        return uncertainties(joint)
    if not _is_searched(expected):
        return uncertainties(joint)[0], 0.0
    return uncertainties(joint, ratio, _lines_fixing_clock(joint, expected, ratio))


_HANN_BINS = 2.0
"""Sum of the bins of a tone over its amplitude, in a spectrum with a Hann window."""


def _residual_peaks(rest: HannSpectrum) -> ResidualPeaks:
    """Residual peaks between the lowest frequency resolved from the mean and the highest examined."""
    first = int(SEPARATION) + 1
    bins = np.arange(first, min(int(PASSBAND * rest.samples), rest.values.size))
    frequency, amplitude = bins / rest.duration, _SCALLOP * rest.magnitude[bins]
    peaks = ResidualPeaks.of(frequency, amplitude)
    floor = rest.floors(peaks.frequency)
    slow = _SCALLOP * float(np.max(rest.magnitude[1:first], initial=0.0))
    return replace(
        peaks,
        floor=floor,
        together=peaks.sums(frequency, amplitude, DETECTION_RATIO * floor) / _HANN_BINS,
        slow=slow,
        resolution=SEPARATION / rest.duration,
    )


def lines_at_known_clock(
    x: np.ndarray,
    sample_rate: float,
    expected: Sequence[ExpectedLine],
    beside: LineTable | None = None,
) -> LineTable:
    """Lines of a simulated torque ``x`` (n,) [N m], whose clock is exactly the expected one,
    without uncertainties.

    Amplitudes, phases and decays are those of ``estimate_lines``, at a fraction of its time. What
    rings in another channel of the same motion, whose lines ``beside`` has, does so here with the
    same frequency and decay.
    """
    rings = () if beside is None else tuple(x for x in beside if x.is_mode and x.seen)
    figures = figures_at_known_clock(x, sample_rate, expected, rings)
    none = 0.0 * figures.amplitude
    return LineTable(
        figures.rows(Uncertainty(none, none, none, none)), 1.0, 0.0, np.size(x), sample_rate
    )


def modes_near_clock_lines(table: LineTable) -> LineTable:
    """Modes of a table so near a clock line that another channel resolves them only if they are known."""
    clock = [x.expected for x in table if x.of_clock]
    modes = (x for x in table if x.is_mode)
    near = (
        x for x in modes if any(abs(x.expected - f) * table.duration < SEPARATION for f in clock)
    )
    return replace(table, lines=tuple(near))


def tones_in_channels(
    xs: Sequence[np.ndarray],
    sample_rate: float,
    expected: Sequence[ExpectedLine],
    beside: LineTable,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines of a simulated motion in several channels ``xs`` at once, a tenth of the time of one
    after another.

    Complex amplitudes (lines, channels), frequencies [Hz] and decays [1/s], (lines,). Modes ring as
    in ``beside``, lines of another channel of the same motion; those that it does not show are nan.
    """
    spectra = [HannSpectrum.of(x - x.mean(), sample_rate) for x in xs]
    rings = {x.name: x for x in beside if x.is_mode and x.seen}
    wanted, _ = _resolvable_lines(expected, spectra[0].duration, rings)
    clock = steady_tones([line for line in wanted if not line.is_mode])
    tones = clock.and_those(
        known_decaying_tones([(line, rings[line.name]) for line in wanted if line.name in rings])
    )
    mean = mean_of_decay(tones.decay * spectra[0].duration)[0]
    found = np.append(
        amplitudes_in(spectra, tones) * mean[:, None], np.full((1, len(xs)), np.nan), axis=0
    )
    order = _order(expected, tones)
    return (
        found[order],
        _values_by_line(tones.frequency, order),
        _values_by_line(tones.decay, order),
    )


def figures_at_known_clock(
    x: np.ndarray, sample_rate: float, expected: Sequence[ExpectedLine], rings: Sequence[Line] = ()
) -> LineEstimates:
    """The figures of ``lines_at_known_clock`` as arrays, for many records."""
    known = [
        replace(line, low=line.frequency, high=line.frequency) if not line.is_mode else line
        for line in expected
    ]
    joint, refused, _ = _fit_all_lines(x, sample_rate, known, rings, everywhere=False)
    return _figures(expected, joint, refused)


def _fit_all_lines(
    x: np.ndarray,
    sample_rate: float,
    expected: Sequence[ExpectedLine],
    rings: Sequence[Line] = (),
    everywhere: bool = True,
) -> tuple[JointFit, dict[str, str], float | None]:
    """The one recipe: the clock, known or searched; what else stands in the record; all that is
    near each other together.

    ``rings`` are modes that are known to ring, and how. The fit, the names of lines without figures
    of their own with the reason, and the clock ratio.
    """
    x = np.asarray(x, dtype=float)
    spectrum = HannSpectrum.of(x - x.mean(), sample_rate)
    named = {line.name: line for line in rings}
    wanted, refused = _resolvable_lines(expected, spectrum.duration, named)
    clock = [line for line in wanted if not line.is_mode]
    known = known_decaying_tones(
        [(line, named[line.name]) for line in wanted if line.name in named]
    )
    modes = [line for line in wanted if line.is_mode and line.name not in named]
    modes, left_out = _strongest_modes(modes, spectrum)
    refused |= left_out
    searched = _is_searched(expected)
    # The clock is found in rounds: with the unlisted lines and modes that the search at one ratio
    # has found taken out, those of the clock tell a better ratio, at which the search may find
    # others. A known clock needs one round.
    if clock:
        if searched:
            ratio = estimate_clock_ratio(clock, spectrum)
        else:
            ratio = 1.0
    else:
        ratio = None
    for _ in range(_ROUNDS):
        orders = ClockOrders.of(expected, ratio)
        joint, hidden = search(
            JointFit.of(spectrum, steady_tones(clock, ratio or 1.0).and_those(known)),
            modes,
            orders,
            everywhere=everywhere,
        )
        tones = joint.tones
        if not searched or ratio is None:
            break
        before = ratio
        tones, ratio = refine_clock_and_tones(
            tones, spectrum, before, _lines_fixing_clock(joint, clock, before, MAX_CLOCK_LINES)
        )
        if (
            abs((ratio or 0.0) - before) * max(line.frequency for line in clock) * spectrum.duration
            < _CLOCK_CONVERGENCE
        ):
            break
    tones, refused = _reassign_unlisted_to_modes(
        tones, expected, refused, orders, spectrum.duration
    )
    return JointFit.of(spectrum, tones), refused | hidden, ratio


def _reassign_unlisted_to_modes(
    tones: Tones,
    expected: Sequence[ExpectedLine],
    refused: dict[str, str],
    orders: ClockOrders | None,
    duration: float,
) -> tuple[Tones, dict[str, str]]:
    """Unlisted tones where modes are expected that were held to be too near another line, as these
    modes.

    Of modes that are too near each other the one that is looked for may have taken another's peak:
    tones are given out anew, in the order of the modes and to those that they are nearest to.
    """
    lines, left, listed = list(tones.lines), dict(refused), {line.name for line in expected}
    unlisted = [
        i for i, line in enumerate(lines)
        if line.kind == "other" and line.name not in listed
        and not (orders and orders.name(float(tones.frequency[i]), 0.02 / duration))
    ]  # fmt: skip
    for group in _unresolved_mode_groups(expected, duration):
        names = [mode.name for mode in group]
        there = [i for i, line in enumerate(lines) if line.name in names]
        there += [
            i
            for i in unlisted
            if any(abs(mode.frequency - tones.frequency[i]) * duration < 0.5 for mode in group)
        ]
        refused_one = any(left.get(name, "").startswith(NOT_SEPARABLE) for name in names)
        if not refused_one or not 0 < len(there) <= len(group):
            continue
        there.sort(key=lambda i: float(tones.frequency[i]))
        chosen = _nearest(tones.frequency[there], group)
        for i, mode in zip(there, chosen, strict=True):
            lines[i] = mode
            left.pop(mode.name, None)
        _refuse_others(group, chosen, left)
    return replace(tones, lines=tuple(lines)), left


def _refuse_others(
    group: Sequence[ExpectedLine], chosen: Sequence[ExpectedLine], refused: dict[str, str]
) -> None:
    """Say of the modes of a group that were not ``chosen`` which of these they are too near to, unless
    another reason is told already.
    """
    names = [mode.name for mode in group]
    for mode in group:
        why = refused.get(mode.name)
        if mode in chosen or (why is not None and why.partition(";")[0].split()[-1] not in names):
            continue
        nearest = min(chosen, key=lambda x: abs(x.frequency - mode.frequency))
        refused[mode.name] = _too_near(mode, nearest)


def _nearest(frequency: np.ndarray, modes: Sequence[ExpectedLine]) -> list[ExpectedLine]:
    """As many of the ``modes``, in their order, as there are tones at each ``frequency``: those
    that all are nearest to.
    """
    from scipy.optimize import linear_sum_assignment  # slow to import, and seldom needed

    _, chosen = linear_sum_assignment(
        np.abs(frequency[:, None] - [mode.frequency for mode in modes])
    )
    return [modes[k] for k in sorted(chosen.tolist())]


def _unresolved_mode_groups(
    expected: Sequence[ExpectedLine], duration: float
) -> list[list[ExpectedLine]]:
    """Array modes in the order of their frequencies, those together of which one is too near the
    next to be told from it.
    """
    groups: list[list[ExpectedLine]] = []
    for mode in sorted((x for x in expected if x.is_mode), key=lambda x: x.frequency):
        if not groups or (mode.frequency - groups[-1][-1].frequency) * duration >= SEPARATION:
            groups.append([])
        groups[-1].append(mode)
    return groups


def _note_inseparable_modes(
    expected: Sequence[ExpectedLine], refused: dict[str, str]
) -> Iterator[ExpectedLine]:
    """The lines; of a mode the origin says which others are not separable from it, since its peak
    may be theirs.
    """
    modes = {line.name for line in expected if line.is_mode}
    hidden = {
        name: why.removeprefix(f"{NOT_SEPARABLE} ").partition(";")[0]
        for name, why in refused.items()
        if name in modes
    }
    for line in expected:
        others = [name for name, other in hidden.items() if other == line.name]
        if line.name in modes and others:
            line = replace(
                line, origin=f"{line.origin}; {' or '.join(others)} as well: not separable"
            )
        yield line


def _lines_fixing_clock(
    joint: JointFit, expected: Sequence[ExpectedLine], ratio: float, most: int | None = None
) -> np.ndarray:
    """Which tones tell the clock ratio once what is not of the clock is taken out, (m,): the
    strongest, where there are more than ``most``.
    """
    free = joint.tones.free
    rest = joint.spectrum.without(joint.tones.only(free), joint.amplitudes[free])
    clock = [line for line in expected if not line.is_mode]
    lines, _ = consistent_lines(clock, ratio, rest, most)
    names = {line.name for line in lines}
    return np.array([line.name in names for line in joint.tones.lines], dtype=bool)


def _is_searched(expected: Sequence[ExpectedLine]) -> bool:
    return any(line.high > line.low for line in expected if not line.is_mode)


BACKGROUND_DRIFT = 1e-3
"""Part of its frequency by which a line of the background may be off in the recording."""


def with_background(table: LineTable, background: np.ndarray) -> LineTable:
    """Lines with what the table reads at their frequencies while nothing runs, ``background`` (m,)
    at the same sample rate.

    The phase between the two is unknown, so nothing is subtracted: half of the background's square
    goes into the variance of the line's amplitude, and a line that does not exceed the background
    is named so. A line of the background may be off by ``BACKGROUND_DRIFT`` between the two, as mains and
    fans are: the highest there counts.
    """
    rows = []
    spectrum = HannSpectrum.of(background - background.mean(), table.sample_rate)
    for line in table:
        if not np.isfinite(line.amplitude):
            rows.append(line)
            continue
        off = BACKGROUND_DRIFT * line.frequency
        drifted, _ = spectrum.peak(line.frequency - off, line.frequency + off)
        there = max(
            tone_amplitude(background, table.sample_rate, f) for f in (line.frequency, drifted)
        )
        spread = float(np.hypot(line.amplitude_uncertainty, there / np.sqrt(2.0)))
        if line.seen and line.amplitude < 2.0 * there:
            status = IN_BACKGROUND
        else:
            status = line.status
        rows.append(replace(line, background=there, amplitude_uncertainty=spread, status=status))
    masked = tuple(_masked_lines(table, background))
    return replace(table, lines=tuple(rows), masked=masked)


def _masked_lines(table: LineTable, background: np.ndarray) -> Iterator[MaskedLine]:
    """Lines of the background where no line of the table is."""
    seen = np.array([line.frequency for line in table if line.seen])
    for line in estimate_lines(background, table.sample_rate, ()):
        if not line.seen or not math.isfinite(line.amplitude):
            continue
        off = BACKGROUND_DRIFT * line.frequency
        if np.any(np.abs(seen - line.frequency) <= off):
            continue
        low, high = line.frequency - off, line.frequency + off
        floor = 0.0 if table.rest is None else table.rest.factor * table.rest.within(low, high)[1]
        yield MaskedLine(low, high, line.amplitude + floor)


def _inseparable_lines(joint: JointFit, spread: Uncertainty) -> dict[str, str]:
    """Names of the lines above the noise floor without a value of their own, with the reason: what
    is beside them hides it.
    """
    tones, sizes, duration = joint.tones, joint.sizes, joint.spectrum.duration
    unsure = spread.amplitude > MAX_RELATIVE_UNCERTAINTY * sizes
    unsure &= sizes > DETECTION_RATIO * joint.rest.floors(tones.frequency)
    more = poorly_fitted_tones(joint)
    why: dict[str, str] = {}
    uncertain = [i for i in np.flatnonzero(unsure).tolist() if tones.lines[i].kind != "other"]
    alone = isolated_uncertainties(joint, uncertain).amplitude
    for i, by_itself in zip(uncertain, alone.tolist(), strict=True):
        apart = np.abs(tones.frequency - tones.frequency[i]) * duration
        near = [
            j
            for j in np.argsort(apart, kind="stable").tolist()
            if j != i and apart[j] < INTERACTION_DISTANCE
        ]
        larger = next((tones.lines[j] for j in near if sizes[j] > sizes[i]), None)
        if larger is not None and spread.amplitude[i] > _CROWDING_RATIO * by_itself:
            why[tones.lines[i].name] = (
                f"not separable from {UNLISTED_LINE if larger.kind == 'other' else larger.name}"
            )
        elif more[i] and tones.clock[i]:
            why[tones.lines[i].name] = (
                f"not separable from {UNLISTED_LINE} less than one bin away, or amplitude not"
                " constant"
            )
        else:
            why[tones.lines[i].name] = BELOW_FLOOR
    return why


def _cancelled_lines(joint: JointFit) -> dict[str, str]:
    """Names of the lines far larger than what the record shows in their bins, with the reason:
    tones on almost one frequency that cancel, of which only the sum is known.
    """
    tones, spectrum = joint.tones, joint.spectrum
    cycles, fold = tones.frequency * spectrum.duration, tones.decay * spectrum.duration
    nearest = np.rint(cycles).astype(int)
    cancelled = {}
    for i, line in enumerate(tones.lines):
        k = np.arange(max(nearest[i] - 1, 0), min(nearest[i] + 2, spectrum.values.size))
        alone = hann.tone(cycles[i], fold[i], joint.amplitudes[i], k, spectrum.table)
        shown = float(np.max(spectrum.magnitude[k], initial=0.0))
        if float(np.max(np.abs(alone), initial=0.0)) > _CANCELLING_RATIO * shown:
            cancelled[line.name] = CANCELLED
    return cancelled


def _name_unlisted_lines(
    joint: JointFit, spread: Uncertainty, orders: ClockOrders | None
) -> tuple[JointFit, list[ExpectedLine]]:
    """The fit with names of unlisted lines and their place among the clock's orders, and these
    lines, the strongest first.
    """
    tones, duration = joint.tones, joint.spectrum.duration
    lines = list(tones.lines)
    mine = [
        i
        for i in np.argsort(-joint.sizes, kind="stable").tolist()
        if tones.lines[i].kind == "other"
    ]
    for number, i in enumerate(mine, 1):
        frequency, within = (
            float(tones.frequency[i]),
            max(3.0 * float(spread.frequency[i]), 0.02 / duration),
        )
        if orders:
            origin = orders.name(frequency, within) or NO_ORDER
        else:
            origin = ""
        lines[i] = replace(lines[i], name=f"other_{number}", origin=origin)
    return replace(joint, tones=replace(tones, lines=tuple(lines))), [lines[i] for i in mine]


def _resolvable_lines(
    expected: Sequence[ExpectedLine], duration: float, known: Collection[str] = ()
) -> tuple[list[ExpectedLine], dict[str, str]]:
    """Lines that the record can resolve, or that are ``known`` by their names, and the names of the
    others with the reason.

    Lines of the clock go before array modes, since they last, while a mode rings down; but those of
    the electrical period go last, for equal phases make none.
    """
    wanted: list[ExpectedLine] = []
    refused: dict[str, str] = {}
    for line in sorted(expected, key=lambda line: _RANK.get(line.kind, 0)):
        if line.frequency * duration < SEPARATION:
            refused[line.name] = (
                f"not resolved: requires a record of at least {SEPARATION / line.frequency:.3g} s"
            )
            continue
        near = next(
            (
                other
                for other in wanted
                if abs(other.frequency - line.frequency) * duration < SEPARATION
            ),
            None,
        )
        if near is not None and line.name not in known:
            refused[line.name] = _too_near(line, near)
        else:
            wanted.append(line)
    return wanted, refused


def _too_near(line: ExpectedLine, near: ExpectedLine) -> str:
    """Why a line has no figures of its own, and what would help."""
    needed = SEPARATION / max(abs(near.frequency - line.frequency), 1e-12)
    if needed < 1e6:
        length = f"; a record of {needed:.3g} s would separate them"
    else:
        length = ""
    return f"{NOT_SEPARABLE} {near.name}{length}"


def _strongest_modes(
    modes: Sequence[ExpectedLine], spectrum: HannSpectrum
) -> tuple[list[ExpectedLine], dict[str, str]]:
    """The array modes that are fitted, MAX_MODES at most, those in whose bands most stands; and the
    others with the reason.
    """
    if len(modes) <= MAX_MODES:
        return list(modes), {}
    first = [max(int(line.low * spectrum.duration), 0) for line in modes]
    last = [int(line.high * spectrum.duration) + 2 for line in modes]
    stands = [
        float(spectrum.magnitude[a:b].max(initial=0.0)) for a, b in zip(first, last, strict=True)
    ]
    kept = set(np.argsort(stands)[-MAX_MODES:].tolist())
    why = f"not looked for: of {len(modes)} array modes, the {MAX_MODES} largest are"
    return [line for k, line in enumerate(modes) if k in kept], {
        line.name: why for k, line in enumerate(modes) if k not in kept
    }


def _figures(
    expected: Sequence[ExpectedLine], joint: JointFit, refused: dict[str, str]
) -> LineEstimates:
    """Figures of the tones and of the lines that are ``refused`` for a reason, which are nan but
    for the nearest bin.
    """
    tones, rest, duration = joint.tones, joint.rest, joint.spectrum.duration
    fold = tones.decay * duration
    size, floor = joint.sizes, rest.floors(tones.frequency)
    status = _statuses(tones, size, floor, fold)
    order = _order(expected, tones)
    hidden = [refused.get(line.name, BELOW_FLOOR) != BELOW_FLOOR for line in expected]
    order = np.where(np.array(hidden, dtype=bool), len(tones), order)
    frequency = _values_by_line(tones.frequency, order)
    wanted = np.array([line.frequency for line in expected], dtype=float)
    bins = np.minimum(
        np.rint(np.where(np.isnan(frequency), wanted, frequency) * duration), rest.values.size - 1
    )
    return LineEstimates(
        expected=tuple(expected),
        status=tuple(refused.get(line.name) or status[line.name] for line in expected),
        frequency=frequency,
        amplitude=_values_by_line(size, order),
        phase=_values_by_line(np.angle(joint.amplitudes), order),
        decay=_values_by_line(tones.decay, order),
        floor=_values_by_line(floor, order),
        # Nearest bin of a rectangular window, as tests are often read: between bins it is up to
        # 36 % low (picket fence), so that it depends on where the bins happen to fall.
        bin_frequency=bins / duration,
        bin_amplitude=np.abs(rest.unwindowed[bins.astype(int)]),
    )


def _statuses(
    tones: Tones, size: np.ndarray, floor: np.ndarray, fold: np.ndarray
) -> dict[str, str]:
    """Status of each tone of amplitude ``size`` that falls by ``fold`` e-foldings, by the name of
    its line.
    """
    faint, falls = (
        size <= DETECTION_RATIO * floor,
        tones.falls & (np.abs(fold) > MIN_DECAY_E_FOLDINGS),
    )
    status = np.select([faint, tones.limited, falls & (fold > 0.0), falls], [0, 1, 2, 3], 4)
    words = (BELOW_FLOOR, "at a limit of its fit", "decaying", "growing", "ok")
    return {line.name: words[k] for line, k in zip(tones.lines, status.tolist(), strict=True)}


def _order(expected: Sequence[ExpectedLine], tones: Tones) -> np.ndarray:
    """Place of each expected line among the tones, (lines,); one after the last where it is none of
    them.
    """
    place = {line.name: k for k, line in enumerate(tones.lines)}
    return np.array([place.get(line.name, len(tones)) for line in expected], dtype=int)


def _values_by_line(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Values of tones (m,) as those of lines (lines,)."""
    return np.append(values, np.nan)[order]


def _uncertainties_by_line(
    spread: Uncertainty, expected: Sequence[ExpectedLine], tones: Tones
) -> Uncertainty:
    """Uncertainties of tones as those of lines."""
    order = _order(expected, tones)
    each = (spread.amplitude, spread.phase, spread.frequency, spread.decay)
    return Uncertainty(*(_values_by_line(values, order) for values in each))
