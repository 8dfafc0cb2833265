"""Routes about scenarios: the catalog, the form, what is wrong with a scenario."""

from __future__ import annotations

from fastapi import APIRouter

from microvib.io.scenario_file import catalog_names, catalog_text
from microvib.io.yaml_text import parse_yaml
from microvib.web.routes import forms
from microvib.web.routes.common import At, refusals, view
from microvib.web.routes.forms import Spec
from microvib.web.routes.messages import Entry, Form, View

routes = APIRouter()


@routes.get("/catalog")
def catalog() -> list[Entry]:
    """Published scenarios."""
    data = ((name, parse_yaml(catalog_text(name), name)) for name in catalog_names())
    return [Entry(name=name, title=d.get("title", ""), source=d.get("source", "")) for name, d in data]


@routes.get("/schema", response_model_exclude_none=True)
def schema() -> Form:
    """Groups of fields, as the drive is built."""
    return Form.model_validate({"groups": forms.groups()})


@routes.post("/scenario", responses=refusals(429))
def scenario(spec: Spec, store: At) -> View:
    """A scenario with all its values, and what is wrong with it."""
    return View.model_validate(view(store, spec))
