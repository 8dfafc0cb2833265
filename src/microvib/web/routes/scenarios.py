"""Routes about scenarios: the catalog, the form, what is wrong with a scenario."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from functools import lru_cache

from fastapi import APIRouter

from microvib.errors import MicrovibError, OptionError
from microvib.io.data_sheet import read_entry
from microvib.io.named import catalog_names, catalog_text
from microvib.io.new_scenario import sheet_text
from microvib.io.yaml_text import parse_yaml
from microvib.studies.quiet.lever_options import named_levers
from microvib.studies.quiet.objective import has_line_of_sight, line_names
from microvib.studies.quiet.starts import require_constant_rate
from microvib.web.routes import forms
from microvib.web.routes.common import (
    RequestRefused,
    StoreDependency,
    ask,
    reading,
    refusals,
    refused,
    requested,
    view,
)
from microvib.web.routes.forms import Spec
from microvib.web.routes.messages import (
    Assumed,
    Entry,
    Form,
    LeverOf,
    LinesNow,
    LinesOf,
    Problem,
    QuietChoices,
    Sheet,
    SheetField,
    SheetOf,
    View,
)

routes = APIRouter()


@routes.get("/catalog")
def catalog() -> list[Entry]:
    """Published scenarios."""
    return list(catalog_entries())


@lru_cache(maxsize=1)
def catalog_entries() -> tuple[Entry, ...]:
    """Names, titles and sources of the catalog, which does not change."""
    data = ((name, parse_yaml(catalog_text(name), name)) for name in catalog_names())
    return tuple(
        Entry(name=name, title=d.get("title", ""), source=d.get("source", "")) for name, d in data
    )


@lru_cache(maxsize=1)
def form_groups() -> Form:
    """The form, which does not change either."""
    return Form.model_validate({"groups": forms.groups()})


@routes.get("/schema", response_model_exclude_none=True)
def schema(store: StoreDependency) -> Form:
    """Groups of fields, as the drive is built."""
    return form_groups().model_copy(update={"keeps": store.library is not None})


@routes.post("/scenario", responses=refusals(429))
def scenario(spec: Spec, store: StoreDependency) -> View:
    """A scenario with all its values, and what is wrong with it."""
    return View.model_validate(view(store, spec))


@routes.post("/quiet/choices", responses=refusals(429))
def quiet_choices(spec: Spec, store: StoreDependency) -> QuietChoices:
    """Lines and levers that a search for a quieter drive can be asked for."""
    found = requested(store, spec)
    require_constant_rate(found)
    levers = [LeverOf(**asdict(lever)) for lever in named_levers(found)]
    return QuietChoices(
        lines=line_names(found), levers=levers, line_of_sight=has_line_of_sight(found)
    )


@routes.post("/lines", responses=refusals(429))
def lines_now(want: LinesOf, store: StoreDependency) -> LinesNow:
    """Lines of a scenario while somebody waits: nothing is kept."""
    found = requested(store, want.scenario)
    return LinesNow.model_validate(ask(store, "lines_now", scenario=found, linear=want.linear))


@routes.get("/datasheet", response_model_exclude_none=True)
def sheet_entries() -> list[SheetField]:
    """Entries of a data sheet, in the order in which they are asked for."""
    return [SheetField.model_validate(field) for field in forms.sheet_fields()]


@routes.post("/datasheet", responses=refusals(429))
def sheet(want: SheetOf, store: StoreDependency) -> Sheet:
    """The scenario file of a data sheet, as `microvib new --from-datasheet` writes it."""
    with reading(store):
        try:
            text, missing = sheet_text(want.entries)
        except MicrovibError as error:
            told = list(_refused(want.entries)) or [refused(error)]
            return Sheet(
                text=None, assumed=[], errors=[Problem(error=x.sentence, key=x.key) for x in told]
            )
    assumed = [
        Assumed(key=k, value=x.text, why=x.source.removeprefix("assumed: "))
        for k, x in missing.items()
    ]
    return Sheet(text=text, assumed=assumed, errors=[])


def _refused(entries: dict[str, str]) -> Iterator[RequestRefused]:
    """Errors of each entry by itself."""
    for key, text in entries.items():
        try:
            read_entry(key, text)
        except OptionError as error:
            yield refused(error)
