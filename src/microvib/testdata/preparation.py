"""Preparation of a recording before its lines are found: channel and unit map, axes, cross-talk,
trimming, filters.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from microvib.errors import quoted_value
from microvib.model.part import Part, Six
from microvib.testdata.bench import Bench
from microvib.testdata.channels import (
    COUNTS,
    FULL_SCALE,
    as_denominator,
    as_measured,
    is_time,
    is_unit,
    measured_per,
)
from microvib.testdata.moved import with_moved_torques
from microvib.testdata.recording import Recording, RecordingError
from microvib.testdata.response import Chain, without_response
from microvib.testdata.table_correction import TableFrf, without_table_dynamics
from microvib.testdata.table_response import modelled_response
from microvib.units import Quantity, convert


def _metres(given: Any) -> Any:
    """Coordinate in metres of one with a unit; a bare number is in metres."""
    if not isinstance(given, str):
        return given
    try:
        return convert(given, "m")
    except ValueError as error:
        raise ValueError(f"{quoted_value(given)} {error}") from None


Metres = Annotated[
    float, BeforeValidator(_metres, json_schema_input_type=float | str), Field(allow_inf_nan=False)
]
"""Coordinate as the file of a bench has it, with its unit, or in metres without."""


class Preparation(Part):
    """Steps from a file's channels to the six components in the drive's frame, in the order of the
    keys.
    """

    sample_rate: (
        Annotated[float, Quantity("Hz", "sample rate, where the file has no time axis", gt=0)]
        | None
    ) = None
    time: str | None = Field(
        default=None, max_length=200, description="name of the column that is the time axis"
    )
    units: dict[str, str] = Field(
        default_factory=dict,
        description="unit of a channel of the file, or what one count of it stands for ('20 N')",
    )
    sensitivity: dict[str, str] = Field(
        default_factory=dict,
        description="what one unit of a channel stands for ('0.5 N*m/V'), or the reverse ('2 mV/N')",
    )
    channels: dict[str, str] = Field(
        default_factory=dict,
        description="component: channel of the file, with a minus sign to reverse it",
    )
    bench: Bench | None = Field(
        default=None,
        description="force table that recorded it: a name of the catalog or a bench file, whose noise, resonances and"
        " usable band then count",
    )
    response: Chain = Field(
        default=(),
        description="measuring chain whose response is removed: boxcar, or a list of stages",
    )
    cross_talk: tuple[Six, Six, Six, Six, Six, Six] | None = Field(
        default=None, description="6 x 6 matrix: readings Fx Fy Fz Mx My Mz = matrix x loads"
    )
    table_frf: TableFrf | None = Field(
        default=None,
        description="frequency response of the table, which is taken out up to half of its first resonance",
    )
    offset: tuple[Metres, Metres, Metres] | None = Field(
        default=None,
        description="position of the interface point in the table's frame, in m unless units are given; torques are"
        " moved there",
    )
    axes: tuple[str, str, str] | None = Field(
        default=None,
        description="the drive frame's x, y, z as axes of the table, such as [y, -x, z]",
    )
    start: Annotated[float, Quantity("s", "start of the part that is kept", ge=0)] | None = None
    stop: Annotated[float, Quantity("s", "end of the part that is kept", gt=0)] | None = None
    detrend: int | None = Field(
        default=None, ge=0, le=8, description="order of the polynomial that is removed"
    )
    decimate: int | None = Field(
        default=None, ge=1, le=10_000, description="keep every n-th sample, after a low-pass"
    )
    background: str | None = Field(
        default=None,
        max_length=1000,
        description="recording of the table without the drive running",
    )

    def apply(self, recording: Recording) -> Recording:
        """The prepared recording, in SI, of one in its file's units; RecordingError where a step
        does not go with it.
        """
        recording = self._in_si(recording)
        if self.bench is not None:
            recording = replace(recording, table=self.bench.force_table)
        ends = [
            None if at is None else round(at * recording.sample_rate)
            for at in (self.start, self.stop)
        ]
        recording = recording.looked_at(slice(*ends))
        return self._shortened(self._at_interface(self._without_instrument(recording)))

    def _in_si(self, recording: Recording) -> Recording:
        """The recording in SI, its channels by their right names."""
        units = {name: text for name, text in self.units.items() if name != self.time}
        recording = _scaled(_in_units(recording, units), self.sensitivity)
        if self.channels:
            recording = recording.mapped(self.channels)
        return recording.in_si()

    def _without_instrument(self, recording: Recording) -> Recording:
        """The recording less what the chain, the cross-talk and the table make of it."""
        if self.response:
            recording = without_response(recording, self.response)
        if self.cross_talk is not None:
            recording = recording.without_cross_talk(np.array(self.cross_talk))
        if self.table_frf is not None:
            recording = self._without_table_dynamics(recording, self.table_frf)
        return recording

    def _at_interface(self, recording: Recording) -> Recording:
        """The recording about the interface point, along the axes of the drive."""
        if self.offset is not None:
            if self.bench is not None and self.bench.torques_about == "interface":
                raise RecordingError(
                    f"{recording.title}: offset: the bench records torques about the interface"
                    " (torques_about); leave offset out, or they are moved twice"
                )
            recording = with_moved_torques(recording, self.offset)
        if self.axes is not None:
            recording = _turned(recording, self.axes)
        return recording

    def _shortened(self, recording: Recording) -> Recording:
        """The part of the recording that is kept, less its trend, at its lower sample rate."""
        if self.start is not None or self.stop is not None:
            recording = recording.trimmed(
                self.start or 0.0, recording.duration if self.stop is None else self.stop
            )
        if self.detrend is not None:
            recording = recording.detrended(self.detrend)
        if self.decimate in (None, 1):
            return recording
        return recording.decimated(self.decimate or 1)

    def _without_table_dynamics(self, recording: Recording, how: TableFrf) -> Recording:
        """The recording less its table's dynamics, by a measured response or that of the bench."""
        if self.bench is not None and self.bench.torques_about == "interface":
            raise RecordingError(
                f"{recording.title}: table_frf: the bench records torques about the interface"
                " (torques_about), of several components of the table; record them about the table"
            )
        if how.measured is not None:
            if how.measured.coupled and self.cross_talk is not None:
                raise RecordingError(
                    f"{recording.title}: table_frf: its 36 responses hold the cross-talk; leave"
                    " cross_talk out, or it is taken out twice"
                )
            return without_table_dynamics(recording, how.measured, how)
        if self.bench is None or not self.bench.table:
            raise RecordingError(
                f"{recording.title}: table_frf: file is missing, or a bench with resonances (table), whose"
                " response is then taken"
            )
        modelled = modelled_response(
            f"the model of {self.bench.title or 'the table'}", self.bench.loaded_table
        )
        return without_table_dynamics(recording, modelled, how)


