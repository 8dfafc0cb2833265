"""A recording: sampled channels with units, checked for what makes them unfit, and the axis map to
the drive.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from numbers import Real
from typing import Any

import numpy as np

from microvib.errors import MicrovibError, expect_mapping
from microvib.former_names import FormerName
from microvib.model.rigid import COMPONENTS
from microvib.testdata.channels import (
    ACCELERATIONS,
    FULL_SCALE,
    LOADS,
    as_acceleration,
    as_denominator,
    as_load,
    plain_load,
    yaml_quoted,
)
from microvib.testdata.clipping import find_plateaus
from microvib.testdata.floors import raised_floors
from microvib.testdata.force_table import LARGEST_BIAS, ForceTable, UnusableBand
from microvib.testdata.gaps import gap_faults
from microvib.text_tables import counted
from microvib.units import Si, quantity

OUTLIER = (
    1e4  # size of a sample, over that of 99 % of them, from which it is taken for a broken number
)
GLITCH_RATIO = (
    10.0  # bend at a sample, over the largest of 999 in a thousand, from which it may stand alone
)
SMALL_PART = (
    0.01  # part of a component, or lever arm [m], that brings no faults or resonances along
)
MAX_LOAD = 1e12  # largest force [N] or torque [N m] that is taken for one
TOLD_FROM_MEAN = 2.5  # cycles of a line in a record, from which it is told from the mean


class RecordingError(MicrovibError):
    """A recording that cannot be read or used: says which file or channel, and what is wrong with
    it.
    """


@dataclass(frozen=True)
class Recording:
    """Channels of one test, each (n,), at one sample rate; forces and torques in N and N m after
    ``in_si``.

    Parameters
    ----------
    channels : mapping of str to array
        Samples by the name of their channel, (n,) each: anything that numpy takes for numbers;
        masked ones are nan.
    sample_rate : float, str or Si
        Samples per second; a bare number is in Hz.
    units : mapping of str to str
        Units of the channels, such as ``{"Mz": "mN*m"}``.
    title : str
        What it is a recording of; its file's name where it was read from one.
    notes : tuple of str
        What reading and preparing did, in words.
    faults, alone : mapping of str to str, optional
        What was wrong with samples of channels, and which stood alone, before they were changed.
    axes : frozenset of str
        What the file holds beside the channels.
    table : ForceTable, optional
        What is known of the force table: its resonances, its usable band and its channels' noise.
    lost : tuple of UnusableBand
        Frequencies at which reading or preparing leaves the loads uncertain, in all channels.
    chain_stated : bool
        Whether the preparation states the filters of the measuring chain, or that there are none.

    Raises
    ------
    RecordingError
        Where channels are not (n,) each, or the sample rate is none.

    Examples
    --------
    >>> import microvib as mv
    >>> mv.Recording({"Mz": [0.0, 0.1]}, 4096.0, {"Mz": "N*m"}, "run 7").duration
    0.00048828125
    """

    channels: Mapping[str, np.ndarray]
    sample_rate: float
    units: Mapping[str, str] = field(default_factory=dict)
    title: str = ""
    notes: tuple[str, ...] = ()
    """Notes on reading and preparing."""
    faults: Mapping[str, str] | None = None
    """Faults of the channels' samples before they were changed, which hides them; None
    while they are as read.
    """
    alone: Mapping[str, str] | None = None
    """Which samples of channels stood alone before they were changed, likewise."""
    axes: frozenset[str] = frozenset()
    """Names of what the file holds beside the channels: time axes, and channels that were left out."""
    table: ForceTable | None = None
    """The force table that made it, where it is known."""
    lost: tuple[UnusableBand, ...] = ()
    """Frequencies at which reading or preparing leaves the loads uncertain, in all channels."""
    chain_stated: bool = False
    """Whether the preparation states the filters of the measuring chain, or that there are none."""

    def __post_init__(self) -> None:
        expect_mapping(self.channels, "channels", "{'Mz': samples}")
        expect_mapping(self.units, "units", "{'Mz': 'N*m'}")
        given: Any = self.sample_rate
        rate = quantity("sample_rate", Si(given) if isinstance(given, Real) else given, "Hz")
        if not 0.0 < rate < math.inf:
            raise RecordingError(
                f"{self.title}: sample rate {rate:g} Hz is not allowed; it must be greater than 0"
                " and finite"
            )
        channels = {str(name): self._samples(name) for name in self.channels}
        sizes = {name: x.size for name, x in channels.items()}
        if len(set(sizes.values())) > 1:
            raise RecordingError(f"{self.title}: its channels differ in length: {sizes}")
        object.__setattr__(self, "sample_rate", float(rate))
        object.__setattr__(self, "channels", channels)
        object.__setattr__(
            self, "units", {name: plain_load(unit) for name, unit in self.units.items()}
        )

    def _samples(self, name: str) -> np.ndarray:
        given = self.channels[name]
        if isinstance(given, np.ma.MaskedArray):
            x = np.ma.filled(given.astype(float), np.nan)
        else:
            x = np.asarray(given)
        if x.dtype.kind in "biuO":
            with contextlib.suppress(TypeError, ValueError):
                x = x.astype(float)
        if x.dtype.kind != "f" or x.ndim != 1:
            what = f"{x.dtype} of shape {x.shape}"
            raise RecordingError(
                f"{self.title}: channel {name} is {what}; real numbers one after another, (n,), are"
                " expected"
            )
        return x

    def __repr__(self) -> str:
        channels = [f"{name} [{self.units.get(name) or 'no unit'}]" for name in self.channels]
        more = f", and {len(channels) - 12} more" if channels[12:] else ""
        return (
            f"{self.name[0].upper()}{self.name[1:]}\n"
            f"  {self.samples} samples at {self.sample_rate:g} Hz, {self.duration:g} s\n"
            f"  {counted(len(channels), 'channel')}: {', '.join(channels[:12])}{more}"
        )

    @property
    def name(self) -> str:
        """The recording by its title, which is its file's name where it was read from one."""
        if self.title:
            return f"recording '{self.title}'"
        return "recording without a title"

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.channels:
            there = [*self.channels]
            which = name in COMPONENTS and bool(there)
            if which:
                such = f"channels: {{{name}: {yaml_quoted(there[-1])}}}"
            else:
                such = ""
            raise RecordingError(
                f"{self.title}: there is no channel '{name}'; there are"
                f" {', '.join(there[:30])}{' ...' if len(there) > 30 else ''}"
                + (
                    f"; say which one it is in the preparation file, such as {such}"
                    if which
                    else ""
                )
                + "".join(f"; {note}" for note in self.notes if note.startswith("left out")),
                remedy="prepare" if which else "",
            )
        return self.channels[name]

    @property
    def samples(self) -> int:
        """Samples of each channel."""
        if self.channels:
            return next(iter(self.channels.values())).size
        return 0

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.samples / self.sample_rate

    def notes_on(self, name: str) -> tuple[str, ...]:
        """Tell what was done to the recording, and which samples of a channel stand alone: they
        stay in what is made of it.

        Parameters
        ----------
        name : str
            Name of the channel.

        Returns
        -------
        tuple of str
            Notes, a sentence each.
        """
        notes = [*self.notes]
        if self.table is not None:
            notes += self.table.notes(name)
        stands = self.glitch(name)
        if stands:
            notes.append(f"channel {name} {stands}; it stays in")
        return tuple(notes)

    told = FormerName("notes_on")

    def unusable(self, name: str) -> tuple[UnusableBand, ...]:
        """Find where a channel does not show its load: by its force table, and by what preparing left.

        Parameters
        ----------
        name : str
            Name of the channel.

        Returns
        -------
        tuple of UnusableBand
            Bands of frequencies [Hz] with a reason each, ascending.
        """
        of_table = () if self.table is None else self.table.unusable(name)
        return tuple(sorted((*of_table, *self.lost), key=lambda one: (one.low, one.high)))

    def glitch(self, name: str) -> str:
        """Find samples of a channel that stand alone, as a converter's or a line's glitches do.

        Parameters
        ----------
        name : str
            Name of the channel.

        Returns
        -------
        str
            Which they are, in words; empty where there is none.
        """
        if self.alone is None:
            return _find_glitches(self[name], self.sample_rate)
        return self.alone.get(name, "")

    def noted(self, note: str, **changes: object) -> Recording:
        """Make a changed copy that says what was done to it.

        Parameters
        ----------
        note : str
            What was done.
        **changes : object
            Fields with their new values.

        Returns
        -------
        Recording
            The copy.
        """
        return replace(self, notes=(*self.notes, note), **changes)  # type: ignore[arg-type]

    def in_si(self) -> Recording:
        """Convert forces to N, torques to N m and accelerations to m/s² or g, whichever they are
        in; what is none of them keeps its unit.

        Returns
        -------
        Recording
            The converted copy.

        Raises
        ------
        RecordingError
            Where a component is the other of the two.
        """
        channels, units = dict(self.channels), dict(self.units)
        for name in channels:
            unit = units.get(name, "").strip()
            found = as_load(f"1 {unit}") if unit else None
            if found is None and unit and name not in COMPONENTS:
                found = as_acceleration(f"1 {unit}")
            if found is None:
                continue
            factor, si = found
            wanted = "N" if name.startswith("F") else "N*m"
            if name in COMPONENTS and si != wanted:
                raise RecordingError(
                    f"{self.title}: channel {name} is in '{unit}', but {wanted} or a part of it is"
                    " expected"
                )
            with np.errstate(all="ignore"):
                channels[name], units[name] = channels[name] * factor, si
        return replace(self, channels=channels, units=units)

    def load(self, name: str) -> np.ndarray:
        """Give a force or a torque, after ``in_si``.

        Parameters
        ----------
        name : str
            Name of the channel.

        Returns
        -------
        numpy.ndarray
            Samples [N] or [N m], (n,).

        Raises
        ------
        RecordingError
            Where the channel is neither: says what the preparation must add.
        """
        x, unit = self[name], self.units.get(name, "").strip()
        if unit in LOADS:
            return x
        example = "N" if name.startswith("F") else "N*m"
        if not unit:
            raise RecordingError(
                f"{self.title}: channel {name} has no unit; add it to the preparation file:"
                f" units: {{{yaml_quoted(name)}: {example}}}",
                remedy="prepare",
            )
        if unit == FULL_SCALE:
            raise RecordingError(
                f"{self.title}: channel {name} is in parts of full scale, and the file does not say"
                " what that is; add it to the"
                f" preparation file, such as units: {{{yaml_quoted(name)}: 20 {example}}} where"
                f" full scale is 20 {example}",
                remedy="prepare",
            )
        raise RecordingError(
            f"{self.title}: channel {name} is in '{unit}', which is neither a force nor a torque;"
            " add to the preparation file"
            f" what it stands for, such as sensitivity: {{{yaml_quoted(name)}: 0.01"
            f" {example}/{as_denominator(unit)}}}, or its right"
            f" unit, units: {{{yaml_quoted(name)}: {example}}}",
            remedy="prepare",
        )

    def load_or_acceleration(self, name: str) -> np.ndarray:
        """Give a force, a torque or an acceleration, after ``in_si``.

        Parameters
        ----------
        name : str
            Name of the channel; no component, ``Fx`` to ``Mz``, is an acceleration.

        Returns
        -------
        numpy.ndarray
            Samples in the channel's unit, (n,): N, N m, m/s² or g.

        Raises
        ------
        RecordingError
            Where the channel is none of them: says what the preparation must add.
        """
        if name not in COMPONENTS and self.units.get(name, "").strip() in ACCELERATIONS:
            return self[name]
        return self.load(name)

    def six(self) -> np.ndarray:
        """Give the six components.

        Returns
        -------
        numpy.ndarray
            Fx Fy Fz [N], Mx My Mz [N m], (6, n).

        Raises
        ------
        RecordingError
            Where one is missing, or is no force or torque.
        """
        return np.array([self.load(name) for name in COMPONENTS])

    @property
    def chain_assumption(self) -> str:
        """Assumption of a verdict about the measuring chain, a sentence; empty where its filters are stated."""
        if self.chain_stated:
            return ""
        return (
            "Assumed: the measuring chain takes nothing of what is judged; state its filters, such as AC coupling, as"
            " response in the preparation file (flat where there is none)."
        )

    def looked_at(self, part: slice = slice(None)) -> Recording:
        """Keep in mind what is wrong with the samples, since filters and sums hide what was
        clipped.

        Parameters
        ----------
        part : slice
            Part of the samples that is looked at.

        Returns
        -------
        Recording
            A copy with ``faults`` and ``alone``.
        """
        if self.faults is not None:
            return self
        found = {
            name: next(_in_samples(x[part], self.sample_rate, self.units.get(name, "")), "")
            for name, x in self.channels.items()
        }
        single = {
            name: _find_glitches(x[part], self.sample_rate) for name, x in self.channels.items()
        }
        return replace(
            self,
            faults={name: fault for name, fault in found.items() if fault},
            alone={name: stands for name, stands in single.items() if stands},
        )

    def combined(self, A: np.ndarray, note: str) -> Recording:
        """Mix the six components, with the faults of all that make a hundredth of one.

        Parameters
        ----------
        A : numpy.ndarray
            Matrix, (6, 6): new components are ``A`` times these.
        note : str
            What was done.

        Returns
        -------
        Recording
            The new components.
        """
        seen = self.looked_at()
        six, told, single = self.six(), dict(seen.faults or {}), dict(seen.alone or {})
        after = A @ six
        large = np.abs(A) * np.ptp(six, axis=1) > SMALL_PART * np.ptp(after, axis=1)[:, None]
        faults, alone = (
            {n: x for n, x in known.items() if n not in COMPONENTS} for known in (told, single)
        )
        for i, j in np.argwhere(large).tolist():
            name, of = COMPONENTS[i], COMPONENTS[j]
            for known, made in ((told, faults), (single, alone)):
                if of in known:
                    if name == of:
                        made[name] = known[of]
                    else:
                        made[name] = f"is made of {of}, which {known[of]}"
        channels = {**self.channels, **dict(zip(COMPONENTS, after, strict=True))}
        said = [note]
        if np.all(np.abs(np.diag(A)) > 0.5):
            said += raised_floors(six, after, self.sample_rate)
        table = self.table
        if table is not None:
            said += table.raised_noise(A)
            table = table.combined(A, large | (np.abs(A) > SMALL_PART))
        return self.noted(
            "; ".join(said), channels=channels, faults=faults, alone=alone, table=table
        )

    def mapped(self, names: Mapping[str, str]) -> Recording:
        """Give channels other names.

        Parameters
        ----------
        names : mapping of str to str
            New names to old ones, ``{new: old}``, or ``{new: "-old"}`` to reverse a channel's sign.

        Returns
        -------
        Recording
            The channels under their new names, and no others.

        Raises
        ------
        RecordingError
            For a channel that is not there.
        """
        channels, units, sources = {}, {}, []
        for new, old in names.items():
            sign, reversed_ = 1.0, ""
            if old.startswith("-"):
                sign, old, reversed_ = -1.0, old[1:], " with its sign reversed"
            sources.append(f"{new} from {old}{reversed_}")
            channels[new], units[new] = sign * self[old], self.units.get(old, "")
        faults, alone = (
            told
            and {
                new: told[old.lstrip("-")] for new, old in names.items() if old.lstrip("-") in told
            }
            for told in (self.faults, self.alone)
        )
        table = None if self.table is None else self.table.renamed(names)
        return self.noted(
            f"channels: {', '.join(sources)}",
            channels=channels,
            units=units,
            faults=faults,
            alone=alone,
            table=table,
        )

    def without_cross_talk(self, matrix: np.ndarray) -> Recording:
        """Invert the cross-talk of the six components.

        Parameters
        ----------
        matrix : array_like
            Cross-talk, (6, 6), readings = matrix @ loads.

        Returns
        -------
        Recording
            Six components of the loads.

        Raises
        ------
        RecordingError
            Where the matrix is not 6 x 6, finite and invertible.
        """
        matrix = np.asarray(matrix, dtype=float)
        if (
            matrix.shape != (6, 6)
            or not np.all(np.isfinite(matrix))
            or np.linalg.cond(matrix) > 1e6
        ):
            raise RecordingError(
                f"{self.title}: the cross-talk matrix must be 6 x 6, finite and invertible"
            )
        return self.combined(np.linalg.inv(matrix), "cross-talk matrix applied")

    def trimmed(self, start: float, stop: float) -> Recording:
        """Cut out a part.

        Parameters
        ----------
        start, stop : float
            Ends of the part, from the first sample [s].

        Returns
        -------
        Recording
            The part.

        Raises
        ------
        RecordingError
            Where the part is not within the recording.
        """
        first, last = round(start * self.sample_rate), round(stop * self.sample_rate)
        if 0 <= first == last <= self.samples and start < stop:
            raise RecordingError(
                f"{self.title}: {start:.9g} to {stop:.9g} s holds no sample;"
                f" samples are {1.0 / self.sample_rate:.3g} s apart"
            )
        if not 0 <= first < last <= self.samples:
            raise RecordingError(
                f"{self.title}: {start:g} to {stop:g} s is not within its {self.duration:g} s"
            )
        channels = {name: x[first:last] for name, x in self.channels.items()}
        return self.noted(f"trimmed to {start:g}-{stop:g} s", channels=channels)

    def detrended(self, order: int = 1) -> Recording:
        """Subtract from each channel its least-squares polynomial.

        A polynomial of higher order follows slow lines, too: below the frequency at which it takes 5 %
        of a tone's amplitude nothing is judged.

        Parameters
        ----------
        order : int
            Order of the polynomial: 0 the mean, 1 a straight line.

        Returns
        -------
        Recording
            What is left.
        """
        u = np.linspace(-1.0, 1.0, self.samples)
        basis = np.polynomial.legendre.legvander(u, order)
        channels = {
            name: x - basis @ np.linalg.lstsq(basis, x, rcond=None)[0]
            for name, x in self.channels.items()
        }
        note, lost = f"polynomial of order {order} removed", self.lost
        cycles = _cycles_beyond_polynomial(order)
        if cycles > TOLD_FROM_MEAN:
            f = cycles / self.duration
            why = (
                f"the polynomial of order {order} that was removed takes more than"
                f" {100.0 * LARGEST_BIAS:g} % of a line below {f:.3g} Hz"
            )
            lost = (*lost, UnusableBand(0.0, f, why, "trend"))
            note += f"; lines below {f:.3g} Hz, of which it takes a part, are not judged"
        return self.looked_at().noted(note, channels=channels, lost=lost)

    def decimated(self, factor: int) -> Recording:
        """Take every ``factor``-th sample after a zero-phase low-pass (FIR, 80 dB).

        Parameters
        ----------
        factor : int
            Samples that become one.

        Returns
        -------
        Recording
            The recording at a ``factor`` lower rate.
        """
        from scipy.signal import resample_poly

        if factor < 1 or self.samples < 20 * factor:
            raise RecordingError(
                f"{self.title}: factor {factor} does not go with {self.samples} samples"
            )
        channels = {
            name: resample_poly(x, 1, factor, window=("kaiser", 8.0))
            for name, x in self.channels.items()
        }
        slower = self.sample_rate / factor
        return self.looked_at().noted(
            f"decimated by {factor}", channels=channels, sample_rate=slower
        )


