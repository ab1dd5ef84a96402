"""The FastAPI application: routes, one JSON line for every error, and the guard in front of all of it."""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from fastapi.routing import APIRoute
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from console.address import Address
from console.calibration import CalibrationRefused
from console.campaigns.campaigns import CampaignRefused, NoCampaign
from console.description import describe, operation_id
from console.guard import Guard
from console.heartbeats import heartbeat
from console.parts import Parts, parts_of
from console.queue.file import QueueFileError
from console.queue.queue import NoSuchEntry, QueueRefused
from console.queue.sweep import SweepRefused
from console.review.columns import ColumnsGone
from console.review.logs import NotReviewable
from console.review.search import FilterRefused
from console.routes import (
    access,
    calibration,
    cameras,
    campaigns,
    control,
    description,
    foxglove,
    jobs,
    layouts,
    live,
    logs,
    pages,
    playback,
    policy,
    queue,
    recordings,
    retention,
    review,
    robot,
    scene,
    teleoperation,
    training,
    trials,
)
from console.routes.problems import problems
from console.routes.retention import InUse
from console.sign_in import NameTaken
from console.templates import error_page, is_page
from console.trials.card import NoTrial
from rtstack.live.client import RobotRefused, RobotUnreachable
from rtstack.log.errors import LogError
from rtstack.references.acceptance import AcceptanceError

_ROUTES = (
    pages, description, access, robot, control, jobs, queue, trials, campaigns, playback, logs, layouts, retention,
    live, cameras, review, scene, teleoperation, policy, training, recordings, calibration, foxglove,
)  # fmt: skip


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
    app.mount("/static", StaticFiles(directory=Path(__file__).parent / "static"))
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(RequestValidationError, _bad_request)
    app.add_exception_handler(NotReviewable, _not_reviewable)
    for kind, status in _STATUSES.items():
        app.add_exception_handler(kind, _with(status))
    app.add_middleware(Guard, sign_in=parts.sign_in, address=address)
    return app


def _methods(path: str) -> set[str]:
    """Return all methods that a path takes: several routes may share it, and the first one knows its own only."""
    routes = [route for module in _ROUTES for route in module.router.routes if isinstance(route, APIRoute)]
    return {method for route in routes if route.path_regex.match(path) for method in route.methods or ()}


def _answer(request: Request, status: int, text: str, headers: Mapping[str, str] | None = None) -> Response:
    """Return an error: a page where a browser asked for one, else one line of JSON."""
    session = request.state.session
    if is_page(request.method, request.url.path) and session is not None and session.token is None:
        return error_page(status, text, request, parts_of(request))
    return JSONResponse({"error": text}, status_code=status, headers=headers)


def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    methods = ", ".join(sorted(_methods(request.url.path))) if error.status_code == 405 else ""
    if methods:
        text = f"{request.method} is not for this address; it takes {methods}"
        return _answer(request, 405, text, {"allow": methods})
    return _answer(request, error.status_code, str(error.detail), error.headers)


def _bad_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"] if part != "body") or "the request"
    return _answer(request, 422, " ".join(f"{key}: {first['msg']}".split()))


def _not_reviewable(request: Request, error: Exception) -> Response:
    assert isinstance(error, NotReviewable)
    return _answer(request, error.status, str(error))


def _with(status: int) -> Callable[[Request, Exception], Response]:
    return lambda request, error: _answer(request, status, str(error))


_STATUSES: dict[type[Exception], int] = {
    RobotRefused: 409, NameTaken: 409, QueueRefused: 409, CampaignRefused: 409, ColumnsGone: 409, InUse: 409,
    CalibrationRefused: 409,
    NoCampaign: 404, NoSuchEntry: 404, NoTrial: 404,
    FilterRefused: 422, SweepRefused: 422,
    QueueFileError: 500, LogError: 500, AcceptanceError: 500,
    RobotUnreachable: 503,
}  # fmt: skip