def _in_units(recording: Recording, given: dict[str, str]) -> Recording:
    """Channels in other units than their file says, or by how many units a count stands for; that
    of its time axis was minded.
    """
    channels, units = dict(recording.channels), dict(recording.units)
    for name, text in given.items():
        if name not in channels and (is_time(name) or name in recording.axes):
            continue
        values = recording[name]
        if re.match(r"\s*[+-]?[\d.]", text) is None:
            if not is_unit(text):
                raise RecordingError(
                    f"{recording.title}: units.{name}: '{text}' is not a unit; write it such as"
                    " N*m, mV or counts"
                )
            if units.get(name) == FULL_SCALE and text.lower() not in COUNTS:
                raise RecordingError(
                    f"{recording.title}: units.{name}: '{text}' has no number; write what full"
                    f" scale is, such as '20 {text}'"
                )
            units[name] = text
            continue
        found = as_measured(text)
        if found is None:
            raise RecordingError(
                f"{recording.title}: units.{name}: '{text}' is neither a force nor a torque to the"
                " count, nor an acceleration"
            )
        channels[name], units[name] = values * found[0], found[1]
    if not given:
        return recording
    note = ", ".join(f"{name} in units of {text}" for name, text in given.items())
    return recording.noted(note, channels=channels, units=units)


def _scaled(recording: Recording, given: dict[str, str]) -> Recording:
    """Volts, charges or counts to loads."""
    channels, units = dict(recording.channels), dict(recording.units)
    for name, text in given.items():
        values, unit = recording[name], as_denominator(units.get(name, "").strip())
        found = measured_per(text, unit)
        if found is None:
            raise RecordingError(
                f"{recording.title}: sensitivity.{name}: '{text}' does not go with a channel in"
                f" {unit}; write it such as"
                f" 0.01 N*m/{unit} or 100 {unit}/(N*m)"
            )
        channels[name], units[name] = values * found[0], found[1]
    if not given:
        return recording
    note = ", ".join(f"{name} with a sensitivity of {text}" for name, text in given.items())
    return recording.noted(note, channels=channels, units=units)


def _turned(recording: Recording, axes: tuple[str, str, str]) -> Recording:
    """Components along the axes of the drive's frame, given as signed axes of the table's frame."""
    R = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        letter = axis.strip().lstrip("+-")
        if letter not in ("x", "y", "z"):
            raise RecordingError(
                f"{recording.title}: axes: '{axis}' is not known; allowed are x, y, z with a sign"
            )
        if axis.strip().startswith("-"):
            R[row, "xyz".index(letter)] = -1.0
        else:
            R[row, "xyz".index(letter)] = 1.0
    if abs(np.linalg.det(R) - 1.0) > 1e-9:
        raise RecordingError(
            f"{recording.title}: axes: {', '.join(axes)} is not a right-handed frame; name each"
            " axis once, with signs to suit"
        )
    return recording.combined(np.kron(np.eye(2), R), f"axes {', '.join(axes)}")
