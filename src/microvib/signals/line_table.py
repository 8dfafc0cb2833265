"""The lines of a record: figures of each, one by one or as arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from microvib.errors import LineError, did_you_mean, quoted_value
from microvib.former_names import FormerName
from microvib.model.expected import ExpectedLine, LineKindProperties
from microvib.results import (
    COUNT,
    DECAY,
    FREQUENCY,
    LINE_FREQUENCY,
    LINE_FREQUENCY_UNCERTAINTY,
    PHASE,
    TORQUE,
    TORQUE_UNCERTAINTY,
    Column,
    columns_of,
    former_field,
)
from microvib.text_tables import counted, text_table
from microvib.units import pretty

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from microvib.signals.limit_curve import LimitCurve
    from microvib.signals.seed_peaks import SeedPeaks
    from microvib.signals.unaccounted import Excess

DETECTION_RATIO = 6.0  # a line is seen when it stands this many times above the floor about it
BELOW_FLOOR = "below the floor"  # status of a line that was looked for and not found
NOISE_DRIVEN = (
    "driven by noise"  # status of a line that is another one with every draw of the noise
)
BEYOND_USABLE = "beyond the usable band"  # status of a line that the force table is not used at
NEAR_RESONANCE = "near a table resonance"  # status of a line that the force table distorts
BEYOND_RESPONSE = "beyond the table's FRF"  # status of a line that could not be corrected
BEYOND_CHAIN = "beyond the measuring chain"  # status of a line that the chain hardly passes
BY_TREND = "in the removed trend"  # status of a slow line of which a polynomial took a part
OF_UNKNOWN_SCALE = "scale not known"  # status of a line whose file leaves open if it is scaled
DISTORTED = (
    BEYOND_USABLE, NEAR_RESONANCE, BEYOND_RESPONSE, BEYOND_CHAIN, BY_TREND, OF_UNKNOWN_SCALE
)  # fmt: skip
IN_BACKGROUND = "in the background"  # status of a line that is there with the drive off, too
NOT_THE_DRIVES = (*DISTORTED, IN_BACKGROUND)
"""Statuses of lines that are seen and not judged as the drive's."""
_DETECTED_STATUSES = ("ok", "decaying", "growing", NOISE_DRIVEN)
"""Statuses of detected lines, whose values were estimated."""

_IN_PHASE = math.sqrt(0.5 / (1.0 - math.pi / 4.0))
"""Deviation of one part of a complex Gaussian over that of its magnitude."""


_UNITS = {"_hz": "Hz", "_rad": "rad", "_per_s": "1/s", "_n_m": "N*m"}
"""Units by the endings of a line's fields."""


def _figure(value: float, form: str) -> str:
    """A figure of a table that is printed; empty where there is none."""
    if math.isnan(value):
        return ""
    return format(value, form)


def _equal_with_nan(one: Line | LineTable, other: Line | LineTable) -> bool:
    """Whether two have the same figures, those that are not known (NaN) among them: a dataclass
    calls these different, or, before Python 3.13, different where they are not one object."""
    pairs = (
        (getattr(one, each.name), getattr(other, each.name)) for each in fields(one) if each.compare
    )
    return all(a == b or (a != a and b != b) for a, b in pairs)


_FORMER = {"place_hz": "place", "hidden_n_m": "hidden", "noise_scatter_n_m": "noise_scatter"}
"""Properties of a line by their names of the release before."""


