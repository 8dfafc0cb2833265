"""Evidence: measured lines with their uncertainties, from recordings or tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from microvib.analysis.lines import (
    channel_warnings,
    clock_warnings,
    lines_of_recording,
    rate_warnings,
    recording_warnings,
)
from microvib.errors import MicrovibError, OptionError
from microvib.io.formats import READERS
from microvib.io.recordings import Prepared
from microvib.io.sources import ReferenceLines, Source
from microvib.model.expected import expected_lines
from microvib.model.line_names import LineName, driving_line
from microvib.model.linear import coupled_modes
from microvib.model.scenario import Scenario
from microvib.signals.clock import near_mains
from microvib.signals.line_table import DETECTION_RATIO, NOISE_DRIVEN, LineTable, ResidualPeaks
from microvib.signals.spectrum import Spectrum, amplitude_spectrum, tone_amplitude
from microvib.signals.tones import HannSpectrum
from microvib.solve.steady.state import SteadyState
from microvib.studies.noise_floor import BANDS, bins_between_lines, max_torque_noise_density
from microvib.studies.relative_phase import phase_reference, relative_phase
from microvib.testdata.recording import Recording
from microvib.units import Band, Si, band, within_band


@dataclass(frozen=True)
class Observation:
    """One measured figure of one line.

    ``form`` is amplitude or nearest_bin [N m], level [N m], the median of bins between the lines
    under a Hann window, frequency [Hz], decay [1/s], phase [rad] against another line of the clock
    (``relative_phase``), which no choice of time zero changes, branch [rad], the same against the
    electrical period, of what its phase against the full step leaves open, or turn [rad], the phase
    at the first sample: of the first line of the electrical period, which tells in which quarter of
    its turn a drive began, as far as the time since then is known.
    """

    line: str
    form: str
    value: float
    uncertainty: float
    against: str = ""
    """Line that a phase or branch is relative to."""
    bin_frequency: float = math.nan
    """Bin of a nearest_bin figure: the test's bin, whichever bin is nearest to the line of a
    simulation.
    """
    bins: tuple[int, ...] = ()
    """Bins of a level: those of a band that no line is near."""
    less: tuple[int, ...] = ()
    """Bins of the quietest band, whose level is taken off, of a simulation's as of the recording's."""

    @property
    def is_angle(self) -> bool:
        """Whether it is a phase, which has no relative error."""
        return self.form in ("phase", "branch", "turn")


@dataclass(frozen=True)
class Evidence:
    """Observations of one test, and the record in which they were made."""

    name: str
    observations: tuple[Observation, ...]
    clock_ratio: float | None
    """Step clock found over that of the scenario."""
    duration: float
    sample_rate: float
    notes: tuple[str, ...] = ()
    """Notes on reading and preparing a recording."""
    rest: ResidualPeaks | None = None
    """Residual peaks of a recording and the floor; None for a table."""
    parts: tuple[float, ...] = ()
    """``subharmonic_amplitudes`` of a recording."""
    noise: float = 0.0
    """Density [N^2 m^2/Hz] of torque noise that a recording may have and its scenario has not;
    infinite where it cannot be told.
    """
    prepared: Prepared | None = field(default=None, repr=False, compare=False)
    """The recording itself; None of a table."""
    channel: str = ""
    """Its channel."""
    warnings: tuple[str, ...] = ()
    """Reasons to question that it is of the scenario's drive at its rate."""

    @property
    def harmonics(self) -> int:
        """Members of each family of lines that a simulation must have, for those that are observed
        to be among them.
        """
        return _members(name for o in self.observations for name in (o.line, o.against))

    def of_channel(self, channel: str, scenario: Scenario) -> Evidence:
        """Evidence of another channel on the same lines."""
        assert self.prepared is not None
        its = replace(self.prepared.recording, channels={channel: self.prepared.recording[channel]})
        other = evidence_of(replace(self.prepared, recording=its), scenario, channel, self.name)
        lines = {o.line for o in self.observations}
        kept = tuple(
            o
            for o in other.observations
            if o.line in lines and (not o.against or o.against in lines)
        )
        return replace(other, observations=kept)


