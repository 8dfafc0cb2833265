"""Universal files of test data: datasets 58, as text or binary (58b) in either byte order."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.io.measured import Axis, Column, Hints, recording_of
from microvib.testdata.recording import Recording, RecordingError

_DELIMITER = b"-1"
_HEADER_LINES = 11
_IEEE = 2
_FUNCTIONS = {
    2: "an auto spectrum", 3: "a cross spectrum", 4: "a frequency response function", 5: "a transmissibility", 6: "a coherence",
    7: "an auto correlation", 8: "a cross correlation", 9: "a power spectral density", 10: "an energy spectral density",
    11: "a probability density", 12: "a spectrum", 24: "a shock response spectrum", 25: "the response of a filter",
    26: "a multiple coherence", 27: "an order function",
}  # fmt: skip
_TIME, _UNKNOWN = 17, (0, 1)
_AXES = {18: "Hz", 19: "rpm", 20: "orders"}
"""Units of the kinds of abscissae that are not time, where the file names none."""
_DIRECTIONS = {0: "", 1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}
_NUMBER = re.compile(
    rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+|[+-]\d{3}(?!\d|\.))?|[+-]?(?:nan|inf\w*)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class _Dataset:
    """One dataset 58: what its header says, and its numbers in the order of the file."""

    label: str
    function: int
    response: tuple[str, int, int]  # name of the entity, node, direction
    reference: tuple[str, int, int]
    kind: int
    points: int
    even: bool
    start: float
    step: float
    abscissa: tuple[int, str, str]  # kind, label, unit
    unit: str
    reference_unit: str
    along_z: float
    values: np.ndarray
    remarks: tuple[str, ...] = ()
    """Lines of its header that are free text, behind the first."""
    z_unit: str = ""
    """Unit of the third axis."""

    @property
    def complex(self) -> bool:
        """Whether its ordinates are complex."""
        return self.kind in (5, 6)


def read_uff(path: Path, hints: Hints) -> Recording:
    """Channels of the time histories among the datasets 58 of a file; RecordingError where there is
    none, or one is broken.
    """
    data = path.read_bytes()
    if not data.rstrip().endswith(_DELIMITER):
        raise RecordingError("is truncated, or no UFF; its last dataset does not end with -1")
    sets = list(_datasets(data))
    if not sets:
        kinds = sorted({int(number) for number in _KINDS.findall(data)})
        raise RecordingError(
            "has no dataset 58, which holds recordings; it has"
            f" {', '.join(map(str, kinds[:12])) or 'none'}; export the time"
            " histories, too"
        )
    names = _names(sets)
    against = [
        f"channel {name}: measured against its direction"
        for name, s in zip(names, sets, strict=True)
        if s.response[2] < 0
    ]
    if against:
        turn = ["a minus sign in the preparation's channels turns it round"]
    else:
        turn = []
    return recording_of(
        [_column(s, name) for s, name in zip(sets, names, strict=True)], hints, [*against, *turn]
    )


RESPONSE, COHERENCE = 4, 6
"""Numbers of the functions of dataset 58 that a response of a table is made of."""


@dataclass(frozen=True)
class FrequencyFunction:
    """A function over frequency in a universal file."""

    label: str
    function: int
    response: int
    """Direction, 1 to 6 for x y z and rotations about them, with its sign; 0 where none is given."""
    reference: int
    unit: str
    reference_unit: str
    frequency: np.ndarray
    """[Hz], (m,)."""
    values: np.ndarray
    """Real or complex, (m,)."""
    along_z: float = 0.0
    """Its place along a third axis, such as a speed."""
    place: str = ""
    """Node and direction in words."""
    z_unit: str = ""
    """Unit of the third axis."""


def read_functions(
    path: Path, functions: Collection[int] = (RESPONSE, COHERENCE)
) -> list[FrequencyFunction]:
    """Functions of these numbers, frequency response functions and coherences where nothing else is asked
    for, among the datasets 58 of a file; RecordingError where it is broken.
    """
    data = path.read_bytes()
    if not data.rstrip().endswith(_DELIMITER):
        raise RecordingError("is truncated, or no UFF; its last dataset does not end with -1")
    found = []
    for s in _datasets(data):
        if s.function not in functions:
            continue
        if s.even:
            f, values = s.start + s.step * np.arange(s.points), s.values[: s.points]
        else:
            f, values = np.real(s.values[::2][: s.points]), s.values[1::2][: s.points]
        found.append(
            FrequencyFunction(
                s.label,
                s.function,
                s.response[2],
                s.reference[2],
                s.unit,
                s.reference_unit,
                f,
                values,
                s.along_z,
                _place(s),
                s.z_unit,
            )
        )
    return found


def _names(sets: list[_Dataset]) -> list[str]:
    """Names of the channels: their first lines where these tell them apart, else with node and
    direction, as 7:+Z.
    """
    labels = ["" if s.label.upper() == "NONE" else s.label for s in sets]
    places = [_place(s) for s in sets]
    found = []
    for label, place in zip(labels, places, strict=True):
        shared = labels.count(label) > 1
        found.append(f"{label} {place}".strip() if shared or not label else label)
    return [name or f"channel {k + 1}" for k, name in enumerate(found)]


def _place(s: _Dataset) -> str:
    name, node, direction = s.response
    if not node and not direction:
        if name.upper() == "NONE":
            return ""
        return name
    if not direction:
        sign = ""
    elif direction < 0:
        sign = "-"
    else:
        sign = "+"
    where = f"{node}:{sign}{_DIRECTIONS.get(abs(direction), abs(direction))}".rstrip(":")
    if name.upper() in ("", "NONE"):
        return where
    return f"{name}:{where}"


def _column(s: _Dataset, name: str) -> Column:
    kind, label, unit = s.abscissa
    unit = unit or _AXES.get(kind, "")
    what = _FUNCTIONS.get(s.function, "") or ("a spectrum, of complex values" if s.complex else "")
    unfit = ""
    if what or (kind not in (_TIME, *_UNKNOWN) and kind not in _AXES):
        what = what or "a function of something else than time"
        unfit = f"channel {name} is not a time history but {what}; export the time history"
    if s.even:
        values = s.values[: s.points]
    else:
        values = s.values[1::2][: s.points]
    if unfit:
        return Column(name, np.real(values), s.unit, unfit=unfit)
    if s.even:
        axis, time = Axis("abscissa", s.step, s.start, unit, label), None
    else:
        axis, time = None, Column("abscissa", s.values[::2][: s.points], unit)
    return Column(name, values, s.unit, time=time, axis=axis, remarks=s.remarks)


def _datasets(data: bytes) -> Iterator[_Dataset]:
    at, count = 0, 0
    while True:
        at = _after_delimiter(data, at)
        if at < 0:
            return
        line, after = _line(data, at)
        count += 1
        if not re.fullmatch(rb" *58(b.*)?", line.strip(), re.IGNORECASE):
            at = _after_delimiter(data, after)
            if at < 0:
                raise RecordingError(f"is truncated; dataset {count} of it does not end with -1")
            continue
        header: list[str] = []
        for _ in range(_HEADER_LINES):
            text, after = _line(data, after)
            header.append(
                text.decode("utf-8", "replace")
                if _is_utf8(text)
                else text.decode("cp1252", "replace")
            )
        try:
            found, at = _dataset(data, line, header, after)
        except (ValueError, IndexError) as error:
            raise RecordingError(f"dataset {count} of it is broken ({error})") from None
        yield found


def _is_utf8(text: bytes) -> bool:
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _line(data: bytes, at: int) -> tuple[bytes, int]:
    """A line without its end, and where the next one begins; lines end with LF, CR LF or CR."""
    ends = [k for k in (data.find(b"\n", at, at + 400), data.find(b"\r", at, at + 400)) if k >= 0]
    if not ends:
        return data[at : at + 400], min(at + 400, len(data))
    end = min(ends)
    return data[at:end], end + (2 if data[end : end + 2] == b"\r\n" else 1)


_KINDS = re.compile(rb"(?:^|[\r\n]) {4}-1 *[\r\n]+ *(\d{2,5})[ \r\n]")
_DELIMITERS = re.compile(rb"(?:^|(?<=[\r\n])) {4}-1 *(?:\r\n|\r|\n|$)")


def _after_delimiter(data: bytes, at: int) -> int:
    """Where the next line after a delimiter begins; -1 without one."""
    found = _DELIMITERS.search(data, at)
    if found is None:
        return -1
    return found.end()


def _field(text: str, first: int, size: int, kind: type = int) -> float:
    own = text[first : first + size].strip()
    if own:
        return kind(own.replace("D", "E").replace("d", "e"))
    return kind(0)


def _dataset(data: bytes, line: bytes, header: list[str], at: int) -> tuple[_Dataset, int]:
    """One dataset, and where what follows its end begins."""
    dof, form, x, y, per = header[5], header[6], header[7], header[8], header[9]
    (kind, points, spacing), (start, step, along_z) = _data_form(form)
    if kind not in (2, 4, 5, 6):
        raise RecordingError(
            f"channel {header[0].strip()} is broken; its data have the kind {kind}, and 2, 4, 5 or"
            " 6 is expected"
        )
    each = (2 if kind in (5, 6) else 1) + (0 if spacing == 1 else 1)
    label = header[0].strip()
    if points < 0 or points * each > 4 * len(data):
        raise RecordingError(
            f"channel {label} is truncated, or corrupt; it declares {points} samples"
        )
    if re.match(rb" *58 *b", line, re.IGNORECASE):
        values, at = _binary(data, line, at, _Numbers(label, kind, points, spacing == 1))
    else:
        values, at = _text(data, at, points * each, label, points)
    if kind in (5, 6):
        table = values.reshape(-1, each)
        values = table[:, -2] + 1j * table[:, -1]
        if spacing != 1:
            values = np.column_stack([table[:, 0], values]).ravel()
    function, response, reference = _ends(dof)
    abscissa = (int(_field(x, 0, 10)), _label(x, 25), _label(x, 46))
    return (
        _Dataset(
            label,
            function,
            response,
            reference,
            kind,
            points,
            spacing == 1,
            start,
            step,
            abscissa,
            _label(y, 46),
            _label(per, 46),
            along_z,
            values,
            tuple(filter(None, map(str.strip, [*header[1:5], _label(y, 25)]))),
            _label(header[10], 46),
        ),
        at,
    )


def _data_form(text: str) -> tuple[tuple[int, int, int], tuple[float, float, float]]:
    """Kind of data, points and spacing, first abscissa, step and place along a third axis, in columns
    or, from other programs, between blanks.
    """
    try:
        kind, points, spacing = (int(_field(text, k, 10)) for k in (0, 10, 20))
        start, step = _field(text, 30, 13, float), _field(text, 43, 13, float)
    except ValueError:
        words = text.replace("D", "E").split()
        kind, points, spacing = (int(word) for word in words[:3])
        return (kind, points, spacing), (float(words[3]), float(words[4]), _third(words[5:6]))
    return (kind, points, spacing), (start, step, _third([text[56:69]]))


def _third(words: list[str]) -> float:
    """Place along a third axis; 0 where it says none."""
    try:
        return float(words[0].replace("D", "E"))
    except (ValueError, IndexError):
        return 0.0


_Place = tuple[str, int, int]


def _ends(text: str) -> tuple[int, _Place, _Place]:
    """Function, and name, node and direction of its response and of its reference."""
    try:
        return (
            int(_field(text, 0, 5)),
            (text[31:41].strip(), int(_field(text, 41, 10)), int(_field(text, 51, 4))),
            (text[56:66].strip(), int(_field(text, 66, 10)), int(_field(text, 76, 4))),
        )
    except ValueError:
        words = text.split()
        reference = (words[7], int(words[8]), int(words[9])) if len(words) > 9 else ("", 0, 0)
        return int(words[0]), (words[4], int(words[5]), int(words[6])), reference


def _label(text: str, first: int) -> str:
    own = text[first : first + 21].strip()
    if own.upper() == "NONE":
        return ""
    return own


def _text(data: bytes, at: int, count: int, label: str, points: int) -> tuple[np.ndarray, int]:
    """Numbers as text up to the dataset's end."""
    end = _DELIMITERS.search(data, at)
    if end is None:
        raise RecordingError(f"channel {label} is truncated; its dataset does not end with -1")
    body = data[at : end.start()]
    try:
        values = np.array(body.split(), dtype=float)
    except ValueError:
        values = np.empty(0)
    if values.size != count:  # columns that run together, exponents with D
        found = [re.sub(rb"[Dd]|(?<=\d)(?=[+-]\d{3}$)", b"E", x) for x in _NUMBER.findall(body)]
        values = np.array(found, dtype=float)
    if values.size < count:
        raise RecordingError(
            f"channel {label} is truncated, {values.size * points // max(count, 1)} of {points}"
            " samples"
        )
    if values.size > count:
        raise RecordingError(
            f"channel {label} is broken; it has {values.size} numbers and says {count}"
        )
    return values, end.end()


