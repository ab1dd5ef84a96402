"""The pages."""

from contextlib import suppress

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from console.live.remedies import chapters
from console.parts import NeedsParts, takes_two_arms
from console.refused import Refused
from console.review.logs import entry_of, opened_entry
from console.routes.recordings import recording_entry
from console.templates import mode_sheet, show, sign_in_page
from rtstack.palette import MODE_STYLES
from rtstack.samples import Reaction
from rtstack.teleoperation import reach
from rtstack.trials.controllers import DEFAULT, controller_names

router = APIRouter(include_in_schema=False)

_REACH = {
    "slowest": reach.SLOWEST_M_S, "fastest": reach.FASTEST_M_S, "speed": reach.SPEED_M_S,
    "softest": reach.SOFTEST_N_M, "hardest": reach.HARDEST_N_M, "stiffness": reach.STIFFNESS_N_M,
}  # fmt: skip
_CHOICES = {"controllers": controller_names(), "reactions": [str(name) for name in Reaction]}


@router.get("/static/css/modes.css", response_class=Response)
def modes() -> Response:
    """Send the style sheet of the modes."""
    return Response(mode_sheet(), media_type="text/css")


@router.get("/", response_class=HTMLResponse)
def operate(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page Operate, or how to sign in."""
    if request.state.session is None:
        refused = getattr(request.state, "refused_token", False)
        return sign_in_page(parts.sign_in.address, request.state.stopper, refused=refused)
    return show("operate.html", "operate", request, parts, reach=_REACH, **_CHOICES)


def _add(address: str, name: str, two_arms: str = "", **shown: object) -> None:
    """Add a page that shows the same to everybody. name: of its template and in the rail; two_arms: what takes them."""

    def page(request: Request, parts: NeedsParts) -> HTMLResponse:
        return show(f"{name}.html", name, request, parts, **shown)

    needs = [takes_two_arms(two_arms)] if two_arms else []
    router.add_api_route(address, page, methods=["GET"], response_class=HTMLResponse, dependencies=needs, name=name)


_add("/trials", "trials", "a queue of trials", default_controller=DEFAULT, **_CHOICES)
_add("/campaigns", "campaigns", "a campaign of trials", default_controller=DEFAULT, **_CHOICES)
_add("/headset", "headset", reach=_REACH)  # for a headset's browser
_add("/access", "access")  # invitations, tokens and the audit trail
_add("/logs", "logs")


@router.get("/recovery", response_class=HTMLResponse)
def recovery(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the runbook's page of what to do about each fault."""
    return show("recovery.html", "recovery", request, parts, chapters=chapters())


@router.get("/recordings/{log_id}", response_class=HTMLResponse, dependencies=[takes_two_arms("a reference")])
def recording(log_id: str, request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page on which a recording is looked at and decided about."""
    return show("recording.html", "operate", request, parts, log=recording_entry(parts, log_id))


@router.get("/logs/{log_id}", response_class=HTMLResponse)
def log_review(log_id: str, request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the review of one log."""
    entry = entry_of(parts.catalogue, log_id)
    with suppress(Refused):  # the page itself asks again, and says why
        opened_entry(entry, parts.review_cache)  # it is read while the browser loads the page
    return show("log.html", "logs", request, parts, log=entry, modes=MODE_STYLES)