_MEMBER = re.compile(r"(?:drive|full_step|electrical)_(\d+)")


def _members(names: Iterable[str]) -> int:
    """The highest order in lines' names, at least the usual eight."""
    return max([8, *(int(found[1]) for name in names if (found := _MEMBER.match(name)))])


SUBHARMONICS = {2: "second", 3: "third"}
"""Microsteps after which a motion may repeat, in place of each."""


def subharmonic_amplitudes(
    x: np.ndarray, sample_rate: float, driving_frequency: float | None
) -> tuple[float, ...]:
    """Amplitudes [N m] of a torque ``x`` (n,) at the driving frequency [Hz] and at those of PARTS;
    none where the rate changes.
    """
    if not driving_frequency:
        return ()
    return tuple(
        tone_amplitude(x, sample_rate, driving_frequency / part) for part in (1, *SUBHARMONICS)
    )


def select_evidence(
    evidence: Sequence[Evidence],
    scenario: Scenario | Sequence[Scenario],
    bands: Sequence[Band] = (),
    without: Sequence[str] = (),
) -> list[Evidence]:
    """The evidence of lines in the ``bands`` (without any: everywhere), less those named in
    ``without``.

    ``scenario``, one or one for each, tells where lines are expected. Phases go with the line that
    they are relative to. MicrovibError for a name that no evidence has, and where nothing is left.
    """
    seen = dict.fromkeys(o.line for one in evidence for o in one.observations)
    for name in without:
        if name not in seen:
            raise OptionError(
                "without", f"no evidence has this line; there are {', '.join(seen)}", name
            )
    ends = [band(given) for given in bands]
    each = [scenario] * len(evidence) if isinstance(scenario, Scenario) else scenario
    frequencies = [_frequencies_of(one, its) for one, its in zip(evidence, each, strict=True)]
    kept = []
    for one, at in zip(evidence, frequencies, strict=True):
        wanted = {name for name, f in at.items() if _in_any_band(f, ends)} - set(without)
        wanted.add("")  # against nothing
        kept.append(
            replace(
                one,
                observations=tuple(o for o in one.observations if {o.line, o.against} <= wanted),
            )
        )
    if not any(one.observations for one in kept):
        require_lines(evidence)
        option = "without" if without else "band"
        raise OptionError(option, f"leaves no line of the evidence{_range_of(seen, frequencies)}")
    return kept


def _frequencies_of(one: Evidence, scenario: Scenario) -> dict[str, float]:
    """Frequencies [Hz] by line: those expected, or of the bins that were read."""
    expected = expected_lines(scenario, Si(math.inf), one.harmonics)
    of_bins = {o.line: o.bin_frequency for o in one.observations if o.bins}
    return {line.name: line.frequency for line in expected} | of_bins


def _in_any_band(frequency: float, ends: Sequence[tuple[float, float]]) -> bool:
    return not ends or any(within_band(frequency, *pair) for pair in ends)


def _range_of(lines: Iterable[str], frequencies: Sequence[Mapping[str, float]]) -> str:
    """Where some lines are, as the end of a sentence; empty where that is not known."""
    found = sorted(at[line] for line in lines for at in frequencies if line in at)
    if not found:
        return ""
    return f"; its lines are from {found[0]:.4g} to {found[-1]:.4g} Hz"


def require_lines(evidence: Sequence[Evidence]) -> None:
    """MicrovibError, which says what to look at, where no recording shows any of the scenario's
    lines.
    """
    if any(one.observations for one in evidence):
        return
    each = (
        f"{one.name}: no line of the scenario's drive is above the noise floor{f' in channel {one.channel}' if one.channel else ''}"
        + (f" ({'; '.join(one.warnings)})" if one.warnings else "")
        for one in evidence
    )
    raise MicrovibError(
        f"{'; '.join(each)}; check the channel's axis and unit, and the scenario's tracking.rate"
    )