@dataclass(frozen=True)
class _Numbers:
    """Layout of a dataset's numbers from its header."""

    label: str  # of the channel
    kind: int
    points: int
    even: bool  # without abscissas

    @property
    def size(self) -> int:
        """Bytes of a number."""
        return 4 if self.kind in (2, 5) else 8

    @property
    def parts(self) -> int:
        """Two of a complex number."""
        return 2 if self.kind in (5, 6) else 1

    @property
    def abscissa_sizes(self) -> tuple[int, ...]:
        """Bytes that an abscissa may have, 0 without."""
        return (0,) if self.even else (4, self.size)


def _binary(data: bytes, line: bytes, at: int, numbers: _Numbers) -> tuple[np.ndarray, int]:
    """Binary numbers, as many as the header says: what looks like an end within them is none."""
    text = line.decode("latin-1")
    order, form, said = (int(_field(text, *place)) for place in ((7, 6), (13, 6), (31, 12)))
    if form not in (0, _IEEE):
        raise RecordingError(
            f"channel {numbers.label} has numbers in a format other than IEEE 754 ({form}); export"
            " it again, or as text"
        )
    *others, last = numbers.abscissa_sizes
    for along in (*others, last):
        whole = numbers.points * (numbers.parts * numbers.size + along)
        stop = _end_at(data, at + whole)
        if stop >= 0 and (said in (0, whole) or along == last):
            return _unpacked(data[at : at + whole], order, numbers, along), stop
    raise RecordingError(
        f"channel {numbers.label} is truncated or corrupt: after its {numbers.points} samples the"
        f" dataset does not end (it says {said} bytes)"
    )


