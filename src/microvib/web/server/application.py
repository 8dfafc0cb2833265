"""The application: all routes, the page's files, and what is said when something is wrong."""

from __future__ import annotations

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import Receive, Scope, Send

from microvib import __version__
from microvib.errors import MicrovibError
from microvib.web.jobs.store import Store
from microvib.web.routes import (
    budgets,
    campaigns,
    envelopes,
    kept,
    new_jobs,
    processing,
    recordings,
    results,
    scenarios,
    table_tests,
)
from microvib.web.routes.common import RequestRefused, refusals, refused
from microvib.web.server.access import Access
from microvib.web.server.assets import FOREVER, PLOTLY, Asset, Assets
from microvib.web.server.guard import FAULT, Guard

_PLAIN = {
    400: "the request cannot be understood",
    404: "no such address",
    405: "not allowed at this address",
}


def create_app(store: Store, access: Access, assets: Assets | None = None) -> Guard:
    """The application on top of ``store``, behind its guard."""
    app = FastAPI(
        title="microvib", version=__version__, openapi_url="/api/openapi.json", docs_url=None, redoc_url=None,
        description="What the page of `microvib serve` asks. Values in SI units; quantities that are given are texts with units.",
    )  # fmt: skip
    app.state.store = store
    api = APIRouter(prefix="/api", responses=refusals(400, 401, 403, 408, 411, 413, 422))
    for part in (
        scenarios,
        new_jobs,
        budgets,
        envelopes,
        recordings,
        processing,
        table_tests,
        campaigns,
        results,
        kept,
    ):
        api.include_router(part.routes)
    app.include_router(api)
    _add_page(app, assets or Assets())
    app.add_middleware(_Packed, minimum_size=10_000, compresslevel=4)
    for kind in (RequestRefused, MicrovibError, RequestValidationError, HTTPException, Exception):
        app.add_exception_handler(kind, _problem_of)
    return Guard(app, access, store.limits)


class _Packed(GZipMiddleware):
    """Packs long tables of numbers, which lose most of their length: a rate map has two megabytes.
    Files go as they are.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        packs = scope["type"] == "http" and scope["path"].endswith(
            ("/result", "/series", "/spectrum", "/waterfall", "/schema", "/scenario", "/so-far")
        )
        await (super().__call__ if packs else self.app)(scope, receive, send)


def _add_page(app: FastAPI, assets: Assets) -> None:
    @app.get("/", include_in_schema=False)
    def page(request: Request) -> Response:
        return _asset_response(assets.page, request)

    @app.get("/static/{digest}/{name}", include_in_schema=False)
    def lasting(digest: str, name: str, request: Request) -> Response:
        if digest != assets.digest:
            raise HTTPException(404)
        return _asset_response(_asset(assets, name), request, FOREVER)

    @app.get("/static/{name}", include_in_schema=False)
    def current(name: str, request: Request) -> Response:
        return _asset_response(_asset(assets, name), request)


def _asset(assets: Assets, name: str) -> Asset:
    found = assets.get(name)
    if found is None and name == PLOTLY:
        raise RequestRefused(404, "plotly is not installed; pip install 'microvib[serve]'")
    if found is None:
        raise HTTPException(404)
    return found


def _asset_response(asset: Asset, request: Request, caching: str | None = None) -> Response:
    """A file of the page, packed for who can unpack it; or that it is still what the browser has."""
    headers = {"vary": "accept-encoding", "etag": asset.tag}
    if caching is not None:
        headers["cache-control"] = caching
    if asset.tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    content = asset.content
    if "gzip" in request.headers.get("accept-encoding", ""):
        content, headers["content-encoding"] = asset.packed, "gzip"
    return Response(content, headers=headers, media_type=asset.media_type)


def _problem_of(request: Request, error: Exception) -> JSONResponse:
    """Error as a sentence with the key that it is about."""
    told = _refusal(error)
    return JSONResponse({"error": told.sentence, "key": told.key}, told.status)


def _refusal(error: Exception) -> RequestRefused:
    match error:
        case RequestRefused():
            return error
        case MicrovibError():
            return refused(error)
        case HTTPException():
            return RequestRefused(
                error.status_code, _PLAIN.get(error.status_code, str(error.detail))
            )
        case RequestValidationError():
            first = error.errors()[0]
            if first["type"] == "json_invalid":
                return RequestRefused(422, "the request is not JSON")
            key = ".".join(str(part) for part in first["loc"][1:]) or None
            message = (
                first["msg"].removeprefix("Value error, ").replace("Input should", "it should")
            )
            return RequestRefused(422, f"{key or 'the request'}: {message}", key)
    return RequestRefused(500, FAULT)  # the guard writes the log
