"""Sections of a record: between two times, or about a trigger."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from microvib.errors import OptionError
from microvib.testdata.channels import as_measured
from microvib.testdata.recording import Recording, RecordingError
from microvib.units import GivenQuantity, quantity

_TRIGGER = re.compile(r"\s*(?P<channel>.+?)\s*(?P<slope>[<>])\s*(?P<level>[^<>]+?)\s*")
_EXAMPLE = "'Mz > 5 mN*m' (rising through it) or 'Mz < -5 mN*m' (falling)"


@dataclass(frozen=True)
class Trigger:
    """Level of a channel whose first crossing, in one direction, is time zero."""

    channel: str
    level: str
    """With its unit, as given."""
    rising: bool

    @classmethod
    def stated(cls, text: str) -> Trigger:
        """The trigger of a text such as ``Mz > 5 mN*m``; OptionError where it is none."""
        found = _TRIGGER.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            raise OptionError("trigger", f"{text!r} is not a trigger; write {_EXAMPLE}")
        return cls(found["channel"], found["level"], found["slope"] == ">")

    def __str__(self) -> str:
        way = "rises" if self.rising else "falls"
        return f"{self.channel} {way} through {self.level}"

    def place(self, recording: Recording) -> int:
        """First sample at or beyond the level, of one before that is not.

        RecordingError where the channel never crosses the level, with the range that it has.
        """
        x, level = recording[self.channel], self._level(recording)
        beyond = x >= level if self.rising else x <= level
        crossed = np.flatnonzero(beyond[1:] & ~beyond[:-1])
        if crossed.size == 0:
            unit = recording.units.get(self.channel, "")
            raise RecordingError(
                f"{recording.title}: trigger: {self.channel} never {str(self).partition(' ')[2]};"
                f" it goes from {x.min():.4g} to {x.max():.4g} {unit}".rstrip()
            )
        return int(crossed[0]) + 1

    def _level(self, recording: Recording) -> float:
        unit = recording.units.get(self.channel, "").strip()
        found = as_measured(self.level)
        if found is not None and found[1] == unit:
            return found[0]
        number = re.fullmatch(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(.*)", self.level)
        try:
            if number is not None and number[2].strip() == unit:
                return float(number[1])
        except ValueError:
            pass
        expected = unit or "a number: the channel has no unit"
        raise OptionError(
            "trigger", f"level {self.level!r} is not in the channel's unit, {expected}"
        )


@dataclass(frozen=True)
class Section:
    """A part of a record; its ends count from the first sample, or from a trigger.

    ``Section.stated`` makes one of texts with units.

    Parameters
    ----------
    start, stop : float, optional
        Ends [s]; with a trigger, ``stop`` counts from it.
    trigger : Trigger, optional
        Level and slope of a channel that begin the section.
    pre_trigger : float
        Time [s] before the trigger that is kept, too.

    Examples
    --------
    >>> import microvib as mv
    >>> mv.Section.stated("2 s", "12 s")
    Section(start=2.0, stop=12.0, trigger=None, pre_trigger=0.0)
    """

    start: float | None = None
    stop: float | None = None
    trigger: Trigger | None = None
    pre_trigger: float = 0.0

    @classmethod
    def stated(
        cls,
        start: GivenQuantity | None = None,
        stop: GivenQuantity | None = None,
        trigger: str | None = None,
        pre_trigger: GivenQuantity | None = None,
    ) -> Section | None:
        """Make the section that options state.

        Parameters
        ----------
        start, stop : str or Si, optional
            Ends, such as ``"2 s"``; with a trigger, ``stop`` counts from it.
        trigger : str, optional
            Channel, slope and level, such as ``"Mz > 5 mN*m"``, where it first rises through it, or
            ``"Mz < -5 mN*m"``, where it falls.
        pre_trigger : str or Si, optional
            Time before the trigger that is kept, too.

        Returns
        -------
        Section or None
            None where nothing is stated.

        Raises
        ------
        OptionError
            Where the options contradict each other.
        """
        begin = None if start is None else float(quantity("from", start, "s"))
        end = None if stop is None else float(quantity("to", stop, "s"))
        lead = 0.0 if pre_trigger is None else float(quantity("pre_trigger", pre_trigger, "s"))
        if trigger is None:
            if pre_trigger is not None:
                raise OptionError("pre_trigger", "needs a trigger", remedy="trigger")
            if begin is not None and begin < 0.0:
                raise OptionError("from", f"{begin:g} s is before the record; at least 0 s")
            if begin is None and end is None:
                return None
        else:
            if begin is not None:
                raise OptionError(
                    "from",
                    "does not go with a trigger, from which the section begins",
                    remedy="pre_trigger",
                )
            if lead < 0.0:
                raise OptionError("pre_trigger", f"{lead:g} s is not allowed; at least 0 s")
        return cls(begin, end, None if trigger is None else Trigger.stated(trigger), lead)

    def cut(self, recording: Recording) -> tuple[Recording, float]:
        """Cut the section out of a recording.

        Parameters
        ----------
        recording : Recording
            The whole record.

        Returns
        -------
        tuple of Recording and float
            The section, and the time [s] of its first sample in the record.

        Raises
        ------
        RecordingError
            Where it is not within the record, or the trigger does not come.
        """
        zero, note = 0.0, ""
        begin = self.start or 0.0
        if self.trigger is not None:
            zero = self.trigger.place(recording) / recording.sample_rate
            note = f"trigger: {self.trigger} at {zero:.6g} s"
            begin = zero - self.pre_trigger
            if begin < 0.0:
                raise RecordingError(
                    f"{recording.title}: the trigger comes at {zero:.4g} s, less than the"
                    f" {self.pre_trigger:g} s before it that are asked for"
                )
        end = recording.duration if self.stop is None else zero + self.stop
        if not begin < end:
            raise RecordingError(
                f"{recording.title}: the section from {begin:.4g} to {end:.4g} s is empty"
            )
        first, last = (round(at * recording.sample_rate) for at in (begin, end))
        cut = recording.looked_at(slice(first, last)).trimmed(begin, end)
        if note:
            cut = cut.noted(note)
        return cut, first / recording.sample_rate
