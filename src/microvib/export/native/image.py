"""One relocatable image of a drive: all that compiled code is called with, in one piece of memory.

An image is 64-bit words. Numbers and arrays lie in it as ``microvib.compiled.layout`` says; an
address is the offset of what it points to, and a list says which words are addresses. Who opens an
image copies it into memory of its size, adds the memory's address to these words, and can then
call the compiled functions with it. What a run changes lies together, so that the state of a run is
a copy of that part. docs/reference/export-interface.md describes the format.
"""

from __future__ import annotations

import inspect
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from microvib.compiled import Entry
from microvib.compiled.layout import Array, Record, place

MAGIC = int.from_bytes(b"MVIMAGE\0", "little")
VERSION = 1
"""Version of the format; whoever opens an image of another refuses it."""
HEADER_WORDS = 16
NAME_BYTES = 48
ENTRY_WORDS = NAME_BYTES // 8 + 4
ALIGNMENT = 8
"""Words that an array's place is a whole multiple of: 64 bytes."""
NUMBER, ARRAY = 0, 1
"""Kinds of entries of the directory."""


@dataclass(frozen=True)
class Call:
    """A call of a compiled function: its entry, and the arguments."""

    entry: Entry
    arguments: Sequence[Any]


@dataclass
class _Part:
    """An array of the image, and how many words it takes."""

    content: bytes
    words: int
    place: int = -1


@dataclass
class _Entry:
    name: str
    kind: int
    word: int
    """The word of a number; of an array the record that says where it is and how long."""
    part: _Part | None = None
    size: int = 1