def evidence_of(
    source: Source | Recording, scenario: Scenario, channel: str = "Mz", name: str = ""
) -> Evidence:
    """Evidence of a recording (its drive-axis torque in ``channel``), a table of lines that is
    called ``name``, or of measured reference lines.
    """
    match source:
        case ReferenceLines(column="measured"):
            return _of_reference(source, scenario)
        case LineTable():
            return _of_table(source, scenario, name)
        case Recording():
            return evidence_of(Prepared(source.in_si()), scenario, channel, name)
        case Prepared(recording, background):
            table, r = lines_of_recording(recording, channel, scenario, background), recording
            found = tuple(
                o
                for o in observations(table)
                if not near_mains(table[o.line].frequency, r.duration)
            )
            found = with_noise_scatter(found, r[channel], r.sample_rate, table, scenario)
            parts = subharmonic_amplitudes(
                r[channel],
                r.sample_rate,
                (scenario.driving_frequency or 0.0) * (table.clock_ratio or 1.0),
            )
            noise = _unlisted_noise(found, r[channel], r.sample_rate, table, scenario)
            notes = (*r.notes_on(channel), *recording_warnings(r, channel, scenario, table))
            return Evidence(
                r.title,
                found,
                table.clock_ratio,
                r.duration,
                r.sample_rate,
                notes,
                table.rest,
                parts,
                noise,
                source,
                channel,
                (*clock_warnings(table), *channel_warnings(r, channel, scenario, table)),
            )
        case _:
            expected = (
                f"a recording ({', '.join(READERS)}), a table of lines (.csv) or SCENARIO:measured"
            )
            raise MicrovibError(f"{name or 'the source'}: is not evidence; expected {expected}")


def observations(table: LineTable) -> tuple[Observation, ...]:
    """Observations from the lines of a table above the noise floor: amplitudes, phases of driving lines
    and of those of the electrical period, frequency and decay of modes; and one turn, since
    relative phases have all that a second would tell."""
    found = []
    sure = {x.name: x for x in table if x.status == "ok"}
    seen = (x for x in table if x.kind != "other" and x.seen)
    for x in (x for x in seen if not x.amplitude < 2 * DETECTION_RATIO * x.floor):
        found.append(Observation(x.name, "amplitude", x.amplitude, x.amplitude_uncertainty))
        if x.is_mode:
            found.append(Observation(x.name, "frequency", x.frequency, x.frequency_uncertainty))
            found.append(Observation(x.name, "decay", x.decay, x.decay_uncertainty))
        against = sure.get(phase_reference(x.name))
        if against is not None and against is not x:
            found.append(Observation(x.name, "phase", *relative_phase(x, against), against.name))
        first = sure.get("electrical_1")
        if x.kind == "electrical" and first is not None and first is not x:
            value, spread = relative_phase(x, first)
            found.append(
                Observation(x.name, "branch", value, math.hypot(BRANCH_SIGMA, spread), first.name)
            )
    turn = next((x for x in sure.values() if x.kind == "electrical"), None)
    if turn is not None:
        found.append(Observation(turn.name, "turn", turn.phase, turn.phase_uncertainty))
    return tuple(found)


MAX_MODE_NOISE_RATIO = 4.0
"""Times what the scenario's noise gives a ringing mode, up to which it is taken to disturb its
frequency and decay: its density is sought."""
MAX_FLOOR_RATIO = 2.0
"""Times of the scenario's own noise that the floor may show without being more than that."""
TWO_DRAW_SCATTER = math.sqrt(2.0)
"""Scatter of the difference of two draws, the recording's and the simulation's, over that of one."""