def require_usable_channel(
    recording: Recording, name: str, shortest: float = 0.0, *, acceleration: bool = False
) -> None:
    """Refuse a channel that cannot be analysed.

    RecordingError where it is neither a force nor a torque, nor with ``acceleration`` one of these,
    has NaN, is constant, clipped, has runs of repeated samples (drop-outs), one sample out of all
    proportion, or is shorter than ``shortest`` [s].
    """
    of = recording.load_or_acceleration if acceleration else recording.load
    _refuse(recording, name, next(_faults(recording, name, of(name), shortest), ""))


def _refuse(recording: Recording, name: str, told: str) -> None:
    """RecordingError where something is told of a channel."""
    if told:
        raise RecordingError(f"{recording.title}: channel {name} {told}".removeprefix(": "))


def channel_fault(recording: Recording, name: str, shortest: float = 0.0) -> str:
    """Fault of a channel, empty if none; RecordingError where it is neither a
    force nor a torque.
    """
    return next(_faults(recording, name, recording.load(name), shortest), "")


def check_samples(recording: Recording, name: str) -> np.ndarray:
    """Samples (n,) of a channel in any unit; RecordingError where there are none, or NaN, constant,
    clipped or repeated ones.
    """
    x = recording[name]
    known = filter(None, [(recording.faults or {}).get(name), "" if x.size else "is empty"])
    _refuse(
        recording,
        name,
        next(
            chain(
                known,
                _broken(x, recording.sample_rate),
                _in_samples(x, recording.sample_rate, recording.units.get(name, "")),
            ),
            "",
        ),
    )
    return x


