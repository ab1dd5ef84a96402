"""The pages."""

from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from console.parts import NeedsParts
from console.queue.entry import MAX_REPETITIONS
from console.review.logs import entry_of
from console.review.plotting import MAPLIBRE_STYLE, PLOTLY_PATH
from console.routes.recordings import recording_entry
from rtstack.samples import Mode, Reaction
from rtstack.teleoperation.reach import (
    FASTEST_M_S,
    HARDEST_N_M,
    SLOWEST_M_S,
    SOFTEST_N_M,
    SPEED_M_S,
    STIFFNESS_N_M,
)
from rtstack.trials.specification import Controller

router = APIRouter(include_in_schema=False)

_REACH = {
    "slowest": SLOWEST_M_S,
    "fastest": FASTEST_M_S,
    "speed": SPEED_M_S,
    "softest": SOFTEST_N_M,
    "hardest": HARDEST_N_M,
    "stiffness": STIFFNESS_N_M,
}

_CHOICES = {"controllers": [str(name) for name in Controller], "reactions": [str(name) for name in Reaction]}

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1] / "pages"), autoescape=True, undefined=StrictUndefined
)


@router.get("/", response_class=HTMLResponse)
def operate(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page Operate, or how to sign in."""
    session = request.state.session
    if session is None:
        refused = getattr(request.state, "refused_token", False)
        page = TEMPLATES.get_template("sign_in.html").render(csrf=None, refused=refused)
        return HTMLResponse(page, status_code=403 if refused else 401)
    page = TEMPLATES.get_template("operate.html").render(
        csrf=session.csrf, page="operate", cell=parts.cell, reach=_REACH, **_CHOICES
    )
    return HTMLResponse(page)


@router.get("/trials", response_class=HTMLResponse)
def trials(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page of the queue and of the trials that there are."""
    page = TEMPLATES.get_template("trials.html")
    return HTMLResponse(
        page.render(
            csrf=request.state.session.csrf,
            page="trials",
            cell=parts.cell,
            most_repetitions=MAX_REPETITIONS,
            **_CHOICES,
        )
    )


@router.get("/campaigns", response_class=HTMLResponse)
def campaigns(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page of all campaigns."""
    page = TEMPLATES.get_template("campaigns.html")
    return HTMLResponse(page.render(csrf=request.state.session.csrf, page="campaigns", cell=parts.cell))


@router.get("/recordings/{log_id}", response_class=HTMLResponse)
def recording(log_id: str, request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page on which a recording is looked at and decided about."""
    entry = recording_entry(parts, log_id)
    page = TEMPLATES.get_template("recording.html")
    return HTMLResponse(
        page.render(
            csrf=request.state.session.csrf,
            page="operate",
            cell=parts.cell,
            log=entry,
            plotly=PLOTLY_PATH,
            maplibre=MAPLIBRE_STYLE,
        )
    )


@router.get("/logs", response_class=HTMLResponse)
def log_list(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page of all logs."""
    page = TEMPLATES.get_template("logs.html")
    return HTMLResponse(page.render(csrf=request.state.session.csrf, page="logs", cell=parts.cell))


@router.get("/logs/{log_id}", response_class=HTMLResponse)
def log_review(log_id: str, request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the review of one log."""
    entry = entry_of(parts.catalogue, log_id)
    page = TEMPLATES.get_template("log.html")
    return HTMLResponse(
        page.render(
            csrf=request.state.session.csrf,
            page="logs",
            cell=parts.cell,
            log=entry,
            plotly=PLOTLY_PATH,
            maplibre=MAPLIBRE_STYLE,
            modes=Mode,
        )
    )
