"""The pages."""

from contextlib import suppress
from typing import Literal
from urllib.parse import parse_qs

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from markupsafe import Markup
from starlette.concurrency import run_in_threadpool

from console.guard import PAGE_POLICY, SIGN_IN
from console.live.remedies import chapters
from console.parts import NeedsParts, Parts, parts_of, takes_two_arms
from console.refused import Refused
from console.review.logs import entry_of, opened_entry
from console.routes.recordings import recording_entry
from console.templates import TEMPLATES, mode_sheet, show, sign_in_page
from rtstack.palette import MODE_STYLES
from rtstack.samples import Reaction
from rtstack.teleoperation import reach
from rtstack.trials.controllers import DEFAULT, controller_names, detector_names
from rtstack.trials.tightening import limits_of_arms

router = APIRouter(include_in_schema=False)

_REACH = {
    "slowest": reach.SLOWEST_M_S, "fastest": reach.FASTEST_M_S, "speed": reach.SPEED_M_S,
    "softest": reach.SOFTEST_N_M, "hardest": reach.HARDEST_N_M, "stiffness": reach.STIFFNESS_N_M,
}  # fmt: skip
_PANEL_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
)
_CHOICES = {
    "controllers": controller_names(),
    "detectors": detector_names(),
    "reactions": [str(name) for name in Reaction],
}


@router.get("/static/css/modes.css", response_class=Response)
def modes() -> Response:
    """Send the style sheet of the modes."""
    return Response(mode_sheet(), media_type="text/css")


@router.get("/", response_class=HTMLResponse)
def operate(request: Request, parts: NeedsParts, token: str = "", code: str = "") -> Response:
    """Return the page Operate, or how to sign in.

    The address signs a browser in that has no session, and that no other site has led here. Else our own page has to
    be confirmed first: no link replaces a session, and no picture of another site guesses a code.
    """
    session = request.state.session
    if session is not None and not (token or code):
        limits = zip(parts.cell.sides, limits_of_arms(parts.cell), strict=True)
        forces = {side: round(min(each.force_max, each.force_contact_max)) for side, each in limits}
        return show("operate.html", "operate", request, parts, reach=_REACH, force_limits=forces, **_CHOICES)
    if session is None and (token or code) and request.headers.get("sec-fetch-site", "none") in ("none", "same-origin"):
        return _signed_in(request, parts, token, code)
    if parts.sign_in.reopened(token, session):
        return RedirectResponse("/", status_code=303)
    if (session is None or session.token is None) and parts.sign_in.is_open(token):
        operator = "" if session is None else session.operator
        return sign_in_page(parts.sign_in.address, request.state.stopper, 200, token=token, operator=operator)
    if session is None:
        return sign_in_page(parts.sign_in.address, request.state.stopper, 401)
    return RedirectResponse("/", status_code=303)


async def sign_in(request: Request) -> Response:
    """Sign a browser in by the token or the code in a form of ours, which its Origin shows: there is no word yet."""
    asked = parse_qs((await request.body()).decode("ascii", "replace"))
    token, code = (asked.get(name, [""])[0] for name in ("token", "code"))
    return await run_in_threadpool(_signed_in, request, parts_of(request), token, code)


router.add_route(SIGN_IN, sign_in, methods=["POST"])  # of pages alone: no part of the interface


def _signed_in(request: Request, parts: Parts, token: str, code: str) -> Response:
    known, session = parts.sign_in, request.state.session
    client = "" if request.client is None else request.client.host
    new = known.redeem(token, session) if token else known.redeem_code(code, session, client)
    if new is None:
        waits_s = 0.0 if token else known.waits_s(client)
        known.refused(f"a {'token' if token else 'code'}{', which has to wait now,' * (waits_s > 0)}", client)
        return sign_in_page(known.address, request.state.stopper, 429 if waits_s else 403, waits_s=waits_s)
    clean = RedirectResponse("/", status_code=303)  # the token stays in no address bar and in no history
    for name, value in ((known.cookie, new.key), (known.stop_cookie, new.stop)):
        clean.set_cookie(name, value, httponly=True, samesite="strict", path="/", secure=known.address.https)
    return clean


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


@router.get("/panels", response_class=HTMLResponse)
def panels(request: Request, parts: NeedsParts) -> HTMLResponse:
    """Return the page of the panels. Its frames may show no other address than theirs."""
    page = show("panels.html", "panels", request, parts, panels=parts.panels.packages())
    frames = f"frame-src {request.base_url}panels/"
    page.headers["content-security-policy"] = PAGE_POLICY.replace("frame-src 'self'", frames)
    return page


@router.get("/panels/{name}", response_class=Response)
def panel_frame(name: str, parts: NeedsParts, theme: Literal["dark", "light"] = "dark") -> Response:
    """Return the document in a panel's frame: of an origin of its own, which reaches no address at all."""
    html = TEMPLATES.get_template("panel_frame.html").render(theme=theme, html=Markup(parts.panels.html(name)))
    return Response(html, media_type="text/html", headers={"content-security-policy": _PANEL_POLICY})


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
