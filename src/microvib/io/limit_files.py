"""Limits over frequency, read from CSV: one column of frequencies, and one of amplitudes for the torque
about the drive axis and each load that has a limit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from microvib.errors import MicrovibError, OptionError, did_you_mean, quoted_value
from microvib.io.file_access import WORKING_FOLDER, FileAccess
from microvib.io.tables import csv_rows, parse_finite, text_rows
from microvib.model.rigid import COMPONENTS
from microvib.signals.limit_curve import Limit, LimitCurve
from microvib.testdata.channels import as_load, load_in_name, named_unit
from microvib.units import Band, GivenQuantity, Si, convert

_ENDINGS = (".csv", ".txt", ".tsv")
"""Endings of the names of files that a limit may be."""
_TORQUE = ("t", "td", "torque", "amplitude")
"""Names of a column of the torque about the drive axis, without underscores."""
_REMARKS = "comment"
_LOWER_CASE = {
    "n_m": (1.0, "N*m"),
    "nm": (1.0, "N*m"),
    "mn_m": (1e-3, "N*m"),
    "mnm": (1e-3, "N*m"),
    "n": (1.0, "N"),
    "mn": (1e-3, "N"),
}
"""Units as names of columns end in small letters: factors to SI, and what they measure."""
_IN_NAME = re.compile(rf"(.*?)_({'|'.join(_LOWER_CASE)})")
_EXAMPLE = "frequency_hz,t_mnm"


def read_limit(file: Path | str, band: Band | None = None) -> Limit:
    """Read a limit over frequency from a CSV file.

    Its first line names the columns: ``frequency_hz`` (or ``frequency [kHz]``), and one or more
    amplitudes, 0-to-peak, with their units: ``t_nm`` or ``t_mnm`` of the torque about the drive axis,
    ``fx_n`` to ``fz_n`` and ``mx_nm`` to ``mz_nm`` of the loads on the spacecraft, or such as
    ``Mz [mN m]``. Between points curves are straight on logarithmic scales, the same frequency twice is
    a step, and beyond the first and last point nothing is limited. An empty cell is no point of its
    curve, nor is one that is repeated for another column's step, and lines that begin with # are remarks.

    Parameters
    ----------
    file : str or path
        The file.
    band : str or pair, optional
        Part of it that counts, such as ``"0.5:150 Hz"``.

    Returns
    -------
    Limit
        The limit.

    Raises
    ------
    OptionError
        Where it cannot be read, or is no limit: names row and column.

    Examples
    --------
    >>> import microvib as mv
    >>> from pathlib import Path
    >>> _ = Path("allowed.csv").write_text("frequency_hz,t_mnm\\n1,5\\n100,50\\n")
    >>> mv.read_limit("allowed.csv")
    Limit of 5 to 50 mN m over frequency, from 1 to 100 Hz
    >>> Path("allowed.csv").unlink()
    """
    with _as_option_errors():
        return _limit_of_rows(str(file), csv_rows(Path(file), MicrovibError)).within(band)


def limit_from_text(text: str, name: str = "limit") -> Limit:
    """As ``read_limit``, of the contents of a file that its owner calls ``name``."""
    with _as_option_errors():
        return _limit_of_rows(name, text_rows(text))


def given_limit(
    given: GivenQuantity | None,
    band: Band | None = None,
    files: FileAccess = WORKING_FOLDER,
) -> Limit | None:
    """The limit that a torque or the name of a file states, in a band.

    Parameters
    ----------
    given : str, Si or None
        A torque such as ``"10 mN*m"``, or a CSV file of a curve; None for no limit.
    band : str or pair, optional
        Where it holds, such as ``"0.5:150 Hz"``; of a curve, its part there.
    files : FileAccess
        Permission to open files.

    Returns
    -------
    Limit or None
        None without a limit.

    Raises
    ------
    OptionError
        For what is no limit or band.
    ScenarioError
        Where a file is named and none may be opened.
    """
    if not is_limit_file(given):
        return Limit.of(given, band)
    return read_limit(files.under("limit").path(given), band)


def is_limit_file(given: GivenQuantity | None) -> bool:
    """Whether a limit is given as the name of a file rather than a torque."""
    return (
        isinstance(given, str)
        and not isinstance(given, Si)
        and given.strip().lower().endswith(_ENDINGS)
    )


@contextmanager
def _as_option_errors() -> Iterator[None]:
    """Whatever is wrong with a file as an error of the option that names it."""
    try:
        yield
    except OptionError:
        raise
    except MicrovibError as error:
        raise OptionError("limit", str(error), remedy=error.remedy) from None


def _limit_of_rows(name: str, rows: Sequence[Sequence[str]]) -> Limit:
    """The limit of a table's rows, of which the first is its header; those that begin with # are
    remarks.
    """
    numbered = [
        (k, row)
        for k, row in enumerate(rows, 1)
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
    ]
    if not numbered:
        raise MicrovibError(f"{name}: is empty; a header such as {_EXAMPLE} is expected")
    (_, head), *points = numbered
    columns = _columns(name, head)
    for k, row in points:
        if len(row) > len(head):
            raise MicrovibError(
                f"{name}, row {k}: has {len(row)} cells, and the first line names {len(head)}"
                " columns"
            )
    curves = {
        key: _curve(name, column, columns["frequency"], points, several=len(columns) > 2)
        for key, column in columns.items()
        if key != "frequency"
    }
    torque = curves.pop("torque", None)
    return Limit.of_curves(torque, curves, Path(name).name)


class _Column:
    """A column that is read: its place, name and factor to SI."""

    def __init__(self, place: int, name: str, factor: float) -> None:
        self.place, self.name, self.factor = place, name, factor

    def value(self, where: str, row: Sequence[str]) -> float | None:
        """The figure of a row in SI; None where its cell is empty."""
        cell = row[self.place].strip() if self.place < len(row) else ""
        if not cell:
            return None
        return self.factor * parse_finite(f"{where}: {self.name}:", cell, MicrovibError)


def _columns(name: str, head: Sequence[str]) -> dict[str, _Column]:
    """Columns by ``frequency``, ``torque`` and the names of loads; an error for one that is not
    known or there twice, or where one is missing."""
    found: dict[str, _Column] = {}
    for place, written in enumerate(head):
        if written.strip().lower() in (_REMARKS, ""):
            continue
        key, factor = _meaning(name, written.strip())
        if key in found:
            raise MicrovibError(
                f"{name}: columns {quoted_value(found[key].name)} and"
                f" {quoted_value(written.strip())} are of the same; leave one of them out"
            )
        found[key] = _Column(place, written.strip(), factor)
    if "frequency" not in found:
        raise MicrovibError(f"{name}: has no column of frequencies; frequency_hz is expected")
    if len(found) == 1:
        raise MicrovibError(
            f"{name}: has no column of amplitudes; one such as t_mnm or mz_nm is expected"
        )
    return found


def _meaning(name: str, written: str) -> tuple[str, float]:
    """Meaning of a column, and its factor to SI; an error where that is not known."""
    own, unit = _name_and_unit(written)
    plain = own.lower().replace("_", "").replace(" ", "")
    if plain in ("frequency", "freq", "f"):
        return "frequency", _frequency_factor(name, written, unit)
    component = next((each for each in COMPONENTS if each.lower() == plain), "")
    if not component and plain not in _TORQUE:
        raise MicrovibError(
            f"{name}: column {quoted_value(written)} is not known;"
            f" {did_you_mean(plain, [*_TORQUE, *(x.lower() for x in COMPONENTS)])}allowed are"
            " frequency_hz, t_nm of the torque about the drive axis, fx_n to fz_n and mx_nm to"
            " mz_nm of the loads, each in any unit, and comment for remarks"
        )
    wanted = "N" if component.startswith("F") else "N*m"
    if not unit:
        raise MicrovibError(
            f"{name}: column {quoted_value(written)} has no unit; a name such as"
            f" {plain}_{'n' if wanted == 'N' else 'nm'} is expected"
        )
    load = _LOWER_CASE.get(unit) or as_load(f"1 {unit}")
    if load is None or load[1] != wanted:
        kind = "force, in N" if wanted == "N" else "torque, in N m"
        raise MicrovibError(
            f"{name}: column {quoted_value(written)} is in {unit}; a {kind} or a part of it, is"
            " expected"
        )
    return component or "torque", load[0]


def _name_and_unit(written: str) -> tuple[str, str]:
    """Name and unit of a header such as ``mz_mnm``, ``Mz_mNm`` or ``Mz [mN m]``."""
    small = _IN_NAME.fullmatch(written)
    if small is not None:
        return small[1], small[2]
    own, unit = named_unit(written)
    if unit:
        return own, unit
    own, unit = load_in_name(written)
    if unit:
        return own, unit
    stem, _, ending = written.rpartition("_")
    if ending.lower() in ("hz", "khz", "mhz"):
        return stem, {"hz": "Hz", "khz": "kHz"}.get(ending.lower(), ending)
    return written, ""


def _frequency_factor(name: str, written: str, unit: str) -> float:
    """Factor of a column of frequencies to Hz."""
    if not unit:
        raise MicrovibError(
            f"{name}: column {quoted_value(written)} has no unit; frequency_hz is expected"
        )
    try:
        return convert(f"1 {unit}", "Hz")
    except ValueError:
        raise MicrovibError(
            f"{name}: column {quoted_value(written)} is in {unit}; a frequency in Hz or kHz is"
            " expected"
        ) from None


def _curve(
    name: str,
    column: _Column,
    frequency: _Column,
    rows: Sequence[tuple[int, Sequence[str]]],
    *,
    several: bool,
) -> LimitCurve:
    """The curve of a column of a file that is called ``name``, one of ``several``; its ``rows`` have
    their numbers.
    """
    points = list(_points(name, column, frequency, rows))
    if several:  # a step of another column repeats the point of this one
        points = [point for k, point in enumerate(points) if k == 0 or point != points[k - 1]]
    where = f"{name}: {column.name}"
    if len(points) < 2:
        raise MicrovibError(f"{where}: has {len(points)} points; two or more are expected")
    try:
        return LimitCurve(*zip(*points, strict=True))
    except OptionError as error:
        raise MicrovibError(f"{where}: {str(error).removeprefix('limit: ')}") from None


def _points(
    name: str,
    column: _Column,
    frequency: _Column,
    rows: Sequence[tuple[int, Sequence[str]]],
) -> Iterator[tuple[float, float]]:
    """Frequencies [Hz] and amplitudes of the rows that have both."""
    for k, row in rows:
        place = f"{name}, row {k}"
        at, allowed = frequency.value(place, row), column.value(place, row)
        if at is None and allowed is None:
            continue
        if at is None:
            raise MicrovibError(f"{place}: {frequency.name}: is empty; a frequency is expected")
        if allowed is None:
            continue
        for one, value in ((frequency, at), (column, allowed)):
            if not value > 0.0:
                shown = value / one.factor
                raise MicrovibError(f"{place}: {one.name}: {shown:g} is not above 0")
        yield at, allowed
