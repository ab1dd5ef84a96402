"""The FastAPI application: routes, one JSON line for every error, and the guard in front of all of it."""

import errno
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from fastapi.routing import APIRoute
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.types import Scope

from console.address import Address
from console.guard import Guard
from console.live.heartbeats import heartbeat
from console.parts import Parts, parts_of
from console.refused import Refused

from console.routes import (  # isort: skip
    access, calibration, cameras, campaigns, control, description, jobs, layouts, live, logs, pages, panels, policy,
    queue, recordings, retention, review, scene, teleoperation, training, trials,
)  # fmt: skip
from console.routes.description import describe, operation_id
from console.routes.problems import problems
from console.templates import KEPT, STATIC, error_page, is_page
from hal.base.configuration import ConfigurationError
from rtstack.access.tokens import NoSuchToken, TokensError
from rtstack.live.client import RobotRefused, RobotUnreachable
from rtstack.log.errors import LogError
from rtstack.log_folder.log_rows import NoReference
from rtstack.log_folder.search import FilterRefused
from rtstack.references.acceptance import AcceptanceError
from rtstack.trials.errors import TrialError

_ROUTES = (
    pages, description, access, live, control, jobs, queue, trials, campaigns, logs, layouts, retention,
    cameras, review, scene, teleoperation, policy, training, recordings, calibration, panels,
)  # fmt: skip


class _Files(StaticFiles):
    """Style and scripts; below the word of console.templates.static for as long as a browser wants to keep them."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        word, _, kept = path.partition("/")
        if not word.startswith(KEPT):
            return await super().get_response(path, scope)
        answer = await super().get_response(kept, scope)
        answer.headers["cache-control"] = "public, max-age=31536000, immutable"
        return answer


def create_app(parts: Parts, address: Address) -> FastAPI:
    """Return the application for a console that is reached at an address."""

    @asynccontextmanager
    async def alive(_: FastAPI) -> AsyncIterator[None]:
        async with heartbeat(parts.mailbox):
            yield

    app = FastAPI(
        title="rtstack console",
        version=version("rtstack"),
        docs_url=None,
        redoc_url=None,
        openapi_url=description.OPENAPI_PATH,
        generate_unique_id_function=operation_id,
        responses=problems(400, 401, 403),
        lifespan=alive,
    )
    app.state.parts = parts
    for module in _ROUTES:
        app.include_router(module.router)
    describe(app)
    app.mount("/static", _Files(directory=STATIC))
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(RequestValidationError, _bad_request)
    app.add_exception_handler(OSError, _no_disk)
    app.add_exception_handler(Exception, _unexpected)
    for kind in (Refused, *_STATUSES):
        app.add_exception_handler(kind, _refused)
    app.add_middleware(Guard, sign_in=parts.sign_in, address=address)
    return app


def _answer(request: Request, status: int, text: str, headers: Mapping[str, str] | None = None) -> Response:
    """Return an error: a page where a browser asked for one, else one line of JSON."""
    session = request.state.session
    if is_page(request.method, request.url.path) and session is not None and session.token is None:
        return error_page(status, text, request, parts_of(request))
    return JSONResponse({"error": text}, status_code=status, headers=headers)


def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    # several routes may share a path, and the first one knows its own methods only
    routes = [each for module in _ROUTES for each in module.router.routes if isinstance(each, APIRoute)]
    same = [each for each in routes if error.status_code == 405 and each.path_regex.match(request.url.path)]
    if methods := ", ".join(sorted({method for each in same for method in each.methods or ()})):
        text = f"{request.method} is not for this address; it takes {methods}"
        return _answer(request, 405, text, {"allow": methods})
    return _answer(request, error.status_code, str(error.detail), error.headers)


def _bad_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"] if part != "body") or "the request"
    return _answer(request, 422, " ".join(f"{key}: {first['msg']}".split()))


def _no_disk(request: Request, error: Exception) -> Response:
    """Answer where a file cannot be read or written."""
    assert isinstance(error, OSError)
    name = f"{Path(str(error.filename)).name}: " if error.filename else ""
    status, todo = _DISK.get(error.errno or 0, (500, "check the folder of logs, then try again"))
    return _answer(request, status, f"{name}{error.strerror or error}; {todo}")


def _unexpected(_: Request, error: Exception) -> Response:
    text = f"internal error: {type(error).__name__}; the console's terminal says where: please report it"
    return JSONResponse({"error": text}, status_code=500, headers={"x-content-type-options": "nosniff"})


def _refused(request: Request, error: Exception) -> Response:
    own = error.status if isinstance(error, Refused) else None
    status = own or next(_STATUSES[kind] for kind in type(error).__mro__ if kind in _STATUSES)
    return _answer(request, status, str(error))


_FULL = 507, "delete logs on the page Logs, or make room on the disk in another way"
_BUSY = 503, "close pages and other programs, then try again"
_DISK = {
    errno.ENOSPC: _FULL, errno.EDQUOT: _FULL, errno.EFBIG: _FULL, errno.EMFILE: _BUSY, errno.ENFILE: _BUSY,
    errno.ENOMEM: _BUSY, errno.EAGAIN: _BUSY, errno.ENOENT: (404, "it was removed meanwhile: load the page again"),
}  # fmt: skip
_STATUSES: dict[type[Exception], int] = {
    NoSuchToken: 404,
    RobotRefused: 409, NoReference: 409, TokensError: 409, ConfigurationError: 409, TrialError: 409,
    FilterRefused: 422,
    LogError: 500, AcceptanceError: 500,
    RobotUnreachable: 503,
}  # fmt: skip
