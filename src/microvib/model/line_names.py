"""Names of spectral lines, made and read in this one place.

A name says which family a line belongs to, which of its members it is, for a side line how many
full steps it lies beside its driving line, and whether the second wing's drive makes it:

>>> str(LineName("drive", 3, sideband=-2))
'drive_3_minus_2'
>>> LineName.parse("wing_2 full_step_1")
LineName(family='full_step', order=1, sideband=0, second_wing=True)
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

DRIVE, FULL_STEP, ELECTRICAL = "drive", "full_step", "electrical"
ARRAY_MODE, HUB_MODE, CONTROL_MODE = "array_mode", "hub_mode", "control_mode"
SECOND_WING_MODE = "wing_2_mode"
UNLISTED = "other"
"""Family of lines that were found and not expected; within a record they are numbered by size, so
that one name means another line in another record."""
SECOND_DRIVE = "wing_2"
"""Name of a second wing's drive in names of lines and of files."""
_MODES = (ARRAY_MODE, HUB_MODE, CONTROL_MODE, SECOND_WING_MODE)
_NAME = re.compile(
    rf"(?P<wing>{SECOND_DRIVE} )?(?P<family>.+?)"
    r"(?:_(?P<order>\d+)(?:_(?P<side>plus|minus)_(?P<steps>\d+))?)?"
)


@dataclass(frozen=True)
class LineName:
    """Parts of a line's name."""

    family: str
    """DRIVE, FULL_STEP, ELECTRICAL, a mode's, UNLISTED, or that of a gear's error."""
    order: int = 0
    """Which member of the family; 0 where it has but one."""
    sideband: int = 0
    """Full steps by which a side line lies beside its driving line; 0 of all others."""
    second_wing: bool = False
    """Whether the second wing's drive makes it."""

    def __str__(self) -> str:
        name = f"{self.family}_{self.order}" if self.order else self.family
        if self.sideband:
            side = "plus" if self.sideband > 0 else "minus"
            name = f"{name}_{side}_{abs(self.sideband)}"
        return of_second_wing(name) if self.second_wing else name

    @classmethod
    def parse(cls, text: str) -> LineName:
        """Parse a name; one of unknown form is a family of its own."""
        found = _NAME.fullmatch(text)
        if found is None:
            return cls(text)
        order, steps = int(found["order"] or 0), int(found["steps"] or 0)
        sideband = -steps if found["side"] == "minus" else steps
        read = cls(found["family"], order, sideband, found["wing"] is not None)
        if str(read) != text:  # such as a number that begins with 0
            return cls(text)
        return read

    @property
    def is_unlisted(self) -> bool:
        """Whether it was found where none was expected, in one record or in one of two."""
        return self.family == UNLISTED or self.family.startswith(f"{UNLISTED}_")

    @property
    def is_mode(self) -> bool:
        """Whether it is a mode's, of an array on a fixed base or of a craft."""
        return self.family in _MODES

    @property
    def is_driving_line(self) -> bool:
        """Whether it is a multiple of the driving frequency; side lines are not."""
        return self.family == DRIVE and not self.sideband

    @property
    def of_own_drive(self) -> LineName:
        """The name that the drive which makes it calls it by."""
        return replace(self, second_wing=False)


def of_second_wing(name: str) -> str:
    """The name of a line that the second wing's drive makes."""
    return f"{SECOND_DRIVE} {name}"


def is_unlisted(name: str) -> bool:
    """Whether a line was found where none was expected, by its name."""
    return LineName.parse(name).is_unlisted


def is_sideband(name: str) -> bool:
    """Whether a line is an expected side line of a driving line, by its name."""
    return LineName.parse(name).sideband != 0


def driving_line(order: int) -> str:
    """Name of a line at a multiple of the driving frequency."""
    return str(LineName(DRIVE, order))


def full_step_line(order: int) -> str:
    """Name of a line at a multiple of the full-step rate, or of the detent period."""
    return str(LineName(FULL_STEP, order))


def electrical_line(order: int) -> str:
    """Name of a line at a multiple of the electrical period."""
    return str(LineName(ELECTRICAL, order))
