"""Shared parts of the routes: the store, refusals, and the way from a request to a scenario and to a
job.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

from fastapi import Depends, Request
from pydantic import BaseModel

from microvib.errors import MicrovibError, OptionError
from microvib.model.scenario import Scenario
from microvib.web.jobs.processes import Job, QueueFull
from microvib.web.jobs.store import Store
from microvib.web.routes import forms
from microvib.web.routes.forms import Spec
from microvib.web.routes.messages import Problem, Started

_MEANINGS = {
    400: "cannot be understood",
    401: "a token is required",
    403: "refused",
    404: "not there",
    408: "sent too slowly",
    409: "not available yet, or no longer available",
    411: "length needed",
    413: "too large",
    422: "not allowed",
    429: "too many computations are waiting",
    507: "no room",
}


_BUSY = "the server is busy; try again in a moment"


class RequestRefused(Exception):
    """An answer that is a sentence."""

    def __init__(self, status: int, sentence: str, key: str | None = None) -> None:
        super().__init__(sentence)
        self.status, self.sentence, self.key = status, sentence, key


def refusals(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Description of the refusals that an address may answer with."""
    return {s: {"model": Problem, "description": _MEANINGS[s]} for s in statuses}


def _store(request: Request) -> Store:
    return request.app.state.store


StoreDependency = Annotated[Store, Depends(_store)]


def ask(store: Store, task: str, **arguments: Any) -> Any:
    """Result of a short task; Refused with its sentence."""
    try:
        job = store.ask(task, **arguments)
    except QueueFull:
        raise RequestRefused(429, _BUSY) from None
    if job.state != "done":
        raise RequestRefused(422, job.error or "the server is shutting down")
    return job.value


def view(store: Store, spec: Spec) -> dict[str, Any]:
    """A scenario as the form shows it; what takes long is found out by a worker, and kept."""
    with reading(store):
        if not forms.is_slow_to_read(spec):
            return forms.view_of(spec)
    text = spec.model_dump_json()
    found: dict[str, Any] | None = store.views.get(text)
    if found is None:
        found = ask(store, "view", spec=spec.model_dump())
        store.keep_view(text, found)
    return found


def requested(store: Store, spec: Spec) -> Scenario:
    """The scenario of a request; Refused with what is wrong with it."""
    try:
        with reading(store):
            if not forms.is_slow_to_read(spec):
                return forms.scenario(spec)
    except MicrovibError as error:
        raise refused(error, spec.name) from None
    shown = view(store, spec)
    if shown["errors"]:
        raise RequestRefused(422, **_first(shown["errors"]))
    with reading(store):
        return forms.scenario(Spec(text=shown["yaml"]))


@contextmanager
def reading(store: Store) -> Iterator[None]:
    """One reads at a time, because threads that compute slow down the one that answers; Refused
    where many wait.
    """
    if not store.waiting.acquire(blocking=False):
        raise RequestRefused(429, _BUSY)
    try:
        with store.reading:
            yield
    finally:
        store.waiting.release()


def refused(error: MicrovibError, name: str = forms.NAME) -> RequestRefused:
    """The refusal that says what an error says."""
    if isinstance(error, OptionError):
        return RequestRefused(422, str(error), error.key)
    return RequestRefused(422, **_first(forms.sentences(str(error), name)))


def _first(errors: list[dict[str, Any]]) -> dict[str, Any]:
    return {"sentence": errors[0]["error"], "key": errors[0]["key"]}


def start(store: Store, kind: str, title: str, want: BaseModel, **arguments: Any) -> Started:
    """A new job that answers the request ``want``; Refused where too many wait."""
    asked = want.model_dump(mode="json", by_alias=True)
    try:
        job: Job = store.submit(kind, title[:200], asked, **arguments)
    except QueueFull:
        raise busy(store) from None
    return Started(id=job.id)


def busy(store: Store) -> RequestRefused:
    """Refusal of one more computation where too many wait."""
    return RequestRefused(
        429,
        f"{store.limits.waiting} computations are waiting already; cancel some, or wait for them",
    )