def _faults(recording: Recording, name: str, x: np.ndarray, shortest: float) -> Iterator[str]:
    """Faults of the samples ``x`` (n,) of a channel, the most obvious first."""
    rate = recording.sample_rate
    if x.size == 0:
        yield "is empty"
    yield from filter(None, [(recording.faults or {}).get(name)])
    yield from _broken(x, rate)
    largest = float(np.max(np.abs(x)))
    if largest > MAX_LOAD:
        measured = f"{largest:.3g} {recording.units[name]}"
        yield f"reaches {measured}, beyond any instrument; the file is corrupt or its unit is wrong"
    if recording.duration < shortest:
        yield f"lasts {recording.duration:.4g} s; the lines asked for need {shortest:.4g} s"
    yield from _in_samples(x, rate, recording.units.get(name, ""))


def _broken(x: np.ndarray, rate: float) -> Iterator[str]:
    bad = np.flatnonzero(~np.isfinite(x))
    if bad.size:
        yield f"has {bad.size} samples that are not numbers, the first at {bad[0] / rate:.4g} s"


def _in_samples(x: np.ndarray, rate: float, unit: str = "") -> Iterator[str]:
    """Faults of samples as they were read, in their ``unit``."""
    if x.size == 0:
        return
    yield from _broken(x, rate)
    if np.ptp(x) == 0.0:
        yield f"is constant, {x[0]:g}; nothing was measured"
    away = np.abs(x - np.median(x))
    usual, k = float(np.quantile(away, 0.99)), int(np.argmax(away))
    if usual > 0.0 and away[k] > OUTLIER * usual:
        times = f"{away[k] / usual:.1g} times as large as 99 % of its samples"
        yield f"is {x[k]:.4g} at {k / rate:.4g} s, {times}; a number in the file is broken"
    if plateaus := find_plateaus(x):
        yield f"is clipped: {' and '.join(one.in_words(unit) for one in plateaus)}"
    yield from gap_faults(x, rate)


