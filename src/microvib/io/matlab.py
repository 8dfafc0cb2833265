"""MATLAB files of any version as plain data: arrays, texts, lists of cells, dicts of structs.

Sizes are bounded before anything is unpacked, since a few bytes may declare, or unpack to, more
than any memory.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from microvib.errors import MicrovibError
from microvib.io.hdf5 import MAX_BYTES, MAX_DEPTH, MAX_OBJECTS, Dataset, Group, open_hdf5

_MATRIX, _COMPRESSED = 14, 15  # types of elements in a file of version 5
_HOLDERS, _TEXT, _NUMBERS = (1, 2, 3), 4, range(6, 16)
"""Classes of arrays there: cells, structs and objects; characters; numbers."""


class MatlabError(MicrovibError):
    """A MATLAB file that is broken or too large."""


def read_matlab(path: Path) -> dict[str, Any]:
    """Variables of a file: arrays without axes of length one, ``str``, ``list`` of cells or of
    structs, ``dict`` of a struct.

    What is none of these (functions, objects, complex numbers, sparse matrices) is left out.
    MatlabError or Hdf5Error where the file is broken, or unpacks to more than is read.
    """
    with path.open("rb") as stream:
        start = stream.read(128)
    if start.startswith((b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")):
        with open_hdf5(path) as root:
            return _members_7_3(root)
    if len(start) >= 4 and 0 in start[:4]:
        _check_4(path)
    else:
        _check_5(path)
    from scipy.io import loadmat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = loadmat(path, simplify_cells=True)
    return {name: _plain_5(x) for name, x in data.items() if not name.startswith("__")}


def _plain_5(x: Any) -> Any:
    if isinstance(x, dict):
        return {key: _plain_5(value) for key, value in x.items()}
    if isinstance(x, list) or (isinstance(x, np.ndarray) and x.dtype.kind in "OU"):
        return [_plain_5(value) for value in (x if isinstance(x, list) else x.ravel())]
    if isinstance(x, str):
        return str(x)
    if isinstance(x, np.ndarray):
        return x
    if isinstance(x, (int, float, np.number, np.bool_)):
        return np.asarray(x)
    return None


def _members_7_3(group: Group) -> dict[str, Any]:
    """Fields of a group; attributes that MATLAB does not write, as of other programs, as fields
    beside them: ``Mz_units``.
    """
    found: dict[str, Any] = {}
    for name, x in group.members().items():
        if not name.startswith("#"):
            found[name] = _plain_7_3(x)
            if isinstance(x, Dataset):
                found |= {
                    f"{name}_{key}": value
                    for key, value in _attributes(x).items()
                    if f"{name}_{key}" not in found
                }
    return {**_attributes(group), **found}


def _attributes(x: Group | Dataset) -> dict[str, Any]:
    names = [
        n
        for n in x.attributes()
        if not n.startswith(("MATLAB_", "H5PATH", "_", "CLASS", "NAME", "DIMENSION", "REFERENCE"))
    ]
    values = {name: x.attribute(name) for name in names}
    return {
        name: value if isinstance(value, str) else np.asarray(value)
        for name, value in values.items()
    }


def _plain_7_3(x: Group | Dataset | None) -> Any:
    if x is None:
        return None
    if isinstance(x, Group):
        return _struct_7_3(x)
    if x.attribute("MATLAB_empty"):
        return "" if _is_text_7_3(x) else np.empty(0)
    if x.refers:
        return [_plain_7_3(v) for v in x.referred()]
    if not x.numeric:
        return None
    values = x.numbers(whole=True).T.squeeze()  # MATLAB stores columns first
    if not _is_text_7_3(x):
        return values
    if values.ndim < 2:
        return _text(values.ravel())
    return [_text(row) for row in values]


def _struct_7_3(group: Group) -> dict[str, Any] | list[dict[str, Any]]:
    """A struct, or a list of the structs of an array, each field of which is a list of references."""
    fields = group.members()
    if not fields or not all(_is_field_of_array(x) for x in fields.values()):
        return _members_7_3(group)
    columns = {name: _plain_7_3(x) for name, x in fields.items()}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _is_field_of_array(x: Group | Dataset) -> bool:
    return isinstance(x, Dataset) and x.refers and x.attribute("MATLAB_class") is None


def _is_text_7_3(x: Dataset) -> bool:
    return x.attribute("MATLAB_class") == "char"


def _text(codes: np.ndarray) -> str:
    return "".join(chr(int(code)) for code in codes)


def _check_4(path: Path) -> None:
    """MatlabError where matrices of version 4 say that they are longer than the file."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        at = 0
        while at < size:
            head = stream.read(20)
            if len(head) < 20:
                raise MatlabError("is truncated, or not a MATLAB file")
            if struct.unpack("<i", head[:4])[0] in range(5000):
                order = "<"
            else:
                order = ">"
            kind, rows, columns, imaginary, name = struct.unpack(f"{order}5i", head)
            item = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}.get(kind // 10 % 10)
            if (
                item is None
                or not 0 <= kind < 5000
                or min(rows, columns, name) < 0
                or imaginary not in (0, 1)
            ):
                raise MatlabError("is broken, or not a MATLAB file")
            at += 20 + name + rows * columns * item * (1 + imaginary)
            stream.seek(at)
        if at > size:
            raise MatlabError(f"is truncated; its last matrix has {rows} x {columns} values")


@dataclass
class _Sizes:
    bytes: int = 0
    held: int = 0


def _check_5(path: Path) -> None:
    """MatlabError where a file of version 5 unpacks to too much, is nested too deep, cut off, or
    has a name twice.
    """
    sizes, names = _Sizes(), set()
    for element, order in _elements(path):
        name = _walk(element, order, sizes)
        if name in names:
            raise MatlabError(f"has the variable {name} twice; keep one of them")
        names.add(name)


def _elements(path: Path) -> Iterator[tuple[bytes, str]]:
    """Content of each matrix of the file, unpacked, and its byte order."""
    unpacked = 0
    with path.open("rb") as stream:
        head = stream.read(128)
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        if order is None:
            raise MatlabError("is corrupt or truncated, or not a MATLAB file")
        while tag := stream.read(8):
            if len(tag) < 8:
                break
            kind, size = struct.unpack(f"{order}2I", tag)
            data = stream.read(min(size, MAX_BYTES))
            if len(data) < size:
                raise MatlabError("is truncated")
            if kind == _COMPRESSED:
                data = zlib.decompressobj().decompress(data, MAX_BYTES - unpacked + 1)
                unpacked += len(data)
                if unpacked > MAX_BYTES:
                    raise MatlabError(
                        f"unpacks to more than {MAX_BYTES / 1e9:g} GB; that much is not read"
                    )
                kind, data = (
                    (struct.unpack(f"{order}I", data[:4])[0] if len(data) >= 8 else 0),
                    data[8:],
                )
            if kind == _MATRIX:
                yield data, order


def _walk(data: bytes, order: str, sizes: _Sizes) -> str:
    """Name of a matrix, after a look at the sizes of all that it holds."""
    found = None
    waiting = [(0, len(data), 1)]
    while waiting:
        at, end, depth = waiting.pop()
        if depth > MAX_DEPTH:
            raise MatlabError(
                f"has cells nested more than {MAX_DEPTH} deep; deeper nesting is not read"
            )
        parts: list[tuple[int, int]] = []
        while at + 8 <= end:
            kind, size = struct.unpack_from(f"{order}2I", data, at)
            body, after = at + 8, at + 8 + -(-size // 8) * 8
            if kind >> 16:  # a small element: its size and its bytes in the tag
                kind, size, body, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            if body + size > end:
                raise MatlabError("is corrupt or truncated; a part of it is longer than the whole")
            if kind == _MATRIX:
                waiting.append((body, body + size, depth + 1))
            parts.append((body, size))
            at = after
        _count(data, order, parts, sizes)
        if found is None:
            if len(parts) > 2:
                found = data[parts[2][0] : sum(parts[2])].decode("latin-1")
            else:
                found = ""
    return found or ""


def _count(data: bytes, order: str, parts: list[tuple[int, int]], sizes: _Sizes) -> None:
    """Add what an array of these parts (flags, dimensions, name, ...) takes when it is unpacked."""
    if len(parts) < 2:
        return
    (flags, _), (at, size) = parts[:2]
    kind = struct.unpack_from(f"{order}I", data, flags)[0] & 0xFF
    count = 1
    for n in struct.unpack_from(f"{order}{size // 4}i", data, at):
        count *= n
        if n < 0:
            raise MatlabError(f"is broken; an array of it has {n} rows")
    if kind in _HOLDERS:
        sizes.held += count
    elif kind == _TEXT or kind in _NUMBERS:
        sizes.bytes += 8 * count
    if sizes.held > MAX_OBJECTS or sizes.bytes > MAX_BYTES:
        raise MatlabError(
            f"has more than {MAX_OBJECTS} cells or unpacks to more than {MAX_BYTES / 1e9:g} GB;"
            " that much is not read"
        )