def with_noise_scatter(
    found: Sequence[Observation],
    x: np.ndarray,
    sample_rate: float,
    table: LineTable,
    scenario: Scenario,
) -> tuple[Observation, ...]:
    """Observations of a recording ``x`` (n,) [N m] of a drive with noise: with what they scatter
    over draws, and with levels.

    A mode that noise drives has the amplitude's deviation over draws in closed form
    (``model.driven``), its frequency scatters by sqrt(sigma/(2 T))/(2 pi) (S.-K. Au, Mechanical
    Systems and Signal Processing 48, 2014) and its decay, by 1/sqrt(sigma T) of itself, is left
    out. Levels between the lines tell the noise's density. Without noise in the scenario all stays
    as it is.
    """
    noise = scenario.friction.torque_noise
    if noise is None or noise.silent:
        return tuple(found)
    sigma = {mode.name: mode.decay for mode in coupled_modes(scenario)}
    told = []
    for o in found:
        line, more = table[o.line], 0.0
        if line.name in sigma and math.isfinite(line.noise_p95):
            if line.status == NOISE_DRIVEN and o.form == "decay":
                continue
            if line.status != NOISE_DRIVEN:
                part = min(MAX_MODE_NOISE_RATIO * line.noise_p95 / line.amplitude, 1.0)
            else:
                part = 1.0
            wander = part * math.sqrt(sigma[line.name] / table.duration)
            scatter = {"frequency": wander / (math.tau * math.sqrt(2.0)), "decay": wander}
            more = {"amplitude": line.noise_scatter, **scatter}.get(o.form, 0.0)
        told.append(replace(o, uncertainty=TWO_DRAW_SCATTER * math.hypot(o.uncertainty, more)))
    return (*told, *_levels(x, sample_rate, table, scenario))


def _levels(
    x: np.ndarray, sample_rate: float, table: LineTable, scenario: Scenario
) -> list[Observation]:
    """Levels between the lines, less what the instrument has: white, as much as the quietest band.

    The median of n bins under a Hann window is known to 1/sqrt(n) of itself.
    """
    magnitude, f, bands = bins_between_lines(x, sample_rate, table, scenario)
    squares = np.array([float(np.median(magnitude[k])) ** 2 for k in bands])
    spreads = np.array(
        [2.0 * square / math.sqrt(k.size) for square, k in zip(squares, bands, strict=True)]
    )
    quiet = int(np.argmin(squares)) if bands else -1
    found = []
    for i, k in enumerate(bands):
        own, spread = squares[i] - squares[quiet], math.hypot(spreads[i], spreads[quiet])
        if own > DETECTION_RATIO * spread:
            level = math.sqrt(own)
            name = f"level_{f[k[0]]:.3g}_to_{f[k[-1]]:.3g}_Hz"
            uncertainty = TWO_DRAW_SCATTER * spread / (2.0 * level)
            less = tuple(bands[quiet].tolist())
            at = float(np.mean(f[k]))
            found.append(
                Observation(
                    name,
                    "level",
                    level,
                    uncertainty,
                    bin_frequency=at,
                    bins=tuple(k.tolist()),
                    less=less,
                )
            )
    return found


def _unlisted_noise(
    found: Sequence[Observation],
    x: np.ndarray,
    sample_rate: float,
    table: LineTable,
    scenario: Scenario,
) -> float:
    """Density [N^2 m^2/Hz] of torque noise that a recording may have and its scenario has not, nor
    levels that would tell it.
    """
    noise = scenario.friction.torque_noise
    if noise is not None and not noise.silent and any(o.form == "level" for o in found):
        return 0.0
    if noise is None:
        own = 0.0
    else:
        own = float(np.max(noise.at(BANDS, sample_rate)))
    return max(
        max_torque_noise_density(x, sample_rate, table, scenario) - MAX_FLOOR_RATIO * own, 0.0
    )


BRANCH_SIGMA = 0.3
"""Standard uncertainty [rad] of a branch, which is to tell quarters apart and nothing that the
phase tells already.
"""


