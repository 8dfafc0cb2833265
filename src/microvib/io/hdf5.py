"""The one door to HDF5 files (MATLAB 7.3, netCDF 4, results): what leads out of the file is
refused, sizes are bounded first.

HDF5 lets a file name other files: external storage, external and user-defined links, virtual
datasets. Whoever opens such a file reads what its maker chose, with the reader's rights. Here only
hard links are followed, and of a dataset only what is stored in the file itself is read.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np

from microvib.errors import MicrovibError

MAX_BYTES = 2_000_000_000  # bytes in memory of all that is read of one file
MAX_FILTER_CHUNK = 100_000_000  # bytes in memory of one chunk of a dataset
MAX_OBJECTS = 10_000  # groups, datasets and references that are opened of one file
MAX_DEPTH = 10  # groups within groups
MAX_TEXT_LENGTH = 65_536  # bytes of one text
DEFLATE = 1
FILTERS = {DEFLATE: "deflate", 2: "shuffle", 3: "fletcher32"}
"""Filters that HDF5 has built in, by their numbers; others would be loaded from plug-ins."""


class Hdf5Error(MicrovibError):
    """An HDF5 file that is broken, too large, or not whole in itself."""


@contextmanager
def open_hdf5(path: Path | str) -> Iterator[Group]:
    """Root group of a file; Hdf5Error for whatever is wrong with the file while it is open."""
    try:
        with h5py.File(path, "r", driver="sec2") as f:
            root = h5py.h5g.open(f.id, b"/")
            yield Group(root, _File(str(path), h5py.h5o.get_info(root).fileno), "")
    except (MicrovibError, MemoryError):
        raise
    except Exception as error:  # the library raises whatever it meets in a broken file
        raise Hdf5Error(
            f"{path}: is corrupt or truncated, or not HDF5 ({type(error).__name__}: {error})"
        ) from None


@dataclass
class _File:
    """The file that objects must lie in, and what was read of it so far."""

    title: str
    number: int
    objects: int = 0
    bytes: int = 0

    def count_object(self) -> None:
        self.objects += 1
        if self.objects > MAX_OBJECTS:
            raise Hdf5Error(
                f"{self.title}: has more than {MAX_OBJECTS} groups and datasets; that many are not"
                " read"
            )

    def count_bytes(self, size: int) -> None:
        self.bytes += size
        if self.bytes > MAX_BYTES:
            raise Hdf5Error(
                f"{self.title}: unpacks to {self.bytes / 1e9:.3g} GB; at most {MAX_BYTES / 1e9:g}"
                " GB of one file are read"
            )


@dataclass(frozen=True)
class _Object:
    id: Any  # identifier of h5py's low-level interface
    file: _File = field(repr=False)
    name: str  # path in the file
    depth: int = 0

    @property
    def where(self) -> str:
        """File and object, for messages."""
        return f"{self.file.title}: {self.name or '/'}"

    def attributes(self) -> list[str]:
        """Names of its attributes that hold a text or a number."""
        names = [
            h5py.h5a.open(self.id, index=k).name
            for k in range(min(h5py.h5a.get_num_attrs(self.id), MAX_OBJECTS))
        ]
        return [
            name.decode("utf-8", "replace")
            for name in names
            if self.attribute(name.decode("utf-8", "replace")) is not None
        ]

    def attribute(self, name: str) -> str | float | None:
        """A text or a number of the object; None if there is none, or where it is a list or
        anything else.
        """
        key = name.encode()
        if not h5py.h5a.exists(self.id, key):
            return None
        attribute = h5py.h5a.open(self.id, key)
        kind = attribute.get_type()
        if (
            attribute.get_space().get_simple_extent_npoints() != 1
            or kind.get_size() > MAX_TEXT_LENGTH
        ):
            return None
        if isinstance(kind, h5py.h5t.TypeStringID):
            return _text(np.ravel(h5py.AttributeManager(self)[name])[0])
        if isinstance(kind, (h5py.h5t.TypeIntegerID, h5py.h5t.TypeFloatID)):
            values = np.empty(1)
            attribute.read(values.reshape(attribute.shape))
            return float(values[0])
        return None


@dataclass(frozen=True)
class Group(_Object):
    """A group whose members are reached by hard links only."""

    def _links(self) -> dict[bytes, int]:
        """Address of each member by its name; Hdf5Error where one leads out of the file, or could."""
        found: dict[bytes, int] = {}
        refused: list[str] = []

        def look(name: bytes, link: Any) -> bool | None:
            shown = f"{self.where.rstrip('/')}/{name.decode('utf-8', 'replace')}"
            if link.type != h5py.h5l.TYPE_HARD:
                if link.type == h5py.h5l.TYPE_SOFT:
                    kind = "a soft link"
                else:
                    kind = "a link to another file"
                refused.append(
                    f"{shown} is {kind}; a file is read only if it contains its own data"
                )
            elif not name or b"/" in name or name in (b".", b".."):
                refused.append(f"{shown}: is not a name that an object can have")
            elif len(found) >= MAX_OBJECTS:
                refused.append(
                    f"{self.where}: has more than {MAX_OBJECTS} members; that many are not read"
                )
            else:
                found[name] = link.u
            if refused:
                return True
            return None

        self.id.links.iterate(look, info=True)
        if refused:
            raise Hdf5Error(refused[0])
        return found

    def members(self) -> dict[str, Group | Dataset]:
        """Groups and datasets of the group."""
        found = {}
        for name, address in self._links().items():
            member = self._opened(name, address)
            if member is not None:
                found[name.decode("utf-8", "replace")] = member
        return found

    def dataset(self, name: str) -> Dataset:
        """One dataset of the group; Hdf5Error if there is none."""
        address = self._links().get(name.encode())
        if address is None:
            member = None
        else:
            member = self._opened(name.encode(), address)
        if not isinstance(member, Dataset):
            raise Hdf5Error(f"{self.where}: has no dataset '{name}'")
        return member

    def _opened(self, name: bytes, address: int) -> Group | Dataset | None:
        opened = h5py.h5o.open(self.id, name)
        if h5py.h5o.get_info(opened).addr != address:
            raise Hdf5Error(f"{self.where}: what is called {name!r} is not what its link leads to")
        return _checked(opened, self, f"{self.name}/{name.decode('utf-8', 'replace')}")


@dataclass(frozen=True)
class Dataset(_Object):
    """A dataset that is stored in the file itself, through built-in filters."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape; () for one value."""
        if self.id.shape is None:
            return (0,)
        return tuple(self.id.shape)

    @property
    def numeric(self) -> bool:
        """Whether it holds plain numbers of at most eight bytes."""
        kind = self.id.get_type()
        return (
            isinstance(kind, (h5py.h5t.TypeIntegerID, h5py.h5t.TypeFloatID))
            and kind.get_size() <= 8
        )

    @property
    def refers(self) -> bool:
        """Whether it holds references to objects of its file, as cells of MATLAB do."""
        return bool(self.id.get_type().equal(h5py.h5t.STD_REF_OBJ))

    @property
    def complete(self) -> bool:
        """Whether all of it was written; what was not would read as the fill value."""
        size = math.prod(self.shape)
        chunks = self._chunks()
        if chunks is None:
            return size == 0 or self.id.get_storage_size() > 0
        wanted = math.prod(-(-n // c) for n, c in zip(self.shape, chunks, strict=True))
        return int(self.id.get_num_chunks()) >= wanted

    def numbers(self, column: int | None = None, *, whole: bool = False) -> np.ndarray:
        """Its numbers, or one column of a table; Hdf5Error where it has none, too many, or, of a
        ``whole``, some not written.
        """
        if not self.numeric:
            raise Hdf5Error(f"{self.where} holds no plain numbers")
        if column is None:
            shape = self.shape
        else:
            shape = self.shape[:1]
        self.file.count_bytes(math.prod(shape) * 8)
        self._check_chunks()
        if whole and not self.complete:
            raise Hdf5Error(f"{self.where}: not all of its values were written")
        table = h5py.Dataset(self.id)
        return np.asarray(table[...] if column is None else table[:, column])

    def texts(self) -> list[str]:
        """Its texts, in order of storage; Hdf5Error where they are not texts, or too many."""
        kind = self.id.get_type()
        if (
            not isinstance(kind, h5py.h5t.TypeStringID)
            or len(self.shape) > 1
            or kind.get_size() > MAX_TEXT_LENGTH
        ):
            raise Hdf5Error(
                f"{self.where} is not a list of texts of at most {MAX_TEXT_LENGTH} characters"
            )
        count = math.prod(self.shape)
        self.file.count_bytes(count * kind.get_size())
        self._check_chunks()
        whole = h5py.Dataset(self.id)
        if not self.shape:
            return [_text(whole[()])]
        # Many texts of variable length may all be the same large one: no more at a time than memory
        # holds of the largest.
        if kind.is_variable_str():
            largest = Path(self.file.title).stat().st_size
        else:
            largest = kind.get_size()
        block = max(1, MAX_BYTES // (4 * max(largest, 1)))
        found: list[str] = []
        for first in range(0, count, block):
            texts = [_text(x) for x in whole[first : first + block]]
            self.file.count_bytes(sum(map(len, texts)))
            found += texts
        return found

    def referred(self) -> list[Group | Dataset | None]:
        """Objects that it refers to, None for an empty reference; Hdf5Error where it holds anything
        else.
        """
        if not self.refers:
            raise Hdf5Error(f"{self.where} does not hold references to objects")
        if math.prod(self.shape) > MAX_OBJECTS:
            raise Hdf5Error(
                f"{self.where}: has more than {MAX_OBJECTS} references; that many are not read"
            )
        self._check_chunks()
        found: list[Group | Dataset | None] = []
        for k, reference in enumerate(np.ravel(h5py.Dataset(self.id)[...])):
            if reference:
                opened = h5py.h5r.dereference(reference, self.id)
            else:
                opened = None
            found.append(
                None if opened is None else _checked(opened, self, f"{self.name}({k + 1})")
            )
        return found

    def _chunks(self) -> tuple[int, ...] | None:
        plan = self.id.get_create_plist()
        if plan.get_layout() == h5py.h5d.CHUNKED:
            return cast(tuple[int, ...], plan.get_chunk())
        return None

    def _check_chunks(self) -> None:
        """Hdf5Error where a chunk unpacks to more than its size: the library would make room for
        whatever comes.
        """
        chunks = self._chunks()
        if chunks is None:
            return
        plan = self.id.get_create_plist()
        size = math.prod(chunks) * self.id.get_type().get_size()
        if size > MAX_FILTER_CHUNK:
            raise Hdf5Error(
                f"{self.where}: has chunks of {size / 1e6:.0f} MB; at most {MAX_FILTER_CHUNK / 1e6:g}"
                " MB are read"
            )
        filters = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
        if DEFLATE not in filters:
            return
        packed: list[tuple[int, ...]] = []

        def look(chunk: Any) -> None:
            if not chunk.filter_mask >> filters.index(DEFLATE) & 1:
                packed.append(chunk.chunk_offset)

        self.id.chunk_iter(look)
        for offset in packed:
            if (
                len(zlib.decompressobj().decompress(self.id.read_direct_chunk(offset)[1], size + 1))
                > size
            ):
                raise Hdf5Error(
                    f"{self.where}: unpacks to more than it says, {size} bytes to the chunk"
                )


def _checked(opened: Any, parent: _Object, name: str) -> Group | Dataset | None:
    """An object that was opened, if it lies in the file and holds its data itself; None for a named
    type.
    """
    depth, file = parent.depth + 1, parent.file
    file.count_object()
    where = f"{file.title}: {name}"
    if depth > MAX_DEPTH:
        raise Hdf5Error(
            f"{where}: has groups nested more than {MAX_DEPTH} deep; deeper nesting is not read"
        )
    if h5py.h5o.get_info(opened).fileno != file.number:
        raise Hdf5Error(
            f"{where} lies in another file; a file is read only if it contains its own data"
        )
    if isinstance(opened, h5py.h5g.GroupID):
        return Group(opened, file, name, depth)
    if not isinstance(opened, h5py.h5d.DatasetID):
        return None
    plan = (
        opened.get_create_plist()
    )  # asked before the shape: that of a virtual dataset opens its sources
    if plan.get_layout() == h5py.h5d.VIRTUAL or plan.get_external_count():
        raise Hdf5Error(
            f"{where} is stored in other files; a file is read only if it contains its own data"
        )
    filters = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
    if len(set(filters)) < len(filters) or not set(filters) <= set(FILTERS):
        raise Hdf5Error(
            f"{where} is packed with filters"
            f" {', '.join(FILTERS.get(k, f'number {k}') for k in filters)}; read are"
            f" {', '.join(FILTERS.values())}, each once; write it without or with gzip compression"
        )
    return Dataset(opened, file, name, depth)


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value)