def _end_at(data: bytes, at: int) -> int:
    """Where what follows a delimiter begins that stands at ``at``, after the end of a line or
    blanks at most; -1 without.
    """
    found = re.compile(rb"[\r\n ]{0,90}-1 *(?:\r\n|\r|\n|$)").match(data, at)
    if found is None:
        return -1
    return found.end()


def _unpacked(data: bytes, order: int, numbers: _Numbers, along: int) -> np.ndarray:
    """Numbers of a dataset with abscissas of ``along`` bytes, in the byte order that it says; in
    the other where only that gives numbers of any sense.
    """
    found = []
    for mark in ("<", ">") if order in (0, 1) else (">", "<"):
        fields: list[Any] = [("y", f"{mark}f{numbers.size}", (numbers.parts,))]
        if along:
            fields = [("x", f"{mark}f{along}"), *fields]
        table = np.frombuffer(data, np.dtype(fields), count=numbers.points)
        columns = [table["y"].astype(float)]
        if along:
            columns = [table["x"].astype(float), *columns]
        found.append(np.column_stack(columns).ravel())
        if _is_plausible(found[-1]):
            return found[-1]
    return found[0]


def _is_plausible(values: np.ndarray) -> bool:
    """Whether numbers are of sizes that are measured, as they are not where their bytes are turned
    round.
    """
    size = np.abs(values[values != 0.0])
    return not size.size or float(np.mean((size > 1e-20) & (size < 1e20))) > 0.95
