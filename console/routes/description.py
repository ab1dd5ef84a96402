"""How the console describes itself: OpenAPI, from the routes' types and docstrings, and what does not stand there.

A route's summary is the first sentence of its docstring. Swagger UI comes from an installed package.
"""

import re
from importlib.metadata import distribution
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import HTTPException
from fastapi.openapi.utils import get_openapi
from fastapi.responses import FileResponse, HTMLResponse
from fastapi.routing import APIRoute

from console.guard import CSRF_HEADER, MAX_BODY_BYTES
from console.parts import NeedsParts
from console.routes.cameras import WINDOW
from console.routes.problems import problems
from console.templates import TEMPLATES, show

router = APIRouter(include_in_schema=False)

OPENAPI_PATH = "/api/openapi.json"
_SWAGGER = distribution("fastapi-offline")  # not imported: we want two of its files
_ASSETS = f"/assets/swagger-ui-{_SWAGGER.version}"
_TYPES = {"swagger-ui-bundle.js": "text/javascript", "swagger-ui.css": "text/css"}
_TAGS = {
    "access": "Sessions, invitations, tokens, and the trail of who did what.",
    "robot": "What the robot says.",
    "control": "The lease, arming, STOP, recovery.",
    "calibration": "Where bases, pads and tracker are: points, what they give, the cell's file.",
    "jobs": "What the robot is asked to carry out.",
    "queue": "Trials that wait, in the name of the operator who has control.",
    "trials": "What trials have come to: cards, means of sweeps.",
    "campaigns": "The papers' campaigns on simulated arms: progress, results, figures, reports.",
    "teleoperation": "Teleoperation of the arms.",
    "training": "Faults of simulated arms at a random moment, and what the operator did about them.",
    "recordings": "Demonstrations: extracted, accepted, thrown away.",
    "panels": "What panels of installed packages show.",
    "logs": "The list of logs, what the review reads of one, what people say about them, and the trash.",
}


def operation_id(route: APIRoute) -> str:
    """Return a route's name for programs: its group and what it does."""
    return "_".join([*(str(tag) for tag in route.tags[:1]), route.name])


def describe(app: FastAPI) -> None:
    """Have the application answer for itself at OPENAPI_PATH."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            page = TEMPLATES.get_template("interface.md")
            text = page.render(csrf_header=CSRF_HEADER, kib=MAX_BODY_BYTES >> 10, window=WINDOW)
            document = get_openapi(title=app.title, version=app.version, description=text, routes=app.routes)
            app.openapi_schema = _completed(document)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _completed(document: dict[str, Any]) -> dict[str, Any]:
    refused = document["components"]["schemas"]
    for name in ("HTTPValidationError", "ValidationError"):  # FastAPI's own form, which is never sent
        refused.pop(name, None)
    for operations in document["paths"].values():
        for method, operation in operations.items():
            paragraph, _, rest = operation.get("description", "").partition("\n\n")
            sentence, _, more = re.sub(r"\s+", " ", paragraph).partition(". ")
            operation["summary"] = sentence.rstrip(".")
            operation["description"] = "\n\n".join(part for part in (more, rest) if part)
            responses = operation["responses"]
            if "422" in responses:
                responses["422"] = _problem(422)
            if method != "get":
                responses["413"] = _problem(413)
    document["components"]["securitySchemes"] = {
        "bearer": {"type": "http", "scheme": "bearer"},
        "word": {"type": "apiKey", "in": "header", "name": CSRF_HEADER, "description": "with the session's cookie"},
    }
    document["security"] = [{"bearer": []}, {"word": []}]
    used = {tag for operations in document["paths"].values() for one in operations.values() for tag in one["tags"]}
    document["tags"] = [{"name": name, "description": text} for name, text in _TAGS.items() if name in used]
    return document


def _problem(status: int) -> dict[str, Any]:
    schema = {"$ref": "#/components/schemas/Problem"}
    return {"description": problems(status)[status]["description"], "content": {"application/json": {"schema": schema}}}


@router.get("/api", response_class=HTMLResponse)
def interface(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page on which every request can be read about and tried out."""
    return show("api.html", "api", request, parts, assets=_ASSETS, description=OPENAPI_PATH)


@router.get(_ASSETS + "/{name}")
def asset(name: str) -> FileResponse:
    """Send a file of Swagger UI; the version is in its address, so that it may be kept."""
    if name not in _TYPES:
        raise HTTPException(404, "there is no such file")
    cached = {"cache-control": "private, max-age=31536000, immutable"}
    path = str(_SWAGGER.locate_file(f"fastapi_offline/static/{name}"))
    return FileResponse(path, media_type=_TYPES[name], headers=cached)