@dataclass(frozen=True)
class Line(LineKindProperties):
    """One line of a channel: amplitudes are 0-to-peak, in the unit of its table; frequencies in Hz,
    phases in rad.

    Figures that are not known are nan. Files call them by the keys of their columns, which end with
    a unit: ``amplitude_n_m``, whatever the channel.
    """

    name: Annotated[str, Column("line", "line")]
    kind: Annotated[str, Column("kind")] = ""
    origin: Annotated[str, Column("origin", "what it is", report_only=True)] = ""
    expected: Annotated[float, Column("expected_hz", measure=FREQUENCY)] = math.nan
    frequency: Annotated[float, Column("frequency_hz", "frequency", LINE_FREQUENCY)] = math.nan
    frequency_uncertainty: Annotated[
        float, Column("frequency_uncertainty_hz", "±", LINE_FREQUENCY_UNCERTAINTY)
    ] = math.nan
    amplitude: Annotated[float, Column("amplitude_n_m", "amplitude", TORQUE)] = math.nan
    """Amplitude; of a decaying tone its mean over the record."""
    amplitude_uncertainty: Annotated[
        float, Column("amplitude_uncertainty_n_m", "±", TORQUE_UNCERTAINTY)
    ] = math.nan
    """Standard uncertainty, from the floor about the line."""
    phase: Annotated[float, Column("phase_rad", measure=PHASE)] = math.nan
    """Phase of the cosine at the first sample."""
    phase_uncertainty: Annotated[float, Column("phase_uncertainty_rad", measure=PHASE)] = math.nan
    bin_frequency: Annotated[float, Column("bin_frequency_hz", measure=FREQUENCY)] = math.nan
    bin_amplitude: Annotated[float, Column("bin_amplitude_n_m", measure=TORQUE)] = math.nan
    """Amplitude of the nearest bin of a rectangular window, as tests are often read."""
    floor: Annotated[float, Column("floor_n_m", "floor", TORQUE_UNCERTAINTY)] = math.nan
    """Median amplitude of the bins about the line."""
    decay: Annotated[float, Column("decay_per_s", measure=DECAY)] = math.nan
    """Decay rate sigma of the tone, exp(-sigma t); 0 for a line of the step clock."""
    decay_uncertainty: Annotated[float, Column("decay_uncertainty_per_s", measure=DECAY)] = math.nan
    status: Annotated[str, Column("status", "status")] = ""
    background: Annotated[float, Column("background_n_m", "background", TORQUE_UNCERTAINTY)] = (
        math.nan
    )
    """Amplitude of the background recording at this frequency; nan without one."""
    noise_mean: Annotated[float, Column("noise_mean_n_m", measure=TORQUE)] = math.nan
    """Amplitude that noise alone gives the line, by the linearised drive: its mean over draws; nan
    without noise there.
    """
    noise_deviation: Annotated[float, Column("noise_deviation_n_m", measure=TORQUE)] = math.nan
    """Its standard deviation."""
    noise_p95: Annotated[float, Column("noise_p95_n_m", measure=TORQUE)] = math.nan
    """95 % quantile over the draws."""
    spread: Annotated[float, Column("spread_n_m", "± (ranges)", TORQUE_UNCERTAINTY)] = math.nan
    """First-order change of the amplitude within the ranges that the scenario's sources note, as a
    root of a sum of squares (``microvib.analysis.spread``); nan without ranges, and where one of the
    values has no derivative.
    """

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            return former_field(self, name, _FORMER)

    @property
    def seen(self) -> bool:
        """Whether it was detected, with estimated values."""
        return self.status in _DETECTED_STATUSES

    @property
    def place(self) -> float:
        """Where it is: its frequency, or where that was not found the expected one."""
        if math.isfinite(self.frequency):
            return self.frequency
        return self.expected

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Line):
            return _equal_with_nan(self, other)
        return NotImplemented

    def __hash__(self) -> int:
        return hash((self.name, self.kind))

    @property
    def hidden(self) -> float:
        """Amplitude that its floor may hide; 0 where it does not."""
        if self.status == BELOW_FLOOR:
            return DETECTION_RATIO * self.floor
        return 0.0

    @property
    def noise_scatter(self) -> float:
        """Standard deviation of the amplitude over draws: of an envelope that noise alone makes;
        where the line has another cause, of the noise's part in phase, which is larger."""
        return self.noise_deviation * (
            1.0 if self.status in (NOISE_DRIVEN, BELOW_FLOOR) else _IN_PHASE
        )

    def amplitude_at_start(self, duration: float) -> float:
        """Amplitude [N m] at the first sample of a record of ``duration`` [s]."""
        fold = self.decay * duration
        if abs(fold) > 1e-9:
            return self.amplitude * fold / -float(np.expm1(-fold))
        return self.amplitude

    starting = FormerName("amplitude_at_start")