@dataclass
class _Build:
    changed: frozenset[str]
    empty: frozenset[str]
    words: list[int] = field(default_factory=list)
    addresses: list[int] = field(default_factory=list)
    """Words that are addresses."""
    records: list[tuple[int, np.ndarray, _Part]] = field(default_factory=list)
    """Words that point to the record of an array, to be laid out behind the arguments."""
    entries: list[_Entry] = field(default_factory=list)
    constant: list[_Part] = field(default_factory=list)
    mutable: list[_Part] = field(default_factory=list)
    zero: list[_Part] = field(default_factory=list)
    known: dict[tuple[int, int], _Part] = field(default_factory=dict)
    """Parts by address and size of their arrays: what shares memory goes on sharing it."""

    def add_call(self, name: str, call: Call) -> int:
        """Words of a call's arguments; the offset [words] of the first, from that of all calls."""
        begun = len(self.words)
        names = list(inspect.signature(call.entry.python).parameters)
        kinds = call.entry.signature.arguments.fields
        for argument, kind, value in zip(names, kinds, call.arguments, strict=True):
            self._add(f"{name}.{argument}", kind, value)
        return begun

    def _add(self, name: str, kind: Any, value: Any) -> None:
        if isinstance(kind, Record):
            for part, each, content in zip(value._fields, kind.fields, value, strict=True):
                self._add(f"{name}.{part}", each, content)
        elif isinstance(kind, Array):
            place(value, kind.dtype, kind.ndim)  # TypeError for what compiled code could not take
            part = self.part_of(name, value)
            self.records.append((len(self.words), value, part))
            self.words.append(0)
            self.entries.append(_Entry(name, ARRAY, len(self.words) - 1, part, value.size))
        else:
            (word,) = struct.unpack("=q", struct.pack("=" + kind.code, value))
            self.entries.append(_Entry(name, NUMBER, len(self.words)))
            self.words.append(word)

    def part_of(self, name: str, array: np.ndarray) -> _Part:
        """The part of an array, of which the first name says what becomes of it."""
        key = (array.ctypes.data if array.size else 0, array.nbytes)
        if key not in self.known:
            content = array.tobytes()
            part = _Part(content, -(-len(content) // 8))
            self.known[key] = part
            short = name.partition(".")[2]
            if short in self.empty:
                self.zero.append(part)
            elif short in self.changed:
                self.mutable.append(part)
            else:
                self.constant.append(part)
        return self.known[key]

    def add_array(self, name: str, array: np.ndarray) -> None:
        """An array beside those of the calls, found by its name."""
        part = self.part_of(f".{name}", array)
        self.entries.append(_Entry(name, ARRAY, -1, part, array.size))


def image(
    calls: Mapping[str, Call],
    beside: Mapping[str, np.ndarray],
    changed: Iterable[str],
    empty: Iterable[str],
) -> bytes:
    """Bytes of the image of some ``calls``, and of named arrays ``beside`` them.

    ``changed`` names the arrays, without the name of their call, that a run changes, and ``empty``
    those of which the content does not count, which are not stored: they are zeros when an image is
    opened.
    """
    build = _Build(frozenset(changed), frozenset(empty))
    begun = {name: build.add_call(name, call) for name, call in calls.items()}
    keep = dict(beside)  # arrays are known by their addresses: none may go before the last came
    for name, array in keep.items():
        build.add_array(name, array)
    for name, first in begun.items():
        build.entries.append(_Entry(name, NUMBER, first))
    return _laid_out(build)


def _laid_out(build: _Build) -> bytes:
    """The image: header, directory, list of addresses, calls, records, arrays; zeros are left out."""
    records = [4 + array.ndim for _, array, _ in build.records]
    addresses = 3 * len(build.records)
    calls = HEADER_WORDS + ENTRY_WORDS * len(build.entries) + addresses
    at_records = calls + len(build.words)
    constant = _aligned(at_records + sum(records))
    mutable = _placed(build.constant, constant)
    zero = _placed(build.mutable, mutable)
    end = _placed(build.zero, zero)
    words = np.zeros(zero, dtype=np.int64)
    words[calls:at_records] = build.words
    relocated = _place_records(words, build, calls, at_records)
    directory = _directory(build, calls, words)
    words[HEADER_WORDS : HEADER_WORDS + len(directory)] = directory
    first = HEADER_WORDS + len(directory)
    words[first : first + addresses] = relocated
    words[:HEADER_WORDS] = [
        MAGIC, VERSION, zero, end, len(build.entries), HEADER_WORDS, addresses, first,
        mutable, zero, calls, 0, 0, 0, 0, 0,
    ]  # fmt: skip
    content = bytearray(words.tobytes())
    for part in (*build.constant, *build.mutable):
        content[8 * part.place : 8 * part.place + len(part.content)] = part.content
    return bytes(content)


def _aligned(place: int) -> int:
    return -(-place // ALIGNMENT) * ALIGNMENT


def _placed(parts: Sequence[_Part], place: int) -> int:
    """Place parts one after the other from ``place`` on [words]; the place after them."""
    for part in parts:
        part.place = place
        place = _aligned(place + part.words)
    return place


def _place_records(words: np.ndarray, build: _Build, calls: int, at: int) -> list[int]:
    """Write the records of arrays, (data, dimensions, place of these, nothing, lengths), and what
    points to them; the words that are addresses."""
    relocated = []
    for word, array, part in build.records:
        words[calls + word] = 8 * at
        words[at : at + 4] = 8 * part.place, array.ndim, 8 * (at + 4), 0
        words[at + 4 : at + 4 + array.ndim] = array.shape
        relocated += [calls + word, at, at + 2]
        at += 4 + array.ndim
    return relocated


def _directory(build: _Build, calls: int, words: np.ndarray) -> np.ndarray:
    """Entries of all numbers and arrays: name; kind, word of the number or of the array's record,
    place and size of the array."""
    rows = np.zeros((len(build.entries), ENTRY_WORDS), dtype=np.int64)
    for row, entry in zip(rows, build.entries, strict=True):
        name = entry.name.encode().ljust(NAME_BYTES, b"\0")
        assert len(name) == NAME_BYTES, entry.name
        assert name.endswith(b"\0"), entry.name
        row[: NAME_BYTES // 8] = np.frombuffer(name, dtype=np.int64)
        record = -1
        if entry.kind == NUMBER:
            record = calls + entry.word
        elif entry.word >= 0:
            record = int(words[calls + entry.word]) // 8
        place = entry.part.place if entry.part is not None else record
        row[NAME_BYTES // 8 :] = entry.kind, record, place, entry.size
    return rows.ravel()