@dataclass(frozen=True)
class Simulated:
    """Lines of a simulated test, and its torque (n,) [N m] at ``sample_rate`` [Hz]."""

    table: LineTable
    torque: np.ndarray
    sample_rate: float
    state: SteadyState | None = field(default=None, repr=False)
    """The steady state that it is, in which nothing is left of the start; None of a run."""

    @cached_property
    def spectrum(self) -> Spectrum:
        """Rectangular-window amplitudes."""
        return amplitude_spectrum(self.torque, self.sample_rate)

    @cached_property
    def between(self) -> np.ndarray:
        """Hann-window amplitudes."""
        return HannSpectrum.of(self.torque - self.torque.mean(), self.sample_rate).magnitude

    def bin_amplitude(self, frequency: float) -> float:
        """Amplitude of the bin nearest to ``frequency`` [Hz]."""
        return float(self.spectrum.amplitude[round(frequency / self.spectrum.resolution)])


def predicted(lines: Simulated, wanted: Observation) -> float:
    """The simulated figure for one observation; nan if the lines do not have it."""
    if wanted.bins:
        level, less = (
            float(np.median(lines.between[list(k)])) if k else 0.0
            for k in (wanted.bins, wanted.less)
        )
        return math.sqrt(max(level**2 - less**2, 0.0))
    by_name = {line.name: line for line in lines.table}
    line = by_name.get(wanted.line)
    if line is None:
        return math.nan
    if wanted.against:
        against = by_name.get(wanted.against)
        if against is None:
            return math.nan
        return relative_phase(line, against)[0]
    figures: dict[str, float] = {
        "amplitude": line.amplitude,
        "nearest_bin": line.bin_amplitude
        if math.isnan(wanted.bin_frequency)
        else lines.bin_amplitude(wanted.bin_frequency),
        "frequency": line.frequency,
        "decay": line.decay,
        "turn": line.phase,
    }
    return figures[wanted.form]


def _of_reference(source: ReferenceLines, scenario: Scenario) -> Evidence:
    """Measured reference lines: amplitudes, good to their last digit, frequencies of modes to half
    a bin, and the clock.
    """
    reference = source.scenario.reference
    assert reference is not None
    found = []
    for one in reference.lines:
        if one.resolution is None:
            spread = 0.01 * one.amplitude
        else:
            spread = 0.5 * one.resolution / math.sqrt(3.0)
        if reference.estimator == "nearest bin":
            found.append(
                Observation(
                    one.line, "nearest_bin", one.amplitude, spread, bin_frequency=one.frequency
                )
            )
        else:
            found.append(Observation(one.line, "amplitude", one.amplitude, spread))
    # A mode's frequency lies within half a bin of that of its bin, which is put at three sigma.
    for one in (one for one in reference.lines if LineName.parse(one.line).is_mode):
        nearest = round(one.frequency * reference.duration) / reference.duration
        found.append(Observation(one.line, "frequency", nearest, 0.5 / reference.duration / 3.0))
    return Evidence(
        f"{reference.source} (measured)",
        tuple(found),
        reference.clock_ratio / scenario.tracking.clock_ratio,
        duration=reference.duration,
        sample_rate=reference.sample_rate,
    )


def _of_table(table: LineTable, scenario: Scenario, name: str) -> Evidence:
    """Amplitudes, or else those of nearest bins, of lines that are above the noise floor and expected of the
    scenario, so that a simulation has them; without uncertainties one per cent is taken."""
    found = []
    ratio = None
    expected = expected_lines(scenario, Si(math.inf), _members(line.name for line in table))
    known = {line.name for line in expected}
    for line in (x for x in table if x.name in known and (x.seen or not x.status)):
        form, value = "amplitude", line.amplitude
        if math.isnan(value):
            form, value = "nearest_bin", line.bin_amplitude
        spread = line.amplitude_uncertainty
        if value > 0.0:
            found.append(
                Observation(line.name, form, value, spread if spread > 0.0 else 0.01 * value)
            )
        if line.name == driving_line(1) and scenario.driving_frequency and line.frequency > 0.0:
            ratio = line.frequency / scenario.driving_frequency
    if not found:
        raise MicrovibError(f"{name}: has no line with amplitude_n_m or bin_amplitude_n_m")
    record, warnings = scenario.record, tuple(rate_warnings(ratio))
    return Evidence(
        name, tuple(found), ratio, record.duration, record.sample_rate, warnings=warnings
    )
