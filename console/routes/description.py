"""The page of the HTTP interface. Swagger UI comes from an installed package: nothing of it is kept here or fetched."""

from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.exceptions import HTTPException
from fastapi.responses import FileResponse, HTMLResponse

from console.parts import NeedsParts
from console.templates import show

router = APIRouter(include_in_schema=False)

OPENAPI_PATH = "/api/openapi.json"
_PACKAGE = "fastapi-offline"
_ASSETS = f"/assets/swagger-ui-{version(_PACKAGE)}"
_TYPES = {"swagger-ui-bundle.js": "text/javascript", "swagger-ui.css": "text/css"}


def _installed() -> Path:
    spec = find_spec("fastapi_offline")  # found, not imported: we want two of its files
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "static"


_FOLDER = _installed()


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
    return FileResponse(_FOLDER / name, media_type=_TYPES[name], headers=cached)
