"""Routes about the library: what outlasts the server, its names, and what is taken out."""

from __future__ import annotations

from fastapi import APIRouter, Response

from microvib.web.jobs.library import Entry, Library
from microvib.web.routes.common import RequestRefused, StoreDependency, refusals
from microvib.web.routes.messages import EntryChanges, Id, Kept, KeptWhole, LibraryOf

_GONE = "no such entry in the library, or it was deleted"

routes = APIRouter(prefix="/library", responses=refusals(404))


def _shown(library: Library, entry: Entry) -> Kept:
    return Kept(**entry.model_dump(), size=library.size(entry.id))


@routes.get("")
def entries(store: StoreDependency) -> LibraryOf:
    """All entries, the newest first."""
    library = store.library
    if library is None:
        return LibraryOf(there=False, entries=[])
    found = [_shown(library, entry) for entry in reversed(library.entries())]
    return LibraryOf(there=True, entries=found)


@routes.get("/{id}")
def entry_of(id: Id, store: StoreDependency) -> KeptWhole:
    """An entry, and the request that it is the answer to."""
    library = store.library
    entry = None if library is None else library.get(id)
    if entry is None or library is None:
        raise RequestRefused(404, _GONE)
    return KeptWhole(**entry.model_dump(), size=library.size(id))


@routes.patch("/{id}")
def change(id: Id, want: EntryChanges, store: StoreDependency) -> Kept:
    """Rename an entry, change its attributes, keep it when others make room."""
    entry = store.rename(id, want.model_dump(exclude_none=True))
    if entry is None or store.library is None:
        raise RequestRefused(404, _GONE)
    return _shown(store.library, entry)


@routes.delete("/{id}", status_code=204, response_class=Response)
def remove(id: Id, store: StoreDependency) -> None:
    """Take an entry out; it can be brought back until the server ends."""
    if not store.remove(id):
        raise RequestRefused(404, _GONE)


@routes.post("/{id}/restore")
def bring_back(id: Id, store: StoreDependency) -> Kept:
    """Bring back an entry that was taken out."""
    entry = store.bring_back(id)
    if entry is None or store.library is None:
        raise RequestRefused(404, _GONE)
    return _shown(store.library, entry)