def _find_glitches(x: np.ndarray, rate: float) -> str:
    """Samples, up to three in a row, that leave their neighbours and come back at once, which no
    motion does; empty without.

    What rings, as after a blow, has many neighbours that bend, and a step does not come back.
    """
    if x.size < 100 or not np.all(np.isfinite(x)):
        return ""
    bend = np.abs(x[1:-1] - 0.5 * (x[:-2] + x[2:]))
    usual = float(np.quantile(bend, 0.999))
    far = np.flatnonzero(bend > GLITCH_RATIO * usual) + 1
    if 0 < far.size <= 5 * (3 + 1e-4 * x.size):
        groups = np.split(far, np.flatnonzero(np.diff(far) > 3) + 1)
    else:
        groups = []
    found = []
    for group in groups if usual > 0.0 else []:
        first, last = int(group[0]) - 1, int(group[-1]) + 1
        around = bend[np.r_[max(first - 11, 0) : max(first - 1, 0), last : last + 10]]
        straight = np.interp(np.arange(first, last + 1), [first, last], x[[first, last]])
        k = first + int(np.argmax(np.abs(x[first : last + 1] - straight)))
        size = float(np.abs(x[k] - straight[k - first]))
        if (
            last - first <= 6
            and abs(x[last] - x[first]) < 0.2 * size
            and np.max(around, initial=0.0) < 0.1 * size
        ):
            found.append((k, size / usual))
    if not found:
        return ""
    k, times = max(found, key=lambda one: one[1])
    if len(found) > 1:
        many = f", with {len(found) - 1} others,"
    else:
        many = ""
    what = f"{x[k]:.4g}, {times:.2g} times the local second difference, typical of a glitch"
    return f"has an isolated outlier sample{many} at {k / rate:.6g} s: {what}"


def _cycles_beyond_polynomial(order: int) -> float:
    """Cycles of a tone in a record from which a least-squares polynomial takes no more than
    ``LARGEST_BIAS`` of its amplitude, whatever its phase.

    Over the record from -1 to 1 the Legendre polynomial of order k has the part (2 k + 1) j_k(x)^2 of
    the mean square of exp(i x u), with the spherical Bessel function j_k: those of even order its
    cosine's, those of odd order its sine's.
    """
    from scipy.special import spherical_jn

    k = np.arange(order + 1)[:, None]
    cycles = np.arange(0.5, 20.0 * (order + 1.0), 0.01)
    x = math.pi * cycles
    parts = (2 * k + 1) * spherical_jn(k, x) ** 2
    whole = 0.5 + 0.25 * np.sin(2.0 * x) / x, 0.5 - 0.25 * np.sin(2.0 * x) / x
    taken = np.maximum(parts[::2].sum(axis=0) / whole[0], parts[1::2].sum(axis=0) / whole[1])
    return float(cycles[np.flatnonzero(taken > LARGEST_BIAS)[-1]])