@dataclass(frozen=True)
class UnusableRange:
    """Frequencies [Hz] at which the channel of a recording does not show its load, and why."""

    low: float
    high: float
    why: str

    def sentence(self, low: float, high: float) -> str:
        """A clause on the part of a band [Hz] that lies in it."""
        first, last = max(self.low, low), min(self.high, high)
        if math.isinf(last):
            return f"from {first:.4g} Hz up, because {self.why}"
        return f"from {first:.4g} to {last:.4g} Hz, because {self.why}"


@dataclass(frozen=True)
class MaskedLine:
    """Bound on what a line of the background may hide in a recording that has none there: as much
    again, in opposite phase.
    """

    low: float
    high: float
    """Between which frequencies [Hz] it lies, as it may have drifted."""
    amplitude: float
    """Upper bound [N m]: the background's amplitude and the floor of the recording there."""


UNFITTED_FACTOR = 3.0
"""Factor on a peak that no line is fitted to, for lines nearer to each other than the record's
resolution cancel in part in the bins that they share."""
TWELFTH_OCTAVE = 2.0 ** (1.0 / 12.0) - 1.0
"""Width of a twelfth of an octave over its lower end."""


@dataclass(frozen=True)
class ResidualPeaks:
    """Unexplained peaks of a table: the highest peak that is left in each twelfth of an
    octave, (m,) each.
    """

    frequency: np.ndarray
    """[Hz]."""
    amplitude: np.ndarray
    """[N m], 0-to-peak."""
    floor: np.ndarray | None = None
    """Floor there [N m], without lines: the median of bins 4 to 20 away; None of exact lines, which
    have none.
    """
    slow: float = 0.0
    """Highest peak [N m] below all of them, at frequencies that the record is too short to tell
    from its mean and from each other; 0 of exact lines, which have none."""
    resolution: float = 0.0
    """Distance [Hz] from which two lines are told apart; 0 of exact lines."""
    together: np.ndarray | None = None
    """Amplitudes [N m] of all peaks in the same part of the spectrum, added; None where
    that is not known.
    """

    @classmethod
    def of(cls, frequency: np.ndarray, amplitude: np.ndarray) -> ResidualPeaks:
        """The highest of peaks, or of bins, at each ``frequency`` (n,) above 0."""
        return cls(*cls._highest(frequency, amplitude)[:2])

    @classmethod
    def of_exact_lines(cls, frequency: np.ndarray, amplitude: np.ndarray) -> ResidualPeaks:
        """The highest of lines at each ``frequency`` (n,) above 0, and what all of them add up to."""
        highest, size, together = cls._highest(frequency, amplitude)
        return cls(highest, size, together=together)

    @staticmethod
    def _highest(
        frequency: np.ndarray, amplitude: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frequency and amplitude of the highest in each twelfth of an octave, and the sum of all."""
        band = twelfth_octave(frequency)
        order = np.argsort(band, kind="stable")
        parts = np.split(order, 1 + np.flatnonzero(np.diff(band[order])))
        parts = [part for part in parts if part.size]
        first = np.array([part[np.argmax(amplitude[part])] for part in parts], dtype=int)
        together = np.array([float(np.sum(amplitude[part])) for part in parts])
        return frequency[first], amplitude[first], together

    def with_peaks(self, frequency: np.ndarray, amplitude: np.ndarray) -> ResidualPeaks:
        """These and further peaks, (n,) at each ``frequency`` (n,) above 0: the highest of all."""
        highest = ResidualPeaks.of(
            np.concatenate([self.frequency, frequency]), np.concatenate([self.amplitude, amplitude])
        )
        floor = None
        if self.floor is not None:
            floor = np.interp(highest.frequency, self.frequency, self.floor)
        return replace(
            highest,
            floor=floor,
            together=None if self.together is None else self.sums_at(highest.frequency),
            slow=self.slow,
            resolution=self.resolution,
        )

    @property
    def in_sum(self) -> np.ndarray:
        """Upper bound of the sum of all that is left in each part [N m], (m,)."""
        highest = self.factor * self.amplitude
        if self.together is None:
            return np.asarray(highest)
        return np.maximum(highest, self.together)

    def sums(self, frequency: np.ndarray, amplitude: np.ndarray, least: np.ndarray) -> np.ndarray:
        """Sums of those of some amplitudes (n,) at each ``frequency`` (n,) that are above the
        ``least`` (m,) of their part, (m,).
        """
        ours = twelfth_octave(self.frequency)
        place = np.clip(np.searchsorted(ours, twelfth_octave(frequency)), 0, ours.size - 1)
        counted = np.where(amplitude > least[place], amplitude, 0.0)
        return np.bincount(place, counted, minlength=ours.size)

    def sums_at(self, frequency: np.ndarray) -> np.ndarray:
        """``in_sum`` in the parts of the spectrum of each ``frequency`` (n,) [Hz]; 0 where nothing
        is left.
        """
        known = dict(
            zip(twelfth_octave(self.frequency).tolist(), self.in_sum.tolist(), strict=True)
        )
        return np.array([known.get(part, 0.0) for part in twelfth_octave(frequency).tolist()])

    def places(self, count: int = 4) -> np.ndarray:
        """Frequencies [Hz] at which what is left may stand, (m, count + 1): that of the peak, and
        others spread over its part of the spectrum.
        """
        low = 2.0 ** (twelfth_octave(self.frequency) / 12.0)
        spread = low[:, None] * np.geomspace(1.0, 1.0 + TWELFTH_OCTAVE, count)
        return np.hstack([self.frequency[:, None], spread])

    @property
    def factor(self) -> float:
        """Factor on a peak for the largest line that may stand there: of exact lines 1."""
        return UNFITTED_FACTOR if self.resolution > 0.0 else 1.0

    def within(self, low: float, high: float) -> tuple[float, float]:
        """Frequency [Hz] and amplitude [N m] of the highest peak between two frequencies [Hz], and
        within the resolution of them; 0 where nothing is left.

        Where an end of the band cuts a twelfth of an octave, only the highest peak of the whole of
        it is known. A peak inside the band may be as high as that one, which then counts although
        it may lie just outside.
        """
        overlapping = self._overlapping(low, high)
        if overlapping.size == 0:
            return low, 0.0
        k = overlapping[np.argmax(self.amplitude[overlapping])]
        return float(self.frequency[k]), float(self.amplitude[k])

    def _overlapping(self, low: float, high: float) -> np.ndarray:
        """Which parts of the spectrum (k,) reach into a band [Hz], or within the resolution of it."""
        if high < low:
            return np.empty(0, dtype=int)
        part = twelfth_octave(self.frequency)
        ends = [max(low - self.resolution, 0.0), high + self.resolution]
        first, last = twelfth_octave(np.array(ends))
        return np.flatnonzero((part >= first) & (part <= last))

    def nearest_to(self, limit: LimitCurve) -> tuple[float, float, float]:
        """Frequency [Hz] and amplitude of the peak that is nearest to a limit, or farthest above it,
        and what that allows.

        Of a twelfth of an octave only the highest peak is known, and others may stand anywhere in
        it: what counts is the least that is allowed in all of it, and within the resolution of it.
        Where no peak is left in the limit's range, an amplitude of 0.
        """
        k = self._overlapping(limit.low, limit.high)
        if k.size == 0:
            return limit.low, 0.0, limit.least
        allowed = self.least_allowed(limit)[k]
        worst = int(np.argmax(self.amplitude[k] / allowed))
        at = k[worst]
        return float(self.frequency[at]), float(self.amplitude[at]), float(allowed[worst])

    def least_allowed(self, limit: LimitCurve) -> np.ndarray:
        """The least that a limit allows in the part of the spectrum of each peak, (m,)."""
        low, high = part_ends(self.frequency)
        allowed = limit.strictest(low - self.resolution, high + self.resolution)
        return np.minimum(allowed, limit.most)  # at its ends, but for rounding


def part_ends(frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends [Hz] of the twelfth of an octave in which each frequency lies, of the same shape each."""
    low = 2.0 ** (twelfth_octave(frequency) / 12.0)
    return low * (1.0 - 1e-9), low * (1.0 + TWELFTH_OCTAVE) * (1.0 + 1e-9)


def twelfth_octave(frequency: np.ndarray) -> np.ndarray:
    """Number of the twelfth of an octave in which each frequency [Hz] lies, as a float: infinite at
    0 and at infinity.
    """
    with np.errstate(divide="ignore"):
        return np.floor(12.0 * np.log2(frequency))


@dataclass(frozen=True)
class SeedLine:
    """A line over many draws of the noise; amplitudes 0-to-peak, in the unit of its table."""

    name: Annotated[str, Column("line", "line")]
    frequency: Annotated[float, Column("frequency_hz", measure=FREQUENCY)]
    """Median [Hz]."""
    draws: Annotated[int, Column("draws", "draws", COUNT)]
    """In how many it has a figure of its own."""
    mean: Annotated[float, Column("mean_n_m", "mean", TORQUE)]
    deviation: Annotated[float, Column("deviation_n_m", "deviation", TORQUE)]
    p95: Annotated[float, Column("p95_n_m", "95 %", TORQUE)]
    """95 % quantile, as estimated from the draws."""
    p95_low: Annotated[float, Column("p95_low_n_m", "at least", TORQUE)]
    """With 95 % confidence that quantile is not below this."""
    p95_high: Annotated[float, Column("p95_high_n_m", "at most", TORQUE, absent="?")]
    """With 95 % confidence it is not above this; nan with fewer draws than 59, which cannot tell."""
    hidden: Annotated[float, Column("hidden_n_m", measure=TORQUE)]
    """Amplitude that a floor may hide; 0 if none does."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            return former_field(self, name, {})


@dataclass(frozen=True)
class LineTable:
    """All lines of one record, and how they were estimated."""

    lines: tuple[Line, ...]
    clock_ratio: float | None
    """Step clock found over step clock expected; None where no line of the clock is seen."""
    clock_ratio_uncertainty: float | None
    """Its standard uncertainty: 0 in a simulation, whose clock is known; None where no line of a
    measured clock is seen.
    """
    samples: int
    sample_rate: float
    unit: str = "N*m"
    """Unit of all amplitudes, in place of N m where the lines are those of another channel than a
    torque.
    """
    source: str = field(default="", compare=False)
    """Origin of the lines: the channel, and the motion, steady state or recording, in words."""
    harmonics: int = field(default=8, compare=False)
    """Members of each family of lines that were looked for."""
    rest: ResidualPeaks | None = field(default=None, compare=False)
    """Residual peaks; None where they were not determined."""
    pieces: ResidualPeaks | None = field(default=None, compare=False)
    """Amplitudes in pieces of the period of a steady state that are larger than its lines about them;
    None where nothing changes slowly within it.
    """
    excess: tuple[Excess, ...] = field(default=(), compare=False)
    """Excess of a recording over its lines and its floor, band by band."""
    masked: tuple[MaskedLine, ...] = field(default=(), compare=False)
    """Lines of the background where a recording has none of its own."""
    unusable: tuple[UnusableRange, ...] = field(default=(), compare=False)
    """Where the force table of a recording does not show its loads; empty where it is not known."""
    own_error: float = field(default=0.0, compare=False)
    """Part of every amplitude that the record itself is known to be off, as by its integration; nan
    where that is not known.
    """
    find_error: Callable[[LineTable], float] | None = field(default=None, compare=False, repr=False)
    """Finds ``own_error`` once a verdict asks for it, since that takes longer than the record; None
    where it is found.
    """
    broken: tuple[str, ...] = field(default=(), compare=False)
    """Invariants of the motion that do not hold, by name: no limit is judged by these lines."""
    seeds: tuple[SeedLine, ...] = field(default=(), compare=False)
    """The lines over many draws of the noise, of which this table is the first; empty where none
    were run.
    """
    seed_peaks: SeedPeaks | None = field(default=None, compare=False, repr=False)
    """The largest amplitudes beside the clock's lines over these draws; None where none were run."""
    ranged: tuple[str, ...] = field(default=(), compare=False)
    """Keys of the values whose ranges make the lines' ``spread``."""
    no_spread: str = field(default="", compare=False)
    """Why no line has a spread though sources note ranges."""

    def __eq__(self, other: object) -> bool:
        if isinstance(other, LineTable):
            return _equal_with_nan(self, other)
        return NotImplemented

    def __hash__(self) -> int:
        return hash(self.lines)

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return self.samples / self.sample_rate

    @cached_property
    def largest(self) -> float:
        """Amplitude of the largest line that has one [N m]; 0 without any."""
        return max((x.amplitude for x in self.lines if math.isfinite(x.amplitude)), default=0.0)

    def __iter__(self) -> Iterator[Line]:
        return iter(self.lines)

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, name: str) -> Line:
        for line in self.lines:
            if isinstance(name, str) and line.name == name:
                return line
        names = self._ipython_key_completions_()
        raise LineError(
            f"no line {quoted_value(name)} in this table; {did_you_mean(str(name), names)}there are"
            f" {', '.join(names) or 'none'}"
        )

    def __str__(self) -> str:
        return self.text()

    def __repr__(self) -> str:
        return f"{self.heading}\n{self._text(self.notable(), '(print shows them)')}"

    @property
    def heading(self) -> str:
        """How many lines of what, and of how long a record, in a line."""
        of = f" of {self.source}" if self.source else ""
        if math.isnan(self.sample_rate):
            return f"{counted(len(self), 'line')}{of}"
        return f"{counted(len(self), 'line')}{of}, {self.duration:g} s at {self.sample_rate:g} Hz"

    def _repr_html_(self) -> str:
        """The notable lines as a notebook shows them."""
        head, *rows = self._cells(shown := self.notable())
        kinds = ["th", *("td" for _ in rows)]
        html = (
            f"<tr>{''.join(f'<{kind}>{escape(cell)}</{kind}>' for cell in row)}</tr>"
            for kind, row in zip(kinds, [head, *rows], strict=True)
        )
        table = f"<table>{''.join(html)}</table>"
        return f"{escape(self.heading)}{table}{self._left_out(shown, '(print shows them)')}"

    def over_seeds(self, name: str) -> SeedLine | None:
        """Look up a line over many draws of the noise.

        Parameters
        ----------
        name : str
            Name of the line.

        Returns
        -------
        SeedLine or None
            None where draws were not run, or the line is not known.
        """
        return next((seed for seed in self.seeds if seed.name == name), None)

    def _ipython_key_completions_(self) -> list[str]:
        return [line.name for line in self.lines]

    def to_xarray(self) -> xr.Dataset:
        """Convert all figures to arrays over the dimension ``line``.

        Returns
        -------
        xarray.Dataset
            A variable for each figure, with its unit.
        """
        import xarray as xr

        columns = {
            column.key: np.array([getattr(x, name) for x in self.lines])
            for name, column in columns_of(Line).items()
        }
        names = columns.pop("line")
        data = {
            name: ("line", values, {"units": u} if (u := self._unit_of(name)) else {})
            for name, values in columns.items()
        }
        found = {
            key: value
            for key in ("clock_ratio", "clock_ratio_uncertainty")
            if (value := getattr(self, key)) is not None
        }
        return xr.Dataset(
            data,
            {"line": names},
            {**found, "samples": self.samples, "sample_rate": self.sample_rate},
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Convert all figures to a DataFrame.

        Returns
        -------
        pandas.DataFrame
            A row for each line, a column for each figure, units in the names of the columns.
        """
        return self.to_xarray().to_dataframe()

    def _unit_of(self, column: str) -> str:
        return next(
            (
                self.unit if unit == "N*m" else unit
                for end, unit in _UNITS.items()
                if column.endswith(end)
            ),
            "",
        )

    def notable(self) -> tuple[Line, ...]:
        """Choose the lines worth a row in a report: without those below the floor, those below a
        thousandth of the largest, and sidebands below a hundredth.

        Returns
        -------
        tuple of Line
            In the order of the table.
        """
        top = max((x.amplitude for x in self.lines if np.isfinite(x.amplitude)), default=0.0)

        def is_notable(x: Line) -> bool:
            least = 0.01 if x.kind == "sideband" else 1e-3
            return x.status != BELOW_FLOOR and not x.amplitude < least * top

        return tuple(x for x in self.lines if is_notable(x))

    def text(self, notable: bool = False) -> str:
        """Print the table as text.

        Parameters
        ----------
        notable : bool
            Only what is notable, not the whole table.

        Returns
        -------
        str
            A head and a row for each line.
        """
        return self._text(self.notable() if notable else self.lines, "in lines.csv")

    def _text(self, shown: Sequence[Line], where: str) -> str:
        header, *rows = self._cells(shown)
        table = text_table(header, rows, left=1, last_left=True)
        return "\n".join(
            filter(None, [table, self._left_out(shown, where), self._over_seeds(shown)])
        )

    def _over_seeds(self, shown: Sequence[Line]) -> str:
        """Mean, deviation and 95 % quantile over the draws of the noise."""
        names = {line.name for line in shown}
        rows = []
        for x in self.seeds:
            if x.name in names:
                if np.isnan(x.p95_high):
                    high = "?"
                else:
                    high = f"{x.p95_high:.4e}"
                figures = (f"{figure:.4e}" for figure in (x.mean, x.deviation, x.p95))
                rows.append((x.name, str(x.draws), *figures, f"{x.p95_low:.4e} to {high}"))
        if not rows:
            return ""
        header = (
            "line",
            "draws",
            "mean",
            "deviation",
            "95 %",
            f"95 % lies within ({pretty(self.unit)})",
        )
        return f"\n{text_table(header, rows, left=1, last_left=True)}"

    def _cells(self, shown: Sequence[Line]) -> Iterator[Sequence[str]]:
        """A head and a row for each line."""
        unit = pretty(self.unit)
        yield "line", "expected Hz", "Hz", unit, "bin Hz", f"bin {unit}", "status"
        for x in shown:
            hertz = _figure(x.expected, ".5f"), _figure(x.frequency, ".5f")
            figures = (
                _figure(x.amplitude, ".4e"),
                f"{x.bin_frequency:.4f}",
                _figure(x.bin_amplitude, ".4e"),
            )
            yield x.name, *hertz, *figures, x.status

    def _left_out(self, shown: Sequence[Line], where: str) -> str:
        left = len(self.lines) - len(shown)
        if left:
            return f"and {left} small ones {where}"
        return ""


@dataclass(frozen=True)
class Uncertainty:
    """Standard uncertainties of lines, (lines,) each, in the units of a ``Line``."""

    amplitude: np.ndarray
    phase: np.ndarray
    frequency: np.ndarray
    decay: np.ndarray


@dataclass(frozen=True)
class LineEstimates:
    """Figures of expected lines as arrays, (lines,) each, in the units of a ``Line``; nan where a
    line is not estimated.
    """

    expected: tuple[ExpectedLine, ...]
    status: tuple[str, ...]
    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    decay: np.ndarray
    floor: np.ndarray
    bin_frequency: np.ndarray
    bin_amplitude: np.ndarray

    def rows(self, spread: Uncertainty) -> tuple[Line, ...]:
        """The lines one by one, with their uncertainties."""
        columns = zip(
            self.frequency.tolist(), spread.frequency.tolist(), self.amplitude.tolist(), spread.amplitude.tolist(),
            self.phase.tolist(), spread.phase.tolist(), self.bin_frequency.tolist(), self.bin_amplitude.tolist(),
            self.floor.tolist(), self.decay.tolist(), spread.decay.tolist(), self.status, strict=True,
        )  # fmt: skip
        return tuple(
            Line(line.name, line.kind, line.origin, float(line.frequency), *figures)
            for line, figures in zip(self.expected, columns, strict=True)
        )
