"""The application: all routes, the page's files, and what is said when something is wrong."""

from __future__ import annotations

from importlib import resources
from importlib.util import find_spec
from pathlib import Path

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from microvib import __version__
from microvib.errors import MicrovibError
from microvib.reports.moving import SCRIPT
from microvib.web.jobs.store import Store
from microvib.web.routes import new_jobs, results, scenarios
from microvib.web.routes.common import RequestRefused, refusals, refused
from microvib.web.server.access import Access
from microvib.web.server.guard import FAULT, Guard

_PLAIN = {
    400: "the request cannot be understood",
    404: "no such address",
    405: "not allowed at this address",
}


def create_app(store: Store, access: Access) -> Guard:
    """The application on top of ``store``, behind its guard."""
    app = FastAPI(
        title="microvib", version=__version__, openapi_url="/api/openapi.json", docs_url=None, redoc_url=None,
        description="What the page of `microvib serve` asks. Values in SI units; quantities that are given are texts with units.",
    )  # fmt: skip
    app.state.store = store
    api = APIRouter(prefix="/api", responses=refusals(400, 401, 403, 408, 411, 413, 422))
    for part in (scenarios, new_jobs, results):
        api.include_router(part.routes)
    app.include_router(api)
    _add_page(app)
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
            ("/result", "/series", "/spectrum")
        )
        await (super().__call__ if packs else self.app)(scope, receive, send)


def _add_page(app: FastAPI) -> None:
    static = Path(str(resources.files("microvib.web"))) / "static"

    @app.get("/", include_in_schema=False)
    def page() -> FileResponse:
        return FileResponse(static / "index.html")

    files = StaticFiles(directory=static)

    def script(path: Path, request: Request) -> Response:
        """A script, or, as of the other files, that it is still the one that the browser has."""
        answer = files.file_response(path, path.stat(), request.scope)
        answer.headers["content-type"] = "text/javascript"
        return answer

    @app.get("/static/plotly.min.js", include_in_schema=False)
    def plotly(request: Request) -> Response:
        return script(_plotly(), request)

    @app.get("/static/shapes.js", include_in_schema=False)
    def shapes(request: Request) -> Response:
        return script(SCRIPT, request)

    app.mount("/static", files)


def _plotly() -> Path:
    """Plotly's script, without importing the package, which takes a second."""
    spec = find_spec("plotly")
    if spec is None or spec.origin is None:
        raise RequestRefused(404, "plotly is not installed; pip install 'microvib[serve]'")
    return Path(spec.origin).parent / "package_data" / "plotly.min.js"


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
